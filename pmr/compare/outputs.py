"""Outputs by which models are compared, and their errors: displacements, velocities, forces and probes.

For a trajectory in the coordinates of a body, forces are the body's outputs in N and the multipliers of its sliders and
pads.  Velocities are the rates of the displacements; they include the rates of the residual part, which follows its
forces at once (`pmr.compare.motion.output_rates`).  All outputs in other units count as probes: stresses, strains, and
displacements and rotations that are measured at a point.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.compare.errors import RELATIVE_FLOOR, Pair, ResponseFunction, refuse_infinite, relative_error, zero_round_off
from pmr.compare.motion import displacement_rates, force_round_off, probe_round_off, round_off
from pmr.files.arrays import Array
from pmr.results import Response
from pmr.scene import Scene
from pmr.scene.keys import ALONE, qualified_name
from pmr.simulation import Excitation, TimeStepping
from pmr.simulation.contact_step import contact_frequency, with_schedule
from pmr.simulation.native import systems
from pmr.simulation.native.form import SystemForm
from pmr.simulation.reactions import output_contacts, outputs_of
from pmr.system.body import force_outputs, length_outputs, other_outputs
from pmr.system.reduced_model import ReducedModel
from pmr.system.states import SystemTrajectory, displacements
from pmr.system.system import System

#: Names of the kinds of outputs in scenes and summaries, and name of the kind that only sections have.
OUTPUT_KINDS = ("beam", "tip", "pad_force", "velocity", "probe")
CYLINDER_FORCE = "cylinder_force"
#: Kinds of outputs that are forces.
FORCE_KINDS = ("pad_force", CYLINDER_FORCE)
#: Share of the largest probe in the same unit: errors of smaller probes are relative to this share of the largest.
LITTLE = 0.01


@dataclass(frozen=True)
class Outputs:
    """Outputs of a simulation by kind: T times, o displacements, p forces, k probes."""

    displacement: Array  # (T, o) m
    velocity: Array  # (T, o) m/s; (T, 0) if velocities are not wanted
    force: Array  # (T, p) N
    probe: Array  # (T, k) in `units`
    units: tuple[str, ...]  # (k,): units of the probes
    tips: tuple[int, ...]  # numbers of the displacements of the tip
    forces: tuple[str, ...] = ()  # (p,): kind of each force; empty if all are forces of sliders and pads

    def of_kind(self, kind: str) -> Array:
        """Return the c outputs (T, c) of one `kind`, which is one of `OUTPUT_KINDS` or `CYLINDER_FORCE`; c may be 0."""
        if kind == "tip":
            return self.displacement[:, list(self.tips)]
        if kind in FORCE_KINDS:
            return self._forces(kind, self.force)
        return {"beam": self.displacement, "velocity": self.velocity, "probe": self.probe}[kind]

    def _forces(self, kind: str, force: Array) -> Array:
        """Columns of `force` (T, p), in N, whose kind is `kind`, one of `FORCE_KINDS`.

        If the forces have no kinds, as those of a single body, all of them are pad forces.
        """
        if not self.forces:
            return force if kind == "pad_force" else force[:, :0]
        return force[:, [k for k, kind_of_force in enumerate(self.forces) if kind_of_force == kind]]

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of outputs that a simulation has; ``velocity`` is always among them, even if no rates were computed."""
        return tuple(
            kind for kind in (*OUTPUT_KINDS, CYLINDER_FORCE) if kind == "velocity" or self.of_kind(kind).shape[1]
        )

    def select_displacements(self, places: Sequence[int]) -> Outputs:
        """Outputs with only those displacements, and their velocities, whose numbers are `places`, in that order.

        `tips` are renumbered; forces, probes and all else stay.
        """
        which, rates = list(places), self.velocity.shape[1] > 0
        tips = tuple(which.index(tip) for tip in self.tips if tip in which)
        velocity = self.velocity[:, which] if rates else self.velocity
        return replace(self, displacement=self.displacement[:, which], velocity=velocity, tips=tips)


