"""The machine in a table: sections, walls, masses, pads, what holds it, loads, angles, reach."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pmr.report import space
from pmr.report.columns import lines, spread
from pmr.report.numbers import MINUS, SPACE, plain, quantity, significant
from pmr.report.parameters import by_face, doubler_words, frame_words, stiff, taper_words
from pmr.report.subject import Acting, is_raised, length, loads_as_asked, moving_part, rings_of, spoken
from pmr.results import RunResult
from pmr.scene.built import Support
from pmr.scene.choice import model_of
from pmr.scene.frame import Frame
from pmr.scene.joints import OneBody
from pmr.scene.keys import named
from pmr.scene.members import members

Array = NDArray[np.float64]
PLACES = 400  # at which the way of a tip is looked at
Rows = Iterator[tuple[str, str]]


def rows(result: RunResult) -> Rows:
    """Rows about the machine, its motion and its loads."""
    yield from _bodies(result)
    yield from _masses(result)
    yield from _pad_rows(result)
    for load in loads_as_asked(result):
        yield named(load.body, load.name), _load_text(load)
    scene = result.scene
    yield "weight of the boom", _weight(result)
    if scene.frame is not None:
        yield from _below(scene.frame, scene.time.end)
        for name, angle in zip(("luffing", "slewing"), scene.frame.angles, strict=True):
            low, high = np.rad2deg(angle.bounds(0.0, scene.time.end))
            if low or high:
                yield name, extent(low, high, "°")
    elif scene.gravity is not None:
        yield "raised by", f"{plain(round(scene.gravity.raised, 1))}°" if is_raised(result) else "0°, it lies level"
    if result.reach is not None:
        yield "reach along the boom", extent(float(result.reach.min()), float(result.reach.max()), f"{SPACE}m")
    elif moving_part(result) == "mouth":
        low, high = scene.path_bounds
        yield "out of its mouth", extent(length(result) - high, length(result) - low, f"{SPACE}m")
    yield from _tip(result)
    yield "time", f"{plain(scene.time.end)}{SPACE}s"


def _tip(result: RunResult) -> Rows:
    """Range of the tip of a boom that is raised, from the pivot."""
    response = result.responses["reduced"]
    if lines(result, response) and (result.scene.frame is not None or is_raised(result)):
        out, up = space.axes(result, spread(len(response.t), PLACES))[-1].side[:, -1].T
        far, high = (extent(float(coordinate.min()), float(coordinate.max()), f"{SPACE}m") for coordinate in (out, up))
        yield "tip from the pivot", f"{far} out, {high} up"


def _load_text(load: Acting) -> str:
    """How large a load is at most, where, and along which axis, against which where it acts against it alone."""
    where, _, axis = load.where.rpartition(" along ")
    if load.values.min(initial=0.0) < 0.0 and load.values.max(initial=0.0) <= 0.0:
        return f"{_range(-load.values, load.unit)} {where} along {MINUS}{axis}"
    return f"{_range(load.values, load.unit)} {load.where}"


def _range(values: Array, unit: str) -> str:
    """The largest of a load, or both ends where it acts both ways."""
    low, high = float(values.min(initial=0.0)), float(values.max(initial=0.0))
    if low < 0.0 < high:
        return f"{quantity(low, unit)} to {quantity(high, unit)}"
    return f"up to {quantity(high or low, unit)}"


def _below(frame: Frame, end: float) -> Rows:
    """The machine below the pivot: what it is, what it stands on, what acts on it, and how the ground moves."""
    if (machine := frame.machine) is not None:
        place = ", ".join(map(plain, machine.center))
        free = f"free along {', '.join(machine.free)}" if machine.free else "held"
        yield "machine", f"{plain(machine.mass)}{SPACE}kg with its centre at ({place}){SPACE}m, {free}"
        if springs := [f"{key} {_spring(key, value)}" for key, value in machine.stiffness.given.items()]:
            yield "machine on springs", ", ".join(springs)
        for what, base, acting in (("force", "N", machine.force), ("moment", "N m", machine.moment)):
            for axis, signal in acting.given.items():
                bounds = np.array(signal.bounds(0.0, end))
                yield f"{what} on the machine", f"{_range(bounds, base)} {'along' if base == 'N' else 'about'} {axis}"
        for what, values_by_key, per in (("displaced", machine.start.given, ""), ("moving", machine.rate.given, "/s")):
            if values_by_key:
                texts = (f"{key} {plain(value)}{_unit(key, frame.unit)}{per}" for key, value in values_by_key.items())
                yield f"machine {what} at the start", ", ".join(texts)
    if frame.base is not None:
        called = "ground" if frame.machine is not None else "machine"
        ranges = {key: signal.bounds(0.0, end) for key, signal in frame.base.motions.items()}
        parts = [f"{key} {extent(*bounds, _unit(key, frame.unit))}" for key, bounds in ranges.items()]
        parts += [f"accelerated along {key}" for key, signal in frame.base.accelerations.items() if signal is not None]
        yield f"motion of the {called}", ", ".join(parts)


def _spring(key: str, stiffness: float) -> str:
    return f"{plain(1e-6 * stiffness)}{SPACE}{f'MN{SPACE}m/rad' if key.startswith('r') else 'kN/mm'}"


def _unit(key: str, angles: str) -> str:
    if not key.startswith("r"):
        return f"{SPACE}m"
    return "°" if angles == "degrees" else f"{SPACE}rad"


def extent(low: float, high: float, unit: str) -> str:
    """From a value to another one; one value where they don't differ as printed."""
    low, high = (round(float(end), 2) for end in (low, high))
    return f"{plain(low)} to {plain(high)}{unit}" if high > low else f"{plain(low)}{unit}"


