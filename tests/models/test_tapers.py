"""Boxes that taper towards an end, as beams and as shells, against closed forms and each other."""

from pathlib import Path

import numpy as np
import pytest
from gathering import gathered
from varying import RHO, E, G, answers, areas, beam, shell

from pmr.fem.compat import MPI
from pmr.fullmodel.model import assemble_model
from pmr.models.profile_section import section_of
from pmr.scene.box import Box

LENGTH = 6.0
#: Half as high at the tip, walls that get thinner.
WEDGE = {"length": LENGTH, "width": 0.3, "height": 0.4, "wall": 0.008}
TIP = {"length": LENGTH, "height": 0.2, "wall": 0.005}
DOUBLER = {"start": 4.0, "end": 5.0, "thickness": 0.004}
LEANING = {"bottom": 0.012, "left": 0.010, "top": 0.008, "right": 0.006}


def integral(box: Box, of) -> float:
    """Over the length, by Gauss' rule of 8 points on two parts of each stretch."""
    x, w = np.polynomial.legendre.leggauss(8)
    total = 0.0
    for one in box.stretches:
        ends = np.linspace(one.start, one.end, 3)
        for a, b in zip(ends[:-1], ends[1:], strict=True):
            places = (a + b) / 2.0 + (b - a) / 2.0 * x
            total += (
                (b - a) / 2.0 * sum(weight * of(at, one.profile_at(at)) for at, weight in zip(places, w, strict=True))
            )
    return total


@pytest.mark.slow
def test_a_tapered_cantilever_bends_as_the_integral_of_its_flexibility_to_the_second_order() -> None:
    """Twice as many elements leave a quarter of the error, of bending, twist, stretching and shear."""
    box = Box(**WEDGE, tip_taper=TIP)
    sections = {}

    def section(at: float, profile):
        return sections.setdefault(at, section_of(profile, 0.3))

    bent = integral(box, lambda x, p: (LENGTH - x) ** 2 / (E * section(x, p).second_moment_y))
    exact = np.array(
        [
            integral(box, lambda x, p: 1.0 / (E * section(x, p).area)),
            bent + integral(box, lambda x, p: 1.0 / (G * section(x, p).shear_area_z)),
            integral(box, lambda x, p: 1.0 / (G * section(x, p).torsion_constant)),
        ]
    )
    off = [np.diag(answers(beam(box, shear=True, elements=n)))[[0, 2, 3]] / exact - 1.0 for n in (6, 12, 24)]
    assert np.all(np.abs(off[2]) < 1e-3)
    for coarse, fine in zip(off[:-1], off[1:], strict=True):
        assert np.log2(coarse / fine) == pytest.approx(2.0, abs=0.1)


