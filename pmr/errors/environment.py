"""What pmr runs on: versions, commit, machine and plug-ins that a result depends on; the clock of its stages.

What a result was made with: versions, commit, machine; the wall seconds of each stage, and its progress.

What other installed packages add: signals, models, bases, export formats and limits, by their entry points.
"""

from __future__ import annotations

import datetime
import hashlib
import importlib
import os
import platform
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache, lru_cache
from importlib import metadata, util
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from pmr.errors import InputError, SimulationError

#: Group of entry points, and what each of them has to be.
GROUPS = {
    "pmr.models": "a module, or an object, with KINDS of cells and of(body, mesh), as pmr.models.shell has them",
    "pmr.bases": "a function of a full model and a pmr.scene.Reduction that returns this rank's rows of vectors (n, k)",
    "pmr.signals": "a subclass of pmr.scene.signals.SignalBase whose `kind` is the entry point's name",
    "pmr.exports": "a pmr.export.formats.Format",
    "pmr.limits": "a function of a pmr.studies.user_limits.AtRest that returns a number",
}


@cache
def plugin_objects(group: str, reserved: frozenset[str]) -> dict[str, Any]:
    """Objects of a group by their names, of all installed distributions; `reserved` are the names that pmr has itself.

    Raises InputError where one can't be imported, or its name is taken.
    """
    objects: dict[str, Any] = {}
    for point in sorted(_points(group)):
        if point.name in reserved or point.name in objects:
            raise plugin_error(group, point.name, f"a name that nothing else has is allowed ({point.value})")
        try:
            objects[point.name] = point.load()
        except Exception as error:
            raise plugin_error(group, point.name, f"{point.value} can't be imported ({error})") from None
    return objects


def one_of(group: str, name: str, reserved: frozenset[str]) -> Any:
    """The object of that name.

    Raises InputError as `plugin_objects`, or where no package has the name: a file may come from another machine.
    """
    objects = plugin_objects(group, reserved)
    if name not in objects:
        raise plugin_error(group, name, "a name that an installed package offers is allowed")
    return objects[name]


def plugin_names(group: str) -> set[str]:
    """Names of all that installed distributions offer; nothing is imported."""
    return {point.name for point in _points(group)}


def plugin_error(group: str, name: str, says: str | None = None) -> InputError:
    """Return the error of an entry point; without `says`, that it is not what its group expects."""
    return InputError("installed plug-ins", group, name, says or f"{GROUPS[group]} is allowed")


def plugin_versions() -> list[str]:
    """Distributions that offer something and their versions: what a result depends on beside `pmr`."""
    points = [point for group in GROUPS for point in _points(group)]
    return sorted({f"{point.dist.name} {point.dist.version}" for point in points if point.dist})


def plugins_digest() -> str:
    """Digest of the versions and all files of installed plug-ins: what stored results depend on beside `pmr`.

    It holds the packages that entry points name, modules beside those that are single files, and what their
    distributions list as installed.  Files are read once in a process, as their code is.
    """
    return _code_digest(tuple(sys.path))


@cache
def _code_digest(path: tuple[str, ...]) -> str:
    points = _points_on(path)
    contents = {content for point in points for content in _contents_of(point)}
    named_by = sorted((point.group, point.name, point.value) for point in points)
    return hashlib.sha256(repr((named_by, plugin_versions(), sorted(contents))).encode()).hexdigest()


def _contents_of(point: metadata.EntryPoint) -> Iterator[tuple[str, str]]:
    """Names and digests of the files of the package or module that an entry point names, and of its distribution."""
    listed = (point.dist.files if point.dist else None) or ()
    files = {Path(str(file.locate())): str(file) for file in listed if ".dist-info/" not in str(file)}
    for place in _places_of(point.module):
        inside = place.rglob("*") if place.is_dir() else place.parent.glob("*.py")
        files |= {file: file.relative_to(place.parent).as_posix() for file in (*inside, place)}
    for file, name in files.items():
        if file.is_file() and "__pycache__" not in file.parts:
            yield name, hashlib.sha256(file.read_bytes()).hexdigest()


def _places_of(module: str) -> list[Path]:
    """Folders of the outermost regular package of a module, or its file; none where it is not there."""
    parts = module.split(".")
    for depth in range(1, len(parts) + 1):
        try:
            spec = find_spec(".".join(parts[:depth]))
        except (ImportError, ValueError):
            return []
        if spec is None:
            return []
        if spec.submodule_search_locations is not None and (spec.has_location or depth == len(parts)):
            return [Path(folder) for folder in spec.submodule_search_locations]
        if spec.submodule_search_locations is None:
            return [Path(spec.origin)] if spec.has_location and spec.origin else []
    return []


