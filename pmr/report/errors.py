"""Errors of a run: its error table, and the errors of model, mesh, time step and reduction as bars and sentences."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from math import ceil, log10
from typing import Any

from pmr.files.arrays import Summary
from pmr.report.blocks import (
    SAME,
    WITHIN,
    ErrorTable,
    Row,
    Table,
    deviating_rows,
    mark_for,
    signed_deviation,
)
from pmr.report.numbers import (
    MINUS,
    SPACE,
    TINY,
    decimals_of,
    format_input,
    format_length,
    format_percent,
    format_quantity,
    significant,
    times_the_true_error,
)
from pmr.report.subject import (
    direction_words,
    force_words,
    is_alone,
    is_luffing_cylinder_alone,
    play_words,
    scope_words,
    shown_force_name,
)
from pmr.results import RunResult
from pmr.results.quantities import (
    COMPARED,
    PIVOT,
    QUANTITIES,
    error_label,
    reduction_error,
    stress_remark,
    wall_stress,
)
from pmr.results.tables import REACTION_OF
from pmr.scene.choice import traits_of
from pmr.scene.members import members
from pmr.scene.model_traits import model_traits

NAMES = {"full": "full", "ancf": "ANCF", "reduced": "reduced"}
#: Order of the pairs of models in the error table, and order of the kinds of errors of each pair.
ORDER = ("reduced_vs_full", "reduced_vs_ancf", "full_vs_ancf")
#: Clause on the error of a reduction that nothing tells.
NOT_COMPARED = "not known: no full model was simulated to compare with"
#: Relative error at which the scale of the bars begins.
LEAST = 1e-5
#: Label of the luffing cylinder's force, where it is the only support that gives way.
LUFFING_LABEL = QUANTITIES["luffing_force"].label
#: Sources that a quantity does not depend on, by its label.
UNAFFECTED = {QUANTITIES["frequency"].label: ("time step",)}
#: Change of a largest value by the play of pads below which it is not stated by itself.
SMALL_CHANGE = 0.01
#: Clause on what the errors of the stresses of beams do not cover.
WALLS = "in stresses the bending of a beam's walls under pads, which a shell has"


def error_table(result: RunResult) -> ErrorTable:
    """Build the error table of a run with its caption, and the notes below it."""
    error_rows, published = rows(result), result.scene.published
    caption = "Over all times and places."
    if is_compared(result):
        places = [place for pair in result.summary.get("errors", {}).values() for place in pair]
        forces = f" and {force_words(result)}" if "pad_force" in places else ""
        source = f"; published: {published.source}" if published and any(row.published for row in error_rows) else ""
        caption = f"Normalised RMS errors of transverse displacements{forces}, and largest values{source}."
    return ErrorTable(caption, error_rows, error_notes(result, error_rows))


def is_compared(result: RunResult) -> bool:
    """Whether the summary holds errors against another model, or names a reference that could not be computed."""
    return bool(result.summary.get("errors") or result.summary.get("no_reference"))


def rows(result: RunResult) -> list[Row]:
    """Rows of the error table.

    Differences to other models come first, then estimates, the largest displacement and the largest difference.
    """
    errors = (*_error_rows(result), *_further_rows(result), *_section_rows(result), *_estimate_rows(result))
    return [*errors, *_length_rows(result)]


def error_notes(result: RunResult, table: Sequence[Row]) -> list[str]:
    """Sentences below the error table: one for each row whose value rounds to the published one, then notes of the run.

    If other rows deviate by more than 5 % from published values and the run has no notes, a sentence takes their place
    that says that no reason is recorded.
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
    return [*explanations, *notes]


def error_name(result: RunResult, kind: str) -> str:
    """Name of the quantity that an error measures, such as ``all sections`` for the kind ``beam``."""
    names = {"tip": "tip", "beam": "beam" if is_alone(result) else "all sections", "pad_force": force_words(result)}
    return names.get(kind) or shown_force_name(_with_shown_label(result, error_label(kind)))


def _with_shown_label(result: RunResult, text: str) -> str:
    """Text in which the label of support forces names the luffing cylinder if it is the only support that gives way."""
    alone = is_luffing_cylinder_alone(result)
    return text.replace(QUANTITIES["support_force"].label, LUFFING_LABEL) if alone else text


