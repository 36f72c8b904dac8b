"""Exudyn as a simulator; also adds systems of reduced bodies to a user's own Exudyn system.

In an mbs of one's own::

    items = add_system(mbs, system, paths, loads)

`SystemRun` is one simulation of a system in Exudyn.
"""

from __future__ import annotations

from collections.abc import Mapping

import exudyn as exu
import numpy as np

from pmr.errors import InputError
from pmr.files.arrays import Array
from pmr.scene.choice import refuse_unsupported
from pmr.scene.frame import INERTIA
from pmr.scene.signals import Constant
from pmr.simulation.contact_step import StepParts, contact_frequency, with_schedule
from pmr.simulation.excitation import Excitation
from pmr.simulation.exudyn.contacts import Balance, Contacts, Motion, Pads, balance_energy
from pmr.simulation.exudyn.equations import Driving, Equations, NodeCoordinate, SignalInputs, TabulatedInputs
from pmr.simulation.exudyn.formulations import ADD_BY, Formulation
from pmr.simulation.exudyn.free_base import Base, OnBody, add_without_contacts, terms_on_base, with_base
from pmr.simulation.exudyn.items import (
    SystemItems,
    add_force_sensor,
    add_node_sensors,
    rates,
    with_quasi_static,
    with_terms,
)
from pmr.simulation.exudyn.solver import read_sensor, solve, solver_settings
from pmr.simulation.free_base import with_all_inertia
from pmr.simulation.modal import LARGEST
from pmr.simulation.native import systems
from pmr.simulation.native.form import path_text
from pmr.simulation.start import InitialState
from pmr.simulation.stepping import Progress, energy_round_off, energy_surplus, refuse_growth
from pmr.system.body import SlidingBody
from pmr.system.contacts import ALONE, SLIDER, Friction
from pmr.system.states import SystemTrajectory
from pmr.system.system import System


def add_system(
    mbs: exu.MainSystem,
    system: System,
    paths: Mapping[str, Driving],
    loads: Mapping[str, Driving],
    initial: Mapping[str, InitialState] | None = None,
    formulation: Formulation = "springs",
    terms: Mapping[str, Driving] | None = None,
    on: OnBody | None = None,
) -> SystemItems:
    """Add a system to an mbs, with contact rows and loads set once a step, or by another `formulation`.

    Contacts that give way, at a pad or by the residual flexibility of reduced models, become springs that travel:
    stiffness and force vector are set once a step, and there is no constraint.  If some only push, Python is called in
    every iteration.  ``multipliers`` gives the same trajectory at a higher cost, for comparison or if other connectors
    need the multipliers: the output variable Force of ``oContacts``.  ``callbacks``, which supports no contacts that
    give way, costs ten times as much.

    Exudyn calls the pre-step function with the time at the *end* of the step, where its generalized-alpha (Arnold and
    Bruels 2007) fulfils both equations: setting C(s) and B f once a step is exact, and no Python is called within it.
    The time integration must start at t = 0; before solving the same mbs a second time, call ``update(mbs, 0.0)``.

    Parameters
    ----------
    mbs : exudyn.MainSystem
        A pre-step function that is already set stays in place and is called first.  One that is set later with
        ``mbs.SetPreStepUserFunction`` replaces the update and is refused in the first step (unless Newton's method
        differentiates numerically): use `pmr.simulation.exudyn.items.add_pre_step_function`.  Explicit solvers, and
        index 2 if rigid rows move, are refused in ``mbs.SolveDynamic``.
    system : System
        `System.of` a single body, or the bodies of a boom.
    paths : mapping of str to signal or function
        Path coordinates in m, by the names in ``system.paths``; a function of mbs and t in s may read
        ``mbs.variables``, which an earlier pre-step function has set.  With `on` a path may also be a `NodeCoordinate`;
        the node then feels the section by loads along it, weight, inertia, and the forces of pads.
    loads : mapping of str to signal or function
        A load in N (or N m) for each of ``system.input_names``.
    initial : mapping of str to InitialState, optional
        Initial state of each body; bodies that are missing start at rest, undeformed.  A velocity of a single body that
        violates the rows is corrected M-orthogonally, for which a path that is a function counts as at rest.
        Connectors on coordinates feel the flexibility of these coordinates: at the model's ports (`ReducedModel.ports`)
        all of it, elsewhere without the residual part.
    formulation : str
        ``springs``, ``multipliers``, ``callbacks`` or ``callbacks-modified-newton``.
    terms : mapping of str to signal or function
        An amplitude for each of ``system.term_names``.
    on : OnBody, optional
        A rigid body of the mbs that carries the boom and feels it, by default the ground.  Inertia, weight and terms
        follow from its motion: neither loads ``inertia ...`` nor `terms` are given.  A path that is a function is
        evaluated half a step before and after t, for its rates: it must not depend on what the mbs has computed by
        then.

    Returns
    -------
    SystemItems
        Numbers of the items.

    Raises
    ------
    InputError
        If a path, load or amplitude is missing, a size is wrong, a path begins off a body or a position violates a
        rigid contact.
    """
    equations = Equations(system if on is None else with_all_inertia(system))
    if on is not None:
        terms = terms_on_base(loads, paths, on)
        inertia_inputs = [name for name in system.input_names if INERTIA in name]  # the base adds the boom's inertia
        loads = dict(loads) | dict.fromkeys(inertia_inputs, Constant(amount=0.0))
    inputs = SignalInputs(mbs, equations, paths, loads, terms or {})
    name, add = ADD_BY[formulation]
    if free := [path for path, driving in paths.items() if isinstance(driving, NodeCoordinate)]:
        if on is None or formulation != "springs":
            allowed = "a coordinate of a node is allowed for a boom on a rigid body (on), with the formulation springs"
            raise InputError("system", f"paths.{free[0]}", "NodeCoordinate", allowed)
        system.ensure_frictionless("system, an extension that is a coordinate")
        add = add_without_contacts
    refuse_unsupported(name, equations.needs(inputs.positions(0.0)))
    items = add(mbs, equations, inputs, equations.start(inputs.s, inputs.rates, initial or {}))
    items = with_terms(mbs, with_quasi_static(mbs, items, equations), equations, inputs)
    return items if on is None else with_base(mbs, items, Base(mbs, equations, inputs, paths, on), inputs)


