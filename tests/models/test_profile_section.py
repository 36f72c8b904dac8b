from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from pmr.models.box_mesh import BoxBoom, write_shell
from pmr.models.named_mesh import read_mesh
from pmr.models.profile_section import section_of
from pmr.scene.profile import BoxProfile
from pmr.scene.structures import BeamSection

BOOM = BoxProfile(width=0.3, height=0.4, wall=0.008)


def test_a_tube_is_one_rectangle_without_another() -> None:
    section = section_of(BOOM, 0.3)
    assert section.area == pytest.approx(0.308 * 0.408 - 0.292 * 0.392, rel=1e-12)
    assert section.second_moment_y == pytest.approx((0.308 * 0.408**3 - 0.292 * 0.392**3) / 12, rel=1e-12)
    assert section.second_moment_z == pytest.approx((0.408 * 0.308**3 - 0.392 * 0.292**3) / 12, rel=1e-12)


def test_torsion_is_bredts() -> None:
    """4 A_m^2 / (perimeter / t)."""
    assert section_of(BOOM, 0.3).torsion_constant == pytest.approx(4 * (0.3 * 0.4) ** 2 / (1.4 / 0.008), rel=1e-12)


@pytest.mark.parametrize("nu", [0.0, 0.3])
def test_the_shear_coefficient_of_a_square_tube_is_cowpers(nu: float) -> None:
    """20 (1 + nu) / (48 + 39 nu), tabulated on its own in the same paper."""
    section = section_of(BoxProfile(width=0.2, height=0.2, wall=0.005), nu)
    assert section.shear_area_y == pytest.approx(20 * (1 + nu) / (48 + 39 * nu) * section.area, rel=1e-12)
    assert section.shear_area_z == pytest.approx(section.shear_area_y, rel=1e-12)


@pytest.mark.parametrize(("width", "height"), [(1.0, 3.0), (0.02, 2.0)])
def test_the_webs_carry_the_shear(width: float, height: float) -> None:
    """The narrower the flanges, the nearer kappa A to 5/6 of the webs' area at nu = 0, and never above the webs'."""
    section = section_of(BoxProfile(width=width, height=height, wall=0.001), 0.0)
    webs = 2 * height * 0.001
    assert section.shear_area_z < webs
    assert section.shear_area_z == pytest.approx(5 / 6 * webs, rel=0.01 + 0.5 * width / height)


def test_turning_the_section_exchanges_its_axes() -> None:
    turned = section_of(BoxProfile(width=0.4, height=0.3, wall=0.008), 0.3)
    section = section_of(BOOM, 0.3)
    assert turned.second_moment_y == pytest.approx(section.second_moment_z, rel=1e-12)
    assert turned.shear_area_z == pytest.approx(section.shear_area_y, rel=1e-12)
    assert np.isclose(turned.torsion_constant, section.torsion_constant, rtol=1e-12)


@pytest.mark.parametrize("nu", [0.0, 0.3])
def test_a_square_that_is_all_corners_is_a_circular_tube(nu: float) -> None:
    """Cowper's coefficient of it is 2 (1 + nu) / (4 + 3 nu); that of the square was his, what changes it is energy."""
    r, t = 0.15, 0.008
    tube = section_of(BoxProfile(width=2 * r, height=2 * r, wall=t, radius=r), nu)
    outer, inner = r + t / 2, r - t / 2
    assert tube.area == pytest.approx(np.pi * (outer**2 - inner**2), rel=1e-12)
    assert tube.second_moment_y == pytest.approx(np.pi / 4 * (outer**4 - inner**4), rel=1e-11)
    assert tube.torsion_constant == pytest.approx(2 * np.pi * r**3 * t, rel=1e-12)
    assert tube.shear_area_y == pytest.approx(2 * (1 + nu) / (4 + 3 * nu) * tube.area, rel=0.02)


@pytest.mark.slow
def test_rounded_corners_take_away_what_is_outside_them() -> None:
    """Sums over a fine grid of points, and a radius that vanishes."""
    b, h, t, r = 0.3, 0.4, 0.02, 0.06
    section, n = (
        section_of(BoxProfile(width=b, height=h, wall=t, radius=r), 0.3),
        2016,
    )  # edges of flats on those of cells
    y, z = np.meshgrid((np.arange(n) + 0.5) / n * (b + t) / 2, (np.arange(n) + 0.5) / n * (h + t) / 2)
    beyond = np.hypot(np.maximum(y - (b / 2 - r), 0.0), np.maximum(z - (h / 2 - r), 0.0))
    solid = (beyond < r + t / 2) & ((y > (b - t) / 2) | (z > (h - t) / 2) | (beyond > r - t / 2))
    cell = (b + t) * (h + t) / n**2
    for found, moment in ((section.area, 1.0), (section.second_moment_y, z**2), (section.second_moment_z, y**2)):
        assert found == pytest.approx(np.sum(solid * moment) * cell, rel=2e-4)  # cells that arcs cut
    sharp, nearly = (
        section_of(BoxProfile(width=100 * b, height=100 * h, wall=1e-6, radius=r), 0.3) for r in (0.0, 6e-7)
    )
    assert nearly.shear_area_z == pytest.approx(sharp.shear_area_z, rel=1e-6)
    assert nearly.second_moment_z == pytest.approx(sharp.second_moment_z, rel=1e-6)


