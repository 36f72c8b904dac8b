"""A boom that luffs by itself, on oil, a force or a length, beside the equations of a rigid boom in NumPy and SciPy."""

from functools import cache
from types import SimpleNamespace
from typing import Any

import free_boom
import numpy as np
import pytest
from oil_boom import (
    AREAS,
    BACK,
    BAND,
    FOOT,
    LEAKAGE,
    LUG,
    RIGID,
    STROKE,
    SUPPLY,
    TANK,
    UP_AND_DOWN,
    G,
    K,
    chambers,
    flows,
    geometry,
    oil,
    opening_at,
    simulated,
    weight_moment,
)
from scipy.integrate import solve_ivp
from scipy.special import ellipk

import pmr
from pmr import InputError, SimulationError
from pmr.files.arrays import Array

pytestmark = pytest.mark.slow  # a boom is reduced


def test_boom_on_shut_oil_swings_at_the_frequency_of_its_columns() -> None:
    """The stiffness is that of both columns, with those by which arm and weight turn; hoses have a part of `DEAD`."""
    hoses = ("frame.cylinder.oil.dead_volumes=[1e-4, 1e-4]", "frame.cylinder.oil.hose_volumes=[1e-4, 2e-4]")
    keys = (*RIGID, oil(), *hoses, "frame.luffing_rate=1e-4", "frame.cylinder.oil.leakage=0.0")
    run = simulated(*keys, "time.end=0.2", "time.step=1e-4")
    angle, d = 0.3, 1e-5
    length, arm = geometry(angle)
    force = -weight_moment(run.boom, angle) / arm
    k = K * (np.array(AREAS) ** 2 / chambers(length)).sum() * arm**2
    k -= force * (geometry(angle + d)[1] - geometry(angle - d)[1]) / (2 * d)
    k -= (weight_moment(run.boom, angle + d) - weight_moment(run.boom, angle - d)) / (2 * d)
    rate = run.angle[1]
    up = np.flatnonzero((rate[:-1] < 0.0) & (rate[1:] >= 0.0))
    crossed = run.t[up] - rate[up] * 1e-4 / (rate[up + 1] - rate[up])
    frequency = (len(crossed) - 1) / (crossed[-1] - crossed[0])
    assert frequency == pytest.approx(np.sqrt(k / run.boom.J) / (2.0 * np.pi), rel=1e-3)


@cache
def driven(step: float, counterbalance: bool = True) -> SimpleNamespace:
    return simulated(*RIGID, oil(UP_AND_DOWN, "", counterbalance), "time.end=1.0", f"time.step={step}")


@cache
def reference() -> Any:
    """The rigid boom with valve and counterbalance valve by Radau's method, as a function of time."""
    boom = driven(1e-3).boom
    arm = geometry(0.3)[1]
    force = -weight_moment(boom, 0.3) / arm
    start = [0.3, 0.0, (force + BACK * AREAS[1]) / AREAS[0], BACK]

    def rates(t: float, y: Array) -> Array:
        angle, rate, *p = y
        length, arm = geometry(angle)
        q, swept = flows(opening_at(t), np.array(p), True), arm * rate * np.array([AREAS[0], -AREAS[1]])
        moment = weight_moment(boom, angle) + (p[0] * AREAS[0] - p[1] * AREAS[1]) * arm
        return np.array([rate, moment / boom.J, *(K / chambers(length) * (q - swept))])

    scale = np.array([1e-12, 1e-11, 1e-3, 1e-3])
    return solve_ivp(
        rates, (0.0, 1.0), start, "Radau", rtol=1e-8, atol=100.0 * scale, dense_output=True, max_step=5e-3
    ).sol


def errors(step: float) -> Array:
    """Largest errors of angle, rate and both pressures, as shares of the largest angle travelled and of the largest."""
    run = driven(step)
    y = reference()(run.t)
    sizes = np.array([np.ptp(y[0]), *np.abs(y[1:]).max(axis=1)])
    return np.abs(np.array([run.angle[0], run.angle[1], run.pressure_bore, run.pressure_rod]) - y).max(axis=1) / sizes


