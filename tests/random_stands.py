"""Random booms on a machine that stands on outriggers, and the sum of all forces on the machine in NumPy.

Shares no formula with `pmr.simulation.reactions`: rotations are products of exponentials, each with its first and
second derivative by Leibniz' rule, and bodies with inertia are six points.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from newton_euler import points
from random_cranes import random_crane
from scipy.spatial.transform import Rotation

from pmr import Response
from pmr.files.arrays import Array
from pmr.scene import Scene
from pmr.scene.built import Gravity
from pmr.scene.checks import check_scene
from pmr.scene.frame import Frame
from pmr.scene.hoist import WINCH_PULLS, Hoist
from pmr.scene.mechanism import CYLINDER, pin_and_cylinder

AXES = ("x", "y", "z", "rx", "ry", "rz")


def random_stand(seed: int, hoists: bool = False) -> Scene:
    """Scene of a short run of a random crane on a machine with three to six outriggers, on a slope or a shaken base.

    One that `hoists` stands level and at rest, with the winch on the machine.
    """
    rng, scene = np.random.default_rng([seed, 512]), random_crane(seed)
    planar = scene.sections[0].body.model == "beam2d"
    frame = {"unit": "degrees", "second_order": bool(rng.random() < 0.5), "pivot": [0.0, 0.0, 0.0]}
    first, last = rng.uniform(0.0, 60.0, 2).tolist()
    frame["luffing"] = {"kind": "smooth_ramp", "times": [0.05, 0.45], "values": [first, first + 0.1 * (last - first)]}
    if not planar:
        frame["slewing"] = {
            "kind": "smooth_ramp",
            "times": [0.0, 0.5],
            "values": [0.0, float(rng.uniform(-20.0, 20.0))],
        }
    at_pin = [support for support in scene.sections[0].supports if support.name == "luffing cylinder"]
    if at_pin:
        frame["cylinder"] = {"foot": [0.6, -1.2], "lug": [at_pin[0].on, -0.2]}
    else:
        frame["pivot"] = [float(rng.uniform(-0.4, 0.8)), 0.0, float(rng.uniform(-0.3, 0.3))]
    sway = {"kind": "sine", "amplitude": float(rng.uniform(0.2, 1.0)), "frequency": float(rng.uniform(0.3, 1.5))}
    if rng.random() < 0.5 and not hoists:
        frame["base"] = {"ry": sway, "x": sway | {"amplitude": 0.01}, "z": sway | {"amplitude": 0.004}}
        frame["base"] |= {} if planar else {"rx": sway, "rz": sway, "y": sway | {"amplitude": 0.01}}
    angle = 2.0 * np.pi * (np.arange(n := int(rng.integers(3, 7))) + rng.uniform(-0.3, 0.3, n)) / n
    radius, reach = rng.uniform(2.0, 3.5, n), sum(part.length for part in scene.sections)
    mass = 1.5e3 * reach * float(rng.uniform(0.5, 1.5))
    frame["ground"] = {
        "height": float(rng.uniform(0.5, 2.5)),
        "slope": [0.0, 0.0] if hoists or "base" in frame else [float(rng.uniform(-3.0, 3.0)), 0.0 if planar else 1.5],
        "masses": [
            {"name": "carrier", "mass": mass, "at": [0.1, 0.1, -1.0], "inertia": [mass, 2.0 * mass, 2.2 * mass]},
            {"name": "weight", "mass": 0.4 * mass, "at": [-1.2, 0.2, 0.1], "slews": True, "inertia": [mass] * 3},
        ],
        "outriggers": [
            {"name": f"leg {k}", "at": [r * np.cos(a), r * np.sin(a)], "stiffness": 10.0 ** rng.uniform(7.0, 8.5)}
            for k, (r, a) in enumerate(zip(radius.tolist(), angle.tolist(), strict=True))
        ],
    }  # fmt: skip
    stand = scene.model_copy(
        update={
            "frame": Frame.model_validate(frame),
            "time": scene.time.model_copy(update={"end": 0.5, "step": 2e-3}),
            "gravity": Gravity(rise=0.0),
            "hoist": _random_hoist(seed, planar) if hoists else None,
            "start": "equilibrium",
        }
    )
    check_scene(stand)
    return stand


def _random_hoist(seed: int, planar: bool) -> Hoist:
    """Hoist with the winch on the machine, by one to three falls."""
    rng = np.random.default_rng([seed, 77])
    speed = {"kind": "smooth_ramp", "times": [0.1, 0.3], "values": [0.0, 0.4]}
    keys = {"payload": rng.uniform(50.0, 400.0), "EA": 10.0 ** rng.uniform(6.0, 7.0), "hanging": rng.uniform(2.0, 4.0)}
    winch = {"at": [-0.5, 0.0 if planar else 0.2, 0.4]}
    return Hoist.model_validate(
        keys | {"falls": int(rng.integers(1, 4)), "damping": 3e4, "winch": winch, "speed": speed}
    )


def rope_on_machine(scene: Scene, response: Response) -> Array:
    """Force and moment about the pivot (T, 6) by which a hoist pulls its winch, along the machine's axes."""
    slewing, t = scene.frame.slewing, response.t
    psi = np.zeros(len(t)) if slewing is None else radian(scene) * slewing.value(t)
    pull = np.stack([response.other(name) for name in WINCH_PULLS], axis=1)
    pull = np.einsum("tji,tj->ti", standing(scene, t).R, pull)
    winch = Rotation.from_rotvec(psi[:, None] * np.eye(3)[2]).apply(scene.hoist.winch.at)
    return np.hstack([pull, np.cross(winch, pull)])


