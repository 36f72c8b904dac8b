"""The full models of a scene's bodies as one system: its motion, by a simulator that suits its size, and frequencies.

A reference is a motion with which the reduced model's is compared.  It is checked before: a reference that fails or
that can't be trusted (`pmr.compare.trust`) counts as missing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from pmr.compare.evaluation import append_friction, response_to_motion
from pmr.compare.outputs import output_contacts
from pmr.compare.responses import Simulation, cable_response, full_simulator, simulate_by
from pmr.compare.trust import reason_for_distrust, rigid_contacts
from pmr.errors import SimulationError, begin_aside, call_on_first_rank
from pmr.errors.environment import Clock, stage_words
from pmr.files.arrays import Array
from pmr.fullmodel.eigensolvers import lowest_frequencies
from pmr.fullmodel.model import FullModel, FullSystem
from pmr.results import Response
from pmr.scene import Scene
from pmr.scene.choice import REFERENCE, refuse_unsupported
from pmr.scene.keys import ALONE
from pmr.scene.mechanism import frame_terms
from pmr.simulation import Excitation, Progress, TimeStepping
from pmr.simulation.excitation import side_positions
from pmr.simulation.petsc import Checkpoint, History, observe, static_start
from pmr.simulation.petsc.rows import contact_rows
from pmr.simulation.reactions import Supports, with_forces_on_machine, with_reactions
from pmr.simulation.start import needs_of
from pmr.system.assembly import Assembly
from pmr.system.body_matrices import natural_frequencies
from pmr.system.contacts import Friction
from pmr.system.from_scene import contacts_of
from pmr.system.states import BodyStates, friction_on_body
from pmr.system.system import System
from pmr.system.terms import TermSum, hoist_of, terms_of

#: (rad/s)^2: shift below all eigenvalues, at which the shifted stiffness is not singular.
SHIFT = -1.0
#: Number of modes without gyroscopic forces for each frequency with these forces.
MODES_PER_GYROSCOPIC = 6


@dataclass(frozen=True)
class References:
    """Responses with which a reduced system is compared; on other ranks than 0, `responses` may lack some."""

    responses: Mapping[str, Response]  # ``full`` and ``ancf``, if the scene is compared with them
    # states of every full body at the selected steps, with this rank's rows of its coordinates
    states: Mapping[str, BodyStates]
    missing: Mapping[str, str]  # reason why a reference is missing, by its name; ``ancf`` on rank 0 alone


class FullMotion(NamedTuple):
    """Response of the full system, None on other ranks than 0, and this rank's rows of its states, by body."""

    response: Response | None
    states: Mapping[str, BodyStates]


