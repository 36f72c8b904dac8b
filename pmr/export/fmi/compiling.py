"""C source compiled for several systems on one machine, by the compiler of PyPI's `ziglang`."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pmr.errors import InputError


@dataclass(frozen=True)
class Platform:
    """A system that an FMU has a binary for: its folders in FMI 2.0 (or none) and 3.0, the compiler's name of it."""

    folder_2: str
    folder_3: str
    target: str
    suffix: str


PLATFORMS = (
    Platform("linux64", "x86_64-linux", "x86_64-linux-gnu.2.17", ".so"),
    Platform("", "aarch64-linux", "aarch64-linux-gnu.2.17", ".so"),
    Platform("win64", "x86_64-windows", "x86_64-windows-gnu", ".dll"),
    Platform("darwin64", "x86_64-darwin", "x86_64-macos", ".dylib"),
    Platform("", "aarch64-darwin", "aarch64-macos", ".dylib"),
)
_FLAGS = ("-shared", "-std=c99", "-O3", "-fvisibility=hidden", "-fno-sanitize=undefined", "-s")


def compiled(folder: Path, sources: Sequence[str], platform: Platform, target: Path) -> None:
    """Compile the files of a folder into a shared library.

    Raises InputError if the compiler fails; with its first line.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    windows = platform.suffix == ".dll"
    libraries = () if windows else ("-lm",)
    command = [
        sys.executable,
        "-m",
        "ziglang",
        "cc",
        "-target",
        platform.target,
        *_FLAGS,
        *(() if windows else ("-fPIC",)),
    ]
    result = subprocess.run(
        [*command, *sources, "-o", str(target.resolve()), *libraries],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    if result.returncode:
        lines = [line for line in result.stderr.splitlines() if "error" in line] or result.stderr.splitlines() or ["?"]
        raise InputError("command line", "--to", "fmu", f"no binary for {platform.folder_3}: {lines[0]}")
