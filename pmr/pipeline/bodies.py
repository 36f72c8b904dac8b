"""Bodies of a scene in a run: reduced, sized to a tolerance, simulated, recovered, compared; stress at their pads."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from pmr.compare.accuracy import Choice, Search, prepare_scene, scene_on_other_mesh
from pmr.compare.error_parts import ReductionError, estimate_reduction, step_part
from pmr.compare.evaluation import SimulatedSystem
from pmr.compare.frequencies import WayPoints, frequencies_on_way, way_points
from pmr.compare.motion import reason_without_estimate
from pmr.compare.responses import Simulations, compared_quantities, simulate
from pmr.compare.second_order import decide_second_order
from pmr.compare.strength import utilisation_part
from pmr.compare.summary import comparison_part, impacts_part, masses_part, parts_of_motion, sections_part
from pmr.compare.trust import reduction_warnings, rigid_contacts
from pmr.errors import ConvergenceError, InputError, begin_aside, call_on_first_rank, reason_of
from pmr.errors.environment import Clock
from pmr.files.arrays import Array
from pmr.fullmodel.build import AssembledBody, models_of
from pmr.fullmodel.pads import Pad, Pads, restrain
from pmr.fullmodel.structure import couple
from pmr.pipeline.full_order import FullOrder, References
from pmr.pipeline.model_errors import UNNEEDED, ComparedScene
from pmr.reduction.bodies import cached_body, join_bodies, reduce_bodies, with_stress_flags
from pmr.reduction.cache import Cache
from pmr.reduction.from_scene import summary as describe_basis
from pmr.reduction.recovery import RecoveredBody, recover
from pmr.results import BodyResult, Frequencies, Response, Shapes
from pmr.results.field_series import mean_by_place
from pmr.results.field_stress import FORCES
from pmr.results.run import SummaryPart
from pmr.scene import Reduction, Scene
from pmr.scene.choice import traits_of
from pmr.scene.joints import BoomSection
from pmr.scene.keys import ALONE
from pmr.scene.members import members
from pmr.simulation import Excitation
from pmr.simulation.native.free_motion import with_free_motion
from pmr.simulation.petsc import Checkpoint
from pmr.system.states import BodyStates

if TYPE_CHECKING:
    from pmr.fullmodel.wall_stress import LoadedRing, SectionStates, WallPeak

#: Least number of coordinates of a model that serves to estimate the error of another model.
FEWEST = 6


#: Function that waits for the estimated error of the reduction.
Estimation = Callable[[], ReductionError]


@dataclass(frozen=True)
class Motions:
    """Motions of a run: of the reduced system by all of its simulators, on rank 0 alone, and of the references."""

    reduced: Simulations | None
    simulated: SimulatedSystem | None  # the reduced system with its motion
    error: Estimation | None
    references: References
    recovered: Mapping[str, RecoveredBody]  # fields of the scene's recovery by body; empty without one

    @property
    def responses(self) -> dict[str, Response]:
        """Responses of the models that were simulated, by name: ``reduced``, ``full`` and ``ancf``; on rank 0 alone."""
        assert self.reduced is not None  # as on rank 0
        return {"reduced": self.reduced.first.response, **self.references.responses}

    @property
    def seconds(self) -> dict[str, float]:
        """Wall time in s of each simulator of the reduced system and of each reference, by name.

        To be read on rank 0 only, as other ranks have no motion.
        """
        assert self.reduced is not None
        references = self.references.responses.items()
        return {**self.reduced.seconds, **{name: reference.seconds for name, reference in references}}


@dataclass(frozen=True)
class Precomputed:
    """Results of a single body's full model that several runs share; a run uses them instead of computing them."""

    references: Mapping[str, Response]  # ``full`` and ``ancf``, if the scene is compared with them
    frequencies: Array  # (S, f) Hz at the places of `pmr.compare.frequencies.way_points`


