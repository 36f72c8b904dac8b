"""The study that ``pmr chart`` writes: extensions, angles and limits of a load chart, from what a scene has."""

from __future__ import annotations

import json
import logging
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import jinja2
import numpy as np

from pmr.errors import InputError
from pmr.errors.environment import is_installed
from pmr.results.quantities import DIRECTION, resultant_name, stress_remark
from pmr.scene.choice import has_unlike_side_walls, lateral_load_reasons
from pmr.scene.hints import boom_scales
from pmr.scene.members import members
from pmr.system.from_scene import force_names

if TYPE_CHECKING:
    from pmr.scene import Scene
    from pmr.scene.frame import Frame
    from pmr.scene.ground import Ground

logger = logging.getLogger(__name__)

#: Number of extensions and number of angles in the chart study that `pmr chart` writes.
EXTENSIONS, ANGLES = 12, 10
#: Number of slewing angles in a whole turn.
SLEWING_STEPS = 8
TEMPLATES = jinja2.Environment(
    loader=jinja2.PackageLoader("pmr.studies"), trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True
)
#: Key that TOML takes without quotes.
BARE_KEY = re.compile("[A-Za-z0-9_-]+")
#: Luffing angles at which the force that buckles the rod of the luffing cylinder is looked at.
LUFFING_PLACES = 200
#: Factor on the mass of a boom without a machine for the largest load that a chart looks for.
BOOMS = 5.0


def usual_load(scene: Scene) -> float:
    """Return the largest load in kg that a chart looks for unless the user names one, rounded up to two digits.

    The load is the mass of machine and boom, or `BOOMS` times that of a boom without a machine.  Masses of sections
    count without payloads, and frames of boxes do not.  Raises InputError if the mass of a section is not known without
    its mesh, or if a number of its body is unusual.
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
    """Return whether the boom with its loads, and all that does not slew, are symmetric about the pivot along an axis.

    The axis is 0 for front and rear, 1 for left and right.  Machines on inclined ground count as not symmetric.
    """
    frame = scene.frame
    if frame is None or (ground := frame.ground) is None:
        return True
    places = {outrigger.at for outrigger in ground.outriggers}
    mirrored = {tuple(-value if k == axis else value for k, value in enumerate(at)) for at in places}
    still = sum(mass.mass * mass.at[axis] for mass in ground.masses if not mass.slews)
    is_level = not any(ground.slope) and frame.base is None
    return places == mirrored and not still and is_level and not _is_lateral(scene, frame, ground)


def _is_lateral(scene: Scene, frame: Frame, ground: Ground) -> bool:
    """Return whether anything that slews is away from the boom's vertical plane, or a load may act out of this plane.

    Payloads do not count, as a chart leaves them out.
    """
    beside = [frame.tail_position[1], *(mass.at[1] for mass in ground.masses if mass.slews)]
    for member in members(scene):
        part, section = member.part, member.part.body.section
        beside += [mass.at[1] for mass in part.masses if mass.at is not None and not mass.payload]
        beside += [load.point[1] for load in part.loads if load.point is not None]
        beside += [section.centroid[0]] if section is not None else []
        if lateral_load_reasons(member) or has_unlike_side_walls(member):
            return True
    return any(beside)


def _slewing_angles(scene: Scene, frame: Frame) -> list[float]:
    """Return slewing angles in the frame's unit, at most an eighth of a turn apart.

    If the scene slews on a ground, they are those of the whole turn that its symmetry leaves: a half or a quarter of a
    turn with both ends, or all of it, each angle once.  Otherwise they are those of the scene's range.
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


class WallLimit(NamedTuple):
    """Limit on the forces of the pads of a joint, by which the walls of a section begin to yield."""

    name: str  # section whose joint it is
    pads: list[str]  # patterns of names of its pads, in quotes
    force: float  # N, less its error bar
    error: float  # N: the error bar
    section: str  # section whose walls yield


