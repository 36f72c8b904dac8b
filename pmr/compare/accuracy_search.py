"""Search for the model and the step with which the errors of a run are within a tolerance or a budget.

The search begins with the scene's own step and coordinates.  It takes shorter steps and twice as many coordinates until
the estimated error of the reduction and the error of the step together are within the tolerance.  Then it leaves out
what is not needed: coordinates first, then every other step.  With a budget, the coordinates follow from the budget,
and the step is the longest one whose error is no larger than that of the reduction.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from pmr.compare.step_error import ROUGH
from pmr.compare.trials import Sizes, Trial, Trials
from pmr.errors import InputError, percent, two_digits
from pmr.scene.run_settings import Budget

Allowed = Mapping[str, float]  # error by kind of output, a fraction

#: An error of step or reduction need not be made smaller if its ratio to the allowed error is at most this.
HALF = 0.5
#: Largest factor by which an error decreases when the step is halved: the scheme is of second order.
SECOND_ORDER = 4.0


def worst_ratio(errors: Mapping[str, float], allowed: Allowed) -> float:
    """Largest ratio of an error in `errors` to the allowed error, over all kinds of outputs in `allowed`."""
    return max(errors[kind] / size for kind, size in allowed.items())


def is_within(trial: Trial, allowed: Allowed) -> bool:
    """Whether the sum of a trial's errors of reduction and step is allowed, and the error of the step is settled."""
    return trial.settled and worst_ratio(trial.total, allowed) <= 1.0


def find_sufficient_trial(trials: Trials, sizes: Sizes, steps: int, allowed: Allowed) -> Trial:
    """Trial whose errors are allowed, found by ever shorter steps and more coordinates; the best one if there is none.

    The search begins with these `sizes` and `steps`.  Whether there are too few coordinates is decided only by runs
    whose steps resolve the motion; other runs show nothing about it.
    """
    tried = list[Trial]()
    while True:
        finer, coarse = 2 * steps <= trials.most_steps, _step_ratio(trials, sizes, steps, allowed)
        if coarse <= 1.0 or not finer or trials.is_resolved(sizes, steps):
            larger, few = trials.double_sizes(sizes), worst_ratio(trials.reduction_errors(sizes, steps), allowed)
            if coarse <= 1.0 or not finer:
                tried.append(trial := trials.estimate_trial(sizes, steps))
                if is_within(trial, allowed):
                    return trial
            # with a shorter step, the estimate of the reduction is better
            grows = finer and not np.isfinite(few) and not trials.has_pushing_contacts
            if few > HALF and larger != sizes and (few >= coarse or not finer) and not grows:
                sizes = larger
                continue
            if not finer or few > 1.0 >= coarse and not grows:
                return min(tried, key=lambda candidate: worst_ratio(candidate.total, allowed))
        halvings = np.ceil(np.log(coarse / HALF) / np.log(SECOND_ORDER)) if np.isfinite(coarse) else 1.0
        steps <<= int(np.clip(halvings, 1.0, np.log2(trials.most_steps / steps)))


def _step_ratio(trials: Trials, sizes: Sizes, steps: int, allowed: Allowed) -> float:
    """Largest ratio of the error of the step to the allowed error, for models of these sizes in a run of `steps` steps.

    The ratio is more than 1 if the error of the step is not settled.
    """
    size = worst_ratio(trials.step_errors(sizes, steps), allowed)
    return size if trials.is_settled(sizes, steps) else max(size, 1.0 + HALF)


def reduce_cost(trials: Trials, trial: Trial, allowed: Allowed, coarsest: int) -> Trial:
    """Trial whose errors are allowed, with the fewest coordinates possible and then with the fewest steps.

    The search begins with `trial`; `coarsest` is the smallest number of steps that is tried.
    """

    def suits(reduction: Mapping[str, float], step: Mapping[str, float]) -> bool:
        """Whether errors of reduction and step together are allowed."""
        return worst_ratio({kind: size + step[kind] for kind, size in reduction.items()}, allowed) <= 1.0

    fewest = _fewest_modes(trials, trial, allowed)
    # the model's own estimate of its error may be a little larger
    for sizes in (fewest, *trials.neighbouring_sizes(fewest, 1)):
        if suits(trials.reduction_errors(sizes, trial.steps), trial.step):
            thinner = trials.estimate_trial(sizes, trial.steps)
            if is_within(thinner, allowed):
                return _longest_steps(trials, thinner, coarsest, suits)
    return _longest_steps(trials, trial, coarsest, suits)


