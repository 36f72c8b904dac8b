"""Damping as multiples of mass and stiffness, where it is that: a product with D is then one with M."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.dolfinx_compat import PETSc
from pmr.fullorder.effective import product
from pmr.operators import FullModel

Array = NDArray[np.float64]

#: Forces that D and its multiples of M and K may differ by, relative to D's.
SAME = 1e-12


@dataclass(frozen=True)
class Damping:
    """D = mass M + stiffness K + rest, in 1/s and s; None where nothing is left."""

    mass: float
    stiffness: float
    rest: PETSc.Mat | None


def split(model: FullModel) -> Damping:
    """The damping of a model; collective.

    The diagonals give the two factors: their ratios vary from translations to rotations and with the mesh.
    """
    if model.D.norm(PETSc.NormType.NORM_INFINITY) == 0.0:
        return Damping(0.0, 0.0, None)
    M, D, K = (np.array(A.getDiagonal().getArray()) for A in (model.M, model.D, model.K))
    stiff = K > 0.0
    ratio, right = M[stiff] / K[stiff], D[stiff] / K[stiff]
    scale = float(np.max(model.comm.allgather(ratio.max(initial=0.0))))
    if scale > 0.0:
        A = np.stack([ratio / scale, np.ones(len(ratio))], axis=1)
        normal, right = model.comm.allreduce(A.T @ A), model.comm.allreduce(A.T @ right)
        mass, stiffness = np.linalg.lstsq(normal, right, rcond=None)[0] / [scale, 1.0]
        if _is_rayleigh(model, mass, stiffness):
            return Damping(float(mass), float(stiffness), None)
    return Damping(0.0, 0.0, model.D)


def _is_rayleigh(model: FullModel, mass: float, stiffness: float) -> bool:
    first, last = model.D.getOwnershipRange()
    x = np.random.default_rng(5).standard_normal(model.size)[first:last]
    forces = product(model.D, x)
    left = forces - mass * product(model.M, x) - stiffness * product(model.K, x)
    return bool(model.comm.allreduce(left @ left) <= SAME**2 * model.comm.allreduce(forces @ forces))
