"""Forces of unilateral contacts of a system at rest, by a method that the package does not use."""

import numpy as np
import scipy.linalg
import scipy.optimize

from pmr import System
from pmr.system.assembly import Assembly


def by_least_squares(system: System, x: np.ndarray, f: np.ndarray) -> np.ndarray:
    """Forces (m,) in N of unilateral contacts with their sides at x under the loads f, from a quadratic problem.

    min lambda^T A lambda / 2 - b^T lambda over lambda >= 0 and Z^T C^T lambda = Z^T B f, with A = C K^+ C^T + F, b = C
    K^+ B f - clearance and the rigid motions Z.  It is solved as non-negative least squares, where the equilibrium of
    rigid motions weighs a million times more.
    """
    a = Assembly(system)
    rows, K = a.contact_rows(x), a.K.toarray()
    C, scale = rows.C, np.sqrt(np.diagonal(K))
    values, vectors = np.linalg.eigh(K / np.outer(scale, scale))
    elastic = values > 1e-9
    Y, Z = vectors[:, elastic] / scale[:, None] / np.sqrt(values[elastic]), vectors[:, ~elastic] / scale[:, None]
    A, b = C @ Y @ Y.T @ C.T + rows.F, C @ Y @ Y.T @ (a.B @ f) - system.clearance
    unit = 1.0 / np.sqrt(np.diagonal(A))  # lambda = unit * mu
    R = scipy.linalg.cholesky(A * np.outer(unit, unit))
    E = Z.T @ C.T * unit
    size = 1e6 / np.linalg.norm(E, axis=1)
    left = np.vstack([R, size[:, None] * E])
    right = np.concatenate([scipy.linalg.solve_triangular(R.T, unit * b, lower=True), size * (Z.T @ (a.B @ f))])
    return np.asarray(unit * scipy.optimize.nnls(left, right)[0])
