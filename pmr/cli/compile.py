"""The command ``pmr compile``: what a first run would compile, made now and side by side."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from pmr.cli.console import leave, out, say
from pmr.errors import environment

#: Scenes to start from (`pmr new`) that together take the loops of one body and of several.
KINDS = ("boom", "telescope")
#: s: so short that nearly all of the time goes into compiling, and a multiple of `recovery.every` of all of them.
END = 0.1


def compile_() -> None:
    """Compile the simulator once after an installation by pip; `make setup` has done it already.

    It compiles the loops of one body and of several and the finite-element forms of beams and boxes, and makes the list
    of fonts. The results are stored on disk and serve until pmr, Numba or the processor change. Without this command
    the first run compiles, and takes longer.

    Example:

        pmr compile && pmr new boom mine && pmr run mine
    """
    environment.check_installed("dolfinx")
    environment.check_report()
    say(out, f"compiling what first runs take: {', '.join(KINDS)}")
    pmr = (sys.executable, "-m", "pmr", "--quiet")
    with tempfile.TemporaryDirectory() as folder:
        for kind in KINDS:
            subprocess.run([*pmr, "new", kind, kind], cwd=folder, check=True)
        runs = {}
        for kind in KINDS:
            with Path(folder, f"{kind}.said").open("wb") as said:
                run = (*pmr, "run", kind, "--set", f"time.end={END}")
                runs[kind] = subprocess.Popen(run, cwd=folder, stdout=said, stderr=said)
        failed = [kind for kind, process in runs.items() if process.wait()]
        if failed:
            said_last = Path(folder, f"{failed[0]}.said").read_text(errors="replace").splitlines()[-1:]
            leave(f"not compiled: {failed[0]}: {''.join(said_last)}", 1)
