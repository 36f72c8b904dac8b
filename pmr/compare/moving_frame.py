"""A boom in a frame that moves: angles, loads on the ground, buckling, and the energy in space with what changes it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pmr.compare.outputs import run_from_start
from pmr.compare.second_order import SECOND_ORDER_LIMIT, SecondOrderEffect, second_order_effect
from pmr.errors import InputError
from pmr.files.arrays import Array
from pmr.results import Frequencies, Response
from pmr.results.response import Extremes
from pmr.results.run import SummaryPart
from pmr.scene import Scene
from pmr.scene.built import force_name
from pmr.scene.frame import INERTIA, BaseMotion, Frame
from pmr.scene.keys import input_name
from pmr.scene.mechanism import TIPPING_MARGIN, FrameTerm, frame_terms
from pmr.scene.rotation import FrameRotation
from pmr.simulation import Excitation
from pmr.simulation.native.watched import TIPS
from pmr.simulation.stepping import row_products, step_means
from pmr.system.body import SlidingBody, kinds_of
from pmr.system.states import SystemTrajectory
from pmr.system.system import System
from pmr.system.terms import Term

#: Motion across the plane of luffing counts as zero up to this share of the motion in the plane.
ACROSS = 1e-9


def frame_part(scene: Scene, system: System, excitation: Excitation, frequencies: Frequencies) -> SummaryPart:
    r"""Entries ``frame`` and ``buckling`` of summary.json; the part is empty if the scene has no frame.

    ``luffing``, ``slewing`` and ``base`` are the ranges of the frame's motions, and ``angular_velocity`` is in rad/s.
    With the largest angular velocity :math:`\omega` of the frame and the lowest circular frequency :math:`\omega_1` on
    the way, ``gyroscopic`` is :math:`2 |\omega| / \omega_1` and ``centrifugal`` is :math:`(|\omega| / \omega_1)^2`.
    Both are sizes, relative to the stiffness, of terms that are left out without second order.  Both are None past the
    buckling load, where :math:`\omega_1` is 0.  ``frequencies`` is ``stressed`` if axial forces and the frame act on
    the frequencies, or ``unstressed`` without second order.

    ``share`` is the largest share by which axial forces and the frame's speed change the stiffness
    (`second_order_effect`); if it is above ``limit``, second order matters.  ``factor`` is the least factor on axial
    forces at which the boom buckles, at the time ``t`` in s; ``over`` has this factor at some times of the run, None
    where nothing presses.  Without second order, ``buckling`` is left out if contacts do not hold the bodies.

    Warnings name second order that is left out although it matters, models that can't show buckling across the plane,
    and times past the buckling load.  Raises an InputError if contacts do not hold the bodies in a run with second
    order.
    """
    if scene.frame is None:
        return SummaryPart()
    luffing, slewing = scene.frame.angles
    t = excitation.times
    rotation = FrameRotation.from_signals(luffing, slewing, t, scene.frame.base_angles)
    speed = float(np.linalg.norm(rotation.velocity, axis=1).max())
    lowest = 2.0 * np.pi * float(np.nanmin(frequencies.models["reduced"][:, 0]))  # 0 past the buckling load
    figures = {
        "luffing": _signal_range(luffing.value(t), "rad"),
        "slewing": _signal_range(slewing.value(t), "rad"),
        **({} if scene.frame.base is None else {"base": _base_ranges(scene.frame.base, scene.frame.unit, t)}),
        "angular_velocity": speed,
        "second_order": scene.frame.second_order,
        "gyroscopic": 2.0 * speed / lowest if lowest else None,
        "centrifugal": (speed / lowest) ** 2 if lowest else None,
        "frequencies": "unstressed" if frequencies.t is None else "stressed",
    }
    try:
        stresses = second_order_effect(scene, system.bodies)
    except InputError:
        if scene.frame.second_order:
            raise
        return SummaryPart({"frame": figures})
    factors = [factor if np.isfinite(factor) else None for factor in stresses.factors.tolist()]
    buckling = {
        "factor": stresses.least_factor if np.isfinite(stresses.least_factor) else None,
        "t": stresses.t_least_factor,
        "over": {"t": stresses.t.tolist(), "factor": factors},
        "share": stresses.largest_share,
        "share_t": stresses.t_largest_share,
        "limit": SECOND_ORDER_LIMIT,
    }
    is_included = scene.frame.second_order is not False
    warnings = [*_left_out_warnings(scene, is_included, stresses), *_plane_buckling_warnings(scene, system)]
    past = _past_buckling_warnings(is_included, stresses)
    return SummaryPart({"frame": figures, "buckling": buckling}, warnings, past)


def _plane_buckling_warnings(scene: Scene, system: System) -> list[str]:
    """List a warning that names bodies whose model can't show buckling across the plane of luffing.

    No load acts on these bodies across the plane, so their reduced models do not move in that direction.  The list is
    empty if all bodies can buckle in all directions, and without second order.
    """
    held = []
    for name, body in system.bodies.items():
        kinds = kinds_of(body)
        along = ([k for k, kind in enumerate(kinds) if kind in (f"tip {axis}", f"beam {axis}")] for axis in "yz")
        across, up = (np.abs(np.asarray(body.outputs)[rows]) for rows in along)
        if across.size and up.size and across.max() <= ACROSS * up.max():
            held.append(name or "the body")
    if not held or not scene.present_frame.second_order:
        return []
    return [
        f"buckling across the plane of luffing is not looked for in {', '.join(held)}: nothing acts across it, so the "
        "reduced model does not move there; a load along y, of any size, brings it in"
    ]


def _past_buckling_warnings(is_included: bool, stresses: SecondOrderEffect) -> list[str]:
    """List a warning if the boom is beyond its buckling load in the run with the effects `stresses`; empty otherwise.

    The words depend on `is_included`, which says whether second order is simulated.
    """
    past = f"the boom is beyond its buckling load: at {stresses.t_least_factor:g} s {stresses.least_factor:.3g} of the "
    past += "axial forces bends it "
    past += "without limit" if is_included else "without limit, which is not simulated without second order"
    return [past] if stresses.least_factor <= 1.0 else []


def _left_out_warnings(scene: Scene, is_included: bool, stresses: SecondOrderEffect) -> list[str]:
    """List a warning if second order matters, by its effects `stresses`, but is left out; empty otherwise.

    `is_included` says whether second order is simulated.
    """
    size = f"by {100.0 * stresses.largest_share:.2g} % at {stresses.t_largest_share:g} s"
    left_out = f"second order is left out: axial forces and the frame's speed change the stiffness {size}, so static "
    left_out += "deflections are off by as much, vibrations drift out of phase; frame.second_order = true includes it"
    left_out += ", which takes a winch on the machine or at a section's tip" if scene.hoist is not None else ""
    return [] if is_included or stresses.least_factor <= 1.0 or not stresses.matters else [left_out]


def _base_ranges(base: BaseMotion, angles: str, t: Array) -> dict[str, dict[str, Any]]:
    """Range at times t (T,) of each motion of the base; `angles` is the frame's unit of angles.

    Accelerations that the scene prescribes are included, as ``acceleration.<axis>``.
    """
    ranges = {
        key: _signal_range(signal.value(t), angles if key.startswith("r") else "m")
        for key, signal in base.motions.items()
    }
    return ranges | {
        f"acceleration.{axis}": _signal_range(signal.value(t), "m/s^2") for axis, signal in base.accelerations.items()
    }


def _signal_range(values: Array, unit: str) -> dict[str, Any]:
    """Smallest and largest entry of `values` (T,) in `unit`, as ``min``, ``max`` and ``unit``."""
    return {"min": float(values.min()), "max": float(values.max()), "unit": unit}


def ground_part(scene: Scene, response: Response) -> SummaryPart:
    """Entry ``ground`` of summary.json: extremes of ``outriggers`` and ``margins``, and of the polygon's ``use``.

    An outrigger that lifts off has ``lifted``: ``t``, the time in s at which it first does, and ``duration``, the time
    in s for which it is off the ground in all.  ``tips`` is the time in s at which the machine begins to tip, None if
    it stands.  Times before the weight acts in full do not count.  Warnings say when outriggers lift off or the machine
    tips.

    If forces are not known, or if the run ends before the weight acts in full, the part has a grave warning and no
    entry.  For a scene without a ground the part is empty.
    """
    if scene.frame is None or scene.frame.ground is None:
        return SummaryPart()
    loaded = response.t >= (scene.gravity.rise if scene.gravity is not None else 0.0)
    if not loaded.any():
        return SummaryPart(grave=["forces of outriggers are not judged, as the weight still grows when the run ends"])
    t, along = response.t[loaded], scene.path_positions(response.t[loaded])
    rows, lifted = dict[str, list[dict[str, Any]]](), list[str]()
    for kind in ("outrigger", "margin", "tipping"):
        rows[kind] = list[dict[str, Any]]()
        for output in [of for of in response.outputs if of.kind == kind]:
            history = response.other(output.name)[loaded]
            name = output.name.removeprefix(force_name("outrigger ")).removeprefix(TIPPING_MARGIN)
            rows[kind].append({"name": name, **Extremes.from_history(history, t, along).summary()})
            if kind == "outrigger" and not history.all():
                off, span = float(t[history == 0.0][0]), float(np.mean(history == 0.0) * (t[-1] - t[0]))
                rows[kind][-1]["lifted"] = {"t": off, "duration": span}
                lifted.append(f"{name} at {off:.4g} s, for {span:.3g} s in all")
    if not rows["tipping"]:
        unknown = "forces of outriggers are not computed, as force and moment at the pivot are not known"
        return SummaryPart(grave=[unknown])
    use = response.of("tipping")[loaded, 0]
    tips, fallen = None, list[str]()
    if use.max() >= 1.0:
        first = int(np.argmax(use >= 1.0))
        over, tips = rows["margin"][int(np.argmin(response.of("margin")[loaded][first]))]["name"], float(t[first])
        fallen = [f"the machine tips over {over} at {tips:.4g} s: {TIPS}"]
    figures = {"outriggers": rows["outrigger"], "margins": rows["margin"], "use": rows["tipping"][0], "tips": tips}
    return SummaryPart(
        {"ground": figures}, [f"outriggers lift off: {'; '.join(lifted)}"] * bool(lifted and tips is None), fallen
    )


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
        """Change of energy (T,) in J since the start less all work, negative where energy is lost.

        It is lost by damping, or gained or lost by the error of the step.
        """
        return self.energy - self.energy[0] - self.drive_work - self.other_work


def energy_in_space(scene: Scene, system: System, excitation: Excitation, run: SystemTrajectory) -> SpaceEnergy:
    r"""Energy of a boom in a moving frame and work on it, each without what a rigid boom of the same mass would have.

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
    they bend.  Without second order, integrals of products of two u are left out, except that of
    :math:`\lvert u' \rvert^2`, as in the equations of motion.
    """
    account = _EnergyBalance(scene, run)
    for name, body in system.bodies.items():
        account.add_fields(name, body, system)
    terms, amplitudes = {term.name: term for term in frame_terms(scene)}, excitation.amplitudes(system.term_names)
    for term, c in zip(system.terms, amplitudes.T, strict=True):
        account.add_term(terms[term.name], term, c)
    for number, name in enumerate(scene.names):
        account.add_momentum(number, account.moments[name])
    return SpaceEnergy(run.t, account.energy, _running_sum(account.drives), _running_sum(account.others))


def energy_part(scene: Scene, system: System, excitation: Excitation, run: SystemTrajectory | None) -> SummaryPart:
    """Entry ``energy`` of summary.json in J, changes from the start to the end; empty if the scene has no frame.

    ``change`` is the change of the energy, ``drives`` and ``others`` are the work of drives and of all other loads, and
    ``lost`` is the sum of both works less the change.  If `run` is None, because its states were not kept, the motion
    is simulated again, which takes microseconds a step.
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
    """Balance at T times: `energy` (T,) in J, and work `drives` and `others` (T - 1,) in J in each step between them.

    The methods are called in this order: `add_fields` for bodies, `add_term` for terms of second order, `add_momentum`.
    """

    def __init__(self, scene: Scene, run: SystemTrajectory) -> None:
        """Begin the balance of a scene's `run`, at T times, with the energy and work in the moving frame."""
        self._scene, self._run = scene, run
        self._turning = FrameRotation.from_signals(*scene.present_frame.angles, run.t, scene.present_frame.base_angles)
        self._base = np.einsum("tji,tj->ti", self._turning.rotation, _pivot_velocity(scene.present_frame, run.t))
        none = np.zeros((len(run.t), len(OVER), 3))
        self.moments = {name: _Moments(none.copy(), none.copy()) for name in scene.names}
        self.energy, self.drives, self.others = run.energy.copy(), np.zeros(len(run.t) - 1), np.diff(run.work)

    def add_fields(self, name: str, body: SlidingBody, system: System) -> None:
        """Set the moments of the body called `name` from its motion, and subtract the work of its inertia loads.

        The work is subtracted from `others`: inertia loads are forces in the frame only, and in space they do no work.
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
        """Add energy and work of a `term` of second order, which `frame_term` describes, with the amplitudes c (T,).

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
        """Add to the moments, in place, how far a section moves along its axis as it bends or its cylinder leans.

        `bent` and `rate` (T,) are q^T G q / 2 and its rate, with the matrix G of the term and its amplitude c (T,).
        The work of a cylinder's extension against the force of the term is subtracted from the work of drives.
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
        # velocities (T, 4, 3) of points at rest in the frame, without the velocity of the pivot
        place, out = np.zeros((len(t), 3)) + self._scene.present_frame.tail_position, np.zeros((len(t), 3))
        for k in range(1, number + 1):
            place[:, 0] += self._scene.extension(k).value(t)
            out[:, 0] += self._scene.extension(k).rate(t)
        tail = np.cross(omega, place) + out
        V = np.stack([tail, *(np.cross(omega, axis) for axis in np.eye(3))], axis=1)
        V[:, 0] += self._base
        c = np.cross(V, omega[:, None])
        self.energy += _contract(V, moments.rate) + _contract(c, moments.u) + row_products(weight, moments.u[:, 0])
        by_rates, by_motion = (
            _contract(step_means(a), np.diff(b, axis=0)) for a, b in ((V, moments.rate), (c, moments.u))
        )
        self.drives += by_rates + 2.0 * by_motion
        lifted = row_products(np.diff(weight, axis=0), step_means(moments.u[:, 0]))
        self.drives += _contract(np.diff(c, axis=0), step_means(moments.u)) + lifted


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
                velocity[:, k] += _running_sum(step_means(frame.base.accelerations[axis].value(t)) * np.diff(t))
    return velocity


def _contract(a: Array, b: Array) -> Array:
    """Sums (T,) over i and j of the products a_ij b_ij of two arrays a and b (T, i, j)."""
    return np.asarray(np.einsum("tij,tij->t", a, b))


def _running_sum(increments: Array) -> Array:
    """Sum (T,), up to each time, of the `increments` (T - 1,) in the steps before; 0 at the first time."""
    return np.append(0.0, np.cumsum(increments))
