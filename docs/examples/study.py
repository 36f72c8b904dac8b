"""
A study in Python
=================

`pmr study` varies keys of a scene from a file, spreads the runs over processes and resumes.  For a handful of runs a
loop is enough.  This one varies the payload of a boom and the stiffness of its pads, and compares the largest force of
a pad.
"""

from itertools import product

import matplotlib.pyplot as plt
import numpy as np

import pmr

payloads, stiffnesses = [100.0, 250.0, 500.0], [3e7, 3e8]
short = ["time.end=3.0", "slider.path.times=[0.5, 1.5, 2.5]", "reduction.estimate=false", "mesh.elements=30"]
rows = []
for payload, stiffness in product(payloads, stiffnesses):
    changes = [f"masses.payload.mass={payload}"]
    changes += [f"pads.{ring}.stiffness={stiffness}" for ring in ("tail", "mouth")]
    scene = pmr.load_scene("boom_beam", [*short, *changes])
    motion = pmr.simulate(scene, pmr.reduce(scene).reduced)
    force, tip = np.abs(motion.slider_force), np.abs(motion.displacement[:, -1])
    rows.append((payload, stiffness, float(force.max()), float(tip.max())))
    print(f"{payload:4.0f} kg on {stiffness:.0e} N/m: {1e-3 * force.max():5.2f} kN, tip {1e3 * tip.max():.2f} mm")

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.5), layout="constrained")
for stiffness in stiffnesses:
    chosen = np.array([row for row in rows if row[1] == stiffness])
    left.plot(chosen[:, 0], 1e-3 * chosen[:, 2], "o-", label=f"{stiffness:.0e} N/m")
    right.plot(chosen[:, 0], 1e3 * chosen[:, 3], "o-")
left.set(xlabel="payload in kg", ylabel="largest pad force in kN")
right.set(xlabel="payload in kg", ylabel="largest tip displacement in mm")
left.legend(title="pads")
plt.show()
