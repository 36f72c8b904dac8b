"""FMUs of booms of several sections, compiled here and called through their interface, against `march` and NumPy."""

from __future__ import annotations

import ctypes
import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace
from pathlib import Path

import nested
import numpy as np
import pytest
from export.fmi.libraries import CallError, Instance, Library, loaded
from numpy.typing import NDArray

from pmr.errors import BEYOND_ENDS, InputError
from pmr.export.fmi.fmu import fmu_contents
from pmr.export.fmi.reference import reference
from pmr.export.fmi.variables import Drivers
from pmr.pipeline import reduce
from pmr.reduction.bodies import Reduction
from pmr.scene import Scene, load_any
from pmr.scene.signals import Ramp
from pmr.simulation.excitation import Excitation, side_positions
from pmr.simulation.modal import modal_form
from pmr.simulation.moving import StoredScene, read_scene, store_boom_scene
from pmr.simulation.native import systems
from pmr.simulation.statics.equilibrium import equilibrium
from pmr.simulation.stepping import TimeStepping
from pmr.system.assembly import Assembly
from pmr.system.contacts import Place
from pmr.system.states import SystemTrajectory
from pmr.system.system import System

Array = NDArray[np.float64]
WORKFLOWS = Path(__file__).parents[3] / "workflows"
STEP = 1e-3
QUICK = (
    "section.mesh.elements=16",
    "section.joint.extension={kind='smooth_ramp',times=[0.0,0.3],values=[0.6,1.6]}",
    "sections.fly.loads.0.signal={kind='sine',amplitude=2e3,frequency=6.0}",
    "time.end=0.3",
    f"time.step={STEP}",
    "time.rho_inf=0.8",
)
BOTH_WAYS = tuple(f"section.joint.{ring}.0.unilateral=false" for ring in ("tail", "mouth"))
GIVES_WAY = "section.joint.cylinder.stiffness=1e7"
#: Scene, its changes and the version of the interface.
KINDS = {
    "two": ("boom_two", BOTH_WAYS, "2"),
    "three": ("boom_three", BOTH_WAYS, "3"),
    "three, elastic": ("boom_three", (*BOTH_WAYS, GIVES_WAY), "3"),
    "three, pushing": ("boom_three", ("sections.fly.loads.0.signal.amplitude=2e4",), "2"),
}


@dataclass(frozen=True)
class Made:
    boom: Scene
    system: System
    library: Library

    @property
    def excitation(self) -> Excitation:
        """As its scene has it, in straight lines from step to step, as inputs with first rates alone go on."""
        found, stepping = (
            store_boom_scene(self.boom, self.system).excitation,
            TimeStepping(self.boom.time.end, STEP, 0.8),
        )
        t = stepping.times
        paths, loads = (
            {name: Ramp(times=t.tolist(), values=one.value(t).tolist()) for name, one in signals.items()}
            for signals in (found.paths, found.loads)
        )
        return Excitation(paths, loads, stepping)

    def inputs(self) -> tuple[list[str], list[str]]:
        """Paths and loads, and their rates."""
        names = self.library.named("input")
        return [name for name in names if "_rate" not in name], [n for n in names if n.endswith("_rate")]

    def observed(self) -> tuple[list[str], list[str], list[str]]:
        """Displacements, their rates, forces of contacts."""
        outputs = [name for name in self.library.named("output") if not name.startswith("reaction")]
        rates, forces = ([n for n in outputs if re.search(what, n)] for what in ("_rate$", "^force_of"))
        return [name for name in outputs if name not in {*rates, *forces}], rates, forces

    def states(self) -> list[str]:
        return [name for name in self.library.named("local") if "mode_" in name and not name.startswith("der_")]


def reduced(scene: str, *changes: str) -> Reduction:
    found = reduce(load_any(WORKFLOWS / f"{scene}.toml", (*QUICK, *changes)))
    assert isinstance(found, Reduction)
    return found


