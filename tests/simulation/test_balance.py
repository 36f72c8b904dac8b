"""Where a motion's energy comes from: what neither loads nor moving rows put in is growth, in every simulator."""

from collections.abc import Callable
from functools import partial

import numpy as np
import one_body
import pytest
from driving import driven
from generalized_alpha import GeneralizedAlpha
from one_body import Simulate
from oracle import enriched, flexible, full_body

from pmr import SimulationError
from pmr.scene.signals import Constant, Ramp, Sine
from pmr.simulation import InitialState, TimeStepping
from pmr.simulation.stepping import GROWN, NOTABLE, energy_surplus
from pmr.system.body import FullBody

FAST = Ramp(times=(0.05, 0.6, 1.15), values=(0.7, 4.2, 0.7))
SLOWER = Ramp(times=(0.05, 1.0, 1.95), values=(0.7, 4.2, 0.7))
LOAD = Sine(amplitude=50.0, frequency=2.0)
SIMULATORS = {
    "march": one_body.simulate,
    **{
        f"exudyn-{way}": partial(one_body.in_exudyn, formulation=way) for way in ("springs", "multipliers", "callbacks")
    },
}


@pytest.fixture(scope="module")
def beam() -> FullBody:
    return full_body(elements=16)


@pytest.fixture(params=SIMULATORS)
def simulator(request: pytest.FixtureRequest) -> Simulate:
    return SIMULATORS[request.param]


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9, 0.99])
def test_a_rigid_rows_multiplier_has_a_triple_root_at_minus_rho(rho: float) -> None:
    """Held at rest, row and scheme alone: what lets it grow as soon as the row turns from step to step."""
    method = GeneralizedAlpha(1.0, rho)
    a_m, a_f, beta, gamma = method.alpha_m, method.alpha_f, method.beta, method.gamma
    # d = 0 at both ends of a step, rate v, acceleration-like a, force per mass b: what (v, a, b) becomes
    a_new = np.array([-1.0, beta - 0.5, 0.0]) / beta
    v_new = np.array([1.0, 1.0 - gamma, 0.0]) + gamma * a_new
    b_new = ((1.0 - a_m) * a_new + np.array([0.0, a_m, -a_f])) / (1.0 - a_f)
    step = np.array([v_new, a_new, b_new])
    np.testing.assert_allclose(np.poly(step), np.poly([-rho] * 3), atol=1e-12)
    if rho:  # one eigenvector: a disturbance lives for n^2 rho^n, and a disturbed root moves by up to its cube root
        assert np.linalg.matrix_rank(step + rho * np.eye(3), tol=1e-9) == 2


@pytest.mark.slow
def test_growth_is_an_error_in_every_simulator(beam: FullBody, simulator: Simulate) -> None:
    """Exudyn's Newton method may give up before the end is reached."""
    with pytest.raises(SimulationError, match=r"(grows without bound.*rigid row slider.* moves|not converge).*rho_inf"):
        simulator(beam, driven(FAST, LOAD, TimeStepping(1.2, 1e-3, 0.999)))


@pytest.mark.slow
def test_what_is_right_passes_in_every_simulator(beam: FullBody, simulator: Simulate) -> None:
    found = simulator(beam, driven(SLOWER, LOAD, TimeStepping(2.0, 1e-3, 0.9)))
    assert 0.0 <= found.surplus < 0.1 * NOTABLE


def test_between_the_two_it_is_notable(beam: FullBody) -> None:
    """With rho_inf = 0.9 too, on a fast path: 29 % of the energy from nowhere before the displacements show it."""
    found = one_body.simulate(beam, driven(FAST, LOAD, TimeStepping(1.2, 1e-3, 0.9)))
    sound = one_body.simulate(flexible(beam, 12), driven(FAST, LOAD, TimeStepping(1.2, 1e-3, 0.9)))
    assert NOTABLE < found.surplus < GROWN
    assert sound.surplus < 0.1 * NOTABLE


def test_a_row_that_gives_way_does_not_grow(beam: FullBody) -> None:
    """The same path and rho_inf, without a multiplier of index 3."""
    model = flexible(beam, 8)
    for simulate in (one_body.simulate, one_body.in_exudyn):
        assert simulate(model, driven(FAST, LOAD, TimeStepping(1.2, 1e-3, 0.999))).surplus < 0.02 * NOTABLE


@pytest.mark.parametrize("of", [flexible, enriched, lambda beam, count: beam], ids=["flexible", "inertial", "full"])
def test_the_balance_closes_with_the_step(beam: FullBody, of: Callable) -> None:
    """Second order: energy, work of loads and work of the row are those of one motion, signs included."""
    smooth = Sine(amplitude=1.2, frequency=1.0, offset=2.4)
    body, steps = of(beam, 8), (4e-3, 1e-3)
    found = [one_body.simulate(body, driven(smooth, LOAD, TimeStepping(1.0, h, 0.8))).surplus for h in steps]
    assert found[0] < 0.02
    assert found[1] < found[0] / 8.0


def test_an_initial_deformation_has_its_energy(beam: FullBody) -> None:
    model = flexible(beam, 8)
    start = InitialState(np.eye(model.size)[2] * 0.1, np.zeros(model.size))
    found = one_body.simulate(
        model, driven(Constant(amount=2.0), Constant(amount=0.0), TimeStepping(1.0, 1e-3, 0.9)), start
    )
    assert found.surplus < 1e-3


@pytest.mark.parametrize(
    ("stored", "work", "expected"),
    [
        ([0.0, 1.0, 2.0], [0.0, 1.0, 2.0], 0.0),
        ([0.0, 1.0, 2.0], [0.0, 1.0, 1.0], 0.5),
        ([4.0, 2.0, 3.0], [0.0, 0.0, 0.0], 0.25),  # lost two, and one came back from nowhere
        ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0], 0.0),
        ([0.0, 1e200, np.inf], [0.0, 0.0, 0.0], np.inf),
        ([0.0, 1.0, np.nan], [0.0, 0.0, 0.0], np.inf),
    ],
)
def test_surplus(stored: list[float], work: list[float], expected: float) -> None:
    assert energy_surplus(np.array(stored), np.array(work)) == expected


def test_round_off_has_no_source(beam: FullBody) -> None:
    assert energy_surplus(np.array([0.0, 1e-30]), np.zeros(2), least=1e-20) == 0.0
    at = full_body(elements=16)
    found = one_body.simulate(flexible(at, 8), driven(Constant(amount=5.0), LOAD, TimeStepping(0.5, 1e-3, 0.9)))
    assert np.abs(found.q).max() < 1e-12  # the slider stands under the load
    assert found.surplus == 0.0


def test_rows_that_open_and_close_are_measured_from_the_start() -> None:
    stored, work = np.array([4.0, 2.0, 3.0]), np.zeros(3)
    assert energy_surplus(stored, work, since_start=True) == 0.0
