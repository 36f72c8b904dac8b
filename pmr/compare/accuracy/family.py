"""All models that one reduction holds, and their motions at common times."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pmr.compare.attached import with_loads_answered
from pmr.compare.estimate import Estimate, estimate
from pmr.compare.halved_steps import reference_rho
from pmr.compare.outputs import Floors, Outputs, lagging, observed, outputs, without_rates
from pmr.compare.step_error import StepError, step_error
from pmr.errors import SimulationError
from pmr.reduced.model import ReducedModel
from pmr.reduced.truncation import extended, truncated, with_kept_inertia
from pmr.simulation import Excitation, TimeStepping
from pmr.simulation.blocks import Recorder
from pmr.simulation.modal import ModalForm, modal_form
from pmr.simulation.native import simulator as march
from pmr.system.body import Trajectory, pushing_rows

Array = NDArray[np.float64]

#: Modes that only serve to tell the errors of others, up to a quarter of all.
BEYOND = 8


@dataclass(frozen=True)
class Member:
    """One model of a family: so many modes as coordinates, with the inertia of all others or without.

    Where rows only push it is the inertia in the directions of what they bear (`pmr.compare.attached`).
    """

    coordinates: int
    residual_inertia: bool = False


def member_of(model: ReducedModel, member: Member) -> ReducedModel:
    """A member as `truncated` and `with_kept_inertia` make it of a reduction."""
    whole = model if model.enrichment is None else extended(model)
    chosen = whole if member.coordinates == whole.size else truncated(whole, member.coordinates)
    return with_kept_inertia(chosen) if member.residual_inertia else chosen


class Family:
    """The models with 1, 2, ... of the modes of one reduction, of which `pmr.compare.estimate.no_estimate` says None.

    The time grid of the excitation is where searches begin, the last `tips` displacements are the tip's; `rates` says
    whether velocities are wanted, which cost more than the motion.  Motions are compared with hardly any damping by the
    scheme (`pmr.compare.halved_steps.reference_rho`); what a run is off by has that of its own rho_inf (`own`).
    """

    def __init__(self, model: ReducedModel, excitation: Excitation, tips: int, rates: bool = False) -> None:
        self.model, self.excitation, self.tips, self.rates = model, excitation, tips, rates
        whole = model if model.enrichment is None else extended(model)
        self._form = modal_form(whole)
        stiffness = self._form.omega2
        self.size = whole.size
        self.fewest = max(1, int(np.count_nonzero(stiffness <= 1e-9 * stiffness[-1])))
        self._forms: dict[Member, ModalForm] = {}
        self._motions: dict[tuple[Member, int, int, float], Outputs] = {}
        self._steps: dict[tuple[Member, int], StepError | None] = {}
        self._given, self._rho = excitation.stepping.rho_inf, reference_rho(whole, excitation.stepping.rho_inf)

    @property
    def end(self) -> float:
        """Simulated time in s."""
        return self.excitation.stepping.end

    @property
    def most(self) -> int:
        """Coordinates of the largest member that all modes are much better than."""
        return max(self.fewest, self.size - min(BEYOND, self.size // 4))

    @property
    def keeps_inertia(self) -> bool:
        """Whether members that are chosen can: damping that couples modes has no tables, nor have rows that push."""
        return self._form.classically_damped and not self.pushing

    @cached_property
    def best(self) -> Member:
        """The one with all modes, which the others are compared with."""
        return Member(self.size, self.keeps_inertia or self.pushing)

    @property
    def pushing(self) -> bool:
        """Whether any rows only push."""
        return bool(pushing_rows(self.model))

    @cached_property
    def _run(self) -> Trajectory:
        return march.simulate_modal(self._form, self.excitation)

    def with_steps(self, steps: int, rho_inf: float | None = None) -> Excitation:
        """The same excitation on so many equal steps, with the given rho_inf or another one."""
        end, rho = self.end, self._given if rho_inf is None else rho_inf
        return self.excitation.with_stepping(TimeStepping(end, end / steps, rho))

    def form(self, member: Member) -> ModalForm:
        """A member in its modal coordinates, which are the modes themselves."""
        if member not in self._forms:
            answers = self.pushing and member.residual_inertia
            self._forms[member] = self._answering(member) if answers else self._plain(member)
        return self._forms[member]

    def _plain(self, member: Member) -> ModalForm:
        body, every = member_of(self._form.body, member), np.eye(member.coordinates)
        return ModalForm(body, every, every, self._form.rows)

    def _answering(self, member: Member) -> ModalForm:
        loads, body = self.excitation.forces(self.model.input_names), member_of(self.model, Member(member.coordinates))
        return modal_form(with_loads_answered(body, self._run, loads))

    def motion(self, member: Member, steps: int, times: int) -> Outputs:
        """Of one member with so many steps, at `times` equal intervals, a whole number of steps each.

        Raises InputError or SimulationError as for `pmr.simulation.Simulator`.
        """
        return self._motion(member, steps, times, self._rho)

    def own(self, member: Member, steps: int, times: int) -> Outputs:
        """The same with the given rho_inf, as a run has it."""
        return self._motion(member, steps, times, self._given)

    def estimate(self, member: Member, steps: int) -> Estimate | None:
        """What a run of this member with so many steps estimates of itself; None where it can't, as after impacts."""
        try:
            return estimate(member_of(self.model, member), self.with_steps(steps), self.tips)
        except SimulationError:
            return None

    def step_error(self, member: Member, steps: int) -> StepError | None:
        """What the same run says of its step; None where it can't."""
        if (member, steps) not in self._steps:
            self._steps[member, steps] = None
            with suppress(SimulationError):
                found = step_error(member_of(self.model, member), self.with_steps(steps), self.tips)
                self._steps[member, steps] = found
        return self._steps[member, steps]

    def _motion(self, member: Member, steps: int, times: int, rho_inf: float) -> Outputs:
        key = member, steps, times, rho_inf
        if key not in self._motions:
            self._motions[key] = self._simulated(member, steps, times, rho_inf)
        return self._motions[key]

    def _simulated(self, member: Member, steps: int, times: int, rho_inf: float | None = None) -> Outputs:
        form, excitation, every = self.form(member), self.with_steps(steps, rho_inf), steps // times
        if self.rates or member.residual_inertia:
            recorder, seen = Recorder(np.arange(0, steps + 1, every)), self.with_steps(times)
            run = recorder.trajectory(march.follow(form, excitation, recorder))
            found = (outputs if self.rates else without_rates)(form.body, run, seen, self.tips)
            return lagging(found, form.body, run, seen) if member == self.best and not self.pushing else found
        told = march.observe(form, excitation, every=every)
        return observed(form.body, told.y, told.multipliers, self.tips)

    def load(self) -> None:
        """Compile or load what simulates the members, with a step of the smallest ones: searches are timed without.

        A step as long as the whole time may fail, after everything is loaded.
        """
        for inertia in (False, True) if self.keeps_inertia else (False,):
            with suppress(SimulationError):
                self._simulated(Member(self.fewest, inertia), 1, 1)

    def floors(self, steps: int) -> Floors:
        """What of its motions may be round-off."""
        return Floors.of(self._form.body, self.with_steps(steps))
