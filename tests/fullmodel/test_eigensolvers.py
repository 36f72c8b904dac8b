"""Block Lanczos against closed forms, where eigenvalues are many times the same.
Static solves under held rows against dense matrices.
"""

import logging
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from textbook import CLOSED_FORM, beam_matrices, subspace_distance

from pmr import ConvergenceError, InputError
from pmr import scene as scenes
from pmr.fem.compat import MPI, PETSc
from pmr.fem.distributed import inner, share, sparse, times
from pmr.fem.factor import Factor, refusal
from pmr.fullmodel import modes, moving
from pmr.fullmodel.build import build, full_model
from pmr.fullmodel.eigensolvers import (
    DenseEigenSolver,
    DependentRowsError,
    OneFactorEigenSolver,
    SlepcEigenSolver,
    eigensolver,
)
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.modes import Modes, largest_eigenpairs
from pmr.fullmodel.moving import static_solver
from pmr.reduction.snapshots import eigenmode_snapshots
from pmr.system.rows import fixed_row, sparse_row

pytestmark = pytest.mark.mpi
SOLVERS = [DenseEigenSolver, SlepcEigenSolver]
ALL = [*SOLVERS, OneFactorEigenSolver]
POSITIONS = [0.1, 1.25, 2.0 / 3.0, 2.5, 3.777, 5.0]  # on nodes, in mid-element, at the end


@pytest.fixture(scope="module")
def model(load_scene) -> FullModel:
    return full_model(load_scene())


def everywhere(modes: Modes) -> np.ndarray:
    return np.concatenate(MPI.COMM_WORLD.allgather(modes.phi))


@pytest.mark.parametrize("solver", ALL)
@pytest.mark.parametrize("s", CLOSED_FORM)
def test_frequencies_are_those_of_the_closed_form(model: FullModel, solver, s: float) -> None:
    """50 elements; 1.25 m and 3.75 m lie in mid-element, where the kink in curvature costs accuracy."""
    omega = solver(model).lowest(s, 3).omega
    tolerance = 2e-5 if s in (1.25, 3.75) else 1e-6
    assert omega == pytest.approx(CLOSED_FORM[s], rel=tolerance)
    assert np.all(omega > np.array(CLOSED_FORM[s]) * (1 - 1e-8))  # a conforming element approaches from above


@pytest.mark.parametrize("s", POSITIONS)
def test_dense_and_slepc_agree(model: FullModel, s: float) -> None:
    M, _ = beam_matrices(model.output_positions)
    dense, slepc = (solver(model).lowest(s, 6) for solver in SOLVERS)
    assert subspace_distance(everywhere(dense), everywhere(slepc), M) < 1e-9
    assert slepc.omega == pytest.approx(dense.omega, rel=1e-8)
    assert everywhere(slepc) == pytest.approx(everywhere(dense), abs=1e-9)  # signs too


@pytest.mark.parametrize("solver", SOLVERS)
def test_modes_are_defined_by_their_properties(model: FullModel, solver) -> None:
    M, K = beam_matrices(model.output_positions)
    modes = solver(model).lowest(2.03, 8)
    phi, omega2 = everywhere(modes), modes.omega**2
    assert np.abs(phi.T @ M @ phi - np.eye(8)).max() < 1e-12
    assert np.abs(phi.T @ K @ phi - np.diag(omega2)).max() < 1e-8 * omega2.max()
    assert np.abs(model.rows.at(2.03) @ phi).max() < 1e-13
    assert np.all(np.diff(modes.omega) > 0.0)
    assert np.all(phi[np.abs(phi).argmax(axis=0), range(8)] > 0.0)
    assert modes.residuals.max() < 1e-13


def test_residuals_tell_a_wrong_eigenpair(model: FullModel) -> None:
    from pmr.fullmodel.modes import _residuals

    modes = DenseEigenSolver(model).lowest(2.5, 3)
    wrong = _residuals(model, 2.5, modes.omega**2 * 1.1, modes.phi)
    assert np.all(wrong > 100.0 * modes.residuals)


