r"""Errors of responses beside references, what of them is round-off, and their frequencies.

.. math::
    e_{NRMS}(s, r) = \min\Big( \frac{1}{|N|} \sum_{i \in N}
        \frac{\sqrt{\frac{1}{J} \sum_j (s_{ij} - r_{ij})^2}}{\sqrt{\frac{1}{J} \sum_j r_{ij}^2}},\; 1 \Big), \qquad
    e_{abs}(s, r) = \lVert s - r \rVert

N holds the components that move.  The publication counts those whose reference has an RMS above 1e-10 m, which leaves
out its pinned node (Weyrer et al., section "Experiments"); here it is those above 1e-6 of the component that moves
most, for a length would call every motion of a small structure nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.errors import SimulationError
from pmr.results import Response
from pmr.simulation.start import dense
from pmr.system.body import SlidingBody, force_outputs, length_outputs, other_outputs, released_rows

Array = NDArray[np.float64]
#: Error of a signal against a reference of the same shape.
Measure = Callable[[Array, Array], float]
Observed = Callable[[Response], Array]
Pair = tuple[Array, Array]
#: Of two responses the later one is the reference.
ORDER = ("reduced", "full", "ancf")

#: Components whose reference RMS does not exceed this share of the largest one are left out of e_NRMS: a direction in
#: which nothing happens holds round-off only.
RELATIVE_FLOOR = 1e-6
#: Size of a reference from which on squares neither vanish nor lose digits, in all of its components that count.
LEAST = 1e-130
#: Share of a displacement or a force that cancels which may be left as round-off: tens of thousands of steps of double
#: precision. Kernels of BLAS leave up to 1.6e-12 of a displacement.
ROUND_OFF = 1e-11
#: N/m: what holds a coordinate lets nothing through.
HOLDS = 1e300
#: Coordinates up to which it is found out what the loads would do to the body.
LARGEST_COMPLIANCE = 500


def nrms(signal: Array, reference: Array) -> float:
    """e_NRMS of a signal (T,) or (T, M) against a reference of the same shape, as a fraction in [0, 1].

    Raises ValueError or SimulationError as `relative_error`.
    """
    return min(relative_error(signal, reference), 1.0)


def relative_error(signal: Array, reference: Array) -> float:
    """RMS of the difference over the RMS of the reference, the mean over all components that move.

    It is e_NRMS without the limit of 1, so that growth can be told.  Where squares would leave the range of numbers,
    the reference's largest value is the unit of both.
    Where the reference is zero throughout: 0 if the signal is too, 1 otherwise.  Raises ValueError if the shapes
    differ; SimulationError if a value is not finite.
    """
    if signal.shape != reference.shape:
        raise ValueError(f"shapes {signal.shape} and {reference.shape} differ")
    with np.errstate(over="ignore", invalid="ignore"):  # infinitely far off is possible
        difference = signal - reference
        scale, error = _lengths(reference), _lengths(difference)
        if not (np.isfinite(error).all() and LEAST < np.max(scale, initial=0.0) < np.inf):
            unit = float(largest(reference, None))
            refuse_infinite(np.array([unit, largest(signal, None)]))
            if unit == 0.0:
                return float(np.any(signal))
            scale, error = _lengths(reference / unit), _lengths(difference / unit)
    counted = scale > RELATIVE_FLOOR * float(scale.max())
    return float(np.mean(error[counted] / scale[counted]))


def _lengths(values: Array) -> Any:
    """Length of each component over all steps."""
    return np.sqrt(np.einsum("t...,t...->...", values, values))


def absolute_error(signal: Array, reference: Array) -> float:
    """e_abs, the euclidean norm of the difference over all steps (and components), in the signals' unit.

    Raises SimulationError if a value is not finite, or the norm isn't.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        difference = np.asarray(signal) - np.asarray(reference)
        unit = float(np.abs(difference).max(initial=0.0))
        norm = unit * float(np.linalg.norm(difference / unit)) if unit > 0.0 else 0.0
    refuse_infinite(np.array(unit), np.array(norm))
    return norm


def refuse_infinite(*values: Array) -> None:
    """Raises SimulationError if anything is not finite."""
    if not all(np.isfinite(largest(array, None)) for array in values):
        raise SimulationError("what was simulated is not finite: loads or motions are too large to be computed with")


