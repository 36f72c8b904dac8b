"""Friction of a stiff section on two pads, its cylinder elastic, beside statics: sliding, reversal, rest, swinging."""

from collections.abc import Mapping

import numpy as np
import pytest

import pmr
from pmr.fullmodel.build import build_bodies, models_of
from pmr.pipeline.full_order import FullOrder
from pmr.scene import Scene
from pmr.simulation import Excitation, exudyn
from pmr.simulation.native import systems
from pmr.system.from_scene import system_of

G, LENGTH, AT, MU = 9.80665, 6.0, 0.15, 0.2
BOX = {"length": LENGTH, "width": 0.26, "height": 0.36, "wall": 0.007}
#: kg of the section that slides, at its middle; half of its outer height, m.
MASS = 1000.0
ARM = BOX["height"] / 2.0
#: N/m along the boom, of each of both pads; N/m of a cylinder on which the section swings with 5 Hz.
SHEAR, SOFT = 1e8, 1e6


def sliding(
    extension: dict[str, object],
    end: float,
    friction: float = MU,
    step: float = 5e-3,
    cylinder: float = 5e8,
    **keys: object,
) -> Scene:
    """A massless stiff box with a mass at its tip, in a stiff one that is clamped."""
    shear = {"shear_stiffness": SHEAR} if friction else {}
    pads = [{"at": AT, "stiffness": 1e9, "unilateral": False, "friction": friction} | shear]
    stiff = {"young": 2.1e15, "density": 1e-3}
    return Scene.model_validate(
        {
            "title": "sliding",
            "gravity": {},
            "start": "equilibrium",
            "sections": [
                {
                    "name": "base",
                    "body": {"model": "beam2d", "box": BOX | {"width": 0.3, "height": 0.4}, "material": stiff},
                    "mesh": {"elements": 6},
                    "supports": [{"on": "tail", "kind": "clamped"}],
                },
                {
                    "name": "fly",
                    "body": {"model": "beam2d", "box": BOX, "material": stiff},
                    "mesh": {"elements": 6},
                    "masses": [{"name": "payload", "on": "tip", "mass": MASS}],
                    "joint": {"tail": pads, "mouth": pads, "extension": extension, "cylinder": {"stiffness": cylinder}},
                },
            ],
            "time": {"end": end, "step": step, "rho_inf": 0.0},  # what friction sets ringing comes to rest
            "compare": {"against": []},
        }
        | keys
    )


def pressed(s: np.ndarray, way: float, friction: float = MU) -> np.ndarray:
    """Sum of the pads' forces in N: moments about the tail's pad, each force as much nearer to the tail as it rubs."""
    nearer = friction * ARM * way
    tail, mouth, tip = AT - nearer, LENGTH - AT - s - nearer, LENGTH
    on_mouth = MASS * G * (tip - tail) / (mouth - tail)
    return np.abs(on_mouth) + np.abs(on_mouth - MASS * G)


def cylinder(scene: Scene) -> tuple[pmr.Response, np.ndarray]:
    found = pmr.simulate(scene, pmr.reduce(scene).reduced)
    return found, found.force("force of cylinder of fly")


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_steady_sliding_needs_what_all_pads_resist_with(way: float) -> None:
    path = {"kind": "ramp", "times": [0.0, 2.0], "values": [2.0 - 0.2 * way, 2.0 + 0.2 * way]}
    found, force = cylinder(sliding(path, 1.5))
    late = found.t > 1.001
    s = 2.0 + way * 0.2 * (found.t - 1.0)
    expected = way * MU * pressed(s, way)
    assert force[late] == pytest.approx(expected[late], rel=1e-6)


def test_a_cycle_takes_what_friction_dissipates() -> None:
    """The loop of the cylinder's force over the extension, whose sides are closed forms."""
    path = {"kind": "sine", "amplitude": 0.3, "frequency": 0.5, "offset": 2.0}
    found, force = cylinder(sliding(path, 4.0, step=5e-4))  # a step in which it turns counts half
    t, s = found.t, 2.0 + 0.3 * np.sin(np.pi * found.t)
    once = t >= 2.0
    work = np.sum((force[1:] + force[:-1])[once[1:]] / 2.0 * np.diff(s)[once[1:]])
    at = np.linspace(1.7, 2.3, 1001)
    lost = MU * (pressed(at, 1.0) + pressed(at, -1.0))
    area = np.sum((lost[1:] + lost[:-1]) / 2.0 * np.diff(at))
    assert work == pytest.approx(area, rel=1e-3)


def test_at_rest_nothing_slides() -> None:
    found, force = cylinder(sliding({"kind": "constant", "amount": 2.0}, 0.2))
    without, free = cylinder(sliding({"kind": "constant", "amount": 2.0}, 0.2, 0.0))
    assert force == pytest.approx(free, abs=1e-9 * MASS * G)
    assert found.displacement == pytest.approx(without.displacement, abs=1e-12)


