"""Models with residual flexibility, and R against its definition in NumPy, which shares no code with the package."""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import scipy.linalg
from oracle import with_pads
from springs import CompliantRows, displacement
from test_random_structures import BOOM, case
from textbook import beam_matrices, static_tip_deflection

from pmr import InputError, ReducedModel
from pmr.fem.distributed import inner, tall, times
from pmr.fullmodel.build import build, full_model
from pmr.fullmodel.model import FullModel
from pmr.reduction.basis import Basis, modal_basis, with_rigid_modes
from pmr.reduction.free_body import FreeBody, ResidualFlexibility, rigid_modes
from pmr.reduction.from_scene import build_basis, project, take_snapshots
from pmr.reduction.residual import flexible_model, section_model
from pmr.reduction.snapshots import eigenmode_snapshots, free_modes
from pmr.scene import load
from pmr.system.rows import Rows
from pmr.system.truncation import FLOOR, truncate

NO_ANCF = "compare.against=[]"

PAPERS_BASIS = ["reduction.basis=eigenmodes", "reduction.coordinates=20"]


@cache
def reduced(load_scene, *overrides: str) -> ReducedModel:
    scene = load_scene("simple_residual", [NO_ANCF, *overrides])
    model = full_model(scene)
    return project(scene, FreeBody(model), build_basis(scene, model, take_snapshots(scene, model)), {})


def tip(model: ReducedModel, s: float, load: float = -50.0) -> float:
    """Static tip deflection."""
    at, compliant = np.array([s]), CompliantRows(model)
    system = compliant.system(at)[0]
    p = np.linalg.solve(system[:, : model.size], system[:, model.size :] @ [load])
    force = compliant.multipliers(at, p[None], np.array([[load]]))
    assert model.flexibility
    return float(model.outputs[-1] @ p + displacement(model.flexibility, at, force, np.array([[load]]))[0, -1])


def frequencies(model: ReducedModel, s: float) -> np.ndarray:
    K = CompliantRows(model).system(np.array([s]))[0, :, : model.size]
    return np.sqrt(np.maximum(scipy.linalg.eigh(K, model.M, eigvals_only=True), 0.0))


@pytest.mark.parametrize("solver", ["dense", "slepc"])
@pytest.mark.parametrize("s", [1.25, 2.5, 3.75])
@pytest.mark.parametrize("coordinates", [1, 6])
def test_statics_are_exact_with_any_number_of_coordinates(load_scene, coordinates: int, s: float, solver: str) -> None:
    """One rigid-body rotation and tables in s: the closed form, the slider being on a node."""
    model = reduced(
        load_scene, f"reduction.coordinates={coordinates}", f"reduction.solver={solver}", "mesh.elements=40"
    )
    assert model.size == coordinates
    assert tip(model, s) == pytest.approx(static_tip_deflection(-50.0, s, 5.0, 5e4), rel=1e-8)


def test_frequencies_with_the_slider_held_are_those_of_the_beam(load_scene) -> None:
    from textbook import CLOSED_FORM

    model = reduced(load_scene)
    for s, omega in CLOSED_FORM.items():
        if s < 5.0:
            assert frequencies(model, s)[:3] == pytest.approx(omega, rel=4e-4)


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.mpi
def test_dense_and_slepc_give_the_same_tables(load_scene) -> None:
    dense, slepc = (reduced(load_scene, f"reduction.solver={solver}") for solver in ("dense", "slepc"))
    assert dense.flexibility and slepc.flexibility
    s = np.linspace(0.3, 4.9, 50)
    for name in ("rows", "inputs", "outputs"):
        a, b = (getattr(model.flexibility, name)(s) for model in (dense, slepc))
        assert np.abs(a - b).max() < 1e-9 * np.abs(a).max()
    assert np.abs(dense.C(s) - slepc.C(s)).max() < 1e-8


def test_rigid_bodies_have_no_stiffness_and_supports_no_rows(load_scene) -> None:
    model = reduced(load_scene)
    assert model.left_out == ("support x at 0 m", "support z at 0 m") and model.row_names == ("slider",)
    assert not model.K[0].any() and not model.K[:, 0].any() and model.K[1, 1] > 200.0
    assert model.pads is None and model.row_compliance.tolist() == [0.0]


@pytest.mark.mpi
def test_the_papers_basis_keeps_its_number_of_coordinates(load_scene) -> None:
    """Rigid rotation first, then what the pool holds beside it."""
    model = reduced(load_scene, *PAPERS_BASIS)
    assert model.size == 20 and not model.K[0].any()
    assert tip(model, 1.75) == pytest.approx(static_tip_deflection(-50.0, 1.75, 5.0, 5e4), rel=2e-4)  # mid-element


def test_where_the_basis_leaves_nothing_out_a_floor_keeps_the_springs_finite(load_scene) -> None:
    """With the slider at a snapshot's position the pool answers its force itself: 1e-13 of the flexibility is left."""
    model = reduced(load_scene, *PAPERS_BASIS)
    assert model.flexibility
    own = (model.C(2.5) @ np.linalg.pinv(model.K, rcond=1e-12, hermitian=True) @ model.C(2.5).T)[0, 0]
    assert FLOOR < model.flexibility.rows(2.5)[0, 0] / own < 1.001 * FLOOR
    assert frequencies(model, 2.5)[:3] == pytest.approx([9.18668595, 47.19065286, 79.76099], rel=1e-6)


