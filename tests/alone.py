"""Functions of `pmr.compare` for a body alone, which they take as the system of one body."""

from collections.abc import Sequence

from pmr import ReducedModel, System
from pmr.compare import estimate as estimates
from pmr.compare import step_error as steps
from pmr.compare.evaluation import SimulatedSystem
from pmr.compare.outputs import Outputs, outputs_of_run, run_from_start
from pmr.compare.trials import Trials
from pmr.files.arrays import Array
from pmr.scene.keys import ALONE, SLIDER
from pmr.simulation import Excitation
from pmr.system.assembly import Assembly
from pmr.system.body import SlidingBody


def estimate(model: ReducedModel, excitation: Excitation) -> estimates.Estimate:
    """Estimate the error of a reduced model of a body alone."""
    return estimates.estimate_error({ALONE: model}, SimulatedSystem(System.of(model), excitation))


def step_error(body: SlidingBody, excitation: Excitation) -> steps.StepError:
    """Measure the error of the time step for a body alone."""
    return steps.step_error(System.of(body), excitation)


def outputs(body: SlidingBody, excitation: Excitation, every: int = 1) -> Outputs:
    """Outputs of a body alone from rest, at each `every`-th step."""
    system = System.of(body)
    return outputs_of_run(system, run_from_start(system, excitation), excitation, every)


def frequencies(model: ReducedModel, s: Array, count: int) -> Array:
    """The lowest natural frequencies (S, count) in Hz of a body alone at the path coordinates s (S,) in m."""
    system = System.of(model)
    return Assembly(system).frequencies(system.side_coordinates({SLIDER: s}), count)


def trials(model: ReducedModel, excitation: Excitation, kinds: Sequence[str] = ("beam", "tip")) -> Trials:
    """Trials of coordinates for a body alone, judged by errors of these kinds."""
    return Trials({ALONE: model}, lambda models: System.of(models[ALONE]), excitation, kinds)
