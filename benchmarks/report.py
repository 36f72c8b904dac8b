"""The page of a benchmark run: reads the results, computes nothing but ratios."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jinja2

from benchmarks import pages
from pmr.report.figures.vector import FONT, words
from pmr.report.fonts import embedded
from pmr.report.numbers import SPACE, plain, quantity, significant
from pmr.report.provenance import Table
from pmr.report.studies.content import Grid
from pmr.report.studies.page import Plate, Section

#: Load of the machine, in processes that want to run, from which on times are called disturbed.
BUSY = 0.5


def write(results: Mapping[str, Any], folder: Path) -> Path:
    """Write benchmarks.html into `folder`."""
    sections = [
        _section(name, title, content(results["sections"][name], f"bench-{name}"))
        for name, (title, content) in pages.PAGES.items()
        if name in results["sections"]
    ]
    packages = [jinja2.PackageLoader("pmr.report.studies"), jinja2.PackageLoader("pmr.report")]
    own = jinja2.FileSystemLoader(Path(__file__).with_name("templates"))
    environment = jinja2.Environment(
        loader=jinja2.ChoiceLoader([own, *packages]),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    drawn = (plate for s in sections for block in s.content.blocks for row in block.rows for plate in row)
    text = "".join(words(plate.svg) for plate in drawn)
    page = environment.get_template("benchmarks.html").render(
        title="How fast, and how far from what is possible",
        circumstances=_circumstances(results),
        sections=sections,
        requirements=_requirements(results["requirements"]),
        font=embedded(FONT, "".join(sorted(set(text)))),
        provenance=_provenance(results),
        software=[f"{name}{SPACE}{version}" for name, version in results["versions"].items()],
    )
    file = folder / "benchmarks.html"
    file.write_text(page, encoding="utf-8")
    return file


def _section(name: str, title: str, content: Any) -> Section:
    anchor = f"bench-{name}"
    plates = [Plate(f"{anchor}-{i}", block.heading) for i, block in enumerate(content.blocks, start=1)]
    return Section(anchor, title, "", content, [], [], plates, [])


def _circumstances(results: Mapping[str, Any]) -> list[str]:
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
    return f"{significant(value, 3)}{SPACE}×" if unit == "ratio" else quantity(value, unit)


def _provenance(results: Mapping[str, Any]) -> list[list[Table]]:
    about = results["about"]
    took = tuple((pages.PAGES[name][0], quantity(one["seconds"], "s")) for name, one in about.items())
    load = tuple((pages.PAGES[name][0], plain(round(one["load_before"], 2))) for name, one in about.items())
    commits = sorted({str(one["commit"]) for one in about.values()})
    machine = tuple(results["machine"].items()) + (("commit", ", ".join(commits)),)
    return [[Table("Machine", machine)], [Table("Time taken", took)], [Table("Load when a section began", load)]]
