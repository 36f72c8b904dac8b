"""A boom on a rigid body of the user's in Exudyn: held, moved, and free."""

from dataclasses import replace

import free_boom
import numpy as np
import pytest
from exudyn.utilities import ObjectGround, RigidBodyInertia, RotationMatrixY
from free_turret import KINDS, PLACE, TURRET, Turret

from pmr import InputError
from pmr.files.arrays import Array
from pmr.scene.frame import DIRECTIONS, INERTIA
from pmr.scene.mechanism import frame_terms
from pmr.scene.rotation import FrameRotation
from pmr.scene.signals import Table
from pmr.simulation import Excitation
from pmr.simulation.exudyn import NodeCoordinate, add_hook, add_sensors, simulate_system
from pmr.simulation.native import systems
from pmr.simulation.native.free_motion import machine_motion

pytestmark = pytest.mark.slow  # a boom is reduced


@pytest.mark.parametrize("changes", [(), free_boom.RUBBING], ids=["smooth", "rubbing"])
def test_held_it_is_the_boom_on_the_ground(changes: tuple[str, ...]) -> None:
    """Raised by 0.3 rad, from rest under its weight while it telescopes; what sensors tell, too."""
    scene = free_boom.scene("time.end=0.04", *changes)
    turret = Turret(scene, changes=changes, referenceRotationMatrix=RotationMatrixY(-0.3))
    turret.hold()
    start = systems.static_start(turret.system, turret.excitation)
    sensors = add_sensors(turret.mbs, turret.add(start))
    turret.solve()
    expected = systems.simulate(turret.system, turret.excitation, start)
    q = np.hstack([one.q for one in expected.bodies.values()])
    np.testing.assert_allclose(turret.q, q, rtol=0.0, atol=1e-9 * np.abs(q).max())
    assert np.abs(q - q[0]).max() > 0.01 * np.abs(q).max()
    y, forces = (turret.mbs.GetSensorStoredData(one)[:, 1:] for one in (sensors.sOutputs, sensors.sForces))
    moved = np.hstack(list(systems.displacements(turret.system, expected).values()))
    np.testing.assert_allclose(y, moved, rtol=0.0, atol=1e-9 * np.abs(moved).max())
    np.testing.assert_allclose(forces, expected.forces, rtol=0.0, atol=1e-8 * np.abs(expected.forces).max())
    if changes:
        assert expected.friction is not None and np.abs(expected.friction).max() > 1e-3 * np.abs(forces).max()


def test_moved_it_is_the_boom_in_a_frame() -> None:
    """A free turret's motion prescribed again, as loads and terms of second order, its tip pressed along."""
    pressed = "sections.fly.loads.hook x.signal={kind='constant', amount=-3000.0}"
    scene = free_boom.scene("time.end=0.04", "sections.fly.loads.gust.signal={kind='constant', amount=200.0}", pressed)
    turret = Turret(scene, "xyz", initialAngularVelocity=[0.8, -0.5, 1.1])
    turret.add()
    turret.solve()
    base = turret.base()
    out = [base.paths.extensions(t, np.empty(0), np.empty(0)) for t in turret.t]
    moved = [base.kinematics(x, x_t) for x, x_t in zip(turret.x, turret.x_t, strict=True)]
    driven = np.array([one[0] @ x_tt + one[1] for one, x_tt in zip(moved, turret.x_tt, strict=True)])
    R, omega = np.array([one[3] for one in moved]), np.array([one[2] for one in moved])
    turning = FrameRotation(omega, driven[:, 3:], R)

    def field(section: int, name: str) -> Array:
        if len(name) == 2:
            return turning.gradient[:, "xyz".index(name[0]), "xyz".index(name[1])]
        s, s_t, s_tt = (np.array([getattr(one, k)[: section + 1].sum() for one in out]) for k in vars(out[0]))
        along = np.array([1.0, 0.0, 0.0])
        found = driven[:, :3] + scene.gravity.signal.value(turret.t)[:, None] * R[:, 2] + np.outer(s_tt, along)
        found += 2.0 * np.cross(omega, np.outer(s_t, along))
        found += np.einsum("tij,tj->ti", turning.gradient, scene.frame.tail_position + np.outer(s, along))
        return found[:, "xyz".index(name)]

    def table(values: Array) -> Table:
        return Table(times=turret.t, values=values, interpolation="linear")

    loads = dict(turret.excitation.loads)
    for k, body in enumerate(turret.system.bodies):
        loads |= {
            name: table(-field(k, name.partition(INERTIA)[2])) for name in loads if name.startswith(f"{body}.{INERTIA}")
        }
    terms = dict(turret.excitation.terms)
    for one in frame_terms(scene):
        if one.kind in ("load", "cylinder load"):
            continue
        j = ["xyz".index(axis) for axis in one.component if one.kind in ("rotation", "turning", "carried")]
        if one.kind == "carried":
            found = omega[:, j[0]] * omega[:, j[1]] * (1.0 if j[0] == j[1] else 2.0)
            found = found - (omega**2).sum(axis=1) if j[0] == j[1] else found
        elif one.kind in ("rotation", "turning"):
            found = (2.0 * omega if one.kind == "rotation" else turning.acceleration)[:, j[0]]
        else:
            found = field(scene.names.index(one.carried_section) if one.carried_section else one.number, one.component)
            found = -found / np.array([o.value[one.number] for o in out]) if one.kind == "cylinder" else found
        terms[one.name] = table(found)
    again = simulate_system(turret.system, replace(turret.excitation, loads=loads, terms=terms), {})
    q = np.hstack([one.q for one in again.bodies.values()])
    np.testing.assert_allclose(turret.q, q, rtol=0.0, atol=1e-8 * np.abs(q).max())


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_free_in_space_momenta_stay_but_for_the_step(kind: str) -> None:
    """Errors of Exudyn's step, of second order as those of its own rigid bodies, so that two steps take most away."""
    found, ends = [], []
    for step in (4e-3, 2e-3):
        scene = free_boom.scene("time.end=0.04", f"time.step={step}", "frame.pivot=[0.2, 0.1, 0.3]")
        turret = Turret(
            scene.model_copy(update={"gravity": None}),
            kind,
            initialAngularVelocity=[0.8, -0.5, 1.1],
            initialVelocity=[0.4, 0.3, -0.2],
        )
        turret.add()
        turret.solve()
        p = turret.momenta()
        size = np.abs(p[0].reshape(2, 3)).max(axis=1).repeat(3)
        found.append(np.abs(p - p[0]).max(axis=0) / size)
        ends.append((p[-1] - p[0]) / size)
    coarse, fine = found
    assert coarse.max() < 2e-3
    assert np.abs((4.0 * ends[1] - ends[0]) / 3.0).max() < 0.05 * np.abs(ends[1]).max()
    np.testing.assert_allclose(coarse.max() / fine.max(), 4.0, rtol=0.1)


