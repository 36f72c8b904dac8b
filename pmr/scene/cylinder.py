"""Cylinders that drive a luffing angle or an extension by a force, a length or oil.

A luffing cylinder has hinges; a free extension is a section's place along the boom that is computed with its motion.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, SkipValidation, model_validator

from pmr.scene.keys import (
    AllowedForce,
    Area,
    Distance,
    Length,
    Place,
    Pressure,
    Quantity,
    SceneTable,
    Speed,
    Stiffness,
    Usual,
    key_error,
)
from pmr.scene.signals import Constant, Signal, SignalBase
from pmr.scene.signals.base import Array, Interval, Strand

Volume = Annotated[float, Quantity("m^3", 1e-12, 1e6), Usual(1e-7, 10.0)]
HoseVolume = Annotated[float, Quantity("m^3", 0.0, 1e6), Usual(0.0, 1.0)]
Gauge = Annotated[float, Quantity("Pa", 0.0, 1e12), Usual(1e4, 1e8)]
Gain = Annotated[float, Quantity("m^3/s/Pa^0.5", 1e-15, 1e6), Usual(1e-10, 1e-5)]
Leakage = Annotated[float, Quantity("m^3/s/Pa", 0.0, 1e6), Usual(0.0, 1e-9)]
ViscousFriction = Annotated[float, Quantity("N s/m", 0.0, 1e15), Usual(1.0, 1e9)]
StopDamping = Annotated[float, Quantity("s/m", 0.0, 1e6), Usual(0.0, 100.0)]
Part = Annotated[float, Field(ge=0.0, lt=1.0), Quantity("1", 0.0, 1.0)]
PilotRatio = Annotated[float, Quantity("1", 0.0, 100.0)]
Force = Annotated[float, Quantity("N", 0.0, 1e15), Usual(0.0, 1e7)]
Rate = Annotated[float, Quantity("m/s", -1e6, 1e6), Usual(0.0, 10.0)]
#: Young's modulus of the steel of rods, Pa.
STEEL = 210e9
#: Share of a stroke up to which a length beyond it is round-off.
ROUND_OFF = 1e-9
#: Stiffness along the boom of a pad or cylinder that sticks, N/m.
SHEAR_STIFFNESS = 1e8
#: Speed in m/s over which friction falls from its value at rest to its value in sliding.
STRIBECK_SPEED = 0.01
#: Largest opening of a valve, in either direction.
OPEN = 1.0


def unused_friction_keys(sliding: float, at_rest: float, key_at_rest: str) -> dict[str, str]:
    """Return the keys of a friction law that have no effect, with the reason.

    `sliding` and `at_rest` are the friction in sliding and at rest; `key_at_rest` is the key of the friction at rest.
    """
    falls = f"it has an effect with {key_at_rest} alone, from which the friction falls"
    unused = {} if at_rest else {"stribeck_speed": falls}
    return unused if sliding else unused | {"shear_stiffness": "without friction nothing sticks"}


class Valve(SceneTable):
    r"""Proportional valve of four edges with a closed centre.

    Beyond the dead band d it is open by :math:`e = \operatorname{sign}(u) (|u| - d) / (1 - d)` of its opening u.  With
    e > 0 the supply feeds the bore and the rod side drains to the tank, with e < 0 the other way round.  A pressure
    difference p drives the flow :math:`|e|\, g\, p / (p^2 + p_l^2)^{1/4}` through an edge, which is
    :math:`|e|\, g \sqrt{|p|}` with the sign of p beyond the laminar range :math:`p_l`.
    """

    opening: Signal = Field(description="Opening over time, -1 to 1; above 0 the cylinder extends")
    gain: tuple[Gain, Gain] = Field(
        description="Flow through the fully open edges of bore and rod side, over the square root of the pressure drop"
    )
    dead_band: Part = Field(default=0.0, description="Opening up to which the valve stays shut")
    laminar: Annotated[Pressure, Usual(10.0, 1e6)] = Field(
        default=1e4, description="Pressure drop below which the flow is laminar"
    )


class Counterbalance(SceneTable):
    r"""Counterbalance valve on the bore: oil flows in freely, and out only as far as the valve is open.

    It opens by :math:`(p_1 + r p_2 - p_s) / \Delta p`, 0 to 1.  In it, :math:`p_1` is the pressure of the bore and
    :math:`p_2` that of the rod side, which pilots the valve; r is the ratio, :math:`p_s` the setting and :math:`\Delta
    p` the range.  Its flow has the law of the proportional valve, with which it is in series.
    """

    setting: Annotated[Pressure, Usual(1e5, 2e8)] = Field(
        description="Pressure of the bore at which it begins to open without a pilot pressure"
    )
    ratio: PilotRatio = Field(description="Pilot ratio: by how much the pilot pressure counts more than the bore's")
    range: Annotated[Pressure, Usual(1e4, 2e8)] = Field(
        description="Rise of the pressure from where it begins to open to where it is open"
    )
    gain: Gain = Field(description="Flow through the open valve over the square root of the pressure drop")


class Oil(SceneTable):
    """Oil in the two chambers of the cylinder, and what feeds it; pairs are of the bore and of the rod side.

    All pressures are above that of the surroundings.
    """

    areas: tuple[Annotated[Area, Usual(1e-5, 1.0)], Annotated[Area, Usual(1e-5, 1.0)]] = Field(
        description="Areas of the piston: bore, and rod side, which is no larger"
    )
    dead_volumes: tuple[Volume, Volume] = Field(description="Volumes of the chambers at their end of the stroke")
    hose_volumes: tuple[HoseVolume, HoseVolume] = Field(
        default=(0.0, 0.0), description="Volumes of hoses between the chambers and the valve that shuts them"
    )
    bulk_modulus: Annotated[Pressure, Usual(1e8, 3e9)] = Field(default=1.4e9, description="Of the oil")
    leakage: Leakage = Field(default=0.0, description="Flow past the piston over the difference of the pressures")
    supply: Gauge = Field(default=0.0, description="Pressure of the supply")
    tank: Gauge = Field(default=0.0, description="Pressure of the tank")
    back_pressure: Gauge = Field(
        default=0.0, description="Pressure at the start in the chamber that the load does not press on"
    )
    valve: Valve | None = Field(default=None, description="Valve that feeds the chambers; without it they are shut")
    counterbalance: Counterbalance | None = Field(default=None, description="Counterbalance valve on the bore")

    @model_validator(mode="after")
    def _check_complete(self) -> Self:
        """Refuse a rod side larger than the bore, and a counterbalance valve without the valve in series with it."""
        if self.areas[1] > self.areas[0]:
            allowed = "[bore, rod side] is allowed, the rod side no larger than the bore: the rod takes its part of it"
            raise key_error("areas", list(self.areas), allowed)
        if self.counterbalance is not None and self.valve is None:
            raise key_error("counterbalance", None, "none is allowed without valve: no oil flows")
        return self


class DrivenCylinder(SceneTable):
    """Drive of a free luffing angle or a free extension, and the forces that act together with it."""

    force: Signal | None = Field(default=None, description="Force over time, in N, above 0 where it pushes")
    length: Signal | None = Field(
        default=None, description="Length over time, in m, whose change from the start drives over spring"
    )
    spring: Stiffness | None = Field(default=None, description="Stiffness between length and cylinder")
    oil: Oil | None = Field(default=None, description="Oil that drives the cylinder")
    damping: ViscousFriction = Field(default=0.0, description="Viscous friction along the cylinder")
    stop_stiffness: Stiffness = Field(default=1e9, description="Stiffness of the stops at both ends of the stroke")
    stop_damping: StopDamping = Field(
        default=0.0, description="Share by which a stop pushes more, per m/s with which it is pressed in"
    )

    @model_validator(mode="after")
    def _check_drive(self) -> Self:
        """Refuse several drives, and a length or a spring alone: a length drives over a spring."""
        drives = self.drives
        if len(drives) > 1:
            raise key_error(drives[1], None, f"one of force, length and oil is allowed: {drives[0]} is there")
        if (self.length is None) != (self.spring is None):
            raise key_error("spring", self.spring, "length and spring are allowed together")
        return self

    @property
    def drives(self) -> tuple[str, ...]:
        """Keys out of ``force``, ``length`` and ``oil`` that the scene sets, by which the cylinder is driven."""
        return tuple(key for key in ("force", "length", "oil") if getattr(self, key) is not None)

    @property
    def drive_signals(self) -> dict[str, SignalBase]:
        """Signal by which the cylinder is driven, under the name ``force``, ``length`` or ``opening`` (of the valve).

        Empty if nothing drives the cylinder, or if its oil has no valve.
        """
        valve = None if self.oil is None else self.oil.valve
        signals: dict[str, SignalBase | None] = {"force": self.force, "length": self.length}
        signals["opening"] = None if valve is None else valve.opening
        return {name: signal for name, signal in signals.items() if signal is not None}

    def worst_opening(self, end: float) -> float | None:
        """Return an opening of the valve that is outside of -1 to 1 at a time from 0 to `end` in s.

        The result is the smallest opening if that is below -1, else the largest one.  None is returned if all openings
        are allowed, or if there is no valve.
        """
        if self.oil is None or self.oil.valve is None:
            return None
        least, most = self.oil.valve.opening.bounds(0.0, end)
        return least if -least > OPEN else most if most > OPEN else None


class LengthAndArm(NamedTuple):
    """Length L of a cylinder and its arm dL / dphi about the pivot, (...) in m each."""

    length: NDArray[np.float64]
    arm: NDArray[np.float64]


class AllowedForces(NamedTuple):
    """Largest forces in N, (...) each, with which a cylinder may push and pull."""

    push: NDArray[np.float64]
    pull: NDArray[np.float64]


class LuffingCylinder(DrivenCylinder):
    r"""Hinges of the cylinder that raises the boom: x and z from the pivot, z upwards when the boom lies level.

    The cylinder goes from the foot :math:`r_0` on the machine to the lug :math:`r_1` on the boom.  With the rotation
    :math:`R(\varphi)` by the luffing angle :math:`\varphi` its length is :math:`L = |R(\varphi) r_1 - r_0|`.  By
    virtual work it carries the moment :math:`\mathfrak M` of the boom about the pivot with the force :math:`\mathfrak M
    / (dL / d\varphi)`.
    """

    foot: Annotated[tuple[Place, Place], Usual(0.0, 2.0, "reach")] = Field(
        description="Hinge on the machine; it slews with the boom and does not luff"
    )
    lug: Annotated[tuple[Place, Place], Usual(0.0, 2.0, "reach")] = Field(
        description="Hinge on the boom, in the axes of the boom"
    )
    stiffness: Stiffness | None = Field(
        default=None,
        description="Stiffness along the cylinder, which then holds the base at the lug in its true direction; "
        "without it supports of the base hold it",
    )
    stroke: tuple[Length, Length] | None = Field(
        default=None, description="Shortest and greatest length from hinge to hinge, where stops act"
    )
    allowed_push: AllowedForce | None = Field(
        default=None, description="Largest force with which it may push; the first page has the share that is used"
    )
    allowed_pull: AllowedForce | None = Field(
        default=None, description="Largest force with which it may pull; the first page has the share that is used"
    )
    rod: Annotated[Length, Usual(0.005, 1.0)] | None = Field(
        default=None,
        description="Diameter of the rod of steel, for the push at which it buckles by Euler, between both hinges",
    )

    def allowed_forces(self, length: ArrayLike) -> AllowedForces:
        r"""Return the largest push and pull in N at the lengths L = `length` (any shape) in m from hinge to hinge.

        The push is at most that of Euler, with Young's modulus E of steel and the diameter d of the rod,

        .. math:: F = \frac{\pi^2 E}{L^2} \frac{\pi d^4}{64}

        as if the cylinder were as slender as its rod all along.  Both results have the shape of `length`.  A force that
        nothing limits is infinite.
        """
        shape = np.shape(length)
        push = np.full(shape, np.inf if self.allowed_push is None else self.allowed_push)
        pull = np.full(shape, np.inf if self.allowed_pull is None else self.allowed_pull)
        if self.rod is not None:
            push = np.minimum(push, np.pi**3 * STEEL * self.rod**4 / (64.0 * np.square(length)))
        return AllowedForces(push, pull)

    @property
    def has_allowed_forces(self) -> bool:
        """Whether a key of the scene limits the cylinder's force."""
        return any(limit is not None for limit in (self.allowed_push, self.allowed_pull, self.rod))

    @model_validator(mode="after")
    def _check_stroke(self) -> Self:
        """Refuse a stroke whose ends are in the wrong order, and oil without a stroke."""
        if self.stroke is not None and self.stroke[0] >= self.stroke[1]:
            raise key_error("stroke", list(self.stroke), "a shortest length below the greatest one is allowed")
        if self.oil is not None and self.stroke is None:
            raise key_error("stroke", None, "the shortest and the greatest length are needed with oil")
        return self

    def square_angle(self, angle: float) -> float:
        """Return the luffing angle in rad at which the lines from the pivot to foot and lug are at right angles.

        Of the two such angles it is the one on the same side of the dead points as the luffing angle `angle` in rad.
        """
        between = np.arctan2(self.lug[1], self.lug[0]) + angle - np.arctan2(self.foot[1], self.foot[0])
        between = (between + np.pi) % (2.0 * np.pi) - np.pi
        return float(angle - between + np.copysign(np.pi / 2.0, between))

    def stroke_angles(self, angle: float) -> Interval:
        """Return the smallest and largest luffing angle in rad, on the side of `angle` in rad, within the stroke.

        An end that no angle reaches is the dead point at which foot, lug and pivot are in line.  There has to be a
        stroke.
        """
        assert self.stroke is not None  # as the docstring says
        foot, lug = (float(np.hypot(*hinge)) for hinge in (self.foot, self.lug))
        cosines = (foot**2 + lug**2 - np.square(self.stroke)) / (2.0 * foot * lug)
        between = np.arccos(np.clip(cosines, -1.0, 1.0)) * (1.0 + np.array([-ROUND_OFF, ROUND_OFF]))
        square = self.square_angle(angle)
        ahead = float(self.length_and_arm(square).arm) > 0.0  # the cylinder gets longer as the boom rises
        ends = square + (between - np.pi / 2.0) * (1.0 if ahead else -1.0)
        return Interval(float(ends.min()), float(ends.max()))

    def lug_position(self, angle: ArrayLike) -> NDArray[np.float64]:
        """Return the lug's positions (..., 2) in m at the luffing angles `angle` (...) in rad.

        The two components are x and z from the pivot, along the axes of the foot, which do not luff.
        """
        sine, cosine, (x, z) = np.sin(angle), np.cos(angle), self.lug
        return np.stack([x * cosine - z * sine, x * sine + z * cosine], axis=-1)

    def length_and_arm(self, angle: ArrayLike) -> LengthAndArm:
        """Return length L and arm dL / dphi about the pivot, in m, at the luffing angles `angle` (any shape).

        Both results have the shape of `angle`.  Angles phi are in rad.  The arm is 0 where the length is 0.
        """
        lug = self.lug_position(angle)
        from_foot = lug - self.foot
        length = np.linalg.norm(from_foot, axis=-1)
        turned = from_foot[..., 1] * lug[..., 0] - from_foot[..., 0] * lug[..., 1]
        return LengthAndArm(length, np.divide(turned, length, out=np.zeros_like(length), where=length > 0.0))

    def beyond_stroke(self, length: ArrayLike) -> float:
        """Return by how much the lengths `length` (T,) in m exceed the stroke at most, as a share of the stroke.

        The share is 0 if there is no stroke, or if no length is beyond its ends by more than round-off.
        """
        if self.stroke is None:
            return 0.0
        low, high = self.stroke
        share = float(max(low - np.min(length), np.max(length) - high) / (high - low))
        return share if share >= ROUND_OFF else 0.0

    def direction(self, angle: ArrayLike) -> NDArray[np.float64]:
        """Return unit vectors (..., 2) from foot to lug, along x and z of the boom.

        `angle` (...) are the luffing angles in rad.
        """
        along_cylinder = self.lug_position(angle) - self.foot
        x, z = np.moveaxis(along_cylinder / np.linalg.norm(along_cylinder, axis=-1, keepdims=True), -1, 0)
        sine, cosine = np.sin(angle), np.cos(angle)
        return np.stack([x * cosine + z * sine, z * cosine - x * sine], axis=-1)


