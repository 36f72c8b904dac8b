"""What supports and pads leave free, against what is known of each arrangement."""

import os
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from bricks import on_pads
from frames3d import lattice

from pmr import InputError, from_matrices, run
from pmr import scene as scenes
from pmr.errors import NotHeldError
from pmr.fem.compat import MPI
from pmr.files.matrices import GivenMatrices
from pmr.fullmodel import build
from pmr.fullmodel.build import CheckedPositions, build_bodies, free_motion_warnings
from pmr.scene import Scene
from pmr.scene.checks import check_scene

WORKFLOWS = Path(__file__).parents[2] / "workflows"
VERTICAL = "loads=[{name='F',signal=1.0}]"
NOTHING = "supports=[]"
ALLOWED = "free_motions=allowed"


def refused(scene: Scene) -> list[str]:
    """The line in which its free motions are refused, if they are."""
    try:
        build_bodies(scene, MPI.COMM_SELF)
    except InputError as error:
        assert error.key == "free_motions"
        return [str(error)]
    return []


def pads(tail: str, mouth: str) -> str:
    rings = [f"{{name='tail',at=0.15,faces={{{tail}}}}}"] if tail else []
    return f"pads=[{','.join([*rings, f'{{name=`mouth`,moving=true,faces={{{mouth}}}}}'])}]".replace("`", "'")


ALL = "bottom=[-0.1,0.1],top=[-0.1,0.1],left=[0.0],right=[0.0]"
UPRIGHT = "bottom=[-0.1,0.1],top=[-0.1,0.1]"
ONE = "bottom=[0.0],left=[0.0]"
AT = " with s at 1.5 m"


@pytest.mark.parametrize("model", ["beam3d", pytest.param("shell", marks=pytest.mark.slow)])
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
    coarse = ["mesh.elements=10"] if model == "beam3d" else ["mesh.size=0.2", "mesh.along=0.5"]
    scene = scenes.load(file, [*coarse, *changes])
    said = refused(scene)
    assert len(said) == (1 if free else 0)
    for line in said:
        assert all(words in line for words in free) and f"{where}: loads along that" in line
        assert line.count("move along") + line.count("turn about") == len(free)


def test_what_holds_in_one_place_only_is_named_with_the_place() -> None:
    """The mouth begins where the tail's pads are: both hold the same place, and the boom can turn about it."""
    rings = "{name='tail',at=1.5,faces={bottom=[0.0,0.1],left=[0.0]}},{name='mouth',moving=true,faces={bottom=[0.0]}}"
    scene = scenes.load(WORKFLOWS / "boom_beam.toml", [f"pads=[{rings}]"])
    (said,) = refused(scene)
    assert "turn about y through (1.5, 0, 0) m, turn about z through (1.5, 0, 0) m with s at 1.5 m" in said


def test_a_planar_beam_is_told_in_the_words_of_the_scene() -> None:
    scene = scenes.load(WORKFLOWS / "boom_beam.toml", ["body.model=beam2d", VERTICAL, pads("", "bottom=[0.0]")])
    (said,) = refused(scene)
    assert "free to turn about y through (1.5, 0, 0) m with s at 1.5 m" in said
    rolling = ["body.profile.axial=true", "supports=[{on=0.0,kind='roller'}]"]
    planar = scenes.load(WORKFLOWS / "paper_simple.toml", rolling + ["compare.against=['full']"])
    assert "the body free to move along x:" in refused(planar)[0]
    assert refused(scenes.load(WORKFLOWS / "paper_simple.toml")) == []


def test_free_motions_do_not_depend_on_where_the_origin_is() -> None:
    """A turn about an axis of any direction through any point is found again, whatever moves beside it."""
    rng = np.random.default_rng(8)
    for _ in range(20):
        d, p = rng.normal(size=3), rng.normal(size=3)
        d /= np.linalg.norm(d)
        (said,) = build.describe_motions(np.concatenate([np.cross(p, d), d])[:, None] * rng.uniform(1e-3, 1e3))
        at = p - d * (d @ p)  # the point of the axis nearest to the origin
        found = np.array([float(x) for x in said.split("through (")[1].removesuffix(") m").split(", ")])
        assert found == pytest.approx(at, abs=1e-3)


