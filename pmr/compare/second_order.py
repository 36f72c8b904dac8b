r"""Second order: how much axial forces and a frame's speed change the stiffness, and whether a run takes them along.

Without ``[frame]`` the equations are those of first order.  In a frame, second order has loads on tips alone.  What a
run leaves out gives a warning if it matters.

The geometric stiffness of an axial force N(x), tension positive, with the deflections w along y and z is estimated
from the observed displacements :math:`w_k` at :math:`x_k`:

.. math:: \delta w^T G\, w = \int N\, w' \delta w'\, dx \approx \sum_k N(\tfrac{x_k + x_{k+1}}{2})\,
    \frac{(w_{k+1} - w_k)(\delta w_{k+1} - \delta w_k)}{x_{k+1} - x_k}

A force along the axis runs to the support that holds the body along it, or to the tail, where a cylinder holds it.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.files.arrays import Array
from pmr.results.run import SummaryPart
from pmr.scene import Scene
from pmr.scene.built import WEIGHT
from pmr.scene.choice import axis_loads
from pmr.scene.keys import input_name
from pmr.scene.mechanism import AXIAL, stress_terms
from pmr.scene.members import Member, members
from pmr.scene.signals import SignalBase
from pmr.simulation import Excitation
from pmr.simulation.excitation import side_positions, term_signals
from pmr.simulation.start import dense
from pmr.simulation.statics.equilibrium import HeldSystem
from pmr.system.assembly import Assembly
from pmr.system.body import SlidingBody, kinds_of
from pmr.system.from_scene import system_of
from pmr.system.system import System
from pmr.system.terms import Term, terms_of

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
        """Smallest of the buckling `factors`; inf if nothing presses at any of the times."""
        return float(self.factors.min())

    @property
    def t_least_factor(self) -> float:
        """Time in s at which the buckling factor first comes within a relative 1e-9 of its smallest value.

        The tolerance is for a boom at rest, whose factor stays the same: without it, round-off would choose the time.
        """
        return float(self.t[np.argmax(self.factors <= self.least_factor * (1.0 + 1e-9))])

    @property
    def largest_share(self) -> float:
        """Largest of the `shares` by which the stiffness changes."""
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
    are the models of all bodies, by name.  A load P along a column that buckles at P_cr has the share P / P_cr.

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
    """Effect of the terms of a `system` on its stiffness, as in `second_order_effect`; errors are raised as there.

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
    If all steps are near kinks, as with an extension from a table of short straight pieces, no step is left out.
    """
    steps = np.unique(np.linspace(0, excitation.stepping.steps, STRESSED_TIMES).astype(np.int64))
    kinks = [t for path in excitation.paths.values() for t in path.kinks(excitation.stepping.end)]
    near_kink = np.abs(np.subtract.outer(excitation.times[steps], kinks)) < 2.0 * excitation.stepping.step
    away = ~near_kink.any(axis=1)
    return steps[away] if away.any() else steps


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


#: Number of equal pieces into which the weight of a body is cut along its axis.
PIECES = 40


class AxialForce(NamedTuple):
    """Axial force in N, tension positive, per unit of the input `load`; `at` returns it (k,) at places (k,) in m."""

    load: str
    at: Callable[[Array], Array]


def axial_part(scene: Scene, system: System, excitation: Excitation, masses: Mapping[str, float]) -> SummaryPart:
    """Part with a warning if axial forces matter that second order leaves out; a grave one beyond the buckling load.

    Without a frame, second order leaves out all axial forces.  With a frame, it leaves out those of loads that do not
    act at a tip.  In a boom of several sections, a load counts only for the section on which it acts, although
    cylinders pass its force on to other sections.  `masses` are those of the bodies in kg by name, without what is
    attached to them; a body that is missing among them has no weight here.  The part is empty if a motion of the scene
    is computed, if nothing acts along a body, or if contacts do not hold the bodies.
    """
    if scene.computed_key is not None:
        return SummaryPart()
    terms, signals = list[Term](), {}
    for name, member in zip(scene.names, members(scene), strict=True):
        body = system.bodies[name]
        for force in axial_forces(member, body, masses.get(name, 0.0)):
            load = input_name(name, force.load)
            if load in excitation.loads:
                terms.append(Term(load, (name,), stiffness=geometric_stiffness(body, force)))
                signals[load] = excitation.loads[load]
    if not terms:
        return SummaryPart()
    try:
        effect = stiffness_changes(replace(system, terms=tuple(terms)), excitation, signals, [*signals])
    except InputError:  # nothing holds the bodies: there is no stiffness to compare with
        return SummaryPart()
    what, remedy = "axial forces", "[frame] with pivot = [0.0, 0.0, 0.0], luffing = 0.0 and second_order = true has "
    remedy += "those of the weight and of loads on the tip"
    if scene.frame is not None:
        what, remedy = "loads along the boom that are not on its tip", "second order has those on the tip alone"
    if effect.least_factor <= 1.0:
        past = f"{what} are beyond the buckling load, by an estimate: at {effect.t_least_factor:g} s "
        past += f"{effect.least_factor:.2g} of them bends the body without limit, which is not simulated; {remedy}"
        return SummaryPart(grave=[past])
    share = f"by some {100.0 * effect.largest_share:.2g} % at {effect.t_largest_share:g} s"
    left_out = f"second order is left out: {what} change the stiffness {share}, so static deflections are off by as "
    return SummaryPart(warnings=[f"{left_out}much, vibrations drift out of phase; {remedy}"] * effect.matters)


def axial_forces(member: Member, body: SlidingBody, mass: float) -> Iterator[AxialForce]:
    """Yield the axial force per unit of each load along the axis of a body, and that of the weight.

    The weight is that of the body with what is attached to it; `mass` in kg is that of the body alone.  In a moving
    frame, a run's second-order terms include loads at the tip and the weight already, so these are left out.
    """
    part, tip = member.part, float(np.max(body.output_positions, initial=0.0))

    def place(on: str | float) -> float | None:
        """Position in m of a group or number `on`; None for a group whose place only a mesh knows.

        The tip of such a mesh is at the farthest place that is observed.
        """
        at = part.position_of(on)
        return tip if at is None and on == "tip" else at

    held = [place(support.on) for support in part.supports if "x" in support.held_directions]
    holds = min((at for at in held if at is not None), default=0.0)

    def between(at: float, x: Array) -> Array:
        """Axial force (k,), tension positive, at places x (k,) in m under a unit force along x at `at` in m.

        The axial force is 1 between the unit force and the support, or -1 there if the support is farther from the
        tail.  It is 0 elsewhere.
        """
        return np.where((x > min(at, holds)) & (x < max(at, holds)), np.sign(at - holds), 0.0)

    for load in axis_loads(member):
        is_included = member.frame is not None and load.on == "tip"
        at = place(load.on) if load.direction == "x" and not is_included else None
        if at is not None:
            yield AxialForce(load.name, partial(between, at))
    along = member.gravity.direction[0] if member.weight and member.gravity is not None else 0.0
    if along:
        attached = [(of.mass, of.at[0] if of.at is not None else place(of.on)) for of in part.masses]
        pieces = [(mass / PIECES, tip * (k + 0.5) / PIECES) for k in range(PIECES)]
        weights = [(along * m, at) for m, at in [*pieces, *attached] if at is not None]

        def of_weight(x: Array) -> Array:
            """Axial force (k,), tension positive, at places x (k,) in m under the weight, per m/s^2 of gravity."""
            return np.sum([m * between(at, x) for m, at in weights], axis=0)

        yield AxialForce(WEIGHT, of_weight)


def geometric_stiffness(body: SlidingBody, force: AxialForce) -> Array:
    """Geometric stiffness (n, n) of an axial force, in its unit per m, from a body's observed displacements."""
    outputs, kinds, G = dense(body.outputs), np.array(kinds_of(body)), np.zeros((body.size, body.size))
    for axis in "yz":
        across = np.flatnonzero(np.isin(kinds, [f"beam {axis}", f"tip {axis}"]))
        x, first = np.unique(body.output_positions[across], return_index=True)
        slopes = np.diff(outputs[across[first]], axis=0) / np.diff(x)[:, None]
        G += slopes.T @ ((force.at((x[1:] + x[:-1]) / 2.0) * np.diff(x))[:, None] * slopes)
    return G
