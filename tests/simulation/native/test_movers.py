"""Forces, masses and carriages that cross a beam, beside series, modal equations and statics."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from textbook import beam_matrices

import pmr
from pmr import InputError, System
from pmr.files.arrays import Array
from pmr.scene import Scene
from pmr.scene.built import Gravity
from pmr.scene.checks import check_scene
from pmr.simulation import Excitation, exudyn
from pmr.simulation.native import systems

ENDS = ("tail", "tip")
LENGTH, EI, MASS, FORCE = 20.0, 1e9, 1000.0, 1e4  # m, N m^2, kg/m, N
#: Lowest circular frequency in rad/s, and the speed in m/s at which half its period takes as long as the crossing.
FIRST = (np.pi / LENGTH) ** 2 * np.sqrt(EI / MASS)
CRITICAL = FIRST * LENGTH / np.pi
STATIC = FORCE * LENGTH**3 / (48.0 * EI)  # m: of the force at midspan


def crossing(inner: Mapping[str, Any], path: Mapping[str, Any] | float, end: float, **more: Any) -> Scene:
    """Scene of a body that crosses a beam on two supports."""
    axial = {"axial": True, "axial_stiffness": 1e9} if more.pop("axial", False) else {}
    supports = [{"on": on, "kind": "pinned" if axial and on == "tail" else "roller"} for on in more.pop("held", ENDS)]
    profile = {"length": LENGTH, "bending_stiffness": EI, "mass_per_length": MASS, "tension": more.pop("tension", 0.0)}
    profile |= axial
    beam = {"name": "beam", "body": {"profile": profile}, "mesh": {"elements": 40}, "supports": supports}
    beam |= {"observe": {"start": 10.0, "end": 20.0, "count": 2}, "reduction": {"coordinates": 12}}
    joint = {"extension": path} | inner.pop("joint")  # type: ignore[attr-defined]
    time = {"end": end, "step": end / more.pop("steps", 2000), "rho_inf": 0.8}
    scene = {"title": "Crossing", "time": time, "start": "rest", "gravity": {"acceleration": 1e-9}} | more
    scene |= {"sections": [beam, {"name": "mover", "joint": joint, **inner}]}
    checked = Scene.model_validate(scene)
    check_scene(checked)
    return checked


def mover(path: Mapping[str, Any] | float, end: float, body: Mapping[str, float], **more: Any) -> Scene:
    """Scene of a mass on a rigid wheel."""
    ring = {"at": 0.0, "unilateral": more.pop("pushes", False), "stiffness": more.pop("wheel", "rigid")}
    wheel = {"tail": [ring | {"clearance": more.pop("clearance", 0.0)}]}
    loads = more.pop("loads", [])
    return crossing({"body": {"mover": body}, "joint": wheel, "loads": loads}, path, end, **more)


@dataclass(frozen=True)
class Motion:
    """Times (T,), deflection (T,) of midspan in m, and contact forces (T, m) in N."""

    t: Array
    midspan: Array
    mover: Array
    forces: Array


def reduced_motion(scene: Scene) -> Motion:
    """Motion of the scene's reduced system."""
    system, excitation = pmr.reduce(scene).system, Excitation.from_scene(scene)
    return motion_of(system, excitation, systems.simulate(system, excitation, start(scene, system, excitation)))


def start(scene: Scene, system: System, excitation: Excitation) -> Any:
    """Initial state of the system, as the scene says."""
    return systems.static_start(system, excitation) if scene.start == "equilibrium" else None


def motion_of(system: System, excitation: Excitation, trajectory: Any) -> Motion:
    """Motion of midspan and mover."""
    y = systems.displacements(system, trajectory)
    return Motion(excitation.times, y["beam"][:, 0], y["mover"][:, 0], trajectory.forces)


def path(end: float, first: float = 0.0, last: float = LENGTH) -> dict[str, Any]:
    """Path at constant speed."""
    return {"kind": "ramp", "times": [0.0, end], "values": [first, last]}


def fryba(alpha: float, t: Array, terms: int = 400, tension: float = 0.0) -> Array:
    """Deflection (T,) of midspan in m under a moving force, downwards (Fryba 1999, equation 1.31)."""
    n = np.arange(1, terms + 1)[:, None]
    omega = np.sqrt((n**2 * FIRST) ** 2 + tension / MASS * (n * np.pi / LENGTH) ** 2)
    Omega = n * np.pi * alpha * CRITICAL / LENGTH
    each = (np.sin(Omega * t) - Omega / omega * np.sin(omega * t)) / (omega**2 - Omega**2)
    return np.asarray(2.0 * FORCE / (MASS * LENGTH) * np.sum(np.sin(n * np.pi / 2.0) * each, axis=0))


