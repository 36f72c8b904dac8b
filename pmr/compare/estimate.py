r"""How far a reduced model is off, without a full one.

The error is what inertia and damping of the truncated modes make of the motion.  A second run has more coordinates: the
first modes left out, the enrichment modes, and attachment modes (`pmr.reduced.attachment`), which give the rest its
inertia and damping in the directions of all loads that a body bore in the first run:

.. math:: \text{estimate} = 1.25 \lVert y_{\text{second}} - y_r \rVert

1.25 is a margin: without it the estimate was 0.98 to 1.2 times the true error in random scenes, damped and not, with
one slider, two sliders and twelve pads (tests/compare/test_estimate_kinds_sweep.py).  It is no bound
(docs/moving_residual_flexibility.md, section 12); `pmr.compare.coverage` says where it can be seen to fail.  Where pads
land and lift off an impact a moment earlier changes all that follows: a third run, without the enrichment modes, has to
be near the second one then.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pmr.compare import coverage
from pmr.compare import errors as compare
from pmr.compare.attached import SETTLED, UnsettledError, lifts_off, loads_carried, scatter, settled
from pmr.compare.booms import quantities
from pmr.compare.evaluation import respond
from pmr.compare.indicators import chi
from pmr.compare.outputs import KINDS, Floors, Outputs, differences, impulsive, probe_differences
from pmr.compare.ringing import rings
from pmr.compare.runs import along_path, in_parts, outputs_of_response, run_from_start
from pmr.errors import GrowthError
from pmr.reduced.attachment import LEFT_OUT, with_attachment_modes
from pmr.reduced.model import ReducedModel
from pmr.reduced.truncation import extend, is_modal
from pmr.results import Response
from pmr.simulation import Excitation
from pmr.simulation.reactions import column_names
from pmr.system.body import length_outputs
from pmr.system.contacts import ALONE, named
from pmr.system.states import SystemTrajectory
from pmr.system.system import System

Array = NDArray[np.float64]
Models = Mapping[str, ReducedModel]

#: Margin of the estimate over what the enrichment modes say, and of errors that all modes of a reduction tell.
MARGIN, MARGIN_OF_ALL_MODES = 1.25, 1.1
#: Share of inertia that attachment modes leave out where those that leave out less make the motion grow: under rigid
#: contacts they leave no flexibility but round-off, which may push the wrong way.
MORE_LEFT_OUT = 1e-5


@dataclass(frozen=True)
class Estimate:
    """Estimated errors of the outputs of reduced bodies, with margin.

    Fractions are e_NRMS relative to the second run's motion, not capped: above 1 the error is larger than the motion.
    `by` says what with: ``attachment`` modes, or an ``other model``.
    """

    errors: Mapping[str, float]  # by kind of output (`pmr.compare.outputs`), without those that are `unknown`
    probes: Mapping[str, float]  # of each output in another unit, by name (`probe_differences`)
    error: Array  # (T, o) m: what is missing in the displacements, as far as these runs know, without margin
    tips: tuple[int, ...]  # numbers of the displacements that are the tip's
    seconds: float  # wall time of the estimate, all runs included
    by: str
    enrichment: int | None = None  # modes of each body that the second run has more; None: all that models keep
    chi: float | None = None  # share of the first truncated mode's motion that is not quasi-static
    bodies: Mapping[str, float] = field(default_factory=dict)  # along each of several bodies
    unknown: Mapping[str, str] = field(default_factory=dict)  # kinds without an estimate, and why, in words
    scatter: str = ""  # what is to be said of peak forces where these are not settled

    def of(self, kind: str) -> float:
        """Error of one kind of output, with margin; 0 where it is unknown."""
        return self.errors.get(kind, 0.0)

    @property
    def beam(self) -> float:
        """That over all displacements."""
        return self.of("beam")

    @property
    def tip(self) -> float:
        """Error of the tip."""
        return self.of("tip")

    @property
    def largest(self) -> float:
        """Estimated largest error of any output at any time in m, with margin."""
        return float(MARGIN * np.abs(self.error).max())


def no_estimate(models: Models) -> str | None:
    """Why errors of bodies with these models can't be estimated, in words; None where they can."""
    return next((f"{name}: {why}" if name else why for name, model in models.items() if (why := _defect(model))), None)


def _defect(model: ReducedModel) -> str | None:
    if model.flexibility is None:
        return (
            "without residual flexibility the static deformation of the modes that are left out is missing, and the "
            "model does not say how large it is"
        )
    if not is_modal(model):
        return (
            "the basis is not one of eigenmodes: what it leaves out may have low frequencies and is coupled to the "
            "coordinates by inertia"
        )
    if model.enrichment is None or model.carriers is None or model.carriers.inertia is None:
        return "the model keeps no enrichment modes: they come with reduction.estimate = true, on a mesh that has more"
    return None


