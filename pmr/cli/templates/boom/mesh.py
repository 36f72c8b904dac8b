"""A mesh of one's own of the section, as a shell with rounded corners: python mesh.py, then in scene.toml

    [body]
    model = "shell"
    thickness = 0.006

    [mesh]
    file = "section.msh"

instead of [body.box].  Any mesh will do that names its groups: tail, tip, and the faces bottom, top, left and right.
"""

from pathlib import Path

from pmr.mesh.box import BoxBoom, write_shell

SECTION = BoxBoom(length=5.0, width=0.25, height=0.35, wall=0.006, radius=0.02, size=0.08, size_along=0.15)

if __name__ == "__main__":
    write_shell(SECTION, Path(__file__).with_name("section.msh"))
