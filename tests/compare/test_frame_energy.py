"""The energy of booms in space: what their drives, loads and pads do is what it changes by."""

from pathlib import Path

import numpy as np
import plain_machines
import pytest
from newton_euler import needed

import pmr
from pmr import Response, System
from pmr import scene as scenes
from pmr.compare.evaluation import evaluate_motion
from pmr.compare.moving_frame import SpaceEnergy, energy_in_space
from pmr.compare.simulated import excitation_of_scene
from pmr.scene import Scene
from pmr.scene.rotation import FrameRotation
from pmr.simulation.native import systems
from pmr.simulation.reactions import with_pivot_force

pytestmark = pytest.mark.slow  # seconds each
TESTS = Path(__file__).parents[1]
LUFFING, CANTILEVER = (TESTS / "pipeline" / f"{name}.toml" for name in ("luffing", "cantilever"))
CRANE = plain_machines.CRANE

THREE = (
    "section.mesh.elements=8", "section.reduction.estimate=false", "damping.ratio=0.0", "frame.pivot=[0.4, 0.0, -0.3]",
    "frame.luffing.times=[0.0, 3.0]", "section.joint.extension.times=[0.0, 2.0]",
    "sections.fly.joint.extension.times=[0.5, 2.5]", "time.end=3.0",
)  # fmt: skip
#: Ten coordinates a section: fewer leave more out of the kinetic energy, in modes without inertia, than a step errs by.
SLEWED = (
    "section.mesh.elements=4", "section.reduction.coordinates=10", "section.reduction.estimate=false",
    "damping.ratio=0.0", "frame.pivot=[0.3, 0.1, -0.5]", "frame.luffing.times=[0.0, 3.0]",
    "frame.slewing.times=[0.1, 2.9]", "section.joint.extension.times=[0.05, 2.0]",
    "sections.fly.joint.extension.times=[0.0, 2.5]", "sections.fly.loads.0.signal.times=[0.2, 0.7, 1.0]",
    "time.end=1.0",
)  # fmt: skip
ONE = (
    "frame.luffing={kind='smooth_ramp', times=[0.0, 1.0], values=[0.2, 0.6], degree=9}",
    "frame.pivot=[0.4, 0.0, -0.3]",
    "gravity.acceleration=9.81",
    "start=equilibrium",
    "time.end=1.0",
)
#: On a base that rolls on, is shaken, and pitches.
SHAKEN = (
    *THREE,
    "frame.base.x={kind='smooth_ramp', times=[0.0, 2.0], values=[0.0, 3.0]}",
    "frame.base.ry={kind='sine', amplitude=2.0, frequency=0.3}",
    "frame.base.acceleration.z={kind='sine', amplitude=0.5, frequency=1.1}",
)
#: A load that presses along the boom, through the cylinders.
PRESSED = (
    *THREE,
    "sections.fly.loads.0.direction=x",
    "sections.fly.loads.0.signal={kind='smooth_ramp', times=[0.2, 1.2], values=[0.0, -20e3]}",
)


def followed(scene: Scene, system: System) -> tuple[SpaceEnergy, Response]:
    excitation = excitation_of_scene(scene, system)
    run = systems.simulate(system, excitation, systems.start_of(system, excitation))
    return energy_in_space(scene, system, excitation, run), with_pivot_force(scene, evaluate_motion(system, run))


@pytest.mark.parametrize("second_order", ["false", "true"])
@pytest.mark.parametrize(
    ("file", "changes"),
    [(CANTILEVER, ONE), (LUFFING, THREE), (LUFFING, PRESSED), (LUFFING, SHAKEN), (CRANE, SLEWED)],
    ids=["one", "three", "pressed", "shaken", "crane"],
)
def test_work_is_what_the_energy_changes_by_to_second_order_in_the_step(
    file: Path, changes: tuple[str, ...], second_order: str
) -> None:
    """A boom that luffs, slews and telescopes at once, without damping."""
    steps = [
        scenes.load_any(file, [*changes, f"frame.second_order={second_order}", f"time.step={h}"]) for h in (4e-3, 2e-3)
    ]
    system, left = pmr.reduce(steps[0]).system, []
    for scene in steps:
        found, _ = followed(scene, system)
        left.append(np.abs(found.residual_energy).max() / np.ptp(found.energy))
        assert np.abs(found.drive_work).max() > 0.05 * np.ptp(found.energy)
    assert left[1] < 1e-4
    assert left[1] == pytest.approx(left[0] / 4.0, rel=0.1)


def test_the_drives_work_is_that_of_the_base_s_reactions_and_the_cylinders() -> None:
    """Less that of rigid sections; what is left is of second order in the deflection, which is small here."""
    stiff = "section.body.material={young=2.1e12, poisson=0.3, density=7850.0}"
    pads = [f"section.joint.{end}.0.stiffness=3e9" for end in ("tail", "mouth")]
    changes = [*THREE, stiff, *pads, "sections.fly.loads.0.signal=0.0", "frame.second_order=true", "time.step=1e-3"]
    scene = scenes.load_any(LUFFING, changes)
    found, pressed = followed(scene, pmr.reduce(scene).system)
    t, power, out = found.t, np.zeros_like(found.t), np.zeros_like(found.t)
    omega = FrameRotation.from_signals(*scene.frame.angles, t).velocity
    power -= pressed.other("reaction of pivot ry") * omega[:, 1]
    for number, name in enumerate(scene.names):
        if number:
            out += scene.extension(number).rate(t)
            power += pressed.force(f"force of cylinder of {name}") * scene.extension(number).rate(t)
        rigid = needed(scene, number, t)
        power -= np.einsum("tk,tk->t", rigid.moment, omega) + rigid.force[:, 0] * out
    work = np.append(0.0, np.cumsum(power[1:] + power[:-1]) / 2.0 * scene.time.step)
    assert work == pytest.approx(found.drive_work, abs=2e-3 * np.abs(found.drive_work).max())


@pytest.mark.parametrize(("file", "changes", "second_order"), [(LUFFING, THREE, "true"), (CANTILEVER, ONE, "false")])
def test_a_run_says_where_the_energy_comes_from(file: Path, changes: tuple[str, ...], second_order: str) -> None:
    damped = ["damping={ratio=0.02, frequencies=[1.0, 30.0]}", "time.end=0.4", "compare.against=[]"]
    scene = scenes.load_any(file, [*changes, *damped, f"frame.second_order={second_order}"])
    energy = pmr.run(scene).result.summary["energy"]
    assert energy["change"] + energy["lost"] == pytest.approx(energy["drives"] + energy["others"])
    assert 0.0 < energy["lost"] < abs(energy["drives"])
