"""Hints at unusual numbers of a scene, and what its model leaves out, in words for a run's first page and load charts.

The usual range of a key is declared on its field (`pmr.scene.keys.Usual`): a range of magnitudes, in the key's unit or
in multiples of a scale, such as the length of the section.  A table may add scales (`hint_scales`), and numbers that
are not fields of it (`hint_numbers`).  Hints refuse nothing: a number may be possible and yet be in another unit.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from pydantic import BaseModel

from pmr.scene.built import GRAVITY, Load
from pmr.scene.choice import has_driven_tail, has_walls_that_could_give, traits_of
from pmr.scene.joints import BoomSection
from pmr.scene.keys import Hinted, Usual, qualified_name, quantity_of, usual_ranges
from pmr.scene.members import Member, member_at, members
from pmr.scene.scene import Scene
from pmr.scene.signals import SignalBase
from pmr.scene.structures import PointMass, Probe

Scales = Mapping[str, float]

#: Other units in which a number may be meant, by the unit of its key, likely ones first, and their size in this unit.
OTHER_UNITS: Mapping[str, Mapping[str, float]] = {
    "m": {"mm": 1e-3, "cm": 1e-2},
    "m^2": {"mm^2": 1e-6, "cm^2": 1e-4},
    "m^4": {"mm^4": 1e-12, "cm^4": 1e-8},
    "m/s": {"m/min": 1.0 / 60.0, "km/h": 1.0 / 3.6, "mm/s": 1e-3},
    "m/s^2": {"mm/s^2": 1e-3, "cm/s^2": 1e-2, "g": GRAVITY},
    "s": {"ms": 1e-3},
    "kg": {"t": 1e3, "g": 1e-3},
    "kg/m": {"t/m": 1e3, "kg/mm": 1e3, "g/m": 1e-3},
    "kg/m^3": {"t/m^3": 1e3, "kg/mm^3": 1e9, "t/mm^3": 1e12, "g/m^3": 1e-3},
    "kg m^2": {"t m^2": 1e3, "kg mm^2": 1e-6},
    "N": {"kN": 1e3, "MN": 1e6},
    "N m": {"kN m": 1e3, "N mm": 1e-3},
    "N m/rad": {"kN m/rad": 1e3, "N mm/rad": 1e-3},
    "N/m": {"N/mm": 1e3, "kN/mm": 1e6, "MN/mm": 1e9},
    "N m^2": {"N mm^2": 1e-6, "kN m^2": 1e3},
    "Pa": {"MPa": 1e6, "GPa": 1e9, "kPa": 1e3},
    "rad": {"degrees": math.pi / 180.0},
    "degrees": {"rad": 180.0 / math.pi},
    "1": {"%": 0.01},
}

#: Distance of a probe from the nearest corner, as a share of that between two corners, from which it is between them.
FROM_CORNER = 0.3
#: Share of the least second moment of a cross-section below which its torsion constant is that of an open profile.  The
#: share is 0.04 to 0.17 for rolled channels and I-sections, and more than 1 for closed and for solid cross-sections.
OPEN = 0.2
#: Share of a section's length up to which a probe is at the place of a force.
AT_JUMP = 1e-6


@dataclass(frozen=True)
class _UnusualNumber:
    """A number outside of its usual range from `low` to `high`; all three are in the same unit."""

    key: str
    value: float
    unit: str
    low: float
    high: float

    @property
    def distance(self) -> float:
        """Factor by which the magnitude is less than `low` or more than `high`."""
        return max(self.low / abs(self.value), abs(self.value) / self.high)

    @property
    def sentence(self) -> str:
        """Sentence with the key, the number, its usual range, and other units in which the number may be meant."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        usual = f"{self.low:.3g} to {self.high:.3g}{unit}" if self.low else f"up to {self.high:.3g}{unit}"
        if math.isinf(self.high):
            usual = f"{self.low:.3g}{unit} and more"
        values = {other: self.value * factor for other, factor in OTHER_UNITS.get(self.unit, {}).items()}
        likely = {other: value for other, value in values.items() if self.low <= abs(value) <= self.high}
        meant = [f"{self.value:.6g} {other} ({value:.3g}{unit})" for other, value in likely.items()]
        question = f"is {' or '.join(meant[:2])} meant?" if meant else "is the unit right?"
        return f"{self.key} = {self.value:.6g}{unit} is unusual: {usual} is usual here; {question}"


