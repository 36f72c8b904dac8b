"""Reductions that are kept: found by what they are made of, and by nothing else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pmr.pipeline.full_order
import pmr.reduction.bodies
from pmr.errors import InputError, NotHeldError
from pmr.fullmodel.build import build
from pmr.fullmodel.model import FullModel
from pmr.pipeline import run
from pmr.reduction.cache import cache_in, model_digest
from pmr.system.system import System

SHORT = ["time.end=0.02", "compare.against=[]"]


@pytest.fixture
def computed(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What is computed: a name for each call of what is kept."""
    calls: list[str] = []
    for place, name in ((pmr.reduction.bodies, "reduce_body"), (pmr.pipeline.full_order, "lowest_frequencies")):
        plain = getattr(place, name)

        def counted(*arguments: object, name: str = name, plain=plain) -> object:
            calls.append(name)
            return plain(*arguments)

        monkeypatch.setattr(place, name, counted)
    return calls


def model(load_scene, *overrides: str) -> FullModel:
    return build(load_scene("evolved_residual", [*SHORT, *overrides])).model


def loads(signal: str) -> str:
    return f"loads=[{{on=5.0,signal={signal}}}]"


@pytest.mark.slow
@pytest.mark.parametrize("basis", ["free_modes", "eigenmodes"])
def test_another_signal_computes_nothing_again(load_scene, tmp_path: Path, computed: list[str], basis: str) -> None:
    choice = [] if basis == "free_modes" else ["reduction.basis=eigenmodes", "reduction.flexibility=false"]
    first, again, other = (
        run(load_scene("evolved_residual", [*SHORT, *choice, loads(signal)]), cache=tmp_path)
        for signal in ("-50.0", "-50.0", "20.0")
    )
    told_by_others = basis != "free_modes"  # whose error takes a second reduction
    assert computed == ["reduce_body"] * (1 + told_by_others) + ["lowest_frequencies"]
    assert first and again and other
    for name in ("M", "D", "K", "B", "outputs"):
        assert np.array_equal(getattr(first.reduced, name), getattr(other.reduced, name)), name
    assert np.array_equal(first.result.frequencies.models["full"], other.result.frequencies.models["full"])
    same, less = (one.result.responses["reduced"].displacement for one in (again, other))
    assert np.array_equal(first.result.responses["reduced"].displacement, same)
    assert less == pytest.approx(-0.4 * same, abs=1e-9 * np.abs(same).max())
    assert other.reduced.provenance["scene_hash"] == other.result.scene.hash != first.result.scene.hash


@pytest.mark.slow
@pytest.mark.parametrize(
    "change",
    ["reduction.coordinates=7", "mesh.elements=21", loads("-50.0").replace("5.0,", "4.0,"), "damping.mass=1.0"],
)
def test_what_decides_is_noticed(load_scene, tmp_path: Path, computed: list[str], change: str) -> None:
    run(load_scene("evolved_residual", [*SHORT, "mesh.elements=20", loads("-50.0")]), cache=tmp_path)
    run(load_scene("evolved_residual", [*SHORT, "mesh.elements=20", loads("-50.0"), change]), cache=tmp_path)
    assert computed.count("reduce_body") == 2


@pytest.mark.slow
def test_damaged_files_are_made_again(load_scene, tmp_path: Path, computed: list[str]) -> None:
    scene = load_scene("evolved_residual", [*SHORT, "mesh.elements=20"])
    first = run(scene, cache=tmp_path)
    for file in tmp_path.iterdir():
        file.write_bytes(file.read_bytes()[:-200])
    again = run(scene, cache=tmp_path)
    assert computed == ["reduce_body", "lowest_frequencies"] * 2
    assert first and again and np.array_equal(first.reduced.K, again.reduced.K)


@pytest.mark.mpi
def test_the_content_is_the_same_on_all_ranks_and_changes_with_the_model(load_scene) -> None:
    one, same, other = (model(load_scene, *more) for more in ([], ["title=Other"], ["damping.mass=0.7"]))
    found = [model_digest(each) for each in (one, same, other)]
    assert found[0] == found[1] != found[2]
    assert len(set(one.comm.allgather(found[0]))) == 1


def test_that_a_body_is_free_to_move_is_found_once_for_each_way(load_scene, tmp_path: Path) -> None:
    """Which takes its full model; a refusal that a package mends is not kept."""
    scene, made = load_scene("evolved_residual", SHORT), list[str]()
    cache = cache_in(tmp_path, build(scene).model)

    def refused(kind: type[InputError], *short: str) -> System:
        made.append(kind.__name__)
        raise kind("scene", "free_motions", scene.free_motions, "it is free", *short)

    longer = scene.model_copy(update={"time": scene.time.model_copy(update={"end": 0.04})})
    for one, kind in ((longer, InputError), *[(one, NotHeldError) for one in (scene, scene, longer, longer)]):
        short = ["it can turn"] if kind is NotHeldError else []
        with pytest.raises(kind, match=r"^scene: free_motions = 'refused': it is free$") as error:
            cache.system_of(one, lambda kind=kind, short=short: refused(kind, *short))
        assert not short or error.value.short == "it can turn"
    assert made == ["InputError", "NotHeldError", "NotHeldError"]


def test_a_folder_that_cannot_be_is_refused(load_scene, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="--cache"):
        cache_in(tmp_path / "file" / "folder", model(load_scene))


@pytest.mark.slow
def test_the_finer_mesh_is_reduced_once_for_any_tolerance(load_scene, tmp_path: Path, computed: list[str]) -> None:
    load = "{{kind='smooth_ramp',times=[0.0,0.2],values=[0.0,{}]}}"
    ordered = [*SHORT, "time.end=0.3", "mesh.elements=20", "simulation.simulators=['march']"]
    rough, fine = (
        [*ordered, f"accuracy.tolerance={tolerance}", loads(load.format(force))]
        for tolerance, force in ((0.1, -50.0), (0.003, 20.0))
    )
    first, other = (run(load_scene("evolved_residual", more), cache=tmp_path) for more in (rough, fine))
    assert first and other and computed.count("reduce_body") == 2
    plain = run(load_scene("evolved_residual", fine))
    assert plain and 6 >= other.reduced.size > first.reduced.size
    for kind, share in plain.result.summary["budget"]["mesh"].items():
        assert other.result.summary["budget"]["mesh"][kind] == pytest.approx(share, rel=1e-6)


@pytest.mark.slow
def test_a_search_has_its_modes_beside_a_reduction_without(load_scene, tmp_path: Path) -> None:
    chosen = [*SHORT, "mesh.elements=20", "reduction.coordinates=6"]
    run(load_scene("evolved_residual", chosen), cache=tmp_path)
    searched = load_scene("evolved_residual", [*chosen, "budget.coordinates=12", "budget.mesh=false"])
    found = run(searched, cache=tmp_path)
    assert found and found.reduced.size == 12
