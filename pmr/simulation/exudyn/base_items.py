"""The items that couple a boom with the body that carries it, and with nodes that draw it out."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import exudyn as exu
import numpy as np
from exudyn.itemInterface import MarkerObjectODE2Coordinates, ObjectGenericODE2
from numpy.typing import NDArray

from pmr.simulation.exudyn.extending import Extending
from pmr.simulation.exudyn.free_base import Base
from pmr.simulation.exudyn.inputs import Inputs
from pmr.simulation.exudyn.items import SystemItems, with_contacts

Array = NDArray[np.float64]


def with_base(mbs: Any, items: SystemItems, base: Base, inputs: Inputs) -> SystemItems:
    """Add the object that couples the items of a boom with the body that carries it."""
    nodes = [base.node, *items.nBodies.values(), *base.paths.nodes]
    count = sum(len(mbs.GetNode(node)["referenceCoordinates"]) for node in nodes)
    key, found = None, (np.empty(0),) * 3

    def evaluate(t: float, q: Any, q_t: Any) -> tuple[Array, Array, Array]:
        nonlocal key, found
        x, rate = np.array(q), np.array(q_t)
        arguments = (t, x.tobytes(), rate.tobytes())
        if arguments != key:  # mass and forces are asked for one after the other
            key, found = arguments, base.at(t, x, rate, np.array(inputs.loads(t)))
        return found

    name = f"{mbs.GetMarker(items.mSystem)['name']}Base"
    oBase = mbs.AddObject(
        ObjectGenericODE2(
            name=name,
            nodeNumbers=nodes,
            massMatrix=np.zeros((count, count)),
            massMatrixUserFunction=lambda mbs, t, item, q, q_t: evaluate(t, q, q_t)[0],
            forceUserFunction=lambda mbs, t, item, q, q_t: evaluate(t, q, q_t)[1],
            # beside what an extension stores, inertia decides within a step
            jacobianUserFunction=lambda mbs, t, item, q, q_t, factor, factor_t: exu.MatrixContainer(
                factor * evaluate(t, q, q_t)[2]
            ),
        )
    )
    items = replace(items, oBase=oBase, base=base)
    if items.rubbing is not None:
        items.rubbing.inertia = lambda t: base.inertia(mbs, t)
    return items if base.extending is None else _with_rows(mbs, items, base, base.extending)


def _with_rows(mbs: Any, items: SystemItems, base: Base, extending: Extending) -> SystemItems:
    """Add a connector for rigid contacts along extensions that are coordinates."""
    k, n = base.count, base.boom.size

    def split(t: float, z: Any) -> tuple[Array, Array]:
        """Extensions and coordinates, of a marker's, which has those of reference, too."""
        z_array = np.array(z)
        return base.extended(t, z_array[k + n :] - base.paths.reference, z_array[k + n :]).value, z_array[k : k + n]

    def gap_derivative(t: float, z: Any) -> Array:
        derivative = extending.moved(*split(t, z))
        return np.hstack([np.zeros((len(derivative), k)), derivative[:, :n], derivative[:, n:] @ base.paths.along])

    name = f"{mbs.GetMarker(items.mSystem)['name']}Extended"
    marker = mbs.AddMarker(MarkerObjectODE2Coordinates(name=name, objectNumber=items.oBase))
    connected = with_contacts(
        mbs,
        replace(items, mSystem=marker),
        extending.rigid,
        scalingMarker0=np.zeros((len(extending.rigid), 1)),  # its height is the number of rows
        constraintUserFunction=lambda mbs, t, item, q, q_t, velocity: extending.gap(*split(t, q)),
        jacobianUserFunction=lambda mbs, t, item, q, q_t, velocity: gap_derivative(t, q),
    )
    return replace(connected, mSystem=items.mSystem)
