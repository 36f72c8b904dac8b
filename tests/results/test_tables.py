"""Tables and frames of a small boom: what a reader of CSV or pandas finds, beside the arrays it comes from."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

import pmr.results
from pmr import InputError, RunResult, run
from pmr import scene as scenes
from pmr.report.first_page import largest_value_rows
from pmr.results.tables import write_tables

CHANGES = (
    "time.end=2.0", "time.step=5e-3", "recovery.every=0.1", "mesh.elements=12", "reduction.coordinates=6",
    "supports=[{name='cylinder',directions=['x'],stiffness=1e8}]",
    "probes=[{name='weld',at=[1.5,0.15,0.2],measures=['stress','displacement']}]", "observe.rotation=true",
)  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("boom")
    outcome = run(scenes.load("boom_beam", CHANGES))
    assert outcome is not None
    outcome.result.save(folder)
    write_tables(outcome.result, folder)
    return folder


def rows(folder: Path, name: str) -> list[dict[str, str]]:
    with (folder / "tables" / f"{name}.csv").open(newline="") as stream:
        return list(csv.DictReader(stream))


def test_forces_have_their_extremes_times_and_places(folder: Path) -> None:
    result = RunResult.load(folder)
    found = [row for row in rows(folder, "forces") if row["model"] == "reduced"]
    response = result.responses["reduced"]
    assert [f"force of {row['force of']}" for row in found] == list(response.force_names)
    assert "cylinder" in {row["force of"] for row in found}
    for row in found:
        force = response.force(f"force of {row['force of']}")
        assert (float(row["min [N]"]), float(row["max [N]"])) == (force.min(), force.max())
        at = int(np.flatnonzero(response.t == float(row["t_max [s]"]))[0])
        assert force[at] == force.max() and float(row["s_max [m]"]) == pytest.approx(result.abscissa[at], rel=1e-12)


def test_an_output_that_no_probe_asks_for_has_rows_under_its_own_name(folder: Path) -> None:
    """The tip's rotation: without place, face and load cycles; on the first page in degrees."""
    result = RunResult.load(folder)
    found = [row for row in rows(folder, "probes") if row["probe"] == "tip ry"]
    assert [(row["model"], row["unit"], row["x [m]"], row["face"]) for row in found] == [
        (model, "rad", "", "") for model in ("reduced", "full")
    ]
    turned = result.responses["reduced"].other("tip ry")
    assert (float(found[0]["min"]), float(found[0]["max"])) == (turned.min(), turned.max())
    assert "tip ry" not in {row["probe"] for row in rows(folder, "cycles")}
    (text,) = [text for name, text in largest_value_rows(result) if name == "largest tip ry"]
    size = turned[np.abs(turned).argmax()]
    assert float(text.partition("°")[0].replace("−", "-")) == pytest.approx(np.rad2deg(size), rel=0.05)


def test_frequencies_are_in_hertz_over_the_path(folder: Path) -> None:
    result, found = RunResult.load(folder), rows(folder, "frequencies")
    assert [float(row["s [m]"]) for row in found] == result.frequencies.along.tolist()
    first = [float(row["full 1 [Hz]"]) for row in found]
    assert first == pytest.approx(result.frequencies.models["full"][:, 0].tolist(), rel=1e-14)
    assert [float(row["reduced 1 [Hz]"]) for row in found] == pytest.approx(first, rel=1e-2)


def test_probes_and_their_cycles_fit_each_other(folder: Path) -> None:
    extremes = {(row["model"], row["probe"]): row for row in rows(folder, "probes")}
    assert {probe for _, probe in extremes} == {
        "weld stress axial", "weld stress torsion", "weld displacement x", "weld displacement y", "weld displacement z",
        "tip ry",
    }  # fmt: skip
    for model in ("reduced", "full"):
        row = extremes[model, "weld stress axial"]
        cycles = [c for c in rows(folder, "cycles") if (c["model"], c["probe"]) == (model, "weld stress axial")]
        assert float(cycles[0]["range"]) == pytest.approx(float(row["max"]) - float(row["min"]), rel=1e-12)
        assert {c["unit"] for c in cycles} == {"Pa"} and {c["count"] for c in cycles} <= {"0.5", "1.0"}


def test_arrays_name_their_columns(folder: Path) -> None:
    with np.load(folder / "trajectories.npz") as data:
        columns = json.loads(str(data["columns"]))
        assert {"loads", "reduced.displacement", "reduced.slider_force", "reduced.others"} <= set(columns)
        for name, named in columns.items():
            assert data[name].shape[1] == len(named) and all(one.endswith("]") for one in named), name
    assert columns["loads"] == ["tip force [N]", "gust [N]", "gravity [m/s^2]"]


def test_three_lines_of_python_give_frames(folder: Path) -> None:
    pytest.importorskip("pandas")
    boom = pmr.results.load(folder)
    assert set(boom) == {"forces", "frequencies", "probes", "cycles", "stress", "section_forces", "reduced", "full"}
    stress = boom["reduced"]["weld stress axial [Pa]"]
    found = boom["probes"].set_index(["model", "probe"]).loc[("reduced", "weld stress axial")]
    assert (stress.min(), stress.idxmax()) == (found["min"], found["t_max [s]"])
    assert list(boom["forces"].columns) == list(rows(folder, "forces")[0])


def test_a_folder_without_results_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="pmr run"):
        pmr.results.load(tmp_path)
