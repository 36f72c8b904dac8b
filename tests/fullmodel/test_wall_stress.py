"""Stress in the walls of a box under pads: similar boxes, smaller cells, a whole shell, and limits that follow."""

import numpy as np
import pytest

import pmr
from pmr.errors import InputError
from pmr.fullmodel import wall_stress
from pmr.fullmodel.pads import Pad
from pmr.fullmodel.wall_compliance import HeldModel, PlateBody, beam_of, shell_of
from pmr.fullmodel.wall_stress import (
    EDGE_MARGIN,
    Estimate,
    LoadedRing,
    PadStress,
    SectionPiece,
    SectionStates,
    estimates_of_pads,
    wall_peak,
    yield_forces,
)
from pmr.models.meshed import node_fits
from pmr.models.shell import draw_box
from pmr.results.field_series import mean_by_place
from pmr.results.field_stress import FORCES, PLANE, von_mises
from pmr.scene import Scene
from pmr.scene.joints import BoomSection

pytest.importorskip("gmsh")


def section(by: float = 1.0, **keys: object) -> BoomSection:
    """A square box of 1.2 m, all of whose lengths are `by` times as large; further `keys` of the box."""
    sizes = {key: by * size for key, size in {"length": 1.2, "width": 0.2, "height": 0.2, "wall": 0.006}.items()}
    scene = pmr.load_scene("boom_three")
    part = scene.sections[1]
    box = part.body.box
    assert box is not None
    return part.with_keys(body={"box": type(box).model_validate(sizes | keys)})


def pad(by: float = 1.0) -> Pad:
    return Pad("pad", "bottom", 0.0, by * 0.05, by * 0.16, by * 0.05)


def largest(part: BoomSection, pad: Pad, x: float) -> Estimate:
    """Largest von Mises stress in Pa/N of a pad alone at x m on a section."""
    piece = SectionPiece(part, pad.length, pad.width)
    (estimate,) = estimates_of_pads(*piece.stresses([pad], float(piece.place(np.array(x)))))
    piece.destroy()
    return estimate


def test_a_value_and_its_bar_follow_from_two_meshes_by_an_error_of_second_order() -> None:
    """8 + 100 h^2 with cells of h = 1/10 and 1/20 has the limit 8."""
    assert Estimate.from_meshes(9.0, 8.25, 0.05) == pytest.approx((8.0, 0.25 + 0.05 * 8.0))


def test_the_bar_is_larger_where_the_largest_stress_is_on_an_edge() -> None:
    stresses = np.array([[[9.0, 0.0, 0.0], [1.0, 0.0, 0.0]], [[1.0, 0.0, 0.0], [9.0, 0.0, 0.0]]])
    ring = wall_stress.RingStress(np.zeros((2, 3)), np.ones(2), stresses, np.array([0.0, 1.0]))
    assert [of.error / 9.0 for of in estimates_of_pads(ring, ring)] == pytest.approx([wall_stress.MARGIN, EDGE_MARGIN])


def test_values_at_nodes_are_those_of_a_quadratic_field_up_to_the_edges_of_each_wall() -> None:
    box = section().body.box
    assert box is not None
    mesh = shell_of(PlateBody(draw_box(box, 0.05, 0.1), box, section().body.material, 5.0 / 6.0)).mesh
    x, y, z = mesh.points[mesh.cells].mean(axis=1).T
    (fits, on_edge), number = node_fits(mesh), 0
    for name, of_wall in mesh.regions.items():
        points = mesh.points[np.unique(mesh.cells[of_wall])]
        across, apart = (y, points[:, 1]) if name in ("bottom", "top") else (z, points[:, 2])
        field, expected = (2.0 + u * v - 3.0 * u**2 + 40.0 * v**2 for u, v in ((x, across), (points[:, 0], apart)))
        rows = fits[number : number + len(points)]
        np.testing.assert_allclose(rows @ field, expected, atol=1e-10)
        assert not rows[:, np.setdiff1d(np.arange(len(mesh.cells)), of_wall)].nnz  # the next wall has another stress
        corners = np.isclose(np.abs(points[:, 1:]), 0.1).all(axis=1)
        assert on_edge[number : number + len(points)].tolist() == corners.tolist()
        number += len(points)
    assert number == fits.shape[0]


