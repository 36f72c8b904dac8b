"""A boom in a frame that moves: effects of second order, buckling, the frame's angles, and the energy in space."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmr.compare.outputs import run_from_start
from pmr.errors import InputError
from pmr.results import Frequencies
from pmr.results.run import SummaryPart
from pmr.scene import Scene
from pmr.scene.frame import INERTIA, BaseMotion, Frame
from pmr.scene.keys import input_name
from pmr.scene.mechanism import AXIAL, FrameTerm, frame_terms, stress_terms
from pmr.simulation import Excitation
from pmr.simulation.balance import row_products, step_means
from pmr.simulation.excitation import side_positions
from pmr.simulation.frame import term_signals
from pmr.simulation.frame_motion import FrameRotation
from pmr.simulation.statics.equilibrium import HeldSystem
from pmr.system.assembly import Assembly
from pmr.system.body import SlidingBody
from pmr.system.from_scene import system_of
from pmr.system.states import SystemTrajectory
from pmr.system.system import System
from pmr.system.terms import Term, terms_of

Array = NDArray[np.float64]


#: Motion across the plane of luffing counts as zero up to this share of the motion in the plane.
ACROSS = 1e-9


def frame_part(scene: Scene, system: System, excitation: Excitation, frequencies: Frequencies) -> SummaryPart:
    r"""``frame`` and ``buckling`` of summary.json; empty without a frame.

    With the largest angular velocity :math:`\omega` of the frame and the lowest circular frequency :math:`\omega_1` on
    the way, ``gyroscopic`` is :math:`2 |\omega| / \omega_1` and ``centrifugal`` is :math:`(|\omega| / \omega_1)^2`: the
    sizes, relative to the stiffness, of the terms that are left out without second order.  Both are None past the
    buckling load, where :math:`\omega_1` is 0.  ``frequencies`` is ``stressed`` if axial forces and the frame act on
    the frequencies, or ``unstressed`` without second order.

    ``share`` is the largest share by which axial forces and the frame's speed change the stiffness
    (`second_order_effect`); if it is above ``limit``, second order matters.
    """
    if scene.frame is None:
        return SummaryPart()
    luffing, slewing = scene.frame.angles
    t = excitation.times
    speed = float(
        np.linalg.norm(FrameRotation.from_signals(luffing, slewing, t, scene.frame.base_angles).velocity, axis=1).max()
    )
    lowest = 2.0 * np.pi * float(np.nanmin(frequencies.models["reduced"][:, 0]))  # 0 past the buckling load
    figures = {
        "luffing": _signal_range(luffing.value(t)),
        "slewing": _signal_range(slewing.value(t)),
        **({} if scene.frame.base is None else {"base": _base_ranges(scene.frame.base, t)}),
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
    return SummaryPart(
        {"frame": figures, "buckling": buckling},
        [
            *_left_out_warnings(scene.frame.second_order is not False, stresses),
            *_plane_buckling_warnings(scene, system),
        ],
        _past_buckling_warnings(scene.frame.second_order is not False, stresses),
    )


def _plane_buckling_warnings(scene: Scene, system: System) -> list[str]:
    """A warning that names bodies whose model can't show buckling across the plane of luffing; else nothing.

    No load acts on these bodies across the plane, so their reduced models do not move in that direction.
    """
    assert scene.frame is not None  # only called for a scene with a frame
    held = []
    for name, body in system.bodies.items():
        across, up = (
            np.abs(
                np.asarray(body.outputs)[[k for k, name in enumerate(body.output_names) if name.endswith(f" {axis}")]]
            )
            for axis in "yz"
        )
        if across.size and up.size and across.max() <= ACROSS * up.max():
            held.append(name or "the body")
    if not held or not scene.frame.second_order:
        return []
    return [
        f"buckling across the plane of luffing is not looked for in {', '.join(held)}: nothing acts across it, so the "
        "reduced model does not move there; a load along y, of any size, brings it in"
    ]


def _past_buckling_warnings(is_included: bool, stresses: SecondOrderEffect) -> list[str]:
    """A warning if the boom is beyond its buckling load, in words that depend on `is_included`; else nothing.

    `is_included` says whether second order is simulated.
    """
    past = f"the boom is beyond its buckling load: at {stresses.t_least_factor:g} s {stresses.least_factor:.3g} of the "
    past += "axial forces bends it "
    past += "without limit" if is_included else "without limit, which is not simulated without second order"
    return [past] if stresses.least_factor <= 1.0 else []


def _left_out_warnings(is_included: bool, stresses: SecondOrderEffect) -> list[str]:
    """A warning if second order is left out although it matters; else nothing."""
    size = f"by {100.0 * stresses.largest_share:.2g} % at {stresses.t_largest_share:g} s"
    left_out = f"second order is left out: axial forces and the frame's speed change the stiffness {size}, so static "
    left_out += "deflections are off by as much, vibrations drift out of phase; frame.second_order = true includes it"
    return [] if is_included or stresses.least_factor <= 1.0 or not stresses.matters else [left_out]


def _base_ranges(base: BaseMotion, t: Array) -> dict[str, dict[str, float]]:
    """Smallest and largest value of each motion of the base, in m or the frame's unit of angles.

    Accelerations that the scene prescribes are included, as ``acceleration.<axis>``.
    """
    accelerations = {f"acceleration.{axis}": signal for axis, signal in base.accelerations.items()}
    return {key: _signal_range(signal.value(t)) for key, signal in (base.motions | accelerations).items()}


def _signal_range(angle: Array) -> dict[str, float]:
    """Smallest and largest value of a signal (T,), as ``min`` and ``max``."""
    return {"min": float(angle.min()), "max": float(angle.max())}


_log = logging.getLogger(__name__)
#: Number of times, ends included, at which the effect of second order is computed.
STRESSED_TIMES = 41
#: Change of the stiffness, as a share of it, above which ``auto`` keeps second order, and a warning is given without
#: it.
SECOND_ORDER_LIMIT = 2e-3


@dataclass(frozen=True)
class SecondOrderEffect:
    """Effect of axial forces and of the frame's speed on stiffness at some times of a run."""

    t: Array  # (T,) s
    factors: Array  # (T,) on all axial forces at which the boom would buckle; inf if nothing presses
    shares: Array  # (T,) of the stiffness that second order changes (`second_order_effect`)

    @property
    def least_factor(self) -> float:
        """Smallest buckling factor at these times."""
        return float(self.factors.min())

    @property
    def t_least_factor(self) -> float:
        """Time in s of the smallest buckling factor."""
        return float(self.t[np.argmin(self.factors)])

    @property
    def largest_share(self) -> float:
        """Largest share by which the stiffness changes at these times."""
        return float(self.shares.max())

    @property
    def t_largest_share(self) -> float:
        """Time in s of the largest share by which the stiffness changes."""
        return float(self.t[np.argmax(self.shares)])

    @property
    def matters(self) -> bool:
        """Whether second order changes the stiffness by more than `SECOND_ORDER_LIMIT`; true for NaN."""
        return not self.largest_share <= SECOND_ORDER_LIMIT


