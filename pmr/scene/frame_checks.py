"""What a frame that moves asks of the rest of a scene."""

from __future__ import annotations

import numpy as np

from pmr.scene.built import Gravity
from pmr.scene.choice import model_of
from pmr.scene.members import members
from pmr.scene.scene import Scene
from pmr.scene.signals import SignalBase
from pmr.scene.structure_checks import refusal

#: Share of an angle's range that it may jump by, which round-off does.
JUMP = 1e-9
#: Of 2 pi rad: more of it is more likely to be meant in degrees.
TURN = 2.0 * np.pi


def check_frame(scene: Scene) -> None:
    """Refuse angles that jump or have kinks, gravity that is given twice, and models or references without a frame."""
    frame = scene.frame
    if frame is None:
        return
    for key, angle in zip(("luffing", "slewing"), frame.angles, strict=True):
        largest = max(np.abs(angle.bounds(0.0, scene.time.end)))
        if largest > TURN and "unit" not in frame.model_fields_set:
            allowed = "its unit has to be said where an angle goes beyond a turn: frame.unit = 'degrees' or 'rad'"
            raise refusal(f"frame.{key}", float(f"{largest:.4g}"), allowed)
        kinks = angle.kinks(scene.time.end)
        jumps = [t for t in angle.breaks if 0.0 < t <= scene.time.end and _jumps(angle, t)]
        if jumps or kinks:
            at, what = (jumps[0], "a jump") if jumps else (min(kinks), "a kink")
            allowed = f"an angle with a rate that does not jump is allowed, here is {what} at {at:g} s: a smooth_ramp"
            raise refusal(f"frame.{key}", None, allowed)
    if scene.gravity is not None and scene.gravity.direction != Gravity().direction:
        allowed = "neither direction nor inclination is allowed beside a frame: frame.luffing says where down is"
        raise refusal("gravity", None, allowed)
    for member in members(scene):
        if model_of(member) == "matrices":
            allowed = "models with a mesh are allowed in a frame: matrices do not say where their mass is"
            raise refusal(scene.key_of(member.number, "body.model"), "matrices", allowed)
        if model_of(member) == "beam2d" and (frame.slewing is not None or frame.place[1] != 0.0):
            key = "slewing" if frame.slewing is not None else "pivot"
            raise refusal(f"frame.{key}", None, "models in space are allowed with it: beam2d knows no lateral motion")
    for number in range(1, len(scene.sections) if frame.second_order else 1):
        least = scene.extension(number).bounds(0.0, scene.time.end)[0]
        if least <= 0.0:
            allowed = f"an extension above 0 is allowed with frame.second_order: here it is {least:g} m"
            raise refusal(f"sections[{number}].joint", None, allowed)
    if "ancf" in scene.compare.against:
        raise refusal("compare.against", list(scene.compare.against), "['full'] or [] is allowed with a frame")


def _jumps(angle: SignalBase, t: float) -> bool:
    low, high = angle.bounds(0.0, t)
    before, after = angle.value(np.array([np.nextafter(t, -np.inf), t]))
    return bool(abs(after - before) > JUMP * (high - low))
