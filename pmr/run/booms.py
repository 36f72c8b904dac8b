"""The same for a boom of several sections: each is reduced by itself, then all are simulated as one system."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.accuracy import booms as order
from pmr.compare import booms as compared
from pmr.compare import errors, pad_forces
from pmr.compare.boom_estimate import BoomError, boom_error
from pmr.compare.boom_friction import with_friction
from pmr.compare.boom_map import frequency_map
from pmr.compare.boom_references import FullBoom, FullRun
from pmr.compare.boom_simulations import BoomSimulations, simulate
from pmr.compare.responses import check_installed
from pmr.compare.summary import Part, driven, gathered, made_with, trusted
from pmr.compare.trust import large_motion
from pmr.environment import Clock
from pmr.errors import on_first
from pmr.fem.compat import MPI
from pmr.fem.compat import versions as fenicsx_versions
from pmr.fullmodel import probes
from pmr.fullmodel.build import warnings as build_warnings
from pmr.fullmodel.sections import build_sections
from pmr.recover.from_scene import Recovered, recovered_steps
from pmr.recover.sections import recover_sections, states_of
from pmr.reduce.cache import Cache, cache_in
from pmr.reduce.sections import ReducedSection, reduce_sections
from pmr.reduced.model import ReducedModel
from pmr.results import BoomFrequencies, BoomResult, Response
from pmr.scene import Boom
from pmr.simulate import contact_step
from pmr.simulate.booms import excitation_of, system_of
from pmr.simulate.native.multibody_march import contact_frequency, places
from pmr.simulate.petsc import Checkpoint

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BoomOutcome:
    """What a run of a boom returns on rank 0: its result, and the reduced model of each section."""

    result: BoomResult
    reduced: Mapping[str, ReducedModel]


def run_boom(
    boom: Boom,
    comm: MPI.Comm = MPI.COMM_WORLD,
    clock: Clock | None = None,
    checkpoint: Checkpoint | None = None,
    cache: Path | None = None,
) -> BoomOutcome | None:
    """Run a boom on `comm`; what is not distributed runs on rank 0, the other ranks get None.

    With a `checkpoint` a full-order simulation that was cut off goes on.  In a `cache`, a folder, reductions of the
    sections and frequencies of full models are cached and found.

    Raises
    ------
    InputError
        If the boom asks for what cannot be had; its source is ``"scene"``.
    ConvergenceError, SimulationError
        If a solver fails.
    """
    check_installed(boom)
    clock = clock or Clock()
    with clock.stage("assemble"):
        built = build_sections(boom, comm)
    with clock.stage("reduce"):
        caches = {} if cache is None else {name: cache_in(cache, one.model) for name, one in built.items()}
        sections = reduce_sections(boom, built, caches)
    choice = _chosen(boom, sections, comm, clock)
    if choice is not None:
        sections = {name: replace(one, model=choice.models[name]) for name, one in sections.items()}
    reduced = {name: one.model for name, one in sections.items()}
    system = system_of(boom, reduced)
    excitation = excitation_of(boom, system)
    x, omega = places(system, excitation), contact_frequency(system, excitation)
    full = FullBoom.of(boom, built) if "full" in boom.compare.against else None
    with clock.stage("frequencies"):
        large = full is not None and full.simulator == "petsc"
        steps = compared.on_the_way(boom, excitation.times, compared.FEWER_PLACES if large else compared.PLACES)
        curves = {} if full is None else {"full": _full_frequencies(boom, full, excitation.s[steps], steps, caches)}
    whole, recovered = FullRun(None, "", {}), recovered_steps(boom)
    states, made = None, excitation.stepping
    simulations = on_first(comm, lambda: simulate(boom, system, excitation, clock))
    if simulations is not None:
        states = states_of(system, simulations.first, recovered)
        made = contact_step.as_made(made, simulations.first.parts, omega)
    made = comm.bcast(made)
    if full is not None:
        whole = full.simulate(boom, made, recovered, clock, checkpoint)
    responses: dict[str, Response] = {} if whole.response is None else {"full": whole.response}
    if simulations is not None:
        responses |= {"reduced": simulations.response}
    seen = dict[str, Recovered]()
    if boom.recovery is not None:
        with clock.stage("recover"):
            states = comm.bcast(states)
            assert states is not None
            seen = recover_sections(boom, built, sections, states, {} if whole.missing else whole.states)
    if simulations is None:
        return None
    responses = {name: with_friction(boom, system.contacts, one) for name, one in responses.items()}
    curves |= {"reduced": compared.frequencies(system, x[steps])}
    error = boom_error(boom, system, excitation.with_stepping(made), simulations.first, clock)
    at, over_joints = boom.reach(excitation.times[steps]), frequency_map(boom, system)
    frequencies = BoomFrequencies(at, excitation.s[steps], curves, over_joints)
    sizes = {name: {"full": built[name].model.size, "reduced": body.size} for name, body in reduced.items()}
    common = compared.with_forces_of_both(responses)
    measured = compared.quantities(boom, responses["reduced"])
    reference = responses.get("full", responses["reduced"]).displacement
    off = np.abs(responses["reduced"].displacement - reference).max() if "full" in responses else None
    parts = [
        made_with(boom, fenicsx_versions()),
        Part({"coordinates": {kind: sum(size[kind] for size in sizes.values()) for kind in ("full", "reduced")}}),
        Part({"basis": {"kind": "free modes of every section, with residual flexibility"}}),
        Part(
            {
                "errors": errors.errors(common, quantities=measured),
                "absolute_errors": errors.errors(common, errors.absolute_error, quantities=measured),
                "max_displacement": float(np.abs(reference).max()),
                "max_error": None if off is None else float(off),
                "simulators": {"reduced": boom.simulation.simulators[0]}
                | ({"full": full.simulator} if full and "full" in responses else {}),
                "agreement": dict(simulations.agreement),
            }
        ),
        _seconds(clock, simulations, responses),
        error.part,
        Part() if choice is None else Part(order.summary(boom, choice), order.warnings(boom, choice)),
        compared.sections(boom, responses, sizes, _more(seen, error)),
        compared.joints(boom, responses["reduced"], system.contacts),
        Part(pad_forces.reactions(responses["reduced"], boom.reach(excitation.times))),
        compared.beside_published(boom, frequencies),
        Part(probes.places({name: one.structure.outputs for name, one in built.items()})),
        driven(excitation),
        Part(contact_step.summary_of(omega, made), contact_step.warnings_of(omega, excitation.stepping)),
        trusted({"full": whole.missing} if whole.missing else {}, responses),
        *(Part(warnings=build_warnings(one.structure)) for one in {id(one): one for one in built.values()}.values()),
        Part(warnings=large_motion(float(boom.reach(excitation.times).max()), responses.values())),
    ]
    loads = excitation.forces(system.input_names)
    result = BoomResult(
        boom,
        gathered(parts),
        responses,
        excitation.s,
        boom.reach(excitation.times),
        loads,
        frequencies,
        {name: one.reduced.fields for name, one in seen.items()},
    )
    return BoomOutcome(result, reduced)


def _chosen(
    boom: Boom, sections: Mapping[str, ReducedSection], comm: MPI.Comm, clock: Clock
) -> order.BoomChoice | None:
    """Coordinates for the boom's tolerance or within its budget, if it has one; the same on every rank."""
    if boom.ordered is None:
        return None
    models = {name: one.model for name, one in sections.items()}
    with clock.stage("search"):
        found = on_first(comm, lambda: order.choose(boom, models, excitation_of(boom, system_of(boom, models))))
        choice: order.BoomChoice = comm.bcast(found)
    return choice


