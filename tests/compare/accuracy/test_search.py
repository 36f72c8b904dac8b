"""The search for a model and a step: against full models, and its way on trials whose errors are given."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from alone import outputs, trials
from oracle import enriched, full_body

from pmr import InputError, System
from pmr.compare import estimate as estimates
from pmr.compare.accuracy_search import (
    explain_trial,
    find_best_affordable,
    find_sufficient_trial,
    is_within,
    reduce_cost,
)
from pmr.compare.outputs import Outputs, RoundOffBounds, differences
from pmr.compare.trials import FINER, Sizes, Trial, Trials
from pmr.errors import GrowthError
from pmr.scene.run_settings import Budget
from pmr.scene.signals import Chirp, Constant, Sine, SmoothRamp
from pmr.simulation import Excitation, TimeStepping

FULL = full_body(30)
MODEL = enriched(FULL, 6, enrichment=18)
#: With modes enough for forces of a slider to 0.3 %.
RICH = enriched(FULL, 6, enrichment=30)
PATH = SmoothRamp(times=(0.1, 0.8), values=(1.5, 3.0))
LOAD = Sine(amplitude=200.0, frequency=3.0)


def driven(steps: int = 1000, load=LOAD, rho_inf: float = 0.9) -> Excitation:
    return Excitation({"slider": PATH}, {FULL.input_names[0]: load}, TimeStepping(1.0, 1.0 / steps, rho_inf))


def found_by(tried: Trials, tolerance: float):
    """The trial that a tolerance gives, from six coordinates and the given step on."""
    allowed = dict.fromkeys(tried.wanted, tolerance)
    trial = find_sufficient_trial(tried, tried.own, tried.excitation.stepping.steps, allowed)
    return reduce_cost(tried, trial, allowed, tried.fewest_steps()) if is_within(trial, allowed) else trial


def true_errors(tried: Trials, sizes: Sizes, steps: int) -> float:
    """Largest error in the wanted kinds, a fraction, beside the full model with steps an eighth as long as any here."""
    coarse, finest = 125, 64_000
    fine = outputs(FULL, driven(finest), finest // coarse)
    own = outputs(tried.models(sizes)[""], driven(steps), steps // coarse)
    floors = RoundOffBounds.for_system(System.of(RICH), driven())
    return max(differences(own, fine, floors, tried.wanted).values())


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.parametrize(
    ("kinds", "tolerance"), [(("beam", "tip"), 0.003), (("pad_force",), 0.03), (("velocity",), 0.003)]
)
def test_the_tolerance_holds_and_three_coordinates_fewer_do_not(kinds: tuple[str, ...], tolerance: float) -> None:
    tried = trials(RICH, driven(), kinds)
    trial = found_by(tried, tolerance)
    true = true_errors(tried, trial.sizes, trial.steps)
    assert is_within(trial, dict.fromkeys(kinds, tolerance)) and true <= max(trial.total.values()) <= tolerance
    fewer = trial.sizes[0] - 3
    if fewer >= 1:
        assert true_errors(tried, (fewer,), 8000) > tolerance / 2.0  # margins and the step have the rest
    if trial.steps > tried.fewest_steps():
        assert not is_within(tried.estimate_trial(trial.sizes, trial.steps // 2), dict.fromkeys(kinds, tolerance))


@pytest.mark.slow
def test_what_cannot_be_held_is_the_best_that_was_tried(few_steps: None) -> None:
    tried = trials(MODEL, driven())
    trial = found_by(tried, 1e-9)
    assert trial.sizes == tried.most == (20,) and max(trial.total.values()) > 1e-9


def judged_by(
    monkeypatch: pytest.MonkeyPatch,
    reduction: Callable[[Sizes, int], float],
    step: Callable[[Sizes, int], float],
    settled: Callable[[Sizes, int], bool] = lambda sizes, steps: True,
) -> list[tuple[Sizes, int]]:
    """Errors of trials are those that are given; the list tells of which models and steps they were asked for."""
    asked = list[tuple[Sizes, int]]()

    def of_reduction(self: Trials, sizes: Sizes, steps: int) -> dict[str, float]:
        asked.append((sizes, steps))
        self._estimates[sizes, steps] = None
        return dict.fromkeys(self.wanted, reduction(sizes, steps))

    def of_step(self: Trials, sizes: Sizes, steps: int) -> dict[str, float]:
        self._step_errors[sizes, steps] = None
        return dict.fromkeys(self.wanted, step(sizes, steps))

    monkeypatch.setattr(Trials, "reduction_errors", of_reduction)
    monkeypatch.setattr(Trials, "step_errors", of_step)
    monkeypatch.setattr(Trials, "is_settled", lambda self, sizes, steps: settled(sizes, steps))
    monkeypatch.setattr(
        Trials, "difference_to_trial", lambda self, trial, sizes, steps: of_reduction(self, sizes, steps)
    )
    monkeypatch.setattr(Trials, "is_resolved", lambda self, sizes, steps: step(sizes, steps) <= 0.05)
    return asked


def second_order(sizes: Sizes, steps: int) -> float:
    return 0.002 * (1000.0 / steps) ** 2


def test_a_step_that_is_too_coarse_is_not_taken_for_too_few_coordinates(monkeypatch: pytest.MonkeyPatch) -> None:
    """A reduction that is 190 % off with steps that do not resolve the motion is judged only with steps that do."""
    resolved = judged_by(
        monkeypatch,
        lambda sizes, steps: 10.0 * sizes[0] ** -4.0 if steps >= 4000 else 1.9,
        lambda sizes, steps: 0.3 * (1000.0 / steps) ** 2,
    )
    tried = trials(MODEL, driven())
    trial = found_by(tried, 0.01)
    assert all(steps >= 4000 for _, steps in resolved)
    assert is_within(trial, {"beam": 0.01, "tip": 0.01}) and trial.sizes == (7,) and trial.steps == 8000


def test_coordinates_are_doubled_and_those_that_can_be_spared_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Errors fall with the fourth power of the coordinates: 11 of them, with half the steps, are 0.98 % off."""
    judged_by(monkeypatch, lambda sizes, steps: 30.0 * sizes[0] ** -3.5, second_order)
    trial = found_by(trials(MODEL, driven()), 0.01)
    assert trial.sizes == (11,) and trial.steps == 1000
    judged_by(monkeypatch, lambda sizes, steps: 1e-4, second_order)
    trial = found_by(trials(MODEL, driven()), 0.01)
    assert trial.sizes == (1,) and trial.steps == 500


