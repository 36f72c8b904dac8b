"""The crane on a turret of Exudyn's own, whose angles are prescribed, beside the same scene in the compiled loop."""

from dataclasses import replace

import numpy as np
import plain_machines
import pytest
from turret import Turret

import pmr
from pmr import Response, System
from pmr import scene as scenes
from pmr.compare.evaluation import evaluate_motion
from pmr.compare.simulated import excitation_of_scene
from pmr.files.arrays import Array
from pmr.report.columns import body_axes
from pmr.scene import Scene
from pmr.scene.frame import INERTIA
from pmr.scene.signals import Table
from pmr.simulation.exudyn import simulate_system
from pmr.simulation.native.systems import start_of

pytestmark = pytest.mark.slow  # ten seconds each
CRANE = plain_machines.CRANE
#: Raised, slewed and drawn out at once, under its weight.
SHORT = (
    "section.mesh.elements=8",
    # long pads have few stations on their paths, and so few loads to answer
    *(f"section.joint.{ring}.0.{key}" for ring in ("tail", "mouth") for key in ("length=0.9", "at=0.45")),
    "section.reduction.estimate=false",
    "compare.against=[]",
    "simulation.simulators=['march', 'exudyn']",
    "simulation.repeats=1",
    "frame.pivot=[0.3, 0.1, -0.5]",
    "frame.luffing.times=[0.0, 1.0]",
    "frame.luffing.values=[10.0, 25.0]",
    "frame.slewing.times=[0.1, 1.0]",
    "frame.slewing.values=[0.0, 20.0]",
    "section.joint.extension.times=[0.05, 0.95]",
    "section.joint.extension.values=[0.6, 1.2]",
    "sections.fly.joint.extension.times=[0.0, 0.9]",
    "sections.fly.joint.extension.values=[0.6, 1.2]",
    "time.end=0.5",
    "time.step=4e-3",
)
ALLOWED = 1e-6  # m


class OnTurret:
    """The crane's sections on a turret at the times t (T,)."""

    def __init__(self, scene: Scene, t: Array) -> None:
        self._scene, self._t, self._turret = scene, t, Turret(*scene.frame.angles, t)

    def _along(self, number: int, what: str = "value") -> Array:
        """Of a section's tail along the boom, (T, 3)."""
        found = sum(getattr(self._scene.extension(k), what)(self._t) for k in range(1, number + 1))
        return np.outer(np.zeros_like(self._t) + found, [1.0, 0.0, 0.0])

    def acceleration(self, number: int, r: Array) -> Array:
        """Of a point (3,) m of a section at rest on the turret, (T, 3) m/s^2 in the boom's axes, weight included."""
        turret, place = self._turret, self._scene.frame.tail_position + self._along(number) + r
        swept = np.cross(turret.velocity, place) + 2.0 * self._along(number, "rate")
        weight = self._scene.gravity.signal.value(self._t)[:, None] * turret.rotation[:, 2]
        turned = np.cross(turret.acceleration, place) + np.cross(turret.velocity, swept)
        return weight + self._along(number, "second_rate") + turned

    def load(self, number: int, field: str) -> Table:
        """What replaces the amplitude of a field of a section: from the accelerations of its points."""
        own, e = self.acceleration(number, np.zeros(3)), np.eye(3)
        if len(field) == 2:
            own = self.acceleration(number, e["xyz".index(field[1])]) - own
        return Table(times=self._t, values=-own[:, "xyz".index(field[0])], interpolation="linear")

    def tip(self, tip: Array) -> Array:
        """Place (T, 3) m in space of the outermost tip, which is off the boom's axis by tip (T, 2) m."""
        last = len(self._scene.sections) - 1
        own = self._scene.frame.tail_position + self._along(last) + [self._scene.sections[last].length, 0.0, 0.0]
        own[:, 1:] += tip
        return np.einsum("tij,tj->ti", self._turret.rotation, own)


def on_turret(scene: Scene, system: System) -> Response:
    """Of the crane in Exudyn, under the inertia loads that Exudyn's own turret makes."""
    excitation = excitation_of_scene(scene, system)
    turret, loads = OnTurret(scene, excitation.times), dict(excitation.loads)
    for name in loads:
        body, _, field = name.partition("." + INERTIA)
        if field:
            loads[name] = turret.load(scene.names.index(body), field)
    driven = replace(excitation, loads=loads)
    return evaluate_motion(system, simulate_system(system, driven, start_of(system, driven)))


@pytest.mark.parametrize("second_order", [False, True])
def test_the_crane_on_a_prescribed_turret(second_order: bool) -> None:
    scene = scenes.load_any(CRANE, [*SHORT, f"frame.second_order={str(second_order).lower()}"])
    outcome = pmr.run(scene)
    result = outcome.result
    assert max(result.summary["agreement"].values()) < ALLOWED  # march and Exudyn, as the run says
    marched, found = result.responses["reduced"], on_turret(scene, outcome.system)
    moved = found.of("tip", body="fly")
    assert np.abs(moved - marched.of("tip", body="fly")).max() < ALLOWED < 1e-3 * np.abs(moved).max()
    # and where that is in space, beside the report's
    fly = body_axes(result, np.arange(len(marched.t)))[-1]
    place = OnTurret(scene, marched.t).tip(moved)
    assert np.abs(place[:, :2] - fly.plan[:, -1]).max() < ALLOWED
    assert np.abs(place[:, 2] - fly.side[:, -1, 1]).max() < ALLOWED
