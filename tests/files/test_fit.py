"""Matrices that don't belong to their nodes, directions or units are refused, and the reason is the true one."""

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from bricks import bricks, lumped
from frames3d import AREA, YOUNG, frame, lattice
from scipy.spatial.transform import Rotation

from pmr import InputError, from_matrices
from pmr.files.matrices import GivenMatrices

BODIES: dict[str, GivenMatrices] = {
    "bricks": bricks((6, 2, 2), (3.0, 0.3, 0.4)),
    "lumped bricks": lumped(bricks((6, 2, 2), (3.0, 0.3, 0.4))),
    "lattice": lattice(),
    "frame": frame(),
}
Change = Callable[[GivenMatrices], GivenMatrices]


def clamped(given: GivenMatrices, held: np.ndarray | None = None) -> GivenMatrices:
    """Without the coordinates (n,) that are held, by default all of the tail."""
    rest = np.flatnonzero(~(np.isin(given.node, given.groups["tail"]) if held is None else held))
    K, M = (A[rest][:, rest] for A in (given.K, given.M))
    return replace(given, M=M, K=K, node=given.node[rest], direction=given.direction[rest])


def sprung(given: GivenMatrices) -> GivenMatrices:
    """On springs between three nodes and the ground, each along an axis of its own and one of them soft."""
    K = given.K.tolil()
    for node, stiffness in ((0, 1e7), (5, 2e5), (given.node.max() - 1, 30.0)):
        at = np.flatnonzero((given.node == node) & (given.direction < 3))
        way = np.array([0.6, 0.48, 0.64])
        K[np.ix_(at, at)] += stiffness * np.outer(way, way)
    return replace(given, K=K.tocsr())


def reordered(given: GivenMatrices, order: tuple[int, int, int]) -> GivenMatrices:
    """Each three coordinates of a node called in another order than that of the rows."""
    turned = np.r_[order, 3 + np.array(order)]
    return replace(given, direction=turned[given.direction])


