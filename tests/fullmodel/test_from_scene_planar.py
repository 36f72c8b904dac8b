"""A boom as a planar beam: what it knows acts the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pmr import scene as scenes
from pmr.fem.compat import MPI
from pmr.fullmodel.build import build
from pmr.fullmodel.from_scene import structure_of
from pmr.scene.members import member_at

WORKFLOWS = Path(__file__).parents[2] / "workflows"
CLAMP = "{on='tail',kind='clamped',points='all'}"
PADS = "pads=[{name='mouth',moving=true,faces={bottom=[0.0],left=[0.0]}}]"
PLAIN = [PADS, "body.shear=false", "mesh.elements=6", "observe.count=5", "masses=[]"]


def deflections(model: str, load: str, clamps: str) -> np.ndarray:
    """Vertical displacements in statics under one load, the mouth's pads apart; at five places and the tip."""
    loads = f"loads=[{{name='F',on='tip',direction='{load}',signal=1.0}}]"
    scene = scenes.load(WORKFLOWS / "boom_beam.toml", [*PLAIN, f"body.model={model}", loads, f"supports=[{clamps}]"])
    body = build(scene, MPI.COMM_SELF).model.gather()
    assert body is not None
    y = body.outputs @ np.linalg.solve(body.K.toarray(), body.B[:, 0])
    return y if model == "beam2d" else y[[*range(5, 10), 11]]


@pytest.mark.parametrize("load", ["z", "ry"])
def test_planar_beams_answer_forces_and_moments_as_beams_in_space(load: str) -> None:
    """A clamp on all directions holds rotation too; a moment about y turns the tip the same way."""
    planar, space = (deflections(model, load, CLAMP) for model in ("beam2d", "beam3d"))
    assert np.abs(space).max() > 0.0
    assert planar == pytest.approx(space, rel=1e-6, abs=1e-9 * np.abs(space).max())


def test_a_lateral_clamp_holds_nothing_of_a_planar_beam() -> None:
    """What a support holds along y must not hold the vertical."""
    both = CLAMP + ",{on='tip',directions=['y'],points='all'}"
    alone, beside = (deflections("beam2d", "z", clamps) for clamps in (CLAMP, both))
    assert beside == pytest.approx(alone, rel=1e-12)


@pytest.mark.parametrize("model", ["beam2d", "beam3d"])
def test_the_tips_rotation_is_an_output_in_rad(model: str) -> None:
    """- F L^2 / (2 EI) under a force upwards: positive about y is downwards along x."""
    loads = "loads=[{name='F',on='tip',direction='z',signal=1.0}]"
    changes = [*PLAIN, f"body.model={model}", loads, f"supports=[{CLAMP}]", "observe.rotation=true"]
    scene = scenes.load(WORKFLOWS / "boom_beam.toml", changes)
    body = build(scene, MPI.COMM_SELF).model.gather()
    assert body is not None
    number = body.output_names.index("tip ry")
    assert body.output_units[number] == "rad"
    box = scene.body.box
    outer, inner = (box.width + box.wall, box.height + box.wall), (box.width - box.wall, box.height - box.wall)
    EI = scene.body.material.young * (outer[0] * outer[1] ** 3 - inner[0] * inner[1] ** 3) / 12.0
    turned = body.outputs[number] @ np.linalg.solve(body.K.toarray(), body.B[:, 0])
    assert turned == pytest.approx(-(box.length**2) / (2.0 * EI), rel=1e-6)


def test_of_a_fine_beam_some_nodes_are_observed() -> None:
    """With all of them the tables of outputs would grow with the square of the mesh."""
    changes = ["mesh.elements=2500", "compare.against=[]"]
    structure = structure_of(member_at(scenes.load(WORKFLOWS / "paper_simple.toml", changes)), MPI.COMM_SELF)
    assert structure.model.node_stations is not None
    *line, tip = [one.on for one in structure.outputs]
    assert line == pytest.approx(structure.model.node_stations[:-1:3]) and tip == "tip"
