"""Postures of a boom at rest, all at once: its matrices, and the loads by its weight, by given loads and by a mass.

Also outputs that show the deflection of a boom at rest: displacements of points of its sections, across the boom.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.results.quantities import Columns
from pmr.results.response import Output
from pmr.scene import Scene
from pmr.scene.built import Load
from pmr.scene.choice import motion_directions
from pmr.scene.frame import boom_rotation
from pmr.scene.keys import LUFFING, qualified_name
from pmr.scene.mechanism import drive_rows, rope_shares
from pmr.scene.members import members
from pmr.scene.signals import Constant
from pmr.simulation.at_rest import accelerate_angle, constant_inclination, rest_rows, scene_at_rest
from pmr.simulation.excitation import Excitation
from pmr.simulation.frame_motion import FrameRotation
from pmr.simulation.statics.loaded import Equations
from pmr.system.assembly import Assembly
from pmr.system.body import kinds_of, names_of, units_of
from pmr.system.system import System

Array = NDArray[np.float64]

#: Names of components of the loads: the load of a chart, with the unit 1 kg, and the boom's weight.
HOOK, WEIGHT = "load of the chart", "weight"
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

    def select(self, numbers: NDArray[np.int64]) -> PostureSet:
        """Postures selected by their numbers."""
        extensions = {name: values[numbers] for name, values in self.extensions.items()}
        return PostureSet(extensions, self.luffing[numbers], self.slewing[numbers])

    def boom_length(self, scene: Scene) -> Array:
        """Distance (P,) in m along the boom from the tail of the base section to the tip of the last section."""
        tails = np.sum([np.zeros(self.count), *(self.extensions[name] for name in scene.names[1:])], axis=0)
        return np.asarray(tails + scene.sections[-1].length)

    def ground_positions(self, scene: Scene, distances: Array) -> Array:
        """Positions (P, 3) in m from the pivot, in ground axes X, Y, Z, of an undeformed point of the boom per posture.

        `distances` (P,) in m is the distance of each posture's point from the tail of the base section.
        """
        assert scene.frame is not None
        place = np.array(scene.frame.tail_position) + distances[:, None] * np.eye(3)[0]
        return np.einsum("pij,pj->pi", boom_rotation(self.luffing, self.slewing), place)


def with_hook(scene: Scene) -> Scene:
    """Scene with the load of a chart, `HOOK`, added at the tip: the weight of 1 kg, downwards in ground axes.

    If the last section can bend sideways, `SIDEWAYS`, a load that is always zero, is added too.  The base keeps only
    its constant inclination, and the scene's `recovery` is removed.
    """
    assert scene.frame is not None and scene.gravity is not None  # the caller has checked both
    pull = Constant(amount=-scene.gravity.acceleration)
    hook = Load(name=HOOK, on="tip", direction="z", axes="ground", signal=pull)
    last, loads = scene.sections[-1], [hook]
    if "y" in motion_directions(members(scene)[-1]):
        loads.append(Load(name=SIDEWAYS, on="tip", direction="y", signal=Constant(amount=0.0)))
    parts = (*scene.sections[:-1], last.model_copy(update={"loads": (*last.loads, *loads)}))
    frame = scene.frame.model_copy(update={"base": constant_inclination(scene.frame.base)})
    return scene.model_copy(update={"sections": parts, "frame": frame, "recovery": None})


@dataclass(frozen=True)
class PostureMatrices:
    """Matrices of a system in P postures, and the loads of each component: the weight, then every load by its name.

    Sizes: n coordinates, i inputs, m contacts, o outputs, k terms, w components, d driven sections, r forces on
    supports and on the machine.  A load acts by a unit: 1 N or 1 N m, or the weight of 1 kg of `HOOK`.
    """

    M: Array  # (n, n)
    K: Array  # (n, n)
    B: Array  # (n, i)
    outputs: Array  # (o, n): of the tip, compliant supports and probes
    direct: Array  # (o, i)
    energy: Array  # (i, i)
    terms: Array  # (k, n, n)
    pushes: NDArray[np.bool_]  # (m,)
    clearance: Array  # (m,) m
    hook: NDArray[np.int64]  # numbers of inputs along which the load moves as a mass
    hook_axes: tuple[str, ...]  # axes of the boom along which these inputs act
    C: Array  # (P, m, n)
    F: Array  # (P, m, m) m/N
    H: Array  # (P, m, i)
    X: Array  # (P, o, m)
    f: Array  # (w, P, i): loads by a unit of each component
    c: Array  # (w, P, k): amplitudes of the terms by a unit of each component
    # rows of r forces on supports and on the machine (`pmr.simulation.at_rest`.RestRows): coefficients of
    # coordinates, of contact forces, of loads and, for a unit of each component, again of coordinates
    machine_q: Array  # (P, r, n)
    machine_forces: Array  # (P, r, m)
    machine_loads: Array  # (P, r, i)
    machine_parts: Array  # (w, P, r, n)
    slewing: Array  # (P,) rad
    luffing: Array  # (P,) rad
    up: Array  # (P, 3): the vertical in the axes of the boom
    tip: Array  # (P, 3) m: the undeformed tip from the pivot, in the axes of the boom
    arm: Array  # (P,) m: lever arm about the pivot of the luffing cylinder; NaN where the scene has none
    drives: Array  # (d, o + r + m): coefficients of all columns in the force that drives a section
    drive_names: tuple[str, ...]  # (d,): names of the driven sections
    rope_names: tuple[str, ...]  # driven sections that ropes move, or with followers that ropes move
    parts: tuple[str, ...]  # (w,): names of the components
    gravity: float  # m/s^2
    # (o + r,): names and more of outputs, then of forces on supports and on the machine
    output_names: tuple[str, ...]
    output_kinds: tuple[str, ...]
    output_units: tuple[str, ...]
    output_bodies: tuple[str, ...]
    force_names: tuple[str, ...]  # (m,)
    force_kinds: tuple[str, ...]

    @classmethod
    def from_scene(cls, scene: Scene, system: System, postures: PostureSet) -> PostureMatrices:
        """Matrices of a scene made by `with_hook`, of its system of reduced or full bodies, in these postures."""
        assembly = Assembly(system)
        x = side_positions(system, postures)
        rows, size = assembly.contact_rows_over_time(x), assembly.size
        parts, f, c = unit_loads(scene, system, postures)
        assert scene.frame is not None and scene.gravity is not None  # as `with_hook` says
        shown, outputs = _select_outputs(system)
        still = scene_at_rest(
            scene, postures.extensions, postures.luffing, postures.slewing, dict.fromkeys(_load_names(scene), 0.0)
        )
        machine = [rest_rows(still, assembly, k, x[k], rows.at_time(k), c[:, k]) for k in range(postures.count)]
        outputs = [*outputs, *machine[0].outputs]
        columns = [output.name for output in outputs] + list(system.contact_names)
        drives = drive_rows(scene, columns)
        used = [k for k, term in enumerate(assembly.terms) if term.stiffness is not None and np.any(c[:, :, k])]
        terms = [assembly.terms[k].stiffness.toarray() for k in used]
        clearance = system.clearance
        return cls(
            M=assembly.M.toarray(),
            K=assembly.K.toarray(),
            B=assembly.B.toarray(),
            outputs=assembly.outputs.toarray()[shown],
            direct=assembly.direct[shown],
            energy=assembly.energy,
            terms=np.array(terms).reshape(len(used), size, size),
            pushes=~np.isnan(clearance),
            clearance=np.nan_to_num(clearance),
            hook=(hook := _hook_inputs(system)),
            hook_axes=tuple("y" if SIDEWAYS in (name := system.input_names[k]) else name[-1] for k in hook),
            C=rows.C,
            F=rows.F,
            H=rows.H,
            X=rows.X[:, shown],
            f=f,
            c=c[:, :, used],
            machine_q=np.array([rows_of_place.coordinates for rows_of_place in machine]),
            machine_forces=np.array([rows_of_place.contacts for rows_of_place in machine]),
            machine_loads=np.array([rows_of_place.loads for rows_of_place in machine]),
            machine_parts=np.stack([rows_of_place.parts for rows_of_place in machine], axis=1),
            slewing=postures.slewing,
            luffing=postures.luffing,
            up=_vertical_directions(still, postures),
            tip=np.array(scene.frame.tail_position) + postures.boom_length(scene)[:, None] * np.eye(3)[0],
            arm=_lever_arms(scene, postures),
            drives=np.array([*drives.values()]).reshape(len(drives), len(columns)),
            drive_names=tuple(drives),
            rope_names=tuple(rope_shares(scene)),
            parts=parts,
            gravity=scene.gravity.acceleration,
            output_names=tuple(output.name for output in outputs),
            output_kinds=tuple(output.kind for output in outputs),
            output_units=tuple(output.unit for output in outputs),
            output_bodies=tuple(output.body for output in outputs),
            force_names=system.contact_names,
            force_kinds=tuple(contact.kind for contact in system.contacts),
        )

    @cached_property
    def columns(self) -> Columns:
        """Names, units and kinds of the columns of the outputs, then of the contact forces."""
        bodies = ("",) * len(self.force_names)
        return Columns(
            (*self.output_names, *self.force_names),
            (*self.output_kinds, *self.force_kinds),
            (*self.output_units, *("N",) * len(self.force_names)),
            (*self.output_bodies, *bodies),
            dict(zip(self.drive_names, self.drives, strict=True)),
            self.rope_names,
        )

    def equations(self, k: int, amounts: Mapping[str, float], factor: float = 1.0) -> Equations:
        """Equations of the k-th posture under a fixed load and a load in kg that grows.

        Parameters
        ----------
        k : int
            Number of the posture.
        amounts : mapping of str to float
            Number of units of each component (weight, loads) that act all the time; zero for a component that is not
            named.  An amount of `HOOK` is ignored.
        factor : float
            Factor of the forces of 1 kg of `HOOK`, the load that grows.
        """
        shares = np.array([0.0 if name == HOOK else amounts.get(name, 0.0) for name in self.parts])
        hook = factor * np.array([name == HOOK for name in self.parts])
        f, c = (np.array([shares, hook]) @ loads_of_parts[:, k] for loads_of_parts in (self.f, self.c))
        H, hook_inputs = self.H[k], self.hook
        gap = np.where(self.pushes, self.clearance, 0.0)
        G = np.tensordot(c, self.terms, 1)
        direct = np.vstack([self.direct, self.machine_loads[k]])
        bent = np.tensordot(np.array([shares, hook]), self.machine_parts[:, k], 1)
        return Equations(
            M=self.M,
            K=self.K,
            G=(G[0], G[1]),
            b=(self.B @ f[0], self.B @ f[1]),
            g=(gap - H @ f[0], -H @ f[1]),
            C=self.C[k],
            F=self.F[k],
            outputs=np.vstack([self.outputs, self.machine_q[k] + bent[0]]),
            X=np.vstack([self.X[k], -self.machine_forces[k]]),
            direct=(direct @ f[0], direct @ f[1]),
            pushes=self.pushes,
            load_inputs=(self.B[:, hook_inputs], H[:, hook_inputs], self.energy[np.ix_(hook_inputs, hook_inputs)]),
            outputs_by_load=bent[1],
        )

    def hook_force(self, k: int) -> Array:
        """Force (3,) in N that 1 kg of the load exerts on the boom in the k-th posture, in the axes of the boom."""
        force = np.zeros(3)
        for number, axis in zip(self.hook.tolist(), self.hook_axes, strict=True):
            force["xyz".index(axis)] += self.f[self.parts.index(HOOK), k, number]
        return force


def side_positions(system: System, postures: PostureSet) -> Array:
    """Positions x (P, sides) in m of the sides of all contacts in each posture."""
    paths = {name: postures.extensions.get(name, np.zeros(postures.count)) for name in system.paths}
    paths |= {LUFFING: postures.luffing} if LUFFING in system.paths else {}
    x = system.side_coordinates(paths) if paths else system.side_coordinates({})
    return np.ascontiguousarray(np.broadcast_to(x, (postures.count, len(system.sides))))


def unit_loads(scene: Scene, system: System, postures: PostureSet) -> tuple[tuple[str, ...], Array, Array]:
    """Names of the w components, their loads (w, P, i) on i inputs and amplitudes (w, P, k) of k terms, in P postures.

    The first component is the weight alone; each of the others is a unit of one load alone: 1 N, 1 N m, or the weight
    of 1 kg of `HOOK`.
    """
    assert scene.gravity is not None
    names = _load_names(scene)
    unit = dict.fromkeys(names, 1.0) | {HOOK: -scene.gravity.acceleration}
    numbers, f, c = np.arange(postures.count, dtype=float), list[Array](), list[Array]()
    for one_of in (None, *names):
        loads = {name: unit[name] if name == one_of else 0.0 for name in names}
        still = scene_at_rest(scene, postures.extensions, postures.luffing, postures.slewing, loads)
        driven = Excitation.from_scene(still)
        f.append(driven.forces(system.input_names, numbers))
        c.append(driven.amplitudes(system.term_names, numbers))
    weight = [np.zeros_like(f[0]), *[f[0]] * len(names)], [np.zeros_like(c[0]), *[c[0]] * len(names)]
    found_f, found_c = (np.array(signal) - np.array(zero) for signal, zero in zip((f, c), weight, strict=True))
    return (WEIGHT, *names), found_f, found_c


def _load_names(scene: Scene) -> list[str]:
    """Names of all loads of the scene's sections, each once."""
    return list(dict.fromkeys(load.name for part in scene.sections for load in part.loads))


