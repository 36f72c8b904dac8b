"""Second order of bodies alone and of sections from the scene on: stressed frequencies, columns, rotating beams."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import plain_machines
import pytest
from newton_euler import needed
from numpy.typing import ArrayLike
from scipy.optimize import brentq

import pmr
from pmr import InputError, System
from pmr import scene as scenes
from pmr.compare.evaluation import evaluate_motion
from pmr.compare.frequencies import frequencies_on_way, frequency_map, way_points
from pmr.compare.summary import simulate_saved
from pmr.fullmodel.build import build_bodies
from pmr.pipeline.full_order import FullOrder
from pmr.results import Frequencies
from pmr.scene import Scene
from pmr.scene.signals import SignalBase
from pmr.simulation import Excitation
from pmr.simulation.native import systems
from pmr.simulation.reactions import with_pivot_force
from pmr.system.assembly import Assembly

CANTILEVER, LUFFING = (Path(__file__).parent / name for name in ("cantilever.toml", "luffing.toml"))
CRANE = plain_machines.CRANE
LENGTH, EI, RHO_A = 5.0, 5.0e4, 78.0
#: Three times as long as in the scene, with a third of the stations on their paths: few loads to answer.
LONG_PADS = (
    *(f"section.joint.{ring}.0.{key}" for ring in ("tail", "mouth") for key in ("length=0.9", "at=0.45")),
    *(f"{of}.joint.extension.values=[0.6, 4.2]" for of in ("section", "sections.fly")),  # no pads overlap
)
#: Of time in bending, s.
UNIT = np.sqrt(RHO_A * LENGTH**4 / EI)
PHASE = 2.0 * np.pi / 15.0  # 1/s
#: First frequency of a rotating cantilever across the plane of rotation (Wright, Smith, Thresher, Wang 1982).
ROTATING = {0: 3.5160, 4: 5.5850, 12: 13.1702}


def load(*changes: str, file: Path = CANTILEVER) -> Scene:
    found: Scene = scenes.load_any(file, changes)
    return found


def natural(scene: Scene) -> Frequencies:
    """Of the reduced system, beside its full model."""
    made, excitation = pmr.reduce(scene), Excitation.from_scene(scene)
    full = FullOrder.join(scene, {name: one.model for name, one in made.built.items()})
    at = way_points(scene, made.system, excitation, full.system.size)
    c = excitation.amplitudes(list(excitation.terms), at.t)
    found = frequencies_on_way(scene, made.system, excitation, at)
    return replace(found, models={**found.models, "full": full.frequencies(at.s, at.count, c)})


def pressed(share: float) -> float:
    """First frequency in rad/s over that without a load, of a cantilever under a share of its buckling load.

    Of EI w'''' + P w'' = rho A omega^2 w with w = w' = 0 at the foot, w'' = EI w''' + P w' = 0 at the head.
    """

    def determinant(omega: float, P: float) -> float:
        a, b = P / 2.0, np.sqrt(P**2 / 4.0 + omega**2)  # EI = rho A = L = 1
        k, h = np.sqrt(a + b), np.sqrt(b - a)
        # w = A (cosh h x - cos k x) + B (sinh h x - h / k sin k x)
        bent = [h**2 * np.cosh(h) + k**2 * np.cos(k), h**2 * np.sinh(h) + h * k * np.sin(k)]
        sheared = [
            h**3 * np.sinh(h) - k**3 * np.sin(k) + P * (h * np.sinh(h) + k * np.sin(k)),
            h**3 * np.cosh(h) + h * k**2 * np.cos(k) + P * h * (np.cosh(h) - np.cos(k)),
        ]
        return float(bent[0] * sheared[1] - bent[1] * sheared[0])

    first = [brentq(determinant, 1e-3, 4.0, args=(one,)) for one in (share * np.pi**2 / 4.0, 1e-9)]
    return first[0] / first[1]


@pytest.mark.parametrize("share", [0.5, 0.9])
def test_a_loaded_column_s_frequency_falls_to_zero_at_its_buckling_load(share: float) -> None:
    P = share * np.pi**2 / 4.0 * EI / LENGTH**2
    found = natural(load(f"sections.beam.loads.0.signal={-P}")).models
    expected = 3.5160 * pressed(share) / UNIT / (2.0 * np.pi)
    assert found["full"][:, 0] == pytest.approx(expected, rel=1e-3)
    assert found["reduced"][:, 0] == pytest.approx(expected, rel=1e-3)


def test_a_column_on_two_pins_has_the_root_of_what_is_left_of_its_load() -> None:
    """Sqrt(1 - P / P_cr), of the one shape in which it buckles and swings."""
    foot, head = "{name='foot', on='tail', directions=['x', 'z']}", "{name='head', on='tip', directions=['z']}"
    pins = f"sections.beam.supports=[{foot}, {head}]"
    P = 0.75 * np.pi**2 * EI / LENGTH**2
    found = natural(load(pins, f"sections.beam.loads.0.signal={-P}")).models
    expected = 0.5 * np.pi**2 / UNIT / (2.0 * np.pi)
    assert found["full"][:, 0] == pytest.approx(expected, rel=1e-4)
    assert found["reduced"][:, 0] == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("eta", ROTATING)
def test_a_cantilever_that_turns_in_its_plane(eta: int) -> None:
    """The square of its frequency is that of Wright's across the plane less eta^2."""
    speed = eta / UNIT
    turn = f"frame.luffing={{kind='ramp', times=[0.0, 10.0], values=[0.0, {10.0 * speed}]}}"
    found = natural(load(turn)).models
    expected = np.sqrt(ROTATING[eta] ** 2 - eta**2) / UNIT / (2.0 * np.pi)
    assert found["full"][:, 0] == pytest.approx(expected, rel=1e-3)
    assert found["reduced"][:, 0] == pytest.approx(expected, rel=1e-3)


