"""R M R between carriers against dense matrices, and models with enrichment modes against those without."""

import numpy as np
import pytest
import scipy.linalg

from pmr import InputError, ReducedModel
from pmr.fullmodel.build import full_model
from pmr.fullmodel.model import FullModel
from pmr.reduction.basis import modal_basis
from pmr.reduction.free_body import FreeBody, ResidualFlexibility
from pmr.reduction.from_scene import build_basis, project, take_snapshots
from pmr.reduction.residual import flexible_model, section_model
from pmr.reduction.snapshots import free_modes
from pmr.system.body import FullBody

pytestmark = pytest.mark.mpi

RICH = [
    "mesh.elements=24",
    "mesh.grading=4.0",
    "slider.offsets=[0.0,-0.33]",
    "compare.against=[]",
    "damping={mass=0.3,stiffness=2e-4}",
    "loads=[{on=5.0,signal=-50},{name='T',on=2.2,direction='ry',signal=3.0}]",
]


def residual(full: FullModel, kept: int) -> tuple[np.ndarray, FullBody]:
    """R M R (n, n) of the modes left out, and the body."""
    body = full.comm.bcast(full.gather())
    M, K = body.M.toarray(), body.K.toarray()
    free = np.setdiff1d(np.arange(full.size), list(body.held.values()))
    omega2, shapes = scipy.linalg.eigh(K[np.ix_(free, free)], M[np.ix_(free, free)])
    phi = np.zeros((full.size, len(free)))
    phi[free] = shapes
    bending = np.abs(phi[1::3]).max(axis=0) > 1e-6  # the others lie along the axis, where nothing excites them
    left = phi[:, np.flatnonzero(bending)[kept:]] / np.sqrt(omega2[np.flatnonzero(bending)[kept:]])
    R = left @ left.T
    return R @ M @ R, body


@pytest.mark.parametrize("solver", ["dense", "slepc"])
def test_inertia_between_carriers_is_exact(load_scene, solver: str) -> None:
    full = full_model(load_scene("paper_simple", RICH))
    mass, body = residual(full, 6)
    model = section_model(FreeBody(full, solver), modal_basis(free_modes(full, 8, solver)), {}, 6)
    assert model.carriers and model.carriers.inertia and model.enrichment and model.enrichment.count == 2
    found, rows = model.carriers.inertia, [model.carriers.row(k, name) for k, name in enumerate(model.row_names)]
    low, high = model.domain
    for s, other in np.random.default_rng(5).uniform(low, high, (20, 2)):
        C, E = (body.C(x).toarray()[2:] for x in (s, other))
        b, e = (np.vstack([row.weights(x).toarray() for row in rows]) for x in (s, other))
        expected = {"rows": C @ mass @ E.T, "inputs": C @ mass @ body.B, "energy": body.B.T @ mass @ body.B}
        measured = {"rows": b @ found.rows @ e.T, "inputs": b @ found.inputs, "energy": found.energy}
        for name, value in expected.items():
            assert np.abs(measured[name] - value).max() < 1e-8 * np.abs(value).max(), name


def test_a_model_whose_error_nobody_asks_for_takes_half_the_solves(load_scene, monkeypatch) -> None:
    """It has the enrichment modes and flexibility, from which terms of second order take modes without inertia."""
    full, solved, apply = full_model(load_scene("paper_simple", RICH)), [], ResidualFlexibility.apply

    def count(residual: ResidualFlexibility, g: np.ndarray) -> np.ndarray:
        solved.append(g.shape[1])
        return apply(residual, g)

    monkeypatch.setattr(ResidualFlexibility, "apply", count)
    (model, both), (without, once) = (
        (section_model(FreeBody(full), modal_basis(free_modes(full, 8)), {}, 6, estimable=e), sum(solved))
        for e in (True, False)
    )
    assert 2 * (once - both) == both
    assert without.carriers and without.carriers.inertia is None and without.enrichment and model.carriers
    assert without.enrichment.count == 2
    np.testing.assert_array_equal(without.carriers.flexibility.rows, model.carriers.flexibility.rows)


def built(load_scene, *overrides: str) -> ReducedModel:
    scene = load_scene("simple_residual", ["compare.against=[]", "mesh.elements=20", *overrides])
    full = full_model(scene)
    return project(scene, FreeBody(full), build_basis(scene, full, take_snapshots(scene, full)), {})


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.parametrize("solver", ["dense", "slepc"])
def test_enrichment_change_nothing_else(load_scene, solver: str) -> None:
    with_them, without = (
        built(load_scene, f"reduction.solver={solver}", f"reduction.estimate={e}") for e in ("true", "false")
    )
    assert with_them.enrichment and with_them.enrichment.count == 4 and without.enrichment is None
    assert with_them.carriers and with_them.carriers.inertia and without.flexibility
    assert without.carriers is None and with_them.size == without.size == 6
    s = np.linspace(0.1, 5.0, 50)
    for name in ("rows", "inputs", "outputs"):
        a, b = (getattr(model.flexibility, name)(s) for model in (with_them, without))
        assert np.abs(a - b).max() < 1e-8 * np.abs(b).max()


def test_a_coarse_mesh_gives_as_many_enrichment_as_it_has(load_scene) -> None:
    coarse = ["mesh.elements=4", "reduction.coordinates=6"]
    model = built(load_scene, *coarse)  # 9 bending coordinates: one mode has to be left out altogether
    assert model.size == 6 and model.enrichment and model.enrichment.count == 2
    assert built(load_scene, "mesh.elements=4", "reduction.coordinates=8").enrichment is None
    with pytest.raises(InputError, match="excite 9 modes"):
        built(load_scene, "mesh.elements=4", "reduction.coordinates=9")


def test_only_eigenmodes_have_this_inertia(load_scene) -> None:
    scene = load_scene("simple_residual", ["compare.against=[]", "mesh.elements=20", "reduction.basis=eigenmodes"])
    full = full_model(scene)
    basis = build_basis(scene, full, take_snapshots(scene, full))
    assert flexible_model(FreeBody(full), basis, {}).flexibility
    with pytest.raises(ValueError, match="residual inertia needs a basis of eigenmodes"):
        section_model(FreeBody(full), basis, {}, basis.size)
