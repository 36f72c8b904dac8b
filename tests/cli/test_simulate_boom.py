"""`pmr simulate` of a saved boom: what `pmr run` finds, without FEniCSx, and none but the boom it was made from."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import plain_machines
import pytest
from processes import FENICSX, PETSC, without

import pmr
from pmr import InputError, System
from pmr.compare.simulated import check_scene_fits
from pmr.compare.summary import EARLIER, simulate_saved
from pmr.system.assembly import Assembly

pytestmark = pytest.mark.slow  # a boom is run

SHORT = ["compare.against=[]", "section.mesh.elements=8", "time.end=0.1", "simulation.repeats=1"]
#: Another way out, another load, another step.
OTHER = [
    "sections.fly.joint.extension={kind='smooth_ramp',times=[0.0,0.1],values=[1.5,1.8]}",
    "sections.fly.loads.tip force.signal={kind='sine',amplitude=500.0,frequency=5.0}",
    "time.step=1e-3",
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With the system of a boom, as a run leaves it."""
    outcome = pmr.run(pmr.load_scene("boom_two", SHORT))
    assert outcome is not None
    found = tmp_path_factory.mktemp("boom")
    outcome.result.save(found)
    outcome.save(found)
    return found


@pytest.fixture(scope="module")
def system(folder: Path) -> System:
    return System.load(folder / "system.npz")


def sets(overrides: list[str]) -> list[str]:
    return [part for one in overrides for part in ("--set", one)]


