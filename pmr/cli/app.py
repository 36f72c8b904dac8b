"""The command line: reads arguments, calls the rooms, prints tables."""

from __future__ import annotations

import json
import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import numpy as np
import typer
from rich.logging import RichHandler
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table

from pmr import environment
from pmr import scene as scenes
from pmr.cli.console import VisibleText, ensure_writable, err, no_report, out, say
from pmr.cli.study import study
from pmr.errors import ConvergenceError, InputError, SimulationError
from pmr.files.swap import finished, fresh, removed
from pmr.files.whole import FULL, NotWrittenError
from pmr.reduced.model import ReducedModel
from pmr.scene.choice import choose
from pmr.system.body import force_outputs
from pmr.text import visible

if TYPE_CHECKING:
    from pmr.clock import Progress as Report
    from pmr.report.marks import Row
    from pmr.run import Outcome

app = typer.Typer(
    help="Reduce beams that slide: from a scene file to a reduced model, checked against full references, in a report.",
    epilog="Start with: pmr run workflows/paper_simple.toml",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)
app.command()(study)


@app.command()
def run(
    scene_files: Annotated[list[Path], typer.Argument(metavar="SCENE.toml", help="One scene file or several.")],
    out_dir: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Where results go.  [default: reports/SCENE]")
    ] = None,
    overrides: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Override a key of the scene; repeatable.")
    ] = None,
    simulators: Annotated[
        str | None,
        typer.Option(
            metavar="NAME,...",
            help="Simulate the reduced model by each: march, exudyn, exudyn-multiplier, exudyn-callback.",
        ),
    ] = None,
) -> None:
    """Run scenes the whole way: operators, snapshots, basis, reduced model, simulations, comparison, report.

    DIR then holds report.html, report.pdf, summary.json, reduced.npz and trajectories.npz, for structures in space
    fields.npz and fields.pvd, which ParaView opens; with several scenes the report is one and the rest stands in a
    folder for each.  They take the place of old ones together: a run that is killed leaves those or its own.  A
    full-order simulation that was cut off goes on where it was.

    Examples
    --------
        pmr run workflows/paper_evolved.toml

        pmr run workflows/paper_evolved.toml --set reduction.coordinates=10

        pmr run workflows/paper_evolved.toml --simulators march,exudyn,exudyn-callback

        mpirun -n 2 pmr run SCENE.toml --set reduction.solver=slepc
    """
    asked = [*(overrides or ()), *([_simulators(simulators)] if simulators is not None else ())]
    loaded = [(file, scenes.load(file, asked)) for file in scene_files]
    if len({file.stem for file in scene_files}) != len(scene_files):
        raise InputError("command line", "SCENE", [file.stem for file in scene_files], "names must differ")
    environment.check_installed("weasyprint")  # before the work, not after it
    folder = out_dir or Path("reports", scene_files[0].stem)
    ensure_writable(folder)
    try:
        from pmr.fem.compat import MPI
    except ImportError as error:
        _leave(f"FEniCSx is not installed ({error}); reduced models simulate without it, new ones need it", 1)
    from pmr.clock import Clock
    from pmr.report.document import REPORT_FILES, write_report
    from pmr.run import run as run_scene
    from pmr.simulate.petsc import Checkpoint

    first = MPI.COMM_WORLD.rank == 0
    outcomes = []
    for file, scene in loaded:
        where = folder if len(loaded) == 1 else folder / file.stem
        kept = Checkpoint(where / f"full-{scene.hash}.checkpoint")
        with _progress(file.stem, shown=first) as progress:
            try:
                outcome = run_scene(scene, MPI.COMM_WORLD, Clock(progress), kept)
            except InputError as error:
                raise error.found_in(str(file)) from None
            except (np.linalg.LinAlgError, ArithmeticError) as error:
                allowed = f"sizes, stiffnesses and masses that double precision can carry are allowed ({error})"
                raise InputError(str(file), "", None, allowed) from None
        if outcome is not None:
            if where != folder:
                removed(folder, REPORT_FILES)  # the one of all scenes, which no longer belongs to what is there
            _save(outcome, where)
            kept.file.unlink(missing_ok=True)
            outcomes.append(outcome)
    if outcomes:
        for outcome in outcomes:
            _print_table(outcome)
        with _progress("report", shown=first) as progress:
            progress("write", 0.0)
            try:
                files = write_report([outcome.result for outcome in outcomes], folder)
            except Exception as error:  # whatever it is: what was computed is there, and worth more
                _leave(no_report(error, folder), 1)
        say(out, f"report  {files.html}")
        say(out, f"        {files.pdf}")