@pytest.mark.slow
def test_a_moving_force_is_frybas_series_and_amplified_most_at_0617_of_the_critical_speed() -> None:
    alpha = 0.617
    end = LENGTH / (alpha * CRITICAL)
    load = {"on": "tip", "signal": {"kind": "constant", "amount": -FORCE}}
    of = reduced_motion(mover(path(end), end, {"mass": 1e-6}, loads=[load], steps=4000))
    series = fryba(alpha, of.t)
    assert np.abs(of.midspan + series).max() < 1e-5 * np.abs(series).max()
    peaks = {a: np.abs(fryba(a, np.linspace(0.0, LENGTH / (a * CRITICAL), 4001), 60)).max() for a in (0.6, alpha, 0.63)}
    assert max(peaks, key=lambda a: peaks[a]) == alpha
    assert -of.midspan.min() / STATIC == pytest.approx(1.73166, abs=2e-5)
    assert np.abs(of.forces - FORCE).max() < 1e-6 * FORCE


@pytest.mark.slow
@pytest.mark.parametrize("alpha", [0.1, 0.3])
def test_a_moving_force_at_other_speeds_is_frybas_series(alpha: float) -> None:
    end = LENGTH / (alpha * CRITICAL)
    load = {"on": 0.0, "signal": {"kind": "constant", "amount": -FORCE}}
    of = reduced_motion(mover(path(end), end, {"mass": 1e-6}, loads=[load], steps=16000))
    series = fryba(alpha, of.t)
    assert np.abs(of.midspan + series).max() < 1e-4 * np.abs(series).max()


@pytest.mark.slow
def test_a_force_on_a_tensioned_wire_is_the_series_with_its_frequencies() -> None:
    tension, alpha = 1e8, 0.5  # the tension's share of the first squared frequency is four times that of bending
    end = LENGTH / (alpha * CRITICAL)
    load = {"on": "tip", "signal": {"kind": "constant", "amount": -FORCE}}
    of = reduced_motion(mover(path(end), end, {"mass": 1e-6}, loads=[load], steps=4000, tension=tension))
    series = fryba(alpha, of.t, tension=tension)
    assert np.abs(of.midspan + series).max() < 1e-4 * np.abs(series).max()


def test_a_tension_that_nothing_holds_is_refused() -> None:
    ends = "unless rigid supports hold tail and tip along z"
    with pytest.raises(InputError, match=ends):
        mover(1.0, 1.0, {"mass": 1.0}, tension=1.0, held=["tail"])


def modal_motion(
    t: Array,
    speed: float,
    body: Mapping[str, float],
    gravity: float,
    modes: int = 8,
    lift: Callable[[float], float] | None = None,
) -> tuple[Array, Array]:
    """Deflections (T,) of midspan and of a mover that enters at rest, in m, by modal equations of the beam.

    A rigid mover adds its mass at the wheel, with all convective terms.  A sprung one has the wheel's mass there, and
    spring and damper to the mass above.  The weight of beam and mover acts from t = 0.  If a force `lift` in N over
    time pulls the mass up, its spring only pushes.
    """
    n = np.arange(1, modes + 1)
    wave, m = n * np.pi / LENGTH, MASS * LENGTH / 2.0
    stiffness, k, d = m * (n**2 * FIRST) ** 2, body.get("stiffness", 0.0), body.get("damping", 0.0)
    wheel = body.get("wheel_mass", 0.0) + (0.0 if k else body["mass"])
    weight = -MASS * gravity / wave * (1.0 - np.cos(n * np.pi))

    def rates(t: float, y: Array) -> Array:
        q, v = y[:modes], y[modes : 2 * modes]
        x = speed * t
        phi, slope, curve = np.sin(wave * x), wave * np.cos(wave * x), -(wave**2) * np.sin(wave * x)
        carried = -wheel * gravity - wheel * (2.0 * speed * slope @ v + speed**2 * curve @ q)
        above = []
        if k:
            z, rate = y[2 * modes :]
            spring = k * (z - phi @ q) + d * (rate - phi @ v - speed * slope @ q)
            spring = spring if lift is None else min(spring, 0.0)
            carried += spring
            above = [rate, -gravity - (spring - (lift(t) if lift else 0.0)) / body["mass"]]
        A = m * np.eye(modes) + wheel * np.outer(phi, phi)
        return np.concatenate([v, np.linalg.solve(A, weight + phi * carried - stiffness * q), above])

    y0 = np.zeros(2 * modes + (2 if k else 0))
    solved = solve_ivp(rates, (0.0, t[-1]), y0, "DOP853", t, rtol=1e-8, atol=1e-11, max_step=t[-1] / 500.0)
    x = np.outer(wave, speed * t)
    above = solved.y[2 * modes] if k else np.sum(np.sin(x) * solved.y[:modes], axis=0)
    return np.asarray(np.sin(n * np.pi / 2.0) @ solved.y[:modes]), above


