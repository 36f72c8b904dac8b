"""
Stress at a weld, and its load cycles
=====================================

A weld is sized by the range of the stress beside it and by the number of its cycles.  A probe in a scene records the
signed stress at a place at every step, as one more output.  Rainflow counting gives its cycles, and pandas reads them.
The report of such a run shows the cycles, too.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt

import pmr
import pmr.results

SCENE = """
extends = "boom_shell"
compare.against = []
reduction.estimate = false
recovery.every = 10.0

[mesh]
size = 0.15
along = 0.4

[[probes]]
name = "weld"
at = [1.5, 0.0, -0.2]
measures = ["stress"]
face = "outer"
"""

# %%
# The weld is on the bottom of the boom, at a place that the mouth passes twice.

with TemporaryDirectory() as folder:
    Path(folder, "weld.toml").write_text(SCENE)
    result = pmr.run(pmr.load_scene(Path(folder, "weld.toml"), ["simulation.repeats=1"])).result
    result.save(Path(folder))
    found = pmr.results.load(folder)

stress = 1e-6 * found["reduced"]["weld stress along [Pa]"]
cycles = found["cycles"].query("probe == 'weld stress along'")
print(cycles[["range", "mean", "count"]].head(3).to_string(index=False, float_format="{:.3g}".format))

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.5), layout="constrained", width_ratios=[2, 1])
left.plot(stress.index, stress, lw=0.7)
left.set(xlabel="t in s", ylabel="stress along the boom in MPa")
right.hist(1e-6 * cycles["range"], weights=cycles["count"], bins=12)
right.set(xlabel="range in MPa", ylabel="cycles")
plt.show()
