"""``pmr run``: compute scenes from mesh to report, with a second process that helps while it goes on."""

from __future__ import annotations

import json
import logging
import os
import signal
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor
from contextlib import closing, contextmanager, suppress
from functools import partial
from importlib import import_module
from multiprocessing import active_children, get_context, parent_process
from pathlib import Path
from threading import Timer
from typing import TYPE_CHECKING, Annotated

from rich.box import SIMPLE_HEAD
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table
from typer import Argument, Option

from pmr.cli import console
from pmr.cli.console import NAMES, QUIET, Folder, Overrides, err, out
from pmr.errors import ConvergenceError, InputError, SimulationError, duration_text, environment, escape_controls
from pmr.files.whole import remove_matching, replacement_folder

if TYPE_CHECKING:
    from pmr.errors.environment import Progress as Report
    from pmr.pipeline import Outcome
    from pmr.report.blocks import Row
    from pmr.scene import Scene


def run(
    scene_files: Annotated[
        list[Path],
        Argument(
            metavar="SCENE", help="Scene files, folders with a scene.toml, or names of scenes that come with pmr."
        ),
    ],
    out_dir: Folder = None,
    overrides: Overrides = None,
    simulators: Annotated[
        str | None,
        Option(
            metavar="NAME,...",
            help="Simulate the reduced model by each: march, exudyn, exudyn-multiplier, exudyn-callback.",
        ),
    ] = None,
    tolerance: Annotated[
        str | None,
        Option(metavar="PERCENT", help="Allowed error, such as 1%: coordinates and step are chosen accordingly."),
    ] = None,
    cache: Annotated[
        Path | None,
        Option(
            metavar="DIR",
            help="Store reductions there, and reuse them in runs with other loads or another motion along the path.",
        ),
    ] = None,
) -> None:
    """Compute scenes: reduced model, simulation, comparison, report.

    The results are written to the folder DIR (--out): report.html, report.pdf, summary.json, trajectories.npz and the
    reduced model.  The reduced model is reduced.npz for a single body and system.npz for several sections.  If the
    scene has a table [recovery], there are also fields.npz and fields.pvd, which ParaView opens.  If several scenes are
    given, they have one report together, and each scene has a folder for its other files.

    A run that is killed leaves the old results as they were.  If it is killed in its last step, which measures the
    errors of mesh and model, it leaves the new results without their report.  If the simulation of a full model in
    PETSc was interrupted, the same command continues it.


    For example:

        pmr run paper_evolved

        pmr run paper_evolved --set reduction.coordinates=10

        pmr run paper_evolved --simulators march,exudyn,exudyn-callback

        pmr run paper_evolved --tolerance 1%

        pmr run boom_shell --cache reports/cache --set "compare.against=[]"

        mpirun -n 2 pmr run SCENE.toml --set reduction.solver=slepc
    """
    from pmr import scene as scenes
    from pmr.scene.choice import traits_of
    from pmr.scene.members import members
    from pmr.scene.tomlfiles import result_name

    changes = [*(overrides or ())]
    if simulators is not None:
        changes.append(f"simulation.simulators={json.dumps([name.strip() for name in simulators.split(',')])}")
    names = [result_name(file) for file in scene_files]
    files = [console.scene_file(file) for file in scene_files]
    by_tolerance = {} if tolerance is None else {file: _tolerance_overrides(tolerance, file) for file in files}
    loaded = [
        (name, file, scenes.load_any(file, [*by_tolerance.get(file, ()), *changes]))
        for name, file in zip(names, files, strict=True)
    ]
    if len(set(names)) != len(names):
        raise InputError("command line", "SCENE", names, "names must differ")
    if any(traits_of(member).needs_fenicsx for *_, scene in loaded for member in members(scene)):
        environment.check_installed("dolfinx")
    environment.check_report()  # before the work, not after it
    folder = out_dir or Path("reports", names[0])
    from pmr.results import RESULT_FILES

    for where in {folder, *(folder / name for name in names if len(names) > 1)}:
        console.prepare_folder(where, RESULT_FILES)
    outcomes = []
    with helper_process() as helper:
        if helper is not None and any(part.body.box for *_, scene in loaded for part in scene.sections):
            with suppress(OSError):
                helper.submit(import_module, "pmr.pipeline")  # at the same time as this process
        import numpy as np

        from pmr.errors.environment import Clock
        from pmr.files.whole import user_cache_folder
        from pmr.pipeline import run as run_scene

        first = console.rank_number() == 0
        for name, file, scene in loaded:
            where = folder if len(loaded) == 1 else folder / name
            checkpoint = where / f"full-{scene.hash}.checkpoint"
            with _progress(name, shown=first) as progress:
                try:
                    outcome = run_scene(
                        scene,
                        clock=Clock(progress),
                        checkpoint=checkpoint,
                        cache=cache,
                        measures=cache or user_cache_folder(),
                        keep=partial(_save_results, where, folder, helper),
                        helper=helper,
                    )
                except (InputError, SimulationError, ConvergenceError) as error:
                    _print_hints(scene)
                    raise error.with_source(str(file)) if isinstance(error, InputError) else error from None
                except (np.linalg.LinAlgError, ArithmeticError) as error:
                    allowed = f"sizes, stiffnesses and masses that double precision can carry are allowed ({error})"
                    raise InputError(str(file), "", None, allowed) from None
            if outcome is not None:
                with replacement_folder(where, ("summary.json",)) as new:
                    outcome.result.save_summary(new)
                checkpoint.unlink(missing_ok=True)
                outcomes.append(outcome)
        if outcomes:
            for outcome in outcomes:
                _print_outcome(outcome)
            with _progress("report", shown=first) as progress:
                progress("write", 0.0)
                from pmr.report.document import write_report

                try:
                    written = write_report([outcome.result for outcome in outcomes], folder, helper)
                except Exception as error:  # any error of the report; the computed results are stored
                    console.exit_with_message(console.report_failure_message(error, folder), 1)
            out.text(f"report  {written.html}")
            out.text(f"        {written.pdf}")


