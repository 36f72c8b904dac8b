"""What SciPy stands in for is what PETSc does, on one rank.
Compiled forms: a form is compiled once, however many other forms a process has compiled before.
Products of distributed matrices, and the memory that they give back.
"""

from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from processes import resident

from pmr import load_scene
from pmr.fem import serial
from pmr.fem.compat import MPI, VERSION, PETSc
from pmr.fem.distributed import share, sparse, times
from pmr.fem.factor import Factor, NotDefiniteError, SparseFactor
from pmr.fullmodel.from_scene import structure_of
from pmr.models.meshed import Assembler
from pmr.scene.members import members

N = 12


def matrix(home: Any, A: sp.csr_matrix) -> Any:
    comm = MPI.COMM_SELF if home is PETSc else serial.WORLD
    sizes = tuple((n, n) for n in A.shape)
    made = home.Mat().createAIJ(sizes, csr=(A.indptr, A.indices, A.data), comm=comm)
    made.assemble()
    return made


def dense(A: Any) -> np.ndarray:
    indptr, indices, entries = A.getValuesCSR()
    return sp.csr_matrix((entries, indices, indptr), shape=A.getSize()).toarray()


@pytest.fixture
def given() -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """A positive definite matrix and a tall one."""
    X, P = (sp.random(N, m, 0.3, format="csr", random_state=m) for m in (N, 5))
    return sp.csr_matrix(X @ X.T + sp.eye(N)), P


def found(home: Any, A: sp.csr_matrix, tall: sp.csr_matrix) -> dict[str, Any]:
    """What operations leave, each on a matrix of its own."""
    new = matrix(home, A)
    x, y = new.createVecs()
    x.getArray()[:] = np.arange(N)
    result: dict[str, Any] = {"diagonal": new.getDiagonal().getArray()}
    new.mult(x, y)
    result["mult"] = y.getArray().copy()
    z = y.duplicate()
    new.multAdd(x, y, z)
    result["multAdd"] = z.getArray()
    result["norm"] = new.norm(home.NormType.NORM_INFINITY)
    result["PtAP"] = dense(new.PtAP(matrix(home, tall)))
    rows = home.IS().createGeneral(np.array([4, 1, 7], dtype=home.IntType), comm=new.comm)
    result["createSubMatrix"] = dense(new.createSubMatrix(rows, rows))
    scaled, grown = new.duplicate(copy=True), new.copy()
    scaled.scale(-2.0)
    grown.axpy(0.5, matrix(home, sp.eye(N, format="csr")), structure=home.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    result |= {"scale": dense(scaled), "axpy": dense(grown), "unchanged": dense(new)}
    B, C = (home.Mat().createDense(((N, N), (home.DECIDE if home is PETSc else 2, 2)), comm=new.comm) for _ in "BC")
    for one in (B, C):
        one.setUp()
        one.assemble()
    B.getDenseArray()[:] = np.arange(2 * N).reshape(N, 2)
    new.matMult(B, C)
    result |= {"matMult": C.getDenseArray().copy(), "sizes": new.getSizes(), "share": new.getOwnershipRange()}
    return result


def test_operations_are_those_of_petsc(given: tuple[sp.csr_matrix, sp.csr_matrix]) -> None:
    expected = found(PETSc, *given)
    for name, value in found(serial.PETSc, *given).items():
        np.testing.assert_allclose(value, expected[name], rtol=1e-13, atol=1e-13, err_msg=name)


def test_a_factor_solves_and_refuses_what_is_not_definite(given: tuple[sp.csr_matrix, sp.csr_matrix]) -> None:
    A, rhs = given[0], np.random.default_rng(2).normal(size=(N, 3))
    factor = SparseFactor(serial.Mat(A), "A")
    np.testing.assert_allclose(A @ factor.solve_columns(rhs), rhs, rtol=0.0, atol=1e-12)
    answer = serial.Vec(np.zeros(N))
    factor.solve(serial.Vec(rhs[:, 0]), answer)
    np.testing.assert_allclose(A @ answer.getArray(), rhs[:, 0], rtol=0.0, atol=1e-12)
    factor.destroy()
    for B in (A - 3.0 * sp.eye(N), sp.diags([0.0, *np.ones(N - 1)], format="csr"), sp.csr_matrix(np.fliplr(np.eye(N)))):
        with pytest.raises(NotDefiniteError, match="A: a positive definite matrix"):
            SparseFactor(serial.Mat(sp.csr_matrix(B)), "A")


@pytest.mark.slow
def test_a_form_has_the_same_signature_before_and_after_another_one_is_compiled(tmp_path) -> None:
    """FFCx changes the element of a mesh while it compiles, unless the element says everything from the start."""
    dolfinx = pytest.importorskip("dolfinx")
    (member,) = members(load_scene("boom_beam"))
    model = structure_of(member, MPI.COMM_SELF).model
    space = Assembler(model, model.domain(MPI.COMM_SELF)).space
    forms = model.forms(space)
    before = forms.stiffness.signature()
    options = "jit_params" if VERSION < (0, 6) else "jit_options"
    dolfinx.fem.form(forms.mass, **{options: {"cache_dir": tmp_path}})
    assert model.forms(space).stiffness.signature() == before


def distributed(A: sp.csr_matrix) -> PETSc.Mat:
    first, last = share(A.shape[0], MPI.COMM_WORLD)
    empty = PETSc.Mat().createAIJ(((last - first, A.shape[0]), (last - first, A.shape[0])), comm=MPI.COMM_WORLD)
    return sparse(sp.csr_matrix(A[first:last]), empty, columns=int(last - first))


def chain(n: int) -> sp.csr_matrix:
    """Stiffness of n masses between walls."""
    return sp.diags([-np.ones(n - 1), 2.0 * np.ones(n), -np.ones(n - 1)], [-1, 0, 1], format="csr")


@pytest.mark.mpi
def test_a_product_is_that_of_the_whole_matrices() -> None:
    rectangular = sp.random(30, 20, 0.3, format="csr", random_state=4)
    first, last = share(30, MPI.COMM_WORLD)
    low, high = share(20, MPI.COMM_WORLD)
    A = sparse(sp.csr_matrix(rectangular[first:last]), distributed(chain(30)), columns=int(high - low))
    X = np.random.default_rng(5).normal(size=(20, 3))
    assert times(A, X[low:high]) == pytest.approx((rectangular @ X)[first:last], abs=1e-14)


@pytest.mark.mpi
def test_products_leave_nothing_behind() -> None:
    A = distributed(chain(40_000))
    X = np.ones((A.getLocalSize()[0], 40))
    times(A, X)
    before = resident()
    for _ in range(10):
        times(A, X)
    assert resident() - before < 0.2 * 10 * 2 * X.nbytes / 2**20


@pytest.mark.slow
@pytest.mark.mpi
def test_a_factor_solves_without_its_matrix_and_goes_when_told() -> None:
    K = sp.csr_matrix(sp.kronsum(chain(100), chain(100)))
    load = K @ np.ones((10_000, 2))
    first, last = share(10_000, MPI.COMM_WORLD)
    before = 0.0
    for repeat in range(12):
        A = distributed(K)
        factor = Factor(A, "K")
        A.destroy()
        assert factor.solve_columns(load[first:last]) == pytest.approx(1.0, abs=1e-9)
        factor.destroy()
        if repeat == 1:
            before = resident()
    # left behind, each of them would take more than 20 numbers a coordinate
    assert resident() - before < 0.3 * 10 * 20 * 8 * 10_000 / 2**20 / MPI.COMM_WORLD.size
