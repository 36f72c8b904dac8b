"""A payload on the rope of a stiff boom beside a mass point of Exudyn on a spring of the rope's stiffness."""

from typing import Any

import exudyn as exu
import numpy as np
import pytest
from exudyn.utilities import SensorBody
from hoists import REACH, G, cantilever, reduced, simulate

from pmr.scene.hoist import OUTPUTS, PLACES

STEP, SPAN, EA, HANGING = 1e-3, 3.0, 1e6, 2.0
#: Angles along and across the boom at the start, and the velocity of the payload: in a plane, a cone, and neither.
STARTS: dict[str, tuple[list[float], list[float]]] = {
    "planar": ([0.8, 0.0], [0.0, 0.0, 0.0]),
    "conical": ([0.5, 0.0], [0.0, float(np.sqrt(G * HANGING * np.sin(0.5) * np.tan(0.5))), 0.0]),
    "wild": ([0.9, -0.4], [0.5, 1.5, -0.39]),
}


def swing_in_exudyn(place: list[float], velocity: list[float]) -> Any:
    """Places (T, 3) of a mass of 100 kg on a rope from the head of the boom, at the steps."""
    mbs = (container := exu.SystemContainer()).AddSystem()
    ground = mbs.CreateGround(referencePosition=[REACH, 0.0, 0.0])
    mass = mbs.CreateMassPoint(
        referencePosition=place, initialVelocity=velocity, physicsMass=100.0, gravity=[0.0, 0.0, -G]
    )
    stiffness = EA / (HANGING + REACH)
    mbs.CreateSpringDamper(itemNumbers=[ground, mass], referenceLength=HANGING, stiffness=stiffness)
    variable = exu.OutputVariableType.Position
    sensor = mbs.AddSensor(SensorBody(bodyNumber=mass, storeInternal=True, outputVariableType=variable))
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.timeIntegration.numberOfSteps, settings.timeIntegration.endTime = round(SPAN / STEP), SPAN
    settings.timeIntegration.generalizedAlpha.spectralRadius = 0.9
    settings.timeIntegration.newton.relativeTolerance = 1e-10
    settings.solution.sensors.writePeriod = STEP
    settings.solution.file.write = False
    settings.timeIntegration.verboseMode = 0
    mbs.SolveDynamic(settings)
    stored = mbs.GetSensorStoredData(sensor)
    del container
    return stored[:, 1:]


@pytest.mark.slow
@pytest.mark.parametrize("start", STARTS)
def test_a_payload_swings_as_in_exudyn(start: str) -> None:
    swing, velocity = STARTS[start]
    changes = {"hoist.EA": EA, "hoist.swing": swing, "hoist.velocity": velocity, "time.end": SPAN, "time.rho_inf": 0.9}
    scene = cantilever(changes)
    run = simulate(reduced(scene), scene)
    assert run.hoist is not None
    places = run.hoist[:, [[*OUTPUTS].index(name) for name in PLACES]]
    beside = swing_in_exudyn(places[0].tolist(), velocity)
    assert np.abs(beside - beside[0]).max() > 1.0
    np.testing.assert_allclose(places, beside[-len(places) :], rtol=0.0, atol=1e-5 * HANGING)