@pytest.mark.parametrize(
    "body",
    [{"mass": 4000.0}, {"mass": 4000.0, "wheel_mass": 500.0, "stiffness": 2e6, "damping": 2e4}],
    ids=["mass", "sprung mass with damper"],
)
@pytest.mark.slow
def test_a_moving_mass_is_that_of_modal_equations(body: dict[str, float]) -> None:
    speed, gravity = 0.3 * CRITICAL, 9.81
    end = LENGTH / speed
    of = reduced_motion(mover(path(end), end, body, gravity={"acceleration": gravity, "rise": 0.0}, steps=8000))
    expected, above = modal_motion(of.t[::20], speed, body, gravity)
    assert np.abs(of.midspan[::20] - expected).max() < 1e-3 * np.abs(expected).max()
    assert np.abs(of.mover[::20] - above).max() < 1e-3 * np.abs(above).max()


@pytest.mark.slow
def test_a_wheel_that_only_pushes_lifts_off_and_lands() -> None:
    """A force of up to twice the weight pulls the mass off the beam, which swings on by itself."""
    speed, gravity, mass, k = 0.3 * CRITICAL, 9.81, 4000.0, 1e7
    end = LENGTH / speed
    pull = {"kind": "ramp", "times": [0.4 * end, 0.45 * end, 0.5 * end], "values": [0.0, 2.0 * mass * gravity, 0.0]}
    scene = mover(
        path(end), end, {"mass": mass}, wheel=k, pushes=True, loads=[{"on": "tip", "signal": pull}], steps=8000,
        gravity={"acceleration": gravity, "rise": 0.0},
    )  # fmt: skip
    of, signal = reduced_motion(scene), scene.sections[1].loads[0].signal
    body = {"mass": mass, "stiffness": k}
    expected, above = modal_motion(of.t[::20], speed, body, gravity, lift=lambda t: float(signal.value(t)))
    assert np.abs(of.midspan[::20] - expected).max() < 1e-3 * np.abs(expected).max()
    assert np.abs(of.mover[::20] - above).max() < 1e-3 * np.abs(above).max()
    assert of.forces.shape[1] == 1 and of.forces.min() == 0.0 < 0.1 < np.mean(of.forces == 0.0) < 0.5


def test_a_wheel_with_play_runs_in_a_rail() -> None:
    held = [reduced_motion(mover(5.0, 0.01, {"mass": 1.0}, steps=2, pushes=True, clearance=x)) for x in (0.0, 0.01)]
    assert [of.forces.shape[1] for of in held] == [1, 2]


@pytest.mark.parametrize("stiffness", [2e6, "rigid"])
def test_a_vehicle_on_a_slope_passes_its_weight_on_to_the_bridge(stiffness: float | str) -> None:
    """The drive has the weight along the slope and what accelerates the vehicle, the wheel has the weight across."""
    times = np.linspace(0.0, 2.0, 5)
    go = {"kind": "table", "times": times.tolist(), "values": (5.0 + times**2).tolist()}
    body = {"mass": 4000.0, "wheel_mass": 500.0, "stiffness": stiffness}
    wheel = {"tail": [{"at": 0.0, "stiffness": 1e9}]}
    weight = {"acceleration": 10.0, "inclination": 30.0, "rise": 0.0}
    inner = {"body": {"mover": body}, "joint": wheel}
    scene = crossing(inner, go, 1.0, steps=100, start="equilibrium", gravity=weight, axial=True)
    system, excitation = pmr.reduce(scene).system, Excitation.from_scene(scene)
    forces = systems.simulate(system, excitation, start(scene, system, excitation)).forces
    driven = forces[:, [contact.name for contact in system.contacts].index("cylinder of mover")]
    assert driven == pytest.approx(4500.0 * (5.0 + 2.0) * np.ones(101), rel=1e-9)
    assert forces[0].max() == pytest.approx(4500.0 * 10.0 * np.sqrt(0.75), rel=1e-9)


