"""Who simulates all sections in full order is whom the scene names."""

from __future__ import annotations

import numpy as np
import pytest

import pmr
from pmr.results import Response

SHORT = ["section.mesh.elements=4", "section.reduction.coordinates=4", "time.end=0.02", "time.step=1e-3"]
SHORT += ["time.rho_inf=0.9", "simulation.repeats=1"]
BOTH_WAYS = [f"section.joint.{end}=[{{at=0.15,stiffness=1e8,unilateral=false}}]" for end in ("tail", "mouth")]


@pytest.mark.slow
@pytest.mark.parametrize("pads", ["both ways", "pushing"])
def test_every_simulator_of_the_full_model_is_honoured(pads: str) -> None:
    """They follow the same motion; where pads only push, each step in the parts that the reduced model's took."""
    found = dict[str, Response]()
    for name in ("march", "petsc", "exudyn"):
        asked = [*SHORT, *(BOTH_WAYS if pads == "both ways" else []), f"simulation.full={name}"]
        result = pmr.run(pmr.load_scene("boom_two", asked)).result
        assert result.summary["simulators"]["full"] == name
        found[name] = result.responses["full"]
    expected = found["march"].displacement
    for name in ("petsc", "exudyn"):
        assert np.abs(found[name].displacement - expected).max() <= 1e-6 * np.abs(expected).max()
