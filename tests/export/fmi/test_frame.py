"""FMUs of booms whose frame moves with inputs: beside the stepper, positions in space and NumPy."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import driven_frame
import numpy as np
import plain_machines
import pytest
from export.fmi.libraries import CallError, Instance, Library, loaded
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import pmr
from pmr.errors import InputError
from pmr.export.fmi.fmu import fmu_contents
from pmr.export.fmi.variables import Drivers, path_names
from pmr.scene import Scene, load_any
from pmr.scene.mechanism import CYLINDER
from pmr.simulation.excitation import Excitation
from pmr.simulation.modal import modal_form
from pmr.simulation.moving import MovingFrame, read_scene
from pmr.simulation.native.stepper import Stepper
from pmr.system.assembly import Assembly
from pmr.system.system import System

Array = NDArray[np.float64]
WORKFLOWS = Path(__file__).parents[3] / "workflows"
STEP = 2e-3
#: Three times as long as in the scene, with a third of its stretches: compilers are slow at reading tables.
LONG_PADS = tuple(f"section.joint.{ring}.0.{key}" for ring in ("tail", "mouth") for key in ("length=0.9", "at=0.45"))
CRANE = (
    *LONG_PADS,
    "compare.against=[]",
    "section.mesh.elements=6",
    "frame.second_order=true",
    "frame.luffing.times=[0.0,1.4]",
    "frame.slewing.times=[-0.2,1.6]",
    "section.joint.extension={kind='smooth_ramp',times=[0.0,0.9],values=[0.6,2.5]}",
    "sections.fly.loads.0.axes=ground",
    "time.end=0.1",
    "time.rho_inf=0.9",
    f"time.step={STEP}",
)
SHIP = (
    "frame.base.x={kind='sine',amplitude=0.02,frequency=2.0}",
    "frame.base.rx={kind='sine',amplitude=2.0,frequency=1.5}",
    "frame.base.ry={kind='sine',amplitude=1.0,frequency=1.1}",
    "frame.base.rz={kind='sine',amplitude=3.0,frequency=0.7}",
)
GIVES_WAY = ("section.joint.cylinder.stiffness=5e7",)
RUBS = (*GIVES_WAY, *(f"section.joint.{ring}.0.friction=0.2" for ring in ("tail", "mouth")))
#: Changes of the crane, and version of the interface: on a ship, with springs alone, and with pads that rub.
KINDS = {"ship": ((*CRANE, *SHIP), "3"), "springs": ((*CRANE, *GIVES_WAY), "2"), "rubbing": ((*CRANE, *RUBS), "3")}
#: Whether a pad slips or sticks is decided by round-off where it is near to both.
GIVEN = ["ship", "springs", pytest.param("rubbing", marks=pytest.mark.numerical)]
pytestmark = pytest.mark.slow


@dataclass(frozen=True)
class Made:
    scene: Scene
    system: System
    drivers: Drivers
    library: Library
    texts: dict[str, str]

    @property
    def frame(self) -> MovingFrame:
        assert self.drivers.frame is not None
        return self.drivers.frame

    def inputs(self) -> list[str]:
        return self.library.named("input")

    def values(self) -> list[str]:
        """Inputs without their rates."""
        return [name for name in self.inputs() if "_rate" not in name]

    def table(self, name: str) -> tuple[list[str], Array]:
        """Names and columns of a table that the unit carries, time first."""
        head, *rows = self.texts[f"resources/reference_{name}.csv"].splitlines()
        return [one.strip('"') for one in head.split(",")], np.array(
            [[float(x) for x in row.split(",")] for row in rows]
        )

    def started(self) -> Instance:
        names, table = self.table("in")
        instance = Instance(self.library)
        instance.set(["internal_step"], [STEP])
        instance.initialise(names[1:], table[0, 1:])
        return instance


@pytest.fixture(scope="module", params=GIVEN)
def made(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Made:
    changes, version = KINDS[request.param]
    scene = load_any(plain_machines.CRANE, changes)
    found = pmr.reduce(scene)
    system = System.load(found.system.save(tmp_path_factory.mktemp("system") / "system.npz"))
    texts = fmu_contents(system, read_scene(system, "system.npz"), "crane", version)
    library = loaded(texts, tmp_path_factory.mktemp("fmu"), version)
    return Made(found.scene, system, Drivers.of(system), library, texts.texts)


def driven(made: Made, instance: Instance) -> dict[str, Any]:
    """Arguments of a stepper's step, as the unit's inputs are now."""
    frame = made.frame
    motions = dict(zip(frame.drivers, instance.get(made.inputs()).reshape(4, -1)[:3].T, strict=True))
    return {
        "s": {path: motions[path] for path in frame.paths},
        "F": {load: motions[load][0] for load in frame.loads},
        "frame": {name: motions[name] for name in made.drivers.motions},
    }


def test_paths_in_another_order_than_the_scene_has_them_are_refused(made: Made) -> None:
    """As inputs would drive the wrong sections."""
    turned = replace(made.system, contacts=made.system.contacts[::-1])
    assert turned.paths == made.system.paths[::-1]
    with pytest.raises(InputError, match="paths = 'middle, fly': .* in the pads' order: fly, middle"):
        Drivers.of(turned)


def outputs_of(made: Made) -> tuple[list[str], list[str]]:
    """Of the bodies in the order of the system, and of contacts."""
    outputs = [name for name in made.library.named("output") if not name.endswith("_rate")]
    contacts = outputs[-len(made.system.contacts) :]
    return [name for name in outputs if name not in contacts and not name.startswith(("reaction", "tip_in"))], contacts


def test_co_simulation_is_the_stepper(made: Made) -> None:
    """Under what has become of its inputs at the end of each step, to round-off."""
    (moved, contacts), (names, table) = outputs_of(made), made.table("in")
    instance = made.started()
    stepper = Stepper(made.system, STEP, **driven(made, instance), rho_inf=made.scene.time.rho_inf)
    found, expected = [instance.get(moved + contacts)], [stepper.outputs]
    for k in range(len(table) - 1):
        instance.set(names[1:], table[k, 1:])
        instance.step(k * STEP, STEP)
        stepper.step(**driven(made, instance))
        found.append(instance.get(moved + contacts))
        expected.append(stepper.outputs)
    y, z = np.array(found), np.array(expected)
    for part, bound in ((slice(len(moved)), 1e-9), (slice(len(moved), None), 1e-6)):
        assert np.ptp(z[:, part], axis=0).max() > 1e-2 * np.abs(z[:, part]).max()
        np.testing.assert_allclose(y[:, part], z[:, part], rtol=0.0, atol=bound * np.abs(z[:, part]).max())


def test_the_reference_that_it_carries_is_that_of_the_run(made: Made) -> None:
    """Its inputs are cubics with the run's accelerations: rates are O(h^3) off in a step."""
    (names, table), (outputs, expected) = made.table("in"), made.table("out")
    instance, found = made.started(), []
    for k in range(len(table)):
        found.append(instance.get(outputs[1:]))
        instance.set(names[1:], table[k, 1:])
        instance.step(k * STEP, STEP)
    at = np.round(expected[:, 0] / STEP).astype(int)
    units = np.array([name.startswith("force") for name in outputs[1:]])
    for some in (units, ~units):
        y = expected[:, 1:][:, some]
        np.testing.assert_allclose(np.array(found)[at][:, some], y, rtol=0.0, atol=3e-6 * np.abs(y).max())


