"""Tables for materials, plates, cross-sections and profiles of bodies, and for point masses, damping and probes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Literal

from pydantic import AfterValidator, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

from pmr.scene.keys import (
    Area,
    Density,
    Frequency,
    Inertia,
    Length,
    Mass,
    Name,
    Once,
    Place,
    Point,
    Pressure,
    Quantity,
    SceneTable,
    SecondMoment,
    ShorthandTable,
    Stiffness,
    Switch,
    Usual,
    Vector,
)
from pmr.scene.profile import BoxProfile

Measured = Literal["stress", "strain", "displacement"]


#: Relative round-off of moments of inertia that are written with few digits.
ROUND_OFF = 1e-3
#: Moments of inertia about x, y and z through the centre of mass, kg m^2.
PrincipalMoments = Annotated[tuple[Inertia, Inertia, Inertia], Usual(1e-7, 4.0, "inertia")]
#: Condition of `is_inertia` in words.
ALLOWED_INERTIA = "three moments are allowed of which none is larger than the sum of the two others, as in every body"


def is_inertia(moments: tuple[float, float, float]) -> bool:
    """Whether a body can have these principal moments of inertia: none exceeds the sum of the other two."""
    return max(moments) <= (1.0 + ROUND_OFF) * (sum(moments) - max(moments))


def _check_inertia(moments: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return the principal moments of inertia if a body can have them; raise an error that shows them otherwise."""
    if not is_inertia(moments):
        raise PydanticCustomError("inertia", ALLOWED_INERTIA)
    return moments


#: Moments of inertia that a body can have.
BodyMoments = Annotated[PrincipalMoments, AfterValidator(_check_inertia)]


def unit_vector(direction: Vector) -> Vector:
    """Return a direction as a vector of unit length, unchanged if its length is 1 to round-off.

    Raises ValueError if the direction is zero or not finite.
    """
    largest = max(map(abs, direction))
    if not 0.0 < largest < math.inf:
        raise ValueError("a direction is allowed: three numbers, not all of them zero")
    if abs(math.hypot(*direction) - 1.0) < 1e-12:
        return direction
    x, y, z = (c / largest for c in direction)  # squares of tiny numbers would vanish, those of huge ones overflow
    length = math.hypot(x, y, z)
    return x / length, y / length, z / length


class Material(SceneTable):
    """Isotropic and linear elastic material; structural steel by default."""

    young: Annotated[Pressure, Usual(1e6, 2e12)] = Field(default=210.0e9, description="Young's modulus E")
    poisson: Annotated[float, Field(gt=-1.0, lt=0.5), Quantity("1", -0.99, 0.4999)] = Field(
        default=0.3, description="Poisson's ratio nu"
    )
    density: Annotated[Density, Usual(20.0, 25e3)] = Field(default=7850.0, description="Density rho")
    yield_stress: Annotated[Pressure, Usual(5e6, 1e10)] | None = Field(
        default=None, description="Yield stress, which the largest von Mises stress is compared with"
    )

    @property
    def shear_modulus(self) -> float:
        """Shear modulus G = E / (2 (1 + nu)) in Pa."""
        return self.young / (2.0 * (1.0 + self.poisson))


class Damping(ShorthandTable):
    """Rayleigh damping D = a M + b K: `mass` is a and `stiffness` is b, or both follow from a damping `ratio`.

    M and K are the mass and stiffness matrix.  The ratio zeta holds at two `frequencies` in Hz; in between the ratio is
    lower, outside it is higher.  Let omega_1 and omega_2 be the circular frequencies of the two.  From zeta = (a /
    omega + b omega) / 2 at both follow a = 2 zeta omega_1 omega_2 / (omega_1 + omega_2) and b = 2 zeta / (omega_1 +
    omega_2).  Bathe: Finite Element Procedures, 1996, section 9.3.3.  A scene that extends another one may use the
    other pair of keys: the first pair is then dropped.
    """

    model_config = ConfigDict(
        json_schema_extra={
            "dependencies": {"ratio": ["frequencies"], "frequencies": ["ratio"]},
            "not": {"required": ["ratio"], "anyOf": [{"required": ["mass"]}, {"required": ["stiffness"]}]},
        }
    )

    mass: Annotated[float, Quantity("1/s", 0.0, 1e9)] = Field(
        default=0.0, description="Factor of the mass matrix M in D"
    )
    stiffness: Annotated[float, Quantity("s", 0.0, 1e6)] = Field(
        default=0.0, description="Factor of the stiffness matrix K in D"
    )

    ratio: Annotated[float, Quantity("1", 0.0, 1e9), Usual(0.0, 0.3)] | None = Field(
        default=None, exclude=True, description="Damping ratio at the two frequencies"
    )
    frequencies: tuple[Frequency, Frequency] | None = Field(
        default=None, exclude=True, description="The two frequencies at which the ratio holds, in ascending order"
    )

    @model_validator(mode="before")
    @classmethod
    def _resolve_ratio(cls, data: object) -> object:
        """Add `mass` and `stiffness` as they follow from `ratio` and `frequencies`; without both, change nothing.

        Refuses one of the two without the other, a further key beside them, a negative ratio, and anything but two
        ascending positive frequencies in Hz.
        """
        if not (isinstance(data, dict) and {"ratio", "frequencies"} & set(data)):
            return data
        try:
            ratio, (first, second) = float(data["ratio"]), map(float, data["frequencies"])
            fits = set(data) == {"ratio", "frequencies"} and ratio >= 0.0 and 0.0 < first < second < math.inf
        except (KeyError, TypeError, ValueError):
            fits = False
        if not fits:
            raise ValueError("ratio with two ascending frequencies in Hz, or mass and stiffness, are allowed")
        first_omega, second_omega = 2.0 * math.pi * first, 2.0 * math.pi * second
        mass = 2.0 * ratio * first_omega * second_omega / (first_omega + second_omega)
        return data | {"mass": mass, "stiffness": 2.0 * ratio / (first_omega + second_omega)}


