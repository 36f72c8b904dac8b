r"""Compliance of the walls of a box that is modelled as a beam, under its pads and at its ends: solves on a shell.

The shell is held by the clamps and rigid masses that keep the shape of the body's ends.  Where these leave the shell
free to move, its inertia holds it: the loads are the forces less the mass times the mean acceleration that they cause.
The walls' own compliance is the difference between the shell and a beam of the same profile, length and support, both
with the mean displacement :math:`u_i` under pad i and the force :math:`f_j` of pad j:

.. math:: C_{ij} = \frac{\partial u_i}{\partial f_j}\Big|_{shell} - \frac{\partial u_i}{\partial f_j}\Big|_{beam}

It is computed for pads of one ring and of several, and for the mean motion of a free end.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from pmr.errors import call_on_first_rank, environment
from pmr.fem.compat import MPI, PETSc
from pmr.fem.distributed import free_objects, gather
from pmr.fem.factor import BLOCK, factor_for_columns
from pmr.files import npz
from pmr.files.arrays import Array
from pmr.fullmodel.pads import Pad, under_even_pad, under_pad
from pmr.fullmodel.structure import Clamp, Structure, couple, structural_model
from pmr.fullmodel.walls import Sliding, Standing, Walls
from pmr.models import DIRECTIONS, StructuralModel
from pmr.models.beam3d import Beam3D, box_beam
from pmr.models.box_mesh import BoxBoom, write_shell
from pmr.models.named_mesh import read_mesh
from pmr.models.shell import Shell, boom_of_box, of
from pmr.scene import Body
from pmr.scene.box import Box
from pmr.scene.choice import motion_directions
from pmr.scene.joints import BoomSection
from pmr.scene.members import Member
from pmr.scene.structures import Beam3DBody, Material, PointMass

#: Elements of the beam whose compliance is subtracted.
ELEMENTS = 40
#: Positions of pads that slide: number per layer of cells, and largest number in all.
A_LAYER, MOST_PLACES = 2, 61
#: Root of the shift that makes a free body's stiffness regular, over the scale of its lowest frequency.
HELD = 0.05


@dataclass(frozen=True)
class PlateBody:
    """A box meshed as a shell, and the clamps and rigid masses that keep the shape of its ends."""

    box: BoxBoom
    profile: Box  # from which `box` was made
    material: Material
    shear_correction: float  # factor kappa on the shear stiffness of the shell
    clamps: tuple[Clamp, ...] = ()
    masses: tuple[PointMass, ...] = ()


@dataclass(frozen=True)
class Ring:
    """Pads that slide together, by the distance `span` in m; 0 if they do not move.

    The `at` of each pad is its position in m before it slides.
    """

    pads: tuple[Pad, ...]
    span: float = 0.0


@dataclass(frozen=True)
class SlidingCompliance:
    """Compliance of k sliding pads at p distances u, under forces on these pads and on m fixed pads and ends."""

    u: Array  # (p,) m: distances from the first position
    sliding: Array  # (p, k, k) m/N: of the sliding pads under their own forces
    standing: Array  # (p, k, m) m/N: between sliding pads and fixed pads and ends


class WallCompliance(NamedTuple):
    """The walls' compliance under m fixed pads and ends, and the compliance under each ring of sliding pads."""

    standing: Array  # (m, m) m/N, of ends that turn rad/N and rad/(N m)
    sliding: list[SlidingCompliance]


def wall_compliance(
    body: PlateBody, standing: tuple[Pad, ...], ends: tuple[tuple[str, str], ...], rings: tuple[Ring, ...]
) -> WallCompliance:
    """Compute the walls' compliance (m, m) for m fixed pads and ends, and for rings of sliding pads; not collective.

    `standing` are the fixed pads, and `ends` are pairs such as ``("tip", "y")``.  The results are stored in a file in
    the user's cache folder.  Equal bodies and later runs read them from there.

    Raises an `InputError` if a pad leaves its face.
    """
    request = repr((body, standing, ends, rings, environment.computing_digest()))
    stored = npz.stored_or_computed("walls", request, lambda: _compliance_arrays(body, standing, ends, rings))
    sliding = [npz.record_from_arrays(SlidingCompliance, stored, f"{i}.") for i in range(len(rings))]
    return WallCompliance(stored["standing"], sliding)


