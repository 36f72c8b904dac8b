r"""A boom on a base that moves freely: momenta of the boom, and forces of the boom on its base, in the boom's axes.

The boom's frame, with its origin O at the pivot, has the velocity v and the angular velocity omega.  The tail of a
section is at d = p + X e_x: that of the base section is at p, and X is the sum of extensions.  A point of the section,
with the density :math:`\rho` and the position r from the tail, is at x = d + r + u with the displacement u = Phi q by
coordinates q.  With second-order terms, u includes the shortening of the boom along its axis as it bends.  With the
first moments of each section over 1, x, y, z (l = 0 to 3) along the axis j

.. math::
    \mu_{lj} = \int \rho\, r_l\, u_j = \beta_{lj} \cdot q + \tfrac12 \delta_{jx}\, q^T G_l q, \qquad
    J_{lj} = \partial \mu_{lj} / \partial q, \qquad r_0 = 1

the kinetic energy is a function of v, omega, the moments, the extensions and the rates of these two, but not of the
frame's position and rotation,

.. math::
    T = \tfrac12 \int \rho\, |v + \omega \times x + \dot x|^2,

so that without outer forces linear and angular momentum are conserved, whatever parts of the moments are neglected.
Lagrange's equations, with the acceleration a = v' + omega x v of O minus the acceleration of gravity and alpha =
omega', are

.. math::
    M \ddot q + \sum J_{lj} \, y_{lj} + \alpha_k T_k q + 2 \omega_k T_k \dot q
        + (\omega_j \omega_k N_{jk} - |\omega|^2 N_{jj})\, q + \dots &= 0 \\
    m\, a + \alpha \times s + \omega \times (\omega \times s) + 2\, \omega \times \dot s + \ddot s &= F \\
    s \times a + \Theta \alpha + \omega \times \Theta \omega + \dot\Theta \omega + \dot h + \omega \times h
        &= \mathfrak M

Here m is the mass of the boom, :math:`s = \int \rho\, x` its first moment about O, Theta its moment of inertia about O
and :math:`h = \int \rho\, x \times \dot x` its angular momentum about O relative to the frame; y is the field of
acceleration of `pmr.simulation.frame`, T and N are matrices of the frame's rotation; F and :math:`\mathfrak M` are the
force and the moment of the base on the boom.  Terms that are quadratic in u, except for G, are included if the system
has second order.  Sources: Shabana: Dynamics of Multibody Systems, section 5, and `docs/moving_frame_theory.md`.
Sizes: S sections, P paths, n coordinates, i inputs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from pmr.errors import InputError
from pmr.files.arrays import Array
from pmr.scene import Scene
from pmr.scene.choice import motion_directions
from pmr.scene.frame import INERTIA
from pmr.scene.keys import LUFFING, input_name
from pmr.scene.mechanism import frame_terms
from pmr.scene.members import member_at
from pmr.scene.rotation import skew
from pmr.system.assembly import Assembly
from pmr.system.changing_rows import EliminatedContacts
from pmr.system.reduced_model import ReducedModel
from pmr.system.system import System
from pmr.system.truncation import extend


def with_all_inertia(system: System) -> System:
    """System in which all coordinates have inertia: modes treated as quasi-static become ordinary ones.

    A system without such modes is returned unchanged.
    """
    if all(len(body.quasi_static) == 0 for body in system.bodies.values()):
        return system
    bodies = {name: replace(body, quasi_static=np.zeros(0, np.int64)) for name, body in system.reduced.items()}
    still = {name: len(body.quasi_static) for name, body in system.reduced.items()}
    on_modes = {name: extend(model, still[name]) if still[name] else model for name, model in system.on_modes.items()}
    return replace(system.with_bodies(bodies), on_modes=on_modes)


@dataclass(frozen=True)
class Extensions:
    """Extensions (P,) of P paths in m, with first and second rates in m/s and m/s^2.

    The extension of a section is the distance of its tail ahead of the tail of the section before; the base has the
    extension 0.  After the extensions of the S sections there may be paths that move no section, such as a single
    body's slider.
    """

    value: Array
    rate: Array
    second: Array


@dataclass(frozen=True)
class Moments:
    """First moments beta of the sections' displacements by coordinates, with the paths at s (P,) in m.

    `value` is (S, 4, 3, n): for each section, the integral over its mass of 1, x, y or z times the displacement along
    x, y or z, per unit of each coordinate.
    """

    value: Array
    slope: Array  # d beta / d s, (S, 4, 3, n, P)
    curve: Array  # sum over j, k of (d^2 beta / d s_j d s_k) s_j' s_k', (S, 4, 3, n)


@dataclass(frozen=True)
class FrameMotion:
    """Angular velocity `omega` (3,) in rad/s of the boom's frame, and minus the acceleration of gravity, `weight` (3,).

    Both vectors are in the axes of the boom's frame.
    """

    omega: Array
    weight: Array  # m/s^2, directed upwards


@dataclass(frozen=True)
class Shortening:
    """Part f q^T G q / 2 of a section's first moment along x that is quadratic in q: the boom is shorter as it bends.

    The part belongs to the moment over 1 (`over` = 0) or over x (`over` = 1).  The factor f is 1 without a `cylinder`;
    with the number of a cylinder's extension as `cylinder`, f is -1 over the length of this extension.
    """

    section: int
    over: int
    G: Array  # (n, n)
    cylinder: int | None = None

    def factor(self, extended: Extensions) -> list[float]:
        """Factor f with sections as `extended`, its rate, and its second rate for a constant rate of the extension."""
        if self.cylinder is None:
            return [1.0, 0.0, 0.0]
        l, v = extended.value[self.cylinder], extended.rate[self.cylinder]
        return [-1.0 / l, v / l**2, -2.0 * v**2 / l**3]


@dataclass(frozen=True)
class BaseEquations:
    """Equations of base (6,), coordinates (n,) and paths (P,): `mass` . (a, alpha, q'', s'') + `forces` = outer loads.

    a and alpha are linear and angular acceleration of the frame, q the coordinates and s the paths.  `mass` does not
    contain the mass matrix M of the coordinates.
    """

    mass: Array
    forces: Array  # left sides at zero accelerations


@dataclass(frozen=True)
class Boom:
    """Properties of a boom that do not change."""

    place: Array  # p (3,) m: position of the base section's tail from the pivot
    masses: Array  # (S,) kg
    first: Array  # (S, 3) kg m: int rho r over each section, with the position r from its tail
    inertia: Array  # (S, 3, 3) kg m^2: moment of inertia of each section about its tail
    loads: Array  # (S, 6, i): forces on each section, and moments about its tail, by all i inputs
    moments: Moments  # first moments by the coordinates
    shortened: list[Shortening]
    rotating: Array  # T_k (3, n, n) of the module's docstring
    carried: Array  # N_jk (3, 3, n, n) of the module's docstring

    @property
    def mass(self) -> float:
        """Mass of the whole boom in kg."""
        return float(self.masses.sum())

    def tails(self, extended: Extensions) -> Array:
        """Positions d (S, 3) in m of the sections' tails from the pivot, with the sections as far out as `extended`."""
        return self.place + np.outer(np.cumsum(extended.value[: len(self.masses)]), np.eye(3)[0])


