r"""Local stress in the walls of a box under pads, on shells of a piece of the box whose cells follow from the pads.

Its inertia holds the piece against the pads' forces.  The local stress :math:`\sigma_k` of pad k is the stress of the
shell under 1 N that pulls outwards at the pad, less the stress of a beam of the same piece under the same force.

Largest von Mises stresses at the nodes of the walls are computed on two meshes with cells of the sizes :math:`h_1` and
:math:`h_2 < h_1`.  They converge with the square of the size, so that the limit and its error bar are

.. math::
    \sigma_v = \sigma_2 + (\sigma_2 - \sigma_1) / (h_1^2 / h_2^2 - 1), \qquad
    e = |\sigma_v - \sigma_2| + m\, \sigma_v

with the margin m, `MARGIN` or `EDGE_MARGIN`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from pmr.errors import InputError, environment
from pmr.files import npz
from pmr.files.arrays import Array
from pmr.fullmodel.pads import Pad
from pmr.fullmodel.wall_compliance import HeldModel, PlateBody, beam_of, shell_of
from pmr.models.named_mesh import NamedMesh
from pmr.models.profile_section import section_of
from pmr.models.sections_along import axial_stress_factors, torsion_stress_factors
from pmr.models.shell import draw_box
from pmr.results.field_stress import FORCES, PLANE, von_mises
from pmr.scene.joints import BoomSection

#: Length of the piece of a section that is looked at, less that of the pads, over the larger of width and height.
PIECE = 3.0
#: Cells along and across a pad, which are taken times the fineness of each mesh, the coarser one first.
ALONG, ACROSS = 4, 2
FINENESS = (1.5, 2.5)
#: Order with which the largest stress converges as cells get smaller.
ORDER = 2
#: Shares of the stress that its error bar has on top, within a wall and at an edge where two walls meet: for where pads
#: lie among the cells, and for what turns the corners of the section beyond the piece.
MARGIN, EDGE_MARGIN = 0.01, 0.08
#: Points are stored at which the stress of a pad alone is at least this share of its largest one.
STORED = 0.3
#: Exponent by which the weight of a cell in a fit falls with the square of its distance, over the largest distance.
FOCUS = 2.0


class Estimate(NamedTuple):
    """Value that is extrapolated from two meshes, and its error bar, both in the same unit."""

    value: float
    error: float

    @classmethod
    def from_meshes(cls, coarse: float, fine: float, margin: float) -> Estimate:
        """Extrapolate from the values on a `coarse` and a `fine` mesh; the error bar is the last change and a `margin`.

        The margin is a share of the value.
        """
        change = (fine - coarse) / ((FINENESS[1] / FINENESS[0]) ** ORDER - 1.0)
        return cls(fine + change, abs(change) + margin * abs(fine + change))


@dataclass(frozen=True)
class RingStress:
    """Local stresses of k pads, each with 1 N outwards alone, at P points on both faces of the walls around them."""

    points: Array  # (P, 3) m: x from the middle of the pads, y and z
    thickness: Array  # (P,) m
    unit: Array  # (k, P, 3) Pa/N: along, across and shear
    on_edge: Array  # (P,): 1 where two walls meet, else 0

    def margin(self, point: int) -> float:
        """Share of the stress that an error bar has on top if the stress is the largest one at this point."""
        return EDGE_MARGIN if self.on_edge[point] else MARGIN


def estimates_of_pads(coarse: RingStress, fine: RingStress) -> list[Estimate]:
    """Largest von Mises stress in Pa/N of each pad alone, from the stresses on two meshes."""
    on_coarse, on_fine = (von_mises(stress.unit, PLANE) for stress in (coarse, fine))
    at = on_fine.argmax(axis=1).tolist()
    return [
        Estimate.from_meshes(float(first.max()), float(second[point]), fine.margin(point))
        for first, second, point in zip(on_coarse, on_fine, at, strict=True)
    ]


class SectionPiece:
    """A piece of a section around pads of one size, as a shell on two meshes."""

    def __init__(self, part: BoomSection, length: float, width: float) -> None:
        """Choose the meshes for pads of this `length` and `width` in m.

        Raises an `InputError` if the walls change along the section, or the cells would be too many.
        """
        box = part.body.box
        if box is None or not part.has_even_walls:
            raise InputError("scene", "body.box", None, "walls that stay the same along the section are allowed")
        self._code = environment.computing_digest()
        self.section, self.length = box, min(box.length, length + PIECE * max(box.width, box.height))
        piece = box.model_copy(update={"length": self.length})
        self.bodies = [
            PlateBody(
                draw_box(piece, width / (fineness * ACROSS), length / (fineness * ALONG)),
                piece,
                part.body.material,
                part.body.shear_correction,
            )
            for fineness in FINENESS
        ]

    @cached_property
    def beam(self) -> PieceBeam:
        """Beam of the piece, which both meshes are compared with."""
        return PieceBeam(self.bodies[0])

    @cached_property
    def meshes(self) -> list[PieceMesh]:
        """Models of the piece on the coarser and the finer mesh."""
        return [PieceMesh(body, self.beam) for body in self.bodies]

    def place(self, x: Array) -> Array:
        """Return the places (...) in m on the piece that stand for places x (...) in m on the section."""
        middle, ahead = self.length / 2.0, self.section.length - x
        return np.where(x < middle, x, np.where(ahead < middle, self.length - ahead, middle)).round(9)

    def stresses(self, pads: Sequence[Pad], place: float) -> list[RingStress]:
        """Return the local stresses of pads at a place in m on the piece, on the coarser and the finer mesh.

        The stresses are stored in the user's cache folder.  Raises an `InputError` if a pad leaves its face.
        """
        ring = [
            Pad("pad", pad.on, place, pad.across, length=pad.length, width=pad.width, stiffness=1.0) for pad in pads
        ]

        def compute(number: int) -> dict[str, Array]:
            return npz.record_arrays(self.meshes[number].stress(ring), "")

        result = []
        for number, body in enumerate(self.bodies):
            request = repr((body, ring, self._code))
            arrays = npz.stored_or_computed("wall-stress", request, partial(compute, number))
            result.append(npz.record_from_arrays(RingStress, arrays, ""))
        return result

    def factors(self, stress: RingStress) -> Array:
        """Return the stresses (P, 3, 6) in Pa at the points of `stress` per unit of each section force.

        Section forces are in the order of `FORCES`.  Stresses are along, across and shear as in `RingStress`.
        """
        box, factors = self.section, np.zeros((len(stress.points), 3, len(FORCES)))
        section = section_of(box, self.bodies[0].material.poisson)
        factors[:, 0] = axial_stress_factors(section, stress.points[:, 1:])
        factors[:, 2] = -torsion_stress_factors(box, stress.thickness)  # along x and clockwise
        return factors

    def destroy(self) -> None:
        """Free the memory of the models."""
        if "meshes" in self.__dict__:
            self.beam.destroy()
            for mesh in self.meshes:
                mesh.destroy()


class PieceBeam:
    """Beam of a piece of a section, and its section forces under pads."""

    def __init__(self, body: PlateBody) -> None:
        line = beam_of(body)
        self._held, self._rows = HeldModel(line, body), line.section_forces()

    def section_forces(self, pads: Sequence[Pad], x: Array) -> Array:
        """Section forces (k, 6, P) under 1 N of each of k pads at the places x (P,) in m."""
        forces, names = self._rows.rows @ self._held.under_pads(pads), np.array(self._rows.names)
        result = np.zeros((len(pads), len(FORCES), len(x)))
        for number, name in enumerate(FORCES):
            if np.any(of := names == name):
                at, values = mean_by_place(self._rows.x[of], forces[of].T)
                result[:, number] = [np.interp(x, at, value) for value in values]
        return result

    def destroy(self) -> None:
        """Free the memory of the model."""
        self._held.destroy()


class PieceMesh:
    """Shell of a piece of a section, its beam, and the shell's stresses at the nodes of its walls."""

    def __init__(self, body: PlateBody, beam: PieceBeam) -> None:
        shell = shell_of(body)
        self._body, self._beam, self._held = body, beam, HeldModel(shell, body)
        self._rows, self._thickness = shell.stresses(), shell.thickness
        self._fits, self._on_edge = node_fits(shell.mesh)

    def stress(self, pads: Sequence[Pad]) -> RingStress:
        """Return the local stresses of pads, at points near the pads.

        At each point, the stress of a pad is at least the share `STORED` of the pad's largest stress.
        """
        rows, fits = self._rows, self._fits
        stress = rows.evaluate(self._held.under_pads(pads).T)
        faces = [rows.points_on(face) for face in (rows.faces[0], rows.faces[-1])]
        points = np.concatenate([fits @ rows.points[on] for on in faces])
        unit = np.array([np.concatenate([fits @ of_pad[on] for on in faces]) for of_pad in stress])
        thickness = np.tile(fits @ self._thickness, 2)
        section = section_of(self._body.profile, self._body.material.poisson)
        forces = self._beam.section_forces(pads, points[:, 0])
        unit[..., 0] -= np.einsum("pc,kcp->kp", axial_stress_factors(section, points[:, 1:]), forces)
        unit[..., 2] += np.einsum("pc,kcp->kp", torsion_stress_factors(self._body.profile, thickness), forces)
        size = von_mises(unit, PLANE)
        near = np.any(size >= STORED * size.max(axis=1)[:, None], axis=0)
        points[:, 0] -= pads[0].at
        return RingStress(points[near], thickness[near], unit[:, near], np.tile(self._on_edge, 2)[near])

    def destroy(self) -> None:
        """Free the memory of the model."""
        self._held.destroy()


