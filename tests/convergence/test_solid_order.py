"""The declared order of quadratic solids, measured: 4 in the frequencies of smooth modes."""

from __future__ import annotations

import numpy as np
import pytest
from blocks import BLOCKS, block

from pmr.fullmodel.eigensolvers import DenseEigenSolver
from pmr.fullmodel.structural import structural_model
from pmr.fullmodel.structure import Clamp, Structure
from pmr.models.solid import Solid
from pmr.scene.structures import Material, SolidBody

DECLARED_ORDER = 4


@pytest.mark.parametrize("kind", BLOCKS)
def test_a_rod_has_the_frequencies_of_its_waves(kind: str) -> None:
    """omega = (2 k - 1) pi / (2 L) sqrt(E / rho): without Poisson's ratio a rod that moves along x only."""
    material, length = Material(young=2e9, poisson=0.0, density=500.0), 3.0
    exact = np.array([1, 3]) * np.pi / (2 * length) * np.sqrt(2e9 / 500.0)
    errors = []
    for cells in (4, 8, 16):
        model = Solid(SolidBody(material=material), block(kind, (cells, 1, 1), (length, 0.3, 0.3)))
        full = structural_model(Structure(model, (Clamp("tail", ("x",)), Clamp("all", ("y", "z")))))
        errors.append(DenseEigenSolver(full).lowest(0.0, 2).omega / exact - 1.0)
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.all(np.array(errors) > 0.0) and np.all(np.abs(orders - DECLARED_ORDER) < 0.3), orders
