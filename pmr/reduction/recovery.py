r"""Full coordinates, fields and stresses of a scene's bodies from reduced states.

At chosen times the full coordinates are

.. math:: q = V p + R\, (B f - C(s)^T z)

with reduced coordinates p, loads f, multipliers z, and the flexibility R that the basis V leaves out.  R is applied to
the loads of all these times with one factorisation; without residual flexibility q = V p.  The outputs of the reduced
model, O V p + W f - X z (`pmr.system.reduced_model`), equal O q.

Velocities are taken as V p'.  The velocity of the residual part would follow from rates of the multipliers, which jump
wherever the path or a load has a kink (`pmr.compare.outputs`; docs/moving_residual_flexibility.md, sections 2, 5 and
11).

From the coordinates follow displacements of the body's points, stresses of its cells and the largest stress, as a scene
asks for them, for reduced models and, if their states are known, for full ones.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.fem.compat import MPI
from pmr.fem.distributed import local_csr, share
from pmr.files.arrays import Array
from pmr.fullmodel.build import AssembledBody
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.structure import couple
from pmr.models import is_assembled
from pmr.reduction.cache import ReducedBody
from pmr.reduction.free_body import FreeBody, ResidualFlexibility
from pmr.reduction.section_forces import PIECES, SectionForces
from pmr.results.field_series import Fields
from pmr.results.field_stress import (
    FORCES,
    Envelope,
    RunningEnvelope,
    StressHistory,
    StressPeak,
    peaks_by_region,
    stress_history,
)
from pmr.scene import Scene
from pmr.scene.members import TAIL
from pmr.system.reduced_model import ReducedModel
from pmr.system.states import BodyStates

#: Number of states that are recovered at once: a few times as many vectors of full length are in memory.
BLOCK = 64


class Recovery:
    """Recovery of full coordinates q from states of a reduced model; every method is collective.

    Parameters
    ----------
    model : FullModel
        The full model, with n coordinates.
    V : (n_local, k) array
        This rank's part of the basis; its first columns are the modes of the reduced model that are no cylinder modes.
    reduced : ReducedModel
        The reduced model, the same on every rank.
    solver : ``"auto"``, ``"dense"`` or ``"slepc"``
        Solver of static equations, chosen as for the tables of the residual flexibility.

    Attributes
    ----------
    V : (n_local, r) array
        This rank's part of the vectors that belong to all r coordinates of the reduced model.
    """

    def __init__(self, model: FullModel, V: Array, reduced: ReducedModel, solver: str = "auto") -> None:
        """Compute the vectors of the reduced model's r coordinates; the class describes the arguments.  Collective."""
        self.reduced = reduced
        self._model, modes = model, reduced.size - reduced.cylinder_modes
        self.V = np.ascontiguousarray(V[:, :modes])
        self._share = model.share
        self._residual: ResidualFlexibility | None = None
        if reduced.flexibility is not None:
            self._inputs = local_csr(model.B)
            body = FreeBody(model, solver)
            self._residual = ResidualFlexibility(body, self.V)
            if reduced.cylinder_modes:
                self.V = np.hstack([self.V, self._cylinder_vectors(self._residual)])
                self._residual = ResidualFlexibility(body, self.V)

    def _cylinder_vectors(self, modal: ResidualFlexibility) -> Array:
        """Vectors (n_local, a), this rank's part, of the a cylinder modes of the reduced model.

        A cylinder mode is a combination of responses to the force of a cylinder at the body's tail.  `modal` is the
        flexibility that the body's other modes leave out.  Collective.
        """
        carriers, model = self.reduced.carriers, self._model
        assert carriers is not None and carriers.answers is not None
        tail = model.rows.rows[model.rows.names.index(TAIL)]
        turned = carriers.answers.turned
        return modal.powers(tail.at(tail.breaks[0]).toarray()[0, self._share], len(turned)) @ turned

    def positions(self, states: BodyStates) -> Array:
        """Full coordinates q (S, n_local), this rank's part, at the S times of `states`.

        The states are the same on every rank.  For many states of a large model, `blocks` takes less memory.
        """
        parts = [np.empty((0, len(self.V))), *self.blocks(states)]
        return np.concatenate(parts)

    def blocks(self, states: BodyStates) -> Iterator[Array]:
        """Yield full coordinates q (k, n_local), this rank's part, for successive blocks of k states.

        A block has at most `BLOCK` states.
        """
        for k in range(0, len(states.t), BLOCK):
            yield self._block(states[k : k + BLOCK])

    def _block(self, states: BodyStates) -> Array:
        """Full coordinates q (S, n_local) of the body in S `states`, this rank's part."""
        q = states.p @ self.V.T
        if self._residual is not None:
            # by the loads B f - C(s)^T z (n_local, S) in N, this rank's part
            model_rows = self._model.rows
            pressed = sp.csr_matrix((len(states.t), model_rows.size))
            for name, z, at in zip(states.rows, states.multipliers.T, states.s.T, strict=True):
                pressed = pressed + model_rows.rows[model_rows.names.index(name)].forces_on_coordinates(at, z)
            q += self._residual.apply(self._inputs @ states.loads.T - pressed[:, self._share].T.toarray()).T
        return np.asarray(q)


