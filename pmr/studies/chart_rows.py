"""Rows of a load chart: extensions of sections and angles, and machines at rest that can be looked at there."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from pmr.errors import BEYOND_ENDS, InputError
from pmr.scene import Scene
from pmr.scene.joint_checks import check_extension
from pmr.scene.keys import SceneTable, key_error
from pmr.scene.members import footprint, members, seats
from pmr.scene.signals import Constant
from pmr.studies.study import Count

#: Largest difference in m between an extension of a study and that by which a section follows another one.
ROUNDED = 1e-4


class Range(SceneTable):
    """Evenly spaced values from `least` to `most`."""

    least: float = Field(description="First value, in m or the unit of the scene's angles")
    most: float = Field(description="Last value")
    count: Annotated[Count, Field(le=1000)] = Field(description="How many")
    order: Literal["together", "in turn"] = Field(
        default="together", description="Whether all sections telescope at once or one after the other"
    )

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        """Refuse a `most` below `least`."""
        if self.most < self.least:
            raise key_error("most", self.most, f"at least {self.least:g}, which is `least`, is allowed")
        return self

    @property
    def values(self) -> tuple[float, ...]:
        """Values from `least` to `most`, evenly spaced; their number is `count`."""
        return tuple(np.linspace(self.least, self.most, self.count).tolist())

    def section_rows(self, names: Sequence[str]) -> list[dict[str, float]]:
        """Return a mapping of extensions in m by section's name, for each of the `count` rows.

        As `order` says, all sections telescope together, or one after the other in the order of `names`.
        """
        rows = list[dict[str, float]]()
        for share in np.linspace(0.0, 1.0, self.count):
            in_turn = np.clip(share * len(names) - np.arange(len(names)), 0.0, 1.0)
            shares = in_turn if self.order == "in turn" else np.full(len(names), share)
            values = self.least + shares * (self.most - self.least)
            rows.append(dict(zip(names, values.tolist(), strict=True)))
        return rows


def extension_rows(scene: Scene, extensions: Range | Sequence[float | dict[str, float]]) -> list[dict[str, float]]:
    """Return extensions in m by section, in the order of the sections, for each row that a study asks for.

    Sections that follow another one are where they follow it.  Raises InputError if an extension is missing, not where
    its section follows, or not allowed by the checks of a scene, and if it takes pads to where the model has none.
    """
    names = scene.names[1:]
    driven = [name for number, name in enumerate(names, 1) if scene.joint(number).follows is None]
    if isinstance(extensions, Range):
        rows = extensions.section_rows(driven)
    else:
        rows = [
            dict.fromkeys(driven, extension) if isinstance(extension, float) else dict(extension)
            for extension in extensions or ({},)
        ]
    for k, row in enumerate(rows):
        key = f"extensions[{k}]"
        if not set(driven) <= set(row) <= set(names):
            allowed = f"an extension of each of {', '.join(names)} is allowed" if names else "none of a body alone"
            raise InputError("study", key, ", ".join(row) or None, allowed)
        still = _scene_at_rest(scene, row)
        rows[k] = {name: float(still.extension(number).value(0.0)) for number, name in enumerate(names, 1)}
        for name, value in rows[k].items():
            if abs(row.get(name, value) - value) > ROUNDED:
                follows = scene.joint(scene.names.index(name)).follows
                raise InputError(
                    "study", f"{key}.{name}", row[name], f"{value:.6g} m is allowed, as it follows {follows}"
                )
            most = scene.sections[scene.names.index(name) - 1].length
            if not 0.0 < value < most:
                raise InputError("study", key, value, f"more than 0 and less than {most:g} m is allowed")
            try:
                check_extension(still, scene.names.index(name))
            except InputError as error:
                raise InputError("study", key, value, error.allowed) from None
        _check_pads(scene, still, key)
    return rows


def _scene_at_rest(scene: Scene, row: Mapping[str, float]) -> Scene:
    """Return the scene with the sections that have a drive of their own extended as in `row`, in m by name."""
    sections = [
        part
        if part.joint is None or part.joint.follows is not None
        else part.with_keys(joint={"extension": Constant(amount=row[part.name]), "overlap": None})
        for part in scene.sections
    ]
    return scene.with_keys(sections=tuple(sections))


def _check_pads(scene: Scene, still: Scene, key: str) -> None:
    """Refuse extensions of the scene `still` that take pads of joints to where the models of `scene` have no rows.

    `key` is that of the row in the study.
    """
    for number, member in enumerate(members(scene)):
        for seat in seats(still, number) if member.has_joint else ():
            if seat.ring.faces is None:
                continue
            (low, high), at = member.ring_ranges[footprint(scene, seat.ring)], seat.positions.low
            slack = BEYOND_ENDS * (high - low)
            if not low - slack <= at <= high + slack:
                beyond = at - min(max(at, low), high)
                inwards = beyond if seat.joint == number else -beyond  # pads of a section's own joint move to its tail
                extension = float(still.extension(seat.joint).value(0.0))
                bound, name = "at least" if inwards > 0.0 else "at most", scene.names[seat.joint]
                allowed = (
                    f"{bound} {extension + inwards:.6g} m of {name} is allowed: the scene's extensions go no further, "
                    "and its model has no pads beyond"
                )
                raise InputError("study", key, extension, allowed)


def check_slewing(scene: Scene, slewing: Sequence[float]) -> None:
    """Raise an InputError for slewing angles of a boom without such an angle on which something of the ground acts."""
    assert scene.frame is not None
    key = next(_keys_of_ground(scene), "")
    if scene.frame.slewing is None and key and any(slewing):
        angle = next(filter(None, slewing))
        allowed = f"0 is allowed, or a scene with frame.slewing, such as 0: {key} acts on the boom as it is slewed"
        raise InputError("study", "slewing", angle, allowed)


def _keys_of_ground(scene: Scene) -> Iterator[str]:
    """Yield keys of what acts on a boom along the ground, so that its effect depends on the slewing angle."""
    assert scene.frame is not None
    if scene.frame.ground is not None and any(scene.frame.ground.slope):
        yield "frame.ground.slope"
    if scene.frame.base is not None:
        yield "frame.base"
    for number, part in enumerate(scene.sections):
        for k, load in enumerate(part.loads):
            if load.acts == "wind" or load.axes == "ground" and load.direction != "z":
                yield f"sections[{number}].loads[{k}]"


def check_at_rest(scene: Scene) -> None:
    """Raise InputError for a machine that moves by itself, a hoist, or a base whose motion is not constant."""
    assert scene.frame is not None
    if scene.frame.machine is not None:
        raise InputError("scene", "frame.machine", None, "a machine that stands still is allowed in a load chart")
    if scene.hoist is not None:
        raise InputError(
            "scene", "hoist", None, "none is allowed in a load chart, which hangs its own loads at the tip"
        )
    if scene.extension_keys:
        raise InputError("scene", scene.extension_keys[0], "free", "an extension over time is allowed in a load chart")
    if scene.frame.luffing == "free":
        raise InputError("scene", "frame.luffing", "free", "an angle over time is allowed in a load chart")
    base = scene.frame.base
    moving = [key for key, signal in (base.motions if base else {}).items() if not isinstance(signal, Constant)]
    moving += [f"acceleration.{axis}" for axis in (base.accelerations if base else {})]
    if moving:
        allowed = "a base that is inclined by a constant rx, ry or rz is allowed in a load chart"
        raise InputError("scene", f"frame.base.{moving[0]}", None, allowed)
