"""Environment of a run: versions, commit, machine and plug-ins that a result depends on, and times of its stages.

Plug-ins are objects that other installed packages add by entry points: signals, models, bases, export formats and
limits.
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
from pathlib import Path
from typing import Any

from pmr.errors import InputError, SimulationError

#: Groups of entry points, and the description of what an entry point of each group has to be.
GROUPS = {
    "pmr.models": "a module, or an object, with KINDS of cells and of(body, mesh), as pmr.models.shell has them",
    "pmr.bases": "a function of a full model and a pmr.scene.Reduction that returns this rank's rows of vectors (n, k)",
    "pmr.signals": "a subclass of pmr.scene.signals.SignalBase whose `kind` is the entry point's name",
    "pmr.exports": "a pmr.export.formats.Format",
    "pmr.limits": "a function of a pmr.studies.further_limits.AtRest that returns a number",
}
#: First letters of environment variables by which a process takes itself for a rank of its parent's MPI job.
MPI_VARIABLES = ("OMPI_", "ORTE_", "PRTE_", "PMIX_", "PMI_", "PMI2_", "HYDI_", "HYDRA_", "MPI_LOCAL", "SLURM_")


@cache
def plugin_objects(group: str, reserved: frozenset[str]) -> dict[str, Any]:
    """Return the objects that installed packages offer in a group of entry points, by name; imported once in a process.

    `reserved` are the names that pmr itself uses.  Raises InputError if an object can't be imported, or if its name is
    reserved or used twice.
    """
    objects: dict[str, Any] = {}
    for point in sorted(_entry_points(group)):
        if point.name in reserved or point.name in objects:
            raise plugin_error(group, point.name, f"a name that nothing else has is allowed ({point.value})")
        try:
            objects[point.name] = point.load()
        except Exception as error:
            raise plugin_error(group, point.name, f"{point.value} can't be imported ({error})") from None
    return objects


def plugin_object(group: str, name: str, reserved: frozenset[str]) -> Any:
    """Return the object called `name` in a group of entry points, where pmr itself uses the names `reserved`.

    Raises InputError in the cases of `plugin_objects`, and if no installed package has the name: the file that names it
    may come from another machine.
    """
    objects = plugin_objects(group, reserved)
    if name not in objects:
        raise plugin_error(group, name, "a name that an installed package offers is allowed")
    return objects[name]


def plugin_names(group: str) -> set[str]:
    """Return the names of all entry points of a group; their objects are not imported."""
    return {point.name for point in _entry_points(group)}


def plugin_error(group: str, name: str, says: str | None = None) -> InputError:
    """Return the error for the entry point `name` of a group; `says` is the reason.

    If it is None, the reason is what kind of object the group expects.
    """
    return InputError("installed plug-ins", group, name, says or f"{GROUPS[group]} is allowed")


def plugin_versions() -> list[str]:
    """Return name and version of each distribution with plug-ins; results depend on these plug-ins and on pmr."""
    points = [point for group in GROUPS for point in _entry_points(group)]
    return sorted({f"{point.dist.name} {point.dist.version}" for point in points if point.dist})


def plugins_digest() -> str:
    """Return a digest of the versions and of all files of installed plug-ins, on which results depend.

    The digest covers the packages or modules that entry points name, and the files that the plug-ins' distributions
    list as installed.  If an entry point names a module of a single file, the modules in its folder count, too.  Files
    are read once in a process, as their code is imported once.
    """
    return _code_digest(tuple(sys.path))


@cache
def _code_digest(path: tuple[str, ...]) -> str:
    """Return the digest of `plugins_digest` for the distributions in the folders `path`."""
    points = _entry_points_on(path)
    contents = {content for point in points for content in _content_digests(point)}
    named_by = sorted((point.group, point.name, point.value) for point in points)
    return hashlib.sha256(repr((named_by, plugin_versions(), sorted(contents))).encode()).hexdigest()


def _content_digests(point: metadata.EntryPoint) -> Iterator[tuple[str, str]]:
    """Yield name and digest of each file of an entry point's package or module, and of its distribution."""
    listed = (point.dist.files if point.dist else None) or ()
    files = {Path(str(file.locate())): str(file) for file in listed if ".dist-info/" not in str(file)}
    for place in _source_folders(point.module):
        inside = place.rglob("*") if place.is_dir() else place.parent.glob("*.py")
        files |= {file: file.relative_to(place.parent).as_posix() for file in (*inside, place)}
    for file, name in files.items():
        if file.is_file() and "__pycache__" not in file.parts:
            yield name, hashlib.sha256(file.read_bytes()).hexdigest()


