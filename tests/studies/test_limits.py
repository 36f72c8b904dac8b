"""Loads that limits allow, beside closed forms: cantilevers to second order, pads and tipping of what is rigid."""

from types import SimpleNamespace

import numpy as np
import plain_machines
import pytest
from chart_beside_full import arrays_at_rest, at_rest, crane
from numpy.typing import ArrayLike
from scipy.integrate import quad, solve_ivp
from scipy.linalg import eigh
from scipy.optimize import brentq
from textbook import beam_matrices

from pmr import InputError
from pmr.compare.outputs import run_from_start
from pmr.files import npz
from pmr.reduction.bodies import join_bodies, reduce_bodies
from pmr.results.quantities import Columns, von_mises_stress
from pmr.scene import Load, Scene, load_any
from pmr.scene.ground import Ground, MachineMass
from pmr.scene.mechanism import CYLINDER
from pmr.scene.signals import Constant, SignalBase
from pmr.scene.structures import PointMass
from pmr.simulation import Excitation
from pmr.simulation.native import systems
from pmr.simulation.statics.postures import (
    HOISTED,
    HOOK,
    MACHINE_WEIGHT,
    WEIGHT,
    DeflectionOutputs,
    PostureMatrices,
    with_hook,
)
from pmr.studies import tasks
from pmr.studies.allowed import Place, allowed_loads, large_rotation_changes
from pmr.studies.chart_models import ComparedModel
from pmr.studies.chart_points import StopMotion, governing_details, largest_governed_rows
from pmr.studies.charting import MARGIN, Chart, case_amount, governing_limit
from pmr.studies.duty import ChartLoads
from pmr.studies.limits import KINDS, Limit, with_fields
from pmr.system.body import kinds_of
from pmr.system.terms import carried_inertia

pytestmark = pytest.mark.slow

G, L, HEIGHT, WIDTH, WALL, E = 9.80665, 6.0, 0.32, 0.22, 0.006, 210e9
BOX = {"length": L, "width": WIDTH, "height": HEIGHT, "wall": WALL}
HINGES = {"foot": [0.5, -1.0], "lug": [1.5, -0.2]}
PROBE = {"name": "root", "at": [0.0, 0.0, HEIGHT / 2.0], "measures": ["stress"]}


A = (WIDTH + WALL) * (HEIGHT + WALL) - (WIDTH - WALL) * (HEIGHT - WALL)
I = ((WIDTH + WALL) * (HEIGHT + WALL) ** 3 - (WIDTH - WALL) * (HEIGHT - WALL) ** 3) / 12.0
I_SIDEWAYS = ((HEIGHT + WALL) * (WIDTH + WALL) ** 3 - (HEIGHT - WALL) * (WIDTH - WALL) ** 3) / 12.0


def cantilever(density: float, elements: int, coordinates: int = 6) -> Scene:
    """A planar box that is clamped at its tail, with a probe on top of it."""
    return Scene.model_validate(
        {
            "title": "cantilever",
            "gravity": {},
            "frame": {
                "pivot": [0.0, 0.0, 0.0],
                "luffing": {"kind": "constant", "amount": 0.0},
                "cylinder": HINGES,
                "second_order": True,
            },
            "sections": [
                {
                    "name": "boom",
                    "body": {
                        "model": "beam3d",
                        "box": BOX,
                        "shear": False,
                        "material": {"young": E, "density": density},
                    },
                    "mesh": {"elements": elements},
                    "supports": [{"on": "tail", "kind": "clamped"}],
                    "pads": [{"name": "none", "moving": True, "faces": {"top": [0.0]}, "stiffness": 1e-3}],
                    "slider": {"path": {"kind": "constant", "amount": 3.0}},
                    "probes": [PROBE],
                    "reduction": {"coordinates": coordinates},
                }
            ],
            "time": {"end": 1.0, "step": 0.01},
        }
    )


def loads(limits: list[Limit], at: PostureMatrices, k: int = 0, up_to: float = 1e6, **amounts: float) -> np.ndarray:
    """Allowed loads, in kg."""
    acting = {WEIGHT: 1.0, MACHINE_WEIGHT: 1.0, HOOK: 1.0} | amounts
    return allowed_loads(limits, Place(at, k, [acting.get(part, 0.0) for part in at.loads.names], G), up_to)