def _full_frequencies(
    boom: Boom, full: FullBoom, extensions: Array, steps: NDArray[np.int64], caches: Mapping[str, Cache]
) -> Array:
    """At some steps, which have these extensions (S, P) in m."""
    if not caches:
        return full.frequencies(boom, steps)
    content = [one.content for one in caches.values()]
    asked = {"sections": content, "contacts": repr(full.whole.contacts), "extensions": extensions.tolist()}
    return caches[boom.names[0]].arrays("frequencies", asked, lambda: full.frequencies(boom, steps))


def _more(seen: Mapping[str, Recovered], error: BoomError) -> dict[str, dict[str, Any]]:
    """What else is known of sections: the estimate along each, and its stresses."""
    estimated: dict[str, dict[str, Any]] = {name: {"estimate": size} for name, size in error.sections.items()}
    return {
        name: estimated.get(name, {}) | (seen[name].summary() if name in seen else {}) for name in {**estimated, **seen}
    }


def _seconds(clock: Clock, simulations: BoomSimulations, responses: Mapping[str, Response]) -> Part:
    stages = {
        name: clock.seconds[name] for name in ("assemble", "reduce", "recover", "estimate") if name in clock.seconds
    }
    simulated = dict(simulations.seconds)
    if "full" in responses:
        simulated["full"] = responses["full"].seconds
    return Part({"seconds": {**stages, "simulate": simulated}})
