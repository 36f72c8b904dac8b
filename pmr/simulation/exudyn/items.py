r"""The Exudyn items that make up a system: nodes, one object, markers, a connector for rigid contacts.

.. math::
    M \ddot q + D \dot q + K q + C(s(t))^T \lambda = B f(t), \qquad C(s(t))\, q = 0

One ObjectGenericODE2 with a node for each body represents all bodies, with coordinates q; an
ObjectConnectorCoordinateVector represents the rigid contacts, with rows C on the paths s and forces :math:`\lambda`.

Terms that vary in time (`pmr.system.terms`) have an ObjectGenericODE2 of their own; its matrices are set once a step.
Exudyn's generalized-alpha fulfils the equations at the end of a step, and the pre-step function receives the time of
this end.  The object's matrices enter the Jacobian like the matrices of any other object.

Coordinates eta without inertia (`pmr.system.attachment`) are integrated by backward Euler with steps of h, as in
`march`:

.. math:: (D / h + K)\, \eta_{n+1} + \ldots = F_{n+1} + D\, \eta_n / h

Here n is the number of the step, and D and K are damping and stiffness of these coordinates.  An ObjectGenericODE2 of
their own adds the stiffness D / h and the force D eta_n / h, set once a step.  Until the first step it has a unit mass
for these coordinates, so that Exudyn can solve for the initial accelerations of all others.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
import scipy.sparse as sp

from pmr.errors import InputError
from pmr.files.arrays import Array, Indices
from pmr.simulation.exudyn.equations import Equations, Inputs
from pmr.simulation.start import InitialState

PreStep = Callable[[exu.MainSystem, float], bool]


def _do_nothing(mbs: exu.MainSystem, t: float) -> bool:
    """Pre-step function that changes nothing and lets the simulation go on."""
    return True


@dataclass(frozen=True)
class SystemParts:
    """Objects that compute matrices, positions and loads of a system at a time, for the system's items in an mbs."""

    equations: Equations
    inputs: Inputs
    base: Any = None  # `Base` of a boom on a body, which `add_hook` needs
    rubbing: Any = None  # `pmr.simulation.exudyn.contacts.Pads`; None where no pad rubs


@dataclass(frozen=True)
class SystemItems:
    """Numbers of the items that make up a system in an mbs (Exudyn's multibody system)."""

    # NodeGenericODE2 of each body, without coordinates that supports of a full body hold
    nBodies: Mapping[str, exu.NodeIndex]
    # markers of all coordinates of each body; connectors here feel the full flexibility only at the ports of the model
    mBodies: Mapping[str, exu.MarkerIndex]
    oSystem: exu.ObjectIndex  # ObjectGenericODE2 with M, D and K of all bodies
    mSystem: exu.MarkerIndex  # marker of all coordinates
    mGround: exu.MarkerIndex
    parts: SystemParts
    # ObjectConnectorCoordinateVector of the `contacts`; its output variable Force is their force in N; None without
    # such contacts
    oContacts: exu.ObjectIndex | None = None
    # ObjectGenericODE2 that couples the boom with a rigid body; None for a boom on the ground
    oBase: exu.ObjectIndex | None = None
    contacts: tuple[int, ...] = ()  # numbers of the system's contacts that oContacts holds, in its order
    # sets rows and loads to the time t in s; the mbs' pre-step function calls it
    update: PreStep = _do_nothing

    def component_name(self, mbs: exu.MainSystem, part: str) -> str:
        """Name in the mbs of a component of the system: the system's name followed by `part`, such as ``Contacts``."""
        return f"{mbs.GetMarker(self.mSystem)['name']}{part}"

    def coordinates(
        self, mbs: exu.MainSystem, configuration: exu.ConfigurationType = exu.ConfigurationType.Current
    ) -> Array:
        """Coordinates (n,) of all bodies, by default in the current configuration."""
        kind, nodes = exu.OutputVariableType.Coordinates, self.nBodies.values()
        return np.concatenate([mbs.GetNodeOutput(node, kind, configuration) for node in nodes])

    def add_object(self, mbs: exu.MainSystem, part: str, equations: Equations, **parameters: Any) -> exu.ObjectIndex:
        """Add an ObjectGenericODE2 on the nodes of all bodies and return its number.

        `part` is the end of the object's name.  The object's mass matrix and Jacobian are zero unless `parameters`,
        which are passed to ObjectGenericODE2, say otherwise.
        """
        empty = equations.matrix(sp.csr_matrix((equations.size,) * 2))
        nothing = {"massMatrix": empty, "jacobianUserFunction": lambda *arguments: empty}
        nodes = list(self.nBodies.values())
        return mbs.AddObject(
            eii.ObjectGenericODE2(name=self.component_name(mbs, part), nodeNumbers=nodes, **(nothing | parameters))
        )

    def updated_by(self, mbs: exu.MainSystem, function: PreStep) -> SystemItems:
        """Have ``function(mbs, t)`` called before each step, after all functions set so far; return updated items."""
        before = self.update
        add_pre_step_function(mbs, function)
        return replace(self, update=lambda mbs, t: before(mbs, t) and function(mbs, t))

    @property
    def nBody(self) -> exu.NodeIndex:  # noqa: N802
        """Node of the body of a system of one body."""
        (node,) = self.nBodies.values()
        return node

    @property
    def mBody(self) -> exu.MarkerIndex:  # noqa: N802
        """Marker of the body of a system of one body."""
        (marker,) = self.mBodies.values()
        return marker


