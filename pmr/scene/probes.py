"""Places whose stress, strain or motion is followed through every step."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from pmr.scene.section import Point, Section

Measured = Literal["stress", "strain", "displacement"]


class Probe(Section):
    """What is followed at a point, where the model's point next to it counts, or on a group, whose mean counts.

    Probes are outputs of the full model and of the reduced one: signed, at every step, without a simulation more.
    """

    name: str = Field(min_length=1, description="What its columns are called by")
    at: Point | None = Field(default=None, description="A point on the body, x along it, z up")
    on: str | None = Field(default=None, description="A named group in place of a point: of stresses, a group of cells")
    measures: tuple[Measured, ...] = Field(default=("stress",), min_length=1, description="What is followed there")
    face: str = Field(
        default="",
        description="Face of a wall (outer, middle, inner) or corner of a beam's section (top left, ...); by default "
        "where the nearest point is, of a group the outer face",
    )

    @model_validator(mode="after")
    def _one_place(self) -> Probe:
        if (self.at is None) == (self.on is None):
            raise ValueError("give at or on, one of them")
        if len(set(self.measures)) < len(self.measures):
            raise ValueError("each measure once is allowed")
        return self
