"""The cylinder that raises a boom, beside statics and the power that a rise takes."""

import numpy as np
import pytest
import turning_cylinder
from turning_cylinder import Rigid, boom

import pmr
from pmr import InputError
from pmr.compare.drives import turning_warnings
from pmr.compare.forces import limits_part
from pmr.scene import Scene
from pmr.scene.checks import check_scene
from pmr.scene.cylinder import LuffingCylinder
from pmr.scene.mechanism import CYLINDER
from pmr.simulation.statics.postures import with_hook
from pmr.studies.chart_models import compute_postures
from pmr.studies.tasks import scene_arguments

G, LENGTH, MASS = 9.80665, 6.0, 250.0
FOOT, LUG = [0.5, -1.0], [1.5, -0.2]


def raised(luffing: dict[str, object], foot: list[float] = FOOT, lug: list[float] = LUG) -> Scene:
    """A stiff planar box that hardly weighs anything itself, with a mass at its tip."""
    return Scene.model_validate(
        {
            "title": "raised",
            "gravity": {},
            "start": "equilibrium",
            "frame": {"pivot": [0.0, 0.0, 0.0], "luffing": luffing, "cylinder": {"foot": foot, "lug": lug}},
            "sections": [
                {
                    "name": "boom",
                    "body": {
                        "model": "beam2d",
                        "box": {"length": LENGTH, "width": 0.3, "height": 0.4, "wall": 0.008},
                        "material": {"young": 2.1e15, "density": 1e-3},
                    },
                    "mesh": {"elements": 8},
                    "supports": [{"on": "tail", "kind": "clamped"}],
                    "pads": [{"name": "none", "moving": True, "faces": {"top": [0.0]}, "stiffness": 1e-3}],
                    "masses": [{"name": "hook", "on": "tip", "mass": MASS}],
                    "slider": {"path": {"kind": "constant", "amount": 3.0}},
                    "reduction": {"coordinates": 4},
                }
            ],
            "time": {"end": 2.0, "step": 2e-3},
            "compare": {"against": []},
        }
    )


def simulated(scene: Scene) -> tuple[pmr.Response, np.ndarray]:
    found = pmr.simulate(scene, pmr.reduce(scene).reduced)
    return found, found.other(CYLINDER)


@pytest.mark.parametrize("angle", [-0.2, 0.3, 1.2])
def test_it_carries_the_moment_with_its_arm_about_the_pivot(angle: float) -> None:
    """The arm is the height of the triangle of pivot, foot and lug over the cylinder."""
    scene = raised({"kind": "constant", "amount": angle})
    lug = np.hypot(*LUG) * np.array([np.cos(beta := angle + np.arctan2(LUG[1], LUG[0])), np.sin(beta)])
    twice_the_area = FOOT[0] * lug[1] - FOOT[1] * lug[0]
    arm = twice_the_area / np.linalg.norm(lug - FOOT)
    _, force = simulated(scene)
    # the boom weighs 1e-5 of the mass, and deflects by less
    assert force == pytest.approx(MASS * G * LENGTH * np.cos(angle) / arm, rel=1e-4)


def test_its_work_raises_the_mass() -> None:
    scene = raised({"kind": "smooth_ramp", "times": [0.2, 1.8], "values": [0.1, 1.0]})
    found, force = simulated(scene)
    length, arm = scene.frame.cylinder.length_and_arm(scene.frame.angles[0].value(found.t))
    power = force * arm * scene.frame.angles[0].rate(found.t)
    work = np.sum(power[1:] + power[:-1]) * scene.time.step / 2.0
    assert work == pytest.approx(MASS * G * LENGTH * (np.sin(1.0) - np.sin(0.1)), rel=1e-4)
    assert work == pytest.approx(np.sum((force[1:] + force[:-1]) / 2.0 * np.diff(length)), rel=1e-5)


def test_its_arm_is_what_the_length_grows_by() -> None:
    one, angle, h = LuffingCylinder(foot=(0.5, -1.0), lug=(1.5, -0.2)), np.linspace(-0.5, 1.4, 7), 1e-4
    grown = (one.length_and_arm(angle + h)[0] - one.length_and_arm(angle - h)[0]) / (2.0 * h)
    assert one.length_and_arm(angle)[1] == pytest.approx(grown, rel=1e-7)


