"""A frame with a motion that a user's own loop prescribes step by step: amplitudes of inputs and terms.

A system with a frame that moves has *drivers*, in this order: paths in m; loads as the scene names them, in N, then the
gravity in m/s^2; angles of the frame and of its base in rad; and accelerations of its base in m/s^2 along ground axes.
Each driver has a value, a rate and a second rate; loads and accelerations have a value only.

Also the scene from which a reduced model was made, as far as the model's file stores it: path, loads and time.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pydantic import ConfigDict, TypeAdapter

from pmr.errors import InputError, escape_controls
from pmr.files.arrays import Array
from pmr.kernel.further import ANGLES, AXES, ComputedData
from pmr.scene import Scene
from pmr.scene.built import Gravity
from pmr.scene.checks import MOST_STEPS
from pmr.scene.cylinder import FirstExtension
from pmr.scene.files import stored_scene
from pmr.scene.hoist import ROPE
from pmr.scene.keys import LUFFING, RECORDED, input_name
from pmr.scene.mechanism import frame_terms
from pmr.scene.members import members
from pmr.scene.signals import Constant, Signal, SignalBase
from pmr.simulation.excitation import SLIDER, Excitation
from pmr.simulation.frame import WindOnSection, base_accelerations, load_signals, products_of
from pmr.simulation.frame_motion import Acceleration, Product, Products
from pmr.simulation.stepping import TimeStepping
from pmr.system.contacts import ALONE
from pmr.system.system import System

_SIGNAL: TypeAdapter[Any] = TypeAdapter(Signal, config=ConfigDict(defer_build=True))


@dataclass(frozen=True)
class StoredScene:
    """A scene stored in a model's file: its title, and its excitation with a load for each input of the system."""

    title: str
    excitation: Excitation
    #: (l,) array: loads with which a stepper begins, in the order of `System.load_names`, with the full weight even if
    #: the weight rises in time
    first_loads: Array
    #: scene of a boom, in which a free luffing angle or extension stays where it begins; None for a single body without
    #: a frame
    scene: Scene | None = None
    #: the scene with its free luffing angle or extension; None if nothing is free, or the scene was read without it
    free_scene: Scene | None = None

    @classmethod
    def of_boom(cls, boom: Scene, system: System) -> StoredScene:
        """The scene `boom` as a stored scene, with its loads at t = 0 under the full weight."""
        in_full = Excitation.from_scene(boom.with_keys(gravity=boom.gravity and {"rise": 0.0}))
        return cls(boom.title, Excitation.from_scene(boom), in_full.first_loads(system), boom)

    @property
    def luffs_freely(self) -> bool:
        """Whether the luffing angle is free."""
        return self.free_scene is not None and not self.extends_freely

    @property
    def extends_freely(self) -> bool:
        """Whether an extension is free."""
        return self.free_scene is not None and bool(self.free_scene.free_extensions)

    @property
    def static(self) -> bool:
        """Whether the system starts in equilibrium with the loads; otherwise at rest and undeformed."""
        return self.excitation.start == "equilibrium"


def read_scene(system: System, source: str, free: bool = False) -> StoredScene:
    """Scene that is stored in the provenance of a system.

    A scene with a free luffing angle or extension is accepted only if `free` is true.  The result then holds this angle
    or extension where it begins, and `StoredScene.free_scene` is the scene in which it is free.

    Raises InputError, which names the file `source`, if there is no scene, or if the scene does not fit the system.
    Also if a value is not of the type that its key needs, if a signal is in a file of its own, or if the scene has more
    than `MOST_STEPS` steps.
    """
    try:
        scene = system.provenance["scene"]
        if any(map(_names_a_file, _signal_entries(scene))):
            raise ValueError("a signal in a saved model contains its numbers; it reads no file")
        if ALONE in system.bodies and not (scene.get("frame") or scene.get("hoist")):
            return _read_body_scene(scene, system)
        return _read_boom_scene(scene, system, free)
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
        if isinstance(error, InputError):
            raise InputError(source, f"provenance.scene.{error.key}", error.value, error.allowed) from None
        why = "this one has none" if error.args == ("scene",) else repr(error)
        raise InputError(
            source, "provenance.scene", None, f"a file that contains its scene is allowed: {why}"
        ) from None


