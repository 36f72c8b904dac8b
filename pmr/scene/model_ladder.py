"""Structural models in order of their richness, and scenes with richer models that a scene is compared with."""

from __future__ import annotations

from typing import NamedTuple

from pmr.errors import InputError
from pmr.scene.checks import check_scene
from pmr.scene.choice import FROM_AN_END, is_undecided, model_of, traits_of
from pmr.scene.joints import BoomSection
from pmr.scene.members import members
from pmr.scene.model_traits import model_traits, models_by_rank
from pmr.scene.run_settings import Reduction, Simulation
from pmr.scene.scene import Scene

#: For comparisons of models: coordinates of a body, and observed positions.
COORDINATES, PLACES = 20, 9
#: For shells that no scene names: length of cells over that of the scene, for beams with rigid walls; most cells.
COARSE, MOST_RECTANGLES = 2.0, 2500
#: Estimated time in s of a comparison, and of each cell of its shells; measured with boxes of 5 and 6 m.
FIXED, EACH = 1.0, 6e-3


class ModelComparison(NamedTuple):
    """A scene with its own structural models, the scene with richer models, and the name of the richer model."""

    scene: Scene
    richer: Scene
    name: str


def model_comparison(scene: Scene) -> ModelComparison:
    """Return the scene with its own models, the scene with richer models, and the name of the richer model.

    Both scenes are reduced and observed alike.  Unless the scene names a richer model, it is a shell that takes little
    time.

    Raises an `InputError` with the reason if there is no richer model or the scene requests no comparison.
    """
    if scene.compare.richer == "none":
        raise _no_comparison("none", "not measured: compare.richer = 'none' leaves it out")
    if scene.compare.richer == "auto":
        return _default_comparison(scene)
    richer_model, models_of_scene = scene.compare.richer, [model_of(member) for member in members(scene)]
    traits, order = [model_traits(model) for model in models_of_scene], models_by_rank()
    ranks = [each.rank for each in traits if each.rank is not None]
    if len(ranks) < len(models_of_scene) or max(ranks) == len(order) - 1:
        models = " and ".join(dict.fromkeys(models_of_scene))
        if any(each.kind == "mass" for each in traits):
            raise _no_comparison(richer_model, "not measured: no shell stands for a mass on a wheel")
        raise _no_comparison(
            richer_model, f"a shell is the richest model there is to compare with, beams are less; this is {models}"
        )
    richer = order[max(ranks) + 1] if richer_model == "next" else richer_model
    if order.index(richer) <= max(ranks):
        raise _no_comparison(richer_model, f"{' and '.join(dict.fromkeys(models_of_scene))} is as rich as that")
    if any(part.body.box is None for part in scene.sections):
        raise _no_comparison(richer_model, "[body.box] is needed: from it the richer model is made")
    has_cells = model_traits(richer).has_cells
    if has_cells and any(part.body.section is not None for part in scene.sections):
        raise _no_comparison(richer_model, "body.section gives stiffnesses that a shell of the box does not have")
    if not has_cells and any(part.body.walls == "give" for part in scene.sections):
        raise _no_comparison(richer_model, "'shell' is allowed for a beam whose walls give way")
    with_richer = _scene_with_models(scene, [richer] * len(models_of_scene))
    return ModelComparison(comparable_scene(scene), with_richer, richer)


def _default_comparison(scene: Scene) -> ModelComparison:
    """Return the scene, the scene with shells, and the shells' name, for ``compare.richer = 'auto'``.

    Beams with rigid walls are compared with coarse shells.  Beams whose walls give way take the compliance of the walls
    from shells with the scene's cells.  They are compared with shells of the same cells, so that the error of the cells
    is in both.

    Raises an InputError if the shells would take long.
    """
    of_scene, shells, called = model_comparison(scene.with_keys(compare={"richer": models_by_rank()[-1]}))
    by = 1.0 if any(part.body.walls == "give" for part in scene.sections) else COARSE
    if sum(shell_cell_count(part, by) for part in shells.sections) > MOST_RECTANGLES:
        minutes = (FIXED + EACH * sum(shell_cell_count(part, 1.0) for part in shells.sections)) / 60.0
        raise _no_comparison(
            "auto", f"not measured; compare.richer = 'shell' measures it, in some {minutes:.2g} minutes"
        )
    if by == 1.0:
        return ModelComparison(of_scene, shells, called)
    coarse = shells.vary_sections(
        lambda part: {"mesh": {"size": by * part.mesh.size, "along": part.mesh.along and by * part.mesh.along}}
    )
    return ModelComparison(of_scene, coarse, f"coarse {called}")


