r"""Bending in one plane, by cubic Hermite elements, with shear or without.

.. math::
    k = \int EI \Bigl( w'' \delta w'' - \frac{h^2}{12} \frac{\Phi}{1 + \Phi} w''' \delta w''' \Bigr) dx, \qquad
    \Phi = \frac{12 EI}{\kappa G A h^2}

Without shear Phi = 0 and the last term is left out: Euler and Bernoulli's beam.  With shear, nodal slopes are rotations
psi of the section.  The shear strain of an element, :math:`\gamma = -\frac{h^2}{12} \frac{\Phi}{1 + \Phi} w'''`,
follows from its own minimum of energy, which gives the term above and the interpolation
:math:`w + \gamma h (X - 3 X^2 + 2 X^3)`, :math:`\psi = w' - \gamma`: nodal values are exact in statics, frequencies
converge with order 2 (4 without shear).  Przemieniecki: Theory of Matrix Structural Analysis, 1968, section 5.6
(stiffness), 11.3 (mass).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: N2, N3 / h, N5, N6 / h as polynomials in xi in [0, 1], highest power first.
HERMITE = np.array([[2.0, -3.0, 0.0, 1.0], [1.0, -2.0, 1.0, 0.0], [-2.0, 3.0, 0.0, 0.0], [1.0, -1.0, 0.0, 0.0]])
#: Their derivatives.
FIRST, THIRD = (np.array([np.polyder(p, k) for p in HERMITE]) for k in (1, 3))


@dataclass(frozen=True)
class Deflection:
    """Bending in one plane, in UFL: what nodal values interpolate, the shear strain (None: rigid in shear), and both.

    `second` in 1/m and `third` in 1/m^2 are derivatives of the interpolated cubic, `value` is in m, `rotation` of the
    section in rad, `curvature`, its derivative, in 1/m.
    """

    second: Any
    third: Any
    shear: Any
    value: Any
    rotation: Any
    curvature: Any


@dataclass(frozen=True)
class Bending:
    """Bending stiffness EI in N m^2 and shear stiffness kappa G A in N (None: rigid in shear) of K sections."""

    stiffness: Array  # (K,)
    shear_stiffness: Array | None = None  # (K,)

    def interpolated(self, h: Array, X: Array, number: Indices) -> tuple[Array, Array]:
        """Weights (4, q) of w_1, psi_1, w_2, psi_2 in the deflection at X h and in the rotation of the section there.

        In q elements of lengths h (m) with these sections.
        """
        scale = np.stack([np.ones_like(h), h, np.ones_like(h), h])
        value, slope = _evaluate(HERMITE, X) * scale, _evaluate(FIRST, X) * scale / h
        if self.shear_stiffness is None:
            return value, slope
        third = _evaluate(THIRD, X) * scale / h**3
        gamma = -(h**2) / 12.0 / (1.0 + (self.shear_stiffness / (12.0 * self.stiffness))[number] * h**2) * third
        return value + gamma * h * (X - 3 * X**2 + 2 * X**3), slope + gamma * (-6 * X + 6 * X**2)

    def deflection(self, w: Any, h: Any, X: Any, of_elements: Callable[[Array], Any]) -> Deflection:
        """In UFL, from the cubic w in elements of lengths h at X h, with what makes properties of sections UFL."""
        first = w.dx(0)  # each looks through all that it is the derivative of
        second = first.dx(0)
        third = second.dx(0)
        if self.shear_stiffness is None:
            return Deflection(second, third, None, w, first, second)
        EI, kGA = of_elements(self.stiffness), of_elements(self.shear_stiffness)
        bulge = h * (X - 3 * X**2 + 2 * X**3)
        gamma, steeper = -(h**2) / 12 / (1 + kGA * h**2 / (12 * EI)) * third, bulge.dx(0)
        rotation, curvature = first + gamma * (steeper - 1), second + gamma * steeper.dx(0)
        return Deflection(second, third, gamma, w + gamma * bulge, rotation, curvature)

    def energy(self, of: Deflection, by: Deflection, of_elements: Callable[[Array], Any]) -> Any:
        """The integrand of k in UFL."""
        EI = of_elements(self.stiffness)
        integrand = EI * of.second * by.second
        return integrand if of.shear is None else integrand + EI * of.shear * by.third


def _evaluate(polynomials: Array, X: Array) -> Array:
    """Values (p, q) of polynomials (p, d), highest power first, at X (q,)."""
    values = np.zeros((len(polynomials), len(X)))
    for c in polynomials.T:
        values = values * X + c[:, None]
    return values