@dataclass(frozen=True)
class RoundOffBounds:
    """Largest round-off of displacements (m), of forces (N) and of each of k probes (k,)."""

    displacement: float  # m
    force: float  # N
    probe: Array  # (k,), each in the unit of the probe

    @classmethod
    def for_system(cls, system: System, excitation: Excitation, forces: Array | None = None) -> RoundOffBounds:
        """Bounds of the round-off of a system's outputs under the excitation's loads (`pmr.compare.motion.round_off`).

        For several bodies, the bound of forces is `RELATIVE_FLOOR` times the largest of `forces`, the contact forces
        (T, m) in N, or 0 if `forces` is None.  For a single body it is `pmr.compare.motion.force_round_off`.
        """
        f, end, least = excitation.forces(system.input_names), excitation.stepping.end, 0.0
        if ALONE in system.bodies:
            body: Any = system.bodies[ALONE]
            least = force_round_off(body, f, end, float(excitation.path.value(0.0)))
        elif forces is not None:
            least = RELATIVE_FLOOR * float(np.abs(forces).max(initial=0.0))
        return cls(round_off(system.bodies, f, end), least, probe_round_off(system.bodies, f, end))


def differences(
    outputs: Outputs, reference: Outputs, floors: RoundOffBounds, kinds: Sequence[str] = OUTPUT_KINDS
) -> dict[str, float]:
    """Errors of outputs against a reference, as fractions, by kind, for each of `kinds`.

    The measure is `pmr.compare.errors.relative_error`.  Columns that are round-off by the `floors` count as zero; so do
    velocities of displacements that are round-off in both.
    """
    moves = zero_round_off(outputs.displacement, reference.displacement, floors.displacement)
    errors = dict[str, float]()
    for kind in kinds:
        match kind:
            case "tip":
                pair = Pair(*(y[:, list(reference.tips)] for y in moves))
            case "beam":
                pair = moves
            case "pad_force" | "cylinder_force":
                forces = zero_round_off(outputs.force, reference.force, floors.force)
                pair = Pair(outputs._forces(kind, forces.signal), reference._forces(kind, forces.reference))
            case "probe":
                errors[kind] = float(probe_differences(outputs, reference, floors).max(initial=0.0))
                continue
            case _:
                still = ~np.any(moves.signal, axis=0) & ~np.any(moves.reference, axis=0)
                pair = Pair(*(np.where(still, 0.0, of.of_kind(kind)) for of in (outputs, reference)))
        errors[kind] = relative_error(*pair)
    return errors


def probe_differences(outputs: Outputs, reference: Outputs, floors: RoundOffBounds) -> Array:
    """Error (k,) of each of k probes in `outputs` against `reference`, as fractions (`probe_errors`).

    `floors` has the bounds of round-off; a history that is round-off counts as zero.  Raises SimulationError if a value
    is not finite.
    """
    y, r = zero_round_off(outputs.probe, reference.probe, floors.probe)
    refuse_infinite(y, r)
    return probe_errors(y, r, reference.units)


def probe_errors(y: Array, r: Array, units: Sequence[str]) -> Array:
    r"""Errors (k,), fractions, of k probes y (T, k) compared with r (T, k), with the `units` of each.

    .. math:: \mathrm{rms}(y_k - r_k) / \max(\mathrm{rms}(r_k),\ 0.01 \max_j \mathrm{rms}(r_j))

    with the probe y_k, its reference r_k, and all probes j in the unit of k.  So the error of a small stress, such as
    that across a wall that is bent, is not relative to its own size.  If the denominator is 0, the error is 0 if the
    probe is zero too, else 1.
    """
    unit, error, size = np.array(units), *(np.sqrt(np.mean(x**2, axis=0)) for x in (y - r, r))
    scale = np.array(
        [max(largest, LITTLE * size[unit == name].max()) for largest, name in zip(size, units, strict=True)]
    )
    none = scale == 0.0
    return np.asarray(np.where(none, error > 0.0, error / np.where(none, 1.0, scale)))


def has_impulsive_force(model: ReducedModel, excitation: Excitation) -> bool:
    """Whether the force of a rigid slider or moving pad has no limit, because its path has a kink before the end.

    At a kink a rigid slider strikes the body.  The shorter the step, the larger is the force of that impact, and no two
    models agree on it.
    """
    rigid = np.flatnonzero(model.row_compliance == 0.0)
    if not set(rigid.tolist()) & set(model.moving):
        return False
    end = excitation.stepping.end
    return any(t < end for t in excitation.path.kinks(end))


