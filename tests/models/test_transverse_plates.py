"""Frames and diaphragms within boxes: their mass in beams, their cells in shells, and what they stiffen."""

from pathlib import Path

import numpy as np
import pytest
from gathering import gathered
from varying import RHO, answers, areas, beam, shell

from pmr.fem.compat import MPI
from pmr.fullmodel.model import assemble_model
from pmr.fullmodel.pads import Pad
from pmr.fullmodel.wall_compliance import PlateBody, Ring, wall_compliance
from pmr.models.profile_section import enclosed_figure, inset_sides, section_of
from pmr.models.shell import boom_of_box
from pmr.scene.box import Box
from pmr.scene.profile import BoxProfile
from pmr.scene.structures import Material

LENGTH, PLATE = 6.0, 0.012
BOX = {"length": LENGTH, "width": 0.3, "height": 0.4, "wall": 0.008, "frame_thickness": PLATE}
FRAMED = BOX | {"frames": [0.02, 1.7, 4.1], "frame_depth": 0.05}
BELOW = {"chamfer": {"bottom": 0.1}}


def test_figures_have_the_integrals_of_closed_forms() -> None:
    b, h, d, r = 0.3, 0.4, 0.05, 0.08
    sharp = enclosed_figure(BoxProfile(width=b, height=h, wall=0.008).sides)
    assert sharp.area == pytest.approx(b * h, rel=1e-13)
    assert sharp.second == pytest.approx(np.diag([h * b**3, b * h**3]) / 12.0, rel=1e-12, abs=1e-18)
    cut = enclosed_figure(BoxProfile(width=b, height=h, wall=0.008, **BELOW).sides)
    assert cut.area == pytest.approx(b * h - 0.01, rel=1e-13)
    corner = h / 2.0 - 0.1 / 3.0  # the centroid of each corner that is cut off is so far below
    assert cut.first == pytest.approx([0.0, 0.01 * corner], rel=1e-12, abs=1e-18)
    round_ = BoxProfile(width=b, height=h, wall=0.008, radius=r).sides
    for sides, side_b, side_h, radius in ((round_, b, h, r), (inset_sides(round_, d), b - 2 * d, h - 2 * d, r - d)):
        assert enclosed_figure(sides).area == pytest.approx(side_b * side_h - (4.0 - np.pi) * radius**2, rel=1e-12)
    disc = enclosed_figure(BoxProfile(width=b, height=b, wall=0.008, radius=b / 2.0).sides)
    assert disc.second == pytest.approx(np.eye(2) * np.pi / 4.0 * (b / 2.0) ** 4, rel=1e-12, abs=1e-18)


@pytest.mark.parametrize("depth", [0.05, "full"])
@pytest.mark.parametrize("elements", [5, 23])
def test_a_beam_weighs_what_its_frames_weigh_where_they_are(depth, elements: int) -> None:
    """Mass, centre and moments of inertia of rigid motions, but for what is due to the elements' length alone."""
    box = Box(**(FRAMED | BELOW | {"frames": [1.7, 4.1], "frame_depth": depth}))
    plate = enclosed_figure(box.sides)
    plate = plate if depth == "full" else plate.plus(enclosed_figure(inset_sides(box.sides, depth)), -1.0)
    own, area = section_of(box, 0.3), PLATE * plate.area
    found = {}
    for shear in (False, True):
        model = beam(box, shear=shear, elements=elements)
        operators = assemble_model(model, model.domain(MPI.COMM_SELF))
        M, R = gathered(operators.M), model.rigid_motions()
        found[shear] = R.T @ M @ R
    for G in found.values():
        mass = RHO * (own.area * LENGTH + 2.0 * area)
        assert np.diag(G)[:3] == pytest.approx([mass] * 3, rel=1e-12)
        assert G[1, 5] == pytest.approx(RHO * (own.area * LENGTH**2 / 2.0 + area * (1.7 + 4.1)), rel=1e-12)
        polar = own.polar_moment + own.area * own.centroid[1] ** 2
        assert G[3, 3] == pytest.approx(RHO * (polar * LENGTH + 2.0 * PLATE * np.trace(plate.second)), rel=1e-12)
        below = RHO * (own.area * own.centroid[1] * LENGTH + 2.0 * PLATE * plate.first[1])
        assert G[1, 3] == pytest.approx(-below, rel=1e-10)
    assert found[True][0, 4] == pytest.approx(below, rel=1e-10)
    more = found[True][4, 4] - found[False][4, 4]  # of sections that turn about the centroid of the profile
    turning = own.second_moment_y * LENGTH + 2.0 * PLATE * (plate.second[1, 1] - plate.area * own.centroid[1] ** 2)
    assert more == pytest.approx(RHO * turning, abs=1e-11 * found[True][4, 4])


