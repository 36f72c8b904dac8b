"""Beams and shells whose walls are thicker over a part of their length, against closed forms and each other."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from gathering import gathered
from varying import RHO, E, G, answers, areas, beam, shell

import pmr
from pmr import scene as scenes
from pmr.fem.compat import MPI
from pmr.fullmodel.model import assemble_model
from pmr.fullmodel.pads import Pad, under_pad
from pmr.models.beam2d import planar_beam
from pmr.models.meshed import Assembler
from pmr.models.profile_section import section_of
from pmr.scene.box import Box

LENGTH, THICK = 6.0, 1.3  # m: the second one, from where on walls are as thin as the box says
ALL = {"start": 0.0, "end": THICK, "thickness": 0.006}
BOTTOM = ALL | {"faces": ["bottom"]}
LEANING = ALL | {"faces": ["bottom", "left"]}
SIDES = ("middle", "outer", "inner")


def box(*doublers: dict, **given) -> Box:
    return Box(**({"length": LENGTH, "width": 0.3, "height": 0.4, "wall": 0.008, "doublers": doublers} | given))


def test_a_doubler_on_one_side_changes_what_docs_profiles_says() -> None:
    """Beside one about the walls' middle: both plates' middle is 3 mm farther out, or in."""
    middle, out, within = (section_of(box(ALL | {"side": side}).stretches[0].first, 0.3) for side in SIDES)
    for key, more, less in (
        ("second_moment_y", 0.049, 0.048),
        ("second_moment_z", 0.057, 0.055),
        ("torsion_constant", 0.054, 0.052),
        ("area", 0.017, 0.017),
    ):
        whole = getattr(middle, key)
        assert getattr(out, key) / whole - 1.0 == pytest.approx(more, abs=5e-4)
        assert 1.0 - getattr(within, key) / whole == pytest.approx(less, abs=5e-4)


@pytest.mark.parametrize("shape", [{}, {"radius": 0.03}, {"chamfer": 0.08}])
@pytest.mark.parametrize(("side", "by"), [("outer", 0.006), ("inner", -0.006)])
def test_plates_all_around_are_a_box_of_another_size_with_thicker_walls(side: str, by: float, shape: dict) -> None:
    """Faces and corners move by 3 mm; a chamfer of 45 degrees keeps what 2 tan(22.5 degrees) times that leaves."""
    moved = dict(shape)
    if "radius" in shape:
        moved["radius"] = shape["radius"] + by / 2.0
    if "chamfer" in shape:
        moved["chamfer"] = shape["chamfer"] + by * (1.0 - np.sqrt(0.5))
    found = section_of(box(ALL | {"side": side}, **shape).stretches[0].first, 0.3).model_dump()
    other = Box(length=LENGTH, width=0.3 + by, height=0.4 + by, wall=0.014, **moved)
    for key, expected in section_of(other, 0.3).model_dump().items():
        assert found[key] == pytest.approx(expected, rel=1e-12, abs=1e-15)


@pytest.mark.parametrize(("side", "low"), [("outer", -0.204), ("inner", -0.196)])
def test_a_plate_below_is_a_rectangle_added_by_hand(side: str, low: float) -> None:
    """Outside from edge to edge of the box, inside from wall to wall; by Steiner's theorem, and Bredt's formula."""
    b, d = (0.308, 0.006) if side == "outer" else (0.292, 0.006)
    z = low - d / 2.0 if side == "outer" else low + d / 2.0
    found, plain = section_of(box(BOTTOM | {"side": side}).stretches[0].first, 0.3), section_of(box(), 0.3)
    assert found.area == pytest.approx(plain.area + b * d, rel=1e-12)
    centroid = b * d * z / found.area
    assert found.centroid == (0.0, pytest.approx(centroid, rel=1e-12))
    about = plain.second_moment_y + plain.area * centroid**2 + b * d * ((z - centroid) ** 2 + d**2 / 12.0)
    assert found.second_moment_y == pytest.approx(about, rel=1e-12)
    assert found.second_moment_z == pytest.approx(plain.second_moment_z + d * b**3 / 12.0, rel=1e-12)
    height = 0.4 + (0.003 if side == "outer" else -0.003)
    bredt = 4.0 * (0.3 * height) ** 2 / (0.3 / 0.014 + 0.3 / 0.008 + 2.0 * height / 0.008)
    assert found.torsion_constant == pytest.approx(bredt, rel=1e-12)


@pytest.mark.mpi
def test_a_stepped_cantilever_bends_stretches_and_twists_as_its_closed_form() -> None:
    """Statics of stepped beams is exact on any mesh."""
    of_box = box(ALL)
    thick, thin = (section_of(one.first, 0.3) for one in of_box.stretches)
    found, rest = answers(beam(of_box)), LENGTH - THICK
    bent = [(LENGTH**3 - rest**3) / (3.0 * E * thick.second_moment_y), rest**3 / (3.0 * E * thin.second_moment_y)]
    assert found[2, 2] == pytest.approx(sum(bent), rel=1e-9)
    assert found[0, 0] == pytest.approx(THICK / (E * thick.area) + rest / (E * thin.area), rel=1e-10)
    twist = THICK / (G * thick.torsion_constant) + rest / (G * thin.torsion_constant)
    assert found[3, 3] == pytest.approx(twist, rel=1e-10)
    sheared = answers(beam(of_box, shear=True))[2, 2] - found[2, 2]
    assert sheared == pytest.approx(THICK / (G * thick.shear_area_z) + rest / (G * thin.shear_area_z), rel=1e-7)


@pytest.mark.mpi
def test_an_axial_force_bends_what_is_thickened_on_one_side() -> None:
    """N on the axis has the arm z_c about the centroid of the thick part, and none beyond."""
    of_box = box(BOTTOM)
    thick = section_of(of_box.stretches[0].first, 0.3)
    curvature = thick.centroid[1] / (E * thick.second_moment_y)  # of w, for N = 1 N
    found = answers(beam(of_box))
    assert thick.centroid[1] < -0.02 and found[2, 0] == pytest.approx(
        curvature * THICK * (LENGTH - THICK / 2.0), rel=1e-9
    )
    assert found[0, 0] == pytest.approx(
        THICK * (1.0 / (E * thick.area) + curvature * thick.centroid[1])
        + (LENGTH - THICK) / (E * section_of(of_box, 0.3).area),
        rel=1e-9,
    )


@pytest.mark.mpi
@pytest.mark.parametrize("doubler", [ALL, BOTTOM, LEANING, LEANING | {"side": "outer"}])
def test_mass_and_rigid_motions_are_exact(doubler: dict) -> None:
    of_box = box(doubler, {"start": 3.0, "end": 3.5, "thickness": 0.01})
    model = beam(of_box, shear=True)
    operators = assemble_model(model, model.domain(MPI.COMM_WORLD))
    M, K, R = gathered(operators.M), gathered(operators.K), model.rigid_motions()
    parts = [(one.end - one.start, (one.end + one.start) / 2.0, section_of(one.first, 0.3)) for one in of_box.stretches]
    mass = RHO * sum(h * section.area for h, _, section in parts)
    assert [R[:, k] @ M @ R[:, k] for k in range(3)] == pytest.approx([mass] * 3, rel=1e-12)
    assert R[:, 1] @ M @ R[:, 5] == pytest.approx(RHO * sum(h * x * s.area for h, x, s in parts), rel=1e-12)
    assert R[:, 0] @ M @ R[:, 4] == pytest.approx(
        RHO * sum(h * s.area * s.centroid[1] for h, _, s in parts), abs=1e-12 * mass
    )
    assert np.abs(K @ R).max() < 1e-11 * np.abs(K).max()


@pytest.mark.mpi
def test_the_axial_force_in_a_moving_frame_is_that_of_the_mass_beyond() -> None:
    """Of rigid turning w' = -1: the integral of N, which is minus that of rho A a x, and F L."""
    of_box, a, b, F = box(ALL), 3.0, 0.7, 11.0
    model = beam(of_box)
    assembler = Assembler(model, model.domain(MPI.COMM_WORLD))
    state = SimpleNamespace(acceleration=np.array([a, 0.0, 0.0]), stretch=b, forces=[("tip", np.array([F, 0.0, 0.0]))])
    A, turn = gathered(assembler.matrix(model.geometric_stiffness(assembler.space, state))), model.rigid_motions()[:, 4]
    inertia = sum(
        RHO * section_of(one.first, 0.3).area
        * (a * (one.end**2 - one.start**2) / 2.0 + b * (one.end**3 - one.start**3) / 3.0)
        for one in of_box.stretches
    )  # fmt: skip
    assert turn @ A @ turn == pytest.approx(F * LENGTH - inertia, rel=1e-11)


