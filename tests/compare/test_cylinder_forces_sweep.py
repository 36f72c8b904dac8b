"""Forces of pads and of cylinders, apart, on booms that were random before any of this was written.

Two as a rule; ``PMR_SWEEP=full`` takes 40.
"""

from __future__ import annotations

import os

import pytest
from random_scenes import driven_boom

from pmr.pipeline import run

SEEDS = range(40) if os.environ.get("PMR_SWEEP") == "full" else (0, 7)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_forces_agree_to_a_per_cent_or_the_estimate_is_near_their_error(seed: int) -> None:
    outcome = run(driven_boom(seed))
    assert outcome is not None
    summary = outcome.result.summary
    true, estimated = summary["errors"]["reduced_vs_full"], summary["estimate"]
    kinds = [kind for kind in true if kind.startswith(("pad_force", "cylinder_force"))]
    assert {"pad_force", "cylinder_force"} <= {*kinds, *summary["not_judged"]}
    for kind in kinds:
        assert true[kind] <= 0.01 or 0.8 <= estimated[kind] / true[kind] <= 5.0
