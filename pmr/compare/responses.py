"""How a system moves under a scene by the simulators that it names, and what it then says; FEniCSx is not needed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.compare import booms
from pmr.compare import errors as compare
from pmr.compare.evaluation import Evaluation, respond
from pmr.compare.pivot import at_pivot
from pmr.errors import GrowthError, environment
from pmr.errors.environment import Clock
from pmr.results import Response
from pmr.scene import Scene
from pmr.scene.choice import transverse
from pmr.scene.members import member_at
from pmr.scene.names import ALONE
from pmr.scene.simulators import SIMULATORS
from pmr.simulation import Excitation, TimeStepping, contact_step, exudyn
from pmr.simulation.blocks import Block, Recorder
from pmr.simulation.modal import modal_form
from pmr.simulation.native import simulator as march
from pmr.simulation.native import systems
from pmr.simulation.native.form import SystemForm
from pmr.simulation.stepping import Progress
from pmr.system.body import SlidingBody
from pmr.system.states import BodyStates, states_of
from pmr.system.system import Joined, System, SystemTrajectory

Indices = NDArray[np.int64]

#: A full model of more coordinates than this goes through PETSc, for diagonalising costs more.  Exudyn factorises in
#: every step: 453 coordinates take it twice as long as PETSc, and from some 900 on Newton's method may not converge.
MARCHED_UP_TO = 400
#: The same of several sections, which are diagonalised one by one.
SECTIONS_MARCHED_UP_TO = 1200
#: s: what takes no longer is simulated several times, since the first one may be cold.
SHORT = 2.0


@dataclass(frozen=True)
class Simulated:
    """What a simulation says."""

    response: Response
    states: Mapping[str, BodyStates]  # of each body at the steps that were asked for
    parts: Indices | None  # (T,): of how many parts each step was made
    run: SystemTrajectory | None  # of several bodies, whose states are all kept


@dataclass(frozen=True)
class Simulations:
    """What the simulators of a scene say."""

    first: Simulated  # by the one that the scene names first
    seconds: Mapping[str, float]  # of each simulator's solver, the least of its repeats
    agreement: Mapping[str, float]  # of each two of them, m
    made: TimeStepping  # the time grid, with the parts that the first one made each step in where contacts only push


def simulate(
    scene: Scene, system: System, excitation: Excitation, clock: Clock | None = None, steps: Sequence[int] = ()
) -> Simulations:
    """Simulate a reduced system by every simulator that the scene names; the first one's states at the `steps`.

    Exudyn makes each step in the parts that the compiled simulator before it chose.

    Raises an InputError where the motion grows: the scene's own model can be mended by its step.
    """
    clock, names = clock or Clock(), scene.simulation.simulators
    omega, made = contact_step.contact_frequency(system, excitation), excitation.stepping
    found = dict[str, Simulated]()
    for name in names:
        with clock.stage("reduced" if len(names) == 1 else f"reduced, {name}") as done, refused_growth(scene):
            found[name] = repeated(scene, system, excitation.with_stepping(made), name, steps, done)
        if names[0] == "march" or name == names[-1]:
            made = contact_step.as_made(excitation.stepping, found[names[0]].parts, omega)
    responses = {name: one.response for name, one in found.items()}
    seconds = {name: response.seconds for name, response in responses.items()}
    return Simulations(found[names[0]], seconds, agreement(responses), made)


def repeated(
    scene: Scene,
    system: System,
    excitation: Excitation,
    simulator: str,
    steps: Sequence[int] = (),
    done: Progress | None = None,
) -> Simulated:
    """By a simulator, several times as the scene says unless it takes long; the seconds are the least."""
    prepared = _prepared(system, excitation, simulator, np.asarray(steps, np.int64))
    found = prepared.run(done)
    seconds = [found.response.seconds]
    if seconds[0] <= SHORT:
        seconds += prepared.seconds(scene.simulation.repeats - 1)
    return replace(found, response=replace(completed(scene, system, found.response), seconds=min(seconds)))


def completed(scene: Scene, system: Joined[Any], response: Response) -> Response:
    """With what follows from the motion: the friction that cylinders overcome, and what the machine below bears."""
    return at_pivot(scene, booms.with_friction(Excitation.of(scene), system.contacts, response))


def agreement(found: Mapping[str, Response]) -> dict[str, float]:
    """``<a>_vs_<b>``: largest difference of displacements in m between two simulators."""
    return {
        f"{a}_vs_{b}": float(np.abs(found[a].displacement - found[b].displacement).max())
        for a, b in combinations(found, 2)
    }


@contextmanager
def refused_growth(scene: Scene) -> Iterator[None]:
    """Within, a motion of the reduced model that grows without bound is the scene's mistake, which a user can mend.

    Raises InputError with the key, `time.step` or `time.rho_inf`.
    """
    try:
        yield
    except GrowthError as error:
        raise error.refusal(scene.time.step, scene.time.rho_inf) from None


def check_installed(scene: Scene) -> None:
    """Refuse before the work what a scene's simulators need and isn't there.

    Raises InputError with the package and the command that installs it.
    """
    names = [*scene.simulation.simulators, *(["exudyn"] if "ancf" in scene.compare.against else [])]
    if "full" in scene.compare.against and scene.simulation.full != "auto":
        names.append(scene.simulation.full)
    for package in {SIMULATORS[name].package for name in names} - {None}:
        environment.check_installed(str(package))


def quantities(scene: Scene, response: Response) -> Mapping[str, compare.Quantity]:
    """What is compared between responses, of which this is one."""
    if ALONE not in scene.bodies:
        return booms.quantities(Excitation.of(scene), response)
    tips = len(transverse(member_at(scene)))
    return compare.quantities_of(tips, slice(None) if scene.observe.stations is None else slice(-tips))


def full_simulator(scene: Scene, size: int) -> str:
    """Which simulator takes a full model of `size` coordinates: the one that the scene names, or the fastest."""
    if scene.simulation.full != "auto":
        return scene.simulation.full
    return "march" if size <= (MARCHED_UP_TO if len(scene.bodies) == 1 else SECTIONS_MARCHED_UP_TO) else "petsc"


@dataclass(frozen=True)
class Prepared:
    """A simulation, with all that repeating it needs made once."""

    run: Callable[[Progress | None], Simulated]
    seconds: Callable[[int], list[float]]  # of the solver alone, so many times: outputs are evaluated once


def _prepared(system: System, excitation: Excitation, simulator: str, steps: Indices) -> Prepared:
    """What simulates, with all that every simulation of the system under the excitation needs made once."""
    if ALONE in system.bodies and not system.terms:
        body, on_slider = system.bodies[ALONE], excitation.on_slider
        return (_marched if simulator == "march" else _in_exudyn(simulator))(body, on_slider, steps)
    start = systems.start_of(system, excitation)

    def again(count: int) -> list[float]:
        if simulator == "march":
            return systems.seconds(SystemForm.of(system), excitation, start, count) if count else []
        formulation = exudyn.FORMULATIONS[simulator]
        return [exudyn.simulate_system(system, excitation, start, None, formulation).seconds for _ in range(count)]

    def run(done: Progress | None) -> Simulated:
        if simulator == "march":
            trajectory = systems.simulate(system, excitation, start, done)
        else:
            formulation = exudyn.FORMULATIONS[simulator]
            trajectory = exudyn.simulate_system(system, excitation, start, done, formulation)
        response = booms.respond(system, trajectory)
        return Simulated(response, states_of(system, trajectory, steps), trajectory.parts, trajectory)

    return Prepared(run, again)


def _marched(body: SlidingBody, excitation: Excitation, steps: Indices) -> Prepared:
    """In modal coordinates throughout, of which the steps alone are kept: a response does not depend on them."""
    form, f = modal_form(body), excitation.forces(body.input_names)
    alone = SystemForm.alone(form)
    start = systems.start_of(alone.system, excitation)

    def run(done: Progress | None) -> Simulated:
        evaluation, recorder = Evaluation(form.body, excitation.times, excitation.path_rate, f), Recorder(steps)
        parts = np.ones(len(excitation.times), np.int64)

        def take(block: Block) -> None:
            evaluation(block)
            if block.part.parts is not None:
                parts[block.first : block.first + len(block.part.t)] = block.part.parts
            if len(steps):
                recorder(block)

        ended = march.follow_form(alone, excitation, take, progress=done)
        states = dict[str, BodyStates]()
        if len(steps):
            kept = march.in_coordinates(body, form, recorder.trajectory(ended), f[steps])
            states[ALONE] = BodyStates.along_path(body, kept, f[steps])
        return Simulated(evaluation.response(ended), states, parts, None)

    return Prepared(run, lambda count: systems.seconds(alone, excitation, start, count) if count else [])


def _in_exudyn(name: str) -> Callable[[SlidingBody, Excitation, Indices], Prepared]:
    def prepared(body: SlidingBody, excitation: Excitation, steps: Indices) -> Prepared:
        f, formulation = excitation.forces(body.input_names), exudyn.FORMULATIONS[name]

        def run(done: Progress | None) -> Simulated:
            kept = exudyn.simulate(body, excitation, progress=done, formulation=formulation)
            states = {ALONE: BodyStates.along_path(body, kept.at(steps), f[steps])}
            return Simulated(respond(body, kept, excitation.path_rate, f), states, kept.parts, None)

        def again(count: int) -> list[float]:
            return [exudyn.simulate(body, excitation, formulation=formulation).seconds for _ in range(count)]

        return Prepared(run, again)

    return prepared
