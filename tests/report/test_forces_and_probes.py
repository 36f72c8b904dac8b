"""Tables of what a body bears, from histories whose extremes and cycles are known.
Forces and moments along beams in a report: a figure, and their extremes.
"""

from dataclasses import replace

import numpy as np
import pytest
from boom_results import MakeSpace
from matplotlib.colors import same_color

from pmr import RunResult
from pmr.report import forces as drawn
from pmr.report import sections
from pmr.report.errors import error_table, slight_outputs
from pmr.report.errors import rows as error_rows
from pmr.report.figures import section_colours
from pmr.report.figures.shapes import envelope_figure
from pmr.report.forces import contact_block
from pmr.report.sections import section_force_block
from pmr.results import BodyResult
from pmr.results.field_stress import Envelope
from pmr.results.response import Output
from pmr.results.tables import load_cycle_table

SPACE = "\u00a0"
NAMES = ("weld stress along", "weld stress shear", "weld strain along", "weld displacement z")


@pytest.fixture
def probed(make_result) -> RunResult:
    """A triangle between -20 and 60 MPa, six times up and down in three seconds; the shear is round-off."""
    at = [{"name": name, "unit": unit, "at": [1.5, 1e-17, -0.2], "face": "outer"}
          for name, unit in zip(NAMES, ("Pa", "Pa", "1", "mm"), strict=True)]  # fmt: skip
    errors = {"reduced_vs_full": {"tip": 0.01, "beam": 0.01, "weld stress along": 0.002, "weld strain along": 0.003}}
    largest = {"reduced_vs_full": {"tip": 0.01, "beam": 0.01, "weld stress along": 2e3, "weld strain along": 1e-6}}
    summary = {"probes": at, "errors": errors, "largest_differences": largest}
    result = make_result(summary=summary, responses=("full", "reduced"))
    found = {}
    for name, response in result.responses.items():
        wave = 20e6 - 40e6 * (2.0 * np.abs(2.0 * ((2.0 * response.t) % 1.0) - 1.0) - 1.0)
        others = np.stack([wave, 1e-9 * wave / 60e6, wave / 210e9, 1e-6 * wave], axis=1)
        outputs = [Output(of, "probe", "", unit=unit) for of, unit in zip(NAMES, ("Pa", "Pa", "1", "mm"), strict=True)]
        found[name] = response.with_others(others, outputs)
    return replace(result, responses=found)


@pytest.mark.slow
def test_probes_have_extremes_and_load_cycles(probed: RunResult) -> None:
    block = sections.probe_block(probed, "case-1")
    assert block is not None
    (extremes,) = block.grids
    assert [row[0] for row in extremes.rows] == [
        "weld stress along", "weld strain along", "weld displacement z",
    ]  # fmt: skip
    first = dict(zip(extremes.head, extremes.rows[0], strict=False))
    assert (first["least"], first["largest"]) == (
        f"\u221220.0{SPACE}MPa at 0{SPACE}s, 1.25{SPACE}m",
        f"60.0{SPACE}MPa at 0.25{SPACE}s, 1.25{SPACE}m",
    )
    assert "weld stress at (1.50, 0, \u22120.200)\u00a0m, outer" in extremes.caption
    assert len(block.drawings) == 3  # of each measure the component that is largest


def test_cycles_below_one_per_cent_are_not_listed(probed: RunResult) -> None:
    of = probed.responses["reduced"]
    number = np.arange(len(of.t))
    history = np.where(number == 3, 60e6, 0.3e6 * (number % 2))  # one large cycle among ripples
    rippled = replace(of, others=np.repeat(history[:, None], len(NAMES), axis=1))
    listed = load_cycle_table(replace(probed, responses={"reduced": rippled})).rows
    assert {row[3] for row in listed if row[1] == NAMES[0]} == {60e6}


def test_axes_of_a_probe_name_the_measure_without_its_component(probed: RunResult) -> None:
    """With the component, which the caption names, the label would touch the label of the panel below."""
    block = sections.probe_block(probed, "case-1")
    assert block is not None
    for drawing, measure in zip(block.drawings, ("stress along", "strain along", "displacement z"), strict=True):
        label = f"{measure.split(' ')[0].capitalize()} "
        assert f"weld {measure}" in drawing.caption.lower()
        assert label in drawing.svg and f"{measure.capitalize()} in" not in drawing.svg


