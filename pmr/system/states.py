r"""A system at given times: rows of its contacts, its simulated motion, and outputs and states of its bodies.

Compliant rows are eliminated: they are springs that travel with the slider, and no constraint is left.  With the
flexibility F(s) = G(s) + 1/k, of the residual flexibility G and the compliance 1/k of pads,

.. math::
    \lambda = F^{-1} (C q + H f), \qquad
    M \ddot q + D \dot q + \big( K + C^T F^{-1} C \big) q = \big( B - C^T F^{-1} H \big) f

which is an ordinary second-order system whose stiffness and inputs depend on s.  From the states of a body its full
coordinates follow.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.errors import SimulationError
from pmr.files.arrays import Array, Indices, Mask
from pmr.system.body import Body, Trajectory, is_round_off
from pmr.system.contacts import Friction
from pmr.system.polynomials import apply_table, select_columns, select_rows
from pmr.system.system import BodySystem, System


@dataclass(frozen=True)
class ContactRows:
    """Rows of m contacts at given coordinates of their places, at one time or at T times, on n coordinates."""

    C: Array  # ([T,] m, n)
    F: Array  # ([T,] m, m) m/N: G + 1/k, residual flexibility plus compliance
    H: Array  # ([T,] m, i) m/N: motion of the contacts that i unit inputs cause by the residual flexibility
    X: Array  # ([T,] o, m) m/N: reduction of o outputs that unit contact forces cause by this flexibility

    def at_time(self, k: int) -> ContactRows:
        """Rows of the contacts at the time with number k; only for rows at T times."""
        return ContactRows(self.C[k], self.F[k], self.H[k], self.X[k])

    def select(self, mask: Mask) -> ContactRows:
        """Rows of those contacts alone that are in a `mask` (m,)."""
        F = self.F[..., mask, :][..., mask]
        return ContactRows(self.C[..., mask, :], F, self.H[..., mask, :], self.X[..., mask])

    def force_scale(self, K: sp.csr_matrix | Array) -> float:
        """Factor by which contact equations are scaled: the largest entry of the stiffness K (n, n).

        For K = 0, as of rigid motions, the factor is max |C|^2 / max |F|, or 1 if F is zero, too.
        """
        flexibility = abs(self.F).max(initial=0.0)
        return float(abs(K).max() or (abs(self.C).max() ** 2 / flexibility if flexibility else 1.0))

    @cached_property
    def force_coefficients(self) -> Array:
        """Contact forces (m, n + i) at one time by unit coordinates, F^-1 C, then by unit inputs, F^-1 H."""
        return np.asarray(np.linalg.solve(self.F, np.hstack([self.C, self.H])))

    @property
    def rigid(self) -> Mask:
        """Mask (m,), or (T, m) at T times, of the contacts that are rigid: their flexibility F is zero or round-off."""
        return is_round_off(self.F)


def add_springs(K: Array, rows: ContactRows) -> Array:
    """Return K (n, n) plus the stiffness C^T F^-1 C (n, n) of those contacts of `rows` that are not rigid."""
    soft = rows.select(~rows.rigid)
    return np.asarray(K + soft.C.T @ np.linalg.solve(soft.F, soft.C))


def free_motions(C: Array) -> Array | None:
    """Orthonormal basis (n, k) of the motions that rigid contacts C (m, n) leave free; None if m is 0."""
    return scipy.linalg.null_space(C) if len(C) else None


#: Smallest eigenvalue of F, after scaling to a unit diagonal, with which F can be inverted.
REGULAR = 1e-13


def check_determined(F: Array, names: Sequence[str], where: Callable[[int], str]) -> None:
    """Raise a SimulationError if a flexibility F (T, m, m) in m/N of the rows `names` (m,) is singular at some time.

    The forces of the rows are then not determined, as of a slider on a support, or of two sliders at one point.
    ``where(k)`` is the beginning of the message about the time with number k.
    """
    if not len(names):
        return
    scale = np.sqrt(np.maximum(np.einsum("tmm->tm", F), np.finfo(float).tiny))
    regular = np.linalg.eigvalsh(F / (scale[:, :, None] * scale[:, None, :]))[:, 0] > REGULAR
    regular &= ~is_round_off(F).any(axis=1)
    if not regular.all():
        place = where(int(np.argmin(regular)))
        raise SimulationError(f"{place}: the forces of the rows {', '.join(names)} are not determined there")


@dataclass(frozen=True, kw_only=True)
class ContactHistory:
    """Forces of m contacts of a system at T times."""

    forces: Array  # (T, m) N: positive where contacts push
    # (T, m) N: for contacts that only push, the largest force in the step that ends at t; for others the force at t
    peaks: Array
    # (T, m) N s: impulse in the step that ends at t, with generalized-alpha's weights; None if no contact only pushes
    impulses: Array | None = None
    # friction (T, n) in N along the boom of the n pads that have any (`pmr.system.contacts`), and its moments (T, m) in
    # N m at all contacts; None without friction
    friction: Array | None = None
    moments: Array | None = None


@dataclass(frozen=True, kw_only=True)
class DriverHistory:
    """Values of what drives a system, at T times: of i inputs, k terms and P paths."""

    loads: Array  # (T, i): values of the inputs `System.input_names`
    amplitudes: Array | None = None  # c (T, k) of the k terms; None without terms
    rates: Array | None = None  # (T, P) m/s: rates of the path coordinates; None if not known


@dataclass(frozen=True, kw_only=True)
class SystemTrajectory(ContactHistory, DriverHistory):
    """Motion of a simulated system at T times, with its contacts and what drives it."""

    t: Array  # (T,) s
    # by name of a body: its coordinates, and for each of its sides (`System.sides_of`) the coordinate ``s`` (T, sides)
    # of the place in m and the ``multipliers`` (T, sides) in N, which have the sign of the side
    bodies: Mapping[str, Trajectory]
    # (T,) J: kinetic plus strain energy; and work of loads and travelling contacts since t = 0, without that of damping
    energy: Array
    work: Array
    seconds: float  # wall time of the solver alone
    surplus: float  # energy that no work explains, over the largest energy (`pmr.simulation.stepping`)
    parts: Indices | None = None  # (T,): substeps of each step (`pmr.simulation.contact_step`)
    hoist: Array | None = None  # (T, 10): outputs of a hoist (`pmr.scene.hoist.OUTPUTS`); None without one

    @classmethod
    def from_states(
        cls,
        system: System,
        t: Array,
        states: Mapping[str, tuple[Array, Array]],
        x: Array,
        multipliers: Array,
        peaks: Array | None,
        energy: Array,
        friction: Array | None = None,
        **more: Any,
    ) -> SystemTrajectory:
        """Trajectory at times t (T,) in s from the `states` of the bodies: coordinates and rates (q, v), by name.

        `x` (T, sides) in m are positions of the contacts' sides.  `friction` (T, n) in N are the friction forces of n
        pads, None without friction.  `multipliers` (T, m) in N are the contact forces without friction.  `energy` (2,
        T) in J has the energy, then the work, both without the energy that friction stores in cylinders.  `peaks` (T,
        m) in N are the largest forces around the times t, of which only those of contacts that only push are used; None
        if the forces at t are the largest ones.  `more` are further fields.
        """
        forces, moments, pads = multipliers, None, Friction.from_contacts(system.contacts)
        if pads is not None and friction is not None:
            forces = multipliers + pads.cylinder_forces(friction)
            moments, energy = pads.moments(friction, forces), energy + pads.stored_energy(friction, forces)
        bodies = {
            name: Trajectory(
                t, q, v, system.side_multipliers(name, multipliers), x.T[system.sides_of(name)].T, more["seconds"]
            )
            for name, (q, v) in states.items()
        }
        peaks = forces if peaks is None else np.where(np.isnan(system.clearance), forces, peaks)
        of_contacts: dict[str, Any] = {"forces": forces, "peaks": peaks, "friction": friction, "moments": moments}
        return cls(t=t, bodies=bodies, energy=energy[0], work=energy[1], **of_contacts, **more)

    @property
    def arrays(self) -> list[NDArray[Any]]:
        """All arrays of the system and its bodies, each with T rows."""
        of_bodies = [array for body in self.bodies.values() for array in _arrays(body).values()]
        return [*of_bodies, *_arrays(self).values()]

    def map_arrays(self, change: Callable[[NDArray[np.generic]], NDArray[np.generic]]) -> SystemTrajectory:
        """Return the trajectory with ``change(array)`` in place of each array (T, any), those of the bodies too."""

        def change_arrays(trajectory: Trajectory | SystemTrajectory) -> dict[str, Any]:
            return {name: change(array) for name, array in _arrays(trajectory).items()}

        bodies = {name: replace(trajectory, **change_arrays(trajectory)) for name, trajectory in self.bodies.items()}
        return replace(self, bodies=bodies, **change_arrays(self))

    def select(self, steps: Indices | slice) -> SystemTrajectory:
        """Return the trajectory at the steps with the numbers `steps` (S,), or in this slice.

        `parts` and `impulses` become None, as both belong to the steps between successive times.
        """
        return replace(self.map_arrays(lambda array: array[steps]), parts=None, impulses=None)


def _arrays(trajectory: Trajectory | SystemTrajectory) -> dict[str, NDArray[Any]]:
    """Fields of a trajectory that are arrays, by name."""
    return {name: value for name, value in vars(trajectory).items() if isinstance(value, np.ndarray)}


@dataclass(frozen=True)
class BodyStates:
    """States of a simulated reduced body with r coordinates, m rows and i inputs at S times."""

    t: Array  # (S,) s
    s: Array  # (S, m) m: coordinate of the place of each row
    # (S, r): coordinates and their rates
    p: Array
    v: Array
    multipliers: Array  # (S, m) in N: multipliers under which the residual part deforms
    loads: Array  # (S, i) N
    rows: tuple[str, ...]  # (m,): names
    # (S, m), friction (`pmr.system.contacts`) at each row: moments in N m, and forces in N that pull the body at the
    # row towards its tail, and push its tail the other way with the same force; None without friction
    friction_moments: Array | None = None
    friction_forces: Array | None = None

    def __getitem__(self, which: slice) -> BodyStates:
        """Return the states at the times in the slice `which`."""
        return replace(
            self, **{key: array[which] for key, array in vars(self).items() if key != "rows" and array is not None}
        )

    def select_coordinates(self, columns: slice) -> BodyStates:
        """Return the states with only the coordinates in the slice `columns`."""
        return replace(self, p=self.p[:, columns], v=self.v[:, columns])


def friction_on_body(system: BodySystem[Body], name: str, forces: Array, friction: Array | None) -> dict[str, Array]:
    """Moments (S, rows) in N m and forces along the boom (S, rows) in N of friction on the rows of a body.

    The keys are ``friction_moments`` and ``friction_forces``, as in the `BodyStates` of the body called `name`.
    `forces` (S, m) in N are the forces of all contacts, `friction` (S, n) in N the friction forces of all pads.  The
    result is empty if no contact has friction or `friction` is None.
    """
    rubbing = Friction.from_contacts(system.contacts)
    if rubbing is None or friction is None:
        return {}
    sides, of_contacts = [system.sides[number] for number in system.sides_of(name)], np.zeros(forces.shape)
    of_contacts[:, rubbing.pads] = friction
    on = [side.contact for side in sides]
    ways = np.array([side.sign * system.contacts[side.contact].direction for side in sides])  # 1 for the inner section
    moments = system.side_multipliers(name, rubbing.moments(friction, forces))
    return {"friction_moments": moments, "friction_forces": of_contacts[:, on] * ways}


def states_of(system: System, trajectory: SystemTrajectory, steps: Indices) -> dict[str, BodyStates]:
    """States of the bodies at the steps of a trajectory with the numbers `steps` (S,), by the bodies' names."""
    states, at_steps = {}, trajectory.select(steps)
    for name, columns in system.load_columns.items():
        motion = at_steps.bodies[name]
        rows = tuple(system.sides[number].place.row for number in system.sides_of(name))
        rubbed = friction_on_body(system, name, at_steps.forces, at_steps.friction)
        part = motion.s, motion.q, motion.v, motion.multipliers, at_steps.loads[:, columns]
        states[name] = BodyStates(at_steps.t, *part, rows, **rubbed)
    return states


