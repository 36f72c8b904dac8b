"""Forces and moments along beams in a report: a figure, and their extremes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from boom_results import MakeSpace
from matplotlib.colors import same_color

from pmr.report.figures.canvas import section_colours
from pmr.report.figures.loads import envelope_figure
from pmr.report.stresses import section_force_block
from pmr.results import BodyResult, RunResult
from pmr.results.field_stress import Envelope

SPACE = "\u00a0"


def with_envelope(result: RunResult, back: float = -2e3) -> RunResult:
    """Of a beam that is bent, and pulled by a 1e-4 of that at most."""
    x, t = np.array([0.0, 3.0, 6.0]), np.full((2, 3), 0.5)
    least = np.array([[-10.0, 0.0, 0.0], [back, 0.5 * back, 0.0]])
    most = np.array([[10.0, 0.0, 0.0], [158e3, 80e3, 0.0]])
    along = Envelope(("normal force", "bending moment y"), ("N", "N m"), x, least, t, most, t)
    summary = result.summary | {"section_forces": {"reduced": along.extremes()}}
    return replace(result, bodies={"": BodyResult(envelopes={"reduced": along})}, summary=summary)


def test_extremes_are_in_a_table_and_round_off_is_not(make_space: MakeSpace) -> None:
    plain = make_space()
    assert section_force_block(plain, "run") is None
    block = section_force_block(with_envelope(plain), "run")
    assert block is not None and len(block.rows) == 1
    (row,) = block.grids[0].rows
    assert row[0] == "bending moment y"
    assert row[1:] == (f"−2.00{SPACE}kN m at 0{SPACE}m, 0.5{SPACE}s", f"158{SPACE}kN m at 0{SPACE}m, 0.5{SPACE}s")


def test_an_end_that_is_nothing_has_no_place(make_space: MakeSpace) -> None:
    block = section_force_block(with_envelope(make_space(), back=-1.0), "run")
    assert block is not None and block.grids[0].rows[0][1] == "0"


def test_the_figure_has_a_panel_a_quantity_from_least_to_most(make_space: MakeSpace) -> None:
    figure = envelope_figure(with_envelope(make_space()), ["bending moment y"])
    (ax,) = figure.axes
    assert ax.get_title(loc="left") == "Bending moment y in kN m"
    (band,) = ax.collections
    heights = band.get_paths()[0].vertices[:, 1]
    assert heights.min() == -2.0 and heights.max() == 158.0


def test_a_section_has_the_colour_of_its_place_in_the_boom(make_space: MakeSpace) -> None:
    """Blue, the second from the base, as where the boom is drawn as a whole; not the first of those in the figure."""
    beam = with_envelope(make_space())
    boom = replace(beam, bodies={"base": BodyResult(), "fly": beam.body})
    (band,) = envelope_figure(boom, ["bending moment y"]).axes[0].collections
    assert same_color(band.get_facecolor()[0][:3], section_colours(["base", "fly"])["fly"])