@pytest.mark.slow
def test_of_similar_boxes_the_stress_by_a_newton_falls_with_the_square_of_their_size() -> None:
    """Elasticity has no length of its own, so cells, pads and walls that are all 1.5 times as large give it exactly."""
    stress, larger = ([largest(section(by), pad(by), by * x).value for x in (0.6, 0.1)] for by in (1.0, 1.5))
    assert larger == pytest.approx(np.array(stress) / 1.5**2, rel=1e-6)
    assert stress[1] > 1.02 * stress[0]  # near an open end walls are softer


@pytest.mark.slow
@pytest.mark.parametrize(
    ("keys", "size", "face", "across", "x"),
    [
        ({}, (0.16, 0.05), "bottom", 0.05, 0.1),
        ({}, (0.12, 0.05), "bottom", 0.075, 0.6),  # its side lies on the edge where two walls meet
        ({"width": 0.14, "height": 0.2, "wall": 0.004}, (0.15, 0.03), "left", 0.0825, 0.6),
        ({"width": 0.3, "height": 0.16, "wall": 0.01}, (0.1, 0.08), "top", 0.0, 0.3),
    ],
)
def test_cells_two_thirds_as_large_give_a_stress_within_the_bar(
    monkeypatch: pytest.MonkeyPatch,
    keys: dict[str, float],
    size: tuple[float, float],
    face: str,
    across: float,
    x: float,
) -> None:
    part, of_case = section(**keys), Pad("pad", face, 0.0, across, *size)
    on_its_cells = largest(part, of_case, x)
    monkeypatch.setattr(wall_stress, "ALONG", 1.5 * wall_stress.ALONG)
    monkeypatch.setattr(wall_stress, "ACROSS", 1.5 * wall_stress.ACROSS)
    on_smaller = largest(part, of_case, x)
    assert abs(on_smaller.value - on_its_cells.value) < on_its_cells.error < 0.12 * on_its_cells.value
    assert on_smaller.error < on_its_cells.error


@pytest.mark.slow
def test_local_and_whole_stress_add_up_to_that_of_a_shell_of_the_whole_section() -> None:
    """Two pads at the middle of a long box bend, twist and dent it together; others near its ends hold and bend it.

    The whole box is a shell on cells as large as those of the pieces.  What is left between both is the shear of the
    transverse force, and the ends of the piece.
    """
    part, size = section(length=2.0), (0.24, 0.08)
    box = part.body.box
    assert box is not None
    middle = [Pad("a", "bottom", 1.0, 0.05, *size), Pad("b", "left", 1.0, -0.05, *size)]
    ends = [Pad("c", on, x, 0.0, *size) for x in (0.3, 1.7) for on in ("bottom", "left")]
    ends += [Pad("d", "bottom", x, 0.0, *size) for x in (0.2, 1.8)]
    f = np.array([2e3, 1e3, 59e3, -0.5e3, 59e3, -0.5e3, -60e3, -60e3])  # N, outwards

    def whole(fineness: int) -> float:
        cells = size[1] / (fineness * wall_stress.ACROSS), size[0] / (fineness * wall_stress.ALONG)
        body = PlateBody(draw_box(box, *cells), box, part.body.material, part.body.shear_correction)
        shell = shell_of(body)
        model, rows, fits = HeldModel(shell, body), shell.stresses(), node_fits(shell.mesh).matrix
        (stress,) = rows.evaluate((model.under_pads([*middle, *ends]) @ f)[None])
        model.destroy()
        on = [rows.points_on(face) for face in ("outer", "inner")]
        near = np.concatenate([np.abs((fits @ rows.points[of])[:, 0] - 1.0) < size[0] for of in on])
        return float(von_mises(np.concatenate([fits @ stress[of] for of in on]), PLANE)[near].max())

    body = PlateBody(draw_box(box, 0.05, 0.05), box, part.body.material, part.body.shear_correction)
    line = beam_of(body)
    held, forces = HeldModel(line, body), line.section_forces()
    values = forces.rows @ (held.under_pads([*middle, *ends]) @ f)
    held.destroy()
    names, along = np.array(forces.names), np.unique(forces.x.round(9))
    by_name = [mean_by_place(forces.x[names == name], values[None, names == name])[1] for name in FORCES]
    states = SectionStates(along, np.stack(by_name, axis=1))
    peak = wall_peak(part, states, [LoadedRing(tuple(middle), np.array([1.0]), -f[None, :2])])
    assert peak is not None
    expected = Estimate.from_meshes(*map(whole, wall_stress.FINENESS), 0.0)
    assert abs(peak.stress.value - expected.value) < peak.stress.error < 0.15 * peak.stress.value
    states_at_rest = SectionStates(along, 0.0 * states.forces)
    local = wall_peak(part, states_at_rest, [LoadedRing(tuple(middle), np.array([1.0]), -f[None, :2])])
    assert local is not None and abs(local.stress.value - expected.value) > local.stress.error


