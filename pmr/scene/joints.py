"""Tables of a section of a boom, and of the joint in which the section slides in the next outer section.

The joint has pads at both ends, a cylinder or rope, and a drive: an extension, an overlap or another section.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Literal

from numpy.typing import ArrayLike
from pydantic import Discriminator, Field, Tag, model_validator

from pmr.errors import LONGEST_NAME
from pmr.scene import run_settings
from pmr.scene.built import ENDS, Body, Load, MeshChoice, PadPlaces, PadRing, Slider, Support
from pmr.scene.cylinder import SHEAR_STIFFNESS, STRIBECK_SPEED, FreeExtension, unused_friction_keys
from pmr.scene.keys import (
    OVER_TIME,
    AxialStiffness,
    Count,
    Friction,
    Length,
    Place,
    Quantity,
    SceneTable,
    Speed,
    Stiffness,
    Switch,
    Usual,
    key_error,
)
from pmr.scene.signals import Constant, Signal, SignalBase
from pmr.scene.signals.base import Array, Floats, Interval, Strand
from pmr.scene.structures import PointMass, Probe


@dataclass(frozen=True, kw_only=True)
class FrictionLaw:
    """Constants of a friction law, in the order of src/law.h; with the defaults there is no friction.

    They are fields of `pmr.system.contacts.Contact`, and keys of a ring of pads have their names (`RingFriction`).
    """

    friction: float = 0.0  # coefficient while the contact slides; of a cylinder, a force in N
    static_friction: float = 0.0  # the same at rest; 0: that while it slides
    stribeck_speed: float = STRIBECK_SPEED  # v_s in m/s

    @property
    def constants(self) -> tuple[float, ...]:
        """Constants in the kernel's order."""
        return tuple(getattr(self, constant.name) for constant in fields(FrictionLaw))


class RingFriction(SceneTable):
    """Friction of a ring of pads along the boom; each key is a field of `pmr.system.contacts.Contact` too."""

    friction: Friction = Field(default=0.0, description="Coulomb's coefficient of friction along the boom")
    static_friction: Friction = Field(
        default=0.0,
        description="Coefficient of friction of pads at rest, from which it falls to that of sliding; 0: no other",
    )
    stribeck_speed: Annotated[Speed, Usual(1e-5, 1.0)] = Field(
        default=STRIBECK_SPEED, description="Speed by which friction falls from that at rest to that of sliding"
    )
    shear_stiffness: Stiffness = Field(
        default=SHEAR_STIFFNESS, description="Stiffness of each pad along the boom while it sticks"
    )

    @property
    def unused_keys(self) -> dict[str, str]:
        """Keys of the friction that have no effect because of its other keys, with the reason."""
        return unused_friction_keys(self.friction, self.static_friction, "static_friction")


class JointPads(RingFriction, PadPlaces):
    """A ring of pads at one end of a joint, between a section and the next outer one.

    Without `faces`, which only planar beams allow, a ring is a point on the axis; if it only pushes, there is one point
    above and one below.
    """

    unilateral: Switch = Field(default=True, description="Whether pads only push, and lift off where they would pull")

    @model_validator(mode="after")
    def _check_friction_and_clearance(self) -> JointPads:
        """Refuse a clearance of pads that hold both ways, or on faces without pads, and too small a static friction.

        An allowed pressure of pads without a size is refused, too.
        """
        if self.clearance_fault:
            raise key_error("clearance", self.clearance, self.clearance_fault)
        if self.allowed_pressure is not None and self.faces is None:
            raise ValueError("an allowed pressure goes with faces, on which pads have a length and a width")
        if self.static_friction and not 0.0 < self.friction <= self.static_friction:
            raise ValueError(f"static_friction = {self.static_friction:g} is allowed beside a smaller friction")
        return self


class LineOfAction(SceneTable):
    """Line along which a cylinder or rope acts, parallel to the axis of the sections."""

    offset: Annotated[tuple[Place, Place], Usual(0.0, 5.0)] | None = Field(
        default=None,
        description="Place of its line of action off the axis, along y and z; by default it acts on the centroid of "
        "each tail",
    )


class Cylinder(LineOfAction):
    """Hydraulic cylinder or rope that holds a section, between the tails of this section and the next outer one."""

    stiffness: Stiffness | Literal["rigid"] = Field(default="rigid", description="Stiffness along the axis")


