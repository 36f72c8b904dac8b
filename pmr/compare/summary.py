"""Parts of summary.json (`pmr.results.run.SummaryPart`), and runs of saved systems, which lack those of full models.

Each function returns values by their keys, and warnings.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from pmr.compare.drives import extension_part, hoist_part, luffing_part
from pmr.compare.error_parts import ReductionError, estimate_reduction, step_part
from pmr.compare.errors import (
    ResponseFunction,
    absolute_error,
    band_of_response,
    compared_pairs,
    error_below_frequency,
    errors_of_pairs,
    largest_difference,
    relative_error,
    with_common_forces,
)
from pmr.compare.evaluation import SimulatedSystem
from pmr.compare.forces import forces_part, limits_part, ropes_part
from pmr.compare.frequencies import (
    frequencies_on_way,
    frequency_part,
    lowest_mode_part,
    published_part,
    response_on_way,
    result_paths,
    way_points,
)
from pmr.compare.moving_frame import energy_part, frame_part, ground_part
from pmr.compare.outputs import has_impulsive_force
from pmr.compare.responses import Simulations, check_installed, simulate
from pmr.compare.second_order import with_choice_of_terms
from pmr.compare.simulated import excitation_of_scene, with_models_of
from pmr.compare.strength import dynamic_factors_part, fatigue_part, missed_stress_part
from pmr.compare.trust import (
    RingingReference,
    distrust_warnings,
    large_motion_warnings,
    missing_reference_warnings,
    reduction_warnings,
    rigid_contacts,
    ringing_warnings,
)
from pmr.errors import environment
from pmr.errors.environment import Clock
from pmr.files.arrays import Summary
from pmr.results import BodyResult, Frequencies, Loads, Response, RunResult, Shapes
from pmr.results.run import SummaryPart, combine_parts
from pmr.scene import Scene
from pmr.scene.hints import hints
from pmr.scene.keys import ALONE
from pmr.simulation import Excitation, contact_step
from pmr.simulation.excitation import machine_signals
from pmr.simulation.stepping import describe_lost_features, describe_overshoots
from pmr.system.from_scene import with_hoist_of
from pmr.system.system import System
from pmr.system.terms import terms_of


def origin_part(scene: Scene, libraries: Mapping[str, str] | None = None) -> SummaryPart:
    """Origin of the result: title, hash, commit, date, machine, and versions of pmr and of `libraries`.

    ``notes`` are remarks of the scene on published values, and the warnings are hints on the scene
    (`pmr.scene.hints`).  `libraries` maps names to versions; None stands for no libraries.
    """
    origin = environment.describe_origin(libraries)
    notes = list(scene.published.remarks) if scene.published else []
    return SummaryPart({"title": scene.title, "scene_hash": scene.hash} | origin | {"notes": notes}, grave=hints(scene))


def simulation_part(
    seconds: Mapping[str, float], agreement: Mapping[str, float], stages: Mapping[str, float]
) -> SummaryPart:
    """Entries ``seconds``, of stages and simulators, and ``agreement``, the differences between simulators in m."""
    return SummaryPart({"seconds": {**stages, "simulate": dict(seconds)}, "agreement": dict(agreement)})


def comparison_part(
    responses: Mapping[str, Response],
    measured: Mapping[str, ResponseFunction],
    simulators: Mapping[str, str],
    rigid: Sequence[str],
) -> SummaryPart:
    """Part with differences to references, in the quantities that `measured` returns, and the simulator of each model.

    `responses` are the responses, and `simulators` the names of simulators, by model.  Errors that come from ringing of
    the full model are not listed as errors: ``not_judged`` has these, with a warning each.  The warnings name `rigid`,
    the rigid contacts of the full model.
    """
    reduced, full = responses["reduced"].displacement, responses.get("full")
    reference = reduced if full is None else full.displacement
    measures = {"errors": relative_error, "absolute_errors": absolute_error, "largest_differences": largest_difference}
    pairs, unjudged = compared_pairs(responses, quantities=measured), dict[str, RingingReference]()
    kinds = {kind: errors_of_pairs(pairs, measure) for kind, measure in measures.items()}
    if full is not None:
        for name, pair in pairs["reduced_vs_full"].items():
            if (not_judged := RingingReference.judge(pair, full)) is not None:
                unjudged[name] = not_judged
                for kind in kinds.values():
                    del kind["reduced_vs_full"][name]
    figures = {
        "not_judged": {name: vars(verdict) for name, verdict in unjudged.items()},
        "max_displacement": float(np.abs(reference).max()),
        "max_error": None if full is None else float(np.abs(reduced - reference).max()),
        "simulators": {name: simulator for name, simulator in simulators.items() if name in responses},
    }
    return SummaryPart(kinds | figures, ringing_warnings(unjudged, rigid))


def impacts_part(system: System, excitation: Excitation, responses: Mapping[str, Response]) -> SummaryPart:
    """Entry ``impacts``, for rigid sliders at kinks of the path: error ``pad_force`` of forces below ``band`` in Hz.

    Above this frequency lies 1 % of the full model's motion at the tip, and most of the forces that an impact causes.
    The part is empty if no rigid slider meets a kink, or if `responses` has no ``full`` model.
    """
    alone = system.reduced.get(ALONE)
    if alone is None or "full" not in responses or not has_impulsive_force(alone, excitation):
        return SummaryPart()
    reduced, full = with_common_forces(responses["reduced"], responses["full"])
    step = excitation.stepping.step
    highest = band_of_response(full)
    error = error_below_frequency(reduced.slider_force, full.slider_force, step, highest)
    return SummaryPart({"impacts": {"band": highest, "pad_force": error}})


def sampling_part(scene: Scene, excitation: Excitation) -> SummaryPart:
    """Part with warnings about paths, loads and drives that the steps do not resolve, and about curves through tables.

    The paths and loads are those of the `excitation`, the drives those of the scene's frame, hoist and extensions.  A
    drive that is also a path or a load is named by its key in the scene.
    """
    drives, stepping = machine_signals(scene), excitation.stepping
    stated = {id(signal) for _, signal in drives}
    signals = [*drives, *(pair for pair in excitation.signals if id(pair[1]) not in stated)]
    return SummaryPart(warnings=describe_lost_features(signals, stepping) + describe_overshoots(signals, stepping))


def reliability_part(reasons: Mapping[str, str], responses: Mapping[str, Response], system: System) -> SummaryPart:
    """Entry ``no_reference``, the `reasons` for missing references, with warnings if the reduced motion is unreliable.

    `responses` are the responses by model.
    """
    doubted = distrust_warnings(responses["reduced"], rigid_contacts(system))
    return SummaryPart({"no_reference": dict(reasons)}, missing_reference_warnings(reasons), doubted)


def theory_part(scene: Scene, responses: Mapping[str, Response]) -> SummaryPart:
    """Part with a warning if a motion in one of the `responses` is too large for the models' linear theory."""
    length = float(np.max(scene.reach(np.linspace(0.0, scene.time.end, scene.time.steps + 1))))
    return SummaryPart(grave=large_motion_warnings(length, responses.values()))


