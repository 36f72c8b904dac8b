"""Boxes with a varying section, as beams and as shells, and their static response to loads at the tip."""

from pathlib import Path

import numpy as np
from statics import static_outputs

from pmr.fullmodel.actions import Action
from pmr.fullmodel.structure import Clamp, Structure, structural_model
from pmr.models import DIRECTIONS
from pmr.models.beam3d import Beam3D, box_beam
from pmr.models.box_mesh import write_shell
from pmr.models.named_mesh import read_mesh
from pmr.models.shell import Shell, boom_of_box, of
from pmr.scene import Body
from pmr.scene.box import Box
from pmr.scene.structures import Beam3DBody, Material, PointMass

E, G, RHO = Material().young, Material().shear_modulus, Material().density


def beam(of_box: Box, shear: bool = False, elements: int = 4) -> Beam3D:
    """Beam of a box, with shear flexibility or without."""
    return box_beam(Beam3DBody(length=of_box.length, profile=of_box, shear=shear, elements=elements), of_box)


def answers(model) -> np.ndarray:
    """Displacement and rotation (6, 6) of the tip under unit forces and moments there, of a clamped model."""
    loads, seen = (tuple(Action(f"{kind} {d}", "tip", d) for d in DIRECTIONS) for kind in ("load", "motion"))
    cap = () if model.node_stations is not None else (PointMass(name="c", on="tip", mass=1e-6, coupling="rigid"),)
    return static_outputs(
        structural_model(Structure(model, clamps=(Clamp("tail"),), masses=cap, loads=loads, outputs=seen))
    )


def shell(of_box: Box, folder: Path, size: float, along: float) -> Shell:
    """Shell of a box, meshed in a folder with cells of `size` m around and `along` m along it."""
    write_shell(boom_of_box(of_box, size, along), folder / "m.msh")
    return of(Body(box=of_box), read_mesh(folder / "m.msh", ("triangle",)))


def areas(mesh) -> np.ndarray:
    """Areas in m^2 of a mesh's triangles."""
    a, b, c = (mesh.points[mesh.cells[:, i]] for i in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2.0
