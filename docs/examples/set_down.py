"""
A load that is set down
=======================

A crane lowers its payload until it stands on the ground.  The rope loses its force, the boom loses its load and swings
up.  The ground is a spring and a damper in a loop around a stepper: they push the payload up as a load of the hoist.
"""

import matplotlib.pyplot as plt
import numpy as np

import pmr

quick = ["section.mesh.elements=6", "section.body.walls=rigid", "section.joint.extension=3.0", "frame.slewing=0.0"]
quick += ["hoist.wind.y=0.0", "hoist.wind.z=0.0", "hoist.speed=0.0"]
system = pmr.reduce(pmr.load_scene("hoist", quick)).system

STEP, END, PAYLOAD, GRAVITY = 2e-3, 6.0, 450.0, 9.80665  # hook and what hangs on it, kg
BELOW = 0.2  # m: how far the load is above the ground at first
STIFFNESS, DAMPING = 2e5, 4e3  # of the ground, N/m and N s/m


def lowered(speed: float) -> dict[str, np.ndarray]:
    """Columns over time while the winch pays out rope at such a speed in m/s from 0.5 s on, until the load stands."""
    names = ["hook height", "force of the hoist rope", "fly: tip z", "force of the ground"]
    stepper = pmr.Stepper(system, step=STEP, s={"middle": 3.0, "fly": 3.0}, outputs=names[:3])
    begun = height = stepper.hoist["hook height"]
    rows, push, paid_out, stands = [], 0.0, 0.0, False
    for k in range(round(END / STEP)):
        share = np.clip((k * STEP - 0.5) / 0.5, 0.0, 1.0)  # the winch starts within half a second
        stands = stands or push > 0.99 * PAYLOAD * GRAVITY  # and stops once the ground has carried the load
        winch = 0.0 if stands else -speed * share * share * (3.0 - 2.0 * share)
        y = stepper.step({}, {"hoist rope": winch, "hoist wind z": push})
        deep, sinks = begun - BELOW - y[0], (height - y[0]) / STEP
        height, paid_out = y[0], paid_out - winch * STEP
        push = max(0.0, STIFFNESS * deep + DAMPING * sinks) if deep > 0.0 else 0.0
        rows.append([*y, push])
    print(f"{speed:g} m/s: {paid_out:.2f} m of rope paid out")
    return dict(zip(names, np.array(rows).T, strict=True))


SPEEDS = (0.1, 0.4)
runs = {speed: lowered(speed) for speed in SPEEDS}

# %%
# How hard the load meets the ground, and how far the tip of the boom goes up.

t = STEP * np.arange(1, round(END / STEP) + 1)
hardest, rebound = {}, {}
for speed, run in runs.items():
    tip = run["fly: tip z"]
    hardest[speed] = run["force of the ground"].max() / (PAYLOAD * GRAVITY)
    rebound[speed] = np.ptp(tip[t > t[np.argmax(run["force of the ground"] > 0.0)]])
    print(f"{speed:g} m/s: the ground bears {hardest[speed]:.2f} times the weight, the tip moves by "
          f"{1e3 * rebound[speed]:.0f} mm")  # fmt: skip

# %%
figure, rows = plt.subplots(3, 1, figsize=(7, 6), sharex=True, layout="constrained")
for speed, run in runs.items():
    rows[0].plot(t, run["force of the hoist rope"] / 1e3, label=f"winch at {speed:g} m/s")
    rows[1].plot(t, run["force of the ground"] / 1e3)
    rows[2].plot(t, 1e3 * run["fly: tip z"])
for axes, label in zip(rows, ("rope, kN", "ground, kN", "tip, mm"), strict=True):
    axes.set_ylabel(label)
rows[-1].set_xlabel("time in s")
rows[0].legend()
plt.show()
