"""For which platforms an FMU has binaries."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from pmr.errors import InputError
from pmr.export.fmi import fmu
from pmr.export.fmi.description import Described
from pmr.export.fmi.fmu import PLATFORMS, Contents, Platform, chosen
from pmr.export.formats import Options, write


@pytest.mark.parametrize(
    ("machine", "system", "folder"),
    [
        ("x86_64", "Linux", "x86_64-linux"),
        ("aarch64", "Linux", "aarch64-linux"),
        ("AMD64", "Windows", "x86_64-windows"),
        ("arm64", "Darwin", "aarch64-darwin"),
    ],
)
def test_by_default_it_is_the_one_of_this_machine(monkeypatch, machine: str, system: str, folder: str) -> None:
    monkeypatch.setattr("platform.machine", lambda: machine)
    monkeypatch.setattr("platform.system", lambda: system)
    assert [one.folder_3 for one in chosen(None, "3")] == [folder] == [one.folder_3 for one in chosen("host", "3")]
    assert chosen("all", "3") == PLATFORMS


@pytest.mark.parametrize(("machine", "system", "version"), [("riscv64", "Linux", "3"), ("aarch64", "Linux", "2")])
def test_a_machine_that_no_binary_is_for_gets_all(monkeypatch, machine: str, system: str, version: str) -> None:
    monkeypatch.setattr("platform.machine", lambda: machine)
    monkeypatch.setattr("platform.system", lambda: system)
    assert chosen(None, version) == PLATFORMS


def test_anything_else_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="host or all is allowed"):
        write("fmu", tmp_path / "system.npz", None, Options(platforms="linux"))
    with pytest.raises(InputError, match="it is allowed with --to fmu"):
        write("matlab", tmp_path / "system.npz", None, Options(platforms="all"))


@pytest.mark.parametrize(("version", "count"), [("2", 3), ("3", 5)])
def test_each_has_its_place_in_the_archive(tmp_path: Path, monkeypatch, version: str, count: int) -> None:
    def compiled(folder: Path, sources: Sequence[str], platform: Platform, target: Path) -> None:
        target.parent.mkdir(parents=True)
        target.write_text(platform.target)

    monkeypatch.setattr(fmu, "_compile", compiled)
    described = Described("boom", "A boom", "token", True, ["model.c"], 1.0, 1e-3)
    found = fmu._binaries(tmp_path, Contents({"sources/model.c": ""}, described), version, PLATFORMS)
    places = {one.folder_2 if version == "2" else one.folder_3: one for one in PLATFORMS}
    assert len(found) == count
    for name, content in found.items():
        binaries, place, library = name.split("/")
        assert (binaries, library) == ("binaries", f"boom{places[place].suffix}")
        assert content.decode() == places[place].target
