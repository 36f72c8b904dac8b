r"""Rigid motions that supports and pads leave free, from the geometry alone.

With the rigid motions R of a body, translations and rotations, what holds it at s measures C(s) R of them: pads,
springs or not, cylinders and clamped coordinates.  Motions in the null space of that meet no resistance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.constraints.rows import Row
from pmr.fullmodel.pads import Pads, fixed_pad, restrain
from pmr.fullmodel.structure import Structure
from pmr.models import DIRECTIONS

Array = NDArray[np.float64]

#: Places along the path at which the body is looked at.
PLACES = 33
#: Motions that are held by less than this share of what holds the others are free; pads measure them to 1e-12.
FREE = 1e-7
AXES = "xyz"
_SAID = "supports and pads leave the body free to {}{}: loads along that move it without limit"


@dataclass(frozen=True)
class Freedom:
    """Motions (6, k) that nothing resists: displacements of the origin and rotations; with s at `s` m."""

    motions: Array
    s: float


def warnings(structure: Structure, path: tuple[float, float]) -> list[str]:
    """What to say of motions that are free somewhere on the path, from s to s in m; nothing if there are none."""
    found = [(freedom.s, described(freedom.motions)) for freedom in freedoms(structure, path)]
    s, most = max(found, key=lambda pair: len(pair[1]))  # the first of several
    if not most:
        return []
    always = all(words == most for _, words in found)
    return [_SAID.format(", ".join(most), "" if always else f" with s at {s:.4g} m")]


def freedoms(structure: Structure, path: tuple[float, float]) -> list[Freedom]:
    """What is free at places along the path, from its one end to the other, m."""
    model, pads = structure.model, structure.pads
    R, whole = model.rigid_motions(), sp.eye(structure.model.size, format="csr")
    still = restrain(replace(pads, moving=(), sliders=(), straight=()), model, whole)
    points = restrain(Pads(sliders=pads.sliders), model, whole).rows
    held = [_measured((*still.rows, *still.springs), R)]
    held += [R[model.coordinates_on(clamp.on, clamp.directions)] for clamp in structure.clamps]
    first, last = (
        _measured([fixed_pad(replace(pad, at=pad.at + s), model, whole, pads.travel) for pad in pads.moving], R)
        for s in path
    )
    found = []
    for share in np.linspace(0.0, 1.0, PLACES):
        moving = first + share * (last - first)  # lines in s: pads measure rigid motions as such
        s = (1.0 - share) * path[0] + share * path[1]
        free = _null_space(np.vstack([*held, moving, _measured(points, R, s)]), R)
        found.append(Freedom(_in_space(free, model.directions), s))
    return found


def _measured(rows: Sequence[Row], R: Array, s: float | None = None) -> Array:
    """What rows measure of each rigid motion at s, (m, k); for those that stay s plays no role."""
    measured = [row.at(row.breaks[0] if s is None else s) @ R for row in rows]
    return np.array(measured).reshape(-1, R.shape[1])


def _null_space(C: Array, R: Array) -> Array:
    """Combinations (k, f) of the rigid motions of which C (m, k) measures nothing."""
    scale = np.abs(R).max(axis=0)  # rotations in units that move the body's far end as far as translations do
    C = C / scale
    size = np.linalg.norm(C, axis=1)
    C = C[size > 0.0] / size[size > 0.0, None]
    if not len(C):
        return np.diag(1.0 / scale)
    _, sigma, Vt = np.linalg.svd(C, full_matrices=True)
    return np.asarray(Vt[int(np.sum(sigma > FREE * sigma[0])) :].T / scale[:, None])


def _in_space(motions: Array, directions: Sequence[str]) -> Array:
    """As displacements along and rotations about x, y, z, (6, f)."""
    space = np.zeros((6, motions.shape[1]))
    space[[DIRECTIONS.index(direction) for direction in directions]] = motions
    return space


def described(motions: Array) -> list[str]:
    """Free motions (6, f) in words: translations first, then turns about axes."""
    theta = motions[3:]
    _, sigma, Vt = np.linalg.svd(theta, full_matrices=True)
    turns = int(np.sum(sigma > FREE * np.abs(motions).max(initial=0.0)))
    shifts = _reduced(Vt[turns:] @ motions[:3].T)
    said = [f"move along {_direction(shift)}" for shift in shifts]
    for motion in _reduced(Vt[:turns] @ np.vstack([theta, motions[:3]]).T):
        about, moved = motion[:3], motion[3:]
        if len(shifts):
            moved = moved - shifts.T @ np.linalg.lstsq(shifts.T, moved, rcond=None)[0]
        said.append(f"turn about {_direction(about)} through {_place(np.cross(about, moved) / (about @ about))}")
    return said


def _reduced(A: Array) -> Array:
    """The span of rows (f, d) with as many zeros as possible: reduced by Gauss and Jordan."""
    row = 0
    for column in range(A.shape[1]):
        if row == len(A):
            break
        pivot = row + int(np.abs(A[row:, column]).argmax())
        if np.abs(A[pivot, column]) <= FREE * np.abs(A).max():
            continue
        A[[row, pivot]] = A[[pivot, row]]
        A[row] /= A[row, column]
        others = np.arange(len(A)) != row
        A[others] -= np.outer(A[others, column], A[row])
        row += 1
    return A[:row]


def _direction(vector: Array) -> str:
    unit = vector / np.linalg.norm(vector)
    along = int(np.abs(unit).argmax())
    if np.abs(unit[along]) > 1.0 - 1e-6:
        return AXES[along]
    return "({})".format(", ".join(f"{c + 0.0:.3g}" for c in np.round(unit, 3)))


def _place(at: Array) -> str:
    return "({}) m".format(", ".join(f"{c + 0.0:.4g}" for c in np.round(at, 6)))
