r"""How far a reduced model is off, without a full one.

The error is what inertia and damping of the truncated modes make of the motion.  A second run has more coordinates: the
first modes left out, the enrichment modes, and attachment modes (`pmr.reduced.attachment`), which give the rest its
inertia and damping in the directions of all loads that a body bore in the first run:

.. math:: \text{estimate} = 1.25 \lVert y_{\text{second}} - y_r \rVert

1.25 is a margin: without it the estimate was 0.98 to 1.2 times the true error in random scenes, damped and not, with
one slider, two sliders and twelve pads (tests/compare/test_estimate_kinds_sweep.py).  It is no bound
(docs/moving_residual_flexibility.md, section 12); `pmr.compare.trust` says where it can be seen to fail.  Where pads
land and lift off an impact a moment earlier changes all that follows: a third run, without the enrichment modes, has to
be near the second one then.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.compare.errors import ROUND_OFF, errors_between, relative_error
from pmr.compare.outputs import (
    OUTPUT_KINDS,
    Floors,
    Outputs,
    along_path,
    differences,
    impulsive,
    in_parts,
    outputs_of_response,
    probe_differences,
    quantities_of_boom,
    run_from_start,
)
from pmr.compare.responses import respond
from pmr.compare.trust import (
    LOAD_JUMPS,
    ROWS_LEFT_OUT,
    SLIDER_IMPACTS,
    SLIDER_RINGING,
    UNSETTLED_KINDS,
    jumps_damped,
    rings,
)
from pmr.constraints.polynomials import columns, evaluate
from pmr.constraints.rows import Row
from pmr.errors import GrowthError, InputError, SimulationError
from pmr.reduced.attachment import LEFT_OUT, with_attachment_modes
from pmr.reduced.carriers import CarriedRows
from pmr.reduced.model import ReducedModel
from pmr.reduced.truncation import extend, is_modal
from pmr.results import Response
from pmr.results.quantities import with_unit
from pmr.scene.keys import ALONE, named
from pmr.simulation import Excitation
from pmr.simulation.reactions import column_names
from pmr.system.body import Trajectory, length_outputs
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
    kinds = [kind for kind in dict.fromkeys((*OUTPUT_KINDS, *outputs_of_run.kinds)) if kind != "probe"]
    largest, of_probes = (
        differences(outputs_of_run, better, floors, kinds),
        probe_differences(outputs_of_run, better, floors),
    )
    largest |= {"probe": float(of_probes.max())} if len(of_probes) else {}
    unknown = {kind: UNSETTLED_KINDS[kind] for kind in difference.unsettled}
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
        return SLIDER_IMPACTS
    if model.moving and jumps_damped(model, excitation.signals, excitation.stepping.end):
        return LOAD_JUMPS
    return SLIDER_RINGING if of_run.force.size and rings(of_run.force, better.force) else None


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
    kinds = tuple(dict.fromkeys((*OUTPUT_KINDS, *first.outputs.kinds)))
    errors_of_first, apart = (
        differences(richer_run.outputs, better.outputs, floors, kinds) for richer_run in (first, other)
    )
    unknown = [kind for kind in kinds if not settled(errors_of_first[kind], apart[kind])]
    if "pad_force" not in unknown:  # which all other forces balance
        unknown = [kind for kind in unknown if kind in OUTPUT_KINDS]
    peaks = [float(richer_run.run.forces[:, pushing].max()) for richer_run in (first, better, other)]
    # Where they disagree on forces, what they differ by in displacements has to be within the estimate's margin.
    stricter = SETTLED / (MARGIN - 1.0) if "pad_force" in unknown else 1.0
    for kind in ("beam", "tip"):
        if not settled(errors_of_first[kind], stricter * apart[kind]):
            raise UnsettledError(errors_of_first[kind], apart[kind], peaks)
    scatter_text = describe_scatter(peaks) if "pad_force" in unknown else ""
    return _Difference(missing, better, count, named, unknown, scatter_text)


def _with_enrichment(model: ReducedModel, count: int) -> ReducedModel:
    """The model with up to `count` of its enrichment modes as coordinates."""
    most = 0 if model.enrichment is None else model.enrichment.count
    return extend(model, min(count, most)) if min(count, most) else model


def _errors_by_name(response: Response, better: Response, excitation: Excitation) -> dict[str, float]:
    """Errors by name, of reactions and probes, and of forces of each kind between kinks."""
    responses, measured = {"reduced": response, "full": better}, quantities_of_boom(excitation, response)
    return errors_between(responses, relative_error, quantities=measured)["reduced_vs_full"]


def _errors_along(system: System, displacement: Array, error: Array) -> dict[str, float]:
    """Error along each of several bodies, with margin."""
    first, errors = 0, dict[str, float]()
    for name, body in system.bodies.items() if len(system.bodies) > 1 else ():
        columns = slice(first, first := first + int(np.count_nonzero(length_outputs(body))))
        errors[name] = MARGIN * relative_error(displacement[:, columns], (displacement + error)[:, columns])
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
    left_out = {"left out": ROWS_LEFT_OUT.format(", ".join(lacking))} if lacking else {}
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


def chi(body: ReducedModel, run: Trajectory, f: Array, mode: int) -> float:
    r"""Share of a mode's motion that is not quasi-static, in a run of a body on its modes under loads f (T, i) in N.

    .. math::
        \chi = \frac{\mathrm{rms}(\eta - \varphi_{r+1}^T g / \omega_{r+1}^2)}{\mathrm{rms}(\eta)}, \quad \eta = p_{r+1}

    docs/moving_residual_flexibility.md, sections 10 and 12.

    It is 0 where the mode stands still but for round-off, as torsion does under loads in a plane of symmetry.
    """
    force = f @ body.B[mode] - np.einsum(
        "tm,tm->t", evaluate(columns(body.rows, [mode]), run.s)[:, :, 0], run.multipliers
    )
    motion, most = _rms(run.q[:, mode]), float(np.abs(run.q).max(initial=0.0))
    return _rms(run.q[:, mode] - force / body.K[mode, mode]) / motion if motion > ROUND_OFF * most else 0.0


def _rms(x: Array) -> float:
    unit = float(np.abs(x).max(initial=0.0))  # squares of tiny values would vanish
    return unit * float(np.sqrt(np.mean((x / unit) ** 2))) if unit > 0.0 else 0.0


#: Share of the error that two richer models may differ by where pads lift.
SETTLED = 0.5
#: Steps of a run whose loads are answered, at most, evenly taken from all.
ANSWERED_STEPS = 20_000


def loads_carried(system: System, run: SystemTrajectory) -> dict[str, sp.csr_matrix]:
    """Forces of contacts and loads on the carriers and inputs of each body, (S, K + i) in N."""
    forces, first = {}, 0
    for name, body in system.reduced.items():
        rows = [system.row(side.place) for side in system.sides if side.place.body == name]
        last = first + len(body.input_names)
        assert body.carriers is not None
        forces[name] = carrier_forces_of_run(body.carriers, rows, run.bodies[name], run.loads[:, first:last])
        first = last
    return forces


def carrier_forces_of_run(carriers: CarriedRows, rows: Sequence[Row], run: Trajectory, loads: Array) -> sp.csr_matrix:
    """Forces of rows on their carriers in a run, and its loads (T, i): (S, K + i) in N, at up to `STEPS` steps.

    The path coordinates of the run are those of each row (T, m) in m.
    """
    steps = np.linspace(0, len(run.t) - 1, min(len(run.t), ANSWERED_STEPS)).astype(int)
    return carrier_forces(carriers, rows, run.s[steps], run.multipliers[steps], loads[steps])


def carrier_forces(
    carriers: CarriedRows, rows: Sequence[Row], x: Array, multipliers: Array, loads: Array
) -> sp.csr_matrix:
    """Forces of rows at x (T, m) m on their carriers, by multipliers (T, m) N, and loads: (T, K + i) in N.

    Sparse, for a row touches few carriers at a time.
    """
    T, K = len(x), len(carriers.values)
    on, shares = [np.broadcast_to(K + np.arange(loads.shape[1]), loads.shape)], [loads]
    for row, at, force in zip(rows, x.T, multipliers.T, strict=True):
        touched, b = row.on_carriers(at, 0)
        on, shares = [*on, touched], [*shares, -b * force[:, None]]
    columns, entries = np.hstack(on), np.hstack(shares)
    ends = columns.shape[1] * np.arange(T + 1)
    forces = sp.csr_matrix((entries.ravel(), columns.ravel(), ends), (T, K + loads.shape[1]))
    forces.sum_duplicates()  # rows may touch the same ones
    return forces


def lifts_off(forces: Array) -> bool:
    """Whether a contact that only pushes does so now and then, by the forces (T, p) of these in N."""
    pushed = forces > 0.0
    return bool(np.any(pushed.any(axis=0) & ~pushed.all(axis=0)))


def settled(error: float, apart: float) -> bool:
    """Whether two richer models that are so far `apart` may tell such an error; fractions."""
    return apart <= SETTLED * error or error <= ROUND_OFF


def describe_scatter(peaks: Sequence[float]) -> str:
    """Sentence about the largest forces, in N, of pads that land and lift off in nearly equal models.

    Empty where they have the same to three digits.
    """
    least, most = (with_unit(find(peaks), "N") for find in (min, max))
    if least == most:
        return ""
    return (
        f"pads lift off and close again many times, and their peak forces scatter: {least} to {most} with models that "
        "are nearly alike, and as much with another time step; they are a range, not a figure"
    )


class UnsettledError(SimulationError):
    """Two richer models differ by as much as they tell; `warning` says how far `peaks`, in N, scatter by it."""

    def __init__(self, error: float, apart: float, peaks: Sequence[float]) -> None:
        super().__init__(
            "pads lift off and close again, and the motion depends on the exact time of impacts: two richer models "
            f"differ by {100.0 * apart:.2g} %, and the error to estimate is {100.0 * error:.2g} %"
        )
        self.warning = describe_scatter(peaks)


#: Share of inertia that directions among the loads may leave out.
LEFT_OUT_AT_REST = 1e-4


def system_with_attachment_modes(system: System, x: Array, forces: Sequence[Array], loads: Sequence[Array]) -> System:
    """Add attachment modes for contact forces (P, m) N at places x (P, sides) m, and loads (P, i) N, of several cases.

    At rest residual flexibility leaves nothing out but for what axial forces do to it: attachment modes for what bodies
    bear (`pmr.reduced.attachment`) and enrichment modes have the matrices of second order, and inertia.

    An InputError is raised where the models know no more.
    """
    models = system.modal
    if why := no_estimate(models):
        raise InputError(
            "scene", "reduction.estimate", None, f"models with an estimate of their error are allowed: {why}"
        )
    bodies, first = {}, 0
    for name, model in models.items():
        last, carriers = first + len(model.input_names), model.carriers
        assert carriers is not None  # as `no_estimate` says
        on = system.sides_of(name)
        rows = [system.row(system.sides[number].place) for number in on]
        pressing = [
            carrier_forces(carriers, rows, x[:, on], system.pressed(name, of), acting[:, first:last])
            for of, acting in zip(forces, loads, strict=True)
        ]
        bodies[name] = with_attachment_modes(extend(model), sp.vstack(pressing, "csr"), LEFT_OUT_AT_REST, at_rest=True)
        first = last
    return system.with_bodies(bodies)
