"""Rings of pads as fewer contacts, beside all pads by themselves."""

from dataclasses import replace

import numpy as np
import plain_machines
import pytest

import pmr
from pmr import scene as scenes
from pmr.compare.simulated import excitation_of_scene
from pmr.scene.built import PadPlaces
from pmr.scene.joints import JointPads, RingFriction
from pmr.scene.keys import cylinder_name
from pmr.simulation import Excitation
from pmr.simulation.native import systems
from pmr.system.contacts import Contact, Friction, Place, pad_at_mouth, pad_at_tail
from pmr.system.from_scene import CombinedRings, combine_rings
from pmr.system.system import System

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


@pytest.mark.parametrize(
    ("name", "kind", "number"),
    [("drive", "cylinder", 1), (cylinder_name("fly"), "pad", 1), ("drive", "pad", -1)],
)
def test_friction_loads_the_cylinder_of_its_joint_by_its_kind_or_its_name(name: str, kind: str, number: int) -> None:
    """A contact that is made by hand may have any name; files of earlier versions have no kinds."""
    pad = Contact("pad", Place("fly", "top"), Place("base", "top", path="fly"), friction=0.2)
    drive = Contact(name, Place("fly", "tail x"), Place("base", "tail x"), compliance=1e-8, kind=kind)
    friction = Friction.from_contacts([pad, drive])
    assert friction is not None and friction.cylinders.tolist() == [number]
    assert friction.cylinder_forces(np.array([30.0])).tolist() == [0.0, 30.0 if number > 0 else 0.0]


CRANE = plain_machines.CRANE
#: With kinds of pads that differ in stiffness within a ring, and between its rings.
CHANGES = (
    "section.mesh.elements=6",
    "section.reduction.coordinates=8",
    "section.reduction.estimate=false",
    "frame.second_order=true",  # 'auto' would look for whether it matters
    "section.joint.tail.0.stiffness=2e8",
    "frame.luffing={kind='smooth_ramp', times=[0.0, 1.0], values=[10.0, 30.0]}",
    "section.joint.extension={kind='smooth_ramp', times=[0.1, 0.4], values=[0.6, 1.6]}",
    "sections.fly.joint.extension={kind='smooth_ramp', times=[0.1, 0.5], values=[0.6, 1.4]}",
    "time.end=0.6",
    "time.step=4e-3",
)


@pytest.fixture(scope="module")
def crane() -> tuple[System, Excitation]:
    scene = scenes.load_any(CRANE, CHANGES)
    system = pmr.reduce(scene).system
    softer = [replace(c, compliance=3.0 * c.compliance) if "bottom" in c.name else c for c in system.contacts]
    system = replace(system, contacts=tuple(softer))
    return system, excitation_of_scene(scene, system)


@pytest.mark.slow
@pytest.mark.numerical
def test_a_ring_of_pads_of_a_beam_is_three_contacts(
    crane: tuple[System, Excitation], monkeypatch: pytest.MonkeyPatch
) -> None:
    system, excitation = crane
    whole = combine_rings(system)
    kept = [contact for contact in system.contacts if contact.kind != "pad"]
    assert len(whole.system.contacts) == 4 * 3 + len(kept) < len(system.contacts)
    fewer = systems.simulate(system, excitation, systems.start_of(system, excitation))
    by_themselves: list[System] = []

    def uncombined(one: System) -> CombinedRings:
        by_themselves.append(one)
        return CombinedRings(one)

    monkeypatch.setattr("pmr.simulation.native.form.combine_rings", uncombined)
    all_of = systems.simulate(system, excitation, systems.start_of(system, excitation))
    assert by_themselves
    assert fewer.forces == pytest.approx(all_of.forces, abs=1e-9 * np.abs(all_of.forces).max())
    assert fewer.energy == pytest.approx(all_of.energy, abs=1e-9 * np.abs(all_of.energy).max())
    for name, body in all_of.bodies.items():
        assert fewer.bodies[name].q == pytest.approx(body.q, abs=1e-9 * np.abs(body.q).max())
        assert fewer.bodies[name].multipliers.shape == body.multipliers.shape


@pytest.mark.slow
@pytest.mark.numerical
def test_pads_that_only_push_or_do_not_give_way_stay_by_themselves(crane: tuple[System, Excitation]) -> None:
    system, _ = crane
    pushing = replace(system, contacts=tuple(replace(c, clearance=0.0) for c in system.contacts))
    rigid = replace(system, contacts=tuple(replace(c, compliance=0.0) for c in system.contacts))
    assert combine_rings(pushing).system is pushing and combine_rings(rigid).system is rigid
    assert combine_rings(pushing).original_forces(np.ones(3)) == pytest.approx(np.ones(3))
