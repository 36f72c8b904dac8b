"""What no reduced model of a structure has: arrays that contradict each other, values that are none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.errors.text import LONGEST_NAME, is_name

#: Share of the largest entry up to which a matrix may be asymmetric, or an eigenvalue negative: far above round-off.
SYMMETRIC = 1e-6
#: Letters of a name made of several.
LONGEST = 4 * LONGEST_NAME


def misfit(part: Any, sizes: Mapping[str, int], prefix: str = "") -> str | None:
    """Describe what is wrong with the arrays, names and piecewise polynomials of a dataclass; None: nothing.

    Its ``AXES`` give a letter for each axis, such as ``{"rows": "mr"}`` for values (m, r).  What a letter stands for,
    unless `sizes` says it, does its first axis.  Parts within the part that have such a table follow.
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
    within = (misfit(inner, sizes, f"{prefix}{name}.") for name, inner in parts.items() if hasattr(inner, "AXES"))
    return next((wrong for wrong in within if wrong), None)


def misshapen(field: str, matrices: Mapping[str, NDArray[np.float64]], size: int) -> str | None:
    """Describe matrices by name of which one is not (size, size) or not finite."""
    for name, A in matrices.items():
        if A.shape != (size, size) or not np.isfinite(A).all():
            return f"{field}.{name} has shape {A.shape} or is not finite, {(size, size)} is allowed"
    return None


def describe_names(field: str, names: Any) -> str | None:
    """Describe a field's names of which one is none (`pmr.errors.text.is_name`)."""
    wrong = [name for name in names if not is_name(name, LONGEST)] if isinstance(names, tuple) else []
    return f"{field} holds {wrong[0]!r:.60}, which is no name" if wrong else None


def symmetric(A: NDArray[np.float64]) -> NDArray[np.float64]:
    """Matrices (..., n, n) without what round-off leaves of an asymmetry."""
    return (A + A.swapaxes(-2, -1)) / 2.0


def pivoted_root(A: NDArray[np.float64]) -> NDArray[np.float64]:
    """L (n, r) with A = L L^T but for round-off, of a positive semidefinite A of rank r, by Cholesky with pivots."""
    factor, pivots, rank, _ = scipy.linalg.lapack.dpstrf(A, lower=1)
    L = np.zeros((len(A), rank))
    L[pivots - 1] = np.tril(factor)[:, :rank]
    return L


def asymmetry(matrices: Mapping[str, NDArray[np.float64]]) -> str | None:
    """Describe a mass, damping or stiffness that is not positive, which lets motions grow."""
    for name, matrix in matrices.items():
        size = np.abs(matrix).max(initial=0.0)
        if np.abs(matrix - matrix.T).max(initial=0.0) > SYMMETRIC * size:
            return f"{name} is not symmetric"
        lowest = np.linalg.eigvalsh(matrix / size)[0] if size else 0.0
        if lowest < -SYMMETRIC or (name == "M" and lowest <= 0.0):
            return f"{name} has a negative eigenvalue" if lowest < 0.0 else f"{name} is singular"
    return None
