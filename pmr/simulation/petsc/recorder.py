"""Records of a full-order simulation: outputs, forces and energies at all steps, and whole states at a few times.

Each rank stores its contributions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.sparse as sp

from pmr.errors import InputError
from pmr.fem.compat import PETSc
from pmr.fem.distributed import local_csr, without_zeros
from pmr.files.arrays import Array
from pmr.fullmodel.model import FullSystem
from pmr.results import Energy
from pmr.simulation.petsc.rows import PathRows
from pmr.simulation.petsc.start import SampledExcitation, State, Terms
from pmr.simulation.stepping import TimeStepping, energy_round_off, energy_surplus, row_products
from pmr.system.contacts import Friction
from pmr.system.states import ContactHistory


@dataclass(frozen=True)
class States:
    """Whole states of a body at t (S,) in s: this rank's rows of q and v (S, n_local), path coordinates s (S, P)."""

    t: Array
    s: Array
    q: Array
    v: Array


@dataclass(frozen=True)
class SolutionErrors:
    """Amounts by which a full-order simulation violates its own equations.

    Attributes
    ----------
    position : (T,) array, m
        Largest violation of a row, max |C q - lambda / k|; for a row that only pushes, beyond its clearance.
    velocity : (T,) array, m/s
        Largest violation of a rigid row's time derivative, max |C v + s' C' q|; NaN if any row gives way.
    surplus : float
        Share of the largest energy that neither loads nor moving rows put in (`pmr.simulation.stepping`).
    """

    position: Array
    velocity: Array
    surplus: float


@dataclass(frozen=True)
class WallTimes:
    """Wall times in s of the steps, and of the preparation before the first step.

    Steps before an interruption are included.  The preparation consists of the factorisation and the compliance of the
    path.
    """

    steps: float
    preparation: float


@dataclass(frozen=True)
class History:
    """Outputs of a full-order simulation; the same on every rank, except `states`.

    Attributes
    ----------
    t : (T,) array, s
    s : (T, P) array, m
        Path coordinates, in the order of the excitation.
    y : mapping of str to (T, o) array
        Outputs of each body.
    contacts : ContactHistory
    supports : (T, h) array, N
        Multipliers of the supports that hold one coordinate, one body after the other (`FullSystem.with_supports`).
    errors : SolutionErrors
    energy : Energy
        Energies, with the pads' strain energy.
    states : mapping of str to States
        Whole states of each body.
    seconds : WallTimes
    """

    t: Array
    s: Array
    y: Mapping[str, Array]
    contacts: ContactHistory
    supports: Array
    errors: SolutionErrors
    energy: Energy
    states: Mapping[str, States]
    seconds: WallTimes