def test_valve_and_counterbalance_move_a_rigid_boom_as_a_stiff_solver_has_it() -> None:
    coarse, fine = errors(5e-4), errors(2.5e-4)
    np.testing.assert_allclose(coarse / fine, 4.0, rtol=0.1)
    assert errors(8e-5).max() < 1e-4


def test_flow_in_is_swept_volume_and_compression() -> None:
    run = driven(1e-3)
    swept = np.array([AREAS[0], -AREAS[1]])[:, None] * (run.length - run.length[0])
    volumes = np.array([chambers(length) for length in run.length]).T
    p = np.array([run.pressure_bore, run.pressure_rod])
    compressed = np.cumsum((volumes[:, 1:] + volumes[:, :-1]) / 2.0 / K * np.diff(p), axis=1)
    fed = np.array([run.volume_bore, run.volume_rod])
    np.testing.assert_allclose(fed[:, 1:], swept[:, 1:] + compressed, rtol=0.0, atol=1e-9 * np.abs(fed).max())


def imbalance(run: SimpleNamespace) -> float:
    """Energy that is missing at the end, as a share of what the supply fed: supply less tank, oil, boom, losses."""
    boom, p = run.boom, np.array([run.pressure_bore, run.pressure_rod])
    opening = np.array([opening_at(t) for t in run.t])
    q = np.array([run.flow_bore, run.flow_rod])
    leak = LEAKAGE * (p[::-1] - p)
    source = np.where(opening > 0.0, np.array([[SUPPLY], [TANK]]), np.array([[TANK], [SUPPLY]]))
    fed = (source * (q - leak)).sum(axis=0)  # supply's power less what the tank takes
    losses = ((source - p) * (q - leak)).sum(axis=0) + LEAKAGE * (p[0] - p[1]) ** 2
    volumes = np.array([chambers(length) for length in run.length]).T
    h = run.t[1]
    stored = ((volumes[:, 1:] + volumes[:, :-1]) / 2.0 / K * np.diff(p) * (p[:, 1:] + p[:, :-1]) / 2.0).sum()
    height = boom.sx * np.sin(run.angle[0]) + boom.sz * np.cos(run.angle[0])
    energy = boom.J * (run.angle[1, -1] ** 2 - run.angle[1, 0] ** 2) / 2.0 + G * (height[-1] - height[0])
    over = lambda power: float(((power[1:] + power[:-1]) / 2.0).sum() * h)  # noqa: E731
    assert np.allclose(
        run.flow_supply, np.where(opening > BAND, (q - leak)[0], np.where(opening < -BAND, (q - leak)[1], 0.0))
    )
    return (over(fed) - over(losses) - stored - energy) / over(np.abs(SUPPLY * run.flow_supply))


def test_power_of_the_supply_is_energy_and_losses_to_second_order() -> None:
    missing = [imbalance(driven(step)) for step in (1e-3, 5e-4, 2.5e-4)]
    assert abs(missing[0]) < 1e-6
    assert missing[0] / missing[1] == pytest.approx(4.0, rel=0.2)
    assert missing[1] / missing[2] == pytest.approx(4.0, rel=0.2)