#: Name that envelopes use for the stress by section forces in the corners of a profile.
AXIAL_STRESS = "axial stress"


class BodyFields:
    """Displacements and stresses of a body, from states that are distributed over ranks; all methods are collective.

    Every method returns the same on every rank.

    Attributes
    ----------
    grid : Grid
        Points and cells at which results are given.
    forces : SectionForces or None
        Section forces; None unless the body is a beam and `stresses` is true.
    stress_rows : StressRows or None
        Points and components of the stresses; None if there are none.

    Parameters
    ----------
    built : AssembledBody
        The full model, with its structural model.  Clamps and rigid masses make coordinates of the structural model
        dependent, so the full model has fewer coordinates.
    stresses : bool
        Whether stresses are computed, for a model that has stresses.

    Raises
    ------
    InputError
        If the model consists of given matrices: then it has no cells.
    """

    def __init__(self, built: AssembledBody, stresses: bool = True) -> None:
        """Prepare displacements and, if `stresses`, stresses of the full model `built`; collective."""
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
        """Displacements (S, N, 3) in m of the grid's N points at S times, from full coordinates q (S, n_local).

        Each rank gives its own part of q.
        """
        values = self._sum_over_ranks(self._points, q)
        return values.reshape(len(values), len(self.grid.points), 3)

    def stresses(self, q: Array, acting: BodyStates | None = None) -> Stresses:
        """Stresses at S times, from full coordinates q (S, n_local); each rank gives its own part of q.  Collective.

        The section forces of a beam include the loads and contact forces `acting` on it; None if nothing acts.  The
        result has None for section forces or stresses that the body does not have.
        """
        along = None if self.forces is None else self.forces.evaluate(np.hstack(self.comm.allgather(q)), acting)
        if self.stress_rows is None:
            return Stresses(along, None)
        values = self._sum_over_ranks(self._stresses, q) if along is None else along @ self.stress_rows.rows.T
        return Stresses(along, self.stress_rows.split_by_point(values))

    def empty_envelope(self) -> RunningEnvelope | None:
        """Empty envelope that collects `Stresses.along_beam`; None for bodies without section forces."""
        if self.forces is None:
            return None
        names, x, rows = self.forces.names, self.forces.x, self.stress_rows
        if rows is None:
            return RunningEnvelope(names, x)
        return RunningEnvelope((*names, *[AXIAL_STRESS] * len(rows.points)), np.concatenate([x, rows.points[:, 0]]))

    def _sum_over_ranks(self, rows: sp.csr_matrix, q: Array) -> Array:
        """Products (S, k) of `rows` (k, n_local) and q (S, n_local), added up over all ranks; collective."""
        values = np.ascontiguousarray((rows @ q.T).T)
        self.comm.Allreduce(MPI.IN_PLACE, values)
        return values


@dataclass(frozen=True)
class Stresses:
    """Stresses and section forces of a body at S times; None for what the body does not have."""

    forces: Array | None  # (S, P) in N and N m: of a beam, as `SectionForces.names` lists them
    values: Array | None  # (S, p, c) in Pa: c components at p points (`BodyFields.stress_rows`)

    @property
    def along_beam(self) -> Array:
        """P section forces in N and N m, then p axial stresses in Pa, at S times: (S, P + p); only for a beam."""
        assert self.forces is not None
        return self.forces if self.values is None else np.hstack([self.forces, self.values[:, :, 0]])


@dataclass(frozen=True)
class FieldRecord:
    """Recorded results of a body's states: stresses of all states, and fields of some states.

    `stress` is None if the model has no stresses.  `by_region` has the largest stress in each of the grid's regions.
    `envelope` has the largest section forces and moments of a beam, and the axial stresses that these cause in the
    profile's corners; `envelope` is None for other bodies.
    """

    stress: StressHistory | None
    fields: Fields
    by_region: Mapping[str, StressPeak]
    envelope: Envelope | None = None