def _print_hints(scene: Scene) -> None:
    """Print a warning for each unusual number in a scene whose run failed, as this number may be the reason."""
    from pmr.scene.hints import hints

    for hint in hints(scene) if console.rank_number() == 0 else ():
        err.sentences(f"warning: {hint}")


def _save_results(folder: Path, of_all: Path, helper: Executor | None, outcome: Outcome) -> None:
    """Write all results of a run but its report into `folder`, and remove old reports there and in `of_all`.

    `of_all` is the folder of the report about all scenes of the run.  A process of `helper` imports what the report
    needs while this process measures errors.
    """
    from pmr.export.paraview import MovingFields, pads_over_time, write_series
    from pmr.report.blocks import REPORT_FILES
    from pmr.results import RESULT_FILES
    from pmr.results.tables import write_tables

    if helper is not None:
        with suppress(BrokenExecutor, OSError):
            helper.submit(import_module, "pmr.report.sections")
    result = outcome.result
    recovery = result.scene.recovery
    if folder != of_all:
        remove_matching(of_all, REPORT_FILES)
    with replacement_folder(folder, (*RESULT_FILES, *REPORT_FILES)) as new:
        result.save(new)
        write_tables(result, new)
        outcome.save(new)
        bodies = {
            name: MovingFields(fields, along, result.pose(fields.t))
            for name, (fields, along) in result.moving_fields.items()
        }
        if recovery is not None and recovery.series and bodies:
            write_series(new, "fields", bodies, pads_over_time(result))


def _tolerance_overrides(tolerance: str, file: Path) -> list[str]:
    """Return the changes of the scene in `file` for ``--tolerance``: the `tolerance`, and a reduction sized by it.

    Sections of a boom have such a reduction anyway.  Raises InputError unless the tolerance is between 0 and 1.
    """
    from pmr.scene import has_sections

    text = tolerance.strip()
    try:
        share = float(text.removesuffix("%")) / (100.0 if text.endswith("%") else 1.0)
    except ValueError:
        share = float("nan")
    if not 0.0 < share < 1.0:
        allowed = "more than 0 and less than 100% is allowed, as 1% or 0.01"
        raise InputError("command line", "--tolerance", tolerance, allowed)
    basis = [] if has_sections(file) else ["reduction.basis=free_modes", "reduction.flexibility=true"]
    return [*basis, f"accuracy.tolerance={share!r}"]


def _print_outcome(outcome: Outcome) -> None:
    """Print title, largest values, errors with published ones, coordinates, computing times and warnings of a run.

    How far to trust the run is printed too, and by how much two simulators agree.
    """
    from pmr.report import errors, first_page, trust
    from pmr.report.verdict import verdict

    result, summary = outcome.result, outcome.result.summary
    out.print(escape_controls(result.scene.title), style="bold")
    said = verdict(result)
    for sentence in (said.text, *said.notes):
        out.sentences(sentence)
    out.rows(first_page.largest_value_rows(result))
    _print_errors(errors.rows(result))
    each = ", ".join(
        f"{section['name']} {section['coordinates']['reduced']}" for section in summary.get("sections", ())
    )
    models = {"full": "full model", "ancf": "ANCF cable"}
    models |= {name: f"reduced model ({words})" for name, words in environment.SIMULATOR_WORDS.items()}
    seconds = ", ".join(f"{models[name]} {value:.3g} s" for name, value in summary["seconds"]["simulate"].items())
    coordinates = f"{summary['coordinates']['full']} -> {summary['coordinates']['reduced']} coordinates"
    out.sentences(f"{coordinates}{f' ({each})' if each else ''}; simulated in: {seconds}")
    table = trust.trust_table(result)
    out.sentences(f"{table.title}: errors by their source")
    out.rows(table.rows)
    for warning in summary["warnings"]:
        out.sentences(f"warning: {warning}")
    for pair, length in summary["agreement"].items():
        out.text(f"{pair.replace('_vs_', ' and ')} agree to {length:.1e} m")
    out.print()


