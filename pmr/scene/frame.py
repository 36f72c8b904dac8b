r"""The moving frame of a boom, which luffs (raises) and slews (turns about the vertical), and the machine below it.

x is along the boom, and z is upwards when the boom lies level.  With the luffing angle :math:`\varphi` and the slewing
angle :math:`\psi` the frame's angular velocity in its own axes is

.. math::
    \omega = (\dot\psi \sin\varphi,\; -\dot\varphi,\; \dot\psi \cos\varphi)

and the vertical in these axes is :math:`(\sin\varphi, 0, \cos\varphi)`.

A base that moves (an earthquake, a truck, a ship) carries the frame.  The pivot is displaced by (x, y, z) along axes of
the ground.  The axes of the base are rotated by roll :math:`r_x`, pitch :math:`r_y` and yaw :math:`r_z`, roll first, so
that :math:`R_Z(r_z) R_Y(r_y) R_X(r_x)` is the product of the rotations about the axes of the ground.  On the ground Z
is upwards, and X is where the boom points at a slewing angle of 0.

The machine below the pivot is a rigid body whose motion in free directions is computed.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Generic, Literal, NamedTuple, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, FieldSerializationInfo, field_serializer, model_validator

from pmr.errors import InputError
from pmr.files.arrays import Array
from pmr.scene.cylinder import LuffingCylinder
from pmr.scene.ground import Ground
from pmr.scene.joints import ScaledSignal
from pmr.scene.keys import Direction, Mass, Once, Point, Quantity, SceneTable, Switch, Usual, key_error
from pmr.scene.rotation import FrameRotation, boom_rotation, motion_of
from pmr.scene.signals import Constant, Signal, SignalBase
from pmr.scene.structures import BodyMoments

#: Directions in which a machine moves, as keys of `[frame.base]`: displacements of the pivot, roll, pitch and yaw.
DIRECTIONS: tuple[Direction, ...] = ("x", "y", "z", "rx", "ry", "rz")
Spring = Annotated[float, Quantity("N/m", 0.0, 1e15), Usual(2e3, 1e14, unit="N/m")]
TurningSpring = Annotated[float, Quantity("N m/rad", 0.0, 1e15), Usual(2e3, 1e15, unit="N m/rad")]
Damper = Annotated[float, Quantity("N s/m", 0.0, 1e15)]
TurningDamper = Annotated[float, Quantity("N m s/rad", 0.0, 1e15)]
Displacement = Annotated[float, Quantity("m", -1e6, 1e6)]
Angle = Annotated[float, Quantity("frame.unit", -1e6, 1e6)]
Velocity = Annotated[float, Quantity("m/s", -1e6, 1e6)]
AngularRate = Annotated[float, Quantity("frame.unit/s", -1e6, 1e6)]
Straight = TypeVar("Straight", bound=float)
Turned = TypeVar("Turned", bound=float)


#: Default of numbers of both types.
NOTHING: Any = 0.0


class DirectionTable(SceneTable, Generic[Straight, Turned]):
    """One number for each direction in which the machine may be free, along and about axes of the ground."""

    x: Straight = Field(default=NOTHING, description="Of the pivot along X of the ground")
    y: Straight = Field(default=NOTHING, description="Of the pivot along Y of the ground")
    z: Straight = Field(default=NOTHING, description="Of the pivot upwards")
    rx: Turned = Field(default=NOTHING, description="Of roll")
    ry: Turned = Field(default=NOTHING, description="Of pitch")
    rz: Turned = Field(default=NOTHING, description="Of yaw")

    @property
    def nonzero(self) -> dict[str, float]:
        """Values that are not zero, by their directions."""
        return {key: value for key in DIRECTIONS if (value := getattr(self, key))}


class Springs(DirectionTable[Spring, TurningSpring]):
    """Springs between the machine and the base it stands on, which moves as `[frame.base]` says."""


class Dampers(DirectionTable[Damper, TurningDamper]):
    """Dampers parallel to the springs."""


class InitialDisplacements(DirectionTable[Displacement, Angle]):
    """Initial displacements of the pivot and initial angles in free directions."""


class InitialRates(DirectionTable[Velocity, AngularRate]):
    """Initial velocities of the pivot and initial angular rates in free directions."""


class PivotLoad(SceneTable):
    """A force at the pivot, or a moment, along axes of the ground."""

    x: Signal | None = Field(default=None, description="Along X of the ground, in N or N m")
    y: Signal | None = Field(default=None, description="Along Y of the ground, in N or N m")
    z: Signal | None = Field(default=None, description="Upwards, in N or N m")

    @property
    def signals(self) -> dict[str, SignalBase]:
        """Signals over time that the scene sets, by their axes x, y and z."""
        return {axis: signal for axis in "xyz" if (signal := getattr(self, axis)) is not None}


class Machine(SceneTable):
    """A rigid body that carries the pivot: a chassis, a ship, a cart."""

    mass: Annotated[Mass, Usual(0.2, 1e6, "boom")] = Field(description="Without the boom")
    center: Annotated[Point, Usual(0.0, 3.0, "reach")] = Field(
        default=(0.0, 0.0, 0.0), description="Of its mass, from the pivot along axes of the machine"
    )
    inertia: BodyMoments = Field(
        default=(0.0, 0.0, 0.0), description="About its centre of mass, about axes of the machine"
    )
    free: Annotated[tuple[Direction, ...], Once] = Field(
        default=(), description="Directions that are not held: their motion is found, far as it may go"
    )
    stiffness: Springs = Field(default=Springs.model_construct(), description="Of springs in free directions")
    damping: Dampers = Field(default=Dampers.model_construct(), description="Of dampers in free directions")
    force: PivotLoad = Field(
        default=PivotLoad.model_construct(), description="Forces at the pivot, along axes of the ground"
    )
    moment: PivotLoad = Field(default=PivotLoad.model_construct(), description="Moments, about axes of the ground")
    start: InitialDisplacements = Field(
        default=InitialDisplacements.model_construct(), description="Where free directions begin"
    )
    rate: InitialRates = Field(
        default=InitialRates.model_construct(), description="How fast free directions move at the start"
    )

    @model_validator(mode="after")
    def _check_free_directions(self) -> Self:
        """Refuse values in directions that are not free."""
        for key in ("stiffness", "damping", "start", "rate"):
            for direction, value in getattr(self, key).nonzero.items():
                if direction not in self.free:
                    raise key_error(f"{key}.{direction}", value, f"one of free is allowed: {list(self.free)}")
        return self

    def hint_scales(self, scales: Mapping[str, float]) -> dict[str, float]:
        """Return the scale ``inertia`` in kg m^2: the machine's mass times the square of the boom's reach."""
        return {"inertia": self.mass * scales["reach"] ** 2}


#: A full turn in rad: a larger angle is probably in degrees.
TURN = 2.0 * np.pi
#: Usual ranges of the frame's motions; angles have one range in rad and one in degrees.
SHAKEN, MOVED = Usual(1e-3, 100.0, unit="m/s^2"), Usual(0.0, 1e3, unit="m")
ROCKED, TURNED = Usual(0.0, 2.0, "rad", "rad"), Usual(0.0, 40.0, "rad", "rad")
#: Usual range of a rate at the start.
SWUNG = Usual(0.0, 20.0, "rad", "rad/s")
RAISED, SLEWED = Usual(1.6, np.inf, "degrees", "degrees"), Usual(3.2, np.inf, "degrees", "degrees")
#: Prefix of the inputs by which a moving frame accelerates a body; the field follows: ``inertia x``, ``inertia zx``.
INERTIA = "inertia "
#: Meaning of the inputs whose name begins with `INERTIA`, for messages.
MINUS_THE_ACCELERATION = "minus the acceleration of the frame, weight included"


class GroundAcceleration(SceneTable):
    """Recorded acceleration of the base."""

    x: Annotated[Signal, SHAKEN] | None = Field(
        default=None, description="Acceleration along X of the ground, in m/s^2"
    )
    y: Annotated[Signal, SHAKEN] | None = Field(
        default=None, description="Acceleration along Y of the ground, in m/s^2"
    )
    z: Annotated[Signal, SHAKEN] | None = Field(default=None, description="Acceleration upwards, in m/s^2")


class BaseMotion(SceneTable):
    """Motion of the machine below the pivot: an earthquake, a travelling truck, a ship."""

    x: Annotated[Signal, MOVED] | None = Field(
        default=None, description="Displacement of the pivot along X of the ground, in m"
    )
    y: Annotated[Signal, MOVED] | None = Field(
        default=None, description="Displacement of the pivot along Y of the ground, in m"
    )
    z: Annotated[Signal, MOVED] | None = Field(default=None, description="Displacement of the pivot upwards, in m")
    rx: Annotated[Signal, ROCKED] | None = Field(
        default=None, description="Roll angle of the base, about its X, in frame.unit"
    )
    ry: Annotated[Signal, ROCKED] | None = Field(
        default=None, description="Pitch angle of the base, about its Y, in frame.unit; positive lowers the boom"
    )
    rz: Annotated[Signal, TURNED] | None = Field(
        default=None, description="Yaw angle of the base, about its Z, in frame.unit"
    )
    acceleration: GroundAcceleration = Field(
        default=GroundAcceleration.model_construct(),
        description="Recorded acceleration of the pivot, added to the motion by x, y and z",
    )

    @model_validator(mode="after")
    def _check_motion(self) -> Self:
        """Refuse a base that has neither a motion nor an acceleration."""
        if not (self.motions or any(self.accelerations.values())):
            raise ValueError("a motion is needed: x, y, z, rx, ry, rz or acceleration")
        return self

    @property
    def motions(self) -> dict[str, SignalBase]:
        """Displacements in m and angles in the frame's unit over time, by those keys x to rz that are set."""
        signals = {key: getattr(self, key) for key in DIRECTIONS}
        return {key: signal for key, signal in signals.items() if signal is not None}

    @property
    def accelerations(self) -> dict[str, SignalBase]:
        """Recorded accelerations in m/s^2 over time, by those axes that are set."""
        signals = {axis: getattr(self.acceleration, axis) for axis in "xyz"}
        return {axis: signal for axis, signal in signals.items() if signal is not None}