def mean_by_place(x: Array, values: Array) -> tuple[Array, Array]:
    """Return the different places of x (P,), ascending (p,), and the means (S, p) of values (S, P) at each of them."""
    places, inverse, counts = np.unique(x.round(9), return_inverse=True, return_counts=True)
    means = sp.csr_matrix((1.0 / counts[inverse], (np.arange(len(x)), inverse)))
    return places, np.asarray(values @ means)


class NodeFits(NamedTuple):
    """Matrix from values of C cells to values at the p nodes of all walls, and the nodes at edges of two walls."""

    matrix: sp.csr_matrix  # (p, C)
    on_edge: Array  # (p,): 1 at these nodes, else 0


def node_fits(mesh: NamedMesh) -> NodeFits:
    """Return the values at the nodes of each wall, at its edges too, that fit values of cells.

    At each node the value is that of a quadratic polynomial in the two directions of the wall.  The polynomial fits the
    values in the middles of the cells that touch the node, and of all cells that share a node with them; cells that are
    farther away have less weight.
    """
    middles = mesh.points[mesh.cells].mean(axis=1)
    fits, walls = list[sp.csr_matrix](), np.zeros(len(mesh.points))
    for of_wall in mesh.regions.values():
        walls[np.unique(mesh.cells[of_wall])] += 1.0
    on_edge = list[Array]()
    for of_wall in mesh.regions.values():
        nodes, corners = np.unique(mesh.cells[of_wall], return_inverse=True)
        numbers = np.arange(len(of_wall)).repeat(mesh.cells.shape[1])
        touching = sp.csr_matrix((np.ones(len(numbers)), (numbers, corners.ravel())))
        around = (touching.T @ touching @ touching.T).tocsr()
        points, counts = mesh.points[nodes], np.diff(around.indptr)
        across = np.linalg.svd(points[:, 1:] - points[:, 1:].mean(axis=0), full_matrices=False)[2][0]
        directions = np.array([[1.0, 0.0, 0.0], [0.0, *across]]).T
        weights = np.zeros(around.nnz)
        for count in np.unique(counts):
            rows = np.flatnonzero(counts == count)
            entries = around.indptr[rows][:, None] + np.arange(count)
            apart = (middles[of_wall[around.indices[entries]]] - points[rows, None]) @ directions
            x, y = np.moveaxis(apart / np.abs(apart).max(axis=1, keepdims=True), -1, 0)
            terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
            weighted = np.exp(-FOCUS * (x * x + y * y))[..., None] * terms
            inverse = np.linalg.pinv(np.swapaxes(terms, 1, 2) @ weighted, hermitian=True)
            weights[entries] = np.einsum("pct,pt->pc", weighted, inverse[:, 0])
        on_edge.append((walls[nodes] > 1.0).astype(float))
        fits.append(sp.csr_matrix((weights, of_wall[around.indices], around.indptr), (len(nodes), len(mesh.cells))))
    return NodeFits(sp.vstack(fits, "csr"), np.concatenate(on_edge))