def _error_rows(result: RunResult) -> Iterator[Row]:
    """Yield a row for each error between two models, with the published error and the norm of the difference."""
    published = result.scene.published
    printed: Mapping[str, Any] = published.model_dump().get("errors", {}) if published else {}
    decimals = _decimals(printed)
    units = {
        name: unit
        for response in result.responses.values()
        for name, unit in zip(response.other_names, response.other_units, strict=True)
    }
    errors: Mapping[str, Mapping[str, Any]] = result.summary.get("errors", {})
    for pair in dict.fromkeys((*(name for name in ORDER if name in errors), *errors)):
        first, _, second = pair.partition("_vs_")
        comparison, values = f"{NAMES.get(first, first)} against {NAMES.get(second, second)}", dict[str, str]()
        for kind in dict.fromkeys((*(name for name in COMPARED if name in errors[pair]), *errors[pair])):
            error, name = float(errors[pair][kind]), error_name(result, kind)
            value, other = _format_error(error), printed.get(pair, {}).get(kind)
            if values.get(name) == value:
                continue  # the force of the only support that gives way has a row already
            if name in values:
                name = f"{name}, by the moment about the pivot" if kind.startswith(PIVOT) else error_label(kind)
            values[name], row = value, Row(comparison, name, value)
            if other is not None:
                row = _comparison_row(comparison, name, error, other, decimals)
            absolute = result.summary.get("absolute_errors", {}).get(pair, {}).get(kind)
            if kind.startswith(REACTION_OF) and error == absolute == 0.0:
                continue  # no force acts along this support
            if absolute is not None and not 0.0 < error < TINY:
                unit = units.get(kind, "N" if "_force" in kind else "m")
                row = replace(row, absolute=_format_norm(unit, absolute))
            yield row


def _further_rows(result: RunResult) -> Iterator[Row]:
    """Yield rows on forces away from impacts, and on references that could not be used; warnings give the reasons."""
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
                "reduced against full", section["name"], _format_error(section["errors"]["reduced_vs_full"]["beam"])
            )


def _estimate_rows(result: RunResult) -> Iterator[Row]:
    """Yield rows with the errors that were estimated without the full model, and a row with the allowed error."""
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


def _format_norm(unit: str, value: float) -> str:
    """Format the norm `value` of a difference with its unit; ``1`` is the unit of a pure number."""
    return format_length(value) if unit == "m" else format_quantity(value, unit)


