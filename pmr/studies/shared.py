"""Tasks that runs of many kinds of studies share: reference motions and frequencies of full models.

Each task is planned from a scene without the keys that do not decide its result, so that runs which differ only in such
keys share the task, within a study and across the studies of a collection.  The functions import FEniCSx when they are
called: planning works without it.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from pmr.files import npz
from pmr.scene import Compare, Damping, Reduction, Scene, Simulation, TimeChoice
from pmr.scene.keys import ALONE
from pmr.studies.tasks import Arguments, Needs, Task, TaskFunction, TaskResult
from pmr.system.from_scene import contacts_of
from pmr.system.terms import terms_of

if TYPE_CHECKING:
    from pmr.fullmodel.build import AssembledBody
    from pmr.fullmodel.model import FullModel
    from pmr.system.system import System

#: Rough effort in s for the beam of Weyrer et al.
COSTS = {"full": 0.5, "ancf": 3.0, "frequencies": 0.5}


def scene_arguments(scene: Scene) -> dict[str, Any]:
    """Return a scene as arguments of a task: ``scene``, its keys, and ``hash``, a digest that covers named files."""
    plain = scene.model_copy(update={"title": "", "published": None})
    return {"scene": plain.model_dump(mode="json"), "hash": plain.hash}


def scene_of(arguments: Arguments) -> Scene:
    """Return the scene of a task's arguments that `scene_arguments` made."""
    return Scene.model_validate(arguments["scene"])


def model_of(scene: Scene) -> FullModel:
    """Return the full model of a scene's single body, stored for later tasks by `bodies_of`."""
    return bodies_of(scene)[ALONE].model


def full_system(scene: Scene) -> System:
    """Return all full models of a scene, with their contacts, as one system of SciPy matrices.

    The matrices are complete, as a task runs on one rank.
    """
    from pmr.fullmodel.model import FullSystem

    models = {name: built.model for name, built in bodies_of(scene).items()}
    full = FullSystem(models, contacts_of(scene, models)).gather()
    assert full is not None
    return replace(full, terms=terms_of(scene, full.bodies))


def reduced_system(scene: Scene) -> System:
    """Return all bodies of a scene, reduced by their own settings, as one system."""
    from pmr.reduction.bodies import join_bodies, reduce_bodies

    return join_bodies(scene, reduce_bodies(scene, bodies_of(scene)))


def bodies_of(scene: Scene) -> Mapping[str, AssembledBody]:
    """Return a scene's full models with their structures, by the body's name.

    The models are stored for later tasks of this process.
    """
    plain = {"title": "", "published": None, "damping": scene.damping}
    return _build_bodies(_without_loads(scene).model_copy(update=plain))


@lru_cache(maxsize=4)
def _build_bodies(scene: Scene) -> Mapping[str, AssembledBody]:
    """Build the full models of a scene's bodies, and log their warnings; return the bodies by name."""
    from pmr.fullmodel.build import build_bodies, log_warnings

    built = build_bodies(scene)
    log_warnings(built.values(), next(iter(built.values())).model.comm)
    return built


def with_reduction(scene: Scene, reduction: Reduction) -> Scene:
    """Return the scene with the settings `reduction` for every body."""
    return scene.vary_sections(lambda part: {"reduction": reduction})


def reference_task(scene: Scene, name: str) -> Task:
    """Return the task that simulates the reference model `name`, ``"full"`` or ``"ancf"``, for comparison."""
    is_ancf = name == "ancf"
    alone = scene.model_copy(
        update={
            "reduction": Reduction(),
            "simulation": Simulation(full="auto" if is_ancf else scene.simulation.full),
            "compare": Compare(against=(name,), ancf_elements=scene.compare.ancf_elements if is_ancf else 1),
        }
    )
    return _scene_task(simulate_reference, name, name, alone, simulator=name)


def frequencies_task(scene: Scene) -> Task:
    """Return the task that computes the full model's lowest frequencies over the path."""
    return _scene_task(compute_frequencies, "frequencies", "frequencies", _without_loads(scene))


def simulate_reference(arguments: Arguments, needs: Needs) -> TaskResult:
    """Task: simulate the full model or the ANCF cable, as argument ``simulator`` says; arrays of the `Response`."""
    from pmr.pipeline.full_order import FullOrder

    scene = scene_of(arguments)
    response = FullOrder.join(scene, {ALONE: model_of(scene)}).reference(arguments["simulator"])
    assert response is not None
    return TaskResult(arrays=npz.record_arrays(response), seconds={"simulate": response.seconds})


def compute_frequencies(arguments: Arguments, needs: Needs) -> TaskResult:
    """Task: the full model's f lowest frequencies ``omega`` (S, f) in rad/s at path coordinates ``s`` (S,) in m."""
    from pmr.compare.frequencies import CURVES, comparison_positions
    from pmr.fullmodel.eigensolvers import lowest_frequencies

    scene = scene_of(arguments)
    model = model_of(scene)
    s = comparison_positions(scene, model.size)
    return TaskResult(arrays={"s": s, "omega": lowest_frequencies(model, s, CURVES, scene.reduction.solver)})


def _without_loads(scene: Scene) -> Scene:
    """Return the scene without loads, damping, comparison and settings of time steps and reduction."""
    end = scene.time.end  # positions of the path are visited up to this time
    unloaded = scene.without_loads().model_copy(
        update={
            "damping": Damping(),
            "time": TimeChoice(end=end, step=end),
            "compare": Compare(against=()),
            "simulation": Simulation(),
            "free_motions": "allowed",  # simulations refuse free motions; here a slider may stand on a support
        }
    )
    return with_reduction(unloaded, Reduction(solver=scene.sections[0].reduction.solver))


def _scene_task(function: TaskFunction, kind: str, name: str, scene: Scene, **more: Any) -> Task:
    """Return a task that calls `function` on the scene; its key is `name` with a digest of its arguments.

    `more` are further arguments, and `kind` is the kind of task by which its cost is known.
    """
    arguments = scene_arguments(scene) | more
    digest = hashlib.sha256(json.dumps(arguments, sort_keys=True).encode()).hexdigest()[:12]
    return Task(f"{name}-{digest}", function, arguments, cost=COSTS[kind])
