"""A body alone as the system of one: names without a prefix, and the motion of the loop in tables."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import one_body
import pytest
from on_pads import beam_on_pads, driven, modes_on_pads
from one_body import displacement
from oracle import free_modes as modes_of

import pmr
from pmr.fullmodel.build import full_model
from pmr.reduction.basis import modal_basis
from pmr.reduction.free_body import FreeBody
from pmr.reduction.residual import section_model
from pmr.reduction.snapshots import free_modes
from pmr.scene.signals import Constant, Sine, SmoothRamp
from pmr.simulation import Excitation, TimeStepping, contact_step
from pmr.simulation.native import systems
from pmr.system.carriers import CarrierRows
from pmr.system.contacts import ALONE, SLIDER
from pmr.system.system import System


def on_two_paths(system: System) -> System:
    """The last contact on a path of its own: nothing but places say then what tables do otherwise."""
    *others, last = system.contacts
    return replace(system, contacts=(*others, replace(last, inner=replace(last.inner, path="other"))))


def twice(excitation: Excitation) -> Excitation:
    """The same path for both."""
    return replace(excitation, paths={SLIDER: excitation.path, "other": excitation.path})


@pytest.mark.parametrize("parts", [0, 1])
def test_pads_that_push_on_a_body_alone_are_followed_alike_in_tables_and_by_places(parts: int) -> None:
    """The same steps in the same parts, each with its own balance of energy."""
    rich = beam_on_pads(1e-3, 3e8)
    carried = CarrierRows.from_rows(rich.rows.shared_carriers.rows, rich.rows.shared_carriers.carriers.toarray())
    model = modes_on_pads(rich, 6)
    modes = modes_of(rich, 6)[0]
    model = replace(model, carriers=carried.project(modes).with_rows([1, 2, 3, 4]))
    loads = (Constant(amount=9.81), Sine(amplitude=4000.0, frequency=5.0))
    path = SmoothRamp(times=(0.0, 0.2), values=(3.0, 3.2))
    excitation, system = driven(path, loads, TimeStepping(0.2, 1e-3, 0.9, parts)), System.of(model)
    tables, sides = systems.simulate(system, excitation), systems.simulate(on_two_paths(system), twice(excitation))
    assert np.array_equal(tables.parts, sides.parts) and (parts == 1 or set(tables.parts) > {1, 2})
    largest = tables.peaks.max()
    assert largest > 0.0 and np.abs(sides.peaks - tables.peaks).max() <= 1e-8 * largest
    assert np.abs(sides.impulses - tables.impulses).max() <= 1e-8 * tables.impulses.max()
    assert np.abs(sides.energy - tables.energy).max() <= 1e-8 * tables.energy.max()


def test_a_body_alone_makes_a_step_in_as_many_parts_as_its_pads_ask_for() -> None:
    """Fewer than resolve the contact throughout, with the same largest force; the schedule makes them again."""
    model = modes_on_pads(beam_on_pads(5e-3, 3e8, 20), 4)
    given = partial(driven, Constant(amount=3.0), (Constant(amount=9.81), Constant(amount=0.0)))
    found = one_body.simulate(model, given(TimeStepping(0.2, 1e-3, 0.9)))
    finest = one_body.simulate(model, given(TimeStepping(0.2, 1e-3, 0.9, parts=128)))
    assert found.parts is not None and found.peaks is not None and finest.peaks is not None
    most = (
        contact_step.contact_frequency(System.of(model), given(TimeStepping(0.2, 1e-3))) * 1e-3 / contact_step.RESOLVED
    )
    assert found.parts.mean() < 0.5 * most <= found.parts.max()
    assert np.abs(found.peaks.max(axis=0) - finest.peaks.max(axis=0)).max() < 1e-3 * finest.peaks.max()
    schedule = tuple(found.parts[1:].tolist())
    again = one_body.simulate(model, given(TimeStepping(0.2, 1e-3, 0.9, schedule=schedule)))
    assert np.abs(again.peaks - found.peaks).max() < 1e-9 * found.peaks.max()


def test_a_body_alone_moves_as_in_tables() -> None:
    scene = pmr.load_scene("evolved_residual", ["mesh.elements=20", "time.end=0.05"])
    body = FreeBody(full_model(scene), "auto")
    model = section_model(body, modal_basis(free_modes(body.model, 8, "auto", 0, body)), {}, 8)
    excitation, system = Excitation.from_scene(scene), System.of(model)
    assert (system.paths, system.input_names, system.contact_names) == ((SLIDER,), model.input_names, model.row_names)
    found, by_tables = systems.simulate(system, excitation), one_body.simulate(model, excitation)
    assert np.array_equal(found.bodies[ALONE].q, by_tables.q)
    y = systems.displacements(system, found)[ALONE]
    expected = displacement(
        model, by_tables.q, by_tables.s, by_tables.multipliers, excitation.forces(model.input_names)
    )
    assert np.abs(y - expected).max() <= 1e-13 * np.abs(expected).max()
    (contact,) = system.contacts
    turned = replace(system, contacts=(replace(contact, direction=-1.0),))
    assert system.on_one_path and not turned.on_one_path
    by_sides = systems.simulate(turned, excitation).bodies[ALONE]
    assert np.abs(by_sides.q - by_tables.q).max() <= 1e-10 * np.abs(by_tables.q).max()
    assert np.abs(by_sides.multipliers - by_tables.multipliers).max() <= 1e-10 * np.abs(by_tables.multipliers).max()