@pytest.fixture(scope="module")
def level() -> PostureMatrices:
    return at_rest(cantilever(7850.0, 100, 24), [0.0])


def test_stress_and_deflection_under_the_weight(level: PostureMatrices) -> None:
    """M = P g (L - x) + q (L - x)^2 / 2 and w = P g L^3 / 3 EI + q L^4 / 8 EI; moments are linear in an element."""
    limits = [Limit(name="a", of="stress", most=200e6, factor=1.5), Limit(name="b", of="deflection", most=0.06)]
    stress, deflection, stability = loads(limits, level)
    q = 7850.0 * A * G
    at_root = 200e6 / 1.5 * I / ((HEIGHT + WALL) / 2.0)
    assert stress == pytest.approx((at_root - q * L**2 / 2.0) / (L * G), rel=1e-5)
    assert deflection == pytest.approx((0.06 * E * I - q * L**4 / 8.0) * 3.0 / L**3 / G, rel=1e-6)
    assert np.isnan(stability)
    factored = loads(limits, level, **{HOOK: 2.0, WEIGHT: 0.0})
    assert factored[1] == pytest.approx(0.06 * E * I * 3.0 / L**3 / G / 2.0, rel=1e-6)
    beside_others = loads(limits, level, **{HOOK: 2.0, HOISTED: 150.0})
    assert beside_others[:2] == pytest.approx((np.array([stress, deflection]) - 150.0) / 2.0, rel=1e-6)


@pytest.fixture(scope="module")
def raised() -> PostureMatrices:
    return at_rest(cantilever(1e-6, 40, 24), [0.3, 1.4, np.pi / 2.0, -0.3])


def berry(load: float, angle: float) -> tuple[float, float]:
    """Tip deflection in m and moment at the root in N m of a massless cantilever raised by an angle: beam column."""
    N, Q = load * G * np.sin(angle), load * G * np.cos(angle)
    u = L * np.sqrt(N / (E * I))
    return Q * L**3 / (E * I) * (np.tan(u) - u) / u**3, Q * L * np.tan(u) / u


def test_deflection_and_stress_to_second_order_are_those_of_a_beam_column(raised: PostureMatrices) -> None:
    """Berry's functions; the probe is where the axial force takes away from the stress."""
    limits = [Limit(name="a", of="stress", most=400e6), Limit(name="b", of="deflection", most=0.5)]
    for k, angle in enumerate((0.3, 1.4)):
        stress, deflection, _ = loads(limits, raised, k)
        assert berry(deflection, angle)[0] == pytest.approx(0.5, rel=1e-3)
        pressed = stress * G * np.sin(angle) / A
        assert berry(stress, angle)[1] * (HEIGHT + WALL) / 2.0 / I - pressed == pytest.approx(400e6, rel=1e-3)


def elastica(bent: float) -> float:
    """P L^2 / E I of an end load that keeps its direction and bends a cantilever by a share of its length."""

    def tip(load: float) -> float:
        def rates(_: float, y: np.ndarray) -> np.ndarray:
            return np.array([y[1], -load * np.cos(y[0])])

        def at_end(curvature: float) -> np.ndarray:
            return np.asarray(solve_ivp(rates, (0.0, 1.0), [0.0, curvature], rtol=1e-10, atol=1e-12).y[:, -1])

        root = brentq(lambda curvature: at_end(curvature)[1], 0.0, 2.0 * load)
        found = solve_ivp(rates, (0.0, 1.0), [0.0, root], rtol=1e-10, atol=1e-12, dense_output=True)
        return float(quad(lambda s: np.sin(found.sol(s)[0]), 0.0, 1.0)[0])

    return float(brentq(lambda load: tip(load) - bent, 0.5 * bent, 6.0 * bent))


@pytest.mark.parametrize("share", [0.05, 0.15, 0.3])
def test_large_rotations_are_within_their_part_of_the_error_bar(share: float) -> None:
    """Euler's elastica beside what is linear, of which the bar is not twice what it has to be; at no angle."""
    at = at_rest(cantilever(1e-6, 10), [0.0])
    place, limits = (
        Place(at, 0, [float(part != HOISTED) for part in at.loads.names], G),
        [Limit(name="b", of="deflection", most=share * L)],
    )
    found = allowed_loads(limits, place, 1e9)
    exact = elastica(share) * E * I / L**2 / G
    bar, _ = MARGIN * large_rotation_changes(limits, place, found, L)
    assert found[0] < exact <= found[0] + bar <= found[0] + 2.0 * (exact - found[0])


