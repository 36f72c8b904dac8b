r"""A consistent initial state of bodies and of the contacts and supports that hold these.

.. math::
    C(s_0)\, q_0 = 0, \qquad C(s_0)\, v_0 + \dot s_0\, C'(s_0)\, q_0 = 0

Here :math:`q_0` and :math:`v_0` are coordinates and velocities at t = 0, C the rigid rows with the path at :math:`s_0`,
and C' their derivative by the path.  A velocity that violates the second equation is changed by :math:`\Delta v` of
least kinetic energy, with the mass matrix M and the impulses :math:`\mu` of the sliders:

.. math::
    C M^{-1} C^T \mu = C v_0 + \dot s_0 C' q_0, \qquad \Delta v = -M^{-1} C^T \mu

Eich: Convergence results for a coordinate projection method applied to mechanical systems with algebraic constraints,
SIAM Journal on Numerical Analysis 30, 1993.

Also the friction of pads (`pmr.system.contacts`) from step to step, by the law of the compiled simulator.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import compress

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import ArrayLike

from pmr.errors import InputError
from pmr.files.arrays import Array, Mask
from pmr.kernel.laws import JointCylinder, slide_pads
from pmr.scene.choice import SimulatorNeeds
from pmr.system.assembly import Assembly
from pmr.system.body import Body, SlidingBody
from pmr.system.body_matrices import dependence_of_rows
from pmr.system.contacts import Contact, Friction, friction_joints
from pmr.system.system import BodySystem

#: Violation of a row that is round-off, over the sum of absolute values of the row times the largest coordinate.
ROW_TOLERANCE = 1e-8


@dataclass(frozen=True)
class InitialState:
    """Coordinates q (n,) and velocities v (n,) at t = 0, in the units of the body's coordinates (per second for v)."""

    q: Array
    v: Array

    @classmethod
    def at_rest(cls, size: int) -> InitialState:
        """State of a body with `size` coordinates, undeformed and without velocity."""
        return cls(np.zeros(size), np.zeros(size))


def consistent_start(
    assembly: Assembly, x: Array, x_rate: Array, initial: Mapping[str, InitialState]
) -> dict[str, InitialState]:
    """Initial state of each body by its name, in all its coordinates; at rest and undeformed where `initial` has none.

    Velocities that violate rigid contacts or supports are changed with the least kinetic energy.  The changed
    velocities are in new arrays; those in `initial` stay.  If `initial` is empty, nothing is checked.

    Parameters
    ----------
    assembly : Assembly
    x : (sides,) array, m
        Positions of the sides of all contacts at t = 0.
    x_rate : (sides,) array, m/s
        Rates of these positions at t = 0.
    initial : mapping of str to InitialState
        Initial states by the bodies' names.

    Raises
    ------
    InputError
        If `initial` has a name that no body has, a size is wrong, a position violates a rigid contact or support, or
        rigid contacts that stop a velocity depend on each other.
    """
    system, bodies = assembly.system, assembly.system.bodies
    starts = complete_states({name: body.size for name, body in bodies.items()}, initial)
    if not initial:
        return starts
    for name, body in bodies.items():
        for row, held in body.held.items():
            largest = np.abs(starts[name].q).max()
            check_position(np.ones((1, 1)), starts[name].q[[held]], (body.row_names[row],), largest)
        starts[name] = InitialState(starts[name].q, _stop_at_supports(body, starts[name].v))
    rows = assembly.contact_rows(x)
    rigid = rows.rigid
    C, names = rows.C[rigid], tuple(compress(system.contact_names, rigid))
    q, v = (
        np.concatenate([getattr(starts[name], part)[assembly.free_coordinates[name]] for name in bodies])
        for part in "qv"
    )
    drift = start_drift(C, assembly.row_rates(x, x_rate)[rigid], InitialState(q, v), names)
    if drift is None:
        return starts
    answers = spla.splu(assembly.M.tocsc()).solve(C.T)  # M^-1 C^T
    v = v - answers @ start_impulses(C @ answers, drift, names)
    for name, start in starts.items():
        start.v[assembly.free_coordinates[name]] = v[assembly.coordinate_slices[name]]
    return starts


def _stop_at_supports(body: SlidingBody, v: Array) -> Array:
    """Velocities (n,) of a body: v (n,), with the change of least kinetic energy that stops coordinates on supports."""
    held, v = np.array(list(body.held.values()), np.int64), v.copy()
    if np.any(v[held]):
        free = np.setdiff1d(np.arange(body.size), held)
        M = sp.csc_matrix(body.M)
        v[free] += spla.spsolve(M[np.ix_(free, free)], M[np.ix_(free, held)] @ v[held])
        v[held] = 0.0
    return v


