"""A mesh of one's own of the section, as a shell with rounded corners: python mesh.py, then in scene.toml

    [body]
    model = "shell"
    thickness = 0.008       # the wall's

    [mesh]
    file = "section.msh"

instead of [body.box].  Any mesh will do that names its groups: tail, tip, and the faces bottom, top, left and right.
"""

from pathlib import Path

from pmr import load_scene
from pmr.models.box_mesh import BoxBoom, write_shell

HERE = Path(__file__).parent

if __name__ == "__main__":
    box = load_scene(HERE / "scene.toml").body.box  # the dimensions that stand there
    rounded = box.model_copy(update={"radius": 0.02})
    section = BoxBoom(rounded.sides, box.length, size=0.08, size_along=0.15)
    write_shell(section, HERE / "section.msh")
