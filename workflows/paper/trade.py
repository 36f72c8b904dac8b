"""Accuracy against processor time, online and offline, of bases, model sizes, time steps and meshes.

Methods of reduction, besides those of `family`:

trajectory
    POD of the full model's own motion.

Axial coordinates, which no load excites, are left out of planar beams in all methods alike. For booms of sections the
methods are ``modes`` and ``flexibility`` alone, and ``coordinates`` are numbers of elastic modes of each section. A
scene of a single body is also simulated with the spectral radii ``radii``, and a planar beam with numbers of
``elements``. ``steps`` are multiples of the scene's step. ``studies`` are studies beside this one, in
workflows/studies/trade.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from experiment import Row, Settings, rows, run, save, warnings_of_response
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

import pmr
from pmr.compare.accuracy import trials_of
from pmr.compare.errors import relative_error
from pmr.compare.evaluation import evaluate_motion
from pmr.compare.outputs import divide_steps, run_from_start
from pmr.reduction.bodies import reduce_bodies, reduce_body
from pmr.report.blocks import Block, Chapter, Grid, KeyNumber, Notices
from pmr.report.figures import WIDE, curve_style, drawing, log_axis, log_x, make_sheet
from pmr.report.numbers import format_input, format_percent, format_quantity
from pmr.report.studies import study_chapter
from pmr.report.studies.tables import FinishedStudy
from pmr.scene import Reduction, Scene
from pmr.scene.keys import ALONE
from pmr.scene.mechanism import frame_terms
from pmr.simulation import Excitation
from pmr.simulation.modal import modal_form
from pmr.simulation.reactions import with_forces_on_machine
from pmr.studies.tasks import bodies_of, full_system, model_of
from pmr.system.attachment import simulated_model
from pmr.system.from_scene import system_of
from pmr.system.reduced_model import ReducedModel
from pmr.system.states import SystemTrajectory
from pmr.system.truncation import MODAL, extend, truncate

NAMES = {
    "pod": "POD, slider at nodes",
    "visited": "POD, places visited",
    "modes": "free modes",
    "flexibility": "residual flexibility",
    "trajectory": "POD of the full motion",
}
SETTINGS = {
    "scenes": [
        "simple_residual", "evolved_residual", "static_slide", "fast_slide", "tip_impact", "sine_sweep", "steel_boom",
        "reversing", "boom_beam",
    ],
    "methods": list(NAMES),
    "coordinates": [2, 3, 4, 5, 6, 8, 10, 12, 16, 20],
    "steps": [4.0, 2.0, 1.0, 0.5, 0.25, 0.125, 0.0625],
    "radii": [0.0, 0.5, 0.8, 0.9, 1.0],
    "elements": [4, 8, 16, 32, 64],
    "studies": ["simulators", "linear", "shell"],
}  # fmt: skip
#: Tolerances of e_NRMS, the normalised root mean square error, of the displacements along the body.
TOLERANCES = (0.05, 0.01, 0.001, 0.0001)
#: Bases that sections may have: free modes, without the flexibility of those left out or with it.
SECTION_BASES = ("modes", "flexibility")
#: The reference's step, as a share of the smallest step that is tried.
FINER = 0.25
#: Number of simulations with which a time is measured; the shortest time is taken.
REPEATS = 3
#: Number of free modes in trials of steps and meshes, with which the model's own error is negligible.
MANY = 20
#: Number of steps of the full motion between two snapshots.
SNAPSHOT_INTERVAL = 5
#: Rigid-body motions of a section, at most.
RIGID_MODES = 6
STUDIES = Path(__file__).resolve().parents[1] / "studies" / "trade"
COLUMNS = 2


@dataclass(frozen=True)
class FullMotion:
    """A scene, its full models as one system, and the motion of that system."""

    scene: Scene
    full: pmr.System  # a single body is in its modal coordinates
    excitation: Excitation  # with steps divided as in the full motion
    run: SystemTrajectory
    response: pmr.Response

    @classmethod
    def simulate(cls, scene: Scene) -> FullMotion:
        """Build the full models of a scene and simulate their motion."""
        alone = len(scene.sections) == 1
        body = model_of(scene).gather() if alone else None
        full = full_system(scene) if body is None else pmr.System.of(modal_form(body).body)
        excitation = divide_steps(full, Excitation.from_scene(scene))
        motion = run_from_start(full, excitation)
        return cls(scene, full, excitation, motion, with_forces_on_machine(scene, evaluate_motion(full, motion)))


def displacement(
    scene: Scene, system: pmr.System, step_factor: float, every: int, rho_inf: float | None = None
) -> np.ndarray:
    """Return the displacements (T, o) in m of a system at each `every`-th step of its motion.

    The time step is `step_factor` times the scene's.  The spectral radius is `rho_inf`, or the scene's if that is None.
    """
    driven = Excitation.from_scene(scene)
    grid = replace(driven.stepping, step=step_factor * driven.stepping.step)
    grid = grid if rho_inf is None else replace(grid, rho_inf=rho_inf)
    return evaluate_motion(system, run_from_start(system, driven.on_grid(grid), every)).displacement


@dataclass(frozen=True)
class Family:
    """Models of one basis as systems: `system_of_size` returns the model of a size from `smallest` to `largest`."""

    system_of_size: Callable[[int], pmr.System]
    largest: int
    smallest: int = 1


def with_basis(scene: Scene, basis: str, largest: int) -> Scene:
    """Return the scene with the reduction that a `basis` needs for models of up to the size `largest`.

    For a boom of sections, tolerance and budget of the scene are removed, so that no size is searched.
    """
    solver = scene.sections[0].reduction.solver
    if len(scene.sections) > 1:
        reduction = {"coordinates": RIGID_MODES + largest, "flexibility": True, "estimate": True}
        return scene.vary_sections(lambda part: {"reduction": reduction}, accuracy=None, budget=None)
    if basis == "visited":
        choice = Reduction(basis="eigenmodes", snapshots=9, modes=4, coordinates=min(largest, 36), solver=solver)
    elif basis == "pod":
        choice = Reduction(basis="eigenmodes", positions="nodes", coordinates=min(largest, 30), solver=solver)
    else:
        choice = Reduction(basis="free_modes", flexibility=True, coordinates=largest, solver=solver)
    return scene.vary_sections(lambda part: {"reduction": choice})


def family(scene: Scene, basis: str) -> Family:
    """Return the models of a `scene` that `with_basis` made for the same `basis`.

    ``pod`` and ``visited`` are POD of eigenmodes with the sliders held, at all nodes or at nine positions that the path
    visits.  ``modes`` are free modes without the flexibility of the modes that are left out, ``flexibility`` are free
    modes with this flexibility.
    """
    if len(scene.sections) > 1:
        return _section_family(scene, basis)
    longest = reduce_body(scene, model_of(scene)).model
    if basis == "flexibility":
        return _flexible_family(longest)
    if basis == "modes":
        longest = replace(longest, flexibility=None, enrichment=None)
    return Family(lambda size: pmr.System.of(longest.leading(size)), longest.size)


def _flexible_family(longest: ReducedModel) -> Family:
    """Return models of free modes with flexibility, each with as many enrichment modes as the longest one has."""
    every = extend(longest) if longest.enrichment else longest
    more = every.size - longest.size

    def system_of_size(size: int) -> pmr.System:
        """Return the system of a model with `size` free modes."""
        leading = every if size + more == every.size else replace(truncate(every, size + more), enrichment=None)
        return pmr.System.of(truncate(leading, size) if more else leading)

    omega2 = np.diagonal(longest.K)
    rigid = int(np.sum(omega2 <= MODAL * np.finfo(float).eps * omega2[-1]))  # rigid-body motions have no flexibility
    return Family(system_of_size, longest.size, max(rigid, 1))


def _pod_family(case: FullMotion) -> Family:
    """Return the models of a single body on the POD of its full motion's modal coordinates."""
    (body,) = case.full.reduced.values()
    U, sigma, _ = np.linalg.svd(case.run.bodies[ALONE].q[::SNAPSHOT_INTERVAL].T, full_matrices=False)
    rank = int(np.sum(sigma > sigma[0] * 1e-13))
    return Family(lambda size: pmr.System.of(pmr.project(body, U[:, :size])), rank)


