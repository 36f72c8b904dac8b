"""
A load chart, and what a heavier carrier changes
================================================

A load chart has the load that a crane boom carries at every extension and angle, and the limit that governs there.
:doc:`/tutorials/load_chart` makes one from an empty folder.  Here one chart has two limits of tipping, for carriers of
14 and 20 tonnes.  Where the boom is far out and low, tipping governs, so the crane with the heavier carrier carries
more.  Farther out the tip's deflection governs, elsewhere the luffing cylinder, and nothing changes.  Last comes the
chart of a boom lift whose geometry is published: there stress, the tip and the pads govern.  Error bars are left out,
because they take most of the time.
"""

import csv
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np
from typer.testing import CliRunner

from pmr.cli.app import app

STUDY = """
kind = "chart"
title = "What the crane carries"
scene = "crane/scene.toml"
up_to = 20000.0
error_bars = false
extensions = { least = 0.8, most = 4.5, count = 6 }
luffing = { least = 0.0, most = 75.0, count = 6 }

[[limits]]
name = "luffing cylinder"
of = "luffing"
most = 400e3

[[limits]]
name = "tip"
of = "deflection"
most = 0.25
"""
TIPPING = """
[[limits]]
name = "tipping, {0} t"
of = "overturning"
factor = 1.33
polygon = [[2.5, 2.5], [-2.5, 2.5], [-2.5, -2.5], [2.5, -2.5]]
machine = [{{ name = "carrier", mass = {0}e3, at = [-0.5, 0.0, -1.0] }}]
"""
carriers = (14, 20)  # t


def rows(out: Path) -> list[dict[str, str]]:
    """The points of a chart."""
    with (out / "chart.csv").open() as table:
        return list(csv.DictReader(table))


with TemporaryDirectory() as folder:
    CliRunner().invoke(app, ["new", "crane", f"{folder}/crane"])  # as `pmr new crane crane` does
    file, out = Path(folder, "chart.toml"), Path(folder, "chart")
    file.write_text(STUDY + "".join(TIPPING.format(mass) for mass in carriers))
    CliRunner().invoke(app, ["study", str(file), "--jobs", "1", "--out", str(out)])  # as `pmr study chart.toml` does
    chart, report = rows(out), (out / "report.html").read_text()
    lift_of = ["study", "chart_boom_lift", "--jobs", "1", "--set", "error_bars=false"]  # a study that comes with `pmr`
    CliRunner().invoke(app, [*lift_of, "--out", f"{folder}/lift"])
    lift = rows(Path(folder, "lift"))

# %%
# A row of ``chart.csv`` has the load of every limit.  An empty cell is a limit that is not reached.  The limit with the
# smallest load governs.

radius = np.array([float(row["radius [m]"]) for row in chart])
figure, both = plt.subplots(1, 2, figsize=(9, 4), sharey=True, layout="constrained")
charts = {}
for axes, mass in zip(both, carriers, strict=True):
    limits = ["luffing cylinder", "tip", f"tipping, {mass} t"]
    loads = np.array([[float(row[f"{name} [kg]"] or "inf") for name in limits] for row in chart])
    governs, load = loads.argmin(axis=1), loads.min(axis=1)
    charts[mass] = governs, load
    for k, name in enumerate(("luffing cylinder", "tip", "tipping")):
        axes.plot(radius[governs == k], 1e-3 * load[governs == k], ".", label=f"{name} governs")
    axes.set(xlabel="radius in m", title=f"carrier of {mass} t")
both[0].set_ylabel("load in t")
both[0].legend()
plt.show()

# %%
# The boom lift's platform, over radius and height: the overlap of its sections shrinks from 35 to 5 % of the last one.
# Pads that are close to each other bear many times the load, so fully out it may not be lowered far, even empty.
figure, axes = plt.subplots(figsize=(6, 5), layout="constrained")
for name, marker in (("stress", "o"), ("tip", "s"), ("pads", "^")):
    chosen = [row for row in lift if row["governed by"] == name]
    radius, height, load = (
        np.array([float(row[key]) for row in chosen]) for key in ("radius [m]", "height [m]", "load [kg]")
    )
    shown = axes.scatter(radius, height, c=load, marker=marker, vmin=0.0, vmax=1000.0, label=f"{name} governs")
axes.set(xlabel="radius in m", ylabel="height in m", aspect="equal")
axes.legend()
figure.colorbar(shown, label="load in kg", extend="max")
plt.show()

# %%
# The page of the crane's report: load over radius and height, on the lighter carrier.  A pointer on the picture shows
# what each limit allows.
