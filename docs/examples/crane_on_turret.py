"""
A boom on a turret, with a payload on a rope
============================================

The turret is a rigid body of Exudyn's own on a hinge, held by the spring of its luffing cylinder.  The boom rides on
it and makes the cylinder give way, and its tip swings with the payload on a rope, while it telescopes.
"""

import exudyn as exu
import matplotlib.pyplot as plt
import numpy as np
from exudyn.utilities import InertiaCuboid, MarkerNodePosition, ObjectConnectorDistance, RotationMatrixY, SensorNode

import pmr
from pmr.scene import Scene
from pmr.simulation import Excitation
from pmr.simulation.exudyn import OnBody, add_hook, add_system
from pmr.system.from_scene import system_of

WEIGHT, STEP, END = 9.81, 5e-3, 1.5
pads = [{"at": 0.2, "faces": {"bottom": [-0.05, 0.05], "top": [-0.05, 0.05], "left": [0.0], "right": [0.0]}}]
pads = [one | {"unilateral": False} for one in pads]
box = {"length": 2.0, "width": 0.24, "height": 0.20, "wall": 0.005}
still = {"kind": "constant", "amount": 0.0}
out = {"kind": "smooth_ramp", "times": [0.0, END], "values": [0.5, 1.1]}
scene = Scene.model_validate({
    "title": "Boom on a turret",
    "frame": {"pivot": [0.2, 0.0, 0.0], "second_order": True, "luffing": still, "slewing": still},
    "gravity": {"rise": 0.0},
    "sections": [
        {"name": "base", "body": {"model": "beam3d", "box": box}, "mesh": {"elements": 4},
         "reduction": {"coordinates": 8, "estimate": False},
         "supports": [{"name": "clamp", "on": "tail", "directions": ["x", "y", "z", "rx", "ry", "rz"]}]},
        {"name": "fly", "body": {"model": "beam3d", "box": box | {"width": 0.21, "height": 0.17, "wall": 0.004}},
         "mesh": {"elements": 4}, "reduction": {"coordinates": 8, "estimate": False},
         "joint": {"extension": out, "tail": pads, "mouth": pads},
         "loads": [{"name": f"hook {one}", "direction": one, "signal": still} for one in "xyz"]},
    ],
    "time": {"end": END, "step": STEP, "rho_inf": 0.8},
})  # fmt: skip
system = system_of(scene, pmr.reduce(scene).reduced)

# %%
# The turret, raised by 0.4 rad about its hinge at the origin, and the cylinder, 0.5 m before it.

container = exu.SystemContainer()
mbs = container.AddSystem()
ground = mbs.CreateGround()
raised = RotationMatrixY(-0.4)
turret = mbs.CreateRigidBody(
    inertia=InertiaCuboid(2000.0, [1.0, 0.6, 0.4]), referenceRotationMatrix=raised, gravity=[0.0, 0.0, -WEIGHT]
)
mbs.CreateRevoluteJoint(itemNumbers=[ground, turret], position=[0.0, 0.0, 0.0], axis=[0.0, 1.0, 0.0])
top = raised @ [0.5, 0.0, 0.0]
cylinder = mbs.CreateSpringDamper(
    itemNumbers=[ground, turret], localPosition0=[0.5, 0.0, -1.0], localPosition1=[0.5, 0.0, 0.0],
    referenceLength=np.linalg.norm(top - [0.5, 0.0, -1.0]) + 0.009, stiffness=6e5, damping=2e4,
)  # fmt: skip

# %%
# The boom on it, and 30 kg on a rope of 0.8 m.

excitation = Excitation.of(scene)
loads = {name: signal for name, signal in excitation.loads.items() if "hook" in name}
items = add_system(mbs, system, excitation.paths, loads, on=OnBody(turret, scene))
hook = add_hook(mbs, items, ("fly.hook x", "fly.hook y", "fly.hook z"), mass=2.0)
tip = np.array(mbs.GetNode(hook.nHook)["referenceCoordinates"])
load = mbs.CreateMassPoint(
    referencePosition=tip - [0.0, 0.0, 0.8], mass=30.0, gravity=[0.0, 0.0, -WEIGHT], returnDict=True
)
rope = [hook.mHook, mbs.AddMarker(MarkerNodePosition(nodeNumber=load["nodeNumber"]))]
mbs.AddObject(ObjectConnectorDistance(markerNumbers=rope, distance=0.8))

position = exu.OutputVariableType.Position
nodes = (hook.nHook, load["nodeNumber"])
sensors = [mbs.AddSensor(SensorNode(nodeNumber=one, outputVariableType=position, storeInternal=True)) for one in nodes]
mbs.Assemble()
settings = exu.SimulationSettings()
settings.solution.file.write = False
settings.solution.sensors.writePeriod = STEP
settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = END, round(END / STEP)
settings.timeIntegration.generalizedAlpha.spectralRadius = scene.time.rho_inf
settings.timeIntegration.verboseMode = 0
mbs.SolveDynamic(settings)

# %%
tip, payload = (mbs.GetSensorStoredData(sensor) for sensor in sensors)
figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
axes.plot(tip[:, 0], tip[:, 3], label="tip of the boom")
axes.plot(payload[:, 0], payload[:, 3] + 0.8, label="payload, by the rope's length higher")
axes.set(xlabel="time in s", ylabel="height in m")
axes.legend()
plt.show()
leans = np.arcsin(np.hypot(*(payload - tip)[:, 1:3].T) / 0.8)
print(
    f"the tip goes up by {np.ptp(tip[:, 3]):.3f} m; the rope leans by {np.degrees(np.arcsin(leans.max())):.1f} degrees"
)
