"""Mesh files with changed lines, numbers and names: of a beam, a shell and a solid."""

import io
from contextlib import redirect_stderr, redirect_stdout
from functools import lru_cache
from pathlib import Path

import meshio
import numpy as np
from fuzz import toml
from fuzz.bases import BEAM, SHELL
from fuzz.mutations import NUMBERS, STRANGE, Random, scratched
from fuzz.scenes import coarse, ran
from fuzz.scenes import prepare as warm

from pmr import scene as scenes

ENDINGS = (".msh", ".msh", ".msh", ".msh", ".vtk", ".xdmf", ".inp", "", ".txt")


prepare = warm


def case(number: int, rng: Random, folder: Path) -> str:
    """Read a scene with a mutated mesh, and run it if both are accepted; return the outcome in a few words."""
    kind = ("beam", "shell", "solid")[int(rng.choice(3, p=[0.3, 0.5, 0.2]))]
    content = whole(kind)
    content = scratched(content, rng) if rng.random() < 0.3 else _edited(content, rng)
    ending = ENDINGS[int(rng.integers(len(ENDINGS)))] if rng.random() < 0.3 else ".msh"
    mesh = folder / f"mesh{ending}"
    mesh.write_bytes(content)
    if kind == "beam":
        scene = BEAM | {"mesh": {"file": mesh.name}}
    else:
        body = {"model": kind} | ({"thickness": 0.008} if kind == "shell" else {})
        scene = SHELL | {"body": body, "mesh": {"file": mesh.name}}
    file = folder / "scene.toml"
    file.write_text(toml.written(scene))
    return ran(coarse(scenes.load(file)), folder, drawn=False)


@lru_cache
def whole(kind: str) -> bytes:
    """Sound mesh of a kind, as text."""
    if kind == "beam":
        x = np.linspace(0.0, 5.0, 11)
        points = np.column_stack([x, 0.0 * x, 0.0 * x])
        return _text(meshio.Mesh(points, [("line", np.column_stack([np.arange(10), np.arange(1, 11)]))]), "gmsh")
    from boxes import block, box

    named = box(along=8, around=2) if kind == "shell" else block(along=8)
    cells, tags, data = [], [], {}
    order = {"quadrilateral": [0, 1, 3, 2], "hexahedron": [0, 1, 3, 2, 4, 5, 7, 6]}
    names = {"triangle": "triangle", "quadrilateral": "quad", "interval": "line", "hexahedron": "hexahedron"}
    faces = {2: "triangle" if kind == "shell" else "quadrilateral", 1: "interval", 3: "hexahedron"}
    if kind == "solid":
        cells.append(("hexahedron", named.cells[:, order["hexahedron"]]))
        tags.append(np.full(len(named.cells), 99))
        data["body"] = np.array([99, 3])
    for tag, (name, group) in enumerate(named.groups.items(), start=1):
        cell = faces[group.dim]
        cells.append((names[cell], group.entities[:, order.get(cell, slice(None))]))
        tags.append(np.full(len(group.entities), tag))
        data[name] = np.array([tag, group.dim])
    mesh = meshio.Mesh(
        named.points, cells, field_data=data, cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags}
    )
    return _text(mesh, "gmsh22")


def _text(mesh: meshio.Mesh, form: str) -> bytes:
    """Mesh in a format of meshio, as text."""
    import tempfile

    with tempfile.TemporaryDirectory() as folder, redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
        mesh.write(f"{folder}/m.msh", file_format=form, binary=False)
        return Path(folder, "m.msh").read_bytes()


def _moved(text: str, rng: Random) -> str:
    """Change a number in a text a little; other texts are returned unchanged."""
    try:
        return repr(float(text) + float(rng.normal(0.0, 0.01)))
    except ValueError:
        return text


def _edited(content: bytes, rng: Random) -> bytes:
    """Delete, double, swap or replace words and lines of a text."""
    lines = content.decode().splitlines()
    for _ in range(int(rng.integers(1, 4))):
        at, kind = int(rng.integers(len(lines))), int(rng.integers(9))
        words = lines[at].split(" ")
        word = int(rng.integers(len(words)))
        if kind == 0:
            del lines[at]
        elif kind == 1:
            lines.insert(at, lines[at])
        elif kind == 2:
            other = int(rng.integers(len(lines)))
            lines[at], lines[other] = lines[other], lines[at]
        elif kind == 3:
            words[word] = str(NUMBERS[int(rng.integers(len(NUMBERS)))])
        elif kind == 4:
            words[word] = STRANGE[int(rng.integers(len(STRANGE)))]
        elif kind == 5:
            words[word] = str(int(rng.integers(-2, 300)))
        elif kind > 6:  # a point moved a little, as a mesher of another version does
            lines[at] = " ".join(_moved(text, rng) if "." in text else text for text in words)
        else:
            named = [i for i, line in enumerate(lines) if '"' in line] or [at]
            at = named[int(rng.integers(len(named)))]
            words = [lines[at].replace('"t', '"T').replace("bottom", "top")]
        if kind in (3, 4, 5, 6):
            lines[at] = " ".join(words)
    return "\n".join(lines).encode("utf-8", "replace")
