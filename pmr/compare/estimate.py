r"""Estimate the error of a reduced model without a full model.

The error comes from inertia and damping of the truncated modes.  A second run has more coordinates: the first truncated
modes (enrichment modes), and attachment modes (`pmr.system.attachment`).  These add inertia and damping of all further
modes, in the directions of all loads that acted on a body in the first run:

.. math:: \text{estimate} = 1.25 \lVert y_{\text{second}} - y_r \rVert

with the outputs y_r of the reduced model and y_second of the second run.  The factor 1.25 is a margin: without it, the
estimate was 0.98 to 1.2 times the true error in random scenes, damped and not, with one slider, two sliders and twelve
pads (tests/compare/test_estimate.py).  The estimate is no bound (docs/moving_residual_flexibility.md,
section 12); `pmr.compare.trust` names the cases in which it was seen to fail.  If pads land and lift off, an impact
that comes a moment earlier changes the whole motion after it.  Then a third run, without the enrichment modes, has to
be close to the second one.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pmr.compare.errors import ROUND_OFF, errors_between, force_errors, force_histories, relative_error
from pmr.compare.evaluation import SimulatedSystem
from pmr.compare.motion import Models, carried_loads, only_body_motion, reason_without_estimate
from pmr.compare.outputs import (
    OUTPUT_KINDS,
    Outputs,
    RoundOffBounds,
    boom_quantities,
    differences,
    divide_steps,
    has_impulsive_force,
    lifts_off,
    probe_differences,
    run_from_start,
)
from pmr.compare.trust import (
    LOAD_JUMPS,
    ROWS_LEFT_OUT,
    SLIDER_IMPACTS,
    SLIDER_RINGING,
    has_damped_jump,
    is_ringing,
)
from pmr.errors import GrowthError, SimulationError
from pmr.files.arrays import Array
from pmr.results.quantities import UNSETTLED_KINDS, with_unit
from pmr.scene.keys import ALONE
from pmr.simulation import Excitation
from pmr.simulation.reactions import outputs_of
from pmr.system.attachment import LEFT_OUT, with_attachment_modes
from pmr.system.body import Trajectory, length_outputs
from pmr.system.polynomials import evaluate, select_columns
from pmr.system.reduced_model import ReducedModel
from pmr.system.system import System
from pmr.system.truncation import extend

#: Factor by which estimates multiply the difference to a richer model.
MARGIN = 1.25
#: Share of inertia that attachment modes leave out if the motion grows with the share `LEFT_OUT`: under rigid contacts
#: the flexibility that remains is round-off, which may have the wrong sign.
MORE_LEFT_OUT = 1e-5


@dataclass(frozen=True)
class Estimate:
    """Estimated errors of the outputs of reduced bodies, with margin.

    Fractions are relative to the motion of the richer model (`pmr.compare.errors.relative_error`).  `by` is the method:
    ``attachment`` modes, or an ``other model``.
    """

    #: Fractions by kind of output (`pmr.compare.outputs`), without `unknown` kinds, and by name of a probe or reaction
    errors: Mapping[str, float]
    probes: Mapping[str, float]  # fractions by name of the probe (`probe_differences`)
    error: Array  # (T, o) m: error of the displacements as far as these runs show it, without margin
    seconds: float  # wall time of the estimate, all runs included
    by: str
    enrichment: int | None = None  # number of modes that the second run has more, for each body; None: all
    chi: float | None = None  # share of the first truncated mode's motion that is not quasi-static
    bodies: Mapping[str, float] = field(default_factory=dict)  # error along each body by name, with margin
    unknown: Mapping[str, str] = field(default_factory=dict)  # reasons, in words, for kinds without an estimate
    scatter: str = ""  # sentence about peak forces that are not settled (`describe_scatter`), else empty

    def error_of(self, kind: str) -> float:
        """Error of one kind of output, such as ``beam``, a fraction with margin; 0 if it has no estimate."""
        return self.errors.get(kind, 0.0)

    @property
    def largest(self) -> float:
        """Estimated largest error of any displacement at any time in m, with margin."""
        return float(MARGIN * np.abs(self.error).max())


@dataclass(frozen=True)
class _RicherSimulation:
    """Simulation of a richer model, that is, one with enrichment and attachment modes."""

    simulation: SimulatedSystem
    enrichment: int  # largest number of additional modes of a body
    unsettled: Collection[str] = ()  # kinds of outputs in which two richer models disagree
    scatter: str = ""  # as in `Estimate`


def estimate_error(models: Models, first: SimulatedSystem) -> Estimate:
    """Estimate the error of a system of reduced bodies by a second run with enrichment modes and attachment modes.

    `models` are the reduced bodies by name, on their modes alone; the bodies of the system in the run `first` have
    further coordinates if there are cylinders (`pmr.system.attachment`).  The second run divides each step into the
    same parts as the first.  If pads lift off, a third run without enrichment modes shows for which kinds of outputs
    richer models disagree; these kinds have no estimate.  The errors of the result are fractions with margin; its
    history `error` is the plain difference between the displacements of the second run and those of the first.

    Raises ValueError if there is no estimate (`reason_without_estimate`); InputError or SimulationError as for
    `pmr.simulation.SystemSimulator`; SimulationError too if the two richer models disagree on the motion after an
    impact.
    """
    begin = time.perf_counter()
    if why := reason_without_estimate(models):
        raise ValueError(f"no estimate: {why}")
    system, excitation, outputs = first.system, first.excitation, first.outputs
    floors = RoundOffBounds.for_system(system, excitation, first.run.forces)
    richer = _simulate_richer(models, first, floors)
    better, indicator = richer.simulation.outputs, None
    unknown = {kind: UNSETTLED_KINDS[kind] for kind in richer.unsettled}
    for model in [models[ALONE]] if ALONE in models else []:
        if why := _reason_without_forces(model, excitation, outputs, better):
            unknown.setdefault("pad_force", why)
        body, motion = only_body_motion(richer.simulation.system, richer.simulation.run, excitation)
        indicator = chi(body, motion, richer.simulation.run.loads, model.size)
    without = {"probe", *(() if outputs.force.size else ("pad_force",))}
    kinds = [kind for kind in dict.fromkeys((*OUTPUT_KINDS, *outputs.kinds)) if kind not in without]
    responses = {"reduced": first.response, "full": richer.simulation.response}
    errors = errors_between(responses, boom_quantities(excitation, first.response))["reduced_vs_full"]
    errors |= differences(outputs, better, floors, kinds)
    if "pad_force" not in unknown or "pad_force" in richer.unsettled:  # supports bear what pads and sliders press
        errors |= _reaction_error(first, richer.simulation)
    of_probes = probe_differences(outputs, better, floors)
    errors |= {"probe": float(of_probes.max())} if len(of_probes) else {}
    probes = dict(zip(_probes(system), (MARGIN * of_probes).tolist(), strict=True))
    error = better.displacement - outputs.displacement
    return Estimate(
        errors={
            name: MARGIN * size for name, size in errors.items() if name.removesuffix("_between_kinks") not in unknown
        },
        probes={} if "probe" in unknown else probes,
        error=error,
        seconds=time.perf_counter() - begin,
        by="attachment",
        enrichment=richer.enrichment,
        chi=indicator,
        bodies=_errors_by_section(system, outputs.displacement, better.displacement),
        unknown=unknown,
        scatter=richer.scatter,
    )


def _reaction_error(run: SimulatedSystem, richer: SimulatedSystem) -> dict[str, float]:
    """Error of all reactions of rigid supports of a `run`, a fraction without margin, as ``{"reaction": ...}``.

    The reference is the run of the `richer` model.  The result is empty if one of both has no reactions, or if all of
    them are round-off.
    """
    errors = force_errors(*(force_histories(of.response) for of in (run, richer)))
    return {kind: size for kind, size in errors.items() if kind == "reaction"}


def _reason_without_forces(model: ReducedModel, excitation: Excitation, of_run: Outputs, richer: Outputs) -> str | None:
    """Reason, in words, why forces of sliders and pads of a single body have no estimate; None if they have one.

    `of_run` are the outputs of the model, `richer` those of the richer model.
    """
    if has_impulsive_force(model, excitation):
        return SLIDER_IMPACTS
    if model.moving and has_damped_jump(model, replace(excitation, hoist={}).signals, excitation.stepping.end):
        return LOAD_JUMPS
    return SLIDER_RINGING if of_run.force.size and is_ringing(of_run.force, richer.force) else None


def _simulate_richer(models: Models, first: SimulatedSystem, floors: RoundOffBounds) -> _RicherSimulation:
    """Simulate a model that is richer than that of the run `first`: it has enrichment and attachment modes.

    The attachment modes are responses to the contact forces and loads of the first run.  Both runs divide each step
    into the same parts.  `floors` are bounds of round-off.  If the motion grows, the richer model gets fewer attachment
    modes, then half its enrichment modes, and so on; a GrowthError is raised if the motion grows with all of these
    models.  If pads lift off in the first run, a third run without enrichment modes shows in which kinds of outputs
    richer models disagree; an UnsettledError is raised if they disagree in displacements.
    """
    excitation = first.excitation
    if not excitation.stepping.schedule:
        excitation = divide_steps(first.system, excitation, first.run)
    loads = carried_loads(first.system, first.run)

    count = max(0 if model.enrichment is None else model.enrichment.count for model in models.values())
    left_out = LEFT_OUT

    def richer(count: int) -> SimulatedSystem:
        """Simulate models with up to `count` enrichment modes of each body."""
        enriched = {name: _with_enrichment(model, count) for name, model in models.items()}
        bodies = {name: with_attachment_modes(model, loads[name], left_out) for name, model in enriched.items()}
        system = first.system.with_bodies(bodies)
        return SimulatedSystem(system, excitation, run_from_start(system, excitation))

    while True:
        try:
            better = richer(count)
            break
        except GrowthError:
            if left_out == MORE_LEFT_OUT and count <= 1:
                raise
            if left_out == MORE_LEFT_OUT:  # a step without numerical damping is too long for so many modes
                count //= 2
            left_out = MORE_LEFT_OUT
    pushing = ~np.isnan(first.system.clearance)
    if not lifts_off(first.run.forces[:, pushing]):
        return _RicherSimulation(better, count)
    other = richer(0)
    kinds = tuple(dict.fromkeys((*OUTPUT_KINDS, *first.outputs.kinds)))
    errors_of_first, apart = (differences(run.outputs, better.outputs, floors, kinds) for run in (first, other))
    if reaction := _reaction_error(first, better):
        kinds, errors_of_first = (*kinds, "reaction"), dict(errors_of_first) | reaction
        apart = dict(apart) | _reaction_error(other, better)
    unknown = [kind for kind in kinds if not are_settled(errors_of_first[kind], apart[kind])]
    if "pad_force" not in unknown:  # pad forces balance all other forces
        unknown = [kind for kind in unknown if kind in OUTPUT_KINDS]
    peaks = [float(richer_run.run.forces[:, pushing].max()) for richer_run in (first, better, other)]
    # If they disagree on forces, their difference in displacements has to be within the margin of the estimate.
    stricter = SETTLED / (MARGIN - 1.0) if "pad_force" in unknown else 1.0
    for kind in ("beam", "tip"):
        if not are_settled(errors_of_first[kind], stricter * apart[kind]):
            raise UnsettledError(errors_of_first[kind], apart[kind], peaks)
    scatter_text = describe_scatter(peaks) if "pad_force" in unknown else ""
    return _RicherSimulation(better, count, unknown, scatter_text)


def _with_enrichment(model: ReducedModel, count: int) -> ReducedModel:
    """The model with its first `count` enrichment modes as coordinates, or with all if it has fewer than `count`."""
    most = 0 if model.enrichment is None else model.enrichment.count
    return extend(model, min(count, most)) if min(count, most) else model


def _errors_by_section(system: System, displacement: Array, better: Array) -> dict[str, float]:
    """Error along each body, a fraction with margin, by the body's name; a single body gives an empty dict.

    `displacement` (T, o) in m are the displacements of all bodies, `better` (T, o) in m those of a richer model.
    """
    first, errors = 0, dict[str, float]()
    for name, body in system.bodies.items() if len(system.bodies) > 1 else ():
        columns = slice(first, first := first + int(np.count_nonzero(length_outputs(body))))
        errors[name] = MARGIN * relative_error(displacement[:, columns], better[:, columns])
    return errors


def _probes(system: System) -> list[str]:
    """Names of all bodies' outputs that are neither displacements nor forces, in the order of `Outputs.probe`."""
    return [output.name for output in outputs_of(system) if not (output.is_displacement or output.is_force)]


