"""Booms in a frame that moves, from the scene to forces and deflections."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pmr
from pmr import scene as scenes
from pmr.results import Response

WORKFLOWS = Path(__file__).parents[2] / "workflows"
RAISED = f"frame.luffing={np.deg2rad(50.0)}"
PIVOT = "frame.pivot=[0.0, 0.0, 0.0]"
#: Three planar sections, their payload and a load, for a moment.
SHORT = ("time.end=0.2", "section.mesh.elements=8", "section.reduction.estimate=false", "compare.against=[]")


def moved(name: str, *changes: str) -> Response:
    scene = scenes.load_any(WORKFLOWS / f"{name}.toml", changes)
    return pmr.simulate(scene, pmr.reduce(scene).reduced)


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("boom_three", SHORT),
        ("boom_beam", ("time.end=0.2", "mesh.elements=20", "compare.against=[]")),
    ],
)
def test_gravity_that_a_frame_at_rest_has_turned_is_gravity_given_so(name: str, changes: tuple[str, ...]) -> None:
    given, turned = moved(name, *changes, "gravity.inclination=50.0"), moved(name, *changes, PIVOT, RAISED)
    # of the same equations: round-off of a step, 1e-13 of the largest, in some hundred of them
    assert turned.displacement == pytest.approx(given.displacement, abs=1e-10 * np.abs(given.displacement).max())
    assert turned.slider_force == pytest.approx(given.slider_force, abs=1e-9 * np.abs(given.slider_force).max())
