r"""How a frame that moves accelerates the sections of a boom, as amplitudes of constant fields.

With the tail of a section at X on the boom's axis, the base's tail at p from the pivot, and the vertical e_Z,

.. math::
    a(r) = g\, e_Z + \ddot u + \ddot X e_x + 2\, \omega \times \dot X e_x + A\, (p + X e_x + r), \qquad
    A = \tilde\alpha + \tilde\omega \tilde\omega

with u'' the pivot's own acceleration where its base moves, is what a body has to be accelerated by to stay at rest in
the frame, its weight included: a constant, and A, for each r_k along e_j.  Loads are minus these.  The axes are those
of `pmr.scene.frame`.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pmr.scene import Scene
from pmr.scene.built import Load
from pmr.scene.choice import inertia_fields, parts_of
from pmr.scene.frame import INERTIA, Frame, rotation
from pmr.scene.frame_terms import FrameTerm, frame_terms
from pmr.scene.joints import Linear
from pmr.scene.members import Member, member_at
from pmr.scene.section import Direction
from pmr.scene.signals import Constant, SignalBase
from pmr.scene.signals.base import Floats
from pmr.simulation.acceleration import Acceleration

Array = NDArray[np.float64]
#: In which the least and the largest amplitude are looked for.
SAMPLES = 10_001


@dataclass(frozen=True)
class Turning:
    """Angular velocity (T, 3) in rad/s and acceleration (T, 3) of the frame in its axes, and its rotation (T, 3, 3)."""

    velocity: Array
    acceleration: Array
    rotation: Array  # from its axes into those of the ground

    @classmethod
    def of(cls, luffing: SignalBase, slewing: SignalBase, t: Array, rocking: Sequence[SignalBase] = ()) -> Turning:
        """At the times t (T,) s, on a base that rolls, pitches and yaws by `rocking`, or keeps its direction."""
        own = cls._on_base(luffing, slewing, t)
        if not rocking:
            return own
        base = _rocked(rocking, t)
        velocity, acceleration = (
            np.einsum("tji,tj->ti", own.rotation, one) for one in (base.velocity, base.acceleration)
        )
        return cls(
            velocity + own.velocity,
            acceleration + np.cross(velocity, own.velocity) + own.acceleration,
            base.rotation @ own.rotation,
        )

    @classmethod
    def _on_base(cls, luffing: SignalBase, slewing: SignalBase, t: Array) -> Turning:
        phi, rise, second = luffing.value(t), luffing.rate(t), luffing.second_rate(t)
        turn, faster = slewing.rate(t), slewing.second_rate(t)
        sine, cosine = np.sin(phi), np.cos(phi)
        return cls(
            np.stack([turn * sine, -rise, turn * cosine], axis=-1),
            np.stack(
                [faster * sine + turn * rise * cosine, -second, faster * cosine - turn * rise * sine],
                axis=-1,
            ),
            rotation(phi, slewing.value(t)),
        )

    @property
    def up(self) -> Array:
        """The vertical (T, 3), in its axes."""
        return self.rotation[:, 2]

    @cached_property
    def gradient(self) -> Array:
        """A (T, 3, 3) in 1/s^2."""
        spin = _crossing(self.velocity)
        return _crossing(self.acceleration) + spin @ spin


def _rocked(rocking: Sequence[SignalBase], t: Array) -> Turning:
    """A base that rolls by a, pitches by b and yaws by c, :math:`R_Z(c) R_Y(b) R_X(a)`, in its own axes."""
    (a, b, c), (a1, b1, c1), (a2, b2, c2) = (
        [getattr(angle, what)(t) for angle in rocking] for what in ("value", "rate", "second_rate")
    )
    (ca, sa), (cb, sb) = ((np.cos(angle), np.sin(angle)) for angle in (a, b))
    velocity = np.stack([a1 - c1 * sb, b1 * ca + c1 * sa * cb, c1 * ca * cb - b1 * sa], axis=-1)
    acceleration = np.stack(
        [
            a2 - c2 * sb - c1 * b1 * cb,
            b2 * ca - b1 * a1 * sa + c2 * sa * cb + c1 * a1 * ca * cb - c1 * b1 * sa * sb,
            c2 * ca * cb - c1 * a1 * sa * cb - c1 * b1 * ca * sb - b2 * sa - b1 * a1 * ca,
        ],
        axis=-1,
    )
    one, none = np.ones_like(a), np.zeros_like(a)
    roll = np.moveaxis(np.array([[one, none, none], [none, ca, -sa], [none, sa, ca]]), -1, 0)
    return Turning(velocity, acceleration, rotation(-b, c) @ roll)


def _crossing(vectors: Array) -> Array:
    """Matrices (T, 3, 3) whose product with r is v x r."""
    x, y, z = vectors.T
    none = np.zeros_like(x)
    return np.stack([none, -z, y, z, none, -x, -y, x, none], axis=-1).reshape(-1, 3, 3)


@lru_cache(maxsize=2)
def _turning(luffing: SignalBase, slewing: SignalBase, t: bytes, rocking: tuple[SignalBase, ...]) -> Turning:
    """`Turning.of` at times that are asked for again and again, for each field of each section."""
    return Turning.of(luffing, slewing, np.frombuffer(t), rocking)


class OfFrame(SignalBase):
    """A scalar that follows from the frame's angles and paths; by differences where its rate is asked for."""

    step: float  # s, over which kinks of paths are spread

    @property
    @abstractmethod
    def signals(self) -> tuple[SignalBase, ...]:
        """What it follows from."""

    def rate(self, t: ArrayLike) -> Array:
        t, half = np.asarray(t, float), self.step / 2.0
        before = np.maximum(t - half, 0.0)
        return np.asarray((self.value(t + half) - self.value(before)) / (t + half - before))

    def on_steps(self, step: float) -> Self:
        return self.model_copy(update={"step": step})

    @property
    def breaks(self) -> Floats:
        return tuple(sorted({b for signal in self.signals for b in signal.breaks}))

    def highest_frequency(self, start: float, end: float) -> float:
        """Twice that of angles and paths: rates are squared, and turn what they multiply."""
        return 2.0 * max(signal.highest_frequency(start, end) for signal in self.signals)

    def bounds(self, start: float, end: float) -> tuple[float, float]:
        """Sampled."""
        values = self.value(np.append(np.linspace(start, end, SAMPLES), [b for b in self.breaks if start <= b <= end]))
        return float(values.min()), float(values.max())