@dataclass(frozen=True)
class _Simulated:
    """Bodies, their motion, and what they say in it."""

    system: System
    run: SystemTrajectory
    response: Response
    outputs: Outputs

    @classmethod
    def of(
        cls,
        system: System,
        excitation: Excitation,
        run: SystemTrajectory | None = None,
        response: Response | None = None,
    ) -> _Simulated:
        run = run or run_from_start(system, excitation)
        response = response or respond(system, run)
        return cls(system, run, response, outputs_of_response(system, run, excitation, response))


@dataclass(frozen=True)
class _Difference:
    """Motion of a richer model beyond a model; its run; kinds of outputs on which two of them disagree."""

    missing: Outputs
    better: _Simulated
    enrichment: int  # modes of each body that it has more, at most
    named: Mapping[str, float] = field(default_factory=dict)  # errors of what is no kind, by name, without margin
    unsettled: Collection[str] = ()
    scatter: str = ""


def estimate(
    models: Models,
    system: System,
    excitation: Excitation,
    run: SystemTrajectory | None = None,
    response: Response | None = None,
) -> Estimate:
    """Estimate the error of a system of bodies whose `models` on their modes are given, with their enrichment modes.

    The system has more where cylinders do (`pmr.reduced.attachment`).  Its `run`, and what it says in it, are found
    here unless they are given; one or two others are, in the parts of a step that it took.  Raises ValueError if there
    is no estimate (`no_estimate`); InputError or SimulationError as for `pmr.simulation.Simulator`; SimulationError too
    if what two richer models say of an impact differs.
    """
    begin = time.perf_counter()
    if why := no_estimate(models):
        raise ValueError(f"no estimate: {why}")
    first = _Simulated.of(system, excitation, run, response)
    outputs_of_run, floors = first.outputs, Floors.of(system, excitation, first.run.forces)
    difference = _attachment_difference(models, first, excitation, floors)
    better = outputs_of_run.plus(difference.missing)
    kinds = [kind for kind in dict.fromkeys((*KINDS, *outputs_of_run.kinds)) if kind != "probe"]
    largest, of_probes = (
        differences(outputs_of_run, better, floors, kinds),
        probe_differences(outputs_of_run, better, floors),
    )
    largest |= {"probe": float(of_probes.max())} if len(of_probes) else {}
    unknown = {kind: coverage.UNSETTLED[kind] for kind in difference.unsettled}
    indicator, error = None, difference.missing.displacement
    for model in [models[ALONE]] if ALONE in models else []:
        if why := _no_forces(model, excitation, outputs_of_run, better):
            unknown.setdefault("pad_force", why)
        body, motion = along_path(difference.better.system, difference.better.run, excitation)
        indicator = chi(body, motion, excitation.forces(body.input_names), model.size)
    probes = dict(zip(_probes(system), (MARGIN * of_probes).tolist(), strict=True))
    return Estimate(
        errors={
            name: MARGIN * size
            for name, size in {**difference.named, **largest}.items()
            if name.removesuffix("_between_kinks") not in unknown
        },
        probes={} if "probe" in unknown else probes,
        error=error,
        tips=outputs_of_run.tips,
        seconds=time.perf_counter() - begin,
        by="attachment",
        enrichment=difference.enrichment,
        chi=indicator,
        bodies=_errors_along(system, outputs_of_run.displacement, error),
        unknown=unknown,
        scatter=difference.scatter,
    )


def _no_forces(model: ReducedModel, excitation: Excitation, of_run: Outputs, better: Outputs) -> str | None:
    """Why forces of a body alone have no estimate; None where they have one."""
    if impulsive(model, excitation):
        return coverage.IMPACTS
    if model.moving and coverage.jumps_damped(model, excitation.signals, excitation.stepping.end):
        return coverage.JUMPS
    return coverage.RINGING if of_run.force.size and rings(of_run.force, better.force) else None


