"""Energies and loads of a response whose boom has a hoist, beside the balance of energy and the rope's directions."""

import re

import hoists
import numpy as np
import pytest

from pmr import InputError, simulate_with_states
from pmr.compare.drives import hoist_part
from pmr.compare.forces import limits_part
from pmr.compare.responses import Simulation
from pmr.scene.hoist import HEIGHT, OUTPUTS, ROPE_FORCE


@pytest.fixture(scope="module")
def swinging() -> Simulation:
    """A payload that swings on a stiff cantilever whose winch is at its tail, without damping."""
    changes = {"time.end": 0.8, "hoist.swing": [0.5, 0.0], "hoist.EA": 1e8, "simulation.simulators": ["march"]}
    scene = hoists.cantilever(changes | {"body.material": {"young": 2.1e13, "density": 7850.0}})
    return simulate_with_states(scene, hoists.reduced(scene), ())


def test_energies_of_a_swing_keep_their_sum(swinging: Simulation) -> None:
    energy = swinging.response.energy
    fallen = 100.0 * hoists.G * 2.0 * (1.0 - np.cos(0.5))
    assert np.ptp(energy.external) == pytest.approx(fallen, rel=2e-3)  # the weight's work; the rope gives a little
    assert np.ptp(energy.total) < 1e-6 * np.abs(energy.external).max()


def test_loads_of_a_swing_are_the_pulls_of_its_rope(swinging: Simulation) -> None:
    run = swinging.run
    assert run is not None and run.hoist is not None
    force, angle = (run.hoist[:, k] for k in ([*OUTPUTS].index(ROPE_FORCE), 4))
    pulls = np.column_stack([force * (np.sin(angle) - 1.0), -force * np.cos(angle)])
    assert np.ptp(force) > 0.25 * force.max()
    np.testing.assert_allclose(swinging.loads[:, [0, 2]], pulls, rtol=0.0, atol=1e-4 * force.max())


def test_the_summary_has_the_weight_s_force_and_where_the_rope_is_slack() -> None:
    """A payload on two falls is thrown upwards and falls into its rope."""
    changes = {"time.end": 0.34, "hoist.falls": 2, "hoist.EA": 1e6, "hoist.velocity": [0.0, 0.0, 1.5]}
    scene = hoists.cantilever(changes | {"simulation.simulators": ["march"]})
    response = simulate_with_states(scene, hoists.reduced(scene), ()).response
    part, force = hoist_part(scene, response), response.other(ROPE_FORCE)
    figures, weight = part.figures["hoist"], 100.0 * hoists.G / 2.0
    assert figures["weight_force"] == pytest.approx(weight, rel=1e-12)
    assert figures["factor"] == pytest.approx(force.max() / weight, rel=1e-12) and figures["factor"] > 5.0
    assert figures["height"]["max"] == response.other(HEIGHT).max()
    slack, (span,) = response.t[force == 0.0], figures["slack"]
    assert slack[0] == pytest.approx(span["start"]) and slack[-1] == pytest.approx(span["end"] - 1e-3)
    assert span["snatch"] == pytest.approx(force.max())
    assert len(part.grave) == 1 and part.grave[0].startswith("the hoist rope is slack from ")


@pytest.mark.parametrize(
    "changes",
    [
        {"hoist.payload": 170.0, "hoist.hook": 5.0},
        {"hoist.swing": [0.1, 0.0]},
        {"hoist.hanging": 1.5, "hoist.velocity": [0.2, 0.0, 0.0]},
        {"hoist.falls": 2, "hoist.EA": 1e6},
    ],
)
def test_a_system_has_the_hoist_of_the_scene_that_it_is_simulated_under(changes: dict[str, object]) -> None:
    short = {"time.end": 0.02, "simulation.simulators": ["march"]}
    scene, other = hoists.cantilever(short), hoists.cantilever(short | changes)
    found, expected, before = (
        simulate_with_states(of, hoists.reduced(model), ()).response
        for of, model in ((other, scene), (other, other), (scene, scene))
    )
    sizes = np.abs(expected.others).max(axis=0) + 1e-6
    assert np.abs(expected.others - before.others).max() > 1e-2
    np.testing.assert_allclose(found.others / sizes, expected.others / sizes, rtol=0.0, atol=1e-9)
    with pytest.raises(InputError, match=r"hoist.on = 3.5: 'tip' is allowed, as in the model"):
        simulate_with_states(hoists.cantilever(short | {"hoist.on": 3.5}), hoists.reduced(scene), ())


RAMP = {"kind": "smooth_ramp", "times": [0.0, 2.0], "values": [0.0, 0.4]}
LENGTH = {"kind": "ramp", "times": [0.0, 1.0], "values": [8.0, 7.6]}


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"hoist.speed": {"kind": "constant", "amount": 0.4}}, "hoist.speed is 0.4 m/s"),
        ({"hoist.speed": {"kind": "constant", "amount": -0.1}}, "hoist.speed is -0.1 m/s"),
        ({"hoist.length": LENGTH, "hoist.hanging": None}, "the rate of hoist.length is -0.4 m/s"),
        ({"hoist.speed": {"kind": "constant", "amount": 0.4}, "hoist.velocity": [0.0, 0.0, 0.2]}, ""),
        ({"hoist.speed": RAMP}, ""),
    ],
)
def test_a_rope_that_jerks_its_payload_at_the_start_has_a_warning(changes: dict[str, object], key: str) -> None:
    """Two falls, a rigid boom and no damping: the force rises to the weight's with (v / 2) (k m)^(1/2) on top."""
    scene = hoists.cantilever(
        {"hoist.hanging": 2.0, "hoist.falls": 2, "hoist.EA": 2e5, "time.end": 0.2, "simulation.simulators": ["march"]}
        | changes
    )
    response = simulate_with_states(scene, hoists.reduced(scene), ()).response
    part = hoist_part(scene, response)
    if not key:
        assert not part.warnings and part.figures["hoist"]["factor"] < 1.5
        return
    (line,) = part.warnings
    figures = re.match(rf"{re.escape(key)} at t = 0, but .* up to ([0-9.]+) times the weight", line)
    assert figures is not None
    assert float(figures[1]) == pytest.approx(part.figures["hoist"]["factor"], rel=0.05)


@pytest.mark.parametrize(("height", "warns"), [(1.5, True), (2.5, False), (0.0, False)])
def test_a_hook_below_the_ground_has_a_warning_where_the_ground_is_known(height: float, warns: bool) -> None:
    """The payload falls freely until it is as fast as the rope that the winch lets out, and then sinks by 1 m/s."""
    speed = {"kind": "constant", "amount": -1.0}
    changes = {"hoist.hanging": 1.0, "hoist.speed": speed, "hoist.pivot_height": height, "time.end": 1.0}
    scene = hoists.cantilever(changes | {"hoist.EA": 1e8, "simulation.simulators": ["march"]})
    system = hoists.reduced(scene)
    response = simulate_with_states(scene, system, ()).response
    lines = limits_part(scene, system, response).grave
    if not warns:
        assert not lines
        return
    (line,) = lines
    figures = re.match(r"the hook is below the ground by up to ([0-9.]+) m at 1 s, first at ([0-9.]+) s: ", line)
    assert figures is not None
    assert float(figures[2]) == pytest.approx(0.5 + 0.5 / hoists.G, abs=2e-3)
    assert float(figures[1]) == pytest.approx(-response.other(HEIGHT).min(), rel=1e-2)
