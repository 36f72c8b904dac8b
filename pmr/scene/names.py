"""What bodies and what belongs to them are called."""

from __future__ import annotations

#: What a body alone is called in a system, and the path on which its moving rows travel.
ALONE, SLIDER = "", "slider"


def input_of(body: str, what: str) -> str:
    """Name of an input of a body among those of all bodies; of a body alone as it is."""
    return what if body == ALONE else f"{body}.{what}"


def named(body: str, what: str) -> str:
    """Name of something of a body among those of all bodies; of a body alone as it is."""
    return what if body == ALONE else f"{body}: {what}"


def cylinder_of(section: str) -> str:
    """Name of the contact that drives a section along the boom."""
    return f"cylinder of {section}"
