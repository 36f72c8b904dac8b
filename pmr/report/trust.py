"""How far the figures of a run are off: model, mesh, time step and reduction, a bar each, and what is not covered."""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil, log10
from typing import Any

from pmr.report.blocks import Table
from pmr.report.model_error import CALLED as MODELS
from pmr.report.numbers import SPACE, percent, plain
from pmr.report.subject import scope
from pmr.results import RunResult
from pmr.results.reduction_error import reduction_error
from pmr.scene.choice import model_of
from pmr.scene.members import members

#: What parts of the budget state, as rows call it.
PARTS = {
    "beam": "displacements",
    "largest": "largest displacement",
    "pad_force": "pad forces",
    "cylinder_force": "cylinder forces",
    "support_force": "supports",
    "reaction": "reactions",
    "frequency": "lowest frequencies",
}
#: Where the reduction's error is not known.
NOT_COMPARED = "not known: nothing was compared with a full model"
#: What measures what the mesh takes.
NO_MESH = "not known: a run with [accuracy] measures it"
#: Bars begin at this error.
LEAST = 1e-5
#: Of stresses of beams, whatever else is known.
WALLS = "in stresses the bending of a beam's walls under pads, which a shell has"


def table(result: RunResult) -> Table:
    """A row each; those whose error is known have a bar, on one scale of powers of ten."""
    summary = result.summary
    budget, step, estimate = (summary.get(name) or {} for name in ("budget", "step", "estimate"))
    model, mesh = budget.get("model") or {}, budget.get("mesh")
    source, reduced = reduction_error(summary)
    shares = {
        "model": _off(model),
        "mesh": _off(mesh if isinstance(mesh, dict) else {"beam": mesh}),
        "time step": _off(step),
        "reduction": _off(reduced),
    }
    texts = {
        "model": _model(model),
        "mesh": _list_errors(shares["mesh"]) or budget.get("mesh_reason") or NO_MESH,
        "time step": _list_errors(shares["time step"]) or f"not known{_reason(step)}",
        "reduction": f"{source}: {_list_errors(shares['reduction'])}" if reduced else NOT_COMPARED,
    }
    largest = {name: most for name, of in shares.items() if (most := max(of.values(), default=0.0))}
    decades = max(ceil(log10(max(largest.values(), default=1.0) / LEAST) - 1e-9), 5)
    walls = [WALLS] if _stressed_beams(result) else []
    missing = {
        "not in the model's bar": model.get("not_covered") or walls,
        "not in the mesh's bar": budget.get("mesh_not_covered") or (),
        "not in the time step's bar": step.get("not_covered") or (),
        "not in the reduction's bar": estimate.get("not_covered") or (),
        "not looked at": _times_between(result),
    }
    rows = (*texts.items(), *((name, "; ".join(dict.fromkeys(parts))) for name, parts in missing.items() if parts))
    bars = {name: min(max(log10(share / LEAST) / decades, 0.01), 1.0) for name, share in largest.items()}
    top = f"{plain(round(100.0 * LEAST * 10**decades, 6))}{SPACE}%"
    note = f"How far off figures are, from small on the left to large: {plain(100.0 * LEAST)}{SPACE}% to {top}, ten "
    note += f"times as much from mark to mark. Displacements are those {scope(result)}; stresses may be further off."
    return Table("How far to trust it", rows, bars, decades, note if bars else "")


def _model(model_part: Mapping[str, Any]) -> str:
    if model_part.get("beside") is None:
        reason = model_part.get("reason") or "compare.richer measures it"
        return reason if reason.startswith("not ") else f"not known: {reason}"
    return f"beside {MODELS[model_part['beside']]}: {_list_errors(_off(model_part))}"


def _off(part: Mapping[str, Any]) -> dict[str, float]:
    """Errors that a part of the budget states, by the words of rows, the largest first."""
    errors = {called: float(part[kind]) for kind, called in PARTS.items() if part.get(kind) is not None}
    return dict(sorted(errors.items(), key=lambda item: -item[1]))


def _list_errors(off: Mapping[str, float]) -> str:
    """List errors that are worth a bar in words; empty where none is known."""
    parts = [f"{called} {percent(error)}" for called, error in off.items() if error >= LEAST]
    return ", ".join(parts) or (f"less than {percent(LEAST, 1)}" if off else "")


def _stressed_beams(result: RunResult) -> bool:
    """Whether stresses are asked for of a beam."""
    has_stresses = "reduced" in result.summary.get("max_von_mises", {})
    return has_stresses and any(model_of(member).startswith("beam") for member in members(result.scene))


def _times_between(result: RunResult) -> list[str]:
    recovery = result.scene.recovery
    if recovery is None or "reduced" not in result.summary.get("max_von_mises", {}):
        return []
    return [f"stresses of the body between times {plain(recovery.every)}{SPACE}s apart (recovery.every)"]


def _reason(part: Mapping[str, Any]) -> str:
    return f": {part['reason']}" if part.get("reason") else ""
