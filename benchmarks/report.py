"""Page of a benchmark run: reads results and computes nothing but ratios."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks import pages
from pmr.report.blocks import Block, Chapter, Grid, Table
from pmr.report.document import render
from pmr.report.numbers import SPACE, format_input, format_quantity, significant

#: Load of the machine, in processes that want to run, from which on times are called disturbed.
BUSY = 0.5


def write(results: Mapping[str, Any], folder: Path) -> Path:
    """Write benchmarks.html into `folder` and return its path."""
    chapters = [
        replace(content(results["sections"][name], f"bench-{name}"), title=title)
        for name, (title, content) in pages.PAGES.items()
        if name in results["sections"]
    ]
    asked = Block("Requirements", grids=(_requirements(results["requirements"]),))
    software = [f"{name}{SPACE}{version}" for name, version in results["versions"].items()]
    origin = Block("Machine and software", tables=_provenance(results), software=software)
    page = render(
        "study_report.html",
        "How fast, and how far from what is possible",
        [
            Chapter(anchor="requirements", title="What is asked for", blocks=(asked,)),
            *chapters,
            Chapter(anchor="provenance", title="Provenance", blocks=(origin,)),
        ],
        kind="Benchmarks",
        introduction=_circumstances(results),
    )
    file = folder / "benchmarks.html"
    file.write_text(page, encoding="utf-8")
    return file


def _circumstances(results: Mapping[str, Any]) -> list[str]:
    """Paragraphs on how times were measured, and on how busy the machine was."""
    machine, about = results["machine"], results["about"]
    busiest = max(one["load_before"] for one in about.values())
    paragraphs = [
        "Whatever is compared was measured side by side in one run, repeat after repeat in turn, in one process on one "
        f"thread, with compiling and loading left out. Processor: {machine['processor']}, {machine['cores']} cores."
    ]
    if busiest > BUSY:
        paragraphs.append(
            f"Other work was running on the machine (up to {significant(busiest, 2)} processes when a section began): "
            "medians and worst cases are larger than on a quiet machine, and ratios of long runs to short ones too."
        )
    return paragraphs


def _requirements(judged: list[dict[str, Any]]) -> Grid:
    """Build the table of requirements with their values and bounds."""
    rows = tuple(
        (
            one["text"],
            _value(one["value"], one["unit"]),
            f"{'≥' if one['least'] else '≤'}{SPACE}{_value(one['bound'], one['unit'])}",
            "holds" if one["holds"] else "missed",
        )
        for one in judged
    )
    held = sum(one["holds"] for one in judged)
    return Grid(f"{held} of {len(judged)} hold.", ("requirement", "here", "asked for", ""), rows)


def _value(value: float, unit: str) -> str:
    """Format a value with its unit; ``ratio`` is printed with ×."""
    return f"{significant(value, 3)}{SPACE}×" if unit == "ratio" else format_quantity(value, unit)


def _provenance(results: Mapping[str, Any]) -> list[Table]:
    """Build tables of the machine, and of the time taken and the machine's load by section."""
    about = results["about"]
    took = tuple((pages.PAGES[name][0], format_quantity(one["seconds"], "s")) for name, one in about.items())
    load = tuple((pages.PAGES[name][0], format_input(round(one["load_before"], 2))) for name, one in about.items())
    commits = sorted({str(one["commit"]) for one in about.values()})
    machine = tuple(results["machine"].items()) + (("commit", ", ".join(commits)),)
    return [Table("Machine", machine), Table("Time taken", took), Table("Load when a section began", load)]
