"""R against its definition, dense in NumPy, on matrices that share no code with the package."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
import scipy.linalg
from test_random_structures import BOOM, case
from textbook import beam_matrices

from pmr.fem.distributed import inner, times
from pmr.fullmodel.build import build, full_model
from pmr.fullmodel.model import FullModel
from pmr.reduction.basis import with_rigid_modes
from pmr.reduction.free_body import FreeBody, rigid_modes
from pmr.reduction.residual_tables import ResidualFlexibility
from pmr.reduction.snapshots import eigenmode_snapshots, free_modes
from pmr.scene import load

NODES = np.linspace(0.0, 5.0, 31)
#: Coordinates that a support at 0 holds.
HELD = {"pinned": [0, 1], "clamped": [0, 1, 2], "roller": [1]}


@cache
def model(load_scene, kind: str, *overrides: str) -> FullModel:
    scene = load_scene(
        "paper_simple",
        [
            *("compare.against=[]", "mesh.elements=30", "free_motions=allowed"),
            *(f"supports=[{{on=0.0,kind='{kind}'}}]", *overrides),
        ],
    )
    return full_model(scene)


def applied(full: FullModel, V: np.ndarray, solver: str) -> np.ndarray:
    """R as a whole (n, n), on every rank."""
    first, last = full.M.getOwnershipRange()
    R = ResidualFlexibility(FreeBody(full, solver), V).apply(np.eye(full.size)[first:last])
    return np.concatenate(full.comm.allgather(R))


def scaled(R: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Entries over the square roots of the diagonal of `by`: metres and radians side by side."""
    size = np.sqrt(np.maximum(np.diag(by), 0.0))
    size[size == 0.0] = 1.0
    return R / np.outer(size, size)


@pytest.mark.mpi
@pytest.mark.parametrize("solver", ["dense", "slepc"])
@pytest.mark.parametrize("kind", HELD)
def test_it_is_the_sum_over_the_modes_left_out(load_scene, kind: str, solver: str) -> None:
    full = model(load_scene, kind)
    M, K = beam_matrices(NODES)
    free = np.setdiff1d(np.arange(len(M)), HELD[kind])
    omega2, shapes = scipy.linalg.eigh(K[np.ix_(free, free)], M[np.ix_(free, free)])
    snapshots = free_modes(full, 7, solver)
    V = np.concatenate(full.comm.allgather(np.array(snapshots.S.getDenseArray())))
    out = np.linalg.norm(shapes.T @ M[free] @ V, axis=1) < 0.5
    assert np.count_nonzero(out) == len(free) - 7
    elastic = out & (omega2 > 1.0)  # the roller leaves the beam free along its axis, which nothing reaches
    rest = np.zeros((len(M), elastic.sum()))
    rest[free] = shapes[:, elastic] / np.sqrt(omega2[elastic])
    R = rest @ rest.T
    found = applied(full, np.array(snapshots.S.getDenseArray()), solver)
    assert np.abs(scaled(found - R, R)).max() < 1e-7


def test_on_soft_supports_it_depends_on_the_span_of_the_basis_alone() -> None:
    """Rods and a ring of 600 N/m leave a shell modes at 0.0045 and 0.3 rad/s; its first bending mode has 47."""
    scene = load(BOOM, case(139).overrides)
    full = build(scene).model
    V = np.array(free_modes(full, 20).S.getDenseArray())
    loads = full.rows.shared_carriers.carriers.toarray().T
    body = FreeBody(full)
    rigid = body.are_rigid(V)  # a motion of a rigid body has to stand in a column of its own, or the rest would lack it
    elastic = V[:, ~rigid]
    assert rigid.any()
    turn = np.linalg.qr(np.random.default_rng(5).standard_normal((elastic.shape[1], elastic.shape[1])))[0]
    bases = (V, np.hstack([V[:, rigid], elastic @ turn]))
    by_modes, by_others = (loads.T @ ResidualFlexibility(body, W).apply(loads.copy()) for W in bases)
    assert np.abs(scaled(by_modes - by_others, by_modes)).max() < 1e-6


@pytest.mark.mpi
@pytest.mark.parametrize("solver", ["dense", "slepc"])
def test_for_any_basis_it_is_what_a_static_answer_lacks(load_scene, solver: str) -> None:
    """K^-1 - V (V^T K V)^-1 V^T, also where V is no set of modes."""
    full = model(load_scene, "clamped")
    M, K = beam_matrices(NODES)
    whole = np.random.default_rng(3).standard_normal((len(M), 5)).cumsum(axis=0)
    whole[HELD["clamped"]] = 0.0
    flexibility = np.zeros_like(K)
    flexibility[3:, 3:] = np.linalg.inv(K[3:, 3:])
    R = flexibility - whole @ np.linalg.solve(whole.T @ K @ whole, whole.T)
    first, last = full.M.getOwnershipRange()
    assert np.abs(scaled(applied(full, whole[first:last], solver) - R, R)).max() < 1e-7


