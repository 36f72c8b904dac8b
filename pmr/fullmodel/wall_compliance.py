r"""How far a box's walls give way under its pads and at its ends: static solves on a short shell of the profile.

A shell, `SEGMENT` times the larger of width and height long, free at one end and clamped at the other, is pressed by
one pad after the other.  With :math:`u_i` the mean displacement under pad i, :math:`f_j` the force of pad j and the
same of a beam of the same profile, length and support

.. math:: C_{ij}(x) = \frac{\partial u_i}{\partial f_j}\Big|_{shell} - \frac{\partial u_i}{\partial f_j}\Big|_{beam}

is the walls' own compliance, pads at x m from the free end.  The beam's part is taken off, so that what is left does
not depend on how the shell is held: the clamp is farther away than the walls' deformation reaches.  The free end's own
compliance follows in the same way, from forces and a torque that are spread over it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.fem.compat import MPI
from pmr.fem.distributed import freed
from pmr.fem.replicated import factor_for_columns
from pmr.fullmodel.pads import Pad, Pads, restrain
from pmr.fullmodel.structure import Clamp, Structure, couple, structural_model
from pmr.mesh.box import BoxBoom, write_shell
from pmr.mesh.named import read_mesh
from pmr.mesh.strip import FACES
from pmr.models import DIRECTIONS, StructuralModel
from pmr.models.beam3d import Beam3D
from pmr.models.shell import Shell
from pmr.scene.structures import Beam3DBody, BoxProfile, Material, Plate, ShellBody

Array = NDArray[np.float64]

#: Of the larger of width and height: the shell's length, and how far from the free end that plays a role.
#: Sections that are pushed out of their rectangle keep that shape far along a thin box.
SEGMENT, REACH = 10.0, 5.0
#: Places at the free end, and over one layer of cells away from it.
AT_THE_END, OVER_A_LAYER = 12, 4
#: Elements of the beam that is taken off.
ELEMENTS = 40
#: What an end's walls answer to, spread over it, and what tells how the clamp turns.
AT_AN_END, TURNS = ("y", "z", "rx"), ("rz", "ry")


@dataclass(frozen=True)
class Plates:
    """A profile as a shell: its plate, and edge lengths of its cells around the section and along the axis in m."""

    profile: BoxProfile
    material: Material
    shear_correction: float
    size: float
    along: float


@dataclass(frozen=True)
class WallCompliance:
    """Compliance of a box's walls."""

    places: Array  # (p,) m from a free end; the last one, as all beyond it, is away from the ends
    rings: tuple[Array, ...]  # (p, k, k) m/N each: of k pads around one place
    end: Array  # (3,): of a free end along y and z in m/N, about x in rad/(N m)


@lru_cache(maxsize=64)
def wall_compliance(plates: Plates, rings: tuple[tuple[Pad, ...], ...]) -> WallCompliance:
    """Of pads around one place each, whose `at` plays no role.  Not collective.

    Raises an `InputError` if a pad leaves its face.
    """
    longer = max(plates.profile.width, plates.profile.height)
    half = max(pad.length for ring in rings for pad in ring) / 2.0
    layers = int(np.ceil((SEGMENT * longer + 2.0 * half) / plates.along))
    length, far = layers * plates.along, REACH * longer + half
    at_the_end = half + (far - half) * (np.arange(AT_THE_END) / AT_THE_END) ** 1.5
    places = np.concatenate([at_the_end, far + plates.along * np.arange(OVER_A_LAYER) / OVER_A_LAYER])
    body = Beam3DBody(length=length, profile=plates.profile, material=plates.material, shear=True, elements=ELEMENTS)
    shell, beam = (_Pressed(model) for model in (_shell(plates, length), Beam3D(body)))
    along_y, along_z, about_x, *turns = shell.at_the_end() - beam.at_the_end()
    found = dict[tuple[Pad, ...], Array]()
    for ring in dict.fromkeys(rings):
        C = shell.under(ring, places) - beam.under(ring, places)
        C = (C + C.transpose(0, 2, 1)) / 2.0 - _by_the_clamp(ring, turns, length - places)
        mean = C[AT_THE_END:].mean(axis=0)  # between two nodes of a coarse mesh a pad dents it deeper than on one
        found[ring] = np.concatenate([C[:AT_THE_END], mean[None]])
    end = np.array([along_y - turns[0] * length**2, along_z - turns[1] * length**2, about_x])
    for one in (shell, beam):
        one.destroy()
    return WallCompliance(np.append(at_the_end, far), tuple(found[ring] for ring in rings), np.maximum(end, 0.0))


class _Pressed:
    """A model that is clamped at its tip, and its answers to forces."""

    def __init__(self, model: StructuralModel) -> None:
        structure = Structure(model, clamps=(Clamp("tip"),))
        self._model, self._T = model, couple(structure).T
        self._full = structural_model(structure, MPI.COMM_SELF)
        self._factor = factor_for_columns(self._full.K, "stiffness")

    def under(self, ring: Sequence[Pad], places: Array) -> Array:
        """What each pad of a ring measures of the answer to each of them, (p, k, k) m/N."""
        k, pads = len(ring), [replace(pad, at=float(x), stiffness=np.inf) for x in places for pad in ring]
        named = tuple(replace(pad, name=str(number)) for number, pad in enumerate(pads))
        rows = restrain(Pads(fixed=named), self._model, self._T).rows
        G = self._answers(sp.csr_matrix(sp.vstack([row.at(row.breaks[0]) for row in rows])))
        return np.stack([G[j : j + k, j : j + k] for j in range(0, len(G), k)])

    def at_the_end(self) -> Array:
        """Motion of the free end along `AT_AN_END` and `TURNS`, each under its own unit force or moment, (5,)."""
        which = [DIRECTIONS.index(direction) for direction in (*AT_AN_END, *TURNS)]
        return np.diag(self._answers(sp.csr_matrix(self._model.motion("tail")[which] @ self._T)))

    def _answers(self, U: sp.csr_matrix) -> Array:
        return np.asarray(U @ self._factor.solve_columns(np.asfortranarray(U.T.toarray())))

    def destroy(self) -> None:
        """Give the memory of its matrices back."""
        self._factor.destroy()
        freed(self._full.K, self._full.M, self._full.inputs, self._full.outputs)


def _by_the_clamp(ring: Sequence[Pad], turns: Sequence[float], arms: Array) -> Array:
    """What pads measure of each other, `arms` (p,) m from a clamp that turns by so much about z and y, rad/(N m).

    A clamp keeps the section's shape, too, which makes the box beside it a little stiffer than the beam.
    """
    normals = np.zeros((2, len(ring)))
    for i, pad in enumerate(ring):
        component, sign = FACES[pad.on]
        normals[component - 1, i] = sign
    turned = np.einsum("d,di,dj->ij", np.asarray(turns), normals, normals)
    return np.asarray(turned * arms[:, None, None] ** 2)


def _shell(plates: Plates, length: float) -> Shell:
    profile = plates.profile
    boom = BoxBoom(length=length, size=plates.size, size_along=plates.along, **profile.model_dump())
    with TemporaryDirectory() as folder:
        write_shell(boom, Path(folder, "walls.msh"))
        mesh = read_mesh(Path(folder, "walls.msh"), ("triangle",))
    plate = Plate(material=plates.material, thickness=profile.wall)
    return Shell(ShellBody(plate=plate, shear_correction=plates.shear_correction), mesh)