@pytest.fixture(scope="module")
def coinciding(load_scene) -> tuple[FullModel, float]:
    """EA such that the first axial frequency equals the third bending frequency with the slider at 2.5 m."""
    nodes = np.linspace(0.0, 5.0, 51)
    M, K = beam_matrices(nodes)
    bending = np.setdiff1d(np.flatnonzero(np.arange(153) % 3 != 0), [1, 76])  # without w at nodes 0 and 25
    third = scipy.linalg.eigh(K[np.ix_(bending, bending)], M[np.ix_(bending, bending)], eigvals_only=True)[2]
    axial = np.arange(3, 153, 3)
    first = scipy.linalg.eigh(K[np.ix_(axial, axial)] / 2e7, M[np.ix_(axial, axial)], eigvals_only=True)[0]
    stiffness = float(third / first)
    return full_model(load_scene("paper_simple", [f"body.profile.axial_stiffness={stiffness!r}"])), stiffness


def test_both_modes_of_a_degenerate_pair_are_found(coinciding: tuple[FullModel, float]) -> None:
    model, stiffness = coinciding
    M, _ = beam_matrices(model.output_positions, EA=stiffness)
    dense, slepc = (solver(model).lowest(2.5, 5) for solver in SOLVERS)
    assert abs(dense.omega[3] / dense.omega[2] - 1.0) < 1e-7
    assert slepc.omega == pytest.approx(dense.omega, rel=1e-7)
    assert subspace_distance(everywhere(dense), everywhere(slepc), M) < 1e-9
    pair = everywhere(slepc)[:, 2:4]
    assert np.linalg.matrix_rank(pair[::3], tol=1e-3) == 1  # one axial and one bending mode, mixed or not
    assert np.abs(pair.T @ M @ pair - np.eye(2)).max() < 1e-10


class Forgetful(SlepcEigenSolver):
    """Loses the third mode at the first attempt, as a Krylov sequence may lose half of a double one."""

    def _solve(self, M, K, count, found):
        omega2, z = super()._solve(M, K, count, found)
        return (omega2, z) if found else (np.delete(omega2, 2), z[:2] + z[3:])


@pytest.mark.parametrize("count", [3, 5])
def test_a_mode_that_the_iteration_missed_is_found_by_the_inertia(model: FullModel, count: int) -> None:
    forgetful, sound = (solver(model).lowest(2.5, count) for solver in (Forgetful, SlepcEigenSolver))
    assert forgetful.omega == pytest.approx(sound.omega, rel=1e-9)
    assert everywhere(forgetful) == pytest.approx(everywhere(sound), abs=1e-9)


@pytest.mark.parametrize("solver", ALL)
def test_a_pair_cut_in_two_is_said_to_those_who_chose_the_number(coinciding: tuple[FullModel, float], solver, caplog):
    """A basis of free modes takes more modes than it keeps, and their number is nobody's choice."""
    with caplog.at_level(logging.WARNING):
        three, four = (solver(coinciding[0]).lowest(2.5, count) for count in (3, 4))
        four.warn_if_cut(2.5)
        assert caplog.text == ""
        three.warn_if_cut(2.5)
    assert "same frequency" in caplog.text


def test_snapshots_say_once_that_a_pair_is_cut_in_two(load_scene, monkeypatch, caplog) -> None:
    """Each rank said it."""
    scene = load_scene(overrides=["reduction.snapshots=2", "reduction.modes=2", "reduction.coordinates=3"])
    full = full_model(scene)
    for solver in ALL:
        lowest = solver.lowest
        monkeypatch.setattr(solver, "lowest", lambda *of, lowest=lowest: replace(lowest(*of), is_cut=True))
    with caplog.at_level(logging.WARNING):
        eigenmode_snapshots(full, scene)
    assert MPI.COMM_WORLD.allreduce(caplog.text.count("same frequency")) == 2


@pytest.mark.parametrize("solver", ALL)
def test_a_rigid_body_mode_is_found_at_zero(load_scene, solver) -> None:
    """Rollers leave the axial motion free: one mode at 0, and the shift keeps the factorisation regular."""
    rollers = "supports=[{on=0.0,kind='roller'}]"
    model = full_model(load_scene("paper_simple", [rollers, "free_motions=allowed", "compare.against=[]"]))
    modes = solver(model).lowest(2.5, 4)
    assert modes.omega[0] < 1e-2 and modes.omega[1:] == pytest.approx(CLOSED_FORM[2.5], rel=1e-6)


