"""A boom one step at a time: what the compiled simulator finds under the same extensions and loads."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from nested import Nested, full, reduced

import pmr
from pmr import InputError, Stepper, System
from pmr.scene import Scene
from pmr.scene.signals import Constant, SignalBase, Sine, Table
from pmr.simulation import Excitation, InitialState, TimeStepping
from pmr.simulation.native import systems
from pmr.simulation.native.driving import Drivers

END, STEP, RHO = 0.2, 1e-3, 0.9
SHORT = ["compare.against=[]", "section.mesh.elements=8", f"time.end={END}", f"time.step={STEP}"]
MOVING = "sections.fly.joint.extension={kind='smooth_ramp',times=[0.0,0.2],values=[2.0,2.3]}"


@pytest.fixture(scope="module")
def boom() -> Scene:
    """On pads that only push, two rigid cylinders among the contacts."""
    return pmr.load_scene("boom_three", [*SHORT, MOVING])


@pytest.fixture(scope="module")
def system(boom: Scene) -> System:
    return pmr.reduce(boom).system


@pytest.mark.slow
def test_steps_are_those_of_the_simulation(boom: Scene, system: System) -> None:
    """Displacements of all sections and forces of all contacts, by names and in their order, from equilibrium on."""
    excitation = Excitation.from_scene(boom).with_stepping(TimeStepping(END, STEP, RHO, parts=1))
    expected = systems.simulate(system, excitation, systems.static_start(system, excitation))
    moved = np.hstack(list(systems.displacements(system, expected).values()))
    s, f = excitation.s, excitation.forces(system.input_names)
    stepper = Stepper(system, STEP, s[0], f[0], RHO)
    by_name = Stepper(
        system,
        STEP,
        dict(zip(system.paths, s[0], strict=True)),
        dict(zip(system.input_names, f[0], strict=True)),
        RHO,
        outputs=["force of cylinder of fly", 3],
    )
    assert stepper.output_names[-1] == "force of cylinder of fly"
    assert len(stepper.output_names) == moved.shape[1] + len(system.contacts)
    size, force = np.abs(moved).max(), np.abs(expected.forces).max()
    np.testing.assert_allclose(stepper.outputs[: moved.shape[1]], moved[0], rtol=0.0, atol=1e-12 * size)
    for k in range(1, len(s)):
        y = stepper.step(s[k], f[k])
        np.testing.assert_allclose(y, moved[k], rtol=0.0, atol=1e-12 * size)
        np.testing.assert_allclose(list(stepper.forces.values()), expected.forces[k], rtol=0.0, atol=1e-12 * force)
        chosen = by_name.step(
            dict(zip(system.paths, s[k], strict=True)), dict(zip(system.input_names, f[k], strict=True))
        )
        assert chosen.tolist() == [stepper.forces["cylinder of fly"], y[3]]
    assert stepper.time == pytest.approx(END)
    for name, motion in expected.bodies.items():
        np.testing.assert_allclose(stepper.states[name].q, motion.q[-1], rtol=0.0, atol=1e-12 * np.abs(motion.q).max())
        np.testing.assert_allclose(stepper.states[name].v, motion.v[-1], rtol=0.0, atol=1e-11 * np.abs(motion.v).max())


def test_a_boom_that_knows_its_scene_starts_in_equilibrium_under_its_weight(system: System) -> None:
    """And stays there: what is left out of a mapping stays."""
    stepper = pmr.Stepper(system, STEP, {"middle": 1.0, "fly": 2.0})
    start, forces = stepper.outputs, stepper.forces
    assert sum(forces.values()) != 0.0
    for _ in range(20):
        stepper.step({"fly": 2.0})
    np.testing.assert_allclose(stepper.outputs, start, rtol=0.0, atol=1e-8 * np.abs(start).max())


def test_a_boom_that_starts_at_rest_does_so_step_by_step(boom: Scene, system: System) -> None:
    at_rest = replace(system, provenance=boom.model_copy(update={"start": "rest"}).provenance)
    stepper = Stepper(at_rest, STEP, [0.6, 2.0])
    assert not stepper.q.any()


def test_a_start_of_ones_own_and_bodies_without_a_scene() -> None:
    """Nothing bears a load, and what moves goes on."""
    bare = reduced(Nested(2, elements=8), 2)
    at_rest = Stepper(bare, STEP, 2.0, initial={})
    assert not at_rest.outputs.any() and not at_rest.step(2.0).any()
    moving = {"1": InitialState(np.zeros(bare.bodies["1"].size), np.ones(bare.bodies["1"].size))}
    stepper = Stepper(bare, STEP, 2.0, initial=moving)
    np.testing.assert_allclose(stepper.states["1"].v, 1.0, rtol=1e-9)
    assert stepper.step(2.0).any()


def test_how_fine_a_step_is_for_pads_that_push(system: System) -> None:
    half = Stepper(system, STEP / 2.0, [1.0, 2.0])
    whole = Stepper(system, STEP, [1.0, 2.0])
    assert whole.contact == pytest.approx(2.0 * half.contact) and whole.contact > 0.0
    assert Stepper(reduced(Nested(2, elements=8), 2), STEP, 2.0).contact == 0.0


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"s": [1.0]}, r"s = \[1.0\]: one path coordinate for each path is allowed, in this order: middle, fly"),
        ({"s": {"fly": 2.0}}, "s: all paths are needed at the start: middle, fly"),
        ({"s": {"middle": 1.0, "fyl": 2.0}}, "s = 'fyl': did you mean 'fly'"),
        ({"s": {"middle": 1.0, "fly": 99.0}}, "s.fly = 99.0: .* m is allowed"),
        ({"s": {"middle": 1.0, "fly": float("nan")}}, "s.fly = nan"),
        ({"F": [1.0, 2.0]}, r"F = \[1.0, 2.0\]: one load for each input is allowed"),
        ({"F": {"fly.tip": 1.0}}, "F = 'fly.tip': did you mean 'fly.tip force'"),
        ({"outputs": ["fly: w"]}, "outputs = 'fly: w'"),
        ({"outputs": [999]}, "outputs = 999"),
    ],
)
def test_what_is_out_of_range_is_refused(system: System, change: dict, says: str) -> None:
    arguments = {"step": STEP, "s": {"middle": 1.0, "fly": 2.0}} | change
    with pytest.raises(InputError, match=f"stepper: {says}"):
        Stepper(system, **arguments)


def test_a_path_that_leaves_its_range_and_loads_that_are_none_are_refused_on_the_way(system: System) -> None:
    stepper = Stepper(system, STEP, [1.0, 2.0])
    with pytest.raises(InputError, match="s.middle = 99.0"):
        stepper.step({"middle": 99.0})
    with pytest.raises(InputError, match="F.fly.tip force = nan: finite numbers are allowed"):
        stepper.step([1.0, 2.0], {"fly.tip force": float("nan")})


def test_motions_are_taken_in_whatever_form_they_are_given() -> None:
    """Values, rates and second rates of some extensions or loads, and how many of them, where a step ends."""
    values, rates = (3.0, np.float64(3.0), 3, [3.0], np.array([3.0])), ((3.0, 2.0), (np.float64(3.0), 2), [3, 2.0])
    for motion in (*values, *rates, (3.0, 2.0, 1), (3.0, 2.0, 1.0)):
        motions, rows = np.zeros((3, 4)), np.zeros(4, np.int32)
        names = ("middle", "fly"), {"gravity": 2, "tip force": 3}, None
        drivers = Drivers(motions, rows, names, {"middle": (0.0, 3.0), "fly": (0.0, 3.0)}, STEP, in_parts=True)
        drivers.take_paths([1.0, 2.0])
        drivers.take_loads({"tip force": motion})
        drivers.take_paths({1: 2.5})
        count = np.size(motion)
        expected = np.array([3.0, 2.0, 1.0]) * (np.arange(3) < count)
        np.testing.assert_array_equal(motions, np.transpose([[1.0, 0.0, 0.0], [2.5, 0.0, 0.0], [0.0] * 3, expected]))
        assert rows.tolist() == [1, 1, 1, count]


def test_an_angle_on_a_path_is_refused_and_warned_of_in_rad(caplog: pytest.LogCaptureFixture) -> None:
    motions, rows = np.zeros((3, 1)), np.zeros(1, np.int32)
    drivers = Drivers(motions, rows, (("luffing",), {}, None), {"luffing": (0.0, 1.0)}, STEP, in_parts=True)
    with pytest.raises(InputError, match="s.luffing = 1.5: 0 to 1 rad is allowed"):
        drivers.take_paths([1.5])
    with pytest.raises(InputError, match=f": {1.0 / STEP:g} rad/s, its range in a step"):
        drivers.take_paths({"luffing": (0.5, 2.0 / STEP)})
    for motion in ((0.2, 1.0), (0.6, 1.0)):
        drivers.take_paths({"luffing": motion})
        drivers.end_step()
    assert "luffing jumps by 0.4 rad" in caplog.text and "luffing moves by 0.4 rad" in caplog.text


def test_bodies_of_full_order_are_stepped_too() -> None:
    """As small ones are simulated: from equilibrium under a constant load, along the same extension."""
    system, s = full(Nested(2, elements=4)), Constant(amount=2.0)
    loads = {name: Constant(amount=10.0) for name in system.input_names}
    excitation = Excitation(dict.fromkeys(system.paths, s), loads, TimeStepping(5 * STEP, STEP, RHO))
    expected = systems.simulate(system, excitation, {})
    stepper = Stepper(system, STEP, 2.0, [10.0] * len(loads), RHO, initial={})
    for k in range(1, 6):
        stepper.step(2.0)
        found, forces = np.array(list(stepper.forces.values())), expected.forces[k]
        np.testing.assert_allclose(found, forces, rtol=0.0, atol=1e-9 * np.abs(expected.forces).max())


@pytest.mark.slow
def test_in_parts_by_their_errors_a_step_is_that_of_the_run(boom: Scene, system: System) -> None:
    """With values and rates of extensions and loads at its ends: the run's parts follow the signals between."""
    excitation = Excitation.from_scene(boom).with_stepping(TimeStepping(END, STEP, RHO))
    lifting = {"fly.tip force": Sine(amplitude=2e4, frequency=6.0)}  # pads let go
    excitation = replace(excitation, loads={**excitation.loads, **lifting})
    expected = systems.simulate(system, excitation, systems.static_start(system, excitation))
    moved = np.hstack(list(systems.displacements(system, expected).values()))

    def given(signals: dict[str, SignalBase], t: float) -> dict[str, tuple[float, float]]:
        return {name: (float(one.value(t)), float(one.rate(t))) for name, one in signals.items()}

    paths, loads = dict(excitation.paths), dict(excitation.loads)
    stepper = Stepper(system, STEP, given(paths, 0.0), given(loads, 0.0), RHO, parts=0)
    lines = Stepper(system, STEP, given(paths, 0.0), given(loads, 0.0), RHO, parts=0)
    off = [0.0, 0.0]
    for k, t in enumerate(excitation.times[1:], 1):
        y = stepper.step(given(paths, t), given(loads, t))
        off[0] = max(off[0], np.abs(y - moved[k]).max())
        values = [{name: motion[0] for name, motion in given(one, t).items()} for one in (paths, loads)]
        off[1] = max(off[1], np.abs(lines.step(*values) - moved[k]).max())
    assert expected.parts[1:].mean() > 1.0
    assert off[0] < 1e-9 < off[1] < 1e-4
    pads = ~np.isnan(system.clearance)  # cylinders keep ringing from a kink of the acceleration within the first step
    found, forces = stepper.multipliers[pads], expected.forces[-1, pads]
    np.testing.assert_allclose(found, forces, rtol=0.0, atol=1e-7 * np.abs(expected.forces).max())


