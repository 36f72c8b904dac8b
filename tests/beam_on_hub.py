"""Soft beam clamped to a hub that is hinged to a cart, in three models: ANCF cables, a reduced body, and a machine.

All move in the plane of X and Z; angles turn X towards Z.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import exudyn as exu
import numpy as np
from exudyn.itemInterface import (
    LoadForceVector,
    LoadMassProportional,
    LoadTorqueVector,
    MarkerBodyMass,
    MarkerBodyRigid,
    MarkerNodeCoordinate,
    MarkerNodePosition,
    MarkerNodeRigid,
    NodePoint2D,
    NodePointGround,
    NodeRigidBody2D,
    ObjectConnectorCoordinate,
    ObjectJointGeneric,
    ObjectJointRevolute2D,
    ObjectMassPoint2D,
    ObjectRigidBody2D,
    SensorBody,
    SensorNode,
)
from exudyn.utilities import RigidBodyInertia, RotationMatrixY
from soft_boom import Beam, settings

import pmr
from pmr.files.arrays import Array
from pmr.scene import Scene
from pmr.scene.frame import Machine, PivotLoad
from pmr.scene.keys import ALONE
from pmr.scene.signals import Constant, Table
from pmr.simulation import Excitation
from pmr.simulation.exudyn import OnBody, add_sensors, add_system
from pmr.system.from_scene import system_of

OfTime = Callable[[float], float]
FILE = Path(__file__).parent / "simulation" / "exudyn" / "soft_beam.toml"
BREADTH, DEPTH, WALL = 0.22, 0.32, 0.006  # m, of the file's box
AREA = 2.0 * (BREADTH + DEPTH) * WALL
SECOND_MOMENT = BREADTH * WALL * DEPTH**2 / 2.0 + WALL * DEPTH**3 / 6.0
DENSITY, LENGTH = 7850.0, 6.0
KIND = exu.OutputVariableType


def _nothing(t: float) -> float:
    """Zero at all times."""
    return 0.0


@dataclass(frozen=True)
class Hub:
    """Cart and hub that carry the beam, and what drives them."""

    young: float  # N/m^2, of the beam
    angle: float  # rad, at rest
    inertia: float  # kg m^2, of the hub about its hinge
    cart: float | None  # kg, free along X; None: the hinge stands still
    push: OfTime = _nothing  # N on the cart
    torque: OfTime = _nothing  # N m on the hub
    mass: float = 10.0  # kg, of the hub


@dataclass(frozen=True)
class Swing:
    """Motion of cart, hub and tip at T times, each (T,)."""

    cart: Array  # m
    angle: Array  # rad, of the hub
    deflection: Array  # m, of the tip from the hub's axis


def as_cable(hub: Hub, scene: Scene) -> Swing:
    """Simulate ANCF cables of Exudyn that stretch as the beam does, with the scene's weight and steps."""
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    beam = Beam(LENGTH, hub.young * AREA, hub.young * SECOND_MOMENT, DENSITY * AREA, 0.0, 0.0)
    nodes, elements = beam.add(mbs, np.zeros(2), np.array([np.cos(hub.angle), np.sin(hub.angle)]))
    if scene.gravity is not None:
        weight = scene.gravity.signal
        for element in elements:
            marker = mbs.AddMarker(MarkerBodyMass(bodyNumber=element))
            falling = {"loadVectorUserFunction": lambda mbs, t, load: [0.0, -float(weight.value(t)), 0.0]}
            mbs.AddLoad(LoadMassProportional(markerNumber=marker, loadVector=[0.0] * 3, **falling))
    ground = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=mbs.AddNode(NodePointGround()), coordinate=0))
    cart = mbs.AddNode(NodePoint2D(referenceCoordinates=[0.0, 0.0]))
    mbs.AddObject(ObjectMassPoint2D(mass=hub.cart or 1.0, nodeNumber=cart))
    for k in (0, 1) if hub.cart is None else (1,):
        held = [ground, mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=cart, coordinate=k))]
        mbs.AddObject(ObjectConnectorCoordinate(markerNumbers=held))
    own = mbs.AddNode(NodeRigidBody2D(referenceCoordinates=[0.0, 0.0, hub.angle]))
    mbs.AddObject(ObjectRigidBody2D(mass=hub.mass, inertia=hub.inertia, nodeNumber=own))
    hinge, on_hub = mbs.AddMarker(MarkerNodePosition(nodeNumber=cart)), mbs.AddMarker(MarkerNodeRigid(nodeNumber=own))
    mbs.AddObject(ObjectJointRevolute2D(markerNumbers=[hinge, on_hub]))
    tail = mbs.AddMarker(MarkerBodyRigid(bodyNumber=elements[0], localPosition=[0.0, 0.0, 0.0]))
    mbs.AddObject(ObjectJointGeneric(markerNumbers=[on_hub, tail], constrainedAxes=[1, 1, 0, 0, 0, 1]))
    pushed = {"loadVectorUserFunction": lambda mbs, t, load: [hub.push(t), 0.0, 0.0]}
    mbs.AddLoad(LoadForceVector(markerNumber=hinge, loadVector=[0.0] * 3, **pushed))
    turned = {"loadVectorUserFunction": lambda mbs, t, load: [0.0, 0.0, hub.torque(t)]}
    mbs.AddLoad(LoadTorqueVector(markerNumber=on_hub, loadVector=[0.0] * 3, **turned))
    asked = ((nodes[-1], KIND.Position), (cart, KIND.Position), (own, KIND.Coordinates))
    sensors = [mbs.AddSensor(SensorNode(nodeNumber=n, outputVariableType=k, storeInternal=True)) for n, k in asked]
    tip, at, moved = _solved(mbs, settings(beam), scene, sensors)
    angle, (x, z) = hub.angle + moved[:, 2], (tip - at)[:, :2].T
    return Swing(at[:, 0], angle, z * np.cos(angle) - x * np.sin(angle))


