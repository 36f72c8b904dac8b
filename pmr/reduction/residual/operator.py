r"""The flexibility that a basis leaves out, applied and never formed.

With rigid-body modes Z (Z^T M Z = I) and the rest of the basis W, turned so that W^T M W = I and W^T K W = diag(theta),

.. math::
    R = P\, K^+ P^T, \qquad P = I - Z (M Z)^T - W (K W\, \mathrm{diag}(\theta)^{-1})^T

P^T takes from a load what the basis answers and makes it self-equilibrated, so K^+ may be a solve with the rigid-body
modes held at any statically determinate set of coordinates; P takes the basis out of the answer.  For eigenmodes R is
the sum of phi phi^T / omega^2 over the modes left out; for any other basis K^-1 - V (V^T K V)^-1 V^T.  The basis and
what R answers are K-orthogonal in any case; eigenmodes make them M-orthogonal too.

On soft supports K w = theta M w is small beside its own terms, and little but round-off is left of it.  With theta of
2e-5 rad^2/s^2 beside 2e3 of the first mode that bends three digits were; the error of that shell was 0.7, 2.0 or 3.5 %
by the processor's kernel of BLAS.  Where K w is theta M w but for round-off, M w stands for K w / theta: it has all its
digits.

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

from pmr.fem.compat import PETSc
from pmr.fem.distributed import free_objects, inner, sparse, subtract, times
from pmr.fem.matrices import local_csr
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.symmetry import images_of
from pmr.reduction.snapshots.free_body import FreeBody, fixed_rows

Array = NDArray[np.float64]

#: What a mirror image of a basis may have beside it, over its largest entry.  Modes know their span to 3e-11, 4e-10 and
#: some 3e-9 at 70,000, 280,000 and a million coordinates; one that cuts two equal modes apart is off by all of it.
KEPT = 1e-8
#: K w is an eigenmode's theta M w where they differ by no more than so many times the round-off of its terms.
ROUND_OFF = 100.0


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
        W, dual = _diagonalise(model, W)
        self._basis = np.asfortranarray(np.hstack([Z, W]))
        self._dual = np.asfortranarray(np.hstack([MZ, dual]))

    def keeps(self, P: sp.csr_matrix) -> bool:
        """Whether basis and fixed rows are their own images by P of the body, so that R P = P R; collective."""
        M, held = self.model.M, [row.at(row.breaks[0]) for row in fixed_rows(self.model)]
        if held and np.any(images_of(sp.vstack(held, format="csr"), [P])[0].partners < 0):
            return False
        first, last = M.getOwnershipRange()
        mirror = sparse(P[first:last], M, columns=last - first)
        image = times(mirror, self._basis)
        free_objects(mirror)
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
        columns = [self.apply(np.array(c)[:, None])]
        while len(columns) < count:
            columns.append(self.apply(times(self.model.M, columns[-1])))
        return np.asfortranarray(np.hstack(columns))


def terms(A: PETSc.Mat, X: Array) -> Array:
    """|A| |X| (n_local, k): the size of what is summed in A X, by which its round-off is known; collective."""
    sizes = sparse(abs(local_csr(A)), A, columns=A.getLocalSize()[1])
    sums = times(sizes, np.abs(X))
    free_objects(sizes)
    return sums


def _diagonalise(model: FullModel, W: Array) -> tuple[Array, Array]:
    """Columns that span those of W (n_local, k), with W^T M W = I and W^T K W diagonal, and K W over the diagonal."""
    if W.shape[1] == 0:
        return W, W
    comm = model.comm
    theta, Q = scipy.linalg.eigh(inner(W, times(model.K, W), comm), inner(W, times(model.M, W), comm))
    W = np.ascontiguousarray(W @ Q)
    KW, MW, of_K = times(model.K, W), times(model.M, W), terms(model.K, W)
    differs, size = (np.diagonal(inner(x, x, comm)) for x in (KW - theta * MW, of_K))
    return W, np.where(differs <= (ROUND_OFF * np.finfo(float).eps) ** 2 * size, MW, KW / theta)
