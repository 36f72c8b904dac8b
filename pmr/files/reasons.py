"""Reasons why a stiffness does not fit its nodes: what points, order, axes or units would have to be.

Each function takes a body that K resists where it should move freely.  It returns the input that is wrong (``points``
or ``direction``) and the reason in words, or None if its reason does not apply.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pmr.files.rigid import Resistance, rigid_motions

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]

#: Most coordinates for which dense matrices are decomposed to find the reason of a refusal.
DENSE = 3000
#: Relative difference up to which two numbers are equal, such as positions as shares of the body's length.
ALIKE = 1e-2


def affine_change(body: Resistance) -> tuple[str, str] | None:
    """Return wrong input and reason, if one linear map leads from directions, axes or units of points to those of K.

    K leaves u = Q (w x P x) free, with turned or reordered directions Q and stretched points P.  With E = Q P all these
    motions u = A x have E^T A skew, which E follows from.  None if there is no such map.
    """
    x, translations = body.points - body.points.mean(axis=0), body.direction < 3
    fields = np.zeros((len(body.node), 12))
    for a in range(3):
        on = body.direction == a
        fields[on, 3 * a : 3 * a + 3] = x[body.node[on]]
        fields[body.direction == a + 3, 9 + a] = 1.0
    fields = fields if not translations.all() else fields[:, :9]
    sizes = body.sums_of_moments[1]
    rows = ~body.grounded_nodes[body.node] & (sizes > 0.0)
    triangle = np.linalg.qr((body.K @ fields)[rows] / sizes[rows, None], mode="r")
    scale = np.linalg.norm(triangle, axis=0)
    if len(triangle) < fields.shape[1] or not scale.all():
        return None
    _, sigma, Vt = np.linalg.svd(triangle / scale)
    if np.sum(sigma < 1e-4 * sigma[0]) != 3:
        return None
    free = Vt[-3:] / scale
    A, turns = free[:, :9].reshape(3, 3, 3), free[:, 9:]
    if not translations.all():
        crossed = np.cross(turns[:, None], np.eye(3)[None]).transpose(0, 2, 1)
        unit = float(np.sum(crossed * A) / np.sum(crossed**2))
        if np.abs(A - unit * crossed).max() < ALIKE * np.abs(A).max():
            return "points", (
                f"places in the unit of K are allowed: it turns freely with places {unit:.4g} times these; "
                "are they in mm?"
            )
    equations = np.zeros((3, 3, 3, 3, 3))  # of E^T A + A^T E, by motion, row, column and entry of E
    for k in range(3):
        for i in range(3):
            for j in range(3):
                equations[k, i, j, :, i] += A[k, :, j]
                equations[k, i, j, :, j] += A[k, :, i]
    _, sigma, Vt = np.linalg.svd(equations.reshape(27, 9) / np.abs(A).max())
    E = Vt[-1].reshape(3, 3)
    volume = np.linalg.det(E)
    if sigma[-1] > 1e-3 * sigma[0] or abs(volume) < 1e-9:
        return None
    return _describe_axes(E / np.cbrt(volume))


def _describe_axes(E: Array) -> tuple[str, str]:
    """Return wrong input and reason for a linear map E (3, 3) between points and K: units, order of axes, or turn."""
    largest = np.abs(E).argmax(axis=1)
    smaller = E.copy()
    smaller[np.arange(3), largest] = 0.0
    factors = E[np.arange(3), largest]
    if np.abs(smaller).max() < ALIKE * np.abs(E).max() and len(set(largest)) == 3:
        stretch = np.abs(factors) / np.median(np.abs(factors))
        if stretch.max() / stretch.min() > 1.0 + ALIKE:
            odd = int(np.abs(np.log(stretch)).argmax())
            return "points", (
                f"places in one unit are allowed: K has those along {'xyz'[largest[odd]]} {stretch[odd]:.4g} times as "
                "far apart, beside the others"
            )
        names = ", ".join(
            f"{'-' if f < 0.0 else ''}{'xyz'[k]}" for f, k in zip(_mirrored_signs(factors), largest, strict=True)
        )
        return "direction", (
            f"directions in the order of K are allowed: the rows that are called x, y, z are along {names} of the "
            "places, or the places are in another order"
        )
    if np.abs(E @ E.T - np.eye(3)).max() < ALIKE:
        angle = np.degrees(np.arccos(np.clip((np.trace(E) * np.sign(np.linalg.det(E)) - 1.0) / 2.0, -1.0, 1.0)))
        return "direction", (
            f"the axes of the places are allowed for directions: K has all of them turned by {angle:.3g} degrees"
        )
    return "points", "the places that K was made for are allowed: these are stretched or sheared beside them"


def _mirrored_signs(factors: Array) -> Array:
    """Return the factors (3,), all negated if more than one is negative: K is the same for a mirrored body."""
    return np.asarray(factors if np.sum(factors < 0.0) <= 1 else -factors)


def misplaced_nodes(body: Resistance, wrong: Mask) -> tuple[str, str] | None:
    """Return wrong input and reason, if single nodes of `wrong` (N,) are not where K has them; else None.

    The points that K has follow from how these nodes move under rotations of the other nodes.
    """
    length = float(np.ptp(body.points, axis=0).max())
    levers = np.cross(np.eye(3)[None], (body.points - body.points.mean(axis=0))[:, None]).transpose(0, 2, 1)
    nodes, U = _rigid_followers(body, wrong, 3, levers, 1e-4 * length)
    if not len(nodes) or np.abs(U + U.transpose(0, 2, 1)).max() > 1e-3 * length or 2 * len(nodes) > len(body.points):
        return None
    x = np.stack([U[:, 1, 2] - U[:, 2, 1], U[:, 2, 0] - U[:, 0, 2], U[:, 0, 1] - U[:, 1, 0]], axis=1) / 2.0
    places = x + body.points.mean(axis=0)
    near, match = cKDTree(body.points[nodes]).query(places)
    if near.max() < 1e-4 * length and len(set(match)) == len(match):
        if len(nodes) == 2:
            return "points", (
                f"nodes in the order of K are allowed: those at {point_text(body.points[nodes[0]])} and "
                f"{point_text(body.points[nodes[1]])} are exchanged"
            )
        return "points", (
            f"nodes in the order of K are allowed: {len(nodes)} are in another one, it has that at "
            f"{point_text(body.points[nodes[0]])} at {point_text(places[0])}"
        )
    first = int(np.linalg.norm(places - body.points[nodes], axis=1).argmax())
    return "points", (
        f"places that K was made for are allowed: it has the node at {point_text(body.points[nodes[first]])} at "
        f"{point_text(places[first])}"
    )


def turned_nodes(body: Resistance, wrong: Mask, near_supports: Mask) -> tuple[str, str] | None:
    """Return wrong input and reason, if nodes of `wrong` (N,) have axes of their own; else None.

    Such nodes follow translations of the other nodes along turned or reversed axes.  A reversed axis can resist
    translations as a spring to ground does, so that nodes with springs that K couples with `wrong` are tried too.
    Nodes of the mask `near_supports` (N,) do not follow others as free ones do, so that first all others are tried.
    """
    coupled = np.zeros(len(wrong), dtype=bool)
    row, column, _ = body.entries
    coupled[body.node[row[wrong[body.node[column]]]]] = True
    springs = wrong | (coupled & body.spring_nodes)
    for mask in (springs & ~near_supports, springs, wrong):
        nodes, Q = _rigid_followers(body, mask, 0, np.tile(np.eye(3), (len(wrong), 1, 1)), ALIKE)
        if len(nodes) and np.abs(Q @ Q.transpose(0, 2, 1) - np.eye(3)).max() < 1e-3:
            return "direction", (
                f"directions along the axes of the places are allowed: {len(nodes)} nodes have axes of their own, that "
                f"at {point_text(body.points[nodes[0]])} {_describe_turn(Q[0])}"
            )
    return None


def _describe_turn(Q: Array) -> str:
    """Return orthogonal axes Q (3, 3) in words: along which axes of the places they are, or by what angle turned."""
    largest = np.abs(Q).argmax(axis=1)
    if np.abs(Q[np.arange(3), largest]).min() > 1.0 - ALIKE:
        signs = np.where(Q[np.arange(3), largest] < 0.0, "-", "")
        return "along " + ", ".join(f"{sign}{'xyz'[k]}" for sign, k in zip(signs, largest, strict=True))
    angle = np.degrees(np.arccos(np.clip((np.trace(Q) * np.sign(np.linalg.det(Q)) - 1.0) / 2.0, -1.0, 1.0)))
    return f"turned by {angle:.3g} degrees"


def lone_turned_nodes(body: Resistance) -> Mask:
    """Return a mask (N,) of nodes that follow translations of all others along turned axes, as no support causes.

    A node follows with U = -K_nn^-1 sum_j K_nj over the others: U is the identity away from supports, shortens motions
    near them, and is another orthogonal matrix for a node with axes of its own.
    """
    turned, T = np.zeros(len(body.points), dtype=bool), body.motions[:, :3]
    order = np.argsort(body.node, kind="stable")
    ends = np.cumsum(np.bincount(body.node, minlength=len(body.points)))
    pulled = body.K @ T
    for node in np.flatnonzero(body.grounded_nodes & ~body.missing_displacements.any(axis=1)):
        at = order[ends[node - 1] if node else 0 : ends[node]]
        node_stiffness = body.K[at][:, at].toarray()
        U = (T[at] - np.linalg.lstsq(node_stiffness, pulled[at], rcond=1e-12)[0])[body.direction[at] < 3]
        stays = np.eye(3)[body.direction[at][body.direction[at] < 3]]
        turned[node] = np.abs(U @ U.T - np.eye(3)).max() < 1e-6 and np.abs(U - stays).max() > ALIKE
    return turned


def _rigid_followers(body: Resistance, wrong: Mask, first: int, expected: Array, least: float) -> tuple[Indices, Array]:
    """Return the nodes (g,) that do not follow three rigid motions of the others as expected, and how they do.

    The motions are translations for `first` 0 and rotations for 3.  The nodes' displacements under them are `expected`
    (N, 3, 3), with the motion in the last axis; the second result (g, 3, 3) are the true ones, which differ by more
    than `least`.  Only nodes of `wrong` (N,) with all displacements are returned; a second pass treats those that
    follow after all as part of the others.
    """
    displaced = ~body.missing_displacements.any(axis=1)
    motions = rigid_motions((body.points - body.points.mean(axis=0))[body.node], body.direction)[:, first : first + 3]
    for _ in range(2):
        at, other_rows = np.flatnonzero(wrong[body.node]), np.flatnonzero(~wrong[body.node])
        if not 0 < len(at) <= DENSE or np.sum(~wrong) < 3:
            return np.empty(0, np.int64), np.empty((0, 3, 3))
        try:
            factor = scipy.linalg.cho_factor(body.K[at][:, at].toarray())
        except np.linalg.LinAlgError:
            return np.empty(0, np.int64), np.empty((0, 3, 3))
        U, translations = expected.copy(), body.direction[at] < 3
        followed = scipy.linalg.cho_solve(factor, -(body.K[at][:, other_rows] @ motions[other_rows]))
        U[body.node[at][translations], body.direction[at][translations]] = followed[translations]
        wrong = wrong & displaced & (np.abs(U - expected).max(axis=(1, 2)) > least)
    nodes = np.flatnonzero(wrong)
    return nodes, U[nodes]


def rows_by_direction(body: Resistance) -> tuple[str, str] | None:
    """Return wrong input and reason, if rows are ordered by direction instead of node by node; else None."""
    count = len(body.node)
    each = count // max(len(np.unique(body.node)), 1)
    if each not in (3, 6) or not np.array_equal(body.direction, np.tile(np.arange(each), count // each)):
        return None
    direction = np.repeat(np.arange(each), count // each)
    T = (direction[:, None] == np.arange(3)).astype(float)
    if np.abs(body.K @ T).max() > 1e-6 * (abs(body.K) @ T).max():
        return None
    return "direction", "rows node by node are allowed: these are all along x, then all along y, and so on"


def all_axes_turned(body: Resistance) -> tuple[str, str] | None:
    """Return wrong input and reason, if K is that of these points with different axes at each node; else None.

    Its free motions are then z_j = Q_j (1, -[x_j]) A, so that tr(z_j B z_j^T) = 3 + 2 |x_j|^2 with one symmetric B.
    """
    count = len(body.points)
    order = np.lexsort((body.direction, body.node))
    if body.K.shape[0] != 3 * count or count * 3 > DENSE or np.any(body.direction >= 3):
        return None
    values, vectors = scipy.linalg.eigh(body.K.toarray(), subset_by_index=(0, 6))
    if values[5] > 1e-3 * values[6]:
        return None
    z = vectors[order, :6].reshape(count, 3, 6)
    x = body.points - body.points.mean(axis=0)
    length = np.ptp(x, axis=0).max()
    gram = np.einsum("nai,naj->nij", z, z)
    upper = np.triu_indices(6)
    A = np.where(upper[0] == upper[1], 1.0, 2.0) * gram[:, *upper]
    squares = 3.0 + 2.0 * np.sum((x / length) ** 2, axis=1)
    B = np.linalg.lstsq(A, squares, rcond=None)[0]
    if count < 22 or np.abs(A @ B - squares).max() > 1e-4:
        return None
    return "direction", "directions along the axes of the places are allowed: nodes have axes of their own"


def point_text(x: Array) -> str:
    """Return a point (3,) in m as text for messages."""
    return "({}) m".format(", ".join(f"{c + 0.0:.4g}" for c in np.round(x, 9)))
