"""A cable of ANCF elements with a sliding joint as items of an Exudyn system."""

# ruff: noqa: N815 - items are numbered as Exudyn users do: nodes n..., objects o...

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from exudyn.itemInterface import (
    LoadForceVector,
    MarkerBodyCable2DCoordinates,
    MarkerBodyPosition,
    MarkerNodeCoordinate,
    MarkerNodePosition,
    NodeGenericData,
    NodePoint2D,
    NodePoint2DSlope1,
    NodePointGround,
    ObjectANCFCable2D,
    ObjectConnectorCoordinate,
    ObjectJointSliding2D,
    ObjectMassPoint2D,
)
from numpy.typing import NDArray

from pmr.simulation.exudyn.cable import Cable

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CableItems:
    """Numbers of the items; forces in N."""

    nNodes: list[Any]  # of NodePoint2DSlope1, from x = 0 on
    oElements: list[Any]  # of ObjectANCFCable2D
    oHold: Any  # an ObjectConnectorCoordinate that holds the slider along x; its offset is s(t) - s(0) in m
    oJoint: Any  # an ObjectJointSliding2D; the second component of its Force is the multiplier normal to the cable


def add_sliding_cable(mbs: Any, cable: Cable, s: float) -> CableItems:
    """Add a straight cable at rest, pinned at x = 0, and a slider at s (m)."""
    h = cable.element_length
    nodes = [
        mbs.AddNode(NodePoint2DSlope1(name=f"cable{i}", referenceCoordinates=[i * h, 0.0, 1.0, 0.0]))
        for i in range(cable.elements + 1)
    ]
    elements = [
        mbs.AddObject(
            ObjectANCFCable2D(
                length=h,
                massPerLength=cable.mass_per_length,
                bendingStiffness=cable.bending_stiffness,
                axialStiffness=cable.axial_stiffness,
                nodeNumbers=[left, right],
            )
        )
        for left, right in zip(nodes[:-1], nodes[1:], strict=True)
    ]
    nGround = mbs.AddNode(NodePointGround(name="ground"))
    mGround = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=nGround, coordinate=0))
    for direction in (0, 1):
        _fix(mbs, mGround, nodes[0], direction)
    # The constraints leave the slider no freedom: its mass and its velocity at t = 0 act on nothing else.
    nSlider = mbs.AddNode(NodePoint2D(name="slider", referenceCoordinates=[s, 0.0]))
    mbs.AddObject(ObjectMassPoint2D(mass=1.0, nodeNumber=nSlider))
    oHold = _fix(mbs, mGround, nSlider, 0)
    _fix(mbs, mGround, nSlider, 1)
    return CableItems(nodes, elements, oHold, _add_joint(mbs, cable, elements, nSlider, s))


def add_force(mbs: Any, cable: Cable, items: CableItems, at: float, force: float) -> Any:
    """Add a force along y (N) at the material point `at` (m); returns its load number."""
    e = int(cable.left_elements(np.array(at)))
    local = [at - e * cable.element_length, 0.0, 0.0]
    marker = mbs.AddMarker(MarkerBodyPosition(bodyNumber=items.oElements[e], localPosition=local))
    return mbs.AddLoad(LoadForceVector(markerNumber=marker, loadVector=[0.0, force, 0.0]))


def _fix(mbs: Any, mGround: Any, node: Any, coordinate: int) -> Any:
    marker = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=node, coordinate=coordinate))
    return mbs.AddObject(ObjectConnectorCoordinate(markerNumbers=[mGround, marker]))


def _add_joint(mbs: Any, cable: Cable, elements: list[Any], nSlider: Any, s: float) -> Any:
    markers = [mbs.AddMarker(MarkerBodyCable2DCoordinates(bodyNumber=element)) for element in elements]
    first = int(cable.left_elements(np.array(s)))
    return mbs.AddObject(
        ObjectJointSliding2D(
            name="slidingJoint",
            markerNumbers=[mbs.AddMarker(MarkerNodePosition(nodeNumber=nSlider)), markers[first]],
            slidingMarkerNumbers=markers,
            slidingMarkerOffsets=np.arange(cable.elements) * cable.element_length,
            nodeNumber=mbs.AddNode(NodeGenericData(initialCoordinates=[first, s], numberOfDataCoordinates=2)),
            useClassicalFormulation=False,  # the classical one is 0.2 % off a linear beam, this 0.07 %
        )
    )
