"""Stresses of every model that has them: patches, the strain energy of the weak form, a cantilever."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg
from blocks import block
from boxes import box
from gathering import gathered
from surfaces import mapped

from pmr.fem.compat import MPI, rule_points
from pmr.fullmodel.model import assemble_model
from pmr.models import FiniteElementModel
from pmr.models.beam2d import Beam2D
from pmr.models.beam3d import Beam3D
from pmr.models.meshed import cell_values
from pmr.models.named_mesh import NamedMesh
from pmr.models.shell import Shell, frames
from pmr.models.solid import Solid
from pmr.results.field_stress import StressRows
from pmr.scene.structures import Beam3DBody, BeamSection, BoxProfile, Material, Plate, Profile, ShellBody, SolidBody

pytestmark = pytest.mark.mpi
MATERIAL = Material(young=210e9, poisson=0.3)
E, NU, G = MATERIAL.young, MATERIAL.poisson, MATERIAL.shear_modulus
PROFILE = BoxProfile(width=0.3, height=0.4, wall=0.008)
THICKNESS = 0.05


def turned(mesh: NamedMesh, angle: float = 0.3) -> NamedMesh:
    """About y, so that no axis of the mesh is one of space."""
    c, s = np.cos(angle), np.sin(angle)
    return dataclasses.replace(mesh, points=mesh.points @ np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]]))


def plate() -> NamedMesh:
    return mapped((4, 3), lambda u, v: np.stack([2 * u, v + 0.1 * np.sin(5 * u) * v * (1 - v), 0 * u], axis=1))


def shell(mesh: NamedMesh | None = None) -> Shell:
    return Shell(ShellBody(plate=Plate(material=MATERIAL, thickness=THICKNESS)), mesh or plate())


def solid(kind: str) -> Solid:
    """Cells that are no boxes: inner points are shifted, but planes stay planes."""
    mesh = block(kind, (4, 3, 1), (2.0, 1.0, 0.2))
    x, y, z = mesh.points.T
    points = np.stack([x + 0.1 * np.sin(np.pi * x) * y, y + 0.1 * np.sin(np.pi * y) * x, z], axis=1)
    return Solid(SolidBody(material=MATERIAL), dataclasses.replace(mesh, points=points))


def beam(shear: bool = False) -> Beam3D:
    return Beam3D(Beam3DBody(length=3.0, profile=PROFILE, material=MATERIAL, elements=7, shear=shear))


def interpolated(model: Shell | Solid, motion: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Coordinates of a motion: displacement, or displacement and rotation, (n, 3 or 6) at places (n, 3)."""
    values = motion(model.nodes.points)
    return np.asarray(values[np.arange(model.size), model.nodes.component])


def at_face(rows: StressRows, stresses: np.ndarray, face: str) -> np.ndarray:
    return stresses[0, rows.points_on(face)]


@pytest.mark.parametrize("kind", ["hexahedron", "tetrahedron"])
def test_a_solid_patch_has_the_stresses_of_its_linear_motion(kind: str) -> None:
    model = solid(kind)
    H = np.array([[1.0, 2.0, -0.5], [0.3, -1.0, 0.7], [0.2, 0.4, 0.6]]) * 1e-3
    rows = model.stresses()
    found = rows.evaluate(interpolated(model, lambda x: x @ H.T)[None])
    strain = (H + H.T) / 2
    sigma = E / (1 + NU) * (strain + NU / (1 - 2 * NU) * np.trace(strain) * np.eye(3))
    expected = sigma[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]]
    assert found == pytest.approx(np.broadcast_to(expected, found.shape), rel=1e-9)
    deviator = sigma - np.trace(sigma) / 3 * np.eye(3)
    assert rows.von_mises(found) == pytest.approx(np.full(found.shape[:2], np.sqrt(1.5 * np.sum(deviator**2))))
    assert rows.faces == ("outer", "middle") and len(rows.points_on("middle")) == len(model.mesh.cells)


@pytest.mark.parametrize("kind", ["hexahedron", "tetrahedron"])
def test_bending_of_a_solid_shows_on_both_of_its_faces_with_one_cell_across(kind: str) -> None:
    """Pure bending with its anticlastic curvature is quadratic: sigma_xx = -E kappa (z - h / 2), nothing else."""
    model, kappa, h = solid(kind), 1e-3, 0.2
    if kind == "hexahedron":
        model = Solid(model.body, block(kind, (4, 3, 1), (2.0, 1.0, h)))

    def motion(at: np.ndarray) -> np.ndarray:
        x, y, z = at[:, 0], at[:, 1], at[:, 2] - h / 2
        return kappa * np.stack([-x * z, NU * y * z, x**2 / 2 + NU * (z**2 - y**2) / 2], axis=1)

    rows = model.stresses()
    found = rows.evaluate(interpolated(model, motion)[None])[0]
    expected = np.zeros_like(found)
    expected[:, 0] = -E * kappa * (rows.points[:, 2] - h / 2)
    assert found == pytest.approx(expected, abs=1e-9 * E * kappa * h)
    assert np.abs(found[:, 0]).max() == pytest.approx(E * kappa * h / 2, rel=1e-9)


