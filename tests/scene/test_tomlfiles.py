"""Entries of lists are changed by their names, or by their numbers, from wherever a change comes."""

from pathlib import Path

import pytest

from pmr import InputError
from pmr import scene as scenes
from pmr.scene.tomlfiles import Change, Dialect, TomlFile, override

PLAIN = Dialect("file")


def read(folder: Path, text: str, dialect: Dialect = PLAIN) -> TomlFile:
    (folder / "a.toml").write_text(text)
    return TomlFile.read(folder / "a.toml", dialect)


def test_changes_are_laid_over_a_file_and_stay_as_they_are(tmp_path: Path) -> None:
    file = read(tmp_path, "x.a = 1\nx.b = 2")
    new, more = Change({"y": {"a": [1]}}, "first"), Change({"y": {"b": 2}, "x": {"b": 3}}, "second")
    file.apply(new)
    file.apply(more)
    assert file.data == {"x": {"a": 1, "b": 3}, "y": {"a": [1], "b": 2}}
    assert new.tables == {"y": {"a": [1]}}
    assert [file.origin(key) for key in ("x.a", "x.b", "y.b")] == [str(tmp_path / "a.toml"), "second", "second"]


def test_a_key_with_a_name_in_several_words_has_the_source_of_its_own_table(tmp_path: Path) -> None:
    file = read(tmp_path, "x.'lower plate'.a = 1")
    file.apply(Change({"x": {"lower plate": {"a": 2}}}, "change"))
    assert [file.origin(key) for key in ("x.lower plate", "x.lower plate.a", "x")] == ["change", "change", "change"]
    file.apply(Change({"x": {"b": 2}}, "another"))
    assert [file.origin(key) for key in ("x.lower plate", "x.lower plate.a", "x")] == ["change", "change", "another"]


def test_an_option_is_a_change() -> None:
    assert override("a.b=[1, 2]") == Change({"a": {"b": [1, 2]}}, "--set")
    assert override("a = word") == Change({"a": "word"}, "--set")
    with pytest.raises(InputError, match=r"--set: a\.b: section\.key=value"):
        override("a.b")


def test_part_of_a_list_cannot_be_changed(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="here: x.y.z = 2: this list can't be changed in part"):
        read(tmp_path, "x = [1]").apply(Change({"x": {"y": {"z": 2}}}, "here"))


def test_names_of_files_are_relative_to_the_file_they_stand_in(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "base.toml").write_text('names = ["m", "n"]\n[x]\nfile = "b.msh"\nown = 1\n')
    file = read(tmp_path, 'extends = "sub/base.toml"\nother = "c"', Dialect("file", ("names", "file"), ("own",)))
    sub = tmp_path / "sub"
    assert file.data == {"names": [str(sub / "m"), str(sub / "n")], "x": {"file": str(sub / "b.msh"), "own": 1},
                         "other": "c"}  # fmt: skip


def test_what_belongs_to_a_file_alone_is_not_taken_over(tmp_path: Path) -> None:
    (tmp_path / "base.toml").write_text("own = 1\nother = 2\n")
    assert read(tmp_path, 'extends = "base.toml"', Dialect("file", not_inherited=("own",))).data == {"other": 2}


DAMPED = Dialect("file", alternatives={"d": (("a", "b"), ("c", "e"))})


def test_another_way_to_say_the_same_takes_over_nothing(tmp_path: Path) -> None:
    (tmp_path / "base.toml").write_text("[d]\nc = 1\ne = 2\nkept = 3\n")
    file = read(tmp_path, 'extends = "base.toml"\n[d]\na = 4', DAMPED)
    assert file.data == {"d": {"a": 4, "kept": 3}}
    file.apply(Change({"d": {"e": 5}}, "--set"))
    assert file.data == {"d": {"e": 5, "kept": 3}} and file.origin("d.e") == "--set"
    file.apply(Change({"d": {"c": 6}}, "--set"))
    assert file.data == {"d": {"c": 6, "e": 5, "kept": 3}}  # of one way: together


BOOM = Path("workflows/boom_beam.toml").resolve()


def test_by_name_by_number_and_inside_a_signal() -> None:
    scene = scenes.load(
        BOOM, ["masses.payload.mass=500.0", "loads.1.direction=z", "loads.tip force.signal.amplitude=1.0"]
    )
    assert scene.masses[0].mass == 500.0 and scene.masses[0].on == "tip"
    assert scene.loads[1].direction == "z" and scene.loads[0].signal.amplitude == 1.0
    assert scene.loads[0].signal.frequencies == (0.5, 6.0)


def test_in_a_file_that_extends_another(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(
        f"extends = '{BOOM}'\n[loads.gust]\ndirection = 'z'\n[pads.mouth]\nwidth = 0.05\n"
    )
    scene = scenes.load(tmp_path / "mine.toml")
    assert [load.direction for load in scene.loads] == ["z", "z"] and len(scene.pads) == 2
    assert scene.pads[1].width == 0.05 and scene.pads[1].moving


def test_two_of_one_name_are_told_apart_by_number_alone(tmp_path: Path) -> None:
    text = BOOM.with_name("boom.toml").read_text().replace('name = "gust"', 'name = "tip force"')
    (tmp_path / "two.toml").write_text(text)
    with pytest.raises(InputError, match="number"):
        scenes.load(tmp_path / "two.toml", ["loads.tip force.direction=y"])
