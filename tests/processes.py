"""Run commands in this process or in processes of their own, on one rank or several."""

import os
import subprocess
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from waiting import PATIENCE

from pmr.cli import main

FENICSX = ("dolfinx", "ufl", "basix", "ffcx")
PETSC = ("petsc4py", "slepc4py", "mpi4py", "dolfinx_solver")  # which sets up the libraries of all of them
COMMAND = "import sys; from pmr.cli import main; sys.argv[0] = 'pmr'; main()"
_NO_FIGURES = (
    "from pmr.cli import run\nfrom pmr.report import album, blocks\nfrom pmr.report import figures\n"
    "album.render_shot = lambda shot: b''\n"
    "run.has_free_core = lambda: False\n"  # another process would help
    "figures.drawing = lambda name, draw, caption, *_, **__: blocks.Drawing(name, '<svg></svg>', caption)\n"
)
#: The command whose reports have empty figures, in a real PDF.
WITHOUT_FIGURES = _NO_FIGURES + COMMAND
#: The same with an empty PDF too, for tests of anything else: both take longer than a short run.
_NO_PDF = "from pmr.report import document\ndocument.write_pdf = lambda text, file: file.touch()\n"
UNDRAWN = _NO_FIGURES + _NO_PDF + COMMAND


@dataclass(frozen=True)
class Called:
    """Exit code and output of a command, named as those of a finished process."""

    returncode: int
    stdout: str
    stderr: str


def called(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *arguments: str) -> Called:
    """Run the command `pmr` in this process, which has loaded everything; return its exit code and output."""
    monkeypatch.setattr(sys, "argv", ["pmr", *arguments])
    with pytest.raises(SystemExit) as left:
        main()
    captured = capsys.readouterr()
    code = left.value.code
    return Called(code if isinstance(code, int) else 0, captured.out, captured.err)


def python(*arguments: str, ranks: int = 1, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run this Python with arguments, by the mpirun beside it if there are several ranks; blocks until it ends.

    Open MPI sets variables behind Python's back once MPI has started here.  A nested mpirun must not see them, so the
    environment is passed as Python knows it.  The session folder is its own, as other tests remove theirs.
    """
    own = Path(sys.executable).with_name("mpirun")
    launcher = [str(own if own.exists() else "mpirun"), "-n", str(ranks)] if ranks > 1 else []
    with TemporaryDirectory(prefix="mpi") if launcher else nullcontext() as session:
        return subprocess.run(
            [*launcher, sys.executable, *arguments],
            capture_output=True,
            text=True,
            check=False,
            timeout=PATIENCE,
            cwd=cwd,
            env=os.environ | ({"OMPI_MCA_orte_tmpdir_base": session} if session else {}),
        )


def undrawn(*arguments: str, ranks: int = 1, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run the command `pmr` in a process of its own, with a report whose figures and PDF are empty."""
    return python("-c", UNDRAWN, *arguments, ranks=ranks, cwd=cwd)


def resident() -> float:
    """Memory in MiB that this process uses now; its peak would hide growth below the peak of an earlier test."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20


def without(packages: Sequence[str], *arguments: str, code: str = COMMAND) -> subprocess.CompletedProcess[str]:
    """Run the command `pmr`, or other code, in a process that can import none of these packages."""
    return python("-c", f"import sys; sys.modules |= dict.fromkeys({list(packages)})\n{code}", *arguments)
