r"""Walls of a beam that give way under its pads, and at its free ends.

A beam's section keeps its shape; a box's walls do not.  With the walls' own compliance :math:`C`, computed by static
solves on a shell of the body (`pmr.fullmodel.wall_compliance`), pads that press with forces f dent the walls by
:math:`C f`, in addition to the pads' own compliance 1/k.  The body gets one more coordinate y per pad, each with the
strain energy :math:`\tfrac12 k_0 y^2`, and the dent :math:`\delta` is added to the displacement that the pad measures.
The index f means all fixed pads and ends, and the index m means pads that slide along the body by u:

.. math::
    \delta_f = S_f\, y_f, \quad S_f S_f^T = k_0\, C_{ff}, \qquad
    \delta_m = A(u)\, y_f + S_m(u)\, y_m, \quad
    A S_f^T = k_0\, C_{mf}, \quad S_m^2 = k_0\, C_{mm} - A A^T

So the pads of one ring dent the walls under each other, and so do rings that come close.  Both :math:`S_f` and
:math:`S_m` come from symmetric roots, which are smooth wherever C is, so that a row is still a cubic of the path
coordinate between its breaks.  Pads that slide on one path do not dent the walls under pads that slide on another.  The
mass that belongs to a pad's y is that of the wall under the pad.

A free end, whose shape no clamp or rigid mass keeps, is treated as a fixed pad.  A mass that follows the end's mean
motion, a load or a support there moves along y and z and turns about x by more than the beam does.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.interpolate import CubicSpline, PchipInterpolator

from pmr.files.arrays import Array
from pmr.scene.keys import qualified_name
from pmr.system.rows import Row

#: Eigenvalues below this share of the largest one count as zero in a root: two pads at one point then count as one.
SAME = 1e-9
#: Entries of A, of about one at most, below which sliding pads count as independent of fixed pads.
SHARED = 0.01
#: k_0 of a body without pads, N/m.
STIFF = 1e7


@dataclass(frozen=True)
class Standing:
    """The m fixed pads and ends of a body: pads first, then ends, each along or about one direction."""

    pads: tuple[str, ...] = ()  # their names
    ends: tuple[tuple[str, str], ...] = ()  # as ("tip", "y")
    compliance: Array = field(default_factory=lambda: np.empty((0, 0)))  # (m, m): C_ff in m/N, rad/N, rad/(N m)
    masses: Array = field(default_factory=lambda: np.empty(0))  # (m,) kg, or kg m^2


@dataclass(frozen=True)
class Sliding:
    """The k pads that slide together along a body, with their compliance at p distances."""

    pads: tuple[str, ...]  # their names
    first: Array  # (k,) m: coordinates of their centres along the body at u = 0
    u: Array  # (p,) m: distances from there; beyond the last one compliance is constant
    compliance: Array  # (p, k, k): C_mm in m/N
    standing_compliance: Array  # (p, k, m): C_mf in m/N
    masses: Array  # (k,) kg


@dataclass(frozen=True)
class Walls:
    """Walls of a body that give way: under fixed pads and at ends, then under sliding pads.

    The coordinates y of the walls are the last ones of the body, in this order, each with the strain energy k_0 y^2 /
    2.  C_ff is the walls' compliance under m fixed pads and ends, and C_mm the compliance under k sliding pads.  C_mf
    are the dents of sliding pads under forces on fixed ones.  The dents of fixed pads and ends are S_f y_f, with S_f
    S_f^T = k_0 C_ff.  The dents of sliding pads are A y_f + S_m y_m, with A S_f^T = k_0 C_mf and S_m^2 = k_0 C_mm - A
    A^T.
    """

    standing: Standing = Standing()
    sliding: tuple[Sliding, ...] = ()

    @property
    def count(self) -> int:
        """Number of the walls' coordinates."""
        return len(self.standing.masses) + sum(len(sliding.pads) for sliding in self.sliding)

    @cached_property
    def stiffness_scale(self) -> float:
        """Stiffness k_0 in N/m: the inverse of the pads' mean compliance, or `STIFF` if there are no pads."""
        compliances = [c for _, c in self.pad_compliances]
        return 1.0 / float(np.mean(compliances)) if compliances else STIFF

    @property
    def pad_compliances(self) -> Iterator[tuple[str, float]]:
        """Yield the name of each pad, and the compliance in m/N of the wall under the pad's own force.

        For a sliding pad it is the mean over the path.
        """
        yield from zip(self.standing.pads, np.diagonal(self.standing.compliance), strict=False)
        for sliding in self.sliding:
            yield from zip(sliding.pads, np.diagonal(sliding.compliance, axis1=1, axis2=2).mean(axis=0), strict=True)

    def compliance_under(self, pad: str, x: float) -> float:
        """Compliance in m/N of the wall under a pad by the pad's own force; 0 if the wall is rigid.

        x (m) is the place of the pad's centre on the body.  For a fixed pad x does not matter.  For a sliding pad whose
        x is beyond its path, the compliance at the nearer end of the path is returned.
        """
        if pad in self.standing.pads:
            number = self.standing.pads.index(pad)
            return float(self.standing.compliance[number, number])
        for sliding in self.sliding:
            if pad in sliding.pads:
                i = sliding.pads.index(pad)
                u = np.clip(x - sliding.first[i], sliding.u[0], sliding.u[-1])
                return float(PchipInterpolator(sliding.u, sliding.compliance[:, i, i])(u))
        return 0.0

    def stiffness(self, size: int) -> sp.csr_matrix:
        """Stiffness (size, size) in N/m of the walls on the body's `size` coordinates.

        It has k_0 on the diagonal of the walls' own coordinates, which are the last ones, and zeros elsewhere.
        """
        return self._last_diagonal(np.full(self.count, self.stiffness_scale if self.count else 0.0), size)

    def mass(self, size: int) -> sp.csr_matrix:
        """Mass (size, size) in kg of the walls on the body's `size` coordinates.

        It has entries on the diagonal of the walls' own coordinates, which are the last ones.  The entry of a pad or an
        end is its mass, times k_0, times its compliance.  For a sliding pad, the mean compliance over its path counts.
        """
        sizes = [np.diagonal(self.standing.compliance)]
        sizes += [np.diagonal(sliding.compliance, axis1=1, axis2=2).mean(axis=0) for sliding in self.sliding]
        masses = np.concatenate([self.standing.masses, *(sliding.masses for sliding in self.sliding)])
        return self._last_diagonal(masses * np.concatenate(sizes) * (self.stiffness_scale if self.count else 0.0), size)

    def pad_row(self, row: Row, centre: float) -> Row:
        """Row of a pad with the dents of its wall as further carriers; `row` itself if the wall under it is rigid.

        The pad is centred at `centre` (m) on the body, or at s + `centre` if it moves with the path coordinate s.
        """
        behind, m = row.carriers.shape[1] - self.count, len(self.standing.masses)
        if row.name in self.standing.pads:
            carriers = np.zeros((1, self.count))
            carriers[0, :m] = self._standing_root[self.standing.pads.index(row.name)]
            return _add_dents(row, np.ones((len(row.breaks), 1)), carriers, behind)
        first = m
        for sliding, (A, shared, S) in zip(self.sliding, self._sliding_factors, strict=True):
            k = len(sliding.pads)
            if row.name in sliding.pads:
                i = sliding.pads.index(row.name)
                u = np.clip(row.breaks + centre - sliding.first[i], sliding.u[0], sliding.u[-1])
                parts = [PchipInterpolator(sliding.u, part[:, i])(u) for part in (A, S)]
                carriers = np.zeros((len(shared) + k, self.count))
                carriers[: len(shared), :m], carriers[len(shared) :, first : first + k] = shared, np.eye(k)
                return _add_dents(row, np.hstack(parts), carriers, behind)
            first += k
        return row

    def add_end_motion(self, motion: sp.csr_matrix, place: str | float, directions: tuple[str, ...]) -> sp.csr_matrix:
        """Rows (k, n) that measure a `place` along or about k `directions`, including the motion of its walls.

        `motion` (k, n) are the rows without the motion of walls.  If the place is no end that gives way in one of the
        directions, `motion` itself is returned.
        """
        behind, pads = motion.shape[1] - self.count, len(self.standing.pads)
        ends = enumerate(self.standing.ends)
        pairs = [(directions.index(d), pads + j) for j, (end, d) in ends if end == place and d in directions]
        if not pairs:
            return motion
        rows, which = np.array(pairs).T
        more = sp.lil_matrix(motion.shape)
        more[rows, behind : behind + self._standing_root.shape[1]] = self._standing_root[which]
        return sp.csr_matrix(motion + more.tocsr())

    @cached_property
    def _standing_root(self) -> Array:
        """Matrix S_f (m, m) with S_f S_f^T = k_0 C_ff, from the symmetric root of C_ff scaled by its diagonal.

        C_ff is scaled because its entries differ in unit and size.
        """
        d = np.sqrt(np.diagonal(self.standing.compliance))
        return np.asarray(np.sqrt(self.stiffness_scale) * d[:, None] * _root(self.standing.compliance / np.outer(d, d)))

    @cached_property
    def _sliding_factors(self) -> list[tuple[Array, Array, Array]]:
        """Factors A' (p, k, r) and V (r, m) of A = A' V, and the matrices S_m (p, k, k), for each `Sliding`.

        The class's docstring has the matrices A and S_m.  V y_f has r components.  A component is left out if its
        column of A' has no entry above `SHARED`, as it hardly moves the pads that slide.
        """
        inverse, factors = np.linalg.pinv(self._standing_root, rcond=SAME**0.5).T, []
        for sliding in self.sliding:
            A = self.stiffness_scale * sliding.standing_compliance @ inverse
            V = np.linalg.svd(A.reshape(A.shape[0] * A.shape[1], -1) if A.size else A[0], full_matrices=False)[2]
            V = V[np.abs(A @ V.T).max(axis=(0, 1), initial=0.0) > SHARED]
            A = A @ V.T
            factors.append((A, V, _root(self.stiffness_scale * sliding.compliance - A @ A.transpose(0, 2, 1))))
        return factors

    def _last_diagonal(self, values: Array, size: int) -> sp.csr_matrix:
        """Diagonal matrix (size, size) with `values` (k,) at its end and zeros before."""
        numbers = np.arange(size - len(values), size)
        return sp.csr_matrix((values, (numbers, numbers)), (size, size))


