"""What examples need of the gallery: their order, and pages of reports in frames, to play and to turn.

A script leaves such a page as HTML in `report`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pmr.report import document

#: In which order examples are shown.
EXAMPLES = (
    "sliding_beam", "own_beam", "residual_flexibility", "saved_model", "study", "accuracy", "pushing_pads", "crane",
    "crane_on_turret", "anti_sway", "set_down", "emergency_stop", "load_chart", "shell_boom", "weld", "sections",
    "own_mesh", "matrices", "real_time", "velocity_feedback", "tip_damping", "leveled_basket", "luffing_oil",
    "driven_extension", "fmu", "own_basis",
)  # fmt: skip
FRAME = """
.. raw:: html

   <iframe class="report" src="../_static/{name}" title="Report" loading="lazy"></iframe>
   <p><a href="../_static/{name}">The report on a page of its own</a></p>

"""


def report(block: Any, variables: dict[str, Any], settings: dict[str, Any]) -> str:
    """Markup for one block of a script; the page goes to what is copied with the manual."""
    text = variables["example_globals"].pop("report", None)
    if text is None:
        return ""
    name = f"report_{Path(variables['src_file']).stem}.html"
    Path(settings["src_dir"], "_static", name).write_text(text, encoding="utf-8")
    return FRAME.format(name=name)


def unprinted(settings: dict[str, Any], file: str) -> None:
    """The manual shows pages of reports and no PDF, which would take longer than the page."""
    document.write_pdf = lambda text, file: file.touch()


def in_order(file: str) -> int:
    """Place of an example."""
    return EXAMPLES.index(Path(file).stem)


def _get_sg_image_scraper() -> Any:
    """By this name sphinx-gallery looks for it."""
    return report
