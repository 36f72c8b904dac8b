"""
Slewing without sway
====================

A crane slews its payload by 20 degrees.  If the slewing angle follows one smooth ramp, the payload sways when the boom
stands again.  If the same ramp is given in two halves, of which the second begins half a swing later, they cancel, and
hardly any sway is left (input shaping; Singer and Seering 1990).
"""

import matplotlib.pyplot as plt
import numpy as np

import pmr

quick = ["compare.against=[]", "compare.richer=none", "section.mesh.elements=6", "hoist.speed=0.0", "hoist.hanging=6.0"]
quick += [
    "section.joint.extension=2.0",
    "hoist.wind.y=0.0",
    "time.end=24.0",
    "time.step=1e-2",
    "section.body.walls=rigid",
]
length, gravity, angle, ramp = 6.0, 9.80665, 20.0, 3.0
half = np.pi * np.sqrt(length / gravity)  # s: half a period of the payload's pendulum


def smooth(begin: float, turned: float) -> str:
    """Ramp of `ramp` s that turns by a number of degrees."""
    return f"{{kind='smooth_ramp',times=[{begin},{begin + ramp}],values=[0.0,{turned}]}}"


slewing = {
    "one ramp": smooth(1.0, angle),
    "two halves": f"{{kind='sum',terms=[{smooth(1.0, angle / 2)},{smooth(1.0 + half, angle / 2)}]}}",
}
scenes = {name: pmr.load_scene("hoist", [*quick, f"frame.slewing={turned}"]) for name, turned in slewing.items()}
system = pmr.reduce(scenes["one ramp"]).system  # the boom is one for all motions
responses = {name: pmr.simulate(scene, system) for name, scene in scenes.items()}

# %%
# What is left when the boom stands: the largest angle of the rope behind the end of both motions.

across, along = (f"swing of the hook {way} the boom" for way in ("across", "along"))
stands = 1.0 + half + ramp
residual = {}
for name, response in responses.items():
    swing = np.degrees(np.hypot(response.other(across), response.other(along)))
    residual[name] = float(swing[response.t > stands].max())
    print(f"{name}: sways by up to {swing.max():.2f} degrees, and by {residual[name]:.2f} degrees when the boom stands")

# %%
figure, (top, bottom) = plt.subplots(2, 1, figsize=(7, 5), sharex=True, layout="constrained")
for name, response in responses.items():
    top.plot(response.t, np.degrees(scenes[name].frame.angles[1].value(response.t)), label=name)
    bottom.plot(response.t, np.degrees(response.other(across)), label=name)
top.set(ylabel="slewed, degrees", title="A payload on a rope of 6 m")
bottom.set(xlabel="time in s", ylabel="swing across the boom, degrees")
bottom.axvline(stands, color="k", lw=0.8, ls=":")
top.legend()
plt.show()
