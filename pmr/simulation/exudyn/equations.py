r"""Equations of a system in Exudyn, and the paths and loads that drive it, at a time.

The equations are the matrices of all coordinates, and the contact rows at any path coordinates:

.. math::
    M \ddot q + D \dot q + K q + C^T \lambda = B f, \qquad C q + H f - F \lambda = 0, \qquad
    y = O q + W f - X \lambda

The extensions of a boom on a rigid body may be signals, functions, and coordinates of the user's own nodes.  Here q are
coordinates, :math:`\lambda` contact forces, f loads, y outputs.  `Inputs` are quantities that Exudyn needs at a time t:
side positions, loads, and quantities that depend on the positions.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import exudyn as exu
import numpy as np
import scipy.sparse as sp

from pmr.errors import InputError
from pmr.files.arrays import Array
from pmr.scene import Scene
from pmr.scene.choice import SimulatorNeeds
from pmr.scene.signals import SignalBase
from pmr.simulation.contact_step import StepParts
from pmr.simulation.excitation import Excitation, side_positions, signals_in_order
from pmr.simulation.free_base import Extensions
from pmr.simulation.start import InitialState, consistent_start, dense, needs_of
from pmr.system.assembly import Assembly
from pmr.system.body import SlidingBody, compliant_rows
from pmr.system.contacts import ALONE
from pmr.system.states import ContactRows, check_determined
from pmr.system.system import System


class Equations:
    """Equations of a system on the n coordinates that its supports leave free, at any positions of contact sides.

    A contact has one or two sides, each on a body; x (sides,) in m are the positions of the sides along their bodies.
    """

    def __init__(self, system: System) -> None:
        """Assemble the matrices of the bodies of `system`, without the coordinates that supports hold.

        Raises InputError if the only body of a system is a section with joints to others.
        """
        self.system, self.assembly = system, Assembly(system)
        self.sparse = all(sp.issparse(body.K) for body in system.bodies.values())
        a = self.assembly
        self.M, self.D, self.K = (A if self.sparse else A.toarray() for A in (a.M, a.D, a.K))
        # indices of the coordinates without inertia, and their damping D (q,); they have an object of their own
        self.quasi_static = a.quasi_static
        self.quasi_static_damping = np.asarray(a.D.diagonal())[a.quasi_static]
        for A in (self.M, self.D) if len(a.quasi_static) else ():
            A[a.quasi_static], A[:, a.quasi_static] = 0.0, 0.0
        self.B, self.outputs, self.size = a.B.toarray(), a.outputs, a.size
        self.alone: SlidingBody | None = system.bodies.get(ALONE)
        if self.alone is not None:
            self.alone.ensure_whole("model")
        #: numbers of the rows of a single reduced body that give way somewhere on its path
        self._yielding = [] if self.alone is None or self.sparse else compliant_rows(self.alone)
        self._places = -1, b""  # number of steps and positions of the last call
        self._rows = ContactRows(*(np.empty(0),) * 4)  # rows of the last call
        self._travelling = [k for k, side in enumerate(system.sides) if side.place.path is not None]

    def matrix(self, A: Array | sp.csr_matrix) -> exu.MatrixContainer:
        """Exudyn's matrix container of A (n, n); sparse triplets if the bodies are sparse."""
        if not self.sparse:
            return exu.MatrixContainer(dense(A))
        container = exu.MatrixContainer()
        container.SetWithSparseMatrix(sp.csr_matrix(A))
        return container

    def side_positions(self, excitation: Excitation) -> Array:
        """Side positions x (T, sides) in m at the steps of an excitation.

        Raises InputError if a path leaves the range of a row.
        """
        if self.alone is not None:
            excitation.path_within(self.alone.domain)  # this error names the key of the scene
        return side_positions(self.system, excitation)

    def side_positions_on(self, s: Mapping[str, float]) -> Array:
        """Side positions x (1, sides) in m with the paths at s in m, by name; errors as `side_positions`."""
        return self.system.side_coordinates(s)[None]

    def rows(self, x: Array) -> ContactRows:
        """Rows of all contacts with their sides at x (T, sides) m; the rows of the last call are stored.

        Raises SimulationError if a single body slides over a support, where its flexibility can't be inverted.
        """
        if (key := (len(x), x.tobytes())) != self._places:
            self._places, self._rows = key, self.assembly.contact_rows_over_time(x)
            if self._yielding and self._travelling:
                F = self._rows.F[:, self._yielding][:, :, self._yielding]
                names = [self.system.contact_names[k] for k in self._yielding]
                check_determined(F, names, lambda k: f"slider at {x[k, self._travelling[0]]:g} m")
        return self._rows

    def start(
        self, s: Mapping[str, float], rates: Mapping[str, float], initial: Mapping[str, InitialState]
    ) -> dict[str, InitialState]:
        """Consistent initial state of each body on the coordinates that supports leave free.

        `s` and `rates` are the path coordinates and their rates at the start, in m and m/s, by name.  `initial` are the
        states of bodies, by name, that are to be made consistent.  Errors are raised as by `consistent_start`.
        """
        free = self.assembly.free_coordinates
        states = consistent_start(self.assembly, self.side_positions_on(s)[0], self.system.side_rates(rates), initial)
        return {name: InitialState(start.q[free[name]], start.v[free[name]]) for name, start in states.items()}

    def needs(self, x: Array, rho_inf: float = 0.0) -> SimulatorNeeds:
        """Properties of the system that a simulator has to support, with the contacts' sides at x (T, sides) m.

        `rho_inf` is the spectral radius of the time integration.
        """
        return needs_of(self.system, self.assembly.contact_rows(x[0], effects=False).rigid, x, rho_inf)


