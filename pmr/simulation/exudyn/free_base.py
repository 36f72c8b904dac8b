r"""A boom on a rigid body of the user's own in Exudyn: an object on the nodes of body and sections.

The object adds the equations of `pmr.simulation.free_base` for base and coordinates.  With the node's coordinates x and
theta (displacement and rotation), the body's rotation R and its angular velocity G theta' in the body's axes, and the
boom's axes A and its pivot c in the body's axes, the accelerations a and alpha of the boom's frame are

.. math::
    \begin{pmatrix} a \\ \alpha \end{pmatrix} = \Lambda \begin{pmatrix} \ddot x \\ \ddot\theta \end{pmatrix} + \gamma,
    \qquad \Lambda = \begin{pmatrix} A^T R^T & -A^T \tilde c\, G \\ 0 & A^T G \end{pmatrix}

in which gamma collects what is quadratic in the rates.

Extensions s may be coordinates of the user's nodes: forces of contacts and loads then act on the boom's coordinates q
and on s.  Contacts that give way have rows C, displacements H by loads f, flexibility F, displacements g = C q + H f
and forces :math:`\lambda = F^{-1} g`.  A cylinder of length l = s that leans by q and carries a load f along x has the
shortening matrix G.  Together they store

.. math::
    V(q, s) = \tfrac12 g^T F^{-1} g + \frac{f}{2 l}\, q^T G q,

so that the force on q is :math:`-C^T \lambda - f G q / l`, and that on a path

.. math::
    F_s = -\lambda^T (C' q + H' f) + \tfrac12 \lambda^T F' \lambda + \frac{f}{2 l^2}\, q^T G q.

A prime marks derivatives by s.  The derivative of :math:`\lambda` by s uses w = C' q + H' f - F' :math:`\lambda`.  If
pads only push, :math:`\lambda` and F are those of the closed pads.  Rigid contacts are constraints C(s) q = 0 of q and
s.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple

import exudyn as exu
import exudyn.itemInterface as eii
import exudyn.rigidBodyUtilities as erb
import numpy as np
import scipy.linalg

from pmr.errors import InputError
from pmr.files.arrays import Array
from pmr.scene import Scene
from pmr.scene.keys import LUFFING, input_name
from pmr.scene.mechanism import frame_terms
from pmr.scene.rotation import skew
from pmr.scene.signals import Constant
from pmr.simulation.exudyn.contacts import Contacts
from pmr.simulation.exudyn.equations import Driving, Equations, Inputs, NodeCoordinate, Paths, check_path, driving_value
from pmr.simulation.exudyn.formulations import Start, zero_jacobian
from pmr.simulation.exudyn.items import Steps, SystemItems, add_bodies, with_contacts
from pmr.simulation.free_base import FrameMotion, FreeBase, Moments, base_equations
from pmr.system.changing_rows import ChangingRows, EliminatedContacts


def add_without_contacts(mbs: exu.MainSystem, equations: Equations, inputs: Inputs, start: Start) -> SystemItems:
    """Add nodes and items of the bodies in the states `start`; contacts are added later, with the base."""
    steps = Steps(held=bool(Contacts(equations, inputs).rigid.any()))
    jacobian, force = zero_jacobian(equations, steps), equations.B @ inputs.values_at(0.0).loads
    items = add_bodies(mbs, equations, inputs, start, forceVector=force, jacobianUserFunction=jacobian)

    def update(mbs: exu.MainSystem, t: float) -> bool:
        """Pre-step function: set the force vector to the loads at t."""
        inputs.begin(t)
        mbs.SetObjectParameter(items.oSystem, "forceVector", equations.B @ inputs.values_at(t).loads)
        return True

    return steps.attach_update(mbs, items, update)


class ForcesAndStiffness(NamedTuple):
    """Forces (N,) on N coordinates, and their stiffness (N, N)."""

    forces: Array
    stiffness: Array


class AddedEquations(NamedTuple):
    """Mass (N, N), force (N,) and stiffness (N, N) of N coordinates."""

    mass: Array
    force: Array
    stiffness: Array


class ExtendingBoom:
    """Forces, stiffness and rigid rows between coordinates q (n,) and extensions s (S,) in m."""

    def __init__(
        self, equations: Equations, contacts: Contacts, boom: FreeBase, paths: Paths, along: ChangingRows
    ) -> None:
        """Find which extensions of a `boom` on its base are coordinates, and which loads shorten cylinders there.

        `paths` has all extensions.  `along` has the rows of `contacts` as functions of the extensions.  `equations` are
        those of the system.
        """
        self._contacts, self._along, self.rigid = contacts, along, np.flatnonzero(contacts.rigid)
        self._numbers = np.flatnonzero(paths.along.any(axis=1))
        self._leaning = [
            (number, k, G)
            for number, name in enumerate(equations.system.input_names)
            for k, G in boom.load_shortenings(name)
            if k is not None and k in self._numbers
        ]

    def forces_and_stiffness(self, s: Array, q: Array, f: Array) -> ForcesAndStiffness:
        """Restoring forces (n + S,) and stiffness (n + S, n + S) on n coordinates and S extensions.

        The forces stand on the left-hand side of the equations of motion, beside the inertia.  The forces and the
        stiffness are those at the extensions s (S,) in m and the coordinates q (n,), under the loads f (i,) in N of the
        inputs.
        """
        n, S, numbers = len(q), len(s), self._numbers
        near = self._along.evaluate(s)
        now, slopes = near.rows.select(self._contacts.gives), near.slopes.select(self._contacts.gives)
        C, F, H = (A[numbers] for A in (slopes.C, slopes.F, slopes.H))
        forces = self._contacts.forces_by_motion(now, now.C @ q + now.H @ f)
        gaps, bent = C @ q + H @ f, F @ forces  # (e, m)
        total, K = np.zeros(n + S), np.zeros((n + S, n + S))
        total[:n], total[n + numbers] = -now.C.T @ forces, -gaps @ forces + bent @ forces / 2.0
        closed = self._contacts.closed
        w = np.hstack([now.C, np.zeros((len(forces), S))])
        w[:, n + numbers] = (gaps - bent).T
        w = w[closed]
        K += w.T @ np.linalg.solve(now.F[np.ix_(closed, closed)], w)
        K[:n, n + numbers] += (forces @ C).T
        K[n + numbers, :n] += forces @ C
        for load, k, G in self._leaning:
            push, l, Gq = f[load], s[k], G @ q
            total[:n] -= push / l * Gq
            total[n + k] += push / l**2 * (q @ Gq) / 2.0
            K[:n, :n] += push / l * G
            K[:n, n + k] -= push / l**2 * Gq
            K[n + k, :n] -= push / l**2 * Gq
            K[n + k, n + k] += push / l**3 * (q @ Gq)
        return ForcesAndStiffness(total, K)

    def gap(self, s: Array, q: Array) -> Array:
        """Gaps C(s) q (k,) in m of the k rigid contacts, at extensions s (S,) in m and coordinates q (n,)."""
        return np.asarray(self._along.evaluate(s).rows.C[self.rigid] @ q)

    def gap_derivative(self, s: Array, q: Array) -> Array:
        """Derivative (k, n + S) of the gaps of k rigid contacts by coordinates q (n,) and extensions s (S,) in m."""
        near, numbers = self._along.evaluate(s), self._numbers
        derivative = np.hstack([near.rows.C[self.rigid], np.zeros((len(self.rigid), len(s)))])
        derivative[:, len(q) + numbers] = (near.slopes.C[numbers][:, self.rigid] @ q).T
        return derivative


@dataclass(frozen=True)
class OnBody:
    """Pivot and axes of a boom on a rigid body of the mbs, which then carries the boom.

    Raises InputError if the axes are no rotation.
    """

    body: exu.ObjectIndex  # number of an ObjectRigidBody, such as CreateRigidBody returns
    scene: Scene  # scene of the system, with pivot, sections and weight
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m: position of the pivot from the body's reference point
    axes: Array = field(default_factory=lambda: np.eye(3))  # (3, 3): columns are the boom's x, y, z in the body's axes

    def __post_init__(self) -> None:
        """Raise InputError unless the axes are those of a rotation."""
        A = np.asarray(self.axes, float)
        if A.shape != (3, 3) or not np.allclose(A.T @ A, np.eye(3), atol=1e-9) or np.linalg.det(A) < 0.0:
            allowed = "a matrix (3, 3) of three orthogonal unit vectors in columns, right-handed, is allowed"
            raise InputError("Exudyn", "OnBody.axes", None, allowed)


@dataclass(frozen=True)
class Rotations:
    """Functions of a kind of node with k rotation coordinates theta, for R (3, 3), G (3, k) and G' theta' (3,).

    R is the rotation and G theta' the angular velocity.  `matrix` and `velocity` return R and G from the coordinates
    (k,), `remainder` returns G' theta' from the coordinates and their rates.
    """

    matrix: Callable[[Array], Array]
    velocity: Callable[[Array], Array]
    remainder: Callable[[Array, Array], Array]


ROTATIONS = {
    "RigidBodyEP": Rotations(
        erb.EulerParameters2RotationMatrix, erb.EulerParameters2GLocal, lambda angles, rates: np.zeros(3)
    ),
    "RigidBodyRxyz": Rotations(
        erb.RotXYZ2RotationMatrix, erb.RotXYZ2GLocal, lambda angles, rates: erb.RotXYZ2GLocal_t(angles, rates) @ rates
    ),
}


class BodyMotion(NamedTuple):
    """Motion of a boom's frame by the k coordinates of the body below it; symbols as in the module's docstring."""

    by_rates: Array  # Lambda (6, k)
    quadratic: Array  # gamma (6,)
    omega: Array  # (3,) rad/s: angular velocity in the boom's axes
    axes: Array  # (3, 3): columns are the boom's axes in space


class Coordinates(NamedTuple):
    """Coordinates of a boom on its base."""

    base: Array  # (k,)
    boom: Array  # (n,)
    s: Array  # (P,) m: of the paths


class Base:
    """Base of a boom on a rigid body: motion of the base, and parts to be added to Exudyn's equations, at a time."""

    def __init__(
        self, mbs: exu.MainSystem, equations: Equations, inputs: Inputs, paths: Mapping[str, Driving], on: OnBody
    ) -> None:
        """Prepare the boom on the rigid body that `on` names in the mbs, driven by `inputs` and `paths`.

        `equations` are those of the boom's system.  Raises InputError if the body is not a rigid body, if its node is
        of a kind that is not in `ROTATIONS`, or if a luffing cylinder with a stiffness holds the base.  Also raises the
        errors of `FreeBase`.
        """
        if LUFFING in equations.system.paths:
            allowed = "a support of the base in its place is allowed where a body of Exudyn carries the boom"
            raise InputError("scene", "frame.cylinder.stiffness", None, allowed)
        self.boom, self._on, self._size = FreeBase(on.scene, equations.system, equations.assembly), on, equations.size
        carrier = mbs.GetObject(on.body)
        if carrier["objectType"] != "RigidBody":
            raise InputError("Exudyn", "objectType", carrier["objectType"], "a rigid body is allowed to carry a boom")
        self.node = carrier["nodeNumber"]
        node = mbs.GetNode(self.node)
        kind = node["nodeType"]
        if kind not in ROTATIONS:
            allowed = f"a rigid body with a node {' or '.join(ROTATIONS)} is allowed"
            raise InputError("Exudyn", "nodeType", kind, allowed)
        self.reference, self._rotations = np.array(node["referenceCoordinates"]), ROTATIONS[kind]
        self._gravity = on.scene.gravity.signal if on.scene.gravity else None
        contacts = Contacts(equations, inputs)
        self.paths = Paths(mbs, on.scene, paths, self.boom.aside)
        self.along = ChangingRows(equations.assembly, self.paths.names)
        gives = contacts.gives & (not contacts.any_pushes)
        self._gives, self._inputs = bool(gives.any()), equations.B.shape[1]
        self.answering = EliminatedContacts(equations.assembly, self.along, gives)
        self._moments: Moments | None = None
        self._moments_key = b""
        self.extending = (
            ExtendingBoom(equations, contacts, self.boom, self.paths, self.along) if self.paths.free else None
        )

    @property
    def count(self) -> int:
        """Number k of the body's coordinates."""
        return len(self.reference)

    def weight(self, t: float) -> float:
        """Acceleration of gravity at t s in m/s^2."""
        return 0.0 if self._gravity is None else float(self._gravity.value(t))

    def origin(self, x: Array) -> Array:
        """Position (3,) in m of the pivot, with the body's k coordinates at displacements x (k,)."""
        angles = (x + self.reference)[3:]
        return (x + self.reference)[:3] + np.array(self._rotations.matrix(angles)) @ np.array(self._on.place)

    def split(self, t: float, z: Array) -> Coordinates:
        """Coordinates of the base (k,), the boom (n,) and the m paths at the time t in s.

        z (k + n + m,) are the coordinates of the nodes of base, boom and paths, as a marker returns them.  They include
        reference values, which are subtracted.
        """
        k, n, x = self.count, self.boom.size, z.copy()
        x[:k] -= self.reference
        x[k + n :] -= self.paths.reference
        return self.split_displacements(t, x)

    def split_displacements(self, t: float, x: Array) -> Coordinates:
        """Coordinates at t s, from the displacements x (k + n + m,) of all nodes."""
        k, n = self.count, self.boom.size
        return Coordinates(x[:k], x[k : k + n], self.paths.extensions(t, x[k + n :], x[k + n :]).value)

    def kinematics(self, x: Array, rate: Array) -> BodyMotion:
        """Motion of the body with its k coordinates at displacements x (k,) with the rates `rate` (k,)."""
        angles, c, A = (x + self.reference)[3:], skew(np.array(self._on.place)), self._on.axes
        R, G = np.array(self._rotations.matrix(angles)), np.array(self._rotations.velocity(angles))
        omega, remainder = G @ rate[3:], self._rotations.remainder(angles, rate[3:])
        turned = np.zeros((6, len(x)))
        turned[:3, :3], turned[:3, 3:], turned[3:, 3:] = (R @ A).T, -A.T @ c @ G, A.T @ G
        gamma = np.append(-A.T @ (c @ remainder + skew(omega) @ c @ omega), A.T @ remainder)
        return BodyMotion(turned, gamma, A.T @ omega, R @ A)

    def inertia(self, mbs: exu.MainSystem, t: float) -> Array:
        """Loads (i,) of the boom's inertia and weight by the body's current motion, at t s.

        Contacts that give way deform under these loads without delay.  The result is zero if no contact gives way, or
        if any contact only pushes.
        """
        loads = np.zeros(self._inputs)
        if not self._gives:
            return loads
        of = exu.OutputVariableType
        nodes, kinds = (self.node, *self.paths.nodes), (of.Coordinates, of.Coordinates_t, of.Coordinates_tt)
        states = [[np.atleast_1d(mbs.GetNodeOutput(node, kind)) for node in nodes] for kind in kinds]
        x, rate, second = (state[0] for state in states)
        z, z_t, z_tt = (np.concatenate([np.empty(0), *state[1:]]) for state in states)
        at, extended = self.kinematics(x, rate), self.paths.extensions(t, z, z_t)
        extended = replace(extended, second=extended.second + self.paths.along @ z_tt)
        motion = FrameMotion(at.omega, self.weight(t) * at.axes[2])
        return self.boom.inertia(motion, at.by_rates @ second + at.quadratic, extended, loads)

    def added_equations(self, t: float, x: Array, rate: Array, loads: Array) -> AddedEquations:
        """Mass (N, N), force (N,) and stiffness (N, N) to be added, for N coordinates of body, boom and user's nodes.

        x and `rate` (N,) are displacements and rates of these coordinates at t s, `loads` (i,) the loads on the inputs.
        """
        k, n = self.count, self._size
        at = self.kinematics(x[:k], rate[:k])
        q, extended = x[k : k + n], self.paths.extensions(t, x[k + n :], rate[k + n :])
        motion = FrameMotion(at.omega, self.weight(t) * at.axes[2])
        key = extended.value.tobytes() + extended.rate.tobytes()
        if self._gives and key != self._moments_key:  # a prescribed extension stays the same while Exudyn iterates
            self._moments_key, self._moments = key, self.boom.moments_with_contacts(self.answering, extended)
        pressed = base_equations(self.boom.boom, motion, extended, q, rate[k : k + n], self._moments)
        L = scipy.linalg.block_diag(at.by_rates, np.eye(n), self.paths.along)
        force = -pressed.forces - pressed.mass @ np.concatenate([at.quadratic, np.zeros(n), extended.second])
        stiffness = np.zeros((k + n, k + n))
        force[:6] += self.boom.load_wrench(loads, extended)
        if self.extending is not None:
            pushes, K = self.extending.forces_and_stiffness(extended.value, q, loads)
            force[6:] += pushes
            force[6 + n :] += self.boom.path_forces(loads)
            inner = L[6:, k:]
            stiffness = scipy.linalg.block_diag(np.zeros((k, k)), inner.T @ K @ inner)
        return AddedEquations(L.T @ pressed.mass @ L, L.T @ force, stiffness)


