"""A machine that moves by itself below a boom: held, driven, and free in space."""

from pathlib import Path

import free_boom
import momenta
import numpy as np
import pytest

import pmr
from pmr import InputError, SimulationError
from pmr.files.arrays import Array
from pmr.scene import Scene
from pmr.scene.frame import DIRECTIONS
from pmr.scene.rotation import FrameRotation
from pmr.simulation import Excitation
from pmr.simulation.frame_motion import MachineMotion, with_computed_motion
from pmr.simulation.free_base import Extensions, FrameMotion, FreeBase, base_equations
from pmr.simulation.native import systems
from pmr.simulation.native.free_motion import machine_motion
from pmr.system.assembly import Assembly
from pmr.system.changing_rows import ChangingRows, EliminatedContacts
from pmr.system.states import SystemTrajectory

pytestmark = pytest.mark.slow  # a boom is reduced

MASS, CENTER, INERTIA = 300.0, (0.1, 0.2, -0.3), (40.0, 60.0, 50.0)
MACHINE = (f"frame.machine={{mass={MASS}, center={list(CENTER)}, inertia={list(INERTIA)}}}",)
ADRIFT = (
    *MACHINE,
    f"frame.machine.free={list(DIRECTIONS)}",
    "frame.machine.rate={x=0.4, y=-0.3, z=0.2, rx=0.8, ry=-0.5, rz=1.1}",
    "frame.luffing={kind='sine', amplitude=0.4, frequency=0.7}",
    "start='rest'",
)


def in_space(*changes: str) -> Scene:
    return free_boom.scene(*ADRIFT, *changes).model_copy(update={"gravity": None})


def moved(scene: Scene, found: MachineMotion) -> SystemTrajectory:
    """The boom in a frame that moves so."""
    system = free_boom.system()
    driven = Excitation.from_scene(with_computed_motion(scene, found))
    return systems.simulate(system, driven, systems.start_of(system, driven))


def coordinates(run: SystemTrajectory) -> tuple[Array, Array]:
    return tuple(np.hstack([getattr(one, what) for one in run.bodies.values()]) for what in "qv")


class Whole:
    """Momenta and energy of machine and boom at the steps, from the motion of both."""

    def __init__(self, scene: Scene, found: MachineMotion, run: SystemTrajectory) -> None:
        system = free_boom.system()
        self.assembly, self.found, self.scene, self.t = Assembly(system), found, scene, run.t
        self.q, self.rate = coordinates(run)
        self.boom, self.along = FreeBase(scene, system, self.assembly), ChangingRows(self.assembly, scene.names)
        path = scene.extension(1)
        self.s = np.array([path.value(run.t), path.rate(run.t), path.second_rate(run.t)])
        self.gives = np.any(self.along.evaluate(np.array([0.0, self.s[0, 0]])).rows.F != 0.0, axis=1)
        self.answering = EliminatedContacts(self.assembly, self.along, self.gives)
        rocking = [tuple(found.values[:, :, 3 + j]) for j in range(3)]
        angles = [
            tuple(getattr(one, of)(run.t) for of in ("value", "rate", "second_rate")) for one in scene.frame.angles
        ]
        self.base, self.turning = FrameRotation.from_rocking(rocking), FrameRotation.from_angles(*angles, rocking)

    def extended(self, k: int) -> Extensions:
        return Extensions(*(np.array([0.0, one]) for one in self.s[:, k]))

    def momenta(self, k: int) -> Array:
        x, v = self.found.values[:2, k, :3]
        R, Rb, omega = self.turning.rotation[k], self.base.rotation[k], self.base.velocity[k]
        out, motion = self.extended(k), FrameMotion(self.turning.velocity[k], np.zeros(3))
        p = momenta.momentum(
            self.boom,
            motion,
            R.T @ v,
            out,
            self.q[k],
            self.rate[k],
            self.boom.moments_with_contacts(self.answering, out),
        )
        own = MASS * (v + Rb @ np.cross(omega, CENTER))
        P = R @ p[:3] + own
        return np.append(P, R @ p[3:] + np.cross(Rb @ CENTER, own) + Rb @ (INERTIA * omega) + np.cross(x, P))

    def energy(self, k: int) -> float:
        v, Rb, omega, q, rate = self.found.values[1, k, :3], self.base.rotation[k], self.base.velocity[k], *self.at(k)
        out, motion = self.extended(k), FrameMotion(self.turning.velocity[k], np.zeros(3))
        own = v + Rb @ np.cross(omega, CENTER)
        energy = momenta.kinetic(
            self.boom,
            motion,
            self.turning.rotation[k].T @ v,
            out,
            q,
            rate,
            self.boom.moments_with_contacts(self.answering, out),
        )
        K = self.assembly.K.toarray() + self.springs(k)[0]
        return energy + (MASS * own @ own + omega @ (INERTIA * omega) + rate @ self.assembly.M @ rate + q @ K @ q) / 2.0

    def power(self, k: int) -> float:
        """Of what draws the boom out, at the accelerations that the equations have there."""
        (q, rate), out, n = self.at(k), self.extended(k), self.assembly.size
        motion = FrameMotion(self.turning.velocity[k], np.zeros(3))
        pressed = base_equations(
            self.boom.boom, motion, out, q, rate, self.boom.moments_with_contacts(self.answering, out)
        )
        mass, forces, (contacts, slope) = pressed.mass.copy(), pressed.forces.copy(), self.springs(k)
        near, R, rigid = self.along.evaluate(out.value), self.turning.rotation[k], ~self.gives
        forces[6 : 6 + n] += (self.assembly.K.toarray() + contacts) @ q
        mass[6 : 6 + n, 6 : 6 + n] += self.assembly.M.toarray()
        known = np.zeros(len(mass))
        known[:3] = R.T @ self.found.values[2, k, :3]
        known[3:6], known[6 + n :] = self.turning.acceleration[k], out.second
        left = forces[6 : 6 + n] + (mass @ known)[6 : 6 + n]
        C, (first, second) = near.rows.C[rigid], self.along.time_derivatives(out.value, out.rate)
        held = 2.0 * first.C[rigid] @ rate + second.C[rigid] @ q + near.slopes.C[1, rigid] @ q * out.second[1]
        m = len(C)
        A = np.block([[mass[6 : 6 + n, 6 : 6 + n], C.T], [C, np.zeros((m, m))]])
        found = -np.linalg.solve(A, np.append(left, held))
        known[6 : 6 + n] = found[:n]
        force = (forces + mass @ known)[-1] + q @ slope @ q / 2.0 + found[n:] @ near.slopes.C[1, rigid] @ q
        return float(force) * out.rate[1]

    def springs(self, k: int) -> tuple[Array, Array]:
        """C^T F^-1 C, and its derivative by the extension."""
        near, gives = self.along.evaluate(self.extended(k).value), self.gives
        C, F, slope = near.rows.C[gives], near.rows.F[np.ix_(gives, gives)], near.slopes
        A = np.linalg.solve(F, C)
        bent = slope.C[1, gives].T @ A
        return C.T @ A, bent + bent.T - A.T @ slope.F[1][np.ix_(gives, gives)] @ A

    def at(self, k: int) -> tuple[Array, Array]:
        return self.q[k], self.rate[k]


