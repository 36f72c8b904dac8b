"""A body of a scene as it is written: what it is, what holds it, what it carries, and how its model is reduced."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Annotated

from pydantic import Field

from pmr.errors.text import LONGEST_NAME
from pmr.scene import asked
from pmr.scene.built import ENDS, Body, Load, MeshChoice, PadRing, Slider, Support
from pmr.scene.joints import Joint
from pmr.scene.section import Section
from pmr.scene.structures import PointMass, Probe

FileName = Annotated[str, Field(pattern=r"^\w[\w -]*$", max_length=LONGEST_NAME)]


class OneBody(Section):
    """A body, x along it and z up, and what is on it."""

    body: Body = Field(description="Shape, material and structural model of the section")
    mesh: MeshChoice = Field(default=MeshChoice(), description="Mesh")
    supports: tuple[Support, ...] = Field(
        default=(),
        description="Supports to the ground, which do not move along the section",
    )
    pads: tuple[PadRing, ...] = Field(default=(), description="Pads between the section and the ground")
    slider: Slider | None = Field(default=None, description="Path along which a single body slides")
    masses: tuple[PointMass, ...] = Field(default=(), description="Rigid bodies attached to the section")
    loads: tuple[Load, ...] = Field(default=(), description="Forces and moments")
    observe: asked.Observe = Field(default=asked.Observe(), description="Where motions are compared and drawn")
    probes: tuple[Probe, ...] = Field(default=(), description="Points at which stress, strain or motion is recorded")
    reduction: asked.Reduction = Field(default=asked.Reduction(), description="How the model is reduced")

    @property
    def files(self) -> dict[str, Path]:
        """Files that the model is made from, by the section that names each."""
        named = {"mesh": self.mesh.file, "reduction": self.reduction.file}
        return {section: file for section, file in named.items() if file is not None}

    @property
    def digests(self) -> dict[str, str]:
        """SHA-256 of what these files hold."""
        return {section: hashlib.sha256(file.read_bytes()).hexdigest() for section, file in self.files.items()}

    @property
    def springs(self) -> dict[str, str]:
        """Supports that give way, in each direction, by name: the unit of their force, or moment."""
        held = [(support, d) for support in self.supports if support.stiffness != "rigid" for d in support.held]
        return {support.row_name(d): "N m" if d.startswith("r") else "N" for support, d in held}

    @property
    def load_places(self) -> dict[str, float]:
        """Places of loads along the axis in m, by name, as far as they are known before a mesh is read."""
        places = {load.name: self.place(load.on) for load in self.loads}
        return {name: at for name, at in places.items() if at is not None}

    @property
    def length(self) -> float:
        """Length of the body in m; of a mesh from a file the place where what is observed ends."""
        observed = self.observe.stations or (0.0,)
        return self.body.length or observed[-1] - min(observed[0], 0.0)

    def place(self, on: str | float) -> float | None:
        """Place along the axis, m; None for groups whose place the mesh decides."""
        if isinstance(on, str):
            return ENDS[on] * self.body.length if on in ENDS and self.body.length else None
        return on


class Part(OneBody):
    """A section of a boom; the first one is the base, all others have a joint."""

    name: FileName = Field(description="Name of the section")
    joint: Joint | None = Field(
        default=None,
        description="Joint in which the section slides in the one before it, the next outer one",
    )
