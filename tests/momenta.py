"""Momentum and energy of a boom on a free base: integrals over its mass, from its mass matrix at one time."""

import numpy as np

from pmr.files.arrays import Array
from pmr.simulation.free_base import Extensions, FrameMotion, FreeBase, Moments, base_equations


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
    mass = base_equations(of.boom, motion, extended, q, rate, moments).mass
    return mass[:6] @ np.concatenate([v, motion.omega, rate, extended.rate])


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
    rates = np.concatenate([v, motion.omega, rate, extended.rate])
    return float(rates @ base_equations(of.boom, motion, extended, q, rate, moments).mass @ rates) / 2.0