def test_free_in_space_momenta_stay_to_round_off_while_it_telescopes() -> None:
    """Those of the boom that is simulated in the frame that was found; it bends, and is driven to luff."""
    scene = in_space("time.end=0.06", "time.step=2e-3")
    found = machine_motion(scene, free_boom.system())
    whole = Whole(scene, found, moved(scene, found))
    p = np.array([whole.momenta(k) for k in range(len(whole.t))])
    size = np.abs(p[0].reshape(2, 3)).max(axis=1).repeat(3)
    for one in (p, found.momenta):
        np.testing.assert_allclose(one / size, np.tile(p[0] / size, (len(p), 1)), rtol=0.0, atol=1e-10)
    assert np.ptp(whole.s[0]) > 0.05
    assert np.abs(found.values[1] - found.values[1, 0]).max() > 0.1  # the machine feels it
    assert np.abs(whole.q).max() > 1e-4


def test_free_in_space_its_energy_is_the_work_of_what_draws_it_out_but_for_the_step() -> None:
    """The work of the cylinder is several times the energy at the start, and integrated with the same steps."""
    lost = []
    for step in (2e-3, 1e-3):
        changes = "frame.luffing={kind='constant', amount=0.3}", "sections.fly.joint.extension.times=[0.0, 0.08]"
        scene = in_space("time.end=0.04", f"time.step={step}", *changes)
        found = machine_motion(scene, free_boom.system())
        whole = Whole(scene, found, moved(scene, found))
        energy, power = (np.array([of(k) for k in range(len(whole.t))]) for of in (whole.energy, whole.power))
        work = np.append(0.0, np.cumsum((power[1:] + power[:-1]) / 2.0 * step))
        assert np.ptp(work) > 5.0 * energy[0]
        lost.append(np.abs(energy - energy[0] - work).max() / energy[0])
    np.testing.assert_allclose(lost[0] / lost[1], 4.0, rtol=0.1)
    assert lost[1] < 0.01