def add_sliding_body(
    mbs: exu.MainSystem,
    body: SlidingBody,
    path: Driving,
    loads: Mapping[str, Driving],
    initial: InitialState | None = None,
    formulation: Formulation = "springs",
) -> SystemItems:
    """Add a system of a single body on its `path`; the other arguments and errors are those of `add_system`.

    `initial` is the body's initial state; None stands for rest without deformation.
    """
    system, start = System.of(body), {} if initial is None else {ALONE: initial}
    return add_system(mbs, system, {SLIDER: path}, loads, start, formulation)


def simulate_system(
    system: System,
    excitation: Excitation,
    initial: Mapping[str, InitialState] | None = None,
    progress: Progress | None = None,
    formulation: Formulation = "springs",
) -> SystemTrajectory:
    """Simulate bodies that contacts join; arguments and errors as `pmr.simulation.SystemSimulator`.

    `formulation` is as for `add_system`.  All formulations follow the same trajectory, to Newton's tolerance; each
    refuses what it can't do.  The option `newton` of the excitation holds Exudyn's settings of Newton's method by their
    own names.

    The initial accelerations are Exudyn's, which leave out the terms of moving rows (2 s' C' v and more).  These
    accelerations are exact if the paths start at rest, or if the bodies start undeformed and at rest.  Otherwise they
    are not exact, but the method is still of second order.  A contact that only pushes opens as in Exudyn's
    generalized-alpha: the effect of its force on the next step is not removed.  So the motion agrees with the compiled
    one in the limit of small steps.
    """
    start = systems.start_of(system, excitation) if initial is None else initial
    return SystemRun(system, excitation, start, formulation).trajectory(progress)


def step_parts(system: System, excitation: Excitation, initial: Mapping[str, InitialState]) -> StepParts:
    """Numbers of parts into which steps are divided: 1 for each step, unless contacts only push.

    If contacts only push, they are the numbers that the excitation states.  If it states none, the compiled simulator
    chooses them by a run from the `initial` states.  If the bodies are too large for this simulator, a step has enough
    parts to resolve the contacts.  Raises the errors of `contact_frequency` and of this run.
    """
    if np.isnan(system.clearance).all():
        return StepParts.for_contacts(excitation.stepping, 0.0)
    omega, stepping = contact_frequency(system, excitation), excitation.stepping
    chosen = stepping.parts or stepping.schedule
    if omega and not chosen and max(body.size for body in system.bodies.values()) <= LARGEST:
        stepping = with_schedule(stepping, systems.simulate(system, excitation, initial).parts, omega)
    return StepParts.for_contacts(stepping, omega)


