"""What is built: a body, what holds it, what it carries, and what drives it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, ConfigDict, Field, model_validator

from pmr.scene.offered import AS_WORD, or_offered
from pmr.scene.plates import Face
from pmr.scene.profile import BoxProfile
from pmr.scene.refusals import of_key
from pmr.scene.section import (
    Count,
    Direction,
    Distance,
    ExistingFile,
    Length,
    Name,
    NameOrNone,
    Place,
    Quantity,
    Section,
    Size,
    Stiffness,
    Switch,
    Vector,
)
from pmr.scene.signals import Constant, Signal, SignalBase, SmoothRamp
from pmr.scene.structures import BeamSection, Material, Profile, unit_vector

GRAVITY = 9.80665  # m/s^2
#: The input that the weight of everything drives.
WEIGHT = "gravity"
OwnModel = Literal["auto", "beam2d", "beam3d", "shell", "solid", "matrices"]
ModelName = Annotated[OwnModel, or_offered("pmr.models"), AS_WORD]
#: What tells pads of a face apart, if there are two: which side of the middle they are on.
SIDES, UPWARDS = dict.fromkeys(("bottom", "top"), ("right", "left")), ("lower", "upper")
#: What each kind of support holds, as far as the body moves that way.
SUPPORTED: dict[str, tuple[Direction, ...]] = {
    "pinned": ("x", "y", "z"),
    "clamped": ("x", "y", "z", "rx", "ry", "rz"),
    "roller": ("z",),
}
#: Places that every body has, as shares of its length.
ENDS = {"tail": 0.0, "tip": 1.0}


class Box(BoxProfile):
    """A tube of plates along x by the dimensions of its mid-surface; width along y, height along z."""

    length: Length = Field(description="Length along x")
    frames: tuple[Size, ...] = Field(
        default=(), description="Places along x where a shell is stiffened by a transverse plate all around"
    )
    frame_depth: Distance = Field(default=0.0, description="How deep these plates are")


class Region(Section):
    """What a named region of the mesh is made of, where it differs from the rest."""

    material: Material | None = Field(default=None, description="Its material")
    thickness: Length | None = Field(default=None, description="Its thickness, in a shell")


class Body(Section):
    """What slides: a box boom, a beam by its stiffnesses, or whatever the mesh file holds.

    `model` ``auto`` takes the smallest one that a run measures to be near enough to a shell.
    """

    model: ModelName = Field(default="auto", description="Structural model; auto: the smallest that will do")
    material: Material = Field(default=Material(), description="Of all that no region says otherwise of")
    box: Box | None = Field(default=None, description="A box boom by its dimensions")
    profile: Profile | None = Field(default=None, description="A planar beam by its stiffnesses")
    thickness: Length | None = Field(default=None, description="Of a shell that is read from a file")
    regions: dict[Name, Region] = Field(default={}, description="Named regions of the mesh that differ from the rest")
    shear: Switch = Field(default=True, description="Shear deformation and rotary inertia of beams in space")
    shear_correction: Annotated[float, Field(gt=0.0, strict=True), Quantity("1", 1e-3, 1e6)] = Field(
        default=5.0 / 6.0, description="Shear correction factor kappa of shells"
    )
    section: BeamSection | None = Field(default=None, description="Of a beam in space, by default that of the box")
    walls: Literal["rigid", "give"] = Field(
        default="rigid", description="Whether the walls of a box that is a beam give way under its pads"
    )

    @model_validator(mode="after")
    def _thickness_is_the_walls(self) -> Body:
        if self.box is not None and self.thickness is not None:
            raise ValueError("give box.wall or thickness, one of them")
        if self.box is not None and self.profile is not None:
            raise ValueError("give box or profile, one of them")
        return self

    @property
    def length(self) -> float | None:
        """Along x in m, where it is known before a mesh is read."""
        described = self.box or self.profile
        return described.length if described else None


class MeshChoice(Section):
    """How fine the mesh is, or a file that holds it (anything meshio reads).

    A box boom takes `size` and `along`; beams take `elements`.  A file holds a chain of lines for a planar beam, else
    cells with named groups: tail and tip, bottom, top, left (+y) and right, as far as pads, loads and supports name
    them.
    """

    size: Size = Field(default=0.1, description="Edge length of cells around the section")
    along: Size | None = Field(default=None, description="Edge length along the axis, by default the same")
    tail_layer: Distance = Field(default=0.0, description="Length of a layer of cells at the tail")
    cells: Literal["hexahedra", "tetrahedra"] = Field(default="hexahedra", description="Of a solid")
    elements: Count = Field(default=60, description="Of a beam")
    grading: Annotated[float, Field(strict=True), Quantity("1", 1e-3, 1e3)] = Field(
        default=1.0, description="Length of a planar beam's last element over that of its first"
    )
    file: ExistingFile | None = Field(
        default=None, description="A mesh to read instead; of model matrices what pmr matrices wrote"
    )


class Support(Section):
    """What holds a place where it is, whatever slides: some directions of its mean motion, or all of its points.

    On a beam, whose places are points, both is the same but for the coordinates, which ``all`` leaves out.
    """

    name: NameOrNone = Field(default="", description="What its rows are called by")
    on: Name | Place = Field(default="tail", description="A named group, or a place along x in m")
    kind: Literal["pinned", "clamped", "roller"] = Field(default="pinned", description="Directions in one word")
    directions: tuple[Direction, ...] | None = Field(default=None, description="Directions, in place of the kind")
    stiffness: Stiffness | Literal["rigid"] = Field(default="rigid", description="Of each direction")
    points: Literal["mean", "all"] = Field(default="mean", description="Whether the mean motion or every point is held")

    @model_validator(mode="after")
    def _points_are_rigid(self) -> Support:
        if self.points == "all" and self.stiffness != "rigid":
            raise ValueError("points = 'all' is rigid: leave the stiffness out")
        return self

    @property
    def held(self) -> tuple[Direction, ...]:
        """Directions that it holds, as far as the body moves that way."""
        return SUPPORTED[self.kind] if self.directions is None else self.directions

    @property
    def shown(self) -> str:
        """How it is drawn: as a clamp where it holds a rotation across the axis, else as a point."""
        return "clamped" if {"ry", "rz"} & set(self.held) else "pinned" if "x" in self.held else "roller"

    def row_name(self, direction: str) -> str:
        """What the row of one direction is called."""
        if not self.name:
            return f"support {direction} " + (f"on {self.on}" if isinstance(self.on, str) else f"at {self.on:g} m")
        return self.name if len(self.held) == 1 else f"{self.name} {direction}"


class Slider(Section):
    """The path s(t) of what slides; where no pads move, points of a planar beam at s + each of the `offsets`.

    Rows of pads are tabulated where the path takes them, or over all of `travel`: a saved model then goes along any
    path on it (`pmr simulate`, FMUs).  Points have the whole beam.  Measured paths overshoot: up to 1e-5 of the range
    beyond an end they are taken at the end.
    """

    path: Signal = Field(description="s over time, in m")
    offsets: tuple[Place, ...] | None = Field(default=None, min_length=1, description="Of points, ahead of s")
    travel: tuple[Place, Place] | None = Field(default=None, description="Smallest and largest s of the saved model")


def clearance_on(given: float | Mapping[Face, float], face: str) -> float:
    """Of the pads on a face, where one of all is given or several by face, m."""
    return next((gap for name, gap in given.items() if name == face), 0.0) if isinstance(given, Mapping) else given


class PadRing(Section):
    """Pads around the section at one place along the axis, which stay on the body or move along it.

    `faces` says where they are across each face, m: y on bottom and top, z on the sides, upwards on faces that are
    slanted, from where a face is nearest to the axis.
    """

    name: Name = Field(description="What its pads are called by")
    at: Place = Field(default=0.0, description="Centre along the axis; of moving pads the distance ahead of s")
    moving: Switch = Field(default=False, description="Whether they move along the body")
    faces: Annotated[dict[Face, tuple[Place, ...]], Field(min_length=1)] = Field(description="Places across each face")
    length: Length = Field(default=0.3, description="Along the axis")
    width: Length = Field(default=0.08, description="Across")
    stiffness: Stiffness | Literal["rigid"] = Field(default=3e8, description="Of each pad")
    unilateral: Switch = Field(default=False, description="Whether they only push")
    clearance: Distance | dict[Face, Distance] = Field(
        default=0.0, description="Between pads that only push and the body at rest"
    )

    def clearance_on(self, face: Face) -> float:
        """Of the pads on a face, m."""
        return clearance_on(self.clearance, face)

    @property
    def places(self) -> list[tuple[str, Face, float]]:
        """Name, face and place across of each pad."""
        found = []
        for face, places in self.faces.items():
            for number, across in enumerate(places, start=1):
                which = (
                    SIDES.get(face, UPWARDS)[int(across > 0.0)]
                    if len(places) == 2 and np.prod(places) < 0.0
                    else str(number)
                )
                found.append((f"{self.name} {face}" + (f" {which}" if len(places) > 1 else ""), face, float(across)))
        return found


def force_of(name: str) -> str:
    """What the force of a pad or slider is called, whether it is an output or the multiplier of a row."""
    return f"force of {name}"


def reaction_of(name: str) -> str:
    """What the force or moment of a rigid support is called."""
    return f"reaction of {name}"


def friction_of(section: str) -> str:
    """What the friction along a section's joint is called, of all its pads together."""
    return f"friction of {section}"


