r"""A luffing angle or an extension that moves by itself: it is computed with the boom's motion, driven by its cylinder.

With the luffing angle :math:`\varphi`, the angular momentum L of the boom about the axis of luffing, the moment
:math:`\mathfrak M` of weight and loads and the length :math:`\ell(\varphi)` of a cylinder that pushes with F,

.. math:: \dot L = \mathfrak M + F\, \frac{d\ell}{d\varphi}

The equations are those of a machine without mass that is free to pitch alone (`pmr.simulation.native.machine`): it yaws
by the slewing angle and pitches by a constant angle, its level, less :math:`\varphi`.

With the force :math:`\Lambda_i` that holds section i along the boom, and with r_i = 1 for the section itself and the
ratio to it of each section that follows,

.. math::
    F = \sum_i r_i \Big( \Lambda_i + \lambda^T \big( C_i z + H_i f - \tfrac12 F_i \lambda \big) \Big)

is the force of the cylinder of a free extension, where C_i, H_i and F_i are derivatives of the rows by the place of
section i.  The search within a step is in src/extension.c.  The law of both cylinders is in src/cylinder.c.

For all further computations the computed angle or extension is a prescribed one.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from pmr.errors import InputError
from pmr.files.arrays import Array
from pmr.kernel._native import ffi, lib
from pmr.kernel.further import ComputedData
from pmr.kernel.kernel import Kernel, Signals
from pmr.kernel.state import Record, Settings, State, StepError
from pmr.results.response import LUFFING_ANGLE
from pmr.scene import Scene
from pmr.scene.checks import moved_sections
from pmr.scene.cylinder import FreeExtension, LuffingCylinder, Oil
from pmr.scene.frame import INERTIA, BaseMotion, InitialDisplacements, InitialRates, Machine
from pmr.scene.joints import FrictionLaw
from pmr.scene.keys import LUFFING_CYLINDER, cylinder_name
from pmr.scene.signals import Constant, SignalBase
from pmr.simulation.contact_step import contact_frequency_within, part_counts
from pmr.simulation.excitation import Excitation, side_positions
from pmr.simulation.frame_motion import ComputedMotion, MachineMotion, MotionSamples, with_computed_motion
from pmr.simulation.free_base import with_all_inertia
from pmr.simulation.moving import (
    DRIVE,
    EXTENSION_DRIVE,
    GRAVITY,
    OF_FRAME,
    MovingFrame,
    StoredScene,
    hold_at_start,
    read_scene,
)
from pmr.simulation.native.form import SystemForm, begin, path_text, step_failure
from pmr.simulation.native.machine import CYLINDER_COLUMNS, Fields, MachineRun
from pmr.simulation.stepping import TimeStepping
from pmr.system.contacts import Friction
from pmr.system.system import System

#: Units of a cylinder's columns by name; the power is that of its force and that out of the supply.
CYLINDER_UNITS = CYLINDER_COLUMNS | {"power": "W", "power supply": "W"}
#: Stroke in m that stands for an infinite one.
FAR = 1e9


def cylinder_columns(oil: Oil | None) -> dict[str, str]:
    """Units of a cylinder's columns by name (`CYLINDER_COLUMNS`); without `oil`, of length, speed and force alone."""
    return dict(list(CYLINDER_COLUMNS.items())[: None if oil else 3])


