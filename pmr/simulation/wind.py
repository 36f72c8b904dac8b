r"""Wind on the sections of a boom: a profile over the height above the ground, as polynomials along each section.

With the pressure q of the wind at the height Z above the ground, and the component e along an axis y or z of a section
of the horizontal unit vector in which the wind blows, the force per length along this axis is

.. math:: w(x) = c\, d\, q(Z(x))\, e\, |e|, \qquad q = q_r(t) \bigl(\max(Z, Z_{least}) / Z_r\bigr)^{2 p}

on the part of the section that is outside of the section around it, and 0 elsewhere.  It is replaced by its projection
on Legendre polynomials of the length L,

.. math:: w \approx \sum_j w_j P_j(2 x / L - 1), \qquad w_j = \frac{2 j + 1}{L} \int w\, P_j(2 x / L - 1)\, dx

which has the same force and the same moment.  The component of the pressure's velocity along the axis of the section
exerts no force.  The motion of the boom itself against the air is left out.
"""

from __future__ import annotations

from functools import lru_cache
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel, ConfigDict

from pmr.files.arrays import Array
from pmr.scene import Scene
from pmr.scene.built import POLYNOMIALS, PRESSED, Load
from pmr.scene.members import Member
from pmr.scene.signals import SignalBase
from pmr.simulation.frame_motion import FrameRotation, FrameSignal

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
    """Amplitude in N/m of one polynomial of the wind on one section, along one of its axes."""

    SAMPLES: ClassVar = 1001

    angles: tuple[SignalBase, ...]  # rad: luffing and slewing, then those of a base that turns
    section: ExposedSection
    azimuth: float  # rad
    factors: tuple[float, float]  # m: shape factor times depth along y and along z
    load: Load  # signal of the pressure in Pa at the reference height, and profile over the height
    above: float  # m: of the pivot above the ground
    axis: str
    degree: int

    @classmethod
    def of_load(cls, scene: Scene, member: Member, load: Load, name: str) -> Self:
        """Amplitude of the input `name` (`pmr.scene.choice.input_directions`) of a load by wind.

        The pivot is as high above the ground as the scene's ground says, unless the load states its own height.
        """
        frame, part, box = scene.frame, member.part, member.part.body.box
        assert frame is not None  # as the checks say
        depths = [load.depth or getattr(box, key) for key in ("height", "width")]
        axis, degree = name.split(" ")[-2:]
        above = load.above or (0.0 if frame.ground is None else frame.ground.height)
        return cls(
            angles=(*frame.angles, *frame.base_angles),
            section=ExposedSection(
                paths=tuple(scene.extension(k) for k in range(1, member.number + 1)),
                pivot=frame.tail_position,
                length=part.length,
                around=scene.sections[member.number - 1].length if member.number else 0.0,
            ),
            azimuth=load.azimuth * (1.0 if frame.unit == "rad" else np.pi / 180.0),
            factors=(load.shape * depths[0], load.shape * depths[1]),
            load=load,
            above=above,
            axis=axis,
            degree=int(degree),
            step=scene.time.step,
        )

    @property
    def signals(self) -> tuple[SignalBase, ...]:
        return (self.load.signal, *self.angles, *self.section.paths)

    def value(self, t: ArrayLike) -> Array:
        at = np.asarray(t, float)
        of_all = self.model_copy(update={"axis": "y", "degree": 0})
        amplitudes = _amplitudes(of_all, at.ravel().tobytes())
        return np.asarray(amplitudes[PRESSED.index(self.axis), self.degree].reshape(at.shape))

    def highest_frequency(self, start: float, end: float) -> float:
        """Sum of the highest frequencies in Hz of pressure, angles and extensions from `start` to `end` in s."""
        return sum(signal.highest_frequency(start, end) for signal in self.signals)


@lru_cache(maxsize=8)
def _amplitudes(wind: WindOnSection, t: bytes) -> Array:
    """Amplitudes (2, `POLYNOMIALS`, T) in N/m of all polynomials of the wind along y and z, at T times.

    `t` holds the times in s as the bytes of an array.
    """
    times, section, load = np.frombuffer(t), wind.section, wind.load
    luffing, slewing, *rocking = wind.angles
    turning = FrameRotation.from_signals(luffing, slewing, times, rocking)
    blown = turning.rotation[:, 0] * np.cos(wind.azimuth) + turning.rotation[:, 1] * np.sin(wind.azimuth)
    up, extensions = turning.up, [path.value(times) for path in section.paths]
    tail = wind.above + up @ np.array(section.pivot) + up[:, 0] * np.sum([np.zeros(len(times)), *extensions], axis=0)
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