def second_order_effect(scene: Scene, bodies: Mapping[str, SlidingBody]) -> SecondOrderEffect:
    r"""Effect of second order in a scene with a frame, with all contacts closed.

    Axial forces and the frame's speed add :math:`\sum_k c_k G_k` to the stiffness K, with the amplitude c_k and the
    matrix G_k of each term k.  The share by which they change the stiffness at a time is the largest share of the
    strain energy that they add to, or take from, any motion q,

    .. math::
        \max_q \frac{\lvert q^T \sum_k c_k G_k\, q \rvert}{q^T K q}, \qquad C q = F \lambda,

    with contact rows C, compliance F and contact forces :math:`\lambda`; for a load P along a column that buckles at
    P_cr it is P / P_cr.  Without second order, the relative error of a static deflection is that share, and a vibration
    lags by :math:`\pi` times that share (as a phase in rad) in each period (docs/moving_frame.md has measurements, on
    which `SECOND_ORDER_LIMIT` rests).

    Raises an InputError if contacts do not hold the bodies.
    """
    terms = list(stress_terms(scene))
    system = replace(system_of(_with_second_order(scene, False), bodies), terms=terms_of(scene, bodies, terms))
    signals, excitation = term_signals(scene, terms), Excitation.from_scene(_with_second_order(scene, False))
    assembly, x = Assembly(system), side_positions(system, excitation)
    axial = [term.name for term in terms if term.kind in AXIAL]
    steps = _second_order_steps(excitation)
    rows = assembly.contact_rows_over_time(x[steps])
    factors, shares = np.full(len(steps), np.inf), np.zeros(len(steps))
    for k, step in enumerate(steps):
        with np.errstate(divide="ignore", invalid="ignore"):  # cylinders may have the length 0
            c = {name: float(signal.value(excitation.times[step])) for name, signal in signals.items()}
        if not np.isfinite(list(c.values())).all():
            continue
        held = HeldSystem(assembly, rows.at_time(k))
        factors[k] = held.factors({name: c[name] for name in axial})[0]
        either = [held.factors({name: way * amount for name, amount in c.items()}) for way in (1, -1)]
        shares[k] = 1.0 / np.min(either)
    return SecondOrderEffect(excitation.times[steps], factors, shares)


