"""Errors that a run estimates without a reference, of the reduction and of the time step, as parts of its summary."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.compare import coverage, estimate, step_advice, step_error
from pmr.compare.summary import Part
from pmr.environment import Clock
from pmr.errors import InputError, SimulationError
from pmr.reduced.model import ReducedModel
from pmr.scene import Scene
from pmr.scene.choice import transverse
from pmr.simulate import Excitation

Array = NDArray[np.float64]


def reduction_error(scene: Scene, reduced: ReducedModel, clock: Clock) -> Part:
    """``estimate``: the reduction's error as the enrichment modes tell it, and what is not in it."""
    excitation, found, failed, left_out = Excitation.of(scene), None, None, list[str]()
    if scene.reduction.estimate and estimate.no_estimate(reduced) is None:
        with clock.stage("estimate"):
            try:
                found = estimate.estimate(reduced, excitation, len(transverse(scene)))
                left_out = coverage.not_covered(reduced, excitation.signals, excitation.stepping)
                left_out += [coverage.BLOWS] * (found.pad_force is None)
            except SimulationError as error:
                failed = str(error)
    figures: dict[str, Any] = {}
    if scene.reduction.estimate:
        figures = {"estimate": estimate.summary(reduced, found, left_out, failed)}
    return Part(figures, estimate.warnings(reduced, excitation.stepping, found) + coverage.warnings(left_out))


def step_part(scene: Scene, reduced: ReducedModel, omega: Array, clock: Clock) -> Part:
    """``step``: the time step's error; `omega` (S, f) rad/s are natural frequencies along the path."""
    excitation = Excitation.of(scene)
    with clock.stage("step"):
        try:
            found = step_error.step_error(reduced, excitation, len(transverse(scene)))
        except (SimulationError, InputError) as error:
            said = [f"the error of the time step is not known: {error}"]
            return Part({"step": step_advice.summary(None, str(error))}, said)
    searched = scene.accuracy is not None  # then the step was chosen by its error
    said = [] if searched else step_advice.warnings(found, excitation.stepping, excitation.signals, omega)
    return Part({"step": step_advice.summary(found)}, said)
