"""The model's own error in words: its motion and frequencies beside a richer model's, or that it is not known."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from pmr.report.blocks import KeyNumber
from pmr.report.numbers import percent
from pmr.report.subject import chosen_by, is_alone, scope, spoken
from pmr.results import RunResult

#: What the models are called with which others are compared.
CALLED = {"beam3d": "a beam in space", "shell": "a shell", "coarse shell": "a coarse shell"}
OF = {
    "tip": "at the tip",
    "pad_force": "in the pad forces",
    "cylinder_force": "in the cylinder forces",
    "support_force": "in the forces of supports",
    "reaction": "in the reactions",
}
#: What parts other than the model's state besides.
ALSO = {"frequency": "in the lowest frequencies"}


def model(result: RunResult) -> str:
    """In two or three sentences; that it is not known in one, with the key that tells it."""
    model_part, chosen = result.summary.get("budget", {}).get("model"), result.summary.get("chosen_model")
    why = "" if chosen is None or is_alone(result) else f"Sections are {_chosen(chosen)}. "
    if model_part is None:
        richest = "" if chosen is None else " for a shell, the richest one there is"
        return (
            f"{why}How far the structural model itself is off is not known{richest or ': compare.richer measures it'}."
        )
    if model_part["beside"] is None:
        reason = model_part["reason"]
        unknown = reason if reason.startswith("not ") else f"not known: {reason}"
        return f"{why}How far the structural model itself is off is {unknown}."
    shares = {"beam": scope(result), **OF}
    off = [f"{percent(model_part[kind])} {of}" for kind, of in shares.items() if model_part.get(kind) is not None]
    errors_text = f"the model is off by {', '.join(off)} over the run; " if off else ""
    most = (
        f" and its largest displacement by {percent(model_part['largest'])}"
        if model_part.get("largest") is not None
        else ""
    )
    vibrates = f"its two lowest frequencies are off by up to {percent(model_part['frequency'] or 0.0)} along the path"
    comparison = f"Beside {CALLED[model_part['beside']]} of the same bodies, pads and loads"
    return f"{why}{comparison} {errors_text}{vibrates}{most}. Not compared: {'; '.join(model_part['not_covered'])}."


def _chosen(choice: Mapping[str, Any]) -> str:
    return f"{spoken(choice['name'], choice['walls'])}, {chosen_by(choice)}"


def key_number(result: RunResult) -> Iterator[KeyNumber]:
    """The model's part of the budget, for the first page; nothing where it is not known."""
    model_part = result.summary.get("budget", {}).get("model")
    if model_part is None or model_part["beside"] is None or model_part.get("beam") is None:
        return
    frequencies = percent(model_part["frequency"] or 0.0)
    more = f"{scope(result)}; lowest frequencies {frequencies}; beside {CALLED[model_part['beside']]}"
    yield KeyNumber(percent(model_part["beam"]), "the model's own error", more)