def test_the_largest_stress_is_that_at_its_time_and_of_the_ring_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """With local stresses of 1 Pa/N at one point, forces alone decide; without pads there is no stress."""
    point = wall_stress.RingStress(
        np.array([[0.1, 0.1, 0.0]]), np.array([0.006]), np.array([[[1.0, 0.0, 0.0]]]), np.zeros(1)
    )
    monkeypatch.setattr(SectionPiece, "stresses", lambda piece, pads, place: [point, point])
    states = SectionStates(np.array([0.0, 1.2]), np.zeros((3, len(FORCES), 2)))
    weak, strong = (
        LoadedRing((pad(),), np.array([0.3, 0.4, 0.5]), force * np.array([[1.0], [3.0], [2.0]])) for force in (1.0, 7.0)
    )
    peak = wall_peak(section(), states, [weak, strong, weak])
    assert peak is not None and (peak.stress, peak.state) == ((21.0, 0.01 * 21.0), 1)
    assert peak.position.tolist() == pytest.approx([0.5, 0.1, 0.0])
    assert wall_peak(section(), states, []) is None


def test_a_place_near_an_end_is_as_far_from_the_end_of_the_piece() -> None:
    piece = SectionPiece(section(), 0.16, 0.05)
    assert piece.length == pytest.approx(0.76)
    assert piece.place(np.array([0.1, 0.5, 0.9, 1.1])).tolist() == pytest.approx([0.1, 0.38, 0.46, 0.66])


def test_walls_that_change_along_a_section_are_refused() -> None:
    doubler = {"start": 0.4, "end": 0.8, "thickness": 0.004}
    other_plate = section().with_keys(body={"regions": {"bottom": {"thickness": 0.01}}})
    for part in (section(doublers=[doubler]), other_plate):
        with pytest.raises(InputError, match="walls that stay the same along the section"):
            SectionPiece(part, 0.16, 0.05)


def test_the_weaker_wall_of_a_joint_decides_and_joints_without_a_yield_stress_are_left_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Pads press on both sections of a joint; a section without yield stress takes its own joint and the next away."""
    scene = pmr.load_scene("boom_three")
    assert isinstance(scene, Scene)
    strong = scene.vary_sections(lambda part: {"body": {"material": {"yield_stress": 350e6}}})
    by_section = dict(zip(strong.names, (2e3, 1e3, 4e3), strict=True))  # Pa/N

    def stresses(scene: Scene, number: int) -> list[PadStress]:
        stress = Estimate(by_section[scene.names[number]], 0.0)
        return [PadStress(joint, "pad", stress) for joint in (number, number + 1) if 0 < joint < 3]

    monkeypatch.setattr(wall_stress, "largest_pad_stresses", stresses)
    forces = yield_forces(strong)
    inner, outer = strong.names[2], strong.names[1]
    assert {name: (of.force, of.section) for name, of in forces.items()} == {
        outer: (350e6 / 2e3, strong.names[0]),
        inner: (350e6 / 4e3, inner),
    }
    last = strong.sections[2].with_keys(body={"material": {"yield_stress": None}})
    assert list(yield_forces(strong.with_keys(sections=(*strong.sections[:2], last)))) == [outer]