def carriage(*wheels: float, x: float, stiffness: float | str = "rigid", **more: Any) -> Scene:
    """Scene of a rigid carriage of 4 m and 2,000 kg that stands with its tail at x on wheels at these places of it."""
    rigid = {"profile": {"length": 4.0, "bending_stiffness": 1e15, "mass_per_length": 500.0}}
    ring = {"unilateral": False, "stiffness": stiffness}
    rings = [ring | {"name": f"wheel {k}", "at": at} for k, at in enumerate(wheels)]
    inner = {"body": rigid, "mesh": {"elements": 4}, "reduction": {"coordinates": 2}, "joint": {"tail": rings}}
    loads = [{"on": 3.0, "signal": {"kind": "constant", "amount": -FORCE}}]
    inner |= {"loads": loads, "observe": {"start": 0.0, "end": 4.0, "count": 2}}
    weight = {"acceleration": 10.0, "rise": 0.0}
    return crossing(inner, x, 0.01, start="equilibrium", gravity=weight, steps=10, **more)


def compliance(x: Array) -> Array:
    """Deflections (k, k) in m at x (k,) in m by unit forces there, of a beam on two supports."""
    a, b = np.minimum.outer(x, x), LENGTH - np.maximum.outer(x, x)
    return np.asarray(a * b * (LENGTH**2 - a**2 - b**2) / (6.0 * EI * LENGTH))


@pytest.mark.slow
def test_the_wheels_of_a_carriage_bear_what_statics_say() -> None:
    of = reduced_motion(carriage(0.5, 3.5, x=6.0))
    weight, front = 2000.0 * 10.0, (2000.0 * 10.0 * 1.5 + FORCE * 2.5) / 3.0
    assert of.forces[0] == pytest.approx([weight + FORCE - front, front], rel=1e-6)
    under = compliance(np.array([6.5, 9.5, 10.0]))[2, :2] @ of.forces[0]
    own = 5.0 * MASS * 10.0 * LENGTH**4 / (384.0 * EI)
    assert -of.midspan[0] == pytest.approx(under + own, rel=1e-6)


@pytest.mark.slow
def test_four_wheels_share_a_load_as_springs_on_the_beam_do() -> None:
    x, k = np.array([0.0, 1.0, 3.0, 4.0]), 2e8
    of = reduced_motion(carriage(*x, x=5.0, stiffness=k))
    sag = own_sag(5.0 + x)
    A = compliance(5.0 + x) + np.eye(4) / k
    # wheels: z + theta x = -(A lambda + sag), with the sums of forces and moments
    rigid = np.column_stack([np.ones(4), x])
    system = np.block([[A, rigid], [rigid.T, np.zeros((2, 2))]])
    load = [2000.0 * 10.0 + FORCE, 2000.0 * 10.0 * 2.0 + FORCE * 3.0]
    expected = np.linalg.solve(system, np.concatenate([-sag, load]))
    assert of.forces[0] == pytest.approx(expected[:4], rel=1e-6)


def own_sag(x: Array) -> Array:
    """Deflection (k,) in m at x (k,) in m by the beam's own weight."""
    return np.asarray(MASS * 10.0 * x * (LENGTH**3 - 2.0 * LENGTH * x**2 + x**3) / (24.0 * EI))


