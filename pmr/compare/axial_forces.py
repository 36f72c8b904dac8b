r"""Axial forces that second order leaves out: how much they would change the stiffness.

Without ``[frame]`` the equations are those of first order.  In a frame, second order has loads on tips alone.

The geometric stiffness of an axial force N(x), tension positive, with the deflections w along y and z is estimated
from the observed displacements :math:`w_k` at :math:`x_k`:

.. math:: \delta w^T G\, w = \int N\, w' \delta w'\, dx \approx \sum_k N(\tfrac{x_k + x_{k+1}}{2})\,
    \frac{(w_{k+1} - w_k)(\delta w_{k+1} - \delta w_k)}{x_{k+1} - x_k}

A force along the axis runs to the support that holds the body along it, or to the tail, where a cylinder holds it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from pmr.compare.moving_frame import stiffness_changes
from pmr.errors import InputError
from pmr.files.arrays import Array
from pmr.results.run import SummaryPart
from pmr.scene import Scene
from pmr.scene.built import WEIGHT
from pmr.scene.choice import axis_loads
from pmr.scene.keys import input_name
from pmr.scene.members import Member, members
from pmr.simulation import Excitation
from pmr.simulation.start import dense
from pmr.system.body import SlidingBody, kinds_of
from pmr.system.system import System
from pmr.system.terms import Term

#: Number of equal pieces into which the weight of a body is cut along its axis.
PIECES = 40


class AxialForce(NamedTuple):
    """Axial force in a body under one unit of the input called `load`: `at` returns it in N at places (k,) in m."""

    load: str
    at: Callable[[Array], Array]


def axial_part(scene: Scene, system: System, excitation: Excitation, masses: Mapping[str, float]) -> SummaryPart:
    """Part with a warning if axial forces matter that second order leaves out; a grave one beyond the buckling load.

    Without a frame these are all axial forces.  With a frame they are those of loads that do not act at a tip.  Of a
    boom of several sections, only the section that a load acts on is looked at, not those whose cylinders hold it.
    `masses` are those of the bodies in kg by name, without what is attached to them; a body that is missing among them
    has no weight here.
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
    """Yield the axial force that each load along the axis of a body causes, and that of the body's weight.

    In a frame, loads at the tip are left out.  `mass` in kg is that of the body without what is attached to it.
    """
    part, tip = member.part, float(np.max(body.output_positions, initial=0.0))

    def place(on: str | float) -> float | None:
        """Position in m of a group or number; the farthest observed place is the tip of a mesh."""
        at = part.position_of(on)
        return tip if at is None and on == "tip" else at

    held = [place(support.on) for support in part.supports if "x" in support.held_directions]
    holds = min((at for at in held if at is not None), default=0.0)

    def between(at: float, x: Array) -> Array:
        """Axial force (k,) at places x under a unit force along x at `at`: 1 or -1 towards the support, else 0."""
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
            """Axial force (k,) at places x under the weight, for a unit of gravity."""
            return np.sum([m * between(at, x) for m, at in weights], axis=0)

        yield AxialForce(WEIGHT, of_weight)


def geometric_stiffness(body: SlidingBody, force: AxialForce) -> Array:
    """Estimate of the geometric stiffness (n, n) of an axial force on a body, from its observed displacements."""
    outputs, kinds, G = dense(body.outputs), np.array(kinds_of(body)), np.zeros((body.size, body.size))
    for axis in "yz":
        across = np.flatnonzero(np.isin(kinds, [f"beam {axis}", f"tip {axis}"]))
        x, first = np.unique(body.output_positions[across], return_index=True)
        slopes = np.diff(outputs[across[first]], axis=0) / np.diff(x)[:, None]
        G += slopes.T @ ((force.at((x[1:] + x[:-1]) / 2.0) * np.diff(x))[:, None] * slopes)
    return G