def _save(outcome: Outcome, folder: Path) -> None:
    """Everything but the report, which comes later: the one that is there belongs to the old results and goes."""
    from pmr.export.paraview import write_series
    from pmr.report.document import REPORT_FILES
    from pmr.results import RESULT_FILES

    result = outcome.result
    recovery = result.scene.recovery if isinstance(result.scene, scenes.StructureScene) else None
    with fresh(folder, (*RESULT_FILES, *REPORT_FILES)) as new:
        result.save(new)
        outcome.reduced.save(new / "reduced.npz")
        if recovery is not None and recovery.series and result.fields is not None:
            write_series(new, "fields", result.fields)


@app.command()
def export(
    model: Annotated[Path, typer.Argument(metavar="reduced.npz", help="A reduced model that `pmr run` wrote.")],
    to: Annotated[str, typer.Option("--to", metavar="FORMAT", help="exudyn: a standalone Python script.")] = "exudyn",
    out_file: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="[default: sliding_body.py beside the model]")
    ] = None,
) -> None:
    """Write a reduced model as something a user can build on, without pmr.

    Example:

        pmr export reports/paper_simple/reduced.npz --to exudyn
    """
    if to != "exudyn":
        raise InputError("command line", "--to", to, "exudyn is allowed")
    from pmr.export.exudyn.script import write_exudyn_script

    target = out_file or model.with_name("sliding_body.py")
    if target.is_dir():
        raise InputError("command line", "--out", str(target), "the name of a file is allowed")
    ensure_writable(target.parent)
    finished(model.parent)
    written = write_exudyn_script(model, target)
    say(out, str(written))


@app.command()
def info(
    file: Annotated[
        Path | None, typer.Argument(metavar="[FILE]", help="reduced.npz or a scene; without it, the stack found.")
    ] = None,
) -> None:
    """Say which stack is in use (versions, MPI, scalar type), or what a file holds.

    Examples
    --------
        pmr info

        pmr info reports/paper_simple/reduced.npz
    """
    if file is None:
        rows = environment.versions()
        try:
            from pmr.fem.compat import versions
        except ImportError as error:
            rows["FEniCSx"] = f"not found ({error}); reduced models simulate without it"
        else:
            rows |= versions()
        rows |= environment.machine()
    elif file.suffix == ".toml":
        rows = _describe_scene(scenes.load(file))
    else:
        finished(file.parent)
        rows = _describe_model(ReducedModel.load(file))
    table = Table(show_header=False, box=None, pad_edge=False)
    for key, value in rows.items():
        table.add_row(key, visible(value))
    out.print(table)


def _simulators(names: str) -> str:
    """The override that ``--simulators a,b`` stands for."""
    return f"simulation.simulators={json.dumps([name.strip() for name in names.split(',')])}"


def _describe_scene(scene: scenes.SceneBase) -> dict[str, str]:
    described = _describe_structure if isinstance(scene, scenes.StructureScene) else _describe_beam
    return {
        "title": scene.title,
        "hash": scene.hash,
        **described(scene),
        "time": f"{scene.time.end:g} s in {scene.time.steps} steps, rho_inf = {scene.time.rho_inf:g}",
        "reduction": f"{scene.reduction.coordinates} coordinates: {_describe_reduction(scene.reduction)}",
        "compared with": ", ".join(scene.compare.against) or "nothing",
    }


def _describe_beam(scene: scenes.SceneBase) -> dict[str, str]:
    assert isinstance(scene, scenes.Scene)
    low, high = scene.path_bounds
    return {
        "body": f"{scene.body.model}, {scene.body.length:g} m, coordinates {', '.join(scene.body.directions)}",
        "slider": f"{len(scene.slider.offsets)} row(s), s from {low:g} to {high:g} m",
        "loads": ", ".join(f"{load.name} at {load.at:g} m along {load.direction}" for load in scene.loads),
    }


def _describe_structure(scene: scenes.SceneBase) -> dict[str, str]:
    assert isinstance(scene, scenes.StructureScene)
    chosen, box, (low, high) = choose(scene), scene.body.box, scene.path_bounds
    size = f"box of {box.length:g} x {box.width:g} x {box.height:g} m, wall {box.wall:g} m" if box else "from a file"
    pads = [f"{len(ring.places)} at the {ring.name}{' (moving)' * ring.moving}" for ring in scene.pads]
    loads = [f"{load.name} on {load.on} along {load.direction}" for load in scene.loads]
    return {
        "body": f"{chosen.model}, {size}",
        "model": f"{scene.body.model}: {'; '.join(chosen.reasons)}",
        "pads": f"{', '.join(pads)}; s from {low:g} to {high:g} m",
        "loads": ", ".join([*loads, *(["gravity"] if scene.gravity else [])]),
    }


def _describe_reduction(reduction: scenes.Reduction) -> str:
    pool = f"POD of {reduction.snapshots} x {reduction.modes} eigenmodes"
    basis = "free modes" if reduction.basis == "free_modes" else pool
    return f"{basis} and residual flexibility" if reduction.flexibility else basis