def test_stiff_oil_in_small_chambers_is_stable_at_a_millisecond() -> None:
    """The boom would swing nine times in a step on its oil; angle and pressures follow the valve all the same."""
    modulus, stroke = 2e12, 1.06
    stiff = f"dead_volumes=[1e-6, 1e-6]; bulk_modulus={modulus}".split("; ")
    keys = (*RIGID, oil(UP_AND_DOWN), *(f"frame.cylinder.oil.{key}" for key in stiff))
    keys = (*keys, f"frame.cylinder.stroke=[{stroke}, {STROKE[1]}]", "time.rho_inf=0.8", "time.end=0.5")
    coarse, fine = simulated(*keys, "time.step=1e-3"), simulated(*keys, "time.step=2.5e-4")
    length, arm = geometry(0.3)
    stiffness = modulus * AREAS[0] ** 2 / (1e-6 + AREAS[0] * (length - stroke)) * arm**2
    assert np.sqrt(stiffness / coarse.boom.J) / (2.0 * np.pi) * 1e-3 > 9.0
    assert np.abs(coarse.angle[0] - fine.angle[0][::4]).max() < 1e-4 * np.ptp(fine.angle[0])
    for name in ("pressure_bore", "pressure_rod"):
        rough, smooth = getattr(coarse, name), getattr(fine, name)
        assert 0.0 < rough.min() and rough.max() < SUPPLY
        assert rough[-1] == pytest.approx(smooth[-1], rel=0.01)


def test_length_over_a_stiff_spring_comes_to_the_prescribed_angle() -> None:
    """The differences of angle and tip fall with the spring's stiffness."""
    ramp = "{kind='smooth_ramp', times=[0.0, 0.4], values=[0.3, 0.45], degree=9}"
    soft = ("sections.fly.joint.extension={kind='constant', amount=0.6}", "start='equilibrium'", "time.rho_inf=0.9")
    t = np.linspace(0.0, 0.6, 1201)
    x = np.clip(t / 0.4, 0.0, 1.0)
    angle = 0.3 + 0.15 * x**5 * (126.0 - 420.0 * x + 540.0 * x**2 - 315.0 * x**3 + 70.0 * x**4)
    table = f"{{kind='table', times={t.tolist()}, values={[geometry(one)[0] for one in angle]}}}"
    ends, system = ("time.end=0.6", "time.step=1e-3"), free_boom.system(*soft)
    prescribed = pmr.simulate(free_boom.scene(*soft, *ends, f"frame.luffing={ramp}"), system)
    tips, off = [k for k, output in enumerate(prescribed.outputs) if output.kind == "tip"], []
    for spring in (1e10, 1e11):
        hinges = f"foot={FOOT.tolist()}, lug={LUG.tolist()}"
        keys = (*soft, *RIGID[4:], f"frame.cylinder={{{hinges}, length={table}, spring={spring}}}")
        run = pmr.simulate(free_boom.scene(*keys, *ends), system)
        moved = run.displacement[:, tips] - prescribed.displacement[:, tips]
        size = np.abs(prescribed.displacement[:, tips]).max()
        off.append([np.abs(run.other("luffing angle") - angle[::2]).max() / 0.15, np.abs(moved).max() / size])
    assert off[0][0] / off[1][0] == pytest.approx(10.0, rel=0.01)
    assert np.max(off[-1]) < 1e-4


def test_boom_without_a_cylinder_swings_as_a_physical_pendulum() -> None:
    """The period has the complete elliptic integral of the half amplitude."""
    amplitude = 1.0
    keys = (*RIGID, f"frame.luffing_start={-np.pi / 2.0 + amplitude}", "time.end=7.0", "time.step=1e-3")
    run = simulated(*keys)
    reach = np.hypot(run.boom.sx, run.boom.sz)
    tilt = np.arctan2(run.boom.sz, run.boom.sx)  # of the centre of mass above the boom's axis
    half = (amplitude + tilt) / 2.0
    period = 4.0 * np.sqrt(run.boom.J / (G * reach)) * ellipk(np.sin(half) ** 2)
    rate = run.angle[1]
    turned = np.flatnonzero((rate[1:-1] < 0.0) & (rate[2:] >= 0.0)) + 1
    back = run.t[turned] - rate[turned] * 1e-3 / (rate[turned + 1] - rate[turned])
    assert len(back) >= 2
    assert np.diff(back).mean() == pytest.approx(period, rel=1e-5)


