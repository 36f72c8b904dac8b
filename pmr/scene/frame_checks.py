"""What a frame that moves asks of the rest of a scene."""

from __future__ import annotations

import numpy as np

from pmr.scene.built import Gravity
from pmr.scene.choice import model_of, parts_of
from pmr.scene.frame import Frame
from pmr.scene.machine_checks import check_machine
from pmr.scene.members import members
from pmr.scene.scene import Scene
from pmr.scene.signals import SignalBase
from pmr.scene.structure_checks import refusal

#: Share of an angle's range that it may jump by, which round-off does.
JUMP = 1e-9
#: Share of a luffing cylinder's distance from the pivot that its arm is at least, and at how many times.
IN_LINE, SAMPLES = 0.01, 1001


def check_frame(scene: Scene) -> None:
    """Refuse angles that jump or have kinks, gravity that is given twice, and models or references without a frame."""
    frame = scene.frame
    if frame is None:
        return
    angles = dict(zip(("luffing", "slewing"), frame.angles, strict=True))
    angles |= dict(zip(("base.rx", "base.ry", "base.rz"), frame.rocking, strict=False))
    for key, angle in angles.items():
        frame.refuse_without_unit(f"frame.{key}", angle.bounds(0.0, scene.time.end))
        _check_smooth(scene, key, "an angle", angle)
    _check_cylinder(scene, frame)
    if frame.machine is not None:
        check_machine(scene, frame, frame.machine)
    for axis, motion in (frame.base.motions if frame.base else {}).items():
        if axis in ("x", "y", "z"):
            _check_smooth(scene, f"base.{axis}", "a motion", motion)
    if scene.gravity is not None and scene.gravity.direction != Gravity().direction:
        allowed = "neither direction nor inclination is allowed beside a frame: frame.luffing says where down is"
        raise refusal("gravity", None, allowed)
    for member in members(scene):
        if model_of(member) == "matrices":
            allowed = "models with a mesh are allowed in a frame: matrices do not say where their mass is"
            raise refusal(scene.key_of(member.number, "body.model"), "matrices", allowed)
        if model_of(member) == "beam2d" and (frame.leaves_plane or frame.place[1] != 0.0):
            key = frame.leaves_plane or "pivot"
            raise refusal(f"frame.{key}", None, "models in space are allowed with it: beam2d has no lateral motion")
    for number in range(1, len(scene.sections) if frame.second_order else 1):
        least = scene.extension(number).bounds(0.0, scene.time.end)[0]
        if least <= 0.0:
            allowed = f"an extension above 0 is allowed with frame.second_order: here it is {least:g} m"
            raise refusal(f"sections[{number}].joint", None, allowed)
    for support in scene.sections[0].supports if frame.second_order else ():
        if "x" in support.held and scene.sections[0].place(support.on) not in (0.0, None):
            allowed = "the tail is allowed as the place that holds the base along with frame.second_order"
            raise refusal(scene.key_of(0, "supports"), support.on, f"{allowed}: axial forces are those from there on")
    for member in members(scene) if frame.second_order else ():
        for load in member.part.loads:
            if load.on != "tip" and "x" in parts_of(member, load).values():
                allowed = "the tip is allowed with frame.second_order as the place of a load along the boom"
                raise refusal(scene.key_of(member.number, "loads"), load.on, allowed)
    if "ancf" in scene.compare.against:
        raise refusal("compare.against", list(scene.compare.against), "['full'] or [] is allowed with a frame")


def _check_cylinder(scene: Scene, frame: Frame) -> None:
    """A cylinder in line with the pivot carries no moment."""
    if frame.cylinder is None:
        return
    t = np.linspace(0.0, scene.time.end, SAMPLES)
    angle = frame.angles[0].value(t)
    length, arm = frame.cylinder.length(angle)
    reach = float(np.hypot(*frame.cylinder.lug))
    k = int(np.argmin(np.abs(arm)))
    if np.abs(arm[k]) < IN_LINE * reach or arm.min() < 0.0 < arm.max() or reach == 0.0:
        at = f"at {t[k]:.4g} s, {np.rad2deg(angle[k]):.3g} degrees, a cylinder of {length[k]:.3g} m has {arm[k]:.2g} m"
        raise refusal("frame.cylinder", None, f"hinges with an arm about the pivot are allowed: {at}")


def _check_smooth(scene: Scene, key: str, what: str, motion: SignalBase) -> None:
    kinks = motion.kinks(scene.time.end)
    jumps = [t for t in motion.breaks if 0.0 < t <= scene.time.end and _jumps(motion, t)]
    if jumps or kinks:
        at, defect = (jumps[0], "a jump") if jumps else (min(kinks), "a kink")
        allowed = f"{what} with a rate that does not jump is allowed, here is {defect} at {at:g} s: a smooth_ramp"
        raise refusal(f"frame.{key}", None, allowed)


def _jumps(angle: SignalBase, t: float) -> bool:
    low, high = angle.bounds(0.0, t)
    before, after = angle.value(np.array([np.nextafter(t, -np.inf), t]))
    return bool(abs(after - before) > JUMP * (high - low))
