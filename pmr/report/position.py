"""Where a boom in a frame that moves is in space."""

from __future__ import annotations

from pmr.report.blocks import Block, Drawing
from pmr.report.columns import lines
from pmr.report.figures import space
from pmr.report.figures.canvas import drawing
from pmr.report.space import slews
from pmr.results import RunResult


def in_space(result: RunResult, prefix: str) -> Block | None:
    """The boom where it is, where its fields are played; nothing without a frame."""
    played = any(body.fields is not None for body in result.bodies.values())
    if result.scene.frame is None or not played or not lines(result, result.responses["reduced"]):
        return None
    return Block(heading="The boom in space", rows=rows(result, prefix))


def rows(result: RunResult, prefix: str) -> tuple[tuple[Drawing, ...], ...]:
    """The boom from above where it slews, its tip over time, and the buckling factor where there is one."""
    caption = "The tip over time: its distance from the pivot in the plane of luffing, and its height over the pivot."
    row = [drawing(f"{prefix}-tip-in-space", space.tip, caption, result)]
    if slews(result):  # from the side it stands at the top of the page
        row.insert(0, drawing(f"{prefix}-plan", space.plan, space.caption(result, "from above"), result))
    drawing_rows = [tuple(row)]
    if any(result.summary.get("buckling", {}).get("over", {}).get("factor", ())):
        caption = (
            "By what all axial forces would have to grow until the boom buckles, with every pad closed, along the "
        )
        caption += "way of this run, which begins at the larger dot."
        captions = (("reach", caption), ("angle", "The same over the angle of luffing."))
        drawing_rows.append(
            tuple(drawing(f"{prefix}-buckling-{x}", space.buckling, caption, result, x) for x, caption in captions)
        )
    return tuple(drawing_rows)
