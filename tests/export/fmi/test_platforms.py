"""For which platforms an FMU has binaries."""

from __future__ import annotations

import ctypes
import subprocess
import sys
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import pytest
from export.fmi.test_body import LOADS, PATH, provided
from oracle import flexible, rich_body

from pmr.errors import InputError
from pmr.export.fmi import fmu
from pmr.export.fmi.fmu import PLATFORMS, selected_platforms
from pmr.export.formats import Options, write
from pmr.simulation.moving import read_scene
from pmr.system.system import System


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
    for platforms in (None, "host"):
        assert [platform.folder_3 for platform in selected_platforms(platforms, "3")] == [folder]
    assert selected_platforms("all", "3") == PLATFORMS


@pytest.mark.parametrize(("machine", "system", "version"), [("riscv64", "Linux", "3"), ("aarch64", "Linux", "2")])
def test_a_machine_that_no_binary_is_for_gets_all(monkeypatch, machine: str, system: str, version: str) -> None:
    monkeypatch.setattr("platform.machine", lambda: machine)
    monkeypatch.setattr("platform.system", lambda: system)
    assert selected_platforms(None, version) == PLATFORMS


def test_anything_else_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="host or all is allowed"):
        write("fmu", tmp_path / "system.npz", None, Options(platforms="linux"))
    with pytest.raises(InputError, match="it is allowed with --to fmu"):
        write("matlab", tmp_path / "system.npz", None, Options(platforms="all"))


@pytest.mark.parametrize(("version", "count"), [("2", 3), ("3", 5)])
def test_each_has_its_place_in_the_archive(tmp_path: Path, monkeypatch, version: str, count: int) -> None:
    monkeypatch.setattr(fmu, "library_bytes", lambda platform: platform.target.encode())
    model = provided(flexible(rich_body(), 6), PATH, LOADS)
    system = System.of(model)
    file = fmu.write(system, read_scene(system, "model.npz"), tmp_path / "boom.fmu", version)
    places = {one.folder_2 if version == "2" else one.folder_3: one for one in PLATFORMS}
    with zipfile.ZipFile(file) as archive:
        binaries = [name for name in archive.namelist() if name.startswith("binaries/")]
        assert len(binaries) == count
        for name in binaries:
            _, place, library = name.split("/")
            assert library == f"boom{places[place].suffix}"
            assert archive.read(name).decode() == places[place].target


def test_without_binary_or_compiler_it_says_what_to_install(monkeypatch) -> None:
    (other,) = (one for one in PLATFORMS if one.folder_3 == "aarch64-darwin")
    monkeypatch.setattr(fmu, "_HERE", Path("nowhere"))
    monkeypatch.setitem(sys.modules, "ziglang", None)
    with pytest.raises(InputError, match="ziglang"):
        fmu.library_bytes(other)


@pytest.mark.slow
@pytest.mark.parametrize("version", ["2", "3"])
def test_sources_that_come_along_compile_to_the_unit(tmp_path: Path, version: str) -> None:
    """As an importer compiles them: the files that are listed, with no option but that for a shared library."""
    system = System.of(provided(flexible(rich_body(), 6), PATH, LOADS))
    file = fmu.write(
        system, read_scene(system, "model.npz"), tmp_path / "body.fmu", version, PLATFORMS[:1], sources=True
    )
    with zipfile.ZipFile(file) as archive:
        archive.extractall(tmp_path / "unit")
    described = tmp_path / "unit" / ("modelDescription.xml" if version == "2" else "sources/buildDescription.xml")
    elements = ElementTree.parse(described).getroot().iter("File" if version == "2" else "SourceFile")
    listed = sorted({str(element.get("name")) for element in elements})
    command = ["cc", "-fPIC", "-shared", *listed, "-o", "body.so", "-lm"]
    subprocess.run(command, cwd=tmp_path / "unit" / "sources", check=True)
    library = ctypes.CDLL(str(tmp_path / "unit" / "sources" / "body.so"))
    assert hasattr(library, f"fmi{version}DoStep") and not hasattr(library, f"fmi{5 - int(version)}DoStep")
