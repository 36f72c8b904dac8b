"""Structured surfaces for benchmarks: a rectangle of triangles mapped into space, with named sides and corners."""

from collections.abc import Callable

import numpy as np

from pmr.models.named_mesh import NamedMesh, named_mesh


def mapped(
    n: tuple[int, int], place: Callable[[np.ndarray, np.ndarray], np.ndarray], crossed: bool = True
) -> NamedMesh:
    """Mesh of the unit square, in n[0] x n[1] rectangles cut by one diagonal or both, mapped into space by `place`.

    ``place(u, v)`` returns the vertices (N, 3) for coordinates (N,).  Sides are ``u0``, ``u1``, ``v0``, ``v1``; corners
    ``00``, ``10``, ``01``, ``11``.
    """
    nu, nv = n
    u, v = (g.ravel() for g in np.meshgrid(np.linspace(0, 1, nu + 1), np.linspace(0, 1, nv + 1), indexing="ij"))
    number = np.arange((nu + 1) * (nv + 1)).reshape(nu + 1, nv + 1)
    a, b, c, d = (x.ravel() for x in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]))
    if crossed:
        m = number.size + np.arange(nu * nv)
        u, v = np.append(u, u[[a, b, c, d]].mean(axis=0)), np.append(v, v[[a, b, c, d]].mean(axis=0))
        cells = np.concatenate([np.stack(t, axis=1) for t in ((a, b, m), (b, c, m), (c, d, m), (d, a, m))])
    else:
        cells = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    sides = {"u0": number[0], "u1": number[-1], "v0": number[:, 0], "v1": number[:, -1]}
    lines = {name: np.stack([side[:-1], side[1:]], axis=1) for name, side in sides.items()}
    corners = {"00": number[0, 0], "10": number[-1, 0], "01": number[0, -1], "11": number[-1, -1]}
    blocks = [
        ("triangle", 2, cells),
        *(("interval", 1, line) for line in lines.values()),
        *(("point", 0, np.array([[corner]])) for corner in corners.values()),
    ]
    named = [*lines, *corners]
    members = {
        name: [np.arange(len(b[2])) if i == 1 + k else np.empty(0, int) for i, b in enumerate(blocks)]
        for k, name in enumerate(named)
    }
    return named_mesh(place(u, v), blocks, members, ("triangle",))
