r"""Motion of a boom's frame, prescribed or computed, and the amplitudes of loads and terms that follow from it.

First, accelerations of sections along the boom, from their extensions.  Second, amplitudes c of loads and terms as
sums over products n, each a number :math:`\kappa_n` times few quantities x_k,

.. math:: c(t) = \sum_n \kappa_n \prod_{k \in n} x_k(t)

so that a run, which evaluates them at many times, a stepper in a user's loop (`pmr.simulation.moving`) and the C source
of an FMU all use the same lists.  Third, the computed motion of a machine, as signals of a frame's base.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import SkipValidation

from pmr.files.arrays import Array
from pmr.kernel.further import Product, Products, Quantity
from pmr.scene import Scene
from pmr.scene.cylinder import Oil
from pmr.scene.frame import DIRECTIONS, BaseMotion
from pmr.scene.signals import Constant, SignalBase
from pmr.scene.signals.base import Floats, Interval, Strand


class Derived(SignalBase):
    """A scalar signal that follows from other signals; its rate is a difference quotient over one step."""

    step: float  # s

    @property
    @abstractmethod
    def signals(self) -> tuple[SignalBase, ...]:
        """Signals from which this one follows."""

    def rate(self, t: ArrayLike) -> Array:
        """Difference quotient over a step around the times t (any shape) in s, in the shape of t.

        The step is from t - h/2, but at least 0, to t + h/2.
        """
        t, half = np.asarray(t, float), self.step / 2.0
        before = np.maximum(t - half, 0.0)
        return np.asarray((self.value(t + half) - self.value(before)) / (t + half - before))

    def on_steps(self, step: float) -> Self:
        """Return the signal with difference quotients over a step of `step` s."""
        return self.model_copy(update={"step": step})

    @property
    def breaks(self) -> Floats:
        """Times in s of the breaks of all signals from which this signal follows, ascending."""
        return tuple(sorted({b for signal in self.signals for b in signal.breaks}))


class FrameSignal(Derived):
    """A signal that follows from the frame's angles and from paths, which are extensions of sections."""

    SAMPLES: ClassVar = 10_001  #: number of samples among which the smallest and largest value are searched

    def highest_frequency(self, start: float, end: float) -> float:
        """Twice the highest frequency in Hz of angles and paths from `start` to `end` in s.

        Their rates enter as squares and products.
        """
        return 2.0 * max(signal.highest_frequency(start, end) for signal in self.signals)

    def bounds(self, start: float, end: float) -> Interval:
        """Smallest and largest value among `SAMPLES` samples from `start` to `end`, and at the breaks in between."""
        breaks = [b for b in self.breaks if start <= b <= end]
        values = self.value(np.append(np.linspace(start, end, self.SAMPLES), breaks))
        return Interval(float(values.min()), float(values.max()))


class Acceleration(Derived):
    r"""Second derivative a in m/s^2 of the sum s of paths, averaged over a step of h, so that a kink acts over a step.

    .. math:: a(t) = \big(\dot s(t + h/2) - \dot s(t - h/2)\big) / h

    Paths are not evaluated before t = 0: the difference then begins at 0.  A path that moves at t = 0 has no kink
    there.
    """

    paths: tuple[SignalBase, ...]

    @property
    def signals(self) -> tuple[SignalBase, ...]:
        """The paths."""
        return self.paths

    def value(self, t: ArrayLike) -> Array:
        """Acceleration in m/s^2 at the times t (any shape) in s, in the shape of t."""
        t, half = np.asarray(t, float), self.step / 2.0
        before = np.maximum(t - half, 0.0)
        changes = [path.rate(t + half) - path.rate(before) for path in self.paths]
        return np.asarray(np.sum(changes, axis=0) / (t + half - before))

    @property
    def strands(self) -> tuple[Strand, ...]:
        """Pieces of the paths for the kernel, with the step over which the kernel takes the difference of rates."""
        return tuple(replace(strand, spread=self.step) for path in self.paths for strand in path.strands)


