"""Reasons why matrices do not fit their nodes: what points, order, axes or units would have to be.

Each function gets a body whose stiffness K resists motions that should be free.  It returns or yields the name of the
wrong input (``M``, ``points`` or ``direction``) and the reason in words; None, or nothing, if its reason does not
apply.  Units are checked by speed of sound and density.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from scipy.spatial import Delaunay, QhullError, cKDTree

from pmr.files.arrays import Array, Indices, Mask
from pmr.files.rigid import DENSE, Resistance, rigid_motions

#: Relative difference up to which two numbers count as equal; for positions it is a share of the body's length.
ALIKE = 1e-2


class Reason(NamedTuple):
    """Why matrices are refused: the name of the wrong input, and what is allowed in its place."""

    input: str
    text: str


def affine_change(body: Resistance) -> Reason | None:
    """Return (wrong input, reason) if one linear map leads from the directions or points of the body to those of K.

    Such a map changes axes, order or units.  Let a node at x have the displacement u in a rotation by the vector w.  If
    the directions are turned or reordered by the matrix Q, and the points stretched by the matrix P, K leaves motions u
    = Q (w x P x) free.  They are motions u = A x with three matrices A.  With the map E = Q P, all three products E^T A
    are skew-symmetric, and E follows from this.  None is returned if there is no such map.
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
            return Reason(
                "points",
                f"places in the unit of K are allowed: it turns freely with places {unit:.4g} times these; "
                "are they in mm?",
            )
    equations = np.zeros((3, 3, 3, 3, 3))  # E^T A + A^T E by motion, row and column, per unit of each entry of E
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


def _describe_axes(E: Array) -> Reason:
    """Return (wrong input, reason) for a linear map E (3, 3) between points and K: units, order of axes, or turn."""
    largest = np.abs(E).argmax(axis=1)
    smaller = E.copy()
    smaller[np.arange(3), largest] = 0.0
    factors = E[np.arange(3), largest]
    if np.abs(smaller).max() < ALIKE * np.abs(E).max() and len(set(largest)) == 3:
        stretch = np.abs(factors) / np.median(np.abs(factors))
        if stretch.max() / stretch.min() > 1.0 + ALIKE:
            odd = int(np.abs(np.log(stretch)).argmax())
            return Reason(
                "points",
                f"places in one unit are allowed: K has those along {'xyz'[largest[odd]]} {stretch[odd]:.4g} times as "
                "far apart, beside the others",
            )
        names = ", ".join(
            f"{'-' if f < 0.0 else ''}{'xyz'[k]}" for f, k in zip(_mirrored_signs(factors), largest, strict=True)
        )
        return Reason(
            "direction",
            f"directions in the order of K are allowed: the rows that are called x, y, z are along {names} of the "
            "places, or the places are in another order",
        )
    if np.abs(E @ E.T - np.eye(3)).max() < ALIKE:
        angle = np.degrees(np.arccos(np.clip((np.trace(E) * np.sign(np.linalg.det(E)) - 1.0) / 2.0, -1.0, 1.0)))
        return Reason(
            "direction",
            (f"the axes of the places are allowed for directions: K has all of them turned by {angle:.3g} degrees"),
        )
    return Reason("points", "the places that K was made for are allowed: these are stretched or sheared beside them")


def _mirrored_signs(factors: Array) -> Array:
    """Return the factors (3,), with all signs reversed if more than one factor is negative.

    Both are equivalent, as K is the same for a mirrored body.
    """
    return np.asarray(factors if np.sum(factors < 0.0) <= 1 else -factors)


