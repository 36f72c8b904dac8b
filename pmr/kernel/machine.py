"""Machines that carry the frame of a boom and move by themselves (src/machine.c)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pmr.errors import InputError, SimulationError
from pmr.files.arrays import Array
from pmr.kernel._native import ffi, lib
from pmr.kernel.kernel import pointer, structure
from pmr.kernel.state import State

#: Why step k of a machine, at t in s, fails although the step of its boom succeeds.
REASONS = {
    lib.PMR_LOST: "the machine's motion is not found at step {k}, t = {t:g} s",
    lib.PMR_UPRIGHT: "the machine pitches by 90 degrees at t = {t:g} s, where roll and yaw turn about one axis",
}
#: The reasons where the machine is what a free luffing angle turns.
LUFFING_REASONS = {
    lib.PMR_LOST: "the luffing angle is not found at step {k}, t = {t:g} s: a shorter time.step",
    lib.PMR_UPRIGHT: "foot, lug and pivot of the luffing cylinder come in line at t = {t:g} s; without a cylinder, the "
    "boom has swung by 90 degrees",
}


#: Columns of a luffing cylinder's record, with their units; the force is positive where it pushes, flows and volumes
#: are of oil into the chambers, volumes since the start.
CYLINDER_COLUMNS = {
    "length": "m",
    "speed": "m/s",
    "force": "N",
    "pressure bore": "Pa",
    "pressure rod": "Pa",
    "flow bore": "m^3/s",
    "flow rod": "m^3/s",
    "volume bore": "m^3",
    "volume rod": "m^3",
    "flow supply": "m^3/s",
}


#: Fields of `pmr_machine` or `pmr_actuator` by name; src/pmr_kernel.h has shapes and units.  A machine has all of its
#: fields but the counts, and neither `cylinder` nor `drive` without a cylinder.
Fields = Mapping[str, Any]


def cylinder_numbers(cylinder: Fields) -> Array:
    """Numbers (k,) of a luffing cylinder in the order of the kernel's ``pmr_actuator``, from its field ``foot`` on.

    `cylinder` has the values of the structure's fields by name.
    """
    first = ffi.offsetof("pmr_actuator", "foot")
    return np.frombuffer(ffi.buffer(ffi.new("pmr_actuator *", cylinder))[first:])


class MachineSimulation:
    """Simulation of a machine with its boom over T steps, with arrays of the recorded results.

    `state` is the state of the boom.  An InputError is raised for a boom on a frame without a moving base, for contacts
    that only push, and for settings of several substeps or of energy.
    """

    def __init__(self, state: State, machine: Fields, reasons: Mapping[int, str] = REASONS) -> None:
        """Open a run of a machine on a `state` of its boom, with arrays of zeros for the results of all steps.

        `machine` has the values of the kernel's ``pmr_machine`` by field name.  `reasons` are messages by the kernel's
        error codes.  Raises an `InputError` if the kernel refuses the machine.
        """
        self.state, self._reasons = state, reasons
        steps, inertial = len(machine["motions"]), len(machine["inertial"])
        counts = {"sections": len(machine["masses"]), "shortened_count": len(machine["of_shortened"])}
        self._machine = structure("pmr_machine", dict(machine) | counts | {"inertial_count": inertial})
        out = ffi.new("pmr_machine_run **")
        if lib.pmr_machine_run_open(state.pointer, self._machine, out):
            allowed = "a frame with a base that moves, contacts that hold both ways and steps without parts and energy"
            raise InputError("machine", "boom", None, f"{allowed} are allowed")
        self._run = ffi.gc(out[0], lib.pmr_machine_run_close)
        self.number = 0
        self.motion = np.zeros((steps, 3, 6))  # of each direction: value, rate, second rate
        self.held = np.zeros((steps, 6))  # N, N m: forces that hold the directions that are not free
        self.springs = np.zeros((steps, 6))  # N, N m: forces of springs and dampers
        self.momenta = np.zeros((steps, 6))  # linear momentum; angular momentum about the ground's origin
        self.inertia = np.zeros((steps, inertial))  # values of the inputs by which the frame accelerates the boom
        self.cylinder = np.zeros((steps, len(CYLINDER_COLUMNS)))  # by `CYLINDER_COLUMNS`

    def _record_pointers(self, first: int) -> Any:
        """Pointers to the rows of the recorded arrays from row `first` on."""
        names = ("motion", "held", "springs", "momenta", "inertia", "cylinder")
        return structure("pmr_machine_record", {name: getattr(self, name)[first:] for name in names})

    def holding_forces(self, motion: Array, z: Array, v: Array, a: Array) -> Array:
        """Forces (6,) in N and N m that hold the machine at t = 0, in the directions x, y, z, roll, pitch and yaw.

        The `motion` (3, 6) of the machine has the directions in m and rad, their rates and second rates.  The boom's
        modes have coordinates z, rates v and accelerations a (modes,).  A StepError is raised if compliant contacts
        depend on each other.
        """
        forces, arrays = np.zeros(6), [np.ascontiguousarray(array, float) for array in (motion, z, v, a)]
        failed = lib.pmr_machine_run_holding_forces(self._run, *map(pointer, arrays), pointer(forces))
        self._raise_unless_done(failed, 0)
        return forces

    def load_cylinder(self, place: Array, z: Array) -> None:
        """Set the initial force, or the initial pressures, of the luffing cylinder so that it holds the boom at rest.

        `place` (6,) in m and rad are the machine's six displacements, z (modes,) the coordinates of the boom's modes.
        The oil on the rod's side gets the back pressure; if the piston's side then needed a negative pressure, it gets
        the back pressure instead.  Raises the errors of `holding_forces`.
        """
        arrays = [np.ascontiguousarray(array, float) for array in (place, z)]
        self._raise_unless_done(lib.pmr_machine_run_load_cylinder(self._run, *map(pointer, arrays)), 0)

    def start(self, motion: Array, z: Array, v: Array) -> None:
        """Begin at t = 0 with the machine's `motion` (3, 6), and with coordinates z and rates v (modes,) of the boom.

        The rows of `motion` are values, rates and second rates of the six directions in m and rad; second rates of free
        directions are computed.  The initial state is recorded in row 0 of the results.  Errors are raised as by
        `advance`.
        """
        self.number = 0
        arrays = [np.ascontiguousarray(array, float) for array in (motion, z, v)]
        failed = lib.pmr_machine_run_start(self._run, *map(pointer, arrays), self._record_pointers(0))
        self._raise_unless_done(failed, 0)

    def advance(self, count: int) -> None:
        """Take `count` steps and record each in the row of its number; `number` is then the number of the last step.

        An InputError is raised for more steps than there are motions, and a StepError if a step of the boom fails.  A
        SimulationError is raised if the motion of the machine is not found or if the machine pitches by 90 degrees.
        After an error, machine and boom are at the end of the last whole step.
        """
        taken, first, further = ffi.new("int64_t *"), self.number + 1, len(self.motion) - 1 - self.number
        if not 0 <= count <= further:
            raise InputError("machine", "steps", count, f"0 to {further} are allowed")
        failed = lib.pmr_machine_run_advance(self._run, first, count, self._record_pointers(first), taken)
        self.number += int(taken[0])
        self._raise_unless_done(failed, self.number + 1)

    def _raise_unless_done(self, failed: int, k: int) -> None:
        """Raise a SimulationError for the kernel's error code `failed` of step k, unless the step is done."""
        if failed in self._reasons:
            raise SimulationError(self._reasons[failed].format(k=k, t=k * self.state.settings.step))
        self.state.raise_unless_done(failed, f"step {k}")
