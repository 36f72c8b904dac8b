"""A scene: everything that a run is made from; what a boom of several sections has in common with it."""

from __future__ import annotations

import hashlib
import json
from abc import abstractmethod
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from pmr.scene import asked
from pmr.scene.built import ENDS, WEIGHT, Body, Gravity, Load, MeshChoice, PadRing, Slider, Support
from pmr.scene.names import ALONE
from pmr.scene.section import Section, Text
from pmr.scene.signals import Constant, SignalBase
from pmr.scene.structures import PointMass, Probe


class OneBody(Section):
    """A body, x along it and z up, and what is on it."""

    body: Body = Field(description="What slides")
    mesh: MeshChoice = Field(default=MeshChoice(), description="How fine it is divided")
    supports: tuple[Support, ...] = Field(default=(), description="What holds it to the ground, in one place")
    pads: tuple[PadRing, ...] = Field(default=(), description="Pads between it and the ground")
    masses: tuple[PointMass, ...] = Field(default=(), description="Rigid bodies attached to it")
    loads: tuple[Load, ...] = Field(default=(), description="Forces and moments")
    observe: asked.Observe = Field(default=asked.Observe(), description="Where motions are compared and drawn")
    probes: tuple[Probe, ...] = Field(default=(), description="Where stress, strain or motion is followed")
    reduction: asked.Reduction = Field(default=asked.Reduction(), description="How the model is reduced")

    @property
    def files(self) -> dict[str, Path]:
        """What is read to make the model, by the section that names it."""
        named = {"mesh": self.mesh.file, "reduction": self.reduction.file}
        return {section: file for section, file in named.items() if file is not None}

    @property
    def digests(self) -> dict[str, str]:
        """SHA-256 of what these files hold."""
        return {section: hashlib.sha256(file.read_bytes()).hexdigest() for section, file in self.files.items()}

    @property
    def springs(self) -> dict[str, str]:
        """Supports that give way, in each direction, by name: the unit of their force, or moment."""
        held = [(one, d) for one in self.supports if one.stiffness != "rigid" for d in one.held]
        return {one.row_name(d): "N m" if d.startswith("r") else "N" for one, d in held}


class Whole(Section):
    """What a scene of one body and a boom of several sections have in common; equal `hash`, equal results."""

    title: Text = Field(description="For reports")
    damping: asked.Damping = Field(default=asked.Damping(), description="Of the material")
    time: asked.TimeChoice = Field(description="Simulated time and its steps")
    recovery: asked.Recovery | None = Field(default=None, description="Fields and stresses from reduced coordinates")
    simulation: asked.Simulation = Field(default=asked.Simulation(), description="Who simulates")
    compare: asked.Compare = Field(default=asked.Compare(), description="What the reduced model is compared with")
    free_motions: Literal["refused", "allowed"] = Field(
        default="refused",
        description="Motions of the whole or a section that no support, pad or cylinder resists somewhere on the way: "
        "loads move it along them without limit; pads that only push count as holding",
    )

    def __hash__(self) -> int:
        return hash(self.hash)  # some sections hold tables

    @property
    def hash(self) -> str:
        """Digest of what decides the result: all but title, published figures and who simulates.

        A key at its default counts as one that is not there: what was computed stays valid when there is a new key.
        """
        left_out = {"title", "published", "simulation", "section"}
        content = self.model_dump(mode="json", exclude=left_out, exclude_defaults=True)
        for body, described in self._bodies(content):
            for section, digest in body.digests.items():
                described[section]["file"] = digest
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]

    @property
    @abstractmethod
    def bodies(self) -> Mapping[str, OneBody]:
        """Each body by its name; a body alone has the empty one."""

    @property
    def files_read(self) -> dict[str, Path]:
        """What is read to make its models, by the table that names it, such as ``mesh`` or ``sections[1].mesh``."""
        content = dict[str, Any](sections=[{} for _ in getattr(self, "sections", ())])
        return {
            ("" if described is content else f"sections[{number}].") + table: file
            for number, (body, described) in enumerate(self._bodies(content))
            for table, file in body.files.items()
        }

    @property
    def recorded(self) -> dict[str, Any]:
        """What a saved model says of the scene that it was made from: ``scene``, ``scene_hash``, ``files``.

        Files are named without their folders, and by the SHA-256 of what they hold.
        """
        content = self.model_dump(mode="json", exclude={"published", "section"})
        for body, described in self._bodies(content):
            for table, file in body.files.items():
                described[table]["file"] = file.name
        files = {table: hashlib.sha256(file.read_bytes()).hexdigest() for table, file in self.files_read.items()}
        return {"scene": content, "scene_hash": self.hash, "files": files}

    @abstractmethod
    def _bodies(self, content: dict[str, Any]) -> Iterable[tuple[OneBody, dict[str, Any]]]:
        """Each body, and where `content` says what it is."""


