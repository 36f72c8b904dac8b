"""An observer in an FMU beside the observer in Python: the same bits under the same measurements."""

import json
import subprocess
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from export.fmi.libraries import CallError, Instance, loaded

import pmr
from pmr import InputError, System
from pmr.cli.export import read_unit_observer
from pmr.compare.simulated import excitation_of_scene
from pmr.export import fmi
from pmr.export.fmi import fmu_contents, write_fmu
from pmr.files.arrays import Array
from pmr.observe.measured import ObserverFile
from pmr.observe.observer import Estimates
from pmr.simulation.moving import read_scene

ROOT, H = Path(__file__).parents[3], 4e-3
RINGS = "[{at=0.15,stiffness=1e8,unilateral=false,faces={bottom=[0.0],top=[0.0]}}]"
BOOM = [
    "section.mesh.elements=4", "section.reduction.coordinates=3", "sections.base.reduction.coordinates=3",
    "start='equilibrium'", "time.end=0.1", f"time.step={H}", "time.rho_inf=0.9", "compare.against=[]",
    f"section.joint.tail={RINGS}", f"section.joint.mouth={RINGS}",
    "sections.base.supports=[{kind='pinned'},{name='cylinder',on=1.5,directions=['z'],stiffness=5e7}]",
    "section.joint.extension={kind='smooth_ramp',times=[0.02,0.1],values=[1.2,1.25]}",
    "sections.fly.loads=[{name='tip force',on='tip',direction='z',signal=0.0}]",
]  # fmt: skip
SENSORS = """
estimate = ["tip", "pad_force", "velocity of fly: tip z"]
sensors = [
    {output = "specific force of fly: tip z", noise = 0.02, bias = 0.1},
    {output = "base: force of cylinder", noise = 300.0, gain = 0.01},
]
loads = [{input = "fly.tip force", deviation = 150.0, time = 0.15}]

[payload]
input = "fly.tip force"
acceleration = "specific force of fly: tip z"
deviation = 100.0
gravity = 0.0
"""


@dataclass(frozen=True)
class Case:
    """A saved system, measurements (T, p) of its observer, estimates from them, and inputs (T + 1, n) of its FMU."""

    model: Path
    sensors: Path
    measured: Array
    estimates: Estimates
    inputs: Array

    def expected(self) -> Array:
        """Estimates, standard deviations, innovations and alarms (T, .) in the order of the FMU's variables."""
        of, q = self.estimates, len(self.estimates.outputs)
        pairs = [(of.means[:, part], of.deviations[:, part]) for part in (slice(q), slice(q, None))]
        parts = (*pairs[0], *pairs[1], of.innovations, of.alarms)
        return np.hstack([part.astype(float) for part in parts])


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Case:
    """Boom of three sections, with every fifth measurement missing."""
    folder, rng = tmp_path_factory.mktemp("observer"), np.random.default_rng(3)
    scene = pmr.load_scene("boom_three", BOOM)
    system = System.load(pmr.reduce(scene).system.save(folder / "system.npz"))
    (folder / "sensors.toml").write_text(SENSORS)
    observer = ObserverFile.read(folder / "sensors.toml").observer(scene, system, {})
    model, excitation = observer.model, excitation_of_scene(scene, system)
    numbers = [model.output_number(sensor.output) for sensor in observer.sensors]
    noise = np.array([sensor.noise for sensor in observer.sensors])
    values = model.reference[:, numbers] + (0.3, 2e3) + noise * rng.standard_normal((len(model.t), 2))
    values[rng.random(values.shape) < 0.2] = np.nan
    measured = {sensor.output: (model.t, column) for sensor, column in zip(observer.sensors, values.T, strict=True)}
    signals = [*excitation.paths.values(), *(excitation.loads[name] for name in system.input_names)]
    inputs = np.column_stack([signal.value(H * np.arange(len(model.t) + 1)) for signal in signals])
    return Case(folder / "system.npz", folder / "sensors.toml", values, observer.run(measured), inputs)


