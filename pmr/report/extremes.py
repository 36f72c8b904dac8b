"""A row of the table of largest values, and clauses that say where and when a value is largest."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from pmr.report import sentences
from pmr.report.numbers import SPACE, format_input, format_time
from pmr.report.subject import crossing, is_alone, moving_part
from pmr.report.subject import reach as reach_of
from pmr.results import RunResult
from pmr.results.field_stress import PeakSummary
from pmr.results.response import Extreme


class LargestValue(NamedTuple):
    """Row of the table of largest values: its name, its text, and the share of the allowed value, None if unknown."""

    name: str
    text: str
    share: float | None = None


LargestValues = Iterator[LargestValue]


def peak_place_clause(result: RunResult, peak: PeakSummary) -> str:
    """Clause with the point and the time of a largest stress, and with the boom's angles at that time."""
    where = [sentences.peak_part_name(peak), f"{two_decimals(peak['position'][0])}{SPACE}m from the tail"]
    return f"{', '.join(filter(None, where))}, at {format_time(peak['t'])}{angles_clause(result, peak['t'])}"


def extreme_clause(result: RunResult, extreme: Extreme) -> str:
    """Clause with the time of an extreme value, and with the reach (or path coordinate) and the angles at that time."""
    where = ", ".join(filter(None, (f"at {format_time(extreme.t)}", position_text(result, extreme.s))))
    return f"{where}{angles_clause(result, extreme.t)}"


def angles_clause(result: RunResult, t: float) -> str:
    """Clause at the end of a sentence: luffing and slewing angle in degrees of a boom in a frame at `t` in s.

    It begins with a comma (", raised 30°, slewed 10°").  An angle that the frame does not set is left out; without a
    frame the clause is empty.
    """
    frame = result.frame
    if frame is None:
        return ""
    luffing, slewing = (float(np.rad2deg(angle.value(np.array([t]))[0])) for angle in frame.angles)
    angles = [] if frame.luffing is None else [f"raised {format_input(round(luffing, 1))}°"]
    angles += [] if frame.slewing is None else [f"slewed {format_input(round(slewing, 1))}°"]
    return "".join(f", {angle_text}" for angle_text in angles)


def position_text(result: RunResult, position: float) -> str:
    """Describe `position` in m: the length of a boom, the length of a section beyond its mouth, or s of the sliders.

    The text is empty for a body that does not slide.
    """
    if mover := crossing(result):
        return f"{mover} at {two_decimals(position)}{SPACE}m"
    if not is_alone(result):
        return f"boom length {two_decimals(position)}{SPACE}m"
    if moving_part(result) == "mouth":
        return f"{two_decimals(reach_of(result) - position)}{SPACE}m out"
    return f"s = {two_decimals(position)}{SPACE}m" if moving_part(result) else ""


def two_decimals(value: float) -> str:
    """Format the number `value`, rounded to two decimals."""
    return format_input(round(value, 2))
