"""Draws the README's picture from the results of `make report`."""

from pathlib import Path

from pmr.report.figures import style
from pmr.report.figures.histories import Timeline, history_figure
from pmr.results import RunResult

REPORTS = Path(__file__).parents[1] / "reports"

with style():
    result = RunResult.load(REPORTS / "paper" / "paper_evolved")
    time = Timeline(result)
    tip = time.signals(lambda response: response.tip)
    figure = history_figure(time, tip, "Displacement", "m")
    figure.savefig(REPORTS / "readme.png", dpi=160, facecolor="white")
