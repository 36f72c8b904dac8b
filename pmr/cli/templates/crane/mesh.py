"""A mesh of one's own of the section, as a shell with rounded corners: python mesh.py, then in scene.toml

    [body]
    model = "shell"
    thickness = 0.007

    [mesh]
    file = "section.msh"

instead of [body.box].  Any mesh will do that names its groups: tail, tip, and the faces bottom, top, left and right.
"""

from pathlib import Path

from pmr.mesh.box import BoxBoom, write_shell

SECTION = BoxBoom(length=12.0, width=0.45, height=0.6, wall=0.007, radius=0.03, size=0.15, size_along=0.3)

if __name__ == "__main__":
    write_shell(SECTION, Path(__file__).with_name("section.msh"))
