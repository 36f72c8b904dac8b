"""Reductions that are kept: found by what they are made of, and by nothing else.

A basis of one's own: vectors from a file, whatever spans their space.
"""

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh

import pmr.pipeline.full_order
import pmr.reduction.bodies
from pmr import InputError, System, run, simulate
from pmr import pipeline as whole
from pmr.errors import NotHeldError
from pmr.fem.compat import MPI
from pmr.fullmodel.build import build, full_model
from pmr.fullmodel.model import FullModel
from pmr.reduction.cache import SystemCache, cache_in, model_digest
from pmr.reduction.from_scene import build_basis, take_snapshots
from pmr.scene.keys import ALONE

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


SMALL = ["mesh.elements=12", "time.end=0.2", "reduction.estimate=false"]


def saved(folder: Path, V: np.ndarray) -> str:
    np.savez(folder / "basis.npz", V=V)
    return f"basis='file',file='{folder / 'basis.npz'}'"


@pytest.mark.mpi
@pytest.mark.parametrize("product", ["euclidean", "mass"])
def test_vectors_are_made_orthonormal_in_their_order(load_scene, tmp_path: Path, product: str) -> None:
    plain = load_scene("evolved_residual", SMALL)
    model = full_model(plain)
    V = np.random.default_rng(2).normal(size=(model.size, 5)) * [1.0, 1e-6, 1e3, 1.0, 1.0]
    V[:, 3] = V[:, 0] + 2.0 * V[:, 1]  # nothing new
    given = f"reduction={{{saved(tmp_path, V)},product='{product}',coordinates=4,flexibility=false}}"
    scene = load_scene("evolved_residual", [*SMALL, given])
    basis = build_basis(scene, model, take_snapshots(scene, model))
    Q = np.concatenate(MPI.COMM_WORLD.allgather(np.array(basis.V.getDenseArray())))
    M = model.gather()
    X = MPI.COMM_WORLD.bcast(None if M is None else M.M.toarray()) if product == "mass" else np.eye(len(Q))
    np.testing.assert_allclose(Q.T @ X @ Q, np.eye(4), atol=1e-12)
    for k, columns in enumerate([[0], [0, 1], [0, 1, 2], [0, 1, 2, 4]], start=1):
        share = np.linalg.lstsq(V[:, columns] / np.linalg.norm(V[:, columns], axis=0), Q[:, :k], rcond=None)
        assert np.sqrt(share[1]).max(initial=0.0) < 1e-9 * np.linalg.norm(Q)


@pytest.mark.slow
def test_free_modes_from_a_file_are_the_model_of_free_modes(load_scene, tmp_path: Path) -> None:
    """Mixed among themselves: what counts is their span."""
    plain = load_scene("evolved_residual", [*SMALL, "reduction.coordinates=6"])
    expected = whole.reduce(plain)
    V = np.array(expected.bodies[ALONE].basis.V.getDenseArray())[:, :6] @ np.random.default_rng(3).normal(size=(6, 6))
    given = f"reduction={{{saved(tmp_path, V)},product='mass',coordinates=6,flexibility=true}}"
    scene = load_scene("evolved_residual", [*SMALL, given])
    found = whole.reduce(scene).reduced
    y, z = (simulate(one, model).displacement for one, model in ((plain, expected.reduced), (scene, found)))
    assert np.abs(y).max() > 1e-4
    np.testing.assert_allclose(z, y, rtol=0.0, atol=1e-8 * np.abs(y).max())
    assert found.provenance["scene"]["reduction"]["file"] == "basis.npz"


def test_the_content_of_a_file_decides_hash_and_stored_system(load_scene, tmp_path: Path) -> None:
    hashes, cache = [], SystemCache(tmp_path, "", MPI.COMM_SELF)

    def refuse() -> System:
        raise NotHeldError("scene", "free_motions", "refused", "it is free", "it can turn")

    for factor in (1.0, 2.0):
        given = f"reduction={{{saved(tmp_path, factor * np.ones((3, 3)))},coordinates=3}}"
        scene = load_scene("evolved_residual", [*SMALL, given])
        hashes.append(scene.hash)
        assert not cache.has_system(scene)
        with pytest.raises(NotHeldError):
            cache.system_of(scene, refuse)
        assert cache.has_system(scene)
    assert hashes[0] != hashes[1]


