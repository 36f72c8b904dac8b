"""Geometric stiffness and the matrices of a turning frame against closed forms: columns, rotating beams."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
import pytest
import scipy.linalg
from blocks import block
from boxes import HEIGHT, WIDTH, box
from gathering import gathered
from surfaces import mapped

from pmr import InputError, System
from pmr.fem.compat import MPI
from pmr.fullmodel.actions import Action, Inertia
from pmr.fullmodel.model import FullModel, FullSystem
from pmr.fullmodel.moving import FrameAssembler
from pmr.fullmodel.pads import Pads, Support
from pmr.fullmodel.structure import Clamp, Structure, structural_model
from pmr.models import StructuralModel
from pmr.models.beam2d import Beam2D
from pmr.models.beam3d import Beam3D
from pmr.models.shell import Shell
from pmr.models.solid import Solid
from pmr.reduction.basis import modal_basis
from pmr.reduction.free_body import FreeBody
from pmr.reduction.residual import section_model
from pmr.reduction.snapshots import free_modes
from pmr.scene.structures import (
    Beam3DBody,
    BeamSection,
    BoxProfile,
    Material,
    Plate,
    PointMass,
    Profile,
    ShellBody,
    SolidBody,
)
from pmr.simulation.statics.equilibrium import buckling_factors
from pmr.system.assembly import Assembly
from pmr.system.body import SlidingBody
from pmr.system.body_matrices import AXIAL, BENDING, CARRIED, ROTATING, STATES
from pmr.system.contacts import Contact, Place
from pmr.system.terms import Term

pytestmark = pytest.mark.mpi
LENGTH, EI, RHO_A, STEEL = 5.0, 5.0e4, 78.0, Material()
#: First frequency of a rotating cantilever over sqrt(EI / (rho A L^4)), by speed in that unit: Wright, Smith, Thresher,
#: Wang: Vibration modes of centrifugally stiffened beams, Journal of Applied Mechanics 49, 1982.
ROTATING_CANTILEVER = {0: 3.5160, 1: 3.6816, 2: 4.1373, 4: 5.5850, 8: 9.2568, 12: 13.1702}
SECOND_AT_12 = 37.603


def planar(length: float = LENGTH, stiffness: float = EI, elements: int = 8, axial: bool = False) -> Beam2D:
    body = Profile(length=length, bending_stiffness=stiffness, mass_per_length=RHO_A, axial=axial, axial_stiffness=2e7)
    return Beam2D(body, np.linspace(0.0, length, elements + 1))


def spatial(length: float = LENGTH, stiffness: float = EI, elements: int = 8, ratio: float = 1.0) -> Beam3D:
    """As stiff along y as `ratio` times along z, and as heavy as the planar one."""
    E, rho = STEEL.young, STEEL.density
    section = BeamSection(
        area=RHO_A / rho,
        second_moment_y=stiffness / E,
        second_moment_z=ratio * stiffness / E,
        torsion_constant=2.0 * stiffness / E,
    )
    return Beam3D(Beam3DBody(length=length, section=section, shear=False, elements=elements))


BEAMS = {"beam2d": planar, "beam3d": spatial}


def held(model: StructuralModel, masses: Sequence[PointMass] = (), names: Sequence[str] = tuple(AXIAL)) -> FullModel:
    clamps = (Clamp("tail", model.directions),)
    loads = tuple(Action(d, "tip", d) for d in model.directions if d in "yz")
    return structural_model(Structure(model, clamps, tuple(masses), loads, matrices=tuple(names)))


def with_terms(system: System) -> Assembly:
    """Each geometric stiffness of each body as a term of its own."""
    terms = [
        Term(f"{name} {matrix}".strip(), (name,), stiffness=body.matrices[matrix])
        for name, body in system.bodies.items()
        for matrix in STATES
        if matrix in body.matrices
    ]
    return Assembly(dataclasses.replace(system, terms=tuple(terms)))


def factors(full: FullModel, coefficients: Mapping[str, float], count: int = 1) -> np.ndarray:
    """Of a body alone without rows; the same on every rank."""
    system = FullSystem.of(full).gather()
    return full.comm.bcast(None if system is None else alone(system, coefficients, count))


def alone(system: System, coefficients: Mapping[str, float], count: int = 1) -> np.ndarray:
    return buckling_factors(with_terms(system), np.zeros(len(system.sides)), coefficients, count)


@pytest.mark.parametrize("kind", BEAMS)
def test_a_column_under_an_end_load(kind: str) -> None:
    """pi^2 / 4 EI / L^2."""
    found = factors(held(BEAMS[kind]()), {"axial tip": -1.0})
    assert found == pytest.approx(np.pi**2 / 4.0 * EI / LENGTH**2, rel=1e-5)


@pytest.mark.parametrize("kind", BEAMS)
def test_a_column_under_its_own_weight(kind: str) -> None:
    """q L = 7.8373 EI / L^2 with q = rho A a, the frame pushing from below."""
    found = factors(held(BEAMS[kind]()), {"axial uniform": 1.0})
    assert found * RHO_A * LENGTH == pytest.approx(7.8373 * EI / LENGTH**2, rel=1e-4)


@pytest.mark.parametrize("kind", BEAMS)
def test_a_mass_at_the_tip_presses_as_a_load_there(kind: str) -> None:
    mass = PointMass(name="load", on="tip", mass=250.0)
    bare, loaded = (held(BEAMS[kind](), masses) for masses in ((), (mass,)))
    for name, acceleration in (("axial uniform", 1.0), ("axial linear", LENGTH)):
        difference = gathered(loaded.matrices[name]) - gathered(bare.matrices[name])
        expected = -mass.mass * acceleration * gathered(bare.matrices["axial tip"])
        assert np.abs(difference - expected).max() < 1e-12 * np.abs(expected).max()


@pytest.mark.parametrize("share", [0.5, 0.53, 0.6])
@pytest.mark.parametrize("kind", BEAMS)
def test_a_mass_between_nodes_presses_on_what_is_before_it(kind: str, share: float) -> None:
    """q of the beam is small beside it: m a = pi^2 / 4 EI / (share L)^2, to 2 % within one of eight elements."""
    mass = PointMass(name="load", on=share * LENGTH, mass=1e4 * RHO_A * LENGTH)
    found = factors(held(BEAMS[kind](), (mass,)), {"axial uniform": 1.0})
    assert found * mass.mass == pytest.approx(np.pi**2 / 4.0 * EI / (share * LENGTH) ** 2, rel=0.02)


def test_a_column_buckles_first_where_it_is_softer() -> None:
    softer, stiffer = factors(held(spatial(ratio=1.7)), {"axial tip": -1.0}, 2)
    assert stiffer / softer == pytest.approx(1.7, rel=1e-6)


@pytest.mark.parametrize("shear", [False, True])
def test_a_bar_in_space_twists_under_its_end_load(shear: bool) -> None:
    """Wagner: N = G J A / (I_y + I_z) however long it is, for a section that is soft in torsion."""
    section = BeamSection(area=1e-2, second_moment_y=1e-4, second_moment_z=2e-4, torsion_constant=1e-9,
                          shear_area_y=5e-3, shear_area_z=5e-3)  # fmt: skip
    full = held(Beam3D(Beam3DBody(length=3.0, section=section, shear=shear, elements=4)))
    expected = STEEL.shear_modulus * 1e-9 * 1e-2 / 3e-4
    assert factors(full, {"axial tip": -1.0}) == pytest.approx(expected, rel=1e-9)


def test_shear_softens_a_column_as_engesser_says() -> None:
    """P = P_E / (1 + P_E / (kappa G A)), nodal rotations or not."""
    section = BeamSection(area=1e-2, second_moment_y=1e-5, second_moment_z=1e-4, torsion_constant=1e-5,
                          shear_area_y=1e-4, shear_area_z=1e-5)  # fmt: skip
    full = held(Beam3D(Beam3DBody(length=2.0, section=section, shear=True, elements=32)))
    euler, kGA = np.pi**2 / 4.0 * STEEL.young * 1e-5 / 2.0**2, STEEL.shear_modulus * 1e-5
    assert factors(full, {"axial tip": -1.0}) == pytest.approx(euler / (1.0 + euler / kGA), rel=1e-3)


@pytest.mark.parametrize("kind", BEAMS)
def test_a_column_of_two_halves(kind: str) -> None:
    """2.0672 EI / L^2, the outer half with half the stiffness: two bodies, one on the end of the other."""
    make = BEAMS[kind]
    directions = [d for d in make().directions if d != "rx"]
    inner, outer = make(LENGTH / 2.0), make(LENGTH / 2.0, EI / 2.0)
    at = {"tail": "tail", "tip": "tip"}

    def half(model: StructuralModel, end: str, clamped: bool) -> FullModel:
        ends = Pads(ends=tuple(Support(f"end {d}", at[end], d) for d in directions))
        clamps = (Clamp("tail", model.directions if clamped else ("rx",)),)
        return structural_model(Structure(model, clamps, pads=ends, matrices=("axial tip",)))

    models = {"inner": half(inner, "tip", True), "outer": half(outer, "tail", False)}
    contacts = tuple(Contact(d, Place("outer", f"end {d}", 0.0), Place("inner", f"end {d}", 0.0)) for d in directions)
    system = FullSystem(models, contacts).gather()
    found = None
    if system is not None:
        assembly = with_terms(system)
        pressed = {term.name: -1.0 for term in assembly.system.terms}
        found = buckling_factors(assembly, np.zeros(2 * len(directions)), pressed)
    found = MPI.COMM_WORLD.bcast(found)
    assert found == pytest.approx(2.0672 * EI / LENGTH**2, rel=1e-4)


def test_nothing_buckles_under_tension_and_what_is_loose_is_refused() -> None:
    assert factors(held(planar()), {"axial tip": 1.0}, 2).tolist() == [np.inf, np.inf]
    assert factors(held(planar()), {"axial tip": 0.0}).tolist() == [np.inf]
    loose = FullSystem.of(structural_model(Structure(planar(), matrices=("axial tip",)))).gather()
    if loose is not None:
        with pytest.raises(InputError, match="contacts that hold the bodies"):
            alone(loose, {"axial tip": -1.0})
        with pytest.raises(InputError, match="'weight'.*axial tip"):
            alone(loose, {"weight": -1.0})


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.parametrize("kind", BEAMS)
def test_a_reduced_column_buckles_as_the_full_one(kind: str) -> None:
    """Its foot is held by contacts, one of which gives way: on free modes, with what these leave out."""
    model = BEAMS[kind]()
    stiffness = 0.3 * EI / LENGTH
    ends = [Support(f"end {d}", "tail", d, stiffness if d == "ry" else np.inf) for d in model.directions if d != "rx"]
    loads = tuple(Action(d, "tip", d) for d in model.directions)
    names = (*AXIAL, *CARRIED, *ROTATING)
    clamps = (Clamp("tail", ("rx",)),)
    full = structural_model(Structure(model, clamps, loads=loads, pads=Pads(ends=tuple(ends)), matrices=names))
    body = FreeBody(full, "dense")
    basis = modal_basis(free_modes(full, 24 if kind == "beam3d" else 10, "dense", body=body))
    reduced: SlidingBody = section_model(body, basis, {}, basis.size)
    assert set(reduced.matrices) == set(full.matrices)
    for load in ({"axial tip": -1.0}, {"axial uniform": 1.0}, {"axial linear": 1.0}):
        expected = factors(full, load)
        assert alone(System.of(reduced), load) == pytest.approx(expected, rel=1e-3)
        assert expected < 0.5 * factors(held(model), load)


def turning(full: FullModel, speed: float) -> np.ndarray:
    """omega of the free vibrations of a beam that turns about z at a speed in rad/s: gyroscopic forces left out."""
    M, K = gathered(full.M), gathered(full.K)
    A = {name: gathered(matrix) for name, matrix in full.matrices.items()}
    K = K + speed**2 * (A["carried zz"] - M) - speed**2 * A["axial linear"]
    return np.sqrt(scipy.linalg.eigh(K, M, eigvals_only=True))


@pytest.mark.parametrize("eta", ROTATING_CANTILEVER)
def test_a_rotating_cantilever_flaps_at_the_published_frequencies(eta: int) -> None:
    """Across the plane of rotation; within it omega^2 is less by the square of the speed."""
    unit = np.sqrt(EI / RHO_A) / LENGTH**2
    names = ("carried zz", "axial linear")
    flap = turning(held(planar(), names=names), eta * unit) / unit
    assert flap[0] == pytest.approx(ROTATING_CANTILEVER[eta], rel=1e-4)
    both = turning(held(spatial(), names=names), eta * unit) / unit
    lag = np.sqrt(flap[:2] ** 2 - eta**2)
    bending = np.sort(np.concatenate([flap[:2], lag]))
    assert [both[np.argmin(np.abs(both - one))] for one in bending] == pytest.approx(bending, rel=1e-9)
    if eta == 12:
        assert flap[1] == pytest.approx(SECOND_AT_12, rel=2e-4)


def test_a_beam_that_is_spun_up() -> None:
    """Simo, Vu-Quoc (J. Appl. Mech. 53, 1986): the tip lags by 0.5744 m, then rests, 5.143e-4 m farther out.

    Within the plane the small motion feels the centrifugal force by -omega^2 M, and by the axial force's stiffness.
    """
    length, own, duration, speed = 10.0, 1.2, 15.0, 6.0
    body = Profile(length=length, bending_stiffness=1.4e4, mass_per_length=own, axial=True, axial_stiffness=2.8e7)
    names, fields = ("rotating y", "carried yy", "axial linear"), ("xx", "zx")
    loads = tuple(Inertia(field) for field in fields)
    model = Beam2D(body, np.linspace(0.0, length, 9))
    full = structural_model(Structure(model, (Clamp("tail", model.directions),), loads=loads, matrices=names))
    M, K, B = gathered(full.M), gathered(full.K), gathered(full.B)
    T, G = gathered(full.matrices["rotating y"]), gathered(full.matrices["axial linear"])
    assert "carried yy" not in full.matrices  # it has no motion along the axis of rotation
    h, q = 0.01, np.zeros(len(M))
    v, a, tip, out = np.zeros_like(q), np.zeros_like(q), [], []
    for t in h * np.arange(1, 2001):
        phase = 2.0 * np.pi * min(t, duration) / duration
        omega = speed * (phase - np.sin(phase)) / (2.0 * np.pi)
        alpha = speed / duration * (1.0 - np.cos(phase))
        # about y: the field of acceleration is alpha (z, 0, -x) - omega^2 (x, 0, z), the load minus that
        force = B @ [omega**2, alpha]
        D, S = 2.0 * omega * T, K + alpha * T - omega**2 * M - omega**2 * G
        predicted, rate = q + h * v + h**2 / 4.0 * a, v + h / 2.0 * a
        a = np.linalg.solve(M + h / 2.0 * D + h**2 / 4.0 * S, force - D @ rate - S @ predicted)
        q, v = predicted + h**2 / 4.0 * a, rate + h / 2.0 * a
        out.append(q[-3])
        tip.append(q[-2])
    lag = np.abs(tip)
    assert lag.max() == pytest.approx(0.5744, rel=2e-3)
    assert h * (1 + lag.argmax()) == pytest.approx(6.76, abs=0.03)
    assert lag[1600:].max() < 5e-3  # without the axial force's stiffness it would grow for ever
    assert np.mean(out[1600:]) == pytest.approx(5.143e-4, rel=2e-3)


def strip(width: float, length: float, along: int) -> Shell:
    """A thin strip of 5 mm that stands on its lower end, flat across z."""
    mesh = mapped((along, 1), lambda u, v: np.stack([length * u, width * (v - 0.5), 0 * u], axis=1))
    mesh = dataclasses.replace(mesh, groups={**mesh.groups, "tail": mesh.groups["u0"], "tip": mesh.groups["u1"]})
    return Shell(ShellBody(plate=Plate(thickness=5e-3, material=Material(poisson=0.0))), mesh)


def test_the_inertia_of_a_tensor_is_that_of_its_form() -> None:
    """A tensor of nine different entries is assembled at once, beside the sum over single entries and transposes."""
    moving, S = FrameAssembler(strip(0.2, 1.0, 2), (), MPI.COMM_WORLD), np.arange(1.0, 10.0).reshape(3, 3)
    tensor, form = moving._inertia_form
    tensor.value = S
    at_once, summed = gathered(moving._assembler.assemble_form(form)), gathered(moving.inertia(S))
    np.testing.assert_allclose(summed, at_once, rtol=0.0, atol=1e-14 * np.abs(at_once).max())
    assert np.abs(at_once - at_once.T).max() > 0.1 * np.abs(at_once).max()


@pytest.mark.slow
@pytest.mark.numerical
def test_a_thin_strip_buckles_as_a_column() -> None:
    length, width = 1.0, 0.05
    full, EI_strip = held(strip(width, length, 10)), STEEL.young * width * 5e-3**3 / 12.0
    assert factors(full, {"axial tip": -1.0}) == pytest.approx(np.pi**2 / 4.0 * EI_strip / length**2, rel=1e-2)
    weight = factors(full, {"axial uniform": 1.0}) * STEEL.density * width * 5e-3 * length
    assert weight == pytest.approx(7.8373 * EI_strip / length**2, rel=1e-2)


@pytest.mark.parametrize("direction", "yz")
def test_a_high_beam_tips_over_sideways(direction: str) -> None:
    """Under a force at its end that bends it the stiff way: 4.0126 sqrt(EI GJ) / L^2, of either sign."""
    stiff, soft, J = 1e-2, 1e-6, 2e-6
    own = {"second_moment_y": stiff, "second_moment_z": soft}
    section = BeamSection(
        area=1e-2, torsion_constant=J, **own if direction == "z" else dict(zip(own, (soft, stiff), strict=True))
    )
    full = held(Beam3D(Beam3DBody(length=3.0, section=section, shear=False, elements=32)), names=tuple(BENDING))
    expected = 4.0126 * np.sqrt(STEEL.young * soft * STEEL.shear_modulus * J) / 3.0**2
    for sign in (-1.0, 1.0):
        assert factors(full, {f"bending tip {direction}": sign}) == pytest.approx(expected, rel=1e-3)
    # under its own weight: q L^3 = 12.85 sqrt(EI GJ), Timoshenko and Gere, section 6.3
    weight = factors(full, {f"bending uniform {direction}": 1.0}) * STEEL.density * 1e-2
    assert weight == pytest.approx(12.85 * np.sqrt(STEEL.young * soft * STEEL.shear_modulus * J) / 3.0**3, rel=1e-3)


@pytest.mark.slow
@pytest.mark.numerical
def test_a_thin_strip_tips_over_sideways() -> None:
    """As a beam in space with its properties, under a force and under its own weight."""
    length, width, t = 10.0, 0.25, 5e-3  # thin, for no shell knows how the edges soften torsion
    shell = held(strip(width, length, 40), names=tuple(BENDING))
    section = BeamSection(
        area=width * t, second_moment_y=width * t**3 / 12.0, second_moment_z=width**3 * t / 12.0,
        torsion_constant=width * t**3 / 3.0 * (1.0 - 0.63 * t / width),
    )  # fmt: skip
    body = Beam3DBody(length=length, section=section, shear=False, elements=40, material=Material(poisson=0.0))
    beam = held(Beam3D(body), names=tuple(BENDING))
    for name in ("bending tip y", "bending uniform y"):
        assert factors(shell, {name: 1.0}) == pytest.approx(factors(beam, {name: 1.0}), rel=1e-2)


@pytest.mark.slow
@pytest.mark.numerical
def test_a_box_of_shells_or_as_a_beam_buckles_alike() -> None:
    """Under an end load, its own weight and that of what it carries."""
    length, wall = 8.0, 0.008
    masses = (PointMass(name="load", on="tip", mass=300.0),)
    shell = held(Shell(ShellBody(plate=Plate(thickness=wall)), box(length, 12, 2)), masses)
    profile = BoxProfile(width=WIDTH, height=HEIGHT, wall=wall)
    beam = held(Beam3D(Beam3DBody(length=length, profile=profile, shear=True, elements=12)), masses)
    for loads in ({"axial tip": -1.0}, {"axial uniform": 1.0}, {"axial linear": 1.0}):
        assert factors(shell, loads) == pytest.approx(factors(beam, loads), rel=1e-2)


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.parametrize("kind", ["hexahedron", "tetrahedron"])
def test_a_solid_bar_buckles_as_a_column(kind: str) -> None:
    length, width, depth = 2.0, 0.1, 0.05
    material = Material(poisson=0.0)
    full = held(Solid(SolidBody(material=material), block(kind, (20, 2, 1), (length, width, depth))))
    expected = np.pi**2 / 4.0 * STEEL.young * width * depth**3 / 12.0 / length**2
    assert factors(full, {"axial tip": -1.0}) == pytest.approx(expected, rel=1e-2)
