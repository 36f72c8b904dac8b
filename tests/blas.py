"""OpenBLAS libraries that this process has loaded, and the kernels by which they compute."""

import ctypes
import re
from dataclasses import dataclass
from pathlib import Path

#: Wheels of NumPy and SciPy bring libraries whose functions have names of their own.
NAMES = ("openblas_get_corename", "scipy_openblas_get_corename", "scipy_openblas_get_corename64_")


@dataclass(frozen=True)
class OpenBlas:
    """Name of a library's file and of its kernel, such as ``Haswell``."""

    name: str
    kernel: str


def loaded() -> list[OpenBlas]:
    """OpenBLAS libraries that are loaded so far; empty if BLAS is another library."""
    maps = Path("/proc/self/maps")
    mapped = {line.split()[-1] for line in maps.read_text().splitlines()} if maps.exists() else set()
    files = (Path(file) for file in sorted(mapped) if re.search(r"/lib[^/]*(openblas|lapack|blas)[^/]*\.so", file))
    found = (OpenBlas(file.name, kernel) for file in files if (kernel := _kernel(ctypes.CDLL(str(file)))))
    return list(found)


def _kernel(library: ctypes.CDLL) -> str:
    """Name of a library's kernel; empty if it is no OpenBLAS."""
    for name in NAMES:
        if hasattr(library, name):
            function = getattr(library, name)
            function.restype = ctypes.c_char_p
            return str(function().decode())
    return ""
