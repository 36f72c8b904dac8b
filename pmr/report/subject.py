"""Properties of a result that reports need for every kind of scene: names of models, parts, positions, lengths, loads.

Only this module and `pmr.report.columns` know how a scene stores these.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from pmr.files.arrays import Array, Summary
from pmr.report.numbers import format_input, format_percent, format_quantity
from pmr.results import BodyResult, RunResult
from pmr.results.quantities import DIRECTION, QUANTITIES
from pmr.scene.built import Load, PadRing, Support
from pmr.scene.choice import input_directions
from pmr.scene.joints import JointPads
from pmr.scene.keys import ALONE, LUFFING_CYLINDER, input_name, qualified_name
from pmr.scene.mechanism import AT_PIVOT, pin_and_cylinder, supports_at_lug
from pmr.scene.members import members
from pmr.scene.model_traits import model_traits
from pmr.scene.scene import BoomSection, Scene
from pmr.scene.signals import SignalBase

#: Axes of the boom.
AXES = ("x", "y", "z")
#: Words for the directions across the axis.
_ACROSS = {"y": "lateral, y", "z": "vertical, z"}


@dataclass(frozen=True)
class AppliedLoad:
    """Load on a body, or a component of a load along an axis of the body.

    `direction` is ``x``, ``y``, ``z``, ``rx``, ``ry`` or ``rz`` of the body's axes, and `position` the distance along
    the body in m.  `source` is the load in the scene; `values` have its unit.
    """

    name: str
    body: str
    direction: str
    position: float
    values: Array  # (T,): N, N m, K, or N/m of wind
    source: Load


def play_clause(result: RunResult, quantity: str, name: str = "") -> str:
    """Clause with the largest value of a `quantity` in the run with another play of the pads (``budget.play``).

    `name` is the part or direction that the value belongs to.  If there was no such run, the clause says that the value
    was computed without play, provided that pads only push and have no play.  In any other case the clause is empty.
    """
    play = play_summary(result)
    for row in play.get("rows", ()):
        if (row["quantity"], row["name"]) == (quantity, name):
            return f"; {format_quantity(row['varied'], QUANTITIES[quantity].unit)} {play_words(play['gap'])}"
    rings = [ring for part in result.scene.sections for ring in part.rings if ring.unilateral]
    return (
        "; computed without play of pads, which no error bar includes"
        if rings and not any(ring.has_clearance for ring in rings)
        else ""
    )


def play_ratio(result: RunResult, quantity: str, name: str, value: float) -> float | None:
    """Ratio of the largest value of a quantity in a run with another play of the pads to `value`, that of this run.

    The result is None if there was no such run, or if `value` is not the largest value of this run (`play_clause`).
    """
    for row in play_summary(result).get("rows", ()):
        if (row["quantity"], row["name"]) == (quantity, name) and np.isclose(row["value"], value, rtol=1e-6):
            return float(row["varied"] / row["value"])
    return None


def play_summary(result: RunResult) -> Summary:
    """Entry ``budget.play`` of a run's summary; empty if the summary has no such entry."""
    return (result.summary.get("budget") or {}).get("play") or {}


def play_words(gap: float) -> str:
    """Words for a play of pads of `gap` m from face to face; a gap of 0 means that the play was taken away."""
    return f"with {format_input(1e3 * gap, 'mm')} of play of pads" if gap else "without the play of pads"


def direction_words(result: RunResult, direction: str) -> str:
    """Words for a direction across the axis; z is vertical unless a boom is raised or in a frame."""
    raised = result.frame is not None or is_raised(result)
    return "perpendicular to the boom, z" if direction == "z" and raised else _ACROSS[direction]


def elevation(result: RunResult, t: Array) -> Array | None:
    """Angles (T,) in rad from level to the boom at times t (T,) in s.

    The result is None if a base moves or is inclined.  Without a frame, the angle is constant, that of gravity; it is
    None if no weight acts.
    """
    if result.frame is None:
        gravity = result.scene.gravity
        return None if gravity is None else np.full(len(t), np.deg2rad(gravity.elevation))
    keeps_level = result.frame.base is None and not result.frame.base_angles
    return result.frame.angles[0].value(t) if keeps_level else None


def is_raised(result: RunResult) -> bool:
    """Whether gravity is turned by at least 0.01 degrees, as it is for a boom that is raised."""
    gravity = result.scene.gravity
    return gravity is not None and abs(gravity.elevation) >= 0.01


@dataclass(frozen=True)
class Fixture:
    """Support at `position` m that acts across the axis and does not move along it.

    `kind` names the symbol by which it is drawn: ``clamped``, a symbol of a support at a point, or ``pad``.
    """

    position: float
    kind: str


def reduced_size(result: RunResult) -> int:
    """Number of coordinates of the reduced model, from the summary or else from the basis; 0 if both lack it."""
    shapes = result.body.shapes
    basis = 0 if shapes is None else shapes.shapes.shape[1]
    return int(result.summary.get("coordinates", {}).get("reduced", basis))


