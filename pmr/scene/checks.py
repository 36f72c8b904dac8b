"""Checks of a whole scene, which raise InputError: time, path, reduction, comparison, simulators, frame and machine.

Each check raises an InputError for the first key that contradicts another key.  The file of the error is ``"scene"``,
for which the reader of the scene puts the name of the file.  Checks of a single table are in its validators, checks of
one body in `pmr.scene.structure_checks`, checks of neighbouring sections in `pmr.scene.joint_checks`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pmr.scene.built import Gravity
from pmr.scene.choice import (
    REFERENCE,
    SimulatorNeeds,
    fewest_rows,
    has_axial_motion,
    input_directions,
    is_pinned_beam,
    model_of,
    refuse_unsupported,
)
from pmr.scene.cylinder import OPEN
from pmr.scene.frame import Frame, Machine
from pmr.scene.hoist_places import check_hoist
from pmr.scene.joint_checks import check_joints
from pmr.scene.joints import JointPads
from pmr.scene.keys import LUFFING, check_bounds
from pmr.scene.mechanism import supports_at_lug
from pmr.scene.members import member_at, members
from pmr.scene.scene import Scene
from pmr.scene.signals import SignalBase
from pmr.scene.structure_checks import check_loads, check_proportions, check_structure, describe_jump, scene_error
from pmr.scene.structures import Damping


def check_machine(frame: Frame, machine: Machine) -> None:
    """Refuse a machine that is free in a direction in which its base moves, without a spring between both."""
    motions = {} if frame.base is None else frame.base.motions
    for direction in machine.free:
        if direction in motions and not machine.is_sprung(direction):
            allowed = f"a spring or a damper in {direction} is allowed on what moves: the machine is free there"
            raise scene_error(f"frame.base.{direction}", None, allowed)


def _check_computed(scene: Scene, frame: Frame, free: tuple[str, ...], beside: str) -> None:
    """Refuse settings that do not go with a computed motion, and simulators without its equations.

    `free` are the directions that are computed, `beside` is the key with its value in words.
    """
    if frame.base is not None and frame.base.accelerations:
        allowed = f"x, y and z are allowed beside {beside}: an acceleration does not say where the ground is"
        raise scene_error("frame.base.acceleration", None, allowed)
    if frame.second_order == "auto":
        raise scene_error("frame.second_order", "auto", f"true or false is allowed beside {beside}")
    if scene.goal is not None:
        key = "accuracy" if scene.accuracy is not None else "budget"
        raise scene_error(key, None, f"none is allowed beside {beside}, whose motion depends on model and step")
    for member in members(scene):
        if model_of(member) == "beam2d":
            key = scene.section_key(member.number, "body.model")
            raise scene_error(key, "beam2d", f"a model in space is allowed beside {beside}")
        for k, load in enumerate(member.part.loads):
            if load.acts == "wind":
                key, allowed = (
                    scene.section_key(member.number, f"loads[{k}].acts"),
                    f"'force' is allowed beside {beside}",
                )
                raise scene_error(key, "wind", f"{allowed}: the pressure of wind follows angles that are prescribed")
    keyed = [(k, key, ring) for k, part in enumerate(scene.sections) for key, ring in part.keyed_rings.items()]
    for number, ring_key, ring in keyed:
        key = f"sections[{number}].{ring_key}"
        if ring.unilateral:
            allowed = f"false is allowed beside {beside}: pads that hold both ways"
            raise scene_error(f"{key}.unilateral", True, allowed)
        if isinstance(ring, JointPads) and ring.friction:
            raise scene_error(f"{key}.friction", ring.friction, f"0 is allowed beside {beside}")
    for name in scene.simulation.simulators:
        refuse_unsupported(name, SimulatorNeeds(free_machine_directions=free))


def _check_luffing(scene: Scene, frame: Frame) -> None:
    """Refuse what a free luffing angle does not go with, and a free angle's keys where the angle is prescribed.

    Beside a free angle these are refused: a machine, rotations of the base, a stiffness of the cylinder, a cylinder
    without a drive, valve openings beyond -1 to 1, and a stroke that does not hold the cylinder's first length or does
    not lie between its dead centres.  Without a cylinder, a free angle is allowed.
    """
    cylinder, free = frame.cylinder, "frame.luffing = 'free'"
    if frame.luffing != "free":
        for key in ("luffing_start", "luffing_rate"):
            if getattr(frame, key):
                raise scene_error(f"frame.{key}", getattr(frame, key), f"{free} is needed with it")
        keys = () if cylinder is None else (*cylinder.drives, *(k for k in ("damping",) if cylinder.damping))
        if keys:
            raise scene_error(f"frame.cylinder.{keys[0]}", None, f"{free} is needed with it: the angle is prescribed")
        return
    if frame.machine is not None:
        raise scene_error("frame.machine", None, f"none is allowed beside {free}")
    for key in ("rx", "ry", "rz"):
        if frame.base is not None and key in frame.base.motions:
            raise scene_error(f"frame.base.{key}", None, f"x, y and z are allowed beside {free}")
    if cylinder is None:
        return
    if cylinder.stiffness is not None:
        allowed = f"none is allowed beside {free}: oil or spring gives way, a support of the base is at the lug"
        raise scene_error("frame.cylinder.stiffness", cylinder.stiffness, allowed)
    if not cylinder.drives:
        allowed = f"force, length or oil is needed beside {free}; without frame.cylinder the boom swings by itself"
        raise scene_error("frame.cylinder", None, allowed)
    if cylinder.oil is not None and cylinder.oil.valve is not None:
        least, most = cylinder.oil.valve.opening.bounds(0.0, scene.time.end)
        if max(-least, most) > OPEN:
            allowed = "openings from -1 to 1 are allowed"
            raise scene_error("frame.cylinder.oil.valve.opening", least if -least > OPEN else most, allowed)
    length = float(cylinder.length_and_arm(frame.angles[0].value(np.zeros(1)))[0][0])
    if cylinder.stroke is not None and not cylinder.stroke[0] <= length <= cylinder.stroke[1]:
        allowed = f"the length at luffing_start, {length:.4g} m, is needed within the stroke"
        raise scene_error("frame.cylinder.stroke", list(cylinder.stroke), allowed)
    reach = [float(np.hypot(*hinge)) for hinge in (cylinder.foot, cylinder.lug)]
    dead = abs(reach[0] - reach[1]), sum(reach)
    if cylinder.stroke is not None and not dead[0] < cylinder.stroke[0] < cylinder.stroke[1] < dead[1]:
        allowed = (
            f"lengths between {dead[0]:.4g} and {dead[1]:.4g} m are allowed: foot, lug and pivot are in line there"
        )
        raise scene_error("frame.cylinder.stroke", list(cylinder.stroke), allowed)


def _check_ground(scene: Scene) -> None:
    """Refuse a ground without gravity, and a ground under a base whose forces at the pivot are not known."""
    if scene.gravity is None:
        raise scene_error("gravity", None, "a table is needed beside frame.ground: the weight presses on the ground")
    assert scene.frame is not None and scene.frame.ground is not None
    if scene.frame.luffing == "free" and any(scene.frame.ground.slope):
        allowed = "no slope is allowed beside a free luffing angle, whose motion is computed on level ground"
        raise scene_error("frame.ground.slope", list(scene.frame.ground.slope), allowed)
    for support in scene.sections[0].supports:
        if support.points == "all":
            allowed = "'mean' is allowed beside frame.ground, as forces of 'all' points are not known"
            raise scene_error(scene.section_key(0, "supports"), "all", allowed)
    if not has_axial_motion(member_at(scene, 0)):
        allowed = "true is allowed beside frame.ground, as forces along the boom have a moment about the ground"
        raise scene_error(scene.section_key(0, "body.profile.axial"), False, allowed)


#: An angle may jump by this share of its range, which is round-off.
JUMP = 1e-9
#: Least arm of a luffing cylinder as a share of the lug's distance from the pivot; number of times that are checked.
IN_LINE, SAMPLES = 0.01, 1001


def check_frame(scene: Scene) -> None:
    """Refuse a moving frame if its angles jump or have kinks, or if it does not go with the scene's settings.

    Such settings are gravity with a direction of its own, models that can't follow the frame's motion, whatever the
    terms of second order do not cover, and the ANCF reference.  A scene without a frame passes.
    """
    frame = scene.frame
    if frame is None:
        return
    angles = dict(zip(("luffing", "slewing"), frame.angles, strict=True))
    keys = ("base.rx", "base.ry", "base.rz")
    if frame.ground is not None and any(frame.ground.slope):
        keys = ("ground.slope[1]", "ground.slope[0]", "base.rz")
    angles |= dict(zip(keys, frame.base_angles, strict=False))
    for key, angle in angles.items():
        frame.refuse_without_unit(f"frame.{key}", angle.bounds(0.0, scene.time.end))
        _check_smooth(scene, key, "an angle", angle)
    _check_cylinder(scene, frame)
    _check_luffing(scene, frame)
    if frame.machine is not None:
        check_machine(frame, frame.machine)
        _check_computed(scene, frame, frame.machine.free, "frame.machine")
    elif frame.computed_key is not None:
        _check_computed(scene, frame, ("luffing",), "frame.luffing = 'free'")
    if frame.ground is not None:
        _check_ground(scene)
    for axis, motion in (frame.base.motions if frame.base else {}).items():
        if axis in ("x", "y", "z"):
            _check_smooth(scene, f"base.{axis}", "a motion", motion)
    if scene.gravity is not None and scene.gravity.direction != Gravity().direction:
        allowed = (
            "neither direction nor inclination is allowed beside a frame: "
            "frame.luffing already says how the boom is inclined"
        )
        raise scene_error("gravity", None, allowed)
    for member in members(scene):
        if model_of(member) == "matrices":
            allowed = "models with a mesh are allowed in a frame: matrices do not say where their mass is"
            raise scene_error(scene.section_key(member.number, "body.model"), "matrices", allowed)
        if model_of(member) == "beam2d" and (frame.out_of_plane_key or frame.tail_position[1] != 0.0):
            key = frame.out_of_plane_key or "pivot"
            raise scene_error(f"frame.{key}", None, "models in space are allowed with it: beam2d has no lateral motion")
    for number in range(1, len(scene.sections) if frame.second_order else 1):
        least = scene.extension(number).bounds(0.0, scene.time.end)[0]
        if least <= 0.0:
            allowed = f"an extension above 0 is allowed with frame.second_order: here it is {least:g} m"
            raise scene_error(f"sections[{number}].joint", None, allowed)
    for support in scene.sections[0].supports if frame.second_order else ():
        if "x" in support.held_directions and scene.sections[0].position_of(support.on) not in (0.0, None):
            allowed = "the tail is allowed as the place that holds the base along with frame.second_order"
            allowed += ": axial forces are those from there on"
            raise scene_error(scene.section_key(0, "supports"), support.on, allowed)
    for member in members(scene) if frame.second_order else ():
        for load in member.part.loads:
            if load.on != "tip" and "x" in input_directions(member, load).values():
                allowed = "the tip is allowed with frame.second_order as the place of a load along the boom"
                raise scene_error(scene.section_key(member.number, "loads"), load.on, allowed)
    if "ancf" in scene.compare.against:
        raise scene_error("compare.against", list(scene.compare.against), "['full'] or [] is allowed with a frame")


def _check_cylinder(scene: Scene, frame: Frame) -> None:
    """Refuse a luffing cylinder whose arm about the pivot is zero, or nearly so, at some time.

    Such a cylinder carries no moment.
    """
    if frame.cylinder is None:
        return
    if frame.cylinder.stiffness is not None:
        _check_holding_cylinder(scene, frame)
    t = np.linspace(0.0, scene.time.end, SAMPLES)
    angle = frame.angles[0].value(t)
    length, arm = frame.cylinder.length_and_arm(angle)
    reach = float(np.hypot(*frame.cylinder.lug))
    k = int(np.argmin(np.abs(arm)))
    if np.abs(arm[k]) < IN_LINE * reach or arm.min() < 0.0 < arm.max() or reach == 0.0:
        at = f"at {t[k]:.4g} s, {np.rad2deg(angle[k]):.3g} degrees, a cylinder of {length[k]:.3g} m has {arm[k]:.2g} m"
        raise scene_error("frame.cylinder", None, f"hinges with an arm about the pivot are allowed: {at}")


def _check_holding_cylinder(scene: Scene, frame: Frame) -> None:
    """Refuse a luffing cylinder with a stiffness unless it can hold the base.

    The base has to be a beam of a boom of several sections with a luffing angle.  The lug has to be on the base, and no
    support may be at the lug.
    """
    key, base = "frame.cylinder.stiffness", members(scene)[0]
    assert frame.cylinder is not None
    if not base.has_joint or model_of(base) not in ("beam2d", "beam3d"):
        raise scene_error(key, None, "a boom of several sections whose base is a beam is allowed with it")
    if frame.luffing is None:
        raise scene_error("frame.luffing", None, f"the angle that the boom is raised by is needed with {key}")
    if LUFFING in scene.names:
        raise scene_error("sections.name", LUFFING, f"other names are allowed beside {key}: a path has this one")
    at = frame.cylinder.lug[0] - frame.tail_position[0]
    if not 0.0 <= at <= base.part.length:
        allowed = "with a stiffness, a place on the base is allowed"
        raise scene_error("frame.cylinder.lug", frame.cylinder.lug[0], allowed)
    if twice := supports_at_lug(scene):
        allowed = f"the cylinder's stiffness or the support {twice[0]!r} at its lug is allowed, one of both"
        raise scene_error(key, frame.cylinder.stiffness, allowed)


def _check_smooth(scene: Scene, key: str, what: str, motion: SignalBase) -> None:
    """Refuse a motion of the frame whose value or rate jumps in the simulated time; `what` names it in messages."""
    kinks = motion.kinks(scene.time.end)
    jumps = [t for t in motion.breaks if 0.0 < t <= scene.time.end and _has_jump(motion, t)]
    if jumps or kinks:
        at, defect = (jumps[0], "a jump") if jumps else (min(kinks), "a kink")
        allowed = f"{what} with a rate that does not jump is allowed, here is {defect} at {at:g} s: a smooth_ramp"
        raise scene_error(f"frame.{key}", None, allowed)


def _has_jump(angle: SignalBase, t: float) -> bool:
    """Whether a signal jumps at t (s) by more than the share `JUMP` of its range from 0 to t."""
    low, high = angle.bounds(0.0, t)
    before, after = angle.value(np.array([np.nextafter(t, -np.inf), t]))
    return bool(abs(after - before) > JUMP * (high - low))


MOST_STEPS = 1_000_000


def check_scene(scene: Scene) -> None:
    """Raise an InputError for the first key of a scene that contradicts another key; its file is ``"scene"``."""
    check_bounds(scene)  # first, so that other checks compute with finite numbers
    check_time(scene)
    _check_outputs(scene)
    if len(scene.sections) > 1:
        check_joints(scene)
    else:
        _check_single_body(scene)
    check_frame(scene)
    check_hoist(scene)
    _check_fatigue(scene)


def _check_single_body(scene: Scene) -> None:
    """Check the keys of a scene of one body."""
    part = scene.only_section
    if part.joint is not None:
        raise scene_error(
            "sections[0].joint", None, "a section alone does not slide in another one: supports or pads hold it"
        )
    if part.slider is None:
        allowed = "a table slider with a path is needed: along it a section alone slides through its pads"
        raise scene_error("slider", None, allowed)
    check_proportions(part)
    check_loads(part, scene.time.end)
    _check_reduction(scene)
    _check_accuracy(scene)
    if jump := describe_jump(scene.slider.path, 1e-9 * max(map(abs, scene.path_bounds))):
        raise scene_error("slider.path", None, f"the slider {jump}")
    check_structure(member_at(scene))
    _check_frequency_response(scene)
    _check_comparison(scene)
    _check_simulators(scene)


def _check_fatigue(scene: Scene) -> None:
    """Refuse fatigue without a probe that measures stress."""
    measured = [measure for part in scene.sections for probe in part.probes for measure in probe.measures]
    if scene.fatigue is not None and "stress" not in measured:
        allowed = "a probe with measures = ['stress'] is needed: damage is that of its stresses"
        raise scene_error("fatigue", None, allowed)


def check_time(scene: Scene) -> None:
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
    if choice.basis == "paper" and choice.flexibility:
        allowed = "'eigenmodes' or 'free_modes' is allowed with flexibility: supports then need no coordinates"
        raise scene_error("reduction.basis", choice.basis, allowed)
    if (choice.basis == "file") != (choice.file is not None):
        raise scene_error("reduction.file", choice.file and str(choice.file), "a file is allowed with basis = 'file'")
    if choice.ports and (choice.basis != "free_modes" or not choice.flexibility):
        allowed = "free modes with flexibility are allowed to have ports"
        raise scene_error("reduction.ports", list(choice.ports), allowed)
    if choice.ports and scene.goal is not None:
        allowed = "a number of coordinates is allowed with them, no tolerance"
        raise scene_error("reduction.ports", list(choice.ports), allowed)
    if choice.uses_pod:
        _check_pod(scene)
    rows, points = fewest_rows(member_at(scene)), len(scene.points)
    if not choice.flexibility and choice.coordinates < rows:
        of_rows = f"{rows} ({rows - points} of supports, {points} of sliders)"
        allowed = f"at least as many as constraint rows are allowed: {of_rows}"
        raise scene_error("reduction.coordinates", choice.coordinates, allowed)


def _check_pod(scene: Scene) -> None:
    """Refuse more coordinates than the POD has vectors, positions off the body, and a wrong number of positions.

    The number of positions has to be the number of snapshots.
    """
    choice = scene.reduction
    pool = choice.snapshots * choice.modes
    if choice.coordinates > pool:
        allowed = f"at most snapshots * modes = {pool} are allowed"
        raise scene_error("reduction.coordinates", choice.coordinates, allowed)
    if isinstance(choice.positions, str):
        return
    if len(choice.positions) != choice.snapshots:
        raise scene_error("reduction.snapshots", choice.snapshots, f"{len(choice.positions)} positions are given")
    for i, at in enumerate(choice.positions):
        if scene.body.length is not None and at > scene.body.length:
            raise scene_error(f"reduction.positions[{i}]", at, f"on the body, 0 to {scene.body.length:g} m, is allowed")


def _check_frequency_response(scene: Scene) -> None:
    """Refuse a frequency response unless all contacts hold both ways and no rigid row constrains the coordinates."""
    choice = scene.reduction
    rigid = bool(scene.points) or any(ring.stiffness == "rigid" for ring in scene.pads)
    rigid = rigid or any(support.stiffness == "rigid" and support.points == "mean" for support in scene.supports)
    if not scene.observe.frequency_response:
        return
    if (rigid and not choice.flexibility) or any(ring.unilateral for ring in scene.pads):
        allowed = "true is allowed with reduction.flexibility and pads that hold both ways"
        raise scene_error("observe.frequency_response", True, allowed)


def _check_comparison(scene: Scene) -> None:
    """Refuse the ANCF reference of a scene that it can't represent."""
    profile = scene.body.profile
    is_cable = is_pinned_beam(member_at(scene)) and profile is not None and profile.axial_stiffness is not None
    is_plain = scene.start == "rest" and scene.gravity is None and scene.damping == Damping()
    if "ancf" in scene.compare.against and not (
        is_cable and is_plain and all(load.direction == "z" for load in scene.loads)
    ):
        allowed = (
            "the ANCF reference needs body.profile with axial_stiffness, one slider without offset, no damping, one "
            "pinned support at x = 0, loads along z and start = 'rest'"
        )
        raise scene_error("compare.against", list(scene.compare.against), allowed)


