"""What holds for the FMU of any system, in either version: beside steppers, runs, NumPy and differences.

Called through the C interface, with the package's library; under the inputs of the unit's own reference.
"""

import ctypes
import re
import xml.etree.ElementTree as ET
from dataclasses import replace

import driven_frame
import numpy as np
import pytest
from export.fmi.libraries import CallError, Instance
from export.fmi.units import BODIES, KINDS, Array, Unit, unit_of
from scipy.spatial.transform import Rotation

import pmr
from pmr import InputError, Stepper
from pmr.compare.outputs import run_from_start
from pmr.errors import BEYOND_ENDS
from pmr.export.fmi.variables import Drivers, path_names
from pmr.scene.mechanism import CYLINDER
from pmr.simulation.modal import modal_form
from pmr.simulation.native import systems
from pmr.simulation.statics.equilibrium import equilibrium
from pmr.system.assembly import Assembly

QUICK = ("flexible 2", "two", "rubbing")
#: Whether a pad slips or sticks is decided by round-off where it is near to both.
BY_ROUND_OFF = ("crane, rubbing",)
MARKS = {
    kind: [*[pytest.mark.slow] * (kind not in QUICK), *[pytest.mark.numerical] * (kind in BY_ROUND_OFF)]
    for kind in KINDS
}


@pytest.fixture(scope="module", params=[pytest.param(kind, marks=MARKS[kind]) for kind in KINDS])
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def unit(kind: str, tmp_path_factory: pytest.TempPathFactory) -> Unit:
    return unit_of(kind, tmp_path_factory.mktemp("unit"))


def assert_close(found: Array, expected: Array, bound: float) -> None:
    """Assert that columns (T, n) are off by `bound` of the largest of all at most."""
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=bound * np.abs(expected).max())


def test_steps_are_those_of_the_stepper(unit: Unit) -> None:
    """Under what has become of its inputs at the end of each step, to round-off; pads let go, land and rub."""
    moved, forces, count = unit.displacements, unit.forces, len(unit.reference_in[1])
    instance, rho_inf = unit.begin(), unit.scene.excitation.stepping.rho_inf
    stepper = Stepper(
        unit.system, unit.step, **unit.arguments(instance), rho_inf=rho_inf, parts=0 if unit.pushes else 1
    )
    found, expected, friction = [instance.get(moved + forces)], [stepper.outputs], []
    for k in range(count - 1):
        unit.advance(instance, k)
        stepper.step(**unit.arguments(instance))
        found.append(instance.get(moved + forces))
        expected.append(stepper.outputs)
        friction.append(list(stepper.friction.values()))
    y, z = np.array(found), np.array(expected)
    for some, bound in ((slice(len(moved)), 1e-9), (slice(len(moved), None), 1e-6)):
        assert np.ptp(z[:, some], axis=0).max() > 1e-3 * np.abs(z[:, some]).max()
        assert_close(y[:, some], z[:, some], bound)
    if unit.pushes:
        is_open = z[:, len(moved) :][:, ~np.isnan(unit.system.clearance)] == 0.0
        assert 0.05 < is_open.mean() < 0.95 and np.any(np.diff(is_open, axis=0))
    if friction[0] and unit.drivers.frame is None:
        assert np.min(friction) < -100.0 and np.max(friction) > 100.0


