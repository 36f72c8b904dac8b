"""One simulation of a system of bodies: its start, the loop around the compiled steps, and what comes of them."""

from __future__ import annotations

import time
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pmr.errors import SimulationError
from pmr.scene.simulators import Needs, refuse
from pmr.simulation import balance, contact_step
from pmr.simulation.excitation import Excitation
from pmr.simulation.native import contact as contact_rows
from pmr.simulation.native import multibody_step as kernel
from pmr.simulation.native.arrays import ROW, Z_NEXT, V, Z
from pmr.simulation.native.multibody_arrays import bodies, multibody_state, sides
from pmr.simulation.native.multibody_form import MultibodyForm, multibody_form
from pmr.simulation.native.multibody_levels import Multibody, control, levels
from pmr.simulation.native.multibody_rows import move_sides
from pmr.simulation.native.multibody_step import Drive, Record
from pmr.simulation.native.scheme import GeneralizedAlpha
from pmr.simulation.native.start import NotSettledError, dependence, multipliers_of
from pmr.simulation.start import InitialState, check_position, checked
from pmr.simulation.stepping import Progress
from pmr.system.assembly import Assembly
from pmr.system.body import Trajectory
from pmr.system.system import Body, Joined, System, SystemTrajectory

Array = NDArray[np.float64]

#: Steps between two looks at the clock, the keyboard and the progress, those that are made in parts counted as many.
BLOCK = 4096