def _source_folders(module: str) -> list[Path]:
    """Return the folders of the outermost regular package that contains a module.

    For a module in no package, the module's file is returned instead.  The list is empty if the module can't be found.
    """
    parts = module.split(".")
    for depth in range(1, len(parts) + 1):
        try:
            spec = util.find_spec(".".join(parts[:depth]))
        except (ImportError, ValueError):
            return []
        if spec is None:
            return []
        if spec.submodule_search_locations is not None and (spec.has_location or depth == len(parts)):
            return [Path(folder) for folder in spec.submodule_search_locations]
        if spec.submodule_search_locations is None:
            return [Path(spec.origin)] if spec.has_location and spec.origin else []
    return []


def _entry_points(group: str) -> list[metadata.EntryPoint]:
    """Return the entry points of a group."""
    return [point for point in _entry_points_on(tuple(sys.path)) if point.group == group]


@cache
def _entry_points_on(path: tuple[str, ...]) -> list[metadata.EntryPoint]:
    """Return the entry points of all groups in installed distributions.

    `path` is `sys.path`; the entry points are read again only if it has changed.
    """
    points = metadata.entry_points()
    return [point for group in GROUPS for point in points.select(group=group)]


MEMINFO = Path("/proc/meminfo")
#: Environment variables in which launchers of MPI state the number of processes.
LAUNCHED = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "SLURM_STEP_NUM_TASKS")
#: Settings of Open MPI for a process that no launcher started: no daemon, no networks, no session folder.  All such
#: processes of a user would share the session folder ompi.HOST.UID/jf.0/1/0, and the first process that ends would
#: remove it while others start.
UNLAUNCHED = {"OMPI_MCA_ess_singleton_isolated": "1", "OMPI_MCA_pml": "ob1", "OMPI_MCA_orte_create_session_dirs": "0"}

_PACKAGES = ("numpy", "scipy", "exudyn", "meshio", "pydantic", "matplotlib", "weasyprint")
_PMR = Path(__file__).parents[1]
_NUMERICAL = ("numpy", "scipy", "exudyn", "fenics-dolfinx", "petsc4py", "slepc4py", "dolfinx-solver-real")


_REPORTS = "pip install jinja2 matplotlib fonttools weasyprint installs what reports need"
#: Packages that are needed to write reports.
REPORT = ("jinja2", "matplotlib", "fontTools", "weasyprint")
#: Purpose of each optional package, and how to install it.
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
    "openpyxl": "it writes spreadsheets (duty.xlsx): pip install openpyxl installs it",
    "pyNastran": "it reads files of Nastran: pip install pynastran installs it",
    "ziglang": "it compiles the libraries of FMUs for other systems; pip install ziglang installs it",
    "matplotlib": f"it draws figures; {_REPORTS}",
    "jinja2": f"it writes reports; {_REPORTS}",
    "fontTools": f"it writes reports; {_REPORTS}",
    "weasyprint": f"it writes report.pdf; {_REPORTS}, its system libraries are Pango's",
}


def import_package(name: str) -> Any:
    """Import and return the optional package `name`, or a module in it, at the time when it is needed.

    Raises InputError if the package, or a library that it loads, is missing.  The message says what the package does
    and how to install it.  Therefore the package has to be one of `_NEEDED`.
    """
    try:
        return importlib.import_module(name)
    except (ImportError, OSError) as error:
        package = name.partition(".")[0]
        raise InputError("installation", package, None, f"not found ({error}); {_NEEDED[package]}") from None


def is_installed(name: str) -> bool:
    """Return whether the package `name` can be found, without importing the package."""
    return util.find_spec(name) is not None


def check_installed(name: str) -> None:
    """Raise an InputError if the package `name`, one of `_NEEDED`, is missing; it is not imported.

    To be called before work that takes long.
    """
    if not is_installed(name):
        raise InputError("installation", name, None, f"not found; {_NEEDED[name]}")


