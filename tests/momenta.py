"""Momentum and energy of a boom on a free base: integrals over its mass, from its moments at one time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.floating import BoomState, Extensions, FrameMotion, Moments
from pmr.simulation.free_base import FreeBase

Array = NDArray[np.float64]


def momentum(
    of: FreeBase,
    motion: FrameMotion,
    v: Array,
    extended: Extensions,
    q: Array,
    rate: Array,
    moments: Moments | None = None,
) -> Array:
    """Linear and angular momentum (6,) about O in the boom's axes, with O moving at v (3,) m/s."""
    at = BoomState(of.boom, motion, extended, q, rate, moments)
    linear = of.boom.mass * v + np.cross(motion.omega, at.s) + at.s_rate
    return np.append(linear, np.cross(at.s, v) + at.inertia @ motion.omega + at.h)


def kinetic(
    of: FreeBase,
    motion: FrameMotion,
    v: Array,
    extended: Extensions,
    q: Array,
    rate: Array,
    moments: Moments | None = None,
) -> float:
    """Kinetic energy in J, without q'^T M q' / 2 of the motion relative to the boom's axes."""
    at, omega = BoomState(of.boom, motion, extended, q, rate, moments), motion.omega
    along = sum(
        mass * X**2 / 2.0 + X * rates[0, 0]
        for mass, X, rates in zip(of.boom.masses, at.X_rate, at.mu_rate, strict=True)
    )
    linear = of.boom.mass * v / 2.0 + np.cross(omega, at.s) + at.s_rate
    return float(v @ linear + omega @ (at.inertia @ omega / 2.0 + at.h) + along)
