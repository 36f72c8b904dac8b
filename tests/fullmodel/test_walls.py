"""Walls of a beam that give way: what the coordinates do that stand for their dents, and how far they give way."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from gathering import gathered

from pmr.fullmodel.actions import Action
from pmr.fullmodel.pads import Pad, Pads, Support
from pmr.fullmodel.structure import Clamp, Structure, structural_model
from pmr.fullmodel.wall_compliance import A_LAYER, PlateBody, Ring, places_along, wall_compliance
from pmr.fullmodel.walls import Sliding, Standing, Walls, summary
from pmr.models.beam3d import Beam3D
from pmr.models.shell import boom_of_box
from pmr.scene.box import Box
from pmr.scene.structures import Beam3DBody, BoxProfile, Material, PointMass

TRAVEL = (0.6, 1.7)
PROFILE = BoxProfile(width=0.3, height=0.4, wall=0.008)
RING = (Pad("top", "top", across=0.1), Pad("bottom", "bottom", across=-0.05), Pad("left", "left", across=0.02))
NAMES = tuple(pad.name for pad in RING)
FAR = 0.5  # m, that the ring slides


def beam() -> Beam3D:
    return Beam3D(Beam3DBody(length=2.0, profile=PROFILE, shear=True, elements=10))


def compliance(k: int = 3) -> np.ndarray:
    """Of k pads, (k, k) m/N."""
    A = np.random.default_rng(3).uniform(-1.0, 1.0, (k, k))
    return 1e-8 * (A @ A.T + np.eye(k))


def staying() -> Walls:
    return Walls(Standing(NAMES, (), compliance(), np.full(3, 2.0)))


def sliding(m: int = 0) -> Sliding:
    """The ring at four places, beside m that stay: less and less compliant, and less and less near to them."""
    whole, u = compliance(3 + m), np.linspace(0.0, FAR, 4)
    less = np.array([4.0, 2.5, 1.4, 1.0])[:, None, None]
    return Sliding(
        NAMES, np.full(3, 0.9), u, less * whole[m:, m:], np.sqrt(less) / less * whole[m:, :m], np.full(3, 2.0)
    )


def clamped(pads: Pads, **rest) -> Structure:
    return Structure(beam(), clamps=(Clamp("tail"),), pads=pads, **rest)


def test_round_off_of_a_path_adds_no_place() -> None:
    """One place more moves what is found between places by as much as interpolation is off."""
    for count in range(1, 50):
        for off in (-1e-14, 0.0, 1e-14):
            assert len(places_along(0.7 * count / A_LAYER * (1.0 + off), 0.7)) == count + 1


def pressed(structure: Structure, s: float) -> np.ndarray:
    """What all rows measure of the answers to unit forces of their pads."""
    full = structural_model(structure)
    C, K = full.rows.at(s).toarray(), gathered(full.K)
    return C @ scipy.linalg.solve(K, C.T, assume_a="pos")


@pytest.mark.slow
def test_pads_that_slide_find_the_walls_compliance_on_top_of_the_beams() -> None:
    moving, walls = tuple(replace(pad, at=0.2) for pad in RING), Walls(sliding=(sliding(),))
    one = walls.sliding[0]
    for s, place in ((0.7, 0), (0.7 + FAR / 3.0, 1), (0.7 + FAR, 3), (0.65, 0), (1.3, 3)):  # constant outside
        travel = (0.6, s) if s > 0.7 else (s, 1.4)  # so that s is a break
        rigid = pressed(clamped(Pads(moving=moving, travel=travel)), s)
        gives = pressed(clamped(Pads(moving=moving, travel=travel, walls=walls)), s)
        assert gives - rigid == pytest.approx(one.compliance[place], rel=1e-6, abs=1e-13)


def test_pads_that_slide_dent_the_walls_under_those_that_stay() -> None:
    """In between two breaks a row is a cubic, whose square is the compliance to 0.3 %."""
    fixed = tuple(replace(pad, name=f"{pad.name} 2", at=0.3, stiffness=np.inf) for pad in RING)
    moving, one = tuple(replace(pad, at=0.2) for pad in RING), sliding(3)
    names = tuple(pad.name for pad in fixed)
    own = compliance(6)[:3, :3]
    walls = Walls(Standing(names, (), own, np.full(3, 2.0)), (one,))
    for s, place, exact in ((0.7 + FAR, 3, 1e-6), (0.7 + FAR / 3.0, 1, 3e-3)):
        travel = (0.7, 0.7 + FAR)
        rigid = pressed(clamped(Pads(fixed, moving, travel=travel)), s)
        gives = pressed(clamped(Pads(fixed, moving, travel=travel, walls=walls)), s)
        beside = one.standing_compliance[place]
        expected = np.block([[own, beside.T], [beside, one.compliance[place]]])
        assert gives - rigid == pytest.approx(expected, rel=exact, abs=exact * 1e-8)


def test_two_pads_in_one_place_are_no_reason_to_fail() -> None:
    same = Walls(Standing(("top", "bottom"), (), np.full((2, 2), 1e-8), np.ones(2)), (sliding(2),))
    assert same.count == 5 and np.all(np.isfinite(same.stiffness(20).toarray()))
    row = structural_model(clamped(Pads(moving=RING, travel=(0.9, 1.4), walls=same))).rows.at(1.0)
    assert np.all(np.isfinite(row.toarray()))


def test_a_pad_that_stays_presses_on_the_wall_where_it_is() -> None:
    """As a spring of the structure; its compliance and the wall's are in series."""
    stiffness = 3e8
    fixed = tuple(replace(pad, at=1.85, stiffness=stiffness) for pad in RING)
    load = Action("F", 1.9, "z")
    tip = {}
    for name, walls in (("rigid", Walls()), ("gives", staying())):
        full = structural_model(clamped(Pads(fixed, walls=walls), loads=(load,), outputs=(load,)))
        B, C, K = (gathered(A) for A in (full.B, full.outputs, full.K))
        tip[name] = (C.T @ scipy.linalg.solve(K, B, assume_a="pos")).item()
    rigid_pads = tuple(replace(pad, at=1.85, stiffness=np.inf) for pad in RING)
    full = structural_model(clamped(Pads(rigid_pads), loads=(load,), outputs=(load,)))
    B, O, K = (gathered(A) for A in (full.B, full.outputs, full.K))
    U = full.rows.at(0.0).toarray()
    free, answers = scipy.linalg.solve(K, B, assume_a="pos"), scipy.linalg.solve(K, U.T, assume_a="pos")
    for name, give in (("rigid", 0.0), ("gives", compliance())):
        F = U @ answers + np.eye(3) / stiffness + give
        expected = O.T @ free - (O.T @ answers) @ np.linalg.solve(F, U @ free)
        assert tip[name] == pytest.approx(expected.item(), rel=1e-9)


