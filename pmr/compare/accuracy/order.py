"""A scene that says what error is allowed, and the model and the step that it gets."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pmr.compare.accuracy import mesh
from pmr.compare.accuracy.errors import Demand, coarsest
from pmr.compare.accuracy.family import Family, member_of
from pmr.compare.accuracy.limits import best_within
from pmr.compare.accuracy.search import Found, comparable, search
from pmr.compare.coverage import BLOWS, JUMPS
from pmr.compare.estimate import no_estimate
from pmr.compare.outputs import impulsive
from pmr.errors import InputError
from pmr.errors.text import rounded
from pmr.reduced.model import ReducedModel
from pmr.scene import Scene
from pmr.scene.asked import Accuracy
from pmr.scene.choice import transverse
from pmr.simulation import Excitation
from pmr.system.body import other_outputs

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
}


@dataclass(frozen=True)
class Choice:
    """What was chosen."""

    scene: Scene  # with the step and the coordinates that were chosen
    reduced: ReducedModel
    found: Found
    mesh: Mapping[str, float] | None = None  # by kind what the mesh is off by, a fraction (`with_mesh`)
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
    """The scene whose reduction holds all models among which is chosen; as it is where it orders none."""
    if scene.ordered is None:
        return scene
    reduction = scene.reduction.model_copy(update={"coordinates": COORDINATES, "residual_inertia": False})
    return scene.model_copy(update={"reduction": reduction})


def choose(scene: Scene, reduced: ReducedModel, taken: Mapping[str, float] | None = None) -> Choice:
    """The smallest model and the longest step that hold a `prepared` scene's tolerance; or the best within its budget.

    Of the tolerance so much is `taken` by the mesh, by kind.  Raises InputError if errors of this model, or of the
    outputs that are asked for, can't be estimated; SimulationError if its motion can't be computed.
    """
    asked, excitation = scene.ordered, Excitation.of(scene)
    assert asked is not None
    key = "accuracy" if isinstance(asked, Accuracy) else "budget"
    if why := no_estimate(reduced):
        raise InputError("scene", key, None, f"there is no estimate to go by: {why}")
    if "pad_force" in asked.outputs and impulsive(reduced, excitation):
        allowed = f"no pad_force, or a path without kinks, is allowed; nothing tells {BLOWS}"
        raise InputError("scene", f"{key}.outputs", list(asked.outputs), allowed)
    if "probe" in asked.outputs and not np.any(other_outputs(reduced)):
        raise InputError("scene", f"{key}.outputs", list(asked.outputs), "no probe, or a scene with probes, is allowed")
    family = Family(reduced, excitation, len(transverse(scene)), rates="velocity" in asked.outputs)
    recovery = scene.recovery
    coarse, inertia = coarsest(family, recovery.every if recovery else None), scene.simulation.simulators == ("march",)
    if isinstance(asked, Accuracy):
        found = search(family, Demand(asked.tolerance, asked.outputs, inertia, taken or {}), coarse)
    else:
        found = best_within(family, Demand(1.0, asked.outputs, inertia), asked, coarse)
    if found.estimate is not None and (why := found.estimate.unknown.get("pad_force")) == JUMPS:
        if "pad_force" in asked.outputs:
            allowed = f"no pad_force, or loads that set in smoothly, are allowed; nothing tells {why}"
            raise InputError("scene", f"{key}.outputs", list(asked.outputs), allowed)
    member = found.member
    update = {"coordinates": member.coordinates, "residual_inertia": member.residual_inertia}
    chosen = scene.model_copy(
        update={
            "time": scene.time.model_copy(update={"step": scene.time.end / found.steps}),
            "reduction": scene.reduction.model_copy(update=update),
        }
    )
    return Choice(chosen, member_of(reduced, member), found)


def with_mesh(
    choice: Choice, asked: Scene, reduced: ReducedModel, reduced_of: Callable[[Scene], ReducedModel]
) -> Choice:
    """What `choose` found for the scene `asked`, with the part of its mesh, if the scene wants that.

    `reduced_of` makes the reduction of a scene.

    That scene has shorter cells, and `COORDINATES` or twice as many until they suffice: most choices share it.  Where
    the mesh leaves some of the tolerance, the rest is searched with that much.  Raises InputError or SimulationError as
    for `pmr.simulation.Simulator`.
    """
    scene, member = choice.scene, choice.found.member
    if scene.ordered is None or not scene.ordered.mesh:
        return choice
    coordinates = COORDINATES
    while coordinates < member.coordinates:
        coordinates *= 2
    reduction = scene.reduction.model_copy(update={"coordinates": coordinates, "residual_inertia": False})
    finer = mesh.finer(scene.model_copy(update={"reduction": reduction}))
    if finer is None:
        return replace(choice, mesh_reason="a mesh that is read from a file has no finer one")
    better = member_of(reduced_of(finer), member)
    steps = comparable(choice.found.steps, 1)
    compared = scene.model_copy(update={"time": scene.time.model_copy(update={"step": scene.time.end / steps})})
    found = mesh.mesh_error(choice.reduced, better, compared, len(transverse(scene)), scene.ordered.outputs)
    choice = replace(choice, mesh=found, mesh_reason=None)
    allowed = scene.ordered.tolerance if isinstance(scene.ordered, Accuracy) else 0.0
    if choice.found.holds and not choice.holds and max(found.values()) <= MOST_OF_MESH * allowed:
        return replace(choose(asked, reduced, found), mesh=found, mesh_reason=None)
    return choice


def summary(choice: Choice) -> dict[str, Any]:
    """``accuracy`` and ``budget`` of summary.json.

    ``accuracy``: ``tolerance``, ``outputs``, ``holds``, ``chosen.{coordinates,residual_inertia,step}``, ``reasons``,
    ``seconds`` of the search; ``budget``: ``reduction``, ``step`` and ``mesh`` by kind of output (fractions), their
    ``sum`` and which is ``first`` to be improved; ``mesh_reason`` says why the part of the mesh isn't known.  A
    tolerance ``holds`` where the sum is within it.
    """
    found, asked = choice.found, choice.scene.ordered
    assert asked is not None
    parts = {"reduction": found.reduction, "step": found.step} | ({"mesh": choice.mesh} if choice.mesh else {})
    chosen = {
        "coordinates": found.member.coordinates,
        "residual_inertia": found.member.residual_inertia,
        "step": choice.scene.time.step,
    }
    accuracy = {
        "tolerance": asked.tolerance if isinstance(asked, Accuracy) else None,
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
