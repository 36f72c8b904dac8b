from __future__ import annotations

import logging

import numpy as np
import pytest
import scipy.linalg
from textbook import CLOSED_FORM, beam_matrices, subspace_distance

from pmr.errors import ConvergenceError
from pmr.fem.compat import MPI
from pmr.fullmodel import modes
from pmr.fullmodel.build import full_model
from pmr.fullmodel.eigensolvers import (
    DenseEigenSolver,
    DependentRowsError,
    OneFactorEigenSolver,
    SlepcEigenSolver,
    eigensolver,
)
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.modes import Modes

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
