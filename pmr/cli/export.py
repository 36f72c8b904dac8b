"""``pmr export``: a reduced model as files for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pmr import environment
from pmr.cli.console import ensure_writable, out, say
from pmr.errors import InputError
from pmr.files.swap import finished


def export(
    model: Annotated[Path, typer.Argument(metavar="reduced.npz", help="A reduced model that `pmr run` wrote.")],
    to: Annotated[str, typer.Option("--to", metavar="FORMAT", help="exudyn: a standalone Python script.")] = "exudyn",
    out_file: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="[default: sliding_body.py beside the model]")
    ] = None,
) -> None:
    """Write a reduced model as something a user can build on, without pmr.

    Example:

        pmr export reports/paper_simple/reduced.npz --to exudyn
    """
    if to != "exudyn":
        raise InputError("command line", "--to", to, "exudyn is allowed")
    environment.needed("exudyn")  # the script's parts are tested code, which is loaded to be written
    from pmr.export.exudyn.script import write_exudyn_script

    target = out_file or model.with_name("sliding_body.py")
    if target.is_dir():
        raise InputError("command line", "--out", str(target), "the name of a file is allowed")
    ensure_writable(target.parent)
    finished(model.parent)
    written = write_exudyn_script(model, target)
    say(out, str(written))
