"""A reduced model with its sliders held at places, as matrices of Nastran: DMIG entries, or OUTPUT4."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pmr.export.formats import Options
from pmr.export.state_space import StateSpace, held_at
from pmr.files.whole import replacement

Array = NDArray[np.float64]
#: Letters of a wide field: 10 to 12 digits fit.
FIELD = 16
_SQUARE, _RECTANGULAR, _SYMMETRIC = 1, 2, 6
_RECTANGULAR_DMIG, _DOUBLE = 9, 2


@dataclass(frozen=True)
class _Named:
    """A matrix: what its name begins with, the number of its place, its form as OUTPUT4 counts."""

    letter: str
    number: str
    A: Array
    form: int


def write_dmig(npz_path: Path, target: Path, options: Options) -> Path:
    """Write M, D and for each place K and the loads, in modal coordinates on the scalar points 1 to r.

    A field holds ten digits or more; what it leaves of a matrix stands in a second one, so that their sum, as Nastran
    takes it (``K2GG = K1, KL1``), has all digits.

    Raises InputError as `pmr.export.state_space.held_at`.
    """
    return _write(npz_path, target, options, _deck)


def write_output4(npz_path: Path, target: Path, options: Options) -> Path:
    """Write all matrices, whole and with all digits, as text of OUTPUT4; raises InputError as `write_dmig`."""
    return _write(npz_path, target, options, _output4)


def _write(npz_path: Path, target: Path, options: Options, lines: Callable[[StateSpace], Iterator[str]]) -> Path:
    space = held_at(npz_path, options)
    with replacement(target) as part:
        part.write_text("\n".join([*lines(space), ""]), encoding="utf-8")
    return target


def _matrices(space: StateSpace) -> Iterator[_Named]:
    r = space.A.shape[1] // 2
    yield _Named("M", "", np.eye(r), _SYMMETRIC)
    damping = -space.A[0, r:, r:]
    yield _Named("D", "", damping, _SYMMETRIC if np.array_equal(damping, damping.T) else _SQUARE)
    for k in range(len(space.s)):
        stiffness = -space.A[k, r:, :r]
        yield _Named("K", str(k + 1), (stiffness + stiffness.T) / 2.0, _SYMMETRIC)
        yield _Named("F", str(k + 1), space.B[k, r:], _RECTANGULAR)


def _deck(space: StateSpace) -> Iterator[str]:
    r = space.A.shape[1] // 2
    yield "$ A reduced model in modal coordinates (modal mass 1 kg), SI units; each matrix is the sum of two."
    yield "$ M2GG = M, ML    B2GG = D, DL    K2GG = K1, KL1 at the first place, and so on; F1, FL1: loads."
    yield from (f"$ Load {k}: {name}".encode("ascii", "replace").decode() for k, name in enumerate(space.inputs, 1))
    for k in range(len(space.s)):
        yield f"$ Place {k + 1}: {space.place(k)}".encode("ascii", "replace").decode()
    yield f"SPOINT  {1:<8d}THRU    {r:<8d}"
    for matrix in _matrices(space):
        form = _RECTANGULAR_DMIG if matrix.form == _RECTANGULAR else matrix.form
        yield from _both(matrix.letter, matrix.number, matrix.A, form)


def _output4(space: StateSpace) -> Iterator[str]:
    for matrix in _matrices(space):
        rows, columns = matrix.A.shape
        yield f"{columns:8d}{rows:8d}{matrix.form:8d}{_DOUBLE:8d}{matrix.letter + matrix.number:<8}1P,3E24.16"
        for j in range(columns):
            nonzero = np.flatnonzero(matrix.A[:, j])
            if nonzero.size:
                values = matrix.A[nonzero[0] : nonzero[-1] + 1, j]
                yield f"{j + 1:8d}{nonzero[0] + 1:8d}{len(values):8d}"
                yield from ("".join(f"{x:24.16E}" for x in values[k : k + 3]) for k in range(0, len(values), 3))
        yield f"{columns + 1:8d}{1:8d}{1:8d}"
        yield f"{1.0:24.16E}"


def _both(letter: str, number: str, A: Array, form: int) -> Iterator[str]:
    """A matrix, and what its fields leave of it."""
    rounded = np.vectorize(lambda x: float(_field(x).replace("D", "e")), otypes=[float])(A)
    yield from _matrix(f"{letter}{number}", A, form)
    yield from _matrix(f"{letter}L{number}", A - rounded, form)


def _matrix(name: str, A: Array, form: int) -> Iterator[str]:
    columns = f"{A.shape[1]:<8d}" if form == _RECTANGULAR_DMIG else ""
    yield f"DMIG    {name:<8}{0:<8d}{form:<8d}{_DOUBLE:<8d}{_DOUBLE:<8d}{'':<16}{columns}".rstrip()
    for j in range(A.shape[1]):
        rows = [i for i in range(j if form == _SYMMETRIC else 0, len(A)) if A[i, j] != 0.0 or (i == j)]
        if rows:
            yield f"{'DMIG*':<8}{name:<16}{j + 1:<16d}{0:<16d}"
        for i in rows:
            yield f"{'*':<8}{i + 1:<16d}{0:<16d}{_field(A[i, j]):<16}"


def _field(x: float) -> str:
    """A number with as many digits as a field has room for."""
    for digits in range(FIELD, 0, -1):
        mantissa, exponent = f"{x:.{digits}e}".split("e")
        text = f"{mantissa}D{int(exponent):+d}"
        if len(text) <= FIELD:
            return text
    raise AssertionError("every double fits")
