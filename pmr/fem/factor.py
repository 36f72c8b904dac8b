"""Factors of symmetric positive definite matrices: distributed over ranks by MUMPS, or complete on each rank.

A matrix is factorised once, and its factor is then used for many solves.  With a complete factor, each rank solves for
its share of the right-hand sides and waits for no other rank meanwhile.  A factor that is distributed over two ranks
solves no faster than a factor on one rank: two fifths of its time go into sending the solutions to the ranks that own
their rows, for which PETSc sets up the communication anew at each call.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import numpy as np
from scipy.sparse.linalg import splu

from pmr.errors import InputError
from pmr.errors.environment import available_memory
from pmr.fem.compat import HAS_PETSC, MPI, PETSc
from pmr.fem.distributed import free_objects, view
from pmr.files.arrays import Array, Indices

_log = logging.getLogger(__name__)


#: Right-hand sides solved at once: one of them then takes a sixth of its time alone (18,000 coordinates).
BLOCK = 64
#: MUMPS' error codes (its manual, "Error and warning diagnostics"): the memory limit is too small; memory could not be
#: had within the limit, in the analysis, for integers, numbers or messages; files can't be written; the structure, a
#: pivot or its sign shows that the matrix is not positive definite.
TOO_LITTLE, NO_MEMORY, NO_FILES, NOT_DEFINITE = -19, (-5, -7, -8, -9, -11, -13, -14, -17, -20), -90, (-6, -10, -40)
#: PETSc's error code of a matrix in which CHOLMOD finds a pivot that is not positive.
ZERO_PIVOT = 81
#: Share of the free memory that a factor may take: solves and later steps need some too.
SHARE = 0.8
#: Entries of a factor over those of its matrix: almost no factor has more.
FILL = 20


class NotDefiniteError(InputError):
    """A matrix has no Cholesky factor; `name` is what messages call the matrix."""

    def __init__(self, name: str) -> None:
        super().__init__("body", name, None, "a positive definite matrix is allowed")


class _PetscFactor:
    """Factor of a matrix, stored by PETSc, and solves with it."""

    _factor: PETSc.Mat

    def solve(self, right: PETSc.Vec, answer: PETSc.Vec) -> None:
        """Solve for one right-hand side `right`, and write the solution to `answer`; collective."""
        self._factor.solve(right, answer)

    def solve_columns(self, columns: Array) -> Array:
        """Rows (n_local, k) on this rank of k solutions, from `columns` (n_local, k), its rows of the right-hand sides.

        Collective.  Right-hand sides in Fortran's order are not copied; the result is in that order.
        """
        result = np.empty(columns.shape, order="F")
        for k in range(0, columns.shape[1], BLOCK):
            right = view(np.asfortranarray(columns[:, k : k + BLOCK]), self._factor)
            answer = view(result[:, k : k + BLOCK], self._factor)
            self._factor.matSolve(right, answer)
            free_objects(right, answer)
        return result

    def destroy(self) -> None:
        """Free the factor's memory; collective."""
        self._factor.destroy()


class Factor(_PetscFactor):
    """Factor L L^T of a distributed matrix by MUMPS; collective.

    The memory for the factor is known before the factor is computed.  If the factor does not fit into the free memory,
    it is stored in files, and a warning is logged.  The environment variable MUMPS_OOC_TMPDIR names the folder.

    Raises a `NotDefiniteError` if the matrix, called `name`, is not positive definite.  Raises an `InputError` if its
    factor does not fit into the memory even with files, or if MUMPS fails for another reason.
    """

    def __init__(self, A: PETSc.Mat, name: str) -> None:
        """Factorise the matrix A (n, n), called `name` in messages, and mark A as positive definite; collective."""
        A.setOption(PETSc.Mat.Option.SPD, True)
        free = free_memory(A.comm.tompi4py())
        self._factor = factorise(A, min(free, ample(A)))
        if self._is_too_little() and free > ample(A):
            self._factor.destroy()
            self._factor = factorise(A, free)
        if self._is_too_little():
            needed = self._factor.getMumpsInfog(16)
            self._factor.destroy()
            self._factor = factorise(A, free, in_files=True)
            self._check_size(name, needed, free)
        code = self._factor.getMumpsInfog(1)
        if code < 0:
            raise refusal(name, code)

    def _is_too_little(self) -> bool:
        """Whether MUMPS was allowed less memory than the factor takes."""
        return bool(self._factor.getMumpsInfog(1) == TOO_LITTLE)

    def _check_size(self, name: str, needed: int, free: int) -> None:
        """Warn that the factor is stored in files; raise an `InputError` if the memory is too small even so.

        `name` is what messages call the matrix.  `needed` is the memory of the factor, and `free` the free memory, both
        in MB on a rank.
        """
        least = self._factor.getMumpsInfog(26)
        sizes = f"the factor of {name} takes {needed} MB of memory on a rank, and {free} MB are there for it"
        if self._is_too_little():
            allowed = (
                f"{sizes}, of which it takes {least} MB if kept in files; a coarser mesh or more memory is allowed"
            )
            raise InputError("scene", "mesh", None, allowed)
        if self._factor.comm.rank == 0:
            _log.warning("%s: it is kept in files, which takes %d MB of it and time for reading", sizes, least)


