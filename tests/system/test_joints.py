from __future__ import annotations

from dataclasses import fields, replace

import pytest

from pmr.system.contacts import Contact, Joint, JointPad

TAIL, MOUTH = JointPad("t", "w", 0.2), JointPad("m", "w", 0.3, -1.0, 1e-8, 1e-3)
JOINT = Joint("inner", "outer", 4.0, 5.0, "e", (TAIL,), (MOUTH,))


@pytest.mark.parametrize("s", [1.0, 2.5, 4.4])
def test_both_places_of_a_pad_are_one_place_of_the_boom(s: float) -> None:
    """Wherever the inner tail is: along the axis, x of the inner section and s are x of the outer one."""
    for contact in JOINT.contacts:
        assert contact.outer is not None and (contact.inner.body, contact.outer.body) == ("inner", "outer")
        assert contact.inner.coordinate({"e": s}) + s == pytest.approx(float(contact.outer.coordinate({"e": s})))
    tail, mouth = JOINT.contacts
    assert tail.inner.coordinate({"e": s}) == 0.2 and mouth.outer is not None and mouth.outer.at == 4.7
    assert (mouth.direction, mouth.compliance, mouth.clearance) == (-1.0, 1e-8, 1e-3)


def test_a_contact_has_all_that_its_pad_has() -> None:
    pad = JointPad("p", "w", 0.2, -1.0, 1e-8, 1e-3, 0.1, 0.15, 2e7, 0.3, 0.02)
    for field in fields(JointPad):
        assert getattr(pad, field.name) != field.default  # else nobody would see that it is left out
    (contact,) = replace(JOINT, tail=(pad,), mouth=()).contacts
    for name in {field.name for field in fields(JointPad)} & {field.name for field in fields(Contact)}:
        assert getattr(contact, name) == getattr(pad, name), name