def _print_errors(error_rows: Sequence[Row]) -> None:
    """Print a table of errors, one line for each of `error_rows`.

    The table has a column of published numbers if one of the rows has such a number.
    """
    published = any(row.published for row in error_rows)
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    numbers = ("this run", "published") if published else ("value",)
    for head in ("normalised RMS errors, and largest values", *numbers, *(("",) if published else ())):
        table.add_column(head, justify="right" if head in numbers else "left")
    above = ""
    for row in error_rows:
        if row.place and row.comparison != above:
            table.add_row(escape_controls(row.comparison))
        above = row.comparison
        mark = f"{row.mark.symbol} {row.mark.text}" if row.mark else ""
        called = console.wrap_at_spaces(f"  {row.place}" if row.place else row.comparison, NAMES + 12, "    ")
        table.add_row(called, escape_controls(row.value), *([row.published or "", mark] if published else []))
    out.print(table)


class _StageLines:
    """Progress of a run without a terminal: a line on standard error for each stage, once `QUIET` s have passed."""

    def __init__(self, title: str) -> None:
        """Start the timer of the first line; lines begin with `title`, the name of the run's scene."""
        self._title, self._begin = title, time.monotonic()
        self._stage, self._printed = "", set[str]()
        self._timer = Timer(QUIET, self._print)
        self._timer.daemon = True
        self._timer.start()

    def __call__(self, stage: str, share: float) -> None:
        """Store the present stage unless its `share` is 1, and print the stage once the run has taken `QUIET` s."""
        if share < 1.0:
            self._stage = stage
            if time.monotonic() - self._begin >= QUIET:
                self._print()

    def _print(self) -> None:
        """Print the present stage, unless it has been printed before."""
        if self._stage and self._stage not in self._printed:
            self._printed.add(self._stage)
            after = duration_text(time.monotonic() - self._begin)
            err.text(f"{self._title}: now {environment.stage_words(self._stage)}, after {after}")

    def close(self) -> None:
        """Stop printing stages."""
        self._timer.cancel()


@contextmanager
def _progress(title: str, shown: bool) -> Iterator[Report]:
    """Yield a function that shows progress: on a terminal a bar for each stage, elsewhere a line.

    `title` is what the run is called.  The function shows nothing if `shown` is false, as it is on all ranks but the
    first.
    """
    if shown and not err.is_terminal:
        with closing(_StageLines(title)) as lines:
            yield lines
        return
    columns = (TextColumn("{task.description:32}", markup=False), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=err, transient=True, disable=not (shown and err.is_terminal)) as bars:
        tasks: dict[str, TaskID] = {}

        def report(stage: str, share: float) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(f"{title}: {environment.stage_words(stage)}", total=1.0)
            bars.update(tasks[stage], completed=share)

        yield report


@contextmanager
def helper_process() -> Iterator[Executor | None]:
    """Yield an executor of one process, which starts at the first task; yield None if no core is free.

    At the end the process is terminated, and so are all other child processes that multiprocessing has started.
    """
    pool = ProcessPoolExecutor(1, get_context("spawn"), _begin_to_help) if has_free_core() else None
    try:
        yield pool
    finally:
        if pool is not None:
            for process in active_children():  # a run that fails does not wait for its help
                process.terminate()
            pool.shutdown(cancel_futures=True)  # its thread would close a pipe on which Python still writes at exit


def _begin_to_help() -> None:
    """Prepare a helper process: let it end with its parent, leave the parent's MPI job, and log as the command line.

    An interrupt from the keyboard is ignored, because the parent ends the process.
    """
    for name in [name for name in os.environ if name.startswith(environment.MPI_VARIABLES)]:
        del os.environ[name]
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends this process
    threading.Thread(target=_end_with_parent, daemon=True).start()
    logging.basicConfig(format="%(levelname)s %(message)s")


def has_free_core() -> bool:
    """Whether a second process would have a core for itself.

    The result is true if this process may use several cores and no launcher of MPI started another process together
    with this one.  Other programs, which may use the cores as well, are not looked at.
    """
    return environment.available_cores() > 1 and environment.launched_process_count() == 1


def _end_with_parent() -> None:
    """Wait until the parent process ends, then exit this process with status 1.

    The call blocks, and therefore runs in a thread.
    """
    if (parent := parent_process()) is not None:
        parent.join()
        os._exit(1)
