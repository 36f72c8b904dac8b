"""A scene in space: a structure that slides through pads, which beams, shells and solids can represent."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from pmr.scene.sections import Compare, Count, ExistingFile, NotNegative, Positive, SceneBase, Simulation, _Section
from pmr.scene.signals import Constant, Real, Signal, SignalBase, SmoothRamp
from pmr.scene.structures import BeamSection, Material, PointMass, Vector, unit_vector

GRAVITY = 9.80665  # m/s^2
ModelName = Literal["auto", "beam2d", "beam3d", "shell", "solid"]
Direction = Literal["x", "y", "z", "rx", "ry", "rz"]
Face = Literal["bottom", "top", "left", "right"]
#: What tells pads of a face apart, if there are two: which side of the middle they are on.
SIDES = {"bottom": ("right", "left"), "top": ("right", "left"), "left": ("lower", "upper"), "right": ("lower", "upper")}


class Box(_Section):
    """A rectangular tube along x by the dimensions of its mid-surface, m; width along y, height along z.

    `frames` are places along x where a shell is stiffened by a transverse plate all around, `frame_depth` deep.
    """

    length: Positive
    width: Positive
    height: Positive
    wall: Positive
    radius: NotNegative = 0.0  # of the corners
    frames: tuple[Positive, ...] = ()
    frame_depth: NotNegative = 0.0


class Region(_Section):
    """What a named region of the mesh is made of, where it differs from the rest."""

    material: Material | None = None
    thickness: Positive | None = None  # m, of a shell


class SpaceBody(_Section):
    """What slides: a box boom, or whatever the mesh file holds.

    `model` ``auto`` takes the smallest model that represents what the scene asks for (`pmr.scene.choice`).
    """

    model: ModelName = "auto"
    material: Material = Material()
    box: Box | None = None
    thickness: Positive | None = None  # of a shell that is read from a file, m
    regions: dict[str, Region] = {}
    shear: bool = True  # of beams in space: shear deformation and rotary inertia
    shear_correction: Positive = 5.0 / 6.0  # kappa of shells
    section: BeamSection | None = None  # of a beam; by default that of the box

    @model_validator(mode="after")
    def _thickness_is_the_walls(self) -> SpaceBody:
        if self.box is not None and self.thickness is not None:
            raise ValueError("give box.wall or thickness, one of them")
        return self


class SpaceMesh(_Section):
    """Edge lengths of the cells of a box boom in m, or a file with named groups (anything meshio reads).

    `size` around the section, `along` the axis; tail and tip, bottom, top, left (+y) and right must be groups of a
    file, as far as pads, loads and holds name them.
    """

    size: Positive = 0.1
    along: Positive | None = None
    tail_layer: NotNegative = 0.0
    cells: Literal["hexahedra", "tetrahedra"] = "hexahedra"  # of a solid
    elements: Count = 60  # of a beam
    file: ExistingFile | None = None


class PadRing(_Section):
    """Pads around the section at one place along the axis, which stay on the body or move along it.

    `faces` says where they are across each face, m: y on bottom and top, z on the sides; 0 is the middle.
    """

    name: str
    at: Real = 0.0  # centre along the axis, m; of moving ones the distance ahead of s
    moving: bool = Field(default=False, strict=True)
    faces: Annotated[dict[Face, tuple[Real, ...]], Field(min_length=1)]
    length: Positive = 0.3  # m
    width: Positive = 0.08  # m
    stiffness: Positive | Literal["rigid"] = 3e8  # N/m
    unilateral: bool = Field(default=False, strict=True)  # they only push
    clearance: NotNegative | dict[Face, NotNegative] = 0.0  # m, between unilateral pads and the body at rest

    def clearance_on(self, face: Face) -> float:
        """Of the pads on a face, m."""
        return self.clearance.get(face, 0.0) if isinstance(self.clearance, dict) else self.clearance

    @property
    def places(self) -> list[tuple[str, Face, float]]:
        """Name, face and place across of each pad."""
        found = []
        for face, places in self.faces.items():
            for number, across in enumerate(places, start=1):
                which = SIDES[face][int(across > 0.0)] if len(places) == 2 and np.prod(places) < 0.0 else str(number)
                found.append((f"{self.name} {face}" + (f" {which}" if len(places) > 1 else ""), face, float(across)))
        return found


class Holder(_Section):
    """What holds the mean displacement of a group along a direction: a cylinder."""

    name: str
    on: str = "tail"
    direction: Direction = "x"
    stiffness: Positive | Literal["rigid"] = "rigid"  # N/m


class ClampChoice(_Section):
    """Coordinates on a named group that are held at zero: by default all."""

    on: str
    directions: tuple[Direction, ...] = ("x", "y", "z", "rx", "ry", "rz")


class SpaceLoad(_Section):
    """A force in N (moment in N m) along `direction`, spread over a named group or at a distance along x in m."""

    name: str
    on: str | Real = "tip"
    direction: Direction = "z"
    signal: Signal


class Gravity(_Section):
    """The weight of everything; it comes up smoothly within the first `rise` seconds, 0: at once.

    Of `direction` the length does not count: it is kept as a unit vector.
    """

    acceleration: Positive = GRAVITY  # m/s^2
    direction: Annotated[Vector, AfterValidator(unit_vector)] = (0.0, 0.0, -1.0)
    rise: NotNegative = 1.0  # s

    @property
    def signal(self) -> SignalBase:
        """Acceleration in m/s^2 over time."""
        if self.rise == 0.0:
            return Constant(amount=self.acceleration)
        return SmoothRamp(times=(0.0, self.rise), values=(0.0, self.acceleration))


class Observe(_Section):
    """Where the motion is compared and drawn: places along the axis, and a group at the end, whose mean counts."""

    start: Real  # m
    end: Real  # m
    count: Count = 29
    tip: str = "tip"

    @property
    def stations(self) -> tuple[float, ...]:
        """Places along the axis, m."""
        return tuple(float(x) for x in np.linspace(self.start, self.end, self.count))

    def tip_along(self, direction: str) -> str:
        """What the output of the tip's displacement along y or z is called."""
        return f"{self.tip} {direction}"