def _bodies(result: RunResult) -> Rows:
    """Size and weight of each section; what all of them are modelled as, and their yield stress."""
    masses = {mass["name"]: mass["mass"] for mass in result.summary.get("masses", ())}
    models, limits = dict[str, None](), dict[str, None]()
    for member, (name, part) in zip(members(result.scene), result.scene.bodies.items(), strict=True):
        called = name or "structure"
        properties = [_size(part)] if part.body.box is not None else []
        properties += [_kg(masses[name])] if name in masses else []
        if properties:
            yield called, ", ".join(properties)
        models[spoken(model_of(member), part.body.walls)] = None
        if (limit := part.body.material.yield_stress) is not None:
            limits[quantity(limit, "Pa")] = None
    yield "modelled as", "; ".join(models)
    if limits:
        yield "yield stress", "; ".join(limits)


def _size(part: OneBody) -> str:
    box = part.body.box
    assert box is not None
    sides = f"{plain(1e3 * box.width)} × {plain(1e3 * box.height)}{SPACE}mm"
    cut = "".join(
        f", {name} {by_face(cut_length)}{SPACE}mm"
        for name, cut_length in (("radius", box.radius), ("chamfer", box.chamfer))
        if cut_length
    )
    more = "".join(f", doubler {doubler_words(doubler)}" for doubler in box.doublers)
    more += f", frames {frame_words(box)}" if box.frames else ""
    tapers = (("tail", box.tail_taper), ("tip", box.tip_taper))
    more += "".join(f", tapers to its {end} {taper_words(taper)}" for end, taper in tapers if taper is not None)
    return f"box of {plain(box.length)}{SPACE}m, {sides}{cut}, wall {by_face(box.wall)}{SPACE}mm{more}"


def _masses(result: RunResult) -> Rows:
    for name, part in result.scene.bodies.items():
        for mass in part.masses:
            yield named(name, mass.name), f"{plain(mass.mass)}{SPACE}kg on {mass.on}"
    if masses := result.summary.get("masses"):
        attached = ", ".join(mass.name for part in result.scene.bodies.values() for mass in part.masses)
        of = f" with {attached}" if attached else ""
        yield "total mass", _kg(sum(mass_of_body["mass"] + mass_of_body["attached"] for mass_of_body in masses)) + of


def _pad_rows(result: RunResult) -> Rows:
    """Pads between sections, those that are alike in one row, and what holds the base."""
    alike = dict[tuple[int, str], list[str]]()
    for name, part in result.scene.bodies.items():
        if rings := rings_of(part):
            count = sum(sum(len(places) for places in ring.faces.values()) if ring.faces else 1 for ring in rings)
            stiffness = dict.fromkeys(stiff(ring.stiffness) for ring in rings)
            ways = dict.fromkeys("only pushing" if ring.unilateral else "holding both ways" for ring in rings)
            alike.setdefault((count, ", ".join((*stiffness, *ways))), []).append(name)
        if part.supports:
            yield " ".join(filter(None, (name, "held by"))), "; ".join(map(_support, part.supports))
    for (count, pad_text), names in alike.items():
        of = ", ".join(filter(None, names))
        yield f"pads of {of}" if of else "pads", f"{count}{' each' if len(names) > 1 else ''}, {pad_text}"


def _support(support: Support) -> str:
    where = f"on its {support.on}" if isinstance(support.on, str) else f"at {plain(support.on)}{SPACE}m"
    along = support.kind if support.directions is None else f"along {', '.join(support.directions)}"
    stiffness = stiff(support.stiffness)
    if all(direction.startswith("r") for direction in support.held):
        stiffness = stiffness.replace("kN/mm", f"MN{SPACE}m/rad")  # 1e6 N m/rad are called so
    return f"{support.name} {along} {where}, {stiffness}".strip()


def _weight(result: RunResult) -> str:
    gravity = result.scene.gravity
    return "left out" if gravity is None else f"included, {significant(gravity.acceleration)}{SPACE}m/s²"


def _kg(mass: float) -> str:
    return f"{plain(round(mass, 1))}{SPACE}kg"
