"""The OpenBLAS libraries of this process, and the kernel by which each of them computes."""

from __future__ import annotations

import ctypes
import re
from dataclasses import dataclass
from pathlib import Path

#: Wheels of NumPy and SciPy bring libraries whose functions have names of their own.
NAMES = ("openblas_get_corename", "scipy_openblas_get_corename", "scipy_openblas_get_corename64_")


@dataclass(frozen=True)
class OpenBlas:
    """One library."""

    name: str
    kernel: str


def loaded() -> list[OpenBlas]:
    """Those that have been loaded so far; none where BLAS is another one."""
    maps = Path("/proc/self/maps")
    mapped = {line.split()[-1] for line in maps.read_text().splitlines()} if maps.exists() else set()
    files = (Path(file) for file in sorted(mapped) if re.search(r"/lib[^/]*(openblas|lapack|blas)[^/]*\.so", file))
    found = (OpenBlas(file.name, kernel) for file in files if (kernel := _kernel(ctypes.CDLL(str(file)))))
    return list(found)


def _kernel(library: ctypes.CDLL) -> str:
    for name in NAMES:
        if hasattr(library, name):
            function = getattr(library, name)
            function.restype = ctypes.c_char_p
            return str(function().decode())
    return ""