@dataclass(frozen=True)
class SectionMoments:
    """First moments mu (S, 4, 3) of the sections' displacements at one instant, with their derivatives."""

    # (S, 4, 3) kg m for 1 and kg m^2 for x, y and z, with the displacements along x, y and z; and their rates in time
    value: Array
    rate: Array
    second: Array  # second rate without the part that accelerations of coordinates and paths cause
    by_motion: Array  # derivatives (S, 4, 3, 6 + n + P) by the displacements of base, coordinates and paths

    @classmethod
    def of(cls, boom: Boom, extended: Extensions, q: Array, rate: Array, beta: Moments) -> SectionMoments:
        """Moments at coordinates q (n,) with rates `rate` (n,), where `beta` is the part that is linear in q.

        The sections of the boom are as far out as `extended`.
        """
        n, beta_rate = len(q), beta.slope @ extended.rate
        by_motion = np.zeros((*beta.value.shape[:3], 6 + n + len(extended.value)))
        by_motion[..., 6 : 6 + n], by_motion[..., 6 + n :] = beta.value, np.einsum("sljne,n->slje", beta.slope, q)
        mu, mu_rate = beta.value @ q, beta.value @ rate + beta_rate @ q
        mu_second = 2.0 * beta_rate @ rate + beta.curve @ q
        for term in boom.shortened:
            factor, factor_rate, factor_second = term.factor(extended)
            at, Gq = (term.section, term.over, 0), term.G @ q
            half = q @ Gq / 2.0
            by_motion[at][6 : 6 + n] += factor * Gq
            mu[at] += factor * half
            mu_rate[at] += factor * (rate @ Gq) + factor_rate * half
            mu_second[at] += factor * (rate @ term.G @ rate) + 2.0 * factor_rate * (rate @ Gq) + factor_second * half
            if term.cylinder is not None:
                by_motion[at][6 + n + term.cylinder] += half / extended.value[term.cylinder] ** 2
        return cls(mu, mu_rate, mu_second, by_motion)


