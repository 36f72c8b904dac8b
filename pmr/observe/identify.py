r"""Parameters of a scene from measured frequencies and damping ratios, by least squares on its reduced model.

.. math::
    \min_p \sum_k \Big( \frac{f_k(p) / \hat f_k - 1}{\sigma_k} \Big)^2, \qquad
    \mathrm{cov}(p) = \max(1, \chi^2 / \nu)\, (J^T J)^{-1}

with measured frequencies or damping ratios :math:`\hat f_k`, their relative standard deviations
:math:`\sigma_k`, the Jacobian J of the residuals and :math:`\nu` degrees of freedom (Seber and Wild,
*Nonlinear Regression*, 1989, section 2.1).
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.optimize

from pmr.errors import InputError, missing_file_reason
from pmr.files.arrays import Array
from pmr.results.quantities import QUANTITIES, unit_text
from pmr.scene.keys import path_unit
from pmr.system.assembly import Assembly
from pmr.system.system import System

HELD_OUT, DEVIATION, PLACE = "held_out", "deviation", "s"
#: Relative standard deviation of measured damping ratios.
DAMPING_DEVIATION = 0.1
#: Smallest and largest value of a parameter, as a share of its start: it keeps its sign.
SHARES = 0.05, 20.0
#: Relative distance to one of the `SHARES` within which a fit has ended there.
AT_BOUND = 1e-3


@dataclass(frozen=True)
class MeasuredFrequencies:
    """Frequencies (m,) in Hz, lowest first, measured at one place of a path; NaN where a mode was not measured.

    Frequencies have to grow, the `deviation` has to be above 0, and damping ratios between 0 and 1; an InputError is
    raised otherwise.
    """

    place: float  # m, or the number of the place in a `FrequencyTable`
    frequencies: tuple[float, ...]  # (m,) Hz
    held_out: bool = False  # whether the place serves to judge the fit, and is not used for it
    deviation: float = 0.002  # relative standard deviation of the frequencies
    damping: tuple[float, ...] = ()  # (d,): damping ratios of the lowest modes; NaN where one was not measured

    def __post_init__(self) -> None:
        measured = [frequency for frequency in self.frequencies if np.isfinite(frequency)]
        if sorted(set(measured)) != measured:
            raise InputError("identify", "frequencies", measured, "frequencies that grow from f1 on are allowed")
        if not self.deviation > 0.0:
            raise InputError("identify", "deviation", self.deviation, "more than 0 is allowed")
        if any(ratio <= 0.0 or ratio >= 1.0 for ratio in self.damping):
            raise InputError("identify", "damping", self.damping, "damping ratios between 0 and 1 are allowed")


@dataclass(frozen=True)
class Identification:
    """Fitted parameters with standard errors, and relative errors of the frequencies at fitted and held-out places.

    A relative error is the ratio of the computed to the measured value, less 1; NaN where nothing was measured.
    Held-out places are not used for the fit; they serve to judge it.  Columns of m frequencies come first, then those
    of d damping ratios.
    """

    names: tuple[str, ...]  # of the p parameters
    values: Array  # (p,): of the parameters, after the fit
    errors: Array  # (p,): standard errors, infinite where the frequencies don't tell the parameter
    correlation: Array  # (p, p): of the errors of the parameters
    fitted: Array  # (k, m + d): relative errors, a row for each place that was fitted
    held_out: Array  # (l, m + d): the same, a row for each place that was held out
    start: Array  # (k + l, m + d): the same before the fit, for all places in the order in which they were given
    bounded: tuple[str, ...] = ()  # names of parameters whose fit ended at one of the `SHARES` of their start

    def overrides(self) -> list[str]:
        """Fitted parameters as texts ``key=value``, with which ``--set`` and `pmr.load_scene` change a scene."""
        return [f"{name}={float(value)!r}" for name, value in zip(self.names, self.values, strict=True)]


def identify(
    frequencies: Callable[[Mapping[str, float], Sequence[float]], Array],
    start: Mapping[str, float],
    measured: Sequence[MeasuredFrequencies],
) -> Identification:
    """Fit parameters of a model to measured frequencies, and to damping ratios if some were measured.

    The fit keeps each parameter between 0.05 and 20 times its value at the start (`SHARES`).

    Parameters
    ----------
    frequencies : callable
        Function from values of all parameters, by name, and places (S,) in m to frequencies (S, r) in Hz, lowest first.
        Where damping was measured, it returns (S, m + d): frequencies, then damping ratios.
    start : mapping of str to float
        Values of the parameters at the start, not zero: they are changed in proportion.
    measured : sequence of MeasuredFrequencies
        One for each of the S places.

    Raises
    ------
    InputError
        If there is no parameter, a value at the start is zero, there are fewer measured frequencies than parameters, or
        the model has fewer frequencies than were measured.
    """
    names, first = tuple(start), np.array([*start.values()], float)
    if not names or not np.all(np.isfinite(first) & (first != 0.0)):
        raise InputError("identify", "start", dict(start), "one finite number or more, other than zero, are allowed")
    m = max((len(each.frequencies) for each in measured), default=0)
    d = max((len(each.damping) for each in measured), default=0)
    targets = np.full((len(measured), m + d), np.nan)
    for row, each in zip(targets, measured, strict=True):
        row[: len(each.frequencies)] = each.frequencies
        row[m : m + len(each.damping)] = each.damping
    held = np.array([each.held_out for each in measured], bool)
    used = np.isfinite(targets) & ~held[:, None]
    if used.sum() < len(names) or not np.all(targets[np.isfinite(targets)] > 0.0):
        allowed = f"frequencies above zero, {len(names)} or more that are not held out, are needed"
        raise InputError("identify", "frequencies", int(used.sum()), allowed)
    deviation = np.array([[each.deviation] * m + [DAMPING_DEVIATION] * d for each in measured]).reshape(targets.shape)
    places = [each.place for each in measured]

    def relative(shares: Array) -> Array:
        """Relative errors (k, m + d) of frequencies and damping ratios at k places, NaN where nothing was measured.

        `shares` (p,) are the values of the parameters as multiples of those at the start.
        """
        values = dict(zip(names, (first * shares).tolist(), strict=True))
        return np.asarray(frequencies(values, places)[:, : m + d] / targets - 1.0)

    ones = np.ones(len(names))
    at_start = relative(ones)
    if not np.all(np.isfinite(at_start[np.isfinite(targets)])):
        raise InputError("identify", "frequencies", m, "the model has fewer: more coordinates, or fewer columns")
    fit = scipy.optimize.least_squares(
        lambda shares: (relative(shares) / deviation)[used], ones, bounds=SHARES, diff_step=1e-3, xtol=1e-10, ftol=1e-10
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
    at_bound = np.min(np.abs(np.log(fit.x[:, None] / SHARES)), axis=1) < AT_BOUND
    bounded = tuple(name for name, is_bounded in zip(names, at_bound, strict=True) if is_bounded)
    return Identification(
        names, first * fit.x, errors, covariance / np.outer(scale, scale),
        after[~held], after[held], at_start, bounded,
    )  # fmt: skip


class NumberTable(NamedTuple):
    """Table of numbers from a file, with k columns and n rows."""

    names: tuple[str, ...]  # (k,): of the columns, without units
    values: Array  # (n, k): NaN where a cell is empty
    units: tuple[str, ...]  # (k,): empty where the table says none

    def check_units(self, file: Path, allowed: Mapping[str, str]) -> None:
        """Raise an InputError that names `file` if a column has another unit than `allowed` states for its name.

        `allowed` has units by name.  Columns without a unit are accepted, and columns whose name is not in `allowed`.
        """
        for name, unit in zip(self.names, self.units, strict=True):
            expected = allowed.get(name, unit)
            if unit and unit_text(unit) != unit_text(expected):
                raise InputError(str(file), "columns", f"{name} [{unit}]", f"the unit {expected} is allowed")


#: Units in which tables are read: those of quantities, of times, rates, masses and displacements of probes.
_UNITS = {quantity.unit for quantity in QUANTITIES.values() if quantity.unit}
_UNITS |= {"s", "Hz", "rad/s", "m/s^2", "m^3", "kg", "mm"}
UNITS = tuple(sorted(_UNITS | {unit_text(unit) for unit in _UNITS if unit_text(unit)}))


def read_table(file: Path) -> NumberTable:
    """Read a CSV table of numbers, whose first line has the names of columns with their units in brackets.

    Empty lines are left out; an empty cell is NaN.  Raises InputError for a file that is missing or no text in UTF-8,
    and for a unit that is not in `UNITS`.  For a cell that is no number, or a line of another length, the InputError
    has the number of the line in the file.
    """
    try:
        with file.open(newline="", encoding="utf-8-sig") as stream:
            reader = csv.reader(stream)
            rows = [(reader.line_num, row) for row in reader if row]
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(str(file), "", None, f"a table of text in UTF-8 is allowed: {error}") from None
    except OSError:
        raise InputError(str(file), "", None, missing_file_reason(file)) from None
    headings = rows[0][1] if rows else []
    units = tuple(heading.partition(" [")[2].strip().removesuffix("]") for heading in headings)
    for heading, unit in zip(headings, units, strict=True):
        if unit and unit not in UNITS:
            raise InputError(str(file), "columns", heading, f"one of these units is allowed: {', '.join(UNITS)}")
    names = tuple(heading.partition(" [")[0].strip() for heading in headings)
    values = np.full((max(len(rows) - 1, 0), len(names)), np.nan)
    for number, (line, row) in enumerate(rows[1:]):
        if len(row) != len(names):
            raise InputError(str(file), f"line {line}", len(row), f"{len(names)} cells are allowed")
        for k, cell in enumerate(row):
            try:
                values[number, k] = float(cell) if cell.strip() else np.nan
            except ValueError:
                raise InputError(str(file), f"line {line}, {names[k]}", cell, "a number is allowed") from None
    return NumberTable(names, values, units)


@dataclass(frozen=True)
class FrequencyTable:
    """Measured frequencies at k places, each given by the coordinates of the P paths of a system."""

    paths: tuple[str, ...]  # (P,), or ``s`` for the only path of a system
    places: Array  # (k, P) m, rad on the path of a luffing angle
    measured: tuple[MeasuredFrequencies, ...]  # (k,)

    @classmethod
    def read(cls, file: Path) -> FrequencyTable:
        """Read a CSV table: columns named by paths, or ``s``, then ``f1``, ``f2`` ...  in Hz, lowest first.

        Each row is a place, by its coordinates on the paths in m, or in rad for a luffing angle.  Further columns may
        follow:

        - ``d1``, ``d2`` ...: damping ratios of the lowest modes,
        - ``held_out``: 1 for places that serve to judge the fit and are not used for it,
        - ``deviation``: relative standard deviations of the frequencies.

        Without the last two columns all places are used for the fit, with the deviation of `MeasuredFrequencies`.
        Raises InputError for another table.
        """
        table = read_table(file)
        names, values = table.names, table.values
        modes, ratios = ([name for name in names if re.fullmatch(f"{kind}[1-9][0-9]*", name)] for kind in "fd")
        paths = [name for name in names if name not in (*modes, *ratios, HELD_OUT, DEVIATION)]
        counted = [f"{kind}{k + 1}" for kind, of in (("f", modes), ("d", ratios)) for k in range(len(of))]
        if not modes or [*modes, *ratios] != counted or len(set(names)) < len(names):
            further = f"d1, d2, ..., {HELD_OUT} and {DEVIATION}"
            allowed = f"columns by paths or {PLACE}, then f1, f2, ..., {further}, each once, are allowed"
            raise InputError(str(file), "columns", list(names), allowed)
        shares = dict.fromkeys((*ratios, HELD_OUT, DEVIATION), "1")
        table.check_units(file, dict.fromkeys(modes, "Hz") | shares | {path: path_unit(path) for path in paths})
        of = dict(zip(names, values.T, strict=True))
        held_out, deviation = of.get(HELD_OUT, np.zeros(len(values))), of.get(DEVIATION, np.full(len(values), np.nan))
        places, f, d = (values[:, [names.index(name) for name in columns]] for columns in (paths, modes, ratios))
        if not np.all(np.isfinite(places)) or not np.all(np.isin(held_out, (0.0, 1.0))):
            allowed = f"a number for each path, and 0 or 1 for {HELD_OUT}, are allowed"
            raise InputError(str(file), "values", None, allowed)
        off = np.where(np.isnan(deviation), MeasuredFrequencies.deviation, deviation).tolist()
        try:
            measured = tuple(
                MeasuredFrequencies(k, tuple(f[k].tolist()), bool(held_out[k]), off[k], tuple(d[k].tolist()))
                for k in range(len(values))
            )
        except InputError as error:
            raise InputError(str(file), error.key, error.value, error.allowed) from None
        return cls(tuple(paths), places, measured)

    def identify(self, reduced: Callable[[Sequence[str]], System], start: Mapping[str, float]) -> Identification:
        """Fit keys of a scene to the frequencies of this table; `start` maps the keys to their values at the start.

        `reduced` takes texts ``key=value``, as the option ``--set`` does, and returns the reduced system of the scene
        with these changes.  All contacts count as closed.  Raises the InputErrors of the function `identify`, and one
        for a system with a hoist or with other paths than those of the table.
        """
        count, damped = (len(self.measured[0].frequencies), len(self.measured[0].damping)) if self.measured else (0, 0)

        @cache
        def frequencies(values: tuple[float, ...]) -> Array:
            """Frequencies in Hz, then damping ratios (k, m + d), with these values of the keys in `start`."""
            system = reduced([f"{name}={value!r}" for name, value in zip(start, values, strict=True)])
            if system.hoist:
                allowed = "none is allowed: natural frequencies are those of the boom without its payload"
                raise InputError("identify", "hoist", None, allowed)
            alone = self.paths == (PLACE,) and len(system.paths) == 1
            paths = tuple(system.paths) if alone else self.paths
            if set(paths) != set(system.paths):
                allowed = f"a column for each path is allowed: {', '.join(system.paths) or 'there is none'}"
                raise InputError("identify", "paths", ", ".join(self.paths), allowed)
            x = system.side_coordinates(dict(zip(paths, self.places.T, strict=True)))
            x = np.ascontiguousarray(np.broadcast_to(x, (len(self.places), len(system.sides))))
            assembly = Assembly(system)
            ratios = assembly.damping_ratios(x, damped) if damped else np.empty((len(x), 0))
            return np.hstack([assembly.frequencies(x, count), ratios])

        return identify(
            lambda values, places: frequencies(tuple(values.values()))[np.array(places, int)], start, self.measured
        )