def test_reactions_are_those_of_the_run(made: Made) -> None:
    """Of the pin, from the modes' equations, and of the cylinder by its hinges; with inertia and second order."""
    response = pmr.simulate(made.scene, made.system)
    listed = [*(f"reaction of base: pin {axis}" for axis in ("x", "y", "z", "rx", "rz")), CYLINDER]
    names = [re.sub("[: ]+", "_", name) for name in listed]
    columns = [response.other_names.index(name) for name in listed]
    assert response.others is not None
    expected = response.others[:, columns]
    (inputs, table), instance, found = made.table("in"), made.started(), []
    for k in range(len(table)):
        found.append(instance.get(names))
        instance.set(inputs[1:], table[k, 1:])
        instance.step(k * STEP, STEP)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-5 * np.abs(expected).max())


def test_the_tip_is_where_it_is_in_space(made: Made) -> None:
    """By rotations of SciPy; its velocity by differences over short steps, which converge with their square."""
    names, table = made.table("in")
    place, rate = ([f"tip_in_space_{axis}{what}" for axis in "XYZ"] for what in ("", "_rate"))
    instance, h = made.started(), 1e-4
    instance.set(names[1:], table[20, 1:])
    places, rates = list[Array](), list[Array]()
    for k in range(3):
        instance.step(k * h, h)
        places.append(instance.get(place))
        rates.append(instance.get(rate))
    values = dict(zip(made.inputs(), instance.get(made.inputs()), strict=True))
    assert made.scene.frame is not None
    u = np.array(
        [
            instance.get([f"fly_tip_{axis}"])[0] if f"fly_tip_{axis}" in made.library.references else 0.0
            for axis in "xyz"
        ]
    )
    X = values["s_middle"] + values["s_fly"] + made.scene.sections[-1].length
    rocked = [values.get(name, 0.0) for name in ("base_rz", "base_ry", "base_rx")]
    axes = Rotation.from_euler("ZYX", rocked) * Rotation.from_euler("ZY", [values["slewing"], -values["luffing"]])
    expected = axes.apply(np.array(made.scene.frame.tail_position) + u + [X, 0.0, 0.0])
    np.testing.assert_allclose(places[-1], expected, rtol=1e-13)
    slope = (places[2] - places[0]) / (2.0 * h)
    assert np.abs(u).max() > 1e-3
    np.testing.assert_allclose(rates[1], slope, rtol=0.0, atol=1e-3 * np.abs(slope).max())


