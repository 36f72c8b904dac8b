"""All models that one reduction holds, and their motions at common times."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pmr.compare.attached import with_loads_answered
from pmr.compare.estimate import Estimate, Estimated, estimate
from pmr.compare.halved_steps import reference_rho
from pmr.compare.outputs import KINDS, Floors, Outputs, impulsive, lagging, observed, outputs, without_rates
from pmr.compare.step_error import StepError, step_error
from pmr.errors import SimulationError
from pmr.reduced.model import ReducedModel
from pmr.reduced.truncation import extended, truncated, with_kept_inertia
from pmr.simulation import Excitation, TimeStepping
from pmr.simulation.blocks import Recorder
from pmr.simulation.columns import called
from pmr.simulation.modal import ModalForm, modal_form
from pmr.simulation.native import simulator as march
from pmr.system.body import Trajectory, length_outputs, other_outputs, pushing_rows
from pmr.system.contacts import ALONE

Array = NDArray[np.float64]

#: Modes that only serve to tell the errors of others, up to a quarter of all.
BEYOND = 8
#: So many modes less tell what all modes leave unsure.
LESS = 4
#: Coordinates more that are tried where the fewest leave no room for the error of any step.
ROOM = 2


@dataclass(frozen=True)
class Member:
    """One model of a family: so many modes as coordinates, with the inertia of all others or without.

    Where rows only push, and of several bodies, it is the inertia in the directions of what they bear
    (`pmr.compare.attached`).
    """

    coordinates: int
    residual_inertia: bool = False
    sizes: tuple[int, ...] = ()  # of each body, where there are several


def member_of(model: ReducedModel, member: Member) -> ReducedModel:
    """A member as `truncated` and `with_kept_inertia` make it of a reduction."""
    whole = model if model.enrichment is None else extended(model)
    chosen = whole if member.coordinates == whole.size else truncated(whole, member.coordinates)
    return with_kept_inertia(chosen) if member.residual_inertia else chosen


class Motions(ABC):
    """Models among which is chosen, from the `fewest` modes to the `most`, and their motions at common times.

    The time grid of the excitation is where searches begin; `rates` says whether velocities are wanted, which cost more
    than the motion.  Motions are compared with hardly any damping by the scheme
    (`pmr.compare.halved_steps.reference_rho`); what a run is off by has that of its own rho_inf (`own`).
    """

    fewest: int  # modes of the smallest member
    most: int  # of the largest member that all modes are much better than
    size: int  # of all
    pushing: bool  # whether any contact only pushes
    keeps_inertia: bool  # whether members that are chosen can keep their residual inertia
    best: Member  # the one with all modes, which the others are compared with
    less: Member  # the same with a few modes less, which tells what that one leaves unsure
    kinds: tuple[str, ...]  # of outputs that there are
    impulsive: bool  # whether forces have no size, as of rigid sliders that strike at kinks
    places: Sequence[tuple[str, float]]  # of each displacement its name, and where it is along its body in m

    def __init__(self, excitation: Excitation, rates: bool, reference_rho: float) -> None:
        self.excitation, self.rates = excitation, rates
        self._motions: dict[tuple[Member, int, int, float], Outputs] = {}
        self._steps: dict[tuple[Member, int], StepError | None] = {}
        self._given, self._rho = excitation.stepping.rho_inf, reference_rho

    @property
    def end(self) -> float:
        """Simulated time in s."""
        return self.excitation.stepping.end

    def with_steps(self, steps: int, rho_inf: float | None = None) -> Excitation:
        """The same excitation on so many equal steps, with the given rho_inf or another one."""
        end, rho = self.end, self._given if rho_inf is None else rho_inf
        return self.on_grid(TimeStepping(end, end / steps, rho))

    def on_grid(self, stepping: TimeStepping) -> Excitation:
        """The same excitation on another time grid."""
        return self.excitation.with_stepping(stepping)

    def motion(self, member: Member, steps: int, times: int) -> Outputs:
        """Of one member with so many steps, at `times` equal intervals, a whole number of steps each.

        Raises InputError or SimulationError as for `pmr.simulation.Simulator`.
        """
        return self._motion(member, steps, times, self._rho)

    def own(self, member: Member, steps: int, times: int) -> Outputs:
        """The same with the given rho_inf, as a run has it."""
        return self._motion(member, steps, times, self._given)

    def _motion(self, member: Member, steps: int, times: int, rho_inf: float) -> Outputs:
        key = member, steps, times, rho_inf
        if key not in self._motions:
            self._motions[key] = self._simulated(member, steps, times, rho_inf)
        return self._motions[key]

    def estimate(self, member: Member, steps: int) -> Estimated | None:
        """What a run of this member with so many steps estimates of itself; None where it can't, as after impacts."""
        try:
            return self._estimate(member, steps)
        except SimulationError:
            return None

    def step_error(self, member: Member, steps: int) -> StepError | None:
        """What the same run says of its step; None where it can't."""
        if (member, steps) not in self._steps:
            self._steps[member, steps] = None
            with suppress(SimulationError):
                self._steps[member, steps] = self._step_error(member, steps)
        return self._steps[member, steps]

    @abstractmethod
    def models(self, member: Member) -> dict[str, ReducedModel]:
        """A member's models by body; of sections without the modes of their cylinders."""

    @abstractmethod
    def member(self, modes: int, residual_inertia: bool = False) -> Member:
        """The one with so many modes, `fewest` to `size`; of several bodies each has so many, as far as it has them."""

    @abstractmethod
    def neighbours(self, member: Member, more: int) -> list[Member]:
        """Members with so many coordinates `more`, or less, of one body each."""

    @abstractmethod
    def roomier(self, member: Member) -> Member:
        """A member that is a little larger; the same one if there is none."""

    @abstractmethod
    def costs_much(self, member: Member) -> bool:
        """Whether a step of it costs so much that fewer are tried."""

    @abstractmethod
    def seconds(self, member: Member, steps: int) -> float:
        """Wall time of the solver for so many steps."""

    @abstractmethod
    def load(self) -> None:
        """Compile or load what simulates the members: searches are timed without."""

    @abstractmethod
    def floors(self, steps: int) -> Floors:
        """What of its motions may be round-off."""

    @abstractmethod
    def _simulated(self, member: Member, steps: int, times: int, rho_inf: float | None = None) -> Outputs: ...

    @abstractmethod
    def _estimate(self, member: Member, steps: int) -> Estimated: ...

    @abstractmethod
    def _step_error(self, member: Member, steps: int) -> StepError: ...


