"""Second order of bodies alone and of sections from the scene on: stressed frequencies, columns, rotating beams."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

import pmr
from pmr import scene as scenes
from pmr.compare.boom_figures import frequency_map
from pmr.compare.way import frequencies, visited
from pmr.fullmodel.build import build_bodies
from pmr.pipeline.full_order import FullOrder
from pmr.results import Frequencies
from pmr.scene import Scene
from pmr.simulation import Excitation
from pmr.system.assembly import Assembly

CANTILEVER, LUFFING = (Path(__file__).parent / name for name in ("cantilever.toml", "luffing.toml"))
LENGTH, EI, RHO_A = 5.0, 5.0e4, 78.0
#: Of time in bending, s.
UNIT = np.sqrt(RHO_A * LENGTH**4 / EI)
#: First frequency of a rotating cantilever across the plane of rotation (Wright, Smith, Thresher, Wang 1982).
ROTATING = {0: 3.5160, 4: 5.5850, 12: 13.1702}


def load(*changes: str, file: Path = CANTILEVER) -> Scene:
    found: Scene = scenes.load_any(file, changes)
    return found


def natural(scene: Scene) -> Frequencies:
    """Of the reduced system, beside its full model."""
    made, excitation = pmr.reduce(scene), Excitation.of(scene)
    full = FullOrder.of(scene, {name: one.model for name, one in made.built.items()})
    at = visited(scene, excitation, full.whole.size)
    c = excitation.amplitudes(list(excitation.terms), at.t)
    return frequencies(scene, made.system, excitation, at, full.frequencies(at.s, at.count, c))


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


CRANE = Path(__file__).parents[2] / "workflows" / "crane.toml"
SMALL = ("frame.second_order=true", "section.mesh.elements=6", "section.reduction.estimate=false")


@pytest.mark.slow
@pytest.mark.mpi
def test_lanczos_iterations_find_the_frequencies_of_a_stressed_crane() -> None:
    """Slewing, luffing and extending, the fast way that couples what is up and aside, beside all modes."""
    fast = ("frame.slewing.values=[0.0, 450.0]", "compare.against=['full']")
    scene = load(*SMALL, *fast, file=CRANE)
    excitation = Excitation.of(scene)
    dense = FullOrder.of(scene, {name: one.model for name, one in build_bodies(scene).items()})
    at = visited(scene, excitation, dense.whole.size)
    c = excitation.amplitudes(list(excitation.terms), at.t)
    sparse = FullOrder(scene, dense.whole, "petsc").frequencies(at.s, at.count, c)
    found = dense.frequencies(at.s, at.count, c)
    unstressed = dense.frequencies(at.s, at.count, np.zeros_like(c))
    assert np.abs(found / unstressed - 1.0).max() > 1e-3  # it matters
    assert sparse == pytest.approx(found, rel=1e-6)


def test_frequencies_over_two_joints_are_those_of_the_stressed_boom_at_rest() -> None:
    """Raised as far as it is on its way; beside the way itself where it rests there, at its end."""
    scene = load(*SMALL, "section.mesh.elements=10", "time.end=20.0", file=LUFFING)
    system, excitation = pmr.reduce(scene).system, Excitation.of(scene)
    over = frequency_map(scene, system)
    assert over is not None
    end = np.array([scene.time.end])
    s = {name: path.value(end)[0] for name, path in scene.paths.items()}
    c = excitation.amplitudes(system.term_names, end)[0]
    resting = Assembly(system).frequencies(system.coordinates(s), 1, c)[0]
    assert over.lowest[-1, -1] == pytest.approx(resting, rel=1e-9)
    assert resting < 0.997 * Assembly(system).frequencies(system.coordinates(s), 1)[0]
