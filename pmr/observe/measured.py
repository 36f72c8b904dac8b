"""Observers from files, measurements from tables in CSV, and the files in which estimates are written."""

from __future__ import annotations

import csv
import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pydantic
from numpy.typing import NDArray

from pmr.errors import InputError, missing_file_reason
from pmr.files.arrays import Array, Summary
from pmr.files.whole import replacement_file, write_text
from pmr.observe.budget import output_errors
from pmr.observe.identify import read_table
from pmr.observe.linear import linearize
from pmr.observe.observer import Estimates, Observer, Payload, Sensor, UnknownLoad
from pmr.scene.scene import Scene
from pmr.system.system import System

TIME = "t"
#: Largest difference of a payload's gravity to that of the scene, as a share of it.
SAME_GRAVITY = 0.01


@dataclass(frozen=True)
class ObserverFile:
    """Content of a file that describes an observer: outputs to be estimated, sensors, unknown loads and payload."""

    __pydantic_config__ = pydantic.ConfigDict(extra="forbid", allow_inf_nan=False)

    estimate: tuple[str, ...]  # outputs, or keys of the table of quantities
    sensors: tuple[Sensor, ...]
    loads: tuple[UnknownLoad, ...] = ()
    payload: Payload | None = None
    step: float | None = None  # s; by default that of the scene
    error_time: float = 0.5  # s, above 0

    @classmethod
    def read(cls, file: Path) -> ObserverFile:
        """Read the TOML file of an observer; raises an InputError that names the file and the wrong key."""
        try:
            content = tomllib.loads(file.read_text(encoding="utf-8"))
            return pydantic.TypeAdapter(cls).validate_python(content)
        except OSError:
            raise InputError(str(file), "", None, missing_file_reason(file)) from None
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise InputError(str(file), "", None, f"TOML is allowed: {error}") from None
        except pydantic.ValidationError as error:
            first = error.errors()[0]
            value = None if first["type"] == "missing" else first["input"]
            raise InputError(str(file), ".".join(map(str, first["loc"])), value, first["msg"].lower()) from None

    def observer(self, scene: Scene, system: System, summary: Summary) -> Observer:
        """Return the observer that this file describes, for a reduced `system` that moves along the paths of `scene`.

        `summary` is the content of the run's ``summary.json``; the errors that it states for outputs count as errors of
        the observer's model.  Raises InputError if the payload's gravity is not the scene's gravity along -z; also as
        `linearize` and `Observer`.
        """
        if self.payload is not None and self.payload.gravity and scene.gravity is not None:
            across = -scene.gravity.acceleration * scene.gravity.direction[2]
            if abs(self.payload.gravity - across) > SAME_GRAVITY * scene.gravity.acceleration:
                allowed = f"{across:.6g} m/s^2 is allowed, the component of the scene's gravity along z"
                raise InputError("observe", "payload.gravity", self.payload.gravity, allowed)
        inputs = [load.input for load in self.loads] + ([] if self.payload is None else [self.payload.input])
        outputs = [*self.estimate, *(sensor.output for sensor in self.sensors)]
        model = linearize(scene, system, outputs, tuple(dict.fromkeys(inputs)), self.step)
        errors = output_errors(summary, model, scene.time.step)
        return Observer(model, self.sensors, self.loads, self.payload, (), errors, self.error_time)


