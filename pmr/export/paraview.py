"""Fields over time as files that ParaView opens: a .vtu a time of body and pads each, and a .pvd that lists them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
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
    body = Travelling(fields, np.zeros(len(fields.t)) if s is None else -s)
    drawn = {"": body.mesh} | ({PADS: lambda k: _of_pads(pads, k)} if pads is not None else {})
    return _written(folder, name, fields.t, drawn)


@dataclass(frozen=True)
class Travelling:
    """Fields of a body whose frame is at `along` (S,) m on the axis x at the times of the fields."""

    fields: Fields
    along: Array

    def mesh(self, k: int) -> Any:
        """As meshio has it, at time number k."""
        import meshio

        fields = self.fields
        named = {f"von_mises_{_word(face)}": stress[k] for face, stress in fields.von_mises.items()}
        named |= {f"stress_{_word(of)}": stress[k] for of, stress in fields.stress.items()}
        return meshio.Mesh(
            fields.grid.points + (self.along[k], 0.0, 0.0),
            [(fields.grid.cell, fields.grid.cells)],
            point_data={"displacement": np.ascontiguousarray(fields.displacement[k])},
            cell_data=_cells(named | _regions(fields.grid)),
        )


def write_bodies(folder: Path, name: str, bodies: Mapping[str, Travelling]) -> Path:
    """The same of several bodies by their names, at the same times, each where it is."""
    times = next(iter(bodies.values())).fields.t
    return _written(folder, name, times, {f"{one}-": body.mesh for one, body in bodies.items()})


def _written(folder: Path, name: str, times: Array, drawn: Mapping[str, Callable[[int], Any]]) -> Path:
    """A file for each time and part; what is `drawn` by the beginnings of the files' names."""
    import meshio

    steps = folder / name
    steps.mkdir(parents=True, exist_ok=True)
    for old in steps.glob("*.vtu"):
        old.unlink()
    root = ElementTree.Element("VTKFile", type="Collection", version="0.1", byte_order="LittleEndian")
    collection = ElementTree.SubElement(root, "Collection")
    for k, t in enumerate(times):
        for number, (called, mesh) in enumerate(drawn.items()):
            file = f"{name}/{called}{k:05}.vtu"
            meshio.write(folder / file, mesh(k))
            ElementTree.SubElement(
                collection, "DataSet", timestep=repr(float(t)), group="", part=str(number), file=file
            )
    listing = folder / f"{name}.pvd"
    ElementTree.ElementTree(root).write(listing, encoding="utf-8", xml_declaration=True)
    return listing


def _of_pads(pads: Boxes, k: int) -> Any:
    import meshio

    cells = [("hexahedron", np.arange(8 * len(pads.names)).reshape(-1, 8))]
    values = {"pad": np.arange(len(pads.names))} | {what: value[k] for what, value in pads.values.items()}
    return meshio.Mesh(pads.corners[k].reshape(-1, 3), cells, cell_data=_cells(values))


def _regions(grid: Grid) -> dict[str, NDArray[Any]]:
    """For each region which cells are in it."""
    every = np.arange(len(grid.cells))
    return {
        f"region_{_word(name)}": np.isin(every, grid.regions[name]).astype(np.int8) for name in sorted(grid.regions)
    }


def _cells(values: dict[str, NDArray[Any]]) -> dict[str, list[NDArray[Any]]]:
    """As meshio has them: one array for each block of cells."""
    return {name: [np.ascontiguousarray(array)] for name, array in values.items()}


def _word(name: str) -> str:
    return name.replace(" ", "_")
