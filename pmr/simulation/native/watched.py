"""What runs, steppers and FMUs warn of: the limits of forces, pressures, lengths and displacements, and their words.

A run states those of `run_limits` with their extremes (`exceeded_limits`), and has more to say of the others.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pmr.errors import InputError
from pmr.files.arrays import Array
from pmr.kernel.further import ground_outputs
from pmr.kernel.limits import ABOVE_ZERO, Limit, LimitCheck, Watch
from pmr.results.quantities import QUANTITIES, with_unit
from pmr.scene import Scene
from pmr.scene.built import force_name
from pmr.scene.cylinder import Oil
from pmr.scene.files import stored_scene
from pmr.scene.hoist import HEIGHT, ROPE_FORCE
from pmr.scene.keys import LUFFING, LUFFING_CYLINDER, RECORDED, cylinder_name
from pmr.scene.mechanism import TIPPING_MARGIN, rope_shares
from pmr.scene.members import pads_on_faces
from pmr.simulation.frame_motion import ComputedMotion
from pmr.simulation.native.free_motion import column_name
from pmr.system.contacts import Contact
from pmr.system.system import System

#: Share of the boom's length: a tip that moves this far comes closer by half a per cent of the length.
SMALL = 0.1
#: Force in N below which a force may be round-off.
NO_FORCE = 1e-6
#: Depth in m by which a stop is pressed in by round-off.
NO_DEPTH = 1e-9
#: Pressure in Pa of the surroundings: oil boils where its pressure is lower by this.
VACUUM = 1e5
#: Share of the supply's pressure by which that of a chamber has to be above it for a warning.
ABOVE = 0.005
#: Name of the cylinder that drives a free extension.
EXTENSION_CYLINDER = "extension cylinder"
#: What it means that a machine tips.
TIPS = "from then on no forces of outriggers hold it"
#: Function that returns the history (T,) of the output with a name, and None if there is no such output.
History = Callable[[str], Array | None]


def run_limits(scene: Scene, contacts: Sequence[Contact], no_force: float = NO_FORCE) -> Iterator[Limit]:
    """Yield the limits of pads, ropes, cylinders, oil and hook, which a run, a stepper and an FMU have in common.

    `contacts` are all contacts of the system.  `no_force` is the force in N up to which a force may be round-off.
    """
    yield from pulled_pads(scene, contacts, no_force)
    for name, pad in pads_on_faces(scene).items():
        if np.isfinite(pad.allowed_force):
            shares = {force_name(name): 1.0 / pad.allowed_force}
            event, extreme = f"the pad {name} bears more than its allowed_pressure", ", {} times as much"
            yield Limit("pressure", event, "", shares, -1.0, 1.0, "1", extreme=extreme)
    yield from pushed_ropes(scene, no_force)
    yield from stroke_limits(scene)
    for cylinder, names, _ in _oils(scene):
        for side in ("bore", "rod"):
            event = f"the oil on the {side} side of the {cylinder} boils"
            shares, extreme = {f"{names} pressure {side}": 1.0}, " at up to {} below the surroundings"
            yield Limit("boil", event, "the model pulls on it", shares, -VACUUM, unit="Pa", extreme=extreme)
    if scene.hoist is not None and scene.pivot_height:
        advice = "nothing in the model stops it there, and the rope bears it as if it hung freely"
        event = "the hook is below the ground"
        yield Limit("hook", event, advice, {HEIGHT: 1.0}, 0.0, unit="m", extreme=" by up to {}")


def watched_limits(system: System, names: Collection[str]) -> list[Limit]:
    """Limits that steppers and FMUs watch, as far as all their outputs and motions are among `names`.

    They are the limits of a run (`run_limits`), and limits of stops, slack hoist ropes, pressures of supplies,
    outriggers and displacements.  The list is empty if the system has no scene of this version.
    """
    try:
        scene = stored_scene(system.provenance["scene"], "system", RECORDED)
    except (KeyError, InputError):
        return []
    limits = [*run_limits(scene, system.contacts), *_stops(scene), *_supplies(scene)]
    if scene.hoist is not None:
        advice = f"{QUANTITIES['hoist_force'].label} need short steps then"
        limits.append(Limit("slack", "the hoist rope is slack", advice, {ROPE_FORCE: 1.0}, ABOVE_ZERO))
    limits += [*_ground(scene), *_displacements(scene, system)]
    return [limit for limit in limits if set(limit.shares) <= set(names)]


def pulled_pads(scene: Scene, contacts: Sequence[Contact], no_force: float = NO_FORCE) -> Iterator[Limit]:
    """Yield a limit for each pad that holds both ways: it does not pull by more than `no_force` in N.

    The advice says which key to set if the pad can only push.  A scene with a computed motion must not have pads that
    only push, so the advice there is to leave out faces.  For a single body only pads in rings have a limit, because
    points that hold a planar beam both ways are meant to pull.
    """
    computed, faces, keys = _computed_motion(scene), pads_on_faces(scene), dict[str, str]()
    if len(scene.sections) == 1:
        rings = [ring for ring in scene.pads if not ring.unilateral]
        keys = {name: f"the ring {ring.name}" for ring in rings for name, _, _ in ring.named_pads}
    for contact in contacts:
        if contact.kind == "pad" and contact.clearance is None and contact.inner.body in scene.names[1:]:
            end = "tail" if contact.inner.path is None else "mouth"  # pads at the tail travel with the inner section
            keys[contact.name] = f"joint.{end} of {contact.inner.body}"
    for name, ring in keys.items():
        if computed is None:
            advice = "if it can only push, set unilateral = true in {}"
        elif name in faces and faces[name].face in ("left", "right"):
            advice = (
                f"unilateral = true is refused beside {computed}; where a pad at the side can only push, the one on "
                "the other side would bear all, and two that share a force are twice as stiff as one that bears it"
            )
        else:
            advice = (
                f"unilateral = true is refused beside {computed}, so if it can only push, leave only the faces that "
                "bear in faces of {}, top at the tail and bottom at the mouth where the tip hangs down; a pad "
                "without another opposite would lift off there"
            )
        event = f"the pad {name} holds both ways and pulls"
        yield Limit("pull", event, advice, {force_name(name): 1.0}, -no_force, watch=Watch("pads"), where=ring)


def pushed_ropes(scene: Scene, no_force: float = NO_FORCE) -> Iterator[Limit]:
    """Yield a limit for each rope that moves a section: it does not push by more than `no_force` in N."""
    for name, shares in rope_shares(scene).items():
        joint = scene.joint(scene.names.index(name))
        if joint.rope is not None or joint.follows is not None:
            forces = {force_name(cylinder_name(section)): share for section, share in shares.items()}
            advice = "the model holds both ways, as with a second rope that pulls the section in"
            event = f"the rope of {name} would have to push"
            yield Limit("push", event, advice, forces, -no_force, watch=Watch("ropes"))


def stroke_limits(scene: Scene) -> Iterator[Limit]:
    """Yield the limit in rad of a prescribed luffing angle; none without a luffing cylinder that has a stroke."""
    frame = scene.frame
    if frame is None or frame.cylinder is None or frame.cylinder.stroke is None or _luffs_by_itself(scene):
        return
    low, high = frame.cylinder.stroke
    event = "the luffing angle needs a luffing cylinder beyond its stroke"
    advice = f"frame.cylinder.stroke is {low:g} to {high:g} m, and the boom can't be at this angle"
    angles = frame.cylinder.stroke_angles(float(frame.angles.luffing.value(0.0)))
    yield Limit("stroke", event, advice, {LUFFING: 1.0}, *angles, "rad", extreme=" with {}")


def stop_event(moved: str, end: str) -> str:
    """Clause which says that `moved` meets a stop at its `end`, such as ``greatest extension``."""
    return f"{moved} meets the stop at its {end}"


def highest_pressure(oil: Oil) -> float:
    """Pressure in Pa of a chamber above which the supply is too weak to fill it, for `oil` with a valve."""
    assert oil.valve is not None  # without one there is no supply
    return oil.supply + max(oil.valve.laminar, ABOVE * oil.supply)


def _luffs_by_itself(scene: Scene) -> bool:
    """Whether the luffing angle is no prescribed signal: it is free, or an earlier simulation has computed it."""
    luffing = None if scene.frame is None else scene.frame.luffing
    return luffing == "free" or isinstance(luffing, ComputedMotion)


def _computed_motion(scene: Scene) -> str | None:
    """Key of a computed motion of the frame, for a message: pads that only push are refused beside it.

    For a free luffing angle the text is the key and its value.  None is returned if all of the frame's motion is
    prescribed.
    """
    if scene.frame is None or scene.frame.machine is not None:
        return None if scene.frame is None else "frame.machine"
    return "frame.luffing = 'free'" if _luffs_by_itself(scene) else None


def _oils(scene: Scene) -> Iterator[tuple[str, str, Oil]]:
    """Yield name, prefix of outputs and oil of each cylinder with oil that drives a luffing angle or an extension."""
    cylinder = None if scene.frame is None else scene.frame.cylinder
    if cylinder is not None and cylinder.oil is not None:
        yield LUFFING_CYLINDER, LUFFING_CYLINDER, cylinder.oil
    for number, part in enumerate(scene.sections):
        extension = None if part.joint is None else part.joint.extension
        oil = extension.samples.oil if isinstance(extension, ComputedMotion) else getattr(extension, "oil", None)
        if oil is not None:
            yield EXTENSION_CYLINDER, column_name(scene.names[number], "").rstrip(), oil


def _stops(scene: Scene) -> Iterator[Limit]:
    """Yield two limits in m for each cylinder that drives a free luffing angle or extension: one for each stop."""
    strokes = [(scene.names[k], column_name(scene.names[k], "length"), "extension", of.stroke)
               for k, of in scene.free_extensions.items()]  # fmt: skip
    cylinder = None if scene.frame is None else scene.frame.cylinder
    if cylinder is not None and cylinder.stroke is not None and _luffs_by_itself(scene):
        strokes.append((f"the {LUFFING_CYLINDER}", f"{LUFFING_CYLINDER} length", "length", cylinder.stroke))
    for name, output, measure, (low, high) in strokes:
        advice, shares = "steps have to be short enough for its impact", {output: 1.0}
        smallest, greatest = (stop_event(name, f"{end} {measure}") for end in ("smallest", "greatest"))
        yield Limit("stop", smallest, advice, shares, low - NO_DEPTH, unit="m")
        yield Limit("stop", greatest, advice, shares, high=high + NO_DEPTH, unit="m")


def _supplies(scene: Scene) -> Iterator[Limit]:
    """Yield a limit in Pa for the pressure of each chamber that a valve connects to a supply."""
    for cylinder, names, oil in _oils(scene):
        if oil.valve is None:
            continue
        advice = "while the valve feeds this side the supply is too weak; at other times the model has no relief valve"
        for side in ("bore", "rod"):
            supply = with_unit(oil.supply, "Pa")
            event = f"the oil on the {side} side of the {cylinder} has more than the supply's {supply}"
            shares = {f"{names} pressure {side}": 1.0}
            yield Limit("supply", event, advice, shares, high=highest_pressure(oil), unit="Pa")


def _ground(scene: Scene) -> Iterator[Limit]:
    """Yield a limit in N m for each margin against tipping, then one in N for each outrigger.

    A margin must not be negative.  The force of an outrigger has to be above zero, or the outrigger lifts off.
    """
    names, prefix = ground_outputs(scene), force_name("outrigger ")
    for name in names:
        if name.startswith(TIPPING_MARGIN):
            event = f"the machine tips over {name.removeprefix(TIPPING_MARGIN)}"
            yield Limit("tip", event, TIPS, {name: 1.0}, 0.0, unit="N m", watch=Watch(once=True))
    for name in names:
        if name.startswith(prefix):
            event = f"the outrigger {name.removeprefix(prefix)} lifts off"
            yield Limit("lift-off", event, "", {name: 1.0}, ABOVE_ZERO, watch=Watch(until="tip"))


def _displacements(scene: Scene, system: System) -> Iterator[Limit]:
    """Yield a limit for each output in m: the share `SMALL` of the boom's greatest length, in both directions."""
    ranges = system.ranges
    length = scene.sections[-1].length + sum(ranges[name][1] for name in scene.names[1:])
    largest = SMALL * length
    advice, watch = "the theory of small motions does not hold", Watch(once=True, seldom=True)
    for name, unit in zip(system.output_names, system.output_units, strict=True):
        if unit == "m":
            event = f"{name} is more than {SMALL:g} times the greatest length of the boom, {length:.3g} m"
            yield Limit("motion", event, advice, {name: 1.0}, -largest, largest, "m", watch=watch)


