r"""The compiled simulator of any system: generalized-alpha in the modal coordinates of each body.

The bodies' M, K and D never change, so each is diagonalised once; the multipliers of the contacts are all that couples
them, one m x m solve a step (`pmr.simulation.native.step`, docs/system_of_bodies.md).  A body may be reduced or of full
order, up to some thousand coordinates: the same loop is the reference of what a reduction leaves out.
"""

from __future__ import annotations

from collections.abc import Mapping
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


def simulate(
    system: System,
    excitation: Excitation,
    initial: Mapping[str, InitialState] | None = None,
    progress: Progress | None = None,
) -> SystemTrajectory:
    """Simulate all bodies from t = 0 on; arguments and errors as for `pmr.simulation.SystemSimulator`."""
    march, T = March(SystemForm.of(system), excitation, initial or {}), excitation.stepping.steps + 1
    found: dict[str, Any] = {}

    def taken(steps: Steps) -> None:
        arrays = steps.record._asdict() | {"stored": steps.stored, "work": steps.work}
        for name, array in arrays.items():
            if array is not None:
                found.setdefault(name, np.empty((T, *array.shape[1:]), array.dtype))
                found[name][steps.first : steps.first + len(array)] = array

    ended = march.run(taken, progress)
    t, forces, motions = march.t, found["multipliers"], {}
    for name, form in march.form.forms.items():
        columns, own = march.form.columns[name], march.x[:, system.sides_of(name)]
        q, v = found["z"][:, columns] @ form.X.T, found["v"][:, columns] @ form.X.T
        pressed = system.pressed(name, forces)
        motions[name] = Trajectory(t, q, v, pressed, own, ended.seconds, surplus=ended.surplus)
    peaks = np.where(march.pushing, found.get("peaks", forces), forces)
    parts = found.get("parts", np.ones(T, np.int64))
    return SystemTrajectory(
        t, motions, forces, peaks, march.f, found["stored"], found["work"], ended.seconds, ended.surplus, parts,
        found.get("impulses"),
    )  # fmt: skip


def static_start(system: System, excitation: Excitation) -> dict[str, InitialState]:
    """Every body at rest in equilibrium with the loads at t = 0; errors as for `pmr.system.statics.equilibrium`."""
    assembly, states = Assembly(system), {}
    found = equilibrium(assembly, places(system, excitation)[0], excitation.forces(system.input_names)[0]).q
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