def terms_on_base(loads: Mapping[str, Driving], paths: Mapping[str, Driving], on: OnBody) -> dict[str, Driving]:
    """Amplitudes by name of the terms of the bodies `on` a base, driven by `loads` and `paths`.

    Only terms of loads have amplitudes other than zero, because the base adds all other terms itself.  The term of a
    load on a cylinder is zero, too, if the cylinder's extension is a coordinate of a node.  Raises InputError for a
    path that is missing, or that is neither a signal, nor a function, nor a `NodeCoordinate`.
    """
    for name in dict.fromkeys((*on.scene.names[1:], *paths)):
        check_path(name, paths.get(name))
    nothing, amplitudes = Constant(amount=0.0), dict[str, Driving]()
    for term in frame_terms(on.scene):
        amplitudes[term.name] = nothing
        if term.kind in ("load", "cylinder load"):
            amplitudes[term.name] = loads.get(
                input_name(term.carried_section or term.bodies[0], term.component), nothing
            )
        if term.kind == "cylinder load":
            path = paths.get(on.scene.names[term.number])
            free = isinstance(path, NodeCoordinate)
            amplitudes[term.name] = (
                nothing if path is None or free else partial(_cylinder_load, amplitudes[term.name], path)
            )
    return amplitudes


def _cylinder_load(load: Driving, extension: Driving, mbs: exu.MainSystem, t: float) -> float:
    """Force in N along a cylinder by `load`, divided by the cylinder's length `extension`, in N/m, at t s."""
    return driving_value(load, mbs, t) / driving_value(extension, mbs, t)


