r"""A sliding body as a handful of items in an Exudyn system of one's own.

.. math::
    M \ddot q + D \dot q + K q + C(s(t))^T \lambda = B f(t), \qquad C(s(t))\, q = 0

An ObjectGenericODE2 carries the body, an ObjectConnectorCoordinateVector against ground holds the rows.
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

from pmr.body import SlidingBody
from pmr.signals import SignalBase
from pmr.simulate.inputs import Inputs, SignalInputs, moving_rows
from pmr.simulate.start import InitialState, consistent_start
from pmr.simulate.stepping import Loads, path_at

PreStep = Callable[[Any, float], bool]


def _nothing(mbs: Any, t: float) -> bool:
    return True


@dataclass(frozen=True)
class SlidingBodyItems:
    """Numbers of the items that make up one sliding body in an mbs.

    Attributes
    ----------
    nBody : NodeIndex
        NodeGenericODE2 with the n coordinates.
    oBody : ObjectIndex
        ObjectGenericODE2 with M, D and K.
    mBody : MarkerIndex
        All coordinates of the body; attach further connectors here.
    nGround, mGround : NodeIndex, MarkerIndex
    oSlider : ObjectIndex
        ObjectConnectorCoordinateVector of the rows that move; its output variable Force is their lambda in N.
    oSupports : tuple of ObjectIndex
        ObjectConnectorCoordinate for each of the body's rows that hold one coordinate, in the order of ``body.held``:
        a vector connector would carry its dense n columns for each of them.
    update : callable ``(mbs, t) -> True``
        Sets rows and loads to the time t in s; the system's pre-step function calls it.
    """

    nBody: Any
    oBody: Any
    mBody: Any
    nGround: Any
    mGround: Any
    oSlider: Any
    oSupports: tuple[Any, ...]
    update: PreStep = _nothing


def add_sliding_body(
    mbs: Any,
    body: SlidingBody,
    path: SignalBase,
    loads: Loads,
    initial: InitialState | None = None,
) -> SlidingBodyItems:
    """Add a sliding body whose rows and loads are set once a step.

    Exudyn calls the pre-step function with the time at the *end* of the step, where its generalized-alpha
    (Arnold and Bruels 2007) fulfils both equations: setting C(s) and B f once a step is exact, and no Python
    is called within it.  The time integration must start at t = 0; before solving the same mbs a second time,
    call ``update(mbs, 0.0)``.

    Parameters
    ----------
    mbs : exudyn.MainSystem
        A pre-step function that is already set stays in place and is called first.  Setting one later with
        ``mbs.SetPreStepUserFunction`` would replace the update: use `add_pre_step_function`.
    body, path, loads, initial
        As for `pmr.simulate.Simulator`.  A velocity that violates the rows is corrected M-orthogonally.

    Raises
    ------
    InputError
        If a load is missing, a size is wrong, the path begins off the body or the initial position violates the rows.
    """
    return add_updated_body(mbs, body, SignalInputs(body, path, loads), _start(body, path, initial))


def add_sliding_body_with_callbacks(
    mbs: Any,
    body: SlidingBody,
    path: SignalBase,
    loads: Loads,
    initial: InitialState | None = None,
) -> SlidingBodyItems:
    """Add a sliding body as the paper does: Exudyn calls Python for rows, their Jacobian and loads.

    The same trajectory as `add_sliding_body` at ten times its cost, for comparison.  Arguments and errors are
    the same.
    """
    return add_called_body(mbs, body, SignalInputs(body, path, loads), _start(body, path, initial))


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


def add_updated_body(mbs: Any, body: SlidingBody, inputs: Inputs, start: InitialState) -> SlidingBodyItems:
    """Items of a body whose rows and loads are set once a step."""
    s_set, loads_set = inputs.position(0.0), inputs.loads(0.0)
    no_more = _matrix(sp.csr_matrix(body.K.shape) if sp.issparse(body.K) else np.zeros_like(body.K))

    def jacobian(mbs: Any, t: float, item: int, q: Any, q_t: Any, factor: float, factor_t: float) -> Any:
        # Nothing beyond K and D, which Exudyn adds itself; without this function it would difference K q.
        return no_more

    items = _add_items(
        mbs,
        body,
        start,
        of_body={"forceVector": body.B @ np.array(loads_set), "jacobianUserFunction": jacobian},
        of_slider={"scalingMarker1": inputs.rows(0.0)},
    )

    def update(mbs: Any, t: float) -> bool:
        nonlocal s_set, loads_set
        s, loads = inputs.position(t), inputs.loads(t)
        if s != s_set:
            mbs.SetObjectParameter(items.oSlider, "scalingMarker1", inputs.rows(t))
            s_set = s
        if loads != loads_set:
            mbs.SetObjectParameter(items.oBody, "forceVector", body.B @ np.array(loads))
            loads_set = loads
        return True

    add_pre_step_function(mbs, update)
    return replace(items, update=update)


def add_called_body(mbs: Any, body: SlidingBody, inputs: Inputs, start: InitialState) -> SlidingBodyItems:
    """Items of a body whose rows and loads Exudyn asks for in every iteration."""

    def force(mbs: Any, t: float, item: int, q: Any, q_t: Any) -> Any:
        return body.B @ np.array(inputs.loads(t))

    def constraint(mbs: Any, t: float, item: int, q: Any, q_t: Any, velocity_level: bool) -> Any:
        return inputs.rows(t) @ q

    def jacobian(mbs: Any, t: float, item: int, q: Any, q_t: Any, velocity_level: bool) -> Any:
        return inputs.rows(t)

    return _add_items(
        mbs,
        body,
        start,
        of_body={"forceUserFunction": force},
        of_slider={
            "scalingMarker0": np.zeros((len(moving_rows(body)), 1)),  # its height is the number of rows
            "constraintUserFunction": constraint,
            "jacobianUserFunction": jacobian,
        },
    )


def _add_items(
    mbs: Any, body: SlidingBody, start: InitialState, of_body: dict[str, Any], of_slider: dict[str, Any]
) -> SlidingBodyItems:
    name = f"slidingBody{mbs.systemData.NumberOfObjects()}"
    nBody = mbs.AddNode(
        NodeGenericODE2(
            name=name,
            referenceCoordinates=np.zeros(body.size),
            initialCoordinates=start.q,
            initialCoordinates_t=start.v,
            numberOfODE2Coordinates=body.size,
        )
    )
    damping = {"dampingMatrix": _matrix(body.D)} if _has_entries(body.D) else {}
    oBody = mbs.AddObject(
        ObjectGenericODE2(
            name=name,
            nodeNumbers=[nBody],
            massMatrix=_matrix(body.M),
            stiffnessMatrix=_matrix(body.K),
            **damping,
            **of_body,
        )
    )
    mBody = mbs.AddMarker(MarkerNodeCoordinates(name=name, nodeNumber=nBody))
    nGround = mbs.AddNode(NodePointGround(name=f"{name}Ground"))
    mGround = mbs.AddMarker(MarkerNodeCoordinates(name=f"{name}Ground", nodeNumber=nGround))
    oSlider = mbs.AddObject(
        ObjectConnectorCoordinateVector(name=f"{name}Slider", markerNumbers=[mGround, mBody], **of_slider)
    )
    oSupports = tuple(
        _hold(mbs, f"{name}Support{row}", nBody, coordinate, nGround) for row, coordinate in body.held.items()
    )
    return SlidingBodyItems(nBody, oBody, mBody, nGround, mGround, oSlider, oSupports)


def _hold(mbs: Any, name: str, nBody: Any, coordinate: int, nGround: Any) -> Any:
    markers = [
        mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=nGround, coordinate=0)),
        mbs.AddMarker(MarkerNodeCoordinate(name=name, nodeNumber=nBody, coordinate=coordinate)),
    ]
    return mbs.AddObject(ObjectConnectorCoordinate(name=name, markerNumbers=markers))


def _start(body: SlidingBody, path: SignalBase, initial: InitialState | None) -> InitialState:
    s = float(path_at(path, body.domain, np.zeros(1))[0])
    return consistent_start(body, s, float(path.rate(0.0)), initial)


def _matrix(A: Any) -> Any:
    """Exudyn's matrix container, sparse triplets for a sparse matrix."""
    if not sp.issparse(A):
        return exu.MatrixContainer(np.asarray(A, dtype=float))
    container = exu.MatrixContainer()
    container.SetWithSparseMatrix(sp.csr_matrix(A))
    return container


def _has_entries(A: Any) -> bool:
    return bool(A.nnz if sp.issparse(A) else np.any(A))
