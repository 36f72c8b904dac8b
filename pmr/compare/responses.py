"""How a system moves under a scene by the simulators that it names, and what it then says; FEniCSx is not needed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from pmr.compare import booms
from pmr.compare import errors as compare
from pmr.compare.evaluation import Evaluation, respond
from pmr.compare.machine import with_machine
from pmr.compare.runs import is_recorded
from pmr.errors import GrowthError, environment
from pmr.errors.environment import Clock
from pmr.reduced.model import ReducedModel
from pmr.results import Response
from pmr.scene import Scene
from pmr.scene.choice import SIMULATORS, transverse
from pmr.scene.keys import ALONE
from pmr.scene.members import member_at
from pmr.simulation import Excitation, TimeStepping, contact_step, exudyn
from pmr.simulation.native import systems
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.march import March
from pmr.simulation.reactions import with_forces_on_machine
from pmr.simulation.stepping import Block, Progress, Recorder
from pmr.system.states import BodyStates, SystemTrajectory, states_of
from pmr.system.system import System

Indices = NDArray[np.int64]

#: A full model of more coordinates than this goes through PETSc, for diagonalising costs more.  Exudyn factorises in
#: every step: 453 coordinates take it twice as long as PETSc, and from some 900 on Newton's method may not converge.
MARCHED_UP_TO = 400
#: The same of several sections, which are diagonalised one by one.
SECTIONS_MARCHED_UP_TO = 1200
#: s: what takes no longer is simulated several times, since the first one may be cold.
SHORT = 0.1


@dataclass(frozen=True)
class Simulated:
    """Response of one simulation, with the states that were recorded."""

    response: Response
    states: Mapping[str, BodyStates]  # of each body at the steps that were asked for
    parts: Indices | None  # (T,): of how many parts each step was made
    run: SystemTrajectory | None  # of reduced bodies, whose states are all kept where these are not too many
    own: Response  # the response without what scenes have beside the system


@dataclass(frozen=True)
class Simulations:
    """Responses and solver times of all simulators of a scene."""

    first: Simulated  # by the one that the scene names first
    seconds: Mapping[str, float]  # of each simulator's solver, the first one's first
    agreement: Mapping[str, float]  # of each two of them, m
    made: TimeStepping  # the time grid, with the parts that the first one made each step in where contacts only push
    again: Callable[[], Mapping[str, float]]  # the seconds once more, the least of the repeats that the scene asks for

    def with_least_seconds(self) -> Simulations:
        """Repeat short simulations and report the least solver seconds of each simulator."""
        least = self.again()
        response = replace(self.first.response, seconds=next(iter(least.values())))
        return replace(self, first=replace(self.first, response=response), seconds=least)


def simulate(
    scene: Scene, system: System, excitation: Excitation, clock: Clock | None = None, steps: Sequence[int] = ()
) -> Simulations:
    """Simulate a reduced system once by every simulator that the scene names; the first one's states at the `steps`.

    Exudyn makes each step in the parts that the compiled simulator before it chose.

    Raises an InputError where the motion grows: the scene's own model can be mended by its step.
    """
    clock, names = clock or Clock(), scene.simulation.simulators
    omega, stepping = contact_step.contact_frequency(system, excitation), excitation.stepping
    results, prepared = dict[str, Simulated](), dict[str, Prepared]()
    for name in names:
        with clock.stage("reduced" if len(names) == 1 else f"reduced, {name}") as done, refused_growth(scene):
            scheduled = excitation.with_stepping(stepping)
            prepared[name] = _prepare(system, scheduled, name, np.asarray(steps, np.int64))
            result = prepared[name].run(done)
            results[name] = replace(result, response=with_machine(scene, with_forces_on_machine(scene, result.own)))
        if names[0] == "march" or name == names[-1]:
            stepping = contact_step.as_made(excitation.stepping, results[names[0]].parts, omega)
    responses = {name: one.response for name, one in results.items()}
    seconds = {name: response.seconds for name, response in responses.items()}

    def again() -> dict[str, float]:
        return {name: one.least(seconds[name], scene.simulation.repeats) for name, one in prepared.items()}

    return Simulations(results[names[0]], seconds, agreement(responses), stepping, again)


def simulate_by(
    scene: Scene,
    system: System,
    excitation: Excitation,
    simulator: str,
    steps: Sequence[int] = (),
    done: Progress | None = None,
) -> Simulated:
    """Simulate by one simulator, repeated as the scene says unless it takes long; least seconds."""
    prepared = _prepare(system, excitation, simulator, np.asarray(steps, np.int64))
    result = prepared.run(done)
    seconds = prepared.least(result.own.seconds, scene.simulation.repeats)
    return replace(result, response=replace(with_forces_on_machine(scene, result.own), seconds=seconds))


def march_once(scene: Scene, system: System, excitation: Excitation) -> Response:
    """Response by the compiled simulator, simulated once; states are not recorded."""
    nothing = np.empty(0, np.int64)
    return with_forces_on_machine(scene, _prepare_march(system, excitation, nothing, nothing).run(None).response)


def agreement(responses: Mapping[str, Response]) -> dict[str, float]:
    """``<a>_vs_<b>``: largest difference of displacements in m between two simulators."""
    return {
        f"{a}_vs_{b}": float(np.abs(responses[a].displacement - responses[b].displacement).max())
        for a, b in combinations(responses, 2)
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
    """Quantities by name that are compared between a response like this one and others."""
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

    def least(self, first: float, repeats: int) -> float:
        """The seconds of the `first` run, or of later ones if that was short and these are shorter."""
        return min([first, *(self.seconds(repeats - 1) if first <= SHORT else [])])


def _prepare(system: System, excitation: Excitation, simulator: str, steps: Indices) -> Prepared:
    """Prepare a simulator so that repeated runs of the system under the excitation share its set-up.

    Of full bodies, and of one alone with many steps, nothing but states at the `steps` is kept.
    """
    alone = ALONE in system.bodies and not system.terms
    if simulator == "march":
        reduced = all(isinstance(body, ReducedModel) for body in system.bodies.values())
        every = reduced and (not alone or is_recorded(system, excitation.stepping))
        return _prepare_march(system, excitation, steps, np.arange(len(excitation.times)) if every else steps)
    start, formulation = systems.start_of(system, excitation), exudyn.FORMULATIONS[simulator]

    def run(done: Progress | None) -> Simulated:
        trajectory = exudyn.simulate_system(system, excitation, start, done, formulation)
        states, response = states_of(system, trajectory, steps), respond(system, trajectory)
        return Simulated(response, states, trajectory.parts, None if alone else trajectory, response)

    def again(count: int) -> list[float]:
        return [exudyn.simulate_system(system, excitation, start, None, formulation).seconds for _ in range(count)]

    return Prepared(run, again)


def _prepare_march(system: System, excitation: Excitation, steps: Indices, recorded_steps: Indices) -> Prepared:
    """Prepare the compiled simulator; response block by block, states of the `recorded_steps`."""
    form = SystemForm.of(system)
    f, every = excitation.forces(system.input_names), len(recorded_steps) == len(excitation.times)
    march = cache(lambda: March(form, excitation))

    def run(done: Progress | None) -> Simulated:
        evaluation, recorder = Evaluation(system, excitation.times, f), Recorder(recorded_steps)
        parts = np.ones(len(excitation.times), np.int64)

        def take(block: Block) -> None:
            part = block.at(slice(None))
            evaluation(block.first, part)
            parts[block.first : block.first + block.count] = part.parts
            recorder(block)

        ended = systems.follow(march(), excitation, take, done)
        trajectory = recorder.trajectory(ended)
        numbers = steps if every else np.arange(len(recorded_steps))
        response, states = evaluation.response(ended), states_of(system, trajectory, numbers)
        return Simulated(response, states, parts, trajectory if every else None, response)

    return Prepared(run, lambda count: [march().again() for _ in range(count)])