@pytest.mark.slow
def test_a_run_says_what_is_free_where_that_is_allowed() -> None:
    """A boom free along its axis runs, for nothing pushes it there."""
    short = ["time.end=0.1", "time.step=0.01", "recovery.every=0.05", "recovery.stress=false", "compare.against=[]"]
    scene = scenes.load(WORKFLOWS / "boom_beam.toml", [*short, "mesh.elements=20", NOTHING, ALLOWED])
    outcome = run(scene)
    assert outcome is not None
    assert any("free to move along x:" in line for line in outcome.result.summary["warnings"])


PIVOT, LUFFING = 0.4, 1.6
SIDES = ("bottom=[-0.08,0.08]", "top=[-0.08,0.08]", "left=[0.0]")
SWEEP = range(30) if os.environ.get("PMR_SWEEP") == "full" else range(0, 30, 4)


def ring(faces: Sequence[str], at: float = 0.2) -> str:
    return f"{{at={at},width=0.04,stiffness=1e8,faces={{{','.join(faces)}}}}}"


@dataclass(frozen=True)
class Machine:
    """A machine that lacks a support, and what that leaves free."""

    scene: Scene
    section: str
    free: tuple[str, ...]


def without_a_support(seed: int) -> Machine:
    """A boom of two to five sections on a pivot and a luffing cylinder, or a beam on a pivot and a slider."""
    rng = np.random.default_rng(seed)
    if rng.random() < 0.2:
        return beam_without_a_support(rng)
    planar, count, lengths = rng.random() < 0.4, int(rng.integers(2, 6)), rng.uniform(6.0, 7.0, 5)
    extensions = rng.uniform(1.2, 2.5, 5)
    held = {d: PIVOT for d in (("x", "z") if planar else ("x", "y", "z", "rx", "rz"))} | {"luffing": LUFFING}
    at = int(rng.integers(0, count))
    joints = [[list(SIDES), list(SIDES)] for _ in range(count)]  # at tail and mouth
    if at == 0:
        lost = str(rng.choice(list(held)))
        del held[lost]
        free = {"x": "move along x", "y": "move along y", "z": turn("y", LUFFING), "rx": "turn about x",
                "rz": turn("z", PIVOT), "luffing": turn("y", PIVOT)}[lost]  # fmt: skip
        lacking = (free,)
    else:
        tail = float(extensions[1 : at + 1].sum())
        mouth = float(extensions[1:at].sum() + lengths[at - 1]) - 0.2
        places, end = (mouth, tail + 0.2), int(rng.integers(0, 2))  # without the tail's it turns about the mouth's
        if planar:
            joints[at][end], lacking = [SIDES[2]], (turn("y", places[end]),)
        elif (kind := int(rng.integers(0, 3))) == 0:
            joints[at][end], lacking = list(SIDES[:2]), (turn("z", places[end]),)
        elif kind == 1:
            joints[at], lacking = [list(SIDES[:2]), list(SIDES[:2])], ("move along y", "turn about z")
        else:
            one = ["bottom=[0.0]", "top=[0.0]", "left=[0.0]"]
            joints[at], lacking = [one, one], ("turn about x",)
    supports = [
        f"{{name='{d}',on={x},directions=['{'z' if d == 'luffing' else d}']"
        + (",stiffness=5e7}" if d == "luffing" and rng.random() < 0.5 else "}")
        for d, x in held.items()
    ]
    sections = []
    for k in range(count):
        box = f"{{length={lengths[k]},width={0.36 - 0.03 * k},height={0.4 - 0.03 * k},wall=0.005}}"
        parts = [f"name='part {k}'", f"body={{model='{'beam2d' if planar else 'beam3d'}',box={box}}}"]
        if k:
            value = f"{{kind='smooth_ramp',times=[0.1,0.9],values=[{extensions[k]},{extensions[k] + 0.5}]}}"
            rings = [f"{end}=[{ring(faces)}]" for end, faces in zip(("tail", "mouth"), joints[k], strict=True)]
            parts.append(f"joint={{extension={value},{','.join(rings)}}}")
        else:
            parts.append(f"supports=[{','.join(supports)}]")
        sections.append(f"{{{','.join(parts)}}}")
    content = f"title='machine'\nsection={{mesh={{elements=6}}}}\nsections=[{','.join(sections)}]\n"
    boom = Scene.model_validate(tomllib.loads(content + "time={end=1.0,step=1e-3}"))
    check_scene(boom)
    return Machine(boom, f"part {at}", lacking)


