"""Results of a run: responses of every simulator, errors, frequencies, and results of each body.

The report reads these objects and computes no new values.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError, non_finite_remarks, overview
from pmr.files import npz
from pmr.files.arrays import Array
from pmr.files.whole import finish_swap
from pmr.results.field_series import Fields, Pose
from pmr.results.field_stress import Envelope
from pmr.results.response import LUFFING_ANGLE, Response
from pmr.scene import Scene
from pmr.scene.files import stored_scene
from pmr.scene.frame import Frame
from pmr.scene.keys import ALONE, SLIDER
from pmr.scene.signals import Table


@dataclass(frozen=True)
class Paths:
    """Path coordinates in m and their rates in m/s over T times, for P paths.

    A body alone has the path of its slider, a boom has the extensions of its sections.
    """

    names: tuple[str, ...]  # (P,)
    values: Array  # (T, P) m
    rates: Array  # (T, P) m/s


@dataclass(frozen=True)
class Loads:
    """Values of the loads on i inputs over T times, with the inputs' names and units."""

    names: tuple[str, ...]  # (i,)
    units: tuple[str, ...]  # (i,)
    values: Array  # (T, i)


@dataclass(frozen=True)
class Shapes:
    """Basis of a beam: singular values of its snapshots, and displacements across the axis in its r basis vectors."""

    singular_values: Array  # (k,)
    x: Array  # (o,) m: positions along the beam
    shapes: Array  # (o, r)


@dataclass(frozen=True)
class FrequencyMap:
    """Lowest natural frequency (A, B) in Hz of a reduced boom over the extensions of two joints.

    `first` (A,) and `second` (B,) are these extensions in m.
    """

    joints: tuple[str, ...]
    first: Array
    second: Array
    lowest: Array


@dataclass(frozen=True)
class Frequencies:
    """The f lowest natural frequencies in Hz of the system at rest, at S positions of its paths, for each model.

    `models` has arrays (S, f) by the model: ``reduced``, ``full`` and ``closed_form``, which is a uniform beam that is
    pinned at 0 and held by one slider.  All contacts are closed.  `resting` is the lowest frequency of the reduced
    system without those pads that are open at rest under the loads of the positions.  It is None if no pad only pushes,
    and NaN where no equilibrium is found.  `along` are the positions in the sense of `RunResult.abscissa`, `paths` are
    the coordinates of all P paths.  `over_joints` is None unless exactly two joints move, each on its own path.  With
    effects of second order, the system has the stresses that it has in the run at the times `t` (S,) in s.  At these
    times it passes the positions; if it passes a position several times, the time with the lowest frequency counts.
    """

    along: Array  # (S,) m
    paths: Array  # (S, P) m
    models: Mapping[str, Array]
    over_joints: FrequencyMap | None = None
    t: Array | None = None
    resting: Array | None = None  # (S,)


@dataclass(frozen=True)
class FrequencyResponse:
    """Displacement of the tip by a sinusoidal load of amplitude 1 on each of i inputs, with the sliders at rest.

    Attributes
    ----------
    s : (S,) array, m
        Path coordinates of the sliders.
    f : (W,) array, Hz
        Frequencies of the load.
    gain : (S, W, i) array
        Amplitude of the displacement, in `units`; `static` (S, i) is the displacement at f = 0, with its sign.
    damped : bool
        Whether the system has any damping; if it has none, the height of peaks depends on the choice of `f`.
    outputs : tuple of str
        For each input, the direction in which the load moves the tip most.
    inputs, units : tuples of str
        Names of the inputs, and the units of their gains.
    """

    s: Array
    f: Array
    gain: Array
    static: Array
    damped: bool
    outputs: tuple[str, ...]
    inputs: tuple[str, ...]
    units: tuple[str, ...]