class Bodies:
    """Reduced and full models of a scene's bodies, as systems; all methods are collective.

    If the scene has a tolerance or a budget, the numbers of coordinates of the reduced models and the step of `scene`
    are chosen to meet it; `choice` says how, and is None otherwise.  `system` is the reduced system, `full` the full
    one, and `excitation` what drives both.
    """

    def __init__(
        self,
        scene: Scene,
        built: Mapping[str, AssembledBody],
        clock: Clock,
        caches: Mapping[str, Cache],
        shared: Precomputed | None = None,
    ) -> None:
        """Reduce the bodies, choose sizes and step, and join the reduced and the full models as systems.

        The motion of a machine that moves by itself is computed here, too.  `built` are the full models and `caches`
        their caches, by body; `shared` are results of a single body that other runs have computed.
        """
        self.built, self.clock, self.caches, self.shared = built, clock, caches, shared
        self._comm = next(iter(built.values())).model.comm
        self.bodies = reduce_bodies(prepare_scene(scene), built, caches, clock)
        models = {name: body.model for name, body in self.bodies.items()}
        scene = self._comm.bcast(call_on_first_rank(self._comm, lambda: decide_second_order(scene, models)))
        self.choice = self._choose_models(scene)
        self.scene = scene if self.choice is None else self.choice.scene  # with the step that was chosen
        if self.choice is not None:
            chosen = self.choice.models
            self.bodies = {name: replace(body, modal=chosen[name]) for name, body in self.bodies.items()}
        self.bodies = with_stress_flags(self.scene, self.bodies)
        #: the scene as written, with the chosen step; in `scene` the machine's motion is the motion of a frame instead
        self.written_scene, self.system = self.scene, join_bodies(self.scene, self.bodies)
        if self.scene.computed_key is not None:
            with clock.stage("machine"):
                self.scene, self.system = self._comm.bcast(
                    call_on_first_rank(self._comm, lambda: with_free_motion(self.scene, self.system))
                )
        self.excitation = Excitation.from_scene(self.scene)
        self.full = FullOrder.join(self.scene, models_of(built))
        self._other = self._other_model()

    def begin_frequencies(self, helper: Executor | None) -> Callable[[], Frequencies]:
        """Return a function with the lowest natural frequencies along the paths of the reduced and of the full system.

        The full system's frequencies are computed for a single body, and for a boom if the scene is compared with
        ``full``; a process of `helper` computes them, if it can.  Those of the reduced system are there on rank 0
        alone.
        """
        with_full = ALONE in self.built or "full" in self.scene.compare.against
        size = self.full.system.size if with_full else 0
        at = self._comm.bcast(
            call_on_first_rank(self._comm, lambda: way_points(self.scene, self.system, self.excitation, size))
        )
        of_full_system = self._begin_full_frequencies(at, helper) if with_full else None
        of_reduced_system = call_on_first_rank(
            self._comm, lambda: frequencies_on_way(self.scene, self.system, self.excitation, at)
        )
        natural = of_reduced_system or Frequencies(at.along, at.s, {})
        if of_full_system is None:
            return lambda: natural
        first = {name: values for name, values in natural.models.items() if name == "reduced"}  # in figures
        return lambda: replace(natural, models={**first, "full": of_full_system(), **natural.models})

    def simulate(self, checkpoint: Checkpoint | None, helper: Executor | None) -> Motions:
        """Simulate the reduced system by all simulators, and the references, and estimate the error; collective.

        References that several runs share are not simulated again.  If the scene has a `recovery`, stresses and fields
        of the bodies are computed, too.  If `checkpoint` is not None, a full-order simulation that was interrupted
        continues.  A process of `helper` simulates the full system, if it can.
        """
        steps = self.scene.recovered_steps.tolist()
        simulations = call_on_first_rank(
            self._comm, lambda: simulate(self.scene, self.system, self.excitation, self.clock, steps)
        )
        stepping = self._comm.bcast(None if simulations is None else simulations.time_grid)
        begun = None if self.shared else self.full.begin_simulation(steps, stepping, helper)
        simulated = None
        if simulations is not None:
            simulated = simulations.simulated_system(self.system, self.excitation)
        with self.clock.stage("estimate"):
            error = call_on_first_rank(self._comm, lambda: self._begin_estimate(simulated, helper))
        if self.shared is None:
            references = self.full.references(self.clock, steps, checkpoint, stepping, begun)
        else:
            references = References(self.shared.references, {}, {})
        recovered: Mapping[str, RecoveredBody] = {}
        if self.scene.recovery is not None:
            with self.clock.stage("recover"):
                states = self._comm.bcast(None if simulations is None else simulations.first.states)
                recovered = recover(self.scene, self.built, self.bodies, states, references.states)
        return Motions(simulations, simulated, error, references, recovered)

    def summary_parts(self, motions: Motions, natural: Frequencies) -> list[SummaryPart]:
        """Return the contributions to summary.json by the run's motions and natural frequencies; on rank 0 alone.

        They are in the order in which they are to be combined.  The error of the time step is measured here.
        """
        scene, system, responses = self.scene, self.system, motions.responses
        simulated = motions.simulated
        assert motions.reduced is not None and simulated is not None and motions.error is not None
        step_error = None if self.choice is None else self.choice.trial.step_error
        with self.clock.stage("step"):
            step = step_part(scene, simulated, natural.models["reduced"], step_error)
        with self.clock.stage("estimate"):
            error = motions.error()
        stresses = {name: body.summary() for name, body in motions.recovered.items()}
        more = {name: error.of_section(name) | stresses.get(name, {}) for name in scene.names}
        sizes = {name: {"full": self.built[name].model.size, "reduced": of.size} for name, of in system.reduced.items()}
        simulators = {"reduced": scene.simulation.simulators[0], "full": self.full.simulator}
        beside_full = comparison_part(
            responses, compared_quantities(scene, responses["reduced"]), simulators, rigid_contacts(self.full.system)
        )
        blows = impacts_part(system, self.excitation, responses)
        figures = {**beside_full.figures, **blows.figures, **error.part.figures}
        return [
            SummaryPart(describe_basis(scene, models_of(self.built), self.bodies)),
            beside_full,
            blows,
            error.part,
            SummaryPart(warnings=reduction_warnings(figures)),
            sections_part(scene, responses, sizes, more),
            utilisation_part(scene, more),
            masses_part({name: body.model.masses for name, body in self.built.items()}),
            *parts_of_motion(scene, simulated, motions.reduced, natural, step),
        ]

    def results(self, motions: Motions) -> dict[str, BodyResult]:
        """Return shapes, recovered fields, stresses and envelopes of each body, by its name; on rank 0 alone.

        Fields, stresses and envelopes are those of `motions`; bodies that were not recovered have none.
        """
        results = {}
        for name, body in self.bodies.items():
            model, of = body.model, motions.recovered.get(name)
            shapes = Shapes(body.basis.sigma, model.output_positions, model.outputs) if name == ALONE else None
            fields = () if of is None else (of.reduced.fields, of.histories(), of.envelopes())
            results[name] = BodyResult(shapes, *fields)
        return results

    def _choose_models(self, scene: Scene) -> Choice | None:
        """Return models and step that meet the scene's tolerance or budget, the same on all ranks.

        None is returned if the scene has neither a tolerance nor a budget.
        """
        if scene.goal is None:
            return None
        models = {name: body.modal for name, body in self.bodies.items()}
        why: str | None = "the scene leaves it out"
        with self.clock.stage("search"):
            search = call_on_first_rank(self._comm, lambda: Search(scene, models))
            trial = self._comm.bcast(None if search is None else search.trial)
        if scene.goal.mesh:
            with self.clock.stage("other mesh"):
                try:
                    other = scene_on_other_mesh(scene, trial)
                    on_other = ComparedScene(other.scene, self._comm, self.caches.get(ALONE)).system.modal
                    call_on_first_rank(self._comm, lambda: search and search.compare_meshes(other, on_other))
                    why = None
                except (InputError, ConvergenceError) as error:  # mesh too coarse to be reduced: the run goes on
                    why = reason_of(error)
        with self.clock.stage("search"):
            choice: Choice = self._comm.bcast(call_on_first_rank(self._comm, lambda: search and search.choose(why)))
        return choice

    def _other_model(self) -> Any:
        """Return another reduced model from which a single body's error is estimated.

        None is returned if the body's own model can estimate its error, or if the other model can't be made.
        """
        if ALONE not in self.bodies or not (choice := self.scene.reduction).estimate:
            return None
        model = self.bodies[ALONE].model
        if reason_without_estimate({ALONE: model}) is None:
            return None
        other = Reduction(basis="free_modes", coordinates=max(FEWEST, model.size), solver=choice.solver)
        scene = self.scene.model_copy(update={"reduction": other})
        try:
            return cached_body(scene, self.built[ALONE].model, self.caches.get(ALONE)).model
        except (InputError, ConvergenceError):  # a small mesh has too few modes: the run goes on
            return None

    def _begin_estimate(self, simulated: SimulatedSystem | None, helper: Executor | None) -> Estimation:
        """Return a function with the error of the reduction, which a process of `helper` estimates if it can."""
        assert simulated is not None  # as on rank 0
        estimated = None if self.choice is None else self.choice.trial.estimate
        motion = replace(simulated, form=None)  # its kernel can't be sent to another process
        return begin_aside(helper, estimate_reduction, self.scene, motion, self._other, estimated)

    def _begin_full_frequencies(self, at: WayPoints, helper: Executor | None) -> Callable[[], Array]:
        """Return a function with the full system's f lowest frequencies (S, f) in Hz at the S positions `at`.

        Frequencies that other runs share are taken as they are.  Others are read from the caches; if these lack them,
        they are computed and stored there.  Without caches, a process of `helper` computes them, if it can.
        """
        if (shared := self.shared) is not None:
            return lambda: shared.frequencies
        c = self.excitation.amplitudes(list(self.excitation.terms), at.t)
        if not self.caches:
            return self.full.begin_frequencies(at.s, at.count, c, helper)
        contacts, solver = repr(self.full.system.contacts), self.scene.sections[0].reduction.solver
        content = {"bodies": [of.content for of in self.caches.values()], "contacts": contacts, "solver": solver}
        content |= {"s": at.s.tolist(), "count": at.count} | ({"c": c.tolist()} if c.size else {})
        cache = self.caches[self.scene.names[0]]
        stored = cache.arrays("frequencies", content, lambda: self.full.frequencies(at.s, at.count, c))
        return lambda: stored


