from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from pmr.mesh.box import BoxBoom, write_shell
from pmr.mesh.named import read_mesh
from pmr.models.box_section import box_section
from pmr.scene.structures import BoxProfile

BOOM = BoxProfile(width=0.3, height=0.4, wall=0.008)


def test_a_tube_is_one_rectangle_without_another() -> None:
    section = box_section(BOOM, 0.3)
    assert section.area == pytest.approx(0.308 * 0.408 - 0.292 * 0.392, rel=1e-12)
    assert section.second_moment_y == pytest.approx((0.308 * 0.408**3 - 0.292 * 0.392**3) / 12, rel=1e-12)
    assert section.second_moment_z == pytest.approx((0.408 * 0.308**3 - 0.392 * 0.292**3) / 12, rel=1e-12)


def test_torsion_is_bredts() -> None:
    """4 A_m^2 / (perimeter / t)."""
    assert box_section(BOOM, 0.3).torsion_constant == pytest.approx(4 * (0.3 * 0.4) ** 2 / (1.4 / 0.008), rel=1e-12)


@pytest.mark.parametrize("nu", [0.0, 0.3])
def test_the_shear_coefficient_of_a_square_tube_is_cowpers(nu: float) -> None:
    """20 (1 + nu) / (48 + 39 nu), tabulated on its own in the same paper."""
    section = box_section(BoxProfile(width=0.2, height=0.2, wall=0.005), nu)
    assert section.shear_area_y == pytest.approx(20 * (1 + nu) / (48 + 39 * nu) * section.area, rel=1e-12)
    assert section.shear_area_z == section.shear_area_y


@pytest.mark.parametrize(("width", "height"), [(1.0, 3.0), (0.02, 2.0)])
def test_the_webs_carry_the_shear(width: float, height: float) -> None:
    """The narrower the flanges, the nearer kappa A to 5/6 of the webs' area at nu = 0, and never above the webs'."""
    section = box_section(BoxProfile(width=width, height=height, wall=0.001), 0.0)
    webs = 2 * height * 0.001
    assert section.shear_area_z < webs
    assert section.shear_area_z == pytest.approx(5 / 6 * webs, rel=0.01 + 0.5 * width / height)


def test_turning_the_section_exchanges_its_axes() -> None:
    turned = box_section(BoxProfile(width=0.4, height=0.3, wall=0.008), 0.3)
    section = box_section(BOOM, 0.3)
    assert (turned.second_moment_y, turned.shear_area_z) == (section.second_moment_z, section.shear_area_y)
    assert np.isclose(turned.torsion_constant, section.torsion_constant, rtol=1e-12)


@pytest.mark.parametrize("nu", [0.0, 0.3])
def test_a_square_that_is_all_corners_is_a_circular_tube(nu: float) -> None:
    """Cowper's coefficient of it is 2 (1 + nu) / (4 + 3 nu); that of the square was his, what changes it is energy."""
    r, t = 0.15, 0.008
    tube = box_section(BoxProfile(width=2 * r, height=2 * r, wall=t, radius=r), nu)
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
        box_section(BoxProfile(width=b, height=h, wall=t, radius=r), 0.3),
        2016,
    )  # edges of flats on those of cells
    y, z = np.meshgrid((np.arange(n) + 0.5) / n * (b + t) / 2, (np.arange(n) + 0.5) / n * (h + t) / 2)
    beyond = np.hypot(np.maximum(y - (b / 2 - r), 0.0), np.maximum(z - (h / 2 - r), 0.0))
    solid = (beyond < r + t / 2) & ((y > (b - t) / 2) | (z > (h - t) / 2) | (beyond > r - t / 2))
    cell = (b + t) * (h + t) / n**2
    for found, moment in ((section.area, 1.0), (section.second_moment_y, z**2), (section.second_moment_z, y**2)):
        assert found == pytest.approx(np.sum(solid * moment) * cell, rel=2e-4)  # cells that arcs cut
    sharp, nearly = (box_section(BoxProfile(width=b, height=h, wall=1e-9, radius=r), 0.3) for r in (0.0, 1e-9))
    assert nearly.shear_area_z == pytest.approx(sharp.shear_area_z, rel=1e-6)
    assert nearly.second_moment_z == pytest.approx(sharp.second_moment_z, rel=1e-6)


def test_the_beams_mass_is_that_of_the_shells_mesh() -> None:
    """Quarters of a circle are a few straight sides there, a little shorter."""
    sides, shells = dict(width=0.27, height=0.39, wall=0.005, radius=0.03), {}
    for size in (0.02, 0.01):
        with TemporaryDirectory() as folder:
            write_shell(BoxBoom(length=1.0, size=size, size_along=0.5, **sides), Path(folder, "box.msh"))
            mesh = read_mesh(Path(folder, "box.msh"), ("triangle",))
        a, b, c = (mesh.points[mesh.cells[:, i]] for i in range(3))
        shells[size] = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0 * 0.005
    area = box_section(BoxProfile(**sides), 0.3).area
    # a side of a circle's arc is short of it by the square of its angle over 24, at most (pi / 4)^2 / 24 of the corners
    assert 0.0 < area - shells[0.01] < area - shells[0.02] < (np.pi / 4) ** 2 / 24 * 2 * np.pi * 0.03 * 0.005
