"""The command line: its commands, and the exit codes of errors."""

from __future__ import annotations

import logging
import warnings
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from pmr.cli.console import (
    VisibleText,
    err,
    exit_with_message,
    out,
    output_failure,
    prepare_streams,
    print_text,
    rank_count,
)
from pmr.cli.export import export, flexible, matrices, simulate
from pmr.cli.identify import identify
from pmr.cli.info import info
from pmr.cli.new import compile_, new, schema
from pmr.cli.observe import observe
from pmr.cli.run import run
from pmr.cli.study import chart, study
from pmr.errors import ConvergenceError, InputError, SimulationError, environment
from pmr.files.whole import FULL, NotWrittenError

_UsageError: type[Exception] = typer.BadParameter.__mro__[1]  # the class of click, or of the copy of click in typer


class _Commands(TyperGroup):
    """Group of commands that raises an InputError for wrong use, as for any other wrong input."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments `args`; raises InputError for wrong ones.  Without any, the help is printed."""
        if not args:
            return super().parse_args(ctx, args)  # typer prints the help
        try:
            return super().parse_args(ctx, args)
        except _UsageError as error:
            raise _refusal(error, ctx) from None

    def invoke(self, ctx: Any) -> Any:
        """Run the command; raises InputError if it is used in a wrong way."""
        try:
            return super().invoke(ctx)
        except _UsageError as error:
            raise _refusal(error, ctx) from None


def _refusal(error: Any, ctx: Any) -> InputError:
    """Return an InputError for a command that was used in a wrong way, with the message of click.

    If an argument is missing and has a help text, that text is added.
    """
    command, about = (error.ctx or ctx).command_path, getattr(getattr(error, "param", None), "help", None)
    message = error.format_message().rstrip(".")
    if message.startswith("Missing") and about:
        message += f": {about[:1].lower()}{about[1:].rstrip('.')}"
    return InputError("command line", "", None, f"{message}; `{command} --help` says more")


app = typer.Typer(
    cls=_Commands,
    help="Simulate booms that telescope: from a scene file to a reduced model, its comparison and a report.",
    epilog="Start with: pmr new boom mine && pmr run mine",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for command in (new, run, study, chart, simulate, observe, identify, export, flexible, matrices, info, schema):
    app.command()(command)
app.command("compile")(compile_)


def _version(is_given: bool) -> None:
    """Print pmr's version and exit, if the option is given."""
    if is_given:
        print_text(out, f"pmr {environment.package_versions()['pmr']}")
        raise typer.Exit


@app.callback()
def _before_any_command(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print errors only.")] = False,
) -> None:
    """Set whether only errors are printed."""
    out.quiet = quiet


def main() -> None:
    """Run the command line; errors are printed as a message in one line.

    The process exits with code 2 for wrong input, and with code 1 if a solver fails.
    """
    prepare_streams()
    warnings.filterwarnings("ignore", "A NumPy version")  # SciPy warns of it; errors due to it are reported below
    handler = logging.StreamHandler()
    handler.setFormatter(VisibleText("%(levelname)s %(message)s"))
    logging.basicConfig(level=logging.WARNING, handlers=[handler])
    try:
        app()
    except SystemExit:
        if (failure := output_failure()) is not None:
            exit_with_message(f"standard output: {failure.strerror}; results that go to files are there", 1)
        raise
    except InputError as error:
        exit_with_message(str(error), 2)
    except (ConvergenceError, SimulationError, NotWrittenError) as error:
        exit_with_message(str(error), 1)
    except Exception as error:
        if isinstance(error, OSError) and error.errno in FULL:
            output_failure()
            places = "standard output, compiled code (XDG_CACHE_HOME) and temporary files (TMPDIR)"
            exit_with_message(f"{error.strerror}: free space is needed for {places}", 1)
        if any(kind.__name__ == "VerificationError" for kind in type(error).__mro__):  # CFFI's
            exit_with_message(
                "a finite-element form was not compiled: a C compiler is needed, and free "
                "space in the folder of compiled code (XDG_CACHE_HOME)",
                1,
            )
        if isinstance(error, ImportError) or "numpy.dtype size changed" in str(error):
            exit_with_message(environment.import_failure_message(error), 2)
        if rank_count() > 1:  # the other ranks would wait for this one for ever
            err.print_exception()
            exit_with_message("a rank failed", 1)
        raise