class FirstExtension(SignalBase):
    """Stand-in for a free extension before its motion is computed: at all times the value `start` and the rate `speed`.

    The value is in m and the rate in m/s.  The bounds are `low` and `high` in m, the range that the boom is made for.
    """

    start: float
    speed: float
    low: float
    high: float
    drives: SkipValidation[Any]  # by name, the signal that drives the cylinder, if any

    def rate(self, t: ArrayLike) -> Array:
        return np.full_like(np.asarray(t, float), self.speed)

    @property
    def strands(self) -> tuple[Strand, ...]:
        return Constant(amount=self.start).strands

    def bounds(self, start: float, end: float) -> Interval:
        """Smallest and largest extension in m that the boom is made for; `start` and `end` have no effect."""
        return Interval(self.low, self.high)


class FreeExtension(DrivenCylinder):
    r"""Extension that is computed with the boom's motion, with what drives the section along the boom.

    The cylinder's length is the extension s.  The cylinder is driven by a force, by a length over a spring, or by oil;
    if no drive is given, the section slides by itself.  Damping, dry friction and stops at both ends of the stroke act
    in addition to the drive.
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
        default=STRIBECK_SPEED, description="Speed by which dry friction falls from that at rest to that of sliding"
    )
    shear_stiffness: Stiffness = Field(
        default=SHEAR_STIFFNESS, description="Stiffness along the boom while the cylinder sticks"
    )

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
    def unused_keys(self) -> dict[str, str]:
        """Keys of the dry friction that have no effect because of its other keys, with the reason."""
        return unused_friction_keys(self.dry_friction, self.dry_friction_at_rest, "dry_friction_at_rest")

    @property
    def reach(self) -> Interval:
        """Smallest and greatest extension in m that the boom is made for: the stroke, and as far as stops give way."""
        return Interval(self.stroke[0] - self.stop_travel, self.stroke[1] + self.stop_travel)

    @property
    def first(self) -> FirstExtension:
        """Signal that stands in for the extension before its motion is computed."""
        low, high = self.reach
        return FirstExtension(start=self.start, speed=self.rate, low=low, high=high, drives=self.drive_signals)
