"""FMUs of the paper's evolved case with six coordinates and of the reference boom, run by FMPy and from C."""

import json
import os
import re
import shlex
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import one_body
import plain_machines
import pytest
from export.fmi import loop, valve
from numpy.typing import ArrayLike
from simulation.native import test_stepper_luffing, test_watched

from benchmarks.fmu import Timed
from pmr import ReducedModel, Stepper, System, reduce, scene
from pmr.export import fmi
from pmr.export.fmi import PLATFORMS
from pmr.export.fmi.description import reference
from pmr.export.fmi.variables import Drivers
from pmr.files.arrays import Array
from pmr.scene.signals import Ramp, SignalBase
from pmr.simulation import Excitation, TimeStepping
from pmr.simulation.free_base import with_all_inertia
from pmr.simulation.modal import modal_form
from pmr.simulation.moving import read_scene
from pmr.simulation.native import systems
from pmr.system.body import force_outputs

ROOT = Path(__file__).parents[3]
HERE = Path(__file__).parent
pytestmark = pytest.mark.slow
CASES = {"evolved_residual": ["time.end=6"], "boom_shell": ["time.end=2"]}
#: All that ziglang compiles for with ``PMR_SWEEP=full``: a minute each.
COMPILED = PLATFORMS if os.environ.get("PMR_SWEEP") == "full" else PLATFORMS[:1]
#: What an importer of both kinds calls, by version.
REQUIRED = {
    "2": "Instantiate FreeInstance SetupExperiment EnterInitializationMode ExitInitializationMode Terminate Reset "
    "GetReal SetReal GetInteger SetInteger GetFMUstate SetFMUstate FreeFMUstate SerializeFMUstate DeSerializeFMUstate "
    "GetDirectionalDerivative DoStep SetTime SetContinuousStates GetDerivatives GetContinuousStates NewDiscreteStates",
    "3": "InstantiateCoSimulation InstantiateModelExchange FreeInstance EnterInitializationMode ExitInitializationMode "
    "GetFloat64 SetFloat64 GetInt64 SetInt64 GetFMUState SetFMUState SerializeFMUState DeserializeFMUState DoStep "
    "GetDirectionalDerivative SetTime SetContinuousStates GetContinuousStateDerivatives UpdateDiscreteStates",
}


@dataclass(frozen=True)
class Exported:
    model: ReducedModel
    files: dict[str, Path]


@pytest.fixture(scope="module")
def fmpy() -> Path:
    python = ROOT / ".venv-fmi" / "bin" / "python"
    if not python.exists():
        pytest.skip("FMPy is not installed: make test does it")
    return python


