import io
import json
import re
import subprocess
import sys
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from processes import FENICSX, PETSC, without
from scipy.interpolate import PPoly

from pmr import InputError, ReducedModel
from pmr.system.body import project, pushing_rows
from pmr.system.reduced_model import satisfied_rows

RNG = np.random.default_rng(2)


@pytest.fixture
def model() -> ReducedModel:
    A = RNG.standard_normal((3, 4, 4))
    M, D, K = A @ A.transpose(0, 2, 1)
    rows = PPoly(RNG.standard_normal((4, 3, 2, 4)), [0.0, 1.0, 2.0, 5.0])
    provenance = {"scene_hash": "abc", "nested": {"x": [1, 2.5]}}
    return ReducedModel(
        M, D, K, RNG.standard_normal((4, 2)), RNG.standard_normal((6, 4)), rows, ("F", "G"), ("slider a", "slider b"),
        np.linspace(0, 5, 6), left_out=("support",), provenance=provenance,
    )  # fmt: skip


def test_a_model_survives_its_file(model: ReducedModel, tmp_path: Path) -> None:
    loaded = ReducedModel.load(model.save(tmp_path / "m.npz"))
    for name in ("M", "D", "K", "B", "outputs", "output_positions"):
        assert np.array_equal(getattr(loaded, name), getattr(model, name))
    for name in ("input_names", "row_names", "left_out", "provenance", "size", "domain"):
        assert getattr(loaded, name) == getattr(model, name)
    s = np.linspace(0.0, 5.0, 17)
    assert np.array_equal(loaded.C(s), model.C(s)) and np.array_equal(loaded.C(1.3, 1), model.C(1.3, 1))


def test_clearances_survive_the_file_and_old_files_have_none(model: ReducedModel, tmp_path: Path) -> None:
    pushing = replace(model, clearance=np.array([np.nan, 2e-3]))
    file = pushing.save(tmp_path / "m.npz")
    loaded = ReducedModel.load(file)
    assert np.array_equal(loaded.row_clearance, [np.nan, 2e-3], equal_nan=True)
    assert np.isnan(model.row_clearance).all() and pushing_rows(loaded) == [1]
    assert np.array_equal(loaded.leading(2).row_clearance, loaded.row_clearance, equal_nan=True)
    with np.load(file) as data:
        arrays = {name: data[name] for name in data if name != "clearance"}
    np.savez(tmp_path / "old.npz", **arrays)
    assert pushing_rows(ReducedModel.load(tmp_path / "old.npz")) == []


def test_matrices_of_a_moving_frame_survive_the_file_and_are_cut_with_the_coordinates(
    model: ReducedModel, tmp_path: Path
) -> None:
    turning = replace(model, matrices={"rotating x": RNG.standard_normal((4, 4))})
    loaded = ReducedModel.load(turning.save(tmp_path / "m.npz"))
    assert np.array_equal(loaded.matrices["rotating x"], turning.matrices["rotating x"])
    assert np.array_equal(loaded.leading(2).matrices["rotating x"], turning.matrices["rotating x"][:2, :2])
    assert dict(ReducedModel.load(model.save(tmp_path / "without.npz")).matrices) == {}
    wrong = replace(model, matrices={"rotating x": np.zeros((3, 4))})
    with pytest.raises(InputError, match=r"matrices\.rotating x has shape \(3, 4\)"):
        ReducedModel.load(wrong.save(tmp_path / "wrong.npz"))


def test_nothing_in_the_file_is_pickled(model: ReducedModel, tmp_path: Path) -> None:
    with zipfile.ZipFile(model.save(tmp_path / "m.npz")) as archive:
        for name in archive.namelist():
            np.load(io.BytesIO(archive.read(name)), allow_pickle=False)
    with pytest.raises(TypeError, match="JSON"):
        replace(model, provenance={"what": object()}).save(tmp_path / "n.npz")


def test_what_is_no_model_is_refused(model: ReducedModel, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        ReducedModel.load(tmp_path / "none.npz")
    text = tmp_path / "text.npz"
    text.write_text("hello")
    with pytest.raises(InputError, match="not a reduced model"):
        ReducedModel.load(text)
    np.savez(tmp_path / "other.npz", a=1)
    with pytest.raises(InputError, match="not a reduced model"):
        ReducedModel.load(tmp_path / "other.npz")


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda V: V * (1.0 + 0.5j), r"V = \[4, 2\]: vectors of real numbers as columns, with 4 rows"),
        (lambda V: V[:3], r"V = \[3, 2\]: vectors of real numbers"),
        (lambda V: V[:, 0], r"V = \[4\]: vectors of real numbers"),
        (lambda V: V * np.nan, "V: finite numbers are allowed"),
    ],
)
def test_vectors_that_no_projection_takes_are_refused(model: ReducedModel, change, says: str) -> None:
    with pytest.raises(InputError, match=says):
        project(model, change(np.eye(4)[:, :2]))


def test_applied_rows_are_the_rows_times_each_state(model: ReducedModel) -> None:
    s, q = np.array([0.0, 1.5, 5.0]), RNG.standard_normal((3, 4))
    expected = np.array([model.C(at, 1) @ state for at, state in zip(s, q, strict=True)])
    assert model.apply_rows(s, q, derivative=1) == pytest.approx(expected)


