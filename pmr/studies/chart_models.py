"""Models of a load chart in all its postures: a reduced model, and richer models that indicate errors of its loads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from pmr.errors import ConvergenceError, InputError, SimulationError, reason_of
from pmr.files import npz
from pmr.files.arrays import Array
from pmr.scene import Scene
from pmr.scene.choice import traits_of
from pmr.scene.keys import LUFFING
from pmr.scene.members import members
from pmr.scene.model_ladder import model_comparison
from pmr.scene.structures import PointMass
from pmr.simulation.statics.equilibrium import buckling_factors
from pmr.simulation.statics.loaded import LoadedStructure
from pmr.simulation.statics.postures import (
    HOOK,
    WEIGHT,
    DeflectionOutputs,
    PostureMatrices,
    PostureSet,
    UnitLoads,
    acceleration_loads,
    side_positions,
)
from pmr.studies import tasks
from pmr.studies.limits import STABILITY_WORDS, Limit, with_fields
from pmr.studies.tasks import Arguments, Needs, TaskResult
from pmr.system.assembly import Assembly
from pmr.system.contacts import Contact
from pmr.system.system import System

#: Converter of a system's contacts to JSON and back.
CONTACTS = TypeAdapter(tuple[Contact, ...])
#: Why the error of the mesh is not known: a clause for the report.
NO_OTHER_MESH = "only beams are compared on another mesh; a run at such a point tells this error"
#: Number of luffing angles at each extension for whose contact forces there are attachment modes.
ANGLES_WITH_MODES = 3
#: Number of postures in which the richer model's buckling factor is compared with that of full order.
FULL_ORDER_POSTURES = 5
#: Why some limits are not compared with a richer model, which has their quantity at other positions or lacks it.
WHY_NOT_STRESS = "as stress depends on how walls bend at pads, loads and corners"
#: Errors after which a richer structural model counts as not available, as in runs.
UNKNOWN = (InputError, ConvergenceError, SimulationError, ValueError, ImportError)


def compute_postures(arguments: Arguments, needs: Needs) -> TaskResult:
    """Task: compute the `PostureMatrices` of a chart and, if ``error`` is true, of the systems for comparison.

    The arrays of the result, by the beginning of their names:

    - ``reduced.``: the postures of the reduced model, P in all.
    - ``reach`` (P,): length of the boom in m; ``tip`` (P, 3): the undeformed tip in m in the axes of the ground.
    - ``bent.``: outputs of `DeflectionOutputs`; ``turned.<angle>``: loads of `acceleration_loads`; ``contacts``: the
      system's contacts as JSON.

    The following arrays are there only if ``error`` is true:

    - ``richer.``: the postures of `richer_system`; ``mass.``: those of `postures_with_tip_mass`.
    - ``mesh.``: for beams, the postures of the model on another mesh, as in a run.  ``mesh_share``: the factor that
      turns a difference to this model into an error of the scene's mesh.  Both are missing for meshes that are read
      from files.
    - ``play`` (m,): the clearance in m of each of m contacts if pads have another play, as in a run; 0 for contacts
      without a clearance.  ``gap``: this play in m from face to face.  Both are missing unless pads only push.
    - ``too_stiff``: the share that `stiffness_excess` returns.

    The task's warnings are those warnings of a run that hold for the scene in all postures.
    """
    from pmr.compare import other_runs
    from pmr.compare.drives import turning_warnings
    from pmr.fullmodel.build import warnings
    from pmr.simulation.native.watched import exceeded_limits, exceeded_warnings, stroke_limits

    at = PostureSet.from_task(arguments["at"])
    scene = with_fields(tasks.scene_of(arguments), arguments.get("fields", ()), at.count)
    if arguments["error"]:  # attachment modes of the richer model need what an estimate needs
        scene = other_runs.with_estimates(scene, True)
    system = tasks.reduced_system(scene)
    reduced = PostureMatrices.from_scene(scene, system, at)
    reach = at.boom_length(scene)
    arrays = {
        **npz.record_arrays(DeflectionOutputs.from_system(system, at), "bent."),
        "reach": reach,
        "contacts": np.array(CONTACTS.dump_json(system.contacts).decode()),
        "tip": at.positions_on_base(scene, reach),
        **npz.record_arrays(reduced, "reduced."),
        **{f"turned.{angle}": acceleration_loads(scene, system, at, angle) for angle in arguments.get("turned", ())},
    }
    if arguments["error"]:
        if (play := other_runs.vary_play(scene, system.contacts)) is not None:
            arrays |= {"play": np.array([of.clearance or 0.0 for of in play.contacts]), "gap": np.array(play.gap)}
        better = richer_system(scene, system, at, arguments["up_to"])
        arrays |= npz.record_arrays(PostureMatrices.from_scene(scene, better, at), "richer.")
        arrays |= npz.record_arrays(postures_with_tip_mass(scene, at, arguments["up_to"]), "mass.")
        if all(traits_of(member).has_line for member in members(scene)):
            with suppress(InputError):  # a mesh that is read from a file has no other one
                other = other_runs.other_mesh(scene)
                on_mesh = tasks.reduced_system(other_runs.motion_only(other.scene))
                arrays |= npz.record_arrays(PostureMatrices.from_scene(scene, on_mesh, at), "mesh.")
                arrays["mesh_share"] = np.array(other.share)
        full = tasks.full_system(scene)
        arrays["too_stiff"] = np.array(stiffness_excess(scene, better, full, at, arguments["up_to"]))
    of_structures = [line for body in tasks.bodies_of(scene).values() for line in warnings(body.structure)]
    beyond = exceeded_limits(stroke_limits(scene), {LUFFING: at.luffing}.get)
    of_luffing = [*turning_warnings(scene, at.luffing), *exceeded_warnings(beyond, lambda _: "in the chart")]
    lines = dict.fromkeys((*of_structures, *other_runs.mesh_warnings(scene), *of_luffing))
    return TaskResult(arrays=arrays, warnings=tuple(lines))


def richer_system(scene: Scene, system: System, positions: PostureSet, up_to: float) -> System:
    """Return the `system` with attachment modes for the contact forces of a few of its equilibria.

    The equilibria are those without a load and under one load.  This load is half of `up_to`, the largest load in kg,
    or half the load at which the boom buckles if this is less.  If the boom has geometric stiffness, further modes are
    for the contact forces of the shape in which it buckles.  `positions` are all postures of the chart; up to three
    luffing angles at each extension are used.
    """
    from pmr.compare.motion import system_with_attachment_modes

    few = positions.select(_sample_postures(positions))
    sample, half = PostureMatrices.from_scene(scene, system, few), up_to / 2.0
    loaded = [LoadedStructure(sample.equations(k, {WEIGHT: 1.0}), may_float=True) for k in range(few.count)]
    most = [min(half, equilibrium.state(0.0).form.critical / 2.0) for equilibrium in loaded]
    forces = [np.array([equilibrium.state(0.0).forces for equilibrium in loaded])]
    forces.append(np.array([equilibrium.state(load).forces for equilibrium, load in zip(loaded, most, strict=True)]))
    weight, hook = sample.loads.f[sample.loads.names.index(WEIGHT)], sample.loads.f[sample.loads.names.index(HOOK)]
    loads = [weight, weight + np.array(most)[:, None] * hook]
    if sample.structure.terms.size:
        shapes = np.array([equilibrium.state(0.0).form.buckling_forces(half) for equilibrium in loaded])
        forces.append(shapes * np.abs(forces[-1]).max(axis=1, initial=0.0)[:, None])
        loads.append(np.zeros_like(weight))
    bearing = [np.nan_to_num(contact_forces) for contact_forces in forces]
    return system_with_attachment_modes(system, side_positions(system, few), bearing, loads)


def postures_with_tip_mass(scene: Scene, positions: PostureSet, mass: float) -> PostureMatrices:
    """Return the postures, at `positions`, of the reduced model of a run with a `mass` in kg at the scene's tip.

    The modes of that model are those of a boom with the mass, so it has an error of its own.  The weight of the mass is
    removed, since the load of the chart, `HOOK`, acts in its place; the mass matrix still contains the mass.
    """
    last = scene.sections[-1]
    point = next(load.point for load in last.loads if load.name == HOOK)
    masses = (*last.masses, PointMass(name=HOOK, on="tip", mass=mass, at=point))
    with_mass = scene.with_keys(sections=(*scene.sections[:-1], last.with_keys(masses=masses)))
    postures = PostureMatrices.from_scene(with_mass, tasks.reduced_system(with_mass), positions)
    loads, machine = postures.loads, postures.machine
    weight, hook = (loads.names.index(name) for name in (WEIGHT, HOOK))
    f, c, parts = loads.f.copy(), loads.c.copy(), machine.parts.swapaxes(0, 1).copy()
    for of_load in (f, c, parts):
        of_load[weight] -= mass * of_load[hook]
    return replace(postures, loads=replace(loads, f=f, c=c), machine=replace(machine, parts=parts.swapaxes(0, 1)))


def stiffness_excess(scene: Scene, better: System, full: System, positions: PostureSet, up_to: float) -> float:
    """Return the largest share by which the richer system's buckling factor exceeds that of full order; 0 if none does.

    `better` is the richer system and `full` the system of full order.  The two are compared in at most
    `FULL_ORDER_POSTURES` of the postures `positions`, under half of `up_to` in kg.  Postures in which either has no
    finite factor are ignored.

    The share is needed because a model with few coordinates buckles at a higher load than the full model (Rayleigh's
    quotient).  The reduced and the richer model both have such an error, so that it may cancel in their difference.
    """
    every = _sample_postures(positions)
    few = positions.select(every[np.linspace(0, len(every) - 1, min(FULL_ORDER_POSTURES, len(every))).astype(int)])
    factors = []
    for system in (better, full):
        assembly, x, loads = Assembly(system), side_positions(system, few), UnitLoads.from_scene(scene, system, few)
        pressed = loads.c[loads.names.index(WEIGHT)] + up_to / 2.0 * loads.c[loads.names.index(HOOK)]
        named = [dict(zip(system.term_names, row.tolist(), strict=True)) for row in pressed]
        factors.append([buckling_factors(assembly, at_, amounts)[0] for at_, amounts in zip(x, named, strict=True)])
    richer, exact = np.array(factors)
    finite = np.isfinite(richer) & np.isfinite(exact)
    return max(0.0, float(np.max(richer[finite] / exact[finite] - 1.0, initial=0.0)))


def _sample_postures(positions: PostureSet) -> NDArray[np.int64]:
    """Return the numbers (n,), ascending, of up to three postures of each extension.

    The postures are those with the least, a middle and the largest luffing angle.
    """
    groups = dict[tuple[float, ...], list[int]]()
    for k in range(positions.count):
        groups.setdefault(tuple(float(extension[k]) for extension in positions.extensions.values()), []).append(k)
    selection = set[int]()
    for numbers in groups.values():
        ordered = np.array(sorted(numbers, key=lambda k: float(positions.luffing[k])))
        some = np.linspace(0, len(ordered) - 1, min(ANGLES_WITH_MODES, len(ordered))).astype(int)
        selection |= set(ordered[some].tolist())
    return np.array(sorted(selection))


def compute_richer_postures(arguments: Arguments, needs: Needs) -> TaskResult:
    """Task: compute the `PostureMatrices` of a richer structural model (arrays ``model.``) and its name (``called``).

    If there is no such model, the only array is ``reason``, which says why.  The richer model is that with which runs
    are compared (`pmr.scene.model_ladder.model_comparison`), with 20 free modes of each section.
    """
    from pmr.system.from_scene import force_names

    scene, at = tasks.scene_of(arguments), PostureSet.from_task(arguments["at"])
    try:
        of_scene, other, called = model_comparison(scene)
        if any(sorted(force_names(of_scene)[kind]) != sorted(force_names(other)[kind]) for kind in ("pad", "cylinder")):
            return _missing_model(f"a {called} has other pads and cylinders")
        postures = PostureMatrices.from_scene(other, tasks.reduced_system(other), at)
    except UNKNOWN as error:
        return _missing_model(reason_of(error))
    return TaskResult(arrays={**npz.record_arrays(postures, "model."), "called": np.array(called)})


def _missing_model(reason: str) -> TaskResult:
    """Return the result of a task without a richer structural model: an array with the `reason` why there is none."""
    return TaskResult(arrays={"reason": np.array(reason)})


@dataclass(frozen=True)
class ComparedModel:
    """Postures with another model, whose name is `label`.

    A difference of the reduced model to this model times `share` is an error of the reduced model.
    """

    postures: PostureMatrices
    label: str
    share: float


@dataclass(frozen=True)
class ChartModels:
    """Postures of a chart with the reduced model (`reduced`) and with the models that it is compared with.

    The postures with a model that is missing are None.  `enriched` is the reduced model with attachment modes.
    `with_tip_mass` is the reduced model of a run with a mass at the tip.  `comparisons` has other models by the part of
    the error that they tell: under ``model`` a richer structural model, under ``mesh`` a reduced model on a finer or
    coarser mesh, under ``play`` the reduced model with another play of its pads.
    """

    reduced: PostureMatrices
    enriched: PostureMatrices | None
    with_tip_mass: PostureMatrices | None
    comparisons: Mapping[str, ComparedModel]
    no_structural: str  # the reason why there is no richer structural model
    stiffness_excess: float  # share by which the richer model's buckling factor is above that of full order
    reach: Array  # (P,) m

    @classmethod
    def from_needs(cls, needs: Needs) -> ChartModels:
        """Collect the models from the results of `compute_postures` and `compute_richer_postures`.

        `needs` has these results under the names ``postures`` and ``model``.  The result ``model`` may be missing.
        """
        arrays, model_arrays = needs["postures"].arrays, needs["model"].arrays if "model" in needs else {}
        reduced = npz.record_from_arrays(PostureMatrices, arrays, "reduced.")
        enriched, with_tip_mass, other_mesh = (_read_postures(arrays, name) for name in ("richer", "mass", "mesh"))
        comparisons = dict[str, ComparedModel]()
        if (structural := _read_postures(model_arrays, "model")) is not None:
            comparisons["model"] = ComparedModel(structural, str(model_arrays["called"]), 1.0)
        if other_mesh is not None:  # the share is the error of the mesh over the difference to this model
            comparisons["mesh"] = ComparedModel(other_mesh, "other mesh", float(arrays["mesh_share"]))
        if "play" in arrays:
            structure = replace(reduced.structure, clearance=arrays["play"])
            comparisons["play"] = ComparedModel(replace(reduced, structure=structure), "model with play of pads", 1.0)
        reason, above = str(model_arrays.get("reason", "")), float(arrays.get("too_stiff", np.nan))
        return cls(reduced, enriched, with_tip_mass, comparisons, reason, above, arrays["reach"])

    def not_covered(self, limits: Sequence[Limit], scene: Scene) -> list[str]:
        """Return the errors that error bars of a chart of `scene` with these `limits` cover at no point, as clauses."""
        if self.enriched is None:
            return ["any error: error_bars = false"]
        of = [limit.name for limit in limits if not limit.kind.in_richer_model]
        model = f"the structural model: {self.no_structural}" if "model" not in self.comparisons else ""
        if not model and of:
            limits_of = f"limit{'s' if len(of) > 1 else ''} {' and '.join(of)}"
            model = f"the error of the structural model in the {limits_of}, {WHY_NOT_STRESS}"
        mesh = "" if "mesh" in self.comparisons else f"the mesh: {NO_OTHER_MESH}"
        may_have_play = any(ring.faces and ring.unilateral for part in scene.sections for ring in part.rings)
        is_left_out = may_have_play and not scene.compare.play and "play" not in self.comparisons
        play = "the play of pads: compare.play = 0" if is_left_out else ""
        return [*filter(None, (model, mesh, play)), f"the effect of large rotations on {STABILITY_WORDS}"]


def _read_postures(arrays: Mapping[str, NDArray[np.generic]], model: str) -> PostureMatrices | None:
    """Return the postures from a task's `arrays` whose names begin with `model` and a dot; None if there are none."""
    return npz.record_from_arrays(PostureMatrices, arrays, f"{model}.") if f"{model}.structure.K" in arrays else None