@pytest.mark.slow
def test_the_wedge_of_one_wall_is_the_textbooks() -> None:
    """Thin walls, all but the height constant: I = t h^2 (h / 6 + b / 2), of a height that is linear in x."""
    b, h, t = 0.3, 0.4, 2e-6
    box = Box(length=LENGTH, width=b, height=h, wall=t, tip_taper={"length": LENGTH, "height": 0.1})
    x = np.linspace(0.0, LENGTH, 20001)
    height = h - 0.3 * x / LENGTH
    bent = (LENGTH - x) ** 2 / (E * t * height**2 * (height / 6.0 + b / 2.0))
    exact = np.sum((bent[1:] + bent[:-1]) / 2.0) * (x[1] - x[0])
    assert answers(beam(box, elements=60))[2, 2] == pytest.approx(exact, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("wall", [0.008, LEANING])
def test_the_mass_of_a_tapered_beam_is_exact_on_any_mesh(wall) -> None:
    box = Box(
        length=LENGTH, width=0.3, height=0.4, wall=wall, chamfer=0.08, doublers=[DOUBLER],
        tail_taper={"length": 1.0, "height": 0.25},
        tip_taper={"length": 2.5, "width": 0.2, "chamfer": 0.05, "wall": 0.005},
    )  # fmt: skip
    model = beam(box, shear=True, elements=7)
    operators = assemble_model(model, model.domain(MPI.COMM_SELF))
    M, K, R = gathered(operators.M), gathered(operators.K), model.rigid_motions()
    mass = RHO * integral(box, lambda x, p: section_of(p, 0.3).area)
    assert [R[:, k] @ M @ R[:, k] for k in range(3)] == pytest.approx([mass] * 3, rel=1e-12)
    assert np.abs(K @ R).max() < 1e-11 * np.abs(K).max()


def test_stress_is_that_of_the_profile_where_it_is() -> None:
    """M c / I at both ends of each element, not of its mean section."""
    box = Box(**WEDGE, tip_taper=TIP)
    model = beam(box, elements=5)
    K, q = gathered(assemble_model(model, model.domain(MPI.COMM_SELF)).K), np.zeros(model.size)
    q[6:] = np.linalg.solve(K[6:, 6:], model.motion("tip").toarray()[4, 6:])
    stresses = model.stresses()
    here = stresses.face == stresses.faces.index("top left")
    for (x, _, z), found in zip(stresses.points[here], (stresses.rows @ q)[::2][here], strict=True):
        profile = box.profile_at(x)
        assert z == pytest.approx(profile.height / 2.0 + profile.thickness("top") / 2.0, rel=1e-12)
        assert found == pytest.approx(z / section_of(profile, 0.3).second_moment_y, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("frames", [(), (1.0, 4.5)])
@pytest.mark.parametrize("radius", [0.0, 0.03])
def test_a_tapered_shell_is_where_its_walls_are(radius: float, frames, tmp_path: Path) -> None:
    """Each point of a wall in the middle of it; mass of flat walls exact; frames as deep as they are."""
    pytest.importorskip("gmsh")
    box = Box(
        length=LENGTH, width=0.3, height=0.4, wall=LEANING, radius=radius, frames=frames, frame_depth=0.02,
        tail_taper={"length": 1.5, "height": 0.25, "wall": 0.006}, tip_taper={"length": 2.5, "width": 0.2},
    )  # fmt: skip
    model = shell(box, tmp_path, 0.15, 0.5)
    mesh = model.mesh
    for name, wide in (("bottom", "width"), ("left", "height")):
        cells = np.concatenate([mesh.regions[name], mesh.regions[f"{name} tapered"]])
        axis = 2 if name == "bottom" else 1
        points = mesh.points[np.unique(mesh.cells[cells])]
        profiles = [box.profile_at(float(x)) for x in points[:, 0]]
        half = np.array([getattr(p, "height" if axis == 2 else "width") / 2.0 for p in profiles])
        assert np.abs(points[:, axis]) == pytest.approx(half, rel=1e-9)
        assert np.all(np.abs(points[:, 3 - axis]) <= [getattr(p, wide) / 2.0 - radius + 1e-9 for p in profiles])
        slope = {"bottom": (0.075 / 1.5, 0.0), "left": (0.0, 0.05 / 2.5)}[name]
        exact = 0.0
        for one in box.stretches:
            a, b = ((getattr(p, wide) - 2.0 * radius, p.thickness(name)) for p in (one.first, one.last))
            s, t = zip(a, b, strict=True)
            mean = (s[0] * t[0] + s[1] * t[1]) / 3.0 + (s[0] * t[1] + s[1] * t[0]) / 6.0
            leans = slope[0] if one.start == 0.0 else slope[1] if one.end == LENGTH else 0.0
            exact += mean * (one.end - one.start) * np.sqrt(1.0 + leans**2)
        assert (areas(mesh) * model.thickness)[cells].sum() == pytest.approx(exact, rel=1e-12)
    if frames:
        rings = mesh.points[np.unique(mesh.cells[mesh.regions["frames"]])]
        assert set(np.round(rings[:, 0], 9)) == set(frames)
        for x, y, z in rings:
            p = box.profile_at(float(x))
            beside = np.array([abs(y) - p.width / 2.0, abs(z) - p.height / 2.0]) + radius
            inside = np.hypot(*beside) if np.all(beside > 0.0) else beside.max()
            assert -0.02 - 1e-9 <= inside - radius <= 1e-9


@pytest.mark.slow
def test_a_long_tapered_shell_answers_as_the_beam(tmp_path: Path) -> None:
    """All 36 answers within 1 % of the geometric mean of their own two.

    Height and width taper alike: else torsion makes parallelograms of rectangles, which no beam knows of.
    """
    pytest.importorskip("gmsh")
    box = Box(
        length=LENGTH, width=0.3, height=0.4, wall={"bottom": 0.012, "sides": 0.008, "top": 0.008},
        tip_taper={"length": 4.0, "height": 0.28, "width": 0.21, "wall": 0.006},
    )  # fmt: skip
    expected, found = answers(shell(box, tmp_path, 0.05, 0.2)), answers(beam(box, shear=True, elements=24))
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.all(np.abs(found - expected) < 0.01 * scale)