def _read_body_scene(scene: Mapping[str, Any], system: System) -> StoredScene:
    """Stored scene of a single body, from the keys of `scene` that files of all versions have.

    Raises KeyError, TypeError or ValueError if a key is missing or has a wrong value.  Raises ValueError unless there
    is one load for each input of the system.
    """
    loads = [_SIGNAL.validate_python(load["signal"]) for load in scene["loads"]]
    weight = Gravity.model_validate(scene["gravity"]) if scene.get("gravity") else None
    if weight is not None:
        loads.append(weight.signal)
    end, step, rho_inf = (float(scene["time"][key]) for key in ("end", "step", "rho_inf"))
    stepping = _check_steps(TimeStepping(end, step, rho_inf))
    slider, start = scene["slider"], scene.get("start", "rest")
    path = Constant(amount=0.0) if slider is None else _SIGNAL.validate_python(slider["path"])
    if len(loads) != len(system.input_names):
        raise ValueError(f"{len(loads)} given, one for each input is allowed: {', '.join(system.input_names)}")
    named = dict(zip(system.input_names, loads, strict=True))
    excitation = Excitation({SLIDER: path}, named, stepping, start=start)
    first_loads = excitation.f[0].copy()
    if weight is not None:
        first_loads[-1] = weight.acceleration
    return StoredScene(escape_controls(str(scene.get("title", "Sliding body"))), excitation, first_loads)


def _read_boom_scene(scene: Any, system: System, free: bool) -> StoredScene:
    """Stored scene of a boom, from the data `scene`; `free` is as for `read_scene`.

    Raises ValueError unless its sections and paths are those of the system.
    """
    boom = stored_scene(scene, "provenance.scene", RECORDED)
    computed = free and boom.computed_key in ("frame.luffing", *boom.extension_keys)
    as_written, boom = boom, hold_at_start(boom) if computed else boom
    _check_steps(TimeStepping(boom.time.end, boom.time.step))
    if set(system.bodies) != set(boom.bodies) or not set(system.paths) <= set(boom.driven_paths):
        raise ValueError(f"sections {', '.join(system.bodies)} and paths {', '.join(system.paths)} are needed")
    return replace(StoredScene.of_boom(boom, system), free_scene=as_written if computed else None)


def hold_at_start(scene: Scene) -> Scene:
    """Scene whose free extensions, or else its luffing angle, stay where they begin.

    If the luffing angle stays, the frame gets a slewing angle of 0 unless it has one.
    """
    frame = scene.present_frame
    if scene.free_extensions:
        sections = list(scene.sections)
        for k, extension in scene.free_extensions.items():
            sections[k] = sections[k].with_keys(joint={"extension": extension.first})
        return scene.with_keys(sections=tuple(sections))
    still = {"luffing": Constant(amount=frame.luffing_start), "slewing": frame.slewing or Constant(amount=0.0)}
    return scene.with_keys(frame=still)


def _check_steps(stepping: TimeStepping) -> TimeStepping:
    """Return the time grid `stepping` itself; raise a ValueError if the grid has more than `MOST_STEPS` steps."""
    if stepping.steps > MOST_STEPS:
        raise ValueError(f"{stepping.steps} steps, at most {MOST_STEPS:,} steps are allowed")
    return stepping


def path_ranges(system: System) -> dict[str, tuple[float, float]]:
    """Smallest and largest coordinate s of each path, by the path's name; in m, but in rad for a luffing angle.

    For a boom of sections, it is the range that the path covers in the scene's time, within the range of the rows.  For
    a single body it is the range of the rows.  It is also the range of the rows if the system has no scene that can be
    read, or a free extension.
    """
    ranges = system.ranges
    try:
        stored = None if ALONE in system.bodies else read_scene(system, "system", free=True)
    except InputError:
        stored = None
    if stored is None or stored.extends_freely:  # it goes wherever the rows allow
        return ranges
    end, paths = stored.excitation.stepping.end, stored.excitation.paths
    ends = {path: signal.bounds(0.0, end) for path, signal in paths.items()}
    return {path: (max(low, ends[path][0]), min(high, ends[path][1])) for path, (low, high) in ranges.items()}


