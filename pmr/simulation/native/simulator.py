r"""The compiled simulator of a body alone: generalized-alpha in modal coordinates, a microsecond or less a step.

.. math::
    M \ddot q + D \dot q + K q + C(s)^T \lambda = B f, \qquad C(s) q + H(s) f - (G(s) + 1/k) \lambda = 0

M, K and D never change: they are diagonalised once (`pmr.simulation.modal`), and a step is r scalar updates and one
m x m solve for the multipliers (`pmr.simulation.native.step`), or a few where rows only push
(`pmr.simulation.native.contact`).  Rayleigh and modal damping stay in the diagonal; a damping that couples the modes
costs two products with an r x r matrix a step.  The body is simulated as the system of one that it is
(`pmr.simulation.native.march`), from its tables.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.blocks import Block, Ended, Recorder, Take
from pmr.simulation.excitation import Excitation
from pmr.simulation.modal import ModalForm, modal_form, support_forces
from pmr.simulation.native import systems
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.march import March, Steps
from pmr.simulation.native.systems import Observation, start_of
from pmr.simulation.start import InitialState
from pmr.simulation.stepping import Progress
from pmr.system.body import SlidingBody, Trajectory
from pmr.system.contacts import ALONE
from pmr.system.system import System

Array = NDArray[np.float64]


def simulate(
    body: SlidingBody,
    excitation: Excitation,
    initial: InitialState | None = None,
    progress: Progress | None = None,
) -> Trajectory:
    """Simulate a reduced body, or a full one of some thousand coordinates at most.

    Arguments and errors as for `pmr.simulation.Simulator`; the same equations, scheme and start as Exudyn's, so the
    trajectories agree to round-off.  `seconds` is the time of the steps, in modal coordinates; compiling (once on a
    machine), diagonalising and the way back to q are not in it.
    """
    form, recorder = modal_form(body), Recorder(np.arange(excitation.stepping.steps + 1))
    ended = follow_form(SystemForm(System.of(body), {ALONE: form}), excitation, recorder, initial, progress)
    return in_coordinates(body, form, recorder.trajectory(ended), excitation.forces(body.input_names))


def simulate_modal(
    form: ModalForm,
    excitation: Excitation,
    initial: InitialState | None = None,
    progress: Progress | None = None,
) -> Trajectory:
    """Simulate a body that is in modal form already; `initial` and the trajectory are in modal coordinates."""
    recorder = Recorder(np.arange(excitation.stepping.steps + 1))
    return recorder.trajectory(follow(form, excitation, recorder, initial, progress))


def follow(
    form: ModalForm,
    excitation: Excitation,
    take: Take,
    initial: InitialState | None = None,
    progress: Progress | None = None,
) -> Ended:
    """The same, but that nothing is recorded: `take` gets some thousand steps at a time.

    Where rows only push, a step may be made in parts (`pmr.simulation.contact_step`), of which `take` gets the last.
    Errors as for `pmr.simulation.Simulator`; that of a motion that grows comes at the end.
    """
    return follow_form(SystemForm.alone(form), excitation, take, initial, progress)


def follow_form(
    form: SystemForm,
    excitation: Excitation,
    take: Take,
    initial: InitialState | None = None,
    progress: Progress | None = None,
) -> Ended:
    """The same of a system of one; simulations of one form share its tables."""

    def taken(steps: Steps) -> None:
        z, v, multipliers, peaks, parts = steps.record[:5]
        assert steps.energy is not None
        part = Trajectory(steps.t, z, v, multipliers, steps.s[:, 0], seconds=0.0, peaks=peaks, parts=parts)
        take(Block(steps.first, part, steps.f, steps.energy))

    return _march(form, excitation, initial).run(taken, progress)


def observe(
    form: ModalForm,
    excitation: Excitation,
    outputs: Sequence[int] | None = None,
    every: int = 1,
) -> Observation:
    """As `pmr.simulation.native.systems.observe`, of a body in modal form."""
    form.body.ensure_whole("model")
    return systems.observe(SystemForm.alone(form), excitation.on_slider, outputs, every)


def in_coordinates(body: SlidingBody, form: ModalForm, modal: Trajectory, f: Array) -> Trajectory:
    """A trajectory under loads f (T, i) in coordinates of the body, with the multipliers of its supports."""
    multipliers = np.empty((len(modal.t), len(body.row_names)))
    multipliers[:, form.rows] = modal.multipliers
    if body.held:
        assert form.body.reactions is not None
        of_rows = [form.body.reactions.names.index(body.row_names[k]) for k in body.held]
        multipliers[:, list(body.held)] = support_forces(form.body, modal, f)[:, of_rows]
    q, v = modal.q @ form.X.T, modal.v @ form.X.T
    peaks = None
    if modal.peaks is not None:
        peaks = multipliers.copy()
        peaks[:, form.rows] = modal.peaks
    return replace(modal, q=q, v=v, multipliers=multipliers, peaks=peaks)


def _march(form: SystemForm, excitation: Excitation, initial: InitialState | None) -> March:
    form.forms[ALONE].body.ensure_whole("model")
    given, excitation = None if initial is None else {ALONE: initial}, excitation.on_slider
    return March(form, excitation, start_of(form.system, excitation, given))
