"""What is measured and drawn of a system in an mbs.

Sensors of a system in an mbs: its outputs, and the forces of its contacts.

A boom that bends in Exudyn's renderer: a tube for each section, along what its outputs across it say.

Its profile is that of the scene where the section is observed; between two such places it changes linearly.
"""

# ruff: noqa: N815 - items are numbered as Exudyn users do: nodes n..., objects o..., markers m...

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import exudyn as exu
import numpy as np
from exudyn import graphics
from exudyn.itemInterface import ObjectGround, SensorUserFunction, VObjectGround
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.scene import Scene
from pmr.scene.members import member_at
from pmr.simulation.exudyn.contacts import Contacts
from pmr.simulation.exudyn.items import SystemItems
from pmr.system.body import kinds_of, units_of
from pmr.system.contact_rows import ContactRows
from pmr.system.system import System


@dataclass(frozen=True)
class SystemSensors:
    """Numbers of the sensors, and what their values are called, in their order."""

    sOutputs: Any
    output_names: tuple[str, ...]
    sForces: Any  # N, positive where contacts push
    contact_names: tuple[str, ...]


class Watched:
    """Outputs and contact forces of a system, in a configuration of Exudyn's at its time."""

    def __init__(self, mbs: Any, items: SystemItems) -> None:
        self._mbs, self._items, self._contacts = mbs, items, Contacts(items.equations, items.inputs)
        self._held = list(items.contacts)
        self._rest = np.array([k not in items.contacts for k in range(len(self._contacts.gives))])

    def forces(self, t: float, configuration: Any) -> Array:
        """Lambda (m,) N, with their friction; of rigid contacts the current ones, for there are no others."""
        multipliers, _, grip = self._contact_state(t, self._items.coordinates(self._mbs, configuration))
        return multipliers if grip is None else multipliers + self._items.rubbing.law.along(grip)

    def outputs(self, t: float, configuration: Any) -> Array:
        """Y = O q + W f - X lambda (o,), and what moments of friction move."""
        equations, q = self._items.equations, self._items.coordinates(self._mbs, configuration)
        multipliers, rows, grip = self._contact_state(t, q)
        y = equations.outputs @ q + equations.assembly.direct @ self._loads(t) - rows.X @ multipliers
        if grip is not None:
            turned = equations.assembly.turned(self._items.inputs.at(t)[0])
            y = y + turned @ self._items.rubbing.law.moments(grip, multipliers)
        return np.asarray(y)

    def _loads(self, t: float) -> Array:
        """Loads (i,), with those by which a base that moves accelerates the boom."""
        loads, base = np.array(self._items.inputs.loads(t)), self._items.base
        return loads if base is None else loads + base.inertia(self._mbs, t)

    def _contact_state(self, t: float, q: Array) -> tuple[Array, ContactRows, Array | None]:
        """Lambda without friction, the rows, and what pads hold; None where none rubs."""
        equations, inputs, multipliers = self._items.equations, self._items.inputs, np.zeros(len(self._rest))
        x, f, rubbing, grip = inputs.at(t), self._loads(t), self._items.rubbing, None
        if self._held:
            multipliers[self._held] = self._mbs.GetObjectOutput(self._items.oContacts, exu.OutputVariableType.Force)
        if rubbing is not None:
            at = rubbing.state(rubbing.rows(x), q, f, t)
            multipliers[self._rest], grip = at.multipliers[self._rest], at.grip.forces
        elif self._rest.any():
            multipliers[self._rest] = self._contacts.forces(self._contacts.rows(x), q[None], f[None])[0]
        return multipliers, equations.rows(x).at(0), grip


def add_sensors(mbs: Any, items: SystemItems) -> SystemSensors:
    """Sensors of a system that `add_system` added: y = O q + W f - X lambda, and lambda, whenever they are written."""
    watched, equations = Watched(mbs, items), items.equations

    def write_forces(mbs: Any, t: float, sensors: Any, factors: Any, configuration: Any) -> Any:
        return watched.forces(t, configuration)

    def write_outputs(mbs: Any, t: float, sensors: Any, factors: Any, configuration: Any) -> Any:
        return watched.outputs(t, configuration)

    added = [
        mbs.AddSensor(SensorUserFunction(sensorNumbers=[], factors=[], sensorUserFunction=function, storeInternal=True))
        for function in (write_outputs, write_forces)
    ]
    return SystemSensors(added[0], equations.system.output_names, added[1], equations.system.contact_names)


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
    name = items.called(mbs, "Drawing")
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
