"""A factor that every rank holds whole: each answers its share of the columns, and waits for nobody while it solves.

A factor that is spread over two ranks solves no faster than on one, and two fifths of its time go into how the answers
reach the ranks that own their rows, which PETSc finds out anew at each call.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.fem.compat import MPI, PETSc
from pmr.fem.distributed import free_objects, view
from pmr.fem.factor import BLOCK, NO_MEMORY, TOO_LITTLE, AnyFactor, ample, factor_of, factorise, free_memory, refusal

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
_log = logging.getLogger(__name__)

#: Share of the memory that one factor could have which the factors of all ranks on a machine may take together.
COPIES = 0.5

#: Bytes in a message: MPI counts them in 32 bits.
LARGEST = 2**31 - 1


class TooLargeError(Exception):
    """The whole factor takes more memory than a rank has for it."""


class ReplicatedFactor:
    """L L^T of a distributed matrix on each rank.

    Raises
    ------
    TooLargeError
        On all ranks, if it is so on one.
    NotDefiniteError
        If the matrix, called `name`, is not positive definite.
    """

    def __init__(self, A: PETSc.Mat, name: str) -> None:
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
        """Solve for right-hand sides in Fortran's order in place: they become the answers.

        Best of as many times `BLOCK` columns as there are ranks.
        """
        columns, many = np.asfortranarray(columns), self._exchange.ranks * min(BLOCK, self._exchange.most)
        for k in range(0, columns.shape[1], many):
            mine = self._exchange.columns(columns[:, k : k + many])
            if mine.size:  # fewer columns than ranks leave some without
                right, answer = view(mine, self._factor), view(mine, self._factor)
                self._factor.matSolve(right, answer)
                free_objects(right, answer)
            self._exchange.rows(mine, columns[:, k : k + many])
        return columns

    def destroy(self) -> None:
        """Give the factor's memory back."""
        self._factor.destroy()


def factor_for_columns(A: PETSc.Mat, name: str) -> AnyFactor | ReplicatedFactor:
    """A factor for many columns at a time: of several ranks each holds it whole, where that fits into memory."""
    if A.comm.size > 1:
        try:
            return ReplicatedFactor(A, name)
        except TooLargeError as error:
            if A.comm.rank == 0:
                _log.warning("%s: it is spread over the ranks, which takes less memory and solves slower", error)
    return factor_of(A, name)


class Exchange:
    """Tall matrices (n, k) between ranks that own rows, as `ends` (ranks + 1,) has them, and ranks that own columns."""

    def __init__(self, comm: MPI.Comm, ends: Indices) -> None:
        self._comm, self._ends, self.ranks = comm, np.asarray(ends), comm.size
        self.most = max(1, LARGEST // (8 * int(self._ends[-1])))  # columns for each rank at a time

    def columns(self, local: Array) -> Array:
        """This rank's columns (n, k_own) of a matrix given by this rank's rows (n_local, k) in Fortran's order."""
        full = np.empty((self._ends[-1], self._shares(local.shape[1])[self._comm.rank]), order="F")
        with self._parts(local, full) as (of_rows, of_columns):
            self._comm.Alltoallw(of_rows, of_columns)
        return full

    def rows(self, full: Array, local: Array) -> None:
        """Reverse `columns`: write this rank's rows to `local` (n_local, k) in Fortran's order."""
        with self._parts(local, full) as (of_rows, of_columns):
            self._comm.Alltoallw(of_columns, of_rows)

    @contextmanager
    def _parts(self, local: Array, full: Array) -> Iterator[tuple[Any, Any]]:
        """Describe what this rank exchanges with each other one, in place: its rows' columns and its columns' rows."""
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
        """How many of k columns each rank has."""
        return k // self.ranks + (np.arange(self.ranks) < k % self.ranks)
