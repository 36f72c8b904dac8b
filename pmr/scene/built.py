"""Tables of a scene for bodies, meshes, supports, pads, the slider, loads and weight."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Literal, Self

import numpy as np
from pydantic import AfterValidator, ConfigDict, Field, ModelWrapValidatorHandler, model_validator

from pmr.files.arrays import Array
from pmr.scene.box import Box
from pmr.scene.keys import (
    AS_WORD,
    AllowedForce,
    AllowedPressure,
    Count,
    Direction,
    Distance,
    ExistingFile,
    Length,
    Name,
    NameOrNone,
    PadStiffness,
    Place,
    Point,
    Positive,
    Quantity,
    SceneTable,
    Share,
    ShorthandTable,
    Size,
    SupportStiffness,
    Switch,
    Thickness,
    Usual,
    Vector,
    key_error,
    or_plugin_name,
)
from pmr.scene.model_traits import MODELS
from pmr.scene.profile import Face
from pmr.scene.signals import Constant, Signal, SignalBase, SmoothRamp
from pmr.scene.structures import BeamSection, Material, MoverBody, Profile, unit_vector

GRAVITY = 9.80665  # m/s^2
#: Name of the input of the weight of all bodies.
WEIGHT = "gravity"
if TYPE_CHECKING:
    ModelName = str
else:
    ModelName = Annotated[Literal["auto", *MODELS], or_plugin_name("pmr.models"), AS_WORD]
#: Names of two pads on a face, by their side of its middle: on bottom and top, and on all other faces.
SIDES, UPWARDS = dict.fromkeys(("bottom", "top"), ("right", "left")), ("lower", "upper")
#: Directions that each kind of support holds; a direction that a model lacks has no effect.
SUPPORTED: dict[str, tuple[Direction, ...]] = {
    "pinned": ("x", "y", "z"),
    "clamped": ("x", "y", "z", "rx", "ry", "rz"),
    "roller": ("z",),
}
#: Positions of the groups that every body has, as shares of its length.
ENDS = {"tail": 0.0, "tip": 1.0}


class Region(SceneTable):
    """Material and thickness of a named region of the mesh, if they differ from those of the body."""

    material: Material | None = Field(default=None, description="Material of the region")
    thickness: Thickness | None = Field(default=None, description="Thickness of the region, in a shell")


class Geometry(ShorthandTable):
    """Structural model, material and shape of a section."""

    model: ModelName = Field(
        default="auto", description="Structural model; `auto` takes the smallest that is near enough to a shell"
    )
    material: Material = Field(
        default=Material.model_construct(), description="Material, except in regions that have their own"
    )
    box: Box | None = Field(default=None, description="A box boom by its dimensions")
    profile: Profile | None = Field(default=None, description="A planar beam by its stiffnesses")
    mover: MoverBody | None = Field(default=None, description="A mass that crosses the section before it on a wheel")
    thickness: Thickness | None = Field(default=None, description="Thickness of a shell whose mesh is read from a file")
    regions: dict[Name, Region] = Field(
        default={}, description="Named regions of the mesh with a material or thickness of their own"
    )


class Body(Geometry):
    """A section: a box boom, a beam given by its stiffnesses, or the mesh of a file.

    With `model` ``auto`` a run measures how far the results of smaller models are from those of a shell, and takes the
    smallest model that is near enough.  The density of `material` includes `attached_mass_per_length` (m') of a box:
    the density is rho + m' L / V, with the box's length L and the volume V of its walls.
    """

    shear: Switch = Field(default=True, description="Whether beams in space have shear deformation and rotary inertia")
    shear_correction: Annotated[float, Quantity("1", 1e-3, 1e6)] = Field(
        default=5.0 / 6.0, description="Shear correction factor kappa of shells"
    )
    section: BeamSection | None = Field(
        default=None, description="Cross-section of a beam in space; by default that of the box"
    )
    walls: Literal["rigid", "give"] = Field(
        default="rigid", description="Whether the local compliance of the walls under pads is added to a beam"
    )
    attached_mass_per_length: Annotated[float, Quantity("kg/m", 0.0, 1e6), Usual(0.05, 100.0)] = Field(
        default=0.0,
        exclude=True,
        description="Mass of hoses, cables and paint along a box, spread over its walls as a part of their density",
    )

    @model_validator(mode="wrap")
    @classmethod
    def _spread_attached_mass(cls, data: object, handler: ModelWrapValidatorHandler[Self]) -> Self:
        """Add a table's `attached_mass_per_length`, spread over the volume of the box, to its material's density.

        Raises an error for this key if the body is not given by a box of one material alone.
        """
        body, key = handler(data), "attached_mass_per_length"
        if not (isinstance(data, dict) and data.get(key)):
            return body
        if body.box is None or body.section is not None or any(of.material for of in body.regions.values()):
            allowed = "a body by its box alone, of one material, is allowed: others have their own mass"
            raise key_error(key, data[key], allowed)
        density = body.material.density + body.attached_mass_per_length * body.box.length / body.box.volume
        return body.model_copy(update={"material": body.material.model_copy(update={"density": density})})

    @model_validator(mode="after")
    def _check_shape(self) -> Body:
        """Refuse a body with more than one of `box`, `profile` and `mover`, or with a `box` and a `thickness`.

        A box says itself how thick its walls are.
        """
        if self.box is not None and self.thickness is not None:
            raise ValueError("give box.wall or thickness, one of them")
        if sum(description is not None for description in (self.box, self.profile, self.mover)) > 1:
            raise ValueError("give box, profile or mover, one of them")
        return self

    @property
    def length(self) -> float | None:
        """Length along x in m of a box, profile or mover; None for a mesh that is read from a file."""
        described = self.box or self.profile or self.mover
        return described.length if described else None


class FaceNormal(SceneTable):
    """A flat face of a mesh that is read: the outermost facets whose normals point in a direction."""

    normal: Annotated[Vector, AfterValidator(unit_vector)] = Field(
        description="Normal of the face, out of the body; any length"
    )
    angle: Annotated[float, Field(ge=0.01, le=45.0), Quantity("degrees", 0.01, 45.0), Usual(0.01, 45.0)] = Field(
        default=1.0, description="Largest angle between this normal and that of a facet"
    )


class NodeGroups(SceneTable):
    """Groups of a mesh that is read, by a list of nodes."""

    file: ExistingFile = Field(
        description="CSV file: a line of headings, then node, x, y, z in m and the names of the node's groups"
    )


class MeshChoice(SceneTable):
    """How fine the mesh is, or a file that holds a mesh, in any format of meshio.

    A box boom takes `size` and `along`; beams take `elements`.  A file for a planar beam holds a chain of lines.  Any
    other file holds cells and named groups, to which pads, loads and supports refer: tail and tip, bottom, top, left
    (+y) and right.  A face that is no group of the file has its normal in `faces`, or its nodes in a file of `groups`.
    """

    size: Annotated[Size, Usual(0.0, 1.0, "length")] = Field(
        default=0.1, description="Edge length of cells along the circumference of the section"
    )
    along: Annotated[Size, Usual(0.0, 1.0, "length")] | None = Field(
        default=None, description="Edge length of cells along the axis (by default as `size`)"
    )
    tail_layer: Distance = Field(
        default=0.0, description="Length of the first layer of cells at the tail; 0: regular layers"
    )
    cells: Literal["hexahedra", "tetrahedra"] = Field(default="hexahedra", description="Shape of the cells of a solid")
    elements: Count = Field(default=60, description="Number of elements of a beam")
    grading: Annotated[float, Quantity("1", 1e-3, 1e3)] = Field(
        default=1.0, description="Length of a planar beam's last element over that of its first one"
    )
    file: ExistingFile | None = Field(
        default=None,
        description="Mesh file, in place of the keys above; with model `matrices` the file that `pmr matrices` wrote",
    )
    faces: dict[Name, FaceNormal] = Field(
        default={}, description="Faces of the mesh file by their normals, such as `bottom.normal = [0, 0, -1]`"
    )
    groups: NodeGroups | None = Field(
        default=None, description="Further groups of the mesh file, by a list of nodes as `pmr matrices --nodes` takes"
    )


class Support(SceneTable):
    """A support that does not slide: it holds some directions of a group's mean motion, or of every point of the group.

    On a beam a group is one point, so both are the same, but only ``all`` removes the held coordinates from the model.
    """

    name: NameOrNone = Field(default="", description="Name in results and messages")
    on: Name | Place = Field(default="tail", description="A named group, or a place along x in m")
    kind: Literal["pinned", "clamped", "roller"] = Field(
        default="pinned",
        description="Directions that are held: pinned x, y, z; clamped these and all rotations; roller z",
    )
    directions: tuple[Direction, ...] | None = Field(
        default=None, description="Directions that are held, in place of `kind`"
    )
    stiffness: SupportStiffness | Literal["rigid"] = Field(
        default="rigid", description="Stiffness in each direction (of rotations in N m/rad)"
    )
    points: Literal["mean", "all"] = Field(
        default="mean", description="Whether the mean motion of the group is held, or every point of it"
    )
    allowed_force: AllowedForce | None = Field(
        default=None,
        description="Largest force of the support or, with `lug_spacing`, of one lug; the first page has the share "
        "that is used",
    )
    lug_spacing: Annotated[Length, Usual(0.02, 3.0)] | None = Field(
        default=None,
        description="Distance between the two lugs of a pin, which lies along the axis about which the support turns",
    )

    @model_validator(mode="after")
    def _check_lugs(self) -> Support:
        """Refuse lugs of a support that does not turn freely about a single axis, that of its pin."""
        if self.lug_spacing is not None and len(self._free_axes) != 1:
            allowed = "a pin is allowed with it, a support that holds two of rx, ry and rz"
            raise key_error("lug_spacing", self.lug_spacing, allowed)
        return self

    @model_validator(mode="after")
    def _check_points(self) -> Support:
        """Refuse a stiffness with ``points = "all"``: a support that holds every point is rigid."""
        if self.points == "all" and self.stiffness != "rigid":
            raise ValueError("points = 'all' is rigid: leave the stiffness out")
        return self

    def hint_scales(self, scales: Mapping[str, float]) -> dict[str, float]:
        """Return the scale 1, whose name says which usual range the stiffness of the support has.

        The name is ``turning`` if the support holds rotations alone, otherwise ``straight``.
        """
        turns = all(direction in ("rx", "ry", "rz") for direction in self.held_directions)
        return {"turning" if turns else "straight": 1.0}

    @property
    def held_directions(self) -> tuple[Direction, ...]:
        """Directions that the support holds; a direction that the body's model lacks has no effect."""
        return SUPPORTED[self.kind] if self.directions is None else self.directions

    @property
    def symbol(self) -> str:
        """Name of the support's symbol in drawings.

        The name is ``clamped`` if the support holds ry or rz, otherwise ``pinned`` if the support holds x, otherwise
        ``roller``.
        """
        if {"ry", "rz"} & set(self.held_directions):
            return "clamped"
        return "pinned" if "x" in self.held_directions else "roller"

    @property
    def _free_axes(self) -> str:
        """Axes, of x, y and z, about which the support lets the body turn."""
        return "".join(axis for axis in "xyz" if f"r{axis}" not in self.held_directions)

    def lug_shares(self, direction: Direction) -> Array:
        r"""Return the forces (2, 3) along x, y, z of both lugs of a pin, by 1 N or 1 N m of the support.

        .. math:: F_{1,2} = \tfrac12\, (F - F_a) + F_a \pm \frac{M \times a}{d}

        Here F and M are force and moment of the support, a is the unit vector along the pin and d the `lug_spacing`.
        The lugs share the force across the pin half and half.  They bear the moment as two opposite forces.  Each lug
        is taken to bear all of the force along the pin, :math:`F_a = a\, (a \cdot F)`, as one of them may have to.
        The support has 1 N along the `direction`, or 1 N m about it.  Only for a support with a `lug_spacing`.
        """
        pin, unit = (np.eye(3)["xyz".index(axis)] for axis in (self._free_axes, direction[-1]))
        if direction.startswith("r"):
            couple = np.cross(unit, pin) / (self.lug_spacing or np.inf)
            return np.array([couple, -couple])
        return np.array([unit, unit]) * (1.0 if unit @ pin else 0.5)

    def row_name(self, direction: str) -> str:
        """Return the name of the support's row along or about one direction.

        The direction follows the support's name, such as ``lug z``, unless the support holds no other direction.  A
        support without a name has rows such as ``support z on tail`` or ``support z at 2 m``.
        """
        if not self.name:
            return f"support {direction} " + (f"on {self.on}" if isinstance(self.on, str) else f"at {self.on:g} m")
        return self.name if len(self.held_directions) == 1 else f"{self.name} {direction}"


class Slider(SceneTable):
    """The path s(t) along which moving pads slide.  Without such pads, points of a planar beam slide at s + `offsets`.

    A saved model, as in `pmr simulate` or an FMU, can follow any path within the range of this path, or within `travel`
    if given.  Points may use the whole beam.  A measured path may exceed the range by 1e-5 of the range; the excess is
    cut off.
    """

    path: Annotated[Signal, Usual(0.0, 2.0, "length", "m")] = Field(description="Path s over time, in m")
    offsets: tuple[Place, ...] | None = Field(
        default=None, min_length=1, description="Distance of each sliding point ahead of s"
    )
    travel: tuple[Place, Place] | None = Field(default=None, description="Smallest and largest s of the saved model")


class PadPlaces(SceneTable):
    """Places, sizes, stiffness and clearance of a ring of pads."""

    name: NameOrNone = Field(default="", description="Name of the ring, where one end has several")
    at: Distance = Field(description="Distance of the pads' centre from the tail, or from the mouth")
    faces: Annotated[dict[Face, tuple[Place, ...]], Usual(0.0, 5.0)] | None = Field(
        default=None,
        description="Places of the pads across each face, by its name; none: a point on the axis of planar beams",
    )
    length: Annotated[Length, Usual(0.001, 5.0)] = Field(default=0.3, description="Length of a pad along the axis")
    width: Annotated[Length, Usual(0.001, 3.0)] = Field(default=0.08, description="Width of a pad across the face")
    stiffness: PadStiffness | Literal["rigid"] = Field(default=3e8, description="Stiffness of each pad")
    unilateral: Switch = Field(default=False, description="Whether pads only push, and lift off where they would pull")
    clearance: Annotated[Distance | dict[Face, Distance], Usual(0.0, 0.2)] = Field(
        default=0.0, description="Gap between pads that only push and the undeformed body, of all faces or by face"
    )
    allowed_pressure: AllowedPressure | None = Field(
        default=None,
        description="Largest mean pressure of a pad, its force over length times width; the first page has the share "
        "that is used",
    )

    def clearance_on(self, face: str) -> float:
        """Return the clearance in m of the pads on a face; 0 for a face that clearances by face do not name."""
        if not isinstance(self.clearance, dict):
            return self.clearance
        return next((gap for name, gap in self.clearance.items() if name == face), 0.0)

    @property
    def clearance_fault(self) -> str:
        """Text that says which clearance is allowed instead of a wrong one; empty if the clearance is right.

        A clearance is wrong for pads that hold both ways, and on a face without pads.
        """
        if self.clearance and not self.unilateral:
            return "0 is allowed, as only pads with unilateral = true have a clearance"
        faces, named = self.faces or {}, self.clearance if isinstance(self.clearance, dict) else {}
        strange = [face for face in named if face not in faces]
        return f"a clearance of faces that have pads is allowed: {strange[0]} has none" if strange else ""

    @property
    def has_clearance(self) -> bool:
        """Whether the clearance is not 0 on one of the faces."""
        return any(self.clearance.values()) if isinstance(self.clearance, dict) else self.clearance > 0.0


class PadRing(PadPlaces):
    """A ring of pads at one position along the axis, which is fixed on the body or moves along it.

    `faces` gives the coordinate in m of each pad across its face: y on bottom and top, z on left and right.  On slanted
    faces it grows upwards, from the point of the face that is nearest to the axis.
    """

    name: Name = Field(description="Name of the ring, with which the names of its pads begin")
    at: Place = Field(
        default=0.0, description="Place of the pads' centre along the axis; of moving pads its distance ahead of s"
    )
    moving: Switch = Field(
        default=False, description="Whether the pads move along the body, as those at the mouth of the next section do"
    )
    faces: Annotated[dict[Face, tuple[Place, ...]], Field(min_length=1), Usual(0.0, 5.0)] = Field(
        description="Places of the pads across each face, by the face's name"
    )

    @property
    def named_pads(self) -> list[tuple[str, Face, float]]:
        """For each pad its name, its face and its coordinate across the face in m.

        The name consists of the names of ring and face.  On a face with several pads, the number of the pad follows,
        from 1 on.  If there are two pads, one on either side of the coordinate 0, a word for the side follows instead
        (`SIDES`, `UPWARDS`).
        """
        pads = []
        for face, places in self.faces.items():
            for number, across in enumerate(places, start=1):
                is_pair = len(places) == 2 and np.prod(places) < 0.0
                which = SIDES.get(face, UPWARDS)[int(across > 0.0)] if is_pair else str(number)
                pads.append((f"{self.name} {face}" + (f" {which}" if len(places) > 1 else ""), face, float(across)))
        return pads


def force_name(name: str) -> str:
    """Return the name in results of the force at the pad, sliding point or other contact called `name`."""
    return f"force of {name}"


def reaction_name(name: str) -> str:
    """Return the name in results of the force or moment in the row called `name` of a rigid support."""
    return f"reaction of {name}"


def friction_name(section: str) -> str:
    """Return the name of the friction force along a section's joint, the sum for all of its pads."""
    return f"friction of {section}"


#: Keys of a load that only some kinds of loads have, with these kinds.
KEYS_OF_LOADS = (
    dict.fromkeys(("on", "axes", "point"), ("force",)) | {"direction": ("force", "temperature")}
    | {"expansion": ("temperature",), "depth": ("temperature", "wind")}
    | dict.fromkeys(("azimuth", "slews", "shape", "exponent", "reference", "least", "above"), ("wind",))
)  # fmt: skip
#: Axes across a beam along which wind presses, and number of polynomials along the beam for each.
PRESSED: tuple[Direction, ...] = ("y", "z")
POLYNOMIALS = 4


class PlacedLoad(SceneTable):
    """Keys of a load of any kind: what it is, where and along which axes it acts, and how large it is over time."""

    name: Name = Field(default="F", description="Name of the load in results and exports")
    on: Name | Place = Field(default="tip", description="A named group, or a place along x in m")
    acts: Literal["force", "temperature", "wind"] = Field(
        default="force",
        description="What it is: a force or moment, wind, or, on a beam, a difference of temperature across it",
    )
    direction: Direction = Field(
        default="z", description="Direction of the force, axis of the moment, or side that is warmer: z above, y left"
    )
    point: Point | None = Field(
        default=None,
        description="Point where the force acts, which moves rigidly with `on`, in the axes of the body; by default "
        "the centroid of `on`",
    )
    axes: Literal["body", "ground"] = Field(
        default="body",
        description="Axes in which `direction` is given: those of the boom, or in a frame those of the ground, z "
        "upwards and x where the boom points unslewed",
    )
    signal: Annotated[
        Signal,
        Usual(1e-3, 1e4, "force", "N"),
        Usual(1e-4, 1e4, "moment", "N m"),
        Usual(1e-2, 150.0, "temperature", "K"),
        Usual(1.0, 5e3, "wind", "Pa"),
    ] = Field(
        description="Force in N, moment in N m, difference of temperature in K or pressure of wind in Pa over time"
    )


class Load(PlacedLoad):
    r"""A force in N (moment in N m) on a named group or at a position, a difference of temperature, or wind.

    A temperature that is higher by :math:`\Delta T` at the face in `direction` than at the opposite face, at the
    distance d, bends a free beam with the curvature :math:`\alpha \Delta T / d`, away from the warmer face.

    Wind has the pressure :math:`q = q_r (Z / Z_r)^{2 p}` at the height Z above the ground, constant below `least`.  It
    presses on the part of a section that is outside of other ones.  Its force per length along each of the axes y and z
    of the section is :math:`c\, q\, d\, e |e|`.  In it, c is the shape factor, d the depth that the wind meets, and e
    the component along this axis of the unit vector in which the wind blows.
    """

    expansion: Annotated[float, Quantity("1/K", 1e-9, 1.0), Usual(1e-6, 1e-4)] = Field(
        default=1.2e-5, description="Coefficient of thermal expansion"
    )
    depth: Length | None = Field(
        default=None,
        description="Distance of the faces between which temperatures differ, or depth that wind meets; by default "
        "that of the box",
    )
    azimuth: Annotated[float, Quantity("frame.unit", -720.0, 720.0), Usual(0.0, 400.0)] = Field(
        default=0.0, description="Angle of the direction in which wind blows, from X of the ground to the left"
    )
    slews: Switch = Field(
        default=False,
        description="Whether wind turns with the boom as it slews: azimuth is then the angle from the boom",
    )
    shape: Positive = Field(default=1.0, description="Shape factor of wind")
    exponent: Share = Field(default=0.0, description="Exponent p of the wind's speed over the height")
    reference: Length = Field(default=10.0, description="Height above the ground of the pressure that `signal` gives")
    least: Length = Field(default=2.0, description="Height up to which the pressure of wind is constant")
    above: Place | None = Field(
        default=None,
        description="Height of the pivot above the ground; 0 or none: that of ground or hoist, or 0",
    )

    @model_validator(mode="after")
    def _check_keys(self) -> Self:
        """Refuse keys that have no effect on a load with this `acts`, unless they have their default; return the load.

        A difference of temperature along the body's axis and the point of a moment are refused, too.
        """
        if self.acts == "temperature" and self.direction not in ("y", "z"):
            raise key_error("direction", self.direction, "'y' or 'z' is allowed across a body")
        for key in self.unused_keys:
            if getattr(self, key) != type(self).model_fields[key].default:
                allowed = f"acts = {' or '.join(map(repr, KEYS_OF_LOADS[key]))} is allowed with it"
                raise key_error(key, getattr(self, key), allowed)
        if self.point is not None and self.direction.startswith("r"):
            raise key_error("point", list(self.point), "a force is allowed with it: a moment acts everywhere alike")
        return self

    def blows_sideways(self, unit: str) -> bool:
        """Whether this is wind with a part across the plane of X and Z; `unit` is that of `azimuth`, rad or degrees."""
        azimuth = self.azimuth if unit == "rad" else math.radians(self.azimuth)
        return self.acts == "wind" and abs(math.sin(azimuth)) > 1e-12

    @property
    def unused_keys(self) -> tuple[str, ...]:
        """Keys that have no effect on loads with this `acts`."""
        return tuple(key for key, kinds in KEYS_OF_LOADS.items() if self.acts not in kinds)

    @property
    def unit(self) -> str:
        """Unit of the load's signal: N, N m, K or Pa."""
        return {"temperature": "K", "wind": "Pa"}.get(self.acts, "N m" if self.direction.startswith("r") else "N")

    def hint_scales(self, scales: Mapping[str, float]) -> dict[str, float]:
        """Return the scale, by its name, in whose multiples the usual ranges of the load are stated.

        The scale of a ``force`` is the ``weight`` in N in `scales`, that of a ``moment`` the weight times the
        ``length`` in m.  Other loads have the scale 1 under the name of their kind, ``temperature`` or ``wind``.
        """
        if self.acts != "force":
            return {self.acts: 1.0}
        if self.direction.startswith("r"):
            return {"moment": scales.get("weight", 0.0) * scales.get("length", 0.0)}
        return {"force": scales.get("weight", 0.0)}


class Gravity(ShorthandTable):
    """Weight of all parts; it rises smoothly from zero within the first `rise` seconds, or acts from the start if 0.

    By default it rises within a second if the motion begins at rest, and acts from the start if the motion begins in
    equilibrium (`start`).  Its direction is given by the vector `direction`, or by the `inclination` in degrees of a
    raised boom; only one of the two is allowed.
    """

    model_config = ConfigDict(json_schema_extra={"not": {"required": ["inclination", "direction"]}})

    acceleration: Annotated[float, Quantity("m/s^2", 1e-9, 1e6), Usual(1.2, 30.0)] = Field(
        default=GRAVITY, description="Acceleration of free fall"
    )
    direction: Annotated[Vector, AfterValidator(unit_vector)] = Field(
        default=(0.0, 0.0, -1.0), description="Direction of the weight; its length does not count"
    )
    rise: Annotated[float, Quantity("s", 0.0, 1e9), Usual(0.0, 200.0)] = Field(
        default=1.0,
        description="Time within which the weight rises smoothly from zero (by default 0 where `start` is equilibrium)",
    )
    inclination: (
        Annotated[float, Field(ge=-90.0, le=90.0), Quantity("degrees", -90.0, 90.0), Usual(1.6, 90.0)] | None
    ) = Field(
        default=None,
        exclude=True,
        description="Angle by which the boom is raised, in place of `direction`: this is (-sin, 0, -cos) of it",
    )

    @model_validator(mode="before")
    @classmethod
    def _resolve_inclination(cls, data: object) -> object:
        """Add the direction (-sin, 0, -cos) of its `inclination` to a table; without one, return the table unchanged.

        An `inclination` together with a `direction` is refused.  An inclination that is no finite number is not
        resolved: the check of the key `inclination` refuses it.
        """
        angle = data.get("inclination") if isinstance(data, dict) else None
        if not (isinstance(data, dict) and isinstance(angle, (int, float)) and math.isfinite(angle)):
            return data
        if "direction" in data:
            raise key_error("inclination", angle, "inclination or direction is allowed, one of them")
        radians = math.radians(angle)
        return data | {"direction": (0.0 - math.sin(radians), 0.0, 0.0 - math.cos(radians))}

    @property
    def elevation(self) -> float:
        """Angle in degrees by which the x axis points upwards."""
        return math.degrees(math.asin(0.0 - self.direction[0]))

    @property
    def signal(self) -> SignalBase:
        """Acceleration of the weight in m/s^2 over time: constant if `rise` is 0, else rising from 0 until `rise`."""
        if self.rise == 0.0:
            return Constant(amount=self.acceleration)
        return SmoothRamp(times=(0.0, self.rise), values=(0.0, self.acceleration))