class OfAngles(OfFrame):
    """What follows from the frame's angles, those of its base among them."""

    luffing: SignalBase
    slewing: SignalBase
    rocking: tuple[SignalBase, ...] = ()

    @property
    def signals(self) -> tuple[SignalBase, ...]:
        return (self.luffing, self.slewing, *self.rocking)

    def turning(self, t: Array) -> Turning:
        """At the times t (T,) s."""
        return _turning(self.luffing, self.slewing, t.tobytes(), self.rocking)


class Shaken(OfFrame):
    """How a base is accelerated along an axis of the ground, m/s^2: by its displacement, and as it is given."""

    displacement: SignalBase  # m
    given: SignalBase  # m/s^2

    @property
    def signals(self) -> tuple[SignalBase, ...]:
        return (self.displacement, self.given)

    def value(self, t: ArrayLike) -> Array:
        return np.asarray(self.displacement.second_rate(t) + self.given.value(t))


class Motion(OfAngles):
    """A component of the acceleration field of a section."""

    gravity: SignalBase  # m/s^2
    pivot: tuple[float, float, float]  # m: the base's tail from the pivot
    paths: tuple[SignalBase, ...]  # whose sum is X
    base: tuple[SignalBase, ...] = ()  # m/s^2: accelerations of the pivot along axes of the ground, if it moves
    field: str  # ``x`` of the constant part, ``xz`` of A_xz
    factor: float = 1.0

    @property
    def signals(self) -> tuple[SignalBase, ...]:
        return (*super().signals, self.gravity, *self.paths, *self.base)

    def value(self, t: ArrayLike) -> Array:
        at = np.asarray(t, float)
        return (self.factor * self._component(at.ravel())).reshape(at.shape)

    def _component(self, t: Array) -> Array:
        turning, along = self.turning(t), "xyz".index(self.field[0])
        if len(self.field) == 2:
            return np.asarray(turning.gradient[:, along, "xyz".index(self.field[1])])
        place = np.array(self.pivot) + self._sum(t, "value")[:, None] * np.eye(3)[0]
        speed = self._sum(t, "rate")
        _, y, z = turning.velocity.T
        across = (np.zeros_like(y), z, -y)[along]  # of the angular velocity x e_x
        found = self.gravity.value(t) * turning.up[:, along] + 2.0 * across * speed
        found += np.einsum("tk,tk->t", turning.gradient[:, along], place)
        for axis, acceleration in enumerate(self.base):
            found += turning.rotation[:, axis, along] * acceleration.value(t)
        if along == 0 and self.paths:
            found += Acceleration(paths=self.paths, step=self.step).value(t)
        return np.asarray(found)

    def highest_frequency(self, start: float, end: float) -> float:
        """Of angles and paths twice theirs; what shakes the base is turned with the frame."""
        of_angles = super().signals
        slow, shaken = (
            max((one.highest_frequency(start, end) for one in signals), default=0.0)
            for signals in ((*of_angles, self.gravity, *self.paths), self.base)
        )
        return max(2.0 * slow, shaken + slow if shaken else 0.0)

    def _sum(self, t: Array, what: str) -> Array:
        return np.sum([np.zeros_like(t), *(getattr(path, what)(t) for path in self.paths)], axis=0)


class Rotation(OfAngles):
    """What the small motion of a body feels of the frame's rotation: twice a velocity, an acceleration, or A."""

    of: str  # `rotation`, `turning` or `carried`, as `pmr.scene.frame_terms` says
    component: str

    def value(self, t: ArrayLike) -> Array:
        at = np.asarray(t, float)
        turning = self.turning(at.ravel())
        along = ["xyz".index(k) for k in self.component]
        if self.of == "carried":
            same = along[0] == along[1]
            product = np.prod(turning.velocity[:, along], axis=1)
            found = product - np.sum(turning.velocity**2, axis=1) if same else 2.0 * product
        else:
            found = {"rotation": 2.0 * turning.velocity, "turning": turning.acceleration}[self.of][:, along[0]]
        return np.asarray(found).reshape(at.shape)


