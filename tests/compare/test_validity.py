"""A motion that no linear model describes is said, a small one is not."""

from __future__ import annotations

from pathlib import Path

import pytest

from pmr import scene as scenes
from pmr.pipeline import run

SHORT = ["mesh.elements=8", "reduction.snapshots=3", "reduction.modes=3", "reduction.coordinates=6", "time.end=0.4"]
SHORT += ["time.step=4e-3", "slider.path=2.5", "compare.against=[]", "simulation.simulators=['march']"]


@pytest.mark.slow
@pytest.mark.parametrize(("force", "times"), [(-50.0, None), (-5e7, True), (-5e4, True)])
def test_a_motion_as_large_as_the_body_is_said(force: float, times: bool | None) -> None:
    scene = scenes.load(Path("workflows/paper_simple.toml"), [*SHORT, f"loads=[{{on=5.0,signal={force!r}}}]"])
    outcome = run(scene)
    assert outcome is not None
    said = [line for line in outcome.result.summary["warnings"] if "theory of small motions" in line]
    assert len(said) == (1 if times else 0)
    if times:
        assert outcome.result.summary["max_displacement"] > 0.5
