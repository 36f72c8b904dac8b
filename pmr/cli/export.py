"""``pmr export``: a reduced model as files for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.text import Text

from pmr.cli.console import Model, ensure_file, ensure_writable, err, out, say
from pmr.errors.text import visible
from pmr.export.formats import Options, formats, write
from pmr.files.swap import finish_swap

_SAYS = "; ".join(f"{name}: {one.says}" for name, one in formats().items())


def export(
    model: Model,
    to: Annotated[str, typer.Option("--to", metavar="FORMAT", help=f"{_SAYS}.")] = "exudyn",
    out_file: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="[default: a name of the format beside the model]")
    ] = None,
    fmi: Annotated[
        str | None, typer.Option("--fmi", metavar="2|3", help="Version of the interface, for fmu.  [default: 3]")
    ] = None,
    platforms: Annotated[
        str | None,
        typer.Option(
            "--platforms",
            metavar="host|all",
            help="Systems that an fmu has binaries for: this machine's, or Linux, Windows and macOS.  [default: host]",
        ),
    ] = None,
    sources: Annotated[
        bool, typer.Option("--sources", help="Whether an fmu has the C of its binaries, for importers that compile it.")
    ] = False,
    at: Annotated[
        str | None,
        typer.Option("--at", metavar="S,...", help="Places of the sliders in m, for state spaces.  [default: a grid]"),
    ] = None,
    section: Annotated[
        str | None,
        typer.Option(
            "--section", metavar="NAME", help="Write a section of a boom alone, without its joints, for state spaces."
        ),
    ] = None,
) -> None:
    """Write a reduced model for other programs, which do not need pmr.

    Examples
    --------
        pmr export reports/paper_simple/reduced.npz --to exudyn

        pmr export reports/boom_shell/reduced.npz --to fmu --fmi 2 --platforms all

        pmr export reports/boom_shell/reduced.npz --to matlab --at 1.5,2.5,4
    """
    ensure_file(out_file, model) if out_file else ensure_writable(model.parent)
    finish_swap(model.parent)
    with err.status(Text(f"writing {visible(to)}")):  # on a terminal alone
        written = write(to, model, out_file, Options(fmi, at, section, platforms, sources or None))
    if section is not None:
        say(out, f"section {section} alone, without its joints")
    say(out, str(written))