class Rope(LineOfAction):
    """Rope or chain that moves a section; its stiffness is strands * EA over the length under tension.

    If section k `follows` section k-1, the rope is fixed at the head of section k-2, runs over a sheave at the head of
    section k-1 and ends at the tail of section k.  If the section has an extension of its own, a winch pulls the rope.
    """

    EA: Annotated[AxialStiffness, Usual(2e5, 5e9)] = Field(
        description="Stiffness of one strand: Young's modulus of the rope times its metallic area"
    )
    strands: Count = Field(default=1, description="Number of parallel ropes or chains")
    length: Annotated[Length, Usual(0.0, 30.0, "reach")] | None = Field(
        default=None,
        description="Length of a strand under tension where this extension is 0 (of a section that follows by default "
        "from the geometry of the sections)",
    )
    lengthens: Annotated[float, Quantity("1", -1e3, 1e3)] = Field(
        default=0.0, description="By how much that grows with this extension: -1 of a rope that a winch takes in"
    )


def _extension_tag(data: object) -> str:
    """Return ``free`` for an extension of this kind, else `OVER_TIME`; pydantic chooses the extension's type by it.

    `OVER_TIME` stands for a signal.  The tag `OVER_TIME` is no key of a scene, so that messages leave it out.
    """
    kind = data.get("kind") if isinstance(data, dict) else getattr(data, "kind", None)
    return "free" if kind == "free" else OVER_TIME


Extension = Annotated[
    Annotated[Signal, Usual(0.0, 2.0, "reach", "m"), Tag(OVER_TIME)] | Annotated[FreeExtension, Tag("free")],
    Discriminator(_extension_tag),
]


class Joint(SceneTable):
    """Joint in which a section slides in the next outer one: by `extension`, `overlap`, or as it `follows` another."""

    extension: Extension | None = Field(
        default=None,
        description="Distance of this section's tail ahead of the tail of the next outer section, over time, in m; of "
        'kind "free": its motion is computed, with what drives it',
    )
    overlap: Annotated[Signal, Usual(0.0, 2.0, "reach", "m")] | None = Field(
        default=None,
        description="Length of this section inside the next outer one, over time, in m; in place of `extension`",
    )
    follows: str | None = Field(
        default=None, description="Name of a section that this one follows: extension = ratio * its extension + offset"
    )
    ratio: Annotated[float, Quantity("1", -1e3, 1e3)] = Field(
        default=1.0, description="Ratio of this extension to that of the section it follows"
    )
    offset: Annotated[Place, Usual(0.0, 2.0, "reach")] = Field(
        default=0.0, description="This extension where that of the section it follows is zero"
    )
    tail: tuple[JointPads, ...] = Field(min_length=1, description="Pads that travel with this section's tail")
    mouth: tuple[JointPads, ...] = Field(
        default=(), description="Pads at the mouth of the next outer section; a carriage on that section has none"
    )
    cylinder: Cylinder = Field(
        default=Cylinder.model_construct(), description="Cylinder that holds and drives the section along the boom"
    )
    rope: Rope | None = Field(
        default=None, description="Rope or chain that moves the section, in place of its cylinder"
    )
    rigid_overlap: Switch = Field(
        default=False,
        description="Whether both sections stay straight from the first pads at the tail to those at the mouth",
    )

    @model_validator(mode="after")
    def _check_drive(self) -> Joint:
        """Refuse a joint with contradictory keys.

        Exactly one of extension, overlap and follows must be given; a rope excludes a cylinder with a stiffness;
        overlap and rigid_overlap need pads at the mouth.
        """
        if sum(signal is not None for signal in (self.extension, self.overlap, self.follows)) != 1:
            raise ValueError("give extension, overlap or follows, one of them")
        if self.rope is not None and self.cylinder != Cylinder():
            raise ValueError("give rope or keys of cylinder, one of them: what moves the section")
        if not self.mouth and (self.rigid_overlap or self.overlap is not None):
            raise ValueError("overlap and rigid_overlap need pads at the mouth: a carriage without them has extension")
        return self

    @property
    def driver(self) -> Literal["cylinder", "rope"]:
        """What drives the section, by the key of its table."""
        return "cylinder" if self.rope is None else "rope"

    @property
    def line(self) -> tuple[float, float] | None:
        """Place y, z in m of the line of action of the rope or cylinder; None for the centroid of each tail."""
        return (self.cylinder if self.rope is None else self.rope).offset

    @property
    def rings(self) -> tuple[JointPads, ...]:
        """Rings of pads of the joint: those at the section's tail, then those at the mouth."""
        return (*self.tail, *self.mouth)