@dataclass(frozen=True)
class Plate:
    """Material and thickness (m) of a region of a shell."""

    thickness: float
    material: Material = Material.model_construct()


class PointMass(SceneTable):
    """A rigid body attached to a named group, or to the section at a place along the body.

    With the `coupling` ``average`` it follows the mean motion of the group, which may deform.  With ``rigid`` the group
    moves with it as a rigid body.
    """

    name: Name = Field(description="Name of the mass in messages")
    on: Name | Place = Field(description="A named group, or a place along x in m")
    mass: Annotated[Mass, Usual(0.005, 1e3, "mass")] = Field(description="Mass of the body")
    inertia: PrincipalMoments = Field(
        default=(0.0, 0.0, 0.0), description="Moments of inertia about x, y, z through its own centre"
    )
    at: Annotated[Point, Usual(0.0, 1.5, "length")] | None = Field(
        default=None, description="Place of its centre in the section's axes (by default the group's centroid)"
    )
    coupling: Literal["average", "rigid"] = Field(
        default="average", description="Whether the group may deform (average) or moves rigidly with the mass (rigid)"
    )

    payload: Switch = Field(
        default=False, description="Whether it is the load that is carried, which a load chart leaves out for its own"
    )
    hoisted: Switch = Field(
        default=False,
        description="Whether it hangs on the rope with the load, as a hook block does: in load cases of a chart its "
        "weight has the factor of the load",
    )

    def hint_scales(self, scales: Mapping[str, float]) -> dict[str, float]:
        """Return the scale ``inertia`` in kg m^2: the mass times the square of the section's length."""
        return {"inertia": self.mass * scales.get("length", 0.0) ** 2}


class Probe(SceneTable):
    """Quantities recorded at the point of the model nearest to a given point, or as the mean over a group.

    Probes are outputs with a sign at every step, of the full and of the reduced model; they need no further simulation.
    """

    name: Name = Field(description="Name of the probe, with which its columns begin")
    at: Annotated[Point, Usual(0.0, 3.0, "length")] | None = Field(
        default=None, description="A point on the body, x along it, z up"
    )
    on: Name | None = Field(default=None, description="Named group in place of a point; for stresses a group of cells")
    measures: Annotated[tuple[Measured, ...], Once] = Field(
        default=("stress",), min_length=1, description="Quantities that are recorded there"
    )
    face: str = Field(
        default="",
        description="Face of a wall (outer, middle, inner) or corner of a beam's section (top left, ...); by default "
        "where the nearest point is, of a group the outer face",
    )

    @model_validator(mode="after")
    def _check_place(self) -> Probe:
        """Refuse a probe unless it has either a point or a group."""
        if (self.at is None) == (self.on is None):
            raise ValueError("give at or on, one of them")
        return self


class MoverBody(SceneTable):
    """A mass that crosses the section before it on a wheel, with a spring and a damper between both, if they are given.

    Its displacement along z is unknown; its joint says where the wheel is.  A moving force is a load on a mover of a
    mass that is small compared with that of the section.
    """

    mass: Annotated[Mass, Usual(1e-12, 1e6)] = Field(description="Mass, on which loads act")
    wheel_mass: Annotated[float, Quantity("kg", 0.0, 1e12), Usual(0.0, 1e6)] = Field(
        default=0.0, description="Mass of the wheel or axle; more than 0 with a stiffness"
    )
    stiffness: Stiffness | Literal["rigid"] = Field(default="rigid", description="Stiffness between mass and wheel")
    damping: Annotated[float, Quantity("N s/m", 0.0, 1e15), Usual(0.0, 1e9)] = Field(
        default=0.0, description="Damper between mass and wheel, beside the stiffness"
    )
    length: Length = Field(default=1.0, description="Length along x by which the mover is drawn")

    @model_validator(mode="after")
    def _check_suspension(self) -> MoverBody:
        """Refuse a spring without a wheel, and a damper without a spring."""
        if self.stiffness != "rigid" and not self.wheel_mass:
            raise ValueError("a stiffness needs wheel_mass; of a wheel without mass it is that of joint.tail")
        if self.stiffness == "rigid" and self.damping:
            raise ValueError("damping needs a stiffness beside it")
        return self

    @property
    def rayleigh(self) -> Damping:
        """The damper as stiffness-proportional damping, D = (d / k) K; none if the stiffness is rigid."""
        return Damping(stiffness=0.0 if self.stiffness == "rigid" else self.damping / self.stiffness)


