"""Keys of a scene in words, with values in the units that the scene declares."""

from __future__ import annotations

from pathlib import Path

import pytest

from pmr.report.scene_tables import input_tables
from pmr.scene import load_any

WORKFLOWS = Path(__file__).parents[2] / "workflows"
SPACE = "\u00a0"


def rows(name: str, *changes: str, title: str = "Body, pads and loads") -> dict[str, str]:
    """Rows of the table called `title` of a workflow with these changes."""
    tables = input_tables(load_any(WORKFLOWS / f"{name}.toml", changes))
    return dict(next(table.rows for table in tables if table.title == title))


def test_numbers_have_the_units_that_the_scene_declares() -> None:
    boom = rows("boom_beam")
    assert boom["body box"].startswith(f"width 300{SPACE}mm, height 400{SPACE}mm, wall 8{SPACE}mm")
    assert f"Young's modulus 210{SPACE}GPa" in boom["body material"]
    assert f"smooth ramp, times (1, 5, 9){SPACE}s, values (1.5, 4, 1.5){SPACE}m, degree 5" == boom["slider path"]
    assert f"stiffness 300{SPACE}kN/mm" in boom["pad tail"] and f"amplitude 2{SPACE}kN" in boom["load tip force"]
    assert f"(9 values, −1 to 1){SPACE}kN" in boom["load gust"]
    settings = rows("boom_beam", "time.step=2e-3", title="Time stepping and settings")
    assert settings["time step"] == f"2{SPACE}ms" and settings["steps"] == "5000"


def test_angles_are_in_degrees_and_rotations_have_their_units() -> None:
    settings = "Time stepping and settings"
    assert rows("crane", title=settings)["frame luffing"].endswith("values (10, 60)°, degree 5")
    radians = rows("crane", "frame.unit=rad", "frame.luffing=0.7", "frame.slewing=0.3", title=settings)
    assert radians["frame luffing"].endswith("amount 40.10705°")
    machine = "{mass=12e3,free=['z','ry'],stiffness={z=4e6,ry=9e6},damping={},start={ry=2.0},rate={z=1.5}}"
    changes = (f"frame.machine={machine}", "frame.second_order=false")
    shown = rows("crane", *changes, title=settings)["frame machine"]
    for text in ("mass 12\u202f000\u00a0kg", "z 4\u00a0kN/mm", "ry 9\u00a0MN\u00a0m/rad", "ry 2°", "z 1.5\u00a0m/s"):
        assert text in shown


@pytest.mark.parametrize(
    ("scene", "unused"),
    [("boom_beam", ("reduction snapshots", "mesh size")), ("boom_shell", ("mesh elements",)),
     ("paper_simple", ("body material",))],
)  # fmt: skip
def test_keys_without_effect_are_left_out(scene: str, unused: tuple[str, ...]) -> None:
    assert not set(unused) & set(rows(scene))


def test_a_key_that_differs_from_its_default_is_shown_and_others_of_settings_are_not() -> None:
    settings = "Time stepping and settings"
    assert "recovery stress" not in rows("boom_shell", title=settings)
    assert rows("boom_shell", "recovery.stress=false", title=settings)["recovery stress"] == "no"
    assert rows("paper_simple", title=settings)["compare ancf elements"]