@dataclass(frozen=True)
class NodeCoordinate:
    """An extension in m that is a coordinate of a node: its reference coordinate plus the node's own displacement.

    A cylinder or a winch that moves the node drives the boom; the boom's inertia, weight and pads act back on the node.
    """

    node: exu.NodeIndex  # number of a node with displacements, such as NodeGenericODE2, Node1D or NodePoint
    number: int = 0  # number of the coordinate in the node

    def __call__(self, mbs: exu.MainSystem, t: float) -> float:
        """Current coordinate of the node, or the initial one before assembly.

        Raises InputError if the node has no such coordinate.
        """
        node = mbs.GetNode(self.node)
        size = len(node["referenceCoordinates"])
        if not 0 <= self.number < size:
            allowed = f"a number from 0 to {size - 1} of the node's coordinates is allowed"
            raise InputError("Exudyn", "NodeCoordinate.number", self.number, allowed)
        displacements = node["initialCoordinates"]
        if mbs.systemData.ODE2Size():
            displacements = mbs.GetNodeOutput(self.node, exu.OutputVariableType.Coordinates)
        return float(node["referenceCoordinates"][self.number] + np.atleast_1d(displacements)[self.number])


def check_path(name: str, path: object) -> None:
    """Raise InputError if the `path` called `name` is neither a signal, nor a function, nor a `NodeCoordinate`."""
    if not (hasattr(path, "value") and hasattr(path, "rate")) and not callable(path):
        allowed = (
            "a signal, an object with value(t) and rate(t), a function of mbs and t, or a NodeCoordinate is allowed"
        )
        raise InputError("system", f"paths.{name}", None, allowed)


class Paths:
    """Extensions of all P paths at a time, some of which may be coordinates of nodes.

    The paths `aside`, which move no section, follow after the paths of the sections.
    """

    def __init__(
        self, mbs: exu.MainSystem, scene: Scene, paths: Mapping[str, Driving], aside: Sequence[str] = ()
    ) -> None:
        """Sort the `paths` of an mbs into two groups: those given in time, and those that are coordinates of nodes.

        A path is a signal or a function of time, or a `NodeCoordinate`; `paths` has it by its name.  `scene` has the
        names of its sections and the time step.  `aside` are names of paths that move no section.
        """
        #: names of the P paths; the first belongs to the base section, which has the extension 0
        self.names = (*scene.names, *aside)
        self._t, h = np.nan, scene.time.step
        self.free = {name: path for name in self.names[1:] if isinstance(path := paths.get(name), NodeCoordinate)}
        self._given = {name: _Path(paths[name], h, mbs) for name in self.names[1:] if name not in self.free}
        self.nodes = list(dict.fromkeys(path.node for path in self.free.values()))
        sizes = [len(mbs.GetNode(node)["referenceCoordinates"]) for node in self.nodes]
        first = dict(zip(self.nodes, np.cumsum([0, *sizes]).tolist(), strict=False))
        #: d s / d z (P, m): derivatives of the extensions s, first the base's, by the m coordinates z of the nodes
        self.along = np.zeros((len(self.names), sum(sizes)))
        self.reference = np.array([value for node in self.nodes for value in mbs.GetNode(node)["referenceCoordinates"]])
        for name, path in self.free.items():
            self.along[self.names.index(name), first[path.node] + path.number] = 1.0
        self._signals_now = np.zeros((3, len(self.names)))

    def extensions(self, t: float, z: Array, z_t: Array) -> Extensions:
        """Extensions at t s, with coordinates and rates z, z_t (m,) of the nodes.

        Second rates of signals and functions are included; second rates of coordinates of nodes are zero.
        """
        if t != self._t:
            self._t, self._signals_now = t, np.zeros_like(self._signals_now)
            for number, name in enumerate(self.names):
                if name in self._given:
                    self._signals_now[:, number] = self._given[name].evaluate(t)
        s, v, a = self._signals_now
        return Extensions(s + self.along @ (z + self.reference), v + self.along @ z_t, a)


