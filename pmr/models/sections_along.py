"""The sections of a beam along its axis: one, or one after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pmr.models.profile_section import MidLine, section_of
from pmr.scene.box import Box, Stretch
from pmr.scene.profile import BoxProfile
from pmr.scene.structures import Beam3DBody, BeamSection

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class SectionsAlong:
    """Places and properties of K sections one after the other; moments are along principal axes."""

    ends: Array  # (K + 1,) m: where each begins, and the last one ends
    each: tuple[BeamSection, ...]
    stretches: tuple[Stretch | None, ...]  # with the profiles that they are of, where they are known
    poisson: float = 0.3  # of the material, which shear areas depend on

    def at(self, places: Array | float) -> Indices:
        """Numbers of the sections at places along the axis, (k,); where one ends those that begin there."""
        return np.clip(np.searchsorted(self.ends, places, side="right") - 1, 0, len(self.each) - 1)

    def profile_at(self, x: float) -> BoxProfile | None:
        """At a place along the axis in m; None where it is not known."""
        stretch = self.stretches[int(self.at(x))]
        return None if stretch is None else stretch.at(x)

    def middle_at(self, x: float) -> Array:
        """Middle of the walls' line at x, (2,) m, where a shell has the mean of its end; without a profile the axis."""
        number = int(self.at(x))
        middle, stretch = self._middles[number], self.stretches[number]
        if middle is None:
            assert stretch is not None
            return MidLine(stretch.at(x)).middle
        return middle

    @cached_property
    def _middles(self) -> tuple[Array | None, ...]:
        """Middle of the walls' line of each section; None where it varies along the section."""
        return tuple(
            np.zeros(2) if stretch is None else MidLine(stretch.first).middle if stretch.first is stretch.last else None
            for stretch in self.stretches
        )

    @cached_property
    def area(self) -> Array:
        """(K,) m^2."""
        return np.array([section.area for section in self.each])

    @cached_property
    def torsion_constant(self) -> Array:
        """(K,) m^4."""
        return np.array([section.torsion_constant for section in self.each])

    @cached_property
    def polar_moment(self) -> Array:
        """(K,) m^4."""
        return np.array([section.polar_moment for section in self.each])

    @cached_property
    def centroid(self) -> Array:
        """(K, 2) m."""
        return np.array([section.centroid for section in self.each])

    @cached_property
    def shear_centre(self) -> Array:
        """(K, 2) m."""
        return np.array([section.shear_centre for section in self.each])

    @property
    def turned(self) -> bool:
        """Whether principal axes of any section are turned against y and z."""
        return any(section.product_of_inertia != 0.0 for section in self.each)

    @cached_property
    def principal(self) -> Array:
        """R (K, 2, 2): principal axes as rows, no farther from y and z than half a right angle."""
        return np.array([_principal(section) for section in self.each])

    @cached_property
    def second_moments(self) -> Array:
        """About the centroid, along the principal axes, (K, 2) m^4."""
        tensors = np.array(
            [
                [
                    [section.second_moment_z, section.product_of_inertia],
                    [section.product_of_inertia, section.second_moment_y],
                ]
                for section in self.each
            ]
        )
        return np.einsum("kij,kjl,kil->ki", self.principal, tensors, self.principal)

    @cached_property
    def shear_areas(self) -> Array | None:
        """Along the principal axes, (K, 2) m^2; None where one is unknown."""
        areas = [(section.shear_area_y, section.shear_area_z) for section in self.each]
        if any(None in pair for pair in areas):
            return None
        return 1.0 / np.einsum("kij,kj,kij->ki", self.principal, 1.0 / np.array(areas, float), self.principal)

    @cached_property
    def own_motion(self) -> Array:
        """(K, 6, 6): u_c, v_s, w_s, phi and rotations about the principal axes from the motion of the axis."""
        motion = about_own_centres(self)
        motion[:, 1:3], motion[:, 4:] = self.principal @ motion[:, 1:3], self.principal @ motion[:, 4:]
        return motion


def about_own_centres(sections: SectionsAlong) -> Array:
    """(K, 6, 6): u of the centroid, v and w of the shear centre, and rotations, from the motion of the axis."""
    motion = np.tile(np.eye(6), (len(sections.each), 1, 1))
    motion[:, 0, 4], motion[:, 0, 5] = sections.centroid[:, 1], -sections.centroid[:, 0]
    motion[:, 1, 3], motion[:, 2, 3] = -sections.shear_centre[:, 1], sections.shear_centre[:, 0]
    return motion


def sections_of(body: Beam3DBody, stations: Array, box: Box | None = None) -> SectionsAlong:
    """Sections of a beam with nodes at the stations (N,) m: one, or of a box that varies one of each of its parts.

    Where it changes from place to place a part is an element.
    """
    poisson = body.material.poisson
    if body.profile is None:
        assert body.section is not None  # one of the two is given
        return SectionsAlong(np.array([0.0, body.length]), (body.section,), (None,), poisson)
    stretch_of_all = [Stretch(0.0, body.length, body.profile, body.profile)]
    parts = [
        stretch.part(a, b)
        for stretch in (stretch_of_all if box is None else box.stretches)
        for a, b in pairwise([stretch.start, *_inner_nodes(stretch, stations), stretch.end])
    ]
    ends = np.array([0.0, *(part.end for part in parts)])
    return SectionsAlong(ends, tuple(mean_section(part, poisson) for part in parts), tuple(parts), poisson)


def mean_section(stretch: Stretch, poisson: float) -> BeamSection:
    """Means of a stretch's properties, by Gauss' rule: of the area exact, as it changes with the square of x."""
    if stretch.first is stretch.last:
        return section_of(stretch.first, poisson)
    x, w = np.polynomial.legendre.leggauss(3)
    places = stretch.start + (stretch.end - stretch.start) * (x + 1.0) / 2.0
    sections = [section_of(stretch.at(float(at)), poisson).model_dump() for at in places]
    mean = {key: w / 2.0 @ np.array([section[key] for section in sections]) for key in sections[0]}
    return BeamSection(**{key: tuple(value.tolist()) if value.ndim else float(value) for key, value in mean.items()})


def _inner_nodes(stretch: Stretch, stations: Array) -> list[float]:
    """Nodes within a stretch that changes from place to place."""
    inside = (stations > stretch.start) & (stations < stretch.end) & (stretch.first is not stretch.last)
    return [float(at) for at in stations[inside]]


def stations_of(breaks: Sequence[float], elements: int) -> Array:
    """Nodes of a beam of about so many elements, one at each of the breaks at least, in between evenly spaced, m."""
    parts = [np.array(breaks[:1])]
    for a, b in zip(breaks[:-1], breaks[1:], strict=True):
        count = max(1, round(elements * (b - a) / (breaks[-1] - breaks[0])))
        parts.append(a + (b - a) * (np.arange(1, count + 1) / count))
    return np.concatenate(parts)


def _principal(section: BeamSection) -> Array:
    if section.product_of_inertia == 0.0:
        return np.eye(2)
    difference = section.second_moment_z - section.second_moment_y
    angle = np.arctan2(np.copysign(2.0, difference) * section.product_of_inertia, abs(difference)) / 2.0
    return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
