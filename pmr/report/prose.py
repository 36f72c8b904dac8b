"""Longer texts of pages: macros of the template `prose.txt`, which get numbers and names and choose the words."""

from __future__ import annotations

import re
from functools import cache
from typing import Any

from pmr.report.numbers import SPACE, format_input, format_percent, format_quantity, format_time, significant


def prose(macro: str, /, **values: Any) -> str:
    """Return the text of a macro for its arguments `values`, on one line, as plain text."""
    text = getattr(_macros(), macro)(**values)
    return re.sub(r"[ \n]+", " ", str(text)).strip()


def format_digits(value: float, digits: int, unit: str = "") -> str:
    """Format a value with at most `digits` significant digits, and with its `unit`."""
    return f"{value:.{digits}g}{SPACE if unit else ''}{unit}"


@cache
def _macros() -> Any:
    """Macros of `prose.txt` as functions; imports Jinja, which only pages need."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(loader=PackageLoader("pmr.report"), undefined=StrictUndefined)
    environment.globals["nbsp"] = SPACE
    environment.filters |= {
        "digits": format_digits,
        "input": format_input,
        "percent": format_percent,
        "quantity": format_quantity,
        "significant": significant,
        "time": format_time,
    }
    return environment.get_template("prose.txt").module