def kernel_cylinder(cylinder: LuffingCylinder | FreeExtension, t: Array) -> dict[str, Any]:
    """Return the fields ``cylinder`` and ``drive`` of the kernel's machine, with the drive at times t (T,) in s.

    If the scene states no stroke, the stroke is infinite.  An extension without a drive is driven by a force of 0.
    """
    kind, oil = (cylinder.drives or ("force",))[0], cylinder.oil
    fields: dict[str, Any] = {
        "kind": {"force": lib.PMR_CYLINDER_FORCE, "length": lib.PMR_CYLINDER_LENGTH, "oil": lib.PMR_CYLINDER_OIL}[kind],
        "spring": cylinder.spring or 0.0,
        "damping": cylinder.damping,
        "stroke": np.minimum(cylinder.stroke or (0.0, np.inf), FAR).tolist(),
        "stop_stiffness": cylinder.stop_stiffness,
        "stop_damping": cylinder.stop_damping,
    }
    if isinstance(cylinder, LuffingCylinder):
        fields |= {"foot": cylinder.foot, "lug": cylinder.lug, "friction": FrictionLaw().constants}
    else:
        fields["friction"] = FrictionLaw(
            friction=cylinder.dry_friction,
            static_friction=cylinder.dry_friction_at_rest,
            stribeck_speed=cylinder.stribeck_speed,
        ).constants
        fields["shear_stiffness"] = cylinder.shear_stiffness
    if oil is not None:
        keys = ("areas", "bulk_modulus", "leakage", "supply", "tank", "back_pressure")
        fields |= {key: getattr(oil, key) for key in keys}
        fields["volumes"] = [dead + hose for dead, hose in zip(oil.dead_volumes, oil.hose_volumes, strict=True)]
        if oil.valve is not None:
            fields |= {key: getattr(oil.valve, key) for key in ("gain", "dead_band", "laminar")}
        if (valve := oil.counterbalance) is not None:
            fields |= {key: getattr(valve, key) for key in ("setting", "ratio", "range")}
            fields["counterbalance"] = valve.gain
    drive: SignalBase | None = next(iter(cylinder.drive_signals.values()), None)
    opening = np.zeros((len(t), 2)) if drive is None else np.column_stack([drive.value(t), drive.rate(t)])
    return {"cylinder": fields, "drive": opening}


#: Names of columns beside those of the cylinder: the extension's second rate, and by how much a stop gives way, above 0
#: at the greatest extension.
ACCELERATION, STOP = "acceleration", "stop"


def with_extension_data(frame: MovingFrame, scene: Scene, system: System, form: SystemForm) -> MovingFrame:
    """Frame whose free extension the kernel computes.

    `scene` has the free extension, and `frame` is the frame in which the extension stays at its start.
    """
    (number, extension), *_ = scene.free_extensions.items()
    contacts, rubbing = form.modal.contact_names, Friction.from_contacts(system.contacts)
    joints = () if rubbing is None else rubbing.joints
    numbers, paths = list[int](), form.modal.paths
    followers = {scene.names[k]: ratio for k, ratio in moved_sections(scene, number).items()}
    for name in followers:
        joint = joints.index(name) if name in joints else -1
        numbers += [frame.drivers.index(name), paths.index(name), contacts.index(cylinder_name(name)), joint]
    drive = next((k for k, name in enumerate(frame.drivers) if name.startswith(EXTENSION_DRIVE)), -1)
    cylinder = kernel_cylinder(extension, np.zeros(0))["cylinder"]
    arrays = {
        "extension_integers": np.array([drive, cylinder["kind"], len(followers), *numbers]),
        "extension_numbers": np.array([*extension.reach, *cylinder_numbers(cylinder), *sum(followers.values(), ())]),
    }
    columns = cylinder_columns(extension.oil) | {ACCELERATION: "m/s^2"}
    outputs = {column_name(scene.names[number], of): unit for of, unit in columns.items()}
    return replace(frame, computed=ComputedData(arrays, outputs, followers))


def column_name(section: str, of: str) -> str:
    """Name of a column of the free extension of a `section`.

    `of` says what the column holds: a key of `CYLINDER_UNITS`, `ACCELERATION` or `STOP`.
    """
    motion = {"length": "extension", "speed": "rate of extension", ACCELERATION: "second rate of extension"}
    return f"{motion[of]} of {section}" if of in motion else f"extension cylinder of {section} {of}"