def test_dents_move_with_nothing_rigid() -> None:
    full = structural_model(Structure(beam(), pads=Pads(moving=RING, travel=TRAVEL, walls=staying())))
    plain = structural_model(Structure(beam(), pads=Pads(moving=RING, travel=TRAVEL)))
    R, of_plain = full.rigid.coordinates, plain.rigid.coordinates
    assert full.size == plain.size + 3 and np.all(R[-3:] == 0.0)
    assert full.rows.at(1.1) @ R == pytest.approx(plain.rows.at(1.1) @ of_plain, abs=1e-12)
    M, of_all = gathered(full.M), gathered(plain.M)
    scale = 2.0 * np.diag(compliance()) / np.diag(compliance()).mean()
    assert M[-3:, -3:] == pytest.approx(np.diag(scale)) and not M[:-3, -3:].any()
    assert R.T @ M @ R == pytest.approx(of_plain.T @ of_all @ of_plain)


@pytest.mark.slow
@pytest.mark.parametrize("on", ["tip", 2.0])
def test_what_is_spread_over_a_free_end_moves_its_walls_too(on: str | float) -> None:
    """A load, what is measured there, a mass and a support; a load at a distance leaves the walls of the end alone."""
    ends = (("tip", "y"), ("tip", "rx"))
    give = Walls(Standing((), ends, np.array([[1e-7, 1e-7], [1e-7, 1e-6]]), np.array([1.0, 0.1])))
    for direction, more in (("y", 1e-7), ("z", 0.0), ("rx", 1e-6)):
        load = Action("F", on, direction)
        found = {}
        for name, walls in (("rigid", Walls()), ("gives", give)):
            full = structural_model(clamped(Pads(walls=walls), loads=(load,), outputs=(load,)))
            B, K = gathered(full.B), gathered(full.K)
            found[name] = (B.T @ scipy.linalg.solve(K, B, assume_a="pos")).item()
        assert found["gives"] - found["rigid"] == pytest.approx(more if on == "tip" else 0.0, rel=1e-6, abs=1e-15)
    mass = PointMass(name="m", on="tip", mass=100.0)
    M = gathered(structural_model(clamped(Pads(walls=give), masses=(mass,))).M)
    plain = gathered(structural_model(clamped(Pads(walls=give))).M)
    support = Support("hold", "tip", "y")
    row = structural_model(clamped(Pads(supports=(support,), walls=give))).rows.at(0.0).toarray()
    assert (M - plain)[-2:, -2:] == pytest.approx(100.0 * np.outer(row[0, -2:], row[0, -2:]))
    assert row[0, -2:] @ row[0, -2:] == pytest.approx(give.stiffness_scale * 1e-7)


