import re
from dataclasses import replace
from operator import attrgetter

import numpy as np
import pytest

from pmr import RunResult
from pmr.report import errors, sections, trust
from pmr.report.document import render_runs as render
from pmr.report.document import write_report
from pmr.report.figures import histories, style
from pmr.report.figures.histories import stress_figure, stress_histories
from pmr.report.sections import chapter as case
from pmr.report.sentences import peak_clause

BOX = {"length": 6.0, "width": 0.3, "height": 0.4, "wall": 0.008}


@pytest.fixture(scope="module")
def page(boom: RunResult) -> str:
    return render([case(boom, "case-1")])


def figures(page: str) -> list[str]:
    return re.findall(r'<figure id="case-1-([^"]+)"', page)


def text(page: str) -> str:
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", page.replace("\u00a0", " ")))


def test_every_figure_is_there_once(page: str) -> None:
    assert figures(page) == [
        *("tip-y", "tip-z", "position", "loads-0", "stress", "forces-1", "forces-2"),
        *("energy", "energy-parts", "frequencies"),
    ]


@pytest.mark.slow
def test_motion_that_may_be_round_off_alone_is_said_and_not_drawn(boom: RunResult) -> None:
    def page(round_off: float) -> str:
        responses = {name: replace(one, round_off=round_off) for name, one in boom.responses.items()}
        return render([case(replace(boom, responses=responses), "case-1")])

    largest = max(float(np.abs(one.displacement[:, -2]).max()) for one in boom.responses.values())
    drawn, left_out = page(0.999 * largest), page(largest)
    assert {"tip-y", "tip-z"} <= set(figures(drawn)) and "does not move" not in text(drawn)
    assert "tip-y" not in figures(left_out) and "tip-z" in figures(left_out)
    assert "The tip does not move sideways." in text(left_out)


def test_a_difference_is_drawn_and_its_largest_share_is_said(boom: RunResult) -> None:
    """Of histories, stresses and energies, of which the full model has a tenth more."""
    total, own = attrgetter("energy.total"), boom.responses["reduced"]
    more = replace(own.energy, kinetic=1.1 * own.energy.kinetic, strain=1.1 * own.energy.strain)
    boom = replace(boom, responses={"full": replace(own, energy=more), "reduced": own})
    peak = boom.body.peak_stress["reduced"]
    body = replace(boom.body, peak_stress={"full": 1.1 * peak, "reduced": peak})
    with style():
        labels = [ax.get_ylabel() for ax in stress_figure(boom, body).axes]
    energy = histories.drawn_history("a", boom, total, "Total energy", "Total energy", "J")
    assert labels[1].startswith("Difference") and "Difference in " in energy.svg
    assert ". Below: the difference to the full model, at most " in energy.caption
    stressed = histories.Timeline(boom).difference_clause(stress_histories(boom, body))
    assert stressed == ". Below: the difference to the full model, at most 9.1\u00a0% of the largest value"


def test_models_that_do_not_differ_have_no_panel_of_a_difference(boom: RunResult) -> None:
    own = boom.responses["reduced"]
    result = replace(boom, responses={"full": own, "reduced": own})
    for drawn in histories.tip_drawings(result, "run"):
        assert "Difference in " not in drawn.svg and "difference" not in drawn.caption


def test_a_figure_has_a_name_without_spaces_whatever_a_section_is_called(make_space) -> None:
    """In the page it begins identifiers, which a reference in an SVG can't quote: curves ran out of their axes."""
    planar = make_space(body={"model": "beam2d", "box": BOX})
    names = ("base", "fly jib (2)")
    block = sections.basis_block(replace(planar, bodies=dict.fromkeys(names, planar.body)), "case-1")
    drawn = [drawing.name for drawing in block.drawings if "basis" in drawing.name]
    assert len(set(drawn)) == 2 and all(re.fullmatch(r"[\w-]+", name) for name in drawn)