@pytest.mark.mpi
@pytest.mark.parametrize("side", SIDES)
def test_a_planar_beam_is_the_one_in_space_in_its_plane(side: str) -> None:
    """Its matrices, and what it measures, are the part of it; centroids are beside the axis everywhere."""
    of_box = box(
        BOTTOM | {"side": side},
        wall={"bottom": 0.012, "sides": 0.008, "top": 0.008},
        tip_taper={"length": 2.0, "height": 0.25},
    )
    space = beam(of_box)
    planar = planar_beam(space.body, of_box, np.array([0.0, LENGTH]))
    own, sign = (
        (6 * np.arange(len(planar.nodes))[:, None] + [0, 2, 4]).ravel(),
        np.tile(planar.signs, len(planar.nodes)),
    )
    state = SimpleNamespace(acceleration=np.array([3.0, 0.0, 0.0]), stretch=0.7, forces=[])
    for name in ("M", "K", "G"):
        found, whole = (matrix(model, name, state) for model in (planar, space))
        assert found == pytest.approx(sign[:, None] * whole[np.ix_(own, own)] * sign, abs=1e-12 * abs(whole).max())
    for place in ("tail", 0.7, 4.9, "tip"):
        expected = space.motion(place).toarray()[[0, 2, 4]][:, own] * sign
        assert planar.motion(place).toarray() == pytest.approx(expected, abs=1e-13)
    forces, whole = planar.section_forces(), space.section_forces()
    kept = [name in forces.names for name in whole.names]
    expected = whole.rows.toarray()[kept][:, own] * sign
    assert forces.rows.toarray() == pytest.approx(expected, rel=1e-9, abs=1e-9 * abs(expected).max())
    assert planar.resultants == pytest.approx(
        (space.resultants[:, [0, 2, 4]][:, :, [0, 2, 4]] * planar.signs), abs=1e-12
    )


