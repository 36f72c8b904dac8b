"""The main job: scene -> model -> snapshots -> basis -> reduced model -> simulations -> comparison."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr import compare, environment, estimate
from pmr.basis import Basis
from pmr.build import Built, build
from pmr.clock import Clock
from pmr.dolfinx_compat import MPI
from pmr.dolfinx_compat import versions as fenicsx_versions
from pmr.frequencies import closed_form_frequencies, reduced_frequencies
from pmr.fullorder import Checkpoint
from pmr.operators import FullModel
from pmr.parallel import free_dropped
from pmr.recovered import Recovered, recover, recovered_steps
from pmr.reduced import ReducedModel
from pmr.reduction import build_basis, description, project, take_snapshots
from pmr.references import References, references
from pmr.responses import Simulations, course, full_simulator, quantities, simulate
from pmr.results import FrequencyCurves, Response, RunResult, Shapes
from pmr.scene import Scene, SceneBase, StructureScene
from pmr.scene.choice import transverse
from pmr.simulate.stepping import loads_at
from pmr.snapshots import Snapshots
from pmr.snapshots.eigensolvers import eigensolver

Array = NDArray[np.float64]

FREQUENCY_CURVES = 6
FREQUENCY_POSITIONS = {Scene: 49, StructureScene: 11}  # in space each costs some tenths of a second and more


@dataclass(frozen=True)
class Reduction:
    """Everything from the operators to the reduced model."""

    model: FullModel
    snapshots: Snapshots
    basis: Basis
    reduced: ReducedModel


@dataclass(frozen=True)
class Outcome:
    """What a run returns on rank 0."""

    result: RunResult
    reduced: ReducedModel


def run(
    scene: SceneBase,
    comm: MPI.Comm = MPI.COMM_WORLD,
    clock: Clock | None = None,
    checkpoint: Checkpoint | None = None,
) -> Outcome | None:
    """Run a scene on `comm`; what is not distributed runs on rank 0, the other ranks get None.

    With a `checkpoint` a full-order simulation that was cut off goes on.

    Raises
    ------
    InputError
        If the scene asks for what cannot be had; its source is ``"scene"``.
    ConvergenceError, SimulationError
        If a solver fails.
    """
    clock = clock or Clock()
    with clock.stage("assemble"):
        built = build(scene, comm)
    reduction = _reduce(scene, built.model, clock)
    with clock.stage("frequencies"):
        curves = _frequency_curves(scene, reduction)
    found = references(scene, reduction.model, clock, recovered_steps(scene).tolist(), checkpoint)
    seen = _recovered(scene, built, reduction, found, clock)
    if comm.rank > 0:
        return None
    simulations = simulate(scene, reduction.reduced, found.responses, clock)
    summary = _summary(scene, reduction, simulations, clock.seconds) | _estimated(scene, reduction.reduced, clock)
    result = _result(scene, summary, simulations.responses, reduction, curves)
    if seen is not None:
        result = replace(
            result, summary=summary | seen.summary(), fields=seen.reduced.fields, peak_stress=seen.histories()
        )
    return Outcome(result, reduction.reduced)


def reduce(scene: SceneBase, comm: MPI.Comm = MPI.COMM_WORLD, clock: Clock | None = None) -> Reduction:
    """From a scene to its reduced model; collective."""
    clock = clock or Clock()
    with clock.stage("assemble"):
        model = build(scene, comm).model
    return _reduce(scene, model, clock)


def reduce_with(scene: SceneBase, model: FullModel, snapshots: Snapshots, clock: Clock | None = None) -> Reduction:
    """From a model and its snapshots to the scene's reduced model; collective."""
    clock = clock or Clock()
    with clock.stage("pod"):
        basis = build_basis(scene, model, snapshots)
        reduced = project(scene, model, basis, _provenance(scene, basis))
    free_dropped(model.comm)
    return Reduction(model, snapshots, basis, reduced)


def visited_positions(scene: SceneBase) -> Array:
    """Path coordinates (S,) in m, evenly over the stretch that the path visits, at which frequencies are compared."""
    low, high = scene.path_bounds
    return np.linspace(low, high, FREQUENCY_POSITIONS[type(scene)]) if high > low else np.array([low])


def full_frequencies(scene: SceneBase, model: FullModel, s: Array) -> Array:
    """Lowest frequencies (S, f) of the full model in rad/s with the sliders at s (S,) m; collective."""
    count = min(FREQUENCY_CURVES, model.size - len(model.rows.names))
    solver = eigensolver(model, scene.reduction.solver)
    return np.array([solver.lowest(float(at), count).omega for at in s])


