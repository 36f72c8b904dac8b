"""Where rows of the operators are assembled, and where they stand afterwards.
Masses and centres of gravity of bodies, beside what their dimensions say.
"""

import numpy as np
import pytest
import scipy.sparse as sp

from pmr.fem.compat import MPI
from pmr.fem.distributed import gather
from pmr.fullmodel.build import build_bodies, full_model
from pmr.fullmodel.eigensolvers import DependentRowsError, eliminate
from pmr.scene import load_any

SCENE = "boom_shell"


CELLS = {"beam3d": ["mesh.elements=6"], "shell": ["mesh.size=0.2", "mesh.along=0.5"]}
LENGTH, WIDTH, HEIGHT, WALL, DENSITY, PAYLOAD = 6.0, 0.3, 0.4, 0.008, 7850.0, 250.0


@pytest.mark.mpi
@pytest.mark.parametrize("model", ["beam3d", "shell"])
def test_a_box_weighs_what_its_walls_do(model: str) -> None:
    """With the payload at its tip; its centre is between both."""
    scene = load_any("boom", [f"body.model={model}", *CELLS[model]])
    (built,) = build_bodies(scene).values()
    found = built.model.masses
    assert found is not None
    own = DENSITY * LENGTH * 2.0 * (WIDTH + HEIGHT) * WALL
    assert found.body == pytest.approx(own, rel=1e-9) and found.attached == PAYLOAD
    centre = (own * LENGTH / 2.0 + PAYLOAD * LENGTH) / (own + PAYLOAD)
    assert found.centre == pytest.approx([centre, 0.0, 0.0], abs=1e-9 * LENGTH)


@pytest.mark.mpi
def test_a_clamp_takes_no_mass_and_a_planar_beam_has_its_own() -> None:
    scene = load_any("boom_two", ["section.mesh.elements=5", "sections.base.supports.0.points=all"])
    base, fly = (one.model.masses for one in build_bodies(scene).values())
    assert base is not None and fly is not None
    box = scene.sections[0].body.box
    assert box is not None
    own = DENSITY * box.length * 2.0 * (box.width + box.height) * box.wall
    assert base.body == pytest.approx(own, rel=1e-9) and base.attached == 0.0
    assert base.centre == pytest.approx([box.length / 2.0, 0.0, 0.0], abs=1e-9)
    assert fly.attached == sum(mass.mass for mass in scene.sections[1].masses) > 0.0 and fly.centre[0] > 3.0
    assert np.all(fly.centre[1:] == 0.0)


RNG = np.random.default_rng(3)


def test_every_z_satisfies_the_rows_and_nothing_else_is_lost() -> None:
    C = sp.random(4, 30, density=0.3, random_state=5, format="csr")
    T = eliminate(C, "abcd").to_scipy()
    assert T.shape == (30, 26)
    assert np.abs(C @ T.toarray()).max() < 1e-14
    assert np.linalg.matrix_rank(T.toarray()) == 26


def test_a_unit_row_deletes_its_coordinate() -> None:
    C = sp.csr_matrix(([1.0], ([0], [2])), shape=(1, 5))
    assert np.array_equal(eliminate(C, ["slider"]).to_scipy().toarray(), np.delete(np.eye(5), 2, axis=1))


def test_dependent_rows_are_named() -> None:
    C = sp.csr_matrix(np.array([[1.0, 2.0, 0.0], [0.0, 1.0, 1.0], [1.0, 4.0, 2.0]]))
    with pytest.raises(DependentRowsError, match="slider"):
        eliminate(C, ["support", "other", "slider"])


def test_rows_of_very_different_size_are_no_less_independent() -> None:
    C = sp.csr_matrix(np.array([[1.0, 0.5, 0.0], [0.0, 1e-12, 1e-12]]))
    assert np.abs(C @ eliminate(C, "ab").to_scipy().toarray()).max() < 1e-24


@pytest.mark.mpi
@pytest.mark.parametrize("s", [0.1, 1.27, 2.5, 5.0])
def test_the_distributed_matrix_is_the_same(load_scene, s: float) -> None:
    model = full_model(load_scene())
    elimination = eliminate(model.rows.at(s), model.rows.names)
    T = gather(elimination.to_petsc(model.M))
    if MPI.COMM_WORLD.rank == 0:
        assert np.array_equal(T.toarray(), elimination.to_scipy().toarray())
