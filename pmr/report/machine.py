"""The machine in a table: sections, walls, masses, pads, what holds it, loads, angles, reach."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pmr.report.numbers import SPACE, plain, quantity, significant
from pmr.report.parameters import by_face, doubled, framed, stiff, tapered
from pmr.report.subject import loads_as_asked, rings_of, spoken
from pmr.results import RunResult
from pmr.scene.built import Support
from pmr.scene.choice import model_of
from pmr.scene.members import members
from pmr.scene.names import named
from pmr.scene.parts import OneBody

Rows = Iterator[tuple[str, str]]


def rows(result: RunResult) -> Rows:
    """What was asked, one thing a row."""
    yield from _bodies(result)
    yield from _masses(result)
    yield from _held(result)
    for load in loads_as_asked(result):
        values = load.values
        most = float(values[np.argmax(np.abs(values))]) if len(values) else 0.0
        yield named(load.body, load.name), f"up to {quantity(most, load.unit)} {load.where}"
    scene = result.scene
    yield "weight of the boom", _weight(result)
    if scene.frame is not None:
        for name, angle in zip(("luffing", "slewing"), scene.frame.angles, strict=True):
            low, high = np.rad2deg(angle.bounds(0.0, scene.time.end))
            if low or high:
                yield name, between(low, high, "°")
    elif scene.gravity is not None and abs(scene.gravity.raised) >= 0.01:
        yield "raised by", f"{plain(round(scene.gravity.raised, 1))}°"
    if result.reach is not None:
        yield "reach along the boom", between(float(result.reach.min()), float(result.reach.max()), f"{SPACE}m")
    yield "time", f"{plain(scene.time.end)}{SPACE}s"


def between(low: float, high: float, unit: str) -> str:
    """From a value to another one; one value where they don't differ as printed."""
    low, high = (round(float(end), 2) for end in (low, high))
    return f"{plain(low)} to {plain(high)}{unit}" if high > low else f"{plain(low)}{unit}"


def _bodies(result: RunResult) -> Rows:
    """Size and weight of each section; what all of them are modelled as, and their yield stress."""
    masses = {one["name"]: one["mass"] for one in result.summary.get("masses", ())}
    models, limits = dict[str, None](), dict[str, None]()
    for member, (name, part) in zip(members(result.scene), result.scene.bodies.items(), strict=True):
        called = name or "structure"
        found = [_size(part)] if part.body.box is not None else []
        found += [_kg(masses[name])] if name in masses else []
        if found:
            yield called, ", ".join(found)
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
        f", {name} {by_face(given)}{SPACE}mm"
        for name, given in (("radius", box.radius), ("chamfer", box.chamfer))
        if given
    )
    more = "".join(f", doubler {doubled(one)}" for one in box.doublers)
    more += f", frames {framed(box)}" if box.frames else ""
    tapers = (("tail", box.tail_taper), ("tip", box.tip_taper))
    more += "".join(f", tapers to its {end} {tapered(taper)}" for end, taper in tapers if taper is not None)
    return f"box of {plain(box.length)}{SPACE}m, {sides}{cut}, wall {by_face(box.wall)}{SPACE}mm{more}"


def _masses(result: RunResult) -> Rows:
    for name, part in result.scene.bodies.items():
        for mass in part.masses:
            yield named(name, mass.name), f"{plain(mass.mass)}{SPACE}kg on {mass.on}"
    if found := result.summary.get("masses"):
        yield "total mass", _kg(sum(one["mass"] + one["attached"] for one in found))


def _held(result: RunResult) -> Rows:
    """Pads between sections, and what holds the base."""
    for name, part in result.scene.bodies.items():
        if rings := rings_of(part):
            count = sum(sum(len(places) for places in ring.faces.values()) if ring.faces else 1 for ring in rings)
            stiffness = dict.fromkeys(stiff(ring.stiffness) for ring in rings)
            ways = dict.fromkeys("only pushing" if ring.unilateral else "holding both ways" for ring in rings)
            yield f"pads of {name}" if name else "pads", f"{count}, {', '.join((*stiffness, *ways))}"
        if part.supports:
            yield " ".join(filter(None, (name, "held by"))), "; ".join(map(_support, part.supports))


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
