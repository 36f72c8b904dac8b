"""``pmr study`` and ``pmr chart``: progress on a terminal or in a log, and summary of the results."""

from __future__ import annotations

import json
import math
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

from pmr.cli.console import (
    QUIET,
    Folder,
    Jobs,
    Overrides,
    SceneFile,
    err,
    out,
    prepare_folder,
    print_sentences,
    print_text,
    report_failure_message,
    scene_file,
)
from pmr.cli.console import study_file as found_file
from pmr.errors import InputError, environment
from pmr.errors.text import escape_controls

if TYPE_CHECKING:
    from pmr.scene import Scene
    from pmr.scene.frame import Frame
    from pmr.studies import workers
    from pmr.studies.call import Outcome, Progress, Project, Watch

LOGGED_EVERY = 30.0  # s between two lines of progress if there is no terminal
SHOWN_FAILURES, SHOWN_KEYS, SHOWN_RUNS = 10, 5, 20
COLUMN = 14  # number of letters that a column of the table takes


def study(
    study_file: Annotated[
        Path,
        typer.Argument(
            metavar="STUDY",
            help="File of a study or of a collection of studies, or the name of one that comes with pmr.",
        ),
    ],
    out_dir: Folder = None,
    jobs: Jobs = None,
    overrides: Overrides = None,
    only: Annotated[
        list[str] | None,
        typer.Option("--only", metavar="RUN", help="Compute only this run, without a table; repeatable."),
    ] = None,
    listed: Annotated[bool, typer.Option("--list", help="Print the names of all runs, and compute nothing.")] = False,
) -> None:
    """Compute many runs and make one table of them.

    DIR then has runs.csv and runs.npz (one row for each run), seconds.csv and summary.json, or a folder of these for
    each study of a collection. After an interruption the same command computes what is missing, and tries runs again
    that failed. Results of another version of pmr are not reused.

    A run that fails is recorded with its reason and the others go on; the exit code is then 1.

    Batch systems may take the runs one by one: --list names them, --only computes one of them into DIR, and a last
    call without either makes the table.

    For example:

        pmr study coordinates --jobs 2

        pmr study coordinates --set "grid.reduction.coordinates=[6, 8]"

        mpiexec -n 9 python -m mpi4py.futures -m pmr study coordinates    (8 workers)
    """
    from pmr.scene.tomlfiles import experiments
    from pmr.studies import call
    from pmr.studies.call import compute_results, save
    from pmr.studies.study import TABLES

    file = found_file(study_file)
    if file in experiments().values():
        _run_experiment(file, out_dir, jobs, overrides or [], only or [], listed)
    if listed:
        for name in call.load(file, overrides or ()).runs:
            print_text(out, name)
        return
    environment.check_report()  # before the work, not after it
    folder = out_dir or Path("reports", study_file.stem)
    try:
        with _worker_pool(jobs) as pool:
            if pool is None:
                return  # this rank is a worker, and the first rank has finished
            project = call.load(file, overrides or ())
            chosen = project.select_runs(only) if only else project
            for part in chosen.parts:
                prepare_folder(folder / part.name, TABLES)
            prepare_folder(folder / "tasks", ("*.npz",))
            with _show_progress() as watch:
                outcome = compute_results(chosen, folder, pool, watch)
    except KeyboardInterrupt:
        print_text(err, "interrupted; the same command goes on from here")
        raise typer.Exit(130) from None
    _print_failures(outcome)
    if not only:
        for table in save(project, outcome, folder):
            print_text(out, f"table  {table}")
        from pmr.report.studies import write_report

        try:
            print_text(out, f"report {write_report(folder).html}")
        except Exception as error:  # any error of the report; the tables are stored
            print_text(err, f"pmr: {report_failure_message(error, folder)}")
            raise typer.Exit(1) from None
    print_text(out, f"{outcome.done} of {len(chosen.runs)} runs are there; {outcome.computed} tasks were computed now")
    if not only:
        _print_results(chosen, outcome)
    if not outcome.is_complete:
        raise typer.Exit(1)


def _run_experiment(
    script: Path, out_dir: Path | None, jobs: int | None, overrides: list[str], only: list[str], listed: bool
) -> NoReturn:
    """Run the script of an experiment of the paper (docs/paper.md) in its own process, and exit with its code.

    Raises InputError for the options --only and --list, which scripts do not have.
    """
    if only or listed:
        allowed = f"a study file is allowed: {script.name} is one script, whose rows are computed in processes"
        raise InputError("command line", "--only" if only else "--list", script.stem, allowed)
    options = [f"--out={out_dir}"] if out_dir else []
    options += [f"--jobs={jobs}"] if jobs else []
    options += [f"--set={change}" for change in overrides]
    raise typer.Exit(subprocess.run([sys.executable, str(script), *options], check=False).returncode)


