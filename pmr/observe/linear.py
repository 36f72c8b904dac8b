r"""Linear model of a system along its paths, from the kernel's derivatives of each step.

.. math::
    \xi_{k+1} = A_k \xi_k + B_k f_k, \qquad y_k = \bar y_k + C_k \xi_k + D_k f_k

A step of the kernel begins from a prediction.  Here :math:`\xi` (n,) is its deviation from the prediction in a
reference motion, f (i,) is the deviation of loads, and y (q,) are quantities with their values :math:`\bar y` in the
reference motion.  The model is exact where contacts hold; contacts that push and pads that rub go on as in the
reference motion.

Accelerations and velocities of outputs y = Y(s) z follow a place that moves along its path:

.. math::
    \dot y = Y \dot z + \dot Y z, \qquad \ddot y = Y \ddot z + 2 \dot Y \dot z + \ddot Y z

with the rates of Y along the motion of the paths, which central differences of neighbouring steps give; at the first
and last step Y goes on along a straight line (src/chosen.c in the kernel).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pmr.compare.responses import march_once
from pmr.compare.simulated import excitation_of_scene
from pmr.errors import InputError
from pmr.files.arrays import Array
from pmr.kernel.filter import ChosenOutputs, LinearSteps, StepMatrices
from pmr.results.quantities import QUANTITIES
from pmr.scene.built import force_name
from pmr.scene.scene import Scene
from pmr.simulation.excitation import Excitation
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.systems import March
from pmr.simulation.stepping import TimeStepping
from pmr.system.assembly import Assembly
from pmr.system.system import System

#: Words before the name of an output, by the derivative with respect to time that they ask for.
VELOCITY, ACCELERATION, SPECIFIC_FORCE = "velocity of ", "acceleration of ", "specific force of "
RATE_ORDERS = {VELOCITY: 1, ACCELERATION: 2, SPECIFIC_FORCE: 2}
#: Largest distance of an output's row to the forces of a unit load that act at the output's place, over their length.
SAME_PLACE = 0.1
_UNITS = {VELOCITY: "m/s", ACCELERATION: "m/s^2", SPECIFIC_FORCE: "m/s^2"}


@dataclass(frozen=True)
class LinearMotion:
    """Linear model of q outputs at T steps around a reference motion, for n states and i loads (`linearize`)."""

    t: Array  # (T,) s: ends of the steps, the first of them one step after the start of the motion
    outputs: tuple[str, ...]  # (q,)
    units: tuple[str, ...]  # (q,)
    kinds: tuple[str, ...]  # (q,): kinds of outputs (`pmr.results.response.KINDS`), empty for a rate
    inputs: tuple[str, ...]  # (i,)
    reference: Array  # (T, q): outputs in the reference motion
    matrices: StepMatrices
    input_units: tuple[str, ...] = ()  # (i,): N m of moments; where it is empty, all are forces in N
    # Displacements along each load at its place, by the load's name; a load that has no entry is not checked.
    displacements: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @cached_property
    def A(self) -> Array:
        """Matrices A (T, n, n) of the T steps, which multiply the state of a step to give that of the next one."""
        return self.matrices.transitions()[0]

    @cached_property
    def B(self) -> Array:
        """Matrices B (T, n, i): contributions to the next state per unit of each load."""
        return self.matrices.transitions()[1]

    @cached_property
    def C(self) -> Array:
        """Matrices C (T, q, n), which multiply the state of a step to give its outputs."""
        return np.pad(self.matrices.C, [(0, 0), (0, 0), (0, self.matrices.modes)])

    @property
    def D(self) -> Array:
        """Matrices D (T, q, i): contributions to the outputs of a step per unit of each load."""
        return self.matrices.D

    @cached_property
    def start(self) -> Array:
        """First states (n, i), one for each of i loads, at rest under one unit of this load alone.

        A state is a deviation from the reference motion.  It is at rest if the first step does not change it: with A
        and B of this step, x = A x + B, solved by least squares with the shortest x.
        """
        A, B = (each[0] for each in self.matrices.transitions(slice(1)))
        return np.linalg.lstsq(np.eye(len(A)) - A, B, rcond=None)[0] if B.shape[1] else np.zeros(B.shape)

    @property
    def step(self) -> float:
        """Time step in s."""
        return float(self.t[1] - self.t[0])

    def sample(self, name: str, times: ArrayLike, values: ArrayLike) -> Array:
        """Put n values, measured at n times, on the model's T steps (T,); steps without a value get NaN.

        `values` (n,) and `times` (n,) in s belong to the measurement `name`.  Each value is put on the nearest step; of
        several values on one step the last one is taken.  Values outside the model's steps are ignored.  Raises an
        InputError with the `name` if `times` and `values` differ in length.
        """
        times, values = np.asarray(times, float), np.asarray(values, float)
        if times.shape != values.shape or times.ndim != 1:
            raise InputError("observe", f"measured.{name}", values.shape, f"{times.shape} is allowed")
        steps, sampled = self.nearest_steps(times), np.full(len(self.t), np.nan)
        used = np.isfinite(steps) & (steps >= 0) & (steps < len(self.t))
        sampled[steps[used].astype(int)] = values[used]
        return sampled

    def nearest_steps(self, times: Array) -> Array:
        """Numbers (n,) of the steps nearest to n times in s; below 0, or T and more, for times beyond the T steps."""
        return np.asarray(np.rint((times - self.t[0]) / self.step))

    def input_unit(self, name: str) -> str:
        """Unit of the load called `name`; N if the model states no units.  Errors as `input_number`."""
        number = self.input_number(name)
        return self.input_units[number] if self.input_units else "N"

    def output_number(self, name: str) -> int:
        """Number, from 0, of the output called `name`; raises InputError if the model has no such output."""
        return _number(name, self.outputs, "outputs")

    def input_number(self, name: str) -> int:
        """Number, from 0, of the load called `name`; raises InputError if the model has no such load."""
        return _number(name, self.inputs, "inputs")


def _number(name: str, names: Sequence[str], key: str) -> int:
    """Number, from 0, of `name` among `names`; raises an InputError about the key `key` if it is not among them."""
    if name not in names:
        raise InputError("observe", key, name, f"one of these is allowed: {', '.join(names)}")
    return names.index(name)


class Selection(NamedTuple):
    """Chosen outputs of a system, with the numbers by which a kernel computes them.

    The fields have an entry for each output.
    """

    names: tuple[str, ...]
    columns: list[int]  # numbers among outputs of the bodies, then forces of the contacts
    orders: list[int]  # how often each is differentiated with respect to time
    units: tuple[str, ...]
    kinds: tuple[str, ...]  # empty for a rate
    axes: tuple[str, ...]  # x, y or z of a displacement and its rates


def select_outputs(scene: Scene, system: System, targets: Sequence[str]) -> Selection:
    """Outputs of a system by their names, or by keys of the table of quantities, such as ``tip`` or ``pad_force``.

    The outputs are in the order of `targets`, each once; a key stands for all outputs of its kinds.  Words before the
    name of a displacement choose its rates: ``velocity of``, ``acceleration of`` or, for an accelerometer, which feels
    gravity, ``specific force of``.  Raises InputError for a name that the system does not have, and for a key without
    an output.  It is also raised if such words stand before the name of an output that is no displacement.
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
    words = [next((words for words in RATE_ORDERS if name.startswith(words)), "") for name in names]
    bases = [name.removeprefix(start) for name, start in zip(names, words, strict=True)]
    columns = [_number(base, available, "outputs") for base in bases]
    for name, start, column in zip(names, words, columns, strict=True):
        if start and units[column] != "m":
            raise InputError("observe", "outputs", name, f"displacements are allowed behind {start.strip()!r}")
    return Selection(
        names=tuple(names),
        columns=columns,
        orders=[RATE_ORDERS.get(start, 0) for start in words],
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
        If the scene does not fit the system, if the system has no output or load of a name, or if there are fewer than
        two steps.  Also for a system with a hoist, and for accelerations and velocities in a frame that moves.
    """
    if system.hoist:
        raise InputError("observe", "hoist", None, "none is allowed: a rope that may be slack is not linear")
    chosen = select_outputs(scene, system, outputs)
    excitation = excitation_of_scene(scene, system)
    end, h = excitation.stepping.end, excitation.stepping.step if step is None else step
    if not 0.0 < h <= end / 2.0:
        raise InputError("observe", "step", h, f"more than 0 and at most half of the motion's {end:g} s is allowed")
    excitation = excitation.on_grid(TimeStepping(end, h, excitation.stepping.rho_inf, parts=1))
    form = SystemForm.of(system)
    if form.kernel.motions and any(chosen.orders):
        named = next(name for name, order in zip(chosen.names, chosen.orders, strict=True) if order)
        raise InputError("observe", "outputs", named, "displacements and forces are allowed in a frame that moves")
    load_columns = [form.kernel.paths + _number(name, system.input_names, "inputs") for name in inputs]
    steps = _differentiate(form, excitation, chosen, load_columns)
    gravity = gravity_of(scene, chosen)
    return LinearMotion(
        excitation.times[1:],
        chosen.names,
        chosen.units,
        chosen.kinds,
        tuple(inputs),
        steps.reference + gravity,
        steps.matrices,
        tuple(system.input_units[system.input_names.index(name)] for name in inputs),
        displacements_along(system, inputs),
    )


def displacements_along(system: System, loads: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Names of the outputs that are the displacement along a load at its place, by the names of the `loads`.

    By the principle of virtual work, the row of such an output equals the forces of a unit load on the coordinates.
    Rows that differ by at most `SAME_PLACE` of their length count as equal, so that a neighbouring place will do.
    """
    assembly, by_load = Assembly(system), dict[str, tuple[str, ...]]()
    forces, outputs = assembly.B.toarray(), assembly.outputs.toarray()
    for load in loads:
        force = forces[:, system.input_names.index(load)]
        near = np.linalg.norm(outputs - force, axis=1) <= SAME_PLACE * np.linalg.norm(force)
        by_load[load] = tuple(name for name, at_load in zip(system.output_names, near, strict=True) if at_load)
    return by_load


def gravity_of(scene: Scene, chosen: Selection) -> Array:
    """Acceleration (q,) in m/s^2 that each of the q chosen outputs shows at rest.

    It is opposite to gravity for a specific force, which an accelerometer measures, and zero for other outputs.
    """
    felt = np.zeros(len(chosen.names))
    for k, (name, axis) in enumerate(zip(chosen.names, chosen.axes, strict=True)):
        if name.startswith(SPECIFIC_FORCE) and scene.gravity is not None and axis in ("x", "y", "z"):
            felt[k] = -scene.gravity.acceleration * scene.gravity.direction["xyz".index(axis)]
    return felt


def _differentiate(form: SystemForm, excitation: Excitation, chosen: Selection, loads: list[int]) -> LinearSteps:
    """Compute the linear model of each step of an excitation: of the `chosen` outputs, by some of the loads.

    `loads` are the numbers of these loads among the drivers of the system in `form`: first paths, then loads.
    """
    march = March(form, excitation)
    u = march.sample_drivers(0, excitation.stepping.steps, 1)
    numbers = (np.array(part, np.int32) for part in (chosen.columns, chosen.orders, loads, form.mode_columns))
    steps = LinearSteps(ChosenOutputs(*numbers), len(u) - 1)
    for k in range(len(u) - 1):
        steps.take(march.state, k, u[k + 1])
    steps.follow_rates(excitation.stepping.step)
    return steps


def output_sensitivity(reference: LinearMotion, changed: LinearMotion) -> Array:
    """Outputs (T, q) of the motion `changed` minus those of the motion `reference`, for q outputs at T steps.

    `changed` is the same motion of a system in which one parameter (a stiffness, Young's modulus, a mass) is changed.
    The difference is due to the whole change; it is not divided by the change of the parameter.  Raises InputError if
    outputs or times of the steps differ between the two motions.
    """
    if reference.outputs != changed.outputs or not np.array_equal(reference.t, changed.t):
        allowed = "the same outputs and steps as those of the reference are needed"
        raise InputError("observe", "parameters", changed.outputs, allowed)
    return changed.reference - reference.reference