def test_model_exchange_has_the_equations_of_motion(made: Made) -> None:
    """M q'' = B f - D q' - K q - sum c (V q' + G q) - C^T lambda, lambda of springs, in NumPy."""
    if not made.drivers.is_differential:
        with pytest.raises(CallError, match="leave no differential equation"):
            Instance(made.library, model_exchange=True)
        return
    rng, system, assembly = np.random.default_rng(5), made.system, Assembly(made.system)
    forms = [modal_form(body) for body in system.reduced.values()]
    z, v = (1e-3 * rng.normal(size=assembly.size) for _ in range(2))
    ends = np.cumsum([form.body.size for form in forms])[:-1]
    q, rate = (np.concatenate([form.X @ a for form, a in zip(forms, np.split(b, ends), strict=True)]) for b in (z, v))
    instance = Instance(made.library, model_exchange=True)
    instance.choose_start(0)
    names, table = made.table("in")
    instance.initialise(names[1:], table[20, 1:])
    instance.set_states(np.concatenate([z, v]))
    now = driven(made, instance)
    f, c = driven_frame.find(
        made.frame,
        np.column_stack([*now["s"].values(), *([x, 0.0, 0.0] for x in now["F"].values()), *now["frame"].values()]),
    )
    rows = assembly.contact_rows(system.side_coordinates({path: motion[0] for path, motion in now["s"].items()}))
    forces = np.linalg.solve(rows.F, rows.C @ q + rows.H @ f)
    right = assembly.B @ f - assembly.D @ rate - assembly.K @ q - rows.C.T @ forces
    at = {name: np.arange(one.start, one.stop) for name, one in assembly.coordinate_slices.items()}
    for term, amplitude in zip(system.terms, c, strict=True):
        on = np.concatenate([at[name] for name in term.bodies])
        for key, A in term.arrays.items():
            right[on] -= amplitude * (A @ (q if key == "stiffness" else rate)[on])
    expected = np.concatenate([form.X.T @ a for form, a in zip(forms, np.split(right, ends), strict=True)])
    found = instance.derivatives(2 * len(z))
    assert np.abs(c).max() > 0.0
    np.testing.assert_allclose(found[len(z) :], expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())


def test_derivatives_along_each_direction(made: Made) -> None:
    """Against central differences, of angles and their rates too; between breaks of the rows."""
    if not made.drivers.is_differential:
        return
    outputs = [name for name in made.library.named("output") if "reaction" not in name]
    groups = [
        [name for name in outputs if name.endswith("_rate")],
        [name for name in outputs if name.startswith("force")],
        [name for name in outputs if not name.endswith("_rate") and not name.startswith("force")],
        [name for name in made.library.named("output") if "reaction" in name],
        [name for name in made.library.named("local") if name.startswith("der_")],
    ]
    unknowns, counts = [name for group in groups for name in group], [len(group) for group in groups]
    ends, rng = np.cumsum(counts)[:-1], np.random.default_rng(3)
    (names, table), instance = made.table("in"), Instance(made.library, model_exchange=True)
    given = made.inputs()
    at = table[20, 1:].copy()
    at[: len(made.system.paths)] = [1.3117, 0.9371]
    instance.choose_start(0)
    instance.initialise(given, at)
    states = [name for name in made.library.named("local") if "mode_" in name and not name.startswith("der_")]
    x = 1e-3 * rng.normal(size=len(states))

    def seen(at: Array, states: Array) -> Array:
        instance.set(given, at)
        instance.set_states(states)
        return instance.get(unknowns)

    assert given == names[1:]
    for k, known in enumerate([*given, *states[:3]]):
        of_inputs, of_modes = np.zeros(len(at)), np.zeros(len(x))
        h = 1e-5 if k < len(at) else 1e-6
        (of_inputs if k < len(at) else of_modes)[k if k < len(at) else k - len(at)] = h
        expected = (seen(at + of_inputs, x + of_modes) - seen(at - of_inputs, x - of_modes)) / (2.0 * h)
        seen(at, x)
        found = instance.directional(unknowns, known)
        slopes, sizes = (
            np.array([np.abs(one).max() for one in np.split(y, ends)]) for y in (expected, instance.get(unknowns))
        )
        atol = np.repeat(1e-6 * slopes + 1e-12 * sizes / h, counts)
        assert np.all(np.abs(found - expected) <= 1e-5 * np.abs(expected) + atol), known