def test_under_its_own_reference_it_is_the_run(unit: Unit) -> None:
    """In a frame the rates of its inputs, cubics with the run's accelerations, are O(h^3) off in a step.

    Without one the cubics have a kink of the acceleration in the first step, from which a rigid cylinder rings.
    """
    found, carried = follow_reference_of(unit)
    bound = 1e-9 if unit.drivers.frame is None else 3e-6
    run = run_from_start(unit.system, unit.scene.excitation)
    at = np.round(unit.reference_out[1][:, 0] / unit.step).astype(int)
    of_run = np.hstack([*systems.displacements(unit.system, run).values(), run.forces])[at]
    moved, pads = len(unit.displacements), np.flatnonzero(~np.isnan(unit.system.clearance))
    for some in (slice(moved), slice(moved, None)):
        assert_close(found[:, some], carried[:, some], bound)
        compared = moved + pads if unit.pushes and some.start else some
        if not unit.rubs:  # friction turns within steps, in which cubics are not the scene's signals
            assert_close(found[:, compared], of_run[:, compared], 1e-6 if unit.drivers.frame is None else 3e-6)
    if unit.pushes and not unit.rubs and len(unit.system.bodies) > 1:
        assert np.abs(found[:, :moved] - of_run[:, :moved]).max() < 1e-9
    if unit.pushes:
        assert 1.0 < run.parts[1:].mean() < 32.0


def follow_reference_of(unit: Unit) -> tuple[Array, Array]:
    """Displacements and forces (S, o) under the inputs of its reference, and those that the reference has."""
    instance, found, names = unit.begin(), [], unit.displacements + unit.forces
    for k in range(len(unit.reference_in[1])):
        found.append(instance.get(names))
        unit.advance(instance, k)
    head, table = unit.reference_out
    at = np.round(table[:, 0] / unit.step).astype(int)
    return np.array(found)[at], table[:, [1 + head.index(name) for name in names]]


def test_model_exchange_has_the_equations_of_motion(unit: Unit) -> None:
    """M q'' = B f - D q' - K q - sum c (V q' + G q) - C^T lambda, lambda of contacts as springs, in NumPy."""
    if not unit.drivers.is_differential:
        with pytest.raises(CallError, match="leave no differential equation: Co-Simulation is allowed"):
            Instance(unit.library, model_exchange=True)
        return
    if unit.pushes:
        return  # which pads are pressed on is what steps and derivatives along directions show
    rng, system, assembly = np.random.default_rng(5), unit.system, Assembly(unit.system)
    forms = [modal_form(body) for body in system.reduced.values()]
    z, v = (1e-3 * rng.normal(size=assembly.size) for _ in range(2))
    ends = np.cumsum([form.body.size for form in forms])[:-1]
    q, rate = (np.concatenate([form.X @ a for form, a in zip(forms, np.split(b, ends), strict=True)]) for b in (z, v))
    instance, (names, table) = Instance(unit.library, model_exchange=True), unit.reference_in
    instance.choose_start(0)
    instance.initialise(names, table[20, 1:])
    instance.set_states(np.concatenate([z, v]))
    now, frame = unit.arguments(instance), unit.drivers.frame
    if frame is None:
        f, c = np.array([load[0] for load in now["F"].values()]), np.zeros(0)
    else:
        given = [*now["s"].values(), *([x, 0.0, 0.0] for x in now["F"].values()), *now["frame"].values()]
        f, c = driven_frame.find(frame, np.column_stack(given))
        assert np.abs(c).max() > 0.0
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
    np.testing.assert_allclose(found[: len(z)], v, rtol=1e-15)
    assert_close(found[len(z) :], expected, 1e-9)
    assert_close(instance.get(unit.forces), forces, 1e-9)
    assert_close(instance.get(unit.displacements), assembly.outputs @ q + assembly.direct @ f - rows.X @ forces, 1e-9)


