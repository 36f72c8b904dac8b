r"""How far a reduced model is off, without a full one.

The error is what inertia and damping of the truncated modes make of the motion.  A second run keeps the first c of
them, the enrichment modes, as coordinates, and of all others the inertia and the damping (`pmr.simulation.native`,
residual inertia), which is one order more of the same series:

.. math::
    d = y_{r+c,\ \text{inertia}} - y_r, \qquad \text{estimate} = 1.25 \max(\lVert d \rVert, \lVert y_{r+c} - y_r \rVert)

The larger one, since what the enrichment modes alone see is a part of the error.  Outputs of the second run have the
lag that damping makes of the residual part's deformation, too (`pmr.compare.velocities`).  1.25 is a margin:
without it the estimate was 0.86 to 1.18 times the true error in random scenes, damped and not, with one slider, two
sliders and twelve pads (tests/compare/test_estimate_sweep.py).  It is no bound: it needs an error that falls from r to
r + c modes (docs/moving_residual_flexibility.md, section 12); `pmr.compare.coverage` says where it can be seen to fail.

A model that keeps all of that inertia already has its enrichment modes only, and what these say is divided by kappa,
their share of what is left out (`pmr.compare.indicators`).  Where rows only push, the second run has attachment modes
in place of the series (`pmr.compare.attached`), and a third one, without the enrichment modes, has to be near it.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pmr.compare import coverage
from pmr.compare.attached import UnsettledError, lifting, scatter, settled, with_loads_answered
from pmr.compare.indicators import chi, kappa
from pmr.compare.outputs import KINDS, Floors, Outputs, differences, impulsive, lagging, outputs, probe_differences
from pmr.compare.ringing import rings
from pmr.reduced.model import ReducedModel
from pmr.reduced.truncation import extended, is_modal, with_kept_inertia
from pmr.simulation import Excitation
from pmr.simulation.columns import called
from pmr.simulation.modal import ModalForm, modal_form
from pmr.simulation.native import simulator as march
from pmr.system.body import Trajectory, pushing_rows

Array = NDArray[np.float64]

#: Margin of the estimate over what the enrichment modes say, and of errors that all modes of a reduction tell.
MARGIN, MARGIN_OF_ALL_MODES = 1.25, 1.1


class Estimated(Protocol):
    """What an estimate says of each kind of output."""

    @property
    def unknown(self) -> Mapping[str, str]: ...

    def of(self, kind: str) -> float:
        """Error as a fraction, with margin; 0 where it is unknown."""


@dataclass(frozen=True)
class Estimate:
    """Estimated errors of a reduced model's outputs, with margin.

    Fractions are e_NRMS relative to the second run's motion, not capped: above 1 the error is larger than the motion.
    `by` says which difference: ``inertia`` (d), ``enrichment`` (y_{r+c} - y_r, over kappa where there is no d),
    ``attachment`` (of rows that only push) or ``other model``.
    """

    beam: float  # over all displacements
    tip: float
    pad_force: float | None  # of sliders and pads; None where `unknown` says why
    velocity: float | None  # of the displacements' rates; None where `unknown` says why
    probes: Mapping[str, float]  # of each output in another unit, by name (`probe_differences`)
    kappa: float | None  # share of the residual part's inertia that the enrichment modes carry
    by: str
    chi: float | None  # share of the first truncated mode's motion that is not quasi-static
    error: Array  # (T, o) m: what is missing in the outputs, as far as these runs know, without margin
    seconds: float  # wall time of the estimate, all runs included
    unknown: Mapping[str, str] = field(default_factory=dict)  # kinds without an estimate, and why, in words
    scatter: str = ""  # what is to be said of peak forces where these are not settled

    def of(self, kind: str) -> float:
        """Error of one kind of output, with margin; 0 where it is unknown."""
        return getattr(self, kind, None) or 0.0

    @property
    def probe(self) -> float | None:
        """That of the probe which is furthest off; None without probes."""
        return max(self.probes.values(), default=None)

    @property
    def largest(self) -> float:
        """Estimated largest error of any output at any time in m, with margin."""
        return float(MARGIN * np.abs(self.error).max())


def no_estimate(model: ReducedModel) -> str | None:
    """Why a model's error can't be estimated, in words; None where it can."""
    if model.flexibility is None:
        return (
            "without residual flexibility the statics of what the basis leaves out are lost with it, and no table says "
            "how much that is"
        )
    if not is_modal(model):
        return (
            "the basis holds no eigenmodes: what it leaves out has a low mode of its own and is coupled to the "
            "coordinates by inertia, which no table says"
        )
    known = model.carriers if pushing_rows(model) else model.flexibility
    if model.enrichment is None or known is None or known.inertia is None:
        return "the model keeps no enrichment modes: they come with reduction.estimate = true, on a mesh that has more"
    return None


@dataclass(frozen=True)
class _Simulated:
    """Outputs of a model, with the trajectory in its modal form that they are of."""

    outputs: Outputs
    form: ModalForm
    run: Trajectory

    @classmethod
    def of(cls, model: ReducedModel, excitation: Excitation, tips: int) -> _Simulated:
        form = modal_form(model)
        run = march.simulate_modal(form, excitation)
        return cls(outputs(form.body, run, excitation, tips), form, run)


@dataclass(frozen=True)
class _Difference:
    """What richer models have beyond a model, by what they have in addition; one of them; kinds they disagree on."""

    missing: Mapping[str, Outputs]
    better: _Simulated
    kappa: float | None = None
    unsettled: Collection[str] = ()
    scatter: str = ""


def estimate(model: ReducedModel, excitation: Excitation, tips: int = 1) -> Estimate:
    """Estimate the error of a model with enrichment modes, from rest; all runs are made here.

    The last `tips` displacements are those of the tip.  Raises ValueError if there is no estimate (`no_estimate`);
    InputError or SimulationError as for `pmr.simulation.Simulator`; SimulationError too if what two richer models say
    of an impact differs.
    """
    begin = time.perf_counter()
    if why := no_estimate(model):
        raise ValueError(f"no estimate: {why}")
    run, floors = _Simulated.of(model, excitation, tips), Floors.of(model, excitation)
    own, difference = run.outputs, (_pushed if pushing_rows(model) else _by_series)(model, run, excitation, floors)
    missing = difference.missing
    found = {name: differences(own, own.plus(what), floors) for name, what in missing.items()}
    by = max(found, key=lambda name: found[name]["beam"])
    largest = {kind: MARGIN * max(one[kind] for one in found.values()) for kind in KINDS}
    of_probes = np.max([probe_differences(own, own.plus(what), floors) for what in missing.values()], axis=0)
    unknown = {kind: coverage.UNSETTLED[kind] for kind in difference.unsettled}
    if impulsive(model, excitation):
        unknown.setdefault("pad_force", coverage.BLOWS)
    elif model.moving and coverage.jumps_damped(model, excitation.signals, excitation.stepping.end):
        unknown.setdefault("pad_force", coverage.JUMPS)
    elif own.force.size and rings(own.force, own.plus(missing[by]).force):
        unknown.setdefault("pad_force", coverage.RINGING)
    return Estimate(
        beam=largest["beam"],
        tip=largest["tip"],
        pad_force=None if "pad_force" in unknown else largest["pad_force"],
        velocity=None if "velocity" in unknown else largest["velocity"],
        probes={} if "probe" in unknown else _named(model, MARGIN * of_probes),
        kappa=difference.kappa,
        by=by,
        chi=chi(difference.better.form, difference.better.run, excitation.forces(model.input_names), model.size),
        error=missing[by].displacement,
        seconds=time.perf_counter() - begin,
        unknown=unknown,
        scatter=difference.scatter,
    )


def _by_series(model: ReducedModel, own: _Simulated, excitation: Excitation, floors: Floors) -> _Difference:
    """By the enrichment modes, and the next term of the series."""
    assert model.flexibility is not None
    tips = len(own.outputs.tips)
    better = _Simulated.of(extended(model), excitation, tips)
    share, beyond = kappa(model, own.run.s), better.outputs.minus(own.outputs)
    if (
        model.flexibility.keeps_inertia or not better.form.classically_damped
    ):  # damping that couples modes has no tables
        late = _with_lag(better, excitation).minus(better.outputs)
        missing = {"enrichment": beyond.times(1.0 / share).plus(late)}
    else:
        complete = _with_lag(_Simulated.of(with_kept_inertia(extended(model)), excitation, tips), excitation)
        missing = {"inertia": complete.minus(own.outputs), "enrichment": beyond}
    return _Difference(missing, better, share)


def _pushed(model: ReducedModel, own: _Simulated, excitation: Excitation, floors: Floors) -> _Difference:
    """By the enrichment modes, and attachment modes for what the model bore, in the parts of a step that it took."""
    if own.run.parts is not None:
        excitation = excitation.with_stepping(replace(excitation.stepping, schedule=tuple(own.run.parts[1:].tolist())))
    loads, tips = excitation.forces(model.input_names), len(own.outputs.tips)
    better = _Simulated.of(with_loads_answered(extended(model), own.run, loads), excitation, tips)
    missing = {"attachment": better.outputs.minus(own.outputs)}
    if not lifting(own.run.multipliers[:, pushing_rows(own.form.body)]):
        return _Difference(missing, better)
    other = _Simulated.of(with_loads_answered(model, own.run, loads), excitation, tips)
    difference, apart = (differences(one.outputs, better.outputs, floors) for one in (own, other))
    unknown = [kind for kind in KINDS if not settled(difference[kind], apart[kind])]
    peaks = [float(one.outputs.force.max()) for one in (own, better, other)]
    for kind in unknown:
        if kind in ("beam", "tip"):
            raise UnsettledError(difference[kind], apart[kind], peaks)
    return _Difference(missing, better, unsettled=unknown, scatter=scatter(peaks) if "pad_force" in unknown else "")


def _with_lag(one: _Simulated, excitation: Excitation) -> Outputs:
    return lagging(one.outputs, one.form.body, one.run, excitation)


def by_other(model: ReducedModel, better: ReducedModel, excitation: Excitation, tips: int = 1) -> Estimate:
    r"""The error of a model on any basis, from another one of the same body whose error can be estimated.

    .. math:: \lVert y - y_r \rVert \le \lVert y_b - y_r \rVert + \lVert y - y_b \rVert

    with y_b the motion of free modes with residual flexibility, and their own estimate for the last term.  Raises
    ValueError, InputError, SimulationError as for `estimate` of the other model.
    """
    begin = time.perf_counter()
    own_of_better = estimate(better, excitation, tips)

    own, other = (_Simulated.of(one, excitation, tips).outputs for one in (model, better))
    floors = Floors.of(better, excitation)
    found, of_probes = differences(own, other, floors), _named(model, probe_differences(own, other, floors))
    known = own.force.shape == other.force.shape and own_of_better.pad_force is not None
    return Estimate(
        beam=found["beam"] + own_of_better.beam,
        tip=found["tip"] + own_of_better.tip,
        pad_force=found["pad_force"] + (own_of_better.pad_force or 0.0) if known else None,
        velocity=None if own_of_better.velocity is None else found["velocity"] + own_of_better.velocity,
        probes={name: of_probes[name] + size for name, size in own_of_better.probes.items()},
        kappa=None,
        by="other model",
        chi=None,
        error=other.displacement - own.displacement + own_of_better.error,
        seconds=time.perf_counter() - begin,
        unknown=own_of_better.unknown,
    )


def _named(model: ReducedModel, of_probes: Array) -> dict[str, float]:
    return dict(zip(called(model, ()).others, of_probes.tolist(), strict=True))
