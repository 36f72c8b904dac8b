"""Errors of a run's outputs by their source; an observer takes them for standard deviations that widen its bands."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pmr.files.arrays import Summary
from pmr.observe.linear import ACCELERATION, SPECIFIC_FORCE, VELOCITY, LinearMotion
from pmr.results.quantities import QUANTITIES

#: Parts of the error budget of a run, and where `summary.json` has them.
PARTS: Mapping[str, tuple[str, ...]] = {
    "reduction": ("estimate",), "step": ("step",), "mesh": ("budget", "mesh"), "model": ("budget", "model"),
}  # fmt: skip


def output_errors(summary: Summary, motion: LinearMotion, run_step: float | None = None) -> dict[str, dict[str, float]]:
    """Errors of a linear model's outputs, as fractions of their RMS: by part of the error budget, then by output.

    The parts are the keys of `PARTS`.  `summary` is the content of a run's ``summary.json``, and `run_step` the run's
    time step in s.  If the model `motion` has another step, the error of the step is multiplied by the square of the
    ratio of the two steps, since the scheme is of second order.  If `run_step` is None, the error stays as it is.  An
    output that a part does not cover is missing in that part.  Accelerations and velocities have the errors of
    velocities, or those of displacements if the part does not cover velocities.  The result is empty if the summary has
    no error budget.
    """
    errors = dict[str, dict[str, float]]()
    for part, keys in PARTS.items():
        table: Any = summary
        for key in keys:
            table = table.get(key) if isinstance(table, Mapping) else None
        if not isinstance(table, Mapping):
            continue
        of_part = {name: _error_of(table, name, kind) for name, kind in zip(motion.outputs, motion.kinds, strict=True)}
        factor = (motion.step / run_step) ** 2 if part == "step" and run_step else 1.0
        errors[part] = {name: factor * error for name, error in of_part.items() if error is not None}
    return {part: of_part for part, of_part in errors.items() if of_part}


def _error_of(table: Summary, name: str, kind: str) -> float | None:
    """Error, as a fraction, of the output `name` in the `table` of a part of the error budget; None if there is none.

    The table may have several entries that suit the output.  The first one in this order is taken: the probe called
    `name`; the quantity whose columns have the output's `kind` and no other kind; the word `kind` itself.

    Velocities, accelerations and specific forces are told by the beginning of `name`.  For them, the entry of
    velocities and then that of the beam's displacements replace the quantity.
    """
    keys = [key for key, quantity in QUANTITIES.items() if quantity.kinds == (kind,)]
    if name.startswith((VELOCITY, ACCELERATION, SPECIFIC_FORCE)):
        keys = ["velocity", "beam"]
    values = [table.get("probes", {}).get(name), *map(table.get, [*keys, kind])]
    return next((float(value) for value in values if isinstance(value, int | float)), None)
