"""Keys of a scene in words, with values in the units that the scene declares."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import plain_machines
import pytest

from pmr.cli.app import TEMPLATES
from pmr.report.columns import forces_of, tip_displacements
from pmr.report.scene_tables import SceneWords, input_tables, size_rows
from pmr.report.subject import field_times, reach, slider_offsets
from pmr.scene import Load, load_any

SPACE = "\u00a0"


def rows(scene: str | Path, *changes: str, title: str = "Body, pads and loads") -> dict[str, str]:
    """Rows of the table called `title` of a workflow, or of a scene file, with these changes."""
    tables = input_tables(load_any(scene, changes))
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
    machine = "{mass=12e3,free=['z','ry','rz'],stiffness={z=4e6,ry=9e6},damping={},start={rz=2.0},rate={z=1.5}}"
    changes = (f"frame.machine={machine}", "frame.second_order=false")
    shown = rows(plain_machines.CRANE, *changes, title=settings)["frame machine"]
    support = "{name='spring',on=1.0,directions=['ry'],stiffness=2e6}"
    held = rows("boom_beam", f"supports=[{support}]")["support spring"]
    assert held == f"on 1{SPACE}m, directions ry, stiffness 2{SPACE}MN{SPACE}m/rad"
    for text in ("mass 12\u202f000\u00a0kg", "z 4\u00a0kN/mm", "ry 9\u00a0MN\u00a0m/rad", "rz 2°", "z 1.5\u00a0m/s"):
        assert text in shown


def test_tables_within_a_table_have_their_names() -> None:
    ground = rows("crane_outriggers", title="Time stepping and settings")["frame ground"]
    assert f"masses carrier mass 7500{SPACE}kg" in ground and f"outriggers front left at (2.6, 2.4){SPACE}m" in ground


@pytest.mark.parametrize(
    ("scene", "unused"),
    [("boom_beam", ("reduction snapshots", "mesh size")), ("boom_shell", ("mesh elements",)),
     ("paper_simple", ("body material",))],
)  # fmt: skip
def test_keys_without_effect_are_left_out(scene: str, unused: tuple[str, ...]) -> None:
    assert not set(unused) & set(rows(scene))


def test_a_section_on_a_rope_has_no_rigid_cylinder_and_cells_of_walls_are_no_elements() -> None:
    assert {"joint cylinder"} <= set(rows("platform", title="first")) and "joint cylinder" not in rows(
        "platform", title="second"
    )
    walls = rows(Path(str(TEMPLATES / "crane.toml")), title="fly")
    assert walls["mesh along"] == f"200{SPACE}mm, shell of walls" and walls["mesh elements"] == "12"


def test_a_key_that_differs_from_its_default_is_shown_and_others_of_settings_are_not() -> None:
    settings = "Time stepping and settings"
    assert "recovery stress" not in rows("boom_shell", title=settings)
    assert rows("boom_shell", "recovery.stress=false", title=settings)["recovery stress"] == "no"
    assert rows("paper_simple", title=settings)["compare ancf elements"]


def test_the_tips_directions_are_the_last_columns(boom, make_space) -> None:
    response = boom.responses["full"]
    found = {d: what(response) for d, what in tip_displacements(boom).items()}
    assert list(found) == ["y", "z"]
    assert np.array_equal(found["y"], response.displacement[:, -2]) and np.ptp(found["y"]) < 0.0061
    assert np.array_equal(found["z"], response.tip)
    assert list(tip_displacements(make_space(body={"model": "beam2d", "box": boom.scene.body.box}))) == ["z"]


def test_forces_are_named_and_a_planar_beam_feels_no_pads_on_its_sides(boom, make_space) -> None:
    tail, mouth = ["tail bottom right", "tail bottom left"], ["mouth bottom right", "mouth bottom left", "mouth top"]
    assert [force.name for force in forces_of(boom)] == [*tail, "tail left", *mouth, "mouth right"]
    planar = make_space(body={"model": "beam2d", "box": boom.scene.body.box})
    assert [force.name for force in forces_of(planar)] == [*tail, *mouth]


def test_places_and_times(boom) -> None:
    assert (slider_offsets(boom), reach(boom)) == ((0.0,), 6.0)
    assert np.allclose(field_times(boom, boom.body), np.linspace(0.0, 1.0, 21))  # the scene's recovery


@pytest.mark.parametrize(
    ("keys", "unit"),
    [
        ({"on": "tip", "direction": "z"}, "N"),
        ({"on": "tip", "direction": "ry"}, f"N{SPACE}m"),
        ({"direction": "z", "acts": "temperature"}, "K"),
        ({"acts": "wind"}, "Pa"),
    ],
)
def test_a_load_has_the_unit_of_what_acts(keys: dict[str, str], unit: str) -> None:
    load = Load.model_validate({"name": "L", "signal": 4.0} | keys)
    assert f"amount 4{SPACE}{unit}" in SceneWords().describe(load)


def test_sizes_tell_the_coordinates_of_the_scene_from_those_on_top(make_result) -> None:
    """Sections have 8 of their key and some for cylinders and second order; with a tolerance, keys have no effect."""
    counts = [{"name": name, "coordinates": {"full": 115, "reduced": n}} for name, n in (("base", 10), ("fly", 12))]
    summary = {"sections": counts, "frame": {"second_order": True}, "coordinates": {"reduced": 22}}
    result = replace(make_result(summary=summary), scene=load_any(Path(str(TEMPLATES / "crane.toml"))))
    sizes = dict(size_rows(result))
    assert [sizes[f"coordinates of {name}"] for name in ("base", "fly")] == ["115 → 8 + 2", "115 → 8 + 4"]
    assert sizes["coordinates behind +"] == "for cylinders and second order"
    sizes = dict(size_rows(replace(result, summary=summary | {"accuracy": {}})))
    assert sizes["coordinates of base"] == "115 → 10" and "coordinates behind +" not in sizes
