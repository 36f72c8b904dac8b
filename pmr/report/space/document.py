"""A structure in space, ready for its template."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from pmr.report import marks, sentences
from pmr.report.case import Case, common
from pmr.report.provenance import Table
from pmr.report.space import provenance
from pmr.report.space.figures import drawings, force_names, tip_names
from pmr.report.space.pictures import Album, album
from pmr.report.space.player import player, said
from pmr.report.space.sentences import paragraph
from pmr.results import RunResult


@dataclass(frozen=True, kw_only=True)
class SpaceCase(Case):
    """Beside what every case says: pictures, the motion for the player, names of figures that repeat, sizes."""

    template: ClassVar[str] = "space_case.html"
    album: Album
    player: dict[str, Any]
    player_scale: str
    tips: list[str]
    forces: list[str]
    sizes: list[list[Table]]


def case(result: RunResult, anchor: str) -> SpaceCase:
    """Everything that the report says about one run."""
    motion = player(result)
    return SpaceCase(
        **common(result, anchor, marks.rows(result)),
        key_numbers=sentences.key_numbers(result),
        paragraph=paragraph(result),
        about="displacements and pad forces",
        drawings=drawings(result, anchor),
        album=album(result, anchor),
        player=motion,
        player_scale=said(motion),
        tips=tip_names(result),
        forces=force_names(result),
        sizes=provenance.sizes(result),
        provenance=provenance.tables(result),
    )
