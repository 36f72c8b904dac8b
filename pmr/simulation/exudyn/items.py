r"""The Exudyn items that make up a system: nodes, one object, markers, a connector for rigid contacts.

.. math::
    M \ddot q + D \dot q + K q + C(s(t))^T \lambda = B f(t), \qquad C(s(t))\, q = 0

An ObjectGenericODE2 carries all bodies, a node each; an ObjectConnectorCoordinateVector the rows.

Terms that vary in time (`pmr.system.terms`) in Exudyn: an object of their own, whose matrices are set once a step.

Exudyn's generalized-alpha fulfils the equations at the end of the step, whose time the pre-step function is given; the
object's matrices join the Jacobian as those of any other do.

Coordinates without inertia (`pmr.reduced.attachment`) in Exudyn: backward Euler as `march` has it.

.. math:: (D / h + K)\, \eta_{n+1} + \ldots = F_{n+1} + D\, \eta_n / h

An object of their own adds D / h and the force of what damping keeps, once a step.  Until the first step it has the
inertia that the bodies lack, so that initial accelerations of all other coordinates can be solved for.
"""

# ruff: noqa: N815 - items are numbered as Exudyn users do: nodes n..., objects o..., markers m...

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import exudyn as exu
import numpy as np
import scipy.sparse as sp
from exudyn.itemInterface import (
    MarkerNodeCoordinates,
    MarkerObjectODE2Coordinates,
    NodeGenericODE2,
    NodePointGround,
    ObjectConnectorCoordinateVector,
    ObjectGenericODE2,
)
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.simulation.exudyn.equations import Equations, Inputs
from pmr.simulation.start import InitialState

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
PreStep = Callable[[Any, float], bool]


def _do_nothing(mbs: Any, t: float) -> bool:
    return True


@dataclass(frozen=True)
class SystemItems:
    """Numbers of the items that make up a system in an mbs."""

    # NodeGenericODE2 of each body with its coordinates, those that supports of a full one hold left out
    nBodies: Mapping[str, Any]
    # all coordinates of each body; connectors attached here feel the full flexibility at the model's ports alone
    mBodies: Mapping[str, Any]
    oSystem: Any  # ObjectGenericODE2 with M, D and K of all bodies
    mSystem: Any  # all coordinates
    mGround: Any
    # ObjectConnectorCoordinateVector of the `contacts`; its output variable Force is their lambda in N; None where
    # there are no such contacts
    oContacts: Any = None
    oTerms: Any = None  # ObjectGenericODE2 of the terms that vary in time; None where there are none
    oBase: Any = None  # ObjectGenericODE2 that couples it with a rigid body; None where it stands on the ground
    contacts: tuple[int, ...] = ()  # numbers of the system's contacts that oContacts holds, in its order
    # sets rows and loads to the time t in s; the mbs' pre-step function calls it
    update: PreStep = _do_nothing
    equations: Any = None  # `Equations` and `Inputs`, which `add_sensors` needs
    inputs: Any = None
    base: Any = None  # what `add_hook` needs
    rubbing: Any = None  # `pmr.simulation.exudyn.contacts.Pads`; None where no pad rubs

    def called(self, mbs: Any, part: str) -> str:
        """Name in the mbs of a part of the system."""
        return f"{mbs.GetMarker(self.mSystem)['name']}{part}"

    def coordinates(self, mbs: Any, configuration: Any = exu.ConfigurationType.Current) -> Array:
        """Coordinates (n,) of all bodies."""
        kind, nodes = exu.OutputVariableType.Coordinates, self.nBodies.values()
        return np.concatenate([mbs.GetNodeOutput(node, kind, configuration) for node in nodes])

    def add_object(self, mbs: Any, part: str, equations: Equations, **parameters: Any) -> Any:
        """Add an ObjectGenericODE2 on the nodes of all bodies, without mass and Jacobian unless they are given."""
        empty = equations.matrix(sp.csr_matrix((equations.size,) * 2))
        nothing = {"massMatrix": empty, "jacobianUserFunction": lambda *arguments: empty}
        nodes = list(self.nBodies.values())
        return mbs.AddObject(
            ObjectGenericODE2(name=self.called(mbs, part), nodeNumbers=nodes, **(nothing | parameters))
        )

    def updated_by(self, mbs: Any, function: PreStep) -> SystemItems:
        """The items with ``function(mbs, t)`` called before each step, after all that is called already."""
        before = self.update
        add_pre_step_function(mbs, function)
        return replace(self, update=lambda mbs, t: before(mbs, t) and function(mbs, t))

    @property
    def nBody(self) -> Any:  # noqa: N802
        """Node of a body alone."""
        (node,) = self.nBodies.values()
        return node

    @property
    def mBody(self) -> Any:  # noqa: N802
        """Marker of a body alone."""
        (marker,) = self.mBodies.values()
        return marker

    @property
    def oBody(self) -> Any:  # noqa: N802
        """Object of a body alone."""
        return self.oSystem

    @property
    def oSlider(self) -> Any:  # noqa: N802
        """Connector of the rigid rows of a body alone."""
        return self.oContacts


