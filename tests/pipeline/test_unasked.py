"""What a run says of its mesh and its structural model without being asked."""

import pickle
from concurrent.futures import BrokenExecutor, Executor, Future
from pathlib import Path

import numpy as np
import pytest

import pmr
from pmr import run
from pmr.compare import other_runs
from pmr.compare.model_part import Motion
from pmr.fem.compat import MPI
from pmr.pipeline import model_errors as pipeline
from pmr.scene.model_ladder import model_comparison

pytest.importorskip("gmsh")
CHANGES = ["compare.against=[]", "time.step=0.01", "time.end=3.0"]


def scene(*changes: str) -> pmr.scene.Scene:
    return pmr.load_scene("boom_beam", [*CHANGES, *changes])


class Ended(Executor):
    """Executor whose process has ended, such as one that was killed."""

    def submit(self, *task) -> Future:
        raise BrokenExecutor


class AtOnce(Executor):
    """Executor that runs a task when it is submitted, and stores the structural model of its scene in `models`.

    Tasks that store stresses are counted and not run.
    """

    def __init__(self) -> None:
        self.models, self.stresses = [], 0

    def submit(self, function, scene_of_task, *arguments) -> Future:
        if function is pipeline._store_stresses:
            self.stresses += 1
            function = str
        else:
            self.models.append(scene_of_task.only_section.body.model)
        done, sent = Future(), pickle.loads(pickle.dumps((scene_of_task, *arguments)))
        done.set_result(function(*sent))
        return done


@pytest.mark.slow
def test_a_run_measures_its_model_and_mesh_last_and_the_next_one_finds_both(tmp_path: Path, monkeypatch) -> None:
    before, reduced, helper, reduce_scene = [], [], AtOnce(), pipeline.reduce_scene

    def count_reductions(one, *more, **options):
        reduced.append(one.only_section.body.model)
        return reduce_scene(one, *more, **options)

    monkeypatch.setattr(pipeline, "reduce_scene", count_reductions)
    result = run(
        scene(), measures=tmp_path, keep=lambda one: before.append(dict(one.result.summary)), helper=helper
    ).result
    assert helper.models == ["shell"] and helper.stresses == 1 and sorted(reduced) == ["beam3d", "beam3d", "shell"]
    first = result.summary["budget"]
    assert "budget" not in before[0] and before[0] == {key: result.summary[key] for key in before[0]}
    (warned,) = [one for one in result.summary["warnings"] if one.startswith("the model is off by up to")]
    assert warned.endswith('set body.walls = "give" to add the compliance of walls under pads')
    assert first["model"]["beside"] == "coarse shell" and 0.1 < first["model"]["beam"] < 0.5
    assert 0.0 < first["mesh"]["beam"] < 1e-3 and first["mesh_reason"] is None
    assert 0.0 < first["mesh"]["frequency"] < 1e-3 and first["mesh_not_covered"] == ["stresses"]
    monkeypatch.setattr(pipeline, "reduce_scene", lambda *_, **__: pytest.fail("what was measured is made again"))
    again = run(scene(), measures=tmp_path, helper=helper).result.summary["budget"]
    assert again["model"]["frequency"] == pytest.approx(first["model"]["frequency"], rel=1e-9)
    # the second run adds the error of the reduction, and motions with other play, on the other mesh and as a shell
    assert helper.models == ["shell", *["beam3d"] * 3, "shell"]


def test_another_process_that_is_idle_simulates_the_full_model() -> None:
    helper = AtOnce()
    alone, *others = (run(scene("compare.against=['full']"), helper=of) for of in (None, helper, Ended()))
    assert helper.models == ["beam3d", "beam3d"] and alone is not None  # and the estimate of the reduction's error
    for other in others:
        found, expected = other.result.responses["full"], alone.result.responses["full"]
        assert np.array_equal(found.displacement, expected.displacement) and np.ptp(expected.displacement) > 0.0
        estimates = [of.result.summary["estimate"]["beam"] for of in (other, alone)]
        assert 0.0 < estimates[0] == pytest.approx(estimates[1], rel=1e-9)


