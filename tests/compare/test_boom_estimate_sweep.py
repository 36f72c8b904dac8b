"""The estimate for booms of sections beside their true errors, on random booms that nobody had tuned to.

Four as a rule; ``PMR_SWEEP=full`` takes 40.
"""

from __future__ import annotations

import os

import pytest
from random_scenes import random_boom

from pmr.pipeline import run

SEEDS = range(40) if os.environ.get("PMR_SWEEP") == "full" else range(4)
#: True errors below this are round-off of two long simulations.
ROUND_OFF = 1e-6


@pytest.mark.slow
def test_one_to_five_times_the_true_error_on_random_booms() -> None:
    ratios = {"tip": [], "beam": [], "pad_force": []}
    for seed in SEEDS:
        outcome = run(random_boom(seed))
        assert outcome is not None
        summary = outcome.result.summary
        true, said = summary["errors"]["reduced_vs_full"], summary["estimate"]
        assert said["tip"] is not None
        for kind, found in ratios.items():
            if said[kind] is not None and ROUND_OFF < true[kind] < 0.99:
                found.append(said[kind] / true[kind])
    for found in ratios.values():
        assert found and min(found) > 0.8
        assert sum(1.0 <= ratio <= 5.0 for ratio in found) >= 0.95 * len(found)
