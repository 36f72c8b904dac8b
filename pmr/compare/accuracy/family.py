"""All models that one reduction of each body holds, and their motions at common times.

The one with all modes has attachment modes for the loads that bodies bear besides (`pmr.compare.attached`): it is
nearly the full model.  Where pads push all models take the parts of a step that those of the scene ask for: what is
compared is the reduction, not how each lands.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.compare.attached import loads_carried
from pmr.compare.booms import force_kinds_of
from pmr.compare.estimate import Estimate, estimate
from pmr.compare.halved_steps import reference_rho
from pmr.compare.outputs import KINDS, Floors, Outputs, impulsive
from pmr.compare.runs import at_intervals, in_parts, recorded, run_from_start
from pmr.compare.step_error import StepError, step_error
from pmr.errors import SimulationError
from pmr.errors.aside import Aside
from pmr.reduced.attachment import with_attachment_modes, with_cylinder_modes
from pmr.reduced.model import ReducedModel
from pmr.reduced.truncation import extended, truncated
from pmr.simulation import Excitation, TimeStepping
from pmr.simulation.columns import called
from pmr.simulation.native import systems
from pmr.simulation.native.form import SystemForm
from pmr.system.body import length_outputs, other_outputs
from pmr.system.contacts import ALONE, named
from pmr.system.system import System, SystemTrajectory

Array = NDArray[np.float64]
Models = Mapping[str, ReducedModel]

#: Modes that only serve to tell the errors of others, up to a quarter of all.
BEYOND = 8
#: So many modes less tell what all modes leave unsure.
LESS = 4
#: Coordinates more that are tried where the fewest leave no room for the error of any step; one of each of several
#: bodies.
ROOM = 2


@dataclass(frozen=True)
class Member:
    """One model of a family: so many modes of each body; with attachment modes for what the bodies bear, or without.

    With them (`pmr.compare.attached`) it only serves to judge others.
    """

    sizes: tuple[int, ...]  # modes of each body
    attached: bool = False
    beside: int = 0  # coordinates that every member has besides: modes of cylinders

    @property
    def coordinates(self) -> int:
        """Of all bodies."""
        return sum(self.sizes) + self.beside


#: Of a motion: steps, at how many equal intervals, rho_inf.
_Key = tuple[int, int, float]


@dataclass
class _Known:
    """What is known of a member, or has been begun."""

    form: SystemForm | None = None
    motions: dict[_Key, Outputs] = field(default_factory=dict)
    begun: dict[_Key, Callable[[], tuple[bool, Any]]] = field(default_factory=dict)  # motions that another process has
    # by the number of steps: what a run says of its step, None where it can't, and estimates, which may be on their way
    step_errors: dict[int, StepError | None] = field(default_factory=dict)
    estimates: dict[int, Callable[[], Estimate]] = field(default_factory=dict)


class Family:
    """Bodies of so many modes each, of reductions of which `pmr.compare.estimate.no_estimate` says None.

    `models` are those on free modes by body, `join` makes a system of such models as they are simulated.  The time grid
    of the excitation is where searches begin; `rates` says whether velocities are wanted, which cost more than the
    motion.  Motions are compared with hardly any damping by the scheme (`pmr.compare.halved_steps.reference_rho`); what
    a run is off by has that of its own rho_inf (`own`).  What is begun before it is asked for another process has,
    `aside`, where there is one.  Raises InputError or SimulationError as for `pmr.simulation.SystemSimulator`.
    """

    def __init__(
        self,
        models: Models,
        join: Callable[[Models], System],
        excitation: Excitation,
        rates: bool = False,
        aside: Aside | None = None,
    ) -> None:
        self.excitation, self.rates, self._aside = excitation, rates, aside or Aside()
        self._models, self._join = models, join
        self._given_system = join(models)
        self._wholes = {name: one if one.enrichment is None else extended(one) for name, one in models.items()}
        self._beside = sum(with_cylinder_modes(model).cylinder_modes for model in self._wholes.values())
        self._sizes = [model.size for model in self._wholes.values()]
        rigid = [_rigid(model) for model in self._wholes.values()]
        self._more = [count - min(rigid) for count in rigid]
        self._given = excitation.stepping.rho_inf
        self._rho = reference_rho(self._given_system, self._given)
        self._of = defaultdict[Member, _Known](_Known)
        self._schedules = dict[int, tuple[int, ...]]()
        self._last: tuple[tuple[Member, int], SystemTrajectory] | None = None
        #: Whether any contact only pushes.
        self.pushing = not np.isnan(self._given_system.clearance).all()
        #: Modes of the smallest member, and of the largest one that all modes are much better than.
        self.fewest = max(1, min(rigid))
        ends = zip(self._more, self._sizes, strict=True)
        self._most = [max(more + self.fewest, size - max(1, min(BEYOND, size // 4))) for more, size in ends]
        self.most = max(most - more for most, more in zip(self._most, self._more, strict=True))
        #: The one with all modes, which the others are compared with; one with a few less, which tells what that one
        #: leaves unsure.
        self.best = self._member(self._sizes, attached=True)
        ends = zip(self._more, self._sizes, strict=True)
        self.less = self._member([max(more + self.fewest, size - LESS) for more, size in ends], attached=True)
        self.size = self.best.coordinates
        forces = dict.fromkeys(["pad_force"] if ALONE in models else force_kinds_of(self._given_system))
        probes = ["probe"] * any(np.any(other_outputs(model)) for model in models.values())
        #: Kinds of outputs that there are.
        self.kinds = tuple(dict.fromkeys((*KINDS[:2], *forces, "velocity", *probes)))
        #: Whether forces have no size, as of rigid sliders that strike at kinks; those of sections count between kinks.
        self.impulsive = ALONE in models and impulsive(models[ALONE], excitation)
        #: Of each displacement its name, and where it is along its body in m.
        self.places = [
            (named(name, one), float(x))
            for name, body in models.items()
            for one, x in zip(called(body).moved, body.output_positions[length_outputs(body)], strict=True)
        ]

    @property
    def end(self) -> float:
        """Simulated time in s."""
        return self.excitation.stepping.end

    def with_steps(self, steps: int, rho_inf: float | None = None) -> Excitation:
        """The same excitation on so many equal steps, with the given rho_inf or another one."""
        end, rho = self.end, self._given if rho_inf is None else rho_inf
        return self.excitation.on_grid(TimeStepping(end, end / steps, rho))

    def begin(self, member: Member, steps: int, times: int) -> None:
        """Begin with what `motion` says of the same."""
        known, key = self._of[member], (steps, times, self._rho)
        if key not in known.motions and key not in known.begun:
            given = self._models, self._join, self.excitation, self.rates
            known.begun[key] = self._aside.ask(_moved, *given, member, key)

    def motion(self, member: Member, steps: int, times: int) -> Outputs:
        """Of one member with so many steps, at `times` equal intervals, a whole number of steps each.

        Raises InputError or SimulationError as for `pmr.simulation.Simulator`.
        """
        return self._motion(member, steps, times, self._rho)

    def own(self, member: Member, steps: int, times: int) -> Outputs:
        """The same with the given rho_inf, as a run has it."""
        return self._motion(member, steps, times, self._given)

    def _motion(self, member: Member, steps: int, times: int, rho_inf: float) -> Outputs:
        known, key = self._of[member], (steps, times, rho_inf)
        if key in known.begun:
            well, found = known.begun.pop(key)()
            known.motions |= {key: found} if well else {}
        if key not in known.motions:
            excitation = self._in_parts(self.with_steps(steps, rho_inf))
            known.motions[key] = at_intervals(self._form(member), excitation, steps // times, self.rates)
        return known.motions[key]

    def begin_estimate(self, member: Member, steps: int) -> None:
        """Begin with what `estimate` says of the same."""
        known = self._of[member].estimates
        if steps not in known:
            with suppress(SimulationError):
                run = self._chosen_parts(member, steps)
                of = self.models(member), self.system(member), self.with_steps(steps), run
                known[steps] = self._aside.done(estimate, *of)

    def estimate(self, member: Member, steps: int) -> Estimate | None:
        """What a run of this member with so many steps estimates of itself; None where it can't, as after impacts."""
        self.begin_estimate(member, steps)
        known = self._of[member].estimates
        with suppress(SimulationError):
            return known[steps]() if steps in known else None
        return None

    def step_error(self, member: Member, steps: int) -> StepError | None:
        """What the same run says of its step; None where it can't."""
        known = self._of[member].step_errors
        if steps not in known:
            known[steps] = None
            with suppress(SimulationError):
                system, excitation = self.system(member), self.with_steps(steps)
                run = self._chosen_parts(member, steps) if recorded(system, excitation.stepping) else None
                known[steps] = step_error(system, excitation, run)
        return known[steps]

    def _chosen_parts(self, member: Member, steps: int) -> SystemTrajectory:
        """A run that chooses the parts of its steps, the last of which is kept."""
        if self._last is None or self._last[0] != (member, steps):
            self._last = (member, steps), run_from_start(self._form(member), self.with_steps(steps))
        return self._last[1]

    def models(self, member: Member) -> dict[str, ReducedModel]:
        """A member's models by body; of sections without the modes of their cylinders."""
        of_all = zip(self._wholes.items(), member.sizes, strict=True)
        return {name: whole if size == whole.size else truncated(whole, size) for (name, whole), size in of_all}

    def member(self, modes: int) -> Member:
        """The one with so many modes, `fewest` to `most`, as far as a body has them.

        A body that has more rigid-body modes than another one has as many more modes.
        """
        of_all = zip(self._more, self._most, strict=True)
        return self._member([min(more + modes, most) for more, most in of_all])

    def neighbours(self, member: Member, more: int) -> list[Member]:
        """Members with so many coordinates `more`, or less, of one body each."""
        found = []
        for k, (size, beyond, most) in enumerate(zip(member.sizes, self._more, self._most, strict=True)):
            if beyond + self.fewest <= size + more <= most:
                found.append(replace(member, sizes=(*member.sizes[:k], size + more, *member.sizes[k + 1 :])))
        return found

    def roomier(self, member: Member) -> Member:
        """A member that is a little larger; the same one if there is none."""
        more = -(-ROOM // len(member.sizes))
        sizes = [max(size, min(size + more, most)) for size, most in zip(member.sizes, self._most, strict=True)]
        return replace(member, sizes=tuple(sizes))

    def costs_much(self, member: Member) -> bool:
        """Whether a step of it costs so much that fewer are tried."""
        return len(member.sizes) > 1

    def seconds(self, member: Member, steps: int) -> float:
        """Wall time of the solver for so many steps."""
        form, excitation = self._form(member), self._in_parts(self.with_steps(steps))
        if form.system.on_one_path:
            return systems.observe(form, excitation, every=steps).seconds
        return run_from_start(form, excitation, steps).seconds

    def load(self) -> None:
        """Compile or load what simulates the members, one step of the smallest ones: searches are timed without."""
        with suppress(SimulationError):  # a step as long as the whole time may fail, after everything is loaded
            self._motion(self.member(self.fewest), 1, 1, self._given)

    def floors(self, steps: int) -> Floors:
        """What of its motions may be round-off."""
        forces = None if ALONE in self._wholes else self._run.forces
        return Floors.of(self._join(self._wholes), self.with_steps(steps), forces)

    @cached_property
    def _run(self) -> SystemTrajectory:
        """Of all modes, in the parts of a step that the scene's own models ask for."""
        return run_from_start(self._join(self._wholes), self._in_parts(self.excitation))

    @cached_property
    def _loads(self) -> Mapping[str, sp.csr_matrix]:
        """What bodies bear in that run."""
        return loads_carried(self._join(self._wholes), self._run)

    @cached_property
    def _given_form(self) -> SystemForm:
        return SystemForm.of(self._given_system)

    def _member(self, sizes: list[int], attached: bool = False) -> Member:
        return Member(tuple(sizes), attached, self._beside)

    def system(self, member: Member) -> System:
        """Of a member's bodies as they are simulated."""
        return self._form(member).system

    def _form(self, member: Member) -> SystemForm:
        known = self._of[member]
        if known.form is None:
            models = self.models(member)
            if member.attached:
                bodies = {name: with_attachment_modes(model, self._loads[name]) for name, model in models.items()}
                system = self._given_system.with_bodies(bodies)
            else:
                system = self._join(models)
            known.form = SystemForm.of(system)
        return known.form

    def _in_parts(self, excitation: Excitation) -> Excitation:
        if not self.pushing:
            return excitation
        steps = excitation.stepping.steps
        if steps not in self._schedules:
            run = run_from_start(self._given_form, excitation)
            self._schedules[steps] = in_parts(self._given_system, excitation, run).stepping.schedule
        return excitation.with_stepping(replace(excitation.stepping, schedule=self._schedules[steps]))


def _moved(
    models: Models, join: Callable[[Models], System], excitation: Excitation, rates: bool, member: Member, key: _Key
) -> Outputs:
    """A motion of such a family."""
    return Family(models, join, excitation, rates)._motion(member, *key)


def _rigid(model: ReducedModel) -> int:
    stiffness = np.diagonal(model.K)
    return int(np.count_nonzero(stiffness <= 1e-9 * stiffness[-1]))
