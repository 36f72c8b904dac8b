"""Simulate and evaluate a body alone, as the system of one, with its path coordinate and all of its rows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import springs
from numpy.typing import NDArray

from pmr import Response, System
from pmr.compare import evaluation
from pmr.files.arrays import Array
from pmr.results import Energy
from pmr.scene.keys import ALONE
from pmr.scene.signals import Chirp, Sine, Step
from pmr.simulation import Excitation, InitialState, Progress, TimeStepping, exudyn
from pmr.simulation.modal import ModalForm
from pmr.simulation.native import systems
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.systems import Observation
from pmr.simulation.stepping import half_form, load_potential, row_products, step_means
from pmr.system.body import SlidingBody, Trajectory
from pmr.system.polynomials import evaluate
from pmr.system.states import BodyStates, SystemTrajectory
from pmr.system.supports import SupportForces

Simulate = Callable[..., "Motion"]

PATH = Sine(amplitude=0.7, frequency=0.8, offset=2.0)
LOADS = (
    Chirp(amplitude=300.0, times=(0.0, 0.2), frequencies=(3.0, 20.0), phase=1.0),
    Step(time=0.1, before=50.0, after=-400.0),
)
STEPPING = TimeStepping(end=0.2, step=1e-3, rho_inf=0.8)


@dataclass(frozen=True)
class Motion(Trajectory):
    """Trajectory of a body alone at T times, with the path s (T,) and the multipliers of all rows.

    Rows of held coordinates are among them.  `peaks` and `parts` are None unless a contact is unilateral.
    """

    peaks: Array | None = None
    parts: NDArray[np.int64] | None = None

    def at(self, steps: Any) -> Motion:
        """Select time steps."""
        arrays = {name: value[steps] for name, value in vars(self).items() if isinstance(value, np.ndarray)}
        return replace(self, **arrays)


def some_state(body: SlidingBody) -> InitialState:
    """Random coordinates that fulfil the rows at the start of `PATH`, and random rates."""
    q, v = np.random.default_rng(1).standard_normal((2, body.size)) * [[1e-3], [1e-2]]
    C = body.C(PATH.offset) @ np.eye(body.size)
    return InitialState(q - np.linalg.pinv(C) @ (C @ q), v)


def simulate(
    body: SlidingBody,
    excitation: Excitation,
    initial: InitialState | None = None,
    progress: Progress | None = None,
    by: Callable[..., SystemTrajectory] = systems.simulate,
    **more: Any,
) -> Motion:
    """Simulate a body alone by a simulator of systems, from an initial state or from rest."""
    system, excitation = System.of(body), excitation.on_slider
    start = systems.start_of(system, excitation) if initial is None else {ALONE: initial}
    return motion(body, by(system, excitation, start, progress, **more), excitation)


def in_exudyn(
    body: SlidingBody,
    excitation: Excitation,
    initial: InitialState | None = None,
    progress: Progress | None = None,
    formulation: str = "springs",
) -> Motion:
    """Simulate a body alone in Exudyn."""
    return simulate(body, excitation, initial, progress, exudyn.simulate_system, formulation=formulation)


def simulate_modal(
    form: ModalForm, excitation: Excitation, initial: InitialState | None = None, progress: Progress | None = None
) -> Motion:
    """Simulate a body alone in modal form."""
    alone, excitation = SystemForm.of_modal_body(form), excitation.on_slider
    start = systems.start_of(alone.system, excitation) if initial is None else {ALONE: initial}
    return motion(form.body, systems.simulate_form(alone, excitation, start, progress), excitation)


def observe(
    form: ModalForm, excitation: Excitation, outputs: Sequence[int] | None = None, every: int = 1
) -> Observation:
    """Simulate a body alone in modal form, and store only these outputs at each `every`-th step."""
    form.body.ensure_whole("model")
    return systems.observe(SystemForm.of_modal_body(form), excitation.on_slider, outputs, every)


def motion(body: SlidingBody, found: SystemTrajectory, excitation: Excitation) -> Motion:
    """Motion of a body alone from the trajectory of the system of one; forces of held rows are computed."""
    alone, contacts = found.bodies[ALONE], _contacts(body)
    multipliers, s = np.zeros((len(found.t), len(body.row_names))), excitation.path_within(body.domain)
    multipliers[:, contacts] = found.forces
    if body.held:
        assert body.reactions is not None
        held = Trajectory(found.t, alone.q, alone.v, multipliers, s, found.seconds)
        of_rows = [body.reactions.names.index(body.row_names[k]) for k in body.held]
        multipliers[:, list(body.held)] = SupportForces.from_body(body, True).on_one_path(held, found.loads)[:, of_rows]
    peaks = None
    if not np.isnan(body.row_clearance).all():
        peaks = multipliers.copy()
        peaks[:, contacts] = found.peaks
    parts = None if peaks is None else found.parts
    return Motion(found.t, alone.q, alone.v, multipliers, s, found.seconds, found.surplus, peaks, parts)


def respond(body: SlidingBody, found: Trajectory, path_rate: Array, loads: Array) -> Response:
    """Response of a body alone from its trajectory, the rates (T,) of its path in m/s and the loads (T, i)."""
    system, contacts = System.of(body), _contacts(body)
    forces, peaks = found.multipliers[:, contacts], getattr(found, "peaks", None)
    places = [found.s if one.inner.path else np.full_like(found.s, one.inner.at) for one in system.contacts]
    x = np.column_stack([np.empty((len(found.t), 0)), *places])
    stored, work = energy_and_work(body, found, loads)
    whole = SystemTrajectory(
        t=found.t,
        bodies={ALONE: Trajectory(found.t, found.q, found.v, system.side_multipliers(ALONE, forces), x, found.seconds)},
        forces=forces,
        peaks=forces if peaks is None else peaks[:, contacts],
        loads=loads,
        energy=stored,
        work=work,
        seconds=found.seconds,
        surplus=found.surplus,
        rates=np.asarray(path_rate)[:, None],
    )
    return evaluation.evaluate_motion(system, whole)


def displacement(body: SlidingBody, q: Array, s: Array, multipliers: Array, loads: Array) -> Array:
    """Outputs O q + W f - X(s) lambda, (T, o), from q (T, n), s (T,), multipliers (T, m) and loads (T, i).

    W and X(s) are the residual flexibility's; without it only O q is returned.
    """
    result = np.asarray((body.outputs @ q.T).T)
    return (
        result if body.flexibility is None else result + springs.displacement(body.flexibility, s, multipliers, loads)
    )


def energy(body: SlidingBody, found: Trajectory, loads: Array) -> Energy:
    """Kinetic, strain and potential energy (T,) in J of a body alone."""
    kinetic, (stored, _) = half_form(body.M, found.v), energy_and_work(body, found, loads)
    return Energy(kinetic, stored - kinetic, load_potential(body, found, loads))


def energy_and_work(body: SlidingBody, found: Trajectory, loads: Array) -> tuple[Array, Array]:
    """Kinetic and strain energy (T,) in J, with that of pads and residual flexibility, and work (T,) in J since t = 0.

    The work is that of loads and of rows that move, from the means over each step, as `pmr.simulation.stepping` says.
    """
    q, s, forces, flexibility = found.q, found.s, found.multipliers, body.flexibility
    v, points = found.v.copy(), np.asarray(q @ body.B)
    v[:, body.quasi_static] = 0.0
    mean_q, mean_f, mean_forces = (step_means(values) for values in (q, loads, forces))
    with np.errstate(over="ignore", invalid="ignore"):
        turned = body.apply_rows(s[1:], mean_q) - body.apply_rows(s[:-1], mean_q)
        stored = half_form(body.M, v) + half_form(body.K, q) + forces**2 @ body.row_compliance / 2.0
        if flexibility is not None:
            G, H = evaluate(flexibility.rows, s), evaluate(flexibility.inputs, s)
            stored += np.einsum("ti,ij,tj->t", loads, flexibility.energy, loads) / 2.0
            stored += np.einsum("tm,tmn,tn->t", forces, G, forces) / 2.0 - np.einsum("tm,tmi,ti->t", forces, H, loads)
            points = points + loads @ flexibility.energy - np.einsum("tmi,tm->ti", H, forces)
            turned += np.einsum("tmi,ti->tm", np.diff(H, axis=0), mean_f)
            turned -= np.einsum("tmn,tn->tm", np.diff(G, axis=0), mean_forces) / 2.0
        steps = row_products(mean_f, np.diff(points, axis=0)) + row_products(mean_forces, turned)
    return stored, np.append(0.0, np.cumsum(steps))


def states(body: SlidingBody, found: Trajectory, loads: Array) -> BodyStates:
    """States of a body for the recovery of stresses; all its rows are at the slider's path."""
    s = np.repeat(found.s[:, None], len(body.row_names), axis=1)
    return BodyStates(found.t, s, found.q, found.v, found.multipliers, loads, body.row_names)


def _contacts(body: SlidingBody) -> list[int]:
    """Numbers of the rows that do not hold a coordinate."""
    return [number for number in range(len(body.row_names)) if number not in body.held]