def estimate_by_other_model(system: System, reference: ReducedModel, excitation: Excitation) -> Estimate:
    r"""Estimate the error of a single body on any basis, by another model of this body whose error can be estimated.

    .. math:: \lVert y - y_r \rVert \le \lVert y_b - y_r \rVert + \lVert y - y_b \rVert

    with the exact outputs y, the outputs y_r of `system`, and y_b those of `reference`, a model on free modes
    with residual flexibility; the estimate for `reference` stands for the last term.  Both are simulated here.  Contact
    forces that only one of both models has are not compared; they are named in `Estimate.unknown`.  Raises ValueError,
    InputError and SimulationError as `estimate_error` of the other model does.
    """
    begin = time.perf_counter()
    terms = () if system.terms_of is None else system.terms_of({ALONE: reference})
    systems = [system, replace(System.of(reference), terms=terms)]
    runs = [SimulatedSystem(of, excitation) for of in systems]
    of_better = estimate_error({ALONE: reference}, runs[1])
    # a force is missing in a run if the basis does not move the row of its contact: such rows are left out of a model
    names = [run.response.force_names for run in runs]
    common = [name for name in names[1] if name in names[0]]
    lacking = [name for name in dict.fromkeys(sum(names, ())) if name not in common]
    of_model, other = (
        replace(run.outputs, force=run.outputs.force[:, [force_names.index(name) for name in common]], forces=())
        for run, force_names in zip(runs, names, strict=True)
    )
    floors, errors_of_better = RoundOffBounds.for_system(systems[1], excitation), dict(of_better.errors)
    apart = differences(of_model, other, floors)
    of_probes = dict(zip(_probes(systems[0]), probe_differences(of_model, other, floors).tolist(), strict=True))
    left_out = {"left out": ROWS_LEFT_OUT.format(", ".join(lacking))} if lacking else {}
    return Estimate(
        errors={kind: apart[kind] + size for kind, size in errors_of_better.items() if kind in apart},
        probes={name: of_probes[name] + size for name, size in of_better.probes.items()},
        error=other.displacement - of_model.displacement + of_better.error,
        seconds=time.perf_counter() - begin,
        by="other model",
        unknown=dict(of_better.unknown) | left_out,
    )


