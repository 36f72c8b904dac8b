r"""A boom that luffs by itself: its angle is computed with the boom's coordinates, driven by the luffing cylinder.

With the luffing angle :math:`\varphi`, the angular momentum L of the boom about the axis of luffing, the moment
:math:`\mathfrak M` of weight and loads and the length :math:`\ell(\varphi)` of a cylinder that pushes with F,

.. math:: \dot L = \mathfrak M + F\, \frac{d\ell}{d\varphi}

The equations are those of a machine without mass that is free to pitch alone (`pmr.simulation.native.machine`): it yaws
by the slewing angle and pitches by a constant angle, its level, less :math:`\varphi`.  The cylinder's law is in
src/cylinder.c.

For all further computations the computed angle is the prescribed luffing angle of the frame.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from pmr.errors import InputError
from pmr.files.arrays import Array
from pmr.kernel.further import ComputedData
from pmr.kernel.machine import CYLINDER_COLUMNS, LUFFING_REASONS, Fields, cylinder_numbers
from pmr.results.response import LUFFING_ANGLE
from pmr.scene import Scene
from pmr.scene.frame import BaseMotion, InitialDisplacements, InitialRates, Machine
from pmr.scene.keys import LUFFING_CYLINDER
from pmr.scene.signals import Constant
from pmr.simulation.frame_motion import ComputedMotion, MotionSamples, with_computed_motion
from pmr.simulation.free_base import with_all_inertia
from pmr.simulation.moving import DRIVE, GRAVITY, OF_FRAME, MovingFrame, held_at_start, read_scene
from pmr.simulation.native.extension import ExtensionRun, cylinder_record, kernel_cylinder, with_extension_data
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.machine import MachineRun, machine_motion
from pmr.simulation.stepping import TimeStepping
from pmr.system.system import System

PITCH = 4  # of the machine's directions
#: Fields of the kernel's machine by which its motion acts on the boom.
INPUTS = ("fields", "inertial", "loads", "of_shortened", "shortened")
#: Angle in rad about which a boom without a cylinder swings.
HANGING = -np.pi / 2.0


def with_free_motion(scene: Scene, system: System) -> tuple[Scene, System]:
    """Scene with the computed motion of its machine or its luffing angle, and system in which all modes have inertia.

    Both are unchanged if all motion of the frame is prescribed.

    Raises
    ------
    InputError
        If rows of the system are not on carriers, or supports of the base are not known.
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
        frame = scene.frame
        assert frame is not None  # of a scene with a free luffing angle
        begun = float(frame.angles.luffing.value(np.zeros(1))[0])
        hangs = begun if np.cos(begun - HANGING) < 0.0 else HANGING  # above the pivot it falls to one side
        #: luffing angle in rad at which the machine does not pitch
        self.level = hangs if frame.cylinder is None else frame.cylinder.square_angle(begun)
        self._scene, unit = scene, frame.radian
        level = Constant(amount=self.level * unit)
        base: dict[str, Any] = {} if frame.base is None else dict(frame.base.motions)
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
        of_machine = scene.model_copy(update={"frame": frame.model_copy(update=as_machine)})
        t = TimeStepping(scene.time.end, scene.time.step, scene.time.rho_inf).times
        cylinder = None if frame.cylinder is None else kernel_cylinder(frame.cylinder, t)
        super().__init__(of_machine, system, held_at_start(scene), self.level, cylinder, LUFFING_REASONS)

    def with_luffing(self) -> Scene:
        """Take all steps and return the scene with the computed luffing angle as a signal.

        Raises SimulationError as `with_free_motion`.
        """
        track, frame = self.run(), self._scene.frame
        assert frame is not None
        angle = -track.values[:, :, PITCH]
        angle[0] += self.level
        record = {} if frame.cylinder is None else cylinder_record(self.simulation.cylinder, frame.cylinder.oil)
        times, still = track.step * np.arange(angle.shape[1]), np.zeros(angle.shape[1])
        samples = MotionSamples(times, np.ascontiguousarray(angle), still, track.inputs, record)
        unit = frame.radian
        luffing = ComputedMotion(samples=samples, unit=unit)
        computed = {"luffing": luffing, "slewing": frame.slewing or Constant(amount=0.0)}
        return self._scene.model_copy(update={"frame": frame.model_copy(update=computed)})

    def _motions_at(self, place: Array) -> Array:
        motions = self._first.copy()
        angles = [self.frame.drivers.index(angle) for angle in OF_FRAME]
        motions[0, angles] = self.level - place[PITCH], place[PITCH + 1]
        return motions


def stepped_frame(system: System, source: str) -> MovingFrame | None:
    """Frame of a system's scene for steps one by one, in which an angle or extension may be free.

    It is None if the system has no scene, or the scene no frame.  Errors as `MovingFrame.from_system`; an InputError
    that names `source` is also raised for a free angle on a base that moves.  The system needs modes that all have
    inertia.
    """
    stored = read_scene(system, source, free=True) if "scene" in system.provenance else None
    if stored is None or stored.free_scene is None or stored.scene is None:
        return MovingFrame.from_system(system)
    scene, frame = stored.free_scene, stored.free_scene.frame
    assert frame is not None
    if stored.extends_freely:
        return with_extension_data(MovingFrame.in_scene(stored.scene, system), scene, system, SystemForm.of(system))
    if frame.base is not None:
        allowed = "a base at rest is allowed beside a free luffing angle that is stepped"
        raise InputError(source, "provenance.scene.frame.base", None, allowed)
    once = scene.time.model_copy(update={"end": scene.time.step})
    run = LuffingRun(scene.model_copy(update={"time": once}), system)
    outputs = {LUFFING_ANGLE: "rad", f"rate of {LUFFING_ANGLE}": "rad/s"}
    if frame.cylinder is not None:
        shown = list(CYLINDER_COLUMNS.items())[: None if frame.cylinder.oil else 3]
        outputs |= {f"{LUFFING_CYLINDER} {name}": unit for name, unit in shown}
    return replace(run.frame, computed=ComputedData(luffing_arrays(run.machine, run.frame), outputs))


def luffing_arrays(machine: Fields, frame: MovingFrame) -> dict[str, Array]:
    """Arrays of a free luffing angle in the kernel's block (`read_luffing` in src/system.c)."""
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
