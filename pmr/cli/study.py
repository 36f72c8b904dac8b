"""``pmr study`` and ``pmr chart``: progress on a terminal or in a log, and summary of the results."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer
from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as Bars
from rich.table import Table
from typer import Argument, Option

from pmr.cli import console
from pmr.cli.console import QUIET, Folder, Jobs, Overrides, SceneFile, err, out
from pmr.errors import InputError, environment, escape_controls

if TYPE_CHECKING:
    from pmr.studies import workers
    from pmr.studies.call import Outcome, Progress, Project, Watch

LOGGED_EVERY = 30.0  # s between two lines of progress if there is no terminal
SHOWN_FAILURES, SHOWN_KEYS, SHOWN_RUNS = 10, 5, 20
COLUMN = 14  # number of letters that a column of the table takes


def study(
    study_file: Annotated[
        Path,
        Argument(
            metavar="STUDY",
            help="File of a study or of a collection of studies, or the name of one that comes with pmr.",
        ),
    ],
    out_dir: Folder = None,
    jobs: Jobs = None,
    overrides: Overrides = None,
    only: Annotated[
        list[str] | None, Option(metavar="RUN", help="Compute only this run, without a table; repeatable.")
    ] = None,
    listed: Annotated[bool, Option("--list", help="Print the names of all runs, and compute nothing.")] = False,
) -> None:
    """Compute many runs and make one table of them.

    DIR then has runs.csv and runs.npz (one row for each run), seconds.csv and summary.json, or a folder of these for
    each study of a collection.  After an interruption the same command computes what is missing, and repeats runs that
    failed.  Results of another version of pmr are not reused.

    A run that fails is recorded with its reason and the others go on; the exit code is then 1.

    Batch systems may take the runs one by one: --list names them, --only computes one of them into DIR, and a last call
    without either makes the table.

    For example:

        pmr study coordinates --jobs 2

        pmr study coordinates --set "grid.reduction.coordinates=[6, 8]"

        mpiexec -n 9 python -m mpi4py.futures -m pmr study coordinates    (8 workers)
    """
    from pmr.scene.tomlfiles import experiments, result_name
    from pmr.studies import call
    from pmr.studies.call import compute_results, save
    from pmr.studies.study import TABLES

    file = console.study_file(study_file)
    if file in experiments().values():
        _run_experiment(file, out_dir, jobs, overrides or [], only or [], listed)
    if listed:
        for name in call.load(file, overrides or ()).runs:
            out.text(name)
        return
    environment.check_report()  # before the work, not after it
    folder = out_dir or Path("reports", result_name(study_file))
    try:
        with _worker_pool(jobs) as pool:
            if pool is None:
                return  # this rank is a worker, and the first rank has finished
            project = call.load(file, overrides or ())
            chosen = project.select_runs(only) if only else project
            for part in chosen.parts:
                console.prepare_folder(folder / part.name, TABLES)
            console.prepare_folder(folder / "tasks", ("*.npz",))
            with _show_progress() as watch:
                outcome = compute_results(chosen, folder, pool, watch)
    except KeyboardInterrupt:
        err.text("interrupted; the same command goes on from here")
        raise typer.Exit(130) from None
    _print_failures(outcome)
    if not only:
        for table in save(project, outcome, folder):
            out.text(f"table  {table}")
        from pmr.report.studies import write_report

        try:
            report = write_report(folder)
            out.text(f"report {report.html}")
            out.text(f"report {report.pdf}")
        except Exception as error:  # any error of the report; the tables are stored
            err.text(f"pmr: {console.report_failure_message(error, folder)}")
            raise typer.Exit(1) from None
    earlier = "" if outcome.computed or not outcome.done else ", all of them earlier"
    out.text(f"{outcome.done} of {len(chosen.runs)} runs are done{earlier}")
    if not only:
        _print_results(chosen, outcome)
    if not outcome.is_complete:
        raise typer.Exit(1)


def _run_experiment(
    script: Path, out_dir: Path | None, jobs: int | None, overrides: list[str], only: list[str], listed: bool
) -> NoReturn:
    """Run the script of an experiment of the paper (docs/paper.md) in its own process, and exit with its code.

    `out_dir`, `jobs` and `overrides` are passed on to the script unless they are None or empty.  Raises InputError for
    the options --only and --list (`only` and `listed`), which scripts do not have.
    """
    if only or listed:
        allowed = f"a study file is allowed: {script.name} is one script, whose rows are computed in processes"
        raise InputError("command line", "--only" if only else "--list", script.stem, allowed)
    options = [f"--out={out_dir}"] if out_dir else []
    options += [f"--jobs={jobs}"] if jobs else []
    options += [f"--set={change}" for change in overrides]
    raise typer.Exit(subprocess.run([sys.executable, str(script), *options], check=False).returncode)


def _worker_pool(jobs: int | None) -> AbstractContextManager[workers.Pool | None]:
    """Return a context with the pool of `jobs` worker processes; if `jobs` is None, one on each core.

    Under MPI, ranks that are workers get None, and InputError is raised if `jobs` is given.
    """
    from pmr.studies import workers

    if workers.count_ranks() == 1:
        return workers.local_pool(jobs or environment.available_cores())
    if jobs:
        raise InputError("command line", "--jobs", jobs, "under MPI all ranks but the first are workers; leave it out")
    return workers.rank_pool()


@contextmanager
def _show_progress() -> Iterator[Watch]:
    """Yield a function that shows progress: on a terminal a bar with a clock, elsewhere lines.

    After `QUIET` s there is a line for each kind of task that begins, and one every `LOGGED_EVERY` s.
    """
    if not err.is_terminal:
        due, printed = [LOGGED_EVERY], set[str]()

        def log(progress: Progress) -> None:
            begins = progress.elapsed >= QUIET and not printed >= progress.stages
            if begins or progress.elapsed >= due[0]:
                err.text(progress.text)
                printed.update(progress.stages)
                due[0] = progress.elapsed + LOGGED_EVERY

        yield log
        return
    columns = (BarColumn(), TimeElapsedColumn(), TextColumn("{task.description}", markup=False))
    with Bars(*columns, console=err, transient=True) as bars:
        bar = bars.add_task("", total=None)
        yield lambda p: bars.update(bar, description=p.text, completed=p.done + p.failed, total=p.total)


def _print_results(project: Project, outcome: Outcome) -> None:
    """Print the table, summary and warnings of each study of a project that has results in `outcome`."""
    from pmr.report.studies import chart_tables
    from pmr.report.studies.runs import terminal_grid

    for part in project.parts:
        results = outcome.results[part.name]
        if not results.done:
            continue
        if part.study.kind == "chart":
            grid = chart_tables.terminal_grid(results, SHOWN_RUNS, part.study.model_dump())
        else:
            grid = terminal_grid(results.runs, out.width // COLUMN, SHOWN_RUNS)
        table = Table(
            title=escape_controls(part.study.title), title_justify="left", caption=grid.caption, title_style="bold"
        )
        for number, head in enumerate(grid.head):
            table.add_column(escape_controls(head), justify="right" if number else "left", vertical="bottom")
        for row in grid.rows:
            table.add_row(*map(escape_controls, row))
        out.print(table)
        if results.is_complete and (line := part.study.summary_line(results)):
            out.text(line)
        for warning in results.warnings:
            out.sentences(f"warning: {warning.line(len(results.runs))}")
        for hint in part.study.hints():
            out.sentences(f"warning: {hint}")


def _print_failures(outcome: Outcome) -> None:
    """Print the first `SHOWN_FAILURES` reasons for failed or missing runs in `outcome`, each with its runs."""
    runs = dict[tuple[str, str], list[str]]()
    for name, results in outcome.results.items():
        for record in results.runs:
            if record.status != "done":
                runs.setdefault((record.status, record.reason), []).append(f"{name}/{record.key}".lstrip("/"))
    for (status, reason), keys in list(runs.items())[:SHOWN_FAILURES]:
        more = f" and {len(keys) - SHOWN_KEYS} more" if len(keys) > SHOWN_KEYS else ""
        err.text(f"{status}: {', '.join(keys[:SHOWN_KEYS])}{more}: {reason}")
    if len(runs) > SHOWN_FAILURES:
        err.text(f"and {len(runs) - SHOWN_FAILURES} more reasons")
    if runs:
        err.text("these are in no table; the same command computes them again")


STUDY = "chart.toml"


def chart(
    scene: SceneFile,
    up_to: Annotated[
        float | None,
        Option(
            metavar="KG",
            help="Largest load that is looked for.",
            show_default="the mass of machine and boom; without a machine, five times the mass of the boom",
        ),
    ] = None,
    out_dir: Folder = None,
    jobs: Jobs = None,
    overrides: Annotated[
        list[str] | None, Option("--set", metavar="KEY=VALUE", help="Change a key of the scene; repeatable.")
    ] = None,
) -> None:
    """Compute what a boom carries at every extension and angle.

    Writes chart.toml, a study over the extensions and luffing angles of the scene, into the folder DIR (--out), and
    computes it as `pmr study` does.  To change limits and factors, edit chart.toml and run the command again: a
    chart.toml that exists is used as it is.  The options --up-to and --set are then refused unless they have the values
    with which this chart.toml was written.

    Example:

        pmr chart crane

        pmr chart crane --up-to 20000

        pmr chart crane --set sections.fly.body.box.wall=0.009
    """
    environment.check_report()  # before a folder is made, and before what needs the packages is imported
    from pmr.scene import load_any
    from pmr.scene.choice import traits_of
    from pmr.scene.members import members
    from pmr.scene.tomlfiles import merge_tables, override, result_name, toml_value
    from pmr.studies.chart_draft import chart_study_text, check_chart, usual_load, words_of_usual_load

    file = console.scene_file(scene)
    folder = out_dir or Path("reports", f"chart_{result_name(scene)}")
    written = folder / STUDY
    loaded, largest = None if written.exists() else load_any(file, overrides or ()), up_to
    change = dict[str, object]()
    for text in overrides or ():
        change = merge_tables(change, override(text).tables)
    present = console.tables_or_empty(written) if loaded is None else {}
    for option, key, value in (("--up-to", "up_to", up_to), ("--set", "change", change or None)):
        if present and value is not None and present.get(key) != value:
            allowed = (
                f"{toml_value(present[key]) if key in present else 'none'} is allowed, the {key} of {written}, which "
            )
            shown = ", ".join(overrides or ()) if option == "--set" else value
            raise InputError("command line", option, shown, f"{allowed}exists: change it there, or remove the file")
    if loaded is not None:
        if any(traits_of(member).needs_fenicsx for member in members(loaded)):
            environment.check_installed("dolfinx")
        largest = usual_load(loaded) if up_to is None else up_to
        check_chart(file, loaded, largest)
    console.prepare_folder(folder, (STUDY, "tasks/*.npz"))
    if loaded is not None and largest is not None:
        written.write_text(chart_study_text(file, loaded, largest, change), encoding="utf-8")
        if up_to is None:
            sentence = (
                f"{largest:.6g} kg is the largest load that is looked for, {words_of_usual_load(loaded)}, rounded up"
            )
            out.sentences(f"{sentence}; --up-to KG sets another")
        out.text(f"study  {written}  the study of this chart: add limits to it, and run the command again")
    study(written, out_dir=folder, jobs=jobs)