def structural_model_words(model: str, walls: str) -> str:
    """Name a structural model in words, such as ``a planar beam``; for beams also say if their walls are flexible."""
    traits = model_traits(model)
    return traits.words + " whose walls give under pads" * (walls == "give" and traits.walls_may_give)


def choice_clause(measured: Summary) -> str:
    """Clause that states why measurements chose a model.

    It has the error of each model that was tried, and the allowed error.  If no model could be compared, the clause
    says that the smallest one was taken, and why.  `measured` is the summary's entry on these measurements.
    """
    if "reason" in measured:
        return f"the smallest one, which nothing could be compared with: {measured['reason']}"
    tried = [
        f"{structural_model_words(trial['name'], trial['walls'])} {format_percent(trial['error'])}"
        for trial in measured["tried"]
    ]
    of = format_percent(measured["tolerance"])
    return f"as measured: beside a shell {', '.join(tried)} off, where {of} is allowed"


def is_alone(result: RunResult) -> bool:
    """Whether the run is of a body alone, not of a boom of sections."""
    return ALONE in result.scene.bodies


def moving_part(result: RunResult) -> str:
    """Name of the part that moves: ``boom`` or, for a body alone, ``slider`` or ``mouth``; empty if nothing slides."""
    if not is_alone(result):
        return "boom"
    if result.scene.only_section.slider is None:
        return ""
    return "slider" if result.scene.points else "mouth"


def force_words(result: RunResult) -> str:
    """Words for the contact forces: ``pad forces``, or ``slider force`` (``slider forces``) for a body on sliders."""
    sliders = len(result.scene.points) if is_alone(result) else 0
    return "pad forces" if not sliders else "slider force" if sliders == 1 else "slider forces"


def scope_words(result: RunResult) -> str:
    """Words for the place where displacements are compared: along the beam, or along all sections of a boom."""
    return "along the beam" if is_alone(result) else "along all sections"


def slider_offsets(result: RunResult) -> tuple[float, ...]:
    """Distances in m of the sliders or moving pads on a body alone from the path coordinate s; empty for a boom."""
    if not is_alone(result):
        return ()
    return result.scene.points or tuple(dict.fromkeys(ring.at for ring in result.scene.pads if ring.moving))


def reach(result: RunResult) -> float:
    """Length of a body alone in m; for a boom, its largest reach.

    If the scene does not state the body's length, the largest x of the points of its fields is taken.  Without fields,
    it is the end of the range in which the scene observes displacements; without such an end, 0.
    """
    if result.reach is not None:
        return float(result.reach.max())
    scene = result.scene
    if scene.body.length is not None:
        return float(scene.body.length)
    return float(result.body.fields.points[:, 0].max()) if result.body.fields is not None else scene.observe.end or 0.0


def input_loads(result: RunResult) -> list[AppliedLoad]:
    """Loads in the order of the model's inputs, without weight.

    A force along an axis of the ground has one entry for each of its components along the axes of the body.  Loads that
    the run did not store are left out.
    """
    acting, names = list[AppliedLoad](), result.loads.names
    for member, (body, section) in zip(members(result.scene), result.scene.bodies.items(), strict=True):
        end = reach(result) if body == ALONE else section.length
        for load in section.loads:
            for name, direction in input_directions(member, load).items():
                if (full_name := input_name(body, name)) in names:
                    values = result.loads.values[:, names.index(full_name)]
                    at = end if isinstance(load.on, str) else load.on
                    acting.append(AppliedLoad(name, body, direction, at, values, load))
    return acting


def scene_loads(result: RunResult) -> list[AppliedLoad]:
    """Loads as the scene defines them: a force along an axis of the ground is one load along that axis.

    The `direction` of such a force is that of its first component in the body's axes.
    """
    by_load, t = dict[tuple[str, str], AppliedLoad](), result.responses["reduced"].t
    for load in input_loads(result):
        if load.name != load.source.name:
            load = replace(load, name=load.source.name, values=load.source.signal.value(t))
        by_load.setdefault((load.body, load.name), load)
    return list(by_load.values())


def acting_loads(result: RunResult) -> list[AppliedLoad]:
    """Loads as the scene defines them, without those that are 0 at all times."""
    return [load for load in scene_loads(result) if np.any(load.values)]


def crossing(result: RunResult) -> str:
    """Name of the section that is a mass on a wheel and crosses the section before it; empty if there is none."""
    last, part = list(result.scene.bodies.items())[-1]
    return "" if part.body.mover is None else last


def changing_angles(result: RunResult) -> dict[str, SignalBase]:
    """Signals of those angles, luffing and slewing, that change during the run, by name; empty without a frame."""
    frame, end = result.frame, result.scene.time.end
    angles = {} if frame is None else dict(zip(("luffing", "slewing"), frame.angles, strict=True))
    bounds = {name: angle.bounds(0.0, end) for name, angle in angles.items()}
    return {name: angles[name] for name, (low, high) in bounds.items() if high > low}


