"""CalculiX computes two nested shells that touch each other on the pads of their joint; needs ``ccx``.

Both hold the same differences of weighted means with the same springs: in CalculiX equations tie nodes to them.
"""

import shutil
from pathlib import Path

import numpy as np
import pytest
from peers.calculix import Deck, Mean, grid
from peers.pads import Patch

from pmr import scene as scenes
from pmr.compare.frequencies import CURVES_OF_BOOM
from pmr.fullmodel.build import build_bodies, models_of
from pmr.pipeline.full_order import FullOrder
from pmr.simulation import Excitation

pytestmark = [pytest.mark.peers, pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) not found")]
SIZE, ALONG, LENGTH, FROM_END, STIFFNESS = 0.05, 0.1, 6.0, 0.15, 3e8  # m; N/m
Box = tuple[float, float, float]
#: Width, height and wall in m: multiples of `SIZE`, so that both programs have the same rectangles.
OUTER, INNER = (0.30, 0.40, 8e-3), (0.25, 0.35, 7e-3)
#: Axis of a pad's normal, which side of it, place across in m.
RING = [(2, side, y) for side in (-1.0, 1.0) for y in (-0.06, 0.06)] + [(1, side, 0.0) for side in (1.0, -1.0)]


def tube(box: Box, size: float, along: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A section by itself as points, 8-node rectangles and nodes of its tail and its tip, around the section."""
    width, height, _ = box
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * [width / 2, height / 2]
    at = np.cumsum([0.0, width, height, width, height]) / (2 * (width + height))

    def place(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.column_stack([LENGTH * u, *(np.interp(v, at, corners[:, i]) for i in (0, 1))])

    counts = round(LENGTH / along), round(2 * (width + height) / size)
    points, quads, number = grid(place, counts, closed=True)
    return points, quads, number[0, :-1], number[-1, :-1]


def peer(extension: float, boxes: tuple[Box, Box] = (OUTER, INNER), size: float = SIZE, along: float = ALONG) -> Deck:
    """The outer section clamped, the inner one on twelve pads and a rigid cylinder."""
    (points, quads, tail, _), (own, inner_quads, inner_tail, tip) = (tube(box, size, along) for box in boxes)
    first = len(points)
    means = []
    for at, outer_at in ((FROM_END, extension + FROM_END), (LENGTH - FROM_END - extension, LENGTH - FROM_END)):
        for normal, side, across in RING:
            half = [box[normal - 1] / 2.0 * side for box in boxes]
            around = Patch(normal, half[0], outer_at, across, extension + FROM_END).shares(points, quads)
            within = Patch(normal, half[1], at, across, FROM_END).shares(own, inner_quads)
            means.append(Mean(np.concatenate([-around, within]), normal + 1, STIFFNESS))
    cylinder = np.zeros(first + len(own))
    cylinder[first + inner_tail] = np.where(np.arange(len(inner_tail)) % 2 == 0, 1.0, 2.0) / 1.5 / len(inner_tail)
    return Deck(
        np.vstack([points, own + [extension, 0.0, 0.0]]),
        np.vstack([quads, inner_quads + first]),
        np.repeat([boxes[0][2], boxes[1][2]], [len(quads), len(inner_quads)]),
        sets={"TAIL": np.unique(tail), "TIP": tip + first},
        held=[("TAIL", 1, 6)],
        means=[*means, Mean(cylinder, 1, np.inf)],
    )


def ours(extension: float) -> np.ndarray:
    """The first two of the sections of workflows/boom_three_shell.toml on the same rectangles, without a payload."""
    changes = [
        f"section.mesh={{size={SIZE},along={ALONG}}}",
        f"section.joint.extension={extension}",
        "time.end=0.04",
        *(f"sections.{name}.body.box={{width={w},height={h},wall={t}}}" for name, (w, h, t) in NAMED.items()),
    ]
    boom = scenes.load_any("boom_three_shell", changes)
    boom = boom.model_copy(update={"sections": boom.sections[:2]})
    full = FullOrder.join(boom, models_of(build_bodies(boom)))
    return full.frequencies(Excitation.from_scene(boom).s[:1], CURVES_OF_BOOM, np.empty((1, 0)))[0]


NAMED = {"base": OUTER, "middle": INNER, "fly": (0.20, 0.30, 6e-3)}


@pytest.mark.parametrize("extension", [1.0, 4.2])
def test_first_four_frequencies_of_nested_shells_agree(extension: float, tmp_path: Path) -> None:
    """Measured: -0.02, -0.004, -0.66, -0.31 % with 5 m of overlap, -0.12, -0.02, -0.30, -0.06 % with 1.8 m."""
    assert ours(extension) == pytest.approx(peer(extension).frequencies(4, tmp_path), rel=0.01)
