"""`pmr simulate`: a saved model under another scene, where there is no FEniCSx."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from processes import FENICSX, PETSC, without

from pmr import InputError, ReducedModel, System, scene, simulate
from pmr import pipeline as whole
from pmr.compare.simulated import check_same_scene
from pmr.compare.summary import simulate_saved

ROOT = Path(__file__).parents[2]
EARLIER = ROOT / "tests" / "files" / "earlier" / "reduced.npz"
#: What simulates a saved model needs none of these.
ABSENT = (*FENICSX, *PETSC, "exudyn")
OURS = ["compare.against=[]", "simulation.simulators=['march']", "simulation.repeats=1"]
OTHER = {
    "evolved_residual": ["slider.path={kind='smooth_ramp',times=[0.2,0.6,1.0],values=[1.5,3.2,2.0]}", "time.end=1"],
    # any stretch of the travel that the rows of a structure in space are tabulated over
    "boom_beam": ["slider.path={kind='ramp',times=[0.2,0.6,1.0],values=[3.5,1.7,2.0]}", "time.end=1",
     "recovery.every=1"],
}  # fmt: skip
MODELS = {"evolved_residual": OURS, "boom_beam": [*OURS, "slider.travel=[1.4,4.2]"]}
BOOM_BEAM, COARSE = (
    ROOT / "workflows" / "boom_beam.toml",
    [*MODELS["boom_beam"], "mesh.elements=8", "recovery.every=1"],
)


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    asked = scene.load(ROOT / "workflows" / "evolved_residual.toml", OURS)
    return whole.reduce(asked).reduced.save(tmp_path_factory.mktemp("saved") / "reduced.npz")


@pytest.fixture(scope="module")
def boom_beam(tmp_path_factory: pytest.TempPathFactory) -> ReducedModel:
    """Model of a coarse boom, saved and read again."""
    reduced = whole.reduce(scene.load(BOOM_BEAM, COARSE)).reduced
    return ReducedModel.load(reduced.save(tmp_path_factory.mktemp("boom") / "reduced.npz"))


def sets(overrides: list[str]) -> list[str]:
    return [part for one in overrides for part in ("--set", one)]


@pytest.mark.slow
@pytest.mark.parametrize("name", OTHER)
def test_it_finds_what_a_run_of_that_scene_finds(name: str, tmp_path: Path) -> None:
    """The run makes a model of its own; forces follow from displacements by stiffnesses of 1e6 N/m and more."""
    file, ours = ROOT / "workflows" / f"{name}.toml", MODELS[name]
    reduced = whole.reduce(scene.load(file, ours)).reduced.save(tmp_path / "reduced.npz")
    asked = ["--scene", str(file), "--out", str(tmp_path / "out"), *sets(ours + OTHER[name])]
    done = without(ABSENT, "simulate", str(reduced), *asked)
    assert done.returncode == 0 and "simulation, compiled" in done.stdout, done.stderr
    outcome = whole.run(scene.load(file, ours + OTHER[name]))
    assert outcome is not None
    expected = outcome.result.responses["reduced"]
    with np.load(tmp_path / "out" / "trajectories.npz") as found:
        for key, within in (("displacement", 1e-12), ("slider_force", 1e-11)):
            size = np.abs(getattr(expected, key)).max()
            assert size > 1e-4
            np.testing.assert_allclose(found[f"reduced.{key}"], getattr(expected, key), rtol=0.0, atol=within * size)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["max_displacement"] == pytest.approx(np.abs(expected.displacement).max(), rel=1e-11)
    assert summary["seconds"]["simulate"]["march"] > 0.0
    for key in ("estimate", "step"):
        assert summary[key]["beam"] == pytest.approx(outcome.result.summary[key]["beam"], rel=1e-6)


REFUSED = [
    (["--set", "slider.path=5.5"], "slider.path: the slider reaches 5.5 m"),
    (["--set", "time.rho_inf=1.5"], "time.rho_inf"),
    (["--scene", "boom_beam"], "loads"),
    (["--scene", "nowhere"], "no such scene file"),
    (["--set", "simulation.simulators=['exudyn']"], "exudyn"),
]


@pytest.mark.parametrize(("arguments", "says"), REFUSED, ids=[" ".join(a) for a, _ in REFUSED])
def test_what_does_not_fit_the_model_is_refused_in_one_line(
    saved: Path, arguments: list[str], says: str, tmp_path: Path, monkeypatch, run_command
) -> None:
    chosen = [] if "--scene" in arguments else ["--scene", str(ROOT / "workflows" / "evolved_residual.toml")]
    monkeypatch.setitem(sys.modules, "exudyn", None)
    out = str(tmp_path / "out")
    done = run_command("simulate", str(saved), *chosen, *arguments, "--out", out)
    assert done.returncode == 2
    assert says in done.stderr and len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "out" / "summary.json").exists()


@pytest.mark.slow
def test_a_path_beyond_what_the_model_was_made_for_is_refused_with_the_time(boom_beam: ReducedModel) -> None:
    """The boom is there, the model has its pads on another stretch."""
    path = "slider.path={kind='ramp',times=[0.0,1.0],values=[4.0,4.4]}"
    with pytest.raises(InputError, match=r"slider.path = 4.2\d*: 1.4 to 4.2 m is allowed; left at t = 0.5"):
        asked = scene.load(BOOM_BEAM, ["mesh.elements=8", path, "time.end=1", "recovery.every=1"])
        simulate_saved(System.of(boom_beam), asked)


@pytest.mark.slow
def test_loads_in_another_place_or_direction_than_the_model_was_made_with_are_refused(boom_beam: ReducedModel) -> None:
    file, ours, model = BOOM_BEAM, COARSE, boom_beam
    with pytest.raises(InputError, match=r"gravity.direction = .*: \[0.0, 0.0, -1.0\] is allowed, as in the model"):
        simulate_saved(System.of(model), scene.load(file, [*ours, "gravity.inclination=30.0"]))
    with pytest.raises(InputError, match=r"loads\[1\].direction = 'z': 'y' is allowed, as in the model"):
        simulate_saved(System.of(model), scene.load(file, [*ours, "loads.gust.direction=z"]))
    with pytest.raises(InputError, match=r"loads\[1\].on = 3.0: 'tip' is allowed, as in the model"):
        simulate(scene.load(file, [*ours, "loads.gust.on=3"]), model)
    written = model.provenance["scene"]
    older = {"scene": written | {"gravity": {}, "loads": [{"name": load["name"]} for load in written["loads"]]}}
    check_same_scene(replace(model, provenance=older), scene.load(file, ours))


BAKED = {
    "masses.payload.mass=500": r"masses\[0\].mass = 500.0: 250.0 is allowed, as in the model",
    "masses=[]": r"masses = \[\]: \[{.* is allowed, as in the model",
    "body.material.young=70e9": "body.material.young = 70000000000.0",
    "pads.mouth.stiffness=1e7": r"pads\[1\].stiffness = 10000000.0: 300000000.0 is allowed, as in the model",
    "pads.mouth.stiffness=rigid": r"pads\[1\].stiffness = 'rigid'",
    "pads.mouth.unilateral=true": r"pads\[1\].unilateral = True",
    "pads.mouth.faces={bottom=[0.0],top=[0.0]}": r"pads\[1\].faces",
    "damping={ratio=0.05,frequencies=[1.0,30.0]}": "damping.mass",
    "reduction.coordinates=7": "reduction.coordinates = 7: 10 is allowed, as in the model",
    "mesh.elements=9": "mesh.elements = 9",
    "observe={start=3.0,end=6.0,count=4}": "observe.start = 3.0",
}
FREE = ["title=x", "time.step=1e-3", "gravity.rise=0.1", "loads.gust.signal=3.0", "slider.path=2.0"]


@pytest.mark.slow
def test_what_is_baked_into_a_saved_model_is_refused_where_a_scene_says_something_else(boom_beam: ReducedModel) -> None:
    """Of each kind of key one; signals, path and time are free."""
    file, ours, model = BOOM_BEAM, COARSE, boom_beam
    check_same_scene(model, scene.load(file, [*ours, *FREE]))
    for change, says in BAKED.items():
        with pytest.raises(InputError, match=f"scene: {says}"):
            simulate_saved(System.of(model), scene.load(file, [*ours, change]))
        with pytest.raises(InputError, match=f"scene: {says}"):
            simulate(scene.load(file, [*ours, change]), model)


def test_a_file_of_another_content_than_the_models_is_refused(tmp_path: Path) -> None:
    basis = tmp_path / "basis.npz"
    np.savez(basis, V=np.eye(153, 6, k=-3))
    reduction = f"reduction={{basis='file',file='{basis}',coordinates=6}}"
    asked = scene.load(ROOT / "workflows" / "paper_simple.toml", [*OURS, reduction])
    made = {"scene": asked.model_dump(mode="json"), "files": asked.only_section.file_digests}
    made["scene"]["reduction"]["file"] = basis.name
    model = replace(ReducedModel.load(EARLIER), provenance=made)
    check_same_scene(model, asked)
    np.savez(basis, V=np.eye(153, 6, k=-4))
    with pytest.raises(InputError, match=r"scene: reduction.file = 'basis.npz': 'content of SHA-256 .*' is allowed"):
        check_same_scene(model, asked)


@pytest.mark.slow
def test_a_load_beyond_what_the_model_was_made_for_is_said(saved: Path) -> None:
    """Faster than the modes that the model knows of: as fast as it was made for nothing is said."""
    file, model, said = ROOT / "workflows" / "evolved_residual.toml", ReducedModel.load(saved), {}
    for frequency in (8.0, 300.0):
        load = f"loads=[{{name='F',on=5.0,signal={{kind='sine',amplitude=1.0,frequency={frequency}}}}}]"
        asked = scene.load(file, [*OURS, "time.end=0.2", "time.step=5e-4", load])
        said[frequency] = " ".join(simulate_saved(System.of(model), asked).summary["warnings"])
    assert "beyond the highest enrichment mode" in said[300.0] and "enrichment" not in said[8.0]


def test_the_folder_of_the_model_is_left_alone(saved: Path, run_command) -> None:
    done = run_command("simulate", str(saved), "--scene", "evolved_residual", "--out", str(saved.parent))
    assert done.returncode == 2 and "other than the model's" in done.stderr
