"""Sections of a scene that describe bodies in space: materials, thicknesses, beam sections, attached masses."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from pmr.scene.sections import NotNegative, Positive, _Section
from pmr.scene.signals import Real

Vector = tuple[Real, Real, Real]


def unit_vector(direction: tuple[float, float, float]) -> tuple[float, float, float]:
    """The direction alone; one of unit length, to round-off, stays as it is.

    Raises
    ------
    ValueError
        If it is zero or not finite.
    """
    largest = max(map(abs, direction))
    if not 0.0 < largest < math.inf:
        raise ValueError("a direction is allowed: three numbers, not all of them zero")
    if abs(math.hypot(*direction) - 1.0) < 1e-12:
        return direction
    x, y, z = (c / largest for c in direction)  # squares of tiny and huge numbers would vanish or overflow
    length = math.hypot(x, y, z)
    return x / length, y / length, z / length


class Material(_Section):
    """Isotropic and linear elastic; structural steel by default."""

    young: Positive = 210.0e9  # E, Pa
    poisson: Annotated[float, Field(gt=-1.0, lt=0.5, strict=True)] = 0.3
    density: Positive = 7850.0  # kg/m^3

    @property
    def shear_modulus(self) -> float:
        """G = E / (2 (1 + nu)) in Pa."""
        return self.young / (2.0 * (1.0 + self.poisson))


class Plate(_Section):
    """Material and thickness of a region of a shell."""

    material: Material = Material()
    thickness: Positive  # m


class PointMass(_Section):
    """A rigid body attached to a named group (or, on a beam, to a place along it).

    `average`: it follows the group's mean motion, which leaves the group free to deform; `rigid`: the group moves
    as one with it.
    """

    name: str
    on: str
    mass: NotNegative  # kg
    inertia: tuple[NotNegative, NotNegative, NotNegative] = (0.0, 0.0, 0.0)  # about its own centre, kg m^2
    at: Vector | None = None  # its centre, m; by default the group's centroid
    coupling: Literal["average", "rigid"] = "average"


class BoxProfile(_Section):
    """A rectangular tube, by the dimensions of its mid-surface; width along y, height along z."""

    width: Positive  # m
    height: Positive  # m
    wall: Positive  # m

    @model_validator(mode="after")
    def _hollow(self) -> BoxProfile:
        if self.wall >= min(self.width, self.height):
            raise ValueError("the wall must be thinner than width and height")
        return self


class Profile(_Section):
    """A straight planar beam by its stiffnesses, along x from 0 to `length`."""

    length: Positive = Field(description="m")
    bending_stiffness: Positive = Field(description="EI, N m^2")
    mass_per_length: Positive = Field(description="rho A, kg/m")
    axial_stiffness: Positive | None = Field(default=None, description="EA, N")
    axial: bool = Field(default=False, description="whether there are axial coordinates")

    @model_validator(mode="after")
    def _axial_needs_stiffness(self) -> Profile:
        if self.axial and self.axial_stiffness is None:
            raise ValueError("axial = true needs axial_stiffness in N")
        return self


class ShellBody(_Section):
    """A shell: its plate, and other ones in named regions of the mesh."""

    model: Literal["shell"] = "shell"
    plate: Plate
    regions: dict[str, Plate] = {}
    shear_correction: Positive = 5.0 / 6.0  # kappa; large: rigid in transverse shear


class SolidBody(_Section):
    """A solid: its material, and other ones in named regions of the mesh."""

    model: Literal["solid"] = "solid"
    material: Material = Material()
    regions: dict[str, Material] = {}


class BeamSection(_Section):
    """Properties of a cross-section about its centroid; z points up in the section, y across."""

    area: Positive  # A, m^2
    second_moment_y: Positive  # I_y, m^4: resists bending along z
    second_moment_z: Positive  # I_z, m^4: resists bending along y
    torsion_constant: Positive  # m^4
    shear_area_y: Positive | None = None  # kappa A for forces along y, m^2
    shear_area_z: Positive | None = None  # kappa A for forces along z, m^2

    @property
    def polar_moment(self) -> float:
        """I_y + I_z in m^4, for rotary inertia about the axis."""
        return self.second_moment_y + self.second_moment_z


class Beam3DBody(_Section):
    """A beam in space along a polyline, with one section; `shear` adds shear deformation and rotary inertia."""

    model: Literal["beam3d"] = "beam3d"
    points: Annotated[tuple[Vector, ...], Field(min_length=2)]  # corners of the axis, m
    up: Vector = (0.0, 0.0, 1.0)  # the section's z axis lies in the plane of this and the beam's axis
    section: BeamSection | None = None
    profile: BoxProfile | None = None
    material: Material = Material()
    shear: bool = False
    elements: Annotated[int, Field(ge=1, strict=True)] = 60  # over the whole length

    @model_validator(mode="after")
    def _described_once(self) -> Beam3DBody:
        if (self.section is None) == (self.profile is None):
            raise ValueError("give section or profile, one of them")
        if self.shear and self.section is not None and None in (self.section.shear_area_y, self.section.shear_area_z):
            raise ValueError("shear = true needs section.shear_area_y and section.shear_area_z in m^2")
        return self

    @model_validator(mode="after")
    def _frames_exist(self) -> Beam3DBody:
        steps = np.diff(np.array(self.points), axis=0)
        lengths = np.linalg.norm(steps, axis=1)
        if np.any(lengths <= 0.0):
            raise ValueError("two points in a row are the same")
        across = np.linalg.norm(np.cross(steps / lengths[:, None], self.up), axis=1)
        if np.any(across <= 1e-6 * float(np.linalg.norm(self.up))):
            raise ValueError("up must not be parallel to the beam")
        return self
