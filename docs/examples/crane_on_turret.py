"""
A boom on a turret, with a payload on a rope
============================================

The turret is a rigid body in Exudyn on a hinge.  A hydraulic cylinder, whose valve opens for a while, raises it.  The
boom is mounted on the turret and telescopes; its tip swings with the payload on a rope.
"""

import exudyn as exu
import exudyn.utilities as eut
import matplotlib.pyplot as plt
import numpy as np

import pmr
from pmr.scene import Scene
from pmr.simulation import Excitation
from pmr.simulation.exudyn import OnBody, add_hook, add_pre_step_function, add_system
from pmr.system.from_scene import system_of

WEIGHT, STEP, END, WINCH = 9.81, 5e-3, 1.5, [0.0, 0.0, 0.3]
faces = {"bottom": [-0.05, 0.05], "top": [-0.05, 0.05], "left": [0.0], "right": [0.0]}
pads = [{"at": 0.2, "faces": faces, "unilateral": False}]
own = {"mesh": {"elements": 4}, "reduction": {"coordinates": 8, "estimate": False}}
box = {"length": 2.0, "width": 0.24, "height": 0.20, "wall": 0.005}
still = {"kind": "constant", "amount": 0.0}
out = {"kind": "smooth_ramp", "times": [0.0, END], "values": [0.5, 1.1]}
scene = Scene.model_validate({
    "title": "Boom on a turret",
    "frame": {"pivot": [0.2, 0.0, 0.0], "second_order": True, "luffing": still, "slewing": still},
    "gravity": {"rise": 0.0},
    "sections": [
        {"name": "base", "body": {"model": "beam3d", "box": box}, **own,
         "supports": [{"name": "clamp", "on": "tail", "directions": ["x", "y", "z", "rx", "ry", "rz"]}]},
        {"name": "fly", "body": {"model": "beam3d", "box": box | {"width": 0.21, "height": 0.17, "wall": 0.004}}, **own,
         "joint": {"extension": out, "tail": pads, "mouth": pads},
         "loads": [{"name": f"hook {one}", "direction": one, "signal": still} for one in "xyz"]},
    ],
    "time": {"end": END, "step": STEP, "rho_inf": 0.8},
})  # fmt: skip
system = system_of(scene, pmr.reduce(scene).reduced)

# %%
# The turret, raised by 0.4 rad about its hinge at the origin, on a cylinder of Exudyn's own, 0.5 m before it, with the
# pressures of its two chambers in Pa.

mbs = (container := exu.SystemContainer()).AddSystem()
ground, raised = mbs.CreateGround(), eut.RotationMatrixY(-0.4)
gravity, inertia = [0.0, 0.0, -WEIGHT], eut.InertiaCuboid(2000.0, [1.0, 0.6, 0.4])
turret = mbs.CreateRigidBody(inertia=inertia, referenceRotationMatrix=raised, gravity=gravity)
mbs.CreateRevoluteJoint(itemNumbers=[ground, turret], position=[0.0, 0.0, 0.0], axis=[0.0, 1.0, 0.0])
ends = (ground, [0.5, 0.0, -1.0]), (turret, [0.5, 0.0, 0.0])
markers = [mbs.AddMarker(eut.MarkerBodyPosition(bodyNumber=body, localPosition=place)) for body, place in ends]
start = {"referenceCoordinates": [0.0, 0.0], "initialCoordinates": [3e6, 1e6]}
pressures = mbs.AddNode(eut.NodeGenericODE1(numberOfODE1Coordinates=2, **start))
cylinder = mbs.AddObject(eut.HydraulicActuatorSimple(
    markerNumbers=markers, nodeNumbers=[pressures], offsetLength=0.8, strokeLength=0.8, chamberCrossSection0=2e-3,
    chamberCrossSection1=1e-3, hoseVolume0=2e-3, hoseVolume1=2e-3, actuatorDamping=1e4, oilBulkModulus=1e9,
    nominalFlow=2e-7, systemPressure=2e7, tankPressure=1e5,
))  # fmt: skip

# %%
# The boom is on the turret.  30 kg hang on a rope, from a winch on the turret over a sheave at the tip.  The winch pays
# out as much rope as the boom gets longer.  The valve is open from 0.3 to 1.2 s.

excitation = Excitation.from_scene(scene)
loads = {name: signal for name, signal in excitation.loads.items() if "hook" in name}
items = add_system(mbs, system, excitation.paths, loads, on=OnBody(turret, scene))
hook = add_hook(mbs, items, ("fly.hook x", "fly.hook y", "fly.hook z"), mass=2.0)
tip, winch = np.array(mbs.GetNode(hook.nHook)["referenceCoordinates"]), raised @ WINCH
sheave, load = (
    mbs.CreateRigidBody(referencePosition=at, inertia=eut.InertiaSphere(mass, 0.1), gravity=gravity)
    for at, mass in ((tip, 2.0), (tip - [0.0, 0.0, 0.8], 30.0))
)
rolls = [
    mbs.AddMarker(eut.MarkerBodyRigid(bodyNumber=body, localPosition=place))
    for body, place in ((turret, WINCH), (sheave, [0.0] * 3), (load, [0.0] * 3))
]
mbs.AddObject(eut.ObjectJointSpherical(markerNumbers=[hook.mHook, rolls[1]]))
length = np.linalg.norm(tip - winch) + 0.8
rope = mbs.AddObject(eut.ReevingSystemSprings(
    markerNumbers=rolls, referenceLength=length, stiffnessPerLength=2e6, dampingPerLength=2e3,
    sheavesAxes=exu.Vector3DList([[0.0, 1.0, 0.0]] * 3), sheavesRadii=[0.0] * 3,
))  # fmt: skip


def drive(mbs, t):
    """Winch and valve, once a step."""
    mbs.SetObjectParameter(rope, "referenceLength", length + float(excitation.paths["fly"].value(t)) - 0.5)
    opening = 0.4 * np.sin(np.pi * np.clip((t - 0.3) / 0.9, 0.0, 1.0)) ** 2
    mbs.SetObjectParameter(cylinder, "valveOpening0", opening)
    mbs.SetObjectParameter(cylinder, "valveOpening1", -opening)
    return True


add_pre_step_function(mbs, drive)
kept = {"outputVariableType": exu.OutputVariableType.Position, "storeInternal": True}
sensors = [mbs.AddSensor(eut.SensorBody(bodyNumber=one, **kept)) for one in (sheave, load)]
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
print(f"the tip goes up by {np.ptp(tip[:, 3]):.3f} m; the rope leans by {np.degrees(leans.max()):.1f} degrees")
