"""Simulations that differ in what they lack share what is compiled, and have addresses of what they need alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from nested import Nested, reduced
from on_pads import beam_on_pads, driven, modes_on_pads
from terms import axial, excitation

from pmr.scene.signals import Constant
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.handles import handle
from pmr.simulation.native.levels import BEGIN, MISSED, STEP
from pmr.simulation.native.march import March
from pmr.simulation.native.terms import ACCOUNT, EXPECT, REVISE, TURN
from pmr.simulation.stepping import TimeStepping
from pmr.system.system import System

Make = Callable[[], System]


def plain(sections: int, clearance: float | None = None) -> System:
    return reduced(Nested(sections, elements=6, clearance=clearance), 3)


def varying(sections: int) -> Any:
    """With terms, and the last coordinate of each body without inertia."""
    system: Any = plain(sections)
    bodies = {name: replace(one, quasi_static=np.array([one.size - 1])) for name, one in system.bodies.items()}
    return replace(system, bodies=bodies, terms=axial(system)[:1])


def rough(sections: int) -> System:
    system = plain(sections)
    contacts = [replace(one, friction=0.3, arm=0.18, shear_stiffness=1e13) for one in system.contacts]
    return replace(system, contacts=tuple(contacts))


def loop_of(system: System) -> Any:
    stepping = TimeStepping(0.01, 1e-3, 0.9)
    return March(
        SystemForm.of(system),
        excitation(system, stepping, {name: Constant(amount=0.5) for name in system.term_names}),
        {},
    ).loop


OTHERS = [
    pytest.param(lambda: plain(2, 1e-4), id="pushing"),
    pytest.param(lambda: varying(2), id="terms and modes without inertia"),
    pytest.param(lambda: rough(2), id="friction"),
]


@pytest.mark.parametrize("made", OTHERS)
def test_sections_share_a_loop(made: Make) -> None:
    assert handle(loop_of(made())).kind == handle(loop_of(plain(2))).kind


def test_bodies_on_tables_have_two_loops() -> None:
    """What is nothing but tables has one without any calls."""
    system = System.of(modes_on_pads(beam_on_pads(1e-3, elements=4), 4))
    drive = driven(Constant(amount=3.0), (Constant(amount=9.81), Constant(amount=0.0)), TimeStepping(0.01, 1e-3))
    pushing = March(SystemForm.of(system), drive, {}).loop
    lean, other = loop_of(plain(1)), loop_of(varying(1))
    assert lean.levels is None and lean.terms is None and lean.state.contact is None
    assert handle(pushing).kind == handle(other).kind != handle(lean).kind


def test_what_is_not_needed_has_no_address() -> None:
    nothing, pushing, rubbing = loop_of(plain(2)), loop_of(plain(2, 1e-4)), loop_of(rough(2))
    assert [bool(loop.state.contact.calls[0]) for loop in (nothing, pushing, rubbing)] == [False, True, False]
    assert np.flatnonzero(nothing.levels.calls).tolist() == [STEP]
    assert np.flatnonzero(pushing.levels.calls).tolist() == [STEP, BEGIN, MISSED]
    assert not nothing.terms.calls.any() and not pushing.terms.calls.any()
    assert rubbing.terms.calls[[EXPECT, REVISE, ACCOUNT, TURN]].all()
    assert nothing.sides.calls[0] == rubbing.sides.calls[0] != 0
