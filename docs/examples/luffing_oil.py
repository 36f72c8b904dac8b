"""
A boom let down through a counterbalance valve
==============================================

The luffing angle is not prescribed: a proportional valve feeds the cylinder, and a counterbalance valve holds the load.
On the way down the pressure on the rod side has to open the counterbalance valve.  A larger pilot ratio takes less
pressure for it, but makes the boom less steady.
"""

import matplotlib.pyplot as plt
import numpy as np

import pmr

RATIOS = (1.5, 3.0)
QUICK = ["section.mesh.elements=8", "section.reduction.estimate=false", "time.step=4e-3"]
system = pmr.reduce(pmr.load_scene("luffing_oil", QUICK)).system
runs = {}
for ratio in RATIOS:
    scene = pmr.load_scene("luffing_oil", [*QUICK, f"frame.cylinder.oil.counterbalance.ratio={ratio}"])
    runs[ratio] = pmr.simulate(scene, system)

# %%
# The valve is open to one side from 0.5 to 4.5 s and to the other from 6 to 9.5 s.  After each move the boom swings on
# the shut oil, as on a spring.

figure, axes = plt.subplots(3, sharex=True, figsize=(7, 7), layout="constrained")
for ratio, run in runs.items():
    name = f"pilot ratio {ratio:g}"
    axes[0].plot(run.t, np.rad2deg(run.other("luffing angle")), label=name)
    (line,) = axes[1].plot(run.t, 1e-6 * run.other("luffing cylinder pressure bore"), label=name)
    axes[1].plot(run.t, 1e-6 * run.other("luffing cylinder pressure rod"), "--", color=line.get_color())
    axes[2].plot(run.t, 1e-3 * run.other("luffing cylinder power supply"), label=name)
axes[0].set(ylabel="angle in degrees")
axes[1].set(ylabel="pressure in MPa", title="lines: bore; dashed: rod side")
axes[2].set(ylabel="supply in kW", xlabel="time in s")
axes[0].legend()
plt.show()

# %%
pressure, sway = {}, {}
for ratio, run in runs.items():
    late = (run.t > 8.0) & (run.t < 9.0)  # the boom goes down, and its swing has died out as far as it does
    rate = run.other("rate of luffing angle")[late]
    pressure[ratio] = run.other("luffing cylinder pressure rod")[late].mean()
    sway[ratio] = np.ptp(rate) / abs(rate.mean())
    print(f"pilot ratio {ratio:g}: {1e-6 * pressure[ratio]:.1f} MPa on the rod side; "
          f"the rate of the angle varies by {100 * sway[ratio]:.0f} %")  # fmt: skip
