"""Bar of trilinear bricks as another program would hand it over: matrices on nodes, assembled by NumPy alone."""

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from pmr import from_matrices
from pmr.files.matrices import GivenMatrices

YOUNG, POISSON, DENSITY = 210e9, 0.3, 7850.0
_SCENE = """
title = "A bar on pads"
[body]
model = "matrices"
[mesh]
file = "bar.npz"
[[pads]]
name = "tail"
at = 0.15
length = 0.2
faces = { bottom = [0.0], top = [0.0], left = [0.0], right = [0.0] }
[[pads]]
name = "mouth"
moving = true
length = 0.2
faces = { bottom = [0.0], top = [0.0], left = [0.0], right = [0.0] }
[[supports]]
on = "tail"
directions = ["x"]
[[supports]]
on = "tip"
directions = ["rx"]
stiffness = 1e6
[slider]
path = { kind = "smooth_ramp", times = [0.0, 0.2], values = [0.6, 1.1] }
[[loads]]
name = "F"
signal = { kind = "smooth_ramp", times = [0.0, 0.1], values = [0.0, 1000.0] }
[observe]
start = 0.2
end = 1.8
count = 5
[time]
end = 0.2
step = 1e-3
[reduction]
coordinates = 12
[compare]
against = ["full"]
"""
_CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))


def bricks(counts: tuple[int, int, int], size: tuple[float, float, float]) -> GivenMatrices:
    """Assemble a bar of `counts` cells and `size` m along x, y, z, with three coordinates a node.

    Its axis is x, from 0 on.
    """
    grids = np.indices([n + 1 for n in counts]).reshape(3, -1).T
    points = grids / counts * size - [0.0, size[1] / 2.0, size[2] / 2.0]
    number = np.arange(len(points)).reshape([n + 1 for n in counts])
    first = np.indices(counts).reshape(3, -1).T
    cells = np.stack([number[tuple((first + (corner > 0)).T)] for corner in _CORNERS], axis=1)
    dofs = (3 * cells[:, :, None] + np.arange(3)).reshape(len(cells), -1)
    rows, columns = (np.broadcast_to(one, (len(cells), 24, 24)) for one in (dofs[:, :, None], dofs[:, None, :]))
    n = 3 * len(points)
    M, K = (
        sp.coo_matrix((np.tile(A, (len(cells), 1, 1)).ravel(), (rows.ravel(), columns.ravel())), (n, n)).tocsr()
        for A in _element(np.array(size) / counts)
    )
    ends = {"tail": points[:, 0] == 0.0, "tip": points[:, 0] == size[0]}
    sides = {"bottom": grids[:, 2] == 0, "top": grids[:, 2] == counts[2]}
    sides |= {"right": grids[:, 1] == 0, "left": grids[:, 1] == counts[1]}
    groups = {name: np.flatnonzero(on) for name, on in {**ends, **sides}.items()}
    return from_matrices((M + M.T) / 2.0, (K + K.T) / 2.0, points, groups)


def on_pads(folder: Path) -> Path:
    """Write a scene of a bar of 20 x 3 x 3 bricks that slides through pads into a folder, and return its path."""
    bricks((20, 3, 3), (2.0, 0.2, 0.3)).save(folder / "bar.npz")
    (folder / "bar.toml").write_text(_SCENE)
    return folder / "bar.toml"


def _element(edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mass and stiffness (24, 24) of a brick with these edges in m, by 2 x 2 x 2 points of Gauss."""
    lame, shear = YOUNG * POISSON / (1.0 + POISSON) / (1.0 - 2.0 * POISSON), YOUNG / 2.0 / (1.0 + POISSON)
    elasticity = np.diag([2.0 * shear] * 3 + [shear] * 3)
    elasticity[:3, :3] += lame
    M, K = np.zeros((2, 24, 24))
    weight = edges.prod() / 8.0
    for xi in _CORNERS / np.sqrt(3.0):
        factors = (1.0 + _CORNERS * xi) / 2.0
        N = factors.prod(axis=1)
        gradients = np.stack([_CORNERS[:, k] / edges[k] * np.delete(factors, k, axis=1).prod(axis=1) for k in range(3)])
        B = np.zeros((6, 24))
        for k, (i, j) in enumerate([(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)]):
            B[k, i::3] += gradients[j]
            if i != j:
                B[k, j::3] += gradients[i]
        K += weight * B.T @ elasticity @ B
        M += weight * DENSITY * np.kron(np.outer(N, N), np.eye(3))
    return M, K


def lumped(given: GivenMatrices) -> GivenMatrices:
    """Make the mass matrix of a body diagonal, in proportion to its diagonal (Hinton, Rock, Zienkiewicz, 1976)."""
    diagonal = given.M.diagonal()
    for axis in range(3):
        along = given.direction == axis
        diagonal[along] *= given.M[along][:, along].sum() / diagonal[along].sum()
    return replace(given, M=sp.diags(diagonal).tocsr())


def struts(given: GivenMatrices, damping: float, spacing: float) -> sp.csr_matrix:
    """Damping (n, n) of dampers between nodes of two edges of a bar, bottom left and top right, in N s/m.

    Each damper joins two nodes that are `spacing` m apart along x, and acts along the line between them, so it resists
    no rigid motion.  As the dampers are not symmetric, they couple bending in both planes, torsion and extension.
    """
    D = sp.lil_matrix((given.size, given.size))
    edges = [
        np.intersect1d(*(given.groups[face] for face in faces)) for faces in (("bottom", "left"), ("top", "right"))
    ]
    for i, j in product(edges[0], np.concatenate(edges)):
        line = given.points[j] - given.points[i]
        if np.isclose(line[0], spacing):
            unit = np.concatenate([-line, line]) / np.linalg.norm(line)
            at = [np.flatnonzero((given.node == node) & (given.direction == k))[0] for node in (i, j) for k in range(3)]
            D[np.ix_(at, at)] += damping * np.outer(unit, unit)
    return sp.csr_matrix(D)