def test_a_stop_of_luffing_swings_a_load_on_a_massless_boom() -> None:
    """2 sin(omega T / 2) times P alpha L^4 / 3 EI, omega^2 = 3 EI / m L^3; twice that from half a period on."""
    scene = cantilever(1e-6, 10)
    arrays, mass, speed = arrays_at_rest(scene, [0.0]), 2000.0, 0.05
    at = at_rest(scene, [0.0])
    place, omega = (
        Place(at, 0, [float(part != HOISTED) for part in at.loads.names], G),
        np.sqrt(3.0 * E * I / (mass * L**3)),
    )
    limit = Limit(name="tip", of="deflection", most=1.0)
    weight = mass * G * L**3 / (3.0 * E * I)
    for share in (0.1, 0.3, 0.5, 1.7):
        within = share * 2.0 * np.pi / omega
        found = StopMotion("luffing", speed, within, arrays["turned.luffing"]).stop_figures(place, mass, limit)
        factor, steady = 2.0 * np.sin(min(share, 0.5) * np.pi), mass * speed / within * L**4 / (3.0 * E * I)
        assert found[0] == pytest.approx(factor, rel=2e-3)
        assert found[1:] == pytest.approx([weight, weight + steady, weight + factor * steady, speed], rel=2e-3)


def turning(density: float, coordinates: int = 24) -> Scene:
    """The cantilever on a frame that can also slew."""
    scene = cantilever(density, 30, coordinates)
    assert scene.frame is not None
    return scene.model_copy(update={"frame": scene.frame.model_copy(update={"slewing": Constant(amount=0.0)})})


def lateral(pressed: float, within: float) -> tuple[float, float]:
    """Largest and steady tip deflection in m of a cantilever that N presses, by rho A x until `within`, then nothing.

    By Hermite elements and their modes, without damping: M q'' + (K - N G) q = M r, r the rotation of a rigid beam.
    """
    nodes = np.linspace(0.0, L, 31)
    M, K = beam_matrices(nodes, E * I_SIDEWAYS, 1.0, 7850.0 * A)
    G, h = np.zeros_like(K), nodes[1]
    one = np.array([[36, 3, -36, 3], [3, 4, -3, -1], [-36, -3, 36, -3], [3, -1, -3, 4]]) / (30.0 * h)
    for e in range(30):
        at = 3 * e + np.array([1, 2, 4, 5])
        G[np.ix_(at, at)] += np.outer([1.0, h, 1.0, h], [1.0, h, 1.0, h]) * one
    rigid = np.column_stack([0.0 * nodes, nodes, 1.0 + 0.0 * nodes]).ravel()
    across = np.arange(3, 93)[np.arange(3, 93) % 3 > 0]
    omega2, shapes = eigh((K - pressed * G)[np.ix_(across, across)], M[np.ix_(across, across)])
    tip = shapes[-2] * (shapes.T @ (M @ rigid)[across]) / omega2
    t = np.linspace(0.0, within + 4.0 * np.pi / np.sqrt(omega2[0]), 4000)[:, None]
    moved = 1.0 - np.cos(np.sqrt(omega2) * t)
    moved -= (t > within) * (1.0 - np.cos(np.sqrt(omega2) * np.maximum(t - within, 0.0)))
    return float(np.abs(moved @ tip).max()), float(tip.sum())


@pytest.mark.parametrize(("angle", "mass"), [(0.0, 500.0), (0.9, 30e3)])
def test_a_stop_of_slewing_swings_the_boom_sideways_and_leaves_the_load_behind(angle: float, mass: float) -> None:
    """Its own mass swings, softer where the load presses along it, and beside what the load bends down."""
    scene, speed = turning(7850.0), 0.05
    arrays, at = arrays_at_rest(scene, [angle]), at_rest(scene, [angle])
    place = Place(at, 0, [float(part not in (WEIGHT, HOISTED)) for part in at.loads.names], G)
    down = berry(mass, angle)[0] if angle else mass * G * L**3 / (3.0 * E * I)
    for within in (0.01, 0.05, 0.3, 5.0):
        found = StopMotion("slewing", speed, within, arrays["turned.slewing"]).stop_figures(
            place, mass, Limit(name="tip", of="deflection", most=1.0)
        )
        most, steady = lateral(mass * G * np.sin(angle), within)
        rate = speed / within * np.cos(angle)
        expected = [down, np.hypot(down, rate * steady), np.hypot(down, rate * most), speed]
        assert found[0] == pytest.approx(most / steady, rel=2e-3)
        assert found[1:] == pytest.approx(expected, rel=2e-3)