def test_frames_and_taper_pass_on_their_mass_to_pieces_of_elements() -> None:
    """A beam that is cut has the mass where the whole one has it."""
    model = beam(Box(**FRAMED, tip_taper={"length": 3.0, "height": 0.3}), shear=True, elements=7)
    cut = model.cut(4).beam
    ends = model.node_stations
    for masses, stations in ((model.masses, ends), (cut.masses, cut.node_stations[cut.grid.cells])):
        h = np.diff(stations) if stations.ndim == 1 else np.diff(stations)[:, 0]
        assert masses @ h == pytest.approx(model.masses @ np.diff(ends), rel=1e-12)
    assert np.repeat(model.masses, 4) == pytest.approx(cut.masses, rel=1e-12)


@pytest.mark.parametrize("taper", [{}, {"tip_taper": {"length": 3.0, "height": 0.12, "width": 0.1, "chamfer": 0.03}}])
@pytest.mark.parametrize("depth", [0.05, "full"])
def test_plates_of_a_shell_are_as_large_and_thick_as_they_are(depth, taper: dict, tmp_path: Path) -> None:
    pytest.importorskip("gmsh")
    box = Box(**(FRAMED | {"frames": [1.5, 4.5], "frame_depth": depth, "chamfer": 0.08} | taper))
    model = shell(box, tmp_path, 0.08, 0.6)
    cells, x = model.mesh.regions["frames"], model.mesh.points[model.mesh.cells].mean(axis=1)[:, 0]
    assert np.all(model.thickness[cells] == PLATE)
    for at in (1.5, 4.5):
        sides = box.profile_at(at).sides
        plate = enclosed_figure(sides)
        plate = plate if depth == "full" else plate.plus(enclosed_figure(inset_sides(sides, depth)), -1.0)
        here = cells[np.abs(x[cells] - at) < 1e-9]
        assert areas(model.mesh)[here].sum() == pytest.approx(plate.area, rel=1e-9)
    others = np.setdiff1d(np.arange(len(x)), cells)
    assert np.all(model.thickness[others] == 0.008)


@pytest.mark.slow
def test_walls_are_stiffer_near_a_frame() -> None:
    """Pads that slide over it dent their walls least there, and farther away nearly as without it."""
    pytest.importorskip("gmsh")
    ring = Ring(tuple(Pad(f"{a}", "top", across=a, width=0.06, length=0.2, at=0.5) for a in (-0.1, 0.1)), 1.4)
    found = {}
    for name, frames in (("bare", ()), ("framed", (1.2,))):
        box = Box(length=2.4, width=0.3, height=0.4, wall=0.008, frames=frames, frame_depth=0.06)
        body = PlateBody(boom_of_box(box, 0.15, 0.15), box, Material(), 5.0 / 6.0)
        _, (along,) = wall_compliance(body, (), (), (ring,))
        found[name] = along.sliding[:, 0, 0]
        where = 0.5 + along.u
    share = found["framed"] / found["bare"]
    assert where[share.argmin()] == pytest.approx(1.2, abs=0.08) and share.min() < 0.6
    assert np.all(share[[0, -1]] > 0.8) and np.all(share < 1.0)


@pytest.mark.slow
def test_diaphragms_keep_a_tapered_box_in_shape(tmp_path: Path) -> None:
    """Width and height taper by different shares: torsion is a beam's with them, and 2 % off without."""
    pytest.importorskip("gmsh")
    given = {"length": LENGTH, "width": 0.3, "height": 0.4, "wall": 0.008}
    taper = {"tip_taper": {"length": 4.0, "height": 0.25, "width": 0.24}}
    plates = {"frames": [2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0, 5.5], "frame_depth": "full", "frame_thickness": 0.008}
    line = answers(beam(Box(**given, **taper), shear=True, elements=24))[3, 3]
    bare, closed = (answers(shell(Box(**given, **taper, **more), tmp_path, 0.06, 0.25))[3, 3] for more in ({}, plates))
    assert bare / line > 1.015 and closed == pytest.approx(line, rel=0.01)
