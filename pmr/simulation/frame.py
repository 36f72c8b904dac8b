r"""Loads on the sections of a boom in a frame: by its acceleration, as amplitudes of constant fields, and by wind.

With the tail of a section at X on the boom's axis e_x, the tail of the base section at p from the pivot, the vertical
e_Z, the acceleration g of gravity, and the angular velocity :math:`\omega` and acceleration :math:`\alpha` of the frame
(a tilde makes a vector the matrix of its cross product),

.. math::
    a(r) = g\, e_Z + \ddot u + \ddot X e_x + 2\, \omega \times \dot X e_x + A\, (p + X e_x + r), \qquad
    A = \tilde\alpha + \tilde\omega \tilde\omega

is the acceleration of a section's points r, which are at rest in the section, minus the acceleration of gravity; u'' is
the acceleration of the pivot if the base moves.  It consists of a constant field and, for each pair of axes j and k, of
the field r_k along e_j with the factor A_jk.  The inertia loads are minus these fields.  The axes are those of
`pmr.scene.frame`.  Wind is a profile over the height above the ground (`WindOnSection`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel, ConfigDict, SkipValidation

from pmr.files.arrays import Array
from pmr.scene import Scene
from pmr.scene.built import POLYNOMIALS, PRESSED, Load
from pmr.scene.choice import input_directions, rope_pulls
from pmr.scene.joints import ScaledSignal
from pmr.scene.keys import Direction, input_name
from pmr.scene.members import Member
from pmr.scene.rotation import FrameRotation, wind_direction
from pmr.scene.signals import Constant, SignalBase
from pmr.scene.signals.base import Strand
from pmr.simulation.frame_motion import (
    Acceleration,
    FrameSignal,
    Product,
    Products,
    Quantity,
    evaluate,
    field_products,
)


@lru_cache(maxsize=2)
def _cached_turning(
    luffing: SignalBase, slewing: SignalBase, t: bytes, rocking: tuple[SignalBase, ...]
) -> FrameRotation:
    """`FrameRotation.from_signals` for the times in s whose array has the bytes t; the last two results are stored.

    `luffing` and `slewing` are the signals of the frame's angles, `rocking` those of the base's angles, in rad.
    """
    return FrameRotation.from_signals(luffing, slewing, np.frombuffer(t), rocking)


class BaseAcceleration(FrameSignal):
    """Acceleration in m/s^2 of a base along a ground axis: of its `displacement`, plus a prescribed `acceleration`."""

    displacement: SignalBase  # m
    acceleration: SignalBase  # m/s^2

    @property
    def signals(self) -> tuple[SignalBase, ...]:
        """The displacement in m and the prescribed acceleration in m/s^2."""
        return (self.displacement, self.acceleration)

    def value(self, t: ArrayLike) -> Array:
        """Acceleration in m/s^2 at the times t (any shape) in s, in the shape of t."""
        return np.asarray(self.displacement.second_rate(t) + self.acceleration.value(t))

    def highest_frequency(self, start: float, end: float) -> float:
        """Highest frequency in Hz of displacement and prescribed acceleration from `start` to `end` in s."""
        return max(signal.highest_frequency(start, end) for signal in self.signals)

    @property
    def strands(self) -> tuple[Strand, ...]:
        """Pieces of the signal for the kernel; those of the displacement are marked to enter with their second rate."""
        displacements = (replace(strand, spread=-1.0) for strand in self.displacement.strands)
        return (*displacements, *self.acceleration.strands)


class FrameAmplitude(FrameSignal):
    """Signal that is a sum of `products` of the frame's quantities (`pmr.simulation.frame_motion.Quantity`).

    The other fields are the signals from which the quantities follow; those that no product needs may be left out.
    """

    products: SkipValidation[Products]
    luffing: SignalBase
    slewing: SignalBase
    rocking: tuple[SignalBase, ...] = ()  # angles of the base
    gravity: SignalBase = Constant(amount=0.0)  # m/s^2
    base: tuple[SignalBase, ...] = ()  # m/s^2: accelerations of the pivot along axes of the ground, if it moves
    paths: tuple[SignalBase, ...] = ()  # m: extensions of the sections, from the first that slides on
    loads: tuple[tuple[str, SignalBase], ...] = ()  # by the names of their inputs

    @property
    def signals(self) -> tuple[SignalBase, ...]:
        """All signals from which the amplitude follows."""
        return (*self._slow_signals, *self._fast_signals)

    @property
    def _slow_signals(self) -> tuple[SignalBase, ...]:
        """Signals of angles, gravity and paths, whose rates, squares and products are in the amplitude."""
        return (self.luffing, self.slewing, *self.rocking, self.gravity, *self.paths)

    @property
    def _fast_signals(self) -> tuple[SignalBase, ...]:
        """Signals of the base's accelerations and of loads, in which the amplitude is linear."""
        return (*self.base, *(load for _, load in self.loads))

    def value(self, t: ArrayLike) -> Array:
        """Sum of the products at the times t (any shape) in s, in the shape of t."""
        at = np.asarray(t, float)
        times = at.ravel()
        return evaluate(self.products, self._quantities(times), times).reshape(at.shape)

    def _quantities(self, t: Array) -> Callable[[Quantity], Array]:
        """Function that returns the values (T,) of a quantity at the times t (T,) in s."""
        turning = _cached_turning(self.luffing, self.slewing, t.tobytes(), self.rocking)
        of_rotation = {
            "turned": turning.rotation,
            "velocity": turning.velocity,
            "turning": turning.acceleration,
            "gradient": turning.gradient,
        }

        def value_of(quantity: Quantity) -> Array:
            """Values (T,) of a quantity."""
            kind, *of = quantity
            if kind == "gravity":
                return np.asarray(self.gravity.value(t))
            if kind == "shaken":
                return np.asarray(self.base[int(of[0])].value(t))
            if kind == "reach":
                paths, order = self.paths[: int(of[0])], int(of[1])
                if order == 2:
                    return Acceleration(paths=paths, step=self.step).value(t)
                return np.asarray(np.sum([getattr(path, ("value", "rate")[order])(t) for path in paths], axis=0))
            if kind == "raised":
                return np.asarray((np.sin, np.zeros_like, np.cos)[int(of[0])](self.luffing.value(t)))
            if kind == "over":
                return np.asarray(1.0 / self.paths[int(of[0]) - 1].value(t))
            if kind == "load":
                return np.asarray(dict(self.loads)[str(of[0])].value(t))
            at: Any = (slice(None), *of)
            return np.asarray(of_rotation[str(kind)][at])

        return value_of

    def highest_frequency(self, start: float, end: float) -> float:
        """Highest frequency in Hz of the amplitude from `start` to `end` in s, an estimate.

        The amplitude has squares and products of angles, gravity and paths, so the estimate is twice the highest
        frequency of these.  A load or an acceleration of the base is multiplied by angles, gravity and paths.  If it
        has tones, the estimate is at least the sum of the highest frequencies of both groups.
        """
        slow, fast = (
            max((signal.highest_frequency(start, end) for signal in signals), default=0.0)
            for signals in (self._slow_signals, self._fast_signals)
        )
        return max(2.0 * slow, fast + slow if fast else 0.0)


