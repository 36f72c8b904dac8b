r"""A hook on a boom that rides on a body in Exudyn: a point with a mass, to which ropes and all else are attached.

Where three loads of the model act along x, y and z, the boom moves by :math:`B^T q + E f`, what follows the forces at
once included, so that the hook at x pulls with

.. math:: f = E_h^{-1} \bigl(R^T (x - x_O) - d - r - B_h^T q - E_{hw} f_w\bigr)

in the boom's axes, with the loads f_w that act beside and the weight's.  It pulls on the base with it, too, at the
place where it is, so that momentum stays.
"""

# ruff: noqa: N815 - items are numbered as Exudyn users do

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import exudyn as exu
import numpy as np
from exudyn.itemInterface import MarkerNodePosition, NodePoint, ObjectGenericODE2, ObjectMassPoint
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.simulation.exudyn.free_base import Base
from pmr.simulation.exudyn.items import SystemItems

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Hook:
    """Numbers of the items of a hook in an mbs."""

    nHook: Any  # NodePoint
    oHook: Any  # ObjectMassPoint on it
    mHook: Any  # MarkerNodePosition
    oJoint: Any  # ObjectGenericODE2 that joins it to the boom


def add_hook(mbs: Any, items: SystemItems, loads: tuple[str, str, str], mass: float) -> Hook:
    """A point of so many kg where three of the boom's loads act, which begins where the boom carries it unloaded.

    Parameters
    ----------
    mbs : exudyn.MainSystem
    items : SystemItems
        Of `add_system` with ``on``.
    loads : three str
        Names of inputs along x, y and z of the boom at one place, ``fly.hook x`` and so on; their signals act beside.
    mass : float
        Of the hook itself, kg; its weight is the user's to add, as of any mass.

    Raises
    ------
    InputError
        If the boom stands on the ground, or the model has no such inputs, at one place, with residual flexibility.
    """
    base = items.base
    if base is None:
        raise InputError("Exudyn", "on", None, "a boom on a rigid body is allowed to carry a hook")
    joint = _Joint(base, items, loads)
    start = np.concatenate([mbs.GetNode(node)["initialCoordinates"] for node in items.nBodies.values()])
    carrier = np.array(mbs.GetNode(base.node)["initialCoordinates"])
    place = joint.place(0.0, carrier, start)
    name = f"{mbs.GetMarker(items.mSystem)['name']} {loads[2]}"
    node = mbs.AddNode(NodePoint(name=name, referenceCoordinates=place))
    nodes = [node, base.node, *items.nBodies.values()]
    size = 3 + base.count + len(start)
    oJoint = mbs.AddObject(
        ObjectGenericODE2(
            name=name,
            nodeNumbers=nodes,
            massMatrix=np.zeros((size, size)),
            forceUserFunction=lambda mbs, t, item, q, q_t: joint.force(t, place, np.array(q)),
            jacobianUserFunction=lambda mbs, t, item, q, q_t, factor, factor_t: exu.MatrixContainer(
                factor * joint.stiffness(t, place, np.array(q))
            ),
        )
    )
    return Hook(
        node,
        mbs.AddObject(ObjectMassPoint(name=f"{name} mass", mass=mass, nodeNumber=node)),
        mbs.AddMarker(MarkerNodePosition(name=name, nodeNumber=node)),
        oJoint,
    )


class _Joint:
    """Between a point and where three loads act."""

    def __init__(self, base: Base, items: SystemItems, loads: tuple[str, str, str]) -> None:
        names = items.equations.system.input_names
        if unknown := [name for name in loads if name not in names]:
            raise InputError("system", "loads", ", ".join(unknown), f"{', '.join(names)} are allowed")
        self._base, self._inputs, self._on = base, items.inputs, [names.index(name) for name in loads]
        owner = next(k for k, one in enumerate(base.boom.boom.sections) if one.loads[:, self._on].any())
        work = base.boom.boom.sections[owner].loads[:, self._on]
        turned = work[3:]  # r x e_j
        self._r, self._section = np.array([turned[2, 1], turned[0, 2], turned[1, 0]]), owner
        there = np.cross(self._r, np.eye(3), axisb=0, axisc=0)
        placed = np.allclose(work[:3], np.eye(3)) and np.allclose(turned, there, atol=1e-9)
        if not placed or np.linalg.eigvalsh(base.answers(0.0).E[np.ix_(self._on, self._on)]).min() <= 0.0:
            allowed = "forces along x, y and z at one place, of a model with residual flexibility, are allowed"
            raise InputError("system", "loads", ", ".join(loads), allowed)

    def _unbent(self, t: float, q: Array, R: Array) -> tuple[Array, Array]:
        """Where the place is from O in the boom's axes with nothing on the hook, (3,) m, and B_h (n, 3)."""
        answers, X = self._base.answers(t), np.cumsum(self._base.extended(t).value)[self._section]
        B = answers.B[:, self._on]
        beside = self._base.boom.weight(self._base.weight(t) * R[2], len(answers.E)) + np.array(self._inputs.loads(t))
        sagging = answers.E[self._on] @ beside
        return self._base.boom.boom.place + [X, 0.0, 0.0] + self._r + B.T @ q + sagging, B

    def place(self, t: float, x: Array, q: Array) -> Array:
        """In space, of nothing on the hook."""
        _, _, _, R = self._base.kinematics(x, 0.0 * x)
        return np.asarray(self._base.origin(x) + R @ self._unbent(t, q, R)[0])

    def _parts(self, t: float, place: Array, z: Array) -> tuple[Array, Array, Array, Array]:
        """Force f (3,) of the hook on the boom, how z moves what it measures (3, N), 1/E_h, and R."""
        k = self._base.count
        x, q = z[3 : 3 + k], z[3 + k :]
        turned, _, _, R = self._base.kinematics(x, 0.0 * x)
        at = R.T @ (place + z[:3] - self._base.origin(x))
        unbent, B = self._unbent(t, q, R)
        spring = np.linalg.inv(self._base.answers(t).E[np.ix_(self._on, self._on)])
        moved = np.hstack([R.T, np.cross(at, turned[3:], axisb=0, axisc=0) - turned[:3], -B.T])
        return spring @ (at - unbent), moved, spring, R

    def force(self, t: float, place: Array, z: Array) -> Array:
        """On hook, base and coordinates, (N,)."""
        f, moved, _, _ = self._parts(t, place, z)
        return np.asarray(-moved.T @ f)

    def stiffness(self, t: float, place: Array, z: Array) -> Array:
        """(N, N) N/m."""
        _, moved, spring, _ = self._parts(t, place, z)
        return np.asarray(moved.T @ spring @ moved)
