"""What the report says of a tolerance: the choices, and the part of each error."""

from __future__ import annotations

import pytest
from matplotlib.patches import Rectangle

from pmr.report.errors import trust_table
from pmr.report.figures.canvas import style
from pmr.report.figures.shapes import budget_figure
from pmr.report.sections import accuracy_block
from pmr.report.sentences import key_numbers

PARTS = {
    "reduction": {"beam": 0.006, "tip": 0.002},
    "step": {"beam": 0.004, "tip": 0.001},
    "mesh": {"beam": 0.02, "tip": 0.003},
}
ORDERED = {
    "accuracy": {
        "tolerance": 0.01,
        "outputs": ["beam", "tip"],
        "reasons": ["5 coordinates: with 4 it is off", "3000 steps: 1500 are off"],
    },
    "budget": PARTS | {"mesh_reason": None, "first": "mesh"},
}


def test_bars_are_the_parts_and_a_line_the_tolerance(make_result) -> None:
    with style():
        ax = budget_figure(make_result(summary=ORDERED)).axes[0]
    widths = [patch.get_width() for patch in ax.patches if isinstance(patch, Rectangle)]
    assert widths == pytest.approx([100.0 * PARTS[name][kind] for kind in ("beam", "tip") for name in PARTS])
    assert ax.lines[0].get_xdata()[0] == pytest.approx(1.0)


def test_choices_and_what_to_improve_are_said(make_result) -> None:
    block = accuracy_block(make_result(summary=ORDERED), "case")
    assert block is not None and block.text == "5 coordinates: with 4 it is off; 3000 steps: 1500 are off."
    assert "the mesh is to be improved first" in block.drawings[0].caption


def test_a_mesh_whose_part_is_not_known_has_no_bar(make_result) -> None:
    summary = ORDERED | {"budget": PARTS | {"mesh": None, "mesh_reason": "it is a file", "first": "step"}}
    block = accuracy_block(make_result(summary=summary), "case")
    assert block is not None and "not known: it is a file" in block.drawings[0].caption
    with style():
        assert len(budget_figure(make_result(summary=summary)).axes[0].patches) == 4


MODEL = {
    "beside": "shell",
    "beam": 0.41,
    "tip": 0.36,
    "pad_force": None,
    "frequency": 0.61,
    "not_covered": ["stress", "pads that open"],
}


def test_the_models_own_error_stands_on_the_first_page_and_beside_the_other_parts(make_result) -> None:
    result = make_result(
        summary=make_result().summary | ORDERED | {"budget": PARTS | {"first": "mesh", "model": MODEL}}
    )
    number = next(one for one in key_numbers(result) if "model's own error" in one.label)
    assert number.value.startswith("41") and "61" in number.note
    said = dict(trust_table(result).rows)
    assert "a shell" in said["model"] and "36" in said["model"] and "pad forces" not in said["model"]
    assert said["not in the model's bar"] == "stress; pads that open"
    with style():
        widths = [patch.get_width() for patch in budget_figure(result).axes[0].patches if isinstance(patch, Rectangle)]
    assert widths[3::4] == pytest.approx([41.0, 36.0])


@pytest.mark.parametrize(("model", "why"), [(None, "compare.richer"), ({"beside": None, "reason": "no box"}, "no box")])
def test_that_it_is_not_known_is_said_in_one_line(make_result, model, why: str) -> None:
    result = make_result(summary=make_result().summary | ({} if model is None else {"budget": {"model": model}}))
    said = dict(trust_table(result).rows)["model"]
    assert "not known" in said and why in said and said.count(".") <= 2
    assert not any("model's own error" in one.label for one in key_numbers(result))


def test_without_a_tolerance_nothing_is_said(make_result) -> None:
    assert accuracy_block(make_result(summary={}), "case") is None
