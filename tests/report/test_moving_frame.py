"""What a report says of a frame that moves."""

from __future__ import annotations

from typing import Any

import pytest

from pmr.report.moving_frame import frame
from pmr.results import RunResult

TURNING = {
    "luffing": {"min": 0.0, "max": 1.0471975511965976},
    "slewing": {"min": 0.0, "max": 0.0},
    "angular_velocity": 0.1,
    "gyroscopic": 0.02,
    "centrifugal": 0.0001,
}


class _Result:
    def __init__(self, **summary: Any) -> None:
        self.summary = summary


def said(**summary: Any) -> str:
    result: RunResult = _Result(**summary)  # type: ignore[assignment]
    return frame(result)


def test_nothing_is_said_of_a_frame_that_there_is_not() -> None:
    assert said() == ""


def test_what_is_left_out_is_said_with_its_size() -> None:
    text = said(frame={**TURNING, "second_order": False})
    assert "raised between 0° and 60°" in text and "slewed" not in text
    assert "left out" in text and "2.00\u00a0% (gyroscopic)" in text


@pytest.mark.parametrize(("factor", "expected"), [(3.2, "3.2"), (None, "no axial force presses")])
def test_second_order_is_said_with_the_buckling_factor(factor: float | None, expected: str) -> None:
    text = said(frame={**TURNING, "second_order": True}, buckling={"factor": factor, "t": 10.0})
    assert expected in text and "left out" not in text
