"""Energy in space of a boom whose frame moves, and the work that drives of the frame, loads and contacts do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pmr.compare.outputs import run_from_start
from pmr.files.arrays import Array
from pmr.results.run import SummaryPart
from pmr.scene import Scene
from pmr.scene.frame import INERTIA, Frame
from pmr.scene.keys import input_name
from pmr.scene.mechanism import (
    FrameTerm,
    frame_terms,
)
from pmr.simulation import Excitation
from pmr.simulation.balance import row_products, step_means
from pmr.simulation.frame_motion import FrameRotation
from pmr.system.body import SlidingBody
from pmr.system.states import SystemTrajectory
from pmr.system.system import System
from pmr.system.terms import Term

#: Coordinates in which fields are linear, "" for constant fields.
OVER = ("", "x", "y", "z")


@dataclass(frozen=True)
class SpaceEnergy:
    """Energy in J of a boom in space at the times t in s, and work in J since the start, (T,) each.

    `drive_work` is the work of the frame's drives, `other_work` the work of all other loads and contacts.
    """

    t: Array
    energy: Array
    drive_work: Array
    other_work: Array

    @property
    def residual_energy(self) -> Array:
        """Change of energy (T,) in J since the start less all work: lost by damping, or an error of the step."""
        return self.energy - self.energy[0] - self.drive_work - self.other_work


def energy_in_space(scene: Scene, system: System, excitation: Excitation, run: SystemTrajectory) -> SpaceEnergy:
    r"""Energy of a scene with a frame, and work of its drives, each less that of the same boom if it were rigid.

    The work of a step is that of the mean forces over the step, which is of second order in the step.

    .. math::
        E = \int \rho\, \bigl( V \cdot (\dot u + \omega \times u) + g\, e_Z \cdot u \bigr)
        + \tfrac12 \int \rho\, |\dot u + \omega \times u|^2 + U, \\
        \dot W = \int \rho\, \bigl( V \cdot \ddot u + 2 c \cdot \dot u + (\dot c + g\, \dot e_Z) \cdot u \bigr)
        + \int \rho\, (\ddot u + 2 \omega \times \dot u + \dot\omega \times u) \cdot (\omega \times u) + f \cdot \dot u

    with the energy E, the work W, the density :math:`\rho`, the displacement u relative to the frame, the angular
    velocity :math:`\omega` of the frame, gravity g, the vertical e_Z, the strain energy U and the loads f.  A point at
    rest in the frame has the velocity V = v_0 + omega x (p + X e_x + r) + X' e_x, and c = V x omega.  Here v_0 is the
    velocity of the pivot, p the position of the base's tail relative to the pivot, X the position of the section's tail
    along the boom's axis e_x, and r the position of the point relative to that tail.

    W is done by the drives of the frame and of the extensions, which move all mass at its deflected position, by loads,
    and by contacts that travel.  V is affine in r, so only the momenta of u with the fields of `pmr.simulation.frame`
    are needed.  With second order u includes the lengths by which sections and cylinders get shorter along the axis as
    they bend.  Without second order, integrals of products of two u are left out, except that of |u'|^2, as in the
    equations of motion.
    """
    account = _EnergyBalance(scene, run)
    for name, body in system.bodies.items():
        account.add_fields(name, body, system)
    terms, amplitudes = {term.name: term for term in frame_terms(scene)}, excitation.amplitudes(system.term_names)
    for term, c in zip(system.terms, amplitudes.T, strict=True):
        account.add_term(terms[term.name], term, c)
    for number, name in enumerate(scene.names):
        account.add_momentum(number, account.moments[name])
    return SpaceEnergy(run.t, account.energy, _cumulative_work(account.drives), _cumulative_work(account.others))


def energy_part(scene: Scene, system: System, excitation: Excitation, run: SystemTrajectory | None) -> SummaryPart:
    """Entry ``energy`` of summary.json in J, changes from the start to the end; empty if the scene has no frame.

    If `run` is None, because its states were not kept, the motion is simulated again, which takes microseconds a step.
    """
    if scene.frame is None:
        return SummaryPart()
    energies = energy_in_space(scene, system, excitation, run or run_from_start(system, excitation))
    change, lost = energies.energy[-1] - energies.energy[0], -energies.residual_energy[-1]
    ends = {"change": change, "drives": energies.drive_work[-1], "others": energies.other_work[-1], "lost": lost}
    return SummaryPart({"energy": {key: float(value) for key, value in ends.items()}})


@dataclass(frozen=True)
class _Moments:
    """Integrals `u` (T, 4, 3) over a section of rho u_j times 1, x, y, z for j = x, y, z, and their `rate` (T, 4, 3).

    u is the displacement of a section relative to the frame, rho its density.
    """

    u: Array
    rate: Array


class _EnergyBalance:
    """Balance over T steps: energy (T,) in J, and work of each of T - 1 steps in J.

    Bodies are added first, then terms of second order, then momenta.
    """

    def __init__(self, scene: Scene, run: SystemTrajectory) -> None:
        """Begin the balance of a scene's `run` of T steps with the energy and work in the moving frame."""
        assert scene.frame is not None  # `energy_in_space` is for scenes with a frame
        self._scene, self._run = scene, run
        self._turning = FrameRotation.from_signals(*scene.frame.angles, run.t, scene.frame.base_angles)
        self._base = np.einsum("tji,tj->ti", self._turning.rotation, _pivot_velocity(scene.frame, run.t))
        none = np.zeros((len(run.t), len(OVER), 3))
        self.moments = {name: _Moments(none.copy(), none.copy()) for name in scene.names}
        self.energy, self.drives, self.others = run.energy.copy(), np.zeros(len(run.t) - 1), np.diff(run.work)

    def add_fields(self, name: str, body: SlidingBody, system: System) -> None:
        """Set the moments of the body `name`, in place, and subtract the work of its inertia loads from `others`.

        Inertia loads are forces in the frame only; in space they do no work.
        """
        moments, motion = self.moments[name], self._run.bodies[name]
        for column, of_input in enumerate(body.input_names):
            if of_input.startswith(INERTIA):
                field, b = of_input.removeprefix(INERTIA), np.asarray(body.B)[:, column]
                at = slice(None), OVER.index(field[1:]), "xyz".index(field[0])
                moments.u[at], moments.rate[at] = motion.q @ b, motion.v @ b
                load = self._run.loads[:, system.input_names.index(input_name(name, of_input))]
                self.others -= step_means(load) * np.diff(moments.u[at])

    def add_term(self, frame_term: FrameTerm, term: Term, c: Array) -> None:
        """Add energy and work of a term of second order with the amplitudes c (T,).

        Terms of loads are skipped: their work is part of the work of the loads.
        """
        if frame_term.kind in ("load", "cylinder load"):  # part of the work of the loads
            return
        q, v = (np.hstack([getattr(self._run.bodies[name], what) for name in term.bodies]) for what in "qv")
        G, V = ((0.0 * q.T if A is None else A @ q.T).T for A in (term.stiffness, term.damping))
        damped = 0.0 * q if term.damping is None else (term.damping @ v.T).T
        self.others += row_products(step_means(c[:, None] * (G + damped)), np.diff(q, axis=0))
        if frame_term.kind in ("field", "cylinder"):
            self._add_shortening(frame_term, c, row_products(q, G) / 2.0, row_products(v, G))
        elif frame_term.kind == "rotation":
            self.energy += c / 2.0 * row_products(v, V)
            self.drives += step_means(c) / 2.0 * row_products(np.diff(v, axis=0), step_means(V))
        elif frame_term.kind == "carried":
            self.energy -= c / 2.0 * row_products(q, G)
            by_motion = 2.0 * step_means(c) * row_products(np.diff(q, axis=0), step_means(G))
            self.drives -= by_motion + np.diff(c) / 2.0 * row_products(step_means(q), step_means(G))

    def _add_shortening(self, frame_term: FrameTerm, c: Array, bent: Array, rate: Array) -> None:
        """Add to the moments the displacement of a section along its axis, as the section bends or its cylinder leans.

        `bent` and `rate` (T,) are q^T G q / 2 and its rate, with the matrix G of the term and its amplitude c (T,).
        """
        if frame_term.kind == "cylinder":  # a cylinder of length L that leans by d shortens by d^2 / 2 L
            extension = self._scene.extension(frame_term.number)
            length, longer = extension.value(self._run.t), extension.rate(self._run.t)
            self.drives -= step_means(c * bent * longer / length) * np.diff(self._run.t)
            bent, rate = -bent / length, -rate / length + bent * longer / length**2
        moments = self.moments[frame_term.carried_section or frame_term.bodies[0]]
        over = OVER.index(frame_term.component[1:])
        moments.u[:, over, 0] += bent
        moments.rate[:, over, 0] += rate

    def add_momentum(self, number: int, moments: _Moments) -> None:
        """Add those parts of the energy and the work of a section that are linear in its displacements.

        `number` is that of the section, and `moments` are the integrals of its displacements.
        """
        t, omega, gravity = self._run.t, self._turning.velocity, self._scene.gravity
        weight = (gravity.signal.value(t) if gravity else 0.0 * t)[:, None] * self._turning.up
        V = _speeds(self._scene, omega, number, t)
        V[:, 0] += self._base
        c = np.cross(V, omega[:, None])
        self.energy += _contract(V, moments.rate) + _contract(c, moments.u) + row_products(weight, moments.u[:, 0])
        by_rates, by_motion = (
            _contract(step_means(a), np.diff(b, axis=0)) for a, b in ((V, moments.rate), (c, moments.u))
        )
        self.drives += by_rates + 2.0 * by_motion
        lifted = row_products(np.diff(weight, axis=0), step_means(moments.u[:, 0]))
        self.drives += _contract(np.diff(c, axis=0), step_means(moments.u)) + lifted