@pytest.mark.parametrize("failed", [None, BrokenExecutor()])
def test_a_motion_of_another_process_is_taken_unless_that_process_failed(failed, monkeypatch) -> None:
    future, failing = Future(), Future()
    future.set_result(motion := object())
    failing.set_result(None) if failed is None else failing.set_exception(failed)
    monkeypatch.setattr(pipeline.Motion, "compute", lambda *_: "computed here")
    monkeypatch.setattr(pipeline.ComparedScene, "system", None)
    taken = [pipeline.ComparedScene(scene(), MPI.COMM_SELF, None, each).motion() for each in (future, failing, None)]
    assert taken == [motion, "computed here", "computed here"]


@pytest.mark.slow
def test_the_motion_of_the_runs_full_model_is_compared_as_that_of_a_reduction_of_its_own() -> None:
    """Both tell the same of the model: a reduction to 20 modes is off by less than a thousandth of the motion."""
    beam = scene("compare.against=['full']", "mesh.elements=20", "reduction.estimate=false")
    outcome = run(beam)
    assert outcome is not None
    result = outcome.result
    of_run = pipeline.RunMotion(
        outcome.system, *(result.responses[name] for name in ("reduced", "full")), result.frequencies
    )
    by_run = pipeline.measure_model(beam, MPI.COMM_WORLD, None, of_run)
    anew = pipeline.measure_model(beam, MPI.COMM_WORLD, None)
    assert 0.1 < by_run["beam"] < 0.5
    for kind in ("beam", "tip", "pad_force", "largest", "frequency"):
        assert by_run[kind] == pytest.approx(anew[kind], abs=2e-3)


@pytest.mark.slow
def test_a_shell_is_compared_with_one_on_cells_twice_as_long(tmp_path: Path) -> None:
    """Their difference is what it is taken to be off by: of first order, as under pads."""
    cells = ["mesh.size=0.15", "mesh.along=0.3", "recovery.stress=false", "reduction.estimate=false"]
    shell = pmr.load_scene("boom_shell", [*CHANGES, *cells])
    coarse = other_runs.motion_only(other_runs.coarser_walls(shell))
    assert (coarse.mesh.size, coarse.mesh.along) == (0.3, 0.6) and coarse.only_section.reduction.estimate is False
    result = pmr.run(shell, measures=tmp_path).result
    summary = result.summary["budget"]
    assert summary["model"]["beside"] is None and summary["mesh_reason"] is None
    moved = [one.responses["reduced"].displacement for one in (result, pmr.run(coarse).result)]
    apart = np.linalg.norm(moved[0] - moved[1]) / np.linalg.norm(moved[0])
    assert summary["mesh"]["beam"] == pytest.approx(apart, rel=0.03) and 0.03 < apart < 0.3


def test_another_process_computes_stresses_of_walls_that_stay_the_same_unless_it_has_ended() -> None:
    helper, framed = AtOnce(), "body.box={length=6.0,width=0.3,height=0.4,wall=0.006,frames=[3.0],frame_depth=0.05}"
    for changes, count in (([framed], 0), (["recovery.stress=false"], 0), ([], 1)):
        future = pipeline.start_stresses(scene(*changes), helper)
        assert helper.stresses == count and (future is not None) == bool(count)
    assert pipeline.start_stresses(scene(), Ended()) is None