@dataclass(frozen=True)
class Observation:
    """Estimates from measurements, and what each sensor contributes to them.

    `observability` is what `Observer.observability` returns.  `without` says what each sensor contributes: if the
    sensor is left out, the standard deviation of each estimate is multiplied by the factor in `without`
    (`Observation.compute`).
    """

    observer: Observer
    estimates: Estimates
    measured: Array  # (T, p): measurements at the steps of the model, NaN where there is none
    observability: Mapping[str, float]
    without: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    truth: Mapping[str, Array] = field(default_factory=dict)  # (T,) at the steps of the model, NaN where not known
    title: str = ""
    beyond: Mapping[str, int] = field(default_factory=dict)  # numbers of values beyond the motion, by sensor

    @classmethod
    def compute(
        cls,
        observer: Observer,
        measured: Mapping[str, tuple[Array, Array]],
        leave_out: bool = False,
        truth: Mapping[str, tuple[Array, Array]] | None = None,
        title: str = "",
    ) -> Observation:
        """Estimate from measurements; if `leave_out` is true, also compute the bands without each sensor in turn.

        `measured` has times (n,) in s and values (n,) by the outputs of the sensors.  For each sensor, `without` of the
        result has a factor for each estimate: the mean standard deviation without this sensor, divided by that with all
        sensors.  A sensor has no factors if no other sensor has a measurement.  If `leave_out` is false, `without` is
        empty.

        `truth` has times (n,) in s and true values (n,) of estimates by their names, None if no true values are known.
        `title` is the title of the report.  Raises the errors of `Observer.run`, and InputError for a name in `truth`
        without an estimate, or without a value at the model's steps.
        """
        estimates, without = observer.run(measured), dict[str, dict[str, float]]()
        names, true = (*estimates.unknowns, *estimates.outputs), dict[str, Array]()
        for name, (times, values) in (truth or {}).items():
            estimates.of(name)
            true[name] = observer.model.sample(name, times, values)
            if not np.isfinite(true[name]).any():
                raise InputError("observe", f"truth.{name}", None, "values at the times of the model are allowed")
        sampled, observability = observer.grid(measured), observer.observability()
        for k, sensor in enumerate(observer.sensors if leave_out else ()):
            if not np.isfinite(np.delete(sampled, k, axis=1)).any():
                continue
            remaining = [each for each in observer.sensors if each is not sensor]
            used = {name: values for name, values in measured.items() if name != sensor.output}
            fewer = replace(observer, sensors=remaining).run(used)
            without[sensor.output] = {
                name: float(np.mean(fewer.of(name).deviation))
                / max(float(np.mean(estimates.of(name).deviation)), 1e-300)
                for name in names
                if name in (*fewer.unknowns, *fewer.outputs)
            }
        steps = {name: observer.model.nearest_steps(np.asarray(times)) for name, (times, _) in measured.items()}
        beyond = {  # the model's first step ends at t = step: a value at the start of the motion is none beyond it
            name: int(np.sum(np.isfinite(values) & ((steps[name] < -1) | (steps[name] >= len(observer.model.t)))))
            for name, (_, values) in measured.items()
        }
        return cls(observer, estimates, sampled, observability, without, true, title, beyond)

    def summary(self) -> dict[str, Any]:
        """Content of ``observe.json``: last estimates, observability, whiteness, alarms, errors, sensors left out.

        ``first_alarm`` has the time in s of each sensor's first alarm; sensors without an alarm are left out.
        ``excluded`` has, for each sensor that was excluded, the intervals [from, to] in s of its exclusion; to is null
        if the sensor is excluded at the end.  ``payload_drift`` is the first time in s at which the payload's estimate
        drifts, or null.  ``beyond`` has, for each sensor, how many measured values are not used because the scene's
        motion does not cover their times.  ``faults`` has sentences on these four.  ``not_covered`` has the outputs for
        which no part of the error budget has an error.  ``coverage`` and ``rms_error`` have, for each estimate with
        true values, the share of these values within the band of 90 %, and the RMS error.
        """
        estimates, t = self.estimates, self.estimates.t
        names = (*estimates.unknowns, *estimates.outputs)
        last = {name: tuple(float(values[-1]) for values in estimates.of(name)) for name in names}
        alarms = {
            name: float(t[np.argmax(alarm)])
            for name, alarm in zip(estimates.sensors, estimates.alarms.T, strict=True)
            if alarm.any()
        }
        excluded = {
            name: _spans(t, column) for name, column in zip(estimates.sensors, estimates.excluded.T, strict=True)
        }
        faults = {
            "first_alarm": alarms,
            "excluded": {name: spans for name, spans in excluded.items() if spans},
            "payload_drift": float(t[np.argmax(estimates.drift)]) if estimates.drift.any() else None,
            "beyond": {name: count for name, count in self.beyond.items() if count},
        }
        return {
            "title": self.title,
            "units": self.observer.units,
            "sensors": list(estimates.sensors),
            "last": {name: {"mean": mean, "deviation": deviation} for name, (mean, deviation) in last.items()},
            "observability": dict(self.observability),
            "whiteness": {name: p if np.isfinite(p) else None for name, p in estimates.whiteness().items()},
            **faults,
            "faults": describe_faults(faults, t),
            "errors_of_model": {part: dict(of) for part, of in self.observer.errors.items()},
            "not_covered": sorted(set(estimates.outputs).difference(*self.observer.errors.values())),
            "coverage": {name: estimates.coverage(name, values) for name, values in self.truth.items()},
            "rms_error": {
                name: float(np.sqrt(np.nanmean((estimates.of(name).mean - values) ** 2)))
                for name, values in self.truth.items()
            },
            "without_sensor": {name: dict(ratios) for name, ratios in self.without.items()},
        }

    def write(self, folder: Path) -> list[Path]:
        """Write ``estimates.csv`` and ``observe.json`` into a folder, which is made if missing; return their paths.

        The table has means and standard deviations of the estimates over time, then measured values and innovations of
        the sensors, then true values.  A cell is empty where nothing was measured.
        """
        folder.mkdir(parents=True, exist_ok=True)
        estimates = self.estimates
        header, columns = [f"{TIME} [s]"], [estimates.t]
        for name, unit in self.observer.units.items():
            header += [f"{name} [{unit}]", f"standard deviation of {name} [{unit}]"]
            columns += estimates.of(name)
        for k, name in enumerate(estimates.sensors):
            header += [f"measured {name}", f"innovation of {name}"]
            columns += [self.measured[:, k], estimates.innovations[:, k]]
        header += [f"true {name}" for name in self.truth]
        columns += self.truth.values()
        table, figures = folder / "estimates.csv", folder / "observe.json"
        with replacement_file(table) as part, part.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream)
            writer.writerow(header)
            for row in np.column_stack(columns).tolist():
                writer.writerow([f"{value:.9g}" if np.isfinite(value) else "" for value in row])
        write_text(figures, json.dumps(self.summary(), indent=2))
        return [table, figures]


