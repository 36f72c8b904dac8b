"""Random structures: rigid-body modes as the geometry of the supports has them, the reduced model as the full one.

Beams, shells and solids; lengths, sections and stiffnesses over decades; pads, cylinders and clamps of all kinds.
PMR_SWEEP=full tries all 200, otherwise every twenty-fifth is.
"""

import os
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import pytest
from alone import estimate

from pmr import InputError, simulate
from pmr import scene as scenes
from pmr.compare.errors import errors_between
from pmr.compare.responses import compared_quantities
from pmr.fullmodel.build import build
from pmr.pipeline.full_order import FullOrder
from pmr.reduction.bodies import reduce_body
from pmr.reduction.free_body import rigid_modes
from pmr.scene.keys import ALONE
from pmr.simulation import Excitation

BOOM = "boom_beam"
COUNT = 200
NUMBERS = range(COUNT) if os.environ.get("PMR_SWEEP") == "full" else sorted({*range(0, COUNT, 50), 40, 139})
MODELS = ("beam3d", "beam3d", "beam2d", "shell", "solid", "beam3d", "beam2d", "beam2d")
NORMALS = {"bottom": (0, 0, -1), "top": (0, 0, 1), "left": (0, 1, 0), "right": (0, -1, 0)}


@dataclass(frozen=True)
class Case:
    """Overrides of a scene, and the rows of its supports on the six rigid motions as decimal numbers."""

    model: str
    overrides: list[str]
    rows: list[tuple[str, ...]]


def case(number: int) -> Case:
    random = np.random.default_rng([20240611, number])
    model = MODELS[number % len(MODELS)]
    thick = model in ("shell", "solid")
    length = round(float(10 ** random.uniform(0.3, 0.9 if thick else 1.8)), 3)
    width = round(length * float(random.uniform(0.1, 0.2) if thick else 10 ** random.uniform(-1.7, -0.9)), 4)
    height = round(width * float(random.uniform(0.7, 1.6)), 4)
    wall = round(width * float(random.uniform(0.03, 0.1)), 5)
    young = float(f"{10 ** random.uniform(9, 11.5):.3g}")
    rigidity = young * wall * height**3 / length**3  # N/m, of the order of the beam's own stiffness at its tip
    mesh = (
        f"mesh={{size={max(width, height) / 2.0},along={length / 10.0}}}"
        if thick
        else (f"mesh={{elements={int(random.integers(12, 41))}}}")
    )
    rows: list[tuple[str, ...]] = []
    mouth = ring(random, width, height)[0]
    if model == "beam2d" and "bottom" not in mouth and "top" not in mouth:  # a planar beam feels no others
        mouth = mouth.replace("left", "bottom").replace("right", "top")
    pads = [f"{{name='mouth',moving=true,{mouth},length={length / 10},width={width / 4},"
            f"stiffness={stiffness(random, rigidity)}}}"]  # fmt: skip
    for i in range(int(random.integers(0, 3))):
        faces, places = ring(random, width, height)
        at = round(length * float(random.uniform(0.06, 0.3)), 4)
        pushes = model != "beam2d" and random.random() < 0.1
        pads.append(f"{{name='ring {i}',at={at},{faces},length={length / 10},width={width / 4},"
                    f"stiffness={stiffness(random, rigidity)},unilateral={str(pushes).lower()}}}")  # fmt: skip
        if not pushes:
            rows += [pad_row(face, at, across, width, height) for face, across in places]
    held = list(random.choice(["x", "z"] if model == "beam2d" else ["x", "y", "z"], random.integers(0, 3), False))
    supports = [f"{{name='rod {d}',directions=['{d}'],stiffness={stiffness(random, rigidity)}}}" for d in held]
    rows += [point_row(d, ("0", "0", "0")) for d in held]
    clamps: list[str] = []
    if random.random() < 0.25:
        known = {"solid": ["x", "y", "z"]}.get(model, ["x", "y", "z", "rx", "ry", "rz"])
        chosen = sorted(map(str, random.choice(known, random.integers(1, len(known) + 1), False)))
        clamps = [f"{{on='tail',directions={chosen},points='all'}}"]
        rows += clamp_rows(chosen, thick, width, height)
        if thick or set(held) & set(chosen):  # a cylinder on clamped coordinates has nothing to hold
            rows, supports, pads = clamp_rows(chosen, thick, width, height), [], pads[:1]
    loads = [f"{{name='down',on='tip',direction='z',signal={signal(random, rigidity * length / 100.0)}}}"]
    if model != "beam2d":
        loads.append(f"{{name='side',on='tip',direction='y',signal={signal(random, rigidity * length / 200.0)}}}")
    return Case(
        model,
        [
            f"body={{model='{model}',box={{length={length},width={width},height={height},wall={wall}}},"
            f"material={{young={young},poisson=0.3,density={round(float(random.uniform(1000, 8000)))}.0}}}}",
            mesh,
            f"pads=[{','.join(pads)}]",
            f"supports=[{','.join([*supports, *clamps])}]",
            "masses=[]" if random.random() < 0.5 else "masses=[{name='payload',on='tip',mass=100.0}]",
            f"loads=[{','.join(loads)}]",
            f"slider={{path={{kind='smooth_ramp',times=[0.2,1.8],values=[{0.4 * length},{0.7 * length}]}}}}",
            f"observe={{start={0.1 * length},end={0.9 * length},count=9}}",
            "recovery.stress=false",
            "reduction.coordinates=20",
            "time={end=2.0,step=2e-3}",
            "free_motions=allowed",
            f"compare.against={[] if 'unilateral=true' in ''.join(pads) else ['full']}",
        ],
        rows,
    )