def hints(scene: Scene, at_rest: bool = False) -> list[str]:
    """Return a sentence for each key of a scene whose number is unusual, and remarks on what its model leaves out.

    The remarks are about a weight that lifts or is never whole, hung forces without a mass, open profiles, and probes
    where a beam does not know the stress.  A model `at_rest`, as that of a load chart, has its whole weight and needs
    no masses of hung forces.
    """
    numbers = list(_unusual_in_table(scene, "", boom_scales(scene)))
    for number, part in enumerate(scene.sections):
        key = f"sections[{number}]." if scene.sections[0].name else ""
        numbers += _unusual_in_table(part, key, boom_scales(scene) | _section_scales(part))
    is_whole = at_rest or "gravity.rise" in [number.key for number in numbers]  # or it is asked for its unit
    remarks = [_weight_remark(scene, is_whole), "" if at_rest else hung_force_remark(scene)]
    return [*_sentences(numbers), *filter(None, remarks), *_open_profile_remarks(scene), *_probe_remarks(scene)]


def _weight_remark(scene: Scene, is_whole: bool) -> str:
    """Sentence about a weight that lifts or, unless it `is_whole`, still grows when a run ends; empty for others."""
    gravity, end = scene.gravity, scene.time.end
    if gravity is not None and gravity.direction[2] > 0.0:
        return "gravity.direction points upwards, along z: the weight lifts this boom"
    if gravity is None or is_whole or gravity.rise <= end:
        return ""
    reached = 100.0 * float(gravity.signal.value(end)) / gravity.acceleration
    remedy = "gravity.rise = 0" if scene.start == "equilibrium" else "a shorter rise, or start = 'equilibrium',"
    return (
        f"the weight grows for gravity.rise = {gravity.rise:g} s, but the run ends at {end:g} s, when it has reached "
        f"{reached:.2g} %; {remedy} has the whole weight"
    )


def _open_profile_remarks(scene: Scene) -> Iterator[str]:
    """Yield a sentence for each beam whose torsion constant is that of an open profile."""
    for member in members(scene):
        section = member.part.body.section
        if section is None or traits_of(member).is_planar:
            continue
        if section.torsion_constant >= OPEN * section.least_second_moment:
            continue
        yield (
            f"{scene.section_key(member.number, 'body.section.torsion_constant')} = {section.torsion_constant:.4g} m^4 "
            "is that of an open profile: this beam warps freely, and twists too far where it is kept from warping; "
            "body.model = 'shell' with a mesh.file has this effect"
        )


def _probe_remarks(scene: Scene) -> Iterator[str]:
    """Yield a sentence for each probe of a beam's stress or strain between its corners, or where section forces jump.

    Section forces jump at supports, masses and loads at points, and at the lug of the luffing cylinder.
    """
    frame = scene.frame
    for number, member in enumerate(members(scene)):
        part = member.part
        jumps = dict[float, str]()
        for kind, group in (("support", part.supports), ("mass", part.masses), ("load", part.loads)):
            jumps |= {float(of.on): f"the {kind} {of.name}" for of in group if isinstance(of.on, float)}
        jumps |= {of.at[0]: f"the mass {of.name}" for of in part.masses if of.at is not None}
        jumps |= {of.point[0]: f"the load {of.name}" for of in part.loads if of.point is not None}
        if frame is not None and frame.cylinder is not None and not number:
            jumps[frame.cylinder.lug[0] - frame.tail_position[0]] = "the luffing cylinder"
        for probe in part.probes if traits_of(member).is_beam else ():
            if probe.at is None or not {"stress", "strain"} & set(probe.measures):
                continue
            if _is_between_corners(member, probe):
                yield (
                    f"probe {probe.name} of {part.name or 'the body'} is between corners of the box: a beam has "
                    "stresses at its corners alone, and the probe has that of the nearest one, or of one of two that "
                    "are as near; probes at the corners have all of them"
                )
            for acting in (name for x, name in jumps.items() if abs(x - probe.at[0]) <= AT_JUMP * part.length):
                yield (
                    f"probe {probe.name} of {part.name or 'the body'} is where {acting} acts, at {probe.at[0]:.6g} m: "
                    "section forces jump there, and the probe has the stress on the side of the tail alone; a probe "
                    "beside this place on each side has both"
                )


