"""A boom of several sections that all bend: what each is, and the joints in which one slides out of the next."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from pmr.errors.text import LONGEST_NAME
from pmr.scene import asked
from pmr.scene.built import Face, Gravity
from pmr.scene.scene import OneBody, Whole
from pmr.scene.section import (
    Distance,
    Frequency,
    Friction,
    Length,
    NameOrNone,
    Place,
    Quantity,
    Section,
    Size,
    Speed,
    Stiffness,
    Switch,
)
from pmr.scene.signals import Signal, SignalBase
from pmr.scene.signals.base import Array, Floats
from pmr.scene.tomlfiles import laid_over

FileName = Annotated[str, Field(pattern=r"^\w[\w -]*$", max_length=LONGEST_NAME)]


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
    clearance: Distance = Field(default=0.0, description="Between pads that only push and the section at rest")
    friction: Friction = Field(default=0.0, description="Coulomb's coefficient along the boom, part of cylinder forces")

    @model_validator(mode="after")
    def _only_what_pushes_has_play(self) -> JointPads:
        if self.clearance and not self.unilateral:
            raise ValueError("a clearance goes with unilateral = true")
        return self


class Cylinder(Section):
    """What drives a section along the boom: a hydraulic cylinder or a rope from its tail to that of the next one."""

    stiffness: Stiffness | Literal["rigid"] = Field(default="rigid", description="Along the axis")


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
    friction_speed: Speed = Field(default=1e-3, description="Sliding speed at which friction is at 76 %")
    rigid_overlap: Switch = Field(
        default=False, description="Whether neither section bends from the first pads at the tail to those at the mouth"
    )

    @model_validator(mode="after")
    def _driven_once(self) -> Joint:
        if sum(given is not None for given in (self.extension, self.overlap, self.follows)) != 1:
            raise ValueError("give extension, overlap or follows, one of them")
        return self

    @property
    def rings(self) -> tuple[JointPads, ...]:
        """All pads of the joint."""
        return (*self.tail, *self.mouth)

    def first_at(self, rings: tuple[JointPads, ...]) -> float:
        """Distance in m of the first of some rings from the end that they sit at."""
        return min(ring.at for ring in rings)


class PublishedFrequency(Section):
    """The first natural frequency of a boom that reaches so far."""

    reach: Length = Field(description="Of the tip from the base's tail")
    first: Frequency = Field(description="Lowest natural frequency")


class PublishedBoom(Section):
    """Figures from a publication, shown beside ours."""

    source: str = Field(description="Where they stand")
    frequencies: tuple[PublishedFrequency, ...] = Field(default=(), description="First ones, at rest")
    remarks: tuple[str, ...] = Field(default=(), description="Where and why our figures differ, for the report")


class BoomSection(OneBody):
    """A section of a boom; the first one is the base, all others have a joint."""

    name: FileName = Field(description="What it is called")
    joint: Joint | None = Field(default=None, description="How it slides in the section before it")


class Boom(Whole):
    """Sections from the base out, each of which slides in the one before it.

    What several have in common stands in the table `section`, which every one of `sections` extends.
    """

    section: dict[str, Any] = Field(default={}, description="What every section takes over unless it says otherwise")
    sections: Annotated[tuple[BoomSection, ...], Field(min_length=2)] = Field(description="From the base out")
    gravity: Gravity = Field(default=Gravity(rise=0.0), description="The weight of everything")
    accuracy: asked.Accuracy | None = Field(
        default=None, description="An allowed error, in place of coordinates and step"
    )
    budget: asked.Budget | None = Field(default=None, description="What a model may cost, in place of an allowed error")
    published: PublishedBoom | None = Field(default=None, description="Figures from a publication")

    @model_validator(mode="before")
    @classmethod
    def _common(cls, data: Any) -> Any:
        if not (isinstance(data, dict) and isinstance(data.get("sections"), list)):
            return data
        common = data.get("section", {})
        if not isinstance(common, dict):
            return data
        if isinstance(data.get("gravity"), dict):  # motions begin in equilibrium: nothing has to come up
            data = {**data, "gravity": {"rise": 0.0} | data["gravity"]}
        base = {key: value for key, value in common.items() if key != "joint"}  # which slides in nothing
        return {
            **data,
            "sections": [
                _extended(common if number else base, part) if isinstance(part, dict) else part
                for number, part in enumerate(data["sections"])
            ],
        }

    def _bodies(self, content: dict[str, Any]) -> Iterable[tuple[OneBody, dict[str, Any]]]:
        return zip(self.sections, content["sections"], strict=True)

    @property
    def bodies(self) -> Mapping[str, OneBody]:
        """The sections by their names, from the base out."""
        return {part.name: part for part in self.sections}

    @property
    def ordered(self) -> asked.Accuracy | asked.Budget | None:
        """What is asked for in place of coordinates, if anything."""
        return self.accuracy or self.budget

    @property
    def names(self) -> tuple[str, ...]:
        """Of the sections."""
        return tuple(part.name for part in self.sections)

    def extension(self, number: int) -> SignalBase:
        """How far the tail of a section, 1 or more, is ahead of that of the one before it, m over time."""
        joint = self.joint(number)
        if joint.extension is not None:
            return joint.extension
        if joint.overlap is not None:
            return Linear(signal=joint.overlap, ratio=-1.0, offset=self.length(number - 1))
        followed = self.extension(self.names.index(str(joint.follows)))
        return Linear(signal=followed, ratio=joint.ratio, offset=joint.offset)

    def joint(self, number: int) -> Joint:
        """In which a section, 1 or more, slides."""
        joint = self.sections[number].joint
        assert joint is not None  # as the checks say
        return joint

    def length(self, number: int) -> float:
        """Of a section, m."""
        part = self.sections[number]
        observed = part.observe.stations or (0.0,)
        return part.body.length or observed[-1]

    @property
    def paths(self) -> dict[str, SignalBase]:
        """Extension of every section but the base, by its name."""
        return {self.names[k]: self.extension(k) for k in range(1, len(self.sections))}

    def reach(self, t: ArrayLike) -> Array:
        """Where the tip is along the boom, from the tail of the base, m at the times t."""
        tails = np.sum([path.value(t) for path in self.paths.values()], axis=0)
        return np.asarray(tails + self.length(len(self.sections) - 1))


class Linear(SignalBase):
    """``offset + ratio * signal``."""

    signal: SignalBase
    ratio: float
    offset: float

    def value(self, t: ArrayLike) -> Array:
        return self.offset + self.ratio * self.signal.value(t)

    def rate(self, t: ArrayLike) -> Array:
        return self.ratio * self.signal.rate(t)

    @property
    def breaks(self) -> Floats:
        return self.signal.breaks

    def bounds(self, start: float, end: float) -> tuple[float, float]:
        ends = [self.offset + self.ratio * at for at in self.signal.bounds(start, end)]
        return min(ends), max(ends)

    def highest_frequency(self, start: float, end: float) -> float:
        return self.signal.highest_frequency(start, end)


def _extended(common: Mapping[str, Any], part: Mapping[str, Any]) -> dict[str, Any]:
    """A section laid over what all have in common; of the ways to drive a joint it takes over none but its own."""
    joint = part.get("joint")
    ways = {"extension", "overlap", "follows"}
    if isinstance(joint, Mapping) and ways & set(joint) and isinstance(common.get("joint"), Mapping):
        common = {**common, "joint": {key: value for key, value in common["joint"].items() if key not in ways}}
    return laid_over(common, part)
