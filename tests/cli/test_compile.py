"""The command of earlier versions, which scripts may still call."""

from __future__ import annotations

from processes import called


def test_nothing_is_to_be_compiled(monkeypatch, capsys) -> None:
    done = called(monkeypatch, capsys, "compile")
    assert done.returncode == 0 and done.stdout.startswith("nothing is to be compiled")
