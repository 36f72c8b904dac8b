r"""A boom at rest in its frame at given extensions and angles: its scene, and the forces on supports and machine.

In a run these forces r (on rigid supports, at the pivot and of the luffing cylinder) are linear in the coordinates q,
the contact forces :math:`\lambda` and the loads f.  The terms of the frame, with the amount :math:`a_w` of each
component w of the load, add forces that are linear in q.  The matrices R follow from the functions that a run uses,
applied to states with a single entry of 1:

.. math:: r = R_q q + R_\lambda \lambda + R_f f + \sum_w a_w R_w q
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pmr.files.arrays import Array
from pmr.results import Energy
from pmr.results.response import Output
from pmr.scene import Scene
from pmr.scene.frame import BaseMotion
from pmr.scene.keys import SLIDER
from pmr.scene.mechanism import frame_terms
from pmr.scene.signals import Constant, SignalBase
from pmr.simulation.excitation import term_signals
from pmr.simulation.reactions import response_to_motion, with_forces_at_pivot, with_support_reactions
from pmr.system.assembly import Assembly
from pmr.system.states import SystemTrajectory, displacements

#: Number of angles among which the steepest angle is searched.
ANGLES = 1001


class ListSignal(SignalBase):
    """Signal with one value of a list at each of the times 0, 1, 2 ...; its rate is 0 at all times.

    The value stays from each of these times to the next, and after the last one.
    """

    values: tuple[float, ...]
    acceleration: float = 0.0  # second rate at all times, in the unit of the values

    def _derivative(self, t: ArrayLike, order: int) -> Array:
        """Value (`order` 0), rate (1) or second rate (2) at the times t (any shape), in the shape of t."""
        if order > 0:
            return np.full(np.shape(t), self.acceleration if order == 2 else 0.0)
        return np.array(self.values)[np.clip(np.asarray(t, float).astype(int), 0, len(self.values) - 1)]


def critical_luffing(scene: Scene) -> float:
    """Luffing angle in rad at which gravity compresses the boom most.

    Of `ANGLES` evenly spaced angles, from the smallest to the largest in the scene's time, it is the one with the
    largest sine.  This is not the largest angle if the boom luffs beyond 90 degrees.  The scene must have a frame.
    """
    angles = np.linspace(*scene.present_frame.angles.luffing.bounds(0.0, scene.time.end), ANGLES)
    return float(angles[np.argmax(np.sin(angles))])


def scene_at_rest(
    scene: Scene,
    extensions: Mapping[str, Array],
    luffing: Array | float,
    slewing: Array | float,
    loads: Mapping[str, float],
) -> Scene:
    """Scene at rest in P postures: at the times 0, 1 ... P - 1 s it is in the posture with the number of the time.

    The weight acts in full.  The base keeps its constant inclination; its motions are removed.  In the returned scene
    all angles are in the unit of its frame, rad or degrees.

    Parameters
    ----------
    scene : Scene
        A scene with a frame.
    extensions : mapping of str to (P,) array, m
        Extensions of joints by the section's name, and of a slider as `SLIDER`.  An extension that is not named keeps
        its signal, so name all that vary in time.
    luffing, slewing : float or (P,) array, rad
        Angles of the frame; `slewing` has no effect on a frame without a slewing angle.
    loads : mapping of str to float
        Constant values of all loads on sections, by the loads' names.
    """
    changed, frame = [], scene.present_frame
    for part in scene.sections:
        steady = tuple(load.model_copy(update={"signal": Constant(amount=loads[load.name])}) for load in part.loads)
        joint = part.joint
        if joint is not None and part.name in extensions:
            stays = _signal_of(extensions[part.name])
            joint = joint.with_keys(extension=stays, overlap=None, follows=None)
        slider = part.slider
        if slider is not None and SLIDER in extensions:
            slider = slider.with_keys(path=_signal_of(extensions[SLIDER]))
        changed.append(part.with_keys(loads=steady, joint=joint, slider=slider))
    still = {"luffing": _signal_of(luffing * frame.radian), "base": constant_inclination(frame.base)}
    still |= {"slewing": _signal_of(slewing * frame.radian)} if frame.slewing is not None else {}
    return scene.with_keys(sections=tuple(changed), frame=still, gravity={"rise": 0.0} if scene.gravity else None)


def constant_inclination(base: BaseMotion | None) -> BaseMotion | None:
    """Base that keeps only those angles of `base` that are constant in time; None if there are none."""
    angles = {} if base is None else {key: base.motions.get(key) for key in ("rx", "ry", "rz")}
    constant = {key: angle for key, angle in angles.items() if isinstance(angle, Constant)}
    return BaseMotion(**constant) if constant else None


def accelerate_angle(still: Scene, angle: str) -> Scene:
    """Return the scene `still`, made by `scene_at_rest`, with an acceleration of 1 rad/s^2 of one of its two angles.

    `angle` is ``luffing`` or ``slewing``.
    """
    turned = getattr(still.frame, angle).model_copy(update={"acceleration": still.present_frame.radian})
    return still.with_keys(frame={angle: turned})


def amplitudes_at_rest(scene: Scene, extensions: Mapping[str, Array], luffing: float) -> Array:
    """Amplitudes c (P, k) of the k terms of a scene's moving frame, for a boom at rest in P postures.

    A term is a matrix of the system times an amplitude that varies in time, such as the geometric stiffness by the
    weight (`pmr.system.terms`).  For a scene without terms, k is 0.

    `extensions` has the extensions (P,) in m by name, of one section at least; `luffing` is the luffing angle in rad of
    all postures.  The weight acts in full.  A load that pulls at the boom along its axis has its smallest value in the
    scene's time, because the boom is compressed most when such a load is small.  Every other load has its largest
    value.
    """
    if not list(frame_terms(scene)):
        return np.empty((len(next(iter(extensions.values()))), 0))
    pulls = {"body": {"x": 1.0}, "ground": {"x": np.cos(luffing), "z": np.sin(luffing)}}
    pressing = {
        load.name: load.signal.bounds(0.0, scene.time.end)[0 if pulls[load.axes].get(load.direction, 0.0) > 0.0 else 1]
        for part in scene.sections
        for load in part.loads
    }
    still = scene_at_rest(scene, extensions, luffing, 0.0, pressing)
    numbers = np.arange(max(len(values) for values in extensions.values()), dtype=float)
    return np.column_stack([signal.value(numbers) for signal in term_signals(still, frame_terms(scene)).values()])


def _signal_of(values: Array | float) -> SignalBase:
    """Constant signal for a number, or `ListSignal` for an array (T,) of values."""
    return (
        Constant(amount=float(values))
        if np.ndim(values) == 0
        else ListSignal(values=tuple(np.asarray(values).tolist()))
    )


@dataclass(frozen=True)
class RestRows:
    """Coefficients of r forces at one posture, for n coordinates, m contact forces, i loads and w components of load.

    The r forces are those on supports and on the machine, and the matrices are those of the module's docstring.
    `outputs` describe the forces; `coordinates` is R_q (r, n), `contacts` R_lambda (r, m), `loads` R_f (r, i), and
    `parts` (w, r, n) holds R_w for each component.
    """

    outputs: tuple[Output, ...]
    coordinates: Array
    contacts: Array
    loads: Array
    parts: Array

    @property
    def arrays(self) -> tuple[Array, ...]:
        """The arrays `coordinates`, `contacts`, `loads` and `parts`, in this order."""
        return self.coordinates, self.contacts, self.loads, self.parts

    @classmethod
    def stack(cls, rows: Sequence[RestRows]) -> RestRows:
        """Stack `rows`, the coefficients at P postures: each array gets an axis of P in front, `outputs` is empty."""
        return cls((), *map(np.array, zip(*(at.arrays for at in rows), strict=True)))


def rest_rows(scene: Scene, assembly: Assembly, place: int, x: Array, amplitudes: Array) -> RestRows:
    """Coefficients of the forces on supports and on the machine, in one posture of a scene made by `scene_at_rest`.

    Parameters
    ----------
    place : int
        Number of the posture.
    x : (sides,) array, m
        Positions of the sides of all contacts.
    amplitudes : (w, k) array
        A row for each of w components of the load: the amplitudes of the system's k terms under a unit of it.
    """
    system, n, m, parts = assembly.system, assembly.size, len(assembly.system.contacts), len(amplitudes)
    ends = np.cumsum([n, m, assembly.B.shape[1]])
    states = np.zeros((int(ends[-1]) + parts * n, ends[-1]))  # coordinates, contact forces and loads
    states[: ends[-1]] = np.eye(ends[-1])
    c, none = np.zeros((len(states), amplitudes.shape[1])), np.zeros(len(states))
    for number, amplitude in enumerate(amplitudes):
        body_states = slice(ends[-1] + number * n, ends[-1] + (number + 1) * n)
        states[body_states, :n], c[body_states] = np.eye(n), amplitude
    q, forces, loads = np.split(states, ends[:2], axis=1)
    coordinates = {name: assembly.body_coordinates(name, q) for name in system.bodies}
    trajectory = SystemTrajectory.from_states(
        system,
        none + place,
        {name: (q, np.zeros_like(q)) for name, q in coordinates.items()},
        np.broadcast_to(x, (len(states), len(x))),
        forces,
        None,
        np.zeros((2, len(states))),
        loads=loads,
        seconds=0.0,
        surplus=np.nan,
        amplitudes=c if system.terms else None,
    )
    of_sections = displacements(system, trajectory)
    response = response_to_motion(system, trajectory.t, of_sections, forces, None, Energy(none, none, none))
    first = len(response.other_names)
    response = with_forces_at_pivot(scene, with_support_reactions(response, system, trajectory))
    values = np.empty((0, len(states))) if response.others is None else response.others.T[first:]
    q, forces, loads = np.split(values[:, : ends[-1]], ends[:2], axis=1)
    more = values[:, ends[-1] :].reshape(len(values), parts, n).transpose(1, 0, 2) - q
    return RestRows(response.outputs[len(response.outputs) - len(values) :], q, forces, loads, more)
