"""The search for the model and the step of a scene with a tolerance or a budget, and its part of summary.json."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from pmr.compare import other_runs
from pmr.compare.accuracy_search import (
    explain_trial,
    find_best_affordable,
    find_sufficient_trial,
    is_within,
    reduce_cost,
    worst_ratio,
)
from pmr.compare.motion import reason_without_estimate
from pmr.compare.trials import Trial, Trials
from pmr.compare.trust import LOAD_JUMPS, SLIDER_IMPACTS
from pmr.errors import InputError, percent, two_digits
from pmr.scene import Scene
from pmr.scene.keys import ALONE
from pmr.scene.mechanism import frame_terms
from pmr.simulation import Excitation
from pmr.system.attachment import simulated_model
from pmr.system.from_scene import system_of
from pmr.system.reduced_model import ReducedModel
from pmr.system.system import System

#: Largest share of a tolerance that the error of the mesh may take: a larger error is ignored by the search.
MOST_OF_MESH = 0.9
#: Number of coordinates of the reduction of a single body, besides enrichment modes; many scenes share this reduction.
COORDINATES = 6
_CALLED = {
    "beam": "displacements",
    "tip": "the tip's",
    "pad_force": "forces of sliders and pads",
    "velocity": "velocities",
    "probe": "values at probes",
    "cylinder_force": "forces of cylinders",
}
_NEEDED = {"probe": "probes", "pad_force": "pads", "cylinder_force": "cylinders"}


@dataclass(frozen=True)
class Choice:
    """The model and the step chosen for a scene, and their errors."""

    scene: Scene  # with the chosen step and, for a single body, the chosen coordinates
    models: Mapping[str, ReducedModel]  # by name of the body (`ALONE` or sections), without cylinder modes
    trial: Trial
    mesh: Mapping[str, float] | None = None  # error of the mesh by kind, a fraction; None if unknown
    mesh_reason: str | None = "the scene leaves it out"  # why that error is unknown
    reasons: tuple[str, ...] = ()  # clauses that say why this model and this step were chosen
    seconds: float = 0.0  # wall time of the search

    @property
    def total_errors(self) -> dict[str, float]:
        """Sum of the errors of reduction, step and mesh (if that is known), a fraction, by kind of output."""
        return {kind: size + (self.mesh or {}).get(kind, 0.0) for kind, size in self.trial.total.items()}

    @property
    def meets_tolerance(self) -> bool:
        """Whether the sum of errors is within the tolerance and the error of the step is settled.

        True if the scene has no tolerance.
        """
        accuracy = self.scene.accuracy
        return accuracy is None or (self.trial.settled and max(self.total_errors.values()) <= accuracy.tolerance)


def prepare_scene(scene: Scene) -> Scene:
    """Scene with `COORDINATES` coordinates, whose reduction contains all models that the search can choose.

    The scene is returned unchanged if it has no tolerance or budget, and for booms of several sections: these have
    their own coordinates and more enrichment modes (`pmr.reduction.from_scene`).
    """
    if scene.goal is None or len(scene.bodies) > 1:
        return scene
    return scene.with_keys(reduction={"coordinates": COORDINATES})


def trials_of(scene: Scene, models: Mapping[str, ReducedModel]) -> Trials:
    """Trials of all smaller models that the reductions `models` of a scene's bodies contain, with any steps."""
    kinds = ("beam", "tip") if scene.goal is None else scene.goal.outputs
    return Trials(models, partial(_join_models, scene), Excitation.from_scene(scene), kinds)


def _join_models(scene: Scene, models: Mapping[str, ReducedModel]) -> System:
    """System that is simulated, from the `models` of its bodies by name."""
    stressed = any(frame_terms(scene))
    return system_of(scene, {name: simulated_model(model, stressed) for name, model in models.items()})


