"""Fields over time and pads as boxes in files for ParaView: a .vtu for each time and body (or pads), a .pvd of all.

Pads are in axes fixed to the section that a body slides in.  The mouth of this section stays at x = 0, and the body
moves by -s, where s is the path coordinate in m.
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from html import escape
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from pmr.files.arrays import Array
from pmr.results.field_series import CUBE, Boxes, Fields, Grid, Pose, pad_corners
from pmr.results.quantities import FORCE_OF
from pmr.results.run import RunResult
from pmr.scene.keys import ALONE


def pads_over_time(result: RunResult) -> Boxes | None:
    """Return all pads of a body alone at the times of its recovered fields, with their forces in N.

    A force is NaN if it is not known.  If the scene has a moving frame, the corners are positions in space.  None is
    returned for a body without pads or recovered fields, and for a boom of sections.
    """
    if ALONE not in (travelling := result.moving_fields):
        return None
    scene, (fields, along) = result.scene.bodies[ALONE], travelling[ALONE]
    places = [(ring, *place) for ring in scene.pads for place in ring.named_pads]
    if not places:
        return None
    t, response = fields.t, result.responses["reduced"]
    body = np.array([fields.points.min(axis=0), fields.points.max(axis=0)])  # least and largest coordinates
    if fields.kind == "line" and scene.body.box is not None:
        outside = np.array([corner.position for corner in scene.body.box.corners])
        body += [[0.0, *outside.min(axis=0)], [0.0, *outside.max(axis=0)]]
    corners = np.empty((len(t), len(places), 8, 3))
    force = np.full((len(t), len(places)), np.nan)
    for k, (ring, name, face, across) in enumerate(places):
        corners[:, k] = pad_corners(ring, (name, face, across), body, scene.body.box, CUBE)
        if not ring.moving:
            corners[:, k, :, 0] += along[:, None]
        if FORCE_OF + name in response.force_names:
            force[:, k] = np.interp(t, response.t, response.force(FORCE_OF + name))
    if (pose := result.pose(t)) is not None:
        corners = pose.positions(corners.reshape(len(t), -1, 3)).reshape(corners.shape)
    return Boxes(tuple(name for _, name, _, _ in places), corners, {"force": force})


Named = Mapping[str, NDArray[Any]]

#: Beginning of the names of the pads' files, in the same folder as the bodies'.
PADS = "pads-"
_TYPES = {"line": 3, "triangle": 5, "tetra": 10, "hexahedron": 12}  # VTK's numbers
_NUMBERS = {"f": "Float", "i": "Int", "u": "UInt"}
_LEVEL = 3  # of zlib: most digits of a series don't compress, so a higher level only takes time


@dataclass(frozen=True)
class MovingFields:
    """Fields of a body with its frame at `axis_position` (S,) in m on the boom's axis, at the S times of the fields.

    If `axis_position` is None, the frame is at 0.  With a `pose` of the boom's axes in space, points and displacements
    are written in ground axes; stresses stay in the body's axes.
    """

    fields: Fields
    axis_position: Array | None = None
    pose: Pose | None = None

    def file(self, k: int) -> str:
        """Text of the .vtu file at the k-th time."""
        fields = self.fields
        named: dict[str, NDArray[Any]] = {
            f"von_mises_{_with_underscores(face)}": of[k] for face, of in fields.von_mises.items()
        }
        named |= {f"stress_{_with_underscores(of)}": stress[k] for of, stress in fields.stress.items()}
        points = fields.grid.points + (0.0 if self.axis_position is None else self.axis_position[k], 0.0, 0.0)
        displacement: NDArray[Any] = fields.displacement[k]
        if self.pose is not None:
            points, displacement = self.pose.positions_at(k, points), self.pose.rotate_at(k, displacement)
        return _vtu(fields.grid, points, {"displacement": displacement}, named | _regions(fields.grid))


def write_series(folder: Path, name: str, bodies: Mapping[str, MovingFields], pads: Boxes | None = None) -> Path:
    """Write ``name.pvd``, which is returned, and a folder ``name`` with one .vtu file for each time and body.

    `bodies` maps names to bodies, all at the same times; a single body may have an empty name.  The folder ``name`` is
    next to ``name.pvd``; old .vtu files in it are deleted.

    Points have ``displacement`` in m (ParaView: Warp By Vector).  Cells have ``von_mises_<face>`` in Pa, and
    ``region_<name>``: 1 in the region, 0 elsewhere.  If signed stresses are stored, cells have
    ``stress_<face>_<component>`` in Pa.  If `pads` is not None, the pads have a file of their own for each time, with
    their values.
    """
    drawn = {f"{body_name}-" if body_name else "": body.file for body_name, body in bodies.items()}
    if pads is not None:
        drawn[PADS] = lambda k: _pads_vtu(pads, k)
    steps = folder / name
    steps.mkdir(parents=True, exist_ok=True)
    for old in steps.glob("*.vtu"):
        old.unlink()
    root = ElementTree.Element("VTKFile", type="Collection", version="0.1", byte_order="LittleEndian")
    collection = ElementTree.SubElement(root, "Collection")
    for k, t in enumerate(next(iter(bodies.values())).fields.t):
        for number, (called, content) in enumerate(drawn.items()):
            file = f"{name}/{called}{k:05}.vtu"
            (folder / file).write_text(content(k), encoding="utf-8")
            ElementTree.SubElement(
                collection, "DataSet", timestep=repr(float(t)), group="", part=str(number), file=file
            )
    listing = folder / f"{name}.pvd"
    ElementTree.ElementTree(root).write(listing, encoding="utf-8", xml_declaration=True)
    return listing


def _pads_vtu(pads: Boxes, k: int) -> str:
    """Text of the pads' .vtu file at the k-th time: boxes with the numbers and values of the pads."""
    points = pads.corners[k].reshape(-1, 3)
    grid = Grid("hexahedron", points, np.arange(len(points)).reshape(-1, 8))
    values = {"pad": np.arange(len(pads.names))} | {what: value[k] for what, value in pads.values.items()}
    return _vtu(grid, points, {}, values)


