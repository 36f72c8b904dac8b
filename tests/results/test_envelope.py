"""Section forces as rows on coordinates, and envelopes of histories."""

import numpy as np
import pytest

from pmr.models.beam2d import Beam2D
from pmr.models.beam3d import Beam3D
from pmr.results.field_stress import FORCES, RunningEnvelope
from pmr.scene.structures import Beam3DBody, BoxProfile, Profile

LENGTH, BOX = 3.0, BoxProfile(width=0.2, height=0.3, wall=0.01)
PULL, SIDE, UP, TWIST = 500.0, 70.0, -30.0, 12.0


def cantilever() -> tuple[Beam3D, np.ndarray]:
    """A beam with shear under a force and a torque at its tip, clamped at its tail: exact at nodes."""
    model = Beam3D(Beam3DBody(length=LENGTH, profile=BOX, shear=True, elements=4))
    x, section, material = model.node_stations, model.section, model.body.material
    E, G = material.young, material.shear_modulus
    q = np.zeros((len(x), 6))
    q[:, 0], q[:, 3] = PULL * x / (E * section.area), TWIST * x / (G * section.torsion_constant)
    for force, of, turn, sign, I, area in (
        (SIDE, 1, 5, 1.0, section.second_moment_z, section.shear_area_y),
        (UP, 2, 4, -1.0, section.second_moment_y, section.shear_area_z),
    ):
        q[:, of] = force * (x**2 * (3.0 * LENGTH - x) / (6.0 * E * I) + x / (G * area))
        q[:, turn] = sign * force * x * (2.0 * LENGTH - x) / (2.0 * E * I)
    return model, q.ravel()


def test_section_forces_of_a_cantilever_are_those_of_statics() -> None:
    model, q = cantilever()
    found = model.section_forces()
    assert set(found.names) == set(FORCES)
    beyond = LENGTH - found.x
    known = {
        "normal force": PULL, "shear force y": SIDE, "shear force z": UP, "torque": TWIST,
        "bending moment y": -UP * beyond, "bending moment z": SIDE * beyond,
    }  # fmt: skip
    expected = np.array([np.broadcast_to(known[name], found.x.shape)[k] for k, name in enumerate(found.names)])
    assert found.rows @ q == pytest.approx(expected, rel=1e-8, abs=1e-6)


def test_moments_make_the_stress_in_the_corners() -> None:
    r"""Navier's sigma = N / A + M_y z / I_y - M_z y / I_z."""
    model, q = cantilever()
    forces, stresses, section = model.section_forces(), model.stresses(), model.section
    assert stresses is not None
    values = forces.rows @ q
    at = {
        name: {x: values[k] for k, x in enumerate(forces.x) if forces.names[k] == name}
        for name in ("normal force", "bending moment y", "bending moment z")
    }
    axial = stresses.evaluate(q[None])[0, :, 0]
    for (x, y, z), stress in zip(stresses.points, axial, strict=True):
        N, M_y, M_z = (of[x] for of in at.values())
        known = N / section.area + M_y * z / section.second_moment_y - M_z * y / section.second_moment_z
        assert stress == pytest.approx(known, rel=1e-8, abs=1.0)


@pytest.mark.parametrize("axial", [True, False])
def test_a_planar_beam_has_the_forces_of_one_in_space_and_of_a_profile_its_stresses(axial: bool) -> None:
    model, q = cantilever()
    E, section, x = model.body.material.young, model.section, model.node_stations
    EI, EA = E * section.second_moment_y, E * section.area
    known = Profile(length=LENGTH, bending_stiffness=EI, mass_per_length=1.0, axial_stiffness=EA, axial=axial)
    planar = Beam2D(model.body if axial else known, x)
    w, slope = UP * x**2 * (3.0 * LENGTH - x) / (6.0 * EI), UP * x * (2.0 * LENGTH - x) / (2.0 * EI)
    u = [q.reshape(-1, 6)[:, 0]] if axial else []
    found, flat = planar.section_forces(), np.column_stack([*u, w, slope]).ravel()
    forces = {"normal force": PULL, "shear force z": UP, "bending moment y": -UP * (LENGTH - found.x)}
    assert set(found.names) == set(forces) - ({"normal force"} if not axial else set())
    expected = np.array([np.broadcast_to(forces[name], found.x.shape)[k] for k, name in enumerate(found.names)])
    assert found.rows @ flat == pytest.approx(expected, rel=1e-8, abs=1e-6)
    stresses = planar.stresses()
    assert (stresses is not None) is axial
    if stresses is not None:
        z = stresses.points[:, 2]
        navier = PULL / section.area - UP * (LENGTH - stresses.points[:, 0]) * z / section.second_moment_y
        assert stresses.evaluate(flat[None])[0, :, 0] == pytest.approx(navier, rel=1e-8, abs=1.0)
        assert stresses.von_mises(stresses.evaluate(flat[None])) == pytest.approx(
            np.abs(navier)[None], rel=1e-8, abs=1.0
        )


def test_envelopes_have_the_extremes_of_all_blocks_and_when_they_are() -> None:
    """Two quantities, of which one has two values at one place; round-off beside the largest of a unit is zero."""
    names = ("normal force", "normal force", "normal force", "torque", "torque")
    running = RunningEnvelope(names, np.array([0.0, 1.0, 1.0, 0.0, 1.0]))
    running.add(np.array([0.0, 0.1]), np.array([[1.0, 5.0, -2.0, 1e-12, 0.1], [2.0, 4.0, 0.0, 0.5, 0.1]]))
    running.add(np.array([0.2]), np.array([[-3e-12, 4.5, 6.0, 0.2, -0.3]]))
    found = running.envelope(FORCES)
    assert found.names == ("normal force", "torque") and found.units == ("N", "N m")
    assert found.x.tolist() == [0.0, 1.0]
    assert found.least.tolist() == [[0.0, -2.0], [0.0, -0.3]] and found.most.tolist() == [[2.0, 6.0], [0.5, 0.1]]
    assert found.least_at.tolist() == [[0.2, 0.0], [0.0, 0.2]] and found.most_at[0].tolist() == [0.1, 0.2]
    most = found.extremes()["normal force"]
    assert most == {"unit": "N", "min": -2.0, "t_min": 0.0, "x_min": 1.0, "max": 6.0, "t_max": 0.2, "x_max": 1.0}


def test_what_is_round_off_all_the_time_is_zero_from_the_start() -> None:
    """When round-off is largest says nothing; a force that comes down to zero has its time."""
    running = RunningEnvelope(("torque", "torque"), np.array([0.0, 1.0]))
    running.add(np.array([0.1, 0.2]), np.array([[1e-13, 5.0], [-2e-13, 3.0]]))
    running.add(np.array([0.3, 0.4]), np.array([[3e-13, 0.0], [1e-13, 2.0]]))
    found = running.envelope(FORCES)
    assert found.least.tolist() == [[0.0, 0.0]] and found.most.tolist() == [[0.0, 5.0]]
    assert found.least_at.tolist() == [[0.1, 0.3]] and found.most_at.tolist() == [[0.1, 0.1]]