def masses_part(masses_of_bodies: Summary) -> SummaryPart:
    """Entry ``masses`` of summary.json: the ``name`` of each body, with `pmr.fullmodel.model.Masses.summary`.

    A body whose masses are None is left out.
    """
    rows = [{"name": name, **masses.summary()} for name, masses in masses_of_bodies.items() if masses is not None]
    return SummaryPart({"masses": rows} if rows else {})


def parts_of_forces(scene: Scene, system: System, response: Response) -> list[SummaryPart]:
    """Parts on forces of pads, supports, ropes, cylinders, hoist and outriggers, and on fatigue, in a response."""
    further_parts = ropes_part, luffing_part, extension_part, hoist_part, ground_part, fatigue_part
    parts = [forces_part(scene, system, response), *(of(scene, response) for of in further_parts)]
    return [limits_part(scene, system, response), *parts]


def parts_of_motion(
    scene: Scene, simulated: SimulatedSystem, simulations: Simulations, natural: Frequencies, step: SummaryPart
) -> list[SummaryPart]:
    """Parts on forces, steps, frequencies and the frame of a motion, in the order in which they are to be combined.

    They are forces, dynamic factors, error of the step, published frequencies, lowest mode, parts of steps, sampling,
    stress that was missed, frame and energy.

    `simulations` are the simulations of `simulated`; `natural` are natural frequencies on the way; `step` is the part
    on the error of the step.
    """
    excitation, system, omega = Excitation.from_scene(scene), simulated.system, simulations.contact_frequency
    divided = contact_step.summary(omega, simulations.time_grid)
    return [
        *parts_of_forces(scene, system, simulations.first.response),
        dynamic_factors_part(scene, simulations.form or system, simulations.first.response),
        step,
        published_part(scene, natural),
        lowest_mode_part(scene, system, excitation, natural),
        SummaryPart(divided, contact_step.warnings(omega, excitation.stepping)),
        sampling_part(scene, excitation),
        missed_stress_part(scene, simulations.first.response),
        frame_part(scene, system, excitation, natural),
        energy_part(scene, system, excitation, simulations.first.run),
    ]