def _section_family(boom: Scene, basis: str) -> Family:
    """Return models of a boom whose size is the number of elastic modes of each section."""
    bodies = reduce_bodies(boom, bodies_of(boom))
    trials = trials_of(boom, {name: body.modal for name, body in bodies.items()})

    def system_of_size(size: int) -> pmr.System:
        """Return the system with `size` elastic modes in each section."""
        modal = trials.models(trials.uniform_sizes(size))
        if basis == "modes":
            modal = {name: _without_flexibility(model) for name, model in modal.items()}
        stressed = any(frame_terms(boom))
        return system_of(boom, {name: simulated_model(model, stressed) for name, model in modal.items()})

    return Family(system_of_size, trials.most_elastic_modes(trials.most))


def _without_flexibility(model: ReducedModel) -> ReducedModel:
    """Return a section's model without the flexibility of the modes that are left out."""
    assert model.carriers is not None  # as of a section
    carriers = replace(model.carriers, flexibility=None, inertia=None, answers=None)
    return replace(model, flexibility=None, enrichment=None, carriers=carriers)


def load(scene: str) -> Scene:
    """Return a scene without recovery of fields, and a planar beam without coordinates along its axis."""
    loaded = pmr.load_scene(scene).model_copy(update={"recovery": None})
    if len(loaded.sections) > 1 or loaded.body.profile is None:
        return loaded
    return loaded.with_keys(body={"profile": {"axial": False}})


