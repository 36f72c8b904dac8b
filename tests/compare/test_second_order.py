"""Where it is looked how much axial forces change a boom's stiffness."""

from __future__ import annotations

import numpy as np

import pmr
from pmr.compare.second_order import TIMES, stressed

SHORT = ["section.mesh.elements=8", "time.end=2.0", "time.step=1e-3", "frame.pivot=[0.0,0.0,0.0]", "frame.luffing=0.5"]
KINKED = "sections.fly.joint.extension={kind='ramp',times=[0.5,1.5],values=[0.6,2.6]}"


def test_a_kink_of_an_extension_is_no_load_that_lasts() -> None:
    """Both kinks fall on times that are looked at; the impulse would be 200 g for a step and buckle the boom."""
    scene = pmr.load_scene("boom_two", [*SHORT, KINKED])
    found = stressed(scene, {name: body.model for name, body in pmr.reduce(scene).bodies.items()})
    assert len(found.t) == TIMES - 2 and np.abs(np.subtract.outer(found.t, [0.5, 1.5])).min() > 1e-2
    assert found.factor > 100.0