def _wall_limits(scene: Scene) -> Iterator[WallLimit]:
    """Yield a limit of a chart for each joint of beams whose walls' stress at pads can be computed."""
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
    for name, at_yield in forces.items():
        joint = scene.joint(scene.names.index(name))
        ends = [end for end, rings in (("tail", joint.tail), ("mouth", joint.mouth)) if any(r.faces for r in rings)]
        pads, bar = [json.dumps(f"{name} {end} *") for end in ends], at_yield.error
        yield WallLimit(name, pads, at_yield.force - bar, bar, at_yield.section)


class SupportLimit(NamedTuple):
    """Limit on the resultant force of a support."""

    name: str
    columns: list[str]  # names of its forces, in quotes
    force: float  # N


def _support_limits(scene: Scene) -> Iterator[SupportLimit]:
    """Yield a limit of a chart for each support that has an allowed force."""
    names = force_names(scene)["support"]
    for body, part in scene.bodies.items():
        for support in part.supports:
            if support.allowed_force is not None:
                name = resultant_name(body, support, " ")
                of_support = [column for column in names if DIRECTION.sub("", column) == name]
                forces = [json.dumps(column) for column in of_support if not re.search(" r[xyz]( |$)", column)]
                if forces:  # a support of angles alone has moments
                    yield SupportLimit(name, forces, support.allowed_force)


def check_chart(file: Path, scene: Scene, up_to: float) -> None:
    """Raise InputError if the scene of a file has no luffing angle over time, or `up_to` in kg is not above 0."""
    if scene.frame is None or scene.frame.luffing is None or scene.frame.luffing == "free":
        allowed = "a scene whose [frame] has a luffing angle over time is allowed"
        raise InputError("command line", "SCENE", str(file), allowed)
    if not up_to > 0.0:
        raise InputError("command line", "--up-to", up_to, "a load above 0 kg is allowed")


def _allowed_luffing_forces(scene: Scene) -> dict[str, float]:
    """Return the least push and pull in N that the luffing cylinder bears over the scene's luffing angles.

    They are by the limits of a chart.  A push or pull that the scene does not limit is left out.
    """
    frame = scene.frame
    if frame is None or frame.cylinder is None or not frame.cylinder.has_allowed_forces:
        return {}
    angles = np.linspace(*frame.angles.luffing.bounds(0.0, scene.time.end), LUFFING_PLACES)
    allowed = frame.cylinder.allowed_forces(frame.cylinder.length_and_arm(angles).length)
    forces = {"luffing": float(allowed.push.min()), "luffing-pull": float(np.min(allowed.pull))}
    return {of: force for of, force in forces.items() if math.isfinite(force)}


def chart_study_text(file: Path, scene: Scene, up_to: float) -> str:
    """Return the text of a study file for a load chart, over the ranges of the scene's extensions and luffing angle.

    Limits are tipping, the stress at probes, the allowed forces of the luffing cylinder and of supports, and the stress
    of walls at pads, as far as the scene has what they need.
    The stress of walls is computed on shells of the sections, on which the pads press.  `up_to` is the largest load in
    kg.  The scene is one that `check_chart` accepts.
    """
    assert scene.frame is not None and scene.frame.luffing is not None and scene.frame.luffing != "free"
    end, numbers = scene.time.end, range(1, len(scene.sections))
    names = {number: scene.names[number] for number in numbers if scene.joint(number).follows is None}
    bounds = [scene.extension(number).bounds(0.0, end) for number in names]
    keys = [name if BARE_KEY.fullmatch(name) else json.dumps(name) for name in names.values()]
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
    return TEMPLATES.get_template("chart.toml").render(
        title=json.dumps(f"Load chart: {scene.title}"),
        scene=json.dumps(str(file.resolve())),
        up_to=repr(float(up_to)),
        rows=rows,
        least=least,
        most=most,
        angles=ANGLES if most > least else 1,
        slewing=[f"{angle:.6g}" for angle in slewing],
        which=which,
        tips=scene.frame.ground is not None,
        stress=1e-6 * min(filter(None, yields)) if yields and all(yields) else None,  # MPa
        walls=_wall_limits(scene),
        cylinder=_allowed_luffing_forces(scene),
        supports=_support_limits(scene),
    )
