r"""Full coordinates from reduced ones, at chosen times.

.. math:: q = V p + R\, (B f - C(s)^T z)

R is the flexibility that the basis leaves out, applied by one factorisation to the loads of the chosen times; without
residual flexibility q = V p.  z are the multipliers that deform the residual part: all of them, or, where its inertia
is kept, `pmr.system.body.Trajectory.quasi_static`.  What the model says of its outputs, O V p + W f - X z, is then O q.

Velocities are V p': those of the residual part follow from rates of the multipliers, which jump wherever the path or a
load has a kink (`pmr.compare.velocities`; docs/moving_residual_flexibility.md, sections 2, 5 and 11).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.fem.matrices import local_csr
from pmr.fullmodel.model import FullModel
from pmr.reduced.model import ReducedModel
from pmr.reduction.residual.operator import ResidualFlexibility
from pmr.reduction.snapshots.free_body import FreeBody
from pmr.scene.members import TAIL
from pmr.system.body import Trajectory

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Times recovered at once; bounds memory at some multiples of this many vectors of full length.
BLOCK = 64


@dataclass(frozen=True)
class ReducedStates:
    """What a simulated reduced model says at S times.

    Attributes
    ----------
    t : (S,) array, s
    s : (S,) array, m
        (S, m) of a body of a system, whose rows are each at a place of their own.
    p, v : (S, r) arrays
        Coordinates and their rates.
    multipliers : (S, m) array, N
        z, those that deform the residual part.
    loads : (S, i) array, N
    """

    t: Array
    s: Array
    p: Array
    v: Array
    multipliers: Array
    loads: Array

    def __getitem__(self, which: slice) -> ReducedStates:
        """Some of the states."""
        return ReducedStates(*(getattr(self, name)[which] for name in ("t", "s", "p", "v", "multipliers", "loads")))


def chosen_states(trajectory: Trajectory, loads: Array, steps: Indices) -> ReducedStates:
    """The states of a trajectory under loads (T, i) in N at some of its steps (S,)."""
    t, s, p, v, z = (
        array[steps] for array in (trajectory.t, trajectory.s, trajectory.q, trajectory.v, trajectory.deforming)
    )
    return ReducedStates(t, s, p, v, z, loads[steps])


class Recovery:
    """Recovers states of a full model; every method is collective.

    Parameters
    ----------
    model : FullModel
    V : (n_local, k) array
        This rank's rows of the basis; its first columns are the reduced model's modes, without those of a cylinder.
    reduced : ReducedModel
        The same on every rank.
    solver : ``"auto"``, ``"dense"`` or ``"slepc"``
        As for the residual flexibility's tables.
    rows : sequence of str, optional
        The row of each of the states' multipliers; by default those of the reduced model.

    Attributes
    ----------
    V : (n_local, r) array
        This rank's rows of all coordinates of the reduced model.
    """

    def __init__(
        self,
        model: FullModel,
        V: Array,
        reduced: ReducedModel,
        solver: str = "auto",
        rows: Sequence[str] | None = None,
    ) -> None:
        self.reduced = reduced
        self._model, modes = model, reduced.size - reduced.cylinder_modes
        self.V = np.ascontiguousarray(V[:, :modes])
        self._share = slice(*model.M.getOwnershipRange())
        self._residual: ResidualFlexibility | None = None
        if reduced.flexibility is not None:
            self._rows = [model.rows.rows[model.rows.names.index(name)] for name in rows or reduced.row_names]
            self._inputs = local_csr(model.inputs)
            body = FreeBody(model, solver)
            self._residual = ResidualFlexibility(body, self.V)
            if reduced.cylinder_modes:
                self.V = np.hstack([self.V, self._of_cylinder(self._residual)])
                self._residual = ResidualFlexibility(body, self.V)

    @property
    def comm(self) -> Any:
        return self._model.comm

    def _of_cylinder(self, modal: ResidualFlexibility) -> Array:
        """The coordinates after the modes, this rank's rows: what answers the force at the body's tail."""
        carriers, model = self.reduced.carriers, self._model
        assert carriers is not None and carriers.answers is not None
        tail = model.rows.rows[model.rows.names.index(TAIL)]
        turned = carriers.answers.turned
        return modal.powers(tail.at(tail.breaks[0]).toarray()[0, self._share], len(turned)) @ turned

    def positions(self, states: ReducedStates) -> Array:
        """This rank's rows of q, (S, n_local), of states that are the same on every rank.

        For many states of a large model ask for `blocks`.
        """
        parts = [np.empty((0, len(self.V))), *self.blocks(states)]
        return np.concatenate(parts)

    def velocities(self, states: ReducedStates) -> Array:
        """V p', this rank's rows (S, n_local): without the residual part's."""
        return np.asarray(states.v @ self.V.T)

    def blocks(self, states: ReducedStates) -> Iterator[Array]:
        """The same as `positions`, at most `BLOCK` states at a time, one block after the other."""
        for k in range(0, len(states.t), BLOCK):
            yield self._block(states[k : k + BLOCK])

    def _block(self, states: ReducedStates) -> Array:
        q = states.p @ self.V.T
        if self._residual is not None:
            q += self._residual.apply(self._loads(states)).T
        return np.asarray(q)

    def _loads(self, states: ReducedStates) -> Array:
        """This rank's rows (n_local, S) of B f - C(s)^T z, in N."""
        g = np.asarray(self._inputs @ states.loads.T)
        s = states.s if states.s.ndim == 2 else np.repeat(states.s[:, None], len(self._rows), axis=1)
        for row, z, at in zip(self._rows, states.multipliers.T, s.T, strict=True):
            weights = sp.diags(z) @ row.weights(at)
            g -= (weights @ row.carriers[:, self._share]).T.toarray()
        return g