def stiffness(random: np.random.Generator, rigidity: float) -> str:
    """Rigid, or from a thousandth of the body's own stiffness to a hundred thousand times that."""
    return "'rigid'" if random.random() < 0.2 else f"{rigidity * 10 ** random.uniform(-3, 5):.4g}"


def ring(random: np.random.Generator, width: float, height: float) -> tuple[str, list[tuple[str, str]]]:
    """Pads around the section: as the scene has them, and the face and place across of each."""
    faces, places = [], []
    for face in random.choice(list(NORMALS), random.integers(1, 4), False):
        side = width if face in ("bottom", "top") else height
        across = [0.0] if random.random() < 0.5 else [-0.25 * side, 0.25 * side]
        texts = [repr(round(x, 5)) for x in across]
        faces.append(f"{face}=[{','.join(texts)}]")
        places += [(str(face), text) for text in texts]
    return f"faces={{{','.join(faces)}}}", places


def signal(random: np.random.Generator, amplitude: float) -> str:
    return (
        f"{{kind='chirp',amplitude={amplitude:.4g},times=[0.0,2.0],"
        f"frequencies=[{random.uniform(0.2, 1.0):.3g},{random.uniform(1.0, 4.0):.3g}]}}"
    )


def pad_row(face: str, at: float, across: str, width: float, height: float) -> tuple[str, ...]:
    half = {"bottom": -height / 2, "top": height / 2, "left": width / 2, "right": -width / 2}[face]
    place = (str(at), across, repr(half)) if face in ("bottom", "top") else (str(at), repr(half), across)
    return twist(NORMALS[face], place)


def point_row(direction: str, place: tuple[str, str, str]) -> tuple[str, ...]:
    return twist(tuple(int(direction == d) for d in "xyz"), place)


def clamp_rows(directions: list[str], ring: bool, width: float, height: float) -> list[tuple[str, ...]]:
    """Of a point with rotations, or of a ring of points, which rotations hold as well."""
    corners = [("0", repr(y * width / 2), repr(z * height / 2)) for y in (-1, 1) for z in (-1, 1)]
    rows = [point_row(d, p) for d in directions if len(d) == 1 for p in (corners if ring else [("0", "0", "0")])]
    return rows + [("0",) * 3 + tuple(str(int(d == e)) for e in ("rx", "ry", "rz")) for d in directions if len(d) == 2]


def twist(n: tuple[int, ...], place: tuple[str, str, str]) -> tuple[str, ...]:
    """n and place x n: what the displacement along n is under translations and rotations about the origin."""
    p = [Fraction(x) for x in place]
    moments = [p[(i + 1) % 3] * n[(i + 2) % 3] - p[(i + 2) % 3] * n[(i + 1) % 3] for i in range(3)]
    return (*(str(x) for x in n), *(str(x) for x in moments))


def motions_left(model: str, rows: list[tuple[str, ...]]) -> int:
    """By elimination in rational numbers: exact."""
    columns = [0, 2, 4] if model == "beam2d" else range(6)
    A = [[Fraction(row[i]) for i in columns] for row in rows]
    rank = 0
    for column in range(len(columns)):
        pivot = next((i for i in range(rank, len(A)) if A[i][column] != 0), None)
        if pivot is None:
            continue
        A[rank], A[pivot] = A[pivot], A[rank]
        for i in range(rank + 1, len(A)):
            share = A[i][column] / A[rank][column]
            A[i] = [a - share * b for a, b in zip(A[i], A[rank], strict=True)]
        rank += 1
    return len(columns) - rank


@pytest.mark.slow
@pytest.mark.parametrize("number", NUMBERS)
def test_a_random_structure(number: int) -> None:
    one = case(number)
    print(one.overrides)
    scene = scenes.load(BOOM, one.overrides)
    model, left = build(scene).model, motions_left(one.model, one.rows)
    assert rigid_modes(model).shape[1] == left
    try:
        found = reduce_body(scene, model)
    except InputError as error:
        # rigid supports that say the same twice are refused in words, and nothing else is
        assert "not determined" in str(error) and "rigid" in str(one.overrides)
        return
    rigid = int(np.sum(found.snapshots.omega == 0.0))
    assert rigid <= left and np.all(found.snapshots.omega[rigid:] > 0.0)
    if "full" not in scene.compare.against:
        return
    full, own = FullOrder.join(scene, {ALONE: model}).references(), simulate(scene, found.model)
    responses = {"reduced": own, **full.responses}
    error = errors_between(responses, compared_quantities(scene, own))["reduced_vs_full"]["beam"]
    estimated = estimate(found.model, Excitation.from_scene(scene)).error_of("beam")
    print(
        number,
        one.model,
        model.size,
        "rigid",
        rigid,
        left,
        f"error {error:.2e} estimate {estimated:.2e}",
    )
    assert np.isfinite(error)
    if estimated < 1e-4:
        assert error < 1e-4
    assert error < max(3.0 * estimated, 1e-6)  # no bound, but of the error's size unless round-off is all of it
