"""A body of given matrices goes the whole way without FEniCSx, and without PETSc, and ends where it does with them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from bricks import bricks, on_pads
from processes import FENICSX, PETSC, UNDRAWN, without

from pmr import pipeline as whole
from pmr import scene as scenes
from pmr.errors import InputError
from pmr.files.matrices import from_matrices


@pytest.fixture(scope="module")
def scene_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bar")
    return on_pads(folder)


@pytest.mark.slow
@pytest.mark.parametrize("missing", [FENICSX, (*FENICSX, *PETSC)], ids=["fenicsx", "petsc"])
def test_the_whole_way_without(missing: tuple[str, ...], scene_file: Path, tmp_path: Path) -> None:
    """By sparse factors; the full model too."""
    solver = "reduction.solver=slepc"
    done = without(missing, "run", str(scene_file), "--set", solver, "--out", str(tmp_path), code=UNDRAWN)
    assert done.returncode == 0, done.stderr
    outcome = whole.run(scenes.load(scene_file, [solver]))
    assert outcome is not None
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert "dolfinx" not in summary["versions"] and ("PETSc" in summary["versions"]) is (missing == FENICSX)
    errors = summary["errors"]["reduced_vs_full"]
    assert max(errors["tip"], errors["beam"]) < 1e-3
    with np.load(tmp_path / "trajectories.npz") as found:
        for name in ("reduced", "full"):
            expected = outcome.result.responses[name].displacement
            atol = (1e-12 if missing == FENICSX else 1e-9) * np.abs(expected).max()
            np.testing.assert_allclose(found[f"{name}.displacement"], expected, rtol=0.0, atol=atol)


@pytest.mark.slow
def test_a_model_of_forms_is_refused_in_one_line() -> None:
    done = without(FENICSX, "run", "paper_simple")
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1
    assert "FEniCSx makes models from forms, all but matrices" in done.stderr


@pytest.mark.slow
def test_several_processes_are_refused_without_mpi(scene_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PMI_SIZE", "2")
    done = without((*FENICSX, *PETSC), "run", str(scene_file))
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1
    assert "mpi4py: with petsc4py and slepc4py it is needed for more than one process" in done.stderr


def test_matrices_without_a_map_are_node_by_node() -> None:
    given = bricks((2, 1, 1), (0.4, 0.1, 0.1))
    again = from_matrices(given.M.toarray(), given.K.toarray(), given.points, {"tip": [3]})
    np.testing.assert_array_equal(again.node, given.node)
    np.testing.assert_array_equal(again.direction, given.direction)
    assert given.M.sum() == pytest.approx(3 * 7850.0 * 0.4 * 0.1 * 0.1, rel=1e-12)
    mask = given.points[:, 0] > 0.3
    masked = from_matrices(given.M, given.K, given.points, {"tip": mask, "twice": [3.0, 3.0, 1.0]})
    np.testing.assert_array_equal(masked.groups["tip"], np.flatnonzero(mask))
    np.testing.assert_array_equal(masked.groups["twice"], [1, 3])  # every node counts alike
    for arguments, says in (
        ({"points": given.points[1:]}, "three or six times the 11 nodes"),
        ({"node": given.node}, "together"),
        ({"groups": {"tip": [12]}}, "groups.tip"),
        ({"groups": {"tip": [0.0, 3.7]}}, "groups.tip: a list of whole numbers is allowed"),
        ({"groups": {"tip": [True, False]}}, "groups.tip: a mask of 12 truth values is allowed"),
        ({"groups": {"tip": ["a"]}}, "groups.tip: "),
        ({"groups": {"tip": [[0, 1], [2, 3]]}}, "groups.tip: a list of whole numbers"),
        ({"groups": {"tip": [np.nan]}}, "groups.tip: a list of whole numbers"),
        ({"node": given.node + 0.5, "direction": given.direction}, "node: a list of whole numbers"),
        ({"K": given.K * 1j}, "K: real numbers are allowed"),
        ({"points": [[0.0, 1.0, 2.0], [0.0]]}, "points: "),
    ):
        with pytest.raises(InputError, match=says):
            from_matrices(**{"M": given.M, "K": given.K, "points": given.points, **arguments})
