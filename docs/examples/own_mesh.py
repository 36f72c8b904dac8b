"""
A mesh of one's own, drawn with gmsh
====================================

A mesh for `pmr` needs named groups: ``tail`` and ``tip`` where it ends, and the faces on which pads slide.  Here gmsh
draws a rail, an I-section of three plates.  The rail slides out between pads on its flanges and its web.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import gmsh
import matplotlib.pyplot as plt
import numpy as np

import pmr

LENGTH, WIDTH, HEIGHT, SIZE = 3.0, 0.1, 0.16, 0.05  # m


def draw(file: Path) -> None:
    """The middle surfaces of both flanges and the web, with names."""
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    occ, y, z = gmsh.model.occ, WIDTH / 2, HEIGHT / 2
    flat = [occ.addRectangle(0, -y, level, LENGTH, WIDTH) for level in (-z, z)]
    web = occ.addRectangle(0, -z, 0, LENGTH, HEIGHT)
    occ.rotate([(2, web)], 0, 0, 0, 1, 0, 0, 3.14159265358979 / 2)
    occ.fragment([(2, tag) for tag in flat], [(2, web)])
    occ.synchronize()

    def within(dimension: int, *box: float) -> list[int]:
        """Entities of a dimension in a box: x, y, z from, x, y, z to."""
        low, high = [b - 1e-6 for b in box[:3]], [b + 1e-6 for b in box[3:]]
        return [tag for _, tag in gmsh.model.getEntitiesInBoundingBox(*low, *high, dimension)]

    names = {"bottom": within(2, 0, -y, -z, LENGTH, y, -z), "top": within(2, 0, -y, z, LENGTH, y, z),
             "left": within(2, 0, 0, -z, LENGTH, 0, z)}  # fmt: skip
    ends = {"tail": within(1, 0, -y, -z, 0, y, z), "tip": within(1, LENGTH, -y, -z, LENGTH, y, z)}
    for dimension, found in ((2, names), (1, ends)):
        for name, tags in found.items():
            gmsh.model.addPhysicalGroup(dimension, tags, name=name)
    gmsh.option.setNumber("Mesh.MeshSizeMax", SIZE)
    gmsh.model.mesh.generate(2)
    gmsh.write(str(file))
    gmsh.finalize()


# %%
# The scene names the file, the thickness of the plates, and where on each face the pads are.

SCENE = """
title = "A rail"
body = { model = "shell", thickness = 0.006 }
mesh.file = "rail.msh"
time = { end = 2.0, step = 1e-3 }
slider.path = { kind = "smooth_ramp", times = [0.2, 1.8], values = [0.8, 1.8] }
loads = [{ on = "tip", direction = "z", signal = { kind = "smooth_ramp", times = [0.0, 0.2], values = [0.0, -500.0] } }]
supports = [{ directions = ["x"] }]
observe = { start = 0.2, end = 2.8 }
recovery = { every = 0.05, series = false }
compare.against = []

[[pads]]
name = "tail"
at = 0.2
width = 0.03
faces = { bottom = [-0.03, 0.03], top = [-0.03, 0.03], left = [0.0] }

[[pads]]
name = "mouth"
moving = true
width = 0.03
faces = { bottom = [-0.03, 0.03], top = [-0.03, 0.03], left = [0.0] }
"""
with TemporaryDirectory() as folder:
    draw(Path(folder, "rail.msh"))
    Path(folder, "scene.toml").write_text(SCENE)
    result = pmr.run(pmr.load_scene(Path(folder))).result
summary, motion = result.summary, result.responses["reduced"]
lowest = 1e3 * float(motion.tip.min())
print(f"{summary['coordinates']['full']} degrees of freedom, {summary['coordinates']['reduced']} coordinates")
print(f"the tip goes down by {-lowest:.1f} mm, stresses reach {1e-6 * summary['max_von_mises']['reduced']:.0f} MPa")

# %%
# The largest stress of each cell over time.

surface = result.body.fields
walls = np.max([stress.max(axis=0) for stress in surface.von_mises.values()], axis=0)
figure = plt.figure(figsize=(7, 4.5))
axes = figure.add_subplot(projection="3d")
axes.set_box_aspect((3, 0.6, 0.6), zoom=1.15)
drawn = axes.plot_trisurf(*surface.points.T, triangles=surface.cells, lw=0.0)
drawn.set(array=1e-6 * walls, cmap="viridis")
figure.colorbar(drawn, label="von Mises stress in MPa", shrink=0.5, orientation="horizontal", pad=0.0)
axes.set(yticks=(-0.05, 0.05), zticks=(-0.08, 0.08))
plt.show()
