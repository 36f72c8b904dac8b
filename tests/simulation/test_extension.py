"""A section that slides by itself, beside equations of a rigid section in NumPy and SciPy, and beside its replay."""

from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import free_boom
import numpy as np
import pytest
from free_extension import RIGID, G, free, scene, simulated, system
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import pmr
from pmr.compare.moving_frame import energy_in_space
from pmr.compare.outputs import run_from_start
from pmr.errors import InputError, SimulationError
from pmr.files.arrays import Array
from pmr.simulation import Excitation
from pmr.simulation.free_base import FreeBase

pytestmark = pytest.mark.slow  # a boom is reduced

SLOPE = np.sin(0.3)
#: A tip force that bends the boom, so that pads push along it.
BENT = "sections.fly.loads.2.signal={kind='constant', amount=-2e4}"
#: Pads that rub.
RUBBING = tuple(
    f"section.joint.{ring}.0.{key}" for ring in ("tail", "mouth") for key in ("friction=0.05", "shear_stiffness=1e6")
)
#: Pads that only push, as stiff as those of a crane.
PUSHING = (*free_boom.PUSHING, "section.joint.tail.0.stiffness=1e7", "section.joint.mouth.0.stiffness=1e7")
#: A tip force that lifts the section off its pads, again and again.
LIFTING = "sections.fly.loads.2.signal={kind='sine', amplitude=4e3, frequency=6.0}"
#: The same, with kinks where steps end.
JERKING = "sections.fly.loads.2.signal={kind='ramp', times=[0.0, 0.04, 0.08, 0.12], values=[0.0, 4e3, -4e3, 3e3]}"
#: A drive that begins with what holds the section.
PULLED = free("length={kind='smooth_ramp', times=[0.0, 0.4], values=[0.6, 1.0]}, spring=1e5")


def frequency(run: SimpleNamespace) -> float:
    """Frequency in Hz, from the times at which the rate goes up through zero."""
    rate, h = run.s[1], run.t[1]
    up = np.flatnonzero((rate[:-1] < 0.0) & (rate[1:] >= 0.0))
    crossed = run.t[up] - rate[up] * h / (rate[up + 1] - rate[up])
    return float((len(crossed) - 1) / (crossed[-1] - crossed[0]))


def test_a_section_slides_down_a_slope_against_a_damper() -> None:
    run, c = simulated(*RIGID, free("damping=400.0"), "time.end=0.4", "time.step=1e-3"), 400.0
    m, weight = run.mass, run.mass * G * SLOPE
    exact = 0.6 - weight / c * run.t + m * weight / c**2 * (1.0 - np.exp(-c * run.t / m))
    assert np.abs(run.s[0] - exact).max() < 1e-6 * np.ptp(exact)


def lifted(response: pmr.Response) -> int:
    """How often pads above and below let go or catch."""
    names = response.force_names
    vertical = [k for k, name in enumerate(names) if "top" in name or "bottom" in name]
    return int((np.diff(response.slider_force[:, vertical] > 0.0, axis=0)).sum())


def test_a_section_slides_down_a_slope_while_its_pads_lift() -> None:
    """Pads that press at right angles to a straight axis leave its slide as it is, whichever of them hold.

    What pads of 1e10 N/m give way tilts the axis by 4e-7 at most, which adds 1e-5 of the way.
    """
    rigid = (*RIGID[:1], *(f"section.joint.{ring}.0.stiffness=1e10" for ring in ("tail", "mouth")))
    run = simulated(*free_boom.PUSHING, *rigid, free("damping=400.0"), LIFTING, "time.end=0.2", "time.step=1e-3")
    m, weight, c = run.mass, run.mass * G * SLOPE, 400.0
    exact = 0.6 - weight / c * run.t + m * weight / c**2 * (1.0 - np.exp(-c * run.t / m))
    assert np.abs(run.s[0] - exact).max() < 3e-5 * np.ptp(exact)
    assert lifted(pmr.simulate(run.written, run.system)) >= 8