def _recovered(
    scene: SceneBase, built: Built, reduction: Reduction, found: References, clock: Clock
) -> Recovered | None:
    if not isinstance(scene, StructureScene) or scene.recovery is None:
        return None
    with clock.stage("recover"):
        V = np.array(reduction.basis.V.getDenseArray())
        return recover(scene, built, V, reduction.reduced, found.states)


def _reduce(scene: SceneBase, model: FullModel, clock: Clock) -> Reduction:
    with clock.stage("snapshots"):
        snapshots = take_snapshots(scene, model)
    return reduce_with(scene, model, snapshots, clock)


def _frequency_curves(scene: SceneBase, reduction: Reduction) -> FrequencyCurves:
    """Lowest frequencies over the stretch that the path visits."""
    s = visited_positions(scene)
    full = full_frequencies(scene, reduction.model, s)
    return FrequencyCurves(
        s,
        full,
        reduced=reduced_frequencies(reduction.reduced, s, full.shape[1]),
        closed_form=closed_form_frequencies(scene, s, full.shape[1]),
    )


def _provenance(scene: SceneBase, basis: Basis) -> dict[str, Any]:
    described = scene.model_dump(mode="json", exclude={"published"})
    if scene.mesh_file is not None:
        # The model travels; its folders stay, the hash has the content.
        described["mesh"]["file"] = scene.mesh_file.name
    return {
        "scene": described,
        "scene_hash": scene.hash,
        "basis": description(scene, basis),
        "kappa": basis.kappa(),
        "versions": environment.versions() | fenicsx_versions(),
    }


def _summary(
    scene: SceneBase, reduction: Reduction, simulations: Simulations, seconds: dict[str, float]
) -> dict[str, Any]:
    responses, measured = simulations.responses, quantities(scene)
    reference = responses.get("full", responses["reduced"]).displacement
    error = float(np.abs(responses["reduced"].displacement - reference).max()) if "full" in responses else None
    return {
        "title": scene.title,
        "scene_hash": scene.hash,
        "errors": compare.errors(responses, quantities=measured),
        "absolute_errors": compare.errors(responses, compare.absolute_error, quantities=measured),
        "max_displacement": float(np.abs(reference).max()),
        "max_error": error,
        "coordinates": {"full": reduction.model.size, "reduced": reduction.reduced.size},
        "basis": {
            "kind": description(scene, reduction.basis),
            "kappa": reduction.basis.kappa(),
            "singular_values": reduction.basis.sigma.tolist(),
            "largest_residual": float(reduction.snapshots.residuals.max()),
            "rows_left_out": list(reduction.reduced.left_out),
        },
        "seconds": {name: seconds[name] for name in ("assemble", "snapshots", "pod", "recover") if name in seconds}
        | {"simulate": dict(simulations.seconds)},
        "simulators": {"reduced": simulations.first}
        | ({"full": full_simulator(scene, reduction.model.size)} if "full" in responses else {}),
        "agreement": dict(simulations.agreement),
        "versions": environment.versions() | fenicsx_versions(),
        "commit": environment.commit(),
        "machine": environment.machine(),
        "notes": list(scene.published.remarks) if scene.published else [],
    }


def _estimated(scene: SceneBase, reduced: ReducedModel, clock: Clock) -> dict[str, Any]:
    """The error estimate, and what a user should know."""
    found = None
    if scene.reduction.estimate and estimate.no_estimate(reduced) is None:
        with clock.stage("estimate"):
            tips = len(transverse(scene)) if isinstance(scene, StructureScene) else 1
            found = estimate.estimate(reduced, *course(scene), tips)
    asked = {"estimate": estimate.summary(reduced, found)} if scene.reduction.estimate else {}
    return asked | {"warnings": estimate.warnings(reduced, course(scene)[2], found)}


def _result(
    scene: SceneBase,
    summary: dict[str, Any],
    responses: Mapping[str, Response],
    reduction: Reduction,
    curves: FrequencyCurves,
) -> RunResult:
    t = responses["reduced"].t
    shapes = Shapes(reduction.basis.sigma, reduction.reduced.output_positions, reduction.reduced.outputs)
    path, loads = scene.slider.path, loads_at(scene.signals, t)
    return RunResult(scene, summary, responses, path.value(t), path.rate(t), loads, shapes, curves)
