"""Where it is looked how much axial forces change a boom's stiffness."""

import re

import numpy as np
import one_body
import plain_machines
import pytest
from turning_cylinder import boom

import pmr
from pmr import reduce, run
from pmr import scene as scenes
from pmr.compare import evaluation
from pmr.compare.responses import simulate
from pmr.compare.second_order import STRESSED_TIMES, second_order_effect
from pmr.compare.summary import origin_part, sampling_part
from pmr.fullmodel.build import build, build_bodies, warnings
from pmr.results.run import SummaryPart, combine_parts
from pmr.scene import Scene
from pmr.scene.keys import ALONE
from pmr.scene.mechanism import stress_terms
from pmr.simulation import Excitation
from pmr.simulation.excitation import term_signals
from pmr.simulation.native.systems import March
from pmr.simulation.statics.equilibrium import geometric_stiffness
from pmr.simulation.stepping import describe_lost_features
from pmr.system.assembly import Assembly
from pmr.system.from_scene import system_of


def test_figures_and_warnings_of_all_parts_are_gathered_in_order() -> None:
    parts = [
        SummaryPart({"a": 1.0}, ["first"]),
        SummaryPart(),
        SummaryPart(warnings=["second"]),
        SummaryPart({"b": {"c": np.nan}}, ("third",)),
    ]
    found = combine_parts(parts)
    assert list(found) == ["a", "b", "warnings"] and found["a"] == 1.0
    assert found["warnings"] == ["b.c is not finite; in summary.json it is null", "first", "second", "third"]


@pytest.mark.parametrize("key", ["hoist.speed", "hoist.wind.y", "frame.base.x", "frame.slewing", "frame.luffing"])
def test_a_drive_that_the_steps_do_not_resolve_is_warned_of_once_by_its_key(key: str) -> None:
    """Dozens of loads and terms of the frame follow from the angle; all signals of an excitation are looked at."""
    fast = f"{key}={{kind='sine',amplitude=0.01,frequency=249.0}}"
    scene = pmr.load_scene(plain_machines.HOIST, (fast, "time.end=2.0", "compare.against=[]"))
    expected = f"{key}: 249 Hz looks like 1 Hz at steps of 0.004 s; steps of 0.00057 s or less follow it"
    excitation = Excitation.from_scene(scene)
    assert sampling_part(scene, excitation).warnings == [expected]
    (line,) = describe_lost_features(excitation.signals, excitation.stepping)
    assert line.endswith(expected.partition(": ")[2])


def test_a_base_that_is_shaken_accelerates_the_boom_with_no_other_frequency() -> None:
    """Loads of the frame are linear in the acceleration of its base, which has ten steps a period."""
    shaken = "frame.base.x={kind='sine',amplitude=0.01,frequency=25.0}"
    scene = pmr.load_scene(plain_machines.HOIST, (shaken, "time.end=2.0", "compare.against=[]"))
    assert sampling_part(scene, Excitation.from_scene(scene)).warnings == []


def test_what_follows_from_a_signal_that_the_steps_resolve_is_told_in_one_line() -> None:
    """Loads of the frame have the square of a rate, so twice its frequency."""
    slewing = "frame.slewing={kind='sine',amplitude=0.01,frequency=20.0}"
    scene = pmr.load_scene(plain_machines.HOIST, (slewing, "time.end=2.0", "compare.against=[]"))
    (line,) = sampling_part(scene, Excitation.from_scene(scene)).warnings
    assert re.match(r"load base.inertia x and \d\d more: 40 Hz has 6.2 steps of 0.004 s a period", line)


def test_a_drive_whose_curve_leaves_its_table_is_warned_of_by_its_key() -> None:
    table = "hoist.speed={kind='table',times=[0.0,1.0,1.2,2.0],values=[0.0,0.0,1.0,1.0]}"
    scene = pmr.load_scene(plain_machines.HOIST, (table, "time.end=2.0", "compare.against=[]"))
    (line,) = sampling_part(scene, Excitation.from_scene(scene)).warnings
    assert line.startswith("hoist.speed: the curve through its table (akima) goes from -0.625 to 1.5, ")