@pytest.fixture(scope="module", params=CASES)
def exported(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Exported:
    folder = tmp_path_factory.mktemp(request.param)
    model = reduce(scene.load(ROOT / "workflows" / f"{request.param}.toml", CASES[request.param])).reduced
    npz, files = model.save(folder / "reduced.npz"), {}
    for version in fmi.VERSIONS:
        everywhere = request.param == "evolved_residual" and version == "3"  # one library has both versions
        target = folder / f"body_{version}.fmu"
        files[version] = fmi.write_fmu(npz, target, version, COMPILED if everywhere else PLATFORMS[:1])
    return Exported(model, files)


#: Short, and less damped by the scheme than by itself.
AT_ONCE = ("time.end=0.02", "time.rho_inf=0.9")


class Held(SignalBase):
    """What a master sets at the beginning of each step, and leaves until its end."""

    step: float
    values: tuple[float, ...]

    def value(self, t: ArrayLike) -> Array:
        before = np.ceil(np.asarray(t, float) / self.step - 1e-6).astype(int) - 1
        return np.array(self.values)[np.maximum(before, 0)]

    def rate(self, t: ArrayLike) -> Array:
        return np.zeros_like(np.asarray(t, float))


def under(python: Path, *arguments: str) -> Any:
    command = [str(python), str(HERE / "under_fmpy.py"), *arguments]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize("version", fmi.VERSIONS)
def test_fmpy_finds_nothing_and_steps_as_march_does(exported: Exported, fmpy: Path, version: str) -> None:
    file = str(exported.files[version])
    assert under(fmpy, "validate", file) == []
    found = under(fmpy, "steps", file)
    assert found["steps"] == read_scene(System.of(exported.model), "model").excitation.stepping.steps
    assert found["m"] < 1e-9
    assert found["N"] < 1e-3


@pytest.mark.parametrize(("sections", "version"), [("two", "2"), ("three", "2"), ("three", "3")])
def test_a_boom_steps_under_fmpy_as_march_does(sections: str, version: str, fmpy: Path, tmp_path: Path) -> None:
    """From a saved system, its extensions as inputs; on pads that push, in the parts that these take."""
    found = reduce(scene.load_any(ROOT / "workflows" / f"boom_{sections}.toml", ["time.end=1.0"]))
    file = fmi.write_fmu(found.system.save(tmp_path / "system.npz"), tmp_path / "boom.fmu", version, PLATFORMS[:1])
    assert under(fmpy, "validate", str(file)) == []
    seen = under(fmpy, "steps", str(file))
    assert seen["steps"] == read_scene(found.system, "system").excitation.stepping.steps
    assert seen["m"] < 1e-9
    assert (
        seen["N"] < 1e-1
    )  # a rigid cylinder's force is an acceleration: round-off of the position over the step squared


def test_a_crane_in_a_loop_under_fmpy_is_that_with_a_stepper(fmpy: Path, tmp_path: Path) -> None:
    """A PID and a cylinder raise it from 10 to 17 degrees within a second, in second order, and feel tip and force.

    They are Python, or a unit of their own.
    """
    changes = ["compare.against=[]", "section.mesh.elements=6", "frame.second_order=true", *AT_ONCE]
    system = reduce(scene.load_any(plain_machines.CRANE, changes)).system
    file = fmi.write_fmu(system.save(tmp_path / "system.npz"), tmp_path / "crane.fmu", "3", PLATFORMS[:1])
    looped = [under(fmpy, "loop", str(file))]
    looped.append(under(fmpy, "loop_of_two", str(file), str(valve.written(tmp_path / "valve.fmu"))))
    stepper = Stepper(system, loop.STEP, {"middle": 0.6, "fly": 0.6}, rho_inf=0.9, outputs=loop.READ)
    numbers = [stepper.output_names.index(name) for name in loop.READ]
    luffing, expected = loop.Luffing([np.radians(10.0), 0.0, 0.0]), [stepper.outputs[numbers]]
    for _ in range(loop.STEPS):
        luffing.led_on(*expected[-1])
        expected.append(stepper.step({}, frame={"luffing": luffing.angle}).copy())
    assert luffing.angle[0] > 0.27
    for other, *ones in zip(*np.swapaxes([expected, *looped], 1, 2), strict=True):
        assert np.ptp(other) > 1e-2 * np.abs(other).max()
        for one in ones:
            np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-6 * np.abs(other).max())


@pytest.mark.parametrize("version", fmi.VERSIONS)
def test_a_crane_that_luffs_by_itself_steps_under_fmpy_as_in_its_run(version: str, fmpy: Path, tmp_path: Path) -> None:
    _, system = test_stepper_luffing.boom("opening")
    file = fmi.write_fmu(system.save(tmp_path / "system.npz"), tmp_path / "crane.fmu", version, PLATFORMS[:1])
    assert under(fmpy, "validate", str(file)) == []
    seen = under(fmpy, "steps", str(file))
    assert seen["m"] < 1e-6
    assert seen["N"] < 1.0  # of 10 kN


