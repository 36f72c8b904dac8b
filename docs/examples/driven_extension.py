"""
A boom drawn out by a cylinder whose force is given
===================================================

The extension is a coordinate of the mbs: a piston of 40 kg, with a force over time that pushes it and a damper that
brakes it.  The boom is raised by 0.3 rad, so its weight acts on the piston, too.  The extension of the scene only gives
the range of the piston.
"""

import exudyn as exu
import matplotlib.pyplot as plt
import numpy as np
from exudyn.utilities import InertiaCuboid, NodeGenericODE2, ObjectGenericODE2, RotationMatrixY, SensorNode

import pmr
from pmr.scene import Scene
from pmr.simulation import Excitation
from pmr.simulation.exudyn import NodeCoordinate, OnBody, add_system
from pmr.system.from_scene import system_of

RAISED, PISTON, BRAKE, STEP, END = 0.3, 40.0, 2e3, 1e-2, 0.8
pads = [{"at": 0.2, "unilateral": False,
         "faces": {"bottom": [-0.05, 0.05], "top": [-0.05, 0.05], "left": [0.0], "right": [0.0]}}]  # fmt: skip
box = {"length": 2.0, "width": 0.24, "height": 0.20, "wall": 0.005}
still = {"kind": "constant", "amount": 0.0}
RANGE = {"kind": "smooth_ramp", "times": [0.0, END], "values": [0.4, 1.4]}
own = {"mesh": {"elements": 4}, "reduction": {"coordinates": 6, "estimate": False}}
scene = Scene.model_validate({
    "title": "Driven extension",
    "frame": {"pivot": [0.2, 0.0, 0.0], "luffing": still, "slewing": still},
    "gravity": {"rise": 0.0},
    "sections": [
        {"name": "base", "body": {"model": "beam3d", "box": box}, **own,
         "supports": [{"name": "clamp", "on": "tail", "directions": ["x", "y", "z", "rx", "ry", "rz"]}]},
        {"name": "fly", "body": {"model": "beam3d", "box": box | {"width": 0.21, "height": 0.17, "wall": 0.004}}, **own,
         "joint": {"extension": RANGE, "tail": pads, "mouth": pads},
         "masses": [{"name": "payload", "on": "tip", "mass": 100.0}]},
    ],
    "time": {"end": END, "step": STEP, "rho_inf": 0.8},
})  # fmt: skip
system = system_of(scene, pmr.reduce(scene).reduced)

# %%
# The boom stands on a body that is fixed to the ground.  The fly is out by 0.5 m plus the piston's displacement.

container = exu.SystemContainer()
mbs = container.AddSystem()
ground = mbs.CreateGround()
carrier = mbs.CreateRigidBody(
    inertia=InertiaCuboid(2000.0, [1.0, 0.6, 0.4]), referenceRotationMatrix=RotationMatrixY(-RAISED)
)
mbs.CreateGenericJoint(itemNumbers=[ground, carrier], position=[0.0, 0.0, 0.0])


def push(t):
    """Force of the cylinder in N at t: more than the weight along the boom at 0.3 rad, from 0.1 s on."""
    return 550.0 + 450.0 * np.clip((t - 0.1) / 0.2, 0.0, 1.0)


rest = {"initialCoordinates": [0.0], "initialCoordinates_t": [0.0]}
piston = mbs.AddNode(NodeGenericODE2(numberOfODE2Coordinates=1, referenceCoordinates=[0.5], **rest))
mbs.AddObject(
    ObjectGenericODE2(
        nodeNumbers=[piston],
        massMatrix=np.array([[PISTON]]),
        dampingMatrix=np.array([[BRAKE]]),
        forceUserFunction=lambda mbs, t, item, q, q_t: np.array([push(t)]),
    )
)
loads = {name: signal for name, signal in Excitation.from_scene(scene).loads.items() if "inertia" not in name}
items = add_system(mbs, system, {"fly": NodeCoordinate(piston)}, loads, on=OnBody(carrier, scene))

of = exu.OutputVariableType
sensors = [
    mbs.AddSensor(SensorNode(nodeNumber=piston, outputVariableType=one, storeInternal=True))
    for one in (of.Coordinates, of.Coordinates_t)
]
mbs.Assemble()
settings = exu.SimulationSettings()
settings.solution.file.write = False
settings.solution.sensors.writePeriod = STEP
settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = END, round(END / STEP)
settings.timeIntegration.generalizedAlpha.spectralRadius = scene.time.rho_inf
settings.timeIntegration.verboseMode = 0
mbs.SolveDynamic(settings)

# %%
t = mbs.GetSensorStoredData(sensors[0])[:, 0]
out, speed = (mbs.GetSensorStoredData(sensor)[:, 1] for sensor in sensors)
figure, axes = plt.subplots(2, sharex=True, figsize=(7, 5), layout="constrained")
axes[0].plot(t, 0.5 + out)
axes[0].set(ylabel="extension in m")
felt = push(t) - BRAKE * speed - PISTON * np.gradient(speed, t)
axes[1].plot(t, push(t), label="cylinder pushes")
axes[1].plot(t, felt, label="boom feels")
axes[1].set(xlabel="time in s", ylabel="force in N")
axes[1].legend()
plt.show()
print(f"the fly goes out by {out[-1]:.3f} m, at {speed.max():.2f} m/s at most")
