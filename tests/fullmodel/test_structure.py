import dataclasses

import numpy as np
import pytest
from blocks import block
from gathering import gathered
from statics import static_outputs
from surfaces import mapped
from textbook import relative

from pmr import InputError
from pmr.fullmodel.actions import Action, Weight
from pmr.fullmodel.eigensolvers import DenseEigenSolver, SlepcEigenSolver
from pmr.fullmodel.from_scene import structure_of
from pmr.fullmodel.structure import Clamp, Structure, structural_model
from pmr.models.beam2d import Beam2D
from pmr.models.beam3d import Beam3D
from pmr.models.named_mesh import NamedMesh
from pmr.models.shell import Shell
from pmr.models.solid import Solid
from pmr.scene import Damping, Scene
from pmr.scene.built import GRAVITY, Profile
from pmr.scene.members import member_at
from pmr.scene.structures import Beam3DBody, BeamSection, Material, Plate, PointMass, ShellBody, SolidBody

pytestmark = pytest.mark.mpi
SOFT, STIFF = Material(young=1e9, density=1000.0), Material(young=1e12, poisson=0.1, density=3000.0)


def angle_section() -> NamedMesh:
    """A folded strip: its end is no straight line, so that it has a rotation."""
    return mapped((6, 4), lambda u, v: np.stack([u, 0.2 * np.abs(v - 0.5), 0.2 * (v - 0.5)], axis=1))


def shell(regions=None, mesh: NamedMesh | None = None) -> Shell:
    body = ShellBody(plate=Plate(thickness=0.01, material=SOFT), regions=regions or {})
    return Shell(body, mesh or angle_section())


def beam() -> Beam3D:
    section = BeamSection(area=1e-2, second_moment_y=1e-5, second_moment_z=2e-5, torsion_constant=1e-5)
    return Beam3D(Beam3DBody(length=2, section=section, elements=8))


def halves() -> NamedMesh:
    mesh = angle_section()
    near = np.flatnonzero(mesh.points[mesh.cells][..., 0].mean(axis=1) < 0.5)
    far = np.setdiff1d(np.arange(len(mesh.cells)), near)
    return dataclasses.replace(mesh, regions={"near": near, "far": far})


def total(structure: Structure) -> float:
    """Work of unit weight on a unit translation: the mass that is not held."""
    full = structural_model(structure)
    return float(gathered(full.B)[:, 0].sum())


def test_regions_have_their_own_plates() -> None:
    M = {}
    for name, regions in (
        ("all", {}),
        ("far", {"far": Plate(thickness=0.03, material=STIFF)}),
        ("both", {"near": Plate(thickness=0.03, material=STIFF), "far": Plate(thickness=0.03, material=STIFF)}),
    ):
        model = shell(regions, halves())
        full = structural_model(Structure(model))
        x = model.rigid_motions()[:, 2]
        M[name] = x @ gathered(full.M) @ x
    area = 0.2 * np.sqrt(2.0)
    assert M["all"] == pytest.approx(area * 0.01 * 1000.0, rel=1e-12)
    assert M["far"] == pytest.approx(area / 2 * (0.01 * 1000.0 + 0.03 * 3000.0), rel=1e-12)
    assert M["both"] == pytest.approx(area * 0.03 * 3000.0, rel=1e-12)


def test_a_region_of_stiffer_material_is_stiffer_on_every_number_of_ranks() -> None:
    """Both halves exchanged: the tip deflects less if the clamped half is the stiff one."""
    deflections = {}
    for name in ("near", "far"):
        tip = Action("tip", "u1", "z")
        model = shell({name: Plate(thickness=0.01, material=STIFF)}, halves())
        deflections[name] = static_outputs(
            structural_model(Structure(model, (Clamp("u0"),), (), (tip,), (tip,)))
        ).item()
    assert deflections["near"] < 0.7 * deflections["far"]