class Braked(SignalBase):
    """An angle in rad that grows by a speed until `at`, ever slower until `at` + `within`, and stays 0."""

    speed: float
    at: float
    within: float

    def value(self, t: ArrayLike) -> np.ndarray:
        left = self._left(t)
        return np.asarray(-self.speed * (self.within * left**2 / 2.0 + np.maximum(self.at - np.asarray(t), 0.0)))

    def rate(self, t: ArrayLike) -> np.ndarray:
        return self.speed * self._left(t)

    def second_rate(self, t: ArrayLike) -> np.ndarray:
        left = self._left(t)
        return np.where((left < 1.0) & (left > 0.0), -self.speed / self.within, 0.0)

    def _left(self, t: ArrayLike) -> np.ndarray:
        """Share of the speed that is left."""
        return np.clip((self.at + self.within - np.asarray(t)) / self.within, 0.0, 1.0)

    @property
    def breaks(self) -> tuple[float, ...]:
        return self.at, self.at + self.within


@pytest.mark.parametrize(("of", "direction", "within"), [("luffing", "z", 0.15), ("slewing", "y", 0.04)])
def test_a_stop_that_is_simulated_moves_the_tip_as_the_chart_has_it(of: str, direction: str, within: float) -> None:
    """The same motion of the frame on the compiled simulator, the load a mass that luffs or a force that stays behind.

    The chart neglects what rotates at speed, L speed^2 / g = 0.2 % of the weight, and takes the angle as it is at the
    end, 0.006 rad further.  Measured: 0.02 % and 0.16 % apart.
    """
    scene, mass, speed, at = turning(7850.0, 12), 400.0, 0.05, 0.05
    arrays, here = arrays_at_rest(scene, [0.0]), at_rest(scene, [0.0])
    place, limit = (
        Place(here, 0, [float(part != HOISTED) for part in here.loads.names], G),
        Limit(name="tip", of="deflection", most=1.0),
    )
    found = StopMotion(of, speed, within, arrays[f"turned.{of}"]).stop_figures(place, mass, limit)
    pull = Load(name="load", on="tip", direction="z", axes="ground", signal=Constant(amount=-mass * G))
    hung = {"masses": (PointMass(name="load", on="tip", mass=mass),)} if of == "luffing" else {"loads": (pull,)}
    assert scene.frame is not None and scene.gravity is not None
    moving = scene.model_copy(
        update={
            "frame": scene.frame.model_copy(update={of: Braked(speed=speed, at=at, within=within)}),
            "sections": (scene.sections[0].model_copy(update=hung),),
            "start": "equilibrium",
            "gravity": scene.gravity.model_copy(update={"rise": 0.0}),
            "time": scene.time.model_copy(update={"end": 0.6, "step": 2e-4, "rho_inf": 1.0}),
        }
    )
    system = join_bodies(moving, reduce_bodies(moving, tasks.bodies_of(moving)))
    run = run_from_start(system, Excitation.from_scene(moving))
    ((name, body),) = system.bodies.items()
    tip = systems.displacements(system, run)[name][:, kinds_of(body).index(f"tip {direction}")]
    steady = found[2] - found[1] if of == "luffing" else np.sqrt(found[2] ** 2 - found[1] ** 2)
    assert np.abs(tip - tip[0]).max() == pytest.approx(found[0] * steady, rel=5e-3)


def test_a_luffing_cylinder_carries_the_moment_to_second_order(raised: PostureMatrices) -> None:
    """Berry's moment at the root over the arm: twice the area of pivot, foot and lug over the cylinder's length."""
    foot, lug = (complex(*HINGES[key]) for key in ("foot", "lug"))
    for k, angle in enumerate((0.3, 1.4)):
        turned = lug * np.exp(1j * angle)
        arm = (foot.conjugate() * turned).imag / abs(turned - foot)
        load, _ = loads([Limit(name="a", of="luffing", most=100e3, factor=1.25)], raised, k)
        assert berry(load, angle)[1] / arm == pytest.approx(80e3, rel=1e-3)


