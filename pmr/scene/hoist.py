r"""A hoist: a rope from its winch along the boom to head sheaves, and from there by falls to a hook with its payload.

With the head h, the hook p, the winch w and n falls the rope has the length

.. math:: l = n\, |h - p| + |h - w|

between its winch and its end.  Its force T is that of an elastic bar which has the length :math:`l_0` without force,
and only pulls, :math:`T = \max(0, E A\, (l - l_0) / l_0)`.
"""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from pmr.files.arrays import Array
from pmr.scene.frame import PivotLoad
from pmr.scene.keys import (
    AxialStiffness,
    Count,
    Length,
    Mass,
    Name,
    NameOrNone,
    Place,
    Point,
    Quantity,
    SceneTable,
    Usual,
    key_error,
)
from pmr.scene.signals import Constant, Signal, SignalBase

#: Prefix of the names of the inputs by which the rope pulls a section, and of the drivers of a hoist.
HOIST = "hoist "
#: Names of the loads of a hoist that the user drives: its rope, and the wind on its payload.
ROPE, WIND = "hoist rope", tuple(f"hoist wind {axis}" for axis in "xyz")
#: Names of a hoist's outputs, in the order of `show_hoist` in pmr/kernel/src/hoist.c.
HEIGHT, ROPE_FORCE = "hook height", "force of the hoist rope"
WINCH_PULLS = tuple(f"pull of the hoist rope on its winch {axis}" for axis in "XYZ")
PLACES = tuple(f"hook in space {axis}" for axis in "XYZ")
SWINGS = ("swing of the hook along the boom", "swing of the hook across the boom")
#: Unit of each output, and its kind in results.
OUTPUTS = {HEIGHT: "m", **dict.fromkeys(PLACES, "m"), **dict.fromkeys(SWINGS, "rad")}
OUTPUTS |= dict.fromkeys((ROPE_FORCE, *WINCH_PULLS), "N")
KINDS = {HEIGHT: "hook_height", **dict.fromkeys(PLACES, "hook_place"), **dict.fromkeys(SWINGS, "swing")}
KINDS |= {ROPE_FORCE: "hoist_force", **dict.fromkeys(WINCH_PULLS, "winch_pull")}
#: Outputs whose extremes are in summary.json, by their keys there.
KEYS = {"height": HEIGHT, **dict(zip(("swing_along", "swing_across"), SWINGS, strict=True)), "force": ROPE_FORCE}
_DAMPING = Annotated[float, Quantity("N s", 0.0, 1e15)]
_ANGLE = Annotated[float, Field(ge=-3.1, le=3.1), Quantity("rad", -3.1, 3.1), Usual(0.0, 1.6, unit="rad")]
_SPEED = Annotated[float, Quantity("m/s", -1e3, 1e3), Usual(0.0, 30.0, unit="m/s")]


class Winch(SceneTable):
    """Winch on the machine, which slews with the boom and does not luff, or on a section."""

    section: NameOrNone = Field(default="", description="Section that carries the winch; by default the machine does")
    at: Annotated[Point, Usual(0.0, 2.0, "reach")] = Field(
        default=(0.0, 0.0, 0.0),
        description="Place of the winch or of its last sheave: on the machine from the pivot (without a frame from the "
        "base's tail), z upwards; on a section from its tail along its axes",
    )


class Rope(SceneTable):
    """Keys of a hoist about its rope."""

    falls: Count = Field(default=1, description="Number of falls between head and hook")
    EA: Annotated[AxialStiffness, Usual(2e5, 5e9)] = Field(
        description="Stiffness of the rope: its Young's modulus times its metallic area"
    )
    damping: Annotated[_DAMPING, Usual(1.0, 1e9, unit="N s")] = Field(
        default=0.0, description="Force of the rope's damper over the rate of its strain"
    )
    length: Annotated[Signal, Usual(0.0, 100.0, "reach", "m")] | None = Field(
        default=None, description="Length over time of the rope without force, from its winch to its end"
    )
    hanging: Annotated[Length, Usual(0.0, 20.0, "reach")] | None = Field(
        default=None,
        description="Distance at t = 0 from the head to the hook of a rope without force, in place of `length`",
    )
    speed: Annotated[Signal, Usual(1e-4, 20.0, unit="m/s")] | None = Field(
        default=None, description="Speed over time at which the winch takes in the rope, with `hanging`"
    )