def test_the_beams_mass_is_that_of_the_shells_mesh() -> None:
    """Quarters of a circle are a few straight sides there, a little shorter."""
    sides, shells = dict(width=0.27, height=0.39, wall=0.005, radius=0.03), {}
    for size in (0.02, 0.01):
        with TemporaryDirectory() as folder:
            write_shell(
                BoxBoom(BoxProfile(**sides).sides, length=1.0, size=size, size_along=0.5), Path(folder, "box.msh")
            )
            mesh = read_mesh(Path(folder, "box.msh"), ("triangle",))
        a, b, c = (mesh.points[mesh.cells[:, i]] for i in range(3))
        shells[size] = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0 * 0.005
    area = section_of(BoxProfile(**sides), 0.3).area
    # a side of a circle's arc is short of it by the square of its angle over 24, at most (pi / 4)^2 / 24 of the corners
    assert 0.0 < area - shells[0.01] < area - shells[0.02] < (np.pi / 4) ** 2 / 24 * 2 * np.pi * 0.03 * 0.005


THIN = 1e-6  # of a width of 1, the thinnest wall of a scene: what the thickness adds is less than 1e-6


def thin(**given) -> BeamSection:
    return section_of(BoxProfile(**({"width": 1.0, "height": 1.0, "wall": THIN} | given)), 0.3)


def test_four_walls_of_their_own_thickness_are_one_rectangle_without_another() -> None:
    b, h = 0.3, 0.4
    bottom, top, left, right = 0.010, 0.008, 0.006, 0.012
    walls = {"bottom": bottom, "top": top, "left": left, "right": right}
    section = section_of(BoxProfile(width=b, height=h, wall=walls), 0.3)
    y0, y1, z0, z1 = -b / 2, b / 2, -h / 2, h / 2  # the mid-surface
    rectangles = [  # sign, y from, y to, z from, z to
        (1.0, y0 - right / 2, y1 + left / 2, z0 - bottom / 2, z1 + top / 2),
        (-1.0, y0 + right / 2, y1 - left / 2, z0 + bottom / 2, z1 - top / 2),
    ]
    A, S, J = 0.0, np.zeros(2), np.zeros((2, 2))
    for sign, a, c, d, e in rectangles:
        size, middle, sides = (c - a) * (e - d), np.array([a + c, d + e]) / 2, np.array([c - a, e - d])
        A, S = A + sign * size, S + sign * size * middle
        J += sign * size * (np.diag(sides**2 / 12) + np.outer(middle, middle))
    J -= np.outer(S, S) / A
    assert section.area == pytest.approx(A, rel=1e-12)
    assert section.centroid == pytest.approx(S / A, rel=1e-11)
    found = [section.second_moment_z, section.product_of_inertia, section.second_moment_y]
    assert found == pytest.approx([J[0, 0], J[0, 1], J[1, 1]], rel=1e-11)
    resistance = b / bottom + b / top + h / left + h / right
    assert section.torsion_constant == pytest.approx(4 * (b * h) ** 2 / resistance, rel=1e-12)


def test_the_regular_octagon() -> None:
    """Of side a: area 2 (1 + sqrt 2) a^2, second moment (11 + 8 sqrt 2) / 12 a^4; the same about every axis."""
    wide, t = 0.4, 0.012
    sides = [(wide + shift) / (1 + np.sqrt(2)) for shift in (-t, 0.0, t)]
    inner, a, outer = sides
    section = section_of(BoxProfile(width=wide, height=wide, wall=t, chamfer=a / np.sqrt(2)), 0.3)
    assert section.area == pytest.approx(2 * (1 + np.sqrt(2)) * (outer**2 - inner**2), rel=1e-12)
    second = (11 + 8 * np.sqrt(2)) / 12 * (outer**4 - inner**4)
    assert [section.second_moment_y, section.second_moment_z] == pytest.approx([second, second], rel=1e-12)
    assert section.torsion_constant == pytest.approx(4 * (2 * (1 + np.sqrt(2)) * a**2) ** 2 * t / (8 * a), rel=1e-12)
    assert section.centroid == section.shear_centre == (0.0, 0.0)