def test_a_luffing_cylinder_that_pushes_uses_nothing_of_an_allowed_pull(raised: PostureMatrices) -> None:
    limit = Limit(name="a", of="luffing-pull", most=1.0)
    for k in (0, 1):
        assert np.isnan(loads([limit], raised, k)[0])
    columns = Columns((CYLINDER, "tip z"), ("reaction", "tip"), ("N", "m"), ("", ""))
    assert limit.measure(columns)(np.array([[-3.0, -9.0], [2.0, 1.0]])).tolist() == [3.0, 0.0]


def test_a_column_stands_up_to_its_buckling_load_and_a_hanging_one_for_ever(raised: PostureMatrices) -> None:
    euler = np.pi**2 * E * I_SIDEWAYS / (4.0 * L**2) / G
    limits = [Limit(name="a", of="buckling", least=2.5), Limit(name="b", of="deflection", most=0.5)]
    factor, deflection, stability = loads(limits, raised, 2, up_to=1e9)
    assert stability == pytest.approx(euler, rel=1e-3) and factor == pytest.approx(euler / 2.5, rel=1e-3)
    assert np.isnan(deflection)
    assert np.isnan(loads(limits, raised, 3, up_to=1e9)[[0, 2]]).all()
    assert np.isnan(loads(limits, raised, 2, up_to=100.0)).all()


def test_what_is_met_at_no_load_is_nothing(level: PostureMatrices) -> None:
    found = loads([Limit(name="a", of="deflection", most=1e-4), Limit(name="b", of="frequency", least=100.0)], level)
    assert found[:2].tolist() == [0.0, 0.0]


def test_the_frequency_is_that_of_a_cantilever_with_a_mass_at_its_tip(level: PostureMatrices) -> None:
    """1 + cos k cosh k + mu k (cos k sinh k - sin k cosh k) = 0, mu the load over the beam's mass; sideways, softer."""
    (load, _) = loads([Limit(name="a", of="frequency", least=2.0)], level)
    k = (rhoA := 7850.0 * A) ** 0.25 * np.sqrt(2.0 * np.pi * 2.0) / (E * I_SIDEWAYS) ** 0.25 * L
    mu = load / (rhoA * L)
    across = np.cos(k) * np.sinh(k) - np.sin(k) * np.cosh(k)
    assert 1.0 + np.cos(k) * np.cosh(k) + mu * k * across == pytest.approx(0.0, abs=1e-3 * np.cosh(k))


MACHINE = (
    MachineMass(name="carrier", mass=3000.0, at=(-0.5, 0.0, -1.0)),
    MachineMass(name="weight", mass=500.0, at=(-2.0, 0.0, 0.0), slews=True),
)
POLYGON = ((2.0, 1.5), (-2.0, 1.5), (-2.0, -1.5), (2.0, -1.5))


def test_a_machine_tips_about_its_edge(raised: PostureMatrices, level: PostureMatrices) -> None:
    """Sum of moments about the front edge, x = 2 m; anticlockwise or not."""
    for corners in (POLYGON, POLYGON[::-1]):
        limits = [Limit(name="a", of="overturning", factor=1.25, polygon=corners, machine=MACHINE, height=1.0)]
        held = 3000.0 * 2.5 + 500.0 * 4.0 - 7850.0 * A * L * (L / 2.0 - 2.0)
        assert loads(limits, level)[0] == pytest.approx(held / (L - 2.0) / 1.25, rel=1e-9)
        assert np.isnan(loads(limits, raised, 2)[0])


def on_legs() -> PostureMatrices:
    """The level cantilever on a machine with four legs."""
    scene, legs = cantilever(7850.0, 20), [{"name": f"leg {k}", "at": at} for k, at in enumerate(POLYGON)]
    ground = Ground.model_validate({"masses": [mass.model_dump() for mass in MACHINE], "outriggers": legs})
    return at_rest(scene.with_keys(frame=scene.frame.with_keys(ground=ground)), [0.0])


