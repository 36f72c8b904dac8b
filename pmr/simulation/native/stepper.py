"""One step at a time, for a simulation in a loop of one's own: hardware, a controller, an operator.

::

    stepper = Stepper(ReducedModel.load("reduced.npz"), step=1e-3, s=1.25)
    while running:
        y = stepper.step(s, F)  # outputs in m at the end of the step

    stepper = Stepper(System.load("system.npz"), step=1e-3, s={"fly": 1.5}, outputs=["fly: w(6)"])
    while running:
        y = stepper.step({"fly": s}, {"fly.tip force": F})

    stepper = Stepper(System.load("crane.npz"), step=1e-3, s={"mid": 0.6, "fly": 0.6})
    while running:  # value, rate and second rate of what moves
        y = stepper.step({"fly": (s, ds, dds)}, frame={"luffing": (phi, dphi, ddphi)})
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError, SimulationError
from pmr.scene.built import force_of
from pmr.scene.names import SLIDER
from pmr.scene.signals import Constant, Ramp
from pmr.simulation.contact_step import MOST_PARTS, contact_frequency
from pmr.simulation.excitation import Excitation
from pmr.simulation.native import bound_step as bound_step
from pmr.simulation.native import tables
from pmr.simulation.native.arrays import Drive, V, Z
from pmr.simulation.native.driving import JUMP, Driving, Motion, Values, number_of
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.handles import Handle, entry_of, handle
from pmr.simulation.native.march import March
from pmr.simulation.native.part import Alone
from pmr.simulation.native.parts import COARSE
from pmr.simulation.native.start import places_of
from pmr.simulation.native.stepped import outputs_of, step_observed, step_of
from pmr.simulation.native.systems import static_start
from pmr.simulation.recorded import Recorded, recorded
from pmr.simulation.start import InitialState
from pmr.simulation.stepping import TimeStepping
from pmr.system.body import SlidingBody
from pmr.system.friction import Friction
from pmr.system.system import System

Array = NDArray[np.float64]


class Stepper:
    """The compiled simulator of `pmr.simulation.native.systems`, which your own loop advances step by step.

    A step of a single body on one path takes well under a microsecond from Python.  Neither the step nor the outputs
    allocate memory.  Compiled code of your own (Numba) calls ``step_on_tables(*stepper.arguments, s, f, y)`` of
    `pmr.simulation.native.part`, without Python in between.

    Parameters
    ----------
    body : SlidingBody or System
        Usually a `ReducedModel`, or a system of reduced models.
    step : float, s
        Time step; `contact` shows whether it resolves contacts that only push.
    s : float where there is one path, mapping of str to float, or sequence of float, m
        Path coordinates at the start; a sequence is in the order of `System.paths`.  If the scene has a frame, give
        rates and second rates, too, {"fly": (s, s', s'')}; those that are left out are zero.
    F : float where there is one load, (i,) array, or mapping of str to float, N (gravity m/s^2)
        Loads at the start; an array is in the order of `System.input_names`.  Loads that are not given are those of the
        system's scene at t = 0, with its full weight even where the weight rises; they are zero if the system has no
        scene.  If the scene has a frame, name loads as the scene does, gravity included; their components in the moving
        frame are computed (`pmr.simulation.moving`).
    rho_inf : float
        Spectral radius at infinite frequency.  If rigid rows move, take at most 0.9: near 1 their multipliers (index 3)
        grow from step to step, the sooner the faster they move.  The stepper does not check the energy, so try the
        fastest path that you expect with `systems.simulate`, which does (docs/time_integration.md).  A model with
        residual flexibility has no such multipliers.
    outputs : sequence of int or str, optional
        The outputs that `step` returns: numbers in `output_names`, or names from it, which include forces of contacts.
        By default all outputs of the bodies.
    initial : InitialState, or mapping of str to InitialState, optional
        State of the body, or of each body, at the start; bodies that are missing start at rest, undeformed.  By default
        all start as the scene of the system says, in equilibrium with F or at rest; at rest if there is no scene.
    frame : mapping of str to float, or to (value, rate, second rate), optional
        Motion of the frame at the start: ``luffing``, ``slewing``, ``base.rx`` ... in rad; for ``base.x`` ... only the
        acceleration of the pivot, in m/s^2.  A rate or second rate that is left out is zero.  Motions that are not
        given are those of the scene at t = 0.
    parts : int
        Number of parts of a step where contacts only push; 0 takes as few as keep their forces within a tolerance, as a
        run does.  Within a step, paths and loads are cubics if they are given with their rates, {"fly": (s, s')}, at
        both ends, and straight lines otherwise.  In a frame, second rates that are given hold at both ends, too.

    Raises
    ------
    InputError
        If a number is out of its range, the system has no such name, or there is not one load for each input.  Also if
        the initial position violates a rigid row, a rigid row only pushes, or nothing holds the bodies in equilibrium.
    SimulationError
        If contacts depend on each other at the start.
    """

    def __init__(
        self,
        body: SlidingBody | System,
        step: float,
        s: Values,
        F: Values | None = None,
        rho_inf: float = 0.9,
        outputs: Sequence[int | str] | None = None,
        initial: InitialState | Mapping[str, InitialState] | None = None,
        frame: Mapping[str, Motion] | None = None,
        parts: int = 1,
    ) -> None:
        if not 0.0 < step < np.inf:
            raise InputError("stepper", "step", step, "more than 0 s is allowed")
        if not (isinstance(parts, int) and 0 <= parts <= MOST_PARTS):
            raise InputError("stepper", "parts", parts, f"0 to {MOST_PARTS} are allowed")
        if not 0.0 <= rho_inf < 1.0:
            raise InputError("stepper", "rho_inf", rho_inf, "from 0 to less than 1 is allowed")
        system = body if isinstance(body, System) else System.of(body)
        form, moved = SystemForm.of(system), system.output_names
        on_tables = form.on_tables
        self._system, self._step, self._steps = system, step, 0
        self._ranges = system.ranges
        if on_tables is not None:  # a body that nothing moves has a place all the same
            self._ranges = dict.fromkeys(system.paths or (SLIDER,), on_tables.domain)
        #: Names of all that `outputs` chooses from: outputs of the bodies, then forces of the contacts.
        self.output_names = (*moved, *map(force_of, system.contact_names))
        names, every = list(self.output_names), range(len(moved))
        self._chosen = np.array([number_of(k, names, "outputs") for k in (every if outputs is None else outputs)], int)
        self._driving, self._parts = Driving(system, self._ranges, step), parts
        self._s, self._f, frame_moves = self._driving.s, self._driving.f, self._driving.frame is not None
        self._driving.take_path(s)
        known = recorded(system, "stepper") if "scene" in system.provenance else None
        if known is not None and not frame_moves:
            self._driving.take_loads(known.first_loads)
        if F is not None:
            self._driving.take_loads(F)
        self._driving.take_frame(frame or {})
        excitation = self._excitation(step, rho_inf)
        if isinstance(initial, InitialState):
            initial = dict.fromkeys(system.bodies, initial)
        if initial is None and known is not None and known.static:
            initial = static_start(system, excitation)
        examples = None if self._driving.frame is None else self._driving.frame.examples
        self._march = March(form, excitation, initial or {}, examples, self._omega(known) if parts == 0 else None)
        self._state = self._march.loop.state
        # A single load, and the place on tables, are written through these in a third of the time that NumPy takes.
        whole = self._march.finest == 1
        alone = len(self._f) == 1 and not frame_moves and whole
        self._single: Any = memoryview(self._f) if alone else None  # type: ignore[arg-type]
        self._place: Any = None
        if on_tables is not None and not frame_moves and whole and np.all(self._chosen < len(moved)):
            self._y, loop = np.zeros(len(self._chosen)), self._march.loop
            observed = tables.outputs(on_tables, self._chosen.tolist())
            body_alone = Alone(loop.tables, loop.divided, loop.scheme, observed, self._state)
            #: What `step_on_tables` takes before s (float), the loads f (i,) and the outputs y (o,).
            self.arguments = (handle(body_alone),)
            self._jump = JUMP * (on_tables.domain[1] - on_tables.domain[0])
            self._entry, self._place = bound_step.entry(self._state.contact is not None), memoryview(self._s)  # type: ignore[arg-type]
            self._bound = handle(bound_step.Bound(body_alone, self._f, self._y))
        else:
            loop, own = self._march.loop, self._chosen < len(moved)
            self._moved, self._stepped = np.zeros(own.sum()), dict[int, Handle]()
            self._seen = outputs_of(form, self._chosen[own].tolist())
            self._counts = [1] if whole else loop.levels.parts.tolist()
            level = np.zeros(1, np.int64) if whole else loop.control.level
            self._level = memoryview(level)  # type: ignore[arg-type]
            #: of these outputs and the contacts' forces behind them; None where it is these
            behind = own.sum() + self._chosen - len(moved)
            self._order = None if own.all() else np.where(own, np.cumsum(own) - 1, behind)
            self._advance = entry_of(step_observed, self._sampled(0))  # compiled or loaded: not in the first step
            failed = self._advance(self._sampled(0))
            if failed:
                raise self._march.failed(failed, f"t = 0 s{places_of(tuple(self._ranges), self._s)}")
            if frame_moves:
                self._driving.leave()

    def step(self, s: Values, F: Values | None = None, frame: Mapping[str, Motion] | None = None) -> Array:
        """Advance by one step.

        Parameters
        ----------
        s : as for the start, m
            Path coordinates at the end of the step.  A path may go beyond its end by `pmr.errors.BEYOND_ENDS` of its
            length; it is then taken at the end.  Paths that a mapping leaves out stay where they are.
        F : as for the start, N (gravity m/s^2)
            Loads at the end of the step; a Python float is fastest.  Loads that are not given stay as they are.
        frame : as for the start
            Motion of the frame at the end of the step; motions that are not given stay as they are, with their rates.

        Returns
        -------
        (o,) array
            The chosen outputs, in their units.  It may be the same array in every step: copy values that you keep.

        Raises
        ------
        InputError
            If a path leaves its range or would cross all of it in a step, an angle other than that of slewing is more
            than a turn, a number is not finite, the system has no such name, or there is not one load for each input.
            What jumps, or moves in a frame without second rates, is told once by a warning of `logging`.
        SimulationError
            If contacts depend on each other.
        """
        if type(F) is float and F - F == 0.0 and self._single is not None:  # else it is not finite
            self._single[0] = F
        elif F is not None:
            self._driving.take_loads(F)
        if frame is not None:
            self._driving.take_frame(frame)
        if self._place is None:
            failed = self._on_places(s)
        else:
            failed = bound_step.OFF_THE_PATH
            if isinstance(s, float):
                failed = self._entry(self._bound, s)
                if failed != bound_step.OFF_THE_PATH:
                    if abs(s - self._place[0]) > self._jump:
                        self._driving.note_path(0, s)
                    self._place[0] = s
            if failed == bound_step.OFF_THE_PATH:
                self._driving.take_path(s)
                failed = self._entry(self._bound, self._place[0])
        if failed:
            raise self._march.failed(failed, f"{self._where}{places_of(tuple(self._ranges), self._s)}")
        self._steps += 1
        return self._y

    @property
    def outputs(self) -> Array:
        """All of `output_names`, at present."""
        s = dict(zip(self._ranges, self._s.tolist(), strict=True))
        return np.concatenate([self._march.outputs_at(s, self._f), self.multipliers])

    @property
    def time(self) -> float:
        """Time in s since the start."""
        return self._steps * self._step

    @property
    def states(self) -> dict[str, InitialState]:
        """Coordinates of each body and their rates, by the body's name, as `initial` takes them."""
        form, modes = self._march.form, self._state.modes
        own = {name: modes[:, columns] for name, columns in form.columns.items()}
        return {name: InitialState(one.X @ own[name][Z], one.X @ own[name][V]) for name, one in form.forms.items()}

    @property
    def q(self) -> Array:
        """Coordinates (n,) of the bodies, one body after the other."""
        return np.concatenate([one.q for one in self.states.values()])

    @property
    def v(self) -> Array:
        """Their rates (n,)."""
        return np.concatenate([one.v for one in self.states.values()])

    @property
    def multipliers(self) -> Array:
        """Forces (m,) of the contacts in N, positive where they push; of cylinders with their friction."""
        return self._march.forces

    @property
    def forces(self) -> dict[str, float]:
        """Forces of the contacts by their names, in N, as in `multipliers`."""
        return dict(zip(self._system.contact_names, self.multipliers.tolist(), strict=True))

    @property
    def friction(self) -> dict[str, float]:
        """Friction force of the pads of each joint, in N, by the section that slides; empty without friction."""
        known = Friction.of(self._system.contacts)
        return (
            {} if known is None else dict(zip(known.joints, known.totals(self._march.friction).tolist(), strict=True))
        )

    @property
    def contact(self) -> float:
        """Time step times the contact frequency of contacts that only push, over all paths; 0 without such contacts.

        With `parts` = 1, impacts lose force and energy where this is above `contact_step.RESOLVED` (docs/pads.md).
        """
        return self._step * contact_frequency(self._system, self._anywhere)

    def check_finite(self) -> None:
        """Raise SimulationError if the state is not finite: loads may have been NaN."""
        if not np.all(np.isfinite(self._state.modes[Z])):
            raise SimulationError(f"march failed at {self._where}: not finite")

    def _on_places(self, s: Values) -> int:
        """A step of bodies on places of their own, or of which forces are asked for; what stopped it, or 0."""
        self._driving.take_path(s)
        self._driving.find()
        failed = COARSE
        while failed == COARSE:
            failed = self._advance(self._sampled(self._counts[self._level[0]]))
        if self._driving.frame is not None:
            self._driving.leave()
        order = self._order
        self._y = self._moved.copy() if order is None else np.concatenate([self._moved, self.multipliers])[order]
        return int(failed)

    def _sampled(self, parts: int) -> Handle:
        """What `step_observed` takes of a step that is known at so many parts, or at the start alone with none."""
        found = self._stepped.get(parts)
        if found is None:
            c, led = self._driving.c, self._driving.motions if self._driving.frame is None else None
            sizes = len(self._s), len(self._f), 0 if c is None else len(self._march.mixed(c))
            found = step_of(self._march.loop, (self._seen, self._moved), parts, sizes, led)
            self._stepped[parts] = found
        if self._driving.frame is not None:
            self._fill(found.kept[0].drive, parts)
        return found

    def _fill(self, drive: Drive, parts: int) -> None:
        """What drives a step, from the frame's motion."""
        drive.s[-1], drive.f[-1] = self._s, self._f
        # where its parts are other ones than before, it begins anew
        if parts > 0 and self._march.finest > 1:
            s, f, c = self._driving.samples(parts)
            drive.s[:-1], drive.f[:-1] = s[:-1], f[:-1]
            if drive.c is not None:
                drive.c[:-1] = [self._march.mixed(one) for one in c[:-1]]
        if self._driving.c is not None:
            drive.c[-1] = self._march.mixed(self._driving.c)

    def _omega(self, known: Recorded | None) -> float:
        """Of contacts that only push, rad/s: on the way of the scene, or anywhere."""
        modal = SystemForm.of(self._system).modal
        return contact_frequency(modal, self._anywhere if known is None else known.excitation)

    @property
    def _anywhere(self) -> Excitation:
        """From one end of all paths to the other."""
        ends = {path: Ramp(times=(0.0, self._step), values=one) for path, one in self._ranges.items()}
        stepping = TimeStepping(self._step, self._step / 64.0)
        return replace(self._excitation(self._step, 0.0), paths=ends, stepping=stepping)

    def _excitation(self, step: float, rho_inf: float) -> Excitation:
        """Of one step on which nothing changes."""
        paths = {path: Constant(amount=float(s)) for path, s in zip(self._ranges, self._s, strict=True)}
        self._driving.find()
        c = np.zeros(0) if self._driving.c is None else self._driving.c
        loads, terms = (
            {name: Constant(amount=one) for name, one in zip(names, values.tolist(), strict=True)}
            for names, values in ((self._system.input_names, self._f), (self._system.term_names, c))
        )
        return Excitation(paths, loads, TimeStepping(step, step, rho_inf, parts=self._parts), terms=terms)

    @property
    def _where(self) -> str:
        return f"step {self._steps + 1}, t = {self.time + self._step:g} s"
