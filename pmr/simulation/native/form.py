"""A system with each body in its own modes, its kernel, its initial state, and messages about failed steps."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from pmr.errors import InputError, SimulationError
from pmr.files.arrays import Array, Mask
from pmr.kernel._native import lib
from pmr.kernel.blocks import round_up
from pmr.kernel.data import system_in_modes
from pmr.kernel.kernel import Kernel
from pmr.kernel.state import StepError
from pmr.scene.choice import SimulatorNeeds, refuse_unsupported
from pmr.scene.keys import path_unit
from pmr.scene.signals import Constant, SignalBase
from pmr.simulation.excitation import Excitation, side_positions, signals_in_order
from pmr.simulation.modal import ModalForm, modal_form
from pmr.simulation.moving import MovingFrame
from pmr.simulation.start import (
    InitialState,
    consistent_start,
    describe_dependence,
    describe_divergence,
    describe_unsettled,
    needs_of,
)
from pmr.simulation.statics.equilibrium import equilibrium
from pmr.system.assembly import Assembly
from pmr.system.contacts import ALONE
from pmr.system.from_scene import CombinedRings, combine_rings
from pmr.system.system import System

#: Most modes for which the kernel computes the equilibrium at the start; for more modes it is computed sparsely.
DENSE = 400
#: Most modes for which it finds the equilibrium with a hoist, whose rope pulls along the deflected boom.
DENSE_WITH_HOIST = 3000


@dataclass(frozen=True)
class SystemForm:
    """A system whose bodies are in modal form."""

    system: System
    forms: Mapping[str, ModalForm]  # by the bodies' names, in their order

    @classmethod
    def of(cls, system: System | SystemForm) -> SystemForm:
        """Diagonalise every body; a form is returned unchanged, so that simulations share its kernel.

        Raises the errors of `modal_form`.
        """
        if isinstance(system, SystemForm):
            return system
        return cls(system, {name: modal_form(body) for name, body in system.bodies.items()})

    @classmethod
    def of_modal_body(cls, form: ModalForm) -> SystemForm:
        """Modal form of a system of one body that is already in modal coordinates."""
        eye, rows = np.eye(form.body.size), tuple(range(len(form.body.row_names)))
        return cls(System.of(form.body), {ALONE: replace(form, X=eye, inverse=eye, rows=rows)})

    @cached_property
    def columns(self) -> dict[str, slice]:
        """Slice of each body's modes among the columns of the kernel's arrays, by the body's name.

        The kernel pads bodies to whole registers; the slices are without padding.
        """
        sizes = {name: form.body.size for name, form in self.forms.items()}
        starts = np.cumsum([0, *map(round_up, sizes.values())]).tolist()
        return {name: slice(at, at + size) for at, (name, size) in zip(starts, sizes.items(), strict=False)}

    @property
    def mode_columns(self) -> NDArray[np.int64]:
        """Columns (r,) of all modes in the kernel's arrays, without padding."""
        return np.concatenate([np.arange(part.start, part.stop) for part in self.columns.values()])

    @property
    def modes(self) -> int:
        """Number of modes in the kernel's arrays, with padding."""
        return round_up(max(part.stop for part in self.columns.values()))

    @cached_property
    def kernel(self) -> Kernel:
        """Kernel of the system and of its `frame`; without a frame, of the system alone."""
        return Kernel.of(self.system, self.forms, self.frame, self.combined)

    @cached_property
    def frame(self) -> MovingFrame | None:
        """Frame of the system's scene; None without a scene or a frame.

        The result is None, too, if this version can't read the scene, or if the scene does not drive all inputs and
        terms of the system.
        """
        try:
            return MovingFrame.from_system(self.system)
        except InputError:
            return None

    @cached_property
    def mobility(self) -> Array:
        """Matrix B^T B (i, i) in 1/kg of modal B: accelerations at the inputs' points by loads on free bodies."""
        return np.asarray(block_diag(*(form.body.B.T @ form.body.B for form in self.forms.values())))

    @property
    def modal(self) -> System:
        """System in modal coordinates, in which each ring of pads is replaced by combined contacts (`combined`).

        A system of one body on one path has no carriers, as its tables describe all rows.
        """
        return self.combined.system

    @cached_property
    def assembly(self) -> Assembly:
        """Equations of the `modal` system."""
        return Assembly(self.modal)

    def refuse_unsupported(self, x: Array, rho_inf: float) -> SimulatorNeeds:
        """Raise an InputError if the kernel does not support all that a simulation needs; otherwise return the needs.

        The contacts of the system in modes (`modal`) have their sides at x (T, sides) in m at T steps; those that are
        rigid at the first step count as rigid.  `rho_inf` is the spectral radius of the time integration at infinite
        frequency.
        """
        if (place := x[0].tobytes()) not in self._rigid:
            self._rigid[place] = self.assembly.contact_rows(x[0], effects=False).rigid
        needs = needs_of(self.modal, self._rigid[place], x, rho_inf)
        refuse_unsupported("march", needs)
        return needs

    @cached_property
    def _rigid(self) -> dict[bytes, Mask]:
        """Store of masks (m,) of the rigid contacts of the `modal` system, empty at first.

        The keys are the positions of the contacts' sides, as the bytes of an array.
        """
        return {}

    @cached_property
    def combined(self) -> CombinedRings:
        """System in modal coordinates with combined contacts, and how the forces of all contacts follow from theirs."""
        return combine_rings(self.in_modes)

    @cached_property
    def in_modes(self) -> System:
        """System in modal coordinates with all contacts of `system`; rings of pads are not combined."""
        return system_in_modes(self.system, self.forms)

    def initial_states(self, z: Array, v: Array) -> dict[str, InitialState]:
        """Coordinates and rates of each body by its name, from those of the kernel's r' modes, z and v (r',)."""
        return {
            name: InitialState(form.X @ z[self.columns[name]], form.X @ v[self.columns[name]])
            for name, form in self.forms.items()
        }