def test_forces_have_extremes_with_time_and_place(probed: RunResult) -> None:
    (grid,) = contact_block(probed, "case-1").grids
    assert grid.head == ("", "least", "largest") and grid.caption.endswith("of the slider along the body then.")
    ((name, least, largest),) = grid.rows
    t = probed.responses["reduced"].t[probed.responses["reduced"].slider_force[:, 0].argmin()]
    assert (name, largest) == ("slider", f"99.0{SPACE}N at 0{SPACE}s, 1.25{SPACE}m")
    assert least == f"\u221298.0{SPACE}N at {t:g}{SPACE}s, 3.75{SPACE}m"


def idle(result: RunResult, **forces: float) -> RunResult:
    """With pads by these names, each with this share of one force of 100 N that varies, and none in the full model."""
    found, t = {}, result.responses["reduced"].t
    for name, one in result.responses.items():
        size = 100.0 if name == "reduced" else 0.0
        force = size * np.outer(np.cos(t) ** 2, list(forces.values()))
        names = tuple(f"force of {called}" for called in forces)
        kinds = (*one.kinds[:11], *("pad",) * len(names))
        found[name] = replace(
            one, slider_force=force, force_names=names, force_peaks=None, kinds=kinds, bodies=("",) * len(kinds),
            others=None, other_names=(), other_units=(),
        )  # fmt: skip
    return replace(result, responses=found)


def test_a_body_without_pads_has_no_table_of_their_forces(make_result) -> None:
    assert contact_block(idle(make_result(responses=("full", "reduced"))), "case-1") is None


def test_a_pad_that_never_touches_has_no_panel_and_no_row(probed: RunResult, monkeypatch) -> None:
    """Neither one without any force, nor one that round-off alone presses on; one of little force has a row."""
    result, panels = idle(probed, lower=1.0, upper=0.0, aside=1e-14, other=2e-2, slight=5e-3), []
    monkeypatch.setattr(drawn, "drawing", lambda *given: panels.extend(given[-3]))
    block = contact_block(result, "case-1")
    assert block is not None and panels == ["lower", "other"]
    assert [row[0] for row in block.grids[0].rows] == ["lower", "other", "slight"]
    assert block.text == (
        f"There is no force at any time on upper, aside. "
        f"Forces below 1{SPACE}% of the largest one are not drawn: slight."
    )
    panels.clear()
    block = contact_block(idle(probed, lower=0.0), "case-1")
    assert block is not None and (list(block.drawings), block.grids, panels) == ([], (), [])


@pytest.mark.usefixtures("undrawn")
def test_what_is_nothing_beside_the_largest_of_its_kind_is_zero(probed: RunResult) -> None:
    (grid,) = contact_block(idle(probed, lower=1.0, other=0.9e-4, aside=1.1e-4), "case-1").grids
    largest = {name: cell.partition(f"{SPACE}N at")[0] for name, _, cell in grid.rows}
    assert largest == {"lower": "100", "other": "0", "aside": "0.0110"}
    assert f" A value is 0 here if it is below 0.01{SPACE}% of the largest one with its unit, in this" in grid.caption


def test_what_is_nothing_beside_the_largest_force_of_the_run_is_zero_in_all_tables(probed: RunResult) -> None:
    """A force was 0 in the table of supports and -3.27 N in that of the machine, whose other forces are smaller."""
    small, pushed = idle(probed, lower=1.0), Output("reaction of base: pin x", "reaction", "", unit="N")
    for size, cell in ((0.9e-2, "0"), (1.1e-2, f"11.0{SPACE}mN at 0{SPACE}s, 1.25{SPACE}m")):
        reaction = np.full((len(small.responses["reduced"].t), 1), size)
        with_pin = small.responses["reduced"].with_others(reaction, [pushed])
        result = replace(small, responses=small.responses | {"reduced": with_pin})
        (grid,) = drawn.support_block(result, "case-1").grids
        assert grid.rows == (("pin of base, along x", cell, cell),)