class _Path:
    """A path that is a signal, an object like one, or a function of mbs and t; a kink acts over one step of h.

    The rates of a function follow from the parabola through its values half a step before t, at t, and half a step
    after t.
    """

    def __init__(self, path: Driving, h: float, mbs: exu.MainSystem) -> None:
        """Store the `path` of an mbs, and the time step of h s over which a kink acts."""
        self._path: Any = path  # of any of these three kinds
        self._h, self._mbs = h, mbs

    def evaluate(self, t: float) -> list[float]:
        """Value in m, rate and second rate at t s."""
        half = self._h / 2.0
        if not hasattr(self._path, "rate"):
            middle = max(t, half)  # the path is not evaluated before the start
            before, now, after = (float(self._path(self._mbs, at)) for at in (middle - half, middle, middle + half))
            second = (after - 2.0 * now + before) / half**2
            return [float(self._path(self._mbs, t)), (after - before) / self._h + second * (t - middle), second]
        last, first = t + half, max(t - half, 0.0)
        second = (float(self._path.rate(last)) - float(self._path.rate(first))) / (last - first)
        return [float(self._path.value(t)), float(self._path.rate(t)), second]


#: A path in m or a load in N: a signal with `value` and `rate`, or a function of the mbs and the time in s, which may
#: read ``mbs.variables``.
Driving: TypeAlias = SignalBase | Callable[[exu.MainSystem, float], float]


def driving_value(driving: Driving, mbs: exu.MainSystem, t: float) -> float:
    """Value of `driving`, a signal or a function of the mbs, at t s."""
    return float(driving.value(t) if hasattr(driving, "value") else driving(mbs, t))


class InputValues(NamedTuple):
    """Values of all inputs at a time."""

    number: int  # index of the side positions, the same as long as the positions are
    loads: Array  # (i,) N or N m: one for each input
    amplitudes: Array  # (k,): one for each term


class Inputs(ABC):
    """Side positions and loads at a time, and quantities that depend on the positions.

    An index numbers the side positions: it stays the same as long as no side moves.
    """

    @abstractmethod
    def values_at(self, t: float) -> InputValues:
        """Return the index of the side positions, the loads and the amplitudes of terms at t s."""

    @abstractmethod
    def begin(self, t: float) -> None:
        """Begin the step that ends at t s."""

    @abstractmethod
    def positions(self, t: float) -> Array:
        """Side positions x (1, sides) in m at t s."""

    def function_of_time(self, evaluate: Callable[[Array], Array]) -> Callable[[float], Array]:
        """Function of t in s that returns the first entry of ``evaluate(x)``, with the side positions x at t.

        `evaluate` is called with x (1, sides) in m, and only if the sides have moved since the last call.  It returns
        an array (1, ...).
        """
        number, stored = -1, np.empty(0)

        def value(t: float) -> Array:
            """First entry of the result of `evaluate` at t s, computed anew only if the sides have moved."""
            nonlocal number, stored
            if (k := self.values_at(t).number) != number:
                number, stored = k, evaluate(self.positions(t))[0]
            return stored

        return value