def test_derivatives_along_each_direction(unit: Unit) -> None:
    """Against central differences, (h^2 / 6) y''' and the round-off of y over h off; between breaks of the rows."""
    if not unit.drivers.is_differential:
        return
    outputs = unit.library.named("output")
    kinds = {name: (name.endswith("_rate"), name.startswith("force"), "reaction" in name) for name in outputs}
    groups = [[name for name in outputs if kinds[name] == kind] for kind in sorted(set(kinds.values()))]
    groups.append([name for name in unit.library.named("local") if name.startswith("der_")])
    unknowns, counts = [name for group in groups for name in group], [len(group) for group in groups]
    rng, given, states = np.random.default_rng(3), unit.inputs, unit.states
    instance, (names, table) = Instance(unit.library, model_exchange=True), unit.reference_in
    at, paths = table[20, 1:].copy(), len(unit.system.paths)
    if unit.drivers.frame is None:
        count = len(unit.values)
        at[paths : 2 * count] = 300.0 * rng.normal(size=2 * count - paths)
        at[count : count + paths] = [0.4, -0.3][:paths]
    at[:paths] = [1.3117, 0.9371] if paths > 1 else 2.3
    instance.choose_start(0)
    instance.initialise(given, at)
    x = 1e-3 * rng.normal(size=len(states))
    assert given == names

    def seen(at: Array, states: Array) -> Array:
        instance.set(given, at)
        instance.set_states(states)
        return instance.get(unknowns)

    for k, known in enumerate([*given, *states[:6]]):
        of_inputs, of_modes = np.zeros(len(at)), np.zeros(len(x))
        h = 1e-6 if k >= len(at) else 1e-5 if k < paths or unit.drivers.frame is not None else 1e-3
        (of_inputs if k < len(at) else of_modes)[k if k < len(at) else k - len(at)] = h
        expected = (seen(at + of_inputs, x + of_modes) - seen(at - of_inputs, x - of_modes)) / (2.0 * h)
        seen(at, x)
        found = instance.directional(unknowns, known)
        parts = np.cumsum(counts)[:-1]
        slopes, sizes = (
            np.array([np.abs(one).max() for one in np.split(y, parts)]) for y in (expected, instance.get(unknowns))
        )
        atol = np.repeat(1e-6 * slopes + 1e-12 * sizes / h, counts)  # terms of the largest cancel in all
        assert np.all(np.abs(found - expected) <= 1e-5 * np.abs(expected) + atol), known


def test_derivatives_leave_friction_as_it_is(unit: Unit) -> None:
    """Along a load against differences of outputs, while friction acts; no pad opens or closes."""
    if not unit.rubs or unit.drivers.frame is not None:
        return
    instance, load, h = unit.begin(), "fly_tip_force", 1.0
    for k in range(30):
        unit.advance(instance, k)
    at, names = instance.get([load])[0], unit.displacements + unit.forces
    seen = list[Array]()
    for value in (at + h, at - h, at):
        instance.set([load], [value])
        seen.append(instance.get(names))
    found, expected = instance.directional(names, load), (seen[0] - seen[1]) / (2.0 * h)
    for some in (slice(len(unit.displacements)), slice(len(unit.displacements), None)):
        atol = 1e-7 * np.abs(expected[some]).max() + 1e-14 * np.abs(seen[2][some]).max() / h
        np.testing.assert_allclose(found[some], expected[some], rtol=0.0, atol=atol)
    assert np.abs(expected[len(unit.displacements) :]).max() > 1e-3


def test_instances_go_their_own_ways_and_a_state_returns_bit_for_bit(unit: Unit) -> None:
    """In turn, each as alone; a saved state, also as bytes in another instance; after a reset as from the beginning."""
    seen = [*unit.library.named("output"), *unit.inputs]
    instance, other = unit.begin(), unit.begin()
    for k in range(10):
        unit.advance(instance, k)
        unit.advance(other, k + 5)
    before, elsewhere = instance.get(seen), other.get(seen)
    assert np.any(before != elsewhere)
    state = instance.saved()
    content = instance.serialised(state)

    def go_on(instance: Instance) -> Array:
        for k in range(10, 20):
            unit.advance(instance, k)
        return instance.get(seen)

    after = go_on(instance)
    instance.restore(state)
    np.testing.assert_array_equal(instance.get(seen), before)
    np.testing.assert_array_equal(go_on(instance), after)
    np.testing.assert_array_equal(other.get(seen), elsewhere)
    third = Instance(unit.library)
    third.restore(third.deserialised(content))
    np.testing.assert_array_equal(go_on(third), after)
    third.call("Reset")
    third.set(["internal_step"], [unit.step])
    third.initialise(unit.inputs, unit.reference_in[1][0, 1:])
    for k in range(10):
        unit.advance(third, k)
    np.testing.assert_array_equal(third.get(seen), before)


