"""Fixtures that all tests share, and which tests run on several ranks, kernels of BLAS and stacks."""

import gc
import os
import shlex
import sys
import tempfile
import time

os.environ.setdefault("OMP_NUM_THREADS", "1")
#: What runs measure once per structure is no user's here.
os.environ["PMR_CACHE"] = os.path.join(tempfile.gettempdir(), f"pmr-tests-{os.getpid()}")

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import blas
import pytest
from oracle import CASES, Case, full_body, paper_basis, project, rich_body
from processes import Called, called

from pmr import scene
from pmr.cli import run as cli_run
from pmr.files import whole
from pmr.kernel import state
from pmr.kernel._native import ffi, lib
from pmr.report import album, document
from pmr.report.blocks import Drawing
from pmr.report.figures import drawing
from pmr.scene import Scene
from pmr.system.body import FullBody
from pmr.system.reduced_model import ReducedModel

TESTS = Path(__file__).parent
WORKFLOWS = TESTS.parent / "workflows"
#: Sources of the kernel beside the package that is tested, if it has them.
KERNEL_SOURCES = Path(str(state.__file__)).parent / "src"
#: Where BLAS and LAPACK have a hand in what is compared: run under several kernels of OpenBLAS, but of slow tests only
#: those that are marked so. Steps are made by C without BLAS: of `simulation` only what stands before them is here.
NUMERICAL = (
    *("compare", "convergence", "fem", "fullmodel", "models", "reduction", "system"),
    *("simulation/petsc", "simulation/statics", "simulation/native/test_systems.py", "simulation/test_modal.py"),
    *("studies/kinds", "errors/test_environment.py", "test_run.py"),
)
#: What shows FEniCSx, PETSc and SLEPc at work (weak forms, factors, memory, whole runs): first cases of its slow tests
#: run on both stacks in CI, all other slow tests on one.
FENICSX = (
    *("convergence", "fem", "models/test_profile_shell.py", "models/test_transverse_plates.py", "simulation/petsc"),
    *("fullmodel/test_memory.py", "fullmodel/test_model.py", "test_random_structures.py", "test_run.py"),
)
#: What reads scenes, pages and sources, or starts processes and stops them, by packages of one version on both stacks:
#: tested on one of them, but for `EVALUATED`, of which NumPy and SciPy decide.
READ = (
    *("benchmarks", "cli", "scene", "studies/test_", "tools"),
    *("test_commands.py", "test_names_in_text.py", "test_readme.py", "test_rooms.py", "test_workflows.py"),
)
EVALUATED = ("scene/test_signals.py",)
#: Ranks of this run, and what files say that have tests for several of them, and for several kernels.
RANKS = int(os.environ.get("OMPI_COMM_WORLD_SIZE", os.environ.get("PMI_SIZE", "1")))
FOR_RANKS, FOR_KERNELS = "pytest.mark.mpi", "pytest.mark.numerical"
#: Variables of the environment on which a test's outcome depends: the command that repeats it alone sets them.
SETTINGS = ("OMP_NUM_THREADS", "OPENBLAS_CORETYPE", "PMR_SWEEP", "PMR_KERNEL", "LD_PRELOAD", "ASAN_OPTIONS")


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print the command that repeats each failed test, and the kernels of BLAS, as these decide the round-off."""
    settings = [f"{name}={os.environ[name]}" for name in SETTINGS if name in os.environ]
    launcher = ["mpirun", "-n", str(RANKS)] if RANKS > 1 else []
    config = terminalreporter.config
    options = ["-p", "other_kernel"] if config.pluginmanager.has_plugin("other_kernel") else []
    options += ["-m", "peers"] if config.option.markexpr == "peers" else []
    for report in (report for kind in ("failed", "error") for report in terminalreporter.stats.get(kind, ())):
        command = shlex.join(["env", *settings, *launcher, sys.executable, "-m", "pytest", *options, report.nodeid])
        terminalreporter.write_line(f"alone: {command}")
    libraries = sorted(f"{library.name} {library.kernel}" for library in blas.loaded())
    terminalreporter.write_line(f"BLAS: {', '.join(libraries) or 'no OpenBLAS was loaded'}")


def pytest_unconfigure(config: pytest.Config) -> None:
    """End all ranks if a test has failed on this one, as the others would wait for it; first let them print."""
    reporter = config.pluginmanager.get_plugin("terminalreporter")
    if RANKS == 1 or reporter is None:
        return
    if reporter.stats.get("failed") or reporter.stats.get("error"):
        from mpi4py import MPI

        sys.stdout.flush()
        time.sleep(10.0)
        MPI.COMM_WORLD.Abort(1)


def pytest_configure() -> None:
    """Stop where the compiled kernel is not that of the sources beside it; an installed package has no sources."""
    if not KERNEL_SOURCES.is_dir():
        return
    from pmr.kernel.build import sources_digest  # reads the sources

    digest = getattr(lib, "SOURCES_DIGEST", ffi.NULL)
    if not digest or ffi.string(digest).decode() != sources_digest():
        pytest.exit("the kernel is older than its sources: run setup.py build_ext --inplace", returncode=2)


def pytest_sessionstart() -> None:
    """Collect no garbage until all tests are read: searching all that is imported takes as long as reading."""
    gc.disable()


def pytest_collection_finish() -> None:
    """Collect garbage again, but leave out what was imported so far."""
    gc.freeze()
    gc.enable()


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Skip files without tests of the chosen mark, so that they need not be imported."""
    if not (collection_path.name.startswith("test_") and collection_path.suffix == ".py"):
        return None
    if RANKS > 1:
        return True if FOR_RANKS not in collection_path.read_text() else None
    if config.option.markexpr in ("numerical", "numerical and not mpi") and not is_numerical(collection_path):
        return True if FOR_KERNELS not in collection_path.read_text() else None
    return None


