r"""A boom on a rigid body of the user's own in Exudyn: an object on the body's node and on those of the sections.

It adds what `pmr.simulation.free_base` says of base and coordinates.  With the node's coordinates x and theta, and the
boom's axes A and its pivot c in the body's,

.. math::
    \begin{pmatrix} a \\ \alpha \end{pmatrix} = \Lambda \begin{pmatrix} \ddot x \\ \ddot\theta \end{pmatrix} + \gamma,
    \qquad \Lambda = \begin{pmatrix} A^T R^T & -A^T \tilde c\, G \\ 0 & A^T G \end{pmatrix}

with the body's rotation R and its angular velocity G theta' in its own axes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import exudyn as exu
import numpy as np
from exudyn.itemInterface import ObjectGenericODE2
from exudyn.rigidBodyUtilities import (
    EulerParameters2GLocal,
    EulerParameters2RotationMatrix,
    RotXYZ2GLocal,
    RotXYZ2GLocal_t,
    RotXYZ2RotationMatrix,
)
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.scene import Scene
from pmr.scene.frame import INERTIA
from pmr.scene.frame_terms import frame_terms
from pmr.scene.names import input_of
from pmr.scene.signals import Constant
from pmr.simulation.exudyn.contacts import Contacts
from pmr.simulation.exudyn.equations import Equations
from pmr.simulation.exudyn.inputs import Driving, Inputs
from pmr.simulation.exudyn.items import SystemItems
from pmr.simulation.floating import Extended, Moments, Motion
from pmr.simulation.free_base import FreeBase
from pmr.system.system import System

Array = NDArray[np.float64]


@dataclass(frozen=True)
class OnBody:
    """Where a boom sits: its pivot and its axes on a rigid body of the mbs, whose coordinates then carry the boom."""

    body: Any  # number of an ObjectRigidBody, such as CreateRigidBody returns
    scene: Scene  # of the system: pivot, sections, weight
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)  # of the pivot, m from the body's reference point
    axes: Array = field(default_factory=lambda: np.eye(3))  # (3, 3): the boom's x, y, z as columns, in the body's axes


@dataclass(frozen=True)
class Rotations:
    """R (3, 3), G (3, k) and G' theta' (3,) of a kind of node, from coordinates and rates (k,) of its rotation."""

    matrix: Callable[[Array], Array]
    velocity: Callable[[Array], Array]
    remainder: Callable[[Array, Array], Array]


ROTATIONS = {
    "RigidBodyEP": Rotations(EulerParameters2RotationMatrix, EulerParameters2GLocal, lambda angles, rates: np.zeros(3)),
    "RigidBodyRxyz": Rotations(
        RotXYZ2RotationMatrix, RotXYZ2GLocal, lambda angles, rates: RotXYZ2GLocal_t(angles, rates) @ rates
    ),
}


@dataclass(frozen=True)
class Answers:
    """Of inputs f (i,): forces B f on the coordinates (n,), and displacements B^T q + E f (i,) of where they act."""

    B: Array
    E: Array


class Base:
    """Places, loads and the base's motion at a time, and what has to be added to Exudyn's equations for them."""

    def __init__(
        self, mbs: Any, equations: Equations, inputs: Inputs, paths: Mapping[str, Driving], on: OnBody
    ) -> None:
        self.boom, self._on, self._size = FreeBase(on.scene, equations.system, equations.assembly), on, equations.size
        carrier = mbs.GetObject(on.body)
        if carrier["objectType"] != "RigidBody":
            raise InputError("Exudyn", "objectType", carrier["objectType"], "a rigid body is allowed to carry a boom")
        self.node = carrier["nodeNumber"]
        known = mbs.GetNode(self.node)
        kind = known["nodeType"]
        if kind not in ROTATIONS:
            allowed = f"a rigid body with a node {' or '.join(ROTATIONS)} is allowed"
            raise InputError("Exudyn", "nodeType", kind, allowed)
        self.reference, self._rotations = np.array(known["referenceCoordinates"]), ROTATIONS[kind]
        self._gravity = on.scene.gravity.signal if on.scene.gravity else None
        self._contacts, self._equations, self._known = Contacts(equations, inputs), equations, dict[float, Answers]()
        self._paths = [_Path(name, paths.get(name), on.scene.time.step, mbs) for name in on.scene.names[1:]]

    @property
    def count(self) -> int:
        """Of the body's coordinates."""
        return len(self.reference)

    def weight(self, t: float) -> float:
        """Acceleration by which things fall at t s, m/s^2."""
        return 0.0 if self._gravity is None else float(self._gravity.value(t))

    def origin(self, x: Array) -> Array:
        """Where the pivot is, (3,) m, with the body's coordinates x."""
        angles = (x + self.reference)[3:]
        return (x + self.reference)[:3] + np.array(self._rotations.matrix(angles)) @ np.array(self._on.place)

    def extended(self, t: float) -> Extended:
        """How far the sections are out at t s."""
        known = np.array([(0.0, 0.0, 0.0), *(path.at(t) for path in self._paths)])
        return Extended(*known.T)

    def moments(self, t: float) -> Moments:
        """At t s, with what contacts that give way answer to inertia; rates by differences over a step."""
        h = self._on.scene.time.step
        before, now, after = (self.boom.moments(self.answers(max(at, 0.0)).B) for at in (t - h, t, t + h))
        return Moments(now, (after - before) / (2.0 * h if t >= h else h + t), (after - 2.0 * now + before) / h**2)

    def answers(self, t: float) -> Answers:
        """What inputs do at t s, with the contacts that give way; pads that only push, and rigid ones, left out."""
        key = round(t, 9)
        if key not in self._known:
            B, E = self._equations.B, self._equations.assembly.energy
            if not self._contacts.push and self._contacts.gives.any():
                x = self._equations.at({path.name: path.at(t)[0] for path in self._paths})
                rows = self._contacts.rows(x).at(0)
                B = self._contacts.springs(x)[0][:, self._size :]
                E = E - rows.H.T @ np.linalg.solve(rows.F, rows.H)
            self._known = dict(list(self._known.items())[-4:]) | {key: Answers(B, E)}
        return self._known[key]

    def kinematics(self, x: Array, rate: Array) -> tuple[Array, Array, Motion, Array]:
        """Lambda (6, k), gamma (6,), the motion of the boom's frame without weight, and its rotation (3, 3)."""
        angles, c, A = (x + self.reference)[3:], np.array(self._on.place), self._on.axes
        R, G = np.array(self._rotations.matrix(angles)), np.array(self._rotations.velocity(angles))
        omega, left = G @ rate[3:], self._rotations.remainder(angles, rate[3:])
        found = np.zeros((6, len(x)))
        found[:3, :3], found[:3, 3:], found[3:, 3:] = (R @ A).T, -A.T @ np.cross(c, G, axisb=0, axisc=0), A.T @ G
        gamma = np.append(A.T @ (np.cross(left, c) + np.cross(omega, np.cross(omega, c))), A.T @ left)
        return found, gamma, Motion(A.T @ omega, np.zeros(3)), R @ A

    def at(self, t: float, x: Array, rate: Array, loads: Array) -> tuple[Array, Array]:
        """Mass (N, N) and force (N,) on the body's coordinates and the boom's, of both's coordinates x and rates."""
        k, n = self.count, self._size
        turned, gamma, motion, R = self.kinematics(x[:k], rate[:k])
        extended = self.extended(t)
        pressed = self.boom.at(
            replace(motion, weight=self.weight(t) * R[2]), extended, x[k:], rate[k:], self.moments(t)
        )
        L = np.zeros((6 + n, k + n))
        L[:6, :k], L[6:, k:] = turned, np.eye(n)
        own, known = pressed.mass[: 6 + n], np.concatenate([gamma, np.zeros(n), extended.second])
        force = -pressed.forces[: 6 + n] - own @ known
        force[:6] += self.boom.loads(loads, extended)
        return L.T @ own[:, : 6 + n] @ L, L.T @ force