def test_page_says_figures_and_inputs(page: str) -> None:
    for said in (
        "length beyond the mouth 2 to 4.5 m",
        "modelled as a shell",
        "17 766 → 3 coordinates 99.98 % fewer",
        "reduced against full, pad forces 0.300 %",
        "The dot marks the largest value, at 0.50 s and (1.50, 0.10, −0.20) m, outer face of bottom.",
        "Nothing was compared with a limit: the scene states none. Without a limit: ",
        "pad mouth faces bottom (−100, 100) mm, top 0 m, right 0 m, length 300 mm",
        "load gust on tip, direction y, signal constant, amount 500 N",
        "The weight acts, too. It grows from zero and has its full value from 1 s on.",
        "pads and supports that no shape of the reduced model moves cylinder",
    ):
        assert said in text(page)


def test_the_error_table_has_pad_forces_in_newtons(boom: RunResult) -> None:
    table = {(row.comparison, row.place): (row.value, row.difference) for row in errors.rows(boom)}
    assert table["reduced against full", "pad forces"] == ("0.300\u00a0%", "450\u00a0N")


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_what_a_run_lacks_is_left_out(make_space) -> None:
    alone = make_space(responses=("reduced",), summary={}, stress=())
    page = render([case(alone, "case-1")])
    assert "stress" not in figures(page) and "von Mises" not in page and "Errors" not in page


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_without_a_reference_the_largest_values_stand_alone(make_space) -> None:
    alone = make_space(responses=("reduced",), summary={"errors": {}, "max_displacement": 0.008}, stress=())
    first = case(alone, "case-1").blocks[0]
    assert (first.heading, first.errors.caption) == ("Largest values", "Over all times and places.")
    kept = make_space(summary={"errors": {}, "no_reference": {"full": "it grew"}, "max_displacement": 0.008})
    assert case(kept, "case-1").blocks[0].heading == "Errors"


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_planar_model_moves_up_and_down_only(boom: RunResult, make_space) -> None:
    planar = make_space(body={"model": "beam2d", "box": boom.scene.body.box})
    assert "tip-y" not in figures(render([case(planar, "case-1")]))


@pytest.mark.usefixtures("undrawn")
def test_kinds_of_cases_mix_in_one_report(boom: RunResult, whole: RunResult, tmp_path) -> None:
    boom.save(tmp_path / "saved")
    files = write_report([whole, RunResult.load(tmp_path / "saved")], tmp_path)
    html = files.html.read_text()
    assert 'id="case-1-position"' in html and 'id="case-2-forces-1"' in html and files.pdf.is_file()


def test_places_that_share_the_peak_are_named_too() -> None:
    peak = {"t": 0.5, "position": [1.0, 0.1, 0.2], "face": "outer", "region": ""}
    for shared, said in (
        ([[1.0, -0.1, 0.2]], "; the stress is the same at (1.00, \u22120.10, 0.20)\u00a0m"),
        ([[1.0, -0.1, 0.2], [1.0, 0.1, -0.2], [1.0, -0.1, -0.2]], "; 3 other places have the same stress"),
    ):
        text = peak_clause(peak | {"shared": shared})
        assert text == "at 0.50\u00a0s and (1.00, 0.10, 0.20)\u00a0m, outer face" + said


def test_an_error_of_round_off_is_called_so_and_is_in_no_sentence(boom: RunResult) -> None:
    """A cylinder that bears what it is told to: no reduction changes its force."""
    found = {"tip": 0.01, "beam": 0.02, "cylinder_force": 1e-12}
    result = replace(boom, summary=boom.summary | {"errors": {"reduced_vs_full": found}, "estimate": found})
    of_cylinders = [row.value for row in errors.rows(result) if "cylinder" in row.place]
    assert of_cylinders == ["round-off", "round-off"]
    reduction = dict(trust.trust_table(result).rows)["reduction"]
    assert "cylinder" not in reduction and "displacements along the beam 2.00\u00a0%" in reduction
