"""The declared order of the model, measured: 4 in the frequencies with the slider on a node.
The declared order of quadratic solids, measured: 4 in the frequencies of smooth modes.
"""

import meshio
import numpy as np
import pytest
from blocks import BLOCKS, block
from textbook import CLOSED_FORM

from pmr.fullmodel.build import full_model
from pmr.fullmodel.eigensolvers import DenseEigenSolver, SlepcEigenSolver
from pmr.fullmodel.structure import Clamp, Structure, structural_model
from pmr.models.beam2d import Beam2D
from pmr.models.solid import Solid
from pmr.scene.structures import Material, SolidBody

DECLARED_ORDER = 4


@pytest.mark.parametrize("s", [2.5, 5.0])
@pytest.mark.parametrize("graded", [False, True])
def test_frequencies_converge_with_the_declared_order(load_scene, s: float, graded: bool, tmp_path) -> None:
    elements, errors = [8, 16, 32], []
    for count in elements:
        # Graded by a fixed map of [0, 1], so that halving the step halves every element; node at 2.5 m.
        x = np.linspace(-1.0, 1.0, count + 1)
        nodes = 2.5 + 2.5 * (x + (0.3 * np.sin(np.pi * x) / np.pi if graded else 0.0))
        file = tmp_path / f"{count}.vtu"
        cells = np.column_stack([np.arange(count), np.arange(1, count + 1)])
        meshio.write(file, meshio.Mesh(np.column_stack([nodes, 0 * nodes, 0 * nodes]), [("line", cells)]))
        scene = load_scene("paper_simple", [f"mesh.file={file}"])
        omega = DenseEigenSolver(full_model(scene)).lowest(s, 3).omega
        errors.append(omega / np.array(CLOSED_FORM[s]) - 1.0)
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.all(orders > DECLARED_ORDER - 0.15), orders
    assert np.all(orders < DECLARED_ORDER + 0.4), orders


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.parametrize("elements", [400, 1600])
def test_round_off_is_as_declared(load_scene, elements: int) -> None:
    """Beyond some hundred elements refinement makes it worse, by the fourth power; within a factor of ten."""
    scene = load_scene("paper_simple", [f"mesh.elements={elements}", "body.profile.axial=false", "compare.against=[]"])
    model = full_model(scene)
    error = abs(SlepcEigenSolver(model).lowest(2.5, 1).omega[0] / CLOSED_FORM[2.5][0] - 1.0)
    expected = Beam2D(scene.body, np.linspace(0.0, 5.0, elements + 1)).round_off
    assert expected / 10.0 < error < expected * 10.0


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
