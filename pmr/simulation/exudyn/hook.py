r"""A hook on a boom that rides on a body in Exudyn: a point with a mass, to which ropes and all else are attached.

Where three loads of the model act along x, y and z, the boom moves by :math:`B^T q + E f`, what follows the forces at
once included, and bends shorter by :math:`q^T G q / 2` where the system has second order.  So the hook at x holds, with
its force f on the boom in the boom's axes and the loads f_w that act beside, those of the weight among them,

.. math:: g = R^T (x - x_O) - d - r - B_h^T q + \tfrac12 e_x\, q^T G q - E_{hw} f_w - E_h f = 0

a constraint whose multiplier is f.  By virtual work f acts on the base too, at the place where the hook is, so that
momentum stays.  Coordinates w in m without mass carry :math:`E_h w = e E_h f`, with e the largest of E_h; where nothing
gives way they are held at zero.
"""

# ruff: noqa: N815 - items are numbered as Exudyn users do

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import exudyn as exu
import numpy as np
from exudyn.itemInterface import (
    MarkerNodePosition,
    MarkerObjectODE2Coordinates,
    NodePoint,
    ObjectConnectorCoordinateVector,
    ObjectGenericODE2,
    ObjectMassPoint,
)
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.simulation.exudyn.free_base import Base
from pmr.simulation.exudyn.items import SystemItems, add_coordinates
from pmr.simulation.start import InitialState

Array = NDArray[np.float64]

#: Of the largest flexibility: less gives nothing; and m/N, the largest of a model that does not give way.
ROUND_OFF, TINY = 1e-9, 1e-20