def _speeds(scene: Scene, omega: Array, number: int, t: Array) -> Array:
    """Velocities (T, 4, 3), at times t (T,), of points at rest in the frame, without the velocity of the pivot.

    First comes the velocity at the tail of the section with this `number` in m/s, then its slopes over x, y and z in
    1/s.  `omega` (T, 3) in rad/s is the angular velocity of the frame.
    """
    assert scene.frame is not None
    place, out = np.zeros((len(t), 3)) + scene.frame.tail_position, np.zeros((len(t), 3))
    for k in range(1, number + 1):
        place[:, 0] += scene.extension(k).value(t)
        out[:, 0] += scene.extension(k).rate(t)
    tail = np.cross(omega, place) + out
    return np.stack([tail, *(np.cross(omega, axis) for axis in np.eye(3))], axis=1)


def _pivot_velocity(frame: Frame, t: Array) -> Array:
    """Velocity (T, 3) in m/s of the pivot at times t (T,), along the axes of the ground.

    Accelerations of the base are integrated.
    """
    velocity = np.zeros((len(t), 3))
    if frame.base is not None:
        for k, axis in enumerate("xyz"):
            if axis in frame.base.motions:
                velocity[:, k] += frame.base.motions[axis].rate(t)
            if axis in frame.base.accelerations:
                velocity[:, k] += _cumulative_work(step_means(frame.base.accelerations[axis].value(t)) * np.diff(t))
    return velocity


def _contract(a: Array, b: Array) -> Array:
    """Sums (T,) over i and j of the products a_ij b_ij of two arrays a and b (T, i, j)."""
    return np.asarray(np.einsum("tij,tij->t", a, b))


def _cumulative_work(work: Array) -> Array:
    """Sum (T,) of the work of all steps, (T - 1,), up to each time."""
    return np.append(0.0, np.cumsum(work))