def _points(group: str) -> list[metadata.EntryPoint]:
    return [point for point in _points_on(tuple(sys.path)) if point.group == group]


@cache
def _points_on(path: tuple[str, ...]) -> list[metadata.EntryPoint]:
    """Entry points of all groups in the distributions on `path`; Python reads a file of each, so they are read once."""
    points = metadata.entry_points()
    return [point for group in GROUPS for point in points.select(group=group)]


MEMINFO = Path("/proc/meminfo")
#: Each launcher's name for the number of processes that it started.
LAUNCHED = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "SLURM_STEP_NUM_TASKS")
#: What Open MPI does in a process that no launcher started: no daemon, no networks, no session folder.  All isolated
#: processes of a user take the same one, ompi.HOST.UID/jf.0/1/0, and the first to end removes it while others start.
UNLAUNCHED = {
    "OMPI_MCA_ess_singleton_isolated": "1",
    "OMPI_MCA_pml": "ob1",
    "OMPI_MCA_orte_create_session_dirs": "0",
}

_PACKAGES = ("numpy", "scipy", "exudyn", "meshio", "pydantic", "matplotlib", "weasyprint")
_PMR = Path(__file__).parents[1]
_NUMERICAL = ("numpy", "scipy", "exudyn", "fenics-dolfinx", "petsc4py", "slepc4py", "dolfinx-solver-real")


_REPORTS = "pip install jinja2 matplotlib fonttools weasyprint installs what reports need"
#: Packages that write reports.
REPORT = ("jinja2", "matplotlib", "fontTools", "weasyprint")
#: Packages that only a part of the work needs: what for, and how to get them.
_NEEDED = {
    "dolfinx": (
        "FEniCSx makes models from forms, all but matrices: apt, conda or pip install '.[fenicsx]' in a checkout has it"
    ),
    "exudyn": (
        "it simulates beside march and makes the ANCF reference; pip install exudyn installs it (or do without: "
        'simulation.simulators = ["march"], and no "ancf" in compare.against)'
    ),
    "gmsh": "it draws the meshes of shells and solids; pip install gmsh installs it (or give mesh.file)",
    "pandas": "it makes frames of results; pip install pandas installs it",
    "pyNastran": "it reads files of Nastran: pip install pynastran installs it",
    "ziglang": "it compiles the libraries of FMUs for other systems; pip install ziglang installs it",
    "matplotlib": f"it draws figures; {_REPORTS}",
    "jinja2": f"it writes reports; {_REPORTS}",
    "fontTools": f"it writes reports; {_REPORTS}",
    "weasyprint": f"it writes report.pdf; {_REPORTS}, its system libraries are Pango's",
}


def needed(name: str) -> Any:
    """The package `name`, or a module in it, imported where it is needed.

    Raises InputError if it, or a library that it loads, is missing: what it is for, and the command that installs it.
    """
    try:
        return importlib.import_module(name)
    except (ImportError, OSError) as error:
        package = name.partition(".")[0]
        raise InputError("installation", package, None, f"not found ({error}); {_NEEDED[package]}") from None


def check_installed(name: str) -> None:
    """Check before long work that a package is there, without an import; raises InputError if it is missing."""
    if util.find_spec(name) is None:
        raise InputError("installation", name, None, f"not found; {_NEEDED[name]}")


def check_report() -> None:
    """Check that all packages that reports need are installed."""
    for name in REPORT:
        check_installed(name)


def unfit(error: Exception) -> str:
    """Text about packages that can't be loaded, because one is missing or of another version than needed."""
    problem = f"installation: {' '.join(str(error).split())}; NumPy is {_version('numpy')}, SciPy {_version('scipy')}"
    return f"{problem}: `make setup` puts the versions back that fit together, elsewhere install pmr anew"


def check_temporary() -> None:
    """Raise InputError unless the folder for temporary files, if the environment names one, can be written to."""
    named = {key: os.environ[key] for key in ("TMPDIR", "TEMP", "TMP") if os.environ.get(key)}
    for key, folder in tuple(named.items())[:1]:
        try:
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError as error:
            allowed = f"a folder that can be written to is allowed ({error.strerror})"
            raise InputError("environment", key, folder, allowed) from None


def check_current_folder() -> None:
    """Raise InputError where the current folder was removed: names of files lead nowhere, and PETSc does not start."""
    try:
        os.getcwd()
    except OSError as error:
        allowed = f"a folder that is there is allowed ({error.strerror}); `cd` into one"
        raise InputError("environment", "the current folder", None, allowed) from None


