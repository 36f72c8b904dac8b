"""Walls of a beam that give way: what the coordinates do that stand for their dents, and how far they give way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from gathering import gathered

from pmr.fullmodel.pads import Pad, Pads, Support
from pmr.fullmodel.structure import Action, Clamp, Structure, structural_model
from pmr.fullmodel.wall_compliance import Plates, WallCompliance, wall_compliance
from pmr.fullmodel.walls import EndWall, RingWall, Walls, summary
from pmr.models.beam3d import Beam3D
from pmr.scene.structures import Beam3DBody, BoxProfile, Material, PointMass

TRAVEL = (0.6, 1.7)
PROFILE = BoxProfile(width=0.3, height=0.4, wall=0.008)
RING = (Pad("top", "top", across=0.1), Pad("bottom", "bottom", across=-0.05), Pad("left", "left", across=0.02))
PRESSED = tuple(
    Pad("", face, across=across, width=0.06)
    for face, across in [("top", -0.1), ("top", 0.1), ("bottom", 0.0), ("left", 0.0), ("right", 0.0)]
)
PLACES = np.array([0.15, 0.3, 0.5, 0.9])


def beam() -> Beam3D:
    return Beam3D(Beam3DBody(length=2.0, profile=PROFILE, shear=True, elements=10))


def compliance() -> np.ndarray:
    """Of three pads, four times as large at an end as away from it, (4, 3, 3) m/N."""
    A = np.random.default_rng(3).uniform(-1.0, 1.0, (3, 3))
    return np.array([4.0, 2.5, 1.4, 1.0])[:, None, None] * 1e-8 * (A @ A.T + np.eye(3))


def ring(names: tuple[str, ...] = ("top", "bottom", "left"), free: tuple[bool, bool] = (True, True)) -> RingWall:
    return RingWall(names, 2.0, free, PLACES, compliance(), 2.0)


def clamped(pads: Pads, **rest) -> Structure:
    return Structure(beam(), clamps=(Clamp("tail"),), pads=pads, **rest)


def pressed(structure: Structure, s: float) -> np.ndarray:
    """What all rows measure of the answers to unit forces of their pads."""
    full = structural_model(structure)
    C, K = full.rows.at(s).toarray(), gathered(full.K)
    return C @ scipy.linalg.solve(K, C.T, assume_a="pos")


def test_the_root_is_that_of_the_compliance_wherever_it_is_known_and_mirrored_at_the_tip() -> None:
    wall = ring()
    S = wall.at(np.array([*PLACES, *(2.0 - PLACES), 1.03, 0.0]))
    given = wall.stiffness * compliance()
    assert S == pytest.approx(S.transpose(0, 2, 1), abs=1e-14)
    assert S @ S == pytest.approx(np.concatenate([given, given, given[[-1, 0]]]), rel=1e-12, abs=1e-12)
    assert np.trace(given[-1]) == pytest.approx(3.0)


def test_an_end_that_is_kept_in_shape_is_as_stiff_as_the_middle() -> None:
    wall = ring(free=(False, True))
    near_tail, near_tip, middle = wall.at(np.array([0.15, 1.85, 1.0]))
    assert near_tail == pytest.approx(middle)
    assert near_tip == pytest.approx(2.0 * middle)  # four times the compliance


def test_pads_that_press_find_the_walls_compliance_on_top_of_the_beams() -> None:
    moving = tuple(replace(pad, at=0.2) for pad in RING)
    for s in (0.6, 0.75, 1.234, 1.5):
        rigid = pressed(clamped(Pads(moving=moving, travel=(0.6, 1.55))), s)
        gives = pressed(clamped(Pads(moving=moving, travel=(0.6, 1.55), walls=Walls((ring(),)))), s)
        S = ring().at(np.array([s + 0.2]))[0]
        assert gives - rigid == pytest.approx(S @ S / ring().stiffness, rel=3e-3)  # between breaks S is a cubic
        if s in (0.6, 1.55):
            assert gives - rigid == pytest.approx(S @ S / ring().stiffness, rel=1e-9)


def test_a_pad_that_stays_presses_on_the_wall_where_it_is() -> None:
    """As a spring of the structure; its compliance and the wall's are in series."""
    stiffness = 3e8
    fixed = tuple(replace(pad, at=1.85, stiffness=stiffness) for pad in RING)
    load = Action("F", 1.9, "z")
    tip = {}
    for name, walls in (("rigid", Walls()), ("gives", Walls((ring(),)))):
        full = structural_model(clamped(Pads(fixed, walls=walls), loads=(load,), outputs=(load,)))
        B, C, K = (gathered(A) for A in (full.inputs, full.outputs, full.K))
        tip[name] = (C.T @ scipy.linalg.solve(K, B, assume_a="pos")).item()
    rigid_pads = tuple(replace(pad, at=1.85, stiffness=np.inf) for pad in RING)
    full = structural_model(clamped(Pads(rigid_pads), loads=(load,), outputs=(load,)))
    B, O, K = (gathered(A) for A in (full.inputs, full.outputs, full.K))
    U = full.rows.at(0.0).toarray()
    free, answers = scipy.linalg.solve(K, B, assume_a="pos"), scipy.linalg.solve(K, U.T, assume_a="pos")
    for name, give in (("rigid", 0.0), ("gives", compliance()[0])):
        F = U @ answers + np.eye(3) / stiffness + give
        expected = O.T @ free - (O.T @ answers) @ np.linalg.solve(F, U @ free)
        assert tip[name] == pytest.approx(expected.item(), rel=1e-9)


