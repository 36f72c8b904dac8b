"""Matrices of other programs: every kind of file says the same, and what is unsound is refused in one line."""

import os
import re
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp

from pmr.errors import InputError
from pmr.files import npz
from pmr.files.foreign import ForeignFiles, MatrixNames, foreign_files, read_foreign
from pmr.files.matrices import GivenMatrices
from pmr.files.nastran import read_bulk

NUMBERS = [7, 3, 12, 5]  # of the nodes, as another program counts them


def given() -> GivenMatrices:
    """Four nodes of a plate, joined by bars that have a mass; the first one stands still along z."""
    points = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 0.0], [0.0, 1.0, 0.125]])
    K, M = np.zeros((2, 12, 12))
    for i, j in combinations(range(4), 2):
        axis = points[j] - points[i]
        length = np.linalg.norm(axis)
        at = [3 * i, 3 * i + 1, 3 * i + 2, 3 * j, 3 * j + 1, 3 * j + 2]
        K[np.ix_(at, at)] += 1e7 / length**3 * np.kron([[1, -1], [-1, 1]], np.outer(axis, axis))
        M[np.ix_(at, at)] += length / 6.0 * np.kron([[2, 1], [1, 2]], np.eye(3))
    rest = np.delete(np.arange(12), 2)
    node, direction = rest // 3, rest % 3
    groups = {"tail": np.array([0, 3]), "tip": np.array([1, 2])}
    K, M = (sp.csr_matrix(A[np.ix_(rest, rest)]) for A in (K, M))
    return GivenMatrices(M, K, points, node, direction, groups)


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


def as_ansys(folder: Path) -> ForeignFiles:
    """One triangle, with a right-hand side behind the stiffness and exponents with a D."""
    one, files = given(), as_calculix(folder)
    for name, A in (("K", one.K), ("M", one.M)):
        scipy.io.hb_write(folder / f"{name}.rb", sp.tril(A).tocsc())
        title, sizes, kind, formats, *lines = (folder / f"{name}.rb").read_text().splitlines()
        if name == "K":
            sizes, lines = f"{sizes[:56]}{1:>14}", ["F                          1", *lines, "1.0"]
        pointers = sum(int(sizes[k : k + 14]) for k in (14, 28)) + (name == "K")
        lines[pointers:] = [line.replace("E", "D") for line in lines[pointers:]]
        head = [title, sizes, f"RSA{kind[3:]}", formats.replace("(", "(1P,", 3).replace("E", "D")]
        (folder / f"{name}.matrix").write_text("\n".join([*head, *lines, ""]))
    rows = zip(one.node, one.direction, strict=True)
    names = ("UX", "UY", "UZ", "ROTX", "ROTY", "ROTZ")
    mapping = [f"{k:>10}{NUMBERS[node]:>10}   {names[d]}" for k, (node, d) in enumerate(rows, 1)]
    (folder / "K.mapping").write_text("\n".join([" Matrix Eqn      Node   DOF", *mapping, ""]))
    paths = [folder / name for name in ("K.matrix", "M.matrix", "K.mapping")]
    return replace(files, stiffness=paths[0], mass=paths[1], dofs=paths[2])


def as_abaqus(folder: Path) -> ForeignFiles:
    """One triangle; its own coordinates ascend by the nodes' numbers."""
    one, files = given(), as_calculix(folder)
    for name, A in (("STIF", one.K), ("MASS", one.M)):
        upper = sp.triu(A).tocoo()
        labels = [(NUMBERS[k], d + 1) for k, d in zip(one.node, one.direction, strict=True)]
        lines = [
            f"{labels[i][0]},{labels[i][1]}, {labels[j][0]},{labels[j][1]}, {value:.17e}\n"
            for i, j, value in zip(upper.row, upper.col, upper.data, strict=True)
        ]
        (folder / f"job_{name}2.mtx").write_text("** of a step\n" + "".join(lines))
    return foreign_files(folder / "job_STIF2.mtx", folder / "job_MASS2.mtx", None, files.nodes)


def as_dmig(folder: Path) -> ForeignFiles:
    """All in one file, as pyNastran writes it."""
    bdf = pytest.importorskip("pyNastran.bdf.bdf", reason="pyNastran is not installed")
    one, deck = given(), bdf.BDF(debug=None)
    for number, point in zip(NUMBERS, one.points, strict=True):
        deck.add_grid(number, point)
    deck.add_set1(4, [3, 12])
    labels = [(NUMBERS[k], int(d) + 1) for k, d in zip(one.node, one.direction, strict=True)]
    for name, A in (("KAAX", one.K), ("MAAX", one.M)):
        upper = sp.triu(A).tocoo()
        rows, columns = ([labels[k] for k in part] for part in (upper.row, upper.col))
        deck.add_dmig(name, 6, 2, 0, 0, len(labels), columns, rows, upper.data.tolist())
    deck.write_bdf(str(folder / "job.bdf"), size=16, is_double=True, write_header=False)
    return foreign_files(folder / "job.bdf", None, None, None)