def _worker_pool(jobs: int | None) -> AbstractContextManager[workers.Pool | None]:
    """Return a context with the pool of `jobs` worker processes; None stands for one on each core.

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
                print_text(err, progress.text)
                printed.update(progress.stages)
                due[0] = progress.elapsed + LOGGED_EVERY

        yield log
        return
    columns = (BarColumn(), TimeElapsedColumn(), TextColumn("{task.description}", markup=False))
    with Bars(*columns, console=err, transient=True) as bars:
        bar = bars.add_task("", total=None)
        yield lambda p: bars.update(bar, description=p.text, completed=p.done + p.failed, total=p.total)


def _print_results(project: Project, outcome: Outcome) -> None:
    """Print the table, summary and warnings of each study that has results."""
    from pmr.report.studies.runs import terminal_grid

    for part in project.parts:
        results = outcome.results[part.name]
        if all(run.status != "done" for run in results.runs):
            continue
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
            print_text(out, line)
        for warning in results.warnings:
            print_sentences(out, f"warning: {warning.line(len(results.runs))}")
        for hint in part.study.hints():
            print_sentences(out, f"warning: {hint}")


def _print_failures(outcome: Outcome) -> None:
    """Print the first `SHOWN_FAILURES` reasons why runs failed or are missing, each with these runs."""
    runs = dict[tuple[str, str], list[str]]()
    for name, results in outcome.results.items():
        for record in results.runs:
            if record.status != "done":
                runs.setdefault((record.status, record.reason), []).append(f"{name}/{record.key}".lstrip("/"))
    for (status, reason), keys in list(runs.items())[:SHOWN_FAILURES]:
        more = f" and {len(keys) - SHOWN_KEYS} more" if len(keys) > SHOWN_KEYS else ""
        print_text(err, f"{status}: {', '.join(keys[:SHOWN_KEYS])}{more}: {reason}")
    if len(runs) > SHOWN_FAILURES:
        print_text(err, f"and {len(runs) - SHOWN_FAILURES} more reasons")
    if runs:
        print_text(err, "these are in no table; the same command computes them again")


STUDY = "chart.toml"
#: Number of extensions and number of angles in the chart study that `pmr chart` writes.
EXTENSIONS, ANGLES = 12, 10
#: Number of slewing angles in a whole turn.
SLEWING_STEPS = 8
#: Limit of a chart whose scene says on what the machine stands.
TIPPING = """
[[limits]]
name = "tipping"
of = "tipping"
most = 1.0      # use of the support polygon: at 1 the machine tips
factor = 1.33   # so that at most three quarters of it are used; your standard has the factor of your machine
"""
#: Limit of a chart whose scene has probes of stress and a yield stress, in Pa.
STRESS = """
[[limits]]
name = "stress at probes"
of = "stress"
most = {most:.6g}e6    # Pa, the least yield stress where probes are
factor = 1.5    # bending of walls under pads comes on top of stresses of beams: limits of pads keep it small
"""
#: Limit of a chart on the forces of the pads of a joint, for a section by name, with a force in N.
WALLS = """
[[limits]]
name = "walls at pads of {name}"
of = "pad"
which = ["{name} *"]
most = {force:.1f}    # N of a pad alone, at which the walls of {section} begin to yield at its edge
factor = 1.5    # bending of the whole section comes on top
"""
LIMITS = """
# Further limits that the load must keep, each with your own safety factor.
# [[limits]]
# name = "pads"
# of = "pad"                   # or stress, luffing, cylinder, support, deflection, buckling, frequency, overturning
# most = 50e3                  # N, what a pad and the walls under it bear
# factor = 1.5
#
# [[cases]]
# name = "in service"
# weight = 1.1
# load = 1.3
# loads = { gust = 400.0 }     # loads of the scene by name
"""


def chart(
    scene: SceneFile,
    up_to: Annotated[float, typer.Option("--up-to", metavar="KG", help="Largest load that is looked for.")],
    out_dir: Folder = None,
    jobs: Jobs = None,
) -> None:
    """Compute what a boom carries at every extension and angle.

    Writes chart.toml into DIR, a study over the extensions and luffing angles of the scene, and computes it as
    `pmr study` does. Add limits and factors to this file: a chart.toml that exists is used as it is.

    Example:

        pmr chart crane --up-to 20000
    """
    from pmr.scene import load_any

    file = scene_file(scene)
    folder = out_dir or Path("reports", f"chart_{scene.resolve().name if scene.is_dir() else file.stem}")
    prepare_folder(folder, (STUDY, "tasks/*.npz"))
    written = folder / STUDY
    if not written.exists():
        written.write_text(_chart_study_text(file, load_any(file), up_to), encoding="utf-8")
        print_text(out, f"study  {written}  the study of this chart: add limits to it, and call again")
    study(written, out_dir=folder, jobs=jobs)


def _slewing_angles(frame: Frame, end: float) -> list[float]:
    """Return slewing angles in the frame's unit, at most an eighth of a turn apart, over the range up to `end` in s.

    Of a whole turn each angle is there once.
    """
    if frame.slewing is None:
        return [0.0]
    turn = 360.0 if frame.unit == "degrees" else 2.0 * math.pi
    low, high = frame.slewing.bounds(0.0, end)
    width = min(high - low, turn)
    count = max(math.ceil(SLEWING_STEPS * width / turn - 1e-9), 1 if width > 0.0 else 0)
    return [low + width * k / max(count, 1) for k in range(count + (width < turn))]


def _wall_limits(scene: Scene) -> Iterator[str]:
    """Yield a limit of a chart for each joint of beams whose walls' stress at pads can be computed."""
    from pmr.results.quantities import stress_remark
    from pmr.studies.shared import pad_yield_forces

    if not stress_remark(scene):  # shells have a limit of their own, on the stress field
        return
    try:
        forces = pad_yield_forces(scene)
    except InputError as error:
        print_text(err, f"walls at pads are not limited: {error.allowed}")
        return
    for name, at_yield in forces.items():
        yield WALLS.format(name=name, force=at_yield.force, section=at_yield.section)


