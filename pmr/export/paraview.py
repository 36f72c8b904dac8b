"""Fields over time as files that ParaView opens: one .vtu a time, and a .pvd that lists them."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from pmr.fields.series import Fields


def write_series(folder: Path, name: str, fields: Fields) -> Path:
    """Write ``name.pvd``, which is returned, and beside it a folder ``name`` with a file for each time.

    Points carry ``displacement`` in m (ParaView: Warp By Vector), cells ``von_mises_<face>`` in Pa.
    """
    import meshio

    steps = folder / name
    steps.mkdir(parents=True, exist_ok=True)
    for old in steps.glob("*.vtu"):
        old.unlink()
    root = ElementTree.Element("VTKFile", type="Collection", version="0.1", byte_order="LittleEndian")
    collection = ElementTree.SubElement(root, "Collection")
    cells = [(fields.grid.cell, fields.grid.cells)]
    for k, t in enumerate(fields.t):
        mesh = meshio.Mesh(
            fields.grid.points,
            cells,
            point_data={"displacement": np.ascontiguousarray(fields.displacement[k])},
            cell_data={_name(face): [np.ascontiguousarray(stress[k])] for face, stress in fields.von_mises.items()},
        )
        file = steps / f"{k:05}.vtu"
        meshio.write(file, mesh)
        ElementTree.SubElement(
            collection, "DataSet", timestep=repr(float(t)), group="", part="0", file=f"{name}/{file.name}"
        )
    listing = folder / f"{name}.pvd"
    ElementTree.ElementTree(root).write(listing, encoding="utf-8", xml_declaration=True)
    return listing


def _name(face: str) -> str:
    return "von_mises_" + face.replace(" ", "_")
