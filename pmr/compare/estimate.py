r"""Estimate the error of a reduced model without a full model.

The error comes from inertia and damping of the truncated modes.  A second run has more coordinates: the first truncated
modes (enrichment modes), and attachment modes (`pmr.system.attachment`), which add inertia and damping of all further
modes in the directions of all loads that acted on a body in the first run:

.. math:: \text{estimate} = 1.25 \lVert y_{\text{second}} - y_r \rVert

with the outputs y_r of the reduced model and y_second of the second run.  The factor 1.25 is a margin: without it, the
estimate was 0.98 to 1.2 times the true error in random scenes, damped and not, with one slider, two sliders and twelve
pads (tests/compare/test_estimate_kinds_sweep.py).  The estimate is no bound (docs/moving_residual_flexibility.md,
section 12); `pmr.compare.trust` names the cases in which it was seen to fail.  If pads land and lift off, an impact
that comes a moment earlier changes the whole motion after it.  Then a third run, without the enrichment modes, has to
be close to the second one.
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
    Outputs,
    RoundOffBounds,
    boom_quantities,
    differences,
    divide_steps,
    has_impulsive_force,
    only_body_motion,
    outputs_of_response,
    probe_differences,
    run_from_start,
)
from pmr.compare.responses import evaluate_motion
from pmr.compare.trust import (
    LOAD_JUMPS,
    ROWS_LEFT_OUT,
    SLIDER_IMPACTS,
    SLIDER_RINGING,
    UNSETTLED_KINDS,
    has_damped_jump,
    is_ringing,
)
from pmr.errors import GrowthError, InputError, SimulationError
from pmr.results import Response
from pmr.results.quantities import with_unit
from pmr.scene.keys import ALONE, qualified_name
from pmr.simulation import Excitation
from pmr.simulation.reactions import column_names
from pmr.system.attachment import LEFT_OUT, with_attachment_modes
from pmr.system.body import Trajectory, length_outputs
from pmr.system.carriers import CarrierRows
from pmr.system.polynomials import evaluate, select_columns
from pmr.system.reduced_model import ReducedModel
from pmr.system.rows import Row
from pmr.system.states import SystemTrajectory
from pmr.system.system import System
from pmr.system.truncation import extend, is_modal

Array = NDArray[np.float64]
Models = Mapping[str, ReducedModel]

#: Factor by which estimates multiply the difference to a richer model.
MARGIN = 1.25
#: Share of inertia that attachment modes leave out if the motion grows with the share `LEFT_OUT`: under rigid contacts
#: the flexibility that remains is round-off, which may have the wrong sign.
MORE_LEFT_OUT = 1e-5


@dataclass(frozen=True)
class Estimate:
    """Estimated errors of the outputs of reduced bodies, with margin.

    Fractions are e_NRMS relative to the second run's motion, without the limit of 1: above 1, the error is larger than
    the motion.  `by` is the method: ``attachment`` modes, or an ``other model``.
    """

    errors: Mapping[str, float]  # fractions by kind of output (`pmr.compare.outputs`); `unknown` kinds are missing
    probes: Mapping[str, float]  # fractions by name of the probe (`probe_differences`)
    error: Array  # (T, o) m: error of the displacements as far as these runs show it, without margin
    tips: tuple[int, ...]  # numbers of the displacements of the tip
    seconds: float  # wall time of the estimate, all runs included
    by: str
    enrichment: int | None = None  # number of modes that the second run has more, for each body; None: all
    chi: float | None = None  # share of the first truncated mode's motion that is not quasi-static
    bodies: Mapping[str, float] = field(default_factory=dict)  # error along each body by name, with margin
    unknown: Mapping[str, str] = field(default_factory=dict)  # reasons, in words, for kinds without an estimate
    scatter: str = ""  # sentence about peak forces that are not settled (`describe_scatter`), else empty

    def error_of(self, kind: str) -> float:
        """Error of one kind of output, a fraction with margin; 0 if there is no estimate of this kind."""
        return self.errors.get(kind, 0.0)

    @property
    def beam(self) -> float:
        """Error over all displacements, a fraction with margin."""
        return self.error_of("beam")

    @property
    def tip(self) -> float:
        """Error of the tip's displacements, a fraction with margin."""
        return self.error_of("tip")

    @property
    def largest(self) -> float:
        """Estimated largest error of any displacement at any time in m, with margin."""
        return float(MARGIN * np.abs(self.error).max())


