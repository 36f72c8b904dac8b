r"""The compiled simulator: generalized-alpha in modal coordinates, a microsecond or less a step.

.. math::
    M \ddot q + D \dot q + K q + C(s)^T \lambda = B f, \qquad C(s) q + H(s) f - (G(s) + 1/k) \lambda = 0

M, K and D never change: they are diagonalised once (`pmr.simulation.modal`), and a step is r scalar updates and one
m x m solve for the multipliers (`pmr.simulation.native.step`), or a few where rows only push
(`pmr.simulation.native.contact`).  Rayleigh and modal damping stay in the diagonal; a damping that couples the modes
costs two products with an r x r matrix a step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmr.simulation import balance
from pmr.simulation.blocks import Block, Ended, Recorder, Take
from pmr.simulation.excitation import Excitation
from pmr.simulation.modal import ModalForm, modal_form, support_forces
from pmr.simulation.native import residual_inertia as inertial
from pmr.simulation.native import step as kernel
from pmr.simulation.native import system as march_system
from pmr.simulation.native.marching import March, Room, without_pull
from pmr.simulation.start import InitialState, consistent_start
from pmr.simulation.stepping import Progress
from pmr.system.body import SlidingBody, Trajectory, displacement, pushing_rows

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Observation:
    """Chosen outputs of a simulation, at every so many steps."""

    t: Array  # (T,) s
    y: Array  # (T, o) m
    multipliers: Array  # (T, m) N
    seconds: float  # wall time of the solver alone


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
    form = modal_form(body)
    if initial is not None:
        s, s_rate = float(excitation.along(body.domain)[0]), float(excitation.path_rate[0])
        initial = form.start(consistent_start(body, s, s_rate, initial))
    modal = simulate_modal(form, excitation, initial, progress)
    return in_coordinates(body, form, modal, excitation.forces(body.input_names))


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
    """The same, but that nothing is recorded: `take` is told of some thousand steps at a time.

    A body that keeps the inertia of its residual part goes to `pmr.simulation.native.residual_inertia`.  Where rows
    only push, a step is made in parts (`pmr.simulation.contact_step`), of which the last one is told.
    Errors as for `pmr.simulation.Simulator`; that of a motion that grows comes at the end.
    """
    if form.body.flexibility is not None and form.body.flexibility.keeps_inertia:
        return inertial.follow(form, excitation, take, initial, progress)
    march, t = March(form, excitation, initial), excitation.times
    account = balance.Account(form.body, excitation.stepping.steps)

    def taken(first: int, part: Trajectory, f: Array) -> None:
        take(Block(first, part, f, account.add(first, part, f)))

    room = Room(march, t, taken)
    seconds = march.advance(room.steps, march.parts, progress, room.passed)
    return Ended(seconds, account.surplus(march.f[:: march.parts], float(t[1] - t[0]), float(march.s[0]), "march"))


def observe(
    form: ModalForm,
    excitation: Excitation,
    outputs: Sequence[int] | None = None,
    every: int = 1,
) -> Observation:
    """Simulate from rest and keep nothing but outputs (all by default) and multipliers of each `every`-th step.

    Memory is of the order of what is recorded: a long simulation of a large body needs little.  So the energy balance
    that `simulate` checks is not: rigid rows that move may grow unnoticed with rho_inf near 1
    (docs/time_integration.md).  Errors as for `pmr.simulation.Simulator`.
    """
    march, stepping = March(form, excitation, None), excitation.stepping
    parts_ = every * march.parts
    chosen = np.arange(len(form.body.outputs)) if outputs is None else np.asarray(outputs, dtype=np.int64)
    tables = march_system.outputs(form.body, chosen)
    count = stepping.steps // every + 1
    y, multipliers = np.empty((count, len(chosen))), np.empty((count, len(form.body.row_names)))
    multipliers[0] = march.state.multipliers
    y[0] = displacement(form.body, march.start[:1], march.s[:1], multipliers[:1], march.f[:1])[0, chosen]

    def steps(first: int, last: int) -> tuple[int, int]:
        rows = slice((first - 1) // parts_ + 1, (last - 1) // parts_ + 1)
        arrays = march.s[first:last], march.f[first:last], parts_, y[rows], multipliers[rows]
        return kernel.run_observed(march.system, march.scheme, tables, march.state, *arrays)

    seconds = march.advance(steps, parts_, None)
    march.check_finite(y, parts_)
    without_pull(multipliers, pushing_rows(form.body))
    return Observation(excitation.times[::every][:count], y, multipliers, seconds)


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
