"""Models made to a tolerance, against full ones: the tolerance holds, and nothing smaller or longer would do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from alone import family as family_of
from alone import outputs
from oracle import enriched, flexible, full_body

from pmr.compare.accuracy import family as families
from pmr.compare.accuracy import limits
from pmr.compare.accuracy.errors import Demand, coarsest, rungs
from pmr.compare.accuracy.family import Family, Member, Models
from pmr.compare.accuracy.limits import best_within
from pmr.compare.accuracy.search import search
from pmr.compare.estimate import MARGIN_OF_ALL_MODES
from pmr.compare.outputs import Floors, Outputs, differences
from pmr.compare.step_error import StepError
from pmr.errors import SimulationError
from pmr.errors.aside import Aside
from pmr.scene.asked import Budget
from pmr.scene.signals import Chirp, Constant, Sine, SmoothRamp, Step
from pmr.simulation import Excitation, TimeStepping
from pmr.system.system import System

FULL = full_body(30)
MODEL = enriched(FULL, 6, enrichment=18)
#: With modes enough for forces of a slider to 0.3 %.
RICH = enriched(FULL, 6, enrichment=30)
PATH = SmoothRamp(times=(0.1, 0.8), values=(1.5, 3.0))
LOAD = Sine(amplitude=200.0, frequency=3.0)


def driven(steps: int = 1000, load=LOAD, path=PATH) -> Excitation:
    name = FULL.input_names[0]
    return Excitation({"slider": path}, {name: load}, TimeStepping(1.0, 1.0 / steps))


def full_motion(steps: int, times: int) -> Outputs:
    return outputs(FULL, driven(steps), steps // times)


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.parametrize(
    ("kinds", "tolerance"), [(("beam", "tip"), 0.003), (("pad_force",), 0.03), (("velocity",), 0.003)]
)
def test_the_tolerance_holds_and_two_coordinates_fewer_do_not(kinds: tuple[str, ...], tolerance: float) -> None:
    family = family_of(RICH, driven(), "velocity" in kinds)
    coarse = coarsest(family)
    found = search(family, Demand(tolerance, kinds), coarse)
    truth, floors = full_motion(32 * found.steps, coarse), Floors.of(System.of(RICH), driven())

    def error(member: Member, steps: int) -> float:
        return max(differences(family.motion(member, steps, coarse), truth, floors, kinds).values())

    assert found.holds and error(found.member, found.steps) <= tolerance
    assert max(found.total.values()) >= error(found.member, found.steps)
    fewer = found.member.coordinates - 3
    if fewer >= family.fewest:
        assert error(family.member(fewer), 32 * coarse) > tolerance
    if found.steps >= 4 * coarse:
        assert error(found.member, found.steps // 4) > tolerance / MARGIN_OF_ALL_MODES**2


@pytest.mark.slow
def test_no_shorter_step_than_the_chosen_one_is_judged_by_runs_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Behind a load that sets in at once a longer step is taken than the first with which runs approach each other."""
    judge, judged = Family.step_error, set[int]()

    def counted(family: Family, member: Member, steps: int) -> StepError | None:
        judged.add(steps)
        return judge(family, member, steps)

    monkeypatch.setattr(Family, "step_error", counted)
    family = family_of(MODEL, driven(load=Step(time=0.3, after=200.0)))
    found = search(family, Demand(0.01, ("beam", "tip")), coarsest(family))
    assert found.holds and max(judged) == found.steps


@pytest.mark.slow
@pytest.mark.numerical
def test_what_cannot_be_held_is_said() -> None:
    family = family_of(MODEL, driven())
    found = search(family, Demand(1e-9, ("beam",)), coarsest(family))
    assert (
        not found.holds
        and found.member.coordinates == family.most == family.size - 6
        and max(found.total.values()) > 1e-9
    )
    # Shorter steps would cost time and gain nothing; twice as long ones err four times as much.
    assert 0.01 < found.step["beam"] / found.reduction["beam"] <= 0.1


