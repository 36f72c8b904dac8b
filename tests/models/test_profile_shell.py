"""Shells of profiles beside beams of them: static answers to all six loads at the end, and pads on slanted faces."""

from pathlib import Path

import numpy as np
import pytest
from statics import static_outputs

from pmr.fullmodel.actions import Action
from pmr.fullmodel.structure import Clamp, Structure, structural_model
from pmr.models import DIRECTIONS
from pmr.models.beam3d import Beam3D
from pmr.models.box_mesh import BoxBoom, write_shell
from pmr.models.named_mesh import read_mesh
from pmr.models.shell import Shell, shell_body
from pmr.models.trace import Window
from pmr.scene.profile import BoxProfile
from pmr.scene.structures import Beam3DBody, Material, PointMass

pytest.importorskip("gmsh")
LENGTH = 8.0
UNEQUAL = {"top": 0.008, "bottom": 0.012, "left": 0.006, "right": 0.010}
PROFILES = {
    "four thicknesses": {"wall": UNEQUAL},
    "octagon": {"wall": UNEQUAL, "chamfer": (0.1, 0.15)},
    "belly": {"wall": 0.008, "radius": {"bottom": 0.15}},
}


def shell(profile: BoxProfile, folder: Path, length: float, size: float, along: float) -> Shell:
    write_shell(BoxBoom(profile.sides, length, size, along), folder / "m.msh")
    return Shell(shell_body(profile, Material()), read_mesh(folder / "m.msh", ("triangle",)))


def answers(model) -> np.ndarray:
    """Displacement and rotation of the tip, which keeps its shape, (6, 6), under unit forces and moments."""
    cap = PointMass(name="cap", on="tip", mass=1e-6, coupling="rigid")
    loads, seen = (tuple(Action(f"{kind} {d}", "tip", d) for d in DIRECTIONS) for kind in ("load", "motion"))
    return static_outputs(
        structural_model(Structure(model, clamps=(Clamp("tail"),), masses=(cap,), loads=loads, outputs=seen))
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", PROFILES)
def test_a_long_shell_bends_twists_and_shears_as_the_beam_of_its_profile(name: str, tmp_path: Path) -> None:
    """All 36 answers within 1 % of the geometric mean of their own two; what couples them is far above that."""
    profile = BoxProfile(width=0.3, height=0.4, **PROFILES[name])
    fine = shell(profile, tmp_path, LENGTH, 0.04, 0.4)
    beam = Beam3D(Beam3DBody(length=LENGTH, profile=profile, shear=True, elements=4))
    assert beam.centroid("tip") == pytest.approx(fine.centroid("tip"), abs=1e-3)
    found, expected = answers(beam), answers(fine)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.abs(found - expected).max() < 0.01 * scale.max() and np.all(np.abs(found - expected) < 0.01 * scale)
    if name != "belly":
        assert np.abs(expected / scale)[0, 4] > 0.1 and np.abs(expected / scale)[0, 5] > 0.04


def test_pads_on_slanted_faces_feel_a_beam_as_they_feel_its_shell(tmp_path: Path) -> None:
    """Rigid motions: the mean displacement along the face's normal."""
    profile = BoxProfile(width=0.3, height=0.4, wall=0.008, chamfer=(0.1, 0.12))
    models = shell(profile, tmp_path, 1.2, 0.1, 0.1), Beam3D(Beam3DBody(length=1.2, profile=profile))
    for name, side in profile.faces.items():
        middle = sum(side.span) / 2.0
        window = Window((0.4, 0.8), (middle - 0.02, middle + 0.02), (0.01, 0.005))
        at = np.array([0.6, *(middle * side.across_direction + side.normal * (side.normal @ side.start))])
        normal = np.array([0.0, *side.normal])
        for model in models:
            strip = model.strip(name, window)
            assert strip.extent.across == pytest.approx(side.span)
            mean = strip.weights @ (strip.normal @ model.rigid_motions()) / strip.weights.sum()
            assert mean == pytest.approx([*normal, *np.cross(at, normal)], abs=2e-3)
