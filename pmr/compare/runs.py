"""Reduced bodies from the start of their excitation on any time grid, and what is compared of their motions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmr.compare.booms import BESIDE_KINK, force_kinds_of, output_contacts, tip_columns
from pmr.compare.outputs import Outputs
from pmr.compare.velocities import velocity
from pmr.reduced.model import ReducedModel
from pmr.results import Response
from pmr.simulation.contact_step import as_made, contact_frequency
from pmr.simulation.excitation import Excitation
from pmr.simulation.native import systems
from pmr.simulation.native.form import SystemForm
from pmr.simulation.start import dense
from pmr.simulation.stepping import TimeStepping
from pmr.system.body import SlidingBody, Trajectory, force_outputs, length_outputs, other_outputs
from pmr.system.states import SystemTrajectory
from pmr.system.system import System

Array = NDArray[np.float64]

#: Numbers of a run that are recorded before outputs alone are.
MOST_RECORDED = 20_000_000


def run_from_start(system: System | SystemForm, excitation: Excitation, every: int = 1) -> SystemTrajectory:
    """Each `every`-th step, from static equilibrium or undeformed, as the excitation says.

    Runs of one modal form share its tables.
    """
    form = system if isinstance(system, SystemForm) else SystemForm.of(system)
    return systems.simulate_form(form, excitation, every=every)


def is_recorded(system: System, stepping: TimeStepping) -> bool:
    """Whether all steps of a run are to be recorded."""
    bodies, contacts = system.bodies.values(), len(system.contacts)
    return stepping.steps * (2 * sum(body.size for body in bodies) + contacts) <= MOST_RECORDED


def in_parts(system: System, excitation: Excitation, run: SystemTrajectory | None = None) -> Excitation:
    """The excitation with the parts of a step that a run of the system takes, where pads push."""
    omega = contact_frequency(system, excitation)
    if omega == 0.0:
        return excitation
    parts = (run or run_from_start(system, excitation)).parts
    return excitation.with_stepping(as_made(excitation.stepping, parts, omega))


def outputs(system: System, run: SystemTrajectory, excitation: Excitation, every: int = 1) -> Outputs:
    """Outputs of each `every`-th step of a run, whose excitation has all of them."""
    y, stride = np.hstack(list(systems.displacements(system, run).values())), slice(None, None, every)
    sampled, displacement = outputs_from(system, y[stride], run.forces[stride]), y[:, _displacement_mask(system)]
    return replace(sampled, velocity=velocities(system, run, excitation, displacement)[stride])


def outputs_of_response(system: System, run: SystemTrajectory, excitation: Excitation, response: Response) -> Outputs:
    """Outputs of all steps of a run from its response."""
    probes = np.concatenate([other_outputs(body) for body in system.bodies.values()])
    other_columns = np.empty((len(run.t), 0)) if response.others is None else response.others
    return Outputs(
        displacement=response.displacement,
        velocity=velocities(system, run, excitation, response.displacement),
        force=response.slider_force,
        probe=other_columns[:, : np.count_nonzero(probes)],
        units=tuple(unit for unit, counts in zip(system.output_units, probes, strict=True) if counts),
        tips=tuple(tip_columns(system)),
        forces=force_kinds_of(system),
    )


def without_rates(system: System, run: SystemTrajectory) -> Outputs:
    """Outputs of all steps of a run without velocities, which are expensive."""
    y = np.hstack(list(systems.displacements(system, run).values()))
    return outputs_from(system, y, run.forces)


def between_kinks(system: System, sampled: Outputs, excitation: Excitation, times: Array, step: float) -> Outputs:
    """Outputs at some times (T,) s whose forces are zero within `BESIDE_KINK` steps, in s, of a kink of an extension.

    There they have no size: the shorter the steps, the larger they are.  A body alone keeps all.
    """
    if system.on_one_path:
        return sampled
    return replace(sampled, force=np.where(away_from_kinks(excitation, times, step)[:, None], sampled.force, 0.0))


def away_from_kinks(excitation: Excitation, times: Array, step: float) -> NDArray[np.bool_]:
    """Which of some times (T,) s are more than `BESIDE_KINK` steps, in s, from every kink of a path."""
    kinks = [kink for path in excitation.paths.values() for kink in path.kinks(excitation.stepping.end)]
    return np.asarray(np.all([np.ones(len(times), bool), *(np.abs(times - t) > BESIDE_KINK * step for t in kinks)], 0))


def outputs_from(system: System, y: Array, forces: Array) -> Outputs:
    """Outputs from all output columns y (T, o) of the bodies and contact forces (T, m), without velocities.

    Forces are those of pads, sliders, springs and cylinders.
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
        forces=force_kinds_of(system),
    )


def _displacement_mask(system: System) -> NDArray[np.bool_]:
    """Which outputs of all bodies are displacements."""
    return np.concatenate([length_outputs(body) for body in system.bodies.values()])


def velocities(system: System, run: SystemTrajectory, excitation: Excitation, displacement: Array) -> Array:
    r"""Rates of the `displacement`, (T, o) in m/s and m, of all steps of the excitation.

    Of a body on one path those of the residual part follow from its tables (`pmr.compare.velocities`); of several
    bodies, and with attachment modes, :math:`O \dot q` and differences.
    """
    if system.on_one_path and all(map(_by_tables, system.bodies.values())):
        body, motion = along_path(system, run, excitation)
        return velocity(body, motion, excitation.on_slider)[:, length_outputs(body)]
    rates, first = list[Array](), 0
    for name, model in system.bodies.items():
        O, trajectory = dense(model.outputs)[length_outputs(model)], run.bodies[name]
        last = first + len(O)
        residual = displacement[:, first:last] - trajectory.q @ O.T
        rates.append(trajectory.v @ O.T + np.gradient(residual, run.t, axis=0))
        first = last
    return np.hstack(rates)


def _by_tables(body: SlidingBody) -> bool:
    """Return whether tables of flexibility yield rates, as they do without attachment modes."""
    attached = body.carriers is not None and getattr(body.carriers, "inertia", None) is None
    return body.flexibility is not None and not attached


def along_path(system: System, run: SystemTrajectory, excitation: Excitation) -> tuple[ReducedModel, Trajectory]:
    """A body on one path with none but the rows that are contacts, and its motion with the path coordinate (T,)."""
    (body,), (motion,) = system.reduced.values(), run.bodies.values()
    rows = [body.row_names.index(contact.inner.row) for contact in system.contacts]
    s = excitation.on_slider.along(body.domain) if excitation.paths else np.full(len(run.t), body.domain[0])
    return body.with_rows(rows), replace(motion, s=s)
