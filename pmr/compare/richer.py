"""A richer system of the same bodies, by which errors of what stands still are estimated.

At rest residual flexibility leaves nothing out but for what axial forces do to it: attachment modes for what bodies
bear (`pmr.reduced.attachment`) and enrichment modes have the matrices of second order, and inertia.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.compare.attached import carrier_forces
from pmr.compare.estimate import no_estimate
from pmr.errors import InputError
from pmr.reduced.attachment import with_attachment_modes
from pmr.reduced.truncation import extend
from pmr.system.system import System

Array = NDArray[np.float64]
#: Share of inertia that directions among the loads may leave out.
LEFT_OUT = 1e-4


def richer(system: System, x: Array, forces: Sequence[Array], loads: Sequence[Array]) -> System:
    """Add attachment modes for contact forces (P, m) N at places x (P, sides) m, and loads (P, i) N, of several cases.

    An InputError is raised where the models know no more.
    """
    models = system.modal
    if why := no_estimate(models):
        raise InputError(
            "scene", "reduction.estimate", None, f"models with an estimate of their error are allowed: {why}"
        )
    bodies, first = {}, 0
    for name, model in models.items():
        last, carriers = first + len(model.input_names), model.carriers
        assert carriers is not None  # as `no_estimate` says
        on = system.sides_of(name)
        rows = [system.row(system.sides[number].place) for number in on]
        pressing = [
            carrier_forces(carriers, rows, x[:, on], system.pressed(name, of), acting[:, first:last])
            for of, acting in zip(forces, loads, strict=True)
        ]
        bodies[name] = with_attachment_modes(extend(model), sp.vstack(pressing, "csr"), LEFT_OUT, at_rest=True)
        first = last
    return system.with_bodies(bodies)