def available_memory() -> int | None:
    """Memory in bytes that this machine can still give; None where it doesn't say."""
    with suppress(OSError, ValueError, StopIteration):
        line = next(line for line in MEMINFO.read_text().splitlines() if line.startswith("MemAvailable:"))
        return int(line.split()[1]) * 1024
    return None


@contextmanager
def without_launcher() -> Iterator[None]:
    """Let MPI start without looking for others, where no launcher started this process.

    Open MPI would start a daemon for processes yet to come, and look for fast networks to them: 0.3 s.  What is set by
    the user stays, and nothing is set for processes that are started later.
    """
    names = [] if launched() > 1 else [name for name in UNLAUNCHED if name not in os.environ]
    os.environ.update({name: UNLAUNCHED[name] for name in names})
    try:
        yield
    finally:
        for name in names:
            del os.environ[name]


def launched() -> int:
    """How many processes a launcher of MPI started together, 1 without one.

    Raises InputError where a variable of a launcher holds no such number.
    """
    return max(map(_processes, LAUNCHED))


def _processes(variable: str) -> int:
    """Number of processes that a launcher wrote into a variable of the environment; 1 where it is not set."""
    text = os.environ.get(variable, "1")
    if not re.fullmatch("[0-9]{1,9}", text) or int(text) < 1:
        allowed = "the number of processes, which a launcher of MPI sets, is allowed; `unset` removes the variable"
        raise InputError("environment", variable, text, allowed)
    return int(text)


def versions() -> dict[str, str]:
    """Versions of pmr, Python and the packages that a result depends on."""
    from pmr import __version__

    return {"pmr": __version__, "python": platform.python_version()} | {name: _version(name) for name in _PACKAGES}


def commit() -> str | None:
    """Commit of the checkout that pmr runs from, with a mark where files differ from it; None outside a checkout."""
    folder = Path(__file__).resolve().parents[2]
    if not (folder / ".git").exists():
        return None
    try:
        git = ["git", "-C", str(folder)]
        head = subprocess.run([*git, "rev-parse", "--short=12", "HEAD"], capture_output=True, text=True, check=True)
        changed = subprocess.run([*git, "status", "--porcelain", "-uno"], capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return head.stdout.strip() + (" with changes" if changed.stdout.strip() else "")


def sources() -> Mapping[str, str]:
    """Texts of pmr's sources, in Python and C, by path within pmr, as they are now."""
    files = sorted(file for kind in ("*.py", "*.c", "*.h") for file in _PMR.rglob(kind))
    return _read(tuple((file, file.stat().st_mtime_ns) for file in files))


@lru_cache(1)
def _read(files: tuple[tuple[Path, int], ...]) -> Mapping[str, str]:
    """Texts of files, each with the time at which it was changed last."""
    return {file.relative_to(_PMR).as_posix(): file.read_text(encoding="utf-8") for file, _ in files}


def code_digest(files: Mapping[str, str], leave_out: Sequence[str] = ()) -> str:
    """Digest of sources, by path within pmr but those that begin with `leave_out`, numerical packages and plug-ins."""
    digest = hashlib.sha256()
    for name, text in sorted(files.items()):
        if not name.startswith(tuple(leave_out)):
            digest.update(name.encode() + b"\0" + text.encode() + b"\0")
    numerical = {package: _version(package) for package in _NUMERICAL} | {"python": platform.python_version()}
    digest.update(repr((numerical, plugins_digest())).encode())
    return digest.hexdigest()[:16]


@cache
def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"


def today() -> str:
    """The date of this machine's clock, year first."""
    return datetime.date.today().isoformat()


def machine() -> dict[str, str]:
    """Processor, cores available to this process and operating system; no names of hosts or users."""
    return {
        "processor": _processor(),
        "cores": str(cores()),
        "system": f"{platform.system()} {platform.machine()}",
    }


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _processor() -> str:
    cpuinfo = Path("/proc/cpuinfo")
    if sys.platform == "linux" and cpuinfo.exists():
        for line in cpuinfo.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


#: Called with a stage's name and the share of it that is done.
Progress = Callable[[str, float], None]


@dataclass
class Clock:
    """Times stages by name."""

    progress: Progress = lambda stage, share: None
    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[Callable[[float], None]]:
        """Time a stage, which may come several times; what is yielded takes the share of it that is done."""
        self.progress(name, 0.0)
        start = time.perf_counter()
        try:
            yield lambda share: self.progress(name, share)
        except SimulationError as error:
            error.args = (f"{name}: {error}",)
            raise
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start
        self.progress(name, 1.0)
