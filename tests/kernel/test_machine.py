"""A machine that carries a boom: its momenta and what has to hold it, beside the boom's equations in NumPy."""

from dataclasses import replace

import free_boom
import momenta
import numpy as np
import pytest

from pmr import InputError, SimulationError
from pmr.files.arrays import Array
from pmr.kernel.state import Settings, State
from pmr.scene.frame import DIRECTIONS
from pmr.scene.rotation import FrameRotation
from pmr.simulation.free_base import Extensions, FrameMotion, FreeBase, base_equations
from pmr.simulation.native.machine import MachineRun, MachineSimulation, modes_in_bodies
from pmr.system.assembly import Assembly
from pmr.system.changing_rows import ChangingRows, EliminatedContacts

pytestmark = pytest.mark.slow  # a boom is reduced

MASS, CENTER, INERTIA = 300.0, np.array([0.1, 0.2, -0.3]), np.array([40.0, 60.0, 50.0])
FORCE, MOMENT = np.array([0.0, 700.0, 0.0]), np.array([0.0, 0.0, 300.0])
STIFFNESS, DAMPING = np.array([1e5, 0.0, 0.0, 2e5, 0.0, 0.0]), np.array([1e3, 0.0, 0.0, 0.0, 0.0, 0.0])
SOFT = ("section.joint.cylinder.stiffness=1e8",)
SCENE = (
    *SOFT,
    f"frame.machine={{mass={MASS}, center={CENTER.tolist()}, inertia={INERTIA.tolist()}}}",
    f"frame.machine.free={list(DIRECTIONS)}",
    "frame.machine.stiffness={x=1e5, rx=2e5}",
    "frame.machine.damping={x=1e3}",
    f"frame.machine.force.y={{kind='constant', amount={FORCE[1]}}}",
    f"frame.machine.moment.z={{kind='constant', amount={MOMENT[2]}}}",
    "frame.luffing={kind='sine', amplitude=0.4, frequency=0.7, offset=0.3}",
    "sections.fly.loads.3.signal={kind='constant', amount=90.0}",
    "sections.fly.joint.extension={kind='sine', amplitude=0.1, frequency=2.0, offset=0.7, phase=0.6}",
    "start='rest'",
)


@pytest.fixture(scope="module")
def run() -> MachineRun:
    return MachineRun(free_boom.scene(*SCENE), free_boom.system(*SOFT))


class Oracle:
    """Machine and boom at t = 0: extension (3,) and machine (3, 6) with rates; the boom's coordinates q, q' and q''."""

    def __init__(self, extension: Array, motion: Array, q: Array, rate: Array, second: Array) -> None:
        scene, system, t = free_boom.scene(*SCENE), free_boom.system(*SOFT), np.zeros(1)
        assembly = Assembly(system)
        equations, along = FreeBase(scene, system, assembly), ChangingRows(assembly, scene.names)
        orders = ("value", "rate", "second_rate")
        out = Extensions(*(np.array([0.0, value]) for value in extension))
        gives = np.any(along.evaluate(out.value).rows.F != 0.0, axis=1)
        moments = equations.moments_with_contacts(EliminatedContacts(assembly, along, gives), out)
        luffing, slewing = (tuple(getattr(angle, order)(t) for order in orders) for angle in scene.frame.angles)
        rocking = [tuple(motion[:, 3 + j, None]) for j in range(3)]
        boom, base = FrameRotation.from_angles(luffing, slewing, rocking), FrameRotation.from_rocking(rocking)
        R, Rb, omega, alpha = boom.rotation[0], base.rotation[0], base.velocity[0], base.acceleration[0]
        x, v, a = motion[:, :3]
        turning = FrameMotion(boom.velocity[0], np.zeros(3))
        p = momenta.momentum(equations, turning, R.T @ v, out, q, rate, moments)
        linear = MASS * (v + Rb @ np.cross(omega, CENTER))
        P = R @ p[:3] + linear
        L = R @ p[3:] + np.cross(Rb @ CENTER, linear) + Rb @ (INERTIA * omega)
        self.momenta = np.append(P, L + np.cross(x, P))
        pressed = base_equations(equations.boom, turning, out, q, rate, moments)
        accelerations = np.concatenate([R.T @ a, boom.acceleration[0], second, out.second])
        own = (pressed.forces + pressed.mass @ accelerations)[:6]
        linear = MASS * (a + Rb @ (np.cross(alpha, CENTER) + np.cross(omega, np.cross(omega, CENTER))))
        turned = Rb @ (INERTIA * alpha + np.cross(omega, INERTIA * omega)) + np.cross(Rb @ CENTER, linear)
        first = R @ pressed.mass[[1, 2, 0], [5, 3, 4]] + MASS * (Rb @ CENTER)
        weight = np.array([0.0, 0.0, -scene.gravity.signal.value(0.0)])
        loads = equations.load_wrench(np.array([90.0 * name.endswith("gust") for name in system.input_names]), out)
        force = (equations.boom.mass + MASS) * weight + R @ loads[:3] + FORCE
        moment = np.cross(first, weight) + R @ loads[3:] + MOMENT
        axes = np.stack([Rb[:, 0], [-np.sin(motion[0, 5]), np.cos(motion[0, 5]), 0.0], [0.0, 0.0, 1.0]], axis=1)
        needed = np.append(R @ own[:3] + linear - force, axes.T @ (R @ own[3:] + turned - moment))
        self.holding_forces = needed + STIFFNESS * motion[0] + DAMPING * motion[1]