@pytest.mark.parametrize("version", fmi.VERSIONS)
@pytest.mark.parametrize("name", ["nothing", "pads pull"])
def test_fmpy_logs_what_a_run_warns_of(name: str, version: str, fmpy: Path, tmp_path: Path) -> None:
    boom = test_watched.SCENES[name][0]()
    file = fmi.write_fmu(reduce(boom).system.save(tmp_path / "s.npz"), tmp_path / "b.fmu", version, PLATFORMS[:1])
    logged = test_watched.times_of(under(fmpy, "steps", str(file))["logged"])
    assert logged == pytest.approx(test_watched.said_by_run(boom), rel=1e-9)


def test_another_importer_steps_as_march_does(exported: Exported, fmpy: Path) -> None:
    """libcosim, which knows FMI 2.0."""
    assert under(fmpy, "cosim", str(exported.files["2"])) < 1e-9


@pytest.mark.parametrize("version", fmi.VERSIONS)
def test_model_exchange_under_cvode(exported: Exported, fmpy: Path, version: str, tmp_path: Path) -> None:
    """Against march with a hundredth of the step, which is off by some 1e-7 m itself."""
    excitation = read_scene(System.of(exported.model), "model").excitation
    stepping, moved = excitation.stepping, np.flatnonzero(~force_outputs(exported.model))
    fine = excitation.with_stepping(TimeStepping(stepping.end, stepping.step / 100.0, 1.0))
    seen = one_body.observe(modal_form(exported.model), fine, moved.tolist(), every=100)
    half = excitation.with_stepping(TimeStepping(stepping.end, stepping.step / 5.0))
    signals = [one.rate(half.times) for one in (excitation.path, *excitation.loads.values())]
    u = np.column_stack([half.times, half.s, half.f, *signals])
    kinks = np.array(excitation.path.breaks)
    np.savez(tmp_path / "fine.npz", t=seen.t, y=seen.y, u=u, kinks=kinks)
    assert np.abs(seen.y).max() > 1e-3
    assert under(fmpy, "cvode", str(exported.files[version]), str(tmp_path / "fine.npz")) < 1e-6


@pytest.mark.parametrize("version", fmi.VERSIONS)
def test_every_binary_exports_the_interface(exported: Exported, fmpy: Path, version: str) -> None:
    found = under(fmpy, "symbols", str(exported.files[version]))
    assert len(found) in (1, len(COMPILED))
    for file, names in found.items():
        missing = {f"fmi{version}{name}" for name in REQUIRED[version].split()} - set(names)
        assert not missing, file