def products_of(signal: SignalBase, name: str) -> Products:
    """Products whose sum is the signal of an input or a term.

    A signal that is no `FrameAmplitude` has one product: the load `name` itself.
    """
    return signal.products if isinstance(signal, FrameAmplitude) else (Product(1.0, (("load", name),)),)


def load_signals(scene: Scene, member: Member) -> dict[str, SignalBase]:
    """Signals of a section's loads over time, by the names of the inputs of the section's full model.

    A load along an axis of the body has one signal.  A force along an axis of the ground has one signal for each of its
    components along the axes of the body.  A component is left out if it is always zero or the model can't move along
    its axis.  Wind has one signal for each polynomial (`WindOnSection`) along each axis across the body.  The
    forces of a hoist's rope come last.
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
    """Signals by name of the forces of a hoist's rope on a section, while the payload hangs at rest.

    Along the boom the rope pulls with the payload's weight divided by the number of the rope's falls.  Simulators that
    compute the payload's motion take the rope's actual forces instead.  The result is empty without a hoist or without
    gravity.
    """
    signals, hoist, gravity = dict[str, SignalBase](), scene.hoist, scene.gravity
    if hoist is None or gravity is None:
        return signals
    for pull in rope_pulls(member):
        weight, line = hoist.mass, hoist.mass / hoist.falls * (1.0 if pull.place == "winch" else -1.0) * pull.lever[0]
        hangs = pull.place == "head"
        if scene.frame is not None:
            shares = enumerate(-weight * part * hangs for part in pull.lever)
            products = [Product(share, (("gravity",), ("turned", 2, k))) for k, share in shares if share]
            products += [Product(line, (("gravity",),))] if line else []
            signals[pull.load.name] = frame_amplitude(scene, tuple(products), gravity=gravity.signal)
        else:
            ratio = line + hangs * weight * float(np.dot(pull.lever, gravity.direction))
            signals[pull.load.name] = ScaledSignal(signal=gravity.signal, ratio=ratio, offset=0.0)
    return signals


def _ground_force_component(scene: Scene, member: Member, load: Load, part: Direction) -> FrameAmplitude:
    """Component `part` (an axis of the body) of a load along a ground axis."""
    name = input_name(scene.names[member.number], load.name)
    turned = ("turned", "xyz".index(load.direction), "xyz".index(part))
    return frame_amplitude(scene, (Product(1.0, (turned, ("load", name))),), loads=((name, load.signal),))


def frame_amplitude(scene: Scene, products: Products, **signals: Any) -> FrameAmplitude:
    """Signal that is the sum of `products` of the quantities of a scene's frame.

    `signals` are the fields of `FrameAmplitude`, other than angles, from which these quantities follow.
    """
    (luffing, slewing), rocking = scene.present_frame.angles, scene.present_frame.base_angles
    about = {"luffing": luffing, "slewing": slewing, "rocking": rocking, "step": scene.time.step}
    return FrameAmplitude(products=products, **about, **signals)


def accelerating_signals(scene: Scene, number: int) -> dict[str, Any]:
    """Signals other than the frame's angles that accelerate section `number`, as fields of `FrameAmplitude`.

    The keys are ``gravity``, ``base`` and ``paths``.
    """
    return {
        "gravity": scene.gravity.signal if scene.gravity else Constant(amount=0.0),
        "base": base_accelerations(scene),
        "paths": extensions_up_to(scene, number),
    }


def extensions_up_to(scene: Scene, number: int) -> tuple[SignalBase, ...]:
    """Extensions in m of the sections from the first that slides to section `number`; empty for the base, section 0."""
    return tuple(scene.extension(k) for k in range(1, number + 1))


def base_accelerations(scene: Scene) -> tuple[SignalBase, ...]:
    """Accelerations of the pivot in m/s^2 along X, Y and Z of the ground; empty if the pivot stays where it is.

    The pivot stays if the scene has no base, or a base with neither displacements nor accelerations.
    """
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


def section_acceleration(scene: Scene, number: int, field: str, factor: float = 1.0) -> FrameAmplitude:
    """Signal of the component `field` of the acceleration of section `number`, less that of gravity, times `factor`.

    Names of components are those of `pmr.simulation.frame_motion.field_products`, such as ``x`` or ``xz``.
    """
    about = accelerating_signals(scene, number)
    products = field_products(field, number, scene.present_frame.tail_position, bool(about["base"]), factor)
    return frame_amplitude(scene, products, **about)


#: Points of Gauss on each side of the height up to which the pressure is constant.
POINTS = 32


class ExposedSection(BaseModel):
    """A section of a boom and what is around it."""

    model_config = ConfigDict(frozen=True)

    paths: tuple[SignalBase, ...]  # m: extensions up to that of the section
    pivot: tuple[float, float, float]  # m: from the pivot to the tail of the base
    length: float  # m
    around: float  # m: length of the section around it; 0 for the base


class WindOnSection(FrameSignal):
    r"""Amplitude in N/m of one polynomial of the wind on one section, along one of its axes.

    The wind has the pressure q at the height Z above the ground, and blows along a horizontal unit vector with the
    component e along the axis y or z of the section.  The force per length along this axis is

    .. math:: w(x) = c\, d\, q(Z(x))\, e\, |e|, \qquad q = q_r(t) \bigl(\max(Z, Z_{least}) / Z_r\bigr)^{2 p}

    on the part of the section that is outside of the section around it, and 0 elsewhere.  The wind is replaced by its
    projection on Legendre polynomials of the length L,

    .. math:: w \approx \sum_j w_j P_j(2 x / L - 1), \qquad w_j = \frac{2 j + 1}{L} \int w\, P_j(2 x / L - 1)\, dx

    which has the same force and the same moment.  The part of the wind's velocity along the axis of the section exerts
    no force.  The motion of the boom itself against the air is left out.
    """

    SAMPLES: ClassVar = 1001

    angles: tuple[SignalBase, ...]  # rad: luffing and slewing, then those of a base that turns
    section: ExposedSection
    azimuth: float  # rad, from X of the ground, or from the boom if `load.slews`
    factors: tuple[float, float]  # m: shape factor times depth along y and along z
    load: Load  # signal of the pressure in Pa at the reference height, and profile over the height
    above: float  # m: of the pivot above the ground, without `rise`
    rise: SignalBase  # m: displacement of the pivot upwards, by frame.base.z
    axis: str  # of the section, ``y`` or ``z``
    degree: int  # j of the polynomial

    @classmethod
    def of_load(cls, scene: Scene, member: Member, load: Load, name: str) -> Self:
        """Amplitude of the input `name` (`pmr.scene.choice.input_directions`) of a load by wind.

        The pivot is as high above the ground as the scene says, unless the load states its own height; a displacement
        of the base upwards comes on top.
        """
        frame, part, box = scene.present_frame, member.part, member.part.body.box
        depths = [load.depth or getattr(box, key) for key in ("height", "width")]
        axis, degree = name.split(" ")[-2:]
        return cls(
            angles=(*frame.angles, *frame.base_angles),
            section=ExposedSection(
                paths=extensions_up_to(scene, member.number),
                pivot=frame.tail_position,
                length=part.length,
                around=scene.sections[member.number - 1].length if member.number else 0.0,
            ),
            azimuth=load.azimuth / frame.radian,
            factors=(load.shape * depths[0], load.shape * depths[1]),
            load=load,
            above=load.above or scene.pivot_height,
            rise=({} if frame.base is None else frame.base.motions).get("z", Constant(amount=0.0)),
            axis=axis,
            degree=int(degree),
            step=scene.time.step,
        )

    @property
    def signals(self) -> tuple[SignalBase, ...]:
        """Signals of the pressure, of the pivot's rise, of all angles, and of the extensions up to the section."""
        return (self.load.signal, self.rise, *self.angles, *self.section.paths)

    def value(self, t: ArrayLike) -> Array:
        """Amplitude in N/m at the times t (any shape) in s, in the shape of t."""
        at = np.asarray(t, float)
        of_all = self.model_copy(update={"axis": "y", "degree": 0})
        amplitudes = _amplitudes(of_all, at.ravel().tobytes())
        return np.asarray(amplitudes[PRESSED.index(self.axis), self.degree].reshape(at.shape))

    def highest_frequency(self, start: float, end: float) -> float:
        """Sum of the highest frequencies in Hz of all `signals` from `start` to `end` in s, an estimate."""
        return sum(signal.highest_frequency(start, end) for signal in self.signals)


