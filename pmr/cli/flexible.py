"""``pmr flexible``: a scene's body, held at a place of its sliders, as a flexible-body file of another program."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pmr.cli.console import Overrides, ensure_file, out, say, scene_file
from pmr.errors import InputError, TooManyModesError
from pmr.export.formats import BODY_FORMATS, ONE_BODY


def flexible(
    scene: Annotated[
        Path, typer.Argument(metavar="SCENE", help="Scene file, or the name of a scene that comes with pmr.")
    ],
    at: Annotated[float, typer.Option("--at", metavar="S", help="Place of the sliders in m.")],
    to: Annotated[
        str,
        typer.Option("--to", metavar="FORMAT", help=f"{'; '.join(f'{k}: {v.says}' for k, v in BODY_FORMATS.items())}."),
    ] = "sid",
    modes: Annotated[int, typer.Option("--modes", metavar="N", help="Number of modes.")] = 8,
    out_file: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="[default: a name of the format in this folder]")
    ] = None,
    overrides: Overrides = None,
) -> None:
    """Write the body of a scene as a flexible body of another multibody program, with its sliders at one place.

    Formats of flexible bodies do not allow sliding: modes and springs are those with the sliders at S, and the
    reference frame is that of the ground.  An FMU includes the sliding (`pmr export --to fmu`).

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
    file = scene_file(scene)
    loaded = scenes.load_any(file, overrides or ())
    if len(loaded.sections) > 1:
        raise InputError(str(file), "sections", list(loaded.names), ONE_BODY)
    ensure_file(target, file, *filter(None, (loaded.mesh.file,)))
    try:
        body = (framed_body if chosen.by == "frame" else held_body)(loaded, at, modes)
    except InputError as error:
        raise error.found_in(str(file)) from None
    except TooManyModesError as error:
        raise InputError(
            "command line", "--modes", modes, f"at most {error.most} are allowed, as many as there are free coordinates"
        ) from None
    chosen.write(body, target)
    for k, (name, point) in enumerate(zip(body.places.names, body.places.points, strict=True), start=1):
        say(out, f"{chosen.by} {k}: {name}, at {', '.join(f'{round(x, 9) + 0.0:.4g}' for x in point)} m")
    say(out, f"{len(body.omega)} modes, {', '.join(f'{w / 6.283185307179586:.4g}' for w in body.omega)} Hz")
    say(out, str(target))