def test_a_section_whose_pads_lift_moves_as_with_shorter_steps() -> None:
    """Extension and tip beside steps that are eight times shorter, on a soft boom."""
    ends = []
    for step in (2e-3, 2.5e-4):
        keys = ("time.end=0.2", f"time.step={step}", "time.rho_inf=0.8")
        run = simulated(*PUSHING, free("damping=800.0"), LIFTING, *keys)
        response, every = pmr.simulate(run.written, run.system), round(2e-3 / step)
        tip = response.displacement[:, response.output_names.index("fly: tip z")]
        ends.append(np.stack([response.other("extension of fly"), tip])[:, ::every])
        assert lifted(response) >= 8
    off = np.abs(ends[0] - ends[1]).max(axis=1) / np.ptp(ends[1], axis=1)
    assert off[0] < 2e-6
    assert off[1] < 1e-3


def test_a_section_swings_on_a_spring_at_the_frequency_of_a_mass() -> None:
    run = simulated(*RIGID, free("length=0.6, spring=2e4, rate=0.1"), "time.end=1.0", "time.step=5e-4")
    assert frequency(run) == pytest.approx(np.sqrt(2e4 / run.mass) / (2.0 * np.pi), rel=1e-5)


def test_a_section_that_follows_moves_with_the_free_one(tmp_path: Path) -> None:
    """With X_2 = 1.5 s + 0.1 of the second one, both masses slide as m_1 + 1.5^2 m_2."""
    text = free_boom.FILE.read_text().replace("second_order = true", "second_order = false")
    follower = '[[sections]]\nname = "end"\nbody.box = { length = 2.0, width = 0.18, height = 0.14, wall = 0.003 }\n'
    follower += "\n".join(f"joint.{key}" for key in ('follows = "fly"', "ratio = 0.5", "offset = 0.1"))
    file = tmp_path / "three.toml"
    file.write_text(text.replace("[gravity]", f"{follower}\n\n[gravity]"))
    three = pmr.load_scene(file, [*RIGID, free("damping=400.0"), "time.end=0.2", "time.step=5e-4", "time.rho_inf=0.9"])
    boom = pmr.reduce(three).system
    response = pmr.simulate(three, boom)
    _, first, second = FreeBase(three, boom).boom.masses
    m, weight, c = first + 1.5**2 * second, (first + 1.5 * second) * G * SLOPE, 400.0
    exact = 0.6 - weight / c * response.t + m * weight / c**2 * (1.0 - np.exp(-c * response.t / m))
    assert np.abs(response.other("extension of fly") - exact).max() < 1e-6 * np.ptp(exact)


def test_a_boom_that_slews_throws_its_section_out() -> None:
    """The centre of mass at x from the pivot obeys x'' = Omega^2 x."""
    spins = (*RIGID, "frame.luffing={kind='constant', amount=0.0}")
    spins = (*spins, "frame.slewing={kind='ramp', times=[0.0, 10.0], values=[0.0, 20.0]}")
    run = simulated(*spins, free("", start=0.4), "time.end=0.4", "time.step=1e-3", "time.rho_inf=0.9")
    boom = FreeBase(run.written, run.system).boom
    centre = boom.place[0] + boom.first[1, 0] / run.mass
    exact = (0.4 + centre) * np.cosh(2.0 * run.t) - centre
    assert np.abs(run.s[0] - exact).max() < 1e-6 * np.ptp(exact)


AREAS, DEAD, K, BACK = np.array([2e-3, 1.2e-3]), np.array([2e-4, 3e-4]), 1.4e9, 1e6
GAIN, SUPPLY, LAMINAR, LEAKAGE = np.array([2e-7, 1.5e-7]), 20e6, 1e4, 2e-13
STROKE = np.array([0.3, 1.2])
CHAMBERS = f"areas={AREAS.tolist()}, dead_volumes={DEAD.tolist()}, bulk_modulus={K}, back_pressure={BACK}"


def volumes(s: float) -> Array:
    return DEAD + AREAS * np.array([s - STROKE[0], STROKE[1] - s])


def test_a_section_swings_on_shut_oil_at_the_frequency_of_its_columns() -> None:
    run = simulated(*RIGID, free(f"rate=1e-3, oil={{{CHAMBERS}}}"), "time.end=0.1", "time.step=2e-4")
    stiffness = K * (AREAS**2 / volumes(0.6)).sum()
    assert frequency(run) == pytest.approx(np.sqrt(stiffness / run.mass) / (2.0 * np.pi), rel=1e-3)