def _signal_entries(scene: Any) -> list[Any]:
    """Entries of a stored scene that may contain signals; an entry that the scene lacks is None.

    These are the frame, the hoist, and joint, slider and loads of each section.  A scene of a single body counts as a
    section itself.
    """
    parts = [part for part in scene.get("sections", [scene]) if isinstance(part, dict)]
    of_parts = (part.get(key) for part in parts for key in ("joint", "slider", "loads"))
    return [scene.get("frame"), scene.get("hoist"), *of_parts]


def _names_a_file(data: object) -> bool:
    """Whether nested data contain a key ``file``."""
    if isinstance(data, dict):
        return "file" in data or any(map(_names_a_file, data.values()))
    return isinstance(data, list) and any(map(_names_a_file, data))


GRAVITY = "gravity"
#: Prefixes of the name of the load that drives a luffing cylinder, or that of an extension: an opening, a force or a
#: length.
DRIVE, EXTENSION_DRIVE = "luffing drive ", "extension drive "
#: Angles that a frame and its base may have.
OF_FRAME, OF_BASE = ANGLES[:2], ANGLES[2:]


@dataclass(frozen=True)
class MovingFrame:
    """A scene with a frame: its drivers, and amplitudes of a system's inputs and terms as sums of products.

    The factors of the products are quantities of the frame's motion, which follow from the drivers.  Sizes: n drivers,
    i inputs, K terms.
    """

    scene: Scene
    paths: tuple[str, ...]
    loads: tuple[str, ...]  # names; gravity, if there is any, is the last one
    angles: tuple[str, ...]  # the angles of `OF_FRAME` and `OF_BASE` that the scene has
    axes: tuple[str, ...]  # `AXES`, or none
    inputs: tuple[Products, ...]  # of the system's i inputs
    terms: tuple[Products, ...]  # of its K terms
    hoist: tuple[Products, ...] = ()  # of what drives its hoist
    computed: ComputedData | None = None  # of a free luffing angle or extension, whose motion is the start's alone

    @classmethod
    def from_system(cls, system: System) -> MovingFrame | None:
        """Frame of the scene in a system's provenance; None without a scene, or if the scene has no frame.

        Raises InputError as `read_scene`, and if the system has an input or a term that the scene does not drive.
        """
        scene = read_scene(system, "system").scene if "scene" in system.provenance else None
        return None if scene is None or scene.frame is None else cls.in_scene(scene, system)

    @classmethod
    def in_scene(cls, scene: Scene, system: System) -> MovingFrame:
        """Frame of a scene, with products for the inputs and terms of a system.

        Raises InputError if the scene does not drive one of these inputs or terms.
        """
        frame = scene.present_frame
        excitation = Excitation.from_scene(scene)
        of_terms = {term.name: input_name(scene.names[term.number], term.component) for term in frame_terms(scene)}
        angles = {"luffing": frame.luffing, "slewing": frame.slewing}
        return cls(
            scene=scene,
            paths=tuple(scene.paths),
            loads=tuple(_scene_loads(scene)),
            angles=(*(name for name in OF_FRAME if angles[name] is not None), *(OF_BASE if frame.base_angles else ())),
            axes=AXES if base_accelerations(scene) else (),
            inputs=_products(system.input_names, excitation.loads, {name: name for name in excitation.loads}),
            terms=_products(system.term_names, excitation.terms, of_terms),
            hoist=_products(tuple(excitation.hoist), excitation.hoist, {name: name for name in excitation.hoist}),
        )

    @cached_property
    def excitation(self) -> Excitation:
        """Excitation of the scene, on its own time grid; errors as `Excitation.from_scene`."""
        return Excitation.from_scene(self.scene)

    @property
    def drivers(self) -> tuple[str, ...]:
        """Names of the n drivers: paths, loads, angles, then axes of the base's accelerations."""
        return (*self.paths, *self.loads, *self.angles, *self.axes)

    @property
    def products(self) -> tuple[Products, ...]:
        """Products of the inputs, then of the terms, then of what drives a hoist."""
        return (*self.inputs, *self.terms, *self.hoist)

    def motions(self, excitation: Excitation, t: ArrayLike) -> Array:
        """Values, rates and second rates (3, n, ...) of the drivers in the scene at the times t (...) in s.

        Second rates of paths are averaged over a step of the `excitation`.  Rates and second rates of loads and
        accelerations are zero, except for the rate of what drives a cylinder.
        """
        at = np.asarray(t, float)
        motions = np.zeros((3, len(self.drivers), *at.shape))
        for k, (name, signal) in enumerate(zip(self.drivers, self.signals, strict=True)):
            motions[0, k] = signal.value(at)
            if name in self.paths:
                second = Acceleration(paths=(signal,), step=excitation.stepping.step)
                motions[1:, k] = signal.rate(at), second.value(at)
            elif name in self.angles:
                motions[1:, k] = signal.rate(at), signal.second_rate(at)
            elif name.startswith((DRIVE, EXTENSION_DRIVE)):
                motions[1, k] = signal.rate(at)
        return motions

    @property
    def start(self) -> Array:
        """Values, rates and second rates (3, n) of the drivers in the scene at t = 0, with the full weight.

        A free luffing angle (`computed`) has the rate with which its motion begins.
        """
        motions, frame = self.motions(self.excitation, 0.0), self.scene.frame
        if self.computed is not None and frame is not None and frame.luffing_rate:
            motions[1, self.drivers.index(LUFFING)] = frame.luffing_rate / frame.radian
        if self.scene.gravity is not None:
            motions[0, self.drivers.index(GRAVITY)] = self.scene.gravity.acceleration
        return motions

    @property
    def signals(self) -> tuple[SignalBase, ...]:
        """Signals of the n drivers in the scene, in the order of `drivers`."""
        frame = self.scene.present_frame
        angles = dict(zip(ANGLES, (*frame.angles, *frame.base_angles), strict=False))
        shaken = dict(zip(AXES, base_accelerations(self.scene), strict=False))
        signals = dict(self.scene.paths) | _scene_loads(self.scene) | angles | shaken
        return tuple(signals[name] for name in self.drivers)

    def drives(self, excitation: Excitation) -> bool:
        """Whether the paths, loads, terms and hoist of an excitation are those of the scene.

        The scene's signals are taken on the time grid of the excitation.  The result is False without a frame, and if a
        part of the frame's motion is computed.
        """
        if self.scene.frame is None or self.scene.computed_key is not None:
            return False
        of_scene = self.excitation
        if excitation.stepping.step != of_scene.stepping.step:
            of_scene = of_scene.on_grid(excitation.stepping)
        parts = ("paths", "loads", "terms", "hoist")
        return all(getattr(of_scene, part) == getattr(excitation, part) for part in parts)