@pytest.mark.slow
def test_a_step_is_no_longer_than_its_run_allows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the run says more of its step than the search sees, finer ones are tried; where all say so, none holds."""
    demand, coarse = Demand(0.01, ("beam", "tip")), coarsest(family_of(MODEL, driven()))
    alone, own = search(family_of(MODEL, driven()), demand, coarse), Family.step_error

    def found_where(steps: float):
        def larger(family: Family, member: Member, taken: int) -> StepError | None:
            said = own(family, member, taken)
            return said if said is None or taken > steps else replace(said, tip=0.011)

        monkeypatch.setattr(Family, "step_error", larger)
        return search(family_of(MODEL, driven()), demand, coarse)

    monkeypatch.setattr("pmr.compare.accuracy.errors.LONGEST", 64 * coarse)
    finer, none = found_where(alone.steps), found_where(np.inf)
    assert alone.holds and finer.holds and finer.steps == 2 * alone.steps and finer.member == alone.member
    assert not none.holds and none.step["tip"] == none.total["tip"] == 0.011


def test_what_a_step_leaves_out_is_known_from_shorter_ones() -> None:
    family = family_of(MODEL, driven())
    coarse, member = coarsest(family), family.member(6)
    truth = family.motion(member, 256 * coarse, coarse)
    seen = 0
    for rung in rungs(family, member, coarse, ("beam",)):
        if rung.steps > 16 * coarse:
            break
        own = family.motion(member, rung.steps, coarse)
        said, true = (
            np.sqrt(np.mean(x**2)) for x in (rung.missing.displacement, truth.displacement - own.displacement)
        )
        if rung.settled:
            seen += 1
            assert said == pytest.approx(true, rel=0.15)
    assert seen >= 2


def test_steps_follow_path_and_loads() -> None:
    slow, fast = Chirp(amplitude=1.0, times=(0.0, 1.0), frequencies=(1.0, 2.0)), Sine(amplitude=1.0, frequency=90.0)
    few, many = (coarsest(family_of(MODEL, driven(960, load))) for load in (slow, fast))
    assert (few, many) == (30, 960)  # 15 steps are less than 20; 480 are 5 a period of the tone
    assert coarsest(family_of(MODEL, driven(960, slow)), every=1.0 / 120.0) == 120  # fields are wanted at each step
    assert coarsest(family_of(MODEL, driven(999, slow))) == 999


def test_a_step_with_which_nothing_can_be_computed_is_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    family = family_of(MODEL, driven())
    coarse, own = coarsest(family), Family._motion

    def fails(self: Family, member: Member, steps: int, times: int, rho_inf: float) -> Outputs:
        if steps <= 2 * coarse:
            raise SimulationError("march failed")
        return own(self, member, steps, times, rho_inf)

    monkeypatch.setattr(Family, "_motion", fails)
    assert next(rungs(family, family.member(6), coarse, ("beam",))).steps == 4 * coarse


def test_code_is_loaded_with_a_step_that_may_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(self: Family, member: Member, steps: int, times: int, rho_inf: float) -> Outputs:
        raise SimulationError("march failed")

    monkeypatch.setattr(Family, "_motion", fails)
    family_of(MODEL, driven()).load()


def test_members_are_those_of_the_reduction() -> None:
    family = family_of(MODEL, driven(100, Constant(amount=5.0)))
    model = family.models(family.member(4))[""]
    assert model.size == 4 and model.flexibility is not None
    excitation = driven(100, Constant(amount=5.0))
    own = outputs(model, excitation)
    assert np.allclose(own.displacement, family.own(family.member(4), 100, 100).displacement, rtol=0.0, atol=1e-12)


def alone(models: Models) -> System:
    return System.of(models[""])


def test_another_process_says_what_this_one_would() -> None:
    aside = Aside.started()
    here, there = (Family({"": MODEL}, alone, driven(100), aside=one) for one in (Aside(), aside))
    member = here.member(4)
    there.begin(member, 100, 50)
    there.begin_estimate(member, 100)
    assert np.array_equal(*(one.motion(member, 100, 50).displacement for one in (here, there)))
    own, other = (one.estimate(member, 100) for one in (here, there))
    assert own.errors == other.errors and np.array_equal(own.error, other.error)
    assert [well for well, _ in aside.answers] == [True, True]
    aside.close()


@pytest.mark.slow
def test_what_more_time_allows_is_no_worse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a machine on which a step takes 10 ns a coordinate: the shortest steps are tried, too."""
    monkeypatch.setattr(limits, "seconds_a_step", lambda _, member: 1e-8 * member.coordinates)
    family = family_of(MODEL, driven())
    real_times, most = (3000.0, 300.0, 3.0), Budget(microseconds_per_step=10.0)
    found = [
        best_within(family, Demand(1.0, ("beam",)), budget, coarsest(family))
        for budget in (*(Budget(real_time=ratio) for ratio in real_times), most)
    ]
    errors = [one.total["beam"] for one in found]
    assert errors[0] > errors[1] > errors[2] and errors[2] <= errors[3]
    for one, ratio in zip(found, real_times, strict=False):
        assert one.steps * one.member.coordinates * 1e-8 <= 1.0 / ratio


def test_members_on_pads_that_push_take_the_same_parts_of_a_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is compared is the reduction, not how each member lands."""
    seen = list[TimeStepping]()

    def noted(system: System, excitation: Excitation, *more: object) -> None:
        seen.append(excitation.stepping)

    monkeypatch.setattr(families, "at_intervals", noted)
    pushed = replace(flexible(FULL, 9), clearance=np.zeros(1))
    family = Family({"": pushed}, lambda models: System.of(models[""]), driven(load=Sine(amplitude=2e3, frequency=7.0)))
    for modes in (5, 7):
        family.own(family.member(modes), 1000, 100)
    assert seen[0].schedule == seen[1].schedule and len(set(seen[0].schedule)) > 1
