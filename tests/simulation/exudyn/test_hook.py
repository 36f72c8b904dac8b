"""What hangs on the hook of a boom on a rigid body in Exudyn."""

from dataclasses import replace
from typing import Any

import exudyn as exu
import free_boom
import numpy as np
import pytest
from exudyn.utilities import MarkerNodePosition, ObjectConnectorDistance, SensorNode, SensorObject
from free_turret import Turret

import pmr
from pmr import InputError
from pmr.scene import Scene
from pmr.simulation.exudyn import Hook, add_hook
from pmr.simulation.free_base import with_all_inertia
from pmr.simulation.native import systems
from pmr.system.from_scene import system_of

pytestmark = pytest.mark.slow  # a boom is reduced
LOADS = ("fly.hook x", "fly.hook y", "fly.hook z")
LEVEL = "frame.luffing={kind='constant', amount=0.0}"
HOOK, LENGTH, GRAVITY = 5.0, 0.1, 9.81


class Hooked(Turret):
    """A boom on a turret that is held, without weight unless it has one here, with a hook."""

    def __init__(self, scene: Scene, mass: float, weighs: bool = False) -> None:
        super().__init__(scene if weighs else scene.model_copy(update={"gravity": None}))
        ground = self.mbs.CreateGround()
        self.mbs.CreateGenericJoint(itemNumbers=[ground, self.body], position=[0.0, 0.0, 0.0])
        self.add()
        self.hook: Hook = add_hook(self.mbs, self.items, LOADS, mass)

    def follow(self, node: Any) -> Any:
        """A sensor of where a node is."""
        kind = exu.OutputVariableType.Position
        return self.mbs.AddSensor(SensorNode(nodeNumber=node, outputVariableType=kind, storeInternal=True))


def test_a_mass_on_the_hook_is_one_of_the_scene() -> None:
    """Pushed from the side while it telescopes, with what makes the boom shorter as it bends."""
    gust = "sections.fly.loads.gust.signal={kind='sine', amplitude=300.0, frequency=4.0}"
    changes = ("time.end=0.05", LEVEL, gust)
    scene = free_boom.scene(*changes)
    turret = Hooked(scene, HOOK)
    sensor = turret.follow(turret.hook.nHook)
    turret.solve(tolerance=1e-9)
    place = turret.mbs.GetSensorStoredData(sensor)[:, 1:]
    heavy = free_boom.scene(*changes, f"sections.fly.masses.payload.mass={20.0 + HOOK}")
    system = with_all_inertia(system_of(heavy, pmr.reduce(heavy).reduced))
    expected, bare = (
        systems.displacements(one, systems.simulate(one, turret.excitation))["fly"] for one in (system, turret.system)
    )
    y = system.bodies["fly"].output_names.index("tip y")
    moved, largest = place[:, 1] - place[0, 1], np.abs(expected[:, y]).max()
    assert np.abs(moved - expected[:, y]).max() < 1e-6 * largest
    assert np.abs(bare - expected)[:, y].max() > 0.03 * largest


def test_a_hook_weighs_as_the_scene_has_it() -> None:
    """Newton's law of the hook: what it pulls the boom with is its weight, and its mass times how it accelerates."""
    still = "sections.fly.joint.extension={kind='constant', amount=0.6}"
    scene = free_boom.scene("time.end=0.05", LEVEL, still, "gravity.rise=0.0")
    turret, kinds = Hooked(scene, 200.0, weighs=True), exu.OutputVariableType
    of_node, of_joint = {"nodeNumber": turret.hook.nHook}, {"objectNumber": turret.hook.oJoint}
    moved = SensorNode(**of_node, outputVariableType=kinds.Acceleration, storeInternal=True)
    pulled = SensorObject(**of_joint, outputVariableType=kinds.Force, storeInternal=True)
    sensors = [turret.mbs.AddSensor(one) for one in (moved, pulled)]
    turret.solve(tolerance=1e-8)
    a, f = (turret.mbs.GetSensorStoredData(sensor)[1:, 3] for sensor in sensors)
    assert scene.gravity is not None and scene.gravity.acceleration == pytest.approx(9.80665)
    np.testing.assert_allclose(f, -200.0 * (9.80665 + a), atol=1e-4 * 200.0 * 9.80665)
    assert np.ptp(f) > 0.05 * 200.0 * 9.80665