@dataclass(frozen=True)
class BodyResult:
    """Results of one body of a run: basis, fields, stresses and section forces.

    `fields` are the fields for which the scene asks in its recovery, at some of the recovery's times, in the body's own
    axes.  `peak_stress` is the largest von Mises stress (F,) in Pa at all F times of the recovery, and `envelopes` are
    section forces along a beam over these times; both are given by model.
    """

    shapes: Shapes | None = None  # None for a section of a boom
    fields: Fields | None = None  # None without a recovery
    peak_stress: Mapping[str, Array] = field(default_factory=dict)
    envelopes: Mapping[str, Envelope] = field(default_factory=dict)


#: Names, or patterns of names, of all files that a run may write into its folder, other than the report; they are
#: replaced together.
RESULT_FILES = (
    "scene.json", "summary.json", "trajectories.npz", "reduced.npz", "system.npz", "fields*.npz", "fields.pvd",
    "fields/*.vtu", "tables/*.csv",
)  # fmt: skip
#: Factor from a frequency in Hz to a circular frequency in rad/s; files store those of a body alone in rad/s.
TURN = 2.0 * np.pi
#: Models whose frequencies are in the file of a body alone; an array without columns stands for a model without
#: frequencies.
_MODELS = ("reduced", "full", "closed_form")
#: Names in files of the arrays of a boom's frequencies, and their names in this module.
_RENAMED = {"frequencies.reach": "frequencies.along", "frequencies.extensions": "frequencies.paths"}

Data = Mapping[str, NDArray[Any]]
ColumnNames = Mapping[str, list[str]]


@dataclass(frozen=True)
class SummaryPart:
    """A contribution to summary.json: values by key, and warnings of one line each.

    `grave` are warnings that a requirement does not hold or that a result is useless.  Grave warnings come before
    `warnings`, which say how far results are off.
    """

    figures: Mapping[str, Any] = field(default_factory=dict)
    warnings: Sequence[str] = ()
    grave: Sequence[str] = ()


def combine_parts(parts: Sequence[SummaryPart]) -> dict[str, Any]:
    """Return the values of all parts by key, and all their warnings under the key ``warnings``.

    Grave warnings come first, then remarks on values that are not finite, then all other warnings in the order of the
    parts.  Raises ValueError if two parts have the same key.
    """
    summary, warnings = dict[str, Any](), list[str]()
    for part in parts:
        if twice := summary.keys() & part.figures.keys():
            raise ValueError(f"two parts of a summary have {', '.join(sorted(twice))}")
        summary |= part.figures
        warnings += part.warnings
    return summary | {"warnings": [*grave_warnings(parts), *non_finite_remarks(summary), *warnings]}


def grave_warnings(parts: Iterable[SummaryPart]) -> list[str]:
    """Return the grave warnings of all parts, in the order of the parts."""
    return [line for part in parts for line in part.grave]


