r"""Friction of pads (`pmr.system.friction`) in a step, compiled: iterated with the forces of terms.

.. math:: w = \sum_j e_j \operatorname{sign}(\lambda_j) f_j\, C'_j(x)^T, \qquad g = \sum_j f_j / k

are what it adds to the forces on the modes, and to the gaps of cylinders that give way.  What residual flexibility
makes of the moments is in the gaps of all contacts.  The pads of a joint slide by what follows from the multipliers of
the last iteration; as more friction f makes the joint slide less, by at most

.. math:: \alpha = \frac{a}{1 + k a}, \qquad a = (dq\, C S^{-1} C^T + G)_{cc}

a unit with the row c of its cylinder, the next iteration solves

.. math::
    \Delta y + \alpha \Bigl(\sum_j \operatorname{clip}(f_{j,n} + \kappa_j \Delta y,\ \pm \mu_j |\lambda_j|) - f\Bigr)
    = \Delta s - (\lambda + f - \Lambda_n) / k

for the slip of a joint.  As alpha is never too small, what is left of an error has the same sign and is smaller; of a
joint alone nothing is left.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.native.arrays import State
from pmr.simulation.native.compilation import addressed, compiled_and_inlined, inlined
from pmr.simulation.native.extrapolation import BEFORE
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.rows import dot
from pmr.simulation.native.side_arrays import Bodies, Sides
from pmr.simulation.native.simd import LANES, aligned, load, store
from pmr.system.friction import Friction

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Of the lengths that a slip is found from: what is round-off; and how often it is improved at most.
ROUND_OFF, TRIES = 1e-15, 64

_NUMBERS, _FLOATS = np.zeros(0, np.int64), np.zeros(0)
_NOTHING = Friction(
    joints=(),
    pads=_NUMBERS,
    first=np.zeros(1, np.int64),
    cylinders=_NUMBERS,
    gives=_FLOATS,
    coefficients=_FLOATS,
    stiffness=_FLOATS,
    arms=_FLOATS,
    count=0,
)


class Rubbing(NamedTuple):
    """Of n pads in J joints, with q sides that travel, among m contacts; old is what stood at the last step's end."""

    pads: Indices  # (n,): numbers of their contacts
    first: Indices  # (J + 1,): where those of a joint begin
    cylinders: Indices  # (J,): numbers of these contacts; -1 of a joint without
    gives: Array  # (J,) m/N: 1/k
    coefficients: Array  # (n,): mu
    stiffness: Array  # (n,) N/m: kappa
    arms: Array  # (n,) m: e
    path: Indices  # (J,): number of the joint's path
    first_side: Indices  # (n + 1,)
    side: Indices  # (q,): which travel on, as `Sides` numbers them, one pad after the other
    slopes: Array  # (n, r') 1/m: C'
    answers: Array  # (m, n) 1/N: what residual flexibility makes of moments of the pads in all contacts
    s: Array  # (J,) m
    old_s: Array
    old_drives: Array  # (J,) N: Lambda
    limits: Array  # (n,) N: mu |N|
    forces: Array  # (n,) N: f
    old_forces: Array
    given: Array  # (J,) N: that of each joint which `gap` has
    new_given: Array  # (J,) N
    gap: Array  # (m,) m: g, less what residual flexibility makes of the moments
    new_gap: Array  # (m,)
    old_gap: Array
    old_multipliers: Array  # (m,) N
    # (2,): the largest gap in m and the largest square of w in N^2 so far, with all pads at their limits
    largest: Array
    began: Array  # (n,) N: `old_forces`, `old_s` and `old_drives` where a step in parts began
    began_at: Array  # (2, J)


def rubbing(form: SystemForm, paths: Sequence[str]) -> Rubbing | None:
    """That of a system that travels on `paths`, by their names; without entries where nothing rubs.

    None of a body on its tables, none of whose contacts rubs.
    """
    system = form.modal
    known = Friction.of(system.contacts)
    if known is None:
        if form.on_tables is not None:
            return None
        known = _NOTHING
    m, n, J, r = known.count, len(known.pads), len(known.joints), int(form.starts[-1])
    travelling = [side for side in system.sides if side.place.path is not None]
    on = [[a for a, side in enumerate(travelling) if side.contact == k] for k in known.pads]
    return Rubbing(
        pads=known.pads,
        first=known.first,
        cylinders=known.cylinders,
        gives=known.gives,
        coefficients=known.coefficients,
        stiffness=known.stiffness,
        arms=known.arms,
        path=np.array([paths.index(name) for name in known.joints], np.int64),
        first_side=np.cumsum([0, *map(len, on)]),
        side=np.array([a for own in on for a in own], np.int64),
        slopes=aligned(np.zeros((n, r))),
        answers=np.zeros((m, n)),
        s=np.zeros(J),
        old_s=np.zeros(J),
        old_drives=np.zeros(J),
        limits=np.zeros(n),
        forces=np.zeros(n),
        old_forces=np.zeros(n),
        given=np.zeros(J),
        new_given=np.zeros(J),
        gap=np.zeros(m),
        new_gap=np.zeros(m),
        old_gap=np.zeros(m),
        old_multipliers=np.zeros(m),
        largest=np.zeros(2),
        began=np.zeros(n),
        began_at=np.zeros((2, J)),
    )


