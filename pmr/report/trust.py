"""How far to trust a run: errors of model, mesh, time step and reduction as bars, in brief, and added up."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, log10

import numpy as np

from pmr.files.arrays import Summary
from pmr.report.blocks import Table
from pmr.report.numbers import format_input, format_percent, format_quantity, times_the_true_error
from pmr.report.subject import direction_words, play_summary, play_words, scope_words, with_shown_label
from pmr.results import RunResult
from pmr.results.quantities import (
    COMPARED,
    ESTIMATED,
    QUANTITIES,
    REACTION_OF,
    UNSETTLED_KINDS,
    reduction_error,
    stress_name,
    stress_remark,
    wall_stress,
)
from pmr.results.response import Extremes
from pmr.scene.choice import traits_of
from pmr.scene.members import members
from pmr.scene.model_traits import model_traits

#: Clause on the error of a reduction that nothing tells.
NOT_COMPARED = "not known: no full model was simulated to compare with"
#: Relative error at which the scale of the bars begins.
LEAST = 1e-5
#: Sources that a quantity does not depend on, by its key.
UNAFFECTED = {"frequency": ("time step",)}
#: Keys of the quantities whose errors are listed.
STATED = ("beam", "largest", *COMPARED[2:], "probe", "tip")
#: Change of a largest value by the play of pads below which it is not stated by itself.
SMALL_CHANGE = 0.01
#: Name of the row on what the error of a source does not contain.
NOT_IN_ERROR = "not in the error of the {}"
#: Clause on the error of the reduction in reactions, some of which the full model lacks.
SOME_REACTIONS = "reactions are compared only in part, as the table of errors says"
#: Clause on what the errors of the stresses of beams do not cover.
WALLS = "in stresses the bending of a beam's walls under pads, which a shell has"


def trust_table(result: RunResult) -> Table:
    """Build the table of errors of model, mesh, time step and reduction, and of what these errors do not cover.

    Each source of errors has a row.  If errors of two or more sources are known, a further row has their sums.  A row
    on the play of the pads is added if a run had another play.  A bar shows the largest error of its row on a
    logarithmic scale, which begins at `LEAST` and is the same for all bars.
    """
    summary = result.summary
    budget, step, estimate = (summary.get(name) or {} for name in ("budget", "step", "estimate"))
    model, source = budget.get("model") or {}, reduction_error(summary).source
    parts = _errors_by_source(summary)
    unsettled = step.get("unsettled", ())
    texts = {
        name: _list_without_round_off(result, errors, 3, unsettled if name == "time step" else ())
        for name, errors in parts.items()
    }
    texts["model"] = (
        f"compared with {model_traits(model['beside']).words}: {texts['model']}"
        if model.get("beside")
        else _reason_without_model_error(model)
    )
    texts["mesh"] = (
        texts["mesh"] or budget.get("mesh_reason") or "not known: not measured (table [accuracy] of the scene)"
    )
    why = f": {step['reason']}" if step.get("reason") else ""
    texts["time step"] = f"{_step_words(step)}{texts['time step']}" if texts["time step"] else f"not known{why}"
    remark = _estimate_words(result)
    by_how = dict[str, dict[str, float]]()
    for key, error in parts["reduction"].items():
        by_how.setdefault("estimated" if key in ESTIMATED else source, {})[key] = error
    known = [f"{how}: {_list_without_round_off(result, errors)}" for how, errors in by_how.items()]
    some = SOME_REACTIONS if has_some_reactions(summary) else ""
    texts["reduction"] = "; ".join(filter(None, (*known, some, remark))) or NOT_COMPARED
    if play := _play_changes(result):
        parts["play of pads"] = {name: abs(change) for name, change in play.items()}
        name, change = next(iter(play.items()))  # the largest change comes first
        varied = play_words(play_summary(result)["gap"])
        texts["play of pads"] = f"{varied}, largest values change by up to {format_percent(abs(change))} ({name})"
    if sums := (summed := summed_errors(summary)).by_key:
        of_largest = dict(sorted(sums.items(), key=lambda item: -item[1]))
        without = ", ".join([*(["play of pads"] if play else []), *_lacking_clauses(summed)])
        texts["added up"] = _list_without_round_off(result, of_largest, 2, unsettled)
        texts["added up"] += f"; not included: {without}" if without else ""
    stressed = "reduced" in summary.get("max_von_mises", {})
    walls = [WALLS] if stressed and any(traits_of(of).is_beam for of in members(result.scene)) else []
    compared = [UNSETTLED_KINDS[key] for key in parts["reduction"] if key in UNSETTLED_KINDS]
    missing = {
        "model": model.get("not_covered") or walls,
        "mesh": budget.get("mesh_not_covered") or (),
        "time step": step.get("not_covered") or (),
        "reduction": [of for of in estimate.get("not_covered") or () if of not in compared],
    }
    largest = {name: most for name, errors in parts.items() if (most := max(errors.values(), default=0.0))}
    decades = max(ceil(log10(max(largest.values(), default=1.0) / LEAST) - 1e-9), 5)
    bars = {name: min(max(log10(error / LEAST) / decades, 0.01), 1.0) for name, error in largest.items()}
    top = format_input(round(100.0 * LEAST * 10**decades, 6), "%")
    note = f"A bar shows the largest error of its row, from {format_input(100.0 * LEAST, '%')} to {top}; each mark "
    note += "is ten times the mark before it; "
    in_walls = "error" in (wall_stress(summary) or {})
    stress = "the error of the stress in walls stands under How sure the values are"
    note += f"{stress if in_walls else 'stresses may be further off'}."
    sources = dict[str, list[str]]()
    for name, of in missing.items():
        sources.setdefault("; ".join(dict.fromkeys(of)), []).append(name)
    gaps = {NOT_IN_ERROR.format(_list_names(names)): text for text, names in sources.items() if text}
    rows = tuple((name, with_shown_label(result, text)) for name, text in (texts | gaps).items())
    return Table("How far to trust this run", rows, bars, decades, note if bars else "")


def certainty_rows(result: RunResult) -> Iterator[tuple[str, str]]:
    """Yield rows (name, text) in brief on the errors of stresses, tip, forces and frequencies, all sources added up.

    A run with stresses has a row on their error even if it is not known.  Other errors that are not known have no row,
    and reactions that are all 0 have none.  The last row is on changes by another play of pads, if a run had it.
    """
    summed, reactions = summed_errors(result.summary), result.summary.get("reactions", ())
    without_play = ", without play of pads" if play_summary(result).get("gap") else ""
    if "reduced" in result.summary.get("max_von_mises", {}):
        yield from _stress_certainty_rows(result)
    for key in ("tip", "pad_force", "reaction", "support_force", "frequency"):
        if key == "reaction" and reactions and not any(Extremes.from_summary(of).size for of in reactions):
            continue
        if (error := summed.by_key.get(key)) is not None:
            text = f"± {format_percent(error, 2)}\n{summed.sources_clause(key)}"
            text += _open_pads_clause(result) if key == "frequency" else without_play
            yield with_shown_label(result, QUANTITIES[key].label), text
    if text := _play_text(result):
        yield "play of pads", text


def _open_pads_clause(result: RunResult) -> str:
    """Clause on how much lower the lowest natural frequency is without the pads that are open at rest; empty if not."""
    resting, closed = result.frequencies.resting, result.frequencies.models.get("reduced")
    if resting is None or closed is None or not np.isfinite(resting).any():
        return ""
    lower = 1.0 - float(np.nanmin(resting) / np.nanmin(closed[:, 0]))
    return f"; open pads lower the lowest one by {format_percent(lower, 2)}" if lower >= SMALL_CHANGE else ""


def has_some_reactions(summary: Summary) -> bool:
    """Whether a run compared some reactions of rigid supports with the full model, but has no error of all of them."""
    compared = summary.get("errors", {}).get("reduced_vs_full", {})
    return any(name.startswith(REACTION_OF) for name in compared) and "reaction" not in reduction_error(summary).by_kind


def _play_changes(result: RunResult) -> dict[str, float]:
    """Relative change of each largest value of a run if its pads have another play, by the value's name.

    A name is in plain words, such as ``pad forces``.  A change is negative if the value gets smaller.  The largest
    change, whatever its sign, comes first; the result is empty if there was no run with another play.
    """
    names = {"luffing_force": "luffing cylinder", "probe": "stress at probes", "pad_force": "pad forces",
             "cylinder_force": "extension cylinders", "wall_stress": "stress in walls"}  # fmt: skip
    changes = dict[str, float]()
    for row in play_summary(result).get("rows", ()):
        label = names.get(row["quantity"], QUANTITIES[row["quantity"]].label)
        if row["quantity"] == "tip":
            label = f"deflection of the tip, {direction_words(result, row['name'])}"
        elif force := {"support": "force", "lug_force": "force of a lug"}.get(row["quantity"]):
            label = f"{force} of {row['name']}"
        changes[label] = row["varied"] / row["value"] - 1.0
    return dict(sorted(changes.items(), key=lambda item: -abs(item[1])))


def _play_text(result: RunResult) -> str:
    """Text on the changes of largest values, the largest first, if pads have another play; empty without such a run.

    Changes below `SMALL_CHANGE` are not listed one by one.  If such a run failed, the text gives the reason why the
    changes are not known.
    """
    changes = _play_changes(result)
    if not changes:
        return f"not known: {play_summary(result)['reason']}" if "reason" in play_summary(result) else ""
    listed = [
        f"{name} {'+' if of > 0.0 else ''}{format_percent(of)}"
        for name, of in changes.items()
        if abs(of) >= SMALL_CHANGE
    ]
    listed += [f"all others less than {format_percent(SMALL_CHANGE)}"] if len(listed) < len(changes) else []
    gap, (first, *further) = play_summary(result)["gap"], listed
    further += ["the play is that of both sides together, assumed as the scene states no clearance"] if gap else []
    return ";\n".join(filter(None, (f"{play_words(gap)}: {first}", "; ".join(further))))


def _stress_certainty_rows(result: RunResult) -> Iterator[tuple[str, str]]:
    """Yield a row on the error of the stress in walls at pads, and a row on other stresses, whose error is not known.

    If the first error is not known either, one row says so of all stresses.
    """
    walls, unknown = wall_stress(result.summary), f"error not known, because {' and '.join(_stress_gaps(result))}"
    if walls is None or not (error := wall_stress_error(result.summary)):
        yield "stress", unknown
        return
    parts, by_pads = "by the mesh of the walls", pad_force_error(result.summary)
    if by_pads is not None:
        parts += f" ({format_percent(walls['error'] / walls['value'], 2)}) and the error of the pad forces"
    parts += ", without the error of the pad forces" if by_pads is None else ""
    yield "stress in walls at pads", f"± {format_percent(error, 2)}\n{parts}; if the pads press most at their centre"
    yield "stress elsewhere", f"{unknown}; its value is the row {stress_name(result.scene)}"


def wall_stress_error(summary: Summary) -> float | None:
    """Return the relative error of the largest stress in walls: the error by their mesh plus that of the pad forces.

    If the error of the pad forces is not known, it counts as 0.  The result is None if the `summary` has no such
    stress, if the stress is 0, and for files of earlier versions, which have no error of it.
    """
    walls = wall_stress(summary)
    if walls is None or "error" not in walls or not walls["value"]:
        return None
    return float(walls["error"] / walls["value"]) + (pad_force_error(summary) or 0.0)


def wall_stress_words(summary: Summary) -> str:
    """Words for the largest stress in walls and its error (`wall_stress_error`); empty without such a stress.

    Files of earlier versions have no error, and a value that is a lower bound.
    """
    walls, error = wall_stress(summary), wall_stress_error(summary)
    if walls is None:
        return ""
    value = format_quantity(walls["value"], "Pa")
    return f"at least {value}" if error is None else f"{value} ± {format_quantity(error * walls['value'], 'Pa', 2)}"


def _stress_gaps(result: RunResult) -> Iterator[str]:
    """Yield clauses on what the stresses of beams leave out, and on the cells of shells and solids."""
    are_beams = [traits_of(of).is_beam for of in members(result.scene)]
    if any(are_beams):
        lacks_bending = "the stress of beams lacks the bending of walls under pads"
        yield lacks_bending if stress_remark(result.scene) else "beams have no local stress at pads, loads and corners"
    if not all(are_beams):
        yield "the cells at pads, loads and corners are too long"


def _errors_by_source(summary: Summary) -> dict[str, dict[str, float]]:
    """Relative errors in a run's `summary` by source, then by key of the quantity, the largest first.

    The sources are ``model``, ``mesh``, ``time step`` and ``reduction``; one without an estimate has an empty mapping.
    """
    budget = summary.get("budget") or {}
    mesh = budget.get("mesh")
    return {
        "model": _errors_by_key(budget.get("model") or {}),
        "mesh": _errors_by_key(mesh if isinstance(mesh, dict) else {"beam": mesh}),
        "time step": _errors_by_key(summary.get("step") or {}),
        "reduction": _errors_by_key(reduction_error(summary).by_kind),
    }


@dataclass(frozen=True)
class SummedErrors:
    """Relative errors added up over their sources, by the key of a quantity.

    `sources` has the sources in the sum of each quantity.  `lacking` has the sources that state no error in the
    quantity, without those that cannot affect it.  A quantity is left out if the model or the mesh states errors, but
    none in this quantity.  There are no sums at all unless two sources or more state errors.
    """

    by_key: Mapping[str, float]
    sources: Mapping[str, tuple[str, ...]]
    lacking: Mapping[str, tuple[str, ...]]

    def sources_clause(self, key: str) -> str:
        """Clause that names the sources in the sum of the quantity `key`, and the sources that are not in it."""
        return f"by {_list_names(self.sources[key])}{self.lacking_clause(key)}"

    def lacking_clause(self, *keys: str) -> str:
        """Clause that names the sources that are missing in the sum of at least one of the quantities `keys`.

        The clause is empty if no source is missing.
        """
        names = dict.fromkeys(name for key in keys for name in self.lacking[key])
        return f", without the error of the {' and '.join(names)}" if names else ""


def summed_errors(summary: Summary) -> SummedErrors:
    """Add up the errors of model, mesh, time step and reduction in a run's `summary`, for each quantity."""
    parts = _errors_by_source(summary)
    stated = {name: errors for name, errors in parts.items() if errors}
    needed = [stated[source] for source in ("model", "mesh") if source in stated]
    keys = dict.fromkeys(key for errors in parts.values() for key in errors)
    complete = [key for key in keys if all(key in errors for errors in needed)] if len(stated) > 1 else []
    sources = {key: tuple(name for name in parts if key in parts[name]) for key in complete}
    return SummedErrors(
        {key: sum(parts[name][key] for name in sources[key]) for key in complete},
        sources,
        {
            key: tuple(name for name in parts if name not in (*sources[key], *UNAFFECTED.get(key, ())))
            for key in complete
        },
    )