def _is_between_corners(member: Member, probe: Probe) -> bool:
    """Return whether a probe on a beam in space is far from all corners of its box, and names none of them."""
    box = member.part.body.box
    if probe.at is None or probe.face or box is None or traits_of(member).is_planar:
        return False
    corners = np.array([corner.position for corner in box.profile_at(probe.at[0]).corners])
    nearest, second = np.argsort(np.linalg.norm(corners - probe.at[1:], axis=1))[:2]
    apart = float(np.linalg.norm(corners[nearest] - corners[second]))
    return float(np.linalg.norm(corners[nearest] - probe.at[1:])) > FROM_CORNER * apart


def table_hints(table: BaseModel, scene: Scene) -> list[str]:
    """Return a sentence for each key of `table` with an unusual number, judged by the scales of the scene.

    The table is not part of the scene; it may be a study of the scene.
    """
    return _sentences(_unusual_in_table(table, "", boom_scales(scene)))


def _sentences(numbers: Iterable[_UnusualNumber]) -> list[str]:
    """Return one sentence for each key, about its most unusual number; keys that differ only in indices are one."""
    by_key: dict[str, list[_UnusualNumber]] = {}
    for number in numbers:
        by_key.setdefault(re.sub(r"\[\d+\]", "", number.key), []).append(number)
    lines = []
    for alike in by_key.values():
        more = f" ({len(alike) - 1} more like it)" if len(alike) > 1 else ""
        lines.append(max(alike, key=lambda number: number.distance).sentence + more)
    return lines


def _unusual_in_table(table: BaseModel, key: str, scales: Scales) -> Iterator[_UnusualNumber]:
    """Yield the unusual numbers of a table and of its inner tables; `key` is the table's key followed by a dot.

    `scales` are magnitudes by name, such as the boom's length, in whose multiples some ranges are stated (`Usual`).
    """
    if isinstance(table, Hinted):
        scales = {**scales, **table.hint_scales(scales)}
        for name, (value, judged_by) in table.hint_numbers.items():
            yield from _unusual_number(value, f"{key}{name}", (judged_by,), judged_by.unit, scales)
    for name in type(table).model_fields:
        if name == "sections" and isinstance(table, Scene):
            continue  # each section has scales of its own
        quantity, usual = quantity_of(type(table), name), usual_ranges(type(table), name)
        unit = quantity.unit if quantity is not None else ""
        yield from _unusual_in_value(getattr(table, name), f"{key}{name}", usual, unit, scales)


def _unusual_in_value(
    value: object, key: str, usual: tuple[Usual, ...], unit: str, scales: Scales
) -> Iterator[_UnusualNumber]:
    """Yield the unusual numbers of a field's `value` and of all lists and tables nested in it.

    `key` is the field's key.  Numbers and signals of the field have the `usual` ranges and the `unit`.  Inner tables
    have ranges of their own.  A signal is judged by its largest magnitude in the run.  If the signal goes on beyond the
    run, it is unusual only if its largest magnitude of all times is unusual, too.  `scales` are those of
    `_unusual_in_table`.
    """
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        yield from _unusual_number(float(value), key, usual, unit, scales)
    elif isinstance(value, (tuple, list)):
        for number, entry in enumerate(value):
            yield from _unusual_in_value(entry, f"{key}[{number}]", usual, unit, scales)
    elif isinstance(value, Mapping):
        for name, entry in value.items():
            yield from _unusual_in_value(entry, f"{key}.{name}", usual, unit, scales)
    elif isinstance(value, BaseModel):
        if isinstance(value, SignalBase) and usual:
            ends = (scales["time"], max(scales["time"], *value.breaks, 0.0))  # of the run, and of the signal
            largest = (max(value.bounds(0.0, end), key=abs) for end in ends)
            in_run, in_all = ([*_unusual_number(of, key, usual, unit, scales)] for of in largest)
            yield from in_run if in_all else ()
        yield from _unusual_in_table(value, f"{key}.", scales)


