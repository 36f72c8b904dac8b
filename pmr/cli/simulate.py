"""``pmr simulate``: a saved body or boom under other paths and other loads."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from pmr.cli.console import Folder, Model, Overrides, ensure_writable, out, say, scene_file, tell
from pmr.errors import InputError
from pmr.errors.text import visible
from pmr.files.swap import finish_swap, fresh


def simulate(
    model: Model,
    scene: Annotated[Path, typer.Option("--scene", metavar="SCENE", help="Scene with the path, loads and time steps.")],
    out_dir: Folder = None,
    overrides: Overrides = None,
) -> None:
    """Simulate a saved body or boom; FEniCSx is not needed.

    The scene may differ from that of the file in paths, signals of loads (with the same names), time and simulators.
    Other bodies or joints are refused.  DIR then has summary.json, scene.json and trajectories.npz, as after `pmr run`.

    Examples
    --------
        pmr simulate reports/paper_simple/reduced.npz --scene paper_evolved --set time.end=5

        pmr simulate reports/boom_three/system.npz --scene boom_three --set "sections.fly.loads.tip force.signal=0.0"
    """
    from pmr import scene as scenes
    from pmr.compare.saved_model import simulate_saved
    from pmr.report import sentences
    from pmr.results import RESULT_FILES
    from pmr.results.tables import reactions
    from pmr.results.tables import write as write_tables
    from pmr.system.system import System

    finish_swap(model.parent)
    system, file = System.load(model), scene_file(scene)
    loaded, folder = scenes.load_any(file, overrides or ()), out_dir or Path("reports", scene.stem)
    if folder.resolve() == model.parent.resolve():
        raise InputError("command line", "--out", str(folder), "a folder other than the model's is allowed")
    ensure_writable(folder, RESULT_FILES)
    try:
        result: Any = simulate_saved(system, loaded)
    except InputError as error:
        raise error.found_in(str(file)) from None
    with fresh(folder, RESULT_FILES) as new:
        result.save(new)
        write_tables(result, new)
    response, summary = result.responses["reduced"], result.summary
    table = Table(title=visible(loaded.title), title_justify="left", title_style="bold", show_header=False)
    table.add_row("largest displacement", f"{1e3 * summary['max_displacement']:.4g} mm")
    for name, force in zip(response.force_names, response.slider_force.T, strict=False):
        table.add_row(visible(name), f"{force.min():.4g} to {force.max():.4g} N")
    for _, support, unit, least, _, _, most, *_ in reactions(result).rows:
        table.add_row(visible(f"reaction of {support}"), f"{least:.4g} to {most:.4g} {unit}")
    table.add_row("simulated in", ", ".join(f"{name} {s:.3g} s" for name, s in summary["seconds"]["simulate"].items()))
    out.print(table)
    for sentence in filter(None, (sentences.estimate(result), sentences.step(result))):
        tell(out, sentence)
    for warning in summary["warnings"]:
        tell(out, f"warning: {warning}")
    say(out, str(folder / "trajectories.npz"))
