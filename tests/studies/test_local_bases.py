"""Local bases: with all modes they are the full model, and their equations need the terms of a basis that changes."""

from __future__ import annotations

import numpy as np
import one_body
import pytest
from one_body import energy
from oracle import TIP_LOAD, full_body

from pmr.compare.errors import relative_error
from pmr.scene.signals import Constant, Sine, SmoothRamp
from pmr.simulation import Excitation, TimeStepping
from pmr.simulation.modal import modal_form
from pmr.studies.local_bases import aligned, held_modes, local_model, positions

BODY = modal_form(full_body(4)).body
PATH = SmoothRamp(times=(0.1, 0.7), values=(1.5, 2.3))  # across a node
S = np.linspace(1.5, 2.3, 81)


def driven(path=PATH) -> Excitation:
    return Excitation({"slider": path}, {TIP_LOAD: Sine(amplitude=50.0, frequency=3.0)}, TimeStepping(0.8, 5e-4))


def full(excitation: Excitation):
    run, f = one_body.simulate_modal(BODY_FORM, excitation), excitation.forces((TIP_LOAD,))
    found = energy(BODY, run, f)
    return run.q @ BODY.outputs.T, found.kinetic + found.strain


BODY_FORM = modal_form(full_body(4))


def test_held_modes_hold_the_slider_and_are_orthonormal() -> None:
    V = held_modes(BODY, 1.7, 4)
    assert np.allclose(V.T @ V, np.eye(4), atol=1e-12) and np.abs(BODY.C(1.7) @ V).max() < 1e-12


def test_sets_of_modes_are_rotated_onto_each_other() -> None:
    one = held_modes(BODY, 1.7, 4)
    mixed = one @ np.linalg.qr(np.random.default_rng(1).normal(size=(4, 4)))[0]
    assert np.allclose(aligned(np.array([one, mixed]))[1], one, atol=1e-12)


def test_at_rest_all_modes_are_the_full_model() -> None:
    excitation = driven(Constant(amount=1.9))
    found = local_model(BODY, S, BODY.size - 1, True).simulate(excitation)
    y, stored = full(excitation)
    assert relative_error(found.displacement, y) < 1e-5
    assert np.abs(found.energy - stored).max() < 1e-5 * stored.max()


def test_while_it_slides_only_the_terms_of_the_change_of_basis_make_it_so() -> None:
    y, stored = full(driven())
    complete, without = (local_model(BODY, S, BODY.size - 1, moving).simulate(driven()) for moving in (True, False))
    assert relative_error(complete.displacement, y) < 2e-3
    assert np.abs(complete.energy - stored).max() < 2e-3 * stored.max()
    assert relative_error(without.displacement, y) > 5.0 * relative_error(complete.displacement, y)


def test_pads_that_give_way_hold_no_modes() -> None:
    from dataclasses import replace

    with pytest.raises(ValueError, match="rigid"):
        local_model(replace(BODY, pads=np.array([1e-6])), S, 3, True)


def test_positions_are_as_close_on_any_path() -> None:
    assert np.allclose(np.diff(positions(BODY, (1.0, 2.0))), 5.0 / 200) and len(positions(BODY, (1.0, 1.001))) == 6
