r"""What Exudyn is given of a system: the matrices of all coordinates, and the contacts' rows wherever the paths lead.

.. math::
    M \ddot q + D \dot q + K q + C^T \lambda = B f, \qquad C q + H f - F \lambda = 0, \qquad
    y = O q + W f - X \lambda
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.scene.simulators import Needs
from pmr.simulation.excitation import Excitation, places
from pmr.simulation.needs import needs_of
from pmr.simulation.start import InitialState, consistent_start
from pmr.system.assembly import Assembly
from pmr.system.body import SlidingBody
from pmr.system.compliant_rows import CompliantRows
from pmr.system.contact_rows import ContactRows
from pmr.system.contacts import ALONE
from pmr.system.system import System

Array = NDArray[np.float64]


class Equations:
    """Equations of a system on the n coordinates that its supports leave free, with its sides at x m."""

    def __init__(self, system: System) -> None:
        self.system, self.assembly = system, Assembly(system)
        self.sparse = all(sp.issparse(body.K) for body in system.bodies.values())
        a = self.assembly
        self.M, self.D, self.K = (A if self.sparse else A.toarray() for A in (a.M, a.D, a.K))
        # numbers of the coordinates without inertia, and their damping D (q,), which are left to an object of their own
        self.quasi_static = a.quasi_static
        self.quasi_static_damping = np.asarray(a.D.diagonal())[a.quasi_static]
        for A in (self.M, self.D) if len(a.quasi_static) else ():
            A[a.quasi_static], A[:, a.quasi_static] = 0.0, 0.0
        self.B, self.outputs, self.size = a.B.toarray(), a.outputs, a.size
        self.alone: SlidingBody | None = system.bodies.get(ALONE)
        if self.alone is not None:
            self.alone.ensure_whole("model")
        self._compliant = CompliantRows(self.alone) if self.alone is not None and not self.sparse else None
        self._places, self._rows = b"", ContactRows(*(np.empty(0),) * 4)  # asked for last
        self._travelling = [k for k, side in enumerate(system.sides) if side.place.path is not None]

    def visited(self, excitation: Excitation) -> Array:
        """X (T, sides) at the steps of an excitation; an InputError is raised where a path leaves a row."""
        if self.alone is not None:
            excitation.along(self.alone.domain)  # which knows the scene's key
        return places(self.system, excitation)

    def at(self, s: Mapping[str, float]) -> Array:
        """X (1, sides) where the paths are at s m; errors as for `visited`."""
        return self.system.coordinates(s)[None]

    def rows(self, x: Array) -> ContactRows:
        """All contacts at places x (T, sides) m.

        A SimulationError is raised where a body alone slides over a support, where its flexibility can't be inverted.
        """
        if self._compliant is not None and self._travelling:
            self._compliant.flexibility(x[:, self._travelling[0]])
        if (key := x.tobytes()) != self._places:
            self._places, self._rows = key, self.assembly.along(x)
        return self._rows

    def whole(self, name: str, values: Array) -> Array:
        """Coordinates (T, n') of one body out of all (T, n), those that supports hold among them."""
        coordinates = np.zeros((len(values), self.system.bodies[name].size))
        coordinates[:, self.assembly.free[name]] = values[:, self.assembly.coordinates[name]]
        return coordinates

    def start(
        self, s: Mapping[str, float], rates: Mapping[str, float], initial: Mapping[str, InitialState]
    ) -> dict[str, InitialState]:
        """A consistent one of each body, on what supports leave free; errors as for `consistent_start`."""
        x, places = self.at(s)[0], [side.place for side in self.system.sides]
        x_rate = np.array([0.0 if place.path is None else place.rate * rates[place.path] for place in places])
        free = self.assembly.free
        states = consistent_start(self.assembly, x, x_rate, initial)
        return {name: InitialState(start.q[free[name]], start.v[free[name]]) for name, start in states.items()}

    def needs(self, x: Array, rho_inf: float = 0.0) -> Needs:
        """Needs of the system in a simulator where its places follow x (T, sides) m."""
        return needs_of(self.system, ~np.any(self.assembly.along(x[:1]).F[0], axis=1), x, rho_inf)