def largest(values: Array, axis: int | None = 0) -> Any:
    """The largest size along an axis, or of all; NaN where one is.  What a copy of all sizes would take is left out."""
    return np.maximum(values.max(axis=axis, initial=0.0), -values.min(axis=axis, initial=0.0))


def observed_quantities(tips: int, along: slice) -> Mapping[str, Observed]:
    """Quantities that are compared: the last `tips` columns are the tip's, those `along` the beam may be among them."""
    return {
        "tip": lambda response: response.displacement[:, -tips:],
        "beam": lambda response: response.displacement[:, along],
        "pad_force": lambda response: response.slider_force,
    }


#: Of a planar beam that is observed at its nodes, the last of which is its tip.
AT_NODES = observed_quantities(1, slice(None))


def errors_between(
    responses: Mapping[str, Response],
    measure: Measure = nrms,
    order: tuple[str, ...] = ORDER,
    quantities: Mapping[str, Observed] = AT_NODES,
) -> dict[str, dict[str, float]]:
    """Errors of all pairs: ``{"reduced_vs_full": {"tip": ..., "beam": ..., "pad_force": ...}, ...}``.

    `measure` is `nrms` (fractions) or `absolute_error` (m, and N for the force).  The later one in `order` is the
    reference.  The pinned node, which does not move, counts in no pair.  Outputs in other units are compared by name.

    A kink of the path strikes the beam, and what of the blow a reduced model can't follow rings on at frequencies
    above its own; the force sees that, displacements hardly do (docs/paper.md).
    """
    return errors_of_pairs(compared_pairs(responses, order, quantities), measure)


def errors_of_pairs(pairs_of_models: Mapping[str, Mapping[str, Pair]], measure: Measure) -> dict[str, dict[str, float]]:
    """Errors of pairs of signals, as from `pairs`."""
    return {between: {name: measure(*pair) for name, pair in of.items()} for between, of in pairs_of_models.items()}


def compared_pairs(
    responses: Mapping[str, Response],
    order: tuple[str, ...] = ORDER,
    quantities: Mapping[str, Observed] = AT_NODES,
) -> dict[str, dict[str, Pair]]:
    """Signals and references (T, o) that `errors` compares, by pair and quantity; round-off set to 0."""
    present = [name for name in order if name in responses]
    pairs_of_models = dict[str, dict[str, Pair]]()
    least = max((response.round_off for response in responses.values()), default=0.0)
    least_force = max((response.force_round_off for response in responses.values()), default=0.0)
    for a, b in combinations(present, 2):
        compared_response, reference = _without_round_off(
            *with_common_forces(responses[a], responses[b]), least, least_force
        )
        pairs_of_models[f"{a}_vs_{b}"] = {
            name: (what(compared_response), what(reference)) for name, what in quantities.items()
        }
        pairs_of_models[f"{a}_vs_{b}"] |= _others(responses[a], responses[b], least_force)
    return pairs_of_models


def _others(response: Response, reference: Response, force: float) -> dict[str, Pair]:
    """Other outputs that both know, with zeros where nothing happens beside those of the same unit.

    Reactions are nothing up to `force` in N, or N m, either.
    """
    units = dict(zip(response.other_names, response.other_units, strict=True))
    pairs = {name: (response.other(name), reference.other(name)) for name in units if name in reference.other_names}
    sizes = {name: max(float(largest(values)) for values in pair) for name, pair in pairs.items()}
    for name, pair in pairs.items():
        least = RELATIVE_FLOOR * max(size for other_name, size in sizes.items() if units[other_name] == units[name])
        least = max(least, force) if units[name] in ("N", "N m") else least
        pairs[name] = pair if sizes[name] > least else (np.zeros_like(pair[0]), np.zeros_like(pair[1]))
    return pairs


def with_common_forces(first: Response, second: Response) -> tuple[Response, Response]:
    """Both with the forces that both know, in one order, where both say which is which."""
    if not (first.force_names and second.force_names) or first.force_names == second.force_names:
        return first, second
    common = [name for name in first.force_names if name in second.force_names]

    aligned = [
        response.with_forces([response.force_names.index(name) for name in common]) for response in (first, second)
    ]
    return aligned[0], aligned[1]