def driver_signals(form: SystemForm, excitation: Excitation) -> list[SignalBase]:
    """Signals of the kernel's N drivers in the kernel's order: paths, loads, amplitudes of terms, drivers of a hoist.

    A single body without a path is at the beginning of its domain.  Raises InputError unless the excitation has just
    the system's loads, terms and drivers of a hoist.
    """
    system, kernel = form.system, form.kernel
    paths: Sequence[SignalBase]
    if system.on_one_path:
        (body,) = system.bodies.values()
        standing = Constant(amount=float(body.domain[0]))
        paths = [next(iter(excitation.paths.values()), standing)]
    else:
        paths = [excitation.paths[name] for name in kernel.names("drivers")[: kernel.paths]]
    loads = signals_in_order(excitation.loads, system.input_names)
    terms = signals_in_order(excitation.terms, system.term_names, "term")
    hoist = signals_in_order(excitation.hoist, system.hoist.drivers, "hoist")
    return [*paths, *loads, *terms, *hoist]


def start_modes(form: SystemForm, x: Array, x_rate: Array, initial: Mapping[str, InitialState]) -> Array:
    """Modal coordinates and rates of initial states, (2, modes) with the kernel's padding.

    x (sides,) in m are the positions of the contacts' sides, and `x_rate` (sides,) in m/s their rates.  `initial` has
    the states by the bodies' names; bodies that are missing are at rest.  A velocity that violates rigid contacts is
    corrected (`consistent_start`); errors as there.
    """
    modes = np.zeros((2, form.modes))
    states = consistent_start(Assembly(form.system), x, x_rate, initial)
    for name, columns in form.columns.items():
        start = form.forms[name].start(states[name])
        modes[:, columns] = start.q, start.v
    return modes


