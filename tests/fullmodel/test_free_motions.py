"""What supports and pads leave free, against what is known of each arrangement."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pmr import scene as scenes
from pmr.fullmodel import free_motions
from pmr.fullmodel.build import build
from pmr.fullmodel.from_scene import structure_of
from pmr.run import run

WORKFLOWS = Path(__file__).parents[2] / "workflows"
VERTICAL = "loads=[{name='F',signal=1.0}]"
NOTHING = "supports=[]"


def pads(tail: str, mouth: str) -> str:
    rings = [f"{{name='tail',at=0.15,faces={{{tail}}}}}"] if tail else []
    return f"pads=[{','.join([*rings, f'{{name=`mouth`,moving=true,faces={{{mouth}}}}}'])}]".replace("`", "'")


ALL = "bottom=[-0.1,0.1],top=[-0.1,0.1],left=[0.0],right=[0.0]"
UPRIGHT = "bottom=[-0.1,0.1],top=[-0.1,0.1]"
ONE = "bottom=[0.0],left=[0.0]"
AT = " with s at 1.5 m"


@pytest.mark.parametrize("model", ["beam3d", "shell"])
@pytest.mark.parametrize(
    ("changes", "free", "where"),
    [
        ((), [], ""),
        ((NOTHING,), ["move along x"], ""),
        ((pads(UPRIGHT, UPRIGHT),), ["move along y", "turn about z"], ""),
        ((pads(ONE, ONE),), ["turn about x"], ""),
        ((pads("", ALL),), ["turn about y through (1.5, 0, 0) m", "turn about z through (1.5, 0, 0) m"], AT),
        ((pads("", "bottom=[0.0]"), NOTHING), ["move along x", "move along y", "turn about x",
                                               "turn about y through (1.5, 0, 0) m", "turn about z"], AT),
        ((pads("", "bottom=[0.0]"), "supports=[{on='tail',kind='clamped',points='all'}]"), [], ""),
        ((pads("", ALL), "supports=[{on='tail',directions=['x','y','z'],points='all'}]"), [], ""),
    ],
)  # fmt: skip
def test_what_is_free_is_found_and_named(model: str, changes: tuple[str, ...], free: list[str], where: str) -> None:
    file = WORKFLOWS / f"boom_{model.removesuffix('3d')}.toml"
    scene = scenes.load(file, ["mesh.size=0.2", "mesh.along=0.5", *changes])
    said = free_motions.warnings(structure_of(scene), scene.path_bounds)
    assert len(said) == (1 if free else 0)
    for line in said:
        assert all(words in line for words in free) and f"{where}: loads along that" in line
        assert line.count("move along") + line.count("turn about") == len(free)


def test_what_holds_in_one_place_only_is_named_with_the_place() -> None:
    """The mouth begins where the tail's pads are: both hold the same place, and the boom can turn about it."""
    rings = "{name='tail',at=1.5,faces={bottom=[0.0,0.1],left=[0.0]}},{name='mouth',moving=true,faces={bottom=[0.0]}}"
    scene = scenes.load(WORKFLOWS / "boom_beam.toml", [f"pads=[{rings}]"])
    (said,) = free_motions.warnings(structure_of(scene), scene.path_bounds)
    assert "turn about y through (1.5, 0, 0) m, turn about z through (1.5, 0, 0) m with s at 1.5 m" in said


def test_a_planar_beam_is_told_in_the_words_of_the_scene() -> None:
    scene = scenes.load(WORKFLOWS / "boom_beam.toml", ["body.model=beam2d", VERTICAL, pads("", "bottom=[0.0]")])
    (said,) = free_motions.warnings(structure_of(scene), scene.path_bounds)
    assert "free to turn about y through (1.5, 0, 0) m with s at 1.5 m" in said
    rolling = ["body.profile.axial=true", "supports=[{on=0.0,kind='roller'}]"]
    planar = scenes.load(WORKFLOWS / "paper_simple.toml", rolling + ["compare.against=['full']"])
    assert "free to move along x:" in free_motions.warnings(build(planar).structure, planar.path_bounds)[0]
    pinned = scenes.load(WORKFLOWS / "paper_simple.toml")
    assert free_motions.warnings(build(pinned).structure, pinned.path_bounds) == []


def test_free_motions_do_not_depend_on_where_the_origin_is() -> None:
    """A turn about an axis of any direction through any point is found again, whatever moves beside it."""
    rng = np.random.default_rng(8)
    for _ in range(20):
        d, p = rng.normal(size=3), rng.normal(size=3)
        d /= np.linalg.norm(d)
        (said,) = free_motions.described(np.concatenate([np.cross(p, d), d])[:, None] * rng.uniform(1e-3, 1e3))
        at = p - d * (d @ p)  # the point of the axis nearest to the origin
        found = np.array([float(x) for x in said.split("through (")[1].removesuffix(") m").split(", ")])
        assert found == pytest.approx(at, abs=1e-3)


def test_a_run_says_what_is_free() -> None:
    """A boom free along its axis runs, for nothing pushes it there."""
    short = ["time.end=0.1", "time.step=0.01", "recovery.every=0.05", "recovery.stress=false", "compare.against=[]"]
    scene = scenes.load(WORKFLOWS / "boom_beam.toml", [*short, "mesh.elements=20", NOTHING])
    outcome = run(scene)
    assert outcome is not None
    assert any("free to move along x:" in line for line in outcome.result.summary["warnings"])
