"""Exudyn as a simulator, and sliding bodies in Exudyn systems of one's own.

In an mbs of one's own::

    items = add_sliding_body(mbs, ReducedModel.load("reduced.npz"), path, loads)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Literal

import exudyn as exu
import numpy as np
import scipy.sparse as sp

from pmr.scene.signals import SignalBase
from pmr.scene.simulators import refuse
from pmr.simulation import balance
from pmr.simulation.excitation import Excitation, on_path
from pmr.simulation.exudyn.bodies import add_body_with_multipliers, add_called_body, add_updated_body
from pmr.simulation.exudyn.inputs import Inputs, SignalInputs, TabulatedInputs
from pmr.simulation.exudyn.items import SlidingBodyItems, add_pre_step_function
from pmr.simulation.exudyn.solver import change, of_connector, of_nodes, slider_at, solve, solver_settings, stored
from pmr.simulation.needs import needs_of, needs_on
from pmr.simulation.start import InitialState, consistent_start
from pmr.simulation.stepping import Progress
from pmr.system.body import SlidingBody, Trajectory
from pmr.system.compliant_rows import CompliantRows

__all__ = ["Formulation", "SlidingBodyItems", "add_pre_step_function", "add_sliding_body", "simulate"]

#: How Exudyn knows the rows and loads of a body (`pmr.simulation.exudyn.bodies`).
#: ``springs``: set once a step; rows that give way, at a pad or by a residual flexibility, are no constraints but
#: springs that travel with the slider.  ``multipliers``: the same with a constraint and its multiplier for every row.
#: ``callbacks``: the paper's way, Python is called in every iteration.  ``callbacks-modified-newton``: the same, but a
#: Jacobian is kept as long as Newton's method converges with it.
Formulation = Literal["springs", "multipliers", "callbacks", "callbacks-modified-newton"]
AddItems = Callable[[Any, SlidingBody, Inputs, InitialState], SlidingBodyItems]
#: Its name as a simulator of a scene, and what adds its items.
_FORMULATIONS: dict[Formulation, tuple[str, AddItems]] = {
    "springs": ("exudyn", add_updated_body),
    "multipliers": ("exudyn-multiplier", add_body_with_multipliers),
    "callbacks": ("exudyn-callback", add_called_body),
    "callbacks-modified-newton": ("exudyn-callback", add_called_body),
}


def add_sliding_body(
    mbs: Any,
    body: SlidingBody,
    path: SignalBase,
    loads: Mapping[str, SignalBase],
    initial: InitialState | None = None,
    formulation: Formulation = "springs",
) -> SlidingBodyItems:
    """Add a sliding body whose rows and loads are set once a step, or as another `Formulation` has it.

    Rows that give way, at a pad or by the residual flexibility of a reduced model, become springs that travel with the
    slider: stiffness and force vector are set once a step, and there is no constraint (`pmr.system.compliant_rows`,
    which also recovers their multipliers).  ``multipliers`` gives the same trajectory at a higher cost, for comparison
    or where other connectors are to see the multiplier: the output variable Force of ``oSlider``.  ``callbacks``,
    which knows no rows that give way, costs ten times as much.

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
    body, initial
        As for `pmr.simulation.Simulator`.  A velocity that violates the rows is corrected M-orthogonally.  What is
        attached to its coordinates feels the flexibility that these have: all of it at the model's `ports`, elsewhere
        without the residual part.
    path : signal
        Slider path s(t) in m.
    loads : mapping of str to signal
        A load in N (or N m) for each of the body's inputs, by its name.

    Raises
    ------
    InputError
        If a load is missing, a size is wrong, the path begins off the body or the initial position violates the rows.
    """
    begin = np.zeros(1)
    s = float(on_path(path, path.value(begin), body.domain, begin)[0])
    name, add = _FORMULATIONS[formulation]
    refuse(name, needs_of(body, s))
    start = consistent_start(body, s, float(path.rate(0.0)), initial)
    return add(mbs, body, SignalInputs(body, path, loads), start)


def simulate(
    body: SlidingBody,
    excitation: Excitation,
    initial: InitialState | None = None,
    progress: Progress | None = None,
    formulation: Formulation = "springs",
) -> Trajectory:
    """Simulate a reduced (dense) or full (sparse) body; rows and loads are set once a step.

    Rows that give way, at a pad or by a residual flexibility, are no constraints but springs that travel with the
    slider (`pmr.system.compliant_rows`); of a sparse body they keep their multiplier.  All formulations follow the same
    trajectory, to Newton's tolerance; those with callbacks refuse rows that give way.

    Arguments and errors as for `pmr.simulation.Simulator`; the option `newton` of the excitation holds Exudyn's
    settings of Newton's method by their own names.  The initial accelerations are Exudyn's, which leave
    out what moving rows add to them (2 s' C' v and more): exact where the slider starts at rest, or the body
    undeformed and still; the method stays of second order elsewhere.
    """
    name, add = _FORMULATIONS[formulation]
    refuse(name, needs_on(body, excitation))
    inputs, stepping = TabulatedInputs(body, excitation), excitation.stepping
    start = consistent_start(body, inputs.position(0.0), float(excitation.path_rate[0]), initial)
    container = exu.SystemContainer()  # owns the mbs: must stay alive
    mbs = container.AddSystem()
    items = add(mbs, body, inputs, start)
    kind = exu.OutputVariableType
    of_body = [of_nodes(mbs, [items.nBody], which)[0] for which in (kind.Coordinates, kind.Coordinates_t)]
    connectors = ([] if items.oSlider is None else [items.oSlider]) + list(items.oSupports)
    sensors = [*of_body, *(of_connector(mbs, connector) for connector in connectors)]
    linear_solver = exu.LinearSolverType.EigenSparse if sp.issparse(body.K) else exu.LinearSolverType.EigenDense
    chosen = solver_settings(stepping, linear_solver)
    chosen.timeIntegration.newton.useModifiedNewton = formulation == "callbacks-modified-newton"
    change(chosen.timeIntegration.newton, excitation.options.newton)
    place = slider_at(inputs.position)
    seconds = solve(mbs, chosen, place, progress)
    q, v, *forces = (stored(mbs, sensor, stepping, place) for sensor in sensors)
    multipliers, held = np.empty((len(q), len(body.row_names))), [*items.rows, *body.held]
    if held:
        multipliers[:, held] = np.hstack(forces)
    compliant = CompliantRows(body)
    if rest := [i for i in compliant.numbers if i not in held]:
        multipliers[:, rest] = compliant.multipliers(inputs.s, q, inputs.f)
    found = Trajectory(t=excitation.times, q=q, v=v, multipliers=multipliers, s=inputs.s, seconds=seconds)
    return balance.checked(body, found, inputs.f, "Exudyn")
