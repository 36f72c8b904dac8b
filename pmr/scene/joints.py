"""Joints in which a section slides out of the next outer one: their pads and cylinder, and what drives them."""

from __future__ import annotations

from typing import Annotated, Literal

from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from pmr.scene.built import Face, clearance_on
from pmr.scene.section import (
    AxialStiffness,
    Count,
    Distance,
    Friction,
    Length,
    NameOrNone,
    Place,
    Quantity,
    Section,
    Size,
    Stiffness,
    Switch,
)
from pmr.scene.signals import Signal, SignalBase
from pmr.scene.signals.base import Array, Floats

#: N/m: of a pad along the boom.
SHEAR_STIFFNESS = 1e8


class JointPads(Section):
    """Pads around one end of a joint, between the inner section and the next outer one.

    Without `faces` they are points on the axes of planar beams; ones that only push then stand above and below.
    """

    name: NameOrNone = Field(default="", description="Tells several rings at one end apart")
    at: Distance = Field(description="Of their centre from the tail or the mouth that they sit at")
    faces: dict[Face, tuple[Place, ...]] | None = Field(
        default=None, description="Places across each face; none: points on planar beams"
    )
    length: Size = Field(default=0.3, description="Along the axis")
    width: Size = Field(default=0.08, description="Across")
    stiffness: Stiffness | Literal["rigid"] = Field(default=3e8, description="Of each pad")
    unilateral: Switch = Field(default=True, description="Whether they only push")
    clearance: Distance | dict[Face, Distance] = Field(
        default=0.0, description="Between pads that only push and the section at rest, of all faces or by face"
    )
    friction: Friction = Field(
        default=0.0,
        description="Coulomb's coefficient along the boom: part of cylinder forces, moment on both sections",
    )
    shear_stiffness: Stiffness = Field(
        default=SHEAR_STIFFNESS, description="Of each pad along the boom, by which friction sticks until it slides"
    )

    @model_validator(mode="after")
    def _only_what_pushes_has_play(self) -> JointPads:
        if self.clearance and not self.unilateral:
            raise ValueError("a clearance goes with unilateral = true")
        strange = (
            [face for face in self.clearance if face not in (self.faces or ())]
            if isinstance(self.clearance, dict)
            else []
        )
        if strange:
            raise ValueError(f"a clearance of faces that have pads is allowed: {strange[0]} has none")
        return self

    def clearance_on(self, face: str) -> float:
        """Of the pads on a face, m."""
        return clearance_on(self.clearance, face)


class Cylinder(Section):
    """What drives a section along the boom: a hydraulic cylinder or a rope from its tail to that of the next one."""

    stiffness: Stiffness | Literal["rigid"] = Field(default="rigid", description="Along the axis")


class Rope(Section):
    """A rope or chain that moves a section that follows another one: it gives way by EA/l, in all of its strands.

    From the head of the section before the one that this section slides in, over a sheave at the head of that one, to
    the tail of this section.
    """

    EA: AxialStiffness = Field(
        description="Stiffness of one strand: Young's modulus of the rope times its metallic area"
    )
    strands: Count = Field(default=1, description="Ropes or chains side by side")
    length: Length | None = Field(
        default=None, description="Of a strand under tension, by default from the heads and the tail"
    )


class Joint(Section):
    """How a section slides in the next outer one: by a signal of its extension or overlap, or as another one does."""

    extension: Signal | None = Field(
        default=None, description="Of the section's tail ahead of the next outer one's, over time, in m"
    )
    overlap: Signal | None = Field(default=None, description="Length within the next outer one over time, in m")
    follows: str | None = Field(default=None, description="A section on whose extension this one's depends")
    ratio: Annotated[float, Field(strict=True), Quantity("1", -1e3, 1e3)] = Field(
        default=1.0, description="Of this extension to that of the section it follows"
    )
    offset: Place = Field(default=0.0, description="Of this extension where that of the section it follows is zero")
    tail: tuple[JointPads, ...] = Field(min_length=1, description="Pads that travel with this section's tail")
    mouth: tuple[JointPads, ...] = Field(min_length=1, description="Pads at the mouth of the next outer section")
    cylinder: Cylinder = Field(default=Cylinder(), description="What drives it along the boom")
    rope: Rope | None = Field(default=None, description="The rope or chain of a section that follows: its stiffness")
    rigid_overlap: Switch = Field(
        default=False, description="Whether neither section bends from the first pads at the tail to those at the mouth"
    )

    @model_validator(mode="after")
    def _driven_once(self) -> Joint:
        if sum(given is not None for given in (self.extension, self.overlap, self.follows)) != 1:
            raise ValueError("give extension, overlap or follows, one of them")
        if self.rope is not None and self.follows is None:
            raise ValueError("a rope goes with follows: a cylinder moves a section that has an extension of its own")
        if self.rope is not None and self.cylinder.stiffness != "rigid":
            raise ValueError(
                "give rope or cylinder.stiffness, one of them: what moves a section that follows is its rope"
            )
        return self

    @property
    def rings(self) -> tuple[JointPads, ...]:
        """All pads of the joint."""
        return (*self.tail, *self.mouth)

    def first_at(self, rings: tuple[JointPads, ...]) -> float:
        """Distance in m of the first of some rings from the end that they sit at."""
        return min(ring.at for ring in rings)


class Linear(SignalBase):
    """``offset + ratio * signal``."""

    signal: SignalBase
    ratio: float
    offset: float

    def value(self, t: ArrayLike) -> Array:
        return self.offset + self.ratio * self.signal.value(t)

    def rate(self, t: ArrayLike) -> Array:
        return self.ratio * self.signal.rate(t)

    def second_rate(self, t: ArrayLike) -> Array:
        return self.ratio * self.signal.second_rate(t)

    @property
    def breaks(self) -> Floats:
        return self.signal.breaks

    def bounds(self, start: float, end: float) -> tuple[float, float]:
        ends = [self.offset + self.ratio * at for at in self.signal.bounds(start, end)]
        return min(ends), max(ends)

    def highest_frequency(self, start: float, end: float) -> float:
        return self.signal.highest_frequency(start, end)
