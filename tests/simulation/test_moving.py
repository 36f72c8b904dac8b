"""What drives a frame from outside, beside the signals of the scene that a run follows."""

from copy import deepcopy
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import driven_frame
import numpy as np
import pytest
from simulation.test_frame import MOVED, THREE, TURNING

from pmr import InputError
from pmr import scene as scenes
from pmr.simulation import Excitation
from pmr.simulation.moving import MovingFrame, read_scene


def system_of(scene: Any) -> Any:
    """Names of inputs and terms, which is all of a system that is asked for."""
    excitation = Excitation.from_scene(scene)
    return SimpleNamespace(
        bodies=dict.fromkeys(scene.names),
        paths=tuple(scene.paths),
        provenance=scene.provenance,
        input_names=tuple(excitation.loads),
        load_names=tuple(excitation.loads),
        term_names=tuple(excitation.terms),
    )


@pytest.mark.parametrize("second_order", ["true", "false"])
@pytest.mark.parametrize("changes", MOVED.values(), ids=MOVED)
def test_amplitudes_are_those_of_a_run(changes: tuple[str, ...], second_order: str) -> None:
    """At instants where gravity rises, the base rocks and a force keeps its direction on the ground."""
    order = f"frame.second_order={second_order}"
    scene = scenes.load_any(THREE, [*changes, order, "sections.fly.loads.0.axes=ground", "gravity.rise=3.0"])
    frame, excitation = MovingFrame.from_system(system_of(scene)), Excitation.from_scene(scene)
    assert frame is not None and "fly.tip force" in frame.loads
    for t in (0.0, 0.7, 2.3, 3.9):
        f, c = driven_frame.find(frame, frame.motions(excitation, t))
        for found, signals in ((f, excitation.loads), (c, excitation.terms)):
            expected = np.array([one.value(t) for one in signals.values()])
            assert found == pytest.approx(expected, abs=1e-13 * np.abs(expected).max(initial=0.0))


def test_it_starts_with_all_of_the_weight() -> None:
    frame = MovingFrame.from_system(system_of(scenes.load_any(THREE, [*TURNING, "gravity.rise=3.0"])))
    assert frame is not None
    assert frame.start[0, frame.drivers.index("gravity")] == pytest.approx(9.80665)
    assert frame.start[:, frame.drivers.index("slewing")] == pytest.approx([0.0, 0.8 * 0.2 * np.pi, 0.0])


def test_without_a_frame_or_a_scene_there_is_none() -> None:
    assert MovingFrame.from_system(system_of(scenes.load_any(THREE))) is None
    assert MovingFrame.from_system(SimpleNamespace(provenance={})) is None  # type: ignore[arg-type]


@pytest.mark.parametrize("entry", ["frame", "loads"])
def test_a_scene_in_a_model_reads_no_file(entry: str, tmp_path: Path) -> None:
    """As whoever opens a model of others would read a file of their own."""
    (tmp_path / "private.csv").write_text("0.0, 0.1\n1.0, 0.2\n")
    system = system_of(scenes.load_any(THREE, TURNING))
    table = {"kind": "table", "file": str(tmp_path / "private.csv")}
    stored = deepcopy(system.provenance["scene"])
    if entry == "frame":
        stored["frame"]["slewing"] = table
    else:
        stored["sections"][-1]["loads"][0]["signal"] = table
    system.provenance = {"scene": stored}
    with pytest.raises(InputError, match="a signal in a saved model contains its numbers; it reads no file"):
        read_scene(system, "model")


def test_a_term_that_the_scene_does_not_drive_is_refused() -> None:
    system = system_of(scenes.load_any(THREE, [*TURNING, "frame.second_order=true"]))
    system.term_names = (*system.term_names, "wind")
    with pytest.raises(
        InputError, match="provenance.scene = 'wind': what the scene drives is allowed: base: rotating x"
    ):
        MovingFrame.from_system(system)
