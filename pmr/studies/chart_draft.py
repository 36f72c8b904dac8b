"""The study that ``pmr chart`` writes from what a scene has; extensions of a chart's rows, and checks of its scene."""

from __future__ import annotations

import json
import logging
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from pmr.errors import BEYOND_ENDS, InputError
from pmr.errors.environment import is_installed
from pmr.results.quantities import DIRECTION, matches_pattern, resultant_name, stress_remark
from pmr.scene import Scene
from pmr.scene.choice import has_unlike_side_walls, is_planar, lateral_load_reasons
from pmr.scene.frame import Frame
from pmr.scene.hints import boom_scales
from pmr.scene.joint_checks import check_extension
from pmr.scene.keys import SceneTable, key_error
from pmr.scene.members import members, pads_on_faces, ring_name, seats
from pmr.scene.signals import Constant
from pmr.scene.tomlfiles import toml_key, toml_value
from pmr.simulation.statics.postures import with_winds
from pmr.studies.study import Count
from pmr.system.from_scene import force_names

logger = logging.getLogger(__name__)

#: Number of extensions and number of angles in the chart study that `pmr chart` writes.
EXTENSIONS, ANGLES = 12, 10
#: Number of slewing angles in a whole turn.
SLEWING_STEPS = 8
#: Luffing angles at which the force that buckles the rod of the luffing cylinder is looked at.
LUFFING_PLACES = 200
#: Factor on the mass of a boom without a machine for the largest load that a chart looks for.
BOOMS = 5.0


def usual_load(scene: Scene) -> float:
    """Return the largest load in kg that a chart looks for if the user states none, rounded up to two digits.

    The load is the mass of machine and boom, or `BOOMS` times the mass of a boom without a machine.  The mass of the
    boom includes the point masses of its sections, but no payloads and no frames of boxes.  Raises InputError if the
    mass of a section is not known without its mesh, or if a number of its body is unusual.
    """
    boom, ground = boom_scales(scene)["boom"], scene.frame.ground if scene.frame is not None else None
    if not boom:
        raise InputError("command line", "--up-to", None, "a load is needed, as the mass of the boom is not known")
    boom += sum(mass.mass for part in scene.sections for mass in part.masses if not mass.payload)
    machine = sum(mass.mass for mass in ground.masses) if ground is not None else 0.0
    load = boom + machine if machine else BOOMS * boom
    step = 10.0 ** (math.floor(math.log10(load)) - 1)
    return math.ceil(load / step - 1e-9) * step


def words_of_usual_load(scene: Scene) -> str:
    """Return in words which mass `usual_load` is."""
    if scene.frame is not None and scene.frame.ground is not None and scene.frame.ground.masses:
        return "the mass of machine and boom"
    return f"{BOOMS:g} times the mass of the boom"


def _is_symmetric(scene: Scene, axis: int) -> bool:
    """Return whether front and rear (`axis` 0) or left and right (`axis` 1) of the machine are alike about the pivot.

    Only outriggers and masses that do not slew are compared.  In either case the boom, and what slews with it, must be
    alike on left and right (`_is_lateral`).  Machines on inclined ground or with `frame.base` count as not symmetric,
    scenes without a ground as symmetric.
    """
    frame = scene.frame
    if frame is None or (ground := frame.ground) is None:
        return True
    places = {outrigger.at for outrigger in ground.outriggers}
    mirrored = {tuple(-value if k == axis else value for k, value in enumerate(at)) for at in places}
    still = sum(mass.mass * mass.at[axis] for mass in ground.masses if not mass.slews)
    is_level = not any(ground.slope) and frame.base is None
    return places == mirrored and not still and is_level and not _is_lateral(scene)


def _is_lateral(scene: Scene) -> bool:
    """Return whether anything that slews is away from the boom's vertical plane, or a load may act out of this plane.

    Payloads do not count, as a chart leaves them out.
    """
    frame = scene.frame
    offsets = [] if frame is None else [frame.tail_position[1]]
    offsets += [mass.at[1] for mass in frame.ground.masses if mass.slews] if frame is not None and frame.ground else []
    for member in members(scene):
        part, section = member.part, member.part.body.section
        offsets += [mass.at[1] for mass in part.masses if mass.at is not None and not mass.payload]
        offsets += [load.point[1] for load in part.loads if load.point is not None]
        offsets += [section.centroid[0]] if section is not None else []
        if lateral_load_reasons(member) or has_unlike_side_walls(member):
            return True
    return any(offsets)


