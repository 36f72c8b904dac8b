r"""A boom whose extensions s are coordinates of the user's: forces of contacts and loads on q and s.

Contacts that give way, with g = C q + H f and :math:`\lambda = F^{-1} g`, and cylinders of length l = s that lean by q
and against which a load along x pushes with f, store

.. math::
    V(q, s) = \tfrac12 g^T F^{-1} g + \frac{f}{2 l}\, q^T G q,

so that q feels :math:`-C^T \lambda - f G q / l`, and a path, with w = C' q + H' f - F' lambda,

.. math::
    F_s = -\lambda^T (C' q + H' f) + \tfrac12 \lambda^T F' \lambda + \frac{f}{2 l^2}\, q^T G q.

Where pads only push, lambda and F are those of the closed ones.  Rigid contacts are constraints C(s) q = 0 of q and s.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.exudyn.contacts import Contacts
from pmr.simulation.exudyn.equations import Equations
from pmr.simulation.exudyn.formulations import Start, nothing_beyond_matrices
from pmr.simulation.exudyn.inputs import Inputs
from pmr.simulation.exudyn.items import Steps, SystemItems, add_bodies
from pmr.simulation.exudyn.paths import Paths
from pmr.simulation.free_base import FreeBase
from pmr.system.changing_rows import ChangingRows

Array = NDArray[np.float64]


def add_extended(mbs: Any, equations: Equations, inputs: Inputs, start: Start) -> SystemItems:
    """Nodes and items of the bodies alone, each by itself: what joins them is the base's to add."""
    steps, known = Steps(held=bool(Contacts(equations, inputs).rigid.any())), inputs.loads(0.0)
    jacobian = nothing_beyond_matrices(equations, steps)
    items = add_bodies(mbs, equations, start, forceVector=equations.B @ np.array(known), jacobianUserFunction=jacobian)

    def update(mbs: Any, t: float) -> bool:
        nonlocal known
        inputs.begin(t)
        if (loads := inputs.loads(t)) != known:
            known = loads
            mbs.SetObjectParameter(items.oSystem, "forceVector", equations.B @ np.array(loads))
        return True

    return steps.attach_update(mbs, items, update)


class Extending:
    """Forces, stiffness and rigid rows between coordinates q (n,) and extensions s (S,) m."""

    def __init__(
        self, equations: Equations, contacts: Contacts, boom: FreeBase, paths: Paths, along: ChangingRows
    ) -> None:
        self._contacts, self._along, self.rigid = contacts, along, np.flatnonzero(contacts.rigid)
        self._numbers = np.flatnonzero(paths.along.any(axis=1))
        self._leaning = [
            (number, k, G)
            for number, name in enumerate(equations.system.input_names)
            for k, G in boom.shortened_by(name)
            if k is not None and k in self._numbers
        ]

    def at(self, s: Array, q: Array, f: Array) -> tuple[Array, Array]:
        """Forces (n + S,) and their stiffness (n + S, n + S) at extensions s (S,) m, under loads f (i,) N."""
        n, S, numbers = len(q), len(s), self._numbers
        near = self._along.at(s)
        now, slopes = self._contacts.giving(near.rows), self._contacts.giving(near.slopes)
        C, F, H = (A[numbers] for A in (slopes.C, slopes.F, slopes.H))
        forces = self._contacts.pressed(now, now.C @ q + now.H @ f)
        gaps, bent = C @ q + H @ f, F @ forces  # (e, m)
        total, K = np.zeros(n + S), np.zeros((n + S, n + S))
        total[:n], total[n + numbers] = -now.C.T @ forces, -gaps @ forces + bent @ forces / 2.0
        closed = self._contacts.closed
        w = np.hstack([now.C, np.zeros((len(forces), S))])
        w[:, n + numbers] = (gaps - bent).T
        w = w[closed]
        K += w.T @ np.linalg.solve(now.F[np.ix_(closed, closed)], w)
        K[:n, n + numbers] += (forces @ C).T
        K[n + numbers, :n] += forces @ C
        for load, k, G in self._leaning:
            push, l, Gq = f[load], s[k], G @ q
            total[:n] -= push / l * Gq
            total[n + k] += push / l**2 * (q @ Gq) / 2.0
            K[:n, :n] += push / l * G
            K[:n, n + k] -= push / l**2 * Gq
            K[n + k, :n] -= push / l**2 * Gq
            K[n + k, n + k] += push / l**3 * (q @ Gq)
        return total, K

    def gap(self, s: Array, q: Array) -> Array:
        """Gaps C(s) q (m,) m of rigid contacts."""
        return np.asarray(self._along.at(s).rows.C[self.rigid] @ q)

    def moved(self, s: Array, q: Array) -> Array:
        """Derivative (m, n + S) of the gaps of rigid contacts by q and s."""
        near, numbers = self._along.at(s), self._numbers
        derivative = np.hstack([near.rows.C[self.rigid], np.zeros((len(self.rigid), len(s)))])
        derivative[:, len(q) + numbers] = (near.slopes.C[numbers][:, self.rigid] @ q).T
        return derivative