def test_a_hexagon_on_its_edge() -> None:
    """Regular, of side a: thin walls have 5/2 a^3 t about every axis."""
    a = 0.5
    section = thin(width=2 * a, height=np.sqrt(3) * a, chamfer=(a / 2, np.sqrt(3) * a / 2))
    assert section.area == pytest.approx(6 * a * THIN, rel=1e-6)
    assert [section.second_moment_y, section.second_moment_z] == pytest.approx([2.5 * a**3 * THIN] * 2, rel=1e-6)
    assert section.torsion_constant == pytest.approx(4 * (1.5 * np.sqrt(3) * a**2) ** 2 * THIN / (6 * a), rel=1e-6)


def test_a_trough_with_a_lid_and_half_a_circle_as_its_belly() -> None:
    """Thin walls: lid 2 r at the top, walls of w, half a circle of r, whose centroid is 2 r / pi below its centre.

    All of one thickness.
    """
    r, w = 0.5, 0.7
    section = thin(width=2 * r, height=w + r, radius={"bottom": r})
    centre = -(w + r) / 2 + r  # of the half circle
    parts = [(2 * r, (w + r) / 2), (2 * w, centre + w / 2), (np.pi * r, centre - 2 * r / np.pi)]
    length = sum(own for own, _ in parts)
    z = sum(own * at for own, at in parts) / length
    own = [0.0, 2 * w**3 / 12, np.pi * r**3 / 2 - np.pi * r * (2 * r / np.pi) ** 2]
    second = sum(size * (at - z) ** 2 + extra for (size, at), extra in zip(parts, own, strict=True))
    assert section.area == pytest.approx(length * THIN, rel=1e-6)
    assert section.centroid == pytest.approx((0.0, z), rel=1e-6, abs=1e-12)
    assert section.second_moment_y == pytest.approx(second * THIN, rel=1e-6)
    across = (2 * r) ** 3 / 12 + 2 * w * r**2 + np.pi * r**3 / 2
    assert section.second_moment_z == pytest.approx(across * THIN, rel=1e-6)
    enclosed = 2 * r * w + np.pi * r**2 / 2
    assert section.torsion_constant == pytest.approx(4 * enclosed**2 * THIN / length, rel=1e-6)
    # Force along -y: S = int y ds from the lowest point is r^2 (1 - cos a) up the arc, r^2 + r s up the wall and
    # r^2 + r w + (r^2 - y^2) / 2 in the lid, the same on the other side; its mean is taken off, for nothing twists.
    half = np.array([r**3 * (np.pi / 2 - 1), r**2 * w + r * w**2 / 2, (r**2 + r * w) * r + r**3 / 3])
    moment = 2 * half @ [r, r, w] - 2 * enclosed * 2 * half.sum() / length  # about the circle's centre
    assert section.shear_centre == pytest.approx((0.0, centre + moment / across), rel=1e-6)


def test_the_shear_centre_of_a_box_with_one_thick_wall() -> None:
    """Symmetric about y: V along z; S from the middles of the webs, and what closes the cell's slit.

    By hand for walls b x h, flanges of t, webs of t_l at y = b/2 and t_r at -b/2.
    """
    b, h, t, t_l, t_r = 0.3, 0.4, 0.0001, 0.0003, 0.00005
    walls = {"top": t, "bottom": t, "left": t_l, "right": t_r}
    section = section_of(BoxProfile(width=b, height=h, wall=walls), 0.3)
    second = 2 * b * t * h**2 / 4 + (t_l + t_r) * h**3 / 12
    # open at the middle of the right web: first moments upwards are carried to the left along the top, all as mirrored
    at_corner = t_r * h**2 / 8  # of the upper half of the right web
    flange = at_corner + t * b * h / 2  # at the end of the top flange
    along_flange = (at_corner + flange) / 2 * b
    along_left = flange * h + t_l * h**3 / 12  # down the left web, sum of S over its length
    along_right = t_r * h**3 / 24
    resistance = h / t_l + h / t_r + 2 * b / t
    slit = (2 * along_flange / t + along_left / t_l + along_right / t_r) / resistance
    # the flow along the left web less the slit's, times its lever about the right one, is the moment of V there
    moment = 2 * along_flange * h / 2 + along_left * b - slit * 2 * b * h
    at_left_of_right = moment / second
    assert section.shear_centre == pytest.approx((at_left_of_right - b / 2, 0.0), rel=1e-6, abs=1e-12)
