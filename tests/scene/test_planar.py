import itertools
import json
import sys
from pathlib import Path

import numpy as np
import pytest

from pmr import InputError, scene
from pmr.scene import Scene
from pmr.scene.choice import fewest_rows
from pmr.scene.files import MOVED
from pmr.scene.members import member_at
from pmr.scene.scene import BodyFile
from pmr.scene.structures import Profile

WORKFLOWS = Path(__file__).parents[2] / "workflows"
SIMPLE = WORKFLOWS / "paper_simple.toml"


@pytest.mark.parametrize("name", ["paper_simple", "paper_evolved"])
def test_the_papers_scenes_hold_table_1(name: str) -> None:
    s = scene.load(WORKFLOWS / f"{name}.toml")
    expected = {"length": 5.0, "bending_stiffness": 5e4, "axial_stiffness": 2e7, "mass_per_length": 78.0, "axial": True}
    assert s.body.profile == Profile(**expected)
    assert (s.mesh.elements, s.compare.ancf_elements, s.time.steps, s.time.rho_inf) == (50, 20, 15000, 0.9)
    assert (s.reduction.snapshots, s.reduction.modes, s.reduction.coordinates, fewest_rows(member_at(s))) == (
        5,
        6,
        20,
        3,
    )
    assert s.path_bounds == (1.25, 3.75)


def test_a_signal_replaces_the_one_of_the_base_file_whole(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(
        f'extends = "{SIMPLE}"\nslider.path = {{ kind = "sine", amplitude = 1.0, frequency = 2.0, offset = 2.0 }}'
    )
    assert scene.load(file).slider.path.kind == "sine"


def test_overrides_take_toml_values_and_bare_words() -> None:
    s = scene.load(SIMPLE, ["reduction.coordinates=10", "reduction.solver=slepc", "body.profile.length = 5.5"])
    assert (s.reduction.coordinates, s.reduction.solver, s.body.length) == (10, "slepc", 5.5)


def test_free_modes_with_flexibility_need_few_coordinates_and_no_pool(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    text = (WORKFLOWS / "paper_base.toml").read_text().split("[reduction]")[0]
    file.write_text(f"{text}[slider]\npath = 2.0\n[[loads]]\non = 5.0\nsignal = 1.0\n")
    assert scene.load(file).reduction.coordinates == 6
    assert scene.load(file, ["reduction.flexibility=false"]).reduction.coordinates == 20
    assert scene.load(file, ["reduction.coordinates=1"]).reduction.coordinates == 1
    assert scene.load(file, ["reduction.coordinates=70"]).reduction.coordinates == 70  # more than any pool would hold
    with pytest.raises(InputError, match="at least 3 are allowed, the number of constraint rows"):
        scene.load(file, ["reduction.flexibility=false", "reduction.coordinates=2"])


def test_the_line_names_the_file_in_which_the_value_stands(tmp_path: Path) -> None:
    base, derived = tmp_path / "base.toml", tmp_path / "derived.toml"
    base.write_text(f'extends = "{SIMPLE}"\n[body.profile]\nmass_per_length = -1.0\n')
    derived.write_text('extends = "base.toml"\n[mesh]\nelements = 0\n')
    with pytest.raises(InputError) as caught:
        scene.load(derived)
    assert caught.value.source == str(base) and caught.value.key == "body.profile.mass_per_length"
    base.write_text(f'extends = "{SIMPLE}"\n')
    with pytest.raises(InputError) as caught:
        scene.load(derived)
    assert caught.value.source == str(derived) and caught.value.key == "mesh.elements"


def test_a_signal_replaced_whole_is_the_later_files(tmp_path: Path) -> None:
    middle, last = tmp_path / "middle.toml", tmp_path / "last.toml"
    middle.write_text(f'extends = "{SIMPLE}"\nslider.path.values = [1.0, 2.0]\n')
    last.write_text('extends = "middle.toml"\nslider.path = { kind = "ramp", times = [0, 1], values = [1, nan] }\n')
    assert scene.load(middle).path_bounds == (1.0, 2.0)
    with pytest.raises(InputError) as caught:
        scene.load(last)
    assert caught.value.source == str(last) and caught.value.key == "slider.path.values[1]"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("extends = 'none.toml'", "extends = 'none.toml': the name of a scene file is allowed; there is none"),
        ("extends = ''", "there is none"),
        ("extends = 'self.toml'", "extend itself"),
        ("a = ", "not valid TOML"),
        (
            "[[sections]]\nbody.box = {}\n[[sections.body.box.doublers]]",
            r"TOML: sections.body.box.doublers can't be added",
        ),
        (
            "[frame]\ncylinder = {}\n[frame.cylinder.oil]",
            r"frame.cylinder.oil can't be added here: a table in braces { }",
        ),
        ("extends = 3", "name of a scene file"),
    ],
)
def test_a_file_that_is_no_scene_is_refused(tmp_path: Path, text: str, says: str) -> None:
    file = tmp_path / "self.toml"
    file.write_text(text)
    with pytest.raises(InputError, match=says):
        scene.load(file)
    with pytest.raises(InputError, match="no such scene file"):
        scene.load(tmp_path / "other.toml")


def test_files_are_found_beside_the_scene_that_names_them(tmp_path: Path) -> None:
    (tmp_path / "s.csv").write_text("0, 1\n15, 2\n")
    (tmp_path / "base.toml").write_text(f'extends = "{SIMPLE}"\nslider.path = {{ kind = "table", file = "s.csv" }}')
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "scene.toml").write_text('extends = "../base.toml"\n')
    assert scene.load(tmp_path / "sub" / "scene.toml").path_bounds == (1.0, 2.0)


