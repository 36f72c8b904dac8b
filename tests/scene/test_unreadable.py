"""Files that can't be read, nests that no stack holds: one line each.
Keys without an effect: refused where they stand beside what decides so, and taken over from what others share.
"""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from pmr import InputError
from pmr import scene as scenes
from pmr.studies import call as studies

PAPER = Path(__file__).parents[2] / "workflows" / "paper_simple.toml"
NOBODY = 65534


def refused(file: Path, *overrides: str) -> str:
    with pytest.raises(InputError) as error:
        scenes.load(file, overrides)
    assert "\n" not in str(error.value)
    return str(error.value)


def extending(folder: Path, more: str) -> Path:
    file = folder / "scene.toml"
    file.write_text(f'extends = "{PAPER}"\n{more}\n')
    return file


@contextmanager
def as_nobody() -> Iterator[None]:
    """Root may read everything; anybody else has the same rights as before."""
    before = os.geteuid()
    if before == 0:
        os.seteuid(NOBODY)
    try:
        yield
    finally:
        os.seteuid(before)


@pytest.fixture
def open_folder() -> Iterator[Path]:
    """One that anybody may look into, in contrast to pytest's own."""
    folder = Path(tempfile.mkdtemp())
    folder.chmod(0o755)
    yield folder
    shutil.rmtree(folder)


def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "folder.toml").mkdir()
    (tmp_path / "broken.toml").symlink_to("nowhere")
    (tmp_path / "loop.toml").symlink_to("loop.toml")
    assert refused(tmp_path / "folder.toml").endswith("no such scene file, but a folder")
    for name in ("folder.toml", "broken.toml", "loop.toml", f"{'x' * 300}.toml"):
        assert "no such scene file" in refused(tmp_path / name)


@pytest.mark.parametrize("name", ["folder", "broken", "loop", "x" * 300, "a\\u0000b"])
@pytest.mark.parametrize(
    ("more", "says"),
    [
        ('[mesh]\nfile = "{}"', "mesh.file = .*: no such file"),
        ('[slider]\npath = {{ kind = "table", file = "{}" }}', "slider.path: no such file"),
    ],
)
def test_a_file_that_a_scene_names_and_that_is_none_is_refused(tmp_path: Path, name: str, more: str, says: str) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "broken").symlink_to("nowhere")
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(InputError, match=says):
        scenes.load(extending(tmp_path, more.format(name)))


@pytest.mark.parametrize("name", ["folder", "broken", "loop", "x" * 300, "a\\u0000b"])
def test_a_base_that_is_none_is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "broken").symlink_to("nowhere")
    (tmp_path / "loop").symlink_to("loop")
    file = tmp_path / "scene.toml"
    file.write_text(f'extends = "{name}"\n')
    says = "the name of a scene file is allowed; there is none" + ", but a folder" * (name == "folder")
    assert refused(file).endswith(says)


def test_text_in_another_encoding_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "latin.toml"
    file.write_bytes("title = 'ü'".encode("latin1"))
    assert "not valid TOML: 'utf-8' codec can't decode" in refused(file)
    (tmp_path / "path.csv").write_bytes(b"0,1\n1,\xfc\n")
    table = extending(tmp_path, '[slider]\npath = { kind = "table", file = "path.csv" }')
    assert "path.csv: text is allowed" in refused(table)


def test_a_file_without_permission_is_refused(open_folder: Path) -> None:
    for name, more in (
        ("mesh.msh", '[mesh]\nfile = "mesh.msh"'),
        ("path.csv", '[slider]\npath = { kind = "table", file = "path.csv" }'),
    ):
        secret, scene = open_folder / name, extending(open_folder, more)
        secret.write_text("0,1\n1,2\n")
        secret.chmod(0o000)
        with as_nobody():
            assert "can't be read: Permission denied" in refused(scene)
    scene.chmod(0o000)
    with as_nobody():
        assert refused(scene) == f"{scene}: can't be read: Permission denied"


def test_a_file_that_opens_and_can_not_be_read_is_refused(tmp_path: Path) -> None:
    """Of this one, the process's own memory, the system lets nobody read the beginning; so do disks that fail."""
    for more in ('[mesh]\nfile = "/proc/self/mem"', '[slider]\npath = { kind = "table", file = "/proc/self/mem" }'):
        assert "can't be read: Input/output error" in refused(extending(tmp_path, more))


@pytest.mark.parametrize(
    "text",
    [
        "a = " + 5000 * "[" + 5000 * "]",
        "a = " + 5000 * "{a = " + "1" + 5000 * "}",
        "[" + ".".join(3000 * "a") + "]\nb = 1",
        "a = " + 41 * "[" + 41 * "]",
        ".".join(100_000 * "a") + " = 1",
        "a = { b = 1, " + " . ".join(["b", '"c.d"', "'e'"] * 20_000) + " = 1 }",
    ],
)
def test_deep_nests_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "deep.toml").write_text(text)
    assert "at most 40 tables or lists within each other are allowed" in refused(tmp_path / "deep.toml")
    with pytest.raises(InputError, match="at most 40 tables"):
        studies.load(tmp_path / "deep.toml")


def test_dots_in_text_are_no_deep_key(tmp_path: Path) -> None:
    assert scenes.load(extending(tmp_path, f'title = "{"a." * 100}"')).title == "a." * 100


@pytest.mark.parametrize("number", [f"0x{'f' * 4000}", str(2**63), str(-(2**63) - 1), "9" * 5000])
def test_integers_of_more_than_64_bits_are_refused(number: str, tmp_path: Path) -> None:
    for key in ("title", "time.end", "a.b"):
        assert "not valid TOML" in refused(extending(tmp_path, f"{key} = {number}"))
        assert f"--set: {key}" in refused(PAPER, f"{key}={number}")


def test_a_file_larger_than_any_scene_is_refused(tmp_path: Path) -> None:
    with (tmp_path / "large.toml").open("wb") as file:
        file.truncate(10**9)
    assert "at most 100 MB" in refused(tmp_path / "large.toml")


def test_deep_options_are_refused() -> None:
    assert "at most 40 tables" in refused(PAPER, "title=" + 5000 * "[" + 5000 * "]")
    assert "section.key=value is allowed" in refused(PAPER, ".".join(3000 * "a") + "=1")


def test_a_long_chain_of_files_is_refused(tmp_path: Path) -> None:
    base = str(PAPER)
    for number in range(1200):
        (tmp_path / f"{number}.toml").write_text(f'extends = "{base}"\n')
        base = f"{number}.toml"
    assert scenes.load(tmp_path / "38.toml").title == scenes.load(PAPER).title
    assert "at most 40 files that extend one another are allowed" in refused(tmp_path / "1199.toml")


def test_what_is_taken_over_may_be_of_use_to_others(tmp_path: Path) -> None:
    """A shell's scene with a beam in its place, sections that share what some have no use for; not one's own file."""
    assert scenes.load_any("boom_shell", ["body.model=beam3d"])
    assert scenes.load_any("boom_three", ["section.mesh.size=0.1", "section.body.box.frame_depth=0.1"])
    assert scenes.load_any("boom_three_shell", ["sections.base.body.model=beam3d"])
    own = tmp_path / "scene.toml"
    own.write_text('extends = "boom_shell"\nbody.model = "beam3d"')
    assert scenes.load_any(own)
    own.write_text('extends = "boom_shell"\nbody.model = "beam3d"\nmesh.size = 0.2')
    with pytest.raises(InputError, match=r"scene.toml: mesh.size: leave it out"):
        scenes.load_any(own)