def find_best_affordable(trials: Trials, budget: Budget, coarsest: int) -> Trial:
    """Trial with the smallest error within a budget: of coordinates, of the time of a step, or of real time.

    If the budget limits coordinates or the time of a step, the trial has the most coordinates possible.  Its step is
    the longest one whose error does not exceed that of the reduction.  If the budget is real time, trials with
    `coarsest` steps and more are compared; each has the most coordinates for which there is time.  Raises InputError if
    the smallest model exceeds the budget.
    """
    key = "microseconds_per_step" if budget.real_time is None else "real_time"
    if budget.coordinates is not None:
        return _balance_errors(trials, _most_coordinates(trials, budget.coordinates), coarsest)
    if budget.microseconds_per_step is not None:
        sizes = _largest_sizes(trials, 1e-6 * budget.microseconds_per_step)
        options = [] if sizes is None else [_balance_errors(trials, sizes, coarsest)]
    else:
        options = list(_real_time_trials(trials, budget.real_time or 1.0, coarsest))
    if not options:
        took = two_digits(1e6 * trials.seconds_per_step(trials.uniform_sizes(trials.least)))
        allowed = f"the smallest model takes {took} us a step here"
        raise InputError("scene", f"budget.{key}", getattr(budget, key), allowed)
    return min(options, key=lambda trial: max(trial.total.values()))


def explain_trial(trials: Trials, trial: Trial, coarsest: int, allowed: Allowed) -> Iterator[str]:
    """Yield a clause on the reason for the trial's coordinates, and one on the reason for its number of steps.

    `coarsest` is the smallest number of steps that follow path and loads; `allowed` are the errors that reduction and
    step may have together.
    """
    r, steps = trial.coordinates, trial.steps
    coarse = trials.fewest_resolving_steps(steps)

    def error_of_fewer(sizes: Sizes) -> float:
        """Largest difference, a fraction, in any kind of output between models of these `sizes` and the trial."""
        return max(trials.difference_to_trial(trial, sizes, coarse).values())

    if fewer := min(trials.neighbouring_sizes(trial.sizes, -1), key=error_of_fewer, default=None):
        clause = f"{r} coordinates: with {r - 1} the reduction alone is off by {percent(error_of_fewer(fewer))}"
        spared = {
            kind: size + trial.step[kind] for kind, size in trials.difference_to_trial(trial, fewer, coarse).items()
        }
        unsettled = worst_ratio(spared, allowed) <= 1.0 and not trials.estimate_trial(fewer, steps).settled
        yield f"{clause}, and the error of {steps} steps is not settled" if unsettled else clause
    else:
        yield f"{r} coordinates: all rigid-body modes, and one mode at least"
    if steps > coarsest:
        half = f"half as many by {1.0 / ROUGH:.2g} to {SECOND_ORDER:g} times as much"
        yield f"{steps} steps: they are off by {percent(max(trial.step.values()))}, and {half}"
    elif trials.has_pushing_contacts:
        yield f"{steps} steps: fewer would take as many parts where pads push"
    else:
        yield f"{steps} steps: fewer don't follow path and loads"


def _fewest_modes(trials: Trials, trial: Trial, allowed: Allowed) -> Sizes:
    """Smallest sizes whose models are still within the `allowed` errors at the step of the trial.

    The error of smaller models is `Trials.difference_to_trial`.  The sum of this error and the error of the trial's
    step has to be allowed.  Modes are left out of all bodies first, then of each body by itself.  The differences are
    those of runs with the fewest steps that resolve the motion.
    """
    margin = {kind: size - trial.step[kind] for kind, size in allowed.items()}
    steps = trials.fewest_resolving_steps(trial.steps)

    def enough(sizes: Sizes) -> bool:
        """Whether models of these `sizes` differ little enough from those of the trial.

        The sum of the difference and the error of the trial's step must not exceed the `allowed` errors.
        """
        return worst_ratio(trials.difference_to_trial(trial, sizes, steps), margin) <= 1.0

    low, high = trials.least - 1, trials.most_elastic_modes(trial.sizes)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if enough(trials.cap_sizes(trial.sizes, middle)) else (middle, high)
    sizes = trials.cap_sizes(trial.sizes, high)
    for body in range(len(sizes) if len(sizes) > 1 else 0):
        while fewer := [of for of in trials.neighbouring_sizes(sizes, -1) if of[body] < sizes[body] and enough(of)]:
            sizes = fewer[0]
    return sizes


