r"""The compiled simulator of a system of bodies: generalized-alpha in the modal coordinates of each.

The bodies' M, K and D never change, so each is diagonalised once; the multipliers of the contacts are all that couples
them, one m x m solve a step (`pmr.simulation.native.multibody_step`, docs/system_of_bodies.md).  A body may be reduced
or of full order, up to some thousand coordinates: the same loop is the reference of what a reduction leaves out.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.excitation import Excitation
from pmr.simulation.native.multibody_march import MultibodyMarch, places
from pmr.simulation.start import InitialState
from pmr.simulation.stepping import Progress
from pmr.system.assembly import Assembly
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
    return MultibodyMarch(system, excitation, initial or {}).run(progress)


def static_start(system: System, excitation: Excitation) -> dict[str, InitialState]:
    """Every body at rest in equilibrium with the loads at t = 0; errors as for `pmr.system.statics.equilibrium`."""
    assembly, states = Assembly(system), {}
    found = equilibrium(assembly, places(system, excitation)[0], excitation.forces(system.input_names)[0]).q
    for name, body in system.bodies.items():
        q = np.zeros(body.size)
        q[assembly.free[name]] = found[assembly.coordinates[name]]
        states[name] = InitialState(q, np.zeros(body.size))
    return states


def displacements(system: System, trajectory: SystemTrajectory) -> dict[str, Array]:
    """Outputs O q + W f - X lambda of every body, (T, o)."""
    found, first = {}, 0
    for name, body in system.bodies.items():
        motion, carriers = trajectory.bodies[name], body.carriers
        loads = trajectory.loads[:, first : first + len(body.input_names)]
        first += len(body.input_names)
        y = np.asarray((body.outputs @ motion.q.T).T)
        if carriers is not None and carriers.flexibility is not None:
            y = y + loads @ carriers.flexibility.direct.T
            own = [side for side in system.sides if side.place.body == name]
            for side, x, force in zip(own, motion.s.T, motion.multipliers.T, strict=True):
                y = y - force[:, None] * (system.row(side.place).weights(x) @ carriers.flexibility.outputs.T)
        found[name] = y
    return found
