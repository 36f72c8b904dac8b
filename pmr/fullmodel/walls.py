r"""Walls of a beam that give way under its pads, and at its free ends.

A beam's section keeps its shape; a box's walls do not.  For each ring of k pads the body gets k more coordinates y,

.. math::
    \delta_i = C_i(s)\, q + \sum_j S_{ij}(x)\, y_j, \qquad
    \tfrac12 k_0\, y^T y \text{ of strain energy}, \qquad S(x)^2 = k_0\, C(x)

so that pads that press with forces f find the walls dented by :math:`S y = C f`, C the compliance that static solves on
a short shell tell (`pmr.fullmodel.wall_compliance`), besides their own 1/k.  Pads of one ring dent each other's walls;
rings do not.  S is the symmetric square root: smooth wherever C is, so along the path a row stays a cubic between its
breaks.  The mass that goes with each y is that of the wall under a pad; nothing but dents moves it.

An end that nothing keeps in shape moves by one more coordinate along y and z, and turns by one about x, under what is
spread over it: a mass that follows its mean motion, a load, a support.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, PchipInterpolator

from pmr.constraints.rows import Row
from pmr.scene.names import named

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RingWall:
    """The walls under one ring of pads."""

    pads: tuple[str, ...]  # their names
    length: float  # m, of the body
    free: tuple[bool, bool]  # whether nothing keeps its tail, and its tip, in shape
    places: Array  # (p,) m from an end: where the compliance is known; constant beyond the last one
    compliance: Array  # (p, k, k): C in m/N
    mass: float  # kg

    @property
    def stiffness(self) -> float:
        """k_0 in N/m: that of a pad's wall away from the ends, on average."""
        return len(self.pads) / float(np.trace(self.compliance[-1]))

    def at(self, x: Array) -> Array:
        """S (len(x), k, k) at places along the body in m."""
        values, vectors = np.linalg.eigh(self.stiffness * self.compliance)
        roots = (vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]) @ vectors.transpose(0, 2, 1)
        far = np.full_like(x, np.inf)
        near = np.minimum(x if self.free[0] else far, self.length - x if self.free[1] else far)
        return np.asarray(PchipInterpolator(self.places, roots)(np.clip(near, self.places[0], self.places[-1])))


@dataclass(frozen=True)
class EndWall:
    """The walls of a free end, along or about one direction."""

    on: str
    direction: str
    stiffness: float  # N/m, or N m
    mass: float  # kg, or kg m^2


@dataclass(frozen=True)
class Walls:
    """All that give way: their coordinates come behind all others of a body, in this order."""

    rings: tuple[RingWall, ...] = ()
    ends: tuple[EndWall, ...] = ()

    @property
    def count(self) -> int:
        """Of their coordinates."""
        return sum(len(ring.pads) for ring in self.rings) + len(self.ends)

    def stiffness(self, size: int) -> sp.csr_matrix:
        """Theirs among all coordinates, (size, size) N/m."""
        return self._behind([one.stiffness for one in self._each], size)

    def mass(self, size: int) -> sp.csr_matrix:
        """Theirs among all coordinates, (size, size) kg."""
        return self._behind([one.mass for one in self._each], size)

    def dented(self, row: Row, at: float) -> Row:
        """The row of a pad whose wall gives way, if one does: that centred at `at`, of a moving one at s + `at` m."""
        first = row.carriers.shape[1] - self.count
        for ring in self.rings:
            if row.name in ring.pads:
                return _dented(row, at, ring, first)
            first += len(ring.pads)
        return row

    def moved(self, motion: sp.csr_matrix, on: str | float, directions: tuple[str, ...]) -> sp.csr_matrix:
        """Rows (k, n) that measure a place along k directions, and what an end's walls add to each."""
        first = motion.shape[1] - len(self.ends)
        found = [(directions.index(e.direction), first + j) for j, e in enumerate(self.ends)
                 if e.on == on and e.direction in directions]  # fmt: skip
        if not found:
            return motion
        rows, columns = np.array(found).T
        return sp.csr_matrix(motion + sp.csr_matrix((np.ones(len(rows)), (rows, columns)), motion.shape))

    @property
    def _each(self) -> list[RingWall | EndWall]:
        return [*(ring for ring in self.rings for _ in ring.pads), *self.ends]

    def _behind(self, values: list[float], size: int) -> sp.csr_matrix:
        numbers = np.arange(size - len(values), size)
        return sp.csr_matrix((np.asarray(values, float), (numbers, numbers)), (size, size))


def summary(bodies: Mapping[str, Walls]) -> dict[str, list[dict[str, Any]]]:
    """``walls`` of summary.json: by how much each gives way under its pad's own force alone, m/N, and its stiffness.

    At an end that nothing keeps in shape, and away from the ends.
    """
    said = [
        {"name": named(body, pad), "at_the_end": float(end), "away": float(away), "stiffness": 1.0 / float(away)}
        for body, walls in bodies.items()
        for ring in walls.rings
        for pad, end, away in zip(ring.pads, *np.diagonal(ring.compliance[[0, -1]], axis1=1, axis2=2), strict=True)
    ]
    return {"walls": said} if said else {}


def _dented(row: Row, at: float, ring: RingWall, first: int) -> Row:
    i, k = ring.pads.index(row.name), len(ring.pads)
    if row.moves:
        pieces = CubicSpline(row.breaks, ring.at(row.breaks + at)[:, i]).c  # (4, intervals, k)
    else:
        pieces = np.tile(ring.at(np.array([at]))[:, i], (1, len(row.touched), 1))
    degrees = max(len(pieces), len(row.coefficients))
    both = [np.concatenate([np.zeros((degrees - len(c), *c.shape[1:])), c]) for c in (row.coefficients, pieces)]
    dents = sp.csr_matrix((np.ones(k), (np.arange(k), first + np.arange(k))), (k, row.carriers.shape[1]))
    numbers = np.broadcast_to(row.carriers.shape[0] + np.arange(k), (len(row.touched), k))
    return replace(
        row,
        carriers=sp.csr_matrix(sp.vstack([row.carriers, dents])),
        touched=np.hstack([row.touched, numbers]),
        coefficients=np.concatenate(both, axis=2),
    )