_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class LoadedSection:
    """Section forces along a section, and forces of its pads, at S times."""

    states: SectionStates
    rings: list[LoadedRing]


def stress_at_pads(
    scene: Scene,
    built: Mapping[str, AssembledBody],
    recovered: Mapping[str, RecoveredBody],
    states: Mapping[str, BodyStates],
) -> dict[str, Any]:
    """Entries of ``budget.model`` on stress in the walls of beams at pads; collective.

    - ``wall_stress`` is the largest von Mises stress at the times of the `states`.  Its keys are ``value`` and its
      ``error`` by the meshes of the walls in Pa, ``t`` in s, ``position`` in m, ``section`` and ``region``, and, if the
      walls have a yield stress, ``yield`` in Pa.  ``even`` is the largest stress in Pa if the pressure of pads is even;
      it may be at other pads.  ``even_error`` is its error in Pa.
    - ``wall_stress_missing`` has, by the name of a section with pads, the reason why its walls are not looked at.
    - ``pad_yield`` has the force of each pad of a joint at which walls begin to yield, by the name of the pad: a
      `pmr.fullmodel.wall_stress.YieldForce` as a dict.

    Entries without content are left out.  `states` are those of the reduced bodies, the same on every rank; `recovered`
    was recorded from them.
    """
    from pmr.fullmodel.wall_stress import wall_peak, yield_forces  # FEniCSx, which given matrices do without

    peaks: dict[str, WallPeak] = {}
    missing = dict[str, str]()
    comm = next(iter(built.values())).model.comm
    for name, member in zip(scene.names, members(scene), strict=True):
        part, body = member.part, built[name]
        if part.body.box is None or not (body.structure.pads.fixed or body.structure.pads.moving):
            continue
        if not traits_of(member).is_beam:
            missing[name] = "it is no beam: its stress is that of its own cells"
        elif not part.has_even_walls:
            missing[name] = "its walls change along it, or have frames or plates of their own"
        else:
            loaded = _loaded_section(body, recovered[name], states[name])
            try:
                peak = comm.bcast(call_on_first_rank(comm, lambda: wall_peak(part, loaded.states, loaded.rings)))  # noqa: B023
            except UNNEEDED as error:
                missing[name] = reason_of(error)
                continue
            peaks |= {} if peak is None else {name: peak}
    entries: dict[str, Any] = {"wall_stress_missing": missing} if missing else {}
    if peaks:
        name = max(peaks, key=lambda name: peaks[name].stress.middle.value)
        entry = _peak_entry(name, scene.bodies[name], peaks[name], float(states[name].t[peaks[name].state]))
        even = max(peak.stress.even for peak in peaks.values())
        entries["wall_stress"] = entry | {"even": even.value, "even_error": even.error}
    try:
        forces = comm.bcast(call_on_first_rank(comm, lambda: yield_forces(scene))) if len(scene.sections) > 1 else {}
    except UNNEEDED as error:
        _log.warning("the force at which walls yield under pads is not known: %s", error)
        forces = {}
    return entries | ({"pad_yield": {name: asdict(force) for name, force in forces.items()}} if forces else {})


