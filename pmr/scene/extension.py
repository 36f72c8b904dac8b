"""A free extension: a section's place along the boom that is computed with the boom's motion, driven by a cylinder."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, SkipValidation, model_validator

from pmr.scene.cylinder import DrivenCylinder
from pmr.scene.keys import Distance, Quantity, Speed, Stiffness, Usual, key_error
from pmr.scene.signals import Constant, SignalBase
from pmr.scene.signals.base import Array, Interval, Strand

Force = Annotated[float, Quantity("N", 0.0, 1e15), Usual(0.0, 1e7)]
Rate = Annotated[float, Quantity("m/s", -1e6, 1e6), Usual(0.0, 10.0)]


class FirstExtension(SignalBase):
    """Extension where a free one begins; it can reach `low` to `high`, and begins with the rate `speed`."""

    start: float
    speed: float
    low: float
    high: float
    drives: SkipValidation[Any]  # by name, the signal that drives the cylinder, if any

    def value(self, t: ArrayLike) -> Array:
        return np.full_like(np.asarray(t, float), self.start)

    def rate(self, t: ArrayLike) -> Array:
        return np.full_like(np.asarray(t, float), self.speed)

    def second_rate(self, t: ArrayLike) -> Array:
        return np.zeros_like(np.asarray(t, float))

    @property
    def strands(self) -> tuple[Strand, ...]:
        return Constant(amount=self.start).strands

    def bounds(self, start: float, end: float) -> Interval:
        """Smallest and largest extension that the boom is made for, whatever `start` and `end`."""
        return Interval(self.low, self.high)


class FreeExtension(DrivenCylinder):
    r"""Extension that is computed with the boom's motion, with what drives the section along the boom.

    The cylinder's length is the extension s.  It is driven by a force, by a length over a spring, or by oil; if no
    drive is given, the section slides by itself.  Damping, dry friction and stops at both ends of the stroke act beside
    the drive.
    """

    kind: Literal["free"] = Field(default="free", description="That the extension is computed")
    stroke: tuple[Distance, Distance] = Field(
        description="Smallest and greatest extension, where stops act; the boom is reduced for this range"
    )
    start: Distance = Field(description="Extension at the start")
    rate: Rate = Field(default=0.0, description="How fast the section slides out at the start")
    stop_stiffness: Stiffness = Field(default=1e8, description="Stiffness of the stops at both ends of the stroke")
    stop_travel: Annotated[Distance, Usual(0.0, 0.5)] = Field(
        default=0.005, description="How far the stops may give way; the boom is reduced for as much beyond the stroke"
    )
    dry_friction: Force = Field(default=0.0, description="Dry friction of the cylinder while it slides")
    dry_friction_at_rest: Force = Field(
        default=0.0, description="Dry friction at rest, from which it falls to that of sliding; 0: no other"
    )
    stribeck_speed: Annotated[Speed, Usual(1e-5, 1.0)] = Field(
        default=0.01, description="Speed by which dry friction falls from that at rest to that of sliding"
    )
    shear_stiffness: Stiffness = Field(default=1e8, description="Stiffness along the boom while the cylinder sticks")

    @model_validator(mode="after")
    def _check_stroke(self) -> Self:
        """Refuse a stroke without room for its stops, a start beyond its ends, and too small a friction at rest."""
        low, high = self.stroke
        if low >= high:
            raise key_error("stroke", list(self.stroke), "a smallest extension below the greatest one is allowed")
        if low < self.stop_travel:
            allowed = f"a smallest extension of stop_travel, {self.stop_travel:g} m, or more is allowed"
            raise key_error("stroke", list(self.stroke), allowed)
        if not low <= self.start <= high:
            raise key_error("start", self.start, f"an extension within the stroke, {low:g} to {high:g} m, is allowed")
        if self.dry_friction_at_rest and not 0.0 < self.dry_friction <= self.dry_friction_at_rest:
            allowed = "as much as dry_friction, which is above 0, or more is allowed"
            raise key_error("dry_friction_at_rest", self.dry_friction_at_rest, allowed)
        return self

    @property
    def reach(self) -> tuple[float, float]:
        """Smallest and greatest extension in m that the boom is made for: the stroke, and as far as stops give way."""
        return self.stroke[0] - self.stop_travel, self.stroke[1] + self.stop_travel

    @property
    def first(self) -> FirstExtension:
        """Signal of the extension where it begins."""
        low, high = self.reach
        return FirstExtension(start=self.start, speed=self.rate, low=low, high=high, drives=self.drive_signals)