def pad_force_error(summary: Summary) -> float | None:
    """Return the relative error of pad forces in a `summary`, added up over its sources; None if not known."""
    return summed_errors(summary).by_key.get("pad_force")


def _lacking_clauses(summed: SummedErrors) -> Iterator[str]:
    """Yield a clause for each source that some sums lack, such as "the error of the mesh".

    If other sums have an error of this source, the clause adds the quantities of the sums that lack it.
    """
    for source in dict.fromkeys(name for names in summed.lacking.values() for name in names):
        keys = [key for key, names in summed.lacking.items() if source in names]
        stated = [key for key in summed.by_key if key not in keys and source in summed.sources[key]]
        labels = " and ".join(QUANTITIES[key].label for key in keys)
        yield f"the error of the {source}" + (f" in {labels}" if stated else "")


def _step_words(step: Mapping[str, object]) -> str:
    """Words before the error of the time step: "of the mean motion, ", "at least ", both or none.

    "At least" stands before an error that is a lower bound, as it did not settle with smaller steps.  `step` is the
    entry ``step`` of the summary.
    """
    least = "at least " if not step.get("settled", True) else ""
    return f"{'of the mean motion, ' if step.get('by') == 'mean' else ''}{least}"


def _estimate_words(result: RunResult) -> str:
    """Clauses on the estimated error of the reduction: how it was made, its ratio to the true error, and probes.

    If the error is neither estimated nor computed, the text is the reason for this.  It is empty if no estimate was
    made, or if only the true error is known.
    """
    estimate = result.summary.get("estimate")
    true = result.summary.get("errors", {}).get("reduced_vs_full", {}).get("beam")
    if estimate is None or (estimate.get("beam") is None and true is not None):
        return ""
    if estimate.get("beam") is None:
        return f"not known, not even by an estimate: {estimate['reason']}" if "reason" in estimate else ""
    by_model = estimate.get("by") == "other model"
    words = "the error is estimated by a model of free modes" if by_model else "the estimate has a margin of a quarter"
    if ratio := times_the_true_error(estimate["beam"], true):
        words = f"the estimated error {scope_words(result)} is {ratio}"
    probes = estimate.get("probe")
    if probes is None:
        return words
    bound = format_percent(probes)
    return f"{words}; the estimated error at probes is {bound if bound.startswith('less') else f'at most {bound}'}"


