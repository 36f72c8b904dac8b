"""Places at which a boom stands still, all at once: what acts there without a load that is looked for, and by it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.scene import Scene
from pmr.scene.built import Load
from pmr.scene.choice import directions
from pmr.scene.frame import INERTIA, rotation
from pmr.scene.members import members
from pmr.scene.names import ALONE, cylinder_of
from pmr.scene.ropes import rope_shares
from pmr.scene.signals import Constant
from pmr.simulation.at_rest import accelerated, resting
from pmr.simulation.excitation import Excitation, in_order
from pmr.system.assembly import Assembly
from pmr.system.body import kinds_of, names_of
from pmr.system.frame_terms import carried
from pmr.system.loaded import Equations
from pmr.system.system import System

Array = NDArray[np.float64]

#: By the bodies' names: mass in kg, first moment about the tail in kg m.
Weights = Mapping[str, tuple[float, float]]
#: What the load is called that is looked for, by a kg of it; what acts without any load.
HOOK, WEIGHT = "load of the chart", "weight"
#: A load that never acts: modes that no load reaches are left out of a model, and by these a boom may buckle sideways.
SIDEWAYS = "sideways in the chart"


@dataclass(frozen=True)
class Stands:
    """Where a boom stands: extensions (P,) m of its sections by name, angles (P,) rad."""

    extensions: Mapping[str, Array]  # of a body alone where its slider is, if it has been said
    luffing: Array
    slewing: Array

    @classmethod
    def of(cls, at: Mapping[str, Any]) -> Stands:
        """From the lists of a task's arguments: ``extensions`` by name, ``luffing`` and ``slewing``."""
        extensions = {name: np.array(one, float) for name, one in at["extensions"].items()}
        return cls(extensions, np.array(at["luffing"], float), np.array(at["slewing"], float))

    @property
    def count(self) -> int:
        return len(self.luffing)

    def some(self, which: NDArray[np.int64]) -> Stands:
        """Some of them, by their numbers."""
        extensions = {name: one[which] for name, one in self.extensions.items()}
        return Stands(extensions, self.luffing[which], self.slewing[which])

    def reach(self, scene: Scene) -> Array:
        """Along the boom from the base's tail to its tip, (P,) m."""
        tails = np.sum([np.zeros(self.count), *(self.extensions[name] for name in scene.names[1:])], axis=0)
        return np.asarray(tails + scene.sections[-1].length)

    def on_ground(self, scene: Scene, along: Array) -> Array:
        """Places (P,) m along the boom, undeformed, from the pivot: X, Y and Z of the ground, (P, 3) m."""
        assert scene.frame is not None
        place = np.array(scene.frame.place) + along[:, None] * np.eye(3)[0]
        return np.einsum("pij,pj->pi", rotation(self.luffing, self.slewing), place)


def with_hook(scene: Scene) -> Scene:
    """The scene with the load of a chart at its tip, a kg of which pulls down, at rest on a level base."""
    assert scene.frame is not None and scene.gravity is not None  # as whoever makes a chart says
    pull = Constant(amount=-scene.gravity.acceleration)
    hook = Load(name=HOOK, on="tip", direction="z", axes="ground", signal=pull)
    last, loads = scene.sections[-1], [hook]
    if "y" in directions(members(scene)[-1]):
        loads.append(Load(name=SIDEWAYS, on="tip", direction="y", signal=Constant(amount=0.0)))
    parts = (*scene.sections[:-1], last.model_copy(update={"loads": (*last.loads, *loads)}))
    frame = scene.frame.model_copy(update={"base": None})
    return scene.model_copy(update={"sections": parts, "frame": frame, "recovery": None})


def weights_of(full: System) -> Weights:
    """Of bodies that are not reduced, with what is attached to them."""
    found = {}
    for name, body in full.bodies.items():
        along = "x" if INERTIA + "x" in body.input_names else "z"
        found[name] = carried(body, along, along), carried(body, f"{along}x", along)
    return found