class _Path:
    """A path, its kinks spread over one step of h: a signal, an object as one, or a function of the mbs and the time.

    The rates of a function are those of the parabola through its values around t, half a step apart.
    """

    def __init__(self, name: str, path: Any, h: float, mbs: Any = None) -> None:
        if not (hasattr(path, "value") and hasattr(path, "rate")) and not callable(path):
            allowed = "a signal, an object with value(t) and rate(t), or a function of mbs and t is allowed"
            raise InputError("system", f"paths.{name}", None, allowed)
        self.name, self._path, self._h, self._mbs = name, path, h, mbs

    def at(self, t: float) -> tuple[float, float, float]:
        """Value in m, rate and second rate."""
        half = self._h / 2.0
        if not hasattr(self._path, "rate"):
            middle = max(t, half)  # no time before the start is asked for
            before, now, after = (float(self._path(self._mbs, at)) for at in (middle - half, middle, middle + half))
            second = (after - 2.0 * now + before) / half**2
            return _value(self._path, self._mbs, t), (after - before) / self._h + second * (t - middle), second
        last, first = t + half, max(t - half, 0.0)
        second = (float(self._path.rate(last)) - float(self._path.rate(first))) / (last - first)
        return float(self._path.value(t)), float(self._path.rate(t)), second


