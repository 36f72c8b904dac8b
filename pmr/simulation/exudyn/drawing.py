"""Sensors and drawing of a system in an mbs (Exudyn's multibody system).

The sensors return the system's outputs and the forces of its contacts.  In Exudyn's renderer a boom that bends is drawn
as a tube for each section, along its outputs across the boom.  The tube has the section's profile at each point where
the scene observes the section; between two of these it changes linearly.
"""

# ruff: noqa: N815 - items are numbered as Exudyn users do: nodes n..., objects o..., markers m...

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import exudyn as exu
import numpy as np
from exudyn import graphics
from exudyn.itemInterface import ObjectGround, SensorUserFunction, VObjectGround

from pmr.errors import InputError
from pmr.files.arrays import Array, Indices
from pmr.scene import Scene
from pmr.scene.members import member_at
from pmr.simulation.exudyn.contacts import Contacts
from pmr.simulation.exudyn.equations import SignalInputs
from pmr.simulation.exudyn.items import SystemItems
from pmr.system.body import kinds_of, units_of
from pmr.system.contact_rows import ContactRows
from pmr.system.system import System


@dataclass(frozen=True)
class SystemSensors:
    """Numbers of the sensors of a system, and the names of the sensors' values in order."""

    sOutputs: exu.SensorIndex
    output_names: tuple[str, ...]
    sForces: exu.SensorIndex  # N, positive where contacts push
    contact_names: tuple[str, ...]


class ContactState(NamedTuple):
    """Contacts of a system at one time."""

    multipliers: Array  # (m,) N: forces without friction
    rows: ContactRows
    friction: Array | None  # (n,) N: of the pads; None if no pad rubs


class SystemObserver:
    """Outputs and contact forces of a system in one of Exudyn's configurations, and at the configuration's time."""

    def __init__(self, mbs: exu.MainSystem, items: SystemItems) -> None:
        self._mbs, self._items, self._contacts = mbs, items, Contacts(items.parts.equations, items.parts.inputs)
        self._held = list(items.contacts)
        self._rest = np.array([k not in items.contacts for k in range(len(self._contacts.gives))])

    def forces(self, t: float, configuration: exu.ConfigurationType) -> Array:
        """Contact forces (m,) in N with friction at t s; rigid contacts have those of the current configuration."""
        at = self._contact_state(t, self._items.coordinates(self._mbs, configuration))
        if at.friction is None:
            return at.multipliers
        return np.asarray(at.multipliers + self._items.parts.rubbing.law.cylinder_forces(at.friction))

    def outputs(self, t: float, configuration: exu.ConfigurationType) -> Array:
        """Outputs y = O q + W f - X lambda (o,) at t s in a `configuration`, with the effect of friction's moments."""
        equations, q = self._items.parts.equations, self._items.coordinates(self._mbs, configuration)
        at = self._contact_state(t, q)
        y = equations.outputs @ q + equations.assembly.direct @ self._acting_loads(t) - at.rows.X @ at.multipliers
        if at.friction is not None:
            turned = equations.assembly.outputs_by_moments(self._items.parts.inputs.positions(t)[0])
            y = y + turned @ self._items.parts.rubbing.law.moments(at.friction, at.multipliers)
        return np.asarray(y)

    def _acting_loads(self, t: float) -> Array:
        """Loads (i,) at t s, with the inertia of the boom by the motion of its base."""
        loads, base = np.array(self._items.parts.inputs.loads(t)), self._items.parts.base
        return loads if base is None else loads + base.inertia(self._mbs, t)

    def _contact_state(self, t: float, q: Array) -> ContactState:
        """Contacts at t s with the coordinates q (n,)."""
        equations, inputs, multipliers = (
            self._items.parts.equations,
            self._items.parts.inputs,
            np.zeros(len(self._rest)),
        )
        x, f, rubbing, grip = inputs.positions(t), self._acting_loads(t), self._items.parts.rubbing, None
        if self._held:
            multipliers[self._held] = self._mbs.GetObjectOutput(self._items.oContacts, exu.OutputVariableType.Force)
        if rubbing is not None:
            at = rubbing.state(rubbing.rows(x), q, f, t)
            multipliers[self._rest], grip = at.multipliers[self._rest], at.grip.forces
        elif self._rest.any():
            multipliers[self._rest] = self._contacts.forces(self._contacts.rows(x), q[None], f[None])[0]
        return ContactState(multipliers, equations.rows(x).at_time(0), grip)


def add_sensors(mbs: exu.MainSystem, items: SystemItems) -> SystemSensors:
    """Add sensors of the outputs y and the contact forces lambda of a system, one from `simulator.add_system`."""
    watched, equations = SystemObserver(mbs, items), items.parts.equations
    functions = (
        lambda mbs, t, sensors, factors, configuration: watched.outputs(t, configuration),
        lambda mbs, t, sensors, factors, configuration: watched.forces(t, configuration),
    )
    added = [
        mbs.AddSensor(SensorUserFunction(sensorNumbers=[], factors=[], sensorUserFunction=function, storeInternal=True))
        for function in functions
    ]
    return SystemSensors(added[0], equations.system.output_names, added[1], equations.system.contact_names)


