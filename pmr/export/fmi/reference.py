"""The reference trajectory that an FMU carries: inputs at every step, outputs of `march` at some of them.

An FMU goes on from step to step in straight lines of its inputs, and so does `march` here; in a run the parts that
a step has where rows only push follow the signals themselves (docs/fmu.md says what that makes).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmr.export.fmi.blocks import Arrangement
from pmr.export.fmi.variables import STARTS, Variable
from pmr.scene.signals import Ramp
from pmr.simulation import contact_step
from pmr.simulation.contact_step import contact_frequency
from pmr.simulation.excitation import Excitation
from pmr.simulation.native import systems
from pmr.simulation.recorded import Recorded
from pmr.simulation.stepping import TimeStepping

Array = NDArray[np.float64]
#: Instants at which outputs are written, as far as the steps go.
INSTANTS = 101


@dataclass(frozen=True)
class Reference:
    """A simulation under the scene of a system of p paths, i inputs, o outputs and m contacts."""

    stepping: TimeStepping  #: With the parts that contacts that only push take
    #: (T, 1 + 2 p + 2 i) array: time, paths, their rates, loads and their rates, at every step; rates lead to the next
    inputs: Array
    first_loads: Array  #: (i,) array, N: where nothing else is given
    static: bool  #: Whether it starts in equilibrium
    t: Array  #: (S,) array, s
    outputs: Array  #: (S, o + m) array: displacements and forces
    nominal: Array  #: (2 r,) array: largest modal coordinates and rates

    @property
    def start_values(self) -> Array:
        """Of the variables up to the kind of start, in the order of `pmr.export.fmi.variables`."""
        loads = _some(self.first_loads)
        paths = _some(self.inputs[0, 1 : 1 + (self.inputs.shape[1] - 1) // 2 - len(self.first_loads)])
        step = self.stepping.step / max(self.stepping.parts, 1)
        start = STARTS["static" if self.static else "at rest"]
        return np.concatenate([[0.0], paths, 0.0 * paths, loads, 0.0 * loads, [step, self.stepping.rho_inf, start]])


def reference(rows: Arrangement, scene: Recorded) -> Reference:
    """Simulate a system under its own scene, in straight lines from step to step."""
    system, excitation = rows.system, scene.excitation
    t, f = excitation.times, excitation.forces(system.input_names)
    s = np.column_stack([np.empty((len(t), 0)), *(excitation.paths[path].value(t) for path in rows.paths)])
    lines = [Ramp(times=t.tolist(), values=values.tolist()) for values in np.hstack([s, f]).T]
    paths, loads = lines[: len(rows.paths)], lines[len(rows.paths) :]
    count = contact_step.parts(contact_frequency(system, excitation), excitation.stepping)
    stepping = replace(excitation.stepping, parts=count)
    given = Excitation(
        dict(zip(rows.paths, paths, strict=True)), dict(zip(system.input_names, loads, strict=True)), stepping
    )
    found = systems.simulate(system, given, systems.static_start(system, given) if scene.static else {})
    y = np.hstack(list(systems.displacements(system, found).values()))
    z, v = (
        np.hstack([getattr(found.bodies[part.name], what) @ part.form.inverse.T for part in rows.parts])
        for what in "qv"
    )
    shown = np.unique(np.linspace(0, len(t) - 1, min(INSTANTS, len(t))).round().astype(int))
    largest = np.abs(np.hstack([z, v])).max(axis=0)
    smallest = 1e-9 * np.repeat(largest.reshape(2, -1).max(axis=1), z.shape[1])
    nominal = np.maximum(largest, smallest)
    return Reference(
        stepping=stepping,
        inputs=np.hstack([t[:, None], s, _leading(s, stepping.step), f, _leading(f, stepping.step)]),
        first_loads=scene.first_loads,
        static=scene.static,
        t=t[shown],
        outputs=np.hstack([y, found.forces])[shown],
        nominal=np.where(nominal > 0.0, nominal, 1.0),
    )


def inputs_csv(found: Reference, variables: Sequence[Variable]) -> str:
    """Inputs as comma-separated values, with the variables' names."""
    names = ["time", *(variable.name for variable in variables if variable.causality == "input")]
    return _csv(names, found.inputs)


def outputs_csv(found: Reference, variables: Sequence[Variable]) -> str:
    """Displacements and forces as comma-separated values."""
    outputs = [v for v in variables if v.causality == "output"]
    names = [v.name for v in outputs if not v.is_rate]
    return _csv(["time", *names], np.hstack([found.t[:, None], found.outputs]))


def _some(values: Array) -> Array:
    """The values, or a zero where there are none: C has no arrays of nothing."""
    return values if len(values) else np.zeros(1)


def _leading(values: Array, step: float) -> Array:
    """Rates (T, k) that lead from each sample to the next; none at the end."""
    return np.vstack([np.diff(values, axis=0) / step, np.zeros((1, values.shape[1]))])


def _csv(names: Sequence[str], rows: Array) -> str:
    lines = [",".join(f'"{name}"' for name in names)]
    return "\n".join([*lines, *(",".join(map(repr, row)) for row in rows.tolist()), ""])
