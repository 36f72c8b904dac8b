"""
Pads that only push
===================

Real pads can't pull.  With `unilateral = true` a pad that would pull lifts off, and other pads carry more.  The pads of
the reference boom hold both ways, so its model is linear.
"""

import matplotlib.pyplot as plt

import pmr

short = ["time.end=4.0", "slider.path.times=[0.5, 2.0, 3.5]", "compare.against=[]", "reduction.estimate=false"]
pushing = ["pads.tail.unilateral=true", "pads.mouth.unilateral=true"]

# %%
# Both ways of holding are reduced with the same modes: pads are rows of forces on the body, not part of it.

ways = {"hold both ways": short, "only push": [*short, *pushing]}
scenes = {name: pmr.load_scene("boom_beam", changes) for name, changes in ways.items()}
motions = {name: pmr.simulate(scene, pmr.reduce(scene).reduced) for name, scene in scenes.items()}
names = motions["only push"].force_names
largest = {}
for name, motion in motions.items():
    least, most = motion.slider_force.min(axis=0), motion.slider_force.max(axis=0)
    largest[name] = (float(least.min()), float(most.max()))
    print(f"pads that {name}: {1e-3 * least.min():.2f} kN to {1e-3 * most.max():.2f} kN")

# %%
# The force of one pad at the mouth over time.  Positive forces push.

pad = next(k for k, name in enumerate(names) if "mouth top" in name)
figure, axes = plt.subplots(figsize=(8, 4), layout="constrained")
for name, motion in motions.items():
    axes.plot(motion.t, 1e-3 * motion.slider_force[:, pad], lw=0.9, label=name)
axes.axhline(0.0, color="k", lw=0.5)
axes.set(xlabel="t in s", ylabel=f"{names[pad]} in kN")
axes.legend()
plt.show()
