r"""A machine that moves by itself below a boom: its motion is computed together with the boom's, step by step.

With P and L the linear and angular momentum of machine and boom about the ground's origin, along the ground's axes, the
length h of a step, and the mean values over the step of the outer force F and the outer moment,

.. math::
    P_{n+1} = P_n + h \tilde F, \qquad L_{n+1} = L_n + h \tilde{\mathfrak M}

hold to round-off.  So a machine in space, without springs, keeps both momenta while the boom bends and telescopes.  The
machine's velocity is that at which machine and boom have these momenta, given the boom's coordinates
(`pmr.simulation.free_base`); the coordinates follow the kernel's step in the frame that the machine moves.

The kernel takes the steps (`MachineSimulation`, src/machine.c).  For all further computations, the computed motion is
the prescribed motion of a frame (`pmr.simulation.frame_motion`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import scipy.linalg

from pmr.errors import InputError, SimulationError
from pmr.files.arrays import Array
from pmr.kernel._native import ffi, lib
from pmr.kernel.further import AXES
from pmr.kernel.kernel import Kernel, pointer, structure
from pmr.kernel.state import Settings, State, StepError
from pmr.scene import Scene
from pmr.scene.frame import DIRECTIONS, INERTIA, BaseMotion
from pmr.scene.keys import LUFFING
from pmr.scene.rotation import motion_of
from pmr.scene.signals import Constant
from pmr.simulation.excitation import Excitation, side_positions
from pmr.simulation.frame_motion import MachineMotion
from pmr.simulation.free_base import FreeBase
from pmr.simulation.moving import OF_BASE, MovingFrame
from pmr.simulation.native.form import SystemForm, begin, path_text, step_failure
from pmr.system.assembly import Assembly
from pmr.system.changing_rows import ChangingRows
from pmr.system.system import System

#: Why step k of a machine, at t in s, fails although the step of its boom succeeds.
REASONS = {
    lib.PMR_LOST: "the machine's motion is not found at step {k}, t = {t:g} s",
    lib.PMR_UPRIGHT: "the machine pitches by 90 degrees at t = {t:g} s, where roll and yaw turn about one axis",
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


class MachineSimulation:
    """Simulation of a machine with its boom over T steps, with arrays of the recorded results, a row for each step.

    The kernel takes only a boom whose base moves and whose contacts hold both ways; others raise an InputError.
    """

    def __init__(self, state: State, machine: Fields, reasons: Mapping[int, str] = REASONS) -> None:
        """Open a run of a machine on a `state` of its boom, with arrays of zeros for the results of all steps.

        `machine` has the values of the kernel's ``pmr_machine`` by field name.  `reasons` are messages by the kernel's
        error codes, with ``{k}`` and ``{t}`` in place of number and time of the step.

        Raises InputError if the kernel does not take the machine.  The boom has to stand on a base that moves.  Its
        contacts have to hold both ways.  Steps must neither be divided into parts nor record the energy.
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
        """Structure ``pmr_machine_record`` for the kernel, whose pointers lead to row `first` of recorded arrays."""
        names = ("motion", "held", "springs", "momenta", "inertia", "cylinder")
        return structure("pmr_machine_record", {name: getattr(self, name)[first:] for name in names})

    def holding_forces(self, motion: Array, z: Array, v: Array, a: Array) -> Array:
        """Forces (6,) in N and moments in N m that hold the machine at t = 0, in x, y, z, roll, pitch and yaw.

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
        steps, first, further = ffi.new("int64_t *"), self.number + 1, len(self.motion) - 1 - self.number
        if not 0 <= count <= further:
            raise InputError("machine", "steps", count, f"0 to {further} are allowed")
        failed = lib.pmr_machine_run_advance(self._run, first, count, self._record_pointers(first), steps)
        self.number += int(steps[0])
        self._raise_unless_done(failed, self.number + 1)

    def _raise_unless_done(self, failed: int, k: int) -> None:
        """Raise a SimulationError for the kernel's error code `failed` of step k, unless the step is done."""
        if failed in self._reasons:
            raise SimulationError(self._reasons[failed].format(k=k, t=k * self.state.settings.step))
        self.state.raise_unless_done(failed, f"step {k}")