@dataclass(frozen=True)
class Hook:
    """Numbers of the items of a hook in an mbs."""

    nHook: Any  # NodePoint
    oHook: Any  # ObjectMassPoint on it
    mHook: Any  # MarkerNodePosition
    oJoint: Any  # ObjectConnectorCoordinateVector that joins it to the boom; its Force is that on the boom, in its axes


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
        If the boom stands on the ground, or the model has no such inputs at one place.
    """
    base = items.base
    if base is None:
        raise InputError("Exudyn", "on", None, "a boom on a rigid body is allowed to carry a hook")
    if base.paths.free:
        allowed = "signals and functions are allowed as extensions of a boom that carries a hook"
        raise InputError("system", f"paths.{next(iter(base.paths.free))}", "NodeCoordinate", allowed)
    joint = _Joint(base, items, loads)
    start = np.concatenate([mbs.GetNode(node)["initialCoordinates"] for node in items.nBodies.values()])
    carrier = np.array(mbs.GetNode(base.node)["initialCoordinates"])
    place = joint.place(0.0, carrier, start)
    name = f"{mbs.GetMarker(items.mSystem)['name']} {loads[2]}"
    node = mbs.AddNode(NodePoint(name=name, referenceCoordinates=place))
    nForce = add_coordinates(mbs, f"{name} force", InitialState.at_rest(3))
    size = 6 + base.count + len(start)
    oGiven = mbs.AddObject(
        ObjectGenericODE2(
            name=f"{name} gives",
            nodeNumbers=[nForce, node, base.node, *items.nBodies.values()],
            massMatrix=_corner(joint.firm, size),
            forceUserFunction=lambda mbs, t, item, q, q_t: -joint.given(t, size) @ np.array(q),
            jacobianUserFunction=lambda mbs, t, item, q, q_t, factor, factor_t: exu.MatrixContainer(
                factor * joint.given(t, size)
            ),
        )
    )
    oJoint = mbs.AddObject(
        ObjectConnectorCoordinateVector(
            name=name,
            markerNumbers=[items.mGround, mbs.AddMarker(MarkerObjectODE2Coordinates(objectNumber=oGiven))],
            scalingMarker0=np.zeros((3, 1)),  # its height is the number of rows
            constraintUserFunction=lambda mbs, t, item, q, q_t, velocity: joint.gap(t, np.array(q)),
            jacobianUserFunction=lambda mbs, t, item, q, q_t, velocity: joint.moved(t, np.array(q)),
        )
    )
    return Hook(
        node,
        mbs.AddObject(ObjectMassPoint(name=f"{name} mass", mass=mass, nodeNumber=node)),
        mbs.AddMarker(MarkerNodePosition(name=name, nodeNumber=node)),
        oJoint,
    )


def _corner(A: Array, size: int) -> Array:
    """A (3, 3) as the first block of a matrix (size, size)."""
    found = np.zeros((size, size))
    found[:3, :3] = A
    return found


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
        E = self._given(0.0)
        if not (np.allclose(work[:3], np.eye(3)) and np.allclose(turned, there, atol=1e-9)):
            allowed = "forces along x, y and z at one place are allowed"
            raise InputError("system", "loads", ", ".join(loads), allowed)
        values, vectors = np.linalg.eigh(E)
        stiff = vectors[:, values <= ROUND_OFF * max(base.answers(base.extended(0.0).value).E.max(), TINY)]
        self.firm = stiff @ stiff.T  # onto the directions in which nothing gives way at once
        self._scale = float(values[-1]) if values[-1] > 0.0 else 1.0
        self._shortened = list(base.boom.shortened_by(loads[0]))

    def _given(self, t: float) -> Array:
        return self._base.answers(self._base.extended(t).value).E[np.ix_(self._on, self._on)]

    def given(self, t: float, size: int) -> Array:
        """E_h / e at t s and what holds w elsewhere, (size, size), over e: N/m."""
        return _corner(self._given(t) / self._scale + self.firm, size) / self._scale

    def _bent(self, t: float, q: Array) -> Array:
        """G q (n,) at t s."""
        extended = self._base.extended(t).value
        parts = [(G if k is None else G / extended[k]) @ q for k, G in self._shortened]
        return np.asarray(sum(parts, np.zeros_like(q)))

    def _unbent(self, t: float, q: Array, R: Array) -> tuple[Array, Array]:
        """Where the place is from O in the boom's axes with nothing on the hook, (3,) m, and how q moves it (3, n)."""
        extended = self._base.extended(t).value
        answers, X = self._base.answers(extended), np.cumsum(extended)[self._section]
        moved, bent = answers.B[:, self._on].T, np.outer([1.0, 0.0, 0.0], self._bent(t, q))
        beside = self._base.boom.weight(self._base.weight(t) * R[2], len(answers.E)) + np.array(self._inputs.loads(t))
        sagging = answers.E[self._on] @ beside
        return self._base.boom.boom.place + [X, 0.0, 0.0] + self._r + (moved - bent / 2.0) @ q + sagging, moved - bent

    def place(self, t: float, x: Array, q: Array) -> Array:
        """In space, of nothing on the hook."""
        _, _, _, R = self._base.kinematics(x, 0.0 * x)
        return np.asarray(self._base.origin(x) + R @ self._unbent(t, q, R)[0])

    def gap(self, t: float, z: Array) -> Array:
        """G (3,) m of w, hook, base and coordinates z, as a marker has them: with those of reference."""
        x, q = self._split(z)
        _, _, _, R = self._base.kinematics(x, 0.0 * x)
        at = R.T @ (z[3:6] - self._base.origin(x))
        return np.asarray(at - self._unbent(t, q, R)[0] - self._given(t) @ z[:3] / self._scale)

    def moved(self, t: float, z: Array) -> Array:
        """Its derivative (3, N)."""
        x, q = self._split(z)
        turned, _, _, R = self._base.kinematics(x, 0.0 * x)
        at = R.T @ (z[3:6] - self._base.origin(x))
        on_base = np.cross(at, turned[3:], axisb=0, axisc=0) - turned[:3]
        return np.hstack([-self._given(t) / self._scale, R.T, on_base, -self._unbent(t, q, R)[1]])

    def _split(self, z: Array) -> tuple[Array, Array]:
        """Coordinates of the base, and of the boom."""
        k = self._base.count
        return z[6 : 6 + k] - self._base.reference, z[6 + k :]