class Payload(SceneTable):
    """Keys of a hoist about what hangs on its rope, and how it begins to move."""

    payload: Annotated[Mass, Usual(1e-3, 1e3, "boom")] = Field(description="Mass that hangs on the hook")
    hook: Annotated[Mass, Usual(0.0, 1e2, "boom")] = Field(default=0.0, description="Mass of the hook with its sheaves")
    wind: PivotLoad = Field(
        default=PivotLoad.model_construct(), description="Forces on the payload along axes of the ground"
    )
    swing: tuple[_ANGLE, _ANGLE] = Field(
        default=(0.0, 0.0), description="Angles of the rope at t = 0 along and across the boom; by default it hangs"
    )
    velocity: tuple[_SPEED, _SPEED, _SPEED] = Field(
        default=(0.0, 0.0, 0.0), description="Velocity of the hook at t = 0 along axes of the ground"
    )

    @property
    def mass(self) -> float:
        """Mass of hook and payload in kg."""
        return self.payload + self.hook

    @property
    def wind_signals(self) -> dict[str, SignalBase]:
        """Signals in N of the wind on the payload along x, y and z of the ground, by their names `WIND`."""
        return dict(zip(WIND, (getattr(self.wind, axis) or Constant(amount=0.0) for axis in "xyz"), strict=True))


class Hoist(Payload, Rope):
    """A rope over head sheaves with a hook and a payload that swings; the rope only pulls."""

    section: NameOrNone = Field(default="", description="Section with the head sheaves; by default the last one")
    on: Name | Place = Field(default="tip", description="Place of the head sheaves: the tip, or a place along x in m")
    offset: Annotated[tuple[Place, Place], Usual(0.0, 0.2, "reach")] = Field(
        default=(0.0, 0.0), description="Place of the head sheaves off the section's axis, along y and z"
    )
    winch: Winch = Field(default=Winch.model_construct(), description="Where the rope is wound up")
    pivot_height: Annotated[Place, Usual(0.0, 2.0, "reach")] = Field(
        default=0.0,
        description="Height above the ground of the pivot, or without a frame of the base's tail; at 0.0 it is "
        "frame.ground.height, if the scene has that key. The hook's height is measured from this ground",
    )

    @model_validator(mode="after")
    def _check_rope(self) -> Self:
        """Refuse a hoist without mass, a rope without a length or with two, and a wrong place of the head.

        The length is set by `length` or by `hanging`; a speed of the winch needs `hanging`, the length at t = 0.  The
        head is at the tip or at a place along x.
        """
        if not self.mass > 0.0:
            raise key_error("payload", self.payload, "a mass above 0 of payload and hook together is allowed")
        if (self.length is None) == (self.hanging is None):
            raise ValueError("give length or hanging, one of them")
        if self.speed is not None and self.hanging is None:
            raise ValueError("a speed is allowed with hanging, the length at t = 0")
        if self.on != "tip" and isinstance(self.on, str):
            raise key_error("on", self.on, "'tip' or a place along x in m is allowed")
        return self

    @property
    def lateral_key(self) -> str:
        """First key by which the rope or its payload leaves the vertical plane of the boom; empty if no key does."""
        lateral = {
            "offset": self.offset[0],
            "swing": self.swing[1],
            "velocity": self.velocity[1],
            "winch.at": self.winch.at[1],
            "wind.y": self.wind.y is not None,
        }
        return next((key for key, value in lateral.items() if value), "")

    @property
    def rope_signal(self) -> SignalBase:
        """Signal that drives the rope: its length without force in m, or the speed of its winch in m/s."""
        return self.length or self.speed or Constant(amount=0.0)

    @property
    def is_wound(self) -> bool:
        """Whether the speed of the winch drives the rope, and not its length."""
        return self.length is None

    def free_length(self, t: Array, along: ArrayLike) -> Array:
        """Return the length without force in m of the rope at ascending times t (T,) in s, the first of which is 0.

        `along` is the distance in m from the winch to the head at t = 0.  The speed of a winch is taken as linear
        between the times.
        """
        if self.length is not None:
            return np.asarray(self.length.value(t))
        speed = self.rope_signal.value(t)
        taken = np.concatenate([[0.0], np.cumsum(np.diff(t) * (speed[1:] + speed[:-1]) / 2.0)])
        return np.asarray(self.falls * (self.hanging or 0.0) + np.asarray(along) - taken)
