"""``pmr matrices``: mass and stiffness of another program's model, as one file that scenes name."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pmr.cli.console import ensure_writable, out, say
from pmr.errors import InputError


def matrices(
    stiffness: Annotated[
        Path, typer.Argument(metavar="STIFFNESS", help=".sti of CalculiX, .mtx, .npz (SciPy), .rb or .hb.")
    ],
    mass: Annotated[
        Path | None, typer.Option("--mass", metavar="FILE", help="[default: .mas beside the stiffness]")
    ] = None,
    dofs: Annotated[
        Path | None,
        typer.Option("--dofs", metavar="FILE", help="Node and direction of each row: .dof, .csv.  [default: .dof]"),
    ] = None,
    nodes: Annotated[
        Path | None,
        typer.Option("--nodes", metavar="FILE", help="Nodes and named groups: .inp, .csv.  [default: .inp]"),
    ] = None,
    out_file: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="[default: STIFFNESS-matrices.npz]")
    ] = None,
) -> None:
    """Read matrices that another program assembled, and check them; FEniCSx is not needed.

    A scene names the file: model = "matrices" in [body], and file in [mesh].

    Example:

        pmr matrices boom.sti
    """
    from pmr.files.foreign import ForeignFiles, read_foreign

    target = out_file or stiffness.with_name(f"{stiffness.stem}-matrices.npz")
    if target.is_dir() or target.suffix != ".npz":
        raise InputError("command line", "--out", str(target), "the name of an .npz file is allowed")
    ensure_writable(target.parent)
    beside = {name: stiffness.with_suffix(suffix) for name, suffix in (("m", ".mas"), ("d", ".dof"), ("n", ".inp"))}
    found = read_foreign(ForeignFiles(stiffness, mass or beside["m"], dofs or beside["d"], nodes or beside["n"]))
    say(out, f"{found.size} coordinates of {len(found.points)} nodes; groups: {', '.join(found.groups) or 'none'}")
    say(out, str(found.save(target)))
