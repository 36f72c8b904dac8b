"""Checks of a whole scene, which raise InputError: time, path, reduction, comparison, simulators, free extensions.

Each check raises an InputError for the first key that contradicts another key.  The file of the error is ``"scene"``,
for which the reader of the scene puts the name of the file.  `EXCLUSIONS` lists parts of a scene that do not go
together.  Checks of a single table are in its validators, checks of one body in `pmr.scene.structure_checks`, of
neighbouring sections in `pmr.scene.joint_checks`, and of a moving frame and a hoist in `pmr.scene.frame_checks`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from pmr.scene.choice import REFERENCE, SimulatorNeeds, fewest_rows, has_driven_tail, is_pinned_beam, refuse_unsupported
from pmr.scene.frame import Frame
from pmr.scene.frame_checks import FREE, check_frame, check_hoist
from pmr.scene.joint_checks import check_joints, check_section
from pmr.scene.joints import JointPads
from pmr.scene.members import member_at, members
from pmr.scene.scene import Scene
from pmr.scene.structure_checks import describe_jump, refuse, scene_error
from pmr.scene.structures import Damping

MOST_STEPS = 1_000_000


def check_scene(scene: Scene) -> None:
    """Raise an InputError for the first key of a scene that contradicts another key; its file is ``"scene"``."""
    _check_time(scene)
    _check_accuracy(scene)
    if len(scene.sections) > 1:
        check_joints(scene)
    else:
        _check_single_body(scene)
    _check_frequency_response(scene)
    _check_comparison(scene)
    _check_exclusions(scene)
    check_frame(scene)
    check_hoist(scene)
    _check_free_extension(scene)
    _check_wind(scene)
    _check_computed_motions(scene)
    _check_payloads(scene)
    _check_fatigue(scene)


def _check_payloads(scene: Scene) -> None:
    """Refuse payloads and hoisted masses that are not at the tip of the last section, where a load chart has its load.

    A mass that is both is refused, too.
    """
    for number, part in enumerate(scene.sections):
        for k, mass in enumerate(part.masses):
            key, at_load = scene.section_key(number, f"masses[{k}]"), part is scene.sections[-1] and mass.on == "tip"
            if (mass.payload or mass.hoisted) and not at_load:
                allowed = "false is allowed except for a mass on the tip of the last section"
                raise scene_error(f"{key}.{'payload' if mass.payload else 'hoisted'}", True, allowed)
            if mass.payload and mass.hoisted:
                raise scene_error(
                    f"{key}.hoisted", True, "false is allowed beside payload = true, which is hoisted anyway"
                )


def _check_single_body(scene: Scene) -> None:
    """Check the keys of a scene of one body; raise an InputError for the first key that is not allowed."""
    part = scene.only_section
    allowed = "a section alone does not slide in another one: supports or pads hold it"
    refuse(part.joint is not None, "sections[0].joint", None, allowed)
    if part.slider is None and any(ring.moving for ring in part.pads):
        raise scene_error("slider", None, "a table slider is needed, with the path along which the moving pads slide")
    _check_reduction(scene)
    if jump := describe_jump(scene.slider.path, 1e-9 * max(map(abs, scene.path_bounds))):
        raise scene_error("slider.path", None, f"the slider {jump}")
    check_section(scene, 0)
    _check_simulators(scene)


def _check_computed_motions(scene: Scene) -> None:
    """Refuse simulators that lack equations which the scene needs: of a hoist, or of a motion that is computed.

    With a computed motion, a comparison with a richer model is refused, too.
    """
    hoist, free = scene.hoist is not None, () if scene.frame is None else scene.frame.free_directions
    free = (*free, *(f"extension of {scene.names[number]}" for number in scene.free_extensions))
    for name in scene.simulation.simulators:
        refuse_unsupported(name, SimulatorNeeds(hoist=hoist, free_machine_directions=free))
    if "full" in scene.compare.against and scene.simulation.full != "auto":
        refuse_unsupported(scene.simulation.full, SimulatorNeeds(hoist=hoist), REFERENCE)
    if scene.computed_key is not None and scene.compare.richer not in ("auto", "none"):
        allowed = f"'auto' or 'none' is allowed beside {scene.computed_key}, which is computed"
        allowed += ": a run of the same boom with a prescribed motion compares models"
        raise scene_error("compare.richer", scene.compare.richer, allowed)


def _check_fatigue(scene: Scene) -> None:
    """Refuse fatigue without a probe that measures stress."""
    measured = [measure for part in scene.sections for probe in part.probes for measure in probe.measures]
    allowed = "a probe with measures = ['stress'] is needed: damage is that of its stresses"
    refuse(scene.fatigue is not None and "stress" not in measured, "fatigue", None, allowed)


def _check_time(scene: Scene) -> None:
    """Refuse time steps that do not add up to the simulated time, are too many, or do not divide `recovery.every`."""
    time, recovery = scene.time, scene.recovery
    if time.steps < 1 or abs(time.steps * time.step - time.end) > 1e-9 * time.end:
        raise scene_error("time.step", time.step, f"a whole number of steps must make up time.end = {time.end:g} s")
    if time.steps > MOST_STEPS:
        raise scene_error("time.step", time.step, f"at most {MOST_STEPS:,} steps are allowed, all of them are stored")
    steps = time.steps if recovery is None else recovery.every / time.step
    if recovery is not None and (abs(steps - round(steps)) > 1e-6 or not 1 <= round(steps) <= time.steps):
        allowed = f"a multiple of time.step = {time.step:g} s up to time.end is allowed"
        raise scene_error("recovery.every", recovery.every, allowed)


def _check_reduction(scene: Scene) -> None:
    """Refuse contradictory settings of the reduction, and fewer coordinates than constraint rows."""
    choice = scene.reduction
    allowed = "'eigenmodes' or 'free_modes' is allowed with flexibility, as supports then need no coordinates"
    refuse(choice.basis == "paper" and choice.flexibility, "reduction.basis", choice.basis, allowed)
    if (choice.basis == "file") != (choice.file is not None):
        allowed = "a file goes with basis = 'file', and with no other basis"
        raise scene_error("reduction.file", choice.file and str(choice.file), allowed)
    if choice.ports and (choice.basis != "free_modes" or not choice.flexibility):
        allowed = "free modes with flexibility are allowed to have ports"
        raise scene_error("reduction.ports", list(choice.ports), allowed)
    if choice.uses_pod:
        allowed = "'free_modes' is allowed for a body that does not slide, as this basis is made along a path"
        refuse(scene.only_section.slider is None, "reduction.basis", choice.basis, allowed)
        _check_pod(scene)
    rows, points = fewest_rows(member_at(scene)), len(scene.points)
    if not choice.flexibility and choice.coordinates < rows:
        of_rows = f"the number of constraint rows ({rows - points} of supports, {points} of sliders)"
        allowed = f"at least {rows} are allowed, {of_rows}"
        raise scene_error("reduction.coordinates", choice.coordinates, allowed)


def _check_pod(scene: Scene) -> None:
    """Refuse more coordinates than the POD has vectors, positions off the body, and a wrong number of positions.

    The number of positions has to be the number of snapshots.
    """
    choice = scene.reduction
    pool = choice.snapshots * choice.modes
    allowed = f"at most snapshots * modes = {pool} are allowed"
    refuse(choice.coordinates > pool, "reduction.coordinates", choice.coordinates, allowed)
    if isinstance(choice.positions, str):
        return
    if len(choice.positions) != choice.snapshots:
        allowed = f"{len(choice.positions)} is allowed, the number of reduction.positions"
        raise scene_error("reduction.snapshots", choice.snapshots, allowed)
    for i, at in enumerate(choice.positions):
        if scene.body.length is not None and at > scene.body.length:
            raise scene_error(f"reduction.positions[{i}]", at, f"on the body, 0 to {scene.body.length:g} m, is allowed")


def _check_frequency_response(scene: Scene) -> None:
    """Refuse a frequency response of another section than the last, or together with contacts that are not linear.

    On a body alone that has rigid supports or pads, a response is refused without residual flexibility, too.
    """
    rings = [ring for part in scene.sections for ring in part.rings]
    for number, part in enumerate(scene.sections):
        if not part.observe.frequency_response:
            continue
        key = scene.section_key(number, "observe.frequency_response")
        allowed = f"false is allowed, as the tip of the boom is the tip of {scene.names[-1]}"
        refuse(number < len(scene.sections) - 1, key, True, allowed)
        allowed = "false is allowed, as some pads only push; a response in frequency needs pads that hold both ways"
        refuse(any(ring.unilateral for ring in rings), key, True, allowed)
        if any(ring.friction for ring in rings if isinstance(ring, JointPads)):
            raise scene_error(key, True, "false is allowed, as pads have friction, which is not linear")
        if len(scene.sections) == 1 and not part.reduction.flexibility and _has_rigid_rows(scene):
            raise scene_error(key, True, "true is allowed with reduction.flexibility beside rigid supports and pads")


def _has_rigid_rows(scene: Scene) -> bool:
    """Whether sliding points, rigid pads or rigid supports of mean motions hold the only body of a scene."""
    supports = [support.stiffness for support in scene.supports if support.points == "mean"]
    return bool(scene.points) or "rigid" in (*supports, *(ring.stiffness for ring in scene.pads))


def _check_comparison(scene: Scene) -> None:
    """Refuse a comparison with "ancf", an ANCF cable in Exudyn, for a scene that such a cable can't represent."""
    if "ancf" not in scene.compare.against:
        return
    profile = None if len(scene.sections) > 1 else scene.body.profile
    is_cable = profile is not None and profile.axial_stiffness is not None and is_pinned_beam(member_at(scene))
    is_plain = scene.start == "rest" and scene.gravity is None and scene.frame is None and scene.damping == Damping()
    loads = [load for part in scene.sections for load in part.loads]
    if not (is_cable and is_plain and all((load.acts, load.direction) == ("force", "z") for load in loads)):
        allowed = (
            "the ANCF reference needs body.profile with axial_stiffness, one slider without offset, no damping, no "
            "frame, one pinned support at x = 0, forces along z and start = 'rest'"
        )
        raise scene_error("compare.against", list(scene.compare.against), f"['full'] or [] is allowed: {allowed}")


