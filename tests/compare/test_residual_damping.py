"""What damping makes of the residual part's own deformation, against full models."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import on_pads
from alone import estimate, outputs
from numpy.typing import NDArray
from on_pads import beam_on_pads
from oracle import enriched, with_curvature

from pmr.compare.outputs import RoundOffBounds, differences
from pmr.scene.signals import Constant, Sine, SmoothRamp
from pmr.simulation import TimeStepping
from pmr.system.body import FullBody
from pmr.system.body_matrices import Rayleigh

Array = NDArray[np.float64]

EXTENSION = on_pads.driven(
    SmoothRamp(times=(0.1, 0.4), values=(2.1, 2.4)),
    (Constant(amount=0.0), Sine(amplitude=200.0, frequency=3.0)),
    TimeStepping(0.5, 2.5e-4),
)


def damped(beta: float, stiffness: float) -> FullBody:
    """In proportion to stiffness, with a gauge beside the pads' path."""
    full = with_curvature(beam_on_pads(None, stiffness), 4)
    return replace(full, D=beta * full.K, rayleigh=Rayleigh(0.0, beta))


def test_estimates_know_of_it() -> None:
    full = damped(1e-3, 2e4)
    model = replace(enriched(full, 12, enrichment=4), rayleigh=full.rayleigh)
    truth, own = (outputs(one, EXTENSION) for one in (full, model))
    found, floors = estimate(model, EXTENSION), RoundOffBounds(0.0, 0.0, np.zeros(1))
    true = differences(own, truth, floors, ["beam", "probe"])
    assert 1.0 < found.error_of("probe") / true["probe"] < 2.0 and 1.0 < found.beam / true["beam"] < 2.0
