"""What is seen of a body's states: displacements of its points, stresses of its cells, where the largest one sits."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.fem.compat import MPI
from pmr.fields.envelope import FORCES, Envelope, Running
from pmr.fields.series import Fields
from pmr.fields.stress import StressHistory, StressPeak, peaks_by_region, stress_history
from pmr.fullmodel.assembly import share
from pmr.fullmodel.build import Built
from pmr.fullmodel.structure import couple
from pmr.models import is_assembled
from pmr.reduction.recover.coordinates import BLOCK
from pmr.reduction.recover.section_forces import PIECES, SectionForces
from pmr.system.states import BodyStates

Array = NDArray[np.float64]

#: What section forces make in the corners of a profile, as envelopes call it.
AXIAL_STRESS = "axial stress"


class View:
    """Looks at states that are spread over ranks; every method is collective and says the same on every rank.

    Parameters
    ----------
    built : Built
        Whose clamps and rigid masses leave out coordinates of its structural model.
    stresses : bool
        Whether stresses are looked at, where the model has any.

    Raises
    ------
    InputError
        If its matrices were given: nothing is known of cells then.
    """

    def __init__(self, built: Built, stresses: bool = True) -> None:
        model, comm = built.structure.model, built.model.comm
        if not is_assembled(model):
            raise InputError("scene", "recovery", None, "given matrices have no cells to draw: leave it out")
        self.comm, self.grid, T = comm, model.grid, couple(built.structure).T
        mine = T.tocsc()[:, slice(*share(T.shape[1], comm))]
        self._points = sp.csr_matrix(model.point_displacements() @ mine)
        cut = model.cut(PIECES) if stresses else None
        self.forces = None if cut is None else SectionForces(built, cut)
        self.stress_rows = model.stresses() if stresses and self.forces is None else None
        self._stresses = None if self.stress_rows is None else sp.csr_matrix(self.stress_rows.rows @ mine)
        if self.forces is not None:
            self.stress_rows = self.forces.stresses

    def displacements(self, q: Array) -> Array:
        """(S, N, 3) in m of the grid's points, from this rank's rows (S, n_local) of the states."""
        values = self._sum_over_ranks(self._points, q)
        return values.reshape(len(values), len(self.grid.points), 3)

    def stresses(self, q: Array, acting: BodyStates | None = None) -> Stresses:
        """Stresses of coordinates; those of a beam under what acts on it at these times."""
        along = None if self.forces is None else self.forces.of(np.hstack(self.comm.allgather(q)), acting)
        if self.stress_rows is None:
            return Stresses(along, None)
        values = self._sum_over_ranks(self._stresses, q) if along is None else along @ self.stress_rows.rows.T
        return Stresses(along, self.stress_rows.split_by_point(values))

    def along(self) -> Running | None:
        """The envelope of `Stresses.along_beam`, to be filled; None of bodies that are no lines."""
        if self.forces is None:
            return None
        names, x, rows = self.forces.names, self.forces.x, self.stress_rows
        if rows is None:
            return Running(names, x)
        return Running((*names, *[AXIAL_STRESS] * len(rows.points)), np.concatenate([x, rows.points[:, 0]]))

    def _sum_over_ranks(self, rows: sp.csr_matrix, q: Array) -> Array:
        values = np.ascontiguousarray((rows @ q.T).T)
        self.comm.Allreduce(MPI.IN_PLACE, values)
        return values


@dataclass(frozen=True)
class Stresses:
    """At S times; None of what a body does not have."""

    forces: Array | None  # (S, P) in N and N m: of a beam, where `SectionForces` has them
    values: Array | None  # (S, p, c) in Pa: at the points of `View.stress_rows`

    @property
    def along_beam(self) -> Array:
        """The section forces with axial stresses behind, (S, P + p)."""
        assert self.forces is not None
        return self.forces if self.values is None else np.hstack([self.forces, self.values[:, :, 0]])


@dataclass(frozen=True)
class Seen:
    """The stress history of all states, None where the model has no stresses; fields of some of them.

    `by_region` has the largest stress in each of the grid's regions, `envelope` of a beam forces and moments of its
    sections, and the axial stress that they make in the profile's corners.
    """

    stress: StressHistory | None
    fields: Fields
    by_region: Mapping[str, StressPeak]
    envelope: Envelope | None = None


def look(
    view: View,
    t: Array,
    blocks: Iterable[Array],
    pictures: Sequence[int] = (),
    components: bool = False,
    acting: BodyStates | None = None,
) -> Seen:
    """Go through states once; collective.

    Parameters
    ----------
    view : View
    t : (S,) array, s
        Times of the states.
    blocks : iterable of (k, n_local) arrays
        This rank's rows of the states, in order: `pmr.reduction.recover.coordinates.Recovery.blocks`, or `in_blocks`.
    pictures : sequence of int
        Numbers of the states whose fields are stored.
    components : bool
        Whether their signed stresses are stored too.
    acting : BodyStates, optional
        Loads and forces of contacts in these states, which beams' section forces take; by default nothing acts.
    """
    rows, cells, chosen = view.stress_rows, len(view.grid.cells), np.unique(np.asarray(pictures, np.int64))
    largest, point = np.zeros(len(t)), np.zeros(len(t), np.int64)
    displacement = np.zeros((len(chosen), len(view.grid.points), 3), np.float32)
    fields = {face: np.zeros((len(chosen), cells), np.float32) for face in (rows.faces if rows else ())}
    signed = dict[str, NDArray[np.float32]]()
    most = np.full(len(rows.points) if rows else 0, -np.inf)
    first, at_peak, when, along = 0, np.zeros(0), np.zeros(len(most)), view.along()
    for q in blocks:
        last = first + len(q)
        numbers = np.flatnonzero((chosen >= first) & (chosen < last))
        displacement[numbers] = view.displacements(q[chosen[numbers] - first])
        stressed = view.stresses(q, None if acting is None else acting[first:last])
        stresses = stressed.values
        if along is not None:
            along.add(np.asarray(t)[first:last], stressed.along_beam)
        if rows is not None and stresses is not None:
            values = rows.von_mises(stresses)
            largest[first:last], point[first:last] = values.max(axis=1), values.argmax(axis=1)
            higher = values.max(axis=0) > most
            when[higher] = np.asarray(t)[first:last][values.argmax(axis=0)[higher]]
            most = np.maximum(most, values.max(axis=0))
            if not at_peak.size or values.max() > at_peak.max():
                at_peak = values[values.max(axis=1).argmax()].copy()
            for face, part in rows.by_cell(values[chosen[numbers] - first], cells).items():
                fields[face][numbers] = part
            if components:
                for name, part in rows.components_by_cell(stresses[chosen[numbers] - first], cells).items():
                    signed.setdefault(name, np.zeros((len(chosen), cells), np.float32))[numbers] = part
        first = last
    history = None if rows is None else stress_history(rows, view.grid, t, largest, point, at_peak)
    regions = {} if rows is None else peaks_by_region(rows, view.grid, most, when)
    envelope = None if along is None else along.envelope(FORCES | {AXIAL_STRESS: "Pa"})
    return Seen(history, Fields(view.grid, np.asarray(t)[chosen], displacement, fields, signed), regions, envelope)


def in_blocks(q: Array) -> Iterator[Array]:
    """States (S, n_local) a few at a time."""
    for k in range(0, len(q), BLOCK):
        yield q[k : k + BLOCK]