def test_a_damaged_state_is_refused(unit: Unit) -> None:
    """Bits that have turned anywhere, bytes that are missing or too many; what is whole is taken."""
    instance, rng = unit.begin(), np.random.default_rng(5)
    unit.advance(instance, 0)
    content = instance.serialised(instance.saved())
    damaged = [content[:size] for size in (0, 1, 63, 64, len(content) - 1)] + [content + b"0", b"x" + content[1:]]
    for _ in range(30):
        turned = bytearray(content)
        for at in rng.integers(0, len(content), rng.integers(1, 9)):
            turned[at] ^= int(rng.integers(1, 256))
        damaged.append(bytes(turned))
    for one in damaged:
        if one != content:
            with pytest.raises(CallError, match="no state of this model, or a damaged one"):
                instance.deserialised(one)
    instance.restore(instance.deserialised(content))


def test_a_static_start_is_in_equilibrium(unit: Unit) -> None:
    """Nothing moves under the same inputs; without a frame it is that of statics."""
    names, moved = unit.values, unit.displacements
    values = unit.reference_in[1][20, 1 : 1 + len(names)]
    instance, at_rest = Instance(unit.library), Instance(unit.library)
    instance.choose_start(1)
    instance.initialise(names, values)
    before, count = instance.get(moved), len(unit.drivers.paths)
    if unit.drivers.frame is None:
        assembly = Assembly(unit.system)
        x = unit.system.side_coordinates(dict(zip(unit.drivers.paths, values[:count], strict=True)))
        state = equilibrium(assembly, x, values[count:])
        rows = assembly.contact_rows(x)
        y = assembly.outputs @ state.q + assembly.direct @ values[count:] - rows.X @ state.forces
        assert_close(before, y, 1e-9)
        gives_way, size = ~unit.system.compliance.rigid, np.abs(state.forces).max()
        found = instance.get(unit.forces)[gives_way]
        np.testing.assert_allclose(found, state.forces[gives_way], rtol=0.0, atol=1e-6 * size)
    for k in range(20):
        instance.step(k * unit.step, unit.step)
    assert np.abs(before).max() > 1e-6
    assert_close(instance.get(moved), before, 1e-8)
    at_rest.choose_start(0)
    at_rest.initialise(names, values)
    assert not at_rest.get(unit.states).any()


def test_it_starts_as_its_scene_says(unit: Unit) -> None:
    """With the scene's path and loads, its weight in full, in equilibrium or at rest."""
    instance = Instance(unit.library)
    instance.initialise()
    values = instance.get(unit.values)
    count = len(unit.drivers.paths)
    assert values[:count] == pytest.approx(unit.reference_in[1][0, 1 : 1 + count])
    if unit.drivers.frame is None:
        assert values[count:] == pytest.approx(unit.scene.first_loads)
    assert instance.get(unit.states).any() == unit.scene.static