def test_a_support_in_its_place_has_a_warning_where_the_arm_changes() -> None:
    """Arms of the triangle of pivot, foot and lug at both angles; none where the cylinder itself gives way.

    At any angle but a right one the cylinder presses along the boom, as a support across it does not.
    """
    plain = boom(30.0, "beam2d", 1e7).model_dump(mode="json")
    turning = Scene.model_validate(plain)
    plain["frame"]["cylinder"]["stiffness"] = None
    plain["sections"][0]["supports"] += [{"name": "luff", "on": 1.5, "directions": ["z"], "stiffness": 1e7}]
    angles = np.deg2rad([10.0, 60.0])
    low, high = sorted(Rigid(angle).arm for angle in angles.tolist())
    (line,) = turning_warnings(Scene.model_validate(plain), angles)
    assert "'luff'" in line and f"by a factor of {(high / low) ** 2:.2g}:" in line
    assert turning_warnings(turning, angles) == []
    (line,) = turning_warnings(Scene.model_validate(plain), angles[:1])
    cylinder = (turning_cylinder.LUG * np.exp(1j * angles[0]) - turning_cylinder.FOOT) * np.exp(
        -1j * angles[0]
    )  # m, in axes of the boom
    assert (
        f"'luff' lacks the cylinder's force along the boom, up to {abs(cylinder.real / cylinder.imag):.2g} times"
        in line
    )
    plain["frame"]["cylinder"]["foot"] = [1.5, -1.5]  # below the lug
    plain["frame"]["cylinder"]["lug"] = [1.5, -0.3]
    assert turning_warnings(Scene.model_validate(plain), np.zeros(1)) == []


@pytest.mark.slow
@pytest.mark.parametrize(("end", "warns"), [(1e-3, False), (-1e-3, True)])
def test_angles_that_the_cylinder_can_not_reach_have_a_warning_in_runs_and_charts(end: float, warns: bool) -> None:
    """The stroke ends 1 mm beyond the length at the greatest angle, or 1 mm before it."""
    plain = boom(30.0, "beam2d", 1e7).model_dump(mode="json")
    longest = abs(turning_cylinder.LUG * np.exp(1j * np.deg2rad(60.0)) - turning_cylinder.FOOT)
    plain["frame"]["cylinder"]["stroke"] = [1.0, longest + end]
    plain["frame"]["luffing"] = {"kind": "smooth_ramp", "times": [0.0, 0.02], "values": [10.0, 60.0]}
    scene = Scene.model_validate(plain)
    system = pmr.reduce(scene).system
    in_run = limits_part(scene, system, pmr.simulate(scene, system))
    at = {"extensions": {name: [1.0] for name in scene.names[1:]}, "luffing": [np.deg2rad(60.0)], "slewing": [0.0]}
    task = scene_arguments(with_hook(scene)) | {"up_to": 1e3, "error": False, "at": at}
    for warnings in (in_run.grave, compute_postures(task, {}).warnings):
        assert [f"stroke is 1 to {longest + end:g} m" in line for line in warnings if "stroke" in line] == [
            True
        ] * warns


def share_along(angle: float) -> float:
    """Force of the cylinder along the boom over that across it, with the angle in rad."""
    cylinder = (turning_cylinder.LUG * np.exp(1j * angle) - turning_cylinder.FOOT) * np.exp(-1j * angle)
    return float(abs(cylinder.real / cylinder.imag))


def test_a_rigid_support_in_its_place_lacks_its_force_along_the_boom_but_does_not_give_way() -> None:
    plain = boom(30.0, "beam2d", 1e7).model_dump(mode="json")
    plain["frame"]["cylinder"]["stiffness"] = None
    plain["sections"][0]["supports"] += [{"name": "luff", "on": 1.5, "directions": ["z"]}]
    angles = np.deg2rad([10.0, 60.0])
    (line,) = turning_warnings(Scene.model_validate(plain), angles)
    share = max(map(share_along, angles.tolist()))
    assert f"'luff' lacks the cylinder's force along the boom, up to {share:.2g} times" in line
    assert "factor" not in line and "frame.cylinder.stiffness, in place of the support" in line