@dataclass(frozen=True)
class RunResult:
    """All results of one run, of a body alone or of a boom of several sections.

    `responses` has the histories by model: ``reduced`` and, if the scene asks for comparison with them, ``full`` and
    ``ancf``.  `bodies` has the results of the bodies by name; the name of a body alone is empty.

    `summary` is the content of summary.json: ``errors.<a>_vs_<b>.{tip,beam}`` (e_NRMS, fractions),
    ``absolute_errors.<a>_vs_<b>.{tip,beam}`` (e_abs, m), ``largest_differences.<a>_vs_<b>.{tip,beam}`` (m),
    ``not_judged`` (`pmr.compare.trust.RingingReference`),
    ``max_displacement`` and ``max_error`` (m),
    ``estimate.{beam,tip,pad_force,velocity,probe,probes,by,chi,largest,not_covered}`` (`pmr.compare.estimate`),
    ``step.{beam,tip,largest,finest,settled,by,enough,band}`` (`pmr.compare.step_error`), ``warnings``, ``coordinates``,
    ``basis``, ``seconds``, ``versions``, ``scene_hash``, ``pads`` and ``cylinders`` (name, min and max in N, their
    times), ``sections`` of a boom (name, coordinates, errors) and more.  If stresses are recovered it has
    ``max_von_mises.{full,reduced}`` (Pa).
    """

    scene: Scene
    summary: dict[str, Any]
    responses: Mapping[str, Response]
    paths: Paths
    loads: Loads
    frequencies: Frequencies
    bodies: Mapping[str, BodyResult] = field(default_factory=dict)
    reach: Array | None = None  # (T,) m, distance of a boom's tip from the base's tail; None for a body alone
    frequency_response: FrequencyResponse | None = None  # None unless the scene asks for it
    tip_error: Array | None = None  # (T, d) m, estimated error of the tip's displacement in d directions

    def __repr__(self) -> str:
        head = f"RunResult of {self.scene.title!r}, warnings: {len(self.summary.get('warnings', ()))}"
        return overview(head, responses=[*self.responses], bodies=[name or "body" for name in self.bodies])

    @property
    def body(self) -> BodyResult:
        """Result of a body alone, or of the outermost section of a boom."""
        return list(self.bodies.values())[-1]

    @property
    def abscissa(self) -> Array:
        """Coordinate (T,) in m over which results are drawn and listed.

        The coordinate is the reach of a boom, or the path coordinate of a body alone.
        """
        return self.paths.values[:, 0] if self.reach is None else self.reach

    def abscissa_at(self, t: Array) -> Array:
        """Return `abscissa` (S,) in m at the times t (S,) in s of a response that may have longer steps.

        The response and this run have the same start and end, and each has steps of constant length.
        """
        return np.interp(t, np.linspace(float(t[0]), float(t[-1]), len(self.abscissa)), self.abscissa)

    @property
    def abscissa_name(self) -> str:
        """Name of `abscissa`: ``s`` for a body alone, ``reach`` for a boom."""
        return "s" if self.reach is None else "reach"

    @cached_property
    def tails(self) -> Array:
        """Position (T, bodies) in m of each body's tail along the boom; 0 for a body alone."""
        if self.reach is None:
            return np.zeros((len(self.responses["reduced"].t), 1))
        return np.cumsum(np.pad(self.paths.values, ((0, 0), (1, 0))), axis=1)

    @property
    def moving_fields(self) -> dict[str, tuple[Fields, Array]]:
        """Fields of each body that has some, and the distance (F,) in m that it has slid along x, by the body's name.

        The distance is given at the F times of the fields.  A section of a boom slides out of the base by the sum of
        the extensions up to its own.  A body alone that pads hold slides by -s into these pads.  If points slide along
        a body, the body itself has the distance 0.
        """
        t, tails = self.responses["reduced"].t, self.tails
        if self.reach is None and not self.scene.points:
            tails = -self.paths.values
        return {
            name: (body.fields, np.interp(body.fields.t, t, tail))
            for (name, body), tail in zip(self.bodies.items(), tails.T, strict=True)
            if body.fields is not None
        }

    @cached_property
    def frame(self) -> Frame | None:
        """Frame of the scene, with the computed angle over time in place of a free luffing angle; None without a frame.

        The angle is linear between steps.
        """
        frame, response = self.scene.frame, self.responses["reduced"]
        if frame is None or frame.luffing != "free":
            return frame
        angle = response.other(LUFFING_ANGLE) * frame.radian
        table = Table(times=tuple(response.t), values=tuple(angle), interpolation="linear")
        return frame.model_copy(update={"luffing": table})

    def pose(self, t: Array) -> Pose | None:
        """Return the motion in space of the axes of `moving_fields` at times t (S,) in s; None without a frame."""
        frame = self.frame
        if frame is None:
            return None
        origin = np.zeros((len(t), 3)) + frame.tail_position
        if self.reach is None and not self.scene.points:  # there the body slides by -s: its own tail is at the place
            origin[:, 0] += np.interp(t, self.responses["reduced"].t, self.paths.values[:, 0])
        return Pose(frame.rotation(t), origin)

    @property
    def columns(self) -> dict[str, list[str]]:
        """Names of the columns, with units in brackets, of each array of trajectories.npz, by the array's name."""
        loads = zip(self.loads.names, self.loads.units, strict=True)
        column_names = {"loads": [f"{name} [{unit}]" for name, unit in loads]}
        if self.reach is None:
            for name in _MODELS:
                count = self.frequencies.models.get(name, np.empty((0, 0))).shape[1]
                column_names[f"frequencies.{name}"] = [f"frequency {k + 1} [rad/s]" for k in range(count)]
        else:
            column_names["extensions"] = [f"{name} [m]" for name in self.paths.names]
        if self.tip_error is not None:
            column_names["estimate.tip"] = [f"tip {k + 1} [m]" for k in range(self.tip_error.shape[1])]
        for simulator, response in self.responses.items():
            column_names |= {f"{simulator}.{array}": names for array, names in response.columns.items()}
            if response.force_peaks is not None:
                column_names[f"{simulator}.force_peaks"] = response.columns["slider_force"]
        return column_names

    def save(self, folder: Path) -> None:
        """Write scene.json, summary.json, the fields of bodies, and trajectories.npz into `folder`, which may be new.

        The entry ``columns`` of trajectories.npz names the columns of its arrays.  Other files in the folder stay.
        """
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "scene.json").write_text(self.scene.model_dump_json(indent=1, exclude={"section"}), encoding="utf-8")
        self.save_summary(folder)
        arrays: dict[str, NDArray[Any]] = {"columns": np.array(npz.json_text(self.columns)), "loads": self.loads.values}
        if self.reach is None:
            arrays |= {"s": self.paths.values[:, 0], "s_rate": self.paths.rates[:, 0]}
        else:
            arrays |= {"extensions": self.paths.values, "extension_rates": self.paths.rates, "reach": self.reach}
        arrays |= _frequency_arrays(self.frequencies, alone=self.reach is None)
        for simulator, response in self.responses.items():
            arrays |= npz.record_arrays(response, f"{simulator}.")
        for name, body in self.bodies.items():
            arrays |= {
                f"{_array_prefix(name)}peak_stress.{model}": stress for model, stress in body.peak_stress.items()
            }
            for model, envelope in body.envelopes.items():
                arrays |= npz.record_arrays(envelope, f"{_array_prefix(name)}envelope.{model}.")
            if body.shapes is not None:
                arrays |= npz.record_arrays(body.shapes, f"{_array_prefix(name)}basis.")
            if body.fields is not None:
                body.fields.save(folder / _fields_file(name))
        if self.tip_error is not None:
            arrays["estimate.tip"] = self.tip_error
        if self.frequency_response is not None:
            arrays |= npz.record_arrays(self.frequency_response, "frequency_response.")
        npz.write(folder / "trajectories.npz", arrays)

    def save_summary(self, folder: Path) -> None:
        """Write summary.json into `folder`, and no other file."""
        (folder / "summary.json").write_text(npz.json_text(self.summary, indent=1), encoding="utf-8")

    @classmethod
    def load(cls, folder: Path) -> RunResult:
        """Return the result from a folder that `save` of this version or of an earlier one wrote.

        If a replacement of the folder's files was interrupted, it is finished first (`pmr.files.whole.finish_swap`).
        Raises an InputError if the columns of its histories have no kinds, as in results of early checkouts.
        """
        finish_swap(folder)
        file = folder / "scene.json"
        scene = stored_scene(json.loads(file.read_text(encoding="utf-8")), str(file))
        data = npz.read(folder / "trajectories.npz")
        if not any(name.endswith(".kinds") for name in data):
            allowed = "histories whose columns have kinds are allowed: pmr run writes these results anew"
            raise InputError(str(folder / "trajectories.npz"), "kinds", None, allowed)
        columns = json.loads(str(data["columns"])) if "columns" in data else {}
        simulators = sorted({key.split(".")[0] for key in data if key.endswith(".displacement")})
        response = (
            npz.record_from_arrays(FrequencyResponse, data, "frequency_response.")
            if "frequency_response.s" in data
            else None
        )
        return cls(
            scene=scene,
            summary=json.loads((folder / "summary.json").read_text(encoding="utf-8")),
            responses={simulator: npz.record_from_arrays(Response, data, f"{simulator}.") for simulator in simulators},
            paths=_read_paths(data, columns),
            loads=_read_loads(data["loads"], columns),
            frequencies=_read_frequencies(data),
            bodies={name: _read_body(folder, data, name) for name in scene.bodies},
            reach=data.get("reach"),
            frequency_response=response,
            tip_error=data.get("estimate.tip"),
        )


