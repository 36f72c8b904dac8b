"""Shared parts of the commands: options, search for files, printing, and checks of output files."""

from __future__ import annotations

import json
import logging
import os
import sys
import tempfile
import textwrap
from collections.abc import Iterable, Sequence
from io import TextIOWrapper
from os.path import isfile
from pathlib import Path
from typing import Annotated, Any, NoReturn

from rich.console import Console
from typer import Argument, Option

from pmr.errors import InputError, escape_controls
from pmr.files.whole import NotWrittenError, ensure_ordinary

Model = Annotated[
    Path,
    Argument(
        metavar="FILE", help="Reduced model that `pmr run` wrote: reduced.npz, or system.npz of several sections."
    ),
]
Overrides = Annotated[
    list[str] | None, Option("--set", metavar="KEY=VALUE", help="Override a key of the file; repeatable.")
]
Folder = Annotated[
    Path | None,
    Option(
        "--out",
        metavar="DIR",
        help="Where results go.  [default: in reports, named after file or folder]",
    ),
]

SceneFile = Annotated[Path, Argument(metavar="SCENE", help="Scene file, or the name of a scene that comes with pmr.")]
MotionScene = Annotated[Path, Option("--scene", metavar="SCENE", help="Scene with the path, loads and time steps.")]
#: Largest number of worker processes; each of them keeps some files open.
MOST_JOBS = 256
Jobs = Annotated[
    int | None, Option("--jobs", metavar="N", min=1, max=MOST_JOBS, help="Worker processes.  [default: one per core]")
]

#: Largest number of letters that a line has for the name of a quantity.
NAMES = 28
#: Time in s before which no progress is printed without a terminal, so that short runs print results alone.
QUIET = 10.0

# Output is plain text: [brackets] are not read as markup, and :names: are not replaced by pictures.
PLAIN: dict[str, Any] = {"markup": False, "emoji": False, "highlight": False}


class Output(Console):
    """A console that goes on silently if it can't print, as on a full disk, since all results are stored anyway."""

    failure: OSError | None = None  # the first error of printing

    def print(self, *objects: Any, **options: Any) -> None:
        """Print objects; do nothing if an earlier call could not print.

        The error of the call that could not print is kept in `failure`.
        """
        if self.failure is not None:
            return
        try:
            super().print(*objects, **options)
            self.file.flush()
        except OSError as error:
            self.failure = error

    def text(self, text: str) -> None:
        """Print a text in one line, without colours and without wrapping; control characters are written as escapes."""
        self.print(escape_controls(text), soft_wrap=True)

    def sentences(self, text: str) -> None:
        """Print the sentences `text`: on a terminal wrapped between words, elsewhere in one line."""
        shown = wrap_at_spaces(text, self.width, "  ") if self.is_terminal else escape_controls(text)
        self.print(shown, soft_wrap=True)

    def rows(self, rows: Iterable[tuple[str, str]]) -> None:
        """Print rows (name, text) in two columns, wrapped at spaces; a text may have several lines."""
        from rich.table import Table

        table = Table.grid(padding=(0, 2))
        for name, text in rows:
            lines = (wrap_at_spaces(line, max(self.width - NAMES - 2, NAMES)) for line in text.split("\n"))
            table.add_row(wrap_at_spaces(name, NAMES), "\n".join(lines))
        self.print(table)


out, err = Output(**PLAIN), Output(stderr=True, **PLAIN)


def wrap_at_spaces(text: str, width: int, indent: str = "") -> str:
    """Return a text in lines of at most `width` letters, wrapped at spaces only, so that a number stays with its unit.

    All lines after the first one begin with `indent`.
    """
    lines = textwrap.wrap(
        escape_controls(text), width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )
    return "\n".join(lines)


class VisibleText(logging.Formatter):
    """Formatter of log messages that writes control characters as escapes, as `Output.text` does."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802  (the name that logging calls)
        """Return the message with control characters written as escapes."""
        return escape_controls(super().formatMessage(record))


def report_failure_message(error: Exception, folder: Path) -> str:
    """Return the message for an error of a report that can't be drawn, while all results are stored in `folder`."""
    reason = " ".join(f"{type(error).__name__}: {error}".split())
    return f"the report can't be drawn ({reason}); the results themselves are in {folder}"


def prepare_folder(folder: Path, ours: Sequence[str] = (), key: str = "--out") -> None:
    """Create `folder` if it does not exist, and check that results can be written into it.

    `key` is the option or argument that names the folder, for messages.  Raises InputError in three cases:

    - the folder, or a file in it that matches one of the patterns `ours`, can't be written;
    - `ours` is not empty, and the folder is the root of the file system;
    - results of a run would replace files of others.  This is so if `ours` includes scene.json, the folder has no
      scene.json, and a file in it matches a pattern of `ours` that has an asterisk.
    """
    try:
        if ours and folder.resolve() == folder.resolve().parent:
            allowed = "a folder below the root of the file system is allowed"
            raise InputError("command line", key, str(folder), allowed)
        if "scene.json" in ours and not (folder / "scene.json").exists():
            wide = [pattern for pattern in ours if "*" in pattern]
            if other := next((file for pattern in wide for file in folder.glob(pattern)), None):
                allowed = (
                    f"a folder without files of others is allowed: results would replace {other.relative_to(folder)}"
                )
                raise InputError("command line", key, str(folder), allowed)
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
        for pattern in ours:
            for old in folder.glob(pattern):
                ensure_ordinary(old)
    except OSError as error:
        allowed = f"a folder that can be written to is allowed ({error.strerror or error})"
        raise InputError("command line", key, str(folder), allowed) from None


