r"""Section forces along a beam, exact at its nodes and between them, for everything that acts on the beam.

A beam is cut at its nodes and between them.  A piece p, with the coordinates q, the acceleration a and matrices K_p and
M_p, is in equilibrium under the loads g_p on its coordinates, its inertia and the forces f at its ends,

.. math:: f = K_p\, (q + \delta) + M_p\, a - g_p, \qquad g = B f - C(s)^T \lambda - \sum k\, c^T c\, q

(in the second equation f are the inputs, c and k the rows and stiffnesses of springs).  Delta is the displacement of
the cuts between nodes in addition to the interpolation of nodal coordinates: with it, the pieces on both sides of each
such cut have equal forces.  At nodes, forces are equal because the whole beam is in equilibrium there.  The loads of
the pieces are those of the whole beam, with the same pads, friction moments, loads and weights, on a mesh in which each
node is doubled.  Loads on a node act between pieces.  The acceleration a follows from the equilibrium of the whole
beam,

.. math:: M a = g - K q - C_0^T \lambda_0, \qquad C_0\, a = 0

with the rows C_0 and the forces :math:`\lambda_0` of rigid supports.  So the forces of damping and of everything else
in a scene are included, as if they were distributed like the mass.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from pmr.fem.compat import MPI
from pmr.fem.distributed import local_csr
from pmr.files.arrays import Array
from pmr.fullmodel.actions import Action
from pmr.fullmodel.build import AssembledBody
from pmr.fullmodel.model import FullModel, operators_of
from pmr.fullmodel.moving import FrameAssembler
from pmr.fullmodel.pads import restrain
from pmr.fullmodel.structure import Structure, couple
from pmr.fullmodel.walls import Walls
from pmr.models import Cut
from pmr.results.field_stress import ForceRows
from pmr.system.rows import Row
from pmr.system.states import BodyStates

#: Number of pieces in each element of length h: the moment at a point force P is exact to P h / (4 PIECES).
PIECES = 4
#: Distance from a node, over the beam's length, up to which a point is on the node.
ON_NODE = 1e-9


class SectionForces:
    """Section forces of a full model whose structure is a beam, cut into pieces; the same on every rank, collective.

    Attributes
    ----------
    names : (P,) tuple of str
        Name of each section force.
    x : (P,) array, m
        Position of each section force; the positions are both ends of each piece.
    stresses : StressRows or None
        Stresses in the corners of the profile under these forces.
    """

    def __init__(self, built: AssembledBody, cut: Cut) -> None:
        """Prepare the whole beam, its pieces between the places of `cut`, and stresses by its section forces.

        `built` is the full model and `cut` its beam, cut into pieces.  The mass matrix of the whole beam is factorised.
        If the beam is cut between nodes, the stiffness of the pieces against opening of these cuts is factorised, too.
        Collective.
        """
        self._whole = _WholeBeam(built.model)
        self._pieces = _BeamPieces(built.structure, cut)
        strained = cut.beam.section_forces()
        self.names, self.x = strained.names, strained.x
        unit_forces = ForceRows(sp.eye(len(self.x), format="csr"), self.names, self.x)
        self.stresses = cut.beam.corner_stresses(unit_forces, cut.element)
        self._strained, self._ends = strained.rows, cut.beam.end_forces()
        self._cut_displacements, self._between = cut.joined, None
        if cut.joined.shape[1]:
            stiffness = local_csr(operators_of(cut.beam, MPI.COMM_SELF).K)
            self._between = spla.splu(sp.csc_matrix(cut.joined.T @ stiffness @ cut.joined))

    def evaluate(self, q: Array, acting: BodyStates | None = None) -> Array:
        """Section forces (S, P) in N and N m at S times; collective.

        q (S, n) are the full coordinates; every rank passes all of them and gets the whole result.  `acting` are the
        loads and contact forces at these times; None if nothing acts.
        """
        a, supports = self._whole.motion(q, acting)
        displaced = self._pieces.displacement(q)
        on_pieces = self._pieces.loads(displaced, a, supports, acting)
        if self._between is not None:
            displaced = (
                displaced + (self._cut_displacements @ self._between.solve(self._cut_displacements.T @ on_pieces.T)).T
            )
        return np.asarray(displaced @ self._strained.T - on_pieces @ self._ends.T) - self._friction_forces(acting)

    def _friction_forces(self, acting: BodyStates | None) -> Array | float:
        """Normal forces (S, P) in N that the friction of pads causes at the P places of section forces.

        The equations of motion let the friction of a pad act at the tail of the beam instead of at the pad.  Therefore
        the friction changes the normal force only at places between the tail and the pad.  The result is 0 if `acting`
        is None or has no friction.
        """
        if acting is None or acting.friction_forces is None:
            return 0.0
        before = self.x < acting.s[:, :, None] - ON_NODE * self.x.max()  # (S, m, P)
        return np.einsum("sm,smp->sp", acting.friction_forces, before & (np.array(self.names) == "normal force"))


class _BeamMotion(NamedTuple):
    """Acceleration (S, n) in m/s^2 and rad/s^2 of a beam, and forces (S,) in N or N m of its rigid supports by name."""

    acceleration: Array
    supports: dict[str, Array]


class _WholeBeam:
    """The whole beam, for its acceleration and the forces of its rigid supports under any loads."""

    def __init__(self, model: FullModel) -> None:
        """Gather the matrices and rows of the full `model` on every rank; collective."""
        M, self._K, self._B = (
            sp.vstack(model.comm.allgather(local_csr(A)), "csr") for A in (model.M, model.K, model.B)
        )
        self._rows, fixed = model.rows.rows, [row for row in model.rows.rows if row.is_fixed]
        held = [_zero_rows(model.size, 0), *(row.at(row.breaks[0]) for row in fixed)]
        self._names, self._held = [row.name for row in fixed], sp.vstack(held, "csr")
        self._mass = spla.splu(sp.csc_matrix(M))
        self._support_responses = self._mass.solve(self._held.T.toarray())
        self._support_stiffness = np.linalg.pinv(self._held @ self._support_responses, hermitian=True)

    def motion(self, q: Array, acting: BodyStates | None) -> _BeamMotion:
        """Acceleration of the beam at S times, and the forces of its rigid supports.

        q (S, n) are the coordinates, `acting` the loads and contact forces; None if nothing acts.
        """
        free = self._mass.solve((_state_loads(self._B, self._rows, acting, len(q)) - q @ self._K).T)
        supports = self._support_stiffness @ (self._held @ free)
        by_name = dict(zip(self._names, supports, strict=True))
        return _BeamMotion((free - self._support_responses @ supports).T, by_name)


class _BeamPieces:
    """Pieces into which a beam is cut, and the loads on each piece."""

    def __init__(self, structure: Structure, cut: Cut) -> None:
        """Assemble masses, loads and springs of a beam's `structure` on its pieces, between the places of `cut`."""
        beam, nodes = cut.beam, structure.model.node_stations
        assert nodes is not None

        def between_nodes(place: str | float) -> bool:
            """Whether a place, by name or in m from the tail, is on no node of the whole beam."""
            return bool(np.abs(nodes - beam.station(place)).min() > ON_NODE * nodes[-1])

        pads, masses = structure.pads, tuple(attached for attached in structure.masses if between_nodes(attached.on))
        supports, ends = (
            tuple(attached for attached in every if between_nodes(attached.on)) for every in (pads.supports, pads.ends)
        )
        pads = replace(pads, supports=supports, ends=ends, walls=Walls())
        masses = tuple(attached.model_copy(update={"coupling": "average"}) for attached in masses)
        apart = replace(structure, model=beam, clamps=(), masses=masses, pads=pads, outputs=(), ports=(), matrices=())
        coupling, base = couple(apart), operators_of(beam, MPI.COMM_SELF)
        restraints, moving = restrain(pads, beam, coupling.T), FrameAssembler(beam, masses, MPI.COMM_SELF)
        loads = [_zero_rows(beam.size, 0)]
        for load in structure.loads:
            on_node = isinstance(load, Action) and not between_nodes(load.on)
            loads.append(_zero_rows(beam.size) if on_node else coupling.load(load, base.M, moving))
        self._B, self._rows = sp.vstack(loads, "csr").T, restraints.rows
        self._M, self._springs = local_csr(base.M) + coupling.attached_mass(), restraints.stiffness(beam.size)
        self._held = {row.name: row.at(row.breaks[0]) for row in restraints.rows if row.is_fixed}
        self._displacement = sp.csr_matrix(cut.coordinates @ couple(structure).T)

    def displacement(self, q: Array) -> Array:
        """Displacements (S, c) of the pieces' c coordinates, interpolated from the beam's coordinates q (S, n)."""
        return (self._displacement @ q.T).T

    def loads(self, displaced: Array, a: Array, supports: dict[str, Array], acting: BodyStates | None) -> Array:
        """Loads (S, c), inertia included, on the c coordinates of the pieces with the displacements `displaced` (S, c).

        The accelerations a of the beam are (S, n).  `supports` has the forces (S,) of rigid supports by name; supports
        at nodes are ignored, because their forces act between pieces.  If `acting` is None, there are no loads and no
        contact forces.
        """
        forces = _state_loads(self._B, self._rows, acting, len(a))
        forces = forces - displaced @ self._springs - self.displacement(a) @ self._M
        for name, force in supports.items():
            if name in self._held:
                forces -= force[:, None] * self._held[name].toarray()
        return forces


def _state_loads(B: sp.csr_matrix, rows: Iterable[Row], acting: BodyStates | None, count: int) -> Array:
    """Loads B f - C(s)^T lambda (S, n) on a beam in S = `count` states, with moments of friction.

    B (n, i) has the inputs; `acting` has the loads and contact forces of the states; the result is zero if it is None.
    Multipliers of rows that are not among `rows` are left out.
    """
    if acting is None:
        return np.zeros((count, B.shape[0]))
    rows_by_name, pressed = {row.name: row for row in rows}, _zero_rows(B.shape[0], count)
    turned = np.zeros_like(acting.multipliers) if acting.friction_moments is None else acting.friction_moments
    for name, force, moment, at in zip(acting.rows, acting.multipliers.T, turned.T, acting.s.T, strict=True):
        if name in rows_by_name:
            pressed = pressed + rows_by_name[name].forces_on_coordinates(at, force)
            if np.any(moment):
                pressed = pressed - rows_by_name[name].forces_on_coordinates(at, moment, 1)
    return np.asarray((B @ acting.loads.T).T - pressed.toarray())


def _zero_rows(size: int, count: int = 1) -> sp.csr_matrix:
    """Sparse zeros (`count`, `size`)."""
    return sp.csr_matrix((count, size))