def test_held_it_is_the_ground_and_driven_a_frame() -> None:
    """Directions of the motion that was found are those that were given, in the unit of the frame's angles."""
    turned = "frame.luffing={kind='smooth_ramp', times=[0.0, 0.1], values=[0.3, 0.5]}"
    base = "frame.base={x={kind='sine', amplitude=0.1, frequency=3.0}, ry={kind='sine', amplitude=0.2, frequency=2.0}}"
    responses = []
    for changes in ((turned,), (turned, base)):
        plain, held = (pmr.simulate(free_boom.scene(*changes, *of), free_boom.system()) for of in ((), MACHINE))
        for one in ("displacement", "slider_force"):
            expected = getattr(plain, one)
            np.testing.assert_allclose(getattr(held, one), expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())
        np.testing.assert_array_equal(plain.others, held.others[:, : plain.others.shape[1]])
        responses.append(held)
    on_ground, driven = responses
    assert not any(on_ground.other(f"machine {one}").any() for one in DIRECTIONS)
    np.testing.assert_allclose(driven.other("machine ry"), 0.2 * np.sin(4.0 * np.pi * driven.t), rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(
        driven.other("rate of machine x"), 0.6 * np.pi * np.cos(6.0 * np.pi * driven.t), rtol=0.0, atol=1e-14
    )
    assert np.abs(driven.displacement - on_ground.displacement).max() > 0.1 * np.abs(on_ground.displacement).max()


def test_what_holds_it_is_the_change_of_momentum() -> None:
    """Held along Y and in yaw, on springs upwards and in roll: momenta change by weight less what it presses with."""
    missing = []
    for step in (2e-3, 1e-3):
        changes = "frame.machine.free=['x', 'z', 'rx', 'ry']", "frame.machine.stiffness={z=2e6, rx=1e6, ry=1e6}"
        begins = "sections.fly.joint.extension.times=[0.02, 0.2]"
        scene = free_boom.scene(*MACHINE, *changes, "start='equilibrium'", f"time.step={step}", begins)
        found = machine_motion(scene, free_boom.system())
        force = -found.forces[:, :3]
        mass = FreeBase(scene, free_boom.system()).boom.mass + MASS
        force[:, 2] -= scene.gravity.acceleration * mass
        assert not found.forces[:, 0].any()
        np.testing.assert_allclose(force[0, 1:], 0.0, rtol=0.0, atol=1e-9 * mass * scene.gravity.acceleration)
        np.testing.assert_allclose(found.values[1, 0], 0.0, rtol=0.0, atol=1e-12)
        impulse = np.cumsum((force[1:] + force[:-1]) / 2.0 * step, axis=0)
        change = (found.momenta - found.momenta[0])[1:, :3]
        missing.append(np.abs(change - impulse).max() / np.abs(change).max())
        # no force is left along X but for the boom's rows, and what begins in balance is moved by its extension alone
        np.testing.assert_allclose(change[:, 0], 0.0, rtol=0.0, atol=1e-10 * np.abs(change).max())
    assert missing[0] / missing[1] > 3.0
    assert missing[1] < 0.01


def test_pushed_it_goes_by_what_pushes() -> None:
    """Along X no more than a force of 500 N on all mass; about a fixed pivot a moment turns it."""
    pushed = "frame.machine.force.x={kind='constant', amount=500.0}", "frame.machine.free=['x']"
    scene = free_boom.scene(*MACHINE, *pushed, "time.end=0.04", "frame.machine.rate.x=2.0")
    found = machine_motion(scene, free_boom.system())
    t = scene.time.step * np.arange(scene.time.steps + 1)
    np.testing.assert_allclose(found.momenta[:, 0] - found.momenta[0, 0], 500.0 * t, rtol=0.0, atol=1e-8)
    turned = "frame.machine.moment.z={kind='constant', amount=300.0}", "frame.machine.free=['rz']"
    found = machine_motion(free_boom.scene(*MACHINE, *turned, "time.end=0.04"), free_boom.system())
    np.testing.assert_allclose(found.momenta[:, 5] - found.momenta[0, 5], 300.0 * t, rtol=0.0, atol=1e-8)


def test_one_without_mass_carries_a_boom_that_is_drawn_out_with_60_m_s2() -> None:
    """What generalized-alpha leaves undamped does not grow: more damping of it leads to the same place."""
    ends = []
    for rho_inf in (0.9, 0.3):
        nothing = "frame.machine.mass=0.0", "frame.machine.inertia=[0.0, 0.0, 0.0]"
        scene = in_space("time.end=0.1", "time.step=2e-3", f"time.rho_inf={rho_inf}", *nothing)
        ends.append(machine_motion(scene, free_boom.system()).values[0, -1])
    np.testing.assert_allclose(ends[0], ends[1], rtol=0.0, atol=0.01 * np.abs(ends[1]).max())


def test_a_motion_between_steps() -> None:
    """Of degree 5 as a signal, with both rates; in degrees where the frame has them."""
    t, power = 0.1 * np.arange(4), np.polynomial.Polynomial([1.0, -2.0, 3.0, 0.5, -4.0, 6.0])
    rates = [power, power.deriv(), power.deriv(2)]
    values = np.repeat(np.array([one(t) for one in rates])[:, :, None], 6, axis=2)
    frame = free_boom.scene(*MACHINE, "frame.unit='degrees'")
    base = with_computed_motion(frame, MachineMotion(0.1, values, 0.0 * values[0], {}, 0.0 * values[0])).frame.base
    assert base is not None
    at = np.array([0.0, 0.03, 0.1, 0.17, 0.3])
    for one, of in zip(rates, ("value", "rate", "second_rate"), strict=True):
        np.testing.assert_allclose(getattr(base.x, of)(at), one(at), rtol=1e-10)
        np.testing.assert_allclose(getattr(base.ry, of)(at), np.rad2deg(one(at)), rtol=1e-10)
    assert base.x.value(0.17).shape == ()
    assert base.x.bounds(0.0, 0.3) == (min(power(t)), max(power(t)))


def test_it_does_not_stand_upright() -> None:
    adrift = "frame.machine.free=['ry']", "frame.machine.start.ry=1.5", "frame.machine.rate.ry=3.0"
    with pytest.raises(SimulationError, match="pitches by 90 degrees at t = 0.0"):
        machine_motion(free_boom.scene(*MACHINE, *adrift), free_boom.system())


REFUSED = {
    "frame.machine.free=['x', 'x']": "frame.machine.free = ['x', 'x']: each once is allowed",
    "compare.richer='next'": "compare.richer = 'next': 'auto' or 'none' is allowed beside frame.machine, which is",
    "frame.machine.free=['w']": "frame.machine.free[0] = 'w': ",
    "frame.machine.stiffness.z=1e6": "frame.machine.stiffness.z = 1000000.0: one of free is allowed: []",
    "frame.machine.mass=-1.0": "frame.machine.mass = -1.0: ",
    "frame.base.x={kind='constant', amount=1.0}; frame.machine.free=['x']": "frame.base.x: a spring or a damper in x",
    "frame.base.acceleration.x={kind='constant', amount=1.0}": "frame.base.acceleration: none is allowed beside",
    "start='equilibrium'; frame.machine.free=['rx']; frame.machine.stiffness.rx=1e6; frame.machine.start.rx=1.0": (
        "frame.machine.start.rx = 1.0: start = 'rest' is needed with it"
    ),
    "frame.second_order='auto'": "frame.second_order = 'auto': true or false is allowed beside frame.machine",
    free_boom.PUSHING[0]: "sections[1].joint.tail[0].unilateral = True: false is allowed beside frame.machine",
    "simulation.simulators=['exudyn']; frame.machine.free=['x']": "exudyn computes no motion that is free (x)",
    "section.reduction.estimate=true; accuracy.tolerance=1e-3": "accuracy: none is allowed beside frame.machine",
}


@pytest.mark.parametrize("changes", REFUSED)
def test_what_is_refused(changes: str) -> None:
    with pytest.raises(InputError) as refused:
        pmr.load_scene(free_boom.FILE, [*MACHINE, *changes.split("; ")])
    assert REFUSED[changes] in str(refused.value)
    assert "\n" not in str(refused.value)


def test_others_who_simulate_refuse_it() -> None:
    with pytest.raises(InputError, match="frame.machine: none is allowed here"):
        Excitation.from_scene(free_boom.scene(*MACHINE))


def test_a_run_says_where_it_goes_and_what_it_presses_with(tmp_path: Path) -> None:
    """Its result has the scene as it was written, and its tables the forces on the ground."""
    changes = "frame.machine.free=['z']", "frame.machine.stiffness.z=2e6", "time.end=0.02", "compare.against=['full']"
    result = pmr.run(free_boom.scene(*MACHINE, *changes)).result
    assert result.scene.frame.machine.free == ("z",)
    found, response = result.summary["frame"]["base"]["z"], result.responses["reduced"]
    units = {key: motion["unit"] for key, motion in result.summary["frame"]["base"].items()}
    assert units == dict.fromkeys(("x", "y", "z"), "m") | dict.fromkeys(("rx", "ry", "rz"), result.scene.frame.unit)
    np.testing.assert_allclose([found["min"], found["max"]], [f(response.other("machine z")) for f in (np.min, np.max)])
    assert found["max"] < 0.0
    np.testing.assert_allclose(response.other("reaction of machine z"), 2e6 * response.other("machine z"), rtol=1e-9)
    assert {"machine x", "machine z"} <= {one["name"] for one in result.summary["reactions"]}
    assert result.summary["errors"]["reduced_vs_full"]["tip"] < 0.01
    result.save(tmp_path)
    again = pmr.RunResult.load(tmp_path)
    assert again.scene == result.scene
    np.testing.assert_array_equal(again.responses["reduced"].others, response.others)