def _check_simulators(scene: Scene) -> None:
    """Refuse simulators that do not support the scene's contacts and supports, as far as a scene alone tells these."""
    choice, (low, high) = scene.reduction, scene.path_bounds
    pushing = tuple(ring.name for ring in scene.pads if ring.unilateral)
    soft = tuple(ring.name for ring in scene.pads if ring.stiffness != "rigid")
    moving = tuple(ring.name for ring in scene.pads if ring.moving) or ("slider",)
    rigid_moving = tuple(name for name in moving if name not in soft) if high > low else ()
    full = SimulatorNeeds(pushing, (), soft, rigid_moving, rho_inf=scene.time.rho_inf)
    if "full" in scene.compare.against:
        refuse_unsupported("petsc" if scene.simulation.full == "auto" else scene.simulation.full, full, REFERENCE)
    reduced = full
    if choice.flexibility:
        reduced = replace(reduced, flexible_rows=("reduction.flexibility",), rigid_moving_rows=())
    else:
        reduced = replace(reduced, rigid_pushing_rows=tuple(name for name in pushing if name not in soft))
    for name in scene.simulation.simulators:
        refuse_unsupported(name, reduced)


def _check_accuracy(scene: Scene) -> None:
    """Refuse accuracy together with a budget; refuse either unless each section has free modes and an estimate.

    The estimate needs the residual flexibility, so that is needed too.
    """
    has_two_goals = scene.accuracy is not None and scene.budget is not None
    refuse(has_two_goals, "budget", None, "accuracy or budget is allowed, not both")
    for number, part in enumerate(scene.sections):
        if scene.goal is not None and not part.reduction.estimable:
            allowed = (
                "free modes with flexibility and an estimate, without ports, are allowed: they hold all smaller models"
            )
            raise scene_error(scene.section_key(number, "reduction"), None, allowed)


