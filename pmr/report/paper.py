"""A page of a report on paper: the same as PDF."""

from __future__ import annotations

import ctypes.util
import re
from base64 import b64encode
from pathlib import Path
from typing import Any

from pmr.errors import InputError
from pmr.errors.environment import needed
from pmr.report.blocks import END_OF_SCREEN, SCREEN


def print_page(text: str, file: Path) -> None:
    """Write a page of HTML as PDF."""
    weasyprint().HTML(string=_on_paper(text)).write_pdf(file)


def weasyprint() -> Any:
    """The package, which loads Pango and other libraries.

    It asks for each by several names.  Under those of other systems the compiler, the linker and the list of libraries
    would be asked too, in some fifty processes.  So they are asked only where no name is that of a file.
    """
    name, find = "weasyprint", ctypes.util.find_library

    def nowhere(name: str) -> str | None:
        return None

    ctypes.util.find_library = nowhere
    try:
        return needed(name)
    except InputError:
        ctypes.util.find_library = find
        return needed(name)
    finally:
        ctypes.util.find_library = find


def _on_paper(text: str) -> str:
    """The page without what only a screen shows or a script reads, and with figures as images that stand in it whole.

    As parts of the page each of their lines would be read, and given styles, by what was made for pages: half the time
    that a PDF takes.
    """

    def embed_figure(match: re.Match[str]) -> str:
        style, drawn = match.groups()
        if style is not None:
            return re.sub(r"\bsvg(?= \{)", "embed", style)
        image = f'<svg xmlns="http://www.w3.org/2000/svg"{drawn}'
        return f'<embed type="image/svg+xml" src="data:image/svg+xml;base64,{b64encode(image.encode()).decode()}">'

    text = re.sub(rf"{SCREEN}.*?{END_OF_SCREEN}|<script\b.*?</script>", "", text, flags=re.DOTALL)
    return re.sub(r"(<style\b.*?</style>)|<svg\b(.*?</svg>)", embed_figure, text, flags=re.DOTALL)
