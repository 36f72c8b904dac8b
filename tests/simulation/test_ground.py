"""Outriggers beside complementarity in NumPy, Newton's and Euler's equations, and sums of forces on random machines."""

import os
from typing import Any

import numpy as np
import pytest
from newton_euler import needed
from random_stands import masses_on_ground, random_stand, rigid_boom, rope_on_machine, unbalanced

from pmr import Response
from pmr.compare.evaluation import evaluate_motion
from pmr.compare.moving_frame import ground_part
from pmr.kernel.laws import Stand
from pmr.reduction.bodies import join_bodies, reduce_bodies
from pmr.scene import Scene
from pmr.scene.checks import check_scene
from pmr.scene.ground import Ground, convex_hull, polygon_area
from pmr.simulation import Excitation
from pmr.simulation.native import systems
from pmr.simulation.native.form import SystemForm
from pmr.simulation.reactions import outputs_of_ground, with_forces_on_machine
from pmr.studies import tasks

G, COUNT = 9.80665, 60
CORNERS = ([2.0, 1.5], [-2.0, 1.5], [-2.0, -1.5], [2.0, -1.5])
LEGS = [{"name": name, "at": at} for name, at in zip("abcd", CORNERS, strict=True)]
CARRIER = {"name": "carrier", "mass": 9000.0, "at": [-0.6, 0.2, -0.8], "inertia": [6e3, 1.4e4, 1.5e4]}
WEIGHT = {"name": "counterweight", "mass": 2500.0, "at": [-1.8, 0.1, 0.2], "slews": True, "inertia": [9e2, 7e2, 8e2]}


def ground(**changes: Any) -> dict[str, Any]:
    """Keys of a ground with four outriggers."""
    return {"height": 1.4, "masses": [CARRIER, WEIGHT], "outriggers": LEGS} | changes


def rigid(luffing: Any, slewing: Any, hoist: dict[str, Any] | None = None, **changes: Any) -> Scene:
    """A boom of 6 m that is 10,000 times as stiff as steel, with 120 kg at its tip, clamped to its machine."""
    smooth = {"kind": "smooth_ramp", "times": [0.5, 2.5], "degree": 9}
    frame: dict[str, Any] = {"pivot": [0.4, 0.0, 0.3], "unit": "rad"}
    for key, values in (("luffing", luffing), ("slewing", slewing)):
        frame[key] = smooth | {"values": values} if isinstance(values, list) else {"kind": "constant", "amount": values}
    box = {"length": 6.0, "width": 0.22, "height": 0.32, "wall": 0.006}
    section: dict[str, Any] = {
        "name": "boom",
        "body": {"model": "beam3d", "box": box, "material": {"young": 2.1e15, "density": 7850.0}},
        "mesh": {"elements": 2},
        "supports": [{"on": "tail", "kind": "clamped"}],
        "pads": [{"name": "none", "moving": True, "faces": {"top": [0.0]}, "stiffness": 1e-3}],
        "slider": {"path": {"kind": "constant", "amount": 3.0}},
        "masses": [{"name": "load", "on": "tip", "mass": 120.0}],
        "reduction": {"coordinates": 8, "estimate": False},
    }
    scene = Scene.model_validate(
        {
            "title": "rigid",
            "frame": frame | {"ground": ground(**changes)},
            "sections": [section],
            "gravity": {},
            "hoist": hoist,
            "start": "equilibrium",
            "time": {"end": 3.0, "step": 4e-3, "rho_inf": 0.6},
            "compare": {"against": []},
        }
    )
    check_scene(scene)
    return scene


def simulated(scene: Scene) -> Response:
    """Response of the reduced system of a scene."""
    system = join_bodies(scene, reduce_bodies(scene, tasks.bodies_of(scene)))
    excitation = Excitation.from_scene(scene)
    moved = systems.simulate_form(SystemForm.of(system), excitation)
    return with_forces_on_machine(scene, evaluate_motion(system, moved))


@pytest.mark.slow
def test_a_rigid_machine_at_rest_tips_as_moments_by_hand_say() -> None:
    """On level ground: weights times distances from each edge, and the rule of levers over a rectangle."""
    phi, psi = 0.4, 0.7
    scene = rigid(phi, psi)
    found = simulated(scene)
    t0 = found.t[:1]
    section = scene.sections[0]
    boom = -needed(scene, 0, t0).force[0] @ scene.frame.rotation(t0)[0].T[:, 2] / G  # kg
    mass = -boom
    beam, reach = mass - 120.0, np.array([np.cos(psi), np.sin(psi)])
    along = np.cos(phi) * (0.4 + np.array([3.0, section.length])) - np.sin(phi) * 0.3
    turned = np.array([[np.cos(psi), -np.sin(psi)], [np.sin(psi), np.cos(psi)]])
    masses = np.array([beam, 120.0, 9000.0, 2500.0])
    places = np.array([along[0] * reach, along[1] * reach, [-0.6, 0.2], turned @ [-1.8, 0.1]])
    total, (x, y) = masses.sum() * G, masses @ places / masses.sum()
    margins = {"a to b": 1.5 - y, "b to c": 2.0 + x, "c to d": 1.5 + y, "d to a": 2.0 - x}
    for name, arm in margins.items():
        assert found.other(f"tipping margin over {name}")[0] == pytest.approx(total * arm, rel=1e-6)
    use = 1.0 - min((1.5 - y) / 1.5, (2.0 + x) / 2.0, (1.5 + y) / 1.5, (2.0 - x) / 2.0)
    assert found.other("use of the support polygon")[0] == pytest.approx(use, rel=1e-6)
    for leg in LEGS:
        force = total / 4.0 * (1.0 + x / leg["at"][0] + y / leg["at"][1])
        assert found.other(f"force of outrigger {leg['name']}")[0] == pytest.approx(force, rel=1e-6)