def shell_cell_count(part: BoomSection, by: float) -> float:
    """Return about how many cells the shell of a section has.

    Each cell is `by` times as long and wide as the scene's cells.  The number is not rounded to whole cells.  The
    section has to be a box.
    """
    assert part.body.box is not None  # as `model_comparison` says
    around, along = by * part.mesh.size, by * (part.mesh.along or part.mesh.size)
    return sum(max(2.0, side.length / around) for side in part.body.box.sides) * part.length / along


def candidate_scenes(scene: Scene) -> list[Scene]:
    """Return the scenes among which measurements choose a model; empty if no body's model is left to measurements.

    First come beams with rigid walls, then beams with flexible walls, planar ones before those in space; shells are
    last.  Planar beams are left out if some body needs a beam in space.  Rigid walls are left out if the scene has
    flexible ones.  Beams that fail the checks of a scene are left out too.  All bodies that are left to measurements
    get the same model.
    """
    open_ = [member for member in members(scene) if is_undecided(member)]
    if not open_:
        return []
    *beams, shell = models_by_rank()
    least = max(traits_of(member).rank or 0 for member in open_)
    kinds = ("give",) if any(member.part.body.walls == "give" for member in open_) else ("rigid", "give")
    beam_scenes = [_choose_models(scene, model, walls) for walls in kinds for model in beams[least:]]
    return [*filter(_passes_checks, beam_scenes), _choose_models(scene, shell, "rigid")]


def comparable_scene(scene: Scene) -> Scene:
    """Return the scene with its own models, and with positions and a reduction by which models can be compared."""
    return _scene_with_models(scene, [model_of(member) for member in members(scene)])


def _choose_models(scene: Scene, model: str, walls: str) -> Scene:
    """Return the scene with this model and these walls for all bodies whose model is left to measurements.

    Another box with the model ``auto`` gets the model that `choose_model` returns for it.
    """
    parts = []
    for member in members(scene):
        part = member.part
        if part.body.model == "auto" and part.body.box is not None:
            chosen = {"model": model, "walls": walls} if is_undecided(member) else {"model": model_of(member)}
            part = part.model_copy(update={"body": part.body.model_copy(update=chosen)})
        parts.append(part)
    return scene.model_copy(update={"sections": tuple(parts)})


def _passes_checks(scene: Scene) -> bool:
    """Whether a scene passes all checks."""
    try:
        check_scene(scene)
    except InputError:
        return False
    return True


def _no_comparison(value: str, why: str) -> InputError:
    """Return the error that says why there is no comparison; `value` is the value of ``compare.richer``."""
    return InputError("scene", "compare.richer", value, why)


def _scene_with_models(scene: Scene, models: list[str]) -> Scene:
    """Return the scene with one model for each body, positions that all models have, and an accurate reduction.

    The scene is simulated once, by ``march``; stresses, accuracy and budget are left out of it, and of probes all but
    displacements.  Walls give way only where the scene says so and the model allows it.
    """
    parts = []
    for part, model in zip(scene.sections, models, strict=True):
        length, walls = part.length, part.body.walls if model_traits(model).walls_may_give else "rigid"
        places = {"start": FROM_AN_END * length, "end": (1.0 - FROM_AN_END) * length, "count": PLACES}
        changes = {
            "body": part.body.model_copy(update={"model": model, "walls": walls}),
            "observe": part.observe.model_copy(update={**places, "frequency_response": False}),
            "probes": tuple(
                probe.model_copy(update={"measures": ("displacement",)})
                for probe in part.probes
                if "displacement" in probe.measures
            ),
            "reduction": Reduction(coordinates=COORDINATES, estimate=False, solver=part.reduction.solver),
        }
        parts.append(part.model_copy(update=changes))
    once = Simulation(simulators=("march",), repeats=1)
    left_out = {"accuracy": None, "budget": None, "recovery": None, "simulation": once}
    return scene.model_copy(update={"sections": tuple(parts), **left_out})
