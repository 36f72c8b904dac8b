r"""Accelerations that a moving frame gives the sections of a boom, as amplitudes of constant fields.

With the tail of a section at X on the boom's axis e_x, the tail of the base section at p from the pivot, the vertical
e_Z, the acceleration g of gravity, and the angular velocity :math:`\omega` and acceleration :math:`\alpha` of the frame
(a tilde makes a vector the matrix of its cross product),

.. math::
    a(r) = g\, e_Z + \ddot u + \ddot X e_x + 2\, \omega \times \dot X e_x + A\, (p + X e_x + r), \qquad
    A = \tilde\alpha + \tilde\omega \tilde\omega

is the acceleration of a section's points r, which are at rest in the section, minus the acceleration of gravity; u'' is
the acceleration of the pivot if the base moves.  It consists of a constant field and, for each pair of axes j and k, of
the field r_k along e_j with the factor A_jk.  The inertia loads are minus these fields.  The axes are those of
`pmr.scene.frame`.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import lru_cache
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike

from pmr.files.arrays import Array
from pmr.scene import Scene
from pmr.scene.built import Load
from pmr.scene.choice import inertia_fields, input_directions, rope_pulls
from pmr.scene.frame import INERTIA, Frame
from pmr.scene.hoist import ROPE
from pmr.scene.joints import ScaledSignal
from pmr.scene.keys import Direction, input_name
from pmr.scene.mechanism import FrameTerm, frame_terms
from pmr.scene.members import Member, member_at
from pmr.scene.signals import Constant, SignalBase
from pmr.scene.signals.base import Interval, Strand
from pmr.simulation.frame_motion import (
    Acceleration,
    Derived,
    FrameRotation,
    Product,
    Products,
    Quantity,
    evaluate,
    field_products,
    rotation_products,
)
from pmr.simulation.wind import WindOnSection
from pmr.system.hoist import frame_quantities

#: Number of samples among which the smallest and largest amplitudes are searched.
SAMPLES = 10_001


@lru_cache(maxsize=2)
def _cached_turning(
    luffing: SignalBase, slewing: SignalBase, t: bytes, rocking: tuple[SignalBase, ...]
) -> FrameRotation:
    """`FrameRotation.from_signals`, cached, as all fields of all sections use the same times t (bytes of an array)."""
    return FrameRotation.from_signals(luffing, slewing, np.frombuffer(t), rocking)


class FrameSignal(Derived):
    """A scalar signal that follows from the frame's angles and paths; its rate is a difference quotient over a step."""

    def highest_frequency(self, start: float, end: float) -> float:
        """Twice the highest frequency in Hz of angles and paths from `start` to `end` in s.

        Their rates enter as squares and products.
        """
        return 2.0 * max(signal.highest_frequency(start, end) for signal in self.signals)

    def bounds(self, start: float, end: float) -> Interval:
        """Smallest and largest value among `SAMPLES` samples from `start` to `end`, and at the breaks in between."""
        values = self.value(np.append(np.linspace(start, end, SAMPLES), [b for b in self.breaks if start <= b <= end]))
        return Interval(float(values.min()), float(values.max()))


class Amplitude(FrameSignal):
    """Signal that is a sum of products of the frame's quantities (`pmr.simulation.frame_motion.Quantity`)."""

    @property
    @abstractmethod
    def products(self) -> Products:
        """Products whose sum is the amplitude."""

    @abstractmethod
    def quantities(self, t: Array) -> Callable[[Quantity], Array]:
        """Function that returns the values (T,) of a quantity at the times t (T,) in s."""

    def value(self, t: ArrayLike) -> Array:
        at = np.asarray(t, float)
        times = at.ravel()
        return evaluate(self.products, self.quantities(times), times).reshape(at.shape)


class AngleAmplitude(Amplitude):
    """Amplitude that depends on the angles of the frame: `luffing`, `slewing`, and `rocking` of its base."""

    luffing: SignalBase
    slewing: SignalBase
    rocking: tuple[SignalBase, ...] = ()

    @property
    def signals(self) -> tuple[SignalBase, ...]:
        return (self.luffing, self.slewing, *self.rocking)

    def frame_rotation(self, t: Array) -> FrameRotation:
        """Angular velocity, angular acceleration and rotation of the frame at the times t (T,) in s."""
        return _cached_turning(self.luffing, self.slewing, t.tobytes(), self.rocking)

    def quantities(self, t: Array) -> Callable[[Quantity], Array]:
        turning = self.frame_rotation(t)
        of = {
            "turned": turning.rotation,
            "velocity": turning.velocity,
            "turning": turning.acceleration,
            "gradient": turning.gradient,
        }

        def value_of(quantity: Quantity) -> Array:
            """Values (T,) of a quantity of rotation, angular velocity, angular acceleration or A."""
            at: Any = (slice(None), *quantity[1:])
            return np.asarray(of[str(quantity[0])][at])

        return value_of


