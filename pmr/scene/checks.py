"""What no section can know by itself."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from pmr.errors import InputError
from pmr.scene.magnitudes import check_magnitudes
from pmr.scene.sections import SUPPORT_ROWS, Damping, Scene, SceneBase
from pmr.scene.simulators import REFERENCE, Needs, refuse
from pmr.scene.space import StructureScene
from pmr.scene.space_checks import check_structure

MOST_STEPS = 1_000_000


def check(scene: SceneBase) -> None:
    """Refuse a scene whose sections contradict each other.

    Raises
    ------
    InputError
        With source ``"scene"``; the reader of the file replaces it by the file in which the key stands.
    """
    check_magnitudes(scene)  # first: what others compute with is then finite
    _time(scene)
    _reduction(scene)
    _accuracy(scene)
    _continuous(scene)
    if isinstance(scene, StructureScene):
        check_structure(scene)
    elif isinstance(scene, Scene):
        _beam(scene)
    _simulators(scene)


def _simulators(scene: SceneBase) -> None:
    """What can be told before there is a model."""
    choice, (low, high) = scene.reduction, scene.path_bounds
    rings = scene.pads if isinstance(scene, StructureScene) else ()
    pushing = tuple(ring.name for ring in rings if ring.unilateral)
    soft = {ring.name for ring in rings if ring.stiffness != "rigid"}
    moving = tuple(ring.name for ring in rings if ring.moving) or ("slider",)
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


def _beam(scene: Scene) -> None:
    if not scene.reduction.flexibility:
        _row_count(scene)
    _places(scene)
    _path(scene)
    if "ancf" in scene.compare.against and not _ancf_can(scene):
        raise _refusal(
            "compare.against",
            list(scene.compare.against),
            "the ANCF reference needs axial_stiffness, one slider without offset, no damping, one pinned support at "
            "x = 0 and loads along y",
        )


def _refusal(key: str, value: Any, allowed: str) -> InputError:
    return InputError("scene", key, value, allowed)


def _time(scene: SceneBase) -> None:
    time = scene.time
    if time.steps < 1 or abs(time.steps * time.step - time.end) > 1e-9 * time.end:
        raise _refusal("time.step", time.step, f"a whole number of steps must make up time.end = {time.end:g} s")

    if time.steps > MOST_STEPS:
        raise _refusal("time.step", time.step, f"at most {MOST_STEPS:,} steps are allowed, all of them are stored")


def _reduction(scene: SceneBase) -> None:
    choice = scene.reduction
    if choice.support_rows == "hold" and (choice.flexibility or choice.basis == "free_modes"):
        allowed = "'drop' is allowed with free modes and with flexibility: their supports hold without coordinates"
        raise _refusal("reduction.support_rows", choice.support_rows, allowed)
    if choice.residual_inertia and not (choice.basis == "free_modes" and choice.flexibility):
        allowed = "free modes with flexibility = true are allowed to keep the inertia of what they leave out"
        raise _refusal("reduction.residual_inertia", True, allowed)
    if choice.basis == "eigenmodes":
        _pool(scene)


def _accuracy(scene: SceneBase) -> None:
    choice = scene.reduction
    if scene.accuracy is None:
        return
    if not (choice.basis == "free_modes" and choice.flexibility and choice.estimate):
        allowed = "free modes with flexibility and estimate = true are allowed: they hold all smaller models"
        raise _refusal("accuracy.tolerance", scene.accuracy.tolerance, allowed)
    if len(set(scene.accuracy.outputs)) < len(scene.accuracy.outputs):
        raise _refusal("accuracy.outputs", list(scene.accuracy.outputs), "each kind once is allowed")


def _pool(scene: SceneBase) -> None:
    choice = scene.reduction
    pool = choice.snapshots * choice.modes
    if choice.coordinates > pool:
        raise _refusal("reduction.coordinates", choice.coordinates, f"at most snapshots * modes = {pool} are allowed")
    if not isinstance(choice.positions, str) and len(choice.positions) != choice.snapshots:
        raise _refusal("reduction.snapshots", choice.snapshots, f"{len(choice.positions)} positions are given")


def _row_count(scene: Scene) -> None:
    choice, rows, sliders = scene.reduction, scene.row_count, len(scene.slider.offsets)
    if choice.coordinates < rows:
        raise _refusal(
            "reduction.coordinates",
            choice.coordinates,
            f"at least as many as constraint rows are allowed: {rows} ({rows - sliders} of supports, "
            f"{sliders} of sliders)",
        )


def _places(scene: Scene) -> None:
    length = scene.body.length
    places = [(f"supports[{i}].at", support.at) for i, support in enumerate(scene.supports)]
    places += [(f"loads[{i}].at", load.at) for i, load in enumerate(scene.loads)]
    if not isinstance(scene.reduction.positions, str):
        places += [(f"reduction.positions[{i}]", at) for i, at in enumerate(scene.reduction.positions)]
    for key, at in places:
        if at > length:
            raise _refusal(key, at, f"on the beam, 0 to {length:g} m, is allowed")
    for i, load in enumerate(scene.loads):
        if load.direction not in scene.body.directions:
            raise _refusal(f"loads[{i}].direction", load.direction, "an axial load needs body.axial = true")
    names = [load.name for load in scene.loads]
    if len(set(names)) != len(names):
        raise _refusal("loads", names, "each load needs a name of its own")


def _continuous(scene: SceneBase) -> None:
    (low, high), at = scene.path_bounds, np.array(scene.slider.path.breaks)
    # All at once: one call costs as much as the signal has knots, and a file of them has thousands.
    before, after = scene.slider.path.value(np.nextafter(at, -np.inf)), scene.slider.path.value(at)
    for k in np.flatnonzero(np.abs(after - before) > 1e-9 * max(abs(low), abs(high)))[:1]:
        jump = f"from {before[k]:g} m to {after[k]:g} m at {at[k]:g} s"
        raise _refusal("slider.path", None, f"the slider jumps {jump}; continuous paths are allowed")


def _path(scene: Scene) -> None:
    length, (low, high) = scene.body.length, scene.path_bounds
    slack = 1e-9 * length
    held = [support.at for support in scene.supports if "y" in SUPPORT_ROWS[support.kind]]
    if len(set(scene.slider.offsets)) != len(scene.slider.offsets):
        raise _refusal("slider.offsets", list(scene.slider.offsets), "sliders must not share an offset")
    for offset in scene.slider.offsets:
        which = f" (offset {offset:g} m)" if offset else ""
        for s in (low + offset, high + offset):
            if not -slack <= s <= length + slack:
                raise _refusal(
                    "slider.path",
                    None,
                    f"the slider reaches {s:g} m{which}; on the beam, 0 to {length:g} m, is allowed",
                )
        for at in held:
            if low + offset - slack <= at <= high + offset + slack:
                raise _refusal(
                    "slider.path",
                    None,
                    f"the slider reaches the support at {at:g} m{which}, where its row repeats the support's; "
                    "paths that keep clear of it are allowed",
                )


def _ancf_can(scene: Scene) -> bool:
    supports = [(support.at, support.kind) for support in scene.supports]
    return (
        scene.body.axial_stiffness is not None
        and scene.slider.offsets == (0.0,)
        and scene.damping == Damping()
        and supports == [(0.0, "pinned")]
        and all(load.direction == "y" for load in scene.loads)
    )
