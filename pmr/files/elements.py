"""Elements of an input deck of Abaqus or CalculiX: their cells, corners, nodes amid edges, faces and edges."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from pmr.files.cards import Place

#: For each type of element, the kind of its cells in meshio's words.
KINDS: Mapping[str, str] = {
    **dict.fromkeys(("T2D2", "T2D2H", "T3D2", "T3D2H", "B21", "B21H", "B31", "B31H", "B31R", "B33"), "line"),
    **dict.fromkeys(("CPS3", "CPE3", "STRI3", "S3", "S3R", "S3RS", "R3D3", "M3D3"), "triangle"),
    **dict.fromkeys(("CPS4", "CPS4R", "CPE4", "CPE4R", "S4", "S4R", "S4RS", "S4RSW", "S4R5", "R3D4", "M3D4"), "quad"),
    **dict.fromkeys(("C3D4", "C3D4H"), "tetra"),
    **dict.fromkeys(("C3D8", "C3D8H", "C3D8I", "C3D8IH", "C3D8R", "C3D8RH"), "hexahedron"),
}
#: For each type of element with a node amid each edge, the kind of its cells.
QUADRATIC: Mapping[str, str] = {
    **dict.fromkeys(("S6", "STRI65"), "triangle"),
    **dict.fromkeys(("S8", "S8R", "S8R5"), "quad"),
    **dict.fromkeys(("C3D10", "C3D10H", "C3D10M", "C3D10MH"), "tetra"),
    **dict.fromkeys(("C3D20", "C3D20H", "C3D20R", "C3D20RH"), "hexahedron"),
}
#: Types of elements whose name has the number of their nodes.
COUNTED = re.compile(r"(?:[A-Z]*3D|CPS|CPE|CPEG|CAX|CGAX|SC|S)([1-9]\d?)[A-Z]*")
#: Number of corners of each kind, and the corners that its edges join, in the order of the nodes amid them.
CORNERS: Mapping[str, int] = {"line": 2, "triangle": 3, "quad": 4, "tetra": 4, "hexahedron": 8}
EDGES: Mapping[str, tuple[tuple[int, int], ...]] = {
    "line": (),
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "quad": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "tetra": ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    "hexahedron": (
        *((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6)),
        *((6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)),
    ),
}
_SOLID_FACES: Mapping[str, tuple[tuple[int, ...], ...]] = {
    "tetra": ((0, 1, 2), (0, 1, 3), (1, 2, 3), (0, 2, 3)),
    "hexahedron": ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 4, 5), (1, 2, 5, 6), (2, 3, 6, 7), (0, 3, 4, 7)),
}


@dataclass(frozen=True)
class Elements:
    """Elements of one card: their type, and three entries for each element.

    These are its number, its line and the numbers of its nodes.
    """

    type: str
    numbers: list[int]
    lines: list[Place]
    nodes: list[list[int]]

    @property
    def kind(self) -> str:
        """Kind of the cells in meshio's words; empty for a type that is not known."""
        return KINDS.get(self.type) or QUADRATIC.get(self.type, "")

    @property
    def node_count(self) -> int:
        """Number of nodes of an element; for a type without a kind the number in its name, as of C3D15, or else 0."""
        if not self.kind:
            named = COUNTED.fullmatch(self.type)
            return int(named[1]) if named else 0
        return CORNERS[self.kind] + (len(EDGES[self.kind]) if self.type in QUADRATIC else 0)

    def renumber(self, nodes: Mapping[int, int], elements: Mapping[int, int]) -> Elements:
        """Return these elements with the numbers that `nodes` and `elements` have for theirs."""
        numbers = [elements[number] for number in self.numbers]
        return Elements(self.type, numbers, self.lines, [[nodes[node] for node in of] for of in self.nodes])

    def face_corners(self, face: str) -> tuple[int, ...]:
        """Return which corners of an element are on a `face`, as surfaces call it: S1, E1, SPOS; empty for another.

        A shell has the faces SPOS and SNEG, and the edges E1 (Abaqus) or S3 (CalculiX) and so on.
        """
        letter, number = face[:1], int(face[1:]) - 1 if face[1:].isdigit() else -1
        if self.kind in _SOLID_FACES:
            faces = _SOLID_FACES[self.kind]
            return faces[number] if letter == "S" and 0 <= number < len(faces) else ()
        if not self.type.startswith("S") or not self.kind:
            return ()
        if face in ("SPOS", "SNEG", "S1", "S2"):
            return tuple(range(CORNERS[self.kind]))
        number = number - 2 if letter == "S" else number
        return EDGES[self.kind][number] if letter in "SE" and 0 <= number < len(EDGES[self.kind]) else ()