CRANE = plain_machines.CRANE
SMALL = ("frame.second_order=true", "section.mesh.elements=6", "section.reduction.estimate=false")


@pytest.mark.slow
@pytest.mark.mpi
def test_lanczos_iterations_find_the_frequencies_of_a_stressed_crane() -> None:
    """Slewing, luffing and extending, the fast way that couples what is up and aside, beside all modes."""
    fast = ("frame.slewing.values=[0.0, 450.0]", "compare.against=['full']")
    scene = load(*SMALL, *fast, file=CRANE)
    excitation = Excitation.from_scene(scene)
    dense = FullOrder.join(scene, {name: one.model for name, one in build_bodies(scene).items()})
    at = way_points(scene, pmr.reduce(scene).system, excitation, dense.system.size)
    c = excitation.amplitudes(list(excitation.terms), at.t)
    sparse = FullOrder(scene, dense.system, "petsc").frequencies(at.s, at.count, c)
    found = dense.frequencies(at.s, at.count, c)
    unstressed = dense.frequencies(at.s, at.count, np.zeros_like(c))
    assert np.abs(found / unstressed - 1.0).max() > 1e-3  # it matters
    assert sparse == pytest.approx(found, rel=1e-6)


@pytest.mark.slow
def test_frequencies_over_two_joints_are_those_of_the_stressed_boom_at_rest() -> None:
    """Raised as far as it is on its way; beside the way itself where it rests there, at its end."""
    scene = load(*SMALL, "section.mesh.elements=10", "time.end=20.0", file=LUFFING)
    system, excitation = pmr.reduce(scene).system, Excitation.from_scene(scene)
    over = frequency_map(scene, system)
    assert over is not None
    end = np.array([scene.time.end])
    s = {name: path.value(end)[0] for name, path in scene.paths.items()}
    c = excitation.amplitudes(system.term_names, end)[0]
    resting = Assembly(system).frequencies(system.side_coordinates(s), 1, c)[0]
    assert over.lowest[-1, -1] == pytest.approx(resting, rel=1e-9)
    assert resting < 0.997 * Assembly(system).frequencies(system.side_coordinates(s), 1)[0]


