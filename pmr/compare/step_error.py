r"""How far the time step itself is off: the same model once more with half the step, a quarter, and so on.

.. math::
    d_k = \lVert y_{h/2^k} - y_{h/2^{k+1}} \rVert, \qquad
    \lVert y_h - y \rVert \approx \lVert y_h - y_{h/2^n} \rVert + d_{n-1} \frac{\rho}{1 - \rho}, \qquad
    \rho = d_{n-1} / d_{n-2}

Generalized-alpha is of second order, so rho tends to 1/4 (Richardson's extrapolation) for motions that the steps
resolve, and to about 1/2 behind kinks and jumps.  Where it is above 0.6, the steps don't resolve the motion yet and
are halved again: two runs of which both miss it may agree.  Halving is what tells, doubling would not: a tone that h
can't tell from a slower one is none that 2 h can.

Reduced and full model take the same steps, so no comparison of the two shows this error.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.compare.halved_steps import Ladder, Runs
from pmr.errors import SimulationError
from pmr.reduced.model import ReducedModel
from pmr.simulate.excitation import Excitation
from pmr.simulate.modal import modal_form
from pmr.system.body import pushing_rows

Array = NDArray[np.float64]

#: Share of the motion above which a step is called too coarse.
LIMIT = 0.02


@dataclass(frozen=True)
class StepError:
    """Error that the time step leaves in a model's displacements.

    Attributes
    ----------
    beam, tip : float
        Along the beam and at the tip, fractions of the finest run's motion; not capped.
    largest : float or None, m
        Largest difference of any output at any time; None by `mean`.
    finest : float, s
        Smallest step that was taken.
    settled : bool
        Whether the runs approach each other; if not, the error is at least of this size.
    by : str
        ``motion``; or ``mean``, where rows only push and the runs part after an impact: error of the RMS values then.
    enough : float or None, s
        Largest of the steps taken with an error below `LIMIT`.
    band : float, Hz
        Frequency above which 1 % of the tip's motion lies, as the finest run has it.
    seconds : float
        Wall time of all runs.
    """

    beam: float
    tip: float
    largest: float | None
    finest: float
    settled: bool
    by: str
    enough: float | None
    band: float
    seconds: float


def step_error(model: ReducedModel, excitation: Excitation, tips: int = 1) -> StepError:
    """Error of the time step, from rest; the last `tips` displacements are the tip's.

    `march` makes the runs; Exudyn's solver has the same scheme and start.

    Raises
    ------
    InputError
        As for `pmr.simulate.Simulator`.
    SimulationError
        If one of the first two runs fails, or the second would be too long.
    """
    begin = time.perf_counter()
    runs = Runs(modal_form(model), excitation)
    y = runs.next()
    if not runs.affordable:
        raise SimulationError("a run with half the step is too long to be made only to estimate this error")
    moving, mean = Ladder(y), Ladder(_rms(y))
    while runs.affordable and not (moving.halvings(LIMIT) is not None and runs.resolved):
        try:
            y = runs.next()
        except SimulationError:
            if not moving.differences:
                raise
            break
        moving.add(y)
        mean.add(_rms(y))
    ladder = mean if pushing_rows(model) and not moving.settled else moving
    halvings = ladder.halvings(LIMIT) if runs.resolved else None
    return StepError(
        beam=ladder.error(slice(None)),
        tip=ladder.error(slice(-tips, None)),
        largest=float(np.abs(ladder.first - ladder.last).max()) if ladder is moving else None,
        finest=runs.stepping.step,
        settled=ladder.settled and runs.resolved,
        by="motion" if ladder is moving else "mean",
        enough=None if halvings is None else excitation.stepping.step / 2**halvings,
        band=runs.band(tips),
        seconds=time.perf_counter() - begin,
    )


def _rms(y: Array) -> Array:
    """Of each output over time, (1, o)."""
    return np.asarray(np.sqrt(np.mean(y**2, axis=0, keepdims=True)))