@dataclass(frozen=True)
class Turned:
    """Rotations (T, 3, 3) with their first and second derivatives in time."""

    R: Array
    R1: Array
    R2: Array

    @classmethod
    def about(cls, axis: int, signal: Any, t: Array, sign: float = 1.0, unit: float = 1.0) -> Turned:
        """Rotation about an axis by the angle of a signal, times `sign` and `unit`."""
        a, a1, a2 = (sign * unit * of(t) for of in (signal.value, signal.rate, signal.second_rate))
        E = np.cross(np.eye(3), np.eye(3)[axis])  # E v is the cross product of the axis and v
        R = Rotation.from_rotvec(a[:, None] * np.eye(3)[axis]).as_matrix()
        a1, a2 = a1[:, None, None], a2[:, None, None]
        return cls(R, a1 * E @ R, a2 * E @ R + a1**2 * E @ E @ R)

    def __matmul__(self, other: Turned) -> Turned:
        return Turned(
            self.R @ other.R,
            self.R1 @ other.R + self.R @ other.R1,
            self.R2 @ other.R + 2.0 * self.R1 @ other.R1 + self.R @ other.R2,
        )


def radian(scene: Scene) -> float:
    """Radians in the unit of the frame's angles."""
    return np.pi / 180.0 if scene.frame.unit == "degrees" else 1.0


def standing(scene: Scene, t: Array) -> Turned:
    """Rotation of the machine by roll, pitch and yaw, of a base that moves or of the slope."""
    assert scene.frame is not None and scene.frame.ground is not None
    unit, motions = radian(scene), {} if scene.frame.base is None else scene.frame.base.motions
    along, across = scene.frame.ground.slope
    still = {"rx": across, "ry": -along, "rz": 0.0}
    roll, pitch, yaw = (
        Turned.about(k, motions[key], t, unit=unit) if key in motions else _fixed(k, unit * still[key], t)
        for k, key in enumerate(AXES[3:])
    )
    return yaw @ pitch @ roll


def _fixed(axis: int, angle: float, t: Array) -> Turned:
    R = np.repeat(Rotation.from_rotvec(angle * np.eye(3)[axis]).as_matrix()[None], len(t), axis=0)
    return Turned(R, np.zeros_like(R), np.zeros_like(R))