def _slewing_angles(scene: Scene, frame: Frame) -> list[float]:
    """Return slewing angles in the frame's unit, at most an eighth of a turn apart; only 0 for a frame without slewing.

    If the scene has a ground and slews, the angles cover a whole turn; a half or a quarter of it if symmetry allows
    (`_is_symmetric`).  Otherwise they cover the range of the scene's slewing angle, at most a turn.  A constant angle
    is the only one.  Both ends of a range are included, except that a whole turn has each angle once.
    """
    if frame.slewing is None:
        return [0.0]
    turn = 360.0 if frame.unit == "degrees" else 2.0 * math.pi
    low, high = frame.slewing.bounds(0.0, scene.time.end)
    if frame.ground is not None and high > low:
        low, high = 0.0, turn
        if _is_symmetric(scene, 1):
            high = turn / 4.0 if _is_symmetric(scene, 0) else turn / 2.0
    width = min(high - low, turn)
    count = max(math.ceil(SLEWING_STEPS * width / turn - 1e-9), 1 if width > 0.0 else 0)
    return [low + width * k / max(count, 1) for k in range(count + (width < turn))]


def _winds(scene: Scene, frame: Frame) -> dict[str, float | None]:
    """Return the azimuths of wind in service by the names of load cases: from behind, and from the sides in space.

    An azimuth is an angle from the boom in the frame's unit.  If left and right of the boom are alike, there is wind
    from the right but not from the left.  If no section has a box or wind of its own, the only case has no wind, and
    its azimuth is None.
    """
    if with_winds(scene, {"wind": (0.0, 1.0)}) == scene:
        return {"hoisting": None}
    quarter = 90.0 if frame.unit == "degrees" else math.pi / 2.0
    winds: dict[str, float | None] = {"wind from behind the boom": 0.0}
    if not any(map(is_planar, members(scene))):
        winds["wind from the right of the boom"] = quarter
        if _is_lateral(scene):
            winds["wind from the left of the boom"] = -quarter
    return winds


class WallLimit(NamedTuple):
    """Limit on the forces of the pads at one end of a joint: beyond it the walls of a section begin to yield."""

    name: str  # section whose joint it is, and the end
    place: str  # end of a section at which these pads are, such as "mouth of base"
    force: float  # N, less its error bar
    error: float  # N: the error bar
    even: float  # N: the least force of these pads with an even pressure, without an error bar
    section: str  # section whose walls yield


def _wall_limits(scene: Scene) -> Iterator[WallLimit]:
    """Yield a limit of a chart for each end of a joint at which the stress of walls under pads can be computed.

    Nothing is yielded for a single section, or if no section is a beam with walls.  If FEniCSx is not installed, or if
    walls can't be computed, a warning is logged and nothing is yielded.
    """
    if len(scene.sections) == 1 or not stress_remark(scene):  # shells have a limit of their own, on the stress field
        return
    if not is_installed("dolfinx"):
        logger.warning("walls at pads are not limited: dolfinx is not installed, and shells of sections need it")
        return
    from pmr.fullmodel.wall_stress import yield_forces

    try:
        forces = yield_forces(scene)
    except InputError as error:
        logger.warning("walls at pads are not limited: %s", error.allowed)
        return
    places = {
        f"{section} {end}": f"tail of {section}" if end == "tail" else f"mouth of {outer}, around {section}"
        for outer, section in pairwise(scene.names)
        for end in ("tail", "mouth")
    }
    for name, place in places.items():
        of_pads = [force for pad, force in forces.items() if matches_pattern((f"{name} *",), pad)]
        if of_pads:
            least = min(of_pads, key=lambda of_pad: of_pad.force - of_pad.error)
            even = min(of_pad.even for of_pad in of_pads)
            yield WallLimit(name, place, least.force - least.error, least.error, even, least.section)


class SupportLimit(NamedTuple):
    """Limit on the resultant force of a support, or on the force of each lug of a pin."""

    name: str
    of: str  # quantity that is limited, ``support`` or ``lug``
    which: list[str]  # names of the support's forces, or of the pin, in quotes
    force: float  # N


