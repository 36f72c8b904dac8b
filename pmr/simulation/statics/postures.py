"""Postures of a boom at rest, all at once: its matrices, and the loads by its weight, by given loads and by a mass.

Also outputs that show the deflection of a boom at rest: displacements of points of its sections, across the boom.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pmr.files.arrays import Array, Indices, Mask
from pmr.kernel.laws import Stand
from pmr.results.quantities import FORCE_OF, Columns
from pmr.results.response import Output
from pmr.scene import Scene
from pmr.scene.built import Load
from pmr.scene.choice import motion_directions, traits_of
from pmr.scene.keys import LUFFING
from pmr.scene.members import members
from pmr.scene.rotation import FrameRotation, boom_rotation
from pmr.scene.signals import Constant
from pmr.simulation.at_rest import RestRows, accelerate_angle, constant_inclination, rest_rows, scene_at_rest
from pmr.simulation.excitation import Excitation
from pmr.simulation.reactions import machine_wrench, outputs_of, outputs_of_ground
from pmr.simulation.statics.loaded import Equations, LoadEffects
from pmr.system.assembly import Assembly
from pmr.system.body import kinds_of
from pmr.system.states import ContactRows
from pmr.system.system import System

#: Name of the load of a chart, with the unit 1 kg.
HOOK = "load of the chart"
#: Names of further components of the loads: the weights of the boom, with masses on it, and of the machine's masses.
#: Loads of a scene can't have these names, which do not begin with a letter.
WEIGHT, MACHINE_WEIGHT = "(weight of the boom)", "(weight of the machine)"
#: Name of a further component, in kg, which acts as `HOOK` does but does not grow: weight of masses that are hoisted
#: with the load, beyond what `WEIGHT` has of it.
HOISTED = "(weight of hoisted masses)"
#: Name of a load that is always zero: without it a model would lack the modes in which a boom buckles sideways.
SIDEWAYS = "sideways in the chart"


@dataclass(frozen=True)
class PostureSet:
    """P postures of a boom: extensions (P,) in m by the sections' names, luffing and slewing angles (P,) in rad."""

    extensions: Mapping[str, Array]  # for a single body the slider's path coordinate, if there is one
    luffing: Array
    slewing: Array

    @classmethod
    def from_task(cls, at: Mapping[str, Any]) -> PostureSet:
        """Postures from a task's arguments `at`: lists ``extensions`` by name, ``luffing`` and ``slewing``."""
        extensions = {name: np.array(extension, float) for name, extension in at["extensions"].items()}
        return cls(extensions, np.array(at["luffing"], float), np.array(at["slewing"], float))

    @property
    def count(self) -> int:
        """Number P of postures."""
        return len(self.luffing)

    def select(self, numbers: Indices) -> PostureSet:
        """The postures with the numbers `numbers` (k,), in this order."""
        extensions = {name: values[numbers] for name, values in self.extensions.items()}
        return PostureSet(extensions, self.luffing[numbers], self.slewing[numbers])

    def boom_length(self, scene: Scene) -> Array:
        """Distance (P,) in m along the boom from the tail of the base section to the tip of the last section.

        Every section of `scene` but the base has to have an extension.
        """
        tails = np.sum([np.zeros(self.count), *(self.extensions[name] for name in scene.names[1:])], axis=0)
        return np.asarray(tails + scene.sections[-1].length)

    def positions_on_base(self, scene: Scene, distances: Array) -> Array:
        """Position (P, 3) in m from the pivot of a point of the undeformed boom in each posture, in axes of the base.

        The axes of the base are X, Y and Z of the ground unless the base is inclined.  `distances` (P,) in m are the
        distances of the point from the tail of the base section.
        """
        place = np.array(scene.present_frame.tail_position) + distances[:, None] * np.eye(3)[0]
        return np.einsum("pij,pj->pi", boom_rotation(self.luffing, self.slewing), place)


def with_hook(scene: Scene, point: tuple[float, float, float] | None = None) -> Scene:
    """Scene with the load of a chart, `HOOK`, added: the weight of 1 kg, downwards in ground axes.

    The load acts at `point` in m in the axes of the last section, which moves with the tip; by default at the tip
    itself.  If the last section can bend sideways, `SIDEWAYS`, a load that is always zero, is added too.  The base
    keeps only its constant inclination, and the scene's `recovery` is removed.
    """
    assert scene.gravity is not None  # the caller has checked it
    pull = Constant(amount=-scene.gravity.acceleration)
    hook = Load(name=HOOK, on="tip", point=point, direction="z", axes="ground", signal=pull)
    last, loads = scene.sections[-1], [hook]
    if "y" in motion_directions(members(scene)[-1]):
        loads.append(Load(name=SIDEWAYS, on="tip", point=point, direction="y", signal=Constant(amount=0.0)))
    parts = (*scene.sections[:-1], last.with_keys(loads=(*last.loads, *loads)))
    base = constant_inclination(scene.present_frame.base)
    return scene.with_keys(sections=parts, frame={"base": base}, recovery=None)


