"""What a run prints while it computes, where there is no terminal."""

from __future__ import annotations

from pathlib import Path

import pytest
from processes import called

SHORT = ("--set", "compare.against=[]", "--set", "time.end=0.05", "--set", "mesh.elements=10")


def stages(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], folder: Path, quiet: float
) -> list[str]:
    """Stages of a short run, as the lines on standard error name them."""
    monkeypatch.setattr("pmr.cli.run.QUIET", quiet)
    done = called(monkeypatch, capsys, "run", "boom_beam", *SHORT, "--out", str(folder))
    assert done.returncode == 0, done.stderr
    lines = [line for line in done.stderr.splitlines() if line.startswith(("boom_beam: ", "report: "))]
    return [line.partition(", after ")[0] for line in lines]


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_long_run_says_each_stage_once_and_a_short_one_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], unmeasured
) -> None:
    unmeasured(True)
    found = stages(monkeypatch, capsys, tmp_path, quiet=0.0)
    assert found[0] == "boom_beam: assemble" and found[-1] == "report: write"
    assert len(found) == len(set(found)) > 4
    assert not stages(monkeypatch, capsys, tmp_path, quiet=1000.0)