class Search:
    """Search for the model and the step of a scene with a tolerance or a budget; `trial` is the best trial so far.

    `models` are the reductions, on free modes, of the bodies by name; the scene is the result of `prepare_scene`.
    Raises InputError if errors of these models, or of the scene's chosen outputs, can't be estimated, or if every model
    exceeds the scene's budget.
    """

    def __init__(self, scene: Scene, models: Mapping[str, ReducedModel]) -> None:
        """Begin the search with `models`, the reductions of the bodies by name, and find the trial that is run.

        Without a budget, this trial meets the scene's tolerance, or comes closest to it if no trial does.  With a
        budget, it has the smallest error that the budget allows.  Raises InputError as the class says.
        """
        begin, self.scene = time.perf_counter(), scene
        if why := reason_without_estimate(models):
            allowed = f"the search needs an estimate of the error, and there is none: {why}"
            raise InputError("scene", _goal_key(scene), None, allowed)
        self.trials = trials = trials_of(scene, models)
        if lacking := [kind for kind in trials.wanted if kind not in trials.kinds]:
            needed = _NEEDED.get(lacking[0], "such outputs")
            raise _outputs_error(scene, f"no {lacking[0]}, or a scene with {needed}, is allowed")
        if "pad_force" in trials.wanted and trials.has_impulsive_forces:
            allowed = "no pad_force, or a path without kinks, is allowed"
            raise _outputs_error(scene, f"{allowed}; there is no estimate of {SLIDER_IMPACTS}")
        self._coarsest = trials.fewest_steps(scene.recovery.every if scene.recovery else None)
        self.mesh: Mapping[str, float] | None = None
        if scene.budget is not None:
            self.trial = find_best_affordable(trials, scene.budget, self._coarsest)
        else:
            sizes = trials.own if len(trials.own) > 1 else trials.uniform_sizes(scene.reduction.coordinates)
            self.trial = find_sufficient_trial(trials, sizes, scene.time.steps, self._allowed_errors)
        unknown = {} if self.trial.estimate is None else self.trial.estimate.unknown
        if "pad_force" in trials.wanted and unknown.get("pad_force") == LOAD_JUMPS:
            allowed = "no pad_force, or loads that set in smoothly, are allowed"
            raise _outputs_error(scene, f"{allowed}; there is no estimate of {LOAD_JUMPS}")
        self._seconds = time.perf_counter() - begin

    @property
    def _allowed_errors(self) -> dict[str, float]:
        """Errors, by kind of output, that reduction and step may have together: the tolerance less the mesh's error.

        The error of the mesh is not subtracted if it is unknown, or if it is more than `MOST_OF_MESH` of the tolerance:
        no reduction or step could then make up for it.
        """
        assert self.scene.accuracy is not None
        tolerance, taken = self.scene.accuracy.tolerance, self.mesh or {}
        if max(taken.values(), default=0.0) > MOST_OF_MESH * tolerance:
            taken = {}
        return {kind: tolerance - taken.get(kind, 0.0) for kind in self.trials.wanted}

    def compare_meshes(self, other: other_runs.OtherMesh, on_other: Mapping[str, ReducedModel]) -> Search:
        """Compute the error of the mesh, and return this search.

        From then on, the search subtracts this error from the tolerance.  `other` is the result of
        `scene_on_other_mesh`.  `on_other` are the reductions of the bodies of the scene on the other mesh, by name.
        Raises InputError or SimulationError as for `pmr.simulation.SystemSimulator`.
        """
        trial = self.trial
        theirs = trials_of(_with_step(self.scene, trial.steps), on_other)
        self.mesh = other_runs.mesh_errors(self.trials, theirs, trial.sizes, trial.steps, other.share)
        return self

    def choose(self, mesh_reason: str | None) -> Choice:
        """Return the best trial as the choice, with the reasons for it.

        With a tolerance, the search goes on first: it ends without coordinates and steps that the tolerance does not
        need.  `mesh_reason` says why the error of the mesh is unknown; None if it is known.  Raises InputError or
        SimulationError as for `pmr.simulation.SystemSimulator`.
        """
        begin, trials = time.perf_counter(), self.trials
        if self.scene.budget is None:
            self.trial = find_sufficient_trial(trials, self.trial.sizes, self.trial.steps, self._allowed_errors)
            if is_within(self.trial, self._allowed_errors):
                self.trial = reduce_cost(trials, self.trial, self._allowed_errors, self._coarsest)
        trial, chosen = self.trial, _with_step(self.scene, self.trial.steps)
        if ALONE in trials.models(trial.sizes):
            chosen = chosen.with_keys(reduction={"coordinates": trial.coordinates})
        if self.scene.budget is None:
            why = tuple(explain_trial(trials, trial, self._coarsest, self._allowed_errors))
        else:
            took = trials.seconds_per_step(trial.sizes)
            ratio = two_digits(self.scene.time.end / (took * trial.steps))
            why = (
                f"{trial.coordinates} coordinates are what the budget allows",
                f"a step takes {two_digits(took * 1e6)} us here: {ratio} times real time",
            )
        seconds = self._seconds + time.perf_counter() - begin
        return Choice(chosen, trials.models(trial.sizes), trial, self.mesh, mesh_reason, why, seconds)


def scene_on_other_mesh(scene: Scene, trial: Trial) -> other_runs.OtherMesh:
    """Scene with a trial's step on another mesh, for an estimate of the error of the scene's own mesh.

    A single body gets `COORDINATES` coordinates, so that most trials share one scene.  If the trial has more
    coordinates, this number is doubled until it is large enough.  Raises an `InputError` with the reason if there is no
    other mesh.
    """
    other = other_runs.other_mesh(_with_step(scene, trial.steps))
    if len(scene.bodies) > 1:
        return other
    coordinates = COORDINATES
    while coordinates < trial.coordinates:
        coordinates *= 2
    changed = other.scene.with_keys(reduction={"coordinates": coordinates}, accuracy=None, budget=None)
    return replace(other, scene=changed)