def test_a_hollow_solid_has_an_inside() -> None:
    mesh = block("hexahedron", (2, 3, 3), (2.0, 0.3, 0.3))
    middle = mesh.points[mesh.cells].mean(axis=1)
    hollow = np.flatnonzero(np.any(np.abs(middle[:, 1:] - 0.15) > 0.06, axis=1))
    cells, used = mesh.cells[hollow], np.unique(mesh.cells[hollow])
    mesh = dataclasses.replace(mesh, cells=cells, groups={}, regions={})
    assert len(used) == len(mesh.points)
    rows = Solid(SolidBody(), mesh).stresses()
    inner = rows.points[rows.points_on("inner")]
    assert len(inner) == 8 and np.abs(inner[:, 1:] - 0.15).max(axis=1) == pytest.approx(np.full(8, 0.05))
    assert len(rows.points_on("outer")) == 2 * 12 + 2 * 8
    fields = rows.by_cell(np.arange(len(rows.points))[None] * 1.0, len(cells))
    corner = np.flatnonzero(~np.isin(np.arange(len(cells)), rows.cell[rows.points_on("inner")]))
    assert fields["inner"][0, corner] == pytest.approx(rows.points_on("middle")[corner])


def test_a_shell_under_tension_and_shear() -> None:
    """Wherever it lies in space: components along its length, across it and between."""
    H = np.array([[1.0, 0.4], [0.2, -0.5]]) * 1e-3  # u1,1 u1,2; u2,1 u2,2
    e11, e22, e12 = H[0, 0], H[1, 1], (H[0, 1] + H[1, 0]) / 2
    expected = E / (1 - NU**2) * np.array([e11 + NU * e22, e22 + NU * e11, (1 - NU) * e12])
    for mesh in (plate(), turned(plate())):
        model = shell(mesh)
        e1, e2 = mesh.points[mesh.groups["u1"].entities[0, 0]] / 2.0, np.array([0.0, 1.0, 0.0])
        e1 = e1 / np.linalg.norm(e1)
        drilling = np.cross(e1, e2) * (H[1, 0] - H[0, 1]) / 2.0

        def motion(x: np.ndarray, e1=e1, e2=e2, drilling=drilling) -> np.ndarray:
            u = (np.stack([x @ e1, x @ e2], axis=1) @ H.T) @ np.stack([e1, e2])
            return np.hstack([u, np.broadcast_to(drilling, u.shape)])

        rows = model.stresses()
        found = rows.evaluate(interpolated(model, motion)[None])
        assert found[0] == pytest.approx(np.broadcast_to(expected, found[0].shape), rel=1e-9)
        s1, s2, t = expected
        assert rows.von_mises(found)[0] == pytest.approx(
            np.full(len(rows.points), np.sqrt(s1**2 - s1 * s2 + s2**2 + 3 * t**2))
        )


def test_a_shell_in_pure_bending() -> None:
    """Moment about y: E t kappa / 2, with the sign of each face; anticlastic curvature leaves nothing across."""
    kappa = 1e-3

    def motion(x: np.ndarray) -> np.ndarray:
        w = kappa * (x[:, 0] ** 2 - NU * x[:, 1] ** 2) / 2
        zero = np.zeros(len(x))
        return np.stack([zero, zero, w, -kappa * NU * x[:, 1], -kappa * x[:, 0], zero], axis=1)

    model = shell()
    rows = model.stresses()
    found, size = rows.evaluate(interpolated(model, motion)[None]), E * kappa * THICKNESS / 2
    for face, sign in (("outer", -1.0), ("middle", 0.0), ("inner", 1.0)):
        on = rows.points_on(face)
        assert at_face(rows, found, face) == pytest.approx(
            np.tile([sign * size, 0.0, 0.0], (len(on), 1)), abs=1e-9 * size
        )
        assert rows.points[on, 2] == pytest.approx(np.full(len(on), -sign * THICKNESS / 2))  # z up: the outer face
        assert np.array_equal(rows.cell[on], np.arange(len(model.mesh.cells)))


