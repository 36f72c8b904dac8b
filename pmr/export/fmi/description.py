"""Descriptions in an FMU (modelDescription.xml, buildDescription.xml of FMI 3.0), and its reference trajectory.

The trajectory has inputs at every step, and outputs of the compiled simulator at some steps.  Within a step an FMU
extrapolates its inputs by their rates: as cubics that agree with the run's inputs at both ends of the step (docs/fmu.md
says which error is left where a step is divided).
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pmr import __version__
from pmr.errors import escape_controls
from pmr.export.fmi.variables import STARTS, UNITS, Drivers, Variable
from pmr.files.arrays import Array
from pmr.scene.built import force_name
from pmr.scene.signals import SignalBase
from pmr.scene.signals.base import Strand
from pmr.simulation.contact_step import contact_frequency, contact_frequency_within
from pmr.simulation.excitation import Excitation, signals_in_order
from pmr.simulation.moving import DRIVE, EXTENSION_DRIVE, StoredScene
from pmr.simulation.native import systems
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.free_motion import with_free_motion
from pmr.simulation.stepping import TimeStepping
from pmr.system.states import displacements


@dataclass(frozen=True)
class ModelAttributes:
    """Attributes of a whole model in its description."""

    identifier: str  #: C identifier: the name of the binaries
    title: str
    token: str  #: Hash that distinguishes the model from others
    model_exchange: bool  #: Whether there is a Model Exchange interface in addition to Co-Simulation
    derivatives: bool  #: Whether there are directional derivatives
    sources: Sequence[str]  #: Names of the C sources in the archive; empty if it has none
    end: float  #: s, of the reference trajectory
    step: float  #: s, of the reference trajectory


def model_description(model: ModelAttributes, variables: Sequence[Variable], version: str) -> str:
    """Text of modelDescription.xml of FMI 2.0 or 3.0, with the given `variables`; `version` is ``"2"`` or ``"3"``."""
    is_3 = version == "3"
    root = ET.Element(
        "fmiModelDescription",
        {
            "fmiVersion": f"{version}.0",
            "modelName": model.title,
            "description": "Reduced model in modal coordinates",
            "generationTool": f"pmr {__version__}",
            "variableNamingConvention": "flat",
            **({"instantiationToken": model.token} if is_3 else {"guid": model.token, "numberOfEventIndicators": "0"}),
        },
    )
    state, plural = ("FMUState", "s") if is_3 else ("FMUstate", "")
    can = {f"canGetAndSet{state}": "true", f"canSerialize{state}": "true"}
    can[f"providesDirectionalDerivative{plural}"] = str(model.derivatives).lower()
    steps = {"canHandleVariableCommunicationStepSize": "true"} | ({} if is_3 else {"canInterpolateInputs": "true"})
    interfaces: dict[str, dict[str, str]] = {"ModelExchange": {}} if model.model_exchange else {}
    interfaces["CoSimulation"] = steps | {"maxOutputDerivativeOrder": "1"}
    for kind, more in interfaces.items():
        element = ET.SubElement(root, kind, {"modelIdentifier": model.identifier, **can, **more})
        if model.sources and not is_3:
            files = ET.SubElement(element, "SourceFiles")
            for name in model.sources:
                ET.SubElement(files, "File", name=name)
    _add_units(root, variables)
    types = ET.SubElement(root, "TypeDefinitions")
    choice = ET.SubElement(types, "EnumerationType" if is_3 else "SimpleType", name="Start")
    choice = choice if is_3 else ET.SubElement(choice, "Enumeration")
    for name, value in STARTS.items():
        ET.SubElement(choice, "Item", name=name, value=str(value))
    categories = ET.SubElement(root, "LogCategories")
    for name in ("logStatusWarning", "logStatusError"):
        ET.SubElement(categories, "Category", name=name)
    times = {"startTime": "0.0", "stopTime": repr(model.end), "tolerance": "1e-8", "stepSize": repr(model.step)}
    ET.SubElement(root, "DefaultExperiment", times)
    listed, number = ET.SubElement(root, "ModelVariables"), {v.reference: k + 1 for k, v in enumerate(variables)}
    for variable in variables:
        kind, attributes = "Float64" if is_3 else "Real", _real_attributes(variable)
        if variable.kind == "choice":
            kind, attributes = "Enumeration", {"declaredType": "Start", "start": str(int(variable.start or 0))}
        if (of := variable.derivative_of) is not None:
            attributes["derivative"] = str(of if is_3 else number[of])
        if is_3:
            ET.SubElement(listed, kind, _variable_attributes(variable) | attributes)
        else:
            ET.SubElement(ET.SubElement(listed, "ScalarVariable", _variable_attributes(variable)), kind, attributes)
    structure = ET.SubElement(root, "ModelStructure")
    groups = {"Output": "Outputs", "ContinuousStateDerivative": "Derivatives", "InitialUnknown": "InitialUnknowns"}
    for (single, group), unknowns in zip(groups.items(), _model_structure(variables), strict=True):
        element = structure if is_3 else ET.SubElement(structure, group)
        for variable in unknowns:
            if is_3:
                ET.SubElement(element, single, valueReference=str(variable.reference))
            else:
                ET.SubElement(element, "Unknown", index=str(number[variable.reference]))
    return _xml_text(root)


def build_description(model: ModelAttributes) -> str:
    """Text of sources/buildDescription.xml of FMI 3.0, with the model's `sources`."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    build = ET.SubElement(root, "BuildConfiguration", modelIdentifier=model.identifier)
    files = ET.SubElement(build, "SourceFileSet", language="C11")
    for name in model.sources:
        ET.SubElement(files, "SourceFile", name=name)
    return _xml_text(root)


