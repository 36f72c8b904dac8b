r"""How far a reduced model is off, without a full one.

The error is what inertia and damping of the truncated modes make of the motion.  A second run keeps the first c of
them, the enrichment modes, as coordinates, and of all others the inertia and the damping (`pmr.simulate.native`,
residual inertia), which is one order more of the same series:

.. math::
    d = y_{r+c,\ \text{inertia}} - y_r, \qquad \text{estimate} = 1.25 \max(\lVert d \rVert, \lVert y_{r+c} - y_r \rVert)

The larger one, since what the enrichment modes alone see is a part of the error.  Outputs of the second run have the
lag that damping makes of the residual part's deformation, too (`pmr.compare.velocities`).  1.25 is a margin:
without it the estimate was 0.86 to 1.18 times the true error in random scenes, damped and not, with one slider, two
sliders and twelve pads (tests/compare/test_estimate_sweep.py).  It is no bound: it needs an error that falls from r to
r + c modes (docs/moving_residual_flexibility.md, section 12); `pmr.compare.coverage` says where it can be seen to fail.

A model that keeps all of that inertia already has its enrichment modes only, and what these say is divided by kappa,
their share of what is left out (`pmr.compare.indicators`).
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.compare.indicators import chi, kappa
from pmr.compare.outputs import KINDS, Floors, Outputs, differences, impulsive, lagging, outputs, probe_differences
from pmr.errors.text import rounded
from pmr.reduced.model import ReducedModel
from pmr.reduced.truncation import extended, is_modal, with_kept_inertia
from pmr.simulate import Excitation, TimeStepping
from pmr.simulate.columns import called
from pmr.simulate.modal import ModalForm, modal_form
from pmr.simulate.native import simulator as march
from pmr.system.body import Trajectory, pushing_rows

Array = NDArray[np.float64]

#: Margin of the estimate over what the enrichment modes say.
MARGIN = 1.25
#: Share of the first truncated mode's motion that is not quasi-static, above which more modes are called for.
REACHED = 0.5
#: Step times highest circular frequency up to which a moving slider was seen to be stable with rho_inf = 1.
RESOLVED = 2.0
_FIGURES = ("beam", "tip", "pad_force", "velocity", "probe", "probes", "kappa", "by", "chi", "largest", "seconds")


@dataclass(frozen=True)
class Estimate:
    """Estimated errors of a reduced model's outputs.

    Attributes
    ----------
    beam, tip : float
        e_NRMS over all displacements and of the tip's, fractions; relative to the second run's motion.  Not
        capped: above 1 the error is larger than the motion.
    pad_force : float or None
        The same of the forces of sliders and pads; None where these have no size (`pmr.compare.outputs.impulsive`).
    velocity : float
        The same of the displacements' rates.
    probes : mapping of name to float
        The same of each output in another unit, stresses at probes for instance (`probe_differences`).
    kappa : float or None
        Share of the residual part's inertia that the enrichment modes carry.
    by : str
        What told: ``inertia`` (d), ``enrichment`` (y_{r+c} - y_r, over kappa where there is no d) or ``other model``.
    chi : float or None
        Share of the first truncated mode's motion that is not quasi-static.
    error : (T, o) array, m
        What is missing in the outputs, as far as these runs know, without margin.
    seconds : float
        Wall time of the estimate, all runs included.
    """

    beam: float
    tip: float
    pad_force: float | None
    velocity: float
    probes: Mapping[str, float]
    kappa: float | None
    by: str
    chi: float | None
    error: Array
    seconds: float

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
    if pushing_rows(model):
        return (
            "pads only push: what the enrichment modes say of an error adds up for linear models; an impact a moment "
            "earlier changes all that follows"
        )
    if not is_modal(model):
        return (
            "the basis holds no eigenmodes: what it leaves out has a low mode of its own and is coupled to the "
            "coordinates by inertia, which no table says"
        )
    if model.enrichment is None or model.flexibility.inertia is None:
        return "the model keeps no enrichment modes: they come with reduction.estimate = true, on a mesh that has more"
    return None


def estimate(model: ReducedModel, excitation: Excitation, tips: int = 1) -> Estimate:
    """Estimate the error of a model with enrichment modes, from rest; all runs are made here.

    The last `tips` displacements are those of the tip.

    Raises
    ------
    ValueError
        If there is no estimate (`no_estimate`).
    InputError, SimulationError
        As for `pmr.simulate.Simulator`.
    """
    begin = time.perf_counter()
    if why := no_estimate(model):
        raise ValueError(f"no estimate: {why}")
    assert model.flexibility is not None
    f = excitation.forces(model.input_names)

    def simulated(one: ReducedModel) -> tuple[Outputs, ModalForm, Trajectory]:
        form = modal_form(one)
        run = march.simulate_modal(form, excitation)
        return outputs(form.body, run, excitation, tips), form, run

    def with_lag(found: Outputs, form: ModalForm, run: Trajectory) -> Outputs:
        return lagging(found, form.body, run, excitation)

    own, _, run = simulated(model)
    better, form, extended_run = simulated(extended(model))
    share = kappa(model, run.s)
    if model.flexibility.keeps_inertia or not form.classically_damped:  # damping that couples modes has no tables
        late = with_lag(better, form, extended_run).minus(better)
        missing = {"enrichment": better.minus(own).times(1.0 / share).plus(late)}
    else:
        complete = with_lag(*simulated(with_kept_inertia(extended(model))))
        missing = {"inertia": complete.minus(own), "enrichment": better.minus(own)}
    floors = Floors.of(model, excitation)
    found = {name: differences(own, own.plus(what), floors) for name, what in missing.items()}
    by = max(found, key=lambda name: found[name]["beam"])
    largest = {kind: MARGIN * max(one[kind] for one in found.values()) for kind in KINDS}
    of_probes = np.max([probe_differences(own, own.plus(what), floors) for what in missing.values()], axis=0)
    return Estimate(
        beam=largest["beam"],
        tip=largest["tip"],
        pad_force=None if impulsive(model, excitation) else largest["pad_force"],
        velocity=largest["velocity"],
        probes=_named(model, MARGIN * of_probes),
        kappa=share,
        by=by,
        chi=chi(form, extended_run, f, model.size),
        error=missing[by].displacement,
        seconds=time.perf_counter() - begin,
    )


def by_other(model: ReducedModel, better: ReducedModel, excitation: Excitation, tips: int = 1) -> Estimate:
    r"""The error of a model on any basis, from another one of the same body whose error can be estimated.

    .. math:: \lVert y - y_r \rVert \le \lVert y_b - y_r \rVert + \lVert y - y_b \rVert

    with y_b the motion of free modes with residual flexibility, and their own estimate for the last term.

    Raises
    ------
    ValueError, InputError, SimulationError
        As for `estimate` of the other model.
    """
    begin = time.perf_counter()
    own_of_better = estimate(better, excitation, tips)

    def simulated(one: ReducedModel) -> Outputs:
        form = modal_form(one)
        return outputs(form.body, march.simulate_modal(form, excitation), excitation, tips)

    own, other = simulated(model), simulated(better)
    floors = Floors.of(better, excitation)
    found, of_probes = differences(own, other, floors), _named(model, probe_differences(own, other, floors))
    known = own.force.shape == other.force.shape and own_of_better.pad_force is not None
    return Estimate(
        beam=found["beam"] + own_of_better.beam,
        tip=found["tip"] + own_of_better.tip,
        pad_force=found["pad_force"] + (own_of_better.pad_force or 0.0) if known else None,
        velocity=found["velocity"] + own_of_better.velocity,
        probes={name: size + own_of_better.probes[name] for name, size in of_probes.items()},
        kappa=None,
        by="other model",
        chi=None,
        error=other.displacement - own.displacement + own_of_better.error,
        seconds=time.perf_counter() - begin,
    )


def _named(model: ReducedModel, of_probes: Array) -> dict[str, float]:
    return dict(zip(called(model, ()).others, of_probes.tolist(), strict=True))


def summary(
    model: ReducedModel, estimated: Estimate | None, not_covered: Sequence[str] = (), failed: str | None = None
) -> dict[str, float | str | list[str] | None]:
    """What summary.json holds: ``beam``, ``tip``, ``pad_force``, ``velocity`` and ``probe`` (fractions), ``probes`` by
    their names, ``kappa``, ``chi``, ``largest`` (m), ``seconds``.

    ``not_covered`` lists in words what the estimate leaves out.  All are None where there is no estimate, and
    ``reason`` says why: what `failed`, or `no_estimate`.
    """
    if estimated is None:
        return dict.fromkeys((*_FIGURES, "not_covered")) | {"reason": failed or no_estimate(model)}
    return {name: getattr(estimated, name) for name in _FIGURES} | {"not_covered": list(not_covered)}


def warnings(model: ReducedModel, stepping: TimeStepping, estimated: Estimate | None) -> list[str]:
    """What a user should know about a run, a line each."""
    found = []
    if estimated is not None and estimated.beam > 1.0:
        found.append(
            f"the estimated error is {rounded(estimated.beam)} times the motion: "
            f"too few coordinates, or a motion that grows"
        )
    if estimated is not None and estimated.beam > 0.0 and (estimated.chi or 0.0) > REACHED:
        found.append(
            f"load or slide reach the first truncated mode (chi = {estimated.chi:.2f}): more coordinates are worth most"
        )
    fastest = stepping.step * float(np.sqrt(np.max(modal_form(model).omega2, initial=0.0)))
    if stepping.rho_inf == 1.0 and fastest > RESOLVED and model.moving:
        found.append(
            f"the step does not resolve the highest mode (h omega = {rounded(fastest)}) and rho_inf = 1 damps nothing: "
            f"with a moving slider this can grow; a smaller step, rho_inf < 1 or fewer coordinates help"
        )
    return found
