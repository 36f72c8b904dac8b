"""Full operators, bases as arrays and full coordinates, as a researcher uses them from `import pmr`."""

import numpy as np
import plain_machines
import pytest
import scipy.linalg
import scipy.sparse.linalg

import pmr
from pmr.fem.compat import MPI
from pmr.scene import Scene

CHANGES = [
    "mesh.elements=12", "time.end=0.2", "time.step=2e-3", "compare.against=[]", "reduction.estimate=false",
    "reduction.product=mass",
]  # fmt: skip


def beam(*changes: str) -> Scene:
    return pmr.load_scene("evolved_residual", [*CHANGES, *changes])


@pytest.fixture(scope="module")
def full():
    """Operators of SciPy, on every rank."""
    return MPI.COMM_WORLD.bcast(pmr.full_model(beam()))


@pytest.fixture(scope="module")
def modes(full) -> np.ndarray:
    """The eight lowest modes (n, 8) with the slider held 2.5 m out, which are orthonormal in the mass product."""
    N = scipy.linalg.null_space(full.rows.at(2.5).toarray())
    return N @ scipy.linalg.eigh(N.T @ full.K @ N, N.T @ full.M @ N, subset_by_index=(0, 7))[1]


@pytest.mark.mpi
def test_a_basis_of_vectors_is_projected_as_the_book_says(full, modes) -> None:
    reduction = pmr.reduce(beam("reduction.flexibility=false"), basis=modes)
    V, model = reduction.basis, reduction.reduced
    assert np.abs(V.T @ full.M @ V - np.eye(8)).max() < 1e-12
    scale = np.abs(model.K).max()
    assert np.abs(V.T @ full.K @ V - model.K).max() < 1e-12 * scale
    assert np.abs(V.T @ full.B - model.B).max() < 1e-12 * np.abs(model.B).max()
    rows = full.rows.at(3.1).toarray() @ V
    assert all(np.abs(rows - row).sum(axis=1).min() < 1e-12 * np.abs(rows).max() for row in model.C(3.1))


@pytest.mark.mpi
def test_a_function_of_the_full_model_is_a_basis_too(modes) -> None:
    scene = beam("reduction.flexibility=false")
    by_array = pmr.reduce(scene, basis=modes).reduced
    by_function = pmr.reduce(scene, basis=lambda model: modes[model.share]).reduced
    assert np.array_equal(by_array.K, by_function.K)


def test_all_unit_vectors_reduce_nothing(full) -> None:
    """On them the motion satisfies the equations of the full model, step by step."""
    scene = beam("reduction.flexibility=false", "reduction.product=euclidean")
    reduction = pmr.reduce(scene, basis=np.eye(full.size))
    by_body = pmr.simulate_with_states(scene, reduction.system).states
    states = by_body[""]
    assert reduction.reduced.size == full.size
    q, rows, s = reduction.reconstruct(by_body), list(states.rows), states.s[:, -1]
    constrained = [full.row_names.index(name) for name in rows]
    residual = [full.rows.at(s[k]).toarray()[constrained] @ q[k] for k in range(len(q))]
    assert np.abs(residual).max() < 1e-10 * np.abs(q).max()
    assert np.abs(q).max() > 1e-4


@pytest.mark.mpi
def test_full_coordinates_say_what_the_simulation_says(full, modes) -> None:
    """Outputs of the reconstructed coordinates are those of the reduced model, residual flexibility included."""
    scene, steps = beam(), [0, 40, 100]
    reduction = pmr.reduce(scene, basis=modes[:, :4])
    simulated = pmr.simulate_with_states(scene, reduction.system, steps)
    q = reduction.reconstruct(simulated.states)
    said = simulated.response.displacement[steps]
    assert np.abs(said).max() > 1e-5
    assert np.abs(q @ full.outputs.T.toarray() - said).max() < 1e-9 * np.abs(said).max()


@pytest.mark.slow
def test_full_coordinates_of_a_boom_have_its_modes_of_second_order() -> None:
    """Its sections have modes without inertia for axial forces, which full coordinates have, too."""
    scene = pmr.load_scene(
        plain_machines.CRANE, ["frame.second_order=true", "section.mesh.elements=10", "time.end=0.2"]
    )
    operators, reduction, steps = pmr.full_model(scene), pmr.reduce(scene), [0, 40, 100]
    simulated = pmr.simulate_with_states(scene, reduction.system, steps)
    q = reduction.reconstruct(simulated.states)
    displacements = dict(zip(simulated.response.output_names, simulated.response.displacement[steps].T, strict=True))
    largest = max(np.abs(values).max() for values in displacements.values())
    for name, full in operators.items():
        outputs = q[name] @ full.outputs.toarray().T
        for number, output in enumerate(full.output_names):
            if (expected := displacements.pop(f"{name}: {output}", None)) is not None:
                assert outputs[:, number] == pytest.approx(expected, abs=1e-9 * largest)
        p = np.random.default_rng(3).normal(size=reduction.basis[name].shape[1])
        assert np.abs(reduction.project(reduction.basis[name] @ p, name) - p).max() < 1e-9
    assert largest > 1e-3 and not displacements


@pytest.mark.mpi
def test_projection_is_the_left_inverse_of_the_basis(modes) -> None:
    reduction = pmr.reduce(beam(), basis=modes[:, :4])
    p = np.random.default_rng(3).normal(size=(reduction.reduced.size, 2))
    assert np.abs(reduction.project(reduction.basis @ p) - p).max() < 1e-12
    assert np.abs(reduction.project(reduction.basis @ p[:, 0]) - p[:, 0]).max() < 1e-12


def test_a_boom_has_operators_for_each_section() -> None:
    boom = pmr.load_scene("boom_two", ["section.mesh.elements=8"])
    operators = pmr.full_model(boom)
    assert set(operators) == {"base", "fly"}
    distributed = pmr.full_model(boom, distributed=True)
    for name in ("M", "D", "K", "B"):
        expected = np.sqrt(np.square(scipy.sparse.csr_matrix(getattr(operators["fly"], name)).data).sum())
        assert getattr(distributed["fly"], name).norm() == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("basis", "allowed"),
    [
        (np.ones((5, 2)), "39 rows"),
        (np.ones(39), "39 rows"),
        (np.full((39, 1), np.nan), "finite vectors"),
        (np.ones((39, 0)), "finite vectors"),
        (np.ones((39, 2)) * (1.0 + 1.0j), "real numbers"),
    ],
)
def test_vectors_that_fit_nothing_are_refused(basis: np.ndarray, allowed: str) -> None:
    with pytest.raises(pmr.InputError, match=allowed):
        pmr.reduce(beam(), basis=basis)


@pytest.mark.mpi
def test_a_function_that_changes_the_model_is_refused(modes) -> None:
    """Also if the last rank alone changes its part: the others would compare with a model of another body, or wait."""
    is_last = MPI.COMM_WORLD.rank == MPI.COMM_WORLD.size - 1

    def stiffened(model) -> np.ndarray:
        if is_last:
            end = model.share.stop - 1
            model.K.setValue(end, end, 1e6, addv=True)
        model.K.assemble()
        return modes[model.share]

    with pytest.raises(pmr.InputError, match="leaves mass and stiffness" if is_last else "finite vectors"):
        pmr.reduce(beam("reduction.flexibility=false"), basis=stiffened)


def test_a_basis_for_a_boom_of_sections_is_refused() -> None:
    with pytest.raises(pmr.InputError, match="a scene of one body is allowed"):
        pmr.reduce(pmr.load_scene("boom_two"), basis=np.eye(3))