def accelerations(boom: Boom, motion: FrameMotion, extended: Extensions, driven: Array) -> Array:
    """Accelerations y (S, 4, 3), less gravity, of points at rest in each of S sections.

    The second axis has, for each section, the acceleration of its tail, then the slopes of the acceleration over x, y
    and z.  The last axis has the components along x, y and z.  `driven` (6 + P,) are the linear and the angular
    acceleration of the frame, and the second rates of the paths.
    """
    y, spin, S = np.empty((len(boom.masses), 4, 3)), skew(motion.omega), len(boom.masses)
    gradient = spin @ spin + skew(driven[3:6])
    rates = np.cumsum(extended.rate[:S])
    seconds = np.cumsum(driven[6 : 6 + S])
    y[:, 0] = motion.weight + driven[:3] + boom.tails(extended) @ gradient.T
    y[:, 0] += 2.0 * np.outer(rates, spin[:, 0]) + np.outer(seconds, np.eye(3)[0])
    y[:, 1:] = gradient.T
    return y


def base_equations(
    boom: Boom, motion: FrameMotion, extended: Extensions, q: Array, rate: Array, moments: Moments | None = None
) -> BaseEquations:
    r"""Mass matrix and forces of the equations of base, coordinates q (n,) and paths, at one instant.

    A motion l of base or paths moves the points of a section as :math:`\sum_l \hat r_l V_l`, with :math:`\hat r` = (1,
    r + u).  A motion of coordinates or paths moves them as the displacement u.  Let :math:`A = \int \rho\, \hat r \hat
    r^T` be the second moments of a section, :math:`\mu` its first moments, and J the derivatives of these by all
    motions.  The mass matrix is the sum of :math:`V^T A V + V^T J + J^T V` over the sections.  The forces are the sum
    of :math:`V^T (A\, y + \ddot\mu + 2\, \omega \times \dot\mu) + J^T y`, with the :math:`y` of `accelerations`.  The
    matrices T and N of the frame's rotation add what is quadratic in u.

    `rate` (n,) are the rates of q.  `moments` replace the boom's moments unless None.
    """
    n, e, spin = len(q), np.eye(3), skew(motion.omega)
    S, P = len(boom.masses), len(extended.value)
    mu = SectionMoments.of(boom, extended, q, rate, boom.moments if moments is None else moments)
    d, y = boom.tails(extended), accelerations(boom, motion, extended, np.zeros(6 + P))
    V = np.zeros((S, 4, 3, 6 + n + P))
    V[:, 0, :, :3], V[:, 0, :, 3:6], V[:, 1:, :, 3:6] = e, -skew(d), -skew(e)
    V[:, 0, 0, 6 + n : 6 + n + S] = np.tril(np.ones((S, S)))  # a path moves its own section and all after it
    A, Nq = np.empty((S, 4, 4)), boom.carried @ q
    A[:, 0, 0], A[:, 0, 1:] = boom.masses, boom.first + mu.value[:, 0]
    A[:, 1:, 0] = A[:, 0, 1:]
    A[:, 1:, 1:] = np.trace(boom.inertia, axis1=1, axis2=2)[:, None, None] / 2.0 * e - boom.inertia
    A[:, 1:, 1:] += mu.value[:, 1:] + mu.value[:, 1:].transpose(0, 2, 1)
    A[0, 1:, 1:] += (Nq @ q + (Nq @ q).T) / 2.0  # that of all sections

    def sum_over(a: Array, b: Array) -> Array:
        """Sum of products of a (S, 4, 3, ...) and b (S, 4, 3, ...) over their first three axes.

        The result has the further axes of a, then those of b.
        """
        return np.tensordot(a, b, ((0, 1, 2), (0, 1, 2)))

    coupling = sum_over(V, mu.by_motion)
    coupling[3:6, 6 : 6 + n] += boom.rotating @ q
    mass = sum_over(V, np.einsum("slm,smja->slja", A, V)) + coupling + coupling.T
    forces = sum_over(V, A @ y + mu.second + 2.0 * mu.rate @ spin.T) + sum_over(mu.by_motion, y)
    carried_rate = Nq @ rate + (Nq @ rate).T
    forces[3:6] += (np.trace(carried_rate) * e - carried_rate) @ motion.omega + spin @ (boom.rotating @ q @ rate)
    squared = np.outer(motion.omega, motion.omega) - (motion.omega @ motion.omega) * e
    forces[6 : 6 + n] += 2.0 * motion.omega @ (boom.rotating @ rate)
    forces[6 : 6 + n] += np.einsum("jk,jkn->n", squared, (Nq + Nq.transpose(1, 0, 2)) / 2.0)
    return BaseEquations(mass, forces)


