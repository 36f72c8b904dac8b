"""A report that another process draws beside the run it is about.

Results go there as soon as they are found, in the end the summaries, which are all that may have changed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from pmr.errors.aside import Aside
from pmr.errors.environment import uncollected
from pmr.report import paper
from pmr.report.blocks import Figures, ReportFiles
from pmr.results import RunResult

#: In the process that draws: what it drew.
_drawn = list[tuple[RunResult, Figures]]()


class Beside:
    """Draws in the process that works `aside`, or in this one where there is none."""

    def __init__(self, aside: Aside) -> None:
        self.aside = aside
        aside.ask(_load)

    def draw(self, result: RunResult) -> None:
        """Let its figures be drawn: of all in a summary they only don't show ``budget``."""
        self.aside.ask(_draw, result)

    def write(self, results: Sequence[RunResult], folder: Path) -> ReportFiles:
        """The report of all results, which were handed to `draw` in this order: see `pmr.report.document`."""
        well, _ = self.aside.ask(_write, folder.absolute(), [result.summary for result in results])()
        if well:
            return ReportFiles.within(folder)
        from pmr.report.document import write_report

        return write_report(results, folder)


@uncollected(keep=True)
def _load() -> None:
    """Each takes its time to load."""
    from pmr.report.document import templates

    paper.weasyprint()
    for name in templates().list_templates():
        templates().get_template(name)


@uncollected(keep=True)
def _draw(result: RunResult) -> None:
    from pmr.report.document import drawn

    _drawn.append((result, drawn(result, len(_drawn) + 1)))


@uncollected(keep=True)
def _write(folder: Path, summaries: Sequence[dict[str, Any]]) -> None:
    from pmr.report.document import write_report

    final = [replace(result, summary=summary) for (result, _), summary in zip(_drawn, summaries, strict=True)]
    write_report(final, folder, [figures for _, figures in _drawn])