@pytest.mark.parametrize(("stiffness", "friction"), [(1e6, 0.3), (2e7, 0.01), (2e9, 0.1)])
def test_at_rest_on_an_incline_the_cylinder_holds_the_weight_along_it(stiffness: float, friction: float) -> None:
    """Round-off alone moves the pads: what it makes of their friction is far below what they could hold."""
    angle, still = np.radians(25.0), {"kind": "constant", "amount": 2.0}
    scene = sliding(still, 0.2, friction, cylinder=stiffness, gravity={"inclination": 25.0})
    found, force = cylinder(scene)
    assert force == pytest.approx(MASS * G * np.sin(angle), rel=1e-5)
    assert np.abs(found.other("friction of fly")).max() < 1e-6 * friction * MASS * G


def test_pads_stick_before_they_slide() -> None:
    """As springs in series with the cylinder; then the section swings about a force that no longer grows."""
    path = {"kind": "smooth_ramp", "times": [0.0, 4.0], "values": [2.0, 2.012]}
    scene = sliding(path, 2.5, cylinder=SOFT)
    found, force = cylinder(scene)
    s, friction = scene.paths["fly"].value(found.t) - 2.0, found.other("friction of fly")
    slips, both = MU * pressed(2.0 + s, 1.0), SOFT * 2.0 * SHEAR / (SOFT + 2.0 * SHEAR)
    sticks = force < 0.4 * slips
    assert sticks.sum() > 100
    assert friction[sticks] == pytest.approx(both * s[sticks], abs=1e-3 * slips[0])
    assert force[sticks] == pytest.approx(friction[sticks], abs=1e-3 * slips[0])
    swings = slice(-40, -5)
    assert friction[swings] == pytest.approx(slips[swings], rel=1e-6) and np.ptp(force[swings]) > 0.05 * slips[0]


def test_a_section_that_swings_on_its_cylinder_comes_to_rest_as_coulomb_has_it() -> None:
    """Each half swing is shorter by 2 F / k, until the cylinder can't move the section; its force stays."""
    path, mu = {"kind": "ramp", "times": [0.0, 0.1], "values": [2.0, 2.04]}, 0.02
    time = {"end": 1.6, "step": 1e-3, "rho_inf": 1.0}
    found, force = cylinder(sliding(path, 1.6, mu, cylinder=SOFT, time=time))
    free = force[found.t > 0.101]
    turns = free[1:-1][np.diff(np.sign(np.diff(free))) != 0.0]
    lost = {way: mu * float(pressed(2.04, way, mu)) for way in (1.0, -1.0)}
    largest, way = turns[0], np.sign(turns[0])  # pressed together, it springs out
    for other in turns[1:12]:
        assert np.sign(other) == -way
        assert abs(largest) - abs(other) == pytest.approx(2.0 * lost[way], rel=2e-3)  # a turn is seen at steps
        largest, way = other, -way
    assert abs(free[-1]) < lost[1.0] and np.ptp(free[-50:]) < 0.05 * lost[1.0]


