"""A hoist driven from outside: a stepper and an FMU beside the run, with a frame and without one."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import plain_machines
import pytest
from export.fmi.libraries import Instance, loaded
from hoists import cantilever

import pmr
from pmr import InputError, Stepper, System
from pmr.export.fmi import fmu_contents
from pmr.export.fmi.variables import Drivers
from pmr.scene import Scene
from pmr.scene.hoist import OUTPUTS, ROPE_FORCE, WINCH_PULLS
from pmr.simulation import Excitation
from pmr.simulation.moving import MovingFrame, read_scene
from pmr.simulation.native import systems
from pmr.simulation.native.form import SystemForm

CRANE = (
    "compare.against=[]", "section.mesh.elements=6", "frame.slewing.times=[-0.2,1.6]",
    "section.joint.extension.times=[0.0,0.9]", "hoist.speed.times=[0.0,0.2,0.6,0.8]",
    "hoist.wind.y.times=[0.0,0.1,0.3]", "time.end=0.2", "time.rho_inf=0.9",
)  # fmt: skip
WOUND = {"hoist.EA": 1e6, "hoist.speed": {"kind": "sine", "amplitude": 0.5, "frequency": 2.0}, "time.end": 0.2}
FORCES = np.isin([*OUTPUTS], [ROPE_FORCE, *WINCH_PULLS])
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module", params=["crane", "cantilever"])
def system(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> System:
    soft = {"body.material.young": 2.1e10, "time.rho_inf": 0.9}
    scene = pmr.load_scene(plain_machines.HOIST, CRANE) if request.param == "crane" else cantilever(WOUND | soft)
    return System.load(pmr.reduce(scene).system.save(tmp_path_factory.mktemp("system") / "system.npz"))


@pytest.fixture(scope="module")
def scene(system: System) -> Scene:
    stored = read_scene(system, "system").scene
    assert stored is not None
    return stored


@pytest.fixture(scope="module")
def hoisted(system: System, scene: Scene) -> np.ndarray:
    """Outputs (T, o) of the hoist in a run."""
    shown = systems.simulate_form(SystemForm.of(system), Excitation.from_scene(scene)).hoist
    assert shown is not None
    return shown


def assert_close(found: Any, expected: np.ndarray, bound: float) -> None:
    """That places in m, angles in rad and forces, which are some thousand times as large, are off by `bound`."""
    scale = np.maximum(np.abs(expected).max(axis=0), 1.0)
    scale[FORCES] = np.abs(expected[:, FORCES]).max()
    np.testing.assert_allclose(np.array(found) / scale, expected / scale, rtol=0.0, atol=bound)


def test_a_stepper_is_the_run(system: System, scene: Scene, hoisted: np.ndarray) -> None:
    excitation, frame = Excitation.from_scene(scene), MovingFrame.from_system(system)
    t, found = excitation.times, list[list[float]]()
    if frame is None:
        loads, paths = {**excitation.loads, **excitation.hoist}, excitation.paths
        at = [{name: float(loads[name].value(now)) for name in system.load_names} for now in t]
        steps: list[dict[str, Any]] = [
            {"s": {name: float(path.value(now)) for name, path in paths.items()}, "F": F}
            for now, F in zip(t, at, strict=True)
        ]
    else:
        motions = dict(zip(frame.drivers, np.moveaxis(frame.motions(excitation, t), 1, 0), strict=True))
        turned = [name for name in frame.drivers if name not in (*frame.paths, *frame.loads)]
        steps = [
            {
                "s": {path: tuple(motions[path][:, k].tolist()) for path in frame.paths},
                "F": {load: float(motions[load][0, k]) for load in frame.loads},
                "frame": {name: tuple(motions[name][:, k].tolist()) for name in turned},
            }
            for k in range(len(t))
        ]
    stepper = Stepper(system, scene.time.step, **steps[0], rho_inf=scene.time.rho_inf, outputs=[*OUTPUTS])
    found.append([*stepper.hoist.values()])
    found += [stepper.step(**step).tolist() for step in steps[1:]]
    assert_close(found, hoisted, 1e-10)


@pytest.mark.parametrize(("exact", "bound"), [(False, 1e-6), (True, 1e-10)])
def test_an_fmu_is_the_run(
    system: System, scene: Scene, hoisted: np.ndarray, exact: bool, bound: float, tmp_path: Path
) -> None:
    """Under its own reference, or by inputs that are exact at the end of each step, where its equations hold.

    In a frame these are parabolas by value, rate and second rate.
    """
    contents = fmu_contents(system, read_scene(system, "system"), "hoist", "3")
    library, h = loaded(contents, tmp_path, "3"), scene.time.step
    head, *rows = contents.texts["resources/reference_in.csv"].splitlines()
    names, table = [name.strip('"') for name in head.split(",")], np.array([row.split(",") for row in rows], float)
    assert not any(name.startswith(("hoist_x", "fly_hoist")) for name in names)
    begun, frame, excitation = table[0, 1:].copy(), MovingFrame.from_system(system), Excitation.from_scene(scene)
    for name in (*frame.paths, *frame.angles) if exact and frame is not None else ():
        at = frame.motions(excitation, excitation.times)[:, frame.drivers.index(name)]
        called = f"s_{name}" if name in frame.paths else name
        columns = [names.index(f"{called}{suffix}") for suffix in ("", "_rate", "_rate_2", "_rate_3")]
        begun[np.array(columns) - 1] = [*at[:, 0], 0.0]
        value, rate, second = at[:, 1:]
        ends = [value - h * rate + h**2 / 2.0 * second, rate - h * second, second, 0.0 * second]
        table[:-1, columns] = np.stack(ends, axis=1)
    instance, shown = Instance(library), list[np.ndarray]()
    outputs = [re.sub(" ", "_", name) for name in OUTPUTS]
    instance.set(["internal_step"], [h])
    instance.initialise(names[1:], begun)
    for k in range(len(table)):
        shown.append(instance.get(outputs))
        instance.set(names[1:], table[k, 1:])
        instance.step(k * h, h)
    assert_close(shown, hoisted, bound)


def test_model_exchange_and_linear_models_are_refused(system: System) -> None:
    assert not Drivers.of(system).is_differential
    with pytest.raises(InputError, match="hoist: a scene without it is allowed here"):
        system.ensure_constant("matlab")
