"""Keys of scenes that earlier versions had: the one place where a key is said to have moved, or to be gone.

A scene file with one of them is refused in a line that has the new name, or what does its work now. A scene that stands
in saved results or in a saved model was run by the version that wrote it: keys that are gone are left out of it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import Any

from pydantic import ValidationError

from pmr.errors import InputError
from pmr.scene.scene import Scene

#: Keys of earlier versions and what they are called now.
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
#: Keys of earlier versions that have no other name now, and what does their work.
GONE = dict.fromkeys(
    ("reduction.residual_inertia", "sections.reduction.residual_inertia"),
    "no such key is allowed any more: more of reduction.coordinates do its work",
) | dict.fromkeys(
    ("section.joint.friction_speed", "sections.joint.friction_speed"),
    "no such key is allowed any more: pads stick until they slide, by the shear_stiffness of each ring",
)


def stored_scene(data: Mapping[str, Any], source: str, context: Mapping[str, str] | None = None) -> Scene:
    """The scene of saved results or of a saved model, of this version or an earlier one; `source` is where it stands.

    Raises
    ------
    InputError
        For the first key that no version up to this one had.
    """
    content = deepcopy(dict(data))
    for name in GONE:
        _leave_out(content, name.split("."))
    try:
        return Scene.model_validate_json(json.dumps(content), context=context)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        allowed = f"a scene of this version of pmr or an earlier one is allowed ({first['msg'].lower()})"
        raise InputError(source, key, first["input"], allowed) from None


def _leave_out(data: Any, keys: Sequence[str]) -> None:
    """Take a key out of nested tables, of each entry where they are lists."""
    first, *inner_keys = keys
    if isinstance(data, list):
        for entry in data:
            _leave_out(entry, keys)
    elif isinstance(data, dict) and inner_keys:
        _leave_out(data.get(first), inner_keys)
    elif isinstance(data, dict):
        data.pop(first, None)
