"""What a unit is made of: the kernel's object code and a file, which the instances of a process share.
For which platforms an FMU has binaries.
"""

import ctypes
import re
import subprocess
import sys
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from export.fmi.libraries import CallError, Instance, Library, loaded
from export.fmi.units import LOADS, PATH, STEP, provided
from oracle import flexible, rich_body

from pmr import InputError, ReducedModel, System
from pmr.export import fmi
from pmr.export.fmi import PLATFORMS, Contents, fmu_contents, selected_platforms
from pmr.export.formats import Options, write
from pmr.files.arrays import Array
from pmr.kernel.kernel import Kernel
from pmr.kernel.state import Settings, State
from pmr.scene.signals import SmoothRamp
from pmr.simulation.modal import modal_form
from pmr.simulation.moving import read_scene

VERSIONS = pytest.mark.parametrize("version", ["2", "3"])


def unit_of(model: ReducedModel, version: str = "3") -> Contents:
    return fmu_contents(System.of(model), read_scene(System.of(model), "model.npz"), "body", version)


def model(last: float) -> ReducedModel:
    """Another model for each place at which its path ends, as instances of one model share it."""
    return provided(flexible(rich_body(), 6), SmoothRamp(times=(0.0, 0.2), values=(2.0, last)), LOADS)


@VERSIONS
def test_a_step_is_the_kernels_bit_for_bit(version: str, tmp_path: Path) -> None:
    """Under what has become of the unit's inputs at the end of each step."""
    unit = unit_of(provided(flexible(rich_body(), 6), PATH, LOADS), version)
    instance, state = Instance(loaded(unit, tmp_path, version)), State(Kernel(unit.system), Settings(STEP, 0.8))
    inputs = [name for name in instance.library.named("input") if "_rate" not in name]
    outputs = [name for name in instance.library.named("output") if not name.endswith("_rate")]
    displacements = [name for name in outputs if not name.startswith(("force_of", "reaction"))]
    forces = [name for name in outputs if name.startswith("force_of")]
    instance.initialise(inputs, [2.0, 10.0, -20.0])
    state.start("rest", [2.0, 10.0, -20.0])
    instance.set([f"{name}_rate" for name in inputs], [0.7, 300.0, 100.0])
    for k in range(50):
        instance.step(k * STEP, STEP)
        state.step(instance.get(inputs))
        y, pads = state.outputs()
        np.testing.assert_array_equal(instance.get(displacements), y)
        np.testing.assert_array_equal(instance.get(forces), pads)
    assert np.abs(y).max() > 1e-6


@VERSIONS
def test_instances_share_the_system(version: str, tmp_path: Path) -> None:
    """The second one reads no file; after the last one is freed the next one does."""
    library = loaded(unit_of(model(2.51), version), tmp_path, version)
    first = Instance(library)
    (tmp_path / f"fmi {version}" / "resources" / "system.pmr").unlink()
    second = Instance(library)
    first.free()
    second.initialise()
    second.step(0.0, STEP)
    second.free()
    with pytest.raises(CallError, match="system.pmr.*it can't be read"):
        Instance(library)


def test_a_damaged_system_is_refused_in_one_line(tmp_path: Path) -> None:
    unit, rng = unit_of(model(2.52)), np.random.default_rng(2)
    library: Library = loaded(unit, tmp_path, "3")
    file = tmp_path / "fmi 3" / "resources" / "system.pmr"
    for _ in range(30):
        damaged = bytearray(unit.system)
        damaged[rng.integers(len(damaged))] ^= int(rng.integers(1, 256))
        file.write_bytes(damaged)
        with pytest.raises(CallError, match=r"resources/system.pmr \(.*\): [^\n]+$"):
            Instance(library)
    file.write_bytes(unit.system[:1000])
    with pytest.raises(CallError, match="cut short"):
        Instance(library)


