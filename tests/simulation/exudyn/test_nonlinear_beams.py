"""Second order in a frame that moves, beside Exudyn's nonlinear beams in space (`soft_boom`)."""

from pathlib import Path

import numpy as np
import pytest
from soft_boom import Beam, hangs, slides_out

import pmr
from pmr import scene as scenes
from pmr.scene import Scene

HERE = Path(__file__).parent
BREADTH, DEPTH, WALL = 0.22, 0.32, 0.006  # m, of the mid-surface
AREA = 2.0 * (BREADTH + DEPTH) * WALL
SECOND_MOMENT = BREADTH * WALL * DEPTH**2 / 2.0 + WALL * DEPTH**3 / 6.0
SOFT, DENSITY, PAYLOAD = 1.05e10, 7850.0, 250.0


def tip_of(scene: Scene) -> np.ndarray:
    """How far it is off the axis, (T,) m."""
    body = scene.names[-1]
    return pmr.simulate(scene, pmr.reduce(scene).reduced).of("tip", body=body)[:, 0]


@pytest.mark.slow
def test_a_soft_box_that_slides_out_while_it_is_raised() -> None:
    """It bends by 2.5 % of what is out.  The cable stretches as steel does, the beam not at all."""
    found, first_order = (
        tip_of(scenes.load_any(HERE / "soft_boom.toml", [f"frame.second_order={which}"])) for which in ("true", "false")
    )
    scene = scenes.load_any(HERE / "soft_boom.toml")
    beam = Beam(6.0, 20.0 * SOFT * AREA, SOFT * SECOND_MOMENT, DENSITY * AREA, PAYLOAD)
    raised, out = scene.frame.angles[0], scene.extension(1)
    expected = slides_out(
        beam,
        6.0,
        lambda t: float(out.value(t)),
        lambda t: float(raised.value(t)),
        scene.time.end,
        scene.time.steps,
        scene.time.rho_inf,
    )
    size = np.sqrt(np.mean(expected**2))
    assert np.abs(expected).max() == pytest.approx(0.1146, rel=1e-3)
    assert np.sqrt(np.mean((found - expected) ** 2)) < 5e-4 * size
    assert np.sqrt(np.mean((first_order - expected) ** 2)) > 2e-2 * size


@pytest.mark.slow
@pytest.mark.parametrize("raised", [0.0, 30.0, 60.0, 80.0, -45.0])
@pytest.mark.parametrize("payload", [0.0, 300.0])
def test_an_inclined_cantilever_s_deflection(payload: float, raised: float) -> None:
    """Under its own weight, or with a mass at its tip, which to first order bend it by 5 % of its length."""
    length, g, heavy, angle = 6.0, 9.81, 50.0, np.deg2rad(raised)
    EI = np.cos(angle) * g * (heavy * length**3 / 8.0 + payload * length**2 / 3.0) / 0.05
    changes = [
        f"frame.luffing={raised}",
        f"sections.beam.body.profile.bending_stiffness={EI}",
        *([f"sections.beam.masses=[{{name='payload', on='tip', mass={payload}}}]"] if payload else []),
    ]
    found = tip_of(scenes.load_any(HERE / "inclined.toml", changes))[0]
    expected = hangs(Beam(length, 1e5 * EI, EI, heavy, payload), angle)
    assert found == pytest.approx(expected, rel=1e-2)