class FreeBase:
    """Inertia of a boom of S sections on n coordinates, in the order of `pmr.system.assembly.Assembly`.

    Raises InputError if the scene has no frame that turns the boom out of its vertical plane, or if a body is planar or
    not reduced.  Also if points of a body are clamped, because the work of its loads on rigid motions is then not
    known.
    """

    def __init__(self, scene: Scene, system: System, assembly: Assembly | None = None) -> None:
        """Collect the inertia of the scene's boom from the reduced models of `system`.

        If `assembly` is None, the system is assembled here.  Raises InputError if the scene has no frame that turns the
        boom out of its vertical plane, if a body is planar or not reduced, or if points of a body are clamped.
        """
        assembly = Assembly(system) if assembly is None else assembly
        if scene.frame is None or scene.frame.out_of_plane_key is None or not scene.frame.has_angles:
            allowed = "a frame with a pivot that luffs and slews is allowed, for it makes all fields of inertia"
            raise InputError("scene", "frame", None, allowed)
        n = assembly.size
        sections = [_rigid_section(scene, k, system.reduced[name], assembly) for k, name in enumerate(scene.names)]
        rigid = {of: np.array([section[of] for section in sections]) for of in ("masses", "first", "inertia", "loads")}
        #: column of the inertia input by (section, 0 to 3 for the moment over 1, x, y, z, 0 to 2 for the axis along it)
        self.fields = {
            (k, " xyz".index(over or " "), "xyz".index(along)): column
            for k, name in enumerate(scene.names)
            for along, over, column in _inertia_inputs(system.reduced[name], assembly.input_slices[name].start)
        }
        rotating, carried, shortened = np.zeros((3, n, n)), np.zeros((3, 3, n, n)), list[Shortening]()
        terms = {term.name: term for term in assembly.terms}
        self._scene, self._terms = scene, {term.name: term.stiffness for term in assembly.terms}
        for frame_term in frame_terms(scene):
            term = terms[frame_term.name]
            if frame_term.kind == "rotation":
                rotating["xyz".index(frame_term.component)] += term.damping.toarray()
            elif frame_term.kind == "carried":
                j, k = ("xyz".index(axis) for axis in frame_term.component)
                for at in {(j, k), (k, j)}:
                    carried[at] += term.stiffness.toarray()
            elif frame_term.kind in ("field", "cylinder"):
                section = (
                    scene.names.index(frame_term.carried_section) if frame_term.carried_section else frame_term.number
                )
                cylinder = frame_term.number if frame_term.kind == "cylinder" else None
                shortened.append(Shortening(section, len(frame_term.component) - 1, term.stiffness.toarray(), cylinder))
        self.size, self._count = n, len(sections)
        B = self.moments(assembly.B.toarray())
        #: names of paths that move no section, such as a slider's
        self.aside = tuple(name for name in system.paths if name not in (*scene.names, LUFFING))
        moments = Moments(B, np.zeros((*B.shape, len(sections) + len(self.aside))), 0.0 * B)
        place = np.array(scene.frame.tail_position)
        self.boom = Boom(place, **rigid, moments=moments, shortened=shortened, rotating=rotating, carried=carried)

    def moments(self, B: Array) -> Array:
        """Moments beta (..., S, 4, 3, n) from the matrix B (..., n, i) of inputs on coordinates.

        B is the matrix of the assembly, or that of a `pmr.system.changing_rows.InputResponse`, which includes the
        response of contacts.
        """
        moments = np.zeros((*B.shape[:-2], self._count, 4, 3, self.size))
        section, over, along = np.array(list(self.fields)).T
        moments[..., section, over, along, :] = np.swapaxes(B[..., list(self.fields.values())], -1, -2)
        return moments

    def moments_with_contacts(self, contacts: EliminatedContacts, at: Extensions) -> Moments:
        """First moments at extensions `at`, with the displacements by which `contacts` give way to inertia."""
        response, curve = contacts.response(at.value), contacts.curve(at.value, at.rate)
        return Moments(
            self.moments(response.B), np.moveaxis(self.moments(response.B_slope), 0, -1), self.moments(curve)
        )

    def weight(self, upwards: Array, count: int) -> Array:
        """Loads (i,) by the weight of the boom, on all i = `count` inputs.

        Inputs of inertia have accelerations in m/s^2 as their loads; the loads on all other inputs are zero.  `upwards`
        (3,) in m/s^2 is minus the acceleration of gravity, in the axes of the boom.
        """
        loads = np.zeros(count)
        for (_, over, along), column in self.fields.items():
            loads[column] = 0.0 if over else -upwards[along]
        return loads

    def inertia(self, motion: FrameMotion, driven: Array, extended: Extensions, loads: Array) -> Array:
        """Return a copy of the `loads` (i,) on all inputs, with the frame's accelerations as loads on inertia inputs.

        `motion` is that of the frame, and the sections are `extended`.  `driven` (6,) are the linear acceleration of
        the pivot and the angular acceleration of the frame.
        """
        changed, y = loads.copy(), accelerations(self.boom, motion, extended, np.append(driven, extended.second))
        for at, column in self.fields.items():
            changed[column] = -y[at]
        return changed

    def load_shortenings(self, load: str) -> Iterator[tuple[int | None, Array]]:
        """Yield (cylinder, G) of the load with this name: its point moves by -q^T G q / 2 along x, G (n, n) in 1/m.

        `cylinder` is None, or the number of an extension: q^T G q / 2 then has to be divided by the length of this
        extension.
        """
        for term in frame_terms(self._scene):
            if term.kind in ("load", "cylinder load"):
                if input_name(term.carried_section or term.bodies[0], term.component) == load:
                    yield (term.number if term.kind == "cylinder load" else None), self._terms[term.name].toarray()

    def load_wrench(self, f: Array, extended: Extensions) -> Array:
        """Force and moment about O (6,) by loads f (i,) on the undeformed boom with sections as `extended`.

        Loads by inertia are left out.
        """
        wrenches = self.boom.loads @ f
        wrenches[:, 3:] += np.cross(self.boom.tails(extended), wrenches[:, :3])
        return np.asarray(wrenches.sum(axis=0))

    def path_forces(self, f: Array) -> Array:
        """Forces (P,) in N along the P paths by loads f (i,): those on a path's section and all sections after it.

        The force is zero for a path that moves no section.
        """
        forces = np.zeros(self.boom.moments.slope.shape[-1])
        forces[: self._count] = np.cumsum((self.boom.loads @ f)[::-1, 0])[::-1]
        return forces


