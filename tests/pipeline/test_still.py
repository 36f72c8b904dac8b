"""A body that does not slide: a bridge on its supports, a box that is clamped or stands on pads that stay.

How motions begin, by one key for any number of bodies: at rest, or in equilibrium with the loads at t = 0.
How models, systems and results describe themselves in an interactive session.
"""

import runpy
from pathlib import Path

import numpy as np
import pytest

import pmr
from pmr import InputError, RunResult, run
from pmr import scene as scenes
from pmr.export.exudyn_script import write_exudyn_script
from tests.scene.test_dialects import WHOLE, written

EI, MASS, LENGTH, F = 1e9, 1000.0, 20.0, 1000.0

RAMP = 'kind = "smooth_ramp", times = [0.5, 0.7]'

BRIDGE = f"""
title = "Bridge"
body.profile = {{ length = {LENGTH}, bending_stiffness = {EI}, mass_per_length = {MASS} }}
mesh.elements = 20
supports = [{{ kind = "roller" }}, {{ on = "tip", kind = "roller" }}]
loads = [{{ name = "F", on = 10.0, direction = "z", signal = {{ {RAMP}, values = [{-F}, 0] }} }}]
start = "equilibrium"
time = {{ end = 1.0, step = 1e-3 }}
"""

BOX = """
title = "Box"
body = { model = "beam3d", box = { length = 4.0, width = 0.4, height = 0.5, wall = 0.008 } }
mesh.elements = 20
loads = [{ on = "tip", direction = "z", signal = { kind = "smooth_ramp", times = [0, 0.2], values = [0, -1000] } }]
time = { end = 0.4, step = 1e-3 }
"""

PADS = """
supports = [{ directions = ["x"] }]
pads = [
  { name = "a", at = 0.5, faces = { bottom = [0.0], top = [0.0], left = [-0.1, 0.1] } },
  { name = "b", at = 2.5, faces = { bottom = [0.0], top = [0.0], left = [-0.1, 0.1] } },
]
"""


def scene(folder: Path, text: str) -> pmr.scene.Scene:
    (folder / "still.toml").write_text(text)
    return pmr.load_scene(folder / "still.toml")


@pytest.mark.slow
def test_a_bridge_without_anything_that_slides(tmp_path: Path) -> None:
    of_bridge = scene(tmp_path, BRIDGE)
    result = pmr.run(of_bridge).result
    errors = result.summary["errors"]["reduced_vs_full"]
    assert errors["beam"] < 1e-6 and "pad_force" not in errors
    response = result.responses["reduced"]
    middle = response.displacement[0].min()
    assert middle == pytest.approx(-F * LENGTH**3 / (48.0 * EI), rel=1e-9)
    assert np.allclose(response.other("reaction of support z on tip")[:400], -F / 2.0, rtol=1e-6)
    first = (np.pi / LENGTH) ** 2 * np.sqrt(EI / MASS) / (2.0 * np.pi)
    assert result.frequencies.models["reduced"][0, 0] == pytest.approx(first, rel=1e-5)


@pytest.mark.slow
def test_its_saved_model_runs_step_by_step_and_in_a_script(tmp_path: Path) -> None:
    of_bridge = scene(tmp_path, BRIDGE.replace("equilibrium", "rest").replace(f"[{-F}, 0]", f"[0, {-F}]"))
    pmr.reduce(of_bridge).reduced.save(tmp_path / "reduced.npz")
    model = pmr.ReducedModel.load(tmp_path / "reduced.npz")
    response = pmr.simulate(of_bridge, model)
    stepper, signal = pmr.Stepper(model, step=1e-3, s=0.0), of_bridge.loads[0].signal
    y = np.array([stepper.step(0.0, float(signal.value(t))).copy() for t in response.t[1:]])
    size = np.abs(response.displacement).max()
    assert np.abs(y[:, : response.displacement.shape[1]] - response.displacement[1:]).max() < 1e-12 * size
    pytest.importorskip("exudyn")
    script = runpy.run_path(str(write_exudyn_script(tmp_path / "reduced.npz", tmp_path / "bridge.py")))
    assert np.abs(script["simulate"]()[1][1:] - y).max() < 1e-6 * size