def _compliance_arrays(
    body: PlateBody, standing: tuple[Pad, ...], ends: tuple[tuple[str, str], ...], rings: tuple[Ring, ...]
) -> dict[str, Array]:
    """Compute the compliance of a body's walls under the fixed pads `standing`, at `ends` and under sliding `rings`.

    It is the compliance of the body's shell minus the compliance of its beam.  `ends` are pairs such as
    ``("tip", "y")``: a group at an end, and the direction of its mean motion.  The result has the array ``standing``
    and the fields of `SlidingCompliance` for each ring.  Their keys begin with the ring's number, such as ``0.u``.
    """
    box, line = body.box, beam_of(body)
    shell, beam = HeldModel(shell_of(body), body), HeldModel(line, body)
    fixed_shell, fixed_beam = (
        sp.vstack([model.pads(standing, np.zeros(1)), model.motions(ends)], "csr") for model in (shell, beam)
    )
    C = shell.compliance(fixed_shell, fixed_shell) - beam.compliance(fixed_beam, fixed_beam)
    arrays = {"standing": (C + C.T) / 2.0}
    for i, ring in enumerate(rings):
        u, k = places_along(ring.span, box.layer), len(ring.pads)
        D = shell.compliance_along(ring.pads, u, fixed_shell) - beam.compliance_along(ring.pads, u, fixed_beam)
        under_pads = (D[:, :k] + D[:, :k].transpose(0, 2, 1)) / 2.0
        sliding = SlidingCompliance(u, _smooth(under_pads), _smooth(D[:, k:].transpose(0, 2, 1)))
        arrays |= npz.record_arrays(sliding, f"{i}.")
    for model in (shell, beam):
        model.destroy()
    return arrays