def test_vectors_that_share_in_a_rigid_motion_make_no_difference(load_scene) -> None:
    full = model(load_scene, "pinned")
    Z = rigid_modes(full)
    first, last = full.M.getOwnershipRange()
    rest = np.random.default_rng(3).standard_normal((full.size, 4)).cumsum(axis=0)
    rest[HELD["pinned"]] = 0.0
    rest = rest[first:last]
    clean = rest - Z @ inner(times(full.M, Z), rest, full.comm)
    mixed, apart = (applied(full, np.hstack([Z, X]), "dense") for X in (rest, clean))
    assert np.abs(scaled(mixed - apart, apart)).max() < 1e-8


@pytest.mark.mpi
def test_it_is_symmetric_positive_and_has_nothing_of_the_basis(load_scene) -> None:
    full = model(load_scene, "pinned", "reduction.positions=path")
    scene = load_scene("paper_simple", ["mesh.elements=30", "compare.against=[]", "reduction.positions=path"])
    for V in (
        np.array(free_modes(full, 20).S.getDenseArray()),
        np.array(with_rigid_modes(full, eigenmode_snapshots(full, scene), rigid_modes(full), 9).V.getDenseArray()),
    ):
        R = applied(full, V, "dense")
        # Each column is a solve, which leaves n u times the condition of what 20 modes leave out of a beam, (n / 20)^4.
        bound = full.size * np.finfo(float).eps / 2.0 * (full.size / 20.0) ** 4
        assert bound < 1e-11 and np.abs(scaled(R - R.T, R)).max() < bound
        assert np.linalg.eigvalsh(scaled(R + R.T, R))[0] > -full.size * bound
        first, last = full.M.getOwnershipRange()
        share = inner(times(full.K, V), R[first:last], full.comm)
        energy = full.comm.allreduce(np.einsum("nr,nr->r", V, times(full.K, V)))
        assert np.abs(share).max() < 1e-12 * np.sqrt(energy.max())


def in_extended_precision(solve: Callable[[np.ndarray], np.ndarray], K: np.ndarray, V: np.ndarray) -> np.ndarray:
    """K^-1 - V (V^T K V)^-1 V^T with 64 bits of mantissa, from both sides: the difference would cancel here too."""
    KV = K @ V
    gram = (V.T @ KV).astype(float)
    weights = np.linalg.inv(gram).astype(np.longdouble)
    for _ in range(3):  # Newton's iteration brings the inverse to extended precision
        weights = weights @ (2.0 * np.eye(len(gram), dtype=np.longdouble) - (V.T @ KV) @ weights)
    P = np.eye(len(K), dtype=np.longdouble) - V @ weights @ KV.T
    return P @ solve(P.T)


def cholesky_solver(K: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    L = K.astype(np.longdouble)
    n = len(L)
    for j in range(n):
        L[j:, j] /= np.sqrt(L[j, j])
        L[j + 1 :, j + 1 :] -= np.outer(L[j + 1 :, j], L[j + 1 :, j])

    def solve(X: np.ndarray) -> np.ndarray:
        X = X.copy()
        for j in range(n):
            X[j] /= L[j, j]
            X[j + 1 :] -= np.outer(L[j + 1 :, j], X[j])
        for j in range(n - 1, -1, -1):
            X[j] = (X[j] - L[j + 1 :, j] @ X[j + 1 :]) / L[j, j]
        return X

    return solve


@pytest.mark.parametrize(("count", "digits"), [(6, 1e-9), (20, 1e-8)])
def test_round_off_is_far_below_that_of_the_difference(load_scene, count: int, digits: float) -> None:
    """K^-1 less the modal part cancels: 1e-4 of R are lost on 50 elements with 20 modes; projections keep 1e-9."""
    full = model(load_scene, "clamped", "mesh.elements=50", "body.profile.axial=false")
    V = np.array(free_modes(full, count, "dense").S.getDenseArray())
    found = applied(full, V, "dense")[2:, 2:]
    body, whole = full.gather(), full.comm.allgather(V)
    if body is None:
        return
    K, V = body.K.toarray()[2:, 2:], np.concatenate(whole)[2:]
    exact = in_extended_precision(cholesky_solver(K), K.astype(np.longdouble), V.astype(np.longdouble))
    R = exact.astype(float)
    naive = np.linalg.inv(K) - V @ np.linalg.solve(V.T @ K @ V, V.T)
    errors = [np.abs(scaled((one - exact).astype(float), R)).max() for one in (found, naive)]
    assert errors[0] < digits and errors[1] > 1e2 * errors[0]
