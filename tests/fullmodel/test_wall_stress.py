"""Stress in the walls of a box under pads: similar boxes, smaller cells, a whole shell, and limits that follow."""

from collections.abc import Callable, Iterator
from dataclasses import astuple, replace

import numpy as np
import pytest

import pmr
from pmr.errors import InputError
from pmr.files.arrays import Array
from pmr.fullmodel import wall_stress
from pmr.fullmodel.pads import Pad
from pmr.fullmodel.wall_compliance import HeldModel, PlateBody, beam_of, shell_of
from pmr.fullmodel.wall_stress import (
    EDGE_MARGIN,
    ByPressure,
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
from pmr.models.shell import boom_of_box
from pmr.results.field_series import mean_by_place
from pmr.results.field_stress import FORCES, PLANE, von_mises
from pmr.scene import Scene
from pmr.scene.joints import BoomSection
from pmr.system.polynomials import cardinal_spline, value_or_zero

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


def largest(part: BoomSection, pad: Pad, *at: float) -> list[Estimate]:
    """Largest von Mises stress in Pa/N of a pad alone at each of these places in m on a section."""
    piece = SectionPiece(part, pad.length, pad.width)
    estimates = [estimates_of_pads(*piece.stresses([pad], float(x)))[0].middle for x in piece.place(np.array(at))]
    piece.destroy()
    return estimates


def test_a_value_and_its_bar_follow_from_two_meshes_by_an_error_of_second_order() -> None:
    """8 + 100 h^2 with cells of h = 1/10 and 1/20 has the limit 8."""
    assert Estimate.from_meshes(9.0, 8.25, 0.05) == pytest.approx((8.0, 0.25 + 0.05 * 8.0))


def test_the_bar_is_larger_where_the_largest_stress_is_on_an_edge() -> None:
    stresses = np.array([[[9.0, 0.0, 0.0], [1.0, 0.0, 0.0]], [[1.0, 0.0, 0.0], [9.0, 0.0, 0.0]]])
    ring = wall_stress.RingStress(
        np.zeros((2, 3)), np.ones(2), np.stack([stresses, stresses[::-1] / 3.0]), np.arange(2.0)
    )
    within, at_edge = estimates_of_pads(ring, ring)
    assert (within.middle.error / 9.0, at_edge.middle.error / 9.0) == pytest.approx((wall_stress.MARGIN, EDGE_MARGIN))
    assert (within.even.error / 3.0, at_edge.even.error / 3.0) == pytest.approx((EDGE_MARGIN, wall_stress.MARGIN))


def test_values_at_nodes_are_those_of_a_quadratic_field_up_to_the_edges_of_each_wall() -> None:
    box = section().body.box
    assert box is not None
    mesh = shell_of(PlateBody(boom_of_box(box, 0.05, 0.1), box, section().body.material, 5.0 / 6.0)).mesh
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
    on_both = (largest(section(by), pad(by), 0.6 * by, 0.1 * by) for by in (1.0, 1.5))
    stress, larger = ([estimate.value for estimate in estimates] for estimates in on_both)
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
    (on_its_cells,) = largest(part, of_case, x)
    monkeypatch.setattr(wall_stress, "ALONG", 1.5 * wall_stress.ALONG)
    monkeypatch.setattr(wall_stress, "ACROSS", 1.5 * wall_stress.ACROSS)
    (on_smaller,) = largest(part, of_case, x)
    assert abs(on_smaller.value - on_its_cells.value) < on_its_cells.error < 0.12 * on_its_cells.value
    assert on_smaller.error < on_its_cells.error


def clamped_strip(
    width: float, t: float, nu: float, along: Array, across: Callable[[Array], Array], period: float
) -> float:
    r"""Largest von Mises stress in Pa/N of Kirchhoff's plate, a strip whose edges at y = -+ width / 2 are clamped.

    The pressure is a sum of p_k v(y) cos(a x) with a = 2 pi k / period.  So is the deflection, of w_k(y) cos(a x), with
    w_k^(4) - 2 a^2 w_k^(2) + a^4 w_k = p_k v / D, which cubic Hermite elements solve.  `along` (k,) is the Fourier
    transform of the pressure's distribution along x at the wave numbers a, and `across` the function v.
    """
    n, (g, weights) = 120, np.polynomial.legendre.leggauss(6)
    h, z, D = width / n, (g + 1.0) / 2.0, t**3 / 12.0 / (1.0 - nu**2)  # for E = 1, on which stresses do not depend
    hermite = [np.poly1d(c) for c in ([2, -3, 0, 1], [h, -2 * h, h, 0], [-2, 3, 0, 0], [h, -h, 0, 0])]
    value, slope, curvature = (np.array([f.deriv(m)(z) for f in hermite]) / h**m for m in range(3))
    bent, sloped, moved = (h / 2.0 * (f * weights) @ f.T for f in (curvature, slope, value))
    dofs = 2 * np.arange(n)[:, None] + np.arange(4)
    force = np.zeros(2 * n + 2)
    for e in range(n):
        force[dofs[e]] += h / 2.0 * value @ (weights * across(h * (e + z) - width / 2.0))
    ends, x = np.array([f.deriv(2)(0.0) for f in hermite]) / h**2, np.linspace(0.0, period / 4.0, 100)
    moments = np.zeros((len(x), n, 3))
    for k, transform in enumerate(along):
        a, K = 2.0 * np.pi * k / period, np.zeros((2 * n + 2, 2 * n + 2))
        for of in dofs:
            K[np.ix_(of, of)] += D * (bent + 2.0 * a**2 * sloped + a**4 * moved)
        w = np.zeros(2 * n + 2)
        w[2:-2] = np.linalg.solve(K[2:-2, 2:-2], (1.0 if k == 0 else 2.0) / period * transform * force[2:-2])
        w_xx, w_yy, w_y = -(a**2) * w[0:-2:2], w[dofs] @ ends, w[1:-2:2]
        of_k = -D * np.stack([w_xx + nu * w_yy, w_yy + nu * w_xx, -(1.0 - nu) * a * w_y], axis=-1)
        moments += of_k * np.stack([np.cos(a * x), np.cos(a * x), np.sin(a * x)], axis=-1)[:, None]
    return float(von_mises(6.0 / t**2 * moments, PLANE).max())


@pytest.mark.slow
@pytest.mark.parametrize(("length", "width"), [(0.16, 0.05), (0.1, 0.08)])
def test_walls_that_pads_press_alike_from_all_sides_bend_as_clamped_plates(length: float, width: float) -> None:
    """Equal pads in the middle of all four walls of a square box turn none of its edges: each wall is a clamped plate.

    The pressure that is largest in the middle is a cubic spline with knots at a fourth of the width and, along the pad,
    at a fifth of the length, there linear between points at a tenth.  The even one is a box function.
    """
    part, t, b = section(), 0.006, 0.2
    piece = SectionPiece(part, length, width)
    pads = [Pad("pad", face, 0.0, 0.0, length, width) for face in ("bottom", "top", "left", "right")]
    coarse, fine = piece.stresses(pads, float(piece.place(np.array(0.6))))
    piece.destroy()
    a = 2.0 * np.arange(200) / piece.length  # over pi
    spline = cardinal_spline(3, width / 4.0)
    pressures = [
        (
            np.sinc(a * length / 10.0) ** 4 * np.sinc(a * length / 20.0) ** 2,
            lambda y: 4.0 / width * value_or_zero(spline, y),
        ),
        (np.sinc(a * length / 2.0), lambda y: np.where(np.abs(y) < width / 2.0, 1.0 / width, 0.0)),
    ]
    values = list[float]()
    for number, (along, across) in enumerate(pressures):
        first, second = (von_mises(on.unit[number].sum(axis=0), PLANE) for on in (coarse, fine))
        at = int(second.argmax())
        shell = Estimate.from_meshes(float(first.max()), float(second[at]), fine.margin(at))
        values.append(clamped_strip(b, t, part.body.material.poisson, along, across, piece.length))
        assert abs(shell.value - values[-1]) < shell.error < 0.15 * shell.value
    assert values[1] < 0.75 * values[0]


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
        body = PlateBody(boom_of_box(box, *cells), box, part.body.material, part.body.shear_correction)
        shell = shell_of(body)
        model, rows, fits = HeldModel(shell, body), shell.stresses(), node_fits(shell.mesh).matrix
        (stress,) = rows.evaluate((model.under_pads([*middle, *ends])[:, : len(f)] @ f)[None])
        model.destroy()
        on = [rows.points_on(face) for face in ("outer", "inner")]
        near = np.concatenate([np.abs((fits @ rows.points[of])[:, 0] - 1.0) < size[0] for of in on])
        return float(von_mises(np.concatenate([fits @ stress[of] for of in on]), PLANE)[near].max())

    body = PlateBody(boom_of_box(box, 0.05, 0.05), box, part.body.material, part.body.shear_correction)
    line = beam_of(body)
    held, forces = HeldModel(line, body), line.section_forces()
    values = forces.rows @ (held.under_pads([*middle, *ends])[:, : len(f)] @ f)
    held.destroy()
    names, along = np.array(forces.names), np.unique(forces.x.round(9))
    by_name = [mean_by_place(forces.x[names == name], values[None, names == name])[1] for name in FORCES]
    states = SectionStates(along, np.stack(by_name, axis=1))
    peak = wall_peak(part, states, [LoadedRing(tuple(middle), np.array([1.0]), -f[None, :2])])
    assert peak is not None
    expected = Estimate.from_meshes(*map(whole, wall_stress.FINENESS), 0.0)
    stress = peak.stress.middle
    assert abs(stress.value - expected.value) < stress.error < 0.15 * stress.value
    states_at_rest = SectionStates(along, 0.0 * states.forces)
    local = wall_peak(part, states_at_rest, [LoadedRing(tuple(middle), np.array([1.0]), -f[None, :2])])
    assert local is not None and abs(local.stress.middle.value - expected.value) > local.stress.middle.error


def test_the_largest_stress_is_that_at_its_time_and_of_the_ring_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Local stresses are 1 Pa/N, or 0.5 Pa/N if pads press evenly, so that forces alone decide.

    At a pad in the middle of the wall they are 0.5 and 2 Pa/N.  Without pads there is no stress.
    """
    point = wall_stress.RingStress(
        np.array([[0.1, 0.1, 0.0]]),
        np.array([0.006]),
        np.array([[[[1.0, 0.0, 0.0]]], [[[0.5, 0.0, 0.0]]]]),
        np.zeros(1),
    )
    in_middle = replace(point, unit=np.array([0.5, 4.0])[:, None, None, None] * point.unit)
    monkeypatch.setattr(
        SectionPiece, "stresses", lambda piece, pads, place: [point if pads[0].across else in_middle] * 2
    )
    states = SectionStates(np.array([0.0, 1.2]), np.zeros((3, len(FORCES), 2)))
    weak, strong = (
        LoadedRing((pad(),), np.array([0.3, 0.4, 0.5]), force * np.array([[1.0], [3.0], [2.0]])) for force in (1.0, 7.0)
    )
    peak = wall_peak(section(), states, [weak, strong, weak])
    assert peak is not None and (peak.stress, peak.state) == (((21.0, 0.01 * 21.0), (10.5, 0.01 * 10.5)), 1)
    assert peak.position.tolist() == pytest.approx([0.5, 0.1, 0.0])
    aside = LoadedRing((replace(pad(), across=0.0),), strong.x, strong.forces)
    for rings in ([strong, aside], [aside, strong]):
        both = wall_peak(section(), states, rings)
        assert both is not None and both.stress == (peak.stress.middle, (42.0, 0.01 * 42.0))
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
    """Pads press on both sections of a joint; a section without yield stress takes its own joint and the next away.

    With an even pressure the weaker wall of the outer joint is that of the other section.
    """
    scene = pmr.load_scene("boom_three")
    assert isinstance(scene, Scene)
    strong = scene.vary_sections(lambda part: {"body": {"material": {"yield_stress": 350e6}}})
    by_section = dict(zip(strong.names, ((2e3, 1e3), (1e3, 1.5e3), (4e3, 2e3)), strict=True))  # Pa/N
    ends = {"tail": 1.0, "mouth": 0.8}

    def stresses(scene: Scene, number: int) -> Iterator[PadStress]:
        middle, even = by_section[scene.names[number]]
        for joint in range(max(number, 1), min(number + 2, 3)):
            for end, by in ends.items():
                stress = ByPressure(Estimate(by * middle, middle / 8.0), Estimate(by * even, 0.0))
                yield PadStress(joint, f"{scene.names[joint]} {end}", stress)

    monkeypatch.setattr(wall_stress, "largest_pad_stresses", stresses)
    base, outer, inner = strong.names
    expected = {
        f"{name} {end}": (350e6 / (by * middle), 350e6 / (8.0 * by**2 * middle), 350e6 / (by * even), of)
        for name, middle, even, of in ((outer, 2e3, 1.5e3, base), (inner, 4e3, 2e3, inner))
        for end, by in ends.items()
    }
    forces = {pad: astuple(force) for pad, force in yield_forces(strong).items()}
    assert forces == {pad: pytest.approx(numbers) for pad, numbers in expected.items()}
    last = strong.sections[2].with_keys(body={"material": {"yield_stress": None}})
    left = yield_forces(strong.with_keys(sections=(*strong.sections[:2], last)))
    assert sorted(left) == [f"{outer} mouth", f"{outer} tail"]