@pytest.mark.parametrize("slope", [0.15, 0.3])
def test_below_the_friction_angle_a_section_stays_and_above_it_slides(slope: float) -> None:
    """With g (sin - mu cos), or not at all: it is held by friction alone but for a cylinder of 1 kN/m."""
    angle, soft, h = np.arctan(slope), 1e3, 5e-3
    scene = sliding(
        {"kind": "constant", "amount": 2.0},
        1.4,
        cylinder=soft,
        gravity={"inclination": float(np.degrees(angle))},
        start="rest",
    ).model_dump(mode="json", exclude_unset=True)
    scene["sections"][1]["masses"] = []  # its own, in the middle, which presses both pads down
    scene["sections"][1]["body"]["material"]["density"] = 2e4
    found, force = cylinder(Scene.model_validate(scene))
    late, weight = found.t[1:-1] > 1.1, -found.slider_force[-1, :2].sum()  # across the incline, when it is all there
    out = -force / soft
    acceleration = np.diff(out, 2) / h**2 - force[1:-1] * G * np.cos(angle) / weight
    falls = max(0.0, np.sin(angle) - MU * np.cos(angle)) * G
    assert np.all(found.slider_force[-1, :2] < 0.0)
    assert acceleration[late] == pytest.approx(-falls, abs=1e-4)
    print(acceleration[late].mean() + falls, out[-1])
    friction = found.other("friction of fly")[-1]
    assert -friction == pytest.approx(min(slope, MU) * weight, rel=1e-5)
    if slope < MU:  # the tail's pad slides, and the other one holds the rest
        on_tail, on_mouth = np.abs(found.slider_force[-1, :2])
        assert out[-1] == pytest.approx(-(slope * (on_tail + on_mouth) - MU * on_tail) / SHEAR, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("at_rest", [0.0, 1.5 * MU])
def test_both_simulators_of_full_order_rub_alike(at_rest: float) -> None:
    """Swinging on a cylinder, sliding and stuck; with another coefficient at rest, which the path's speed lowers."""
    path = {"kind": "smooth_ramp", "times": [0.0, 0.06], "values": [2.0, 2.03]}
    pads = {"at": AT, "stiffness": 3e8, "unilateral": False, "friction": MU, "shear_stiffness": 1e7}
    pads |= {"static_friction": at_rest, "stribeck_speed": 0.3} if at_rest else {}
    scene = sliding(path, 0.2, step=4e-4, cylinder=SOFT).model_dump(mode="json", exclude_unset=True)
    for section in scene["sections"]:
        section["body"]["material"] = {}
    scene["sections"][1]["joint"] |= {"tail": [pads], "mouth": [pads]}
    found = {}
    for simulator in ("march", "petsc"):
        scene["compare"] = {"against": ["full"]}
        scene["simulation"] = {"full": simulator}
        one = Scene.model_validate(scene)
        found[simulator] = FullOrder.join(one, models_of(build_bodies(one))).reference("full")
    march, petsc = found["march"], found["petsc"]
    assert march is not None and petsc is not None
    for one in (march, petsc):
        friction = one.other("friction of fly")
        assert friction.min() < -2e3 and friction.max() > 2e3 and one.surplus < 1e-3
    assert petsc.residual_position.max() < 1e-12
    size = np.abs(march.slider_force).max()
    # at the start a force is a stiffness times what round-off leaves of a motion
    assert petsc.slider_force[1:] == pytest.approx(march.slider_force[1:], abs=1e-7 * size)
    assert petsc.other("friction of fly") == pytest.approx(march.other("friction of fly"), abs=1e-7 * size)
    assert petsc.displacement == pytest.approx(march.displacement, abs=1e-7 * np.abs(march.displacement).max())
    assert petsc.energy.strain == pytest.approx(march.energy.strain, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stiffness", "unilateral", "at_rest"),
    [(SOFT, False, 0.0), ("rigid", False, 0.0), (SOFT, False, 1.5 * MU), (SOFT, True, 1.5 * MU)],
)
def test_exudyn_rubs_as_the_compiled_loop_does(stiffness: float | str, unilateral: bool, at_rest: float) -> None:
    """Stuck at first, then sliding, with what residual flexibility makes of the moments; pads in the same parts.

    Of pads that have another coefficient at rest, twice as slow as it falls at most: a slide takes more than Coulomb's.
    """
    path = {"kind": "smooth_ramp", "times": [0.0, 0.06], "values": [2.0, 2.03]}
    pads = {"at": AT, "stiffness": 3e8, "unilateral": unilateral, "friction": MU, "shear_stiffness": 1e7}
    pads |= {"static_friction": at_rest, "stribeck_speed": 1.5} if at_rest else {}
    data = sliding(path, 0.03, step=1e-3).model_dump(mode="json", exclude_unset=True)
    for section in data["sections"]:
        section["body"]["material"] = {}
    data["sections"][1]["joint"] |= {"tail": [pads], "mouth": [pads], "cylinder": {"stiffness": stiffness}}
    scene = Scene.model_validate(data | {"time": {"end": 0.03, "step": 1e-3, "rho_inf": 0.8}})
    models = pmr.reduce(scene).reduced
    assert isinstance(models, Mapping)
    reduced = system_of(scene, models)
    given = Excitation.from_scene(scene)
    start = systems.start_of(reduced, given)
    march, other = (one(reduced, given, start) for one in (systems.simulate, exudyn.simulate_system))
    size, friction = np.abs(march.forces).max(), march.friction
    assert friction is not None and other.friction is not None
    slid = friction.sum(axis=1) > 0.99 * MU * np.abs(march.forces[:, :2]).sum(axis=1)
    assert slid.sum() > 5 and (~slid).sum() > 3
    pressed_by = np.abs(march.forces[:, : friction.shape[1]]).sum(axis=1)
    assert bool(at_rest) == np.any(friction.sum(axis=1) > 1.05 * MU * pressed_by)
    bound = 1e-4 if unilateral else 1e-7  # pads let go as Exudyn's scheme has it
    assert other.forces == pytest.approx(march.forces, abs=bound * size)
    assert other.friction == pytest.approx(friction, abs=bound * size)
    assert other.energy == pytest.approx(march.energy, rel=bound) and other.work == pytest.approx(
        march.work, rel=10.0 * bound
    )