#: Width in m with which a section without a known profile is drawn.
THIN = 0.02
#: RGBA of the sections; repeated if there are more.
COLORS = ((0.95, 0.75, 0.15, 1.0), (0.75, 0.55, 0.1, 1.0), (0.9, 0.85, 0.5, 1.0))


@dataclass(frozen=True)
class Tube:
    """A section as drawn, in coordinates from its tail, at k points along it."""

    x: Array  # (k,) m: points at which it is observed
    across: dict[int, Indices]  # indices of outputs (k,) along y (key 1) and z (key 2), if any
    outline: Array  # (k, c, 2) m: y and z of the profile's c corners at these points


def add_drawing(mbs: exu.MainSystem, items: SystemItems, scene: Scene, scale: float = 1.0) -> exu.ObjectIndex:
    """Draw a boom that was added by `simulator.add_system`, with deflections `scale` times as large.

    Returns the number of the ObjectGround that draws the boom, in the mbs' axes: on the body that carries the boom, or
    where the scene's frame puts it.  The object's user function is called whenever the picture changes.

    Raises InputError if a section is observed at less than two points along it.
    """
    drawn = BoomDrawing(mbs, items, scene, scale)
    looks = VObjectGround(graphicsDataUserFunction=lambda mbs, item: drawn.graphics())
    name = items.component_name(mbs, "Drawing")
    return mbs.AddObject(ObjectGround(name=name, visualization=looks))


class Posture(NamedTuple):
    """Position and axes of a boom, and its extensions."""

    pivot: Array  # (3,) m
    axes: Array  # (3, 3): columns are the axes of the boom
    extensions: Array  # m: of the sections, first the base's 0


class BoomDrawing:
    """Drawing of a boom in the state that Exudyn shows."""

    def __init__(self, mbs: exu.MainSystem, items: SystemItems, scene: Scene, scale: float = 1.0) -> None:
        self._mbs, self._items, self._scene, self._scale = mbs, items, scene, scale
        self._watched, self.tubes = SystemObserver(mbs, items), section_tubes(scene, items.parts.equations.system)
        place = (0.0, 0.0, 0.0) if scene.frame is None else scene.frame.tail_position
        self._place = np.array(place)

    def axes(self) -> list[Array]:
        """Points (k, 3) in m of each section's axis, k for each section, in the axes of the mbs."""
        return [rings[:, 0] for rings in self._rings([np.zeros((1, 1, 2))] * len(self.tubes))]

    def graphics(self) -> list[dict[str, object]]:
        """Exudyn's graphics data of all sections."""
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
        """Outlines (k, c, 3) in m at the k points of each section, in the axes of the mbs.

        `outlines` are (k or 1, c, 2) in m, the y and z of c corners across each section.
        """
        shown = exu.ConfigurationType.Visualization
        t = self._mbs.systemData.GetTime(shown)
        outputs, posture = self._watched.outputs(t, shown), self._posture(t, shown)
        rings_of_sections, observed = list[Array](), self._items.parts.equations.assembly.output_slices.values()
        for tube, outline, X, at in zip(self.tubes, outlines, np.cumsum(posture.extensions), observed, strict=True):
            rings = np.zeros((len(tube.x), outline.shape[1], 3))
            rings[:, :, 0] = X + tube.x[:, None]
            rings[:, :, 1:] = outline
            for axis, numbers in tube.across.items():
                rings[:, :, axis] += self._scale * outputs[at][numbers][:, None]
            rings_of_sections.append(posture.pivot + (rings + self._place) @ posture.axes.T)
        return rings_of_sections

    def _posture(self, t: float, shown: exu.ConfigurationType) -> Posture:
        """Posture of the boom at t s in the configuration that is `shown`."""
        base, kind, names = self._items.parts.base, exu.OutputVariableType.Coordinates, self._scene.names
        if base is None:
            assert isinstance(self._items.parts.inputs, SignalInputs)  # of a user's own mbs
            s = self._items.parts.inputs.paths(t)
            R = np.eye(3) if self._scene.frame is None else self._scene.frame.rotation(np.array([t]))[0]
            return Posture(np.zeros(3), R, np.array([0.0, *(s[name] for name in names[1:])]))
        x = np.array(self._mbs.GetNodeOutput(base.node, kind, shown))
        z = np.array(
            [value for n in base.paths.nodes for value in np.atleast_1d(self._mbs.GetNodeOutput(n, kind, shown))]
        )
        return Posture(
            base.origin(x), base.kinematics(x, 0.0 * x).axes, base.extensions(t, z, 0.0 * z).value[: len(names)]
        )


def section_tubes(scene: Scene, system: System) -> list[Tube]:
    """One tube for each section, from the base section on; a section without a box is a thin square one.

    Raises InputError if a section is observed at less than two points along it.
    """
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
            raise InputError("scene", scene.section_key(number, "observe.stations"), len(x), allowed)
        box = member_at(scene, number).part.body.box
        thin = THIN * np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])
        outline = [thin if box is None else [side.start for side in box.profile_at(at).sides] for at in x]
        across = {axis: np.array([numbers[place] for place in x]) for axis, numbers in along.items() if numbers}
        sections.append(Tube(np.array(x), across, np.array(outline)))
    return sections