@dataclass(frozen=True)
class Postures:
    """Matrices of a system at P places, and what acts there: parts by name, the weight first, a unit of each."""

    M: Array  # (n, n)
    K: Array  # (n, n)
    B: Array  # (n, i)
    outputs: Array  # (o, n): of the tip and of probes
    direct: Array  # (o, i)
    energy: Array  # (i, i)
    terms: Array  # (k, n, n)
    pushes: NDArray[np.bool_]  # (m,)
    clearance: Array  # (m,) m
    hook: NDArray[np.int64]  # numbers of the load's inputs
    C: Array  # (P, m, n)
    F: Array  # (P, m, m)
    H: Array  # (P, m, i)
    X: Array  # (P, o, m)
    f: Array  # (w, P, i): loads of each part
    c: Array  # (w, P, k): amplitudes of the terms of each part
    wrenches: Array  # (w, P, 6): force in N and moment in N m about the pivot, along the ground's axes, of each part
    slewing: Array  # (P,) rad
    luffing: Array  # (P,) rad
    arm: Array  # (P,) m: about the pivot, of the cylinder that raises the boom; NaN where the scene has none
    ropes: Array  # (r, m): shares of the contacts' forces that ropes and cylinders of sections bear that others follow
    rope_names: tuple[str, ...]  # (r,): the sections that they move
    parts: tuple[str, ...]  # (w,)
    output_names: tuple[str, ...]
    output_kinds: tuple[str, ...]
    force_names: tuple[str, ...]
    force_kinds: tuple[str, ...]

    @classmethod
    def of(cls, scene: Scene, system: System, at: Stands, weights: Weights) -> Postures:
        """Of a scene that `with_hook` made, with its bodies, reduced or full."""
        assembly = Assembly(system)
        x = places_of(system, at)
        rows, size = assembly.along(x), assembly.size
        parts, f, c = acting(scene, system, at)
        shown, names, kinds = _shown(system)
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
            hook=np.array([k for k, name in enumerate(system.input_names) if HOOK in name]),
            C=rows.C,
            F=rows.F,
            H=rows.H,
            X=rows.X[:, shown],
            f=f,
            c=c[:, :, used],
            wrenches=np.array([_wrench(scene, weights, at, name) for name in parts]),
            slewing=at.slewing,
            luffing=at.luffing,
            arm=_arms(scene, at),
            ropes=_ropes(scene, system),
            rope_names=tuple(rope_shares(scene)),
            parts=parts,
            output_names=names,
            output_kinds=kinds,
            force_names=system.contact_names,
            force_kinds=tuple(contact.kind for contact in system.contacts),
        )

    def at(self, k: int, amounts: Mapping[str, float], factor: float = 1.0) -> Equations:
        """Of the k-th place, where parts act by so many units each, and a kg of the load `factor` times."""
        shares = np.array([0.0 if name == HOOK else amounts.get(name, 0.0) for name in self.parts])
        hook = factor * np.array([name == HOOK for name in self.parts])
        f, c = (np.array([shares, hook]) @ one[:, k] for one in (self.f, self.c))
        H, own = self.H[k], self.hook
        gap = np.where(self.pushes, self.clearance, 0.0)
        G = np.tensordot(c, self.terms, 1)
        return Equations(
            M=self.M,
            K=self.K,
            G=(G[0], G[1]),
            b=(self.B @ f[0], self.B @ f[1]),
            g=(gap - H @ f[0], -H @ f[1]),
            C=self.C[k],
            F=self.F[k],
            outputs=self.outputs,
            X=self.X[k],
            direct=(self.direct @ f[0], self.direct @ f[1]),
            pushes=self.pushes,
            on=(self.B[:, own], H[:, own], self.energy[np.ix_(own, own)]),
        )


def places_of(system: System, at: Stands) -> Array:
    """Of the sides of all contacts, (P, sides) m."""
    paths = {name: at.extensions.get(name, np.zeros(at.count)) for name in system.paths}
    x = system.coordinates(paths) if paths else system.coordinates({})
    return np.ascontiguousarray(np.broadcast_to(x, (at.count, len(system.sides))))


