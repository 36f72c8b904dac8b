"""A body alone as `[body]` and as `[[sections]]` with one entry: one scene, with messages in the words of each file."""

import re
from pathlib import Path

import pytest

from pmr import InputError
from pmr import scene as scenes
from pmr.scene import Scene

BODY = """
body = {model = "beam2d", box = {length = 6.0, width = 0.3, height = 0.4, wall = 0.008}}
mesh = {elements = 30}
supports = [{on = "tail", kind = "pinned"}]
pads = [{name = "mouth", moving = true, faces = {bottom = [0.0], top = [0.0]}}]
loads = [{name = "F", signal = 1000.0}]
slider = {path = {kind = "ramp", times = [0.0, 0.2], values = [2.0, 2.5]}}
"""
WHOLE = 'title = "A boom"\ntime = {end = 0.2, step = 1e-3}\n'


def written(folder: Path, listed: bool, whole: str = WHOLE) -> Path:
    """The file of one body, at the top or as the only section."""
    file = folder / f"{'sections' if listed else 'body'}.toml"
    file.write_text(whole + (f'[[sections]]\nname = "mast"\n{BODY}' if listed else BODY))
    return file


@pytest.mark.parametrize("more", ["", "gravity = {}\n", 'start = "equilibrium"\ngravity = {}\n'])
def test_one_body_is_one_scene_however_it_is_written(tmp_path: Path, more: str) -> None:
    listed, top = (scenes.load(written(tmp_path, way, WHOLE + more)) for way in (True, False))
    assert listed.hash == top.hash and listed.names == top.names == ("",)
    assert [one for one in Scene.model_fields if getattr(listed, one) != getattr(top, one)] == ["sections"]
    assert listed.only_section.model_copy(update={"name": ""}) == top.only_section
    for scene in (listed, top):
        assert Scene.model_validate_json(scene.model_dump_json()) == scene
    assert "body" in top.model_dump()  # as files of earlier versions have it


REFUSED = [
    ("mesh.elements=0", "mesh.elements = 0: input should be"),
    ("slider.path=9.0", "slider.path: the pad mouth bottom reaches"),
    ("body.box.wall=0.3", "body.box.wall = 0.3: less than 0.15 m"),
    ("reduction.coordinates=1e9", "reduction.coordinates = "),
    ("loads.F.on=7.0", "loads[0].on = 7.0: on the body, 0 to 6 m"),
    ("mesh.size=0.1", "mesh.size: leave it out: it has no effect on beam2d"),
    ("reduction.basis=file", "reduction.file: a file goes with basis"),
    ("bodi=1", "bodi = 1: unknown key; did you mean 'body'?"),
]


@pytest.mark.parametrize(("change", "said"), REFUSED)
@pytest.mark.parametrize("listed", [True, False])
def test_a_refusal_names_the_key_as_the_file_writes_it(tmp_path: Path, listed: bool, change: str, said: str) -> None:
    with pytest.raises(InputError) as refused:
        scenes.load(written(tmp_path, listed), [f"sections.mast.{change}" if listed else change])
    where = "sections[0]." if listed else ""
    assert str(refused.value).startswith(f"--set: {where}{said}")


def test_a_section_alone_needs_a_path_and_has_no_joint(tmp_path: Path) -> None:
    file = written(tmp_path, True)
    file.write_text(re.sub("slider = .*\n", "", file.read_text()))
    with pytest.raises(InputError, match=r"sections\[0\].slider: a table slider is needed, with the path"):
        scenes.load(file)
    with pytest.raises(InputError, match=r"sections\[2\].slider: leave it out, as joints move the sections of a boom"):
        scenes.load_any("boom_three", ["sections.fly.slider.path=1.0"])


def test_weight_is_there_from_the_start_where_motions_begin_in_equilibrium(tmp_path: Path) -> None:
    """In both dialects, with an empty table as with a key in it; what is given counts."""
    for listed in (True, False):
        for start, rise in (("rest", 1.0), ("equilibrium", 0.0)):
            found = scenes.load(written(tmp_path, listed, WHOLE + f'start = "{start}"\ngravity = {{}}\n'))
            assert found.gravity is not None and (found.start, found.gravity.rise) == (start, rise)
    data = scenes.load_any("boom_two").model_dump(mode="json", exclude={"start", "gravity"})
    for more, start, rise in (({}, "equilibrium", 0.0), ({"gravity": {}}, "equilibrium", 0.0), (REST, "rest", 1.0)):
        boom = Scene.model_validate(data | more)
        assert boom.gravity is not None and (boom.start, boom.gravity.rise) == (start, rise)
    assert scenes.load(written(tmp_path, True)).gravity is None  # a body alone has no weight without the table


REST = {"start": "rest"}
