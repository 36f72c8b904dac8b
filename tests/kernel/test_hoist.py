"""A payload on a rope beside closed forms: pendulums, two coupled masses, steady slewing, winding, slack and snatch."""

from dataclasses import replace

import hoists
import numpy as np
import pytest
from hoists import REACH, SECOND_MOMENT, G, cantilever, simulate
from kernels import unpack
from scipy.spatial.transform import Rotation
from scipy.special import ellipk

from pmr import InputError, SimulationError, Stepper, System
from pmr.kernel.blocks import LINE, pack, seal
from pmr.kernel.kernel import Kernel, checksum
from pmr.kernel.state import Record, State
from pmr.scene import Scene
from pmr.scene.hoist import ROPE, ROPE_FORCE
from pmr.simulation import Excitation
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.systems import March
from pmr.system.terms import hoist_of

HEIGHT, X, Y, Z, ALONG, ACROSS, FORCE = range(7)


@pytest.fixture(scope="module")
def stiff() -> System:
    return hoists.reduced(cantilever())


@pytest.fixture(scope="module")
def soft() -> System:
    return hoists.reduced(cantilever({"body.material.young": 2.1e10}))


@pytest.fixture(scope="module")
def slewing() -> System:
    return hoists.reduced(cantilever(SLEWN))


SPEED = 1.1
SLEWN = {
    "frame.pivot": [0.0, 0.0, 0.0],
    "frame.unit": "rad",
    "frame.slewing": {"kind": "ramp", "times": [-100.0, 100.0], "values": [-100.0 * SPEED, 100.0 * SPEED]},
}


def period(t: np.ndarray, angle: np.ndarray) -> float:
    """Mean time between downward zeros."""
    down = np.flatnonzero((angle[:-1] > 0) & (angle[1:] <= 0))
    zeros = t[down] + (t[1] - t[0]) * angle[down] / (angle[down] - angle[down + 1])
    return float(np.diff(zeros).mean())


@pytest.mark.parametrize("swing", [[1e-3, 0.0], [0.0, 1e-3], [1.4, 0.0], [0.0, 1.4]])
def test_a_pendulum_of_any_amplitude_has_its_period(stiff: System, swing: list[float]) -> None:
    angle = max(swing)
    run = simulate(stiff, cantilever({"hoist.swing": swing}))
    exact = 4.0 * np.sqrt(2.0 / G) * ellipk(np.sin(angle / 2.0) ** 2)
    assert period(run.t, run.hoist[:, ALONG if swing[0] else ACROSS]) == pytest.approx(exact, rel=1e-5)


def test_a_payload_on_a_soft_boom_moves_as_two_coupled_masses(soft: System) -> None:
    M = m = 100.0
    length = 2.0 + m * G * (REACH / (2.1e10 * 1e-2) + 1e5 / 1e13)  # the boom is pressed, and the rope stretched
    k, c = 3.0 * 2.1e10 * SECOND_MOMENT / REACH**3, m * G / length
    far = {"hoist.winch.at": [-1e5, 0.0, 0.0]}  # so that the rope pulls along the boom wherever its head is
    scene = cantilever({"body.material.young": 2.1e10, "hoist.swing": [0.0, 1e-4], "time.step": 4e-4, **far})
    run = simulate(soft, scene)
    omega2, modes = np.linalg.eigh([[(k + c) / M, -c / np.sqrt(M * m)], [-c / np.sqrt(M * m), c / m]])
    y = run.hoist[:, Y] - length * np.sin(run.hoist[:, ACROSS])  # of the head
    start = np.array([y[0], run.hoist[0, Y]]) * 10.0
    exact = (modes @ (np.cos(np.sqrt(omega2)[:, None] * run.t) * (modes.T @ start)[:, None])) / 10.0
    assert y[0] == pytest.approx(c * 1e-4 * length / k, rel=1e-3)
    np.testing.assert_allclose(run.hoist[:, Y], exact[1], rtol=0.0, atol=1e-4 * np.abs(exact[1]).max())
    np.testing.assert_allclose(y, exact[0], rtol=0.0, atol=1e-4 * np.abs(exact[0]).max())


