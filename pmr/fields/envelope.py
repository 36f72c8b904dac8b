r"""Section forces along beams as rows on a model's coordinates, and the envelope of histories along a body.

On the face of a section that looks along x, with its principal axes y and z,

.. math::
    N = \int \sigma\, dA, \quad M_y = \int z\, \sigma\, dA, \quad M_z = -\int y\, \sigma\, dA, \quad
    V_z = M_y', \quad V_y = -M_z'

From strains alone they are those of loads on nodes; `pmr.reduction.recover.section_forces` adds what acts between.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Share of the largest value of its unit up to which another one is round-off.
ROUND_OFF = 1e-9
#: Section forces and their units.
FORCES = {
    "normal force": "N",
    "shear force y": "N",
    "shear force z": "N",
    "torque": "N m",
    "bending moment y": "N m",
    "bending moment z": "N m",
}
#: Shear forces as derivatives of moments along x, with their sign.
SHEAR = {"shear force y": ("bending moment z", -1.0), "shear force z": ("bending moment y", 1.0)}


@dataclass(frozen=True)
class ForceRows:
    """Section forces at P places of a beam: `rows` (P, n) in N or N m per unit of a coordinate.

    Row by row `names` says which force, one of `FORCES`, and `x` (P,) m where.
    """

    rows: sp.csr_matrix
    names: tuple[str, ...]
    x: Array


def force_rows(x: Array, strains: Array, stiffness: dict[str, Array], coordinates: Indices, size: int) -> ForceRows:
    """Return rows of the section forces at both ends of E elements.

    Parameters
    ----------
    x : (E, 2) array, m
        Where the ends are.
    strains : (E, 2, v, d) array
        Of both ends, on the coordinates (E, d), which are numbers below `size`.
    stiffness : dict of str to (v,) or (E, v) array
        The normal force and moments of unit strains, of all elements or of each; shear forces follow.
    """
    each = (len(strains), strains.shape[2])
    forces = {name: np.einsum("eavd,ev->ead", strains, np.broadcast_to(unit, each)) for name, unit in stiffness.items()}
    for name, (moment, sign) in SHEAR.items():
        if moment in forces:
            slope = sign * (forces[moment][:, 1] - forces[moment][:, 0]) / np.diff(x)
            forces[name] = np.stack([slope, slope], axis=1)
    names = [name for name in FORCES if name in forces]
    entries = np.concatenate([forces[name].reshape(x.size, -1) for name in names])
    columns = np.tile(np.repeat(coordinates, 2, axis=0), (len(names), 1))
    ends = np.arange(0, entries.size + 1, entries.shape[1])
    rows = sp.csr_matrix((entries.ravel(), columns.ravel(), ends), (len(entries), size))
    return ForceRows(rows, tuple(np.repeat(names, x.size).tolist()), np.tile(x.ravel(), len(names)))


@dataclass(frozen=True)
class Envelope:
    """Smallest and largest values over time of c quantities at N places along a body, and when they are there."""

    names: tuple[str, ...]  # (c,)
    units: tuple[str, ...]  # (c,)
    x: Array  # (N,) m
    least: Array  # (c, N), in the quantities' units
    least_at: Array  # (c, N) s
    most: Array  # (c, N)
    most_at: Array  # (c, N) s

    def extremes(self) -> dict[str, dict[str, Any]]:
        """Extremes of each quantity by its name: ``unit``, ``min`` and ``max``, each with ``t`` in s and ``x`` in m."""
        extremes_of = {}
        for k, name in enumerate(self.names):
            low, high = int(self.least[k].argmin()), int(self.most[k].argmax())
            extremes_of[name] = {
                "unit": self.units[k],
                **_extreme("min", self.least[k, low], self.least_at[k, low], self.x[low]),
                **_extreme("max", self.most[k, high], self.most_at[k, high], self.x[high]),
            }
        return extremes_of


class Running:
    """The envelope of values that come a few times at a time: quantities by `names` (P,) at places `x` (P,) m.

    Each quantity has values at each of the places, one or several.
    """

    def __init__(self, names: tuple[str, ...], x: Array) -> None:
        self._names, self._x = np.array(names), x
        self._least, self._most = np.full(len(x), np.inf), np.full(len(x), -np.inf)
        self._least_at, self._most_at, self._start = np.zeros(len(x)), np.zeros(len(x)), np.inf

    def add(self, t: Array, values: Array) -> None:
        """Values (S, P) at the times t (S,) s."""
        self._start = min(self._start, float(t[0]))
        low, high = values.argmin(axis=0), values.argmax(axis=0)
        on = np.arange(values.shape[1])
        lower, higher = values[low, on] < self._least, values[high, on] > self._most
        self._least_at[lower], self._most_at[higher] = t[low[lower]], t[high[higher]]
        self._least, self._most = np.minimum(self._least, values[low, on]), np.maximum(self._most, values[high, on])

    def envelope(self, units: dict[str, str]) -> Envelope:
        """Return the smallest and largest value of each quantity at each place.

        What is round-off beside the largest value of the same unit is zero; what is nothing else is so from the start.
        """
        names, x = [name for name in units if name in self._names], np.unique(self._x)
        shape = (len(names), len(x))
        least, least_at, most, most_at = (np.full(shape, np.nan) for _ in range(4))
        for k, name in enumerate(names):
            of_quantity = np.flatnonzero(self._names == name)
            for i, place in enumerate(x):
                at_place = of_quantity[self._x[of_quantity] == place]
                low, high = at_place[self._least[at_place].argmin()], at_place[self._most[at_place].argmax()]
                least[k, i], least_at[k, i] = self._least[low], self._least_at[low]
                most[k, i], most_at[k, i] = self._most[high], self._most_at[high]
        for unit in set(units.values()):
            of_unit = np.array([units[name] == unit for name in names])
            largest = max(np.abs(extremes[of_unit]).max(initial=0.0) for extremes in (least, most))
            for values in (least, most):
                values[of_unit[:, None] & (np.abs(values) <= ROUND_OFF * largest)] = 0.0
        nothing = (least == 0.0) & (most == 0.0)
        least_at[nothing] = most_at[nothing] = self._start
        return Envelope(tuple(names), tuple(units[name] for name in names), x, least, least_at, most, most_at)


def _extreme(what: str, value: float, t: float, x: float) -> dict[str, float]:
    return {what: float(value), f"t_{what}": float(t), f"x_{what}": float(x)}