def reason_without_estimate(models: Models) -> str | None:
    """Why errors of bodies with these models can't be estimated, in words; None if they can.

    `models` maps names of bodies to models.
    """
    return next(
        (
            f"{name}: {why}" if name else why
            for name, model in models.items()
            if (why := _reason_without_estimate_of(model))
        ),
        None,
    )


def _reason_without_estimate_of(model: ReducedModel) -> str | None:
    """Why the error of one model can't be estimated, in words; None if it can."""
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
        return (
            "the model holds no enrichment modes, which the estimate needs: reduction.estimate "
            "= true adds them where the mesh has more modes"
        )
    return None


@dataclass(frozen=True)
class _Simulation:
    """A system, its motion in a run, the response to that motion and its outputs."""

    system: System
    run: SystemTrajectory
    response: Response
    outputs: Outputs

    @classmethod
    def simulate(
        cls,
        system: System,
        excitation: Excitation,
        run: SystemTrajectory | None = None,
        response: Response | None = None,
    ) -> _Simulation:
        """Simulate the system under the excitation and evaluate its outputs.

        If `run` or `response` are passed, they are used and not computed again.
        """
        run = run or run_from_start(system, excitation)
        response = response or evaluate_motion(system, run)
        return cls(system, run, response, outputs_of_response(system, run, excitation, response))


@dataclass(frozen=True)
class _Difference:
    """Outputs of a richer model minus those of a model, and the simulation of the richer model.

    `unsettled` are kinds of outputs in which two richer models disagree.
    """

    difference: Outputs  # of the richer model minus those of the model
    richer: _Simulation
    enrichment: int  # largest number of additional modes of a body
    errors_by_name: Mapping[str, float] = field(
        default_factory=dict
    )  # errors by name (`_errors_by_name`), without margin
    unsettled: Collection[str] = ()  # kinds in which two richer models disagree
    scatter: str = ""  # as in `Estimate`


def estimate_error(
    models: Models,
    system: System,
    excitation: Excitation,
    run: SystemTrajectory | None = None,
    response: Response | None = None,
) -> Estimate:
    """Estimate the error of a system of reduced bodies by a second run with enrichment modes and attachment modes.

    `models` are the reduced bodies by name, on their modes alone; the bodies of `system` have further coordinates if
    there are cylinders (`pmr.system.attachment`).  `run` is the motion of `system` under the excitation, and `response`
    the response to it; each is computed if it is None.  The second run, and a third one if pads lift off, divide each
    step into the same parts as `run`.

    Raises ValueError if there is no estimate (`reason_without_estimate`); InputError or SimulationError as for
    `pmr.simulation.Simulator`; SimulationError too if the two richer models disagree on the motion after an impact.
    """
    begin = time.perf_counter()
    if why := reason_without_estimate(models):
        raise ValueError(f"no estimate: {why}")
    first = _Simulation.simulate(system, excitation, run, response)
    outputs_of_run, floors = first.outputs, RoundOffBounds.for_system(system, excitation, first.run.forces)
    difference = _attachment_difference(models, first, excitation, floors)
    better = outputs_of_run.plus(difference.difference)
    kinds = [kind for kind in dict.fromkeys((*OUTPUT_KINDS, *outputs_of_run.kinds)) if kind != "probe"]
    largest, of_probes = (
        differences(outputs_of_run, better, floors, kinds),
        probe_differences(outputs_of_run, better, floors),
    )
    largest |= {"probe": float(of_probes.max())} if len(of_probes) else {}
    unknown = {kind: UNSETTLED_KINDS[kind] for kind in difference.unsettled}
    indicator, error = None, difference.difference.displacement
    for model in [models[ALONE]] if ALONE in models else []:
        if why := _reason_without_forces(model, excitation, outputs_of_run, better):
            unknown.setdefault("pad_force", why)
        body, motion = only_body_motion(difference.richer.system, difference.richer.run, excitation)
        indicator = chi(body, motion, excitation.forces(body.input_names), model.size)
    probes = dict(zip(_probes(system), (MARGIN * of_probes).tolist(), strict=True))
    return Estimate(
        errors={
            name: MARGIN * size
            for name, size in {**difference.errors_by_name, **largest}.items()
            if name.removesuffix("_between_kinks") not in unknown
        },
        probes={} if "probe" in unknown else probes,
        error=error,
        tips=outputs_of_run.tips,
        seconds=time.perf_counter() - begin,
        by="attachment",
        enrichment=difference.enrichment,
        chi=indicator,
        bodies=_errors_by_section(system, outputs_of_run.displacement, error),
        unknown=unknown,
        scatter=difference.scatter,
    )


