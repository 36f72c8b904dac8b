from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from oracle import flexible, full_body, generalized_alpha, project, rich_body
from springs import CompliantRows

from pmr.errors import SimulationError
from pmr.simulation import InitialState, TimeStepping
from pmr.system.body import FullBody
from pmr.system.contact_rows import compliant_rows
from pmr.system.reduced_model import ReducedModel
from pmr.system.rows import Rows

S = np.array([0.7, 1.9, 2.0, 3.3])


@pytest.fixture(scope="module")
def model() -> ReducedModel:
    """Two sliders, two inputs, damping."""
    return flexible(rich_body(), 8)


def with_pads(full: FullBody, *compliances: float) -> FullBody:
    rows = [replace(row, compliance=c) for row, c in zip(full.rows.rows, compliances, strict=True)]
    return replace(full, rows=Rows(tuple(rows), full.size))


def test_which_rows_give_way(model: ReducedModel) -> None:
    full = full_body(elements=6)
    assert compliant_rows(model) == [0, 1] and compliant_rows(full) == []
    assert compliant_rows(with_pads(full, 0.0, 1e-6, 0.0)) == [1]
    assert compliant_rows(replace(model, flexibility=None)) == []


def test_it_solves_the_saddle_point_problem(model: ReducedModel) -> None:
    f = np.array([30.0, -7.0])
    compliant, r = CompliantRows(model), model.size
    system = compliant.system(S)
    for k, s in enumerate(S):
        assert model.flexibility
        C, F, H = model.C(s), model.flexibility.rows(s) + np.diag(model.row_compliance), model.flexibility.inputs(s)
        saddle = np.linalg.solve(np.block([[model.K + np.eye(r), C.T], [C, -F]]), np.concatenate([model.B @ f, -H @ f]))
        q = np.linalg.solve(system[k, :, :r] + np.eye(r), system[k, :, r:] @ f)
        assert q == pytest.approx(saddle[:r], rel=1e-9, abs=1e-12)
        assert compliant.multipliers(np.array([s]), q[None], f[None])[0] == pytest.approx(saddle[r:], rel=1e-8)


def test_pads_alone_are_springs() -> None:
    """K + k c^T c, whatever the residual flexibility."""
    full = with_pads(full_body(elements=6), 0.0, 0.0, 4e-6)
    model = replace(project(full, np.eye(full.size)[:, 2:]), pads=np.array([4e-6]))
    c = model.C(1.3)[0]
    found = CompliantRows(model).system(np.array([1.3]))[0]
    assert found[:, : model.size] == pytest.approx(model.K + np.outer(c, c) / 4e-6, rel=1e-12)
    assert np.array_equal(found[:, model.size :], model.B)


def test_a_slider_on_a_support_is_refused_with_its_place(model: ReducedModel) -> None:
    with pytest.raises(SimulationError, match=r"slider at 0 m: the forces of the rows slider 0, slider 0.8 are"):
        CompliantRows(model).system(np.array([0.5, 0.0]))
    assert np.isfinite(CompliantRows(model).system(np.array([1e-5]))).all()  # beside it they can


def test_the_oracles_integrator_knows_the_same_equations(model: ReducedModel) -> None:
    """At rest in the static equilibrium of constant loads the model stays there."""
    f, s = np.array([30.0, -7.0]), 1.9
    compliant = CompliantRows(model)
    system = compliant.system(np.array([s]))[0]
    q = np.linalg.solve(system[:, : model.size], system[:, model.size :] @ f)
    stepping = TimeStepping(0.05, 1e-3)
    T = len(stepping.times)
    found, v, force = generalized_alpha(model, np.full(T, s), np.tile(f, (T, 1)), stepping, InitialState(q, 0.0 * q))
    assert np.abs(found - q).max() < 1e-9 * np.abs(q).max() and np.abs(v).max() < 1e-8 * np.abs(q).max()
    assert force == pytest.approx(np.tile(compliant.multipliers(np.array([s]), q[None], f[None]), (T, 1)), rel=1e-6)