def _check_free_extension(scene: Scene) -> None:
    """Refuse a second free extension, and settings with which an extension can't be computed.

    A frame, first order, a start in equilibrium, and valve openings from -1 to 1 are needed; `_check_moved_sections`
    says what the drives of the sections have to be.  A scene without a free extension passes.
    """
    for number, extension in scene.free_extensions.items():
        free = f"the free extension of {scene.names[number]}"
        key = f"sections[{number}].joint"
        refuse(number != min(scene.free_extensions), f"{key}.extension.kind", "free", "one free extension is allowed")
        if scene.frame is None:
            raise scene_error("frame", None, f"a table is needed beside {free}: luffing = 0 is a level boom")
        allowed = f"false is allowed beside {free}: what a boom shortens by bending is not in its equation"
        refuse(scene.frame.second_order is not False, "frame.second_order", scene.frame.second_order, allowed)
        allowed = f"'equilibrium' is allowed beside {free}, which its cylinder holds then"
        refuse(scene.start != "equilibrium", "start", scene.start, allowed)
        if (opening := extension.worst_opening(scene.time.end)) is not None:
            raise scene_error(f"{key}.extension.oil.valve.opening", opening, "openings from -1 to 1 are allowed")
        _check_moved_sections(scene, number, free)


def moved_sections(scene: Scene, number: int) -> dict[int, tuple[float, float]]:
    """Ratio r and offset a in m of each section with the extension r s + a, by its number.

    Here s is the free extension of section `number`, which has the ratio 1 and the offset 0.  The other sections in the
    result follow this section, or follow one that does.
    """
    ratios_and_offsets = {number: (1.0, 0.0)}
    for k in range(number + 1, len(scene.sections)):
        follows = scene.joint(k).follows
        leader = None if follows is None else scene.names.index(follows)
        if leader in ratios_and_offsets:
            ratio, offset = ratios_and_offsets[leader]
            joint = scene.joint(k)
            ratios_and_offsets[k] = joint.ratio * ratio, joint.ratio * offset + joint.offset
    return ratios_and_offsets


