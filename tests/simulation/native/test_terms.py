"""Terms that vary in time in the compiled loop, beside matrices that hold them, closed forms and SciPy.

A hoist on a boom whose sections push, rub and bend in second order: at rest, and wound while it telescopes.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import plain_machines
import pytest
import scipy.linalg
from nested import LENGTH, Nested, box, full, full_section, joints, reduced
from scipy.integrate import solve_ivp
from terms import TURN, axial, excitation, geometric_stiffness, masses, merged, turning, turning_frequencies

import pmr
from pmr import SimulationError, System
from pmr.files.arrays import Array
from pmr.scene.hoist import OUTPUTS, ROPE_FORCE
from pmr.scene.signals import Constant, Ramp, Sine
from pmr.simulation import Excitation, InitialState, TimeStepping
from pmr.simulation.native import systems
from pmr.simulation.native.form import SystemForm
from pmr.simulation.statics.equilibrium import buckling_factors
from pmr.system.assembly import Assembly
from pmr.system.contacts import Contact, Place
from pmr.system.states import SystemTrajectory
from pmr.system.terms import Term


def constant(**amplitudes: float) -> dict[str, Any]:
    return {name: Constant(amount=amplitude) for name, amplitude in amplitudes.items()}


def coupled(system: System) -> System:
    """With a damping that couples the modes."""

    def damped(body: Any) -> Any:
        n = body.size
        return replace(body, D=body.D + 20.0 * np.outer(np.ones(n), np.ones(n)), rayleigh=None)

    return replace(system, bodies={name: damped(body) for name, body in system.bodies.items()})


@pytest.mark.parametrize("rho_inf", [0.9, 1.0])
@pytest.mark.parametrize(
    "made",
    [
        pytest.param(lambda: reduced(Nested(3, elements=10), 3), id="sides"),
        pytest.param(lambda: reduced(Nested(1, elements=10), 3), id="tables"),
        pytest.param(lambda: reduced(Nested(2, elements=10, clearance=1e-4), 3), id="pushing"),
        pytest.param(lambda: coupled(reduced(Nested(2, elements=10), 3)), id="coupled"),
        pytest.param(lambda: coupled(reduced(Nested(2, elements=10, clearance=1e-4), 3)), id="coupled-pushing"),
        pytest.param(lambda: full(Nested(2, elements=6)), id="full"),
    ],
)
def test_constant_terms_are_as_matrices_that_hold_them(made: Callable[[], System], rho_inf: float) -> None:
    """Coordinates and forces, to what a step leaves of its terms' forces.

    Where contacts push, steps have the same parts: how many are found may hang on round-off, and so does when a pad
    that chatters lets go.
    """
    system, stepping = made(), TimeStepping(0.3, 1e-3, rho_inf, parts=4)
    terms = [*axial(system)[: len(system.bodies)]]
    for name, body in system.bodies.items():
        terms.append(Term(f"dashpot {name}", (name,), damping=np.diag(np.arange(1.0, body.size + 1.0))))
    system, c = replace(system, terms=tuple(terms)), {term.name: -0.9 + 0.4 * k for k, term in enumerate(terms)}
    alike = merged(system, c)
    found = systems.simulate(system, excitation(system, stepping, constant(**c)))
    expected = systems.simulate(alike, excitation(alike, stepping, {}))
    for name, motion in expected.bodies.items():
        for one, other in ((found.bodies[name].q, motion.q), (found.bodies[name].v, motion.v)):
            np.testing.assert_allclose(one, other, atol=1e-9 * np.abs(other).max())
    np.testing.assert_allclose(found.forces, expected.forces, atol=1e-9 * np.abs(expected.forces).max(initial=0.0))


def test_a_term_on_two_bodies_is_a_spring_between_them() -> None:
    """Beside a third contact of the same stiffness, as a cylinder between two tails makes one."""
    boom = Nested(2, elements=10)
    system, stepping, k = full(boom), TimeStepping(0.5, 1e-3, 0.9), 1e7
    at = [Place(name, "w", 0.5 * LENGTH) for name in ("1", "0")]
    sprung = replace(system, contacts=(*system.contacts, Contact("spring", *at, compliance=1.0 / k)))
    row = np.concatenate(
        [sign * np.asarray(system.bodies[p.body].C(p.at).toarray())[-1] for sign, p in zip((1, -1), at, strict=True)]
    )
    term = Term("spring", ("1", "0"), stiffness=np.outer(row, row))
    system = replace(system, terms=(term,))
    found = systems.simulate(system, excitation(system, stepping, constant(spring=k)))
    expected = systems.simulate(sprung, excitation(sprung, stepping, {}))
    assert len([*joints(boom)]) == 2  # tail and mouth, whose forces are compared
    np.testing.assert_allclose(found.forces, expected.forces[:, :2], atol=1e-8 * np.abs(expected.forces).max())


def still(system: System, stepping: TimeStepping, terms: dict[str, Any]) -> Excitation:
    """Nothing travels, nothing pushes."""
    loads = {name: Constant(amount=0.0) for name in system.input_names}
    return Excitation({}, loads, stepping, terms=terms)


@pytest.mark.slow
def test_a_frame_that_turns_keeps_the_energy_of_a_mass_on_springs() -> None:
    """And the mass moves as the exponential of its equations says, to second order in the step."""
    m, k, W = 2.0, (50.0, 80.0), 1.5
    system = turning(m, k)
    start = {"mass": InitialState(np.array([0.1, 0.0]), np.array([0.0, 0.3]))}
    errors = []
    for h in (0.02, 0.01):
        driven = still(system, TimeStepping(20.0, h, 1.0), constant(turning=W, spin=W**2))
        motion = systems.simulate(system, driven, start)
        q, v = motion.bodies["mass"].q, motion.bodies["mass"].v
        energy = (m * v**2).sum(axis=1) / 2.0 + ((np.array(k) - m * W**2) * q**2).sum(axis=1) / 2.0
        np.testing.assert_allclose(energy, energy[0], rtol=1e-8)
        A = np.block([[np.zeros((2, 2)), np.eye(2)], [W**2 * np.eye(2) - np.diag(k) / m, -2.0 * W * TURN]])
        exact = scipy.linalg.expm(20.0 * A) @ np.concatenate([q[0], v[0]])
        errors.append(np.abs(q[-1] - exact[:2]).max())
        balance = motion.energy - motion.work
        np.testing.assert_allclose(balance, balance[0], rtol=1e-8)
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)


def test_a_turning_frame_parts_the_frequencies() -> None:
    """The closed form, below and beyond a crossing; without terms those of the springs; 0 Hz where spin buckles."""
    m, k = 2.0, (50.0, 80.0)
    assembly = Assembly(turning(m, k))
    for W in (0.0, 0.5, 3.0):
        found = assembly.frequencies(np.zeros(0), 2, np.array([W, W**2]))
        np.testing.assert_allclose(found, turning_frequencies(m, k, W), rtol=1e-12)
    np.testing.assert_allclose(assembly.frequencies(np.zeros(0), 2), np.sqrt(np.array(k) / m) / (2.0 * np.pi))
    assert assembly.frequencies(np.zeros(0), 2, np.array([0.0, 25.0]))[0] < 1e-7


@pytest.mark.slow
def test_terms_that_vary_are_followed_to_second_order() -> None:
    """Mathieu's equation for two masses, with a dashpot that comes and goes, beside SciPy's Runge-Kutta of order 8."""
    rng = np.random.default_rng(3)
    K = np.diag([30.0, 90.0])
    G, V = (0.3 * (A + A.T) for A in rng.normal(size=(2, 2, 2)) * [[[10.0]], [[1.0]]])
    terms = (Term("stiffness", ("",), stiffness=G), Term("dashpot", ("",), damping=V))
    system = System({"": masses(np.eye(2), K)}, (), terms=terms)
    signals = {"stiffness": Sine(amplitude=1.0, frequency=1.3), "dashpot": Sine(amplitude=1.0, frequency=0.4)}
    start = InitialState(np.array([0.1, -0.05]), np.array([0.0, 0.2]))

    def rate(t: float, x: Array) -> Array:
        c, d = (float(signals[name].value(t)) for name in ("stiffness", "dashpot"))
        return np.concatenate([x[2:], -(K + c * G) @ x[:2] - d * V @ x[2:]])

    exact = solve_ivp(rate, (0.0, 5.0), np.concatenate([start.q, start.v]), "DOP853", rtol=1e-11, atol=1e-13).y[:2, -1]
    for rho_inf in (0.8, 1.0):
        errors, open_ends = [], []
        for h in (0.01, 0.005):
            motion = systems.simulate(system, still(system, TimeStepping(5.0, h, rho_inf), signals), {"": start})
            errors.append(np.abs(motion.bodies[""].q[-1] - exact).max())
            left = motion.energy - motion.work
            open_ends.append(np.abs(left - left[0]).max() / motion.energy.max())
        assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.15)
        # the trapezoidal rule closes the balance, but for what a step leaves of its terms' forces
        assert open_ends[0] / open_ends[1] > 3.0 if rho_inf < 1.0 else open_ends[1] < 1e-8


def column(elements: int = 16) -> tuple[System, float]:
    """A box between two hinges that do not give way, without damping; its buckling load in N."""
    one = box(1, False, elements)
    body = replace(full_section(one), D=0.0 * full_section(one).D)
    contacts = tuple(Contact(name, Place("1", "w", x)) for name, x in (("foot", 0.0), ("head", LENGTH)))
    term = Term(
        "tension", ("1",), stiffness=geometric_stiffness(np.linspace(0.0, LENGTH, elements + 1), np.ones(elements))
    )
    free = np.setdiff1d(np.arange(body.size), [0, body.size - 2])
    K, G = body.K.toarray()[np.ix_(free, free)], term.stiffness[np.ix_(free, free)]
    load = 1.0 / scipy.linalg.eigh(G, K, eigvals_only=True)[-1]
    assert load == pytest.approx(np.pi**2 * one.bending_stiffness / LENGTH**2, rel=1e-4)
    return System({"1": body}, contacts, terms=(term,)), load


@pytest.mark.slow
def test_a_column_at_nine_tenths_of_its_buckling_load_is_stable() -> None:
    """Over 1e5 steps, with no damping at all; its frequency is sqrt(1 - 0.9) of the unloaded one."""
    system, load = column()
    assembly, x = Assembly(system), system.side_coordinates({})
    unloaded, loaded = (assembly.frequencies(x, 1, np.array([-share * load]))[0] for share in (0.0, 0.9))
    assert loaded == pytest.approx(np.sqrt(0.1) * unloaded, rel=1e-4)
    h, count = 1.0 / (40.0 * loaded), 100_000
    shape = np.sin(np.pi * np.linspace(0.0, 1.0, 17))
    slope = np.pi / LENGTH * np.cos(np.pi * np.linspace(0.0, 1.0, 17))
    start = InitialState(np.stack([shape, slope], axis=1).ravel() * 1e-3, np.zeros(34))
    start.q[-2] = 0.0
    driven = still(system, TimeStepping(count * h, h, 1.0), constant(tension=-0.9 * load))
    motion = systems.simulate(system, driven, {"1": start})
    middle = motion.bodies["1"].q[:, 16]
    assert np.abs(middle).max() < 1.001e-3 and np.abs(middle[-80:]).max() > 0.999e-3
    crossings = np.flatnonzero(np.diff(np.sign(middle)) != 0)
    assert len(crossings) / 2.0 / (count * h) == pytest.approx(loaded, rel=3e-3)  # of which the step's period is 2e-3
    left = motion.energy - motion.work
    assert np.abs(left - left[0]).max() < 0.02 * motion.energy.max()


@pytest.mark.slow
def test_sections_on_pads_that_push_are_stable_at_nine_tenths_of_their_buckling_load() -> None:
    """That of the longest extension, every pad closed: the boom swings on, slower than without, and pads let go."""
    system = full(Nested(2, elements=6, clearance=0.0))
    size = system.bodies["1"].size
    axial_force = geometric_stiffness(np.linspace(0.0, LENGTH, size // 2), np.ones(size // 2 - 1))
    system = replace(system, terms=(Term("tension", ("1",), stiffness=axial_force),))
    stepping = TimeStepping(6.0, 2e-3, 1.0)
    driven = excitation(system, stepping, constant(tension=0.0))
    long = system.side_coordinates({name: path[-1] for name, path in zip(driven.paths, driven.s.T, strict=True)})
    load = buckling_factors(Assembly(system), long, {"tension": -1.0})[0]
    tips = []
    for share in (0.0, 0.9):
        motion = systems.simulate(system, replace(driven, terms=constant(tension=-share * load)))
        assert (motion.forces.min(axis=1) == 0.0).mean() > 0.5  # of two pads across each other one is open
        tips.append(motion.bodies["1"].q[len(motion.t) // 6 :, -2])
        first, last = np.array_split(np.abs(tips[-1] - tips[-1].mean()), 2)
        assert last.max() < 1.05 * first.max()
    assert np.ptp(tips[1]) > 1.5 * np.ptp(tips[0])


@pytest.mark.slow
def test_beyond_the_buckling_load_nothing_grows_in_silence() -> None:
    """The motion overflows, or its terms no longer converge."""
    system, load = column(8)
    start = InitialState(np.zeros(18), np.full(18, 1e-3))
    start.v[[0, -2]] = 0.0
    driven = still(system, TimeStepping(40.0, 0.02, 0.9), constant(tension=-3.0 * load))
    with pytest.raises(SimulationError, match="tension do not converge|not finite|overflows|grows"):
        systems.simulate(system, driven, {"1": start})


@pytest.mark.parametrize("share", [30.0, 100.0, 300.0])
def test_a_tension_of_any_size_is_as_the_matrix_that_holds_it(share: float) -> None:
    """A string of so many times the buckling load, at a step that is long for what the tension makes of its modes."""
    system, load = column(8)
    start = InitialState(np.zeros(18), np.full(18, 1e-3))
    start.v[[0, -2]] = 0.0
    driven = still(system, TimeStepping(2.0, 0.1, 0.9), constant(tension=share * load))
    found = systems.simulate(system, driven, {"1": start}).bodies["1"].q
    whole = merged(system, {"tension": share * load})
    expected = systems.simulate(whole, replace(driven, terms={}), {"1": start}).bodies["1"].q
    np.testing.assert_allclose(found, expected, atol=1e-7 * np.abs(expected).max())


def test_equilibrium_knows_terms() -> None:
    """A start in equilibrium stays where it is while amplitudes stay."""
    system = reduced(Nested(2, elements=10), 3)
    system = replace(system, terms=axial(system))
    amplitudes = constant(**{name: -0.7 for name in system.term_names})
    driven = excitation(system, TimeStepping(0.09, 1e-3, 0.9), amplitudes)  # until the sections begin to extend
    start = systems.static_start(system, driven)
    motion: SystemTrajectory = systems.simulate(system, driven, start)
    for name, body in motion.bodies.items():
        np.testing.assert_allclose(body.q, np.tile(start[name].q, (len(body.q), 1)), atol=1e-9 * np.abs(body.q).max())
    without = systems.static_start(replace(system, terms=()), replace(driven, terms={}))
    assert np.abs(start["1"].q - without["1"].q).max() > 0.05 * np.abs(start["1"].q).max()


def test_amplitudes_are_taken_at_parts_of_steps() -> None:
    """A tension that rises within a step acts on contacts that push as in steps as short as the parts."""
    system = reduced(Nested(2, elements=10, clearance=1e-4), 3)
    system = replace(system, terms=axial(system)[:2])
    signals = {name: Ramp(times=(0.0, 0.2), values=(0.0, -0.9)) for name in system.term_names}
    coarse = excitation(system, TimeStepping(0.2, 4e-3, 0.9, parts=8), signals)
    fine = excitation(system, TimeStepping(0.2, 1e-3, 0.9, parts=2), signals)
    found, expected = (systems.simulate(system, one) for one in (coarse, fine))
    np.testing.assert_allclose(found.forces, expected.forces[::4], atol=1e-7 * np.abs(expected.forces).max())


QUICK = (
    "compare.against=[]", "section.mesh.elements=6", "time.end=1.6", "time.rho_inf=0.9",
    "frame.slewing.times=[0.2,6.0]", "section.joint.extension.times=[0.5,3.0]", "hoist.speed.times=[0.2,1.0,2.0,3.0]",
)  # fmt: skip

RINGS = [f"section.joint.{ring}.0." for ring in ("tail", "mouth")]

PUSHES, RUBS = ([ring + key for ring in RINGS] for key in ("unilateral=true", "friction=0.1"))

KINDS = {
    "held": [],
    "second order": ["frame.second_order=true"],
    "pushing": [*PUSHES, "frame.second_order=true"],
    "rubbing": [*PUSHES, *RUBS],
    "winch on a section": ["hoist.winch={section='base', at=[1.0, 0.0, 0.4]}", "hoist.offset=[0.1, 0.2]"],
}


def run_of(changes: list[str]) -> SystemTrajectory:
    scene = pmr.load_scene(plain_machines.HOIST, [*QUICK, *changes])
    return systems.simulate_form(SystemForm.of(pmr.reduce(scene).system), Excitation.from_scene(scene))


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_boom_begins_at_rest_and_its_energy_closes(kind: str) -> None:
    run = run_of(KINDS[kind])
    assert run.hoist is not None
    force = run.hoist[:, [*OUTPUTS].index(ROPE_FORCE)]
    np.testing.assert_allclose(force[:50], 450.0 * 9.80665 / 2.0, rtol=1e-9)
    assert np.ptp(force) > 30.0 and np.ptp(run.hoist[:, 3]) > 0.1  # it is wound
    assert run.surplus < 1e-6


@pytest.mark.slow
def test_a_hook_that_reaches_its_head_ends_the_run() -> None:
    scene = pmr.load_scene(plain_machines.HOIST, [*QUICK, "hoist.EA=2e5", "hoist.hanging=1.0", "hoist.speed=0.0"])
    scene = scene.model_copy(update={"hoist": scene.hoist.model_copy(update={"speed": Constant(amount=2.0)})})
    with pytest.raises(SimulationError, match="the hook is at its head sheaves: its rope is too short"):
        systems.simulate_form(SystemForm.of(pmr.reduce(scene).system), Excitation.from_scene(scene))
