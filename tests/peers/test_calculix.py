"""CalculiX computes the reference boom on rectangles of the same size, clamped and on its pads; needs ``ccx``.

On pads both programs hold the same weighted means with the same springs: there equations tie nodes to them.
"""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spl
from boxes import box
from peers.calculix import Deck, Mean, grid
from peers.pads import Patch
from statics import static_outputs

from pmr import scene as scenes
from pmr.fullmodel.actions import Action
from pmr.fullmodel.eigensolvers import SlepcEigenSolver, eigensolver
from pmr.fullmodel.from_scene import structure_of
from pmr.fullmodel.model import FullModel, FullSystem
from pmr.fullmodel.structure import Clamp, Structure, structural_model
from pmr.models.box_mesh import BoxBoom, write_shell
from pmr.models.named_mesh import read_mesh
from pmr.models.shell import Shell
from pmr.scene.members import member_at
from pmr.scene.profile import BoxProfile
from pmr.scene.structures import Plate, ShellBody
from pmr.simulation.statics.equilibrium import buckling_factors
from pmr.system.assembly import Assembly
from pmr.system.contacts import ALONE
from pmr.system.terms import Term

pytestmark = [pytest.mark.peers, pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) not found")]
SIZE, ALONG = 0.05, 0.1  # m
LENGTH, WIDTH, HEIGHT, WALL = 6.0, 0.3, 0.4, 0.008
TAIL, FIRST, STIFFNESS = 0.15, 1.5, 3e8  # m; where s begins, and with it the mouth's stations, m; N/m
#: Axis of the normal, the face's place along it, place across; m.
RING = [(2, z, y) for z in (-HEIGHT / 2, HEIGHT / 2) for y in (-0.1, 0.1)] + [
    (1, y, 0.0) for y in (WIDTH / 2, -WIDTH / 2)
]


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


def simpson(nodes: np.ndarray) -> np.ndarray:
    """Shares of nodes around the section in its mean: a vertex, the middle of a side, a vertex and so on."""
    return np.where(np.arange(len(nodes)) % 2 == 0, 1.0, 2.0) / 3.0 * 2.0 / len(nodes)


def tip_deflection(deck: Deck, direction: int, folder: Path) -> float:
    """Mean at the tip in m under 1 kN, spread in the same way."""
    nodes = deck.sets["TIP"]
    share = simpson(nodes)
    loads = [(n, direction, 1e3 * w) for n, w in zip(nodes, share, strict=True)]
    return float(share @ deck.displacements(loads, "TIP", folder)[:, direction - 1])


def peer_on_pads(s: float) -> Deck:
    """Twelve pads and the cylinder of the scene, in place of the clamp."""
    deck = peer()
    deck.held = []
    patches = [
        Patch(normal, place, along, across, lattice)
        for along, lattice in ((TAIL, TAIL), (s, FIRST))
        for normal, place, across in RING
    ]
    cylinder = np.zeros(len(deck.points))
    cylinder[deck.sets["TAIL"]] = simpson(deck.sets["TAIL"])
    pads = [Mean(patch.shares(deck.points, deck.quads), patch.normal + 1, STIFFNESS) for patch in patches]
    deck.means = [*pads, Mean(cylinder, 1, np.inf)]
    return deck


def static_tip(model: FullModel, s: float) -> tuple[float, float]:
    """Ours under 1 kN, vertical and lateral, with the rows as springs."""
    whole, C = model.gather(), model.rows.at(s)
    assert whole is not None
    names, inputs = model.output_names, [model.input_names.index(name) for name in ("tip force", "gust")]
    right = np.vstack([whole.B[:, inputs], np.zeros((C.shape[0], 2))])
    system = sp.bmat([[whole.K, C.T], [C, -sp.diags(model.rows.compliance)]], format="csc")
    y = 1e3 * whole.outputs @ spl.splu(system).solve(right)[: whole.size]
    return float(y[names.index("tip z"), 0]), float(y[names.index("tip y"), 1])


@pytest.fixture(scope="module")
def ours_on_pads() -> FullModel:
    """workflows/boom_shell.toml without its payload, on the peer's rectangles."""
    scene = scenes.load("boom_shell", [f"mesh.size={SIZE}", f"mesh.along={ALONG}", "masses=[]"])
    return structural_model(structure_of(member_at(scene)))


@pytest.fixture(scope="module")
def ours(tmp_path_factory):
    file = tmp_path_factory.mktemp("boom") / "m.msh"
    write_shell(BoxBoom(BoxProfile(width=WIDTH, height=HEIGHT, wall=WALL).sides, LENGTH, SIZE, ALONG), file)
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