@dataclass(frozen=True)
class Reference:
    """Full motion of a scene, its displacements with a far shorter step, and the estimated error of these."""

    case: FullMotion
    displacement: np.ndarray  # y (T, o) in m, at the largest of the steps that are tried
    error: float


@lru_cache(maxsize=2)
def reference(scene: str, steps: tuple[float, ...]) -> Reference:
    """Return the full model's motion, and that with the smallest of `steps`, longest first, times `FINER`."""
    case, finest = FullMotion.simulate(load(scene)), FINER * steps[-1]
    coarser, y = (
        displacement(case.scene, case.full, factor * finest, round(steps[0] / (factor * finest)))
        for factor in (2.0, 1.0)
    )
    return Reference(case, y, relative_error(coarser, y) / 3.0)


def row(scene: str, method: str, steps: list[float], values: list[float]) -> Row:
    """Return errors and times of a method, of spectral radii or of meshes; NaN where a model can't be simulated.

    For a method with r coordinates, each of `values` that its basis can have:

    - ``total.<r>.<factor>``: e_NRMS of all displacements against the reference, with the scene's step times a factor.
    - ``reduction.<r>``: e_NRMS of all displacements against the full model, both with the scene's step.
    - ``energy.<r>``, for a single body: the largest difference from the full model's energy while the slider moves,
      over the largest energy of the full model; 1000 at most.
    - ``reference``: the error of the reference's step; ``scene step`` in s, and the number of ``steps``.
    - ``seconds.offline``: processor time to make all models; ``seconds.step.<r>``, ``seconds.full``: time of one step.

    For ``radii``, with many free modes so that the model's own error is small: ``rho.<radius>.<factor>``, e_NRMS
    against the reference. For ``elements``: ``tip.<elements>``, e_NRMS of the tip against a mesh of twice the largest
    number. ``warnings`` are those of a run with the scene's step.
    """
    truth = reference(scene, tuple(steps))
    case = truth.case
    warnings = warnings_of_response(case.scene, case.full, case.response)
    if method == "radii":
        system = _system_of_many_modes(case.scene)
        errors = {
            f"rho.{rho:g}.{h:g}": relative_error(
                displacement(case.scene, system, h, round(steps[0] / h), rho_inf=rho), truth.displacement
            )
            for rho in values
            for h in steps
        }
    elif method == "elements":
        errors = _errors_of_meshes(case.scene, [int(count) for count in values])
    else:
        errors = _errors_of_method(truth, method, steps, [int(size) for size in values])
    return errors | {"warnings": warnings}