def _attachment_difference(models: Models, first: _Simulated, excitation: Excitation, floors: Floors) -> _Difference:
    """By the enrichment modes, and attachment modes for what bodies bore, in the parts of a step that they took."""
    if not excitation.stepping.schedule:
        excitation = in_parts(first.system, excitation, first.run)
    loads = loads_carried(first.system, first.run)

    count = max(0 if model.enrichment is None else model.enrichment.count for model in models.values())
    left_out = LEFT_OUT

    def richer(count: int) -> _Simulated:
        """Simulate models with up to `count` enrichment modes of each body."""
        bodies = {
            name: with_attachment_modes(_with_enrichment(model, count), loads[name], left_out)
            for name, model in models.items()
        }
        return _Simulated.of(first.system.with_bodies(bodies), excitation)

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
    missing = better.outputs.minus(first.outputs)
    named = _errors_by_name(first.response, better.response, excitation)
    if not lifts_off(first.run.forces[:, pushing]):
        return _Difference(missing, better, count, named)
    other = richer(0)
    kinds = tuple(dict.fromkeys((*KINDS, *first.outputs.kinds)))
    errors_of_first, apart = (
        differences(richer_run.outputs, better.outputs, floors, kinds) for richer_run in (first, other)
    )
    unknown = [kind for kind in kinds if not settled(errors_of_first[kind], apart[kind])]
    if "pad_force" not in unknown:  # which all other forces balance
        unknown = [kind for kind in unknown if kind in KINDS]
    peaks = [float(richer_run.run.forces[:, pushing].max()) for richer_run in (first, better, other)]
    # Where they disagree on forces, what they differ by in displacements has to be within the estimate's margin.
    stricter = SETTLED / (MARGIN - 1.0) if "pad_force" in unknown else 1.0
    for kind in ("beam", "tip"):
        if not settled(errors_of_first[kind], stricter * apart[kind]):
            raise UnsettledError(errors_of_first[kind], apart[kind], peaks)
    scatter_text = scatter(peaks) if "pad_force" in unknown else ""
    return _Difference(missing, better, count, named, unknown, scatter_text)


def _with_enrichment(model: ReducedModel, count: int) -> ReducedModel:
    """The model with up to `count` of its enrichment modes as coordinates."""
    most = 0 if model.enrichment is None else model.enrichment.count
    return extend(model, min(count, most)) if min(count, most) else model


def _errors_by_name(response: Response, better: Response, excitation: Excitation) -> dict[str, float]:
    """Errors by name, of reactions and probes, and of forces of each kind between kinks."""
    responses, measured = {"reduced": response, "full": better}, quantities(excitation, response)
    return compare.errors(responses, compare.relative_error, quantities=measured)["reduced_vs_full"]


def _errors_along(system: System, displacement: Array, error: Array) -> dict[str, float]:
    """Error along each of several bodies, with margin."""
    first, errors = 0, dict[str, float]()
    for name, body in system.bodies.items() if len(system.bodies) > 1 else ():
        columns = slice(first, first := first + int(np.count_nonzero(length_outputs(body))))
        errors[name] = MARGIN * compare.relative_error(displacement[:, columns], (displacement + error)[:, columns])
    return errors


def _probes(system: System) -> list[str]:
    return [named(name, probe) for name, body in system.bodies.items() for probe in column_names(body).others]


def by_other(system: System, better: ReducedModel, excitation: Excitation) -> Estimate:
    r"""The error of a body alone on any basis, from another one of the same body whose error can be estimated.

    .. math:: \lVert y - y_r \rVert \le \lVert y_b - y_r \rVert + \lVert y - y_b \rVert

    with y_b the motion of free modes with residual flexibility, and their own estimate for the last term.  Raises
    ValueError, InputError, SimulationError as for `estimate` of the other model.
    """
    begin = time.perf_counter()
    terms = () if system.terms_of is None else system.terms_of({ALONE: better})
    systems = [system, replace(System.of(better), terms=terms)]
    of_better = estimate({ALONE: better}, systems[1], excitation)
    of_model, other, lacking = _with_common_forces(*(_Simulated.of(simulated, excitation) for simulated in systems))
    floors, errors_of_better = Floors.of(systems[1], excitation), dict(of_better.errors)
    apart = differences(of_model, other, floors)
    of_probes = dict(zip(_probes(systems[0]), probe_differences(of_model, other, floors).tolist(), strict=True))
    left_out = {"left out": coverage.LEFT_OUT.format(", ".join(lacking))} if lacking else {}
    return Estimate(
        errors={kind: apart[kind] + size for kind, size in errors_of_better.items() if kind in apart},
        probes={name: of_probes[name] + size for name, size in of_better.probes.items()},
        error=other.displacement - of_model.displacement + of_better.error,
        tips=other.tips,
        seconds=time.perf_counter() - begin,
        by="other model",
        unknown=dict(of_better.unknown) | left_out,
    )


def _with_common_forces(first_run: _Simulated, second_run: _Simulated) -> tuple[Outputs, Outputs, list[str]]:
    """Outputs with the forces that both know, and names of the others: rows that a basis doesn't move are left out."""
    names = [each.response.force_names for each in (first_run, second_run)]
    common = [name for name in names[1] if name in names[0]]
    first, second = (
        replace(each.outputs, force=each.outputs.force[:, [force_names.index(name) for name in common]], forces=())
        for each, force_names in zip((first_run, second_run), names, strict=True)
    )
    return first, second, [name for name in dict.fromkeys(sum(names, ())) if name not in common]
