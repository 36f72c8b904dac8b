r"""The energy of a boom in space, and the work of what drives its frame, beyond those of the same boom when rigid.

With the velocity V = v_0 + omega x (p + X e_x + r) + X' e_x of points at rest in the frame, whose base moves by v_0,
c = V x omega, and g the weight,

.. math::
    E = \int \rho\, \bigl( V \cdot (\dot u + \omega \times u) + g\, e_Z \cdot u \bigr)
    + \tfrac12 \int \rho\, |\dot u + \omega \times u|^2 + U, \\
    \dot W = \int \rho\, \bigl( V \cdot \ddot u + 2 c \cdot \dot u + (\dot c + g\, \dot e_Z) \cdot u \bigr)
    + \int \rho\, (\ddot u + 2 \omega \times \dot u + \dot\omega \times u) \cdot (\omega \times u) + f \cdot \dot u

U is the strain energy.  W is done by the drives of the frame and of the extensions, which move all mass at its
deflected place, by loads, and by contacts that travel.  V is affine in r: momenta of the fields of
`pmr.simulation.frame` are all that is needed of u.  To u belongs, with second order, by how much sections and cylinders
are shorter along the axis as they bend; without it the integrals with two u but that of |u'|^2 are left out, as in the
equations of motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.compare.runs import run_from_start
from pmr.compare.summary import Part
from pmr.scene import Scene
from pmr.scene.frame import INERTIA, Frame
from pmr.scene.keys import input_of
from pmr.scene.mechanism import FrameTerm, frame_terms
from pmr.simulation import Excitation
from pmr.simulation.balance import dot, mean
from pmr.simulation.frame_motion import Turning
from pmr.system.body import SlidingBody
from pmr.system.states import SystemTrajectory
from pmr.system.system import System
from pmr.system.terms import Term

Array = NDArray[np.float64]
#: What fields grow with: none, x, y, z.
OVER = ("", "x", "y", "z")


@dataclass(frozen=True)
class InSpace:
    """In J at the times t (T,): the energy, and the work since the start, of the frame's drives and of all else."""

    t: Array
    energy: Array
    drives: Array
    others: Array

    @property
    def residual_energy(self) -> Array:
        """Change of energy that is nobody's work, (T,) J: damping takes it, or it is an error of the step."""
        return self.energy - self.energy[0] - self.drives - self.others


def in_space(scene: Scene, system: System, excitation: Excitation, run: SystemTrajectory) -> InSpace:
    """Energy of a scene with a frame; work is that of each step's means, which is of second order in the step."""
    account = _Account(scene, run)
    for name, body in system.bodies.items():
        account.add_fields(name, body, system)
    terms, amplitudes = {term.name: term for term in frame_terms(scene)}, excitation.amplitudes(system.term_names)
    for term, c in zip(system.terms, amplitudes.T, strict=True):
        account.add_term(terms[term.name], term, c)
    for number, name in enumerate(scene.names):
        account.add_momentum(number, account.moments[name])
    return InSpace(run.t, account.energy, _since_start(account.drives), _since_start(account.others))


def energy(scene: Scene, system: System, excitation: Excitation, run: SystemTrajectory | None) -> Part:
    """``energy`` of summary.json, in J from the start to the end; nothing without a frame.

    A run whose states were not kept, which takes microseconds a step, is made again.
    """
    if scene.frame is None:
        return Part()
    energies = in_space(scene, system, excitation, run or run_from_start(system, excitation))
    ends = {
        "change": energies.energy[-1] - energies.energy[0],
        "drives": energies.drives[-1],
        "others": energies.others[-1],
    }
    return Part(
        {"energy": {key: float(value) for key, value in ends.items()} | {"lost": -float(energies.residual_energy[-1])}}
    )


@dataclass(frozen=True)
class _Moments:
    """Integrals of rho u_j, then of rho u_j times x, y and z, (T, 4, 3), and their rates."""

    u: Array
    rate: Array