def test_a_start_as_given_goes_on_where_another_instance_is(kind: str, unit: Unit) -> None:
    """From its states, path and loads: the same outputs at once; then apart by what a step's own history is, O(h^2)."""
    if kind not in BODIES:
        return
    values, rates, moved, states = unit.values, unit.rates, unit.displacements, unit.states
    velocities = [f"{name}_rate" for name in moved]
    first = Instance(unit.library)
    first.initialise(values, [2.0, *(0.0,) * (len(values) - 1)])
    first.set(rates, [0.3, *(500.0,) * (len(rates) - 1)])
    for k in range(20):
        first.step(k * unit.step, unit.step)
    reached, inputs = first.get(states), first.get([*values, *rates])
    assert np.abs(reached).max() > 1e-9
    second = Instance(unit.library)
    second.set(states, reached)
    second.choose_start(2)
    second.initialise([*values, *rates], inputs)
    np.testing.assert_array_equal(second.get(states), reached)
    for names in (moved, velocities):
        assert_close(second.get(names), first.get(names), 1e-9)
    for instance in (first, second):
        instance.set(rates, first.get(rates))
        for k in range(20, 25):
            instance.step(k * unit.step, unit.step)
    assert_close(second.get(moved), first.get(moved), 1e-2)
    with pytest.raises(CallError, match="fixed once the start is made"):
        second.set(states, reached)
    forgotten = Instance(unit.library)
    forgotten.set(states, reached)
    with pytest.raises(CallError, match="modes were set, which start = 2 alone takes"):
        forgotten.initialise(values, first.get(values))
    if kind == "rigid":
        r = len(reached) // 2
        still = np.append(reached[:r], np.zeros(r))  # while the rows travel
        for wrong, said in (
            (1.0 + reached, "the states move a rigid row"),
            (reached + np.append(np.zeros(r), np.ones(r)), "the states' rates move a rigid row"),
            (still, "do not follow it along the path"),
        ):
            third = Instance(unit.library)
            third.set(states, wrong)
            third.choose_start(2)
            with pytest.raises(CallError, match=said):
                third.initialise([*values, *rates], inputs)


def test_rates_are_those_of_the_outputs(unit: Unit) -> None:
    """Of a smooth motion, against central differences over short steps, which converge with their square."""
    if unit.pushes or unit.rubs or (unit.system.compliance.rigid.any() and unit.drivers.frame is None):
        return
    rates = [name for name in unit.library.named("output") if name.endswith("_rate")]
    moved, h = [name.removesuffix("_rate") for name in rates], 1e-5
    instance, (names, table) = unit.begin(), unit.reference_in
    instance.set(names, table[20, 1:])
    found, rate = list[Array](), list[Array]()
    for k in range(20):
        instance.step(k * h, h)
        found.append(instance.get(moved))
        rate.append(instance.get(rates))
    y, v = np.array(found), np.array(rate)
    expected = (y[2:] - y[:-2]) / (2.0 * h)
    assert_close(v[1:-1][5:], expected[5:], 2e-3)


def test_a_long_communication_step_is_made_of_internal_ones(unit: Unit) -> None:
    """Linear inputs over five steps: those of five steps."""
    slope = np.where(np.arange(len(unit.rates)) < len(unit.drivers.paths), 0.05, 1.0)
    once, often = unit.begin(), unit.begin()
    start = once.get(unit.values)
    for instance in (once, often):
        instance.set(unit.inputs, np.concatenate([start, slope, np.zeros(2 * len(slope))]))
    once.step(0.0, 5 * unit.step)
    for k in range(5):
        often.step(k * unit.step, unit.step)
    assert_close(once.get(unit.displacements), often.get(unit.displacements), 1e-8)
    np.testing.assert_allclose(once.get(unit.values), start + 5 * unit.step * slope, rtol=1e-13, atol=1e-13)


def test_paths_have_ends_and_may_lie_a_little_beyond(unit: Unit) -> None:
    ranges = unit.system.ranges if unit.system.paths else {"": next(iter(unit.system.bodies.values())).domain}
    for path, (low, high) in ranges.items():
        name = f"s_{path}" if f"s_{path}" in unit.inputs else "s"
        found = []
        for share in (0.0, 0.9):
            instance = Instance(unit.library)
            instance.choose_start(0)
            instance.initialise([name], [high + share * BEYOND_ENDS * (high - low)])
            instance.step(0.0, unit.step)
            found.append(instance.get(unit.displacements))
        if unit.drivers.frame is None:  # in a frame inertia grows with the place itself
            np.testing.assert_array_equal(*found)
        outside = high + 1.1 * BEYOND_ENDS * (high - low)
        said = re.escape(f"{name} = {outside:.9g} m lies off the path: {low:.9g} to {high:.9g} m is allowed")
        with pytest.raises(CallError, match=said):
            Instance(unit.library).initialise([name], [outside])