def summary(bodies: Mapping[str, Walls]) -> dict[str, list[dict[str, Any]]]:
    """Entry ``walls`` of summary.json: compliance in m/N and stiffness in N/m of the wall under each pad's own force.

    For a sliding pad the compliance is the mean over the path.  `bodies` are the walls by the name of the body.
    Returns an empty dict if no walls give way.
    """
    walls_of_bodies = [
        {"name": qualified_name(body, pad), "compliance": float(c), "stiffness": 1.0 / float(c)}
        for body, walls in bodies.items()
        for pad, c in walls.pad_compliances
    ]
    return {"walls": walls_of_bodies} if walls_of_bodies else {}


def _root(C: Array) -> Array:
    """Symmetric roots of symmetric matrices C (..., k, k), with 0 for eigenvalues that are negative or round-off."""
    values, vectors = np.linalg.eigh((C + np.swapaxes(C, -1, -2)) / 2.0)
    least = SAME * np.abs(values).max(axis=-1, initial=0.0, keepdims=True)
    roots = np.sqrt(np.where(values > least, values, 0.0))
    return np.asarray((vectors * roots[..., None, :]) @ np.swapaxes(vectors, -1, -2))


def _add_dents(row: Row, dents: Array, carriers: Array, behind: int) -> Row:
    """Return `row` with k more carrier rows, whose weights at the b breaks of the row are `dents` (b, k).

    Between the breaks of a row that moves, a weight is a cubic spline; in a row that stays, it is constant.  The
    carrier rows `carriers` (k, c) act on the last c coordinates, which follow `behind` others.
    """
    k = len(carriers)
    if row.moves:
        pieces = CubicSpline(row.breaks, dents).c  # (4, intervals, k)
    else:
        pieces = dents[None, :-1]
    degrees = max(len(pieces), len(row.coefficients))
    coefficients = [np.concatenate([np.zeros((degrees - len(c), *c.shape[1:])), c]) for c in (row.coefficients, pieces)]
    added = sp.hstack([sp.csr_matrix((k, behind)), sp.csr_matrix(carriers)])
    numbers = np.broadcast_to(row.carriers.shape[0] + np.arange(k), (len(row.touched), k))
    return replace(
        row,
        carriers=sp.csr_matrix(sp.vstack([row.carriers, added])),
        touched=np.hstack([row.touched, numbers]),
        coefficients=np.concatenate(coefficients, axis=2),
    )
