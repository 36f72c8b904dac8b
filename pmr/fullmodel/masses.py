r"""Mass and centre of gravity of a body, from its mass matrix under rigid motions.

.. math:: m = r_x^T M r_x, \qquad m\, \bar x = r_y^T M r_{\theta z}, \quad m\, \bar y = r_z^T M r_{\theta x}, \quad
    m\, \bar z = r_x^T M r_{\theta y}
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.fem.compat import MPI, PETSc
from pmr.fem.distributed import free_objects
from pmr.models import StructuralModel, is_assembled
from pmr.scene.structures import PointMass

Array = NDArray[np.float64]

#: Share of the largest coordinate of a centre of gravity up to which another one is round-off.
ROUND_OFF = 1e-12
#: First moments along x, y, z by a translation and a rotation that meet in them, with their sign.
MOMENTS = ((("y", "rz", 1.0), ("z", "ry", -1.0)), (("z", "rx", 1.0),), (("x", "ry", 1.0),))


@dataclass(frozen=True)
class Masses:
    """Masses of a body by itself and with what is attached to it."""

    own: float  # kg
    attached: float  # kg
    centre: Array  # (3,) m, of both, in the body's axes

    def summary(self) -> dict[str, Any]:
        """``mass`` and ``attached`` in kg, ``centre`` in m, for summary.json."""
        return {"mass": self.own, "attached": self.attached, "centre": self.centre.tolist()}


def masses_of(model: StructuralModel, attached: Sequence[PointMass], M: PETSc.Mat) -> Masses | None:
    """Masses of a model with mass matrix M, without supports; None of matrices that were given.  Collective."""
    if not is_assembled(model):
        return None
    directions, G = model.directions, _gram_matrix(model.rigid_motions(), M)
    mass_of_model = max(float(G[k, k]) for k, direction in enumerate(directions) if direction in "xyz")
    moments = np.zeros(3)
    for axis, options in enumerate(MOMENTS):
        for along, about, sign in options:
            if along in directions and about in directions:
                moments[axis] = sign * G[directions.index(along), directions.index(about)]
                break
    for mass in attached:
        moments += mass.mass * np.array(model.centroid(mass.on) if mass.at is None else mass.at)
    carried = float(sum(mass.mass for mass in attached))
    centre = moments / (mass_of_model + carried)
    centre[np.abs(centre) <= ROUND_OFF * np.abs(centre).max()] = 0.0
    return Masses(mass_of_model, carried, centre)


def _gram_matrix(R: Array, M: PETSc.Mat) -> Array:
    """R^T M R (k, k) of motions R (n, k) that every rank has."""
    x, f = M.createVecRight(), M.createVecLeft()
    mine, columns = R[slice(*M.getOwnershipRange())], []
    for motion in mine.T:
        x.getArray()[:] = motion
        M.mult(x, f)
        columns.append(mine.T @ f.getArray())
    free_objects(x, f)
    product = np.column_stack(columns)
    M.comm.tompi4py().Allreduce(MPI.IN_PLACE, product)
    return product