def with_base(mbs: exu.MainSystem, items: SystemItems, base: Base, inputs: Inputs) -> SystemItems:
    """Add the object by which the boom and the body below it act on each other; return the items with it.

    `base` computes the mass, force and stiffness of this object.  Rigid contacts along extensions that are coordinates
    of nodes get a connector, too.
    """
    nodes = [base.node, *items.nBodies.values(), *base.paths.nodes]
    count = sum(len(mbs.GetNode(node)["referenceCoordinates"]) for node in nodes)
    evaluated_at, evaluated = None, AddedEquations(*(np.empty(0),) * 3)

    def evaluate(t: float, q: Array, q_t: Array) -> AddedEquations:
        """Mass, force and stiffness at t s, computed once for the same coordinates q (n,) and rates q_t (n,)."""
        nonlocal evaluated_at, evaluated
        x, rate = np.array(q), np.array(q_t)
        arguments = (t, x.tobytes(), rate.tobytes())
        if arguments != evaluated_at:  # Exudyn calls for mass and forces one after the other
            evaluated_at, evaluated = arguments, base.added_equations(t, x, rate, inputs.values_at(t).loads)
        return evaluated

    name = items.component_name(mbs, "Base")
    oBase = mbs.AddObject(
        eii.ObjectGenericODE2(
            name=name,
            nodeNumbers=nodes,
            massMatrix=np.zeros((count, count)),
            massMatrixUserFunction=lambda mbs, t, item, q, q_t: evaluate(t, q, q_t).mass,
            forceUserFunction=lambda mbs, t, item, q, q_t: evaluate(t, q, q_t).force,
            # inertia dominates the Jacobian, except for energy stored along extensions
            jacobianUserFunction=lambda mbs, t, item, q, q_t, factor, factor_t: exu.MatrixContainer(
                factor * evaluate(t, q, q_t).stiffness
            ),
        )
    )
    items = replace(items, oBase=oBase, parts=replace(items.parts, base=base))
    if items.parts.rubbing is not None:
        items.parts.rubbing.inertia = lambda t: base.inertia(mbs, t)
    return items if base.extending is None else _with_rows(mbs, items, base, base.extending)


