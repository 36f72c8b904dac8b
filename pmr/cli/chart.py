"""The command ``pmr chart``: a study of the load chart of a scene, written and computed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pmr.cli.console import MOST_JOBS, Folder, ensure_writable, out, say, scene_file
from pmr.cli.study import study
from pmr.errors import InputError

if TYPE_CHECKING:
    from pmr.scene import Scene

STUDY = "chart.toml"
#: Extensions and angles of a study that is written.
EXTENSIONS, ANGLES = 12, 10
LIMITS = """
# What may not be passed, each with a factor of yours; without one the chart shows what buckles the boom.
# [[limits]]
# name = "stress"
# of = "stress"                # or pad, cylinder, support, deflection, buckling, frequency, overturning
# most = 355e6                 # Pa, von Mises at the probes of the scene
# factor = 1.5
#
# [[cases]]
# name = "in service"
# weight = 1.1
# load = 1.3
# loads = { gust = 400.0 }     # loads of the scene by name
"""


def chart(
    scene: Annotated[
        Path, typer.Argument(metavar="SCENE", help="Scene file, or the name of a scene that comes with pmr.")
    ],
    up_to: Annotated[float, typer.Option("--up-to", metavar="KG", help="Largest load that is looked for.")],
    out_dir: Folder = None,
    jobs: Annotated[
        int | None,
        typer.Option("--jobs", metavar="N", min=1, max=MOST_JOBS, help="Worker processes.  [default: one a core]"),
    ] = None,
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
    ensure_writable(folder)
    written = folder / STUDY
    if not written.exists():
        written.write_text(_study(file, load_any(file), up_to), encoding="utf-8")
        say(out, f"study  {written}  what is asked: add limits to it, and call again")
    study(written, out_dir=folder, jobs=jobs)


def _study(file: Path, scene: Scene, up_to: float) -> str:
    """A study over what joints and the luffing angle of a scene go through."""
    if scene.frame is None or scene.frame.luffing is None:
        raise InputError("command line", "SCENE", str(file), "a scene whose [frame] has a luffing angle is allowed")
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
    return "".join(
        [
            'kind = "chart"\n',
            f"title = {json.dumps(f'Load chart: {scene.title}')}\n",
            f"scene = {json.dumps(str(file.resolve()))}\n",
            "# change.sections.fly.masses = []   # a payload of the scene counts as weight until it goes\n",
            f"up_to = {float(up_to)!r}  # kg\n",
            f"extensions = [\n{''.join(rows)}]\n" if rows else "",
            f"luffing = {{ least = {least:.6g}, most = {most:.6g}, count = {ANGLES if most > least else 1} }}\n",
            LIMITS,
        ]
    )