def masses_on_ground(scene: Scene, t: Array) -> Array:
    """Weight and inertia of the machine's masses as force and moment about the pivot (T, 6), in the machine's axes."""
    frame = scene.frame
    assert frame is not None and frame.ground is not None and scene.gravity is not None
    base, total = standing(scene, t), np.zeros((len(t), 6))
    slewing = Turned.about(2, frame.slewing, t, unit=radian(scene)) if frame.slewing else _fixed(2, 0.0, t)
    motions = {} if frame.base is None else frame.base.motions
    pivot = np.stack([motions[d].second_rate(t) if d in motions else np.zeros(len(t)) for d in "xyz"], axis=1)
    pivot[:, 2] += scene.gravity.signal.value(t)
    for mass in frame.ground.masses:
        place, at, (a, b, c) = base @ slewing if mass.slews else base, np.array(mass.at), mass.inertia
        for axis, second in enumerate(((b + c - a) / 2.0, (a + c - b) / 2.0, (a + b - c) / 2.0)):
            for side in (-1.0, 1.0):
                r = at + side * np.sqrt(3.0 * second / mass.mass) * np.eye(3)[axis]
                force = -mass.mass / 6.0 * np.einsum("tji,tj->ti", base.R, place.R2 @ r + pivot)
                total += np.hstack([force, np.cross(np.einsum("tji,tj->ti", base.R, place.R @ r), force)])
    return total


def rigid_boom(scene: Scene, t: Array) -> Array:
    """Weight and inertia of a rigid boom of one section as force and moment about the pivot (T, 6), as above."""
    frame = scene.frame
    base, total = standing(scene, t), np.zeros((len(t), 6))
    turned = Turned.about(2, frame.slewing, t, unit=radian(scene)) @ Turned.about(
        1, frame.luffing, t, sign=-1.0, unit=radian(scene)
    )
    weight = scene.gravity.signal.value(t)[:, None] * [0.0, 0.0, 1.0]
    for point, mass in points(scene, 0):
        r, whole = np.array(frame.tail_position) + point, base @ turned
        force = -mass * np.einsum("tji,tj->ti", base.R, whole.R2 @ r + weight)
        total += np.hstack([force, np.cross(turned.R @ r, force)])
    return total


def boom_on_machine(scene: Scene, response: Response) -> Array:
    """Force and moment of the boom about the pivot (T, 6), in the machine's axes, by pin and cylinder if it can."""
    frame, t = scene.frame, response.t
    assert frame is not None
    known = dict(zip(response.other_names, response.others.T, strict=True)) if response.others is not None else {}
    wrench = np.stack([known.get(f"reaction of pivot {d}", np.zeros(len(t))) for d in AXES], axis=1)
    if pin_and_cylinder(scene) is not None and frame.cylinder is not None:
        wrench = np.stack([known.get(f"reaction of {scene.names[0]}: pin {d}", np.zeros(len(t))) for d in AXES], axis=1)
        phi, (lx, lz), (fx, fz) = radian(scene) * frame.luffing.value(t), frame.cylinder.lug, frame.cylinder.foot
        c, s, zero = np.cos(phi), np.sin(phi), np.zeros(len(t))
        foot = np.stack([c * fx + s * fz, zero, c * fz - s * fx], axis=1)  # in the axes of the boom
        along = foot - [lx, 0.0, lz]
        push = known[CYLINDER][:, None] * along / np.linalg.norm(along, axis=1)[:, None]
        wrench += np.hstack([push, np.cross(foot, push)])
    turned = frame.rotation(t)
    return np.hstack([np.einsum("tij,tj->ti", turned, part) for part in (wrench[:, :3], wrench[:, 3:])])


def unbalanced(scene: Scene, response: Response, rope: Array | float = 0.0) -> tuple[Array, Array]:
    """Sum of forces and moments on the machine (T, 6), over the largest of each kind, and the polygon's use (T,).

    `rope` (T, 6) is the force and the moment of a rope on the machine.
    """
    ground = scene.frame.ground
    total = boom_on_machine(scene, response) + masses_on_ground(scene, response.t) + rope
    scale = np.repeat([np.abs(part).max() for part in (total[:, :3], total[:, 3:])], 3)
    for leg in ground.outriggers:
        force = np.outer(response.other(f"force of outrigger {leg.name}"), [0.0, 0.0, 1.0])
        total += np.hstack([force, np.cross([*leg.at, -ground.height], force)])
    along = -np.stack([response.other(f"reaction of ground {d}") for d in "xy"] + [np.zeros(len(response.t))], axis=1)
    total += np.hstack([along, np.cross([0.0, 0.0, -ground.height], along)])
    total[:, 5] -= response.other("reaction of ground rz")
    return total / scale, response.other("use of the support polygon")