class SpunUp(SignalBase):
    """Angle in rad after Simo and Vu-Quoc (J. Appl. Mech. 53, 1986): to 6 rad/s within 15 s."""

    def value(self, t: ArrayLike) -> np.ndarray:
        t = np.asarray(t, float)
        return np.where(t < 15.0, 0.4 * (t**2 / 2.0 + (np.cos(PHASE * t) - 1.0) / PHASE**2), 6.0 * t - 45.0)

    def rate(self, t: ArrayLike) -> np.ndarray:
        t = np.minimum(t, 15.0)
        return 0.4 * (t - np.sin(PHASE * t) / PHASE)

    def second_rate(self, t: ArrayLike) -> np.ndarray:
        return 0.4 * (1.0 - np.cos(PHASE * np.minimum(t, 15.0)))


@pytest.mark.slow
def test_a_beam_that_is_spun_up_lags_and_comes_to_rest() -> None:
    """The tip lags by 0.5744 m at 6.76 s, then rests."""
    profile = "{length=10.0, bending_stiffness=1.4e4, mass_per_length=1.2, axial=true, axial_stiffness=2.8e7}"
    changes = (f"sections.beam.body.profile={profile}", "time.end=20.0", "time.step=5e-3")
    scene = load(*changes, "sections.beam.mesh.elements=10", "sections.beam.slider.path=5.0")
    assert scene.frame is not None
    spun = scene.model_copy(update={"frame": scene.frame.model_copy(update={"luffing": SpunUp()})})
    found = pmr.simulate(spun, pmr.reduce(scene).reduced)
    lag = np.abs(found.tip)
    assert lag.max() == pytest.approx(0.5744, rel=2e-3)
    assert found.t[lag.argmax()] == pytest.approx(6.76, abs=0.03)
    assert lag[found.t > 16.0].max() < 5e-3  # no growth


@pytest.mark.slow
def test_a_boom_is_the_same_as_a_body_and_as_a_section(tmp_path: Path) -> None:
    text = CANTILEVER.read_text()
    top = text.replace('[[sections]]\nname = "beam"\n', "")
    head, sections = top.split("body.model", 1)
    begun, frame = head.split("[frame]")
    keys, rest = sections.split("[time]")
    (tmp_path / "body.toml").write_text(f"{begun}body.model{keys}[frame]{frame}[time]{rest}")
    changes = (
        "loads.0.signal=-2000.0",
        "gravity={rise=0.01}",
        "frame.luffing={kind='ramp', times=[0.0, 10.0], values=[0.0, 20.0]}",
    )
    alone = load(*changes, file=tmp_path / "body.toml")
    section = load(f"sections.beam.{changes[0]}", *changes[1:])
    a, b = (pmr.simulate(scene, pmr.reduce(scene).reduced) for scene in (alone, section))
    assert np.abs(a.displacement).max() > 1e-6
    assert b.displacement == pytest.approx(a.displacement, abs=1e-12 * np.abs(a.displacement).max())
    assert natural(section).models["reduced"] == pytest.approx(natural(alone).models["reduced"], rel=1e-12)


@pytest.mark.slow
def test_a_saved_body_with_second_order_is_simulated_with_it(tmp_path: Path) -> None:
    """As a system, which has its terms: exports that know none refuse it."""
    scene = load("sections.beam.loads.0.signal=-3000.0", "frame.luffing=0.5", "gravity={rise=0.0}")
    outcome = pmr.run(scene)
    saved = outcome.save(tmp_path)
    assert saved.name == "system.npz"
    system = System.load(saved)
    assert system.term_names == tuple(Excitation.from_scene(scene).terms)
    again = simulate_saved(system, scene)
    expected = outcome.result.responses["reduced"].displacement
    assert again.responses["reduced"].displacement == pytest.approx(expected, abs=1e-12 * np.abs(expected).max())
    assert again.frequencies.models["reduced"] == pytest.approx(outcome.result.frequencies.models["reduced"], rel=1e-9)
    with pytest.raises(InputError, match="terms that vary in time"):
        system.ensure_constant("model")


