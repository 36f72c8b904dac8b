"""Checks of reduced models: arrays that contradict each other, and values that no model of a structure has."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.errors.text import LONGEST_NAME, is_name

#: Deviation from symmetry, and size of a negative eigenvalue, that are allowed relative to the largest entry.
SYMMETRIC = 1e-6
#: Most letters of a name that is composed of several names.
LONGEST = 4 * LONGEST_NAME


def describe_misfit(part: Any, sizes: Mapping[str, int], prefix: str = "") -> str | None:
    """Description of what is wrong with the arrays, names and tables of a dataclass; None if nothing is wrong.

    Its ``AXES`` have a letter for each axis, such as ``{"rows": "mr"}`` for values (m, r).  The size of a letter is
    taken from `sizes`, or else from the first axis with this letter.  Fields that are dataclasses with ``AXES`` of
    their own are checked too.
    """
    sizes = dict(sizes)
    for name, axes in part.AXES.items():
        value = getattr(part, name)
        if value is None:
            continue
        if wrong := describe_names(name, value):
            return prefix + wrong
        values, has = (value.c, value.c.shape[2:]) if isinstance(value, PPoly) else (value, np.shape(value))
        if len(has) != len(axes):
            return f"{prefix}{name} has shape {has}, {len(axes)} axes are allowed"
        for letter, size in zip(axes, has, strict=True):
            sizes.setdefault(letter, size)
        if has != (allowed := tuple(sizes[letter] for letter in axes)):
            return f"{prefix}{name} has shape {has}, {allowed} is allowed"
        if not isinstance(value, tuple) and not np.isfinite(values).all():
            return f"{prefix}{name} is not finite"
        if isinstance(value, PPoly) and not (np.all(np.diff(value.x) > 0.0) and np.isfinite(value.x).all()):
            return f"the breaks of {prefix}{name} do not increase"
    parts = {field.name: getattr(part, field.name) for field in fields(part)}
    within = (
        describe_misfit(inner, sizes, f"{prefix}{name}.") for name, inner in parts.items() if hasattr(inner, "AXES")
    )
    return next((wrong for wrong in within if wrong), None)


def describe_misshapen(field: str, matrices: Mapping[str, NDArray[np.float64]], size: int) -> str | None:
    """Description of the first matrix that is not (size, size) or not finite; None if there is none."""
    for name, A in matrices.items():
        if A.shape != (size, size) or not np.isfinite(A).all():
            return f"{field}.{name} has shape {A.shape} or is not finite, {(size, size)} is allowed"
    return None


def describe_names(field: str, names: object) -> str | None:
    """Description of the first entry that is no name (`pmr.errors.text.is_name`); None if there is none.

    None is also returned if `names` is no tuple.
    """
    wrong = [name for name in names if not is_name(name, LONGEST)] if isinstance(names, tuple) else []
    return f"{field} holds {wrong[0]!r:.60}, which is not a name" if wrong else None


def symmetric_part(A: NDArray[np.float64]) -> NDArray[np.float64]:
    """Symmetric part (A + A^T) / 2 of matrices (..., n, n), which removes round-off."""
    return (A + A.swapaxes(-2, -1)) / 2.0


def pivoted_cholesky(A: NDArray[np.float64]) -> NDArray[np.float64]:
    """Factor L (n, r) of a positive semidefinite matrix A = L L^T (n, n) of rank r, by pivoted Cholesky.

    The product equals A up to round-off.
    """
    factor, pivots, rank, _ = scipy.linalg.lapack.dpstrf(A, lower=1)
    L = np.zeros((len(A), rank))
    L[pivots - 1] = np.tril(factor)[:, :rank]
    return L


def describe_asymmetry(matrices: Mapping[str, NDArray[np.float64]]) -> str | None:
    """Description of the first matrix that is not symmetric or has a negative eigenvalue; None if there is none.

    The matrix called M must not be singular either.  Deviations up to `SYMMETRIC` of the largest entry count as
    round-off.
    """
    for name, matrix in matrices.items():
        size = np.abs(matrix).max(initial=0.0)
        if np.abs(matrix - matrix.T).max(initial=0.0) > SYMMETRIC * size:
            return f"{name} is not symmetric"
        lowest = np.linalg.eigvalsh(matrix / size)[0] if size else 0.0
        if lowest < -SYMMETRIC or (name == "M" and lowest <= 0.0):
            return f"{name} has a negative eigenvalue" if lowest < 0.0 else f"{name} is singular"
    return None