def _reason_without_forces(model: ReducedModel, excitation: Excitation, of_run: Outputs, richer: Outputs) -> str | None:
    """Why forces of sliders and pads of a single body have no estimate, in words; None if they have one.

    `of_run` are the outputs of the model, `richer` those of the richer model.
    """
    if has_impulsive_force(model, excitation):
        return SLIDER_IMPACTS
    if model.moving and has_damped_jump(model, excitation.signals, excitation.stepping.end):
        return LOAD_JUMPS
    return SLIDER_RINGING if of_run.force.size and is_ringing(of_run.force, richer.force) else None


def _attachment_difference(
    models: Models, first: _Simulation, excitation: Excitation, floors: RoundOffBounds
) -> _Difference:
    """Simulate the richer model, with enrichment and attachment modes, and return its difference to the first run.

    The attachment modes are responses to the contact forces and loads of the first run, whose parts of each step are
    used again.  If the motion grows, the richer model gets fewer attachment modes, then half as many enrichment modes,
    and so on; a GrowthError is raised if the motion grows with all of these models.  If pads lift off in the first run,
    a third run without enrichment modes shows in which kinds of outputs richer models disagree; an UnsettledError is
    raised if they disagree in displacements.
    """
    if not excitation.stepping.schedule:
        excitation = divide_steps(first.system, excitation, first.run)
    loads = carried_loads(first.system, first.run)

    count = max(0 if model.enrichment is None else model.enrichment.count for model in models.values())
    left_out = LEFT_OUT

    def richer(count: int) -> _Simulation:
        """Simulate models with up to `count` enrichment modes of each body."""
        bodies = {
            name: with_attachment_modes(_with_enrichment(model, count), loads[name], left_out)
            for name, model in models.items()
        }
        return _Simulation.simulate(first.system.with_bodies(bodies), excitation)

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
    return _Difference(missing, better, count, named, unknown, scatter_text)


def _with_enrichment(model: ReducedModel, count: int) -> ReducedModel:
    """The model with its first `count` enrichment modes, or all if it has fewer, as coordinates."""
    most = 0 if model.enrichment is None else model.enrichment.count
    return extend(model, min(count, most)) if min(count, most) else model


def _errors_by_name(response: Response, richer: Response, excitation: Excitation) -> dict[str, float]:
    """Errors of `response` against `richer` in all outputs that `errors_between` compares: fractions without margin.

    They include reactions and probes by name, and forces of each kind between kinks of extensions.
    """
    responses, measured = {"reduced": response, "full": richer}, boom_quantities(excitation, response)
    return errors_between(responses, relative_error, quantities=measured)["reduced_vs_full"]


def _errors_by_section(system: System, displacement: Array, error: Array) -> dict[str, float]:
    """Error along each body, a fraction with margin, by the body's name; empty for a single body.

    `displacement` (T, o) in m are the displacements of all bodies, `error` (T, o) in m their errors.
    """
    first, errors = 0, dict[str, float]()
    for name, body in system.bodies.items() if len(system.bodies) > 1 else ():
        columns = slice(first, first := first + int(np.count_nonzero(length_outputs(body))))
        errors[name] = MARGIN * relative_error(displacement[:, columns], (displacement + error)[:, columns])
    return errors


def _probes(system: System) -> list[str]:
    """Names of the probes of all bodies, in the order of the probes in `Outputs`."""
    return [
        qualified_name(name, probe)
        for name, body in system.bodies.items()
        for probe in column_names(body).other_outputs
    ]


