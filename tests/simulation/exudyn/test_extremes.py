"""Exudyn beside `march` where models, steps and loads are extreme: docs/validation.md, "At the extremes"."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import one_body
import pytest
from one_body import displacement
from oracle import TIP_LOAD, flexible, full_body

from pmr.scene.signals import SmoothRamp
from pmr.simulation import Excitation, TimeStepping

FULL = full_body(20)
MODEL = flexible(FULL, 6)
#: A slide that nothing is extreme of: largest force in N, step and end in s, place at the end in m.
PLAIN = {"force": 100.0, "step": 1e-3, "seconds": 0.5, "end": 3.0}


@pytest.mark.parametrize(
    ("model", "change"),
    [
        (MODEL, {"step": 1e-2}),
        (MODEL, {"step": 1e-4, "seconds": 0.2}),
        (MODEL, {"force": 1e-12}),
        (MODEL, {"force": 1e9}),
        (MODEL, {"seconds": 0.02, "end": 4.5}),
        (replace(MODEL, pads=np.array([1e-3])), {}),
        (replace(MODEL, pads=np.array([1e-15])), {}),
        (flexible(FULL, 1), {}),
        (flexible(FULL, 40), {}),
    ],
    ids=["long step", "short step", "no force", "huge force", "fast", "soft pad", "stiff pad", "one mode", "all modes"],
)
def test_both_simulators_agree(model, change: dict[str, float]) -> None:
    asked = PLAIN | change
    end = asked["seconds"]
    path = SmoothRamp(times=(0.1 * end, 0.9 * end), values=(1.5, asked["end"]))
    load = SmoothRamp(times=(0.0, 0.4 * end, 0.8 * end), values=(0.0, asked["force"], 0.0))
    excitation = Excitation({"slider": path}, {TIP_LOAD: load}, TimeStepping(end, asked["step"], 0.9))
    f = excitation.forces(model.input_names)
    runs = [one_body.simulate(model, excitation), one_body.in_exudyn(model, excitation, formulation="multipliers")]
    one, other = (displacement(model, run.q, run.s, run.multipliers, f) for run in runs)
    assert np.abs(one - other).max() < 1e-9 * np.abs(one).max()
