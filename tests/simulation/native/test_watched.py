"""Steppers and FMUs warn of what a run warns of, of the same limits and from the same step on."""

import logging
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import free_boom
import numpy as np
import pytest
from compare.test_ropes import winch
from export.fmi.libraries import Instance, loaded, table
from free_extension import free
from oil_boom import STROKE, SUPPLY, UP_AND_DOWN, oil
from simulation.test_pairs import PLAIN

import pmr
from pmr import System
from pmr.export.fmi import fmu_contents
from pmr.scene import Scene
from pmr.simulation.excitation import Excitation
from pmr.simulation.moving import DRIVE, EXTENSION_DRIVE, read_scene
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.free_motion import prepare_stepping, with_free_motion
from pmr.simulation.native.systems import simulate_form

pytestmark = pytest.mark.slow  # booms are reduced

RAMP = "{kind='smooth_ramp', times=[0.0, 0.09], values="
#: The tip force is the third load.
FORCE = "sections.fly.loads.2.signal="
PRESSURES = tuple(f"section.joint.{end}.0.allowed_pressure=2e5" for end in ("tail", "mouth"))
LUFFED = f"frame.luffing={RAMP}[0.3, 0.32]}}"
HOIST = "hoist={payload=60.0, EA=2e6, damping=1e3, falls=2, hanging=1.7, winch={at=[-0.4, 0.1, 0.5]}, "
LOWERED = "speed={kind='ramp', times=[0.02, 0.03], values=[0.0, -8.0]}}"
FREE = ("frame.luffing='free'", "frame.luffing_start=0.3", "time.step=5e-4")


def boom(*changes: str) -> Callable[[], Scene]:
    return lambda: free_boom.scene(*PLAIN, *changes)


SCENES: dict[str, tuple[Callable[[], Scene], str]] = {
    "nothing": (boom(*free_boom.PUSHING), ""),
    "pads pull": (boom(f"{FORCE}{RAMP}[0.0, -2e3]}}", *PRESSURES), "bears more than its allowed_pressure"),
    "an outrigger lifts off": (boom(*free_boom.PUSHING, f"{FORCE}{RAMP}[0.0, 8e3]}}"), "lifts off"),
    "the machine tips": (boom(*free_boom.PUSHING, f"{FORCE}{RAMP}[0.0, 4e4]}}"), "tips over"),
    "the machine of a boom that swings up tips": (boom(*FREE, f"{FORCE}1.5e4"), "tips over"),
    "a cylinder is too short": (
        boom(*free_boom.PUSHING, LUFFED, "frame.cylinder={foot=[0.5, -0.6], lug=[1.2, -0.15], stroke=[0.6, 1.07]}"),
        "beyond its stroke",
    ),
    "a rope is slack": (boom(*free_boom.PUSHING, HOIST + LOWERED), "is slack"),
    "a rope pushes": (winch, "would have to push"),
    "oil has more than the supply": (boom(*FREE, oil(UP_AND_DOWN, "", True).replace(str(SUPPLY), "3e5")), "supply"),
    "oil boils": (boom(*FREE, "frame.luffing_rate=-0.3", oil("", "", False)), "boils"),
    "a cylinder at its stop": (
        boom(*FREE, "frame.luffing_rate=-0.3", oil("", "", False).replace(f"stroke=[{STROKE[0]}", "stroke=[1.0655")),
        "meets the stop",
    ),
    "a section at its stop": (boom(free("force={kind='constant', amount=4e3}", (0.5, 0.62))), "meets the stop"),
    "the hook at the ground": (boom(*free_boom.PUSHING, HOIST.replace("1.7", "2.11") + LOWERED), "below the ground"),
}


def times_of(lines: list[str]) -> dict[str, float]:
    """Time of each event of which there is a warning."""
    found = [re.fullmatch(r"(?:step \d+, )?t = ([^ ]+) s: ([^:]*)(: .*)?", line) for line in lines]
    return {of[2]: float(of[1]) for of in found if of}


def said_by_run(scene: Scene) -> dict[str, float]:
    """Times at which the quantities of a run first exceed limits, as far as its summary warns of them."""
    result = pmr.run(scene).result
    summary, said = result.summary, "\n".join(result.summary["warnings"])
    times = {row["what"]: row["t"] for row in summary.get("exceeded", ())}
    ground = summary.get("ground", {"tips": None, "outriggers": ()})
    stands = np.inf if ground["tips"] is None else ground["tips"]  # a run that tips does not speak of them
    lifted = {of["name"]: of["lifted"]["t"] for of in ground["outriggers"] if "lifted" in of}
    times |= {f"the outrigger {name} lifts off": t for name, t in lifted.items() if t < stands}
    times |= {event: float(t) for event, t in re.findall(r"(the machine tips over .*?) at (\S+) s:", said)}
    for cylinder in ("luffing_cylinder", "extension_cylinder"):
        stops = summary.get(cylinder, {}).get("stops", ())
        times |= {re.search(r"(\S.* meets the stop at its \S+ \S+) at", said)[1]: span["start"] for span in stops[:1]}
    for span in summary.get("hoist", {}).get("slack", ())[:1]:
        times["the hoist rope is slack"] = span["start"]
    for side in re.findall("the oil on the (.*) side of the luffing cylinder has up to", said):
        pressure = result.responses["reduced"].other(f"luffing cylinder pressure {side}")
        event = f"the oil on the {side} side of the luffing cylinder has more than the supply's 300 kPa"
        times[event] = result.responses["reduced"].t[np.argmax(pressure > 3e5 + 1e4)]
    return times


