"""What a simulated motion means: outputs, forces, energies and residuals of its rows, block by block."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmr.compare.errors import force_round_off, refuse_infinite, round_off
from pmr.reduced.model import ReducedModel
from pmr.results import Energy, Response
from pmr.scene.names import ALONE
from pmr.simulation.balance import blocks, energy
from pmr.simulation.blocks import Block, Ended
from pmr.simulation.columns import called
from pmr.simulation.modal import support_forces
from pmr.system.body import (
    FullBody,
    SlidingBody,
    Trajectory,
    displacement,
    force_outputs,
    length_outputs,
    other_outputs,
    released_rows,
)

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
        self._force, self._length, self._others = force_outputs(body), length_outputs(body), other_outputs(body)
        self._released = released_rows(body)
        self._columns: dict[str, Array] = {}
        self._start = 0.0  # path coordinate in m

    def __call__(self, block: Block) -> None:
        """Evaluate a block; raises SimulationError if outputs, forces or energies overflow."""
        body, part, energies = self._body, block.part, block.energy
        rows = slice(block.first, block.first + len(part.t))
        if block.first == 0:
            self._start = float(part.s[0])
        with np.errstate(over="ignore", invalid="ignore"):
            outputs = displacement(body, part.q, part.s, part.deforming, block.loads)
        refuse_infinite(outputs, part.multipliers, energies.kinetic, energies.strain, energies.external)
        violation, drift = _residuals(body, part, self._path_rate[rows], block.loads)
        forces = outputs[:, self._force]
        self._keep("displacement", rows, outputs[:, self._length])
        others = np.hstack([outputs[:, self._others], self._reactions(part, block.loads)])
        if others.shape[1]:
            self._keep("others", rows, others)
        self._keep("slider_force", rows, np.hstack([forces, part.multipliers[:, self._released]]))
        self._keep("residual_position", rows, np.abs(violation).max(axis=1))
        self._keep("residual_velocity", rows, np.abs(drift).max(axis=1))
        for name in ("kinetic", "strain", "external"):
            self._keep(name, rows, getattr(energies, name))
        if part.peaks is not None:
            self._keep("force_peaks", rows, np.hstack([forces, part.peaks[:, self._released]]))

    def _reactions(self, part: Trajectory, loads: Array) -> Array:
        """Of rigid supports, (T, h): multipliers of a full body's own rows, else from the equations of motion."""
        if isinstance(self._body, ReducedModel):
            return support_forces(self._body, part, loads)
        assert isinstance(self._body, FullBody)
        return part.multipliers[:, self._body.rows.fixed]

    def response(self, ended: Ended) -> Response:
        """The response, when all blocks are taken."""
        body, columns = self._body, dict(self._columns)
        end = float(self._t[-1] - self._t[0])
        names, reactions = called(body, [body.row_names[k] for k in self._released]), body.reactions
        names = names if reactions is None else names.with_reactions(reactions.names, reactions.units)
        energies = Energy(*(columns.pop(name) for name in ("kinetic", "strain", "external")))
        return Response(
            t=self._t,
            x=body.output_positions[self._length],
            energy=energies,
            seconds=ended.seconds,
            round_off=round_off({ALONE: body}, self._loads, end),
            force_round_off=force_round_off(body, self._loads, end, self._start),
            surplus=ended.surplus,
            output_names=names.moved,
            output_units=("m",) * len(names.moved),
            force_names=names.forces,
            other_names=names.others,
            other_units=names.other_units,
            kinds=names.all_kinds,
            bodies=(ALONE,) * len(names.all_kinds),
            **columns,
        )

    def _keep(self, name: str, rows: slice, values: Array) -> None:
        if name not in self._columns:
            self._columns[name] = np.empty_like(values, shape=(len(self._t), *values.shape[1:]))
        self._columns[name][rows] = values


def _residuals(body: SlidingBody, part: Trajectory, path_rate: Array, loads: Array) -> tuple[Array, Array]:
    """What each row violates, (T, m) in m, and its rate in m/s; NaN where rows have no equation for the latter."""
    q, v, s, multipliers = part.q, part.v, part.s, part.deforming
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