@cache
def valved(step: float) -> SimpleNamespace:
    """A section that a valve lets out, in 0.3 s."""
    opening = "{kind='smooth_ramp', times=[0.05, 0.15], values=[0.0, 0.5]}"
    valve = f"valve={{opening={opening}, gain={GAIN.tolist()}, laminar={LAMINAR}}}"
    oil = f"{CHAMBERS}, leakage={LEAKAGE}, supply={SUPPLY}, {valve}"
    return simulated(*RIGID, free(f"damping=100.0, oil={{{oil}}}"), "time.end=0.3", f"time.step={step}")


@cache
def reference() -> Any:
    """The rigid section with its valve by Radau's method, as a function of time."""
    m = valved(2e-4).mass
    opening = valved(2e-4).written.sections[1].joint.extension.oil.valve.opening

    def rates(t: float, y: Array) -> Array:
        s, rate, *of = y
        p = np.array(of)
        drop = np.array([SUPPLY, 0.0]) - p
        flow = float(opening.value(t)) * GAIN * drop / (drop**2 + LAMINAR**2) ** 0.25 + LEAKAGE * (p[::-1] - p)
        force = p @ (AREAS * [1.0, -1.0]) - 100.0 * rate - m * G * SLOPE
        return np.array([rate, force / m, *(K / volumes(s) * (flow - AREAS * [rate, -rate]))])

    start = [0.6, 0.0, (m * G * SLOPE + BACK * AREAS[1]) / AREAS[0], BACK]
    scale = np.array([1e-10, 1e-9, 1e-1, 1e-1])
    return solve_ivp(rates, (0.0, 0.3), start, "Radau", rtol=1e-8, atol=scale, dense_output=True, max_step=5e-3).sol


def errors(step: float) -> Array:
    """Largest errors of extension, rate and pressures, as shares of the way and of the largest."""
    run = valved(step)
    y = reference()(run.t)
    sizes = np.array([np.ptp(y[0]), *np.abs(y[1:]).max(axis=1)])
    return np.asarray(np.abs([*run.s[:2], run.pressure_bore, run.pressure_rod] - y).max(axis=1) / sizes)


def test_a_valve_moves_a_rigid_section_as_a_stiff_solver_has_it() -> None:
    fine = errors(1e-4)
    np.testing.assert_allclose(errors(2e-4) / fine, 4.0, rtol=0.1)
    assert errors(2.5e-5).max() < 1e-4


def unbalanced(step: float, *keys: str) -> tuple[float, float]:
    """Largest work that is missing in J, and the largest work of the drive: drive and tip force, less all energy."""
    run = simulated(PULLED, *keys, "time.end=0.4", f"time.step={step}")
    excitation, response = Excitation.from_scene(run.scene), pmr.simulate(run.scene, run.system)
    space = energy_in_space(run.scene, run.system, excitation, run_from_start(run.system, excitation))
    at, rate = response.other("extension of fly"), response.other("rate of extension of fly")
    rigid = run.mass * (rate**2 / 2.0 + G * SLOPE * at)
    work = np.append(0.0, np.cumsum((run.power[1:] + run.power[:-1]) / 2.0 * step))
    tip = response.displacement[:, response.output_names.index("fly: tip z")]
    force = run.written.sections[1].loads[2].signal.value(response.t)
    of_tip = np.append(0.0, np.cumsum((force[1:] + force[:-1]) / 2.0 * np.diff(tip)))
    missing = work + of_tip - (space.energy - space.energy[0] + rigid - rigid[0])
    return float(np.abs(missing).max()), float(np.abs(work).max())


def test_the_drives_work_is_energy_to_second_order() -> None:
    """Pads push a section out of a bent boom: without their share along the boom a fifth of the work is missing."""
    (coarse, _), (fine, work) = unbalanced(2e-3, BENT), unbalanced(1e-3, BENT)
    assert coarse / fine == pytest.approx(4.0, rel=0.1)
    assert fine < 1e-4 * work


