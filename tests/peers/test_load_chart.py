"""Loads of a chart beside CalculiX with large displacements (NLGEOM): a box of shells, raised, its tip to the side."""

import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from chart_beside_full import GRAVITY, at_rest
from peers.calculix import Deck
from peers.test_calculix import HEIGHT, LENGTH, WALL, WIDTH, peer, simpson
from peers.test_nested import peer as on_pads

from pmr.scene import Scene, load_any
from pmr.simulation.statics.postures import HOISTED, PostureMatrices
from pmr.studies.allowed import Place, allowed_loads
from pmr.studies.limits import Limit

pytestmark = [pytest.mark.peers, pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) not found")]
#: Luffing angles in rad, and the deflection in m that is allowed there.
POINTS = [(0.0, 0.12), (0.4, 0.2), (0.8, 0.25), (1.1, 0.25), (1.3, 0.2)]


def shell() -> Scene:
    """Without a weight."""
    return Scene.model_validate(
        {
            "title": "box of shells",
            "gravity": {},
            "frame": {"pivot": [0.0, 0.0, 0.0], "luffing": {"kind": "constant", "amount": 0.0}, "second_order": True},
            "sections": [
                {
                    "name": "boom",
                    "body": {
                        "model": "shell",
                        "box": {"length": LENGTH, "width": WIDTH, "height": HEIGHT, "wall": WALL},
                        "material": {"density": 1e-6},
                    },
                    "mesh": {"size": 0.1, "along": 0.2},
                    "observe": {"start": 0.5, "end": 5.5, "count": 3},
                    "supports": [{"on": "tail", "kind": "clamped"}],
                    "pads": [{"name": "none", "moving": True, "faces": {"top": [0.0]}, "stiffness": 1e-3}],
                    "slider": {"path": {"kind": "constant", "amount": 3.0}},
                    "reduction": {"coordinates": 12},
                }
            ],
            "time": {"end": 1.0, "step": 0.01},
        }
    )


def moved(at: PostureMatrices, deck: Deck, folder: Path, points: Sequence[tuple[float, float]] = POINTS) -> list[float]:
    """How far the loads that the chart allows move CalculiX' tip, as shares of the deflection that is allowed."""
    share = simpson(nodes := deck.sets["TIP"])
    found = []
    for k, (angle, most) in enumerate(points):
        limit, place = (
            Limit(name="tip", of="deflection", most=most),
            Place(at, k, [float(part != HOISTED) for part in at.loads.names], GRAVITY),
        )
        pull = allowed_loads([limit], place, 1e6)[0] * GRAVITY
        along, across = -np.sin(angle) * pull, -np.cos(angle) * pull
        loads = [(n, d, f * w) for n, w in zip(nodes, share, strict=True) for d, f in ((1, along), (3, across))]
        tip = share @ deck.displacements(loads, "TIP", folder, large=True)
        found.append(float(np.hypot(tip[1], tip[2])) / most)
    return found


def test_five_points_beside_large_displacements(tmp_path: Path) -> None:
    """The load by which the tip is so far to the side moves that of CalculiX as far to 3 %, at all angles."""
    at = at_rest(shell(), [angle for angle, _ in POINTS])
    assert moved(at, peer(0.1), tmp_path) == pytest.approx([1.0] * len(POINTS), rel=0.03)


#: Two sections whose walls are whole rectangles of 0.1 m: width, height and wall in m; how far the inner one is out.
BOXES, OUT = ((0.40, 0.50, 10e-3), (0.30, 0.40, 8e-3)), 3.6


def nested() -> Scene:
    """Both of shells, the inner one on twelve pads, without a weight."""
    (width, height, wall), (own_width, own_height, own_wall) = BOXES
    changes = [
        "section.mesh={size=0.1,along=0.2}",
        "section.body.material.density=1e-6",
        "section.reduction.coordinates=16",
        f"sections.base.body.box={{width={width},height={height},wall={wall}}}",
        f"sections.middle.body.box={{width={own_width},height={own_height},wall={own_wall}}}",
        "frame={pivot=[0.0,0.0,0.0],luffing={kind='constant',amount=0.0},second_order=true}",
    ]
    scene = load_any("boom_three_shell", changes)
    return scene.model_copy(update={"sections": scene.sections[:2]})


def test_five_points_of_nested_shells_on_pads_beside_large_displacements(tmp_path: Path) -> None:
    """The same of two shells on pads between them; in CalculiX equations tie what touches.  Measured: 0.1 to 0.3 %."""
    at = at_rest(nested(), [angle for angle, _ in POINTS], {"middle": [OUT] * len(POINTS)})
    deck = on_pads(OUT, BOXES, 0.1, 0.2)
    assert moved(at, deck, tmp_path) == pytest.approx([1.0] * len(POINTS), rel=0.03)
