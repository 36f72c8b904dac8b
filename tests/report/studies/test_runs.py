"""What any study says of its runs: in words and units, over what was varied."""

import re
from pathlib import Path

import pytest

from pmr.report.blocks import Chapter
from pmr.report.studies.runs import MOST_COLUMNS, build_chapter, terminal_grid, value_figure, varied_parameter
from pmr.report.studies.tables import FinishedStudy, heading, key_words, quantity_of, run_name, value_blocks
from pmr.studies.study import RunRecord, StudyResults

BEAM, TIP = "errors.reduced_vs_full.beam", "errors.reduced_vs_full.tip"


def run(key: str, parameters: dict, figures: dict | None = None, seconds: float | None = None) -> RunRecord:
    measured = {} if seconds is None else {"simulate.reduced": seconds, "task": 1.0}
    status = "failed" if figures is None else "done"
    return RunRecord(key, status, parameters, figures or {}, measured)


def said(*runs: RunRecord) -> Chapter:
    return build_chapter(
        FinishedStudy("study", {"kind": "scenes", "title": "A study"}, StudyResults(Path(), runs)), "study-1"
    )


def sweep() -> list[RunRecord]:
    """Two treatments, three sizes; the last run failed."""
    found = []
    for way in ("eigenmodes", "paper"):
        for r in (10, 12, 20):
            error = (0.1 if way == "eigenmodes" else 0.2) / r
            parameters = {"reduction.basis": way, "reduction.coordinates": r}
            figures = {TIP: error / 2.0, BEAM: error, "max_displacement": 0.0479, "max_error": error / 100.0}
            figures |= {"coordinates.full": 153, "coordinates.reduced": r, "basis.kappa": 0.9995}
            found.append(run(f"{way}-{r}", parameters, figures, 1e-4 * r))
    return [*found[:-1], run("paper-20", found[-1].parameters)]


def test_a_terminal_has_a_row_for_each_of_many_runs_and_a_column_for_each_of_a_few() -> None:
    runs = sweep()
    many = terminal_grid(runs, columns=4, rows=5)
    assert many.head == ("basis", "coordinates", "error along the beam", "largest displacement")
    assert many.rows[0] == ("eigenmodes", "10", "1.00\u00a0%", "47.9\u00a0mm") and len(many.rows) == 5
    assert many.caption.startswith("1 more runs and all figures")
    narrow = terminal_grid(runs, columns=3, rows=6)
    assert narrow.head == many.head[:3]  # in which runs differ
    assert narrow.rows[5][2] == "–"  # of the run that failed
    few = terminal_grid(runs[:2], columns=4, rows=5)
    assert few.head == ("", "basis eigenmodes, 10 coordinates", "basis eigenmodes, 12 coordinates")
    assert ("error along the beam", "1.00\u00a0%", "0.833\u00a0%") in few.rows


@pytest.mark.parametrize(
    ("name", "value", "label", "text"),
    [
        (BEAM, 0.0149, "error along the beam", "1.49\u00a0%"),
        ("errors.reduced_vs_ancf.tip", 0.02, "error at the tip against ANCF", "2.00\u00a0%"),
        ("errors.full_vs_ancf.tip", 0.02, "error at the tip, full against ANCF", "2.00\u00a0%"),
        ("frequency_error.2", 0.001, "error of frequency 2", "0.100\u00a0%"),
        ("max_error", 0.000321, "largest difference", "0.321\u00a0mm"),
        ("basis.kappa", 0.99955, "share of the snapshots that the basis leaves out, 1 − κ", "0.00045"),
        ("simulate.reduced", 4.5e-4, "time, reduced", "450\u00a0µs"),
        ("some_thing.of.6", 3.14159, "some thing, of, 6", "3.142"),
        ("coordinates.full", 17766, "coordinates, full", "17\u202f766"),
        ("probes.weld stress along.range", 2e6, "range of weld stress along", "2.00\u00a0MPa"),
        ("probes.high stress spot displacement z.range", 3.0, "range of high stress spot displacement z", "3.000"),
        (BEAM, None, "error along the beam", "–"),
    ],
)
def test_figures_have_a_name_and_a_unit(name: str, value: float | None, label: str, text: str) -> None:
    assert (quantity_of(name).label, quantity_of(name).cell(value)) == (label, text)


def test_runs_are_called_by_what_was_varied() -> None:
    one = run(
        "key", {"case": "fine-inertia", "reduction.coordinates": 10, "time.step": 0.001, "reduction.flexibility": True}
    )
    assert run_name(one) == "fine-inertia, 10 coordinates, time step 0.001\u00a0s, flexibility yes"
    assert run_name(one, "reduction.coordinates") == "fine-inertia, time step 0.001\u00a0s, flexibility yes"
    assert run_name(run("alone", {})) == "alone"
    assert run_name(run("key", {"body.model": "beam3d"})) == "model beam in space"
    assert (key_words("mesh.boundary_size"), heading("time.step")) == ("boundary size", "time step in s")