def estimate_by_other_model(system: System, reference: ReducedModel, excitation: Excitation) -> Estimate:
    r"""Estimate the error of a single body on any basis, by another model of this body whose error can be estimated.

    .. math:: \lVert y - y_r \rVert \le \lVert y_b - y_r \rVert + \lVert y - y_b \rVert

    with the exact outputs y, the outputs y_r of `system`, and y_b those of `reference`, a model on free modes
    with residual flexibility; the estimate for `reference` stands for the last term.  Raises ValueError, InputError and
    SimulationError as `estimate_error` of the other model does.
    """
    begin = time.perf_counter()
    terms = () if system.terms_of is None else system.terms_of({ALONE: reference})
    systems = [system, replace(System.of(reference), terms=terms)]
    of_better = estimate_error({ALONE: reference}, systems[1], excitation)
    of_model, other, lacking = _with_common_forces(
        *(_Simulation.simulate(simulated, excitation) for simulated in systems)
    )
    floors, errors_of_better = RoundOffBounds.for_system(systems[1], excitation), dict(of_better.errors)
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


def _with_common_forces(first_run: _Simulation, second_run: _Simulation) -> tuple[Outputs, Outputs, list[str]]:
    """Outputs of both runs with only the forces that occur in both, and the names of all other forces.

    A force is missing in a run if the basis does not move the row of its contact: such rows are left out of a model.
    """
    names = [each.response.force_names for each in (first_run, second_run)]
    common = [name for name in names[1] if name in names[0]]
    first, second = (
        replace(each.outputs, force=each.outputs.force[:, [force_names.index(name) for name in common]], forces=())
        for each, force_names in zip((first_run, second_run), names, strict=True)
    )
    return first, second, [name for name in dict.fromkeys(sum(names, ())) if name not in common]


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
    force = f @ body.B[mode] - np.einsum(
        "tm,tm->t", evaluate(select_columns(body.rows, [mode]), run.s)[:, :, 0], run.multipliers
    )
    motion, most = _rms(run.q[:, mode]), float(np.abs(run.q).max(initial=0.0))
    return _rms(run.q[:, mode] - force / body.K[mode, mode]) / motion if motion > ROUND_OFF * most else 0.0


def _rms(x: Array) -> float:
    """RMS of all entries of x."""
    unit = float(np.abs(x).max(initial=0.0))  # scaled: squares of tiny values would vanish
    return unit * float(np.sqrt(np.mean((x / unit) ** 2))) if unit > 0.0 else 0.0


#: Largest difference between two richer models, over the error, if pads lift off.
SETTLED = 0.5
#: Largest number of steps, evenly spaced among all, whose loads decide on attachment modes.
ANSWERED_STEPS = 20_000


def carried_loads(system: System, run: SystemTrajectory) -> dict[str, sp.csr_matrix]:
    """Contact forces on the carriers of each body in a run, and loads on its inputs: (S, K + i) in N, by body.

    S is the number of steps, at most `ANSWERED_STEPS`, evenly spaced; the body has K carriers and i inputs.
    """
    forces, first = {}, 0
    for name, body in system.reduced.items():
        rows = [system.row(side.place) for side in system.sides if side.place.body == name]
        last = first + len(body.input_names)
        assert body.carriers is not None
        forces[name] = carrier_forces_of_run(body.carriers, rows, run.bodies[name], run.loads[:, first:last])
        first = last
    return forces


def carrier_forces_of_run(carriers: CarrierRows, rows: Sequence[Row], run: Trajectory, loads: Array) -> sp.csr_matrix:
    """Forces of rows on K carriers in a run of one body, and its loads: (S, K + i) in N.

    The S steps, at most `ANSWERED_STEPS`, are evenly spaced among the T steps of the run and of the `loads` (T, i).
    `run.s` must have the path coordinate of each row, (T, m) in m.
    """
    steps = np.linspace(0, len(run.t) - 1, min(len(run.t), ANSWERED_STEPS)).astype(int)
    return carrier_forces(carriers, rows, run.s[steps], run.multipliers[steps], loads[steps])


