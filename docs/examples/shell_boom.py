"""
A boom whose walls give way
===========================

Pads bend the thin walls of a boom; a beam has no walls.  Here the section is a shell of triangles.  It is reduced to
ten coordinates, from which displacement and stress of every wall are recovered.
"""

import matplotlib.pyplot as plt
import numpy as np

import pmr
from pmr.report.document import render_runs
from pmr.report.sections import chapter

coarse = ["mesh.size=0.15", "mesh.along=0.4", "time.end=3.0", "slider.path.times=[0.5, 1.5, 2.5]", "recovery.frames=31"]
scene = pmr.load_scene("boom_shell", [*coarse, "compare.against=[]", "recovery.series=false", "simulation.repeats=1"])
result = pmr.run(scene).result

summary = result.summary
peak = summary["max_von_mises"]["reduced"]
print(f"{summary['coordinates']['full']} degrees of freedom, {summary['coordinates']['reduced']} coordinates")
print(f"error by the estimate: {100 * summary['estimate']['tip']:.3f} % at the tip")
print(f"largest von Mises stress {1e-6 * peak:.0f} MPa")

# %%
# The largest stress of all walls over time, and where on the boom it is at its worst: beside a pad.

fields = result.body.fields
walls = np.max([stress.max(axis=0) for stress in fields.von_mises.values()], axis=0)
centre = fields.points[fields.cells].mean(axis=1)
worst = float(centre[walls.argmax(), 0])
print(f"at x = {worst:.1f} m")

figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.5), layout="constrained")
left.plot(np.linspace(0.0, 3.0, len(result.body.peak_stress["reduced"])), 1e-6 * result.body.peak_stress["reduced"])
left.set(xlabel="t in s", ylabel="largest von Mises stress in MPa")
right.plot(centre[:, 0], 1e-6 * walls, ".", ms=3)
right.set(xlabel="x in m", ylabel="largest in each cell in MPa")
plt.show()

# %%
# The page of the run's report, to play and to turn.

report = render_runs([chapter(result, "boom")])