def turned(given: GivenMatrices, nodes: np.ndarray, rotation: Rotation) -> GivenMatrices:
    """Displacements and rotations of some nodes along axes of their own."""
    T = sp.identity(len(given.node), format="lil")
    for node in nodes:
        for first in (0, 3):
            at = np.flatnonzero((given.node == node) & (given.direction // 3 == first // 3))
            if len(at):
                T[np.ix_(at, at)] = rotation.as_matrix()
    K, M = ((T.T @ A @ T).tocsr() for A in (given.K, given.M))
    return replace(given, K=(K + K.T) / 2.0, M=(M + M.T) / 2.0)


def exchanged(given: GivenMatrices, nodes: list[int]) -> GivenMatrices:
    """Places of nodes moved on, each to that of the next one."""
    points = given.points.copy()
    points[nodes] = given.points[np.roll(nodes, -1)]
    return replace(given, points=points)


def shuffled(given: GivenMatrices) -> GivenMatrices:
    return replace(given, points=given.points[np.random.default_rng(3).permutation(len(given.points))])


def changed_mass(given: GivenMatrices, change: Callable[[sp.csr_matrix], sp.csr_matrix]) -> GivenMatrices:
    return replace(given, M=change(given.M))


def rounded(K: sp.csr_matrix, digits: int = 9) -> sp.csr_matrix:
    """Entries with so many digits; a field of 16 letters has nine."""
    lower = sp.tril(K).tocoo()
    half = sp.coo_matrix(
        ([float(f"{value:.{digits - 1}e}") for value in lower.data], (lower.row, lower.col)), K.shape
    ).tocsr()
    return (half + sp.tril(half, -1).T).tocsr()


HALF = Rotation.from_euler("z", 30, degrees=True)
PLACES = "points: places that K was made for are allowed: it resists rotations at .* most at"
AXES = "direction: directions along the axes of the places are allowed: K resists translations at"
WRONG: dict[str, tuple[Change, str]] = {
    "z, y, x": (lambda g: reordered(g, (2, 1, 0)), PLACES),
    "y, z, x": (lambda g: reordered(g, (1, 2, 0)), PLACES),
    "x, z, y": (lambda g: reordered(g, (0, 2, 1)), PLACES),
    "all axes turned": (lambda g: turned(g, np.arange(len(g.points)), HALF), PLACES),
    "some axes turned": (lambda g: turned(g, np.array([19, 20]), HALF), AXES),
    "two nodes": (lambda g: exchanged(g, [21, 25]), PLACES),
    "three nodes": (lambda g: exchanged(g, [20, 21, 25]), PLACES),
    "all nodes": (shuffled, PLACES),
    "places in mm": (lambda g: replace(g, points=1e3 * g.points), "mm"),
    "places in inches": (lambda g: replace(g, points=g.points / 0.0254), f"SI units|{PLACES}"),
    "one coordinate in mm": (lambda g: replace(g, points=g.points * [1, 1, 1e3]), PLACES),
    "mass in t": (lambda g: changed_mass(g, lambda M: 1e-3 * M), "sound would travel at .* in mm, or masses in t"),
    "mm, t and N": (lambda g: replace(g, points=1e3 * g.points, K=1e-3 * g.K, M=1e-3 * g.M), "mm"),
    "N/mm and t": (lambda g: replace(g, K=1e-3 * g.K, M=1e-3 * g.M),
     "masses in kg are allowed: these are .* kg within .*; are they in t"),
    "forces per mm": (lambda g: replace(g, K=1e-3 * g.K), "forces per mm"),
    "stiffness for mass": (lambda g: changed_mass(g, lambda M: g.K), "the same matrix as the stiffness"),
    "a node too far": (lambda g: replace(g, points=np.vstack([g.points[:20], g.points[[20]] + [0.1, 0, 0],
     g.points[21:]])), PLACES),
}  # fmt: skip


@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize("held", [None, clamped, sprung], ids=["free", "clamped", "sprung"])
@pytest.mark.parametrize("name", WRONG)
def test_what_does_not_fit_is_refused_with_the_reason(body: str, held: Change | None, name: str) -> None:
    change, says = WRONG[name]
    given = BODIES[body] if held is None else held(BODIES[body])
    with pytest.raises(InputError) as caught:
        change(given)
    assert re.search(says, str(caught.value)), str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


FACES = {
    "both ends": ("tail", "tip"),
    "the bottom": ("bottom",),
    "the bottom and one end": ("bottom", "tip"),
    "one side": ("left",),
}


@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize("faces", FACES)
@pytest.mark.parametrize("name", ["forces per mm", "places in mm", "mass in t"])
def test_units_are_told_where_no_rigid_motion_is_free(body: str, faces: str, name: str) -> None:
    """By the speed of sound between the supports: 5000 m/s in steel."""
    given = BODIES[body]
    held = clamped(given, np.isin(given.node, np.concatenate([given.groups[face] for face in FACES[faces]])))
    with pytest.raises(InputError, match="sound would travel|are places in mm|are they in t"):
        WRONG[name][0](held)


HELD: dict[str, Change] = {
    "free": lambda g: g,
    "a face clamped": clamped,
    "both faces clamped": lambda g: clamped(g, np.isin(g.node, np.r_[g.groups["tail"], g.groups["tip"]])),
    "a face on rollers": lambda g: clamped(g, np.isin(g.node, g.groups["tail"]) & (g.direction == 2)),
    "one coordinate": lambda g: clamped(g, (g.node == 9) & (g.direction == 1)),
    "springs": sprung,
    "springs and a clamp": lambda g: sprung(clamped(g, (g.node == 2) & (g.direction < 3))),
    "a stiff spring": lambda g: replace(g, K=g.K + sp.diags(1e15 * ((g.node == 9) & (g.direction == 2))).tocsr()),
    "an elastic foundation": lambda g: replace(
        g, K=g.K + sp.diags(1e5 * (np.isin(g.node, g.groups["bottom"]) & (g.direction == 2))).tocsr()
    ),
    "a heavy node": lambda g: replace(g, M=g.M + sp.diags(1e6 * (g.node == 9)).tocsr()),
    "six digits": lambda g: replace(g, points=np.array([[float(f"{c:.6g}") for c in x] for x in g.points + 1 / 3])),
    "nine digits of K": lambda g: replace(g, K=rounded(g.K)),
    "nine digits of K, clamped": lambda g: clamped(replace(g, K=rounded(g.K))),
    "nodes that nothing uses": lambda g: replace(g, points=np.vstack([g.points, g.points + [10.0, 0.0, 0.0]])),
    "in another order": lambda g: replace(
        g, M=g.M[::-1, ::-1], K=g.K[::-1, ::-1], node=g.node[::-1], direction=g.direction[::-1]
    ),
}


@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize("name", HELD)
def test_what_fits_is_taken(body: str, name: str) -> None:
    HELD[name](BODIES[body])


@pytest.mark.parametrize("digits", [6, 7, 8, 0])
def test_rounding_to_few_digits_is_no_springs_to_ground(digits: int) -> None:
    """On pads of 10 MN/m a bar with seven digits sank by 2.5 % less; 0 stands for single precision."""
    given = bricks((30, 2, 2), (6.0, 0.5, 0.6))
    K = rounded(given.K, digits) if digits else given.K.astype(np.float32).astype(float)
    with pytest.raises(InputError, match="^matrices: K: entries of 9 digits or more are allowed: these have"):
        replace(given, K=K)


def test_a_foundation_is_not_blamed_on_rounding_to_few_digits() -> None:
    """On 1e7 N/m^2 along 6 m: 60 MN/m in all, of which rounding to single precision is less than a hundredth."""
    given = bricks((30, 2, 2), (6.0, 0.1, 0.05))
    below = (given.direction == 2) & (given.points[given.node, 2] == given.points[:, 2].min())
    K = (given.K + sp.diags(np.where(below, 6e7 / below.sum(), 0.0))).astype(np.float32).astype(float)
    with pytest.raises(InputError, match="springs to ground of up to") as caught:
        replace(given, K=K)
    assert float(re.findall(r"up to (\S+) N/m", str(caught.value))[0]) < 6e5


def test_a_body_with_nine_digits_is_as_free_as_it_was() -> None:
    given = bricks((30, 2, 2), (6.0, 0.5, 0.6))
    K = rounded(given.K)
    assert np.abs((K @ given.rigid_motions())[:, :3]).max() > 1e2  # N/m, of rounding alone
    assert len(replace(given, K=K).held) == 0


def condensed(given: GivenMatrices, keep: np.ndarray) -> GivenMatrices:
    """Guyan's reduction to some nodes."""
    a, b = (np.flatnonzero(np.isin(given.node, keep) == on) for on in (True, False))
    K, M = given.K.toarray(), given.M.toarray()
    T = np.vstack([np.eye(len(a)), -np.linalg.solve(K[np.ix_(b, b)], K[np.ix_(b, a)])])
    order = np.r_[a, b]
    K, M = (sp.csr_matrix(T.T @ A[np.ix_(order, order)] @ T) for A in (K, M))
    renumbered = {int(node): k for k, node in enumerate(keep)}
    node = np.array([renumbered[int(one)] for one in given.node[a]])
    return from_matrices((M + M.T) / 2, (K + K.T) / 2, given.points[keep], None, node, given.direction[a])


@pytest.mark.parametrize("held", [None, clamped, sprung], ids=["free", "clamped", "sprung"])
def test_a_condensed_body_is_taken_and_its_directions_are_told_apart(held: Change | None) -> None:
    given = BODIES["bricks"] if held is None else held(BODIES["bricks"])
    keep = np.flatnonzero(np.isin(given.points[:, 0], [0.5, 1.0, 2.0, 3.0]))
    whole = condensed(given, keep)
    if held is None:
        with pytest.raises(InputError, match=PLACES):
            reordered(whole, (2, 1, 0))
        with pytest.raises(InputError, match=AXES):
            turned(whole, np.arange(5), HALF)


def test_a_node_that_only_free_ones_surround_is_told_apart_by_its_axes() -> None:
    """On cells that are longer than the body is high, with all of its bottom clamped."""
    given = BODIES["bricks"]
    held = clamped(given, np.isin(given.node, given.groups["bottom"]))
    top = given.groups["top"]
    for node in (top[0], top[7]):
        with pytest.raises(InputError, match=AXES):
            turned(held, np.array([node]), HALF)


def test_a_mass_that_couples_axes_tells_axes_of_a_node_beside_a_support() -> None:
    """All that K says of it is lost with the rows that were left out."""
    given = BODIES["bricks"]
    held = clamped(given, np.isin(given.node, given.groups["bottom"]))
    middle = np.flatnonzero(np.abs(given.points[:, 2]) < 1e-9)
    with pytest.raises(InputError, match="M couples displacements of the node at .* it has axes of its own"):
        turned(held, middle[[7]], HALF)


@pytest.mark.parametrize("body", ["lattice", "frame"])
def test_a_body_of_which_nothing_can_be_told_says_so(body: str) -> None:
    """All nodes that are left are beside the bottom's, which the matrices lack; with the tail clamped most are not."""
    given = BODIES[body]
    assert not (given.unchecked or given.lacks or clamped(given).unchecked)
    held = clamped(given, np.isin(given.node, given.groups["bottom"]))
    assert held.unchecked and held.lacks and reordered(held, (2, 1, 0)).unchecked


def test_parts_that_nothing_joins_are_refused() -> None:
    given = BODIES["bricks"]
    two = sp.block_diag([given.K, given.K], format="csr"), sp.block_diag([given.M, given.M], format="csr")
    points = np.vstack([given.points, given.points + [0.0, 1.0, 0.0]])
    with pytest.raises(InputError, match="no stiffness joins 63 of its nodes to the others"):
        from_matrices(two[1], two[0], points)


@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize("share", [0.4, 1e-3, 1e-7])
def test_an_indefinite_stiffness_is_refused(body: str, share: float) -> None:
    given = BODIES[body]
    cut = share * given.K.diagonal()
    cut[:30] = 0.0
    with pytest.raises(InputError, match="K: a matrix without negative eigenvalues is allowed"):
        replace(given, K=given.K - sp.diags(cut))


def test_parts_on_a_hinge_are_refused() -> None:
    """A lattice of which two stations have two nodes joined in place of four: it folds about the line through these."""
    given = BODIES["lattice"]
    K = given.K.toarray()
    for i, j in (
        (12, 16),
        (13, 17),
        (12, 17),
        (13, 16),
        (12, 18),
        (14, 16),
        (12, 19),
        (15, 16),
        (13, 18),
        (14, 17),
        (13, 19),
        (15, 17),
    ):
        axis = given.points[j] - given.points[i]
        span = float(np.linalg.norm(axis))
        at = np.r_[3 * i : 3 * i + 3, 3 * j : 3 * j + 3]
        K[np.ix_(at, at)] -= YOUNG * AREA / span**3 * np.kron([[1, -1], [-1, 1]], np.outer(axis, axis))
    with pytest.raises(InputError, match="motions take no force, as of parts on a hinge"):
        replace(given, K=sp.csr_matrix(K))


@pytest.mark.parametrize("name", ["M", "K"])
def test_what_is_no_mass_or_stiffness_beside_the_others_is_refused(name: str) -> None:
    given = BODIES["lattice"]
    scale = np.ones(len(given.node))
    scale[-1] = 1e-150
    A = sp.diags(scale) @ getattr(given, name) @ sp.diags(scale)
    with pytest.raises(InputError, match=rf"{name}: a (mass|stiffness) at every coordinate is allowed: coordinate 84"):
        replace(given, **{name: A.tocsr()})


def test_rows_that_run_through_directions_first_are_refused() -> None:
    given = BODIES["bricks"]
    order = np.lexsort((given.node, given.direction))
    with pytest.raises(InputError, match=AXES):
        from_matrices(given.M[order][:, order], given.K[order][:, order], given.points)


def test_cylindrical_axes_at_all_nodes_are_refused() -> None:
    given = BODIES["bricks"]
    T = sp.block_diag([Rotation.from_euler("x", 7.0 * k, degrees=True).as_matrix() for k in range(len(given.points))])
    K = (T.T @ given.K @ T).tocsr()
    with pytest.raises(InputError, match=AXES):
        replace(given, K=(K + K.T) / 2.0)


@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize("held", [None, clamped, sprung], ids=["free", "clamped", "sprung"])
@pytest.mark.parametrize("reversed_axes", ["x", "z", "xy"])
def test_nodes_whose_axes_are_reversed_are_refused(body: str, held: Change | None, reversed_axes: str) -> None:
    """A reversed axis where K couples no axes looks like a spring to ground at that node."""
    given = BODIES[body] if held is None else held(BODIES[body])
    nodes = (given.points[:, 0] > 2.0) & (given.points[:, 2] == given.points[:, 2].max())
    nodes = np.flatnonzero(nodes & (given.points[:, 1] == given.points[:, 1].max()))[[0, -1]]
    signs = np.where(
        np.isin(given.node, nodes) & np.isin(given.direction, ["xyz".index(a) for a in reversed_axes]), -1, 1
    )
    D = sp.diags(signs.astype(float))
    with pytest.raises(InputError, match=AXES):
        replace(given, K=(D @ given.K @ D).tocsr(), M=(D @ given.M @ D).tocsr())


def test_light_bodies_with_few_nodes_that_move_are_told_from_masses_in_t() -> None:
    """Two cells long, and held at one end: half of the volume is between nodes that have coordinates."""
    steel = clamped(bricks((2, 2, 2), (0.6, 0.2, 0.3)))
    for density in (7850.0, 20.0):
        replace(steel, M=density / 7850.0 * steel.M, K=density / 7850.0 * steel.K)
    with pytest.raises(InputError, match="masses in kg are allowed: .* are they in t, and forces in kN or N/mm"):
        replace(steel, M=1e-3 * steel.M, K=1e-3 * steel.K)