def product(A: PETSc.Mat, x: Array) -> Array:
    """Rows (n_local,) of A x that this rank owns, as a new array, from this rank's rows `x` (n_local,); collective."""
    right, result = A.createVecs()
    right.getArray()[:] = x
    A.mult(right, result)
    rows = np.array(result.getArray())
    right.destroy()  # at once: PETSc keeps an object that is merely dropped until all ranks clean up together
    result.destroy()
    return rows


class SequentialFactor(_PetscFactor):
    """Factor on one rank by CHOLMOD.  A solve with a single right-hand side takes half as long as by MUMPS.

    Raises a `NotDefiniteError` if CHOLMOD finds that the matrix, called `name`, is not positive definite; a small
    indefinite matrix may have a factor L D L^T all the same.  Raises an `InputError` if CHOLMOD fails for another
    reason, such as too little memory.
    """

    def __init__(self, A: PETSc.Mat, name: str) -> None:
        """Factorise the matrix A (n, n) on one rank; messages call it `name`."""
        A.setOption(PETSc.Mat.Option.SPD, True)
        pc = cholesky(A, "cholmod")
        try:
            pc.setUp()
        except PETSc.Error as error:
            if error.ierr == ZERO_PIVOT:
                raise NotDefiniteError(name) from None
            raise no_memory(name, str(error).splitlines()[-1].removeprefix("[0] ")) from None
        self._factor = pc.getFactorMatrix()
        pc.destroy()


class SparseFactor:
    """Factor L U of a matrix by SciPy's SuperLU with pivots on the diagonal, used if PETSc is not installed.

    Raises a `NotDefiniteError` if the matrix, called `name`, is not positive definite, and an `InputError` if its
    factor does not fit into the memory.
    """

    def __init__(self, A: PETSc.Mat, name: str) -> None:
        """Factorise the matrix A (n, n) of `pmr.fem.serial`; messages call it `name`."""
        A_csc, by = A.values.tocsc(), {"SymmetricMode": True}
        try:
            self._factor = splu(A_csc, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=by)
        except (RuntimeError, MemoryError) as error:  # SuperLU's failures to allocate are of both types
            raise (NotDefiniteError(name) if "singular" in str(error) else no_memory(name, "SuperLU")) from None
        if not np.array_equal(self._factor.perm_r, self._factor.perm_c) or self._factor.U.diagonal().min() <= 0.0:
            raise NotDefiniteError(name)

    def solve(self, right: PETSc.Vec, answer: PETSc.Vec) -> None:
        """Solve for one right-hand side `right`, and write the solution to `answer`."""
        answer.getArray()[:] = self._factor.solve(right.getArray())

    def solve_columns(self, columns: Array) -> Array:
        """Solutions (n, k), in Fortran's order, for the k right-hand sides `columns` (n, k)."""
        return np.asfortranarray(self._factor.solve(columns))

    def destroy(self) -> None:
        """Free the factor's memory."""
        self.__dict__.pop("_factor", None)


MatrixFactor = Factor | SequentialFactor | SparseFactor


def factor_of(A: PETSc.Mat, name: str) -> Factor | SparseFactor:
    """Factor of a symmetric positive definite matrix A by MUMPS, or by SciPy if PETSc is not installed; collective.

    Raises a `NotDefiniteError` if the matrix, called `name`, is not positive definite, and an `InputError` if its
    factor does not fit into the memory.
    """
    return Factor(A, name) if HAS_PETSC else SparseFactor(A, name)


def factor_for_steps(A: PETSc.Mat, name: str) -> MatrixFactor:
    """Factor of A for single right-hand sides, one after another: by CHOLMOD on one rank, otherwise by `factor_of`.

    A (n, n) is symmetric and is called `name` in messages.  CHOLMOD is taken only if PETSc was built with it.  Raises a
    `NotDefiniteError` if A is not positive definite, and an `InputError` if its factor does not fit into the memory.
    Collective.
    """
    if HAS_PETSC and A.comm.size == 1:
        with suppress(PETSc.Error):
            free_objects(cholesky(A, "cholmod"))
            return SequentialFactor(A, name)
    return factor_of(A, name)