def acting(scene: Scene, system: System, at: Stands) -> tuple[tuple[str, ...], Array, Array]:
    """Parts, and loads (w, P, i) and amplitudes (w, P, k) of a unit of each: of the weight, and of every load."""
    names = list(dict.fromkeys(load.name for part in scene.sections for load in part.loads))
    assert scene.gravity is not None
    unit = dict.fromkeys(names, 1.0) | {HOOK: -scene.gravity.acceleration}
    numbers, f, c = np.arange(at.count, dtype=float), list[Array](), list[Array]()
    for one_of in (None, *names):
        loads = {name: unit[name] if name == one_of else 0.0 for name in names}
        still = resting(scene, at.extensions, at.luffing, at.slewing, loads)
        driven = Excitation.of(still)
        signals = in_order(driven.loads, system.input_names)
        f.append(np.column_stack([np.empty((at.count, 0)), *(one.value(numbers) for one in signals)]))
        c.append(driven.amplitudes(system.term_names, numbers))
    weight = [np.zeros_like(f[0]), *[f[0]] * len(names)], [np.zeros_like(c[0]), *[c[0]] * len(names)]
    found_f, found_c = (np.array(one) - np.array(own) for one, own in zip((f, c), weight, strict=True))
    return (WEIGHT, *names), found_f, found_c


def turned(scene: Scene, system: System, at: Stands, angle: str) -> Array:
    """Loads (P, i) of a unit of the acceleration of an angle, in N s^2, on a scene that `with_hook` made."""
    names = [load.name for part in scene.sections for load in part.loads]
    still, f = resting(scene, at.extensions, at.luffing, at.slewing, dict.fromkeys(names, 0.0)), list[Array]()
    for one in (still, accelerated(still, angle)):
        signals = in_order(Excitation.of(one).loads, system.input_names)
        f.append(np.column_stack([one_.value(np.arange(at.count, dtype=float)) for one_ in signals]))
    return np.asarray(f[1] - f[0])


def _wrench(scene: Scene, weights: Weights, at: Stands, acting: str) -> Array:
    """Force (P, 3) N of a unit of what acts and its moment (P, 3) N m about the pivot, on the undeformed boom."""
    assert scene.frame is not None and scene.gravity is not None
    found, tail, turned = np.zeros((at.count, 6)), np.zeros(at.count), rotation(at.luffing, at.slewing)
    for name, part in zip(scene.names, scene.sections, strict=True):
        tail = tail + (at.extensions[name] if part.joint is not None else 0.0)
        if acting == WEIGHT:
            mass, moment = weights[name]
            force = np.array([0.0, 0.0, -mass * scene.gravity.acceleration])
            _add(found, at.on_ground(scene, tail + moment / mass), np.tile(force, (at.count, 1)))
        for load in part.loads:
            if load.name == acting:
                along = np.eye(3)["xyz".index(load.direction[-1])]
                force = (-scene.gravity.acceleration if acting == HOOK else 1.0) * along
                force = np.tile(force, (at.count, 1)) if load.axes == "ground" else turned @ force
                if load.direction[0] == "r":
                    found[:, 3:] += force
                else:
                    _add(found, at.on_ground(scene, tail + (part.place(load.on) or 0.0)), force)
    return found


def _add(found: Array, place: Array, force: Array) -> None:
    found[:, :3] += force
    found[:, 3:] += np.cross(place, force)


def _arms(scene: Scene, at: Stands) -> Array:
    assert scene.frame is not None
    cylinder = scene.frame.cylinder
    return np.full(at.count, np.nan) if cylinder is None else cylinder.length(at.luffing)[1]


def _ropes(scene: Scene, system: System) -> Array:
    """Shares (r, m) of the cylinders' forces; where none holds a section along the boom, not a number."""
    found = np.zeros((len(rope_shares(scene)), len(system.contact_names)))
    for row, shares in zip(found, rope_shares(scene).values(), strict=True):
        for name, share in shares.items():
            if (known := cylinder_of(name)) in system.contact_names:
                row[system.contact_names.index(known)] = share
            else:
                row[:] = np.nan
    return found


def _shown(system: System) -> tuple[list[int], tuple[str, ...], tuple[str, ...]]:
    """Numbers, names and kinds of outputs: of the last body's tip, of supports that give way, and of probes."""
    numbers, names, kinds, first = list[int](), list[str](), list[str](), 0
    last = list(system.bodies)[-1]
    for name, body in system.bodies.items():
        for k, (kind, one) in enumerate(zip(kinds_of(body), names_of(body), strict=True)):
            what = kind.split(" ")[0]
            if what in ("probe", "support") or (what == "tip" and name == last):
                numbers.append(first + k)
                names.append(one if name == ALONE else f"{name}: {one}")
                kinds.append(what)
        first += len(kinds_of(body))
    return numbers, tuple(names), tuple(kinds)
