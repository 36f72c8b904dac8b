r"""A boom on a base that moves freely: momenta of the boom, and forces of the boom on its base, in the boom's axes.

The boom's frame, with its origin O at the pivot, has the velocity v and the angular velocity omega.  A section with its
tail at d = p + X e_x (the base section's tail is at p, X is the sum of extensions) has points, with the density
:math:`\rho`, at the position x = d + r + u, with the position r from the tail and the displacement u = Phi q by
coordinates q; with second-order terms, u includes the shortening of the boom along its axis as it bends.  With the
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

Also the response of contacts that give way to inputs and to a boom's own inertia, and the derivatives of this response
by the paths.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from pmr.errors import InputError
from pmr.files.arrays import Array, Mask
from pmr.scene import Scene
from pmr.scene.choice import motion_directions
from pmr.scene.frame import INERTIA
from pmr.scene.keys import LUFFING, input_name
from pmr.scene.mechanism import frame_terms
from pmr.scene.members import member_at
from pmr.simulation.floating import (
    CROSS,
    BaseEquations,
    Boom,
    BoomState,
    Extensions,
    FrameMotion,
    Moments,
    Shortening,
)
from pmr.simulation.frame_motion import skew
from pmr.system.assembly import Assembly
from pmr.system.changing_rows import ChangingRows
from pmr.system.reduced_model import ReducedModel
from pmr.system.system import System


def with_all_inertia(system: System) -> System:
    """System in which all coordinates have inertia: modes treated as quasi-static become ordinary ones."""
    if all(len(body.quasi_static) == 0 for body in system.bodies.values()):
        return system
    bodies = {name: replace(body, quasi_static=np.zeros(0, np.int64)) for name, body in system.reduced.items()}
    return system.with_bodies(bodies)


class FreeBase:
    """Inertia of a boom of S sections on n coordinates, in the order of `pmr.system.assembly.Assembly`.

    Raises InputError for planar sections, for a frame that does not slew, and if it is not known how supports hold the
    base.
    """

    def __init__(self, scene: Scene, system: System, assembly: Assembly | None = None) -> None:
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

        B is the matrix of the assembly, or of an `InputResponse`, which includes the response of contacts.
        """
        moments = np.zeros((*B.shape[:-2], self._count, 4, 3, self.size))
        section, over, along = np.array(list(self.fields)).T
        moments[..., section, over, along, :] = np.swapaxes(B[..., list(self.fields.values())], -1, -2)
        return moments

    def weight(self, upwards: Array, count: int) -> Array:
        """Loads (i,), i = `count`, by the weight; `upwards` (3,) in m/s^2 is minus the acceleration of gravity."""
        loads = np.zeros(count)
        for (_, over, along), column in self.fields.items():
            loads[column] = 0.0 if over else -upwards[along]
        return loads

    def inertia(self, motion: FrameMotion, driven: Array, extended: Extensions, loads: Array) -> Array:
        """The `loads` (i,) with the inertia inputs replaced by the loads of the frame's accelerations.

        `driven` (6,) is the acceleration of O and the angular acceleration of the frame.
        """
        spin, e, changed = skew(motion.omega), np.eye(3)[0], loads.copy()
        gradient, S = spin @ spin + skew(driven[3:]), self._count
        X, X_rate, X_second = (np.cumsum(values[:S]) for values in (extended.value, extended.rate, extended.second))
        at = motion.weight + driven[:3] + (self.boom.place + np.outer(X, e)) @ gradient.T
        at = at + 2.0 * np.outer(X_rate, spin @ e) + np.outer(X_second, e)
        for (section, over, along), column in self.fields.items():
            changed[column] = -(gradient[along, over - 1] if over else at[section, along])
        return changed

    def load_shortenings(self, load: str) -> Iterator[tuple[int | None, Array]]:
        """Yield (cylinder, G) of a load: its point moves by -q^T G q / 2 along the bent boom, G (n, n) in 1/m.

        `cylinder` is None, or the number of an extension: q^T G q / 2 then has to be divided by the length of this
        extension.
        """
        for term in frame_terms(self._scene):
            if term.kind in ("load", "cylinder load"):
                if input_name(term.carried_section or term.bodies[0], term.component) == load:
                    yield (term.number if term.kind == "cylinder load" else None), self._terms[term.name].toarray()

    def loads(self, f: Array, extended: Extensions) -> Array:
        """Force and moment about O (6,) by loads f (i,) on the undeformed boom, without inertia."""
        wrenches = self.boom.loads @ f
        x, y, z = np.outer(np.eye(3)[0], np.cumsum(extended.value)[: self._count]) + self.boom.place[:, None]
        force = wrenches[:, :3].T
        moments = (y @ force[2] - z @ force[1], z @ force[0] - x @ force[2], x @ force[1] - y @ force[0])
        return np.asarray(wrenches.sum(axis=0) + np.concatenate([np.zeros(3), moments]))

    def path_forces(self, f: Array) -> Array:
        """Forces (P,) along the P paths by loads f (i,): on a path's section and all sections after it.

        The force is zero for a path that moves no section.
        """
        forces = np.zeros(self.boom.moments.slope.shape[-1])
        forces[: self._count] = np.cumsum((self.boom.loads @ f)[::-1, 0])[::-1]
        return forces

    def base_equations(
        self, motion: FrameMotion, extended: Extensions, q: Array, rate: Array, moments: Moments | None = None
    ) -> BaseEquations:
        """Mass matrix and forces of the equations of base, coordinates q and extensions, at one instant.

        `rate` are the rates of q; `moments` are those of the boom if None.
        """
        state = BoomState(self.boom, motion, extended, q, rate, moments)
        return BaseEquations(state.mass(), state.forces())