def test_the_drives_work_is_energy_to_second_order_while_pads_lift() -> None:
    keys = (*PUSHING, LIFTING, "time.rho_inf=0.8")
    (coarse, _), (fine, work) = unbalanced(2e-3, *keys), unbalanced(1e-3, *keys)
    assert coarse / fine == pytest.approx(4.0, rel=0.3)
    assert fine < 1e-4 * work


@pytest.mark.parametrize("damping", [0.0, 0.7])
def test_a_section_rebounds_from_its_stop(damping: float) -> None:
    """With F = k d (1 + c d') the speeds u before and e u after obey c u (1 + e) = ln((1 + c u) / (1 - c e u))."""
    drive = f"length=0.35, spring=1e-6, rate=-1.0, stop_stiffness=2e6, stop_damping={damping}"
    run = simulated(*RIGID, free(drive, start=0.35), "time.end=0.12", "time.step=2e-4", "time.rho_inf=0.9")
    back = 1.0
    if damping:
        back = brentq(lambda e: damping * (1 + e) - np.log((1 + damping) / (1 - damping * e)), 0.1, 1.0)
    assert run.s[1, -1] == pytest.approx(back, rel=1e-3)
    assert run.stop.min() == pytest.approx(run.s[0].min() - 0.3, rel=1e-12)
    assert run.stop[-1] == 0.0


def test_dry_friction_holds_a_section_up_to_its_limit() -> None:
    """A force that is 10 N more than weight and friction moves it; as much less does not."""
    weight = simulated(*RIGID, free("damping=400.0"), "time.end=0.4", "time.step=1e-3").mass * G * SLOPE
    ends = []
    for more in (-10.0, 10.0):
        signal = f"{{kind='smooth_ramp', times=[0.0, 0.1], values=[{weight}, {weight + 100.0 + more}]}}"
        drive = f"force={signal}, dry_friction=100.0, shear_stiffness=1e7"
        ends.append(simulated(*RIGID, free(drive), "time.end=0.3", "time.step=1e-3", "time.rho_inf=0.8").s[:, -1])
    (at, rate), (_, slides) = ends[0][:2], ends[1][:2]
    assert at == pytest.approx(0.6 + 90.0 / 1e7, rel=1e-5)
    assert abs(rate) < 1e-4
    assert slides > 1e-3


WAYS = {
    "held": (BENT,),
    "rubbing": (*RUBBING, BENT),
    "pushing": (*PUSHING, JERKING),
    "pushing and rubbing": (*PUSHING, *RUBBING, JERKING),
}


@pytest.mark.parametrize("way", WAYS)
def test_a_stepper_moves_a_soft_boom_as_a_run_that_replays_the_extension(way: str) -> None:
    """Tip, pads and extension: the steps that find it, and those of a prescribed extension that a run takes.

    Steps that pads divide into parts have the same parts; drive and tip force are straight between steps.
    """
    drive = "force={kind='ramp', times=[0.0, 0.05, 0.15, 0.2], values=[196.0, 800.0, 800.0, -200.0]}"
    changes = (*WAYS[way], free(drive), "time.end=0.25", "time.step=1e-3", "time.rho_inf=0.8")
    boom, of = system(*changes), scene(*changes)
    response = pmr.simulate(of, boom)
    names = ["fly: tip z", "extension of fly", "force of fly mouth bottom left", "extension cylinder of fly force"]
    stepper = pmr.Stepper(boom, step=1e-3, s={"fly": 0.6}, rho_inf=0.8, outputs=names, parts=0)
    force, tip = of.sections[1].joint.extension.force, of.sections[1].loads[2].signal
    signals = {"fly.hook z": tip, "extension drive force": force}
    drives = [{name: float(signal.value(t)) for name, signal in signals.items()} for t in response.t[1:]]
    y = np.array([stepper.step({}, loads) for loads in drives])
    columns = [response.displacement[:, response.output_names.index(names[0])], response.other(names[1])]
    columns += [response.slider_force[:, response.force_names.index(names[2])], response.other(names[3])]
    for computed, replayed in zip(y.T, columns, strict=True):
        assert np.abs(computed - replayed[1:]).max() < 1e-10 * np.abs(replayed).max()
    assert stepper.extension["extension of fly"] == y[-1, 1]
    other = pmr.Stepper(boom, step=1e-3, s={"fly": 0.6}, rho_inf=0.8, outputs=names, parts=0)
    other._state.restore(stepper._state.save())  # with the extension, its rate and the search's slope
    for _ in range(20):
        steps = [each.step({}, drives[-1] | {"extension drive force": 150.0}) for each in (stepper, other)]
        np.testing.assert_array_equal(*steps)
    with pytest.raises(InputError, match=r"s\.fly = 0\.7: none is allowed after the start, for the extension is free"):
        stepper.step({"fly": 0.7})


