"""Masses and centres of gravity of bodies, beside what their dimensions say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pmr.fullmodel.build import build_bodies
from pmr.scene import load_any

WORKFLOWS = Path(__file__).parents[2] / "workflows"
CELLS = {"beam3d": ["mesh.elements=6"], "shell": ["mesh.size=0.2", "mesh.along=0.5"]}
LENGTH, WIDTH, HEIGHT, WALL, DENSITY, PAYLOAD = 6.0, 0.3, 0.4, 0.008, 7850.0, 250.0


@pytest.mark.mpi
@pytest.mark.parametrize("model", ["beam3d", "shell"])
def test_a_box_weighs_what_its_walls_do(model: str) -> None:
    """With the payload at its tip; its centre is between both."""
    scene = load_any(WORKFLOWS / "boom.toml", [f"body.model={model}", *CELLS[model]])
    (built,) = build_bodies(scene).values()
    found = built.model.masses
    assert found is not None
    own = DENSITY * LENGTH * 2.0 * (WIDTH + HEIGHT) * WALL
    assert found.body == pytest.approx(own, rel=1e-9) and found.attached == PAYLOAD
    centre = (own * LENGTH / 2.0 + PAYLOAD * LENGTH) / (own + PAYLOAD)
    assert found.centre == pytest.approx([centre, 0.0, 0.0], abs=1e-9 * LENGTH)


@pytest.mark.mpi
def test_a_clamp_takes_no_mass_and_a_planar_beam_has_its_own() -> None:
    scene = load_any(WORKFLOWS / "boom_two.toml", ["section.mesh.elements=5", "sections.base.supports.0.points=all"])
    base, fly = (one.model.masses for one in build_bodies(scene).values())
    assert base is not None and fly is not None
    box = scene.sections[0].body.box
    assert box is not None
    own = DENSITY * box.length * 2.0 * (box.width + box.height) * box.wall
    assert base.body == pytest.approx(own, rel=1e-9) and base.attached == 0.0
    assert base.centre == pytest.approx([box.length / 2.0, 0.0, 0.0], abs=1e-9)
    assert fly.attached == sum(mass.mass for mass in scene.sections[1].masses) > 0.0 and fly.centre[0] > 3.0
    assert np.all(fly.centre[1:] == 0.0)