class Pushed(OfFrame):
    """What a cylinder pushes with, over its length: minus an acceleration, or a load against it, over an extension."""

    acceleration: SignalBase
    length: SignalBase

    @property
    def signals(self) -> tuple[SignalBase, ...]:
        return (self.acceleration, self.length)

    def on_steps(self, step: float) -> Self:
        return self.model_copy(update={"step": step, "acceleration": self.acceleration.on_steps(step)})

    def value(self, t: ArrayLike) -> Array:
        return np.asarray(-self.acceleration.value(t) / self.length.value(t))


class AlongGround(OfAngles):
    """The part along an axis of the body of a force along an axis of the ground."""

    force: SignalBase
    along: Literal["x", "y", "z"]  # the axis of the ground
    part: Literal["x", "y", "z"]  # that of the body

    @property
    def signals(self) -> tuple[SignalBase, ...]:
        return (*super().signals, self.force)

    def value(self, t: ArrayLike) -> Array:
        at = np.asarray(t, float)
        turned = self.turning(at.ravel()).rotation
        part = turned[:, "xyz".index(self.along), "xyz".index(self.part)].reshape(at.shape)
        return np.asarray(part * self.force.value(at))

    def highest_frequency(self, start: float, end: float) -> float:
        """That of the force and of what turns it."""
        return sum(signal.highest_frequency(start, end) for signal in self.signals)


def load_signals(scene: Scene, member: Member) -> dict[str, SignalBase]:
    """What drives the inputs of a body's loads, by their names."""
    found = dict[str, SignalBase]()
    for load in member.part.loads:
        for name, part in parts_of(member, load).items():
            found[name] = load.signal if load.axes == "body" else _along_ground(scene, load, part)
    return found


def _along_ground(scene: Scene, load: Load, part: Direction) -> AlongGround:
    assert scene.frame is not None  # as the checks say
    about = {"along": load.direction, "part": part, "step": scene.time.step}
    return AlongGround(force=load.signal, **_angles(scene.frame), **about)


def _angles(frame: Frame) -> dict[str, Any]:
    luffing, slewing = frame.angles
    return {"luffing": luffing, "slewing": slewing, "rocking": frame.rocking}


def base_accelerations(scene: Scene) -> tuple[SignalBase, ...]:
    """Of the pivot along X, Y and Z of the ground, m/s^2; none where it stays."""
    base, none = scene.frame.base if scene.frame else None, Constant(amount=0.0)
    if base is None or not {"x", "y", "z"} & {*base.motions, *base.accelerations}:
        return ()
    return tuple(
        Shaken(
            displacement=base.motions.get(axis, none), given=base.accelerations.get(axis, none), step=scene.time.step
        )
        for axis in "xyz"
    )


def motion_of(scene: Scene, number: int, field: str, factor: float = 1.0) -> Motion:
    """A component of the acceleration field of the section with that number."""
    frame = scene.frame
    assert frame is not None  # of a scene that has one
    return Motion(
        **_angles(frame),
        base=base_accelerations(scene),
        gravity=scene.gravity.signal if scene.gravity else Constant(amount=0.0),
        pivot=frame.place,
        paths=tuple(scene.extension(k) for k in range(1, number + 1)),
        step=scene.time.step,
        field=field,
        factor=factor,
    )


def inertia_loads(scene: Scene, member: Member) -> dict[str, SignalBase]:
    """Amplitudes of the inputs by which the frame accelerates a body, by their names; none where it stands still."""
    return {INERTIA + field: motion_of(scene, member.number, field, -1.0) for field in inertia_fields(member)}


def term_signals(scene: Scene, which: Iterable[FrameTerm] | None = None) -> dict[str, SignalBase]:
    """What the terms of `pmr.scene.frame_terms` are multiplied with, by their names: all of the scene's, or `which`."""
    return {term.name: _signal(scene, term) for term in (frame_terms(scene) if which is None else which)}


def _signal(scene: Scene, term: FrameTerm) -> SignalBase:
    assert scene.frame is not None  # of a scene that has terms
    if term.of == "field":
        return motion_of(scene, term.number, term.component)
    if term.of == "load":
        return load_signals(scene, member_at(scene, term.number))[term.component]
    if term.of == "cylinder":
        carried = motion_of(scene, scene.names.index(term.carried), term.component)
        return Pushed(acceleration=carried, length=scene.extension(term.number), step=scene.time.step)
    if term.of == "cylinder load":
        load = load_signals(scene, member_at(scene, scene.names.index(term.carried)))[term.component]
        against = Linear(signal=load, ratio=-1.0, offset=0.0)
        return Pushed(acceleration=against, length=scene.extension(term.number), step=scene.time.step)
    about = {"of": term.of, "component": term.component, "step": scene.time.step}
    return Rotation(**_angles(scene.frame), **about)