def _add_units(root: ET.Element, variables: Sequence[Variable]) -> None:
    """Add the units of the variables to the element `root`, each once; of units that `UNITS` lacks only the name."""
    units = ET.SubElement(root, "UnitDefinitions")
    for name in dict.fromkeys(variable.unit for variable in variables if variable.unit):
        unit = ET.SubElement(units, "Unit", name=name)
        if name in UNITS:
            ET.SubElement(unit, "BaseUnit", {base: str(power) for base, power in UNITS[name].items()})


def _variable_attributes(variable: Variable) -> dict[str, str]:
    """Attributes that every variable has, by their names in the FMI.

    The attributes are ``name``, ``valueReference`` and ``description``, and ``causality``, ``variability`` and
    ``initial`` as far as the variable's role sets them.
    """
    attributes = {
        "name": variable.name,
        "valueReference": str(variable.reference),
        "description": variable.description,
    }
    return attributes | {name: value for name, value in variable.role._asdict().items() if value}


def _real_attributes(variable: Variable) -> dict[str, str]:
    """Attributes of a real variable by their names: ``unit``, ``start``, ``nominal``, ``min`` and ``max``.

    Attributes that the variable does not set are left out.
    """
    attributes = {} if not variable.unit else {"unit": variable.unit}
    low, high = variable.within or (None, None)
    numbers = {"start": variable.start, "nominal": variable.nominal, "min": low, "max": high}
    return attributes | {
        name: "NaN" if value != value else repr(value) for name, value in numbers.items() if value is not None
    }


def _model_structure(variables: Sequence[Variable]) -> list[list[Variable]]:
    """Lists of variables for the ModelStructure: outputs, derivatives of states, and unknowns of the initialisation."""
    return [
        [v for v in variables if v.role.causality == "output"],
        [v for v in variables if v.derivative_of is not None],
        [v for v in variables if v.role.initial in ("approx", "calculated")],
    ]


def _xml_text(root: ET.Element) -> str:
    """Text of the XML tree below `root`; control characters and lone surrogates, which XML can't hold, are replaced."""
    for element in root.iter():
        element.attrib.update({key: escape_controls(value) for key, value in element.attrib.items()})
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


#: Number of instants at which outputs are written; all steps if there are fewer.
INSTANTS = 101


@dataclass(frozen=True)
class Reference:
    """Reference trajectory: a simulation of a system with n drivers, o outputs, m contacts and r modes."""

    stepping: TimeStepping
    omega: float  #: rad/s, of contacts that only push; 0 without any
    inputs: Array  #: (T, 1 + 4 n) array: time, drivers and their rates of order one to three, at every step
    first: Array  #: (2, n) array: values of the drivers at the start, and rates of those that have no input
    static: bool  #: Whether it starts in equilibrium
    t: Array  #: (S,) array, s
    outputs: Array  #: (S, o + m) array: outputs of the bodies, and contact forces
    nominal: Array  #: (2 r,) array: largest modal coordinates, then their largest rates; none is 0

    @property
    def start_values(self) -> Array:
        """Start values (4 + 4 n,) of time, drivers and parameters.

        - Time is 0.
        - The values of the n drivers follow, then their first, second and third rates.  All rates are zero, except the
          first rate of a free luffing angle or extension.
        - The last three are the parameters step, rho_inf and start, the number of the kind of start (`STARTS`).
        """
        step = self.stepping.step
        start = STARTS["static" if self.static else "at rest"]
        return np.concatenate([[0.0], *self.first, np.zeros(self.first.size), [step, self.stepping.rho_inf, start]])


