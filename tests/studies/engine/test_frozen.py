"""Results belong to the code that computed them, also where it is edited while a study begins."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from waiting import PATIENCE

import pmr
from pmr.files.whole import replaced
from pmr.studies.engine.frozen import Sources, sources

SCRIPT = Path(__file__).with_name("edited.py")
EDITS = 12 if os.environ.get("PMR_SWEEP") == "full" else 1


def start(code: Path, folder: Path) -> subprocess.Popen[str]:
    paths = os.pathsep.join([str(code), str(SCRIPT.parent)])
    return subprocess.Popen(
        [sys.executable, str(SCRIPT), str(folder)],
        stdout=subprocess.PIPE,
        text=True,
        env=dict(os.environ) | {"PYTHONPATH": paths},
    )


def figures(process: subprocess.Popen[str]) -> set[float]:
    said, _ = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0
    return {float(word) for word in said.split()[-2:]}


@pytest.mark.slow
def test_code_edited_while_a_study_begins_gives_no_result_of_the_one_under_the_name_of_the_other(
    tmp_path: Path,
) -> None:
    code = tmp_path / "code"
    shutil.copytree(Path(pmr.__file__).parent, code / "pmr", ignore=shutil.ignore_patterns("__pycache__"))
    edited, text = code / "pmr" / "errors" / "environment.py", (code / "pmr" / "errors" / "environment.py").read_text()

    def edit(figure: int) -> None:
        """Of the same length, and perhaps within the same second: Python's own cache would take it for the old one."""
        with replaced(edited) as new:  # nobody reads half of it
            new.write_text(f"{text}\nFIGURE = {figure}.0\n")

    edit(0)
    begin = time.perf_counter()
    assert figures(start(code, tmp_path / "first")) == {0.0}
    took = time.perf_counter() - begin
    rng = np.random.default_rng(20)
    for k in range(EDITS):
        folder = tmp_path / str(k)
        edit(1)
        process = start(code, folder)
        time.sleep(took * rng.uniform(0.1, 0.9))
        edit(2)
        found = figures(process)
        assert found in ({1.0}, {2.0})  # one code computed all of it
        assert figures(start(code, folder)) == {2.0}
        edit(1)
        assert figures(start(code, folder)) == {1.0}


def test_a_module_has_the_source_that_was_read() -> None:
    kept = sources()
    assert kept.of("pmr.studies.engine.frozen") == (Path(kept.root) / "studies" / "engine" / "frozen.py").read_text()
    assert kept.of("numpy") is None
    assert Sources(kept.root, {**kept.files, "errors/environment.py": ""}).digest != kept.digest
