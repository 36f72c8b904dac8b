r"""The compiled simulator of models that keep the inertia of what their modes leave out.

Same coordinates and outputs as without; multipliers gain the force that accelerates the local deformation under each
slider (`pmr.simulation.native.residual_inertia_step` has the equations).  Rates of path and loads are central
differences of the signals at the steps, also across kinks, whose impulse they carry: one-sided derivatives would lose
it.  A load that jumps is differentiated likewise; measured loads should be smooth on the scale of a step.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.constraints.polynomials import side_by_side, total
from pmr.errors import InputError, SimulationError
from pmr.scene.simulators import refuse
from pmr.simulation import balance
from pmr.simulation.blocks import Block, Ended, Take, in_blocks
from pmr.simulation.excitation import Excitation, in_order
from pmr.simulation.modal import ModalForm
from pmr.simulation.native import march
from pmr.simulation.native import residual_inertia_step as kernel
from pmr.simulation.native.scheme import GeneralizedAlpha
from pmr.simulation.native.simd import aligned
from pmr.simulation.needs import needs_on
from pmr.simulation.start import InitialState
from pmr.simulation.stepping import Progress
from pmr.system.body import Trajectory

Array = NDArray[np.float64]


def follow(
    form: ModalForm,
    excitation: Excitation,
    take: Take,
    initial: InitialState | None = None,
    progress: Progress | None = None,
) -> Ended:
    """As `pmr.simulation.native.simulator.follow`, for a body that keeps the inertia of its residual part.

    The trajectory's `quasi_static` multipliers are those that outputs and energies take.  Errors as for
    `pmr.simulation.Simulator`; an InputError, too, if damping couples the modes, and if rows only push: their
    multipliers follow from second derivatives of the deformation, which jump where a row opens or closes.
    """
    body = form.body
    refuse("march", needs_on(body, excitation))
    stepping, t = excitation.stepping, excitation.times
    course, account = _sampled(form, excitation), balance.Account(body, stepping.steps)
    r, m, i, T = body.size, len(body.row_names), len(body.input_names), stepping.steps + 1
    record = kernel.Record(*(np.empty((min(march.BLOCK, T - 1) + 1, size)) for size in (r, r, m, m)))
    state = _state(InitialState.at_rest(r) if initial is None else initial, m, i)
    scheme = _scheme(GeneralizedAlpha(stepping.step, stepping.rho_inf))
    resting = scheme._replace(step=0.0, dq=0.0, dv=0.0, gain=1.0)

    def where(k: int) -> str:
        return f"march failed at step {k}, t = {t[k]:g} s, slider at {course.s[0, k]:g} m"

    def check(k: int, failed: int) -> None:
        if failed:
            raise SimulationError(f"{where(k)}: {_reason(body.row_names, failed)}")

    check(0, kernel.run(_system(form, resting), resting, state, course, record, 0, 1)[1])
    system = _system(form, scheme)

    def steps(first: int, last: int) -> None:
        part = kernel.Course(*(np.ascontiguousarray(one[:, first - 1 : last]) for one in course))
        reached, failed = kernel.run(system, scheme, state, part, record, 1, last - first + 1)
        check(first + reached - 1, failed)

    def taken(first: int, last: int) -> None:
        rows = slice(first - 1, last)
        p, v, z, multipliers = (array[: last - first + 1] for array in record)
        finite = np.isfinite(p).all(axis=1)
        if not finite.all():
            raise SimulationError(f"{where(first - 1 + int(np.argmin(finite)))}: not finite")
        found, f = Trajectory(t[rows], p, v, multipliers, course.s[0, rows], 0.0, z), course.f[0, rows]
        take(Block(first - 1, found, f, account.add(first - 1, found, f)))
        for array in record:
            array[0] = array[last - first]

    seconds = in_blocks(T, march.BLOCK, 1, steps, taken, progress)
    return Ended(seconds, account.surplus(course.f[0], float(t[1] - t[0]), float(course.s[0, 0]), "march"))


def central_differences(values: Array, step: float) -> Array:
    """Values, first and second differences, (3, T, ...), of samples (T + 2, ...) that begin and end a step outside."""
    first = (values[2:] - values[:-2]) / (2.0 * step)
    second = (values[2:] - 2.0 * values[1:-1] + values[:-2]) / step**2
    return np.stack([values[1:-1], first, second])


def _sampled(form: ModalForm, excitation: Excitation) -> kernel.Course:
    stepping, loads = excitation.stepping, in_order(excitation.loads, form.body.input_names)
    around = np.arange(-1, stepping.steps + 2) * stepping.step
    s = central_differences(np.asarray(excitation.path.value(around), float), stepping.step)
    s[0] = excitation.along(form.body.domain)
    f = np.column_stack([np.empty((len(around), 0)), *(load.value(around) for load in loads)])
    return kernel.Course(s, central_differences(f, stepping.step))


def _system(form: ModalForm, scheme: kernel.Scheme) -> kernel.System:
    body, tables = form.body, form.body.flexibility
    assert tables is not None and tables.inertia is not None
    if not form.classically_damped:
        allowed = "false is allowed: damping couples the modes, and so those kept with those left out"
        raise InputError("scene", "reduction.residual_inertia", True, allowed)
    pads = PPoly(np.diag(body.row_compliance)[None, None], np.array(body.domain))
    named = {"C": body.rows, "G": total(tables.rows, pads), "H": tables.inputs}
    ordered = [named.get(name) or getattr(tables.inertia, name) for name in kernel.TABLES]
    all_tables = side_by_side(*ordered)
    omega2, damping = form.omega2, np.diagonal(body.D)
    return kernel.System(
        breaks=all_tables.x,
        tables=aligned(all_tables.c.reshape(*all_tables.c.shape[:2], -1).swapaxes(0, 1)),
        omega2=aligned(omega2),
        damping=aligned(damping),
        inverse=1.0 / (1.0 + damping * scheme.dv + omega2 * scheme.dq),
        B=aligned(body.B.T),
        round_off=np.finfo(float).eps * np.abs(np.einsum("kmm->km", ordered[1](all_tables.x))).max(axis=0),
    )


def _scheme(method: GeneralizedAlpha) -> kernel.Scheme:
    h, gamma, beta = method.step, method.gamma, method.beta
    gain = (1.0 - method.alpha_f) / (1.0 - method.alpha_m)
    return kernel.Scheme(h, method.alpha_m, method.alpha_f, gamma, beta, gain, gamma * h * gain, beta * h**2 * gain)


def _state(start: InitialState, m: int, i: int) -> kernel.State:
    r = len(start.q)
    flat = aligned(np.zeros((3, m * (r + 6 * m + 3 * i))))
    return kernel.State(
        motion=aligned(np.stack([start.q, start.v, np.zeros(r), np.zeros(r)])),
        flat=flat,
        values=flat.reshape(3, m, -1),
        rates=aligned(np.zeros((2, m, r))),
        gains=aligned(np.zeros((3, m, m))),
        Z=aligned(np.zeros((4, m, r + 1))),
        small=aligned(np.zeros((m, m + 1))),
    )


def _reason(names: Sequence[str], failed: int) -> str:
    depend = ", ".join(names[:failed])
    return f"the rows {depend} can't tell there what holds the body (a slider on a support, or two in one place)"
