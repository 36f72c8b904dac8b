"""A page of a report on paper: the same as PDF."""

from __future__ import annotations

import re
from base64 import b64encode
from pathlib import Path

from pmr.errors.environment import needed
from pmr.report.blocks import END_OF_SCREEN, SCREEN


def print_page(text: str, file: Path) -> None:
    """Write a page of HTML as PDF."""
    needed("weasyprint").HTML(string=_on_paper(text)).write_pdf(file)  # takes a second to load


def _on_paper(text: str) -> str:
    """The page without what only a screen shows or a script reads, and with figures as images that stand in it whole.

    As parts of the page each of their lines would be read, and given styles, by what was made for pages: half the time
    that a PDF takes.
    """

    def placed(found: re.Match[str]) -> str:
        style, drawn = found.groups()
        if style is not None:
            return re.sub(r"\bsvg(?= \{)", "embed", style)
        image = f'<svg xmlns="http://www.w3.org/2000/svg"{drawn}'
        return f'<embed type="image/svg+xml" src="data:image/svg+xml;base64,{b64encode(image.encode()).decode()}">'

    text = re.sub(rf"{SCREEN}.*?{END_OF_SCREEN}|<script\b.*?</script>", "", text, flags=re.DOTALL)
    return re.sub(r"(<style\b.*?</style>)|<svg\b(.*?</svg>)", placed, text, flags=re.DOTALL)