def _array_prefix(body: str) -> str:
    """Return the text with which the names of a body's arrays in trajectories.npz begin; empty for a body alone."""
    return "" if body == ALONE else f"bodies.{body}."


def _fields_file(body: str) -> str:
    """Return the name of the file of a body's fields."""
    return f"{'-'.join(filter(None, ('fields', body)))}.npz"


def _read_paths(data: Data, columns: ColumnNames) -> Paths:
    """Return the paths from `data`, the arrays of trajectories.npz, and the names of their columns."""
    if "s" in data:
        return Paths((SLIDER,), data["s"][:, None], data["s_rate"][:, None])
    values = data["extensions"]
    names = tuple(column.removesuffix(" [m]") for column in columns["extensions"])
    return Paths(names, values, data["extension_rates"])


def _read_loads(values: Array, columns: ColumnNames) -> Loads:
    """Return the loads from their values (T, i) and the names of the columns, which have units in brackets.

    Without names of the columns, the loads have no names and units.
    """
    parts = [column.removesuffix("]").rpartition(" [") for column in columns.get("loads", ())]
    return Loads(tuple(name for name, _, _ in parts), tuple(unit for _, _, unit in parts), values)


def _frequency_arrays(frequencies: Frequencies, alone: bool) -> dict[str, NDArray[Any]]:
    """Return the arrays of frequencies for trajectories.npz; keys and units depend on whether a body is `alone`.

    Arrays of frequencies are (positions, modes).  For a body alone, ``frequencies.s`` is in m.
    ``frequencies.reduced``, ``frequencies.full`` and ``frequencies.closed_form`` are in rad/s; an array has no columns
    if there are no such frequencies.  If they are known, ``frequencies.t`` in s and ``frequencies.resting`` in Hz are
    added.  For a boom, each key is ``frequencies.`` followed by a field of `Frequencies`, or by its name in
    `_RENAMED`; frequencies are in Hz.
    """
    if alone:
        none = np.empty((len(frequencies.along), 0))
        circular = {f"frequencies.{name}": TURN * frequencies.models.get(name, none) for name in _MODELS}
        return (
            {"frequencies.s": frequencies.along}
            | circular
            | ({} if frequencies.t is None else {"frequencies.t": frequencies.t})
            | ({} if frequencies.resting is None else {"frequencies.resting": frequencies.resting})
        )
    arrays = npz.record_arrays(frequencies, "frequencies.")
    return npz.rename_keys(arrays, {new: old for old, new in _RENAMED.items()})