class _Account:
    """Energy (T,), and work of each step (T - 1,), to which bodies, terms and momenta are added in this order."""

    def __init__(self, scene: Scene, run: SystemTrajectory) -> None:
        assert scene.frame is not None  # of those who ask
        self._scene, self._run = scene, run
        self._turning = Turning.of(*scene.frame.angles, run.t, scene.frame.rocking)
        self._base = np.einsum("tji,tj->ti", self._turning.rotation, _of_base(scene.frame, run.t))
        none = np.zeros((len(run.t), len(OVER), 3))
        self.moments = {name: _Moments(none.copy(), none.copy()) for name in scene.names}
        self.energy, self.drives, self.others = run.energy.copy(), np.zeros(len(run.t) - 1), np.diff(run.work)

    def add_fields(self, name: str, body: SlidingBody, system: System) -> None:
        """Moments of a body; what inertia loads do in the frame is nobody's work in space."""
        moments, motion = self.moments[name], self._run.bodies[name]
        for column, of_input in enumerate(body.input_names):
            if of_input.startswith(INERTIA):
                field, b = of_input.removeprefix(INERTIA), np.asarray(body.B)[:, column]
                at = slice(None), OVER.index(field[1:]), "xyz".index(field[0])
                moments.u[at], moments.rate[at] = motion.q @ b, motion.v @ b
                load = self._run.loads[:, system.input_names.index(input_of(name, of_input))]
                self.others -= mean(load) * np.diff(moments.u[at])

    def add_term(self, of: FrameTerm, term: Term, c: Array) -> None:
        """One of second order with amplitudes c (T,)."""
        if of.of in ("load", "cylinder load"):  # whose work it is
            return
        q, v = (np.hstack([getattr(self._run.bodies[name], what) for name in term.bodies]) for what in "qv")
        G, V = ((0.0 * q.T if A is None else A @ q.T).T for A in (term.stiffness, term.damping))
        damped = 0.0 * q if term.damping is None else (term.damping @ v.T).T
        self.others += dot(mean(c[:, None] * (G + damped)), np.diff(q, axis=0))
        if of.of in ("field", "cylinder"):
            self._shorten(of, c, dot(q, G) / 2.0, dot(v, G))
        elif of.of == "rotation":
            self.energy += c / 2.0 * dot(v, V)
            self.drives += mean(c) / 2.0 * dot(np.diff(v, axis=0), mean(V))
        elif of.of == "carried":
            self.energy -= c / 2.0 * dot(q, G)
            self.drives -= 2.0 * mean(c) * dot(np.diff(q, axis=0), mean(G)) + np.diff(c) / 2.0 * dot(mean(q), mean(G))

    def _shorten(self, of: FrameTerm, c: Array, bent: Array, rate: Array) -> None:
        """Displacements along the axis, as a section bends or the cylinder that carries it leans."""
        if of.of == "cylinder":  # it is shorter along the axis the shorter it is
            length, longer = (
                getattr(self._scene.extension(of.number), what)(self._run.t) for what in ("value", "rate")
            )
            self.drives -= mean(c * bent * longer / length) * np.diff(self._run.t)
            bent, rate = -bent / length, -rate / length + bent * longer / length**2
        moments, over = self.moments[of.carried or of.bodies[0]], OVER.index(of.component[1:])
        moments.u[:, over, 0] += bent
        moments.rate[:, over, 0] += rate

    def add_momentum(self, number: int, of: _Moments) -> None:
        """Add moments that are linear in the displacements of the section with that number."""
        t, omega, gravity = self._run.t, self._turning.velocity, self._scene.gravity
        weight = (gravity.signal.value(t) if gravity else 0.0 * t)[:, None] * self._turning.up
        V = _speeds(self._scene, omega, number, t)
        V[:, 0] += self._base
        c = np.cross(V, omega[:, None])
        self.energy += _sum(V, of.rate) + _sum(c, of.u) + dot(weight, of.u[:, 0])
        self.drives += _sum(mean(V), np.diff(of.rate, axis=0)) + 2.0 * _sum(mean(c), np.diff(of.u, axis=0))
        self.drives += _sum(np.diff(c, axis=0), mean(of.u)) + dot(np.diff(weight, axis=0), mean(of.u[:, 0]))


def _speeds(scene: Scene, omega: Array, number: int, t: Array) -> Array:
    """V (T, 4, 3) of a section: of its tail in m/s, and by how much it grows with x, y and z, in 1/s."""
    assert scene.frame is not None
    place, out = np.zeros((len(t), 3)) + scene.frame.place, np.zeros((len(t), 3))
    for k in range(1, number + 1):
        place[:, 0] += scene.extension(k).value(t)
        out[:, 0] += scene.extension(k).rate(t)
    tail = np.cross(omega, place) + out
    return np.stack([tail, *(np.cross(omega, axis) for axis in np.eye(3))], axis=1)


def _of_base(frame: Frame, t: Array) -> Array:
    """How fast the pivot moves along axes of the ground, (T, 3) m/s; what is given as an acceleration is integrated."""
    velocity = np.zeros((len(t), 3))
    if frame.base is not None:
        for k, axis in enumerate("xyz"):
            if axis in frame.base.motions:
                velocity[:, k] += frame.base.motions[axis].rate(t)
            if axis in frame.base.accelerations:
                velocity[:, k] += _since_start(mean(frame.base.accelerations[axis].value(t)) * np.diff(t))
    return velocity


def _sum(a: Array, b: Array) -> Array:
    """Sum of the products of all entries at each time, (T,)."""
    return np.asarray(np.einsum("tij,tij->t", a, b))


def _since_start(work: Array) -> Array:
    return np.append(0.0, np.cumsum(work))
