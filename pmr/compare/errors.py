r"""Errors of responses against reference responses, bounds of their round-off, and the band of a motion.

.. math::
    e_{NRMS}(s, r) = \frac{1}{|N|} \sum_{i \in N}
        \frac{\sqrt{\frac{1}{J} \sum_j (s_{ij} - r_{ij})^2}}{\sqrt{\frac{1}{J} \sum_j r_{ij}^2}}, \qquad
    e_{abs}(s, r) = \lVert s - r \rVert

s is the signal, r the reference, i the component, j the time step and J the number of steps.  N is the set of
components that move.  Weyrer, Gerstmayr, Mikkola, Orzechowski: Model Order Reduction of a Sliding Beam using a Global
Basis, section "Experiments", counts components whose reference has an RMS above 1e-10 m, which leaves out the pinned
node.  Here components count whose reference has an RMS above 1e-6 of the largest one, because a limit in m would treat
every motion of a small structure as zero.  In the paper an error above 1 counts as 1 (`nrms`); elsewhere it stays, so
that a growing motion can be recognised.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from pmr.errors import SimulationError
from pmr.files.arrays import Array
from pmr.results import Response

#: Share of a displacement or force that may remain as round-off if its contributions cancel: tens of thousands of units
#: of double precision.  BLAS routines leave up to 1.6e-12 of a displacement.
ROUND_OFF = 1e-11
#: Function that returns the error of a signal against a reference of the same shape.
Measure = Callable[[Array, Array], float]
ResponseFunction = Callable[[Response], Array]
#: Names of models; of two responses, the one whose model comes later here is the reference.
ORDER = ("reduced", "full", "ancf")

#: Components whose reference RMS does not exceed this share of the largest one are left out of e_NRMS: a direction in
#: which nothing happens holds round-off only.
RELATIVE_FLOOR = 1e-6
#: Norm of a reference above which the squares of all components that count neither underflow nor lose digits.
LEAST = 1e-130


def largest_absolute(values: Array, axis: int | None = 0) -> Any:
    """Largest absolute value of `values` (any shape) along `axis`; NaN if an entry is NaN, and 0 without entries.

    With an `axis` of 0 the result has a value for each column, with None one for all entries.  The value is computed
    from maximum and minimum, which saves the memory of an array of absolute values.
    """
    return np.maximum(values.max(axis=axis, initial=0.0), -values.min(axis=axis, initial=0.0))


class Pair(NamedTuple):
    """A signal and its reference, (T, o) or (T,) each, in the same unit."""

    signal: Array
    reference: Array


def clear_round_off(values: Array, round_off: float | Array) -> Array:
    """`values` (T, o) with zeros in columns that never exceed `round_off`; columns with NaN stay.

    `round_off` is one value, or one for each column (o,), in the unit of the values.  A single output (T,) is one
    column.  The array itself is returned if nothing changes.
    """
    still = largest_absolute(values) <= round_off
    return np.where(still, 0.0, values) if np.any(still) else values


def zero_round_off(signal: Array, reference: Array, round_off: float | Array) -> Pair:
    """`signal` and `reference` (T, o), each by itself with zeros in columns of round-off, as by `clear_round_off`.

    A reference that is nothing but round-off thus counts as zero.
    """
    return Pair(clear_round_off(signal, round_off), clear_round_off(reference, round_off))


def relative_error(signal: Array, reference: Array) -> float:
    """RMS of the difference divided by the RMS of the reference, the mean of all components that move; a fraction.

    The result is e_NRMS of the module's docstring; it may exceed 1.  Signal and reference have the shape (T,) or
    (T, M): T times, M components.  If squares of the values would leave the range of double precision, both are divided
    by the largest absolute value of the reference first.  If the reference is zero throughout, the error is 0 if the
    signal is zero too, and 1 otherwise.  Raises ValueError if the shapes differ; SimulationError if a value is not
    finite.
    """
    if signal.shape != reference.shape:
        raise ValueError(f"shapes {signal.shape} and {reference.shape} differ")
    with np.errstate(over="ignore", invalid="ignore"):  # the difference may be infinite
        difference = signal - reference
        scale, error = _norms_over_time(reference), _norms_over_time(difference)
        if not (np.isfinite(error).all() and LEAST < np.max(scale, initial=0.0) < np.inf):
            unit = float(largest_absolute(reference, None))
            refuse_infinite(np.array([unit, largest_absolute(signal, None)]))
            if unit == 0.0:
                return float(np.any(signal))
            scale, error = _norms_over_time(reference / unit), _norms_over_time(difference / unit)
    counted = scale > RELATIVE_FLOOR * float(scale.max())
    return float(np.mean(error[counted] / scale[counted]))


def nrms(signal: Array, reference: Array) -> float:
    """Error of a signal against a reference as the paper has it: `relative_error`, or 1 if that is larger."""
    return min(relative_error(signal, reference), 1.0)


def _norms_over_time(values: Array) -> Any:
    """Norm (...) of each component of `values` (T, ...): the root of the sum of the squares at the T times."""
    return np.sqrt(np.einsum("t...,t...->...", values, values))


def absolute_error(signal: Array, reference: Array) -> float:
    """Error e_abs in the unit of the signals: the norm of `signal` - `reference`, at T times, (T,) or (T, M) each.

    Raises SimulationError if a value of the difference, or its norm, is not finite.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        difference = np.asarray(signal) - np.asarray(reference)
        unit = float(np.abs(difference).max(initial=0.0))
        norm = unit * float(np.linalg.norm(difference / unit)) if unit > 0.0 else 0.0
    refuse_infinite(np.array(unit), np.array(norm))
    return norm


