"""Three ways to represent the contacts and loads of a system in Exudyn.

Springs: rows and loads are set once a step; contacts that give way are no constraints but springs that travel, with the
stiffness ``K(s) = K + C^T F^-1 C`` by their rows C and flexibility F at the path position s.  If some contacts only
push, Python is called in every iteration for the forces of all contacts that give way; the kernel finds the closed
contacts (`pmr.kernel.laws`), and Newton's method uses their stiffness.  Multipliers: contacts that give way have
multipliers, for comparison.  Callbacks: as in Weyrer et al., Python is called for rows, their Jacobian and loads in
every iteration, for comparison.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Literal, NamedTuple, TypeAlias

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
import scipy.sparse as sp

from pmr.files.arrays import Array
from pmr.simulation.exudyn.contacts import Contacts, PadRows, Pads
from pmr.simulation.exudyn.equations import Equations, Inputs
from pmr.simulation.exudyn.items import Steps, SystemItems, add_bodies, add_coordinates, with_contacts
from pmr.simulation.start import InitialState
from pmr.system.contacts import Friction
from pmr.system.states import ContactRows

Start = Mapping[str, InitialState]

#: How Exudyn gets the contacts and loads of a system.
#: ``springs``: set once a step; contacts that give way, by a pad's stiffness or by residual flexibility, are no
#: constraints but springs that travel.  ``multipliers``: the same with a constraint and its multiplier for every
#: contact.  ``callbacks``: Python is called in every iteration (Weyrer et al.).  ``callbacks-modified-newton``: the
#: same, but a Jacobian is kept as long as Newton's method converges with it.
Formulation = Literal["springs", "multipliers", "callbacks", "callbacks-modified-newton"]
AddItems: TypeAlias = Callable[[exu.MainSystem, Equations, Inputs, Start], SystemItems]


def add_with_springs(mbs: exu.MainSystem, equations: Equations, inputs: Inputs, start: Start) -> SystemItems:
    """Add the items of a system in the states `start`; contact rows, travelling springs and loads are set once a step.

    A sparse system with contacts that give way, but without any that only push or rub, is added by
    `add_with_multipliers` instead: springs would fill the sparse stiffness anew in every step.
    """
    n = equations.size
    contacts = Contacts(equations, inputs)
    friction = Friction.from_contacts(equations.system.contacts)
    springs = bool(contacts.gives.any()) and not contacts.any_pushes and friction is None
    if springs and equations.sparse:
        return add_with_multipliers(mbs, equations, inputs, start)
    rigid = np.flatnonzero(contacts.rigid)
    rows = inputs.function_of_time(lambda x: equations.rows(x).C[:, rigid])
    system = inputs.function_of_time(contacts.springs)

    def force(t: float) -> Array:
        """Force vector (n,) at t s."""
        B = system(t)[:, n:] if springs else equations.B
        return np.asarray(B @ inputs.values_at(t).loads)

    steps, parameters = Steps(held=bool(len(rigid))), dict[str, Any](forceVector=force(0.0))
    finish: Callable[[exu.MainSystem, SystemItems, float], None] | None = None
    if friction is not None or contacts.any_pushes:
        pads = Pads(equations, contacts, friction)
        contact_parameters, finish = _contact_functions(pads, equations, inputs, steps, start)
        parameters |= contact_parameters
    else:
        parameters["jacobianUserFunction"] = zero_jacobian(equations, steps)
    K = system(0.0)[:, :n] if springs else None
    items = with_contacts(
        mbs, add_bodies(mbs, equations, inputs, start, K, **parameters), rigid, scalingMarker1=rows(0.0)
    )
    items = items if friction is None else replace(items, parts=replace(items.parts, rubbing=pads))
    place_set = inputs.values_at(0.0).number

    def update(mbs: exu.MainSystem, t: float) -> bool:
        """Pre-step function: set rows, stiffness and forces to those at t."""
        nonlocal place_set
        if finish is not None:
            finish(mbs, items, t)
        inputs.begin(t)
        changes, place_set = inputs.values_at(t).number != place_set, inputs.values_at(t).number
        if changes and len(rigid):
            mbs.SetObjectParameter(items.oContacts, "scalingMarker1", rows(t))
        if changes and springs:
            mbs.SetObjectParameter(items.oSystem, "stiffnessMatrix", system(t)[:, :n])
        mbs.SetObjectParameter(items.oSystem, "forceVector", force(t))
        return True

    return steps.attach_update(mbs, items, update)


class ContactFunctions(NamedTuple):
    """User functions of ObjectGenericODE2 by name, and a function to be called before each step."""

    parameters: dict[str, Any]
    finish: Callable[[exu.MainSystem, SystemItems, float], None]


def _contact_functions(
    pads: Pads, equations: Equations, inputs: Inputs, steps: Steps, start: Start
) -> ContactFunctions:
    """Return the user functions of ObjectGenericODE2 for `pads`, contacts that push or rub, and a function `finish`.

    ``finish(mbs, items, t)`` is to be called before each step, with the time t in s at which that step will end.  It
    ends the friction of the step before.  At t = 0 it begins friction anew in the bodies' states `start`.  It does
    nothing if contacts do not rub.

    The user function for the Jacobian raises an InputError (``steps.check``) if rows and loads were not set for its
    step.
    """
    stored_rows: tuple[int, PadRows] | None = None
    begun = np.concatenate([state.q for state in start.values()])
    reached, loads = 0.0, inputs.values_at(0.0).loads

    def rows(t: float) -> PadRows:
        """Rows of the contacts at t s, computed once for each position."""
        nonlocal stored_rows
        place = inputs.values_at(t).number
        if stored_rows is None or stored_rows[0] != place:
            stored_rows = place, pads.rows(inputs.positions(t))
        return stored_rows[1]

    def begin(q: Array) -> None:
        """Set the state at t = 0, with coordinates q (n,)."""
        pads.begin(rows(0.0), q, inputs.values_at(0.0).loads + pads.inertia(0.0))

    def force(mbs: exu.MainSystem, t: float, item: int, q: Array, q_t: Array) -> Array:
        """User function: forces (n,) of the contacts on the coordinates q (n,)."""
        at, inertia = rows(t), pads.inertia(t)
        if t <= 0.0:  # when Exudyn computes the accelerations at the start
            begin(np.asarray(q))
        state = pads.state(at, np.asarray(q), inputs.values_at(t).loads + inertia, t)
        # the response of contacts to inertia is in the mass of base and coordinates
        return state.w - at.giving.C.T @ (state.multipliers[pads.gives] - pads.answers(at, inertia))

    def jacobian(
        mbs: exu.MainSystem, t: float, item: int, q: Array, q_t: Array, factor: float, factor_t: float
    ) -> exu.MatrixContainer:
        """User function: stiffness of the contacts at the coordinates q (n,), times `factor`."""
        steps.check(t)
        at = rows(t)
        state = pads.state(at, np.asarray(q), inputs.values_at(t).loads + pads.inertia(t), t)
        return equations.matrix(factor * pads.stiffness(at, state))

    def finish(mbs: exu.MainSystem, items: SystemItems, t: float) -> None:
        """End the friction of the last step, before the step to t begins, which starts from this friction.

        At t = 0 friction begins anew.
        """
        nonlocal reached, loads
        if pads.law is None:
            return
        if t <= 0.0:  # when a simulation is repeated
            reached = 0.0
            begin(begun)
            return
        q = items.coordinates(mbs)
        if reached > 0.0:
            pads.end(rows(reached), q, loads + pads.inertia(reached), reached)
        else:
            begin(q)
        reached, loads = t, inputs.values_at(t).loads

    begin(begun)
    return ContactFunctions({"forceUserFunction": force, "jacobianUserFunction": jacobian}, finish)


def add_with_multipliers(mbs: exu.MainSystem, equations: Equations, inputs: Inputs, start: Start) -> SystemItems:
    r"""Add the items of a system in the states `start`, with constraints for all contacts, flexible ones too.

    Each contact has a coordinate w without mass:

    .. math:: C q + H f - F w = 0 \quad (\lambda), \qquad F w - F \lambda = 0

    so that w = lambda in N.  Rigid contacts have w = 0.  Without contacts, multipliers are not needed.
    """
    if not equations.system.contacts:
        return add_with_springs(mbs, equations, inputs, start)
    contacts, m = Contacts(equations, inputs), len(equations.system.contacts)
    gives, rigid = np.flatnonzero(contacts.gives), np.diag(contacts.rigid.astype(float))

    def rows(t: float) -> ContactRows:
        """Rows of all contacts at t s."""
        return equations.rows(inputs.positions(t)).at_time(0)

    def constraint(at: ContactRows, loads: Array) -> dict[str, Array]:
        """Parameters of the connector with the rows `at` a time, under `loads` (i,)."""
        return {"scalingMarker0": at.F, "scalingMarker1": at.C, "offset": -at.H @ loads}

    at, loads = rows(0.0), inputs.values_at(0.0).loads
    q, forces = np.concatenate([state.q for state in start.values()]), np.zeros(m)
    forces[gives] = np.linalg.solve(at.F[np.ix_(gives, gives)], (at.C @ q + at.H @ loads)[gives])
    steps = Steps(held=bool(m))
    jacobian, force = zero_jacobian(equations, steps), equations.B @ loads
    items = add_bodies(mbs, equations, inputs, start, forceVector=force, jacobianUserFunction=jacobian)
    name = items.component_name(mbs, "Rows")
    nRows = add_coordinates(mbs, name, InitialState(forces, np.zeros(m)))
    nothing = exu.MatrixContainer(np.zeros((m, m)))
    oRows = mbs.AddObject(
        eii.ObjectGenericODE2(
            name=name,
            nodeNumbers=[nRows],
            massMatrix=rigid,
            stiffnessMatrix=at.F + rigid,
            jacobianUserFunction=lambda *arguments: nothing,
        )
    )
    mRows = mbs.AddMarker(eii.MarkerNodeCoordinates(name=name, nodeNumber=nRows))
    items = with_contacts(mbs, items, np.arange(m), mRows, **constraint(at, loads))

    def update(mbs: exu.MainSystem, t: float) -> bool:
        """Pre-step function: set rows and forces to those at t; True, so that Exudyn goes on."""
        inputs.begin(t)
        at, loads = rows(t), inputs.values_at(t).loads
        for key, value in constraint(at, loads).items():
            mbs.SetObjectParameter(items.oContacts, key, value)
        mbs.SetObjectParameter(oRows, "stiffnessMatrix", at.F + rigid)
        mbs.SetObjectParameter(items.oSystem, "forceVector", equations.B @ loads)
        return True

    return steps.attach_update(mbs, items, update)


def add_with_callbacks(mbs: exu.MainSystem, equations: Equations, inputs: Inputs, start: Start) -> SystemItems:
    """Add the items of a system of rigid contacts in the states `start`, with Python callbacks in every iteration.

    This is the way of Weyrer et al.
    """
    m = len(equations.system.contacts)
    rows = inputs.function_of_time(lambda x: equations.rows(x).C)

    def force(mbs: exu.MainSystem, t: float, item: int, q: Array, q_t: Array) -> Array:
        """User function: loads (n,) on the coordinates at t s."""
        return equations.B @ inputs.values_at(t).loads

    def constraint(mbs: exu.MainSystem, t: float, item: int, q: Array, q_t: Array, velocity_level: bool) -> Array:
        """User function: values C q (m,) of the contact rows at t s, on both the position and the velocity level."""
        return rows(t) @ q

    def jacobian(mbs: exu.MainSystem, t: float, item: int, q: Array, q_t: Array, velocity_level: bool) -> Array:
        """User function: contact rows C (m, n) at t s."""
        return rows(t)

    return with_contacts(
        mbs,
        add_bodies(mbs, equations, inputs, start, forceUserFunction=force),
        np.arange(m),
        scalingMarker0=np.zeros((m, 1)),  # its number of rows is that of the contacts
        constraintUserFunction=constraint,
        jacobianUserFunction=jacobian,
    )


def zero_jacobian(equations: Equations, steps: Steps) -> Callable[..., exu.MatrixContainer]:
    """User function for the Jacobian of forces other than K q and D q': zero, because Exudyn adds K and D itself.

    Without this function Exudyn would differentiate K q numerically.  The function also checks, by `steps`, that the
    step has been updated.
    """
    no_more = equations.matrix(sp.csr_matrix(equations.K.shape))

    def jacobian(
        mbs: exu.MainSystem, t: float, item: int, q: Array, q_t: Array, factor: float, factor_t: float
    ) -> exu.MatrixContainer:
        """User function: zero Jacobian (n, n), after the check of the step."""
        steps.check(t)
        return no_more

    return jacobian


#: Name as a simulator of a scene, and function that adds the items, of each formulation.
ADD_BY: dict[Formulation, tuple[str, AddItems]] = {
    "springs": ("exudyn", add_with_springs),
    "multipliers": ("exudyn-multiplier", add_with_multipliers),
    "callbacks": ("exudyn-callback", add_with_callbacks),
    "callbacks-modified-newton": ("exudyn-callback", add_with_callbacks),
}
