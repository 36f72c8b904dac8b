"""A reduced model as a functional mock-up unit: an archive of description, binaries, their source and a reference."""

from __future__ import annotations

import os
import platform as this
import re
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from pmr.errors import InputError, environment
from pmr.export.fmi.constants import constants, source_text
from pmr.export.fmi.description import Described, build_description, description_2, description_3
from pmr.export.fmi.reference import inputs_csv, outputs_csv, reference
from pmr.export.fmi.variables import variables
from pmr.files.whole import replaced
from pmr.simulation.recorded import Recorded, recorded
from pmr.system.system import System

VERSIONS = ("2", "3")
_SOURCE = Path(__file__).with_name("source")
#: In every file of the archive, so that the same model makes the same bytes.
_DATE = (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True)
class Platform:
    """A system that an FMU has a binary for: its folders in FMI 2.0 (or none) and 3.0, the compiler's name of it."""

    folder_2: str
    folder_3: str
    target: str
    suffix: str


PLATFORMS = (
    Platform("linux64", "x86_64-linux", "x86_64-linux-gnu.2.17", ".so"),
    Platform("", "aarch64-linux", "aarch64-linux-gnu.2.17", ".so"),
    Platform("win64", "x86_64-windows", "x86_64-windows-gnu", ".dll"),
    Platform("darwin64", "x86_64-darwin", "x86_64-macos", ".dylib"),
    Platform("", "aarch64-darwin", "aarch64-macos", ".dylib"),
)
#: What `Platform.folder_3` is called after, as Python names processors and systems.
_MACHINES = {"amd64": "x86_64", "x86_64": "x86_64", "arm64": "aarch64", "aarch64": "aarch64"}
_FLAGS = ("-shared", "-std=c99", "-O3", "-fvisibility=hidden", "-fno-sanitize=undefined", "-s")


@dataclass(frozen=True)
class Contents:
    """All that an FMU holds besides its binaries: texts by their names in the archive, and what was described."""

    texts: dict[str, str]
    described: Described

    @property
    def sources(self) -> dict[str, str]:
        """Files of C by their names."""
        found = {Path(name): text for name, text in self.texts.items()}
        return {path.name: text for path, text in found.items() if path.suffix in {".c", ".h"}}


def chosen(asked: str | None, version: str) -> tuple[Platform, ...]:
    """The platforms that are asked for: ``all``, or by default the one that this machine is; all if it is none of them.

    Raises InputError if something else is asked for.
    """
    if asked not in (None, "host", "all"):
        raise InputError("command line", "--platforms", asked, "host or all is allowed")
    here = f"{_MACHINES.get(this.machine().lower(), '')}-{this.system().lower()}"
    found = tuple(one for one in PLATFORMS if one.folder_3 == here and _place(one, version))
    return PLATFORMS if asked == "all" else found or PLATFORMS


def write_fmu(
    npz_path: str | Path, target: str | Path, version: str = "3", platforms: Sequence[Platform] = PLATFORMS
) -> Path:
    """Write a saved system or reduced model as an FMU, under the scene that it was made from.

    Arguments and errors as for `write`, and an InputError is raised if the file is neither.
    """
    npz_path = Path(npz_path)
    system = System.load(npz_path)
    return write(system, recorded(system, npz_path.name), target, version, platforms)