class ExtensionRun:
    """Simulation of a boom with a free extension, by the kernel's steps."""

    def __init__(self, scene: Scene, system: System) -> None:
        """Prepare the kernel for the `system` of a `scene` with one free extension, at its start.

        Raises InputError if the kernel does not support the system.
        """
        self._scene, first = scene, hold_at_start(scene)
        ((self._number, self._extension),) = scene.free_extensions.items()
        self._excitation, self.form, self._system = Excitation.from_scene(first), SystemForm.of(system), system
        stepping, modal = self._excitation.stepping, self.form.modal
        x = side_positions(modal, self._excitation)
        self._x = x[0]
        self.form.refuse_unsupported(np.vstack([x[:1], self._reached(modal)]), stepping.rho_inf)
        self.frame = with_extension_data(MovingFrame.in_scene(first, system), scene, system, self.form)
        kernel = Kernel.of(system, self.form.forms, self.frame)
        omega = contact_frequency_within(modal, system.ranges)
        self._parts = part_counts(omega, stepping)
        self.state = State(kernel, Settings(stepping.step, stepping.rho_inf, self._parts, omega, energy=False))

    def _reached(self, modal: System) -> Array:
        """Positions (2, sides) in m of the contacts' sides of `modal` at both ends of what the extension can reach."""
        low, high = self._extension.reach
        paths = {name: np.full(2, at) for name, at in zip(self._excitation.paths, self._excitation.s[0], strict=True)}
        for k, (ratio, offset) in moved_sections(self._scene, self._number).items():
            paths[self._scene.names[k]] = ratio * np.array([low, high]) + offset
        return np.asarray(modal.side_coordinates(paths))

    def with_extension(self) -> Scene:
        """Take all steps and return the scene with the computed extension as a signal.

        Raises InputError if nothing holds the boom at the start, and SimulationError if a step fails or the extension
        leaves its stroke by more than the travel of its stops.
        """
        state, kernel, t = self.state, self.state.kernel, self._excitation.times
        name, inputs = self._scene.names[self._number], self._system.input_names
        columns = np.zeros((len(t), kernel.computed))
        record, signals = Record(kernel, 1, (), self._parts[-1]), Signals(self.frame.signals)
        ends, times, parts = list[Array](), list[Array](), list[int]()

        for k in range(len(t)):
            try:
                if k:
                    state.advance(signals, 1, record)
                else:
                    begin(self.form, partial(state.start_in_frame, motions=self.frame.start), self._excitation)
            except StepError as error:
                where = f"step {k}, t = {t[k]:g} s" if k else "t = 0 s"
                at = path_text((name,), columns[max(k - 1, 0), :1])
                raise step_failure(f"{where}{at}", self.form, error, self._x) from None
            columns[k] = state.computed
            if k == 0:
                record.ends[0] = np.concatenate([columns[0, [0, 1, -1]], state.drivers])
            parts.append(state.parts)
            ends.append(record.ends[: state.parts].copy())
            times.append(t[k] + (np.arange(state.parts) + 1 - state.parts) * (t[1] / state.parts))
        values, drivers = np.split(np.concatenate(ends).T, [3])
        of_inputs = {of: drivers[kernel.paths + k] for k, of in enumerate(inputs) if INERTIA in of}
        divided = tuple(parts[1:]) if max(parts) > 1 else ()
        none = np.zeros(drivers.shape[1])
        oil = self._extension.oil
        own = cylinder_record(columns[:, :-1], oil) | {ACCELERATION: columns[:, -1]}
        own[STOP] = own["length"] - np.clip(own["length"], *self._extension.stroke)
        samples = MotionSamples(np.concatenate(times), values, none, of_inputs, own, divided, oil)
        sections, extension = list(self._scene.sections), ComputedMotion(samples=samples, unit=1.0)
        sections[self._number] = sections[self._number].with_keys(joint={"extension": extension})
        return self._scene.with_keys(sections=tuple(sections))


def cylinder_record(columns: Array, oil: Oil | None) -> dict[str, Array]:
    """Columns (T,) of a cylinder by the names in `CYLINDER_UNITS`, those of oil only if `oil` drives the cylinder.

    The argument `columns` (T, c) has c columns in the order of `CYLINDER_COLUMNS`; `oil` is None for a cylinder without
    oil.
    """
    record = dict(zip(cylinder_columns(oil), columns.T, strict=False))
    record["power"] = record["force"] * record["speed"]
    return record if oil is None else record | {"power supply": oil.supply * record["flow supply"]}


PITCH = 4  # of the machine's directions
#: Fields of the kernel's machine by which its motion acts on the boom.
INPUTS = ("fields", "inertial", "loads", "of_shortened", "shortened")
#: Angle in rad about which a boom without a cylinder swings.
HANGING = -np.pi / 2.0


