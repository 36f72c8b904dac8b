"""
A crane's boom that is raised
=============================

`pmr new crane` writes a scene of a boom that is raised by 60 degrees and telescopes with a load.  Here the load grows,
and what counts is how low the first frequency gets where the boom is far out: a crane driver feels it as swaying.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
from typer.testing import CliRunner

import pmr
from pmr.cli.app import app
from pmr.report.document import page
from pmr.report.sections import chapter

loads = [100.0, 400.0, 1600.0]  # kg on the hook
curves, sway = {}, {}
with TemporaryDirectory() as folder:
    CliRunner().invoke(app, ["new", "crane", f"{folder}/crane"])  # as `pmr new crane crane` does
    for load in loads:
        changes = [f"masses.hook block.mass={load}", "mesh.elements=20", "simulation.repeats=1"]
        changes += ["recovery={every=0.1,series=false}"]  # for the boom in motion
        result = pmr.run(pmr.load_scene(Path(folder, "crane"), changes)).result
        curves[load] = result.frequencies
        sway[load] = result.summary["errors"]["reduced_vs_full"]["tip"]
        (cylinder,) = result.summary["reactions"]
        print(f"{load:.0f} kg: {curves[load].models['full'][:, 0].min():.2f} Hz at the lowest; "
              f"the cylinder holds {-1e-3 * cylinder['min']:.1f} kN; "
              f"{len(result.body.shapes.shapes.T)} coordinates are off by {100 * sway[load]:.3f} %")  # fmt: skip

# %%
figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
for load, curve in curves.items():
    (line,) = axes.plot(12.0 - curve.along, curve.models["full"][:, 0], label=f"{load:.0f} kg")
    axes.plot(12.0 - curve.along, curve.models["reduced"][:, 0], "o", mfc="none", ms=4, color=line.get_color())
axes.set(xlabel="length that is out in m", ylabel="lowest frequency in Hz", title="lines: full model; circles: reduced")
axes.legend()
plt.show()

# %%
# The page of the last run's report, to play and to turn.

report = page([chapter(result, "crane")])