def write(
    system: System,
    scene: Recorded,
    target: str | Path,
    version: str = "3",
    platforms: Sequence[Platform] = PLATFORMS,
) -> Path:
    """Write a system as an FMU for Co-Simulation and, where no row is rigid and nothing rubs, Model Exchange.

    Parameters
    ----------
    system : System
        Its paths and loads become inputs, outputs of its bodies and forces of its contacts become outputs.
    scene : Recorded
        What it starts with, and under what its reference trajectory is.
    target : str or Path
        The archive; its name is that of the binaries.
    version : {"2", "3"}
        Of the interface.
    platforms : sequence of Platform
        The systems to compile for.

    Raises
    ------
    InputError
        If a rigid row only pushes, the compiler is missing, or as `pmr.simulation` raises it.
    """
    if version not in VERSIONS:
        raise InputError("command line", "--fmi", version, "2 or 3 is allowed")
    environment.check_installed("ziglang")
    target = Path(target)
    found = contents(system, scene, target.stem, version)
    with tempfile.TemporaryDirectory() as folder:
        binaries = _binaries(Path(folder), found, version, platforms)
    files: dict[str, str | bytes] = {**found.texts, **binaries}
    target.parent.mkdir(parents=True, exist_ok=True)
    with replaced(target) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name, _DATE), content, zipfile.ZIP_DEFLATED)
    return target


def contents(system: System, scene: Recorded, name: str, version: str) -> Contents:
    """Description, source and reference trajectory of a system whose binaries are called `name`; errors as `write`."""
    found = constants(system)
    run = reference(found.drivers, scene)
    listed = variables(found.drivers, run.start_values, run.nominal)
    paths = [variable.name for variable in listed if variable.within is not None]
    source = source_text(found, paths, run.start_values, run.nominal, run.omega)
    others = {f"fmi{other}.c" for other in VERSIONS if other != version}
    files = {file.name: file.read_text() for file in sorted(_SOURCE.iterdir()) if file.name not in others}
    files |= {"model.h": source.header, "model.c": source.text}
    plain = re.sub(r"[^A-Za-z0-9_]+", "_", name)
    described = Described(
        identifier=plain if re.match(r"[A-Za-z_]", plain) else f"model_{plain}",
        title=scene.title,
        token=source.token,
        model_exchange=found.rows.is_differential,
        sources=sorted(name for name in files if name.endswith(".c")),
        end=run.stepping.end,
        step=run.stepping.step,
    )
    texts = {"modelDescription.xml": (description_2 if version == "2" else description_3)(described, listed)}
    texts |= {f"sources/{name}": text for name, text in files.items()}
    if version == "3":
        texts["sources/buildDescription.xml"] = build_description(described)
    texts["resources/reference_in.csv"] = inputs_csv(run, listed)
    texts["resources/reference_out.csv"] = outputs_csv(run, found.drivers, listed)
    return Contents(texts, described)


def _binaries(folder: Path, found: Contents, version: str, platforms: Sequence[Platform]) -> dict[str, bytes]:
    """Shared libraries by their names in the archive."""
    for name, text in found.sources.items():
        (folder / name).write_text(text)
    libraries = {}
    for platform in platforms:
        if place := _place(platform, version):
            library = Path("binaries", place, f"{found.described.identifier}{platform.suffix}")
            libraries[library] = (folder, found.described.sources, platform, folder / library)
    with ThreadPoolExecutor(os.cpu_count()) as pool:  # each waits for a compiler, a process of its own
        list(pool.map(lambda one: _compile(*one), libraries.values()))
    return {library.as_posix(): (folder / library).read_bytes() for library in libraries}


def _place(platform: Platform, version: str) -> str:
    """The platform's folder in a version of the interface, empty where that knows none."""
    return platform.folder_2 if version == "2" else platform.folder_3


def _compile(folder: Path, sources: Sequence[str], platform: Platform, target: Path) -> None:
    """Compile the files of a folder into a shared library; raises InputError with the compiler's first line."""
    target.parent.mkdir(parents=True, exist_ok=True)
    windows = platform.suffix == ".dll"
    command = [sys.executable, "-m", "ziglang", "cc", "-target", platform.target, *_FLAGS]
    command += [*(() if windows else ("-fPIC",)), *sources, "-o", str(target.resolve()), *(() if windows else ("-lm",))]
    result = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if result.returncode:
        lines = [line for line in result.stderr.splitlines() if "error" in line] or result.stderr.splitlines() or ["?"]
        raise InputError("command line", "--to", "fmu", f"no binary for {platform.folder_3}: {lines[0]}")
