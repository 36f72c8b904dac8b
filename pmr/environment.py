"""What a result was made with: versions, commit, machine."""

from __future__ import annotations

import hashlib
import os
import platform
import subprocess
import sys
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path

_PACKAGES = ("numpy", "scipy", "exudyn", "meshio", "pydantic", "matplotlib", "weasyprint")
_NUMERICAL = ("numpy", "scipy", "numba", "exudyn", "fenics-dolfinx", "petsc4py", "slepc4py", "dolfinx-solver-real")


def versions() -> dict[str, str]:
    """Versions of pmr, Python and the packages that a result depends on."""
    from pmr import __version__

    return {"pmr": __version__, "python": platform.python_version()} | {name: _version(name) for name in _PACKAGES}


def commit() -> str | None:
    """Commit of the checkout that pmr runs from, with a mark where files differ from it; None outside a checkout."""
    folder = Path(__file__).resolve().parents[1]
    if not (folder / ".git").exists():
        return None
    try:
        git = ["git", "-C", str(folder)]
        head = subprocess.run([*git, "rev-parse", "--short=12", "HEAD"], capture_output=True, text=True, check=True)
        changed = subprocess.run([*git, "status", "--porcelain", "-uno"], capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return head.stdout.strip() + (" with changes" if changed.stdout.strip() else "")


def code_digest(leave_out: Sequence[str] = ()) -> str:
    """Digest of what computes: pmr's own source files and the versions of the numerical packages.

    Files whose path within pmr begins with one of `leave_out` do not count.
    """
    root, digest = Path(__file__).resolve().parent, hashlib.sha256()
    for file in sorted(root.rglob("*.py")):
        name = file.relative_to(root).as_posix()
        if not name.startswith(tuple(leave_out)):
            digest.update(name.encode() + b"\0" + file.read_bytes() + b"\0")
    numerical = {package: _version(package) for package in _NUMERICAL} | {"python": platform.python_version()}
    digest.update(repr(numerical).encode())
    return digest.hexdigest()[:16]


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"


def machine() -> dict[str, str]:
    """Processor, cores available to this process and operating system; no names of hosts or users."""
    return {
        "processor": _processor(),
        "cores": str(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()),
        "system": f"{platform.system()} {platform.machine()}",
    }


def _processor() -> str:
    cpuinfo = Path("/proc/cpuinfo")
    if sys.platform == "linux" and cpuinfo.exists():
        for line in cpuinfo.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