def with_free_motion(scene: Scene, system: System) -> tuple[Scene, System]:
    """Compute the motion of a free machine, luffing angle or extension; return the scene with it, and the system.

    In the returned scene this motion is a prescribed one.  With a machine or a free luffing angle, all modes of the
    returned system have inertia.  Otherwise the system is unchanged, and so is the scene if all motion is prescribed.

    Raises
    ------
    InputError
        If rows of the system are not on carriers, if a section is planar, or if points of a section are clamped.
    SimulationError
        If a step fails, if a machine pitches until it stands upright, or if the luffing cylinder comes to a dead point
        or has no equilibrium at the start.
    """
    if scene.frame is None or scene.computed_key is None:
        return scene, system
    if scene.free_extensions:
        return ExtensionRun(scene, system).with_extension(), system
    system = with_all_inertia(system)
    if scene.frame.machine is not None:
        return with_computed_motion(scene, machine_motion(scene, system)), system
    return LuffingRun(scene, system).with_luffing(), system


class LuffingRun(MachineRun):
    """Simulation of a boom that luffs by itself."""

    def __init__(self, scene: Scene, system: System) -> None:
        """Prepare the kernel for the `system` of a `scene` with a free luffing angle, at its start."""
        frame = scene.present_frame
        first = float(frame.angles.luffing.value(np.zeros(1))[0])
        hanging = first if np.cos(first - HANGING) < 0.0 else HANGING  # above the pivot it falls to one side
        #: luffing angle in rad at which the machine does not pitch
        self.level = hanging if frame.cylinder is None else frame.cylinder.square_angle(first)
        self._scene, unit = scene, frame.radian
        level = Constant(amount=self.level * unit)
        motions = {} if frame.base is None else frame.base.motions  # its angles turn the ground of what pitches
        base: dict[str, Any] = {axis: motions[axis] for axis in ("x", "y", "z") if axis in motions}
        machine = Machine.model_construct(
            mass=0.0,
            free=("ry",),
            start=InitialDisplacements(ry=self.level * unit - frame.luffing_start),
            rate=InitialRates(ry=-frame.luffing_rate),
        )
        as_machine = {
            "luffing": level,
            "slewing": None,
            "base": BaseMotion.model_construct(**base, rz=frame.slewing or Constant(amount=0.0)),
            "machine": machine,
        }
        of_machine = scene.with_keys(frame=as_machine)
        t = TimeStepping(scene.time.end, scene.time.step, scene.time.rho_inf).times
        cylinder = None if frame.cylinder is None else kernel_cylinder(frame.cylinder, t)
        super().__init__(of_machine, system, hold_at_start(scene), self.level, cylinder, LUFFING_REASONS)

    def with_luffing(self) -> Scene:
        """Take all steps and return the scene with the computed luffing angle as a signal.

        Raises SimulationError as `with_free_motion`.
        """
        track, frame = self.run(), self._scene.present_frame
        angle = -track.values[:, :, PITCH]
        angle[0] += self.level
        record = {} if frame.cylinder is None else cylinder_record(self.simulation.cylinder, frame.cylinder.oil)
        times, still = track.step * np.arange(angle.shape[1]), np.zeros(angle.shape[1])
        samples = MotionSamples(times, np.ascontiguousarray(angle), still, track.inputs, record)
        luffing = ComputedMotion(samples=samples, unit=frame.radian)
        return self._scene.with_keys(frame={"luffing": luffing, "slewing": frame.slewing or Constant(amount=0.0)})

    def _motions_at(self, place: Array) -> Array:
        """Motions (3, n) of the frame at t = 0 with the boom at rest.

        The luffing and the slewing angle follow from pitch and yaw in `place` (6,), the displacements of the machine
        that stands for the boom.
        """
        motions = self._first.copy()
        angles = [self.frame.drivers.index(angle) for angle in OF_FRAME]
        motions[0, angles] = self.level - place[PITCH], place[PITCH + 1]
        return motions


def prepare_stepping(system: System, source: str) -> tuple[System, StoredScene | None, MovingFrame | None]:
    """Prepare a system for steps one by one; return it with its scene and the frame that moves it.

    If the system has no scene, both are None; if the scene has no frame, only the frame is None.  A luffing angle or an
    extension of the scene may be free.  With a free luffing angle, all modes of the returned system have inertia.
    Raises the errors of `MovingFrame.from_system`.  An InputError that names `source` is also raised for a free angle
    on a base that is displaced, and for a system with terms whose scene has no frame.
    """
    stored = read_scene(system, source, free=True) if "scene" in system.provenance else None
    if stored is not None and stored.luffs_freely:
        system = with_all_inertia(system)
    frame = _stepped_frame(system, stored, source)
    return system if frame else system.ensure_without_terms(source), stored, frame