def accuracy_summary(choice: Choice) -> dict[str, Any]:
    """Entries ``accuracy`` and ``budget`` of summary.json.

    ``accuracy`` has ``tolerance``, ``outputs``, ``holds`` (whether the sum of errors is within the tolerance),
    ``chosen.{coordinates,step}``, for booms also ``chosen.sections``, ``reasons``, and ``seconds`` of the search.
    ``budget`` has the errors of ``reduction``, ``step`` and ``mesh`` by kind of output (fractions, None if unknown) and
    their ``sum``.  Its ``first`` is the name of the largest of the three errors, to be improved first.  Its
    ``mesh_reason`` says why the error of the mesh is unknown.
    """
    trial, goal = choice.trial, choice.scene.goal
    assert goal is not None  # as of every choice
    sizes = {name: model.size for name, model in choice.models.items()}
    parts = {"reduction": trial.reduction, "step": trial.step} | ({"mesh": choice.mesh} if choice.mesh else {})
    of_bodies = {} if ALONE in sizes else {"sections": sizes}
    accuracy = {
        "tolerance": choice.scene.accuracy.tolerance if choice.scene.accuracy else None,
        "outputs": list(goal.outputs),
        "holds": choice.meets_tolerance,
        "chosen": {"coordinates": trial.coordinates, **of_bodies, "step": choice.scene.time.step},
        "reasons": list(choice.reasons),
        "seconds": choice.seconds,
    }
    budget: dict[str, Any] = {name: _none_if_unknown(part) for name, part in parts.items()}
    budget |= {
        "mesh": choice.mesh,
        "mesh_reason": choice.mesh_reason,
        "sum": _none_if_unknown(choice.total_errors),
        "first": max(parts, key=lambda name: max(parts[name].values())),
    }
    return {"accuracy": accuracy, "budget": budget}


def _none_if_unknown(errors: Mapping[str, float]) -> dict[str, float | None]:
    """Errors by kind, with None for errors that are not finite and therefore unknown."""
    return {kind: size if np.isfinite(size) else None for kind, size in errors.items()}


def accuracy_warnings(choice: Choice) -> list[str]:
    """Warnings that an error of the chosen model exceeds the tolerance of the scene.

    Three errors are compared with the tolerance: that of reduction and step, that of the mesh, and the sum of both.
    The list is empty if all three are within the tolerance and the error of the step is settled.  It is also empty if
    the scene has no tolerance.
    """
    accuracy, trial = choice.scene.accuracy, choice.trial
    if accuracy is None:
        return []
    limit, lines = percent(accuracy.tolerance, "their size"), list[str]()
    allowed = dict.fromkeys(trial.total, accuracy.tolerance)
    if not is_within(trial, allowed):
        model = f"{trial.coordinates} coordinates with steps of {choice.scene.time.step:.3g} s"
        larger = "reduction" if worst_ratio(trial.reduction, allowed) >= worst_ratio(trial.step, allowed) else "step"
        cause = f"most of it by the {larger}" if trial.settled else "and shorter steps do not settle it"
        sizes = _list_errors(accuracy.tolerance, trial.total)
        lines.append(f"the tolerance of {limit} isn't held: {model} are off by {sizes}, {cause}")
    beyond = {kind: size for kind, size in (choice.mesh or {}).items() if size > accuracy.tolerance}
    if beyond:
        sizes = _list_errors(accuracy.tolerance, beyond)
        lines.append(f"the mesh can't hold the tolerance of {limit}: it is off by {sizes}; shorter cells help")
    elif not lines and not choice.meets_tolerance:
        sizes = _list_errors(accuracy.tolerance, choice.total_errors)
        of_mesh = f"of which the mesh causes {percent(max((choice.mesh or {}).values()), 'their size')}"
        total = f"the sum of all errors is {sizes}, {of_mesh}"
        lines.append(f"the tolerance of {limit} isn't held: {total}; shorter cells help")
    return lines


def _goal_key(scene: Scene) -> str:
    """Key of the scene's table that asks for the search: ``accuracy`` or ``budget``."""
    return "budget" if scene.accuracy is None else "accuracy"


def _outputs_error(scene: Scene, allowed: str) -> InputError:
    """Return the error of the key ``accuracy.outputs`` or ``budget.outputs``; `allowed` says what is allowed."""
    return InputError("scene", f"{_goal_key(scene)}.outputs", list(scene.goal.outputs if scene.goal else ()), allowed)


def _with_step(scene: Scene, steps: int) -> Scene:
    """Scene with `steps` equal steps up to its end."""
    return scene.with_keys(time={"step": scene.time.end / steps})


def _list_errors(tolerance: float, errors: Mapping[str, float]) -> str:
    """The `errors`, fractions by kind of output, as words; one above the `tolerance` is never rounded down to it."""
    listed, limit = list[str](), percent(tolerance, "their size")
    for kind, error in errors.items():
        words = percent(error, "their size")
        listed.append(f"{'a little more' if error > tolerance and words == limit else words} in {_CALLED[kind]}")
    return ", ".join(listed)
