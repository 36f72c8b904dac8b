"""Run FMUs with FMPy, in its own environment: under_fmpy.py KIND FMU [npz] calls the function KIND, prints JSON."""

import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from fmpy import extract, instantiate_fmu, read_csv, read_model_description, simulate_fmu
from fmpy.sundials import CVodeSolver
from fmpy.validation import validate_fmu
from loop import STEP, STEPS, VARIABLES, Luffing


def validate(fmu: str) -> Any:
    """Problems that FMPy finds in an FMU."""
    return validate_fmu(fmu)


def steps(fmu: str) -> Any:
    """Largest difference, by unit, of Co-Simulation to the FMU's own reference, under the inputs that it carries.

    Also what the FMU logs.
    """
    folder = Path(extract(fmu))
    said = read_model_description(folder)
    inputs, reference = (read_csv(str(folder / "resources" / f"reference_{name}.csv")) for name in ("in", "out"))
    names = [name for name in reference.dtype.names if name != "time"]
    step, units = float(said.defaultExperiment.stepSize), {v.name: v.unit for v in said.modelVariables}
    logged: list[str] = []
    found = simulate_fmu(
        str(folder), fmi_type="CoSimulation", input=inputs, output=names, output_interval=step,
        stop_time=float(said.defaultExperiment.stopTime), logger=lambda *message: logged.append(message[-1].decode()),
    )  # fmt: skip
    at = np.round(reference["time"] / step).astype(int)
    differs = {unit: 0.0 for unit in units.values()}
    for name in names:
        differs[units[name]] = max(differs[units[name]], float(np.abs(found[name][at] - reference[name]).max()))
    return {"m": differs["m"], "N": differs.get("N", 0.0), "steps": len(found) - 1, "logged": logged}


def cvode(fmu: str, npz: str) -> Any:
    """Largest difference in m to y of Model Exchange under CVODE, with inputs set at every evaluation.

    The npz file holds t (T,), y (T, o), and u (S, 1 + 2 n): time, n inputs and their rates on a fine grid, between
    whose points inputs are cubic.
    """
    folder, data = str(extract(fmu)), np.load(npz)
    said, u, t, y = read_model_description(folder), data["u"], data["t"], data["y"]
    two, h = said.fmiVersion == "2.0", u[1, 0]
    model = instantiate_fmu(folder, said, fmi_type="ModelExchange")
    setter, getter = (model.setReal, model.getReal) if two else (model.setFloat64, model.getFloat64)
    by_name = {v.name: v for v in said.modelVariables if v.causality == "input"}
    values = [v.valueReference for name, v in by_name.items() if "_rate" not in name]
    rates = [v.valueReference for name, v in by_name.items() if name.endswith("_rate")]
    outputs = [v.valueReference for v in said.modelVariables if v.causality == "output" and v.unit == "m"]

    def given(now: float) -> None:
        """Set all inputs and their rates at the time `now`."""
        k = min(max(int(now / h), 0), len(u) - 2)
        x = now / h - k
        a, b, da, db = u[k, values], u[k + 1, values], u[k, rates] * h, u[k + 1, rates] * h
        c, d = 3.0 * (b - a) - 2.0 * da - db, 2.0 * (a - b) + da + db
        setter([*values, *rates], [*(a + x * (da + x * (c + x * d))), *((da + x * (2.0 * c + 3.0 * x * d)) / h)])

    def set_time(now: float) -> None:
        """Set the time and the inputs."""
        model.setTime(now)
        given(now)

    if two:
        model.setupExperiment(startTime=0.0)
        model.enterInitializationMode()
    else:
        model.enterInitializationMode(startTime=0.0)
    given(0.0)
    model.exitInitializationMode()
    model.enterContinuousTimeMode()
    solver = CVodeSolver(
        nx=said.numberOfContinuousStates, nz=0, get_x=model.getContinuousStates, set_x=model.setContinuousStates,
        get_dx=model.getDerivatives if two else model.getContinuousStateDerivatives, get_z=lambda *_: None,
        get_nominals=model.getNominalsOfContinuousStates, set_time=set_time, input=None, startTime=0.0, maxStep=0.01,
        relativeTolerance=1e-8,
    )  # fmt: skip
    now, worst, kinks = 0.0, 0.0, data["kinks"]
    for k in range(10, len(t), 10):
        _, _, now = solver.step(now, t[k])
        set_time(now)
        worst = max(worst, float(np.abs(np.array(getter(outputs)) - y[k]).max()))
        if np.abs(kinks - now).min(initial=1.0) < 1e-9:
            solver.reset(now)
    return worst


def cosim(fmu: str) -> Any:
    """Largest difference of a displacement in m as by `steps`, but under libcosim, whose importer is FMI Library."""
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimManipulator import CosimManipulator
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    folder = Path(extract(fmu))
    said = read_model_description(folder)
    inputs, reference = (read_csv(str(folder / "resources" / f"reference_{name}.csv")) for name in ("in", "out"))
    known = {v.name: v for v in said.modelVariables}
    moved = [name for name in reference.dtype.names if name in known and known[name].unit == "m"]
    given = [name for name in inputs.dtype.names if name != "time"]
    execution = CosimExecution.from_step_size(round(1e9 * float(said.defaultExperiment.stepSize)))
    unit = execution.add_local_slave(CosimLocalSlave(fmu_path=fmu, instance_name="body"))
    drive, seen = CosimManipulator.create_override(), CosimObserver.create_last_value()
    execution.add_manipulator(drive)
    execution.add_observer(seen)
    values, outputs = ([known[name].valueReference for name in names] for names in (given, moved))
    for name, reference_of in zip(given, values, strict=True):  # its initialisation knows no manipulator
        execution.real_initial_value(unit, reference_of, float(inputs[0][name]))
    instants = {round(float(row["time"]), 9): row for row in reference}
    worst = 0.0
    for now, after in zip(inputs[:-1], inputs[1:], strict=True):
        drive.slave_real_values(slave_index=unit, variable_references=values, values=[float(now[n]) for n in given])
        assert execution.step()
        row = instants.get(round(float(after["time"]), 9))
        if row is not None:
            found = seen.last_real_values(slave_index=unit, variable_references=outputs)
            worst = max(worst, float(np.abs(np.array(found) - [row[name] for name in moved]).max()))
    return worst


