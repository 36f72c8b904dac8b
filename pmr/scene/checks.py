"""What no section can know by itself but of bodies: sizes, time, path, reduction, comparison and simulators."""

from __future__ import annotations

from dataclasses import replace

from pmr.scene.asked import Damping
from pmr.scene.choice import fewest_rows, is_pinned_beam
from pmr.scene.frame_checks import check_frame
from pmr.scene.joint_checks import check_joints
from pmr.scene.magnitudes import check_loads, check_proportions, jump_of
from pmr.scene.members import member_at
from pmr.scene.scene import Scene
from pmr.scene.section import check_sizes
from pmr.scene.simulators import REFERENCE, Needs, refuse
from pmr.scene.structure_checks import check_structure, refusal

MOST_STEPS = 1_000_000


def check(scene: Scene) -> None:
    """Refuse a scene whose sections contradict each other, of the key ``"scene"``: its reader names the file."""
    check_sizes(scene)  # first: what others compute with is then finite
    check_time(scene)
    _check_outputs(scene)
    if len(scene.sections) > 1:
        check_joints(scene)
    else:
        _check_alone(scene)
    check_frame(scene)
    _fatigue(scene)


def _check_alone(scene: Scene) -> None:
    part = scene.alone
    if part.joint is not None:
        raise refusal("sections[0].joint", None, "a section alone slides in nothing: supports or pads hold it")
    if part.slider is None:
        allowed = "a table slider with a path is needed: along it a section alone slides through its pads"
        raise refusal("slider", None, allowed)
    check_proportions(part)
    check_loads(part, scene.time.end)
    _reduction(scene)
    _accuracy(scene)
    if jump := jump_of(scene.slider.path, 1e-9 * max(map(abs, scene.path_bounds))):
        raise refusal("slider.path", None, f"the slider {jump}")
    check_structure(member_at(scene))
    _frequency_response(scene)
    _comparison(scene)
    _simulators(scene)


def _fatigue(scene: Scene) -> None:
    measured = [measure for part in scene.sections for probe in part.probes for measure in probe.measures]
    if scene.fatigue is not None and "stress" not in measured:
        raise refusal("fatigue", None, "a probe with measures = ['stress'] is needed: damage is that of its stresses")


def check_time(scene: Scene) -> None:
    """Steps make up the time and what is recovered."""
    time, recovery = scene.time, scene.recovery
    if time.steps < 1 or abs(time.steps * time.step - time.end) > 1e-9 * time.end:
        raise refusal("time.step", time.step, f"a whole number of steps must make up time.end = {time.end:g} s")
    if time.steps > MOST_STEPS:
        raise refusal("time.step", time.step, f"at most {MOST_STEPS:,} steps are allowed, all of them are stored")
    steps = time.steps if recovery is None else recovery.every / time.step
    if recovery is not None and (abs(steps - round(steps)) > 1e-6 or not 1 <= round(steps) <= time.steps):
        allowed = f"a multiple of time.step = {time.step:g} s up to time.end is allowed"
        raise refusal("recovery.every", recovery.every, allowed)


def _reduction(scene: Scene) -> None:
    choice = scene.reduction
    if choice.basis == "paper" and choice.flexibility:
        allowed = "'eigenmodes' or 'free_modes' is allowed with flexibility: supports then need no coordinates"
        raise refusal("reduction.basis", choice.basis, allowed)
    if (choice.basis == "file") != (choice.file is not None):
        raise refusal("reduction.file", choice.file and str(choice.file), "a file is allowed with basis = 'file'")
    if choice.ports and (choice.basis != "free_modes" or not choice.flexibility):
        allowed = "free modes with flexibility are allowed to have ports"
        raise refusal("reduction.ports", list(choice.ports), allowed)
    if choice.ports and scene.goal is not None:
        raise refusal(
            "reduction.ports", list(choice.ports), "a number of coordinates is allowed with them, no tolerance"
        )
    if choice.uses_pod:
        _pool(scene)
    if not choice.flexibility and choice.coordinates < fewest_rows(member_at(scene)):
        points = len(scene.points)
        allowed = (
            f"at least as many as constraint rows are allowed: {fewest_rows(member_at(scene))} "
            f"({fewest_rows(member_at(scene)) - points} of supports, {points} of sliders)"
        )
        raise refusal("reduction.coordinates", choice.coordinates, allowed)


