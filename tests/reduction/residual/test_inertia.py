"""R M R and R D R on the path against dense matrices, and models with enrichment modes against those without."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg

from pmr.errors import InputError
from pmr.fullmodel.build import full_model
from pmr.fullmodel.model import FullModel
from pmr.reduced.model import ReducedModel
from pmr.reduction.basis import modal_basis
from pmr.reduction.from_scene import build_basis, project, take_snapshots
from pmr.reduction.residual import tables
from pmr.reduction.residual.inertia import PathProducts
from pmr.reduction.residual.model import flexible_model, modal_model
from pmr.reduction.snapshots.free_body import FreeBody
from pmr.reduction.snapshots.free_modes import free_modes
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


def residual(full: FullModel, kept: int) -> tuple[np.ndarray, np.ndarray, FullBody]:
    """R M R and R D R (n, n) of the modes left out, and the body."""
    body = full.comm.bcast(full.gather())
    M, K, D = body.M.toarray(), body.K.toarray(), body.D.toarray()
    free = np.setdiff1d(np.arange(full.size), list(body.held.values()))
    omega2, shapes = scipy.linalg.eigh(K[np.ix_(free, free)], M[np.ix_(free, free)])
    phi = np.zeros((full.size, len(free)))
    phi[free] = shapes
    bending = np.abs(phi[1::3]).max(axis=0) > 1e-6  # the others lie along the axis, where nothing excites them
    left = phi[:, np.flatnonzero(bending)[kept:]] / np.sqrt(omega2[np.flatnonzero(bending)[kept:]])
    R = left @ left.T
    return R @ M @ R, R @ D @ R, body


@pytest.mark.parametrize("solver", ["dense", "slepc"])
def test_tables_of_inertia_are_exact(load_scene, solver: str) -> None:
    full = full_model(load_scene("paper_simple", RICH))
    mass, damping, body = residual(full, 6)
    B = body.B
    model = modal_model(FreeBody(full, solver), modal_basis(free_modes(full, 6, solver)), {}, 6)
    assert model.flexibility and model.flexibility.inertia and model.enrichment is None
    found = model.flexibility.inertia
    low, high = model.domain
    for s in np.concatenate([np.random.default_rng(5).uniform(low, high, 20), model.rows.x[3:5] + 1e-12]):
        C, C1, C2 = (body.C(s, order).toarray()[2:] for order in range(3))
        expected = {
            "A0": C @ mass @ C.T,
            "A1": C @ mass @ C1.T,
            "A2": C @ mass @ C2.T,
            "E0": C @ mass @ B,
            "D0": C @ damping @ C.T,
            "D1": C @ damping @ C1.T,
            "F0": C @ damping @ B,
        }
        for name, value in expected.items():
            assert np.abs(getattr(found, name)(s) - value).max() < 1e-8 * np.abs(value).max(), name


def test_answers_that_the_path_has_left_behind_are_forgotten(load_scene, monkeypatch: pytest.MonkeyPatch) -> None:
    full, held = full_model(load_scene("paper_simple", RICH)), []
    basis, take = modal_basis(free_modes(full, 6)), PathProducts.take

    def counted(self: PathProducts, numbers: np.ndarray, answers: np.ndarray) -> None:
        take(self, numbers, answers)
        held.append(sum(len(others) for others, _ in self._held))

    monkeypatch.setattr(PathProducts, "take", counted)
    expected = modal_model(FreeBody(full), basis, {}, 6).flexibility
    monkeypatch.setattr(tables, "BLOCK", 4)
    found, loads = modal_model(FreeBody(full), basis, {}, 6).flexibility, len(full.input_names) + 48
    assert len(held) > loads // (4 * full.comm.size) and max(held[1:]) < loads / 2
    assert expected and found and expected.inertia and found.inertia
    for name in ("A0", "A1", "A2", "E0", "D0", "D1", "F0"):
        one, other = getattr(found.inertia, name).c, getattr(expected.inertia, name).c
        assert np.abs(one - other).max() < 1e-8 * np.abs(other).max(), name


def test_without_damping_its_tables_vanish(load_scene) -> None:
    full = full_model(load_scene("paper_simple", [change for change in RICH if "damping" not in change]))
    model = modal_model(FreeBody(full), modal_basis(free_modes(full, 4)), {}, 4)
    assert model.flexibility and model.flexibility.inertia
    assert not any(np.any(getattr(model.flexibility.inertia, name).c) for name in ("D0", "D1", "F0"))


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
    assert with_them.flexibility and with_them.flexibility.inertia and without.flexibility
    assert without.flexibility.inertia is None and with_them.size == without.size == 6
    s = np.linspace(0.1, 5.0, 50)
    for name in ("rows", "inputs", "outputs"):
        a, b = (getattr(model.flexibility, name)(s) for model in (with_them, without))
        assert np.abs(a - b).max() < 1e-8 * np.abs(b).max()
    assert not with_them.flexibility.keeps_inertia
    alone = "simulation.simulators=['march']"
    kept = built(load_scene, f"reduction.solver={solver}", "reduction.residual_inertia=true", alone)
    assert kept.flexibility and kept.flexibility.keeps_inertia


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
    with pytest.raises(ValueError, match="must hold these"):
        modal_model(FreeBody(full), basis, {}, basis.size)
