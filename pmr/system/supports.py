r"""Forces of a body on its rigid supports, linear in coordinates, rates, loads and contact forces.

The equations and symbols are those of `pmr.system.body_matrices`, with the accelerations from the equations of motion:

.. math::
    \lambda_f = (\Phi^T - P V^T) B f - (\Phi^T D V - P D_r) \dot p - (\Phi^T K V - P K_r) p
    - (C \Phi - C_r P^T)^T \lambda, \qquad P = \Phi^T M V M_r^{-1}

Terms with amplitudes c_k and the matrices G_k and V_k of their stiffness and damping add

.. math:: - \sum_k c_k (\Phi^T - P V^T) (G_k p + V_k \dot p)

So each of these forces is an output of coordinates, loads and multipliers, plus contributions of rates and terms.
Responses and the kernel evaluate the same matrices.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.interpolate import PPoly
from scipy.sparse.linalg import spsolve

from pmr.files.arrays import Array
from pmr.system.body import SlidingBody, Trajectory
from pmr.system.carriers import CarrierFlexibility, Flexibility
from pmr.system.polynomials import (
    add_tables,
    apply_table,
    common_breaks,
    refine_table,
    same_degree,
    select_columns,
    transpose,
)
from pmr.system.reduced_model import ReducedModel
from pmr.system.system import System
from pmr.system.terms import Term


@dataclass(frozen=True)
class SupportForces:
    """Forces of a body on its h rigid supports, in N or N m, by its n coordinates, their rates and i inputs."""

    body: SlidingBody
    names: tuple[str, ...]  # (h,)
    units: tuple[str, ...]  # (h,): N, or N m for a rotation
    inertia: Array  # P (h, n): shares of inertia forces; zero for coordinates that supports hold
    coordinates: Array  # (h, n): by unit coordinates
    rates: Array  # (h, n): by unit rates
    inputs: Array  # (h, i): by unit inputs

    @classmethod
    def from_body(cls, body: SlidingBody, on_path: bool, include: bool = True) -> SupportForces:
        """Forces of the supports in ``body.reactions``.

        The result has no forces, h = 0, if ``body.reactions`` is None or `include` is false.  `on_path` says whether
        all contacts of the body are at one path coordinate.  If it is false, the result has forces only if the body
        stores how its supports bear forces on its carriers (`Reactions.carried`).
        """
        reactions, n = body.reactions, body.size
        if reactions is not None and not on_path:
            include = include and body.carriers is not None and reactions.carried is not None
        if reactions is None or not include:
            none = np.zeros((0, n))
            return cls(body, (), (), none, none, none, np.zeros((0, len(body.input_names))))
        free, P = np.setdiff1d(np.arange(n), list(body.held.values())), np.zeros((len(reactions.names), n))
        M, right = body.M[np.ix_(free, free)], reactions.inertia[:, free].T
        shares = spsolve(sp.csc_matrix(M), right).reshape(right.shape) if sp.issparse(M) else np.linalg.solve(M, right)
        P[:, free] = shares.T
        coordinates, rates = P @ body.K - reactions.stiffness[:, :n], P @ body.D - reactions.damping[:, :n]
        return cls(body, reactions.names, reactions.units, P, coordinates, rates, reactions.inputs - P @ body.B)

    @cached_property
    def rows(self) -> PPoly:
        """Minus the forces (h, m) by unit multipliers of the m rows of a body on one path."""
        assert self.body.reactions is not None  # the body has supports
        return add_tables(self.body.reactions.rows, transpose(self.body.rows_on(self.inertia.T)), -1.0)

    @cached_property
    def carrier_forces(self) -> Array:
        """Minus the forces (K, h) by unit forces on the K carriers of the body."""
        reactions, carriers = self.body.reactions, self.body.carriers
        assert (
            reactions is not None and reactions.carried is not None and carriers is not None
        )  # `from_body` has checked it
        return np.asarray(reactions.carried - carriers.values @ self.inertia.T)

    def without_contacts(self, trajectory: Trajectory, loads: Array) -> Array:
        """Forces (T, h) by the coordinates and rates of a `trajectory` and by `loads` (T, i)."""
        by_motion = trajectory.q @ self.coordinates.T + trajectory.v @ self.rates.T
        return np.asarray(by_motion + loads @ self.inputs.T)

    def by_term(self, system: System, term: Term, name: str) -> dict[str, Array]:
        """Minus the forces (h, N) by unit coordinates (``stiffness``) and rates (``damping``) of a term's bodies.

        The term has an amplitude of 1, and its bodies have N coordinates; `name` is that of this body in the `system`.
        The result is empty if the term does not act on the body, or if the body has no supports.
        """
        work = term.supports.get(name)
        if work is None or not self.names:
            return {}
        before = sum(system.bodies[of].size for of in term.bodies[: term.bodies.index(name)])
        parts = {key: A[before : before + self.body.size] for key, A in term.arrays.items()}
        return {key: np.asarray(work - self.inertia @ part) for key, part in parts.items()}

    def on_one_path(self, trajectory: Trajectory, loads: Array) -> Array:
        """Forces (T, h) under `loads` (T, i), with the multipliers (T, m) of the `trajectory` at its places s (T,)."""
        pressed = apply_table(self.rows, trajectory.s, trajectory.multipliers)
        return self.without_contacts(trajectory, loads) - pressed


def with_support_forces(modal: ReducedModel, X: Array, rows: tuple[int, ...], supports: SupportForces) -> ReducedModel:
    """Return the body of `supports` in its modes, `modal`, with the forces on these supports as further outputs.

    The forces come after the body's own outputs.  The body's n coordinates are X z with the r modes X (n, r), and
    `rows` are the numbers of those of the body's rows that `modal` has.  Contributions of rates and terms are left out.
    `modal` is returned unchanged if there are no supports.
    """
    if not supports.names:
        return modal
    outputs = np.vstack([modal.outputs, supports.coordinates @ X])
    i, o = len(modal.input_names), len(modal.outputs)
    if modal.carriers is None:
        pressed = select_columns(supports.rows, list(rows))
        flexibility = modal.residual
        breaks = common_breaks([flexibility.outputs, pressed], modal.domain)
        c = same_degree(refine_table(flexibility.outputs, breaks).c, refine_table(pressed, breaks).c)
        tables, direct = PPoly(np.concatenate(c, axis=2), breaks), np.vstack([flexibility.direct, supports.inputs])
        with_pressed = Flexibility(flexibility.rows, flexibility.inputs, tables, direct, flexibility.energy)
        return replace(modal, outputs=outputs, flexibility=with_pressed)
    carriers = modal.carriers
    residual = carriers.flexibility or CarrierFlexibility.zero(len(carriers.values), i, o)
    residual = replace(
        residual,
        outputs=np.vstack([residual.outputs, supports.carrier_forces.T]),
        direct=np.vstack([residual.direct, supports.inputs]),
    )
    return replace(modal, outputs=outputs, carriers=replace(carriers, flexibility=residual))
