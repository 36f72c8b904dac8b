"""The command ``pmr study``: progress on a terminal or in a log, and what came out."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import BarColumn, TextColumn
from rich.progress import Progress as Bars

from pmr.console import ensure_writable, err, out, say
from pmr.errors import InputError
from pmr.studies import files, pools
from pmr.studies.call import Outcome, compute
from pmr.studies.runner import Progress, Watch

LOGGED_EVERY = 30.0  # s, where there is no terminal
SHOWN_FAILURES = 10


def study(
    study_file: Annotated[Path, typer.Argument(metavar="STUDY.toml", help="A study, or a collection of studies.")],
    out_dir: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Where results go.  [default: reports/STUDY]")
    ] = None,
    jobs: Annotated[
        int | None, typer.Option("--jobs", metavar="N", min=1, help="Worker processes.  [default: one a core]")
    ] = None,
    overrides: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Override a key of the study; repeatable.")
    ] = None,
) -> None:
    """Compute many runs, several at a time, and make one table of them.

    DIR then holds runs.csv and runs.npz (one row a run), seconds.csv and summary.json, or a folder of these for each
    study of a collection. Called again, it goes on where it was cut off, with the runs that failed tried once more;
    results made by another version of pmr are not taken over.

    A run that fails is recorded with its reason and the others go on; the exit code is then 1.

    Examples
    --------
        pmr study workflows/studies/coordinates.toml --jobs 2

        pmr study workflows/studies/coordinates.toml --set "grid.reduction.coordinates=[6, 8]"

        mpiexec -n 9 python -m mpi4py.futures -m pmr study workflows/studies/coordinates.toml    (8 workers)
    """
    ranks = pools.launched_ranks()
    if ranks > 1 and jobs:
        raise InputError("command line", "--jobs", jobs, f"the {ranks - 1} ranks beside the first are the workers")
    try:
        with pools.rank_pool() if ranks > 1 else pools.local_pool(jobs or pools.cores()) as pool:
            if pool is None:
                return  # a rank that has worked for the first one
            project = files.load(study_file, overrides or ())
            folder = out_dir or Path("reports", study_file.stem)
            ensure_writable(folder)
            with _watching() as watch:
                outcome = compute(project, folder, pool, watch)
    except KeyboardInterrupt:
        say(err, "interrupted; the same command goes on from here")
        raise typer.Exit(130) from None
    _tell(outcome, folder)
    if not outcome.is_complete:
        raise typer.Exit(1)


@contextmanager
def _watching() -> Iterator[Watch]:
    """A bar on a terminal; elsewhere a line in the log now and then."""
    if not err.is_terminal:
        yield _LogLines()
        return
    with Bars(BarColumn(), TextColumn("{task.description}"), console=err, transient=True) as bars:
        bar = bars.add_task("", total=None)
        yield lambda p: bars.update(bar, description=p.text, completed=p.done + p.failed, total=p.total)


class _LogLines:
    """Every `LOGGED_EVERY` seconds a line."""

    def __init__(self) -> None:
        self._next = time.monotonic() + LOGGED_EVERY

    def __call__(self, progress: Progress) -> None:
        if time.monotonic() >= self._next:
            say(err, progress.text)
            self._next = time.monotonic() + LOGGED_EVERY


def _tell(outcome: Outcome, folder: Path) -> None:
    runs = [(name, run) for name, results in outcome.results.items() for run in results.runs]
    wrong = [(name, run) for name, run in runs if run.status != "done"]
    for name, run in wrong[:SHOWN_FAILURES]:
        say(err, f"{run.status}: {f'{name}/' if name else ''}{run.key}: {run.reason}")
    if len(wrong) > SHOWN_FAILURES:
        say(err, f"and {len(wrong) - SHOWN_FAILURES} more, see runs.csv")
    for results in outcome.results.values():
        say(out, f"table  {results.folder}/runs.csv")
    done = len(runs) - len(wrong)
    say(out, f"{done} of {len(runs)} runs are there; {outcome.computed} tasks were computed now")
