"""
A boom whose tip is damped by its luffing cylinder
==================================================

The boom is mounted on a turret in Exudyn, which a cylinder lifts.  The valve of the cylinder follows a given speed over
time.  A controller (PID) adds a correction from the deflection of the tip, which damps its vibration.  Weight is left
out: it adds a constant deflection only.
"""

import exudyn as exu
import matplotlib.pyplot as plt
import numpy as np
from exudyn.utilities import InertiaCuboid, RotationMatrixY, SensorNode

import pmr
from pmr.scene import Scene
from pmr.simulation import Excitation
from pmr.simulation.exudyn import OnBody, add_hook, add_pre_step_function, add_system
from pmr.system.from_scene import system_of

STEP, END = 1e-2, 3.5
pads = [{"at": 0.3, "unilateral": False,
         "faces": {"bottom": [-0.03, 0.03], "top": [-0.03, 0.03], "left": [0.0], "right": [0.0]}}]  # fmt: skip
box = {"length": 5.0, "width": 0.18, "height": 0.16, "wall": 0.004}
still = {"kind": "constant", "amount": 0.0}
own = {"mesh": {"elements": 4}, "reduction": {"coordinates": 6, "estimate": False}}
scene = Scene.model_validate({
    "title": "Tip damping", "gravity": None,
    "frame": {"pivot": [0.0, 0.0, 0.0], "luffing": still, "slewing": still},
    "sections": [
        {"name": "base", "body": {"model": "beam3d", "box": box}, **own,
         "supports": [{"name": "clamp", "on": "tail", "directions": ["x", "y", "z", "rx", "ry", "rz"]}]},
        {"name": "fly", "body": {"model": "beam3d", "box": box | {"width": 0.15, "height": 0.13}}, **own,
         "joint": {"extension": {"kind": "constant", "amount": 4.0}, "tail": pads, "mouth": pads},
         "loads": [{"name": f"hook {one}", "direction": one, "signal": still} for one in "xyz"]},
    ],
    "time": {"end": END, "step": STEP, "rho_inf": 0.8},
})  # fmt: skip
system = system_of(scene, pmr.reduce(scene).reduced)
excitation = Excitation.from_scene(scene)
loads = {name: signal for name, signal in excitation.loads.items() if "hook" in name}


# %%
# The speed is constant for a second.  The controller measures the angle at the hinge between the tip and the turret's
# axis.  Its output is set once a step.


def lifted(gains):
    """Times (T,) in s and angles of the tip (T,) in rad; P, I and D in m/s for rad, rad s and rad/s."""
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    ground, raised = mbs.CreateGround(), RotationMatrixY(-0.2)
    turret = mbs.CreateRigidBody(inertia=InertiaCuboid(2000.0, [1.0, 0.6, 0.4]), referenceRotationMatrix=raised)
    mbs.CreateRevoluteJoint(itemNumbers=[ground, turret], position=[0.0, 0.0, 0.0], axis=[0.0, 1.0, 0.0])
    foot = np.array([1.0, 0.0, -1.0])
    length = np.linalg.norm(raised @ [1.0, 0.0, 0.0] - foot)
    cylinder = mbs.CreateSpringDamper(
        itemNumbers=[ground, turret], localPosition0=foot, localPosition1=[1.0, 0.0, 0.0], referenceLength=length,
        stiffness=2e7, damping=1e5,
    )  # fmt: skip
    position = exu.OutputVariableType.Position
    items = add_system(mbs, system, excitation.paths, loads, on=OnBody(turret, scene))
    hook = add_hook(mbs, items, ("fly.hook x", "fly.hook y", "fly.hook z"), mass=100.0)
    known = {"length": length, "sum": 0.0, "before": 0.0}

    def valve(mbs, t):
        speed = 0.1 if 0.5 < t <= 1.5 else 0.0
        x, _, z = mbs.GetNodeOutput(hook.nHook, position)
        ear_x, _, ear_z = mbs.GetObjectOutputBody(turret, position, [1.0, 0.0, 0.0])
        error = np.arctan2(z, x) - np.arctan2(ear_z, ear_x)
        change, known["before"] = (error - known["before"]) / STEP, error
        known["sum"] += error * STEP
        known["length"] += STEP * (speed + np.dot(gains, [error, known["sum"], change]))
        mbs.SetObjectParameter(cylinder, "referenceLength", known["length"])
        return True

    add_pre_step_function(mbs, valve)
    sensor = mbs.AddSensor(SensorNode(nodeNumber=hook.nHook, outputVariableType=position, storeInternal=True))
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = STEP
    settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = END, round(END / STEP)
    settings.timeIntegration.verboseMode = 0
    mbs.SolveDynamic(settings)
    t, x, _, z = mbs.GetSensorStoredData(sensor).T
    return t, np.arctan2(z, x)


figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
swings = {}
for name, gains in (("valve alone", (0.0, 0.0, 0.0)), ("with PID", (2.0, 0.2, 0.05))):
    t, angle = lifted(gains)
    swings[name] = np.degrees(np.ptp(angle[t > 2.8]))
    axes.plot(t, np.degrees(angle), label=name)
    print(f"{name}: the tip swings by {swings[name]:.2f} degrees at the end")
axes.set(xlabel="time in s", ylabel="angle of the tip in degrees")
axes.legend()
plt.show()
