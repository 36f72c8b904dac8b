"""The error table of a run: errors beside published ones, then largest displacements, differences and stresses."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from decimal import Decimal
from typing import Any

from pmr.report.blocks import SAME, WITHIN, ErrorTable, Row, deviating_rows, mark_for, signed_deviation
from pmr.report.numbers import SPACE, TINY, length, percent, quantity, significant
from pmr.report.subject import forces_called, places_called
from pmr.results import RunResult
from pmr.results.tables import REACTION_OF

NAMES = {"full": "full", "ancf": "ANCF", "reduced": "reduced"}
ORDER = ("reduced_vs_full", "reduced_vs_ancf", "full_vs_ancf")
PLACES = ("tip", "beam", "pad_force", "cylinder_force", "support_force")


def error_table(result: RunResult) -> ErrorTable:
    """The error table of a run, with notes on it."""
    error_rows, published = rows(result), result.scene.published
    if not is_compared(result):
        return ErrorTable("Over all times and places.", error_rows, reasons(result, error_rows))
    places = [place for pair in result.summary.get("errors", {}).values() for place in pair]
    forces = f" and {forces_called(result)}" if "pad_force" in places else ""
    source = f"; published: {published.source}" if published and any(row.published for row in error_rows) else ""
    return ErrorTable(
        f"Normalised RMS errors of transverse displacements{forces}, and largest values{source}.",
        error_rows,
        reasons(result, error_rows),
    )


def is_compared(result: RunResult) -> bool:
    """Whether there is anything that the run was, or should have been, compared with."""
    return bool(result.summary.get("errors") or result.summary.get("no_reference"))


def rows(result: RunResult) -> list[Row]:
    """Lines of the error table: normalised errors and their estimates, then the largest displacement and stress."""
    errors = (*_errors(result), *_missing_rows(result), *_of_sections(result), *_estimate_rows(result))
    return [*errors, *_lengths(result), *_stresses(result)]


def reasons(result: RunResult, table: Sequence[Row]) -> list[str]:
    """Why figures differ from the published ones by more than 5 %, and other notes of the run."""
    explanations = [
        f"{row.comparison}, {row.place}: the published {row.published} is a rounded figure; "
        f"{row.here} rounds to it, so the two agree as far as is known."
        for row in table
        if row.mark is SAME
    ]
    notes = [str(note) for note in result.summary.get("notes", ())]
    if not notes and len(deviating_rows(table)) > len(explanations):
        notes = [f"No reason {'for the other figures ' if explanations else ''}is recorded with this result."]
    return [*explanations, *notes]


def _errors(result: RunResult) -> Iterator[Row]:
    published = result.scene.published
    printed: Mapping[str, Any] = published.model_dump().get("errors", {}) if published else {}
    names, decimals = places_called(result), _decimals(printed)
    responses = result.responses.values()
    units = {
        n: unit for response in responses for n, unit in zip(response.other_names, response.other_units, strict=True)
    }
    errors: Mapping[str, Mapping[str, Any]] = result.summary.get("errors", {})
    for pair in (*(p for p in ORDER if p in errors), *(p for p in errors if p not in ORDER)):
        first, _, second = pair.partition("_vs_")
        comparison = f"{NAMES.get(first, first)} against {NAMES.get(second, second)}"
        for place in (*(p for p in PLACES if p in errors[pair]), *(p for p in errors[pair] if p not in PLACES)):
            error, called = float(errors[pair][place]), names.get(place, place)
            other = printed.get(pair, {}).get(place)
            row = Row(comparison, called, _percent(error))
            if other is not None:
                row = _comparison_row(comparison, called, error, other, decimals)
            absolute = result.summary.get("absolute_errors", {}).get(pair, {}).get(place)
            if place.startswith(REACTION_OF) and error == absolute == 0.0:
                continue  # nothing acts along this support
            norm = (
                None
                if absolute is None or 0.0 < error < TINY
                else _norm(units.get(place, "N" if "_force" in place else "m"), absolute)
            )
            yield replace(row, absolute=norm)


def _missing_rows(result: RunResult) -> Iterator[Row]:
    """References that were asked for and can't be trusted, errors that are theirs; why, the run's warnings say."""
    for name in result.summary.get("not_judged", {}):
        yield Row("reduced against full", places_called(result).get(name, name), "not judged")
    for name in result.summary.get("no_reference", {}):
        yield Row(f"reduced against {NAMES.get(name, name)}", "", "no reference")


def _of_sections(result: RunResult) -> Iterator[Row]:
    """Along each section of a boom."""
    for section in result.summary.get("sections", ()):
        if "errors" in section:
            yield Row("reduced against full", section["name"], _percent(section["errors"]["reduced_vs_full"]["beam"]))


def _estimate_rows(result: RunResult) -> Iterator[Row]:
    """Estimated errors, and the allowed one."""
    estimates, names = result.summary.get("estimate", {}), places_called(result)
    for place in PLACES:
        if estimates.get(place) is not None:
            yield Row("estimated without the full model", names.get(place, place), _percent(estimates[place]))
    accuracy = result.summary.get("accuracy", {})
    if accuracy.get("tolerance") is not None:
        places = ", ".join(names.get(place, place) for place in accuracy["outputs"])
        yield Row("allowed", places, percent(accuracy["tolerance"]))


def _percent(error: float) -> str:
    """An error in per cent; of one below `TINY` what it is."""
    return "round-off" if 0.0 < error < TINY else percent(error)


def _norm(unit: str, value: float) -> str:
    """The norm of a difference with its unit."""
    if unit == "m":
        return length(value, 3)
    return (
        quantity(value, unit) if unit in ("N", "Pa") else f"{significant(value)}{SPACE}{unit}".removesuffix(f"{SPACE}1")
    )


def _stresses(result: RunResult) -> Iterator[Row]:
    largest: Mapping[str, float] = result.summary.get("max_von_mises", {})
    for name in ("reduced", "full"):
        if name in largest:
            yield Row("largest von Mises stress", NAMES[name], quantity(largest[name], "Pa", 4))
    if {"full", "reduced"} <= set(largest) and largest["full"] > 0.0:
        apart = signed_deviation(largest["reduced"], largest["full"])
        yield Row("largest von Mises stress", "reduced to full", apart)


def _comparison_row(comparison: str, place: str, error: float, other: float, decimals: int) -> Row:
    """An error beside the published one, which is printed in per cent with so many decimals."""
    printed, deviation = f"{100.0 * other:.{decimals}f}{SPACE}%", signed_deviation(error, other)
    rounded = abs(error - other) <= 0.5 * 10.0 ** -(decimals + 2) * (1.0 + 1e-9)
    mark = mark_for(error, other)
    if rounded and mark is not WITHIN:
        mark = SAME
    return Row(comparison, place, percent(error), printed, deviation, mark)


def _lengths(result: RunResult) -> Iterator[Row]:
    published = result.scene.published
    for name, comparison, is_error in (
        ("max_displacement", "largest transverse displacement", False),
        ("max_error", "largest difference, reduced to full", True),
    ):
        value = result.summary.get(name)
        if value is None:
            continue
        other = getattr(published, name, None)
        if other is None:
            yield Row(comparison, "", length(value, 4))
            continue
        deviation = signed_deviation(value, other)
        mark = mark_for(value, other, is_error)
        yield Row(comparison, "", length(value, 4), length(other, _digits(other)), deviation, mark)


def _decimals(printed: Mapping[str, Mapping[str, float]]) -> int:
    """Decimals, in per cent, to which a publication states its errors: the most that any of them shows."""
    exponents = [
        Decimal(repr(value)).normalize().as_tuple().exponent for pair in printed.values() for value in pair.values()
    ]
    return max((max(-int(exponent) - 2, 0) for exponent in exponents), default=0)


def _digits(value: float) -> int:
    return len(Decimal(repr(value)).normalize().as_tuple().digits)
