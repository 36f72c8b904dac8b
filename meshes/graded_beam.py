"""A 5 m beam with short elements where the slider travels (1.25 m to 3.75 m) and long ones elsewhere.

    python meshes/graded_beam.py [FILE]

writes line cells that any reader of `mesh.file` understands; by default graded_beam.msh beside this script.
"""

import sys
from pathlib import Path

import meshio
import numpy as np

LENGTH, TRAVEL = 5.0, (1.25, 3.75)  # m
SHORT, LONG = 0.0625, 0.125  # m


def nodes() -> np.ndarray:
    """Node positions in m, ascending."""
    stretches = [(0.0, TRAVEL[0], LONG), (*TRAVEL, SHORT), (TRAVEL[1], LENGTH, LONG)]
    parts = [np.linspace(a, b, round((b - a) / h), endpoint=False) for a, b, h in stretches]
    return np.append(np.concatenate(parts), LENGTH)


def write(file: Path) -> None:
    """Write the mesh in gmsh's format."""
    x = nodes()
    points = np.column_stack([x, np.zeros_like(x), np.zeros_like(x)])
    lines = np.column_stack([np.arange(len(x) - 1), np.arange(1, len(x))])
    meshio.write(file, meshio.Mesh(points, [("line", lines)]), file_format="gmsh", binary=False)


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_suffix(".msh"))