def test_unknown_and_overlapping_regions_are_refused() -> None:
    plate = Plate(thickness=0.02)
    with pytest.raises(InputError, match="body.regions.middle: mesh has these regions: far, near"):
        structural_model(Structure(shell({"middle": plate}, halves())))
    mesh = halves()
    mesh = dataclasses.replace(mesh, regions={**mesh.regions, "some": np.array([0, 1, 2])})
    with pytest.raises(InputError, match="shares cells with (near|far)"):
        structural_model(Structure(shell({"near": plate, "far": plate, "some": plate}, mesh)))


def test_a_solid_has_regions_too() -> None:
    mesh = block("hexahedron", (4, 1, 1), (1.0, 0.1, 0.1))
    right = np.flatnonzero(mesh.points[mesh.cells][..., 0].mean(axis=1) > 0.5)
    mesh = dataclasses.replace(mesh, regions={"right": right})
    materials = [Material(young=young, poisson=0.0) for young in (1e9, 3e9)]
    model, pull = (
        Solid(SolidBody(material=materials[0], regions={"right": materials[1]}), mesh),
        Action("F", "tip", "x"),
    )
    full = structural_model(Structure(model, (Clamp("tail"),), (), (pull,), (pull,)))
    assert static_outputs(full).item() == pytest.approx(0.5 / 0.01 * (1 / 1e9 + 1 / 3e9), rel=1e-9)  # springs in series


MASS = {"name": "payload", "on": "u1", "mass": 7.0, "inertia": (0.1, 0.2, 0.3), "at": (1.1, 0.05, 0.3)}


@pytest.mark.parametrize("coupling", ["average", "rigid"])
def test_an_attached_mass_moves_with_the_body(coupling: str) -> None:
    """Rigid motion: mass, static moments and inertia are those of the shell and the mass together."""
    model, mass = shell(), PointMass(**MASS, coupling=coupling)
    plain, loaded = (structural_model(Structure(model, masses=masses)) for masses in ((), (mass,)))
    R = model.rigid_motions()
    expected = R.T @ gathered(plain.M) @ R
    p = np.array(MASS["at"])
    G = np.zeros((6, 6))
    G[:3, :3], G[3:, 3:] = np.eye(3), np.eye(3)
    G[:3, 3:] = np.stack([np.cross(e, p) for e in np.eye(3)], axis=1)
    expected = expected + G.T @ np.diag([7.0, 7.0, 7.0, 0.1, 0.2, 0.3]) @ G
    if coupling == "rigid":
        free = np.setdiff1d(np.arange(model.size), model.coordinates_on("u1", model.directions))
        assert loaded.size == len(free) + 6
        R = np.concatenate([R[free], G])
    assert R.T @ gathered(loaded.M) @ R == pytest.approx(expected, rel=1e-11, abs=1e-11)
    assert np.abs(gathered(loaded.K) @ R).max() < 1e-11 * np.abs(gathered(loaded.K)).max()
    assert total(Structure(model, masses=(mass,), loads=(Weight((0.0, 0.0, 1.0)),))) > 0.0


def planar() -> Beam2D:
    body = Profile(length=2.0, bending_stiffness=2e5, mass_per_length=10.0, axial_stiffness=1e8, axial=True)
    return Beam2D(body, np.linspace(0.0, 2.0, 6))


@pytest.mark.parametrize("end", ["tail", "tip"])
@pytest.mark.parametrize("made", [planar, beam], ids=["beam2d", "beam3d"])
def test_a_mass_coupled_to_a_single_node_moves_with_it(made, end: str) -> None:
    """Its motions take the place of the node's coordinates, in another order and with other signs."""
    mass = PointMass(name="payload", on=end, mass=7.0, coupling="rigid")
    plain, loaded = (structural_model(Structure(made(), masses=masses)) for masses in ((), (mass,)))
    assert plain.rigid is not None and loaded.rigid is not None
    R, R_loaded = (np.concatenate(full.comm.allgather(full.rigid.coordinates)) for full in (plain, loaded))
    K, M = gathered(loaded.K), gathered(loaded.M)
    assert np.abs(K @ R_loaded).max() < 1e-11 * np.abs(K).max() * np.abs(R_loaded).max()
    along = [r[:, 0] for r in (R, R_loaded)]  # translation along x
    assert along[1] @ M @ along[1] == pytest.approx(along[0] @ gathered(plain.M) @ along[0] + 7.0, rel=1e-12)


