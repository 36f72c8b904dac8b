"""Meshes made by this package: patches drawn and meshed by gmsh, and the nodes of a straight planar beam.

The nodes of a beam are generated, or read from a chain of line cells in a file.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from pmr.errors import InputError
from pmr.errors.environment import import_package
from pmr.files.arrays import Array
from pmr.models.mesh_file import read_mesh_file, split_quads

Entity = tuple[int, int]  # dimension and tag

#: gmsh's element types: meshio's name and number of vertices.
ELEMENTS = {1: ("line", 2), 2: ("triangle", 3), 3: ("quad", 4), 4: ("tetra", 4), 5: ("hexahedron", 8)}
#: Number of bytes to append to a file that was cut off: more than a disk has left that had no room for an array.
BEYOND = 2**20


class NotDrawnError(ValueError):
    """gmsh can't draw or mesh its input; gmsh itself raises a bare `Exception`."""


@contextmanager
def _unchanged_sigpipe() -> Iterator[None]:
    """Context that restores the handler of the signal SIGPIPE on exit, because gmsh resets it.

    Otherwise a pipe that nobody reads would end the process without a message.
    """
    is_main = threading.current_thread() is threading.main_thread()  # only this thread can set handlers
    handler = signal.getsignal(signal.SIGPIPE) if is_main and hasattr(signal, "SIGPIPE") else None
    yield
    if handler is not None:
        signal.signal(signal.SIGPIPE, handler)


class Drawing:
    """A gmsh model in which a point, or a curve between two points, is drawn once however often it is requested.

    The drawing is a context manager, as gmsh is global to the process; on exit the context turns gmsh's errors into
    `NotDrawnError`.
    """

    def __enter__(self) -> Drawing:
        gmsh = import_package("gmsh")
        with _unchanged_sigpipe():
            gmsh.initialize(interruptible=False)
        gmsh.option.setNumber("General.Terminal", 0)
        self._model: Any = gmsh.model
        self._finalize = gmsh.finalize
        self._points: dict[tuple[float, ...], int] = {}
        self._curves: dict[frozenset[int], int] = {}
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._finalize()
        if kind is Exception:
            raise NotDrawnError(str(error)) from None

    def point(self, x: float, y: float, z: float) -> int:
        """Tag in gmsh of the point with the coordinates x, y, z in m."""
        key = tuple(round(c, 9) + 0.0 for c in (x, y, z))
        if key not in self._points:
            self._points[key] = self._model.geo.addPoint(x, y, z)
        return self._points[key]

    def line(self, start: int, end: int, divisions: int) -> int:
        """Tag in gmsh of the straight line between the points `start` and `end`, in `divisions` equal parts."""
        return self._curve(start, end, divisions, lambda: self._model.geo.addLine(start, end))

    def arc(self, start: int, centre: int, end: int, divisions: int) -> int:
        """Tag in gmsh of the arc around the point `centre` from the point `start` to `end`, in `divisions` parts."""
        return self._curve(start, end, divisions, lambda: self._model.geo.addCircleArc(start, centre, end))

    def _curve(self, start: int, end: int, divisions: int, draw: Callable[[], int]) -> int:
        """Tag in gmsh of the curve from `start` to `end`, tags of points; `draw` draws a curve that does not exist yet.

        A new curve gets as many cells as `divisions`.
        """
        key = frozenset((start, end))
        if key not in self._curves:
            self._curves[key] = draw()
            self._model.geo.mesh.setTransfiniteCurve(self._curves[key], divisions + 1)
        return self._curves[key]

    def patch(self, sides: Sequence[int], quads: bool) -> Entity:
        """Surface within the four curves `sides`, meshed in rows and columns: by rectangles if `quads`.

        Otherwise the cells are triangles.
        """
        geo = self._model.geo
        surface = geo.addPlaneSurface([geo.addCurveLoop(sides, reorient=True)])
        geo.mesh.setTransfiniteSurface(surface)
        if quads:
            geo.mesh.setRecombine(2, surface)
        return 2, surface

    def fill(self, curves: Sequence[int]) -> Entity:
        """Plane surface within a closed line of `curves`, meshed by triangles of the size of the curves' divisions."""
        geo = self._model.geo
        return 2, geo.addPlaneSurface([geo.addCurveLoop(list(curves), reorient=True)])

    def sweep(self, entities: Sequence[Entity], distance: float, layers: list[float], quads: bool) -> list[Entity]:
        """Sweep curves or surfaces along x by `distance` in m; returns the entities that gmsh makes, in its order.

        `layers` are the ends of the layers of cells as shares of `distance`; cells are not split in triangles if
        `quads`.
        """
        once = [1] * len(layers)
        return list(self._model.geo.extrude(list(entities), distance, 0, 0, once, layers, recombine=quads))

    def strips(self, outer: Sequence[int], inner: Sequence[int], divisions: int) -> list[Entity]:
        """Patches of rectangles between each curve of `outer` and the curve of `inner` with the same number.

        `divisions` is the number of rectangles across.
        """
        self._model.geo.synchronize()
        patches = []
        for left_curve, right_curve in zip(outer, inner, strict=True):
            (a, b), (c, d) = (
                [tag for _, tag in self._model.getBoundary([(1, curve)], oriented=False)]
                for curve in (left_curve, right_curve)
            )
            if self._distance(a, c) + self._distance(b, d) > self._distance(a, d) + self._distance(b, c):
                c, d = d, c
            patches.append(
                self.patch(
                    [left_curve, self.line(b, d, divisions), right_curve, self.line(c, a, divisions)], quads=True
                )
            )
        return patches

    def _distance(self, a: int, b: int) -> float:
        """Distance in m between the points with the gmsh tags `a` and `b`."""
        p, q = (np.array(self._model.getValue(0, tag, [])) for tag in (a, b))
        return float(np.linalg.norm(p - q))

    def boundary(self, entities: Sequence[Entity]) -> list[Entity]:
        """Entities of one dimension less that bound all given `entities` as a whole.

        An entity that two of the given entities share lies inside, and is left out.
        """
        self._model.geo.synchronize()
        return list(self._model.getBoundary(list(entities), combined=True, oriented=False))

    def bounds(self, entity: Entity) -> Array:
        """Lower and upper corner (2, 3) in m of an entity's bounding box."""
        return np.reshape(self._model.getBoundingBox(*entity), (2, 3))

    def write(
        self, groups: Mapping[str, Sequence[Entity]], file: Path, move: Callable[[Array], Array] = np.asarray
    ) -> None:
        """Mesh the drawing, move the mesh's points and write the mesh to `file`, with `groups` as physical groups.

        `move` maps points (N, 3) m to their new positions.  If the drawing is a surface, each of its rectangles becomes
        four triangles.

        Raises a `NotDrawnError` if cells collapse.
        """
        import meshio

        self._model.geo.synchronize()
        top = max(dim for members in groups.values() for dim, _ in members)
        self._model.mesh.generate(top)
        tags, coordinates, _ = self._model.mesh.getNodes()
        number = np.zeros(int(tags.max()) + 1, np.int64)
        number[tags.astype(np.int64)] = np.arange(len(tags))
        points = move(coordinates.reshape(-1, 3))
        cells, physical, field_data = [], [], {}
        for tag, (name, members) in enumerate(groups.items(), 1):
            field_data[name] = np.array([tag, members[0][0]])
            for entity in members:
                for element, _, nodes in zip(*self._model.mesh.getElements(*entity), strict=True):
                    if int(element) not in ELEMENTS:
                        raise NotDrawnError("cells collapse where sizes are too different")
                    kind, vertices = ELEMENTS[int(element)]
                    block = number[nodes.astype(np.int64)].reshape(-1, vertices)
                    if kind == "quad" and top == 2:
                        kind, quads, block = "triangle", block, split_quads(block, len(points))
                        points = np.concatenate([points, points[quads].mean(axis=1)])
                    cells.append((kind, block))
                    physical.append(np.full(len(block), tag))
        data = {"gmsh:physical": physical, "gmsh:geometrical": physical}
        mesh = meshio.Mesh(points, cells, cell_data=data, field_data=field_data)
        try:
            meshio.write(file, mesh, file_format="gmsh22", binary=True)
        except OSError as error:
            if error.errno is None:  # the error of an array that was cut off has no cause; that of further bytes has
                with file.open("ab") as stream:
                    stream.write(bytes(BEYOND))
            raise