@pytest.mark.slow
@pytest.mark.parametrize("way", ["springs", "multipliers"])
def test_exudyn_moves_a_sprung_mass_as_the_compiled_simulator_does(way: Literal["springs", "multipliers"]) -> None:
    pytest.importorskip("exudyn")
    body = {"mass": 4000.0, "wheel_mass": 500.0, "stiffness": 2e6, "damping": 2e4}
    end = LENGTH / (0.3 * CRITICAL)
    scene = mover(path(end), end, body, wheel=1e9, start="equilibrium", gravity={"rise": 0.0}, steps=50)
    system, excitation = pmr.reduce(scene).system, Excitation.from_scene(scene)
    initial = start(scene, system, excitation)
    ours = motion_of(system, excitation, systems.simulate(system, excitation, initial))
    theirs = exudyn.simulate_system(system, excitation, initial, formulation=way)
    assert motion_of(system, excitation, theirs).mover == pytest.approx(ours.mover, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"body": {"mover": {"mass": 1.0, "stiffness": 1.0}}}, "needs wheel_mass"),
        ({"body": {"mover": {"mass": 1.0, "damping": 1.0}}}, "needs a stiffness"),
        ({"joint": {"tail": [{"at": 0.5}]}}, "one ring in `tail`, at = 0"),
        ({"joint": {"tail": [{"at": 0.0}, {"at": 0.1, "name": "b"}]}}, "one ring in `tail`, at = 0"),
        ({"supports": [{"kind": "roller"}]}, "none is allowed on a mover"),
        ({"body": {"mover": {"mass": 1.0}, "thickness": 0.1}}, "body.thickness: none is allowed on a mover"),
        ({"body": {"mover": {"mass": 1.0}, "walls": "give"}}, "body.walls = 'give': 'rigid' is allowed on a mover"),
        ({"loads": [{"direction": "x", "signal": 1.0}]}, "z is allowed on a mover"),
    ],
)
def test_a_mover_that_can_not_be_is_refused(change: dict[str, Any], said: str) -> None:
    plain = {"body": {"mover": {"mass": 1.0}}, "joint": {"tail": [{"at": 0.0}]}}
    with pytest.raises((InputError, ValueError), match=said):
        crossing(plain | change, 1.0, 1.0)


def test_a_load_on_a_place_that_a_mover_lacks_is_refused() -> None:
    load = {"name": "force", "on": "middle", "direction": "z", "signal": 1.0}
    scene = mover(path(1.0), 1.0, {"mass": 1.0}, loads=[load])
    with pytest.raises(InputError, match="place = 'middle': tail, tip or a number is allowed on a mover"):
        pmr.reduce(scene)


def test_a_wheel_that_leaves_the_beam_is_refused() -> None:
    with pytest.raises(InputError, match="the whole pad has to be on it"):
        mover(path(1.0, 0.0, 21.0), 1.0, {"mass": 1.0})


def on_rail(
    rail: Mapping[str, Any],
    body: Mapping[str, Any],
    faces: Mapping[str, Any],
    start: float = 6.0,
    length: float = 0.01,
    width: float = 0.01,
    **more: Any,
) -> Scene:
    """Scene of a carriage of 4 m with short pads 0.5 m from its ends that is `start` m from the tail of a rail."""
    pad = {"length": length, "width": width, "unilateral": False, "stiffness": 2e3, "faces": faces}
    tail = [{"name": name, "at": at} | pad for name, at in (("rear", 0.5), ("front", 3.5))]
    go = {"kind": "ramp", "times": [0.0, 0.002], "values": [start, start + 0.002]}
    joint = {"extension": go, "tail": tail}
    carriage = {"name": "carriage", "joint": joint, "observe": {"start": 0.5, "end": 3.5}} | body | more
    sections = [{"name": "rail", "observe": {"start": 1.0, "end": 19.0}} | rail, carriage]
    time = {"end": 0.002, "step": 1e-3}
    return Scene.model_validate({"title": "Rail", "time": time, "start": "rest", "sections": sections})


def beam_in_space(a: Array, b: Array, EI: float) -> tuple[Array, Array]:
    """Stiffness and mass (12, 12) of a Bernoulli beam from a to b (3,) m with EI in both planes, by the textbook."""
    EA, GJ, mass, inertia, x = 1e6, EI / 2.0, 10.0, 0.1, b - a
    h = float(np.linalg.norm(x))
    axes = np.array([x / h, np.cross([0.0, 0.0, 1.0], x / h), [0.0, 0.0, 1.0]])
    K, M = np.zeros((12, 12)), np.zeros((12, 12))
    for d, stiffness, per_length in ((0, EA, mass), (3, GJ, inertia)):
        K[np.ix_([d, d + 6], [d, d + 6])] = stiffness / h * np.array([[1.0, -1.0], [-1.0, 1.0]])
        M[np.ix_([d, d + 6], [d, d + 6])] = per_length * h / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
    plane_M, plane_K = (A[np.ix_([1, 2, 4, 5], [1, 2, 4, 5])] for A in beam_matrices(np.array([0.0, h]), EI, EA, mass))
    for at, sign in (([1, 5, 7, 11], 1.0), ([2, 4, 8, 10], -1.0)):
        turned = np.outer([1.0, sign, 1.0, sign], [1.0, sign, 1.0, sign])
        K[np.ix_(at, at)], M[np.ix_(at, at)] = turned * plane_K, turned * plane_M
    T = np.kron(np.eye(4), axes)
    return T.T @ K @ T, T.T @ M @ T


