"""Responses of systems: simulation by the simulators of a scene, evaluation of motions, and memory they take."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from pmr.compare.errors import ResponseFunction, observed_quantities
from pmr.compare.evaluation import Evaluation, SimulatedSystem, append_machine, evaluate_motion
from pmr.compare.outputs import boom_quantities, fits_in_memory
from pmr.errors import GrowthError, InputError, environment
from pmr.errors.environment import Clock, import_package
from pmr.files.arrays import Array, Indices
from pmr.results import Response
from pmr.scene import Scene
from pmr.scene.built import force_name
from pmr.scene.choice import SIMULATORS, observed_places, transverse_axes
from pmr.scene.keys import ALONE, SLIDER
from pmr.scene.members import member_at
from pmr.simulation import Excitation, Progress, TimeStepping, contact_step, exudyn
from pmr.simulation.native import systems
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.systems import March
from pmr.simulation.reactions import with_forces_on_machine
from pmr.simulation.stepping import Recorder
from pmr.system.body import Body, kinds_of, names_of, units_of
from pmr.system.reduced_model import ReducedModel
from pmr.system.states import BodyStates, SystemTrajectory, states_of
from pmr.system.system import System

if TYPE_CHECKING:
    from pmr.simulation.exudyn import ancf

#: A full model with more coordinates than this is simulated by PETSc, because diagonalising it would take longer.
#: Exudyn factorises in every step: 453 coordinates take it twice as long as PETSc, and from some 900 on Newton's method
#: may not converge.
MARCHED_UP_TO = 400
#: Largest number of coordinates of full models of several sections that ``march`` simulates, diagonalised one by one.
SECTIONS_MARCHED_UP_TO = 1200
#: Seconds: shorter simulations are repeated to measure their time, since caches are empty in the first run.
SHORT = 0.1


@dataclass(frozen=True)
class Simulation:
    """Response of one simulation, with the states that were recorded."""

    response: Response
    states: Mapping[str, BodyStates]  # by name of the body, at the steps that were asked for
    parts: Indices | None  # (T,): number of parts of each step; None if not known
    run: SystemTrajectory | None  # motion at all steps; None if it was not kept
    own_response: Response  # the response of the system alone, without forces and motions of the scene's machine
    loads: Array  # (T, i): values of the inputs `System.input_names`; those of a hoist's rope are its pulls


@dataclass(frozen=True)
class Simulations:
    """Responses and solver times of all simulators of a scene."""

    first: Simulation  # by the first simulator in the scene
    seconds: Mapping[str, float]  # solver time by simulator, in the order of the scene
    agreement: Mapping[str, float]  # m: largest difference of displacements between two simulators, by pair
    time_grid: TimeStepping  # with the first simulation's parts of each step if contacts only push
    contact_frequency: float  # rad/s: largest one of contacts that only push (`pmr.simulation.contact_step`)
    form: SystemForm | None  # of the system; None: the compiled simulator did not simulate it

    def simulated_system(self, system: System, excitation: Excitation) -> SimulatedSystem:
        """The system under the excitation, with the motion and response of the first simulator if it kept the motion.

        With a motion, the excitation has the times of that simulator, which may have divided steps into parts; without
        one, it is unchanged.
        """
        if self.first.run is None:
            return SimulatedSystem(system, excitation, form=self.form)
        stepped = excitation.with_stepping(self.time_grid)
        return SimulatedSystem(system, stepped, self.first.run, self.first.own_response, self.form)


def simulate(
    scene: Scene, system: System, excitation: Excitation, clock: Clock | None = None, steps: Sequence[int] = ()
) -> Simulations:
    """Simulate a reduced system by each simulator of the scene, as `simulate_by` does; record states at the `steps`.

    The numbers of `steps` count from 0.  The response and states are those of the first simulator; for the others, the
    solver times and the differences in displacements are returned.  If contacts only push, and the compiled simulator
    ran first, Exudyn divides each step into the same parts.  Each simulation is a stage of `clock`; None measures
    nothing.

    Raises InputError, with the key to change, if the motion grows without bound.
    """
    clock, names = clock or Clock(), scene.simulation.simulators
    omega, stepping = contact_step.contact_frequency(system, excitation), excitation.stepping
    results, form = dict[str, Simulation](), SystemForm.of(system) if "march" in names else None
    for name in names:
        with clock.stage("reduced" if len(names) == 1 else f"reduced, {name}") as done, refuse_growth(scene):
            result = simulate_by(scene, form or system, excitation.with_stepping(stepping), name, steps, done)
            results[name] = replace(result, response=append_machine(scene, result.response))
        if names[0] == "march" or name == names[-1]:
            stepping = contact_step.with_schedule(excitation.stepping, results[names[0]].parts, omega)
    responses = {name: simulation.response for name, simulation in results.items()}
    seconds = {name: response.seconds for name, response in responses.items()}
    return Simulations(results[names[0]], seconds, agreement(responses), stepping, omega, form)


def simulate_by(
    scene: Scene,
    system: System | SystemForm,
    excitation: Excitation,
    simulator: str,
    steps: Sequence[int] = (),
    done: Progress | None = None,
) -> Simulation:
    """Simulate by one simulator and record states at the `steps`.

    Short simulations are repeated as the scene says, and the shortest solver time is reported.  The response has the
    forces on the scene's machine, but not its motion (`pmr.compare.evaluation.append_machine`).  The compiled simulator
    keeps the motion of reduced bodies at all steps; that of a single body without terms, only if it fits in memory
    (`fits_in_memory`).  `done`, if not None, is called with the share of the run that is done.
    """
    numbers, repeats = np.asarray(steps, np.int64), scene.simulation.repeats
    if simulator == "march":
        form = SystemForm.of(system)
        reduced = all(isinstance(body, ReducedModel) for body in form.system.bodies.values())
        every = reduced and (not _is_alone(form.system) or fits_in_memory(form.system, excitation.stepping))
        recorded_steps = np.arange(len(excitation.times)) if every else numbers
        result = _march(form, excitation, numbers, recorded_steps, repeats, done)
    else:
        system = system.system if isinstance(system, SystemForm) else system
        result = _simulate_by_exudyn(system, excitation, simulator, numbers, repeats, done)
    return replace(result, response=with_forces_on_machine(scene, result.own_response))


def march_once(scene: Scene, system: System | SystemForm, excitation: Excitation) -> Response:
    """Response by the compiled simulator, simulated once, with the forces on the scene's machine.

    States are not recorded.  Simulations of the same `SystemForm` share its tables.
    """
    nothing = np.empty(0, np.int64)
    return with_forces_on_machine(scene, _march(SystemForm.of(system), excitation, nothing, nothing).response)


def agreement(responses: Mapping[str, Response]) -> dict[str, float]:
    """Largest difference in m, at any time, between the displacements of two simulators, by ``<a>_vs_<b>``.

    `responses` are the responses by simulator; each pair of them has one entry.
    """
    return {
        f"{a}_vs_{b}": float(np.abs(responses[a].displacement - responses[b].displacement).max())
        for a, b in combinations(responses, 2)
    }


@contextmanager
def refuse_growth(scene: Scene) -> Iterator[None]:
    """Context in which a motion that grows without bound raises an InputError for the user.

    The motion is that of the reduced model.  The error names the key to change, `time.step` or `time.rho_inf`.
    """
    try:
        yield
    except GrowthError as error:
        raise error.refusal(scene.time.step, scene.time.rho_inf) from None


def check_installed(scene: Scene) -> None:
    """Raise an InputError if a package that a simulator of the scene needs is not installed.

    Simulators of the full model and of the ANCF cable count, too.  The error names the package and the command that
    installs it.
    """
    names = [*scene.simulation.simulators, *(["exudyn"] if "ancf" in scene.compare.against else [])]
    if "full" in scene.compare.against and scene.simulation.full != "auto":
        names.append(scene.simulation.full)
    for package in {SIMULATORS[name].package for name in names} - {None}:
        environment.check_installed(str(package))


def compared_quantities(scene: Scene, response: Response) -> Mapping[str, ResponseFunction]:
    """Functions of a response, by name, each of which returns a quantity to be compared for this scene.

    The functions fit responses like `response`.  These functions are `observed_quantities` for a single body and
    `boom_quantities` for a boom.
    """
    if ALONE not in scene.bodies:
        return boom_quantities(Excitation.from_scene(scene), response)
    tips, places = len(transverse_axes(member_at(scene))), observed_places(member_at(scene))
    return observed_quantities(tips, slice(None) if places is None else slice(-tips))


def full_simulator(scene: Scene, size: int) -> str:
    """Name of the simulator for a full model of `size` coordinates: that of the scene, or by default the fastest.

    With a hoist it is by default ``march``.  `size` is that of all bodies together.
    """
    if scene.simulation.full != "auto":
        return scene.simulation.full
    if scene.hoist is not None:
        return "march"  # which alone follows its payload
    return "march" if size <= (MARCHED_UP_TO if len(scene.bodies) == 1 else SECTIONS_MARCHED_UP_TO) else "petsc"


def _simulate_by_exudyn(
    system: System, excitation: Excitation, simulator: str, steps: Indices, repeats: int, done: Progress | None
) -> Simulation:
    """Simulate by Exudyn, evaluate the response, and record states at the `steps` (k,).

    `simulator` is the name of a formulation.  The wall time is the least of `repeats` runs, and `done`, if it is not
    None, is called with the share of the first run that is done.  The motion at all steps is kept, too, unless the
    system is a single body without terms.
    """
    start, formulation = systems.start_of(system, excitation), exudyn.FORMULATIONS[simulator]
    trajectory = exudyn.simulate_system(system, excitation, start, done, formulation)
    response = _with_shortest_time(
        evaluate_motion(system, trajectory),
        repeats,
        lambda: exudyn.simulate_system(system, excitation, start, None, formulation).seconds,
    )
    states, recorded_run = states_of(system, trajectory, steps), None if _is_alone(system) else trajectory
    loads = excitation.forces(system.input_names)  # Exudyn knows no hoist
    return Simulation(response, states, trajectory.parts, recorded_run, response, loads)


def _is_alone(system: System) -> bool:
    """Whether a system is a single body without terms."""
    return ALONE in system.bodies and not system.terms


def _march(
    form: SystemForm,
    excitation: Excitation,
    steps: Indices,
    recorded_steps: Indices,
    repeats: int = 1,
    done: Progress | None = None,
) -> Simulation:
    """Simulate by the compiled simulator (``march``), and evaluate the response block by block.

    The motion is kept at the `recorded_steps` (r,).  States are returned at the `steps` (k,), all of which are
    recorded.  A short simulation is made `repeats` times, and the shortest time counts.  `done`, if not None, is called
    with the share of the run that is done.
    """
    system = form.system
    march, f = March(form, excitation), excitation.forces(system.input_names)
    every = len(recorded_steps) == len(excitation.times)
    evaluation, recorder = Evaluation(system, excitation.times, f), Recorder(recorded_steps)
    parts, loads = np.ones(len(excitation.times), np.int64), f.copy() if system.hoist else f

    def take(first: int, part: SystemTrajectory) -> None:
        """Evaluate consecutive steps from the one with the number `first` on, and record their states and parts."""
        evaluation(first, part)
        rows = slice(first, first + len(part.t))
        parts[rows] = part.parts
        if system.hoist:  # `f` has the hanging weight, and the motion the rope's pulls
            loads[rows] = part.loads
        recorder(first, part)

    ended = systems.follow(march, take, done)
    trajectory = recorder.trajectory(ended)
    states = states_of(system, trajectory, steps if every else np.arange(len(recorded_steps)))
    response = _with_shortest_time(evaluation.response(ended), repeats, march.rerun)
    return Simulation(response, states, parts, trajectory if every else None, response, loads)


def _with_shortest_time(response: Response, repeats: int, rerun: Callable[[], float]) -> Response:
    """The response with the shortest solver time in s of `repeats` simulations, the one of the response included.

    `rerun` simulates once more and returns the solver time; it is not called if the simulation took more than `SHORT`.
    """
    more = repeats - 1 if response.seconds <= SHORT else 0
    return replace(response, seconds=min([response.seconds, *(rerun() for _ in range(more))]))


_log = logging.getLogger(__name__)

#: Number of arrays (T, n) of states, n coordinates at T steps, that exist at once: if Exudyn simulates, which keeps all
#: states; and if the error of a reduced model is estimated by two richer models.  ``march`` keeps the states of several
#: full bodies, but not those of a single one.
ARRAYS_OF_STATES = 4
#: Number of arrays (T, o) of o outputs that exist at once in addition to the responses: if the error of the reduction
#: is estimated; and if it is not.  Measured with two responses: 6.9 kB a step for 66 outputs and 10 coordinates, by
#: this formula 7.5; 1.7 kB for 51 outputs, by this formula 2.3.
ESTIMATED, COMPARED = 10, 2
#: Count of numbers that each response has for a step in addition to its outputs.
NUMBERS_BESIDE = 12
BYTES = 8  # bytes of a number
NOTABLE_BYTES = 2**30  # bytes: there is a warning if histories take more


def needed_bytes(scene: Scene, size: int, outputs: int) -> int:
    """Largest memory in bytes that the histories of all steps take at once.

    `size` is the number of coordinates, and `outputs` the number of outputs, of all full models together.
    """
    bodies, full = scene.bodies.values(), full_simulator(scene, size)
    r, several = sum(body.reduction.coordinates for body in bodies), len(bodies) > 1
    responses = len(scene.compare.against) + len(scene.simulation.simulators) + 1  # 1 is for a repeated one
    responses += 2 * (scene.compare.richer not in ("auto", "none"))
    keeping = [r] if several or any(name != "march" for name in scene.simulation.simulators) else []
    if "full" in scene.compare.against and (full == "exudyn" or (several and full == "march")):
        keeping.append(size)
    estimated = all(body.reduction.estimable for body in bodies)
    states = max([*keeping, r if estimated else 0])
    a_step = responses * (outputs + NUMBERS_BESIDE) + ARRAYS_OF_STATES * states
    a_step += (ESTIMATED if estimated else COMPARED) * outputs
    return BYTES * (scene.time.steps + 1) * a_step


def memory_warnings(scene: Scene, size: int, outputs: int) -> list[str]:
    """List a warning if the histories of a run take more than `NOTABLE_BYTES`; empty otherwise.

    `size` is the number of coordinates, and `outputs` the number of outputs, of all full models together.
    """
    total = needed_bytes(scene, size, outputs)
    return [] if total < NOTABLE_BYTES else [f"{scene.time.steps:,} steps take about {total / 1e9:.1f} GB of memory"]


def check_memory(scene: Scene, size: int, outputs: int, free: int | None, tell: bool = True) -> None:
    """Raise an InputError, with the number of steps that fits, if histories do not fit into `free` bytes of memory.

    Histories of less than `NOTABLE_BYTES` are not checked, and all others fit if `free` is None (unknown).  If `tell`
    is true, the warning of `memory_warnings` is logged for those that fit.  `size` is the number of coordinates, and
    `outputs` the number of outputs, of all full models together.
    """
    for message in memory_warnings(scene, size, outputs):
        total = needed_bytes(scene, size, outputs)
        if free is not None and total > free:
            fitting = scene.time.steps * free // total
            allowed = f"{message}, {free / 1e9:.1f} GB are free; at most about {fitting:,} steps are allowed"
            raise InputError("scene", "time.step", scene.time.step, allowed)
        if tell:
            _log.warning("%s", message)


def _cable(scene: Scene) -> ancf.Cable:
    """The scene's beam as an ANCF cable; raises InputError if Exudyn is not installed."""
    import_package("exudyn")
    from pmr.simulation.exudyn import ancf

    profile = scene.body.profile
    assert profile is not None and profile.axial_stiffness is not None  # the scene's check
    return ancf.Cable(
        length=profile.length,
        axial_stiffness=profile.axial_stiffness,
        bending_stiffness=profile.bending_stiffness,
        mass_per_length=profile.mass_per_length,
        elements=scene.compare.ancf_elements,
    )