def _second_order_steps(excitation: Excitation) -> NDArray[np.int64]:
    """Numbers of the steps at which second order is computed, `STRESSED_TIMES` at most.

    Steps near a kink of an extension are left out: the acceleration of the kink lasts one step and is no lasting load.
    """
    steps = np.unique(np.linspace(0, excitation.stepping.steps, STRESSED_TIMES).astype(np.int64))
    kinks = [t for path in excitation.paths.values() for t in path.kinks(excitation.stepping.end)]
    near_kink = np.abs(np.subtract.outer(excitation.times[steps], kinks)) < 2.0 * excitation.stepping.step
    return steps[~near_kink.any(axis=1)]


def decide_second_order(scene: Scene, bodies: Mapping[str, SlidingBody]) -> Scene:
    """The scene with or without second order, if its frame leaves the decision open (``auto``); else the same scene.

    Second order is kept if it matters (`SecondOrderEffect.matters`), or if contacts do not hold the bodies.
    """
    if scene.frame is None or scene.frame.second_order != "auto":
        return scene
    try:
        effect = second_order_effect(scene, bodies)
    except InputError:  # nothing holds the bodies: there is no stiffness to compare with
        return _with_second_order(scene, True)
    chosen = "kept" if effect.matters else "left out"
    _log.info("second order is %s: stiffness changes by %.2g %%", chosen, 100.0 * effect.largest_share)
    return _with_second_order(scene, effect.matters)


def with_choice_of_terms(scene: Scene, terms: Sequence[Term]) -> Scene:
    """The scene with second order if a system with these `terms` has it, and without it else; only for ``auto``.

    A scene that does not leave the choice to ``auto`` is returned unchanged.
    """
    open_ = scene.frame is not None and scene.frame.second_order == "auto"
    return _with_second_order(scene, bool(terms)) if open_ else scene


def _with_second_order(scene: Scene, second_order: bool) -> Scene:
    """The scene with this choice of second order in its frame."""
    assert scene.frame is not None  # callers have checked it
    return scene.model_copy(update={"frame": scene.frame.model_copy(update={"second_order": second_order})})


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
        """Change of energy (T,) in J since the start less all work: dissipation by damping, or an error of the step."""
        return self.energy - self.energy[0] - self.drive_work - self.other_work


