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
    """Tables about all bodies together."""

    title: Text = Field(description="Title of the report")
    gravity: Gravity | None = Field(
        default=None,
        description="Weight of all parts.  Without this table a single body has no weight, and several sections have "
        "theirs, which presses them on their pads",
    )
    frame: Frame | None = Field(
        default=None, description="Luffing and slewing of the whole boom, and motion of its base"
    )
    start: Literal["rest", "equilibrium"] = Field(
        default="rest",
        description="Initial state: undeformed and at rest, or in equilibrium under the loads at t = 0.  A single body "
        "begins at rest by default, several sections in equilibrium: loose in their pads they would begin with a fall",
    )
    damping: asked.Damping = Field(default=asked.Damping(), description="Damping of the structure")
    time: asked.TimeChoice = Field(description="Simulated time and its steps")
    recovery: asked.Recovery | None = Field(
        default=None, description="Fields of displacement and stress on the whole mesh"
    )
    fatigue: asked.Fatigue | None = Field(default=None, description="Fatigue damage at probes that measure stress")
    simulation: asked.Simulation = Field(default=asked.Simulation(), description="Programs that simulate the models")
    compare: asked.Compare = Field(default=asked.Compare(), description="What the reduced model is compared with")
    accuracy: asked.Accuracy | None = Field(
        default=None, description="Allowed error, in place of a number of coordinates and a step"
    )
    budget: asked.Budget | None = Field(
        default=None, description="Allowed cost of the model, in place of an allowed error"
    )
    published: asked.Published | None = Field(default=None, description="Figures from a publication")
    free_motions: Literal["refused", "allowed"] = Field(
        default="refused",
        description="Whether rigid-body motions are allowed that no support, pad or cylinder resists somewhere on the "
        "path; a load along such a motion moves the boom without limit.  Pads that only push count as resisting",
    )

    @model_validator(mode="before")
    @classmethod
    def _begun(cls, data: Any) -> Any:
        """Fill in the start, and a weight that fits it: what begins in equilibrium has its weight from the start."""
        if not isinstance(data, Mapping):
            return data
        sections = data.get("sections", ())
        several = isinstance(sections, list | tuple) and len(sections) > 1
        start = data.get("start", "equilibrium" if several else "rest")
        gravity = data.get("gravity", {} if several else None)
        if isinstance(gravity, dict) and start == "equilibrium":
            gravity = {"rise": 0.0} | gravity
        return {**data, "start": start, "gravity": gravity}
