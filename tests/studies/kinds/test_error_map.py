"""The error map against an independent recomputation, and the whole of the paper's."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from finished import WORKFLOWS, compute, finished, short_scene
from oracle import CASES, full_body, generalized_alpha, nrms_error, paper_basis, project

from pmr.errors import InputError
from pmr.scene import load
from pmr.simulate import InitialState, TimeStepping
from pmr.studies import files
from pmr.studies.results import StudyResults
from pmr.studies.task import number

SMALL = """
kind = "error_map"
title = "Small map"
scene = "short.toml"
most_snapshots = 4
most_modes = 4
budget = 8
averaged = 2
marked = 3
"""


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> StudyResults:
    folder = tmp_path_factory.mktemp("small")
    short_scene(folder)
    return finished(folder, SMALL)


def test_tiles_are_those_with_pools_that_are_asked_for(small: StudyResults) -> None:
    tiles = [(run.parameters["snapshots"], run.parameters["modes"]) for run in small.runs]
    assert tiles == [(n, m) for n in range(1, 5) for m in range(1, 5) if n * m >= 3]


@pytest.mark.parametrize(("snapshots", "modes"), [(2, 4), (4, 3), (3, 2)])
def test_a_tile_is_the_mean_of_simulations_made_elsewhere(
    small: StudyResults, tmp_path: Path, snapshots: int, modes: int
) -> None:
    """Textbook matrices, NumPy's basis and an integrator of its own; held coordinates are those left out."""
    full, stepping = full_body(20), TimeStepping(0.5, 1e-3, 0.9)
    path, t = load(short_scene(tmp_path)).slider.path, stepping.times
    s, f = path.value(t), CASES["evolved"].load.value(t)[:, None]

    def motion(body: object) -> np.ndarray:
        q, _, _ = generalized_alpha(body, s, f, stepping, InitialState.at_rest(body.size))
        return np.asarray(
            q @ np.asarray(body.outputs.T.toarray() if hasattr(body.outputs, "toarray") else body.outputs.T)
        )

    reference = motion(full)
    top = min(8, snapshots * modes)
    run = next(run for run in small.runs if run.key == f"{snapshots}x{modes}")
    for treatment, held in (("drop", 0), ("hold", 2)):
        errors = [
            nrms_error(motion(project(full, paper_basis(full, snapshots, modes, r - held))), reference)
            for r in (top - 1, top)
        ]
        assert run.figures[f"{treatment}.error"] == pytest.approx(np.mean(errors), rel=1e-5)


def test_kept_rows_hold_two_coordinates_too(small: StudyResults) -> None:
    """Which combination is a matter of round-off, but never fewer coordinates are left than with the last two held."""
    for run in small.runs:
        kept, hold, drop = (run.figures[f"{name}.error"] for name in ("kept", "hold", "drop"))
        if kept is not None and drop is not None and number(kept) < 0.9:
            assert number(drop) < number(kept)
            assert number(kept) > 0.5 * number(hold)


def test_the_lowest_errors_are_named(small: StudyResults) -> None:
    figures = json.loads((small.folder / "summary.json").read_text())["figures"]
    errors = {run.key: run.figures["drop.error"] for run in small.runs if run.figures["drop.error"] is not None}
    lowest = sorted(errors, key=errors.__getitem__)[:3]
    assert figures["drop.marked"].split() == lowest and figures["drop.best"] == lowest[0]
    assert figures["drop.error"] == errors[lowest[0]]
    sizes = [int(n) * int(m) for n, m in (key.split("x") for key in lowest)]
    assert figures["drop.pool"] == np.median(sizes)


def test_a_single_position_vanishes_where_the_slider_passes_it(tmp_path: Path) -> None:
    """At s = 1.25 m, where it rests; the tile says so and the study goes on."""
    scene = short_scene(tmp_path)
    scene.write_text(scene.read_text() + 'reduction.positions = "path"\n')
    scene.write_text(scene.read_text().replace("values = [1.25, 1.6]", "values = [1.25, 1.25]"))
    found = finished(tmp_path, SMALL.replace("most_snapshots = 4", "most_snapshots = 1"))
    assert all(run.figures["drop.error"] is None for run in found.runs)
    assert json.loads((tmp_path / "summary.json").read_text())["figures"]["drop.singular"] == len(found.runs)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("most_snapshots = 21", "most_snapshots = 21"),
        ("most_modes = 99", "99"),
        ("largest_pool = 2", "largest_pool"),
        ("budget = 0", "budget"),
    ],
)
def test_what_cannot_be_had_is_refused_before_anything_runs(tmp_path: Path, line: str, message: str) -> None:
    short_scene(tmp_path)
    name = line.split(" = ")[0]
    kept = [row for row in SMALL.splitlines() if not row.startswith(f"{name} ")]
    (tmp_path / "study.toml").write_text("\n".join([*kept, line]))
    with pytest.raises(InputError, match=message):
        files.load(tmp_path / "study.toml")


@pytest.mark.slow
def test_the_map_of_the_paper(tmp_path: Path) -> None:
    """With its rows kept the best pools hold some 26 snapshots, as published; without them that valley is gone."""
    found = compute(tmp_path, files.load(WORKFLOWS / "studies" / "error_map.toml"))
    figures = json.loads((tmp_path / "summary.json").read_text())["figures"]
    assert figures["combinations"] == 270 == len(found.runs)
    kept, drop = figures["kept.marked"].split(), figures["drop.marked"].split()
    assert len(kept) == len(drop) == 15 and "5x6" not in drop  # which pools are kept's best, LAPACK's round-off decides
    assert 20 <= figures["kept.pool"] <= 32
    assert figures["drop.best"] == "25x2" and figures["drop.error"] == pytest.approx(0.0097, abs=1e-4)
    assert figures["hold.best"] == "29x2" and figures["hold.error"] == pytest.approx(0.0134, abs=1e-4)
    errors = {run.key: run.figures for run in found.runs}
    assert errors["5x6"]["drop.error"] == pytest.approx(0.02018, abs=1e-5)
    assert errors["5x6"]["hold.error"] == pytest.approx(0.02830, abs=1e-5)
    assert errors["10x10"]["kept.error"] > 0.99 and errors["10x10"]["drop.error"] == pytest.approx(0.80, abs=0.03)
    # A budget of five positions says what more modes cost: 5 x 16 is lost, 5 x 7 is not.
    assert errors["5x16"]["drop.error"] > 0.99 and errors["5x7"]["drop.error"] < 0.02