def drive_of(rope: Mapping[str, object]) -> str:
    """Return ``rope`` or ``cylinder``: the part that carries the force of an entry of ``ropes`` in summary.json.

    The part is a rope if the entry's section follows another section.  It is also a rope if the entry has a length, as
    the section may hang on the rope of a winch.
    """
    return "rope" if rope["follows"] or "length" in rope else "cylinder"


def rings_of(part: BoomSection) -> list[PadRing | JointPads]:
    """Rings of pads of a body: the rings on the ground, and those in the next outer section."""
    return [*part.pads, *((*part.joint.tail, *part.joint.mouth) if part.joint is not None else ())]


def has_pushing_pads(result: RunResult) -> bool:
    """Whether any pad is unilateral: such a pad can only push, and may lift off."""
    return any(ring.unilateral for part in result.scene.bodies.values() for ring in rings_of(part))


def has_free_luffing(result: RunResult) -> bool:
    """Whether the luffing angle is computed together with the motion of the boom."""
    return result.scene.frame is not None and result.scene.frame.computed_key == "luffing"


def abscissa_label(result: RunResult) -> str:
    """Name of the position along the motion on axes and in tables: the length of a boom, or the path coordinate s."""
    return "boom length" if result.abscissa_name == "reach" else result.abscissa_name


def shown_force_name(name: str) -> str:
    """Name of the force `name` on pages.

    The luffing cylinder's force has two names in results, as a contact and at the pivot.  Pages have one name for it.
    All other names are returned unchanged.
    """
    return LUFFING_CYLINDER if name.endswith((f" {LUFFING_CYLINDER}", f"{AT_PIVOT} cylinder")) else name


def is_luffing_cylinder_alone(result: RunResult) -> bool:
    """Whether the luffing cylinder is the only support of the run that gives way."""
    supports = [output.name for output in result.responses["reduced"].outputs if output.kind == "support"]
    return bool(supports) and all(name.endswith(LUFFING_CYLINDER) for name in supports)


def axis_words(name: str) -> str:
    """Words for a direction, such as ``along x`` for ``x`` and ``about x`` for ``rx``; other names are unchanged."""
    way = {**{axis: f"along {axis}" for axis in AXES}, **{f"r{axis}": f"about {axis}" for axis in AXES}}
    return way.get(name, name)


def support_words(name: str) -> str:
    """Words for a force or moment of a support, such as ``pivot of base, about x`` for ``base: pivot rx``."""
    body, _, support = name.rpartition(": ")
    if not body and support != (axis := axis_words(support)):
        return axis
    if held := DIRECTION.search(support):
        support = support[: held.start()] + support[held.end() :]
    of = f"{support.removesuffix(' along')} of {body}" if body else support.removesuffix(" along")
    return f"{of}, {axis_words(held.group().strip())}" if held else of


def luffing_support_names(result: RunResult) -> set[str]:
    """Names of the luffing cylinder's force, and of the supports that stand in its place.

    The force of the luffing cylinder has its own row, so these names are left out elsewhere.  The result is empty if
    the scene has no luffing cylinder, or the summary states nothing about it.
    """
    frame = result.scene.frame
    if frame is None or frame.cylinder is None or result.summary.get("luffing_cylinder") is None:
        return set()
    body, names = next(iter(result.scene.bodies)), (of.row_name("z") for of in luffing_stand_ins(result.scene))
    return {qualified_name(body, name) for name in (LUFFING_CYLINDER, *names)}


def luffing_stand_ins(scene: Scene) -> tuple[Support, ...]:
    """Supports of the base that stand in the place of the luffing cylinder; empty if there are none."""
    held = pin_and_cylinder(scene)
    return supports_at_lug(scene) if held is None else (held.stand_in,)


def fixtures(result: RunResult) -> list[Fixture]:
    """Supports and pads of a body alone, or of a boom's base, that act across its axis and do not move along it."""
    body, of = next(iter(result.scene.bodies.items()))
    end = reach(result) if body == ALONE else of.length
    supports = [
        Fixture(end if support.on == "tip" else 0.0, support.symbol)
        if isinstance(support.on, str)
        else Fixture(support.on, support.symbol)
        for support in of.supports
        if {"y", "z"} & set(support.held_directions)
    ]
    return supports + [Fixture(ring.at, "pad") for ring in of.pads if not ring.moving]


def field_times(result: RunResult, body: BodyResult) -> Array:
    """Times (F,) in s at which the largest stresses of a body are stored; empty for a body without stresses."""
    count = max(map(len, body.peak_stress.values()), default=0)
    if body.fields is not None and len(body.fields.t) == count:
        return body.fields.t
    recovery = result.scene.recovery
    return np.arange(count) * (recovery.every if recovery else 0.0)


def with_shown_label(result: RunResult, text: str) -> str:
    """Replace the label of support forces in a text by that of the luffing cylinder's force.

    The text is returned unchanged unless the luffing cylinder is the only support that gives way.
    """
    alone = is_luffing_cylinder_alone(result)
    return text.replace(QUANTITIES["support_force"].label, QUANTITIES["luffing_force"].label) if alone else text