def cholesky(A: PETSc.Mat, package: str) -> PETSc.PC:
    """PETSc preconditioner, not set up yet, that will compute the Cholesky factor of A by the named package.

    Raises a `PETSc.Error` if PETSc was built without the package.
    """
    pc = PETSc.PC().create(comm=A.comm)
    pc.setOperators(A)
    pc.setType("cholesky")
    pc.setFactorSolverType(package)
    pc.setFactorSetUpSolverType()
    return pc


def refusal(name: str, code: int) -> InputError:
    """Error to be raised for a matrix called `name` whose factorisation MUMPS ended with the negative error `code`."""
    if code in NOT_DEFINITE:
        return NotDefiniteError(name)
    allowed = f"the factor of {name} failed in MUMPS with error {code}"
    if code in (TOO_LITTLE, *NO_MEMORY):
        return no_memory(name, f"MUMPS {code}")
    if code == NO_FILES:
        allowed = (
            f"the factor of {name} can't be kept in files (MUMPS {code}); a folder in MUMPS_OOC_TMPDIR that can be "
            "written to and has room, a coarser mesh or more memory is allowed"
        )
    return InputError("scene", "mesh", None, allowed)


def no_memory(name: str, reason: str) -> InputError:
    """Error to be raised if the factor of the matrix called `name` does not fit into the memory.

    The message has the `reason` in brackets.
    """
    allowed = f"no memory for the factor of {name} ({reason}); a coarser mesh or more memory is allowed"
    return InputError("scene", "mesh", None, allowed)


def factorise(A: PETSc.Mat, free: int, in_files: bool = False) -> PETSc.Mat:
    """Factor of A by MUMPS in at most `free` MB of memory on a rank, 0 for no limit; collective.

    The factor is stored in files if `in_files`.  Errors of MUMPS are not raised: the caller finds a negative error code
    in ``getMumpsInfog(1)`` of the factor.  If the memory is too little, MUMPS says so before it computes anything.  The
    factor holds no reference to A.
    """
    pc = cholesky(A, "mumps")
    factor = pc.getFactorMatrix()
    factor.setMumpsIcntl(22, int(in_files))
    factor.setMumpsIcntl(23, free)
    factor.setMumpsIcntl(27, BLOCK)  # as many at once within MUMPS, instead of its 32: an eighth faster
    pc.setUp()
    pc.destroy()
    return factor


def ample(A: PETSc.Mat) -> int:
    """Memory in MB on a rank that suffices for the factors of most matrices of the size of A; collective.

    The result is at least 1000.  It serves as the limit of `factorise`, because MUMPS reserves half of what it is
    allowed, even if it needs less.
    """
    entries = A.getInfo(PETSc.Mat.InfoType.GLOBAL_MAX)["nz_used"]
    return max(1000, int(FILL * 12 * entries / 1e6))


def free_memory(comm: MPI.Comm) -> int:
    """Memory in MB that a factor may take on each rank, the same on all ranks; collective.

    On each machine, the share `SHARE` of its free memory is divided by the number of ranks there.  The result is the
    least of these values of all machines, and at least 1.  The result is 0, for no limit, if no machine says how much
    memory is free.
    """
    node = comm.Split_type(MPI.COMM_TYPE_SHARED)
    available = available_memory()
    share = np.inf if available is None else SHARE * available / 1e6 / node.size
    node.Free()
    least = comm.allreduce(share, MPI.MIN)
    return 0 if np.isinf(least) else max(1, int(least))


#: The factors of all ranks on a machine may together take this share of the memory that a single factor may take.
COPIES = 0.5

#: Most bytes in a message: MPI counts them in 32 bits.
LARGEST = 2**31 - 1


class TooLargeError(Exception):
    """A complete factor takes more memory than a rank has."""


