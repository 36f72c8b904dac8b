"""A basis of one's own: vectors from a file, whatever spans their space."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh

from pmr import pipeline as whole
from pmr.compare.simulated import simulate
from pmr.errors import InputError
from pmr.fem.compat import MPI
from pmr.fullmodel.build import full_model
from pmr.reduction.from_scene import build_basis, take_snapshots
from pmr.scene.keys import ALONE

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


def test_the_content_of_the_file_decides_the_scenes_hash(load_scene, tmp_path: Path) -> None:
    hashes = []
    for factor in (1.0, 2.0):
        given = f"reduction={{{saved(tmp_path, factor * np.ones((3, 3)))},coordinates=3}}"
        hashes.append(load_scene("evolved_residual", [*SMALL, given]).hash)
    assert hashes[0] != hashes[1]


REFUSED = {
    "rows": (np.ones((7, 2)), r"V = \[7, 2\]: a row for each of the model's 39 coordinates"),
    "one axis": (np.ones(39), r"V = \[39\]"),
    "not finite": (np.full((39, 3), np.nan), "finite entries are allowed"),
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
    with pytest.raises(InputError, match="reduction.file.*a file is allowed with basis = 'file'"):
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
