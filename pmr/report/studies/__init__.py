"""Report of a study or a collection, from what `pmr study` left in a folder; nothing is computed for it."""

from pmr.report.studies.document import write_report

__all__ = ["write_report"]
