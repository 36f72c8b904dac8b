"""The parameter study: the same figures as single runs, with nothing computed twice."""

from pathlib import Path

import numpy as np
import pytest
from finished import compute
from fuzz import toml
from ways.kinds import HOISTED, PLANE, boom, rings

from pmr import InputError, Response, run, scene
from pmr import scene as scenes
from pmr.files.whole import user_cache_folder
from pmr.results import Energy
from pmr.scene.tomlfiles import Change
from pmr.studies import call
from pmr.studies import tasks as common
from pmr.studies.kinds.scenes import grid_points, motion_figures, run_case
from pmr.studies.study import StudyResults
from pmr.studies.tasks import Plan, scene_arguments, task_key

NAMES = ("base", "fly")
SCENE = Path(__file__).parents[3] / "workflows" / "paper_simple.toml"
SHORT = """
kind = "scenes"
title = "Short"
scenes = ["{scene}"]
[change]
time.end = 0.5
mesh.elements = 20
slider.path = {{ kind = "ramp", times = [0.1, 0.4], values = [1.25, 1.6] }}
compare.against = ["full"]
{rest}
"""


def plan(folder: Path, rest: str) -> Plan:
    file = folder / "study.toml"
    file.write_text(SHORT.format(scene=SCENE, rest=rest))
    (part,) = call.load(file).parts
    return part.plan


def shared(folder: Path, rest: str) -> dict[str, int]:
    """How many tasks of each function the runs share."""
    names = [task.function.__name__ for task in plan(folder, rest).shared]
    return {name: names.count(name) for name in names}


@pytest.mark.slow
def test_runs_share_what_is_equal(tmp_path: Path) -> None:
    once = {"compute_frequencies": 1, "simulate_reference": 1}
    sizes = "[grid]\nreduction.coordinates = [10, 20]\nreduction.product = ['euclidean', 'mass']"
    assert shared(tmp_path, sizes) == once
    assert shared(tmp_path, "[grid]\ntime.rho_inf = [0.5, 0.9]") == once | {"simulate_reference": 2}
    forces = "[grid]\nloads = [[{on = 5.0, signal = 1.0}], [{on = 5.0, signal = 2.0}]]"
    assert shared(tmp_path, forces) == once | {"simulate_reference": 2}
    assert shared(tmp_path, "[grid]\nreduction.modes = [5, 6]") == once
    assert shared(tmp_path, "[grid]\nmesh.elements = [20, 30]") == {name: 2 * n for name, n in once.items()}
    assert shared(tmp_path, "[grid]\ncompare.against = [['full', 'ancf']]") == once | {"simulate_reference": 2}
    later = "[grid]\nslider.path = [{kind = 'constant', amount = 2.0}, {kind = 'constant', amount = 3.0}]"
    assert shared(tmp_path, later) == {"compute_frequencies": 2, "simulate_reference": 2}


def test_who_simulates_is_shared_where_it_matters_only(tmp_path: Path) -> None:
    once = {"compute_frequencies": 1, "simulate_reference": 1}
    assert shared(tmp_path, "[grid]\nsimulation.simulators = [['march'], ['exudyn']]") == once
    assert shared(tmp_path, "[grid]\nsimulation.full = ['march', 'exudyn']") == once | {"simulate_reference": 2}


@pytest.mark.slow
def test_a_scene_may_have_any_name(tmp_path: Path) -> None:
    """Keys of runs are names of files in the results."""
    names = ["my scene", "größe 2", "long" * 40]
    for name in names:
        (tmp_path / f"{name}.toml").write_text(f'extends = "{SCENE}"\n')
    scenes = '.toml", "'.join(names) + ".toml"
    (tmp_path / "study.toml").write_text(SHORT.format(scene=scenes, rest=""))
    results = compute(tmp_path / "results", call.load(tmp_path / "study.toml"))
    assert results.is_complete and [run.key for run in results.runs] == [task_key(name) for name in names]
    assert np.isfinite(results.column("max_displacement")).all()


def test_scenes_of_folders_have_the_folders_names(tmp_path: Path) -> None:
    """As results of ``pmr run s1/scene.toml`` do."""
    for name in ("s1", "s2"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "scene.toml").write_text(f'extends = "{SCENE}"\n')
    (tmp_path / "study.toml").write_text(SHORT.format(scene='s1/scene.toml", "s2/scene.toml', rest=""))
    (part,) = call.load(tmp_path / "study.toml").parts
    assert [task.label for task in part.plan.shared] == ["simulation of the full model", "natural frequencies"]
    assert [(run.key, run.parameters["scene"]) for run in part.plan.runs] == [("s1", "s1"), ("s2", "s2")]


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> StudyResults:
    """Three sizes of basis, with the pin's rows held and dropped."""
    folder = tmp_path_factory.mktemp("study")
    plan(folder, "[grid]\nreduction.coordinates = [4, 10, 20]\nreduction.basis = ['paper', 'eigenmodes']")
    found = compute(folder, call.load(folder / "study.toml"))
    # six runs share a reference and frequencies
    assert found.is_complete and len(list(folder.glob("tasks/*.npz"))) == 6 + 2
    return found