def _without_round_off(
    compared_response: Response, reference: Response, least: float, force: float
) -> tuple[Response, Response]:
    """Both with zeros where neither exceeds round-off: such displacements (m) and forces (N) are nobody's error."""
    x, y = zero_round_off(compared_response.displacement, reference.displacement, least)
    size = max(float(largest(response.slider_force, None)) for response in (compared_response, reference))
    f, g = zero_round_off(compared_response.slider_force, reference.slider_force, max(force, ROUND_OFF * size))
    return replace(compared_response, displacement=x, slider_force=f), replace(
        reference, displacement=y, slider_force=g
    )


def zero_round_off(signal: Array, reference: Array, round_off: float | Array) -> tuple[Array, Array]:
    """Two signals (T, o) with zeros in the columns in which neither exceeds round-off, which each may have its own."""
    moves = np.maximum(largest(signal), largest(reference)) > round_off
    if moves.all():
        return signal, reference
    return np.where(moves, signal, 0.0), np.where(moves, reference, 0.0)


def round_off(bodies: Mapping[str, SlidingBody], loads: Array, end: float) -> float:
    r"""Displacement in m that may be round-off alone, where loads (T, i) in N act for `end` seconds.

    .. math:: 10^{-11} \max_o \lVert O_o^T \rVert \sum_i \lVert B_i \rVert \max_t |f_i|, \qquad
        \lVert x \rVert^2 = x^T \big(K + (2 \pi / t_e)^2 M\big)^{-1} x

    By Cauchy and Schwarz the product bounds what the loads do to an output of the bodies with their contacts released,
    in whichever coordinates.  Round-off is a share of that also where a slider cancels it, or where loads along the
    axis don't bend the body at all.  It is linear in the loads, so no motion is too small by itself.  0 for bodies that
    are large.
    """
    return float(ROUND_OFF * _largest_motions(bodies, loads, end, length_outputs).max(initial=0.0))


def probe_round_off(bodies: Mapping[str, SlidingBody], loads: Array, end: float) -> Array:
    """Round-off as in `round_off`, of each output that is neither in m nor in N, (k,) in its unit."""
    return ROUND_OFF * _largest_motions(bodies, loads, end, other_outputs)


def _largest_motions(bodies: Mapping[str, SlidingBody], loads: Array, end: float, which: Callable[[Any], Any]) -> Array:
    """How far each of some outputs (o,) may go; 0 where a body is large."""
    sizes, reach, first = list[Array](), 0.0, 0
    for body in bodies.values():
        chosen, last = which(body), first + body.B.shape[1]
        A = _dynamic_stiffness(body, end)
        reach += np.inf if A is None else _reach(A, body, loads[:, first:last])
        sizes.append(np.zeros(np.count_nonzero(chosen)) if A is None else _norms(A, dense(body.outputs)[chosen]))
        first = last
    sizes_of_outputs = np.concatenate(sizes)
    return sizes_of_outputs * reach if np.isfinite(reach) else np.zeros_like(sizes_of_outputs)


def force_round_off(body: SlidingBody, loads: Array, end: float, s: float) -> float:
    r"""Force in N that may be round-off alone: as `round_off`, of outputs that are forces and of sliders' rows.

    A row's is at most that share of :math:`\lVert B \rVert |f| / \sqrt{\lVert C^T \rVert^2 + G + 1/k}`,
    with C and G at the path coordinate s in m.
    """
    if (A := _dynamic_stiffness(body, end)) is None:
        return 0.0
    rows = released_rows(body)
    C = dense(body.C(s))[rows]
    give = _norms(A, C) ** 2 + np.asarray(body.row_compliance)[rows]
    if body.flexibility is not None:
        give = give + np.diag(body.flexibility.rows(s))[rows]
    stiff = 1.0 / np.sqrt(give[give > 0.0])
    forces = _norms(A, dense(body.outputs)[force_outputs(body)])
    return float(ROUND_OFF * np.concatenate([stiff, forces]).max(initial=0.0) * _reach(A, body, loads))


def _dynamic_stiffness(body: SlidingBody, end: float) -> Array | None:
    """K + (2 pi / end)^2 M, with what supports hold held; None where the body is large."""
    if body.size > LARGEST_COMPLIANCE or not end > 0.0:
        return None
    stiffness = dense(body.K + (2.0 * np.pi / end) ** 2 * body.M)
    held = list(body.held.values())
    stiffness[held] = stiffness[:, held] = 0.0
    stiffness[held, held] = HOLDS
    return stiffness