def matrix(model, name: str, state: SimpleNamespace) -> np.ndarray:
    assembler = Assembler(model, model.domain(MPI.COMM_WORLD))
    forms = model.forms(assembler.space)
    of = {"M": forms.mass, "K": forms.stiffness, "G": model.geometric_stiffness(assembler.space, state)}
    return gathered(assembler.matrix(of[name]))


def test_stresses_know_where_walls_are_thicker() -> None:
    """M c / I of each part under a moment at the tip."""
    of_box = box(ALL)
    model = beam(of_box)
    K = gathered(assemble_model(model, model.domain(MPI.COMM_SELF)).K)
    free, q = np.arange(6, model.size), np.zeros(model.size)
    load = model.motion("tip").toarray()[4]
    q[free] = np.linalg.solve(K[np.ix_(free, free)], load[free])
    forces, stresses = model.section_forces(), model.stresses()
    bent = np.array(forces.names) == "bending moment y"
    assert forces.rows[bent] @ q == pytest.approx(np.ones(bent.sum()), rel=1e-9)
    found = (stresses.rows @ q)[::2]
    for one in of_box.stretches:
        section, (corner, *_) = section_of(one.first, 0.3), [c for c in one.first.corners if c.name == "top left"]
        here = (stresses.face == stresses.faces.index("top left")) & (stresses.points[:, 0] > one.start + 0.01)
        here &= stresses.points[:, 0] < one.end - 0.01
        assert stresses.points[here, 2] == pytest.approx(corner.position[1], rel=1e-12)
        assert found[here] == pytest.approx(corner.position[1] / section.second_moment_y, rel=1e-9)


