"""``pmr info``: the stack in use, or what a file holds."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from pmr.cli.console import out, scene_file
from pmr.cli.described import described_file, described_scene
from pmr.errors import environment
from pmr.errors.text import visible
from pmr.files.swap import finish_swap

_PLACES = {"tip": "at the tip", "beam": "along the beam"}


def info(
    file: Annotated[
        Path | None,
        typer.Argument(
            metavar="[FILE]", help="reduced.npz, system.npz, a scene or its name; without it what is installed."
        ),
    ] = None,
) -> None:
    """Print what is installed (versions, MPI, scalar type), or what a file contains.

    Examples
    --------
        pmr info

        pmr info reports/paper_simple/reduced.npz

        pmr info reports/boom_three/system.npz
    """
    if file is None:
        rows = environment.versions()
        try:
            from pmr.pipeline import fenicsx_versions
        except ImportError as error:
            rows["FEniCSx"] = f"not found ({error}); reduced models simulate without it"
        else:
            rows |= fenicsx_versions()
        rows |= environment.machine()
    elif file.suffix != ".npz":
        from pmr import scene as scenes

        rows = described_scene(scenes.load_any(scene_file(file)))
    else:
        finish_swap(file.parent)
        rows = described_file(file) | _estimate_lines(file.with_name("summary.json"))
    table = Table(show_header=False, box=None, pad_edge=False)
    for key, value in rows.items():
        table.add_row(key, visible(value))
    out.print(table)


def _estimate_lines(summary: Path) -> dict[str, str]:
    """Estimated errors of the run that left a model, where its summary stands beside it."""
    try:
        estimates = json.loads(summary.read_text(encoding="utf-8"))["estimate"]
        shares = {place: float(estimates[place]) for place in ("tip", "beam") if estimates[place] is not None}
    except (OSError, ValueError, LookupError, TypeError):
        return {}
    sentence = ", ".join(f"{100.0 * share:.2g} % {_PLACES[place]}" for place, share in shares.items())
    return {"estimated error": sentence or "not known"}
