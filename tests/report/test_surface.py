from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pmr.report.bodies import body_surface
from pmr.results.field_series import Grid
from pmr.scene.box import Box

BOX = Box(length=6.0, width=0.3, height=0.4, wall=0.008)


def area(points: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0)


@pytest.mark.parametrize(
    ("kind", "expected"), [("triangle", 1.4 * 6.0), ("line", 1.4 * 6.0), ("hexahedron", 1.4 * 6.0 + 2.0 * 0.12)]
)
def test_what_is_seen_is_the_outside(make_fields, kind: str, expected: float) -> None:
    fields = make_fields(kind)
    body = body_surface(fields, BOX)
    assert area(body.points, body.triangles) == pytest.approx(expected, rel=1e-6)
    centres = body.points[body.triangles].mean(axis=1)[:, 0]
    of_triangle = np.tile(body.cell, len(body.triangles) // len(body.cell))
    cells = fields.points[fields.cells].mean(axis=1)[of_triangle, 0]
    assert np.all(np.abs(centres - cells) <= 0.5 + 1e-9)  # each triangle with the cell that it belongs to


def test_what_two_solids_share_is_not_seen(make_fields) -> None:
    fields = make_fields("hexahedron")
    assert len(body_surface(fields).faces) == 4 * len(fields.cells) + 2
    wedge = replace(fields, grid=Grid("tetra", fields.points, np.array([[0, 1, 3, 4], [1, 3, 4, 5]])))
    assert len(body_surface(wedge).faces) == 6


def test_points_move_with_their_vertices(make_fields) -> None:
    fields = make_fields("triangle")
    body = body_surface(fields)
    assert np.array_equal(body.point_displacements(fields, fields.displacement), fields.displacement[:, body.vertex])


def test_sections_of_beams_stay_across_the_axis(make_fields) -> None:
    fields = make_fields("line")
    turned = np.zeros((len(fields.points), 3), np.float32)
    turned[:, 2] = 0.01 * fields.points[:, 0]  # slope of 1 %: what is above moves back
    body = body_surface(fields, BOX)
    moved = body.point_displacements(fields, turned)
    assert np.allclose(moved[:, 0], -0.01 * body.points[:, 2], atol=1e-7)
    assert np.allclose(moved[:, 2], turned[body.vertex, 2])


def test_each_edge_is_drawn_once(make_fields) -> None:
    body = body_surface(make_fields("hexahedron"))
    assert len(body.edges) == 7 * 4 + 6 * 4
