r"""Rigid motions of the nodes of a body, and forces of another program's stiffness matrix under them.

Let K be the stiffness matrix, x_i the position of the node of row i, d(j) the direction of coordinate j, and e_d(j) the
unit vector along this direction.  A rigid motion r is split, about the node of row i, into a translation t and a
rotation w.  The force on row i is then

.. math:: (K r)_i = F_i\, t + G_i\, w, \qquad F_i = \sum_j K_{ij}, \qquad
    G_i = \sum_j K_{ij}\, (e_{d(j)} \cdot (w \times (x_j - x_i)))

F (n, 3) is summed for each direction of translation, and G (n, 3) for each direction of the rotation w of size 1.  Both
are zero if no support and no spring to ground acts on the row.  F shows what holds the row to the ground, and does not
depend on the positions of nodes.  If F is zero and G is not, nodes are not at the points that K was made for.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pmr.files.arrays import Array, Indices

#: Names of the directions of a coordinate: displacements along the axes and rotations about them.
DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")
#: Energy of a free motion of unit size up to which the rounding of a condensation may go (8e-11 of a superelement of
#: Nastran).
CONDENSED = 2e-10
#: Largest number of coordinates for which dense matrices are decomposed.
DENSE = 3000
#: Least and largest rounding of the sum of a row's entries, as a share of the sum of their magnitudes.  The first pair
#: is for entries, which files state with nine to sixteen digits.  The second pair is for positions of nodes, which are
#: known to a thousandth of a cell's size or better.
ROUNDING, ROUNDING_OF_POINTS = (1e-13, 1e-8), (1e-11, 1e-3)
#: Least number of digits behind the point to which files state entries.
DIGITS = 8
#: Rounding is estimated as this multiple of a quartile, over rows, of the sum of a row's entries as a share of the sum
#: of their magnitudes.  It is the lower quartile of all rows for the rounding of entries, and the upper quartile of
#: rows without a support for the rounding of positions.
SPREAD = 100.0


def rigid_motions(at: Array, component: Indices) -> Array:
    """Return n coordinates (n, 6) under six rigid motions: unit translations along x, y, z, then rotations about them.

    The axes of the rotations go through the origin.  Coordinate i is the displacement or rotation `component[i]`, an
    index of `DIRECTIONS`, of the point `at[i]` (3,) in m.
    """
    motions, translations = np.zeros((len(at), 6)), component < 3
    motions[np.arange(len(at)), component] = 1.0
    motions[translations, 3:] = np.cross(at[translations], np.eye(3)[component[translations]])
    return motions


def elastic_energies(K: sp.csr_matrix, R: Array, q: Array) -> Array:
    """Return q^T K q (k,) in N m of k motions q (n, k), without the part of supports and springs to ground in K.

    With r rigid motions R (n, r), this part has the stiffness K R (R^T K R)^+ R^T K, where ^+ is the pseudoinverse.
    The remaining stiffness does not resist R.
    """
    resisted = K @ R
    on_ground = resisted.T @ q
    ground = np.einsum("rk,rk->k", on_ground, np.linalg.pinv(R.T @ resisted, hermitian=True) @ on_ground)
    return np.asarray(np.einsum("nk,nk->k", q, K @ q) - ground)


class RoundedSums(NamedTuple):
    """Sums (n, 3) over the entries of n rows of a matrix, one for each of three motions, with a number for each row.

    The number is the rounding of the row's sums, or the sum of the magnitudes of their terms: the function that returns
    it says which.
    """

    sums: Array
    rounding: Array


@dataclass(frozen=True)
class Resistance:
    """Resistance of the stiffness K (n, n) of a body on N nodes to rigid motions.

    F (n, 3) are the forces on rows of K under unit translations, G (n, 3) those under unit rotations about the node of
    each row (see the module).  Entries of F and G that are within rounding are set to zero.
    """

    K: sp.csr_matrix
    points: Array  # (N, 3) m, positions of the nodes
    node: Indices  # (n,) node of each row of K
    direction: Indices  # (n,) direction of each row of K, an index of `DIRECTIONS`

    def __post_init__(self) -> None:
        """Replace a K whose entries are unsorted by a sorted copy.

        `on_pattern` shares its indices, and SciPy would sort them in place.
        """
        if not self.K.has_canonical_format:
            ordered = self.K.copy()
            ordered.sum_duplicates()
            object.__setattr__(self, "K", ordered)

    @cached_property
    def entries(self) -> sp.coo_matrix:
        """Row, column and absolute value of each of the e stored entries of K."""
        return abs(self.K).tocoo()

    @cached_property
    def edges(self) -> Array:
        """Distances (e,) in m between the nodes of row and column of each of the e stored entries of K."""
        row, column = self.entries.row, self.entries.col
        squares = np.zeros(len(row))
        for x in self.points[self.node].T:
            squares += (x[row] - x[column]) ** 2
        return np.sqrt(squares)

    def on_pattern(self, values: Array) -> sp.csr_matrix:
        """Return a sparse matrix (n, n) with `values` (e,) in place of the e stored entries of K.

        The matrix shares its indices with K.
        """
        return sp.csr_matrix((values, self.K.indices, self.K.indptr), shape=self.K.shape)

    @cached_property
    def coupling(self) -> sp.csr_matrix:
        """Matrix (N, N) with sums of absolute entries of K: positive for two nodes that K couples, else zero."""
        rows = np.arange(len(self.node))
        of_nodes = sp.csr_matrix((np.ones(len(rows)), (self.node, rows)), (len(self.points), len(rows)))
        return sp.csr_matrix(of_nodes @ abs(self.K) @ of_nodes.T)

    @cached_property
    def _translations(self) -> RoundedSums:
        """F (n, 3) with entries within rounding set to zero, and the rounding (n,) of each row."""
        T = self.motions[:, :3]
        return _remove_rounding(self.K @ T, (abs(self.K) @ T).sum(axis=1), self._limits(ROUNDING), 0.25)

    @cached_property
    def grounded_nodes(self) -> NDArray[np.bool_]:
        """Mask (N,) of nodes with a row that resists a translation, as at supports and springs to ground."""
        grounded = np.zeros(len(self.points), dtype=bool)
        grounded[self.node[self._translations.sums.any(axis=1)]] = True
        return grounded

    @cached_property
    def missing_displacements(self) -> NDArray[np.bool_]:
        """Mask (N, 3) of displacements of nodes along x, y, z that have no coordinate, as at supports."""
        lacking = np.ones((len(self.points), 3), dtype=bool)
        translations = self.direction < 3
        lacking[self.node[translations], self.direction[translations]] = False
        return lacking

    def near(self, missing: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return a mask (N,) of nodes that are near a node of the mask `missing` (N,).

        A node is near if its distance is at most 1.2 times that of the farthest node that K couples with it, and at
        most half the body's length.
        """
        if not missing.any():
            return np.zeros(len(missing), dtype=bool)
        reach = np.zeros(len(missing))
        np.maximum.at(reach, self.node, self.on_pattern(self.edges).max(axis=1).toarray().ravel())
        reach = np.minimum(1.2 * reach, 0.5 * float(np.ptp(self.points, axis=0).max()))
        return np.asarray(cKDTree(self.points[missing]).query(self.points)[0] <= reach)

    @cached_property
    def blocks(self) -> Array:
        """Forces (N, 3, 3) in N/m on each node along three axes (rows) under three unit translations (columns).

        The forces are zero along axes without a coordinate.
        """
        blocks, translations = np.zeros((len(self.points), 3, 3)), self.direction < 3
        blocks[self.node[translations], self.direction[translations]] = self._translations.sums[translations]
        return blocks

    @cached_property
    def spring_nodes(self) -> NDArray[np.bool_]:
        """Mask (N,) of grounded nodes that are held by a spring.

        The spring acts at the node, or at a point within the body's length of the node.  Its force is then a symmetric
        matrix S (3, 3) times the displacement of this point: S v if the body moves by v, and S (w x d) if it turns by w
        about the node, with the vector d from the node to the point.
        """
        translations = self.direction < 3
        S, G = self.blocks, np.zeros((len(self.points), 3, 3))
        at = self.node[translations], self.direction[translations]
        sums, sizes = self.sums_of_moments
        G[at] = sums[translations]
        allowed, noise = np.zeros((2, len(self.points), 3))
        allowed[at], noise[at] = ROUNDING_OF_POINTS[1] * sizes[translations], self._translations[1][translations]
        most = 1e-6 * np.abs(S).max(axis=(1, 2)) + 2.0 * noise.max(axis=1)
        skew = np.abs(S - S.transpose(0, 2, 1)).max(axis=(1, 2)) > most
        at_node = (np.abs(G).max(axis=2) <= allowed).all(axis=1)
        levers = np.einsum("nab,bcd->nacd", S, np.cross(np.eye(3)[:, None], np.eye(3)[None]).transpose(2, 0, 1))
        d = np.einsum("ndm,nm->nd", np.linalg.pinv(levers.reshape(-1, 9, 3), rcond=1e-6), G.reshape(-1, 9))
        residuals = np.abs(G - np.einsum("nacd,nd->nac", levers, d)).max(axis=2)
        near = np.linalg.norm(d, axis=1) <= np.ptp(self.points, axis=0).max()
        return np.asarray(self.grounded_nodes & ~skew & (at_node | (near & (residuals <= allowed).all(axis=1))))

    @cached_property
    def sums_of_moments(self) -> RoundedSums:
        """G (n, 3) including rounding, and for each row the sum (n,) of the magnitudes of the terms of G."""
        column, size = self.entries.col, self.entries.data
        local = np.where(self.direction[column] < 3, self.edges, 1.0)
        sums, middle = self.K @ self.motions, self.points.mean(axis=0)
        moments = sums[:, 3:] - np.einsum("na,nab->nb", sums[:, :3], self._levers(middle))
        return RoundedSums(moments, np.asarray(self.on_pattern(size * local).sum(axis=1)).ravel())

    @cached_property
    def _rotations(self) -> RoundedSums:
        """G (n, 3) with entries within rounding set to zero, and the rounding (n,) of each row.

        Supports displace the rows of their neighbours.  So rows at grounded nodes are left as they are, except at nodes
        that a spring holds.
        """
        sums, sizes = self.sums_of_moments
        near_supports = (self.grounded_nodes & ~self.spring_nodes)[self.node]
        cleaned, noise = _remove_rounding(sums, sizes, self._limits(ROUNDING_OF_POINTS), 0.75, ~near_supports)
        return RoundedSums(np.where(near_supports[:, None], sums, cleaned), noise)

    @cached_property
    def motions(self) -> Array:
        """Coordinates (n, 6) under the six rigid motions about the mean of all points."""
        return rigid_motions((self.points - self.points.mean(axis=0))[self.node], self.direction)

    @property
    def rounding_share(self) -> float:
        """Rounding of K as a share of its entries, at least 1e-16.

        A translation takes no force but round-off in most rows.  The share of a row is its largest force under a unit
        translation, divided by the sum of the magnitudes of the terms.  The lower quartile of all rows is returned.
        """
        T = self.motions[:, :3]
        sizes = (abs(self.K) @ T).sum(axis=1)
        shares = np.abs(self.K @ T).max(axis=1)[sizes > 0.0] / sizes[sizes > 0.0]
        return max(1e-16, float(np.quantile(shares, 0.25)))

    @property
    def dense(self) -> bool:
        """Whether more than half of K is stored, as of a condensed body, and K is small enough to be decomposed."""
        n = self.K.shape[0]
        return bool(self.K.nnz > 0.5 * n**2 and n <= DENSE)

    @cached_property
    def scaled_eigenvalues(self) -> Array:
        """Eigenvalues (n,) of K, with its diagonal scaled to one, in ascending order."""
        scale = 1.0 / np.sqrt(self.K.diagonal())
        return np.asarray(np.linalg.eigvalsh(self.K.toarray() * scale * scale[:, None]))

    @cached_property
    def digits(self) -> int:
        """Number of digits behind the point to which a sample of K's entries is written, from 5 to 16.

        Entries in single precision have 7.
        """
        sample = self.K.data[np.linspace(0, self.K.nnz - 1, min(self.K.nnz, 500)).astype(int)]
        single = 7 if np.all(sample.astype(np.float32) == sample) else 16
        return next((d for d in range(5, single) if all(float(f"{x:.{d}e}") == x for x in sample.tolist())), single)

    def _limits(self, limits: tuple[float, float]) -> tuple[float, float]:
        """Return two `limits` of the rounding, the least and the largest one.

        The least one is raised to the rounding of the digits of K, if this is larger.
        """
        return max(limits[0], 0.5 * 10.0 ** -max(self.digits, DIGITS)), limits[1]

    @cached_property
    def least_energy(self) -> float:
        """Energy above which a motion of unit size is not free: its energy is more than the rounding of K.

        K is scaled to a diagonal of ones.  The limit follows from the digits to which K is written.  If no motion is
        free to these digits, the limit is at least `CONDENSED`, that of a condensed matrix.
        """
        energy = 10.0 * 10.0**-self.digits + 1e-13 * self.K.shape[0]
        return energy if self.scaled_eigenvalues[0] < energy else max(energy, CONDENSED)

    def _held_by_energy(self, motions: Array) -> Array:
        """Return a matrix H (h, 6) that tells which sums of six rigid `motions` (n, 6) K resists.

        With factors a (6,) of the motions, H a is zero if the motion takes no energy.
        """
        scale = 1.0 / np.sqrt(self.K.diagonal())
        Q, T = np.linalg.qr(motions / scale[:, None])
        energies, V = np.linalg.eigh(Q.T @ (scale[:, None] * (self.K @ (scale[:, None] * Q))))
        return np.asarray(V[:, energies > self.least_energy].T @ T)

    def held_motions(self) -> Array:
        """Return a matrix H (h, 6) that tells which sums of the six rigid motions K resists.

        With factors a (6,) of the rigid motions, H a is zero if K leaves their sum free.  The rotations are about axes
        through the origin.  The number h is that of the rigid motions that supports and springs in K hold, from 0 to 6.

        The rows of H are singular vectors of F and G, whose rows are divided by their rounding; singular values within
        rounding count as zero.  In a dense K supports act on all rows; there the energies of rigid motions decide.
        """
        (F, of_forces), (G, of_moments) = self._translations, self._rotations
        middle = self.points.mean(axis=0)
        length = float(np.ptp(self.points, axis=0).max()) or 1.0
        rows = np.hstack([F, (G + np.einsum("na,nab->nb", F, self._levers(middle))) / length])
        noise = of_forces + np.where(G.any(axis=1), of_moments / length, 0.0)
        acting = rows.any(axis=1) & (noise > 0.0)
        if not acting.any():
            return np.empty((0, 6))
        triangle = np.linalg.qr(rows[acting] / noise[acting, None], mode="r")
        _, sigma, Vt = np.linalg.svd(triangle)
        rank = int(np.sum(sigma > 3.0 * np.sqrt(acting.sum())))
        if self.dense:
            motions = np.hstack([self.motions[:, :3], self.motions[:, 3:] / length])
            by_energy = self._held_by_energy(motions)
            if len(by_energy) != rank:  # else the vectors of F and G are those with less round-off
                Vt, rank = by_energy, len(by_energy)
        about_origin = np.eye(6)
        about_origin[:3, 3:] = np.cross(np.eye(3), middle).T
        about_origin[3:, 3:] *= length
        return np.asarray(Vt[:rank] @ about_origin)

    def _levers(self, about: Array) -> Array:
        """Return the displacements (n, 3, 3) in m/rad of the node of each row under three unit rotations.

        The axes of the rotations go through `about` (3,) in m.  The last axis of the array is the rotation.
        """
        x = self.points[self.node] - about
        return np.asarray(np.cross(np.eye(3)[None], x[:, None]).transpose(0, 2, 1))