def _reason_without_model_error(model: Mapping[str, object]) -> str:
    """Clause with the reason why the model's own error is not known, or with the scene's key that has it measured."""
    reason = str(model.get("reason") or "not measured (key compare.richer of the scene)")
    return reason if reason.startswith("not ") else f"not known: {reason}"


def _errors_by_key(part: Mapping[str, float | None]) -> dict[str, float]:
    """Relative errors of one source, the largest first, by the keys of the quantities, such as ``tip``.

    `part` holds these errors in a summary.  Keys that are not in `STATED`, and errors that are None, are left out.
    """
    errors = {key: error for key in STATED if (error := part.get(key)) is not None}
    return dict(sorted(errors.items(), key=lambda item: -item[1]))


def _list_names(names: Sequence[str]) -> str:
    """List one or more names, with ``and`` before the last one."""
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))


def _list_without_round_off(
    result: RunResult, errors: Mapping[str, float], digits: int = 3, unsettled: Collection[str] = ()
) -> str:
    """List those `errors`, by key of the quantity, that are at least `LEAST`, in words, with `digits` digits.

    If all errors are smaller, the text says so; if there are no errors, it is empty.  Errors with a key in `unsettled`
    are lower bounds.
    """
    parts = [
        f"{QUANTITIES[key].label}{f' {scope_words(result)}' * (key == 'beam')} {'at least ' * (key in unsettled)}"
        f"{format_percent(error, digits)}{' (not converged)' * (key in unsettled)}"
        for key, error in errors.items()
        if error >= LEAST
    ]
    return ", ".join(parts) or (f"less than {format_percent(LEAST, 1)}" if errors else "")
