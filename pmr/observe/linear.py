r"""Linear model of a system along its paths, from the kernel's derivatives of each step.

.. math::
    \xi_{k+1} = A_k \xi_k + B_k f_k, \qquad y_k = \bar y_k + C_k \xi_k + D_k f_k

Here :math:`\xi` (n,) is the deviation of the prediction, from which a step of the kernel begins, from that of a
reference motion, f (i,) the deviation of loads, and y (q,) are quantities with their values :math:`\bar y` in the
reference motion.  The model is exact where contacts hold; contacts that push and pads that rub go on as in the
reference motion.

Accelerations and velocities of outputs y = Y(s) z follow a place that moves along its path:

.. math::
    \dot y = Y \dot z + \dot Y z, \qquad \ddot y = Y \ddot z + 2 \dot Y \dot z + \ddot Y z

with the rates of Y along the motion of the paths, which central differences of neighbouring steps give.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pmr.compare.responses import march_once
from pmr.compare.simulated import excitation_of_scene
from pmr.errors import InputError
from pmr.files.arrays import Array
from pmr.results.quantities import QUANTITIES
from pmr.scene.built import force_name
from pmr.scene.scene import Scene
from pmr.simulation.excitation import Excitation
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.march import March
from pmr.simulation.stepping import TimeStepping
from pmr.system.system import System

#: Words before the name of an output, by the derivative with respect to time that they ask for.
VELOCITY, ACCELERATION, SPECIFIC_FORCE = "velocity of ", "acceleration of ", "specific force of "
_ORDERS = {VELOCITY: 1, ACCELERATION: 2, SPECIFIC_FORCE: 2}
_UNITS = {VELOCITY: "m/s", ACCELERATION: "m/s^2", SPECIFIC_FORCE: "m/s^2"}


@dataclass(frozen=True)
class LinearMotion:
    """Linear model of q outputs at T steps around a reference motion, for n states and i loads (`linearize`)."""

    t: Array  # (T,) s
    outputs: tuple[str, ...]  # (q,)
    units: tuple[str, ...]  # (q,)
    kinds: tuple[str, ...]  # (q,): kinds of outputs (`pmr.results.response.KINDS`), empty for a rate
    inputs: tuple[str, ...]  # (i,)
    reference: Array  # (T, q): outputs in the reference motion
    # (T, n, n), (T, n, i), (T, q, n) and (T, q, i)
    A: Array
    B: Array
    C: Array
    D: Array
    start: Array  # (n, i): change of the first state with constant loads, in equilibrium

    @property
    def step(self) -> float:
        """Time step in s."""
        return float(self.t[1] - self.t[0])

    def sample(self, name: str, times: ArrayLike, values: ArrayLike) -> Array:
        """Values (T,) at the model's steps, NaN where there is none: each of n `values` counts at the nearest step.

        Values outside the model's steps are ignored; of several values at one step the last one counts.
        Raises an InputError with the `name` if `times` (n,) in s and values differ in length.
        """
        times, values = np.asarray(times, float), np.asarray(values, float)
        if times.shape != values.shape or times.ndim != 1:
            raise InputError("observe", f"measured.{name}", values.shape, f"{times.shape} is allowed")
        steps, sampled = np.rint((times - self.t[0]) / self.step), np.full(len(self.t), np.nan)
        used = np.isfinite(steps) & (steps >= 0) & (steps < len(self.t))
        sampled[steps[used].astype(int)] = values[used]
        return sampled

    def output_number(self, name: str) -> int:
        """Number of an output; an InputError is raised for a name that the model does not have."""
        return _number(name, self.outputs, "outputs")

    def input_number(self, name: str) -> int:
        """Number of a load; an InputError is raised for a name that the model does not have."""
        return _number(name, self.inputs, "inputs")


def _number(name: str, names: Sequence[str], key: str) -> int:
    """Number of `name` among `names`; an InputError with the `key` is raised if it is not among them."""
    if name not in names:
        raise InputError("observe", key, name, f"one of these is allowed: {', '.join(names)}")
    return names.index(name)


class Selection(NamedTuple):
    """Outputs that were chosen, by name, and how each follows from the columns of a kernel."""

    names: tuple[str, ...]
    columns: list[int]  # numbers among outputs of the bodies, then forces of the contacts
    orders: list[int]  # how often each is differentiated with respect to time
    units: tuple[str, ...]
    kinds: tuple[str, ...]  # empty for a rate
    axes: tuple[str, ...]  # x, y or z of a displacement and its rates


def select_outputs(scene: Scene, system: System, targets: Sequence[str]) -> Selection:
    """Outputs of a system by their names, or by keys of the table of quantities, such as ``tip`` or ``pad_force``.

    They are in the order of `targets`, each once; a key stands for all outputs of its kinds.
    A displacement may be preceded by ``velocity of``, ``acceleration of`` or, for an accelerometer, which feels
    gravity, ``specific force of``.  Raises InputError for a name that the system does not have.
    """
    available = (*system.output_names, *map(force_name, system.contact_names))
    units = (*system.output_units, *("N",) * len(system.contact_names))
    excitation = excitation_of_scene(scene, system)
    grid = excitation.with_stepping(replace(excitation.stepping, end=excitation.stepping.step, schedule=()))
    meanings = {each.name: each for each in march_once(scene, system, grid).outputs}
    names = list[str]()
    for name in targets:
        kinds = QUANTITIES[name].kinds if name in QUANTITIES else ()
        of_table = [each for each in available if each in meanings and meanings[each].kind in kinds]
        if name in QUANTITIES and not of_table:
            raise InputError("observe", "outputs", name, "a quantity that outputs of this system state is allowed")
        names += of_table or [name]
    names = list(dict.fromkeys(names))
    words = [next((words for words in _ORDERS if name.startswith(words)), "") for name in names]
    bases = [name.removeprefix(start) for name, start in zip(names, words, strict=True)]
    columns = [_number(base, available, "outputs") for base in bases]
    for name, start, column in zip(names, words, columns, strict=True):
        if start and units[column] != "m":
            raise InputError("observe", "outputs", name, f"displacements are allowed behind {start.strip()!r}")
    return Selection(
        names=tuple(names),
        columns=columns,
        orders=[_ORDERS.get(start, 0) for start in words],
        units=tuple(_UNITS.get(start, units[column]) for start, column in zip(words, columns, strict=True)),
        kinds=tuple("" if start else meanings[base].kind for base, start in zip(bases, words, strict=True)),
        axes=tuple(meanings[base].direction for base in bases),
    )


def linearize(
    scene: Scene, system: System, outputs: Sequence[str], inputs: Sequence[str] = (), step: float | None = None
) -> LinearMotion:
    """Linear model of a saved system along the paths of a scene.

    Parameters
    ----------
    scene : Scene
        Its paths, loads and start are those of the reference motion; paths of constant signals keep the system at one
        place.
    system : System
        Reduced bodies and their contacts.
    outputs : sequence of str
        Names of outputs, or keys of the table of quantities (`select_outputs`).
    inputs : sequence of str
        Names of loads, as in `System.input_names`, by which the model has derivatives.
    step : float, s, optional
        Time step; by default that of the scene.

    Raises
    ------
    InputError
        If the scene does not fit the system, or a name is not one of the system.  Also for accelerations and velocities
        in a frame that moves.
    """
    chosen = select_outputs(scene, system, outputs)
    excitation = excitation_of_scene(scene, system)
    grid = TimeStepping(excitation.stepping.end, step or excitation.stepping.step, excitation.stepping.rho_inf, parts=1)
    excitation = excitation.on_grid(grid)
    form = SystemForm.of(system)
    if form.kernel.motions and any(chosen.orders):
        named = next(name for name, order in zip(chosen.names, chosen.orders, strict=True) if order)
        raise InputError("observe", "outputs", named, "displacements and forces are allowed in a frame that moves")
    load_columns = [form.kernel.paths + _number(name, system.input_names, "inputs") for name in inputs]
    steps = _differentiate(form, excitation, chosen, load_columns)
    gravity = _gravity_of(scene, chosen)
    return LinearMotion(
        excitation.times[1:],
        chosen.names,
        chosen.units,
        chosen.kinds,
        tuple(inputs),
        steps.reference + gravity,
        *steps[1:],
    )


def _gravity_of(scene: Scene, chosen: Selection) -> Array:
    """Gravity (q,) in m/s^2 that accelerometers along z feel at rest; zero for all other outputs."""
    felt = np.zeros(len(chosen.names))
    for k, (name, axis) in enumerate(zip(chosen.names, chosen.axes, strict=True)):
        if name.startswith(SPECIFIC_FORCE) and scene.gravity is not None and axis == "z":
            felt[k] = scene.gravity.acceleration
    return felt


class _Steps(NamedTuple):
    """Matrices of T steps; as `LinearMotion`."""

    reference: Array
    A: Array
    B: Array
    C: Array
    D: Array
    start: Array


def _differentiate(form: SystemForm, excitation: Excitation, chosen: Selection, loads: list[int]) -> _Steps:
    """Matrices of all steps of an excitation, with the `chosen` outputs and loads in the columns `loads` of drivers."""
    march = March(form, excitation)
    if error := march.start():
        raise error
    state, kernel = march.state, form.kernel
    modes = form.mode_columns
    states = np.concatenate([modes, modes + kernel.modes, modes + 2 * kernel.modes])
    u = march.sample_drivers(0, excitation.stepping.steps, 1)
    T, r, q, first_forces = len(u) - 1, len(modes), len(chosen.names), len(form.system.output_names)
    columns, order = np.array(chosen.columns, int), np.array(chosen.orders, int)
    moving = np.nonzero(order)[0]
    A, B = np.zeros((T, 3 * r, 3 * r)), np.zeros((T, 3 * r, len(loads)))
    C, D, E = np.zeros((T, q, 3 * r)), np.zeros((T, q, len(loads))), np.zeros((T, 3 * r, 3 * r))
    G, reference = np.zeros((T, 3 * r, len(loads))), np.zeros((T, q))
    shapes, motion = np.zeros((T, q, r)), np.zeros((T, 3, r))  # Y of outputs in motion; z, v and accelerations
    for k in range(T):
        jacobian = state.linearize(u[k + 1])
        of_state = np.vstack([jacobian.C[:first_forces], form.combined.original_forces(jacobian.L.T).T])
        of_loads = np.vstack([jacobian.D[:first_forces], form.combined.original_forces(jacobian.K.T).T])
        A[k], B[k] = jacobian.A[np.ix_(states, states)], jacobian.B[np.ix_(states, loads)]
        C[k], D[k] = of_state[columns][:, states], of_loads[columns][:, loads]
        state.step(u[k + 1])
        present = state.outputs()
        reference[k] = np.concatenate([present.values[:first_forces], present.forces])[columns]
        if order.any():
            E[k], G[k] = jacobian.E[np.ix_(states, states)], jacobian.G[np.ix_(states, loads)]
            shapes[k, moving] = state.output_shapes(u[k + 1], modes)[columns[moving]]
            accelerations = state.evaluate(u[k + 1])["accelerations"]
            motion[k] = state.z[modes], state.v[modes], accelerations[modes]
    if order.any():
        h = excitation.stepping.step
        rates, second_rates = _rates(shapes, h)
        loaded = reference - np.einsum("tqr,tr->tq", shapes, motion[:, 0])  # by loads alone
        loaded_rates = _rates(loaded, h)
        by_order = {
            1: np.concatenate([rates, shapes, np.zeros_like(shapes)], axis=2),
            2: np.concatenate([second_rates, 2.0 * rates, shapes], axis=2),
        }
        for which, rows in by_order.items():
            at = np.nonzero(order == which)[0]
            C[:, at], D[:, at] = rows[:, at] @ E, rows[:, at] @ G
            of_motion = np.einsum("tqn,tn->tq", rows[:, at], motion.reshape(T, 3 * r))
            reference[:, at] = of_motion + loaded_rates[which - 1][:, at]
    start = np.zeros((3 * r, len(loads)))
    if loads:  # equilibrium under a constant load: the state that the first step keeps
        start = np.linalg.lstsq(np.eye(3 * r) - A[0], B[0], rcond=None)[0]
    return _Steps(reference, A, B, C, D, start)


def _rates(values: Array, h: float) -> tuple[Array, Array]:
    """First and second rates of values (T, ...) at T steps of h s, by central differences; copied to the ends.

    They are zero for fewer than three steps.
    """
    rates, second_rates = np.zeros_like(values), np.zeros_like(values)
    if len(values) > 2:
        rates[1:-1] = (values[2:] - values[:-2]) / (2.0 * h)
        second_rates[1:-1] = (values[2:] - 2.0 * values[1:-1] + values[:-2]) / h**2
        for array in (rates, second_rates):
            array[0], array[-1] = array[1], array[-2]
    return rates, second_rates


def output_sensitivity(reference: LinearMotion, changed: LinearMotion) -> Array:
    """Differences (T, q) that a changed parameter makes in all outputs of the reference motion.

    `changed` is the same motion of a system in which one parameter (a stiffness, Young's modulus, a mass) is changed.
    Raises InputError if the two motions have other steps or outputs.
    """
    if reference.outputs != changed.outputs or reference.t.shape != changed.t.shape:
        raise InputError("observe", "parameters", changed.outputs, "the outputs and steps of the reference are allowed")
    return changed.reference - reference.reference
