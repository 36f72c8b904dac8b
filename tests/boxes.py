"""Small box booms as triangles, with the groups that a boom has: four walls, tail and tip."""

from __future__ import annotations

import numpy as np

from pmr.mesh.named import NamedMesh, named_mesh

WIDTH, HEIGHT = 0.3, 0.4
WALLS = ("bottom", "left", "top", "right")


def box(length: float = 2.0, along: int = 8, around: int = 2, skew: float = 0.0) -> NamedMesh:
    """Rectangles cut by one diagonal, `around` of them a wall; `skew` shifts inner nodes along x by that share."""
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