@pytest.mark.parametrize("solver", ALL)
def test_more_modes_than_there_are_is_an_error_that_says_what_to_do(load_scene, solver) -> None:
    model = full_model(load_scene("paper_simple", ["mesh.elements=2"]))
    with pytest.raises(ConvergenceError, match="6 free coordinates; ask for fewer modes or refine"):
        solver(model).lowest(2.5, 7)


def test_too_few_converged_pairs_are_an_error_that_says_what_to_do(model: FullModel, monkeypatch) -> None:
    monkeypatch.setattr(modes, "ITERATIONS", 1)
    monkeypatch.setattr(modes, "TOLERANCE", 1e-200)
    with pytest.raises(
        ConvergenceError, match="of 41 eigenpairs converged to 1e-200 within 1 iterations; ask for fewer"
    ):
        SlepcEigenSolver(model).lowest(2.5, 40)


@pytest.mark.parametrize("solver", ALL)
def test_the_slider_on_the_support_is_refused(model: FullModel, solver) -> None:
    with pytest.raises(DependentRowsError, match="slider"):
        solver(model).lowest(0.0, 3)


def test_the_automatic_choice_goes_by_size(load_scene, model: FullModel) -> None:
    assert isinstance(eigensolver(model, "auto"), DenseEigenSolver)
    large = full_model(load_scene("paper_simple", ["mesh.elements=600"]))
    assert isinstance(eigensolver(large, "auto"), SlepcEigenSolver)
    # Round-off in K grows with the fourth power of the elements: 600 leave five digits, 50 leave nine.
    assert eigensolver(large, "auto").lowest(2.5, 2).omega == pytest.approx(CLOSED_FORM[2.5][:2], rel=1e-5)


def distributed(A: sp.spmatrix) -> PETSc.Mat:
    first, last = share(A.shape[0], MPI.COMM_WORLD)
    like = PETSc.Mat().createAIJ(((last - first, A.shape[0]), (last - first, A.shape[0])), comm=MPI.COMM_WORLD)
    return sparse(sp.csr_matrix(A)[first:last], like, columns=int(last - first))


def cube(n: int) -> tuple[sp.csr_matrix, np.ndarray]:
    """Laplacian of n^3 points, whose eigenvalues come up to six times over, and all of them in ascending order."""
    chain = sp.diags([-np.ones(n - 1), 2.0 * np.ones(n), -np.ones(n - 1)], [-1, 0, 1])
    line = 4.0 * np.sin(np.arange(1, n + 1) * np.pi / (2 * n + 2)) ** 2
    values = (line[:, None, None] + line[:, None] + line).ravel()
    return sp.csr_matrix(sp.kronsum(sp.kronsum(chain, chain), chain)), np.sort(values)


def start(n: int, columns: int) -> np.ndarray:
    first, last = share(n, MPI.COMM_WORLD)
    return np.asfortranarray(np.random.default_rng(3).normal(size=(n, columns))[first:last])


@pytest.mark.parametrize("heavy", [1.0, 7.0])
def test_equal_eigenvalues_are_all_found(heavy: float) -> None:
    A, expected = cube(9)
    K, M = distributed(A), distributed(heavy * sp.eye(729))
    factor = Factor(K, "K")
    found = largest_eigenpairs(factor.solve_columns, M, factor.solve_columns(start(729, 8)), 17, 729)
    assert heavy / found.theta == pytest.approx(expected[:17], rel=1e-11)
    X, comm = found.vectors, MPI.COMM_WORLD
    assert inner(X, times(M, X), comm) == pytest.approx(np.eye(17), abs=1e-12)
    assert times(K, X) == pytest.approx(times(M, X) / found.theta, abs=1e-10)
    factor.destroy()


def test_a_space_that_ends_gives_what_it_has() -> None:
    A, expected = cube(3)
    K, M = distributed(A), distributed(sp.eye(27))
    factor = Factor(K, "K")
    found = largest_eigenpairs(factor.solve_columns, M, factor.solve_columns(start(27, 8)), 40, 27)
    assert 1.0 / found.theta == pytest.approx(expected, rel=1e-12)
    factor.destroy()


def test_what_does_not_converge_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(modes, "STEPS", 2)
    K, M = distributed(cube(9)[0]), distributed(sp.eye(729))
    factor = Factor(K, "K")
    with pytest.raises(ConvergenceError, match="not all of 17 eigenpairs"):
        largest_eigenpairs(factor.solve_columns, M, factor.solve_columns(start(729, 8)), 17, 729)
    factor.destroy()