def _support_limits(scene: Scene) -> Iterator[SupportLimit]:
    """Yield a limit of a chart for each support that has an allowed force and holds displacements."""
    names = force_names(scene)["support"]
    for body, part in scene.bodies.items():
        for support in part.supports:
            if support.allowed_force is not None:
                name = resultant_name(body, support, " ")
                of_support = [column for column in names if DIRECTION.sub("", column) == name]
                forces = [json.dumps(column) for column in of_support if not re.search(" r[xyz]( |$)", column)]
                if forces and support.lug_spacing is not None:
                    yield SupportLimit(name, "lug", [json.dumps(name)], support.allowed_force)
                elif forces:  # a support of angles alone has moments
                    yield SupportLimit(name, "support", forces, support.allowed_force)


def check_chart(file: Path, scene: Scene, up_to: float) -> None:
    """Raise InputError if a scene has no luffing angle over time, or if the load `up_to` in kg is not above 0.

    `file` is that of the scene; the message names it.
    """
    if scene.frame is None or scene.frame.luffing is None or scene.frame.luffing == "free":
        allowed = "a load chart needs luffing angles; a scene is allowed whose [frame] has luffing over time"
        raise InputError("command line", "SCENE", str(file), allowed)
    if not 0.0 < up_to < math.inf:
        raise InputError("command line", "--up-to", up_to, "a finite load above 0 kg is allowed")


def _allowed_luffing_forces(scene: Scene) -> dict[str, float]:
    """Return the least push and pull in N that the luffing cylinder bears over the scene's luffing angles.

    The keys are the names of the chart's limits, ``luffing`` for the push and ``luffing-pull`` for the pull.  A push or
    pull that the scene does not limit is left out; without a luffing cylinder the result is empty.
    """
    frame = scene.frame
    if frame is None or frame.cylinder is None or not frame.cylinder.has_allowed_forces:
        return {}
    angles = np.linspace(*frame.angles.luffing.bounds(0.0, scene.time.end), LUFFING_PLACES)
    allowed = frame.cylinder.allowed_forces(frame.cylinder.length_and_arm(angles).length)
    forces = {"luffing": float(allowed.push.min()), "luffing-pull": float(np.min(allowed.pull))}
    return {of: force for of, force in forces.items() if math.isfinite(force)}