def test_the_hash_changes_with_what_decides_the_result_only(tmp_path: Path) -> None:
    reference = scene.load(SIMPLE).hash
    assert scene.load(SIMPLE, ["title=other"]).hash == reference
    assert scene.load(SIMPLE, ["body.profile.length=5.01"]).hash != reference
    defaults = ["observe.rotation=false", "damping.mass=0.0", "reduction.product=euclidean", "mesh.grading=1.0"]
    assert scene.load(SIMPLE, defaults).hash == reference != scene.load(SIMPLE, ["observe.rotation=true"]).hash
    csv = tmp_path / "s.csv"
    digests = []
    for end in (2, 3):
        csv.write_text(f"0, 1\n15, {end}\n")
        digests.append(scene.load(SIMPLE, [f"slider.path={{kind='table',file='{csv}'}}"]).hash)
    assert digests[0] != digests[1]
    for kind in ("ramp", "smooth_ramp", "table"):  # three kinds with the same keys
        digests.append(scene.load(SIMPLE, [f"slider.path={{kind='{kind}',times=[0.0,15.0],values=[1.0,2.5]}}"]).hash)
    assert len(set(digests)) == 5


def test_equal_scenes_are_equal_keys_of_a_table() -> None:
    """Though sections as `simulation` hold tables, which have no hash."""
    assert len({scene.load(SIMPLE), scene.load(SIMPLE), scene.load(SIMPLE, ["simulation.newton.maxIterations=9"])}) == 2
    booms = [scene.load_any(WORKFLOWS / "boom_two.toml") for _ in range(2)]
    assert len(set(booms)) == 1


def test_published_figures_stand_beside_their_own_scene_only(tmp_path: Path) -> None:
    assert scene.load(SIMPLE).published is not None
    assert scene.load(SIMPLE, ["title=mine"]).published is not None
    assert scene.load(SIMPLE, ["reduction.coordinates=10"]).published is None
    derived = tmp_path / "derived.toml"
    derived.write_text(f'extends = "{SIMPLE}"\n[reduction]\ncoordinates = 10\n')
    assert scene.load(derived).published is None


def test_an_override_may_mend_what_the_file_lacks(tmp_path: Path) -> None:
    file = tmp_path / "template.toml"
    file.write_text(f'extends = "{SIMPLE}"\n[body.profile]\nlength = -1\n')
    assert scene.load(file, ["body.profile.length=5.0"]).body.length == 5.0


def test_a_scene_survives_json() -> None:
    s = scene.load(WORKFLOWS / "paper_evolved.toml")
    assert Scene.model_validate(json.loads(s.model_dump_json())) == s


OLD = {
    "body": "length = 5.0, bending_stiffness = 5e4, axial_stiffness = 2e7, mass_per_length = 78.0, axial = true",
    "supports": "supports = [{ kind = 'roller' }, { at = 0.0 }]",
    "loads": "loads = [{ on = 5.0, signal = 1.0 }, { name = 'G', at = 5.0, signal = 1.0 }]",
    "holds": "holds = [{ name = 'cylinder' }]",
    "clamps": "clamps = [{ on = 'tail' }]",
    "reduction": "reduction.support_rows = 'drop'",
}


@pytest.mark.parametrize("key", MOVED)
def test_a_key_that_has_moved_is_refused_with_its_new_name(tmp_path: Path, key: str) -> None:
    file, (table, _, last) = tmp_path / "old.toml", key.partition(".")
    text = OLD[table]
    if table == "body":
        text = f"body.{last} = " + text.split(f"{last} = ")[1].split(",")[0].strip(" }")
    file.write_text(f'extends = "{SIMPLE}"\n{text}\n')
    with pytest.raises(InputError) as caught:
        scene.load(file)
    where = {"supports.at": "supports[1].at", "loads.at": "loads[1].at"}.get(key, key)
    assert (caught.value.source, caught.value.key) == (str(file), where)
    assert caught.value.allowed == f"this key is called {MOVED[key]} now" and "\n" not in str(caught.value)


def test_the_names_of_moved_keys_are_known() -> None:
    """What stands in their place is a key: else the advice would be refused."""
    known = BodyFile.model_json_schema()
    for new in MOVED.values():
        part = known
        for word in new.partition(" ")[0].split("."):
            found = part["properties"][word]
            found = found.get("items", next((way for way in found.get("anyOf", ()) if "$ref" in way), found))
            part = known["$defs"][found["$ref"].rpartition("/")[2]] if "$ref" in found else found


def test_a_path_of_many_rows_loads_in_the_time_that_reading_takes(tmp_path: Path) -> None:
    """15 calls and returns of functions a row, 0.05 s for 15,000 of them; checking them one by one took a minute."""
    calls = []
    for rows in (150, 15_000):
        t = np.linspace(0.0, 15.0, rows)
        np.savetxt(tmp_path / "path.csv", np.column_stack([t, 2.5 - 1.25 * np.cos(t)]), delimiter=",")
        count = itertools.count()
        sys.setprofile(lambda *event, count=count: next(count))
        loaded = scene.load(SIMPLE, [f"slider.path={{kind='table',file='{tmp_path}/path.csv'}}"])
        sys.setprofile(None)
        assert len(loaded.slider.path.breaks) == rows
        calls.append(next(count))
    assert calls[1] - calls[0] < 40 * (15_000 - 150)
