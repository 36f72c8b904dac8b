"""A scene that says what error is allowed, and the model and the step that it gets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from pmr.compare.accuracy import mesh
from pmr.compare.accuracy.errors import Demand, coarsest
from pmr.compare.accuracy.family import Family
from pmr.compare.accuracy.limits import best_within
from pmr.compare.accuracy.search import Found, comparable, search
from pmr.compare.coverage import IMPACTS, JUMPS
from pmr.compare.estimate import no_estimate
from pmr.errors import InputError
from pmr.errors.aside import Aside
from pmr.errors.text import rounded
from pmr.reduced.model import ReducedModel
from pmr.reduced.quasi_static import as_simulated
from pmr.scene import Scene
from pmr.scene.asked import Accuracy, Budget
from pmr.scene.frame_terms import frame_terms
from pmr.simulation import Excitation
from pmr.system.contacts import ALONE
from pmr.system.from_scene import system_of
from pmr.system.system import System

#: Share of a tolerance that a mesh may take for the rest to be searched beside it.
MOST_OF_MESH = 0.9
#: Coordinates of the reduction from which the search takes away, or to which it adds its enrichment modes.
COORDINATES = 6
_CALLED = {
    "beam": "displacements",
    "tip": "the tip's",
    "pad_force": "forces of sliders and pads",
    "velocity": "velocities",
    "probe": "what probes measure",
    "cylinder_force": "forces of cylinders",
}


@dataclass(frozen=True)
class Choice:
    """What was chosen."""

    scene: Scene  # with the step and, of a body alone, the coordinates that were chosen
    models: Mapping[str, ReducedModel]  # by body, `ALONE` or sections, these without the modes of their cylinders
    found: Found
    mesh: Mapping[str, float] | None = None  # by kind what the mesh is off by, a fraction (`BesideOtherMesh`)
    mesh_reason: str | None = "the scene leaves it out"  # why that isn't known

    @property
    def sum(self) -> dict[str, float]:
        """What all parts are together, by kind: reduction and step as signals, and the mesh as far as it is known."""
        return {kind: share + (self.mesh or {}).get(kind, 0.0) for kind, share in self.found.total.items()}

    @property
    def holds(self) -> bool:
        """Whether that is within the tolerance, if there is one."""
        asked = self.scene.accuracy
        return self.found.holds and (asked is None or max(self.sum.values()) <= asked.tolerance)


def prepared(scene: Scene) -> Scene:
    """The scene whose reduction holds all models among which is chosen; as it is where it orders none.

    Sections have the coordinates that they ask for, and more enrichment modes (`pmr.reduction.from_scene`).
    """
    if scene.ordered is None or len(scene.bodies) > 1:
        return scene
    reduction = scene.reduction.model_copy(update={"coordinates": COORDINATES})
    return scene.model_copy(update={"reduction": reduction})


def choose(
    scene: Scene,
    models: Mapping[str, ReducedModel],
    aside: Aside,
    taken: Mapping[str, float] | None = None,
) -> Choice:
    """The smallest models and the longest step that hold a scene's tolerance; or the best within its budget.

    `models` are those of a `prepared` scene by body, of sections on free modes.  Of the tolerance so much is `taken` by
    the mesh, by kind.  The process `aside` helps.  Raises InputError if errors of these models, or of
    the outputs that are asked for, can't be estimated; SimulationError if their motion can't be computed.
    """
    asked, recovery = _asked(scene), scene.recovery
    if why := no_estimate(models):
        raise InputError("scene", _key(scene), None, f"there is no estimate to go by: {why}")
    family = family_of(scene, models, aside)
    if lacking := [kind for kind in asked.outputs if kind not in family.kinds]:
        _refuse(scene, f"no {lacking[0]}, or a scene with {_NEEDED.get(lacking[0], 'such outputs')}, is allowed")
    if "pad_force" in asked.outputs and family.impulsive:
        _refuse(scene, f"no pad_force, or a path without kinks, is allowed; there is no estimate of {IMPACTS}")
    coarse = coarsest(family, recovery.every if recovery else None)
    if scene.accuracy is not None:
        found = search(family, Demand(scene.accuracy.tolerance, asked.outputs, taken or {}), coarse)
    else:
        assert scene.budget is not None
        found = best_within(family, Demand(1.0, asked.outputs), scene.budget, coarse)
    if found.estimate is not None and (why := found.estimate.unknown.get("pad_force")) == JUMPS:
        if "pad_force" in asked.outputs:
            _refuse(scene, f"no pad_force, or loads that set in smoothly, are allowed; there is no estimate of {why}")
    chosen, member = _with_step(scene, found.steps), found.member
    if ALONE in models:
        update = {"coordinates": member.coordinates}
        chosen = chosen.model_copy(update={"reduction": scene.reduction.model_copy(update=update)})
    return Choice(chosen, family.models(member), found)


def family_of(scene: Scene, models: Mapping[str, ReducedModel], aside: Aside | None = None) -> Family:
    """All models of a scene's bodies that reductions hold."""
    rates = scene.ordered is not None and "velocity" in scene.ordered.outputs
    return Family(models, partial(_joined, scene), Excitation.of(scene), rates, aside)


