r"""How contacts give way by themselves: pads and supports, and cylinders and ropes, which bear the forces of others.

What gives way at contact k bears its own force and shares of others', :math:`T = S \lambda` (`pmr.scene.ropes`), and by
virtual work moves each of these contacts by its share.  A rope whose length under tension grows with a path is the
softer the farther this leads:

.. math::
    C q + H f = (G + A)\, \lambda, \qquad A(s) = S^T \operatorname{diag}\bigl(a + a' s\bigr)\, S, \qquad
    a + a' s = \frac{l(s)}{z\, EA}

A stands beside the residual flexibility G in all equations, so that what ropes store is
:math:`\tfrac12 \lambda^T A \lambda`, and a drum that lets rope out under tension does the work
:math:`-\tfrac12 \lambda^T \dot A \lambda` on the boom.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.system.contacts import Contact, refusal

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Compliance:
    """A of m contacts, linear in Q paths."""

    constant: Array  # (m, m) m/N: where all paths are at 0
    paths: tuple[str, ...]  # (Q,)
    slopes: Array  # (Q, m, m) 1/N

    @classmethod
    def of(cls, contacts: Sequence[Contact]) -> Compliance:
        """Compliance of a system's contacts; an InputError is raised where one bears others that there are none of."""
        names = [contact.name for contact in contacts]
        S = np.eye(len(contacts))
        for k, contact in enumerate(contacts):
            for name, share in contact.bears:
                if name not in names:
                    raise refusal(contact.name, "bears", name, f"{', '.join(names)} are allowed")
                S[k, names.index(name)] += share
        compliances, grows = (
            np.array([getattr(contact, what) for contact in contacts]) for what in ("compliance", "lengthening")
        )
        changing = np.flatnonzero(grows)
        paths = tuple(dict.fromkeys(str(contacts[k].path) for k in changing))
        slopes = np.zeros((len(paths), *S.shape))
        for k in changing:
            slopes[paths.index(str(contacts[k].path))] += grows[k] * np.outer(S[k], S[k])
        return cls(S.T @ (compliances[:, None] * S), paths, slopes)

    @property
    def rigid(self) -> NDArray[np.bool_]:
        """(m,): contacts that do not give way by themselves."""
        return np.diagonal(self.constant) == 0.0

    def at(self, s: Array) -> Array:
        """(..., m, m) m/N with these paths at s (..., Q) m."""
        return np.asarray(self.constant + np.tensordot(s, self.slopes, 1))

    def moved(self, forces: Array, s: Array) -> Array:
        """A lambda (T, m) m of forces (T, m) N, likewise."""
        return np.asarray(forces @ self.constant + np.einsum("tm,qmn,tq->tn", forces, self.slopes, s))

    def work(self, forces: Array, s: Array) -> Array:
        """Work of drums on the boom in each step, (T - 1,) J, likewise: from the means of the forces."""
        mean = (forces[1:] + forces[:-1]) / 2.0
        return np.asarray(-np.einsum("tm,qmn,tn,tq->t", mean, self.slopes, mean, np.diff(s, axis=0)) / 2.0)