def test_the_outer_face_of_a_box_is_its_outside_whichever_way_the_triangles_turn() -> None:
    rows = shell(box()).stresses()
    outer, inner = (rows.points[rows.points_on(face)] for face in ("outer", "inner"))
    beyond = np.maximum(np.abs(outer[:, 1]) - 0.15, np.abs(outer[:, 2]) - 0.2)
    assert beyond == pytest.approx(np.full(len(outer), THICKNESS / 2))
    assert np.linalg.norm(outer - inner, axis=1) == pytest.approx(np.full(len(outer), THICKNESS))


def stiffness(model: FiniteElementModel) -> np.ndarray:
    return gathered(assemble_model(model, model.domain(MPI.COMM_WORLD)).K)


def surface_energy(model: Shell, q: np.ndarray) -> tuple[float, float]:
    """Membrane and bending part of q^T K q, at the points of the rule that the weak form takes."""
    found, t = cell_values(model, model.plane_stresses, rule_points("triangle", 2)), model.body.plate.thickness
    sigma = np.einsum("cqvd,cd->cqv", found.entries, q[found.coordinates])
    compliance = np.array([[1.0, -NU, 0.0], [-NU, 1.0, 0.0], [0.0, 0.0, 2.0 * (1.0 + NU)]]) / E
    corners = model.mesh.points[model.mesh.cells]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    membrane, bending = (
        factor * np.einsum("c,cqv,vw,cqw->", areas / 3, part, compliance, part)
        for factor, part in ((t, sigma[..., :3]), (t**3 / 12, sigma[..., 3:]))
    )
    return float(membrane), float(bending)


def without_shear(mesh: NamedMesh, thickness: float) -> Shell:
    plate = Plate(material=MATERIAL, thickness=thickness)
    return Shell(ShellBody(plate=plate, shear_correction=1e-15), mesh)


def test_a_shells_membrane_stresses_have_the_energy_of_its_weak_form() -> None:
    """Bending and drilling grow with t^3, so that two thicknesses tell them from the membrane."""
    thick, thin = (without_shear(turned(box(skew=0.3)), t) for t in (THICKNESS, THICKNESS / 2))
    q = np.random.default_rng(1).normal(size=thick.size)
    whole, half = (float(q @ stiffness(model) @ q) for model in (thick, thin))
    assert 8 * half - whole == pytest.approx(3 * surface_energy(thick, q)[0], rel=1e-8)


def test_a_shells_bending_stresses_have_the_energy_of_its_weak_form() -> None:
    """Rotations within a flat plate leave its drilling term at rest."""
    model = without_shear(turned(plate()), THICKNESS)
    normal = frames(model.mesh)[0, 2]
    at, component = model.nodes.points, model.nodes.component
    turns = np.cross(normal, np.sin(3.0 * at + at[:, ::-1] ** 2))
    q = np.where(component < 3, 0.0, turns[np.arange(model.size), component % 3])
    membrane, bending = surface_energy(model, q)
    assert membrane == 0.0 and q @ stiffness(model) @ q == pytest.approx(bending, rel=1e-9)


def test_a_solids_stresses_have_the_energy_of_its_weak_form() -> None:
    """At the points of the rule that both take in tetrahedra."""
    model = solid("tetrahedron")
    q = np.random.default_rng(1).normal(size=model.size)
    found = cell_values(model, model.stress_components, rule_points("tetrahedron", 2))
    sigma = np.einsum("cqvd,cd->cqv", found.entries, q[found.coordinates])
    compliance = np.diag(np.repeat([(1 + NU) / E, 1 / G], 3))
    compliance[:3, :3] -= NU / E
    volumes = np.abs(np.linalg.det(np.diff(model.mesh.points[model.mesh.cells], axis=1))) / 6
    energy = np.einsum("c,cqv,vw,cqw->", volumes / 4, sigma, compliance, sigma)
    assert q @ stiffness(model) @ q == pytest.approx(energy, rel=1e-11)