def test_a_step_whose_error_is_not_settled_is_shortened(monkeypatch: pytest.MonkeyPatch) -> None:
    judged_by(monkeypatch, lambda *_: 1e-4, lambda *_: 1e-4, lambda sizes, steps: steps > 2000)
    tried = trials(MODEL, driven())
    trial = found_by(tried, 0.01)
    assert trial.settled and trial.steps == 4000
    judged_by(monkeypatch, lambda *_: 1e-4, lambda *_: 1e-4, lambda *_: False)
    assert not is_within(found_by(tried, 0.01), {"beam": 0.01, "tip": 0.01})


def test_its_own_step_is_not_refused_where_more_modes_grow_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """With rho_inf = 1 nothing damps modes that the step does not resolve: fewer of them judge the reduction then."""
    tried = trials(RICH, driven(250, rho_inf=1.0))
    made, grown = estimates.run_from_start, list[int]()

    def grows(system: System, excitation):
        size = sum(body.size for body in system.bodies.values())
        if size > 20:
            grown.append(size)
            raise GrowthError("the motion grows without bound")
        return made(system, excitation)

    monkeypatch.setattr(estimates, "run_from_start", grows)
    trial = tried.estimate_trial(tried.own, 250)
    assert grown and trial.estimate is not None and 0 < trial.estimate.enrichment < 30
    assert 0.0 < trial.reduction["beam"] < 0.1


def test_smaller_models_are_judged_by_their_difference_to_a_larger_one() -> None:
    """As their own estimates say, but for the margin of these."""
    tried = trials(MODEL, driven())
    larger = tried.estimate_trial((12,), 1000)
    for size in (4, 6, 8):
        own, beside = tried.reduction_errors((size,), 1000), tried.difference_to_trial(larger, (size,), 1000)
        assert own["beam"] / 1.25 <= beside["beam"] <= 1.25 * own["beam"]
    smaller = tried.estimate_trial((8,), 1000)  # its difference to itself is 0, to the larger one it was not
    assert tried.difference_to_trial(smaller, (8,), 1000) == smaller.reduction


def test_reasons_are_a_clause_each(monkeypatch: pytest.MonkeyPatch) -> None:
    judged_by(monkeypatch, lambda sizes, steps: 30.0 * sizes[0] ** -3.5, second_order)
    tried = trials(MODEL, driven())
    allowed = dict.fromkeys(tried.wanted, 0.01)
    why = list(explain_trial(tried, found_by(tried, 0.01), tried.fewest_steps(), allowed))
    assert why == [
        "11 coordinates: with 10 the reduction alone is off by 0.95 %",
        "1000 steps: they are off by 0.2 %, and half as many by 1.7 to 4 times as much",
    ]