def evaluate(products: Products, quantity: Callable[[Quantity], Array], t: Array) -> Array:
    """Sum (T,) of products at the times t (T,) in s; the function `quantity` returns the values (T,) of a quantity."""
    total = np.zeros_like(t)
    for product in products:
        part = np.full_like(t, product.factor)
        for quantity_of_product in product.of:
            part *= quantity(quantity_of_product)
        total += part
    return total


def field_products(field: str, number: int, pivot: Sequence[float], shaken: bool, factor: float) -> Products:
    r"""Products whose sum is one component of the acceleration field of section `number`, times `factor`.

    The frame of the boom has the unit vectors :math:`e_x`, :math:`e_y` and :math:`e_z` along its axes and the angular
    velocity :math:`\omega`; the accelerations of its points change from point to point by the gradient A.  The pivot is
    displaced by u, g is the acceleration of gravity and :math:`e_Z` points vertically upwards.  The vector p, the
    argument `pivot`, goes from the pivot to the tail of the base section, and the tail of section `number` is the
    distance X ahead of it along x.  The acceleration of this tail, with that of gravity, is

    .. math:: g\, e_Z + \ddot u + \ddot X e_x + 2\, \omega \times \dot X e_x + A\, (p + X e_x)

    `field` is ``x``, ``y`` or ``z`` for the component of this vector along the axis, or two axes such as ``xz`` for the
    component A_xz of the gradient.  The acceleration of the pivot is left out unless `shaken`.  A product is a number
    times quantities such as an angular velocity, by their names (`Quantity`).
    """
    along = "xyz".index(field[0])
    if len(field) == 2:
        return (Product(factor, (("gradient", along, "xyz".index(field[1])),)),)
    products = [Product(factor, (("gravity",), ("turned", 2, along)))]
    products += [Product(factor * at, (("gradient", along, k),)) for k, at in enumerate(pivot) if at]
    if shaken:
        products += [Product(factor, (("turned", axis, along), ("shaken", axis))) for axis in range(3)]
    if number:
        products.append(Product(factor, (("gradient", along, 0), ("reach", number, 0))))
        across = (None, (2, 1.0), (1, -1.0))[along]  # component of the angular velocity in the cross product with e_x
        if across is None:
            products.append(Product(factor, (("reach", number, 2),)))
        else:
            products.append(Product(2.0 * across[1] * factor, (("velocity", across[0]), ("reach", number, 1))))
    return tuple(products)


def rotation_products(effect: str, component: str) -> Products:
    """Products of the frame's angular velocity and acceleration whose sum is the amplitude of an inertia effect.

    The `component` names one axis j, such as ``y``, or two axes j and k, such as ``xy``.  With the frame's angular
    velocity w, the amplitude is 2 w_j for the `effect` ``rotation``, and the angular acceleration along j for
    ``turning``.  For ``carried`` it is 2 w_j w_k with j != k, and w_j^2 - w . w with j = k.
    """
    first, last = "xyz".index(component[0]), "xyz".index(component[-1])
    if effect == "rotation":
        return (Product(2.0, (("velocity", first),)),)
    if effect == "turning":
        return (Product(1.0, (("turning", first),)),)
    if first != last:
        return (Product(2.0, (("velocity", first), ("velocity", last))),)
    return tuple(Product(-1.0, (("velocity", k), ("velocity", k))) for k in range(3) if k != first)


#: Share of a step within which a time counts as the time of a step.
SAME = 1e-6
#: (6, 6): value, h rate and h^2 second rate at the beginning and the end of a step of h, for each power x^k of t / h.
_ENDS = np.array([[1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0], [0, 0, 2, 0, 0, 0], [1] * 6, range(6), [0, 0, 2, 6, 12, 20]])
_QUINTIC = np.linalg.inv(_ENDS.astype(float))


