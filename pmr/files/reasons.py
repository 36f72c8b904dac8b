"""Reasons why matrices do not fit their nodes: what points, order, axes or units would have to be.

Each function gets a body whose stiffness K resists motions that should be free.  It returns or yields the name of the
wrong input (``M``, ``points`` or ``direction``) and the reason in words; None, or nothing, if its reason does not
apply.  Units are checked by speed of sound and density.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.spatial import Delaunay, QhullError, cKDTree

from pmr.files.arrays import Array, Mask
from pmr.files.rigid import Resistance

#: Relative difference up to which two numbers count as equal; for positions it is a share of the body's length.
ALIKE = 1e-2


class Reason(NamedTuple):
    """Why matrices are refused: the name of the wrong input, and what is allowed in its place."""

    input: str
    text: str


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


def point_text(x: Array) -> str:
    """Return a point x (3,) in m as text for messages."""
    return "({}) m".format(", ".join(f"{c + 0.0:.4g}" for c in np.round(x, 9)))


#: Least and largest speed of sound in m/s that a body may have; in soft plastics it is 500, in diamond 1.8e4.
SLOWEST, FASTEST = 250.0, 3e4
#: Least density in kg/m^3 of a body in its convex hull (that of air), and in the part of the hull where all nodes are
#: coupled by stiffness (that of foam).
LIGHTEST, LIGHTEST_SOLID = 1.0, 10.0
#: Pairs of vertices at the ends of the six edges of a tetrahedron.
_EDGES = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))


def check_speed(M: sp.csr_matrix, body: Resistance) -> Iterator[Reason]:
    """Yield a reason about ``points`` if the speed of sound shows that units of mass, stiffness and length disagree."""
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
    """Yield a reason about ``M`` if the body is too light, as if its masses were in t.

    It is too light if its mass is below that of air in the convex hull of its nodes.  It is also too light if its mass
    is below that of foam in its stiff part: the tetrahedra between nodes that K couples.  Nodes without coordinates, as
    at supports, count as coupled if they are as near to others as coupled nodes are.  Of a tetrahedron with k corners
    that have coordinates, (k/4)^2 of the volume counts: M has at least this share of its mass, since the mean square of
    a displacement is at least the square of its mean.
    """
    T = body.motions[:, :3]
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
    coupled = body.coupling[nodes][:, nodes]
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
    """Return two rough bounds in m/s, the least and the largest, of the speed of sound in a body.

    The bounds are 0 and infinity if the speed is not known.  Both follow from stretching the body: the least bound with
    its whole mass, the largest one without payloads.

    The least bound may be lower by a second estimate, the median over nodes of a distance times a frequency (in rad/s).
    These are the distance to the nearest coupled node and the node's own frequency.  So stiff links and nodes with
    little mass do not make a body seem too fast.
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
    """Return speeds of sound (a, 2) in m/s, estimated by stretching a body with the mass matrix M along a axes.

    The first column is for the whole mass, the second one for the mass without payloads.  The mass of a node that
    exceeds four times the median of all nodes counts as payload.  Axes with longer distances come first, and axes along
    which nothing is stretched are left out.

    The speed c is given by c^2 = u^T (K - S) u / m.  Here u are the displacements of a stretch, m is the mass, and S
    are the springs to ground in the stiffness K.  The displacement of a node is its distance to the nearest node that
    supports hold along the axis.  If there is no such node, the displacement is the node's position.  So the slope of u
    is one and supports do no work.
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
