r"""The fewest coordinates of a boom's sections that hold an error, or the best ones within a number of them.

One reduction of each section holds all smaller ones.  Errors are those beside a model that has all of its modes and
attachment modes for the loads which sections bear (`pmr.compare.boom_estimate`), with the margin of an estimate.  The
search begins with the fewest elastic modes, as many in every section, then takes away one by one where the tolerance
allows it; within a budget it adds them one by one where that helps most.  The time step stays as it is given: both
models take it.  Where pads push all models take the parts of a step that those of the scene ask for: what is compared
is the reduction, not how each lands.  What is found is judged by the estimate of its own run; where that is beyond the
tolerance, the search goes on with as much less.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pmr.compare import errors
from pmr.compare.accuracy.search import TRIES
from pmr.compare.boom_estimate import estimate, response_from_rest, run_from_rest, with_loads_answered
from pmr.compare.booms import quantities
from pmr.compare.estimate import MARGIN
from pmr.errors import InputError, SimulationError
from pmr.reduced.attachment import with_cylinder_modes
from pmr.reduced.model import ReducedModel
from pmr.reduced.truncation import extended, truncated
from pmr.scene import Boom
from pmr.simulation import Excitation
from pmr.simulation.contact_step import as_made
from pmr.simulation.native.multibody_march import contact_frequency
from pmr.system.booms import system_of
from pmr.system.system import System, SystemTrajectory

Sizes = Mapping[str, int]


@dataclass(frozen=True)
class BoomChoice:
    """The model of each section, and what they are off by together."""

    models: Mapping[str, ReducedModel]  # on free modes
    errors: Mapping[str, float]  # by kind of output: fractions, with margin
    holds: bool  # whether these are within the tolerance
    seconds: float  # of the search


class _Search:
    """Errors of the smaller models that one reduction of each section holds."""

    def __init__(self, boom: Boom, models: Mapping[str, ReducedModel], excitation: Excitation) -> None:
        self._boom, self._given, self._known = boom, excitation, dict[tuple[int, ...], dict[str, float]]()
        self.wholes = {name: extended(model) for name, model in models.items()}
        self.fewest = {name: 1 + _rigid(model) for name, model in self.wholes.items()}
        self.of_cylinders = sum(model.cylinder_modes for model in _driven(self.wholes).values())
        self.most = {name: model.size - 1 for name, model in self.wholes.items()}
        whole = system_of(boom, _driven(self.wholes))
        self._excitation = excitation = in_parts(system_of(boom, _driven(models)), excitation)
        self._best = response_from_rest(with_loads_answered(whole, self.wholes, excitation), excitation)

    def models(self, sizes: Sizes) -> dict[str, ReducedModel]:
        return {name: truncated(model, sizes[name]) for name, model in self.wholes.items()}

    def of(self, sizes: Sizes) -> dict[str, float]:
        """By kind of output that is asked for; infinite where there is no motion."""
        key, asked = tuple(sizes.values()), self._boom.ordered
        assert asked is not None
        if key not in self._known:
            try:
                found = response_from_rest(system_of(self._boom, _driven(self.models(sizes))), self._excitation)
                pair, measured = {"reduced": found, "full": self._best}, quantities(self._boom, found)
                off = errors.errors(pair, errors.relative_error, quantities=measured)["reduced_vs_full"]
                self._known[key] = {kind: MARGIN * off[kind] for kind in asked.outputs}
            except SimulationError:
                self._known[key] = dict.fromkeys(asked.outputs, float("inf"))
        return self._known[key]

    def judged(self, sizes: Sizes) -> dict[str, float]:
        """The same, no less than what a run of these models estimates of itself, where it does."""
        try:
            modal = self.models(sizes)
            system = system_of(self._boom, _driven(modal))
            run = run_from_rest(system, self._given)
            found = estimate(self._boom, modal, system, in_parts(system, self._given, run), run).errors
        except SimulationError:  # after impacts that decide
            return self.of(sizes)
        return {kind: max(share, found.get(kind, 0.0)) for kind, share in self.of(sizes).items()}

    def worst(self, sizes: Sizes) -> float:
        return max(self.of(sizes).values())

    def elastic(self, count: int) -> dict[str, int]:
        """As many elastic modes in each section, as far as there are."""
        return {name: min(self.fewest[name] - 1 + count, self.most[name]) for name in self.wholes}


def choose(boom: Boom, models: Mapping[str, ReducedModel], excitation: Excitation) -> BoomChoice:
    """For a boom's `accuracy` or `budget`, of sections with enrichment modes.

    Raises InputError if there are no such modes, or fewer coordinates are allowed than a motion needs; SimulationError
    if the motion of all modes can't be computed.
    """
    begin = time.perf_counter()
    if lacking := [name for name, model in models.items() if model.enrichment is None]:
        raise InputError("scene", "accuracy" if boom.accuracy else "budget", None, _NO_MODES.format(lacking[0]))
    search = _Search(boom, models, excitation)
    if boom.accuracy is not None:
        sizes, found, holds = _holding(search, boom.accuracy.tolerance)
    else:
        assert boom.budget is not None
        sizes, holds = _best(search, boom.budget.coordinates - search.of_cylinders), True
        found = search.judged(sizes)
    return BoomChoice(search.models(sizes), found, holds, time.perf_counter() - begin)


_NO_MODES = "a mesh with more modes is allowed: there are none beyond the coordinates of {}"


def in_parts(system: System, excitation: Excitation, run: SystemTrajectory | None = None) -> Excitation:
    """The excitation with the parts of a step that a run of the system takes, where pads push."""
    omega = contact_frequency(system, excitation)
    if omega == 0.0:
        return excitation
    made = (run or run_from_rest(system, excitation)).parts
    return excitation.with_stepping(as_made(excitation.stepping, made, omega))


def _holding(search: _Search, tolerance: float) -> tuple[dict[str, int], dict[str, float], bool]:
    """The fewest that hold by their own estimate, too, with their errors; else the last ones tried, and False."""
    less = tolerance
    for _ in range(TRIES):
        sizes = _fewest(search, less)
        found, seen = search.judged(sizes), search.worst(sizes)
        if (worst := max(found.values())) <= tolerance or seen > less:
            break
        less = 0.99 * min(less, seen) * tolerance / worst
    return sizes, found, worst <= tolerance


def _fewest(search: _Search, tolerance: float) -> dict[str, int]:
    count, top = 1, max(search.most[name] - search.fewest[name] + 1 for name in search.wholes)
    while count < top and search.worst(search.elastic(count)) > tolerance:
        count += 1
    sizes = search.elastic(count)
    for name in sizes:
        while sizes[name] > search.fewest[name]:
            fewer = sizes | {name: sizes[name] - 1}
            if search.worst(fewer) > tolerance:
                break
            sizes = fewer
    return sizes


def _best(search: _Search, coordinates: int) -> dict[str, int]:
    sizes = dict(search.fewest)
    if sum(sizes.values()) > coordinates:
        least = sum(sizes.values()) + search.of_cylinders
        allowed = f"at least {least} are needed: rigid-body motions, one mode of each section, those of cylinders"
        raise InputError("scene", "budget.coordinates", coordinates + search.of_cylinders, allowed)
    while sum(sizes.values()) < coordinates:
        more = [sizes | {name: size + 1} for name, size in sizes.items() if size < search.most[name]]
        if not more:
            break
        sizes = min(more, key=search.worst)
    return sizes


def _driven(models: Mapping[str, ReducedModel]) -> dict[str, ReducedModel]:
    """As they are simulated: with the modes of their cylinders."""
    return {name: with_cylinder_modes(model) for name, model in models.items()}


def _rigid(model: ReducedModel) -> int:
    stiffness = np.diagonal(model.K)
    return int(np.count_nonzero(stiffness <= 1e-9 * stiffness[-1]))


def summary(boom: Boom, choice: BoomChoice) -> dict[str, Any]:
    """``accuracy`` and ``budget`` of summary.json, as of one body; `chosen` has what each section's reduction takes."""
    asked, sizes = boom.ordered, {name: model.size for name, model in choice.models.items()}
    assert asked is not None
    count = sum(model.size for model in _driven(choice.models).values())
    chosen = {"coordinates": count, "sections": sizes, "step": boom.time.step}
    accuracy = {
        "tolerance": boom.accuracy.tolerance if boom.accuracy else None,
        "outputs": list(asked.outputs),
        "holds": choice.holds,
        "chosen": chosen,
        "seconds": choice.seconds,
    }
    return {"accuracy": accuracy, "budget": {"reduction": dict(choice.errors)}}


def warnings(boom: Boom, choice: BoomChoice) -> list[str]:
    """A line where the tolerance isn't held."""
    if boom.accuracy is None or choice.holds:
        return []
    off = ", ".join(f"{100.0 * error:.2g} % in {kind}" for kind, error in choice.errors.items())
    return [f"the tolerance of {100.0 * boom.accuracy.tolerance:g} % isn't held: all modes there are leave {off}"]
