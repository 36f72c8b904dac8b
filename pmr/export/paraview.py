"""Fields over time as files that ParaView opens: a .vtu a time of body and pads each, and a .pvd that lists them."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from pmr.fields.grid import Grid
from pmr.fields.series import Boxes, Fields

Array = NDArray[np.float64]

#: Where the pads' files are, in the folder of the body's.
PADS = "pads-"


def write_series(folder: Path, name: str, fields: Fields, s: Array | None = None, pads: Boxes | None = None) -> Path:
    """Write ``name.pvd``, which is returned, and beside it a folder ``name`` with a file for each time.

    Points carry ``displacement`` in m (ParaView: Warp By Vector); cells ``von_mises_<face>`` and, where they are
    stored, signed stresses ``stress_<face>_<component>`` in Pa, and ``region_<name>``, 1 in the region and 0 elsewhere.
    With the path coordinate `s` (S,) m the body stands where it is: the mouth that it slides through at x = 0.  The
    pads are a second part, with their values.
    """
    import meshio

    steps = folder / name
    steps.mkdir(parents=True, exist_ok=True)
    for old in steps.glob("*.vtu"):
        old.unlink()
    root = ElementTree.Element("VTKFile", type="Collection", version="0.1", byte_order="LittleEndian")
    collection = ElementTree.SubElement(root, "Collection")
    ahead = np.zeros(len(fields.t)) if s is None else -s
    regions = _regions(fields.grid)
    for k, t in enumerate(fields.t):
        named = {f"von_mises_{_word(face)}": stress[k] for face, stress in fields.von_mises.items()}
        named |= {f"stress_{_word(of)}": stress[k] for of, stress in fields.stress.items()}
        parts = [
            meshio.Mesh(
                fields.grid.points + (ahead[k], 0.0, 0.0),
                [(fields.grid.cell, fields.grid.cells)],
                point_data={"displacement": np.ascontiguousarray(fields.displacement[k])},
                cell_data=_cells(named | regions),
            )
        ]
        if pads is not None:
            cells = [("hexahedron", np.arange(8 * len(pads.names)).reshape(-1, 8))]
            values = {"pad": np.arange(len(pads.names))} | {what: value[k] for what, value in pads.values.items()}
            parts.append(meshio.Mesh(pads.corners[k].reshape(-1, 3), cells, cell_data=_cells(values)))
        for number, mesh in enumerate(parts):
            file = f"{name}/{PADS if number else ''}{k:05}.vtu"
            meshio.write(folder / file, mesh)
            ElementTree.SubElement(
                collection, "DataSet", timestep=repr(float(t)), group="", part=str(number), file=file
            )
    listing = folder / f"{name}.pvd"
    ElementTree.ElementTree(root).write(listing, encoding="utf-8", xml_declaration=True)
    return listing


def _regions(grid: Grid) -> dict[str, NDArray[Any]]:
    """For each region which cells are in it."""
    inside = {name: np.zeros(len(grid.cells), np.int8) for name in sorted(grid.regions)}
    for name, cells in grid.regions.items():
        inside[name][cells] = 1
    return {f"region_{_word(name)}": mask for name, mask in inside.items()}


def _cells(values: dict[str, NDArray[Any]]) -> dict[str, list[NDArray[Any]]]:
    """As meshio has them: one array for each block of cells."""
    return {name: [np.ascontiguousarray(array)] for name, array in values.items()}


def _word(name: str) -> str:
    return name.replace(" ", "_")
