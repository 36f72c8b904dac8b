"""The drivers of an FMU, and its variables in the order of their value references (source/unit.h)."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from pmr.errors import BEYOND_ENDS, InputError
from pmr.files.arrays import Array
from pmr.kernel.data import SystemData, system_data, system_in_modes
from pmr.kernel.further import AXES, ground_outputs
from pmr.scene.built import force_name
from pmr.scene.hoist import ROPE, WIND
from pmr.scene.keys import LUFFING
from pmr.simulation.modal import ModalForm, modal_form
from pmr.simulation.moving import DRIVE, EXTENSION_DRIVE, GRAVITY, MovingFrame
from pmr.simulation.native.free_motion import prepare_stepping
from pmr.system.body import force_outputs, names_of, units_of
from pmr.system.contacts import ALONE, SLIDER, qualified_name
from pmr.system.from_scene import combine_rings
from pmr.system.system import System

#: Name of the only angle without a range.
SLEWING = "slewing"
#: Unit of what drives the rope of a hoist: of its length, and of the speed of its winch.
ROPE_UNITS = ("m", "m/s")
#: Unit of what drives a free luffing angle or extension, by the kind of drive.
DRIVE_UNITS = {"opening": "1", "force": "N", "length": "m"}


@dataclass(frozen=True)
class Drivers:
    """A system in the kernel's form, and its N drivers: all that moves or loads it from outside.

    The drivers are paths, then loads, then motions of the frame if the frame moves.  `forms` has each body in modal
    coordinates, by name, and `data` the arrays of the kernel.  `frame` is None if the system has no frame that moves
    it.
    """

    system: System
    forms: Mapping[str, ModalForm]
    frame: MovingFrame | None
    data: SystemData

    @classmethod
    def of(cls, system: System, *, reactions: bool = True) -> Drivers:
        """Bring a system into the kernel's form and list what drives it: paths, loads, motions of its frame.

        If `reactions` is false, forces of rigid supports are no outputs, and pads of a ring are combined where this
        does not change the motion.  Where the luffing angle of the system's scene is free, all modes get inertia.

        Raises InputError as `modal_form` and `stepped`.  It is also raised if the frame has other paths than the
        system, or the same ones in another order.
        """
        system, _, frame = prepare_stepping(system, "system")
        if frame is not None and frame.paths != tuple(path for path in system.paths if path != LUFFING):
            of_scene, of_pads = (", ".join(paths) or "none" for paths in (frame.paths, system.paths))
            raise InputError(
                "system", "paths", of_scene, f"paths that pads travel on are allowed in the pads' order: {of_pads}"
            )
        forms = {name: modal_form(body) for name, body in system.reduced.items()}
        reduced = None if reactions else combine_rings(system_in_modes(system, forms))
        return cls(system, forms, frame, system_data(system, forms, frame, reduced))

    @property
    def paths(self) -> tuple[str, ...]:
        """Names of the paths that are drivers.

        The path of a luffing cylinder is left out if an angle of the frame determines it.
        """
        return self.data.rows.paths if self.frame is None else self.frame.paths

    @property
    def shown_paths(self) -> tuple[str, ...]:
        """Names of the paths that are inputs of the FMU; empty for a section of a boom without contacts."""
        return self.paths if self.system.paths or ALONE in self.system.bodies else ()

    @property
    def loads(self) -> tuple[str, ...]:
        """Names of the loads."""
        return self.frame.loads if self.frame is not None else (*self.system.input_names, *self.system.hoist.drivers)

    @property
    def motions(self) -> tuple[str, ...]:
        """Names of the angles of the frame, then of the accelerations of its base; empty without a frame."""
        return () if self.frame is None else (*self.frame.angles, *self.frame.axes)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all drivers in the kernel's order: paths, loads, motions."""
        return (*self.paths, *self.loads, *self.motions)

    @property
    def watchable_names(self) -> tuple[str, ...]:
        """Names of outputs, contact forces, further outputs and motions, as the kernel's `pmr_observe` counts them."""
        frame, system = self.frame, self.system
        further_names = {name for name, _, _ in self.data.further}
        computed = () if frame is None or frame.computed is None else tuple(frame.computed.outputs)
        ground = () if frame is None else tuple(name for name in ground_outputs(frame.scene) if name in further_names)
        forces = map(force_name, system.contact_names)
        behind = (*system.hoist.outputs, *computed, *ground, *(() if frame is None else frame.drivers))
        return (*system.output_names, *forces, *behind)

    @property
    def count(self) -> int:
        """Number N of drivers."""
        return len(self.names)

    @property
    def modes(self) -> int:
        """Number r of modes of all bodies together."""
        return len(self.data.used_modes)

    @cached_property
    def load_units(self) -> tuple[str, ...]:
        """Unit of each load as FMI writes it, without ^ (``N``, ``N m``, ``m/s``), in the order of `loads`."""
        units = [unit.replace("^", "") for unit in self.system.input_units]
        of_inputs = dict(zip(self.system.input_names, units, strict=True))
        # a force along a ground axis has an input for each axis of the body
        of_parts = {name.rpartition(" ")[0]: unit for name, unit in of_inputs.items()}
        fixed_units = {GRAVITY: "m/s2"} if self.frame else {}
        fixed_units |= {name: "N" for name in WIND} | {ROPE: ROPE_UNITS[self.system.hoist.is_wound]}
        fixed_units |= {
            f"{drive}{name}": unit for drive in (DRIVE, EXTENSION_DRIVE) for name, unit in DRIVE_UNITS.items()
        }
        return tuple(fixed_units.get(name) or of_inputs.get(name) or of_parts[name] for name in self.loads)

    @property
    def first_load_number(self) -> int:
        """Index of the first load among the drivers."""
        return len(self.paths)

    @property
    def has_free_motion(self) -> bool:
        """Whether the luffing angle or an extension is free, so that only its start is given."""
        return self.frame is not None and self.frame.computed is not None

    @property
    def moved_paths(self) -> tuple[str, ...]:
        """Names of the paths of a free extension and of all following sections; empty without a free extension."""
        return () if self.frame is None or self.frame.computed is None else tuple(self.frame.computed.moved)

    @property
    def started(self) -> tuple[str, ...]:
        """Name (1,) of the free luffing angle or extension, whose value and rate at the start are parameters.

        The result is empty if neither is free.
        """
        return () if not self.has_free_motion else self.moved_paths[:1] or (LUFFING,)

    @property
    def has_derivatives(self) -> bool:
        """Whether rates of outputs and directional derivatives are known.

        They are not known with a hoist, a free luffing angle or a free extension.
        """
        return not self.system.hoist and not self.has_free_motion

    @property
    def is_differential(self) -> bool:
        """Whether the model is an ordinary differential equation (ODE), as Model Exchange needs it.

        It is one if its derivatives are known (`has_derivatives`), and if it has neither rigid contacts nor friction.
        """
        rows = self.data.rows
        return self.has_derivatives and rows.friction is None and bool(np.all(rows.flexibility_bounds > 0.0))

    def kinds(self) -> list[int]:
        """Kind of each driver (N,), as source/unit.h numbers them.

        - 1 is a path, and 5 a path that a free extension moves.
        - 2 is an angle, 3 the slewing angle, and 4 a free luffing angle, of which only the start counts.
        - 0 is any other driver.
        """
        kinds = dict.fromkeys(AXES, 0) | {SLEWING: 3} | ({LUFFING: 4} if LUFFING in self.started else {})
        of_motions = [kinds.get(name, 2) for name in self.motions]
        return [*(5 if path in self.moved_paths else 1 for path in self.paths), *(0 for _ in self.loads), *of_motions]