@pytest.mark.parametrize("doubler", [ALL, LEANING])
def test_a_shells_cells_are_as_thick_as_the_walls_where_they_are(doubler: dict, tmp_path: Path) -> None:
    """Volume: that of thin walls, to round-off; layers of cells end where the doubler does."""
    pytest.importorskip("gmsh")
    of_box = box(doubler, chamfer=0.08, radius=0.03)
    model = shell(of_box, tmp_path, 0.1, 0.5)
    flat, area = [side.name for side in of_box.faces.values()], areas(model.mesh)
    for name in flat:
        cells = model.mesh.regions[name]
        side, own = of_box.faces[name], doubler.get("faces")
        more = 0.006 * THICK * (own is None or name in own)
        assert (area * model.thickness)[cells].sum() == pytest.approx(side.length * (0.008 * LENGTH + more), rel=1e-12)
    assert {"corners"} == set(model.mesh.regions) - set(flat) or doubler is LEANING


@pytest.mark.parametrize(("side", "by"), [("outer", 0.006), ("inner", -0.006)])
def test_a_shell_with_plates_all_along_is_that_of_a_box_of_another_size(side: str, by: float, tmp_path: Path) -> None:
    """Points, thickness and groups; a taper changes both alike."""
    pytest.importorskip("gmsh")
    taper = {"tip_taper": {"length": 2.0, "height": 0.3}}
    found = shell(box(ALL | {"side": side, "end": LENGTH}, **taper), tmp_path, 0.1, 0.5)
    taper["tip_taper"]["height"] += by
    other = shell(box(width=0.3 + by, height=0.4 + by, wall=0.014, **taper), tmp_path, 0.1, 0.5)
    points, cells = (mesh.points[mesh.cells].mean(axis=1) for mesh in (found.mesh, other.mesh))
    assert points == pytest.approx(cells, abs=1e-9) and found.mesh.regions.keys() == other.mesh.regions.keys()
    assert found.thickness == pytest.approx(other.thickness, rel=1e-12)