@pytest.mark.slow
def test_a_column_beyond_its_buckling_load_is_warned_of() -> None:
    beyond = -1.2 * np.pi**2 / 4.0 * EI / LENGTH**2
    summary = pmr.run(load(f"sections.beam.loads.0.signal={beyond}")).result.summary
    assert summary["buckling"]["factor"] == pytest.approx(1.0 / 1.2, rel=1e-3)
    (said,) = [one for one in summary["warnings"] if "buckling" in one]
    assert (
        said.startswith("the boom is beyond its buckling load: at 0 s 0.833 of the axial forces") and "\n" not in said
    )


@pytest.mark.slow
def test_a_column_that_grows_under_its_weight_beyond_the_buckling_load() -> None:
    """Upright, q L = 7.8373 EI / L^2 buckles it; the factor is what is left."""
    upright = ("frame.luffing=1.5707963267948966", "gravity={rise=0.0, acceleration=9.81}")
    summary = pmr.run(load(*upright)).result.summary
    expected = 7.8373 * EI / LENGTH**2 / (RHO_A * 9.81 * LENGTH)
    assert summary["buckling"]["factor"] == pytest.approx(expected, rel=1e-3)


def held_down(share: float) -> tuple[str, str]:
    return f"sections.beam.loads.0.signal={-share * np.pi**2 / 4.0 * EI / LENGTH**2}", "frame.luffing=0.3"


@pytest.mark.slow
@pytest.mark.parametrize(("asked", "share", "kept"), [("auto", 0.003, True), ("auto", 0.001, False)])
def test_auto_keeps_second_order_where_axial_forces_matter(asked: str, share: float, kept: bool) -> None:
    """The share of the buckling load in report and summary; the model that is made is that of the choice."""
    scene = load(*held_down(share), f"frame.second_order={asked}")
    outcome = pmr.run(scene)
    summary = outcome.result.summary
    assert summary["frame"]["second_order"] is kept and bool(outcome.system.terms) is kept
    assert summary["buckling"]["share"] == pytest.approx(share, rel=1e-3) and summary["buckling"]["limit"] == 2e-3
    assert summary["buckling"]["factor"] == pytest.approx(1.0 / share, rel=1e-3)
    assert not [one for one in summary["warnings"] if "second order" in one]
    press = f"{{name='press', on='tip', direction='x', {held_down(share)[0].removeprefix('sections.beam.loads.0.')}}}"
    lifted = f"sections.beam.loads=[{press}, {{name='lift', on='tip', direction='z', signal=10.0}}]"
    given = load(lifted, held_down(share)[1], f"frame.second_order={asked}")
    expected = load(lifted, held_down(share)[1], f"frame.second_order={str(kept).lower()}")
    a, b = (pmr.simulate(one, pmr.reduce(one).reduced).displacement for one in (given, expected))
    # modes of two solves, the one with more of them than the other: each to the square root of round-off, and with
    # residual flexibility a displacement is off by the square of that
    assert a == pytest.approx(b, abs=1e-10 * np.abs(b).max())


@pytest.mark.slow
def test_a_saved_system_is_followed_as_it_was_made_under_auto(tmp_path: Path) -> None:
    scene = load(*held_down(0.01), "frame.second_order=auto")
    outcome = pmr.run(scene)
    again = simulate_saved(System.load(outcome.save(tmp_path)), scene)
    assert again.summary["frame"]["second_order"] is True


@pytest.mark.parametrize(("share", "said"), [(0.01, 1), (0.001, 0)])
def test_without_second_order_a_line_says_how_much_is_left_out_where_that_is_not_small(share: float, said: int) -> None:
    summary = pmr.run(load(*held_down(share), "frame.second_order=false")).result.summary
    lines = [one for one in summary["warnings"] if one.startswith("second order is left out")]
    assert len(lines) == said
    assert all("stiffness by 1 % at 0 s" in one and "\n" not in one for one in lines)
    assert summary["frame"]["frequencies"] == "unstressed"


