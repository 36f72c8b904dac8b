"""Reading of scene files: validation, keys without effect, and keys of earlier versions; JSON schemas for editors.

A scene file with a key of an earlier version is refused; the error names the key's new name or what replaces it.  A
scene in saved results or in a saved model was valid for the version that wrote it: keys that no longer exist are left
out.

Keys that a scene file sets and that have no effect on the scene are refused too, because whoever sets a key expects an
effect.

The schemas are those of pydantic, extended by what files may contain besides: a file that `extends` another one may
leave out keys, a number stands for a constant signal, and entries of lists may be changed by their names.  The dialect
is JSON Schema's draft 7, which editors of TOML know.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from pmr.errors import InputError
from pmr.scene.checks import check_scene
from pmr.scene.choice import has_axial_motion, has_giving_walls, is_planar, model_of, observed_places, traits_of
from pmr.scene.cylinder import FreeExtension
from pmr.scene.joints import JointPads
from pmr.scene.keys import Schema
from pmr.scene.members import Member, member_at, members
from pmr.scene.model_traits import CELLS
from pmr.scene.scene import BodyFile, Scene
from pmr.scene.structure_checks import scene_error
from pmr.scene.tomlfiles import OPTION, Change, Dialect, TomlFile, override, resolve_path

#: Keys of earlier versions and their present names.
MOVED = {
    "body.length": "body.profile.length",
    "body.bending_stiffness": "body.profile.bending_stiffness",
    "body.axial_stiffness": "body.profile.axial_stiffness",
    "body.mass_per_length": "body.profile.mass_per_length",
    "body.axial": "body.profile.axial",
    "supports.at": "supports.on",
    "loads.at": "loads.on",
    "holds": "supports (with their directions)",
    "clamps": "supports (with points = 'all', and kind = 'clamped' or directions)",
    "reduction.support_rows": "reduction.basis ('paper' for 'hold', 'eigenmodes' for 'drop')",
}
_INERTIA = "this key is no longer allowed: a larger reduction.coordinates has the same effect"
_FRICTION = "this key is no longer allowed: pads stick until they slide, by the shear_stiffness of each ring"
#: Keys of earlier versions without a present name, and what replaces them.
GONE = {
    "reduction.residual_inertia": _INERTIA,
    "section.reduction.residual_inertia": _INERTIA,
    "sections.reduction.residual_inertia": _INERTIA,
    "section.joint.friction_speed": _FRICTION,
    "sections.joint.friction_speed": _FRICTION,
}
#: Keys of stored scenes, with the value by default that earlier versions wrote there, in place of None.
_FORMER_DEFAULTS = {"loads.above": 0.0, "sections.loads.above": 0.0}


def stored_scene(data: Mapping[str, object], source: str, context: Mapping[str, str] | None = None) -> Scene:
    """Return the scene in `data` from saved results or from a saved model, of this version or an earlier one.

    `source` names the file in messages; `context` is `pmr.scene.keys.RECORDED` if files that the scene names need not
    exist, else None.

    Raises
    ------
    InputError
        For the first key that was never allowed, or the first value that is not valid.
    """
    content = deepcopy(dict(data))
    for name, value in (dict.fromkeys(GONE) | _FORMER_DEFAULTS).items():
        _leave_out(content, name.split("."), value)
    try:
        return Scene.model_validate_json(json.dumps(content), context=context)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        allowed = f"a scene of this version of pmr or an earlier one is allowed ({first['msg'].lower()})"
        raise InputError(source, key, first["input"], allowed) from None


def _leave_out(data: object, keys: Sequence[str], value: object) -> None:
    """Remove a key from nested tables, in place, if the key has this `value`; with None, whatever its value is.

    `keys` is the path to the key, such as ["joint", "tail"].  In a list of tables, the key is removed from each table.
    A key that is missing is ignored.
    """
    first, *inner_keys = keys
    if isinstance(data, list):
        for entry in data:
            _leave_out(entry, keys, value)
    elif isinstance(data, dict) and inner_keys:
        _leave_out(data.get(first), inner_keys, value)
    elif isinstance(data, dict) and value in (None, data.get(first)):
        data.pop(first, None)


#: Keys that a beam uses if its walls give way, or if it is compared with a shell.
OF_WALLS = ("mesh.size", "mesh.along", "body.shear_correction")
#: Keys of a box that a planar beam can't represent.
STIFFENERS = ("body.box.frame_depth", "body.box.frame_thickness")
#: Keys that only the POD of eigenmodes uses.
POOLED = ("reduction.snapshots", "reduction.modes", "reduction.positions")


@dataclass(frozen=True)
class UnusedKey:
    """A key without effect, the key `decided_by` that causes this ("" if none does), and the reason in words."""

    key: str
    decided_by: str
    reason: str


def check_unused(file: TomlFile, scene: Scene) -> None:
    """Raise an InputError for the first key without effect that this file or an option sets.

    A second key may take away the effect (`UnusedKey.decided_by`).  A key of this file is then refused only if this
    file sets the second key as well.  Keys pass that come from a file which this one extends, from the table common to
    all sections, or from the grid of a study: they may have an effect elsewhere.
    """
    if "sections" not in file.data:
        _refuse_any(file, "", file.data, _refused_body_keys(member_at(scene)))
    else:
        for number, (member, section) in enumerate(zip(members(scene), file.data["sections"], strict=True)):
            _refuse_any(file, f"sections[{number}].", section, _refused_body_keys(member))
            if number:
                _refuse_any(file, f"sections[{number}].", section, _unused_joint_keys(scene, number))
    _refuse_any(file, "", file.data, _unused_scene_keys(scene))


def _refuse_any(file: TomlFile, prefix: str, content: Mapping[str, object], unused_keys: Iterator[UnusedKey]) -> None:
    """Raise an InputError for the first of `unused_keys` in the table `content` that an option or this file sets.

    A key of this file passes if another file sets the key that takes away its effect (see `check_unused`).  `prefix` is
    put before the keys of the table; it is the key of the table in the file with a dot, or empty.
    """
    for unused in unused_keys:
        if not _has_key(content, unused.key):
            continue
        decider = writer = file.origin(prefix + unused.key)
        if unused.decided_by:
            decided = _has_key(content, unused.decided_by) or not prefix
            decider = file.origin(prefix + unused.decided_by if decided else f"section.{unused.decided_by}")
        if writer == OPTION or writer == decider == str(file.path):
            raise scene_error(f"{prefix}{unused.key}", None, f"leave it out: {unused.reason}")


def _has_key(data: object, key: str) -> bool:
    """Whether nested tables and lists have a dotted key, such as ``joint.tail.0.friction``; False for ""."""
    for word in filter(None, key.split(".")):
        if isinstance(data, list):
            data = dict(zip(map(str, range(len(data))), data, strict=True))
        if not (isinstance(data, Mapping) and word in data):
            return False
        data = data[word]
    return bool(key)


def _refused_body_keys(member: Member) -> Iterator[UnusedKey]:
    """Yield the keys of `unused_body_keys` that a scene file must not set.

    If `body.model` is ``auto`` and the body has a box, the model is chosen by loads, pads and outputs.  Keys that have
    no effect because of the chosen model are then left out.
    """
    decided = member.part.body.model != "auto" or member.part.body.box is None
    return (unused for unused in unused_body_keys(member) if decided or unused.decided_by != "body.model")


def unused_body_keys(member: Member) -> Iterator[UnusedKey]:
    """Yield keys without effect on a body, with the key that takes away their effect and the reason.

    Keys of walls have an effect on a beam if its walls give way, or if it is compared with a richer model, a shell.
    """
    model, compared = model_of(member), member.scene.compare.richer not in ("auto", "none")
    for key in traits_of(member).without_effect:
        if key == "body.shear" and traits_of(member).is_beam and not member.part.body.shear:
            continue  # the beam has no shear deformation, as the key says
        if key in OF_WALLS and (compared or has_giving_walls(member)):
            continue
        yield UnusedKey(key, "body.model", f"it has no effect on {model}")
    if is_planar(member):
        yield from (UnusedKey(key, "", f"{model} has no frames; beam3d and shell have them") for key in STIFFENERS)
    if member.part.mesh.file is not None:
        drawn = (*CELLS, "mesh.elements", "mesh.grading")
        yield from (UnusedKey(key, "mesh.file", "the mesh is read from a file") for key in drawn)
    else:
        yield UnusedKey("mesh.faces", "mesh.file", "only faces of a mesh that is read are found by their normals")
        yield UnusedKey("mesh.groups", "mesh.file", "only a mesh that is read gets further groups")
    if member.part.body.profile is not None:
        yield UnusedKey("body.material", "body.profile", "a profile holds stiffness and mass itself")
    for k, support in enumerate(member.part.supports):
        why = "forces of a support that holds all points are not computed"
        keys = ("allowed_force", "lug_spacing") if support.points == "all" else ()
        yield from (UnusedKey(f"supports.{k}.{key}", "", why) for key in keys)
    if not member.part.reduction.uses_pod:
        why = f"basis = {member.part.reduction.basis!r} has no eigenmodes at several positions"
        yield from (UnusedKey(key, "reduction.basis", why) for key in POOLED)
    if observed_places(member) is None:
        yield UnusedKey("observe.count", "observe", "without observe.start and observe.end a beam's nodes are observed")


def _unused_joint_keys(scene: Scene, number: int) -> Iterator[UnusedKey]:
    """Yield keys without effect in the joint of section `number`.

    - `ratio` and `offset` have none if the section follows no other one.
    - Keys of friction have none if other keys of their ring or of the free extension make them void.
    - `cylinder` and `rope` have none if the model has no displacements along the boom.
    """
    joint, name = scene.joint(number), scene.names[number]
    if joint.follows is None:
        yield from (UnusedKey(f"joint.{key}", "", f"{name} follows no other section") for key in ("ratio", "offset"))
    keyed: dict[str, JointPads | FreeExtension] = {f"joint.tail.{k}": ring for k, ring in enumerate(joint.tail)}
    keyed |= {f"joint.mouth.{k}": ring for k, ring in enumerate(joint.mouth)}
    keyed |= {"joint.extension": joint.extension} if isinstance(joint.extension, FreeExtension) else {}
    for key, table in keyed.items():
        yield from (UnusedKey(f"{key}.{unused}", "", why) for unused, why in table.unused_keys.items())
    for key in ("cylinder", "rope") if not has_axial_motion(member_at(scene, number)) else ():
        yield UnusedKey(f"joint.{key}", "", f"{name} has no coordinates along the boom, and so no {key}")


def _unused_scene_keys(scene: Scene) -> Iterator[UnusedKey]:
    """Yield keys without effect in the tables about all bodies.

    - The number of elements of an ANCF cable has none if there is no such reference.
    - Settings of Newton's method have none if Exudyn does not simulate.
    - A play of pads has none if no pad on a face only pushes, or if such pads have a clearance already.
    - Stops of a luffing cylinder have none if it has no stroke, or if its angle is prescribed.
    """
    frame = scene.frame
    if frame is not None and frame.cylinder is not None and not (frame.luffing == "free" and frame.cylinder.stroke):
        why = "stops act on a cylinder that drives a free luffing angle, at the ends of its stroke"
        yield from (UnusedKey(f"frame.cylinder.stop_{key}", "frame.luffing", why) for key in ("stiffness", "damping"))
    if "ancf" not in scene.compare.against:
        yield UnusedKey("compare.ancf_elements", "compare.against", "compare.against names no ANCF reference")
    if not any(name.startswith("exudyn") for name in (*scene.simulation.simulators, scene.simulation.full)):
        why = "Exudyn, whose settings these are, does not simulate"
        yield UnusedKey("simulation.newton", "simulation.simulators", why)
    pushing = [ring for part in scene.sections for ring in part.rings if ring.unilateral and ring.faces is not None]
    if not pushing:
        yield UnusedKey("compare.play", "", "no ring of pads on faces has unilateral = true, and others have no play")
    elif any(ring.has_clearance for ring in pushing):
        yield UnusedKey("compare.play", "", "pads have a clearance, without which `pmr run` simulates the scene again")


#: Rules of scene files: keys that replace each other, and published results, which belong to one scene alone.
_ALTERNATIVES = {
    "damping": (("mass", "stiffness"), ("ratio", "frequencies")),
    "body": (("box",), ("profile",)),
    "gravity": (("direction",), ("inclination",)),
}
DIALECT = Dialect("scene file", ("file",), ("published",), _ALTERNATIVES, renamed_keys=MOVED, removed_keys=GONE)


def load(path: str | Path, overrides: Sequence[str] = ()) -> Scene:
    """Read a scene file in TOML: its path, a folder with a ``scene.toml``, or the name of a workflow of the package.

    A file may extend another one: its key ``extends`` names a base file, relative to the file itself, and its other
    keys override those of the base file.  `overrides` are ``"section.key=value"`` with the value in TOML notation (a
    bare word is taken as a string).

    Raises InputError in one line: file, key, value, what is allowed.  A scene of several sections is refused, too;
    `load_any` reads it.
    """
    scene = load_any(path, overrides)
    try:
        scene.only_section  # noqa: B018
    except InputError as error:
        raise error.with_source(str(_read_file(path).path)) from None
    return scene


def load_any(path: str | Path, overrides: Sequence[str] = ()) -> Scene:
    """Read a scene file of one section or of several; `path`, `overrides` and errors are as in `load`."""
    return vary(path, [override(text) for text in overrides])


def vary(path: str | Path, changes: Sequence[Change]) -> Scene:
    """Load the scene at `path` and lay `changes` over its tables in order.

    If the scene's hash changes, only the frequencies of its published results are kept.
    """
    file, as_it_stands = _read_file(path), ""
    with suppress(InputError):  # a later change may mend the error
        as_it_stands = _checked_scene(file).hash if changes and "published" in file.data else ""
    for change in changes:
        file.apply(change)
    scene = _checked_scene(file)
    if as_it_stands and scene.hash != as_it_stands and scene.published is not None:
        without_errors: dict[str, Any] = {"errors": {}, "max_displacement": None, "max_error": None}
        published = scene.published.model_copy(update=without_errors) if scene.published.frequencies else None
        scene = scene.model_copy(update={"published": published})
    return scene


def has_sections(path: str | Path) -> bool:
    """Whether the scene file `path` describes a boom of more than one section."""
    sections = _read_file(path).data.get("sections")
    return isinstance(sections, list) and len(sections) > 1


def _read_file(path: str | Path) -> TomlFile:
    """Read the scene file `path` with the files named by its key ``extends``.

    `path` may also be a folder with ``scene.toml``, or the name of a workflow.
    """
    return TomlFile.read(resolve_path(Path(path), "scene.toml"), DIALECT)


def _checked_scene(file: TomlFile) -> Scene:
    """Return the checked scene of a file in either form: with a body at the top, or with a list of sections.

    Raises InputError with the file that set the key, and the key as it is written there.
    """
    of_boom = "sections" in file.data
    if of_boom and "body" in file.data:
        allowed = "one [body], or the [[sections]] of a boom, are allowed, not both"
        raise InputError(file.origin("sections"), "sections", None, allowed)
    if "section" in file.data and not of_boom:
        allowed = "only a boom of several [[sections]] has this table: a scene of one [body] has its keys at the top"
        raise InputError(file.origin("section"), "section", None, allowed)
    scene = file.validate(Scene) if of_boom else Scene.from_body(file.validate(BodyFile))
    try:
        check_scene(scene)
        check_unused(file, scene)
    except InputError as error:
        error = error.with_key(scene.file_key(error.key))
        raise error.with_source(file.origin(error.key)) from None
    return scene


DRAFT = "http://json-schema.org/draft-07/schema#"
EXTENDS = {
    "type": "string",
    "description": "File that this one changes: a path relative to it, or the name of one that comes with pmr",
}
#: Suffix of the names of schemas of tables that need not be complete.
IN_PART = ", in part"


def scene_form_schemas() -> list[Schema]:
    """Return the schemas of the two forms of a scene file.

    The first form has a body at the top, the second a list of sections.
    """
    return [BodyFile.model_json_schema(), Scene.model_json_schema(mode="validation")]


def scene_file_schema() -> Schema:
    """Return the schema of a scene file with one body or with several sections."""
    body, several = scene_form_schemas()
    section = {"$ref": f"#/$defs/BoomSection{IN_PART}"}  # the table of keys that sections share
    about = several["properties"]["section"]["description"]
    several["properties"]["section"] = {"allOf": [section], "description": about}
    several["properties"]["sections"]["items"] = {"allOf": [section, {"required": ["name"]}]}
    return union_schema([body, several], "Scene of pmr")


def union_schema(schemas: Sequence[Schema], title: str) -> Schema:
    """Return the schema, with a title, of files that fit any one of `schemas`.

    Tables with the same name are equal in all of these.
    """
    parts: Schema = {}
    complete, extending = [], []
    for schema in schemas:
        spelled_schema = _in_draft_7(schema)
        parts |= spelled_schema.pop("$defs", {})
        changed = _without_required_keys(spelled_schema)
        changed["properties"]["extends"] = EXTENDS
        complete.append(spelled_schema)
        extending.append(changed | {"required": ["extends"]})
    parts |= {f"{name}{IN_PART}": _without_required_keys(part) for name, part in parts.items()}
    return {"$schema": DRAFT, "title": title, "$defs": parts, "anyOf": [*complete, *extending]}


def _in_draft_7(node: object) -> Any:
    """Return a node of a pydantic schema in draft 7, with units in descriptions, and numbers allowed as signals."""
    if isinstance(node, list):
        return [_in_draft_7(entry) for entry in node]
    if not isinstance(node, dict):
        return node
    spelled_node = {key: _in_draft_7(value) for key, value in node.items() if key != "discriminator"}
    if "prefixItems" in spelled_node:
        spelled_node["items"] = spelled_node.pop("prefixItems")
    if "constant" in node.get("discriminator", {}).get("mapping", {}):
        spelled_node["anyOf"] = [{"type": "number"}, {"oneOf": spelled_node.pop("oneOf")}]
    if isinstance(node.get("description"), str) and isinstance(node.get("unit"), str) and node["unit"] != "1":
        spelled_node["description"] += f", in {node['unit']}"
    return spelled_node


def _without_required_keys(node: object) -> Any:
    """Return a node of a schema, changed for files that extend other files.

    In such a file no key is required, as the file that it extends may have the key.  Where the schema allows a list of
    tables, the file may instead have a table that changes entries of the list, each under its name or number.
    """
    if isinstance(node, list):
        return [_without_required_keys(entry) for entry in node]
    if not isinstance(node, dict):
        return node
    part = {key: _without_required_keys(value) for key, value in node.items()}
    if isinstance(part.get("required"), list):
        del part["required"]
    if isinstance(node.get("$ref"), str) and not node["$ref"].endswith(IN_PART):
        part["$ref"] = f"{node['$ref']}{IN_PART}"
    if isinstance(node.get("oneOf"), list):
        part["anyOf"] = part.pop("oneOf")
    if node.get("type") == "array" and "$ref" in str(node.get("items")):
        about = {key: part.pop(key) for key in ("description", "default", "title") if key in part}
        entries = {"type": "object", "additionalProperties": part["items"]}
        part = {**about, "anyOf": [part, entries]}
    return part
