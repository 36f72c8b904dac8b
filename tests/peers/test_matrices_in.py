"""Matrices that CalculiX assembled of the reference boom, the whole way; needs ``ccx``."""

import shutil
import subprocess
import tomllib
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from peers.solid_boom import SolidBoom, solid_boom

from pmr import pipeline as whole
from pmr import scene as scenes
from pmr.files.foreign import ForeignFiles, foreign_files, read_foreign
from pmr.files.matrices import GivenMatrices
from pmr.fullmodel.build import build
from pmr.fullmodel.eigensolvers import eigensolver
from pmr.fullmodel.structure import Clamp, Structure, structural_model
from pmr.models.matrices import Matrices

pytestmark = [pytest.mark.peers, pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) not found")]
WORKFLOWS = Path(__file__).parents[2] / "workflows"


def read(boom: SolidBoom, folder: Path) -> GivenMatrices:
    stiffness = boom.matrices(folder)
    return read_foreign(ForeignFiles(stiffness, *(stiffness.with_suffix(s) for s in (".mas", ".dof", ".inp"))))


def scene_on(given: GivenMatrices, folder: Path, **sections: object) -> scenes.Scene:
    """The scene of the reference boom on given matrices."""
    data = tomllib.loads((WORKFLOWS / "boom.toml").read_text())
    del data["body"]["box"]
    data["body"]["model"], data["mesh"] = "matrices", {"file": str(given.save(folder / "boom.npz"))}
    return scenes.Scene.model_validate(data | sections)


def test_frequencies_are_those_of_calculix(tmp_path: Path) -> None:
    """Files of 14 digits leave 1e-6: entries of 4e11 N/m are off by 1e-3, and 3e6 of them add up."""
    boom = solid_boom(60, 6, 8)
    given = read(boom, tmp_path)
    (tmp_path / "clamped").mkdir()
    expected = boom.frequencies(4, tmp_path / "clamped")
    full = structural_model(Structure(Matrices(given), clamps=(Clamp("tail"),)))
    found = eigensolver(full, "slepc").lowest(0.5, 4).omega / (2.0 * np.pi)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_the_whole_way_and_beside_a_solid(tmp_path: Path) -> None:
    """Reduced against full 0.1 % at most; on pads the lowest frequencies of a solid of FEniCSx with cells of that size.

    These are 4 % and 1.4 % lower: its cells have 27 nodes, CalculiX's 20, and walls under pads are what a mesh decides.
    """
    given = read(solid_boom(60, 6, 8), tmp_path)
    path = {"kind": "smooth_ramp", "times": [0.0, 0.4], "values": [1.5, 2.5]}
    compare = {"against": ["full"]}
    case = scene_on(given, tmp_path, time={"end": 0.4, "step": 1e-3}, slider={"path": path}, compare=compare)
    outcome = whole.run(case)
    assert outcome is not None
    errors = outcome.result.summary["errors"]["reduced_vs_full"]
    assert max(errors["tip"], errors["beam"]) < 1e-3
    assert outcome.result.summary["coordinates"] == {"full": given.size, "reduced": 10}
    solid = scenes.load(WORKFLOWS / "boom_solid.toml", ["mesh.size=0.05", "mesh.along=0.1"])
    found, beside = (eigensolver(build(one).model, "slepc").lowest(2.0, 2).omega for one in (case, solid))
    assert np.all((found > beside) & (found < 1.05 * beside))


def tied_bars(how: str) -> str:
    """Deck of two bars of bricks whose coincident nodes are joined by equations or a tie, on a clamped tail."""
    ends = ((-0.25, -0.3), (0.25, -0.3), (0.25, 0.3), (-0.25, 0.3))
    places = [(1.5 * i + 3.0 * part, y, z) for part in (0, 1) for i in range(3) for y, z in ends]
    lines = ["*NODE", *(f"{k}, {x}, {y}, {z}" for k, (x, y, z) in enumerate(places, 1))]
    lines += ["*ELEMENT, TYPE=C3D8, ELSET=all"]
    for k, first in enumerate((1, 5, 13, 17), 1):
        lines += [f"{k}, " + ", ".join(str(first + n) for n in range(8))]
    lines += ["*NSET, NSET=tail", "1, 2, 3, 4", "*NSET, NSET=tip", "21, 22, 23, 24"]
    if how == "EQUATION":
        lines += ["*EQUATION"]
        lines += [f"2\n{13 + k}, {d}, 1.0, {9 + k}, {d}, -1.0" for k in range(4) for d in (1, 2, 3)]
    else:
        lines += ["*SURFACE, NAME=begin", "3, S1", "*SURFACE, NAME=end", "2, S2"]
        lines += ["*TIE, NAME=joint, POSITION TOLERANCE=0.01", "begin, end"]
    lines += ["*MATERIAL, NAME=steel", "*ELASTIC", "2.1e11, 0.3", "*DENSITY", "7850.0"]
    lines += ["*SOLID SECTION, MATERIAL=steel, ELSET=all", "*BOUNDARY", "tail, 1, 3", "*STEP"]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("how", ["EQUATION", "TIE"])
def test_nodes_that_calculix_ties_are_left_out_of_its_matrices(how: str, tmp_path: Path) -> None:
    for name, option in (("job", ", SOLVER=MATRIXSTORAGE"), ("own", "")):
        (tmp_path / f"{name}.inp").write_text(f"{tied_bars(how)}*FREQUENCY{option}\n4\n*END STEP\n")
        subprocess.run(["ccx", name], cwd=tmp_path, check=True, capture_output=True, timeout=60)
    given = read_foreign(foreign_files(tmp_path / "job.sti", None, None, None))
    assert len(given.points) == 20 and len(given.held) == 6
    found = np.sqrt(scipy.linalg.eigh(given.K.toarray(), given.M.toarray(), eigvals_only=True)[:4]) / (2.0 * np.pi)
    rows = [line.split() for line in (tmp_path / "own.dat").read_text().splitlines()]
    expected = [float(row[3]) for row in rows if len(row) == 5 and row[0] in "1234"][:4]
    assert found == pytest.approx(expected, rel=1e-6)
