"""How the kernel is compiled: `setup.py` takes `ffi` from this module and builds ``pmr.kernel._native``.

To build it in place, for a package that is used from its folder: ``python setup.py -q build_ext --inplace``.
"""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path

from cffi import FFI

SOURCES = Path(__file__).parent / "src"  # from the root of a checkout where setup.py reads this file
#: Files that are compiled by themselves; all other files are included by avx2.c and baseline.c (variant.c).
FILES = ("block.c", "system.c", "signals.c", "frame.c", "ground.c", "bank.c", "dispatch.c", "avx2.c", "baseline.c")
#: Python's own flags let indices of loops wrap around, which costs a twentieth of a step.
FLAGS = ["-std=gnu11", "-O2", "-fno-wrapv", "-ffp-contract=fast", "-fvisibility=hidden", "-Wall", "-Wextra"]
BEGIN, END = "/* ---- from here on cffi reads this file: declarations only ---- */", "/* ---- up to here ---- */"


def declarations(header: str) -> str:
    """Part of the header's text between the marks `BEGIN` and `END`, which cffi can read."""
    return header.partition(BEGIN)[2].partition(END)[0]


def sources_digest() -> str:
    """SHA-256 digest of all sources of the kernel; the compiled module stores it as ``SOURCES_DIGEST``."""
    contents = [f"{path.name}\n{path.read_text()}" for path in sorted(SOURCES.glob("*.[ch]"))]
    return hashlib.sha256("\n".join(contents).encode()).hexdigest()


ffi = FFI()
for header in ("law.h", "pmr_kernel.h"):
    ffi.cdef(declarations((SOURCES / header).read_text()))
ffi.cdef("static char *const SOURCES_DIGEST;")
ffi.set_source(
    "pmr.kernel._native",
    f'#include "pmr_kernel.h"\nstatic char *const SOURCES_DIGEST = "{sources_digest()}";',
    sources=[str(SOURCES / name) for name in FILES],
    depends=[str(path) for path in sorted(SOURCES.glob("*.[ch]"))],
    include_dirs=[str(SOURCES)],
    libraries=[] if sys.platform == "win32" else ["m"],
    extra_compile_args=FLAGS,
)