def start(rubbing: Rubbing, s: Array, multipliers: Array) -> None:
    """At rest without friction, where paths lead to s (P,) m and contacts have multipliers (m,) N."""
    rubbing.s[:] = rubbing.old_s[:] = s[rubbing.path]
    rubbing.old_multipliers[:] = multipliers
    rubbing.old_drives[:] = np.where(rubbing.cylinders < 0, 0.0, multipliers[rubbing.cylinders])


@addressed
def turn(rubbing: Rubbing, bodies: Bodies, sides: Sides) -> int:
    """Where joints stand, C' of the pads where the contacts' sides do, what their moments move in all contacts; 0."""
    m = len(rubbing.gap)
    for i in range(len(rubbing.s)):
        rubbing.s[i] = sides.s[rubbing.path[i]]
    for j in range(len(rubbing.pads)):
        for n in range(0, rubbing.slopes.shape[1], LANES):
            store(rubbing.slopes[j], n, load(bodies.staying_slopes[j], n))
        for k in range(m):
            rubbing.answers[k, j] = sides.half[k, m + j]
        for at in range(rubbing.first_side[j], rubbing.first_side[j + 1]):
            _add_slope(rubbing, bodies, sides, rubbing.side[at], j)
    return 0


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
def rub(rubbing: Any, state: State, force: Array) -> None:
    """Find f from the present multipliers; add w to forces (r',), and g as `Rubbing.new_gap`."""
    if rubbing is None:
        return
    multipliers = state.multipliers
    for j in range(len(rubbing.pads)):
        rubbing.limits[j] = rubbing.coefficients[j] * abs(multipliers[rubbing.pads[j]])
    for k in range(len(rubbing.new_gap)):
        rubbing.new_gap[k] = 0.0
    gap, square = 0.0, 0.0
    for i in range(len(rubbing.s)):
        c, gives = rubbing.cylinders[i], rubbing.gives[i]
        moved, softness = rubbing.s[i] - rubbing.old_s[i], 0.0
        if gives > 0.0:
            a = max(state.couplings[c, c] - gives, 0.0)
            softness = gives * a / (gives + a)
            moved -= gives * (multipliers[c] + rubbing.given[i] - rubbing.old_drives[i])
        own = slice(rubbing.first[i], rubbing.first[i + 1])
        total = slide(
            rubbing.stiffness[own], rubbing.old_forces[own], rubbing.limits[own], moved, softness, rubbing.given[i],
            rubbing.forces[own],
        )  # fmt: skip
        rubbing.new_given[i] = total
        if gives > 0.0:
            rubbing.new_gap[c] += gives * total
            for j in range(rubbing.first[i], rubbing.first[i + 1]):
                gap += gives * rubbing.limits[j]
    for j in range(len(rubbing.pads)):
        moment = rubbing.arms[j] * rubbing.forces[j]
        if multipliers[rubbing.pads[j]] < 0.0:
            moment = -moment
        square += (rubbing.arms[j] * rubbing.limits[j]) ** 2 * dot(rubbing.slopes[j], rubbing.slopes[j])
        if moment != 0.0:
            for n in range(0, len(force), LANES):
                store(force, n, load(force, n) + load(rubbing.slopes[j], n) * moment)
            for k in range(len(rubbing.new_gap)):
                rubbing.new_gap[k] -= rubbing.answers[k, j] * moment
    rubbing.largest[0], rubbing.largest[1] = max(rubbing.largest[0], gap), max(rubbing.largest[1], square)


@compiled_and_inlined
def slide(
    stiffness: Array, old: Array, limits: Array, moved: float, softness: float, given: float, new: Array
) -> float:
    r"""New friction (p,) N of a joint's pads after the old one, and its sum.

    Under a friction `given` in N it slides by `moved` m, and by `softness` m/N less under more of it,

    .. math:: x + \alpha \Bigl(\sum_j \operatorname{clip}(f_j + \kappa_j x,\ \pm l_j) - f\Bigr) = \Delta y

    the left side of which grows with x, at least as x does: Newton's steps, kept between what is known to be too
    little and too much.  Where all pads slide on both sides of the solution such steps go to and fro for ever; so one
    that is not half as long as the one before gives way to halving what is between.
    """
    x, low, high, last, total = moved, -np.inf, np.inf, np.inf, 0.0
    for _ in range(TRIES):
        total, slope, size = 0.0, 1.0, 0.0
        for j in range(len(new)):
            value = old[j] + stiffness[j] * x
            new[j] = min(max(value, -limits[j]), limits[j])
            total += new[j]
            size += abs(new[j])
            if new[j] == value:
                slope += softness * stiffness[j]
        off = x + softness * (total - given) - moved
        if abs(off) <= ROUND_OFF * (abs(x) + abs(moved) + softness * (size + abs(given))):
            break
        if off > 0.0:
            low, high = max(low, x - off), x
        else:
            low, high = x, min(high, x - off)
        ahead = x - off / slope
        if abs(ahead - x) > last / 2.0 or not low <= ahead <= high:
            ahead = low + (high - low) / 2.0
        last, x = abs(ahead - x), ahead
    return total