def displacements(
    system: System, trajectory: SystemTrajectory, outputs: Sequence[int] | None = None
) -> dict[str, Array]:
    """Outputs O q + W f - X lambda (T, o) of each body by name, with the effect of the moments of friction.

    `trajectory` has a body's coordinates q, its loads f and the contact forces lambda on the body.  `outputs` are
    ascending indices among the outputs of all bodies, one body after the other; None returns all.
    """
    outputs_of_bodies, first = {}, 0
    for name, chosen in outputs_by_body(system, outputs).items():
        body, motion = system.bodies[name], trajectory.bodies[name]
        last = first + len(body.input_names)
        turned = None if trajectory.moments is None else system.side_multipliers(name, trajectory.moments)
        loads = trajectory.loads[:, first:last]
        deformed = deformation(system, name, motion.s, motion.multipliers, loads, chosen, turned)
        O = body.outputs[chosen]
        from_modes = np.asarray((O @ motion.q.T).T) if sp.issparse(O) else motion.q @ O.T
        outputs_of_bodies[name], first = from_modes if deformed is None else from_modes + deformed, last
    return outputs_of_bodies


def outputs_by_body(system: System, outputs: Sequence[int] | None) -> dict[str, Indices | slice]:
    """Split `outputs`, ascending indices among the outputs of all bodies, by body: indices (k,) in its own outputs.

    The outputs of all bodies are counted one body after the other.  If `outputs` is None, each body's name has the
    slice of all its outputs.
    """
    ends = np.cumsum([0, *(body.outputs.shape[0] for body in system.bodies.values())])
    if outputs is None:
        return dict.fromkeys(system.bodies, slice(None))
    split = np.split(np.asarray(outputs, np.int64), np.searchsorted(outputs, ends[1:-1]))
    return {name: numbers - first for name, numbers, first in zip(system.bodies, split, ends, strict=False)}


