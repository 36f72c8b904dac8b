"""Where it is looked how much axial forces change a boom's stiffness."""

from __future__ import annotations

import numpy as np
import pytest

import pmr
from pmr.compare.moving_frame import STRESSED_TIMES, second_order_effect
from pmr.fullmodel.build import build_bodies
from pmr.scene.mechanism import stress_terms
from pmr.simulation.frame import term_signals
from pmr.simulation.statics.equilibrium import geometric_stiffness
from pmr.system.assembly import Assembly
from pmr.system.from_scene import system_of

SHORT = ["section.mesh.elements=8", "time.end=2.0", "time.step=1e-3", "frame.pivot=[0.0,0.0,0.0]", "frame.luffing=0.5"]
KINKED = "sections.fly.joint.extension={kind='ramp',times=[0.5,1.5],values=[0.6,2.6]}"


@pytest.mark.slow
def test_a_kink_of_an_extension_is_no_load_that_lasts() -> None:
    """Both kinks fall on times that are looked at; the impulse would be 200 g for a step and buckle the boom."""
    scene = pmr.load_scene("boom_two", [*SHORT, KINKED])
    found = second_order_effect(scene, {name: body.model for name, body in pmr.reduce(scene).bodies.items()})
    assert len(found.t) == STRESSED_TIMES - 2 and np.abs(np.subtract.outer(found.t, [0.5, 1.5])).min() > 1e-2
    assert found.least_factor > 100.0


@pytest.mark.slow
@pytest.mark.numerical
def test_what_pulls_at_the_tip_loads_every_cylinder_as_the_weight_of_a_payload_does() -> None:
    """An upright boom: 2,000 kg at its tip, or their weight along it, make the same stiffness of axial forces."""
    upright = ["section.mesh.elements=6", "time.end=0.01", "frame.second_order=true", "frame.pivot=[0.0,0.0,0.0]"]
    upright += [
        f"frame.luffing={np.pi / 2.0}",
        "sections.middle.joint.extension=2.0",
        "sections.fly.joint.extension=3.0",
    ]
    payload = "sections.fly.masses=[{{name='payload',on='tip',mass={}}}]"
    weight = "sections.fly.loads=[{{name='weight',on='tip',direction='x',signal={}}}]"
    stiffness = []
    for mass, force in ((2250.0, 0.0), (250.0, -2000.0 * 9.80665)):
        scene = pmr.load_scene("boom_three", [*upright, payload.format(mass), weight.format(force)])
        bodies = {name: built.model.gather() for name, built in build_bodies(scene).items()}
        assembly = Assembly(system_of(scene, bodies))
        c = {name: float(signal.value(0.0)) for name, signal in term_signals(scene, stress_terms(scene)).items()}
        stiffness.append(geometric_stiffness(assembly, c).toarray())
    np.testing.assert_allclose(*stiffness, rtol=0.0, atol=1e-9 * np.abs(stiffness[0]).max())
