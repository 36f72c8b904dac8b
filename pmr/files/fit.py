"""Checks whether mass and stiffness matrices of another program belong to their nodes and directions.

A body that nothing holds can move as a rigid body of its nodes without resistance of its stiffness K.  If K does resist
at some nodes, these have to be near coordinates that were left out, as at supports, or at springs to ground.  If they
are not, then the rows, directions, axes or points are not those that K was made for.  What they should be follows from
the motions that K leaves free (`pmr.files.reasons`).

Each check gets the mass M and the stiffness in `body`.  If it finds an error it yields (name, reason): the name of the
input that is wrong (``M``, ``K``, ``points`` or ``direction``) and the reason in words.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from pmr.files.arrays import Array, Mask
from pmr.files.reasons import ALIKE, Reason, check_density, check_speed, lone_turned_nodes, point_text
from pmr.files.rigid import DIGITS, DIRECTIONS, ROUNDING_OF_POINTS, Resistance, rigid_motions

#: Number of steps of Lanczos' method for the least eigenvalue of a matrix with a diagonal of ones, and the least
#: eigenvalue that rounding may explain.
STEPS, NEGATIVE = 60, -1e-6
#: Diagonal entry of a damping, over the largest one, below which it may be round-off, or zero.
LEAST_DAMPING = 1e-9
#: Number of powers of ten by which a diagonal entry may be smaller than the median entry; still smaller entries are
#: negligible in double precision, and so are their squares.
VANISHING = 30
#: Share of rows that are rounded to too few digits above which K is refused, and least force of such a row under a
#: translation over the sum of the magnitudes of its terms.
ROUNDED_ROWS, ROUNDED = 0.05, 1e-12
#: Largest number of coordinates for which all eigenvalues of K are computed, which takes half a second.
DENSE_ALWAYS = 1000
#: Warning about matrices that can't be checked against their nodes.
UNCHECKED = (
    "all nodes of the body are beside supports inside its matrices, so order and axes of directions and places "
    "could not be held against its stiffness; supports of the scene, in their place, let them be"
)


def misfit(M: sp.csr_matrix, body: Resistance) -> Reason | None:
    """Return the first reason why a mass matrix M or the stiffness in `body` does not belong to its nodes.

    The reason names the wrong input: ``M``, ``K``, ``points`` or ``direction``.  None is returned if all checks pass.
    """
    checks: tuple[Callable[[sp.csr_matrix, Resistance], Iterator[Reason]], ...] = (
        _vanishing_entries,
        _few_digits,
        lambda M, body: indefinite(M, body.K),
        _unknown_motions,
        _separate_parts,
        _missing_mass,
        _misplaced_rows,
        _wrong_axes,
        _wrong_axes_of_mass,
        _free_mechanisms,
        _wrong_centre_of_mass,
        check_speed,
        check_density,
    )
    return next((reason for check in checks for reason in check(M, body)), None)


def negative_damping(D: sp.csr_matrix) -> Reason | None:
    """Return a reason about ``D`` if a damping matrix D (n, n) has negative eigenvalues, else None.

    Rows of D may be empty.
    """
    diagonal = D.diagonal()
    largest = float(np.abs(diagonal).max())
    least = _least_eigenvalue(D, np.maximum(diagonal, LEAST_DAMPING * largest)) if largest else -D.count_nonzero()
    if least >= NEGATIVE:
        return None
    allowed = "a damping without negative eigenvalues is allowed: some motion would gain energy by this one"
    return Reason("D", allowed)


def _vanishing_entries(M: sp.csr_matrix, body: Resistance) -> Iterator[Reason]:
    """Yield a reason about ``M`` or ``K`` if a diagonal entry is negligible compared with the median diagonal entry.

    Logarithms are compared, as squares of such entries might not be representable numbers.
    """
    for name, A, what in (("M", M, "mass"), ("K", body.K, "stiffness")):
        diagonal = A.diagonal()
        size = np.log10(diagonal)
        below = np.median(size) - size
        if below.max() > VANISHING:
            at = int(below.argmax())
            yield Reason(
                name,
                f"a {what} at every coordinate is allowed: coordinate {at + 1} has {diagonal[at]:.3g}, others have "
                f"{10.0 ** np.median(size):.3g}; what has none has to be condensed",
            )


def _few_digits(M: sp.csr_matrix, body: Resistance) -> Iterator[Reason]:
    """Yield a reason about ``K`` if its entries have so few digits that their rounding resists a translation.

    The rounded entries of a row do not sum to zero, so that they act like a spring to ground, perhaps of a negative
    stiffness.  The reason states the stiffness of all of them together.  Rows are left out whose force is larger than
    rounding explains, as that of true springs to ground.
    """
    if body.digits >= DIGITS:
        return
    T = body.motions[:, :3]
    forces, sizes = body.K @ T, abs(body.K) @ T
    rounded = (np.abs(forces) > ROUNDED * sizes) & (np.abs(forces) <= 10.0**-body.digits * sizes)
    if np.mean(rounded.any(axis=1)) > ROUNDED_ROWS:
        springs = np.abs(np.sum(T * forces * rounded, axis=0)).max()
        yield Reason(
            "K",
            f"entries of {DIGITS + 1} digits or more are allowed: these have {body.digits + 1}, whose rounding acts as "
            f"springs to ground of up to {springs:.2g} N/m",
        )


def indefinite(M: sp.csr_matrix, K: sp.csr_matrix) -> Iterator[Reason]:
    """Yield a reason about ``M`` or ``K`` for each of the two matrices that has negative eigenvalues."""
    for name, A in (("M", M), ("K", K)):
        least = _least_eigenvalue(A, A.diagonal())
        if least < NEGATIVE:
            yield Reason(
                name,
                "a matrix without negative eigenvalues is allowed; scaled to a diagonal of ones this one has "
                f"{least:.2g} or less: some motion would have negative energy",
            )


def _least_eigenvalue(A: sp.csr_matrix, sizes: Array) -> float:
    """Return an upper bound of the least eigenvalue of a matrix A (n, n), scaled to a diagonal of ones.

    `sizes` (n,) are the positive numbers that count as diagonal entries of A in the scaling.  The bound is computed by
    Lanczos' method, which starts from a fixed vector.
    """
    scale = 1.0 / np.sqrt(sizes)
    v = np.random.default_rng(3).standard_normal(A.shape[0])
    v, before, beta = v / np.linalg.norm(v), np.zeros(A.shape[0]), 0.0
    diagonal, off_diagonal = list[float](), list[float]()
    for _ in range(min(STEPS, A.shape[0])):
        w = scale * (A @ (scale * v)) - beta * before
        diagonal.append(float(w @ v))
        w -= diagonal[-1] * v
        beta = float(np.linalg.norm(w))
        if not beta > 1e-10:
            break
        off_diagonal.append(beta)
        before, v = v, w / beta
    return float(scipy.linalg.eigh_tridiagonal(diagonal, off_diagonal[: len(diagonal) - 1], eigvals_only=True)[0])


def _unknown_motions(M: sp.csr_matrix, body: Resistance) -> Iterator[Reason]:
    """Yield a reason about ``direction`` if the coordinates cannot tell the six rigid motions from each other.

    The coordinates cannot tell the motions if a rigid motion moves no coordinate, or moves them only as other rigid
    motions do.
    """
    sizes = np.linalg.norm(body.motions, axis=0)
    R = body.motions / np.maximum(sizes, 1e-9 * np.linalg.norm(sizes))
    independent = list[int]()
    for k in range(6):
        if np.linalg.matrix_rank(R[:, [*independent, k]], tol=np.sqrt(1e-9)) > len(independent):
            independent.append(k)
    missing = ", ".join(DIRECTIONS[k] for k in range(6) if k not in independent)
    if missing:
        yield Reason(
            "direction",
            f"coordinates that move and turn in space are allowed: these know no rigid motion along {missing}",
        )


def _separate_parts(M: sp.csr_matrix, body: Resistance) -> Iterator[Reason]:
    """Yield a reason about ``K`` if stiffness connects some nodes neither with the other nodes nor with the ground."""
    count, part = connected_components(body.coupling, directed=False)
    nodes = np.unique(body.node)
    sizes = np.bincount(part[nodes], minlength=count)
    held = np.bincount(part[nodes], body.grounded_nodes[nodes], minlength=count)
    loose = np.flatnonzero((sizes > 0) & (held == 0))
    if len(loose) and np.sum(sizes > 0) > 1:
        smallest = loose[np.argmin(sizes[loose])]
        first = int(nodes[part[nodes] == smallest][0])
        yield Reason(
            "K",
            f"one connected body is allowed: no stiffness joins {sizes[smallest]} of its nodes to the others, "
            f"such as that at {point_text(body.points[first])}",
        )


def _missing_mass(M: sp.csr_matrix, body: Resistance) -> Iterator[Reason]:
    """Yield a reason about ``M`` if M equals K, or if the body as a whole has no mass along some axis."""
    if M.nnz == body.K.nnz > len(body.node) and abs(M - body.K).count_nonzero() == 0:
        yield Reason("M", "a mass is allowed: this is the same matrix as the stiffness")
    T = body.motions[:, :3]
    mass, size = np.diag(T.T @ (M @ T)), np.diag(T.T @ (abs(M) @ T))
    if np.any(mass <= 1e-6 * size):
        along = DIRECTIONS[int(np.argmin(mass / size))]
        yield Reason(
            "M",
            f"a mass is allowed: of a rigid body this matrix has {mass.min():.3g} kg along {along}; "
            "is it the stiffness?",
        )


def _misplaced_rows(M: sp.csr_matrix, body: Resistance) -> Iterator[Reason]:
    """Yield a reason about ``points`` if rows of K resist a rotation about their node but no translation.

    Rows near supports, and near nodes without a rotation that other nodes have, are left out.
    """
    sums, sizes = body.sums_of_moments
    moments = np.divide(np.abs(sums).max(axis=1), sizes, out=np.zeros_like(sizes), where=sizes > 0.0)
    share = np.zeros(len(body.points))
    np.maximum.at(share, body.node, moments)
    wrong = share > ROUNDING_OF_POINTS[1]
    wrong &= ~body.grounded_nodes & ~body.missing_displacements.any(axis=1) & ~body.near(_nodes_without_rotations(body))
    if wrong.any():
        worst = body.points[np.where(wrong, share, 0.0).argmax()]
        yield Reason(
            "points",
            f"places that K was made for are allowed: it resists rotations at {wrong.sum()} nodes that it leaves free "
            f"to move, most at {point_text(worst)}; are places in mm, directions or nodes in another order, or the "
            "nodes of another mesh?",
        )


def _wrong_axes(M: sp.csr_matrix, body: Resistance) -> Iterator[Reason]:
    """Yield a reason about ``direction`` if rows of K far from supports resist a translation.

    In a dense K all rows may be near supports.  Then the reason is yielded if more motions take no energy than there
    are free rigid motions.
    """
    held = body.grounded_nodes & ~body.spring_nodes
    if body.dense:
        free_count = np.sum(body.scaled_eigenvalues < body.least_energy) if held.any() else 0
        wrong = held & (free_count > 6 - len(body.held_motions()))
    else:
        wrong = held & (~_supported_nodes(body) | lone_turned_nodes(body))
    if wrong.any():
        yield Reason(
            "direction",
            f"directions along the axes of the places are allowed: K resists translations at {wrong.sum()} nodes, such "
            f"as that at {point_text(body.points[wrong][0])}, as neither supports nor springs do; have nodes axes of "
            "their own, or are the rows not node by node?",
        )


def _wrong_axes_of_mass(M: sp.csr_matrix, body: Resistance) -> Iterator[Reason]:
    """Yield a reason about ``direction`` if M couples displacements of two nodes along different axes.

    Elements couple displacements of the nodes i and j by the same mass m_ij along each axis, near supports too.  The
    check is made if M has displacements alone and at least half of the nodes show no coupling between different axes.
    """
    entries, count = M.tocoo(), len(body.points)
    row, column = body.node[entries.row], body.node[entries.col]
    apart, across = row != column, body.direction[entries.row] != body.direction[entries.col]
    if np.any(body.direction >= 3) or not apart.any():
        return
    coupled, turned = (
        np.bincount(row[which], np.abs(entries.data[which]), minlength=count) for which in (apart, apart & across)
    )
    share = np.divide(turned, coupled, out=np.zeros(count), where=coupled > 0.0)
    if np.median(share[np.unique(body.node)]) < 1e-9 and share.max() > ALIKE:
        yield Reason(
            "direction",
            "directions along the axes of the places are allowed: M couples displacements of the node at "
            f"{point_text(body.points[share.argmax()])} with those of others along other axes, "
            "so it has axes of its own",
        )


def _free_mechanisms(M: sp.csr_matrix, body: Resistance) -> Iterator[Reason]:
    """Yield a reason about ``K`` if K leaves motions free that are not rigid, or has negative eigenvalues.

    Only matrices of up to `DENSE_ALWAYS` coordinates are checked.
    """
    if body.K.shape[0] > DENSE_ALWAYS:
        return
    values, rounding = body.scaled_eigenvalues, body.rounding_share
    free = 6 - len(body.held_motions())
    if values[0] < -min(1e3 * rounding, 1e-8):
        yield Reason(
            "K",
            "a matrix without negative eigenvalues is allowed; scaled to a diagonal of ones this one has "
            f"{values[0]:.2g}",
        )
    elif rounding < 1e-13 and (more := int(np.sum(values < 30.0 * rounding)) - free) > 0:
        yield Reason(
            "K",
            f"a body that only moves as a whole is allowed: {more} more motions take no force, as of parts on a "
            "hinge, or of elements integrated with too few points (C3D8R, one layer of C3D20R)",
        )


def _wrong_centre_of_mass(M: sp.csr_matrix, body: Resistance) -> Iterator[Reason]:
    """Yield a reason about ``M`` if M couples translations along different axes, or has its centre outside of the body.

    The check is made only if no support or spring in K holds the body.
    """
    if len(body.held_motions()):
        return
    R = rigid_motions(body.points[body.node], body.direction)
    J = R.T @ (M @ R)
    mass = np.trace(J[:3, :3]) / 3.0
    coupling = np.abs(J[:3, :3] - np.diag(np.diag(J[:3, :3]))).max()
    if coupling > ALIKE * mass:
        yield Reason(
            "M",
            f"a mass is allowed that is the same along all directions: {coupling:.3g} of {mass:.3g} kg couple two "
            "of them; its rows are in another order than those of K",
        )
    centre = centre_of_mass(J)
    low, high = body.points.min(axis=0), body.points.max(axis=0)
    if np.any(np.abs(centre - (low + high) / 2.0) > 0.55 * (high - low).max()):
        yield Reason("M", f"a mass within the body is allowed: its centre is at {point_text(centre)}")


def centre_of_mass(J: Array) -> Array:
    """Return the centre of mass (3,) in m from the inertia J = R^T M R (6, 6) under the six rigid motions R.

    M is the mass matrix.  The rigid motions are translations along x, y and z, then rotations about axes x, y and z
    through the origin.
    """
    moments = np.array([J[1, 5] - J[2, 4], J[2, 3] - J[0, 5], J[0, 4] - J[1, 3]])
    return np.asarray(1.5 * moments / np.trace(J[:3, :3]))


def _nodes_without_rotations(body: Resistance) -> Mask:
    """Return a mask (N,) of nodes that have displacements but lack a rotation that more than half of all nodes have."""
    missing, displaced = np.zeros(len(body.points), dtype=bool), ~body.missing_displacements.any(axis=1)
    for k in range(3, 6):
        rotates = np.bincount(body.node[body.direction == k], minlength=len(body.points)) > 0
        if 2 * np.sum(rotates) > len(rotates):
            missing |= displaced & ~rotates
    return missing


def _supported_nodes(body: Resistance) -> Mask:
    """Return a mask (N,) of nodes whose forces under translations are explained by nearby supports.

    Such a node is near a node that lacks a displacement.  Translations along the axes of missing displacements are not
    looked at.  Under the others, the node has no forces, or the forces of a spring to ground.
    """
    lacks = np.stack([body.near(body.missing_displacements[:, k]) for k in range(3)], axis=1)
    springs = np.where(lacks[:, :, None] | lacks[:, None], 0.0, body.blocks)
    size = np.abs(body.blocks).max(axis=(1, 2))
    skew = np.abs(springs - springs.transpose(0, 2, 1)).max(axis=(1, 2))
    least = np.linalg.eigvalsh((springs + springs.transpose(0, 2, 1)) / 2.0)[:, 0]
    return np.asarray(lacks.any(axis=1) & (skew <= 1e-6 * size) & (least >= -1e-6 * size))
