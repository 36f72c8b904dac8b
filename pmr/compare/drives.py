"""Drives of a boom in the summary of a run: luffing cylinder and free extension, both with their oil, and hoist."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from pmr.files.arrays import Array, Mask
from pmr.results import Response
from pmr.results.quantities import QUANTITIES, with_unit
from pmr.results.response import LUFFING_ANGLE, Extremes
from pmr.results.run import SummaryPart
from pmr.scene import Scene
from pmr.scene.cylinder import LuffingCylinder, Oil
from pmr.scene.frame_checks import distance_along, misplaced_supports
from pmr.scene.hoist import HEIGHT, KEYS, KINDS, Hoist
from pmr.scene.keys import LUFFING_CYLINDER
from pmr.scene.mechanism import CYLINDER, NEAR, PinAndCylinder, pin_and_cylinder, supports_at_lug
from pmr.simulation.frame_motion import ComputedMotion
from pmr.simulation.native.free_motion import ACCELERATION, CYLINDER_UNITS, STOP, column_name
from pmr.simulation.native.watched import EXTENSION_CYLINDER, NO_DEPTH, highest_pressure, stop_event

#: A support can't stand in for a cylinder if the cylinder's largest stiffness about the pivot is more than this times
#: its smallest.
TURNED = 1.1
#: A support lacks a cylinder's force along the boom if this is more than this share of the force across the boom.
LEANING = 0.1
#: A rope that jerks its payload at t = 0 by less than this share of the weight is not worth a word.
JERK = 0.01
#: Number of steps that resolve the impact on a stop.
IMPACT = 8


def luffing_part(scene: Scene, response: Response) -> SummaryPart:
    r"""Entry ``luffing_cylinder`` of summary.json: extremes of ``force`` N, ``length`` m, ``speed`` m/s, ``power`` W.

    .. math::
        L(\varphi) = |R(\varphi)\, r_1 - r_0|, \qquad F = \mathfrak M / \tfrac{dL}{d\varphi}, \qquad P = F\, \dot L

    Here L is the length at the luffing angle :math:`\varphi`, R the rotation, r_1 the lug on the boom, r_0 the foot on
    the machine, F the force and P the power. :math:`\mathfrak M` is the moment about the pivot of all forces with which
    the boom presses on its machine (`pmr.simulation.reactions`).  The pivot turns freely, and the cylinder alone keeps
    the angle, whatever holds the base in the scene.

    If the response has the columns of a cylinder that drives the angle, the entry has the extremes of all these
    columns, such as pressures, flows and volumes of oil.  It then has ``stops`` and warnings, too, as `extension_part`
    describes them.  If the scene limits the force of the cylinder, ``use`` is the share of the allowed force that is
    used.  The part has the warnings of `turning_warnings`, too.  The part is empty if the scene has no such cylinder,
    or if its force is not known.
    """
    if scene.frame is None or scene.frame.cylinder is None or CYLINDER not in response.other_names:
        return SummaryPart()
    cylinder, t, along = scene.frame.cylinder, response.t, scene.path_positions(response.t)
    prefix = f"{LUFFING_CYLINDER} "
    named = [output.name for output in response.outputs if output.kind != "probe"]
    driven = [name for name in named if name.startswith(prefix)]
    histories = {name.removeprefix(prefix): response.other(name) for name in driven}
    if driven:
        length, stroke = histories["length"], cylinder.stroke or (0.0, np.inf)
        stop = length - np.clip(length, *stroke)
        drive = _Drive(LUFFING_CYLINDER, f"the {LUFFING_CYLINDER}", "length", cylinder.oil)
        histories |= _use_of_cylinder(cylinder, histories["force"], length)
        return _driven_part(
            drive, histories, stop, response, along, turning_warnings(scene, response.other(LUFFING_ANGLE))
        )
    angle, force = scene.frame.angles.luffing, response.other(CYLINDER)
    length, arm = cylinder.length_and_arm(angle.value(t))
    speed = arm * angle.rate(t)
    histories = {"force": force, "length": length, "speed": speed, "power": force * speed}
    histories |= _use_of_cylinder(cylinder, force, length)
    return _cylinder_part(LUFFING_CYLINDER, histories, response, along, turning_warnings(scene, angle.value(t)))


def _use_of_cylinder(cylinder: LuffingCylinder, force: Array, length: Array) -> dict[str, Array]:
    """Return the entry ``use``: the share (T,) of its allowed force that a `cylinder` uses at T times.

    The cylinder has the `force` (T,) in N, positive where it pushes, and the `length` (T,) in m.  A pushing force is
    compared with the one that is allowed for pushing, a pulling force with the one for pulling.  The result is empty if
    the scene limits neither.
    """
    if not cylinder.has_allowed_forces:
        return {}
    allowed = cylinder.allowed_forces(length)
    return {"use": np.maximum(force / allowed.push, -force / allowed.pull)}


def extension_part(scene: Scene, response: Response) -> SummaryPart:
    """Entry ``extension_cylinder`` of summary.json: extremes of the drive of a computed extension, and its ``stops``.

    Lengths are extensions in m.  ``stops`` lists the spans in which a stop is pressed in.  A span has ``start`` and
    ``end`` in s, the number of ``steps``, and the ``speed`` in m/s with which the stop was met.  ``give`` in m is how
    far the stop gives way at most: above 0 at the greatest extension, below 0 at the smallest.  ``length`` in m is the
    extension at this time.  There is a warning about each stop that is met.  Further warnings name pressures that are
    higher than that of the supply (`supply_warnings`).  The part is empty unless an extension was computed.
    """
    computed = {name: path for name, path in scene.paths.items() if isinstance(path, ComputedMotion)}
    if (name := next(iter(computed), None)) is None:
        return SummaryPart()
    names = {of: column_name(name, of) for of in (*CYLINDER_UNITS, ACCELERATION, STOP)}
    histories = {of: response.other(column) for of, column in names.items() if column in response.other_names}
    if STOP not in histories:
        return SummaryPart()
    drive = _Drive(EXTENSION_CYLINDER, name, "extension", computed[name].samples.oil)
    return _driven_part(drive, histories, histories[STOP], response, scene.path_positions(response.t), [])


@dataclass(frozen=True)
class _Drive:
    """Drive, with a cylinder, of a computed luffing angle or extension.

    `cylinder` is the cylinder's name, and `moved` the name of the part that meets the stops.  `measure` is the quantity
    that the stroke limits, ``length`` or ``extension``.
    """

    cylinder: str
    moved: str
    measure: str
    oil: Oil | None


def _driven_part(
    drive: _Drive, histories: Mapping[str, Array], stop: Array, response: Response, along: Array, warnings: list[str]
) -> SummaryPart:
    """Part of the summary on the drive of a computed motion, as `extension_part` describes it.

    `histories` (T,) are the drive's quantities by name.  `stop` (T,) in m is how far a stop gives way: above 0 at the
    greatest length, below 0 at the smallest.  `along` (T,) in m is the path coordinate, or the reach of several
    sections.  `warnings` come before the part's own.
    """
    stop = np.where(np.abs(stop) > NO_DEPTH, stop, 0.0)
    spans = _stop_spans(response.t, stop, histories)
    for end, sign in (("smallest", -1.0), ("greatest", 1.0)):
        at_end = [of for of in spans if sign * of["give"] > 0.0]
        warnings = warnings + _stop_warnings(drive.moved, f"{end} {drive.measure}", at_end)
    if drive.oil is not None:
        warnings = warnings + supply_warnings(drive.cylinder, drive.oil, histories, stop, response)
    part = _cylinder_part(drive.cylinder, histories, response, along, warnings)
    return replace(part, figures={key: of | {"stops": spans} for key, of in part.figures.items()})


def _more_times(count: int) -> str:
    """Clause which says that something happens `count` more times; empty if `count` is 0."""
    return f", and {count} more time{'s' * (count > 1)}" if count else ""


def _stop_warnings(name: str, end: str, spans: list[dict[str, float]]) -> list[str]:
    """List a warning that `name` meets the stop at its `end`, such as ``greatest extension``.

    The list is empty without `spans` in which the stop is pressed in.
    """
    if not spans:
        return []
    worst = max(spans, key=lambda of: abs(of["speed"]))
    more = _more_times(len(spans) - 1)
    deepest = with_unit(max(abs(of["give"]) for of in spans), "m")
    fewest = min(of["steps"] for of in spans)
    missed = f"; {fewest:g} steps do not resolve it: a shorter time.step or a softer stop" * (fewest < IMPACT)
    return [
        f"{stop_event(name, end)} at {worst['start']:.4g} s with {abs(worst['speed']):.3g} m/s"
        f"{more}; the stop gives way by up to {deepest}{missed}"
    ]


def _stop_spans(t: Array, stop: Array, histories: Mapping[str, Array]) -> list[dict[str, float]]:
    """Spans in which a stop is pressed in, as `extension_part` describes them, in the order of time.

    t (T,) in s are the times, and `stop` (T,) in m is how far the stop gives way: above 0 at the greatest length, below
    0 at the smallest, else 0.  `histories` (T,) have the cylinder's ``length`` in m and ``speed`` in m/s.  A span has
    the keys:

    - ``start`` and ``end``: its first and its last time in s,
    - ``steps``: the number of its steps,
    - ``length`` and ``give``: the length, and how far the stop gives way, where it gives way most,
    - ``speed``: the speed just before the span.
    """
    spans = list[dict[str, float]]()
    for first, last in _spans(stop != 0.0):
        deepest = first + int(np.argmax(np.abs(stop[first:last])))
        before = max(first - 1, 0)
        figures = {"start": t[first], "end": t[last - 1], "length": histories["length"][deepest]}
        figures |= {"steps": last - first, "give": stop[deepest], "speed": histories["speed"][before]}
        spans.append({key: float(value) for key, value in figures.items()})
    return spans


def _spans(holds: Mask) -> list[tuple[int, int]]:
    """Spans in which a condition holds, each as its first step and the first step after it.

    `holds` (T,) says at which steps the condition holds.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]])))
    return [(first, last) for first, last in edges.reshape(-1, 2).tolist()]