@inlined
def gap(rubbing: Any, k: int) -> float:
    """How far the cylinder of contact k gives way to friction, m."""
    if rubbing is None or k >= len(rubbing.gap):
        return 0.0
    return float(rubbing.gap[k])


@inlined
def largest_square(rubbing: Any) -> float:
    """The largest |w|^2 of friction so far, N^2, with all pads at their limits."""
    return 0.0 if rubbing is None else float(rubbing.largest[1])


@inlined
def gives_way(rubbing: Any, bound: float) -> bool:
    """Whether the gaps have changed by more than a share of the largest so far."""
    if rubbing is None:
        return False
    change, size = 0.0, rubbing.largest[0]
    for k in range(len(rubbing.gap)):
        change, size = max(change, abs(rubbing.new_gap[k] - rubbing.gap[k])), max(size, abs(rubbing.new_gap[k]))
    rubbing.largest[0] = size
    return change > bound * size


@inlined
def take(rubbing: Any) -> None:
    """The new gaps instead of the old ones."""
    if rubbing is not None:
        for k in range(len(rubbing.gap)):
            rubbing.gap[k] = rubbing.new_gap[k]
        for i in range(len(rubbing.given)):
            rubbing.given[i] = rubbing.new_given[i]


@inlined
def note(rubbing: Any, history: Any, first: int, force: float) -> None:
    """Write gaps, and the friction that they have, behind the first numbers of an iterate, the largest as `force`."""
    if rubbing is None:
        return
    m = len(rubbing.gap)
    if not history.counts[BEFORE]:
        largest = rubbing.largest[0]
        history.unit[0] = (force if force > 0.0 else 1.0) / (largest if largest > 0.0 else 1.0)
    for k in range(m):
        history.x[first + k] = rubbing.gap[k] * history.unit[0]
        history.residual[first + k] = (rubbing.new_gap[k] - rubbing.gap[k]) * history.unit[0]
    for i in range(len(rubbing.given)):
        history.x[first + m + i] = rubbing.given[i]
        history.residual[first + m + i] = rubbing.new_given[i] - rubbing.given[i]


@inlined
def follow(rubbing: Any, history: Any, first: int) -> None:
    """Take gaps, and the friction that they have, from the next iterate."""
    if rubbing is None:
        return
    m = len(rubbing.gap)
    for k in range(m):
        rubbing.new_gap[k] = history.x[first + k] / history.unit[0]
    for i in range(len(rubbing.given)):
        rubbing.new_given[i] = history.x[first + m + i]


@inlined
def _total(rubbing: Any, i: int) -> float:
    """Of joint i."""
    total = 0.0
    for j in range(rubbing.first[i], rubbing.first[i + 1]):
        total += rubbing.forces[j]
    return total


@inlined
def begin(rubbing: Any) -> None:
    """Go on from the last step's end, whatever was tried since."""
    if rubbing is not None:
        for j in range(len(rubbing.forces)):
            rubbing.forces[j] = rubbing.old_forces[j]
        for i in range(len(rubbing.given)):
            rubbing.given[i], rubbing.s[i] = _total(rubbing, i), rubbing.old_s[i]


@inlined
def finish(rubbing: Any, multipliers: Array) -> float:
    """End a step: the work of friction on cylinders that give way since this was last called, J."""
    if rubbing is None:
        return 0.0
    done = 0.0
    for k in range(len(rubbing.gap)):
        done -= (multipliers[k] + rubbing.old_multipliers[k]) / 2.0 * (rubbing.gap[k] - rubbing.old_gap[k])
        rubbing.old_multipliers[k], rubbing.old_gap[k] = multipliers[k], rubbing.gap[k]
    for j in range(len(rubbing.forces)):
        rubbing.old_forces[j] = rubbing.forces[j]
    for i in range(len(rubbing.s)):
        rubbing.old_s[i] = rubbing.s[i]
        if rubbing.cylinders[i] >= 0:
            rubbing.old_drives[i] = multipliers[rubbing.cylinders[i]] + _total(rubbing, i)
    return done


@inlined
def mark(rubbing: Any) -> None:
    """Note where a step begins."""
    if rubbing is not None:
        for j in range(len(rubbing.began)):
            rubbing.began[j] = rubbing.old_forces[j]
        for i in range(len(rubbing.s)):
            rubbing.began_at[0, i], rubbing.began_at[1, i] = rubbing.old_s[i], rubbing.old_drives[i]


@inlined
def take_back(rubbing: Any) -> None:
    """Return to where the step began."""
    if rubbing is not None:
        for j in range(len(rubbing.began)):
            rubbing.old_forces[j] = rubbing.began[j]
        for i in range(len(rubbing.s)):
            rubbing.old_s[i], rubbing.old_drives[i] = rubbing.began_at[0, i], rubbing.began_at[1, i]
