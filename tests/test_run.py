import json

import numpy as np
import one_body
import pytest
from driving import driven
from one_body import respond
from scipy.signal import butter, sosfiltfilt

from pmr import RunResult, reduce, run
from pmr.compare.errors import relative_error
from pmr.errors.environment import Clock
from pmr.fem.compat import MPI
from pmr.fullmodel.build import full_model
from pmr.simulation import TimeStepping

SHORT = ("time.end=0.5", "mesh.elements=20", "slider.path={kind='ramp',times=[0.1,0.4],values=[1.25,1.6]}")


@pytest.mark.slow
@pytest.mark.mpi
def test_a_run_gives_its_result_on_rank_0(load_scene, tmp_path) -> None:
    stages: list[tuple[str, float]] = []
    scene = load_scene("paper_evolved", SHORT)
    outcome = run(scene, clock=Clock(lambda stage, share: stages.append((stage, share))))
    if MPI.COMM_WORLD.rank > 0:
        assert outcome is None
        return
    assert outcome is not None
    assert 0.5 in {round(share, 2) for stage, share in stages if stage == "ancf"}
    result, summary = outcome.result, outcome.result.summary
    assert list(dict.fromkeys(stage for stage, share in stages if share == 1.0)) == [
        "assemble", "snapshots", "pod", "frequencies", "reduced, march", "reduced, exudyn", "estimate", "full", "ancf",
        "step",
    ]  # fmt: skip
    assert set(summary["errors"]) == {"reduced_vs_full", "full_vs_ancf", "reduced_vs_ancf"}
    assert summary["coordinates"] == {"full": 63, "reduced": 20} and summary["scene_hash"] == scene.hash
    assert set(summary["seconds"]) == {"assemble", "snapshots", "pod", "estimate", "simulate"}
    assert set(summary["seconds"]["simulate"]) == {"march", "exudyn", "full", "ancf"}
    assert summary["estimate"]["by"] == "other model"
    assert 1.0 <= summary["estimate"]["beam"] / summary["errors"]["reduced_vs_full"]["beam"] < 2.0
    assert result.tip_error is not None and result.tip_error.shape == (len(result.abscissa), 1)
    assert all("change their sign with every step" in line for line in summary["warnings"])  # forces, behind kinks
    assert set(summary["agreement"]) == {"march_vs_exudyn"} and 0.0 < summary["agreement"]["march_vs_exudyn"] < 1e-11
    assert summary["simulators"] == {"reduced": "march", "full": "march"}
    assert all(
        np.isfinite(r.displacement).all() and r.displacement.shape == (501, 21) for r in result.responses.values()
    )
    assert summary["max_displacement"] == np.abs(result.responses["full"].displacement).max()
    assert result.frequencies.models["full"] == pytest.approx(result.frequencies.models["closed_form"], rel=1e-2)
    result.save(tmp_path)
    json.loads((tmp_path / "summary.json").read_text())
    loaded = RunResult.load(tmp_path)
    assert loaded.scene == scene and loaded.summary == summary
    assert np.array_equal(loaded.responses["full"].tip, result.responses["full"].tip)
    assert np.array_equal(loaded.body.shapes.shapes, result.body.shapes.shapes)
    assert loaded.responses["reduced"].seconds == result.responses["reduced"].seconds


@pytest.mark.slow
@pytest.mark.mpi
def test_six_coordinates_with_residual_flexibility(load_scene) -> None:
    changes = ["reduction.solver=slepc", "simulation.simulators=['march','exudyn','exudyn-multiplier']"]
    outcome = run(load_scene("evolved_residual", [*SHORT, *changes]))
    if outcome is None:
        return
    assert len(outcome.result.summary["agreement"]) == 3
    assert max(outcome.result.summary["agreement"].values()) < 1e-12
    summary, reduced = outcome.result.summary, outcome.reduced
    assert summary["coordinates"] == {"full": 63, "reduced": 6}
    found = summary["errors"]["reduced_vs_full"]
    assert 0.0 < found["beam"] < 2e-3 and 0.0 < summary["not_judged"]["pad_force"]["below"] < 1e-2
    assert reduced.provenance["basis"].startswith("eigenmodes on the fixed supports with the sliders released")
    assert "residual flexibility" in summary["basis"]["kind"]
    assert summary["basis"]["carriers"] == 42  # deflection and slope at 21 nodes
    assert outcome.result.responses["reduced"].residual_position.max() < 1e-12
    assert outcome.result.frequencies.models["reduced"][:, :2] == pytest.approx(
        outcome.result.frequencies.models["full"][:, :2], rel=1e-4
    )


