from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import scipy.linalg
from springs import CompliantRows, displacement
from textbook import static_tip_deflection

from pmr.errors import InputError
from pmr.fem.distributed import tall
from pmr.fullmodel.build import full_model
from pmr.fullmodel.model import FullModel
from pmr.reduction.basis import Basis, modal_basis
from pmr.reduction.free_body import FreeBody
from pmr.reduction.from_scene import build_basis, project, take_snapshots
from pmr.reduction.residual import FLOOR, flexible_model, section_model
from pmr.reduction.snapshots import free_modes
from pmr.system.reduced_model import ReducedModel
from pmr.system.rows import Rows
from pmr.system.truncation import truncate

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
    from pmr.reduction.residual_tables import ResidualFlexibility, load_pairs, load_powers, tables

    modes = free_modes(model, 60)
    found = flexible_model(FreeBody(model), modal_basis(modes), {})
    V = np.array(modes.S.getDenseArray())
    shared = Rows(model.rows.rows[2:], model.size).shared_carriers.refine(found.rows.x)
    residual = ResidualFlexibility(FreeBody(model), V)
    (flexibility,) = load_powers(residual, shared.carriers, load_pairs(shared, len(model.input_names)), 1)
    plain = tables(flexibility, shared, model.rows.domain)
    assert found.flexibility and np.array_equal(found.flexibility.rows.c, plain.rows.c)


def with_pads(model: FullModel, *compliances: float) -> FullModel:
    rows = [replace(row, compliance=c) for row, c in zip(model.rows.rows, compliances, strict=True)]
    return replace(model, rows=Rows(tuple(rows), model.size))


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
    found = flexible_model(FreeBody(model), modal_basis(modes), {})
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