def _comparison_row(comparison: str, place: str, error: float, other: float, decimals: int) -> Row:
    """Build a row with an error and the published one; both are given as fractions.

    `comparison` says which models are compared, `place` names the quantity, `other` is the published error, and
    `decimals` is the number of decimals with which the published error is stated in per cent.
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
        ("max_error", "largest difference, reduced to full", True),
    ):
        if (value := result.summary.get(name)) is None:
            continue
        row, other = Row(comparison, "", format_length(value, 4)), getattr(published, name, None)
        if other is not None:
            printed, mark = format_length(other, _digits(other)), mark_for(value, other, is_error)
            row = replace(row, published=printed, deviation=signed_deviation(value, other), mark=mark)
        yield row


def _decimals(printed: Mapping[str, Mapping[str, float]]) -> int:
    """Number of decimals with which a publication states its errors in per cent.

    It is the largest number that an error in `printed` needs; `printed` has errors by pair of models, then by quantity.
    """
    return max((max(decimals_of(value) - 2, 0) for pair in printed.values() for value in pair.values()), default=0)


def _digits(value: float) -> int:
    """Number of significant digits of a value as Python prints it."""
    return len(Decimal(repr(value)).normalize().as_tuple().digits)


def trust_table(result: RunResult) -> Table:
    """Build the table of errors of model, mesh, time step and reduction, and of what these errors do not cover.

    A row has a bar if its error is known.  The bar shows the largest of the row's errors on a logarithmic scale, which
    begins at `LEAST` and is the same for all bars.
    """
    summary = result.summary
    budget, step, estimate = (summary.get(name) or {} for name in ("budget", "step", "estimate"))
    model, (source, reduction) = budget.get("model") or {}, reduction_error(summary)
    parts = _errors_by_source(summary)
    texts = {name: _list_without_round_off(errors) for name, errors in parts.items()}
    texts["model"] = (
        f"beside {model_traits(model['beside']).words}: {texts['model']}"
        if model.get("beside")
        else _reason_without_model_error(model)
    )
    texts["mesh"] = texts["mesh"] or budget.get("mesh_reason") or "not known: a run with [accuracy] measures it"
    why = f": {step['reason']}" if step.get("reason") else ""
    texts["time step"] = f"{_step_words(step)}{texts['time step']}" if texts["time step"] else f"not known{why}"
    remark = _estimate_words(result)
    texts["reduction"] = f"{source}: {texts['reduction']}" if reduction else ""
    texts["reduction"] = "; ".join(filter(None, (texts["reduction"], remark))) or NOT_COMPARED
    if play := _play_changes(result):
        parts["play of pads"] = {name: abs(change) for name, change in play.items()}
        texts["play of pads"] = "see How sure"
    if sums := (summed := summed_errors(summary)).by_label:
        of_largest = dict(sorted(sums.items(), key=lambda item: -item[1]))
        without = "; ".join([*_lacking_clauses(summed), *(["play of pads"] if play else [])])
        texts["added up"] = _list_without_round_off(of_largest) + (f"; not in it: {without}" if without else "")
    stressed = "reduced" in summary.get("max_von_mises", {})
    walls = [WALLS] if stressed and any(traits_of(of).is_beam for of in members(result.scene)) else []
    missing = {
        "model": model.get("not_covered") or walls,
        "mesh": budget.get("mesh_not_covered") or (),
        "time step": step.get("not_covered") or (),
        "reduction": estimate.get("not_covered") or (),
    }
    largest = {name: most for name, errors in parts.items() if (most := max(errors.values(), default=0.0))}
    decades = max(ceil(log10(max(largest.values(), default=1.0) / LEAST) - 1e-9), 5)
    bars = {name: min(max(log10(error / LEAST) / decades, 0.01), 1.0) for name, error in largest.items()}
    top = format_input(round(100.0 * LEAST * 10**decades, 6), "%")
    note = f"How far off figures are, from small on the left to large: {format_input(100.0 * LEAST, '%')} to {top}, "
    note += f"ten times as much from mark to mark. Displacements are those {scope_words(result)}; "
    note += "stresses may be further off."
    gaps = "; ".join(f"{name}: {', '.join(dict.fromkeys(clauses))}" for name, clauses in missing.items() if clauses)
    rows = tuple((name, _with_shown_label(result, text)) for name, text in texts.items())
    rows += (("not in these bars", gaps),) if gaps else ()
    return Table("How far to trust it", rows, bars, decades, note if bars else "")


def certainty_rows(result: RunResult) -> Iterator[tuple[str, str]]:
    """Yield rows (name, text) in brief on the errors of stress, tip, forces and frequencies, all sources added up."""
    summed = summed_errors(result.summary)
    if "reduced" in result.summary.get("max_von_mises", {}):
        yield "stress", _stress_certainty(result)
    for key in ("tip", "pad_force", "reaction", "support_force", "frequency"):
        if (error := summed.by_label.get(label := QUANTITIES[key].label)) is not None:
            yield _with_shown_label(result, label), f"± {format_percent(error, 2)} {summed.sources_clause(label)}"
    if text := _play_text(result):
        yield "play of pads", text


def _play_changes(result: RunResult) -> dict[str, float]:
    """Relative changes of a run's largest values if its pads have another play, by the names of the values in words."""
    names = {"luffing_force": "luffing cylinder", "probe": "stress at probes", "pad_force": "pads",
             "cylinder_force": "extension cylinders", "wall_stress": "stress in walls"}  # fmt: skip
    changes = dict[str, float]()
    for row in _play(result).get("rows", ()):
        label = names.get(row["quantity"], QUANTITIES[row["quantity"]].label)
        if row["quantity"] == "tip":
            label = f"tip {direction_words(result, row['name'])}"
        changes[row["name"] if row["quantity"] == "support" else label] = row["varied"] / row["value"] - 1.0
    return dict(sorted(changes.items(), key=lambda item: -abs(item[1])))