def _regions(grid: Grid) -> dict[str, NDArray[Any]]:
    """Values ``region_<name>`` (C,) on the C cells of a grid: 1 for cells in the region, 0 for others."""
    every = np.arange(len(grid.cells))
    return {
        f"region_{_with_underscores(name)}": np.isin(every, grid.regions[name]).astype(np.int8)
        for name in sorted(grid.regions)
    }


def _with_underscores(name: str) -> str:
    """The name with underscores in place of spaces."""
    return name.replace(" ", "_")


def _vtu(grid: Grid, points: Array, of_points: Named, of_cells: Named) -> str:
    """Text of a VTK unstructured grid with the cells of `grid`.

    Its points are at `points` (N, 3) in m; `of_points` and `of_cells` are values at points and in cells by name.
    """
    count, corners = grid.cells.shape
    cells = {
        "connectivity": grid.cells,
        "offsets": corners * np.arange(1, count + 1),
        "types": np.full(count, _TYPES[grid.cell], np.uint8),
    }
    parts: dict[str, Named] = {"Points": {"Points": points}, "Cells": cells}
    parts |= {"PointData": of_points, "CellData": of_cells}
    inside = "".join(
        f"<{part}>{''.join(_array(name, values, part) for name, values in arrays.items())}</{part}>\n"
        for part, arrays in parts.items()
    )
    return (
        '<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian" '
        'compressor="vtkZLibDataCompressor">\n<UnstructuredGrid>\n'
        f'<Piece NumberOfPoints="{len(points)}" NumberOfCells="{count}">\n{inside}</Piece>\n'
        "</UnstructuredGrid>\n</VTKFile>\n"
    )


def _array(name: str, values: NDArray[np.generic], part: str) -> str:
    """Compressed DataArray element called `name` with `values`, (k,) or (k, components).

    `part` is the name of its parent: Points, Cells, PointData or CellData.
    """
    kind = f"{_NUMBERS[values.dtype.kind]}{8 * values.dtype.itemsize}"
    wide = f' NumberOfComponents="{values.shape[1]}"' if values.ndim > 1 and part != "Cells" else ""
    data = _compress(np.ascontiguousarray(values, values.dtype.newbyteorder("<")).tobytes())
    return f'<DataArray type="{kind}" Name="{escape(name)}"{wide} format="binary">{data}</DataArray>\n'


@lru_cache(maxsize=64)
def _compress(data: bytes) -> str:
    """Return `data` as one zlib block in base64, after VTK's header (count and sizes of blocks).

    The cache serves cells and regions, which are the same in every file of a series.
    """
    block = zlib.compress(data, _LEVEL)
    head = np.array([1, len(data), len(data), len(block)], "<u4").tobytes()
    return (base64.b64encode(head) + base64.b64encode(block)).decode()