def test_bad_values_and_calls_out_of_order_are_refused(unit: Unit) -> None:
    """With a reason; no value is taken over."""
    for name, value in (("internal_step", 0.0), ("rho_inf", 1.1)):
        with pytest.raises(CallError, match=name):
            Instance(unit.library).initialise([name], [value])
    fresh = Instance(unit.library)
    with pytest.raises(CallError, match="after the initialisation"):
        fresh.step(0.0, unit.step)
    instance = unit.begin()
    before = instance.get(unit.inputs)
    for number in (np.nan, np.inf, -np.inf):
        for name in unit.inputs:
            with pytest.raises(CallError, match=f"{name}: a finite number is allowed"):
                instance.set([name], [number])
    if unit.drivers.frame is not None:
        with pytest.raises(CallError, match="luffing: an angle of at most one turn is allowed, in rad"):
            instance.set(["luffing"], [45.0])
    np.testing.assert_array_equal(instance.get(unit.inputs), before)
    with pytest.raises(CallError, match="parameters and states are fixed"):
        instance.set(["internal_step"], [1e-4])
    with pytest.raises(CallError, match=f"{unit.displacements[0]}: it can be read only"):
        instance.set(unit.displacements[:1], [1.0])
    with pytest.raises(CallError, match="another model"):
        Instance(unit.library, token="{0}")
    unit.advance(instance, 0)  # whole after all of these


def test_a_jump_is_told_once(unit: Unit) -> None:
    """Of each path."""
    if unit.drivers.frame is not None:
        return
    instance, count = unit.begin(), len(unit.drivers.paths)
    unit.advance(instance, 0)
    assert not any("jumps" in message for message in instance.said)
    ranges = unit.system.ranges if unit.system.paths else {"": next(iter(unit.system.bodies.values())).domain}
    at = instance.get(unit.values[:count])
    instance.set(unit.rates, np.zeros(len(unit.rates)))
    for name, (low, high), s in zip(unit.values, ranges.values(), at, strict=False):
        instance.set([name], [high - 0.1 * (high - low) if s < (low + high) / 2.0 else low + 0.1 * (high - low)])
    for k in range(2):
        instance.step((1 + k) * unit.step, unit.step)
        assert sum("jumps" in message for message in instance.said) == count