def _value(driving: Any, mbs: Any, t: float) -> float:
    """Of a signal or function."""
    return float(driving.value(t) if hasattr(driving, "value") else driving(mbs, t))


def driven_by_base(system: System, loads: Mapping[str, Driving]) -> dict[str, Driving]:
    """The loads, and those at zero by which a frame would accelerate the boom: its base does so."""
    nothing = Constant(amount=0.0)
    return dict(loads) | {one: nothing for one in system.input_names if INERTIA in one}


def terms_on_base(loads: Mapping[str, Driving], paths: Mapping[str, Driving], on: OnBody) -> dict[str, Driving]:
    """Amplitudes of the terms: of the stress that loads make, for all others are the base's.

    An InputError is raised where an extension is neither a signal nor a function.
    """
    for name in on.scene.names[1:]:
        _Path(name, paths.get(name), on.scene.time.step)
    nothing, found = Constant(amount=0.0), dict[str, Driving]()
    for one in frame_terms(on.scene):
        found[one.name] = nothing
        if one.of in ("load", "cylinder load"):
            found[one.name] = loads.get(input_of(one.carried or one.bodies[0], one.component), nothing)
        if one.of == "cylinder load":
            found[one.name] = partial(_pushed, found[one.name], paths.get(on.scene.names[one.number]))
    return found


def _pushed(load: Any, extension: Any, mbs: Any, t: float) -> float:
    """Minus what a cylinder pushes with against a load along it, over its length, N/m."""
    return _value(load, mbs, t) / _value(extension, mbs, t)


def with_base(mbs: Any, items: SystemItems, base: Base, inputs: Inputs) -> SystemItems:
    """The same items, and the object that couples them with the body."""
    count = base.count + sum(len(mbs.GetNode(node)["referenceCoordinates"]) for node in items.nBodies.values())
    nothing = exu.MatrixContainer(np.zeros((count, count)))
    key, found = None, (np.empty(0), np.empty(0))

    def at(t: float, q: Any, q_t: Any) -> tuple[Array, Array]:
        nonlocal key, found
        x, rate = np.array(q), np.array(q_t)
        asked = (t, x.tobytes(), rate.tobytes())
        if asked != key:  # mass and forces are asked for one after the other
            key, found = asked, base.at(t, x, rate, np.array(inputs.loads(t)))
        return found

    name = f"{mbs.GetMarker(items.mSystem)['name']}Base"
    oBase = mbs.AddObject(
        ObjectGenericODE2(
            name=name,
            nodeNumbers=[base.node, *items.nBodies.values()],
            massMatrix=np.zeros((count, count)),
            massMatrixUserFunction=lambda mbs, t, item, q, q_t: at(t, q, q_t)[0],
            forceUserFunction=lambda mbs, t, item, q, q_t: at(t, q, q_t)[1],
            jacobianUserFunction=lambda *arguments: nothing,  # inertia decides within a step
        )
    )
    return replace(items, oBase=oBase, base=base)