def misplaced_nodes(body: Resistance, wrong: Mask) -> Reason | None:
    """Return (wrong input, reason) if single nodes of the mask `wrong` (N,) are not where K has them; else None.

    The points that K was made for follow from how these nodes move under rotations of the other nodes.
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
            return Reason(
                "points",
                f"nodes in the order of K are allowed: those at {point_text(body.points[nodes[0]])} and "
                f"{point_text(body.points[nodes[1]])} are exchanged",
            )
        return Reason(
            "points",
            f"nodes in the order of K are allowed: {len(nodes)} are in another one, it has that at "
            f"{point_text(body.points[nodes[0]])} at {point_text(places[0])}",
        )
    first = int(np.linalg.norm(places - body.points[nodes], axis=1).argmax())
    return Reason(
        "points",
        f"places that K was made for are allowed: it has the node at {point_text(body.points[nodes[first]])} at "
        f"{point_text(places[first])}",
    )


def turned_nodes(body: Resistance, wrong: Mask, near_supports: Mask) -> Reason | None:
    """Return (wrong input, reason) if nodes among `wrong` (N,), a mask, have their own axes; else None.

    Such nodes follow translations of the other nodes along turned or reversed axes.  A reversed axis can resist
    translations as a spring to ground does; so nodes that seem to have springs, and that K couples with nodes of
    `wrong`, are tried too.  Nodes of the mask `near_supports` (N,) do not follow other nodes as free nodes do; so nodes
    that are not in this mask are tried first.
    """
    coupled = np.zeros(len(wrong), dtype=bool)
    row, column = body.entries.row, body.entries.col
    coupled[body.node[row[wrong[body.node[column]]]]] = True
    springs = wrong | (coupled & body.spring_nodes)
    for mask in (springs & ~near_supports, springs, wrong):
        nodes, Q = _rigid_followers(body, mask, 0, np.tile(np.eye(3), (len(wrong), 1, 1)), ALIKE)
        if len(nodes) and np.abs(Q @ Q.transpose(0, 2, 1) - np.eye(3)).max() < 1e-3:
            return Reason(
                "direction",
                f"directions along the axes of the places are allowed: {len(nodes)} nodes have axes of their own, that "
                f"at {point_text(body.points[nodes[0]])} {_describe_turn(Q[0])}",
            )
    return None


def _describe_turn(Q: Array) -> str:
    """Return orthogonal axes Q (3, 3) in words: the axes of the points that they follow, or the angle of a turn."""
    largest = np.abs(Q).argmax(axis=1)
    if np.abs(Q[np.arange(3), largest]).min() > 1.0 - ALIKE:
        signs = np.where(Q[np.arange(3), largest] < 0.0, "-", "")
        return "along " + ", ".join(f"{sign}{'xyz'[k]}" for sign, k in zip(signs, largest, strict=True))
    angle = np.degrees(np.arccos(np.clip((np.trace(Q) * np.sign(np.linalg.det(Q)) - 1.0) / 2.0, -1.0, 1.0)))
    return f"turned by {angle:.3g} degrees"


def lone_turned_nodes(body: Resistance) -> Mask:
    """Return a mask (N,) of nodes that follow translations of all other nodes along turned axes.

    Let K_nn be the stiffness block of a node n, and K_nj its coupling with node j.  Node n follows unit translations of
    all others with the displacements U = -K_nn^-1 sum_j K_nj.  Away from supports, U is the identity, and near supports
    it shortens motions.  Only for a node with its own axes U is another orthogonal matrix.
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
    """Return the numbers (g,) of nodes that do not follow three rigid motions of the others, and their displacements.

    The motions are translations if `first` is 0 and rotations if it is 3.  `expected` (N, 3, 3) are the displacements
    of the nodes that follow the motions, with the motion in the last axis.  The displacements that are returned (g, 3,
    3) differ from `expected` by more than `least`.  Only nodes of the mask `wrong` (N,) that have all three
    displacements are tried.  Nodes that turn out to follow count among the other nodes in a second pass.
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


def rows_by_direction(body: Resistance) -> Reason | None:
    """Return (wrong input, reason) if rows of K are ordered by direction, and not node by node; else None."""
    count = len(body.node)
    each = count // max(len(np.unique(body.node)), 1)
    if each not in (3, 6) or not np.array_equal(body.direction, np.tile(np.arange(each), count // each)):
        return None
    direction = np.repeat(np.arange(each), count // each)
    T = (direction[:, None] == np.arange(3)).astype(float)
    if np.abs(body.K @ T).max() > 1e-6 * (abs(body.K) @ T).max():
        return None
    return Reason("direction", "rows node by node are allowed: these are all along x, then all along y, and so on")


def all_axes_turned(body: Resistance) -> Reason | None:
    """Return (wrong input, reason) if K was made for these points with axes of each node's own; else None.

    A K in the right axes passes this test too: ask for other reasons first.  Nothing is tested, and None is returned,
    if a node has a rotation or lacks a displacement, if there are more than `DENSE` coordinates, or if K does not leave
    six motions free.

    If node j at x_j has the axes Q_j, its displacements in the six free motions are z_j = Q_j (1, -[x_j]) A, (3, 6).
    Here [x_j] is the matrix of the cross product with x_j, and A (6, 6) is the same for all nodes.  So the symmetric
    matrix B = (A^T A)^-1 satisfies tr(z_j B z_j^T) = 3 + 2 |x_j|^2 at all nodes, whatever the Q_j are.
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
    return Reason("direction", "directions along the axes of the places are allowed: nodes have axes of their own")