def test_forces_of_outriggers_allow_no_load_under_which_the_machine_tips() -> None:
    """Moments about x = 2 m; the force of a leg is not reached before."""
    limits = [Limit(name="strong", of="outrigger", most=1e6), Limit(name="tips", of="tipping", most=1.0)]
    held = 3000.0 * 2.5 + 500.0 * 4.0 - 7850.0 * A * L * (L / 2.0 - 2.0)
    assert loads(limits, on_legs())[:2] == pytest.approx([held / (L - 2.0)] * 2, rel=1e-6)


@pytest.mark.parametrize(("boom", "machine"), [(1.3, 1.0), (1.0, 0.9), (1.1, 0.8)])
def test_weights_of_boom_and_machine_have_factors_of_their_own(boom: float, machine: float) -> None:
    """Moments about the edges in front and behind give the forces on four legs; the machine's weight holds it down."""
    limits = [
        Limit(name="own", of="overturning", factor=1.25, polygon=POLYGON, machine=MACHINE),
        Limit(name="over", of="overturning", factor=1.25),
        Limit(name="front", of="outrigger", most=16e3),
        Limit(name="behind", of="lift-off", least=4e3),
    ]
    own, over, front, behind, _ = loads(limits, on_legs(), **{WEIGHT: boom, MACHINE_WEIGHT: machine})
    beam, masses = boom * 7850.0 * A * L, machine * np.array([part.mass for part in MACHINE])
    held = masses @ [2.5, 4.0] - beam * (L / 2.0 - 2.0)  # in kg m about x = 2 m
    assert [own, over] == pytest.approx([held / (L - 2.0) / 1.25] * 2, rel=1e-6)
    assert front == pytest.approx((2.0 * 4.0 * 16e3 / G - masses @ [1.5, 0.0] - beam * (L / 2.0 + 2.0)) / (L + 2.0))
    assert behind == pytest.approx((held - 2.0 * 4.0 * 4e3 / G) / (L - 2.0))


def test_a_load_of_the_scene_that_is_named_weight_is_no_weight() -> None:
    """A force of -500 N at the tip takes away from the load that the deflection allows."""
    scene = cantilever(1e-6, 20)
    load = Load(name="weight", on="tip", direction="z", signal=Constant(amount=0.0))
    at = at_rest(scene.with_keys(sections=(scene.sections[0].with_keys(loads=(load,)),)), [0.0])
    case = {"weight": 1.3, "machine": 1.0, "load": 1.0, "hoisted": 0.0, "loads": {"weight": -500.0}}
    place = Place(at, 0, [case_amount(case, part) for part in at.loads.names], G)
    allowed = allowed_loads([Limit(name="tip", of="deflection", most=0.06)], place, 1e6)[0]
    assert allowed == pytest.approx((0.06 * 3.0 * E * I / L**3 - 500.0) / G, rel=1e-5)


def test_the_load_at_the_deflected_tip_tips_a_machine_sooner(raised: PostureMatrices) -> None:
    """Berry's deflection moves it outwards by its part along the ground; a massless boom."""
    limit = Limit(name="a", of="overturning", factor=1.25, polygon=POLYGON, machine=MACHINE, height=1.0)
    load, out = loads([limit], raised)[0], L * np.cos(0.3)
    moved = berry(load, 0.3)[0] * np.sin(0.3)
    assert moved > 0.01
    assert load * (out + moved - 2.0) == pytest.approx((3000.0 * 2.5 + 500.0 * 4.0) / 1.25, rel=1e-5)


def test_an_expression_that_says_what_a_limit_does_allows_the_same(raised: PostureMatrices) -> None:
    tip = ", ".join(f'output["{name}"]' for name in raised.output_names if "tip" in name)
    limits = [Limit(name="a", of="deflection", most=0.5, factor=1.2)]
    limits.append(Limit(name="b", of="expression", expression=f"hypot({tip})", most=0.5, factor=1.2))
    limits.append(Limit(name="c", of="expression", expression="2 * load * cos(luffing)", most=5e3))
    deflection, same, level, _ = loads(limits, raised)
    assert same == deflection > 0.0
    assert level == pytest.approx(2500.0 / np.cos(0.3))
    for wrong, said in (('output["tip w"]', "did you mean"), ("1 / (load - load)", "it failed: ZeroDivisionError")):
        with pytest.raises(InputError, match=said) as refused:
            loads([Limit(name="a", of="expression", expression=wrong, most=1.0)], raised)
        assert "limits.a.expression" in str(refused.value) and "\n" not in str(refused.value)