class HeldModel:
    """A model of a body and its static displacements under unit forces.

    The model is held by the clamps and rigid masses that keep the shape of the body's ends.  If these leave rigid
    motions free, inertia forces of the body balance the load.  The mass times a small shift is then added to the
    stiffness, so that it has a factor.
    """

    def __init__(self, model: StructuralModel, body: PlateBody) -> None:
        """Assemble the structural `model` of the `body`, hold it and factorise its stiffness; on this rank alone."""
        structure = Structure(model, clamps=body.clamps, masses=body.masses)
        self._model, self._T = model, couple(structure).T
        full = structural_model(structure, MPI.COMM_SELF)
        M, rigid = gather(full.M), full.rigid
        assert M is not None and rigid is not None  # as structures have, on the only rank
        self._R = rigid.coordinates @ scipy.linalg.null_space(rigid.held_measures.T @ rigid.held_measures)
        self._MR = M @ self._R
        self._J = self._R.T @ self._MR
        if self._R.size:
            sigma = (HELD * beam_of(body).reference_frequency) ** 2
            full.K.axpy(sigma, full.M, structure=PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        del M
        free_objects(full.M, full.B, full.outputs)  # before the factor, which takes most of the memory
        self._factor = factor_for_columns(full.K, "stiffness")
        free_objects(full.K)

    def pads(self, pads: Sequence[Pad], u: Array) -> sp.csr_matrix:
        """Rows (p k, n) of the mean normal displacement under k pads that have slid by p distances `u` (p,) in m.

        The rows act on the n coordinates of the held model; the k rows of one distance follow each other.  Raises an
        `InputError` if a pad leaves its face.
        """
        means = [sp.csr_matrix((0, self._T.shape[1]))]
        means += [under_pad(pad, self._model, pad.at + u) @ self._T for pad in pads]
        order = np.arange(len(pads) * len(u)).reshape(len(pads), len(u)).T.ravel()
        return sp.vstack(means, "csr")[order]

    def motions(self, ends: Sequence[tuple[str, str]]) -> sp.csr_matrix:
        """Rows (m, n) that measure the mean motion of m ends in m or rad, each a pair such as ``("tip", "y")``.

        A pair is the name of a group and the direction along or about which it moves.
        """
        rows = [self._model.motion(end)[[DIRECTIONS.index(d)]] @ self._T for end, d in ends]
        return sp.csr_matrix(sp.vstack([sp.csr_matrix((0, self._T.shape[1])), *rows]))

    def _displacements(self, loaded_rows: sp.csr_matrix) -> Array:
        """Displacements (n, f) of the held model under a unit force on each of the f rows `loaded_rows` (f, n) alone.

        If the model has free rigid motions, a unit force accelerates it along them.  The inertia forces of this
        acceleration then act beside the unit force, and the displacements have no part along these motions.
        """
        f = loaded_rows.T.toarray()
        x = self._factor.solve_columns(np.asfortranarray(f - self._MR @ self._solve_rigid(self._R.T @ f)))
        x -= self._R @ self._solve_rigid(self._MR.T @ x)
        return x

    def under_pads(self, pads: Sequence[Pad]) -> Array:
        """Displacements (c, 2 k) of the model's own c coordinates under 1 N outwards on each of k pads alone.

        In the first k columns the pressure is largest in the middle of the pad (`pmr.fullmodel.pads.under_pad`).  In
        the last k columns it is even (`under_even_pad`).  Raises an `InputError` if a pad leaves its face.
        """
        even = sp.vstack([under_even_pad(pad, self._model) for pad in pads]) @ self._T
        return np.asarray(self._T @ self._displacements(sp.vstack([self.pads(pads, np.zeros(1)), even], "csr")))

    def compliance(self, loaded_rows: sp.csr_matrix, rows: sp.csr_matrix) -> Array:
        """Compliance (m, f): what `rows` (m, n) measure, in m or rad, under 1 N or 1 N m on each of f `loaded_rows`.

        `loaded_rows` are (f, n).
        """
        result = np.empty((rows.shape[0], loaded_rows.shape[0]))
        for start in range(0, loaded_rows.shape[0], BLOCK):
            block = slice(start, start + BLOCK)
            result[:, block] = rows @ self._displacements(loaded_rows[block])
        return result

    def compliance_along(self, pads: Sequence[Pad], u: Array, fixed_rows: sp.csr_matrix) -> Array:
        """Compliance (p, k + m, k) under 1 N on each of k pads that have slid by each of p distances `u` (p,) m.

        The second axis has what is measured: first the displacements in m under the k pads, then the values in m or rad
        of the `fixed_rows` (m, n).
        """
        rows, p, k = self.pads(pads, u), np.arange(len(u)), len(pads)
        of_pads, of_fixed = np.split(self.compliance(rows, sp.vstack([rows, fixed_rows], "csr")), [rows.shape[0]])
        at_fixed = of_fixed.reshape(-1, len(u), k).transpose(1, 0, 2)
        return np.concatenate([of_pads.reshape(len(u), k, len(u), k)[p, :, p], at_fixed], axis=1)

    def _solve_rigid(self, g: Array) -> Array:
        """Solve J x = g for the k free rigid motions, which have the inertia J (k, k); return `g` if there are none."""
        return np.linalg.solve(self._J, g) if self._R.size else g

    def destroy(self) -> None:
        """Free the memory of the factor."""
        self._factor.destroy()


def places_along(span: float, layer: float) -> Array:
    """Distances (p,) in m from 0 to `span` at which a sliding ring of pads is evaluated.

    There are `A_LAYER` distances for each `layer` of cells, which is a length in m, but at least two and at most
    `MOST_PLACES`.  Round-off in `span` does not add a distance.
    """
    return np.linspace(0.0, span, min(MOST_PLACES, max(2, int(np.ceil(A_LAYER * span / layer - 1e-9)) + 1)))


def _smooth(values: Array) -> Array:
    """Moving means of `values` (p, ...), at p distances, over a layer of cells.

    The means are needed because on a coarse mesh a pad dents the wall deeper between two nodes than on a node.
    """
    between = (values[:-1] + values[1:]) / 2.0
    return np.concatenate([between[:1], (between[:-1] + between[1:]) / 2.0, between[-1:]])


def beam_of(body: PlateBody) -> Beam3D:
    """Beam of a box in `ELEMENTS` elements; its compliance and stress are subtracted from those of the box's shell."""
    line = Beam3DBody(
        length=body.box.length, profile=body.profile, material=body.material, shear=True, elements=ELEMENTS
    )
    return box_beam(line, body.profile)


def shell_of(body: PlateBody) -> Shell:
    """Shell of a box, which gmsh meshes with the sizes of cells in `body.box`."""
    with TemporaryDirectory() as folder:
        write_shell(body.box, Path(folder, "walls.msh"))
        mesh = read_mesh(Path(folder, "walls.msh"), ("triangle",))
    return of(Body(box=body.profile, material=body.material, shear_correction=body.shear_correction), mesh)


ENDS = ("tail", "tip")
#: Directions along or about which a free end's walls give way.
AT_AN_END = ("y", "z", "rx")


def walls_of(member: Member, pads: Sequence[Pad], comm: MPI.Comm) -> Walls:
    """Walls of a box modelled as a beam: under the pads of the beam and at its ends; collective.

    Their compliance is computed on a shell with the cells of a shell model of the same body.  An end is left out if
    nothing acts on it, if a clamp or rigid mass keeps its shape, or if the shell is not softer there than the beam.

    Raises an `InputError` if a pad leaves its face, or the box can't be drawn with these cells.
    """
    part = member.part
    box, mesh, body = part.body.box, part.mesh, part.body
    assert box is not None  # the scene's check
    staying, rings = _split_by_sliding(member, pads)
    masses = tuple(mass for mass in part.masses if mass.coupling == "rigid")
    plates = PlateBody(
        boom_of_box(box, mesh.size, mesh.along or 0.0),
        box,
        body.material,
        body.shear_correction,
        tuple(Clamp(str(support.on), support.held_directions) for support in part.supports if support.points == "all"),
        masses,
    )
    moves = motion_directions(member)
    ends = tuple((end, d) for end in ENDS if end in _loaded_ends(part) for d in AT_AN_END if d in moves)
    compliance: WallCompliance = comm.bcast(
        call_on_first_rank(comm, lambda: wall_compliance(plates, staying, ends, rings))
    )
    C = compliance.standing
    rho = body.material.density
    soft = np.diagonal(C) > 0.0  # an end that is stiffer than the beam's end is left as stiff as it
    soft_ends = [end for end, gives in zip(ends, soft[len(staying) :], strict=True) if gives]
    weights = [rho * _wall_volume(pad, box) for pad in staying] + [
        rho * _end_volume(box, direction) for _, direction in soft_ends
    ]
    return Walls(
        Standing(tuple(pad.name for pad in staying), tuple(soft_ends), C[np.ix_(soft, soft)], np.array(weights)),
        tuple(
            Sliding(
                pads=tuple(pad.name for pad in ring.pads),
                first=np.array([pad.at for pad in ring.pads]),
                u=of_ring.u,
                compliance=of_ring.sliding,
                standing_compliance=of_ring.standing[:, :, soft],
                masses=np.array([rho * _wall_volume(pad, box) for pad in ring.pads]),
            )
            for ring, of_ring in zip(rings, compliance.sliding, strict=True)
        ),
    )


class _PadGroups(NamedTuple):
    """Pads at rest, and groups of pads that slide together."""

    staying: tuple[Pad, ...]
    rings: tuple[Ring, ...]


def _split_by_sliding(member: Member, pads: Sequence[Pad]) -> _PadGroups:
    """Split the pads of a body into pads that stay and groups of pads that slide together.

    Pads of one joint, or of the ground, slide together.  Pads that move, but by no distance, stay.  `at` of each
    returned pad is its first position along the body in m.
    """
    staying, sliding = list[Pad](), dict[int, Ring]()
    rings = {name: ring for ring in member.pads for name, _, _ in ring.named_pads}
    for pad in pads:
        ring = rings[pad.name]
        of_joint = member.dented_rings.get(ring.name)
        if not ring.moving:
            staying.append(pad)
            continue
        joint, (first, last) = (0, member.travel) if of_joint is None else (of_joint.joint, of_joint.positions)
        at = replace(pad, at=first + pad.at)
        if last > first:
            together = sliding.get(joint, Ring((), last - first))
            sliding[joint] = replace(together, pads=(*together.pads, at))
        else:
            staying.append(at)
    return _PadGroups(tuple(staying), tuple(sliding.values()))


def _wall_volume(pad: Pad, box: Box) -> float:
    """Volume in m^3 of the wall of a box under a pad."""
    return box.thickness(pad.on) * pad.length * pad.width


def _end_volume(box: Box, direction: str) -> float:
    """Volume in m^3 of the last piece of a box's walls at a free end, whose mass moves with the end.

    The piece is as long as a quarter of the width or the height, whichever is larger.  `direction` is the direction of
    the end's motion.  For the rotation ``rx`` the result is in m^5: the volume times the square of half the box's
    diagonal.
    """
    arm = (box.width**2 + box.height**2) / 4.0 if direction == "rx" else 1.0
    return sum(side.thickness * side.length for side in box.sides) * max(box.width, box.height) / 4.0 * arm


def _loaded_ends(part: BoomSection) -> set[str | float]:
    """Places, such as ``tip`` or a coordinate in m, at which a mass, a load or a support is attached to a body.

    Places that a clamp or rigid mass keeps in shape are left out: their walls can't give way.
    """
    clamped = {support.on for support in part.supports if support.points == "all"}
    held_in_shape = clamped | {mass.on for mass in part.masses if mass.coupling == "rigid"}
    return {attached.on for kind in (part.masses, part.loads, part.supports) for attached in kind} - held_in_shape
