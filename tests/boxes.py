"""Meshes of small box booms as shells and solids, with the groups that a boom has: walls, tail and tip."""

import numpy as np

from pmr.models.named_mesh import NamedMesh, named_mesh

WIDTH, HEIGHT = 0.3, 0.4
WALLS = ("bottom", "left", "top", "right")


def box(length: float = 2.0, along: int = 8, around: int = 2, skew: float = 0.0) -> NamedMesh:
    """Mesh of a box as rectangles that one diagonal cuts, `along` of them along it and `around` on each wall.

    `skew` shifts inner nodes along x by up to this share of a cell.
    """
    y, z = WIDTH / 2.0, HEIGHT / 2.0
    corners = np.array([(-y, -z), (y, -z), (y, z), (-y, z), (-y, -z)])
    share = np.arange(around)[:, None] / around
    ring = np.concatenate([a + share * (b - a) for a, b in zip(corners[:-1], corners[1:], strict=True)])
    n = len(ring)
    x = np.repeat(np.linspace(0.0, length, along + 1), n)
    inner = (x > 0.0) & (x < length)
    x[inner] += skew * length / along * np.sin(3.0 * np.arange(len(x)))[inner]
    points = np.column_stack([x, np.tile(ring, (along + 1, 1))])
    i, j = (g.ravel() for g in np.meshgrid(np.arange(along), np.arange(n), indexing="ij"))
    a, b = i * n + j, i * n + (j + 1) % n
    triangles = np.concatenate([np.stack([a, b, b + n], axis=1), np.stack([a, b + n, a + n], axis=1)])
    triangles[::3] = triangles[::3, ::-1]  # whatever side a mesh generator takes for the outer one
    wall = np.tile(j // around, 2)
    ends = [np.stack([np.arange(n), (np.arange(n) + 1) % n], axis=1) + k * along * n for k in (0, 1)]
    none = np.empty(0, int)
    members = {name: [np.flatnonzero(wall == k), none, none] for k, name in enumerate(WALLS)}
    members |= {"tail": [none, np.arange(n), none], "tip": [none, none, np.arange(n)]}
    blocks = [("triangle", 2, triangles), ("interval", 1, ends[0]), ("interval", 1, ends[1])]
    return named_mesh(points, blocks, members, ("triangle",))


def block(length: float = 2.0, along: int = 8) -> NamedMesh:
    """Mesh of a solid beam with the same outer dimensions and groups, as hexahedra, two by two over its section."""
    n = (along, 2, 2)
    points = np.stack(
        np.meshgrid(
            np.linspace(0.0, length, along + 1),
            np.linspace(-WIDTH / 2.0, WIDTH / 2.0, 3),
            np.linspace(-HEIGHT / 2.0, HEIGHT / 2.0, 3),
            indexing="ij",
        ),
        axis=-1,
    ).reshape(-1, 3)
    number = np.arange(len(points)).reshape(along + 1, 3, 3)
    corner = np.stack(np.meshgrid(*map(np.arange, n), indexing="ij"), axis=-1).reshape(-1, 3)
    corners = [np.array([i & 1, i >> 1 & 1, i >> 2]) for i in range(8)]  # dolfinx: the first axis runs fastest
    cells = np.stack([number[tuple((corner + c).T)] for c in corners], axis=1)
    sides = {"tail": (0, 0), "tip": (0, 1), "right": (1, 0), "left": (1, 1), "bottom": (2, 0), "top": (2, 1)}
    blocks, members = [("hexahedron", 3, cells)], {}
    for k, (name, (axis, end)) in enumerate(sides.items()):
        outer = cells[corner[:, axis] == end * (n[axis] - 1)]
        blocks.append(("quadrilateral", 2, outer[:, [i for i in range(8) if (i >> axis & 1) == end]]))
        members[name] = [np.arange(len(outer)) if i == 1 + k else np.empty(0, int) for i in range(7)]
    return named_mesh(points, blocks, members, ("hexahedron",))
