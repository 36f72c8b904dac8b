"""Origin of a result: sizes of models, wall times, software and machine."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from pmr.files.arrays import Summary
from pmr.report.numbers import SPACE, format_input, format_quantity
from pmr.report.subject import reduced_size
from pmr.results import RunResult
from pmr.scene.keys import qualified_name

Rows = Iterator[tuple[str, str]]
CELLS = {"line": "lines", "triangle": "triangles", "tetra": "tetrahedra", "hexahedron": "hexahedra"}
_STEPS = {
    "assemble": "full model",
    "snapshots": "snapshots",
    "reduce": "reduction",
    "pod": "basis, projection",
    "exudyn": "simulation, Exudyn",
    "estimate": "error estimate",
    "march": "simulation, compiled",
    "exudyn-multiplier": "simulation, Exudyn, multipliers",
    "exudyn-callback": "simulation, Exudyn, callbacks",
    "recover": "fields and stresses",
    "reduced": "simulation, reduced",
    "full": "simulation, full",
    "ancf": "simulation, ANCF",
}


def software_versions(summary: Summary) -> list[str]:
    """Names and versions of the software that computed a result with this summary."""
    return [f"{name}{SPACE}{version}" for name, version in _flatten_times(summary.get("versions", {}))]


def size_rows(result: RunResult) -> Rows:
    """Yield rows with the sizes of models, meshes and fields, and with the number of pads.

    If pads only push, a row states the number of parts into which steps are divided for them.
    """
    coordinates = result.summary.get("coordinates", {})
    if "full" in coordinates:
        yield "coordinates of the full model", format_input(coordinates["full"])
    yield "coordinates of the reduced model", format_input(reduced_size(result))
    for part in result.summary.get("sections", ()):
        counts = part["coordinates"]
        yield f"coordinates of {part['name']}", f"{format_input(counts['full'])} → {format_input(counts['reduced'])}"
    for name, body in result.bodies.items():
        if (fields := body.fields) is not None:
            yield qualified_name(name, "mesh"), f"{format_input(len(fields.cells))} {CELLS[fields.kind]}"
            yield qualified_name(name, "vertices"), format_input(len(fields.points))
            yield qualified_name(name, "recovered fields"), f"{format_input(len(fields.t))} times"
    if pads := sum(len(ring.named_pads) for of in result.scene.bodies.values() for ring in of.pads):
        yield "pads", format_input(pads)
    if contact := result.summary.get("contact"):
        parts_text = (
            f"{format_input(contact['parts'])}, each with h omega = {format_input(round(contact['h_omega'], 3))}"
        )
        if "mean_parts" in contact:
            parts_text = f"at most {parts_text}; {format_input(round(contact['mean_parts'], 1))} in the mean"
        yield "parts of a step, for pads that only push", parts_text
    basis = result.summary.get("basis", {})
    if basis.get("carriers"):
        yield "carriers that the rows touch along the path", format_input(basis["carriers"])
    if basis.get("rows_left_out"):
        yield "rows left out", ", ".join(basis["rows_left_out"])


def time_rows(seconds: Summary) -> Rows:
    """Yield a row with the wall time in s of each part of the run; `seconds` are these times, in nested mappings."""
    for name, value in seconds.items():
        if isinstance(value, Mapping):
            yield from time_rows(value)
        else:
            yield _STEPS.get(name, name), format_quantity(float(value), "s")


def run_rows(result: RunResult) -> Rows:
    """Yield rows about the run: hash of the scene, commit, date and machine."""
    yield "scene", str(result.summary.get("scene_hash") or result.scene.hash)
    yield from origin_rows(result.summary)


def origin_rows(summary: Summary) -> Rows:
    """Yield rows about the origin of results with this summary: commit, date and machine, as far as they are known."""
    yield from ((key, str(summary[key])) for key in ("commit", "date") if summary.get(key))
    yield from _flatten_times(summary.get("machine", {}))


def _flatten_times(values: Mapping[str, object]) -> Rows:
    """Yield (name, text) of all entries of nested mappings that are not None; the names of the levels are joined."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from ((f"{name} {key}", text) for key, text in _flatten_times(value))
        elif value is not None:
            yield str(name), str(value)
