import logging

import numpy as np
import pytest
import scipy.sparse as sp
from gathering import gathered
from textbook import beam_matrices, relative

from pmr.fem.compat import MPI
from pmr.fullmodel.build import full_model
from pmr.fullmodel.model import FullModel

pytestmark = pytest.mark.mpi
BENDING = np.array([1, 2])


@pytest.mark.parametrize("mesh", ["mesh.elements=50", "mesh.elements=1", "mesh.grading=7.3", "mesh.grading=0.2"])
def test_mass_and_stiffness_equal_the_textbook(load_scene, mesh: str) -> None:
    if MPI.COMM_WORLD.size > 1 and mesh == "mesh.elements=1":
        mesh = "mesh.elements=2"  # no rank without a cell
    model = full_model(load_scene("paper_simple", [mesh]))
    M, K = beam_matrices(model.output_positions)
    assert relative(gathered(model.M), M) < 1e-12
    assert relative(gathered(model.K), K) < 1e-12


def test_without_axial_coordinates_the_bending_part_is_left(load_scene) -> None:
    model = full_model(
        load_scene("paper_simple", ["body.profile.axial=false", "mesh.elements=7", "compare.against=['full']"])
    )
    M, K = beam_matrices(model.output_positions)
    kept = np.flatnonzero(np.isin(np.arange(len(M)) % 3, BENDING))
    assert relative(gathered(model.M), M[np.ix_(kept, kept)]) < 1e-12
    assert relative(gathered(model.K), K[np.ix_(kept, kept)]) < 1e-12
    assert model.rows.names == ("support z at 0 m", "slider")


def test_other_stiffness_and_mass_reach_the_matrices(load_scene) -> None:
    changes = [
        "body.profile.bending_stiffness=1.0e3",
        "body.profile.axial_stiffness=5.0e5",
        "body.profile.mass_per_length=3.0",
    ]
    model = full_model(load_scene("paper_simple", changes))
    M, K = beam_matrices(model.output_positions, EI=1.0e3, EA=5.0e5, rho_A=3.0)
    assert relative(gathered(model.M), M) < 1e-12
    assert relative(gathered(model.K), K) < 1e-12


def test_damping_is_rayleigh(load_scene) -> None:
    model = full_model(load_scene("paper_simple", ["damping.mass=0.3", "damping.stiffness=2e-4", "compare.against=[]"]))
    assert relative(gathered(model.D), 0.3 * gathered(model.M) + 2e-4 * gathered(model.K)) < 1e-15


def test_rigid_motion_has_the_beams_mass_and_no_stiffness(load_scene) -> None:
    model = full_model(load_scene("paper_simple", ["mesh.grading=3.0"]))
    M, K, x = gathered(model.M), gathered(model.K), model.output_positions
    rotation = np.zeros(model.size)
    rotation[1::3], rotation[2::3] = x, 1.0
    assert rotation @ M @ rotation == pytest.approx(78.0 * 5.0**3 / 3.0, rel=1e-12)
    assert np.abs(K @ rotation).max() < 1e-12 * np.abs(K).max()


def test_inputs_and_outputs_are_point_rows(load_scene) -> None:
    loads = "loads=[{name='F',on=5.0,signal=1.0},{name='T',on=2.03,direction='ry',signal=1.0}]"
    model = full_model(load_scene("paper_simple", [loads, "compare.against=[]"]))
    B, O = gathered(model.B), gathered(model.outputs).T
    assert model.input_names == ("F", "T")
    assert np.flatnonzero(B[:, 0]).tolist() == [151] and B[151, 0] == 1.0
    rotation = np.zeros(model.size)
    rotation[1::3], rotation[2::3] = model.output_positions, 1.0
    assert B[:, 1] @ rotation == pytest.approx(-1.0, abs=1e-13)  # a slope upwards turns against the axis y
    assert np.array_equal(O, np.eye(model.size)[1::3])


def test_rows_hold_the_supports_and_the_sliders(load_scene) -> None:
    extra = "supports=[{on=0.0,kind='clamped'}]"
    model = full_model(load_scene("paper_simple", [extra, "slider.offsets=[0.0,0.3]", "compare.against=[]"]))
    assert model.rows.names == (
        "support x at 0 m", "support z at 0 m", "support ry at 0 m", "slider at s", "slider at s+0.3 m"
    )  # fmt: skip
    assert model.rows.domain == (0.0, 4.7)
    C = model.rows.at(1.0)
    assert sp.issparse(C) and C.shape == (5, 153)
    assert np.flatnonzero(C.toarray()[3]).tolist() == [31]  # 1.0 m is node 10
    assert np.flatnonzero(C.toarray()[4]).tolist() == [40]


@pytest.mark.slow
@pytest.mark.numerical
def test_a_mesh_too_fine_for_its_digits_is_said(load_scene, caplog) -> None:
    with caplog.at_level(logging.WARNING):
        full_model(load_scene("paper_simple", ["mesh.elements=600"]))
    assert caplog.text == ""
    with caplog.at_level(logging.WARNING):
        full_model(load_scene("paper_simple", ["mesh.elements=4000"]))
    assert MPI.COMM_WORLD.rank > 0 or "changes the lowest frequency by about 5e-03" in caplog.text


def test_gathering_keeps_everything_on_rank_0_only(load_scene) -> None:
    model: FullModel = full_model(load_scene())
    body = model.gather()
    if MPI.COMM_WORLD.rank > 0:
        assert body is None
        return
    assert body is not None and body.size == 153 and body.outputs.shape == (51, 153) and body.B.shape == (153, 1)
    assert sp.issparse(body.M) and body.domain == (0.0, 5.0)