def with_winds(scene: Scene, winds: Mapping[str, tuple[float, float]]) -> Scene:
    """Scene with winds of zero pressure that turn with the boom: loads on sections, with the names of `winds`.

    A value of `winds` is a pair: the angle from the boom to the direction in which the wind blows, in the unit of the
    scene's frame, and the shape factor.  If a section already has a wind, the added winds take shape factor, depth and
    height profile from its first wind.  Other sections need a box and no given matrices; otherwise they get no wind.  A
    box that varies along its section meets the wind with its largest dimension.
    """
    parts = list[Any]()
    for member in members(scene):
        part, box, loads = member.part, member.part.body.box, list[Load]()
        wind_of_part = next((load for load in part.loads if load.acts == "wind"), None)
        for name, (azimuth, shape) in winds.items():
            blows = {"name": name, "azimuth": azimuth, "slews": True, "signal": Constant(amount=0.0)}
            if wind_of_part is not None:
                loads.append(wind_of_part.model_copy(update=blows))
            elif box is not None and traits_of(member).kind != "matrices":
                profiles = [box.profile_at(x) for x in box.breaks] if box.varying_keys else []
                depth = max((max(profile.width, profile.height) for profile in profiles), default=None)
                loads.append(Load(acts="wind", shape=shape, depth=depth, **blows))
        parts.append(part.with_keys(loads=(*part.loads, *loads)) if loads else part)
    return scene.with_keys(sections=tuple(parts))


def hook_offset(scene: Scene) -> Array:
    """Place (3,) in m of `HOOK` from the end of the last section's axis, in a scene made by `with_hook`."""
    last = scene.sections[-1]
    points = (load.point for load in last.loads if load.name == HOOK and load.point is not None)
    return np.asarray(next(points, (last.length, 0.0, 0.0)), float) - (last.length, 0.0, 0.0)


@dataclass(frozen=True)
class StructureMatrices:
    """Matrices of a system that are the same in all postures, for n coordinates, i inputs, o outputs and m contacts."""

    M: Array  # (n, n)
    K: Array  # (n, n)
    B: Array  # (n, i)
    outputs: Array  # (o, n): of the tip, compliant supports and probes
    direct: Array  # (o, i)
    energy: Array  # (i, i)
    terms: Array  # (k, n, n): stiffness of each of k terms by a unit of its amplitude
    pushes: Mask  # (m,)
    clearance: Array  # (m,) m


@dataclass(frozen=True)
class PosturePlaces:
    """Angles and places of a boom in P postures."""

    slewing: Array  # (P,) rad
    luffing: Array  # (P,) rad
    up: Array  # (P, 3): the vertical in the axes of the boom
    # (P, 3) m: the undeformed place of `HOOK`, the tip unless it has a point, from the pivot in the axes of the boom
    hook: Array
    arm: Array  # (P,) m: lever arm about the pivot of the luffing cylinder; NaN where the scene has none


@dataclass(frozen=True)
class HookInputs:
    """Numbers of the inputs along which the load `HOOK` moves as a mass, and the boom's axes along which they act."""

    numbers: Indices
    axes: tuple[str, ...]

    @classmethod
    def from_system(cls, system: System) -> HookInputs:
        """Inputs of the weight of `HOOK`; if none of them acts sideways, the first input of `SIDEWAYS` is added."""
        inputs = {name.rpartition(" ")[2]: k for k, name in enumerate(system.input_names) if HOOK in name}
        for k, name in enumerate(system.input_names):
            if SIDEWAYS in name:
                inputs.setdefault("y", k)
        return cls(np.array([*inputs.values()]), tuple(name[-1] for name in inputs))


