"""Simulations of a scene: the reduced model by one simulator or several, and the references it asks for."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pmr.compare import cable
from pmr.compare import errors as compare
from pmr.compare.evaluation import Evaluation, respond
from pmr.compare.made_for import check_made_for
from pmr.errors import GrowthError, environment
from pmr.errors.environment import Clock
from pmr.reduced.model import ReducedModel
from pmr.results import Response
from pmr.scene import Scene
from pmr.scene.choice import transverse
from pmr.scene.members import member_at
from pmr.scene.simulators import SIMULATORS
from pmr.simulation import Excitation, TimeStepping, contact_step, exudyn
from pmr.simulation.blocks import Block, Recorder
from pmr.simulation.modal import modal_form
from pmr.simulation.native import simulator as march
from pmr.system.body import FullBody, SlidingBody, Trajectory
from pmr.system.system import System

if TYPE_CHECKING:
    from pmr.simulation.exudyn import Formulation

Array = NDArray[np.float64]
Done = Callable[[float], None]
Indices = NDArray[np.int64]
Simulate = Callable[["Done | None", Indices], "Simulated"]
#: What every simulation of a body under an excitation needs is made once.
Prepare = Callable[[Excitation, SlidingBody], Simulate]

#: A full model of more coordinates than this goes through PETSc, for diagonalising costs more.  Exudyn factorises in
#: every step: 453 coordinates take it twice as long as PETSc, and from some 900 on Newton's method may not converge.
MARCHED_UP_TO = 400
#: The same of several sections, which are diagonalised one by one.
SECTIONS_MARCHED_UP_TO = 1200
#: s: what takes no longer is simulated several times, since the first one may be cold.
SHORT = 0.2


@dataclass(frozen=True)
class Simulated:
    """What a simulation says, and its states at the steps that were asked for, None where there were none."""

    response: Response
    states: Trajectory | None
    parts: Indices | None = None  # (T,): of how many parts each step was made


@dataclass(frozen=True)
class Simulations:
    """What the simulators say."""

    responses: Mapping[str, Response]  # ``reduced``, by the `first` simulator
    seconds: Mapping[str, float]  # of each simulator's solver, the least of its repeats
    agreement: Mapping[str, float]  # of the simulators of the reduced model, m
    first: str  # that the scene names
    made: TimeStepping  # the time grid, with the parts that it made each step in where rows only push
    states: Trajectory | None = None  # what it says at the steps whose states were asked for


def simulate(
    scene: Scene,
    reduced: ReducedModel,
    clock: Clock | None = None,
    steps: Sequence[int] = (),
) -> Simulations:
    """Simulate the reduced model by every simulator that the scene names.

    Exudyn makes each step in the parts that the compiled simulator before it chose.  States of the first one are kept
    at the `steps`, ascending numbers.
    """
    clock, first = clock or Clock(), scene.simulation.simulators[0]
    made, simulated = Excitation.of(scene).stepping, dict[str, Simulated]()
    for name in scene.simulation.simulators:
        label = "reduced" if len(scene.simulation.simulators) == 1 else f"reduced, {name}"
        with clock.stage(label), refused_growth(scene):
            simulated[name] = _repeated(scene, reduced, name, steps=steps, made=made)
        if (name, first) == ("march", "march"):
            omega = contact_step.contact_frequency(System.of(reduced), Excitation.of(scene))
            made = contact_step.as_made(made, simulated[name].parts, omega)
    found: dict[str, Response] = {name: one.response for name, one in simulated.items()}
    seconds = {name: response.seconds for name, response in found.items()}
    return Simulations({"reduced": found[first]}, seconds, agreement(found), first, made, simulated[first].states)


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


def simulate_reduced(scene: Scene, reduced: ReducedModel) -> Response:
    """Response of a reduced model to the scene's path and loads, by the first simulator that the scene names.

    Its seconds are the least of several simulations, if these are short.

    Raises
    ------
    InputError
        If the scene describes another body than the model's, or loads that act elsewhere.
    """
    check_made_for(reduced, scene)
    return simulate_with_states(scene, reduced, ()).response


def simulate_with_states(scene: Scene, reduced: ReducedModel, steps: Sequence[int]) -> Simulated:
    """The same with the states at the `steps`, ascending numbers."""
    with Clock().stage("reduced"), refused_growth(scene):
        return _repeated(scene, reduced, scene.simulation.simulators[0], longest=SHORT, steps=steps)


def simulate_reference(
    name: str,
    scene: Scene,
    full: FullBody,
    clock: Clock | None = None,
    steps: Sequence[int] = (),
    made: TimeStepping | None = None,
) -> Simulated:
    """Response of ``"full"``, by a simulator that is not distributed, or of ``"ancf"``, which has no states."""
    with (clock or Clock()).stage(name) as done:
        if name == "ancf":
            return Simulated(cable.response(scene, full.output_positions, done), None)
        return _repeated(scene, full, full_simulator(scene, full.size), done, SHORT, steps, made)


def check_installed(scene: Scene) -> None:
    """Refuse before the work what a scene's simulators need and isn't there.

    Raises InputError with the package and the command that installs it.
    """
    names = [*scene.simulation.simulators, *(["exudyn"] if "ancf" in scene.compare.against else [])]
    if "full" in scene.compare.against and scene.simulation.full != "auto":
        names.append(scene.simulation.full)
    for package in {SIMULATORS[name].package for name in names} - {None}:
        environment.check_installed(str(package))


def quantities(scene: Scene) -> Mapping[str, compare.Quantity]:
    """What is compared between responses."""
    tips = len(transverse(member_at(scene)))
    return compare.quantities_of(tips, slice(None) if scene.observe.stations is None else slice(-tips))


def full_simulator(scene: Scene, size: int) -> str:
    """Which simulator takes a full model of `size` coordinates: the one that the scene names, or the fastest."""
    if scene.simulation.full != "auto":
        return scene.simulation.full
    return "march" if size <= (MARCHED_UP_TO if len(scene.bodies) == 1 else SECTIONS_MARCHED_UP_TO) else "petsc"


def _repeated(
    scene: Scene,
    body: SlidingBody,
    simulator: str,
    done: Done | None = None,
    longest: float = np.inf,
    steps: Sequence[int] = (),
    made: TimeStepping | None = None,
) -> Simulated:
    """A response, of several simulations unless the first takes longer than `longest`; its seconds are the least."""
    excitation = Excitation.of(scene)
    excitation = excitation.with_stepping(made or excitation.stepping)
    simulate, found, seconds = _PREPARED[simulator](excitation, body), None, list[float]()
    while found is None or (len(seconds) < scene.simulation.repeats and seconds[0] <= longest):
        found = None  # two of them at once would take twice the memory
        found = simulate(None if seconds else done, np.asarray(steps, np.int64))
        seconds.append(found.response.seconds)
    return replace(found, response=replace(found.response, seconds=min(seconds)))


def _in_exudyn(formulation: Formulation) -> Prepare:
    def prepared(excitation: Excitation, body: SlidingBody) -> Simulate:
        f = excitation.forces(body.input_names)

        def simulate(done: Done | None, steps: Indices) -> Simulated:
            trajectory = exudyn.simulate(body, excitation, progress=done, formulation=formulation)
            found = respond(body, trajectory, excitation.path_rate, f)
            return Simulated(found, trajectory.at(steps) if len(steps) else None, trajectory.parts)

        return simulate

    return prepared


def _in_march(excitation: Excitation, body: SlidingBody) -> Simulate:
    """In modal coordinates throughout, of which the steps alone are kept: a response does not depend on them."""
    form, f = modal_form(body), excitation.forces(body.input_names)

    def simulate(done: Done | None, steps: Indices) -> Simulated:
        evaluation, recorder = Evaluation(form.body, excitation.times, excitation.path_rate, f), Recorder(steps)
        parts = np.ones(len(excitation.times), np.int64)

        def take(block: Block) -> None:
            evaluation(block)
            if block.part.parts is not None:
                parts[block.first : block.first + len(block.part.t)] = block.part.parts
            if len(steps):
                recorder(block)

        ended = march.follow(form, excitation, take, progress=done)
        states = march.in_coordinates(body, form, recorder.trajectory(ended), f[steps]) if len(steps) else None
        return Simulated(evaluation.response(ended), states, parts)

    return simulate


_PREPARED: dict[str, Prepare] = {
    "march": _in_march,
    **{name: _in_exudyn(formulation) for name, formulation in exudyn.FORMULATIONS.items()},
}
