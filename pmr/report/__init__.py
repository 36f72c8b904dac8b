"""The report: one HTML page and one PDF of results, to which it adds nothing but form."""

from pmr.report.document import ReportFiles, write_report

__all__ = ["ReportFiles", "write_report"]
