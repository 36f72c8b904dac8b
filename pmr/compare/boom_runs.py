"""A boom's reduced sections from static equilibrium on any time grid, and what is compared of their motions."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmr.compare.booms import force_kinds, respond, tip_columns, with_friction
from pmr.compare.halved_steps import UNDAMPED
from pmr.compare.outputs import Outputs
from pmr.scene import Scene
from pmr.simulation import Excitation
from pmr.simulation.columns import called
from pmr.simulation.contact_step import as_made, contact_frequency
from pmr.simulation.native import systems
from pmr.simulation.stepping import TimeStepping
from pmr.system.body import length_outputs, other_outputs
from pmr.system.contacts import named
from pmr.system.system import System, SystemTrajectory

Array = NDArray[np.float64]

#: Steps beside a kink whose forces are left out.
BESIDE_KINK = 2.0


def run_from_rest(system: System, excitation: Excitation) -> SystemTrajectory:
    """From static equilibrium, or undeformed, as the excitation says."""
    return systems.simulate(system, excitation, systems.start_of(system, excitation))


def in_parts(system: System, excitation: Excitation, run: SystemTrajectory | None = None) -> Excitation:
    """The excitation with the parts of a step that a run of the system takes, where pads push."""
    omega = contact_frequency(system, excitation)
    if omega == 0.0:
        return excitation
    made = (run or run_from_rest(system, excitation)).parts
    return excitation.with_stepping(as_made(excitation.stepping, made, omega))


def on_grid(boom: Scene, system: System, stepping: TimeStepping) -> Excitation:
    """What drives a system of the boom's sections on another time grid: kinks are spread over its own steps."""
    time = boom.time.model_copy(update={"step": stepping.step})
    return Excitation.of(boom.model_copy(update={"time": time})).with_stepping(stepping)


def reference_rho(system: System, rho_inf: float) -> float:
    """`rho_inf` of runs that others are compared with, as `pmr.compare.halved_steps.reference_rho`."""
    carriers = [body.carriers for body in system.bodies.values()]
    known = all(one is not None and getattr(one, "flexibility", None) is not None for one in carriers)
    return max(rho_inf, UNDAMPED) if known and np.isnan(system.clearance).all() else rho_inf


class SteppedBoom:
    """A boom's system with ever smaller steps (`pmr.compare.halved_steps.Stepped`); parts of a step choose themselves.

    So what an impact leaves to the tolerance of these parts is no part of the error.
    """

    def __init__(self, boom: Scene, system: System, excitation: Excitation) -> None:
        self._boom, self._system, self.excitation = boom, system, excitation
        self.pushing = not np.isnan(system.clearance).all()
        self.given = replace(excitation.stepping, schedule=())
        self.parts = self.given.parts
        self.reference_rho = reference_rho(system, self.given.rho_inf)
        self.round_off = 0.0
        self.tips = tip_columns(system)

    def displacements(self, stepping: TimeStepping, every: int, which: list[int] | None = None) -> Array:
        run = run_from_rest(self._system, on_grid(self._boom, self._system, stepping))
        found = systems.displacements(self._system, run.at(slice(None, None, every)))
        moved = [found[name][:, length_outputs(body)] for name, body in self._system.bodies.items()]
        return np.hstack(moved)[:, slice(None) if which is None else which]


@dataclass(frozen=True)
class Seen:
    """Which steps of a run are compared, each `every`-th one, and s beside kinks in which forces are not."""

    every: int = 1
    beside: float = 0.0
    rates: bool = False  # whether velocities are wanted


def outputs(boom: Scene, system: System, run: SystemTrajectory, seen: Seen) -> Outputs:
    """Of a run; forces with the friction that cylinders overcome, and none beside kinks."""
    at = slice(None, None, seen.every)
    response = with_friction(boom, system.contacts, respond(system, run.at(at)))
    probes = sum(int(np.count_nonzero(other_outputs(body))) for body in system.bodies.values())
    kinks = [kink for path in boom.paths.values() for kink in path.kinks(boom.time.end)]
    away = np.all([np.ones(len(response.t), bool), *(np.abs(response.t - t) > seen.beside for t in kinks)], axis=0)
    others = np.empty((len(response.t), 0)) if response.others is None else response.others
    return Outputs(
        displacement=response.displacement,
        velocity=velocities(system, run)[at] if seen.rates else np.empty((len(response.t), 0)),
        force=np.where(away[:, None], response.slider_force, 0.0),
        probe=others[:, :probes],
        units=response.other_units[:probes],
        tips=tuple(tip_columns(system)),
        forces=tuple(force_kinds(response)),
    )


def velocities(system: System, run: SystemTrajectory) -> Array:
    r"""Rates of the displacements, (T, o) in m/s: :math:`O \dot q`, and by differences those of the residual part."""
    of_all, found = systems.displacements(system, run), list[Array]()
    for name, body in system.bodies.items():
        moved, motion = length_outputs(body), run.bodies[name]
        O = np.asarray(body.outputs[moved])
        residual = of_all[name][:, moved] - motion.q @ O.T
        found.append(motion.v @ O.T + np.gradient(residual, run.t, axis=0))
    return np.hstack(found)


def places(system: System) -> list[tuple[str, float]]:
    """Of each displacement its name, and where it is along its section in m."""
    return [
        (named(name, one), float(x))
        for name, body in system.bodies.items()
        for one, x in zip(called(body, ()).moved, body.output_positions[length_outputs(body)], strict=True)
    ]