def sections_part(
    boom: Scene, responses: Mapping[str, Response], sizes: Mapping[str, Mapping[str, int]], more: Mapping[str, Summary]
) -> SummaryPart:
    """Entry ``sections`` of summary.json: name, coordinates, difference to the full model, and `more` of each section.

    `responses` are the responses by model, and `sizes` the numbers of coordinates by section and model.  `more` has
    further values for each section by name.  The largest ``stress_peak`` of all sections is returned as well, and its
    value as ``max_von_mises``.  For a single body only `more` is returned.
    """
    if ALONE in boom.bodies:
        return SummaryPart(dict(more.get(ALONE, {})))
    reduced, full, rows = responses["reduced"], responses.get("full"), []
    for name in boom.names:
        figures: dict[str, Any] = {"name": name, "coordinates": dict(sizes[name])}
        if full is not None:
            columns = [k for k, of in enumerate(reduced.outputs) if of.body == name and of.is_displacement]
            error = relative_error(reduced.displacement[:, columns], full.displacement[:, columns])
            figures |= {"errors": {"reduced_vs_full": {"beam": error}}}
        rows.append(figures | dict(more.get(name, {})))
    peaks = [(row["name"], row["stress_peak"]) for row in rows if "stress_peak" in row]
    if not peaks:
        return SummaryPart({"sections": rows})
    highest = dict[str, dict[str, Any]]()
    for model in peaks[0][1]:
        highest[model] = max(({"section": n, **peak[model]} for n, peak in peaks), key=lambda row: float(row["value"]))
    most = {model: peak["value"] for model, peak in highest.items()}
    return SummaryPart({"sections": rows, "max_von_mises": most, "stress_peak": highest})


#: Reason why there is no estimate for a boom from a file of version 1 or 2.
EARLIER = "the file is of an earlier version, without the modes that the estimate needs"


def simulate_saved(system: System, scene: Scene) -> RunResult:
    """Simulate a system under another scene's paths, loads and time stepping, by that scene's simulators.

    The result has those errors that are estimated without the full model, and no singular values.

    Raises
    ------
    InputError
        If bodies, joints or loads of the scene are not those of the system, if a path leaves the range that the system
        is made for, or if a simulator can't simulate the system.
    SimulationError
        If a step fails.
    """
    scene = with_choice_of_terms(scene, system.terms)
    check_installed(scene)
    scene = with_models_of(scene, system)
    # a system that is read from a file has only the terms of its own bodies
    system = replace(with_hoist_of(scene, system), terms_of=partial(terms_of, scene))
    clock, excitation, models = Clock(), excitation_of_scene(scene, system), system.reduced
    results = simulate(scene, system, excitation, clock)
    responses, response = {"reduced": results.first.response}, results.first.response
    natural = frequencies_on_way(scene, system, excitation, way_points(scene, system, excitation, 0))
    motion = results.simulated_system(system, excitation)
    by_frequency = response_on_way(scene, system, excitation)
    error = _estimated_error(scene, motion)
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


def _estimated_error(scene: Scene, simulated: SimulatedSystem) -> ReductionError:
    """Estimated error of the reduction; for models from a file of an earlier version the reason `EARLIER` instead."""
    error = estimate_reduction(scene, simulated)
    bodies, estimated = simulated.system.reduced.items(), all(part.reduction.estimate for part in scene.sections)
    if estimated and any(model.cylinder_modes and name not in simulated.system.on_modes for name, model in bodies):
        return ReductionError(SummaryPart({"estimate": error.part.figures["estimate"] | {"reason": EARLIER}}))
    return error
