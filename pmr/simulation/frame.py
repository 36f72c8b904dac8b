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

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pydantic import SkipValidation

from pmr.files.arrays import Array
from pmr.scene import Scene
from pmr.scene.built import Load
from pmr.scene.choice import inertia_fields, input_directions, rope_pulls
from pmr.scene.frame import INERTIA
from pmr.scene.hoist import ROPE
from pmr.scene.joints import ScaledSignal
from pmr.scene.keys import Direction, input_name
from pmr.scene.mechanism import FrameTerm, frame_terms
from pmr.scene.members import Member, member_at
from pmr.scene.signals import Constant, SignalBase
from pmr.scene.signals.base import Strand
from pmr.simulation.frame_motion import (
    Acceleration,
    FrameRotation,
    FrameSignal,
    Product,
    Products,
    Quantity,
    evaluate,
    field_products,
    rotation_products,
)
from pmr.simulation.wind import WindOnSection
from pmr.system.terms import frame_quantities


@lru_cache(maxsize=2)
def _cached_turning(
    luffing: SignalBase, slewing: SignalBase, t: bytes, rocking: tuple[SignalBase, ...]
) -> FrameRotation:
    """`FrameRotation.from_signals`, cached, as all fields of all sections use the same times t (bytes of an array).

    `rocking` are the signals of the base's angles.
    """
    return FrameRotation.from_signals(luffing, slewing, np.frombuffer(t), rocking)


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


class FrameAmplitude(FrameSignal):
    """Signal that is a sum of `products` of the frame's quantities (`pmr.simulation.frame_motion.Quantity`).

    The other fields are the signals from which the quantities follow.
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
                return self._reach(t, int(of[0]), int(of[1]))
            if kind == "over":
                return np.asarray(1.0 / self.paths[int(of[0]) - 1].value(t))
            if kind == "load":
                return np.asarray(dict(self.loads)[str(of[0])].value(t))
            at: Any = (slice(None), *of)
            return np.asarray(of_rotation[str(kind)][at])

        return value_of

    def highest_frequency(self, start: float, end: float) -> float:
        """Highest frequency in Hz of the amplitude from `start` to `end` in s, an estimate.

        The estimate is twice the highest frequency of angles, gravity and paths, as the amplitude has their squares and
        products.  If a load or the base moves, the estimate is at least the sum of that motion's highest frequency and
        that of angles, gravity and paths.
        """
        slow, fast = (
            max((signal.highest_frequency(start, end) for signal in signals), default=0.0)
            for signals in (self._slow_signals, self._fast_signals)
        )
        return max(2.0 * slow, fast + slow if fast else 0.0)

    def _reach(self, t: Array, number: int, order: int) -> Array:
        """Position (T,) of a section's tail on the axis in m at t (T,) s, or its derivative of order 1 or 2.

        `number` is that of the section.
        """
        paths = self.paths[:number]
        if order == 2:
            return Acceleration(paths=paths, step=self.step).value(t)
        return np.asarray(np.sum([getattr(path, ("value", "rate")[order])(t) for path in paths], axis=0))


def products_of(signal: SignalBase, name: str) -> Products:
    """Products of the signal of an input or a term; a signal that is no `FrameAmplitude` is the load `name` itself."""
    return signal.products if isinstance(signal, FrameAmplitude) else (Product(1.0, (("load", name),)),)


def load_signals(scene: Scene, member: Member) -> dict[str, SignalBase]:
    """Signals of a section's loads over time, by the names of the inputs of the section's full model.

    A load along an axis of the body has one signal.  A force along an axis of the ground has one signal for each of its
    components along the axes of the body.  A component is left out if it is always zero or the model can't move along
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

    Along the boom the rope pulls with the weight divided by the number of its falls.  Simulators that know how the
    payload moves put the rope's forces in their place.  The result is empty without a hoist or without gravity.
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
            signals[pull.load.name] = _frame_amplitude(scene, tuple(products), gravity=gravity.signal)
        else:
            ratio = line + hangs * weight * float(np.dot(pull.lever, gravity.direction))
            signals[pull.load.name] = ScaledSignal(signal=gravity.signal, ratio=ratio, offset=0.0)
    return signals