def add_pre_step_function(mbs: Any, function: PreStep) -> None:
    """Have ``function(mbs, t)`` called before each step, after the pre-step functions that are already set.

    As in Exudyn, the simulation stops after the step if one of them returns False.
    """
    present = mbs.GetPreStepUserFunction()
    if not present:
        mbs.SetPreStepUserFunction(function)
        return
    earlier = present["function"]

    def both(mbs: Any, t: float) -> bool:
        goes_on = earlier(mbs, t)
        return bool(function(mbs, t) and goes_on)

    mbs.SetPreStepUserFunction(both)


def add_bodies(
    mbs: Any, equations: Equations, start: Mapping[str, InitialState], K: Any = None, **parameters: Any
) -> SystemItems:
    """Nodes, object and ground, with K or the bodies' own; `parameters` are those of its ObjectGenericODE2."""
    name = f"system{mbs.systemData.NumberOfObjects()}"
    called = {body: f"{name} {body}".strip() for body in equations.system.bodies}
    nodes = {body: add_coordinates(mbs, called[body], start[body]) for body in called}
    of_bodies = {"massMatrix": equations.M, "stiffnessMatrix": equations.K if K is None else K}
    of_bodies |= {"dampingMatrix": equations.D} if equations.assembly.D.count_nonzero() else {}
    matrices = {key: equations.matrix(A) for key, A in of_bodies.items()}
    oSystem = mbs.AddObject(ObjectGenericODE2(name=name, nodeNumbers=list(nodes.values()), **matrices, **parameters))
    ground = mbs.AddNode(NodePointGround(name=f"{name}Ground"))
    return SystemItems(
        nBodies=nodes,
        mBodies={
            body: mbs.AddMarker(MarkerNodeCoordinates(name=called[body], nodeNumber=node))
            for body, node in nodes.items()
        },
        oSystem=oSystem,
        mSystem=mbs.AddMarker(MarkerObjectODE2Coordinates(name=f"{name}All", objectNumber=oSystem)),
        mGround=mbs.AddMarker(MarkerNodeCoordinates(name=f"{name}Ground", nodeNumber=ground)),
    )


def add_coordinates(mbs: Any, name: str, start: InitialState) -> Any:
    """A NodeGenericODE2."""
    size = len(start.q)
    return mbs.AddNode(
        NodeGenericODE2(
            name=name,
            referenceCoordinates=np.zeros(size),
            initialCoordinates=start.q,
            initialCoordinates_t=start.v,
            numberOfODE2Coordinates=size,
        )
    )


