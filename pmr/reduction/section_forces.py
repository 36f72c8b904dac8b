r"""Section forces along a beam, exact for all that acts on it, between its nodes too.

A beam is cut at its nodes and between them.  A piece is in equilibrium under what its loads g are at its own
coordinates, its inertia and what pulls at its ends,

.. math:: f = K_p\, (q + \delta) + M_p\, a - g_p, \qquad g = B f - C(s)^T \lambda - \sum k\, c^T c\, q

The displacement delta of the cuts between nodes beside what nodal coordinates interpolate is the one with which pieces
pull equally on both sides of each; at nodes they do as the whole is in equilibrium there.  Loads of the pieces are
those of the whole: the same pads, moments of friction, loads and weights on a mesh whose nodes stand twice.  What acts
on a node itself acts between pieces.  The acceleration a follows from the equilibrium of the whole beam,

.. math:: M a = g - K q - C_0^T \lambda_0, \qquad C_0\, a = 0

with rigid supports C_0, so that it holds damping and what else a scene has, too, as if it were spread as the mass is.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from pmr.constraints.rows import Row
from pmr.fem.compat import MPI
from pmr.fem.distributed import local_csr
from pmr.fields.stress import ForceRows
from pmr.fullmodel.assembly import operators_of
from pmr.fullmodel.build import Built
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.moving import Moving
from pmr.fullmodel.pads import restrain
from pmr.fullmodel.structure import Action, Structure, couple
from pmr.fullmodel.walls import Walls
from pmr.models import Cut
from pmr.system.states import BodyStates

Array = NDArray[np.float64]

#: Pieces an element: the moment right under a point force is known to P h / (4 PIECES).
PIECES = 4
#: Places that are nearer to a node than this share of the length are on it.
ON_NODE = 1e-9


class SectionForces:
    """Section forces of a full model whose structure is a beam, cut to pieces; the same on every rank, collective.

    Attributes
    ----------
    names : (P,) tuple of str
    x : (P,) array, m
        Which force, and where: at both ends of each piece.
    stresses : StressRows or None
        Stresses in the profile's corners, on these forces.
    """

    def __init__(self, built: Built, cut: Cut) -> None:
        self._whole = _Whole(built.model)
        self._pieces = _Pieces(built.structure, cut)
        strained = cut.beam.section_forces()
        self.names, self.x = strained.names, strained.x
        unit_forces = ForceRows(sp.eye(len(self.x), format="csr"), self.names, self.x)
        self.stresses = cut.beam.corner_stresses(unit_forces, cut.element)
        self._strained, self._ends = strained.rows, cut.beam.end_forces()
        self._joined, self._between = cut.joined, None
        if cut.joined.shape[1]:
            stiffness = local_csr(operators_of(cut.beam, MPI.COMM_SELF).K)
            self._between = spla.splu(sp.csc_matrix(cut.joined.T @ stiffness @ cut.joined))

    def of(self, q: Array, acting: BodyStates | None = None) -> Array:
        """(S, P) in N and N m, of whole states q (S, n) under what acts then; by default nothing does."""
        a, supports = self._whole.acceleration(q, acting)
        on_pieces, displaced = self._pieces.loads(q, a, supports, acting)
        if self._between is not None:
            displaced = displaced + (self._joined @ self._between.solve(self._joined.T @ on_pieces.T)).T
        return np.asarray(displaced @ self._strained.T - on_pieces @ self._ends.T) - self._friction_forces(acting)

    def _friction_forces(self, acting: BodyStates | None) -> Array | float:
        """Normal force of friction, which the equations have at the tail, from there to the pad, (S, P) N."""
        if acting is None or acting.along is None:
            return 0.0
        before = self.x < acting.s[:, :, None] - ON_NODE * self.x.max()  # (S, m, P)
        return np.einsum("sm,smp->sp", acting.along, before & (np.array(self.names) == "normal force"))


class _Whole:
    """The beam as one: its acceleration, and the forces of its rigid supports."""

    def __init__(self, model: FullModel) -> None:
        M, self._K, self._B = (
            sp.vstack(model.comm.allgather(local_csr(A)), "csr") for A in (model.M, model.K, model.inputs)
        )
        self._rows, fixed = model.rows.rows, [row for row in model.rows.rows if row.fixed]
        held = [_zero_rows(model.size, 0), *(row.at(row.breaks[0]) for row in fixed)]
        self._names, self._held = [row.name for row in fixed], sp.vstack(held, "csr")
        self._mass = spla.splu(sp.csc_matrix(M))
        self._lent = self._mass.solve(self._held.T.toarray())
        self._firm = np.linalg.pinv(self._held @ self._lent, hermitian=True)

    def acceleration(self, q: Array, acting: BodyStates | None) -> tuple[Array, dict[str, Array]]:
        """In m/s^2, (S, n), and forces (S,) of rigid supports by their names, in N or N m."""
        free = self._mass.solve((_loads(self._B, self._rows, acting, len(q)) - q @ self._K).T)
        supports = self._firm @ (self._held @ free)
        return (free - self._lent @ supports).T, dict(zip(self._names, supports, strict=True))


class _Pieces:
    """The beam's pieces, and what acts on each by itself."""

    def __init__(self, structure: Structure, cut: Cut) -> None:
        beam, nodes = cut.beam, structure.model.node_stations
        assert nodes is not None

        def between_nodes(place: str | float) -> bool:
            return bool(np.abs(nodes - beam.station(place)).min() > ON_NODE * nodes[-1])

        pads, masses = structure.pads, tuple(attached for attached in structure.masses if between_nodes(attached.on))
        supports, ends = (
            tuple(attached for attached in every if between_nodes(attached.on)) for every in (pads.supports, pads.ends)
        )
        pads = replace(pads, supports=supports, ends=ends, walls=Walls())
        masses = tuple(attached.model_copy(update={"coupling": "average"}) for attached in masses)
        apart = replace(structure, model=beam, clamps=(), masses=masses, pads=pads, outputs=(), ports=(), matrices=())
        coupling, base = couple(apart), operators_of(beam, MPI.COMM_SELF)
        restraints, moving = restrain(pads, beam, coupling.T), Moving(beam, masses, MPI.COMM_SELF)
        loads = [_zero_rows(beam.size, 0)]
        for load in structure.loads:
            on_node = isinstance(load, Action) and not between_nodes(load.on)
            loads.append(_zero_rows(beam.size) if on_node else coupling.load(load, base.M, moving))
        self._B, self._rows = sp.vstack(loads, "csr").T, restraints.rows
        self._M, self._springs = local_csr(base.M) + coupling.attached_mass(), restraints.stiffness(beam.size)
        self._held = {row.name: row.at(row.breaks[0]) for row in restraints.rows if row.fixed}
        self._moved = sp.csr_matrix(cut.coordinates @ couple(structure).T)

    def loads(self, q: Array, a: Array, supports: dict[str, Array], acting: BodyStates | None) -> tuple[Array, Array]:
        """Loads on the pieces, inertia too, and their places if nothing acts between nodes, (S, c) both."""
        displaced = (self._moved @ q.T).T
        forces = (
            _loads(self._B, self._rows, acting, len(q)) - displaced @ self._springs - (self._moved @ a.T).T @ self._M
        )
        for name, force in supports.items():
            if name in self._held:
                forces -= force[:, None] * self._held[name].toarray()
        return forces, displaced


def _loads(B: sp.csr_matrix, rows: Iterable[Row], acting: BodyStates | None, count: int) -> Array:
    """B f - C(s)^T lambda of the states, (S, n)."""
    if acting is None:
        return np.zeros((count, B.shape[0]))
    rows_by_name, pressed = {row.name: row for row in rows}, _zero_rows(B.shape[0], count)
    turned = np.zeros_like(acting.multipliers) if acting.moments is None else acting.moments
    for name, force, moment, at in zip(acting.rows, acting.multipliers.T, turned.T, acting.s.T, strict=True):
        if name in rows_by_name:
            pressed = pressed + rows_by_name[name].pressed(at, force)
            if np.any(moment):
                pressed = pressed - rows_by_name[name].pressed(at, moment, 1)
    return np.asarray((B @ acting.loads.T).T - pressed.toarray())


def _zero_rows(size: int, count: int = 1) -> sp.csr_matrix:
    return sp.csr_matrix((count, size))
