"""A hoist on a boom whose sections push, rub and bend in second order: at rest, and wound while it telescopes."""

from __future__ import annotations

import numpy as np
import plain_machines
import pytest

import pmr
from pmr.errors import SimulationError
from pmr.scene.hoist import OUTPUTS, ROPE_FORCE
from pmr.scene.signals import Constant
from pmr.simulation.excitation import Excitation
from pmr.simulation.native import systems
from pmr.simulation.native.form import SystemForm

QUICK = (
    "compare.against=[]",
    "section.mesh.elements=6",
    "time.end=1.6",
    "time.rho_inf=0.9",
    "frame.slewing.times=[0.2,6.0]",
    "section.joint.extension.times=[0.5,3.0]",
    "hoist.speed.times=[0.2,1.0,2.0,3.0]",
)
RINGS = [f"section.joint.{ring}.0." for ring in ("tail", "mouth")]
PUSHES, RUBS = ([ring + key for ring in RINGS] for key in ("unilateral=true", "friction=0.1"))
KINDS = {
    "held": [],
    "second order": ["frame.second_order=true"],
    "pushing": [*PUSHES, "frame.second_order=true"],
    "rubbing": [*PUSHES, *RUBS],
    "winch on a section": ["hoist.winch={section='base', at=[1.0, 0.0, 0.4]}", "hoist.offset=[0.1, 0.2]"],
}


def run_of(changes: list[str]) -> pmr.SystemTrajectory:
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