def beam_without_a_support(rng: np.random.Generator) -> Machine:
    lost, start = str(rng.choice(["x", "z"])), round(float(rng.uniform(1.0, 3.0)), 3)
    left = "z" if lost == "x" else "x"
    content = (
        "title='beam'\nbody.profile={length=6.0,bending_stiffness=1e5,mass_per_length=50.0,axial=true,axial_stiffness=1e8}\n"
        f"mesh.elements=8\nloads=[{{signal=1.0}}]\nsupports=[{{on=0.0,directions=['{left}']}}]\ntime={{end=1.0,step=1e-3}}\n"
        f"slider.path={{kind='ramp',times=[0.0,1.0],values=[{start},4.0]}}"
    )
    scene = Scene.model_validate(tomllib.loads(content))
    check_scene(scene)
    return Machine(scene, "the body", ("move along x" if lost == "x" else turn("y", start),))


def turn(axis: str, x: float) -> str:
    return f"turn about {axis} through ({x:.4g}, 0, 0) m"


@pytest.mark.slow
@pytest.mark.parametrize("seed", SWEEP)
def test_a_machine_without_one_of_its_supports_is_refused_before_it_is_reduced(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What moves, and how, follows from what was taken away."""
    machine = without_a_support(seed)
    monkeypatch.setattr("pmr.pipeline.bodies.reduce_bodies", None)
    with pytest.raises(InputError) as error:
        run(machine.scene, MPI.COMM_SELF)
    said = str(error.value)
    assert error.value.key == "free_motions" and "\n" not in said
    assert f"leave {machine.section} " in said and all(words in said for words in machine.free)
    assert said.count("move along") + said.count("turn about") == len(machine.free)


@pytest.mark.slow
def test_a_boom_on_a_pivot_and_a_cylinder_is_held_where_its_pin_is() -> None:
    """In space a point and a cylinder leave it free to turn about two axes; in the plane they hold it."""
    space = ("section.body.model=beam3d", *(f"section.joint.{end}=[{ring(SIDES)}]" for end in ("tail", "mouth")))
    luffing = "{directions=['z'],on=1.5,stiffness=5e7}"
    point = f"sections.base.supports=[{{kind='pinned'}},{luffing}]"
    pin = f"sections.base.supports=[{{directions=['x','y','z','rx','rz']}},{luffing}]"
    file, few = WORKFLOWS / "boom_two.toml", "section.mesh.elements=6"
    assert refused(scenes.load_any(file, [few, point])) == []
    assert refused(scenes.load_any(file, [few, *space, pin])) == []
    (said,) = refused(scenes.load_any(file, [few, *space, point]))
    assert "leave base with what it carries free to turn about x through (0, 0, 0) m, turn about z" in said


def test_a_boom_may_be_free_where_its_scene_allows_it() -> None:
    rollers = "sections.base.supports=[{kind='roller'},{kind='roller',on=2.0}]"
    boom = scenes.load_any(WORKFLOWS / "boom_two.toml", ["section.mesh.elements=6", rollers, ALLOWED])
    (said,) = free_motion_warnings(boom, build_bodies(boom, MPI.COMM_SELF))
    assert "leave base with what it carries free to move along x: loads" in said
    with pytest.raises(NotHeldError) as error:
        build_bodies(boom.model_copy(update={"free_motions": "refused"}), MPI.COMM_SELF)
    assert error.value.short == "base can move along x"


def test_what_is_free_is_said_shortly_by_its_first_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    turned = {"middle": ["move along y", "turn about x"], "fly": ["move along y"]}
    monkeypatch.setattr(build, "describe_motions", lambda motions: motions)
    monkeypatch.setattr(build, "free_motions", lambda *_: [turned])
    way = CheckedPositions({}, {}, ["at t = 0 s"])
    found = build.describe_free_motions(SimpleNamespace(bodies=dict.fromkeys(("base", "middle", "fly"))), {}, way)
    assert found.clause == "middle and fly can move along y, and in 1 more way"
    assert found.sentence == "middle with what it carries free to move along y, turn about x; fly free to move along y"


def test_what_given_matrices_hold_by_themselves_is_not_free(tmp_path: Path) -> None:
    """Nodes without rows stand still: the same bar is free where all of its nodes move."""
    file = on_pads(tmp_path)
    bare = ["supports=[]", "pads.0.faces={bottom=[0.0]}"]
    (said,) = refused(scenes.load(file, bare))
    assert "the body free to move along x, turn about x" in said
    bar = GivenMatrices.load(tmp_path / "bar.npz")
    moves = np.flatnonzero(bar.points[bar.node, 0] > 0.0)
    M, K = (A[moves][:, moves] for A in (bar.M, bar.K))
    held = from_matrices(M, K, bar.points, bar.groups, node=bar.node[moves], direction=bar.direction[moves])
    held.save(tmp_path / "bar.npz")
    assert refused(scenes.load(file, bare)) == []


@pytest.mark.slow
def test_supports_close_to_each_other_and_short_overlaps_hold() -> None:
    """Pins 10 mm apart, 0.35 m of overlap in every joint of a boom of five sections; one pin of them is too few."""
    pins = [f"{{name='{d} {x}',on={x},directions=['{d}']}}" for d, x in (("x", 0.0), ("z", 0.0), ("z", 0.01))]
    pads = ring(SIDES[:2], 0.15).replace("width=", "length=0.04,width=")
    joint = f"joint={{extension=11.65,tail=[{pads}],mouth=[{pads}]}}}}"
    parts = [
        f"{{name='{k}',body.box={{width={0.36 - 0.03 * k},height={0.4 - 0.03 * k}}},"
        + (joint if k else "supports=PINS}")
        for k in range(5)
    ]
    common = "{mesh={elements=6},body={model='beam2d',box={length=12.0,wall=0.005}}}"
    for count in (3, 2):
        text = f"title='long'\nsection={common}\nsections=[{','.join(parts)}]\ntime={{end=1.0,step=1e-3}}"
        boom = Scene.model_validate(tomllib.loads(text.replace("PINS", f"[{','.join(pins[:count])}]")))
        check_scene(boom)
        said = refused(boom)
        assert len(said) == 3 - count and all("0 with what it carries free to turn about y" in one for one in said)


@pytest.mark.parametrize(
    ("axes", "parallel"),
    [
        (((1, 0, 0), (0, 1, 0), (0, 0, 1)), True),
        (((1, 0, 0), (0, -1, 0), (0, 0, -1)), False),  # z down
        (((1, 0, 0), (0, 0, -1), (0, 1, 0)), False),  # y up
    ],
)
@pytest.mark.parametrize("points", ["mean", "all"])
def test_sections_whose_faces_turn_elsewhere_are_refused(
    axes: tuple, parallel: bool, points: str, tmp_path: Path
) -> None:
    """Rows of such pads would take the base's displacement with another sign, or along another axis, than the fly's.

    Near a clamp of all points they take a part of it.
    """
    given, R = lattice(), np.array(axes, float)
    T = np.kron(np.eye(len(given.points)), R)
    file = from_matrices(T @ given.M @ T.T, T @ given.K @ T.T, given.points @ R.T, given.groups).save(
        tmp_path / "f.npz"
    )
    faces = {"bottom": [-0.1, 0.1], "top": [0.0], "left": [0.0], "right": [0.0]}
    ring = {"at": 0.15, "stiffness": 1e8, "faces": faces}
    joint = {"extension": 0.3, "tail": [ring], "mouth": [ring]}
    box = {"length": 6.0, "width": 0.6, "height": 0.7, "wall": 0.01}
    base = {"name": "base", "body": {"model": "beam3d", "box": box}, "mesh": {"elements": 4}}
    fly = {"name": "fly", "body": {"model": "matrices"}, "mesh": {"file": str(file)}, "joint": joint}
    boom = Scene.model_validate(
        {
            "title": "A section of another program",
            "sections": [
                base | {"supports": [{"name": "clamp", "kind": "clamped", "points": points}]},
                fly | {"observe": {"start": 0.5, "end": 5.5}},
            ],
            "time": {"end": 1.0, "step": 1e-2},
        }
    )
    if parallel:
        build_bodies(boom, MPI.COMM_SELF)
        return
    with pytest.raises(InputError, match=r"sections\[1\].joint: faces .* at the pad fly tail bottom right are not"):
        build_bodies(boom, MPI.COMM_SELF)
