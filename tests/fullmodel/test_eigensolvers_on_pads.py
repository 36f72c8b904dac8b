from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pmr import scene as scenes
from pmr.fullmodel.build import build
from pmr.fullmodel.eigensolvers import DenseEigenSolver, OneFactorEigenSolver, eigensolver
from pmr.fullmodel.model import FullModel

pytestmark = pytest.mark.mpi
WORKFLOWS = Path(__file__).parents[2] / "workflows"


def boom(*overrides: str) -> FullModel:
    return build(scenes.load(WORKFLOWS / "boom_beam.toml", ["mesh.elements=12", *overrides])).model


@pytest.mark.parametrize("stiffness", ["3e8", "'rigid'"])
def test_modes_are_those_of_lapack(stiffness: str) -> None:
    pads = "[{name='tail',at=0.15,faces={bottom=[0.0],left=[0.0]}},{name='mouth',moving=true,"
    model = boom(f"pads={pads}faces={{bottom=[-0.1,0.1],left=[0.0]}},stiffness={stiffness}}}]")
    one, other = OneFactorEigenSolver(model), DenseEigenSolver(model)
    for s in (1.5, 2.777, 4.0):
        few, exact = one.lowest(s, 8), other.lowest(s, 8)
        assert few.omega == pytest.approx(exact.omega, rel=1e-9)
        assert few.residuals.max() < 1e-9
        assert np.abs(few.phi) == pytest.approx(np.abs(exact.phi), abs=1e-6 * np.abs(exact.phi).max())


def test_pads_that_give_way_lower_the_frequencies() -> None:
    firm, soft = (DenseEigenSolver(boom(f"pads={PADS.format(k)}")).lowest(2.5, 6).omega for k in ("3e8", "3e6"))
    assert np.all(soft < firm) and soft[0] < 0.95 * firm[0]


PADS = (
    "[{{name='tail',at=0.15,faces={{bottom=[-0.1,0.1],left=[0.0]}}}},"
    "{{name='mouth',moving=true,faces={{bottom=[-0.1,0.1],left=[0.0]}},stiffness={}}}]"
)


@pytest.mark.slow
@pytest.mark.numerical
def test_large_models_whose_rows_give_way_need_one_factor() -> None:
    assert isinstance(eigensolver(boom(), "slepc"), OneFactorEigenSolver)
    assert isinstance(eigensolver(boom(), "auto"), DenseEigenSolver)