def _with_rows(mbs: exu.MainSystem, items: SystemItems, base: Base, extending: ExtendingBoom) -> SystemItems:
    """Add a connector for rigid contacts along extensions that are coordinates of nodes; return the items with it.

    `extending` computes the gaps of these contacts, on the boom of `base`.
    """
    k, n = base.count, base.boom.size

    def gap(t: float, z: Array) -> Array:
        """Gaps (m,) in m of the m contacts at t s, at the c coordinates z (c,) of the marker."""
        at = base.split(t, np.array(z))
        return extending.gap(at.s, at.boom)

    def gap_derivative(t: float, z: Array) -> Array:
        """Derivatives (m, c) of the gaps of the m contacts by all c coordinates z (c,) of the marker, at t s."""
        at = base.split(t, np.array(z))
        derivative = extending.gap_derivative(at.s, at.boom)
        return np.hstack([np.zeros((len(derivative), k)), derivative[:, :n], derivative[:, n:] @ base.paths.along])

    name = items.component_name(mbs, "Extended")
    marker = mbs.AddMarker(eii.MarkerObjectODE2Coordinates(name=name, objectNumber=items.oBase))
    connected = with_contacts(
        mbs,
        replace(items, mSystem=marker),
        extending.rigid,
        scalingMarker0=np.zeros((len(extending.rigid), 1)),  # its number of rows is that of the contacts
        constraintUserFunction=lambda mbs, t, item, q, q_t, velocity: gap(t, q),
        jacobianUserFunction=lambda mbs, t, item, q, q_t, velocity: gap_derivative(t, q),
    )
    return replace(connected, mSystem=items.mSystem)
