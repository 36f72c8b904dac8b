"""A machine and the boom that it carries as the kernel has them, and what drives both at the steps of a scene."""

from __future__ import annotations

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from pmr.kernel.carried import Machine
from pmr.kernel.frame import AXES
from pmr.scene import Scene
from pmr.scene.frame import DIRECTIONS, INERTIA
from pmr.scene.keys import LUFFING
from pmr.scene.signals import Constant
from pmr.simulation.excitation import Excitation
from pmr.simulation.free_base import FreeBase
from pmr.simulation.moving import MovingFrame
from pmr.simulation.native.form import SystemForm
from pmr.system.assembly import Assembly
from pmr.system.changing_rows import ChangingRows
from pmr.system.system import System

Array = NDArray[np.float64]


def machine_of(scene: Scene, system: System, frame: MovingFrame, excitation: Excitation, modes: Array) -> Machine:
    """Return the machine of a scene below the system on its frame, whose base stands still in the excitation.

    Bodies' coordinates of unit modes are `modes` (n, r').  Errors as for `FreeBase` and `ChangingRows`.
    """
    assembly = Assembly(system)
    free_base = FreeBase(scene, system, assembly)
    paths = dict.fromkeys((*scene.names, *system.paths))
    ChangingRows(assembly, tuple(paths))  # refuses rows that are not on carriers
    boom, t = free_base.boom, excitation.times
    assert scene.frame is not None and scene.frame.machine is not None  # of those who ask
    machine, count = scene.frame.machine, len(boom.sections)
    inputs = np.full((count, 4, 3), -1, np.int32)
    for at, column in free_base.fields.items():
        inputs[at] = column
    pushed = [getattr(of, axis) or Constant(amount=0.0) for of in (machine.force, machine.moment) for axis in "xyz"]
    weight = np.zeros(len(t)) if scene.gravity is None else scene.gravity.signal.value(t)
    shortened = [term.G for term in boom.shortened]
    return Machine(
        axes=np.array([frame.drivers.index(axis) for axis in AXES], np.int32),
        free=np.isin(DIRECTIONS, machine.free).astype(np.int32),
        mass=machine.mass,
        center=np.array(machine.center),
        inertia=np.array(machine.inertia),
        stiffness=np.array([getattr(machine.stiffness, direction) for direction in DIRECTIONS]),
        damping=np.array([getattr(machine.damping, direction) for direction in DIRECTIONS]),
        boom_mass=boom.mass,
        largest_weight=float(np.abs(weight).max()),
        place=boom.place,
        section_inertia=boom.inertia,
        section_paths=np.array([frame.paths.index(n) if n in frame.paths else -1 for n in scene.names], np.int32),
        fields=inputs,
        inertial=np.array([k for k, name in enumerate(system.input_names) if INERTIA in name], np.int32),
        masses=boom.masses,
        first=boom.first,
        loads=boom.loads,
        rotating=modes.T @ boom.rotating @ modes,
        carried=modes.T @ boom.carried @ modes,
        of_shortened=np.array(
            [(term.section, term.over, -1 if term.cylinder is None else term.cylinder) for term in boom.shortened],
            np.int32,
        ).reshape(-1, 3),
        shortened=modes.T @ np.array(shortened).reshape(-1, boom.size, boom.size) @ modes,
        motions=np.ascontiguousarray(np.moveaxis(frame.motions(excitation, t), -1, 0)),
        rates=_path_rates(scene, frame, t),
        given=base_motions(scene, t),
        pushed=np.stack([signal.value(t) for signal in pushed], axis=1),
        weight=weight,
    )


def modes_in_bodies(form: SystemForm, size: int) -> Array:
    """Coordinates of the assembled bodies of unit modes, (n, r')."""
    assembly = Assembly(form.system)
    modes = np.zeros((assembly.size, size))
    blocks = [modal.X[assembly.free[name]] for name, modal in form.forms.items()]
    modes[:, form.used] = scipy.linalg.block_diag(*blocks)
    return modes


def _path_rates(scene: Scene, frame: MovingFrame, t: Array) -> Array:
    """Rates (T, n) of motions that are paths: at a kink the mean of both, which leads to the right place."""
    rates = np.zeros((len(t), len(frame.drivers)))
    before = np.maximum(np.nextafter(t, -np.inf), 0.0)
    for k, name in enumerate(frame.paths):
        rates[:, k] = (scene.paths[name].rate(t) + scene.paths[name].rate(before)) / 2.0
    if scene.holding_cylinder is not None:
        rates[:, frame.drivers.index(LUFFING)] = scene.driven_paths[LUFFING].rate(t)
    return rates


def base_motions(scene: Scene, t: Array) -> Array:
    """Motion (T, 3, 6) at t (T,) s of directions that are held, and of what springs stand on, in m and rad."""
    assert scene.frame is not None  # of a scene with a machine
    still, motions = Constant(amount=0.0), {} if scene.frame.base is None else scene.frame.base.motions
    signals = [motions.get(direction, still) for direction in DIRECTIONS]
    values = np.array([[getattr(signal, of)(t) for signal in signals] for of in ("value", "rate", "second_rate")])
    return np.ascontiguousarray(np.moveaxis(values, -1, 0)) * units(scene)


def units(scene: Scene) -> Array:
    """(6,): m and rad of a unit of each direction."""
    assert scene.frame is not None  # of a scene with a machine
    return np.repeat([1.0, 1.0 if scene.frame.unit == "rad" else np.pi / 180.0], 3)