ODD = {
    "all coordinates held": ["reduction.coordinates=3"],
    "no load": ["loads=[{on=5.0,signal=0.0}]"],
    "two sliders": ["slider.offsets=[0.0,0.4]"],
    "clamped": ["supports=[{on=0.0,kind='clamped'}]"],
    "three supports, one in mid-element": ["supports=[{on=0.0},{on=4.0,kind='roller'},{on=4.61,kind='roller'}]"],
    "slider on the load": ["slider.path=5.0"],
    "no axial coordinates, mass product": ["body.profile.axial=false", "reduction.product=mass"],
    "moment and force": ["loads=[{on=5.0,signal=-50},{name='T',on=2.2,direction='ry',signal=3.0}]"],
}


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.parametrize("odd", ODD)
def test_odd_scenes_give_finite_results(load_scene, odd: str) -> None:
    outcome = run(load_scene("paper_simple", [*SHORT, "time.end=0.05", "compare.against=['full']", *ODD[odd]]))
    assert outcome is not None
    found = outcome.result.summary["errors"]["reduced_vs_full"]
    assert all(np.isfinite(value) and value >= 0.0 for value in found.values())
    exact = {"all coordinates held": 1.0, "no load": 0.0, "slider on the load": 0.0}
    if odd in exact:
        assert found["tip"] == exact[odd]
    else:
        assert 0.0 < found["tip"] < 0.05


@pytest.mark.slow
@pytest.mark.parametrize("size", [1e-12, 1e-3, 1e6, 1e100])
def test_errors_of_a_linear_model_do_not_depend_on_the_size_of_its_load(load_scene, size: float) -> None:
    """Not by an absolute length below which nothing counts; and where the load sits on the slider, nothing moves."""

    def errors(size: float, *overrides: str) -> dict[str, float]:
        loads = f"loads=[{{on=5.0,signal={size!r}}}]"
        short = ["time.end=0.1", "compare.against=['full']", "simulation.simulators=['march']"]
        outcome = run(load_scene("simple_residual", [*SHORT, *short, loads, *overrides]))
        assert outcome is not None
        estimated, found = outcome.result.summary["estimate"], outcome.result.summary["errors"]["reduced_vs_full"]
        return {place: found[place] for place in ("tip", "beam")} | {f"~{p}": estimated[p] for p in ("tip", "beam")}

    one, other = errors(1.0), errors(size)
    assert min(one.values()) > 1e-6 and other == pytest.approx(one, rel=1e-4)
    assert set(errors(size, "slider.path=5.0").values()) == {0.0}


#: Largest error of the beam allowed, in %.
BEAM = {"evolved_residual": {4: 2.6, 5: 0.65, 6: 0.24, 10: 0.04, 20: 0.0025}, "simple_residual": {5: 0.4, 6: 0.26}}


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.parametrize("name", BEAM)
def test_few_coordinates_with_residual_flexibility_do_what_twenty_did_not(load_scene, name: str) -> None:
    scene = load_scene(name)
    full = full_model(scene).gather()
    assert full is not None
    stepping, path, load = TimeStepping(15.0, 1e-3, 0.9), scene.slider.path, scene.loads[0].signal
    loads = load.value(stepping.times)[:, None]
    reference = respond(full, one_body.simulate(full, driven(path, load, stepping)), path.rate(stepping.times), loads)
    found, forces = {}, {}
    for r in BEAM[name]:
        reduced = reduce(load_scene(name, [f"reduction.coordinates={r}"])).reduced
        response = respond(
            reduced, one_body.simulate(reduced, driven(path, load, stepping)), path.rate(stepping.times), loads
        )
        assert len(reduced.K) == r
        found[r] = 100.0 * relative_error(response.displacement, reference.displacement)
        slow = butter(4, 50.0, fs=1000.0, output="sos")
        forces[r] = 100.0 * relative_error(*(sosfiltfilt(slow, x.slider_force[:, 0]) for x in (response, reference)))
    assert all(found[r] <= allowed for r, allowed in BEAM[name].items()), found
    if name == "evolved_residual":
        # Kinks of the path strike modes that are left out; what a basis covers, up to 50 Hz, it has in the force too.
        assert forces[6] < 2.0 and forces[10] < 0.4 and forces[20] < 0.004, forces


