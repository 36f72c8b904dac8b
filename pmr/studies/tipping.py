r"""A machine that tips over an edge of the polygon it stands on.

.. math::
    \gamma\, \frac{P\; \hat n \cdot (p + u) \times F_1}{-\hat n \cdot (M - P\, (p + u) \times F_1 + M_m)} = 1

is reached at the load P in kg at which the machine tips.  Moments are taken about an edge of the polygon, with the unit
vector n along the edge.  M is the moment about the edge by the force and the moment with which the boom presses on its
machine at the pivot, as in a run (`pmr.simulation.reactions`).  M contains the moment of the load: the force of 1 kg of
the load, F_1, times P, acts at the tip p, which is displaced by u.  M_m is the moment of the machine's weight,
:math:`\gamma` the limit's factor.  All vectors are in the axes of the base, which may be inclined; the weight acts on
the deflected boom.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pmr.errors import InputError
from pmr.files.arrays import Array
from pmr.scene.frame import boom_rotation
from pmr.scene.ground import MachineMass
from pmr.simulation.statics.loaded import LoadedStates
from pmr.simulation.statics.postures import HOOK, WEIGHT, PostureMatrices

AXES = ("x", "y", "z", "rx", "ry", "rz")


@dataclass(frozen=True)
class TippingMoments:
    """Moments about the e edges of a polygon at one posture; positive moments tip the machine.

    Edges run anticlockwise.
    """

    machine: Array  # (e,) N m: moment of the machine's weight
    boom: Array  # (e, o): moment of boom and load together, by a unit of each of o outputs
    tip_moment: Array  # (e,) N m: moment of 1 kg of the load at the undeformed tip
    tip_derivative: Array  # (e, o): change of `tip_moment` by a unit of each output

    @classmethod
    def compute(cls, edges: Array, resting: Array, at: PostureMatrices, k: int, amounts: Array) -> TippingMoments:
        """Compute the moments at the k-th posture of `at`, about edges with the rows (e, 6) of `edge_rows`.

        `resting` (6,) is the weight of the machine's masses with its moment about the pivot; `amounts` (w,) are the
        amounts by which the w components ``at.loads`` (weight, load, loads of the scene) act.  Raises InputError if a
        force or moment at the pivot is not among the outputs.
        """
        turned = boom_rotation(at.place.luffing[k : k + 1], at.place.slewing[k : k + 1])[0]
        about = np.hstack([edges[:, :3] @ turned, edges[:, 3:] @ turned])  # rows for forces in the boom's axes
        pull = amounts[at.loads.names.index(HOOK)] * at.hook_force(k)
        moment = about[:, 3:] @ _cross_matrix(pull)
        return cls(
            machine=edges @ resting,
            boom=about @ pivot_rows(at),
            tip_moment=about[:, :3] @ pull + moment @ at.place.tip[k],
            tip_derivative=moment @ _tip_rows(at.output_names, at.output_kinds),
        )

    def share(self, states: LoadedStates, factor: float) -> Array:
        """Return (p,) the moment of `factor` times the load over the resisting moment about the worst edge, by state.

        The result is infinite where no moment resists.
        """
        load = states.load[:, None] * (self.tip_moment + states.outputs @ self.tip_derivative.T)
        held = load - self.machine - states.outputs @ self.boom.T
        return np.asarray(np.where(held > 0.0, factor * load / np.where(held > 0.0, held, 1.0), np.inf).max(axis=1))

    def overturning_load(self, states: LoadedStates, factor: float) -> float:
        """Return a load in kg whose moment is the load's own moment plus the moment of the boom divided by `factor`.

        Both moments are absolute values about the worst edge; `states` hold one state.
        """
        load = states.load[0] * (self.tip_moment + states.outputs[0] @ self.tip_derivative.T)
        boom = states.outputs[0] @ self.boom.T - load
        held = -self.machine - boom
        worst = int(np.argmax(factor * load / np.where(held > 0.0, held, np.nan)))
        return float(states.load[0] * (1.0 + abs(boom[worst]) / (factor * abs(load[worst]))))


def weight_of_masses(masses: Sequence[MachineMass], at: PostureMatrices, k: int, amounts: Array) -> Array:
    """Return the weight of `masses` of the machine and its moment about the pivot (6,) at the k-th posture of `at`.

    `amounts` are the amounts of the loads of the postures, the weight's among them.
    """
    turned = boom_rotation(at.place.luffing[k : k + 1], at.place.slewing[k : k + 1])[0]
    weight, up = amounts[at.loads.names.index(WEIGHT)] * at.gravity, turned @ at.place.up[k]
    resting, (c, s) = np.zeros(6), (np.cos(at.place.slewing[k]), np.sin(at.place.slewing[k]))
    for part in masses:
        x, y, z = part.at
        force = -part.mass * weight * up
        place = np.array([c * x - s * y, s * x + c * y, z] if part.slews else part.at)
        resting += np.concatenate([force, np.cross(place, force)])
    return resting


def _cross_matrix(force: Array) -> Array:
    """Return the matrix (3, 3) whose product with a vector u is the cross product u x F with the `force` F."""
    x, y, z = force.tolist()
    return np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])


def pivot_rows(at: PostureMatrices) -> Array:
    """Return the rows (6, o) that select force and moment at the pivot from the o outputs of the postures `at`.

    For a planar boom the rows of y, rx and rz are zero.  Raises InputError if another direction is not among the
    outputs.
    """
    columns, count = at.columns.pivot_columns(), len(at.output_names)
    planar = not {"y", "rx", "rz"} & set(columns)
    missing = [axis for axis in AXES if axis not in columns and not (planar and axis in ("y", "rx", "rz"))]
    if missing:
        allowed = f"a scene whose run has force and moment at the pivot is allowed: {', '.join(missing)} is not known"
        raise InputError("study", "limits", "overturning", allowed)
    rows = np.zeros((6, count))
    for number, axis in enumerate(AXES):
        if axis in columns:
            rows[number, columns[axis]] = 1.0
    return rows


@lru_cache(64)
def _tip_rows(names: tuple[str, ...], kinds: tuple[str, ...]) -> Array:
    """Return the rows (3, o) that select the tip's displacement along the boom's x, y and z from o outputs.

    `names` and `kinds` (o,) are the outputs' names and kinds.  A direction without an output has a row of zeros.
    """
    tips = [name if kind == "tip" else "" for name, kind in zip(names, kinds, strict=True)]
    return np.array([[name.endswith(axis) for name in tips] for axis in "xyz"], dtype=float)
