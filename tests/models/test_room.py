"""What every structural model of the room fulfils, whatever it is made of."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from blocks import block
from gathering import gathered
from statics import static_outputs
from surfaces import mapped

from pmr import InputError
from pmr.fem.compat import MPI
from pmr.fullmodel.actions import Action, Inertia, Weight
from pmr.fullmodel.model import FullModel, assemble_model
from pmr.fullmodel.structure import Clamp, Structure, structural_model
from pmr.models import FiniteElementModel
from pmr.models.beam2d import Beam2D
from pmr.models.beam3d import Beam3D, box_beam
from pmr.models.named_mesh import NamedMesh
from pmr.models.shell import Shell
from pmr.models.solid import Solid
from pmr.scene.box import Box
from pmr.scene.frame import INERTIA
from pmr.scene.structures import Beam3DBody, BeamSection, Material, Plate, PointMass, Profile, ShellBody, SolidBody
from pmr.system.body_matrices import CARRIED, CONSTANT, LINEAR, ROTATING

pytestmark = pytest.mark.mpi
LENGTH, WIDTH, DEPTH = 2.0, 0.1, 0.05  # a flat bar along x, bent along z (the planar beam: along y)
HOLLOW = Box(length=5.0, width=0.3, height=0.2, wall=0.008)  # softest along z, as the bar
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


def hollow() -> Beam3D:
    return box_beam(Beam3DBody(length=HOLLOW.length, profile=HOLLOW, shear=True, elements=8), HOLLOW)


@dataclasses.dataclass(frozen=True)
class Bar:
    """A straight body along x from its tail at 0, and what every model of it has to know; by default the flat bar."""

    make: Callable[[], FiniteElementModel]
    length: float = LENGTH
    mass: float = MASS
    bending_stiffness: float = STEEL.young * WIDTH * DEPTH**3 / 12  # N m^2, of bending along z
    spread: tuple[float, float] = (WIDTH**2 / 12, DEPTH**2 / 12)  # m^2: means of y^2 and z^2 over the mass


def hollow_bar() -> Bar:
    """The box of plates by its mid-surface: the second moments of its outer less those of its inner rectangle."""
    length, b, h, t = HOLLOW.length, HOLLOW.width, HOLLOW.height, HOLLOW.wall
    area = 2.0 * (b + h) * t
    about_y, about_z = (
        ((across + t) * (along + t) ** 3 - (across - t) * (along - t) ** 3) / 12.0 for across, along in ((b, h), (h, b))
    )
    spread = (about_z / area, about_y / area)
    return Bar(hollow, length, STEEL.density * area * length, STEEL.young * about_y, spread)


#: Models of the room; one that is made from boxes alone brings its own dimensions, as the last one.
MODELS = {
    "beam2d": Bar(planar),
    "beam3d": Bar(spatial),
    "shell": Bar(lambda: Shell(ShellBody(plate=Plate(thickness=DEPTH)), strip())),
    "hexahedra": Bar(lambda: Solid(SolidBody(), bar("hexahedron"))),
    "tetrahedra": Bar(lambda: Solid(SolidBody(), bar("tetrahedron"))),
    "beam3d of a box": hollow_bar(),
}


@pytest.fixture(scope="module", params=MODELS)
def body(request) -> Bar:
    return MODELS[request.param]


@pytest.fixture(scope="module")
def model(body: Bar) -> FiniteElementModel:
    return body.make()


def test_matrices_are_symmetric_and_know_rigid_motions(model: FiniteElementModel, body: Bar) -> None:
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
    assert R[:, along] @ M @ R[:, along] == pytest.approx(body.mass, rel=1e-12)
    turning = R[:, model.directions.index("ry")]
    assert turning @ M @ turning == pytest.approx(body.mass * (body.length**2 / 3 + body.spread[1]), rel=3e-4)


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
        assert np.abs(rows.evaluate(R.T)).max() < 1e-11 * np.abs(rows.rows).max() * np.abs(R).max()
        assert len(rows.points) == len(rows.cell) == len(rows.face) and rows.cell.max() == len(grid.cells) - 1


def test_a_cantilever_bends_and_sags_as_a_beam(model: FiniteElementModel, body: Bar) -> None:
    """F L^3 / (3 EI) and rho g A L^4 / (8 EI), but for Poisson's ratio, shear and coarse meshes."""
    tip = Action("tip", "tip", "z")
    full = structural_model(Structure(model, (Clamp("tail", model.directions),), (), (tip, Weight()), (tip,)))
    under_force, under_weight = static_outputs(full)[0]
    EI, length = body.bending_stiffness, body.length
    assert under_force == pytest.approx(length**3 / (3 * EI), rel=2e-2)
    assert under_weight == pytest.approx(-body.mass * length**3 / (8 * EI), rel=2e-2)


def test_the_frequency_scale_has_the_right_magnitude(model: FiniteElementModel, body: Bar) -> None:
    first = 3.516 * np.sqrt(body.bending_stiffness / (body.mass / body.length)) / body.length**2
    assert first / 4.0 < model.reference_frequency < 0.8 * first


TURNING = (0.5, 0.4, 0.6)


def on_tip(model: FiniteElementModel, body: Bar) -> PointMass:
    """A body whose centre is off the axis, where the model knows what that is."""
    at = None if len(model.directions) == 3 else (body.length, 0.02, -0.03)
    return PointMass(name="load", on="tip", mass=40.0, inertia=TURNING, at=at)