def _check_moved_sections(scene: Scene, number: int, free: str) -> None:
    """Refuse ropes, and cylinders that give way, at the sections that a free extension moves.

    The sections are section `number`, whose extension is free, and all sections that follow it.  A model without
    displacements along the boom is refused on them.  `free` is the name of the extension in messages.
    """
    for k in moved_sections(scene, number):
        joint, key = scene.joint(k), f"sections[{k}].joint"
        if joint.rope is not None:
            raise scene_error(f"{key}.rope", None, f"none is allowed beside {free}: its cylinder moves the section")
        allowed = f"'rigid' is allowed beside {free}: oil or a spring gives way"
        refuse(joint.cylinder.stiffness != "rigid", f"{key}.cylinder.stiffness", joint.cylinder.stiffness, allowed)
        allowed = f"a model with displacements along the boom is allowed beside {free}"
        refuse(not has_driven_tail(member_at(scene, k)), scene.section_key(k, "body.model"), None, allowed)


class Exclusion(NamedTuple):
    """A part of a scene, by its key, that is refused together with another part, and the reason."""

    key: str
    excluded_by: str
    why: str


#: A frequency response, and an extension that is computed, as parts of a scene.
RESPONSE, FREE_EXTENSION = "observe.frequency_response", "joint.extension.kind = 'free'"
#: Parts of a scene that exclude each other.
EXCLUSIONS = (
    Exclusion(RESPONSE, "hoist", "a payload that swings has a part in it"),
    Exclusion("hoist", "frame.machine", "the rope's pull on it is not known"),
    Exclusion("frame.machine", FREE, "the cylinder stands on what does not move by itself"),
    Exclusion("frame.ground", "frame.machine", "its masses belong to frame.ground, which does not move"),
    Exclusion("frame.cylinder.stiffness", FREE, "oil or spring gives way, a support of the base is at the lug"),
    *(Exclusion(f"frame.base.{key}", "frame.ground.slope", "which inclines the machine") for key in ("rx", "ry")),
    *(
        Exclusion("frame.base.acceleration", part, "it does not say where the ground is: x, y and z do")
        for part in ("frame.machine", FREE)
    ),
    Exclusion("hoist", FREE_EXTENSION, "a rope's path is known for a prescribed extension alone"),
    *(Exclusion(part, FREE_EXTENSION, "one motion is computed at a time") for part in ("frame.machine", FREE)),
    *(
        Exclusion(key, part, why)
        for part in ("frame.machine", FREE, FREE_EXTENSION)
        for key, why in (
            ("accuracy", "whose motion depends on model and step"),
            (RESPONSE, "what is computed there has a part in it"),
            ("budget", "whose motion depends on model and step"),
        )
    ),
)


def _check_exclusions(scene: Scene) -> None:
    """Refuse the first of `EXCLUSIONS` both of whose parts the scene has."""
    frame = scene.frame or Frame.model_construct()
    ground, base = frame.ground, frame.base
    parts = {
        RESPONSE: any(part.observe.frequency_response for part in scene.sections),
        "hoist": scene.hoist,
        "accuracy": scene.accuracy,
        "budget": scene.budget,
        "frame.machine": frame.machine,
        FREE: frame.luffing == "free",
        FREE_EXTENSION: scene.free_extensions,
        "frame.ground": ground,
        "frame.ground.slope": ground is not None and any(ground.slope),
        "frame.cylinder.stiffness": frame.cylinder and frame.cylinder.stiffness,
        "frame.base.acceleration": base and base.accelerations,
    } | {f"frame.base.{key}": True for key in (base.motions if base else {})}
    for key, other, why in EXCLUSIONS:
        if parts.get(key) and parts.get(other):
            key = scene.section_key(len(scene.sections) - 1, key) if key == RESPONSE else key
            key, value = ("frame.luffing", "free") if key == FREE else (key, None)
            raise scene_error(key, value, f"none is allowed beside {other}: {why}")


def _check_wind(scene: Scene) -> None:
    """Refuse wind together with a motion that is computed: of a machine, a luffing angle or an extension."""
    for member in members(scene) if scene.computed_key is not None else ():
        for k, load in enumerate(member.part.loads):
            if load.acts == "wind":
                allowed = f"'force' is allowed beside {scene.computed_key}, which is computed: the pressure of wind "
                allowed += "follows motions that are prescribed"
                raise scene_error(scene.section_key(member.number, f"loads[{k}].acts"), "wind", allowed)