def hoist_signals(scene: Scene) -> dict[str, SignalBase]:
    """Signals of all that drives the hoist of a scene, by name; empty without a hoist (`pmr.system.terms`)."""
    if scene.hoist is None:
        return {}
    signals = {ROPE: scene.hoist.rope_signal, **scene.hoist.wind_signals}
    if scene.frame is None:
        return signals
    return signals | {
        name: _frame_amplitude(scene, (Product(1.0, (quantity,)),), **_accelerating(scene, 0))
        for name, quantity in frame_quantities(scene).items()
    }


def _ground_force_component(scene: Scene, member: Member, load: Load, part: Direction) -> FrameAmplitude:
    """Component `part` (an axis of the body) of a load along a ground axis."""
    name = input_name(scene.names[member.number], load.name)
    turned = ("turned", "xyz".index(load.direction), "xyz".index(part))
    return _frame_amplitude(scene, (Product(1.0, (turned, ("load", name))),), loads=((name, load.signal),))


def _frame_amplitude(scene: Scene, products: Products, **signals: Any) -> FrameAmplitude:
    """Signal that is the sum of `products` of the quantities of a scene's frame.

    `signals` are the fields of `FrameAmplitude`, other than angles, from which these quantities follow.
    """
    assert scene.frame is not None  # as the checks say
    (luffing, slewing), rocking = scene.frame.angles, scene.frame.base_angles
    about = {"luffing": luffing, "slewing": slewing, "rocking": rocking, "step": scene.time.step}
    return FrameAmplitude(products=products, **about, **signals)


def _accelerating(scene: Scene, number: int) -> dict[str, Any]:
    """Signals other than the frame's angles that accelerate section `number`, as fields of `FrameAmplitude`.

    The keys are ``gravity``, ``base`` and ``paths``.
    """
    return {
        "gravity": scene.gravity.signal if scene.gravity else Constant(amount=0.0),
        "base": base_accelerations(scene),
        "paths": _extensions(scene, number),
    }


def _extensions(scene: Scene, number: int) -> tuple[SignalBase, ...]:
    """Extensions in m of all sections up to section `number`, in their order."""
    return tuple(scene.extension(k) for k in range(1, number + 1))


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


def section_acceleration(scene: Scene, number: int, field: str, factor: float = 1.0) -> FrameAmplitude:
    """Signal of a component `field` of the acceleration field of section `number`, times `factor`."""
    assert scene.frame is not None  # of a scene that has one
    about = _accelerating(scene, number)
    products = field_products(field, number, scene.frame.tail_position, bool(about["base"]), factor)
    return _frame_amplitude(scene, products, **about)


def inertia_loads(scene: Scene, member: Member) -> dict[str, SignalBase]:
    """Amplitudes of the inertia inputs of a section in a frame, by the inputs' names; empty without such inputs."""
    return {
        INERTIA + field: section_acceleration(scene, member.number, field, -1.0) for field in inertia_fields(member)
    }


def term_signals(scene: Scene, which: Iterable[FrameTerm] | None = None) -> dict[str, SignalBase]:
    """Amplitudes of terms (`pmr.scene.mechanism`) by the term's name: of those in `which`, or of all if it is None."""
    return {term.name: _term_signal(scene, term) for term in (frame_terms(scene) if which is None else which)}


def _term_signal(scene: Scene, term: FrameTerm) -> SignalBase:
    """Amplitude of one term of the scene."""
    if term.kind == "field":
        return section_acceleration(scene, term.number, term.component)
    if term.kind == "load":
        return load_signals(scene, member_at(scene, term.number))[term.component]
    if term.kind == "cylinder":
        carried = scene.names.index(term.carried_section)
        return _over_length(scene, section_acceleration(scene, carried, term.component, -1.0), term)
    if term.kind == "cylinder load":
        load = load_signals(scene, member_at(scene, scene.names.index(term.carried_section)))[term.component]
        return _over_length(scene, load, term)
    return _frame_amplitude(scene, rotation_products(term.kind, term.component))


def _over_length(scene: Scene, of: SignalBase, term: FrameTerm) -> FrameAmplitude:
    """Amplitude of the force of a cylinder, the one of `term`, divided by the cylinder's length.

    The force is caused by `of`, which is a load on what the cylinder carries, or an acceleration of what it carries.
    """
    name, over = input_name(term.carried_section, term.component), ("over", term.number)
    products = tuple(product.times(1.0, over) for product in products_of(of, name))
    if not isinstance(of, FrameAmplitude):
        return _frame_amplitude(scene, products, loads=((name, of),), paths=_extensions(scene, term.number))
    return of.model_copy(update={"products": products, "paths": of.paths or _extensions(scene, term.number)})