def as_output4(folder: Path) -> ForeignFiles:
    op4 = pytest.importorskip("pyNastran.op4.op4", reason="pyNastran is not installed")
    one, files = given(), as_calculix(folder)
    whole = {"KAA": (6, one.K.toarray()), "MAA": (6, one.M.toarray())}
    op4.OP4(debug=None).write_op4(str(folder / "job.op4"), whole, precision="double", is_binary=False)
    return foreign_files(folder / "job.op4", None, files.dofs, files.nodes)


WRITERS = [as_calculix, as_csv, as_matrix_market, as_scipy, as_harwell_boeing, as_ansys, as_abaqus, as_dmig, as_output4]


@pytest.mark.parametrize("write", WRITERS)
def test_every_kind_of_file_says_the_same(write: Callable[[Path], ForeignFiles], tmp_path: Path) -> None:
    found = GivenMatrices.load(read_foreign(write(tmp_path)).save(tmp_path / "all.npz"))
    expected = given()
    own = np.array([np.flatnonzero((expected.points == point).all(axis=1)).item() for point in found.points])
    order = np.lexsort((found.direction, own[found.node]))  # entries that name their coordinates have them ascend
    digits = 1e-9 if write is as_dmig else 1e-14  # its fields have 16 letters
    for name in ("M", "K"):
        A, B = (getattr(one, name).toarray() for one in (found, expected))
        np.testing.assert_allclose(A[np.ix_(order, order)], B, rtol=digits, atol=digits * np.abs(B).max())
    np.testing.assert_array_equal(own[found.node][order], expected.node)
    np.testing.assert_array_equal(found.direction[order], expected.direction)
    if write is as_dmig:
        np.testing.assert_array_equal(np.sort(own[found.groups["set4"]]), expected.groups["tip"])
        return
    for name, nodes in expected.groups.items():
        np.testing.assert_array_equal(np.sort(found.groups[name]), nodes)
    if write is not as_csv:
        np.testing.assert_array_equal(np.sort(found.groups["ends"]), [0, 1, 2, 3])


def test_a_node_may_have_a_line_for_each_of_its_groups_at_one_place(tmp_path: Path) -> None:
    files = as_csv(tmp_path)
    text = files.nodes.read_text()
    first = text.splitlines()[1].split(",")
    files.nodes.write_text(text + ",".join([*first[:4], "ends"]) + "\n")
    body, expected = read_foreign(files), given()
    np.testing.assert_array_equal(body.points, expected.points)
    assert len(body.groups["ends"]) == 1
    files.nodes.write_text(text + ",".join([first[0], "0.5", *first[2:4], "ends"]) + "\n")
    with pytest.raises(InputError, match=f"line 6: one place of each node is allowed: node {first[0]} has another"):
        read_foreign(files)


def entry(A: sp.csr_matrix, i: int, j: int, value: float) -> sp.csr_matrix:
    changed = A.toarray()
    changed[i, j] = value
    return sp.csr_matrix(changed)