class FrameAngles(NamedTuple):
    """Angles of a frame over time, in rad."""

    luffing: SignalBase
    slewing: SignalBase


class BoomAngles(SceneTable):
    """Angles of a boom about a pivot."""

    pivot: Annotated[Point, Usual(0.0, 5.0, "reach")] | None = Field(
        default=None, description="Position of the base's tail relative to the pivot, in the axes of the boom"
    )
    luffing: Annotated[Signal, ROCKED, RAISED] | Literal["free"] | None = Field(
        default=None,
        description="Luffing angle over time: how far the boom is raised; free: its motion is computed, with what "
        "drives the cylinder",
    )
    luffing_start: Annotated[float, Quantity("frame.unit", -1e6, 1e6), ROCKED, RAISED] = Field(
        default=0.0, description="Where a free luffing angle begins"
    )
    luffing_rate: Annotated[float, Quantity("frame.unit/s", -1e6, 1e6), SWUNG] = Field(
        default=0.0, description="How fast a free luffing angle moves at the start"
    )
    slewing: Annotated[Signal, TURNED, SLEWED] | None = Field(
        default=None, description="Slewing angle over time, about the upward vertical"
    )
    unit: Literal["rad", "degrees"] = Field(default="rad", description="Unit of all angles")


class Frame(BoomAngles):
    """A frame that luffs and slews about a pivot: the whole boom moves with it, and gravity keeps pointing down."""

    base: BaseMotion | None = Field(default=None, description="Motion of the machine below the pivot")
    machine: Machine | None = Field(
        default=None, description="Machine below the pivot as a rigid body, whose motion in free directions is computed"
    )
    cylinder: LuffingCylinder | None = Field(
        default=None, description="Luffing cylinder, whose force, length and power are computed"
    )
    ground: Ground | None = Field(
        default=None, description="Outriggers or wheels below the machine, whose forces are computed"
    )
    second_order: Switch | Literal["auto"] = Field(
        default=False,
        description="Whether geometric stiffness of axial forces and gyroscopic and centrifugal terms are included; "
        "auto: where they come to more than 0.2 % of what buckles the boom",
    )

    @model_validator(mode="after")
    def _check_complete(self) -> Self:
        """Refuse a frame without a motion or without a pivot."""
        if not any((self.luffing, self.slewing, self.base, self.machine, self.ground)):
            raise ValueError("an angle is needed: luffing or slewing, or a motion of the base, a machine or a ground")
        if self.pivot is None:
            raise key_error("pivot", None, "a place is needed, [0.0, 0.0, 0.0] for a base whose tail is at the pivot")
        return self

    def hint_scales(self, scales: Mapping[str, float]) -> dict[str, float]:
        """Return the scale 1 under the name of the unit of angles, ``rad`` or ``degrees``."""
        return {self.unit: 1.0}

    @property
    def radian(self) -> float:
        """One radian in the frame's unit of angles."""
        return 1.0 if self.unit == "rad" else 180.0 / float(np.pi)

    @property
    def tail_position(self) -> Point:
        """Position (3,) in m of the base's tail, measured from the pivot, in the axes of the boom.

        The key ``pivot`` holds this vector, despite its name.
        """
        assert self.pivot is not None  # as the validator says
        return self.pivot

    @field_serializer("luffing")
    def _dump_luffing(self, luffing: SignalBase | str | None, info: FieldSerializationInfo) -> object:
        """Return the keys of a luffing angle that is a signal, and any other angle unchanged.

        Pydantic itself would warn of the union of types.
        """
        if not isinstance(luffing, SignalBase):
            return luffing
        return luffing.model_dump(
            mode=info.mode,
            by_alias=info.by_alias,
            exclude_unset=info.exclude_unset,
            exclude_defaults=info.exclude_defaults,
            exclude_none=info.exclude_none,
        )

    @property
    def angles(self) -> FrameAngles:
        """Luffing and slewing angle in rad; a constant 0 for an angle that the scene does not set.

        A free luffing angle is represented by a constant, its value at t = 0.
        """
        luffing = Constant(amount=self.luffing_start) if self.luffing == "free" else self.luffing_signal
        return FrameAngles(self._in_rad(luffing), self._in_rad(self.slewing))

    @property
    def luffing_signal(self) -> SignalBase | None:
        """Luffing angle over time in the frame's unit; None if the scene does not set the angle, or leaves it free."""
        return None if self.luffing == "free" else self.luffing

    @property
    def computed_key(self) -> str | None:
        """Key within [frame] of the part whose motion is computed with the boom's; None if all motion is prescribed."""
        return "machine" if self.machine is not None else "luffing" if self.luffing == "free" else None

    @property
    def free_directions(self) -> tuple[str, ...]:
        """Directions of the machine, or ``luffing``, whose motion is computed; empty if all motion is prescribed."""
        return self.machine.free if self.machine is not None else ("luffing",) if self.luffing == "free" else ()

    @property
    def base_angles(self) -> tuple[SignalBase, ...]:
        """Roll, pitch and yaw of the base in rad over time.

        Roll and pitch follow from the slope of the ground, if that is not 0.  The result is empty if nothing turns the
        base: no angle in ``base``, no slope and no machine.
        """
        motions = {} if self.base is None else self.base.motions
        if self.ground is not None and any(self.ground.slope):
            along, across = self.ground.slope
            motions = motions | {"rx": Constant(amount=across), "ry": Constant(amount=-along)}
        turned = tuple(self._in_rad(motions.get(axis)) for axis in ("rx", "ry", "rz"))
        return turned if self.machine is not None or {"rx", "ry", "rz"} & set(motions) else ()

    @property
    def has_angles(self) -> bool:
        """Whether the frame has any angle: luffing, slewing, or one of the base."""
        return self.luffing is not None or self.slewing is not None or bool(self.base_angles)

    @property
    def out_of_plane_key(self) -> str | None:
        """Key within [frame] of the motion that moves the boom out of a vertical plane; None if nothing does.

        A motion that is computed counts as such a motion, and so does a ground that slopes across the boom.
        """
        if self.computed_key is not None:
            return self.computed_key
        motions = {} if self.base is None else {f"base.{key}": signal for key, signal in self.base.motions.items()}
        if self.base is not None:
            motions |= {f"base.acceleration.{axis}": signal for axis, signal in self.base.accelerations.items()}
        if self.ground is not None and self.ground.slope[1]:
            return "ground.slope"
        out = ("base.y", "base.rx", "base.rz", "base.acceleration.y")
        return next((key for key in ("slewing", *out) if key in motions or (key == "slewing" and self.slewing)), None)

    def rotation(self, t: ArrayLike) -> Array:
        """Return the rotations (T, 3, 3) from axes of the boom to axes of the base at times t (T,) in s.

        T is 1 for a single number t.  A free luffing angle has its value at t = 0 at all times.
        """
        luffing, slewing = (np.atleast_1d(angle.value(np.asarray(t))) for angle in self.angles)
        return boom_rotation(luffing, slewing)

    def base_rotation(self, t: Array) -> Array:
        """Return the rotation (T, 3, 3) from axes of the base to axes of the ground at times t (T,) in s.

        It is the identity if nothing turns the base.
        """
        rocking = self.base_angles or (Constant(amount=0.0),) * 3
        return FrameRotation.from_rocking([motion_of(angle, t) for angle in rocking]).rotation

    def refuse_without_unit(self, key: str, angles: ArrayLike, source: str = "scene") -> None:
        """Raise an InputError for `key` in `source` if `angles` (any shape) exceed a full turn and no unit is set."""
        largest = float(np.max(np.abs(angles), initial=0.0))
        if largest > TURN and "unit" not in self.model_fields_set:
            allowed = "an angle of more than a turn needs its unit: set frame.unit = 'degrees' or 'rad'"
            raise InputError(source, key, float(f"{largest:.4g}"), allowed)

    def _in_rad(self, angle: SignalBase | None) -> SignalBase:
        """Return an angle of the scene as a signal in rad; a constant 0 for None."""
        if angle is None:
            return Constant(amount=0.0)
        return angle if self.unit == "rad" else ScaledSignal(signal=angle, ratio=float(np.pi) / 180.0, offset=0.0)