def _inertia_inputs(body: ReducedModel, first: int) -> Iterator[tuple[str, str, int]]:
    """Yield the axis, the lever axis (or "") and the number, from `first` on, of each inertia input of a body."""
    for number, name in enumerate(body.input_names, first):
        if name.startswith(INERTIA):
            field = name.removeprefix(INERTIA)
            yield field[0], field[1:], number


def _rigid_section(scene: Scene, number: int, body: ReducedModel, assembly: Assembly) -> dict[str, Array | float]:
    """Return the properties of one section, fields of `Boom`: mass, first moment, inertia, loads of its inputs.

    Mass properties follow from the work of the section's inertia loads on its six rigid motions; the columns of these
    inputs in `loads` are zero.  Raises InputError for planar sections, and if the work on rigid motions is not known.
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
            S[3:, column] = CROSS[:, "xyz".index(over), j]
        else:
            S[j, column] = 1.0
        loads[:, assembly.input_slices[name].start + column] = 0.0
    gram = W @ S.T
    first, inertia = gram[3:, :3], gram[3:, 3:]
    first = np.array([first[2, 1] - first[1, 2], first[0, 2] - first[2, 0], first[1, 0] - first[0, 1]]) / 2.0
    return {"masses": gram[0, 0], "first": first, "inertia": (inertia + inertia.T) / 2.0, "loads": loads}


@dataclass(frozen=True)
class InputResponse:
    """Forces B f on coordinates (n,) by inputs f (i,), and displacements B^T q + E f (i,) at the inputs' points."""

    B: Array
    E: Array
    B_slope: Array  # d B / d s, (P, n, i)
    E_slope: Array  # (P, i, i)


class EliminatedContacts:
    """Response of a boom on n coordinates to inputs, after contacts that give way and hold both ways are eliminated.

    The mask `gives` (m,) selects these contacts; it is false for rigid contacts and for pads that only push.
    """

    def __init__(self, boom: FreeBase, assembly: Assembly, along: ChangingRows, gives: Mask) -> None:
        self._boom, self._along, self._gives = boom, along, gives
        self._B, self._E = assembly.B.toarray(), assembly.energy
        self._stored, self._moments = dict[bytes, InputResponse](), (b"", boom.boom.moments)

    def moments(self, at: Extensions) -> Moments:
        """First moments of the sections at extensions `at`; they include the response of contacts that give way."""
        key = at.value.tobytes() + at.rate.tobytes()
        if self._gives.any() and key != self._moments[0]:
            answers, of, B_curve = self.response(at.value), self._boom.moments, np.zeros_like(self._B)
            if at.rate.any():
                near, gives = self._along.evaluate(at.value), self._gives
                rows, (first, second) = (
                    near.rows.select(gives),
                    (part.select(gives) for part in near.time_derivatives(at.rate)),
                )
                bent, answer = np.split(rows.force_coefficients, [rows.C.shape[1]], axis=1)
                answer_rate = np.linalg.solve(rows.F, first.H - first.F @ answer)
                B_curve = -second.C.T @ answer - 2.0 * first.C.T @ answer_rate
                B_curve -= bent.T @ (second.H - second.F @ answer - 2.0 * first.F @ answer_rate)
            self._moments = key, Moments(of(answers.B), np.moveaxis(of(answers.B_slope), 0, -1), of(B_curve))
        return self._moments[1]

    def response(self, s: Array) -> InputResponse:
        """Response to inputs with the paths at s (P,) m; the last few responses are stored."""
        key = s.tobytes()
        if key not in self._stored:
            B, E = self._B, self._E
            B_slope, E_slope = np.zeros((len(s), *B.shape)), np.zeros((len(s), *E.shape))
            if self._gives.any():
                near = self._along.evaluate(s)
                rows, slopes = near.rows.select(self._gives), near.slopes.select(self._gives)
                bent, answer = np.split(rows.force_coefficients, [rows.C.shape[1]], axis=1)
                turned = slopes.H - slopes.F @ answer
                B, B_slope = B - rows.C.T @ answer, -slopes.C.transpose(0, 2, 1) @ answer - bent.T @ turned
                E, E_slope = E - rows.H.T @ answer, -answer.T @ turned - slopes.H.transpose(0, 2, 1) @ answer
            self._stored = dict(list(self._stored.items())[-4:]) | {key: InputResponse(B, E, B_slope, E_slope)}
        return self._stored[key]