UNSOUND: dict[str, tuple[Callable[[GivenMatrices], GivenMatrices], str]] = {
    "not symmetric": (lambda g: replace(g, K=entry(g.K, 1, 2, 50.0)), "K: a symmetric matrix is allowed"),
    "not finite": (lambda g: replace(g, M=entry(g.M, 3, 3, np.nan)), r"M: finite entries are allowed; row 4"),
    "wrong size": (lambda g: replace(g, M=g.M[:5, :5]), r"M = \[5, 5\]: a square matrix of the size of K, 11"),
    "no mass": (lambda g: replace(g, M=g.M - sp.diags(g.M.diagonal())), "M = 0.0: positive diagonal entries"),
    "pushed": (lambda g: replace(g, K=-g.K), "K = -.*: positive diagonal entries .* no stiffness"),
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


def cut(name: str, lines: bool = False) -> Callable[[ForeignFiles], ForeignFiles]:
    def change(files: ForeignFiles) -> ForeignFiles:
        path = getattr(files, name)
        text = path.read_text()[: path.stat().st_size // 2]
        path.write_text(text.rpartition("\n")[0] + "\n" if lines else text)
        return files

    return change


BAD: list[tuple[Callable[[ForeignFiles], ForeignFiles], str]] = [
    (changed("dofs", "12.1->99.1"), "job.dof: node = 99: only nodes of job.inp"),
    (changed("dofs", "12.1->12.8"), "job.dof: direction = 8: 1 to 6"),
    (changed("dofs", "12.1\n->"), "job.dof = 10: 11 lines are needed, one for each row"),
    (changed("dofs", "12.1->x"), "job.dof: line 6: node and direction with '.' between them are allowed, not 'x'"),
    (changed("nodes", "3, 12, 9->3, 13, 10"), "job.inp: line 11: node 13 of set tip is not in the file"),
    (changed("nodes", "*NODE\n"), "job.inp: nodes are allowed: this file has none"),
    (changed("stiffness", "1 1 nan\n" + "".join(f"{k} {k} 1.0\n" for k in range(2, 12))),
     "K: finite entries are allowed; row 1 has another"),
    (changed("stiffness", "1 2\n"), "job.sti: line 1: row, column and entry are allowed, not '1 2'"),
    (changed("nodes", "*STEP->*TRANSFORM, NSET=tip, TYPE=T\n0, 0, 0, 0, 0, 1\n*STEP"),
     "job.inp: line 14: TYPE=R, C or S with three coordinates of two points is allowed"),
    (changed("nodes",
     "*STEP->*PART, NAME=p\n*NODE\n99, 9, 9, 9\n*END PART\n*INSTANCE, NAME=a, PART=p\n*INSTANCE, NAME=b, PART=p"),
     "job.inp: line 19: matrices name nodes by their numbers: instances whose nodes have numbers that no other has"),
    (changed("nodes", "*STEP->*EQUATION\n2\n12, 3, 1.0, 7, 3, -1.0\n*STEP"),
     "job.inp: line 14: a model is allowed in which *EQUATION ties no coordinates to others: 1 displacements"),
    (cut("stiffness"), "job.sti"),
    (cut("stiffness", lines=True), "positive diagonal entries"),
    (cut("mass"), "job.mas"),
    (cut("dofs"), "job.dof"),
    (changed("mass", "<html>\n"), "job.mas: line 1: row, column and entry are allowed, not '<html>'"),
    (lambda files: replace(files, mass=files.mass.with_name("none.mas")), "none.mas: no such file"),
    (lambda files: replace(files, mass=files.nodes), "job.inp: files that end in"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "says"), BAD, ids=[says for _, says in BAD])
def test_a_bad_file_ends_with_one_line_and_exit_code_2(
    change: Callable[[ForeignFiles], ForeignFiles], says: str, tmp_path: Path, run_command
) -> None:
    files = change(as_calculix(tmp_path))
    options = [part for key in ("mass", "dofs", "nodes") for part in (f"--{key}", str(getattr(files, key)))]
    done = run_command("matrices", str(files.stiffness), *options)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1
    assert says in done.stderr
    assert not (tmp_path / "job-matrices.npz").exists()


def relabelled(files: ForeignFiles) -> ForeignFiles:
    """Of the mass one coordinate is another one."""
    files.mass.write_text(files.mass.read_text().replace("12,3, ", "3,4, "))
    return files


LABELLED: list[tuple[Callable[[Path], ForeignFiles], Callable[[ForeignFiles], ForeignFiles], str]] = [
    (as_abaqus, relabelled, "job_MASS2.mtx: the same nodes and directions as in job_STIF2.mtx"),
    (as_abaqus, changed("stiffness", "1,2,3,4\n"),
     "line 1: node, direction, node, direction and entry are allowed, not '1,2,3,4'"),
    (as_abaqus, changed("stiffness", "1.5,1,1,1,2.0\n"),
     "line 1: node, direction, node, direction and entry are allowed, not '1.5,1,1,1,2.0'"),
    (as_dmig, changed("stiffness", "KAAX->QAAX"),
     "one square matrix whose name begins with K is allowed, not QAAX, MAAX"),
    (as_dmig, changed("stiffness", "GRID*->GRUD*"), "job.bdf: nodes are allowed: this file has none"),
    (as_output4, changed("stiffness", "KAA"), "job.op4: OUTPUT4 in binary form or as text is allowed"),
]  # fmt: skip


@pytest.mark.parametrize(("write", "change", "says"), LABELLED, ids=[says for _, _, says in LABELLED])
def test_bad_files_of_abaqus_and_nastran_are_refused_in_one_line(
    write: Callable[[Path], ForeignFiles], change: Callable[[ForeignFiles], ForeignFiles], says: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError) as caught:
        read_foreign(change(write(tmp_path)))
    assert says in str(caught.value) and len(str(caught.value).splitlines()) == 1


def test_the_command_says_what_mass_it_has_read_and_what_holds_it(tmp_path: Path, run_command) -> None:
    """Bars of 1 kg/m; along z the first node's share, a third and a sixth twice of each bar there, is left out."""
    files, points = as_calculix(tmp_path), given().points
    done = run_command("matrices", str(files.stiffness))
    lengths = {(i, j): float(np.linalg.norm(points[i] - points[j])) for i, j in combinations(range(4), 2)}
    missing = sum(2.0 / 3.0 * length for (i, _), length in lengths.items() if i == 0)
    mass = (3.0 * sum(lengths.values()) - missing) / 3.0
    line = done.stdout.splitlines()[1]
    assert line.startswith(f"{mass:.4g} kg of what supports inside the matrices leave free, centre of mass at (")
    assert line.endswith("; supports and springs in its stiffness hold 1 of 6 rigid motions")


def struts() -> sp.csr_matrix:
    """Damping of `given`: a damper along the line between the second and third node, and one to ground at the last."""
    D = np.zeros((11, 11))
    D[np.ix_([3, 6], [3, 6])] = 50.0 * np.array([[1.0, -1.0], [-1.0, 1.0]])  # along y, as the line is
    D[10, 10] = 7.0
    return sp.csr_matrix(D)


def with_damping(files: ForeignFiles, folder: Path) -> ForeignFiles:
    """Write the damping in the format of the stiffness, where it can be with rows of damped coordinates alone."""
    D, suffix = struts().tocoo(), files.stiffness.suffix
    labels = [(NUMBERS[k], int(d) + 1) for k, d in zip(given().node, given().direction, strict=True)]
    path = folder / f"D{suffix}"
    if suffix == ".npz":
        sp.save_npz(path, D)
    elif suffix == ".mtx" and files.dofs == files.stiffness:
        lines = [(*labels[i], *labels[j], v) for i, j, v in zip(D.row, D.col, D.data, strict=True)]
        path.write_text("".join(f"{n},{d}, {m},{e}, {v!r}\n" for n, d, m, e, v in lines))
    elif suffix == ".mtx":
        scipy.io.mmwrite(path, D, symmetry="symmetric", precision=17)
    elif suffix == ".bdf":
        rows = "".join(
            f"DMIG,BAAX,{m},{e},,{n},{d},{v}\n"
            for i, j, v in zip(D.row, D.col, D.data, strict=True)
            if i <= j
            for (n, d), (m, e) in [(labels[i], labels[j])]
        )
        text = files.stiffness.read_text().replace("ENDDATA", "")
        files.stiffness.write_text(f"{text}DMIG,BAAX,0,6,2,0\n{rows}DMIG,K4AAX,0,6,2,0\nDMIG,K4AAX,3,1,,3,1,1.0\n")
        return foreign_files(files.stiffness, None, None, None, names=MatrixNames(damping="baax"))
    return replace(files, damping=path)


@pytest.mark.parametrize("write", [as_matrix_market, as_scipy, as_abaqus, as_dmig])
def test_damping_is_read_by_its_file_or_name(write: Callable[[Path], ForeignFiles], tmp_path: Path, caplog) -> None:
    files = with_damping(write(tmp_path), tmp_path)
    body = read_foreign(files)
    order, mine = (np.lexsort((of.direction, *of.points[of.node].T)) for of in (body, given()))
    assert body.D is not None and abs(body.D[order][:, order] - struts()[mine][:, mine]).max() < 1e-12
    assert ("damping is not read: K4AAX" in caplog.text) is (write is as_dmig) and "BAAX" not in caplog.text
    stored = GivenMatrices.load(body.save(tmp_path / "body.npz"))
    assert stored.D is not None and (stored.D != body.D).nnz == 0


def test_the_command_reads_damping_by_its_name(tmp_path: Path, run_command) -> None:
    files = with_damping(as_dmig(tmp_path), tmp_path)
    done = run_command("matrices", str(files.stiffness), "--damping-name", "BAAX")
    assert done.returncode == 0, done.stderr
    assert "viscous damping on 3 coordinates; the damping of a scene is added to it" in done.stdout
    body = GivenMatrices.load(tmp_path / "job-matrices.npz")
    assert body.D is not None and body.D.sum() == pytest.approx(7.0, rel=1e-9)


def test_a_file_without_damping_is_what_it_was_and_one_with_it_says_its_version(tmp_path: Path) -> None:
    for body, version in ((given(), 1), (replace(given(), D=struts()), 2)):
        assert npz.pop_header(npz.read(body.save(tmp_path / "body.npz")))["version"] == version
    assert GivenMatrices.load(given().save(tmp_path / "body.npz")).D is None


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda D: D - 2.0 * sp.diags(D.diagonal()), "D: a damping without negative eigenvalues is allowed"),
        (lambda D: D + sp.csr_matrix(([3.0, 3.0], ([0, 1], [1, 0])), D.shape), "without negative eigenvalues"),
        (lambda D: D + sp.csr_matrix(([3.0], ([0], [1])), D.shape), "a symmetric matrix is allowed"),
        (lambda D: D[1:][:, 1:], "D = [10, 10]: a square matrix of the size of K, 11, is allowed"),
        (lambda D: D * np.inf, "D: finite entries are allowed; row 4 has another"),
    ],
)
def test_damping_that_is_none_is_refused(change: Callable[[sp.csr_matrix], sp.csr_matrix], says: str) -> None:
    with pytest.raises(InputError) as caught:
        replace(given(), D=sp.csr_matrix(change(struts())))
    assert says in str(caught.value) and len(str(caught.value).splitlines()) == 1