def _pool(scene: Scene) -> None:
    choice = scene.reduction
    pool = choice.snapshots * choice.modes
    if choice.coordinates > pool:
        raise refusal("reduction.coordinates", choice.coordinates, f"at most snapshots * modes = {pool} are allowed")
    if isinstance(choice.positions, str):
        return
    if len(choice.positions) != choice.snapshots:
        raise refusal("reduction.snapshots", choice.snapshots, f"{len(choice.positions)} positions are given")
    for i, at in enumerate(choice.positions):
        if scene.body.length is not None and at > scene.body.length:
            raise refusal(f"reduction.positions[{i}]", at, f"on the body, 0 to {scene.body.length:g} m, is allowed")


def _frequency_response(scene: Scene) -> None:
    """Linear equations in coordinates that are free: rows give way and hold both ways."""
    choice = scene.reduction
    rigid = bool(scene.points) or any(ring.stiffness == "rigid" for ring in scene.pads)
    rigid = rigid or any(support.stiffness == "rigid" and support.points == "mean" for support in scene.supports)
    if not scene.observe.frequency_response:
        return
    if (rigid and not choice.flexibility) or any(ring.unilateral for ring in scene.pads):
        allowed = "true is allowed with reduction.flexibility and pads that hold both ways"
        raise refusal("observe.frequency_response", True, allowed)


def _comparison(scene: Scene) -> None:
    profile = scene.body.profile
    ancf_can = (
        scene.start == "rest"
        and is_pinned_beam(member_at(scene))
        and profile is not None
        and profile.axial_stiffness is not None
        and scene.gravity is None
        and scene.damping == Damping()
        and all(load.direction == "z" for load in scene.loads)
    )
    if "ancf" in scene.compare.against and not ancf_can:
        raise refusal(
            "compare.against",
            list(scene.compare.against),
            "the ANCF reference needs body.profile with axial_stiffness, one slider without offset, no damping, one "
            "pinned support at x = 0, loads along z and start = 'rest'",
        )


def _simulators(scene: Scene) -> None:
    """Check the simulators as far as that is possible before there is a model."""
    choice, (low, high) = scene.reduction, scene.path_bounds
    pushing = tuple(ring.name for ring in scene.pads if ring.unilateral)
    soft = {ring.name for ring in scene.pads if ring.stiffness != "rigid"}
    moving = tuple(ring.name for ring in scene.pads if ring.moving) or ("slider",)
    full = Needs(
        pushing=pushing,
        giving=tuple(soft),
        rigid_moving=tuple(name for name in moving if name not in soft) if high > low else (),
        rho_inf=scene.time.rho_inf,
    )
    if "full" in scene.compare.against:
        refuse("petsc" if scene.simulation.full == "auto" else scene.simulation.full, full, REFERENCE)
    reduced = full
    if choice.flexibility:
        reduced = replace(reduced, giving=("reduction.flexibility",), rigid_moving=())
    else:
        reduced = replace(reduced, rigid_pushing=tuple(name for name in pushing if name not in soft))
    for name in scene.simulation.simulators:
        refuse(name, reduced)


def _check_outputs(scene: Scene) -> None:
    """Check that accuracy or budget alone is given, and each kind of output once."""
    ordered, key = scene.goal, "accuracy" if scene.accuracy is not None else "budget"
    if scene.accuracy is not None and scene.budget is not None:
        raise refusal("budget", None, "accuracy or budget is allowed, not both")
    if ordered is not None and len(set(ordered.outputs)) < len(ordered.outputs):
        raise refusal(f"{key}.outputs", list(ordered.outputs), "each kind once is allowed")


def _accuracy(scene: Scene) -> None:
    choice, key = scene.reduction, "accuracy" if scene.accuracy is not None else "budget"
    if scene.goal is None:
        return
    if choice.basis != "free_modes" or not (choice.flexibility and choice.estimate):
        allowed = "free modes with flexibility and estimate = true are allowed: they hold all smaller models"
        raise refusal(key, None, allowed)