def _unusual_number(
    value: float, key: str, usual: tuple[Usual, ...], unit: str, scales: Scales
) -> Iterator[_UnusualNumber]:
    """Yield the number `value` of a key if its magnitude is outside of the intersection of its `usual` ranges.

    The number is in the unit of the last range, or in `unit` if that range has none.  Nothing is yielded if the ranges
    have nothing in common.  0 is never unusual.  A range in multiples of a scale is left out if
    `scales` lacks this scale or has it as 0.
    """
    ranges = [of for of in usual if not of.scale or scales.get(of.scale)]
    if not (value and ranges):
        return
    sizes = [scales.get(of.scale, 1.0) for of in ranges]
    low = max(of.low * size for of, size in zip(ranges, sizes, strict=True))
    high = min(of.high * size for of, size in zip(ranges, sizes, strict=True))
    if low <= high and not low <= abs(value) <= high:
        yield _UnusualNumber(key, value, ranges[-1].unit or unit, low, high)


def boom_scales(scene: Scene) -> dict[str, float]:
    """Return the scales of the whole boom: reach in m, mass in kg, weight in N, time in s and gravity in m/s^2.

    Their names are ``reach``, ``boom`` (the mass), ``weight``, ``time`` and ``gravity``.  Reach, mass or weight is 0 if
    it is not known of one of the sections.
    """
    sections = [_section_scales(part) for part in scene.sections]
    lengths, masses, weights = ([scales[name] for scales in sections] for name in ("length", "mass", "weight"))
    reach, mass, weight = (sum(sizes) if all(sizes) else 0.0 for sizes in (lengths, masses, weights))
    return {"reach": reach, "boom": mass, "weight": weight, "time": scene.time.end, "gravity": GRAVITY}


def _section_scales(part: BoomSection) -> dict[str, float]:
    """Return ``length`` in m, ``mass`` in kg and ``weight`` in N of a section.

    All are 0 if a number of its body is unusual.  Mass and weight are 0 if only a mesh file describes the body.
    """
    if any(_unusual_in_table(part.body, "", {"gravity": GRAVITY})):
        return dict.fromkeys(("length", "mass", "weight"), 0.0)
    return {"length": part.length, "mass": _mass(part), "weight": GRAVITY * _mass(part)}


def _mass(part: BoomSection) -> float:
    """Return the mass in kg of a section's mover, beam or box, without frames; 0 for a mesh file."""
    body = part.body
    if body.mover is not None:
        return body.mover.mass + body.mover.wheel_mass
    if body.profile is not None:
        return body.profile.mass_per_length * body.profile.length
    if body.box is None:
        return 0.0
    volume = body.box.volume if body.section is None else body.section.area * body.box.length
    return body.material.density * volume


#: Least share of a hung load's mass that point masses at its place must have, so that the load counts as having a mass.
HAS_MASS = 0.5


class Effect(NamedTuple):
    """Effect that a model leaves out, in words, and what checks it: a key or table of the scene, a command or hands."""

    text: str
    check: str = "by hand"
    is_stated: bool = False  # whether text without checks names the check, too


#: Effect of a play of pads that nothing computed.
PLAY = "play (at side pads it changes the stress in walls)"


def left_out(scene: Scene, at_rest: bool = False, play: str = PLAY, in_walls: bool = False) -> dict[str, str]:
    """Return the effects that the model of a scene does not contain (`effects_left_out`), as text by subject."""
    effects = effects_left_out(scene, at_rest, play, in_walls)
    return {
        subject: ", ".join(f"{effect.text} ({effect.check})" if effect.is_stated else effect.text for effect in of)
        for subject, of in effects.items()
    }


def effects_left_out(
    scene: Scene, at_rest: bool = False, play: str = PLAY, in_walls: bool = False
) -> dict[str, list[Effect]]:
    """Return effects that the model of a scene does not contain, by subject.

    The subjects are ``strength``, ``walls``, ``pads``, ``masses``, ``loads`` and ``machine``; subjects without an
    effect are left out.  An effect that has a key of its own, such as wind or friction, is named only if the scene does
    not use this key.  A model `at_rest`, as that of a load chart, has neither friction nor fatigue.  `play` names the
    play of pads that the results lack, if no pad has one.  `in_walls` says whether the stress in walls under pads is
    known.
    """
    effects = {
        "strength": strength_effects(scene, at_rest, in_walls),
        "walls": _wall_effects(scene),
        "pads": _pad_effects(scene, at_rest, play),
        "masses": _missing_masses(scene),
        "loads": _load_effects(scene),
        "machine": _machine_effects(scene),
    }
    return {subject: of for subject, of in effects.items() if of}


