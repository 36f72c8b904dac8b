"""Signals as the kernel evaluates them, beside themselves."""

from __future__ import annotations

import numpy as np
import pytest

from pmr.kernel.kernel import Signals
from pmr.scene.signals import Chirp, Constant, Ramp, Sine, SmoothRamp, Step, Sum, Table
from pmr.simulation.frame_motion import Acceleration

KNOTS = {"times": (0.5, 1.0, 2.5, 3.0), "values": (1.0, 4.0, -2.0, 0.5)}
SIGNALS = {
    "constant": Constant(amount=3.5),
    "ramp": Ramp(**KNOTS),
    "smooth": SmoothRamp(**KNOTS),
    "smoother": SmoothRamp(**KNOTS, degree=9),
    "akima": Table(**KNOTS),
    "linear": Table(**KNOTS, interpolation="linear"),
    "step": Step(time=1.25, before=-1.0, after=2.0),
    "sine": Sine(amplitude=2.0, frequency=1.5, phase=0.3, offset=-1.0),
    "chirp": Chirp(amplitude=50.0, times=(0.5, 1.5, 3.0), frequencies=(1.0, 10.0, 2.0), phase=0.2),
    "acceleration": Acceleration(paths=(Ramp(**KNOTS), SmoothRamp(**KNOTS)), step=1e-2),
    "sum": Sum(terms=(Ramp(**KNOTS), Sine(amplitude=2.0, frequency=1.5), Constant(amount=1.0))),
}
TIMES = np.concatenate([np.linspace(0.0, 4.0, 81), [0.5, 1.0, 1.25, 1.5, 2.5, 3.0]])


def test_values_and_rates_are_those_of_the_signals() -> None:
    """All at once, at breaks too, where the piece that begins there counts."""
    signals = Signals(list(SIGNALS.values()))
    found = [signals.at(t) for t in TIMES.tolist()]
    for k, (name, signal) in enumerate(SIGNALS.items()):
        second = np.zeros(len(TIMES)) if name == "acceleration" else signal.second_rate(TIMES)
        expected = np.array([signal.value(TIMES), signal.rate(TIMES), second])
        seen = np.array([signals_at_time[:, k] for signals_at_time in found]).T
        for one, other in zip(seen, expected, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-11, atol=1e-11 * np.abs(other).max() + 1e-14, err_msg=name)


def test_a_signal_that_is_no_sum_of_pieces_is_refused() -> None:
    class Other(Constant):
        kind: str = "other"  # type: ignore[assignment]

        @property
        def strands(self):  # type: ignore[no-untyped-def]
            return super(Constant, self).strands

    with pytest.raises(NotImplementedError, match="Other"):
        Signals([Constant(amount=1.0), Other(amount=2.0)])