def _cylinder_part(
    cylinder: str, histories: Mapping[str, Array], response: Response, along: Array, warnings: list[str]
) -> SummaryPart:
    """Part of the summary with the extremes of a cylinder's `histories` (T,).

    `along` (T,) in m is the path coordinate, or the reach of several sections, at the times of the response.
    `warnings` are added to the part.
    """
    extremes = {key: Extremes.from_history(history, response.t, along) for key, history in histories.items()}
    figures = {key.replace(" ", "_"): of.summary() for key, of in extremes.items()}
    return SummaryPart({cylinder.replace(" ", "_"): figures}, warnings)


def turning_warnings(scene: Scene, angles: Array) -> list[str]:
    """Warnings about supports of the base that stand in for a luffing cylinder but differ from it.

    The list is empty if the scene has no luffing cylinder, or if nothing differs.  There are warnings about:

    - supports across the boom that are not at the cylinder's lug (`misplaced_supports`),
    - a pin that is lacking or is not at the pivot,
    - a support at the lug that has a stiffness and so does not turn as a cylinder does, if the cylinder's stiffness
      about the pivot varies by more than a factor of `TURNED` over the luffing `angles` (T,) in rad,
    - a support at the lug, as it has no force along the boom, if the cylinder's force along the boom exceeds `LEANING`
      times its force across.
    """
    if scene.frame is None or scene.frame.cylinder is None:
        return []
    supports, at_lug = scene.sections[0].supports, supports_at_lug(scene)
    lug = scene.frame.cylinder.lug[0] - scene.frame.tail_position[0]
    warnings = [
        f"the support {supports[k].row_name('z')!r} is at {place:g} m from the tail, the luffing cylinder's lug at "
        f"{lug:g} m: if it stands for the cylinder, the base bends in another place, deflections and stress are off"
        for k, place in misplaced_supports(scene).items()
    ]
    held = pin_and_cylinder(scene)
    warnings += _pin_warnings(scene, held)
    if not at_lug:
        return warnings
    differences = list[str]()
    arm = np.abs(scene.frame.cylinder.length_and_arm(angles).arm)
    factor = float(arm.max() / arm.min()) ** 2
    force_along, force_across = np.abs(scene.frame.cylinder.direction(angles)).T
    leaning = float(np.max(force_along / np.maximum(force_across, 1e-9)))
    if factor > TURNED and any(of.stiffness != "rigid" for of in at_lug):
        differences.append(
            "is as stiff at all angles, where a cylinder's stiffness about the pivot changes by "
            f"a factor of {factor:.2g}: deflections and frequencies are right at one angle alone"
        )
    if leaning > LEANING:
        differences.append(
            f"lacks the cylinder's force along the boom, up to {leaning:.2g} times that across it: normal and shear "
            "forces of the base up to the lug are off, and so is its stress"
        )
    if not differences:
        return warnings
    remedy = "frame.cylinder.stiffness, in place of the support, turns with the boom"
    if scene.frame.cylinder.drives:  # of a free angle, which takes no stiffness
        remedy = "a run at a given angle with frame.cylinder.stiffness in place of the support has that force"
    if held is not None and np.hypot(*held.offset) > NEAR:
        remedy += ", with the pin at the pivot"
    return [*warnings, f"the support {at_lug[0].row_name('z')!r} {'; it '.join(differences)}; {remedy}"]


