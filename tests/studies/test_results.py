from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from pmr.studies.results import RunRecord, StudyResults

FIGURES = {"e": 0.1, "ok": True, "count": 3}
PULLED = (
    "the rope of fly would have to push with up to 1.5e3 N at t = 7.31 s: the model holds both ways",
    "the model is off by up to 57 % beside a coarse shell; a richer one is closer",
)


def results(folder: Path) -> StudyResults:
    return StudyResults(
        folder,
        (
            RunRecord(
                "a",
                "done",
                {"n": 1, "solver": "x, y"},
                {"e": 0.1, "ok": True, "count": 3},
                {"task": 1.0},
                warnings=PULLED,
            ),
            RunRecord("b", "failed", {"n": 2, "solver": None}, {}, {}, 'said "no"', "Traceback"),
            RunRecord(
                "c",
                "done",
                {"n": 3, "solver": "z"},
                {"e": 1e-17, "ok": False, "more": 2.0},
                {"task": 2.0},
                warnings=("the rope of fly would have to push with up to 3 N at t = 1 s: the model holds both ways",),
            ),
        ),
    )


def test_columns_come_in_the_order_in_which_they_come_up(tmp_path: Path) -> None:
    found = results(tmp_path)
    found.save({})
    assert (tmp_path / "runs.csv").read_text() == (
        "run,status,reason,n,solver,e,ok,count,more,warnings\n"
        f'a,done,,1,"x, y",0.1,true,3,,{PULLED[0]} | {PULLED[1]}\n'
        'b,failed,"said ""no""",2,,,,,,\n'
        f"c,done,,3,z,1e-17,false,,2.0,{found.runs[2].warnings[0]}\n"
    )
    assert (tmp_path / "seconds.csv").read_text() == "run,task\na,1.0\nb,\nc,2.0\n"


def test_a_column_has_the_type_that_holds_all_its_values(tmp_path: Path) -> None:
    found = results(tmp_path)
    assert found.column("n").tolist() == [1, 2, 3] and found.column("n").dtype.kind == "i"
    assert found.column("solver").tolist() == ["x, y", "", "z"]
    e, ok = found.column("e"), found.column("ok")
    assert e[2] == 1e-17 and np.isnan(e[1]) and ok[0] == 1.0 and np.isnan(ok[1])
    found.save({})
    with np.load(tmp_path / "runs.npz", allow_pickle=False) as table:
        assert all(np.array_equal(table[name], found.column(name), equal_nan=name in {"e", "ok", "count", "more"})
                   for name in table)  # fmt: skip


def test_what_was_saved_is_loaded(tmp_path: Path) -> None:
    found = results(tmp_path)
    found.save({"title": "Three"})
    assert StudyResults.load(tmp_path) == found and not found.is_complete
    assert json.loads((tmp_path / "summary.json").read_text())["title"] == "Three"


def test_warnings_are_counted_by_their_kind(tmp_path: Path) -> None:
    """Numbers differ from run to run; what is said is the text of the first run."""
    rope, model = results(tmp_path).warnings
    assert (rope.runs, rope.text) == (("a", "c"), PULLED[0])
    assert rope.line(3) == f"in 2 of 3 runs, first in a: {PULLED[0]}"
    assert model.line(3) == f"in a: {PULLED[1]}" and model.line(1) == PULLED[1]


def test_studies_of_earlier_versions_had_notes(tmp_path: Path) -> None:
    found = results(tmp_path)
    found.save({})
    file = tmp_path / "summary.json"
    file.write_text(file.read_text().replace('"warnings": [', '"notes": ['))
    assert '"warnings"' not in file.read_text() and StudyResults.load(tmp_path) == found
