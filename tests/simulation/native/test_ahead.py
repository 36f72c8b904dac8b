"""What is compiled ahead is what a run asks for; who needs it in the meantime does other work, or waits for it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from nested import Nested, reduced
from on_pads import beam_on_pads, driven, modes_on_pads

from pmr.scene import load_any
from pmr.scene.signals import Constant
from pmr.simulation import Excitation
from pmr.simulation.native import ahead, linking, parts
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.handles import handle
from pmr.simulation.native.march import March
from pmr.simulation.stepping import TimeStepping
from pmr.system.system import System

WORKFLOWS = Path(__file__).parents[3] / "workflows"
STEPPING = TimeStepping(0.01, 1e-3)
ON_PADS = driven(Constant(amount=3.0), (Constant(amount=9.81), Constant(amount=0.0)), STEPPING)


def loop_of(system: System, drive: Excitation = ahead.DRIVE) -> Any:
    return March(SystemForm.of(system), drive, {}).loop


def nested(sections: int, clearance: float | None) -> Any:
    boom = reduced(Nested(sections, elements=6, clearance=clearance), 3)
    paths, loads = (dict.fromkeys(names, Constant(amount=2.0)) for names in (boom.paths, boom.input_names))
    return loop_of(boom, Excitation(paths, loads, STEPPING))


def on_pads() -> Any:
    return loop_of(System.of(modes_on_pads(beam_on_pads(1e-3, elements=4), 4)), ON_PADS)


@pytest.mark.parametrize(
    ("small", "real"),
    [
        pytest.param(ahead.held, lambda: nested(1, None), id="a beam"),
        pytest.param(ahead.pushed, on_pads, id="on pads"),
        pytest.param(ahead.several, lambda: nested(2, 1e-4), id="a boom"),
    ],
)
def test_small_systems_have_the_loops_of_real_ones(small: Callable[[], System], real: Callable[[], Any]) -> None:
    assert handle(loop_of(small())).kind == handle(real()).kind


@pytest.mark.parametrize("system", [ahead.pushed, ahead.several])
def test_all_that_a_step_in_parts_calls_is_compiled(system: Callable[[], System]) -> None:
    loop = loop_of(system())
    assert loop.levels.calls.all() and loop.state.contact.calls.all()
    assert loop.sides is None or loop.sides.calls.all()


def test_it_is_that_of_the_scene() -> None:
    chosen = {"paper_simple": ahead.held, "boom_shell_pushing": ahead.pushed, "boom_three": ahead.several}
    scenes = {name: load_any(WORKFLOWS / f"{name}.toml") for name in chosen}
    assert {name: ahead.system_like(scene) for name, scene in scenes.items()} == chosen


def test_what_another_process_compiles_comes_last(monkeypatch: pytest.MonkeyPatch) -> None:
    asked, loop = list[Any](), loop_of(ahead.several())
    monkeypatch.setattr(linking, "known", lambda *one: False)
    monkeypatch.setattr(linking, "claimed", lambda function: function is parts.take_step)
    monkeypatch.setattr(linking, "address_of", lambda function, *kinds: asked.append(function) or 1)
    linking.link(loop)
    assert asked[-1] is parts.take_step and len(set(asked)) == len(asked) == 5