def _read_frequencies(data: Data) -> Frequencies:
    """Return the frequencies in Hz from `data`, the arrays of trajectories.npz."""
    if "frequencies.s" not in data:
        return npz.record_from_arrays(Frequencies, npz.rename_keys(data, _RENAMED), "frequencies.")
    s = data["frequencies.s"]
    in_hertz = {name: data[f"frequencies.{name}"] / TURN for name in _MODELS}
    models = {name: values for name, values in in_hertz.items() if values.shape[1]}
    return Frequencies(s, s[:, None], models, t=data.get("frequencies.t"), resting=data.get("frequencies.resting"))


def _read_body(folder: Path, data: Data, name: str) -> BodyResult:
    """Return the results of the body `name` from `data`, the arrays of trajectories.npz, and the file of its fields."""
    of, file = _array_prefix(name), folder / _fields_file(name)
    stress, along = f"{of}peak_stress.", f"{of}envelope."
    models = sorted({key.removeprefix(along).split(".")[0] for key in data if key.startswith(along)})
    return BodyResult(
        shapes=npz.record_from_arrays(Shapes, data, f"{of}basis.") if f"{of}basis.x" in data else None,
        fields=Fields.load(file) if file.is_file() else None,
        peak_stress={key.removeprefix(stress): values for key, values in data.items() if key.startswith(stress)},
        envelopes={model: npz.record_from_arrays(Envelope, data, f"{along}{model}.") for model in models},
    )