@dataclass(frozen=True)
class UnitLoads:
    """Loads of w components, each by a unit, in P postures.

    They are `WEIGHT`, `MACHINE_WEIGHT` and `HOISTED`, then every load by its name.  A unit is 1 N, 1 N m, or the weight
    of 1 kg of `HOOK` and `HOISTED`.  The weight of the machine does not act on the boom.
    """

    names: tuple[str, ...]  # (w,)
    f: Array  # (w, P, i): loads on i inputs
    c: Array  # (w, P, k): amplitudes of k terms

    @classmethod
    def from_scene(cls, scene: Scene, system: System, postures: PostureSet) -> UnitLoads:
        """Loads of a scene made by `with_hook` on a system in these postures.

        For a load of the scene, f and c are what one unit of this load adds to the f and c of the boom's weight.
        """
        assert scene.gravity is not None
        names = load_names(scene)
        unit = dict.fromkeys(names, 1.0) | {HOOK: -scene.gravity.acceleration}
        numbers, f, c = np.arange(postures.count, dtype=float), list[Array](), list[Array]()
        for acting in ("", *names):
            driven = Excitation.from_scene(_still_scene(scene, postures, {acting: unit[acting]} if acting else {}))
            f.append(driven.forces(system.input_names, numbers))
            c.append(driven.amplitudes(system.term_names, numbers))
        hook = 1 + names.index(HOOK)
        of_load, amplitude = (
            np.array([of[0], np.zeros_like(of[0]), of[hook] - of[0], *(each - of[0] for each in of[1:])])
            for of in (f, c)
        )
        return cls((WEIGHT, MACHINE_WEIGHT, HOISTED, *names), of_load, amplitude)


@dataclass(frozen=True)
class StandAtRest:
    """Outriggers, and the weight of the machine's masses in P postures."""

    stand: Stand
    columns: Columns  # meaning of the stand's columns
    weight: Array  # (P, 6) N and N m: force and moment about the pivot, along the axes of the machine

    @classmethod
    def in_postures(cls, still: Scene, postures: PostureSet) -> StandAtRest | None:
        """Outriggers of a scene `still`, made by `scene_at_rest`, in these postures; None without a ground."""
        if still.frame is None or still.frame.ground is None:
            return None
        numbers = np.arange(postures.count, dtype=float)
        outputs = [replace(output, name=output.name.removeprefix(FORCE_OF)) for output in outputs_of_ground(still)]
        columns = Columns.of_outputs(still, outputs)
        return cls(Stand.of_ground(still.frame.ground), columns, machine_wrench(still, numbers))


