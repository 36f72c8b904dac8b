"""A saved system under a scene: what `pmr run` says of it, less what needs the full model."""

from __future__ import annotations

from typing import Any

import numpy as np

from pmr.compare import boom_figures as figures
from pmr.compare import pad_forces
from pmr.compare.boom_runs import SteppedBoom
from pmr.compare.booms import with_friction
from pmr.compare.estimated import reduction_error, step_part
from pmr.compare.frequencies import frequency_part, reduced_frequencies
from pmr.compare.halved_steps import SteppedBody
from pmr.compare.pivot import at_pivot
from pmr.compare.responses import check_installed, simulate
from pmr.compare.simulated import driven_by, simulate_sections
from pmr.compare.summary import Part, combined, contact, origin, pads, reliability, sampling, simulated, theory
from pmr.errors.environment import Clock
from pmr.results import BodyResult, Frequencies, Loads, Paths, Response, RunResult, Shapes
from pmr.scene import Scene
from pmr.scene.choice import transverse
from pmr.scene.members import member_at
from pmr.simulation import Excitation, contact_step
from pmr.simulation.contact_step import contact_frequency
from pmr.simulation.excitation import places
from pmr.simulation.modal import modal_form
from pmr.system.assembly import Assembly
from pmr.system.contacts import ALONE
from pmr.system.system import System

#: Frequencies, and places along the path at which they are found.
FREQUENCIES, POSITIONS = 6, 11
#: Why there is no estimate for a boom of several sections.
NO_ESTIMATE = "the file of a boom has its sections as they are simulated, without the modes that tell it"


def simulate_saved(system: System, scene: Any) -> RunResult:
    """Simulate a system under another scene's paths, loads and time stepping, by the simulators that it names.

    There are no errors in the result but what is estimated without the full model, and no singular values.  Raises
    InputError if the scene describes other bodies or joints than the system's, loads and inputs differ, a path leaves
    the system's, or a simulator can't do what is asked;
    SimulationError if a step fails.
    """
    check_installed(scene)
    excitation = driven_by(scene, system)
    return (_alone if ALONE in system.bodies else _sections)(system, scene, excitation)


def _figures(system: System, response: Response, simulator: str) -> Part:
    """What was simulated, and how far it moves."""
    made = {name: system.provenance.get(name) for name in ("scene_hash", "basis", "versions")}
    return Part(
        {
            "model": made,
            "max_displacement": float(np.abs(response.displacement).max()),
            "coordinates": {"reduced": sum(body.size for body in system.bodies.values())},
            "simulators": {"reduced": simulator},
        }
    )


def _sections(system: System, boom: Scene, excitation: Excitation) -> RunResult:
    """Of a boom of several sections, which starts in equilibrium."""
    clock, x, omega = Clock(), places(system, excitation), contact_frequency(system, excitation)
    found = simulate_sections(boom, system, excitation, clock)
    made = contact_step.as_made(excitation.stepping, found.first.parts, omega)
    response = at_pivot(boom, with_friction(boom, system.contacts, found.response))
    steps, reach = figures.on_the_way(boom, excitation.times, figures.PLACES), boom.reach(excitation.times)
    curves = {"reduced": Assembly(system).frequencies(x[steps], figures.CURVES)}
    frequencies = Frequencies(reach[steps], excitation.s[steps], curves, figures.frequency_map(boom, system))
    in_frequency = figures.in_frequency(boom, system, excitation)
    responses, sizes = {"reduced": response}, {name: {"reduced": one.size} for name, one in system.bodies.items()}
    parts = [
        origin(boom),
        _figures(system, response, boom.simulation.simulators[0]),
        simulated(found.seconds, found.agreement, {}),
        figures.sections(boom, responses, sizes, {}),
        Part({"estimate": {"tip": None, "beam": None, "reason": NO_ESTIMATE}}),
        step_part(SteppedBoom(boom, system, excitation), curves["reduced"], clock, boom.accuracy is not None),
        figures.joints(boom, response, system),
        Part(pad_forces.reactions(boom, response, reach), pad_forces.missing(boom)),
        figures.beside_published(boom, frequencies),
        frequency_part(in_frequency),
        sampling(excitation),
        Part(contact_step.summary_of(omega, made), contact_step.warnings_of(omega, excitation.stepping)),
        reliability({}, responses),
        theory(boom, responses),
    ]
    return RunResult(
        boom,
        combined(parts),
        responses,
        Paths(tuple(excitation.paths), excitation.s, excitation.rates),
        Loads(system.input_names, system.input_units, excitation.forces(system.input_names)),
        frequencies,
        {name: BodyResult() for name in boom.names},
        reach,
        in_frequency,
    )


def _alone(system: System, scene: Scene, excitation: Excitation) -> RunResult:
    """Of one body on one path."""
    reduced: Any = system.bodies[ALONE]
    clock = Clock()
    simulations = simulate(scene, reduced, clock)
    response = simulations.responses["reduced"]
    s = np.unique(np.linspace(excitation.s.min(), excitation.s.max(), POSITIONS))
    found = reduced_frequencies(reduced, s, min(FREQUENCIES, reduced.size))
    stepped = SteppedBody(modal_form(reduced), excitation, len(transverse(member_at(scene))))
    estimated = reduction_error(scene, reduced, clock)
    parts = [
        origin(scene),
        _figures(system, response, simulations.first),
        simulated(simulations.seconds, simulations.agreement, {}),
        sampling(excitation),
        estimated.part,
        step_part(stepped, found, clock, scene.accuracy is not None),
        pads(scene, response),
        contact(reduced, excitation),
        reliability({}, simulations.responses),
    ]
    shapes = Shapes(np.zeros(0), reduced.output_positions, reduced.outputs)
    return RunResult(
        scene,
        combined(parts),
        simulations.responses,
        Paths(tuple(excitation.paths), excitation.s, excitation.rates),
        Loads(reduced.input_names, reduced.input_units, excitation.forces(reduced.input_names)),
        Frequencies(s, s[:, None], {"reduced": found}),
        {ALONE: BodyResult(shapes)},
        tip_error=estimated.band,
    )