def _joined(scene: Scene, models: Mapping[str, ReducedModel]) -> System:
    """As they are simulated."""
    stressed = any(frame_terms(scene))
    return system_of(scene, {name: as_simulated(model, stressed) for name, model in models.items()})


_NEEDED = {"probe": "probes", "pad_force": "pads", "cylinder_force": "cylinders"}


def _asked(scene: Scene) -> Accuracy | Budget:
    assert scene.ordered is not None
    return scene.ordered


def _key(scene: Scene) -> str:
    return "budget" if scene.accuracy is None else "accuracy"


def _refuse(scene: Scene, allowed: str) -> None:
    raise InputError("scene", f"{_key(scene)}.outputs", list(_asked(scene).outputs), allowed)


def _with_step(scene: Scene, steps: int) -> Scene:
    return scene.model_copy(update={"time": scene.time.model_copy(update={"step": scene.time.end / steps})})


def on_other_mesh(choice: Choice, asked: Scene) -> mesh.OtherMesh:
    """The scene `asked` with the step that was chosen, on the mesh that tells the part of its own.

    A body alone has `COORDINATES` or twice as many until they suffice: most choices share that scene.  Raises an
    `InputError` that says why there is no other mesh.
    """
    found = mesh.other_mesh(_with_step(asked, choice.found.steps))
    if ALONE not in choice.models:
        return found
    coordinates = COORDINATES
    while coordinates < choice.found.member.coordinates:
        coordinates *= 2
    reduction = asked.reduction.model_copy(update={"coordinates": coordinates})
    scene = found.scene.model_copy(update={"reduction": reduction, "accuracy": None, "budget": None})
    return replace(found, scene=scene)


@dataclass(frozen=True)
class BesideOtherMesh:
    """What `choose` found for the scene `asked` of its `models`, which move as `own` beside those on another mesh."""

    choice: Choice
    asked: Scene
    models: Mapping[str, ReducedModel]
    own: Family
    aside: Aside

    @classmethod
    def begin(cls, choice: Choice, asked: Scene, models: Mapping[str, ReducedModel], aside: Aside) -> BesideOtherMesh:
        """The process `aside` begins with what moves on the scene's own mesh."""
        steps = comparable(choice.found.steps, 1)
        own = family_of(_with_step(asked, steps), models, aside)
        own.begin(choice.found.member, steps, steps)
        return cls(choice, asked, models, own, aside)

    def with_mesh(self, other: mesh.OtherMesh, on_other: Mapping[str, ReducedModel]) -> Choice:
        """The choice with the part of the mesh, from models `on_other_mesh`.

        Where the mesh leaves some of the tolerance, the rest is searched with that much.  Raises InputError or
        SimulationError as for `pmr.simulation.Simulator`.
        """
        found, wanted = self.choice.found, _asked(self.asked)
        steps = comparable(found.steps, 1)
        theirs = family_of(_with_step(self.asked, steps), on_other)
        part = mesh.part_of(self.own, theirs, found.member, steps, other.share, wanted.outputs)
        choice, accuracy = replace(self.choice, mesh=part, mesh_reason=None), self.choice.scene.accuracy
        allowed = 0.0 if accuracy is None else accuracy.tolerance
        if found.holds and not choice.holds and max(part.values()) <= MOST_OF_MESH * allowed:
            return replace(choose(self.asked, self.models, self.aside, part), mesh=part, mesh_reason=None)
        return choice


