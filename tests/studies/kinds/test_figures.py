from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from fuzz import toml
from ways.kinds import HOISTED, PLANE, boom, rings

from pmr import scene as scenes
from pmr.files.whole import user_cache_folder
from pmr.pipeline import run
from pmr.results import Energy, Response
from pmr.studies.kinds.scenes import motion_figures, run_case
from pmr.studies.shared import scene_arguments

WORKFLOWS = Path(__file__).parents[3] / "workflows"


def test_rows_hold_forces_frequencies_and_probes_with_times_and_places() -> None:
    scene = scenes.load(WORKFLOWS / "boom_beam.toml", ["slider.path={kind='ramp',times=[0.0,1.0],values=[1.5,2.5]}"])
    t = np.linspace(0.0, 1.0, 101)
    forces = np.stack([100.0 * np.sin(2.0 * np.pi * t), -3.0 * t], axis=1)
    response = Response(
        t, np.zeros(0), np.zeros((101, 0)), Energy(t, t, t), forces, t, t, 0.0,
        force_names=("force of mouth top", "force of cylinder"), others=5.0 * np.cos(2.0 * np.pi * t)[:, None],
        other_names=("weld stress along",), other_units=("Pa",),
    )  # fmt: skip
    s, frequencies = np.array([1.5, 2.0, 2.5]), np.array([[1.0, 4.0], [2.0, 5.0], [3.0, np.nan]])
    found = motion_figures(scene, response, s, frequencies)
    assert found["largest_force"] == pytest.approx(100.0)
    top = {key: found[f"forces.mouth top.{key}"] for key in ("min", "t_min", "s_min", "max", "t_max", "s_max")}
    assert top == pytest.approx(
        {"min": -100.0, "t_min": 0.75, "s_min": 2.25, "max": 100.0, "t_max": 0.25, "s_max": 1.75}
    )
    assert (found["forces.cylinder.min"], found["forces.cylinder.t_min"]) == (-3.0, 1.0)
    assert [found[f"frequencies.{at}.1"] for at in ("s_min", "s_middle", "s_max")] == pytest.approx([1.0, 2.0, 3.0])
    assert found["frequencies.s_max.2"] is None
    assert (found["path.s_min"], found["path.s_max"]) == (1.5, 2.5)
    assert found["probes.weld stress along.range"] == pytest.approx(10.0)
    assert found["probes.weld stress along.t_min"] == 0.5


@pytest.mark.slow
def test_a_row_has_ropes_and_the_warnings_of_the_run(tmp_path: Path) -> None:
    """A planar boom on pads that hold both ways, whose fly follows: beside a run of the same scene."""
    described = boom("On a rope", "beam2d", rings(faces=PLANE) | HOISTED)
    described["sections"][2]["joint"] = {"follows": "mid"}
    (tmp_path / "boom.toml").write_text(toml.written(described | {"compare": {"against": []}}))
    scene = scenes.load_any(tmp_path / "boom.toml")
    outcome, row = run(scene, measures=user_cache_folder()), run_case(scene_arguments(scene), {})
    assert outcome is not None
    summary = outcome.result.summary
    ropes = {one["name"]: one["force"] for one in summary["ropes"]}
    assert set(ropes) == {"mid", "fly"} and ropes["fly"]["max"] - ropes["fly"]["min"] > 1.0
    for name, force in ropes.items():
        assert [row.record[f"ropes.{name}.{key}"] for key in ("min", "max")] == [force["min"], force["max"]]
    assert row.warnings == tuple(summary["warnings"])
    assert any("hold both ways and pull" in one for one in row.warnings)