def chi(body: ReducedModel, run: Trajectory, f: Array, mode: int) -> float:
    r"""Share of a mode's motion that is not quasi-static, in a `run` of a body on modes under loads f (T, i) in N.

    .. math::
        \chi = \frac{\mathrm{rms}(\eta - \varphi^T g / \omega^2)}{\mathrm{rms}(\eta)}, \quad
        \eta = q_k, \quad \varphi^T g = (B f - C(s)^T \lambda)_k, \quad \omega^2 = K_{kk}

    with k = `mode`, counted from 0, which is usually the first truncated mode, and coordinates q, contact rows C,
    multipliers :math:`\lambda` and path coordinate s of the run (docs/moving_residual_flexibility.md, sections 10 and
    12).

    The result is 0 if the mode moves by round-off only, as torsion does under loads in a plane of symmetry.
    """
    rows = evaluate(select_columns(body.rows, [mode]), run.s)[:, :, 0]
    force = f @ body.B[mode] - np.einsum("tm,tm->t", rows, run.multipliers)
    motion, most = run.q[:, mode], float(np.abs(run.q).max(initial=0.0))
    moves = float(np.abs(motion).max(initial=0.0)) > ROUND_OFF * most
    return relative_error(force / body.K[mode, mode], motion) if moves else 0.0


