r"""Parameters of a scene from measured frequencies, by least squares on its reduced model.

.. math::
    \min_p \sum_k \Big( \frac{f_k(p) / \hat f_k - 1}{\sigma_k} \Big)^2, \qquad
    \mathrm{cov}(p) = \max(1, \chi^2 / \nu)\, (J^T J)^{-1}

with measured frequencies :math:`\hat f_k`, their relative standard deviations :math:`\sigma_k`, the Jacobian J of the
residuals and :math:`\nu` degrees of freedom (Seber and Wild, *Nonlinear Regression*, 1989, section 2.1).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.optimize

from pmr.errors import InputError
from pmr.files.arrays import Array


@dataclass(frozen=True)
class MeasuredFrequencies:
    """Frequencies (m,) in Hz, lowest first, measured with a path at a place; NaN where a mode was not measured."""

    place: float  # m
    frequencies: tuple[float, ...]  # (m,) Hz
    held_out: bool = False  # whether the fit is judged by it, not made
    deviation: float = 0.002  # relative standard deviation


@dataclass(frozen=True)
class Identification:
    """Fitted parameters with standard errors, and relative errors of frequencies that were fitted and held out."""

    names: tuple[str, ...]
    values: Array  # (p,)
    errors: Array  # (p,): standard errors, infinite where the frequencies don't tell the parameter
    correlation: Array  # (p, p)
    fitted: Array  # (k, m): relative errors of frequencies, a row for each place that was fitted
    held_out: Array  # (l, m): a row for each place that was held out
    start: Array  # (k + l, m): before the fit, in the order in which they were given

    def overrides(self) -> list[str]:
        """Changes of a scene to the fitted values, as ``--set`` and `pmr.load_scene` take them."""
        return [f"{name}={float(value)!r}" for name, value in zip(self.names, self.values, strict=True)]


def identify(
    frequencies: Callable[[Mapping[str, float], Sequence[float]], Array],
    start: Mapping[str, float],
    measured: Sequence[MeasuredFrequencies],
) -> Identification:
    """Fit parameters of a model to measured frequencies.

    Parameters
    ----------
    frequencies : callable
        Function from values of all parameters, by name, and places (S,) in m to frequencies (S, r) in Hz, lowest first.
    start : mapping of str to float
        Values of the parameters at the start, not zero: they are changed in proportion.
    measured : sequence of MeasuredFrequencies

    Raises
    ------
    InputError
        If a value at the start is zero, or there are fewer measured frequencies than parameters.
    """
    names, first = tuple(start), np.array([*start.values()], float)
    if not np.all(np.isfinite(first) & (first != 0.0)):
        raise InputError("identify", "start", dict(start), "finite numbers beside zero are allowed")
    m = max((len(each.frequencies) for each in measured), default=0)
    targets = np.full((len(measured), m), np.nan)
    for row, each in zip(targets, measured, strict=True):
        row[: len(each.frequencies)] = each.frequencies
    held = np.array([each.held_out for each in measured], bool)
    used = np.isfinite(targets) & ~held[:, None]
    if used.sum() < len(names) or not np.all(targets[np.isfinite(targets)] > 0.0):
        allowed = f"frequencies above zero, {len(names)} or more that are not held out, are needed"
        raise InputError("identify", "frequencies", int(used.sum()), allowed)
    deviation = np.array([[each.deviation] for each in measured])
    places = [each.place for each in measured]

    def relative(shares: Array) -> Array:
        """Relative errors (k, m) of the model's frequencies."""
        values = dict(zip(names, (first * shares).tolist(), strict=True))
        return np.asarray(frequencies(values, places)[:, :m] / targets - 1.0)

    fit = scipy.optimize.least_squares(
        lambda shares: (relative(shares) / deviation)[used],
        np.ones(len(names)),
        bounds=(0.05, 20.0),  # a parameter keeps its sign
        diff_step=1e-3,
        xtol=1e-10,
        ftol=1e-10,
    )
    after = relative(fit.x)
    spread = max(1.0, 2.0 * fit.cost / max(1, used.sum() - len(names)))
    _, sizes, V = np.linalg.svd(fit.jac, full_matrices=False)
    with np.errstate(divide="ignore", invalid="ignore"):
        weak = sizes < 1e-8 * sizes.max()
        covariance = spread * (V.T * np.where(weak, 0.0, sizes**-2.0)) @ V
    errors = np.abs(first) * np.sqrt(np.diagonal(covariance))
    errors = np.where(np.any(np.abs(V[weak]) > 1e-3, axis=0), np.inf, errors)
    scale = np.sqrt(np.maximum(np.diagonal(covariance), 1e-300))
    return Identification(
        names, first * fit.x, errors, covariance / np.outer(scale, scale),
        after[~held], after[held], relative(np.ones(len(names))),
    )  # fmt: skip
