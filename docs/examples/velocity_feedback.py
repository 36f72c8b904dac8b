"""
Frequency response and a controller
===================================

With the slider at a fixed place a reduced model is a state space, which python-control can read.  Here it computes the
frequency response at the tip for three places of the slider, and a feedback that damps the tip at all of them.
"""

import runpy
from pathlib import Path
from tempfile import TemporaryDirectory

import control
import matplotlib.pyplot as plt
import numpy as np

import pmr
from pmr.export.formats import Options, write

places = [1.25, 2.5, 3.75]
scene = pmr.load_scene("evolved_residual")
with TemporaryDirectory() as folder:
    model, script = Path(folder, "reduced.npz"), Path(folder, "beam.py")
    pmr.reduce(scene).reduced.save(model)
    write("python-control", model, script, Options(fmi=None, at="1.25,2.5,3.75"))
    spaces = runpy.run_path(str(script))  # `from beam import system`

tip = max(k for k, name in enumerate(spaces["system"](0).output_labels) if "force" not in name)
beams = [spaces["system"](k)[tip, 0] for k in range(len(places))]

# %%
# A velocity feedback at the tip, :math:`F = -g\,\dot y`, damps the first mode at every place, since sensor and force
# are at one point.

gain = 60.0  # N s/m
derivative = control.tf([1.0, 0.0], [1e-5, 1.0])
damped = [control.feedback(beam, gain * derivative) for beam in beams]


def damping(system: control.StateSpace) -> float:
    """Of the slowest oscillation."""
    poles = system.poles()
    oscillating = poles[poles.imag > 1e-6]
    slowest = oscillating[np.argmin(np.abs(oscillating))]
    return abs(float(slowest.real / abs(slowest)))


before, after = [damping(beam) for beam in beams], [damping(beam) for beam in damped]
for s, one, other in zip(places, before, after, strict=True):
    print(f"slider at {s} m: damping ratio of the first mode {one:.4f}, with feedback {other:.3f}")

# %%
f = np.geomspace(0.5, 40.0, 1500)
figure, axes = plt.subplots(figsize=(8, 4), layout="constrained")
for s, beam, with_feedback in zip(places, beams, damped, strict=True):
    (line,) = axes.loglog(f, np.abs(beam(2j * np.pi * f)), lw=0.7, label=f"{s} m")
    axes.loglog(f, np.abs(with_feedback(2j * np.pi * f)), "--", color=line.get_color())
axes.set(xlabel="f in Hz", ylabel="tip in m per N", title="without (thin) and with feedback (dashed)")
axes.legend(title="slider at")
plt.show()