def summary(choice: Choice) -> dict[str, Any]:
    """``accuracy`` and ``budget`` of summary.json.

    ``accuracy``: ``tolerance``, ``outputs``, ``holds``, ``chosen.{coordinates,step}``, of sections
    ``chosen.sections`` too, ``reasons``, ``seconds`` of the search; ``budget``: ``reduction``, ``step``
    and ``mesh`` by kind of output (fractions), their ``sum`` and which is ``first`` to be improved; ``mesh_reason``
    says why the part of the mesh isn't known.  A tolerance ``holds`` where the sum is within it.
    """
    found, asked = choice.found, _asked(choice.scene)
    sizes = {name: model.size for name, model in choice.models.items()}
    parts = {"reduction": found.reduction, "step": found.step} | ({"mesh": choice.mesh} if choice.mesh else {})
    of_bodies = {} if ALONE in sizes else {"sections": sizes}
    chosen = {"coordinates": found.member.coordinates, **of_bodies, "step": choice.scene.time.step}
    accuracy = {
        "tolerance": choice.scene.accuracy.tolerance if choice.scene.accuracy else None,
        "outputs": list(asked.outputs),
        "holds": choice.holds,
        "chosen": chosen,
        "reasons": list(found.reasons),
        "seconds": found.seconds,
    }
    budget = parts | {
        "mesh": choice.mesh,
        "mesh_reason": choice.mesh_reason,
        "sum": choice.sum,
        "first": max(parts, key=lambda name: max(parts[name].values())),
    }
    return {"accuracy": accuracy, "budget": budget}


def warnings(choice: Choice) -> list[str]:
    """What a user should know: a tolerance that isn't held, by the model or by its mesh; a line each."""
    found, asked = choice.found, choice.scene.accuracy
    if asked is None:
        return []
    limit, said = _percent(asked.tolerance), list[str]()
    if not found.holds:
        sizes = ", ".join(_beside(asked.tolerance, kind, share) for kind, share in found.total.items())
        model = f"{found.member.coordinates} coordinates with steps of {choice.scene.time.step:.3g} s"
        said.append(
            f"the tolerance of {limit} isn't held: {model} are off by {sizes}, most of it by the {_larger(found)}"
        )
    shares = (choice.mesh or {}).items()
    if beyond := [_beside(asked.tolerance, kind, share) for kind, share in shares if share > asked.tolerance]:
        said.append(
            f"the mesh can't hold the tolerance of {limit}: it is off by {', '.join(beyond)}; shorter cells help"
        )
    elif found.holds and not choice.holds:
        sizes = ", ".join(_beside(asked.tolerance, kind, share) for kind, share in choice.sum.items())
        of_mesh = _percent(max((choice.mesh or {}).values()))
        said.append(
            f"the tolerance of {limit} isn't held: all is off by {sizes}, {of_mesh} by the mesh; shorter cells help"
        )
    return said


def _larger(found: Found) -> str:
    return "reduction" if max(found.reduction.values()) >= max(found.step.values()) else "step"


def _percent(fraction: float) -> str:
    return f"{rounded(100.0 * fraction)} %" if fraction < 10.0 else f"{rounded(fraction)} times their size"


def _beside(tolerance: float, kind: str, share: float) -> str:
    """A share and its kind, in words that don't round what is beyond the tolerance to it."""
    said = _percent(share)
    said = "a little more" if share > tolerance and said == _percent(tolerance) else said
    return f"{said} in {_CALLED[kind]}"