def is_numerical(file: Path) -> bool:
    """Whether the results of a file's tests depend on BLAS and LAPACK."""
    return file.is_relative_to(TESTS) and file.relative_to(TESTS).as_posix().startswith(NUMERICAL)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark numerical tests, first cases and what CI runs on both stacks; refuse a mark that the file does not have."""
    functions = set[tuple[Path, str]]()
    for item in items:
        function = item.path, item.nodeid.partition("[")[0]
        first = function not in functions
        functions.add(function)
        if first:
            item.add_marker(pytest.mark.first)
        for mark in (FOR_RANKS, FOR_KERNELS):
            if item.get_closest_marker(mark.rpartition(".")[2]) and mark not in item.path.read_text():
                raise pytest.UsageError(f"{item.nodeid}: where it is to run only files are read that say {mark}")
        file, slow = item.path.relative_to(TESTS).as_posix(), item.get_closest_marker("slow") is not None
        if is_numerical(item.path) and not slow:
            item.add_marker(pytest.mark.numerical)
        read = file.startswith(READ) and not file.startswith(EVALUATED)
        of_fenicsx, numerical = file.startswith(FENICSX), item.get_closest_marker("numerical") is not None
        if of_fenicsx and first if slow else of_fenicsx or numerical or first and not read:
            item.add_marker(pytest.mark.stack)


@pytest.fixture(autouse=True, scope="session")
def _no_waiting_for_the_disk() -> Iterator[None]:
    """Leave files to the system's memory: no test is about a power failure."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda file: None)
        yield


@pytest.fixture(autouse=True, scope="module")
def _what_is_loaded_stays() -> None:
    """Leave what earlier files have loaded out of garbage collection, which `free_dropped` starts often."""
    gc.collect()
    gc.freeze()


@pytest.fixture
def run_command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., Called]:
    """Function that runs the command `pmr` with some arguments in this process."""
    return partial(called, monkeypatch, capsys)


@pytest.fixture
def without_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace drawings and pictures by empty ones; they take most of a page's time."""

    def empty(name: str, draw: object, caption: str, *arguments: object, fits: bool = False) -> Drawing:
        """Build an empty drawing."""
        return Drawing(name, "<svg></svg>", caption)

    monkeypatch.setattr(drawing, "__code__", empty.__code__)  # many modules have the function itself
    monkeypatch.setattr(cli_run, "has_free_core", lambda: False)  # another process would help
    monkeypatch.setattr(album, "render_shot", lambda shot: b"")


@pytest.fixture
def undrawn(without_figures: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace PDFs by empty files too."""
    monkeypatch.setattr(document, "write_pdf", lambda text, file: file.touch())


@pytest.fixture
def unmeasured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Function that, called with True, keeps runs of this process from measuring mesh and model.

    How far walls give way is read from the cache all the same. With `workers` those of a study measure nothing either:
    they have no cache at all.
    """
    nowhere, folder, usual = tmp_path / "no folder", os.environ["PMR_CACHE"], whole.user_cache_folder
    nowhere.touch()

    def leave_out(really: bool, workers: bool = False) -> None:
        monkeypatch.setattr(whole, "user_cache_folder", (lambda: None) if really else usual)
        monkeypatch.setenv("PMR_CACHE", str(nowhere / "in it") if really and workers else folder)

    return leave_out


@pytest.fixture(scope="session")
def load_scene() -> Callable[..., Scene]:
    """Function that loads a scene of ``workflows/`` with overrides."""

    def load(name: str = "paper_simple", overrides: Sequence[str] = ()) -> Scene:
        """Load a scene of ``workflows/``."""
        return scene.load(WORKFLOWS / f"{name}.toml", overrides)

    return load


@pytest.fixture(params=CASES)
def case(request: pytest.FixtureRequest) -> Case:
    """Test case of the paper; each test runs with all of them."""
    return CASES[request.param]


@pytest.fixture(scope="session")
def full() -> FullBody:
    """Full model of the paper: 50 elements, 153 coordinates."""
    return full_body(elements=50)


@pytest.fixture(scope="session")
def reduced(full: FullBody) -> ReducedModel:
    """Reduced model of the paper: (5, 6) snapshots, 20 coordinates."""
    return project(full, paper_basis(full, snapshots=5, modes=6, coordinates=20))


@pytest.fixture(scope="session")
def rich() -> FullBody:
    """Sparse full model with damping, two sliders and two inputs."""
    return rich_body()