def lifts_off(forces: Array) -> bool:
    """Whether any of p contacts that only push is closed at some steps and open at others.

    `forces` (T, p) in N are the forces of these contacts; the force of an open contact is zero.
    """
    pushed = forces > 0.0
    return bool(np.any(pushed.any(axis=0) & ~pushed.all(axis=0)))


#: Number of steps, before a kink and after it, whose forces are left out.
BESIDE_KINK = 2.0


def boom_quantities(excitation: Excitation, response: Response) -> Mapping[str, ResponseFunction]:
    """Functions of a response, by key, that return the quantities (T, k) in which models of a boom are compared.

    The key ``tip`` has the displacements in m of the last section's tip, and ``beam`` those of all sections.  Each kind
    of forces in `response`, such as ``pad_force``, is the key of its forces in N.

    A force at a kink of an extension has no limit: it grows as the step gets shorter or the cylinder stiffer.  So if an
    extension has a kink before the end, there is a further key for each kind of forces, ``<kind>_between_kinks``.  It
    has the forces at times more than `BESIDE_KINK` steps away from every kink.  If there are no such times, this key is
    left out.
    """
    last = response.outputs[len(response.output_names) - 1].body
    away = away_from_kinks(excitation, response.t, excitation.stepping.step)
    measures: dict[str, ResponseFunction] = {
        "tip": lambda response: response.of("tip", body=last),
        "beam": lambda response: response.displacement,
    }
    for kind in dict.fromkeys(force_kinds(response)):
        measures[kind] = partial(_forces_at_steps, kind, slice(None))
        if not away.all():
            measures[f"{kind}_between_kinks"] = partial(_forces_at_steps, kind, away)
    return measures


def _forces_at_steps(kind: str, steps: slice | NDArray[np.bool_], response: Response) -> Array:
    """Forces (S, k) in N of the k contacts of one kind at S `steps`; those of negligible contacts are set to 0.

    `steps` are a slice of all T steps, or a mask (T,).  A contact is negligible if its largest force in all T steps is
    at most `RELATIVE_FLOOR` times the largest force of all contacts of all kinds.  A cylinder that holds still is an
    example.
    """
    which = np.array(force_kinds(response)) == kind
    size = np.abs(response.slider_force).max(axis=0)
    counts = size > RELATIVE_FLOOR * size.max()
    return np.where(counts, response.slider_force, 0.0)[steps][:, which]


def force_kinds(response: Response) -> list[str]:
    """Kind of each force of a response, in order: ``pad_force``, ``cylinder_force`` or ``support_force``.

    A ``support_force`` is the force of a support with a stiffness.
    """
    return [f"{output.kind}_force" for output in response.outputs if output.is_force]


def force_kinds_of_system(system: System) -> tuple[str, ...]:
    """Kind of each force output of a system: of the springs of all bodies, then of the contacts (`output_contacts`).

    For a single body all kinds are ``pad_force``.
    """
    springs = [output.text for output in outputs_of(system) if output.is_force]
    kinds = [*springs, *(system.contacts[k].kind for k in output_contacts(system))]
    return tuple("pad_force" if ALONE in system.bodies else f"{kind}_force" for kind in kinds)


def tip_columns(system: System) -> list[int]:
    """Numbers, among the displacements of all bodies, of those at the tip of the last body."""
    last = list(system.bodies)[-1]
    displacements = [output for output in outputs_of(system) if output.is_displacement]
    return [k for k, output in enumerate(displacements) if output.body == last and output.kind == "tip"]


def tip_names(boom: Scene) -> set[str]:
    """Names of the outputs of the system that are displacements of the last section's tip along y and z."""
    last = boom.sections[-1]
    section = "" if ALONE in boom.bodies else last.name
    return {qualified_name(section, last.observe.tip_along(direction)) for direction in "yz"}