def check_report() -> None:
    """Raise InputError if a package that is needed to write reports is missing."""
    for name in REPORT:
        check_installed(name)


def import_failure_message(error: Exception) -> str:
    """Return the message for an import error: a package is missing or has an unsuitable version."""
    problem = f"installation: {' '.join(str(error).split())}; NumPy is {_version('numpy')}, SciPy {_version('scipy')}"
    return f"{problem}: `make setup` puts the versions back that fit together, elsewhere install pmr anew"


def check_temporary() -> None:
    """Raise InputError if the environment names a folder for temporary files that can't be written to.

    Only the first of ``TMPDIR``, ``TEMP`` and ``TMP`` that is set is tried, as Python takes this one.
    """
    named = {key: os.environ[key] for key in ("TMPDIR", "TEMP", "TMP") if os.environ.get(key)}
    for key, folder in tuple(named.items())[:1]:
        try:
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError as error:
            allowed = f"a folder that can be written to is allowed ({error.strerror})"
            raise InputError("environment", key, folder, allowed) from None


def check_current_folder() -> None:
    """Raise InputError if the current folder was removed.

    Relative names of files would fail there, and PETSc would not start.
    """
    try:
        os.getcwd()
    except OSError as error:
        allowed = f"a folder that is there is allowed ({error.strerror}); `cd` into one"
        raise InputError("environment", "the current folder", None, allowed) from None


def available_memory() -> int | None:
    """Return the available memory of this machine in bytes; None if the system does not say."""
    with suppress(OSError, ValueError, StopIteration):
        line = next(line for line in MEMINFO.read_text().splitlines() if line.startswith("MemAvailable:"))
        return int(line.split()[1]) * 1024
    return None


@contextmanager
def mpi_without_launcher() -> Iterator[None]:
    """Context in which MPI starts without looking for other processes; without effect in a process of a launcher.

    Open MPI would otherwise start a daemon for later processes and look for fast networks, which takes 0.3 s.
    Environment variables that the user has set are kept.  All others that this function sets are removed after the
    block, so that later processes do not inherit them.
    """
    names = [] if launched_process_count() > 1 else [name for name in UNLAUNCHED if name not in os.environ]
    os.environ.update({name: UNLAUNCHED[name] for name in names})
    try:
        yield
    finally:
        for name in names:
            del os.environ[name]


def launched_process_count() -> int:
    """Return the number of processes that a launcher of MPI started together; 1 if there was no launcher.

    Raises InputError if the variable of a launcher does not hold such a number.
    """
    return max(map(_processes, LAUNCHED))


def _processes(variable: str) -> int:
    """Return the number of processes that a launcher's environment variable states; 1 if the variable is not set.

    Raises InputError if it is no positive number.
    """
    text = os.environ.get(variable, "1")
    if not re.fullmatch("[0-9]{1,9}", text) or int(text) < 1:
        allowed = "the number of processes, which a launcher of MPI sets, is allowed; `unset` removes the variable"
        raise InputError("environment", variable, text, allowed)
    return int(text)


def package_versions() -> dict[str, str]:
    """Return the versions of pmr, Python and the packages that a result depends on, by the package's name."""
    from pmr import __version__

    return {"pmr": __version__, "python": platform.python_version()} | {name: _version(name) for name in _PACKAGES}


def checkout_commit() -> str | None:
    """Return the commit of pmr's Git checkout, followed by " with changes" if files differ from the commit.

    None is returned if pmr does not run from a checkout, or if git can't read it.
    """
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


def source_texts() -> Mapping[str, str]:
    """Return the texts of pmr's source files in Python and C, by their paths within pmr."""
    files = sorted(file for kind in ("*.py", "*.c", "*.h") for file in _PMR.rglob(kind))
    return _read_texts(tuple((file, file.stat().st_mtime_ns) for file in files))


@lru_cache(1)
def _read_texts(files: tuple[tuple[Path, int], ...]) -> Mapping[str, str]:
    """Return the texts of files by their paths relative to the package, with slashes.

    `files` holds each path with its time of last change, so that the cache notices changes.
    """
    return {file.relative_to(_PMR).as_posix(): file.read_text(encoding="utf-8") for file, _ in files}


