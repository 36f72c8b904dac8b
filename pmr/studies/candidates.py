"""Models of all methods that are compared, simulated alike."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.simulate import Excitation, TimeStepping
from pmr.simulate.balance import energy
from pmr.simulate.blocks import Recorder
from pmr.simulate.modal import ModalForm, modal_form
from pmr.simulate.native import simulator as march
from pmr.studies import bases, local_bases
from pmr.system.body import displacement, length_outputs

Array = NDArray[np.float64]
LOCAL = ("local", "matrices")
Simulate = Callable[[Excitation, int], local_bases.LocalMotion]  # each so many steps


@dataclass(frozen=True)
class Candidates:
    """What simulates models of one method by their number of coordinates, up to the largest."""

    of: Callable[[int], Simulate]
    largest: int


def candidates(case: bases.Case, method: str) -> Candidates:
    """Of one method: a basis of `pmr.studies.bases`, or local ones."""
    if method not in LOCAL:
        models = bases.MODELS[method](case)
        return Candidates(lambda r: _marched(modal_form(models.of(r))), models.largest)
    if np.any(case.full.row_compliance > 0.0):
        return Candidates(lambda r: _marched(modal_form(case.full)), 0)  # pads that give way hold no modes
    s = local_bases.positions(case.full, case.scene.path_bounds)
    return Candidates(
        lambda r: local_bases.local_model(case.full, s, r, method == "local").simulate, case.full.size // 2
    )


def _marched(form: ModalForm) -> Simulate:
    def simulate(excitation: Excitation, every: int) -> local_bases.LocalMotion:
        recorder = Recorder(np.arange(0, excitation.stepping.steps + 1, every))
        run, f = recorder.trajectory(march.follow(form, excitation, recorder)), excitation.forces(form.body.input_names)
        y = displacement(form.body, run.q, run.s, run.deforming, f[::every])[:, length_outputs(form.body)]
        found = energy(form.body, run, f[::every])
        return local_bases.LocalMotion(y, found.kinetic + found.strain, run.seconds)

    return simulate


def full_energy(case: bases.Case) -> Array:
    """Energy (T,) in J of the full model's motion."""
    body = case.full
    found = energy(body, case.run, case.excitation.forces(body.input_names))
    return np.asarray(found.kinetic + found.strain)


def stepped(excitation: Excitation, factor: float) -> Excitation:
    """The same with a step that is so many times as long."""
    given = excitation.stepping
    return excitation.with_stepping(TimeStepping(given.end, given.step * factor, given.rho_inf))


def observed(form: ModalForm, excitation: Excitation, every: int) -> Array:
    """Displacements (T, o) in m at each `every`-th step."""
    return march.observe(form, excitation, np.flatnonzero(length_outputs(form.body)).tolist(), every).y