def test_structural_damping_and_names_without_a_matrix_are_refused(tmp_path: Path) -> None:
    files = with_damping(as_dmig(tmp_path), tmp_path)
    for name, says in (
        ("K4AAX", "this one is structural"),
        ("B", "the name of a matrix of the file is allowed, not B"),
    ):
        with pytest.raises(InputError, match=says):
            read_foreign(replace(files, names=MatrixNames(damping=name)))
    job, deck = tmp_path / "job_DMPS1.mtx", as_abaqus(tmp_path)
    job.write_text(deck.stiffness.read_text())
    with pytest.raises(InputError, match="job_DMPS1.mtx: viscous damping in N s/m is allowed"):
        read_foreign(replace(deck, damping=job))
    job = tmp_path / "job_DMPV1.mtx"
    job.write_text("3,1, 3,1, 5.0\n99,1, 99,1, 5.0\n")
    with pytest.raises(InputError, match="node = 99: only coordinates of job_STIF2.mtx are allowed"):
        read_foreign(replace(deck, damping=job))
    with pytest.raises(InputError, match="only files of Nastran have matrices with names; leave it out for job.sti"):
        read_foreign(
            foreign_files(as_calculix(tmp_path).stiffness, None, None, None, names=MatrixNames(damping="BAAX"))
        )


