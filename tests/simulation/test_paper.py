"""The paper's two test cases over their 15 s: what it publishes, and what an independent oracle found."""

from functools import partial
from typing import Any

import numpy as np
import one_body
import pytest
from driving import driven
from oracle import CASES, Case, nrms_error, paper_basis, project
from textbook import EA, EI, LENGTH, RHO_A

from pmr import ReducedModel
from pmr.files.arrays import Array
from pmr.simulation import TimeStepping
from pmr.simulation.exudyn import ancf
from pmr.system.body import FullBody, Trajectory

pytestmark = pytest.mark.slow

STEPPING = TimeStepping(end=15.0, step=1e-3, rho_inf=0.9)
SLIDING_ENDS = 11.25  # s


def run(body: FullBody | ReducedModel, case: Case, simulate: Any = one_body.simulate) -> Trajectory:
    return simulate(body, driven(case.path, [case.load], STEPPING))


def displacement(body: FullBody | ReducedModel, trajectory: Trajectory) -> Array:
    return np.asarray(trajectory.q @ body.outputs.T)


def errors(found: Array, reference: Array) -> tuple[float, float]:
    """e_NRMS of tip and beam in %."""
    return 100.0 * nrms_error(found[:, -1:], reference[:, -1:]), 100.0 * nrms_error(found, reference)


@pytest.fixture(scope="module")
def full_runs(full: FullBody) -> dict[str, Trajectory]:
    return {name: run(full, case) for name, case in CASES.items()}


@pytest.fixture(scope="module")
def references(full: FullBody, full_runs: dict[str, Trajectory]) -> dict[str, Array]:
    return {name: displacement(full, trajectory) for name, trajectory in full_runs.items()}


@pytest.fixture(scope="module")
def cable_runs(full: FullBody) -> dict[str, ancf.CableMotion]:
    cable = ancf.Cable(LENGTH, EA, EI, RHO_A, elements=20)
    return {
        name: ancf.simulate(cable, {"F": LENGTH}, driven(case.path, case.load, STEPPING), full.output_positions)
        for name, case in CASES.items()
    }


@pytest.mark.numerical
@pytest.mark.parametrize(("name", "expected"), [("simple", (0.1646, 0.3389)), ("evolved", (0.9234, 1.4893))])
def test_twenty_coordinates_do_better_than_published(
    reduced: ReducedModel, references: dict[str, Array], name: str, expected: tuple[float, float]
) -> None:
    """The rows of the support, which the basis satisfies, are left out; below is what keeping them costs."""
    assert reduced.row_names == ("slider 0",)
    found = errors(displacement(reduced, run(reduced, CASES[name])), references[name])
    assert found == pytest.approx(expected, rel=1e-3)


@pytest.mark.numerical
@pytest.mark.parametrize(("name", "published"), [("simple", (0.20, 0.40)), ("evolved", (1.13, 1.82))])
def test_published_errors_are_those_of_round_off_in_the_support_rows(
    full: FullBody, references: dict[str, Array], name: str, published: tuple[float, float]
) -> None:
    """An SVD with sigma_20 / sigma_1 = 5e-8 leaves 1e-10 in the pinned coordinates of the last vectors.

    The paper keeps the two rows of the support: tiny as their entries are, they hold two coordinates at zero.
    """
    V = paper_basis(full, snapshots=5, modes=6, coordinates=20)
    V[0, 18] = V[1, 19] = 1e-10
    noisy = project(full, V, tolerance=0.0)
    assert noisy.row_names == ("pin x", "pin y", "slider 0")
    found = displacement(noisy, run(noisy, CASES[name]))
    assert errors(found, references[name]) == pytest.approx(published, abs=0.04)
    eighteen = project(full, paper_basis(full, snapshots=5, modes=6, coordinates=18))
    np.testing.assert_allclose(found, displacement(eighteen, run(eighteen, CASES[name])), atol=1e-8)


@pytest.mark.parametrize("name", CASES)
def test_callbacks_agree_with_updates_once_a_step(reduced: ReducedModel, name: str) -> None:
    """The same equations at each step, however long it is."""
    case, stepping = CASES[name], TimeStepping(end=15.0, step=4e-3, rho_inf=0.9)
    once, called = (
        displacement(reduced, simulate(reduced, driven(case.path, [case.load], stepping)))
        for simulate in (one_body.in_exudyn, partial(one_body.in_exudyn, formulation="callbacks"))
    )
    assert np.abs(once - called).max() < 1e-9


def test_largest_displacement_of_the_evolved_case(references: dict[str, Array]) -> None:
    assert np.abs(references["evolved"]).max() == pytest.approx(47.8586e-3, abs=1e-7)


@pytest.mark.parametrize(("name", "published"), [("simple", (0.07, 0.14)), ("evolved", (0.46, 0.67))])
def test_linear_beam_against_ancf(
    references: dict[str, Array], cable_runs: dict[str, ancf.CableMotion], name: str, published: tuple[float, float]
) -> None:
    assert errors(references[name], cable_runs[name].displacement) == pytest.approx(published, abs=0.005)


def test_energy_settles_at_the_same_level_in_all_three(
    full: FullBody, reduced: ReducedModel, full_runs: dict[str, Trajectory], cable_runs: dict[str, ancf.CableMotion]
) -> None:
    def total(body: FullBody | ReducedModel, trajectory: Trajectory) -> Array:
        q, v = trajectory.q, trajectory.v
        inner = np.sum(v * (body.M @ v.T).T + q * (body.K @ q.T).T, axis=1) / 2.0
        return inner - (q @ body.B)[:, 0] * -50.0

    cable = ancf.Cable(LENGTH, EA, EI, RHO_A, elements=20)
    after = STEPPING.times > SLIDING_ENDS
    levels = [
        total(full, full_runs["simple"])[after],
        total(reduced, run(reduced, CASES["simple"]))[after],
        ancf.energy(cable, cable_runs["simple"]).total[after],
    ]
    for level in levels:
        assert level.mean() == pytest.approx(1.7233, abs=0.002)  # J; "approximately 1.75" in the paper
        assert np.ptp(level) < 0.005


def test_constant_load_does_no_more_work_before_sliding(full: FullBody, full_runs: dict[str, Trajectory]) -> None:
    """Energy stays zero while the slider rests: neither integrator nor rows add or remove any."""
    trajectory = full_runs["simple"]
    rest = trajectory.t <= 3.75
    q, v = trajectory.q[rest], trajectory.v[rest]
    parts = np.sum(v * (full.M @ v.T).T, axis=1) / 2.0, np.sum(q * (full.K @ q.T).T, axis=1) / 2.0
    total = sum(parts) + 50.0 * (q @ full.B)[:, 0]
    assert np.abs(total).max() < 1e-3 < max(part.max() for part in parts)