def test_a_motion_without_second_rates_is_told_once(unit: Unit) -> None:
    """As the run has it nothing is said; with values and first rates alone the inertia of what moves is missing."""
    if unit.drivers.frame is None:
        return
    names, table = unit.reference_in
    second = [name for name in names if name.endswith(("_rate_2", "_rate_3"))]
    for left_out in (False, True):
        instance = unit.begin()
        for k, row in enumerate(table[: len(table) // 2]):
            instance.set(names, row[1:])
            if left_out:
                instance.set(second, np.zeros(len(second)))
            instance.step(k * unit.step, unit.step)
        said = [one for one in instance.said if "the inertia of what moves is left out" in one]
        assert bool(said) == left_out and len(said) == len(set(said))


def test_rates_in_mrad_beside_an_angle_in_rad_are_told_once(unit: Unit) -> None:
    """Inertia forces would be those of such rates; nothing is said of those of the run."""
    if unit.drivers.frame is None:
        return
    names, table = unit.reference_in
    is_rate = np.array([name.startswith("luffing_rate") for name in names])
    for factor in (1.0, 1e3):
        instance = unit.begin()
        for k, row in enumerate(table[: len(table) // 2]):
            instance.set(names, np.where(is_rate, factor, 1.0) * row[1:])
            instance.step(k * unit.step, unit.step)
        said = [message for message in instance.said if "its rates do not lead" in message]
        assert len(said) == (factor > 1.0) and all(message.startswith("luffing: ") for message in said)


def test_rates_of_inputs_may_be_given_as_derivatives(unit: Unit) -> None:
    """As FMI 2.0 has it, beside variables of their own."""
    if unit.library.version != "2":
        return
    slopes, values = np.linspace(0.2, 0.4, len(unit.rates)), unit.values
    by_name, by_order = unit.begin(), unit.begin()
    by_name.set(unit.rates, slopes)
    of = (ctypes.c_uint32 * len(values))(*(unit.library.references[name] for name in values))
    orders, given = (ctypes.c_int * len(values))(*[1] * len(values)), (ctypes.c_double * len(values))(*slopes)
    by_order.call("SetRealInputDerivatives", of, ctypes.c_size_t(len(values)), orders, given)
    for instance in (by_name, by_order):
        instance.step(0.0, unit.step)
    names = unit.displacements + values
    np.testing.assert_array_equal(by_name.get(names), by_order.get(names))


def test_reactions_in_a_frame_are_those_of_the_run(unit: Unit) -> None:
    """Of the pin, from the modes' equations, and of the cylinder by its hinges; with inertia and second order."""
    if unit.drivers.frame is None or unit.rubs:
        return
    response = pmr.simulate(unit.scene.scene, unit.system)
    listed = [*(f"reaction of base: pin {axis}" for axis in ("x", "y", "z", "rx", "rz")), CYLINDER]
    expected = response.others[:, [response.other_names.index(name) for name in listed]]
    names, instance, found = [re.sub("[: ]+", "_", name) for name in listed], unit.begin(), []
    for k in range(len(expected)):
        found.append(instance.get(names))
        unit.advance(instance, k)
    assert_close(np.array(found), expected, 1e-5)


def test_the_tip_is_where_it_is_in_space(unit: Unit) -> None:
    """By rotations of SciPy; `test_rates_are_those_of_the_outputs` has its velocity."""
    if unit.drivers.frame is None:
        return
    instance, scene = unit.begin(), unit.scene.scene
    for k in range(20):
        unit.advance(instance, k)
    values = dict(zip(unit.inputs, instance.get(unit.inputs), strict=True))
    names = [f"fly_tip_{axis}" for axis in "xyz"]
    u = np.array([instance.get([name])[0] if name in unit.library.references else 0.0 for name in names])
    X = values["s_middle"] + values["s_fly"] + scene.sections[-1].length
    rocked = [values.get(name, 0.0) for name in ("base_rz", "base_ry", "base_rx")]
    axes = Rotation.from_euler("ZYX", rocked) * Rotation.from_euler("ZY", [values["slewing"], -values["luffing"]])
    expected = axes.apply(np.array(scene.frame.tail_position) + u + [X, 0.0, 0.0])
    assert np.abs(u).max() > 1e-3
    np.testing.assert_allclose(instance.get([f"tip_in_space_{axis}" for axis in "XYZ"]), expected, rtol=1e-13)


def test_what_goes_in_has_its_unit(unit: Unit) -> None:
    if unit.drivers.frame is None:
        return
    units = dict[str, str]()
    for variable in ET.fromstring(unit.texts["modelDescription.xml"]).iter():
        if variable.get("causality") == "input":
            real = variable if variable.tag == "Float64" else variable.find("Real")
            units[variable.attrib["name"]] = real.attrib["unit"]
    angles = {"luffing": "rad", "slewing_rate": "rad/s", "luffing_rate_2": "rad/s2"}
    assert units | angles | {"gravity": "m/s2", "fly_gust": "N"} == units
    assert path_names(unit.drivers.paths) == ["s middle", "s fly"]


def test_paths_in_another_order_than_the_scene_has_them_are_refused(unit: Unit) -> None:
    """As inputs would drive the wrong sections."""
    if unit.drivers.frame is None:
        return
    turned = replace(unit.system, contacts=unit.system.contacts[::-1])
    assert turned.paths == unit.system.paths[::-1]
    with pytest.raises(InputError, match="paths = 'middle, fly': .* in the pads' order: fly, middle"):
        Drivers.of(turned)