def test_the_self_check_of_the_manual_on_the_tutorials_boom(
    fmpy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run_command
) -> None:
    """Its commands as they are written, but that only this machine's binary is made."""
    page = (ROOT / "docs" / "fmu.md").read_text().split("## Self-check")[1]
    commands = re.findall(r"^    (\S.*)$", page.split("```")[0], flags=re.M)
    (check,) = re.findall(r"^```python\n(.*?)^```$", page, flags=re.S | re.M)
    monkeypatch.chdir(tmp_path)
    assert run_command("new", "boom", "mine").returncode == 0
    model = reduce(scene.load(Path("mine") / "scene.toml")).reduced
    fmi.write_fmu(model.save(tmp_path / "reduced.npz"), "boom.fmu", platforms=PLATFORMS[:1])
    programs = {"PATH": f"{fmpy.parent}:/usr/bin:/bin"}
    assert [command.split()[0] for command in commands] == ["python", "fmpy"]
    for command in (*(shlex.split(line) for line in commands), ["python", "-c", check]):
        done = subprocess.run(command, env=programs, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    found = {name: float(value) for name, value in (line.split() for line in done.stdout.splitlines())}
    forces = {name for name in found if name.startswith("force_of")}
    assert 0.0 < max(found[name] for name in forces) < 1e-5
    assert 0.0 < max(value for name, value in found.items() if name not in forces) < 1e-12


def test_the_boom_of_the_manual_is_driven_under_fmpy(fmpy: Path, tmp_path: Path) -> None:
    """As it is written there; against `march` along the same straight lines, the weight and all else as they begin."""
    page = (ROOT / "docs" / "fmu.md").read_text().split("## Drive a boom with FMPy")[1]
    (drive,) = re.findall(r"^```python\n(.*?)^```$", page.split("\n## ")[0], flags=re.S | re.M)
    system = reduce(scene.load_any(ROOT / "workflows" / "boom_three.toml", ["time.end=0.5"])).system
    fmi.write_fmu(system.save(tmp_path / "system.npz"), tmp_path / "three.fmu", platforms=PLATFORMS[:1])
    done = subprocess.run([str(fmpy), "-c", drive], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    known = read_scene(system, "system")
    t, h = known.excitation.times, known.excitation.stepping.step
    s = 0.6 + 0.4 * np.sin(np.pi * t) ** 2
    acceleration = np.diff(np.append(np.diff(s) / h, 0.0), prepend=0.0) / h
    starting = zip(system.input_names, known.first_loads, strict=True)
    loads: dict[str, SignalBase] = {name: Ramp(times=(0.0, 1.0), values=(at, at)) for name, at in starting}
    loads["fly.extension"] = Held(step=h, values=tuple(acceleration.tolist()))
    paths = {"middle": Ramp(times=(0.0, 1.0), values=(0.6, 0.6)), "fly": Ramp(times=t.tolist(), values=s.tolist())}
    given = Excitation(paths, loads, reference(Drivers.of(system), known).stepping)
    run = systems.simulate(system, given, systems.static_start(system, given))
    tip = systems.displacements(system, run)["fly"][-1, -1]
    force = run.forces[-1, system.contact_names.index("cylinder of fly")]
    found = [float(number) for number in done.stdout.splitlines()[-1].split()]
    assert found[0] == pytest.approx(tip, rel=1e-6)
    assert found[1] == pytest.approx(force, rel=1e-5)  # of a rigid row (index 3): places times mass over h^2


def test_the_controller_of_the_manual_holds_the_angle_under_fmpy(fmpy: Path, tmp_path: Path) -> None:
    """As it is written there; beside a `Stepper` under the same controller, whose steps are those of the FMU."""
    page = (ROOT / "docs" / "fmu.md").read_text().split("## A controller in the loop")[1]
    (loop,) = re.findall(r"^```python\n(.*?)^```$", page.split("\n## ")[0], flags=re.S | re.M)
    system = reduce(scene.load_any("luffing_oil", ["section.mesh.elements=6", "time.end=0.1"])).system
    fmi.write_fmu(system.save(tmp_path / "oil.npz"), tmp_path / "oil.fmu", platforms=PLATFORMS[:1])
    program = f"import numpy as np\n{loop}"
    done = subprocess.run([str(fmpy), "-c", program], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    h, parts = 0.01, 5
    names = ["luffing angle", "luffing cylinder pressure bore"]
    stepper = Stepper(with_all_inertia(system), h / parts, s={"middle": 2.0, "fly": 2.0}, outputs=names, rho_inf=0.9)
    angle = stepper.luffing["luffing angle"]
    for k in range(1500):
        error = np.radians(min(20.0 + 2.5 * k * h, 40.0)) - angle
        for _ in range(parts):
            angle, pressure = stepper.step({}, {"luffing drive opening": 12.0 * error + 0.05 * np.sign(error)})
    found = [float(number) for number in done.stdout.splitlines()[-1].split()]
    assert found == pytest.approx([angle, pressure], rel=1e-6)
    assert np.degrees(found[0]) == pytest.approx(40.0, abs=0.05)


def test_steps_through_the_c_interface_are_timed(exported: Exported, tmp_path: Path) -> None:
    assert Timed(System.of(exported.model), exported.files["2"], tmp_path).seconds(steps=200) > 0.0