@pytest.mark.slow
def test_pads_that_push_and_rub_are_stepped_as_in_the_run(boom: Scene, system: System) -> None:
    """Along cubics between steps, as the stepper takes them: nothing but round-off is left of either.

    Pads land, lift off, stick and slide; cylinders give way.
    """
    pads = ~np.isnan(system.clearance)
    rough = [
        replace(one, friction=0.2, arm=0.1, shear_stiffness=1e6) if pad else replace(one, compliance=1e-7)
        for one, pad in zip(system.contacts, pads, strict=True)
    ]
    rubbing, scenes = replace(system, contacts=tuple(rough)), Excitation.from_scene(boom)
    scenes = scenes.with_stepping(TimeStepping(END, STEP, RHO))
    lifting = {"fly.tip force": Sine(amplitude=2e4, frequency=6.0)}

    def cubic(signals: Mapping[str, SignalBase]) -> dict[str, SignalBase]:
        t = STEP * np.arange(len(scenes.times) + 1)  # a table that ends stands still
        return {name: Table(times=t.tolist(), values=one.value(t).tolist()) for name, one in signals.items()}

    paths, loads = cubic(scenes.paths), cubic({**scenes.loads, **lifting})
    excitation = replace(scenes, paths=paths, loads=loads)
    expected = systems.simulate(rubbing, excitation, systems.static_start(rubbing, excitation))
    moved = np.hstack(list(systems.displacements(rubbing, expected).values()))

    def given(signals: dict[str, SignalBase], t: float) -> dict[str, tuple[float, float]]:
        return {name: (float(one.value(t)), float(one.rate(t))) for name, one in signals.items()}

    stepper = Stepper(rubbing, STEP, given(paths, 0.0), given(loads, 0.0), RHO, parts=0)
    found, forces = [], []
    for now in excitation.times[1:]:
        found.append(stepper.step(given(paths, now), given(loads, now)))
        forces.append(stepper.multipliers)
    assert expected.friction is not None and expected.parts is not None
    pressed = expected.forces[1:, pads]
    sticks = np.abs(expected.friction[1:]) < 0.2 * pressed
    assert expected.parts[1:].mean() > 4.0 and sticks.sum() > 10 and (sticks < (pressed > 0.0)).sum() > 10
    np.testing.assert_allclose(found, moved[1:], rtol=0.0, atol=1e-12 * np.abs(moved).max())
    np.testing.assert_allclose(forces, expected.forces[1:], rtol=0.0, atol=1e-9 * np.abs(expected.forces).max())