def reference(drivers: Drivers, scene: StoredScene) -> Reference:
    """Simulate the system of `drivers` under the `scene` stored with it, and return the reference trajectory.

    Without a frame, paths and loads follow the FMU's cubics between steps.  With a frame that moves, they follow the
    scene's signals.  A free luffing angle or extension is computed first, as in a run.  Raises the errors of
    `pmr.simulation.native.free_motion.with_free_motion`.
    """
    if scene.free_scene is not None:
        scene = StoredScene.of_boom(with_free_motion(scene.free_scene, drivers.system)[0], drivers.system)
    system, excitation = drivers.system, scene.excitation
    inputs = input_cubics(drivers, excitation)
    reached = _cubic_excitation(drivers, excitation, inputs)
    free = bool(system.hoist) or drivers.has_free_motion
    initial = None if free else systems.static_start(system, reached) if scene.static else {}
    trajectory = systems.simulate_form(SystemForm(system, drivers.forms), reached, initial)
    y = list(displacements(system, trajectory).values())
    z, v = (
        np.hstack([getattr(trajectory.bodies[name], what) @ form.inverse.T for name, form in drivers.forms.items()])
        for what in "qv"
    )
    t, modal = excitation.times, SystemForm(system, drivers.forms).modal
    anywhere = bool(drivers.moved_paths)
    shown = np.unique(np.linspace(0, len(t) - 1, min(INSTANTS, len(t))).round().astype(int))
    largest = np.abs(np.hstack([z, v])).max(axis=0)
    smallest = 1e-9 * np.repeat(largest.reshape(2, -1).max(axis=1), z.shape[1])
    nominal = np.maximum(largest, smallest)
    first = np.stack([inputs[0, 0], np.zeros(drivers.count)])
    if not drivers.shown_paths:
        first[0, : drivers.first_load_number] = [low for low, _ in drivers.data.rows.ranges]
    first[0, drivers.first_load_number :][: len(drivers.loads)] = first_loads(drivers, scene)
    if drivers.frame is not None:
        started = [drivers.names.index(name) for name in drivers.started]
        first[:, started] = drivers.frame.start[:2, started]
    return Reference(
        stepping=reached.stepping,
        omega=contact_frequency_within(modal, system.ranges) if anywhere else contact_frequency(modal, reached),
        inputs=np.hstack([t[:, None], *inputs]),
        first=first,
        static=scene.static,
        t=t[shown],
        outputs=np.hstack([*y, trajectory.forces])[shown],
        nominal=np.where(nominal > 0.0, nominal, 1.0),
    )


def first_loads(drivers: Drivers, scene: StoredScene) -> Array:
    """Values (i,) of the i loads of `drivers` at the start, with the full weight, in the units `Drivers.load_units`."""
    if drivers.frame is None:
        at = dict.fromkeys(drivers.loads, 0.0) | dict(
            zip(drivers.system.load_names, scene.first_loads.tolist(), strict=True)
        )
        return np.array([at[name] for name in drivers.loads])
    return drivers.frame.start[0, drivers.first_load_number :][: len(drivers.loads)]


class CubicSignal(SignalBase):
    """Signal of one cubic for each step, given by value and rates of order one to three at the step's beginning."""

    step: float  # s
    rates: tuple[tuple[float, ...], ...]  # (4, T)

    @property
    def strands(self) -> tuple[Strand, ...]:
        """One strand: the polynomials, without a sine."""
        x = np.array(self.rates)
        breaks, polynomials = self.step * np.arange(x.shape[1]), x[::-1].T / [6.0, 2.0, 1.0, 1.0]
        return (Strand(breaks, np.ascontiguousarray(polynomials)),)


def _cubic_excitation(drivers: Drivers, excitation: Excitation, inputs: Array) -> Excitation:
    """Return the excitation with cubics over each step in place of the signals of its paths and loads.

    `inputs` (4, T, n) are value and rates of order one to three of the n drivers at T steps, as `input_cubics` returns
    them.  In a frame that moves, the excitation is returned unchanged.
    """
    if drivers.frame is not None:
        return excitation
    step = excitation.stepping.step

    def signal_of(number: int) -> CubicSignal:
        """Signal of the driver with this `number`, a cubic in each step."""
        return CubicSignal(step=step, rates=tuple(map(tuple, inputs[:, :, number].tolist())))

    paths = dict(excitation.paths) | {name: signal_of(k) for k, name in enumerate(drivers.shown_paths)}
    loads = {name: signal_of(drivers.first_load_number + k) for k, name in enumerate(drivers.loads)}
    driven = {name: loads.pop(name) for name in excitation.hoist}
    return replace(excitation, paths=paths, loads=loads, hoist=driven)