def said_by_stepper(system: System, caplog: pytest.LogCaptureFixture) -> dict[str, float]:
    """Times of the warnings of a stepper that the scene's motions drive."""
    _, stored, frame = prepare_stepping(system, "system")
    assert stored is not None
    excitation, t = stored.excitation, stored.excitation.times
    paths, loads, started = list(excitation.paths), list(excitation.loads), set[str]()
    motions = {name: signal.value(t)[None] for name, signal in {**excitation.paths, **excitation.loads}.items()}
    if frame is not None:
        moved = frame.motions(excitation, t)
        moved[:, :, 0] = frame.start
        motions = dict(zip(frame.drivers, np.moveaxis(moved, 1, 0), strict=True))
        paths, loads = list(frame.paths), list(frame.loads)
        started = {"luffing"} if stored.luffs_freely else set(paths) if stored.extends_freely else set()

    def at(k: int) -> dict[str, Mapping[str, Any]]:
        of = {n: tuple(motion[:, k].tolist()) for n, motion in motions.items() if not k or n not in started}
        F = {n: of.pop(n)[: 2 if n.startswith((DRIVE, EXTENSION_DRIVE)) else 1] for n in loads}
        return {"s": {n: of.pop(n) for n in paths if n in of}, "F": F, "frame": of}

    caplog.clear()
    with caplog.at_level(logging.WARNING):
        stepper = pmr.Stepper(system, excitation.stepping.step, **at(0), parts=0)
        for k in range(1, len(t)):
            stepper.step(**at(k))
    return times_of([record.getMessage() for record in caplog.records])


def said_by_fmu(system: System, folder: Path, version: str) -> dict[str, float]:
    """Times of the warnings of an FMU that its reference drives."""
    contents = fmu_contents(system, read_scene(system, "system", free=True), "boom", version)
    given = table(contents.texts["resources/reference_in.csv"])
    instance, t = Instance(loaded(contents, folder, version)), given.pop("time")
    rows = np.column_stack(list(given.values()))
    instance.initialise(list(given), rows[0])
    for k in range(len(rows) - 1):
        instance.set(list(given), rows[k])
        instance.step(t[k], t[k + 1] - t[k])
    return times_of(instance.said)


@pytest.mark.parametrize("name", SCENES)
def test_steppers_and_fmus_say_what_a_run_says(name: str, caplog: pytest.LogCaptureFixture, tmp_path: Path) -> None:
    scene, part = SCENES[name][0](), SCENES[name][1]
    system, expected = pmr.reduce(scene).system, said_by_run(scene)
    assert any(part in event for event in expected) if part else not expected
    for version in ("2", "3"):
        assert said_by_fmu(system, tmp_path, version) == pytest.approx(expected, rel=1e-9)
    assert said_by_stepper(system, caplog) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("rope", [(), (HOIST + LOWERED,)], ids=["without a hoist", "with a hoist"])
def test_a_run_out_of_balance_begins_in_the_equilibrium_of_a_stepper(rope: tuple[str, ...]) -> None:
    """The first acceleration, with which the boom is let go, does not bend it before."""
    scene = boom(*FREE, f"{FORCE}1.5e4", "start='equilibrium'", *rope)()
    moved, system = with_free_motion(scene, pmr.reduce(scene).system)
    found = simulate_form(SystemForm.of(system), Excitation.from_scene(moved)).forces[0]
    expected = pmr.Stepper(system, scene.time.step, {"fly": scene.paths["fly"].value(0.0)}).forces
    assert dict(zip(system.contact_names, found, strict=True)) == pytest.approx(
        expected, abs=1e-9 * np.abs(found).max()
    )


def test_a_displacement_too_large_for_the_theory_has_one_warning(caplog: pytest.LogCaptureFixture) -> None:
    system = pmr.reduce(free_boom.scene(*PLAIN)).system
    stepper = pmr.Stepper(system, 1e-3, {"fly": 0.6}, outputs=["fly: tip z"])
    with caplog.at_level(logging.WARNING):
        for _ in range(300):
            stepper.step({"fly": 0.6}, {"fly.hook z": -2e6})
    (line,) = [of.getMessage() for of in caplog.records if "theory of small motions does not hold" in of.getMessage()]
    assert "is more than 0.1 times the greatest length of the boom, 3.6 m" in line
