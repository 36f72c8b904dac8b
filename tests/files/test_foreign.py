"""Matrices of other programs: every kind of file says the same, and what is unsound is refused in one line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from processes import called

from pmr.errors import InputError
from pmr.files.foreign import ForeignFiles, read_foreign
from pmr.files.matrices import GivenMatrices

NUMBERS = [7, 3, 12, 5]  # of the nodes, as another program counts them


def given() -> GivenMatrices:
    """Four nodes of a plate; the first one stands still along z."""
    rng = np.random.default_rng(4)
    pairs = [(k, d) for k in range(4) for d in range(3) if (k, d) != (0, 2)]
    X, Y = rng.normal(size=(2, len(pairs), len(pairs)))
    node, direction = np.array(pairs).T
    points = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 0.0], [0.0, 1.0, 0.125]])
    groups = {"tail": np.array([0, 3]), "tip": np.array([1, 2])}
    return GivenMatrices(sp.csr_matrix(X @ X.T), sp.csr_matrix(Y @ Y.T), points, node, direction, groups)


def triangle(path: Path, A: sp.csr_matrix) -> Path:
    upper = sp.triu(A).tocoo()
    lines = zip(upper.row + 1, upper.col + 1, upper.data, strict=True)
    path.write_text("".join(f"{i} {j} {value:.17e}\n" for i, j, value in lines))
    return path


def as_calculix(folder: Path) -> ForeignFiles:
    one = given()
    dofs, nodes = folder / "job.dof", folder / "job.inp"
    pairs = zip(one.node, one.direction, strict=True)
    dofs.write_text("".join(f"{NUMBERS[k]}.{d + 1}\n" for k, d in pairs))
    points = "".join(f"{n}, {x!r}, {y!r}, {z!r}\n" for n, (x, y, z) in zip(NUMBERS, one.points.tolist(), strict=True))
    sets = "*NSET, NSET=TAIL\n7,\n5,\n*nset, nset=tip, generate\n3, 12, 9\n*NSET, NSET=Ends\nTail, tip\n"
    nodes.write_text(f"** a comment\n*NODE, NSET=NALL\n{points}{sets}*STEP\n")
    return ForeignFiles(triangle(folder / "job.sti", one.K), triangle(folder / "job.mas", one.M), dofs, nodes)


def as_csv(folder: Path) -> ForeignFiles:
    one, files = given(), as_calculix(folder)
    dofs, nodes = folder / "dofs.csv", folder / "nodes.csv"
    pairs = zip(one.node, one.direction, strict=True)
    dofs.write_text("node,direction\n" + "".join(f"{NUMBERS[k]},{d + 1}\n" for k, d in pairs))
    rows = zip(NUMBERS, one.points.tolist(), ("tail", "tip", "tip", "tail"), strict=True)
    nodes.write_text("node,x,y,z,groups\n" + "".join(f"{n},{x!r},{y!r},{z!r},{name}\n" for n, (x, y, z), name in rows))
    return replace(files, dofs=dofs, nodes=nodes)


def as_matrix_market(folder: Path) -> ForeignFiles:
    one, files = given(), as_calculix(folder)
    for name, A in (("K", one.K), ("M", one.M)):
        scipy.io.mmwrite(folder / f"{name}.mtx", A.tocoo(), symmetry="symmetric", precision=17)
    return replace(files, stiffness=folder / "K.mtx", mass=folder / "M.mtx")


def as_scipy(folder: Path) -> ForeignFiles:
    one, files = given(), as_calculix(folder)
    sp.save_npz(folder / "K.npz", one.K)
    sp.save_npz(folder / "M.npz", sp.triu(one.M).tocsr())
    return replace(files, stiffness=folder / "K.npz", mass=folder / "M.npz")


def as_harwell_boeing(folder: Path) -> ForeignFiles:
    one, files = given(), as_calculix(folder)
    for name, A in (("K", one.K), ("M", one.M)):
        scipy.io.hb_write(folder / f"{name}.rb", A.tocsc())
    return replace(files, stiffness=folder / "K.rb", mass=folder / "M.rb")


@pytest.mark.parametrize("write", [as_calculix, as_csv, as_matrix_market, as_scipy, as_harwell_boeing])
def test_every_kind_of_file_says_the_same(write: Callable[[Path], ForeignFiles], tmp_path: Path) -> None:
    found = GivenMatrices.load(read_foreign(write(tmp_path)).save(tmp_path / "all.npz"))
    expected = given()
    for name in ("M", "K"):
        A, B = (getattr(one, name).toarray() for one in (found, expected))
        np.testing.assert_allclose(A, B, rtol=1e-14, atol=1e-14 * np.abs(B).max())
    for name in ("points", "node", "direction"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    for name, nodes in expected.groups.items():
        np.testing.assert_array_equal(np.sort(found.groups[name]), nodes)
    if write is not as_csv:
        np.testing.assert_array_equal(np.sort(found.groups["ends"]), [0, 1, 2, 3])


def entry(A: sp.csr_matrix, i: int, j: int, value: float) -> sp.csr_matrix:
    changed = A.toarray()
    changed[i, j] = value
    return sp.csr_matrix(changed)


UNSOUND: dict[str, tuple[Callable[[GivenMatrices], GivenMatrices], str]] = {
    "not symmetric": (lambda g: replace(g, K=entry(g.K, 1, 2, 50.0)), "K: a symmetric matrix is allowed"),
    "not finite": (lambda g: replace(g, M=entry(g.M, 3, 3, np.nan)), r"M: finite entries are allowed; row 4"),
    "wrong size": (lambda g: replace(g, M=g.M[:5, :5]), r"M = \[5, 5\]: a square matrix of the size of K, 11"),
    "no mass": (lambda g: replace(g, M=g.M - sp.diags(g.M.diagonal())), "M = 0.0: positive diagonal entries"),
    "pushed": (lambda g: replace(g, K=-g.K), "K = -.*: diagonal entries from 0 on"),
    "missing node": (lambda g: replace(g, node=g.node + 2), "node = 4: 0 to 3 is allowed"),
    "direction": (lambda g: replace(g, direction=g.direction + 5), "direction = 6: 0 to 5 is allowed"),
    "map too short": (lambda g: replace(g, node=g.node[:4]), "node = 4: one for each of the 11 coordinates"),
    "twice": (lambda g: replace(g, node=g.node * 0), "one coordinate for each node and direction"),
    "group": (lambda g: replace(g, groups={"tip": np.array([9])}), "groups.tip: at least one node, 0 to 3"),
    "points": (lambda g: replace(g, points=g.points[:, :2]), r"points: finite \(N, 3\) coordinates"),
}


@pytest.mark.parametrize("name", UNSOUND)
def test_what_is_unsound_is_refused(name: str) -> None:
    change, says = UNSOUND[name]
    with pytest.raises(InputError, match=says):
        change(given())


def changed(name: str, text: str) -> Callable[[ForeignFiles], ForeignFiles]:
    def change(files: ForeignFiles) -> ForeignFiles:
        path = getattr(files, name)
        path.write_text(path.read_text().replace(*text.split("->")) if "->" in text else text)
        return files

    return change


BAD: list[tuple[Callable[[ForeignFiles], ForeignFiles], str]] = [
    (changed("dofs", "12.1->99.1"), "job.dof: node = 99: nodes that job.inp has"),
    (changed("dofs", "12.1->12.8"), "job.dof: direction = 8: 1 to 6"),
    (changed("dofs", "12.1\n->"), "job.dof = 10: a line for each of the 11 rows"),
    (changed("dofs", "12.1->x"), "job.dof: a readable .dof file"),
    (changed("nodes", "3, 12, 9->3, 13, 10"), "job.inp: group tip = 13: nodes"),
    (changed("nodes", "*NODE\n"), "job.inp: a readable .inp file is allowed (no nodes)"),
    (changed("stiffness", "1 1 nan\n11 11 1.0\n"), "K: finite entries are allowed; row 1 has another"),
    (changed("stiffness", "1 2\n"), "a readable .sti file is allowed"),
    (changed("mass", "<html>"), "job.mas: a readable .mas file"),
    (lambda files: replace(files, mass=files.mass.with_name("none.mas")), "none.mas: no such file"),
    (lambda files: replace(files, mass=files.nodes), "job.inp: files that end in"),
]


@pytest.mark.parametrize(("change", "says"), BAD, ids=[says for _, says in BAD])
def test_a_bad_file_ends_with_one_line_and_exit_code_2(
    change: Callable[[ForeignFiles], ForeignFiles], says: str, tmp_path: Path, monkeypatch, capsys
) -> None:
    files = change(as_calculix(tmp_path))
    options = [part for key in ("mass", "dofs", "nodes") for part in (f"--{key}", str(getattr(files, key)))]
    done = called(monkeypatch, capsys, "matrices", str(files.stiffness), *options)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1
    assert says in done.stderr
    assert not (tmp_path / "job-matrices.npz").exists()


@pytest.mark.parametrize("name", ["header", "node", "points", "K.indices", "M.data"])
def test_an_npz_with_text_for_numbers_or_without_a_part_is_refused(name: str, tmp_path: Path) -> None:
    with np.load(given().save(tmp_path / "whole.npz")) as data:
        arrays = dict(data)
    for changed in ({**arrays, name: np.array("text")}, {key: one for key, one in arrays.items() if key != name}):
        np.savez(tmp_path / "other.npz", **changed)
        with pytest.raises(InputError, match="matrices that pmr wrote are allowed"):
            GivenMatrices.load(tmp_path / "other.npz")