def test_free_modes_need_no_floor(load_scene) -> None:
    """Their tables stay what R is, to the last digit that it has."""
    scene = load_scene("simple_residual", [NO_ANCF, "reduction.coordinates=60"])
    model = full_model(scene)
    from pmr.reduction.free_body import ResidualFlexibility
    from pmr.reduction.residual import load_powers, tables

    modes = free_modes(model, 60)
    found = flexible_model(FreeBody(model), modal_basis(modes), {})
    V = np.array(modes.S.getDenseArray())
    shared = Rows(model.rows.rows[2:], model.size).shared_carriers.refine(found.rows.x)
    residual = ResidualFlexibility(FreeBody(model), V)
    (flexibility,) = load_powers(residual, shared.carriers, 1)
    plain = tables(flexibility, shared, model.rows.domain)
    assert found.flexibility and np.array_equal(found.flexibility.rows.c, plain.rows.c)


@pytest.mark.mpi
def test_pads_come_along_and_a_support_that_gives_way_stays_a_row(load_scene) -> None:
    scene = load_scene("simple_residual", [NO_ANCF, "mesh.elements=40"])
    model = with_pads(full_model(scene), 0.0, 2e-6, 1e-6)
    found = flexible_model(FreeBody(model), modal_basis(free_modes(model, 6)), {})
    assert found.row_names == ("support z at 0 m", "slider") and found.left_out == ("support x at 0 m",)
    assert found.row_compliance.tolist() == [2e-6, 1e-6]
    # free in y and in rotation: statics are those of the rigid pads, and a rigid motion on top of them
    a, s, F = 5.0 - 2.5, 2.5, -50.0
    pads = F * ((1.0 + a / s) * 1e-6 * (1.0 + a / s) + a / s * 2e-6 * a / s)
    assert tip(found, 2.5) == pytest.approx(static_tip_deflection(F, 2.5, 5.0, 5e4) + pads, rel=1e-8)


def test_clearances_come_along_and_a_rigid_support_that_only_pushes_stays_a_row(load_scene) -> None:
    full = full_model(load_scene("simple_residual", [NO_ANCF, "mesh.elements=40"]))
    on_rest = replace(full.rows.rows[1], clearance=1e-3)
    model = replace(full, rows=Rows((full.rows.rows[0], on_rest, full.rows.rows[2]), full.size))
    modes = free_modes(model, 6)
    assert np.sum(modes.omega == 0.0) == 2  # free in y and in rotation
    found = section_model(FreeBody(model), modal_basis(modes), {}, 6)
    assert found.row_names == ("support z at 0 m", "slider")
    for smaller in (found, truncate(found, 4)):
        assert np.array_equal(smaller.row_clearance, [1e-3, np.nan], equal_nan=True)


def test_sliders_in_one_place_are_refused(load_scene) -> None:
    with pytest.raises(InputError, match=r"scene: the rows slider at s, slider at s\+1e-07 m depend on each other"):
        reduced(load_scene, "slider.offsets=[0.0,1e-7]")


def test_a_basis_that_violates_a_support_is_refused(load_scene) -> None:
    model = full_model(load_scene("simple_residual", [NO_ANCF]))
    first, last = model.M.getOwnershipRange()
    V = np.random.default_rng(1).standard_normal((model.size, 4))[first:last]
    with pytest.raises(InputError, match="these move support x at 0 m, support z at 0 m"):
        flexible_model(FreeBody(model), Basis(tall(np.ascontiguousarray(V), model.M), np.ones(4), "euclidean"), {})


def test_too_few_coordinates_for_the_rigid_bodies(load_scene) -> None:
    with pytest.raises(InputError, match="1 rigid-body modes free; more than these are allowed"):
        reduced(load_scene, "reduction.basis=eigenmodes", "reduction.coordinates=1")


def test_a_pool_too_small_is_told_in_the_users_count(load_scene) -> None:
    """The beam on its pin has one rigid-body mode, which stands before the POD's vectors."""
    with pytest.raises(InputError, match=r"coordinates = 30: .*one rigid-body mode; at most \d+") as refused:
        reduced(load_scene, *PAPERS_BASIS, "reduction.coordinates=30")
    span, most = map(int, re.findall(r"span (\d+) dimensions.*at most (\d+)", str(refused.value))[0])
    assert most == span + 1
    scene = load_scene("simple_residual", [NO_ANCF, *PAPERS_BASIS, f"reduction.coordinates={most}"])
    model = full_model(scene)
    assert build_basis(scene, model, take_snapshots(scene, model)).size == most


def test_a_section_has_its_rows_on_carriers(load_scene) -> None:
    """Multiplied out at one path coordinate they are the tables."""
    model = full_model(load_scene("evolved_residual", ["slider.offsets=[0.0,-0.33]", "compare.against=[]"]))
    basis = modal_basis(free_modes(model, 6, "auto", 3))
    found = section_model(FreeBody(model), basis, {}, 6)
    assert found.carriers is not None and found.carriers.flexibility is not None and found.flexibility is not None
    rows = [found.carriers.row(k, name) for k, name in enumerate(found.row_names)]
    for s in (0.5, 1.7, 4.4):
        b = np.vstack([row.weights(s).toarray() for row in rows])
        assert b @ found.carriers.values == pytest.approx(found.C(s), abs=1e-9)
        G = found.flexibility.rows(s)
        assert b @ found.carriers.flexibility.rows @ b.T == pytest.approx(G, abs=1e-9 * np.abs(G).max())


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