#: An input has its value and its rates of order one to three.
ORDERS = 4
#: Values of the parameter ``start``: number by the kind of start.
STARTS = {"at rest": 0, "static": 1, "as given": 2}


class Role(NamedTuple):
    """Role of a variable of an FMU in the importing program, in the words of the standard."""

    causality: str = "output"
    variability: str = "continuous"
    initial: str = "calculated"  #: Empty if the causality determines it


INPUT, PARAMETER = Role("input", initial=""), Role("parameter", "fixed", "exact")


@dataclass(frozen=True)
class Variable:
    """Variable of an FMU: its value reference (the number by which importers call it) and its other attributes."""

    name: str
    reference: int
    description: str
    role: Role = Role()
    unit: str = ""  #: Empty for a number
    start: float | None = None  #: Value at the start; None if the FMU computes it
    nominal: float | None = None  #: Magnitude of usual values; None if not stated
    derivative_of: int | None = None  #: Value reference of the state of which this variable is the derivative
    within: tuple[float, float] | None = None  #: Smallest and largest value
    # ``choice``: the kind of start, the only variable that is no real number; ``rate``: the rate of an output
    kind: Literal["quantity", "choice", "rate"] = "quantity"


def variables(
    drivers: Drivers,
    start: Array,
    nominal: Array,
    further: Callable[[Identifiers, int], Iterator[Variable]] | None = None,
) -> list[Variable]:
    """All variables of the FMU of a system with N drivers and r modes, in ascending order of their value references.

    `start` (4 + 4 N,) are start values of time, drivers, their rates and parameters, and `nominal` (2 r,) the nominal
    values of the states, as described for `pmr.export.fmi.system_file`.  `further` yields more variables, which come
    last; it is called with the maker of names and the first free value reference.  None stands for no more variables.
    """
    names = Identifiers()
    listed = list(_inputs_and_parameters(drivers, names, start))
    first, modes = 4 + ORDERS * drivers.count, drivers.modes
    of_modes = [(name, k + 1) for name, form in drivers.forms.items() for k in range(form.body.size)]
    for k in range(2 * modes):
        (body, mode), rate = of_modes[k % modes], k >= modes
        called, unit = ("rate of mode", "m/s") if rate else ("mode", "m")
        what = f"{qualified_name(body, f'{called} {mode}')}, modal mass 1 kg"
        name = names(f"{qualified_name(body, f'mode {mode}')}{' rate' * rate}")
        size = float(nominal[k])
        role = Role("local", initial="approx")
        listed.append(Variable(name, first + k, what, role, unit, start=0.0, nominal=size))
    states = listed[-2 * modes :]
    for k, state in enumerate(states):
        unit = "m/s2" if k >= modes else "m/s"
        reference = first + 2 * modes + k
        name = names(f"der_{state.name}")
        listed.append(
            Variable(name, reference, f"derivative: {state.description}", Role("local"), unit, derivative_of=first + k)
        )
    listed += _output_variables(drivers, names, first + 4 * modes)
    if further is not None:
        count, forces = len(list(described_outputs(drivers))), len(drivers.system.contacts)
        listed += further(names, first + 4 * modes + 2 * count + forces)
    return listed