def machine_of(
    scene: Scene, system: System, frame: MovingFrame, excitation: Excitation, modes: Array, level: float | None
) -> dict[str, Any]:
    """Return the fields of the kernel's machine that carries the `system` of a `scene`, without a luffing cylinder.

    `frame` is the frame of the scene, with a base at rest in the `excitation`.  `modes` (n, r') are the bodies' n
    coordinates by the kernel's r' modes.  If a free luffing angle is simulated as a machine that pitches, `level` is
    the luffing angle in rad at a pitch of 0, None otherwise.  Raises the errors of `FreeBase` and `ChangingRows`.
    """
    assembly = Assembly(system)
    free_base = FreeBase(scene, system, assembly)
    paths = dict.fromkeys((*scene.names, *system.paths))
    ChangingRows(assembly, tuple(paths))  # refuses rows that are not on carriers
    boom, t = free_base.boom, excitation.times
    machine, count = scene.present_frame.machine, len(boom.masses)
    assert machine is not None  # of a scene with a machine
    columns = np.full((count, 4, 3), -1, np.int32)
    for at, column in free_base.fields.items():
        columns[at] = column
    pushed = [getattr(of, axis) or Constant(amount=0.0) for of in (machine.force, machine.moment) for axis in "xyz"]
    weight = np.zeros(len(t)) if scene.gravity is None else scene.gravity.signal.value(t)
    shortened = [term.G for term in boom.shortened]
    of_shortened = [
        (term.section, term.over, -1 if term.cylinder is None else term.cylinder) for term in boom.shortened
    ]
    return {
        "axes": [frame.drivers.index(axis) if frame.axes else -1 for axis in AXES],
        "free": np.isin(DIRECTIONS, machine.free).astype(int),
        "luffs": level is not None,
        "level": level or 0.0,
        "mass": machine.mass,
        "center": machine.center,
        "inertia": machine.inertia,
        "stiffness": np.array([getattr(machine.stiffness, direction) for direction in DIRECTIONS]),
        "damping": [getattr(machine.damping, direction) for direction in DIRECTIONS],
        "boom_mass": boom.mass,
        "place": boom.place,
        "section_inertia": boom.inertia.sum(axis=0),
        "section_paths": [frame.paths.index(name) if name in frame.paths else -1 for name in scene.names],
        "masses": boom.masses,
        "first_moments": boom.first,
        "rotating": modes.T @ boom.rotating.transpose(0, 2, 1) @ modes,
        "second_moments": modes.T @ boom.carried @ modes,
        "fields": columns,
        "inertial": np.array([k for k, name in enumerate(system.input_names) if INERTIA in name], np.int32),
        "loads": boom.loads,
        "of_shortened": np.array(of_shortened, np.int32).reshape(-1, 3),
        "shortened": modes.T @ np.array(shortened).reshape(-1, *boom.rotating.shape[1:]) @ modes,
        "motions": np.moveaxis(frame.motions(excitation, t), -1, 0),
        "rates": _path_rates(scene, frame, t),
        "base_motion": base_motions(scene, t),
        "external": np.stack([signal.value(t) for signal in pushed], axis=1),
        "weight": weight,
        "largest_weight": float(np.abs(weight).max()),
    }


def modes_in_bodies(form: SystemForm) -> Array:
    """Coordinates (n, r') of the assembled bodies by the kernel's r' modes; columns of zeros are padding."""
    assembly = Assembly(form.system)
    modes = np.zeros((assembly.size, form.modes))
    blocks = [modal.X[assembly.free_coordinates[name]] for name, modal in form.forms.items()]
    modes[:, form.mode_columns] = scipy.linalg.block_diag(*blocks)
    return modes