class BaseAcceleration(FrameSignal):
    """Acceleration in m/s^2 of a base along a ground axis: of its `displacement`, plus a prescribed `acceleration`."""

    displacement: SignalBase  # m
    acceleration: SignalBase  # m/s^2

    @property
    def signals(self) -> tuple[SignalBase, ...]:
        return (self.displacement, self.acceleration)

    def value(self, t: ArrayLike) -> Array:
        return np.asarray(self.displacement.second_rate(t) + self.acceleration.value(t))

    @property
    def strands(self) -> tuple[Strand, ...]:
        displacements = (replace(strand, spread=-1.0) for strand in self.displacement.strands)
        return (*displacements, *self.acceleration.strands)


class SectionAcceleration(AngleAmplitude):
    """A component of the acceleration field of a section, times a factor."""

    gravity: SignalBase  # m/s^2
    pivot: tuple[float, float, float]  # m: position of the base section's tail from the pivot
    paths: tuple[SignalBase, ...]  # m: extensions with the sum X
    base: tuple[SignalBase, ...] = ()  # m/s^2: accelerations of the pivot along axes of the ground, if it moves
    field: str  # ``x`` of the constant part, ``xz`` of A_xz
    factor: float = 1.0

    @property
    def signals(self) -> tuple[SignalBase, ...]:
        return (*super().signals, self.gravity, *self.paths, *self.base)

    @property
    def products(self) -> Products:
        """Products of the component (`field_products`)."""
        return field_products(self.field, len(self.paths), self.pivot, bool(self.base), self.factor)

    def quantities(self, t: Array) -> Callable[[Quantity], Array]:
        of_angles = super().quantities(t)

        def value_of(quantity: Quantity) -> Array:
            """Values (T,) of gravity, of the base's acceleration, of the position X, or of a quantity of the angles."""
            if quantity[0] == "gravity":
                return np.asarray(self.gravity.value(t))
            if quantity[0] == "shaken":
                return np.asarray(self.base[int(quantity[1])].value(t))
            return self._reach(t, int(quantity[2])) if quantity[0] == "reach" else of_angles(quantity)

        return value_of

    def highest_frequency(self, start: float, end: float) -> float:
        """Twice the highest frequency in Hz of angles, gravity and paths from `start` to `end` in s.

        If the base is shaken, it is at least the sum of two highest frequencies: the base's and that of all others.
        """
        of_angles = super().signals
        slow, shaken = (
            max((signal.highest_frequency(start, end) for signal in signals), default=0.0)
            for signals in ((*of_angles, self.gravity, *self.paths), self.base)
        )
        return max(2.0 * slow, shaken + slow if shaken else 0.0)

    def _reach(self, t: Array, order: int) -> Array:
        """Position X (T,) of the section's tail in m at t (T,) s, or its derivative of order 1 or 2."""
        if order == 2:
            return Acceleration(paths=self.paths, step=self.step).value(t)
        return np.asarray(np.sum([getattr(path, ("value", "rate")[order])(t) for path in self.paths], axis=0))


class Rotation(AngleAmplitude):
    """Amplitude by which the frame's rotation acts on a body's small motions (`rotation_products`).

    `of` is ``rotation`` (twice an angular velocity), ``turning`` (an angular acceleration) or ``carried`` (a product of
    angular velocities).
    """

    of: str  # `rotation`, `turning` or `carried`
    component: str  # one or two axes, such as ``x`` or ``xy``

    @property
    def products(self) -> Products:
        return rotation_products(self.of, self.component)


class CylinderAmplitude(Amplitude):
    """Amplitude of a cylinder's force over its length: `factor` times `of` (acceleration or load) over `length`."""

    factor: float
    of: SignalBase
    length: SignalBase
    number: int  # number of the section that the cylinder drives
    name: str = ""  # name of the load's input

    @property
    def signals(self) -> tuple[SignalBase, ...]:
        return (self.of, self.length)

    def on_steps(self, step: float) -> Self:
        return self.model_copy(update={"step": step, "of": self.of.on_steps(step)})

    @property
    def products(self) -> Products:
        """Products of `of`, each times factor over length."""
        return tuple(product.times(self.factor, ("over", self.number)) for product in products_of(self.of, self.name))

    def quantities(self, t: Array) -> Callable[[Quantity], Array]:
        inner = self.of.quantities(t) if isinstance(self.of, Amplitude) else lambda _: np.asarray(self.of.value(t))
        return lambda quantity: np.asarray(1.0 / self.length.value(t)) if quantity[0] == "over" else inner(quantity)