def point_text(x: Array) -> str:
    """Return a point (3,) in m as text for messages."""
    return "({}) m".format(", ".join(f"{c + 0.0:.4g}" for c in np.round(x, 9)))


#: Least and largest speed of sound in m/s that a body may have; in soft plastics it is 500, in diamond 1.8e4.
SLOWEST, FASTEST = 250.0, 3e4
#: Least density in kg/m^3 of a body in its convex hull (that of air), and in the part of the hull where all nodes are
#: coupled by stiffness (that of foam).
LIGHTEST, LIGHTEST_SOLID = 1.0, 10.0
#: Pairs of vertices at the ends of the six edges of a tetrahedron.
_EDGES = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))


def check_speed(M: sp.csr_matrix, body: Resistance) -> Iterator[Reason]:
    """Yield (``points``, reason) if the speed of sound shows that the units of the matrices do not fit each other."""
    least, most = speeds_of_sound(M, body)
    if most < SLOWEST or least > FASTEST:
        speed, guess = (
            (least, "the places of nodes in mm, or masses in t")
            if least > FASTEST
            else (most, "forces per mm, or masses in g")
        )
        yield Reason(
            "points",
            f"SI units are allowed: in this body sound would travel at {speed:.2g} m/s, in steel it does at 5000; "
            f"are {guess}?",
        )


def check_density(M: sp.csr_matrix, body: Resistance) -> Iterator[Reason]:
    """Yield (``M``, reason) if the body is lighter than air in its convex hull, or lighter than foam where it is stiff.

    Nodes without coordinates, as at supports, are in the hull too if they are as near to others as coupled nodes are.
    Of a tetrahedron of which k corners have coordinates, these carry at least (k/4)^2 of the mass, as the mean square
    of a displacement is at least the square of its mean.  If the density is too small, masses are probably in t.
    """
    T = rigid_motions(body.points[body.node], body.direction)[:, :3]
    mass, distance = float(np.diag(T.T @ (M @ T)).max()), cKDTree(body.points[body.node]).query(body.points)[0]
    nodes = np.flatnonzero(distance <= 1.2 * body.edges.max())
    if not mass < LIGHTEST_SOLID * np.ptp(body.points[nodes], axis=0).prod():
        return
    try:
        cells = Delaunay(body.points[nodes])
    except QhullError:  # all nodes are in a plane
        return
    x = cells.points[cells.simplices]
    volumes = np.abs(np.linalg.det(x[:, 1:] - x[:, :1])) / 6.0
    shape = len(body.points), len(body.node)
    joined = sp.coo_matrix((np.ones(len(body.node)), (body.node, np.arange(len(body.node)))), shape)
    coupled = (joined @ abs(body.K) @ joined.T).tocsr()[nodes][:, nodes]
    moves = np.isin(nodes, body.node)[cells.simplices]
    edges = [
        np.where(
            moves[:, i] & moves[:, j],
            np.asarray(coupled[cells.simplices[:, i], cells.simplices[:, j]])[0] > 0.0,
            np.linalg.norm(x[:, i] - x[:, j], axis=1) <= 1.2 * body.edges.max(),
        )
        for i, j in _EDGES
    ]
    solid = float((volumes * moves.mean(axis=1) ** 2)[np.all(edges, axis=0)].sum())
    if mass < max(LIGHTEST * volumes.sum(), LIGHTEST_SOLID * solid):
        yield Reason(
            "M",
            f"masses in kg are allowed: these are {mass:.3g} kg within {volumes.sum():.3g} m^3; are they in t, and "
            "forces in kN or N/mm?",
        )


