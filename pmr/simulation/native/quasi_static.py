r"""Modes without inertia (`pmr.reduced.quasi_static`) in a step, compiled: they follow at once, with their damping.

.. math::
    D\, (z_{n+1} - z_n) / h + \Omega^2 z_{n+1} = F_{n+1}

by backward Euler, which no kink makes ring.  In the words of `pmr.simulation.native.step` that is a prediction of what
damping keeps, :math:`z^* = z_n\, D / (D + h\, \Omega^2)`, with
:math:`S = dq\, (\Omega^2 + D / h)` and neither stiffness nor damping of the prediction.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.native.arrays import A_NEXT, V_NEXT, Z_FREE, Z_NEXT, Scheme, V, Z
from pmr.simulation.native.compilation import compiled_and_inlined, inlined
from pmr.simulation.native.form import SystemForm

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class QuasiStatic(NamedTuple):
    """Q modes without inertia."""

    numbers: Indices  # (q,): among all modes
    lag: Array  # (q,) s: D / Omega^2
    old: Array  # (q,): their displacement where the step begins


def quasi_static(form: SystemForm) -> QuasiStatic:
    """Those of a system."""
    numbers = form.quasi_static
    stiffness, D, _ = form.modes
    damping = D[0] if len(D) == 1 else np.diagonal(D)
    return QuasiStatic(numbers, damping[numbers] / stiffness[numbers], np.zeros(len(numbers)))


@inlined
def leave(quasi_static: Any, modes: Array) -> None:
    """Note where a step begins."""
    if quasi_static is not None:  # decided when compiled
        for k in range(len(quasi_static.numbers)):
            quasi_static.old[k] = modes[Z, quasi_static.numbers[k]]


@inlined
def forget(quasi_static: Any, scheme: Scheme, modes: Array) -> None:
    """Undo what forces of the step before have been given in the prediction: they leave nothing here."""
    if quasi_static is not None:
        for k in range(len(quasi_static.numbers)):
            n, kept = quasi_static.numbers[k], quasi_static.old[k] * _kept(quasi_static.lag[k], scheme)
            modes[Z_FREE, n] += kept - modes[Z_NEXT, n]
            modes[Z_NEXT, n] = kept
            modes[V_NEXT, n] = modes[A_NEXT, n] = 0.0


@inlined
def stop(quasi_static: Any, modes: Array) -> None:
    """No rates, while energies are found."""
    if quasi_static is not None:
        for k in range(len(quasi_static.numbers)):
            modes[V, quasi_static.numbers[k]] = 0.0


@compiled_and_inlined
def follow(quasi_static: QuasiStatic, scheme: Scheme, modes: Array) -> None:
    """The prediction for the step after the present state."""
    for k in range(len(quasi_static.numbers)):
        n = quasi_static.numbers[k]
        kept = modes[Z, n] * _kept(quasi_static.lag[k], scheme)
        modes[Z_NEXT, n] = modes[Z_FREE, n] = kept
        modes[V_NEXT, n] = modes[A_NEXT, n] = 0.0


@inlined
def finish(quasi_static: Any, scheme: Scheme, modes: Array) -> None:
    """Rates in the step that has ended, and the prediction for the next."""
    if quasi_static is not None:
        for k in range(len(quasi_static.numbers)):
            n = quasi_static.numbers[k]
            modes[V, n] = (modes[Z, n] - quasi_static.old[k]) / scheme.z_from_v
        follow(quasi_static, scheme, modes)


@inlined
def _kept(lag: float, scheme: Scheme) -> float:
    """Share of a displacement that is still there after a step in which nothing presses."""
    return lag / (scheme.z_from_v + lag)
