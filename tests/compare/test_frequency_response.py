"""The response in frequency that a scene may ask for: of one mode in closed form, in results, summary and report."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pmr import pipeline as whole
from pmr import scene as scenes
from pmr.compare.frequencies import frequency_part, frequency_response
from pmr.errors import InputError
from pmr.report import sections
from pmr.report.numbers import SPACE
from pmr.results import RunResult

BOOM = Path(__file__).parents[2] / "workflows" / "boom_beam.toml"
ASKED = [
    "observe.frequency_response=true",
    "time.end=0.1",
    "compare.against=[]",
    "mesh.elements=12",
    "recovery.every=0.1",
]
STEADY = "slider.path=2.5"


@pytest.fixture(scope="module")
def outcome() -> whole.Outcome:
    found = whole.run(scenes.load(BOOM, [*ASKED, STEADY, "recovery.stress=false"]))
    assert found is not None
    return found


def test_the_response_is_that_of_the_equations_with_multipliers(outcome: whole.Outcome) -> None:
    """(-w^2 M + i w D + K) p + C^T lambda = B f,  C p + H f - (G + 1/k) lambda = 0,  y = O p + W f - X lambda."""
    model, found = outcome.reduced, outcome.result.frequency_response
    assert found is not None and model.flexibility is not None
    assert dict(zip(found.inputs, found.outputs, strict=True)) == {
        "tip force": "tip z",
        "gust": "tip y",
        "gravity": "tip z",
    }
    at = [model.output_names.index(name) for name in found.outputs]
    C, flex = model.C(2.5), model.flexibility
    F = flex.rows(2.5) + np.diag(model.row_compliance)
    for k in (0, 150, 399):
        w = 2.0 * np.pi * found.f[k]
        upper = np.hstack([-(w**2) * model.M + 1j * w * model.D + model.K, C.T])
        A = np.vstack([upper, np.hstack([C, -F])])
        x = np.linalg.solve(A, np.vstack([model.B, -flex.inputs(2.5)]))
        p, multipliers = x[: model.size], x[model.size :]
        y = np.diagonal(model.outputs[at] @ p + flex.direct[at] - flex.outputs(2.5)[at] @ multipliers)
        np.testing.assert_allclose(found.gain[0, k], np.abs(y), rtol=1e-7, atol=1e-9 * np.abs(y).max())


def test_summary_results_and_report_have_it(outcome: whole.Outcome, tmp_path: Path) -> None:
    result = outcome.result
    said = result.summary["frequency_response"]["gain"]["tip force"]
    found = result.frequency_response
    assert found is not None and found.damped and said["unit"] == "m/N"
    load = found.inputs.index("tip force")
    assert said["largest"][0] == found.gain[0, :, load].max() > abs(said["static"][0]) > 0.0
    result.save(tmp_path)
    again_result = RunResult.load(tmp_path)
    again = again_result.frequency_response
    assert again is not None and again.inputs == found.inputs
    np.testing.assert_array_equal(again.gain, found.gain)
    block = sections.response(again_result, "case")
    assert block is not None and len(block.drawings) == 3 and len(block.grids) == 3
    assert block.grids[0].rows[0][0] == f"2.5{SPACE}m" and "Frequency in Hz" in block.drawings[0].svg
    assert sections.response(replace(result, frequency_response=None), "case") is None


def test_only_who_asks_for_it_gets_it() -> None:
    scene = scenes.load(BOOM)
    assert frequency_response(scene, None) is None and frequency_part(None).figures == {}  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "other", ["pads.mouth.unilateral=true", "reduction.flexibility=false", "reduction.residual_inertia=true"]
)
def test_what_has_no_linear_response_is_refused(other: str) -> None:
    with pytest.raises(InputError, match="observe.frequency_response"):
        scenes.load(BOOM, ["observe.frequency_response=true", other])
