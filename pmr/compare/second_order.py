r"""How much axial forces and the frame's speed change the stiffness of a boom, and whether second order follows.

With the stiffness :math:`\sum_k c_k G_k` that they add at a time, the share is the largest part of the strain energy
that it adds to or takes from any motion,

.. math::
    \max_q \frac{\lvert q^T \sum_k c_k G_k\, q \rvert}{q^T K q}, \qquad C q = F \lambda,

for a load along a column P / P_cr.  Left out, a static deflection is off by that share, and a vibration falls behind by
:math:`\pi` times it a period (docs/moving_frame.md has measurements, on which `LIMIT` rests).
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.scene import Scene
from pmr.scene.mechanism import AXIAL, stress_terms
from pmr.simulation import Excitation
from pmr.simulation.excitation import places
from pmr.simulation.frame import term_signals
from pmr.simulation.statics.equilibrium import Held
from pmr.system.assembly import Assembly
from pmr.system.body import SlidingBody
from pmr.system.from_scene import system_of
from pmr.system.terms import terms_of

Array = NDArray[np.float64]
_log = logging.getLogger(__name__)
#: Times at which is looked, ends included.
TIMES = 41
#: Share from which on ``auto`` keeps second order, and a warning says that it is left out.
LIMIT = 2e-3


@dataclass(frozen=True)
class Stressed:
    """Effect of axial forces and of the frame's speed on stiffness at some times of a run."""

    t: Array  # (T,) s
    factors: Array  # (T,) by which all axial forces would have to grow until the boom buckles; inf where none presses
    shares: Array  # (T,) by which the stiffness changes, as above

    @property
    def factor(self) -> float:
        return float(self.factors.min())

    @property
    def at(self) -> float:
        """When that is, s."""
        return float(self.t[np.argmin(self.factors)])

    @property
    def share(self) -> float:
        return float(self.shares.max())

    @property
    def share_at(self) -> float:
        """When that is, s."""
        return float(self.t[np.argmax(self.shares)])

    @property
    def matters(self) -> bool:
        return not self.share <= LIMIT


def second_order_effect(scene: Scene, bodies: Mapping[str, SlidingBody]) -> Stressed:
    """Effect of second order in a scene with a frame, with all contacts closed.

    Raises an InputError where contacts do not hold the bodies.
    """
    terms = list(stress_terms(scene))
    system = replace(system_of(_with(scene, False), bodies), terms=terms_of(scene, bodies, terms))
    signals, excitation = term_signals(scene, terms), Excitation.of(_with(scene, False))
    assembly, x = Assembly(system), places(system, excitation)
    axial = [term.name for term in terms if term.of in AXIAL]
    steps = _looked_at(excitation)
    rows = assembly.along(x[steps])
    factors, shares = np.full(len(steps), np.inf), np.zeros(len(steps))
    for k, step in enumerate(steps):
        with np.errstate(divide="ignore", invalid="ignore"):  # of cylinders of no length
            c = {name: float(signal.value(excitation.times[step])) for name, signal in signals.items()}
        if not np.isfinite(list(c.values())).all():
            continue
        held = Held(assembly, rows.at(k))
        factors[k] = held.factors({name: c[name] for name in axial})[0]
        either = [held.factors({name: way * amount for name, amount in c.items()}) for way in (1, -1)]
        shares[k] = 1.0 / np.min(either)
    return Stressed(excitation.times[steps], factors, shares)


def _looked_at(excitation: Excitation) -> NDArray[np.int64]:
    """Numbers of steps; none beside a kink of an extension, which accelerates for a step and is no load that lasts."""
    steps = np.unique(np.linspace(0, excitation.stepping.steps, TIMES).astype(np.int64))
    kinks = [t for path in excitation.paths.values() for t in path.kinks(excitation.stepping.end)]
    near_kink = np.abs(np.subtract.outer(excitation.times[steps], kinks)) < 2.0 * excitation.stepping.step
    return steps[~near_kink.any(axis=1)]


def decide_second_order(scene: Scene, bodies: Mapping[str, SlidingBody]) -> Scene:
    """The scene with second order or without it, where its frame leaves that open."""
    if scene.frame is None or scene.frame.second_order != "auto":
        return scene
    try:
        effect = second_order_effect(scene, bodies)
    except InputError:  # what nothing holds: no stiffness to compare with
        return _with(scene, True)
    chosen = "kept" if effect.matters else "left out"
    _log.info("second order is %s: stiffness changes by %.2g %%", chosen, 100.0 * effect.share)
    return _with(scene, effect.matters)


def as_made(scene: Scene, terms: Any) -> Scene:
    """Scene with the choice of second order that the system's `terms` were made with."""
    open_ = scene.frame is not None and scene.frame.second_order == "auto"
    return _with(scene, bool(terms)) if open_ else scene


def _with(scene: Scene, second_order: bool) -> Scene:
    assert scene.frame is not None  # of a scene that is asked about
    return scene.model_copy(update={"frame": scene.frame.model_copy(update={"second_order": second_order})})
