"""Derivatives of a step and of its outputs beside differences of steps."""

from collections.abc import Callable

import numpy as np
import pytest
from kernels import coupled, kernel_of, linearize, rubbing, varying
from nested import Nested, reduced

from pmr import System
from pmr.files.arrays import Array
from pmr.kernel.state import Settings, State

CASES = {
    "two bodies": lambda: reduced(Nested(2, elements=8), 3),
    "three bodies": lambda: reduced(Nested(3, elements=8), 3),
    "pads that push": lambda: reduced(Nested(2, elements=8, clearance=1e-5, compliance=1e-7), 3),
    "coupled damping": lambda: coupled(reduced(Nested(2, elements=8), 3)),
    "terms": lambda: varying(reduced(Nested(2, elements=8), 3)),
    "terms, pads that push": lambda: varying(reduced(Nested(2, elements=8, clearance=1e-5, compliance=1e-7), 3)),
    "friction that sticks": lambda: rubbing(reduced(Nested(2, elements=8), 3), 3e5),
    "friction that slides": lambda: rubbing(reduced(Nested(2, elements=8), 3), 3e8),
    "friction that falls": lambda: rubbing(reduced(Nested(2, elements=8), 3), 3e8, 0.5),
    "friction, terms": lambda: varying(rubbing(reduced(Nested(3, elements=8), 3), 3e6)),
}
#: What differences, the error of which is of fourth order, differ by from derivatives, over the largest one.
WITHIN = 1e-7
#: Of outputs and forces, in a difference of them.
ROUND_OFF = 1e-12


def drivers(of: State, t: float) -> Array:
    kernel = of.kernel
    s = [2.0 + 0.1 * k + 0.3 * t for k in range(kernel.paths)]
    f = [2e3 * np.sin(20.0 * t + k) for k in range(kernel.inputs)]
    c = [-0.5, 0.4, 2.0, 1.0, 0.3, 0.2][: kernel.terms]
    return np.array([*s, *f, *c])


@pytest.mark.parametrize("make", CASES.values(), ids=list(CASES))
def test_derivatives_are_those_of_differences(make: Callable[[], System]) -> None:
    """A state is moved by changes of u in the step before, so that no prediction has to be set by hand."""
    system = make()
    kernel, _ = kernel_of(system)
    state = State(kernel, Settings(1e-3, 0.8))
    state.start("equilibrium", drivers(state, 0.0))
    for n in range(1, 6):
        state.step(drivers(state, 1e-3 * n))
    start = state.save()
    u, before = drivers(state, 7e-3), drivers(state, 6e-3)
    state.step(before)
    jacobian, at = linearize(state, u), state.save()
    first = state_before(state, start, before)

    def ended(changed: Array, last: Array) -> tuple[Array, Array]:
        """Outputs and multipliers after steps to these drivers."""
        state.restore(start)
        state.step(changed)
        state.step(last)
        return state.outputs()[0], state.multipliers.copy()

    sizes = [np.abs(values).max(initial=0.0) for values in ended(before, u)]
    moved = 2e-6 if any(contact.static_friction for contact in system.contacts) else 1e-4  # m: of speeds, d / h counts
    for k in range(kernel.drivers):
        d = np.zeros(kernel.drivers)
        d[k] = moved if k < kernel.paths else 10.0 if k < kernel.paths + kernel.inputs else 5e-2
        compared = [(jacobian.D[:, k], jacobian.K[:, k], lambda d: ended(before, u + d))]
        if not kernel.pads:  # what these remember of the step before is no coordinate
            through = first.B[:, k]  # what the step before makes of its own drivers
            compared.append((jacobian.C @ through, jacobian.L @ through, lambda d: ended(before + d, u)))
        for of_outputs, of_forces, after in compared:
            for found, expected, size in zip((of_outputs, of_forces), differences(after, d), sizes, strict=True):
                round_off = ROUND_OFF * size / np.abs(d).max()
                atol = WITHIN * np.abs(expected).max(initial=0.0) + round_off
                np.testing.assert_allclose(found, expected, rtol=0.0, atol=atol)
    state.restore(at)
    assert state.save() == at


def differences(after: Callable[[Array], tuple[Array, Array]], d: Array) -> list[Array]:
    """Derivatives of what is so after a change d, by Richardson's extrapolation of central differences."""
    size = 2.0 * np.abs(d).max()
    coarse, fine = (
        [(a - b) / (x * size) for a, b in zip(after(x * d), after(-x * d), strict=True)] for x in (1.0, 0.5)
    )
    return [(4.0 * one - other) / 3.0 for one, other in zip(fine, coarse, strict=True)]


def state_before(state: State, start: bytes, u: Array):  # type: ignore[no-untyped-def]
    """Derivatives of the step before; the state is left where it stood."""
    here = state.save()
    state.restore(start)
    jacobian = linearize(state, u)
    assert state.save() == start
    state.restore(here)
    return jacobian


def test_two_steps_are_the_product_of_one_after_the_other() -> None:
    """A of a system that nothing moves is that of all its steps: its powers are those of the free motion."""
    kernel, _ = kernel_of(reduced(Nested(2, elements=8), 3))
    state = State(kernel, Settings(1e-3, 0.8))
    u = np.array([2.0, *np.zeros(kernel.inputs)])
    state.start("equilibrium", u)
    jacobian = linearize(state, u)
    push = np.zeros(kernel.drivers)
    push[-1] = 100.0
    state.step(u + push)
    x = jacobian.B @ push
    for _ in range(40):
        state.step(u)
        y = jacobian.C @ x
        x = jacobian.A @ x
        np.testing.assert_allclose(state.outputs()[0], y, atol=1e-9 * np.abs(y).max())