def test_dents_move_with_nothing_rigid() -> None:
    full = structural_model(Structure(beam(), pads=Pads(moving=RING, travel=TRAVEL, walls=Walls((ring(),)))))
    plain = structural_model(Structure(beam(), pads=Pads(moving=RING, travel=TRAVEL)))
    R, of_plain = full.rigid.coordinates, plain.rigid.coordinates
    assert full.size == plain.size + 3 and np.all(R[-3:] == 0.0)
    assert full.rows.at(1.1) @ R == pytest.approx(plain.rows.at(1.1) @ of_plain, abs=1e-12)
    M, of_all = gathered(full.M), gathered(plain.M)
    assert M[-3:, -3:] == pytest.approx(2.0 * np.eye(3)) and not M[:-3, -3:].any()
    assert R.T @ M @ R == pytest.approx(of_plain.T @ of_all @ of_plain)


def test_two_rings_dent_walls_of_their_own() -> None:
    other = tuple(replace(pad, name=f"{pad.name} 2", at=0.05) for pad in RING)
    walls = Walls((ring(), ring(tuple(pad.name for pad in other))))
    travel = (0.6, 1.4)
    gives = pressed(clamped(Pads(moving=(*RING, *other), travel=travel, walls=walls)), 1.0)
    rigid = pressed(clamped(Pads(moving=(*RING, *other), travel=travel)), 1.0)
    own = compliance()[-1]
    assert gives - rigid == pytest.approx(scipy.linalg.block_diag(own, own), rel=1e-4, abs=1e-13)


@pytest.mark.parametrize("on", ["tip", 2.0])
def test_what_is_spread_over_a_free_end_moves_its_walls_too(on: str | float) -> None:
    """A load, what is measured there, a mass and a support; a load at a distance leaves the walls of the end alone."""
    give = Walls(ends=(EndWall("tip", "y", 1e7, 1.0), EndWall("tip", "rx", 1e6, 0.1)))
    for direction, more in (("y", 1e-7), ("z", 0.0), ("rx", 1e-6)):
        load = Action("F", on, direction)
        found = {}
        for name, walls in (("rigid", Walls()), ("gives", give)):
            full = structural_model(clamped(Pads(walls=walls), loads=(load,), outputs=(load,)))
            B, K = gathered(full.inputs), gathered(full.K)
            found[name] = (B.T @ scipy.linalg.solve(K, B, assume_a="pos")).item()
        assert found["gives"] - found["rigid"] == pytest.approx(more if on == "tip" else 0.0, rel=1e-6, abs=1e-15)
    mass = PointMass(name="m", on="tip", mass=100.0)
    M = gathered(structural_model(clamped(Pads(walls=give), masses=(mass,))).M)
    assert M[-2, -2] == pytest.approx(101.0) and M[-2].sum() > 200.0
    support = Support("hold", "tip", "y")
    row = structural_model(clamped(Pads(supports=(support,), walls=give))).rows.at(0.0).toarray()
    assert row[0, -2:] == pytest.approx([1.0, 0.0])


def test_a_summary_says_how_far_each_wall_gives_way() -> None:
    said = summary({"": Walls((ring(),)), "fly": Walls((ring(),))})["walls"]
    assert [one["name"] for one in said] == ["top", "bottom", "left", "fly: top", "fly: bottom", "fly: left"]
    for one, end, away in zip(said, np.diag(compliance()[0]), np.diag(compliance()[-1]), strict=False):
        assert (one["at_the_end"], one["away"], one["stiffness"]) == pytest.approx((end, away, 1.0 / away))
    assert summary({"": Walls()}) == {}


def found(thickness: float) -> WallCompliance:
    """How far the walls of a box give way, by a shell of it."""
    pytest.importorskip("gmsh")
    profile = BoxProfile(width=0.3, height=0.4, wall=thickness)
    return wall_compliance(Plates(profile, Material(), 5.0 / 6.0, 0.15, 0.15), (PRESSED,))


@pytest.mark.slow
@pytest.mark.numerical
def test_the_shells_compliance_is_symmetric_definite_and_a_mirror_image_of_itself() -> None:
    C = found(0.008).rings[0]
    assert C == pytest.approx(C.transpose(0, 2, 1), rel=1e-9)
    assert np.all(np.linalg.eigvalsh(C) > 0.0)
    mirrored = C[:, [1, 0, 2, 4, 3]][:, :, [1, 0, 2, 4, 3]]
    assert C == pytest.approx(mirrored, rel=1e-6)


def test_it_falls_from_the_end_to_the_middle_and_then_stays() -> None:
    """A pad in the middle of a face; those beside its edges dent the section as a whole, farther along."""
    C = found(0.008)
    middle = C.rings[0][:, 2, 2]
    assert middle[0] > 1.1 * middle[-1]
    assert middle[-3] == pytest.approx(middle[-1], rel=0.05)


@pytest.mark.slow
@pytest.mark.numerical
def test_a_wall_half_as_thick_gives_way_as_a_plate_does() -> None:
    """By the cube in bending, by its first power as a membrane; the middle of a face is in between, near the cube."""
    thick, thin = (found(t).rings[0][-1, 3, 3] for t in (0.008, 0.004))
    assert 5.0 < thin / thick < 8.0


def test_a_free_end_gives_way_across_and_in_torsion() -> None:
    along_y, along_z, about_x = found(0.008).end
    assert 2e-8 < along_y < 3e-8 and 6e-9 < along_z < 1e-8 and about_x > 5e-8