def test_a_reason_names_the_step_where_fewer_coordinates_would_do_for_the_reduction(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A path with kinks excites models differently: with six coordinates runs of shorter steps approach nothing."""
    judged_by(monkeypatch, lambda *_: 1e-3, lambda *_: 1e-3, lambda sizes, steps: sizes[0] > 6)
    tried = trials(MODEL, driven())
    allowed = dict.fromkeys(tried.wanted, 0.01)
    trial = tried.estimate_trial((7,), 1000)
    assert next(explain_trial(tried, trial, tried.fewest_steps(), allowed)) == (
        "7 coordinates: with 6 the reduction alone is off by 0.1 %, and the error of 1000 steps is not settled"
    )


@pytest.mark.slow
def test_what_more_time_allows_is_no_worse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a machine on which a step takes 10 ns a coordinate: the shortest steps are tried, too."""
    monkeypatch.setattr(Trials, "seconds_per_step", lambda self, sizes: 1e-8 * sizes[0])
    monkeypatch.setattr("pmr.compare.trials.LONGEST", 32_000)
    tried, real_times = trials(MODEL, driven()), (30_000.0, 3000.0, 300.0)
    found = [find_best_affordable(tried, Budget(real_time=ratio), tried.fewest_steps()) for ratio in real_times]
    errors = [max(one.total.values()) for one in found]
    assert errors[0] > errors[1] > errors[2]
    for one, ratio in zip(found, real_times, strict=True):
        assert one.steps * one.sizes[0] * 1e-8 <= 1.0 / ratio


def test_a_budget_of_coordinates_has_a_step_that_suits_them(monkeypatch: pytest.MonkeyPatch) -> None:
    judged_by(monkeypatch, lambda sizes, steps: 30.0 * sizes[0] ** -3.5, second_order)
    tried = trials(MODEL, driven())
    few, more = (find_best_affordable(tried, Budget(coordinates=count), 62) for count in (6, 18))
    assert few.sizes == (6,) and few.steps == 250 and more.sizes == (18,) and more.steps == 2000
    free = replace(MODEL, K=np.diag([0.0, 0.0, *np.diagonal(MODEL.K)[2:]]))
    with pytest.raises(InputError, match="at least 2 are needed: rigid-body motions"):
        find_best_affordable(trials(free, driven()), Budget(coordinates=1), 62)


def test_steps_follow_path_and_loads() -> None:
    slow, fast = Chirp(amplitude=1.0, times=(0.0, 1.0), frequencies=(1.0, 2.0)), Sine(amplitude=1.0, frequency=90.0)
    few, many = (trials(MODEL, driven(960, load)).fewest_steps() for load in (slow, fast))
    assert (few, many) == (30, 960)  # 15 steps are less than 20; 480 are 5 a period of the tone
    every = trials(MODEL, driven(960, slow)).fewest_steps(every=1.0 / 120.0)
    assert every == 120  # fields are wanted at each step
    assert trials(MODEL, driven(999, slow)).fewest_steps() == 999


def test_models_are_those_of_the_reduction() -> None:
    tried = trials(MODEL, driven(100, Constant(amount=5.0)))
    model = tried.models((4,))[""]
    assert model.size == 4 and model.flexibility is not None
    own, other = outputs(model, tried.excitation), tried.motion((4,), tried.excitation)
    assert np.allclose(own.displacement, other.displacement, rtol=0.0, atol=1e-12)


def test_models_on_pads_that_push_take_the_same_parts_of_a_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is compared is the reduction, not how each lands; and steps are hardly shortened, as impacts take parts."""
    seen, made = list[TimeStepping](), Trials.motion

    def noted(self: Trials, sizes: Sizes, excitation: Excitation) -> Outputs:
        seen.append(excitation.stepping)
        return made(self, sizes, excitation)

    monkeypatch.setattr(Trials, "motion", noted)
    pushed = replace(enriched(FULL, 9), clearance=np.zeros(1))
    tried = trials(pushed, driven(load=Sine(amplitude=2e3, frequency=7.0)))
    assert tried.fewest_steps() == 1000 and tried.most_steps == FINER * 1000
    errors = dict.fromkeys(tried.wanted, 0.0)
    tried.difference_to_trial(Trial((7,), 7, 1000, errors, errors, True, None, None), (5,), 1000)
    assert seen[0].schedule == seen[1].schedule and len(set(seen[0].schedule)) > 1


def test_a_model_that_is_refused_does_not_end_the_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """With rho_inf = 1 a model that keeps all modes is refused, as its rows have no residual flexibility."""
    tried = trials(RICH, driven(250))

    def refuse(sizes: Sizes, steps: int) -> None:
        raise InputError("scene", "time.rho_inf", 1.0, "less than 1 is allowed")

    monkeypatch.setattr(tried, "_run", refuse)
    assert set(tried.reduction_errors((8,), 250).values()) == set(tried.step_errors((8,), 250).values()) == {np.inf}
