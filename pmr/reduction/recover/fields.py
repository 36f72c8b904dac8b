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
from pmr.fullmodel.structure import Structure, couple
from pmr.models import FiniteElementModel, is_assembled
from pmr.reduction.recover.coordinates import BLOCK

Array = NDArray[np.float64]

#: What section forces make in the corners of a profile, as envelopes call it.
AXIAL_STRESS = "axial stress"


class View:
    """Looks at states that are spread over ranks; every method is collective and says the same on every rank.

    Parameters
    ----------
    model : FiniteElementModel
    comm : MPI communicator
    T : (n, n') sparse matrix, optional
        The model's coordinates are T z; by default they are z.
    stresses : bool
        Whether stresses are looked at, where the model has any.
    """

    def __init__(
        self,
        model: FiniteElementModel,
        comm: MPI.Comm = MPI.COMM_WORLD,
        T: sp.csr_matrix | None = None,
        stresses: bool = True,
    ) -> None:
        self.comm, self.grid, self.stress_rows = comm, model.grid, model.stresses() if stresses else None
        T = sp.eye(model.size, format="csr") if T is None else T
        mine = T.tocsc()[:, slice(*share(T.shape[1], comm))]
        self._points = sp.csr_matrix(model.point_displacements() @ mine)
        self._stresses = None if self.stress_rows is None else sp.csr_matrix(self.stress_rows.rows @ mine)
        self.force_rows = model.section_forces() if stresses else None
        self._forces = None if self.force_rows is None else sp.csr_matrix(self.force_rows.rows @ mine)

    @classmethod
    def of(cls, structure: Structure, comm: MPI.Comm = MPI.COMM_WORLD, stresses: bool = True) -> View:
        """The view of a structure, whose clamps and rigid masses leave out coordinates of its model.

        Raises
        ------
        InputError
            If its matrices were given: nothing is known of cells then.
        """
        if not is_assembled(structure.model):
            raise InputError("scene", "recovery", None, "given matrices have no cells to draw: leave it out")
        return cls(structure.model, comm, couple(structure).T, stresses)

    def displacements(self, q: Array) -> Array:
        """(S, N, 3) in m of the grid's points, from this rank's rows (S, n_local) of the states."""
        values = self._summed(self._points, q)
        return values.reshape(len(values), len(self.grid.points), 3)

    def stresses(self, q: Array) -> Array:
        """(S, P, c) in Pa at the points of `stress_rows`, likewise.

        Raises
        ------
        ValueError
            If the model has no stresses.
        """
        if self.stress_rows is None or self._stresses is None:
            raise ValueError("a beam without a profile has no stresses")
        return self.stress_rows.shaped(self._summed(self._stresses, q))

    def along(self) -> Running | None:
        """The envelope of what `section_forces` gives, to be filled; None without."""
        if self.force_rows is None:
            return None
        names, x, rows = self.force_rows.names, self.force_rows.x, self.stress_rows
        if rows is None:
            return Running(names, x)
        return Running((*names, *[AXIAL_STRESS] * len(rows.points)), np.concatenate([x, rows.points[:, 0]]))

    def section_forces(self, q: Array, stresses: Array | None) -> Array:
        """(S, P) in N and N m at the places of `force_rows`, with the axial of the `stresses` (S, p, c) behind."""
        assert self._forces is not None
        forces = self._summed(self._forces, q)
        return forces if stresses is None else np.hstack([forces, stresses[:, :, 0]])

    def _summed(self, rows: sp.csr_matrix, q: Array) -> Array:
        values = np.ascontiguousarray((rows @ q.T).T)
        self.comm.Allreduce(MPI.IN_PLACE, values)
        return values


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


def look(view: View, t: Array, blocks: Iterable[Array], pictures: Sequence[int] = (), components: bool = False) -> Seen:
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
        found = np.flatnonzero((chosen >= first) & (chosen < last))
        displacement[found] = view.displacements(q[chosen[found] - first])
        stresses = None if rows is None else view.stresses(q)
        if along is not None:
            along.add(np.asarray(t)[first:last], view.section_forces(q, stresses))
        if rows is not None and stresses is not None:
            values = rows.von_mises(stresses)
            largest[first:last], point[first:last] = values.max(axis=1), values.argmax(axis=1)
            higher = values.max(axis=0) > most
            when[higher] = np.asarray(t)[first:last][values.argmax(axis=0)[higher]]
            most = np.maximum(most, values.max(axis=0))
            if not at_peak.size or values.max() > at_peak.max():
                at_peak = values[values.max(axis=1).argmax()].copy()
            for face, part in rows.by_cell(values[chosen[found] - first], cells).items():
                fields[face][found] = part
            if components:
                for name, part in rows.components_by_cell(stresses[chosen[found] - first], cells).items():
                    signed.setdefault(name, np.zeros((len(chosen), cells), np.float32))[found] = part
        first = last
    history = None if rows is None else stress_history(rows, view.grid, t, largest, point, at_peak)
    regions = {} if rows is None else peaks_by_region(rows, view.grid, most, when)
    envelope = None if along is None else along.envelope(FORCES | {AXIAL_STRESS: "Pa"})
    return Seen(history, Fields(view.grid, np.asarray(t)[chosen], displacement, fields, signed), regions, envelope)


def in_blocks(q: Array) -> Iterator[Array]:
    """States (S, n_local) a few at a time."""
    for k in range(0, len(q), BLOCK):
        yield q[k : k + BLOCK]