@pytest.mark.slow
@pytest.mark.parametrize("joined", [True, False], ids=["joined", "apart"])
def test_a_scene_has_four_wheels_on_two_rails(joined: bool, tmp_path: Path) -> None:
    """The rails are matrices of beams; a rigid carriage has a load off its middle and a moment.

    Rails that nothing joins have their supports inside the matrices, with the rotation about their axis.
    """
    cells, y, k, EI = 40, 0.6000051, 2e3, 100.0  # wheels are at 0.6 m, where pads just fit on the face
    x = np.linspace(0.0, LENGTH, cells + 1)
    points = np.array([[at, side, 0.0] for side in (-y, y) for at in x])
    beams = [(i, i + 1) for first in (0, cells + 1) for i in range(first, first + cells)]
    K, M = np.zeros((6 * len(points),) * 2), np.zeros((6 * len(points),) * 2)
    ties = [(0, cells + 1), (cells, 2 * cells + 1)] if joined else []
    for i, j in (*beams, *ties):
        at = np.r_[6 * i : 6 * i + 6, 6 * j : 6 * j + 6]
        for A, part in zip((K, M), beam_in_space(points[i], points[j], EI), strict=True):
            A[np.ix_(at, at)] += part
    groups = {"tail": points[:, 0] == 0.0, "tip": points[:, 0] == LENGTH, "bottom": points[:, 0] >= 0.0}
    held = [6 * n + d for n in np.flatnonzero(groups["tail"]) for d in ((0, 1, 2) if joined else (0, 1, 2, 3))]
    held += [6 * n + d for n in np.flatnonzero(groups["tip"]) for d in (1, 2)]
    free = np.setdiff1d(np.arange(len(K)), held)
    rows = np.arange(len(K)) if joined else free
    given = (M[np.ix_(rows, rows)], K[np.ix_(rows, rows)])
    pmr.from_matrices(*given, points, groups, rows // 6, rows % 6).save(tmp_path / "rails.npz")
    ends = [{"directions": ["x", "y", "z"]}, {"on": "tip", "directions": ["y", "z"]}] if joined else []
    rails = {"body": {"model": "matrices"}, "mesh": {"file": str(tmp_path / "rails.npz")}}
    rails |= {"supports": [end | {"points": "all"} for end in ends], "reduction": {"coordinates": 20}}
    box = {"length": 4.0, "width": 1.4, "height": 0.5, "wall": 0.05}
    car = {"body": {"box": box, "material": {"young": 2e12}, "model": "beam3d"}, "reduction": {"coordinates": 8}}
    car["supports"] = [{"directions": ["y"]}, {"on": "tip", "directions": ["y"]}]
    car["loads"] = [{"name": "force", "on": 3.0, "signal": -1000.0}]
    car["loads"] += [{"name": "moment", "on": 3.0, "direction": "rx", "signal": 200.0}]
    faces = {"bottom": [-0.6, 0.6]}
    scene = on_rail(rails, car, faces, start=6.25, length=0.02, width=1e-5)
    scene = scene.model_copy(update={"start": "equilibrium", "gravity": Gravity(acceleration=1e-9, rise=0.0)})
    response = pmr.simulate(scene, pmr.reduce(scene).system)
    wheels = [(at, side) for at in (0, 1) for side in (0, 1)]
    rows = np.zeros((4, len(K)))  # each wheel is amid two nodes
    for row, (at, side) in zip(rows, wheels, strict=True):
        node = side * (cells + 1) + int((6.75 + 3.0 * at) / LENGTH * cells)
        row[[6 * node + 2, 6 * node + 8]] = 0.5
    A = rows[:, free] @ np.linalg.solve(K[np.ix_(free, free)], rows[:, free].T) + np.eye(4) / k
    rigid = np.array([[1.0, 0.5 + 3.0 * at, 1.2 * side - 0.6] for at, side in wheels])
    full = np.block([[A, rigid], [rigid.T, np.zeros((3, 3))]])
    expected = np.linalg.solve(full, [0.0, 0.0, 0.0, 0.0, 1000.0, 3000.0, -200.0])[:4]
    assert response.slider_force[0, :4] == pytest.approx(expected, abs=1e-6 * np.abs(expected).max())