@pytest.fixture(scope="module", params=["two", *(pytest.param(kind, marks=pytest.mark.slow) for kind in [*KINDS][1:])])
def made(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Made:
    scene, changes, version = KINDS[request.param]
    found = reduced(scene, *changes)
    system = System.load(found.system.save(tmp_path_factory.mktemp("system") / "system.npz"))
    texts = fmu_contents(system, read_scene(system, "system.npz"), "boom", version)
    return Made(found.scene, system, loaded(texts, tmp_path_factory.mktemp("fmu"), version))


def outputs_of(system: System, found: SystemTrajectory) -> Array:
    return np.hstack(list(systems.displacements(system, found).values()))


def co_simulated(made: Made, instance: Instance, every: float = STEP) -> tuple[Array, Array]:
    """Displacements and forces at all steps, one communication every so many seconds."""
    t = np.linspace(0.0, made.boom.time.end, round(made.boom.time.end / every) + 1)
    excitation = made.excitation
    columns = [*excitation.paths.values(), *excitation.loads.values()]
    (values, rates), (moved, _, forces) = made.inputs(), made.observed()
    given = np.column_stack([one.value(t) for one in columns])
    instance.set(["internal_step"], [every])
    instance.initialise(values, given[0])
    found = [instance.get(moved + forces)]
    for k in range(len(t) - 1):
        instance.set(values + rates, np.concatenate([given[k], (given[k + 1] - given[k]) / every]))
        instance.step(t[k], every)
        found.append(instance.get(moved + forces))
    both = np.array(found)
    return both[:, : len(moved)], both[:, len(moved) :]


def test_co_simulation_is_march(made: Made) -> None:
    """From equilibrium, the same equations and steps in another order of operations."""
    system, excitation = made.system, made.excitation
    expected = systems.simulate(system, excitation, systems.static_start(system, excitation))
    y, scale = outputs_of(system, expected), np.abs(expected.forces).max()
    found, forces = co_simulated(made, Instance(made.library))
    assert np.abs(y - y[0]).max() > 1e-3 and scale > 1e3
    np.testing.assert_allclose(found, y, rtol=0.0, atol=1e-9 * np.abs(y).max())
    np.testing.assert_allclose(forces, expected.forces, rtol=0.0, atol=1e-6 * scale)
    if not np.isnan(system.clearance).all():
        pushes = ~np.isnan(system.clearance)
        assert 0.05 < np.mean(expected.forces[:, pushes] == 0.0) < 0.95
        assert np.any(np.diff(expected.forces[:, pushes] == 0.0, axis=0))  # pads open and close on the way


def test_with_rates_of_its_signals_a_boom_on_pads_that_push_is_the_run(made: Made) -> None:
    """Steps in as many parts as the run makes, and what it finds in them; a kink within a step is all that is left."""
    if np.isnan(made.system.clearance).all():
        return
    scene = read_scene(made.system, "system")
    carried = reference(Drivers.of(made.system), scene)
    run = systems.simulate(made.system, scene.excitation, systems.static_start(made.system, scene.excitation))
    assert 1.0 < run.parts[1:].mean() < 32.0
    instance, given, found = Instance(made.library), made.library.named("input"), []
    moved, _, forces = made.observed()
    instance.initialise(given, carried.inputs[0, 1:])
    for k in range(len(carried.inputs)):
        found.append(instance.get(moved + forces))
        instance.set(given, carried.inputs[k, 1:])
        instance.step(k * STEP, STEP)
    y, pads = outputs_of(made.system, run), ~np.isnan(made.system.clearance)
    both, size = np.array(found), np.abs(run.forces).max()
    np.testing.assert_allclose(both[:, : len(moved)], y, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(both[:, len(moved) :][:, pads], run.forces[:, pads], rtol=0.0, atol=1e-6 * size)


def test_it_starts_in_equilibrium_unless_told_to_be_at_rest(made: Made) -> None:
    system, (moved, _, forces) = made.system, made.observed()
    scene, assembly = store_boom_scene(made.boom, system), Assembly(system)
    x = side_positions(system, made.excitation)[0]
    expected = equilibrium(assembly, x, scene.first_loads)
    rows = assembly.contact_rows(x)
    y = assembly.outputs @ expected.q + assembly.direct @ scene.first_loads - rows.X @ expected.forces
    instance, at_rest = Instance(made.library), Instance(made.library)
    instance.initialise()
    np.testing.assert_allclose(instance.get(moved), y, rtol=0.0, atol=1e-9 * np.abs(y).max())
    compliant = ~made.system.compliance.rigid
    found, scale = instance.get(forces), np.abs(expected.forces).max()
    np.testing.assert_allclose(found[compliant], expected.forces[compliant], rtol=0.0, atol=1e-6 * scale)
    at_rest.choose_start(0)
    at_rest.initialise()
    assert not at_rest.get(made.states()).any()
    assert at_rest.get(made.inputs()[0]).tolist() == pytest.approx([0.6] * len(system.paths) + [*scene.first_loads])


@pytest.mark.parametrize("noise", [0.0, 1e-25])
def test_a_contact_that_gives_way_by_round_off_leaves_no_differential_equation(noise: float) -> None:
    assert not Drivers.of(nested.with_round_off(noise)).is_differential
    assert Drivers.of(nested.reduced(nested.Nested(2, elements=8, compliance=0.0), 3)).is_differential


def test_model_exchange_has_the_equations_of_motion(made: Made) -> None:
    """Contacts as springs, K + C^T F^-1 C, at places where a section slides on two others."""
    if not Drivers.of(made.system).is_differential:
        with pytest.raises(CallError, match="leave no differential equation"):
            Instance(made.library, model_exchange=True)
        return
    rng, system, assembly = np.random.default_rng(5), made.system, Assembly(made.system)
    forms = [modal_form(body) for body in system.reduced.values()]
    z, v = (1e-3 * rng.normal(size=assembly.size) for _ in range(2))
    s, f = {"middle": 1.3, "fly": 0.9}, 100.0 * rng.normal(size=len(system.input_names))
    ends = np.cumsum([form.body.size for form in forms])[:-1]
    q, rate = (np.concatenate([form.X @ a for form, a in zip(forms, np.split(b, ends), strict=True)]) for b in (z, v))
    rows = assembly.contact_rows(system.side_coordinates(s))
    forces = np.linalg.solve(rows.F, rows.C @ q + rows.H @ f)
    right = assembly.B @ f - assembly.D @ rate - assembly.K @ q - rows.C.T @ forces
    expected = np.concatenate([form.X.T @ a for form, a in zip(forms, np.split(right, ends), strict=True)])
    instance = Instance(made.library, model_exchange=True)
    instance.choose_start(0)
    instance.initialise(made.inputs()[0], [*(s[path] for path in system.paths), *f])
    instance.set_states(np.concatenate([z, v]))
    found = instance.derivatives(2 * len(z))
    np.testing.assert_allclose(found[: len(z)], v, rtol=1e-15)
    np.testing.assert_allclose(found[len(z) :], expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())
    (moved, _, of_contacts), size = made.observed(), np.abs(forces).max()
    np.testing.assert_allclose(instance.get(of_contacts), forces, rtol=0.0, atol=1e-9 * size)
    y = assembly.outputs @ q + assembly.direct @ f - rows.X @ forces
    np.testing.assert_allclose(instance.get(moved), y, rtol=0.0, atol=1e-9 * np.abs(y).max())


def test_derivatives_along_each_direction(made: Made) -> None:
    """Against central differences, (h^2 / 6) y''' and the round-off of y over h off; between breaks."""
    if not Drivers.of(made.system).is_differential:
        return
    (values, rates), observed = made.inputs(), made.observed()
    of_states = [name for name in made.library.named("local") if name.startswith("der_")]
    unknowns, counts = [*sum(observed, []), *of_states], [*map(len, observed), *[len(of_states) // 2] * 2]
    ends = np.cumsum(counts)[:-1]
    rng, paths = np.random.default_rng(3), len(made.system.paths)
    instance = Instance(made.library, model_exchange=True)
    inputs = np.concatenate([[1.3117, 0.9371], 100.0 * rng.normal(size=len(values) - paths)])
    moving = np.concatenate([[0.4, -0.3], 300.0 * rng.normal(size=len(rates) - paths)])
    instance.choose_start(0)
    instance.initialise(values, inputs)
    states = 1e-3 * rng.normal(size=len(made.states()))
    given, at = [*values, *rates], np.concatenate([inputs, moving])

    def seen(at: Array, states: Array) -> Array:
        instance.set(given, at)
        instance.set_states(states)
        return instance.get(unknowns)

    for k, known in enumerate([*given, *made.states()]):
        of_inputs, of_modes = np.zeros(len(at)), np.zeros(len(states))
        h = 1e-6 if k >= len(at) else 1e-5 if k < paths else 1e-3
        (of_inputs if k < len(at) else of_modes)[k if k < len(at) else k - len(at)] = h
        expected = (seen(at + of_inputs, states + of_modes) - seen(at - of_inputs, states - of_modes)) / (2.0 * h)
        seen(at, states)
        found = instance.directional(unknowns, known)
        slopes, sizes = (
            np.array([np.abs(one).max() for one in np.split(y, ends)]) for y in (expected, instance.get(unknowns))
        )
        atol = np.repeat(1e-7 * slopes + 1e-13 * sizes / h, counts)  # terms of the largest cancel in all
        assert np.all(np.abs(found - expected) <= 2e-6 * np.abs(expected) + atol), known


def test_a_state_returns_bit_for_bit(made: Made) -> None:
    values, rates = made.inputs()
    seen = [*sum(made.observed(), []), *values]
    instance, paths = Instance(made.library), len(made.system.paths)
    instance.initialise()
    instance.set(rates, [0.3, 0.05][:paths] + [50.0] * (len(rates) - paths))

    def run(instance: Instance, first: int) -> Array:
        for k in range(first, first + 5):
            instance.step(k * STEP, STEP)
        return instance.get(seen)

    before = run(instance, 0)
    state = instance.saved()
    content, after = instance.serialised(state), run(instance, 5)
    instance.restore(state)
    np.testing.assert_array_equal(instance.get(seen), before)
    np.testing.assert_array_equal(run(instance, 5), after)
    other = Instance(made.library)
    other.restore(other.deserialised(content))
    np.testing.assert_array_equal(run(other, 5), after)


def test_a_damaged_state_is_refused(made: Made) -> None:
    """Bits that have turned anywhere, bytes that are missing or too many; what is whole is taken."""
    instance, rng = Instance(made.library), np.random.default_rng(5)
    instance.initialise()
    instance.step(0.0, STEP)
    content = instance.serialised(instance.saved())
    for _ in range(100):
        damaged = bytearray(content)
        for at in rng.integers(0, len(content), rng.integers(1, 9)):
            damaged[at] ^= int(rng.integers(1, 256))
        if bytes(damaged) != content:
            with pytest.raises(CallError, match="no state of this model, or a damaged one"):
                instance.deserialised(bytes(damaged))
    for size in (0, 1, 63, 64, len(content) - 1, len(content) + 1):
        with pytest.raises(CallError, match="no state of this model, or a damaged one"):
            instance.deserialised((content + b"0")[:size])
    instance.restore(instance.deserialised(content))


def test_what_is_no_number_is_refused_and_a_jump_is_told(made: Made) -> None:
    instance, (values, rates) = Instance(made.library), made.inputs()
    instance.initialise()
    before = instance.get([*values, *rates])
    for name in (*values, *rates):
        for number in (np.nan, np.inf, -np.inf):
            with pytest.raises(CallError, match="a finite number is allowed"):
                instance.set([name], [number])
    np.testing.assert_array_equal(instance.get([*values, *rates]), before)
    instance.step(0.0, STEP)
    assert instance.said == ["", *[one for one in instance.said if "finite" in one]]
    count = len(made.system.paths)
    for name, (low, high), at in zip(values, made.system.ranges.values(), instance.get(values[:count]), strict=False):
        instance.set([name], [high - 0.1 * (high - low) if at < (low + high) / 2.0 else low + 0.1 * (high - low)])
    for k in range(count + 1):  # a step tells of one of them
        instance.step((1 + k) * STEP, STEP)
        assert sum("jumps" in message for message in instance.said) == min(k + 1, count)


def test_rates_of_inputs_may_be_given_as_derivatives(made: Made) -> None:
    """As FMI 2.0 has it, beside variables of their own."""
    if made.library.version != "2":
        return
    (values, rates), moved = made.inputs(), made.observed()[0]
    slopes = np.linspace(0.2, 0.4, len(rates))
    by_name, by_order = Instance(made.library), Instance(made.library)
    for instance in (by_name, by_order):
        instance.initialise()
    by_name.set(rates, slopes)
    of = (ctypes.c_uint32 * len(values))(*(made.library.references[name] for name in values))
    orders, given = (ctypes.c_int * len(values))(*[1] * len(values)), (ctypes.c_double * len(values))(*slopes)
    by_order.call("SetRealInputDerivatives", of, ctypes.c_size_t(len(values)), orders, given)
    for instance in (by_name, by_order):
        instance.step(0.0, STEP)
    np.testing.assert_array_equal(by_name.get(moved + values), by_order.get(moved + values))


@pytest.mark.slow
def test_pads_with_a_clearance_find_where_they_lie(tmp_path: Path) -> None:
    """All of them closed would pull, and all of them open hold nothing."""
    wide = tuple(f"section.joint.{ring}.0.clearance=2e-3" for ring in ("tail", "mouth"))
    found = reduced("boom_two", *wide, "time.end=0.01")
    scene, assembly = store_boom_scene(found.scene, found.system), Assembly(found.system)
    made = Made(found.scene, found.system, loaded(fmu_contents(found.system, scene, "boom", "3"), tmp_path, "3"))
    expected = equilibrium(assembly, side_positions(found.system, made.excitation)[0], scene.first_loads)
    instance = Instance(made.library)
    instance.initialise()
    forces = instance.get(made.observed()[2])
    assert 0 < np.count_nonzero(expected.closed[:-1]) < len(forces) - 1
    np.testing.assert_allclose(forces[:-1], expected.forces[:-1], rtol=0.0, atol=1e-6 * np.abs(expected.forces).max())


def test_paths_have_ends_of_their_own(made: Made) -> None:
    ranges, values = made.system.ranges, made.inputs()[0]
    for path, (low, high) in ranges.items():
        beyond, outside = Instance(made.library), Instance(made.library)
        beyond.initialise([f"s_{path}"], [low - 0.9 * BEYOND_ENDS * (high - low)])
        assert np.isfinite(beyond.get(made.observed()[0])).all()
        said = re.escape(f"s_{path} = {high + 0.1:.9g} m lies off the path: {low:.9g} to {high:.9g} m is allowed")
        with pytest.raises(CallError, match=said):
            outside.initialise([f"s_{path}"], [high + 0.1])
    assert values[: len(ranges)] == [f"s_{path}" for path in ranges]


@pytest.fixture(scope="module")
def two() -> Reduction:
    return reduced("boom_two", *BOTH_WAYS, "time.end=0.02")


HOSTILE = ("a\x1b[31m", "\0", "\ud800", "<&>'\"", "]]>", "\n", "-", "1", "start", "s", "rate of x", "internal_step")


def renamed(system: System, scene: StoredScene, bodies: tuple[str, ...], path: str) -> tuple[System, StoredScene]:
    """With other names of its bodies, its path and its contacts."""
    names = dict(zip(system.bodies, bodies, strict=True))

    def place(at: Place) -> Place:
        return replace(at, body=names[at.body], path=path if at.path else None)

    contacts = [
        replace(one, name=f"{path}{k}", inner=place(one.inner), outer=place(one.outer) if one.outer else None)
        for k, one in enumerate(system.contacts)
    ]
    found = System({names[name]: body for name, body in system.bodies.items()}, tuple(contacts))
    loads = dict(zip(found.input_names, scene.excitation.loads.values(), strict=True))
    (signal,) = scene.excitation.paths.values()
    return found, replace(scene, excitation=Excitation({path: signal}, loads, scene.excitation.stepping))


@pytest.mark.slow
@pytest.mark.parametrize("version", ["2", "3"])
def test_any_name_leaves_a_description_that_can_be_read(two: Reduction, version: str) -> None:
    for one, other in zip(HOSTILE, reversed(HOSTILE), strict=True):
        system, scene = renamed(two.system, store_boom_scene(two.scene, two.system), (one, other), one)
        texts = fmu_contents(system, scene, "boom", version).texts
        root = ET.fromstring(texts["modelDescription.xml"].encode())
        names = [v.attrib["name"] for v in root.find("ModelVariables") or ()]
        assert len(set(names)) == len(names) > 100
        assert all(re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) for name in names)
        for text in (t for name, t in texts.items() if name.endswith(".csv")):
            head, *rows = text.splitlines()
            assert head.count(",") == rows[0].count(",") == rows[-1].count(",")


def test_inputs_of_sections_have_their_units(two: Reduction) -> None:
    texts = fmu_contents(two.system, store_boom_scene(two.scene, two.system), "boom", "3").texts
    root = ET.fromstring(texts["modelDescription.xml"])
    given = {v.attrib["name"]: v.attrib for v in root.iter("Float64") if v.attrib["causality"] == "input"}
    units = {name: has["unit"] for name, has in given.items() if "_rate" not in name}
    assert units == {
        "s_fly": "m", "base_gravity": "m/s2", "fly_tip_force": "N", "fly_gravity": "m/s2", "fly_extension": "m/s2",
    }  # fmt: skip
    assert [given[f"fly_extension_rate{order}"]["unit"] for order in ("", "_2", "_3")] == ["m/s3", "m/s4", "m/s5"]
    low, high = two.system.ranges["fly"]
    assert (float(given["s_fly"]["min"]), float(given["s_fly"]["max"])) == (low, high)


@pytest.mark.slow
def test_a_body_without_contacts_or_paths_is_a_system_too(two: Reduction, tmp_path: Path) -> None:
    """A clamped section by itself, under its weight."""
    base = two.reduced["base"].without_joints()
    system, stepping = System({"base": base}, ()), TimeStepping(0.02, STEP, 0.8)
    weight = store_boom_scene(two.scene, two.system).excitation.loads["base.gravity"]
    driven = Excitation({}, {"base.gravity": weight}, stepping, start="equilibrium")
    scene = StoredScene("base", driven, np.array([9.81]))
    instance = Instance(loaded(fmu_contents(system, scene, "base", "3"), tmp_path, "3"))
    (moved,) = [[name for name in instance.library.named("output") if name.endswith("tip_z")]]
    instance.initialise()
    assembly = Assembly(system)
    q = np.linalg.solve(assembly.K.toarray(), assembly.B.toarray() @ [9.81])
    sag = (assembly.outputs @ q + assembly.direct @ [9.81])[-1]
    assert instance.get(moved) == pytest.approx([sag], rel=1e-9)
    instance.step(0.0, 20 * STEP)
    assert instance.get(moved) == pytest.approx([sag], rel=1e-9)


def test_what_a_file_does_not_hold_is_said_in_one_line(two: Reduction) -> None:
    scene = two.system.provenance["scene"]
    file = {"kind": "table", "file": "/etc/passwd"}
    (fly,) = (part for part in scene["sections"] if part["name"] == "fly")
    others = [part for part in scene["sections"] if part["name"] != "fly"]
    for wrong, said in (
        ({}, "this one has none"),
        ({"scene": {**scene, "sections": others}}, "provenance.scene"),
        ({"scene": {**scene, "sections": [*others, {**fly, "name": "another"}]}}, "provenance.scene"),
        ({"scene": {**scene, "time": {**scene["time"], "end": 1e12}}}, "steps"),
        ({"scene": {**scene, "sections": [*others, {**fly, "joint": {**fly["joint"], "extension": file}}]}}, "numbers"),
    ):
        with pytest.raises(InputError, match=rf"system.npz: provenance.scene.*{said}|system.npz: {said}") as refused:
            read_scene(replace(two.system, provenance=wrong), "system.npz")
        assert "\n" not in str(refused.value)


def test_a_section_whose_mesh_is_in_a_file_needs_no_such_file(two: Reduction) -> None:
    scene = two.system.provenance["scene"]
    sections = [{**part, "mesh": {"file": "elsewhere.msh"}} for part in scene["sections"]]
    system = replace(two.system, provenance={"scene": {**scene, "sections": sections}})
    found, expected = (read_scene(one, "system.npz").excitation for one in (system, two.system))
    np.testing.assert_array_equal(found.s, expected.s)
    np.testing.assert_array_equal(found.f, expected.f)
