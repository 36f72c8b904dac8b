"""A box boom as triangles (shell), hexahedra or tetrahedra, for `mesh.file`; needs gmsh.

    python meshes/box_boom.py shell boom.msh --size 0.05 --radius 0.03 --frames 2,4 --frame-depth 0.02

Lengths in m. Groups: bottom, top, left, right (the sliding paths), tail, tip, corners, frames.
"""

import argparse
from dataclasses import fields
from pathlib import Path

from pmr.mesh.box import BoxBoom, write_shell, write_solid

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
    for field in fields(BoxBoom):
        name = "--" + field.name.replace("_", "-")
        many = isinstance(field.default, tuple)
        kind = (lambda text: tuple(float(x) for x in text.split(","))) if many else float
        parser.add_argument(name, type=kind, default=field.default)
    given = vars(parser.parse_args())
    kind, file = given.pop("kind"), given.pop("file")
    WRITERS[kind](BoxBoom(**given), file)


if __name__ == "__main__":
    main()