def _pin_warnings(scene: Scene, held: PinAndCylinder | None) -> list[str]:
    """List a warning if the base's supports are no pin at the pivot, or if their pin is away from the pivot.

    `held` is the pin and the cylinder's support among the base's supports; None if the supports are others.  The list
    is empty if the pin is at the pivot, or if a cylinder of the model, and no support, holds the boom.
    """
    base = scene.names[0]
    if scene.holding_cylinder is not None:
        return []
    if held is None:
        return [
            f"the supports of {base!r} are not a rigid pin along x and z and one support across the boom alone: their "
            "forces lack the luffing cylinder's thrust, which a pin at the pivot bears on top"
        ]
    ahead, above = held.offset
    if np.hypot(ahead, above) <= NEAR:
        return []
    return [
        f"the pin of {base!r} is {ahead:g} m ahead of the pivot and {above:g} m above it: its force and that of the "
        "luffing cylinder are those of a pin at the pivot, but the base lacks the moment of this force at the pin: "
        "deflections, and stress between pin and lug, are off"
    ]


def slack_spans(t: Array, force: Array) -> list[dict[str, float]]:
    """Spans in which a rope is slack: ``start`` and ``end`` in s, and the largest force ``snatch`` in N afterwards.

    `force` (T,) in N is that of the rope at the times t (T,) in s.  The ``end`` is the first time at which the rope
    pulls again, or the end of the run; the ``snatch`` is the largest force from then until the rope is slack again.
    """
    spans, listed = _spans(force <= 0.0), list[dict[str, float]]()
    for (start, end), (following, _) in pairwise([*spans, (len(t), len(t))]):
        snatch = float(force[end:following].max(initial=0.0))
        listed.append({"start": float(t[start]), "end": float(t[min(end, len(t) - 1)]), "snatch": snatch})
    return listed


