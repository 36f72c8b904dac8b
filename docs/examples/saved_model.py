"""
A saved model under other loads
===============================

A reduced model is one small file.  Any machine with NumPy reads and simulates it, without FEniCSx.  Another
load or another motion along the path takes milliseconds.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt

import pmr

asked = ["mesh.elements=30", "compare.against=[]", "simulation.repeats=1"]
with TemporaryDirectory() as folder:
    file = Path(folder) / "reduced.npz"
    pmr.reduce(pmr.load_scene("boom_beam", asked)).reduced.save(file)  # FEniCSx ends here
    size = file.stat().st_size
    model = pmr.ReducedModel.load(file)
print(f"{1e-3 * size:.0f} kB: {model.size} coordinates; inputs {', '.join(model.input_names)}")

# %%
# The scene needs loads with the same names.  Their signals may be any, and so may the path, within the range of the
# model's tables.

cases = {
    "as reduced": [],
    "a stop on the way": [
        "slider.path.times=[1.0, 3.0, 6.0, 9.0]",
        "slider.path.values=[1.5, 2.7, 2.7, 4.0]",
    ],
    "a stronger gust": ["loads.gust.signal.values=[0.0, 3000.0, 0.0, 0.0, -3000.0, 0.0, 0.0, 3000.0, 0.0]"],
}
motions = {
    name: pmr.simulate(pmr.load_scene("boom_beam", [*asked, *changes]), model) for name, changes in cases.items()
}
sideways = motions["as reduced"].output_names.index("tip y")
for name, motion in motions.items():
    print(f"{name}: tip at most {1e3 * abs(motion.displacement[:, sideways]).max():.2f} mm sideways")

# %%
figure, axes = plt.subplots(figsize=(8, 4), layout="constrained")
for name, motion in motions.items():
    axes.plot(motion.t, 1e3 * motion.displacement[:, sideways], lw=0.9, label=name)
axes.set(xlabel="t in s", ylabel="tip sideways in mm")
axes.legend()
plt.show()