BULK = """GRID,1,,0.,0.,0.
GRID,2,,1.,0.,0.
GRID,30,,1.,1.,0.
DMIG,KAA,0,6,2,0,,,9
DMIG,KAA,1,1,,1,1,2.0
DMIG,MAA,0,6,2,0,,,9
DMIG,MAA,1,1,,1,1,1.0
"""


@pytest.mark.parametrize(
    ("entry", "members"),
    [
        ("SET1,7,1,THRU,900000000\n", [1, 2, 30]),
        ("SET1,7,2,THRU,29,30\n", [2, 30]),
        ("SET1    7       1       2       30\n", [1, 2, 30]),
        ("SET1*   7               1               2\n*       30\n", [1, 2, 30]),
        ("SET1,7,1\n,30\n", [1, 30]),
        ("SET1,7,1,1,1,1,1,1,1,+\n+,30\nSET1,8,2\n", [1, 30]),
        ("$ SET1,7,1\nset1,7,2 $ the middle\n", [2]),
    ],
)
def test_sets_of_bulk_data_have_the_points_that_there_are(entry: str, members: list[int], tmp_path: Path) -> None:
    pytest.importorskip("pyNastran.bdf.bdf", reason="pyNastran is not installed")
    (tmp_path / "k.bdf").write_text(entry + BULK)
    assert read_bulk(tmp_path / "k.bdf").groups["set7"].tolist() == members


@pytest.mark.parametrize(
    ("old", "new", "line", "says"),
    [
        ("GRID,30,,1.,1.,0.", "GRID,30,,1.,1.,0.,4\nCORD2S,4,,1.,1.,2.,1.,1.,3.\n,2.,0.,0.", 3,
         "displacements along spherical axes are allowed away from their poles: grid point 30 is at one"),
        ("KAA,0,6,2,0", "KAA,0,6,4,0", 4, "real entries are allowed: those of KAA have imaginary parts"),
        ("GRID,1", "SET1,7,1,THRU\nGRID,1", 1, "SET1 with numbers of grid points, and first THRU last"),
        ("GRID,1", "SET1,7,x\nGRID,1", 1, "SET1 with numbers of grid points, and first THRU last"),
    ],
)  # fmt: skip
def test_bulk_data_that_is_not_read_is_refused_by_its_line(
    old: str, new: str, line: int, says: str, tmp_path: Path
) -> None:
    pytest.importorskip("pyNastran.bdf.bdf", reason="pyNastran is not installed")
    text = BULK.replace(old, new, 1)
    if "0,6,4,0" in new:
        text = text.replace("1,1,2.0", "1,1,2.0,0.5")
    (tmp_path / "k.bdf").write_text(text)
    with pytest.raises(InputError) as caught:
        read_foreign(foreign_files(tmp_path / "k.bdf", None, None, None))
    assert f"k.bdf: line {line}: {says}" in str(caught.value) and len(str(caught.value).splitlines()) == 1


