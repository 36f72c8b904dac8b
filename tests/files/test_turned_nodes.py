"""Matrices whose nodes have axes of their own by `*TRANSFORM`: along these, or along those of the whole."""

from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from bricks import bricks

from pmr import InputError
from pmr.files.foreign import ForeignFiles, read_foreign
from pmr.files.matrices import GivenMatrices


def written(body: GivenMatrices, card: str, folder: Path) -> ForeignFiles:
    """Files of a body, with a card in its deck."""
    for name, A in (("K", body.K), ("M", body.M)):
        sp.save_npz(folder / f"{name}.npz", A)
    rows = [f"{n + 1}.{d + 1}" for n, d in zip(body.node, body.direction, strict=True)]
    (folder / "job.dof").write_text("\n".join([*rows, ""]))
    nodes = [f"{k}, {x!r}, {y!r}, {z!r}" for k, (x, y, z) in enumerate(body.points.tolist(), 1)]
    tip = [str(k + 1) for k in body.groups["tip"]]
    (folder / "job.inp").write_text("\n".join(["*NODE", *nodes, "*NSET, NSET=tip", *tip, card, "*STEP", ""]))
    return ForeignFiles(folder / "K.npz", folder / "M.npz", folder / "job.dof", folder / "job.inp")


CARDS = {
    "R": "*TRANSFORM, NSET=tip\n0.8, 0.6, 0., -0.6, 0.8, 0.",
    "C": "*TRANSFORM, NSET=tip, TYPE=C\n0., 3., 0., 0., 3., 1.",
    "S": "*TRANSFORM, NSET=tip, TYPE=S\n0., 3., 0., 0., 3., 1.",
}


def axes(kind: str, point: np.ndarray) -> np.ndarray:
    """Axes as rows at a point."""
    x = np.array([0.8, 0.6, 0.0]) if kind == "R" else np.array([point[0], point[1] - 3.0, 0.0])
    x = x / np.linalg.norm(x)
    if kind == "S":
        latitude = np.arctan2(point[2], np.hypot(point[0], point[1] - 3.0))
        east, pole = np.cross([0.0, 0.0, 1.0], x), np.array([0.0, 0.0, 1.0])
        return np.stack(
            [np.cos(latitude) * x + np.sin(latitude) * pole, east, np.cos(latitude) * pole - np.sin(latitude) * x]
        )
    return np.stack([x, np.cross([0.0, 0.0, 1.0], x), [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("kind", CARDS)
@pytest.mark.parametrize("along", ["nodes", "whole"])
def test_rows_are_read_along_the_axes_that_the_stiffness_has(kind: str, along: str, tmp_path: Path) -> None:
    body = bricks((4, 1, 1), (2.0, 0.2, 0.3))
    Q = np.eye(body.size)
    for node in body.groups["tip"]:
        at = np.flatnonzero(body.node == node)
        Q[np.ix_(at, at)] = axes(kind, body.points[node])
    Q = sp.csr_matrix(Q if along == "nodes" else np.eye(body.size))
    turned = object.__new__(GivenMatrices)
    vars(turned).update(vars(body) | {"K": sp.csr_matrix(Q @ body.K @ Q.T), "M": sp.csr_matrix(Q @ body.M @ Q.T)})
    read = read_foreign(written(turned, CARDS[kind], tmp_path))
    assert abs(read.K - body.K).max() < 1e-12 * abs(body.K).max() and not len(read.held)


def test_axes_that_are_in_doubt_are_refused_with_the_line(tmp_path: Path) -> None:
    body = bricks((4, 1, 1), (2.0, 0.2, 0.3))
    same = "*TRANSFORM, NSET=tip\n1., 0., 0., 0., 1., 0."
    with pytest.raises(InputError, match=r"job\.inp: line \d+: .*K fits both"):
        read_foreign(written(body, same, tmp_path))
    with pytest.raises(InputError, match=r"job\.inp: line \d+: .*not on a line"):
        read_foreign(written(body, same.replace("0., 1.", "2., 0."), tmp_path))
