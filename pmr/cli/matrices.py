"""``pmr matrices``: mass and stiffness of another program's model, as one file that scenes name."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pmr.cli.console import ensure_file, out, say
from pmr.errors import InputError


def matrices(
    stiffness: Annotated[
        Path,
        typer.Argument(metavar="STIFFNESS", help=".sti of CalculiX, .mtx (Abaqus), .bdf or .op4 (Nastran), .npz, .hb."),
    ],
    mass: Annotated[
        Path | None, typer.Option("--mass", metavar="FILE", help="[default: .mas beside it; of .bdf itself]")
    ] = None,
    dofs: Annotated[
        Path | None,
        typer.Option(
            "--dofs",
            metavar="FILE",
            help="Node and direction of each row.  [default: .dof beside it; of .bdf, .mtx itself]",
        ),
    ] = None,
    nodes: Annotated[
        Path | None,
        typer.Option(
            "--nodes",
            metavar="FILE",
            help="Nodes and groups: .inp, .bdf, .csv.  [default: .inp beside it; of .bdf itself]",
        ),
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
    from pmr.files.foreign import foreign_files, read_foreign

    if not stiffness.name:
        raise InputError("command line", "STIFFNESS", str(stiffness), "the name of a file is allowed")
    target = out_file or stiffness.with_name(f"{stiffness.stem}-matrices.npz")
    if target.suffix != ".npz":
        raise InputError("command line", "--out", str(target), "the name of an .npz file is allowed")
    files = foreign_files(stiffness, mass, dofs, nodes)
    ensure_file(target, files.stiffness, files.mass, files.dofs, files.nodes)
    body = read_foreign(files)
    say(out, f"{body.size} coordinates of {len(body.points)} nodes; groups: {', '.join(body.groups) or 'none'}")
    x, y, z = (round(float(c), 9) + 0.0 for c in body.centre)
    say(out, f"{body.mass:.4g} kg, centre of mass at ({x:.4g}, {y:.4g}, {z:.4g}) m; {_held_text(len(body.held))}")
    say(out, str(body.save(target)))


def _held_text(count: int) -> str:
    if not count:
        return "free to move as a rigid body"
    return f"supports and springs in its stiffness hold {count} of 6 rigid motions"
