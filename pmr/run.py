"""The main job: scene -> model -> snapshots -> basis -> reduced model -> simulations -> comparison."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr import environment
from pmr.accuracy import mesh as meshes
from pmr.accuracy import order
from pmr.compare import coverage, estimate, memory, pad_forces, step_advice, trust, validity
from pmr.compare import errors as compare
from pmr.compare.frequencies import closed_form_frequencies, reduced_frequencies
from pmr.compare.references import References, references
from pmr.compare.responses import Simulations, check_installed, full_simulator, quantities, simulate
from pmr.compare.step_error import StepError, step_error
from pmr.environment import Clock
from pmr.errors import InputError, SimulationError
from pmr.fem.compat import MPI
from pmr.fem.compat import versions as fenicsx_versions
from pmr.fem.distributed import free_dropped
from pmr.files import jsonfile
from pmr.fullmodel import free_motions
from pmr.fullmodel.build import Built, build
from pmr.fullmodel.eigensolvers import eigensolver
from pmr.fullmodel.model import FullModel
from pmr.recover.from_scene import Recovered, recover, recovered_steps
from pmr.reduce.basis import Basis
from pmr.reduce.from_scene import build_basis, description, project, take_snapshots
from pmr.reduced.model import ReducedModel
from pmr.results import FrequencyCurves, Response, RunResult, Shapes
from pmr.scene import Scene
from pmr.scene.choice import transverse
from pmr.simulate import Excitation, contact_step, resolution
from pmr.simulate.petsc import Checkpoint
from pmr.snapshots import Snapshots
from pmr.snapshots.free_body import FreeBody

Array = NDArray[np.float64]

FREQUENCY_CURVES = 6
#: Places at which frequencies are compared: beyond so many coordinates each costs some tenths of a second and more.
FREQUENCY_POSITIONS, FEWER_POSITIONS, LARGE = 49, 11, 300


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
    scene: Scene,
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
    check_installed(scene)
    clock, scene = clock or Clock(), order.prepared(scene)
    with clock.stage("assemble"):
        built = build(scene, comm)
    free = comm.bcast(environment.available_memory() if comm.rank == 0 else None)
    size, outputs = built.model.size, built.model.outputs.getSize()[1]
    memory.check(scene, size, outputs, free, tell=comm.rank == 0)
    reduction = _reduce(scene, built.model, clock)
    choice, on_finer = _chosen(scene, reduction, clock)
    if choice is not None:
        scene, reduction = choice.scene, replace(reduction, reduced=choice.reduced)
    with clock.stage("frequencies"):
        curves = _frequency_curves(scene, reduction)
    found = references(scene, reduction.model, clock, recovered_steps(scene).tolist(), checkpoint)
    seen = _recovered(scene, built, reduction, found, clock)
    if comm.rank > 0:
        return None
    simulations = simulate(scene, reduction.reduced, found.responses, clock)
    summary = _summary(scene, reduction, simulations, clock.seconds)
    summary |= _estimated(scene, reduction.reduced, curves.reduced, clock)
    if choice is not None:
        summary |= order.summary(choice, on_finer)
        summary["warnings"] += order.warnings(choice, on_finer)
    summary |= pad_forces.summary(scene, simulations.responses["reduced"])
    summary["warnings"] += memory.warnings(scene, size, outputs)
    summary["warnings"] += free_motions.warnings(built.structure, scene.path_bounds)
    summary["warnings"] += pad_forces.warnings(scene, simulations.responses["reduced"])
    excitation = Excitation.of(scene)
    summary |= contact_step.summary(reduction.reduced, excitation)
    summary["warnings"] += contact_step.warnings(reduction.reduced, excitation)
    summary |= {"no_reference": found.missing}
    summary["warnings"] += trust.warnings(found.missing, simulations.responses["reduced"])
    result = _result(scene, summary, simulations.responses, reduction, curves)
    if seen is not None:
        result = replace(
            result, summary=summary | seen.summary(), fields=seen.reduced.fields, peak_stress=seen.histories()
        )
    result.summary["warnings"] += validity.large_motion(result) + jsonfile.remarks(result.summary)
    return Outcome(result, reduction.reduced)


def reduce(scene: Scene, comm: MPI.Comm = MPI.COMM_WORLD, clock: Clock | None = None) -> Reduction:
    """From a scene to its reduced model; collective."""
    clock = clock or Clock()
    with clock.stage("assemble"):
        model = build(scene, comm).model
    return _reduce(scene, model, clock)


def reduce_with(
    scene: Scene,
    model: FullModel,
    snapshots: Snapshots,
    clock: Clock | None = None,
    body: FreeBody | None = None,
) -> Reduction:
    """From a model and its snapshots to the scene's reduced model; collective.

    A `body` whose factor the snapshots were made with is taken over and dropped.
    """
    clock = clock or Clock()
    with clock.stage("pod"):
        basis = build_basis(scene, model, snapshots)
        reduced = project(scene, model, basis, _provenance(scene, basis), body)
    free_dropped(model.comm)
    return Reduction(model, snapshots, basis, reduced)


def visited_positions(scene: Scene, size: int) -> Array:
    """Path coordinates (S,) in m, evenly over the path, at which frequencies of `size` coordinates are compared."""
    low, high = scene.path_bounds
    count = FREQUENCY_POSITIONS if size <= LARGE else FEWER_POSITIONS
    return np.linspace(low, high, count) if high > low else np.array([low])


def full_frequencies(scene: Scene, model: FullModel, s: Array) -> Array:
    """Lowest frequencies (S, f) of the full model in rad/s with the sliders at s (S,) m; collective."""
    count = min(FREQUENCY_CURVES, model.size - len(model.rows.names))
    solver = eigensolver(model, scene.reduction.solver)
    return np.array([solver.lowest(float(at), count).omega for at in s])


def _recovered(scene: Scene, built: Built, reduction: Reduction, found: References, clock: Clock) -> Recovered | None:
    if scene.recovery is None:
        return None
    with clock.stage("recover"):
        V = np.array(reduction.basis.V.getDenseArray())
        return recover(scene, built, V, reduction.reduced, found.states)


def _reduce(scene: Scene, model: FullModel, clock: Clock) -> Reduction:
    with clock.stage("snapshots"):
        body = FreeBody(model, scene.reduction.solver)
        snapshots = take_snapshots(scene, model, body)
    return reduce_with(scene, model, snapshots, clock, body)


def _chosen(scene: Scene, reduction: Reduction, clock: Clock) -> tuple[order.Choice | None, dict[str, float] | str]:
    """Model and step for the scene's tolerance, if it gives one, and the part of the mesh, or why it isn't known."""
    if scene.accuracy is None:
        return None, ""
    with clock.stage("search"):
        choice = order.choose(scene, reduction.reduced, _tips(scene))
    if not scene.accuracy.mesh:
        return choice, "the scene leaves it out"
    finer = meshes.finer(choice.scene)
    if finer is None:
        return choice, "a mesh that is read from a file has no finer one"
    with clock.stage("finer mesh"):
        on_finer = reduce(finer, reduction.model.comm).reduced
        return choice, meshes.mesh_error(choice.reduced, on_finer, choice.scene, _tips(scene), scene.accuracy.outputs)


def _frequency_curves(scene: Scene, reduction: Reduction) -> FrequencyCurves:
    """Lowest frequencies over the stretch that the path visits."""
    s = visited_positions(scene, reduction.model.size)
    full = full_frequencies(scene, reduction.model, s)
    return FrequencyCurves(
        s,
        full,
        reduced=reduced_frequencies(reduction.reduced, s, full.shape[1]),
        closed_form=closed_form_frequencies(scene, s, full.shape[1]),
    )


def _provenance(scene: Scene, basis: Basis) -> dict[str, Any]:
    described = scene.model_dump(mode="json", exclude={"published"})
    if scene.mesh.file is not None:
        # The model travels; its folders stay, the hash has the content.
        described["mesh"]["file"] = scene.mesh.file.name
    return {
        "scene": described,
        "scene_hash": scene.hash,
        "basis": description(scene, basis),
        "kappa": basis.kappa(),
        "versions": environment.versions() | fenicsx_versions(),
    }


def _summary(scene: Scene, reduction: Reduction, simulations: Simulations, seconds: dict[str, float]) -> dict[str, Any]:
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
        "date": environment.today(),
        "machine": environment.machine(),
        "notes": list(scene.published.remarks) if scene.published else [],
    }


def _estimated(scene: Scene, reduced: ReducedModel, omega: Array, clock: Clock) -> dict[str, Any]:
    """Errors estimated of the reduction and of the step, and what a user should know."""
    excitation = Excitation.of(scene)
    driven, stepping = excitation.signals, excitation.stepping
    found, failed, left_out = None, None, list[str]()
    if scene.reduction.estimate and estimate.no_estimate(reduced) is None:
        with clock.stage("estimate"):
            try:
                found = estimate.estimate(reduced, excitation, _tips(scene))
                left_out = coverage.not_covered(reduced, driven, stepping)
                left_out += [coverage.BLOWS] * (found.pad_force is None)
            except SimulationError as error:
                failed = str(error)
    asked = {"estimate": estimate.summary(reduced, found, left_out, failed)} if scene.reduction.estimate else {}
    said = resolution.unseen(driven, stepping) + resolution.overshooting(driven, stepping)
    said += estimate.warnings(reduced, stepping, found)
    said += coverage.warnings(left_out)
    step, reason = _step_error(scene, reduced, clock)
    if step is not None and scene.accuracy is None:  # otherwise the search has chosen it
        said += step_advice.warnings(step, stepping, driven, omega)
    elif reason is not None:
        said.append(f"the error of the time step is not known: {reason}")
    return asked | {"step": step_advice.summary(step, reason), "warnings": said}


def _step_error(scene: Scene, reduced: ReducedModel, clock: Clock) -> tuple[StepError | None, str | None]:
    """Error of the time step, or why there is no figure."""
    with clock.stage("step"):
        try:
            return step_error(reduced, Excitation.of(scene), _tips(scene)), None
        except (SimulationError, InputError) as error:
            return None, str(error)


def _tips(scene: Scene) -> int:
    """Number of outputs at the tip."""
    return len(transverse(scene))


def _result(
    scene: Scene,
    summary: dict[str, Any],
    responses: Mapping[str, Response],
    reduction: Reduction,
    curves: FrequencyCurves,
) -> RunResult:
    shapes = Shapes(reduction.basis.sigma, reduction.reduced.output_positions, reduction.reduced.outputs)
    excitation = Excitation.of(scene)
    s, f = excitation.s[:, 0], excitation.forces(reduction.reduced.input_names)
    return RunResult(scene, summary, responses, s, excitation.path_rate, f, shapes, curves)