@pytest.mark.parametrize("coupling", ["average", "rigid"])
def test_a_heavy_tip_mass_on_a_beam_swings_as_a_spring_and_a_mass(coupling: str) -> None:
    """omega^2 = 3 EI / (L^3 (m + 33/140 rho A L)), Blevins: Formulas for Natural Frequency, table 8-8."""
    model = beam()
    mass = PointMass(name="payload", on="tip", mass=5e4, coupling=coupling)
    full = structural_model(Structure(model, (Clamp("tail"),), (mass,)))
    E, rho = model.body.material.young, model.body.material.density
    expected = [np.sqrt(3 * E * I / (8.0 * (5e4 + 33 / 140 * rho * 1e-2 * 2.0))) for I in (1e-5, 2e-5)]
    for solver in (DenseEigenSolver, SlepcEigenSolver):
        assert solver(full).lowest(0.0, 2).omega == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("model", ["beam2d", "beam3d"])
def test_a_mass_of_a_scene_is_at_a_place_along_its_beam(model: str) -> None:
    """A heavy mass at the distance a, between nodes or at the tip, has omega^2 = 3 EI / (m a^3) in bending."""
    length, m, lowest = 6.0, 5e7, {}
    for on in ("tip", length, 2.53):
        clamp, mass = {"on": "tail", "kind": "clamped"}, {"name": "winch", "on": on, "mass": m}
        body = {"model": model, "shear": False, "box": {"length": length, "width": 0.3, "height": 0.4, "wall": 0.01}}
        parts = {"supports": [clamp], "masses": [mass], "loads": [{"name": "F", "signal": 1.0}]}
        keys = {"title": "winch", "body": body, "mesh": {"elements": 11}, **parts, "time": {"end": 1.0, "step": 0.1}}
        full = structural_model(structure_of(member_at(Scene.model_validate(keys), 0)))
        lowest[on] = DenseEigenSolver(full).lowest(0.0, 2 if model == "beam3d" else 1).omega[-1]
    assert lowest["tip"] == pytest.approx(lowest[length], rel=1e-12)
    EI = 210e9 * (0.31 * 0.41**3 - 0.29 * 0.39**3) / 12.0
    for a in (length, 2.53):
        assert lowest[a] == pytest.approx(np.sqrt(3.0 * EI / (m * a**3)), rel=1e-4)


def test_averaging_leaves_the_end_free_to_deform_and_rigid_does_not() -> None:
    """A force on one corner of the end, along the line to the other corner, moves both alike if the end is rigid."""
    apart = {}
    for coupling in ("average", "rigid"):
        mass = PointMass(**MASS, coupling=coupling)
        corners = (Action("c", "11", "z"), Action("d", "10", "z"))
        full = structural_model(Structure(shell(), (Clamp("u0"),), (mass,), corners[:1], corners))
        c, d = static_outputs(full)[:, 0]
        apart[coupling] = abs(c - d) / abs(c)
    assert apart["rigid"] < 1e-9 and apart["average"] > 1e-2


