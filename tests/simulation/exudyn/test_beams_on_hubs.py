"""A soft beam on rigid bodies that move freely, Exudyn's and a machine of `march`, beside Exudyn's nonlinear beams."""

import numpy as np
import pytest
from beam_on_hub import LENGTH, Hub, OfTime, Swing, as_cable, as_machine, as_reduced, scene_of

pytestmark = pytest.mark.slow  # some seconds each


def assert_near(found: Swing, expected: Swing) -> None:
    """Within 1 % of what cart, hub and tip do, the beam bent by 2 to 3 %."""
    assert 0.02 < np.abs(expected.deflection).max() / LENGTH < 0.03
    for one, other in zip(vars(found).values(), vars(expected).values(), strict=True):
        moved = other - other[0]
        assert np.sqrt(np.mean((one - other) ** 2)) <= 1e-2 * np.sqrt(np.mean(moved**2))


def smooth(amount: float, start: float) -> OfTime:
    """Of time: a push that comes and goes within a second."""
    return lambda t: amount * np.sin(np.pi * np.clip(t - start, 0.0, 1.0)) ** 2


def test_a_pendulum_on_a_free_cart() -> None:
    """The cart is pushed off, and the beam that hangs on it swings by half a radian."""
    hub = Hub(4e8, -np.pi / 2.0, 50.0, cart=400.0, push=smooth(4000.0, 0.5))
    scene = scene_of(hub, "time.end=2.0")
    expected = as_cable(hub, scene)
    assert_near(as_reduced(hub, scene), expected)
    assert_near(as_machine(hub, scene), expected)


def test_a_spin_up_by_a_torque() -> None:
    hub = Hub(2.1e9, 0.0, 200.0, cart=None, torque=smooth(3500.0, 0.0))
    scene = scene_of(hub, "time.end=1.5").model_copy(update={"gravity": None})
    expected = as_cable(hub, scene)
    assert_near(as_reduced(hub, scene), expected)
    assert_near(as_machine(hub, scene), expected)