def test_reactions_without_a_row_among_the_errors_are_named_with_the_reason(make_space) -> None:
    """The full model has none where a support holds a coordinate of its mesh, and small ones are far off in percent."""
    supports = [{"name": "pin", "on": "tail", "directions": ["x", "z", "rx"]}]
    names = [f"reaction of pin {axis}" for axis in ("x", "z", "rx")]
    errors = {"reduced_vs_full": {"tip": 0.01, names[1]: 0.02, names[2]: 0.5}}
    result, sizes = make_space(supports=supports, summary={"errors": errors}), {"x": 2e6, "z": 1e6, "rx": 1.0}
    result = replace(result, responses={
        model: response.with_others(
            np.ones((len(response.t), 1)) * [sizes[axis] for axis in axes],
            [Output(f"reaction of pin {axis}", "reaction", "", unit="N m" if axis == "rx" else "N") for axis in axes],
        )
        for (model, response), axes in zip(
            ((name, result.responses["reduced"]) for name in ("full", "reduced")), (("z", "rx"), ("x", "z", "rx")),
            strict=True,
        )
    })  # fmt: skip
    listed = error_table(result)
    assert [row.place for row in listed.rows if "reaction" in row.place] == [
        "reaction of pin, along z", "reaction of pin, about x",
    ]  # fmt: skip
    missing, without = listed.reasons
    assert missing.startswith("Not compared: the reaction of pin, along x. ") and without.startswith("So the sums ")
    moment = Output("reaction of pivot ry", "reaction", "", unit="N m")
    large = result.responses["reduced"].with_others(np.full((len(result.responses["reduced"].t), 1), 2e4), [moment])
    listed = error_table(replace(result, responses=result.responses | {"reduced": large}))
    assert [row.place for row in listed.rows if "reaction" in row.place] == ["reaction of pin, along z"]
    assert listed.reasons[-1].endswith("% of the largest force, moment or stress: the reaction of pin, about x.")
    lug = Output("lug stress", "probe", "", unit="Pa")
    probed = result.responses["reduced"].with_others(np.full((len(large.t), 1), 1e4), [lug])
    for stress, slight in ((9e7, False), (2e8, True)):  # beside the largest stress in walls
        budget = {"model": {"wall_stress": {"value": stress}}}
        of = replace(result, summary=result.summary | {"budget": budget}, responses={"reduced": probed})
        assert slight_outputs(of) == ({"lug stress": "lug stress"} if slight else {})


def test_moments_of_supports_that_give_way_are_no_forces(make_space, monkeypatch) -> None:
    """A support of 1e8 N/m along z and one of 1e6 N m/rad about y: each with its unit, in a figure and a table."""
    supports = [
        {"name": "leg", "on": "tail", "directions": ["z"], "stiffness": 1e8},
        {"name": "hinge", "on": "tail", "directions": ["ry"], "stiffness": 1e6},
    ]
    result, figures = make_space(supports=supports, responses=("reduced",)), []
    names, reduced = ("force of leg", "force of hinge"), result.responses["reduced"]
    kinds = (*reduced.kinds[:12], "support", "support")
    forces = np.array([2e3, 5e4]) * np.ones((len(reduced.t), 2))
    bearing = replace(reduced, slider_force=forces, force_names=names, kinds=kinds, bodies=("",) * len(kinds))
    monkeypatch.setattr(drawn, "drawing", lambda *given: figures.append(given[-2]))
    block = drawn.support_block(replace(result, responses={"reduced": bearing}), "case-1")
    assert block is not None and figures == ["N", "N m"]
    (grid,) = block.grids
    assert [(row[0], row[1].partition(" at")[0]) for row in grid.rows] == [
        ("leg", f"2.00{SPACE}kN"), ("hinge", f"50.0{SPACE}kN m"),
    ]  # fmt: skip


def test_the_error_table_has_probes_in_their_units(probed: RunResult) -> None:
    found = {row.place: (row.value, row.difference) for row in error_rows(probed)}
    assert found["weld stress along"] == ("0.200\u00a0%", "2.00\u00a0kPa")
    assert found["weld strain along"] == ("0.300\u00a0%", "1.00\u00a0·\u00a010⁻⁶")


