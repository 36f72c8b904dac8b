"""How the full model of a boom moves.

All sections in full order are simulated by whoever is fastest for their size, and checked before they judge, as the
reference of one body is (`pmr.compare.references`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from pmr.compare.boom_figures import CURVES
from pmr.compare.booms import Motion, respond, response_of
from pmr.compare.responses import full_simulator
from pmr.compare.simulated import simulator_of
from pmr.compare.trust import distrust
from pmr.errors import SimulationError
from pmr.errors.environment import Clock
from pmr.fullmodel.build import Built
from pmr.fullmodel.system import FullSystem
from pmr.results import Response
from pmr.scene import Scene
from pmr.simulation.excitation import Excitation, places
from pmr.simulation.petsc import Checkpoint, Recording, observe_system, static_start
from pmr.simulation.petsc.rows import contact_rows
from pmr.simulation.stepping import TimeStepping
from pmr.system.assembly import Assembly
from pmr.system.from_scene import contacts_of
from pmr.system.system import System

Array = NDArray[np.float64]

#: (rad/s)^2, below all that is looked for: what holds is not singular there.
SHIFT = -1.0


@dataclass(frozen=True)
class FullRun:
    """A simulation of all sections in full order."""

    response: Response | None  # on rank 0; None where it failed or can't be trusted
    missing: str  # why
    states: Mapping[str, Array]  # of every section (S, n_local): this rank's rows, at the steps that were asked for


@dataclass(frozen=True)
class FullBoom:
    """All sections in full order, who simulates them, and on rank 0 the `system` of those that are not distributed."""

    whole: FullSystem
    simulator: str
    system: System | None

    @classmethod
    def of(cls, boom: Scene, built: Mapping[str, Built]) -> FullBoom:
        """Collective."""
        bodies = {name: one.model for name, one in built.items()}
        whole = FullSystem(bodies, contacts_of(boom, bodies))
        simulator = full_simulator(boom, whole.size)
        return cls(whole, simulator, None if simulator == "petsc" else whole.gather())

    def frequencies(self, boom: Scene, steps: NDArray[np.int64]) -> Array:
        """The lowest natural frequencies (S, f) in Hz at some steps, every contact closed; collective."""
        x = places(self.whole, Excitation.of(boom))[steps]
        if self.simulator == "march":
            found = None if self.system is None else Assembly(self.system).frequencies(x, CURVES)
        else:
            found = _sparse(self.whole, x)
        return np.asarray(self.whole.comm.bcast(found))

    def simulate(
        self,
        boom: Scene,
        stepping: TimeStepping,
        steps: NDArray[np.int64],
        clock: Clock,
        checkpoint: Checkpoint | None = None,
    ) -> FullRun:
        """Its motion, and its states at some steps, made as the reduced model made them.  Collective."""
        excitation, comm = Excitation.of(boom), self.whole.comm
        excitation = excitation.with_stepping(stepping)
        found, failed, states = None, "", dict[str, Array]()
        try:
            with clock.stage("full") as done:
                start = static_start(self.whole, excitation) if excitation.start == "equilibrium" else {}
                if self.simulator == "petsc":
                    recording = Recording(energies=True, states=(steps * boom.time.step).tolist())
                    history = observe_system(self.whole, excitation, recording, start, done, checkpoint)
                    assert history.energy is not None
                    motion = Motion(history.y, history.forces, history.peaks, history.energy)
                    found = response_of(self.whole, history.t, motion)
                    found = replace(found, seconds=history.seconds, surplus=history.surplus)
                    states = {name: one.q for name, one in history.states.items()}
                elif self.system is not None:
                    trajectory = simulator_of(self.simulator)(self.system, excitation, start, done)
                    found = respond(self.system, trajectory)
                    states = {name: one.q[steps] for name, one in trajectory.bodies.items()}
        except SimulationError as error:
            failed = str(error).removeprefix("full: ")  # the clock's stage
        failed = comm.bcast(failed or (distrust(found) if found is not None else None) or "")
        if self.simulator != "petsc":
            whole = comm.bcast(states)
            states = {name: q[:, self.whole.bodies[name].share] for name, q in whole.items()}
        return FullRun(None if failed else found, failed, states)


def _sparse(whole: FullSystem, x: Array) -> Array | None:
    """By Lanczos iterations on the saddle point of the coordinates and the contacts' forces, on rank 0."""
    system = whole.supported()
    gathered = {id(model): model.gather() for model in dict((id(one), one) for one in system.models).values()}
    if system.comm.rank > 0:
        return None
    bodies = [gathered[id(model)] for model in system.models]
    K = sp.block_diag([body.K for body in bodies if body is not None], format="csr")
    M = sp.block_diag([body.M for body in bodies if body is not None], format="csr")
    m, scale = len(system.contacts), abs(K).max()  # forces in the unit of stiffness: rows of both kinds are of one size
    mass = sp.block_diag([M, sp.csr_matrix((m, m))], format="csc")
    supports = np.array([side.place.at for side in system.sides[x.shape[1] :]])
    found = []
    for at in x:
        C = scale * contact_rows(system, np.concatenate([at, supports]))
        A = sp.bmat([[K, C.T], [C, -(scale**2) * sp.diags(system.compliance)]], format="csc")
        factor = spla.splu((A - SHIFT * mass).tocsc())
        start = factor.solve(np.concatenate([M @ np.ones(M.shape[0]), np.zeros(m)]))
        solved = spla.LinearOperator(A.shape, factor.solve)
        values = spla.eigsh(A, CURVES, M=mass, sigma=SHIFT, OPinv=solved, v0=start, return_eigenvectors=False)
        found.append(np.sqrt(np.maximum(np.sort(values), 0.0)) / (2.0 * np.pi))
    return np.array(found)