def check_output_file(file: Path, *read: Path) -> None:
    """Make the folder of a file, and raise InputError unless the file can be written.

    The file has to be new or an ordinary file, and must be none of the files in `read`, from which the command reads.
    """
    prepare_folder(file.parent)
    try:
        ensure_ordinary(file)
        if any(file.exists() and isfile(source) and file.samefile(source) for source in read):
            raise NotWrittenError("another name is allowed: this file is input of the same run")
    except OSError as error:
        raise InputError("command line", "--out", str(file), error.strerror or str(error)) from None


def scene_file(path: Path) -> Path:
    """Return the scene file that `path` names: itself, `scene.toml` in this folder, or a workflow of this name.

    Raises InputError if the file is a study.  A missing file is no error here: the function that reads it will raise
    one.
    """
    file = _find_file(path, "scene.toml")
    if "kind" in tables_or_empty(file):
        raise InputError("command line", "SCENE", str(path), f"that is a study: pmr study {path} computes it")
    return file


def is_study(path: Path) -> bool:
    """Return whether `path` is a study file, or a workflow of that name that is a study.

    A folder is a study if it has a ``study.toml`` and no ``scene.toml``.
    """
    file = _find_file(path, "study.toml")
    return not isfile(path / "scene.toml") and (file == path / "study.toml" or "kind" in tables_or_empty(file))


def study_file(path: Path) -> Path:
    """Return the study file that `path` names: itself, `study.toml` in this folder, or a workflow of this name.

    For the name of an experiment of the paper by Weyrer et al. (docs/paper.md), the path of its script is returned.
    Raises InputError if the file is a scene.
    """
    from pmr.scene.tomlfiles import experiments

    script = experiments().get(str(path))
    if script and not path.is_file():
        return script
    file = _find_file(path, "study.toml")
    keys = tables_or_empty(file)
    if "kind" not in keys and {"body", "slider", "sections"} & set(keys):
        raise InputError("command line", "STUDY", str(path), f"that is a scene: pmr run {path} computes it")
    return file


def _find_file(path: Path, within: str) -> Path:
    """Return a file by its path, or the file called `within` in a folder, or a workflow by its name."""
    from pmr.scene.tomlfiles import resolve_path  # loaded late: it takes longer than printing a help text

    return resolve_path(path, within)


def tables_or_empty(file: Path) -> dict[str, object]:
    """Return the tables of a file by name.

    The result is empty if the file can't be read, as a later function reports the reason.
    """
    from pmr.scene.tomlfiles import read_tables

    try:
        return read_tables(file, "file")
    except InputError:
        return {}


def summary_beside(model: Path) -> Any:
    """Return the content of the ``summary.json`` that a run left beside its `model`; an empty table if there is none.

    Raises InputError if the file is not JSON.
    """
    file = model.with_name("summary.json")
    try:
        return json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
    except ValueError as error:
        raise InputError(str(file), "", None, f"JSON is allowed: {error}") from None


def prepare_streams() -> None:
    """Open standard input, output and error as far as they are closed, and let standard output write any letter.

    If a stream stayed closed, a file of results could get its number, and would contain what libraries print.  Letters
    that the encoding lacks are written as escapes, as on standard error.
    """
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # it gets the lowest free number, which is this one
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, mode, closefd=False))
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")


def output_failure() -> OSError | None:
    """Return the error for which standard output takes no more text, or None if standard output works.

    After an error the text that was not taken is dropped, because Python would try to write it again at its end.
    """
    try:
        sys.stdout.flush()
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return error
    return out.failure


def exit_with_message(message: str, code: int) -> NoReturn:
    """Print a message on standard error, and end this process and all other MPI ranks with the exit code `code`."""
    err.text(f"pmr: {message}")
    if rank_count() > 1:
        sys.modules["mpi4py.MPI"].COMM_WORLD.Abort(code)
    sys.exit(code)


def rank_count() -> int:
    """Return the number of MPI ranks of this run, without starting MPI; 1 if MPI was not loaded."""
    mpi = sys.modules.get("mpi4py.MPI")
    return mpi.COMM_WORLD.size if mpi else 1


def rank_number() -> int:
    """Return the number of this MPI rank; 0 if MPI was not loaded."""
    mpi = sys.modules.get("mpi4py.MPI")
    return mpi.COMM_WORLD.rank if mpi else 0
