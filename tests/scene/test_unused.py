"""Keys without an effect: refused where they stand beside what decides so, and taken over from what others share."""

from __future__ import annotations

from pathlib import Path

import pytest

from pmr import scene as scenes
from pmr.errors import InputError

WORKFLOWS = Path(__file__).parents[2] / "workflows"
REFUSED = [
    ("boom_beam", "mesh.size=0.1", "mesh.size: leave it out: it has no effect on beam3d"),
    ("boom_beam", "mesh.cells=tetrahedra", "mesh.cells: leave it out"),
    ("boom_beam", "body.shear_correction=1.0", "body.shear_correction: leave it out"),
    ("boom_beam", "reduction.snapshots=3", "reduction.snapshots: leave it out: basis = 'free_modes' has no eigenmodes"),
    ("boom_beam", "compare.ancf_elements=5", "compare.ancf_elements: leave it out"),
    ("boom_beam", "simulation.newton={relativeTolerance=1e-9}", "simulation.newton: leave it out: Exudyn"),
    ("boom_beam_walls", "mesh.tail_layer=0.1", "mesh.tail_layer: leave it out: it has no effect on beam3d"),
    ("boom_shell", "body.walls=give", "body.walls: leave it out: it has no effect on shell"),
    ("boom_solid", "body.walls=give", "body.walls: leave it out: it has no effect on solid"),
    ("boom_shell", "mesh.elements=5", "mesh.elements: leave it out: it has no effect on shell"),
    ("boom_shell", "mesh.cells=tetrahedra", "mesh.cells: leave it out"),
    ("boom_solid", "body.shear=false", "body.shear: leave it out"),
    ("paper_simple", "body.shear=true", "body.shear: leave it out: it has no effect on beam2d"),
    ("paper_simple", "body.material.young=7e10", "body.material: leave it out: a profile holds stiffness"),
    ("paper_simple", "observe.count=5", "observe.count: leave it out"),
    ("boom_three", "sections.fly.mesh.size=0.1", r"sections\[2\].mesh.size: leave it out: it has no effect on beam2d"),
    ("boom_three", "sections.fly.body.box.frame_depth=0.1", r"sections\[2\].body.box.frame_depth: leave it out"),
    ("boom_three", "sections.fly.joint.ratio=2.0", r"sections\[2\].joint.ratio: leave it out: fly follows no other"),
    ("boom_three", "sections.fly.joint.tail.0.shear_stiffness=1e7", r"sections\[2\].joint.tail.0.shear_stiffness:"),
    ("boom_three", "sections.fly.joint.tail.0.stribeck_speed=0.1", r"sections\[2\].joint.tail.0.stribeck_speed:"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "change", "says"), REFUSED, ids=[f"{a}-{b}" for a, b, _ in REFUSED])
def test_a_key_without_effect_is_refused_in_one_line(name: str, change: str, says: str) -> None:
    with pytest.raises(InputError, match=f"--set: {says}") as refused:
        scenes.load_any(WORKFLOWS / f"{name}.toml", [change])
    assert "\n" not in str(refused.value)


def test_frames_that_a_planar_beam_inherits_are_refused_for_their_mass() -> None:
    with pytest.raises(
        InputError, match=r"sections\[0\].body.model = 'beam2d': beam3d and shell are allowed with body.box.frames"
    ):
        scenes.load_any(WORKFLOWS / "boom_three.toml", ["section.body.box.frames=[3.0]"])
    assert scenes.load_any(WORKFLOWS / "boom_three.toml", ["section.body.box.frames=[]"])


def test_what_is_taken_over_may_be_of_use_to_others(tmp_path: Path) -> None:
    """A shell's scene with a beam in its place, sections that share what some have no use for; not one's own file."""
    assert scenes.load_any(WORKFLOWS / "boom_shell.toml", ["body.model=beam3d"])
    assert scenes.load_any(WORKFLOWS / "boom_three.toml", ["section.mesh.size=0.1", "section.body.box.frame_depth=0.1"])
    assert scenes.load_any(WORKFLOWS / "boom_three_shell.toml", ["sections.base.body.model=beam3d"])
    own = tmp_path / "scene.toml"
    own.write_text('extends = "boom_shell"\nbody.model = "beam3d"')
    assert scenes.load_any(own)
    own.write_text('extends = "boom_shell"\nbody.model = "beam3d"\nmesh.size = 0.2')
    with pytest.raises(InputError, match=r"scene.toml: mesh.size: leave it out"):
        scenes.load_any(own)