def test_the_deck_is_read_as_the_boom_that_it_is(ours, tmp_path: Path) -> None:
    """With its nodes in a file that it includes: the frequencies are those of CalculiX and of the boom drawn by pmr."""
    expected = peer().frequencies(4, tmp_path)
    deck = tmp_path / "deck.inp"
    nodes, elements = deck.read_text().split("*ELEMENT", 1)
    (tmp_path / "nodes.inc").write_text(nodes)
    deck.write_text(f"*INCLUDE, INPUT=nodes.inc\n*ELEMENT{elements}")
    shell = Shell(ShellBody(plate=Plate(thickness=WALL)), read_mesh(deck, ("triangle",)))
    full = structural_model(Structure(shell, (Clamp("TAIL"),)))
    found = SlepcEigenSolver(full).lowest(0.0, 4).omega / (2.0 * np.pi)
    assert found == pytest.approx(expected, rel=5e-4)
    assert found == pytest.approx(SlepcEigenSolver(ours).lowest(0.0, 4).omega / (2.0 * np.pi), rel=1e-9)


def test_tip_deflections_agree(ours, tmp_path: Path) -> None:
    """1 kN spread over the perimeter, Simpson's rule on each side of a rectangle; the mean that works with it."""
    deck = peer()
    assert simpson(deck.sets["TIP"]).sum() == pytest.approx(1.0)
    assert static_outputs(ours).item() * 1e3 == pytest.approx(tip_deflection(deck, 3, tmp_path), rel=5e-4)


def test_pads_of_the_peer_are_those_of_the_definition() -> None:
    """Between stations: weights add up to one, the centre is the pad's, the spread that of the spline and the hat."""
    deck, along = peer(), 2.763
    for normal, place, across in RING:
        share = Patch(normal, place, along, across, FIRST).shares(deck.points, deck.quads)
        x, y = deck.points[:, 0] - along, deck.points[:, 3 - normal] - across
        assert share @ np.stack([x**0, x, y], axis=1) == pytest.approx([1.0, 0.0, 0.0], abs=1e-12)
        assert share @ x**2 == pytest.approx(0.06**2 / 3.0 + 0.03**2 / 6.0)
        assert share @ y**2 == pytest.approx(0.02**2 / 3.0)


@pytest.mark.parametrize("s", [1.5, 2.75])
def test_frequencies_on_pads_agree(ours_on_pads: FullModel, s: float, tmp_path: Path) -> None:
    """Measured at 1.5 and 2.75 m: first vertical mode 0.06 and 0.13 %; first two lateral 0.3 and 0.4 %, 0.1 and 0.6 %.

    Those that distort the walls, the third of all among them: 0.8 and 1 %, above that 1.7 % at most, as without pads.
    Lateral modes are worse than vertical ones, for the side pads press on the middle of thin walls, and how a wall
    gives way under a pad is what a mesh resolves least, in either program.
    """
    found = eigensolver(ours_on_pads, "auto").lowest(s, 8).omega / (2.0 * np.pi)
    off = np.abs(peer_on_pads(s).frequencies(8, tmp_path) / found - 1.0)
    assert np.all(off < [0.004, 0.0015, 0.011, 0.006, *4 * [0.018]])


@pytest.mark.parametrize("s", [1.5, 2.75])
def test_tip_deflections_on_pads_agree(ours_on_pads: FullModel, s: float, tmp_path: Path) -> None:
    """Measured at 1.5 and 2.75 m: vertical 0.11 and 0.14 %, lateral 0.58 and 0.54 %.

    Of the lateral 3.05 and 1.01 mm only 1.15 and 0.58 mm are there if the section can not deform (boom_beam); the rest
    is walls that give way under the side pads.
    """
    deck = peer_on_pads(s)
    vertical, lateral = (tip_deflection(deck, direction, tmp_path) for direction in (3, 2))
    found = static_tip(ours_on_pads, s)
    assert found[0] == pytest.approx(vertical, rel=2e-3)
    assert found[1] == pytest.approx(lateral, rel=7e-3)


@pytest.mark.slow
def test_buckling_under_an_end_load(tmp_path: Path) -> None:
    """To 2 %: 1.0 % measured.  The next one, of the walls beside the free end, is 2.6 % off on meshes so coarse.

    Each program finds the stresses of the end load by itself.
    """
    deck, load = peer(0.1), 1e6
    nodes = deck.sets["TIP"]
    loads = [(n, 1, -load * share) for n, share in zip(nodes, simpson(nodes), strict=True)]
    expected = load * deck.buckling_factors(loads, 2, tmp_path)
    model = Shell(ShellBody(plate=Plate(thickness=WALL)), box(LENGTH, 24, 3))
    full = structural_model(Structure(model, (Clamp("tail"),), matrices=("axial tip",)))
    system = FullSystem.of(full).gather()
    assert system is not None
    term = Term("end load", (ALONE,), stiffness=system.bodies[ALONE].matrices["axial tip"])
    assembly = Assembly(replace(system, terms=(term,)))
    assert buckling_factors(assembly, np.zeros(0), {"end load": -1.0}) == pytest.approx(expected[:1], rel=0.02)