@pytest.mark.slow
@pytest.mark.parametrize("held", ['supports = [{ kind = "clamped", points = "all" }]', PADS], ids=["clamped", "pads"])
def test_a_box_without_any_row_that_moves(tmp_path: Path, held: str) -> None:
    errors = pmr.run(scene(tmp_path, BOX + held)).result.summary["errors"]["reduced_vs_full"]
    assert errors["tip"] < 1e-6 and errors["beam"] < 1e-6


def test_what_needs_a_path_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match="slider: a table slider is needed, with the path along which the moving pads slide"
    ):
        scene(tmp_path, BOX + PADS.replace('"b", at', '"b", moving = true, at'))
    with pytest.raises(InputError, match="'free_modes' is allowed for a body that does not slide"):
        scene(tmp_path, BRIDGE + 'reduction.basis = "eigenmodes"')


STILL = "slider.path=2.2"

STATIC = ("start=equilibrium", "gravity={}")


def result(folder: Path, *changes: str) -> RunResult:
    outcome = run(scenes.load(written(folder, False, WHOLE), ["simulation.repeats=1", *changes]))
    assert outcome is not None
    return outcome.result


@pytest.mark.slow
@pytest.mark.parametrize("full", ["march", "petsc"])
def test_a_body_alone_in_equilibrium_stays_where_it_is(tmp_path: Path, full: str) -> None:
    """Under constant loads and on a path that stands still nothing moves, in full order and reduced."""
    found = result(tmp_path, *STATIC, STILL, "time.end=0.05", f"simulation.full={full}")
    statics = found.responses["full"].displacement[0]
    assert np.abs(statics).max() > 1e-4
    for model, response in found.responses.items():
        moved = np.abs(response.displacement - response.displacement[0]).max()
        assert moved < 1e-8 * np.abs(statics).max(), model
    assert found.responses["reduced"].tip[0] == pytest.approx(found.responses["full"].tip[0], rel=1e-6)


@pytest.mark.slow
def test_at_rest_it_begins_undeformed_and_swings_about_that_equilibrium(tmp_path: Path) -> None:
    changes = STILL, "compare.against=[]", "gravity={rise=0.0}"
    still = result(tmp_path, "start=equilibrium", *changes).responses["reduced"].tip[0]
    swinging = result(tmp_path, *changes).responses["reduced"].tip
    # what modes leave out answers the loads at once, and so does a little of the tip
    assert np.abs(swinging[0]) < 0.01 * np.abs(still) and np.abs(swinging).max() > 1.5 * np.abs(still)


@pytest.mark.slow
def test_sections_begin_at_rest_where_that_is_asked_for() -> None:
    hold = [f"section.joint.{end}.0.unilateral=false" for end in ("tail", "mouth")]
    quick = ["section.mesh.elements=12", "time.end=0.02", "simulation.repeats=1", *hold]
    begun = {}
    for start in ("rest", "equilibrium"):
        outcome = run(scenes.load_any("boom_two", [*quick, f"start={start}"]))
        assert outcome is not None
        begun[start] = {name: np.abs(one.displacement[0]).max() for name, one in outcome.result.responses.items()}
    assert set(begun["rest"]) == {"reduced", "full"} and begun["rest"]["full"] == 0.0
    assert min(begun["equilibrium"].values()) > 1e-3 > 100.0 * begun["rest"]["reduced"]


def test_models_and_results_describe_themselves_in_three_lines() -> None:
    """Of arrays a reader sees meaning and number, not thousands of entries."""
    scene = pmr.load_scene("paper_simple", ["time.end=0.01", "compare.against=[]"])
    outcome = pmr.run(scene)
    for described in (outcome.reduced, outcome.system, outcome.result, outcome.result.responses["reduced"]):
        lines = repr(described).splitlines()
        assert len(lines) == 3 and all(len(line) < 160 for line in lines)
        assert lines[0].startswith(type(described).__name__)
