from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from textbook import RHO_A, beam_matrices, relative, static_tip_deflection

from pmr import InputError, ReducedModel
from pmr.fem.compat import MPI
from pmr.fem.distributed import tall
from pmr.fullmodel.build import full_model
from pmr.reduction.basis import pod, reduced_model, with_held_coordinates
from pmr.reduction.snapshots import eigenmode_snapshots

pytestmark = pytest.mark.mpi


@cache
def reduce(load_scene, *overrides: str) -> tuple[ReducedModel, np.ndarray]:
    """Reduced model and basis (n, r) on every rank."""
    scene = load_scene("paper_simple", ["reduction.basis=eigenmodes", *overrides])
    model = full_model(scene)
    basis = pod(model, eigenmode_snapshots(model, scene), scene.reduction.coordinates)
    V = np.concatenate(MPI.COMM_WORLD.allgather(np.array(basis.V.getDenseArray())))
    return reduced_model(model, basis, {}), V


def test_the_reduced_matrices_are_galerkin_projections(load_scene) -> None:
    reduced, V = reduce(load_scene, "damping.mass=0.1", "damping.stiffness=1e-4", "compare.against=[]")
    M, K = beam_matrices(np.linspace(0.0, 5.0, 51))
    assert relative(reduced.M, V.T @ M @ V) < 1e-12
    assert relative(reduced.K, V.T @ K @ V) < 1e-12
    assert relative(reduced.D, 0.1 * V.T @ M @ V + 1e-4 * V.T @ K @ V) < 1e-12
    assert np.abs(reduced.B[:, 0] - V[151]).max() < 1e-14
    assert np.abs(reduced.outputs - V[1::3]).max() < 1e-14
    assert np.array_equal(reduced.M, reduced.M.T) and np.array_equal(reduced.K, reduced.K.T)


def test_the_reduced_row_is_the_full_row_times_the_basis(load_scene) -> None:
    reduced, V = reduce(load_scene, "mesh.grading=3.0")
    scene = load_scene("paper_simple", ["mesh.grading=3.0"])
    row = full_model(scene).rows.rows[-1]
    assert reduced.row_names == ("slider",) and reduced.left_out == ("support x at 0 m", "support z at 0 m")
    for s in np.concatenate([np.linspace(0.0, 5.0, 83), row.breaks]):
        for derivative in (0, 1, 2):
            found = reduced.C(s, derivative)[0]
            assert np.abs(found - row.at(s, derivative) @ V).max() < 1e-9 * 20.0**derivative
    assert reduced.C(np.array([1.0, 2.0])).shape == (2, 1, 20)
    with pytest.raises(ValueError, match="0 to 5 m"):
        reduced.C(5.1)


def test_several_sliders_give_several_rows(load_scene) -> None:
    reduced, V = reduce(load_scene, "slider.offsets=[0.0,-0.33]", "compare.against=[]", "reduction.positions=path")
    assert reduced.row_names == ("slider at s", "slider at s-0.33 m") and reduced.domain == (0.33, 5.0)
    rows = full_model(load_scene("paper_simple", ["slider.offsets=[0.0,-0.33]", "compare.against=[]"])).rows.rows[-2:]
    for s in np.linspace(0.33, 5.0, 61):
        for i, row in enumerate(rows):
            assert np.abs(reduced.C(s)[i] - row.at(s) @ V).max() < 1e-12


def test_held_rows_freeze_the_last_coordinates_and_keep_the_slider(load_scene) -> None:
    reduced, _ = reduce(load_scene)
    held = with_held_coordinates(reduced)
    assert held.size == 20 and held.left_out == ()
    assert held.row_names == (
        "support x at 0 m (holds coordinate 20)", "support z at 0 m (holds coordinate 19)", "slider"
    )  # fmt: skip
    for s in (0.0, 1.37, 5.0):
        assert np.array_equal(held.C(s)[:2], np.eye(20)[[19, 18]])
        assert np.array_equal(held.C(s)[2], reduced.C(s)[0])
        assert np.array_equal(held.C(s, 1)[:2], np.zeros((2, 20)))


def test_held_rows_are_rigid_beside_pads_that_give_way_and_push(load_scene) -> None:
    reduced, _ = reduce(load_scene)
    held = with_held_coordinates(replace(reduced, pads=np.array([1e-8]), clearance=np.array([1e-3])))
    assert held.pads is not None and held.contradiction() is None
    assert held.pads.tolist() == [0.0, 0.0, 1e-8] and held.row_clearance[2] == 1e-3
    assert np.isnan(held.row_clearance[:2]).all()


def test_a_sliders_row_is_never_taken_for_round_off(load_scene) -> None:
    """Even where the singular values say that the last vectors are nothing but noise; the pin still drops out."""
    scene = load_scene("paper_simple", ["mesh.elements=10"])
    model = full_model(scene)
    basis = pod(model, eigenmode_snapshots(model, scene), 20)
    noisy = replace(basis, sigma=np.append(np.ones(19), np.full(11, 1e-17)))
    assert noisy.accuracy > 1.0
    reduced = reduced_model(model, noisy, {})
    assert reduced.row_names == ("slider",) and reduced.left_out == ("support x at 0 m", "support z at 0 m")
    assert reduced.moving == [0]


def test_a_basis_too_poor_for_its_rows_is_refused(load_scene) -> None:
    """Two sliders a nanometre apart are one row."""
    with pytest.raises(InputError, match="depend on each other in the reduced space"):
        reduce(
            load_scene, "slider.offsets=[0.0,1e-9]", "compare.against=[]", "reduction.positions=[1.0,2.0,3.0,4.0,4.5]"
        )


@pytest.mark.parametrize("elements", [40, 50])
@pytest.mark.parametrize("s", [1.25, 2.5, 3.75])
def test_static_tip_deflection_is_the_closed_form(load_scene, s: float, elements: int) -> None:
    """All coordinates kept (V = I): exact with the slider on a node, a little stiff with it in mid-element."""
    scene = load_scene("paper_simple", [f"mesh.elements={elements}"])
    model = full_model(scene)
    body = model.gather()
    if body is None:
        return
    C = body.C(s).toarray()
    saddle = np.block([[body.K.toarray(), C.T], [C, np.zeros((3, 3))]])
    tip = np.linalg.solve(saddle, np.concatenate([body.B[:, 0] * -50.0, np.zeros(3)]))[-2 - 3]
    expected = static_tip_deflection(-50.0, s, 5.0, 5e4)
    on_node = abs(s * elements / 5.0 - round(s * elements / 5.0)) < 1e-9
    assert tip == pytest.approx(expected, rel=1e-9 if on_node else 2e-4)


def test_mass_of_the_whole_beam_is_kept_for_any_basis_that_holds_it(load_scene) -> None:
    """The rigid translation as the only basis vector: M = rho A L."""
    from pmr.reduction.basis import Basis

    model = full_model(load_scene())
    first, last = model.M.getOwnershipRange()
    lift = (np.arange(model.size) % 3 == 1).astype(float)[first:last, None]
    basis = Basis(tall(lift, model.M), np.ones(1), "euclidean")
    reduced_rows_free = [row for row in model.rows.rows if row.name == "slider"]
    model = type(model)(**{**vars(model), "rows": type(model.rows)(tuple(reduced_rows_free), model.size)})
    assert reduced_model(model, basis, {}).M[0, 0] == pytest.approx(RHO_A * 5.0, rel=1e-12)
