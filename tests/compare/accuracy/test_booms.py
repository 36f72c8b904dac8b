"""Coordinates of a boom's sections by an allowed error, or within a number of them."""

import os
from typing import Any

import pytest
from random_scenes import random_boom

from pmr import InputError, Response, run
from pmr import scene as scenes
from pmr.compare.errors import relative_error
from pmr.compare.estimate import MARGIN
from pmr.scene.run_settings import Accuracy
from pmr.system.attachment import CYLINDER

QUICK = (
    "time.end=0.2",
    "section.mesh.elements=12",
    "section.joint.extension={kind='smooth_ramp',times=[0.0,0.2],values=[1.0,1.3]}",
    "section.joint.tail.0.unilateral=false",
    "section.joint.mouth.0.unilateral=false",
    "sections.fly.loads.0.signal={kind='sine',amplitude=4000.0,frequency=12.0}",
)


def summary(*changes: str) -> dict[str, Any]:
    boom = scenes.load_any("boom_two", (*QUICK, *changes))
    outcome = run(boom)
    assert outcome is not None
    return outcome.result.summary


@pytest.mark.slow
def test_the_fewest_that_hold_a_tolerance() -> None:
    """Beside the full model; with one coordinate less, wherever it is taken from, hardly any of it is left."""
    found = summary("accuracy.tolerance=1e-3", "accuracy.outputs=['pad_force','beam']")
    sizes, true = found["accuracy"]["chosen"]["sections"], found["errors"]["reduced_vs_full"]
    assert found["accuracy"]["holds"] and sum(sizes.values()) + CYLINDER == found["coordinates"]["reduced"]
    for kind, estimate in found["budget"]["reduction"].items():
        assert true[kind] < 1e-3 and estimate == pytest.approx(MARGIN * true[kind], rel=0.1)
    for name, size in sizes.items():
        fewer = {one: count - (one == name) for one, count in sizes.items()}
        less = summary(*(f"sections.{one}.reduction.coordinates={count}" for one, count in fewer.items()))
        true, step = less["errors"]["reduced_vs_full"], found["budget"]["step"]
        assert max(MARGIN * true[kind] + step[kind] for kind in ("pad_force", "beam")) > 1e-3, size


@pytest.mark.slow
def test_random_booms_hold_what_they_are_asked_for() -> None:
    """Beside their full models; ``PMR_SWEEP=full`` takes eight booms, each with two tolerances."""
    whole = os.environ.get("PMR_SWEEP") == "full"
    for seed in (0, 2, 3, 5, 7, 11, 14, 17) if whole else (3,):
        for tolerance in (1e-3, 1e-4) if whole else (1e-3,):
            outcome = run(random_boom(seed).model_copy(update={"accuracy": Accuracy(tolerance=tolerance)}))
            assert outcome is not None
            found = outcome.result.summary
            true = found["errors"]["reduced_vs_full"]
            assert found["accuracy"]["holds"] and max(true["tip"], true["beam"]) < tolerance


@pytest.mark.slow
def test_on_pads_that_push_parts_of_steps_are_not_taken_for_errors_of_the_reduction() -> None:
    """Few coordinates hold, beside the full model in the same parts of steps, and by the run's own estimate."""
    pushing = [f"section.joint.{ring}.0.unilateral=true" for ring in ("tail", "mouth")]
    found = summary(*pushing, "accuracy.tolerance=1e-3")
    true, said = found["errors"]["reduced_vs_full"], found["estimate"]
    assert found["accuracy"]["holds"] and found["coordinates"]["reduced"] <= 14
    for kind in ("tip", "beam"):
        assert true[kind] < 1e-3 and said[kind] <= found["budget"]["reduction"][kind] <= 1e-3


@pytest.mark.slow
def test_within_a_budget_the_best_ones_are_taken() -> None:
    found = summary("budget.coordinates=8", "compare.against=[]")
    chosen = found["accuracy"]["chosen"]
    assert chosen["coordinates"] == found["coordinates"]["reduced"] == 8
    assert found["accuracy"]["tolerance"] is None and set(found["budget"]["reduction"]) == {"beam", "tip"}


@pytest.mark.slow
def test_a_tolerance_chooses_the_step_and_counts_the_mesh() -> None:
    """Of a boom as of one body: with all three parts, which a finer full model on a finer mesh confirms."""
    extension = "section.joint.extension={kind='smooth_ramp',times=[0.0,0.2],values=[1.0,1.3]}"
    found = summary("accuracy.tolerance=3e-3", "compare.against=[]", extension)
    asked, budget = found["accuracy"], found["budget"]
    step = asked["chosen"]["step"]
    assert asked["holds"] and step != 1e-3 and len(asked["reasons"]) == 2
    for kind in ("beam", "tip"):
        parts = [budget[part][kind] for part in ("reduction", "step", "mesh")]
        assert min(parts) > 0.0 and max(parts) <= budget["sum"][kind] <= min(sum(parts), 3e-3)
        assert found["step"][kind] <= budget["step"][kind] and found["estimate"][kind] <= budget["reduction"][kind]
    sizes = [f"sections.{name}.reduction.coordinates={size}" for name, size in asked["chosen"]["sections"].items()]
    own = _motion("reduced", f"time.step={step}", *sizes)
    fine = _motion("full", f"time.step={step / 8.0}", "section.mesh.elements=24")
    assert 0.0 < _apart(own, fine) <= 3e-3


def _motion(model: str, *changes: str) -> Response:
    boom = scenes.load_any("boom_two", (*QUICK, *changes))
    outcome = run(boom)
    assert outcome is not None
    return outcome.result.responses[model]


def _apart(own: Response, fine: Response) -> float:
    """Largest error of displacements that both have, at the steps of the coarser one."""
    common = [name for name in own.output_names if name in fine.output_names]
    one, other = (
        response.displacement[::every, [response.output_names.index(name) for name in common]]
        for response, every in ((own, 1), (fine, (len(fine.t) - 1) // (len(own.t) - 1)))
    )
    return relative_error(one, other)


@pytest.mark.slow
@pytest.mark.numerical
def test_velocities_and_cylinders_are_kinds_of_their_own() -> None:
    """Their errors are estimated, and a tolerance may be asked for them."""
    kinds = ["velocity", "cylinder_force"]
    found = summary("accuracy.tolerance=0.02", f"accuracy.outputs={kinds}", "accuracy.mesh=false")
    assert found["accuracy"]["holds"]
    for kind in kinds:
        assert (
            0.0 < found["estimate"][kind] <= found["budget"]["reduction"][kind] <= found["budget"]["sum"][kind] <= 0.02
        )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (("accuracy.tolerance=0.01", "section.reduction.estimate=false"), "an estimate, without ports, are allowed"),
        (("budget.coordinates=3",), "at least 7 are needed"),
        (("accuracy.tolerance=0.01", "section.mesh.elements=2", "section.reduction.coordinates=5"),
         "the mesh has more modes"),
    ],
)  # fmt: skip
def test_what_is_refused(changes: tuple[str, ...], said: str) -> None:
    with pytest.raises(InputError, match=said):
        summary("compare.against=[]", "time.end=0.02", *changes)
