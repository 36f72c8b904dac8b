"""Compliant rows as springs that travel with the slider: an oracle from the tables of a body."""

import numpy as np
import scipy.sparse as sp

from pmr.files.arrays import Array
from pmr.system.body import SlidingBody, compliant_rows
from pmr.system.carriers import Flexibility
from pmr.system.polynomials import apply_table, evaluate
from pmr.system.states import check_determined


class CompliantRows:
    """Compliant rows of a body, eliminated by lambda = F^-1 (C q + H f) with F = G + 1/k.

    The body has n coordinates, i inputs and m' compliant rows, whose numbers are `numbers`; T is a number of positions
    s (T,) in m.  G and H are the tables of the residual flexibility, or 0, and k the stiffness of each row.
    """

    def __init__(self, body: SlidingBody) -> None:
        self._body, self.numbers = body, compliant_rows(body)

    def flexibility(self, s: Array) -> Array:
        """Flexibility F(s) (T, m', m') in m/N; raises the package's error if it is singular."""
        F = np.tile(np.diag(self._body.row_compliance), (len(s), 1, 1))
        if self._body.flexibility is not None:
            F = F + evaluate(self._body.flexibility.rows, s)
        F, names = F[:, self.numbers][:, :, self.numbers], [self._body.row_names[k] for k in self.numbers]
        check_determined(F, names, lambda k: f"slider at {s[k]:g} m")
        return F

    def inputs(self, s: Array) -> Array:
        """Table H(s) (T, m', i) in m/N."""
        if self._body.flexibility is None:
            return np.zeros((len(s), len(self.numbers), len(self._body.input_names)))
        return evaluate(self._body.flexibility.inputs, s)[:, self.numbers]

    def system(self, s: Array) -> Array:
        """Matrices K + C^T F^-1 C and B - C^T F^-1 H beside each other, (T, n, n + i), of a dense body."""
        C = np.array([sp.csr_matrix(self._body.C(at)).toarray() for at in s])[:, self.numbers]
        answers = np.linalg.solve(self.flexibility(s), np.concatenate([C, -self.inputs(s)], axis=2))
        return np.hstack([self._body.K, self._body.B]) + C.transpose(0, 2, 1) @ answers

    def multipliers(self, s: Array, q: Array, loads: Array) -> Array:
        """Multipliers F^-1 (C q + H f) (T, m') in N, from s (T,) in m, q (T, n) and loads f (T, i)."""
        motion = self._body.apply_rows(s, q)[:, self.numbers] + np.einsum("tmi,ti->tm", self.inputs(s), loads)
        return np.asarray(np.linalg.solve(self.flexibility(s), motion[:, :, None])[:, :, 0])


def displacement(flexibility: Flexibility, s: Array, multipliers: Array, loads: Array) -> Array:
    """Displacement W f - X(s) lambda (T, o) in m that residual flexibility adds to the outputs.

    W (o, i) and X(s) (o, m) are its tables, f (T, i) the loads and lambda (T, m) the multipliers.
    """
    return np.asarray(loads @ flexibility.direct.T - apply_table(flexibility.outputs, s, multipliers))
