r"""Friction of pads (`pmr.system.friction`) in a step, compiled: iterated with the forces of terms.

.. math:: w = \sum_k e_k \mu_k \tau_k\, C'_k(x)^T \lambda_k, \qquad g = \sum_k (\mu_k / k) \, \tau_k |\lambda_k|

are what it adds to the forces on the modes, and to the gaps of cylinders that give way, with the amplitudes tau of
their joints.  What residual flexibility makes of the moments is in the gaps of all contacts.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.native.compilation import inlined
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.simd import LANES, aligned, load, store
from pmr.system.friction import Friction

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class Rubbing(NamedTuple):
    """Of n pads, with q sides that travel, among m contacts."""

    pads: Indices  # (n,): numbers of their contacts
    amplitude: Indices  # (n,): where that of their joint stands among all
    arms: Array  # (n,) m: e mu
    given_way: Array  # (m, n) m/N
    first_side: Indices  # (n + 1,)
    side: Indices  # (q,): which travel on, as `Sides` numbers them, one pad after the other
    slopes: Array  # (n, r') 1/m: C'
    answers: Array  # (m, n) 1/N: what residual flexibility makes of moments of the pads in all contacts
    gap: Array  # (m,) m: g, less what residual flexibility makes of the moments
    new_gap: Array  # (m,)
    old_gap: Array  # (m,): at the last step
    old_forces: Array  # (m,) N


def rubbing(form: SystemForm, before: int) -> Rubbing | None:
    """That of a system, with as many amplitudes `before` its own; None without friction."""
    system = form.modal
    known = Friction.of(system.contacts)
    if known is None:
        return None
    m, n, r = len(system.contacts), len(known.pads), int(form.starts[-1])
    travelling = [side for side in system.sides if side.place.path is not None]
    on = [[a for a, side in enumerate(travelling) if side.contact == k] for k in known.pads]
    return Rubbing(
        pads=known.pads,
        amplitude=before + known.drives,
        arms=known.arms,
        given_way=known.given_way,
        first_side=np.cumsum([0, *map(len, on)]),
        side=np.array([a for own in on for a in own], np.int64),
        slopes=aligned(np.zeros((n, r))),
        answers=np.zeros((m, n)),
        gap=np.zeros(m),
        new_gap=np.zeros(m),
        old_gap=np.zeros(m),
        old_forces=np.zeros(m),
    )


@inlined
def turn(rubbing: Any, bodies: Any, sides: Any) -> None:
    """C' of the pads where the contacts' sides stand now, and what moments of these move in all contacts."""
    if rubbing is not None:  # decided when compiled
        m = len(rubbing.gap)
        for j in range(len(rubbing.pads)):
            for n in range(0, rubbing.slopes.shape[1], LANES):
                store(rubbing.slopes[j], n, load(bodies.staying_slopes[j], n))
            for k in range(m):
                rubbing.answers[k, j] = sides.half[k, m + j]
            for at in range(rubbing.first_side[j], rubbing.first_side[j + 1]):
                _add_slope(rubbing, bodies, sides, rubbing.side[at], j)


@inlined
def _add_slope(rubbing: Any, bodies: Any, sides: Any, a: int, j: int) -> None:
    """What side a of pad j contributes."""
    body, q = bodies.rows.body[a], len(bodies.rows.body)
    for p in range(1, sides.powers.shape[1]):
        lowered = p * sides.powers[a, p - 1]
        for n in range(bodies.modes[body], bodies.modes[body + 1], LANES):
            value = load(rubbing.slopes[j], n) + load(sides.of_modes[a, p], n) * lowered
            store(rubbing.slopes[j], n, value)
        if bodies.first_flexibility[body + 1] == bodies.first_flexibility[body]:
            continue
        for k in range(len(rubbing.gap)):
            rubbing.answers[k, j] += sides.of_staying[a, p, k] * lowered
        for b in range(q):
            if bodies.rows.body[b] == body:
                moved = 0.0
                for o in range(sides.powers.shape[1]):
                    both = sides.of_others[b, a, o, p] if b >= a else sides.of_others[a, b, p, o]
                    moved += both * sides.powers[b, o]
                rubbing.answers[bodies.rows.contact[b], j] += moved * lowered


@inlined
def rub(rubbing: Any, c: Array, multipliers: Array, force: Array) -> None:
    """Add w to forces (r',), with amplitudes c and multipliers (m,); and g, as `Rubbing.new_gap`."""
    if rubbing is not None:
        for k in range(len(rubbing.new_gap)):
            rubbing.new_gap[k] = 0.0
        for j in range(len(rubbing.pads)):
            pressed = c[rubbing.amplitude[j]] * multipliers[rubbing.pads[j]]
            for n in range(0, len(force), LANES):
                store(force, n, load(force, n) + load(rubbing.slopes[j], n) * (rubbing.arms[j] * pressed))
            if pressed != 0.0:
                slides = c[rubbing.amplitude[j]] * abs(multipliers[rubbing.pads[j]])
                for k in range(len(rubbing.new_gap)):
                    moved = rubbing.answers[k, j] * rubbing.arms[j] * pressed
                    rubbing.new_gap[k] += rubbing.given_way[k, j] * slides - moved


@inlined
def gap(rubbing: Any, k: int) -> float:
    """How far the cylinder of contact k gives way to friction, m."""
    if rubbing is None:
        return 0.0
    return float(rubbing.gap[k])


@inlined
def gives_way(rubbing: Any, bound: float) -> bool:
    """Whether the gaps have changed by more than a share of the largest."""
    if rubbing is None:
        return False
    change, size = 0.0, 0.0
    for k in range(len(rubbing.gap)):
        change, size = max(change, abs(rubbing.new_gap[k] - rubbing.gap[k])), max(size, abs(rubbing.new_gap[k]))
    return change > bound * size


@inlined
def take(rubbing: Any) -> None:
    """The new gaps instead of the old ones."""
    if rubbing is not None:
        for k in range(len(rubbing.gap)):
            rubbing.gap[k] = rubbing.new_gap[k]


@inlined
def work(rubbing: Any, multipliers: Array) -> float:
    """Of friction on cylinders that give way since this was last called, J."""
    if rubbing is None:
        return 0.0
    done = 0.0
    for k in range(len(multipliers)):
        done -= (multipliers[k] + rubbing.old_forces[k]) / 2.0 * (rubbing.gap[k] - rubbing.old_gap[k])
        rubbing.old_forces[k], rubbing.old_gap[k] = multipliers[k], rubbing.gap[k]
    return done
