"""
A basket that its own cylinder keeps level
==========================================

The boom of a platform is mounted on a turret, which a cylinder raises.  The basket is a rigid body in Exudyn, hinged to
the tip.  Its own cylinder pushes it from a lug below the boom; a controller (PI) sets by the basket's angle how fast a
valve lets oil into this cylinder.  Hinge and cylinder bend the boom.
"""

import exudyn as exu
import matplotlib.pyplot as plt
import numpy as np
from exudyn import utilities

import pmr
from pmr.scene import Scene
from pmr.simulation import Excitation
from pmr.simulation.exudyn import OnBody, add_hook, add_pre_step_function, add_system
from pmr.system.from_scene import system_of

WEIGHT, STEP, END = 9.81, 1e-2, 4.5
LUG = [4.2, 0.0, -0.3]  # m from the tail of the fly
pads = [{"at": 0.3, "unilateral": False,
         "faces": {"bottom": [-0.03, 0.03], "top": [-0.03, 0.03], "left": [0.0], "right": [0.0]}}]  # fmt: skip
box = {"length": 5.0, "width": 0.18, "height": 0.16, "wall": 0.004}
still = {"kind": "constant", "amount": 0.0}
out = {"kind": "smooth_ramp", "times": [0.0, END], "values": [2.0, 4.0]}
own = {"mesh": {"elements": 4}, "reduction": {"coordinates": 6, "estimate": False}}
forces = [{"name": f"basket {axis}", "direction": axis, "signal": still} for axis in "xyz"]
forces += [{"name": f"lug {axis}", "direction": axis, "signal": still, "on": LUG[0], "point": LUG} for axis in "xyz"]
scene = Scene.model_validate({
    "title": "Leveled basket", "damping": {"ratio": 0.02, "frequencies": [1.0, 30.0]},
    "frame": {"pivot": [0.0, 0.0, 0.0], "luffing": still, "slewing": still},
    "gravity": {"rise": 0.0},
    "sections": [
        {"name": "base", "body": {"model": "beam3d", "box": box}, **own,
         "supports": [{"name": "clamp", "on": "tail", "directions": ["x", "y", "z", "rx", "ry", "rz"]}]},
        {"name": "fly", "body": {"model": "beam3d", "box": box | {"width": 0.15, "height": 0.13}}, **own,
         "joint": {"extension": out, "tail": pads, "mouth": pads}, "loads": forces},
    ],
    "time": {"end": END, "step": STEP, "rho_inf": 0.8},
})  # fmt: skip
system = system_of(scene, pmr.reduce(scene).reduced)
excitation = Excitation.from_scene(scene)

# %%
# The turret is raised while the boom telescopes.  The valve of the basket's cylinder is set once a step; P and I are in
# m/s for rad and rad s.

gains, FASTEST, OIL = (5.0, 5.0), 0.2, 5e6  # and m/s with the valve fully open, N/m of the columns of oil
mbs = exu.SystemContainer().AddSystem()
ground = mbs.CreateGround()
turret = mbs.CreateRigidBody(inertia=utilities.InertiaCuboid(2000.0, [1.0, 0.6, 0.4]), gravity=[0.0, 0.0, -WEIGHT])
mbs.CreateRevoluteJoint(itemNumbers=[ground, turret], position=[0.0, 0.0, 0.0], axis=[0.0, 1.0, 0.0])
foot, lug = np.array([1.0, 0.0, -1.0]), np.array([1.0, 0.0, 0.0])
between = {"itemNumbers": [ground, turret], "localPosition0": foot, "localPosition1": lug}
cylinder = mbs.CreateSpringDamper(**between, referenceLength=1.0, stiffness=2e7, damping=1e5)