#: Largest number of values of a run that are kept in memory; for larger runs only outputs are kept.
MOST_RECORDED = 20_000_000


def run_from_start(system: System | SystemForm, excitation: Excitation, every: int = 1) -> SystemTrajectory:
    """Simulate a system by the compiled simulator; return the motion at every `every`-th step.

    The motion starts in static equilibrium or undeformed, as the excitation says.  Repeated runs of the same
    `SystemForm` share its tables.
    """
    return systems.simulate_form(SystemForm.of(system), excitation, every=every)


def fits_in_memory(system: System, stepping: TimeStepping) -> bool:
    """Whether states and multipliers at all steps are at most `MOST_RECORDED` numbers, so that memory can hold them."""
    bodies, contacts = system.bodies.values(), len(system.contacts)
    return stepping.steps * (2 * sum(body.size for body in bodies) + contacts) <= MOST_RECORDED


def divide_steps(system: System, excitation: Excitation, run: SystemTrajectory | None = None) -> Excitation:
    """Excitation whose steps are divided into the same parts as in a run of the system.

    `run` is simulated if it is None.  The excitation is returned unchanged if no contact only pushes, or if its time
    grid sets the number of parts.
    """
    omega = contact_frequency(system, excitation)
    if omega == 0.0:
        return excitation
    parts = (run or run_from_start(system, excitation)).parts
    return excitation.with_stepping(with_schedule(excitation.stepping, parts, omega))


def outputs_of_run(
    system: System, run: SystemTrajectory, excitation: Excitation, every: int = 1, rates: bool = True
) -> Outputs:
    """Outputs at every `every`-th step of a run; the run must contain all steps of the excitation.

    Velocities, which take long to compute, are left out unless `rates` is true.
    """
    y, stride = np.hstack(list(displacements(system, run).values())), slice(None, None, every)
    outputs = outputs_from_columns(system, y[stride], run.forces[stride])
    if not rates:
        return outputs
    displacement = y[:, np.concatenate([length_outputs(body) for body in system.bodies.values()])]
    return replace(outputs, velocity=displacement_rates(system, run, excitation, displacement)[stride])


def without_kink_forces(system: System, sampled: Outputs, excitation: Excitation, times: Array, step: float) -> Outputs:
    """Outputs `sampled` at `times` (T,) in s, with all forces near kinks of the extensions set to 0.

    Near means within `BESIDE_KINK` times `step` in s.  Forces at kinks have no limit: the shorter the steps, the larger
    the forces.  The outputs of a single body on one path are returned unchanged.
    """
    if system.on_one_path:
        return sampled
    return replace(sampled, force=np.where(away_from_kinks(excitation, times, step)[:, None], sampled.force, 0.0))


def away_from_kinks(excitation: Excitation, times: Array, step: float) -> NDArray[np.bool_]:
    """Mask (T,) of the `times` in s that are more than `BESIDE_KINK` times `step` in s from every kink of a path.

    If there are no such times, as with a path of short straight pieces, the mask is true at all times.
    """
    kinks = [kink for path in excitation.paths.values() for kink in path.kinks(excitation.stepping.end)]
    away = np.all([np.ones(len(times), bool), *(np.abs(times - t) > BESIDE_KINK * step for t in kinks)], axis=0)
    return np.asarray(away if away.any() else ~away)


def outputs_from_columns(system: System, y: Array, forces: Array) -> Outputs:
    """Outputs without velocities, from all outputs y (T, o) of the bodies and contact forces (T, m) in N.

    The forces in the result are those of springs, then those of pads, sliders and cylinders (`output_contacts`).
    """
    bodies = list(system.bodies.values())
    displacements, springs, probes = (
        np.concatenate([of(body) for body in bodies]) for of in (length_outputs, force_outputs, other_outputs)
    )
    return Outputs(
        displacement=y[:, displacements],
        velocity=np.empty((len(y), 0)),
        force=np.hstack([y[:, springs], forces[:, output_contacts(system)]]),
        probe=y[:, probes],
        units=tuple(unit for unit, counts in zip(system.output_units, probes, strict=True) if counts),
        tips=tuple(tip_columns(system)),
        forces=force_kinds_of_system(system),
    )
