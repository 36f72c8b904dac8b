import numpy as np
import pytest

from pmr import InputError
from pmr.fem.compat import MPI
from pmr.fem.distributed import gather, tall
from pmr.fullmodel.build import full_model
from pmr.fullmodel.model import FullModel
from pmr.reduction.basis import Basis, kappa, pod
from pmr.reduction.snapshots import Snapshots, eigenmode_snapshots
from pmr.scene import Scene

pytestmark = pytest.mark.mpi
PRODUCTS = ["euclidean", "mass"]
SOLVERS = ["dense", "slepc"]


@pytest.fixture(scope="module")
def scene(load_scene) -> Scene:
    return load_scene()


@pytest.fixture(scope="module")
def model(scene: Scene) -> FullModel:
    return full_model(scene)


@pytest.fixture(scope="module")
def pool(model: FullModel, scene: Scene) -> Snapshots:
    return eigenmode_snapshots(model, scene)


def everywhere(matrix) -> np.ndarray:
    return np.concatenate(MPI.COMM_WORLD.allgather(np.array(matrix.getDenseArray())))


def product_matrix(model: FullModel, product: str) -> np.ndarray:
    M = gather(model.M)
    M = MPI.COMM_WORLD.bcast(None if M is None else M.toarray())
    return M if product == "mass" else np.eye(len(M))


def synthetic(model: FullModel, sigma: np.ndarray, X: np.ndarray) -> Snapshots:
    """A pool with known singular values in the product X."""
    rng = np.random.default_rng(11)
    L = np.linalg.cholesky(X)
    U = np.linalg.qr(rng.standard_normal((model.size, len(sigma))))[0]
    W = np.linalg.qr(rng.standard_normal((len(sigma), len(sigma))))[0]
    S = np.linalg.solve(L.T, U * sigma @ W.T)
    first, last = model.M.getOwnershipRange()
    nothing = np.zeros(len(sigma))
    return Snapshots(tall(S[first:last], model.M), nothing, nothing, nothing, "synthetic")


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("product", PRODUCTS)
def test_a_basis_is_defined_by_its_properties(model: FullModel, pool: Snapshots, product: str, solver: str) -> None:
    before = everywhere(pool.S)
    basis = pod(model, pool, 20, product, solver)
    V, X = everywhere(basis.V), product_matrix(model, product)
    assert V.shape == (153, 20) and basis.size == 20 and basis.product == product
    assert np.abs(V.T @ X @ V - np.eye(20)).max() < 1e-12
    W = V.T @ X @ before  # = Sigma W^T: its rows are orthogonal with the singular values as norms
    assert np.abs(W @ W.T - np.diag(basis.sigma[:20] ** 2)).max() < 1e-13 * basis.sigma[0] ** 2
    rest = before - V @ W
    assert np.sqrt(np.trace(rest.T @ X @ rest)) == pytest.approx(np.linalg.norm(basis.sigma[20:]), abs=1e-14)
    assert np.all(np.diff(basis.sigma) <= 0.0)
    assert np.all(V[np.abs(V).argmax(axis=0), range(20)] > 0.0)
    assert np.array_equal(everywhere(pool.S), before)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("product", PRODUCTS)
def test_the_tail_is_not_lost(model: FullModel, product: str, solver: str) -> None:
    """Singular values far below sqrt(eps): a method that forms S^T S gives noise of 1e-8 from the ninth on."""
    sigma = 10.0 ** -np.arange(0.0, 13.0)
    found = pod(model, synthetic(model, sigma, product_matrix(model, product)), 10, product, solver).sigma
    assert np.abs(found - sigma).max() < 1e-14
    assert found[:12] == pytest.approx(sigma[:12], rel=1e-2)


@pytest.mark.parametrize("product", PRODUCTS)
def test_dense_and_slepc_agree_as_far_as_the_pool_knows(model: FullModel, pool: Snapshots, product: str) -> None:
    dense, slepc = (pod(model, pool, 20, product, solver) for solver in SOLVERS)
    assert np.abs(dense.sigma - slepc.sigma).max() < 1e-14 * dense.sigma[0]
    apart = np.abs(everywhere(dense.V) - everywhere(slepc.V)).max(axis=0)
    assert np.all(apart < 1e3 * np.finfo(float).eps * dense.sigma[0] / dense.sigma[:20])


def test_kappa_of_ten_by_ten_at_twenty_is_the_papers(model: FullModel, load_scene) -> None:
    scene = load_scene("paper_simple", ["reduction.snapshots=10", "reduction.modes=10"])
    basis = pod(model, eigenmode_snapshots(model, scene), 20)
    assert f"{basis.kappa():.6f}" == "0.999986"
    assert basis.kappa(3) < basis.kappa(10) < basis.kappa()


def test_kappa_keeps_the_digits_of_its_complement() -> None:
    assert 1.0 - kappa(np.array([1.0, 1e-5]), 1) == pytest.approx(1e-10, rel=1e-5)
    assert kappa(np.array([3.0, 4.0])[::-1], 1) == pytest.approx(16.0 / 25.0)
    assert kappa(np.array([3.0, 2.0, 1.0]), 4) == 1.0  # more vectors than values


@pytest.mark.parametrize("solver", SOLVERS)
def test_more_vectors_than_the_pool_spans_are_refused(model: FullModel, solver: str) -> None:
    twice = synthetic(model, np.array([1.0, 0.5, 0.25]), np.eye(model.size))
    local = np.array(twice.S.getDenseArray())
    doubled = Snapshots(tall(np.hstack([local, local]), model.M), *[np.zeros(6)] * 3, "doubled")
    assert pod(model, doubled, 3, solver=solver).size == 3
    with pytest.raises(InputError, match="span 3 dimensions"):
        pod(model, doubled, 4, solver=solver)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("product", PRODUCTS)
def test_where_all_snapshots_vanish_the_basis_is_zero(model: FullModel, pool: Snapshots, product, solver: str) -> None:
    V = everywhere(pod(model, pool, 24, product, solver).V)
    assert np.array_equal(V[:2], np.zeros((2, 24))) and np.abs(V[2:]).max(axis=1).min() > 0.0


def test_accuracy_bounds_the_noise_in_a_relation_that_the_snapshots_satisfy(load_scene) -> None:
    """A support in mid-element: its four entries cancel to about round-off times sigma_1 / sigma_r."""
    scene = load_scene("paper_simple", ["supports=[{on=0.033}]", "compare.against=[]"])
    model = full_model(scene)
    basis: Basis = pod(model, eigenmode_snapshots(model, scene), 20)
    C = model.rows.at(2.0).toarray()[1]
    assert 0.0 < np.abs(C @ everywhere(basis.V)).max() < 100.0 * basis.accuracy < 1e-3