class Recorder:
    """Records a full-order simulation: this rank's contributions to sums over coordinates, added up at the end.

    This rank's contribution to the work is added up at every step, or at every part of a step.  Whole states are
    recorded at the steps nearest to the times `states` in s.  Raises InputError if one of these times is not in the
    run.
    """

    def __init__(self, system: FullSystem, stepping: TimeStepping, states: Sequence[float]) -> None:
        """Make empty records for all steps of `stepping`, and for whole states at the times `states` in s."""
        times = np.asarray(states, float).reshape(-1)
        if np.any(~((times >= 0.0) & (times <= stepping.end * (1.0 + 1e-12)))):
            raise InputError("recording", "states", list(times), f"0 to {stepping.end:g} s are allowed")
        self._system = system
        self.state_steps = np.unique(np.rint(times / stepping.step).astype(np.int64))
        outputs, inputs = ([local_csr(getattr(model, of)).T for model in system.models] for of in ("outputs", "B"))
        self._outputs: sp.csr_matrix = sp.block_diag(outputs, format="csr")
        self._inputs: sp.csr_matrix = sp.block_diag(inputs, format="csr")
        self._M = [model.M for model in system.models]
        self._K = [without_zeros(model.K.copy()) for model in system.models]  # of the plane walls of a shell half
        self._vectors = [model.K.createVecs() for model in system.models]
        T, m = stepping.steps + 1, len(system.contacts)
        self.multipliers, self.peaks = np.zeros((T, m)), np.zeros((T, m))
        friction = Friction.from_contacts(system.contacts)
        self.friction, self._friction = np.zeros((T, 0 if friction is None else len(friction.pads))), friction
        self._pushes, self._peak = bool(np.any(~np.isnan(system.clearance))), np.full(m, -np.inf)
        self._ends = np.cumsum([system.output_slices[-1].stop, m, m])
        self.sums = np.zeros((T, self._ends[-1] + 4))
        self._now: _StepWork | None = None
        self._work, self._terms = 0.0, Terms(system)
        n = system.local_slices[-1].stop
        self.q, self.v = np.zeros((len(self.state_steps), n)), np.zeros((len(self.state_steps), n))

    def follow(self, state: State, rows: PathRows, x: Array, f: Array, c: Array) -> None:
        """Update peaks and work by the `state` after a step, or after a part of a step.

        `rows` are the contact rows at the end of this step.  There the sides of contacts are at x (sides,) in m, the
        loads are f (i,), and the K terms have the amplitudes c (K,).
        """
        if self._pushes:
            self._peak = np.maximum(self._peak, state.multipliers)
        pressed = state.multipliers[rows.course.contact]
        now = _StepWork(f, self._inputs @ state.q, pressed, rows.slopes(state.q), x)
        if self._terms:
            rubbed = self._terms.pad_friction(rows, state.multipliers, state.grip)
            forces = self._terms.forces(state.q, state.v, c) + rubbed.force
            now = replace(now, of_terms=forces, q=state.q, multipliers=state.multipliers, gap=rubbed.gap)
        if self._now is not None:
            self._work += _work(self._now, now)
        self._now = now

    def forget(self) -> None:
        """Discard peaks and work, as the simulation resumes from a state that was recorded before."""
        self._peak, self._work = np.full_like(self._peak, -np.inf), 0.0

    def record(self, step: int, state: State, rows: PathRows, at: SampledExcitation) -> None:
        """Record the state after step number `step`, for which `follow` was called before.

        `at` has paths and loads at steps.  Peak forces and work are those within this step alone.
        """
        peak, work, self._work = self._peak, self._work, 0.0
        if self._pushes:
            self._peak = np.full_like(peak, -np.inf)
        k = np.searchsorted(self.state_steps, step)
        if k < len(self.state_steps) and self.state_steps[k] == step:
            self.q[k], self.v[k] = state.q, state.v
        assert self._now is not None
        self.multipliers[step], self.peaks[step], self.friction[step] = state.multipliers, peak, state.grip.forces
        drift = rows.apply(state.v) + rows.of_contacts(at.rates[step] * self._now.slope)
        energy = self._energy(state, -float(at.f[step] @ self._now.motion))
        self.sums[step] = np.concatenate([self._outputs @ state.q, rows.apply(state.q), drift, [*energy, work]])

    def _energy(self, state: State, potential: float) -> list[float]:
        """This rank's contributions to kinetic energy, strain energy and `potential` of the loads, in J."""

        def half_form(matrices: Sequence[PETSc.Mat], x: Array) -> float:
            """This rank's contribution to x^T A x / 2, by its part x (n_local,), for the `matrices` A of all bodies."""
            energy = 0.0
            for A, at, (right, product) in zip(matrices, self._system.local_slices, self._vectors, strict=True):
                right.getArray()[:] = x[at]
                A.mult(right, product)
                energy += float(x[at] @ product.getArray()) / 2.0
            return energy

        return [half_form(self._M, state.v), half_form(self._K, state.q), potential]

    def history(self, at: SampledExcitation, seconds: WallTimes) -> History:
        """History of all records, in a run under the excitation `at`; collective.

        `seconds` are the wall times in s.  The violation of velocities is NaN if a contact gives way.  Forces of
        supports are among those of the contacts, and `supports` has no columns.
        """
        system = self._system
        sums = system.comm.allreduce(self.sums)
        y, motion, drift, energies_of_steps = np.split(sums, self._ends, axis=1)
        ropes, pushes = system.rope_coordinates(at.x), ~np.isnan(system.clearance)
        forces, of_cylinders = self.multipliers, np.zeros(len(sums))
        if (pads := self._friction) is not None:
            forces = forces + pads.cylinder_forces(self.friction)
            of_cylinders = pads.stored_energy(self.friction, forces)
        deflections = system.compliance.displacements(forces, ropes)
        violation = motion - deflections - np.where(pushes, system.clearance, 0.0)
        open_now = pushes & (self.multipliers <= 0.0)
        violation = np.where(open_now, np.maximum(violation, 0.0), violation)
        if not system.compliance.rigid.all():
            drift = np.full_like(drift, np.nan)
        kinetic, stored, potential, work = energies_of_steps.T
        strain = stored + row_products(forces, deflections) / 2.0
        least = energy_round_off(self._mobility(), at.f, float(at.t[1]))
        done = np.cumsum(work) + of_cylinders
        done[1:] += np.cumsum(system.compliance.drum_work(forces, ropes))
        surplus = energy_surplus(kinetic + strain, done, least, since_start=bool(pushes.any()))
        return History(
            t=at.t,
            s=at.s,
            y={name: y[:, of] for name, of in zip(system.bodies, system.output_slices, strict=True)},
            contacts=ContactHistory(
                forces=forces,
                peaks=np.where(pushes, self.peaks, forces),
                friction=None if self._friction is None else self.friction,
            ),
            supports=np.zeros((len(sums), 0)),
            errors=SolutionErrors(
                np.abs(violation).max(axis=1, initial=0.0), np.abs(drift).max(axis=1, initial=0.0), surplus
            ),
            energy=Energy(kinetic, strain, potential),
            states={
                name: States(at.t[self.state_steps], at.s[self.state_steps], self.q[:, rows], self.v[:, rows])
                for name, rows in zip(system.bodies, system.local_slices, strict=True)
            },
            seconds=seconds,
        )

    def _mobility(self) -> Array:
        """Matrix B^T diag(M)^-1 B (i, i) in 1/kg; collective."""
        inertia = np.concatenate([model.M.getDiagonal().getArray() for model in self._system.models])
        B = self._inputs.toarray().T
        return np.asarray(self._system.comm.allreduce(B.T @ (B / inertia[:, None])))