def _describe_model(model: ReducedModel) -> dict[str, str]:
    low, high = model.domain
    made_with = model.provenance.get("versions", {})
    scene = model.provenance.get("scene", {})
    return {
        "reduced model": f"{model.size} coordinates",
        "scene": f"{scene.get('title', 'unknown') if isinstance(scene, dict) else 'unknown'} "
        f"({model.provenance.get('scene_hash', 'no hash')})",
        "basis": str(model.provenance.get("basis", "unknown")),
        "inputs": ", ".join(model.input_names),
        "outputs": _describe_outputs(model),
        "rows": f"{', '.join(model.row_names)}; s from {low:g} to {high:g} m",
        "rows left out": ", ".join(model.left_out) or "none",
        "made with": ", ".join(
            f"{name} {made_with[name]}" for name in ("pmr", "dolfinx", "PETSc", "SLEPc") if name in made_with
        ),
    }


def _describe_outputs(model: ReducedModel) -> str:
    forces = int(force_outputs(model).sum())
    moved = f"{len(model.outputs) - forces} transverse displacements in m"
    return f"{moved}, {forces} forces of pads in N" if forces else moved


def _print_table(outcome: Outcome) -> None:
    """Errors, beside published ones where there are any, and solver seconds."""
    from pmr.report import marks, sentences

    summary, found = outcome.result.summary, marks.rows(outcome.result)
    table = Table(title=visible(outcome.result.scene.title), title_justify="left", title_style="bold")
    table.add_column("e_NRMS, or largest value")
    table.add_column("")
    table.add_column("here", justify="right")
    if any(row.published for row in found):
        table.add_column("published", justify="right")
        table.add_column("")
    for row in found:
        verdict = [row.published or "", _verdict(row)] if len(table.columns) > 3 else []
        table.add_row(*map(visible, (row.comparison, row.place, row.here, *verdict)))
    out.print(table)
    seconds = ", ".join(f"{name} {value:.3g} s" for name, value in summary["seconds"]["simulate"].items())
    coordinates = summary["coordinates"]
    say(out, f"{coordinates['full']} -> {coordinates['reduced']} coordinates; simulated in: {seconds}")
    for said in filter(None, (sentences.estimate(outcome.result), sentences.step(outcome.result))):
        say(out, said)
    for warning in summary["warnings"]:
        say(out, f"warning: {warning}")
    for pair, length in summary["agreement"].items():
        say(out, f"{pair.replace('_vs_', ' and ')} agree to {length:.1e} m")
    out.print()


def _verdict(row: Row) -> str:
    return f"{row.mark.symbol} {row.mark.text}" if row.mark else ""


@contextmanager
def _progress(title: str, shown: bool) -> Iterator[Report]:
    """A bar a stage on the terminal; nothing on other ranks or where the output is no terminal."""
    columns = (TextColumn("{task.description:32}", markup=False), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=err, transient=True, disable=not (shown and err.is_terminal)) as bars:
        tasks: dict[str, TaskID] = {}

        def report(stage: str, share: float) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(f"{title}: {stage}", total=1.0)
            bars.update(tasks[stage], completed=share)

        yield report


def main() -> None:
    """Entry point: a line and exit code 2 for bad input, 1 for a solver that failed."""
    handler = RichHandler(console=err, show_path=False)
    handler.setFormatter(VisibleText("%(message)s"))
    logging.basicConfig(level=logging.WARNING, handlers=[handler])
    try:
        app()
    except InputError as error:
        _leave(str(error), 2)
    except (ConvergenceError, SimulationError, NotWrittenError) as error:
        _leave(str(error), 1)
    except Exception as error:
        if isinstance(error, OSError) and error.errno in FULL:
            _leave(f"no room for compiled code (XDG_CACHE_HOME) or temporary files (TMPDIR): {error.strerror}", 1)
        if any(kind.__name__ == "VerificationError" for kind in type(error).__mro__):  # CFFI's
            _leave("a form was not compiled: a C compiler and room for what it writes (XDG_CACHE_HOME) are needed", 1)
        if _ranks() > 1:  # the others would wait for this rank for ever
            err.print_exception()
            _leave("a rank failed", 1)
        raise


def _leave(message: str, code: int) -> NoReturn:
    say(err, f"pmr: {message}")
    err.file.flush()
    if _ranks() > 1:
        sys.modules["mpi4py.MPI"].COMM_WORLD.Abort(code)
    sys.exit(code)


def _ranks() -> int:
    """Ranks of this run, without starting MPI for commands that do without it."""
    mpi = sys.modules.get("mpi4py.MPI")
    return mpi.COMM_WORLD.size if mpi else 1