def hoist_part(scene: Scene, response: Response) -> SummaryPart:
    r"""Entry ``hoist`` of summary.json: extremes of `KEYS`, ``weight_force`` and ``factor`` of the rope, and ``slack``.

    ``weight_force`` is the rope's force if the payload is at rest, :math:`m g / n` with the mass m, gravity g and n
    falls.  ``factor`` is the largest force divided by the weight force: the hoist factor or stop factor of the motion.
    ``slack`` lists the spans in which the rope is slack (`slack_spans`).  A grave warning names the worst of these
    spans.  Another warning says if the rope moves at t = 0 with another speed than its payload (`_jerk_warnings`).  The
    part is empty if the scene has no hoist or no gravity, or if the response has no hook.
    """
    hoist = scene.hoist
    if hoist is None or scene.gravity is None or not response.of(KINDS[HEIGHT]).shape[1]:
        return SummaryPart()
    along = scene.path_positions(response.t)
    columns = {key: response.other(name) for key, name in KEYS.items()}
    figures: dict[str, Any] = {
        key: Extremes.from_history(values, response.t, along).summary() for key, values in columns.items()
    }
    weight = hoist.mass * scene.gravity.acceleration / hoist.falls
    largest = float(columns["force"].max())
    figures |= {"weight_force": weight, "factor": largest / weight}
    spans, warnings = slack_spans(response.t, columns["force"]), list[str]()
    if spans:
        figures["slack"] = spans
        worst = max(spans, key=lambda span: span["snatch"])
        more = _more_times(len(spans) - 1)
        snatch = (
            f"snatches with up to {with_unit(worst['snatch'], 'N')}, {worst['snatch'] / weight:.3g} times the weight"
        )
        slack = f"from {worst['start']:.4g} s to {worst['end']:.4g} s{more}"
        warnings.append(
            f"the hoist rope is slack {slack}, and {snatch}: {QUANTITIES['hoist_force'].label} need short steps then"
        )
    return SummaryPart({"hoist": figures}, _jerk_warnings(scene, hoist, scene.gravity.acceleration), warnings)