@dataclass(frozen=True)
class _StepWork:
    """Loads and contacts at a step, from which work follows.

    `f` (i,) are the loads, and `motion` (i,) the displacements of their points.  Each side of a contact has a `force`
    (sides,) in N, a position x (sides,) in m, and a `slope` (sides,): the derivative of its row by x, times the
    coordinates.
    """

    f: Array
    motion: Array
    force: Array
    slope: Array
    x: Array
    # (n_local,) each: forces of terms on this rank's coordinates, and the coordinates; empty without terms
    of_terms: Array = field(default_factory=lambda: np.zeros(0))
    q: Array = field(default_factory=lambda: np.zeros(0))
    # contact forces (m,) N, and displacements (m,) m of cylinders by friction; empty without friction
    multipliers: Array = field(default_factory=lambda: np.zeros(0))
    gap: Array = field(default_factory=lambda: np.zeros(0))


def _work(a: _StepWork, b: _StepWork) -> float:
    """Work in J of loads, terms and travelling contacts from the step `a` to the next, `b`, as this rank's part."""
    of_loads = (a.f + b.f) @ (b.motion - a.motion) / 2.0
    of_terms = (a.of_terms + b.of_terms) @ (b.q - a.q) / 2.0 - (a.multipliers + b.multipliers) @ (b.gap - a.gap) / 2.0
    return float(of_loads + of_terms + ((a.force + b.force) / 2.0) @ ((a.slope + b.slope) / 2.0 * (b.x - a.x)))
