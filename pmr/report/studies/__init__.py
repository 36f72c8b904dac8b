"""The report of a study or a collection: reads what `pmr study` left in a folder and computes nothing."""

from pmr.report.studies.document import write_report

__all__ = ["write_report"]