def largest_difference(signal: Array, reference: Array) -> float:
    """Return the largest absolute value of `signal` - `reference` at T times, (T,) or (T, M) each, in their unit.

    Raises SimulationError if a value of the difference is not finite.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        largest = float(largest_absolute(np.asarray(signal) - np.asarray(reference), None))
    refuse_infinite(np.array(largest))
    return largest


def refuse_infinite(*values: Array) -> None:
    """Raise a SimulationError if a value in one of the arrays is NaN or infinite."""
    if not all(np.isfinite(largest_absolute(array, None)) for array in values):
        raise SimulationError(
            "the simulation gave values that are not finite: loads or motions are too large for double precision"
        )


def observed_quantities(tips: int, columns: slice) -> Mapping[str, ResponseFunction]:
    """Functions of a response, by name, that return compared quantities of a single body, k columns (T, k) each.

    ``tip`` returns the last `tips` columns of the displacements in m.  ``beam`` returns the columns of the
    displacements in the slice `columns`, which may include the tip's.  ``pad_force`` returns all contact forces in N.
    """
    return {
        "tip": lambda response: response.displacement[:, -tips:],
        "beam": lambda response: response.displacement[:, columns],
        "pad_force": lambda response: response.slider_force,
    }


def errors_between(
    responses: Mapping[str, Response],
    quantities: Mapping[str, ResponseFunction],
    measure: Measure = relative_error,
) -> dict[str, dict[str, float]]:
    """Errors of all pairs of models, as ``{"reduced_vs_full": {"tip": ..., "beam": ..., "pad_force": ...}, ...}``.

    `responses` maps names of models, those in `ORDER`, to their responses.  `measure` is `relative_error` (fractions)
    or `absolute_error` (m for displacements, N for forces).  `quantities` are functions of a response by the name of
    the quantity that they return.  In each pair, the model that comes later in `ORDER` is the reference.  All further
    outputs that both responses have, such as probes and reactions, are compared too, under their own names.

    A kink of the path is a blow on the beam.  The part of this blow that the reduced model can't follow makes the full
    model vibrate at frequencies above those of the reduced model; forces show that, displacements hardly do
    (docs/paper.md).
    """
    return errors_of_pairs(compared_pairs(responses, quantities), measure)


def errors_of_pairs(pairs_of_models: Mapping[str, Mapping[str, Pair]], measure: Measure) -> dict[str, dict[str, float]]:
    """Errors by pair of models and quantity, by `measure`, from pairs (signal, reference).

    `pairs_of_models` are the pairs as `compared_pairs` returns them.
    """
    return {between: {name: measure(*pair) for name, pair in of.items()} for between, of in pairs_of_models.items()}


def compared_pairs(
    responses: Mapping[str, Response], quantities: Mapping[str, ResponseFunction]
) -> dict[str, dict[str, Pair]]:
    """Pairs (signal, reference), each (T, o), that `errors_between` compares, by ``<a>_vs_<b>`` and quantity.

    `responses` are the responses by model; models that are not in `ORDER` are ignored.  `quantities` are the functions
    that take a quantity, o columns, from a response.  Columns of signal or reference that do not exceed round-off are
    set to 0.  Of the contact forces, only those that both responses have are compared; without any there is no
    ``pad_force``.  Each further output that both have, such as a probe or a reaction, is a pair too, under its own
    name.
    """
    present = [name for name in ORDER if name in responses]
    pairs_of_models = dict[str, dict[str, Pair]]()
    least = max((response.round_off for response in responses.values()), default=0.0)
    least_force = max((response.force_round_off for response in responses.values()), default=0.0)
    for a, b in combinations(present, 2):
        signal, reference = _without_round_off(with_common_forces(responses[a], responses[b]), least, least_force)
        pairs = {name: Pair(quantity(signal), quantity(reference)) for name, quantity in quantities.items()}
        if not signal.slider_force.size:  # a body without pads and sliders
            pairs.pop("pad_force", None)
        pairs_of_models[f"{a}_vs_{b}"] = pairs | _other_pairs(responses[a], responses[b], least_force)
    return pairs_of_models


def _other_pairs(response: Response, reference: Response, force: float) -> dict[str, Pair]:
    """Pairs (signal, reference), (T,) each, of further outputs that both responses have, by the outputs' names.

    Further outputs are probes, reactions and the like.  A signal or reference is replaced by zeros if it is round-off.
    This is so up to `RELATIVE_FLOOR` times the largest output in the same unit.  In N and N m it is also so up to
    `force`, the round-off of forces, and up to `ROUND_OFF` times the largest output in N or N m.
    """
    units = dict(zip(response.other_names, response.other_units, strict=True))
    common = [name for name in units if name in reference.other_names]
    pairs = {name: Pair(response.other(name), reference.other(name)) for name in common}
    sizes = {name: max(float(largest_absolute(values)) for values in pair) for name, pair in pairs.items()}
    forces = [size for name, size in sizes.items() if units[name] in ("N", "N m")]
    force = max(force, ROUND_OFF * max(forces, default=0.0))
    for name, pair in pairs.items():
        least = RELATIVE_FLOOR * max(size for other_name, size in sizes.items() if units[other_name] == units[name])
        least = max(least, force) if units[name] in ("N", "N m") else least
        pairs[name] = zero_round_off(*pair, least)
    return pairs


class ResponsePair(NamedTuple):
    """A response, `signal`, and the one with which it is compared, `reference`."""

    signal: Response
    reference: Response


def with_common_forces(first: Response, second: Response) -> ResponsePair:
    """Responses `first` and `second`, both with only those contact forces that both have, in the order of `first`.

    Both are returned unchanged if one of them has no names of forces, or if the names are equal.
    """
    if not (first.force_names and second.force_names) or first.force_names == second.force_names:
        return ResponsePair(first, second)
    common = [name for name in first.force_names if name in second.force_names]
    pair = (of.with_forces([of.force_names.index(name) for name in common]) for of in (first, second))
    return ResponsePair(*pair)


def _without_round_off(pair: ResponsePair, least: float, force: float) -> ResponsePair:
    """Both responses of a `pair`, with zeros in all columns of displacements and forces that don't exceed round-off.

    The round-off of displacements is `least` in m.  The round-off of forces is the larger of `force` in N and
    `ROUND_OFF` times the largest force.
    """
    signal, reference = pair
    x, y = zero_round_off(signal.displacement, reference.displacement, least)
    size = max(float(largest_absolute(response.slider_force, None)) for response in pair)
    f, g = zero_round_off(signal.slider_force, reference.slider_force, max(force, ROUND_OFF * size))
    signal = replace(signal, displacement=x, slider_force=f)
    return ResponsePair(signal, replace(reference, displacement=y, slider_force=g))


#: Histories (T,) of forces or moments: by kind and unit, such as ``("pad_force", "N")``, then by name.
ForceHistories = dict[tuple[str, str], dict[str, Array]]

#: Share of the largest norm of all kinds of forces: errors of kinds with a smaller norm are relative to this share.
LITTLE_FORCE = 1e-3
#: Units of forces and moments.
FORCE_UNITS = ("N", "N m")


def force_histories(response: Response) -> ForceHistories:
    """Histories (T,) of all forces of a response, by kind and unit, then by name.

    Keys are such as ``("pad_force", "N")`` or ``("reaction", "N m")``.  Forces of contacts are those at the ends of
    steps; for pads that only push, the peaks within steps are larger.
    """
    forces = ForceHistories()
    first = len(response.output_names)
    for number, output in enumerate(response.outputs):
        if output.is_force:
            values = response.slider_force[:, number - first]
            forces.setdefault((f"{output.kind}_force", "N"), {})[output.name] = values
        elif output.kind == "reaction" and output.unit in FORCE_UNITS:
            forces.setdefault((output.kind, output.unit), {})[output.name] = response.column(number)
    return forces


def force_errors(
    forces: Mapping[tuple[str, str], Mapping[str, Array]], reference: Mapping[tuple[str, str], Mapping[str, Array]]
) -> dict[str, float]:
    r"""Errors by kind, fractions, of the forces that occur in both; for a kind with moments too, the larger error.

    .. math::
        e = \frac{\lVert f - r \rVert}{\max(\lVert r \rVert,\; 10^{-3} \max_k \lVert r_k \rVert)}

    with the forces f and their reference r over all forces of a kind and all times; r_k are the reference forces of
    each kind k in the same unit.  So the error of a kind with very small forces, such as that of a cylinder that holds
    still, is relative to `LITTLE_FORCE` times the largest kind.  Kinds are left out if the norms of all kinds in their
    unit are at most `ROUND_OFF` times the largest norm in any unit, as moments about the axis of a straight boom are.
    """
    pairs = dict[tuple[str, str], tuple[float, float]]()
    for key in (key for key in forces if key in reference):
        names = [name for name in forces[key] if name in reference[key]]
        if names:
            y, r = (np.array([of[key][name] for name in names]) for of in (forces, reference))
            scale = float(np.abs(r).max(initial=0.0)) or 1.0  # scaled, so that squares neither vanish nor overflow
            pairs[key] = scale * float(np.linalg.norm((y - r) / scale)), scale * float(np.linalg.norm(r / scale))
    errors, least = dict[str, float](), ROUND_OFF * max((size for _, size in pairs.values()), default=0.0)
    for (kind, unit), (apart, size) in pairs.items():
        largest = max(other for (_, of), (_, other) in pairs.items() if of == unit)
        if largest > least:
            errors[kind] = max(errors.get(kind, 0.0), apart / max(size, LITTLE_FORCE * largest))
    return errors


def band_limit(y: Array, step: float) -> float:
    """Frequency in Hz above which signals y (T, o) have 1 % of their RMS; 0 if all are constant.

    The mean of each signal is removed first, and its ends are faded out by a Hann window.  The RMS is that of all
    signals together, so all have to be in one unit.  `step` is the time between samples in s.
    """
    from scipy.fft import next_fast_len  # imported here: it is slow to import and rarely needed

    window, count = np.hanning(len(y))[:, None], next_fast_len(len(y), real=True)
    power = np.sum(np.abs(np.fft.rfft((y - y.mean(axis=0)) * window, n=count, axis=0)) ** 2, axis=1)
    above = np.cumsum(power[::-1])[::-1]  # from each frequency on
    if above[0] <= 0.0:
        return 0.0
    return float(np.flatnonzero(above > 1e-4 * above[0])[-1] / (count * step))


def band_of_response(response: Response) -> float:
    """Band in Hz of the motion of a response: `band_limit` of the last displacement, which is the tip's.

    If the tip moves by round-off only, as on a support, the band is the `band_limit` of all displacements.
    """
    tip, step = response.displacement[:, -1:], float(response.t[1] - response.t[0])
    return band_limit(tip if np.ptp(tip) > response.round_off else response.displacement, step)


def error_below_frequency(signal: Array, reference: Array, step: float, highest: float) -> float:
    """Error (`relative_error`) of a signal (T, o) against a reference (T, o), without frequencies above `highest`.

    Frequencies above `highest` in Hz are removed from both before.  `step` is the time between samples in s.
    """
    too_high = np.fft.rfftfreq(len(signal), step) > highest
    spectra = [np.fft.rfft(values, axis=0) for values in (signal, reference)]
    for spectrum in spectra:
        spectrum[too_high] = 0.0
    slow, slow_reference = (np.fft.irfft(spectrum, n=len(signal), axis=0) for spectrum in spectra)
    return relative_error(slow, slow_reference)