REFUSED = {
    "rows": (np.ones((7, 2)), r"V = \[7, 2\]: .* a row for each of the model's 39 coordinates"),
    "one axis": (np.ones(39), r"V = \[39\]"),
    "not finite": (np.full((39, 3), np.nan), "finite vectors as columns"),
    "dependent": (np.ones((39, 9)), "coordinates = 4: the vectors and rigid-body modes span 1 dimensions"),
    "text": (np.array([["a"] * 3] * 39), "an npz file with an array V is allowed"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_basis_is_refused(load_scene, tmp_path: Path, name: str) -> None:
    V, says = REFUSED[name]
    given = f"reduction={{{saved(tmp_path, V)},coordinates=4,flexibility=false}}"
    with pytest.raises(InputError, match=says):
        whole.reduce(load_scene("evolved_residual", [*SMALL, given]))


@pytest.mark.parametrize("key", ["reduction.basis=file", "reduction.file=workflows/evolved_residual.toml"])
def test_basis_and_file_go_together(load_scene, key: str) -> None:
    with pytest.raises(InputError, match="reduction.file.*a file goes with basis = 'file'"):
        load_scene("evolved_residual", [key])


@pytest.mark.parametrize("flexibility", ["true", "false"])
def test_vectors_of_any_size_span_what_they_are(load_scene, tmp_path: Path, flexibility: str) -> None:
    """Squares of entries of 1e-200 are zero, of 1e200 infinite."""
    model = full_model(load_scene("evolved_residual", SMALL))
    spans = []
    for size in (1.0, 1e-200, 1e200):
        V = size * np.random.default_rng(2).normal(size=(model.size, 5))
        choice = f"reduction={{{saved(tmp_path, V)},product='mass',coordinates=4,flexibility={flexibility}}}"
        scene = load_scene("evolved_residual", [*SMALL, choice])
        spans.append(np.array(build_basis(scene, model, take_snapshots(scene, model)).V.getDenseArray()))
    np.testing.assert_allclose(spans[1:], [spans[0]] * 2, rtol=1e-9, atol=1e-9 * np.abs(spans[0]).max())


def test_vectors_that_move_rigid_supports_are_refused_with_flexibility(load_scene, tmp_path: Path) -> None:
    """They ended in a ValueError without a key."""
    choice = f"reduction={{{saved(tmp_path, np.random.default_rng(2).normal(size=(39, 6)))},coordinates=6}}"
    scene = load_scene("evolved_residual", [*SMALL, choice])
    with pytest.raises(InputError, match="reduction.basis: vectors that move no rigid support .* support z at 0 m"):
        whole.reduce(scene)


@pytest.mark.slow
def test_forces_of_rows_that_a_basis_does_not_move_are_not_covered(load_scene, tmp_path: Path) -> None:
    """Forces of two models with different rows were compared column by column, which their shapes don't allow."""
    changes = ["mesh.elements=10", "time.end=0.05", "simulation.simulators=['march']", "compare.against=[]"]
    body = full_model(load_scene("boom_beam", changes)).gather()
    assert body is not None
    M, K, C = body.M.toarray(), body.K.toarray(), body.C(1.5).toarray()
    modes = eigh(K + 1e8 * C.T @ C, M, subset_by_index=(0, 19))[1]
    lateral = [k for k, name in enumerate(body.row_names) if name in ("mouth left", "mouth right")]
    V = modes[:, np.abs(C[lateral] @ modes).max(axis=0) < 1e-9 * np.abs(C @ modes).max()]
    V[np.abs(V) < 1e-9 * np.abs(V).max()] = 0.0
    choice = f"reduction={{{saved(tmp_path, V)},product='mass',coordinates=6,flexibility=false}}"
    outcome = whole.run(load_scene("boom_beam", [*changes, choice]))
    assert outcome is not None
    estimate = outcome.result.summary["estimate"]
    assert estimate["pad_force"] > 0.0
    assert any("force of mouth left" in clause for clause in estimate["not_covered"])