def test_boom_that_begins_above_its_pivot_falls_with_the_energy_of_its_weight() -> None:
    """But for vibrations of the boom, which take 2e-4 of it."""
    run = simulated(*RIGID, "frame.luffing_start=1.2", "time.end=0.8", "time.step=1e-3")
    height = run.boom.sx * np.sin(run.angle[0]) + run.boom.sz * np.cos(run.angle[0])
    fallen = G * (height[0] - height)
    assert run.angle[0, -1] < 1.0
    np.testing.assert_allclose(run.boom.J * run.angle[1] ** 2 / 2.0, fallen, rtol=0.0, atol=5e-4 * fallen.max())


def test_oil_that_holds_a_boom_down_has_the_back_pressure_in_the_bore() -> None:
    """A load lifts the boom, and the cylinder pulls; in balance with the pressures nothing moves."""
    lift = "sections.fly.loads=[{name='lift', on='tip', direction='z', signal={kind='constant', amount=1e4}}]"
    run = simulated(*RIGID, oil(), lift, "frame.cylinder.oil.leakage=0.0", "time.end=0.05")
    assert run.force[0] < 0.0 and run.pressure_bore[0] == pytest.approx(BACK)
    assert run.pressure_bore * AREAS[0] - run.pressure_rod * AREAS[1] == pytest.approx(run.force)
    assert np.ptp(run.angle[0]) < 1e-6


def ramp(size: float, t: float) -> tuple[float, float, float]:
    """Value, rate and second rate at t of a smooth ramp from 0 to `size` between 0 and 1 s."""
    shape = (
        t**3 * (10.0 - 15.0 * t + 6.0 * t * t),
        30.0 * t**2 * (1.0 - t) ** 2,
        60.0 * t * (1.0 - t) * (1.0 - 2.0 * t),
    )
    return size * shape[0], size * shape[1], size * shape[2]


