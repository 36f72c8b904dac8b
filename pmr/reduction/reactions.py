"""Static motions of a full model's rigid supports, and with them the reactions of a reduced one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.constraints.polynomials import stack_tables
from pmr.constraints.rows import Rows
from pmr.fem.distributed import inner, subtract, times
from pmr.fem.matrices import local_csr
from pmr.fullmodel.model import FullModel
from pmr.reduced.model import ReducedModel
from pmr.reduced.reactions import Reactions
from pmr.reduction.snapshots.free_body import HELD, FreeBody, fixed_rows

Array = NDArray[np.float64]


def support_motions(body: FreeBody) -> Array | None:
    r"""Phi with C_f Phi = I, Phi^T K q = 0 wherever C_f q = 0, and Z^T M Phi = 0; None without rigid supports.

    .. math::
        \Phi = P (\Phi_0 - K^+ K \Phi_0), \qquad \Phi_0 = R N + C_f^T (C_f C_f^T)^{-1} (I - C_f R N), \qquad
        N = (C_f R)^+

    with R the rigid motions: where these do all, as on statically determinate supports, nothing is solved.  This
    rank's rows (n_local, h); collective.
    """
    model = body.model
    held = fixed_rows(model)
    if not held or model.rigid is None:
        return None
    share, R = model.share, model.rigid.coordinates
    S = sp.vstack([row.at(row.breaks[0]) for row in held], format="csr")
    measured = np.asarray(model.comm.allreduce(S[:, share] @ R))
    N = np.linalg.pinv(measured, rcond=HELD)
    remainder = np.eye(len(held)) - measured @ N
    remainder[np.abs(remainder) < HELD] = 0.0
    motions = R @ N
    if np.any(remainder) or np.any(np.abs(model.rigid.held @ N) > HELD * np.abs(model.rigid.held).max(initial=0.0)):
        motions = motions + (S[:, share].T @ (np.linalg.pinv((S @ S.T).toarray()) @ remainder))
        motions = motions - body.solve(np.asfortranarray(times(model.K, np.asfortranarray(motions))))
    motions = np.asfortranarray(motions)
    subtract(motions, body.Z, inner(body.MZ, motions, model.comm))
    return motions


def with_reactions(reduced: ReducedModel, body: FreeBody, V: Array, motions: Array | None) -> ReducedModel:
    """The model on the basis V, given by this rank's rows as `motions` of its supports are, that tells their forces."""
    if motions is None:
        return reduced
    model, held = body.model, fixed_rows(body.model)
    first = model.M.getOwnershipRange()[0]
    tables = {row.name: row.project(motions, first) for row in model.rows.rows}
    for row in model.rows.rows:
        tables[row.name].c[:] = 0.0 if row.fixed else model.comm.allreduce(tables[row.name].c)
    nothing = PPoly(np.zeros((1, 1, len(held))), np.array(model.rows.domain))
    rows = stack_tables([tables.get(name, nothing) for name in reduced.row_names] or [nothing], model.rows.domain)
    c = rows.c if reduced.row_names else rows.c[:, :, :0]
    inertia = inner(motions, times(model.M, V), model.comm)
    if model.rayleigh is None:
        damping = inner(motions, times(model.D, V), model.comm)
    else:
        damping = model.rayleigh.of(inertia, np.zeros_like(inertia))
    carriers = None if reduced.carriers is None else replace(reduced.carriers, supports={})
    return replace(
        reduced,
        carriers=carriers,
        reactions=Reactions(
            names=tuple(row.name for row in held),
            units=tuple(row.unit for row in held),
            inertia=inertia,
            damping=damping,
            stiffness=np.zeros_like(inertia),
            inputs=np.asarray(model.comm.allreduce(motions.T @ local_csr(model.inputs))),
            rows=PPoly(np.ascontiguousarray(c.swapaxes(2, 3)), rows.x),
            carried=None if reduced.carriers is None else _carrier_motions(model, motions),
            matrices=_work_on_motions(reduced, model, V, motions),
            ports={
                name: model.comm.allreduce(np.asarray(row[:, model.share] @ motions)[0])
                for name, row in model.ports.items()
            },
        ),
    )


def _work_on_motions(reduced: ReducedModel, model: FullModel, V: Array, motions: Array) -> dict[str, Array]:
    """Work (h, .) of the model's matrices on the motions: on V, and on all that the carriers' matrices are on."""
    if reduced.carriers is not None and reduced.carriers.supports:
        return dict(reduced.carriers.supports)
    return {name: inner(motions, times(A, V), model.comm) for name, A in model.matrices.items()}


def _carrier_motions(model: FullModel, motions: Array) -> Array:
    """U Phi (K, h) on the carriers of the rows that are no rigid supports."""
    U = Rows(tuple(row for row in model.rows.rows if not row.fixed), model.size).shared.carriers
    return np.asarray(model.comm.allreduce(U[:, model.share] @ motions))
