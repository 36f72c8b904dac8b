r"""Forces on supports and on the machine at rest, as a run computes them, as rows over what determines them.

A run's forces on rigid supports, at the pivot and of the luffing cylinder are linear in coordinates q, contact forces
lambda and loads f, and the terms of a frame add forces that are linear in q at given amplitudes.  Each row follows from
the run's own functions, applied to states with one unit entry:

.. math:: r = R_q q + R_\lambda \lambda + R_f f + \sum_w a_w R_w q
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.results import Energy, Response
from pmr.results.outputs import Output
from pmr.scene import Scene
from pmr.scene.built import force_of
from pmr.simulation.columns import column_names
from pmr.simulation.pivot import with_forces_on_machine
from pmr.simulation.support_reactions import is_reaction, with_support_reactions
from pmr.system.assembly import Assembly
from pmr.system.body import Trajectory, force_outputs
from pmr.system.contact_rows import ContactRows
from pmr.system.contacts import named
from pmr.system.system import System, SystemTrajectory

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RestRows:
    """Rows of r forces at one place, by coordinates (r, n), contact forces (r, m), loads (r, i), parts (w, r, n)."""

    outputs: tuple[Output, ...]
    coordinates: Array
    contacts: Array
    loads: Array
    parts: Array


def rest_rows(scene: Scene, assembly: Assembly, place: int, x: Array, rows: ContactRows, amplitudes: Array) -> RestRows:
    """Rows of a scene of `rest_scene`, at the place of that number.

    Parameters
    ----------
    x : (sides,) array, m
        Places of the sides of all contacts.
    rows : ContactRows
        Of all contacts there.
    amplitudes : (w, k) array
        Amplitudes of the system's terms by a unit of each part that acts.
    """
    n, m, i, parts = assembly.size, len(rows.C), assembly.B.shape[1], len(amplitudes)
    ends = np.cumsum([n, m, i])
    states = np.zeros((int(ends[-1]) + parts * n, n + m + i))
    states[: ends[-1]] = np.eye(n + m + i)
    c = np.zeros((len(states), amplitudes.shape[1]))
    for number, amplitude in enumerate(amplitudes):
        body_states = slice(ends[-1] + number * n, ends[-1] + (number + 1) * n)
        states[body_states, :n], c[body_states] = np.eye(n), amplitude
    response = _response(scene, assembly, place, x, rows, states, c)
    values = np.empty((0, len(states))) if response.others is None else response.others.T
    q, forces, loads = np.split(values[:, : ends[-1]], ends[:2], axis=1)
    more = values[:, ends[-1] :].reshape(len(values), parts, n).transpose(1, 0, 2) - q
    return RestRows(response.outputs[len(response.force_names) :], q, forces, loads, more)


def _response(
    scene: Scene, assembly: Assembly, place: int, x: Array, rows: ContactRows, states: Array, c: Array
) -> Response:
    """Forces of springs, contacts, supports and on the machine in states (T, n + m + i) at rest."""
    system, (n, m), count = assembly.system, (assembly.size, len(rows.C)), len(states)
    q, forces, loads = np.split(states, [n, n + m], axis=1)
    t, none = np.full(count, float(place)), np.zeros(count)
    bodies = dict[str, Trajectory]()
    for name, body in system.bodies.items():
        coordinates = np.zeros((count, body.size))
        coordinates[:, assembly.free[name]] = q[:, assembly.coordinates[name]]
        at = np.broadcast_to(x[system.sides_of(name)], (count, len(system.sides_of(name))))
        bodies[name] = Trajectory(t, coordinates, np.zeros_like(coordinates), system.pressed(name, forces), at, 0.0)
    trajectory = SystemTrajectory(
        t, bodies, forces, forces, loads, none, none, 0.0, np.nan, amplitudes=c if system.terms else None
    )
    springs, names, kinds, owners = _springs(system, assembly)
    held = [k for k, contact in enumerate(system.contacts) if not is_reaction(contact)]
    y = (assembly.outputs[springs] @ q.T).T - forces @ rows.X[springs].T + loads @ assembly.direct[springs].T
    response = Response(
        t=t,
        x=np.empty(0),
        displacement=np.empty((count, 0)),
        energy=Energy(none, none, none),
        slider_force=np.hstack([y, forces[:, held]]),
        residual_position=none,
        residual_velocity=none,
        seconds=0.0,
        force_names=(*names, *(force_of(system.contact_names[k]) for k in held)),
        kinds=(*kinds, *(system.contacts[k].kind for k in held)),
        bodies=(*owners, *(system.contacts[k].inner.body for k in held)),
    )
    return with_forces_on_machine(scene, with_support_reactions(response, system, trajectory))


def _springs(
    system: System, assembly: Assembly
) -> tuple[NDArray[np.int64], Sequence[str], Sequence[str], Sequence[str]]:
    """Numbers of the outputs that are forces of springs of bodies, with names, kinds and bodies."""
    numbers, names, kinds, owners = list[int](), list[str](), list[str](), list[str]()
    for name, body in system.bodies.items():
        of = column_names(body)
        numbers += (assembly.observed[name].start + np.flatnonzero(force_outputs(body))).tolist()
        names += [named(name, spring) for spring in of.forces]
        kinds += of.kinds[1]
        owners += [name] * len(of.forces)
    return np.array(numbers, dtype=np.int64), names, kinds, owners
