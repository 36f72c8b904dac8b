"""The roller's position on measured series that settings were not tuned on, where there is a folder with them."""

from __future__ import annotations

import os
import runpy
from pathlib import Path

import pytest

from pmr.observe.position import PositionObserver

#: Folder with series of Dataset-8 (CC BY-SA 4.0) as .npz files, which are not part of the project.
FOLDER = Path(os.environ.get("PMR_DROPBEAR", "none"))


@pytest.mark.slow
@pytest.mark.skipif(not (FOLDER / "rand1.npz").is_file(), reason="PMR_DROPBEAR names no folder with DROPBEAR's series")
def test_figures_of_the_manual_are_those_of_the_measurements() -> None:
    script = runpy.run_path(str(Path(__file__).parents[2] / "workflows" / "dropbear.py"))
    observer = PositionObserver(script["models"](), script["SETTINGS"])
    for name, rms, held in (("rand1", 6.2, 0.94), ("slow6", 3.1, 0.84)):
        figures = script["judge"](observer, [script["series"](FOLDER / f"{name}.npz")])
        assert figures["rms"] == pytest.approx(rms, abs=0.1) and figures["held"] == pytest.approx(held, abs=0.01)
    tuned, others = ([script["series"](FOLDER / f"{name}.npz")] for name in ("rand0", "rand1"))
    figures = script["judge_strain"](observer, tuned, others, 0)
    assert figures["NRMS"] == pytest.approx(0.177, abs=0.01) and figures["correlation"] > 0.98