def test_what_is_no_system_of_a_unit_is_refused(tmp_path: Path) -> None:
    """A block of the kernel alone, and the system of another unit."""
    system = System.of(model(2.53))
    library = loaded(unit_of(model(2.53)), tmp_path, "3")
    kernel = Kernel.of(system, {name: modal_form(body) for name, body in system.reduced.items()})
    file = tmp_path / "fmi 3" / "resources" / "system.pmr"
    for content in (kernel.block, unit_of(model(2.54)).system):
        file.write_bytes(content)
        with pytest.raises(CallError, match="the token is that of another model"):
            Instance(library)


@pytest.mark.parametrize("folder", ["a b", "100 %", "ä"])
def test_resources_are_found_in_any_folder(folder: str, tmp_path: Path) -> None:
    """Whose URI has its letters escaped."""
    unit = unit_of(model(2.55), "2")
    instance = Instance(loaded(unit, tmp_path / folder, "2"))
    instance.initialise()
    instance.free()


def test_a_step_of_another_length_goes_on(tmp_path: Path) -> None:
    """Half the steps from the middle on: both ways are within what a step errs."""
    library = loaded(unit_of(model(2.56)), tmp_path, "3")
    ends = list[Array]()
    displacements = [name for name in library.named("output") if re.match("displacement|output|tip", name)]
    for half in (1.0, 0.5):
        instance, t = Instance(library), 0.0
        instance.initialise()
        instance.set(["F"] if "F" in library.references else library.named("input")[1:2], [30.0])
        for h in (*[STEP] * 50, *[half * STEP] * round(50 / half)):
            instance.step(t, h)
            t += h
        ends.append(instance.get(displacements))
    assert np.abs(ends[0]).max() > 1e-6
    np.testing.assert_allclose(ends[1], ends[0], rtol=0.0, atol=2e-2 * np.abs(ends[0]).max())


@VERSIONS
@pytest.mark.parametrize("kind", [-1.0, 0.5, 3.0, 1e30])
def test_a_start_that_there_is_none_of_is_refused(version: str, kind: float, tmp_path: Path) -> None:
    """Also where it is set as a number, as an importer may that takes all values for such."""
    instance = Instance(loaded(unit_of(model(2.53), version), tmp_path, version))
    with pytest.raises(CallError, match="0, 1 or 2 is allowed: at rest, static, as given"):
        instance.set(["start"], [kind])
    instance.set(["start"], [0.0])
    instance.initialise()


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
    monkeypatch.setattr(fmi, "library_bytes", lambda platform: platform.target.encode())
    model = provided(flexible(rich_body(), 6), PATH, LOADS)
    system = System.of(model)
    file = fmi.write_fmu(system.save(tmp_path / "system.npz"), tmp_path / "boom.fmu", version)
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
    monkeypatch.setattr(fmi, "_HERE", Path("nowhere"))
    monkeypatch.setitem(sys.modules, "ziglang", None)
    with pytest.raises(InputError, match="ziglang"):
        fmi.library_bytes(other)


@pytest.mark.slow
@pytest.mark.parametrize("version", ["2", "3"])
def test_sources_that_come_along_compile_to_the_unit(tmp_path: Path, version: str) -> None:
    """As an importer compiles them: the files that are listed, with no option but that for a shared library."""
    system = System.of(provided(flexible(rich_body(), 6), PATH, LOADS))
    saved = system.save(tmp_path / "system.npz")
    file = fmi.write_fmu(saved, tmp_path / "body.fmu", version, PLATFORMS[:1], sources=True)
    with zipfile.ZipFile(file) as archive:
        archive.extractall(tmp_path / "unit")
    described = tmp_path / "unit" / ("modelDescription.xml" if version == "2" else "sources/buildDescription.xml")
    elements = ElementTree.parse(described).getroot().iter("File" if version == "2" else "SourceFile")
    listed = sorted({str(element.get("name")) for element in elements})
    command = ["cc", "-fPIC", "-shared", *listed, "-o", "body.so", "-lm"]
    subprocess.run(command, cwd=tmp_path / "unit" / "sources", check=True)
    library = ctypes.CDLL(str(tmp_path / "unit" / "sources" / "body.so"))
    assert hasattr(library, f"fmi{version}DoStep") and not hasattr(library, f"fmi{5 - int(version)}DoStep")