def _remove_rounding(
    sums: Array, sizes: Array, limits: tuple[float, float], part: float, free: NDArray[np.bool_] | None = None
) -> RoundedSums:
    """Return sums (n, 3) with entries within rounding set to zero, and the rounding (n,) of each row.

    The rounding is estimated as a share of `sizes`, between the two `limits`.  The least limit is used if the estimate
    exceeds the largest one, as the rows then hold more than rounding.

    Parameters
    ----------
    sums : (n, 3) array
        Sums over the entries of n rows, for three motions.
    sizes : (n,) array
        For each row, the sum of the magnitudes of the numbers that are added.
    limits : pair of float
        Least and largest rounding, as a share of `sizes`.
    part : float
        Share of the rows, those with the smallest sums, whose sums are taken to be rounding alone.
    free : (n,) mask, optional
        Rows that the estimate is based on; by default all rows.
    """
    least, most = limits
    shares = np.divide(np.abs(sums).max(axis=1), sizes, out=np.zeros(len(sums)), where=sizes > 0.0)
    shares = shares if free is None else shares[free]
    share = SPREAD * float(np.quantile(shares, part)) if len(shares) else most
    noise = (max(least, share) if share < most else least) * sizes
    return RoundedSums(np.where(np.abs(sums) > noise[:, None], sums, 0.0), noise)