@pytest.mark.numerical
def test_momenta_and_what_holds_it_are_those_of_the_equations(run: MachineRun) -> None:
    """Where machine and boom move anyhow, the boom telescopes, and contacts give way by residual flexibility."""
    rng, r = np.random.default_rng(3), run.simulation.state.kernel.modes
    modes = modes_in_bodies(run.form)
    extension = run.machine["motions"][0, :, 0]  # its second rate is spread over a step
    assert extension.all()
    for _ in range(3):
        motion = rng.uniform(-1.0, 1.0, (3, 6))
        z, v, a = rng.normal(size=(3, r)) * [[0.02], [0.5], [20.0]]
        oracle = Oracle(extension, motion, modes @ z, modes @ v, modes @ a)
        needed = run.simulation.holding_forces(motion, z, v, a)
        for part in (slice(3), slice(3, 6)):
            size = np.abs(oracle.holding_forces[part]).max()
            np.testing.assert_allclose(needed[part], oracle.holding_forces[part], rtol=0.0, atol=1e-11 * size)
        run.simulation.start(motion, z, v)
        np.testing.assert_allclose(
            run.simulation.momenta[0], oracle.momenta, rtol=0.0, atol=1e-11 * np.abs(oracle.momenta).max()
        )


@pytest.mark.numerical
def test_momenta_change_by_forces_that_are_averaged_as_accelerations_are() -> None:
    """Upwards, where nothing but weight acts, which rises.

    Rates are found to 1e-9 of the fastest at worst, also those of the angles, at whose levers all mass is within 3 m.
    """
    scene = free_boom.scene(*(change for change in SCENE if "loads" not in change))
    run = MachineRun(scene, free_boom.system(*SOFT))
    mass = FreeBase(scene, free_boom.system(*SOFT)).boom.mass + MASS
    h, rho = run.simulation.state.settings.step, run.simulation.state.settings.rho_inf
    am, af = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
    gamma = 0.5 + af - am
    motion, force = run.run(), -mass * run.machine["weight"]
    momenta, within = motion.momenta[:, 2], 1e-9 * mass * (1.0 + 3.0) * np.abs(motion.values[1]).max()
    expected, smooth = momenta[0], force[0]
    for k in range(1, len(force)):
        last, smooth = smooth, ((1.0 - af) * force[k] + af * force[k - 1] - am * smooth) / (1.0 - am)
        expected += h * ((1.0 - gamma) * last + gamma * smooth)
        assert momenta[k] == pytest.approx(expected, abs=within)
    assert np.ptp(force) > 0.01 * mass


def test_what_it_cannot_carry_is_refused(run: MachineRun) -> None:
    """Steps in parts have momenta of their own."""
    kernel = run.simulation.state.kernel
    for settings in (Settings(1e-3, parts=(1, 2), energy=False), Settings(1e-3, energy=True)):
        with pytest.raises(InputError, match="a frame with a base that moves"):
            MachineSimulation(State(kernel, settings), run.machine)


def test_no_more_steps_are_taken_than_there_are_motions(run: MachineRun) -> None:
    nothing, steps = np.zeros(run.simulation.state.kernel.modes), len(run.machine["motions"])
    run.simulation.start(np.zeros((3, 6)), nothing, nothing)
    for count in (-1, steps):
        with pytest.raises(InputError, match=f"0 to {steps - 1}"):
            run.simulation.advance(count)
    run.simulation.advance(2)
    with pytest.raises(InputError, match=f"0 to {steps - 3}"):
        run.simulation.advance(steps - 2)
    assert run.simulation.number == 2


def test_a_step_that_fails_leaves_machine_and_boom_where_the_last_one_ended() -> None:
    """Upright, where roll and yaw turn about one axis; another motion there goes on as if nothing had been."""
    held = [change for change in SCENE if not change.startswith(("frame.machine.free", "frame.machine.stiff"))]
    held += ["frame.machine.free=['x', 'y', 'z']", "frame.machine.stiffness={x=1e5}"]
    run = MachineRun(free_boom.scene(*held), free_boom.system(*SOFT))
    nothing, given = np.zeros(run.simulation.state.kernel.modes), run.machine["base_motion"].copy()
    ends = list[bytes]()
    for turned in (0.0, np.pi / 2.0):
        state = State(run.simulation.state.kernel, run.simulation.state.settings)
        carried = MachineSimulation(state, run.machine | {"base_motion": given})
        carried.start(given[0], nothing, nothing)
        carried.advance(2)
        stood = carried.state.save()
        given[3, 0, 4] += turned
        if turned:
            with pytest.raises(SimulationError, match="90 degrees"):
                carried.advance(1)
            assert carried.state.save() == stood and carried.number == 2
            given[3, 0, 4] -= turned
        carried.advance(2)
        ends.append(carried.state.save())
    assert ends[0] == ends[1]


def test_contacts_that_depend_on_each_other_are_told() -> None:
    """Two in one place, of which both give way by residual flexibility alone."""
    system = free_boom.system(*SOFT)
    contact = replace(system.contacts[0], compliance=0.0)
    twice = (contact, replace(contact, name="again"), *system.contacts[1:])
    run = MachineRun(free_boom.scene(*SCENE), replace(system, contacts=twice))
    nothing = np.zeros(run.simulation.state.kernel.modes)
    with pytest.raises(SimulationError, match="again depends on those before it"):
        run.simulation.holding_forces(np.zeros((3, 6)), nothing, nothing, nothing)