def test_free_in_space_friction_adds_nothing_to_momenta() -> None:
    """It acts within the boom: what remains is the error of Exudyn's step, as without friction."""
    found = []
    for changes in ((), free_boom.RUBBING):
        scene = free_boom.scene("time.end=0.04", *changes).model_copy(update={"gravity": None})
        turret = Turret(scene, changes=changes, initialAngularVelocity=[0.8, -0.5, 1.1])
        turret.add()
        turret.solve()
        found.append((turret.momenta(), turret.q))
    (smooth, q), (p, rubbed) = found
    size = np.abs(p[0].reshape(2, 3)).max(axis=1).repeat(3)
    error = np.abs(smooth - smooth[0]).max(axis=0) / size
    assert np.abs(rubbed - q).max() > 1e-2 * np.abs(q).max()
    assert (np.abs(p - p[0]).max(axis=0) / size).max() < 1.1 * error.max()


def test_free_in_space_its_energy_stays_but_for_the_step() -> None:
    """Undamped, its extension constant; with one that moves the equations are tested by themselves."""
    found, still = [], "sections.fly.joint.extension={kind='constant', amount=0.6}"
    for step in (4e-3, 2e-3):
        scene = free_boom.scene("time.end=0.04", f"time.step={step}", still).model_copy(update={"gravity": None})
        turret = Turret(scene, initialAngularVelocity=[0.8, -0.5, 1.1], initialVelocity=[0.4, 0.3, -0.2])
        turret.add()
        turret.solve()
        energy = turret.energies()
        found.append(np.abs(energy - energy[0]).max() / energy[0])
    coarse, fine = found
    assert coarse < 1e-5
    assert coarse / fine == pytest.approx(4.0, rel=0.2)


def test_free_in_space_a_spring_draws_it_out_and_energy_and_momenta_stay_but_for_the_step() -> None:
    """The extension is a coordinate of a rod on a spring, which the boom shakes as it swings."""
    found, moved = [], 0.0
    for step in (4e-3, 2e-3):
        scene = free_boom.scene("time.end=0.04", f"time.step={step}").model_copy(update={"gravity": None})
        turret = Turret(scene, initialAngularVelocity=[0.8, -0.5, 1.1], initialVelocity=[0.4, 0.3, -0.2])
        turret.draw(rod=50.0, s=0.6, rate=-0.8, spring=2e5)
        turret.add()
        turret.solve()
        energy, p = turret.energies(), turret.momenta()
        lost = np.abs(p - p[0]).max(axis=0) / np.abs(p[0].reshape(2, 3)).max(axis=1).repeat(3)
        found.append([np.abs(energy - energy[0]).max() / energy[0], lost.max()])
        moved = np.ptp(turret.z)
    coarse, fine = np.array(found)
    assert moved > 0.05
    assert coarse.max() < 1e-3
    np.testing.assert_allclose(coarse / fine, 4.0, rtol=0.2)