def test_a_payload_on_a_rope_swings_as_a_pendulum() -> None:
    still = "sections.fly.joint.extension={kind='constant', amount=0.6}"
    turret = Hooked(free_boom.scene("time.end=0.5", "time.step=5e-3", LEVEL, still), 0.5)
    top = np.array(turret.mbs.GetNode(turret.hook.nHook)["referenceCoordinates"])
    place = top + LENGTH * np.array([0.0, np.sin(0.02), -np.cos(0.02)])
    load = turret.mbs.CreateMassPoint(referencePosition=place, mass=0.5, gravity=[0.0, 0.0, -GRAVITY], returnDict=True)
    marker = turret.mbs.AddMarker(MarkerNodePosition(nodeNumber=load["nodeNumber"]))
    turret.mbs.AddObject(ObjectConnectorDistance(markerNumbers=[turret.hook.mHook, marker], distance=LENGTH))
    sensor = turret.follow(load["nodeNumber"])
    turret.solve(tolerance=1e-6)
    y, t = turret.mbs.GetSensorStoredData(sensor)[:, 2] - top[1], turret.t
    before = np.flatnonzero(y[:-1] * y[1:] < 0.0)
    first, second = (t[k] - y[k] * (t[k + 1] - t[k]) / (y[k + 1] - y[k]) for k in before)
    assert 2.0 * (second - first) == pytest.approx(2.0 * np.pi * np.sqrt(LENGTH / GRAVITY), rel=1e-3)


def test_adrift_with_a_mass_on_the_hook_while_a_spring_draws_it_out_energy_and_momenta_stay_but_for_the_step() -> None:
    """The extension is a coordinate that feels what pulls on the hook, and what gives way to it."""
    found = []
    for step in (4e-3, 2e-3):
        scene = free_boom.scene("time.end=0.04", f"time.step={step}").model_copy(update={"gravity": None})
        turret = Turret(scene, initialAngularVelocity=[0.8, -0.5, 1.1], initialVelocity=[0.4, 0.3, -0.2])
        turret.draw(rod=50.0, s=0.6, rate=-0.8, spring=2e5)
        turret.add()
        hook = add_hook(turret.mbs, turret.items, LOADS, 40.0)
        kinds = exu.OutputVariableType
        sensors = [
            turret.mbs.AddSensor(SensorNode(nodeNumber=hook.nHook, outputVariableType=kind, storeInternal=True))
            for kind in (kinds.Position, kinds.Velocity)
        ]
        pulled = turret.mbs.AddSensor(
            SensorObject(objectNumber=hook.oJoint, outputVariableType=kinds.Force, storeInternal=True)
        )
        turret.solve()
        x, v, f = (turret.mbs.GetSensorStoredData(sensor)[:, 1:] for sensor in (*sensors, pulled))
        base, numbers = turret.base(), [turret.system.input_names.index(name) for name in LOADS]
        paths = [
            base.paths.extensions(t, z, z_t).value for t, z, z_t in zip(turret.t, turret.z, turret.z_t, strict=True)
        ]
        E = np.array([base.answering.response(s).E[np.ix_(numbers, numbers)] for s in paths])
        energy = turret.energies() + 20.0 * (v**2).sum(axis=1) + np.einsum("ti,tij,tj->t", f, E, f) / 2.0
        p = turret.momenta() + np.hstack([40.0 * v, np.cross(x, 40.0 * v)])
        lost = np.abs(p - p[0]).max(axis=0) / np.abs(p[0].reshape(2, 3)).max(axis=1).repeat(3)
        found.append([np.abs(energy - energy[0]).max() / energy[0], lost.max()])
        assert np.abs(f).max() > 100.0
    coarse, fine = np.array(found)
    assert coarse.max() < 2e-4
    np.testing.assert_allclose(coarse / fine, 4.0, rtol=0.25)


def test_what_is_refused() -> None:
    turret = Turret(free_boom.scene())
    turret.add()
    for loads, says in (
        (("fly.hook x", "fly.hook y", "fly.rope"), "fly.rope"),
        (("fly.hook x", "fly.hook z", "fly.hook y"), "forces along x, y and z at one place"),
    ):
        with pytest.raises(InputError, match=says):
            add_hook(turret.mbs, turret.items, loads, HOOK)
    with pytest.raises(InputError, match="mass = -1.0: 0 kg or more"):
        add_hook(turret.mbs, turret.items, LOADS, -1.0)
    with pytest.raises(InputError, match="on a rigid body"):
        add_hook(turret.mbs, replace(turret.items, parts=replace(turret.items.parts, base=None)), LOADS, HOOK)