@pytest.mark.slow
def test_a_rigid_machine_in_motion_presses_as_newton_and_euler_say() -> None:
    """On a slope, luffing and slewing; three legs, whose forces equilibrium alone decides."""
    scene = rigid([0.2, 0.7], [0.0, 0.9], outriggers=[*LEGS[:2], {"name": "e", "at": [0.3, -2.5]}], slope=[0.03, -0.02])
    found = simulated(scene)
    wrench = rigid_boom(scene, found.t) + masses_on_ground(scene, found.t)
    legs = np.array([leg.at for leg in scene.frame.ground.outriggers])
    sums = np.vstack([np.ones(3), legs.T])
    along_x, along_y = wrench[:, 4] + 1.4 * wrench[:, 0], 1.4 * wrench[:, 1] - wrench[:, 3]
    forces = np.linalg.solve(sums, np.stack([-wrench[:, 2], along_x, along_y])).T
    assert forces.min() > 0.0
    assert found.of("outrigger") == pytest.approx(forces, abs=1e-6 * forces.max())
    moved = np.abs(np.diff(forces, axis=0)).max()
    assert moved > 1e-4 * forces.max()
    of_ground = [found.other(f"reaction of ground {d}") for d in ("x", "y", "z", "rx", "ry", "rz")]
    for k, column in enumerate(of_ground):
        size = np.abs(wrench[:, :3] if k < 3 else wrench[:, 3:]).max()
        assert column == pytest.approx(wrench[:, k], abs=1e-6 * size)


@pytest.mark.slow
@pytest.mark.numerical
def test_a_payload_on_a_rope_to_the_machine_presses_where_it_hangs() -> None:
    """Hoisting, luffing and slewing: the ground bears machine, boom, and the pull of the falls at the head.

    What the rope pulls at the winch it presses the boom with.
    """
    speed = {"kind": "smooth_ramp", "times": [0.5, 1.0, 2.0, 2.5], "values": [0.0, 0.5, 0.5, 0.0]}
    winch = {"at": [-0.7, 0.2, 0.5]}
    hoist = {"payload": 400.0, "falls": 2, "EA": 1e7, "damping": 5e4, "hanging": 3.0, "speed": speed, "winch": winch}
    scene = rigid([0.2, 0.3], [0.0, 0.4], hoist)
    shown = simulated(scene)
    assert shown.of("hoist_force").min() > 0.0
    head = np.einsum("tij,j->ti", scene.frame.rotation(shown.t), [0.4 + scene.sections[0].length, 0.0, 0.3])
    fall = np.stack([shown.other(f"hook in space {axis}") for axis in "XYZ"], axis=1) - head
    pull = 2.0 * shown.of("hoist_force") * fall / np.linalg.norm(fall, axis=1)[:, None]
    hung = np.hstack([pull, np.cross(head, pull)])
    wrench = rigid_boom(scene, shown.t) + masses_on_ground(scene, shown.t) + hung
    for k, axis in enumerate(("x", "y", "z", "rx", "ry", "rz")):
        size = np.abs(hung[:, :3] if k < 3 else hung[:, 3:]).max()
        assert shown.other(f"reaction of ground {axis}") == pytest.approx(wrench[:, k], abs=1e-5 * size)


@pytest.mark.parametrize("seed", range(COUNT))
def test_forces_of_outriggers_solve_the_complementarity_problem(seed: int) -> None:
    """They push, carry the load, and are stiffness times the sinking of a rigid machine, above lifted ones or none."""
    rng = np.random.default_rng([seed, 9])
    n = int(rng.integers(3, 9))
    places, k = rng.uniform(-3.0, 3.0, (n, 2)), 10.0 ** rng.uniform(6.5, 8.5, n)
    legs = [
        {"name": str(i), "at": at, "stiffness": float(ki)}
        for i, (at, ki) in enumerate(zip(places.tolist(), k, strict=True))
    ]
    stand = Stand.of_ground(Ground.model_validate({"outriggers": legs}))
    inside = rng.dirichlet(np.full(len(stand.polygon), 0.4), 40) @ stand.polygon
    loads = 1e5 * np.insert(inside, 0, 1.0, axis=1)
    forces = stand.forces(loads)
    sums = np.insert(places, 0, 1.0, axis=1)
    assert forces @ sums == pytest.approx(loads, abs=1e-9 * np.abs(loads).max())
    assert forces.min() >= -1e-9 * forces.max()
    for row in forces:
        stands = row > 1e-7 * row.max()
        sinking = np.linalg.lstsq(sums[stands], row[stands] / k[stands], rcond=None)[0]
        if np.linalg.matrix_rank(sums[stands], tol=1e-6) == 3:
            assert k * np.maximum(sums @ sinking, 0.0) == pytest.approx(row, abs=1e-6 * row.max())


