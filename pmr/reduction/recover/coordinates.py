r"""Full coordinates from reduced ones, at chosen times.

.. math:: q = V p + R\, (B f - C(s)^T z)

R is the flexibility that the basis leaves out, applied by one factorisation to the loads of the chosen times; without
residual flexibility q = V p.  z are the multipliers.  What the model says of its outputs, O V p + W f - X z, is then
O q.

Velocities are V p': those of the residual part follow from rates of the multipliers, which jump wherever the path or a
load has a kink (`pmr.compare.velocities`; docs/moving_residual_flexibility.md, sections 2, 5 and 11).
"""

from __future__ import annotations

from collections.abc import Iterator
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
from pmr.system.states import BodyStates

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Times recovered at once; bounds memory at some multiples of this many vectors of full length.
BLOCK = 64


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
    ) -> None:
        self.reduced = reduced
        self._model, modes = model, reduced.size - reduced.cylinder_modes
        self.V = np.ascontiguousarray(V[:, :modes])
        self._share = slice(*model.M.getOwnershipRange())
        self._residual: ResidualFlexibility | None = None
        if reduced.flexibility is not None:
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

    def positions(self, states: BodyStates) -> Array:
        """This rank's rows of q, (S, n_local), of states that are the same on every rank.

        For many states of a large model ask for `blocks`.
        """
        parts = [np.empty((0, len(self.V))), *self.blocks(states)]
        return np.concatenate(parts)

    def velocities(self, states: BodyStates) -> Array:
        """V p', this rank's rows (S, n_local): without the residual part's."""
        return np.asarray(states.v @ self.V.T)

    def blocks(self, states: BodyStates) -> Iterator[Array]:
        """Positions of at most `BLOCK` states at a time, one block after the other."""
        for k in range(0, len(states.t), BLOCK):
            yield self._block(states[k : k + BLOCK])

    def _block(self, states: BodyStates) -> Array:
        q = states.p @ self.V.T
        if self._residual is not None:
            q += self._residual.apply(self._loads(states)).T
        return np.asarray(q)

    def _loads(self, states: BodyStates) -> Array:
        """This rank's rows (n_local, S) of B f - C(s)^T z, in N."""
        model_rows = self._model.rows
        pressed = sp.csr_matrix((len(states.t), model_rows.size))
        for name, z, at in zip(states.rows, states.multipliers.T, states.s.T, strict=True):
            pressed = pressed + model_rows.rows[model_rows.names.index(name)].pressed(at, z)
        return np.asarray(self._inputs @ states.loads.T - pressed[:, self._share].T.toarray())
