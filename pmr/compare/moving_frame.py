"""A boom in a frame that moves: effects of second order, buckling, the frame's angles, and the energy in space."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.files.arrays import Array
from pmr.results import Frequencies, Response
from pmr.results.response import Extremes
from pmr.results.run import SummaryPart
from pmr.scene import Scene
from pmr.scene.built import force_name
from pmr.scene.frame import BaseMotion
from pmr.scene.mechanism import AXIAL, TIPPING_MARGIN, stress_terms
from pmr.scene.signals import SignalBase
from pmr.simulation import Excitation
from pmr.simulation.excitation import side_positions, term_signals
from pmr.simulation.frame_motion import FrameRotation
from pmr.simulation.statics.equilibrium import HeldSystem
from pmr.system.assembly import Assembly
from pmr.system.body import SlidingBody
from pmr.system.from_scene import system_of
from pmr.system.system import System
from pmr.system.terms import Term, terms_of

#: Motion across the plane of luffing counts as zero up to this share of the motion in the plane.
ACROSS = 1e-9


def frame_part(scene: Scene, system: System, excitation: Excitation, frequencies: Frequencies) -> SummaryPart:
    r"""Entries ``frame`` and ``buckling`` of summary.json; the part is empty if the scene has no frame.

    With the largest angular velocity :math:`\omega` of the frame and the lowest circular frequency :math:`\omega_1` on
    the way, ``gyroscopic`` is :math:`2 |\omega| / \omega_1` and ``centrifugal`` is :math:`(|\omega| / \omega_1)^2`.
    Both are sizes, relative to the stiffness, of terms that are left out without second order.  Both are None past the
    buckling load, where :math:`\omega_1` is 0.  ``frequencies`` is ``stressed`` if axial forces and the frame act on
    the frequencies, or ``unstressed`` without second order.

    ``share`` is the largest share by which axial forces and the frame's speed change the stiffness
    (`second_order_effect`); if it is above ``limit``, second order matters.
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
    empty if all bodies can buckle in all directions.
    """
    assert scene.frame is not None  # only called for a scene with a frame
    held = []
    for name, body in system.bodies.items():
        along = ([k for k, output in enumerate(body.output_names) if output.endswith(f" {axis}")] for axis in "yz")
        across, up = (np.abs(np.asarray(body.outputs)[rows]) for rows in along)
        if across.size and up.size and across.max() <= ACROSS * up.max():
            held.append(name or "the body")
    if not held or not scene.frame.second_order:
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

    An outrigger that lifts off has ``lifted``: the time in s at which it first does, and for how long in all.
    ``tips`` is the time in s at which the machine begins to tip, None if it stands.  Times before the weight acts in
    full do not count.  Warnings say when outriggers lift off, when the machine tips, and if no force is known.
    """
    if scene.frame is None or scene.frame.ground is None:
        return SummaryPart()
    loaded = response.t >= (scene.gravity.rise if scene.gravity is not None else 0.0)
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
        fallen = [f"the machine tips at {tips:.4g} s over {over}: from then on no forces of outriggers hold it"]
    figures = {"outriggers": rows["outrigger"], "margins": rows["margin"], "use": rows["tipping"][0], "tips": tips}
    return SummaryPart(
        {"ground": figures}, [f"outriggers lift off: {'; '.join(lifted)}"] * bool(lifted and tips is None), fallen
    )


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
        """Time in s at which the buckling factor first comes within a relative 1e-9 of its smallest value.

        A boom at rest keeps its factor, so that among later times round-off alone would decide.
        """
        return float(self.t[np.argmax(self.factors <= self.least_factor * (1.0 + 1e-9))])

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
    r"""Buckling factors and changes of stiffness by second order over a run in a scene with a frame.

    Axial forces and the frame's speed add :math:`\sum_k c_k G_k` to the stiffness K, with the amplitude c_k and the
    matrix G_k of each term k.  The share by which they change the stiffness at a time is the largest share of the
    strain energy that they add to, or take from, any motion q,

    .. math::
        \max_q \frac{\lvert q^T \sum_k c_k G_k\, q \rvert}{q^T K q}, \qquad C q = F \lambda,

    with contact rows C, compliance F and contact forces :math:`\lambda`.  All contacts are taken as closed.  `bodies`
    are the models of all bodies, by name.  For a load P along a column that buckles at P_cr it is P / P_cr.

    If second order is left out, the relative error of a static deflection is that share.  A vibration then lags by
    :math:`\pi` times that share (as a phase in rad) in each period.  The measurements in docs/moving_frame.md are the
    base of `SECOND_ORDER_LIMIT`.

    Raises an InputError if contacts do not hold the bodies.
    """
    terms = list(stress_terms(scene))
    system = replace(system_of(_with_second_order(scene, False), bodies), terms=terms_of(scene, bodies, terms))
    signals, excitation = term_signals(scene, terms), Excitation.from_scene(_with_second_order(scene, False))
    return stiffness_changes(system, excitation, signals, [term.name for term in terms if term.kind in AXIAL])


def stiffness_changes(
    system: System, excitation: Excitation, signals: Mapping[str, SignalBase], axial: Sequence[str]
) -> SecondOrderEffect:
    """Effect of the terms of a `system` on its stiffness, as in `second_order_effect`, which has the errors.

    `signals` are the amplitudes of the terms by their names, `axial` the names of the terms of axial forces.
    """
    assembly, x = Assembly(system), side_positions(system, excitation)
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
    """Ascending numbers (S,) of the steps at which second order is computed, at most `STRESSED_TIMES`.

    Steps near a kink of an extension are left out: the acceleration of the kink lasts one step and is no lasting load.
    """
    steps = np.unique(np.linspace(0, excitation.stepping.steps, STRESSED_TIMES).astype(np.int64))
    kinks = [t for path in excitation.paths.values() for t in path.kinks(excitation.stepping.end)]
    near_kink = np.abs(np.subtract.outer(excitation.times[steps], kinks)) < 2.0 * excitation.stepping.step
    return steps[~near_kink.any(axis=1)]


def decide_second_order(scene: Scene, bodies: Mapping[str, SlidingBody]) -> Scene:
    """Return the scene with or without second order, if its frame leaves the choice open (``auto``).

    Any other scene is returned unchanged.  Second order is included if it matters (`SecondOrderEffect.matters`), or if
    contacts do not hold the bodies.
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
    """Scene with second order in place of ``auto``: true if a system has `terms` of second order, false if not.

    A scene that does not leave the choice to ``auto`` is returned unchanged.
    """
    open_ = scene.frame is not None and scene.frame.second_order == "auto"
    return _with_second_order(scene, bool(terms)) if open_ else scene


def _with_second_order(scene: Scene, second_order: bool) -> Scene:
    """The scene with `second_order` as the choice in its frame."""
    return scene.with_keys(frame={"second_order": second_order})