@dataclass(frozen=True)
class FullOrder:
    """All bodies of a scene in full order (`system`), and the name of their `simulator`; every method is collective."""

    scene: Scene
    system: FullSystem
    simulator: str

    @classmethod
    def join(cls, scene: Scene, models: Mapping[str, FullModel]) -> FullOrder:
        """Join the full models of a scene, by body, to one system."""
        full_system = FullSystem(models, contacts_of(scene, models), hoist=hoist_of(scene))
        return cls(scene, full_system, full_simulator(scene, full_system.size))

    @cached_property
    def gathered_system(self) -> System | None:
        """The system as SciPy matrices on rank 0, for simulators that are not distributed.

        None is returned on other ranks.
        """
        gathered_system = self.system.gather()
        return gathered_system and replace(gathered_system, terms=terms_of(self.scene, gathered_system.bodies))

    def frequencies(self, s: Array, count: int, c: Array) -> Array:
        """Return the f = `count` lowest natural frequencies (S, f) in Hz at S positions of the system, on every rank.

        Collective.  The P paths have the coordinates s (S, P) in m, and every contact is closed.  The system's k terms,
        such as geometric stiffness, have the amplitudes c (S, k).
        """
        return self.begin_frequencies(s, count, c, None)()

    def begin_frequencies(self, s: Array, count: int, c: Array, helper: Executor | None) -> Callable[[], Array]:
        """Return a function with the result of `frequencies`, which a process of `helper` computes if it can."""
        if ALONE in self.system.bodies and not c.size:
            solver = self.scene.reduction.solver
            hertz = lowest_frequencies(self.system.bodies[ALONE], s[:, 0], count, solver) / (2.0 * np.pi)
            return lambda: hertz
        x = self.system.side_coordinates(dict(zip(self.scene.driven_paths, s.T, strict=True)))
        if self.simulator == "march":
            lowest = begin_aside(helper, _frequencies, self.gathered_system, x, count, c)
        else:
            lowest = begin_aside(None, _lanczos_frequencies, self._with_terms(), x, count, c)
        return lambda: np.asarray(self.system.comm.bcast(lowest()))

    def begin_simulation(
        self, steps: Sequence[int], stepping: TimeStepping, helper: Executor | None
    ) -> Callable[[], Simulation] | None:
        """Let a process of `helper` simulate the full system for `references`; return a function with its simulation.

        None is returned if that simulation is not needed, or if this process has to make it.
        """
        if helper is None or self.simulator != "march" or "full" not in self.scene.compare.against:
            return None
        excitation = Excitation.from_scene(self.scene).with_stepping(stepping)
        return begin_aside(helper, simulate_by, self.scene, self.gathered_system, excitation, self.simulator, steps)

    def references(
        self,
        clock: Clock | None = None,
        steps: Sequence[int] = (),
        checkpoint: Checkpoint | None = None,
        stepping: TimeStepping | None = None,
        begun: Callable[[], Simulation] | None = None,
    ) -> References:
        """Simulate all references that the scene is compared with, and record states of the full bodies at `steps`.

        `steps` are numbers of time steps.  If contacts only push, `stepping` holds the parts into which the reduced
        system's steps were divided; None stands for the scene's steps.  If `checkpoint` is not None, a simulation that
        was interrupted continues.  `begun` is what `begin_simulation` returned.  References that fail are listed in
        `References.missing`.  `clock` measures the wall time of each reference.
        """
        responses, missing = dict[str, Response](), dict[str, str]()
        states: Mapping[str, BodyStates] = {}
        for name in [name for name in ("full", "ancf") if name in self.scene.compare.against]:
            try:
                if name == "full":
                    response, states = self._simulate_full(clock or Clock(), steps, checkpoint, stepping, begun)
                else:
                    response = self.reference(name, clock)
            except SimulationError as error:
                missing[name] = str(error).removeprefix(f"{stage_words(name)}: ")  # which the clock has put first
            else:
                responses |= {} if response is None else {name: response}
        return References(responses, states, missing)

    def reference(self, name: str, clock: Clock | None = None) -> Response | None:
        """Return the response of the reference `name`: ``"full"`` or, for a single body, ``"ancf"``.

        The response is returned on rank 0; other ranks may get None.  Raises SimulationError if the simulation fails or
        can't be trusted (`pmr.compare.trust`), for ``"full"`` on every rank, for ``"ancf"`` on rank 0.
        """
        if name == "full":
            return self._simulate_full(clock or Clock()).response
        if self.system.comm.rank > 0:
            return None
        with (clock or Clock()).stage(name) as done:
            response = cable_response(self.scene, self.system.bodies[ALONE], done)
        if reason := reason_for_distrust(response):
            raise SimulationError(reason)
        return response

    def _simulate_full(
        self,
        clock: Clock,
        steps: Sequence[int] = (),
        checkpoint: Checkpoint | None = None,
        stepping: TimeStepping | None = None,
        begun: Callable[[], Simulation] | None = None,
    ) -> FullMotion:
        """Simulate the full system; return its response, and this rank's rows of the states at `steps`, by body.

        If contacts only push, `stepping` holds the parts into which steps are divided; None stands for the scene's
        steps.  If `checkpoint` is not None, a simulation that was interrupted continues.  `begun` is what
        `begin_simulation` returned.  Raises SimulationError on every rank if the simulation fails, or its response
        can't be trusted.
        """
        system, comm, excitation = self.system, self.system.comm, Excitation.from_scene(self.scene)
        excitation = excitation.with_stepping(stepping or excitation.stepping)
        rigid, x = system.compliance.rigid, side_positions(system, excitation)
        refuse_unsupported(self.simulator, needs_of(system, rigid, x, excitation.stepping.rho_inf), REFERENCE)
        with clock.stage("full") as done:
            if self.simulator == "petsc":
                motion = self._simulate_distributed(excitation, steps, done, checkpoint)
            else:

                def make() -> Simulation:
                    """Simulate the system on rank 0."""
                    assert self.gathered_system is not None  # as on rank 0
                    if begun is not None:
                        return begun()
                    return simulate_by(self.scene, self.gathered_system, excitation, self.simulator, steps, done)

                _ = self.gathered_system  # collective
                simulated = call_on_first_rank(comm, make)
                of_all = comm.bcast(None if simulated is None else simulated.states)
                states = {name: of.select_coordinates(system.bodies[name].share) for name, of in of_all.items()}
                motion = FullMotion(None if simulated is None else simulated.response, states)
        of_first = motion.response
        if reason := comm.bcast(None if of_first is None else reason_for_distrust(of_first, rigid_contacts(system))):
            raise SimulationError(reason)
        return motion

    def _simulate_distributed(
        self, excitation: Excitation, steps: Sequence[int], done: Progress, checkpoint: Checkpoint | None
    ) -> FullMotion:
        """Simulate the full system by PETSc on all ranks; return response and states as `_simulate_full`.

        `steps` are the numbers of the steps whose states are returned; `done` is called with the share of steps that
        are done.  If `checkpoint` is not None, an interrupted simulation continues.
        """
        system = self._with_terms()
        times = [excitation.stepping.step * step for step in steps]
        start = static_start(system, excitation) if excitation.start == "equilibrium" else {}
        history = observe(system, excitation, times, start, done, checkpoint)
        response = response_to_motion(
            system, history.t, history.y, history.contacts.forces, history.contacts.peaks, history.energy
        )
        response = _with_support_reactions(response, system, history)
        response = replace(
            append_friction(response, system.contacts, history.contacts.friction),
            residual_position=history.errors.position,
            residual_velocity=history.errors.velocity,
            seconds=history.seconds.preparation + history.seconds.steps,
            surplus=history.errors.surplus,
        )
        x, f = side_positions(system, excitation), excitation.forces(system.input_names)
        states = _states_of_bodies(system, history, list(steps), x, f)
        return FullMotion(with_forces_on_machine(self.scene, response), states)

    def _with_terms(self) -> FullSystem:
        """Return the distributed system with its terms: the matrices that its moving frame adds to the equations.

        Collective.  The system is returned unchanged if the frame adds none.  The sparse matrices of the terms are
        whole on every rank.
        """
        if not list(frame_terms(self.scene)):
            return self.system
        terms = None if (gathered_system := self.gathered_system) is None else gathered_system.terms
        return replace(self.system, terms=self.system.comm.bcast(terms))