def about(axis: int, angle: float) -> Array:
    """Rotation (3, 3) by an angle in rad about an axis, by its number."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turned = np.eye(3)
    turned[[i, j, i, j], [i, j, j, i]] = np.cos(angle), np.cos(angle), -np.sin(angle), np.sin(angle)
    return turned


HEAVE, ROLL, TURN = 0.2, 0.5, 1.5
#: Bases of a boom that slews, by keys of [frame], the ramp by which they move ahead and upwards, roll at the start,
#: ramp of the roll, and pitch, in m and rad.
BASES = {
    "moves": (f"base={{x=RAMP {HEAVE}]}}, z=RAMP {HEAVE}]}}}}", HEAVE, 0.0, 0.0, 0.0),
    "slope": ("ground={outriggers=LEGS, slope=[0.15, -0.2]}", 0.0, -0.2, 0.0, -0.15),
    "rolls": (f"base={{rx=RAMP {ROLL}]}}, ry={{kind='constant', amount=0.1}}}}", 0.0, 0.0, ROLL, 0.1),
}


@pytest.mark.parametrize("base", BASES)
def test_boom_that_slews_on_a_base_luffs_as_a_rigid_body_does(base: str) -> None:
    """A length of cylinder is held by a soft spring while centrifugal forces and the base act on the boom."""
    key, heave, tilt, roll, pitch = BASES[base]
    legs = "[{name='a', at=[2, 2]}, {name='b', at=[-2, 2]}, {name='c', at=[0, -2]}]"
    spring, up_to = 2e5, "{kind='smooth_ramp', times=[0.0, 1.0], values=[0.0,"
    hinges = f"foot={FOOT.tolist()}, lug={LUG.tolist()}"
    name, _, table = key.partition("=")
    keys = (
        *RIGID,
        f"frame.slewing={up_to} {TURN}]}}",
        f"frame.{name}={table.replace('RAMP', up_to).replace('LEGS', legs)}",
        f"frame.cylinder={{{hinges}, length={{kind='constant', amount=1.0}}, spring={spring}}}",
    )
    run = simulated(*keys, "time.end=1.0", "time.step=2.5e-4")
    boom, length = run.boom, geometry(0.3)[0]
    x2, z2, xz, xy, yz = boom.second
    inertia = np.array([[z2, -xy, -xz], [-xy, x2 + z2, -yz], [-xz, -yz, x2]])  # about y alone, y^2 has no part in it
    first, raising, upright = np.array([boom.sx, 0.0, boom.sz]), np.array([0.0, -1.0, 0.0]), np.array([0.0, 0.0, 1.0])

    def moment_of_motion(t: float, angle: float, rate: float) -> float:
        """Moment that inertia and weight need about the axis of luffing, at a constant rate."""
        (psi, psi_rate, psi_second), (rolled, roll_rate, roll_second) = ramp(TURN, t), ramp(roll, t)
        slewed, boom_axes = about(2, psi), about(1, -angle)
        of_roll = slewed.T @ [roll_rate, 0.0, 0.0]
        omega = of_roll + psi_rate * upright  # along axes that slew
        change = slewed.T @ [roll_second, 0.0, 0.0] + psi_second * upright - np.cross(psi_rate * upright, of_roll)
        turned = boom_axes.T @ omega + rate * raising
        alpha = boom_axes.T @ change - np.cross(rate * raising, boom_axes.T @ omega)
        second = ramp(heave, t)[2]
        lifted = np.array([second, 0.0, second + G])
        felt = (about(1, pitch) @ about(0, tilt + rolled) @ slewed @ boom_axes).T @ lifted
        return float(raising @ (inertia @ alpha + np.cross(turned, inertia @ turned) + np.cross(first, felt)))

    force = moment_of_motion(0.0, 0.3, 0.0) / geometry(0.3)[1]

    def rates(t: float, y: Array) -> Array:
        now, arm = geometry(y[0])
        return np.array([y[1], ((force - spring * (now - length)) * arm - moment_of_motion(t, *y)) / boom.J])

    y = solve_ivp(rates, (0.0, 1.0), [0.3, 0.0], "Radau", rtol=1e-9, atol=1e-12, t_eval=run.t).y
    for computed, exact in zip(run.angle[:2], y, strict=True):
        assert np.abs(computed - exact).max() < 1e-4 * np.ptp(exact)


HINGES = f"foot={FOOT.tolist()}, lug={LUG.tolist()}"
BESIDE = "'rigid' is allowed beside frame.luffing = 'free'"


def supports(lug: str) -> str:
    """Key of a pin at the tail and a support across the boom whose keys `lug` says."""
    pin = "{name='pin', on='tail', directions=['x', 'y', 'z', 'rx', 'rz']}"
    return f"sections.base.supports=[{pin}, {{name='lug', directions=['z'], {lug}}}]"


#: Wrong keys, with what is said of them.
WRONG = {
    oil().replace("areas=[0.008", "areas=[0.0"): "frame.cylinder.oil.areas[0] = 0.0: input should be greater than 0",
    oil().replace(
        "stroke=[0.6", "stroke=[1.1"
    ): "frame.cylinder.stroke = [1.1, 1.3]: the length at luffing_start, 1.066 m",
    oil().replace(
        "1.3]", "2.3]"
    ): "frame.cylinder.stroke = [0.6, 2.3]: lengths between 0.4283 and 1.99 m are allowed: foot",
    f"frame.cylinder={{{HINGES}}}": "frame.cylinder: force, length or oil is needed beside frame.luffing = 'free'",
    "frame.cylinder={foot=[0.6, 0.1065], lug=[1.2, -0.15], force={kind='constant', amount=1.0}}": "an arm",
    f"frame.cylinder={{{HINGES}, stiffness=1e8}}": "frame.cylinder.stiffness: none is allowed beside",
    f"frame.cylinder={{{HINGES}, spring=1e8}}": "frame.cylinder.spring = 100000000.0: length and spring are allowed",
    oil("{kind='constant', amount=1.5}"): "frame.cylinder.oil.valve.opening = 1.5: openings from -1 to 1 are allowed",
    oil(
        "", "counterbalance={setting=1e7, ratio=3.0, range=1e6, gain=1e-7}"
    ): "none is allowed without valve: no oil flows",
    "frame.base.acceleration.z={kind='constant', amount=0.1}": "frame.base.acceleration: none is allowed beside",
    "frame.machine={mass=100.0}": "frame.machine: none is allowed beside frame.luffing = 'free'",
    "simulation.simulators=['exudyn']": "march is allowed: exudyn computes no motion that is free (luffing)",
    "sections.fly.loads=[{name='gust', acts='wind', signal=100.0}]": "loads[0].acts = 'wind': 'force' is allowed",
    "frame.second_order='auto'": "frame.second_order = 'auto': true or false is allowed beside frame.luffing = 'free'",
    free_boom.PUSHING[0]: "unilateral = True: false is allowed beside frame.luffing = 'free': pads that hold both ways",
    "frame.luffing={kind='constant', amount=0.3}": "frame.luffing_start = 0.3: frame.luffing = 'free' is needed",
    "sections.base.supports.0.stiffness=1e8": f"sections[0].supports[0].stiffness = 100000000.0: {BESIDE}",
    supports("stiffness=5e7, on=1.0"): f"sections[0].supports[1].stiffness = 50000000.0: {BESIDE}",
    supports("on=0.9"): "sections[0].supports[1].on = 0.9: 1 m from the tail, where frame.cylinder.lug is, is allowed",
    supports("on='tip'"): "sections[0].supports[1].on = 'tip': 1 m from the tail, where frame.cylinder.lug is",
    "compare.richer='shell'": "compare.richer = 'shell': 'auto' or 'none' is allowed beside frame.luffing,",
    oil().replace("[0.008, 0.005]", "[0.005, 0.008]"): "frame.cylinder.oil.areas = [0.005, 0.008]: [bore, rod side] ",
}


@pytest.mark.parametrize("key", WRONG)
def test_what_does_not_go_with_a_free_angle_is_refused_in_one_line(key: str) -> None:
    with pytest.raises(InputError) as refused:
        free_boom.scene(*RIGID, *([] if "frame.cylinder" in key else [oil()]), key)
    assert WRONG[key] in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_rigid_support_at_the_lug_is_allowed_beside_a_free_angle_and_a_soft_pin_at_the_pivot_too() -> None:
    """The tail of the boom is 0.2 m ahead of its pivot, the lug 1.2 m."""
    assert len(free_boom.scene(*RIGID, oil(), supports("on=1.0")).sections[0].supports) == 2
    soft = "sections.base.supports.0.stiffness=1e9"
    free_boom.scene(*RIGID, oil(), "frame.pivot=[0.0, 0.0, 0.0]", supports("on=1.2"), soft)


def test_cylinder_that_comes_in_line_with_the_pivot_ends_the_run_in_one_line() -> None:
    force = "{kind='constant', amount=9e3}"
    with pytest.raises(
        SimulationError, match=r"foot, lug and pivot of the luffing cylinder come in line at t = 0\.\d+ s"
    ):
        simulated(*RIGID, f"frame.cylinder={{{HINGES}, force={force}}}", "time.end=2.0")


def test_stops_end_the_stroke() -> None:
    """The boom falls on the lower stop, which carries it afterwards."""
    force = "{kind='constant', amount=0.0}"
    keys = (
        f"frame.cylinder={{{HINGES}, force={force}, stroke=[1.0, 1.3], stop_stiffness=1e8, damping=3e4}}",
        "time.rho_inf=0.9",
    )
    run = simulated(*RIGID, *keys, "time.end=1.5", "time.step=1e-3")
    length, arm = geometry(run.angle[0, -1])
    assert run.length[-1] < 1.0 < run.length[0]
    assert run.force[-1] == pytest.approx(-weight_moment(run.boom, run.angle[0, -1]) / arm, rel=1e-3)
    assert 1e8 * (1.0 - run.length[-1]) == pytest.approx(run.force[-1], rel=1e-2)
