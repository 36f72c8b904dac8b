"""Loads of a chart beside CalculiX with large displacements (NLGEOM): a box of shells, raised, its tip to the side."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from chart_beside_full import GRAVITY, at_rest
from peers.test_calculix import HEIGHT, LENGTH, WALL, WIDTH, peer, simpson

from pmr.scene import Scene
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
            "frame": {
                "pivot": [0.0, 0.0, 0.0],
                "luffing": {"kind": "constant", "amount": 0.0},
                "second_order": True,
            },
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


def test_five_points_beside_large_displacements(tmp_path: Path) -> None:
    """The load by which the tip is so far to the side moves that of CalculiX as far to 3 %, at all angles."""
    at = at_rest(shell(), [angle for angle, _ in POINTS])
    deck = peer(0.1)
    share = simpson(nodes := deck.sets["TIP"])
    found = []
    for k, (angle, most) in enumerate(POINTS):
        limit, place = Limit(name="tip", of="deflection", most=most), Place(at, k, [1.0] * len(at.parts), GRAVITY)
        pull = allowed_loads([limit], place, 1e6)[0] * GRAVITY
        along, across = -np.sin(angle) * pull, -np.cos(angle) * pull
        loads = [(n, d, f * w) for n, w in zip(nodes, share, strict=True) for d, f in ((1, along), (3, across))]
        moved = share @ deck.displacements(loads, "TIP", tmp_path, large=True)
        found.append(float(np.hypot(moved[1], moved[2])) / most)
    assert found == pytest.approx([1.0] * len(POINTS), rel=0.03)
