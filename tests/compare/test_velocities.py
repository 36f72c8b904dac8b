"""Recovered velocities and kinetic energy against derivatives of the whole body's coordinates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import on_pads
import one_body
import pytest
from driving import driven, loads_at
from numpy.typing import NDArray
from on_pads import beam_on_pads, flexible_on_pads
from one_body import displacement
from oracle import enriched, paper_basis, project, rich_body

from pmr.compare.velocities import force_rates, load_rates, output_rates
from pmr.scene.signals import Sine, SmoothRamp
from pmr.simulation import TimeStepping

Array = NDArray[np.float64]

FULL = rich_body()
PATH = SmoothRamp(times=(0.0, 0.3), values=(1.5, 2.1))
LOADS = (Sine(amplitude=200.0, frequency=3.0), SmoothRamp(times=(0.0, 0.3), values=(0.0, 80.0)))
STEPPING = TimeStepping(0.3, 2e-5, 0.9)
EXTENSION = driven(PATH, LOADS, STEPPING)
SHORT = driven(PATH, LOADS, TimeStepping(0.1, 1e-3))


def rate(x: Array) -> Array:
    """Central differences at all but the first and last step."""
    return (x[2:] - x[:-2]) / (2.0 * STEPPING.step)


@pytest.mark.parametrize("pads", [None, np.array([2e-6, 5e-6])])
def test_they_are_the_rates_of_outputs_and_forces(pads: Array | None) -> None:
    model = replace(enriched(FULL, 5), pads=pads)
    run = one_body.simulate(model, EXTENSION)
    y = displacement(model, run.q, run.s, run.multipliers, loads_at(LOADS, run.t))
    found, late = output_rates(model, run, EXTENSION)[1:-1], slice(300, None)  # the start strikes
    assert np.abs(found - rate(y))[late].max() < 2e-4 * np.abs(found).max()
    assert np.abs(run.v @ model.outputs.T - output_rates(model, run, EXTENSION)).max() > 1e-2 * np.abs(found).max()
    z = force_rates(model, run, EXTENSION.path_rate, load_rates(model, EXTENSION))
    assert np.abs(z.rate[1:-1] - rate(run.multipliers))[late].max() < 1e-3 * np.abs(z.rate).max()


def test_rows_that_are_open_have_no_force_that_changes() -> None:
    """A beam that rises from the lower pads to the upper ones and back."""
    model = flexible_on_pads(beam_on_pads(clearance=1e-3), 5)
    loads = (SmoothRamp(times=(0.0, 0.1), values=(0.0, 9.81)), Sine(amplitude=4000.0, frequency=5.0))
    excitation = on_pads.driven(PATH, loads, STEPPING)
    run = one_body.simulate(model, excitation)
    z = force_rates(model, run, excitation.path_rate, load_rates(model, excitation))
    pushes = run.multipliers > 0.0
    assert not z.rate[~pushes].any() and 0.1 < pushes.mean() < 0.9
    y = displacement(model, run.q, run.s, run.multipliers, loads_at(loads, run.t))
    same = np.all((pushes[2:] == pushes[1:-1]) & (pushes[:-2] == pushes[1:-1]), axis=1)
    found = output_rates(model, run, excitation)[1:-1]
    assert np.abs(found - rate(y))[same].max() < 2e-4 * np.abs(found).max()


def test_without_flexibility_they_are_those_of_the_coordinates() -> None:
    model = project(FULL, paper_basis(FULL, 3, 3, 6))
    run = one_body.simulate(model, SHORT)
    assert np.array_equal(output_rates(model, run, SHORT), run.v @ model.outputs.T)
    with pytest.raises(ValueError, match="without residual flexibility"):
        force_rates(model, run, SHORT.path_rate, load_rates(model, SHORT))