def control(mbs, t):
    angle = 0.2 - 0.2 * np.cos(np.pi * np.clip((t - 1.0) / 2.5, 0.0, 1.0))  # to which the cylinder raises the turret
    length = np.linalg.norm(utilities.RotationMatrixY(-angle) @ lug - foot)
    mbs.SetObjectParameter(cylinder, "referenceLength", float(length))
    R = mbs.GetObjectOutputBody(basket, exu.OutputVariableType.RotationMatrix, [0.0, 0.0, 0.0])
    dips = np.arctan2(-R[6], R[0])  # turned about y, nose down
    valve["sum"] += STEP * dips
    valve["length"] += STEP * float(np.clip(np.dot(gains, [dips, valve["sum"]]), -FASTEST, FASTEST))
    mbs.SetObjectParameter(leveler, "referenceLength", valve["length"])
    return True


add_pre_step_function(mbs, control)
loads = {name: signal for name, signal in excitation.loads.items() if "basket" in name or "lug" in name}
items = add_system(mbs, system, excitation.paths, loads, on=OnBody(turret, scene))
hinged = add_hook(mbs, items, ("fly.basket x", "fly.basket y", "fly.basket z"), mass=10.0)
below = add_hook(mbs, items, ("fly.lug x", "fly.lug y", "fly.lug z"), mass=2.0)
tip, start = (np.array(mbs.GetNode(hook.nHook)["referenceCoordinates"]) for hook in (hinged, below))
inertia = utilities.InertiaCuboid(150.0, [0.8, 1.5, 1.0]).Translated([0.5, 0.0, 0.3])
basket = mbs.CreateRigidBody(referencePosition=tip, inertia=inertia)
mbs.CreateForce(  # its weight rises within a second, so that it does not fall onto the boom
    itemNumber=basket, localPosition=[0.5, 0.0, 0.3],
    loadVectorUserFunction=lambda mbs, t, load: [0.0, 0.0, -75.0 * WEIGHT * (1.0 - np.cos(np.pi * min(t, 1.0)))],
)  # fmt: skip
hinge = mbs.AddMarker(utilities.MarkerBodyRigid(bodyNumber=basket, localPosition=[0.0, 0.0, 0.0]))
mbs.AddObject(utilities.ObjectJointSpherical(markerNumbers=[hinged.mHook, hinge]))
mbs.CreateGenericJoint(itemNumbers=[ground, basket], position=tip, constrainedAxes=[0, 0, 0, 1, 0, 1])
pushed = mbs.AddMarker(utilities.MarkerBodyPosition(bodyNumber=basket, localPosition=[0.0, 0.0, -0.6]))
valve = {"sum": 0.0, "length": float(np.linalg.norm(tip + [0.0, 0.0, -0.6] - start))}
leveler = mbs.AddObject(utilities.ObjectConnectorSpringDamper(
    markerNumbers=[below.mHook, pushed], referenceLength=valve["length"], stiffness=OIL, damping=5e4))  # fmt: skip

turning, pushing = (
    {"outputVariableType": kind, "storeInternal": True}
    for kind in (exu.OutputVariableType.RotationMatrix, exu.OutputVariableType.Force)
)
sensors = [mbs.AddSensor(utilities.SensorBody(bodyNumber=body, **turning)) for body in (turret, basket)]
sensors.append(mbs.AddSensor(utilities.SensorObject(objectNumber=leveler, **pushing)))
mbs.Assemble()
settings = exu.SimulationSettings()
settings.solution.file.write = False
settings.solution.sensors.writePeriod = STEP
settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = END, round(END / STEP)
settings.timeIntegration.generalizedAlpha.spectralRadius = scene.time.rho_inf
settings.timeIntegration.verboseMode = 0
mbs.SolveDynamic(settings)

# %%
*turned, force = (mbs.GetSensorStoredData(sensor) for sensor in sensors)
t, (boom, level) = turned[0][:, 0], (np.degrees(np.arctan2(R[:, 7], R[:, 1])) for R in turned)
push = 1e-3 * np.linalg.norm(force[t > 1.0, 1:], axis=1)
figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
axes.plot(t, boom, label="turret")
axes.plot(t, level, label="basket")
axes.set(xlabel="time in s", ylabel="raised by, degrees")
axes.legend()
plt.show()
print(f"the turret is raised by {boom[-1]:.1f} degrees, the basket tilts by {np.abs(level).max():.1f} at most")
print(f"its cylinder pushes with {push.min():.2f} to {push.max():.2f} kN")
