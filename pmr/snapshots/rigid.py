r"""Rigid-body modes, decided by geometry: the closed-form motions that clamps, springs and fixed rows leave free.

With the rigid motions R of the body, M-orthonormal, and all that measures them in one place, clamps and springs H and
fixed rows C,

.. math::
    Z = R\, N, \qquad \begin{pmatrix} H \\ C R \end{pmatrix} N = 0, \qquad Z^T M Z = I

N is a null space of six columns at most, each row scaled to unit length.  No eigenvalue is asked whether it is zero:
what round-off leaves of one depends on lengths, meshes and the machine, and may be nearer to a soft mode than to
nothing.  Z is rigid to the last digit, which computed eigenvectors are not.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmr.constraints.rows import Row
from pmr.fem.distributed import inner, times
from pmr.fullmodel.model import FullModel

Array = NDArray[np.float64]

#: A motion that rows of unit length measure by less is free.  Rows know a rigid motion to some 1e-13; two supports a
#: millimetre apart hold a boom of 100 m by 1e-5.
HELD = 1e-9

#: A vector whose distance from the rigid-body modes is a smaller share of it is one of them: exact ones have 1e-15,
#: what is M-orthogonal to them has 1.
RIGID = 1e-6


def fixed_rows(model: FullModel) -> tuple[Row, ...]:
    """The rows that always hold, in one place: what holds the body while its sliders and pads are released."""
    return tuple(row for row in model.rows.rows if row.fixed)


def rigid_modes(model: FullModel) -> Array:
    """Rigid-body modes that the fixed supports leave free, M-orthonormal, this rank's rows (n_local, c); collective.

    Raises
    ------
    ValueError
        If the model does not know its rigid motions.
    """
    if model.rigid is None:
        raise ValueError("the model's rigid motions are not known, so nothing tells which of them its supports hold")
    R, held = model.rigid.coordinates, model.rigid.held
    for _ in range(2):  # once leaves the condition of motions about a distant origin in the last digits
        U = np.linalg.inv(np.linalg.cholesky(inner(R, times(model.M, R), model.comm)).T)
        R, held = R @ U, held @ U
    return np.ascontiguousarray(R @ _free(np.vstack([held, _measured(model, R)])))


def rigid_bodies(model: FullModel, local: Array) -> NDArray[np.bool_]:
    """Which columns (k,), given by this rank's rows, are motions of a rigid body that the fixed supports allow."""
    Z = rigid_modes(model)
    apart = local - Z @ inner(times(model.M, Z), local, model.comm)
    far, size = model.comm.allreduce(np.array([np.sum(x * times(model.M, x), axis=0) for x in (apart, local)]))
    return np.asarray(far <= RIGID**2 * size)


def _measured(model: FullModel, R: Array) -> Array:
    """What the fixed rows measure of each motion, (h, k)."""
    first = model.M.getOwnershipRange()[0]
    rows = [row.project(R, first).c[-1, 0] for row in fixed_rows(model)]
    return np.asarray(model.comm.allreduce(np.reshape(rows, (len(rows), R.shape[1]))))


def _free(rows: Array) -> Array:
    """Orthonormal combinations (k, c) of k motions that no row (h, k) measures."""
    size = np.linalg.norm(rows, axis=1, keepdims=True)
    scaled = rows[size[:, 0] > 0.0] / size[size[:, 0] > 0.0]
    count = rows.shape[1]
    if not len(scaled):
        return np.eye(count)
    _, values, Vt = np.linalg.svd(np.vstack([scaled, np.zeros((count, count))]), full_matrices=False)
    return np.asarray(Vt[values <= HELD].T)
