r"""A reduced model as the arrays of a file, in which nothing is stored twice.

The arrays are those of `pmr.files.npz`, with two exceptions.  If a table over the path follows from values on the
carriers, as :math:`C = b\, (U V)` and :math:`G = b\, R\, b^T` do (`pmr.system.rows`), only its breaks are stored, not
its coefficients.  For a symmetric matrix between carriers, or between vectors, only the lower triangle is stored, row
by row, as ``name.triangle``; for an antisymmetric matrix, as ``name.antitriangle``.

Files of earlier versions store all arrays in full, and are read as they are.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.files import npz
from pmr.files.arrays import Array
from pmr.system.carriers import CarrierRows
from pmr.system.soundness import describe_misfit

#: Prefix of arrays that may be written as triangles, and smallest size of such matrices.
TRIANGLES, LEAST = "carriers.", 8
_SIGNS = {"triangle": 1.0, "antitriangle": -1.0}


def pack(model: Any, prefix: str = "") -> dict[str, NDArray[Any]]:
    """Arrays (any shape) of a `pmr.system.reduced_model.ReducedModel` to be stored, by `prefix` and the field's name.

    Triangles and tables are shortened as the module's docstring says.
    """
    content = npz.record_arrays(model)
    sound = model.carriers is not None and not _describe_fault(model.carriers)
    for name, table in (_path_tables(model.carriers, content) if model.carriers and sound else {}).items():
        if np.array_equal(table.c, content[f"{name}.coefficients"]):
            del content[f"{name}.coefficients"]
    compact = dict[str, NDArray[Any]]()
    for name, array in content.items():
        kind = _triangle_kind(array) if name.startswith(TRIANGLES) else None
        if kind is None:
            compact[prefix + name] = array
        else:
            compact[f"{prefix}{name}.{kind}"] = array[np.tril_indices(len(array))]
    return compact


def unpack(data: Mapping[str, NDArray[Any]], prefix: str = "") -> dict[str, NDArray[Any]]:
    """Arrays (any shape) of a model in full, by the field's name, from those of a file that begin with `prefix`.

    `data` are all arrays of the file.  The arrays are as `pmr.files.npz.record_from_arrays` reads them, and its errors
    are raised.  A ValueError is raised if tables are missing and carriers are not sound, or if a triangle has a wrong
    number of entries.
    """
    content = dict[str, NDArray[Any]]()
    for name, array in data.items():
        if name.startswith(prefix):
            name = name.removeprefix(prefix)
            stem, _, kind = name.rpartition(".")
            if kind in _SIGNS and name.startswith(TRIANGLES):
                content[stem] = _unpack_triangle(array, _SIGNS[kind])
            else:
                content[name] = array
    tables = {name.removesuffix(".breaks") for name in content if name.endswith(".breaks")}
    if any(f"{name}.coefficients" not in content for name in tables) and any(
        name.startswith(TRIANGLES) for name in content
    ):
        carriers = npz.record_from_arrays(CarrierRows, content, TRIANGLES)
        if wrong := _describe_fault(carriers):
            raise ValueError(wrong)
        for name, table in _path_tables(carriers, content).items():
            content.setdefault(f"{name}.coefficients", table.c)
    return {prefix + name: array for name, array in content.items()}


def _describe_fault(carriers: CarrierRows) -> str | None:
    """Description of the carriers' first fault; None if tables can be computed from the carriers."""
    return describe_misfit(carriers, {}, TRIANGLES) or carriers.contradiction(len(carriers.breaks))


def _path_tables(carriers: CarrierRows, arrays: Mapping[str, NDArray[Any]]) -> dict[str, PPoly]:
    """Tables that follow from values on the carriers, by their names in the file.

    The tables have the breaks of the rows in `arrays`; tables that have other breaks in `arrays` are left out.  The
    result is empty if the carriers or `arrays` have no breaks.
    """
    breaks = arrays.get("rows.breaks")
    if not carriers.breaks or breaks is None:
        return {}
    C = carriers.polynomials(breaks)
    tables = {"rows": C.times(carriers.values)}
    if carriers.flexibility is not None:
        products = carriers.flexibility.tables(C)
        tables |= {f"flexibility.{name}": getattr(products, name) for name in ("rows", "inputs", "outputs")}
    on_breaks = [name for name in tables if np.array_equal(arrays.get(f"{name}.breaks", ()), breaks)]
    return {name: tables[name] for name in on_breaks}


def _triangle_kind(A: Array) -> str | None:
    """``triangle`` if A (n, n) is symmetric, ``antitriangle`` if A is antisymmetric.

    None for other arrays and for matrices with fewer than `LEAST` rows.
    """
    if A.ndim != 2 or A.shape[0] != A.shape[1] or len(A) < LEAST:
        return None
    return next((kind for kind, sign in _SIGNS.items() if np.array_equal(A, sign * A.T)), None)


def _unpack_triangle(triangle: Array, sign: float) -> Array:
    """Matrix (n, n) with the lower triangle `triangle`, row by row; `sign` is 1 if symmetric, -1 if antisymmetric.

    Raises ValueError if `triangle` has another length than n (n + 1) / 2.
    """
    n = int((np.sqrt(8.0 * triangle.size + 1.0) - 1.0) / 2.0 + 0.5)
    if triangle.shape != (n * (n + 1) // 2,):
        raise ValueError(f"{triangle.shape} is not the shape of a triangle of a matrix")
    square, below = np.empty((n, n)), np.tri(n, dtype=bool)
    square.T[below] = sign * triangle
    square[below] = triangle
    return square
