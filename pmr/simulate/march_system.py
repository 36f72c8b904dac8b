"""A body and a time step as the arrays that the compiled loop of `march` reads."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.reduced import ReducedModel
from pmr.simulate.march_kernel import Outputs, Scheme, State, System
from pmr.simulate.modal import ModalForm
from pmr.sliding import common_breaks, rebased

Array = NDArray[np.float64]


def scheme(step: float, rho_inf: float) -> Scheme:
    """Generalized-alpha with the parameters of Chung and Hulbert, Journal of Applied Mechanics 60, 1993, eq. 25."""
    alpha_m, alpha_f = (2.0 * rho_inf - 1.0) / (rho_inf + 1.0), rho_inf / (rho_inf + 1.0)
    gamma = 0.5 + alpha_f - alpha_m
    beta = (gamma + 0.5) ** 2 / 4.0
    gain = (1.0 - alpha_f) / (1.0 - alpha_m)
    return Scheme(
        step=step,
        a_from_acceleration=alpha_f / (1.0 - alpha_m),
        a_from_a=-alpha_m / (1.0 - alpha_m),
        z_from_a=(0.5 - beta) * step**2,
        z_from_next=beta * step**2,
        v_from_a=(1.0 - gamma) * step,
        v_from_next=gamma * step,
        a_gain=gain,
        v_gain=gamma * step * gain,
        z_gain=beta * step**2 * gain,
    )


def system(form: ModalForm, scheme: Scheme) -> System:
    """Constants of a body in modal form, its tables on common breaks."""
    body, omega2, damping = form.body, form.omega2, np.diagonal(form.body.D)
    i, m = len(body.input_names), len(body.row_names)
    breaks = table_breaks(body)
    zero = PPoly(np.zeros((1, 1, m, max(m, i))), np.array(body.domain))
    G, H = (body.flexibility.rows, body.flexibility.inputs) if body.flexibility else (zero, zero)
    compliance = _powers_last(rebased(G, breaks).c[..., :m])
    compliance[:, np.arange(m), np.arange(m), -1] += body.row_compliance
    effective = np.diag(1.0 + omega2 * scheme.z_gain) + body.D * scheme.v_gain
    couples = not form.classically_damped
    return System(
        breaks=breaks,
        rows=_powers_second_last(rebased(body.rows, breaks).c),
        compliance=compliance,
        inputs=_powers_last(rebased(H, breaks).c[..., :i]),
        B=_copy(body.B.T),
        omega2=_copy(omega2),
        damping=_copy(damping),
        inverse=1.0 / np.diagonal(effective),
        coupling=_copy(body.D) if couples else np.zeros((0, 0)),
        full_inverse=np.linalg.inv(effective) if couples else np.zeros((0, 0)),
    )


def outputs(body: ReducedModel, chosen: NDArray[np.int64]) -> Outputs:
    """Constants of the `chosen` outputs (numbers) of a body in modal form."""
    breaks = table_breaks(body)
    if body.flexibility is None:
        direct = np.zeros((len(chosen), len(body.input_names)))
        of_rows = np.zeros((len(breaks) - 1, len(body.row_names), 0, len(chosen)))
    else:
        direct = body.flexibility.direct[chosen]
        of_rows = _copy(rebased(body.flexibility.outputs, breaks).c[:, :, chosen].transpose(1, 3, 0, 2))
    return Outputs(of_modes=_copy(body.outputs[chosen].T), of_inputs=_copy(direct.T), of_rows=of_rows)


def table_breaks(body: ReducedModel) -> Array:
    """Breaks (k + 1,) in m between which all tables of a body are polynomials."""
    extra = [body.flexibility.rows, body.flexibility.inputs, body.flexibility.outputs] if body.flexibility else []
    return common_breaks([body.rows, *extra], body.domain)


def state(r: int, m: int) -> State:
    """At rest; the rows are evaluated in the first step."""
    return State(
        z=np.zeros(r),
        v=np.zeros(r),
        a=np.zeros(r),
        acceleration=np.zeros(r),
        multipliers=np.zeros(m),
        position=np.full(1, np.nan),
        interval=np.zeros(1, np.int64),
        C=np.zeros((m, r)),
        weighted=np.zeros((m, r)),
        factor=np.zeros((m, m)),
        scratch=np.zeros(r),
    )


def _powers_last(c: Array) -> Array:
    """(p, k, a, b) -> (k, a, b, p)."""
    return _copy(c.transpose(1, 2, 3, 0))


def _powers_second_last(c: Array) -> Array:
    """(p, k, m, r) -> (k, m, p, r)."""
    return _copy(c.transpose(1, 2, 0, 3))


def _copy(array: Array) -> Array:
    """Contiguous and writable: other arrays would be other types to the compiled loop."""
    return np.array(array, dtype=float, order="C")