def test_a_deck_with_axes_and_names_of_its_own_has_the_same_matrices(tmp_path: Path) -> None:
    """With executive and case control, places in one system, and displacements of two nodes along axes of their own.

    Nodes 12 and 5 have rectangular axes that are turned about x, and cylindrical ones about z at node 3, node 3 has
    spherical ones about an axis along y through the point (-1, -4, 0).
    """
    bdf = pytest.importorskip("pyNastran.bdf.bdf", reason="pyNastran is not installed")
    one, deck = given(), bdf.BDF(debug=None)
    a = np.deg2rad(30.0)
    deck.add_cord2r(8, [0.0, 0.0, 0.0], [0.0, -np.sin(a), np.cos(a)], [1.0, 0.0, 0.0])
    deck.add_cord2c(9, [2.0, 0.0, 0.0], [2.0, 0.0, 1.0], [3.0, 0.0, 0.0])
    deck.add_cord2s(6, [-1.0, -4.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -4.0, 0.0])
    deck.add_cord2r(4, [1.0, 2.0, 3.0], [1.0, 2.0, 4.0], [2.0, 2.0, 3.0])
    for number, point in zip(NUMBERS, one.points, strict=True):
        deck.add_grid(number, point - [1.0, 2.0, 3.0], cp=4, cd={12: 8, 5: 9, 3: 6}.get(number, 0))
    place = one.points[NUMBERS.index(5)] - [2.0, 0.0, 0.0]
    radial = np.array([place[0], place[1], 0.0]) / np.hypot(place[0], place[1])
    axes = {
        12: np.array([[1.0, 0.0, 0.0], [0.0, np.cos(a), np.sin(a)], [0.0, -np.sin(a), np.cos(a)]]),
        3: np.array([[0.6, 0.8, 0.0], [0.8, -0.6, 0.0], [0.0, 0.0, -1.0]]),  # along the radius, from and about the pole
        5: np.stack([radial, np.cross([0.0, 0.0, 1.0], radial), [0.0, 0.0, 1.0]]),
    }
    Q = np.eye(one.size)
    for number, R in axes.items():
        at = np.flatnonzero(one.node == NUMBERS.index(number))
        Q[np.ix_(at, at)] = R
    labels = [(NUMBERS[k], int(d) + 1) for k, d in zip(one.node, one.direction, strict=True)]
    for name, A in (("KAAX", one.K), ("K4AAX", 0.01 * one.K), ("MAAX", one.M), ("MES1", 2.0 * one.M)):
        turned = Q @ A.toarray() @ Q.T
        rows, columns = (part.tolist() for part in np.triu_indices(one.size))
        entries = [labels[k] for k in columns], [labels[k] for k in rows]
        deck.add_dmig(name, 6, 2, 0, 0, one.size, *entries, turned[rows, columns].tolist())
    deck.write_bdf(str(tmp_path / "bulk.bdf"), size=16, is_double=True, write_header=False)
    control = "SOL 103\nCEND\nTITLE = A plate\nSET 1 = 3 THRU 9\nMETHOD = 5\nBEGIN BULK\n"
    bulk = (tmp_path / "bulk.bdf").read_text()
    (tmp_path / "job.bdf").write_text(control + "EIGRL,5,,,10\n" + bulk)
    assert read_foreign(foreign_files(tmp_path / "job.bdf", None, None, None)).size == one.size  # MAAX goes with KAAX
    with pytest.raises(InputError, match="the name of a matrix of the file is allowed, not mgg"):
        read_foreign(foreign_files(tmp_path / "job.bdf", None, None, None, names=MatrixNames(mass="mgg")))
    read = read_foreign(foreign_files(tmp_path / "job.bdf", None, None, None, names=MatrixNames(mass="maax")))
    order = np.lexsort((one.direction, np.array(NUMBERS)[one.node]))
    for name in ("K", "M"):
        expected = getattr(one, name).toarray()[np.ix_(order, order)]
        assert getattr(read, name).toarray() == pytest.approx(expected, abs=1e-9 * np.abs(expected).max())
    assert read.points == pytest.approx(one.points[np.argsort(NUMBERS)], abs=1e-12)


