from __future__ import annotations

import numpy as np
from boom_results import make_fields, make_space  # noqa: F401 fixtures

from pmr.results.pads import CUBE, THICK, pads_over_time


def test_pads_of_the_mouth_stay_and_those_of_the_tail_move_with_the_body(make_space, make_fields) -> None:  # noqa: F811
    result = make_space(fields=make_fields("triangle"))
    found, along = pads_over_time(result), result.moving_fields[""][1]
    assert found is not None and len(found.names) == sum(len(ring.named_pads) for ring in result.scene.pads)
    moving = [ring.moving for ring in result.scene.pads for _ in ring.named_pads]
    start = found.corners[:, :, :, 0].min(axis=2)
    for k, stays in enumerate(moving):
        assert np.allclose(start[:, k] - start[0, k], 0.0 if stays else along - along[0])
    size = np.ptp(found.corners, axis=2)
    assert np.allclose(size.min(axis=2), THICK)
    assert found.values["force"].shape == start.shape


def test_the_order_of_corners_is_that_of_a_hexahedron() -> None:
    """Each face of the lower four turns once around, the upper four stand above them."""
    assert np.array_equal(CUBE[:4, :2], CUBE[4:, :2]) and set(CUBE[:4, 2]) == {0.0}
    assert np.all(np.abs(np.diff(CUBE[:4], axis=0)).sum(axis=1) == 1.0)