def _jerk_warnings(scene: Scene, hoist: Hoist, gravity: float) -> list[str]:
    r"""List a warning about a rope that moves at t = 0 with another speed than its payload.

    Let v be the difference of the speeds, m the mass, k the stiffness of all falls and g the `gravity`.  On a boom that
    does not give, the force of a rope without damping rises to :math:`1 + |v| \sqrt{k / m} / g` times the weight; if
    that exceeds 1 by `JERK`, there is a warning, otherwise the list is empty.
    """
    signal, falls = hoist.rope_signal, hoist.falls
    taken_in = float(signal.value(0.0)) if hoist.is_wound else -float(signal.rate(0.0))
    line = float(hoist.free_length(np.zeros(1), distance_along(scene, 0.0))[0])
    change = abs(taken_in / falls - hoist.velocity[2])
    factor = 1.0 + change * float(np.sqrt(falls**2 * hoist.EA / (line * hoist.mass))) / gravity
    if not taken_in or factor < 1.0 + JERK:
        return []
    key = "hoist.speed" if hoist.is_wound else "the rate of hoist.length"
    return [
        f"{key} is {taken_in if hoist.is_wound else -taken_in:.3g} m/s at t = 0, but the payload rises with "
        f"{hoist.velocity[2]:.3g} m/s there: this jerks the rope, with up to {factor:.3g} times the weight on a rigid "
        "boom, and largest forces and factors of the run contain it; let the speed begin at 0, or state "
        f"hoist.velocity = [0.0, 0.0, {taken_in / falls:.3g}]"
    ]


def supply_warnings(
    cylinder: str, oil: Oil, histories: Mapping[str, Array], stop: Array, response: Response
) -> list[str]:
    """List up to two warnings for each chamber of a cylinder whose oil has a higher pressure than the supply.

    The first warning is for times at which the valve connects the chamber to the supply: the supply is too weak for the
    load, and oil flows back unless a counterbalance valve stops it.  The second is for all other times: a real relief
    valve might open, which the model does not have.  The pressure has to exceed the supply by the valve's laminar
    pressure drop or a small share, whichever is larger (`highest_pressure`).

    `histories` (T,) are by ``pressure bore`` and ``pressure rod``.  `stop` (T,) is how far a stop gives way: above 0 at
    the greatest length, below 0 at the smallest.  Times on a stop are ignored in both warnings.  The first warning also
    ignores the time after a stop, until the valve closes the next time, because the cylinder may rebound.  For this, a
    stop counts only for the chamber that drives the cylinder to it: the greatest length for the bore, the smallest for
    the rod side.  Without a valve there is no supply, and the list is empty.
    """
    if oil.valve is None:
        return []
    warnings, opening = list[str](), oil.valve.opening.value(response.t)
    supply = with_unit(oil.supply, "Pa")
    for side, way, verb in (("bore", 1.0, "extend"), ("rod", -1.0, "retract")):
        pressure = histories[f"pressure {side}"]
        above = (stop == 0.0) & (pressure > highest_pressure(oil))
        feeds, number = way * opening > oil.valve.dead_band, np.arange(len(opening))
        last_stop, last_shut = (
            np.maximum.accumulate(np.where(is_so, number, -1)) for is_so in (way * stop > 0.0, ~feeds)
        )
        fed = above & feeds & (last_stop <= last_shut)
        if fed.any():
            most = with_unit(float(pressure[fed].max()), "Pa")
            warnings.append(
                f"the supply of {supply} is too weak for the {cylinder}: at {response.t[np.argmax(fed)]:g} s "
                f"the valve is open to {verb} it, but the oil on the {side} side has up to {most}, and flows back "
                "unless a counterbalance valve holds it"
            )
        shut = above & ~feeds
        if shut.any():
            k = int(np.argmax(np.where(shut, pressure, -np.inf)))
            warnings.append(
                f"the oil on the {side} side of the {cylinder} has up to {with_unit(float(pressure[k]), 'Pa')} "
                f"at {response.t[k]:g} s while the supply does not feed it, more than the supply's {supply}: "
                "the model has no relief valve"
            )
    return warnings
