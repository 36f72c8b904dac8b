"""
A load chart, and what a heavier carrier changes
================================================

A load chart has the load that a crane boom carries at every extension and angle, and the limit that governs there.
:doc:`/tutorials/load_chart` makes one from an empty folder.  Here the chart is computed twice, for carriers of 14 and
20 tonnes.  Where the boom is far out and low, tipping governs, so the crane with the heavier carrier carries more.
Elsewhere the luffing cylinder governs, and nothing changes.  Last comes the chart of a boom lift whose geometry is
published: there stress, the tip and the pads govern.
"""

import csv
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np
from typer.testing import CliRunner

from pmr.cli.app import app
from pmr.report.studies.document import page

STUDY = """
kind = "chart"
title = "What the crane carries"
scene = "crane/scene.toml"
up_to = 20000.0
extensions = { least = 0.8, most = 4.5, count = 8 }
luffing = { least = 0.0, most = 75.0, count = 9 }

[[limits]]
name = "luffing cylinder"
of = "luffing"
most = 400e3

[[limits]]
name = "tip"
of = "deflection"
most = 0.25

[[limits]]
name = "tipping"
of = "overturning"
factor = 1.33
polygon = [[2.5, 2.5], [-2.5, 2.5], [-2.5, -2.5], [2.5, -2.5]]
machine = [{ name = "carrier", mass = MASS, at = [-0.5, 0.0, -1.0] }]
"""
carriers = [14000.0, 20000.0]  # kg
charts = {}


def rows(out: Path) -> list[dict[str, str]]:
    """The points of a chart."""
    with (out / "chart.csv").open() as table:
        return list(csv.DictReader(table))


with TemporaryDirectory() as folder:
    CliRunner().invoke(app, ["new", "crane", f"{folder}/crane"])  # as `pmr new crane crane` does
    for mass in carriers:
        file, out = Path(folder, f"{mass:.0f}.toml"), Path(folder, f"{mass:.0f}")
        file.write_text(STUDY.replace("MASS", str(mass)))
        CliRunner().invoke(app, ["study", str(file), "--out", str(out)])  # as `pmr study 14000.toml` does
        charts[mass] = rows(out)
        report = page(out)
    CliRunner().invoke(app, ["study", "chart_boom_lift", "--out", f"{folder}/lift"])  # a study that comes with `pmr`
    lift = rows(Path(folder, "lift"))

# %%
figure, both = plt.subplots(1, 2, figsize=(9, 4), sharey=True, layout="constrained")
for axes, (mass, rows) in zip(both, charts.items(), strict=True):
    for name in ("luffing cylinder", "tip", "tipping"):
        chosen = [row for row in rows if row["governed by"] == name]
        radius, load = (np.array([float(row[key]) for row in chosen]) for key in ("radius [m]", "load [kg]"))
        axes.plot(radius, 1e-3 * load, ".", label=f"{name} governs")
    axes.set(xlabel="radius in m", title=f"carrier of {1e-3 * mass:.0f} t")
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
# The page of the report for the crane on the heavier carrier: load over radius and height.  A pointer on the picture
# shows what each limit allows.
