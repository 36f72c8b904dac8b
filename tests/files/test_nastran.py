"""Superelements of Nastran: EXTSEOUT's punch, names and formats of OUTPUT4, and entries that tie displacements."""

import re
from collections.abc import Mapping, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from superelements import bar, boundary, superelement

from pmr import InputError
from pmr.files.foreign import MatrixNames, foreign_files, read_foreign
from pmr.files.labelled import UnreadableError, only_matrix, read_output4
from pmr.files.matrices import GivenMatrices
from pmr.files.nastran import read_bulk

pytest.importorskip("pyNastran.bdf.bdf", reason="pyNastran is not installed")


def dmig(name: str, A: sp.csr_matrix, pairs: Sequence[tuple[int, int]]) -> list[str]:
    """Lines of a symmetric matrix on grid points and scalar points, with exponents with a D."""
    lines, A = [f"DMIG    {name:<8}{0:>8}{6:>8}{2:>8}{0:>8}"], sp.tril(A).tocsc()
    for j, (node, direction) in enumerate(pairs):
        column = slice(A.indptr[j], A.indptr[j + 1])
        if A.indices[column].size:
            lines.append(f"DMIG*   {name:<16}{node:>16}{direction:>16}")
        for i, value in zip(A.indices[column], A.data[column], strict=True):
            number = f"{value:.9E}".replace("E", "D")
            lines.append(f"*       {pairs[i][0]:>16}{pairs[i][1]:>16}{number:>16}")
    return lines


def punch(part: GivenMatrices) -> list[str]:
    """Lines of a superelement as EXTSEOUT(EXTBULK, DMIGPCH) writes them."""
    amplitudes = np.cumsum(part.modal) + 90000
    on_nodes = zip(part.node.tolist(), part.direction.tolist(), part.modal, amplitudes.tolist(), strict=True)
    pairs = [(number, 0) if modal else (node + 1, direction + 1) for node, direction, modal, number in on_nodes]
    lines = ["$ EXTSEOUT", "BEGIN SUPER=      10"]
    for k, (x, y, z) in enumerate(part.points, 1):
        lines += [f"GRID*   {k:>16}{'':16}{x:>16.9f}{y:>16.9f}", f"*       {z:>16.9f}"]
    lines += [f"SPOINT  {number:>8}" for number, direction in pairs if not direction]
    lines += ["ASET1   123     1       THRU    10", "EXTRN   1       123     2       123"]
    for name, A in (("KAAX", part.K), ("MAAX", part.M), ("K4AAX", 0.01 * part.K), ("BAAX", 1e-4 * part.K)):
        lines += dmig(name, A, pairs)
    return [*lines, "ENDDATA", ""]


