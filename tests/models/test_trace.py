from dataclasses import replace

import numpy as np
import pytest
from blocks import BLOCKS, block
from surfaces import mapped

from pmr import InputError
from pmr.models.mesh_nodes import number_nodes
from pmr.models.trace import coordinates_on, group_trace, section_trace

SHELL = {0: (0, 1, 2), 1: (0, 1, 2, 3, 4, 5)}


def surface():
    return mapped((3, 2), lambda u, v: np.stack([2 * u, np.sin(v), 0.3 * u * v + np.cos(v)], axis=1))


def field(nodes, polynomial) -> np.ndarray:
    """Coordinates of the interpolant of a displacement field; rotations zero."""
    q = np.zeros(nodes.size)
    for component in range(3):
        at = nodes.component == component
        q[at] = polynomial(nodes.points[at])[:, component]
    return q


def quadratic(x: np.ndarray) -> np.ndarray:
    return np.stack([x[:, 0] ** 2 - x[:, 1], x[:, 0] * x[:, 2], 1 + 3 * x[:, 2] ** 2], axis=1)


@pytest.mark.parametrize("name", ["u1", "v0", "10", "cells"])
def test_a_trace_is_exact_for_quadratic_fields(name: str) -> None:
    mesh = surface()
    if name == "cells":
        mesh.groups["cells"] = type(mesh.groups["u1"])(2, mesh.cells[:5])  # type: ignore[index]
    nodes = number_nodes("triangle", mesh.points, mesh.cells, SHELL)
    found, q = group_trace(mesh, nodes, name), field(nodes, quadratic)
    assert np.stack([value @ q for value in found.values], axis=1) == pytest.approx(quadratic(found.points), abs=1e-13)


@pytest.mark.parametrize("kind", BLOCKS)
def test_a_trace_on_a_solids_face_is_exact_for_quadratic_fields(kind: str) -> None:
    mesh = block(kind, (2, 2, 1), (1.0, 2.0, 0.5))
    dims = range(4) if kind == "hexahedron" else range(2)
    nodes = number_nodes(kind, mesh.points, mesh.cells, dict.fromkeys(dims, (0, 1, 2)))
    q = field(nodes, quadratic)
    for name, measure in (("tip", 1.0), ("top", 2.0), ("all", 1.0)):
        found = group_trace(mesh, nodes, name)
        assert found.measure == pytest.approx(measure, rel=1e-13)
        values = np.stack([value @ q for value in found.values], axis=1)
        assert values == pytest.approx(quadratic(found.points), abs=1e-13)


@pytest.mark.parametrize("name", ["u0", "u1"])
def test_mean_and_rotation_are_those_of_a_rigid_motion(name: str) -> None:
    mesh = surface()
    nodes = number_nodes("triangle", mesh.points, mesh.cells, SHELL)
    found = group_trace(mesh, nodes, name)
    translation, rotation, about = np.array([0.3, -1.0, 2.0]), np.array([0.2, 0.5, -0.7]), np.array([1.0, -2.0, 0.5])
    q = field(nodes, lambda x: translation + np.cross(rotation, x))
    motion = found.motion(about) @ q
    assert motion[:3] == pytest.approx(translation + np.cross(rotation, about), abs=1e-12)
    assert motion[3:] == pytest.approx(rotation, abs=1e-12)
    assert found.mean @ q == pytest.approx(translation + np.cross(rotation, found.centroid), abs=1e-13)


@pytest.mark.parametrize("at", [0.0, 0.01, 0.7, 1.93, 2.0])
def test_a_section_is_where_it_was_asked_for(at: float) -> None:
    """Beside the ends too, where all cells lie on one side."""
    mesh = mapped((7, 4), lambda u, v: np.stack([2 * u**2, 0.2 * np.sin(v), 0.2 * np.cos(v)], axis=1))
    nodes = number_nodes("triangle", mesh.points, mesh.cells, SHELL)
    found = section_trace(mesh, nodes, at)
    assert found.centroid[0] == pytest.approx(at, abs=1e-12)
    q = field(nodes, lambda x: np.array([0.3, -1.0, 2.0]) + np.cross([0.2, 0.5, -0.7], x))
    assert found.motion()[3:] @ q == pytest.approx([0.2, 0.5, -0.7], abs=1e-11)
    expected = np.array([0.3, -1.0, 2.0]) + np.cross([0.2, 0.5, -0.7], found.centroid)
    assert found.mean @ q == pytest.approx(expected, abs=1e-12)


def test_the_rotation_is_the_nearest_one() -> None:
    """What is left of any field has no mean and no moment about the centroid."""
    mesh = surface()
    nodes = number_nodes("triangle", mesh.points, mesh.cells, SHELL)
    found, q = group_trace(mesh, nodes, "u1"), field(nodes, quadratic)
    motion = found.motion() @ q
    r = found.points - found.centroid
    rest = quadratic(found.points) - motion[:3] - np.cross(motion[3:], r)
    assert found.weights @ rest == pytest.approx(np.zeros(3), abs=1e-13)
    assert found.weights @ np.cross(r, rest) == pytest.approx(np.zeros(3), abs=1e-13)


def test_a_weighted_mean_weighs() -> None:
    mesh = surface()
    nodes = number_nodes("triangle", mesh.points, mesh.cells, SHELL)
    found = group_trace(mesh, nodes, "v0")
    found = replace(found, weights=found.weights * found.points[:, 0])
    q = field(nodes, lambda x: x)
    assert (found.mean @ q)[0] == pytest.approx(4.0 / 3.0, rel=1e-13)  # int x^2 / int x over 0 to 2


def test_a_straight_line_leaves_a_rotation_open() -> None:
    mesh = surface()
    nodes = number_nodes("triangle", mesh.points, mesh.cells, SHELL)
    with pytest.raises(InputError, match="'10'.*on a line, so the rotation about that line is not defined"):
        group_trace(mesh, nodes, "10").motion()


def test_all_coordinates_on_a_line_are_found() -> None:
    mesh = surface()
    nodes = number_nodes("triangle", mesh.points, mesh.cells, SHELL)
    on = coordinates_on(mesh, nodes, "u0", range(6))
    assert len(on) == 3 * 3 + 2 * 6 and np.all(nodes.points[on][:, 0] == 0.0)
    some = coordinates_on(mesh, nodes, "u0", [1, 4])
    assert set(nodes.component[some]) == {1, 4} and len(some) == 5 + 2