def test_ropes_bear_by_statics_what_follows() -> None:
    """A weight counts by how far along the boom it moves where what moves it moves by one."""
    scene = crane("section.mesh.elements=8")
    fly = scene.sections[-1]
    assert fly.joint is not None
    joint = fly.joint.model_copy(update={"extension": None, "follows": "middle", "ratio": 0.5})
    scene = scene.model_copy(update={"sections": (*scene.sections[:-1], fly.model_copy(update={"joint": joint}))})
    angle = 0.9
    at = at_rest(scene, [angle], {"middle": [3.0], "fly": [2.0]})
    named = [Limit(name=name, of="rope", which=(name,), most=20e3) for name in ("middle", "fly")]
    cylinder, rope, _ = loads(named, at)
    full = tasks.full_system(with_hook(scene)).bodies
    own = [carried_inertia(full[name], "x") for name in ("middle", "fly")]
    most = 20e3 / (G * np.sin(angle))
    assert rope == pytest.approx(most - own[1], rel=1e-6)
    assert cylinder == pytest.approx((most - own[0] - 1.5 * own[1]) / 1.5, rel=1e-6)
    with pytest.raises(InputError, match="limits.a.which = 'base': names among middle, fly are allowed"):
        Limit(name="a", of="rope", which=("base",), most=1.0).check(scene)
    with pytest.raises(InputError, match="there is no rope"):
        Limit(name="a", of="rope", most=1.0).check(crane())


def test_the_model_that_lacks_what_is_limited_is_named(level: PostureMatrices) -> None:
    chart = Chart(
        [Limit(name="ropes", of="rope", most=1.0)], [[float(part != HOISTED) for part in level.loads.names]], 1e3, G
    )
    models = SimpleNamespace(comparisons={"model": ComparedModel(level, "coarse shell", 1.0)})
    with pytest.raises(InputError, match="there is no rope in the coarse shell that the scene is compared with"):
        chart.comparison_errors(models, "model", 0, np.ones((1, 2)))


def test_a_field_of_walls_is_that_of_probes_at_its_points() -> None:
    """The least load of all probes at a shell's centroids, of one face by name; beams have no field."""
    changes = ["sections.fly.masses=[]", "frame.second_order=true", "section.mesh.elements=4"]
    # pads three times as long, with a third of the stations on each path
    changes += [f"section.joint.{ring}.0.{key}" for ring in ("tail", "mouth") for key in ("length=0.9", "at=0.45")]
    changes += [f"{of}.joint.extension.values=[0.6, 4.2]" for of in ("section", "sections.fly")]  # no pads overlap
    scene = load_any(plain_machines.CRANE_SHELL, [*changes, "sections.fly.mesh={size=0.32,along=2.0}"])
    found = with_fields(with_hook(scene), ["fly"], 1)
    points = found.sections[-1].probes
    assert len(points) > 100 and {one.face for one in points} == {"outer", "inner"}
    resting = arrays_at_rest(with_fields(scene, ["fly"], 1), [0.5], {"middle": [2.0], "fly": [3.0]})
    at = npz.record_from_arrays(PostureMatrices, resting, "reduced.")
    field = Limit(name="a", of="field", which=("fly",), most=100e6)
    load = loads([field], at)[0]
    state = Place(at, 0, [1.0 if part in (WEIGHT, HOOK) else 0.0 for part in at.loads.names], G).equilibria.state(load)
    each = [
        von_mises_stress(state.outputs[list(one.values())], tuple(one))
        for p, one in at.columns.stress_columns().items()
        if "field of" in p
    ]
    assert len(each) == len(points) and max(each) == pytest.approx(100e6, rel=1e-6)
    place = Place(at, 0, [1.0 if part in (WEIGHT, HOOK) else 0.0 for part in at.loads.names], G)
    arrays = governing_details(
        [field],
        [place, None],
        np.array([load, np.nan]),
        npz.record_from_arrays(DeflectionOutputs, resting, "bent."),
        (),
    )
    assert arrays["stress"].shape[1] == len(arrays["stress.names"])  # of the scene's own probes alone
    with pytest.raises(InputError, match="there is no field"):
        field.check(crane())
    with pytest.raises(InputError, match="a body or region with walls is allowed"):
        with_fields(scene, ["base"], 1)
    with pytest.raises(InputError, match="fewer places or a coarser mesh"):
        with_fields(scene, ["fly"], 10**6)


