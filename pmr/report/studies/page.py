"""A study's part of the page."""

from __future__ import annotations

import importlib
import pkgutil
from dataclasses import replace

from pmr.report.blocks import Block, Chapter
from pmr.report.studies import runs, sections
from pmr.report.studies.finished import FinishedStudy
from pmr.report.studies.names import called
from pmr.report.studies.statements import comparison


def chapter(study: FinishedStudy, anchor: str) -> Chapter:
    """Everything that the report says about one study; while a run is missing, what the runs say that are there."""
    known = {module.name for module in pkgutil.iter_modules(sections.__path__)}
    if study.kind in known and not study.unfinished:
        found: Chapter = importlib.import_module(f"{sections.__name__}.{study.kind}").content(study, anchor)
    else:
        found = runs.content(study, anchor)
    published = comparison(study)
    if published.rows and not any(block.errors for block in found.blocks):
        found = replace(found, blocks=[*found.blocks, Block("Beside the publication", errors=published)])
    unfinished = [f"{called(run)} ({run.status}: {run.reason})" for run in study.unfinished]
    return replace(found, unfinished=unfinished)