def deformation(
    system: System,
    name: str,
    x: Array,
    multipliers: Array,
    loads: Array,
    chosen: Indices | slice = slice(None),
    moments: Array | None = None,
) -> Array | None:
    """Outputs W f - X lambda (T, o) by one body's residual flexibility, under loads f and contact forces lambda.

    None is returned if the body has no residual flexibility.

    Parameters
    ----------
    name : str
        Name of the body.
    x : (T, sides) array, m
        Positions of the contact sides on the body.
    multipliers : (T, sides) array, N
        Contact forces on these sides.
    loads : (T, i) array
        Loads on the body.
    chosen : (o,) array of int, or slice
        Numbers of outputs.
    moments : (T, sides) array, N m, optional
        Moments of friction at the sides (`pmr.system.contacts`); they add X' times the moments to the outputs, with the
        derivative X' of X by the position.  Without effect in a system on one path (`System.on_one_path`).
    """
    body = system.bodies[name]
    if system.on_one_path:  # all rows are at the position of the one that moves
        points = [side.place for side in system.sides if side.place.body == name]
        if body.flexibility is None:
            return None
        rows = [body.row_names.index(place.row) for place in points]
        moving = [place.path is not None for place in points]
        X = select_rows(select_columns(body.flexibility.outputs, rows), chosen)
        s = x[:, moving.index(True)] if any(moving) else np.full(len(x), body.domain[0])
        return np.asarray(loads @ body.flexibility.direct[chosen].T - apply_table(X, s, multipliers))
    residual = None if body.carriers is None else body.carriers.flexibility
    if residual is None:
        return None
    pressed = outputs_by_carriers(system, name, x, multipliers, residual.outputs.T[:, chosen], moments)
    return np.asarray(loads @ residual.direct[chosen].T - pressed)