def chart_study_text(file: Path, scene: Scene, up_to: float, change: Mapping[str, object] | None = None) -> str:
    """Return the text of a study file for a load chart, over the ranges of the scene's extensions and luffing angle.

    As far as the scene has what they need, there are limits on tipping, on the stress at probes, and on the forces of
    luffing cylinder and supports.  There are also limits on the pressure of pads, and on the stress of walls at pads,
    for which shells of the sections are computed.  Load cases have a factor of hoisting, and wind on the sections.

    `up_to` is the largest load in kg.  The scene is one that `check_chart` accepts, with the keys `change` of its file
    changed.
    """
    from jinja2 import Environment, PackageLoader

    assert scene.frame is not None and scene.frame.luffing is not None and scene.frame.luffing != "free"
    end, numbers = scene.time.end, range(1, len(scene.sections))
    names = {number: scene.names[number] for number in numbers if scene.joint(number).follows is None}
    bounds = [scene.extension(number).bounds(0.0, end) for number in names]
    keys = [toml_key(name) for name in names.values()]
    rows = [
        [f"{key} = {low + share * (high - low):.6g}" for key, (low, high) in zip(keys, bounds, strict=True)]
        for share in np.linspace(0.0, 1.0, EXTENSIONS if names else 0).tolist()
    ]
    least, most = scene.frame.luffing.bounds(0.0, end)
    slewing, which = _slewing_angles(scene, scene.frame), "the least load of all counts"
    if scene.frame.ground is not None and len(slewing) > 1 and _is_symmetric(scene, 1):
        which += "; others are needed unless machine, boom and loads are alike on left and right"
    probed = [part for part in scene.bodies.values() if any("stress" in probe.measures for probe in part.probes)]
    regions = [region for part in probed for region in part.body.regions.values() if region.material is not None]
    materials = [*(part.body.material for part in probed), *(region.material for region in regions)]
    yields = [material.yield_stress for material in materials if material is not None]
    loader = PackageLoader("pmr.studies")
    templates = Environment(loader=loader, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True)
    return templates.get_template("chart.toml").render(
        title=json.dumps(f"Load chart: {scene.title}"),
        scene=json.dumps(str(file.resolve())),
        change=toml_value(change) if change else "",
        up_to=repr(float(up_to)),
        rows=rows,
        least=least,
        most=most,
        angles=ANGLES if most > least else 1,
        slewing=[f"{angle:.6g}" for angle in slewing],
        which=which,
        tips=scene.frame.ground is not None,
        stress=1e-6 * min(filter(None, yields)) if yields and all(yields) else None,  # MPa
        walls=list(_wall_limits(scene)),
        winds=_winds(scene, scene.frame),
        cylinder=_allowed_luffing_forces(scene),
        supports=_support_limits(scene),
        pressed=any(np.isfinite(pad.allowed_force) for pad in pads_on_faces(scene).values()),
    )


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
        """Return extensions in m by section's name, for each of the `count` rows.

        By the key `order`, all sections telescope together, or one after the other in the order of `names`.
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

    A row has all sections but the first.  A section that follows another one need not be given, as its extension
    results.  Without `extensions` there is one empty row, which is allowed only for a body alone.  Raises InputError in
    these cases:

    - An extension is missing, or is not that which follows from another section.
    - The checks of a scene do not allow it.
    - It takes pads to where the model has none.
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
    """Raise InputError if the extensions of `still` take pads of joints to where the models of `scene` have no pads.

    `still` is the scene at rest with these extensions, and `key` is that of their row in the study.
    """
    for number, member in enumerate(members(scene)):
        for seat in seats(still, number) if member.has_joint else ():
            if seat.ring.faces is None:
                continue
            (low, high), at = member.ring_ranges[ring_name(scene, seat.ring)], seat.positions.low
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
    """Raise InputError if a scene without `frame.slewing` needs it for an angle of `slewing` other than 0.

    The scene needs it if something is not the same at all angles: a slope of the ground, a base of the frame, or a mass
    of the machine that slews.  The same holds for a wind or load along an axis of the ground other than z.
    """
    key = next(_keys_of_slewing(scene), "")
    if scene.present_frame.slewing is None and key and any(slewing):
        angle = next(filter(None, slewing))
        allowed = f"0 is allowed, or a scene with frame.slewing, such as 0: {key} counts as the boom is slewed"
        raise InputError("study", "slewing", angle, allowed)


def _keys_of_slewing(scene: Scene) -> Iterator[str]:
    """Yield the keys of the scene for what acts along axes of the ground, and for masses that slew with the boom."""
    ground = scene.present_frame.ground
    if ground is not None and any(ground.slope):
        yield "frame.ground.slope"
    for number, mass in enumerate(ground.masses if ground is not None else ()):
        if mass.slews:
            yield f"frame.ground.masses[{number}].slews"
    if scene.present_frame.base is not None:
        yield "frame.base"
    for number, part in enumerate(scene.sections):
        for k, load in enumerate(part.loads):
            if load.acts == "wind" or load.axes == "ground" and load.direction != "z":
                yield f"sections[{number}].loads[{k}]"


def check_at_rest(scene: Scene) -> None:
    """Raise InputError for a scene with a part that moves by itself, a hoist, or a base whose motion is not constant.

    Such parts are a machine, an extension and a luffing angle that are computed with the boom.
    """
    if scene.present_frame.machine is not None:
        raise InputError("scene", "frame.machine", None, "a machine that stands still is allowed in a load chart")
    if scene.hoist is not None:
        raise InputError("scene", "hoist", None, "leave it out, as a load chart hangs its own loads at the tip")
    if scene.extension_keys:
        raise InputError("scene", scene.extension_keys[0], "free", "an extension over time is allowed in a load chart")
    if scene.present_frame.luffing == "free":
        raise InputError("scene", "frame.luffing", "free", "an angle over time is allowed in a load chart")
    base = scene.present_frame.base
    moving = [key for key, signal in (base.motions if base else {}).items() if not isinstance(signal, Constant)]
    moving += [f"acceleration.{axis}" for axis in (base.accelerations if base else {})]
    if moving:
        allowed = "a base that is inclined by a constant rx, ry or rz is allowed in a load chart"
        raise InputError("scene", f"frame.base.{moving[0]}", None, allowed)
