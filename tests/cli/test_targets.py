"""Where a command may write: a file takes the place of a file or of nothing, never of what the command reads."""

import os
from pathlib import Path

import pytest
from oracle import flexible, rich_body
from processes import called

KINDS = ("a link", "a folder", "a device or a pipe")
LONG = "x" * 300


def made(place: Path, kind: str) -> Path:
    """Something that is no file."""
    if kind == "a link":
        place.with_name("precious").write_text("mine")
        place.symlink_to("precious")
    elif kind == "a folder":
        place.mkdir()
    else:
        os.mkfifo(place)
    return place


@pytest.fixture
def model(tmp_path: Path) -> Path:
    return flexible(rich_body(), 6).save(tmp_path / "self.npz")


def refused(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    done = called(monkeypatch, capsys, *arguments)
    assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
    return done.stderr


@pytest.mark.parametrize("kind", KINDS)
def test_a_link_a_folder_and_a_pipe_stay(kind: str, model: Path, tmp_path: Path, monkeypatch, capsys) -> None:
    there = made(tmp_path / "there.op4", kind)
    before = os.lstat(there)
    said = refused(monkeypatch, capsys, "export", str(model), "--to", "op4", "--out", str(there))
    assert f"is {kind}, which is not replaced" in said
    now = os.lstat(there)  # its time of access may change: who follows a link reads it
    assert (now.st_ino, now.st_mode, now.st_mtime_ns) == (before.st_ino, before.st_mode, before.st_mtime_ns)
    assert kind != "a link" or there.read_text() == "mine"


@pytest.mark.parametrize("kind", KINDS)
def test_so_they_do_among_results(kind: str, tmp_path: Path, monkeypatch, capsys) -> None:
    there = made(tmp_path / "summary.json", kind)
    said = refused(monkeypatch, capsys, "run", "paper_simple", "--out", str(tmp_path))
    assert f"is {kind}, which is not replaced" in said and there.lstat()


def test_what_a_command_reads_it_does_not_write_over(model: Path, tmp_path: Path, monkeypatch, capsys) -> None:
    scene, K = tmp_path / "scene.toml", tmp_path / "K.npz"
    scene.write_text('extends = "boom_beam"\n')
    K.write_bytes(model.read_bytes())
    (tmp_path / "same.mat").write_bytes(model.read_bytes())
    for read, asked in (
        (model, ["export", str(model), "--to", "op4", "--out", str(model)]),
        (model, ["export", str(model), "--to", "op4", "--out", f"{tmp_path}/../{tmp_path.name}/self.npz"]),
        (tmp_path / "same.mat", ["export", f"{tmp_path}/same.mat", "--to", "python-control", "--out", "same.py"]),
        (scene, ["flexible", str(scene), "--at", "1", "--out", str(scene)]),
        (K, ["matrices", str(K), "--out", str(K)]),
    ):
        content = read.read_bytes()
        monkeypatch.chdir(tmp_path)
        assert " is input of the same run" in refused(monkeypatch, capsys, *asked)
        assert read.read_bytes() == content


@pytest.mark.parametrize(
    "arguments",
    [
        ["run", LONG], ["new", "boom", LONG], ["info", f"{LONG}.npz"], ["export", LONG], ["matrices", LONG],
        ["study", LONG], ["simulate", LONG, "--scene", "paper_simple"], ["flexible", LONG, "--at", "1"],
        ["run", "paper_simple", "--out", LONG],
    ],
)  # fmt: skip
def test_a_name_that_no_file_can_have_is_one_line(arguments: list[str], monkeypatch, capsys, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    assert "Traceback" not in refused(monkeypatch, capsys, *arguments)


@pytest.mark.parametrize("command", [["info"], ["run"], ["study"], ["flexible", "--at", "1"], ["export"]])
def test_a_pipe_and_an_endless_device_are_no_input(command: list[str], tmp_path: Path, monkeypatch, capsys) -> None:
    os.mkfifo(tmp_path / "pipe")
    for name in (str(tmp_path / "pipe"), "/dev/zero"):
        assert "no such" in refused(monkeypatch, capsys, *command, name)