def test_a_summary_says_how_far_each_wall_gives_way() -> None:
    """Of pads that slide on average over the path."""
    both = Walls(Standing(("tail",), (), np.array([[3e-8]]), np.ones(1)), (sliding(1),))
    said = summary({"": both, "fly": staying()})["walls"]
    assert [one["name"] for one in said] == ["tail", *NAMES, *(f"fly: {name}" for name in NAMES)]
    slid = sliding(1).compliance.mean(axis=0)
    for one, own in zip(said, (3e-8, *np.diag(slid), *np.diag(compliance())), strict=True):
        assert (one["compliance"], one["stiffness"]) == pytest.approx((own, 1.0 / own))
    assert summary({"": Walls()}) == {}


def test_the_wall_under_a_sliding_pad_gives_way_as_it_does_at_this_place() -> None:
    """A ring that is 0.2 m ahead of the path coordinate; beyond its way the compliance stays that of the end."""
    ring = sliding(1)
    walls = Walls(Standing(("tail",), (), np.array([[3e-8]]), np.ones(1)), (ring,))
    moving = tuple(Pad(name, name, at=0.2) for name in NAMES)
    pads = Pads(fixed=(Pad("tail", "top"),), moving=moving, travel=TRAVEL, walls=walls)
    for i, name in enumerate(NAMES):
        for u, compliance_there in zip(ring.u, ring.compliance[:, i, i], strict=True):
            assert pads.wall_compliance(name, 0.7 + u) == pytest.approx(compliance_there, rel=1e-12)
        assert pads.wall_compliance(name, 9.0) == ring.compliance[-1, i, i]
    assert pads.wall_compliance("tail", 9.0) == 3e-8 and Pads().wall_compliance("tail", 0.0) == 0.0


PRESSED = tuple(
    Pad(f"{face} {across}", face, across=across, width=0.06, length=0.2, at=1.0)
    for face, across in [("top", -0.1), ("top", 0.1), ("bottom", 0.0), ("left", 0.0), ("right", 0.0)]
)


