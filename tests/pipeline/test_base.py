"""A boom whose base moves: an earthquake, a truck, a ship."""

from pathlib import Path

import numpy as np
import pytest

import pmr
from pmr import Response
from pmr import scene as scenes
from pmr.scene.signals import SmoothRamp

CANTILEVER, LUFFING = (Path(__file__).parent / name for name in ("cantilever.toml", "luffing.toml"))
LENGTH, EI, RHO_A = 5.0, 5.0e4, 78.0
UNIT = np.sqrt(RHO_A * LENGTH**4 / EI)
COMES = "{kind='smooth_ramp', times=[0.0, 0.5], values=[0.0, 9.81]}"


def moved(*changes: str, file: Path = CANTILEVER) -> Response:
    scene = scenes.load_any(file, changes)
    return pmr.simulate(scene, pmr.reduce(scene).reduced)


def swung(amplitude: float, frequency: float) -> str:
    return f"{{kind='sine', amplitude={amplitude}, frequency={frequency}}}"


@pytest.mark.slow
@pytest.mark.parametrize("second_order", ["true", "false"])
def test_a_base_that_is_accelerated_upwards_weighs_as_gravity_does(second_order: str) -> None:
    raised = ("frame.luffing=0.7", f"frame.second_order={second_order}", "time.end=1.0")
    gravity = moved(*raised, "gravity={acceleration=9.81, rise=0.5}")
    base = moved(*raised, f"frame.base={{acceleration={{z={COMES}}}}}")
    assert np.abs(gravity.displacement).max() > 1e-4
    assert base.displacement == pytest.approx(gravity.displacement, abs=1e-10 * np.abs(gravity.displacement).max())
    reaction, expected = (one.other("reaction of pivot x") for one in (base, gravity))
    assert reaction == pytest.approx(expected, abs=1e-10 * np.abs(expected).max())


@pytest.mark.slow
def test_sections_on_a_base_that_is_accelerated_upwards_weigh_as_under_gravity() -> None:
    short = ("section.mesh.elements=8", "section.reduction.estimate=false", "time.end=0.4", "frame.second_order=true")
    gravity = moved(*short, file=LUFFING)
    base = moved(*short, "gravity.acceleration=4.905", "frame.base={acceleration={z=4.905}}", file=LUFFING)
    assert base.displacement == pytest.approx(gravity.displacement, abs=1e-10 * np.abs(gravity.displacement).max())
    assert base.slider_force == pytest.approx(gravity.slider_force, abs=1e-9 * np.abs(gravity.slider_force).max())


@pytest.mark.slow
def test_a_displacement_shakes_as_its_second_rate_does() -> None:
    raised, f = ("frame.luffing=0.7", "time.end=1.0"), 2.0
    by_displacement = moved(*raised, f"frame.base={{x={swung(0.01, f)}, z={swung(0.02, f)}}}")
    second = -((2.0 * np.pi * f) ** 2)
    accelerations = f"{{x={swung(0.01 * second, f)}, z={swung(0.02 * second, f)}}}"
    by_acceleration = moved(*raised, f"frame.base={{acceleration={accelerations}}}")
    largest = np.abs(by_displacement.displacement).max()
    assert largest > 1e-4
    assert by_acceleration.displacement == pytest.approx(by_displacement.displacement, abs=1e-10 * largest)


#: (beta L)^2 of a cantilever's bending modes, and what a unit acceleration of the base makes of each at the tip.
SQUARES, TIPS = (3.5160153, 22.0344916, 61.6972144), (1.5659827, -0.8679297, 0.5088290)


def test_a_base_that_swings_moves_a_cantilever_as_its_modes_say() -> None:
    """From rest beside the base: A Omega^2 (sin Omega t - Omega / omega sin omega t) / (omega^2 - Omega^2) of each."""
    f, A = 0.8 * SQUARES[0] / UNIT / (2.0 * np.pi), 1e-3
    changes = ("time.end=6.0", "time.step=2e-3", "frame.second_order=false")
    scene = scenes.load_any(CANTILEVER, [*changes, f"frame.base={{z={swung(A, f)}}}"])
    assert scene.frame is not None
    without = scene.model_copy(update={"frame": scene.frame.model_copy(update={"luffing": None})})
    found = pmr.simulate(without, pmr.reduce(without).reduced)
    Omega, expected = 2.0 * np.pi * f, np.zeros_like(found.t)
    for square, tip in zip(SQUARES, TIPS, strict=True):
        omega = square / UNIT
        swing = np.sin(Omega * found.t) - Omega / omega * np.sin(omega * found.t)
        expected += tip * A * Omega**2 * swing / (omega**2 - Omega**2)
    assert np.abs(expected).max() > 3.0 * A
    assert found.tip == pytest.approx(expected, abs=2e-3 * np.abs(expected).max())


@pytest.mark.slow
def test_a_rigid_boom_presses_on_a_base_that_swings_as_newton_and_euler_say() -> None:
    """Force -m u'', moment about the pivot -(p + L / 2) x m u'': the pivot's own place counts."""
    profile = f"{{length={LENGTH}, bending_stiffness=5e9, mass_per_length={RHO_A}, axial=true, axial_stiffness=2e13}}"
    f, A, ahead = 0.5, 0.1, 0.6
    changes = (f"sections.beam.body.profile={profile}", "time.end=4.0", "time.step=4e-3", "time.rho_inf=0.6")
    base = f"frame.base={{x={swung(A, f)}, z={swung(2.0 * A, f)}, acceleration={{z={COMES}}}}}"
    found = moved(*changes, base, f"frame.pivot=[{ahead}, 0.0, 0.3]", "frame.second_order=false")
    second = -A * (2.0 * np.pi * f) ** 2 * np.sin(2.0 * np.pi * f * found.t)
    upwards = 2.0 * second + SmoothRamp(times=(0.0, 0.5), values=(0.0, 9.81)).value(found.t)
    mass, late = RHO_A * LENGTH, found.t > 0.1  # once the start has been damped
    for axis, expected in (("x", -mass * second), ("z", -mass * upwards)):
        reaction = found.other(f"reaction of pivot {axis}")
        assert reaction[late] == pytest.approx(expected[late], abs=1e-4 * np.abs(expected).max())
    moment = mass * (ahead + LENGTH / 2.0) * upwards - mass * 0.3 * second
    assert found.other("reaction of pivot ry")[late] == pytest.approx(moment[late], abs=1e-4 * np.abs(moment).max())