@lru_cache(maxsize=8)
def _amplitudes(wind: WindOnSection, t: bytes) -> Array:
    """Amplitudes (2, `POLYNOMIALS`, T) in N/m of all polynomials of the wind along y and z, at T times.

    `t` holds the times in s as the bytes of an array.  Axis and degree of `wind` have no effect.  The last results are
    stored, so they must not be changed in place.
    """
    times, section, load = np.frombuffer(t), wind.section, wind.load
    luffing, slewing, *rocking = wind.angles
    turning = FrameRotation.from_signals(luffing, slewing, times, rocking)
    blown = wind_direction(turning.rotation, wind.azimuth + (slewing.value(times) if load.slews else 0.0))
    up, extensions = turning.up, [path.value(times) for path in section.paths]
    pivot = wind.above + wind.rise.value(times)
    tail = pivot + up @ np.array(section.pivot) + up[:, 0] * np.sum([np.zeros(len(times)), *extensions], axis=0)
    hidden = np.clip(section.around - extensions[-1], 0.0, section.length) if extensions else np.zeros(len(times))
    level = np.abs(up[:, 0]) < 1e-12
    bend = np.where(level, hidden, (load.least - tail) / np.where(level, 1.0, up[:, 0]))
    bend = np.clip(bend, hidden, section.length)
    points, weights = np.polynomial.legendre.leggauss(POINTS)
    total = np.zeros((POLYNOMIALS, len(times)))
    for first, last in ((hidden, bend), (bend, np.full(len(times), section.length))):
        x = ((first + last)[:, None] + (last - first)[:, None] * points) / 2.0
        height = np.maximum(tail[:, None] + up[:, :1] * x, load.least)
        pressure = (height / load.reference) ** (2.0 * load.exponent) * weights * (last - first)[:, None] / 2.0
        for degree in range(POLYNOMIALS):
            shape = np.polynomial.legendre.legval(2.0 * x / section.length - 1.0, np.eye(POLYNOMIALS)[degree])
            total[degree] += (2 * degree + 1) / section.length * np.sum(pressure * shape, axis=1)
    total *= load.signal.value(times)
    across = np.array([factor * blown[:, 1 + k] * np.abs(blown[:, 1 + k]) for k, factor in enumerate(wind.factors)])
    return np.asarray(across[:, None, :] * total)