@pytest.mark.slow
@pytest.mark.numerical
def test_the_papers_basis_is_sixty_times_better_with_what_it_leaves_out(load_scene) -> None:
    """Twenty coordinates, evolved case: 1.49 % of the beam without."""
    changes = ["reduction.basis=eigenmodes", "reduction.coordinates=20"]
    outcome = run(load_scene("evolved_residual", changes))
    assert outcome is not None
    assert outcome.result.summary["errors"]["reduced_vs_full"]["beam"] < 0.0149 / 60.0


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.mpi
@pytest.mark.skipif(MPI.COMM_WORLD.size == 1, reason="compares two ranks with one")
def test_one_and_two_ranks_give_the_same_figures(load_scene) -> None:
    """A whole run on 1 and 2 ranks, SLEPc's path.

    Ranks add up in another order, which is a perturbation of the pool by E, |E| <= n u sigma_1 (backward error of a
    QR of n rows and of the decomposition after it).  Singular values move by |E| at most (Weyl), the eighteen vectors
    that are not held turn by |E| / (sigma_18 - sigma_19) (Wedin), and errors, which are relative to the motion, by as
    much.  The full model knows nothing of it.
    """
    scene = load_scene("paper_evolved", ["reduction.solver=slepc", "compare.against=['full']", "time.end=3.0"])
    alone, together = (run(scene, comm) for comm in (MPI.COMM_SELF, MPI.COMM_WORLD))
    if together is None:
        assert MPI.COMM_WORLD.rank > 0
        return
    a, b = (outcome.result.summary for outcome in (alone, together))
    sigma = np.array(a["basis"]["singular_values"])
    E = a["coordinates"]["full"] * np.finfo(float).eps / 2.0 * sigma[0]
    np.testing.assert_allclose(b["basis"]["singular_values"], sigma, rtol=0.0, atol=E)
    turned = E / (sigma[17] - sigma[18])
    displaced = [a["errors"]["reduced_vs_full"][name] for name in ("tip", "beam")]
    assert turned < 1e-8 < 1e-4 * min(displaced)
    assert a["errors"]["reduced_vs_full"] == pytest.approx(b["errors"]["reduced_vs_full"], rel=0.0, abs=turned)
    assert a["max_displacement"] == pytest.approx(b["max_displacement"], rel=1e-9)


@pytest.mark.slow
@pytest.mark.numerical
def test_free_modes_with_flexibility_come_with_an_estimate(load_scene) -> None:
    scene = load_scene("evolved_residual", [*SHORT, "simulation.simulators=['march']"])
    outcome = run(scene)
    assert outcome is not None
    summary = outcome.result.summary
    assert 1.0 < summary["estimate"]["beam"] / summary["errors"]["reduced_vs_full"]["beam"] < 2.0
    assert 0.0 < summary["estimate"]["chi"] < 1.5
    assert summary["estimate"]["seconds"] > 0.0 and 0.0 < summary["estimate"]["largest"] < summary["max_displacement"]
    assert outcome.reduced.enrichment is not None and summary["coordinates"]["reduced"] == outcome.reduced.size == 6
    plain = run(load_scene("evolved_residual", [*SHORT, "simulation.simulators=['march']", "reduction.estimate=false"]))
    assert plain is not None and "estimate" not in plain.result.summary and plain.reduced.enrichment is None
