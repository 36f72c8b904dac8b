"""A basis of one's own: vectors from a file or of an installed package, orthonormal in their order."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError, plugins
from pmr.fem.distributed import inner, tall, times
from pmr.files import npz
from pmr.fullmodel.model import FullModel
from pmr.reduction.basis import Basis
from pmr.reduction.snapshots import Snapshots
from pmr.reduction.snapshots.free_body import rigid_modes
from pmr.scene import Reduction
from pmr.scene.asked import OwnBasis

Array = NDArray[np.float64]
#: Vectors (n, k) on the coordinates of a full model, or a function of the model that returns this rank's rows of them.
Vectors: TypeAlias = Array | Callable[[FullModel], Array]
#: A vector of which a smaller share is left beside those before it depends on them.
DEPENDENT = 1e-10


def given_vectors(model: FullModel, file: Path) -> Snapshots:
    """Vectors (n, k) on the full model's coordinates: the array ``V`` of an npz file, read by every rank.

    Raises an `InputError` if the file holds no such array, or entries that are not finite.
    """
    try:
        V = np.asarray(npz.read(file)["V"], dtype=float)
    except (KeyError, ValueError, TypeError) as error:
        raise InputError(str(file), "V", None, f"an npz file with an array V is allowed ({error})") from None
    if V.ndim != 2 or V.shape[0] != model.size or V.shape[1] == 0:
        allowed = f"a row for each of the model's {model.size} coordinates, and at least one column, are allowed"
        raise InputError(str(file), "V", list(V.shape), allowed)
    if not np.isfinite(V).all():
        raise InputError(str(file), "V", None, "finite entries are allowed")
    return _snapshots(model, V[slice(*model.M.getOwnershipRange())], f"vectors from {file.name}")


def vectors_of(model: FullModel, basis: Vectors) -> Snapshots:
    """Snapshots from an array (n, k) on all coordinates of the full model, or from what a function makes of the model.

    Every rank has the whole array. A function returns this rank's rows (n_local, k) alone.

    Raises
    ------
    InputError
        If the array has another number of rows, no column, or entries that are not finite.
    """
    share = model.share
    if callable(basis):
        local, rows = np.asarray(basis(model), dtype=float), share.stop - share.start
    else:
        local, rows = np.asarray(basis, dtype=float), model.size
    fits = local.ndim == 2 and local.shape[0] == rows and local.shape[1] > 0 and bool(np.isfinite(local).all())
    if not all(model.comm.allgather(fits)):
        allowed = f"finite vectors as columns, with {rows} rows, one for each coordinate of the full model, are allowed"
        raise InputError("pmr.reduce", "basis", list(local.shape), allowed)
    return _snapshots(model, local if callable(basis) else local[share], "vectors given as an array")


def offered_vectors(model: FullModel, choice: Reduction) -> Snapshots:
    """Vectors by a function of an installed package, an entry point `pmr.bases` of the basis' name; collective.

    It gets the model and what the scene says of the reduction, and returns this rank's rows (n_local, k) of vectors.

    Raises an `InputError` if there is none of that name, or it returns anything else.
    """
    make = plugins.one_of("pmr.bases", choice.basis, frozenset(get_args(OwnBasis)))
    if not callable(make):
        raise plugins.plugin_error("pmr.bases", choice.basis)
    first, last = model.M.getOwnershipRange()
    V, failed = np.empty((0, 0)), ""
    try:
        returned = np.asarray(make(model, choice))
        if returned.dtype.kind in "biuf":
            V = returned.astype(float)
    except Exception as error:  # whatever the package does: every rank has to hear of it
        failed = f"it failed: {error!r}"
    fits = V.ndim == 2 and V.shape[0] == last - first and V.shape[1] > 0 and bool(np.isfinite(V).all())
    if not all(model.comm.allgather(fits)):
        allowed = f"finite vectors (n, k) of real numbers with {last - first} rows here are allowed"
        raise plugins.plugin_error("pmr.bases", choice.basis, failed or allowed)
    return _snapshots(model, V, f"vectors of {choice.basis}")


def _snapshots(model: FullModel, local: Array, source: str) -> Snapshots:
    """Snapshots of vectors of which nothing is known but this rank's rows."""
    unknown = np.full(local.shape[1], np.nan)
    return Snapshots.of(np.ascontiguousarray(local), model, unknown, unknown, unknown, source)


def given_basis(model: FullModel, vectors: Snapshots, choice: Reduction, size: int | None) -> Basis:
    """The first `size` of the vectors, or all independent ones, each made orthonormal to those before it; collective.

    Where flexibility is added, rigid-body modes come first: it can't stand in for them.  All singular values are 1, for
    nothing is known of how much a vector weighs.

    Raises an `InputError` if there are fewer vectors, or one depends on those before it.
    """
    V = np.array(vectors.S.getDenseArray())
    largest = np.max(model.comm.allgather(np.abs(V).max(axis=0, initial=0.0)), axis=0)
    V /= np.where(largest > 0.0, largest, 1.0)  # squares neither vanish nor overflow
    if choice.flexibility:
        V = np.hstack([rigid_modes(model), V])
    in_mass = choice.product == "mass"
    Q = np.zeros((len(V), 0))
    for v in V.T:
        if Q.shape[1] == size:
            break
        size_before = size_after = _size(model, v, in_mass)
        for _ in range(2):  # once leaves round-off of what was taken away
            if size_after <= DEPENDENT * size_before:
                break
            v = v - Q @ inner(Q, _weigh(model, v, in_mass), model.comm)[:, 0]
            size_after = _size(model, v, in_mass)
        if size_after > DEPENDENT * size_before:
            Q = np.column_stack([Q, v / size_after])
    if size is not None and Q.shape[1] < size:
        allowed = f"the vectors and rigid-body modes span {Q.shape[1]} dimensions; at most so many are allowed"
        raise InputError("scene", "reduction.coordinates", size, allowed)
    return Basis(tall(np.ascontiguousarray(Q), model.M), np.ones(Q.shape[1]), choice.product)


def _weigh(model: FullModel, v: Array, in_mass: bool) -> Array:
    return times(model.M, v[:, None]) if in_mass else v[:, None]


def _size(model: FullModel, v: Array, in_mass: bool) -> float:
    return float(np.sqrt(inner(v[:, None], _weigh(model, v, in_mass), model.comm).item()))
