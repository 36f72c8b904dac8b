"""Exudyn as a simulator, and systems of reduced bodies in Exudyn systems of one's own.

In an mbs of one's own::

    items = add_system(mbs, system, paths, loads)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from pmr.errors import InputError
from pmr.scene.simulators import refuse
from pmr.simulation.excitation import Excitation
from pmr.simulation.exudyn.base_items import with_base
from pmr.simulation.exudyn.drawing import add_drawing
from pmr.simulation.exudyn.equations import Equations
from pmr.simulation.exudyn.extending import add_extended
from pmr.simulation.exudyn.formulations import FORMULATIONS, Formulation
from pmr.simulation.exudyn.free_base import Base, OnBody, driven_by_base, terms_on_base
from pmr.simulation.exudyn.hook import Hook, add_hook
from pmr.simulation.exudyn.inputs import Driving, SignalInputs
from pmr.simulation.exudyn.items import SystemItems, add_pre_step_function
from pmr.simulation.exudyn.paths import NodeCoordinate
from pmr.simulation.exudyn.quasi_static import with_quasi_static
from pmr.simulation.exudyn.run import Run
from pmr.simulation.exudyn.sensors import SystemSensors, add_sensors
from pmr.simulation.exudyn.terms import with_terms
from pmr.simulation.free_base import with_all_inertia
from pmr.simulation.start import InitialState
from pmr.simulation.stepping import Progress
from pmr.system.body import SlidingBody
from pmr.system.contacts import ALONE, SLIDER
from pmr.system.system import System, SystemTrajectory

__all__ = [
    "Formulation",
    "Hook",
    "NodeCoordinate",
    "OnBody",
    "SystemItems",
    "SystemSensors",
    "add_drawing",
    "add_hook",
    "add_pre_step_function",
    "add_sensors",
    "add_sliding_body",
    "add_system",
    "simulate_system",
]


def add_system(
    mbs: Any,
    system: System,
    paths: Mapping[str, Driving],
    loads: Mapping[str, Driving],
    initial: Mapping[str, InitialState] | None = None,
    formulation: Formulation = "springs",
    terms: Mapping[str, Driving] | None = None,
    on: OnBody | None = None,
) -> SystemItems:
    """Add a system whose rows and loads are set once a step, or as another `Formulation` has it.

    Contacts that give way, at a pad or by the residual flexibility of reduced models, become springs that travel:
    stiffness and force vector are set once a step, and there is no constraint.  Where some only push, Python is called
    in every iteration.  ``multipliers`` gives the same trajectory at a higher cost, for comparison or where other
    connectors are to see the multipliers: the output variable Force of ``oContacts``.  ``callbacks``, which knows no
    contacts that give way, costs ten times as much.

    Exudyn calls the pre-step function with the time at the *end* of the step, where its generalized-alpha
    (Arnold and Bruels 2007) fulfils both equations: setting C(s) and B f once a step is exact, and no Python
    is called within it.  The time integration must start at t = 0; before solving the same mbs a second time,
    call ``update(mbs, 0.0)``.

    Parameters
    ----------
    mbs : exudyn.MainSystem
        A pre-step function that is already set stays in place and is called first.  One that is set later with
        ``mbs.SetPreStepUserFunction`` replaces the update and is refused in the first step (but where Newton's method
        differentiates numerically): use `add_pre_step_function`.  Explicit solvers, and index 2 where rigid rows move,
        are refused in ``mbs.SolveDynamic``.
    system : System
        `System.of` a body alone, or the bodies of a boom.
    paths : mapping of str to signal or function
        Path coordinates in m, by the names in ``system.paths``; a function of mbs and t in s may read
        ``mbs.variables``, which an earlier pre-step function has set.  With ``on`` also a `NodeCoordinate`, whose node
        then feels the section: loads along it, weight, inertia, and what pads are pressed with.
    loads : mapping of str to signal or function
        A load in N (or N m) for each of ``system.input_names``.
    initial : mapping of str to InitialState, optional
        Of each body; those that are missing start at rest, undeformed.  Of a body alone a velocity that violates the
        rows is corrected M-orthogonally, for which a path that is a function counts as at rest.  What is attached to
        coordinates feels the flexibility that these have: all of it at a model's `ports`, elsewhere without the
        residual part.
    terms : mapping of str to signal or function
        An amplitude for each of ``system.term_names``.
    on : OnBody, optional
        A rigid body of the mbs that carries the boom and feels it, by default the ground.  Inertia, weight and terms
        follow from its motion: neither loads ``inertia ...`` nor `terms` are given.  A path that is a function is asked
        for half a step to either side of t, for its rates: it must not depend on what the mbs has computed by then.

    Raises
    ------
    InputError
        If a path, load or amplitude is missing, a size is wrong, a path begins off a body or a position violates a
        rigid contact.
    """
    equations = Equations(system if on is None else with_all_inertia(system))
    if on is not None:
        loads, terms = driven_by_base(system, loads), terms_on_base(loads, paths, on)
    inputs = SignalInputs(mbs, equations, paths, loads, terms or {})
    name, add = FORMULATIONS[formulation]
    if free := [path for path, driving in paths.items() if isinstance(driving, NodeCoordinate)]:
        if on is None or formulation != "springs":
            allowed = "a coordinate of a node is allowed for a boom on a rigid body (on), with the formulation springs"
            raise InputError("system", f"paths.{free[0]}", "NodeCoordinate", allowed)
        system.ensure_frictionless("system, an extension that is a coordinate")
        add = add_extended
    refuse(name, equations.needs(inputs.at(0.0)))
    items = add(mbs, equations, inputs, equations.start(inputs.s, inputs.rates, initial or {}))
    items = with_terms(mbs, with_quasi_static(mbs, items, equations), equations, inputs)
    if on is not None:
        items = with_base(mbs, items, Base(mbs, equations, inputs, paths, on), inputs)
    return replace(items, equations=equations, inputs=inputs)


def add_sliding_body(
    mbs: Any,
    body: SlidingBody,
    path: Driving,
    loads: Mapping[str, Driving],
    initial: InitialState | None = None,
    formulation: Formulation = "springs",
) -> SystemItems:
    """Add a body alone: `add_system` of ``System.of(body)`` on its path."""
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

    All formulations follow the same trajectory, to Newton's tolerance; what one of them can't do it refuses.  The
    option `newton` of the excitation holds Exudyn's settings of Newton's method by their own names.  The initial
    accelerations are Exudyn's, which leave out what moving rows add to them (2 s' C' v and more): exact where places
    start at rest, or bodies undeformed and still; the method stays of second order elsewhere.  A contact that only
    pushes lets go as Exudyn's generalized-alpha has it: what its force leaves in the next step is not taken back, so
    that the motion is the compiled one's in the limit of small steps.
    """
    return Run(system, excitation, initial or {}, formulation).trajectory(progress)
