"""Models that tell the error of another one: with attachment modes for what it bore in a run.

Attachment modes for the loads of a run give what is left out its inertia and damping in their directions
(`pmr.reduced.attachment`), which is nearly the full model, pads that land and lift off included.  Where an impact a
moment earlier changes all that follows, no model tells another one's error: two of these have to agree.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.compare.errors import ROUND_OFF
from pmr.constraints.rows import Row
from pmr.errors import SimulationError
from pmr.reduced.carriers import CarriedRows
from pmr.results.quantities import with_unit
from pmr.system.body import Trajectory
from pmr.system.states import SystemTrajectory
from pmr.system.system import System

Array = NDArray[np.float64]

#: Share of the error that two richer models may differ by where pads lift.
SETTLED = 0.5
#: Steps of a run whose loads are answered, at most, evenly taken from all.
STEPS = 20_000


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
    steps = np.linspace(0, len(run.t) - 1, min(len(run.t), STEPS)).astype(int)
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


def scatter(peaks: Sequence[float]) -> str:
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
        self.warning = scatter(peaks)