def energy_in_space(scene: Scene, system: System, excitation: Excitation, run: SystemTrajectory) -> SpaceEnergy:
    r"""Energy of a scene with a frame, and work of its drives, each less that of the same boom if it were rigid.

    The work of a step is that of the mean forces over it, which is of second order in the step.

    .. math::
        E = \int \rho\, \bigl( V \cdot (\dot u + \omega \times u) + g\, e_Z \cdot u \bigr)
        + \tfrac12 \int \rho\, |\dot u + \omega \times u|^2 + U, \\
        \dot W = \int \rho\, \bigl( V \cdot \ddot u + 2 c \cdot \dot u + (\dot c + g\, \dot e_Z) \cdot u \bigr)
        + \int \rho\, (\ddot u + 2 \omega \times \dot u + \dot\omega \times u) \cdot (\omega \times u) + f \cdot \dot u

    with the energy E, the work W, the density :math:`\rho`, the displacement u relative to the frame, the angular
    velocity :math:`\omega` of the frame, gravity g, the vertical e_Z, the strain energy U, the loads f, and the
    velocity V = v_0 + omega x (p + X e_x + r) + X' e_x of a point at rest in the frame, c = V x omega.  Here v_0 is the
    velocity of the pivot, p the position of the base's tail relative to the pivot, X the position of the section's tail
    along the boom's axis e_x, and r the position of the point relative to that tail.

    W is done by the drives of the frame and of the extensions, which move all mass at its deflected position, by loads,
    and by contacts that travel.  V is affine in r, so only the momenta of u with the fields of `pmr.simulation.frame`
    are needed.  With second order u includes the lengths by which sections and cylinders get shorter along the axis as
    they bend; without it, integrals of products of two u are left out, except that of |u'|^2, as in the equations of
    motion.
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
    """Entry ``energy`` of summary.json in J, changes from the start to the end; empty without a frame.

    If `run` is None, because its states were not kept, the motion is simulated again, which takes microseconds a step.
    """
    if scene.frame is None:
        return SummaryPart()
    energies = energy_in_space(scene, system, excitation, run or run_from_start(system, excitation))
    ends = {
        "change": energies.energy[-1] - energies.energy[0],
        "drives": energies.drive_work[-1],
        "others": energies.other_work[-1],
    }
    return SummaryPart(
        {"energy": {key: float(value) for key, value in ends.items()} | {"lost": -float(energies.residual_energy[-1])}}
    )


@dataclass(frozen=True)
class _Moments:
    """Integrals `u` (T, 4, 3) of rho u_j times 1, x, y and z, for the axes j = x, y, z, and their `rate` (T, 4, 3).

    u is the displacement of a section relative to the frame, rho its density.
    """

    u: Array
    rate: Array


class _EnergyBalance:
    """Energy (T,) in J, and work of each of T - 1 steps in J; add bodies first, then terms, then momenta."""

    def __init__(self, scene: Scene, run: SystemTrajectory) -> None:
        assert scene.frame is not None  # `energy_in_space` is for scenes with a frame
        self._scene, self._run = scene, run
        self._turning = FrameRotation.from_signals(*scene.frame.angles, run.t, scene.frame.base_angles)
        self._base = np.einsum("tji,tj->ti", self._turning.rotation, _pivot_velocity(scene.frame, run.t))
        none = np.zeros((len(run.t), len(OVER), 3))
        self.moments = {name: _Moments(none.copy(), none.copy()) for name in scene.names}
        self.energy, self.drives, self.others = run.energy.copy(), np.zeros(len(run.t) - 1), np.diff(run.work)

    def add_fields(self, name: str, body: SlidingBody, system: System) -> None:
        """Set the moments of a body, in place, and subtract the work of its inertia loads from the attribute `others`.

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
            self.drives -= 2.0 * step_means(c) * row_products(np.diff(q, axis=0), step_means(G)) + np.diff(
                c
            ) / 2.0 * row_products(step_means(q), step_means(G))

    def _add_shortening(self, frame_term: FrameTerm, c: Array, bent: Array, rate: Array) -> None:
        """Add to the moments the displacement along the axis of a section that bends, or whose cylinder leans.

        `bent` and `rate` (T,) are q^T G q / 2 and its rate, with the matrix G of the term and its amplitude c (T,).
        """
        if frame_term.kind == "cylinder":  # a cylinder of length L that leans by d shortens by d^2 / 2 L
            length, longer = (
                getattr(self._scene.extension(frame_term.number), what)(self._run.t) for what in ("value", "rate")
            )
            self.drives -= step_means(c * bent * longer / length) * np.diff(self._run.t)
            bent, rate = -bent / length, -rate / length + bent * longer / length**2
        moments, over = (
            self.moments[frame_term.carried_section or frame_term.bodies[0]],
            OVER.index(frame_term.component[1:]),
        )
        moments.u[:, over, 0] += bent
        moments.rate[:, over, 0] += rate

    def add_momentum(self, number: int, moments: _Moments) -> None:
        """Add the energy and work that are linear in the displacements of the section with this `number`."""
        t, omega, gravity = self._run.t, self._turning.velocity, self._scene.gravity
        weight = (gravity.signal.value(t) if gravity else 0.0 * t)[:, None] * self._turning.up
        V = _speeds(self._scene, omega, number, t)
        V[:, 0] += self._base
        c = np.cross(V, omega[:, None])
        self.energy += _contract(V, moments.rate) + _contract(c, moments.u) + row_products(weight, moments.u[:, 0])
        self.drives += _contract(step_means(V), np.diff(moments.rate, axis=0)) + 2.0 * _contract(
            step_means(c), np.diff(moments.u, axis=0)
        )
        self.drives += _contract(np.diff(c, axis=0), step_means(moments.u)) + row_products(
            np.diff(weight, axis=0), step_means(moments.u[:, 0])
        )


def _speeds(scene: Scene, omega: Array, number: int, t: Array) -> Array:
    """Velocities (T, 4, 3) of points at rest in the frame, without the velocity of the pivot.

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
    """Velocity (T, 3) in m/s of the pivot along the axes of the ground; accelerations are integrated."""
    velocity = np.zeros((len(t), 3))
    if frame.base is not None:
        for k, axis in enumerate("xyz"):
            if axis in frame.base.motions:
                velocity[:, k] += frame.base.motions[axis].rate(t)
            if axis in frame.base.accelerations:
                velocity[:, k] += _cumulative_work(step_means(frame.base.accelerations[axis].value(t)) * np.diff(t))
    return velocity


def _contract(a: Array, b: Array) -> Array:
    """Sums (T,) over the last two axes of the products of the entries of two arrays."""
    return np.asarray(np.einsum("tij,tij->t", a, b))


def _cumulative_work(work: Array) -> Array:
    """Sum (T,) of the work of all steps, (T - 1,), up to each time."""
    return np.append(0.0, np.cumsum(work))
