"""The reference trajectory that an FMU carries: inputs at every step, outputs of `march` at some of them.

An FMU goes on from step to step in straight lines of its inputs, and so does `march` here; in a run the parts that
a step has where rows only push follow the signals themselves (docs/fmu.md says what that makes).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.export.fmi.variables import Variable
from pmr.reduced.model import ReducedModel
from pmr.scene.signals import Ramp
from pmr.simulation import contact_step
from pmr.simulation.excitation import SLIDER, Excitation
from pmr.simulation.modal import modal_form
from pmr.simulation.native import simulator as march
from pmr.simulation.recorded import Recorded
from pmr.simulation.stepping import TimeStepping
from pmr.system.body import displacement

Array = NDArray[np.float64]
#: Instants at which outputs are written, as far as the steps go.
INSTANTS = 101


@dataclass(frozen=True)
class Reference:
    """A simulation under the scene of a model."""

    stepping: TimeStepping  #: With the parts that rows that only push take
    #: (T, 3 + 2 i) array: time, s, its rate, loads and their rates, at every step; rates lead to the next step
    inputs: Array
    first_loads: Array  #: (i,) array, N: where nothing else is said
    t: Array  #: (S,) array, s
    outputs: Array  #: (S, o + m) array: displacements and forces
    nominal: Array  #: (2 r,) array: largest modal coordinates and rates

    @property
    def start_values(self) -> Array:
        """Of the variables up to the scheme's parameter, in the order of `pmr.export.fmi.variables`."""
        loads = self.first_loads if len(self.first_loads) else np.zeros(1)  # C has no arrays of nothing
        step = self.stepping.step / max(self.stepping.parts, 1)
        return np.concatenate([self.inputs[0, :2], [0.0], loads, 0.0 * loads, [step, self.stepping.rho_inf]])


def reference(model: ReducedModel, scene: Recorded) -> Reference:
    """Simulate a model under its own scene, in straight lines from step to step."""
    excitation, form, names = scene.excitation, modal_form(model), model.input_names
    t, s, f = excitation.times, excitation.along(model.domain)[:, None], excitation.forces(names)
    path, *loads = (Ramp(times=t.tolist(), values=values.tolist()) for values in np.hstack([s, f]).T)
    stepping = contact_step.with_parts(model, excitation)
    given = Excitation({SLIDER: path}, dict(zip(names, loads, strict=True)), stepping)
    trajectory = march.simulate_modal(form, given)
    shown = np.unique(np.linspace(0, len(t) - 1, min(INSTANTS, len(t))).round().astype(int))
    y = displacement(form.body, trajectory.q[shown], s[shown, 0], trajectory.multipliers[shown], f[shown])
    largest = np.abs(np.hstack([trajectory.q, trajectory.v])).max(axis=0)
    smallest = 1e-9 * np.repeat(largest.reshape(2, -1).max(axis=1), model.size)
    nominal = np.maximum(largest, smallest)
    return Reference(
        stepping=stepping,
        inputs=np.hstack([t[:, None], s, _leading(s, stepping.step), f, _leading(f, stepping.step)]),
        first_loads=scene.first_loads,
        t=t[shown],
        outputs=np.hstack([y, trajectory.multipliers[shown]]),
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


def _leading(values: Array, step: float) -> Array:
    """Rates (T, k) that lead from each sample to the next; none at the end."""
    return np.vstack([np.diff(values, axis=0) / step, np.zeros((1, values.shape[1]))])


def _csv(names: Sequence[str], rows: Array) -> str:
    lines = [",".join(f'"{name}"' for name in names)]
    return "\n".join([*lines, *(",".join(map(repr, row)) for row in rows.tolist()), ""])