def _norms(A: Array, rows: Array) -> Array:
    """Norm sqrt(x A^-1 x^T) of each of the rows (r, n)."""
    return np.asarray(np.sqrt(np.maximum(np.einsum("rn,nr->r", rows, np.linalg.solve(A, rows.T)), 0.0)))


def _reach(A: Array, body: SlidingBody, loads: Array) -> float:
    """Sum of all loads' largest values (T, i), each times the norm of its input."""
    return float(_norms(A, np.asarray(body.B).T) @ np.abs(loads).max(axis=0, initial=0.0))


#: Forces, or moments, (T,) by kind and unit, such as ``("pad_force", "N")``, and by their names.
ForceHistories = dict[tuple[str, str], dict[str, Array]]

#: Share of the largest kind's norm below which a kind of forces is measured by that share.
LITTLE_FORCE = 1e-3
#: Units of forces and moments.
FORCE_UNITS = ("N", "N m")


def force_histories(response: Response) -> ForceHistories:
    """All forces of a response by kind, such as ``("pad_force", "N")`` or ``("reaction", "N m")``, and by name.

    Forces at the ends of steps; of pads that only push those are smaller than the peaks within steps.
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
    r"""Errors by kind, fractions, of the forces that both have; the larger one where a kind has forces and moments.

    .. math::
        e = \frac{\lVert f - r \rVert}{\max(\lVert r \rVert,\; 10^{-3} \max_k \lVert r_k \rVert)}

    over all forces of a kind and all times; r_k are the forces of the other kinds in the same unit.  A kind that bears
    next to nothing, such as a cylinder that holds still, is measured by what the others bear.
    Kinds of which all forces of the reference are zero are left out.
    """
    pairs = dict[tuple[str, str], tuple[float, float]]()
    for key in (key for key in forces if key in reference):
        names = [name for name in forces[key] if name in reference[key]]
        if names:
            y, r = (np.array([of[key][name] for name in names]) for of in (forces, reference))
            scale = float(np.abs(r).max(initial=0.0)) or 1.0  # squares neither vanish nor overflow
            pairs[key] = scale * float(np.linalg.norm((y - r) / scale)), scale * float(np.linalg.norm(r / scale))
    errors = dict[str, float]()
    for (kind, unit), (apart, size) in pairs.items():
        largest = max(other for (_, of), (_, other) in pairs.items() if of == unit)
        if largest > 0.0:
            errors[kind] = max(errors.get(kind, 0.0), apart / max(size, LITTLE_FORCE * largest))
    return errors


def band(y: Array, step: float) -> float:
    """Frequency in Hz above which 1 % of signals (T, o) lies, by its RMS, at steps of so many s; 0 if all are zero."""
    from scipy.fft import next_fast_len  # slow to import, and few need it

    window, count = np.hanning(len(y))[:, None], next_fast_len(len(y), real=True)
    power = np.sum(np.abs(np.fft.rfft((y - y.mean(axis=0)) * window, n=count, axis=0)) ** 2, axis=1)
    above = np.cumsum(power[::-1])[::-1]  # from each frequency on
    if above[0] <= 0.0:
        return 0.0
    return float(np.flatnonzero(above > 1e-4 * above[0])[-1] / (count * step))


def band_of(response: Response) -> float:
    """Band of a motion in Hz: the tip's, or that of all displacements where the tip rests on a support."""
    tip, step = response.displacement[:, -1:], float(response.t[1] - response.t[0])
    return band(tip if np.ptp(tip) > response.round_off else response.displacement, step)


def error_below(signal: Array, reference: Array, step: float, highest: float) -> float:
    """`pmr.compare.errors.relative_error` of what two signals (T, o) have up to a frequency in Hz."""
    too_high = np.fft.rfftfreq(len(signal), step) > highest
    spectra = [np.fft.rfft(values, axis=0) for values in (signal, reference)]
    for spectrum in spectra:
        spectrum[too_high] = 0.0
    slow, slow_reference = (np.fft.irfft(spectrum, n=len(signal), axis=0) for spectrum in spectra)
    return relative_error(slow, slow_reference)