def code_digest(files: Mapping[str, str], leave_out: Sequence[str] = ()) -> str:
    """Return a digest, 16 hexadecimal digits, of source files and of the versions of numerical packages and plug-ins.

    `files` are texts by path within pmr; those whose path begins with one of `leave_out` are left out.
    """
    digest = hashlib.sha256()
    for name, text in sorted(files.items()):
        if not name.startswith(tuple(leave_out)):
            digest.update(name.encode() + b"\0" + text.encode() + b"\0")
    numerical = {package: _version(package) for package in _NUMERICAL} | {"python": platform.python_version()}
    digest.update(repr((numerical, plugins_digest())).encode())
    return digest.hexdigest()[:16]


#: Parts of the package whose code changes no full or reduced model.
NOT_COMPUTING = ("report/", "studies/", "cli/", "export/", "simulation/", "compare/")


def computing_digest() -> str:
    """Return a digest of all code that full and reduced models are computed by: pmr's, numerical packages, plug-ins."""
    return code_digest(source_texts(), NOT_COMPUTING)


@cache
def _version(package: str) -> str:
    """Return the version of an installed package, or the text "not installed"."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"


def today() -> str:
    """Return today's date, by this machine's clock, as YYYY-MM-DD."""
    return datetime.date.today().isoformat()


def describe_origin(libraries: Mapping[str, str] | None = None) -> dict[str, object]:
    """Return what a run or study was computed with: ``versions``, ``commit``, ``date`` and ``machine``.

    The versions are those of pmr and of its packages.  Versions in `libraries`, by name, are added unless it is None.
    """
    versions = package_versions() | dict(libraries or {})
    return {"versions": versions, "commit": checkout_commit(), "date": today(), "machine": describe_machine()}


def describe_machine() -> dict[str, str]:
    """Return processor, available cores and operating system of this machine, by key, without names of host or user."""
    return {
        "processor": _processor(),
        "cores": str(available_cores()),
        "system": f"{platform.system()} {platform.machine()}",
    }


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _processor() -> str:
    """Return the name of this machine's processor."""
    cpuinfo = Path("/proc/cpuinfo")
    if sys.platform == "linux" and cpuinfo.exists():
        for line in cpuinfo.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


#: Function that is called with the name of a stage and the share (0 to 1) of the stage that is done.
Progress = Callable[[str, float], None]


#: Words for the stages of a run that need them, and for simulators, by their names in progress and in summaries.
STAGE_WORDS = {
    "assemble": "assembly of the full model",
    "reduce": "reduction",
    "pod": "basis and projection",
    "estimate": "error estimate",
    "recover": "fields and stresses",
    "reduced": "simulation of the reduced model",
    "full": "simulation of the full model",
    "ancf": "simulation, ANCF",
    "machine": "motion of the machine",
    "frequencies": "natural frequencies",
    "step": "error of the time step",
    "mesh and model": "errors of mesh and model",
    "search": "search for the accuracy that is required",
    "write": "pages and figures",
}
SIMULATOR_WORDS = {
    "march": "compiled",
    "exudyn": "Exudyn",
    "exudyn-multiplier": "Exudyn, multipliers",
    "exudyn-callback": "Exudyn, callbacks",
}


def stage_words(name: str) -> str:
    """Return words for a stage of a run, such as ``"reduced"`` or ``"reduced, exudyn"``, or for a simulator's part."""
    stage, _, simulator = ("simulation", "", name) if name in SIMULATOR_WORDS else name.partition(", ")
    by = f", {SIMULATOR_WORDS[simulator]}" if simulator else ""
    return f"{STAGE_WORDS.get(stage, stage)}{by}"


@dataclass
class Clock:
    """Clock that adds up the wall time of each stage in `seconds`, by the stage's name.

    `progress` is called with the name of a stage and the share (0 to 1) of the stage that is done.
    """

    progress: Progress = lambda stage, share: None
    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[Callable[[float], None]]:
        """Context that measures the time of a stage, which may come several times.

        The context yields a function that reports the share (0 to 1) of the stage that is done.  A SimulationError in
        the block gets the words for the stage before its message.  A stage that raises an error adds no time.
        """
        self.progress(name, 0.0)
        start = time.perf_counter()
        try:
            yield lambda share: self.progress(name, share)
        except SimulationError as error:
            error.args = (f"{stage_words(name)}: {error}",)
            raise
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start
        self.progress(name, 1.0)
