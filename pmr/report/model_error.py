"""The model's own error in words: static answers and frequencies beside a richer model, or that it is not known."""

from __future__ import annotations

from collections.abc import Iterator

from pmr.report.blocks import KeyNumber
from pmr.report.numbers import percent
from pmr.report.subject import along
from pmr.results import RunResult

#: What the models are called with which others are compared.
CALLED = {"beam3d": "a beam in space", "shell": "a shell"}
OF = {
    "tip": "at the tip",
    "pad_force": "in the pad forces",
    "cylinder_force": "in the cylinder forces",
    "support_force": "in the forces of supports",
}


def model(result: RunResult) -> str:
    """In two or three sentences; that it is not known in one, with the key that tells it."""
    found = result.summary.get("budget", {}).get("model")
    if found is None:
        return "How far the structural model itself is off is not known: compare.richer measures it."
    if found["beside"] is None:
        return f"How far the structural model itself is off is not known: {found['reason']}."
    shares = {"beam": along(result), **OF}
    off = [f"{percent(found[kind])} {of}" for kind, of in shares.items() if found.get(kind) is not None]
    static = f"the model's static answers are off by {', '.join(off)}; " if off else ""
    return (
        f"Beside {CALLED[found['beside']]} of the same bodies, pads and loads {static}"
        f"its two lowest frequencies are off by up to {percent(found['frequency'])}, at the ends and in the middle of "
        f"the path. Not compared: {'; '.join(found['not_covered'])}."
    )


def key_number(result: RunResult) -> Iterator[KeyNumber]:
    """The model's part of the budget, for the first page; nothing where it is not known."""
    found = result.summary.get("budget", {}).get("model")
    if found is None or found["beside"] is None or found.get("beam") is None:
        return
    more = f"lowest frequencies {percent(found['frequency'])}; beside {CALLED[found['beside']]}"
    yield KeyNumber(percent(found["beam"]), "the model's own error, static", more)
