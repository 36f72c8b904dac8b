"""What is asked of all bodies of a scene together."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import Field, model_validator

from pmr.scene import asked
from pmr.scene.built import Gravity
from pmr.scene.frame import Frame
from pmr.scene.section import Section, Text


class Whole(Section):
    """What is asked of all bodies together."""

    title: Text = Field(description="For reports")
    gravity: Gravity | None = Field(
        default=None,
        description="The weight of everything.  Without this table a body alone has no weight, and sections that slide "
        "in one another have theirs, which presses them on their pads",
    )
    frame: Frame | None = Field(
        default=None, description="A frame that luffs and slews, in which all bodies move and gravity turns"
    )
    start: Literal["rest", "equilibrium"] = Field(
        default="rest",
        description="How motions begin: undeformed and at rest, or in equilibrium under the loads at t = 0.  Rest is "
        "the default of a body alone, equilibrium that of sections that slide in one another: loose in their pads they "
        "would begin with a fall",
    )
    damping: asked.Damping = Field(default=asked.Damping(), description="Of the material")
    time: asked.TimeChoice = Field(description="Simulated time and its steps")
    recovery: asked.Recovery | None = Field(default=None, description="Fields and stresses from reduced coordinates")
    fatigue: asked.Fatigue | None = Field(default=None, description="Damage by load cycles at probes of stress")
    simulation: asked.Simulation = Field(default=asked.Simulation(), description="Who simulates")
    compare: asked.Compare = Field(default=asked.Compare(), description="What the reduced model is compared with")
    accuracy: asked.Accuracy | None = Field(
        default=None, description="An allowed error, in place of coordinates and step"
    )
    budget: asked.Budget | None = Field(default=None, description="What a model may cost, in place of an allowed error")
    published: asked.Published | None = Field(default=None, description="Figures from a publication")
    free_motions: Literal["refused", "allowed"] = Field(
        default="refused",
        description="Motions of the whole or a section that no support, pad or cylinder resists somewhere on the way: "
        "loads move it along them without limit; pads that only push count as holding",
    )

    @model_validator(mode="before")
    @classmethod
    def _begun(cls, data: Any) -> Any:
        """The start, and a weight that fits it: what begins in equilibrium has its weight from the start."""
        if not isinstance(data, Mapping):
            return data
        sections = data.get("sections", ())
        several = isinstance(sections, list | tuple) and len(sections) > 1
        start = data.get("start", "equilibrium" if several else "rest")
        gravity = data.get("gravity", {} if several else None)
        if isinstance(gravity, dict) and start == "equilibrium":
            gravity = {"rise": 0.0} | gravity
        return {**data, "start": start, "gravity": gravity}