def test_output4_as_text_may_have_exponents_with_d(tmp_path: Path) -> None:
    files = as_output4(tmp_path)
    text = files.stiffness.read_text()
    assert "E+" in text
    files.stiffness.write_text(text.replace("E+", "D+").replace("E-", "D-"))
    assert abs(read_foreign(files).K - given().K).max() < 1e-9 * abs(given().K).max()


@pytest.mark.parametrize(
    ("kind", "entry"), [("complex symmetric", " 1.0 0.5"), ("pattern symmetric", ""), ("real skew-symmetric", " 1.0")]
)
def test_matrices_that_are_not_real_or_not_symmetric_are_refused(kind: str, entry: str, tmp_path: Path) -> None:
    files = as_matrix_market(tmp_path)
    files.stiffness.write_text(f"%%MatrixMarket matrix coordinate {kind}\n2 2 1\n2 1{entry}\n")
    with pytest.raises(InputError, match=rf"K.mtx: line 1: real entries, .* not {kind} ones"):
        read_foreign(files)


@pytest.mark.parametrize(
    ("name", "old", "new", "says"),
    [
        ("K.matrix", "RSA", "CSA", "K.matrix: line 3: real assembled matrices, RSA or RUA, are allowed, not 'CSA'"),
        ("K.mapping", "UZ", "TEMP", r"K.mapping: line \d+: row \d+, a node and one of UX, .* are allowed"),
        ("K.mapping", "         2  ", "         3  ", "K.mapping: line 3: row 2, a node"),
    ],
)
def test_files_of_ansys_that_are_not_read_are_refused(name: str, old: str, new: str, says: str, tmp_path: Path) -> None:
    files = as_ansys(tmp_path)
    text = (tmp_path / name).read_text()
    assert old in text
    (tmp_path / name).write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=says):
        read_foreign(files)


def test_a_row_beyond_the_matrix_is_refused(tmp_path: Path) -> None:
    """A damaged file of Harwell and Boeing: the process died of it."""
    files = as_harwell_boeing(tmp_path)
    lines = files.stiffness.read_text().splitlines()
    pointers = int(lines[1][14:28])  # lines of where columns begin; numbers of rows follow
    lines[4 + pointers] = f"999{lines[4 + pointers][3:]}"
    files.stiffness.write_text("\n".join([*lines, ""]))
    with pytest.raises(InputError, match="K.rb: a readable .rb file is allowed"):
        read_foreign(files)


EQUATIONS = "".join(f"*EQUATION\n2\n900, {d}, 1.0, 12, {d}, -1.0\n" for d in (1, 2, 3))


def test_nodes_that_depend_on_others_are_left_out(tmp_path: Path) -> None:
    """They have no rows: programs leave them out of their matrices."""
    files, expected = as_calculix(tmp_path), read_foreign(as_calculix(tmp_path))
    text = files.nodes.read_text()
    files.nodes.write_text(text.replace("*STEP", f"*NODE\n900, 1.0, 1.0, 1.0\n{EQUATIONS}*STEP"))
    found = read_foreign(files)
    assert np.array_equal(found.points, expected.points) and (found.K != expected.K).nnz == 0
    assert found.lacks == expected.lacks and found.groups.keys() == expected.groups.keys()


@pytest.mark.parametrize(
    "card",
    [
        EQUATIONS[: EQUATIONS.rindex("*")],  # one displacement depends on nothing
        EQUATIONS + "*EQUATION\n2\n12, 3, 1.0, 7, 3, -1.0\n",  # a node with rows depends on another
        EQUATIONS.replace("900", "set of nodes"),
    ],
)
def test_nodes_that_depend_on_others_in_part_are_refused(card: str, tmp_path: Path) -> None:
    files = as_calculix(tmp_path)
    text = files.nodes.read_text()
    files.nodes.write_text(text.replace("*STEP", f"*NODE\n900, 1.0, 1.0, 1.0\n{card}*STEP"))
    with pytest.raises(InputError, match=r"job.inp: line \d+: a model is allowed in which \*EQUATION ties no"):
        read_foreign(files)


@pytest.mark.parametrize("rest", ["", "\n", "\n% a comment\n", "\n\n \n%"])
def test_a_file_of_matrix_market_that_ends_in_its_head_is_refused(rest: str, tmp_path: Path) -> None:
    files = as_matrix_market(tmp_path)
    files.stiffness.write_text("%%MatrixMarket matrix coordinate real symmetric" + rest)
    with pytest.raises(InputError, match="K.mtx: a line with the numbers of rows, columns and entries is allowed"):
        read_foreign(files)