def observe(fmu: str, npz: str) -> Any:
    """Estimates (T, .) of an observer, from measurements (T, p) at the ends of steps, with all inputs set there."""
    folder, data = str(extract(fmu)), np.load(npz)
    said = read_model_description(folder)
    unit, two = instantiate_fmu(folder, said, fmi_type="CoSimulation"), said.fmiVersion == "2.0"
    setter, getter = (unit.setReal, unit.getReal) if two else (unit.setFloat64, unit.getFloat64)
    given = [v for v in said.modelVariables if v.causality == "input" and "_rate" not in v.name]
    inputs, measured = (
        [v.valueReference for v in given if v.name.startswith("measured_") == is_measured]
        for is_measured in (False, True)
    )
    starts = ("estimate_of_", "standard_deviation_of_", "innovation_of_", "alarm_of_")
    estimated = [v.valueReference for v in said.modelVariables if v.name.startswith(starts)]
    if two:
        unit.setupExperiment(startTime=0.0)
    unit.enterInitializationMode()
    setter(inputs, data["inputs"][0].tolist())
    unit.exitInitializationMode()
    rows, h = [], float(data["step"])
    for k, (values, readings) in enumerate(zip(data["inputs"][1:], data["measured"], strict=True)):
        setter([*inputs, *measured], [*values, *readings])
        unit.doStep(currentCommunicationPoint=k * h, communicationStepSize=h)
        rows.append(list(map(float, getter(estimated))))
    return rows


def loop(fmu: str) -> Any:
    """Values (T, 2) that are read of a crane which a valve raises, beginning with the start."""
    return raised(fmu, Luffing)


def loop_of_two(fmu: str, valve: str) -> Any:
    """Values (T, 2) as by `loop`, but with the valve as an FMU too."""
    return raised(fmu, lambda angle: Valve(valve, angle[0]))


class Valve:
    """FMU that does what `Luffing` does, from an angle in rad on."""

    def __init__(self, fmu: str, start: float) -> None:
        folder = str(extract(fmu))
        said = read_model_description(folder)
        references = {v.name: v.valueReference for v in said.modelVariables}
        self._unit, self._time = instantiate_fmu(folder, said, fmi_type="CoSimulation"), 0.0
        self._given = [references[name] for name in ("tip", "force")]
        self._told = [v.valueReference for v in said.modelVariables if v.causality == "output"]
        self._unit.setReal([references["start"]], [start])
        self._unit.setupExperiment(startTime=0.0)
        self._unit.enterInitializationMode()
        self._unit.exitInitializationMode()

    def led_on(self, tip: float, force: float) -> list[float]:
        """Angle and its rates of order one to three in the next step."""
        self._unit.setReal(self._given, [tip, force])
        self._unit.doStep(currentCommunicationPoint=self._time, communicationStepSize=STEP)
        self._time += STEP
        return list(self._unit.getReal(self._told))


def raised(fmu: str, raising: Callable[[list[float]], Any]) -> Any:
    """Values (T, 2) that are read of a crane whose luffing `raising` makes from angle and rates at the start."""
    folder = str(extract(fmu))
    said = read_model_description(folder)
    references = {v.name: v.valueReference for v in said.modelVariables}
    model = instantiate_fmu(folder, said, fmi_type="CoSimulation")
    step = [references["internal_step"]]
    driven = [references[f"luffing{order}"] for order in ("", "_rate", "_rate_2", "_rate_3")]
    seen = [references[name] for name in VARIABLES]
    model.setFloat64(step, [STEP])
    model.enterInitializationMode(startTime=0.0)
    model.exitInitializationMode()
    luffing, found = raising([float(model.getFloat64(driven[:1])[0]), 0.0, 0.0]), [model.getFloat64(seen)]
    for k in range(STEPS):
        model.setFloat64(driven, luffing.led_on(*found[-1]))
        model.doStep(currentCommunicationPoint=k * STEP, communicationStepSize=STEP)
        found.append(model.getFloat64(seen))
    return [list(map(float, one)) for one in found]


def symbols(fmu: str) -> Any:
    """Exported functions of the interface, by file."""
    import lief

    folder = Path(extract(fmu))
    found = {}
    for file in sorted((folder / "binaries").rglob("*.*")):
        binary = lief.parse(str(file))
        names = {function.name.lstrip("_") for function in binary.exported_functions}
        found[str(file.relative_to(folder / "binaries"))] = sorted(n for n in names if re.match("fmi[23][A-Z]", n))
    return found


KINDS = {one.__name__: one for one in (validate, steps, cvode, cosim, observe, loop, loop_of_two, symbols)}

if __name__ == "__main__":
    print(json.dumps(KINDS[sys.argv[1]](*sys.argv[2:])))
