"""The command line: its commands, the one to begin with (``new``), exit codes of errors."""

from __future__ import annotations

import logging
import sys
import warnings
from importlib import resources
from os.path import lexists
from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Argument, Option

from pmr.cli import console
from pmr.cli.console import err, out
from pmr.cli.export import export, flexible, matrices, simulate
from pmr.cli.info import info, scene_schema, schema
from pmr.cli.observe import identify, observe
from pmr.cli.run import run
from pmr.cli.study import chart, study
from pmr.errors import ConvergenceError, InputError, SimulationError, environment, escape_controls, similar_name_hint
from pmr.files.whole import FULL, NotWrittenError

SCHEMA = "scene.schema.json"
TEMPLATES = resources.files("pmr.cli") / "templates"


def scene_kinds() -> list[str]:
    """Return the names of the scenes that ``pmr new`` offers."""
    return sorted(file.name.removesuffix(".toml") for file in TEMPLATES.iterdir() if file.name.endswith(".toml"))


def new(
    kind: Annotated[
        str, Argument(metavar="KIND", help="beam, boom, telescope, crane or platform.", autocompletion=scene_kinds)
    ],
    name: Annotated[Path, Argument(metavar="NAME", help="New folder, whose name is the title of the scene.")],
) -> None:
    """Write a scene with comments into a new folder.

    For one body there is also a script that draws a mesh.

    Example:

        pmr new boom mine && pmr run mine
    """
    if kind not in scene_kinds():
        allowed = f"{similar_name_hint(kind, scene_kinds())}{', '.join(scene_kinds())} are allowed"
        raise InputError("command line", "KIND", kind, allowed)
    if lexists(name):
        raise InputError("command line", "NAME", str(name), "the name of a folder that is not there yet is allowed")
    console.prepare_folder(name, key="NAME")
    title = escape_controls(name.name).replace("\\", "").replace('"', "")
    scene = (TEMPLATES / f"{kind}.toml").read_text(encoding="utf-8").replace('title = "NAME"', f'title = "{title}"')
    (name / "scene.toml").write_text(f"#:schema {SCHEMA}\n{scene}", encoding="utf-8")
    (name / SCHEMA).write_text(scene_schema(), encoding="utf-8")
    about = {
        "scene.toml": f"the scene: the structure and what is computed, with comments; `pmr run {name}` computes it",
        SCHEMA: "the schema: an editor completes and checks keys with it",
    }
    if "[[sections]]" not in scene:
        mesh = TEMPLATES / f"mesh_of_a_{'box' if '[body.box]' in scene else 'beam'}.py"
        (name / "mesh.py").write_text(mesh.read_text(encoding="utf-8"), encoding="utf-8")
        about["mesh.py"] = "a script that draws a mesh; change it to draw your own"
    for file, what in about.items():
        out.text(f"{name / file}  {what}")


def compile_() -> None:
    """Do nothing: pip has compiled all code already.

    Version 0.2 removes this command of earlier versions.
    """
    out.text("nothing is to be compiled: the step was compiled when pmr was installed")


_UsageError: type[Exception] = typer.BadParameter.__mro__[1]  # the class of click, or of the copy of click in typer


def _usage_message(error: Any) -> str:
    """Return click's message for a command used in a wrong way, with a pointer to the command's ``--help``.

    If an argument is missing and has a help text, that text is added.
    """
    command = error.ctx.command_path if error.ctx else "pmr"
    message, about = error.format_message().rstrip("."), getattr(getattr(error, "param", None), "help", None)
    if message.startswith("Missing") and about:
        message += f": {about[:1].lower()}{about[1:].rstrip('.')}"
    return f"{message}; `{command} --help` says more"


app = typer.Typer(
    help="Simulate booms that telescope: from a scene file to a reduced model, its errors and a report.",
    epilog="Start with: pmr new boom mine && pmr run mine",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for command in (new, run, study, chart, simulate, observe, identify, export, flexible, matrices, info, schema):
    app.command()(command)
app.command("compile")(compile_)


def _version(is_given: bool) -> None:
    """Print pmr's version and exit if the option ``--version`` is given; otherwise do nothing."""
    if is_given:
        out.text(f"pmr {environment.package_versions()['pmr']}")
        raise typer.Exit


@app.callback()
def _before_any_command(
    version: Annotated[bool, Option("--version", callback=_version, is_eager=True, help="Print the version.")] = False,
    quiet: Annotated[bool, Option("--quiet", help="Print errors only.")] = False,
) -> None:
    """Set whether only errors are printed; called before any command."""
    out.quiet = quiet


def main() -> None:
    """Run the command line; errors are printed as a message in one line.

    The process exits with code 2 for wrong input or a package that can't be imported, and with code 1 if a solver fails
    or results can't be written.
    """
    console.prepare_streams()
    warnings.filterwarnings("ignore", "A NumPy version")  # SciPy warns of it; errors due to it are reported below
    handler = logging.StreamHandler()
    handler.setFormatter(console.VisibleText("%(levelname)s %(message)s"))
    logging.basicConfig(level=logging.WARNING, handlers=[handler])
    try:
        sys.exit(app(standalone_mode=False))
    except SystemExit:
        if (failure := console.output_failure()) is not None:
            console.exit_with_message(f"standard output: {failure.strerror}; results that go to files are there", 1)
        raise
    except _UsageError as error:
        if not sys.argv[1:]:
            error.show()  # type: ignore[attr-defined]  # the help
            sys.exit(2)
        console.exit_with_message(f"command line: {_usage_message(error)}", 2)
    except InputError as error:
        console.exit_with_message(str(error), 2)
    except (ConvergenceError, SimulationError, NotWrittenError) as error:
        console.exit_with_message(str(error), 1)
    except Exception as error:
        if isinstance(error, OSError) and error.errno in FULL:
            console.output_failure()
            places = "standard output, compiled code (XDG_CACHE_HOME) and temporary files (TMPDIR)"
            console.exit_with_message(f"{error.strerror}: free space is needed for {places}", 1)
        if any(kind.__name__ == "VerificationError" for kind in type(error).__mro__):  # CFFI's
            console.exit_with_message(
                "a finite-element form was not compiled: a C compiler is needed, and free "
                "space in the folder of compiled code (XDG_CACHE_HOME)",
                1,
            )
        if isinstance(error, ImportError) or "numpy.dtype size changed" in str(error):
            console.exit_with_message(environment.import_failure_message(error), 2)
        if console.rank_count() > 1:  # the other ranks would wait for this one for ever
            err.print_exception()
            console.exit_with_message("a rank failed", 1)
        raise
