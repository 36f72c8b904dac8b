r"""Energy balance of a simulated motion: a rise that neither loads nor moving rows put in is an error.

.. math::
    \frac{d}{dt} \Big( \tfrac12 \dot q^T M \dot q + \tfrac12 q^T K q + \tfrac12 \lambda^T k^{-1} \lambda \Big)
    = f^T \frac{d}{dt} (B^T q) + \dot s\, \lambda^T C' q - \dot q^T D \dot q

(docs/moving_residual_flexibility.md, section 6, has it with the residual flexibility).  Damping, and generalized-alpha
with rho_inf < 1, only take energy, so that energy less work may fall but not rise.  Both works are taken from the means
of each step,

.. math::
    \Delta W = \bar f^T \Delta (B^T q)
    + \bar \lambda^T (\Delta C\, \bar q + \Delta H\, \bar f - \tfrac12 \Delta G\, \bar \lambda)

in which a multiplier that changes its sign with every step, the way in which rigid rows that move grow at index 3
(docs/time_integration.md), does no work: the energy that such a motion gains is a surplus.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.errors import GrowthError
from pmr.system.body import SlidingBody, Trajectory

Array = NDArray[np.float64]

#: Share of the largest energy that nothing put in, from which on nothing is compared with a motion.  Sound motions that
#: their steps resolve stay below 0.03; the share follows the error of the velocities, which grow first.
NOTABLE = 0.1
#: From here on the motion is the growth of an error, not a result.  Sound motions reach 0.4 with three steps a period.
GROWN = 0.9
#: Share of an energy that counts as zero: a motion of 1e-6 of that of a free body, as where a slider is under the load.
ROUND_OFF = 1e-12
#: Steps taken at once: memory stays small.
BLOCK = 4096


def load_potential(body: SlidingBody, trajectory: Trajectory, loads: Array) -> Array:
    """Potential energy (T,) in J of the loads (T, i): minus loads times displacements of their points.

    Without residual flexibility -q^T B f (Weyrer et al., equation for H(t)).
    """
    motion = np.asarray(trajectory.q @ body.B)
    if body.flexibility is not None:
        motion = motion + body.flexibility.input_motion(trajectory.s, trajectory.multipliers, loads)
    return -row_products(motion, loads)


def energy_surplus(stored: Array, work: Array, least: float = 0.0, since_start: bool = False) -> float:
    """Largest rise of energy less work over the largest energy: 0 to 1 and a little more; inf if it overflows.

    Parameters
    ----------
    stored : (T,) array, J
        Kinetic and strain energy.
    work : (T,) array, J
        Work done on the body since t = 0.
    least : float, J
        If the energy never exceeds this, it is round-off and the surplus is 0.
    since_start : bool
        Measure the rise from the first step instead of the lowest value before: contacts that open and close between
        steps lose energy and gain it back.
    """
    if not (np.isfinite(stored).all() and np.isfinite(work).all()):
        return np.inf
    excess, largest = stored - stored[0] - work, float(stored.max(initial=0.0))
    rise = excess if since_start else excess - np.minimum.accumulate(excess)
    return float(rise.max(initial=0.0)) / largest if largest > least else 0.0


def round_off(mobility: Array, loads: Array, step: float) -> float:
    """Energy in J that counts as zero, next to the kinetic energy that the loads (T, i) give a free body in one step.

    `mobility` is B^T diag(M)^-1 B, (i, i) in 1/kg; `step` is in s.
    """
    energy = np.einsum("ti,ij,tj->t", loads, mobility, loads).max(initial=0.0) * step**2 / 2.0
    return ROUND_OFF * float(energy)


def refuse_growth(surplus: float, simulator: str, moving: list[str]) -> None:
    """Raise GrowthError if `surplus` exceeds `GROWN`; `moving` names the rigid rows that move."""
    if surplus > GROWN:
        line = f"{simulator}: the motion grows without bound, {describe_surplus(surplus)}{describe_remedy(moving)}"
        raise GrowthError(line, tuple(moving))


def describe_surplus(surplus: float) -> str:
    """Text about a surplus of energy."""
    if surplus == np.inf:
        return "its energy overflows"
    return f"{100.0 * min(surplus, 1.0):.3g} % of its largest energy was put in by neither loads nor moving rows"


def describe_remedy(moving: list[str]) -> str:
    """Text about remedies against growth; `moving` names the rigid rows that move."""
    if not moving:
        return "; a smaller step or a smaller time.rho_inf helps"
    return (
        f"; the rigid row {', '.join(moving)} moves, and its multiplier (index 3) grows where time.rho_inf is near 1 "
        "or the path fast: a smaller time.rho_inf, pads that give way or a residual flexibility help, smaller steps "
        "need not"
    )


def row_blocks(size: int) -> Iterator[slice]:
    """Yield slices of a trajectory of `size` steps, of some thousand rows; each begins with the last row before it."""
    for first in range(0, max(1, size - 1), BLOCK):
        yield slice(first, min(first + BLOCK + 1, size))


def half_form(A: Array | sp.csr_matrix, x: Array) -> Array:
    """Values x^T A x / 2 (T,) of the rows of x (T, n)."""
    if not sp.issparse(A) and not np.any(A - np.diag(np.diagonal(A))):
        return np.asarray(x**2 @ np.diagonal(A)) / 2.0  # modal coordinates
    return row_products((A @ x.T).T, x) / 2.0


def row_products(a: Array, b: Array) -> Array:
    """Scalar products (T,) of the rows of two arrays (T, n)."""
    return np.asarray(np.einsum("tn,tn->t", a, b))


def step_means(values: Array) -> Array:
    """Mean (T - 1, ...) of the two ends of each step, of values (T, ...)."""
    return np.asarray(values[1:] + values[:-1]) / 2.0