#: Largest difference between two richer models, over the error, if pads lift off.
SETTLED = 0.5


def are_settled(error: float, difference: float) -> bool:
    """Whether two richer models differ little enough for an estimate of the error.

    `error` is the error to be estimated, and `difference` that between the two richer models; both are fractions.  The
    result is true if the difference is at most `SETTLED` times the error, or if the error is round-off.
    """
    return difference <= SETTLED * error or error <= ROUND_OFF


def describe_scatter(peaks: Sequence[float]) -> str:
    """Sentence on the largest forces of pads that land and lift off, by several models that are nearly equal.

    `peaks` has the largest force in N of each model.  The sentence is empty if the smallest and the largest peak agree
    to three digits.
    """
    least, most = (with_unit(find(peaks), "N") for find in (min, max))
    if least == most:
        return ""
    return (
        f"pads lift off and close again many times, and their peak forces scatter: {least} to {most} with models that "
        "are nearly alike, and as much with another time step; they are a range, not a figure"
    )


class UnsettledError(SimulationError):
    """Error for a run whose error can't be estimated, since two richer models differ too much.

    `error` is the relative error that was to be estimated, and `difference` the relative difference between the two
    richer models, both as fractions of 1.  `peaks` are the largest pad forces in N, one for each model; the attribute
    `warning` is their `describe_scatter`.
    """

    def __init__(self, error: float, difference: float, peaks: Sequence[float]) -> None:
        """Compose the message from two relative errors, as fractions of 1, and the warning from pad forces in N.

        `error` was to be estimated, `difference` is that between two richer models, and `peaks` are the largest forces
        of pads with each model.
        """
        super().__init__(
            "pads lift off and close again, and the motion depends on the exact time of impacts: two richer models "
            f"differ by {100.0 * difference:.2g} %, and the error to estimate is {100.0 * error:.2g} %"
        )
        self.warning = describe_scatter(peaks)