def as_reduced(hub: Hub, scene: Scene) -> Swing:
    """Simulate the scene's reduced beam on rigid bodies of Exudyn, in space."""
    system, excitation = system_of(scene, {ALONE: pmr.reduce(scene).reduced}), Excitation.from_scene(scene)
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    ground = mbs.CreateGround()
    cart = mbs.CreateRigidBody(inertia=RigidBodyInertia(hub.cart or 1.0, np.eye(3)))
    mbs.CreateGenericJoint(
        itemNumbers=[ground, cart], position=[0.0] * 3, constrainedAxes=[int(hub.cart is None), 1, 1, 1, 1, 1]
    )
    inertia, turned = RigidBodyInertia(hub.mass, hub.inertia * np.eye(3)), RotationMatrixY(-hub.angle)
    own = mbs.CreateRigidBody(inertia=inertia, referenceRotationMatrix=turned)
    mbs.CreateRevoluteJoint(itemNumbers=[cart, own], position=[0.0] * 3, axis=[0.0, 1.0, 0.0], useGlobalFrame=True)
    pushed, turning = (lambda mbs, t, load: [hub.push(t), 0.0, 0.0]), (lambda mbs, t, load: [0.0, -hub.torque(t), 0.0])
    mbs.CreateForce(itemNumber=cart, loadVector=[0.0] * 3, loadVectorUserFunction=pushed)
    mbs.CreateTorque(itemNumber=own, loadVector=[0.0] * 3, loadVectorUserFunction=turning)
    loads = {name: load for name, load in excitation.loads.items() if "inertia" not in name}
    items = add_system(mbs, system, excitation.paths, loads, on=OnBody(own, scene))
    outputs = add_sensors(mbs, items)
    asked = ((cart, KIND.Position), (own, KIND.RotationMatrix))
    sensors = [mbs.AddSensor(SensorBody(bodyNumber=b, outputVariableType=k, storeInternal=True)) for b, k in asked]
    at, rotation, moved = _solved(mbs, exu.SimulationSettings(), scene, [*sensors, outputs.sOutputs])
    angle = np.unwrap(np.arctan2(rotation[:, 6], rotation[:, 0]))
    return Swing(at[:, 0], angle, moved[:, outputs.output_names.index("tip z")])


def as_machine(hub: Hub, scene: Scene) -> Swing:
    """Simulate the scene's reduced beam by pmr on a machine that is cart and hub in one."""
    t, axis = scene.time.step * np.arange(scene.time.steps + 1), ["ry"] if hub.cart is None else ["x", "ry"]
    push, torque = (Table(times=t, values=[of(at) for at in t]) for of in (hub.push, lambda at: -hub.torque(at)))
    machine = Machine.model_validate(
        {"mass": hub.mass + (hub.cart or 1.0), "inertia": [hub.inertia] * 3, "free": axis}
    ).model_copy(update={"force": PivotLoad.model_construct(x=push), "moment": PivotLoad.model_construct(y=torque)})
    frame = scene.frame.model_copy(update={"machine": machine, "luffing": Constant(amount=hub.angle)})
    moved = scene.model_copy(update={"frame": frame})
    found = pmr.simulate(moved, pmr.reduce(moved).reduced)
    angle = hub.angle - found.other("machine ry")
    return Swing(found.other("machine x"), angle, found.of("tip", direction="z")[:, 0])


def scene_of(hub: Hub, *changes: str) -> Scene:
    """Load the scene with the hub's beam and further settings."""
    return pmr.load_scene(FILE, [f"sections.beam.body.material.young={hub.young}", *changes])


def _solved(mbs: exu.MainSystem, chosen: exu.SimulationSettings, scene: Scene, sensors: list) -> list[Array]:
    """Assemble and solve; return what each sensor stored, (T, k)."""
    mbs.Assemble()
    chosen.solution.file.write = False
    chosen.solution.sensors.writePeriod = scene.time.step
    integration = chosen.timeIntegration
    integration.endTime, integration.numberOfSteps, integration.verboseMode = scene.time.end, scene.time.steps, 0
    integration.generalizedAlpha.spectralRadius = scene.time.rho_inf
    mbs.SolveDynamic(chosen)
    return [mbs.GetSensorStoredData(sensor)[:, 1:] for sensor in sensors]