class SystemRun:
    """Simulation of a system under an excitation; steps are divided as `step_parts` says."""

    def __init__(
        self, system: System, excitation: Excitation, initial: Mapping[str, InitialState], formulation: Formulation
    ) -> None:
        """Add the system to a new mbs in a `formulation`, in the states `initial` of bodies by name.

        The excitation has paths, loads and time steps.  Raises InputError for systems and options that Exudyn can't
        simulate.
        """
        self.system, self._excitation, self._formulation = system, excitation, formulation
        self._equations, self._friction = Equations(system), Friction.from_contacts(system.contacts)
        name, add = ADD_BY[formulation]
        self._needs = self._equations.needs(self._equations.side_positions(excitation), excitation.stepping.rho_inf)
        refuse_unsupported(name, self._needs)
        self._lengths = step_parts(system, excitation, initial)
        self._inputs = TabulatedInputs(self._equations, excitation, self._lengths)
        s, rates = (dict(zip(excitation.paths, at[0].tolist(), strict=True)) for at in (excitation.s, excitation.rates))
        start = self._equations.start(s, rates, initial)
        self._container = exu.SystemContainer()  # owns the mbs: must stay alive
        self._mbs = self._container.AddSystem()
        items = add(self._mbs, self._equations, self._inputs, start)
        items = with_quasi_static(self._mbs, items, self._equations)
        self._items = with_terms(self._mbs, items, self._equations, self._inputs)
        kind, nodes = exu.OutputVariableType, list(self._items.nBodies.values())
        self._of_nodes = [add_node_sensors(self._mbs, nodes, which) for which in (kind.Coordinates, kind.Coordinates_t)]
        connector = self._items.oContacts
        self._of_contacts = None if connector is None else add_force_sensor(self._mbs, connector)

    def trajectory(self, progress: Progress | None) -> SystemTrajectory:
        """Take all steps and return the trajectory; to be called once.

        `progress`, if not None, is called with the share of the run that is done.  Errors as
        `pmr.simulation.SystemSimulator`.  An InputError is also raised if Exudyn refuses a setting of Newton's method.
        """
        linear = exu.LinearSolverType.EigenSparse if self._equations.sparse else exu.LinearSolverType.EigenDense
        chosen = solver_settings(self._excitation.stepping.divide(self._lengths.finest), linear)
        chosen.timeIntegration.numberOfSteps = self._lengths.steps
        chosen.timeIntegration.newton.useModifiedNewton = self._formulation == "callbacks-modified-newton"
        # Overwrite Exudyn's settings `newton` of Newton's method by the `settings` of the same names, in place
        names = [
            name
            for name, value in chosen.timeIntegration.newton.GetDictionary().items()
            if not isinstance(value, Mapping)
        ]
        for name, value in self._excitation.options.newton.items():
            if name not in names:
                raise InputError("scene", f"simulation.newton.{name}", value, f"one of {', '.join(names)} is allowed")
            try:
                setattr(chosen.timeIntegration.newton, name, value)
            except exu.ExudynError as error:
                raise InputError("scene", f"simulation.newton.{name}", value, str(error).splitlines()[0]) from None
        times = self._lengths.times if np.ptp(self._lengths.parts) else None
        seconds = solve(self._mbs, chosen, self._describe, progress, times)
        motion, contacts = self._motion(), Contacts(self._equations, self._inputs)
        if self._friction is not None:
            motion = Pads(self._equations, contacts, self._friction).add_friction(motion, self._lengths.times)
        balanced = balance_energy(self._equations, contacts, motion)
        return self._trajectory(motion, balanced, seconds)

    def _describe(self, t: float) -> str:
        """Text with the coordinates of the paths at t s, to append to a message."""
        paths = self._excitation.paths
        return path_text(tuple(paths), np.array([path.value(t) for path in paths.values()]))

    def _motion(self) -> Motion:
        """Motion that the sensors stored, with zeros in place of the forces of contacts without multipliers."""
        q, v = (np.hstack([self._sensor_values(sensor) for sensor in sensors]) for sensors in self._of_nodes)
        forces = np.zeros((len(q), len(self.system.contacts)))
        if self._of_contacts is not None:
            forces[:, self._items.contacts] = self._sensor_values(self._of_contacts)
        v = rates(self._equations, self._lengths.times, q, v)
        none = np.zeros((len(q), 0))
        return Motion(self._inputs.x, q, v, self._inputs.f, forces, self._inputs.c, none, none, none)

    def _sensor_values(self, sensor: exu.SensorIndex) -> Array:
        """Values (N, c) of the c quantities of a sensor at t = 0 and at the ends of all parts of steps, N in all.

        Errors as `read_sensor`.
        """
        return read_sensor(self._mbs, sensor, self._lengths, self._describe)

    def _trajectory(self, motion: Motion, balanced: Balance, seconds: float) -> SystemTrajectory:
        """Trajectory at the steps, from the motion at the ends of all parts of steps.

        `balanced` has the energy and work at these ends, and `seconds` is the wall time in s.  Raises GrowthError if
        the motion grows without bound.
        """
        system, ends, parts = self.system, self._lengths.ends, self._lengths.parts
        pushes, t = ~np.isnan(system.clearance), self._excitation.times
        B, inertia = self._equations.B, self._equations.assembly.M.diagonal()
        least = energy_round_off(B.T @ (B / inertia[:, None]), motion.f, float(t[1]))
        surplus = energy_surplus(balanced.stored, balanced.work, least, since_start=bool(pushes.any()))
        refuse_growth(surplus, list(self._needs.rigid_moving_rows))
        within = np.maximum.reduceat(motion.forces[1:], ends[:-1], axis=0)
        of_body = self._equations.assembly.body_coordinates
        states = {name: (of_body(name, motion.q[ends]), of_body(name, motion.v[ends])) for name in system.bodies}
        return SystemTrajectory.from_states(
            system,
            t,
            states,
            motion.x[ends],
            motion.forces[ends],
            np.vstack([motion.forces[:1], within]),
            np.array([balanced.stored[ends], balanced.work[ends]]),
            None if self._friction is None else motion.friction[ends],
            loads=motion.f[ends],
            seconds=seconds,
            surplus=surplus,
            parts=np.concatenate([[1], parts]),
            amplitudes=motion.c[ends] if system.terms else None,
            rates=self._excitation.rates,
        )
