"""Pinched cylinder on rigid diaphragms by double Fourier series, in NumPy alone.

First-order shear deformation, Sanders' strains: Reddy, Mechanics of Laminated Composite Plates and Shells, 2nd ed.,
2004, sections 8.2 and 8.3.
"""

import numpy as np


def pinched(kappa: float, patch: tuple[float, float], harmonics: int, E=3e6, nu=0.3, t=3.0, R=300.0, L=600.0) -> float:
    """Mean radial displacement in m under two opposite unit loads, spread over patches (along x, around) in m.

    A patch of 0 is a point, under which a shear-flexible shell's series grows with the logarithm of `harmonics`.
    `kappa` is the shear correction factor, t the thickness, R the radius and L the length in m.
    """
    A, D, G = E * t / (1 - nu**2), E * t**3 / 12 / (1 - nu**2), E / 2 / (1 + nu)
    C = np.zeros((8, 8))
    C[:2, :2] = A * np.array([[1, nu], [nu, 1]])
    C[3:5, 3:5] = D * np.array([[1, nu], [nu, 1]])
    C[2, 2], C[5, 5], C[6, 6], C[7, 7] = G * t, G * t**3 / 12, kappa * G * t, kappa * G * t
    waves, total = np.arange(0, harmonics, 2), 0.0
    n = waves / R
    for m in range(1, harmonics, 2):
        a = m * np.pi / L
        B = np.zeros((len(n), 8, 5))  # of u, v, w, beta_x, beta_theta
        B[:, 0, 0], B[:, 1, 1], B[:, 1, 2], B[:, 2, 0], B[:, 2, 1] = -a, n, 1 / R, -n, a
        B[:, 3, 3], B[:, 4, 4], B[:, 5, 3], B[:, 5, 4] = -a, n, -n, a
        B[:, 5, 0], B[:, 5, 1] = n / (2 * R), a / (2 * R)
        B[:, 6, 2], B[:, 6, 3], B[:, 7, 2], B[:, 7, 1], B[:, 7, 4] = a, 1, -n, -1 / R, 1
        K = np.einsum("nai,ab,nbj->nij", B, C, B) * (L / 2 * np.pi * R * np.where(waves == 0, 2, 1))[:, None, None]
        K[0, [1, 4], [1, 4]] += 1.0  # no motion around the axis without a wave around it
        spread = np.sinc(m * patch[0] / L / 2) * np.sinc(waves * patch[1] / R / np.pi / 2)
        load = np.zeros((len(n), 5, 1))
        load[:, 2, 0] = 2.0 * np.sin(m * np.pi / 2) * spread
        total += np.sum(np.linalg.solve(K, load)[:, 2, 0] * spread) * np.sin(m * np.pi / 2)
    return float(total)