class Recovery(_Section):
    """Full fields from reduced coordinates: displacement and, if asked for, stress, every so many seconds."""

    every: Positive = 0.02  # s
    stress: bool = Field(default=True, strict=True)
    frames: Count = 101  # of the fields that are kept, for pictures
    series: bool = Field(default=True, strict=True)  # write a series of fields that ParaView opens


class StructureScene(SceneBase):
    """A structure in space that slides through pads: everything that a run is made from."""

    body: SpaceBody
    mesh: SpaceMesh = SpaceMesh()
    clamps: tuple[ClampChoice, ...] = ()
    pads: tuple[PadRing, ...] = ()
    holds: tuple[Holder, ...] = ()
    masses: tuple[PointMass, ...] = ()
    loads: tuple[SpaceLoad, ...] = ()
    gravity: Gravity | None = None
    observe: Observe
    recovery: Recovery | None = None
    simulation: Simulation = Simulation(simulators=("march",))
    compare: Compare = Compare()

    @model_validator(mode="before")
    @classmethod
    def _residual_flexibility_by_default(cls, data: Any) -> Any:
        if not isinstance(data, dict) or not isinstance(data.get("reduction", {}), dict):
            return data
        chosen = data.get("reduction", {})
        if chosen.get("basis", "free_modes") == "free_modes":
            chosen = {"basis": "free_modes", "flexibility": True} | chosen
        else:
            chosen = {"positions": "path"} | chosen
        return data | {"reduction": chosen}

    def __hash__(self) -> int:
        return hash(self.hash)  # some sections hold tables

    @property
    def signals(self) -> dict[str, SignalBase]:
        weight = {"gravity": self.gravity.signal} if self.gravity else {}
        return {load.name: load.signal for load in self.loads} | weight

    def without_loads(self) -> StructureScene:
        loads = tuple(load.model_copy(update={"signal": Constant(amount=0.0)}) for load in self.loads)
        gravity = self.gravity.model_copy(update={"rise": 0.0}) if self.gravity else None
        return self.model_copy(update={"loads": loads, "gravity": gravity, "recovery": None})

    @property
    def mesh_file(self) -> Path | None:
        return self.mesh.file