def with_contacts(
    mbs: Any, items: SystemItems, contacts: Indices, mOther: Any = None, **parameters: Any
) -> SystemItems:
    """Add a connector for `contacts` between the marker `mOther` (the ground) and all bodies."""
    if not len(contacts):
        return items
    name = items.called(mbs, "Contacts")
    markers = [items.mGround if mOther is None else mOther, items.mSystem]
    connector = ObjectConnectorCoordinateVector(name=name, markerNumbers=markers, **parameters)
    return replace(items, oContacts=mbs.AddObject(connector), contacts=tuple(contacts.tolist()))


class Steps:
    """The update of a system before each step; refuses steps that it is not called for, or not right for.

    `held` says whether constraints move.  What is refused comes out of Exudyn as an error of its own, with the line of
    an `InputError` in it.
    """

    def __init__(self, held: bool) -> None:
        self._held, self._reached = held, 0.0
        self._update: PreStep = _do_nothing

    def attach_update(self, mbs: Any, items: SystemItems, update: PreStep) -> SystemItems:
        """The items, with ``update(mbs, t)`` called before each step that ends at t."""
        self._update = update
        add_pre_step_function(mbs, self._begin)
        return replace(items, update=self._begin)

    def check(self, t: float) -> None:
        """Within a step that ends at t."""
        if t > self._reached + 1e-9 * abs(t):
            allowed = (
                "it replaced the function by which path and loads change; add_pre_step_function(mbs, function) of "
                "pmr.simulation.exudyn keeps both"
            )
            raise InputError("Exudyn", "SetPreStepUserFunction", None, allowed)

    def _begin(self, mbs: Any, t: float) -> bool:
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


def with_terms(mbs: Any, items: SystemItems, equations: Equations, inputs: Inputs) -> SystemItems:
    """Add the object of the system's terms, if it has any."""
    if not equations.system.terms:
        return items
    assembly, amplitudes_set = equations.assembly, inputs.amplitudes(0.0)

    def matrices(c: tuple[float, ...]) -> dict[str, Any]:
        entries = {
            "stiffnessMatrix": assembly.stiffness(c) - assembly.K,
            "dampingMatrix": assembly.damping(c) - assembly.D,
        }
        return {key: equations.matrix(A) for key, A in entries.items()}

    oTerms = items.add_object(mbs, "Terms", equations, **matrices(amplitudes_set))

    def vary(mbs: Any, t: float) -> bool:
        nonlocal amplitudes_set
        amplitudes = inputs.amplitudes(t)
        if amplitudes != amplitudes_set:
            amplitudes_set = amplitudes
            for key, value in matrices(amplitudes).items():
                mbs.SetObjectParameter(oTerms, key, value)
        return True

    return replace(items.updated_by(mbs, vary), oTerms=oTerms)


def with_quasi_static(mbs: Any, items: SystemItems, equations: Equations) -> SystemItems:
    """Add items for coordinates without inertia, if there are any."""
    still, reached, begun = equations.quasi_static, 0.0, False
    if not len(still):
        return items

    def diagonal(values: Any) -> Any:
        entries = np.zeros(equations.size)
        entries[still] = values
        return equations.matrix(sp.diags(entries, format="csr"))

    empty, inertia = diagonal(0.0), diagonal(1.0)
    oStill = items.add_object(
        mbs,
        "QuasiStatic",
        equations,
        massMatrix=inertia,
        massMatrixUserFunction=lambda *arguments: empty if begun else inertia,  # Exudyn reuses what is a constant
        stiffnessMatrix=empty,
        forceVector=np.zeros(equations.size),
    )

    def follow(mbs: Any, t: float) -> bool:
        nonlocal reached, begun
        if t <= 0.0:  # before a simulation is repeated
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
    """Rates (T, n), of coordinates without inertia by the differences of q (T, n) at the times t (T,) s."""
    still, changed = equations.quasi_static, v.copy()
    changed[:, still] = 0.0
    changed[1:, still] = np.diff(q[:, still], axis=0) / np.diff(t)[:, None]
    return changed
