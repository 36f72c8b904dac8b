"""A planar beam's part of a report."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from pmr.report import marks, provenance, sentences
from pmr.report.animation import animation, scale_text
from pmr.report.case import Case, common
from pmr.report.figures import drawings
from pmr.results import RunResult


@dataclass(frozen=True, kw_only=True)
class PlanarCase(Case):
    """Beside what every case says, the motion as data for the player and its scale in words."""

    template: ClassVar[str] = "case.html"
    animation: dict[str, Any]
    scale: str


def case(result: RunResult, anchor: str) -> PlanarCase:
    """Everything that the report says about one run."""
    table, motion = marks.rows(result), animation(result)
    return PlanarCase(
        **common(result, anchor, table),
        key_numbers=sentences.key_numbers(result),
        paragraph=sentences.paragraph(result, table),
        about="the transverse displacement",
        drawings=drawings(result, anchor),
        animation=motion,
        scale=scale_text(motion),
        provenance=provenance.tables(result),
    )