def _play(result: RunResult) -> Mapping[str, Any]:
    """Entry ``budget.play`` of a run's summary; empty if the summary has no such entry."""
    return (result.summary.get("budget") or {}).get("play") or {}


def _play_text(result: RunResult) -> str:
    """Sentence on the changes of largest values if pads have another play; empty if no run had another play."""
    changes = _play_changes(result)
    if not changes:
        return f"not known: {_play(result)['reason']}" if "reason" in _play(result) else ""
    listed = [
        f"{name} {f'{100.0 * of:+.1f}'.replace('-', MINUS)}{SPACE}%"
        for name, of in changes.items()
        if abs(of) >= SMALL_CHANGE
    ]
    small = [name for name, of in changes.items() if abs(of) < SMALL_CHANGE]
    listed += [f"less than {format_percent(SMALL_CHANGE)}: {', '.join(small)}"] if small else []
    gap = _play(result)["gap"]
    where = " from face to face, which compare.play assumes as the scene states no clearance" if gap else ""
    return f"{play_words(gap)}{where}: largest values change: {'; '.join(listed)}"


def _stress_certainty(result: RunResult) -> str:
    """Text on the error of the stress in walls at pads, if known, and on errors of stresses that are not known."""
    walls, unknown = wall_stress(result.summary), f"error is not known: {'; '.join(_stress_gaps(result))}"
    if walls is None or "error" not in walls or not walls["value"]:
        return f"its {unknown}"
    by_cells, by_pads = walls["error"] / walls["value"], pad_force_error(result.summary)
    share = f"{format_percent(by_cells, 2)} by their cells, and the error of pad forces"
    if by_pads is not None:
        share = f"{format_percent(by_cells + by_pads, 2)}, of which {format_percent(by_cells, 2)} by their cells "
        share += "and the rest by pad forces"
    return f"in walls at pads ± {share}; elsewhere the {unknown}"


def _stress_gaps(result: RunResult) -> Iterator[str]:
    """Yield clauses on what the stresses of beams leave out, and on the cells of shells and solids."""
    are_beams = [traits_of(of).is_beam for of in members(result.scene)]
    if any(are_beams):
        yield stress_remark(result.scene) or "beams have no local stress at pads, loads and corners"
    if not all(are_beams):
        yield "cells are not short enough at pads, loads and corners to tell"


def _errors_by_source(summary: Summary) -> dict[str, dict[str, float]]:
    """Relative errors by source (``model``, ``mesh``, ``time step``, ``reduction``), then by label of the quantity.

    A source without an estimate has an empty mapping.
    """
    budget = summary.get("budget") or {}
    mesh = budget.get("mesh")
    return {
        "model": _errors_by_label(budget.get("model") or {}),
        "mesh": _errors_by_label(mesh if isinstance(mesh, dict) else {"beam": mesh}),
        "time step": _errors_by_label(summary.get("step") or {}),
        "reduction": _errors_by_label(reduction_error(summary).by_kind),
    }


@dataclass(frozen=True)
class SummedErrors:
    """Relative errors added up over their sources, by the label of a quantity.

    `sources` are the sources in the sum of a quantity, `lacking` are those that state no error in this quantity.  A
    quantity is left out if the model or the mesh states errors, but none in this quantity.  There are no sums unless
    two sources or more state errors.
    """

    by_label: Mapping[str, float]
    sources: Mapping[str, tuple[str, ...]]
    lacking: Mapping[str, tuple[str, ...]]

    def sources_clause(self, label: str) -> str:
        """Clause that names the sources in the sum of the quantity `label`, and the sources that are not in it."""
        *names, last = self.sources[label]
        first = f"{', '.join(names)} and " if names else ""
        return f"by {first}{last}{self.lacking_clause(label)}"

    def lacking_clause(self, *labels: str) -> str:
        """Clause that names the sources that are not in the sum of one of several quantities.

        It is empty if no source is missing.
        """
        names = dict.fromkeys(name for label in labels for name in self.lacking[label])
        return f", without that of the {' and '.join(names)}" if names else ""