def _states_of_bodies(
    system: FullSystem, history: History, steps: list[int], x: Array, f: Array
) -> dict[str, BodyStates]:
    """Return the states of all bodies at `steps` of a `history`, by body.

    `x` (T, sides) in m are the positions of the contacts' sides over time, `f` (T, i) in N the loads on the inputs.
    """
    states_of_bodies = dict[str, BodyStates]()
    forces, rubbing = history.contacts.forces[steps], Friction.from_contacts(system.contacts)
    friction = None if history.contacts.friction is None else history.contacts.friction[steps]
    reaching = forces if rubbing is None or friction is None else forces - rubbing.cylinder_forces(friction)
    for name, columns in system.load_columns.items():
        side_numbers, states = system.sides_of(name), history.states[name]
        rows = tuple(system.sides[number].place.row for number in side_numbers)
        loads, pressed = f[steps, columns], system.side_multipliers(name, reaching)
        rubbed = friction_on_body(system, name, forces, friction)
        states_of_bodies[name] = BodyStates(
            states.t, x[steps][:, side_numbers], states.q, states.v, pressed, loads, rows, **rubbed
        )
    return states_of_bodies


def _with_support_reactions(response: Response, full_system: FullSystem, history: History) -> Response:
    """Return the response with the forces in N and moments in N m of those rigid supports that are no outputs yet."""
    system, bearing_contacts = full_system.with_supports(), set(output_contacts(full_system))
    inner = {k: contact.inner for k, contact in enumerate(system.contacts) if k not in bearing_contacts}
    rows = {(side.body, side.row): k for k, side in inner.items()}
    forces = np.hstack([history.contacts.forces, history.supports])
    supports, reactions = dict[str, Supports](), dict[str, Array]()
    for name, model in full_system.bodies.items():
        support_rows = [row for row in model.rows.rows if row.is_fixed and (name, row.name) in rows]
        if support_rows:
            supports[name] = [(row.name, row.unit) for row in support_rows]
            reactions[name] = forces[:, [rows[name, row.name] for row in support_rows]]
    return with_reactions(response, supports, reactions)