def speeds_of_sound(M: sp.csr_matrix, body: Resistance) -> list[float]:
    """Return rough bounds, the least and the largest, of the speed of sound in a body in m/s.

    They are 0 and infinity if the speed is not known.  Both bounds follow from stretching the body: the least with its
    whole mass, the largest without payloads.  The least one is at most the median over nodes of the distance to the
    nearest coupled node times the node's own frequency (in rad/s).  Stiff links and nodes with little mass therefore do
    not make a body seem too fast.
    """
    row = body.entries.row
    apart = (body.edges > 0.0) & (body.direction[row] < 3)
    inverse = np.divide(1.0, body.edges, out=np.zeros(len(row)), where=apart)
    nearest = body.on_pattern(inverse).max(axis=1).toarray().ravel()
    connected = nearest > 0.0
    by_stretch = _stretch_speeds(M, body)
    if not connected.any() or not len(by_stretch):
        return [0.0, np.inf]
    speeds = np.zeros(len(body.points))
    local = 1.0 / nearest[connected] * np.sqrt(body.K.diagonal()[connected] / M.diagonal()[connected])
    np.maximum.at(speeds, body.node[connected], local)
    return [min(float(np.median(speeds[speeds > 0.0])), float(by_stretch[0, 0])), float(by_stretch.max())]


def _stretch_speeds(M: sp.csr_matrix, body: Resistance) -> Array:
    """Return speeds of sound (a, 2) in m/s by stretching along each of a axes.

    The first column is for the whole mass, the second one for the mass without payloads.  With the displacements u of a
    stretch, the mass m, and springs to ground S in the stiffness K, the speed c is given by c^2 = u^T (K - S) u / m.
    The displacement of a node is its distance to the nearest node that supports hold along the axis or, if there is
    none, its position; so the slope of u is one and supports do no work.  The mass of a node that exceeds four times
    the median of all nodes counts as payload.  Axes with longer distances come first, and axes along which nothing is
    stretched are left out.
    """
    speeds = list[tuple[float, float, float]]()
    free = ~body.near(body.missing_displacements.any(axis=1)) & body.spring_nodes
    for axis in range(3):
        along = body.direction == axis
        x, supports = body.points[body.node[along]], body.points[body.missing_displacements[:, axis]]
        distance = cKDTree(supports).query(x)[0] if len(supports) else x[:, axis] - x[:, axis].min(initial=np.inf)
        u, moves = np.zeros(len(along)), np.zeros(len(along), dtype=bool)
        u[along], moves[along] = distance, (distance > 0.0) | (len(supports) == 0)
        springs = np.where(free, body.blocks[:, axis, axis], 0.0)[body.node]
        energy, masses = float(u @ (body.K @ u - springs * u)), (M @ along.astype(float))[moves]
        typical = float(np.median(masses)) if len(masses) else 0.0
        if energy > 0.0 and typical > 0.0 and masses.sum() > 0.0:
            with_payload, bare = (np.sqrt(energy / m.sum()) for m in (masses, np.minimum(masses, 4.0 * typical)))
            speeds.append((float(np.ptp(distance)), with_payload, bare))
    return np.array(sorted(speeds, reverse=True)).reshape(-1, 3)[:, 1:]