def test_rows_satisfied_identically_are_recognised_relative_to_the_others() -> None:
    c = np.zeros((2, 2, 3, 4))
    c[:, :, 0] = 1e-9
    c[1, 1, 2] = 1e3
    table = PPoly(c, [0.0, 1.0, 2.0])
    assert satisfied_rows(table, tolerance=1e-10) == [0, 1]
    assert satisfied_rows(table, tolerance=1e-13) == [1]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"M": np.full((4, 4), np.nan)}, "M is not finite"),
        ({"K": np.eye(3)}, "K has shape (3, 3), (4, 4) is allowed"),
        ({"input_names": ("F",)}, "B has shape (4, 2), (4, 1) is allowed"),
        ({"row_names": ("slider",)}, "rows has shape (2, 4)"),
        ({"output_positions": np.arange(5.0)}, "outputs has shape (6, 4)"),
        ({"clearance": np.zeros(3)}, "clearance has shape (3,)"),
        ({"clearance": np.array([np.nan, -1e-3])}, "values that are no lengths, (2,) from 0 on are allowed"),
        ({"M": -np.eye(4)}, "M has a negative eigenvalue"),
        ({"M": np.zeros((4, 4))}, "M is singular"),
        ({"K": np.triu(np.ones((4, 4)))}, "K is not symmetric"),
        ({"D": -np.eye(4)}, "D has a negative eigenvalue"),
        ({"output_positions": np.full(6, np.inf)}, "output_positions is not finite"),
        ({"output_names": ("w",)}, "1 names, 0 units and 0 kinds are given for 6 outputs"),
        ({"pads": np.array([np.inf, 0.0])}, "pads is not finite"),
    ],
)
def test_a_model_that_contradicts_itself_or_that_no_structure_has_is_refused(
    model: ReducedModel, tmp_path: Path, change: dict, says: str
) -> None:
    file = replace(model, **change).save(tmp_path / "m.npz")
    with pytest.raises(InputError, match=re.escape(says)):
        ReducedModel.load(file)


@pytest.mark.parametrize(
    "header",
    [
        [], {"format": []}, {"version": "four"}, {"version": 1e400}, {"version": 4},
        {"version": 4, "row_names": "ab", "provenance": {}}, {"version": 4, "row_names": [1, 2], "provenance": {}},
        {"version": 4, "input_names": None, "provenance": {}}, {"version": 4, "provenance": []},
    ],
    ids=repr,
)  # fmt: skip
def test_a_header_of_other_types_is_refused(model: ReducedModel, tmp_path: Path, header: Any) -> None:
    with np.load(model.save(tmp_path / "m.npz")) as data:
        arrays = dict(data)
    whole = json.loads(str(arrays.pop("header")))
    crafted = whole | header if isinstance(header, dict) else header
    np.savez(tmp_path / "crafted.npz", header=np.array(json.dumps(crafted)), **arrays)
    with pytest.raises(InputError) as caught:
        ReducedModel.load(tmp_path / "crafted.npz")
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.slow
def test_three_hundred_kilobytes_never_ask_for_three_hundred_megabytes(model: ReducedModel, tmp_path: Path) -> None:
    with np.load(model.save(tmp_path / "m.npz")) as data:
        arrays = dict(data)
    code = (
        "import re, sys; from pmr.system.reduced_model import ReducedModel\n"
        "def peak():  # of this process, not of the one that started it\n"
        "    return int(re.search('VmHWM:(.*) kB', open('/proc/self/status').read())[1])\n"
        "before = peak()\n"
        "try:\n    ReducedModel.load(sys.argv[1])\n"
        "except ValueError as error:\n    print(error)\n"
        "print(peak() - before)\n"
    )
    np.savez_compressed(tmp_path / "m.npz", **(arrays | {"M": np.zeros((2**12, 2**13))}))
    assert (tmp_path / "m.npz").stat().st_size < 3e5
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path / "m.npz")], capture_output=True, text=True)
    line, kilobytes = done.stdout.splitlines()
    assert "claims to hold 268," in line and int(kilobytes) < 50_000


def test_a_damaged_file_is_refused(model: ReducedModel, tmp_path: Path) -> None:
    content = model.save(tmp_path / "m.npz").read_bytes()
    for damaged in (b"", content[: len(content) // 2], content[:400] + bytes(80) + content[480:]):
        (tmp_path / "m.npz").write_bytes(damaged)
        with pytest.raises(InputError, match="not a reduced model"):
            ReducedModel.load(tmp_path / "m.npz")


@pytest.mark.slow
def test_the_right_world_lives_without_fenicsx() -> None:
    """Nothing that a reduced model needs imports dolfinx, PETSc, SLEPc or MPI."""
    code = (
        "import pmr.system.reduced_model, pmr.results, pmr.compare.errors, pmr.compare.frequencies, pmr.cli.app\n"
        "import pmr.simulation.exudyn.simulator, pmr.simulation.exudyn.ancf, pmr.export.exudyn_script\n"
        "import pmr.report.document\n"
    )
    done = without((*FENICSX, *PETSC), code=code)
    assert done.returncode == 0, done.stderr
