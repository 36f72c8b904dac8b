r"""Energy balance of a simulated motion: a rise that neither loads nor moving rows put in is an error.

.. math::
    \frac{d}{dt} \Big( \tfrac12 \dot q^T M \dot q + \tfrac12 q^T K q + \tfrac12 \lambda^T k^{-1} \lambda \Big)
    = f^T \frac{d}{dt} (B^T q) + \dot s\, \lambda^T C' q - \dot q^T D \dot q

with coordinates q, matrices M, D and K, loads f on inputs B, contact forces :math:`\lambda`, stiffness k and rows C of
the contacts, whose derivative by the path s is C' (docs/moving_residual_flexibility.md, section 6, has the balance with
the residual flexibility).  Damping, and generalized-alpha with rho_inf < 1, only take energy, so that energy minus work
may fall but not rise.  The works of loads and moving rows in a step follow from the mean values over the step (marked
by a bar) and the changes (:math:`\Delta`) of loads f, contact forces, rows C, their displacements H by loads and their
flexibility G:

.. math::
    \Delta W = \bar f^T \Delta (B^T q)
    + \bar \lambda^T (\Delta C\, \bar q + \Delta H\, \bar f - \tfrac12 \Delta G\, \bar \lambda)

A contact force that changes its sign with every step does no work in this sum.  The forces of rigid rows that move grow
in this way at index 3 (docs/time_integration.md); the energy that such a motion gains is a surplus.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy.sparse as sp

from pmr.errors import GrowthError
from pmr.files.arrays import Array
from pmr.system.body import SlidingBody, Trajectory

#: Surplus over the largest energy from which on a motion is not compared with others.  Sound motions that
#: their steps resolve stay below 0.03; the share follows the error of the velocities, which grow first.
NOTABLE = 0.1
#: Surplus from which on a motion is a growing error, no result.  Sound motions reach 0.4 with three steps a period.
GROWN = 0.9
#: Share of an energy that counts as zero: for motions 1e-6 times as large as a free body's, as with a slider at a load.
ROUND_OFF = 1e-12
#: Steps that are evaluated at once, so that memory stays small.
BLOCK = 4096


def load_potential(body: SlidingBody, trajectory: Trajectory, loads: Array) -> Array:
    """Potential energy (T,) in J of `loads` (T, i): minus the loads times the displacements of their points.

    `trajectory` has the body's coordinates and contact forces.  Without residual flexibility the energy is -q^T B f,
    with coordinates q and input matrix B (Weyrer et al., equation for H(t)).
    """
    motion = np.asarray(trajectory.q @ body.B)
    if body.flexibility is not None:
        motion = motion + body.flexibility.input_motion(trajectory.s, trajectory.multipliers, loads)
    return -row_products(motion, loads)


def energy_surplus(stored: Array, work: Array, least: float = 0.0, since_start: bool = False) -> float:
    """Largest rise of energy minus work, divided by the largest energy.

    The result is from 0 to slightly more than 1, and infinite if the energy overflows.

    Parameters
    ----------
    stored : (T,) array, J
        Kinetic and strain energy.
    work : (T,) array, J
        Work done on the body since t = 0.
    least : float, J
        If the energy never exceeds this, it is round-off and the surplus is 0.
    since_start : bool
        Whether the rise is measured from the first step instead of from the lowest value before: contacts that open and
        close between steps lose energy and gain it back.
    """
    if not (np.isfinite(stored).all() and np.isfinite(work).all()):
        return np.inf
    excess, largest = stored - stored[0] - work, float(stored.max(initial=0.0))
    rise = excess if since_start else excess - np.minimum.accumulate(excess)
    return float(rise.max(initial=0.0)) / largest if largest > least else 0.0


def round_off(mobility: Array, loads: Array, step: float) -> float:
    """Energy in J that counts as zero: a share of the kinetic energy that `loads` (T, i) give a free body in a step.

    `mobility` is B^T diag(M)^-1 B, (i, i) in 1/kg; `step` is in s.
    """
    energy = np.einsum("ti,ti->t", loads @ mobility, loads).max(initial=0.0) * step**2 / 2.0
    return ROUND_OFF * float(energy)


def refuse_growth(surplus: float, simulator: str, moving: list[str]) -> None:
    """Raise GrowthError if `surplus` exceeds `GROWN`, with the name of the simulator.

    `moving` holds the names of the rigid rows that move.
    """
    if surplus > GROWN:
        line = f"{simulator}: the motion grows without bound, {describe_surplus(surplus)}{describe_remedy(moving)}"
        raise GrowthError(line, tuple(moving))


def describe_surplus(surplus: float) -> str:
    """Sentence that states a surplus of energy, in per cent of the largest energy."""
    if surplus == np.inf:
        return "its energy overflows"
    return f"{100.0 * min(surplus, 1.0):.3g} % of its largest energy was put in by neither loads nor moving rows"


def describe_remedy(moving: list[str]) -> str:
    """Text with remedies against a growing motion; `moving` holds the names of the rigid rows that move."""
    if not moving:
        return "; a smaller step or a smaller time.rho_inf helps"
    return (
        f"; the rigid row {', '.join(moving)} moves, and its multiplier (index 3) grows where time.rho_inf is near 1 "
        "or the path fast: a smaller time.rho_inf, pads that give way or a residual flexibility help, smaller steps "
        "need not"
    )


def row_blocks(size: int) -> Iterator[slice]:
    """Yield slices of some thousand of `size` steps; each slice begins with the last step of the slice before."""
    for first in range(0, max(1, size - 1), BLOCK):
        yield slice(first, min(first + BLOCK + 1, size))


def half_form(A: Array | sp.csr_matrix, x: Array) -> Array:
    """Values x^T A x / 2 (T,), with A (n, n), for each row of x (T, n)."""
    if not sp.issparse(A) and not np.any(A - np.diag(np.diagonal(A))):
        return np.asarray(x**2 @ np.diagonal(A)) / 2.0  # A is diagonal in modal coordinates
    return row_products((A @ x.T).T, x) / 2.0


def row_products(a: Array, b: Array) -> Array:
    """Scalar products (T,) of the rows of a and b (T, n)."""
    return np.asarray(np.einsum("tn,tn->t", a, b))


def step_means(values: Array) -> Array:
    """Means (T - 1, ...) over the two ends of each step, of values (T, ...) at the ends of steps."""
    return np.asarray(values[1:] + values[:-1]) / 2.0