def _chart_study_text(file: Path, scene: Scene, up_to: float) -> str:
    """Return the text of a study file for a load chart, over the ranges of the scene's extensions and luffing angle.

    Limits are tipping, the stress at probes and that of walls at pads, as far as the scene has what they need; pads are
    pressed on shells of the sections for it.  `up_to` is the largest load in kg.  Raises InputError if the scene has no
    luffing angle.
    """
    if scene.frame is None or scene.frame.luffing is None or scene.frame.luffing == "free":
        allowed = "a scene whose [frame] has a luffing angle over time is allowed"
        raise InputError("command line", "SCENE", str(file), allowed)
    if not up_to > 0.0:
        raise InputError("command line", "--up-to", up_to, "a load above 0 kg is allowed")
    end, names = scene.time.end, scene.names[1:]
    bounds = [scene.extension(number).bounds(0.0, end) for number in range(1, len(scene.sections))]
    rows = []
    for k in range(EXTENSIONS if names else 0):
        share = k / (EXTENSIONS - 1)
        at = (f"{name} = {low + share * (high - low):.6g}" for name, (low, high) in zip(names, bounds, strict=True))
        rows.append(f"  {{ {', '.join(at)} }},\n")
    least, most = scene.frame.luffing.bounds(0.0, end)
    slewing = _slewing_angles(scene.frame, end)
    probed = [part for part in scene.bodies.values() if any("stress" in probe.measures for probe in part.probes)]
    regions = [region for part in probed for region in part.body.regions.values() if region.material is not None]
    materials = [*(part.body.material for part in probed), *(region.material for region in regions)]
    yields = [material.yield_stress for material in materials if material is not None]
    return "".join(
        [
            'kind = "chart"\n',
            f"title = {json.dumps(f'Load chart: {scene.title}')}\n",
            f"scene = {json.dumps(str(file.resolve()))}\n",
            f"up_to = {float(up_to)!r}  # kg\n",
            f"extensions = [\n{''.join(rows)}]\n" if rows else "",
            f"luffing = {{ least = {least:.6g}, most = {most:.6g}, count = {ANGLES if most > least else 1} }}\n",
            f"slewing = [{', '.join(f'{angle:.6g}' for angle in slewing)}]  # the least load of all counts\n",
            TIPPING if scene.frame.ground is not None else "",
            STRESS.format(most=1e-6 * min(filter(None, yields))) if yields and all(yields) else "",
            *_wall_limits(scene),
            LIMITS,
        ]
    )