def telescope(stiff: float, unilateral: bool = False) -> Scene:
    """Two planar boxes, the inner one on two pads."""
    pads = [{"at": 0.2, "stiffness": 1e14, "unilateral": unilateral}]
    common = {"body": {"model": "beam2d", "box": BOX, "material": {"young": stiff * E}}, "mesh": {"elements": 10}}
    return Scene.model_validate(
        {
            "title": "telescope",
            "frame": {"pivot": [0.0, 0.0, 0.0], "luffing": {"kind": "constant", "amount": 0.0}, "second_order": True},
            "sections": [
                {"name": "base", **common, "supports": [{"on": "tail", "kind": "clamped"}]},
                {
                    "name": "fly",
                    **common,
                    "joint": {"tail": pads, "mouth": pads, "extension": {"kind": "constant", "amount": 3.0}},
                },
            ],
            "gravity": {},
            "time": {"end": 1.0, "step": 0.01},
        }
    )


@pytest.mark.parametrize("unilateral", [False, True])
def test_pads_of_a_rigid_boom_carry_what_statics_say(unilateral: bool) -> None:
    """Moments about the tail's pad: F d = (P (L - a) + m (L / 2 - a)) g cos phi, d between both pads."""
    at = at_rest(telescope(1e6, unilateral), [0.0, 1.0], {"fly": [3.0, 4.0]})
    assert {at.columns.bodies[k] for k in at.columns.numbers_of_kind("pad", "cylinder")} == {"fly"}
    for k, (angle, out) in enumerate(((0.0, 3.0), (1.0, 4.0))):
        d, m = L - 0.4 - out, 7850.0 * A * L
        found = loads(
            [Limit(name="a", of="pad", most=2e5), Limit(name="b", of="pad", most=1e7, area=(0.1, 0.2))], at, k
        )
        expected = (2e5 * d / (G * np.cos(angle)) - m * (L / 2.0 - 0.2)) / (L - 0.2)
        assert found[:2] == pytest.approx(expected, rel=1e-6)


def test_another_limit_may_govern_within_the_error_bars() -> None:
    load, error = np.array([[10.0, 11.0, np.nan], [10.0, 20.0, np.nan]]), np.array([[1.0, 0.5, 0.0]] * 2)
    assert governing_limit(load).tolist() == [0, 0]
    assert ChartLoads(load, error, 100.0).may_govern.tolist() == [[True, True, False], [False, False, False]]
    error[:, 2] = 90.5  # of a limit that is not reached up to 100 kg by one model, but by another one at 9.5 kg
    assert ChartLoads(load, error, 100.0).may_govern.tolist() == [[True, True, True], [True, False, True]]
    assert ChartLoads(load, error, 100.0).lower.tolist() == [[9.0, 10.5, 9.5], [9.0, 19.5, 9.5]]
    assert governing_limit(np.full((1, 2), np.nan)).tolist() == [-1]


def test_the_page_of_a_limit_shows_where_it_governs_the_largest_load() -> None:
    """Not where it allows more but another one less, nor where nothing is carried."""
    load = np.array(
        [[10.0, 20.0, np.nan], [30.0, 40.0, np.nan], [60.0, 8.0, 90.0], [90.0, 9.0, 90.0], [5.0, 50.0, 0.0]]
    )
    assert largest_governed_rows(load).tolist() == [1, 3, -1]


@pytest.mark.parametrize("of", [of for of, kind in KINDS.items() if not kind.has_parts])
def test_which_is_refused_where_a_quantity_has_no_parts_to_choose_from(of: str) -> None:
    """It was ignored: a limit of the luffing cylinder that named a part which is not there held for the cylinder."""
    keys = {KINDS[of].amount: 1.0} if KINDS[of].amount else {}
    with pytest.raises(ValueError, match=f"which belongs to a limit of parts with names: {of} has none"):
        Limit(name="a", of=of, which=("x",), **keys)
