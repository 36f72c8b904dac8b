"""The scene: the bodies from the base outwards, and the settings of a run about all of them."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import ConfigDict, Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from pmr.errors import InputError
from pmr.files.arrays import Indices
from pmr.scene import run_settings
from pmr.scene.built import WEIGHT, Body, Gravity, Load, MeshChoice, PadRing, Slider, Support
from pmr.scene.cylinder import FreeExtension, LuffingCylinder
from pmr.scene.frame import Frame
from pmr.scene.hoist import Hoist
from pmr.scene.joints import BoomSection, Joint, OneBody, ScaledSignal
from pmr.scene.keys import ALONE, LUFFING, SLIDER, SceneTable, Schema, Text, key_error
from pmr.scene.signals import Constant, SignalBase
from pmr.scene.signals.base import Array, Interval
from pmr.scene.structures import Damping, PointMass
from pmr.scene.tomlfiles import merge_tables


class Surroundings(SceneTable):
    """Weight, moving frame, hoist, start and damping of all bodies together."""

    title: Text = Field(description="Title of the report")
    gravity: Gravity | None = Field(
        default=None,
        description="Weight of all parts.  Without this table a single body has no weight, and several sections have "
        "theirs, which presses them on their pads",
    )
    frame: Frame | None = Field(
        default=None, description="Luffing and slewing of the whole boom, and motion of its base"
    )
    hoist: Hoist | None = Field(
        default=None, description="Rope over head sheaves with a hook and a payload that swings"
    )
    start: Literal["rest", "equilibrium"] = Field(
        default="rest",
        description="Initial state: undeformed and at rest, or in equilibrium under the loads at t = 0.  A single body "
        "begins at rest by default, several sections in equilibrium: loose in their pads they would begin with a fall",
    )
    damping: Damping = Field(default=Damping.model_construct(), description="Damping of the structure")


class CommonTables(Surroundings):
    """Tables about all bodies together."""

    time: run_settings.TimeChoice = Field(description="Simulated time and its steps")
    recovery: run_settings.Recovery | None = Field(
        default=None, description="Fields of displacement and stress on the whole mesh"
    )
    fatigue: run_settings.Fatigue | None = Field(
        default=None, description="Fatigue damage at probes that measure stress"
    )
    simulation: run_settings.Simulation = Field(
        default=run_settings.Simulation.model_construct(), description="Programs that simulate the models"
    )
    compare: run_settings.Compare = Field(
        default=run_settings.Compare.model_construct(), description="What the reduced model is compared with"
    )
    accuracy: run_settings.Accuracy | None = Field(
        default=None, description="Allowed error, in place of a number of coordinates and a step"
    )
    budget: run_settings.Budget | None = Field(
        default=None, description="Allowed cost of the model, in place of an allowed error"
    )
    published: run_settings.Published | None = Field(default=None, description="Figures from a publication")
    free_motions: Literal["refused", "allowed"] = Field(
        default="refused",
        description="Whether rigid-body motions are allowed that no support, pad or cylinder resists somewhere on the "
        "path; a load along such a motion moves the boom without limit.  Pads that only push count as resisting",
    )

    @model_validator(mode="before")
    @classmethod
    def _fill_in_start(cls, data: object) -> object:
        """Fill in the default start and, for several sections, the weight; in equilibrium it acts from t = 0 on."""
        if not isinstance(data, Mapping):
            return data
        sections = data.get("sections", ())
        several = isinstance(sections, list | tuple) and len(sections) > 1
        start = data.get("start", "equilibrium" if several else "rest")
        gravity = data.get("gravity", {} if several else None)
        if isinstance(gravity, dict) and start == "equilibrium":
            gravity = {"rise": 0.0} | gravity
        return {**data, "start": start, "gravity": gravity}


class SectionTables(CommonTables):
    """Bodies from the base outwards; properties such as `body` and `loads` are those of the only body.

    If there are several bodies, these properties raise an InputError.
    """

    sections: Annotated[tuple[BoomSection, ...], Field(min_length=1)] = Field(description="From the base out")

    @property
    def only_section(self) -> BoomSection:
        """The only body of the scene; raises InputError if there are several bodies."""
        if len(self.sections) > 1:
            allowed = "a scene of one body is allowed here; pmr run takes booms of several sections"
            raise InputError("scene", "sections", None, allowed)
        return self.sections[0]

    @property
    def body(self) -> Body:
        return self.only_section.body

    @property
    def mesh(self) -> MeshChoice:
        return self.only_section.mesh

    @property
    def supports(self) -> tuple[Support, ...]:
        return self.only_section.supports

    @property
    def pads(self) -> tuple[PadRing, ...]:
        return self.only_section.pads

    @property
    def masses(self) -> tuple[PointMass, ...]:
        return self.only_section.masses

    @property
    def loads(self) -> tuple[Load, ...]:
        return self.only_section.loads

    @property
    def observe(self) -> run_settings.Observe:
        return self.only_section.observe

    @property
    def reduction(self) -> run_settings.Reduction:
        return self.only_section.reduction

    @property
    def slider(self) -> Slider:
        """Path of the only body, constant s = 0 for a body that does not slide."""
        return self.only_section.slider or Slider(path=Constant(amount=0.0))

    @property
    def signals(self) -> dict[str, SignalBase]:
        """Signals over time of the only body's loads and of its weight, by name.

        Users of Exudyn pass them to `pmr.simulation.exudyn.add_sliding_body`.  A load along an axis of the ground and
        wind have several inputs, whose names begin with the load's (`pmr.scene.choice.input_directions`).
        """
        weight = {WEIGHT: self.gravity.signal} if self.gravity else {}
        return {load.name: load.signal for load in self.loads} | weight

    @property
    def path_bounds(self) -> Interval:
        """Smallest and largest s(t) in m over the simulated time."""
        return Interval(*self.slider.path.bounds(0.0, self.time.end))

    @property
    def travel(self) -> Interval:
        """Smallest and largest s in m for which the model is made."""
        return Interval(*(self.slider.travel or self.path_bounds))

    @property
    def points(self) -> tuple[float, ...]:
        """Distances in m of the only body's sliding points ahead of s.

        If the slider has no `offsets`, the result is (0.0,).  It is empty if pads slide on the body, or if nothing
        slides on it.
        """
        slider = self.only_section.slider
        if slider is not None and slider.offsets is not None:
            return slider.offsets
        return () if slider is None or any(ring.moving for ring in self.pads) else (0.0,)


#: Keys of a body, which a scene of one body may have at its top.
OF_A_BODY = frozenset(OneBody.model_fields)


class BodyFile(OneBody, CommonTables):
    """A body, x along it and z up, which may slide."""


def _describe_common_keys(schema: Schema) -> None:
    """Change a JSON schema in place: describe the table of the keys shared by all sections."""
    about = "Keys that every section has unless it has its own"
    schema["properties"]["section"] = {"type": "object", "description": about, "default": {}}


class Scene(SectionTables):
    """Sections from the base outwards, each of which slides in the one before it; a single body is one section.

    Keys that several sections share are written once, in the table `section`.
    """

    model_config = ConfigDict(json_schema_extra=_describe_common_keys)

    @model_validator(mode="before")
    @classmethod
    def _from_either_form(cls, data: object) -> object:
        """Return the fields of a scene, from a body at the top of a file or from sections and their shared keys.

        Refuses `section` if it is no table; content of another form is returned unchanged, for pydantic to refuse.
        """
        if not isinstance(data, Mapping):
            return data
        if "sections" not in data:
            return cls._single_body_fields(BodyFile.model_validate(data))
        common, sections = data.get("section", {}), data["sections"]
        content = {key: value for key, value in data.items() if key != "section"}
        if not isinstance(common, dict):
            raise key_error("section", None, "a table of keys is allowed")
        if not isinstance(sections, list):
            return content
        base = {key: value for key, value in common.items() if key != "joint"}  # the base slides in no other section
        merged = list[Any]()
        for number, part in enumerate(sections):
            merged.append(_merge_section(common if number else base, part) if isinstance(part, dict) else part)
        return content | {"sections": merged}

    @classmethod
    def from_body(cls, written: BodyFile) -> Self:
        """Return the scene of a body that a file describes at its top."""
        return cls.model_validate(cls._single_body_fields(written))

    @staticmethod
    def _single_body_fields(written: BodyFile) -> dict[str, Any]:
        """Return the fields of a `Scene` of one body, by name, from the file `written`.

        The only section is named `ALONE`.
        """
        part = BoomSection.model_construct(name=ALONE, **{key: getattr(written, key) for key in OneBody.model_fields})
        return {key: getattr(written, key) for key in CommonTables.model_fields} | {"sections": (part,)}

    def __hash__(self) -> int:
        return hash(self.hash)  # some sections hold tables

    @model_serializer(mode="wrap")
    def _file_content(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Return the content of the scene for files; a body without a name has its keys at the top."""
        content: dict[str, Any] = handler(self)
        return content if self.sections[0].name else _lift_body_keys(content)

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Return a copy with the fields in `update` changed; keys of a body change the only body.

        None changes nothing.
        """
        changed = dict(update or {})
        of_body = {key: changed.pop(key) for key in OF_A_BODY & set(changed)}
        if of_body:
            changed["sections"] = (self.only_section.model_copy(update=of_body),)
        return super().model_copy(update=changed, deep=deep)

    def vary_sections(self, keys_of: Callable[[BoomSection], Mapping[str, object]], **keys: object) -> Self:
        """Return a copy in which each section has the keys that `keys_of` returns for that section.

        `keys` are further keys, of the scene itself.
        """
        sections = tuple(part.with_keys(**keys_of(part)) for part in self.sections)
        return self.with_keys(sections=sections, **keys)

    @property
    def hash(self) -> str:
        """Digest (16 hex digits) of the keys that decide the results: all but `title`, `published` and `simulation`.

        Keys at their default value are left out, so that stored results stay valid when a new version adds a key.
        Files of the sections count by their contents: moving a file keeps the digest, editing it changes the digest.
        """
        content = self.model_dump(mode="json", exclude={"title", "published", "simulation"}, exclude_defaults=True)
        content = self._replace_files(content, [part.file_digests for part in self.sections])
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]

    @property
    def files_read(self) -> dict[str, Path]:
        """Files from which models are made, by the table that names each, such as ``mesh`` or ``sections[1].mesh``."""
        several = len(self.sections) > 1
        return {
            (f"sections[{number}]." if several else "") + table: file
            for number, part in enumerate(self.sections)
            for table, file in part.files.items()
        }

    @property
    def provenance(self) -> dict[str, Any]:
        """Record of the scene in a saved model: ``scene``, ``scene_hash`` and ``files`` (SHA-256 by table).

        Files are named without their folders.
        """
        names = [{table: file.name for table, file in part.files.items()} for part in self.sections]
        content = self._replace_files(self.model_dump(mode="json", exclude={"published"}), names)
        files = {table: hashlib.sha256(file.read_bytes()).hexdigest() for table, file in self.files_read.items()}
        return {"scene": content, "scene_hash": self.hash, "files": files}

    def _replace_files(self, content: dict[str, Any], values: Sequence[Mapping[str, str]]) -> dict[str, Any]:
        """Return the `content` of the scene with other values of its keys ``file``; `content` is changed.

        `values` are those of each section, by the table that has the key.  A body alone has its keys at the top.
        """
        if len(self.sections) == 1:
            content = _lift_body_keys(content)
        for of_section, written in zip(values, content.get("sections", [content]), strict=True):
            for table, value in of_section.items():
                reduce(getitem, table.split("."), written)["file"] = value
        return content

    def file_key(self, key: str) -> str:
        """Return a key of the scene as in its file.

        A key of the body loses ``sections[0].`` if the file has a single [body], and gets it if the file has a list of
        one section.
        """
        if len(self.sections) > 1:
            return key
        if not self.sections[0].name:
            return re.sub(r"^sections\[0\]\.", "", key)
        return f"sections[0].{key}" if re.split(r"\W", key)[0] in OF_A_BODY else key

    def section_key(self, number: int, key: str) -> str:
        """Return a key of section `number` as in the scene's file; a key that no body has is returned unchanged."""
        return self.file_key(f"sections[{number}].{key}") if re.split(r"\W", key)[0] in OF_A_BODY else key

    # -- all bodies

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the bodies; a body alone has the empty name."""
        return (ALONE,) if len(self.sections) == 1 else tuple(part.name for part in self.sections)

    @property
    def bodies(self) -> Mapping[str, BoomSection]:
        """Bodies of the scene by name, from the base outwards."""
        return dict(zip(self.names, self.sections, strict=True))

    @property
    def goal(self) -> run_settings.Accuracy | run_settings.Budget | None:
        """Accuracy or budget by which coordinates and step are chosen; None if the scene sets both itself."""
        return self.accuracy or self.budget

    @property
    def paths(self) -> dict[str, SignalBase]:
        """Paths over time in m by name: extensions of all sections but the base, or ``"slider"`` of the only body."""
        if len(self.sections) == 1:
            return {SLIDER: self.slider.path}
        return {self.names[k]: self.extension(k) for k in range(1, len(self.sections))}

    @property
    def recovered_steps(self) -> Indices:
        """Numbers (S,) of the steps whose states are recovered; empty if the scene does not ask for recovery."""
        if self.recovery is None:
            return np.empty(0, np.int64)
        return np.arange(0, self.time.steps + 1, round(self.recovery.every / self.time.step))

    @property
    def holding_cylinder(self) -> LuffingCylinder | None:
        """Luffing cylinder with a stiffness, which holds the base at its lug; None if supports hold the base there."""
        cylinder = None if self.frame is None else self.frame.cylinder
        return cylinder if cylinder is not None and cylinder.stiffness is not None else None

    @property
    def pivot_height(self) -> float:
        """Height in m above the ground of the pivot or, without a frame, of the base's tail; 0 if no height is set.

        A height in the table of the hoist counts before one in the table of the ground.
        """
        ground = None if self.frame is None else self.frame.ground
        of_hoist = 0.0 if self.hoist is None else self.hoist.pivot_height
        return of_hoist or (0.0 if ground is None else ground.height)

    @property
    def driven_paths(self) -> dict[str, SignalBase]:
        """Signals of all `paths` by name, and the luffing angle in rad if a luffing cylinder holds the base."""
        if self.frame is None or self.holding_cylinder is None:
            return self.paths
        return self.paths | {LUFFING: self.frame.angles.luffing}

    @property
    def present_frame(self) -> Frame:
        """The frame of a scene that has one; for others, not to be called."""
        assert self.frame is not None
        return self.frame

    def joint(self, number: int) -> Joint:
        """Return the joint in which section `number` (1 or more) slides."""
        joint = self.sections[number].joint
        assert joint is not None  # as the checks say
        return joint

    def extension(self, number: int) -> SignalBase:
        """Return the distance in m over time of the tail of section `number` (from 1) ahead of the previous tail.

        A free extension has the stand-in `FreeExtension.first` until it is computed.
        """
        joint = self.joint(number)
        if isinstance(joint.extension, FreeExtension):
            return joint.extension.first
        if joint.extension is not None:
            return joint.extension
        if joint.overlap is not None:
            return ScaledSignal(signal=joint.overlap, ratio=-1.0, offset=self.sections[number - 1].length)
        followed = self.extension(self.names.index(str(joint.follows)))
        return ScaledSignal(signal=followed, ratio=joint.ratio, offset=joint.offset)

    @property
    def free_extensions(self) -> dict[int, FreeExtension]:
        """Extensions that are computed with the boom's motion, by the number of their section."""
        extensions = {k: part.joint.extension for k, part in enumerate(self.sections) if part.joint is not None}
        return {k: extension for k, extension in extensions.items() if isinstance(extension, FreeExtension)}

    @property
    def extension_keys(self) -> tuple[str, ...]:
        """Keys of the extensions that are computed with the boom's motion."""
        return tuple(f"sections[{number}].joint.extension" for number in self.free_extensions)

    @property
    def computed_key(self) -> str | None:
        """Key of the motion that is computed with the boom's, such as ``frame.machine``; None if all is prescribed."""
        if self.extension_keys:
            return self.extension_keys[0]
        key = None if self.frame is None else self.frame.computed_key
        return key and f"frame.{key}"

    def reach(self, t: ArrayLike) -> Array:
        """Return the distances in m along the boom from the base's tail to the tip at the times t in s (any shape).

        The result has the shape of t.  If the last section is a mass on a wheel, the distances are those to its wheel.
        """
        last = self.sections[-1]
        end = last.length if last.body.mover is None else 0.0
        tails = [self.extension(number).value(t) for number in range(1, len(self.sections))]
        return np.asarray(np.sum([np.zeros_like(np.asarray(t, float)), *tails], axis=0) + end)

    def path_positions(self, t: ArrayLike) -> Array:
        """Return s of the only body, or `reach` of several sections, in m at the times t in s (any shape).

        The result has the shape of t.
        """
        return self.reach(t) if len(self.sections) > 1 else np.asarray(self.slider.path.value(t))

    def without_loads(self) -> Self:
        """Return the scene with zero loads of sections, full weight at t = 0 and no recovery of stresses.

        Scenes that differ only in loads, weight and recovery have the same modes.  This method returns equal scenes for
        all of them.
        """
        gravity = self.gravity.with_keys(rise=0.0) if self.gravity else None
        return self.vary_sections(
            lambda part: {"loads": tuple(load.with_keys(signal=Constant(amount=0.0)) for load in part.loads)},
            gravity=gravity,
            recovery=None,
        )


def _lift_body_keys(content: dict[str, Any]) -> dict[str, Any]:
    """Return the content of a scene of one body with the keys of the body at the top; `content` is changed."""
    sections = content.pop("sections", [])
    for section in sections:
        content |= {key: value for key, value in section.items() if key in OF_A_BODY}
    return content


def _merge_section(common: Mapping[str, object], part: Mapping[str, object]) -> dict[str, Any]:
    """Return the tables `part` of a section merged over the tables `common` to all sections.

    If the section's own joint sets one of `extension`, `overlap` and `follows`, it takes over none of the three.  If it
    sets `extension` or `overlap`, it takes over no rope either.
    """
    joint, of_common = part.get("joint"), common.get("joint")
    ways = {"extension", "overlap", "follows"}
    if isinstance(joint, Mapping) and ways & set(joint) - {"follows"}:
        ways |= {"rope"}
    if isinstance(joint, Mapping) and ways & {*joint} - {"rope"} and isinstance(of_common, Mapping):
        common = {**common, "joint": {key: value for key, value in of_common.items() if key not in ways}}
    return merge_tables(common, part)