def test_warnings_of_what_does_not_hold_stand_before_those_of_what_is_off() -> None:
    parts = [
        SummaryPart(warnings=["off by 2 %"]),
        SummaryPart({"a": 1.0}, ["a hint"], ["it yields"]),
        SummaryPart(grave=["it slips"]),
    ]
    assert combine_parts(parts)["warnings"] == ["it yields", "it slips", "off by 2 %", "a hint"]


def test_no_part_overwrites_what_another_one_says() -> None:
    with pytest.raises(ValueError, match="two parts of a summary have a, b"):
        combine_parts([SummaryPart({"a": 1, "b": 2}), SummaryPart({"b": 3, "a": 4})])


def test_libraries_stand_beside_the_versions(load_scene) -> None:
    scene = load_scene("paper_simple", [])
    figures = origin_part(scene, {"dolfinx": "0"}).figures
    assert figures["versions"]["dolfinx"] == "0" and "numpy" in figures["versions"]
    assert (figures["title"], figures["scene_hash"]) == (scene.title, scene.hash)


@pytest.mark.parametrize(("elements", "count"), [(50, 0), (3000, 1)])
def test_too_many_elements_are_said(load_scene, elements: int, count: int) -> None:
    said = warnings(build(load_scene("paper_simple", [f"mesh.elements={elements}"])).structure)
    assert [line.startswith("round-off in the stiffness of so short elements") for line in said] == [True] * count


@pytest.mark.slow
def test_where_a_slider_strikes_the_forces_are_judged_without_the_blows(load_scene) -> None:
    short = [
        "time.end=1.0", "time.rho_inf=0.5", "mesh.elements=20", "simulation.simulators=['march']",
        "compare.against=['full']",
    ]  # fmt: skip
    kinked = "slider.path={kind='ramp',times=[0.3,0.6],values=[1.25,1.6]}"
    outcome = run(load_scene("evolved_residual", [*short, kinked]))
    assert outcome is not None
    found, errors = outcome.result.summary["impacts"], outcome.result.summary["errors"]["reduced_vs_full"]
    assert 0.0 < found["pad_force"] < 0.2 * errors["pad_force"] and 1.0 < found["band"] < 100.0
    smooth = run(load_scene("evolved_residual", [*short, kinked.replace("'ramp'", "'smooth_ramp'")]))
    assert smooth is not None and "impacts" not in smooth.result.summary


SMALL = ("mesh.elements=12", "time.end=0.2", "reduction.coordinates=6", "slider.path=2.0", "simulation.repeats=1")


