"""The page of commands, written from the command line's own help before Sphinx reads its sources."""

from __future__ import annotations

from pathlib import Path

import typer.main
from keys import write
from sphinx.application import Sphinx

from pmr.cli.app import app as command_line


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the page when a build begins."""
    app.connect("builder-inited", write_page)
    return {"parallel_read_safe": True}


def write_page(app: Sphinx) -> None:
    """One section a command: usage, what it does, arguments and options."""
    group = typer.main.get_command(command_line)
    parts = ["# Commands", "", group.help or ""]
    for name, command in group.commands.items():  # type: ignore[attr-defined]
        parts += ["", f"## `pmr {name}`", "", *_text(command.help or ""), "", "| | |", "|---|---|"]
        for parameter in command.params:
            record = getattr(parameter, "help", "") or ""
            label = (
                " ".join(parameter.opts)
                if parameter.param_type_name == "option"
                else (parameter.metavar or parameter.name)
            )
            if getattr(parameter, "metavar", None) and parameter.param_type_name == "option":
                label += f" {parameter.metavar}"
            parts.append(f"| `{label}` | {record.replace('|', chr(92) + '|')} |")
    write(Path(app.srcdir, "reference", "commands.md"), "\n".join(parts) + "\n")


def _text(text: str) -> list[str]:
    """Lines of a command's help, as Markdown."""
    return text.replace("\f", "").splitlines()
