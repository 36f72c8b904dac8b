"""Craig-Bampton models of a bar of bricks, made from its full matrices by NumPy."""

from collections.abc import Sequence

import bricks
import numpy as np
import scipy.linalg

from pmr import from_matrices
from pmr.files.matrices import MODAL, GivenMatrices


def bar(across: int = 2) -> GivenMatrices:
    """Bar of bricks, 2.4 m long, with `across` cells over width and height."""
    return bricks.bricks((12, across, across), (2.4, 0.2, 0.3))


def boundary(whole: GivenMatrices) -> np.ndarray:
    """Nodes of the outer faces where pads travel, and those of the tip."""
    x = whole.points[:, 0]
    outer = np.unique(np.concatenate([whole.groups[face] for face in ("bottom", "top", "left", "right")]))
    return outer[(x[outer] < 1.5) | (x[outer] > 2.3)]


def superelement(whole: GivenMatrices, nodes: np.ndarray, modes: int, held: Sequence[int] = ()) -> GivenMatrices:
    """Craig-Bampton model on boundary nodes and `modes` modes with these held, without `held` coordinates."""
    K, M, free = whole.K.toarray(), whole.M.toarray(), ~np.isin(np.arange(whole.size), held)
    on = np.isin(whole.node, nodes)
    b, i = np.flatnonzero(on & free), np.flatnonzero(~on & free)
    inner = np.ix_(i, i)
    T = np.zeros((len(K), len(b) + modes))
    T[b, np.arange(len(b))] = 1.0
    T[i, : len(b)] = -np.linalg.solve(K[inner], K[np.ix_(i, b)])
    T[i, len(b) :] = scipy.linalg.eigh(K[inner], M[inner], subset_by_index=[0, modes - 1])[1]
    K, M = (T.T @ A @ T for A in (K, M))
    number = {int(node): k for k, node in enumerate(nodes)}
    node = np.array([*(number[int(n)] for n in whole.node[b]), *[MODAL] * modes])
    direction = np.array([*whole.direction[b], *[MODAL] * modes])
    groups = {name: [number[int(n)] for n in members if int(n) in number] for name, members in whole.groups.items()}
    some = {name: members for name, members in groups.items() if members}
    return from_matrices((M + M.T) / 2.0, (K + K.T) / 2.0, whole.points[nodes], some, node, direction)
