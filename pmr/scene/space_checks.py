"""What no section of a scene in space can know by itself."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Any

from pmr.errors import InputError
from pmr.scene.choice import model_of
from pmr.scene.pad_checks import check_pads
from pmr.scene.sections import Slider
from pmr.scene.space import StructureScene

BEAMS = ("beam2d", "beam3d")


def check_structure(scene: StructureScene) -> None:
    """Refuse a scene whose sections contradict each other.

    Raises
    ------
    InputError
        With source ``"scene"``.
    """
    _body(scene)
    _names("pads", (name for ring in scene.pads for name, _, _ in ring.places))
    for key in ("loads", "masses", "holds"):
        _names(key, (part.name for part in getattr(scene, key)))
    if scene.slider.offsets != Slider.model_fields["offsets"].default:
        raise _refusal("slider.offsets", list(scene.slider.offsets), "pads have an `at` of their own: leave it out")
    if not any(ring.moving for ring in scene.pads):
        raise _refusal("pads", None, "at least one ring of pads with moving = true is allowed: nothing slides")
    for i, ring in enumerate(scene.pads):
        if ring.clearance and not ring.unilateral:
            raise _refusal(f"pads[{i}].clearance", ring.clearance, "0 is allowed unless unilateral = true")
    check_pads(scene)
    _observed(scene)
    if not scene.signals:
        raise _refusal("loads", None, "a load or [gravity] is allowed: nothing moves the structure")
    if "ancf" in scene.compare.against:
        raise _refusal("compare.against", list(scene.compare.against), "ANCF is for planar beams; full is allowed")
    choice = scene.reduction
    if choice.positions == "nodes" and choice.basis == "eigenmodes":
        raise _refusal("reduction.positions", "nodes", "'path' or a list of places in m is allowed in space")
    if choice.support_rows == "hold":
        raise _refusal("reduction.support_rows", "hold", "'drop' is allowed in space")
    if scene.recovery is not None:
        steps = scene.recovery.every / scene.time.step
        if abs(steps - round(steps)) > 1e-6 or not 1 <= round(steps) <= scene.time.steps:
            allowed = f"a multiple of time.step = {scene.time.step:g} s up to time.end is allowed"
            raise _refusal("recovery.every", scene.recovery.every, allowed)


def _observed(scene: StructureScene) -> None:
    """A box's ends are known before it is drawn; a mesh that is read says itself where it ends."""
    if scene.observe.end < scene.observe.start:
        raise _refusal(
            "observe.end", scene.observe.end, f"observe.start = {scene.observe.start:g} m or more is allowed"
        )
    if scene.body.box is None:
        return
    length = scene.body.box.length
    places = [("observe.start", scene.observe.start), ("observe.end", scene.observe.end)]
    places += [(f"loads[{i}].on", load.on) for i, load in enumerate(scene.loads) if not isinstance(load.on, str)]
    for key, at in places:
        if not -1e-9 * length <= at <= (1.0 + 1e-9) * length:
            raise _refusal(key, at, f"on the body, 0 to {length:g} m, is allowed")


def _body(scene: StructureScene) -> None:
    body, file, model = scene.body, scene.mesh.file, model_of(scene)
    if (body.box is None) == (file is None):
        raise _refusal("body.box", None, "a box, or mesh.file, one of them is allowed")
    if file is not None and model in BEAMS:
        raise _refusal("mesh.file", str(file), "a beam needs body.box; shells and solids read files")
    if file is not None and body.model == "auto":
        raise _refusal("body.model", "auto", "shell or solid is allowed for a mesh that is read")
    if file is not None and model == "shell" and body.thickness is None:
        raise _refusal("body.thickness", None, "a thickness in m is needed for a shell that is read")
    if body.box is not None and body.box.wall >= min(body.box.width, body.box.height):
        raise _refusal("body.box.wall", body.box.wall, "less than width and height is allowed")
    if body.box is not None and body.box.radius >= min(body.box.width, body.box.height) / 2.0:
        raise _refusal("body.box.radius", body.box.radius, "less than half of width and height is allowed")
    if body.section is not None and body.model != "beam3d":
        raise _refusal("body.section", None, "a section goes with body.model = 'beam3d'")
    if body.section is not None and body.shear and None in (body.section.shear_area_y, body.section.shear_area_z):
        allowed = "shear_area_y and shear_area_z in m^2 are needed, or body.shear = false"
        raise _refusal("body.section", None, allowed)
    for name, region in body.regions.items():
        if model in BEAMS:
            raise _refusal(f"body.regions.{name}", None, "regions are for shells and solids")
        if model == "solid" and region.thickness is not None:
            raise _refusal(f"body.regions.{name}.thickness", region.thickness, "a solid has none")
    if model == "beam2d":
        _planar(scene)


def _planar(scene: StructureScene) -> None:
    """A planar beam knows x, z and the rotation about y."""
    for key, parts, known in (("loads", scene.loads, ("x", "z", "ry")), ("holds", scene.holds, ("x", "z"))):
        for part in parts:
            if part.direction not in known:
                allowed = f"{', '.join(known[:-1])} and {known[-1]} are allowed for beam2d"
                raise _refusal(f"{key}.{part.name}.direction", part.direction, allowed)
    if not any(ring.moving and {"bottom", "top"} & set(ring.faces) for ring in scene.pads):
        allowed = "a ring with moving = true at bottom or top is needed: a planar beam does not feel pads on its sides"
        raise _refusal("pads", None, allowed)
    if scene.gravity is not None and scene.gravity.direction[1] != 0.0:
        raise _refusal("gravity.direction", list(scene.gravity.direction), "x and z are allowed for beam2d")


def _names(key: str, names: Iterable[str]) -> None:
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise _refusal(key, twice[0], "names that differ are allowed")


def _refusal(key: str, value: Any, allowed: str) -> InputError:
    return InputError("scene", key, value, allowed)
