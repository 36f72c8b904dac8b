"""One of the random motions by which the manual judges bands, of a boom whose truth is another model.

`workflows/observe_boom.py` judges 30 others, on other beams too.
"""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np
import pytest


@pytest.mark.slow
@pytest.mark.numerical
def test_estimates_are_near_the_truth_and_bands_hold_it() -> None:
    script = runpy.run_path(str(Path(__file__).parents[2] / "workflows" / "observe_boom.py"))
    judged = script["judge"](0, other=False)
    for name in script["ESTIMATES"]:
        largest = {"payload": 0.04, script["TIP"]: 0.002}.get(name, 0.01)
        assert judged[name].error < largest, (name, judged)
    assert np.mean([of.share for of in judged.values()]) > 0.8, judged
