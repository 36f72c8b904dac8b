"""CalculiX computes the reference boom on rectangles of the same size; optional, for it needs ``ccx``."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from peers.calculix import Deck, grid
from statics import static_outputs

from pmr.mesh import read_mesh
from pmr.mesh.box import BoxBoom, write_shell
from pmr.models.shell import Shell
from pmr.scene.structures import Plate, ShellBody
from pmr.snapshots.eigensolvers import SlepcEigenSolver
from pmr.structure import Action, Clamp, Structure, structural_model

pytestmark = [pytest.mark.peers, pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) not found")]
SIZE, ALONG = 0.05, 0.1  # m
LENGTH, WIDTH, HEIGHT, WALL = 6.0, 0.3, 0.4, 0.008


def around(v: np.ndarray) -> np.ndarray:
    """Places (N, 2) on the section's perimeter, counted in rectangles of `SIZE`."""
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * [WIDTH / 2, HEIGHT / 2]
    at = np.cumsum([0.0, WIDTH, HEIGHT, WIDTH, HEIGHT]) / (2 * (WIDTH + HEIGHT))
    return np.stack([np.interp(v, at, corners[:, i]) for i in (0, 1)], axis=1)


def peer(size: float = SIZE) -> Deck:
    counts = round(LENGTH / ALONG), round(2 * (WIDTH + HEIGHT) / size)
    points, quads, number = grid(lambda u, v: np.column_stack([LENGTH * u, around(v)]), counts, closed=True)
    sets = {"TAIL": np.unique(number[0]), "TIP": number[-1, :-1]}
    return Deck(points, quads, WALL, sets=sets, held=[("TAIL", 1, 6)])


@pytest.fixture(scope="module")
def ours(tmp_path_factory):
    file = tmp_path_factory.mktemp("boom") / "m.msh"
    write_shell(BoxBoom(LENGTH, WIDTH, HEIGHT, WALL, SIZE, ALONG), file)
    tip = Action("tip", "tip", "z")
    shell = Shell(ShellBody(plate=Plate(thickness=WALL)), read_mesh(file, ("triangle",)))
    return structural_model(Structure(shell, (Clamp("tail"),), (), (tip,), (tip,)))


def test_frequencies_agree(ours, tmp_path: Path) -> None:
    """The first four on the same rectangles to 0.05 %; those that distort the walls with CalculiX' limit, to 0.4 %.

    Its wall modes are stiff in proportion to the size around the section (`test_reference_boom`): 1.4 % on this mesh.
    """
    coarse, fine = (peer(size).frequencies(8, tmp_path) for size in (SIZE, SIZE / 2))
    found = SlepcEigenSolver(ours).lowest(0.0, 8).omega / (2.0 * np.pi)
    assert found[:4] == pytest.approx(coarse[:4], rel=5e-4)
    assert found[4:] == pytest.approx(2 * fine[4:] - coarse[4:], rel=4e-3)
    assert np.all(coarse[4:] > fine[4:]) and np.all(fine[4:] > found[4:])


def test_tip_deflections_agree(ours, tmp_path: Path) -> None:
    """1 kN spread over the perimeter, Simpson's rule on each side of a rectangle; the mean that works with it."""
    deck = peer()
    nodes = deck.sets["TIP"]
    share = np.where(np.arange(len(nodes)) % 2 == 0, 1.0, 2.0) / 3.0 * 2.0 / len(nodes)
    deflection = deck.displacements([(n, 3, 1e3 * w) for n, w in zip(nodes, share, strict=True)], "TIP", tmp_path)
    assert share.sum() == pytest.approx(1.0)
    assert static_outputs(ours).item() * 1e3 == pytest.approx(share @ deflection[:, 2], rel=5e-4)
