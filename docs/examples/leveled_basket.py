"""
A basket that is kept level
===========================

The boom of a platform is mounted on a turret, which a cylinder raises.  The basket is a rigid body in Exudyn, hinged to
the tip.  A controller (PID) keeps it level with a torque between basket and boom; this torque is a load on the boom.
"""

import exudyn as exu
import matplotlib.pyplot as plt
import numpy as np
from exudyn.utilities import InertiaCuboid, MarkerBodyRigid, ObjectJointSpherical, RotationMatrixY, SensorBody

import pmr
from pmr.scene import Scene
from pmr.simulation import Excitation
from pmr.simulation.exudyn import OnBody, add_hook, add_pre_step_function, add_system
from pmr.system.from_scene import system_of

WEIGHT, STEP, END = 9.81, 1e-2, 4.0
pads = [{"at": 0.3, "unilateral": False,
         "faces": {"bottom": [-0.03, 0.03], "top": [-0.03, 0.03], "left": [0.0], "right": [0.0]}}]  # fmt: skip
box = {"length": 5.0, "width": 0.18, "height": 0.16, "wall": 0.004}
still = {"kind": "constant", "amount": 0.0}
out = {"kind": "smooth_ramp", "times": [0.0, END], "values": [2.0, 4.0]}
own = {"mesh": {"elements": 4}, "reduction": {"coordinates": 6, "estimate": False}}
at_tip = [{"name": f"basket {one}", "direction": one, "signal": still} for one in ("x", "y", "z", "ry")]
scene = Scene.model_validate({
    "title": "Leveled basket",
    "frame": {"pivot": [0.0, 0.0, 0.0], "luffing": still, "slewing": still},
    "gravity": {"rise": 0.0},
    "sections": [
        {"name": "base", "body": {"model": "beam3d", "box": box}, **own,
         "supports": [{"name": "clamp", "on": "tail", "directions": ["x", "y", "z", "rx", "ry", "rz"]}]},
        {"name": "fly", "body": {"model": "beam3d", "box": box | {"width": 0.15, "height": 0.13}}, **own,
         "joint": {"extension": out, "tail": pads, "mouth": pads}, "loads": at_tip},
    ],
    "time": {"end": END, "step": STEP, "rho_inf": 0.8},
})  # fmt: skip
system = system_of(scene, pmr.reduce(scene).reduced)
excitation = Excitation.from_scene(scene)


# %%
# The cylinder raises the turret while the boom telescopes.  The output of the controller is set once a step; P, I and D
# are in N m for rad, rad s and rad/s.

gains = (2e4, 1e4, 3e3)
container = exu.SystemContainer()
mbs = container.AddSystem()
ground, gravity = mbs.CreateGround(), [0.0, 0.0, -WEIGHT]
turret = mbs.CreateRigidBody(inertia=InertiaCuboid(2000.0, [1.0, 0.6, 0.4]), gravity=gravity)
mbs.CreateRevoluteJoint(itemNumbers=[ground, turret], position=[0.0, 0.0, 0.0], axis=[0.0, 1.0, 0.0])
foot, lug = np.array([1.0, 0.0, -1.0]), np.array([1.0, 0.0, 0.0])
cylinder = mbs.CreateSpringDamper(
    itemNumbers=[ground, turret], localPosition0=foot, localPosition1=lug, referenceLength=1.0, stiffness=2e7,
    damping=1e5,
)  # fmt: skip
mbs.variables["torque"] = 0.0

# The boom, with the torque of the controller as a load on its tip.
loads = {name: signal for name, signal in excitation.loads.items() if "basket" in name}
loads["fly.basket ry"] = lambda mbs, t: -mbs.variables["torque"]
known = {"sum": -150.0 * 0.5 * WEIGHT / gains[1]}  # carries the basket


def pitch(body):
    R = mbs.GetObjectOutputBody(body, exu.OutputVariableType.RotationMatrix, [0.0, 0.0, 0.0])
    return np.arctan2(-R[6], R[0])  # turned about y, nose down


def control(mbs, t):
    angle = 0.2 - 0.2 * np.cos(np.pi * np.clip((t - 0.5) / 2.5, 0.0, 1.0))  # to which the cylinder raises the turret
    mbs.SetObjectParameter(cylinder, "referenceLength", float(np.linalg.norm(RotationMatrixY(-angle) @ lug - foot)))
    error = -pitch(basket)
    rate = mbs.GetObjectOutputBody(basket, exu.OutputVariableType.AngularVelocity, [0.0, 0.0, 0.0])[1]
    known["sum"] += STEP * error
    torque = mbs.variables["torque"] = float(np.dot(gains, [error, known["sum"], -rate]))
    mbs.SetLoadParameter(turning, "loadVector", [0.0, torque, 0.0])
    return True


add_pre_step_function(mbs, control)
items = add_system(mbs, system, excitation.paths, loads, on=OnBody(turret, scene))
hook = add_hook(mbs, items, ("fly.basket x", "fly.basket y", "fly.basket z"), mass=10.0)
tip = np.array(mbs.GetNode(hook.nHook)["referenceCoordinates"])
inertia = InertiaCuboid(150.0, [0.8, 1.5, 1.0]).Translated([0.5, 0.0, 0.3])
basket = mbs.CreateRigidBody(referencePosition=tip, inertia=inertia, gravity=gravity)
hinge = mbs.AddMarker(MarkerBodyRigid(bodyNumber=basket, localPosition=[0.0, 0.0, 0.0]))
mbs.AddObject(ObjectJointSpherical(markerNumbers=[hook.mHook, hinge]))
mbs.CreateGenericJoint(itemNumbers=[ground, basket], position=tip, constrainedAxes=[0, 0, 0, 1, 0, 1])
turning = mbs.CreateTorque(itemNumber=basket, loadVector=[0.0, 0.0, 0.0])

kind = exu.OutputVariableType.RotationMatrix
sensors = [
    mbs.AddSensor(SensorBody(bodyNumber=one, outputVariableType=kind, storeInternal=True)) for one in (turret, basket)
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
turned = [mbs.GetSensorStoredData(sensor) for sensor in sensors]
t, (boom, level) = turned[0][:, 0], (np.degrees(np.arctan2(one[:, 7], one[:, 1])) for one in turned)
figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
axes.plot(t, boom, label="turret")
axes.plot(t, level, label="basket")
axes.set(xlabel="time in s", ylabel="raised by, degrees")
axes.legend()
plt.show()
print(f"the turret is raised by {boom[-1]:.1f} degrees, the basket tilts by {np.abs(level).max():.1f} at most")