def _errors_of_method(truth: Reference, method: str, steps: list[float], coordinates: list[int]) -> Row:
    """Return errors and times of a method, as `row` describes them."""
    case, scene, count = truth.case, truth.case.scene, truth.case.scene.time.steps
    begin = time.process_time()
    models = _pod_family(case) if method == "trajectory" else family(
        with_basis(scene, method, max(coordinates)), method
    )  # fmt: skip
    systems = {r: models.system_of_size(r) for r in coordinates if models.smallest <= r <= models.largest}
    result = {"seconds.offline": time.process_time() - begin, "seconds.full": case.run.seconds / count}
    result |= {"reference": truth.error, "scene step": scene.time.step, "steps": count}
    for r, system in systems.items():
        for h in steps:
            result[f"total.{r}.{h:g}"] = np.nan
            try:
                y = displacement(scene, system, h, round(steps[0] / h))
            except (pmr.SimulationError, pmr.InputError):
                continue
            result[f"total.{r}.{h:g}"] = relative_error(y, truth.displacement)
        try:
            runs = [run_from_start(system, case.excitation) for _ in range(REPEATS)]
        except (pmr.SimulationError, pmr.InputError):
            continue
        result[f"seconds.step.{r}"] = min(each.seconds for each in runs) / count
        y = evaluate_motion(system, runs[0]).displacement
        result[f"reduction.{r}"] = relative_error(y, case.response.displacement)
        if len(scene.sections) == 1:
            moving = np.abs(case.excitation.path_rate) > 0.0
            off = np.abs(runs[0].energy - case.run.energy)[moving].max(initial=0.0)
            result[f"energy.{r}"] = float(min(off / case.run.energy.max(), 1e3))
    return result


def _errors_of_meshes(scene: Scene, elements: list[int]) -> Row:
    """Return ``tip.<elements>``; NaN where a mesh is too coarse, as with two sliders within one element."""

    def tip(count: int) -> np.ndarray:
        """Return the tip's displacement (T, 1) in m with `count` elements."""
        finer = scene.model_copy(update={"mesh": scene.mesh.model_copy(update={"elements": count})})
        return displacement(finer, _system_of_many_modes(finer), 1.0, 1)[:, -1:]

    finest, errors = tip(2 * max(elements)), {}
    for count in elements:
        try:
            errors[f"tip.{count}"] = relative_error(tip(count), finest)
        except pmr.InputError:
            errors[f"tip.{count}"] = np.nan
    return errors


