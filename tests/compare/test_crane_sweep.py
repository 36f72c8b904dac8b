"""Random booms that luff, slew and telescope with second order: reduced beside full, and the estimate.

Two as a rule; ``PMR_SWEEP=full`` takes 40.
"""

from __future__ import annotations

import os

import numpy as np
import pytest
from random_cranes import random_crane

from pmr.pipeline import run

SEEDS = range(40) if os.environ.get("PMR_SWEEP") == "full" else range(1, 3)
#: True errors below this are round-off of two long simulations.
ROUND_OFF = 1e-6


@pytest.mark.slow
def test_reduced_beside_full_and_the_estimate_on_random_cranes() -> None:
    errors, ratios = [], []
    for seed in SEEDS:
        outcome = run(random_crane(seed))
        assert outcome is not None
        summary = outcome.result.summary
        error, estimate = summary["errors"]["reduced_vs_full"]["tip"], summary["estimate"]
        errors.append(error)
        if estimate["tip"] is None:
            assert estimate["reason"], seed
        elif error > ROUND_OFF:
            ratios.append(estimate["tip"] / error)
    assert np.median(errors) < 5e-3
    assert len(ratios) >= 0.9 * len(errors) and 0.95 < min(ratios) <= max(ratios) < 5.0