def _peak_entry(name: str, part: BoomSection, peak: WallPeak, t: float) -> dict[str, Any]:
    """Return the entry ``wall_stress`` for `peak`, the largest stress of the body `name`, at the time t in s.

    The entry has ``value`` and ``error`` in Pa, ``t``, ``position`` in m, the name of the body as ``section``, the wall
    as ``region``, and, if the material has a yield stress, ``yield`` in Pa.
    """
    box, material = part.body.box, part.body.material
    assert box is not None
    flat = [side for side in box.sides if side.centre is None]
    off_mid = {side.name: abs(float((peak.position[1:] - side.start) @ side.normal)) for side in flat}
    off_face = {side.name: abs(off_mid[side.name] - side.thickness / 2.0) for side in flat}  # at an edge not the same
    entry = {
        "value": peak.stress.middle.value,
        "error": peak.stress.middle.error,
        "t": t,
        "position": peak.position.tolist(),
        "section": name,
        "region": min(off_face, key=lambda name: off_face[name]),
    }
    allowed = None if material is None else material.yield_stress
    return entry | ({} if allowed is None else {"yield": allowed})


def _loaded_section(body: AssembledBody, recovered: RecoveredBody, states: BodyStates) -> LoadedSection:
    """Return the section forces of a beam and the forces of its pads, at the times of its `states`; collective.

    `recovered` has the objects that compute full coordinates and section forces of the beam.
    """
    from pmr.fullmodel.wall_stress import SectionStates

    along, recovery = recovered.forces, recovered.recovery
    assert along is not None and recovery is not None  # as of every beam with a profile
    q = np.concatenate([np.hstack(body.model.comm.allgather(block)) for block in recovery.blocks(states)])
    values, names = along.evaluate(q, states), np.array(along.names)
    x = np.unique(along.x.round(9))
    forces = np.zeros((len(q), len(FORCES), len(x)))
    for number, name in enumerate(FORCES):
        if np.any(of := names == name):
            forces[:, number] = mean_by_place(along.x[of], values[:, of])[1]
    return LoadedSection(SectionStates(x, forces), _loaded_rings(body, states, q))


