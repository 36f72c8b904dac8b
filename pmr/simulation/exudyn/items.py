r"""The Exudyn items that make up a sliding body: nodes, objects, markers.

.. math::
    M \ddot q + D \dot q + K q + C(s(t))^T \lambda = B f(t), \qquad C(s(t))\, q = 0

An ObjectGenericODE2 carries the body, an ObjectConnectorCoordinateVector the rows.
"""

# ruff: noqa: N815 - items are numbered as Exudyn users do: nodes n..., objects o..., markers m...

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import exudyn as exu
import numpy as np
import scipy.sparse as sp
from exudyn.itemInterface import (
    MarkerNodeCoordinate,
    MarkerNodeCoordinates,
    NodeGenericODE2,
    NodePointGround,
    ObjectConnectorCoordinate,
    ObjectConnectorCoordinateVector,
    ObjectGenericODE2,
)
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.simulation.start import InitialState
from pmr.system.body import SlidingBody

Array = NDArray[np.float64]
PreStep = Callable[[Any, float], bool]


def _nothing(mbs: Any, t: float) -> bool:
    return True


@dataclass(frozen=True)
class SlidingBodyItems:
    """Numbers of the items that make up one sliding body in an mbs."""

    nBody: Any  # NodeGenericODE2 with the n coordinates
    oBody: Any  # ObjectGenericODE2 with M, D and K
    # all coordinates of the body; connectors attached here feel the full flexibility at the model's ports alone
    mBody: Any
    nGround: Any
    mGround: Any
    # ObjectConnectorCoordinateVector of `rows`; its output variable Force is their lambda in N; None where there are
    # no such rows
    oSlider: Any
    # ObjectConnectorCoordinate for each of the body's rows that hold one coordinate, in the order of ``body.held``: a
    # vector connector would carry its dense n columns for each of them
    oSupports: tuple[Any, ...]
    rows: tuple[int, ...]  # numbers of the body's rows that oSlider holds, in its order
    # sets rows and loads to the time t in s; the system's pre-step function calls it
    update: PreStep = _nothing


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


def add_body(mbs: Any, body: SlidingBody, start: InitialState, **parameters: Any) -> SlidingBodyItems:
    """Node, object, ground and supports of a body; `parameters` are those of its ObjectGenericODE2."""
    name = f"slidingBody{mbs.systemData.NumberOfObjects()}"
    nBody = add_coordinates(mbs, name, start)
    damping = {"dampingMatrix": matrix(body.D)} if _has_entries(body.D) else {}
    model = {"massMatrix": matrix(body.M), "stiffnessMatrix": matrix(body.K)} | damping | parameters
    oBody = mbs.AddObject(ObjectGenericODE2(name=name, nodeNumbers=[nBody], **model))
    mBody = mbs.AddMarker(MarkerNodeCoordinates(name=name, nodeNumber=nBody))
    nGround = mbs.AddNode(NodePointGround(name=f"{name}Ground"))
    mGround = mbs.AddMarker(MarkerNodeCoordinates(name=f"{name}Ground", nodeNumber=nGround))
    oSupports = tuple(
        _fix(mbs, f"{name}Support{row}", nBody, coordinate, nGround) for row, coordinate in body.held.items()
    )
    return SlidingBodyItems(nBody, oBody, mBody, nGround, mGround, None, oSupports, ())


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


def with_rows(
    mbs: Any, items: SlidingBodyItems, rows: list[int], mOther: Any = None, **parameters: Any
) -> SlidingBodyItems:
    """The same items and a vector connector for `rows` between the marker `mOther` (the ground) and the body."""
    if not rows:
        return items
    name = f"{mbs.GetMarker(items.mBody)['name']}Slider"
    markers = [items.mGround if mOther is None else mOther, items.mBody]
    connector = ObjectConnectorCoordinateVector(name=name, markerNumbers=markers, **parameters)
    return replace(items, oSlider=mbs.AddObject(connector), rows=tuple(rows))


class Steps:
    """The update of a body before each step; refuses steps that it is not called for, or not right for.

    `held` says whether constraints of the body move.  What is refused comes out of Exudyn as an error of its own, with
    the line of an `InputError` in it.
    """

    def __init__(self, held: bool) -> None:
        self._held, self._reached = held, 0.0
        self._update: PreStep = _nothing

    def updated(self, mbs: Any, items: SlidingBodyItems, update: PreStep) -> SlidingBodyItems:
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


def _fix(mbs: Any, name: str, nBody: Any, coordinate: int, nGround: Any) -> Any:
    markers = [
        mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=nGround, coordinate=0)),
        mbs.AddMarker(MarkerNodeCoordinate(name=name, nodeNumber=nBody, coordinate=coordinate)),
    ]
    return mbs.AddObject(ObjectConnectorCoordinate(name=name, markerNumbers=markers))


def matrix(A: Any) -> Any:
    """Exudyn's matrix container, sparse triplets for a sparse matrix."""
    if not sp.issparse(A):
        return exu.MatrixContainer(np.asarray(A, dtype=float))
    container = exu.MatrixContainer()
    container.SetWithSparseMatrix(sp.csr_matrix(A))
    return container


def _has_entries(A: Any) -> bool:
    return bool(A.nnz if sp.issparse(A) else np.any(A))