@pytest.mark.slow
def test_a_beam_that_spins_needs_second_order_without_any_compression() -> None:
    """Tension and the frame's speed count as much: eta^2 over the square of its frequency, and more."""
    speed = 1.0 / UNIT
    turn = f"frame.luffing={{kind='ramp', times=[0.0, 10.0], values=[0.0, {10.0 * speed}]}}"
    summary = pmr.run(load(turn, "frame.second_order=auto")).result.summary
    assert summary["frame"]["second_order"] is True and summary["buckling"]["factor"] is None
    assert 0.01 < summary["buckling"]["share"] < 0.2


def test_a_clamp_bears_the_moment_of_a_load_along_on_what_is_bent() -> None:
    """F L + P w at rest, and P along: equilibrium of the bent column."""
    P, F = 0.5 * np.pi**2 / 4.0 * EI / LENGTH**2, 20.0
    press = f"{{name='press', on='tip', direction='x', signal={-P}}}"
    push = f"{{name='push', on='tip', direction='z', signal={F}}}"
    scene = load(f"sections.beam.loads=[{press}, {push}]", "start=equilibrium")
    found = pmr.simulate(scene, pmr.reduce(scene).reduced)
    w = found.tip[0]
    assert P * w > 0.3 * F * LENGTH  # it matters
    moment = found.other("reaction of pivot ry")
    assert np.abs(moment).max() == pytest.approx(F * LENGTH + P * w, rel=1e-4)
    assert np.ptp(moment) < 1e-6 * np.abs(moment).max()
    assert found.other("reaction of pivot x")[0] == pytest.approx(-P, rel=1e-9)
    assert found.other("reaction of pivot z")[0] == pytest.approx(F, rel=1e-6)


@pytest.mark.slow
def test_a_base_bears_the_moment_of_the_weight_of_bent_sections() -> None:
    """At rest: what rigid sections would press with, and g sin(phi) times how far their mass is aside."""
    scene = load("frame.luffing=40.0", "frame.second_order=true", "section.mesh.elements=8", "time.end=0.02",
                 "section.reduction.estimate=false", "sections.fly.loads.0.signal=0.0", file=LUFFING)  # fmt: skip
    system = pmr.reduce(scene).system
    run = systems.simulate(system, excitation := Excitation.from_scene(scene), systems.start_of(system, excitation))
    found = with_pivot_force(scene, evaluate_motion(system, run))
    aside = sum(
        np.asarray(body.B)[:, body.input_names.index("inertia z")] @ run.bodies[name].q[0]
        for name, body in system.bodies.items()
    )
    rigid = sum(needed(scene, number, found.t[:1]).moment[0, 1] for number in range(3))
    bent = 9.81 * np.sin(np.deg2rad(40.0)) * aside
    assert abs(bent) > 5e-4 * abs(rigid)
    assert found.other("reaction of pivot ry")[0] + rigid == pytest.approx(-bent, abs=1e-2 * abs(bent))


BOX = "body.box = { length = 5.0, width = 0.22, height = 0.32, wall = 0.006 }"
BODIES = {
    "beam3d": ("sections.beam.mesh.elements=10",),
    "shell": ("sections.beam.mesh={size=0.22, along=0.5}",),
    "solid": ("sections.beam.mesh={size=0.22, along=1.0}",),
}


def of_model(folder: Path, model: str, *changes: str) -> Scene:
    """The cantilever as a box of another model."""
    lines = [line for line in CANTILEVER.read_text().splitlines() if not line.startswith(("body.profile", "mesh."))]
    text = "\n".join(lines).replace('body.model = "beam2d"', f'body.model = "{model}"\n{BOX}')
    (folder / "box.toml").write_text(text)
    about = ("sections.beam.reduction.coordinates=14", "sections.beam.observe={start=0.5, end=4.5, count=5}")
    return load(*BODIES[model], *about, *changes, file=folder / "box.toml")


