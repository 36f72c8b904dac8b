"""
A crane's boom that is raised
=============================

`pmr new crane` writes a scene of a boom of three sections that luffs, slews and telescopes with a load.  Here the hook
becomes heavier, and the lowest natural frequency of the extended boom is compared.  A boom with a low frequency sways.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
from typer.testing import CliRunner

import pmr
from pmr.cli.app import app
from pmr.report.document import render_runs
from pmr.report.sections import chapter

hooks = [150.0, 2400.0]  # kg
curves, sway, luffing = {}, {}, {}
with TemporaryDirectory() as folder:
    CliRunner().invoke(app, ["new", "crane", f"{folder}/crane"])  # as `pmr new crane crane` does
    for hook in hooks:
        changes = [f"sections.fly.masses.hook block.mass={hook}", "section.mesh.elements=6", "time.step=1e-2"]
        changes += ["section.reduction.estimate=false", "simulation.repeats=1", "frame.second_order=false"]
        result = pmr.run(pmr.load_scene(Path(folder, "crane"), changes)).result
        curves[hook] = result.frequencies
        sway[hook] = result.summary["errors"]["reduced_vs_full"]["tip"]
        luffing[hook] = result.responses["reduced"].other("reaction of pivot cylinder")
        print(f"{hook:.0f} kg: {curves[hook].models['full'][:, 0].min():.2f} Hz at the lowest; "
              f"the luffing cylinder presses with {1e-3 * luffing[hook].max():.0f} kN; "
              f"the reduced model is off by {100 * sway[hook]:.3f} %")  # fmt: skip

# %%
figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
for hook, curve in curves.items():
    (line,) = axes.plot(curve.along, curve.models["full"][:, 0], label=f"{hook:.0f} kg")
    axes.plot(curve.along, curve.models["reduced"][:, 0], "o", mfc="none", ms=4, color=line.get_color())
axes.set(xlabel="boom length in m", ylabel="lowest frequency in Hz", title="lines: full model; circles: reduced")
axes.legend()
plt.show()

# %%
# The page of the last run's report, with the boom in its true position, to play.

report = render_runs([chapter(result, "crane")])
