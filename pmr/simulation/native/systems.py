r"""The compiled simulator of any system: generalized-alpha in the modal coordinates of each body.

The bodies' M, K and D never change, so each is diagonalised once; the multipliers of the contacts are all that couples
them, one m x m solve a step (`pmr.simulation.native.step`, docs/system_of_bodies.md).  A body may be reduced or of full
order, up to some thousand coordinates: the same loop is the reference of what a reduction leaves out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.constraints.polynomials import evaluate
from pmr.simulation.excitation import Excitation, places
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.march import March, Steps
from pmr.simulation.start import InitialState
from pmr.simulation.stepping import Progress
from pmr.system.assembly import Assembly
from pmr.system.body import Trajectory
from pmr.system.statics import equilibrium
from pmr.system.system import System, SystemTrajectory

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Observation:
    """Chosen outputs of a simulation, at every so many steps."""

    t: Array  # (T,) s
    y: Array  # (T, o) m
    multipliers: Array  # (T, m) N
    seconds: float  # wall time of the solver alone


def simulate(
    system: System,
    excitation: Excitation,
    initial: Mapping[str, InitialState] | None = None,
    progress: Progress | None = None,
    every: int = 1,
) -> SystemTrajectory:
    """Simulate all bodies from t = 0 on and keep each `every`-th step.

    Arguments and errors as for `pmr.simulation.SystemSimulator`.
    """
    march, T = March(SystemForm.of(system), excitation, initial or {}), excitation.stepping.steps // every + 1
    found: dict[str, Any] = {}

    def taken(steps: Steps) -> None:
        arrays = steps.record._asdict() | {"stored": steps.stored, "work": steps.work}
        before = -steps.first % every  # as many until the next one that is kept
        for name, array in arrays.items():
            if array is not None:
                found.setdefault(name, np.empty((T, *array.shape[1:]), array.dtype))
                kept, at = array[before::every], (steps.first + before) // every
                found[name][at : at + len(kept)] = kept

    ended = march.run(taken, progress)
    kept = slice(None, None, every)
    forces_of, pushing = march.form.combined.forces, ~np.isnan(system.clearance)
    t, forces, motions = march.t[kept], forces_of(found["multipliers"]), {}
    for name, form in march.form.forms.items():
        columns, own = march.form.columns[name], march.x[kept, system.sides_of(name)]
        q, v = found["z"][:, columns] @ form.X.T, found["v"][:, columns] @ form.X.T
        pressed = system.pressed(name, forces)
        motions[name] = Trajectory(t, q, v, pressed, own, ended.seconds, surplus=ended.surplus)
    peaks = np.where(pushing, forces_of(found["peaks"]), forces) if "peaks" in found else forces
    impulses = forces_of(found["impulses"]) if "impulses" in found else None
    parts = found.get("parts", np.ones(T, np.int64))
    return SystemTrajectory(
        t, motions, forces, peaks, march.f[kept], found["stored"], found["work"], ended.seconds, ended.surplus, parts,
        impulses, excitation.amplitudes(system.term_names)[kept] if system.terms else None,
    )  # fmt: skip


def seconds(form: SystemForm, excitation: Excitation, initial: Mapping[str, InitialState], count: int) -> list[float]:
    """The solver's wall time of the same simulation, `count` times; nothing of it is kept."""
    march = March(form, excitation, initial)
    return [march.again() for _ in range(count)]


def observe(
    form: SystemForm, excitation: Excitation, outputs: Sequence[int] | None = None, every: int = 1
) -> Observation:
    """Simulate from the start of the excitation, keep nothing but outputs and contact forces of each `every`-th step.

    The outputs, all by default, are numbered from one body to the next, ascending.  Memory is of the order of what is
    recorded: a long simulation of a large body needs little.  So the energy balance that `simulate` checks is not:
    rigid rows that move may grow unnoticed with rho_inf near 1 (docs/time_integration.md).  Errors as for
    `pmr.simulation.SystemSimulator`.
    """
    march = March(form, excitation, start_of(form.system, excitation))
    first = march.outputs_at(dict(zip(excitation.paths, excitation.s[0], strict=True)), march.f[0])
    chosen = np.arange(len(first)) if outputs is None else np.asarray(outputs, np.int64)
    count = excitation.stepping.steps // every + 1
    y, forces = np.empty((count, len(chosen))), np.empty((count, len(march.pushing)))
    y[0], forces[0] = first[chosen], march.loop.state.multipliers
    seconds = march.observe(march.outputs_of(chosen), every, y[1:], forces[1:])
    return Observation(march.t[::every], y, form.combined.forces(forces), seconds)


def static_start(system: System, excitation: Excitation) -> dict[str, InitialState]:
    """Every body at rest in equilibrium with the loads at t = 0; errors as for `pmr.system.statics.equilibrium`."""
    assembly, states = Assembly(system), {}
    f, c = excitation.forces(system.input_names)[0], excitation.amplitudes(system.term_names)[0]
    found = equilibrium(assembly, places(system, excitation)[0], f, c).q
    for name, body in system.bodies.items():
        q = np.zeros(body.size)
        q[assembly.free[name]] = found[assembly.coordinates[name]]
        states[name] = InitialState(q, np.zeros(body.size))
    return states


def start_of(
    system: System, excitation: Excitation, initial: Mapping[str, InitialState] | None = None
) -> Mapping[str, InitialState]:
    """Of each body at t = 0: what is given, else at rest or in equilibrium, as the excitation says."""
    if initial is not None or excitation.start == "rest":
        return initial or {}
    return static_start(system, excitation)


def displacements(system: System, trajectory: SystemTrajectory) -> dict[str, Array]:
    """Outputs O q + W f - X lambda of every body, (T, o)."""
    found, first = {}, 0
    for name, body in system.bodies.items():
        motion, carriers = trajectory.bodies[name], body.carriers
        loads = trajectory.loads[:, first : first + len(body.input_names)]
        first += len(body.input_names)
        y, known = np.asarray((body.outputs @ motion.q.T).T), (body if carriers is None else carriers).flexibility
        own = [side for side in system.sides if side.place.body == name]
        if known is not None:
            y = y + loads @ known.direct.T
            for side, x, force in zip(own, motion.s.T, motion.multipliers.T, strict=True):
                if carriers is None:
                    X = evaluate(known.outputs, x)[:, :, body.row_names.index(side.place.row)]
                else:
                    X = system.row(side.place).weights(x) @ known.outputs.T
                y = y - force[:, None] * X
        found[name] = y
    return found
