"""The declared orders of the beam in space, measured: 4 in the bending frequencies, 2 with shear.

An element's shear strain is constant, which is exact in statics, where the shear force is too; under inertia the force
varies along the element.  The error is a small one: it is the shear's share of the compliance that converges so.
"""

import numpy as np
import pytest

from pmr.fullmodel.eigensolvers import DenseEigenSolver
from pmr.fullmodel.structure import Clamp, Structure, structural_model
from pmr.models.beam3d import Beam3D
from pmr.scene.structures import Beam3DBody, BoxProfile

DECLARED_ORDER = {False: 4, True: 2}


def frequencies(elements: int, shear: bool) -> np.ndarray:
    profile = BoxProfile(width=0.3, height=0.4, wall=0.008)
    body = Beam3DBody(length=6.0, profile=profile, shear=shear, elements=elements)
    full = structural_model(Structure(Beam3D(body), clamps=(Clamp("tail"),)))
    return DenseEigenSolver(full).lowest(0.0, 4).omega


@pytest.mark.parametrize(("shear", "coarsest"), [(False, 4), (True, 8)])  # the finer, the less digits are left
def test_frequencies_converge_with_the_declared_order(shear: bool, coarsest: int) -> None:
    first, second, third, fourth = (frequencies(coarsest * k, shear) for k in (1, 2, 4, 8))
    orders = np.log2([(first - second) / (second - third), (second - third) / (third - fourth)])
    assert np.all(np.abs(orders - DECLARED_ORDER[shear]) < 0.25), orders
    assert np.all(third > fourth)  # a conforming element approaches from above
    assert np.all(third / fourth - 1.0 < 2e-4)