def test_it_finds_what_the_run_found(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    asked = ["--scene", "boom_two", "--out", str(out), *sets(SHORT)]
    done = without((*FENICSX, *PETSC, "exudyn"), "simulate", str(folder / "system.npz"), *asked)
    assert done.returncode == 0, done.stderr
    with np.load(out / "trajectories.npz") as found, np.load(folder / "trajectories.npz") as run:
        for key in ("reduced.displacement", "reduced.slider_force"):
            within = 1e-12 * np.abs(run[key]).max()
            np.testing.assert_allclose(found[key], run[key], rtol=0.0, atol=within)
    one, other = (json.loads((place / "summary.json").read_text()) for place in (out, folder))
    for key in ("max_displacement", "pads", "cylinders", "reactions", "scene_hash", "title"):
        assert one[key] == other[key]
    assert one["model"]["scene_hash"] == other["scene_hash"]
    same_estimates(one, other)


def same_estimates(one: dict[str, Any], other: dict[str, Any]) -> None:
    """Of a saved boom and of its run, of sections too: there is one, and it is the same."""
    assert one["estimate"]["beam"] > 0.0 and "seconds" in one["estimate"]
    of_sections = [[section["estimate"] for section in summary["sections"]] for summary in (one, other)]
    assert of_sections[0] == pytest.approx(of_sections[1], rel=1e-10)
    assert set(one["estimate"]) == set(other["estimate"])
    for key, value in other["estimate"].items():
        if key != "seconds":
            number = isinstance(value, float)
            assert one["estimate"][key] == (pytest.approx(value, rel=1e-10) if number else value)


def test_errors_with_second_order_are_estimated_too() -> None:
    """By other models of the sections, whose terms the scene makes."""
    quick = ["section.mesh.elements=4", "compare.against=[]", "time.end=0.02", "time.step=1e-3", "simulation.repeats=1"]
    # long pads have few stations on their paths, and so few loads to answer
    quick += [f"section.joint.{ring}.0.{key}" for ring in ("tail", "mouth") for key in ("length=0.9", "at=0.45")]
    scene = pmr.load_scene(plain_machines.CRANE, quick)
    outcome = pmr.run(scene)
    assert outcome is not None
    found = simulate_saved(replace(outcome.system, terms_of=None), scene)
    same_estimates(found.summary, outcome.result.summary)


def test_of_a_file_of_an_earlier_version_errors_are_not_estimated(folder: Path, tmp_path: Path) -> None:
    with np.load(folder / "system.npz") as data:
        arrays = {name: array for name, array in data.items() if not name.startswith("on_modes.")}
    header = json.loads(str(arrays["header"]))
    del header["on_modes"]
    arrays["header"] = np.array(json.dumps(header | {"version": 2}))
    np.savez(tmp_path / "system.npz", **arrays)
    scene = pmr.load_scene("boom_two", SHORT)
    found = simulate_saved(System.load(tmp_path / "system.npz"), scene).summary["estimate"]
    assert found["beam"] is None and found["reason"] == EARLIER


def test_under_another_scene_it_is_the_run_of_that_scene(system: System) -> None:
    """The run makes sections of its own, on another stretch."""
    scene = pmr.load_scene("boom_two", [*SHORT, *OTHER])
    found, outcome = pmr.simulate(scene, system), pmr.run(scene)
    assert outcome is not None
    expected = outcome.result.responses["reduced"]
    for key in ("displacement", "slider_force"):
        size = np.abs(getattr(expected, key)).max()
        np.testing.assert_allclose(getattr(found, key), getattr(expected, key), rtol=0.0, atol=1e-10 * size)


#: What is in the bodies and the contacts for good.
BAKED = {
    "sections.fly.masses.payload.mass=500": r"sections\[1\].masses\[0\].mass = 500.0: 250.0 is allowed",
    "sections.fly.body.material.young=70e9": r"sections\[1\].body.material.young = 70000000000.0",
    "sections.base.body.box.wall=0.01": r"sections\[0\].body.box.wall = 0.01",
    "sections.fly.joint.tail.0.stiffness=1e7": r"sections\[1\].joint.tail\[0\].stiffness = 10000000.0",
    "sections.fly.joint.mouth.0.unilateral=false": r"sections\[1\].joint.mouth\[0\].unilateral = False",
    "sections.fly.joint.mouth.0.at=0.2": r"sections\[1\].joint.mouth\[0\].at = 0.2",
    "sections.fly.joint.cylinder.stiffness=1e7": r"sections\[1\].joint.cylinder.stiffness = 10000000.0",
    "sections.fly.joint.rigid_overlap=true": r"sections\[1\].joint.rigid_overlap = True",
    "sections.fly.reduction.coordinates=7": r"sections\[1\].reduction.coordinates = 7",
    "sections.fly.loads=[]": "sections.fly.loads = .*the inputs of its model are allowed: tip force, gravity",
    "sections.fly.loads.tip force.direction=x": r"sections\[1\].loads\[0\].direction = 'x'",
    "gravity.inclination=30": r"gravity.direction = .*: \[0.0, 0.0, -1.0\] is allowed",
    "damping.ratio=0.02": "damping.mass",
}
#: What is in the contacts and the terms of a boom in a frame.
HINGES = {
    "frame.cylinder.foot=[0.7, -1.2]": "frame.cylinder.foot",
    "frame.cylinder.lug=[2.0, -0.3]": "frame.cylinder.lug",
}
FREE = ["title=x", "time.step=1e-3", "gravity.rise=0.1", *OTHER[:2]]


def test_what_is_baked_into_a_saved_boom_is_refused_where_a_scene_says_something_else(system: System) -> None:
    check_scene_fits(pmr.load_scene("boom_two", [*SHORT, *FREE]), system)
    for change, says in BAKED.items():
        with pytest.raises(InputError, match=f"scene: {says}"):
            pmr.simulate(pmr.load_scene("boom_two", [*SHORT, change]), system)


def test_a_system_without_second_order_is_refused_to_a_scene_that_asks_for_it() -> None:
    quick = ["section.mesh.elements=8", "compare.against=[]", "time.end=0.01", "time.step=1e-3"]
    scene = pmr.load_scene(plain_machines.CRANE, [*quick, "frame.second_order=false"])
    system = pmr.reduce(scene).system
    check_scene_fits(scene, system)
    with pytest.raises(InputError, match="frame.second_order") as refused:
        check_scene_fits(pmr.load_scene(plain_machines.CRANE, [*quick, "frame.second_order=true"]), system)
    assert refused.value.allowed == "false is allowed: the system was reduced so"
    with pytest.raises(InputError, match="scene: frame.pivot = .* is allowed, as in the model"):
        moved = "frame.pivot=[0.5, 0.0, 0.0]"
        check_scene_fits(pmr.load_scene(plain_machines.CRANE, [*quick, "frame.second_order=false", moved]), system)


@pytest.mark.slow
def test_hinges_of_a_cylinder_that_holds_the_boom_are_those_of_the_model() -> None:
    quick = ["section.body.walls='rigid'", "section.mesh.elements=8", "compare.against=[]", "time.end=0.1"]
    quick += ["frame.second_order=false"]
    system = pmr.reduce(pmr.load_scene("crane", quick)).system
    for change, key in HINGES.items():
        with pytest.raises(InputError, match=f"scene: {key} = .* is allowed, as in the model"):
            check_scene_fits(pmr.load_scene("crane", [*quick, change]), system)


def test_hinges_of_a_cylinder_that_holds_nothing_are_those_of_the_scene() -> None:
    """Supports hold this base: the system does not depend on the cylinder, whose force follows from its hinges."""
    quick = ["compare.against=[]", "time.end=0.1", "frame.second_order=false"]
    machine = plain_machines.OUTRIGGERS
    system = pmr.reduce(pmr.load_scene(machine, quick)).system
    moved = pmr.load_scene(machine, [*quick, "frame.cylinder.foot=[0.7,-1.3]"])
    found, expected = pmr.simulate(moved, system), pmr.simulate(moved, pmr.reduce(moved).system)
    force = "reaction of pivot cylinder"
    np.testing.assert_allclose(found.other(force), expected.other(force), rtol=1e-12)
    frame = moved.frame.model_copy(update={"cylinder": None})
    with pytest.raises(InputError, match="scene: frame.cylinder: the model has one"):
        check_scene_fits(moved.model_copy(update={"frame": frame}), system)


def test_another_boom_or_a_body_alone_is_refused(system: System, folder: Path) -> None:
    with pytest.raises(InputError, match=r"sections = \['base', 'middle', 'fly'\]: the sections of the system "):
        pmr.simulate(pmr.load_scene("boom_three"), system)
    with pytest.raises(InputError, match=r"sections = \[\]: the sections of the system are allowed: base, fly"):
        pmr.simulate(pmr.load_scene("boom_beam"), system)
    alone = System.load(Path(__file__).parents[1] / "files" / "earlier" / "reduced.npz")
    with pytest.raises(InputError, match="a scene of one body is allowed"):
        pmr.simulate(pmr.load_scene("boom_two"), alone)


def test_an_extension_beyond_the_systems_rows_is_refused(folder: Path, tmp_path: Path, run_command) -> None:
    """Further in than the one that it was made from; in one line, with file, section, time."""
    further_in = "sections.fly.joint.extension={kind='ramp',times=[0.0,0.1],values=[0.7,0.5]}"
    asked = ("--scene", "boom_two", *sets([*SHORT, further_in]), "--out", str(tmp_path / "out"))
    done = run_command("simulate", str(folder / "system.npz"), *asked)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1
    assert "boom_two.toml: sections.fly.joint = 0.59" in done.stderr
    assert "0.6 to 5.7 m is allowed; left at t = 0.05" in done.stderr
    assert not (tmp_path / "out" / "summary.json").exists()


def test_models_that_know_no_scene_are_simulated_as_they_are(system: System) -> None:
    """A system that was put together in Python: only sections and loads have to be those of the scene."""
    bodies = {name: replace(body, provenance={}) for name, body in system.bodies.items()}
    scene = pmr.load_scene("boom_two", [*SHORT, "sections.fly.joint.tail.0.stiffness=1e7"])
    found = pmr.simulate(scene, System(bodies, system.contacts))
    expected = pmr.simulate(pmr.load_scene("boom_two", SHORT), system)
    np.testing.assert_array_equal(found.displacement, expected.displacement)


def test_info_says_what_a_saved_boom_is(folder: Path, system: System, run_command) -> None:
    """Bodies, contacts, paths with their ranges, and frequencies where the scene's paths end."""
    done = run_command("info", str(folder / "system.npz"))
    said = " ".join(done.stdout.split())
    assert done.returncode == 0 and "2 bodies, 11 coordinates" in said and "body fly 8 coordinates" in said
    assert "fly from 0.6 to 5.7 m" in said and "fly tail bottom (only pushes)" in said
    assert "cylinder of fly (holds both ways)" in said and "fly.tip force in N" in said
    hertz = Assembly(system).frequencies(system.side_coordinates({"fly": 0.6}), 4)
    assert f"frequencies, fly at 0.6 m {', '.join(f'{f:.4g}' for f in hertz)} Hz" in said
    scene = " ".join(run_command("info", "boom_three").stdout.split())
    assert "middle body box width 260 mm, height 360 mm" in scene and "values (0.6, 4.5, 0.6) m" in scene
