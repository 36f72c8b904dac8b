"""`pmr chart`: the study that it writes, and what it refuses."""

from __future__ import annotations

from pathlib import Path

import pytest
from processes import called

from pmr.studies import files


@pytest.mark.parametrize(
    ("scene", "up_to", "says"),
    [("boom_beam", "1000", "SCENE = "), ("crane", "0", "--up-to = 0"), ("crane", "-5", "--up-to = -5")],
)
def test_what_has_no_chart_is_refused_in_one_line(
    scene: str, up_to: str, says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    done = called(monkeypatch, capsys, "chart", scene, "--up-to", up_to, "--out", str(tmp_path))
    assert done.returncode == 2 and says in done.stderr and done.stderr.count("\n") == 1, done.stderr
    assert not list(tmp_path.iterdir())


def test_the_study_that_it_writes_asks_for_all_that_the_scene_goes_through(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.setattr("pmr.cli.study.study", lambda *_, **__: None)  # written, not computed
    called(monkeypatch, capsys, "chart", "crane", "--up-to", "20000", "--out", str(tmp_path))
    asked = files.load(tmp_path / "chart.toml").parts[0].study
    assert (asked.extensions[0], asked.extensions[-1]) == (
        {"middle": 0.6, "fly": 0.6}, {"middle": 4.5, "fly": 4.5},
    )  # fmt: skip
    assert (asked.luffing.least, asked.luffing.most) == (10.0, 60.0)


def test_a_chart_of_a_folder_has_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    monkeypatch.setattr("pmr.cli.study.study", lambda *_, **__: None)  # written, not computed
    monkeypatch.chdir(tmp_path)
    called(monkeypatch, capsys, "new", "crane", "mine")
    called(monkeypatch, capsys, "chart", "mine", "--up-to", "20000")
    assert (tmp_path / "reports" / "chart_mine" / "chart.toml").is_file()