def test_an_extension_is_a_function() -> None:
    """As the signal with the same values, but for its rates: their error falls with the step."""
    found = []
    for step in (4e-3, 2e-3):
        scene, q = free_boom.scene("time.end=0.04", f"time.step={step}"), []
        signal = Excitation.from_scene(scene).paths["fly"]
        for path in (signal, lambda mbs, t, signal=signal: float(signal.value(t))):
            turret = Turret(scene, initialAngularVelocity=[0.8, -0.5, 1.1])
            turret.excitation = replace(turret.excitation, paths={"fly": path})
            turret.add()
            turret.solve()
            q.append(turret.q)
        found.append(np.abs(q[1] - q[0]).max() / np.abs(q[0]).max())
    coarse, fine = found
    assert fine < 0.01  # 0.76 %, and 0.22 % with half the step
    assert coarse / fine > 2.5  # on its way to 4


def test_a_heavy_rod_draws_it_out_as_a_signal_does() -> None:
    """With weight, and a load that presses it along, by which it and its cylinder lean."""
    pressed = "sections.fly.loads.hook x.signal={kind='constant', amount=-3000.0}"
    scene, q = free_boom.scene("time.end=0.04", pressed), []
    for rod in (None, 1e9):
        turret = Turret(scene, initialAngularVelocity=[0.8, -0.5, 1.1])
        steady = Table(times=[0.0, 1.0], values=[0.6, 1.1], interpolation="linear")
        turret.excitation = replace(turret.excitation, paths={"fly": steady})
        if rod is not None:
            turret.draw(rod, s=0.6, rate=0.5)
        turret.add()
        turret.solve()
        q.append(turret.q)
    np.testing.assert_allclose(q[1], q[0], rtol=0.0, atol=1e-6 * np.abs(q[0]).max())


def test_on_pads_that_push() -> None:
    """Held and raised, some pads open: as on the ground, but for how weight bends what is between pads at once."""
    scene = free_boom.scene("time.end=0.04", *free_boom.PUSHING)
    steady, q = Table(times=[0.0, 1.0], values=[0.5, 1.0], interpolation="linear"), []
    ramp = Excitation.from_scene(scene).paths["fly"]
    for path, rod in ((ramp, None), (steady, None), (None, 1e9)):
        turret = Turret(scene, changes=free_boom.PUSHING, referenceRotationMatrix=RotationMatrixY(-0.3))
        turret.hold()
        start = systems.static_start(turret.system, turret.excitation)
        if path is None:
            turret.draw(rod, s=0.5, rate=0.5)
        else:
            turret.excitation = replace(turret.excitation, paths={"fly": path})
        turret.add(start)
        turret.solve()
        q.append(turret.q)
    given = Excitation.from_scene(scene)
    whole = given.with_stepping(replace(given.stepping, parts=1))
    expected = systems.simulate(turret.system, whole, start)
    on_ground = np.hstack([one.q for one in expected.bodies.values()])
    assert np.abs(q[0] - on_ground).max() < 1e-4 * np.abs(on_ground).max()
    np.testing.assert_allclose(q[2], q[1], rtol=0.0, atol=1e-6 * np.abs(q[1]).max())
    assert 0 < np.count_nonzero(expected.forces[-1]) < len(expected.forces[-1])


def test_on_springs_it_is_march_s_with_a_machine_on_supports_that_give_way() -> None:
    """A rigid body at the tail on six springs, blown at from the side while it telescopes: where its tip is."""
    stiffness, mass, inertia = 2e5, 500.0, [100.0, 120.0, 80.0]
    gust = "sections.fly.loads.gust.signal={kind='sine', amplitude=100.0, frequency=3.0}"
    slow = "sections.fly.joint.extension={kind='smooth_ramp', times=[0.0, 1.0], values=[0.5, 0.9]}"
    springs = ", ".join(
        f"{{name='springs{turn}', on='tail', directions={[turn + one for one in 'xyz']}, stiffness={stiffness}}}"
        for turn in ("", "r")
    )
    machine = f"sections.base.masses=[{{name='machine', on='tail', mass={mass}, inertia={inertia}}}]"
    changes = ("time.end=0.2", gust, slow, f"sections.base.supports=[{springs}]", machine)
    scene, system = free_boom.scene(*changes).model_copy(update={"gravity": None}), free_boom.system(*changes)
    moved = systems.displacements(system, systems.simulate(system, Excitation.from_scene(scene)))["fly"]
    expected = moved[:, system.bodies["fly"].output_names.index("tip y")]

    own = free_boom.scene("time.end=0.2", gust, slow).model_copy(update={"gravity": None})
    turret = Turret(own)
    turret.body = turret.mbs.CreateRigidBody(inertia=RigidBodyInertia(mass, np.diag(inertia)))
    turret.mbs.CreateRigidBodySpringDamper(
        itemNumbers=[turret.mbs.CreateGround(), turret.body], stiffness=stiffness * np.eye(6)
    )
    turret.on = replace(turret.on, body=turret.body, place=tuple(-one for one in own.frame.tail_position))
    sensors = add_sensors(turret.mbs, turret.add())
    turret.solve()
    y = turret.mbs.GetSensorStoredData(sensors.sOutputs)[:, 1:]
    y, z = (y[:, sensors.output_names.index(f"fly: tip {one}")] for one in "yz")
    tip = np.column_stack([own.extension(1).value(turret.t) + 2.0, y, z])
    base = turret.base()
    turned = np.array([base.kinematics(x, 0.0 * x)[3] for x in turret.x])
    found = turret.x[:, 1] + np.einsum("tj,tj->t", turned[:, 1], tip)
    assert np.abs(found - expected).max() < 1e-4 * np.abs(expected).max()
    assert np.abs(y).max() < 0.1 * np.abs(expected).max()  # the springs give way, the boom hardly


