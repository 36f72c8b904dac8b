from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from pmr.studies.results import RunRecord, StudyResults


def results(folder: Path) -> StudyResults:
    return StudyResults(
        folder,
        (
            RunRecord("a", "done", {"n": 1, "solver": "x, y"}, {"e": 0.1, "ok": True, "count": 3}, {"task": 1.0}),
            RunRecord("b", "failed", {"n": 2, "solver": None}, {}, {}, 'said "no"', "Traceback"),
            RunRecord("c", "done", {"n": 3, "solver": "z"}, {"e": 1e-17, "ok": False, "more": 2.0}, {"task": 2.0}),
        ),
    )


def test_columns_come_in_the_order_in_which_they_come_up(tmp_path: Path) -> None:
    results(tmp_path).save({})
    assert (tmp_path / "runs.csv").read_text() == (
        "run,status,reason,n,solver,e,ok,count,more\n"
        'a,done,,1,"x, y",0.1,true,3,\n'
        'b,failed,"said ""no""",2,,,,,\n'
        "c,done,,3,z,1e-17,false,,2.0\n"
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
