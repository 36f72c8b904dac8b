"""
A beam of one's own
===================

A scene is a TOML file.  This script writes one, reduces it to five coordinates and shows how its frequencies change
while the support travels.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np

import pmr

SCENE = """
title = "A ladder on a roller"

[body]
model = "beam2d"

[body.profile]
length = 3.0
bending_stiffness = 4e3
mass_per_length = 6.0

[mesh]
elements = 30

[[supports]]
on = 0.0
kind = "pinned"

[slider]
path = { kind = "smooth_ramp", times = [0.5, 3.0, 5.5], values = [0.8, 2.6, 0.8] }

[[loads]]
name = "foot"
on = 3.0
signal = { kind = "sine", amplitude = 10.0, frequency = 3.0 }

[time]
end = 6.0
step = 1e-3

[reduction]
coordinates = 5
"""

# %%
# A scene that is not possible is refused in one line, so a scene that is loaded can be run.

with TemporaryDirectory() as folder:
    file = Path(folder) / "ladder.toml"
    file.write_text(SCENE)
    scene = pmr.load_scene(file)
    try:
        pmr.load_scene(file, ["slider.path.values=[0.8, 3.6, 0.8]"])
    except pmr.InputError as error:
        refused = error.allowed
print(f"refused: {refused}")

result = pmr.run(scene).result
error = result.summary["errors"]["reduced_vs_full"]["beam"]
estimate = result.summary["estimate"]["beam"]
print(f"five coordinates differ by {100 * error:.4f} % from the full model; estimated were {100 * estimate:.4f} %")

# %%
# The roller holds the beam best about three quarters of the way out: the first frequency is highest there.

curves = result.frequencies
stiffest = float(curves.along[np.argmax(curves.models["full"][:, 0])])
print(f"the first frequency is highest with the roller at {stiffest:.2f} m")

figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.5), layout="constrained")
left.semilogy(curves.along, curves.models["full"], "k")
left.semilogy(curves.along, curves.models["reduced"], "--", color="tab:orange")
left.set(xlabel="roller at s in m", ylabel="frequencies in Hz", title="full (black) and reduced")
right.plot(result.responses["reduced"].t, 1e3 * result.responses["reduced"].tip, lw=0.8)
right.set(xlabel="t in s", ylabel="tip in mm")
plt.show()