def test_the_headline_has_the_least_and_the_largest_error() -> None:
    chapter = said(*sweep())
    assert chapter.headline == (
        "The error along the beam is 0.500\u00a0% at least (basis eigenmodes, 20 coordinates) and 2.00\u00a0% at most "
        "(basis paper, 10 coordinates). 5 of 6 runs are done."
    )
    numbers = {number.label: (number.value, number.note) for number in chapter.key_numbers}
    assert numbers["largest difference, at most"] == (
        "0.200\u00a0mm", "smallest 0.0500\u00a0mm, basis eigenmodes, 20 coordinates",
    )  # fmt: skip
    assert chapter.opening == "6 runs over basis (eigenmodes, paper) and coordinates (10, 12, 20)."
    assert numbers["largest displacement"] == ("47.9\u00a0mm", "in all runs")
    assert numbers["fastest simulation"] == ("1.00\u00a0ms", "basis eigenmodes, 10 coordinates")


def test_figures_are_drawn_over_the_coordinates_and_over_seconds() -> None:
    chapter = said(*sweep())
    over, runs = chapter.blocks
    assert over.heading == "Results over the coordinates" and runs.heading == "Runs"
    first, second = over.drawings
    texts = re.findall(r"<text[^>]*>([^<]+)</text>", first.svg)
    assert {"Error along the beam in %", "Error at the tip in %", "Largest difference in µm"} <= set(texts)
    assert {"basis eigenmodes", "basis paper", "Coordinates (–)"} <= set(texts)
    assert not any("displacement" in text for text in texts)  # the same in all runs
    assert "Time of one simulation in ms" in second.svg


def test_an_axis_of_a_plain_number_has_a_dash_in_place_of_a_unit() -> None:
    figure = value_figure(sweep()[:-1], "reduction.coordinates", ["coordinates.reduced"])
    assert figure.axes[0].get_ylabel() == "Coordinates, reduced (–)"


def test_tables_fit_the_page_and_say_what_is_alike_once() -> None:
    (grid,) = said(*sweep()[:-1]).blocks[-1].grids
    assert grid.head == (
        "basis",
        "coordinates",
        *(quantity_of(n).label for n in (TIP, BEAM, "max_error")),
        "time, reduced",
    )
    assert grid.caption.endswith("In all runs: largest displacement: 47.9\u00a0mm; coordinates, full: 153; "
                                 "share of the snapshots that the basis leaves out, 1 − κ: 0.00050.")  # fmt: skip
    assert grid.rows[0] == ("eigenmodes", "10", "0.500\u00a0%", "1.00\u00a0%", "0.100\u00a0mm", "1.00\u00a0ms")
    many = [run(f"r{k}", {"a": k}, {f"figure.{i}": float(k + i) for i in range(40)}) for k in range(3)]
    grids = said(*many).blocks[-1].grids
    assert {len(grid.head) for grid in grids} == {MOST_COLUMNS} and len(grids) == 3
    assert "runs.csv" in grids[-1].caption and "runs.csv" not in grids[0].caption


def test_a_run_without_a_result_has_an_empty_row() -> None:
    rows = {row[:2]: row[2:] for grid in said(*sweep()).blocks[-1].grids for row in grid.rows}
    assert set(rows["paper", "20"]) == {"–"}


def payloads(*masses: float, **figures: float) -> list[RunRecord]:
    found = {BEAM: 0.01, "max_displacement": 0.1, "largest_force": 5e3, "path.s_min": 1.5, "path.s_max": 4.0}
    found |= {"forces.tail left.min": -5e3, "forces.tail left.max": 0.0, "forces.tail left.t_max": 2.0}
    found |= {"moments.clamp ry.min": 0.0, "moments.clamp ry.max": 2e3, "stress.top.max": 2.5e7, "stress.top.x": 1.5}
    found |= {"frequencies.s_min.1": 10.25, "frequencies.s_max.1": 26.5}
    found |= {"probes.weld stress along.min": -1e6, "probes.weld stress along.max": 25e6}
    found |= {"probes.weld stress along.range": 26e6, "probes.weld stress shear.range": 1e-9}
    found |= {"probes.weld stress shear.min": 0.0, "probes.weld stress shear.max": 1e-9}
    found |= {"probes.weld strain along.min": 0.0, "probes.weld strain along.max": 1.25e-4}
    found |= {"probes.weld strain along.range": 1.25e-4}
    return [run(f"m{mass:g}", {"masses.payload.mass": mass}, found | figures, 1e-3) for mass in masses]


