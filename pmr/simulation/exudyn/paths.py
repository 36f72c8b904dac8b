"""How far a boom on a rigid body is out: by signals, functions, and coordinates of the user's own nodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import exudyn as exu
import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.scene import Scene
from pmr.simulation.floating import Extended

Array = NDArray[np.float64]


@dataclass(frozen=True)
class NodeCoordinate:
    """An extension that is a coordinate of a node: that of reference and the node's own displacement, in m.

    What moves the node, a cylinder or a winch, drives the boom, whose inertia, weight and pads act back on it.
    """

    node: Any  # number of a node with displacements, such as NodeGenericODE2, Node1D or NodePoint
    number: int = 0  # of its coordinates

    def __call__(self, mbs: Any, t: float) -> float:
        """Coordinate of the node now, or at the start; an InputError if it has no such coordinate."""
        node = mbs.GetNode(self.node)
        size = len(node["referenceCoordinates"])
        if not 0 <= self.number < size:
            allowed = f"a number from 0 to {size - 1} of the node's coordinates is allowed"
            raise InputError("Exudyn", "NodeCoordinate.number", self.number, allowed)
        displacements = node["initialCoordinates"]
        if mbs.systemData.ODE2Size():
            displacements = mbs.GetNodeOutput(self.node, exu.OutputVariableType.Coordinates)
        return float(node["referenceCoordinates"][self.number] + np.atleast_1d(displacements)[self.number])


def check_path(name: str, path: Any) -> None:
    """Raise an InputError for what can't say how far a section is out."""
    if not (hasattr(path, "value") and hasattr(path, "rate")) and not callable(path):
        allowed = (
            "a signal, an object with value(t) and rate(t), a function of mbs and t, or a NodeCoordinate is allowed"
        )
        raise InputError("system", f"paths.{name}", None, allowed)


class Paths:
    """Extensions of all sections, of which those that are coordinates of nodes are asked for with these.

    Behind them stand paths `aside`, which move no section.
    """

    def __init__(self, mbs: Any, scene: Scene, paths: Mapping[str, Any], aside: Sequence[str] = ()) -> None:
        #: of the P paths; the first is that of the base, which stays
        self.names = (*scene.names, *aside)
        self._t, h = np.nan, scene.time.step
        self.free = {name: path for name in self.names[1:] if isinstance(path := paths.get(name), NodeCoordinate)}
        self._given = {name: _Path(paths[name], h, mbs) for name in self.names[1:] if name not in self.free}
        self.nodes = list(dict.fromkeys(path.node for path in self.free.values()))
        sizes = [len(mbs.GetNode(node)["referenceCoordinates"]) for node in self.nodes]
        first = dict(zip(self.nodes, np.cumsum([0, *sizes]).tolist(), strict=False))
        #: d s / d z (P, m), of the extensions, the base's 0 first, by the m coordinates of the nodes
        self.along = np.zeros((len(self.names), sum(sizes)))
        self.reference = np.array([value for node in self.nodes for value in mbs.GetNode(node)["referenceCoordinates"]])
        for name, path in self.free.items():
            self.along[self.names.index(name), first[path.node] + path.number] = 1.0
        self._known = np.zeros((3, len(self.names)))

    def at(self, t: float, z: Array, z_t: Array) -> Extended:
        """At t s with the nodes' coordinates and rates (m,); second rates are those of signals and functions."""
        if t != self._t:
            self._t, self._known = t, np.zeros_like(self._known)
            for number, name in enumerate(self.names):
                if name in self._given:
                    self._known[:, number] = self._given[name].at(t)
        s, v, a = self._known
        return Extended(s + self.along @ (z + self.reference), v + self.along @ z_t, a)


class _Path:
    """A path, its kinks spread over one step of h: a signal, an object as one, or a function of the mbs and the time.

    The rates of a function are those of the parabola through its values around t, half a step apart.
    """

    def __init__(self, path: Any, h: float, mbs: Any) -> None:
        self._path, self._h, self._mbs = path, h, mbs

    def at(self, t: float) -> tuple[float, float, float]:
        """Value in m, rate and second rate."""
        half = self._h / 2.0
        if not hasattr(self._path, "rate"):
            middle = max(t, half)  # no time before the start is asked for
            before, now, after = (float(self._path(self._mbs, at)) for at in (middle - half, middle, middle + half))
            second = (after - 2.0 * now + before) / half**2
            return float(self._path(self._mbs, t)), (after - before) / self._h + second * (t - middle), second
        last, first = t + half, max(t - half, 0.0)
        second = (float(self._path.rate(last)) - float(self._path.rate(first))) / (last - first)
        return float(self._path.value(t)), float(self._path.rate(t)), second