def test_regions_stand_beside_the_full_model(make_result) -> None:
    peak = {"value": 50e6, "t": 0.5, "position": [1.0, 0.1, 0.2], "face": "outer"}
    both = {"top": peak, "bottom": peak | {"value": 40e6}}
    found = {"stress_by_region": {"reduced": both, "full": {name: one | {"value": 51e6} for name, one in both.items()}},
             "stress_peak": {"reduced": peak, "full": peak}}  # fmt: skip
    (grid,) = sections.stress_block(make_result(summary=found), "case-1").grids
    assert grid.head[:3] == ("", "reduced model, MPa", "full model, MPa")
    assert grid.rows[1] == ("bottom", "40.00", "51.00", f"0.5{SPACE}s", "(1.00, 0.100, 0.200)", "outer")
    assert (
        sections.stress_block(
            make_result(summary={"stress_by_region": {"reduced": {"body": peak}}, "stress_peak": {"reduced": peak}}),
            "case-1",
        )
        is None
    )


def test_without_probes_nothing_is_said(make_result) -> None:
    assert sections.probe_block(make_result(), "case-1") is None


def with_envelope(result: RunResult, back: float = -2e3, pull: float = 2.0) -> RunResult:
    """Of a beam of 6 m that is bent, and pulled by a 1e-4 of the force that bends it so, or by `pull` in N."""
    x, t = np.array([0.0, 3.0, 6.0]), np.full((2, 3), 0.5)
    least = np.array([[-pull, 0.0, 0.0], [back, 0.5 * back, 0.0]])
    most = np.array([[pull, 0.0, 0.0], [158e3, 80e3, 0.0]])
    along = Envelope(("normal force", "bending moment y"), ("N", "N m"), x, least, t, most, t)
    summary = result.summary | {"section_forces": {"reduced": along.extremes()}}
    return replace(result, bodies={"": BodyResult(envelopes={"reduced": along})}, summary=summary)


def test_extremes_are_in_a_table_and_round_off_is_not(make_space: MakeSpace) -> None:
    plain = make_space()
    assert section_force_block(plain, "run") is None
    block = section_force_block(with_envelope(plain), "run")
    assert block is not None and len(block.drawings) == 1
    (row,) = block.grids[0].rows
    assert row[0] == "bending moment y"
    assert row[1:] == (f"−2.00{SPACE}kN m at 0.5{SPACE}s, 0{SPACE}m", f"158{SPACE}kN m at 0.5{SPACE}s, 0{SPACE}m")


@pytest.mark.parametrize("pull", [2.6, 2.7, 2e9])
def test_forces_are_compared_with_moments_over_the_length_of_the_boom(make_space: MakeSpace, pull: float) -> None:
    """158 kN m on 6 m are 26.3 kN: 2.7 N are more than a 1e-4 of them, and were less than a 1e-4 of 158 kN m."""
    block = section_force_block(with_envelope(make_space(), pull=pull), "run")
    assert block is not None
    shown = {2.6: ["bending moment y"], 2.7: ["normal force", "bending moment y"], 2e9: ["normal force"]}
    assert [row[0] for row in block.grids[0].rows] == shown[pull]


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


def test_panels_of_one_unit_have_one_prefix(make_space: MakeSpace) -> None:
    beam = with_envelope(make_space())
    envelope = beam.body.envelopes["reduced"]
    torque = replace(envelope, names=("torque", "bending moment y"), units=("N m", "N m"))
    twisted = replace(beam, bodies={"": BodyResult(envelopes={"reduced": torque})})
    titles = [ax.get_title(loc="left") for ax in envelope_figure(twisted, torque.names).axes]
    assert titles == ["Torque in kN m", "Bending moment y in kN m"]


def test_a_section_has_the_colour_of_its_place_in_the_boom(make_space: MakeSpace) -> None:
    """Blue, the second from the base, as where the boom is drawn as a whole; not the first of those in the figure."""
    beam = with_envelope(make_space())
    boom = replace(beam, bodies={"base": BodyResult(), "fly": beam.body})
    (band,) = envelope_figure(boom, ["bending moment y"]).axes[0].collections
    assert same_color(band.get_facecolor()[0][:3], section_colours(["base", "fly"])["fly"])
