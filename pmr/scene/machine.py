"""The machine below the pivot as a rigid body: what of its motion is found, and what acts on it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Self

from pydantic import Field, model_validator

from pmr.scene.refusals import of_key
from pmr.scene.section import Direction, Mass, Point, Quantity, Section, Usual
from pmr.scene.signals import Signal, SignalBase
from pmr.scene.structures import ALLOWED_INERTIA, PrincipalMoments, is_inertia

#: Directions in which a machine moves, as `[frame.base]` has them: of the pivot, then roll, pitch and yaw.
DIRECTIONS: tuple[Direction, ...] = ("x", "y", "z", "rx", "ry", "rz")
_PerDirection = Field(ge=0.0, strict=True)
Spring = Annotated[float, _PerDirection, Quantity("N/m, of angles N m/rad", 0.0, 1e15)]
Damper = Annotated[float, _PerDirection, Quantity("N s/m, of angles N m s/rad", 0.0, 1e15)]
Value = Annotated[float, Field(strict=True), Quantity("m, of angles frame.unit", -1e6, 1e6)]
Rate = Annotated[float, Field(strict=True), Quantity("m/s, of angles frame.unit/s", -1e6, 1e6)]


class _ByDirection(Section):
    @property
    def given(self) -> dict[str, float]:
        """Values that are not zero, by their directions."""
        return {key: value for key in DIRECTIONS if (value := getattr(self, key))}


class Springs(_ByDirection):
    """Between the machine and what it stands on, whose motion `[frame.base]` has; angles are roll, pitch and yaw."""

    x: Annotated[Spring, Usual(2e3, 1e14, unit="N/m")] = Field(default=0.0, description="Along X of the ground")
    y: Annotated[Spring, Usual(2e3, 1e14, unit="N/m")] = Field(default=0.0, description="Along Y of the ground")
    z: Annotated[Spring, Usual(2e3, 1e14, unit="N/m")] = Field(default=0.0, description="Upwards")
    rx: Annotated[Spring, Usual(2e3, 1e15, unit="N m")] = Field(default=0.0, description="Of roll")
    ry: Annotated[Spring, Usual(2e3, 1e15, unit="N m")] = Field(default=0.0, description="Of pitch")
    rz: Annotated[Spring, Usual(2e3, 1e15, unit="N m")] = Field(default=0.0, description="Of yaw")


class Dampers(_ByDirection):
    """Beside the springs."""

    x: Damper = Field(default=0.0, description="Along X of the ground")
    y: Damper = Field(default=0.0, description="Along Y of the ground")
    z: Damper = Field(default=0.0, description="Upwards")
    rx: Damper = Field(default=0.0, description="Of roll")
    ry: Damper = Field(default=0.0, description="Of pitch")
    rz: Damper = Field(default=0.0, description="Of yaw")


class Places(_ByDirection):
    """Places at which free directions begin."""

    x: Value = Field(default=0.0, description="Of the pivot along X of the ground")
    y: Value = Field(default=0.0, description="Of the pivot along Y of the ground")
    z: Value = Field(default=0.0, description="Of the pivot upwards")
    rx: Value = Field(default=0.0, description="Roll")
    ry: Value = Field(default=0.0, description="Pitch")
    rz: Value = Field(default=0.0, description="Yaw")


class Rates(_ByDirection):
    """How fast free directions move at the start."""

    x: Rate = Field(default=0.0, description="Of the pivot along X of the ground")
    y: Rate = Field(default=0.0, description="Of the pivot along Y of the ground")
    z: Rate = Field(default=0.0, description="Of the pivot upwards")
    rx: Rate = Field(default=0.0, description="Of roll")
    ry: Rate = Field(default=0.0, description="Of pitch")
    rz: Rate = Field(default=0.0, description="Of yaw")


class OnMachine(Section):
    """A force at the pivot, or a moment, along axes of the ground."""

    x: Signal | None = Field(default=None, description="Along X of the ground, in N or N m")
    y: Signal | None = Field(default=None, description="Along Y of the ground, in N or N m")
    z: Signal | None = Field(default=None, description="Upwards, in N or N m")

    @property
    def given(self) -> dict[str, SignalBase]:
        """Signals by their axes."""
        return {axis: one for axis in "xyz" if (one := getattr(self, axis)) is not None}


class Machine(Section):
    """A rigid body that carries the pivot: a chassis, a ship, a cart."""

    mass: Annotated[Mass, Usual(0.2, 1e6, "boom")] = Field(description="Without the boom")
    center: Annotated[Point, Usual(0.0, 3.0, "reach")] = Field(
        default=(0.0, 0.0, 0.0), description="Of its mass, from the pivot along axes of the machine"
    )
    inertia: PrincipalMoments = Field(
        default=(0.0, 0.0, 0.0), description="About its centre of mass, about axes of the machine"
    )
    free: tuple[Direction, ...] = Field(
        default=(), description="Directions that are not held: their motion is found, far as it may go"
    )
    stiffness: Springs = Field(default=Springs(), description="Of springs in free directions")
    damping: Dampers = Field(default=Dampers(), description="Of dampers in free directions")
    force: OnMachine = Field(default=OnMachine(), description="Forces at the pivot, along axes of the ground")
    moment: OnMachine = Field(default=OnMachine(), description="Moments, about axes of the ground")
    start: Places = Field(default=Places(), description="Where free directions begin")
    rate: Rates = Field(default=Rates(), description="How fast free directions move at the start")

    @model_validator(mode="after")
    def _of_free_directions(self) -> Self:
        if not is_inertia(self.inertia):
            raise of_key("inertia", list(self.inertia), ALLOWED_INERTIA)
        if len(set(self.free)) < len(self.free):
            raise of_key("free", list(self.free), "each direction once is allowed")
        for key in ("stiffness", "damping", "start", "rate"):
            for direction, value in getattr(self, key).given.items():
                if direction not in self.free:
                    raise of_key(f"{key}.{direction}", value, f"one of free is allowed: {list(self.free)}")
        return self

    def hint_scales(self, scales: Mapping[str, float]) -> dict[str, float]:
        return {"inertia": self.mass * scales["reach"] ** 2}

    def is_sprung(self, direction: str) -> bool:
        """Whether a spring or a damper holds it."""
        return bool(getattr(self.stiffness, direction) or getattr(self.damping, direction))
