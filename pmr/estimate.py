r"""How far a reduced model is off, without a full one.

The error is what the inertia of the truncated modes makes of the motion.  A second run keeps the first c of them, the
companions, as coordinates:

.. math::
    d = y_{r+c} - y_r, \qquad
    \kappa = \frac{\mathrm{rms}_t\, \mathrm{tr} \sum_{j=r+1}^{r+c} (C \varphi_j)(C \varphi_j)^T \omega_j^{-4}}
                  {\mathrm{rms}_t\, \mathrm{tr} A_0(s)}, \qquad
    \text{estimate} = 1.25\, \lVert d \rVert / \kappa

kappa is the share of the residual part's inertia that the companions carry over the visited stretch, and 1.25 a margin:
without it the estimate was 0.9 to 1.15 times the true error on all scenes of workflows/residual with five modes or
more.  It is no bound: it needs an error that falls from r to r + c modes
(docs/moving_residual_flexibility.md, section 12).

On a thin-walled body a few modes carry little of that inertia, the walls under the pads have most of it.  Where kappa
is below one half the second run keeps all of the inertia instead (`pmr.truncation.with_kept_inertia`), and
1.25 ||d|| is the estimate.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.body import Trajectory, displacement, force_outputs, pushing_rows
from pmr.compare import nrms
from pmr.reduced import ReducedModel
from pmr.signals import SignalBase
from pmr.simulate import Loads, TimeStepping, march
from pmr.simulate.modal import ModalForm, modal_form
from pmr.simulate.stepping import loads_at, one_for_each
from pmr.sliding import evaluate
from pmr.truncation import extended, is_modal, with_kept_inertia

Array = NDArray[np.float64]

#: Margin of the estimate over what the companions say.
MARGIN = 1.25
#: Share of the first truncated mode's motion that is not quasi-static, above which more modes are called for.
REACHED = 0.5
#: Step times highest circular frequency up to which a moving slider was seen to be stable with rho_inf = 1.
RESOLVED = 2.0
#: Share of the inertia that the companions must carry to stand for the rest.
CARRIED = 0.5
_FIGURES = ("beam", "tip", "kappa", "by", "chi", "largest", "seconds")


@dataclass(frozen=True)
class Estimate:
    """Estimated errors of a reduced model's outputs.

    Attributes
    ----------
    beam, tip : float
        e_NRMS over all displacements and of the tip's, fractions; relative to the reduced model's own motion.
    kappa : float
        Share of the residual part's inertia that the companions carry.
    by : str
        What told: ``companions``, or ``inertia`` where they carry less than half.
    chi : float
        Share of the first truncated mode's motion that is not quasi-static.
    error : (T, o) array, m
        d / kappa: what is missing in the outputs, as far as the companions (or the inertia) know, without margin.
    seconds : float
        Wall time of the estimate, both runs included.
    """

    beam: float
    tip: float
    kappa: float
    by: str
    chi: float
    error: Array
    seconds: float

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
            "pads only push: what the companions say of an error adds up for linear models, and an impact a moment "
            "earlier changes all that follows"
        )
    if not is_modal(model):
        return (
            "the basis holds no eigenmodes: what it leaves out has a low mode of its own and is coupled to the "
            "coordinates by inertia, which no table says"
        )
    if model.companions is None or model.flexibility.inertia is None:
        return "the model keeps no companion modes: they come with reduction.estimate = true, on a mesh that has more"
    return None


def estimate(model: ReducedModel, path: SignalBase, loads: Loads, stepping: TimeStepping, tips: int = 1) -> Estimate:
    """Estimate the error of a model with companions on a path under loads, from rest; all runs are made here.

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
    f = loads_at(one_for_each(loads, model.input_names), stepping.times)
    moved = ~force_outputs(model)

    def simulated(one: ReducedModel) -> tuple[Array, ModalForm, Trajectory]:
        form = modal_form(one)
        run = march.simulate_modal(form, path, loads, stepping)
        return displacement(form.body, run.q, run.s, run.deforming, f)[:, moved], form, run

    own, _, run = simulated(model)
    better, form, extended_run = simulated(extended(model))
    share = kappa(model, run.s)
    error = (better - own) / share
    by = "companions"
    if share < CARRIED and not model.flexibility.keeps_inertia:
        better, _, _ = simulated(with_kept_inertia(model))
        error, by = better - own, "inertia"
    return Estimate(
        beam=min(1.0, MARGIN * nrms(own + error, own)),
        tip=min(1.0, MARGIN * nrms(own[:, -tips:] + error[:, -tips:], own[:, -tips:])),
        kappa=share,
        by=by,
        chi=_chi(form, extended_run, f, model.size),
        error=error,
        seconds=time.perf_counter() - begin,
    )


def summary(model: ReducedModel, estimated: Estimate | None) -> dict[str, float | str | None]:
    """What summary.json holds: ``beam``, ``tip`` (fractions), ``kappa``, ``chi``, ``largest`` (m), ``seconds``.

    All None where there is no estimate, and ``reason`` says why.
    """
    if estimated is None:
        return dict.fromkeys(_FIGURES) | {"reason": no_estimate(model)}
    return {name: getattr(estimated, name) for name in _FIGURES}


def kappa(model: ReducedModel, s: Array) -> float:
    """Share of the residual part's inertia that the companions carry, at the path coordinates s (T,) m.

    Where the model keeps that inertia, what is neglected is C (R M)^2 R C^T; the modes beyond the companions are taken
    to be as low as the last of these, which makes kappa a little smaller than it is.
    """
    assert model.companions is not None and model.flexibility is not None and model.flexibility.inertia is not None
    squares = np.einsum("tmc,tmc->tc", rows := evaluate(model.companions.rows, s), rows)
    stiffness = model.companions.stiffness
    part = squares @ stiffness**-2.0
    whole = np.einsum("tmm->t", evaluate(model.flexibility.inertia.A0, s))
    if model.flexibility.keeps_inertia:
        rest = np.maximum(whole - part, 0.0) / stiffness[-1]
        part = squares @ stiffness**-3.0
        whole = part + rest
    return min(1.0, _rms(part) / _rms(whole)) if np.any(whole > 0.0) else 1.0


def warnings(model: ReducedModel, stepping: TimeStepping, estimated: Estimate | None) -> list[str]:
    """What a user should know about a run, a line each."""
    found = []
    if estimated is not None and estimated.chi > REACHED:
        found.append(
            f"load or slide reach the first truncated mode (chi = {estimated.chi:.2f}): more coordinates are worth most"
        )
    fastest = stepping.step * float(np.sqrt(np.max(modal_form(model).omega2, initial=0.0)))
    if stepping.rho_inf == 1.0 and fastest > RESOLVED and model.moving:
        found.append(
            f"the step does not resolve the highest mode (h omega = {fastest:.2g}) and rho_inf = 1 damps nothing: with "
            f"a moving slider this can grow; a smaller step, rho_inf < 1 or fewer coordinates help"
        )
    return found


def _chi(form: ModalForm, run: Trajectory, f: Array, mode: int) -> float:
    """Share of a mode's motion that is not quasi-static."""
    body = form.body
    force = f @ body.B[mode] - np.einsum("tm,tm->t", body.C(run.s)[:, :, mode], run.multipliers)
    motion = _rms(run.q[:, mode])
    return _rms(run.q[:, mode] - force / form.omega2[mode]) / motion if motion > 0.0 else 0.0


def _rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x**2)))
