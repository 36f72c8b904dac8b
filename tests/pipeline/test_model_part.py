"""A run's own model beside a richer one: the part of the budget, and the cache that it is found in."""

from pathlib import Path

import numpy as np
import pytest

import pmr
from pmr.compare.model_part import Motion
from pmr.fem.compat import MPI
from pmr.pipeline import model_errors as pipeline
from pmr.reduction.cache import SystemCache

pytest.importorskip("gmsh")
CELLS = {"size": 0.2, "along": 0.4}
ALONE = ["compare.against=[]", "simulation.simulators=['march']", "time.step=0.004"]


def run(name: str, *changes: str, **rest):
    return pmr.run(pmr.load_scene(name, [*ALONE, *changes]), **rest).result


def test_rows_within_reach_are_zero_between_two_joints_and_change_no_motion() -> None:
    scene = pmr.load_scene("boom_three", [*ALONE, "section.mesh.elements=6"])
    whole, within = (pipeline.reduce_scene(scene, MPI.COMM_WORLD, reach=reach) for reach in (False, True))
    models = [of.built["base"].model for of in (whole, within)]
    rows = [model.rows.rows[model.rows.names.index("pads 1 bottom")] for model in models]  # 0.75 to 4.65 m, and 5.85 m
    at, between = np.array([0.75, 2.0, 4.65, 5.85]), np.array([5.2])
    assert np.array_equal(rows[1].at(at).toarray(), rows[0].at(at).toarray())
    assert rows[0].at(between).toarray().any() and not rows[1].at(between).toarray().any()
    motions = [Motion.compute(scene, of.system).response.displacement for of in (whole, within)]
    assert motions[1] == pytest.approx(motions[0], rel=1e-9, abs=1e-9 * np.abs(motions[0]).max())


def test_a_stored_system_serves_no_scene_in_which_pads_get_farther(tmp_path: Path) -> None:
    cache = SystemCache(tmp_path, "", MPI.COMM_SELF)
    long, *others = (
        pmr.load_scene("boom_three", ["section.mesh.elements=6", *changes])
        for changes in ([], ["time.end=2.0"], ["time.step=0.01"])
    )
    cache.system_of(long, lambda: pipeline.reduce_scene(long, MPI.COMM_SELF, reach=True).system)
    assert [cache.has_system(scene) for scene in (long, *others)] == [True, False, True]


@pytest.mark.slow
def test_a_beam_beside_a_shell_is_off_by_what_two_runs_are_apart(tmp_path: Path, monkeypatch) -> None:
    """Within a factor of two of the largest displacements' difference; frequencies are those of the shell itself."""
    cells = [f"mesh.{key}={value}" for key, value in CELLS.items()]
    beam = run("boom_beam", "compare.richer='shell'", *cells, cache=tmp_path)
    shell = run("boom_shell", *cells, "recovery.stress=false")
    found = beam.summary["budget"]["model"]
    apart = 1.0 - beam.summary["max_displacement"] / shell.summary["max_displacement"]
    assert found["beside"] == "shell" and found["largest"] == pytest.approx(apart, rel=0.02)
    assert 0.5 < found["tip"] / apart < 2.0 and 0.5 < found["beam"] / apart < 2.0
    f = {name: one.frequencies.models["reduced"][[0, -1], :2] for name, one in (("own", beam), ("richer", shell))}
    for name, expected in f.items():
        assert np.array(found["frequencies"][name])[[0, -1]] == pytest.approx(expected, rel=2e-3)
    assert found["frequency"] == pytest.approx(np.abs(f["own"] / f["richer"] - 1.0).max(), rel=0.02)

    def never(*_, **__):
        raise AssertionError("what was measured is made again")

    monkeypatch.setattr(pipeline, "reduce_scene", never)
    again = run("boom_beam", "compare.richer='shell'", *cells, cache=tmp_path)
    assert again.summary["budget"]["model"]["beside"] == "shell"


@pytest.mark.slow
def test_without_the_key_there_is_none_and_what_forbids_it_is_said() -> None:
    short = ("time.end=0.5", "mesh.elements=10")
    plain = run("boom_beam", *short)
    assert "model" not in plain.summary.get("budget", {})
    same = run("boom_beam", *short, "compare.richer='beam3d'")
    found = same.summary["budget"]["model"]
    assert found["beside"] is None and "is as rich as that" in found["reason"]
    assert same.summary["max_displacement"] == plain.summary["max_displacement"]
