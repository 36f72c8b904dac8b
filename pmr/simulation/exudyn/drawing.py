"""A boom that bends in Exudyn's renderer: a tube for each section, along what its outputs across it say.

Its profile is that of the scene where the section is observed; between two such places it changes linearly.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import exudyn as exu
import numpy as np
from exudyn import graphics
from exudyn.itemInterface import ObjectGround, VObjectGround
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.scene import Scene
from pmr.scene.members import member_at
from pmr.simulation.exudyn.items import SystemItems
from pmr.simulation.exudyn.sensors import Watched
from pmr.system.body import kinds_of, units_of
from pmr.system.system import System

Array = NDArray[np.float64]

#: m, of a section whose profile is not known
THIN = 0.02
#: RGBA of the sections, again from the first one where there are more.
COLORS = ((0.95, 0.75, 0.15, 1.0), (0.75, 0.55, 0.1, 1.0), (0.9, 0.85, 0.5, 1.0))


@dataclass(frozen=True)
class Tube:
    """A section as drawn, from its tail."""

    x: Array  # (k,) m: places at which it is observed
    across: dict[int, NDArray[np.int64]]  # numbers of the outputs (k,) along y (1) and z (2), as far as there are
    outline: Array  # (k, c, 2) m: y and z of its profile there


def add_drawing(mbs: Any, items: SystemItems, scene: Scene, scale: float = 1.0) -> Any:
    """Draw a boom that `add_system` added; deflections are `scale` times as large.

    Returns the number of the ObjectGround that draws it, in the mbs' axes: on the body that carries the boom, or where
    the scene's frame has it.  A user function of it is asked whenever the picture changes.

    An InputError is raised where a section is observed at less than two places along itself.
    """
    drawn = Drawn(mbs, items, scene, scale)
    looks = VObjectGround(graphicsDataUserFunction=lambda mbs, item: drawn.graphics())
    name = f"{mbs.GetMarker(items.mSystem)['name']}Drawing"
    return mbs.AddObject(ObjectGround(name=name, visualization=looks))


class Drawn:
    """Drawing of a boom in the state that Exudyn shows."""

    def __init__(self, mbs: Any, items: SystemItems, scene: Scene, scale: float = 1.0) -> None:
        self._mbs, self._items, self._scene, self._scale = mbs, items, scene, scale
        self._watched, self.tubes = Watched(mbs, items), tubes(scene, items.equations.system)
        place = (0.0, 0.0, 0.0) if scene.frame is None else scene.frame.place
        self._place = np.array(place)

    def axes(self) -> list[Array]:
        """Points (k, 3) m of each section's axis, in the axes of the mbs."""
        return [rings[:, 0] for rings in self._rings([np.zeros((1, 1, 2))] * len(self.tubes))]

    def graphics(self) -> list[dict[str, Any]]:
        """Exudyn's graphics data."""
        triangulated = []
        for number, rings in enumerate(self._rings([tube.outline for tube in self.tubes])):
            k, c, _ = rings.shape
            a = (c * np.arange(k - 1)[:, None] + np.arange(c)).ravel()
            b = (c * np.arange(k - 1)[:, None] + (np.arange(c) + 1) % c).ravel()
            triangles = np.vstack([np.column_stack([a, b, b + c]), np.column_stack([a, b + c, a + c])])
            color = list(COLORS[number % len(COLORS)])
            triangulated.append(graphics.FromPointsAndTrigs(rings.reshape(-1, 3), triangles, color))
        return triangulated

    def _rings(self, outlines: list[Array]) -> list[Array]:
        """Outlines (k, c, 3) m at all places of each section, from those (k or 1, c, 2) m across it."""
        shown = exu.ConfigurationType.Visualization
        t = self._mbs.systemData.GetTime(shown)
        outputs, (origin, R, extended) = self._watched.outputs(t, shown), self._posture(t, shown)
        rings_of_sections, observed = list[Array](), self._items.equations.assembly.observed.values()
        for tube, outline, X, at in zip(self.tubes, outlines, np.cumsum(extended), observed, strict=True):
            rings = np.zeros((len(tube.x), outline.shape[1], 3))
            rings[:, :, 0] = X + tube.x[:, None]
            rings[:, :, 1:] = outline
            for axis, numbers in tube.across.items():
                rings[:, :, axis] += self._scale * outputs[at][numbers][:, None]
            rings_of_sections.append(origin + (rings + self._place) @ R.T)
        return rings_of_sections

    def _posture(self, t: float, shown: Any) -> tuple[Array, Array, Array]:
        """Place (3,) m and axes (3, 3) of the pivot, and extensions of the sections, the base first."""
        base, kind, names = self._items.base, exu.OutputVariableType.Coordinates, self._scene.names
        if base is None:
            s = self._items.inputs.paths(t)
            R = np.eye(3) if self._scene.frame is None else self._scene.frame.rotation(np.array([t]))[0]
            return np.zeros(3), R, np.array([0.0, *(s[name] for name in names[1:])])
        x = np.array(self._mbs.GetNodeOutput(base.node, kind, shown))
        z = np.array(
            [value for n in base.paths.nodes for value in np.atleast_1d(self._mbs.GetNodeOutput(n, kind, shown))]
        )
        _, _, _, R = base.kinematics(x, 0.0 * x)
        return base.origin(x), R, base.extended(t, z, 0.0 * z).value[: len(names)]


def tubes(scene: Scene, system: System) -> list[Tube]:
    """One for each section, from the base out."""
    sections = []
    for number, body in enumerate(system.bodies.values()):
        kinds, units = kinds_of(body), units_of(body)
        along = {
            axis: {
                float(body.output_positions[k]): k
                for k, (kind, unit) in enumerate(zip(kinds, units, strict=True))
                if unit == "m" and kind in (f"beam {direction}", f"tip {direction}")
            }
            for axis, direction in ((1, "y"), (2, "z"))
        }
        at = [set(numbers) for numbers in along.values() if numbers]
        x = sorted(set.intersection(*at)) if at else []
        if len(x) < 2:
            allowed = "stations along it are allowed, with a drawing"
            raise InputError("scene", scene.key_of(number, "observe.stations"), len(x), allowed)
        box = member_at(scene, number).part.body.box
        thin = THIN * np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])
        outline = [thin if box is None else [side.start for side in box.profile_at(at).sides] for at in x]
        across = {axis: np.array([numbers[place] for place in x]) for axis, numbers in along.items() if numbers}
        sections.append(Tube(np.array(x), across, np.array(outline)))
    return sections
