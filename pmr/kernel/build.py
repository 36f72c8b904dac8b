"""How the kernel is compiled: `setup.py` takes `ffi` from this module and builds ``pmr.kernel._native``.

To build it in place, for a package that is used from its folder: ``python setup.py -q build_ext --inplace``.
"""

from __future__ import annotations

import sys
from pathlib import Path

from cffi import FFI

SOURCES = Path("pmr", "kernel", "src")
#: Files that are compiled by themselves; all other files are included by avx2.c and baseline.c (variant.c).
FILES = ("block.c", "system.c", "signals.c", "frame.c", "ground.c", "bank.c", "dispatch.c", "avx2.c", "baseline.c")
FLAGS = ["-std=gnu11", "-O2", "-ffp-contract=fast", "-fvisibility=hidden", "-Wall", "-Wextra"]
BEGIN, END = "/* ---- from here on cffi reads this file: declarations only ---- */", "/* ---- up to here ---- */"


def declarations(header: str) -> str:
    """Part of the header between the marks `BEGIN` and `END`, which cffi can read."""
    return header.partition(BEGIN)[2].partition(END)[0]


ffi = FFI()
ffi.cdef(declarations((SOURCES / "pmr_kernel.h").read_text()))
ffi.set_source(
    "pmr.kernel._native",
    '#include "pmr_kernel.h"',
    sources=[str(SOURCES / name) for name in FILES],
    depends=[str(path) for path in sorted(SOURCES.glob("*.[ch]"))],
    include_dirs=[str(SOURCES)],
    libraries=[] if sys.platform == "win32" else ["m"],
    extra_compile_args=FLAGS,
)
