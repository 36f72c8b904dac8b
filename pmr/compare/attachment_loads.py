"""Loads that attachment modes answer, in a run and at rest, and whether a model has the data for such modes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import scipy.sparse as sp

from pmr.errors import InputError
from pmr.files.arrays import Array
from pmr.system.attachment import with_attachment_modes
from pmr.system.carriers import CarrierRows
from pmr.system.reduced_model import ReducedModel
from pmr.system.rows import Row
from pmr.system.states import SystemTrajectory
from pmr.system.system import System
from pmr.system.truncation import extend, is_modal

Models = Mapping[str, ReducedModel]


def reason_without_estimate(models: Models) -> str | None:
    """Reason, in words, why errors of bodies with these models can't be estimated; None if they can.

    `models` maps names of bodies to models.
    """
    for name, model in models.items():
        if why := _reason_without_estimate_of(model):
            return f"{name}: {why}" if name else why
    return None


def _reason_without_estimate_of(model: ReducedModel) -> str | None:
    """Reason, in words, why the error of one model can't be estimated; None if it can be."""
    if model.flexibility is None:
        return (
            "without residual flexibility the static deformation of the modes that are left out is missing, and the "
            "model does not say how large it is"
        )
    if not is_modal(model):
        return (
            "the basis is not one of eigenmodes: what it leaves out may have low frequencies and is coupled to the "
            "coordinates by inertia"
        )
    if model.enrichment is None or model.carriers is None or model.carriers.inertia is None:
        return (
            "the model holds no enrichment modes, which the estimate needs: reduction.estimate "
            "= true adds them where the mesh has more modes"
        )
    return None


#: Largest number of steps, evenly spaced among all, whose loads decide on attachment modes.
ANSWERED_STEPS = 20_000


def carried_loads(system: System, run: SystemTrajectory) -> dict[str, sp.csr_matrix]:
    """Forces in a run on the K carriers of each body and loads on its i inputs: sparse (S, K + i) in N, by body.

    The forces are those of the contacts at S steps of the run, at most `ANSWERED_STEPS`, evenly spaced.
    """
    forces, steps = {}, np.linspace(0, len(run.t) - 1, min(len(run.t), ANSWERED_STEPS)).astype(int)
    for name, body in system.reduced.items():
        assert body.carriers is not None
        rows = [system.row(side.place) for side in system.sides if side.place.body == name]
        motion, loads = run.bodies[name], run.loads[steps, system.load_columns[name]]
        forces[name] = carrier_forces(body.carriers, rows, motion.s[steps], motion.multipliers[steps], loads)
    return forces


def carrier_forces(
    carriers: CarrierRows, rows: Sequence[Row], x: Array, multipliers: Array, loads: Array
) -> sp.csr_matrix:
    r"""Forces of m rows on the K carriers of a body and, in i further columns, its loads: sparse (T, K + i) in N.

    A row with the multiplier :math:`\lambda` acts on its few carriers with :math:`-b(x) \lambda`, where b are its
    weights on these carriers.  The rows are at the path coordinates x (T, m) in m; their `multipliers` are (T, m) in N,
    and the `loads` (T, i) in N.
    """
    T, K = len(x), len(carriers.values)
    on, shares = [np.broadcast_to(K + np.arange(loads.shape[1]), loads.shape)], [loads]
    for row, at, force in zip(rows, x.T, multipliers.T, strict=True):
        touched, b = row.touched_weights(at, 0)
        on, shares = [*on, touched], [*shares, -b * force[:, None]]
    columns, entries = np.hstack(on), np.hstack(shares)
    ends = columns.shape[1] * np.arange(T + 1)
    forces = sp.csr_matrix((entries.ravel(), columns.ravel(), ends), (T, K + loads.shape[1]))
    forces.sum_duplicates()  # several rows may touch the same carrier
    return forces


#: Share of inertia that attachment modes for load cases at rest may leave out.
LEFT_OUT_AT_REST = 1e-4


def system_with_attachment_modes(system: System, x: Array, forces: Sequence[Array], loads: Sequence[Array]) -> System:
    """Return the system with attachment modes for the contact forces and loads of several load cases at rest.

    The residual flexibility of a model at rest is exact, except that axial forces do not change it.  Attachment modes
    for the loads on the bodies (`pmr.system.attachment`) and enrichment modes have second-order matrices and inertia,
    so they add the effect of axial forces.

    Parameters
    ----------
    system : System
        System of reduced bodies.
    x : (P, sides) array, m
        Path coordinates of all sides of the contacts in P positions.
    forces, loads : sequences of arrays, (P, m) and (P, i) in N
        Forces of the m contacts, and loads on the i inputs, with one array for each load case.

    Raises
    ------
    InputError
        If the models lack data that attachment modes need (`reason_without_estimate`).
    """
    models = system.modal
    if why := reason_without_estimate(models):
        allowed = f"models with an estimate of their error are allowed: {why}"
        raise InputError("scene", "reduction.estimate", None, allowed)
    bodies = {}
    for name, model in models.items():
        columns, carriers = system.load_columns[name], model.carriers
        assert carriers is not None  # `reason_without_estimate` has checked this
        on = system.sides_of(name)
        rows = [system.row(system.sides[number].place) for number in on]
        pressing = [
            carrier_forces(carriers, rows, x[:, on], system.side_multipliers(name, of), acting[:, columns])
            for of, acting in zip(forces, loads, strict=True)
        ]
        bodies[name] = with_attachment_modes(extend(model), sp.vstack(pressing, "csr"), LEFT_OUT_AT_REST, at_rest=True)
    return system.with_bodies(bodies)
