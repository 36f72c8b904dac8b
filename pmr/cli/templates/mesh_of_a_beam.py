"""A mesh of one's own of the beam, with short elements where the slider goes: python mesh.py, then in scene.toml

    [mesh]
    file = "beam.msh"

instead of `elements`.  Any chain of lines along x will do.
"""

from pathlib import Path

import meshio
import numpy as np

from pmr import load_scene

HERE = Path(__file__).parent
SHORT, LONG = 0.05, 0.1  # m

if __name__ == "__main__":
    scene = load_scene(HERE / "scene.toml")
    low, high = scene.path_bounds
    stretches = [(0.0, low, LONG), (low, high, SHORT), (high, scene.body.length, LONG)]
    parts = [np.linspace(a, b, round((b - a) / size), endpoint=False) for a, b, size in stretches]
    x = np.append(np.concatenate(parts), scene.body.length)
    points = np.column_stack([x, 0.0 * x, 0.0 * x])
    lines = np.column_stack([np.arange(len(x) - 1), np.arange(1, len(x))])
    meshio.write(HERE / "beam.msh", meshio.Mesh(points, [("line", lines)]), file_format="gmsh", binary=False)