def acceleration_loads(scene: Scene, system: System, postures: PostureSet, angle: str) -> Array:
    """Loads (P, i) by an acceleration of 1 rad/s^2 of an `angle`, ``luffing`` or ``slewing``, in units of the i inputs.

    The scene is one that `with_hook` made.
    """
    still = scene_at_rest(
        scene, postures.extensions, postures.luffing, postures.slewing, dict.fromkeys(_load_names(scene), 0.0)
    )
    numbers = np.arange(postures.count, dtype=float)
    f = [
        Excitation.from_scene(each).forces(system.input_names, numbers)
        for each in (still, accelerate_angle(still, angle))
    ]
    return np.asarray(f[1] - f[0])


def _lever_arms(scene: Scene, postures: PostureSet) -> Array:
    """Lever arms (P,) in m of the luffing cylinder about the pivot; NaN for a scene without one."""
    assert scene.frame is not None
    cylinder = scene.frame.cylinder
    return np.full(postures.count, np.nan) if cylinder is None else cylinder.length_and_arm(postures.luffing)[1]


def _vertical_directions(still: Scene, postures: PostureSet) -> Array:
    """Vertical unit vectors (P, 3) in the axes of the boom, for a scene made by `scene_at_rest`."""
    assert still.frame is not None
    numbers = np.arange(postures.count, dtype=float)
    return FrameRotation.from_signals(*still.frame.angles, numbers, still.frame.base_angles).up