def summed_errors(summary: Summary) -> SummedErrors:
    """Add up the errors of model, mesh, time step and reduction of a run in each quantity."""
    parts = _errors_by_source(summary)
    stated = {name: errors for name, errors in parts.items() if errors}
    needed = [stated[source] for source in ("model", "mesh") if source in stated]
    labels = dict.fromkeys(label for errors in parts.values() for label in errors)
    complete = [label for label in labels if all(label in errors for errors in needed)] if len(stated) > 1 else []
    sources = {label: tuple(name for name in parts if label in parts[name]) for label in complete}
    return SummedErrors(
        {label: sum(parts[name][label] for name in sources[label]) for label in complete},
        sources,
        {
            label: tuple(name for name in parts if name not in (*sources[label], *UNAFFECTED.get(label, ())))
            for label in complete
        },
    )


def pad_force_error(summary: Summary) -> float | None:
    """Return the relative error of pad forces, added up over its sources; None if it is not known."""
    return summed_errors(summary).by_label.get(QUANTITIES["pad_force"].label)


def _lacking_clauses(summed: SummedErrors) -> Iterator[str]:
    """Yield each source that is not in all sums, with the quantities in whose sums it is not."""
    for source in dict.fromkeys(name for names in summed.lacking.values() for name in names):
        labels = [label for label, names in summed.lacking.items() if source in names]
        stated = [label for label in summed.by_label if label not in labels and source in summed.sources[label]]
        yield source + (f" in {', '.join(labels)}" if stated else "")


def _step_words(step: Mapping[str, object]) -> str:
    """Words before the error of the time step, which say whether it is a lower bound or that of the mean motion.

    `step` is the entry of the time step in the summary's budget.  The words are empty if neither holds.
    """
    least = "at least " if not step.get("settled", True) else ""
    return f"{'of the mean motion, ' if step.get('by') == 'mean' else ''}{least}"


def _estimate_words(result: RunResult) -> str:
    """Clauses on the estimated error of the reduction: how it was made, its ratio to the true error, and probes.

    If the error was neither estimated nor computed, the reason is given; without an estimate the text is empty.
    """
    estimate = result.summary.get("estimate")
    true = result.summary.get("errors", {}).get("reduced_vs_full", {}).get("beam")
    if estimate is None or (estimate.get("beam") is None and true is not None):
        return ""
    if estimate.get("beam") is None:
        return f"not known, not even by an estimate: {estimate['reason']}" if "reason" in estimate else ""
    by_model = estimate.get("by") == "other model"
    words = "the estimate is made by a model of free modes" if by_model else "the estimate has a margin of a quarter"
    if ratio := times_the_true_error(estimate["beam"], true):
        words = f"{scope_words(result)} the estimate is {ratio}"
    probes = estimate.get("probe")
    return words + (f", at most {format_percent(probes)} of what a probe measures" if probes is not None else "")


def _reason_without_model_error(model: Mapping[str, object]) -> str:
    """Clause with the reason why the model's own error is not known, or with the scene's key that has it measured."""
    reason = str(model.get("reason") or "compare.richer measures it")
    return reason if reason.startswith("not ") else f"not known: {reason}"


def _errors_by_label(part: Mapping[str, float | None]) -> dict[str, float]:
    """Relative errors of one source, by the labels of the quantities in which they are measured, the largest first.

    `part` is the mapping of this source in the summary; its keys are kinds of errors.  Other keys, and values that are
    None, are left out.
    """
    kinds = ("beam", "largest", *COMPARED[2:], "probe", "tip")
    errors = {QUANTITIES[kind].label: error for kind in kinds if (error := part.get(kind)) is not None}
    return dict(sorted(errors.items(), key=lambda item: -item[1]))


def _list_without_round_off(errors: Mapping[str, float]) -> str:
    """List the errors that are at least `LEAST`, in words.

    If all errors are smaller, the text says so; if there are no errors, it is empty.
    """
    parts = [f"{name} {format_percent(error)}" for name, error in errors.items() if error >= LEAST]
    return ", ".join(parts) or (f"less than {format_percent(LEAST, 1)}" if errors else "")
