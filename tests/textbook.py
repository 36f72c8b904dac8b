"""Beam of the paper from the textbook, in NumPy alone: an oracle that shares no code with the package.

Element matrices after Cook, Malkus, Plesha: Concepts and Applications of Finite Element Analysis, 3rd ed., 1989,
sections 4.2 and 13.3.
"""

import numpy as np

from pmr.files.arrays import Array

LENGTH, EI, EA, RHO_A = 5.0, 5.0e4, 2.0e7, 78.0  # m, N m^2, N, kg/m

#: omega_1..3 in rad/s of the beam pinned at 0, supported at s and free at L, from the characteristic equation.
CLOSED_FORM = {
    1.25: (5.2589210642, 34.452093348, 97.757877962),
    2.50: (9.1866858678, 47.190641488, 79.760935162),
    3.75: (15.566575163, 38.427517955, 84.014587905),
    5.00: (9.9953369145, 39.981347658, 89.958032231),
}

#: Static tip deflection in m under -50 N at the tip.
TIP_DEFLECTION = {1.25: -0.0234375, 2.5: -0.0104166666666667, 3.75: -0.00260416666666667}


def beam_matrices(nodes: Array, EI: float = EI, EA: float = EA, rho_A: float = RHO_A) -> tuple[Array, Array]:
    """Consistent mass and stiffness (3 N, 3 N) of a beam with N nodes; coordinates node by node: u, w, theta."""
    n = 3 * len(nodes)
    M, K = np.zeros((n, n)), np.zeros((n, n))
    for e, h in enumerate(np.diff(nodes)):
        bar, bend = 3 * e + np.array([0, 3]), 3 * e + np.array([1, 2, 4, 5])
        M[np.ix_(bar, bar)] += rho_A * h / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
        K[np.ix_(bar, bar)] += EA / h * np.array([[1.0, -1.0], [-1.0, 1.0]])
        scale = np.outer([1.0, h, 1.0, h], [1.0, h, 1.0, h])  # rotations carry the element length
        M[np.ix_(bend, bend)] += (
            rho_A
            * h
            / 420.0
            * scale
            * np.array([[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]])
        )
        K[np.ix_(bend, bend)] += (
            EI / h**3 * scale * np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]])
        )
    return M, K


def relative(found: Array, expected: Array) -> float:
    """Largest difference between two arrays, relative to the largest entry of the expected one."""
    return float(np.abs(np.asarray(found) - expected).max() / np.abs(expected).max())


def subspace_distance(A: Array, B: Array, M: Array) -> float:
    """Sine of the largest angle between the ranges of A and B (n, k), both orthonormal in M."""
    return float(np.linalg.norm(B - A @ (A.T @ M @ B), 2) / np.linalg.norm(B, 2))


def static_tip_deflection(force: float, s: float, length: float, bending_stiffness: float) -> float:
    """Tip deflection F (L - s)^2 L / (3 EI) in m of a beam pinned at 0 and supported at s, under a tip force F in N.

    It is an overhang that rests on a simply supported span (Timoshenko 1955, section 37).
    """
    return force * (length - s) ** 2 * length / (3.0 * bending_stiffness)
