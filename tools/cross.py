"""C compiled for other systems than this one by zig, a compiler that pip installs (the package ziglang).

`setup.py` compiles the kernel's extension module and the libraries of FMUs with it.
"""

from __future__ import annotations

import platform
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent


@dataclass(frozen=True)
class Target:
    """A system that C is compiled for: what zig calls it and the suffixes of its files."""

    triple: str  # processor, system and the lowest version of its C library
    wheel: str  # platform tag of a wheel
    library: str  # suffix of a shared library
    extension: str  # suffix of an extension module of Python's stable interface


#: By processor and system, as FMI 3.0 names them.
TARGETS = {
    "x86_64-linux": Target("x86_64-linux-gnu.2.17", "manylinux_2_17_x86_64", ".so", ".abi3.so"),
    "aarch64-linux": Target("aarch64-linux-gnu.2.17", "manylinux_2_17_aarch64", ".so", ".abi3.so"),
    "x86_64-darwin": Target("x86_64-macos.13.0", "macosx_13_0_x86_64", ".dylib", ".abi3.so"),
    "aarch64-darwin": Target("aarch64-macos.13.0", "macosx_13_0_arm64", ".dylib", ".abi3.so"),
    "x86_64-windows": Target("x86_64-windows-gnu", "win_amd64", ".dll", ".pyd"),
}
_PROCESSORS = {"amd64": "x86_64", "arm64": "aarch64"}


def host() -> str:
    """Name of the system that this is, which `TARGETS` may lack."""
    processor = platform.machine().lower()
    return f"{_PROCESSORS.get(processor, processor)}-{platform.system().lower()}"


def compile_library(
    name: str,
    sources: Sequence[str | Path],
    output: str | Path,
    include_dirs: Sequence[str | Path] = (),
    flags: Sequence[str] = ("-O2", "-fvisibility=hidden"),
) -> None:
    """Compile C files into a shared library for a system of `TARGETS`, with libm.

    It runs on any processor of its kind.  Where glibc is, version 2.17 is enough.

    Raises
    ------
    subprocess.CalledProcessError
        If a file does not compile; the compiler has printed why.
    """
    with tempfile.TemporaryDirectory() as folder:  # zig leaves a list of exports beside a library for Windows
        library = Path(folder, Path(output).name)
        _zig(
            "cc", "-target", TARGETS[name].triple, "-mcpu=baseline", "-shared", "-fno-sanitize=undefined", "-s", *flags,
            *(f"-I{include_dir}" for include_dir in include_dirs), *map(str, sources),
            *(() if name.endswith("windows") else ("-fPIC", "-lm")), "-o", str(library),
        )  # fmt: skip
        shutil.move(library, output)


def compile_extension(
    name: str,
    sources: Sequence[str | Path],
    output: str | Path,
    include_dirs: Sequence[str | Path],
    flags: Sequence[str],
    scratch: str | Path,
) -> None:
    """Compile C files into an extension module of Python's stable interface for a system of `TARGETS`.

    It is bound to Python when it is loaded: on Windows by ``python3.dll``, whose functions ``python3.def`` lists,
    elsewhere by the process that loads it.  Arguments and errors as `compile_library` has them; `scratch` is a folder.
    """
    headers = Path(scratch, "python")
    shutil.copytree(
        sysconfig.get_path("include"), headers, dirs_exist_ok=True, ignore=shutil.ignore_patterns("pyconfig.h")
    )
    shutil.copy(HERE / "pyconfig.h", headers)
    linked = ["-Wl,-undefined,dynamic_lookup"] if name.endswith("darwin") else []
    if name.endswith("windows"):
        linked = [str(Path(scratch, "python3.lib"))]
        _zig("dlltool", "-m", "i386:x86-64", "-d", str(HERE / "python3.def"), "-l", *linked)
    compile_library(name, sources, output, [*include_dirs, headers], [*flags, *linked])


def _zig(*arguments: str) -> None:
    subprocess.run([sys.executable, "-m", "ziglang", *arguments], check=True)