def carrier_forces(
    carriers: CarrierRows, rows: Sequence[Row], x: Array, multipliers: Array, loads: Array
) -> sp.csr_matrix:
    r"""Forces of m rows on K carriers and, in further columns, the loads: a sparse matrix (T, K + i) in N.

    A row with the multiplier :math:`\lambda` acts on its few carriers with :math:`-b(x) \lambda`, where b are its
    weights on these carriers.  The rows are at the path coordinates x (T, m) in m; their `multipliers` are (T, m) in N,
    and the `loads` (T, i) in N.
    """
    T, K = len(x), len(carriers.values)
    on, shares = [np.broadcast_to(K + np.arange(loads.shape[1]), loads.shape)], [loads]
    for row, at, force in zip(rows, x.T, multipliers.T, strict=True):
        touched, b = row.touched_weights(at, 0)
        on, shares = [*on, touched], [*shares, -b * force[:, None]]
    columns, entries = np.hstack(on), np.hstack(shares)
    ends = columns.shape[1] * np.arange(T + 1)
    forces = sp.csr_matrix((entries.ravel(), columns.ravel(), ends), (T, K + loads.shape[1]))
    forces.sum_duplicates()  # several rows may touch the same carrier
    return forces


def lifts_off(forces: Array) -> bool:
    """Whether any of p contacts that only push is closed at some steps and open at others.

    `forces` (T, p) in N are the forces of these contacts; the force of an open contact is zero.
    """
    pushed = forces > 0.0
    return bool(np.any(pushed.any(axis=0) & ~pushed.all(axis=0)))


def are_settled(error: float, difference: float) -> bool:
    """Whether two richer models differ little enough for an estimate of the error.

    Both `error` and `difference` are fractions.  The models do if the difference is at most `SETTLED` times the error,
    or if the error is round-off.
    """
    return difference <= SETTLED * error or error <= ROUND_OFF


def describe_scatter(peaks: Sequence[float]) -> str:
    """Sentence about the largest forces, in N, of pads that land and lift off in several nearly equal models.

    It is empty if the smallest and the largest of the `peaks` agree to three digits.
    """
    least, most = (with_unit(find(peaks), "N") for find in (min, max))
    if least == most:
        return ""
    return (
        f"pads lift off and close again many times, and their peak forces scatter: {least} to {most} with models that "
        "are nearly alike, and as much with another time step; they are a range, not a figure"
    )


class UnsettledError(SimulationError):
    """Two richer models differ too much for an estimate; `warning` is `describe_scatter` of the `peaks` in N."""

    def __init__(self, error: float, difference: float, peaks: Sequence[float]) -> None:
        super().__init__(
            "pads lift off and close again, and the motion depends on the exact time of impacts: two richer models "
            f"differ by {100.0 * difference:.2g} %, and the error to estimate is {100.0 * error:.2g} %"
        )
        self.warning = describe_scatter(peaks)


#: Share of inertia that attachment modes for load cases at rest may leave out.
LEFT_OUT_AT_REST = 1e-4


def system_with_attachment_modes(system: System, x: Array, forces: Sequence[Array], loads: Sequence[Array]) -> System:
    """Return the system with attachment modes for the contact forces and loads of several load cases at rest.

    The residual flexibility of a model at rest is exact, except that axial forces do not change it.  Attachment modes
    for the loads on the bodies (`pmr.system.attachment`) and enrichment modes have second-order matrices and inertia,
    so they add the effect of axial forces.

    Parameters
    ----------
    system : System     System of reduced bodies. x : (P, sides) array, m
        Path coordinates of all sides of the contacts in P positions.
    forces, loads : sequences of arrays, (P, m) and (P, i) in N
        Forces of the m contacts, and loads on the i inputs, with one array for each load case.

    Raises
    ------
    InputError
        If the models lack data that attachment modes need (`reason_without_estimate`).
    """
    models = system.modal
    if why := reason_without_estimate(models):
        raise InputError(
            "scene", "reduction.estimate", None, f"models with an estimate of their error are allowed: {why}"
        )
    bodies, first = {}, 0
    for name, model in models.items():
        last, carriers = first + len(model.input_names), model.carriers
        assert carriers is not None  # `reason_without_estimate` has checked this
        on = system.sides_of(name)
        rows = [system.row(system.sides[number].place) for number in on]
        pressing = [
            carrier_forces(carriers, rows, x[:, on], system.side_multipliers(name, of), acting[:, first:last])
            for of, acting in zip(forces, loads, strict=True)
        ]
        bodies[name] = with_attachment_modes(extend(model), sp.vstack(pressing, "csr"), LEFT_OUT_AT_REST, at_rest=True)
        first = last
    return system.with_bodies(bodies)