def _spans(t: Array, mask: NDArray[np.bool_]) -> list[list[float | None]]:
    """Intervals [from, to] in s in which a mask (T,) is true, at the times t (T,) in s.

    If the mask is true at the end, the last interval has None for its end.
    """
    changes = np.nonzero(np.diff(mask, prepend=False, append=False))[0]
    return [
        [float(t[begin]), float(t[end]) if end < len(t) else None]
        for begin, end in zip(changes[::2], changes[1::2], strict=True)
    ]


def describe_faults(figures: Summary, times: Array) -> list[str]:
    """Sentences on faulty sensors, on a payload that drifts and on values beyond the motion.

    `figures` are the contents of ``observe.json``, and `times` (T,) in s are the times of the motion.  The list is
    empty if nothing is at fault.
    """
    sentences = [
        f"{name} disagrees with the model, is stuck or silent from {t:.3g} s on"
        for name, t in figures["first_alarm"].items()
    ]
    for name, spans in figures["excluded"].items():
        listed = ", ".join(f"from {a:.3g} s {'on' if b is None else f'to {b:.3g} s'}" for a, b in spans)
        sentences.append(f"{name} was at fault and was not used {listed}")
    if figures["payload_drift"] is not None:
        cause = "the payload changes, or a sensor has an error that grows slowly"
        sentences.append(f"the payload's estimate drifts at {figures['payload_drift']:.3g} s: {cause}")
    for name, count in figures["beyond"].items():
        values = f"1 measured value of {name} is" if count == 1 else f"{count} measured values of {name} are"
        cause = f"beyond the times of the scene's motion, {times[0]:.4g} to {times[-1]:.4g} s"
        sentences.append(f"{values} not used, {cause}")
    return sentences


def read_measurements(file: Path, units: Mapping[str, str] | None = None) -> dict[str, tuple[Array, Array]]:
    """Read measurements from a CSV table: times (n,) in s and values (n,) of each column, by the column's name.

    The first column is ``t``, the times.  Units in brackets after a name are not part of it.  An empty cell is NaN:
    nothing was measured.  `units` are the allowed units by name (`Observer.units`); None allows all.  Raises an
    InputError as `read_table` does.  It is also raised if the table has no times, fewer than two lines of numbers,
    times that do not grow, or a unit that is not allowed.
    """
    table = read_table(file)
    table.check_units(file, {**(units or {}), TIME: "s"})
    names, values = table.names, table.values
    if not names or names[0] != TIME or len(values) < 2 or len(set(names)) < len(names):
        allowed = f"a first column {TIME}, then columns by the sensors' outputs, each once, and two lines or more"
        raise InputError(str(file), "columns", list(names), f"{allowed} are allowed")
    t = values[:, 0]
    if not np.all(np.isfinite(t)) or not np.all(np.diff(t) > 0.0):
        raise InputError(str(file), TIME, None, "times are needed that grow from line to line")
    return {name: (t, column) for name, column in zip(names[1:], values.T[1:], strict=True)}