@pytest.mark.parametrize("side", ["outer", "inner"])
def test_the_middle_of_a_shells_wall_has_a_ramp_where_plates_on_one_side_end(side: str, tmp_path: Path) -> None:
    """Of two layers of cells; pads measure motions over it exactly, as the normal of their face does not lean."""
    pytest.importorskip("gmsh")
    model = shell(box(BOTTOM | {"side": side}), tmp_path, 0.1, 0.25)
    mesh, by = model.mesh, 0.003 if side == "outer" else -0.003
    assert {name for name in mesh.regions if "ramp" in name} == {"bottom ramp"}
    points = mesh.points[np.unique(mesh.cells[np.concatenate([mesh.regions["bottom"], mesh.regions["bottom ramp"]])])]
    share = np.clip((THICK + 0.25 - points[:, 0]) / 0.5, 0.0, 1.0)
    assert points[:, 2] == pytest.approx(-0.2 - by * share, abs=1e-12)
    assert np.any((share > 0.0) & (share < 1.0)) and np.abs(points[:, 1]).max() == pytest.approx(0.15, rel=1e-12)
    assert np.unique(model.thickness[mesh.regions["bottom ramp"]].round(9)) == pytest.approx([0.008, 0.014])
    pad = Pad("pad", "bottom", at=THICK, across=0.05, length=0.3, width=0.08)
    place, down = np.array([THICK, 0.05, 0.0]), np.array([0.0, 0.0, -1.0])
    expected = np.concatenate([down, np.cross(place, down)])
    assert (under_pad(pad, model, np.array([THICK])) @ model.rigid_motions())[0] == pytest.approx(expected, abs=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("doubler", [ALL, LEANING])
def test_a_long_shell_with_doublers_answers_as_the_beam(doubler: dict, side: str, tmp_path: Path) -> None:
    """All 36 answers within 0.4 % of the geometric mean of their own two; what couples them is above that."""
    pytest.importorskip("gmsh")
    of_box = box(doubler | {"end": 3.0, "side": side})
    expected, found = answers(shell(of_box, tmp_path, 0.05, 0.3)), answers(beam(of_box, shear=True))
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.all(np.abs(found - expected) < 0.004 * scale)
    plain = answers(beam(box(), shear=True))
    assert np.all(np.diag(plain) > 1.1 * np.diag(expected))
    if doubler is LEANING:
        assert abs(expected / scale)[0, 4] > 0.05 and abs(expected / scale)[0, 5] > 0.05


@pytest.mark.slow
def test_pads_slide_over_the_end_of_plates_on_the_other_side_of_the_wall() -> None:
    """A shell, whose pads pass the ramp, moves as a beam whose walls give way; with plates outside it is stiffer."""
    pytest.importorskip("gmsh")
    plates = "body.box.doublers=[{{start=0.0,end=3.0,thickness=0.006,side='{}'}}]"
    motion = dict[tuple[str, str], np.ndarray]()
    for workflow, side in (("boom_shell", "inner"), ("boom_beam_walls", "inner"), ("boom_beam_walls", "outer")):
        scene = scenes.load_any(workflow, [plates.format(side), "mesh={size=0.1,along=0.25}", "compare.against=[]"])
        low, high = scene.path_bounds
        assert low < 3.0 < high
        response = pmr.simulate(scene, pmr.reduce(scene).reduced)
        motion[workflow, side] = response.displacement[
            :, [of.kind == "tip" for of in response.outputs[: len(response.x)]]
        ]
    shell_boom, beam_boom, other = motion.values()
    size = np.linalg.norm(shell_boom)
    assert np.linalg.norm(beam_boom - shell_boom) < 0.005 * size < np.linalg.norm(other - shell_boom)


@pytest.mark.mpi
@pytest.mark.parametrize(("sizes", "sign"), [("outer", 1.0), ("inner", -1.0)])
def test_a_box_by_outer_or_inner_sizes_has_the_operators_of_its_mid_surface(sizes: str, sign: float) -> None:
    """Walls of 12 mm below, 8 mm else, a doubler, and a tip of 0.25 m by 6 mm: each size is half of two walls off."""
    wall, given = {"bottom": 0.012, "sides": 0.008, "top": 0.008}, {"length": LENGTH, "doublers": (BOTTOM,)}
    middle = Box(width=0.30, height=0.40, wall=wall, tip_taper={"length": 2.0, "height": 0.25, "wall": 0.006}, **given)
    tip = {"length": 2.0, "width": 0.30 + sign * 0.006, "height": 0.25 + sign * 0.006, "wall": 0.006}
    width, height = 0.30 + sign * 0.008, 0.40 + sign * 0.010
    other = Box(width=width, height=height, wall=wall, sizes=sizes, tip_taper=tip, **given)
    for model, same in zip(*(operators_of(beam(of_box, shear=True)) for of_box in (middle, other)), strict=True):
        assert np.abs(model - same).max() <= 1e-12 * np.abs(model).max()


def operators_of(model) -> tuple[np.ndarray, np.ndarray]:
    """Mass and stiffness matrix of a model."""
    operators = assemble_model(model, model.domain(MPI.COMM_WORLD))
    return gathered(operators.M), gathered(operators.K)
