"""Which rows depend on each other, or nearly so, by name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: A row takes part in a dependence if its share is at least this part of the largest one.
TAKES_PART = 1e-2


@dataclass(frozen=True)
class Dependence:
    """How independent rows are: `measure` is 1 for rows that share nothing and 0 for dependent ones; `names` of these.

    Of rows whose combination all but vanishes, only those are named that take part in it.
    """

    measure: float
    names: tuple[str, ...]


def of_rows(C: Array, names: Sequence[str]) -> Dependence:
    """Smallest singular value of the rows (m, r) scaled to unit length; a row that vanishes depends on nothing else."""
    size = np.linalg.norm(C, axis=1)
    if not size.all():
        return Dependence(0.0, tuple(name for name, length in zip(names, size, strict=True) if length == 0.0))
    U, sigma, _ = np.linalg.svd(C / size[:, None], full_matrices=True)
    measure = float(sigma[-1]) if len(sigma) == len(C) else 0.0
    return Dependence(measure, _involved_names(U[:, -1], names))


def of_flexibility(F: Array, names: Sequence[str]) -> Dependence:
    """Smallest eigenvalue of a symmetric flexibility (m, m) scaled to a unit diagonal."""
    diagonal = np.diagonal(F)
    if not np.all(diagonal > 0.0):
        return Dependence(0.0, tuple(name for name, d in zip(names, diagonal, strict=True) if not d > 0.0))
    scale = np.sqrt(diagonal)
    values, vectors = np.linalg.eigh(F / np.outer(scale, scale))
    return Dependence(float(values[0]), _involved_names(vectors[:, 0], names))


def _involved_names(shares: Array, names: Sequence[str]) -> tuple[str, ...]:
    large = np.abs(shares) >= TAKES_PART * np.abs(shares).max()
    return tuple(name for name, takes_part in zip(names, large, strict=True) if takes_part)