def graded_nodes(length: float, elements: int, grading: float) -> Array:
    """Coordinates (elements + 1,) in m of a beam's nodes from 0 to `length`.

    The lengths of the elements grow geometrically.  `grading` is the length of the last element divided by the length
    of the first one.
    """
    if elements == 1 or grading == 1.0:
        return np.linspace(0.0, length, elements + 1)
    lengths = grading ** (np.arange(elements) / (elements - 1))
    nodes = np.concatenate([[0.0], np.cumsum(lengths)])
    return nodes * (length / nodes[-1])


def read_nodes(file: Path, length: float) -> Array:
    """Coordinates (N,) in m, ascending, of a beam's nodes from the line cells of a file that meshio reads.

    Raises an `InputError` if the line cells form no chain on the x axis from 0 to `length`, and the errors of
    `read_mesh_file`.
    """

    def refuse(problem: str) -> InputError:
        """The error for a file with this problem."""
        return InputError(str(file), "", None, f"{problem}; a chain of line cells on the x axis is allowed")

    read = read_mesh_file(file)
    kinds = sorted({block.kind for block in read.blocks} - {"vertex"})
    if kinds != ["line"]:
        raise refuse(f"cells of type {', '.join(kinds) or 'none'}")
    lines = np.concatenate([block.corners for block in read.blocks if block.kind == "line"])
    used = np.unique(lines)
    if not np.all(np.abs(read.points[used, 1:]) <= 1e-9 * length):
        raise refuse("points off the x axis")
    order = np.argsort(read.points[used, 0])
    nodes, rank = read.points[used[order], 0], np.empty(len(read.points), int)
    rank[used[order]] = np.arange(len(used))
    first = np.arange(len(nodes) - 1)
    is_chain = np.array_equal(np.unique(np.sort(rank[lines], axis=1), axis=0), np.stack([first, first + 1], axis=1))
    if not is_chain or len(lines) != len(first) or np.any(np.diff(nodes) <= 1e-12 * length):
        raise refuse(f"{len(lines)} lines on {len(nodes)} nodes that form no single chain")
    if not np.all(np.abs(nodes[[0, -1]] - [0.0, length]) <= 1e-9 * length):
        raise refuse(f"nodes from {nodes[0]:g} to {nodes[-1]:g} m, but the beam has {length:g} m from 0")
    nodes[0], nodes[-1] = 0.0, length
    return np.asarray(nodes, float)