class SignalInputs(Inputs):
    """Inputs from signals and functions, which are evaluated when the time changes or a step begins.

    Raises InputError if a path is missing, if the loads are not just one for each input, or if the amplitudes are not
    just one for each term.
    """

    def __init__(
        self,
        mbs: exu.MainSystem,
        equations: Equations,
        paths: Mapping[str, Driving],
        loads: Mapping[str, Driving],
        terms: Mapping[str, Driving],
    ) -> None:
        """Check the names of `paths`, `loads` and `terms` against the equations' system, and evaluate all at t = 0.

        Each path, load or amplitude is a signal, or a function of the mbs and the time.
        """
        if missing := set(equations.system.paths) - set(paths):
            allowed = f"{', '.join(paths) or 'none'} given, one for each path is allowed: {', '.join(sorted(missing))}"
            raise InputError("system", "paths", None, allowed)
        self._mbs, self._equations, self._paths, self._k = mbs, equations, dict(paths), 0
        # m/s at t = 0, when a path that is a function counts as at rest
        self.rates = {name: float(path.rate(0.0)) if hasattr(path, "rate") else 0.0 for name, path in paths.items()}
        self._loads = signals_in_order(loads, equations.system.input_names)
        self._terms = signals_in_order(terms, equations.system.term_names, "term")
        # coordinates of nodes, which move within a step
        self._moving = [name for name, path in self._paths.items() if isinstance(path, NodeCoordinate)]
        self._x = np.empty(0)
        self.begin(0.0)

    def positions(self, t: float) -> Array:
        """Side positions x (1, sides) in m at t s; positions that move within a step are evaluated at each call.

        Raises InputError if a path leaves a row.
        """
        self.values_at(t)
        if not self._moving:
            return self._x
        return self._equations.side_positions_on(
            self.s | {name: driving_value(self._paths[name], self._mbs, t) for name in self._moving}
        )

    def begin(self, t: float) -> None:
        """Evaluate paths, loads and amplitudes of terms at the time t in s, at the start of a step to t.

        Raises InputError if a path leaves a row.
        """
        self.s = {name: driving_value(path, self._mbs, t) for name, path in self._paths.items()}  # m
        before, self._t, self._x = self._x, t, self._equations.side_positions_on(self.s)
        self._k += int(not np.array_equal(before, self._x))
        self._f, self._c = (
            np.array([driving_value(driving, self._mbs, t) for driving in each]) for each in (self._loads, self._terms)
        )

    def values_at(self, t: float) -> InputValues:
        """Return index of the side positions, loads, and amplitudes at t s.

        They are evaluated only if t is not the time of the last evaluation.
        """
        if t != self._t:
            self.begin(t)
        return InputValues(self._k, self._f, self._c)

    def paths(self, t: float) -> dict[str, float]:
        """Coordinate in m of each path at the time t in s, by the path's name."""
        self.values_at(t)
        return self.s


class TabulatedInputs(Inputs):
    """Inputs that have been evaluated beforehand, at the ends of all parts of all steps.

    Raises the errors of `Equations.side_positions`, `Excitation.forces` and `Excitation.amplitudes`.
    """

    def __init__(self, equations: Equations, excitation: Excitation, lengths: StepParts) -> None:
        """Evaluate positions, loads and amplitudes of the excitation at the ends of all parts of its steps, `lengths`.

        `equations` are those of the system.  Raises InputError if a path leaves a row.
        """
        stepping, numbers = excitation.stepping.divide(lengths.finest), lengths.numbers
        fine = excitation.with_stepping(stepping)
        self.x, self.f = equations.side_positions(fine)[numbers], fine.forces(equations.system.input_names)[numbers]
        self.c = fine.amplitudes(equations.system.term_names)[numbers]
        changes = np.append(True, np.any(self.x[1:] != self.x[:-1], axis=1))
        at = (np.cumsum(changes) - 1).tolist()
        self._places, self._step = self.x[changes], stepping.step
        self._values = dict(zip(numbers.tolist(), map(InputValues, at, self.f, self.c), strict=True))

    def begin(self, t: float) -> None:
        """Do nothing, as all values are known."""

    def values_at(self, t: float) -> InputValues:
        """Return index of the side positions, loads, and amplitudes at t s, which has to end a part of a step."""
        return self._values[round(t / self._step)]

    def positions(self, t: float) -> Array:
        """Side positions x (1, sides) in m at t s, the end of a part of a step."""
        return np.asarray(self._places[[self.values_at(t).number]])