def input_cubics(drivers: Drivers, excitation: Excitation) -> Array:
    """Values and rates of order one to three (4, T, n) of n drivers at T steps: a cubic from each step to the next one.

    The cubic of a step has the exact values of the driver at both ends of the step.  Without a frame, it has the exact
    rates of paths and loads there too.  In a frame, it has the exact second rates of paths and angles, which accelerate
    the frame, and the exact rates of a cylinder's drive; all other drivers are straight lines.  At the last time the
    rates are zero.
    """
    t, h, n = excitation.times, excitation.stepping.step, drivers.count
    orders, frame = np.zeros((4, len(t), n)), drivers.frame
    if frame is not None:
        at = frame.motions(excitation, t)
        second = np.array([name in (*frame.paths, *frame.angles) for name in frame.drivers])
        orders[0] = at[0].T
        x, v, a = at[0].T, at[1].T, at[2].T
        slope = (x[1:] - x[:-1]) / h
        lines = np.array([x[:-1], slope, 0.0 * slope, 0.0 * slope])  # with rates of order one to three
        drive = [name.startswith((DRIVE, EXTENSION_DRIVE)) for name in frame.drivers]
        lines = np.where(drive, cubic_by_rates(x[:-1], x[1:], v[:-1], v[1:], h), lines)
        orders[:, :-1] = np.where(second, cubic_by_second_rates(x[:-1], x[1:], a[:-1], a[1:], h), lines)
        return orders
    signals = [*(excitation.paths[path] for path in drivers.shown_paths)]
    numbers = [*range(len(drivers.shown_paths)), *(drivers.first_load_number + k for k in range(len(drivers.loads)))]
    for number, signal in zip(
        numbers, [*signals, *signals_in_order({**excitation.loads, **excitation.hoist}, drivers.loads)], strict=True
    ):
        orders[0, :, number] = signal.value(t)
        ended = signal.rate(np.nextafter(t[1:], 0.0))  # at a kink the rate before it
        x = orders[0, :, number].copy()
        orders[:, :-1, number] = cubic_by_rates(x[:-1], x[1:], signal.rate(t[:-1]), ended, h)
    return orders


def inputs_csv(run: Reference, variables: Sequence[Variable]) -> str:
    """Text of resources/reference_in.csv: time and inputs of `run` at every step, with the names of `variables`.

    Measurements, which are inputs of an observer, are left out.
    """
    shown = [variable for variable in variables if variable.role.causality == "input"]
    inputs = [variable for variable in shown if variable.reference < run.inputs.shape[1]]
    return _csv(["time", *(v.name for v in inputs)], run.inputs[:, [0, *(v.reference for v in inputs)]])


def outputs_csv(run: Reference, drivers: Drivers, variables: Sequence[Variable]) -> str:
    """Text of resources/reference_out.csv: time, body outputs and contact forces of a run, under the variables' names.

    `variables` are all of the FMU; rates among them are left out.  `drivers` has the system, which names the outputs
    and contacts of the bodies.
    """
    titles = {*drivers.system.output_names, *map(force_name, drivers.system.contact_names)}
    outputs = [v for v in variables if v.role.causality == "output" and v.kind != "rate"]
    names = [v.name for v in outputs if v.description.partition("; ")[0] in titles]
    return _csv(["time", *names], np.hstack([run.t[:, None], run.outputs]))


def _csv(names: Sequence[str], rows: Array) -> str:
    """Comma-separated text of a header with `names` (k), and of `rows` (T, k) of numbers."""
    lines = [",".join(f'"{name}"' for name in names)]
    return "\n".join([*lines, *(",".join(map(repr, row)) for row in rows.tolist()), ""])


def cubic_by_rates(begun: Array, ended: Array, begun_rate: Array, ended_rate: Array, h: float) -> Array:
    """Value and rates of order one to three (4, ...) at the beginning of a step of h s: Hermite's cubic.

    The cubic has the values `begun`, `ended` (...) and the rates `begun_rate`, `ended_rate` (...) at both ends.
    """
    mean = (ended - begun) / h
    second = (6.0 * mean - 4.0 * begun_rate - 2.0 * ended_rate) / h
    return np.array([begun, begun_rate, second, 6.0 * (begun_rate + ended_rate - 2.0 * mean) / h**2])


def cubic_by_second_rates(begun: Array, ended: Array, begun_second: Array, ended_second: Array, h: float) -> Array:
    """Value and rates of order one to three (4, ...) at the beginning of a step of h s, of a cubic.

    The cubic has the values `begun`, `ended` (...) and the second rates `begun_second`, `ended_second` (...) at both
    ends.
    """
    third = (ended_second - begun_second) / h
    rate = (ended - begun) / h - h / 2.0 * begun_second - h**2 / 6.0 * third
    return np.array([begun, rate, begun_second, third])