def test_what_is_refused() -> None:
    turret = Turret(free_boom.scene())
    turret.excitation = replace(turret.excitation, paths={"fly": 0.6})
    with pytest.raises(InputError, match="paths.fly"):
        turret.add()
    turret = Turret(free_boom.scene())
    turret.draw(rod=50.0, s=0.6, rate=0.0)
    turret.excitation = replace(turret.excitation, paths={"fly": NodeCoordinate(turret.rods[0], 1)})
    with pytest.raises(InputError, match="from 0 to 0"):
        turret.add()
    turret = Turret(free_boom.scene(*free_boom.RUBBING), changes=free_boom.RUBBING)
    with pytest.raises(InputError, match="a boom with a hook: friction"):
        add_hook(turret.mbs, turret.add(), ("fly.hook x", "fly.hook y", "fly.hook z"), 10.0)
    turret.draw(rod=50.0, s=0.6, rate=0.0)
    with pytest.raises(InputError, match="an extension that is a coordinate: friction"):
        turret.add()
    turret = Turret(free_boom.scene())
    turret.on = replace(turret.on, body=turret.mbs.AddObject(ObjectGround()))
    with pytest.raises(InputError, match="rigid body"):
        turret.add()
    for axes in (np.diag([1.0, 1.0, -1.0]), 2.0 * np.eye(3), np.full((3, 3), np.nan), np.eye(2)):
        with pytest.raises(InputError, match=r"OnBody.axes: a matrix \(3, 3\) of three orthogonal unit vectors"):
            replace(turret.on, axes=axes)


def test_free_in_space_a_machine_of_march_moves_as_it_but_for_the_step() -> None:
    """The same body below the same boom: what both differ by is of second order in the step."""
    still, own = ("frame.luffing.amount=0.0", "time.end=0.04"), TURRET.Translated(-np.array(PLACE))
    spin, speed = np.array([0.8, -0.5, 1.1]), np.array([0.4, 0.3, -0.2])
    assert not (own.InertiaCOM() - np.diag(np.diag(own.InertiaCOM()))).any()
    rates = dict(zip(DIRECTIONS, np.append(speed + np.cross(spin, PLACE), spin).tolist(), strict=True))
    body = f"mass={own.mass}, center={own.com.tolist()}, inertia={np.diag(own.InertiaCOM()).tolist()}"
    moves = ", ".join(f"{key}={value}" for key, value in rates.items())
    machine = f"frame.machine={{{body}, free={list(DIRECTIONS)}, rate={{{moves}}}}}"
    apart = []
    for step in (2e-3, 1e-3):
        scene = free_boom.scene(*still, f"time.step={step}").model_copy(update={"gravity": None})
        turret = Turret(scene, initialAngularVelocity=spin, initialVelocity=speed)
        turret.add()
        turret.solve()
        base = turret.base()
        place, R = (
            np.array([base.origin(x) for x in turret.x]),
            np.array([base.kinematics(*x)[3] for x in zip(turret.x, turret.x_t, strict=True)]),
        )
        scene = free_boom.scene(*still, f"time.step={step}", machine, "start='rest'").model_copy(
            update={"gravity": None}
        )
        found = machine_motion(scene, turret.system).values
        turned = FrameRotation.from_rocking([tuple(found[:, :, 3 + j]) for j in range(3)]).rotation
        apart.append([np.abs(found[0, :, :3] - place + place[0]).max(), np.abs(turned - R).max()])
    coarse, fine = np.array(apart)
    assert np.all(coarse < 1e-5)
    np.testing.assert_allclose(coarse / fine, 4.0, rtol=0.1)