class Family(Motions):
    """The models with 1, 2, ... of the modes of one reduction, of which `pmr.compare.estimate.no_estimate` says None.

    The last `tips` displacements are the tip's.
    """

    def __init__(self, model: ReducedModel, excitation: Excitation, tips: int, rates: bool = False) -> None:
        whole = model if model.enrichment is None else extended(model)
        super().__init__(excitation, rates, reference_rho(whole, excitation.stepping.rho_inf))
        self.model, self.tips, self.size = model, tips, whole.size
        self._form, self._forms = modal_form(whole), dict[Member, ModalForm]()
        stiffness = self._form.omega2
        self.fewest = max(1, int(np.count_nonzero(stiffness <= 1e-9 * stiffness[-1])))
        self.most = max(self.fewest, self.size - min(BEYOND, self.size // 4))
        self.kinds = KINDS if np.any(other_outputs(model)) else KINDS[:-1]
        self.pushing, self.impulsive = bool(pushing_rows(model)), impulsive(model, excitation)
        moved = length_outputs(model)
        self.places = list(zip(called(model, ()).moved, model.output_positions[moved], strict=True))
        # Damping that couples modes has no tables, nor have rows that push.
        self.keeps_inertia = self._form.classically_damped and not self.pushing
        self.best = Member(self.size, self.keeps_inertia or self.pushing)
        self.less = replace(self.best, coordinates=max(self.fewest, self.size - LESS))

    @cached_property
    def _run(self) -> Trajectory:
        return march.simulate_modal(self._form, self.excitation)

    def models(self, member: Member) -> dict[str, ReducedModel]:
        return {ALONE: member_of(self.model, member)}

    def member(self, modes: int, residual_inertia: bool = False) -> Member:
        return Member(modes, residual_inertia)

    def neighbours(self, member: Member, more: int) -> list[Member]:
        size = member.coordinates + more
        return [replace(member, coordinates=size)] if self.fewest <= size <= self.most else []

    def roomier(self, member: Member) -> Member:
        return replace(member, coordinates=min(member.coordinates + ROOM, self.most))

    def costs_much(self, member: Member) -> bool:
        return member.residual_inertia

    def seconds(self, member: Member, steps: int) -> float:
        form, excitation = self.form(member), self.with_steps(steps)
        if member.residual_inertia:
            return march.follow(form, excitation, Recorder(np.array([0, steps]))).seconds
        return march.observe(form, excitation, every=steps).seconds

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

    def _estimate(self, member: Member, steps: int) -> Estimate:
        return estimate(member_of(self.model, member), self.with_steps(steps), self.tips)

    def _step_error(self, member: Member, steps: int) -> StepError:
        return step_error(member_of(self.model, member), self.with_steps(steps), self.tips)

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
        """With a step of the smallest ones; one as long as the whole time may fail, after everything is loaded."""
        for inertia in (False, True) if self.keeps_inertia else (False,):
            with suppress(SimulationError):
                self._simulated(Member(self.fewest, inertia), 1, 1)

    def floors(self, steps: int) -> Floors:
        return Floors.of(self._form.body, self.with_steps(steps))
