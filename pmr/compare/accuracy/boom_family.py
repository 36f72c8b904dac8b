"""All models that one reduction of each section of a boom holds, and their motions from static equilibrium.

The one with all modes has attachment modes for the loads that sections bear besides (`pmr.compare.boom_estimate`): it
is nearly the full model.  Where pads push all models take the parts of a step that those of the scene ask for: what is
compared is the reduction, not how each lands.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pmr.compare import boom_runs
from pmr.compare.accuracy.family import LESS, Member, Motions
from pmr.compare.boom_estimate import BoomEstimate, estimate, loads_borne
from pmr.compare.errors import RELATIVE_FLOOR
from pmr.compare.outputs import Floors, Outputs
from pmr.compare.step_error import StepError, step_error_of
from pmr.errors import SimulationError
from pmr.reduced.attachment import with_attachment_modes, with_cylinder_modes
from pmr.reduced.model import ReducedModel
from pmr.reduced.truncation import extended, truncated
from pmr.scene import Scene
from pmr.simulation import Excitation, TimeStepping
from pmr.system.body import other_outputs
from pmr.system.from_scene import system_of
from pmr.system.system import System, SystemTrajectory

Array = NDArray[np.float64]


class BoomFamily(Motions):
    """Sections of 1, 2, ... elastic modes each, of reductions with enrichment modes; `models` are those on free modes.

    Raises InputError or SimulationError as for `pmr.simulation.SystemSimulator`.
    """

    def __init__(self, boom: Scene, models: Mapping[str, ReducedModel], rates: bool = False) -> None:
        self._boom, self._names = boom, tuple(models)
        self._given_system = system_of(boom, _driven(models))
        excitation = Excitation.of(boom)
        super().__init__(excitation, rates, boom_runs.reference_rho(self._given_system, excitation.stepping.rho_inf))
        self._wholes = {name: extended(model) for name, model in models.items()}
        self._rigid = tuple(_rigid(model) for model in self._wholes.values())
        self._sizes = tuple(model.size for model in self._wholes.values())
        self._of_cylinders = sum(model.cylinder_modes for model in _driven(self._wholes).values())
        self._probes = sum(int(np.count_nonzero(other_outputs(model))) for model in models.values())
        forces = [f"{one.kind}_force" for one in self._given_system.contacts if one.kind != "straight"]
        self.kinds = ("beam", "tip", "velocity", *dict.fromkeys(forces), *["probe"] * bool(self._probes))
        self.places, self.impulsive = boom_runs.places(self._given_system), False  # forces count between kinks
        self._systems, self._schedules = dict[Member, System](), dict[int, tuple[int, ...]]()
        elastic = [size - rigid for size, rigid in zip(self._sizes, self._rigid, strict=True)]
        self.fewest, self.most, self.size = 1, max(elastic) - 1, max(elastic)
        self.pushing, self.keeps_inertia = not np.isnan(self._given_system.clearance).all(), False
        self.best = self._member(self._sizes, True)
        self.less = self._member(tuple(max(size - LESS, 1) for size in self._sizes), True)

    def models(self, member: Member) -> dict[str, ReducedModel]:
        of_all = zip(self._wholes.items(), member.sizes, strict=True)
        return {name: whole if size == whole.size else truncated(whole, size) for (name, whole), size in of_all}

    def member(self, modes: int, residual_inertia: bool = False) -> Member:
        of_all = zip(self._rigid, self._sizes, strict=True)
        return self._member(tuple(min(rigid + modes, size - 1) for rigid, size in of_all), residual_inertia)

    def neighbours(self, member: Member, more: int) -> list[Member]:
        found = []
        for k, (size, rigid, whole) in enumerate(zip(member.sizes, self._rigid, self._sizes, strict=True)):
            if rigid < size + more < whole:
                found.append(self._member((*member.sizes[:k], size + more, *member.sizes[k + 1 :])))
        return found

    def roomier(self, member: Member) -> Member:
        of_all = zip(member.sizes, self._sizes, strict=True)
        return self._member(tuple(min(size + 1, whole - 1) for size, whole in of_all))

    def costs_much(self, member: Member) -> bool:
        return True

    def seconds(self, member: Member, steps: int) -> float:
        return boom_runs.run_from_rest(self._system(member), self._in_parts(self.with_steps(steps))).seconds

    def load(self) -> None:
        with suppress(SimulationError):
            self._simulated(self.member(self.fewest), 1, 1)

    def floors(self, steps: int) -> Floors:
        forces = float(np.abs(self._run.forces).max(initial=0.0))
        return Floors(0.0, RELATIVE_FLOOR * forces, np.zeros(self._probes))

    def on_grid(self, stepping: TimeStepping) -> Excitation:
        return boom_runs.on_grid(self._boom, self._given_system, stepping)

    @cached_property
    def _run(self) -> SystemTrajectory:
        """Of all modes, in the parts of a step that the scene's own models ask for."""
        return boom_runs.run_from_rest(self._whole, self._in_parts(self.excitation))

    @cached_property
    def _whole(self) -> System:
        return system_of(self._boom, _driven(self._wholes))

    def _member(self, sizes: tuple[int, ...], residual_inertia: bool = False) -> Member:
        return Member(sum(sizes) + self._of_cylinders, residual_inertia, sizes)

    def _system(self, member: Member) -> System:
        if member not in self._systems:
            models = self.models(member)
            if member.residual_inertia:
                loads = loads_borne(self._whole, self._run)
                richer = {name: with_attachment_modes(model, loads[name]) for name, model in models.items()}
                self._systems[member] = replace(self._whole, bodies=richer)
            else:
                self._systems[member] = system_of(self._boom, _driven(models))
        return self._systems[member]

    def _in_parts(self, excitation: Excitation) -> Excitation:
        if not self.pushing:
            return excitation
        steps = excitation.stepping.steps
        if steps not in self._schedules:
            self._schedules[steps] = boom_runs.in_parts(self._given_system, excitation).stepping.schedule
        return excitation.with_stepping(replace(excitation.stepping, schedule=self._schedules[steps]))

    def _simulated(self, member: Member, steps: int, times: int, rho_inf: float | None = None) -> Outputs:
        system, excitation = self._system(member), self._in_parts(self.with_steps(steps, rho_inf))
        run = boom_runs.run_from_rest(system, excitation)
        seen = boom_runs.Seen(steps // times, boom_runs.BESIDE_KINK * self.end / times, self.rates)
        return boom_runs.outputs(self._boom, system, run, seen)

    def _estimate(self, member: Member, steps: int) -> BoomEstimate:
        system, excitation = self._system(member), self.with_steps(steps)
        run = boom_runs.run_from_rest(system, excitation)
        parts = boom_runs.in_parts(system, excitation, run)
        return estimate(self._boom, self.models(member), system, parts, run)

    def _step_error(self, member: Member, steps: int) -> StepError:
        return step_error_of(boom_runs.SteppedBoom(self._boom, self._system(member), self.with_steps(steps)))


def _driven(models: Mapping[str, ReducedModel]) -> dict[str, ReducedModel]:
    """As they are simulated: with the modes of their cylinders."""
    return {name: with_cylinder_modes(model) for name, model in models.items()}


def _rigid(model: ReducedModel) -> int:
    stiffness = np.diagonal(model.K)
    return int(np.count_nonzero(stiffness <= 1e-9 * stiffness[-1]))
