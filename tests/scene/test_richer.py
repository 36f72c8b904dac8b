"""Beside which model a scene's own one is put, and why beside none."""

from __future__ import annotations

from pathlib import Path

import pytest

from pmr.errors import InputError
from pmr.scene import load_any
from pmr.scene.choice import model_of
from pmr.scene.members import members
from pmr.scene.richer import COORDINATES, PLACES, beside

WORKFLOWS = Path(__file__).parents[2] / "workflows"


def scene(name: str, *changes: str):
    return load_any(WORKFLOWS / f"{name}.toml", list(changes))


def models(one) -> set[str]:
    return {model_of(member) for member in members(one)}


@pytest.mark.parametrize(
    ("name", "asked", "own", "richer"),
    [
        ("boom_beam", "next", "beam3d", "shell"),
        ("boom_beam", "shell", "beam3d", "shell"),
        ("boom_beam_walls", "next", "beam3d", "shell"),
        ("boom_three", "next", "beam2d", "beam3d"),
        ("boom_three", "shell", "beam2d", "shell"),
    ],
)
def test_the_next_richer_model_or_that_asked_for(name: str, asked: str, own: str, richer: str) -> None:
    one, other, called = beside(scene(name, f"compare.richer={asked}"))
    assert (models(one), models(other), called) == ({own}, {richer}, richer)
    for part, better in zip(one.sections, other.sections, strict=True):
        assert part.reduction == better.reduction and part.reduction.coordinates == COORDINATES
        assert part.observe == better.observe and len(part.observe.stations) == PLACES
        assert (part.pads, part.masses, part.loads, part.supports) == (
            better.pads, better.masses, better.loads, better.supports
        )  # fmt: skip
    assert {part.body.walls for part in other.sections} == {"rigid"}


@pytest.mark.parametrize(
    ("name", "asked", "why"),
    [
        ("boom_shell", "next", "richest"),
        ("boom_solid", "shell", "richest"),
        ("boom_beam", "beam3d", "knows as much"),
        ("paper_evolved", "next", "a box is needed"),
    ],
)
def test_why_there_is_no_richer_one_is_said(name: str, asked: str, why: str) -> None:
    with pytest.raises(InputError, match=why):
        beside(scene(name, f"compare.richer={asked}"))


def test_cells_of_the_shell_may_be_said_where_a_beam_is_compared_with_one() -> None:
    assert scene("boom_beam", "compare.richer=shell", "mesh.size=0.2").sections[0].mesh.size == 0.2
    with pytest.raises(InputError, match="no effect"):
        scene("boom_beam", "mesh.size=0.2")
