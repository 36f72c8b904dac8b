r"""The flexibility that a basis leaves out, applied and never formed.

With rigid-body modes Z (Z^T M Z = I) and the rest of the basis W, made K-orthonormal (W^T K W = I),

.. math::
    R = P\, K^+ P^T, \qquad P = I - Z (M Z)^T - W (K W)^T

P^T takes from a load what the basis answers and makes it self-equilibrated, so K^+ may be a solve with the rigid-body
modes held at any statically determinate set of coordinates; P takes the basis out of the answer.  For eigenmodes R is
the sum of phi phi^T / omega^2 over the modes left out; for any other basis K^-1 - V (V^T K V)^-1 V^T.  The basis and
what R answers are K-orthogonal in any case; eigenmodes make them M-orthogonal too.

Projecting on both sides keeps what a difference loses: with 6 and 20 modes of a cantilever on 50 elements R is off by
2e-10 and 6e-10 (scaled to a unit diagonal), K^-1 less the modal part by 1e-5 and 1e-4.  Projecting again gains nothing.
MacNeal: A hybrid method of component mode synthesis, Computers & Structures 1, 1971, pp. 581-601; Craig and Kurdila:
Fundamentals of Structural Dynamics, 2nd ed., 2006, section 17.6 (inertia relief).
"""

from __future__ import annotations

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.fem.distributed import freed, inner, sparse, subtract, times
from pmr.fullmodel.symmetry import images_of
from pmr.reduction.snapshots.free_body import FreeBody, fixed_rows

Array = NDArray[np.float64]

#: What a mirror image of a basis may have beside it, over its largest entry.  Modes know their span to 3e-11, 4e-10 and
#: some 3e-9 at 70,000, 280,000 and a million coordinates; one that cuts two equal modes apart is off by all of it.
KEPT = 1e-8


class ResidualFlexibility:
    """R of a model on its fixed rows for the basis V, given by this rank's rows (n_local, r); collective.

    V holds those rigid-body modes that loads or rows excite.
    """

    def __init__(self, body: FreeBody, V: Array) -> None:
        self.model = model = body.model
        self._body, self._comm = body, model.comm
        Z, MZ = body.Z, body.MZ
        self.rigid = body.rigid(V)  # (r,): which columns of the basis are motions of a rigid body
        W = V[:, ~self.rigid]
        W = W - Z @ inner(MZ, W, self._comm)
        W = _orthonormal(W, times(model.K, W), self._comm)
        self._basis = np.asfortranarray(np.hstack([Z, W]))
        self._dual = np.asfortranarray(np.hstack([MZ, times(model.K, W)]))

    def keeps(self, P: sp.csr_matrix) -> bool:
        """Whether basis and fixed rows are their own images by P of the body, so that R P = P R; collective."""
        M, held = self.model.M, [row.at(row.breaks[0]) for row in fixed_rows(self.model)]
        if held and np.any(images_of(sp.vstack(held, format="csr"), [P])[0].partners < 0):
            return False
        first, last = M.getOwnershipRange()
        mirror = sparse(P[first:last], M, columns=last - first)
        image = times(mirror, self._basis)
        freed(mirror)
        apart = image - self._basis @ inner(self._dual, image, self._comm)
        far, size = (np.max(self._comm.allgather(np.abs(x).max(axis=0, initial=0.0)), axis=0) for x in (apart, image))
        return bool(np.all(far <= KEPT * size))

    def apply(self, g: Array) -> Array:
        """R g, this rank's rows (n_local, k) in m, of loads in N given likewise, which may be overwritten."""
        g = np.asfortranarray(g)
        subtract(g, self._dual, inner(self._basis, g, self._comm))
        x = np.asfortranarray(self._body.solve(g))
        subtract(x, self._basis, inner(self._dual, x, self._comm))
        return x

    def powers(self, c: Array, count: int) -> Array:
        """R c, R M R c, ..., (n_local, count), of one load by this rank's rows c (n_local,); collective."""
        found = [self.apply(np.array(c)[:, None])]
        while len(found) < count:
            found.append(self.apply(times(self.model.M, found[-1])))
        return np.asfortranarray(np.hstack(found))


def _orthonormal(X: Array, AX: Array, comm: object) -> Array:
    """Columns of X made A-orthonormal by Cholesky's factor of X^T A X."""
    if X.shape[1] == 0:
        return X
    L = np.linalg.cholesky(inner(X, AX, comm))
    return np.ascontiguousarray(scipy.linalg.solve_triangular(L, X.T, lower=True).T)