def test_steady_slewing_inclines_the_rope(slewing: System) -> None:
    angle = 0.3
    for _ in range(100):
        angle = np.arctan(SPEED**2 * (REACH + 2.0 * np.sin(angle)) / G)
    speed = SPEED * (REACH + 2.0 * np.sin(angle))
    changes = {"hoist.swing": [float(angle), 0.0], "hoist.velocity": [0.0, float(speed), 0.0]}
    changes |= {"hoist.EA": 1e9, "hoist.damping": 1e6}  # what bears the payload at rest is less
    run = simulate(slewing, cantilever(SLEWN | changes))
    force = 100.0 * G / np.cos(angle)
    np.testing.assert_allclose(run.hoist[:, ALONG], angle, rtol=1e-5)
    np.testing.assert_allclose(run.hoist[:, ACROSS], 0.0, atol=1e-5 * angle)
    np.testing.assert_allclose(run.hoist[1000:, FORCE], force, rtol=1e-5)


@pytest.mark.slow
def test_winding_in_slowly_keeps_action_over_frequency(stiff: System) -> None:
    speed = {"kind": "smooth_ramp", "times": [0.0, 10.0, 50.0, 60.0], "values": [0.0, 0.02, 0.02, 0.0]}
    scene = cantilever({"hoist.swing": [0.02, 0.0], "hoist.speed": speed, "time.end": 80.0, "time.step": 4e-3})
    run = simulate(stiff, scene)
    length = run.hoist[-1, Z]
    first, last = (np.abs(run.hoist[part, ALONG]).max() for part in (slice(0, 1000), slice(-2000, None)))
    assert length == pytest.approx(-1.0, rel=1e-3)
    assert last**2 * 1.0**1.5 == pytest.approx(first**2 * 2.0**1.5, rel=0.01)


def test_a_rope_that_snatches_peaks_as_its_energy_says(stiff: System) -> None:
    stiffness, speed = 1e6 / 2.0, 1.5
    scene = cantilever(
        {"hoist.EA": 1e6, "hoist.velocity": [0.0, 0.0, speed], "time.end": 0.6, "hoist.winch.at": [REACH, 0.0, 1e-6]}
    )
    force = simulate(stiff, scene).hoist[:, FORCE]
    assert np.count_nonzero(force == 0.0) > 100  # a throw
    assert force.max() == pytest.approx(100.0 * G + speed * np.sqrt(stiffness * 100.0), rel=5e-3)