class ReplicatedFactor:
    """Complete factor L L^T of a distributed matrix on each rank; collective.

    Raises
    ------
    TooLargeError
        On all ranks, if one rank lacks the memory.
    NotDefiniteError
        If the matrix, called `name`, is not positive definite.
    InputError
        If MUMPS fails for another reason.
    """

    def __init__(self, A: PETSc.Mat, name: str) -> None:
        """Factorise copies on all ranks of the distributed matrix A (n, n), called `name` in messages; collective."""
        comm = A.comm.tompi4py()
        self._exchange = Exchange(comm, A.getOwnershipRanges())
        copy = A.getRedundantMatrix(comm.size, PETSc.COMM_SELF)
        copy.setOption(PETSc.Mat.Option.SPD, True)
        free = free_memory(comm)
        share = max(1, int(COPIES * free)) if free else 0
        self._factor = factorise(copy, min(share, ample(copy)))
        free_objects(copy)
        codes = comm.allgather(self._factor.getMumpsInfog(1))
        if {TOO_LITTLE, *NO_MEMORY} & set(codes):
            needed = self._factor.getMumpsInfog(16)
            self.destroy()
            raise TooLargeError(f"the factor of {name} takes {needed} MB, {share} MB are there for it on each rank")
        if min(codes) < 0:
            raise refusal(name, min(codes))

    def solve_columns(self, columns: Array) -> Array:
        """Rows (n_local, k) on this rank of k solutions, from `columns` (n_local, k), its rows of the right-hand sides.

        Collective.  Right-hand sides in Fortran's order are overwritten by the solutions, which are returned.  The
        solve is fastest if the number of columns is a multiple of `BLOCK` times the number of ranks.
        """
        columns, many = np.asfortranarray(columns), self._exchange.ranks * min(BLOCK, self._exchange.most)
        for k in range(0, columns.shape[1], many):
            mine = self._exchange.columns(columns[:, k : k + many])
            if mine.size:  # if there are fewer columns than ranks, some ranks have none
                right, answer = view(mine, self._factor), view(mine, self._factor)
                self._factor.matSolve(right, answer)
                free_objects(right, answer)
            self._exchange.write_rows(mine, columns[:, k : k + many])
        return columns

    def destroy(self) -> None:
        """Free the factor's memory."""
        self._factor.destroy()


def factor_for_columns(A: PETSc.Mat, name: str) -> MatrixFactor | ReplicatedFactor:
    """Factor of A for many right-hand sides at a time; collective.

    On several ranks the factor is complete on each rank if it fits into the memory.  If it does not, a warning is
    logged, and `factor_of` computes a factor that is spread over the ranks.  On one rank `factor_of` is used, too.
    Messages call the matrix `name`.  Raises the errors of `factor_of`.
    """
    if A.comm.size > 1:
        try:
            return ReplicatedFactor(A, name)
        except TooLargeError as error:
            if A.comm.rank == 0:
                _log.warning("%s: it is spread over the ranks, which takes less memory and solves slower", error)
    return factor_of(A, name)


class Exchange:
    """Exchange of matrices (n, k) between ranks: from a distribution by rows to one by columns, and back.

    `ends` (ranks + 1,) has the number of the first row of each rank, and last the number n of rows.
    """

    def __init__(self, comm: MPI.Comm, ends: Indices) -> None:
        self._comm, self._ends, self.ranks = comm, np.asarray(ends), comm.size
        self.most = max(1, LARGEST // (8 * int(self._ends[-1])))  # columns for each rank at a time

    def columns(self, local: Array) -> Array:
        """This rank's columns (n, k_local) of a matrix (n, k), from its rows `local` (n_local, k) in Fortran's order.

        Each rank gets consecutive columns; the numbers of columns differ by at most one between ranks.  Collective.
        """
        full = np.empty((self._ends[-1], self._shares(local.shape[1])[self._comm.rank]), order="F")
        with self._parts(local, full) as (of_rows, of_columns):
            self._comm.Alltoallw(of_rows, of_columns)
        return full

    def write_rows(self, full: Array, local: Array) -> None:
        """Write this rank's rows to `local` (n_local, k) in Fortran's order, from its columns `full` (n, k_local).

        Collective; the method undoes `columns`.
        """
        with self._parts(local, full) as (of_rows, of_columns):
            self._comm.Alltoallw(of_columns, of_rows)

    @contextmanager
    def _parts(self, local: Array, full: Array) -> Iterator[tuple[tuple[object, ...], ...]]:
        """Yield MPI's descriptions of `local` (n_local, k), this rank's rows, and `full` (n, k_local), its columns.

        `local` is described by columns and `full` by rows, for one exchange.  Both descriptions refer to the arrays in
        place.  Their data types are freed on exit.
        """
        counts, number = len(local) * self._shares(local.shape[1]), MPI.DOUBLE
        begins = (np.cumsum(counts) - counts) * number.size
        kinds = [number.Create_vector(full.shape[1], h, len(full)).Commit() for h in np.diff(self._ends).tolist()]
        try:
            yield (
                (local.T, (counts, begins), [number] * self.ranks),
                (full.T, ([1] * self.ranks, self._ends[:-1] * number.size), kinds),
            )
        finally:
            for kind in kinds:
                kind.Free()

    def _shares(self, k: int) -> Indices:
        """Number of columns, out of k, that each rank owns, (ranks,); they differ by at most one."""
        return k // self.ranks + (np.arange(self.ranks) < k % self.ranks)
