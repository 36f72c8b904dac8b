r"""Coordinates without inertia (`pmr.reduced.quasi_static`) in Exudyn: backward Euler as `march` has it.

.. math:: (D / h + K)\, \eta_{n+1} + \ldots = F_{n+1} + D\, \eta_n / h

An object of their own adds D / h and the force of what damping keeps, once a step.  Until the first step it has the
inertia that the bodies lack, so that initial accelerations of all other coordinates can be solved for.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import exudyn as exu
import numpy as np
import scipy.sparse as sp
from exudyn.itemInterface import ObjectGenericODE2
from numpy.typing import NDArray

from pmr.simulation.exudyn.equations import Equations
from pmr.simulation.exudyn.items import SystemItems, add_pre_step_function, matrix

Array = NDArray[np.float64]


def with_quasi_static(mbs: Any, items: SystemItems, equations: Equations) -> SystemItems:
    """Add items for coordinates without inertia, if there are any."""
    still, reached, begun = equations.quasi_static, 0.0, False
    if not len(still):
        return items

    def diagonal(values: Any) -> Any:
        diagonal = np.zeros(equations.size)
        diagonal[still] = values
        return matrix(sp.diags(diagonal, format="csr") if equations.sparse else np.diag(diagonal))

    empty, inertia = diagonal(0.0), diagonal(1.0)
    name = f"{mbs.GetMarker(items.mSystem)['name']}QuasiStatic"
    oStill = mbs.AddObject(
        ObjectGenericODE2(
            name=name,
            nodeNumbers=list(items.nBodies.values()),
            massMatrix=inertia,
            massMatrixUserFunction=lambda *arguments: empty if begun else inertia,  # Exudyn reuses what is a constant
            stiffnessMatrix=empty,
            forceVector=np.zeros(equations.size),
            jacobianUserFunction=lambda *arguments: empty,  # nothing beyond the matrices
        )
    )

    def follow(mbs: Any, t: float) -> bool:
        nonlocal reached, begun
        if t <= 0.0:  # before a simulation is repeated
            reached, begun = 0.0, False
            return True
        kind, force, step = exu.OutputVariableType.Coordinates, np.zeros(equations.size), t - reached
        q = np.concatenate([mbs.GetNodeOutput(node, kind) for node in items.nBodies.values()])
        force[still] = equations.quasi_static_damping * q[still] / step
        mbs.SetObjectParameter(oStill, "stiffnessMatrix", diagonal(equations.quasi_static_damping / step))
        mbs.SetObjectParameter(oStill, "forceVector", force)
        reached, begun = t, True
        return True

    def update(mbs: Any, t: float) -> bool:
        return items.update(mbs, t) and follow(mbs, t)

    add_pre_step_function(mbs, follow)
    return replace(items, update=update)


def rates(equations: Equations, t: Array, q: Array, v: Array) -> Array:
    """Rates (T, n), of coordinates without inertia by the differences of q (T, n) at the times t (T,) s."""
    still, changed = equations.quasi_static, v.copy()
    changed[:, still] = 0.0
    changed[1:, still] = np.diff(q[:, still], axis=0) / np.diff(t)[:, None]
    return changed