def test_walls_that_give_way_are_compared_with_those_of_coarser_cells_and_with_shells_on_their_own() -> None:
    give = scene("body.walls='give'", "mesh.size=0.1", "mesh.along=0.2")
    coarse = other_runs.other_mesh(give).scene
    assert (coarse.mesh.size, coarse.mesh.along, coarse.mesh.elements) == (0.2, 0.4, give.mesh.elements // 2)
    measured = {"beam": 0.25, "tip": None, "frequency": 0.1, "reaction": 0.05}
    found = other_runs.mesh_budget(give, lambda make, called: measured if make() != give else {})
    assert found == {"mesh": {"beam": 0.25, "frequency": 0.1, "reaction": 0.05}, "mesh_reason": None}
    for one, size, called in ((give, 0.1, "shell"), (scene(), 2.0 * scene().mesh.size, "coarse shell")):
        own, shell, name = model_comparison(one)
        assert (shell.mesh.size, shell.only_section.body.model, name) == (size, "shell", called)
        assert own.only_section.reduction == shell.only_section.reduction  # no more than the models differs


@pytest.mark.slow
def test_the_mesh_of_a_beam_has_an_error_at_each_probe() -> None:
    """It is 4/3 of the difference to twice as many elements, over the RMS of the probe or 1 % of the largest stress."""
    probes = "probes=[{name='p',at=[4.0,0.15,0.2]},{name='d',at=[6.0,0.0,0.0],measures=['displacement']}]"
    coarse = scene("mesh.elements=12", "reduction.estimate=false", "time.end=0.5", probes)
    systems = [(each, pmr.reduce(each).system) for each in (coarse, other_runs.finer_beams(coarse))]
    (_, system), (own, finer) = systems[0], (pmr.simulate(*each) for each in systems)
    budget = pipeline.measure_mesh(coarse, system, own, MPI.COMM_WORLD, None)["mesh"]
    sizes = {name: np.sqrt(np.mean(own.other(name) ** 2)) for name in budget["probes"]}
    assert set(sizes) == {"p stress axial", "p stress torsion", *(f"d displacement {axis}" for axis in "xyz")}
    round_off = Motion.compute(coarse, system, own).round_off
    still = {name for name in sizes if np.abs([own.other(name), finer.other(name)]).max() <= round_off[name]}
    assert still == {"p stress torsion", "d displacement y"}  # the load acts along z
    for name, error in budget["probes"].items():
        least = 0.01 * max(size for other, size in sizes.items() if other[0] == name[0])
        apart = np.sqrt(np.mean((own.other(name) - finer.other(name)) ** 2)) / max(sizes[name], least)
        assert error == pytest.approx(0.0 if name in still else 4.0 / 3.0 * apart, rel=1e-6, abs=1e-12)
    assert budget["probe"] == max(budget["probes"].values()) > 1e-5


def test_what_costs_more_has_to_be_asked_for() -> None:
    much = scene("body.walls='give'", "mesh.size=0.015", "mesh.along=0.04")
    with pytest.raises(pmr.InputError, match=r"compare.richer = 'shell' measures it, in some [\d.]+ minutes"):
        model_comparison(much)


def test_elements_longer_than_two_pads_converge_with_the_first_order() -> None:
    """With 5, 10, 20 and 40 elements the tip is off by 2.1, 1.1, 0.30 and 0.05 %; pads are 0.3 m long."""
    for elements, share in ((5, 2.0), (9, 2.0), (11, 4.0 / 3.0), (40, 4.0 / 3.0)):
        assert other_runs.other_mesh(scene(f"mesh.elements={elements}")).share == pytest.approx(share)
    assert other_runs.other_mesh(pmr.load_scene("paper_simple", ["mesh.elements=4"])).share == pytest.approx(4.0 / 3.0)


@pytest.mark.slow
def test_a_python_run_measures_nothing_unasked() -> None:
    assert "budget" not in pmr.run(scene()).result.summary


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ([], ""),
        (["mesh.size=0.2"], "cells are 0.2 m wide under pads of 0.08 m"),
        (["mesh.along=0.5"], "cells are 0.5 m long under pads of 0.3 m"),
    ],
)
def test_cells_that_are_long_beside_pads_are_warned_of(changes: list[str], said: str) -> None:
    found = other_runs.mesh_warnings(pmr.load_scene("boom_shell", changes))
    assert len(found) == bool(said) and said in "".join(found)
    shell = pmr.load_scene("boom_shell", changes)
    budget = other_runs.mesh_budget(shell, lambda make, called: {"beam": 0.1, "frequency": 0.013})["mesh"]
    assert budget.keys() == ({"beam"} if said else {"beam", "frequency"})
    assert other_runs.mesh_warnings(scene()) == []  # walls of these don't give way