class Profile(SceneTable):
    """A straight planar beam by its stiffnesses, along x from 0 to `length`."""

    length: Length = Field(description="Length along x")
    bending_stiffness: Annotated[float, Quantity("N m^2", 1e-15, 1e25), Usual(0.5, 3e8, "sag")] = Field(
        description="Bending stiffness E I"
    )
    mass_per_length: Annotated[float, Quantity("kg/m", 1e-12, 1e12), Usual(1e-3, 1e5)] = Field(
        description="Mass per length rho A"
    )
    axial_stiffness: Annotated[float, Quantity("N", 1e-9, 1e25), Usual(4e4, 1e12, "mass per length")] | None = Field(
        default=None, description="Axial stiffness E A"
    )
    axial: Switch = Field(default=False, description="Whether the beam has axial coordinates")
    tension: Annotated[float, Quantity("N", 0.0, 1e15), Usual(0.0, 1e12)] = Field(
        default=0.0, description="Axial tension, as of a wire between two supports, which resists its deflection"
    )

    def hint_scales(self, scales: Mapping[str, float]) -> dict[str, float]:
        """Return two scales for usual stiffnesses, by name.

        ``sag`` is the EI in N m^2 with which a cantilever sags by its own length under its weight.  ``mass per length``
        is the EA in N with which axial waves travel at 1 m/s.  Of the `scales`, only ``gravity`` in m/s^2 is used.
        """
        return {
            "sag": self.mass_per_length * scales["gravity"] * self.length**3 / 8.0,
            "mass per length": self.mass_per_length,
        }

    @model_validator(mode="after")
    def _check_axial_stiffness(self) -> Profile:
        """Refuse axial coordinates without an axial stiffness."""
        if self.axial and self.axial_stiffness is None:
            raise ValueError("axial = true needs axial_stiffness in N")
        return self


@dataclass(frozen=True)
class ShellBody:
    """A shell: its plate, other plates in named regions of the mesh, and the shear correction factor kappa."""

    plate: Plate
    regions: Mapping[str, Plate] = field(default_factory=dict)
    shear_correction: float = 5.0 / 6.0  # large: rigid in transverse shear


@dataclass(frozen=True)
class SolidBody:
    """A solid: its material, and other materials in named regions of the mesh."""

    material: Material = Material.model_construct()
    regions: Mapping[str, Material] = field(default_factory=dict)


class BeamSection(SceneTable):
    """Properties of a cross-section about its centroid, with y across and z up.

    Centroid and shear centre are measured from the axis of the beam, on which supports, loads and pads act.
    """

    area: Area = Field(description="Area A")
    second_moment_y: SecondMoment = Field(description="Second moment I_y, which resists bending along z")
    second_moment_z: SecondMoment = Field(description="Second moment I_z, which resists bending along y")
    torsion_constant: SecondMoment = Field(description="Torsion constant J")
    shear_area_y: Area | None = Field(default=None, description="Shear area kappa A for forces along y")
    shear_area_z: Area | None = Field(default=None, description="Shear area kappa A for forces along z")
    product_of_inertia: Annotated[float, Quantity("m^4", -1e20, 1e20), Usual(0.0, 0.5)] = Field(
        default=0.0, description="Product of inertia, the integral of y z; zero where y or z is an axis of symmetry"
    )
    centroid: Annotated[tuple[Place, Place], Usual(0.0, 5.0)] = Field(
        default=(0.0, 0.0), description="y and z of the centroid"
    )
    shear_centre: Annotated[tuple[Place, Place], Usual(0.0, 5.0)] = Field(
        default=(0.0, 0.0), description="y and z of the shear centre"
    )

    @property
    def least_second_moment(self) -> float:
        """Smaller principal second moment in m^4."""
        half_difference = (self.second_moment_y - self.second_moment_z) / 2.0
        return self.polar_moment / 2.0 - math.hypot(half_difference, self.product_of_inertia)

    @property
    def polar_moment(self) -> float:
        """I_y + I_z in m^4, for rotary inertia about the axis."""
        return self.second_moment_y + self.second_moment_z


@dataclass(frozen=True)
class Beam3DBody:
    """A straight beam in space, along x, of a `section` or a `profile`."""

    length: float  # m
    section: BeamSection | None = None
    profile: BoxProfile | None = None
    material: Material = Material.model_construct()
    shear: bool = False  # whether it has shear deformation and rotary inertia
    elements: int = 60  # over the whole length