@pytest.mark.parametrize(("supply", "weak"), [(5e4, True), (20e6, False)])
def test_a_supply_that_is_too_weak_has_a_warning(supply: float, weak: bool) -> None:
    """The valve opens to extend a raised section: with a weak supply the section sinks, and else it meets its stop."""
    oil = f"oil={{areas=[2e-3, 1.2e-3], dead_volumes=[2e-4, 3e-4], bulk_modulus=1.4e9, supply={supply}, valve="
    oil += "{opening={kind='smooth_ramp', times=[0.0, 0.1], values=[0.0, 1.0]}, gain=[6e-6, 4e-6]}}"
    keys = free(oil, stroke=(0.3, 0.7)), "frame.luffing={kind='constant', amount=0.6}", "time.end=0.4"
    result = pmr.run(scene(*keys, "compare.against=[]", "compare.richer='none'")).result
    extension = result.responses["reduced"].other("extension of fly")
    stops = result.summary["extension_cylinder"]["stops"]
    assert bool(extension[-1] < extension[0]) == weak and bool(stops) != weak
    lines = [line for line in result.summary["warnings"] if "too weak" in line]
    assert len(lines) == weak and all("for the extension cylinder" in line for line in lines)
    assert weak or not [line for line in result.summary["warnings"] if "supply" in line]


REFUSED = {
    "frame.second_order=true": "false is allowed beside the free extension of fly",
    "compare.richer='shell'": "'auto' or 'none' is allowed beside sections[1].joint.extension, which is computed",
    "start='rest'": "'equilibrium' is allowed beside the free extension of fly",
    "section.joint.cylinder.stiffness=1e8": "'rigid' is allowed beside the free extension of fly",
    "frame.luffing='free'": "none is allowed beside joint.extension.kind = 'free': one motion is computed at a time",
    "simulation.simulators=['exudyn']": "march is allowed: exudyn computes no motion that is free (extension of fly)",
    "sections.fly.joint.extension.start=1.5": "an extension within the stroke, 0.3 to 1.2 m, is allowed",
    "sections.fly.joint.extension.stroke=[1.2, 0.3]": "a smallest extension below the greatest one is allowed",
    "sections.fly.joint.extension.stroke=[0.01, 1.2]": "a smallest extension of stop_travel, 0.02 m, or more is",
    "sections.fly.joint.extension.kind='fre'": "extension.kind = 'fre': did you mean 'free'? constant, ramp,",
    "sections.fly.joint.extension.length=0.6": "length and spring are allowed together",
    "sections.fly.joint.extension.dry_friction_at_rest=1.0": "as much as dry_friction, which is above 0, or",
}


@pytest.mark.parametrize("key", REFUSED)
def test_what_a_free_extension_does_not_go_with_is_refused(key: str) -> None:
    with pytest.raises(InputError) as error:
        scene(free(""), key)
    assert REFUSED[key] in str(error.value)
    assert "\n" not in str(error.value)


def test_a_section_that_leaves_its_stroke_ends_the_run() -> None:
    with pytest.raises(SimulationError, match=r"step \d+, t = 0\.\d+ s, fly at .*: .*left its stroke and stop_travel"):
        simulated(*RIGID, free("rate=-3.0, stop_stiffness=1e3", start=0.35), "time.end=0.2")


def test_what_needs_the_extension_beforehand_refuses_a_free_one() -> None:
    with pytest.raises(InputError, match=r"joint\.extension = 'free': none is allowed here: only pmr run"):
        Excitation.from_scene(scene(free("")))
