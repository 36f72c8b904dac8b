r"""Mirror images: of a body that is symmetric, mirrored loads have mirrored answers.

With the image P q of a motion q in a plane across y or z, a signed permutation,

.. math::
    P M P^T = M, \quad P K P^T = K \quad \Rightarrow \quad R\, (P g) = P\, (R\, g)

for any R that M and K make.  Whether a body is symmetric, what holds it and what it carries included, is decided by
these equations, on two random vectors.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pmr.fem.compat import PETSc
from pmr.fem.distributed import times
from pmr.mesh.nodes import Nodes
from pmr.models import StructuralModel

Array = NDArray[np.float64]

#: Nodes and their images may be apart by this share of the body's length, K and its image by this share of K x: meshes
#: that are read have some 11 digits.
NODES, OPERATORS = 1e-8, 1e-10


def mirror_images(model: StructuralModel, T: sp.csr_matrix, M: PETSc.Mat, K: PETSc.Mat) -> tuple[sp.csr_matrix, ...]:
    """P (n, n) of each plane of symmetry across y or z, of coordinates z with q = T z.

    The same on every rank; collective.
    """
    nodes = getattr(model, "nodes", None)
    if not isinstance(nodes, Nodes) or T.nnz != T.shape[1]:  # with rigid couplings coordinates are not those of nodes
        return ()
    images = (_image(nodes, axis) for axis in (1, 2))
    on_free = (sp.csr_matrix(T.T @ P @ T) for P in images if P is not None)
    return tuple(P for P in on_free if P.nnz == len(P.indptr) - 1 and all(_unchanged(A, P) for A in (M, K)))


def _image(nodes: Nodes, axis: int) -> sp.csr_matrix | None:
    """P for the plane across an axis in the middle of the nodes; None where a node has no image."""
    first = np.flatnonzero(nodes.component == 0)  # of each node; its other coordinates follow
    node, places = np.cumsum(nodes.component == 0) - 1, nodes.at[first]
    low, high = places.min(axis=0), places.max(axis=0)
    mirrored = places.copy()
    mirrored[:, axis] = low[axis] + high[axis] - places[:, axis]
    apart, image = cKDTree(places).query(mirrored)
    counts = np.bincount(node)
    if apart.max() > NODES * (high - low).max() or not np.array_equal(counts[image], counts):
        return None
    number = np.arange(nodes.size)
    columns = first[image[node]] + number - first[node]
    if not np.array_equal(np.sort(columns), number) or not np.array_equal(nodes.component[columns], nodes.component):
        return None
    sign = np.ones(6)  # rotations are axial vectors: those about the axis stay
    sign[[axis, *(3 + other for other in range(3) if other != axis)]] = -1.0
    return sp.csr_matrix((sign[nodes.component], columns, np.arange(nodes.size + 1)), (nodes.size, nodes.size))


def _unchanged(A: PETSc.Mat, P: sp.csr_matrix) -> bool:
    """Whether A P x = P A x; collective."""
    comm, share = A.comm.tompi4py(), slice(*A.getOwnershipRange())
    x = np.random.default_rng(5).uniform(-1.0, 1.0, (P.shape[0], 2))
    of_image, image_of = (np.concatenate(comm.allgather(times(A, np.asfortranarray(y[share])))) for y in (P @ x, x))
    return bool(np.abs(of_image - P @ image_of).max() <= OPERATORS * np.abs(image_of).max())