def add_pre_step_function(mbs: exu.MainSystem, function: PreStep) -> None:
    """Have ``function(mbs, t)`` called before each step, after the pre-step functions that are already set.

    All are called in each step.  As in Exudyn, the simulation stops if one of them returns False.
    """
    present = mbs.GetPreStepUserFunction()
    if not present:
        mbs.SetPreStepUserFunction(function)
        return
    earlier = present["function"]

    def both(mbs: exu.MainSystem, t: float) -> bool:
        """Call both functions; return whether both let the simulation go on."""
        goes_on = earlier(mbs, t)
        return bool(function(mbs, t) and goes_on)

    mbs.SetPreStepUserFunction(both)


def add_bodies(
    mbs: exu.MainSystem,
    equations: Equations,
    inputs: Inputs,
    start: Mapping[str, InitialState],
    K: Array | None = None,
    **parameters: Any,
) -> SystemItems:
    """Add nodes, markers, the common object and a ground node of all bodies to an mbs, and return their numbers.

    Parameters
    ----------
    mbs : exudyn.MainSystem
    equations : Equations
        Mass, damping and stiffness matrices of the system.
    inputs : Inputs
        Positions and loads that drive it.
    start : mapping of str to InitialState
        Initial coordinates and rates of every body, by its name.
    K : (n, n) matrix, optional
        Stiffness that replaces the stiffness matrix of `equations`.
    **parameters
        Passed to ObjectGenericODE2, such as user functions.
    """
    name = f"system{mbs.systemData.NumberOfObjects()}"
    called = {body: f"{name} {body}".strip() for body in equations.system.bodies}
    nodes = {body: add_coordinates(mbs, called[body], start[body]) for body in called}
    of_bodies = {"massMatrix": equations.M, "stiffnessMatrix": equations.K if K is None else K}
    of_bodies |= {"dampingMatrix": equations.D} if equations.assembly.D.count_nonzero() else {}
    matrices = {key: equations.matrix(A) for key, A in of_bodies.items()}
    oSystem = mbs.AddObject(
        eii.ObjectGenericODE2(name=name, nodeNumbers=list(nodes.values()), **matrices, **parameters)
    )
    ground = mbs.AddNode(eii.NodePointGround(name=f"{name}Ground"))
    return SystemItems(
        nBodies=nodes,
        mBodies={
            body: mbs.AddMarker(eii.MarkerNodeCoordinates(name=called[body], nodeNumber=node))
            for body, node in nodes.items()
        },
        oSystem=oSystem,
        mSystem=mbs.AddMarker(eii.MarkerObjectODE2Coordinates(name=f"{name}All", objectNumber=oSystem)),
        parts=SystemParts(equations, inputs),
        mGround=mbs.AddMarker(eii.MarkerNodeCoordinates(name=f"{name}Ground", nodeNumber=ground)),
    )