def complete_states(sizes: Mapping[str, int], initial: Mapping[str, InitialState]) -> dict[str, InitialState]:
    """State of each body, by its name, as float arrays; bodies that `initial` does not name are at rest, undeformed.

    `sizes` are the numbers of coordinates by the bodies' names.  Arrays of floats in `initial` are not copied.  Raises
    InputError if `initial` has a name that no body has.  Also if a body's coordinates or velocities have another number
    of values than it has coordinates, or values that are not finite.
    """
    if unknown := [name for name in initial if name not in sizes]:
        raise InputError("initial state", unknown[0], None, f"one of the bodies is allowed: {', '.join(sizes)}")
    return {
        name: InitialState(*(_vector(part, getattr(initial[name], part), size) for part in ("q", "v")))
        if name in initial
        else InitialState.at_rest(size)
        for name, size in sizes.items()
    }


def start_drift(C: Array, C_t: Array, start: InitialState, names: tuple[str, ...]) -> Array | None:
    """Violation C v + C_t q (m,) in m/s of rows C (m, n) with rates C_t (m, n) by the coordinates q, v of `start`.

    The result is None if it is round-off.  Raises InputError if the position q violates one of the rows, which have the
    `names`.
    """
    check_position(C, start.q, names)
    drift = C @ start.v + C_t @ start.q
    scale = _magnitude(C, start.v) + _magnitude(C_t, start.q)
    return None if np.all(np.abs(drift) <= ROW_TOLERANCE * scale) else np.asarray(drift)


def check_position(C: Array, q: Array, names: tuple[str, ...], largest: float = 0.0) -> None:
    """Raise InputError, with the row's name, for the first row of C (m, n) that q (n,) violates.

    `names` are the names of the rows.  The tolerance is proportional to the largest absolute value in q, or to
    `largest` if that is larger.
    """
    for name, excess, scale in zip(names, np.abs(C @ q), _magnitude(C, q, largest), strict=True):
        if excess > ROW_TOLERANCE * scale:
            allowed = f"row {name!r} is violated by {excess:.3g}; C(s(0)) q = 0 is allowed"
            raise InputError("initial state", "q", None, allowed)


def start_impulses(G: Array, drift: Array, names: tuple[str, ...]) -> Array:
    """Impulses mu (m,) in N s that change the velocities of rows by `drift` (m,): G mu = drift, G = C M^-1 C^T (m, m).

    Raises InputError if the rows, which have the `names`, depend on each other.
    """
    impulses, _, rank, _ = np.linalg.lstsq(G, drift, rcond=None)
    if rank < len(G) or not np.allclose(G @ impulses, drift, rtol=0.0, atol=1e-6 * np.abs(drift).max()):
        raise InputError("initial state", "v", None, f"the rows {', '.join(names)} depend on each other")
    return np.asarray(impulses)


def _magnitude(C: Array, q: Array, largest: float = 0.0) -> Array:
    """Upper bound (m,) of the values C q of rows C (m, n), from the largest absolute value in q (n,).

    If `largest` is larger than the largest absolute value in q, the bound follows from `largest` instead.
    """
    return np.asarray(np.abs(C).sum(axis=1) * np.abs(q).max(initial=largest))


def _vector(name: str, values: ArrayLike, size: int) -> Array:
    """Return `values` as a float array (size,); raise an InputError about `name` if they don't fit or aren't finite."""
    vector = np.asarray(values, dtype=float)
    if vector.shape != (size,) or not np.all(np.isfinite(vector)):
        allowed = f"{size} finite values are allowed, found an array of shape {vector.shape}"
        raise InputError("initial state", name, None, allowed)
    return vector


def dense(A: Array | sp.csr_matrix) -> Array:
    """The matrix A (m, n) as a dense array (m, n) of floats."""
    return np.asarray(A if isinstance(A, np.ndarray) else A.toarray(), dtype=float)


@dataclass(frozen=True)
class Grip:
    """Friction of n pads in J joints at the end of a step; all arrays are empty if there is no friction."""

    forces: Array = field(default_factory=lambda: np.zeros(0))  # (n,) N
    s: Array = field(default_factory=lambda: np.zeros(0))  # (J,) m: path coordinates
    drives: Array = field(default_factory=lambda: np.zeros(0))  # (J,) N: forces of the cylinders; 0 without a cylinder
    limits: Array = field(default_factory=lambda: np.zeros(0))  # (n,) N: friction at which pads slide

    @classmethod
    def at_start(cls, contacts: Sequence[Contact], s: Array, multipliers: Array) -> Grip:
        """State at t = 0 without friction, with paths at s (J,) m and contact forces `multipliers` (m,) in N.

        The arrays of the result are empty if none of `contacts` has friction.
        """
        law = Friction.from_contacts(contacts)
        if law is None:
            return cls()
        none, drives = np.zeros(len(law.pads)), np.where(law.cylinders < 0, 0.0, multipliers[law.cylinders])
        return cls(none, s.copy(), drives, none.copy())


