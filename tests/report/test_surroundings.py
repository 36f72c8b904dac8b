from __future__ import annotations

import numpy as np
import pytest

from pmr.report.bodies import Block, body_surface, build_surroundings
from pmr.results import RunResult
from pmr.results.pads import THICK


@pytest.fixture(scope="module")
def blocks(make_space, make_fields) -> tuple[RunResult, object]:
    fields = make_fields("triangle")
    result = make_space(fields=fields)
    return result, build_surroundings(result, body_surface(fields))


def extent(block: Block) -> np.ndarray:
    return np.array([block.corners.min(axis=0), block.corners.max(axis=0)])


def test_pads_lie_on_their_faces(blocks) -> None:
    _, around = blocks
    right, left, top, side = (extent(block) for block in around.near)
    assert np.allclose(right, [(-0.15, -0.14, -0.2 - THICK), (0.15, -0.06, -0.2)])
    assert np.allclose(left[:, 1], (0.06, 0.14))
    assert np.allclose(top[:, 2], (0.2, 0.2 + THICK))
    assert np.allclose(side[:, 1], (-0.15 - THICK, -0.15)) and np.allclose(side[:, 2], (-0.04, 0.04))
    assert [extent(block)[:, 0].mean() for block in around.tail] == pytest.approx([0.15] * 3)


def test_the_next_section_holds_the_body_at_every_extension(blocks) -> None:
    result, around = blocks
    (back, *_), (front, *_) = extent(around.section[0])
    assert back < -result.abscissa.max() and front == pytest.approx(0.15)
    assert np.all(extent(around.section[0])[0, 1:] < (-0.15 - THICK, -0.2 - THICK))
    assert len(around.section[0].sides) == 4  # open at both ends
