"""Report of a study or a collection, from the files that `pmr study` left in a folder; no new values are computed."""

from pmr.report.studies.document import write_report

__all__ = ["write_report"]