def test_ten_instances_go_their_own_ways(made: Made) -> None:
    """In turn, each as alone; after a reset as from the beginning, and a saved state returns bit for bit."""
    names, table = made.table("in")
    seen = [*sum(outputs_of(made), []), "tip_in_space_Z"]

    def step(instance: Instance, k: int, gust: float) -> None:
        instance.set(names[1:], table[k, 1:])
        instance.set(["fly_gust"], [gust])
        instance.step(k * STEP, STEP)

    def alone(gust: float) -> Array:
        instance = made.started()
        for k in range(5):
            step(instance, k, gust)
        return instance.get(seen)

    instances = [made.started() for _ in range(10)]
    for k in range(5):
        for number, instance in enumerate(instances):
            step(instance, k, 1e3 * number)
    found = np.array([instance.get(seen) for instance in instances])
    for number in (0, 4, 9):
        np.testing.assert_array_equal(found[number], alone(1e3 * number))
    assert len(np.unique(found[:, -1])) == 10
    one = instances[4]
    content = one.serialised(one.saved())
    step(one, 5, 0.0)
    after = one.get(seen)
    one.call("Reset")
    one.set(["internal_step"], [STEP])
    one.initialise(names[1:], table[0, 1:])
    for k in range(5):
        step(one, k, 4e3)
    np.testing.assert_array_equal(one.get(seen), found[4])
    other = made.started()
    other.restore(other.deserialised(content))
    step(other, 5, 0.0)
    np.testing.assert_array_equal(other.get(seen), after)


def test_bad_values_are_refused(made: Made) -> None:
    instance = made.started()
    with pytest.raises(CallError, match="a finite number is allowed"):
        instance.set(["luffing"], [np.nan])
    with pytest.raises(CallError, match="an angle of at most one turn is allowed, in rad"):
        instance.set(["luffing"], [45.0])
    instance = made.started()
    instance.set(["s_fly"], [99.0])
    with pytest.raises(CallError, match=r"s_fly = 99 m lies off the path"):
        instance.step(0.0, STEP)
    with pytest.raises(CallError, match="read only"):
        instance.set(["tip_in_space_X"], [1.0])


def test_a_motion_without_second_rates_is_told_once(made: Made) -> None:
    """As the run has it nothing is said; with values and first rates alone the inertia of what moves is missing."""
    names, table = made.table("in")
    second = [name for name in names[1:] if name.endswith(("_rate_2", "_rate_3"))]
    for left_out in (False, True):
        instance = made.started()
        for row in table[: len(table) // 2]:
            instance.set(names[1:], row[1:])
            if left_out:
                instance.set(second, np.zeros(len(second)))
            instance.step(row[0], STEP)
        said = [one for one in instance.said if "the inertia of what moves is left out" in one]
        assert bool(said) == left_out and len(said) == len(set(said))


def test_what_goes_in_has_its_unit(made: Made) -> None:
    root = ET.fromstring(made.texts["modelDescription.xml"])
    units = dict[str, str]()
    for variable in root.iter():
        if variable.get("causality") == "input":
            real = variable if variable.tag == "Float64" else variable.find("Real")
            assert real is not None
            units[str(variable.get("name"))] = str(real.get("unit"))
    expected = {
        "luffing": "rad",
        "slewing_rate": "rad/s",
        "luffing_rate_2": "rad/s2",
        "gravity": "m/s2",
        "fly_gust": "N",
    }
    assert {name: units[name] for name in expected} == expected
    assert path_names(made.drivers.paths) == ["s middle", "s fly"]
    assert Excitation.from_scene(made.scene).paths.keys() == set(made.frame.paths)