def boom(*overrides: str) -> FullModel:
    return build(scenes.load("boom_beam", ["mesh.elements=12", *overrides])).model


@pytest.mark.parametrize("stiffness", ["3e8", "'rigid'"])
def test_modes_are_those_of_lapack(stiffness: str) -> None:
    pads = "[{name='tail',at=0.15,faces={bottom=[0.0],left=[0.0]}},{name='mouth',moving=true,"
    model = boom(f"pads={pads}faces={{bottom=[-0.1,0.1],left=[0.0]}},stiffness={stiffness}}}]")
    one, other = OneFactorEigenSolver(model), DenseEigenSolver(model)
    for s in (1.5, 2.777, 4.0):
        few, exact = one.lowest(s, 8), other.lowest(s, 8)
        assert few.omega == pytest.approx(exact.omega, rel=1e-9)
        assert few.residuals.max() < 1e-9
        assert np.abs(few.phi) == pytest.approx(np.abs(exact.phi), abs=1e-6 * np.abs(exact.phi).max())


def test_pads_that_give_way_lower_the_frequencies() -> None:
    firm, soft = (DenseEigenSolver(boom(f"pads={PADS.format(k)}")).lowest(2.5, 6).omega for k in ("3e8", "3e6"))
    assert np.all(soft < firm) and soft[0] < 0.95 * firm[0]


PADS = (
    "[{{name='tail',at=0.15,faces={{bottom=[-0.1,0.1],left=[0.0]}}}},"
    "{{name='mouth',moving=true,faces={{bottom=[-0.1,0.1],left=[0.0]}},stiffness={}}}]"
)


@pytest.mark.slow
@pytest.mark.numerical
def test_large_models_whose_rows_give_way_need_one_factor() -> None:
    assert isinstance(eigensolver(boom(), "slepc"), OneFactorEigenSolver)
    assert isinstance(eigensolver(boom(), "auto"), DenseEigenSolver)


def held(full: FullModel) -> tuple[list, np.ndarray]:
    """A coordinate, and two rows that couple others; and the dense inverse on what they leave free."""
    n = full.size
    mixed = np.random.default_rng(2).normal(size=(2, 6))
    at = np.array([[1, 4, 7, 10, 13, 40], [2, 4, 10, 20, 30, 43]])
    rows = [fixed_row("one", sparse_row(0, 1.0, n), (0.0, 5.0))]
    rows += [fixed_row(f"mixed {i}", sparse_row(at[i], mixed[i], n), (0.0, 5.0)) for i in range(2)]
    C = np.vstack([row.carriers.toarray() for row in rows])
    T = np.linalg.svd(C)[2][3:].T
    body = full.comm.bcast(full.gather())
    return rows, T @ np.linalg.solve(T.T @ body.K.toarray() @ T, T.T)


@pytest.mark.parametrize("solver", ["dense", "slepc"])
def test_answers_are_those_of_the_motions_that_the_rows_leave(load_scene, solver: str) -> None:
    full = full_model(load_scene("paper_simple", ["mesh.elements=20", "compare.against=[]"]))
    rows, inverse = held(full)
    g = np.random.default_rng(4).normal(size=(full.size, 3))
    share = slice(*full.M.getOwnershipRange())
    solve = static_solver(full, rows, solver)
    x = solve.solve(np.asfortranarray(g[share]))
    assert x == pytest.approx((inverse @ g)[share], abs=1e-8 * np.abs(inverse @ g).max())
    solve.destroy()


@pytest.mark.parametrize(("code", "said"), [(-13, "no memory"), (-10, "scene: body: .* singular")])
def test_no_memory_is_not_called_a_singular_stiffness(
    load_scene, monkeypatch: pytest.MonkeyPatch, code: int, said: str
) -> None:
    full = full_model(load_scene("paper_simple", ["mesh.elements=20", "compare.against=[]"]))

    def refused(A: object, name: str) -> None:
        raise refusal(name, code)

    monkeypatch.setattr(moving, "factor_for_columns", refused)
    with pytest.raises(InputError, match=said):
        static_solver(full, held(full)[0], "slepc")
