"""Every law of the kernel's step beside the same in NumPy: contacts, friction, terms, damping that couples, energy."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from kernels import coupled, kernel_of, motions_of, rubbing, varying
from nested import Nested, reduced
from plain_step import Plain

from pmr import System
from pmr.files.arrays import Array
from pmr.kernel.state import Record, Settings, State

STEP, STEPS = 1e-3, 60
PUSHING = {"clearance": 2e-4, "compliance": 1e-7}


@cache
def boom(sections: int, **how: Any) -> System:
    return reduced(Nested(sections, elements=8, **how), 3)


def amplitudes(t: float, count: int) -> Array:
    return np.array([-0.9 * np.sin(9.0 * t), 0.7 * np.cos(5.0 * t), 3.0 * t, 2.0 + np.sin(7.0 * t)])[:count]


CASES = {
    "no contact": lambda: boom(1),
    "two bodies": lambda: boom(2),
    "three bodies": lambda: boom(3),
    "pads that push": lambda: boom(2, **PUSHING),
    "coupled damping": lambda: coupled(boom(2)),
    "coupled damping, pads that push": lambda: coupled(boom(2, **PUSHING)),
    "terms": lambda: varying(boom(2)),
    "terms, pads that push": lambda: varying(boom(2, **PUSHING)),
    "terms, coupled damping": lambda: varying(coupled(boom(2))),
    "friction that sticks": lambda: rubbing(boom(2), 3e6),
    "friction that slides": lambda: rubbing(boom(2), 3e7),
    "friction that falls": lambda: rubbing(boom(2), 3e7, 0.5),
    "friction, pads that push": lambda: rubbing(boom(2, **PUSHING), 3e7),
}


#: Both values of rho_inf, but for friction one, as NumPy takes a second for it.
BOTH = (1.0, 0.7)
DAMPED = {name: BOTH[1:] if "friction" in name else BOTH for name in CASES} | {"friction that slides": BOTH[:1]}


@pytest.mark.parametrize(
    ("make", "rho_inf"), [pytest.param(CASES[name], rho, id=f"{name}-{rho}") for name in CASES for rho in DAMPED[name]]
)
def test_each_step_is_that_of_plain_numpy(make: Callable[[], System], rho_inf: float) -> None:
    """Coordinates, forces, impulses, outputs, energy and work, to the round-off of a small matrix's condition."""
    system = make()
    kernel, forms = kernel_of(system)
    state, plain = State(kernel, Settings(STEP, rho_inf)), Plain(system, STEP, rho_inf)
    motions = motions_of(system, forms, kernel)
    paths = kernel.names("drivers")[: kernel.paths]

    def driven(t: float) -> tuple[Array, Array, Array, Array]:
        s = np.array([2.0 + 0.3 * (k + 1.0) * t for k in range(kernel.paths)])
        f = np.array([2e3 * np.sin((19.0 + 31.0 * k) * t + k) for k in range(kernel.inputs)])
        return s, f, amplitudes(t, kernel.terms), system.side_coordinates(dict(zip(paths, s, strict=True)))

    s, f, c, x = driven(0.0)
    state.start("rest", np.concatenate([s, f, c]))
    at_rest = np.zeros(plain.assembly.size)
    forces = state.multipliers.copy()
    a = np.linalg.solve(plain.M, plain.B @ f - plain.assembly.contact_rows(x).C.T @ forces)
    plain.begin(x, f, at_rest, at_rest, a, forces, s)
    assert state.energy[0] == pytest.approx(plain.energy[0], rel=1e-12)
    seen: dict[str, list[tuple[Array, Array]]] = {}
    for number in range(1, STEPS + 1):
        s, f, c, x = driven(STEP * number)
        state.step(np.concatenate([s, f, c]))
        plain.take(x, f, c, s)
        y, forces = state.outputs()
        expected = (
            plain.forces if plain.friction is None else plain.forces + plain.friction.cylinder_forces(plain.rubbed)
        )
        pairs = {
            "q": (motions @ state.z, plain.q),
            "v": (motions @ state.v, plain.v),
            "forces": (forces, expected),
            "friction": (state.friction.copy(), plain.rubbed),
            "y": (y, plain.outputs()),
            "stored": (state.energy[:1].copy(), plain.energy[:1].copy()),
            "work": (state.energy[1:].copy(), plain.energy[1:].copy()),
        }
        if kernel.pushing:
            pairs["impulses"] = (state.impulses.copy(), plain.impulses)
        for name, pair in pairs.items():
            seen.setdefault(name, []).append(pair)
    for name, series in seen.items():
        found, expected = (np.array(one) for one in zip(*series, strict=True))
        atol = (1e-9 if name in ("forces", "friction", "impulses") else 1e-11) * np.abs(expected).max(initial=0.0)
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=atol, err_msg=name)


def test_pads_open_and_close_in_what_is_compared() -> None:
    """Else the comparison would not say what happens to a contact that opens."""
    system = boom(2, **PUSHING)
    kernel, _ = kernel_of(system)
    state, opened = State(kernel, Settings(STEP, 0.7)), np.zeros(kernel.contacts, np.int64)
    state.start("rest", np.concatenate([[2.0], np.zeros(kernel.inputs)]))
    before = state.multipliers > 0.0
    for number in range(1, STEPS + 1):
        t = STEP * number
        f = [2e3 * np.sin((19.0 + 31.0 * k) * t + k) for k in range(kernel.inputs)]
        state.step(np.concatenate([[2.0 + 0.3 * t], f]))
        opened += before & (state.multipliers == 0.0)
        before = state.multipliers > 0.0
    assert opened.sum() >= 3


@pytest.mark.parametrize("make", ["terms, pads that push", "friction, pads that push"])
def test_work_is_that_of_the_parts_a_step_ends_with(make: str) -> None:
    """Steps that are taken back and made in more parts, beside the same parts from the outset."""
    kernel, _ = kernel_of(CASES[make]())
    t = STEP * np.arange(2 * STEPS + 1)[:, None] / 8.0
    forces = 2e3 * np.sin((19.0 + 31.0 * np.arange(kernel.inputs)) * t) * (t > 4.0 * STEP)
    u = np.hstack([np.full((len(t), kernel.paths), 2.0) + 0.3 * t, forces, np.ones((len(t), kernel.terms))])
    settings, records = Settings(STEP, 0.7, (1, 2, 4, 8), contact_omega=2e3, tolerance=2e-2), list[Record]()
    for is_given in (False, True):
        state, record = State(kernel, settings), Record(kernel, len(t) // 8)
        state.start("rest", u[0])
        state.advance_sampled(u, 8, record, parts=records[0].parts if is_given else None)
        records.append(record)
    assert np.any(np.diff(records[0].parts) > 0) and np.any(np.diff(records[0].parts) < 0)
    for what in ("z", "multipliers", "friction", "energy"):
        expected = records[1][what]
        np.testing.assert_allclose(records[0][what], expected, rtol=0.0, atol=1e-11 * np.abs(expected).max(initial=0.0))