def slide(law: Friction, old: Grip, sums: Array, s: Array, h: float, multipliers: Array, matrix: Array) -> Grip:
    """Friction of all pads that rub, at the end of a step of h s.

    Parameters
    ----------
    law : Friction
    old : Grip
        State at the beginning of the step.
    sums : (J,) array, N
        Sum of the friction in each joint, as it was when `multipliers` were computed.
    s : (J,) array, m
        Path coordinates at the end of the step.
    h : float, s
    multipliers : (m,) array, N
        Contact forces at the end of the step.
    matrix : (m, m) array, m/N
        How far contact forces move the contacts (A of `pmr.kernel.laws.solve_contact`); only its diagonal is used.
    """
    forces, limits = np.zeros((2, len(old.forces)))
    driven = np.where(law.cylinders < 0, 0.0, multipliers[law.cylinders])
    for joint, (c, gives) in enumerate(zip(law.cylinders, law.cylinder_compliance, strict=True)):
        of_joint = slice(law.first_pads[joint], law.first_pads[joint + 1])
        cylinder = JointCylinder(gives, matrix[c, c], driven[joint], sums[joint], old.drives[joint])
        pads, travel = law.pads[of_joint], s[joint] - old.s[joint]
        forces[of_joint], limits[of_joint] = slide_pads(
            law.stiffness[of_joint],
            law.laws[of_joint],
            multipliers[pads],
            old.forces[of_joint],
            travel,
            abs(travel) / h if travel else 0.0,
            cylinder,
        )
    return Grip(forces, s, driven + law.joint_totals(forces), limits)


#: Most names in a message, which gives the number of all further ones.
MOST_NAMES = 3


def describe_dependence(C: Array, names: Sequence[str]) -> str:
    """Text with the names of those rows of C (m, n) that depend on each other.

    The first m of `names` are the names of the rows.
    """
    involved = dependence_of_rows(C, names[: len(C)]).names
    if len(involved) == 1:
        return f"the row {involved[0]} vanishes"
    return f"the rows {', '.join(involved)} depend on each other"


def describe_unsettled(names: Sequence[str], pushes: Mask) -> str:
    """Text with the names of the one-sided contacts, which did not settle as open or closed within the kernel's limit.

    `names` are the names of all m contacts, and the mask `pushes` (m,) is true for those that only push.
    """
    return f"which of the rows {', '.join(compress(names, pushes))} are closed was not settled in 1000 solves"


def describe_divergence(term_names: Sequence[str], contacts: Sequence[Contact]) -> str:
    """Text about forces of terms, friction or a hoist rope that have not converged in a step or at the start.

    The text names `term_names` and the joints of `contacts` with friction, but only the first `MOST_NAMES` of these.
    Without either, it names the hoist rope.
    """
    causes = [*term_names, *(f"friction of {joint}" for joint in friction_joints(contacts))] or ["the hoist rope"]
    further = len(causes) - MOST_NAMES
    names = ", ".join(causes[:MOST_NAMES]) + (f" and {further} more" if further > 0 else "")
    return (
        f"the forces of {names} do not converge; after the start, shorter steps help where terms change the stiffness "
        "of a step by some hundred times, or pads stick and slide, close and open again and again"
    )


def needs_of(system: BodySystem[Body], rigid: Mask, x: Array, rho_inf: float) -> SimulatorNeeds:
    """Properties of a system that a simulator has to support: contacts that push, are rigid, give way, move or rub.

    Parameters
    ----------
    rigid : (m,) mask
        True for rigid contacts.
    x : (T, sides) array, m
        Positions of the sides of all contacts; a contact moves if one of its sides changes its position.
    rho_inf : float
        Spectral radius at infinite frequency.
    """
    pushing, moving = ~np.isnan(system.clearance), np.zeros(len(rigid), bool)
    moving[[system.sides[k].contact for k in np.flatnonzero((x != x[0]).any(axis=0))]] = True
    names, rubs = system.contact_names, Friction.from_contacts(system.contacts)
    return SimulatorNeeds(
        pushing_rows=tuple(compress(names, pushing)),
        rigid_pushing_rows=tuple(compress(names, pushing & rigid)),
        flexible_rows=tuple(compress(names, ~rigid)),
        rigid_moving_rows=tuple(compress(names, rigid & moving)),
        friction_rows=() if rubs is None else tuple(names[k] for k in rubs.pads),
        hoist=bool(system.hoist),
        rho_inf=rho_inf,
    )