class GroundForceComponent(AngleAmplitude):
    """Component, along a body's axis, of a force along an axis of the ground."""

    force: SignalBase
    name: str  # of the load
    along: Literal["x", "y", "z"]  # axis of the ground
    part: Literal["x", "y", "z"]  # axis of the body

    @property
    def signals(self) -> tuple[SignalBase, ...]:
        return (*super().signals, self.force)

    @property
    def products(self) -> Products:
        turned = ("turned", "xyz".index(self.along), "xyz".index(self.part))
        return (Product(1.0, (turned, ("load", self.name))),)

    def quantities(self, t: Array) -> Callable[[Quantity], Array]:
        of_angles = super().quantities(t)
        return lambda quantity: np.asarray(self.force.value(t)) if quantity[0] == "load" else of_angles(quantity)

    def highest_frequency(self, start: float, end: float) -> float:
        """Sum of the highest frequencies in Hz of the force and of the frame's angles from `start` to `end` in s."""
        return sum(signal.highest_frequency(start, end) for signal in self.signals)


def products_of(signal: SignalBase, name: str) -> Products:
    """Products of the signal of an input or a term; a signal that is no `Amplitude` is the load `name` itself."""
    return signal.products if isinstance(signal, Amplitude) else (Product(1.0, (("load", name),)),)


def load_signals(scene: Scene, member: Member) -> dict[str, SignalBase]:
    """Signals of a section's loads over time, by the names of the inputs of the section's full model.

    A load along an axis of the body has one signal.  A force along an axis of the ground has one signal for each of its
    components along the axes of the body; a component is left out if it is always zero or the model can't move along
    its axis.  The loads by which the rope of a hoist pulls come last.
    """
    signals = dict[str, SignalBase]()
    for load in member.part.loads:
        for name, part in input_directions(member, load).items():
            if load.acts == "wind":
                signals[name] = WindOnSection.of_load(scene, member, load, name)
            else:
                along_body = load.axes == "body"
                signals[name] = load.signal if along_body else _ground_force_component(scene, member, load, part)
    return signals | rope_load_signals(scene, member)


def rope_load_signals(scene: Scene, member: Member) -> dict[str, SignalBase]:
    """Signals of the loads by which the rope of a hoist pulls a section while its payload hangs at rest, by names.

    Along the boom the rope pulls with the weight over the number of its falls.  Simulators that know how the payload
    moves put the rope's forces in their place.  The result is empty without a hoist or without gravity.
    """
    signals, hoist, gravity = dict[str, SignalBase](), scene.hoist, scene.gravity
    if hoist is None or gravity is None:
        return signals
    for pull in rope_pulls(member):
        weight, line = hoist.mass, hoist.mass / hoist.falls * (1.0 if pull.place == "winch" else -1.0) * pull.lever[0]
        hangs = pull.place == "head"
        if scene.frame is not None:
            signals[pull.load.name] = RopeWeight(
                **_angle_signals(scene.frame), gravity=gravity.signal, step=scene.time.step, line=line,
                share=tuple(-weight * part * hangs for part in pull.lever),
            )  # fmt: skip
        else:
            ratio = line + hangs * weight * float(np.dot(pull.lever, gravity.direction))
            signals[pull.load.name] = ScaledSignal(signal=gravity.signal, ratio=ratio, offset=0.0)
    return signals


class RopeWeight(AngleAmplitude):
    """Load by a payload that hangs at rest: gravity times `line`, and times `share` along the vertical."""

    gravity: SignalBase
    line: float  # kg
    share: tuple[float, float, float]  # kg: along x, y and z of the boom

    @property
    def signals(self) -> tuple[SignalBase, ...]:
        return (*super().signals, self.gravity)

    @property
    def products(self) -> Products:
        of_share = (Product(s, (("gravity",), ("turned", 2, k))) for k, s in enumerate(self.share) if s)
        return (*of_share, *([Product(self.line, (("gravity",),))] if self.line else []))

    def quantities(self, t: Array) -> Callable[[Quantity], Array]:
        of_angles = super().quantities(t)
        return lambda quantity: np.asarray(self.gravity.value(t)) if quantity[0] == "gravity" else of_angles(quantity)


