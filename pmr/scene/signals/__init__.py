"""Signals over time: slider paths s(t) in m and loads F(t) in N (or N m), each with its rate.

A signal is written in a scene as a table with a ``kind`` (or as a plain number, which is constant)::

    path   = { kind = "ramp", times = [3.75, 11.25], values = [1.25, 3.75] }
    signal = { kind = "chirp", amplitude = 50.0, times = [0.0, 7.5, 15.0], frequencies = [1.0, 10.0, 1.0] }
"""

from pmr.scene.signals.base import Chirp, Constant, SignalBase, Sine, Step
from pmr.scene.signals.knots import Ramp, SmoothRamp, Table
from pmr.scene.signals.sums import Signal, Sum

__all__ = [
    "Chirp", "Constant", "Ramp", "Signal", "SignalBase", "Sine", "SmoothRamp", "Step", "Sum", "Table",
]  # fmt: skip