def add_coordinates(mbs: exu.MainSystem, name: str, start: InitialState) -> exu.NodeIndex:
    """Add a NodeGenericODE2 called `name` with the initial coordinates and rates of `start`, and return its number."""
    size = len(start.q)
    return mbs.AddNode(
        eii.NodeGenericODE2(
            name=name,
            referenceCoordinates=np.zeros(size),
            initialCoordinates=start.q,
            initialCoordinates_t=start.v,
            numberOfODE2Coordinates=size,
        )
    )


def with_contacts(
    mbs: exu.MainSystem, items: SystemItems, contacts: Indices, mOther: exu.MarkerIndex | None = None, **parameters: Any
) -> SystemItems:
    """Add a connector for `contacts` (k,), numbers of contacts of the system, to the mbs; return the items with it.

    If k is 0, nothing is added.  The connector acts between the marker `mOther`, by default the ground, and all bodies;
    `parameters` are passed to ObjectConnectorCoordinateVector.
    """
    if not len(contacts):
        return items
    name = items.component_name(mbs, "Contacts")
    markers = [items.mGround if mOther is None else mOther, items.mSystem]
    connector = eii.ObjectConnectorCoordinateVector(name=name, markerNumbers=markers, **parameters)
    return replace(items, oContacts=mbs.AddObject(connector), contacts=tuple(contacts.tolist()))


class Steps:
    """Calls the update of a system before each step, and refuses unsuitable solvers and settings.

    `held` says whether the system has constraints, which may move.  A refusal appears as an error of Exudyn that
    contains the text of an `InputError`.
    """

    def __init__(self, held: bool) -> None:
        """Begin at t = 0 without an update; `held` says whether the system has constraints."""
        self._held, self._reached = held, 0.0
        self._update: PreStep = _do_nothing

    def attach_update(self, mbs: exu.MainSystem, items: SystemItems, update: PreStep) -> SystemItems:
        """Have ``update(mbs, t)`` called before each step that ends at t; return items with the checked `update`."""
        self._update = update
        add_pre_step_function(mbs, self._begin)
        return replace(items, update=self._begin)

    def check(self, t: float) -> None:
        """Raise InputError if a step ends at t (s) and the update of paths and loads was not called for this time.

        The update is missing if another pre-step function has replaced it.
        """
        if t > self._reached + 1e-9 * abs(t):
            allowed = (
                "it replaced the function by which path and loads change; add_pre_step_function(mbs, function) of "
                "pmr.simulation.exudyn keeps both"
            )
            raise InputError("Exudyn", "SetPreStepUserFunction", None, allowed)

    def _begin(self, mbs: exu.MainSystem, t: float) -> bool:
        """Pre-step function: raise InputError for an unsuitable solver or setting, or else update the system to t."""
        if "staticSolver" in mbs.sys and "dynamicSolver" not in mbs.sys:
            allowed = "SolveDynamic is allowed: a static solution takes its load factor for the time in s"
            raise InputError("Exudyn", "SolveStatic", None, allowed)
        if isinstance(mbs.sys.get("dynamicSolver"), exu.MainSolverExplicit):
            allowed = "an implicit one is allowed: path and loads are set once a step, to those at its end"
            raise InputError("Exudyn", "solverType", "explicit", allowed)
        settings = mbs.sys.get("simulationSettings")
        if self._held and settings is not None and settings.timeIntegration.generalizedAlpha.useIndex2Constraints:
            allowed = "false (GeneralizedAlpha) is allowed: rigid rows that move are fulfilled by positions"
            raise InputError("Exudyn", "generalizedAlpha.useIndex2Constraints", True, allowed)
        self._reached = t
        return self._update(mbs, t)