def test_a_dense_matrix_of_matrix_market_is_read(tmp_path: Path) -> None:
    files = as_matrix_market(tmp_path)
    scipy.io.mmwrite(files.stiffness, given().K.toarray(), precision=17)
    np.testing.assert_array_equal(read_foreign(files).K.toarray(), given().K.toarray())


def test_imaginary_parts_of_other_files_are_refused(tmp_path: Path) -> None:
    files = as_scipy(tmp_path)
    sp.save_npz(files.stiffness, given().K * (1.0 + 0.02j))
    with pytest.raises(InputError, match=r"K.npz: real entries are allowed: these have imaginary parts"):
        read_foreign(files)


@pytest.mark.parametrize("name", ["", ".", "/", ".."])
def test_a_name_that_is_no_file_is_refused_in_one_line(name: str, run_command) -> None:
    done = run_command("matrices", name)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1


#: What readers of libraries say of files that they can't read.
INSIDE = re.compile(
    r"list index|'[a-z]+' object|unpack|NoneType|Misindent|could not convert|invalid literal|<class|codec"
)


#: Damages of the files of each kind.
DAMAGES = 1000 if os.environ.get("PMR_SWEEP") == "full" else 40
INSERTED = (b"nan", b"-", b"1e999", b"9" * 20, b"*", b",", b"\x00", b"\xff")


def damaged(content: bytes, rng: np.random.Generator) -> bytes:
    """Cut off, a byte changed, some left out, a line doubled, or something put in."""
    at, more = (int(n) for n in rng.integers(len(content), size=2))
    lines = content.split(b"\n")
    lines.insert(at % len(lines), lines[more % len(lines)])
    ways = [
        content[:at],
        content[:at] + bytes([more % 256]) + content[at + 1 :],
        content[:at] + content[at + more % 40 :],
        b"\n".join(lines),
        content[:at] + INSERTED[more % len(INSERTED)] + content[at:],
    ]
    return ways[int(rng.integers(len(ways)))]


@pytest.mark.slow
@pytest.mark.parametrize("write", WRITERS)
def test_damaged_files_are_read_or_refused_in_one_line(
    write: Callable[[Path], ForeignFiles], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """No error of a library's, no advice of its own, no memory for sizes that a file can't fill."""
    rng, files, refused = np.random.default_rng(14), write(tmp_path), 0
    whole = {
        path: path.read_bytes() for path in sorted({path for path in vars(files).values() if isinstance(path, Path)})
    }
    capfd.readouterr()
    for _ in range(DAMAGES):
        path = list(whole)[rng.integers(len(whole))]
        path.write_bytes(damaged(whole[path], rng))
        try:
            read_foreign(files)
        except InputError as error:
            refused += 1
            assert len(str(error).splitlines()) == 1 and len(str(error)) < 500
            assert not INSIDE.search(str(error))
        path.write_bytes(whole[path])
    assert refused > DAMAGES // 4
    assert capfd.readouterr() == ("", "")
    read_foreign(files)


def test_sizes_and_indices_that_the_file_cannot_hold_are_refused(tmp_path: Path) -> None:
    files = as_calculix(tmp_path)
    files.stiffness.write_text("1 1 1.0\n2000000000 2000000000 1.0\n")
    with pytest.raises(InputError, match="entries in all rows is allowed, not 2 entries in 2000000000 x 2000000000"):
        read_foreign(files)
    files = as_scipy(tmp_path)
    sp.save_npz(files.stiffness, given().K.tocsc())
    with np.load(files.stiffness) as found:
        parts = dict(found)
    parts["indices"] = parts["indices"] + 10**8
    np.savez(files.stiffness, **parts)
    with pytest.raises(InputError, match="K.npz: a readable .npz file"):
        read_foreign(files)


def test_a_truncated_npz_is_refused(tmp_path: Path) -> None:
    whole = given().save(tmp_path / "whole.npz").read_bytes()
    for part in (0, 100, len(whole) // 2, len(whole) - 10):
        (tmp_path / "part.npz").write_bytes(whole[:part])
        with pytest.raises(InputError, match="part.npz"):
            GivenMatrices.load(tmp_path / "part.npz")


@pytest.mark.parametrize("name", ["header", "node", "points", "K.indices", "M.data"])
def test_an_npz_with_text_for_numbers_or_without_a_part_is_refused(name: str, tmp_path: Path) -> None:
    with np.load(given().save(tmp_path / "whole.npz")) as data:
        arrays = dict(data)
    for changed in ({**arrays, name: np.array("text")}, {key: one for key, one in arrays.items() if key != name}):
        np.savez(tmp_path / "other.npz", **changed)
        with pytest.raises(InputError, match="matrices that pmr wrote are allowed"):
            GivenMatrices.load(tmp_path / "other.npz")
