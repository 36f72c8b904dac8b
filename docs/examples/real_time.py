"""
One step at a time, in a loop of one's own
==========================================

An operator's stick, a controller, or hardware under test decides in every step where the boom goes.  `pmr.Stepper`
advances a reduced model by one step per call, in about a microsecond, and allocates no memory.
"""

import time

import matplotlib.pyplot as plt
import numpy as np

import pmr

scene = pmr.load_scene("evolved_residual", ["damping.ratio=0.03", "damping.frequencies=[2.0, 20.0]"])
model = pmr.reduce(scene).reduced

# %%
# The operator pushes the stick forward at 1 s and lets go at 3 s; the slider's speed follows the stick with a lag of
# 0.2 s.  A force of 30 N hangs on the tip from 0.5 s on.

h, lag = 1e-3, 0.2
stepper = pmr.Stepper(model, step=h, s=1.25)
s, speed, track = 1.25, 0.0, []
begin = time.perf_counter()
for k in range(6000):
    t = (k + 1) * h
    stick = 1.0 if 1.0 <= t < 3.0 else 0.0
    speed += h / lag * (stick - speed)
    s = min(s + h * speed, 3.75)
    tip = stepper.step(s, -30.0 if t > 0.5 else 0.0)[-1]
    track.append((t, s, tip))
seconds = time.perf_counter() - begin
t, s, tip = np.array(track).T
print(f"slider at {s[-1]:.2f} m in the end, tip {1e3 * tip[-1]:.1f} mm below, lowest {1e3 * tip.min():.1f} mm")
print("faster than real time" if seconds < t[-1] else "slower than real time")

# %%
figure, (above, below) = plt.subplots(2, 1, sharex=True, figsize=(8, 4.5), layout="constrained")
above.plot(t, s)
above.set_ylabel("slider in m")
below.plot(t, 1e3 * tip, lw=0.8)
below.set(xlabel="t in s", ylabel="tip in mm")
plt.show()