def hung_forces(scene: Scene) -> dict[str, float]:
    """Return the mass in kg whose weight equals each force that only pulls the tip down, by the load's name.

    Only vertical forces on the last section are listed, with their largest pull during the run.  The result is empty
    without gravity, and if the masses at the tip are at least the share `HAS_MASS` of the sum of these masses.
    """
    part = scene.sections[-1]
    gravity = scene.gravity.acceleration if scene.gravity is not None else 0.0
    at_tip = sum(mass.mass for mass in part.masses if mass.on == "tip")
    hung = {
        qualified_name(part.name, load.name): -load.signal.bounds(0.0, scene.time.end)[0] / gravity
        for load in part.loads
        if gravity and is_hung(load, scene)
    }
    return hung if at_tip < HAS_MASS * sum(hung.values()) else {}


def is_hung(load: Load, scene: Scene) -> bool:
    """Return whether a load is a force along the ground's Z on a section's tip that pulls down and never up."""
    low, high = load.signal.bounds(0.0, scene.time.end)
    is_down = (load.acts, load.axes, load.direction, load.on) == ("force", "ground", "z", "tip")
    return is_down and low < 0.0 >= high


def hung_force_remark(scene: Scene) -> str:
    """Return a sentence that names the forces of `hung_forces`; empty if there are none."""
    hung = hung_forces(scene)
    names = " and ".join(f"{name} ({mass:.4g} kg)" for name, mass in hung.items())
    are, its = ("are forces", "their") if len(hung) > 1 else ("is a force", "its")
    return (
        f"{names} {are} without mass: frequencies, accelerations and the forces that they cause lack {its} inertia; "
        "[[masses]] with payload = true, or [hoist], has it"
        if hung
        else ""
    )


def strength_effects(scene: Scene, at_rest: bool = False, in_walls: bool = False) -> list[Effect]:
    """List the effects on strength that no stress contains.

    Fatigue is one of these effects if the model is `at_rest`, or if the scene does not ask for fatigue.  Bending of
    walls under pads of beams is one unless `in_walls` is true: then a shell beside the beam has this stress.  The list
    is empty if all sections are planar beams given by their stiffnesses, or masses on wheels: they have no stresses.
    """
    if all(part.body.profile is not None or part.body.mover is not None for part in scene.sections):
        return []  # lines without a section, which have no stress
    effects, boxes = list[Effect](), [member for member in members(scene) if member.part.body.box is not None]
    if not in_walls and any(traits_of(member).is_beam and member.pads for member in boxes):
        effects.append(Effect("bending of walls under pads (in stresses of beams)", "key body.model = 'shell'"))
    if boxes:
        effects += [Effect("buckling of plates"), Effect("entry of loads into walls (at lugs, hinges and the head)")]
    effects += [Effect("welds, bolts and cut-outs"), Effect("plastic deformation")]
    return effects if scene.fatigue is not None and not at_rest else [*effects, Effect("fatigue", "table [fatigue]")]


def _wall_effects(scene: Scene) -> list[Effect]:
    """List what is left out of walls: their compliance under pads of a beam, and the side on which doublers lie.

    The compliance is named if a pad presses on a beam whose walls could be modelled as compliant but are rigid.
    """
    effects = list[Effect]()
    if any(map(has_walls_that_could_give, members(scene))):
        text = "compliance of walls under pads, so that deflections are too small, frequencies too high and forces of "
        effects.append(Effect(f"{text}pads off", "body.walls = 'give' adds it", is_stated=True))
    boxes = [part.body.box for part in scene.sections if part.body.box is not None]
    if any(doubler.side == "middle" for box in boxes for doubler in box.doublers):
        effects.append(Effect("the side of walls on which doublers lie", "their key side adds it", is_stated=True))
    return effects


