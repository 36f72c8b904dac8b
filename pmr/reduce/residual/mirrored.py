"""Loads that are mirror images of each other: the answer to one is the image of the other's."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.fem.compat import PETSc
from pmr.fem.distributed import freed, sparse, times

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Loads on carriers and their images may be apart by this share of their largest entry.
SAME = 1e-9


@dataclass(frozen=True)
class Image:
    """A mirror image P, or several after each other, and the carriers' images among them.

    Attributes
    ----------
    P : (n, n) sparse matrix
    partners : (K,) array
        Number of the carrier that is the image of each; -1 where none is.
    """

    P: sp.csr_matrix
    partners: Indices


@dataclass(frozen=True)
class Answers:
    """Numbers of loads, and this rank's rows (n_local, k) of the answers to them."""

    numbers: Indices
    columns: Array


def images_of(carriers: sp.csr_matrix, mirrors: Sequence[sp.csr_matrix]) -> list[Image]:
    """Of all mirrors and their products."""
    whole: list[sp.csr_matrix] = []
    for P in mirrors:
        whole += [P, *(sp.csr_matrix(P @ other) for other in whole)]
    return [Image(P, _partners(carriers, P)) for P in whole]


def _partners(U: sp.csr_matrix, P: sp.csr_matrix) -> Indices:
    V, found = sp.csr_matrix(U @ P.T), np.full(U.shape[0], -1)
    size = np.asarray(U.multiply(U).sum(axis=1)).ravel()
    shared = sp.coo_matrix(V @ U.T)
    apart = size[shared.row] + size[shared.col] - 2.0 * shared.data
    order = np.lexsort((apart, shared.row))
    nearest = order[np.unique(shared.row[order], return_index=True)[1]]
    rows, partners = shared.row[nearest], shared.col[nearest]
    difference, largest = (abs(A).max(axis=1).toarray().ravel() for A in (V[rows] - U[partners], U[partners]))
    same = difference <= SAME * largest
    found[rows[same]] = partners[same]
    return found


class Orbits:
    """Loads in the order of `order`, of which those that are images of earlier ones need no answer of their own."""

    def __init__(self, order: Indices, images: Sequence[Image], like: PETSc.Mat) -> None:
        self._images, self._like = images, like
        covered, own = np.zeros(len(order), bool), []
        self._of = [dict[int, int]() for _ in images]
        for load in order.tolist():
            if covered[load]:
                continue
            own.append(load)
            covered[load] = True
            for image, of in zip(images, self._of, strict=True):
                partner = int(image.partners[load]) if load < len(image.partners) else -1
                if partner >= 0 and not covered[partner]:
                    covered[partner] = True
                    of[load] = partner
        self.own = np.array(own, np.int64)

    def answers(self, numbers: Indices, columns: Array) -> Iterator[Answers]:
        """Those to loads of their own, as given, then to their images; collective."""
        yield Answers(numbers, columns)
        first, last = self._like.getOwnershipRange()
        for image, of in zip(self._images, self._of, strict=True):
            at = [k for k, load in enumerate(numbers.tolist()) if load in of]
            if at:
                P = sparse(image.P[first:last], self._like, columns=last - first)
                mirrored = times(P, columns[:, at])
                freed(P)
                yield Answers(np.array([of[load] for load in numbers[at].tolist()]), mirrored)
