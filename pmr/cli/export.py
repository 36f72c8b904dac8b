"""Commands on saved models and on models of other programs: ``export``, ``flexible``, ``matrices``, ``simulate``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from rich.table import Table
from rich.text import Text
from typer import Argument, Option

from pmr.cli import console
from pmr.cli.console import Folder, Model, MotionScene, Overrides, SceneFile, err, out
from pmr.errors import InputError, TooManyModesError, escape_controls
from pmr.errors.environment import stage_words
from pmr.export.formats import BODY_FORMATS, FORMATS, ONE_BODY, Options, write
from pmr.files.whole import finish_swap, replacement_folder

if TYPE_CHECKING:
    from pmr.export.fmi import UnitObserver

_SAYS = "; ".join(f"{name}: {target_format.description}" for name, target_format in FORMATS.items())


def export(
    model: Model,
    to: Annotated[str, Option(metavar="FORMAT", help=f"{_SAYS}.")] = "exudyn",
    out_file: Annotated[
        Path | None, Option("--out", metavar="FILE", help="[default: a name of the format beside the model]")
    ] = None,
    fmi: Annotated[str | None, Option(metavar="2|3", help="Version of the interface, for fmu.  [default: 3]")] = None,
    platforms: Annotated[
        str | None,
        Option(
            metavar="host|all",
            help="Systems that an fmu has binaries for: this machine's, or Linux, Windows and macOS.  [default: host]",
        ),
    ] = None,
    sources: Annotated[
        bool, Option("--sources", help="Whether an fmu has the C of its binaries, for importers that compile it.")
    ] = False,
    observer: Annotated[
        Path | None, Option(metavar="FILE", help="Sensors and unknowns as TOML, of which an fmu has estimates.")
    ] = None,
    at: Annotated[
        str | None, Option(metavar="S,...", help="Places of the sliders in m, for state spaces.  [default: a grid]")
    ] = None,
    section: Annotated[
        str | None,
        Option(metavar="NAME", help="Write a section of a boom alone, without its joints, for state spaces."),
    ] = None,
) -> None:
    """Write a reduced model for other programs, which do not need pmr.

    For example:

        pmr export reports/paper_simple/reduced.npz --to exudyn

        pmr export reports/boom_shell/reduced.npz --to fmu --fmi 2 --platforms all

        pmr export reports/boom_shell/reduced.npz --to matlab --at 1.5,2.5,4

        pmr export reports/boom_three/system.npz --to fmu --observer sensors.toml
    """
    console.check_output_file(out_file, model) if out_file else console.prepare_folder(model.parent, key="FILE")
    finish_swap(model.parent)
    with err.status(Text(f"writing {escape_controls(to)}")):  # shown on a terminal only
        estimator = None if observer is None else read_unit_observer(observer, model)
        written = write(to, model, out_file, Options(fmi, at, section, platforms, sources or None, estimator))
    if section is not None:
        out.text(f"section {section} alone, without its joints")
    out.text(str(written))


def read_unit_observer(file: Path, model: Path) -> UnitObserver:
    """Return the observer for an FMU that a `file` describes, of the saved system `model` with its stored scene.

    The errors of the model are those in ``summary.json`` in the folder of the model, if it is there.  Raises InputError
    for a model without its scene, and for all that `ObserverFile.observer` refuses.
    """
    import numpy as np

    from pmr.export.fmi import UnitObserver
    from pmr.observe.linear import gravity_of, select_outputs
    from pmr.observe.measured import ObserverFile
    from pmr.scene.files import stored_scene
    from pmr.scene.keys import RECORDED
    from pmr.system.system import System

    description, system = ObserverFile.read(file), System.load(model)
    if "scene" not in system.provenance:
        raise InputError(model.name, "provenance.scene", None, "a file that contains its scene is allowed")
    scene = stored_scene(system.provenance["scene"], "provenance.scene", RECORDED)
    if scene.frame is not None or system.hoist:
        allowed = "a system without a moving frame and without a hoist is allowed"
        raise InputError("command line", "--observer", None, allowed)
    observer = description.observer(scene, system, console.summary_beside(model))
    chosen = select_outputs(scene, system, observer.model.outputs)
    return UnitObserver(
        data=observer.filter_data(),
        step=observer.model.step,
        outputs=chosen.names,
        columns=np.array(chosen.columns, np.int32),
        orders=np.array(chosen.orders, np.int32),
        felt=gravity_of(scene, chosen),
        inputs=observer.model.inputs,
        sensors=tuple(sensor.output for sensor in observer.sensors),
        units=observer.units,
    )


def flexible(
    scene: SceneFile,
    at: Annotated[float, Option(metavar="S", help="Place of the sliders in m.")],
    to: Annotated[
        str, Option(metavar="FORMAT", help=f"{'; '.join(f'{k}: {v.description}' for k, v in BODY_FORMATS.items())}.")
    ] = "sid",
    modes: Annotated[int, Option(metavar="N", help="Number of modes.")] = 8,
    out_file: Annotated[
        Path | None, Option("--out", metavar="FILE", help="[default: a name of the format in this folder]")
    ] = None,
    overrides: Overrides = None,
) -> None:
    """Write a scene's body as a flexible body for other programs.

    Its sliders are at one place, S.  Formats of flexible bodies do not allow sliding: modes and springs are those with
    the sliders there, and the reference frame is that of the ground.  An FMU includes the sliding (`pmr export --to
    fmu`).

    Example:

        pmr flexible boom_solid --at 2.5 --to sid --set masses=[]
    """
    from pmr import scene as scenes
    from pmr.pipeline import framed_body, held_body

    if to not in BODY_FORMATS:
        raise InputError("command line", "--to", to, f"{', '.join(BODY_FORMATS)} is allowed")
    if modes < 1:
        raise InputError("command line", "--modes", modes, "1 or more is allowed")
    chosen = BODY_FORMATS[to]
    target = out_file or Path(chosen.file_name)
    file = console.scene_file(scene)
    loaded = scenes.load_any(file, overrides or ())
    if len(loaded.sections) > 1:
        raise InputError(str(file), "sections", list(loaded.names), ONE_BODY)
    console.check_output_file(target, file, *filter(None, (loaded.mesh.file,)))
    try:
        body = (framed_body if chosen.by == "frame" else held_body)(loaded, at, modes)
    except InputError as error:
        raise error.with_source(str(file)) from None
    except TooManyModesError as error:
        allowed = f"at most {error.most} are allowed, as many as there are free coordinates"
        raise InputError("command line", "--modes", modes, allowed) from None
    chosen.write(body, target)
    for k, (name, point) in enumerate(zip(body.frames.names, body.frames.points, strict=True), start=1):
        out.text(f"{chosen.by} {k}: {name}, at {', '.join(f'{round(x, 9) + 0.0:.4g}' for x in point)} m")
    out.text(f"{len(body.omega)} modes, {', '.join(f'{w / math.tau:.4g}' for w in body.omega)} Hz")
    out.text(str(target))


def matrices(
    stiffness: Annotated[
        Path, Argument(metavar="STIFFNESS", help=".sti of CalculiX, .mtx (Abaqus), .bdf or .op4 (Nastran), .npz, .hb.")
    ],
    mass: Annotated[Path | None, Option(metavar="FILE", help="[default: .mas beside it; of .bdf itself]")] = None,
    dofs: Annotated[
        Path | None,
        Option(metavar="FILE", help="Node and direction of each row.  [default: .dof beside it; of .bdf, .mtx itself]"),
    ] = None,
    nodes: Annotated[
        Path | None,
        Option(metavar="FILE", help="Nodes and groups: .inp, .bdf, .csv.  [default: .inp beside it; of .bdf itself]"),
    ] = None,
    stiffness_name: Annotated[str, Option(metavar="NAME", help="Stiffness in a file of several matrices.")] = "",
    mass_name: Annotated[str, Option(metavar="NAME", help="Mass in a file of several matrices.")] = "",
    damping: Annotated[Path | None, Option(metavar="FILE", help="Viscous damping.  [default: none]")] = None,
    damping_name: Annotated[str, Option(metavar="NAME", help="Name of the damping.  [of STIFFNESS itself]")] = "",
    out_file: Annotated[Path | None, Option("--out", metavar="FILE", help="[default: STIFFNESS-matrices.npz]")] = None,
) -> None:
    """Read matrices that another program assembled, and check them.

    FEniCSx is not needed.  A scene names the file: model = "matrices" in [body], and file in [mesh].

    Example:

        pmr matrices boom.sti
    """
    from pmr.files.fit import UNCHECKED
    from pmr.files.foreign import MatrixNames, foreign_files, read_foreign

    if not stiffness.name:
        raise InputError("command line", "STIFFNESS", str(stiffness), "the name of a file is allowed")
    target = out_file or stiffness.with_name(f"{stiffness.stem}-matrices.npz")
    if target.suffix != ".npz":
        raise InputError("command line", "--out", str(target), "the name of an .npz file is allowed")
    files = foreign_files(stiffness, mass, dofs, nodes, damping, MatrixNames(stiffness_name, mass_name, damping_name))
    console.check_output_file(target, *(file for file in vars(files).values() if isinstance(file, Path)))
    body = read_foreign(files)
    amplitudes = f", {body.modal.sum()} of them modal amplitudes" if body.modal.any() else ""
    coordinates = f"{body.size} coordinates of {len(body.points)} nodes{amplitudes}"
    out.text(f"{coordinates}; groups: {', '.join(body.groups) or 'none'}")
    x, y, z = (round(float(c), 9) + 0.0 for c in body.centre)
    free = " of what supports inside the matrices leave free" if body.lacks else ""
    centre = f"centre of mass at ({x:.4g}, {y:.4g}, {z:.4g}) m"
    out.text(f"{body.mass:.4g} kg{free}, {centre}; {_held_motions_text(len(body.held))}")
    if body.D is not None:
        damped = (body.D.getnnz(axis=1) > 0).sum()
        out.text(f"viscous damping on {damped} coordinates; the damping of a scene is added to it")
    if body.unchecked:
        err.text(f"warning: {UNCHECKED}")
    out.text(str(body.save(target)))


def _held_motions_text(count: int) -> str:
    """Return a clause that tells how many rigid motions, `count` of six, a stiffness matrix resists.

    Supports and springs whose stiffness the matrix contains hold these motions.
    """
    if not count:
        return "free to move as a rigid body"
    return f"supports and springs in its stiffness hold {count} of 6 rigid motions"


def simulate(model: Model, scene: MotionScene, out_dir: Folder = None, overrides: Overrides = None) -> None:
    """Simulate a saved body or boom; FEniCSx is not needed.

    The scene may differ from that of the file in paths, signals of loads (with the same names), time and simulators.
    Other bodies or joints are refused.  DIR then has summary.json, scene.json, trajectories.npz and tables/*.csv, as
    after `pmr run`.  DIR must not be the folder of the model.

    For example:

        pmr simulate reports/paper_simple/reduced.npz --scene paper_evolved --set time.end=5

        pmr simulate reports/boom_three/system.npz --scene boom_three --set "sections.fly.loads.tip force.signal=0.0"
    """
    from pmr import scene as scenes
    from pmr.compare.summary import simulate_saved
    from pmr.report import trust
    from pmr.report.numbers import format_length, format_quantity
    from pmr.results import RESULT_FILES
    from pmr.results.quantities import QUANTITIES
    from pmr.results.tables import reaction_table, write_tables
    from pmr.scene.tomlfiles import result_name
    from pmr.system.system import System

    finish_swap(model.parent)
    system, file = System.load(model), console.scene_file(scene)
    loaded, folder = scenes.load_any(file, overrides or ()), out_dir or Path("reports", result_name(scene))
    if folder.resolve() == model.parent.resolve():
        raise InputError("command line", "--out", str(folder), "a folder other than the model's is allowed")
    console.prepare_folder(folder, RESULT_FILES)
    try:
        result: Any = simulate_saved(system, loaded)
    except InputError as error:
        raise error.with_source(str(file)) from None
    with replacement_folder(folder, RESULT_FILES) as new:
        result.save(new)
        write_tables(result, new)
    response, summary = result.responses["reduced"], result.summary
    table = Table(title=escape_controls(loaded.title), title_justify="left", title_style="bold", show_header=False)
    table.add_row(QUANTITIES["largest"].reported, format_length(summary["max_displacement"], 4))

    def add_range(name: str, least: float, most: float, unit: str) -> None:
        """Add a row with the range of the force or moment called `name`, from `least` to `most` in the unit `unit`."""
        table.add_row(escape_controls(name), " to ".join(format_quantity(end, unit, 4) for end in (least, most)))

    for name, force in zip(response.force_names, response.slider_force.T, strict=False):
        add_range(name, float(force.min()), float(force.max()), "N")
    for _, support, unit, least, _, _, most, *_ in reaction_table(result).rows:
        add_range(f"reaction of {support}", float(least), float(most), str(unit))
    for name, seconds in summary["seconds"]["simulate"].items():
        table.add_row(stage_words(name), f"{seconds:.3g} s")
    out.print(table)
    hidden = ("model", "mesh")  # they are those of the run that wrote the model
    out.rows(row for row in trust.trust_table(result).rows if row[0] not in hidden)
    for warning in summary["warnings"]:
        out.sentences(f"warning: {warning}")
    out.text(str(folder / "trajectories.npz"))