def outputs_by_carriers(
    system: System, name: str, x: Array, multipliers: Array, X: Array, moments: Array | None = None
) -> Array:
    """Outputs (T, o) by forces on a body's contact sides: the sum of lambda b X over the sides.

    lambda is the force on a side, b are the side's weights on K carriers, and X (K, o) are the outputs by unit forces
    on the carriers.  If there are `moments`, each side's moment times b' X is subtracted, with the derivative b' of b
    by the position.  The other arguments are those of `deformation`.
    """
    pressed = np.zeros((len(x), X.shape[1]))
    if not X.shape[1]:
        return pressed
    points = [side.place for side in system.sides if side.place.body == name]
    shares, touched = list[Array](), list[Indices]()
    for derivative, acting in ((0, multipliers), *([] if moments is None else [(1, -moments)])):
        staying = np.zeros((len(points), X.shape[1]))
        for k, (place, at) in enumerate(zip(points, x.T, strict=True)):
            stays = bool((at == at[0]).all())
            on, weights = system.row(place).touched_weights(at[:1] if stays else at, derivative)
            if stays:
                staying[k] = weights[0] @ X[on[0]]
            else:
                shares.append(weights * acting[:, k, None])
                touched.append(on)
        pressed += acting @ staying
    return pressed + _weighted_sum(np.hstack(shares), np.hstack(touched), X) if shares else pressed


def _weighted_sum(weights: Array, touched: Indices, X: Array) -> Array:
    """Sums (T, o) of d rows of X (K, o) at each of T times: rows `touched` (T, d), each times its `weights` (T, d)."""
    ends = np.arange(len(weights) + 1) * weights.shape[1]
    return np.asarray(sp.csr_matrix((weights.ravel(), touched.ravel(), ends), (len(weights), len(X))) @ X)