class Load(Section):
    """A force in N (moment in N m) along a direction, spread over a named group or at a place along the axis."""

    name: Name = Field(default="F", description="What the input is called")
    on: Name | Place = Field(default="tip", description="A named group, or a place along x in m")
    direction: Direction = Field(default="z", description="Of the force, or the axis that a moment turns about")
    axes: Literal["body", "ground"] = Field(
        default="body",
        description="Whose axes direction is one of; in a frame a force may act along the ground's: z upwards, x where "
        "the boom points unslewed",
    )
    signal: Signal = Field(description="Over time, in N or N m")


def _or_inclination(schema: dict[str, Any]) -> None:
    """An inclination may stand in the place of the direction."""
    about = "How far the boom is raised, in place of the direction, which then is (-sin, 0, -cos) of it"
    degrees = {"type": "number", "minimum": -90.0, "maximum": 90.0, "unit": "degrees", "default": None}
    schema["properties"] |= {"inclination": degrees | {"description": about}}
    schema["not"] = {"required": ["inclination", "direction"]}


class Gravity(Section):
    """The weight of everything; it comes up smoothly within the first `rise` seconds, 0: it is there from the start.

    What begins at rest has its weight come up within a second by default; what begins in equilibrium (`start`) has it
    from the start.

    Down is where `direction` points, whose length does not count, or what an `inclination` in degrees says of a boom
    that is raised, with x along it: one of the two.  It is stored as a unit vector.
    """

    model_config = ConfigDict(json_schema_extra=_or_inclination)

    acceleration: Annotated[float, Field(gt=0.0, strict=True), Quantity("m/s^2", 1e-9, 1e6)] = Field(
        default=GRAVITY, description="Of free fall"
    )
    direction: Annotated[Vector, AfterValidator(unit_vector)] = Field(
        default=(0.0, 0.0, -1.0), description="Where down is"
    )
    rise: Annotated[float, Field(ge=0.0, strict=True), Quantity("s", 0.0, 1e9)] = Field(
        default=1.0, description="Time in which it comes up; 0 by default where start is equilibrium"
    )

    @model_validator(mode="before")
    @classmethod
    def _inclined(cls, data: Any) -> Any:
        if not (isinstance(data, dict) and "inclination" in data):
            return data
        rest, angle = {key: value for key, value in data.items() if key != "inclination"}, data["inclination"]
        is_number = isinstance(angle, (int, float)) and not isinstance(angle, bool)
        if "direction" in rest or not is_number or not -90.0 <= angle <= 90.0:
            raise of_key("inclination", angle, "a number from -90 to 90 in degrees, or direction, is allowed")
        radians = math.radians(angle)
        return rest | {"direction": (0.0 - math.sin(radians), 0.0, 0.0 - math.cos(radians))}

    @property
    def raised(self) -> float:
        """How far x points upwards, in degrees."""
        return math.degrees(math.asin(0.0 - self.direction[0]))

    @property
    def signal(self) -> SignalBase:
        """Acceleration in m/s^2 over time."""
        if self.rise == 0.0:
            return Constant(amount=self.acceleration)
        return SmoothRamp(times=(0.0, self.rise), values=(0.0, self.acceleration))