def _products(
    names: tuple[str, ...], signals: Mapping[str, SignalBase], loads: Mapping[str, str]
) -> tuple[Products, ...]:
    """Products of each of the inputs or terms `names`, in this order, from its signal in `signals`.

    A signal that is no `FrameAmplitude` is a load itself; `loads` maps each name to the name of this load.  A signal
    without products gets one product, which is zero.  Raises InputError if a name has no signal.
    """
    products = list[Products]()
    for name in names:
        if name not in signals:
            raise InputError(
                "system", "provenance.scene", name, f"what the scene drives is allowed: {', '.join(signals)}"
            )
        products.append(products_of(signals[name], loads[name]) or (Product(0.0, ()),))
    return tuple(products)


def _scene_loads(scene: Scene) -> dict[str, SignalBase]:
    """Signals by name of all that a scene prescribes as loads, in the axes in which it states them, gravity last.

    The signals are loads of sections, rope and wind of a hoist, what drives cylinders, and gravity.  Wind on a section
    has a signal for each of its inputs.
    """
    signals = dict[str, SignalBase]()
    for name, member in zip(scene.names, members(scene), strict=True):
        as_written = {load.name: load.signal for load in member.part.loads if load.acts != "wind"}
        wind = {key: of for key, of in load_signals(scene, member).items() if isinstance(of, WindOnSection)}
        signals |= {input_name(name, key): of for key, of in (as_written | wind).items()}
    if scene.hoist is not None:
        signals |= {ROPE: scene.hoist.rope_signal, **scene.hoist.wind_signals}
    cylinder = None if scene.frame is None else scene.frame.cylinder
    if cylinder is not None and cylinder.drives:
        signals |= {f"{DRIVE}{name}": signal for name, signal in cylinder.drive_signals.items()}
    for path in scene.paths.values() if len(scene.sections) > 1 else ():
        if isinstance(path, FirstExtension):
            signals |= {f"{EXTENSION_DRIVE}{name}": signal for name, signal in path.drives.items()}
    return signals if scene.gravity is None else signals | {GRAVITY: scene.gravity.signal}