class ScaledSignal(SignalBase):
    """Signal ``offset + ratio * signal``."""

    signal: SignalBase
    ratio: float
    offset: float

    @property
    def signals(self) -> tuple[SignalBase, ...]:
        return (self.signal,)

    def value(self, t: ArrayLike) -> Array:
        return self.offset + self.ratio * self.signal.value(t)

    def rate(self, t: ArrayLike) -> Array:
        return self.ratio * self.signal.rate(t)

    def second_rate(self, t: ArrayLike) -> Array:
        return self.ratio * self.signal.second_rate(t)

    @property
    def strands(self) -> tuple[Strand, ...]:
        """Strands whose sum is the scaled signal: those of the signal itself, each scaled."""
        scaled = (
            replace(strand, polynomials=self.ratio * strand.polynomials, amplitude=self.ratio * strand.amplitude)
            for strand in self.signal.strands
        )
        return (*Constant(amount=self.offset).strands, *scaled)

    @property
    def breaks(self) -> Floats:
        return self.signal.breaks

    def bounds(self, start: float, end: float) -> Interval:
        ends = [self.offset + self.ratio * at for at in self.signal.bounds(start, end)]
        return Interval(min(ends), max(ends))

    def highest_frequency(self, start: float, end: float) -> float:
        return self.signal.highest_frequency(start, end)


FileName = Annotated[str, Field(pattern=r"^\w[\w -]*$", max_length=LONGEST_NAME)]


class OneBody(SceneTable):
    """A body with x along it and z up, and everything that holds, loads, observes or reduces it."""

    body: Body = Field(description="Shape, material and structural model of the section")
    mesh: MeshChoice = Field(default=MeshChoice.model_construct(), description="Mesh")
    supports: tuple[Support, ...] = Field(
        default=(), description="Supports to the ground, which do not move along the section"
    )
    pads: tuple[PadRing, ...] = Field(default=(), description="Pads between the section and the ground")
    slider: Slider | None = Field(default=None, description="Path along which a single body slides")
    masses: tuple[PointMass, ...] = Field(default=(), description="Rigid bodies attached to the section")
    loads: tuple[Load, ...] = Field(default=(), description="Forces and moments")
    observe: run_settings.Observe = Field(
        default=run_settings.Observe.model_construct(), description="Where motions are compared and drawn"
    )
    probes: tuple[Probe, ...] = Field(default=(), description="Points at which stress, strain or motion is recorded")
    reduction: run_settings.Reduction = Field(default=run_settings.Reduction(), description="How the model is reduced")

    @property
    def files(self) -> dict[str, Path]:
        """Files that the scene names for the model, by table: ``mesh``, ``mesh.groups`` and ``reduction``."""
        groups = None if self.mesh.groups is None else self.mesh.groups.file
        named = {"mesh": self.mesh.file, "mesh.groups": groups, "reduction": self.reduction.file}
        return {section: file for section, file in named.items() if file is not None}

    @property
    def file_digests(self) -> dict[str, str]:
        """SHA-256 of the content of each of `files`, by the same keys."""
        return {section: hashlib.sha256(file.read_bytes()).hexdigest() for section, file in self.files.items()}

    @property
    def spring_units(self) -> dict[str, str]:
        """Unit (N or N m) of the force or moment of each row of a support with a stiffness, by the row's name."""
        springs = [support for support in self.supports if support.stiffness != "rigid"]
        held = [(support, d) for support in springs for d in support.held_directions]
        return {support.row_name(d): "N m" if d.startswith("r") else "N" for support, d in held}

    @property
    def length(self) -> float:
        """Length of the body in m.

        For a mesh file it is the distance from x = 0, or from the first observed station if that lies below 0, to the
        last one; 0 without stations.
        """
        observed = self.observe.stations or (0.0,)
        return self.body.length or observed[-1] - min(observed[0], 0.0)

    def position_of(self, on: str | float) -> float | None:
        """Return the position in m along the axis of the group or number `on`; None for a group whose place is unknown.

        Only a mesh knows where groups other than the ends are.
        """
        if isinstance(on, str):
            return ENDS[on] * self.body.length if on in ENDS and self.body.length else None
        return on


class BoomSection(OneBody):
    """A section of a boom; the first section is the base, all others have a joint."""

    name: FileName = Field(description="Name of the section")
    joint: Joint | None = Field(
        default=None, description="Joint in which the section slides in the one before it, the next outer one"
    )

    @property
    def keyed_rings(self) -> dict[str, PadRing | JointPads]:
        """Rings of pads on the section and of its joint, by their keys in the section, such as ``joint.tail[0]``."""
        rings: dict[str, tuple[PadRing | JointPads, ...]] = {"pads": self.pads}
        if self.joint is not None:
            rings |= {"joint.tail": self.joint.tail, "joint.mouth": self.joint.mouth}
        return {f"{key}[{k}]": ring for key, of_key in rings.items() for k, ring in enumerate(of_key)}

    @property
    def rings(self) -> tuple[PadRing | JointPads, ...]:
        """Rings of pads on the section and of its joint."""
        return tuple(self.keyed_rings.values())

    @property
    def has_even_walls(self) -> bool:
        """Whether the section is a box whose walls stay the same along it, without frames and regions."""
        box = self.body.box
        return box is not None and not box.varying_keys and not box.frames and not self.body.regions