def path_names(paths: Sequence[str]) -> list[str]:
    """Names of the inputs for `paths`: ``s`` for the common path of all sliders, ``s <path>`` for others."""
    return ["s" if path == SLIDER else f"s {path}" for path in paths]


def rate_unit(unit: str, order: int) -> str:
    """Unit of the rate of a given order of a quantity: ``m/s2`` for the unit ``m/s`` and order 1.

    An empty unit, or ``1``, stands for a number: ``1/s``.  For order 0 the unit is returned.
    """
    if not order:
        return unit
    what, over, exponent = (unit or "1").partition("/s")
    power = order + (int(exponent or 1) if over else 0)
    return f"{what}/s{power if power > 1 else ''}"


#: Exponents of the SI base units of each unit, and its factor where that is not 1.
_UNITS: dict[str, dict[str, float]] = {
    "1": {},
    "s": {"s": 1},
    "m": {"m": 1},
    "m/s": {"m": 1, "s": -1},
    "m/s2": {"m": 1, "s": -2},
    "N": {"kg": 1, "m": 1, "s": -2},
    "N m": {"kg": 1, "m": 2, "s": -2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "mm": {"m": 1, "factor": 0.001},
    "rad": {"rad": 1},
    "K": {"K": 1},
    "m3": {"m": 3},
    "N/m": {"kg": 1, "s": -2},
    "kg": {"kg": 1},
}
UNITS = _UNITS | {
    rate_unit(unit, order): was | {"s": was.get("s", 0) - order} for unit, was in _UNITS.items() for order in (1, 2, 3)
}


def _driver_variables(drivers: Drivers) -> Iterator[Variable]:
    """Yield the drivers of an FMU's system as variables without a start value: first paths, then loads, then motions.

    The variables have names that are not made unique yet, and no rates.  Drivers are inputs; of a free luffing angle or
    extension, the value at the beginning of the simulation is a parameter instead.  Left out are other paths that a
    free motion moves, and the loads by which the rope of a hoist pulls.
    """
    paths, ranges = drivers.shown_paths, drivers.data.rows.ranges
    for k, (name, path, (low, high)) in enumerate(zip(path_names(paths), paths, ranges, strict=False), 1):
        what = f"path coordinate {'of the sliders' if path == SLIDER else path}"
        if path in drivers.started:
            yield Variable(f"{name} start", k, f"{what} at the start", PARAMETER, "m", within=(low, high))
        elif path not in drivers.moved_paths:
            what += f"; up to {BEYOND_ENDS * (high - low):.3g} m beyond an end it is taken there"
            yield Variable(name, k, what, INPUT, "m", within=(low, high))
    for k, (name, unit) in enumerate(zip(drivers.loads, drivers.load_units, strict=True), 1):
        if name not in drivers.system.hoist.inputs:
            yield Variable(name, drivers.first_load_number + k, f"load {name}", INPUT, unit)
    for k, name in enumerate(drivers.motions, 1 + drivers.first_load_number + len(drivers.loads)):
        if name in AXES:
            yield Variable(f"{name} acceleration", k, f"acceleration of the pivot, {name}", INPUT, "m/s2")
        elif name in drivers.started:
            yield Variable(f"{name} start", k, f"angle {name} at the start", PARAMETER, "rad")
        else:
            yield Variable(name, k, f"angle {name}", INPUT, "rad")


def _inputs_and_parameters(drivers: Drivers, names: Identifiers, start: Array) -> Iterator[Variable]:
    """Yield time, the inputs with their rates of order one to three, and the parameters, as variables.

    They are in the order of their value references.  The start of a free luffing angle or extension has the first rate
    alone.  `start` (4 + 4 N,), for N drivers, has the start values of time, of the drivers, of their first, second and
    third rates, and of three parameters; `names` makes identifiers from names.
    """
    fixed = [names(name) for name in ("internal_step", "rho_inf", "start")]  # before those of loads
    yield Variable(names("time"), 0, "time", Role("independent", initial=""), "s")
    orders = list[tuple[int, Variable]]()
    for driver in _driver_variables(drivers):
        suffixes = ("", "_rate", "_rate_2", "_rate_3")[: 2 if driver.role is PARAMETER else ORDERS]
        orders += [(k, replace(driver, name=names(driver.name + suffix))) for k, suffix in enumerate(suffixes)]
    for order, driver in sorted(orders, key=lambda each: (each[0], each[1].reference)):
        at = order * drivers.count + driver.reference
        what = ("", "rate of ", "second rate of ", "third rate of ")[order]
        what += driver.description.partition("; ")[0] if order else driver.description
        unit, within = rate_unit(driver.unit, order), None if order else driver.within
        yield replace(driver, reference=at, description=what, unit=unit, start=float(start[at]), within=within)
    first = 1 + ORDERS * drivers.count
    how = "undeformed and at rest, in equilibrium with the loads, or as the start values of the modes say"
    yield Variable(fixed[0], first, "longest internal step in Co-Simulation", PARAMETER, "s", float(start[first]))
    what = "spectral radius of generalized-alpha at infinite frequency"
    yield Variable(fixed[1], first + 1, what, PARAMETER, start=float(start[first + 1]))
    yield Variable(fixed[2], first + 2, how, PARAMETER, start=float(start[first + 2]), kind="choice")


def described_outputs(drivers: Drivers) -> Iterator[tuple[str, str, bool]]:
    """Yield (name, unit, rate) of each output of `drivers` in the kernel's order; `rate` says if the output has a rate.

    Motions have rates, forces have none.
    """
    for name, body in drivers.system.reduced.items():
        for output, unit, is_force in zip(names_of(body), units_of(body), force_outputs(body).tolist(), strict=True):
            yield qualified_name(name, output), unit, not is_force
    yield from drivers.data.further


def _output_variables(drivers: Drivers, names: Identifiers, first: int) -> Iterator[Variable]:
    """Yield outputs, rates of outputs that are motions, and contact forces; the first value reference is `first`.

    A value reference is kept free for the rate of every output, also of an output without a rate.  There are no rates
    if the system of `drivers` has no derivatives.  `names` makes identifiers from names.
    """
    system, called = drivers.system, list(described_outputs(drivers))
    count, o = len(called), len(system.output_names)
    outputs = [names(force_name(name) if not moves and k < o else name) for k, (name, _, moves) in enumerate(called)]
    for k, (name, unit, _) in enumerate(called):
        yield Variable(outputs[k], first + k, name, unit=unit.replace("^", ""))
    for k, (what, unit, moves) in enumerate(called):
        if moves and drivers.has_derivatives:
            name = names(f"{outputs[k]}_rate")
            yield Variable(name, first + count + k, f"rate of {what}", unit=rate_unit(unit, 1), kind="rate")
    for k, contact in enumerate(system.contacts):
        on = "on the body with the opposite sign" if contact.outer is None else f"pushes {contact.inner.body} away"
        what = f"{force_name(contact.name)}; {on}"
        yield Variable(names(force_name(contact.name)), first + 2 * count + k, what, unit="N")


class Identifiers:
    """Maker of names of letters, digits and underscores, each different from all names made so far and from `taken`."""

    def __init__(self, taken: Iterable[str] = ()) -> None:
        self._taken = set(taken)

    def __call__(self, name: str) -> str:
        """Return a unique identifier for a name."""
        plain = re.sub(r"[^A-Za-z0-9]+", "_", name.replace("-", "m") if re.search(r"-\d", name) else name).strip("_")
        plain = plain if plain and not plain[0].isdigit() else f"v_{plain}"
        identifier, count = plain, 1
        while identifier in self._taken:
            count += 1
            identifier = f"{plain}_{count}"
        self._taken.add(identifier)
        return identifier