def test_gravity_acts_on_everything() -> None:
    """The support's reaction is the weight: what a clamp holds hangs on the clamp."""
    model, mass = beam(), PointMass(name="payload", on="tip", mass=250.0)
    full = structural_model(Structure(model, (), (mass,), (Weight(),)))
    R = model.rigid_motions()
    force = R.T @ gathered(full.B)[:, 0] * GRAVITY
    weight = -(2.0 * 1e-2 * 7850.0 + 250.0) * GRAVITY
    assert force[:3] == pytest.approx([0.0, 0.0, weight], abs=1e-9)
    assert force[4] == pytest.approx((2.0 * 1e-2 * 7850.0 * 1.0 + 250.0 * 2.0) * GRAVITY, rel=1e-12)


def test_what_is_held_is_left_out() -> None:
    model = shell()
    full = structural_model(Structure(model, (Clamp("u0", ("x", "rz")),), loads=(Action("F", "u0", "x"),)))
    held = model.coordinates_on("u0", ("x", "rz"))
    assert full.size == model.size - len(held)
    free = np.setdiff1d(np.arange(model.size), held)
    whole = structural_model(Structure(model))
    assert relative(gathered(full.K), gathered(whole.K)[np.ix_(free, free)]) < 1e-14
    assert np.all(gathered(full.B) == 0.0)  # a force on what is held does nothing


def test_a_line_load_is_spread_evenly_and_works_on_the_mean() -> None:
    model = shell()
    load = Action("F", "u1", "z")
    full = structural_model(Structure(model, (), (), (load,), (load,)))
    column, row = gathered(full.B)[:, 0], gathered(full.outputs)[:, 0]
    assert np.array_equal(column, row)
    assert column @ model.rigid_motions()[:, 2] == pytest.approx(1.0, rel=1e-12)
    vertices = np.sort(column[column > 0.0])
    assert vertices == pytest.approx(np.sort([*[1 / 24] * 2, *[1 / 12] * 3, *[1 / 6] * 4]), rel=1e-12)  # Simpson


def test_damping_has_the_ratio_at_both_frequencies() -> None:
    damping = Damping.model_validate({"ratio": 0.005, "frequencies": [10.0, 60.0]})
    for f in (10.0, 60.0):
        omega = 2 * np.pi * f
        assert (damping.mass / omega + damping.stiffness * omega) / 2 == pytest.approx(0.005, rel=1e-12)
    full = structural_model(Structure(shell(), (Clamp("u0"),), (PointMass(**MASS),), damping=damping))
    expected = damping.mass * gathered(full.M) + damping.stiffness * gathered(full.K)
    assert relative(gathered(full.D), expected) < 1e-14
    assert Structure(shell()).damping == Damping()


def test_a_rigid_coupling_on_a_clamp_is_refused() -> None:
    mass = PointMass(name="m", on="u0", mass=1.0, coupling="rigid")
    with pytest.raises(InputError, match="masses.m.on = 'u0': shares coordinates with the clamp at u0"):
        structural_model(Structure(shell(), (Clamp("u0"),), (mass,)))


def test_a_direction_that_the_model_lacks_is_refused() -> None:
    with pytest.raises(InputError, match="F.direction = 'rotation': x, y, z, rx, ry, rz are allowed"):
        structural_model(Structure(beam(), (), (), (Action("F", "tip", "rotation"),)))


def test_the_model_is_the_same_on_any_number_of_ranks() -> None:
    """Against numbers of one rank, to 1e-8."""
    mass = PointMass(**MASS)
    full = structural_model(
        Structure(shell(), (Clamp("u0"),), (mass,), (Action("F", "u1", "y"),), (Action("o", "11", "y"),))
    )
    assert static_outputs(full).item() == pytest.approx(REFERENCE["deflection"], rel=1e-8)
    assert SlepcEigenSolver(full).lowest(0.0, 3).omega == pytest.approx(REFERENCE["omega"], rel=1e-8)
    assert np.sum(np.abs(gathered(full.M))) == pytest.approx(REFERENCE["mass"], rel=1e-10)


REFERENCE = {
    "deflection": 0.00015017234481,
    "omega": [7.02055195325, 44.0807153766, 56.9594437308],
    "mass": 901.28685155387,
}
