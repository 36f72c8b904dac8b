"""What no section can know by itself but of bodies: sizes, time, path, reduction, comparison and simulators."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pmr.scene.asked import Damping
from pmr.scene.boom import Boom
from pmr.scene.choice import fewest_rows, is_pinned_beam
from pmr.scene.scene import Scene
from pmr.scene.section import check_sizes
from pmr.scene.signals import SignalBase
from pmr.scene.simulators import REFERENCE, Needs, refuse
from pmr.scene.structure_checks import check_structure, refusal

Range = tuple[float, float]

#: Of a box: what its length is over its smaller side, and that side over its wall.
SLENDER, THIN = (0.01, 1e4), (0.0, 1e4)
#: Of a beam: its length over a section's radius of gyration.
GYRATION = (0.01, 1e6)
LARGEST_LOAD = 1e120  # N or N m; models are linear in it, their energies are its squares
MOST_STEPS = 1_000_000


def check(scene: Scene) -> None:
    """Refuse a scene whose sections contradict each other, of the key ``"scene"``: its reader names the file."""
    check_magnitudes(scene)  # first: what others compute with is then finite
    check_time(scene)
    _reduction(scene)
    _accuracy(scene)
    if jump := jump_of(scene.slider.path, 1e-9 * max(map(abs, scene.path_bounds))):
        raise refusal("slider.path", None, f"the slider {jump}")
    check_structure(scene)
    _frequency_response(scene)
    _comparison(scene)
    _simulators(scene)


def check_magnitudes(scene: Scene) -> None:
    """Refuse sizes that no computation in double precision can carry."""
    check_sizes(scene)
    _proportions(scene)
    for i, load in enumerate(scene.loads):
        with np.errstate(all="ignore"):
            largest = float(np.abs(load.signal.bounds(0.0, scene.time.end)).max())
        if not largest <= LARGEST_LOAD:
            allowed = f"at most {LARGEST_LOAD:g} N or N m are allowed, here it is {largest:.3g}"
            raise refusal(f"loads[{i}].signal", None, allowed)


def check_time(scene: Scene | Boom) -> None:
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


def jump_of(path: SignalBase, least: float) -> str | None:
    """Where a signal in m first jumps by more than `least`, in words."""
    at = np.array(path.breaks)
    # All at once: one call costs as much as the signal has knots, and a file of them has thousands.
    before, after = path.value(np.nextafter(at, -np.inf)), path.value(at)
    for k in np.flatnonzero(np.abs(after - before) > least):
        return f"jumps from {before[k]:g} m to {after[k]:g} m at {at[k]:g} s; continuous paths are allowed"
    return None


def _proportions(scene: Scene) -> None:
    box, section, profile = scene.body.box, scene.body.section, scene.body.profile
    if profile is not None and profile.axial_stiffness is not None:
        radius = float(np.sqrt(profile.bending_stiffness / profile.axial_stiffness))
        slender = profile.length / radius
        _check_ratio("body.profile.axial_stiffness", slender, GYRATION, "length over radius of gyration")
    if box is not None:
        side = min(box.width, box.height)
        _check_ratio("body.box.length", box.length / side, SLENDER, "length over the smaller side")
        _check_ratio("body.box.width", box.width / box.height, (1e-3, 1e3), "width over height")
        _check_ratio("body.box.wall", side / box.wall, THIN, "the smaller side over the wall")
        if section is not None:
            for name in ("second_moment_y", "second_moment_z", "torsion_constant"):
                slender = box.length / float(np.sqrt(getattr(section, name) / section.area))
                _check_ratio(f"body.section.{name}", slender, GYRATION, "length over radius of gyration")


def _check_ratio(key: str, found: float, allowed: Range, what: str) -> None:
    if not allowed[0] <= found <= allowed[1]:
        said = f"a ratio of {what} from {allowed[0]:g} to {allowed[1]:g} is allowed, here it is {found:.3g}"
        raise refusal(key, None, said)


def _reduction(scene: Scene) -> None:
    choice = scene.reduction
    if choice.basis == "paper" and choice.flexibility:
        allowed = "'eigenmodes' or 'free_modes' is allowed with flexibility: supports then need no coordinates"
        raise refusal("reduction.basis", choice.basis, allowed)
    if (choice.basis == "file") != (choice.file is not None):
        raise refusal("reduction.file", choice.file and str(choice.file), "a file is allowed with basis = 'file'")
    if choice.residual_inertia and not (choice.basis == "free_modes" and choice.flexibility):
        allowed = "free modes with flexibility = true are allowed to have the inertia of what they leave out"
        raise refusal("reduction.residual_inertia", True, allowed)
    if choice.ports and (choice.basis != "free_modes" or not choice.flexibility or choice.residual_inertia):
        allowed = "free modes with flexibility and without residual_inertia are allowed to have ports"
        raise refusal("reduction.ports", list(choice.ports), allowed)
    if choice.ports and scene.ordered is not None:
        raise refusal(
            "reduction.ports", list(choice.ports), "a number of coordinates is allowed with them, no tolerance"
        )
    if choice.pooled:
        _pool(scene)
    if not choice.flexibility and choice.coordinates < fewest_rows(scene):
        points = len(scene.points)
        allowed = (
            f"at least as many as constraint rows are allowed: {fewest_rows(scene)} "
            f"({fewest_rows(scene) - points} of supports, {points} of sliders)"
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
    """Linear equations in coordinates that are free: rows give way, hold both ways, and leave no inertia behind."""
    choice = scene.reduction
    rigid = bool(scene.points) or any(ring.stiffness == "rigid" for ring in scene.pads)
    rigid = rigid or any(one.stiffness == "rigid" and one.points == "mean" for one in scene.supports)
    if not scene.observe.frequency_response:
        return
    if (rigid and not choice.flexibility) or any(ring.unilateral for ring in scene.pads) or choice.residual_inertia:
        allowed = "true is allowed with reduction.flexibility, pads that hold both ways and without residual_inertia"
        raise refusal("observe.frequency_response", True, allowed)


def _comparison(scene: Scene) -> None:
    profile = scene.body.profile
    ancf_can = (
        is_pinned_beam(scene)
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
            "pinned support at x = 0 and loads along z",
        )


def _simulators(scene: Scene) -> None:
    """What can be told before there is a model."""
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
    reduced = replace(full, kept_inertia=choice.residual_inertia)
    if choice.flexibility:
        reduced = replace(reduced, giving=("reduction.flexibility",), rigid_moving=())
    else:
        reduced = replace(reduced, rigid_pushing=tuple(name for name in pushing if name not in soft))
    for name in scene.simulation.simulators:
        refuse(name, reduced)


def check_ordered(scene: Scene | Boom) -> None:
    """What is asked for in place of coordinates is one thing, and each kind of output once."""
    key = "accuracy" if scene.accuracy is not None else "budget"
    if scene.accuracy is not None and scene.budget is not None:
        raise refusal("budget", None, "accuracy or budget is allowed, not both")
    if scene.ordered is not None and len(set(scene.ordered.outputs)) < len(scene.ordered.outputs):
        raise refusal(f"{key}.outputs", list(scene.ordered.outputs), "each kind once is allowed")


def _accuracy(scene: Scene) -> None:
    choice, key = scene.reduction, "accuracy" if scene.accuracy is not None else "budget"
    if scene.ordered is None:
        return
    check_ordered(scene)
    if choice.basis != "free_modes" or not (choice.flexibility and choice.estimate):
        allowed = "free modes with flexibility and estimate = true are allowed: they hold all smaller models"
        raise refusal(key, None, allowed)