@dataclass(frozen=True)
class Exceeded:
    """Limit that does not hold at some time of a motion."""

    limit: Limit
    first: int  # number of the first time at which it does not hold
    worst: int  # number of the time at which the quantity is farthest beyond it
    value: float  # at the time `worst`, in the unit of the limit

    @property
    def amount(self) -> str:
        """Text behind the event with the value at the worst time, such as `` with up to 2.5 kN``."""
        size, unit = abs(self.value), self.limit.unit
        if unit == "rad":
            return self.limit.extreme.format(f"{np.rad2deg(self.value):.4g} degrees")
        return self.limit.extreme.format(f"{size:.3g}" if unit == "1" else with_unit(size, unit))


def exceeded_limits(limits: Iterable[Limit], history: History) -> list[Exceeded]:
    """List the limits that do not hold at some time of the histories, in the order of `limits`.

    Limits of outputs without a history are left out.
    """
    recorded = [limit for limit in limits if all(history(name) is not None for name in limit.shares)]
    if not recorded:
        return []
    check, exceeded = LimitCheck(recorded, {name: 0 for limit in recorded for name in limit.shares}), list[Exceeded]()
    columns = {name: np.asarray(history(name)) for name in check.names}
    values = np.stack([columns[name] for name in check.names], axis=1)
    for number, first in sorted(check.first_times(values).items()):
        limit = recorded[number]
        quantity = np.sum([share * columns[name] for name, share in limit.shares.items()], axis=0)
        worst = int(np.argmax(np.maximum(limit.low - quantity, quantity - limit.high)))
        exceeded.append(Exceeded(limit, first, worst, float(quantity[worst])))
    return exceeded


def exceeded_warnings(exceeded: Iterable[Exceeded], when: Callable[[int], str]) -> Iterator[str]:
    """Yield one warning for each cause of limits that are exceeded.

    The warning is about the limit whose quantity has the largest size.  It says when this limit is exceeded first and
    most, and how many limits of the same cause are exceeded, too.  ``when(k)`` are the words for the time number k.
    """
    by_cause = dict[str, list[Exceeded]]()
    for of in exceeded:
        by_cause.setdefault(of.limit.cause, []).append(of)
    for of_cause in by_cause.values():
        worst = max(of_cause, key=lambda of: abs(of.value))
        first, most = when(worst.first), when(worst.worst)
        since = f", first {first}" if first != most else ""
        more = f", and {len(of_cause) - 1} more" if len(of_cause) > 1 else ""
        where = dict.fromkeys(of.limit.where for of in of_cause if of.limit.advice == worst.limit.advice)
        advice = worst.limit.advice.format(" and ".join(where))
        yield f"{worst.limit.event}{worst.amount} {most}{since}{more}{':' * bool(advice)} {advice}".rstrip()