class HoistDriver(SectionAcceleration):
    """A quantity that drives a hoist: ``gravity``, ``shaken`` along an axis or ``turned``, an entry of the rotation."""

    quantity: tuple[str | int, ...]

    @property
    def products(self) -> Products:
        return (Product(1.0, (self.quantity,)),)


def hoist_signals(scene: Scene) -> dict[str, SignalBase]:
    """Signals of all that drives the hoist of a scene, by name; empty without a hoist (`pmr.system.hoist`)."""
    if scene.hoist is None:
        return {}
    signals = {ROPE: scene.hoist.rope_signal, **scene.hoist.wind_signals}
    if scene.frame is None:
        return signals
    about = section_acceleration(scene, 0, "x")
    fields = {name: getattr(about, name) for name in type(about).model_fields}
    return signals | {name: HoistDriver(**fields, quantity=of) for name, of in frame_quantities(scene).items()}


def _ground_force_component(scene: Scene, member: Member, load: Load, part: Direction) -> GroundForceComponent:
    """Component `part` (an axis of the body) of a load along a ground axis."""
    assert scene.frame is not None  # as the checks say
    name = input_name(scene.names[member.number], load.name)
    about = {"name": name, "along": load.direction, "part": part, "step": scene.time.step}
    return GroundForceComponent(force=load.signal, **_angle_signals(scene.frame), **about)


def _angle_signals(frame: Frame) -> dict[str, Any]:
    """Luffing, slewing and rocking angles of a frame, as arguments of `AngleAmplitude`."""
    luffing, slewing = frame.angles
    return {"luffing": luffing, "slewing": slewing, "rocking": frame.base_angles}


def base_accelerations(scene: Scene) -> tuple[SignalBase, ...]:
    """Accelerations of the pivot in m/s^2 along X, Y and Z of the ground; empty if the base has no displacement."""
    base, none = scene.frame.base if scene.frame else None, Constant(amount=0.0)
    if base is None or not {"x", "y", "z"} & {*base.motions, *base.accelerations}:
        return ()
    return tuple(
        BaseAcceleration(
            displacement=base.motions.get(axis, none),
            acceleration=base.accelerations.get(axis, none),
            step=scene.time.step,
        )
        for axis in "xyz"
    )


def section_acceleration(scene: Scene, number: int, field: str, factor: float = 1.0) -> SectionAcceleration:
    """Signal of a component `field` of the acceleration field of section `number`, times `factor`."""
    frame = scene.frame
    assert frame is not None  # of a scene that has one
    return SectionAcceleration(
        **_angle_signals(frame),
        base=base_accelerations(scene),
        gravity=scene.gravity.signal if scene.gravity else Constant(amount=0.0),
        pivot=frame.tail_position,
        paths=tuple(scene.extension(k) for k in range(1, number + 1)),
        step=scene.time.step,
        field=field,
        factor=factor,
    )


def inertia_loads(scene: Scene, member: Member) -> dict[str, SignalBase]:
    """Amplitudes of the inertia inputs of a section in a frame, by the inputs' names; empty without such inputs."""
    return {
        INERTIA + field: section_acceleration(scene, member.number, field, -1.0) for field in inertia_fields(member)
    }


def term_signals(scene: Scene, which: Iterable[FrameTerm] | None = None) -> dict[str, SignalBase]:
    """Amplitudes of terms (`pmr.scene.mechanism`) by name: of all terms of the scene, or of `which`."""
    return {term.name: _term_signal(scene, term) for term in (frame_terms(scene) if which is None else which)}


def _term_signal(scene: Scene, term: FrameTerm) -> SignalBase:
    """Amplitude of one term of the scene."""
    assert scene.frame is not None  # of a scene that has terms
    if term.kind == "field":
        return section_acceleration(scene, term.number, term.component)
    if term.kind == "load":
        return load_signals(scene, member_at(scene, term.number))[term.component]
    if term.kind in ("cylinder", "cylinder load"):
        carried = scene.names.index(term.carried_section)
        length = {"length": scene.extension(term.number), "number": term.number, "step": scene.time.step}
        if term.kind == "cylinder":
            return CylinderAmplitude(factor=-1.0, of=section_acceleration(scene, carried, term.component), **length)
        load = load_signals(scene, member_at(scene, carried))[term.component]
        return CylinderAmplitude(factor=1.0, of=load, name=input_name(term.carried_section, term.component), **length)
    about = {"of": term.kind, "component": term.component, "step": scene.time.step}
    return Rotation(**_angle_signals(scene.frame), **about)
