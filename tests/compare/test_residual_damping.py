"""What damping makes of the residual part's own deformation, against full models."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import on_pads
import pytest
from alone import estimate, outputs
from numpy.typing import NDArray
from on_pads import beam_on_pads
from oracle import inertial, with_curvature

from pmr.compare.outputs import Floors, differences
from pmr.compare.velocities import lag
from pmr.reduced.damping import Rayleigh
from pmr.reduced.model import ReducedModel
from pmr.reduced.truncation import with_kept_inertia
from pmr.scene.signals import Constant, Sine, SmoothRamp
from pmr.simulation import TimeStepping
from pmr.simulation.native import simulator as march
from pmr.system.body import FullBody, displacement

Array = NDArray[np.float64]

DRIVEN = on_pads.driven(
    SmoothRamp(times=(0.1, 0.4), values=(2.1, 2.4)),
    (Constant(amount=0.0), Sine(amplitude=200.0, frequency=3.0)),
    TimeStepping(0.5, 2.5e-4),
)


def damped(beta: float, stiffness: float) -> FullBody:
    """In proportion to stiffness, with a gauge beside the pads' path."""
    full = with_curvature(beam_on_pads(None, stiffness), 4)
    return replace(full, D=beta * full.K, rayleigh=Rayleigh(0.0, beta))


@pytest.mark.parametrize("stiffness", [2e4, 2e5])
def test_it_is_what_outputs_lack(stiffness: float) -> None:
    """The rest is of second order in beta, of displacements and of a curvature, the last output."""
    full = damped(1e-3, stiffness)
    model = replace(with_kept_inertia(inertial(full, 12)), rayleigh=full.rayleigh)
    truth = march.simulate(full, DRIVEN)
    run, f = march.simulate(model, DRIVEN), DRIVEN.forces(model.input_names)
    missing = displacement(full, truth.q, truth.s, truth.multipliers, f)
    missing -= displacement(model, run.q, run.s, run.deforming, f)
    left = missing - lag(model, run, DRIVEN)
    sizes = [np.sqrt(np.mean(x[200:] ** 2, axis=0)) for x in (left, missing)]
    assert np.linalg.norm(sizes[0][:-1]) < 0.2 * np.linalg.norm(sizes[1][:-1])
    assert sizes[0][-1] < 0.2 * sizes[1][-1]


@pytest.mark.parametrize("keep", [lambda model: model, with_kept_inertia], ids=["plain", "with its inertia"])
def test_estimates_know_of_it(keep: Callable[[ReducedModel], ReducedModel]) -> None:
    full = damped(1e-3, 2e4)
    model = keep(replace(inertial(full, 12, enrichment=4), rayleigh=full.rayleigh))
    truth, own = (outputs(one, DRIVEN) for one in (full, model))
    found, floors = estimate(model, DRIVEN), Floors(0.0, 0.0, np.zeros(1))
    true = differences(own, truth, floors, ["beam", "probe"])
    assert 1.0 < found.of("probe") / true["probe"] < 2.0 and 1.0 < found.beam / true["beam"] < 2.0


def test_without_such_damping_nothing_is_late() -> None:
    full = damped(1e-3, 2e4)
    model = replace(inertial(full, 5), rayleigh=full.rayleigh)
    run = march.simulate(model, DRIVEN)
    assert lag(model, run, DRIVEN).any()
    assert not lag(replace(model, rayleigh=None), run, DRIVEN).any()
    assert not lag(replace(model, rayleigh=Rayleigh(0.5, 0.0)), run, DRIVEN).any()