def _pad_effects(scene: Scene, at_rest: bool, play: str) -> list[Effect]:
    """List the effects in pads that are left out; empty if there are no pads.

    Friction is left out if the model is `at_rest`, or if no pad of the scene has friction.  Play is left out, in the
    words `play`, if no pad of the scene has a clearance.
    """
    rings = [ring for part in scene.sections for ring in part.rings]
    if not rings:
        return []
    rubbing = not at_rest and any(getattr(ring, "friction", 0.0) for ring in rings)
    effects = [] if rubbing else [Effect("friction", "key friction of pads")]
    effects += [Effect("wear"), Effect("spread of the pressure under a pad")]
    if not any(ring.has_clearance for ring in rings):
        effects.append(Effect(play, "key clearance of pads"))
    return effects


def _missing_masses(scene: Scene) -> list[Effect]:
    """List the parts of a boom of boxes whose mass only a [[masses]] table of the scene could add.

    The scene's [[masses]] are not looked at.  The list is empty if no section is a box.
    """
    if not any(part.body.box for part in scene.sections):
        return []
    has_hoses = any(part.body.attached_mass_per_length for part in scene.sections)
    others = "stiffeners, pads and fittings" if has_hoses else "stiffeners, pads, hoses and fittings"
    attached = ", what is attached along them" if has_hoses else ""
    joined = any(part.joint is not None and part.joint.cylinder is not None for part in scene.sections)
    cylinders = ["cylinders"] if joined or scene.frame is not None and scene.frame.cylinder is not None else []
    texts = [*cylinders, f"{others} (only walls{attached} and the scene's masses have weight)"]
    return [Effect(text, "table [[masses]]") for text in texts]


def _load_effects(scene: Scene) -> list[Effect]:
    """List the loads and the dynamic effects of loads that the scene does not have.

    The list is empty for a scene without a frame whose sections are no boxes.
    """
    loads = [load for part in scene.sections for load in part.loads]
    masses: list[PointMass] = [mass for part in scene.sections for mass in part.masses]
    if scene.frame is None and not any(part.body.box for part in scene.sections):
        return []
    acting = {load.acts for load in loads}
    calm = [part.name for part in scene.sections if not any(load.acts == "wind" for load in part.loads)]
    by_wind, by_warmth = "acts = 'wind' of [[loads]]", "acts = 'temperature' of [[loads]]"
    is_calm = len(calm) == len(scene.sections)
    effects = [Effect("wind on the sections", by_wind) if is_calm else Effect("wind on machine and payload")]
    effects += [Effect(f"wind on {' and '.join(calm)}", by_wind)] if calm and not is_calm else []
    effects += [] if "temperature" in acting else [Effect("temperature", by_warmth)]
    if any(mass.payload for mass in masses):
        effects.append(Effect("rope and swing of the payload (it is fixed to the tip)", "table [hoist]"))
    return effects


def _machine_effects(scene: Scene) -> list[Effect]:
    """Effects of a machine that the model leaves out, such as play in hinges, each as a noun phrase of a sentence.

    The list is empty for a single body without a frame, the table that mounts a boom on a machine.
    """
    frame = scene.frame
    if frame is None and len(scene.sections) == 1:
        return []
    effects, cylinder = [Effect("play in hinges")], None if frame is None else frame.cylinder
    driven = [number for number in range(1, len(scene.sections)) if has_driven_tail(member_at(scene, number))]
    if central := [scene.names[number] for number in driven if scene.joint(number).line is None]:
        placed = f"line of action of the cylinder or rope of {' and '.join(central)} off the axis"
        effects.append(Effect(placed, "key offset", is_stated=True))
    if frame is not None and frame.machine is None:
        stands = frame.ground is not None
        effects.append(
            Effect("ground and chassis that give way", "table [frame.machine]")
            if stands
            else Effect("what the machine stands on, and its tipping", "table [frame.ground]")
        )
    if cylinder is None or cylinder.oil is None:
        by_oil = "by hand" if cylinder is None else "table [frame.cylinder.oil]"
        effects.append(Effect("oil and valves (drives follow the prescribed motion)", by_oil))
    else:
        effects.append(Effect("relief valves and dry friction of the cylinder on oil"))
    by_rod = "by hand" if cylinder is None else "key rod of frame.cylinder, by hand for other cylinders"
    return [*effects, Effect("buckling of cylinders", by_rod)]
