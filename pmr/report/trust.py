"""How far the figures of a run are off: model, mesh, time step and reduction, a bar each, and what is not covered."""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil, log10
from typing import Any

from pmr.report.blocks import Table
from pmr.report.model_error import CALLED as MODELS
from pmr.report.numbers import SPACE, percent, plain
from pmr.report.subject import along
from pmr.results import RunResult
from pmr.scene.choice import model_of
from pmr.scene.members import members

#: What a model's part states over a run, as rows call it.
PARTS = {
    "beam": "displacements",
    "largest": "largest displacement",
    "pad_force": "pad forces",
    "cylinder_force": "cylinder forces",
    "support_force": "supports",
    "frequency": "lowest frequencies",
}
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
    errors = summary.get("errors", {}).get("reduced_vs_full", {})
    model, mesh = budget.get("model") or {}, budget.get("mesh")
    shares = {
        "model": max(_off(model).values(), default=None),
        "mesh": mesh.get("beam") if isinstance(mesh, dict) else mesh,
        "time step": step.get("beam"),
        "reduction": errors.get("beam", estimate.get("beam")),
    }
    said = {
        "model": _model(model),
        "mesh": _percent(shares["mesh"]) or budget.get("mesh_reason") or NO_MESH,
        "time step": _percent(step.get("beam")) or f"not known{_reason(step)}",
        "reduction": _reduction(errors, estimate),
    }
    known = {name: share for name, share in shares.items() if share}
    decades = max(ceil(log10(max(known.values(), default=1.0) / LEAST) - 1e-9), 5)
    walls = [WALLS] if _stressed_beams(result) else []
    missing = {
        "not in the model's bar": model.get("not_covered") or walls,
        "not in the reduction's bar": estimate.get("not_covered") or (),
        "not looked at": _between(result),
    }
    rows = (*said.items(), *((name, "; ".join(dict.fromkeys(parts))) for name, parts in missing.items() if parts))
    bars = {name: min(max(log10(share / LEAST) / decades, 0.01), 1.0) for name, share in known.items()}
    top = f"{plain(round(100.0 * LEAST * 10**decades, 6))}{SPACE}%"
    note = f"How far off figures are, from small on the left to large: {plain(100.0 * LEAST)}{SPACE}% to {top}, ten "
    note += "times as much from mark to mark. The bars of mesh, time step and reduction are for displacements "
    note += f"{along(result)}; forces and stresses may be further off."
    return Table("How far to trust it", rows, bars, decades, note if bars else "")


def _model(found: Mapping[str, Any]) -> str:
    if found.get("beside") is None:
        reason = found.get("reason") or "compare.richer measures it"
        return reason if reason.startswith("not ") else f"not known: {reason}"
    off = _off(found)
    parts = [f"{called} {percent(off[called])}" for called in sorted(off, key=lambda one: -off[one])]
    return f"beside {MODELS[found['beside']]}: {', '.join(parts) or f'less than {percent(LEAST, 1)}'}"


def _off(model: Mapping[str, Any]) -> dict[str, float]:
    """What a model's part states, as rows call it, of what is worth a bar."""
    return {called: model[kind] for kind, called in PARTS.items() if (model.get(kind) or 0.0) >= LEAST}


def _reduction(errors: Mapping[str, Any], estimate: Mapping[str, Any]) -> str:
    if "beam" in errors:
        return f"{percent(errors['beam'])} off the full model"
    known = _percent(estimate.get("beam"))
    return f"{known}, estimated" if known else "not known: nothing was compared with a full model"


def _stressed_beams(result: RunResult) -> bool:
    """Whether stresses are asked for of a beam."""
    asked = "reduced" in result.summary.get("max_von_mises", {})
    return asked and any(model_of(member).startswith("beam") for member in members(result.scene))


def _between(result: RunResult) -> list[str]:
    recovery = result.scene.recovery
    if recovery is None or "reduced" not in result.summary.get("max_von_mises", {}):
        return []
    return [f"stresses of the body between times {plain(recovery.every)}{SPACE}s apart (recovery.every)"]


def _percent(value: float | None) -> str:
    return percent(value) if value is not None else ""


def _reason(found: Mapping[str, Any]) -> str:
    return f": {found['reason']}" if found.get("reason") else ""