def _system_of_many_modes(scene: Scene) -> pmr.System:
    """Return a body's model with `MANY` free modes, or all of a coarse beam, and the flexibility of the other modes."""
    size = 2 * (scene.mesh.elements + 1) if scene.body.profile is not None else 10 * MANY
    return pmr.System.of(pmr.reduce(with_basis(scene, "flexibility", min(MANY, size // 2))).reduced)


def tasks(settings: Settings) -> Iterator[dict[str, Any]]:
    """Yield the parameters of all rows; InputError for settings that can't be computed."""
    steps = sorted(settings["steps"], reverse=True)
    for name in settings["scenes"]:
        scene = load(name)
        alone, count = len(scene.sections) == 1, scene.time.steps
        if alone and scene.frame is not None and scene.frame.second_order:
            allowed = "false is allowed for a body alone; studies of kind 'scenes' follow second order"
            raise pmr.InputError("scene", "frame.second_order", scene.frame.second_order, allowed)
        ratios = [count / steps[0], *(steps[0] / factor for factor in steps)]
        if any(ratio != round(ratio) for ratio in ratios) or 1.0 not in steps:
            allowed = f"1 and factors that divide the largest, and that one the {count} steps, are allowed"
            raise pmr.InputError("trade", "steps", settings["steps"], allowed)
        values = {method: sorted(settings["coordinates"]) for method in settings["methods"]}
        if not alone:
            values = {method: values[method] for method in SECTION_BASES if method in values}
        else:
            values["radii"] = settings["radii"]
            if scene.body.profile is not None and scene.mesh.file is None:
                values["elements"] = settings["elements"]
        yield from ({"scene": name, "method": method, "steps": steps, "values": of} for method, of in values.items())


def main(settings: Settings, out: Path, jobs: int) -> list[Chapter]:
    """Compute all scenes and methods and the studies beside, save the errors, and return the chapters of the report.

    Figures: ``<scene>.<method>.<tolerance>``, such as ``"6 x 0.5"``: the fewest coordinates that hold the tolerance
    with any of the steps, and the longest step with which they do, as a multiple of the scene's.
    """
    parameters = list(tasks(settings))
    found = rows(row, parameters, out, jobs)
    results = {(Path(one["scene"]).stem, one["method"]): errors for one, errors in zip(parameters, found, strict=True)}
    figures = {}
    for (scene, method), errors in results.items():
        for tolerance in TOLERANCES if method in NAMES else ():
            best = coarsest_within(errors, tolerance)
            figures[f"{scene}.{method}.{tolerance:g}"] = None if best is None else f"{best[0]} x {best[1]:g}"
    save(out, figures=figures, rows={f"{scene},{method}": errors for (scene, method), errors in results.items()})
    chapters = [chapter(results, figures, settings["coordinates"])]
    for name in settings["studies"]:
        command = [sys.executable, "-m", "pmr", "study", str(STUDIES / f"{name}.toml"), "--out", str(out / name)]
        subprocess.run([*command, "--jobs", str(max(jobs, 1))], check=True)
        chapters.append(study_chapter(FinishedStudy.load(out / name), name))
    return chapters


def trade_points(errors: Row) -> list[tuple[int, float, float]]:
    """Return (coordinates, step as a multiple of the scene's step, error) of each simulated model in a row."""
    split = [(name.split("."), value) for name, value in errors.items() if name.startswith("total.")]
    return [(int(part[1]), float(".".join(part[2:])), value) for part, value in split if not np.isnan(value)]


def coarsest_within(errors: Row, tolerance: float) -> tuple[int, float] | None:
    """Return the fewest coordinates that hold a `tolerance`, and the longest step with which they do; None if none do.

    Steps are multiples of the scene's step.  All shorter steps have to hold the tolerance, too, so that errors of model
    and step that happen to cancel are not counted as accuracy.
    """
    for r in sorted({r for r, _, _ in trade_points(errors)}):
        longest = None
        for _, h, error in sorted(point for point in trade_points(errors) if point[0] == r):
            if error > tolerance:
                break
            longest = h
        if longest is not None:
            return r, longest
    return None


def error_front(times_and_errors: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the points (seconds, error) that no other point beats in both, in increasing order of time."""
    best: list[tuple[float, float]] = []
    for seconds, error in sorted(times_and_errors):
        if not best or error < best[-1][1]:
            best.append((seconds, error))
    return best


Results = Mapping[tuple[str, str], Row]  # rows by scene and method


def chapter(results: Results, figures: Mapping[str, str | None], sizes: list[int]) -> Chapter:
    """Return the chapter of the report about errors and times of reduction methods."""
    scenes = list(dict.fromkeys(scene for scene, _ in results))
    fronts_caption = (
        "Error along the body against the full model with a far shorter step, over the time of one simulation: of each "
        "method the models and steps that none of its others beats in both."
    )
    energy = "Error along the body, and the largest error of the energy while the slider moves, by coordinates."
    offline = tuple(
        (scene.replace("_", " "), *(_offline(results.get((scene, method), {})) for method in NAMES)) for scene in scenes
    )
    return Chapter(
        anchor="trade",
        title="Accuracy against time: methods, sizes and steps",
        headline="How much time an error costs, by method, number of coordinates and step.",
        key_numbers=[KeyNumber(format_input(len(scenes)), "scenes")],
        paragraphs=[
            "Coordinates and steps each have their part of the error. What holds a tolerance here holds it with all "
            "shorter steps too, so that no two parts cancel by chance.",
            "Times are those of the compiled loops, that of a step times the number of steps; offline times are "
            "those of the processor, without the assembly.",
        ],
        notices=Notices(
            warnings=list(dict.fromkeys(str(line) for errors in results.values() for line in errors["warnings"]))
        ),
        blocks=[
            Block(
                "Error over time",
                (drawing("trade-fronts", draw_fronts, fronts_caption, results, scenes),),
                grids=(Grid("Offline time of the largest model.", ("scene", *NAMES.values()), offline),),
            ),
            Block("What holds a tolerance", grids=tuple(_tolerance_grid(results, figures, scene) for scene in scenes)),
            Block(energy, grids=tuple(_energy_grid(results, scene, sizes) for scene in scenes[:2])),
        ],
    )


def _offline(errors: Row) -> str:
    """Return the offline processor time of a row as text; a dash if it has no models."""
    timed = any(name.startswith("seconds.step.") for name in errors)
    return format_quantity(errors["seconds.offline"], "s") if timed else "–"


def _tolerance_grid(results: Results, figures: Mapping[str, str | None], scene: str) -> Grid:
    """Return the table of the number of coordinates and the step by which each method meets a tolerance in a scene."""
    lines = [
        (name, *((figures[f"{scene}.{method}.{limit:g}"] or "–").replace(" x ", " × ") for limit in TOLERANCES))
        for method, name in NAMES.items()
        if (scene, method) in results
    ]
    caption = f"{scene.replace('_', ' ')}: coordinates × step (as a multiple of the scene's) that hold a tolerance."
    return Grid(caption, ("method", *(format_percent(tolerance) for tolerance in TOLERANCES)), tuple(lines))


def _energy_grid(results: Results, scene: str, sizes: list[int]) -> Grid:
    """Return the table of the errors along the body and of the energy, by method and number of coordinates."""

    def cell(errors: Row, r: int) -> str:
        """Return both errors of the model with r coordinates as text; a dash where it has none."""
        names = (f"reduction.{r}", f"energy.{r}")
        known = all(name in errors for name in names)
        return ", ".join(format_percent(errors[name], 2) for name in names) if known else "–"

    lines = [
        (name, *(cell(results[scene, method], r) for r in sizes))
        for method, name in NAMES.items()
        if (scene, method) in results
    ]
    return Grid(f"{scene.replace('_', ' ')}.", ("method", *map(str, sizes)), tuple(lines))


def draw_fronts(results: Results, scenes: list[str]) -> Figure:
    """Draw the front of error over time for each method, in a panel for each scene."""
    lines, gaps = -(-len(scenes) // COLUMNS), {"wspace": 0.05, "hspace": 0.3}
    grid = {"sharex": True, "sharey": True, "gridspec_kw": gaps}
    figure, axes = make_sheet(WIDE, 0.9 + 1.6 * lines, lines, COLUMNS, {"top": 0.7}, **grid)
    every = [point for ax, scene in zip(axes.flat, scenes, strict=False) for point in _draw_panel(ax, results, scene)]
    for ax in axes.flat[len(scenes) :]:
        ax.set_visible(False)
    seconds, errors = np.array(every).T
    log_axis(axes[0, 0], float(errors.min()), 1.0)
    log_x(axes[0, 0], 0.8 * float(seconds.min()), 1.25 * float(seconds.max()))
    for ax in axes[:, 0]:
        ax.set_ylabel("e_NRMS (–)")
    for ax in axes[-1]:
        ax.set_xlabel("Time of one simulation in ms")
    handles = [Line2D([], [], label=label, **curve_style(i, 2.2)) for i, label in enumerate(NAMES.values())]
    figure.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.07, 1.0), ncols=4, borderaxespad=0.25)
    return figure


def _draw_panel(ax: Axes, results: Results, scene: str) -> list[tuple[float, float]]:
    """Draw the front of each method for a scene, and return the points (ms, error) of all fronts.

    All steps are taken to need equal time, whatever their length.
    """
    every = []
    for i, method in enumerate(NAMES):
        errors = results.get((scene, method), {})
        points = [
            (1e3 * errors[f"seconds.step.{r}"] * errors["steps"] / h, error)
            for r, h, error in trade_points(errors)
            if f"seconds.step.{r}" in errors and 0.0 < error < 1.0
        ]
        if points:
            front = error_front(points)
            ax.plot(*np.array(front).T, **curve_style(i, 2.2))
            every += front
    ax.set_title(scene.replace("_", " "), loc="left", pad=3.0)
    return every


if __name__ == "__main__":
    run(main, SETTINGS, __doc__, "Accuracy against time")
