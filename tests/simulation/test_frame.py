"""Amplitudes of the loads of a frame that moves, beside positions in space differentiated twice."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pmr import scene as scenes
from pmr.files.arrays import Array
from pmr.scene import Scene
from pmr.simulation import Excitation
from pmr.simulation.frame import section_acceleration

THREE = "boom_three"
TURNING = (
    "frame.pivot=[0.3, -0.2, 0.5]",
    "frame.luffing={kind='smooth_ramp', times=[1.0, 5.0], values=[0.2, 1.1]}",
    "frame.slewing={kind='sine', amplitude=0.8, frequency=0.1}",
    "section.body.model=beam3d",
    "sections.fly.joint.extension={kind='smooth_ramp', times=[0.0, 6.0], values=[0.6, 4.0]}",
    "section.joint.tail.0.faces={bottom=[-0.05, 0.05], top=[-0.05, 0.05], left=[0.0], right=[0.0]}",
    "section.joint.mouth.0.faces={bottom=[-0.05, 0.05], top=[-0.05, 0.05], left=[0.0], right=[0.0]}",
)


def in_space(scene: Scene, number: int, r: Array, t: float) -> tuple[Array, Array]:
    """Where a point r of a section is, and the axes of the boom as columns, at the time t."""
    assert scene.frame is not None
    phi, psi = (float(angle.value(t)) for angle in scene.frame.angles)
    level = np.array([[np.cos(phi), 0.0, -np.sin(phi)], [0.0, 1.0, 0.0], [np.sin(phi), 0.0, np.cos(phi)]])
    turned = np.array([[np.cos(psi), -np.sin(psi), 0.0], [np.sin(psi), np.cos(psi), 0.0], [0.0, 0.0, 1.0]])
    axes, away = turned @ level, np.zeros(3)
    if (base := scene.frame.base) is not None:
        away += [float(base.motions[axis].value(t)) if axis in base.motions else 0.0 for axis in "xyz"]
        rocked = [float(base.motions[axis].value(t)) if axis in base.motions else 0.0 for axis in ("rz", "ry", "rx")]
        axes = Rotation.from_euler("ZYX", rocked).as_matrix() @ axes
    X = sum(float(scene.extension(k).value(t)) for k in range(1, number + 1))
    return away + axes @ (np.array(scene.frame.tail_position) + r + [X, 0.0, 0.0]), axes


def swung(amplitude: float, frequency: float, phase: float) -> str:
    return f"{{kind='sine', amplitude={amplitude}, frequency={frequency}, phase={phase}}}"


#: A ship in a seaway.
ROCKED = tuple(
    f"frame.base.{key}={swung(amplitude, frequency, phase)}"
    for key, amplitude, frequency, phase in (
        ("x", 0.5, 0.11, 0.2), ("y", 0.7, 0.13, 1.0), ("z", 0.9, 0.17, 2.0),
        ("rx", 0.3, 0.15, 0.4), ("ry", 0.2, 0.12, 1.3), ("rz", 0.25, 0.09, 2.2),
    )
)  # fmt: skip
MOVED = {"on a base that stays": TURNING, "on a ship": (*TURNING, *ROCKED)}


@pytest.mark.parametrize("t", [0.7, 2.3, 3.9])
@pytest.mark.parametrize("changes", MOVED.values(), ids=MOVED)
def test_the_field_is_the_acceleration_in_space_with_gravity(changes: tuple[str, ...], t: float) -> None:
    scene, r, h = scenes.load_any(THREE, changes), np.array([2.0, 0.3, -0.4]), 1e-3
    assert scene.gravity is not None
    for number in range(3):
        before, at, after = (in_space(scene, number, r, t + shift)[0] for shift in (-h, 0.0, h))
        axes = in_space(scene, number, r, t)[1]
        expected = axes.T @ ((before - 2.0 * at + after) / h**2 + [0.0, 0.0, scene.gravity.acceleration])
        a = np.array([section_acceleration(scene, number, j).value(t) for j in "xyz"])
        A = np.array([[section_acceleration(scene, number, j + k).value(t) for k in "xyz"] for j in "xyz"])
        # differences of positions of 10 m: 16 u |r| / h^2 = 4e-8 m/s^2, their error h^2 r'''' / 12 of about 1e-6
        assert a + A @ r == pytest.approx(expected, abs=2e-6)


def test_a_body_in_a_frame_has_no_weight_beside_its_inertia() -> None:
    scene = scenes.load_any(THREE, TURNING)
    loads = Excitation.from_scene(scene).loads
    assert not {"base.gravity", "middle.extension"} & set(loads)
    assert {f"fly.inertia {jk}" for jk in ("x", "y", "z", "xx", "yx", "zx", "yz", "zy")} <= set(loads)


def test_gravity_of_a_frame_at_rest_is_gravity_along_that_direction() -> None:
    at_rest = Excitation.from_scene(
        scenes.load_any(THREE, ["frame.pivot=[0.0, 0.0, 0.0]", f"frame.luffing={np.pi / 2.0}"])
    )
    given = Excitation.from_scene(scenes.load_any(THREE, ["gravity.inclination=90.0"]))
    t = np.linspace(0.0, 8.0, 33)
    for name in ("base", "middle", "fly"):
        turned = {field: at_rest.loads[f"{name}.inertia {field}"].value(t) for field in ("x", "z", "xx", "zx")}
        weight = -given.loads[f"{name}.gravity"].value(t)
        driven = given.loads[f"{name}.extension"].value(t) if name != "base" else 0.0
        expected = {"x": weight - driven, "z": np.zeros(33), "xx": np.zeros(33), "zx": np.zeros(33)}
        for field, values in turned.items():
            assert values == pytest.approx(expected[field], abs=1e-12)


@pytest.mark.parametrize("changes", MOVED.values(), ids=MOVED)
def test_terms_of_second_order_are_those_of_the_field_s_gradient(changes: tuple[str, ...]) -> None:
    scene = scenes.load_any(THREE, [*changes, "frame.second_order=true"])
    terms, t = Excitation.from_scene(scene).terms, np.array([0.7, 2.3, 3.9])
    A = np.array([[section_acceleration(scene, 0, j + k).value(t) for k in "xyz"] for j in "xyz"])
    found = np.zeros_like(A)
    for j, k in ("xx", "yy", "zz", "xy", "xz", "yz"):
        a, b = "xyz".index(j), "xyz".index(k)
        half = terms[f"fly: carried {j}{k}"].value(t) / 2.0
        found[a, b] += half
        found[b, a] += half
    for k, axis in enumerate("xyz"):
        found += np.cross(np.eye(3)[k], np.eye(3)).T[:, :, None] * terms[f"fly: turning {axis}"].value(t)
    assert found == pytest.approx(A, abs=1e-14)
    velocity = np.array([terms[f"fly: rotating {axis}"].value(t) / 2.0 for axis in "xyz"])
    assert np.einsum("kt,kt->t", velocity, velocity) == pytest.approx(-np.einsum("jjt->t", A) / 2.0)


def test_a_cylinder_pushes_all_that_it_carries() -> None:
    scene = scenes.load_any(THREE, [*TURNING, "frame.second_order=true"])
    terms, t = Excitation.from_scene(scene).terms, np.array([0.7, 2.3, 3.9])
    for name, beyond in (("middle", ("middle", "fly")), ("fly", ("fly",))):
        for carried in beyond:
            acceleration = section_acceleration(scene, scene.names.index(carried), "x").value(t)
            length = scene.paths[name].value(t)
            term = terms[f"cylinder of {name} that carries {carried}, x"]
            assert term.value(t) == pytest.approx(-acceleration / length)
    assert not Excitation.from_scene(scenes.load_any(THREE, TURNING)).terms