class Scene(OneBody, Whole):
    """A body that slides, x along it and z up."""

    slider: Slider = Field(description="The path of what slides")
    gravity: Gravity | None = Field(default=None, description="The weight of everything")
    accuracy: asked.Accuracy | None = Field(
        default=None, description="An allowed error, in place of coordinates and step"
    )
    budget: asked.Budget | None = Field(default=None, description="What a model may cost, in place of an allowed error")
    published: asked.Published | None = Field(default=None, description="Figures from a publication")

    __hash__ = Whole.__hash__  # pydantic would take the one it has made for `OneBody`, of its fields

    def _bodies(self, content: dict[str, Any]) -> Iterable[tuple[OneBody, dict[str, Any]]]:
        return [(self, content)]

    @property
    def bodies(self) -> Mapping[str, OneBody]:
        """Itself, under the empty name."""
        return {ALONE: self}

    @property
    def ordered(self) -> asked.Accuracy | asked.Budget | None:
        """What decides coordinates and step in place of the scene."""
        return self.accuracy or self.budget

    @property
    def signals(self) -> dict[str, SignalBase]:
        """What drives each input of the model, by its name."""
        weight = {WEIGHT: self.gravity.signal} if self.gravity else {}
        return {load.name: load.signal for load in self.loads} | weight

    @property
    def load_places(self) -> dict[str, float]:
        """Places of loads along the axis in m, by name, as far as they are known before a mesh is read."""
        places = {load.name: self.place(load.on) for load in self.loads}
        return {name: at for name, at in places.items() if at is not None}

    def without_loads(self) -> Scene:
        """The scene with nothing but zeros for loads: what its modes depend on."""
        loads = tuple(load.model_copy(update={"signal": Constant(amount=0.0)}) for load in self.loads)
        gravity = self.gravity.model_copy(update={"rise": 0.0}) if self.gravity else None
        return self.model_copy(update={"loads": loads, "gravity": gravity, "recovery": None})

    @property
    def path_bounds(self) -> tuple[float, float]:
        """Smallest and largest s(t) in m over the simulated time."""
        return self.slider.path.bounds(0.0, self.time.end)

    @property
    def travel(self) -> tuple[float, float]:
        """Smallest and largest s in m that the model is made for."""
        return self.slider.travel or self.path_bounds

    @property
    def points(self) -> tuple[float, ...]:
        """Distances ahead of s, m, of the points that slide: none where pads do."""
        if self.slider.offsets is not None:
            return self.slider.offsets
        return () if any(ring.moving for ring in self.pads) else (0.0,)

    @property
    def length(self) -> float:
        """Of the body in m, or of what is observed of it where a mesh that is read says how long it is."""
        observed = self.observe.stations or (0.0,)
        return self.body.length or observed[-1] - observed[0]

    def place(self, on: str | float) -> float | None:
        """Where a place is along the axis, m; None for groups whose place the mesh decides."""
        if isinstance(on, str):
            return ENDS[on] * self.body.length if on in ENDS and self.body.length else None
        return on
