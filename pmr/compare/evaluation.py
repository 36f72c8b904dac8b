"""What a simulated motion means: outputs, forces, energies and residuals of its rows, block by block."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmr.compare.booms import Motion, response_of, with_reactions
from pmr.compare.errors import force_round_off, refuse_infinite, round_off
from pmr.reduced.model import ReducedModel
from pmr.results import Energy, Response
from pmr.scene.names import ALONE
from pmr.simulation.balance import blocks, energy
from pmr.simulation.blocks import Block, Ended
from pmr.simulation.modal import support_forces
from pmr.system.body import FullBody, SlidingBody, Trajectory, displacement
from pmr.system.system import System

Array = NDArray[np.float64]


def respond(body: SlidingBody, trajectory: Trajectory, path_rate: Array, loads: Array) -> Response:
    """Outputs, energies and constraint residuals of a trajectory under loads (T, i) in N.

    `path_rate` is s'(t) (T,) in m/s, for the residual at velocity level.  Raises SimulationError if outputs, forces or
    energies overflow.
    """
    evaluation = Evaluation(body, trajectory.t, path_rate, loads)
    for kept in blocks(len(trajectory.t)):
        part, f = trajectory.at(kept), loads[kept]
        with np.errstate(over="ignore", invalid="ignore"):
            energies = energy(body, part, f)
        evaluation(Block(kept.start, part, f, energies))
    return evaluation.response(Ended(trajectory.seconds, trajectory.surplus))


class Evaluation:
    """Takes the blocks of a body's simulation at times t (T,) in s and makes the response of them: no state is kept.

    `path_rate` and `loads` as for `respond`.
    """

    def __init__(self, body: SlidingBody, t: Array, path_rate: Array, loads: Array) -> None:
        self._body, self._t, self._path_rate, self._loads = body, t, path_rate, loads
        self._rows = [number for number in range(len(body.row_names)) if number not in body.held]  # that are contacts
        self._columns: dict[str, Array] = {}
        self._start = 0.0  # path coordinate in m

    def __call__(self, block: Block) -> None:
        """Evaluate a block; raises SimulationError if outputs, forces or energies overflow."""
        body, part, energies = self._body, block.part, block.energy
        rows = slice(block.first, block.first + len(part.t))
        if block.first == 0:
            self._start = float(part.s[0])
        with np.errstate(over="ignore", invalid="ignore"):
            outputs = displacement(body, part.q, part.s, part.multipliers, block.loads)
        refuse_infinite(outputs, part.multipliers, energies.kinetic, energies.strain, energies.external)
        violation, drift = _residuals(body, part, self._path_rate[rows], block.loads)
        self._keep("outputs", rows, outputs)
        self._keep("reactions", rows, self._reactions(part, block.loads))
        self._keep("forces", rows, part.multipliers[:, self._rows])
        self._keep("residual_position", rows, np.abs(violation).max(axis=1))
        self._keep("residual_velocity", rows, np.abs(drift).max(axis=1))
        for name in ("kinetic", "strain", "external"):
            self._keep(name, rows, getattr(energies, name))
        if part.peaks is not None:
            self._keep("peaks", rows, part.peaks[:, self._rows])

    def _reactions(self, part: Trajectory, loads: Array) -> Array:
        """Of rigid supports, (T, h): multipliers of a full body's own rows, else from the equations of motion."""
        if isinstance(self._body, ReducedModel):
            return support_forces(self._body, part, loads)
        assert isinstance(self._body, FullBody)
        return part.multipliers[:, self._body.rows.fixed]

    def response(self, ended: Ended) -> Response:
        """The response, when all blocks are taken."""
        body, columns, end = self._body, self._columns, float(self._t[-1] - self._t[0])
        energies = Energy(*(columns[name] for name in ("kinetic", "strain", "external")))
        motion = Motion({ALONE: columns["outputs"]}, columns["forces"], columns.get("peaks"), energies)
        found = response_of(System.of(body), self._t, motion)
        if body.reactions is not None:
            found = with_reactions(found, {ALONE: body.reactions.supports}, {ALONE: columns["reactions"]})
        return replace(
            found,
            residual_position=columns["residual_position"],
            residual_velocity=columns["residual_velocity"],
            seconds=ended.seconds,
            round_off=round_off({ALONE: body}, self._loads, end),
            force_round_off=force_round_off(body, self._loads, end, self._start),
            surplus=ended.surplus,
        )

    def _keep(self, name: str, rows: slice, values: Array) -> None:
        if name not in self._columns:
            self._columns[name] = np.empty_like(values, shape=(len(self._t), *values.shape[1:]))
        self._columns[name][rows] = values


def _residuals(body: SlidingBody, part: Trajectory, path_rate: Array, loads: Array) -> tuple[Array, Array]:
    """What each row violates, (T, m) in m, and its rate in m/s; NaN where rows have no equation for the latter."""
    q, v, s, multipliers = part.q, part.v, part.s, part.multipliers
    violation = body.apply_rows(s, q) - body.row_compliance * multipliers
    if body.flexibility is not None:
        violation = violation + body.flexibility.row_motion(s, multipliers, loads)
    violation = np.where(np.isnan(body.row_clearance), violation, _overlap(violation - body.row_clearance, multipliers))
    if body.flexibility is not None or np.any(body.row_compliance):
        return violation, np.full_like(violation, np.nan)  # rows that give way have no equation at velocity level
    return violation, body.apply_rows(s, v) + path_rate[:, None] * body.apply_rows(s, q, derivative=1)


def _overlap(excess: Array, multipliers: Array) -> Array:
    """What rows that only push violate, (T, m) in m: where they push any gap, elsewhere a negative one."""
    return np.where(multipliers > 0.0, excess, np.maximum(excess, 0.0))