def test_a_support_across_the_boom_that_is_not_at_the_lug_has_a_warning() -> None:
    """Not so a support at the pivot, or one that is no support across the boom alone."""
    plain = boom(30.0, "beam2d", 1e7).model_dump(mode="json")
    supports = plain["sections"][0]["supports"]
    supports += [{"name": "luff", "on": 2.0, "directions": ["z"]}, {"name": "foot", "on": "tail", "directions": ["z"]}]
    supports += [{"name": "brace", "on": 2.5, "kind": "clamped", "stiffness": 1e3}]
    assert turning_warnings(Scene.model_validate(plain), np.zeros(1)) == []  # the cylinder's own stiffness holds
    plain["frame"]["cylinder"]["stiffness"] = None
    line, thrust = turning_warnings(Scene.model_validate(plain), np.zeros(1))
    assert "'luff' is at 2 m from the tail, the luffing cylinder's lug at 1.5 m" in line
    assert "forces lack the luffing cylinder's thrust" in thrust


@pytest.mark.parametrize(("foot", "lug"), [([-1.0, 0.0], [1.0, 0.0]), ([0.5, -1.0], [0.0, 0.0])])
def test_a_cylinder_in_line_with_the_pivot_is_refused(foot: list[float], lug: list[float]) -> None:
    with pytest.raises(InputError, match=r"frame\.cylinder.*an arm about the pivot"):
        check_scene(raised({"kind": "constant", "amount": 0.0}, foot, lug))


@pytest.mark.parametrize("at", [1.5, 2.0])
def test_a_pin_off_the_pivot_bears_the_thrust_of_the_cylinder(at: float) -> None:
    """The hinge is 0.3 m behind the tail and 0.1 m below: forces by hand, of a rigid boom that turns about the hinge.

    The cylinder carries the moment of all weights about the hinge, and the pin the rest, wherever a support stands for
    the cylinder.
    """
    angle, ahead, below = np.deg2rad(30.0), 0.3, 0.1
    plain = boom(30.0, "beam2d", 1e7).model_dump(mode="json")
    plain["frame"]["pivot"] = [ahead, 0.0, below]
    plain["frame"]["cylinder"] |= {"stiffness": None, "lug": [1.5 + ahead, -0.3]}
    plain["sections"][0]["supports"] += [{"name": "luff", "on": at, "directions": ["z"]}]
    scene = Scene.model_validate(plain)
    response = pmr.simulate(scene, pmr.reduce(scene).reduced)
    turned = np.exp(1j * angle)
    arms = [complex(ahead + tail + length, below) * turned for tail, length in ((0.0, 3.0), (4.0, 3.0), (4.0, 6.0))]
    weights = [
        *(G * 7850.0 * 2.0 * wall * (b + h) * 6.0 for b, h, wall in turning_cylinder.BOXES),
        turning_cylinder.PULL,
    ]
    lug, foot = complex(1.5 + ahead, -0.3) * turned, turning_cylinder.FOOT
    along = (lug - foot) / abs(lug - foot)
    force = sum(w * arm.real for w, arm in zip(weights, arms, strict=True)) / (foot.conjugate() * along).imag
    pin = (force * along - 1j * sum(weights)) / turned
    assert response.other(CYLINDER)[0] == pytest.approx(force, rel=1e-5)
    assert response.other("reaction of s0: pin x")[0] == pytest.approx(pin.real, rel=1e-5)
    assert response.other("reaction of s0: pin z")[0] == pytest.approx(pin.imag, rel=1e-5)
    warnings = turning_warnings(scene, np.array([angle]))
    assert any("the pin of 's0' is 0.3 m ahead of the pivot and 0.1 m above it" in line for line in warnings)
    assert (at == 1.5) == any(line.endswith("turns with the boom, with the pin at the pivot") for line in warnings)


def test_a_pin_off_the_pivot_is_refused_beside_a_stiffness() -> None:
    plain = boom(30.0, "beam2d", 1e7).model_dump(mode="json")
    plain["frame"]["pivot"] = [0.0, 0.0, 0.05]
    with pytest.raises(InputError, match=r"supports\[0\]\.on.*this one is 0 m ahead of the pivot and 0\.05 m above"):
        check_scene(Scene.model_validate(plain))