def record_fields(
    view: BodyFields,
    t: Array,
    blocks: Iterable[Array],
    pictures: Sequence[int] = (),
    components: bool = False,
    acting: BodyStates | None = None,
) -> FieldRecord:
    """Record stresses of all states and fields of the states in `pictures`, in a single pass; collective.

    Parameters
    ----------
    view : BodyFields
        Displacements and stresses of the body.
    t : (S,) array, s
        Times of the states.
    blocks : iterable of (k, n_local) arrays
        Full coordinates of k successive states each, this rank's part: `Recovery.blocks`, or `in_blocks`.
    pictures : sequence of int
        Numbers of the states whose fields are stored.
    components : bool
        Whether the signed stresses of the states in `pictures` are stored too.
    acting : BodyStates, optional
        Loads and contact forces at the times t, for the section forces of beams; None if nothing acts.
    """
    rows, cells, chosen = view.stress_rows, len(view.grid.cells), np.unique(np.asarray(pictures, np.int64))
    largest, point = np.zeros(len(t)), np.zeros(len(t), np.int64)
    displacement = np.zeros((len(chosen), len(view.grid.points), 3), np.float32)
    fields = {face: np.zeros((len(chosen), cells), np.float32) for face in (rows.faces if rows else ())}
    signed = dict[str, NDArray[np.float32]]()
    most = np.full(len(rows.points) if rows else 0, -np.inf)
    first, at_peak, when, along = 0, np.zeros(0), np.zeros(len(most)), view.empty_envelope()
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
    return FieldRecord(
        history, Fields(view.grid, np.asarray(t)[chosen], displacement, fields, signed), regions, envelope
    )


def in_blocks(q: Array) -> Iterator[Array]:
    """Yield successive blocks (k, n_local) of states q (S, n_local); k is at most `BLOCK`."""
    for k in range(0, len(q), BLOCK):
        yield q[k : k + BLOCK]


@dataclass(frozen=True)
class RecoveredBody:
    """Stresses of a body by model: ``reduced``, with fields, and ``full``, without fields, if its states are known.

    For a beam, the objects that computed its section forces and full coordinates are stored too.
    """

    records: Mapping[str, FieldRecord]
    forces: SectionForces | None = None  # None: the body is no beam
    recovery: Recovery | None = None  # object that computes full coordinates; None: the body is no beam

    @property
    def reduced(self) -> FieldRecord:
        """Fields and stresses of the reduced model."""
        return self.records["reduced"]

    @property
    def _stresses(self) -> dict[str, StressHistory]:
        """Histories of stresses by model; empty for a body without stresses."""
        return {name: record.stress for name, record in self.records.items() if record.stress is not None}

    def summary(self) -> dict[str, Any]:
        """Entries ``max_von_mises`` (Pa), ``stress_peak``, ``stress_by_region`` and ``section_forces``, each by model.

        Keys that do not apply to the body are left out: a beam without a profile has no stresses, a shell no section
        forces.
        """
        along = {name: envelope.extremes() for name, envelope in self.envelopes().items()}
        forces = {"section_forces": along} if along else {}
        if not (stresses := self._stresses):
            return forces
        regions = {
            name: {region: peak.summary() for region, peak in record.by_region.items()}
            for name, record in self.records.items()
        }
        return forces | {
            "stress_by_region": {name: by_region for name, by_region in regions.items() if by_region},
            "max_von_mises": {name: stress.peak.value for name, stress in stresses.items()},
            "stress_peak": {name: stress.peak.summary() for name, stress in stresses.items()},
        }

    def histories(self) -> dict[str, Array]:
        """Largest von Mises stress (S,) in Pa at each recovered time, by model; empty for a body without stresses."""
        return {name: stress.largest for name, stress in self._stresses.items()}

    def envelopes(self) -> dict[str, Envelope]:
        """Envelopes of section forces and axial stresses along a beam, by model; empty for a body that is no beam."""
        return {name: record.envelope for name, record in self.records.items() if record.envelope is not None}


def recover(
    scene: Scene,
    built: Mapping[str, AssembledBody],
    bodies: Mapping[str, ReducedBody],
    reduced: Mapping[str, BodyStates],
    full: Mapping[str, BodyStates],
) -> dict[str, RecoveredBody]:
    """Stresses of a scene's reduced and full models, and fields of the reduced models, by the bodies' names.

    Collective.  The scene must have a `recovery`.  `reduced` has the states of the reduced bodies at the
    `Scene.recovered_steps`, the same on every rank.  Fields are stored at `scene.recovery.frames` of these steps,
    evenly spread, or at all steps if there are fewer.  `full` has this rank's part of the states of the full models, or
    lacks a body whose full model was not simulated.  No fields are stored for full models.
    """
    settings, recovered = scene.recovery, dict[str, RecoveredBody]()
    assert settings is not None
    for name, part in scene.bodies.items():
        at = reduced[name]
        recovery = Recovery(built[name].model, bodies[name].V, bodies[name].model, part.reduction.solver)
        view = BodyFields(built[name], settings.stress)
        pictures = np.rint(np.linspace(0, len(at.t) - 1, min(settings.frames, len(at.t)))).astype(np.int64).tolist()
        records = {"reduced": record_fields(view, at.t, recovery.blocks(at), pictures, settings.components, at)}
        if name in full:
            states = full[name]
            records["full"] = record_fields(view, states.t, in_blocks(states.p), acting=states)
        recovered[name] = RecoveredBody(records, view.forces, None if view.forces is None else recovery)
    return recovered
