"""The .mat for Simscape's flexible body: frames first, six coordinates each; its frequencies are the full model's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.linalg
from bricks import bricks, on_pads
from processes import called

from pmr import scene as scenes
from pmr.fem.distributed import times
from pmr.fullmodel.build import build
from pmr.fullmodel.eigensolvers import eigensolver
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.modes import Modes

S, COUNT = 0.85, 8
BOOM = ["mesh.elements=12", "recovery.stress=false"]


@pytest.fixture(scope="module")
def bar(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = on_pads(tmp_path_factory.mktemp("bar"))
    bricks((10, 1, 1), (2.0, 0.2, 0.3)).save(file.with_name("bar.npz"))
    return file


def written(file: Path, s: float, modes: int, folder: Path, capture: tuple, *overrides: str) -> dict[str, np.ndarray]:
    target, options = folder / "body.mat", [part for one in overrides for part in ("--set", one)]
    asked = ["--at", str(s), "--to", "simscape", "--modes", str(modes), "--out", str(target), *options]
    done = called(*capture, "flexible", str(file), *asked)
    assert done.returncode == 0, done.stderr
    assert "frame 1: ground, at 0, 0, 0 m" in done.stdout
    return scipy.io.loadmat(target)


def frequencies(said: dict[str, np.ndarray]) -> np.ndarray:
    """With the ground at rest."""
    return 1.0 / np.sqrt(scipy.linalg.eigh(said["M"][6:, 6:], said["K"][6:, 6:], eigvals_only=True)[::-1][:COUNT])


def modes_of(model: FullModel, s: float) -> Modes:
    return eigensolver(model, "dense").lowest(s, COUNT)


def test_with_all_modes_it_is_the_full_model(bar: Path, tmp_path: Path, monkeypatch, capsys) -> None:
    """Frames and modes are then coordinates of the whole body: with the ground at rest its frequencies and damping."""
    damped = ["damping.mass=0.5", "damping.stiffness=1e-5"]
    full = build(scenes.load(bar, damped)).model
    rigid = int(np.sum(full.row_compliance == 0.0))
    said = written(bar, S, full.size - rigid - 6, tmp_path, (monkeypatch, capsys), *damped)
    expected = modes_of(full, S)
    np.testing.assert_allclose(frequencies(said), expected.omega, rtol=1e-6)
    theta, z = scipy.linalg.eigh(said["M"][6:, 6:], said["K"][6:, 6:])
    z = z[:, ::-1][:, :COUNT] / np.sqrt(theta[::-1][:COUNT])  # of modal mass 1 kg
    found = np.sum(z * (said["C"][6:, 6:] @ z), axis=0)
    np.testing.assert_allclose(found, np.sum(expected.phi * times(full.D, expected.phi), axis=0), rtol=1e-6)


def displaced(point: np.ndarray) -> np.ndarray:
    """Displacement (3, 6) of a point under unit translations and rotations about the origin."""
    return np.hstack([np.eye(3), np.cross(np.eye(3), point).T])


@pytest.mark.slow
@pytest.mark.parametrize("case", ["bar", "boom"])
def test_what_the_block_reads(case: str, bar: Path, tmp_path: Path, monkeypatch, capsys) -> None:
    """Frequencies from above, the nearer the more modes; all frames as one move without force, with the whole mass."""
    file, s, overrides = (bar, S, []) if case == "bar" else (Path("workflows/boom_beam.toml"), 2.0, BOOM)
    scene, capture = scenes.load(file, overrides), (monkeypatch, capsys)
    few, many = (written(file, s, modes, tmp_path, capture, *overrides) for modes in (4, 16))
    P, K, M, C = (many[name] for name in "PKMC")
    assert P.shape == (2, 3) and K.shape == M.shape == C.shape == (28, 28)
    assert [str(cell[0]) for cell in many["frames"].ravel()] == ["ground", "tip"]
    expected = modes_of(build(scene).model, s).omega
    off = [frequencies(one) / expected - 1.0 for one in (few, many)]
    assert np.all(off[1] > -1e-7) and np.all(off[0] > off[1] - 1e-7)
    assert off[1][:4].max() < 1e-4
    rigid = np.vstack([*(np.vstack([displaced(point), np.eye(6)[3:]]) for point in P), np.zeros((16, 6))])
    for A in (K, M, C):
        np.testing.assert_array_equal(A, A.T)
    size = np.sqrt(np.diag(np.abs(rigid).T @ np.abs(K) @ np.abs(rigid)))
    assert np.all(np.abs(rigid.T @ K @ rigid) <= 1e-9 * np.outer(size, size))
    assert np.linalg.eigvalsh(M[6:, 6:])[0] > 0.0  # of the whole zero, where a spring alone joins ground and frame
    inertia, total = rigid.T @ M @ rigid, 7850.0 * 2.0 * 0.2 * 0.3
    if case == "boom":
        box, density = scene.body.box, scene.body.material.density
        total = 2.0 * density * (box.width + box.height) * box.wall * box.length + sum(
            mass.mass for mass in scene.masses
        )
    np.testing.assert_allclose(inertia[:3, :3], total * np.eye(3), rtol=1e-9, atol=1e-9 * total)
    if case == "bar":
        given = bricks((10, 1, 1), (2.0, 0.2, 0.3))
        R = np.vstack([displaced(point) for point in given.points])
        np.testing.assert_allclose(inertia, R.T @ given.M @ R, rtol=1e-9, atol=1e-9 * total)


def test_a_force_at_the_tip_moves_it_as_the_full_model(bar: Path, tmp_path: Path, monkeypatch, capsys) -> None:
    said = written(bar, S, 1, tmp_path, (monkeypatch, capsys))
    found = np.linalg.solve(said["K"][6:, 6:], np.eye(7)[:, 2])[2]
    full = build(scenes.load(bar)).model.gather()
    C, compliance = full.rows.at(S).toarray(), full.rows.compliance
    saddle = np.block([[full.K.toarray(), C.T], [C, -np.diag(compliance)]])
    load = np.concatenate([full.B[:, 0], np.zeros(len(C))])
    assert found == pytest.approx(load @ np.linalg.solve(saddle, load), rel=1e-9)


REFUSED = [
    ("workflows/paper_simple.toml", [], "a body in space is allowed"),
    ("workflows/boom_beam.toml", ["supports=[{on='tip',points='all'}]"], "places that move, each by itself"),
    (
        "workflows/boom_beam.toml",
        ["supports=[]", "free_motions=allowed"],
        "pads and supports that hold the body at s in all directions",
    ),
]


@pytest.mark.parametrize(("file", "overrides", "says"), REFUSED, ids=[says for *_, says in REFUSED])
def test_what_has_no_frames_is_refused(
    file: str, overrides: list[str], says: str, tmp_path: Path, monkeypatch, capsys
) -> None:
    options = [part for one in overrides for part in ("--set", one)]
    asked = ["--at", "2", "--to", "simscape", "--out", str(tmp_path / "body.mat"), *options]
    done = called(monkeypatch, capsys, "flexible", file, *asked)
    assert done.returncode == 2 and says in done.stderr and len(done.stderr.splitlines()) == 1