def _stepped_frame(system: System, stored: StoredScene | None, source: str) -> MovingFrame | None:
    """Frame of a `stored` scene of a `system`, which may have a free motion; None without a scene or a frame.

    `source` is named in errors.
    """
    if stored is None or stored.free_scene is None or stored.scene is None:
        return MovingFrame.from_system(system)
    scene, frame = stored.free_scene, stored.free_scene.present_frame
    if stored.extends_freely:
        return with_extension_data(MovingFrame.in_scene(stored.scene, system), scene, system, SystemForm.of(system))
    if frame.base is not None and {"x", "y", "z"} & set(frame.base.motions):
        allowed = "rx, ry and rz alone are allowed where a free luffing angle is stepped, as its pivot has to rest"
        raise InputError(source, "provenance.scene.frame.base", None, allowed)
    run = LuffingRun(scene.with_keys(time={"end": scene.time.step}), system)
    outputs = {LUFFING_ANGLE: "rad", f"rate of {LUFFING_ANGLE}": "rad/s"}
    if frame.cylinder is not None:
        columns = cylinder_columns(frame.cylinder.oil)
        outputs |= {f"{LUFFING_CYLINDER} {name}": unit for name, unit in columns.items()}
    return replace(run.frame, computed=ComputedData(luffing_arrays(run.machine, run.frame), outputs))


def luffing_arrays(machine: Fields, frame: MovingFrame) -> dict[str, Array]:
    """Arrays of a free luffing angle for the kernel, by the names that `read_luffing` in src/system.c reads.

    The names begin with ``luffing_``.  The boom in the `frame` luffs as a machine that pitches, and `machine` has the
    fields of this machine for the kernel.
    """
    cylinder = machine.get("cylinder", {})
    drive = next((k for k, name in enumerate(frame.loads) if name.startswith(DRIVE)), None)
    at = [len(frame.paths) + frame.loads.index(GRAVITY) if GRAVITY in frame.loads else -1]
    at.append(-1 if drive is None else len(frame.paths) + drive)
    sizes = [len(machine[name]) for name in ("masses", "of_shortened", "inertial")]
    numbers = [machine[name] for name in ("level", "boom_mass", "place", "section_inertia")]
    names = ("section_paths", "masses", "first_moments", "rotating", "second_moments")
    arrays = {name: np.ravel(machine[name]) for name in (*names, *INPUTS)}
    arrays["integers"] = np.array([*sizes, *machine["axes"], *at, cylinder.get("kind", 0)])
    arrays["numbers"] = np.concatenate([*map(np.ravel, numbers), cylinder_numbers(cylinder)])
    return {f"luffing_{name}": array for name, array in arrays.items()}


#: Why step k, at t in s, fails if the machine stands for a free luffing angle.
LUFFING_REASONS = {
    lib.PMR_LOST: "the luffing angle is not found at step {k}, t = {t:g} s: a shorter time.step",
    lib.PMR_UPRIGHT: "foot, lug and pivot of the luffing cylinder come in line at t = {t:g} s; without a cylinder, the "
    "boom has swung by 90 degrees",
}


def cylinder_numbers(cylinder: Fields) -> Array:
    """Numbers (k,) of a cylinder: fields of the kernel's structure ``pmr_actuator``, from ``foot`` to the last.

    `cylinder` has values of these fields by name; fields that are missing are zero.
    """
    first = ffi.offsetof("pmr_actuator", "foot")
    return np.frombuffer(ffi.buffer(ffi.new("pmr_actuator *", cylinder))[first:])


def machine_motion(scene: Scene, system: System) -> MachineMotion:
    """Compute the motion of the machine of a scene, with the boom.

    Raises
    ------
    InputError
        If rows of the system are not on carriers, if a section is planar, or if points of a section are clamped.
    SimulationError
        If a step fails, or the machine pitches until it stands upright.
    """
    return MachineRun(scene, with_all_inertia(system)).run()