def simulate_cable(
    scene: Scene, x: ArrayLike, excitation: Excitation, done: Progress | None = None
) -> ancf.CableMotion:
    """Motion of the scene's beam, modelled as an ANCF cable, at the material points x (o,) in m.

    `done`, if not None, is called with the share of the run that is done.  Raises InputError if Exudyn is not
    installed, and whenever `pmr.simulation.exudyn.ancf.simulate` does; SimulationError if a step fails or a result is
    not finite.
    """
    cable = _cable(scene)
    from pmr.simulation.exudyn import ancf

    part = scene.only_section
    places = {load.name: part.position_of(load.on) for load in part.loads}
    on_axis = {name: at for name, at in places.items() if at is not None}  # loads on groups of a mesh file are left out
    return ancf.simulate(cable, on_axis, excitation, np.asarray(x, dtype=float), done)


def cable_response(scene: Scene, body: Body, done: Progress | None) -> Response:
    """Response of the scene's beam as an ANCF cable, a reference for its `body`, with the outputs of this body.

    The joint of the cable holds a point in space, so the cable has no rows, and the residuals of rows are NaN.  `done`,
    if not None, is called with the share of the run that is done.  Errors are those of `simulate_cable`.
    """
    motion = simulate_cable(scene, body.output_positions, Excitation.from_scene(scene), done)
    from pmr.simulation.exudyn import ancf

    unknown = np.full(len(motion.t), np.nan)
    return Response(
        t=motion.t,
        x=motion.x,
        displacement=motion.displacement,
        energy=ancf.energy(_cable(scene), motion),
        slider_force=motion.slider_force[:, None],
        residual_position=unknown,
        residual_velocity=unknown,
        seconds=motion.seconds,
        output_names=names_of(body),
        output_units=units_of(body),
        force_names=(force_name(SLIDER),),
        kinds=(*kinds_of(body), "pad"),
        bodies=(ALONE,) * (len(motion.x) + 1),
    )