@pytest.mark.slow
def test_a_study_has_the_figures_of_single_runs(results: StudyResults) -> None:
    changes = ["time.end=0.5", "mesh.elements=20", "compare.against=['full']", "reduction.basis=eigenmodes"]
    changes.append("slider.path={kind='ramp',times=[0.1,0.4],values=[1.25,1.6]}")
    outcome = run(scene.load(SCENE, changes))
    assert outcome is not None
    summary = outcome.result.summary
    of_study = next(run for run in results.runs if run.key == "coordinates=20,basis=eigenmodes")
    figures = of_study.figures
    for place in ("tip", "beam"):
        assert figures[f"errors.reduced_vs_full.{place}"] == pytest.approx(
            summary["errors"]["reduced_vs_full"][place], rel=1e-9
        )
    assert figures["max_displacement"] == pytest.approx(summary["max_displacement"], rel=1e-12)
    assert figures["max_error"] == pytest.approx(summary["max_error"], rel=1e-9)
    assert (figures["coordinates.full"], figures["coordinates.reduced"]) == (63, 20)
    assert figures["basis.kappa"] == summary["basis"]["kappa"]
    curves = outcome.result.frequencies
    off = np.abs(curves.models["reduced"] / curves.models["full"] - 1.0).max(axis=0)
    assert figures["frequency_error.1"] == pytest.approx(off[0], rel=1e-4)
    arrays = results.arrays(of_study.key)
    assert np.allclose(arrays["tip"], outcome.result.responses["reduced"].tip, rtol=0.0, atol=1e-12)
    assert np.allclose(arrays["frequencies.full"], curves.models["full"], rtol=1e-9)
    assert set(summary["warnings"]) <= set(of_study.warnings)  # beside them rows say how far the mesh is off


@pytest.mark.slow
def test_six_free_modes_with_flexibility_beat_ten_coordinates(results: StudyResults, tmp_path: Path) -> None:
    choice = "{ basis = 'free_modes', flexibility = true, coordinates = 6 }"
    plan(tmp_path, f"[[cases]]\nname = 'free'\nchange.reduction = {choice}")
    (six,) = compute(tmp_path, call.load(tmp_path / "study.toml")).runs
    (ten,) = [run for run in results.runs if run.key == "coordinates=10,basis=eigenmodes"]
    errors = [run.figures["errors.reduced_vs_full.beam"] for run in (six, ten)]
    assert six.figures["coordinates.reduced"] == 6 and 0.0 < 5.0 * float(errors[0] or 0.0) < float(errors[1] or 0.0)


@pytest.mark.slow
def test_errors_fall_with_the_number_of_coordinates(results: StudyResults) -> None:
    rows, error = results.column("reduction.basis"), results.column("errors.reduced_vs_full.beam")
    for kind in ("paper", "eigenmodes"):
        four, ten, twenty = error[rows == kind]
        assert twenty < 0.1 * ten < 0.1 * four
    useful = error[rows == "paper"] < 0.5  # both are useless with four coordinates
    assert useful.any() and np.all(error[rows == "eigenmodes"][useful] <= error[rows == "paper"][useful])


@pytest.mark.slow
def test_what_too_few_coordinates_lack_is_left_empty(results: StudyResults) -> None:
    held = next(run for run in results.runs if run.key == "coordinates=4,basis=paper")
    assert held.figures["frequency_error.1"] is not None
    assert held.figures["frequency_error.2"] is None and held.status == "done"  # 4 - 3 rows leave one


@pytest.mark.slow
def test_a_row_has_reactions_and_the_stress_of_each_region() -> None:
    coarse = ["mesh.size=0.2", "mesh.along=0.25", "compare.against=[]", "time={end=0.5,step=5e-3}"]
    tilted = ["gravity={direction=[-0.5,0.0,-0.866],rise=0.0}", "damping={mass=5.0}", "recovery.every=0.1"]
    boom = scene.load(SCENE.with_name("boom_shell.toml"), [*coarse, *tilted])
    task = common.frequencies_task(boom)
    needs = {"frequencies": task.function(task.arguments, {})}
    found = run_case(common.scene_arguments(boom), needs).record
    regions = {name.split(".")[1] for name in found if name.startswith("stress.")}
    assert regions == {"bottom", "left", "right", "top"}
    assert found["stress.top.z"] == pytest.approx(0.196, abs=0.01) and float(found["stress.top.max"] or 0.0) > 1e6
    # along the axis nothing but the cylinder holds, and its motion is that of a rigid body
    assert float(found["reactions.cylinder.min"] or 0.0) < -3e3


