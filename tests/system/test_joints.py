"""Places of pads of joints, and the keys of their friction."""

from __future__ import annotations

from dataclasses import replace

import pytest

from pmr.scene.joints import JointPads, PadPlaces, RingFriction
from pmr.system.contacts import Contact, Friction, Place, pad_at_mouth, pad_at_tail

TAIL = Contact("t", Place("inner", "w", 0.2))
MOUTH = Contact("m", Place("inner", "w", 0.3), None, -1.0, 1e-8, 1e-3)
PADS = pad_at_tail(TAIL, "outer", "e"), pad_at_mouth(MOUTH, "outer", "e", 5.0)


@pytest.mark.parametrize("s", [1.0, 2.5, 4.4])
def test_both_places_of_a_pad_are_one_place_of_the_boom(s: float) -> None:
    """Wherever the inner tail is: along the axis, x of the inner section and s are x of the outer one."""
    for contact in PADS:
        assert contact.outer is not None and (contact.inner.body, contact.outer.body) == ("inner", "outer")
        assert contact.inner.coordinate({"e": s}) + s == pytest.approx(float(contact.outer.coordinate({"e": s})))
    tail, mouth = PADS
    assert tail.inner.coordinate({"e": s}) == 0.2 and mouth.outer is not None and mouth.outer.at == 4.7
    assert (mouth.direction, mouth.compliance, mouth.clearance) == (-1.0, 1e-8, 1e-3)


FRICTION = {*RingFriction.model_fields}


@pytest.mark.parametrize("key", sorted(JointPads.model_fields.keys() - PadPlaces.model_fields.keys()))
def test_every_key_of_friction_changes_the_law_that_the_kernel_gets(key: str) -> None:
    ring = JointPads(at=0.2, friction=0.2, static_friction=0.3, stribeck_speed=0.05, shear_stiffness=1e7)
    changed = ring.with_keys(**{key: 1.1 * getattr(ring, key)})
    laws = [Friction.from_contacts([replace(TAIL, **pads.model_dump(include=FRICTION))]) for pads in (ring, changed)]
    numbers = [(law.laws.tolist(), law.stiffness.tolist()) for law in laws if law is not None]
    assert len(numbers) == 2 and numbers[0] != numbers[1]