def moments(model: FiniteElementModel, body: Bar, mass: PointMass | None) -> tuple[float, np.ndarray, np.ndarray]:
    """The integrals of rho, rho r and rho r r^T over the bar and a body on it."""
    planar = len(model.directions) == 3
    m, first = body.mass, body.mass * np.array([body.length / 2, 0.0, 0.0])
    second = body.mass * np.diag([body.length**2 / 3, *((0.0, 0.0) if planar else body.spread)])
    if mass is not None:
        at = np.array([body.length, 0.0, 0.0]) if mass.at is None else np.array(mass.at)
        own = np.diag(sum(mass.inertia) / 2.0 - np.array(mass.inertia))
        m, first, second = m + mass.mass, first + mass.mass * at, second + mass.mass * np.outer(at, at) + own
    return m, first, second


def turned(direction: str) -> tuple[np.ndarray, np.ndarray]:
    """A rigid motion u = a + W r: a (3,), W (3, 3)."""
    axis = np.eye(3)["xyz".index(direction[-1])]
    return (np.zeros(3), np.cross(axis, np.eye(3)).T) if direction[0] == "r" else (axis, np.zeros((3, 3)))


@pytest.fixture(scope="module", params=["bare", "with a mass"])
def mass(request, model: FiniteElementModel, body: Bar) -> PointMass | None:
    if request.param == "bare":
        return None
    if isinstance(model, Shell):
        pytest.skip("the end of a flat shell has no rotation")
    return on_tip(model, body)


@pytest.fixture(scope="module")
def full(model: FiniteElementModel, mass: PointMass | None) -> FullModel:
    """With all that a moving frame adds."""
    names = tuple(ROTATING | CARRIED)
    masses = () if mass is None else (mass,)
    loads = tuple(Inertia(field.removeprefix(INERTIA)) for field in CONSTANT | LINEAR)
    return structural_model(Structure(model, masses=masses, loads=loads, matrices=names))


def test_inertia_in_a_moving_frame_is_that_of_a_rigid_body(
    model: FiniteElementModel, body: Bar, mass: PointMass | None, full: FullModel
) -> None:
    R, directions = model.rigid_motions(), model.directions
    m, first, second = moments(model, body, mass)
    scale = m * body.length**2
    for name, S in (ROTATING | CARRIED).items():
        found = gathered(full.matrices[name]) if name in full.matrices else np.zeros((full.size, full.size))
        expected = np.array(
            [
                [
                    v @ S @ u * m + v @ S @ U @ first + (V @ first) @ S @ u + np.trace(V.T @ S @ U @ second)
                    for u, U in map(turned, directions)
                ]
                for v, V in map(turned, directions)
            ]
        )
        assert R.T @ found @ R == pytest.approx(expected, abs=1e-11 * scale), name
        sign = -1.0 if name in ROTATING else 1.0
        assert np.abs(found - sign * found.T).max() <= 1e-14 * np.abs(found).max(), name


def test_the_carried_matrices_add_up_to_the_mass(model: FiniteElementModel, full: FullModel) -> None:
    """But for the inertia of drilling rotations, which a shell's mass has and no point of it moves by."""
    found = sum(gathered(full.matrices[name]) for name in CARRIED if name[-1] == name[-2] and name in full.matrices)
    left = gathered(full.M) - found
    if isinstance(model, Shell):
        turns = model.nodes.component >= 3
        assert np.linalg.eigvalsh(left)[0] > -1e-14 * np.abs(full.M.norm())
        left = left[~turns]
    assert np.abs(left).max() < 1e-14 * full.M.norm()


def test_inertia_loads_are_those_of_a_field_of_acceleration(
    model: FiniteElementModel, body: Bar, mass: PointMass | None, full: FullModel
) -> None:
    R, directions = model.rigid_motions(), model.directions
    m, first, second = moments(model, body, mass)
    known = dict(zip(full.input_names, (R.T @ gathered(full.B)).T, strict=True))
    for j in range(3):
        fields = {f"inertia {'xyz'[j]}": (m, first)}
        fields |= {f"inertia {'xyz'[j]}{'xyz'[k]}": (first[k], second[:, k]) for k in range(3)}
        for name, (total, arm) in fields.items():
            expected = [v[j] * total + V[j] @ arm for v, V in map(turned, directions)]
            assert known.get(name, np.zeros(len(directions))) == pytest.approx(expected, abs=1e-11 * m), name


def test_a_frame_that_turns_loads_as_the_mass_does(
    model: FiniteElementModel, mass: PointMass | None, full: FullModel
) -> None:
    """The field e_k x r is a rigid motion: M R, element by element, but for drilling rotations."""
    R = model.rigid_motions()
    M, loads = gathered(full.M), dict(zip(full.input_names, gathered(full.B).T, strict=True))
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        turn = f"r{'xyz'[k]}"
        if turn not in model.directions:
            continue
        by_axes = [loads.get(f"inertia {'xyz'[a]}{'xyz'[b]}", np.zeros(full.size)) for a, b in ((j, i), (i, j))]
        left = by_axes[0] - by_axes[1] - M @ R[:, model.directions.index(turn)]
        if isinstance(model, Shell):
            left = left[model.nodes.component < 3]
        # a place measures rigid motions to 1e-11
        assert np.abs(left).max() < 1e-13 * np.abs(M @ R).max() + (0.0 if mass is None else 1e-11 * mass.mass)


def test_a_missing_place_is_refused(model: FiniteElementModel) -> None:
    for ask in (model.motion, model.displacement, model.centroid):
        with pytest.raises(InputError, match="nowhere|tip"):
            ask("nowhere")
    with pytest.raises(InputError):
        model.coordinates_on("nowhere", model.directions)