def found(thickness: float, staying=PRESSED, rings=(), ends=(), clamps=()):
    """How far the walls of a box give way, by a shell of it."""
    pytest.importorskip("gmsh")
    box = Box(length=2.4, width=0.3, height=0.4, wall=thickness)
    return wall_compliance(
        PlateBody(boom_of_box(box, 0.15, 0.15), box, Material(), 5.0 / 6.0, clamps), staying, ends, rings
    )


@pytest.mark.slow
@pytest.mark.numerical
def test_the_shells_compliance_is_symmetric_definite_and_a_mirror_image_of_itself() -> None:
    C, _ = found(0.008)
    assert C == pytest.approx(C.T, rel=1e-9)
    assert np.all(np.linalg.eigvalsh(C) > 0.0)
    mirrored = C[[1, 0, 2, 4, 3]][:, [1, 0, 2, 4, 3]]
    assert C == pytest.approx(mirrored, rel=1e-9, abs=1e-9 * C.max())


@pytest.mark.slow
def test_a_later_run_reads_the_compliance_that_an_earlier_one_has_computed(tmp_path, monkeypatch) -> None:
    """Both give the same numbers; a damaged file is made again."""
    monkeypatch.setenv("PMR_CACHE", str(tmp_path))
    ring = Ring(tuple(replace(pad, at=0.6) for pad in PRESSED[:2]), 0.3)

    def compute() -> tuple:
        """Compute as a new process does, which has nothing in its memory."""
        C, (sliding,) = found(0.0085, PRESSED[:2], (ring,))
        return C, sliding.u, sliding.sliding, sliding.standing

    first = compute()
    (file,) = tmp_path.glob("*.npz")
    written = file.stat().st_mtime_ns
    with monkeypatch.context() as without_shell:
        without_shell.setattr("pmr.fullmodel.wall_compliance.write_shell", None)
        again = compute()
    assert file.stat().st_mtime_ns == written and all(map(np.array_equal, first, again))
    file.write_bytes(b"damaged")
    assert all(map(np.array_equal, first, compute()))


@pytest.mark.slow
def test_a_free_end_is_softer_than_the_middle_and_one_that_is_clamped_stiffer() -> None:
    """Under a pad in the middle of a face."""
    ring, found_at = Ring(tuple(replace(pad, at=0.15) for pad in PRESSED), 1.05), {}
    for name, clamps in (("free", ()), ("clamped", (Clamp("tail"),))):
        along = found(0.008, (), (ring,), clamps=clamps)[1][0].sliding[:, 2, 2]
        found_at[name] = along[0] / along[-1]
    assert found_at["free"] > 1.05 and found_at["clamped"] < 0.8


@pytest.mark.slow
def test_rings_dent_each_others_walls_the_more_the_nearer_they_are() -> None:
    """As pads that stay do; those that twist a section out of its rectangle reach far."""
    ring = Ring(tuple(replace(pad, at=1.2) for pad in PRESSED[:2]), 0.9)
    _, (one,) = found(0.008, PRESSED[:2], (ring,))
    twisting = np.array([1.0, -1.0]) / np.sqrt(2.0)
    shared = one.standing @ twisting @ twisting / (one.sliding[-1] @ twisting @ twisting)
    assert 0.1 < shared[-1] < 0.9 * shared[0] and np.all(np.diff(shared) < 0.0)


@pytest.mark.slow
@pytest.mark.numerical
def test_a_wall_half_as_thick_gives_way_as_a_plate_does() -> None:
    """By the cube in bending, by its first power as a membrane; the middle of a face is in between, near the cube."""
    thick, thin = (found(t)[0][3, 3] for t in (0.008, 0.004))
    assert 5.0 < thin / thick < 8.0


def test_a_free_end_gives_way_across_and_in_torsion() -> None:
    ends = (("tip", "y"), ("tip", "z"), ("tip", "rx"))
    C, _ = found(0.008, (), ends=ends)
    along_y, along_z, about_x = np.diag(C)
    assert 1e-8 < along_y < 3e-8 and 4e-9 < along_z < 1.1e-8 and about_x > 5e-8
