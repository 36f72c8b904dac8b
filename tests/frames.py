"""Straight beam in space from the textbook, in NumPy alone: element matrices, added up.

Stiffness after Przemieniecki: Theory of Matrix Structural Analysis, 1968, section 5.6; mass from the shape functions of
the same element by Gauss quadrature, section 11.3.
"""

import numpy as np

GAUSS = np.polynomial.legendre.leggauss(5)


def bending(EI: float, kGA: float | None, rhoA: float, rhoI: float, h: float) -> tuple[np.ndarray, np.ndarray]:
    """Mass and stiffness (4, 4) of an element of length h for w_1, theta_1, w_2, theta_2; kGA is None without shear."""
    Phi = 0.0 if kGA is None else 12 * EI / (kGA * h**2)
    K = EI / (h**3 * (1 + Phi)) * np.array(
        [
            [12, 6 * h, -12, 6 * h],
            [6 * h, (4 + Phi) * h**2, -6 * h, (2 - Phi) * h**2],
            [-12, -6 * h, 12, -6 * h],
            [6 * h, (2 - Phi) * h**2, -6 * h, (4 + Phi) * h**2],
        ]
    )  # fmt: skip
    M = np.zeros((4, 4))
    for point, weight in zip(*GAUSS, strict=True):
        x = (point + 1) / 2
        N = np.array([
            1 - 3 * x**2 + 2 * x**3 + Phi * (1 - x),
            h * (x - 2 * x**2 + x**3 + Phi / 2 * (x - x**2)),
            3 * x**2 - 2 * x**3 + Phi * x,
            h * (-(x**2) + x**3 - Phi / 2 * (x - x**2)),
        ]) / (1 + Phi)  # fmt: skip
        psi = np.array([
            6 / h * (x**2 - x),
            1 - 4 * x + 3 * x**2 + Phi * (1 - x),
            6 / h * (x - x**2),
            3 * x**2 - 2 * x + Phi * x,
        ]) / (1 + Phi)  # fmt: skip
        M += weight * h / 2 * (rhoA * np.outer(N, N) + (0.0 if kGA is None else rhoI) * np.outer(psi, psi))
    return M, K


def frame_matrices(stations, section, material, shear: bool) -> tuple[np.ndarray, np.ndarray]:
    """Mass and stiffness (6 N, 6 N) of a chain of elements between N stations in m.

    Coordinates are ordered node by node: displacements along, then rotations about x, y, z.
    """
    E, rho, G = material.young, material.density, material.young / (2 * (1 + material.poisson))
    n = 6 * len(stations)
    M, K = np.zeros((n, n)), np.zeros((n, n))
    for e, h in enumerate(np.diff(stations)):
        m, k = np.zeros((12, 12)), np.zeros((12, 12))
        for dofs, stiff, mass in (
            ([0, 6], E * section.area, rho * section.area),
            ([3, 9], G * section.torsion_constant, rho * (section.second_moment_y + section.second_moment_z)),
        ):
            k[np.ix_(dofs, dofs)] += stiff / h * np.array([[1, -1], [-1, 1]])
            m[np.ix_(dofs, dofs)] += mass * h / 6 * np.array([[2, 1], [1, 2]])
        for dofs, signs, second_moment, shear_area in (
            ([1, 5, 7, 11], [1, 1, 1, 1], section.second_moment_z, section.shear_area_y),
            ([2, 4, 8, 10], [1, -1, 1, -1], section.second_moment_y, section.shear_area_z),
        ):
            kGA = G * shear_area if shear else None
            mass, stiff = bending(E * second_moment, kGA, rho * section.area, rho * second_moment, h)
            k[np.ix_(dofs, dofs)] += np.outer(signs, signs) * stiff
            m[np.ix_(dofs, dofs)] += np.outer(signs, signs) * mass
        at = slice(6 * e, 6 * e + 12)
        M[at, at] += m
        K[at, at] += k
    return M, K
