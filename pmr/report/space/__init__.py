"""The part of a report about a structure in space."""

from pmr.report.space.document import case

__all__ = ["case"]