@pytest.mark.slow
def test_the_punch_of_a_superelement_is_read(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    part = superelement(bar(), boundary(bar())[::4], 3)
    (tmp_path / "part.pch").write_text("\n".join(punch(part)))
    read = read_foreign(foreign_files(tmp_path / "part.pch", None, None, None))
    assert (read.size, read.modal.sum(), len(read.held)) == (part.size, 3, 0)
    assert read.mass == pytest.approx(part.mass, rel=1e-8) and read.centre == pytest.approx(part.centre, abs=1e-8)
    assert read.K.diagonal() == pytest.approx(part.K.diagonal(), rel=1e-8)
    assert caplog.messages == ["damping is not read: K4AAX, BAAX; --damping-name chooses a viscous one"]
    damped = read_foreign(foreign_files(tmp_path / "part.pch", None, None, None, names=MatrixNames(damping="BAAX")))
    assert damped.D is not None and damped.D.diagonal() == pytest.approx(1e-4 * part.K.diagonal(), rel=1e-8)


def test_a_second_superelement_in_a_file_is_refused_with_its_line(tmp_path: Path) -> None:
    (tmp_path / "two.pch").write_text("BEGIN SUPER=1\nGRID,1,,0.,0.,0.\nENDDATA\nBEGIN SUPER=2\n")
    with pytest.raises(InputError, match=r"two\.pch: line 4: the bulk data of one part are allowed"):
        read_foreign(foreign_files(tmp_path / "two.pch", None, None, None))


GRIDS = [(-1.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]


def lattice(folder: Path, text: str) -> Path:
    """File of a tetrahedron of bars on grid points 1 to 4, with the lines `text` behind them."""
    points, pairs = np.array(GRIDS), [(k, d) for k in (1, 2, 3, 4) for d in (1, 2, 3)]
    K = np.zeros((12, 12))
    for i, j in combinations(range(4), 2):
        axis = (points[j] - points[i]) / np.linalg.norm(points[j] - points[i])
        at = [*range(3 * i, 3 * i + 3), *range(3 * j, 3 * j + 3)]
        K[np.ix_(at, at)] += 1e7 * np.kron([[1, -1], [-1, 1]], np.outer(axis, axis))
    grids = [f"GRID,{k},,{x},{y},{z}" for k, (x, y, z) in enumerate(GRIDS, 1)]
    matrices = [*dmig("KAA", sp.csr_matrix(K), pairs), *dmig("MAA", sp.eye(12, format="csr"), pairs)]
    (folder / "job.bdf").write_text("\n".join([*grids, text, *matrices, ""]))
    return folder / "job.bdf"


MPC = "\n".join(f"MPC,7,9,{d},1.0,3,{d},-1.0" for d in (1, 2, 3))


@pytest.mark.parametrize(
    "entry",
    ["RBE2,9,1,123456,9,10", "RBE3,9,,9,123,1.0,123,3\nRBE2,8,9,123,10,1.0-5", "RBAR,8,1,9,123456\nRBAR,9,1,10,123456",
     f"{MPC}\nRBE2,9,9,123,10"],
)  # fmt: skip
def test_points_that_rigid_elements_make_depend_on_others_are_left_out(entry: str, tmp_path: Path) -> None:
    """A program leaves their displacements out of its matrices."""
    loose = "GRID,9,,0.,0.,2.\nGRID,10,,0.,0.,3.\nSET1,7,2,THRU,10\n"
    read = read_foreign(foreign_files(lattice(tmp_path, loose + entry), None, None, None))
    assert read.points.tolist() == [list(point) for point in GRIDS]
    assert {name: members.tolist() for name, members in read.groups.items()} == {"set7": [1, 2, 3]}


@pytest.mark.parametrize(
    ("entry", "says"),
    [
        ("RBE2,9,1,12,9", "a model is allowed in which RBE2 ties no coordinates to others: 3 displacements"),
        ("RBE2,9,1,123,9,THRU,10", "a model is allowed in which RBE2 ties no coordinates to others: 3 displacements"),
        ("RBE3,9,,3,123,1.0,123,1,+\n+,UM,9,123", "a model is allowed in which RBE3 ties no coordinates to others"),
        ("RJOINT,9,1,9,123", "a model is allowed in which RJOINT ties no coordinates to others"),
        ("RSSCON,9,GRID,1,2,9", "a model is allowed in which RSSCON ties no coordinates to others"),
        ("RBAR,9,1,9,123,12,3", "a model is allowed in which RBAR ties no coordinates to others"),
        ("RBE2,9,1,123456,9,3", "matrices are allowed that RBE2 is part of: it makes direction 1 of grid point 3"),
        ("RBE3,9,,3,123,1.0,123,1", "matrices are allowed that RBE3 is part of: it makes direction 1 of grid point 3"),
    ],
)
def test_rigid_elements_that_do_not_go_with_the_matrices_are_refused(entry: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=rf"job\.bdf: line 6: {says}"):
        read_foreign(foreign_files(lattice(tmp_path, "GRID,9,,0.,0.,2.\n" + entry), None, None, None))


def test_sets_have_the_names_that_preprocessors_write_in_comments(tmp_path: Path) -> None:
    sets = '$HMSET       7        1 "Rail Top"\nSET1,7,1,2\nSET1,8,3\n$ANSA_NAME_COMMENT;8;SET;tip;;NO;NO;NO;NO;\n'
    sets += '$HMSET       9        2 "elements"\n'
    read = read_bulk(lattice(tmp_path, sets)).groups
    assert {name: members.tolist() for name, members in read.items()} == {
        "set7": [1, 2], "rail top": [1, 2], "set8": [3], "tip": [3],
    }  # fmt: skip


def output4(matrices: Mapping[str, np.ndarray], form: str, width: int, exponent: str = "E", words: int = 2) -> str:
    """Dense text of OUTPUT4 with numbers of a width, after the format `form` in each header."""
    text = list[str]()
    for name, A in matrices.items():
        text.append(f"{A.shape[1]:>8}{A.shape[0]:>8}{2:>8}{2:>8}{name:<8}{form}")
        for j, column in enumerate(A.T, 1):
            numbers = [f"{x:.{width - 8}E}".replace("E", exponent).rjust(width) for x in column]
            text.append(f"{j:>8}{1:>8}{words * len(column):>8}")
            text += ["".join(numbers[k : k + 3]) for k in range(0, len(numbers), 3)]
        text += [f"{A.shape[1] + 1:>8}{1:>8}{words:>8}", " 1.0000000E+00"]
    return "\n".join([*text, ""])


@pytest.mark.parametrize("words", [1, 2])
@pytest.mark.parametrize(
    ("form", "width", "exponent"),
    [
        ("1P,3E23.16", 23, "E"), ("1P,3E23.16", 23, "D"), ("1P,3D25.17", 25, "D"), ("1P3E26.18", 26, "E"),
        ("(3E30.22)", 30, "E"),
    ],
)  # fmt: skip
def test_output4_is_read_in_any_width(form: str, width: int, exponent: str, words: int, tmp_path: Path) -> None:
    A = np.random.default_rng(1).standard_normal((5, 5))
    A, B = A + A.T, np.ones((3, 5))
    names = {"KXX": A, "K4XX": 0.01 * A, "MES1": B, "MXX": np.diag([1.0, 2.0, 3.0, 4.0, 1e-99])}
    (tmp_path / "job.op4").write_text(output4(names, form, width, exponent, words))
    read = read_output4(tmp_path / "job.op4")
    assert only_matrix(read, "K").toarray() == pytest.approx(A, rel=1e-14)
    assert only_matrix(read, "M").toarray() == pytest.approx(names["MXX"], rel=1e-14)


def test_sparse_output4_is_read_and_a_cut_off_text_refused_with_its_line(tmp_path: Path) -> None:
    text = (
        "       3       3       6       1KAA     1P,3E16.9\n       1       0       5\n"
        f"{65536 * 2 + 1:>8}\n 2.000000000E+00\n{65536 * 3 + 2:>8}\n 1.000000000E+00-1.000000000+00\n"
        "       3       1       3\n 0.000000000E+00 0.000000000E+00 5.000000000E+00\n"
        "       4       1       1\n 1.000000000E+00\n"
    )
    (tmp_path / "k.op4").write_text(text)
    expected = [[2.0, 0.0, 0.0], [1.0, 0.0, 0.0], [-1.0, 0.0, 5.0]]
    assert read_output4(tmp_path / "k.op4")["KAA"].toarray().tolist() == expected
    (tmp_path / "k.op4").write_text(text[:150])
    with pytest.raises(UnreadableError) as error:
        read_output4(tmp_path / "k.op4")
    assert error.value.line > 3


def test_masses_of_which_none_goes_with_the_stiffness_are_refused() -> None:
    A = sp.eye(2, format="csr")
    with pytest.raises(UnreadableError, match="begins with M is allowed, not KAA, MBB, MCC; --mass-name"):
        only_matrix({"KAA": A, "MBB": A, "MCC": A}, "M")


def test_rows_of_output4_are_those_of_extrn(tmp_path: Path) -> None:
    text = (
        "BEGIN SUPER     111\nEXTRN   7       123     3       12      12      2\n        90001   0\nGRID,3,,0.,1.,2.\n"
    )
    (tmp_path / "part.pch").write_text(text)
    pairs = read_bulk(tmp_path / "part.pch").pairs.tolist()
    assert pairs == [[7, 1], [7, 2], [7, 3], [3, 1], [3, 2], [12, 2], [90001, 0]]
    (tmp_path / "part.pch").write_text(text.replace("90001   0", "90001"))
    with pytest.raises(UnreadableError, match="EXTRN with pairs"):
        read_bulk(tmp_path / "part.pch")


def test_files_that_bulk_data_include_are_read_for_sets_and_ties_too(tmp_path: Path) -> None:
    job = lattice(tmp_path, "INCLUDE 'more.inc'")
    (tmp_path / "more.inc").write_text("GRID,9,,0.,0.,2.\nSET1,7,1,9\nRBE2,9,1,123,9\n")
    assert read_bulk(job).groups["set7"].tolist() == [1, 9]
    assert read_foreign(foreign_files(job, None, None, None)).points.tolist() == [list(point) for point in GRIDS]
    (tmp_path / "more.inc").write_text("RBE2,9,1,12,9\nGRID,9,,0.,0.,2.\nGRID,10,,0.,0.,3.\nRBE2,8,1,123,10\n")
    with pytest.raises(InputError, match=r"job\.bdf: line 5: a model is allowed in which RBE2 ties no"):
        read_foreign(foreign_files(job, None, None, None))
    (tmp_path / "more.inc").write_text("INCLUDE 'job.bdf'\n")
    with pytest.raises(
        UnreadableError, match="a file beside the deck is allowed that does not include itself"
    ) as error:
        read_bulk(job)
    assert error.value.line == 5


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("GRID,9,,0.,x,2.\n", "this line can't be read"),
        ("GRID,9,,0.,0.,2.,-1\n", "points of a structure are allowed: 9 is one of a fluid"),
        ("INCLUDE 'none.inc'\n", "INCLUDE none.inc: a file beside the deck is allowed"),
        ("GRDSET,,,,,,5\n", "grid points with CP and CD of their own are allowed, without those of GRDSET"),
    ],
)
def test_bulk_data_that_can_not_be_read_is_refused_with_its_line(text: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=rf"job\.bdf: line 5: .*{says}"):
        read_foreign(foreign_files(lattice(tmp_path, text), None, None, None))


def test_nodes_that_entries_condense_are_no_supports(tmp_path: Path) -> None:
    """A spring to the ground, so that the stiffness alone does not say it, and a grid point without rows."""
    job = lattice(tmp_path, "GRID,9,,0.,0.2,0.3\nSET1,7,2,9\nASET1,123,1,THRU,4")
    number = re.search(r"(DMIG\*   KAA +1 +1\n\* +1 +1 +)(\S+)", job.read_text())
    assert number is not None
    spring = f"{float(number[2].replace('D', 'E')) + 1e7:.9E}"
    job.write_text(job.read_text().replace(number[0], number[1] + spring))
    read = read_foreign(foreign_files(job, None, None, None))
    assert len(read.points) == 4 and read.groups["set7"].tolist() == [1] and len(read.held) == 1
    job.write_text(job.read_text().replace("ASET1,123,1,THRU,4\n", ""))
    assert len(read_foreign(foreign_files(job, None, None, None)).points) == 5