def with_terms(mbs: exu.MainSystem, items: SystemItems, equations: Equations, inputs: Inputs) -> SystemItems:
    """Add the object of the system's terms and return the items with it, or the items unchanged without terms."""
    if not equations.system.terms:
        return items
    assembly, amplitudes_set = equations.assembly, inputs.values_at(0.0).amplitudes

    def matrices(c: Array) -> dict[str, Any]:
        """Stiffness and damping that terms of amplitudes c (k,) add, as parameters of ObjectGenericODE2.

        The keys are ``stiffnessMatrix`` and ``dampingMatrix``.
        """
        entries = {
            "stiffnessMatrix": assembly.stiffness(c) - assembly.K,
            "dampingMatrix": assembly.damping(c) - assembly.D,
        }
        return {key: equations.matrix(A) for key, A in entries.items()}

    oTerms = items.add_object(mbs, "Terms", equations, **matrices(amplitudes_set))

    def vary(mbs: exu.MainSystem, t: float) -> bool:
        """Pre-step function: set the matrices to the amplitudes at the time t, if these have changed."""
        nonlocal amplitudes_set
        amplitudes = inputs.values_at(t).amplitudes
        if not np.array_equal(amplitudes, amplitudes_set):
            amplitudes_set = amplitudes
            for key, value in matrices(amplitudes).items():
                mbs.SetObjectParameter(oTerms, key, value)
        return True

    return items.updated_by(mbs, vary)


def with_quasi_static(mbs: exu.MainSystem, items: SystemItems, equations: Equations) -> SystemItems:
    """Add the object of coordinates without inertia and return the items with it.

    The items are returned unchanged if all coordinates have inertia.
    """
    still, reached, begun = equations.quasi_static, 0.0, False
    if not len(still):
        return items

    def diagonal(values: Array | float) -> exu.MatrixContainer:
        """Diagonal matrix (n, n) with `values` at coordinates without inertia, and zeros at all other coordinates.

        `values` has one number for each coordinate without inertia, or is one number for all of them.
        """
        entries = np.zeros(equations.size)
        entries[still] = values
        return equations.matrix(sp.diags(entries, format="csr"))

    empty, inertia = diagonal(0.0), diagonal(1.0)
    oStill = items.add_object(
        mbs,
        "QuasiStatic",
        equations,
        massMatrix=inertia,
        massMatrixUserFunction=lambda *arguments: empty if begun else inertia,  # Exudyn reuses a constant matrix
        stiffnessMatrix=empty,
        forceVector=np.zeros(equations.size),
    )

    def follow(mbs: exu.MainSystem, t: float) -> bool:
        """Pre-step function: set the stiffness D / h and the force D eta / h of the step of length h that ends at t.

        D is the damping of the coordinates without inertia, and eta are these coordinates at the step's beginning.
        """
        nonlocal reached, begun
        if t <= 0.0:  # when a simulation is repeated
            reached, begun = 0.0, False
            return True
        force, step = np.zeros(equations.size), t - reached
        force[still] = equations.quasi_static_damping * items.coordinates(mbs)[still] / step
        mbs.SetObjectParameter(oStill, "stiffnessMatrix", diagonal(equations.quasi_static_damping / step))
        mbs.SetObjectParameter(oStill, "forceVector", force)
        reached, begun = t, True
        return True

    return items.updated_by(mbs, follow)


def rates(equations: Equations, t: Array, q: Array, v: Array) -> Array:
    """Rates (T, n): v (T, n), with backward differences of q (T, n) in place of v for coordinates without inertia.

    t (T,) in s are the times of the rows; at the first time, the rates of these coordinates are zero.
    """
    still, changed = equations.quasi_static, v.copy()
    changed[:, still] = 0.0
    changed[1:, still] = np.diff(q[:, still], axis=0) / np.diff(t)[:, None]
    return changed


def add_node_sensors(
    mbs: exu.MainSystem, nodes: Iterable[exu.NodeIndex], kind: exu.OutputVariableType
) -> list[exu.SensorIndex]:
    """Add sensors that store an output variable `kind` of nodes at every step; return their numbers."""
    return [
        mbs.AddSensor(eii.SensorNode(nodeNumber=node, outputVariableType=kind, storeInternal=True)) for node in nodes
    ]


def add_force_sensor(mbs: exu.MainSystem, connector: exu.ObjectIndex) -> exu.SensorIndex:
    """Add a sensor that stores a connector's force at every step; return its number."""
    kind = exu.OutputVariableType.Force
    return mbs.AddSensor(eii.SensorObject(objectNumber=connector, outputVariableType=kind, storeInternal=True))
