r"""A body on its fixed rows, its sliders and pads released: rigid-body modes, and one factor for all that bends.

.. math::
    P = I - Z Z^T M, \qquad P\, K^+ P^T

Z spans the rigid-body modes that the fixed rows leave (`pmr.snapshots.rigid`).  P^T makes a load self-equilibrated, so
K^+ may be a solve with the rigid-body modes held at any statically determinate set of coordinates.  Free modes and the
flexibility beside them take the same factor.  Craig and Kurdila: Fundamentals of Structural Dynamics, 2nd ed., 2006,
section 17.6 (inertia relief).
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from pmr.constraints.rows import Row, carrier, fixed_row
from pmr.fem.distributed import inner, subtract, times
from pmr.fullmodel.block_lanczos import BLOCK, Pairs, largest
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.statics import StaticSolver, static_solver
from pmr.snapshots.rigid import fixed_rows, rigid_modes

Array = NDArray[np.float64]


class FreeBody:
    """Z, M Z and K^+ of a model; factorised when a solve first asks for it, and again after `drop`.  Collective."""

    def __init__(self, model: FullModel, choice: str = "auto") -> None:
        self.model, self.choice = model, choice
        self._solver: StaticSolver | None = None

    @property
    def comm(self) -> Any:
        return self.model.comm

    @cached_property
    def Z(self) -> Array:
        """Rigid-body modes, M-orthonormal, this rank's rows (n_local, c)."""
        return np.asfortranarray(rigid_modes(self.model))

    @cached_property
    def MZ(self) -> Array:
        """M Z, this rank's rows (n_local, c)."""
        return times(self.model.M, self.Z)

    def solve(self, g: Array) -> Array:
        """K^+ g, this rank's rows (n_local, k), of self-equilibrated loads given likewise, which may be overwritten."""
        if self._solver is None:
            rows = [*fixed_rows(self.model), *_anchors(self.model, self.Z)]
            self._solver = static_solver(self.model, rows, self.choice)
        return self._solver.solve(g)

    def elastic(self, count: int) -> Pairs:
        r"""1/omega^2 and modes of the `count` lowest elastic modes, fewer if there are no more.

        Raises
        ------
        ConvergenceError
            If fewer converge.
        """
        first, last = self.model.M.getOwnershipRange()
        loads = np.random.default_rng(7).uniform(-1.0, 1.0, (self.model.size, BLOCK))[first:last]
        dimension = self.model.size - len(fixed_rows(self.model)) - self.Z.shape[1]
        return largest(self._relieved, self.model.M, self._relieved(np.asfortranarray(loads)), count, dimension)

    def drop(self) -> None:
        """Give the factor's memory back."""
        if self._solver is not None:
            self._solver.destroy()
        self._solver = None

    def _relieved(self, g: Array) -> Array:
        """P K^+ P^T g of columns in Fortran's order."""
        g = g.copy(order="F")
        subtract(g, self.MZ, inner(self.Z, g, self.model.comm))
        x = np.asfortranarray(self.solve(g))
        subtract(x, self.Z, inner(self.MZ, x, self.model.comm))
        return x


def _anchors(model: FullModel, Z: Array) -> list[Row]:
    """Rows that hold as many coordinates as there are rigid-body modes Z, those that pin them down best.

    Pivoted QR of the modes, each coordinate weighted by the square root of its mass.
    """
    if Z.shape[1] == 0:
        return []
    weighted = Z * np.sqrt(model.M.getDiagonal().getArray())[:, None]
    everywhere = np.concatenate(model.comm.allgather(weighted))
    pivots = scipy.linalg.qr(everywhere.T, mode="r", pivoting=True)[1][: Z.shape[1]]
    return [fixed_row(f"coordinate {i}", carrier(i, 1.0, model.size), model.rows.domain) for i in pivots]
