"""The paper's two test cases over their 15 s: what it publishes, and what an independent oracle found."""

from functools import partial
from typing import Any

import numpy as np
import one_body
import pytest
from driving import driven
from oracle import CASES, Case, nrms_error, paper_basis, project

from pmr import ReducedModel
from pmr.files.arrays import Array
from pmr.simulation import TimeStepping
from pmr.system.body import FullBody, Trajectory

pytestmark = pytest.mark.slow

STEPPING = TimeStepping(end=15.0, step=1e-3, rho_inf=0.9)


def run(body: FullBody | ReducedModel, case: Case, simulate: Any = one_body.simulate) -> Trajectory:
    return simulate(body, driven(case.path, [case.load], STEPPING))


def displacement(body: FullBody | ReducedModel, trajectory: Trajectory) -> Array:
    return np.asarray(trajectory.q @ body.outputs.T)


def errors(found: Array, reference: Array) -> tuple[float, float]:
    """e_NRMS of tip and beam in %."""
    return 100.0 * nrms_error(found[:, -1:], reference[:, -1:]), 100.0 * nrms_error(found, reference)


@pytest.fixture(scope="module")
def references(full: FullBody) -> dict[str, Array]:
    return {name: displacement(full, run(full, case)) for name, case in CASES.items()}


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