def instance_of(case: Case, folder: Path, version: str) -> tuple[Instance, list[str], list[str], list[str]]:
    """Instance of the observer's FMU, and names of its inputs, measurements and estimates."""
    system, observer = System.load(case.model), read_unit_observer(case.sensors, case.model)
    contents = fmu_contents(system, read_scene(system, "system.npz"), "observer", version, observer=observer)
    library = loaded(contents, folder, version)
    inputs = [name for name in library.named("input") if "_rate" not in name]
    measured = [name for name in inputs if name.startswith("measured_")]
    starts = ("estimate_of_", "standard_deviation_of_", "innovation_of_", "alarm_of_")
    estimated = [name for name in library.named("output") if name.startswith(starts)]
    return Instance(library), [name for name in inputs if name not in measured], measured, estimated


@pytest.mark.parametrize("version", fmi.VERSIONS)
def test_estimates_are_those_in_python_to_the_last_bit(case: Case, tmp_path: Path, version: str) -> None:
    """One step later, as rates need the step behind; also after a state that was saved, and after a reset."""
    instance, inputs, measured, estimated = instance_of(case, tmp_path, version)
    for _ in range(2):
        rows, saved = list[list[float]](), b""
        instance.initialise(inputs, case.inputs[0])
        assert np.isnan(instance.get(estimated)).all()
        for k, (values, readings) in enumerate(zip(case.inputs[1:], case.measured, strict=True)):
            if k == len(case.measured) // 2:
                saved = instance.serialised(instance.saved())
            instance.set([*inputs, *measured], [*values, *readings])
            instance.step(k * H, H)
            rows.append(instance.get(estimated))
        np.testing.assert_array_equal(rows[1:], case.expected()[:-1])
        other, half = Instance(instance.library), len(case.measured) // 2
        other.restore(other.deserialised(saved))
        for k in range(half, len(case.measured)):
            other.set([*inputs, *measured], [*case.inputs[k + 1], *case.measured[k]])
            other.step(k * H, H)
        np.testing.assert_array_equal(other.get(estimated), rows[-1])
        instance.call("Reset")


def test_steps_that_are_no_multiple_of_the_observers_are_refused(case: Case, tmp_path: Path) -> None:
    instance, inputs, _, _ = instance_of(case, tmp_path, "3")
    instance.initialise(inputs, case.inputs[0])
    with pytest.raises(CallError, match=r"the observer's step of 0.004 s, or a multiple of it, is allowed"):
        instance.step(0.0, 1.5 * H)


def test_a_moving_frame_is_refused(case: Case, tmp_path: Path) -> None:
    system = System.load(case.model)
    luffing = {**system.provenance["scene"], "frame": {"luffing": 0.5, "pivot": [0.0, 0.0, 0.0]}}
    file = replace(system, provenance={**system.provenance, "scene": luffing}).save(tmp_path / "system.npz")
    with pytest.raises(InputError, match="--observer: a system without a moving frame and without a hoist is allowed"):
        read_unit_observer(case.sensors, file)


def test_the_command_writes_it_and_other_formats_refuse_an_observer(case: Case, tmp_path: Path, run_command) -> None:
    target = tmp_path / "observer.fmu"
    arguments = ["export", str(case.model), "--observer", str(case.sensors), "--out", str(target)]
    assert run_command(*arguments, "--to", "fmu").returncode == 0 and target.exists()
    refused = run_command(*arguments, "--to", "matlab")
    assert refused.returncode == 2 and "--observer: it is allowed with --to fmu" in refused.stderr


@pytest.mark.slow
@pytest.mark.parametrize("version", fmi.VERSIONS)
def test_fmpy_finds_nothing_and_has_the_same_estimates(case: Case, tmp_path: Path, version: str) -> None:
    python = ROOT / ".venv-fmi" / "bin" / "python"
    if not python.exists():
        pytest.skip("FMPy is not installed: make test does it")
    observer = read_unit_observer(case.sensors, case.model)
    file = write_fmu(case.model, tmp_path / "observer.fmu", version, fmi.PLATFORMS[:1], observer=observer)
    data = tmp_path / "data.npz"
    np.savez(data, inputs=case.inputs, measured=case.measured, step=H)
    script = str(Path(__file__).with_name("under_fmpy.py"))
    said = [
        subprocess.run([str(python), script, *arguments], capture_output=True, text=True)
        for arguments in (["validate", str(file)], ["observe", str(file), str(data)])
    ]
    assert [each.returncode for each in said] == [0, 0], said[-1].stderr
    problems, estimates = (json.loads(each.stdout.splitlines()[-1]) for each in said)
    assert problems == []
    np.testing.assert_allclose(np.array(estimates, float)[1:], case.expected()[:-1], rtol=1e-12, atol=0.0)