@dataclass(frozen=True, eq=False)
class MotionSamples:
    """Computed motion of one direction of a machine, of a luffing angle, or of an extension.

    The N `times` are t = 0 and the ends of all T - 1 steps, or of all parts if steps are divided into parts.  Two
    objects are never equal, even with the same values.
    """

    times: Array  # (N,) s
    values: Array  # (3, N): motion in m or rad, its rate and its second rate
    # (T,) N or N m: force or moment of the machine on the ground in this direction; zero for an angle or extension
    force: Array
    inputs: Mapping[str, Array]  # (N,) values of the inertia inputs of the boom, by input name
    cylinder: Mapping[str, Array] = field(default_factory=dict)  # (T,) of the cylinder that drives it, by name
    parts: tuple[int, ...] = ()  # (T - 1,): number of parts of each step; empty: no step was divided
    oil: Oil | None = None  # in the cylinder that drives an extension


class ComputedMotion(SignalBase):
    """Computed motion of a machine, luffing angle or extension as a signal, in m or the unit of the frame's angles.

    Between two samples it is the polynomial of degree 5 with the values, rates and second rates of both.  Before the
    first and after the last sample, value, rate and second rate are those of this sample.
    """

    samples: SkipValidation[Any]
    unit: float  # factor on the samples: number of units in 1 m or 1 rad

    def bounds(self, start: float, end: float) -> Interval:
        """Smallest and largest value of the samples from `start` to `end` in s and of the nearest around these."""
        of: MotionSamples = self.samples
        first, last = np.searchsorted(of.times, start, "right") - 1, np.searchsorted(of.times, end)
        some = of.values[0, max(first, 0) : last + 1] * self.unit
        return Interval(float(some.min()), float(some.max()))

    def _derivative(self, t: ArrayLike, order: int) -> Array:
        """Value (`order` 0), rate (1) or second rate (2) at the times t (any shape) in s, in the shape of t."""
        of: MotionSamples = self.samples
        at = np.clip(np.asarray(t, float), of.times[0], of.times[-1])
        k = np.clip(np.searchsorted(of.times, at, "right") - 1, 0, len(of.times) - 2)
        h = of.times[k + 1] - of.times[k]
        x = (at - of.times[k]) / h
        values = np.asarray(of.values[order][k + np.rint(x).astype(int)])
        between = np.abs(x - np.rint(x)) > SAME
        if between.any():
            scale = h ** np.arange(3).reshape(3, *[1] * h.ndim)
            ends = np.concatenate([of.values[:, k] * scale, of.values[:, k + 1] * scale])
            c = np.moveaxis(np.tensordot(_QUINTIC, ends, 1), 0, -1)
            factor = np.array([np.prod(np.arange(p, p - order, -1)) for p in range(order, 6)])
            powers = x[..., None] ** np.arange(6 - order)
            values = np.where(between, (c[..., order:] * factor * powers).sum(axis=-1) / h**order, values)
        return np.asarray(values * self.unit)


class ComputedInput(SignalBase):
    """Samples of an input, connected by straight lines."""

    samples: SkipValidation[Any]
    name: str

    def value(self, t: ArrayLike) -> Array:
        """Value at the times t (any shape) in s, on the line between two samples, in the shape of t.

        Before the first and after the last sample, it is the value of this sample.
        """
        of: MotionSamples = self.samples
        return np.asarray(np.interp(np.asarray(t, float), of.times, of.inputs[self.name]))

    def rate(self, t: ArrayLike) -> Array:
        """Slope of the line at the times t (any shape) in s, in the shape of t; at a sample, of the line after it.

        Before the first and after the last sample, it is the slope of the nearest line.
        """
        of: MotionSamples = self.samples
        lengths = np.diff(of.times)
        k = np.searchsorted(of.times, np.asarray(t, float) + SAME * lengths.min(), "right") - 1
        k = np.clip(k, 0, len(lengths) - 1)
        return np.asarray(np.diff(of.inputs[self.name])[k] / lengths[k])

    def bounds(self, start: float, end: float) -> Interval:
        """Smallest and largest of all samples; `start` and `end` have no effect."""
        values = self.samples.inputs[self.name]
        return Interval(float(values.min()), float(values.max()))