def _check_simulators(scene: Scene) -> None:
    """Refuse simulators that do not support the scene's rows, as far as the rows are known before a model is made."""
    choice, (low, high) = scene.reduction, scene.path_bounds
    pushing = tuple(ring.name for ring in scene.pads if ring.unilateral)
    soft = {ring.name for ring in scene.pads if ring.stiffness != "rigid"}
    moving = tuple(ring.name for ring in scene.pads if ring.moving) or ("slider",)
    rigid_moving = tuple(name for name in moving if name not in soft) if high > low else ()
    full = SimulatorNeeds(pushing, (), tuple(soft), rigid_moving, rho_inf=scene.time.rho_inf)
    if "full" in scene.compare.against:
        refuse_unsupported("petsc" if scene.simulation.full == "auto" else scene.simulation.full, full, REFERENCE)
    reduced = full
    if choice.flexibility:
        reduced = replace(reduced, flexible_rows=("reduction.flexibility",), rigid_moving_rows=())
    else:
        reduced = replace(reduced, rigid_pushing_rows=tuple(name for name in pushing if name not in soft))
    for name in scene.simulation.simulators:
        refuse_unsupported(name, reduced)


def _check_outputs(scene: Scene) -> None:
    """Refuse a scene with both accuracy and budget, and an output that one of them lists twice."""
    ordered, key = scene.goal, "accuracy" if scene.accuracy is not None else "budget"
    if scene.accuracy is not None and scene.budget is not None:
        raise scene_error("budget", None, "accuracy or budget is allowed, not both")
    if ordered is not None and len(set(ordered.outputs)) < len(ordered.outputs):
        raise scene_error(f"{key}.outputs", list(ordered.outputs), "each kind once is allowed")


def _check_accuracy(scene: Scene) -> None:
    """Refuse accuracy or budget unless the reduction has free modes with flexibility and an estimate."""
    choice, key = scene.reduction, "accuracy" if scene.accuracy is not None else "budget"
    if scene.goal is None:
        return
    if choice.basis != "free_modes" or not (choice.flexibility and choice.estimate):
        allowed = "free modes with flexibility and estimate = true are allowed: they hold all smaller models"
        raise scene_error(key, None, allowed)