def _hook_inputs(system: System) -> NDArray[np.int64]:
    """Indices of the inputs along which `HOOK` moves as a mass: the inputs of its weight, and of `SIDEWAYS`."""
    named = {name.rpartition(" ")[2]: k for k, name in enumerate(system.input_names) if HOOK in name}
    across = [k for k, name in enumerate(system.input_names) if SIDEWAYS in name]
    return np.array([*named.values(), *(across if "y" not in named else [])])


def _select_outputs(system: System) -> tuple[list[int], list[Output]]:
    """Indices and descriptions of a chart's outputs: at the last body's tip, of compliant supports, and of probes."""
    numbers, outputs, first = list[int](), list[Output](), 0
    last = list(system.bodies)[-1]
    for name, body in system.bodies.items():
        for k, (kind, output, unit) in enumerate(zip(kinds_of(body), names_of(body), units_of(body), strict=True)):
            what = kind.split(" ")[0]
            if what in ("probe", "support") or (what == "tip" and name == last):
                numbers.append(first + k)
                outputs.append(Output(qualified_name(name, output), what, name, unit=unit))
        first += len(kinds_of(body))
    return numbers, outputs


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
    section: NDArray[np.int64]  # (b,): number of the section; the base is 0
    direction: tuple[str, ...]  # (b,): ``y`` or ``z`` of the boom
    names: tuple[str, ...]  # of the sections

    @classmethod
    def from_system(cls, system: System, postures: PostureSet) -> DeflectionOutputs:
        """Choose outputs across the boom of a system in these postures."""
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
        none = {name: getattr(postures, name)[..., :0, :] for name in ("machine_q", "machine_forces", "machine_loads")}
        return replace(
            postures,
            outputs=self.outputs,
            direct=self.direct,
            X=self.X,
            machine_parts=postures.machine_parts[..., :0, :],
            **none,
        )
