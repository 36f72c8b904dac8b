"""What every structural model of the room fulfils, whatever it is made of."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from blocks import block
from gathering import gathered
from statics import static_outputs
from surfaces import mapped

from pmr.errors import InputError
from pmr.fem.compat import MPI
from pmr.fullmodel.assembly import assemble_model
from pmr.fullmodel.structure import Action, Clamp, Structure, Weight, structural_model
from pmr.mesh.named import NamedMesh
from pmr.models import FiniteElementModel
from pmr.models.beam2d import Beam2D
from pmr.models.beam3d import Beam3D
from pmr.models.shell import Shell
from pmr.models.solid import Solid
from pmr.scene.structures import Beam3DBody, BeamSection, Material, Plate, Profile, ShellBody, SolidBody

pytestmark = pytest.mark.mpi
LENGTH, WIDTH, DEPTH = 2.0, 0.1, 0.05  # a flat bar along x, bent along z (the planar beam: along y)
STEEL = Material()
MASS = STEEL.density * LENGTH * WIDTH * DEPTH


def strip() -> NamedMesh:
    mesh = mapped((12, 2), lambda u, v: np.stack([LENGTH * u, WIDTH * (v - 0.5), 0 * u], axis=1))
    groups = {**mesh.groups, "tail": mesh.groups["u0"], "tip": mesh.groups["u1"]}
    return dataclasses.replace(mesh, groups=groups)


def bar(kind: str) -> NamedMesh:
    mesh = block(kind, (20, 1, 1), (LENGTH, WIDTH, DEPTH))
    return dataclasses.replace(mesh, points=mesh.points - [0.0, WIDTH / 2, DEPTH / 2])


def planar() -> Beam2D:
    E, A, I = STEEL.young, WIDTH * DEPTH, WIDTH * DEPTH**3 / 12
    body = Profile(length=LENGTH, bending_stiffness=E * I, mass_per_length=STEEL.density * A, axial_stiffness=E * A,
                axial=True)  # fmt: skip
    return Beam2D(body, np.linspace(0.0, LENGTH, 9))


def spatial() -> Beam3D:
    A, I, J = WIDTH * DEPTH, WIDTH * DEPTH**3 / 12, WIDTH**3 * DEPTH / 12
    section = BeamSection(area=A, second_moment_y=I, second_moment_z=J, torsion_constant=0.229 * WIDTH * DEPTH**3,
                          shear_area_y=A * 5 / 6, shear_area_z=A * 5 / 6)  # fmt: skip
    return Beam3D(Beam3DBody(length=LENGTH, section=section, shear=True, elements=8))


MODELS = {
    "beam2d": planar,
    "beam3d": spatial,
    "shell": lambda: Shell(ShellBody(plate=Plate(thickness=DEPTH)), strip()),
    "hexahedra": lambda: Solid(SolidBody(), bar("hexahedron")),
    "tetrahedra": lambda: Solid(SolidBody(), bar("tetrahedron")),
}


@pytest.fixture(params=MODELS)
def model(request) -> FiniteElementModel:
    return MODELS[request.param]()


def test_matrices_are_symmetric_and_know_rigid_motions(model: FiniteElementModel) -> None:
    operators = assemble_model(model, model.domain(MPI.COMM_WORLD))
    M, K, R = gathered(operators.M), gathered(operators.K), model.rigid_motions()
    assert M.shape == K.shape == (model.size, model.size) and R.shape == (model.size, len(model.directions))
    assert np.abs(M - M.T).max() < 1e-14 * np.abs(M).max() and np.abs(K - K.T).max() < 1e-12 * np.abs(K).max()
    assert np.abs(K @ R).max() < 1e-11 * np.abs(K).max()
    assert np.linalg.eigvalsh(M)[0] > 0.0
    assert np.linalg.matrix_rank(R) == len(model.directions)
    held = K + np.abs(K).max() * 1e-3 * R @ R.T  # no other motion is free
    assert np.linalg.eigvalsh(held)[0] > 1e-9 * np.abs(K).max()
    along = model.directions.index("z")
    assert R[:, along] @ M @ R[:, along] == pytest.approx(MASS, rel=1e-12)
    turning = R[:, model.directions.index("ry")]
    assert turning @ M @ turning == pytest.approx(MASS * (LENGTH**2 / 3 + DEPTH**2 / 12), rel=3e-4)


def test_a_place_follows_a_rigid_motion(model: FiniteElementModel) -> None:
    try:
        motion = model.motion("tip")
    except InputError as error:
        assert "on a line" in str(error)  # the end of a flat shell
        return
    x = model.centroid("tip")
    expected = np.eye(len(model.directions))
    if len(expected) == 3:
        expected[1, 2] = -x[0]
    else:
        expected[:3, 3:] = np.stack([np.cross(e, x) for e in np.eye(3)], axis=1)
    assert motion @ model.rigid_motions() == pytest.approx(expected, abs=1e-11)
    assert (model.displacement("tip") - motion[: len(expected) // 2 + (len(expected) == 3)]).nnz == 0


def test_points_of_the_grid_follow_a_rigid_motion_and_nothing_is_stressed(model: FiniteElementModel) -> None:
    grid, R = model.grid, model.rigid_motions()
    moved = (model.point_displacements() @ R).reshape(len(grid.points), 3, -1)
    expected = np.zeros_like(moved)
    if R.shape[1] == 3:
        expected[:, [0, 2], [0, 1]], expected[:, 2, 2] = 1.0, -grid.points[:, 0]
    else:
        expected[:, :, :3], expected[:, :, 3:] = np.eye(3), np.cross(np.eye(3), grid.points[:, None]).swapaxes(1, 2)
    assert moved == pytest.approx(expected, abs=1e-12)
    assert grid.cells.max() == len(grid.points) - 1
    rows = model.stresses()
    if rows is not None:
        assert np.abs(rows.of(R.T)).max() < 1e-11 * np.abs(rows.rows).max() * np.abs(R).max()
        assert len(rows.points) == len(rows.cell) == len(rows.face) and rows.cell.max() == len(grid.cells) - 1


def test_a_cantilever_bends_and_sags_as_a_beam(model: FiniteElementModel) -> None:
    """F L^3 / (3 EI) and rho g A L^4 / (8 EI), but for Poisson's ratio, shear and coarse meshes."""
    tip = Action("tip", "tip", "z")
    full = structural_model(Structure(model, (Clamp("tail", model.directions),), (), (tip, Weight()), (tip,)))
    under_force, under_weight = static_outputs(full)[0]
    EI = STEEL.young * WIDTH * DEPTH**3 / 12
    assert under_force == pytest.approx(LENGTH**3 / (3 * EI), rel=2e-2)
    assert under_weight == pytest.approx(-MASS * LENGTH**3 / (8 * EI), rel=2e-2)


def test_the_frequency_scale_has_the_right_magnitude(model: FiniteElementModel) -> None:
    EI, mass = STEEL.young * WIDTH * DEPTH**3 / 12, MASS / LENGTH
    first = 3.516 * np.sqrt(EI / mass) / LENGTH**2
    assert first / 4.0 < model.reference_frequency < 0.8 * first


def test_a_missing_place_is_refused(model: FiniteElementModel) -> None:
    for ask in (model.motion, model.displacement, model.centroid):
        with pytest.raises(InputError, match="nowhere|tip"):
            ask("nowhere")
    with pytest.raises(InputError):
        model.coordinates_on("nowhere", model.directions)
