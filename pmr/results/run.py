"""What a run leaves behind: responses of every simulator, errors, basis, frequencies; kept in a folder.

The report reads these objects and computes nothing.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.fields.series import Fields
from pmr.files import jsonfile, npz, records
from pmr.files.swap import finished
from pmr.scene import Scene

Array = NDArray[np.float64]

#: Names of all that a run may leave in its folder, the report aside: files that go together.
RESULT_FILES = (
    "scene.json", "summary.json", "trajectories.npz", "reduced.npz", "reduced-*.npz", "fields*.npz", "fields.pvd",
    "fields/*.vtu", "tables/*.csv",
)  # fmt: skip


@dataclass(frozen=True)
class Energy:
    """Kinetic, strain and external energy in J over time, each (T,); external is minus the work of the loads."""

    kinetic: Array
    strain: Array
    external: Array

    @property
    def total(self) -> Array:
        return self.kinetic + self.strain + self.external


@dataclass(frozen=True)
class Response:
    """What one simulator says of the beam, in quantities that all of them share.

    Attributes
    ----------
    t : (T,) array, s
    x : (o,) array, m
        Beam coordinates of the outputs.
    displacement : (T, o) array, m
        Transverse; the last column is the tip.  In space that of all places along y, along z, then of the tip.
    energy : Energy
    slider_force : (T, m) array, N
        Multipliers of the sliders; in space forces of all pads.  Which is which, `force_names` say.
    residual_position : (T,) array, m
        Largest violation of a row, the largest absolute entry of C(s) q; NaN where a simulator has no such rows.
    residual_velocity : (T,) array, m/s
        Largest violation of its time derivative, that of C(s) q' + C'(s) s' q; NaN likewise.
    seconds : float
        Wall time of the solver alone.
    output_names, output_units : tuples of str
        Of the columns of `displacement`, (o,); empty in results of version 0.1 and where nobody named them.
    others : (T, k) array or None
        Outputs that are neither in m nor in N, `other_names` in `other_units`; then reactions of rigid supports.
    force_names : tuple of str
        Of the columns of `slider_force`, (m,), likewise.
    round_off : float, m
        What of a displacement may be round-off alone (`pmr.compare.errors.round_off`); 0 where that isn't known.
    force_round_off : float, N
        The same of a force (`pmr.compare.errors.force_round_off`).
    force_peaks : (T, m) array, N, or None
        `slider_force`, but of pads that only push the largest within the step that ends at t; None where a step is one.
    surplus : float
        Share of the largest energy that neither loads nor moving rows put in; NaN where a simulator can't tell, and in
        results of version 0.1.
    """

    t: Array
    x: Array
    displacement: Array
    energy: Energy
    slider_force: Array
    residual_position: Array
    residual_velocity: Array
    seconds: float
    output_names: tuple[str, ...] = ()
    output_units: tuple[str, ...] = ()
    force_names: tuple[str, ...] = ()
    round_off: float = 0.0
    force_round_off: float = 0.0
    force_peaks: Array | None = None
    surplus: float = np.nan
    others: Array | None = None
    other_names: tuple[str, ...] = ()
    other_units: tuple[str, ...] = ()

    def other(self, name: str) -> Array:
        """One of the other outputs, (T,)."""
        assert self.others is not None
        return self.others[:, self.other_names.index(name)]

    def force(self, name: str, unnamed: int) -> Array:
        """A force by its name, (T,) N, NaN if it isn't known; column `unnamed` where the response has no names.

        Of pads that only push the peaks within each step, where these are known.
        """
        forces = self.slider_force if self.force_peaks is None else self.force_peaks
        if not self.force_names:
            return forces[:, unnamed]
        if name not in self.force_names:
            return np.full(len(self.t), np.nan)
        return forces[:, self.force_names.index(name)]

    @property
    def columns(self) -> dict[str, list[str]]:
        """What the columns of each array (T, c) are called, with their units in brackets."""
        moved = self.output_names or tuple(f"output {k}" for k in range(self.displacement.shape[1]))
        forces = self.force_names or tuple(f"force {k}" for k in range(self.slider_force.shape[1]))
        others = [f"{name} [{unit}]" for name, unit in zip(self.other_names, self.other_units, strict=True)]
        found = {"displacement": [f"{name} [m]" for name in moved], "slider_force": [f"{name} [N]" for name in forces]}
        return found | ({"others": others} if others else {})

    @property
    def tip(self) -> Array:
        """Transverse displacement of the free end, (T,) m."""
        return self.displacement[:, -1]


@dataclass(frozen=True)
class Shapes:
    """The basis as seen on the beam: singular values (k,) and the transverse shapes (o, r) at x (o,) m."""

    singular_values: Array
    x: Array
    shapes: Array


@dataclass(frozen=True)
class FrequencyCurves:
    """Lowest circular frequencies in rad/s against the slider position s (S,) m; each (S, f).

    `closed_form` is empty, (S, 0), where the scene is no uniform beam pinned at 0 with one slider.
    """

    s: Array
    full: Array
    reduced: Array
    closed_form: Array


@dataclass(frozen=True)
class FrequencyResponse:
    """How far the tip moves under a sinusoidal load of unit size, with the sliders at rest.

    Attributes
    ----------
    s : (S,) array, m
    f : (W,) array, Hz
    gain : (S, W, i) array
        In `units`; `static` (S, i) with its sign at f = 0.
    damped : bool
        Whether anything damps it: otherwise peaks are as high as the frequencies happen to lie.
    outputs : tuple of str
        Of each input the direction in which it moves the tip most.
    inputs, units : tuples of str
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
class RunResult:
    """All of one run.

    `responses` is keyed by simulator: ``reduced`` and, as asked, ``full`` and ``ancf``.  `summary` is what
    summary.json holds: ``errors.<a>_vs_<b>.{tip,beam}`` (e_NRMS, fractions),
    ``absolute_errors`` likewise (e_abs, m), ``not_judged`` (`pmr.compare.ringing`),
    ``max_displacement`` and ``max_error`` (m),
    ``estimate.{beam,tip,pad_force,velocity,probe,probes,kappa,by,chi,largest,not_covered}`` (`pmr.compare.estimate`),
    ``step.{beam,tip,largest,finest,settled,by,enough,band}`` (`pmr.compare.step_error`), ``warnings``,
    ``coordinates``, ``basis``, ``seconds``, ``versions``, ``scene_hash``, ``pads`` (least and largest force of each)
    and more; ``max_von_mises.{full,reduced}`` (Pa) where stresses are recovered.

    `fields` are some of what a scene's recovery asks for, and `peak_stress` the largest von Mises stress in Pa,
    ``reduced`` and, where there is a full model, ``full``, over all of its times.
    """

    scene: Scene
    summary: dict[str, Any]
    responses: Mapping[str, Response]
    path: Array  # s(t), (T,) m
    path_rate: Array  # s'(t), (T,) m/s
    loads: Array  # (T, i) N
    shapes: Shapes
    frequencies: FrequencyCurves
    fields: Fields | None = None
    peak_stress: Mapping[str, Array] = field(default_factory=dict)
    frequency_response: FrequencyResponse | None = None
    tip_error: Array | None = None  # how far off the tip may be by the estimate, (T, d) m

    @property
    def columns(self) -> dict[str, list[str]]:
        """What the columns of each array of trajectories.npz are called, with their units in brackets."""
        units = {load.name: "N m" if load.direction.startswith("r") else "N" for load in self.scene.loads}
        found = {"loads": [f"{name} [{units.get(name, 'm/s^2')}]" for name in self.scene.signals]}
        for name in ("full", "reduced", "closed_form"):
            count = getattr(self.frequencies, name).shape[1]
            found[f"frequencies.{name}"] = [f"frequency {k + 1} [rad/s]" for k in range(count)]
        if self.tip_error is not None:
            found["estimate.tip"] = [f"tip {k + 1} [m]" for k in range(self.tip_error.shape[1])]
        for simulator, response in self.responses.items():
            found |= {f"{simulator}.{array}": names for array, names in response.columns.items()}
            if response.force_peaks is not None:
                found[f"{simulator}.force_peaks"] = response.columns["slider_force"]
        return found

    def save(self, folder: Path) -> None:
        """Write scene.json, summary.json and trajectories.npz, whose ``columns`` names columns, into `folder`."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "scene.json").write_text(self.scene.model_dump_json(indent=1), encoding="utf-8")
        (folder / "summary.json").write_text(jsonfile.text(self.summary, indent=1), encoding="utf-8")
        arrays: dict[str, NDArray[Any]] = {"s": self.path, "s_rate": self.path_rate, "loads": self.loads}
        arrays["columns"] = np.array(jsonfile.text(self.columns))
        arrays |= records.arrays(self.shapes, "basis.") | records.arrays(self.frequencies, "frequencies.")
        for simulator, response in self.responses.items():
            arrays |= records.arrays(response, f"{simulator}.")
        arrays |= {f"peak_stress.{name}": stress for name, stress in self.peak_stress.items()}
        if self.tip_error is not None:
            arrays["estimate.tip"] = self.tip_error
        if self.frequency_response is not None:
            arrays |= records.arrays(self.frequency_response, "frequency_response.")
        npz.write(folder / "trajectories.npz", arrays)
        if self.fields is not None:
            self.fields.save(folder / "fields.npz")

    @classmethod
    def load(cls, folder: Path) -> RunResult:
        """Read what `save` wrote."""
        finished(folder)
        summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
        data = npz.read(folder / "trajectories.npz")
        simulators = sorted({key.split(".")[0] for key in data if key.endswith(".displacement")})
        return cls(
            scene=Scene.model_validate(json.loads((folder / "scene.json").read_text(encoding="utf-8"))),
            summary=summary,
            responses={simulator: records.record(Response, data, f"{simulator}.") for simulator in simulators},
            path=data["s"],
            path_rate=data["s_rate"],
            loads=data["loads"],
            shapes=records.record(Shapes, data, "basis."),
            frequencies=records.record(FrequencyCurves, data, "frequencies."),
            fields=Fields.load(folder / "fields.npz") if (folder / "fields.npz").is_file() else None,
            frequency_response=records.record(FrequencyResponse, data, "frequency_response.")
            if "frequency_response.s" in data
            else None,
            tip_error=data.get("estimate.tip"),
            peak_stress={
                key.removeprefix("peak_stress."): values
                for key, values in data.items()
                if key.startswith("peak_stress.")
            },
        )
