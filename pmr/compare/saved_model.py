"""Simulation of a saved system under a scene, with those results of `pmr run` that need no full model."""

from __future__ import annotations

import numpy as np

from pmr.compare.error_parts import ReductionError, SimulatedSystem, reduction_error, step_part
from pmr.compare.frequencies import frequencies_on_way, frequency_part, response_on_way, result_paths, way_points
from pmr.compare.moving_frame import with_choice_of_terms
from pmr.compare.responses import check_installed, simulate
from pmr.compare.simulated import excitation_of_scene, with_models_of
from pmr.compare.summary import (
    origin_part,
    parts_of_motion,
    reliability_part,
    sections_part,
    simulation_part,
    theory_part,
)
from pmr.compare.trust import reduction_warnings
from pmr.errors.environment import Clock
from pmr.results import BodyResult, Loads, RunResult, Shapes
from pmr.results.run import SummaryPart, combine_parts
from pmr.scene import Scene
from pmr.scene.keys import ALONE
from pmr.system.from_scene import with_terms_of
from pmr.system.system import System

#: Reason why there is no estimate for a boom from a file of version 1 or 2.
EARLIER = "the file is of an earlier version, without the modes that the estimate needs"


def simulate_saved(system: System, scene: Scene) -> RunResult:
    """Simulate a system under another scene's paths, loads and time stepping, by the simulators that it names.

    The result has those errors that are estimated without the full model, and no singular values.

    Raises
    ------
    InputError
        If the scene describes other bodies or joints than those of the system, if its loads differ from the system's
        inputs, if a path leaves that of the system, or if a simulator can't simulate the system.
    SimulationError
        If a step fails.
    """
    scene = with_choice_of_terms(scene, system.terms)
    check_installed(scene)
    scene = with_models_of(scene, system)
    system = with_terms_of(scene, system)
    clock, excitation, models = Clock(), excitation_of_scene(scene, system), system.reduced
    results = simulate(scene, system, excitation, clock).with_least_seconds()
    responses, response = {"reduced": results.first.response}, results.first.response
    natural = frequencies_on_way(scene, system, excitation, way_points(scene, excitation, 0))
    motion = SimulatedSystem.from_simulations(system, excitation, results)
    by_frequency = response_on_way(scene, system, excitation)
    error = _error(scene, motion, clock)
    with clock.stage("step"):
        step = step_part(scene, motion, natural.models["reduced"])
    sizes = {name: {"reduced": model.size} for name, model in models.items()}
    of_model = {
        "model": {name: system.provenance.get(name) for name in ("scene_hash", "basis", "versions")},
        "max_displacement": float(np.abs(response.displacement).max()),
        "coordinates": {"reduced": sum(model.size for model in models.values())},
        "simulators": {"reduced": scene.simulation.simulators[0]},
    }
    parts = [
        origin_part(scene),
        SummaryPart(of_model),
        simulation_part(results.seconds, results.agreement, {}),
        sections_part(scene, responses, sizes, {name: error.of_section(name) for name in models}),
        error.part,
        SummaryPart(warnings=reduction_warnings(error.part.figures)),
        *parts_of_motion(scene, motion, results, natural, step),
        frequency_part(by_frequency),
        reliability_part({}, responses, system),
        theory_part(scene, responses),
    ]
    alone = models.get(ALONE)
    shapes = None if alone is None else Shapes(np.zeros(0), alone.output_positions, alone.outputs)
    return RunResult(
        scene,
        combine_parts(parts),
        responses,
        result_paths(scene, excitation),
        Loads(system.input_names, system.input_units, results.first.loads),
        natural,
        {name: BodyResult(shapes) for name in models},
        None if alone is not None else scene.reach(excitation.times),
        by_frequency,
        error.band,
    )


def _error(scene: Scene, simulated: SimulatedSystem, clock: Clock) -> ReductionError:
    """Estimated error of the reduction; it has no values if the file is of an earlier version (reason: `EARLIER`)."""
    error = reduction_error(scene, simulated, clock)
    bodies, estimated = simulated.system.reduced.items(), all(part.reduction.estimate for part in scene.sections)
    if estimated and any(model.cylinder_modes and name not in simulated.system.on_modes for name, model in bodies):
        return ReductionError(SummaryPart({"estimate": error.part.figures["estimate"] | {"reason": EARLIER}}))
    return error