@pytest.mark.parametrize(("falls", "hanging", "EA"), [(1, 2.0, 1e7), (4, 3.0, 1e6), (2, 1.0, 1e13)])
def test_the_hook_hangs_where_reeving_says(stiff: System, falls: int, hanging: float, EA: float) -> None:
    scene = cantilever(
        {"hoist.falls": falls, "hoist.hanging": hanging, "hoist.EA": EA, "hoist.winch.at": [0.0, 0.0, 1.0]}
    )
    state = March(SystemForm.of(hoisted(stiff, scene)), Excitation.from_scene(scene)).state
    force, head, winch = 100.0 * G / falls, np.array([REACH, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    for _ in range(5):  # by the boom, which gives some nm: 3 E I / L^3 across, E A / L along
        line = force * (winch - head) / np.linalg.norm(winch - head)
        down = (line[2] - 200.0 * G) * REACH**3 / (3.0 * 2.1e17 * SECOND_MOMENT)
        head = np.array([REACH + line[0] * REACH / 2.1e15, 0.0, down])
    along = np.linalg.norm(winch - head)
    stretched = (falls * hanging + np.hypot(REACH, 1.0)) * (1.0 + force / EA)
    assert state.hoist[Z] == pytest.approx(head[2] - (stretched - along) / falls, rel=1e-14)
    assert state.hoist[FORCE] == pytest.approx(force, rel=1e-14)


def hoisted(system: System, scene: Scene) -> System:
    return replace(system, hoist=hoist_of(scene), provenance=scene.provenance)


ON_MACHINE = {
    "frame": {"pivot": [0.0, 0.0, 0.0], "unit": "rad", "luffing": 0.6, "slewing": 0.4},
    "hoist.winch.at": [-0.5, 0.2, 0.4], "hoist.EA": 1e9, "time.end": 1.6,
}  # fmt: skip


def head_of_rigid_boom(roll: float, pitch: float, yaw: float = 0.0) -> np.ndarray:
    """Place (3,) of the head along axes of the ground."""
    base = Rotation.from_euler("ZYX", [yaw, pitch, roll])
    return np.asarray((base * Rotation.from_euler("ZY", [0.4, -0.6])).apply([REACH, 0.0, 0.0]))


def assert_falls_are_unchanged(hoist: np.ndarray, heads: np.ndarray) -> None:
    """Falls of 2 m are longer by the strain of the whole rope alone, whose other part has one length."""
    winch = np.array([-0.5, 0.2, 0.4])
    along = float(np.linalg.norm(REACH * np.array([np.cos(0.6), 0.0, np.sin(0.6)]) - winch))
    strained = (2.0 + along) * (1.0 + hoist[:, FORCE] / 1e9) - along
    np.testing.assert_allclose(np.linalg.norm(hoist[:, X : Z + 1] - heads, axis=1), strained, rtol=1e-8)


def test_a_winch_on_a_machine_that_rocks_keeps_its_rope() -> None:
    roll, pitch, yaw = (
        {"kind": "smooth_ramp", "times": [0.0, 1.5], "values": [0.0, angle]} for angle in (0.2, -0.3, 0.5)
    )
    scene = cantilever(ON_MACHINE | {"frame": ON_MACHINE["frame"] | {"base": {"rx": roll, "ry": pitch, "rz": yaw}}})
    assert scene.frame is not None
    run, angles = simulate(hoists.reduced(scene), scene), scene.frame.base_angles
    of_base = np.column_stack([angle.value(run.t) for angle in angles])
    assert np.ptp(of_base, axis=0).min() > 0.19
    assert_falls_are_unchanged(run.hoist, np.array([head_of_rigid_boom(*now) for now in of_base.tolist()]))


def test_a_stepper_of_a_winch_on_a_slope_follows_roll_and_pitch() -> None:
    legs = [{"name": f"leg {k}", "at": at} for k, at in enumerate([[9.0, 9.0], [-9.0, 9.0], [0.0, -9.0]])]
    ground = {
        "slope": [0.05, 0.1],
        "outriggers": legs,
        "masses": [{"name": "car", "mass": 1e5, "at": [0.0, 0.0, -1.0]}],
    }
    held = [{"on": "tail", "kind": "clamped"}]
    scene = cantilever(ON_MACHINE | {"frame": ON_MACHINE["frame"] | {"ground": ground}, "supports": held})
    stepper, hooks, heads = Stepper(hoists.reduced(scene), step=4e-3, s=0.5), list[list[float]](), list[np.ndarray]()
    for more in 0.2 * np.sin(np.linspace(0.0, np.pi / 2.0, 400)) ** 2:
        roll, pitch = 0.1 + float(more), -0.05 - 2.0 * float(more)
        stepper.step({}, frame={"base.rx": roll, "base.ry": pitch})
        hooks.append([*stepper.hoist.values()])
        heads.append(head_of_rigid_boom(roll, pitch))
    assert_falls_are_unchanged(np.array(hooks), np.array(heads))


def test_a_stepper_refuses_a_rope_that_is_too_short() -> None:
    rope = {"hoist.hanging": None, "hoist.length": {"kind": "constant", "amount": 8.0}}
    system = hoists.reduced(cantilever(rope))
    assert Stepper(system, step=1e-3, s=0.5).hoist[ROPE_FORCE] == pytest.approx(100.0 * G, rel=1e-12)
    with pytest.raises(SimulationError, match="the hook is at its head sheaves: its rope is too short"):
        Stepper(system, step=1e-3, s=0.5, F={ROPE: 0.5})


def test_a_start_whose_rope_finds_no_equilibrium_says_so(soft: System) -> None:
    """Beside a winch that is nearer to the head than the boom bends, the pull's direction turns again and again."""
    scene = cantilever({"body.material.young": 2.1e10, "hoist.winch.at": [REACH, 0.0, -0.05]})
    with pytest.raises(SimulationError, match="t = 0 s.*: the forces of the hoist rope do not converge") as refused:
        simulate(soft, scene)
    assert "iterations" not in str(refused.value)


def test_a_hoist_that_pulls_more_inputs_than_there_are_is_refused(stiff: System) -> None:
    """Although the checksum fits."""
    kernel = SystemForm.of(hoisted(stiff, cantilever())).kernel
    arrays = unpack(kernel.block)

    def block(count: int) -> bytearray:
        """The system's block with a hoist that pulls `count` inputs."""
        of_inputs = {"hoist_inputs": np.zeros(count, int), "hoist_levers": np.zeros(6 * count)}
        block = pack(arrays | of_inputs)
        seal(block, checksum(block[LINE:]))
        return block

    assert Kernel(block(kernel.inputs)).hoist == kernel.hoist
    with pytest.raises(InputError, match="damaged: inputs of a hoist"):
        Kernel(block(kernel.inputs + 1))


WILD = {
    "body.material.young": 2.1e10,
    "hoist.EA": 1e6,
    "hoist.swing": [0.5, 0.3],
    "hoist.speed": {"kind": "smooth_ramp", "times": [0.0, 1.0], "values": [0.0, 1.0]},
    "time.end": 1.0,
}


def test_errors_of_place_and_energy_fall_with_the_square_of_the_step(soft: System) -> None:
    runs = {n: simulate(soft, cantilever(WILD | {"time.step": 4e-3 / n})) for n in (1, 2, 16)}
    place = {n: np.linalg.norm(runs[n].hoist[-1, X:ALONG] - runs[16].hoist[-1, X:ALONG]) for n in (1, 2)}
    energy = {n: abs((run.energy - run.work)[-1] - (run.energy - run.work)[0]) for n, run in runs.items()}
    assert place[1] / place[2] == pytest.approx(4.0, rel=0.1)
    assert energy[1] / energy[2] == pytest.approx(4.0, rel=0.2)
    assert energy[16] < 1e-5 * np.ptp(runs[16].energy)
    assert runs[1].surplus < 1e-3


def test_a_restored_state_goes_on_bit_for_bit(soft: System) -> None:
    scene = cantilever(WILD)
    march = March(SystemForm.of(hoisted(soft, scene)), Excitation.from_scene(scene))
    kernel, state = march.form.kernel, march.state
    record = Record(kernel, 400, ("hoist", "energy"))
    state.advance(march._signals, 200, record)
    saved = state.save()
    state.advance(march._signals, 200, record, 200)
    other, again = State(kernel, state.settings), Record(kernel, 200, ("hoist", "energy"))
    other.restore(saved)
    other.advance(march._signals, 200, again)
    np.testing.assert_array_equal(again["hoist"], record["hoist"][200:])
    np.testing.assert_array_equal(again["energy"], record["energy"][200:])


def test_a_boom_at_rest_stays_at_rest(soft: System) -> None:
    run = simulate(soft, cantilever({"body.material.young": 2.1e10, "hoist.EA": 1e7, "time.end": 1.0}))
    np.testing.assert_allclose(run.hoist[:, FORCE], 100.0 * G, rtol=1e-9)
    np.testing.assert_allclose(run.hoist[:, Z], run.hoist[0, Z], rtol=1e-12)
