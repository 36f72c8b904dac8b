"""Where a result in space comes from: the structure, its pads and loads, sizes, the time that each part took."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import PurePath

from pmr.report.numbers import SPACE, plain, signed
from pmr.report.provenance import Table, damping, described, method, run, times
from pmr.report.space.layout import scene_of
from pmr.report.space.sentences import MODELS
from pmr.results import RunResult
from pmr.scene import StructureScene
from pmr.scene.choice import choose

Rows = Iterator[tuple[str, str]]
CELLS = {"line": "lines", "triangle": "triangles", "tetra": "tetrahedra", "hexahedron": "hexahedra"}


def sizes(result: RunResult) -> list[list[Table]]:
    """How large everything is, and the seconds that it took."""
    seconds = Table("Wall time", tuple(times(result.summary.get("seconds", {}))))
    return [[Table("Sizes", tuple(_sizes(result)))], *([[seconds]] if seconds.rows else [])]


def tables(result: RunResult) -> list[list[Table]]:
    """Parameters and circumstances of a run, in the columns in which they fill a page."""
    scene = scene_of(result)
    columns = (
        (Table("Structure", tuple(_body(scene))), Table("Run", tuple(run(result.summary, scene)))),
        (Table("Pads and loads", tuple(_motion(scene))),),
        (Table("Time stepping and reduction", tuple(method(scene))),),
    )
    return [[table for table in column if table.rows] for column in columns]


def _sizes(result: RunResult) -> Rows:
    scene, coordinates = scene_of(result), result.summary.get("coordinates", {})
    if "full" in coordinates:
        yield "coordinates of the full model", plain(coordinates["full"])
    yield "coordinates of the reduced model", plain(coordinates.get("reduced", result.shapes.shapes.shape[1]))
    if result.fields is not None:
        yield "mesh", f"{plain(len(result.fields.cells))} {CELLS[result.fields.kind]}"
        yield "vertices", plain(len(result.fields.points))
        yield "recovered fields", f"{plain(len(result.fields.t))} times"
    yield "pads", plain(sum(len(ring.places) for ring in scene.pads))
    yield "observed places", plain(scene.observe.count)
    if contact := result.summary.get("contact"):
        said = f"{plain(contact['parts'])}, each with h omega = {plain(round(contact['h_omega'], 3))}"
        yield "parts of a step, for pads that only push", said
    basis = result.summary.get("basis", {})
    if basis.get("rows_left_out"):
        yield "rows left out", ", ".join(basis["rows_left_out"])


def _body(scene: StructureScene) -> Rows:
    body, material, mesh = scene.body, scene.body.material, scene.mesh
    yield "model", f"{MODELS[choose(scene).model].split(' ', 1)[1]} ({body.model})"
    if body.box is not None:
        box = body.box
        yield "box", f"{plain(box.length)} × {plain(box.width)} × {plain(box.height)}{SPACE}m"
        yield "wall", f"{plain(1e3 * box.wall)}{SPACE}mm"
    elif body.thickness is not None:
        yield "thickness", f"{plain(1e3 * body.thickness)}{SPACE}mm"
    yield "Young's modulus", f"{plain(1e-9 * material.young)}{SPACE}GPa"
    yield "Poisson's ratio", plain(material.poisson)
    yield "density", f"{plain(material.density)}{SPACE}kg/m³"
    if mesh.file is not None:
        yield "mesh", PurePath(mesh.file).name
    elif choose(scene).model.startswith("beam"):
        yield "elements", plain(mesh.elements)
    else:
        yield "edges", f"{plain(mesh.size)}{SPACE}m, along the axis {plain(mesh.along or mesh.size)}{SPACE}m"
    for mass in scene.masses:
        yield f"mass {mass.name}", f"{plain(mass.mass)}{SPACE}kg on {mass.on}"
    for clamp in scene.clamps:
        yield "clamped", f"{clamp.on}: {', '.join(clamp.directions)}"
    yield from damping(scene)


def _motion(scene: StructureScene) -> Rows:
    yield "mouth path s", described(scene.slider.path, "m")
    for ring in scene.pads:
        where = (f"s {signed(ring.at)}" if ring.at else "s") if ring.moving else plain(ring.at)
        faces = ", ".join(f"{len(places)} {face}" for face, places in ring.faces.items())
        stiffness = ring.stiffness if isinstance(ring.stiffness, str) else f"{plain(ring.stiffness)}{SPACE}N/m"
        size = f"{plain(ring.length)} × {plain(ring.width)}{SPACE}m"
        yield f"pads at the {ring.name}", f"at {where}{SPACE}m, {faces}; {size}, {stiffness}"
    for hold in scene.holds:
        yield f"hold {hold.name}", f"{hold.on} along {hold.direction}, {hold.stiffness}"
    for load in scene.loads:
        unit = f"N{SPACE}m" if load.direction.startswith("r") else "N"
        on = load.on if isinstance(load.on, str) else f"{plain(load.on)}{SPACE}m"
        yield f"load {load.name}", f"{described(load.signal, unit)}; on {on} along {load.direction}"
    if scene.gravity is not None:
        along = ", ".join(plain(round(c, 3) + 0.0) for c in scene.gravity.direction)
        yield "gravity", f"{plain(scene.gravity.acceleration)}{SPACE}m/s² along ({along})"
