r"""Inertia and damping of the residual part, as small tables in s.

The residual part x = R (B f - C(s)^T z) moves with the forces z at the rows.  What its inertia and damping do there is

.. math::
    -C R M \ddot x = A_0 \ddot z + 2 \dot s A_1 \dot z + (\ddot s A_1 + \dot s^2 A_2)\, z - E_0 \ddot f, \qquad
    -C R D \dot x = D_0 \dot z + \dot s D_1 z - F_0 \dot f

    A_0 = C R M R C^T, \quad A_1 = C R M R C'^T, \quad A_2 = C R M R C''^T, \quad E_0 = C R M R B, \qquad
    D_0 = C R D R C^T, \quad D_1 = C R D R C'^T, \quad F_0 = C R D R B

docs/moving_residual_flexibility.md, sections 6 and 11; for rows at rest A_0 is the mass term of Rubin: Improved
component-mode representation for structural dynamic analysis, AIAA Journal 13, 1975, pp. 995-1006.
"""

from __future__ import annotations

from dataclasses import dataclass

from scipy.interpolate import PPoly

from pmr.reduced.soundness import misfit

#: Tables by name, and whether their values are (m, i) instead of (m, m).
TABLES = {"A0": False, "A1": False, "A2": False, "E0": True, "D0": False, "D1": False, "F0": True}


@dataclass(frozen=True)
class Inertia:
    """Tables of the residual part's inertia and damping, for m rows and i inputs.

    Attributes
    ----------
    A0, A1, A2 : PPoly with values (m, m), m s^2/N, s^2/N, s^2/(m N)
        C R M R C^T and, with the second C replaced by its first and second derivative, A1 and A2.
    E0 : PPoly with values (m, i), m s^2/N
        C R M R B.
    D0, D1, F0 : PPoly
        As A0, A1 and E0 with the damping D in place of M; s instead of s^2 in the units.
    kept : bool
        Whether the equations of motion keep this inertia (`pmr.simulate.native.residual_inertia`); else it only serves
        error estimates.
    """

    A0: PPoly
    A1: PPoly
    A2: PPoly
    E0: PPoly
    D0: PPoly
    D1: PPoly
    F0: PPoly
    kept: bool = False

    def contradiction(self, m: int, i: int) -> str | None:
        """What is wrong with the shapes for m rows and i inputs, in words; None where all is sound."""
        shapes = {name: (m, i if of_inputs else m) for name, of_inputs in TABLES.items()}
        return misfit(self, shapes, "inertia.")