@dataclass(frozen=True)
class PostureMatrices:
    """Matrices of a system in P postures, and the loads of each of w components.

    Sizes: n coordinates, i inputs, m contacts, o outputs, k terms, r forces on supports and on the machine.
    """

    structure: StructureMatrices
    rows: ContactRows  # C (P, m, n), F (P, m, m) in m/N, H (P, m, i) and X (P, o, m) of the contacts
    machine: RestRows  # of r forces on supports and on the machine, each array with an axis of P postures in front
    loads: UnitLoads
    hook: HookInputs
    place: PosturePlaces
    columns: Columns  # of the o outputs, of the r forces on supports and on the machine, then of the m contact forces
    gravity: float  # m/s^2
    ground: StandAtRest | None = None  # of a scene whose frame has a ground

    @classmethod
    def from_scene(cls, scene: Scene, system: System, postures: PostureSet) -> PostureMatrices:
        """Return the matrices of a system of reduced or full bodies in the given postures.

        `scene` is made by `with_hook`.  Outputs are the system's probes, springs of supports and displacements of the
        last body's tip, in the system's order; then what `rest_rows` adds; then the forces of contacts.  Terms that
        have no stiffness are left out, and so are terms whose amplitudes are 0 in all postures.
        """
        assert scene.frame is not None and scene.gravity is not None  # as `with_hook` says
        assembly, x = Assembly(system), side_positions(system, postures)
        rows, loads = assembly.contact_rows_over_time(x), UnitLoads.from_scene(scene, system, postures)
        described, last = outputs_of(system), list(system.bodies)[-1]
        shown = [
            k
            for k, output in enumerate(described)
            if output.kind in ("probe", "support") or (output.kind, output.body) == ("tip", last)
        ]
        still = _still_scene(scene, postures)
        machine = [rest_rows(still, assembly, k, x[k], loads.c[:, k]) for k in range(postures.count)]
        outputs = [*(described[k] for k in shown), *machine[0].outputs]
        outputs += [Output(contact.name, contact.kind, contact.inner.body, unit="N") for contact in system.contacts]
        used = [k for k, term in enumerate(assembly.terms) if term.stiffness is not None and np.any(loads.c[:, :, k])]
        terms = [assembly.terms[k].stiffness.toarray() for k in used]
        cylinder, length = scene.frame.cylinder, postures.boom_length(scene)
        return cls(
            structure=StructureMatrices(
                M=assembly.M.toarray(),
                K=assembly.K.toarray(),
                B=assembly.B.toarray(),
                outputs=assembly.outputs.toarray()[shown],
                direct=assembly.direct[shown],
                energy=assembly.energy,
                terms=np.array(terms).reshape(len(used), assembly.size, assembly.size),
                pushes=~np.isnan(system.clearance),
                clearance=np.nan_to_num(system.clearance),
            ),
            rows=replace(rows, X=rows.X[:, shown]),
            machine=RestRows.stack(machine),
            loads=replace(loads, c=loads.c[:, :, used]),
            hook=HookInputs.from_system(system),
            place=PosturePlaces(
                postures.slewing,
                postures.luffing,
                up=_vertical_directions(still, postures),
                hook=np.array(scene.frame.tail_position) + hook_offset(scene) + length[:, None] * np.eye(3)[0],
                arm=np.full(len(length), np.nan) if cylinder is None else cylinder.length_and_arm(postures.luffing).arm,
            ),
            columns=Columns.of_outputs(scene, outputs),
            gravity=scene.gravity.acceleration,
            ground=StandAtRest.in_postures(still, postures),
        )

    @property
    def output_names(self) -> tuple[str, ...]:
        """Names (o + r,) of the outputs, then of the forces on supports and on the machine."""
        return self.columns.names[: len(self.columns.names) - len(self.structure.pushes)]

    @property
    def output_kinds(self) -> tuple[str, ...]:
        """Kinds (o + r,) of the outputs in `output_names`."""
        return self.columns.kinds[: len(self.output_names)]

    @property
    def force_names(self) -> tuple[str, ...]:
        """Names (m,) of the contact forces."""
        return self.columns.names[len(self.output_names) :]

    @property
    def force_kinds(self) -> tuple[str, ...]:
        """Kinds (m,) of the contacts."""
        return self.columns.kinds[len(self.output_names) :]

    def equations(self, k: int, amounts: Mapping[str, float], factor: float = 1.0) -> Equations:
        """Equations of the k-th posture under a fixed load and a load in kg that grows.

        Parameters
        ----------
        k : int
            Number of the posture.
        amounts : mapping of str to float
            Number of units of each component (weight, loads) that act all the time; zero for a component that is not
            named.  An amount of `HOOK` is ignored, and so are other names.
        factor : float
            Factor of the forces of 1 kg of `HOOK`, the load that grows.
        """
        shares = np.array([0.0 if name == HOOK else amounts.get(name, 0.0) for name in self.loads.names])
        acting = np.array([shares, factor * np.array([name == HOOK for name in self.loads.names])])
        f, c = (acting @ of_parts[:, k] for of_parts in (self.loads.f, self.loads.c))
        on, rows, H, hook = self.structure, self.rows.at_time(k), self.rows.H[k], self.hook.numbers
        gap, G = np.where(on.pushes, on.clearance, 0.0), np.tensordot(c, on.terms, 1)
        direct = np.vstack([on.direct, self.machine.loads[k]])
        bent = np.tensordot(acting, self.machine.parts[k], 1)
        return Equations(
            M=on.M,
            K=on.K,
            outputs=np.vstack([on.outputs, self.machine.coordinates[k] + bent[0]]),
            rows=ContactRows(rows.C, rows.F, H[:, hook], np.vstack([rows.X, -self.machine.contacts[k]])),
            fixed=LoadEffects(on.B @ f[0], gap - H @ f[0], direct @ f[0], G[0]),
            growing=LoadEffects(on.B @ f[1], -H @ f[1], direct @ f[1], G[1], bent[1]),
            pushes=on.pushes,
            load_inputs=on.B[:, hook],
            load_flexibility=on.energy[np.ix_(hook, hook)],
            names=self.force_names,
        )

    def hook_force(self, k: int) -> Array:
        """Force (3,) in N that 1 kg of the load exerts on the boom in the k-th posture, in the axes of the boom."""
        force = np.zeros(3)
        for number, axis in zip(self.hook.numbers.tolist(), self.hook.axes, strict=True):
            force["xyz".index(axis)] += self.loads.f[self.loads.names.index(HOOK), k, number]
        return force