@pytest.mark.slow
@pytest.mark.parametrize("model", BODIES)
def test_a_body_alone_of_any_model_is_stressed_as_its_full_model(model: str, tmp_path: Path) -> None:
    """A load along lowers its frequency in the plane, reduced as in full."""
    free, stressed = (
        natural(of_model(tmp_path, model, f"sections.beam.loads.0.signal={-P}")).models for P in (0.0, 5e5)
    )
    assert stressed["reduced"][0, 0] < 0.9 * free["reduced"][0, 0]
    full = stressed["full"][0]
    in_plane = full[np.argmin(np.abs(full - stressed["reduced"][0, 0]))]  # the full one moves across it, too
    assert stressed["reduced"][0, 0] == pytest.approx(in_plane, rel=1e-3)


@pytest.mark.slow
def test_a_line_says_where_buckling_across_the_plane_is_not_looked_for(tmp_path: Path) -> None:
    side = "{name='side', on='tip', direction='y', signal=0.0}"
    press = "{name='press', on='tip', direction='x', signal=-5e5}"
    stiff = "{name='stiff', on=1.0, directions=['z', 'ry'], stiffness=1e12}"  # whose forces are outputs, and no motions
    for loads, supports, lines in ((f"[{press}]", "", 1), (f"[{press}, {side}]", "", 0), (f"[{side}]", stiff, 0)):
        added = [f"sections.beam.supports=[{{name='clamp', kind='clamped'}}, {supports}]"] if supports else []
        summary = pmr.run(of_model(tmp_path, "beam3d", f"sections.beam.loads={loads}", *added)).result.summary
        assert len([one for one in summary["warnings"] if one.startswith("buckling across the plane")]) == lines
        flatwise = summary["buckling"]["factor"]
        assert supports or (flatwise < 3.0) == (lines == 0)  # the weak way is known where something acts there


def test_a_base_that_is_held_along_anywhere_but_at_its_tail_is_refused() -> None:
    pins = "{name='foot', on='tail', directions=['z', 'ry']}, {name='head', on='tip', directions=['x']}"
    with pytest.raises(InputError, match=r"supports\[1\].on = 'tip': with frame.second_order, the support") as refused:
        load(f"sections.beam.supports=[{pins}]")
    assert "\n" not in str(refused.value)
    assert load(f"sections.beam.supports=[{pins}]", "frame.second_order=false")


@pytest.mark.slow
def test_the_crane_takes_six_coordinates_a_section() -> None:
    """To 0.1 % at the tip beside its full model, and the estimate is within 1 to 5 times that."""
    few = ("section.mesh.elements=6", "time.step=8e-3", "time.end=8.0", "frame.second_order=true", *LONG_PADS)
    outcome = pmr.run(load(*few, "simulation.simulators=['march']", "simulation.repeats=1", file=CRANE))
    summary = outcome.result.summary
    error, estimate = summary["errors"]["reduced_vs_full"]["tip"], summary["estimate"]["tip"]
    assert error < 1e-3 and error < estimate < 5.0 * error


@pytest.mark.slow
def test_three_sections_that_luff_are_followed_by_few_coordinates() -> None:
    """16 across the boom, six of them without inertia, as near as 16 of a separate planar model come: 0.0032 %.

    Six more are along it, where that model is rigid.
    """
    changes = [f"sections.{name}.reduction.coordinates={n}" for name, n in {"base": 2, "middle": 5, "fly": 5}.items()]
    few = ("section.mesh.elements=10", "time.step=8e-3", "frame.second_order=true", "section.reduction.estimate=false")
    scene = load(*few, *changes, "compare.against=['full']", "simulation.repeats=1", file=LUFFING)
    assert pmr.run(scene).result.summary["errors"]["reduced_vs_full"]["tip"] < 4e-5