def test_a_few_runs_stand_side_by_side() -> None:
    blocks = {block.heading: block.grids[0] for block in said(*payloads(100.0, 250.0)).blocks if block.grids}
    headings = ["Forces of pads, sliders and supports", "Moments on rigid supports", "Stress by region"]
    headings += ["Frequencies, while pads and sliders rest", "Stresses at probes", "Strains at probes"]
    assert list(blocks) == ["At a glance", "Runs", *headings]
    forces, moments, stress, frequencies, stresses, strains = list(blocks.values())[2:]
    assert moments.rows == (("clamp ry", *["0\u00a0…\u00a02.00"] * 2),) and " in kN m;" in moments.caption
    assert stress.rows == (("top", "25.0", "25.0"),) and " in MPa;" in stress.caption
    assert forces.head == ("", "payload mass 100\u00a0kg", "payload mass 250\u00a0kg")
    assert forces.rows == (("tail left", *["\u22125.00\u00a0…\u00a00"] * 2),)
    assert frequencies.rows == (
        ("frequency 1, least s", "10.2", "10.2"),
        ("frequency 1, largest s", "26.5", "26.5"),
    )
    cycle = "\u00a0\u00a0range of the largest load cycle"
    assert [row[:2] for row in (*stresses.rows, *strains.rows)] == [
        ("weld stress along", "\u22121.00\u00a0…\u00a025.0"), (cycle, "26.0"),
        ("weld strain along", "0\u00a0…\u00a0125"), (cycle, "125"),
    ]  # fmt: skip
    assert " in µm/m;" in strains.caption
    assert not any("forces" in name for name in blocks["Runs"].head)


def test_one_table_has_the_largest_of_all_with_units() -> None:
    """In either direction; the lowest frequency; a dash where a run lacks what another one has."""
    first, second = payloads(100.0, 250.0)
    second.figures.update({"mass": 777.52, "utilisation": 0.0642, "beam_moments.bending moment y.min": -31e3,
                           "beam_moments.torque.max": 90e3, "reactions.clamp x.min": -4.0})  # fmt: skip
    grid = next(block.grids[0] for block in said(first, second).blocks if block.heading == "At a glance")
    assert grid.head == ("", "payload mass 100\u00a0kg", "payload mass 250\u00a0kg")
    assert [(row[0], row[2]) for row in grid.rows] == [
        ("mass", "777.5\u00a0kg"),
        ("largest displacement", "100\u00a0mm"),
        ("lowest frequency", "10.25\u00a0Hz"),
        ("largest force of a pad, slider or support", "5.00\u00a0kN"),
        ("largest force on a rigid support", "4.00\u00a0N"),
        ("largest moment on a rigid support", "2.00\u00a0kN m"),
        ("largest bending moment", "31.0\u00a0kN m"),
        ("largest von Mises stress", "25.0\u00a0MPa"),
        ("largest stress over yield stress", "6.42\u00a0%"),
    ]
    assert [row[1] for row in grid.rows][0] == "–" and grid.rows[1][1] == "100\u00a0mm"


def test_what_bears_nothing_has_no_row() -> None:
    """A torque of 1e-9 N m beside a bending moment of 31 kN m, in both runs."""
    found = {"torque.min": -1e-9, "torque.max": 0.0, "bending moment y.min": 0.0, "bending moment y.max": 31e3}
    blocks = said(*payloads(100.0, 250.0, **{f"beam_moments.{key}": value for key, value in found.items()})).blocks
    (grid,) = next(block.grids for block in blocks if block.heading == "Moments along beams")
    assert [row[0] for row in grid.rows] == ["bending moment y"]


@pytest.mark.parametrize(
    ("values", "over"),
    [
        ([{"reduction.coordinates": 6, "mass": 1.0}, {"reduction.coordinates": 6, "mass": 2.0}], "mass"),
        ([{"reduction.coordinates": 6, "mass": k} for k in (1.0, 2.0)] + [{"reduction.coordinates": 8, "mass": 3.0}],
         "reduction.coordinates"),
        ([{"case": "a"}, {"case": "b"}], None),
        ([{"at": 1.0}, {"at": "tip"}], None),
        ([{}], None),
        ([], None),
    ],
)  # fmt: skip
def test_what_is_drawn_over(values: list[dict], over: str | None) -> None:
    assert varied_parameter([run(str(k), parameters, {}) for k, parameters in enumerate(values)]) == over


def test_without_numbers_there_are_tables_alone() -> None:
    chapter = said(
        run("a", {"case": "a"}, {"max_displacement": 0.1}), run("b", {"case": "b"}, {"max_displacement": 0.2})
    )
    assert [block.heading for block in chapter.blocks] == ["Runs"]
    assert chapter.headline == "2 of 2 runs are done."
    (number,) = chapter.key_numbers
    assert (number.value, number.label, number.note) == ("200\u00a0mm", "largest displacement", "b")
    assert said().headline == "0 of 0 runs are done."


def test_a_probe_is_in_the_table_of_what_it_measures_whatever_its_name_is() -> None:
    """A displacement in mm stood among the stresses in Pa."""
    values = {"probes.high stress spot displacement z": 3.0, "probes.high stress spot stress along": 2e6}
    figures = {f"{name}.{key}": value for name, value in values.items() for key in ("min", "max")}
    run = RunRecord("one", "done", {"modes": 5}, figures, {})
    rows = {block.heading: [row[0] for row in block.grids[0].rows] for block in value_blocks([run])}
    assert rows == {
        "Stresses at probes": ["high stress spot stress along"],
        "Displacements at probes": ["high stress spot displacement z"],
    }