SAMPLED = (2, 5, 22, 30, 58)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(COUNT) if os.environ.get("PMR_SWEEP") == "full" else SAMPLED)
def test_forces_on_a_random_machine_sum_to_zero_with_weight_and_inertia(seed: int) -> None:
    """Forces of pin and luffing cylinder, of all masses and of the outriggers, while the machine stands.

    One of them, number 33, falls over its rear edge from the start.
    """
    scene = random_stand(seed)
    sums, use = unbalanced(scene, simulated(scene))
    assert (use < 1.0).any() == (seed != 33)
    assert np.abs(sums[use < 1.0]).max(initial=0.0) < 1e-9


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.parametrize("seed", range(COUNT) if os.environ.get("PMR_SWEEP") == "full" else SAMPLED[:2])
def test_forces_on_a_random_machine_that_hoists_sum_to_zero(seed: int) -> None:
    """The rope's pull on the winch among them; some ropes get slack, and some machines tip as these snatch."""
    scene = random_stand(seed, hoists=True)
    shown = simulated(scene)
    sums, use = unbalanced(scene, shown, rope_on_machine(scene, shown))
    assert np.abs(sums[use < 1.0]).max(initial=0.0) < 1e-9
    assert shown.of("hoist_force").max() > 0.0


def test_beyond_an_edge_the_machine_tips_and_the_last_forces_are_at_the_edge() -> None:
    scene = rigid(0.3, 0.0)
    stand = Stand.of_ground(scene.frame.ground)
    wrench = np.array([[0.0, 0.0, -1e5, 0.0, 2.5e5, 0.0], [0.0, 0.0, -1e5, 0.0, 1e5, 0.0], [0.0] * 6])
    columns = stand.columns(wrench)
    forces, margins, use = columns[:, 6:10], columns[:, 10:14], columns[:, 14]
    assert forces[0] == pytest.approx([5e4, 0.0, 0.0, 5e4], abs=1e-3)
    assert dict(zip([of.name for of in outputs_of_ground(scene)[10:14]], margins[0], strict=True))[
        "tipping margin over d to a"
    ] == pytest.approx(-0.5e5)
    assert use == pytest.approx([1.25, 0.5, 0.0])
    assert forces[1].sum() == pytest.approx(1e5) and forces[2].tolist() == [0.0] * 4
    beyond = stand.columns(np.array([[0.0, 0.0, -1e5, 2.5e5, 2.5e5, 0.0]]))[0, 6:10]  # two edges, beside corner d
    assert beyond == pytest.approx([0.0, 0.0, 0.0, 1e5], abs=1e-3)


def test_the_summary_says_which_outriggers_lift_off_and_when_the_machine_tips() -> None:
    scene = rigid(0.3, 0.0)
    stand, t = Stand.of_ground(scene.frame.ground), np.linspace(0.0, 1.0, 11)
    wrench = np.zeros((11, 6))
    wrench[:, 2], wrench[:, 4] = -1e5, np.linspace(0.0, 1.95e5, 11)
    wrench[:, 3] = -0.2e5
    empty = Response(t, np.empty(0), np.empty((11, 0)), None, np.empty((11, 0)), t, t, 0.0)  # type: ignore[arg-type]
    part = ground_part(scene, empty.with_others(stand.columns(wrench), outputs_of_ground(scene)))
    assert part.figures["ground"]["tips"] is None
    lifted = {of["name"]: of.get("lifted") for of in part.figures["ground"]["outriggers"]}
    assert lifted["c"]["t"] == pytest.approx(0.9) and lifted["a"] is None
    assert part.warnings and part.warnings[0].startswith("outriggers lift off: ")
    wrench[5:, 4] = 2.1e5
    part = ground_part(scene, empty.with_others(stand.columns(wrench), outputs_of_ground(scene)))
    assert part.figures["ground"]["tips"] == pytest.approx(0.5)
    assert "the machine tips over d to a at 0.5 s" in part.grave[0]
    growing = scene.with_keys(gravity={"rise": 1.5})
    part = ground_part(growing, empty.with_others(stand.columns(wrench), outputs_of_ground(scene)))
    assert part.figures == {} and "the weight still grows when the run ends" in part.grave[0]


def test_the_hull_is_convex_and_holds_all_points() -> None:
    for seed in range(20):
        points = [tuple(p) for p in np.random.default_rng(seed).uniform(-1.0, 1.0, (9, 2)).tolist()]
        hull = convex_hull(points)
        assert polygon_area(hull) > 0.0 and set(hull) <= set(points)
        for a, b in zip(hull, [*hull[1:], hull[0]], strict=True):
            assert all(polygon_area((a, b, p)) >= -1e-12 for p in points)