@pytest.mark.slow
def test_booms_of_sections_are_cases_too(tmp_path: Path) -> None:
    """With residual flexibility and without it, the same figures in the table as of one body, and more."""
    file, boom = tmp_path / "study.toml", SCENE.with_name("boom_two.toml")
    file.write_text(
        f"""
kind = "scenes"
title = "Sections"
scenes = ["{boom}"]
[change]
time.end = 0.1
recovery.every = 0.01
section.body.material.yield_stress = 355e6
section.mesh.elements = 10
section.joint.tail.0.unilateral = false
section.joint.mouth.0.unilateral = false
[grid]
section.reduction.flexibility = [true, false]
"""
    )
    with_flexibility, without = (run.figures for run in compute(tmp_path / "out", call.load(file)).runs)
    assert with_flexibility["errors.reduced_vs_full.beam"] < 1e-3 < without["errors.reduced_vs_full.beam"]
    assert without["coordinates.reduced"] == 9
    assert with_flexibility["coordinates.reduced"] == 9 + 2  # modes of the fly's cylinder
    assert with_flexibility["largest_force"] > 0.0 and "cylinders.cylinder of fly.max" in without
    for figures in (with_flexibility, without):
        assert figures["utilisation"] == max(figures[f"stress.{name}: whole body.max"] for name in NAMES) / 355e6
        assert figures["mass"] == sum(figures[f"mass.{name}"] for name in NAMES) > 0.0
        assert figures["reactions.base: clamp z.min"] < -1e3 < 1e3 < figures["moments.base: clamp ry.max"]
        assert figures["beam_moments.base: bending moment y.max"] == pytest.approx(
            figures["moments.base: clamp ry.max"], rel=0.01
        )
        assert figures["forces.fly tail bottom.max"] > 0.0 and figures["frequencies.s_middle.1"] > 0.0


def test_all_combinations_the_last_list_fastest() -> None:
    found = list(grid_points({"reduction": {"modes": [4, 6], "product": ["mass"]}, "time": {"rho_inf": [0.5, 0.9]}}))
    assert [point.words for point in found[:2]] == [
        ("modes=4", "product=mass", "rho_inf=0.5"),
        ("modes=4", "product=mass", "rho_inf=0.9"),
    ]
    assert found[3].parameters == {"reduction.modes": 6, "reduction.product": "mass", "time.rho_inf": 0.9}
    assert found[3].changes[0] == Change({"reduction": {"modes": 6}}, "grid")


def test_no_grid_is_one_point_without_changes() -> None:
    (point,) = grid_points({})
    assert (point.changes, point.words, point.parameters) == ((), (), {})


def test_names_are_as_long_as_they_must_be() -> None:
    grid = {"mesh": {"elements": [1]}, "compare": {"ancf_elements": [1]}, "load": {"at": [1]}, "support": {"at": [2]}}
    (point,) = grid_points(grid)
    assert point.words == ("elements=1", "ancf_elements=1", "load.at=1", "support.at=2")


def test_a_value_that_fits_no_file_name_goes_by_its_number() -> None:
    paths = [{"kind": "constant", "amount": 2.0}, "a/b", [1.0, 2.0]]
    found = list(grid_points({"slider": {"path": [{"kind": "ramp"}, *paths[1:]]}}))
    assert next(grid_points({"body": {"axial": [True]}})).words == ("axial=true",)
    assert [point.words for point in found] == [("path=no1",), ("path=no2",), ("path=no3",)]
    assert (
        found[0].parameters == {"slider.path": '{"kind": "ramp"}'}
        and found[2].parameters["slider.path"] == "[1.0, 2.0]"
    )


@pytest.mark.parametrize("value", [3, "text", []])
def test_anything_but_a_list_with_values_is_refused(value: object) -> None:
    with pytest.raises(InputError, match=r"grid\.reduction\.modes.*a list of values"):
        list(grid_points({"reduction": {"modes": value}}))


def test_rows_hold_forces_frequencies_and_probes_with_times_and_places() -> None:
    scene = scenes.load("boom_beam", ["slider.path={kind='ramp',times=[0.0,1.0],values=[1.5,2.5]}"])
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
    luffs = motion_figures(scene, response, np.full(3, 2.0), frequencies[[2, 0, 1]])  # the softest one is in the middle
    assert [luffs[f"frequencies.{at}.1"] for at in ("s_min", "s_middle", "s_max")] == [1.0, 1.0, 1.0]
    assert motion_figures(scene, response, s, frequencies[:, :0]).keys() < found.keys()
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
    assert any("holds both ways and pulls" in one for one in row.warnings)