def static_start(system: System, excitation: Excitation) -> dict[str, InitialState]:
    """States of all bodies at rest in equilibrium with the loads at t = 0, by the body's name.

    Motions that were computed with the boom are held where they begin.  Raises InputError as `equilibrium`.
    """
    excitation = excitation.resting or excitation
    f, c = excitation.forces(system.input_names)[0], excitation.amplitudes(system.term_names)[0]
    assembly = Assembly(system)
    q = equilibrium(assembly, side_positions(system, excitation)[0], f, c).q[None]
    coordinates = {name: assembly.body_coordinates(name, q)[0] for name in system.bodies}
    return {name: InitialState(of_body, np.zeros_like(of_body)) for name, of_body in coordinates.items()}


def begin(
    form: SystemForm,
    start: Callable[..., None],
    excitation: Excitation,
    initial: Mapping[str, InitialState] | None = None,
) -> Callable[[], None]:
    """Start a kernel of `form` by its function `start`; return a function that starts it in the same way again.

    `start` is `State.start` or `State.start_in_frame`, with all arguments bound but the kind of the start and the
    modes.  The kernel begins in the states `initial` of bodies by name, at rest if it has none.  If `initial` is None,
    the kernel begins at rest or in equilibrium, as the excitation says.  In addition to the errors of `start`, a
    StepError is raised if no equilibrium with a hoist is found.  For a start in equilibrium, an InputError is raised if
    nothing holds the bodies, or if a system with a hoist has more than `DENSE_WITH_HOIST` modes.
    """
    system, modes, failed = form.system, form.modes, None
    if initial is None and excitation.start == "equilibrium":
        if system.hoist and modes > DENSE_WITH_HOIST:
            allowed = f"'rest' is allowed with a hoist and {modes} coordinates, of {DENSE_WITH_HOIST} at most"
            raise InputError("scene", "start", "equilibrium", f"{allowed} the equilibrium is found")
        if system.hoist or (modes <= DENSE and excitation.resting is None):
            try:
                start("equilibrium")
                return partial(start, "equilibrium")
            except StepError as error:
                failed = error
        initial = static_start(system, excitation)  # raises an error that names motions that are not held
        if system.hoist and failed is not None:
            raise failed  # no other method finds the equilibrium of a rope
    again = partial(start, "rest")
    if initial:
        rates = dict(zip(excitation.paths, excitation.rates[0].tolist(), strict=True))
        x, x_rate = side_positions(system, excitation)[0], system.side_rates(rates)
        z, v = start_modes(form, x, x_rate, initial)
        again = partial(start, "given", z=z, v=v)
    again()
    return again


def start_of(system: System, excitation: Excitation) -> dict[str, InitialState]:
    """States of bodies at t = 0, by name, as ``excitation.start`` says: of `static_start`, or none for a start at rest.

    Errors as `static_start`.
    """
    return {} if excitation.start == "rest" else static_start(system, excitation)


def step_failure(where: str, form: SystemForm, error: StepError, x: Array) -> SimulationError:
    """Error for the user about a step that failed with the kernel's `error`; `where` names the step.

    The sides of contacts are at x (sides,) in m.
    """
    system, reason = form.modal, "not finite" if error.failure == lib.PMR_NOT_FINITE else str(error)
    if error.failure == lib.PMR_UNSETTLED:
        reason = describe_unsettled(system.contact_names, ~np.isnan(system.clearance))
    elif error.failure == lib.PMR_UNCONVERGED:
        reason = describe_divergence(system.term_names, system.contacts)
    elif error.failure == lib.PMR_DEPENDENT:  # at the start the kernel does not say which rows depend on each other
        C = form.assembly.contact_rows(x, effects=False).C
        reason = describe_dependence(C[: error.contact + 1] if error.contact >= 0 else C, system.contact_names)
    return SimulationError(f"stopped at {where}: {reason}")


def path_text(paths: Sequence[str], s: Array) -> str:
    """Text to append to a message, such as ``, boom at 1.5 m``: coordinates s (P,) in m, a luffing angle in rad."""
    return "".join(f", {path} at {at:g} {path_unit(path)}" for path, at in zip(paths, s, strict=False))
