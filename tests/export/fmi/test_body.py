"""The C source of FMUs, compiled here and called through its interface, against `march` and NumPy."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import one_body
import pytest
from export.fmi.libraries import CallError, Instance, Library, library
from numpy.typing import NDArray
from on_pads import beam_on_pads, flexible_on_pads
from one_body import displacement
from oracle import flexible, project, rich_body
from springs import CompliantRows

from pmr.errors import BEYOND_ENDS
from pmr.export.fmi.fmu import Contents, fmu_contents
from pmr.export.fmi.reference import reference
from pmr.export.fmi.variables import Drivers
from pmr.scene.signals import Chirp, Ramp, SignalBase, Sine, SmoothRamp
from pmr.simulation.excitation import SLIDER, Excitation
from pmr.simulation.modal import modal_form
from pmr.simulation.moving import read_scene
from pmr.simulation.native.stepper import Stepper
from pmr.simulation.statics.equilibrium import equilibrium
from pmr.simulation.stepping import TimeStepping
from pmr.system.assembly import Assembly
from pmr.system.reduced_model import ReducedModel
from pmr.system.system import System

Array = NDArray[np.float64]

END, STEP = 0.2, 1e-3
PATH = SmoothRamp(times=(0.0, 0.2), values=(2.0, 2.6))
ON_PADS = Ramp(times=(0.0, 0.2), values=(2.0, 2.2))
LOADS: tuple[SignalBase, ...] = (
    Chirp(amplitude=50.0, times=(0.0, 0.2), frequencies=(2.0, 20.0), phase=1.0),
    Sine(amplitude=30.0, frequency=4.0, phase=0.3),
)
WEIGHT_AND_LIFT: tuple[SignalBase, ...] = (
    Ramp(times=(0.0, 0.02, 0.2), values=(0.0, 9.81, 9.81)),
    Sine(amplitude=2e3, frequency=10.0),
)
KINDS = ("flexible", "rigid", "coupled", "pushing")


def provided(model: ReducedModel, path: SignalBase, loads: tuple[SignalBase, ...]) -> ReducedModel:
    """With the scene that a run would leave in it."""
    listed = [{"name": "F", "signal": load.model_dump(mode="json")} for load in loads]
    time = {"end": END, "step": STEP, "rho_inf": 0.8}
    scene: dict[str, Any] = {"slider": {"path": path.model_dump(mode="json")}, "loads": listed, "time": time}
    return replace(model, provenance={"scene": scene})


def described(model: ReducedModel, version: str) -> Contents:
    """What an FMU of it holds."""
    return fmu_contents(System.of(model), read_scene(System.of(model), "model.npz"), "body", version)


def model_of(kind: str) -> ReducedModel:
    rich = rich_body()
    if kind == "pushing":
        return provided(flexible_on_pads(beam_on_pads(1e-4), 6), ON_PADS, WEIGHT_AND_LIFT)
    if kind == "rigid":
        return provided(project(rich, np.eye(rich.size)[:, 2:]), PATH, LOADS)
    model = provided(flexible(rich, 6), PATH, LOADS)
    if kind == "coupled":
        couples = np.diag(np.arange(1.0, 7.0)) + 0.5
        model = replace(model, D=model.M @ couples @ model.M, rayleigh=None, pads=np.array([2e-6, 3e-6]))
    return model


@dataclass(frozen=True)
class Made:
    model: ReducedModel
    library: Library

    @property
    def excitation(self) -> Excitation:
        """In straight lines from step to step, as inputs with first rates alone go on."""
        pushing = self.model.clearance is not None
        path, loads = (ON_PADS, WEIGHT_AND_LIFT) if pushing else (PATH, LOADS)
        stepping = TimeStepping(END, STEP, 0.8)
        t = stepping.times
        on, *given = (Ramp(times=t.tolist(), values=one.value(t).tolist()) for one in (path, *loads))
        return Excitation({SLIDER: on}, dict(zip(self.model.input_names, given, strict=True)), stepping)

    def names(self) -> tuple[list[str], list[str]]:
        """Inputs and their rates, s first."""
        inputs = self.library.named("input")
        return [name for name in inputs if "_rate" not in name], [n for n in inputs if n.endswith("_rate")]

    def observed(self) -> tuple[list[str], list[str], list[str]]:
        """Displacements, their rates, forces of rows."""
        outputs = [name for name in self.library.named("output") if not name.startswith("reaction")]
        rates = [name for name in outputs if name.endswith("_rate")]
        forces = [name for name in outputs if name.startswith("force_of")]
        return [name for name in outputs if name not in {*rates, *forces}], rates, forces

    def states(self) -> list[str]:
        return [name for name in self.library.named("local") if name.startswith("mode_")]


MADE = [("flexible", "2"), *(pytest.param((kind, "3"), marks=pytest.mark.slow) for kind in KINDS)]


@pytest.fixture(scope="module", params=MADE, ids=lambda p: "-".join(p))
def made(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Made:
    kind, version = request.param
    model = model_of(kind)
    return Made(model, library(model, tmp_path_factory.mktemp(kind), version))


def co_simulated(made: Made, instance: Instance) -> tuple[Array, Array]:
    """Displacements and forces at every step, which is an internal one too; inputs lead to the next."""
    excitation, (values, rates), (moved, _, forces) = made.excitation, made.names(), made.observed()
    given = np.hstack([excitation.s, excitation.forces(made.model.input_names)])
    instance.set(["internal_step"], [STEP])
    instance.initialise(values, given[0])
    found = [instance.get(moved + forces)]
    for k in range(len(given) - 1):
        instance.set(values + rates, np.concatenate([given[k], (given[k + 1] - given[k]) / STEP]))
        instance.step(k * STEP, STEP)
        found.append(instance.get(moved + forces))
    both = np.array(found)
    return both[:, : len(moved)], both[:, len(moved) :]


@pytest.mark.slow
def test_co_simulation_is_march(made: Made) -> None:
    """The same equations and steps, in another order of operations: what differs is round-off, which decays."""
    found, forces = co_simulated(made, Instance(made.library))
    expected = one_body.simulate(made.model, made.excitation)
    f = made.excitation.forces(made.model.input_names)
    y = displacement(made.model, expected.q, expected.s, expected.multipliers, f)
    assert np.abs(y).max() > 1e-6 and np.abs(expected.multipliers).max() > 1.0
    np.testing.assert_allclose(found, y, rtol=0.0, atol=1e-9 * np.abs(y).max())
    np.testing.assert_allclose(forces, expected.multipliers, rtol=0.0, atol=1e-7 * np.abs(expected.multipliers).max())
    if made.model.clearance is not None:
        open_now = expected.multipliers[:, made.model.row_clearance >= 0.0] == 0.0
        assert 0.05 < open_now.mean() < 0.95


def test_from_step_to_step_its_inputs_have_the_signals_values_and_rates(made: Made) -> None:
    """Led on by the rates that it carries it is the run, whose parts of steps follow the signals."""
    scene, (values, _), (moved, _, forces) = read_scene(System.of(made.model), "model"), made.names(), made.observed()
    given = made.library.named("input")
    carried = reference(Drivers.of(System.of(made.model)), scene)
    instance, found, shown = Instance(made.library), [], np.round(carried.t / STEP).astype(int)
    instance.initialise(values, carried.inputs[0, 1 : 1 + len(values)])
    for k in range(shown[-1] + 1):
        if k in shown:
            found.append(instance.get(moved + forces))
        instance.set(given, carried.inputs[k, 1:])
        instance.step(k * STEP, STEP)
    largest = (np.abs(some).max() for some in np.split(carried.outputs, [len(moved)], axis=1))
    size = np.repeat([*largest], [len(moved), len(forces)])
    assert np.all(np.abs(np.array(found) - carried.outputs) <= 1e-9 * size)
    run = one_body.simulate(made.model, scene.excitation)
    f = scene.excitation.forces(made.model.input_names)
    y = np.hstack([displacement(made.model, run.q, run.s, run.multipliers, f), run.multipliers])[shown]
    assert np.all(np.abs(np.array(found) - y) <= 1e-7 * size)


def test_it_starts_with_the_loads_of_the_scene_and_its_whole_weight() -> None:
    model = model_of("flexible")
    scene = model.provenance["scene"]
    scene |= {"loads": scene["loads"][:1], "gravity": {"rise": 1.0}}
    root = ET.fromstring(described(model, "3").texts["modelDescription.xml"])
    start = {v.attrib["name"]: float(v.attrib["start"]) for v in root.iter("Float64") if v.get("causality") == "input"}
    assert list(start.values()) == [2.0, float(LOADS[0].value(0.0)), 9.80665, *(0.0,) * 9]


def test_the_path_has_ends_and_may_lie_a_little_beyond(made: Made) -> None:
    low, high = made.model.domain
    for version, tag in (("2", "Real"), ("3", "Float64")):
        root = ET.fromstring(described(made.model, version).texts["modelDescription.xml"])
        elements = [(v.get("name"), v if version == "3" else v.find(tag)) for v in root.iter() if v.get("name") == "s"]
        ((_, path),) = [(name, e) for name, e in elements if e is not None and e.get("unit") == "m"]
        assert (float(path.attrib["min"]), float(path.attrib["max"])) == (low, high)
    values, moved = made.names()[0], made.observed()[0]
    loads = np.full(len(values) - 1, 30.0)
    at_the_end, beyond, outside = (Instance(made.library) for _ in range(3))
    found = []
    for instance, share in ((at_the_end, 0.0), (beyond, 0.9)):
        instance.initialise(values, [high - share * BEYOND_ENDS * (low - high), *loads])
        instance.step(0.0, STEP)
        found.append(instance.get(moved))
    np.testing.assert_array_equal(*found)
    with pytest.raises(CallError, match="lies off the path"):
        outside.initialise(values, [high + 1.1 * BEYOND_ENDS * (high - low), *loads])


HOSTILE = (
    *("a\x1b[31m", "\0", "\ud800", "<&>'\"", "]]>", "\uffff", "\n", "-", "1", ""),
    *("start", "s", "rate of x", "internal_step"),
)


@pytest.mark.parametrize("version", ["2", "3"])
def test_any_name_leaves_a_description_that_can_be_read(version: str) -> None:
    model = model_of("flexible")
    o, pairs = len(model.outputs), zip(HOSTILE, reversed(HOSTILE), strict=True)
    for pair in pairs:
        named = replace(
            model,
            input_names=pair,
            row_names=tuple(f"{pair[0]}{k}" for k in range(len(model.row_names))),
            output_names=(*pair, *(f"{pair[1]}{k}" for k in range(o - 2))),
        )
        named.provenance["scene"]["title"] = pair[0]
        texts = described(named, version).texts
        root = ET.fromstring(texts["modelDescription.xml"].encode())
        listed = list(root.find("ModelVariables"))
        names = [v.attrib["name"] for v in listed]
        assert len(set(names)) == len(names) and all(re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) for name in names)
        choices = [v for v in listed if v.tag == "Enumeration" or v.find("Enumeration") is not None]
        assert [v.attrib["name"] for v in choices] == ["start"]
        for text in (t for name, t in texts.items() if name.endswith(".csv")):
            head, *rows = text.splitlines()
            assert head.count(",") == rows[0].count(",") == rows[-1].count(",")


def test_co_simulation_is_the_stepper_bit_for_bit(made: Made) -> None:
    """One compiled step in both, under inputs that are set for the end of each step."""
    if made.model.clearance is not None:
        return  # whose steps are whole ones there
    instance, values, (moved, _, forces) = Instance(made.library), made.names()[0], made.observed()
    excitation, f = made.excitation, made.excitation.forces(made.model.input_names)
    s, found, expected = excitation.s[:, 0], [], []
    stepper = Stepper(made.model, STEP, s[0], f[0], 0.8)
    instance.initialise(values, [s[0], *f[0]])
    for k in range(1, len(s)):
        instance.set(values, [s[k], *f[k]])
        instance.step((k - 1) * STEP, STEP)
        found.append(instance.get([*moved, *forces]))
        stepper.step(s[k], f[k])
        expected.append(stepper.outputs)
    assert np.abs(expected).max() > 1e-6
    np.testing.assert_array_equal(found, expected)


def test_a_long_communication_step_is_made_of_internal_ones(made: Made) -> None:
    """Linear inputs over five steps: those of five steps of one millisecond."""
    values, rates = made.names()
    moved = made.observed()[0]
    slope = np.array([0.5, *(100.0,) * (len(values) - 1)])
    start = np.array([2.0, *(0.0,) * (len(values) - 1)])
    once, often = Instance(made.library), Instance(made.library)
    for instance in (once, often):
        instance.initialise(values, start)
        instance.set(rates, slope)
    once.step(0.0, 5 * STEP)
    for k in range(5):
        often.step(k * STEP, STEP)
    found, expected = once.get(moved), often.get(moved)
    assert np.abs(expected).max() > 1e-9
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_allclose(once.get(values), start + 5 * STEP * slope, rtol=1e-14, atol=1e-14)


def test_a_state_returns_bit_for_bit(made: Made) -> None:
    values, rates = made.names()
    seen = [*sum(made.observed(), []), *values]

    def run(instance: Instance) -> Array:
        for k in range(10, 20):
            instance.set(values[1:], [1e3 * np.sin(k)] * (len(values) - 1))
            instance.step(k * STEP, STEP)
        return instance.get(seen)

    instance = Instance(made.library)
    instance.initialise(values, [2.0, *(0.0,) * (len(values) - 1)])
    instance.set(rates, [0.3, *(50.0,) * (len(values) - 1)])
    for k in range(10):
        instance.step(k * STEP, STEP)
    state, before = instance.saved(), instance.get(seen)
    content = instance.serialised(state)
    after = run(instance)
    instance.restore(state)
    np.testing.assert_array_equal(instance.get(seen), before)
    np.testing.assert_array_equal(run(instance), after)
    other = Instance(made.library)
    other.restore(other.deserialised(content))
    np.testing.assert_array_equal(run(other), after)
    with pytest.raises(CallError, match="no state of this model"):
        other.deserialised(b"x" + content[1:])


def test_model_exchange_has_the_equations_of_motion(made: Made) -> None:
    """Rows as springs, K + C^T F^-1 C; of those that push, where they are pressed on."""
    if made.model.flexibility is None:
        with pytest.raises(CallError, match="leave no differential equation"):
            Instance(made.library, model_exchange=True)
        return
    body, values = modal_form(made.model).body, made.names()[0]
    if made.model.clearance is not None:
        return  # covered by Co-Simulation and by derivatives along a direction
    rng = np.random.default_rng(5)
    r, f, s = body.size, rng.normal(size=len(values) - 1), 2.3
    z, v = rng.normal(size=(2, r))
    instance = Instance(made.library, model_exchange=True)
    instance.initialise(values, [s, *f])
    instance.set_states(np.concatenate([z, v]))
    system = CompliantRows(body).system(np.array([s]))[0]
    expected = system[:, r:] @ f - system[:, :r] @ z - body.D @ v
    found = instance.derivatives(2 * r)
    np.testing.assert_allclose(found[:r], v, rtol=1e-15)
    np.testing.assert_allclose(found[r:], expected, rtol=0.0, atol=1e-10 * np.abs(expected).max())


def test_derivatives_along_each_direction(made: Made) -> None:
    """Against central differences, (h^2 / 6) y''' off and by the round-off of y over h."""
    if made.model.flexibility is None:
        return
    (values, rates), observed = made.names(), made.observed()
    unknowns = [*sum(observed, []), *(name for name in made.library.named("local") if name.startswith("der_"))]
    rng = np.random.default_rng(3)
    instance = Instance(made.library, model_exchange=True)
    inputs = np.concatenate([[2.3], 100.0 * rng.normal(size=len(values) - 1)])
    instance.initialise(values, inputs)
    states = 1e-3 * rng.normal(size=2 * modal_form(made.model).body.size)
    moving = np.concatenate([[0.4], 300.0 * rng.normal(size=len(rates) - 1)])
    given, at = [*values, *rates], np.concatenate([inputs, moving])

    def seen(at: Array, states: Array) -> Array:
        instance.set(given, at)
        instance.set_states(states)
        return instance.get(unknowns)

    for k, known in enumerate([*given, *made.states()]):
        of_inputs, of_states = np.zeros(len(at)), np.zeros(len(states))
        h = 1e-6 if k >= len(at) else 1e-5 if known == "s" else 1e-3
        (of_inputs if k < len(at) else of_states)[k if k < len(at) else k - len(at)] = h
        expected = (seen(at + of_inputs, states + of_states) - seen(at - of_inputs, states - of_states)) / (2.0 * h)
        seen(at, states)
        found = instance.directional(unknowns, known)
        atol = 1e-7 * np.abs(expected).max() + 1e-14 * np.abs(instance.get(unknowns)) / h
        assert np.all(np.abs(found - expected) <= 2e-6 * np.abs(expected) + atol), known


def test_a_static_start_is_in_equilibrium(made: Made) -> None:
    values, _ = made.names()
    moved = made.observed()[0]
    loads = [9.81, 0.0] if made.model.clearance is not None else [40.0, -20.0]
    instance = Instance(made.library)
    instance.choose_start(1)
    instance.initialise(values, [2.25, *loads])
    rest = [name for name in made.library.named("local") if name.startswith("der_")]
    K = modal_form(made.model).body.K
    size = np.abs(instance.get(made.states()[: len(K)]) @ K).max()
    assert size > 1.0
    np.testing.assert_allclose(instance.get(rest), 0.0, atol=1e-9 * size)
    before = instance.get(moved)
    for k in range(20):
        instance.step(k * STEP, STEP)
    np.testing.assert_allclose(instance.get(moved), before, rtol=0.0, atol=1e-9 * np.abs(before).max())


def test_a_scene_that_starts_in_equilibrium_is_an_fmu_that_does() -> None:
    """Under the inputs of its reference it has the reference's outputs."""
    model = model_of("flexible")
    model.provenance["scene"]["start"] = "equilibrium"
    found = described(model, "3")
    root = ET.fromstring(found.texts["modelDescription.xml"])
    (start,) = [v.attrib["start"] for v in root.iter("Enumeration")]
    assert start == "1"
    first = np.loadtxt(found.texts["resources/reference_out.csv"].splitlines(), delimiter=",", skiprows=1)[0, 1:]
    system, scene = System.of(model), read_scene(System.of(model), "model")
    assembly = Assembly(system)
    f, x = scene.first_loads, system.side_coordinates({SLIDER: scene.excitation.s[0, 0]})
    state = equilibrium(assembly, x, f)
    y = assembly.outputs @ state.q + assembly.direct @ f
    y -= assembly.contact_rows(x).X @ state.forces
    assert np.abs(y).max() > 1e-6
    np.testing.assert_allclose(first[: len(y)], y, rtol=0.0, atol=1e-9 * np.abs(y).max())
    np.testing.assert_allclose(first[len(y) :], state.forces, rtol=0.0, atol=1e-9 * np.abs(state.forces).max())


def test_a_start_as_given_goes_on_where_another_instance_is(made: Made) -> None:
    """From its states, path and loads: the same outputs at once; then apart by what a step's own history is, O(h^2)."""
    (values, rates), (moved, velocities, _), states = made.names(), made.observed(), made.states()
    first = Instance(made.library)
    first.initialise(values, [2.0, *(0.0,) * (len(values) - 1)])
    first.set(rates, [0.3, *(500.0,) * (len(rates) - 1)])
    for k in range(20):
        first.step(k * STEP, STEP)
    reached, inputs = first.get(states), first.get([*values, *rates])
    assert np.abs(reached).max() > 1e-9
    second = Instance(made.library)
    second.set(states, reached)
    second.choose_start(2)
    second.initialise([*values, *rates], inputs)
    np.testing.assert_array_equal(second.get(states), reached)
    for names in (moved, velocities):
        expected = first.get(names)
        np.testing.assert_allclose(second.get(names), expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())
    for instance in (first, second):
        instance.set(rates, first.get(rates))
        for k in range(20, 25):
            instance.step(k * STEP, STEP)
    expected = first.get(moved)
    np.testing.assert_allclose(second.get(moved), expected, rtol=0.0, atol=1e-2 * np.abs(expected).max())
    with pytest.raises(CallError, match="fixed once the start is made"):
        second.set(states, reached)
    forgotten = Instance(made.library)
    forgotten.set(states, reached)
    with pytest.raises(CallError, match="modes were set, which start = 2 alone takes"):
        forgotten.initialise(values, first.get(values))
    if made.model.flexibility is None:
        r = len(reached) // 2
        still = np.append(reached[:r], np.zeros(r))  # while the rows travel
        for wrong, said in (
            (1.0 + reached, "the states move a rigid row"),
            (reached + np.append(np.zeros(r), np.ones(r)), "the states' rates move a rigid row"),
            (still, "do not follow it along the path"),
        ):
            third = Instance(made.library)
            third.set(states, wrong)
            third.choose_start(2)
            with pytest.raises(CallError, match=said):
                third.initialise([*values, *rates], inputs)


def test_rates_are_those_of_the_outputs(made: Made) -> None:
    """Of a smooth motion, against central differences: on smooth loads these converge with the square of the step."""
    if made.model.clearance is not None or made.model.flexibility is None:
        return
    (values, rates), (moved, velocities, _) = made.names(), made.observed()
    instance = Instance(made.library)
    instance.initialise(values, [2.0, 0.0, 0.0])
    instance.set(rates, [0.5, 100.0, -50.0])
    h, found, rate = 1e-5, [], []
    for k in range(40):
        instance.step(k * h, h)
        found.append(instance.get(moved))
        rate.append(instance.get(velocities))
    y, v = np.array(found), np.array(rate)
    expected = (y[2:] - y[:-2]) / (2.0 * h)
    np.testing.assert_allclose(v[1:-1][5:], expected[5:], rtol=0.0, atol=2e-3 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [("s", 7.0, "s = 7 m lies off the path"), ("internal_step", 0.0, "internal_step"), ("rho_inf", 1.1, "rho_inf")],
)
def test_what_cannot_be_is_refused_with_its_reason(made: Made, name: str, value: float, said: str) -> None:
    instance = Instance(made.library)
    with pytest.raises(CallError, match=said):
        instance.initialise([name], [value])


def test_calls_out_of_order_are_refused(made: Made) -> None:
    instance = Instance(made.library)
    with pytest.raises(CallError, match="after the initialisation"):
        instance.step(0.0, STEP)
    instance.initialise()
    with pytest.raises(CallError, match="parameters and states are fixed"):
        instance.set(["internal_step"], [1e-4])
    with pytest.raises(CallError, match="read only"):
        instance.set(made.observed()[0][:1], [1.0])
    with pytest.raises(CallError, match="another model"):
        Instance(made.library, token="{0}")


def test_the_same_model_makes_the_same_source(tmp_path: Path) -> None:
    model = model_of("flexible")
    model.save(tmp_path / "a.npz")
    once, again = (described(one, "2").texts for one in (model, ReducedModel.load(tmp_path / "a.npz")))
    assert once == again


def test_what_probes_measure_has_its_unit() -> None:
    model = model_of("flexible")
    units = [*("m",) * (len(model.outputs) - 4), "Pa", "1", "mm", "furlong"]
    measured = replace(model, output_units=tuple(units), output_names=tuple(f"p{k}" for k in range(len(units))))
    for version, tag in (("2", "Real"), ("3", "Float64")):
        root = ET.fromstring(described(measured, version).texts["modelDescription.xml"])
        defined = {unit.attrib["name"]: unit for unit in root.iter("Unit")}
        found = {v.attrib["unit"] for v in root.iter(tag) if "unit" in v.attrib}
        assert {"Pa", "Pa/s", "1", "1/s", "mm", "mm/s", "furlong", "furlong/s"} <= found == set(defined)
        assert [base.attrib for base in defined["mm"]] == [{"m": "1", "factor": "0.001"}]
        assert [base.attrib for base in defined["Pa"]] == [{"kg": "1", "m": "-1", "s": "-2"}]


def test_a_moment_has_its_unit() -> None:
    model = model_of("flexible")
    for load, name, direction in zip(model.provenance["scene"]["loads"], model.input_names, ("ry", "z"), strict=True):
        load |= {"name": name, "direction": direction}
    texts = described(model, "3").texts
    root = ET.fromstring(texts["modelDescription.xml"])
    units = [v.attrib["unit"] for v in root.iter("Float64") if v.attrib["causality"] == "input"]
    assert units == [
        *("m", "N m", "N"), *("m/s", "N m/s", "N/s"), *("m/s2", "N m/s2", "N/s2"), *("m/s3", "N m/s3", "N/s3")
    ]  # fmt: skip
    assert set(units) <= {unit.attrib["name"] for unit in root.iter("Unit")}
