"""
Model and step for a tolerance
==============================

How many coordinates are enough, and how long may a step be?  Give the allowed error, and `pmr` chooses both.
"""

import matplotlib.pyplot as plt

import pmr

tolerances = [0.05, 0.02, 0.01]
found = {}
for tolerance in tolerances:
    changes = [f"accuracy.tolerance={tolerance}", "accuracy.mesh=false", "mesh.elements=24"]
    summary = pmr.run(pmr.load_scene("evolved_tolerance", changes)).result.summary
    chosen, budget = summary["accuracy"]["chosen"], summary["budget"]
    found[tolerance] = (
        budget["reduction"]["beam"],
        budget["step"]["beam"],
        chosen["step"],
        summary["accuracy"]["holds"],
    )
    print(f"{100 * tolerance:g} %: {chosen['coordinates']} coordinates, steps of {1e3 * chosen['step']:.3g} ms")

# %%
# The tolerance is for the sum of both errors, that of the reduction and that of the step.

figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
places = range(len(tolerances))
reduction, step = ([100 * found[tolerance][k] for tolerance in tolerances] for k in (0, 1))
axes.bar([k - 0.2 for k in places], reduction, 0.4, label="reduction")
axes.bar([k + 0.2 for k in places], step, 0.4, label="time step")
for k, tolerance in enumerate(tolerances):
    axes.hlines(100 * tolerance, k - 0.4, k + 0.4, color="k")
axes.set(yscale="log", ylabel="parts of the error in %", title="lines: what was allowed")
axes.set_xticks(places, [f"{100 * t:g} %" for t in tolerances])
axes.legend()
plt.show()