@pytest.mark.parametrize("shear", [False, True])
def test_a_beams_stresses_have_the_energy_of_its_weak_form(shear: bool) -> None:
    """N, both moments and the torque from the corners' stresses; they are linear in an element."""
    model = beam(shear)
    section, q = model.section, np.random.default_rng(1).normal(size=model.size)
    rows = model.stresses()
    sigma = rows.evaluate(q[None])[0].reshape(4, -1, 2, 2)  # corner, element, end, component
    y, z = 0.308 / 2, 0.408 / 2
    axial, tau = sigma[..., 0], sigma[0, ..., 1]
    N = section.area * axial.mean(axis=0)
    Mz = -section.second_moment_z / y * (axial[1] - axial[0]) / 2
    My = -section.second_moment_y / z * (axial[2] - axial[1]) / 2
    T = tau * 2 * 0.3 * 0.4 * 0.008
    h = np.diff(model.node_stations)
    energy = 0.0
    for force, stiff in ((N, E * section.area), (Mz, E * section.second_moment_z), (My, E * section.second_moment_y),
                         (T, G * section.torsion_constant)):  # fmt: skip
        a, b = force.T
        energy += np.sum(h * (a**2 + a * b + b**2) / 3 / stiff)
    if shear:
        for M, area in ((Mz, section.shear_area_y), (My, section.shear_area_z)):
            energy += np.sum((M[:, 1] - M[:, 0]) ** 2 / h / (G * area))
    assert q @ stiffness(model) @ q == pytest.approx(energy, rel=1e-9)


def test_corners_of_a_beam_lie_on_its_outside() -> None:
    rows = beam().stresses()
    assert rows.points[0] == pytest.approx([0.0, -0.154, -0.204])
    assert rows.points[rows.points_on("top left")][0] == pytest.approx([0.0, 0.154, 0.204])


def test_a_beam_without_a_profile_has_no_stresses() -> None:
    section = BeamSection(area=1e-2, second_moment_y=1e-5, second_moment_z=2e-5, torsion_constant=1e-5)
    assert Beam3D(Beam3DBody(length=2, section=section)).stresses() is None
    body = Profile(length=2.0, bending_stiffness=1.0, mass_per_length=1.0)
    assert Beam2D(body, np.linspace(0.0, 2.0, 4)).stresses() is None


def bent(model: FiniteElementModel) -> np.ndarray:
    """Coordinates under a unit force along z that is spread over the tip, the tail clamped."""
    free = np.setdiff1d(np.arange(model.size), model.coordinates_on("tail", model.directions))
    K = sp.csc_matrix(stiffness(model)[np.ix_(free, free)])
    q = np.zeros(model.size)
    q[free] = scipy.sparse.linalg.spsolve(K, model.displacement("tip")[2].toarray().ravel()[free])
    return q


LENGTH, WIDTH, DEPTH = 2.0, 0.1, 0.05


def bar(kind: str) -> NamedMesh:
    mesh = block(kind, (20, 1, 1), (LENGTH, WIDTH, DEPTH))
    return dataclasses.replace(mesh, points=mesh.points - [0.0, WIDTH / 2, DEPTH / 2])


def strip() -> NamedMesh:
    mesh = mapped((20, 2), lambda u, v: np.stack([LENGTH * u, WIDTH * (v - 0.5), 0 * u], axis=1))
    return dataclasses.replace(mesh, groups={"tail": mesh.groups["u0"], "tip": mesh.groups["u1"]})


def straight_beam() -> Beam3D:
    return Beam3D(Beam3DBody(length=LENGTH, profile=PROFILE, material=MATERIAL, elements=4, shear=True))


BAR, TUBE = WIDTH * DEPTH**3 / 12, (0.308 * 0.408**3 - 0.292 * 0.392**3) / 12
CANTILEVERS = {
    "beam3d": (straight_beam, TUBE),
    "strip": (lambda: Shell(ShellBody(plate=Plate(thickness=DEPTH)), strip()), BAR),
    "box": (lambda: Shell(ShellBody(plate=Plate(thickness=0.008)), box(along=16, around=3)), TUBE),
    "hexahedra": (lambda: Solid(SolidBody(), bar("hexahedron")), BAR),
    "tetrahedra": (lambda: Solid(SolidBody(), bar("tetrahedron")), BAR),
}


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.parametrize("name", CANTILEVERS)
def test_a_cantilever_has_the_stresses_of_bending(name: str) -> None:
    """M z / I within 1 % of the largest one, away from clamp and load: on both faces of each wall."""
    make, second_moment = CANTILEVERS[name]
    model = make()
    rows = model.stresses()
    found = rows.evaluate(bent(model)[None])
    x, z = rows.points[:, 0], rows.points[:, 2]
    away = (x >= 0.3 * LENGTH) & (x <= 0.6 * LENGTH)
    expected = -(LENGTH - x) * z / second_moment
    size = np.abs(expected[away]).max()
    assert np.abs(found[0, away, 0] - expected[away]).max() < 0.01 * size
    extreme = away & (np.abs(expected) > 0.9 * size)  # the webs have the shear force besides
    assert rows.von_mises(found)[0, extreme] == pytest.approx(np.abs(expected[extreme]), rel=0.03)