def _path_rates(scene: Scene, frame: MovingFrame, t: Array) -> Array:
    """Rates (T, n) of the frame's n drivers at times t (T,) in s, in m/s or rad/s.

    The columns are in the order of `frame.drivers`.  The rate of a path at a kink is the mean of the rates before and
    after.  The luffing angle has its rate if a luffing cylinder holds the boom.  The rates of all other drivers are 0.
    """
    rates = np.zeros((len(t), len(frame.drivers)))
    before = np.maximum(np.nextafter(t, -np.inf), 0.0)
    for k, name in enumerate(frame.paths):
        rates[:, k] = (scene.paths[name].rate(t) + scene.paths[name].rate(before)) / 2.0
    if scene.holding_cylinder is not None:
        rates[:, frame.drivers.index(LUFFING)] = scene.driven_paths[LUFFING].rate(t)
    return rates


def base_motions(scene: Scene, t: Array) -> Array:
    """Prescribed motion of the machine at t (T,) in s: values, rates, second rates (T, 3, 6) in m and rad.

    In a held direction this is the motion of the machine; in any other direction it is the motion of the ground below
    the machine's springs.
    """
    still, base = Constant(amount=0.0), scene.present_frame.base
    motions = {} if base is None else base.motions
    values = np.array([motion_of(motions.get(direction, still), t) for direction in DIRECTIONS])
    return np.ascontiguousarray(values.transpose(2, 1, 0)) * direction_units(scene)


def direction_units(scene: Scene) -> Array:
    """Units (6,) of the six directions in m and rad: 1, or pi / 180 for angles in degrees."""
    return np.repeat([1.0, 1.0 / scene.present_frame.radian], 3)


#: For the equilibrium of a machine on its springs: most steps of Newton's method, increment in m and rad of numerical
#: derivatives, relative change of the position that is round-off.
TRIALS, DIFFERENCE, ROUND_OFF = 30, 1e-4, 1e-12
#: Steps in one call of the kernel, between which the user can interrupt.
BLOCK = 1024