def _inertia_inputs(body: ReducedModel, first: int) -> Iterator[tuple[str, str, int]]:
    """Yield the axis, the lever axis and the number of each inertia input of a body.

    The lever axis is ``""`` for a uniform field.  Numbers count from `first`, the number of the body's first input.
    """
    for number, name in enumerate(body.input_names, first):
        if name.startswith(INERTIA):
            field = name.removeprefix(INERTIA)
            yield field[0], field[1:], number


def _rigid_section(scene: Scene, number: int, body: ReducedModel, assembly: Assembly) -> dict[str, Array | float]:
    """Return the rigid-body properties of section `number`, for `Boom`.

    The keys are ``masses``, ``first``, ``inertia`` and ``loads``, the force and moment by each input; the shapes are
    those in `Boom` for one section.  Mass properties follow from the work of the section's inertia loads on its six
    rigid motions; the columns of these inputs in ``loads`` are zero.  Raises InputError for planar sections, and if the
    work on rigid motions is not known.
    """
    name, W = scene.names[number], body.rigid_work
    if set(motion_directions(member_at(scene, number))) != {"x", "y", "z", "rx", "ry", "rz"}:
        allowed = "a model in space is allowed on a base that moves freely"
        raise InputError("scene", scene.section_key(number, "body.model"), None, allowed)
    if W is None:
        allowed = "a body none of whose points is clamped (supports of points = 'mean') is allowed on a free base"
        raise InputError("system", f"bodies.{name}.rigid_work", None, allowed)
    S, loads = np.zeros((6, W.shape[1])), np.zeros((6, assembly.B.shape[1]))
    loads[:, assembly.input_slices[name]] = W
    for along, over, column in _inertia_inputs(body, 0):
        j = "xyz".index(along)
        if over:
            S[3:, column] = skew(np.eye(3)["xyz".index(over)])[:, j]
        else:
            S[j, column] = 1.0
        loads[:, assembly.input_slices[name].start + column] = 0.0
    gram = W @ S.T
    first, inertia = gram[3:, :3], gram[3:, 3:]
    first = np.array([first[2, 1] - first[1, 2], first[0, 2] - first[2, 0], first[1, 0] - first[0, 1]]) / 2.0
    return {"masses": gram[0, 0], "first": first, "inertia": (inertia + inertia.T) / 2.0, "loads": loads}
