"""A box boom as triangles (shell), hexahedra or tetrahedra, for `mesh.file`; needs gmsh.

    python meshes/box_boom.py shell boom.msh --size 0.05 --radius 0.03 --frames 2,4 --frame-depth 0.02

Lengths in m. Groups: bottom, top, left, right (the sliding paths), tail, tip, corners, frames.
"""

import argparse
from dataclasses import fields
from pathlib import Path

from pmr.models.box_mesh import BoxBoom, write_shell, write_solid
from pmr.scene.structures import BoxProfile

DIMENSIONS = {"width": 0.3, "height": 0.4, "wall": 0.008, "radius": 0.0}

WRITERS = {
    "shell": write_shell,
    "hexahedra": write_solid,
    "tetrahedra": lambda boom, file: write_solid(boom, file, hexahedra=False),
}


def main() -> None:
    """Read the dimensions and write the mesh."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=WRITERS)
    parser.add_argument("file", type=Path)
    for field in (*DIMENSIONS, *(field.name for field in fields(BoxBoom) if field.name != "sides")):
        default = DIMENSIONS.get(field) or getattr(BoxBoom, field, 0.0)
        kind = (lambda text: tuple(float(x) for x in text.split(","))) if isinstance(default, tuple) else float
        parser.add_argument("--" + field.replace("_", "-"), type=kind, default=default)
    given = vars(parser.parse_args())
    kind, file = given.pop("kind"), given.pop("file")
    profile = BoxProfile(**{key: given.pop(key) for key in DIMENSIONS})
    WRITERS[kind](BoxBoom(profile.sides, **given), file)


if __name__ == "__main__":
    main()