def side_positions(system: System, postures: PostureSet) -> Array:
    """Positions x (P, sides) in m of the sides of all contacts in each of P postures.

    A path that is neither an extension in `postures` nor the luffing angle is at 0.
    """
    paths = {name: postures.extensions.get(name, np.zeros(postures.count)) for name in system.paths}
    paths |= {LUFFING: postures.luffing} if LUFFING in system.paths else {}
    x = np.broadcast_to(system.side_coordinates(paths), (postures.count, len(system.sides)))
    return np.ascontiguousarray(x)


def load_names(scene: Scene) -> list[str]:
    """Names of all loads of the scene's sections, each name once.

    In a scene made by `with_hook`, they include the loads that it added, such as `HOOK`.
    """
    return list(dict.fromkeys(load.name for part in scene.sections for load in part.loads))


def _still_scene(scene: Scene, postures: PostureSet, loads: Mapping[str, float] | None = None) -> Scene:
    """Scene at rest in the given postures under its weight and the `loads` in N or N m by name.

    All other loads are zero; None stands for no loads.
    """
    acting = dict.fromkeys(load_names(scene), 0.0) | dict(loads or {})
    return scene_at_rest(scene, postures.extensions, postures.luffing, postures.slewing, acting)


def acceleration_loads(scene: Scene, system: System, postures: PostureSet, angle: str) -> Array:
    """Values (P, i) of the i inputs at P postures by an acceleration of 1 rad/s^2 of an `angle`, luffing or slewing.

    The scene is one that `with_hook` made.
    """
    still, numbers = _still_scene(scene, postures), np.arange(postures.count, dtype=float)
    f = [
        Excitation.from_scene(each).forces(system.input_names, numbers)
        for each in (still, accelerate_angle(still, angle))
    ]
    return np.asarray(f[1] - f[0])


def _vertical_directions(still: Scene, postures: PostureSet) -> Array:
    """Vertical unit vectors (P, 3) in the axes of the boom in P postures, for a scene `still` of `scene_at_rest`."""
    numbers = np.arange(postures.count, dtype=float)
    return FrameRotation.from_signals(*still.present_frame.angles, numbers, still.present_frame.base_angles).up


#: Most points along each section with outputs of the deflection.
PLACES = 9


@dataclass(frozen=True)
class DeflectionOutputs:
    """Outputs that show the deflection of a boom: b displacements across it, at about `PLACES` points of each section.

    Sizes as in `PostureMatrices`.
    """

    outputs: Array  # (b, n)
    direct: Array  # (b, i)
    X: Array  # (P, b, m)
    x: Array  # (b,) m, distance from the section's tail
    section: Indices  # (b,): number of the section; the base is 0
    direction: tuple[str, ...]  # (b,): ``y`` or ``z`` of the boom
    names: tuple[str, ...]  # of the sections

    @classmethod
    def from_system(cls, system: System, postures: PostureSet) -> DeflectionOutputs:
        """Choose outputs across the boom of a system in these postures: up to `PLACES` of each body along each axis."""
        assembly = Assembly(system)
        number, x, section, direction, first = list[int](), list[float](), list[int](), list[str](), 0
        for k, body in enumerate(system.bodies.values()):
            kinds = kinds_of(body)
            for axis in dict.fromkeys(kind[-1] for kind in kinds if kind.split(" ")[0] in ("beam", "tip")):
                numbers = [i for i, kind in enumerate(kinds) if kind in (f"beam {axis}", f"tip {axis}")]
                some = np.unique(np.linspace(0, len(numbers) - 1, min(PLACES, len(numbers))).round().astype(int))
                for i in (numbers[place] for place in some):
                    number.append(first + i)
                    x.append(float(body.output_positions[i]))
                    section.append(k)
                    direction.append(axis)
            first += len(kinds)
        rows = assembly.contact_rows_over_time(side_positions(system, postures))
        outputs, direct = assembly.outputs.toarray()[number], assembly.direct[number]
        return cls(
            outputs, direct, rows.X[:, number], np.array(x), np.array(section), tuple(direction), tuple(system.bodies)
        )

    def replace_outputs(self, postures: PostureMatrices) -> PostureMatrices:
        """`postures` with displacements across the boom as their only outputs; forces on the machine are left out."""
        structure = replace(postures.structure, outputs=self.outputs, direct=self.direct)
        machine = RestRows((), *(rows[..., :0, :] for rows in postures.machine.arrays))
        return replace(postures, structure=structure, rows=replace(postures.rows, X=self.X), machine=machine)
