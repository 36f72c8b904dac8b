"""What first runs compile: the scenes that are run for it, and what is said where one fails."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest
from processes import called

from pmr import scene as scenes
from pmr.cli import compile as command
from pmr.cli.new import TEMPLATES, kinds


def test_it_runs_scenes_to_start_from_of_one_body_and_of_several() -> None:
    several = {kind: "[[sections]]" in (TEMPLATES / f"{kind}.toml").read_text() for kind in command.KINDS}
    assert set(command.KINDS) <= set(kinds())
    assert set(several.values()) == {False, True}


@pytest.mark.parametrize("kind", command.KINDS)
def test_these_scenes_may_be_as_short_as_they_are_run(kind: str) -> None:
    assert scenes.load_any(TEMPLATES / f"{kind}.toml", [f"time.end={command.END}"]).time.end == command.END


@pytest.mark.slow
def test_nothing_but_compiled_code_stays(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(command, "KINDS", ("beam",))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    done = called(monkeypatch, capsys, "compile")
    assert done.returncode == 0
    assert done.stdout == "compiling what first runs take: beam\n"
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_where_a_run_fails_its_line_is_said(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(command, "KINDS", ("beam",))
    monkeypatch.setattr(command, "END", -1.0)
    failed = called(monkeypatch, capsys, "compile")
    assert failed.returncode == 1
    assert failed.stderr.startswith("pmr: not compiled: beam: ") and "time.end" in failed.stderr
