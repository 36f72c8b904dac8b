"""One step at a time, for a simulation in a loop of your own: with hardware, a controller, an operator.

::

    stepper = Stepper(ReducedModel.load("reduced.npz"), step=1e-3, s=1.25)
    while running:
        y = stepper.step(s, F)  # outputs in m at the end of the step

    stepper = Stepper(System.load("system.npz"), step=1e-3, s={"fly": 1.5}, outputs=["fly: w(6)"])
    while running:
        y = stepper.step({"fly": s}, {"fly.tip force": F})

    stepper = Stepper(System.load("crane.npz"), step=1e-3, s={"mid": 0.6, "fly": 0.6})
    while running:  # value, rate and second rate of paths and angles
        y = stepper.step({"fly": (s, ds, dds)}, frame={"luffing": (phi, dphi, ddphi)})
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from pmr.errors import InputError, SimulationError
from pmr.files.arrays import Array
from pmr.kernel.further import ground_outputs
from pmr.kernel.kernel import Kernel
from pmr.kernel.limits import LimitCheck
from pmr.kernel.state import BoundStep, Settings, State, StepError
from pmr.scene.built import force_name
from pmr.scene.hoist import OUTPUTS
from pmr.scene.keys import LUFFING, SLIDER
from pmr.scene.signals import Constant
from pmr.simulation.contact_step import MOST_PARTS, contact_frequency, contact_frequency_within, part_counts
from pmr.simulation.excitation import Excitation
from pmr.simulation.moving import StoredScene
from pmr.simulation.native.driving import JUMP, Drivers, Motion, Values, number_of
from pmr.simulation.native.form import SystemForm, begin, path_text, step_failure
from pmr.simulation.native.free_motion import prepare_stepping
from pmr.simulation.native.watched import watched_limits
from pmr.simulation.start import InitialState
from pmr.simulation.stepping import TimeStepping
from pmr.system.body import SlidingBody
from pmr.system.contacts import Friction
from pmr.system.system import System

logger = logging.getLogger(__name__)


#: Distance in m within which a section that follows a free extension has to begin.
FOLLOWS = 1e-6


class Stepper:
    """The kernel's step (docs/kernel.md), which your own loop takes one by one.

    A step of a single body on one path takes about a microsecond from Python.  No step allocates memory.

    Parameters
    ----------
    body : SlidingBody or System
        Usually a `ReducedModel`, or a system of reduced models.
    step : float, s
        Time step; `contact` shows whether it resolves contacts that only push.
    s : float where there is one path, mapping of str to float, or sequence of float, m
        Path coordinates at the start; a sequence is in the order of `System.paths`.  If the scene has a frame, give
        rates and second rates, too, {"fly": (s, s', s'')}; rates that are left out are zero.
    F : float where there is one load, (i,) array, or mapping of str to float, N (gravity m/s^2)
        Loads at the start; an array is in the order of `System.input_names`.  Loads that are not given have their
        values in the system's scene at t = 0, with its full weight even where the weight rises; they are zero if the
        system has no scene.  If the scene has a frame, name loads as the scene does, gravity included; their components
        in the moving frame are computed (`pmr.simulation.moving`).
    rho_inf : float
        Spectral radius at infinite frequency.  If rigid rows move, take at most 0.9: near 1 the multipliers of these
        rows (index 3) grow from step to step, and sooner if the rows move faster.  The stepper does not check the
        energy, but `systems.simulate` does: try the fastest path that you expect with it (docs/time_integration.md).  A
        model with residual flexibility has no such multipliers.
    outputs : sequence of int or str, optional
        The outputs that `step` returns: numbers in `output_names`, or names from it, which include forces of contacts.
        By default all outputs of the bodies.
    initial : InitialState, or mapping of str to InitialState, optional
        State of the body, or of each body, at the start; bodies that are missing start at rest, undeformed.  By default
        all start as the scene of the system says, in equilibrium with F or at rest; at rest if there is no scene.
    frame : mapping of str to float, or to (value, rate, second rate), optional
        Motion of the frame at the start: ``luffing``, ``slewing``, ``base.rx`` ... in rad; for ``base.x`` ... only the
        acceleration of the pivot, in m/s^2.  A rate or second rate that is left out is zero.  Motions that are not
        given are as in the scene at t = 0.
    parts : int
        Number of parts of a step if contacts only push; with 0 a step has as few parts as keep the error of contact
        forces within a tolerance, as in a run.  Within a step, paths and loads are cubics if they are given with their
        rates, {"fly": (s, s')}, at both ends, and straight lines otherwise.  In a frame, second rates that are given
        hold at both ends, too.

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
        """Start the simulation at t = 0; the class describes the arguments and the errors."""
        if not 0.0 < step < np.inf:
            raise InputError("stepper", "step", step, "more than 0 s is allowed")
        if not (isinstance(parts, int) and 0 <= parts <= MOST_PARTS):
            raise InputError("stepper", "parts", parts, f"0 to {MOST_PARTS} are allowed")
        if not 0.0 <= rho_inf < 1.0:
            raise InputError("stepper", "rho_inf", rho_inf, "from 0 to less than 1 is allowed")
        system, scene, moving = prepare_stepping(body if isinstance(body, System) else System.of(body), "stepper")
        form = SystemForm.of(system)
        self._system, self._form, self._step, self._rho_inf = system, form, step, rho_inf
        self._ranges: dict[str, tuple[float, float]] = dict(system.ranges)
        if system.on_one_path:  # a body without a path has a position, too
            (body,) = system.bodies.values()
            self._ranges = dict.fromkeys(system.paths or (SLIDER,), body.domain)
        self._moved = {} if moving is None or moving.computed is None else moving.computed.moved
        self._computed = () if moving is None or moving.computed is None else tuple(moving.computed.outputs)
        if moving is not None and set(moving.paths) != set(self._ranges) - {LUFFING}:
            allowed = f"{', '.join(moving.paths)} are allowed"
            raise InputError("stepper", "paths", ", ".join(self._ranges), allowed)
        kernel = form.kernel if moving is None else Kernel.of(system, form.forms, moving)
        self._ground = tuple(ground_outputs(moving.scene)) if moving is not None and kernel.ground else ()
        #: Names of all that `outputs` chooses from: outputs of the bodies, forces of the contacts, outputs of a hoist,
        #: of a free luffing angle, and of outriggers.
        behind = (*system.hoist.outputs, *self._computed, *self._ground)
        self.output_names = (*system.output_names, *map(force_name, system.contact_names), *behind)
        every = range(len(system.output_names))
        chosen = [number_of(k, self.output_names, "outputs") for k in (every if outputs is None else outputs)]
        settings = Settings(step, rho_inf, *self._levels(parts, scene), energy=False)
        self._state = State(kernel, settings)
        #: names of all motions of a boom in a frame, in the order in which `step` takes them as an array
        self.motion_names = () if moving is None else moving.drivers
        numbers = {name: k for k, name in enumerate((*self.output_names, *self.motion_names))}
        self._limits = LimitCheck(watched_limits(system, numbers), numbers)
        self._bound = bound = BoundStep(self._state, chosen, self._limits.structure if self._limits.limits else None)
        names, of_frame = kernel.names("drivers"), None
        paths, loads = names[: kernel.paths], {name: names.index(name) for name in system.load_names}
        if moving is not None:
            bound.motions[:] = moving.start
            paths, of_frame = moving.paths, (*moving.angles, *moving.axes)
            loads = {name: len(paths) + k for k, name in enumerate(moving.loads)}
            self._ranges = {path: self._ranges[path] for path in paths}
        undivided, of_drivers = settings.parts == (1,), (paths, loads, of_frame)
        self._free = (*self._moved, *([LUFFING] if self._computed and not self._moved else ()))
        self._drivers = Drivers(bound.motions, bound.rows, of_drivers, self._ranges, step, not undivided, self._free)
        self._drivers.take_paths(s)
        self._check_followers()
        if scene is not None and moving is None:
            self._drivers.take_loads(scene.first_loads)
        if F is not None:
            self._drivers.take_loads(F)
        self._drivers.take_frame(frame or {})
        if isinstance(initial, InitialState):
            initial = dict.fromkeys(system.bodies, initial)
        self._start(initial, static=scene is not None and scene.static)
        self._drivers.end_step()
        # taken without `Drivers` in each step: a single load, and a single path if steps are not divided
        self._in_parts, alone = moving is None and not undivided, moving is None and undivided
        self._has_rates = not alone
        low, high = next(iter(self._ranges.values()), (1.0, 0.0))
        self._low, self._high, self._jump = (
            (low, high, JUMP * (high - low)) if alone and len(paths) == 1 else (1.0, 0.0, 0.0)
        )
        self._load = len(paths) if alone and len(loads) == 1 else -1
        self._driver_values: Any = memoryview(bound.motions[0])
        self._same_memory = alone and system.on_one_path and max(chosen, default=0) < len(every)
        self._advance = bound.step_by_rates if self._in_parts else bound.step
        self._advance_all = bound.step_by_all
        self._observe, self._y = bound.observe, bound.values
        self._warn_beyond(self._limits.watch(self._state))

    def step(self, s: Values, F: Values | None = None, frame: Mapping[str, Motion] | None = None) -> Array:
        """Advance by one step.

        Parameters
        ----------
        s : as for the start, m; or array (3, n)
            Path coordinates at the end of the step.  A path may go beyond its end by `pmr.errors.BEYOND_ENDS` of its
            length; it is then taken at the end.  Paths that a mapping leaves out stay where they are.  For a boom in a
            frame, an array (3, n) is fastest, without F and frame: values, rates and second rates of all n motions,
            in the order of `motion_names`.  Columns of motions that are free have no effect.
        F : as for the start, N (gravity m/s^2)
            Loads at the end of the step; a Python float is fastest.  Loads that are not given stay as they are.
        frame : as for the start
            Motion of the frame at the end of the step; motions that are not given stay as they are, with their rates.

        Returns
        -------
        (o,) array
            The chosen outputs, in their units.  The array may be the same in every step: copy values that you keep.

        Raises
        ------
        InputError
            If a path leaves its range or would cross all of the range in a step, an angle other than slewing is more
            than a turn, a number is not finite, the system has no such name, or there is not one load for each input.
            Also if a free luffing angle or a free extension is given.
        SimulationError
            If contacts depend on each other, a search within the step does not end, or a force on the ground is not
            finite: the message names the step, its time and what failed.

        Notes
        -----
        Warnings go to `logging`, each of them once.  One is given for a motion that jumps, or that has no second rate
        in a frame.  Another is given for each limit that is exceeded: of pads, ropes, cylinders, oil, outriggers and
        displacements (`pmr.simulation.native.watched`).
        """
        drivers = self._drivers
        if type(s) is np.ndarray and s.ndim == 2:
            if not self.motion_names or F is not None or frame is not None:
                allowed = "an array of all motions is allowed by itself, for a boom in a frame"
                raise InputError("stepper", "s", s.shape, allowed)
            drivers.take_all(s, self.motion_names)
            failed = self._advance_all()
        else:
            if type(F) is float and self._load >= 0 and F - F == 0.0:  # F - F is NaN unless F is finite
                self._driver_values[self._load] = F
            elif F is not None:
                drivers.take_loads(F)
            if frame is not None:
                if self._computed and not self._moved and LUFFING in frame:
                    allowed = "none is allowed after the start, for the luffing angle is free"
                    raise InputError("stepper", "frame.luffing", frame[LUFFING], allowed)
                drivers.take_frame(frame)
            if type(s) is float and self._low <= s <= self._high and abs(s - self._driver_values[0]) <= self._jump:
                self._driver_values[0] = s
            else:
                if self._moved:
                    self._refuse_moved(s)
                drivers.take_paths(s)
            if self._in_parts:
                drivers.write_rates(self._bound.rates)
            failed = self._advance()
        if failed:
            self._raise_failure(failed, self._step_text(1))
        if self._has_rates:
            drivers.end_step()
        if failed := self._observe():
            if failed > 0:
                self._raise_failure(failed, f"the outputs of {self._step_text(0)}")
            self._warn_beyond(-1 - failed)
        return self._y if self._same_memory else self._y.copy()

    @property
    def outputs(self) -> Array:
        """Values (o,) of all `output_names` at present."""
        values, forces = self._state.outputs()
        behind = (self._state.hoist, self._state.computed, self._state.ground)
        return np.concatenate([values, forces, *behind])

    @property
    def hoist(self) -> dict[str, float]:
        """Outputs of the hoist by the names in `pmr.scene.hoist.OUTPUTS`.

        They are the hook's height and place in m, its swings in rad, the rope's force and its pull on the winch in N.
        The dict is empty if the system has no hoist.
        """
        return dict(zip(OUTPUTS, self._state.hoist.tolist(), strict=False))

    @property
    def luffing(self) -> dict[str, float]:
        """Free luffing angle in rad and its rate, and the quantities of the luffing cylinder, by name.

        The dict is empty if the luffing angle is prescribed.
        """
        return {} if self._moved else self._values_of_computed

    @property
    def extension(self) -> dict[str, float]:
        """Free extension in m with its first and second rate, and the quantities of its cylinder, by name.

        The dict is empty if all extensions are prescribed.
        """
        return self._values_of_computed if self._moved else {}

    @property
    def _values_of_computed(self) -> dict[str, float]:
        """Outputs of a free luffing angle or extension, by name."""
        return dict(zip(self._computed, self._state.computed.tolist(), strict=True))

    @property
    def ground(self) -> dict[str, float]:
        """Force and moment on the ground, forces of outriggers, margins against tipping, use of the polygon, by name.

        Units are those of `pmr.kernel.further.ground_outputs`.  The dict is empty if the scene has no ground.
        """
        return dict(zip(self._ground, self._state.ground.tolist(), strict=True))

    @property
    def time(self) -> float:
        """Time in s since the start."""
        return self._state.step_number * self._step

    @property
    def states(self) -> dict[str, InitialState]:
        """Coordinates of each body and their rates, by the body's name; `initial` takes them to continue from here."""
        return self._form.initial_states(self._state.z, self._state.v)

    @property
    def q(self) -> Array:
        """Coordinates (n,) of the bodies, one body after the other."""
        return np.concatenate([state.q for state in self.states.values()])

    @property
    def v(self) -> Array:
        """Rates (n,) of the coordinates."""
        return np.concatenate([state.v for state in self.states.values()])

    @property
    def multipliers(self) -> Array:
        """Forces (m,) of the contacts in N, positive where they push; a cylinder's force includes pads' friction."""
        return self._state.outputs()[1]

    @property
    def forces(self) -> dict[str, float]:
        """Forces of the contacts by their names, in N, as in `multipliers`."""
        return dict(zip(self._system.contact_names, self.multipliers.tolist(), strict=True))

    @property
    def friction(self) -> dict[str, float]:
        """Friction force of the pads of each joint, in N, by the section that slides; empty without friction."""
        pads = Friction.from_contacts(self._system.contacts)
        if pads is None:
            return {}
        return dict(zip(pads.joints, pads.joint_totals(self._state.friction).tolist(), strict=True))

    @property
    def contact(self) -> float:
        """Time step times the highest frequency of contacts that only push, at any position; 0 without such contacts.

        With `parts` = 1, impacts lose force and energy if the result is above `contact_step.RESOLVED`
        (docs/pads_theory.md).
        """
        return self._step * contact_frequency_within(self._system, self._ranges)

    def _start(self, initial: Mapping[str, InitialState] | None, static: bool) -> None:
        """Set the state to t = 0: to `initial`, or, if that is None, to equilibrium (`static` is true) or to rest.

        Raises InputError for a system that the simulator does not support or nothing holds; SimulationError if a solve
        fails.
        """
        kernel, motions, paths = self._state.kernel, self._bound.motions, self._path_coordinates
        if kernel.motions:
            u = kernel.frame_drivers(motions)
            start = partial(self._state.start_in_frame, motions=motions, rows=self._bound.rows)
        else:
            u, start = motions[0], partial(self._state.start, u=motions[0])
        self._form.refuse_unsupported(self._form.modal.side_coordinates(paths)[None], self._rho_inf)
        try:
            begin(self._form, start, self._constant_excitation(paths, u, static), initial)
        except StepError as error:
            raise self._failure("t = 0 s", error) from None

    def _constant_excitation(self, paths: Mapping[str, float], u: Array, static: bool) -> Excitation:
        """Excitation of one step with constant `paths` in m, loads and amplitudes of terms, by drivers u (N,).

        The excitation starts in equilibrium if `static`, or at rest.
        """
        names, first = (self._system.input_names, self._system.term_names), len(paths)
        split = np.split(u[first : first + len(names[0]) + len(names[1])], [len(names[0])])
        loads, terms = (
            {name: Constant(amount=value) for name, value in zip(of, values.tolist(), strict=True)}
            for of, values in zip(names, split, strict=True)
        )
        still = {path: Constant(amount=s) for path, s in paths.items()}
        stepping = TimeStepping(self._step, self._step, self._rho_inf)
        return Excitation(still, loads, stepping, start="equilibrium" if static else "rest", terms=terms)

    @property
    def _path_coordinates(self) -> dict[str, float]:
        """Coordinates in m of all paths of the system, by name."""
        kernel = self._state.kernel
        if not kernel.motions:
            return self._drivers.path_coordinates
        paths = kernel.names("drivers")[: kernel.paths]
        return dict(zip(paths, kernel.frame_drivers(self._bound.motions)[: kernel.paths].tolist(), strict=True))

    def _levels(self, parts: int, scene: StoredScene | None) -> tuple[tuple[int, ...], float]:
        """Numbers of parts among which a step chooses, and the contact frequency in rad/s.

        The frequency is 0 unless contacts only push and `parts` is 0.  `scene` is the stored scene of the system, None
        if it has none.  Errors as `contact_frequency`.
        """
        modal = self._form.modal
        if np.isnan(modal.clearance).all():
            return (1,), 0.0
        if parts:
            omega = 0.0
        elif scene is None or scene.extends_freely:
            omega = contact_frequency_within(modal, self._ranges)
        else:
            omega = contact_frequency(modal, scene.excitation)
        return part_counts(omega, TimeStepping(self._step, self._step, parts=parts)), omega

    def _refuse_moved(self, s: Values) -> None:
        """Raise InputError if path coordinates `s` are no mapping, or contain a free extension or one that follows."""
        if not isinstance(s, Mapping):
            raise InputError("stepper", "s", None, "a mapping without the free extension is allowed after the start")
        for path in self._moved:
            if path in s:
                allowed = "none is allowed after the start, for the extension is free"
                raise InputError("stepper", f"s.{path}", s[path], allowed)

    def _check_followers(self) -> None:
        """Raise InputError if a section that follows a free extension does not begin where it has to.

        Its extension has to be its ratio times the free extension, plus an offset.
        """
        at = dict(zip(self._drivers.paths, self._bound.motions[0].tolist(), strict=False))
        first = next(iter(self._moved), "")
        for path, (ratio, offset) in self._moved.items():
            needed = ratio * at[first] + offset
            if abs(at[path] - needed) > FOLLOWS * abs(ratio):
                raise InputError("stepper", f"s.{path}", at[path], f"{needed:.9g} m is allowed: it follows {first}")

    def _warn_beyond(self, number: int) -> None:
        """Log warnings that the limit with this number, and further limits if there are any, do not hold.

        A `number` below 0 stands for none.
        """
        while number >= 0:
            logger.warning("%s: %s", self._step_text(0), self._limits.limits[number].message)
            number = self._limits.watch(self._state)

    def _raise_failure(self, failed: int, where: str) -> None:
        """Raise the error that the error code `failed` stands for; `where` names the step."""
        try:
            self._state.raise_unless_done(failed, where)
        except StepError as error:
            raise self._failure(where, error) from None

    def _failure(self, where: str, error: StepError) -> SimulationError:
        """Error of a failed step or start for the user; `where` names the step or time."""
        paths = dict(self._path_coordinates)
        if self._moved and self._state.step_number:
            at = self._values_of_computed[self._computed[0]]
            paths |= {path: ratio * at + offset for path, (ratio, offset) in self._moved.items()}
        where = f"{where}{path_text(tuple(paths), np.array(list(paths.values())))}"
        return step_failure(where, self._form, error, self._form.modal.side_coordinates(paths))

    def _step_text(self, further: int) -> str:
        """Text with number and time of the step that is `further` steps after the last one."""
        number = self._state.step_number + further
        return f"step {number}, t = {number * self._step:g} s"
