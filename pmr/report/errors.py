"""Error table of a run: differences between models, estimates and published errors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from decimal import Decimal
from typing import Any

import numpy as np

from pmr.report.blocks import SAME, WITHIN, ErrorTable, Row, deviating_rows, mark_for, signed_deviation
from pmr.report.columns import largest_by_unit
from pmr.report.numbers import (
    NOTHING,
    SPACE,
    TINY,
    decimals_of,
    format_length,
    format_percent,
    format_quantity,
    significant,
)
from pmr.report.subject import force_words, is_alone, shown_force_name, support_words, with_shown_label
from pmr.report.trust import has_some_reactions
from pmr.results import RunResult
from pmr.results.quantities import COMPARED, PIVOT, REACTION_OF, error_label, reduction_error, wall_stress
from pmr.scene.built import reaction_name
from pmr.scene.keys import qualified_name

NAMES = {"full": "full", "ancf": "ANCF", "reduced": "reduced"}
#: Order of the pairs of models in the error table, and order of the kinds of errors of each pair.
ORDER = ("reduced_vs_full", "reduced_vs_ancf", "full_vs_ancf")


def error_table(result: RunResult) -> ErrorTable:
    """Build the error table of a run with its caption, and the notes below it."""
    error_rows, published = rows(result), result.scene.published
    caption = "Over all times and places."
    if is_compared(result):
        places = [place for pair in result.summary.get("errors", {}).values() for place in pair]
        forces = " and forces" if "pad_force" in places else ""
        source = f"; published: {published.source}" if published and any(row.published for row in error_rows) else ""
        caption = (
            f"Errors of transverse displacements{forces}: RMS of the difference over all times, divided by the RMS "
        )
        caption += (
            f"of the model that is compared with, as a mean over all places. The last rows are largest values{source}."
        )
    return ErrorTable(caption, error_rows, error_notes(result, error_rows))


def is_compared(result: RunResult) -> bool:
    """Whether the summary holds errors against another model, or names a reference that could not be computed."""
    return bool(result.summary.get("errors") or result.summary.get("no_reference"))


def rows(result: RunResult) -> list[Row]:
    """Rows of the error table, as far as the run has their values.

    Errors against other models come first; the last of these are the errors along single sections.  Then come estimated
    errors and the allowed error.  The last two rows are the largest displacement and the largest difference to the full
    model.
    """
    errors = (*_error_rows(result), *_further_rows(result), *_section_rows(result), *_estimate_rows(result))
    return [*errors, *_length_rows(result)]


def error_notes(result: RunResult, table: Sequence[Row]) -> list[str]:
    """Sentences below the error table: one for each row whose value rounds to the published one, then notes of the run.

    If the run has no notes, but other rows deviate by more than 5 % from published values, a sentence says that no
    reason is recorded.  The last sentences are on reactions and stresses that have no row.
    """
    explanations = [
        f"{row.comparison}, {row.place}: the published {row.published} is a rounded figure; "
        f"{row.value} rounds to it, so the two agree within the published digits."
        for row in table
        if row.mark is SAME
    ]
    notes = [str(note) for note in result.summary.get("notes", ())]
    if not notes and len(deviating_rows(table)) > len(explanations):
        notes = [f"No reason {'for the other figures ' if explanations else ''}is recorded with this result."]
    return [*explanations, *notes, *_reaction_notes(result), *_slight_notes(result)]


def _slight_notes(result: RunResult) -> Iterator[str]:
    """Yield a sentence that names the compared outputs that have no row, as they are nothing beside the largest."""
    compared = result.summary.get("errors", {}).get("reduced_vs_full", {})
    if small := [words for name, words in slight_outputs(result).items() if name in compared]:
        share = format_percent(NOTHING, 1)
        yield f"Not listed, as it is below {share} of the largest force, moment or stress: {'; '.join(small)}."


def _reaction_notes(result: RunResult) -> Iterator[str]:
    """Yield up to two sentences on reactions of rigid supports that the full model does not have.

    The first one names them, the second one says what the errors of reactions contain.  Nothing is
    yielded if there is no full model, or if none of its reactions was compared.
    """
    full, reduced, slight = result.responses.get("full"), result.responses["reduced"], slight_outputs(result)
    compared = result.summary.get("errors", {}).get("reduced_vs_full", {})
    if full is None or not any(name.startswith(REACTION_OF) for name in compared):
        return
    supports = [
        reaction_name(qualified_name(body, support.row_name(direction)))
        for body, part in result.scene.bodies.items()
        for support in part.supports
        for direction in support.held_directions
    ]
    unknown = [
        support_words(name.removeprefix(REACTION_OF))
        for name in supports
        if name in reduced.other_names and name not in (*full.other_names, *slight)
    ]
    if unknown:
        yield (
            f"Not compared: the reaction of {'; '.join(unknown)}. Where a support holds a coordinate of the mesh, "
            "the full model does not compute its force."
        )
        if has_some_reactions(result.summary):
            yield "So the sums of errors of reactions lack the error of the reduction."
        elif "reaction" in reduction_error(result.summary).by_kind:
            yield "The error of the reduction in all reactions together is estimated."


def error_name(result: RunResult, kind: str) -> str:
    """Name of the quantity that an error measures, such as ``all sections`` for the kind ``beam``."""
    names = {"tip": "tip", "beam": "beam" if is_alone(result) else "all sections", "pad_force": force_words(result)}
    shown = names.get(kind) or shown_force_name(with_shown_label(result, error_label(kind)))
    if shown.startswith(REACTION_OF):
        return REACTION_OF + support_words(shown.removeprefix(REACTION_OF))
    return shown


def _error_rows(result: RunResult) -> Iterator[Row]:
    """Yield a row for each error between two models.

    If the scene states a published error, the row compares the error with it.  The row also has the largest difference
    if the summary has one.  There is no row for a reaction or stress of at most the share `NOTHING` of the largest one
    (`slight_outputs`).  Nor is there a row that would repeat both name and error of an earlier row.
    """
    published = result.scene.published
    printed: Mapping[str, Any] = published.model_dump().get("errors", {}) if published else {}
    decimals = max((max(decimals_of(value) - 2, 0) for pair in printed.values() for value in pair.values()), default=0)
    units = {
        name: unit
        for response in result.responses.values()
        for name, unit in zip(response.other_names, response.other_units, strict=True)
    }
    errors: Mapping[str, Mapping[str, Any]] = result.summary.get("errors", {})
    slight = slight_outputs(result)
    for pair in dict.fromkeys((*(name for name in ORDER if name in errors), *errors)):
        first, _, second = pair.partition("_vs_")
        comparison, values = f"{NAMES.get(first, first)} against {NAMES.get(second, second)}", dict[str, str]()
        for kind in dict.fromkeys((*(name for name in COMPARED if name in errors[pair]), *errors[pair])):
            if kind in slight:
                continue
            error, name = float(errors[pair][kind]), error_name(result, kind)
            value, other = _format_error(error), printed.get(pair, {}).get(kind)
            if values.get(name) == value:
                continue  # the force of the only support that gives way has a row already
            if name in values:
                name = f"{name}, by the moment about the pivot" if kind.startswith(PIVOT) else error_label(kind)
            values[name], row = value, Row(comparison, name, value)
            if other is not None:
                row = _comparison_row(comparison, name, error, other, decimals)
            largest = result.summary.get("largest_differences", {}).get(pair, {}).get(kind)
            if largest is not None and not 0.0 < error < TINY:
                unit = units.get(kind, "N" if "_force" in kind else "m")
                row = replace(row, difference=_format_difference(unit, largest))
            yield row


def slight_outputs(result: RunResult) -> dict[str, str]:
    """Map the names of slight reactions and stresses to words for them, such as ``the reaction of pivot, about x``.

    An output is slight if it is at most the share `NOTHING` of the run's largest force, moment or stress.  The largest
    stress is that in walls at pads; if it is not known, no stress is slight.  The names are those of the reduced
    model's outputs.
    """
    response, largest = result.responses["reduced"], largest_by_unit(result)
    if walls := wall_stress(result.summary):
        largest["Pa"] = float(walls["value"])
    return {
        name: f"the reaction of {support_words(name.removeprefix(REACTION_OF))}" if unit != "Pa" else name
        for name, unit in zip(response.other_names, response.other_units, strict=True)
        if (name.startswith(REACTION_OF) or unit == "Pa")
        and float(np.abs(response.other(name)).max()) <= NOTHING * largest.get(unit, 0.0)
    }


def _further_rows(result: RunResult) -> Iterator[Row]:
    """Yield rows on comparisons other than plain errors.

    A row says "not judged" of a quantity, or "no reference" of another model; warnings of the run state the reasons.
    If there are impacts, a row has the error of the contact forces at frequencies at which the tip moves.
    """
    for kind in result.summary.get("not_judged", {}):
        yield Row("reduced against full", error_name(result, kind), "not judged")
    if (impacts := result.summary.get("impacts")) is not None:
        band = f"{significant(impacts['band'], 2)}{SPACE}Hz, where the tip moves"
        yield Row("reduced against full", f"{force_words(result)} below {band}", format_percent(impacts["pad_force"]))
    for name in result.summary.get("no_reference", {}):
        yield Row(f"reduced against {NAMES.get(name, name)}", "", "no reference")


def _section_rows(result: RunResult) -> Iterator[Row]:
    """Yield a row for each section of a boom with the error along it compared with the full model."""
    for section in result.summary.get("sections", ()):
        if "errors" in section:
            yield Row(
                "reduced against full",
                f"along {section['name']}",
                _format_error(section["errors"]["reduced_vs_full"]["beam"]),
            )


def _estimate_rows(result: RunResult) -> Iterator[Row]:
    """Yield a row for each error that was estimated without the full model, and a row with the allowed error.

    A run without a tolerance has no row with the allowed error.
    """
    estimates = result.summary.get("estimate", {})
    for kind in COMPARED[:5]:
        if estimates.get(kind) is not None:
            yield Row("estimated without the full model", error_name(result, kind), _format_error(estimates[kind]))
    accuracy = result.summary.get("accuracy", {})
    if accuracy.get("tolerance") is not None:
        places = ", ".join(error_name(result, kind) for kind in accuracy["outputs"])
        yield Row("allowed", places, format_percent(accuracy["tolerance"]))


def _format_error(error: float) -> str:
    """Format a relative error in per cent, or as ``round-off`` if it is below `TINY` but not 0."""
    return "round-off" if 0.0 < error < TINY else format_percent(error)


def _format_difference(unit: str, value: float) -> str:
    """Format a difference `value` with its unit; ``1`` is the unit of a pure number."""
    return format_length(value) if unit == "m" else format_quantity(value, unit)


def _comparison_row(comparison: str, place: str, error: float, other: float, decimals: int) -> Row:
    """Build a row with an error and the published one; both are given as fractions.

    `comparison` says which models are compared, and `place` names the quantity.  `other` is the published error, which
    is stated in per cent with this number of `decimals`.  An error that is more than 5 % off, but rounds to the
    published one, has the mark `SAME`.
    """
    printed, deviation = f"{100.0 * other:.{decimals}f}{SPACE}%", signed_deviation(error, other)
    rounded = abs(error - other) <= 0.5 * 10.0 ** -(decimals + 2) * (1.0 + 1e-9)
    mark = mark_for(error, other)
    if rounded and mark is not WITHIN:
        mark = SAME
    return Row(comparison, place, format_percent(error), printed, deviation, mark)


def _length_rows(result: RunResult) -> Iterator[Row]:
    """Yield rows with the largest displacement and the largest difference in m, with the published values."""
    published = result.scene.published
    for name, comparison, is_error in (
        ("max_displacement", "largest transverse displacement", False),
        ("max_error", "largest difference to the full model", True),
    ):
        if (value := result.summary.get(name)) is None:
            continue
        row, other = Row(comparison, "", format_length(value, 4)), getattr(published, name, None)
        if other is not None:
            printed, mark = format_length(other, _digits(other)), mark_for(value, other, is_error)
            row = replace(row, published=printed, deviation=signed_deviation(value, other), mark=mark)
        yield row


def _digits(value: float) -> int:
    """Number of significant digits of a value as Python prints it."""
    return len(Decimal(repr(value)).normalize().as_tuple().digits)
