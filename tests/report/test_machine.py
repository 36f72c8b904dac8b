"""What was asked for, in words."""

from __future__ import annotations

from pydantic import TypeAdapter

from pmr.report.machine import describe_signal
from pmr.scene.signals import Signal


def test_the_degree_of_a_ramp_has_no_unit() -> None:
    ramp = TypeAdapter(Signal).validate_python({"kind": "smooth_ramp", "times": [0.5, 4.5], "values": [0.8, 3.8]})
    assert describe_signal(ramp, "m") == "smooth ramp, times (0.5, 4.5)\u00a0s, values (0.8, 3.8)\u00a0m, degree 5"