class MachineRun:
    """Simulation of a machine and its boom from the start on, with the kernel's steps.

    A free luffing angle is simulated as a machine that pitches.  `luffing` is then the scene whose luffing angle is
    prescribed.
    """

    def __init__(
        self,
        scene: Scene,
        system: System,
        luffing: Scene | None = None,
        level: float | None = None,
        cylinder: Fields | None = None,
        reasons: Mapping[int, str] = REASONS,
    ) -> None:
        """Prepare the kernel for the boom's `system` and for the machine in the frame of `scene`.

        Three arguments are None except for a free luffing angle, which is simulated as a machine that pitches:
        `luffing`, the scene in which the angle is prescribed; `level`, the luffing angle in rad at which the machine
        does not pitch; and `cylinder`, the kernel's fields of a luffing cylinder.  `reasons` are the messages for the
        kernel's error codes.  Raises InputError if the kernel does not support the system.
        """
        machine = scene.present_frame.machine
        assert machine is not None  # of a scene with a machine
        still = BaseMotion(**dict.fromkeys(DIRECTIONS, Constant(amount=0.0)))
        resting = luffing or scene.with_keys(frame={"base": still, "machine": None})
        if system.hoist:
            system = replace(system, hoist=system.hoist.in_frame(resting))
        self.form = SystemForm.of(system)
        self._excitation = Excitation.from_scene(resting)
        stepping = self._excitation.stepping
        self.form.refuse_unsupported(side_positions(self.form.modal, self._excitation), stepping.rho_inf)
        self.frame = moving = MovingFrame.in_scene(resting, system)
        self._kernel = Kernel.of(system, self.form.forms, moving)
        modes = modes_in_bodies(self.form)
        state = State(self._kernel, Settings(stepping.step, stepping.rho_inf, energy=False))
        #: fields of the kernel's machine
        self.machine = machine_of(scene, system, moving, self._excitation, modes, level) | dict(cylinder or {})
        self._base_motion, self._first = base_motions(scene, np.zeros(1))[0], self.machine["motions"][0].copy()
        self._free, self._sprung = np.isin(DIRECTIONS, machine.free), self.machine["stiffness"] > 0.0
        start = [[getattr(of, axis) for axis in DIRECTIONS] for of in (machine.start, machine.rate)]
        self._stated_start = np.array(start) * direction_units(scene)  # (2, 6): motions in free directions, then rates
        self._inertial = [system.input_names[k] for k in self.machine["inertial"]] if self._free.any() else []
        self.simulation = MachineSimulation(state, self.machine, reasons)
        self._in_balance = scene.start == "equilibrium"

    def run(self) -> MachineMotion:
        """Take all steps and return the motion; a SimulationError names the time at which a step or the start fails."""
        t, simulation, started = self._excitation.times, self.simulation, False
        try:
            self._start()
            started = True
            while simulation.number + 1 < len(t):
                simulation.advance(min(BLOCK, len(t) - 1 - simulation.number))
        except StepError as error:
            k = simulation.number + 1 if started else 0
            s = self._excitation.s[k]
            where = f"step {k}, t = {t[k]:g} s" if k else f"t = 0 s{path_text(tuple(self._excitation.paths), s)}"
            raise step_failure(where, self.form, error, side_positions(self.form.modal, self._excitation)[k]) from None
        return MachineMotion(
            self._excitation.stepping.step,
            np.ascontiguousarray(np.moveaxis(simulation.motion, 0, 1)),
            -(simulation.held + simulation.springs),
            dict(zip(self._inertial, simulation.inertia.T, strict=False)),
            simulation.momenta,
        )

    def _start(self) -> None:
        """Set the initial state of machine and boom.

        If the scene starts in equilibrium, the machine's springs and the boom are in equilibrium with weight and loads.
        Otherwise the machine begins with the motion that the scene states, and the boom undeformed and at rest.  Raises
        the errors of `begin` and of `holding_forces`, and SimulationError if the springs find no equilibrium.
        """
        motion = self._base_motion.copy()
        motion[:2, self._free] += self._stated_start[:, self._free]
        if self._in_balance:
            motion = self._balance_springs(motion)
        z, v = self._begin(motion[0])
        self.simulation.load_cylinder(motion[0], z)
        self.simulation.start(motion, z, v)

    def _begin(self, place: Array) -> Array:
        """Start the boom on a machine at rest at `place` (6,); return coordinates and rates of its modes, (2, modes).

        Errors as `begin`.
        """
        state = self.simulation.state
        begin(self.form, partial(state.start_in_frame, motions=self._motions_at(place)), self._excitation)
        return np.array([state.z, state.v])

    def _motions_at(self, place: Array) -> Array:
        """Motions (3, n) of the frame at t = 0 with the machine at rest at `place` (6,)."""
        motions = self._first.copy()
        motions[0, [self.frame.drivers.index(angle) for angle in OF_BASE]] = place[3:]
        return motions

    def _balance_springs(self, motion: Array) -> Array:
        """Copy of `motion` (3, 6) with free directions on springs moved to where the springs balance weight and loads.

        Raises SimulationError if Newton's method finds no such equilibrium.
        """
        sprung, motion = np.flatnonzero(self._free & self._sprung), motion.copy()
        if not len(sprung):
            return motion
        nothing, place = np.zeros(self._kernel.modes), motion[0].copy()

        def forces_at(at: Array) -> Array:
            """Unbalanced forces (d,) in N or N m in the d directions that have springs.

            The machine is at rest at `at` (d,) in these directions.
            """
            place[sprung] = at
            still = np.vstack([place, np.zeros((2, 6))])
            return self.simulation.holding_forces(still, self._begin(place)[0], nothing, nothing)[sprung]

        at = place[sprung].copy()
        for _ in range(TRIALS):
            now = forces_at(at)
            slope = np.array([(forces_at(at + step) - now) / DIFFERENCE for step in DIFFERENCE * np.eye(len(at))]).T
            change = np.linalg.solve(slope, now)
            at = at - change
            if np.abs(change).max() <= ROUND_OFF * max(1.0, np.abs(at).max()):
                motion[0, sprung] = at
                return motion
        raise SimulationError("no equilibrium of the machine on its springs was found")