def _longest_steps(
    trials: Trials, trial: Trial, coarsest: int, suits: Callable[[Mapping[str, float], Mapping[str, float]], bool]
) -> Trial:
    """Trial with the fewest steps with which its errors are allowed, found by halving the number of steps.

    `suits` says whether errors of reduction and step, by kind, are allowed; `coarsest` is the smallest number of steps.
    """
    while trial.steps > coarsest:
        least = {kind: size / ROUGH for kind, size in trial.step.items()}  # least error with half as many steps
        fewer = trial.steps // 2
        if not suits(trial.reduction, least) or not suits(trial.reduction, trials.step_errors(trial.sizes, fewer)):
            break
        longer = trials.estimate_trial(trial.sizes, fewer)
        if not longer.settled or not suits(longer.reduction, longer.step):
            break
        trial = longer
    return trial


def _balance_errors(trials: Trials, sizes: Sizes, coarsest: int) -> Trial:
    """Trial with the longest step whose error does not exceed the error of the reduction.

    The models have the given `sizes`.  If no step is that accurate, the trial has the most steps that a run may have.
    The run has at least `coarsest` steps.
    """

    def suits(reduction: Mapping[str, float], step: Mapping[str, float]) -> bool:
        """Whether the largest error of the step is no more than that of the reduction."""
        return max(step.values()) <= max(reduction.values())

    trial = trials.estimate_trial(sizes, trials.excitation.stepping.steps)
    while not (trial.settled and suits(trial.reduction, trial.step)) and 2 * trial.steps <= trials.most_steps:
        trial = trials.estimate_trial(sizes, 2 * trial.steps)
    return _longest_steps(trials, trial, coarsest, suits)


def _real_time_trials(trials: Trials, ratio: float, coarsest: int) -> Iterator[Trial]:
    """Yield trials with `coarsest` steps, twice as many, and so on; each has the largest model that is fast enough.

    A model is fast enough if it is simulated `ratio` times as fast as real time.
    """
    steps = coarsest
    while steps <= trials.most_steps:
        sizes = _largest_sizes(trials, trials.excitation.stepping.end / (steps * ratio))
        if sizes is None:
            return
        yield trials.estimate_trial(sizes, steps)
        steps *= 2


def _largest_sizes(trials: Trials, seconds: float) -> Sizes | None:
    """Largest sizes of models with which a step takes at most `seconds`.

    All bodies have the same number of elastic modes; a body with fewer has all of them.  The result is None if a step
    takes longer even with the fewest modes.
    """
    low, high = trials.least - 1, trials.most_elastic_modes(trials.most) + 1
    middle = high - 1
    while high - low > 1:  # begins with all modes: most budgets of time are generous
        fits = trials.seconds_per_step(trials.uniform_sizes(middle)) <= seconds
        low, high = (middle, high) if fits else (low, middle)
        middle = (low + high) // 2
    return trials.uniform_sizes(low) if low >= trials.least else None


def _most_coordinates(trials: Trials, allowed: int) -> Sizes:
    """Sizes with up to `allowed` coordinates; each coordinate is added to the body whose error it reduces most.

    Raises InputError if the smallest model has more coordinates than are allowed.
    """
    sizes, steps = trials.uniform_sizes(trials.least), trials.excitation.stepping.steps
    if allowed < (least := trials.coordinates(sizes)):
        needed = f"at least {least} are needed: rigid-body motions"
        needed += ", one mode of each section, those of cylinders" * (len(sizes) > 1)
        raise InputError("scene", "budget.coordinates", allowed, needed)
    while trials.coordinates(sizes) < allowed and (more := trials.neighbouring_sizes(sizes, 1)):
        alone = len(more) == 1
        sizes = more[0] if alone else min(more, key=lambda of: max(trials.reduction_errors(of, steps).values()))
    return sizes