def computed_inputs(scene: Scene) -> dict[str, SignalBase]:
    """Signals of a boom's inertia inputs, by name, if a motion of the scene has been computed; otherwise an empty dict.

    The motion is that of a machine, of a luffing angle or of an extension.  The signals agree with the frame's
    accelerations averaged over a step; the accelerations at the ends of steps are not used.  Generalized-alpha leaves
    in the accelerations at the ends of steps an undamped part that alternates from step to step.  This part must not be
    multiplied by quantities that change from step to step.
    """
    frame = scene.frame
    if frame is None:
        return {}
    signals = (frame.luffing_signal, *(frame.base.motions if frame.base else {}).values(), *scene.paths.values())
    samples = next((signal.samples for signal in signals if isinstance(signal, ComputedMotion)), None)
    return {} if samples is None else {name: ComputedInput(samples=samples, name=name) for name in samples.inputs}


def hold_computed_motions(scene: Scene) -> Scene:
    """Scene in which motions that were computed rest where they are at t = 0; the scene itself if there are none.

    A machine whose directions are all held has none.
    """
    if not computed_inputs(scene):
        return scene

    def still(signal: SignalBase) -> SignalBase:
        """Return a constant for a computed motion, and any other signal as it is."""
        return Constant(amount=float(signal.value(0.0))) if isinstance(signal, ComputedMotion) else signal

    frame, sections = scene.present_frame, list(scene.sections)
    held: dict[str, Any] = {} if frame.luffing_signal is None else {"luffing": still(frame.luffing_signal)}
    if frame.base is not None:
        held["base"] = {direction: still(signal) for direction, signal in frame.base.motions.items()}
    for k, part in enumerate(sections):
        extension: object = getattr(part.joint, "extension", None)
        if isinstance(extension, ComputedMotion):
            sections[k] = part.with_keys(joint={"extension": still(extension)})
    return scene.with_keys(frame=held, sections=tuple(sections))


def has_computed_motion(scene: Scene) -> bool:
    """Whether a motion of the scene is or will be computed with the model: of a machine, luffing angle or extension.

    A machine whose directions are all held does not count.
    """
    machine, free = (None, False) if scene.frame is None else (scene.frame.machine, scene.frame.luffing == "free")
    free = free or bool(scene.free_extensions)
    return bool(computed_inputs(scene)) or free or (machine is not None and bool(machine.free))


@dataclass(frozen=True)
class MachineMotion:
    """Motion of a machine at T steps, in the directions x, y, z of the pivot (m), roll, pitch and yaw (rad)."""

    step: float  # s
    values: Array  # (3, T, 6): motions, their rates and their second rates
    forces: Array  # (T, 6) N and N m: forces and moments on the ground, by springs, dampers and held directions
    inputs: Mapping[str, Array]  # (T,) values of inertia inputs by name; empty if no direction is free
    momenta: Array  # (T, 6): linear and angular momentum of machine and boom about the ground's origin


def with_computed_motion(scene: Scene, track: MachineMotion) -> Scene:
    """Scene whose frame has a base with the computed motion `track` in place of its former base, and no machine."""
    angle, times = scene.present_frame.radian, track.step * np.arange(track.values.shape[1])
    signals: dict[str, Any] = {
        direction: ComputedMotion(
            samples=MotionSamples(times, np.ascontiguousarray(track.values[:, :, k]), track.forces[:, k], track.inputs),
            unit=1.0 if k < 3 else angle,
        )
        for k, direction in enumerate(DIRECTIONS)
    }
    base = BaseMotion.model_construct(**signals)
    return scene.with_keys(frame={"base": base, "machine": None})
