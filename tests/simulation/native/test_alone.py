"""A body alone as the system of one: names without a prefix, and the motion of the loop in tables."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import pmr
from pmr.fullmodel.build import full_model
from pmr.reduction.basis import modal_basis
from pmr.reduction.residual.model import section_model
from pmr.reduction.snapshots.free_body import FreeBody
from pmr.reduction.snapshots.free_modes import free_modes
from pmr.simulation import Excitation
from pmr.simulation.native import simulator, systems
from pmr.system.contacts import ALONE, SLIDER
from pmr.system.system import System


def test_a_body_alone_moves_as_in_tables() -> None:
    scene = pmr.load_scene("evolved_residual", ["mesh.elements=20", "time.end=0.05"])
    body = FreeBody(full_model(scene), "auto")
    model = section_model(body, modal_basis(free_modes(body.model, 8, "auto", 0, body)), {}, 8)
    excitation, system = Excitation.of(scene), System.of(model)
    assert (system.paths, system.input_names, system.contact_names) == ((SLIDER,), model.input_names, model.row_names)
    by_sides = systems.simulate(system, replace(excitation, paths={SLIDER: scene.slider.path})).bodies[ALONE]
    by_tables = simulator.simulate(model, excitation)
    assert np.abs(by_sides.q - by_tables.q).max() <= 1e-10 * np.abs(by_tables.q).max()
    assert np.abs(by_sides.multipliers - by_tables.multipliers).max() <= 1e-10 * np.abs(by_tables.multipliers).max()
