r"""Free-interface modes: eigenmodes on the fixed supports with all sliders and pads released.

.. math::
    K \phi = \omega^2 M \phi, \qquad C_{fixed}\, \phi = 0

Rigid-body modes, where the fixed supports leave any, come first with omega = 0.  MacNeal: A hybrid method of component
mode synthesis, Computers & Structures 1, 1971, pp. 581-601; Rubin: Improved component-mode representation for
structural dynamic analysis, AIAA Journal 13, 1975, pp. 995-1006.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.operators import FullModel, local_csr
from pmr.parallel import freed, sparse, tall, times
from pmr.sliding import Row, Rows, contributions
from pmr.snapshots import Snapshots
from pmr.snapshots.eigensolvers import eigensolver
from pmr.snapshots.modes import Modes

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

#: A vector whose strain energy exceeds its round-off no more than this many times is a rigid-body mode.  Measured:
#: these stay below 0.2 times, the softest mode of a cantilever exceeds it 2e8 times on 50 elements and 200 times on
#: 1500, from where on a mesh is called too fine.
RIGID = 8.0

#: A load or a row that does less work on a mode than this share of its work on another one does not excite it.
UNREACHED = 1e-8


def fixed_rows(model: FullModel) -> tuple[Row, ...]:
    """The rows that always hold, in one place: what holds the body while its sliders and pads are released."""
    return tuple(row for row in model.rows.rows if row.fixed)


def free_modes(model: FullModel, count: int, solver: str = "auto", companions: int = 0) -> Snapshots:
    """The lowest M-orthonormal modes that a load or a slider can excite, rigid-body modes included; collective.

    There are `count` of them, and up to `companions` more.

    Modes that none of them reaches stay at rest for ever: along the axis of a straight beam, say, where all loads act
    across it.  They are left out.

    Parameters
    ----------
    model : FullModel
    count : int
        At least as many as there are rigid-body modes, fewer than all: flexibility has to be left.
    solver : ``"auto"``, ``"dense"`` or ``"slepc"``
    companions : int
        Asked for beyond `count`; a coarse mesh may have fewer.

    Raises
    ------
    InputError
        If `count` is out of this range.
    ConvergenceError
        If too few modes converge.
    """
    lowest = _lowest(model, count + companions + 1, solver)  # one more tells whether all rigid-body modes are there
    modes, found = lowest.modes, len(lowest.excited)
    if found <= count:
        allowed = f"loads and sliders excite {found} modes of this mesh; fewer than these are allowed"
        raise InputError("scene", "reduction.coordinates", count, allowed)
    taken = lowest.excited[: min(count + companions, found - 1)]
    if lowest.rigid[lowest.excited[: count + 1]].all():
        allowed = f"the fixed supports leave at least {count + 1} rigid-body modes free; at least as many are allowed"
        raise InputError("scene", "reduction.coordinates", count, allowed)
    return Snapshots(
        S=tall(np.ascontiguousarray(modes.phi[:, taken]), model.M),
        omega=np.where(lowest.rigid, 0.0, modes.omega)[taken],
        s=np.full(len(taken), np.nan),
        residuals=modes.residuals[taken],
        source="eigenmodes on the fixed supports, sliders released",
        rigid=np.ascontiguousarray(modes.phi[:, lowest.rigid]),
    )


@dataclass(frozen=True)
class _Lowest:
    """The lowest modes, the numbers of those that are excited, and which ones (k,) are rigid-body modes."""

    modes: Modes
    excited: Indices
    rigid: NDArray[np.bool_]


def _lowest(model: FullModel, count: int, solver: str) -> _Lowest:
    """With `count` that are excited, fewer if there are no more."""
    held = _with_rows(model, fixed_rows(model))
    free, solve, asked = model.size - len(held.rows.rows), eigensolver(held, solver), count
    while True:
        asked = min(asked, free)
        modes = solve.lowest(_somewhere(held), asked)
        chosen = np.flatnonzero(excited(model, modes.phi))[:count]
        if len(chosen) == count or asked == free:
            return _Lowest(modes, chosen, rigid_bodies(model, modes.phi))
        asked = 2 * asked


def excited(model: FullModel, phi: Array) -> NDArray[np.bool_]:
    """Which columns (k,) of the modes, given by this rank's rows, a load or a released row does work on."""
    first = model.M.getOwnershipRange()[0]
    work = [local_csr(model.inputs).T @ phi]
    work += [
        contributions(row.project(phi, first)).reshape(-1, phi.shape[1]) for row in model.rows.rows if not row.fixed
    ]
    size = np.abs(model.comm.allreduce(np.concatenate(work)))
    return np.asarray(np.any(size > UNREACHED * size.max(axis=1, keepdims=True), axis=0))


def rigid_modes(model: FullModel, solver: str = "auto", expected: int = 1) -> Array:
    """All rigid-body modes that the fixed supports leave free, M-orthonormal; this rank's rows (n_local, count).

    As many as are `expected` cost one solution, more of them two.
    """
    held = _with_rows(model, fixed_rows(model))
    solve, free = eigensolver(held, solver), model.size - len(held.rows.rows)
    for count in (expected + 1, 7):  # a planar body on a pin has one, a free one in space six
        phi = solve.lowest(_somewhere(held), min(count, free)).phi
        rigid = rigid_bodies(model, phi)
        if not rigid.all():
            break
    return np.ascontiguousarray(phi[:, rigid])


def rigid_bodies(model: FullModel, local: Array) -> NDArray[np.bool_]:
    r"""Which columns (k,) are rigid-body motions: their strain energy is what round-off in K leaves of it.

    .. math:: x^T K x \le c\, \epsilon\, |x|^T |K| |x|

    The right-hand side bounds the error of the left one, so the comparison needs no frequency to compare with.
    """
    size = sparse(abs(local_csr(model.K)), model.K, columns=model.K.getLocalSize()[1])
    energy, scale = model.comm.allreduce(
        np.array([np.sum(local * times(model.K, local), axis=0), np.sum(abs(local) * times(size, abs(local)), axis=0)])
    )
    freed(size)
    return np.asarray(energy <= RIGID * np.finfo(float).eps * scale)


def _with_rows(model: FullModel, rows: tuple[Row, ...]) -> FullModel:
    return replace(model, rows=Rows(rows, model.size))


def _somewhere(model: FullModel) -> float:
    """A path coordinate at which the rows, none of which moves, can be evaluated."""
    return float(model.rows.domain[0]) if model.rows.rows else 0.0