def _frequencies(system: System | None, x: Array, count: int, c: Array) -> Array | None:
    """Return the `count` lowest frequencies (S, count) in Hz of a system, by `Assembly`; None without a system."""
    return None if system is None else Assembly(system).frequencies(x, count, c)


def _lanczos_frequencies(full_system: FullSystem, places_of: Array, count: int, c: Array) -> Array | None:
    """Return the f = `count` lowest frequencies (S, f) in Hz, by Lanczos iterations, on rank 0; None on other ranks.

    The unknowns of the iterations are coordinates and contact forces.  `places_of` (S, sides) in m are the path
    coordinates of the contacts' sides at S positions of the system.  The system's k terms have the amplitudes c (S, k)
    there.  Of terms that act on rates only the antisymmetric, gyroscopic part is taken; it is projected on the lowest
    modes of the system without it.
    """
    system = full_system.with_supports()
    gathered = {id(model): model.gather() for model in dict((id(model), model) for model in system.models).values()}
    if system.comm.rank > 0:
        return None
    bodies = [gathered[id(model)] for model in system.models]
    gathered_bodies = {name: body for name, body in zip(system.bodies, bodies, strict=True) if body is not None}
    slices = zip(gathered_bodies, system.whole_slices, strict=True)
    numbers = {name: np.arange(at.start, at.stop) for name, at in slices}
    terms = [term.scatter(numbers, system.size) for term in system.terms]
    K0 = sp.block_diag([body.K for body in gathered_bodies.values()], format="csr")
    M = sp.block_diag([body.M for body in gathered_bodies.values()], format="csr")
    stiffness, damping = TermSum(K0, terms, "stiffness"), TermSum(0.0 * M, terms, "damping")
    # forces scaled by the stiffness, so that all rows are of similar size
    m, scale = len(system.contacts), abs(K0).max()
    mass = sp.block_diag([M, sp.csr_matrix((m, m))], format="csc")
    supports = np.array([side.place.at for side in system.sides[places_of.shape[1] :]])
    lowest = []
    for at, amplitudes in zip(places_of, c, strict=True):
        K, V = stiffness.matrix(amplitudes), damping.matrix(amplitudes)
        x = np.concatenate([at, supports])
        C, F = scale * contact_rows(system, x), sp.csr_matrix(-(scale**2) * system.contact_compliance(x))
        A = sp.bmat([[(K + K.T) / 2.0, C.T], [C, F]], format="csc")
        factor = spla.splu((A - SHIFT * mass).tocsc())
        start = factor.solve(np.concatenate([M @ np.ones(M.shape[0]), np.zeros(m)]))
        solved = spla.LinearOperator(A.shape, factor.solve)
        count_of_pairs = MODES_PER_GYROSCOPIC * count if V.count_nonzero() else count
        values, q = spla.eigsh(A, count_of_pairs, M=mass, sigma=SHIFT, OPinv=solved, v0=start)
        X = q[: system.size]
        turning = X.T @ ((V - V.T) @ X) / 2.0
        lowest.append(natural_frequencies(X.T @ (M @ X), turning, np.diag(values))[:count] / (2.0 * np.pi))
    return np.array(lowest)
