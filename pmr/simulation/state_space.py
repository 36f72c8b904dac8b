r"""A reduced model with its sliders held at places: state space on a grid of s, and frequency response.

.. math::
    \dot x = A(s)\, x + B(s)\, f, \qquad y = C(s)\, x + D(s)\, f, \qquad x = (z, \dot z), \qquad
    A = \begin{bmatrix} 0 & I \\ -(\Omega^2 + C_r^T F^{-1} C_r) & -D_m \end{bmatrix}

in modal coordinates z, which are the same at every s: mass and damping do not depend on it, so matrices between two
places may be interpolated and scheduled by s.  F = G(s) + 1/k is the flexibility of the rows C_r.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.constraints.polynomials import evaluate
from pmr.errors import InputError
from pmr.reduced.model import ReducedModel
from pmr.scene.built import force_of
from pmr.simulation.modal import modal_form
from pmr.system.body import pushing_rows
from pmr.system.compliant_rows import CompliantRows

Array = NDArray[np.float64]


@dataclass(frozen=True)
class StateSpace:
    """A(s), B(s), C(s), D(s) at S places, for 2 r states, i inputs and q outputs."""

    s: Array  # (S,) m
    # (S, 2 r, 2 r), (S, 2 r, i), (S, q, 2 r) and (S, q, i)
    A: Array
    B: Array
    C: Array
    D: Array
    # names; units are those of the outputs, displacements first, then the forces of the rows
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    units: tuple[str, ...]
    states: tuple[str, ...]

    @property
    def natural(self) -> Array:
        """Circular frequencies (S, r) in rad/s of the undamped system, ascending."""
        r = self.A.shape[1] // 2
        found: Array = np.sqrt(np.abs(np.linalg.eigvals(-self.A[:, r:, :r]).real))
        return np.sort(found, axis=1)

    def frequency_response(self, omega: Array) -> NDArray[np.complex128]:
        """C (i omega - A)^-1 B + D, complex (S, W, q, i), at circular frequencies (W,) in rad/s."""
        size = self.A.shape[1]
        found = np.empty((len(self.s), len(omega), self.C.shape[1], self.B.shape[2]), dtype=complex)
        for k, w in enumerate(omega):
            found[:, k] = self.C @ np.linalg.solve(1j * w * np.eye(size) - self.A, self.B) + self.D
        return found


def state_space(model: ReducedModel, s: Array, source: str) -> StateSpace:
    """State space of a model with its sliders at s (S,) m.

    An InputError, of the file `source`, is raised where rows are rigid or only push, residual inertia is kept, or the
    model is a section of a boom that its joints hold.
    """
    model.ensure_whole(source)
    form = modal_form(model)
    body, r = form.body, form.body.size
    rows = CompliantRows(body)
    rigid = [name for k, name in enumerate(body.row_names) if k not in rows.numbers]
    if rigid:
        allowed = (
            f"rows that give way are allowed in a state space, {', '.join(rigid)} are rigid: reduction.flexibility"
        )
        raise InputError(source, "rows", None, allowed)
    if pushing := [body.row_names[k] for k in pushing_rows(body)]:
        raise InputError(source, "rows", None, f"rows that hold both ways are allowed: {', '.join(pushing)} only push")
    if body.flexibility is not None and body.flexibility.keeps_inertia:
        raise InputError(source, "flexibility.inertia", None, "a model without residual inertia is allowed")
    system, C = rows.system(s), body.dense_rows(s)
    answers = np.linalg.solve(rows.flexibility(s), np.concatenate([C, rows.inputs(s)], axis=2))
    forces, of_loads = answers[:, :, :r], answers[:, :, r:]
    shapes = np.repeat(body.outputs[None], len(s), axis=0)
    direct = np.zeros((len(s), len(body.outputs), len(body.input_names)))
    if body.flexibility is not None:
        X = evaluate(body.flexibility.outputs, s)
        shapes, direct = shapes - X @ forces, body.flexibility.direct - X @ of_loads
    A = np.zeros((len(s), 2 * r, 2 * r))
    A[:, :r, r:], A[:, r:, :r], A[:, r:, r:] = np.eye(r), -system[:, :, :r], -body.D
    B = np.zeros((len(s), 2 * r, len(body.input_names)))
    B[:, r:] = system[:, :, r:]
    measured = np.concatenate([shapes, forces], axis=1)
    count = len(body.outputs)
    return StateSpace(
        s=s,
        A=A,
        B=B,
        C=np.concatenate([measured, np.zeros_like(measured)], axis=2),
        D=np.concatenate([direct, of_loads], axis=1),
        inputs=body.input_names,
        outputs=(*(body.output_names or tuple(f"output {k}" for k in range(count))), *map(force_of, body.row_names)),
        units=(*(body.output_units or ("m",) * count), *("N",) * len(body.row_names)),
        states=(*(f"mode {k + 1}" for k in range(r)), *(f"rate of mode {k + 1}" for k in range(r))),
    )