@pytest.mark.slow
@pytest.mark.parametrize("workflow", ["boom_beam", "boom_two"])
def test_repeats_time_the_solver_and_evaluate_nothing(workflow: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = scenes.load_any(workflow, ["time.end=0.05"])
    system, evaluated, taken = reduce(scene).system, [], []
    whole, once_more = evaluation.response_to_motion, March.rerun
    monkeypatch.setattr(evaluation, "response_to_motion", lambda *of: evaluated.extend(of[1]) or whole(*of))
    monkeypatch.setattr(March, "rerun", lambda march: taken.append(march) or once_more(march))
    found = simulate(scene, system, Excitation.from_scene(scene)).first
    assert len(taken) == scene.simulation.repeats - 1
    assert len(set(evaluated)) == scene.time.steps + 1 and min(np.diff(evaluated)) >= 0.0  # block by block, and once
    assert found.response.seconds > 0.0
    march = taken[-1]  # from the same start to the same end
    repeated, number = march.state.z.copy(), march.state.step_number
    march.rerun()
    assert np.allclose(march.state.z, repeated, rtol=1e-9, atol=0.0) and march.state.step_number == number


@pytest.mark.slow
@pytest.mark.parametrize(("simulator", "bound"), [("march", 1e-12), ("exudyn", 1e-6)])
def test_states_are_those_of_the_simulation_that_made_the_response(simulator: str, bound: float) -> None:
    scene = scenes.load("boom_beam", [*SMALL, f"simulation.simulators=['{simulator}']"])
    reduction, steps, excitation = reduce(scene), np.array([0, 50, 200]), Excitation.from_scene(scene)
    found = simulate(scene, reduction.system, excitation, steps=steps.tolist()).first.states[ALONE]
    expected = one_body.simulate(reduction.reduced, excitation).at(steps)
    states = {"t": found.t, "s": found.s[:, 0], "q": found.p, "v": found.v, "multipliers": found.multipliers}
    for name, here in states.items():
        there = getattr(expected, name)
        assert here.shape == there.shape and np.abs(here - there).max() <= bound * np.abs(there).max(), name


SHORT = ["section.mesh.elements=8", "time.end=2.0", "time.step=1e-3", "frame.pivot=[0.0,0.0,0.0]", "frame.luffing=0.5"]
KINKED = "sections.fly.joint.extension={kind='ramp',times=[0.5,1.5],values=[0.6,2.6]}"


@pytest.mark.slow
def test_a_kink_of_an_extension_is_no_load_that_lasts() -> None:
    """Both kinks fall on times that are looked at; the impulse would be 200 g for a step and buckle the boom."""
    scene = pmr.load_scene("boom_two", [*SHORT, KINKED])
    found = second_order_effect(scene, {name: body.model for name, body in pmr.reduce(scene).bodies.items()})
    assert len(found.t) == STRESSED_TIMES - 2 and np.abs(np.subtract.outer(found.t, [0.5, 1.5])).min() > 1e-2
    assert found.least_factor > 100.0


@pytest.mark.slow
@pytest.mark.numerical
def test_what_pulls_at_the_tip_loads_every_cylinder_as_the_weight_of_a_payload_does() -> None:
    """An upright boom: 2,000 kg at its tip, or their weight along it, make the same stiffness of axial forces."""
    upright = ["section.mesh.elements=6", "time.end=0.01", "frame.second_order=true", "frame.pivot=[0.0,0.0,0.0]"]
    upright += [
        f"frame.luffing={np.pi / 2.0}",
        "sections.middle.joint.extension=2.0",
        "sections.fly.joint.extension=3.0",
    ]
    payload = "sections.fly.masses=[{{name='payload',on='tip',mass={}}}]"
    weight = "sections.fly.loads=[{{name='weight',on='tip',direction='x',signal={}}}]"
    stiffness = []
    for mass, force in ((2250.0, 0.0), (250.0, -2000.0 * 9.80665)):
        scene = pmr.load_scene("boom_three", [*upright, payload.format(mass), weight.format(force)])
        bodies = {name: built.model.gather() for name, built in build_bodies(scene).items()}
        assembly = Assembly(system_of(scene, bodies))
        c = {name: float(signal.value(0.0)) for name, signal in term_signals(scene, stress_terms(scene)).items()}
        stiffness.append(geometric_stiffness(assembly, c).toarray())
    np.testing.assert_allclose(*stiffness, rtol=0.0, atol=1e-9 * np.abs(stiffness[0]).max())


def test_a_peak_between_times_of_recovery_has_a_warning() -> None:
    """A load pulls at the tip for 0.2 s: it is over at the times that are 0.5 s apart, and at every step it is not."""

    def pulled(every: float) -> tuple[float, list[str]]:
        plain = boom(30.0, "beam2d", 6e7, 2.1e11, recovery={"every": every}, time={"end": 0.5, "step": 0.01})
        scene = plain.model_dump(mode="json")
        gust = {"kind": "smooth_ramp", "times": [0.1, 0.2, 0.3], "values": [0.0, -2e4, 0.0]}
        scene["sections"][1]["loads"][0]["signal"] = gust
        scene["damping"] = {"ratio": 0.1, "frequencies": [1.0, 30.0]}
        scene["compare"]["richer"] = "none"
        summary = run(Scene.model_validate(scene)).result.summary
        return summary["max_von_mises"]["reduced"], [line for line in summary["warnings"] if "may be missed" in line]

    (at_ends, (line,)), (at_steps, nothing) = pulled(0.5), pulled(0.01)
    assert at_ends < 0.8 * at_steps and not nothing
    assert line.startswith("the largest stress may be missed: ") and " at the times of recovery" in line
    assert "recovery.every = 0.5 s" in line and " at 0.2" in line


def test_round_off_between_times_of_recovery_has_no_warning() -> None:
    """A boom in space that stays in its vertical plane: moments about its axis are round-off."""
    still = boom(30.0, "beam3d", 6e7, 2.1e11, recovery={"every": 0.5}, time={"end": 0.5, "step": 0.01})
    assert not [line for line in run(still).result.summary["warnings"] if "may be missed" in line]
