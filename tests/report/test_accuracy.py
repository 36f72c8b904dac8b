"""What the report says of a tolerance: the choices, and the part of each error."""

from __future__ import annotations

import pytest
from matplotlib.patches import Rectangle

from pmr.report.figures.budget import budget
from pmr.report.figures.canvas import style
from pmr.report.sections import accuracy

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
        ax = budget(make_result(summary=ORDERED)).axes[0]
    widths = [patch.get_width() for patch in ax.patches if isinstance(patch, Rectangle)]
    assert widths == pytest.approx([100.0 * PARTS[name][kind] for kind in ("beam", "tip") for name in PARTS])
    assert ax.lines[0].get_xdata()[0] == pytest.approx(1.0)


def test_choices_and_what_to_improve_are_said(make_result) -> None:
    block = accuracy(make_result(summary=ORDERED), "case")
    assert block is not None and block.text == "5 coordinates: with 4 it is off; 3000 steps: 1500 are off."
    assert "the mesh is to be improved first" in block.drawings[0].caption


def test_a_mesh_whose_part_is_not_known_has_no_bar(make_result) -> None:
    summary = ORDERED | {"budget": PARTS | {"mesh": None, "mesh_reason": "it is a file", "first": "step"}}
    block = accuracy(make_result(summary=summary), "case")
    assert block is not None and "not known: it is a file" in block.drawings[0].caption
    with style():
        assert len(budget(make_result(summary=summary)).axes[0].patches) == 4


def test_without_a_tolerance_nothing_is_said(make_result) -> None:
    assert accuracy(make_result(summary={}), "case") is None
