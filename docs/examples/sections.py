"""
Sections that slide in each other
=================================

Three steel boxes of 6 m, one in the other, telescope together under a payload. Each section is reduced by itself. A pad
between two sections is fixed to one of them and slides along the other. Pads only push.
"""

import matplotlib.pyplot as plt
import numpy as np

import pmr

short = ["time.end=4.0", "section.mesh.elements=12", "section.reduction.estimate=false", "simulation.repeats=1"]
boom = pmr.load_scene("boom_three", short)
result = pmr.run(boom).result
summary = result.summary
for section in summary["sections"]:
    sizes = section["coordinates"]
    print(f"{section['name']}: {sizes['full']} degrees of freedom, {sizes['reduced']} coordinates")
errors = summary["errors"]["reduced_vs_full"]
print(f"{100 * errors['tip']:.4f} % off at the tip")

# %%
# Largest force of each pad.  It is largest at the bottom of the base's mouth, because all sections that are out rest
# there.

pads = summary["pads"]
heaviest = max(pads, key=lambda pad: pad["max"])
print(f"{1e-3 * heaviest['max']:.1f} kN on {heaviest['name']}")

full, reduced = result.responses["full"], result.responses["reduced"]
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.5), layout="constrained", width_ratios=[3, 2])
left.plot(full.t, 1e3 * full.tip, "k", label="full")
left.plot(reduced.t, 1e3 * reduced.tip, "--", color="tab:orange", label="reduced")
left.set(xlabel="t in s", ylabel="tip in mm")
left.legend()
names = [pad["name"] for pad in pads]
right.barh(np.arange(len(pads)), [1e-3 * pad["max"] for pad in pads])
right.set_yticks(np.arange(len(pads)), names, fontsize="small")
right.set(xlabel="largest force in kN")
plt.show()