class MultibodyMarch:
    """Constants, state, places and loads of one simulation; arguments and errors as `multibody.simulate`."""

    def __init__(self, system: System, excitation: Excitation, initial: Mapping[str, InitialState]) -> None:
        self._system, self._form, stepping = system, multibody_form(system), excitation.stepping
        self._t, self._x, omega = excitation.times, places(system, excitation), 0.0
        parts: tuple[int, ...] = (1,)
        if not np.isnan(system.clearance).all():
            omega = 0.0 if stepping.parts or stepping.schedule else contact_frequency(system, excitation)
            parts = contact_step.levels(omega, stepping)
        given = np.full(stepping.steps, -1)
        if stepping.schedule and len(parts) > 1:
            given = np.searchsorted(parts, stepping.schedule)
        self._finest = parts[-1]
        fine = excitation.with_stepping(stepping.divided(self._finest))
        self._drive = Drive(fine.s, fine.forces(system.input_names), given)
        methods = [GeneralizedAlpha(stepping.divided(count).step, stepping.rho_inf) for count in parts]
        self._levels = levels(self._form, methods, parts)
        self._bodies = bodies(self._form, list(excitation.paths))
        self._state = multibody_state(self._form, self._bodies, methods[0].memory())
        self._sides = sides(self._bodies, len(excitation.paths))
        self._control = control(self._state, contact_step.TOLERANCE, omega)
        self._bodies.B[:], self._bodies.damped[:] = self._levels.B[0], self._levels.damped[0]
        self._state.modes[:Z_NEXT] = self._levels.modes[0]
        self._start(stepping.rho_inf, initial)

    @property
    def form(self) -> MultibodyForm:
        """The bodies in their modes."""
        return self._form

    @property
    def march(self) -> Multibody:
        """What the compiled steps read and change."""
        return Multibody(self._bodies, self._levels, self._state, self._sides, self._control)

    def record(self, T: int) -> Record:
        """Room for T steps."""
        m, r = len(self._system.contacts), self._state.modes.shape[1]
        return Record._make([*(np.zeros((T, width)) for width in (r, r, m, m, m, 2)), np.ones(T, np.int64)])

    def _start(self, rho_inf: float, initial: Mapping[str, InitialState]) -> None:
        state, f, m = self._state, self._drive.f[0], len(self._system.contacts)
        scheme = GeneralizedAlpha(float(self._t[1]), rho_inf).scheme()
        failed = move_sides(self._bodies, scheme, state, self._sides, self._drive.s[0])
        if failed:
            raise SimulationError(f"march failed at t = 0 s: {self.reason(failed)}")
        half = self._sides.half[:, :m]
        C, F = state.modes[ROW : ROW + m].copy(), np.asarray(half + half.T + np.diag(self._system.compliance), float)
        self._check_rigid(np.all(F == 0.0, axis=1), rho_inf)
        z, v = self._stacked(initial)
        names = zip(self._system.contact_names, self._rigid, strict=True)
        check_position(C[self._rigid], z, tuple(name for name, rigid in names if rigid))
        free = self._form.B @ f - self._form.damping @ v - self._form.along("K") * z
        try:
            state.multipliers[:] = multipliers_of(C, F, free, C @ z + self._sides.inputs @ f, state.contact)
        except NotSettledError as error:
            raise SimulationError(f"march failed at t = 0 s: {self.reason(error.number)}") from None
        state.modes[Z], state.modes[V] = z, v
        kernel.account(self._bodies, state, self._sides, f)
        self._sides.energy[1] = 0.0

    def _check_rigid(self, rigid: NDArray[np.bool_], rho_inf: float) -> None:
        """Refuse rigid contacts that only push, or that travel with nothing to damp their forces."""
        self._rigid, contacts = rigid, zip(self._system.contacts, rigid, strict=True)
        pushing = tuple(c.name for c, firm in contacts if firm and c.clearance is not None)
        refuse("march", Needs(rigid_pushing=pushing, rigid_moving=tuple(self._rigid_and_moving), rho_inf=rho_inf))

    @property
    def _rigid_and_moving(self) -> list[str]:
        travelling = {s.contact for s, x in zip(self._system.sides, self._x.T, strict=True) if np.any(x != x[0])}
        return [name for k, name in enumerate(self._system.contact_names) if self._rigid[k] and k in travelling]

    def _stacked(self, initial: Mapping[str, InitialState]) -> tuple[Array, Array]:
        z, v = (np.zeros(self._form.modes[-1]) for _ in range(2))
        for (name, body), form, columns in zip(
            self._system.bodies.items(), self._form.forms, self._form.columns, strict=True
        ):
            if name in initial:
                start = form.start(checked(initial[name], body.size))
                z[columns], v[columns] = start.q, start.v
        return z, v

    def run(self, progress: Progress | None) -> SystemTrajectory:
        """Take all steps."""
        T, record = len(self._t), self.record(len(self._t))
        modes, multipliers = self._state.modes, self._state.multipliers
        start = (modes[Z], modes[V], multipliers, multipliers, 0.0, self._sides.energy, 1)
        for array, values in zip(record, start, strict=True):
            array[0] = values
        self._advance(1, 1, record)  # none: what is compiled or loaded for the first time is not the solver's time
        seconds, block = 0.0, max(1, BLOCK // self._finest)
        for first in range(1, T, block):
            last = min(first + block, T)
            begin = time.perf_counter()
            self._advance(first, last, record)
            seconds += time.perf_counter() - begin
            if progress is not None:
                progress((last - 1) / (T - 1))
        return self._trajectory(record, seconds)

    def _advance(self, first: int, last: int, record: Record) -> None:
        """Take steps `first` to `last`, the latter excluded."""
        rows, reach = slice(first, last), slice((first - 1) * self._finest, (last - 1) * self._finest + 1)
        drive = Drive(self._drive.s[reach], self._drive.f[reach], self._drive.given[first - 1 : last - 1])
        taken, failed = kernel.run(self.march, drive, Record._make(array[rows] for array in record))
        if failed:
            raise SimulationError(f"march failed at {self._where(first + taken)}: {self.reason(failed)}")
        finite = np.isfinite(record.z[rows]).all(axis=1)
        if not finite.all():
            raise SimulationError(f"march failed at {self._where(first + int(np.argmin(finite)))}: not finite")

    def _where(self, step: int) -> str:
        return f"step {step}, t = {self._t[step]:g} s"

    def reason(self, failed: int) -> str:
        """Why a step failed, in words."""
        system = self._system
        if failed == contact_rows.UNSETTLED:
            names = ", ".join(c.name for c in system.contacts if c.clearance is not None)
            return f"which of the contacts {names} are closed was not settled in {contact_rows.LIMIT} solves"
        return dependence(self._state.modes[ROW : ROW + failed], system.contact_names)

    def _trajectory(self, record: Record, seconds: float) -> SystemTrajectory:
        x, f = self._x, self._drive.f[:: self._finest]
        least = balance.round_off(self._form.B.T @ self._form.B, f, float(self._t[1]))
        pushing = not np.isnan(self._system.clearance).all()
        energy, work = record.energy.T
        found = balance.surplus(energy, work, least, since_start=pushing)
        balance.refuse_growth(found, "march", self._rigid_and_moving)
        motions = {}
        for name, form, columns in zip(self._system.bodies, self._form.forms, self._form.columns, strict=True):
            own, forces = x[:, self._system.sides_of(name)], self._system.pressed(name, record.multipliers)
            q, v = record.z[:, columns] @ form.X.T, record.v[:, columns] @ form.X.T
            motions[name] = Trajectory(self._t, q, v, forces, own, seconds, surplus=found)
        peaks = np.where(np.isnan(self._system.clearance), record.multipliers, record.peaks)
        return SystemTrajectory(
            self._t, motions, record.multipliers, peaks, f, energy, work, seconds, found, record.parts,
            record.impulses if pushing else None,
        )  # fmt: skip


def contact_frequency(system: System, excitation: Excitation) -> float:
    """Largest omega in rad/s of the contacts that only push, along the paths; 0 without any, or if a rigid one does."""
    assembly, x = Assembly(system), places(system, excitation)
    pushing, largest = np.flatnonzero(~np.isnan(system.clearance)), 0.0
    if not len(pushing):
        return largest
    inverse = np.linalg.inv(assembly.M.toarray())
    rows = assembly.along(x[np.unique(np.linspace(0, len(x) - 1, contact_step.PLACES).astype(int))])
    for C, F in zip(rows.C[:, pushing], rows.F[:, pushing][:, :, pushing], strict=True):
        largest = max(largest, contact_step.frequency(F, C @ inverse @ C.T))
    return largest


def places(system: Joined[Body], excitation: Excitation) -> Array:
    """X (T, sides) in m of the contacts' places at the steps.

    Raises
    ------
    InputError
        If a path is missing, or takes a place where its row is not defined.
    """
    x = system.coordinates(dict(zip(excitation.paths, excitation.s.T, strict=True)))
    return np.ascontiguousarray(np.broadcast_to(x, (len(excitation.s), len(system.sides))))