def _loaded_rings(body: AssembledBody, states: BodyStates, q: Array) -> list[LoadedRing]:
    """Return the pads of a body in rings, with the places and the forces of each ring in the S `states`.

    Pads of one size that are at the same place along the body in all states form a ring.  q (S, n) are the full
    coordinates, from which the forces of springs follow.
    """
    from pmr.fullmodel.wall_stress import LoadedRing

    pads, structure = body.structure.pads, body.structure
    rings = dict[bytes, list[tuple[Pad, Array, Array]]]()

    def add(pad: Pad, x: Array, force: Array) -> None:
        """Add a pad at x (S,) in m along the body, with its forces (S,) in N, to the ring of pads that are there."""
        size = np.array([pad.length, pad.width])
        rings.setdefault(np.concatenate([x, size]).round(6).tobytes(), []).append((pad, x, force))

    by_name = {pad.name: (pad, moves) for moves, some in ((0.0, pads.fixed), (1.0, pads.moving)) for pad in some}
    for name, s, force in zip(states.rows, states.s.T, states.multipliers.T, strict=True):
        if name in by_name:
            pad, moves = by_name[name]
            add(pad, pad.at + moves * s, force)
    T, without_row = couple(structure).T, tuple(pad for pad in pads.fixed if pad.name not in states.rows)
    restraints = restrain(Pads(fixed=without_row, travel=pads.travel, walls=pads.walls), structure.model, T)
    for row in restraints.springs:
        pad = by_name[row.name][0]
        add(pad, np.full(len(q), pad.at), np.asarray(q @ restraints.force(row.name, T.shape[1]).toarray()[0]))
    return [
        LoadedRing(tuple(pad for pad, _, _ in ring), ring[0][1], np.stack([force for _, _, force in ring], axis=1))
        for ring in rings.values()
    ]
