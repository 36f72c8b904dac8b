from __future__ import annotations

import gc
import os
import sys
import tempfile
import time

os.environ.setdefault("OMP_NUM_THREADS", "1")
#: What runs measure once per structure is no user's here.
os.environ["PMR_CACHE"] = os.path.join(tempfile.gettempdir(), f"pmr-tests-{os.getpid()}")

from collections.abc import Callable, Sequence
from pathlib import Path

import blas
import pytest
from oracle import CASES, Case, full_body, paper_basis, project, rich_body

from pmr import scene
from pmr.reduced.model import ReducedModel
from pmr.report import album, background, document
from pmr.report.blocks import Drawing
from pmr.report.figures.canvas import drawing
from pmr.scene import Scene
from pmr.system.body import FullBody

TESTS = Path(__file__).parent
WORKFLOWS = TESTS.parent / "workflows"
#: Where BLAS and LAPACK have a hand in what is compared: run under several kernels of OpenBLAS, but of slow tests only
#: those that are marked so.
NUMERICAL = (
    *("compare", "constraints", "convergence", "fem", "fullmodel", "models", "reduction", "reduced"),
    *("simulation", "studies/kinds", "system", "errors/test_environment.py", "test_run.py"),
)
#: Rooms that compute with FEniCSx, PETSc and SLEPc: of the others CI runs slow tests on one stack alone.
FENICSX = (
    *("convergence", "fem", "fullmodel", "mesh", "models", "reduction", "simulation/petsc"),
    "test_random_structures.py",
)
#: What reads scenes, pages and sources, by packages of one version on both stacks: tested on one of them, but for
#: `EVALUATED`, of which NumPy and SciPy decide.
READ = ("scene", "test_commands.py", "test_readme.py", "test_rooms.py", "test_workflows.py")
EVALUATED = ("scene/test_signals.py",)
#: Ranks of this run, and what files say that have tests for several of them, and for several kernels.
RANKS = int(os.environ.get("OMPI_COMM_WORLD_SIZE", os.environ.get("PMI_SIZE", "1")))
FOR_RANKS, FOR_KERNELS = "pytest.mark.mpi", "pytest.mark.numerical"


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Which kernels decided the round-off."""
    found = sorted(f"{library.name} {library.kernel}" for library in blas.loaded())
    terminalreporter.write_line(f"BLAS: {', '.join(found) or 'no OpenBLAS was loaded'}")


def pytest_unconfigure(config: pytest.Config) -> None:
    """A rank on which a test failed ends the others, which would wait for it, after a while to say what they know."""
    reporter = config.pluginmanager.get_plugin("terminalreporter")
    if RANKS == 1 or reporter is None:
        return
    if reporter.stats.get("failed") or reporter.stats.get("error"):
        from mpi4py import MPI

        sys.stdout.flush()
        time.sleep(10.0)
        MPI.COMM_WORLD.Abort(1)


def pytest_sessionstart() -> None:
    """Nothing is garbage until all tests are read: to look for it in all that is imported takes as long as reading."""
    gc.disable()


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """What runs a part of the tests would read and import all files for the sake of a few."""
    if not (collection_path.name.startswith("test_") and collection_path.suffix == ".py"):
        return None
    if RANKS > 1:
        return True if FOR_RANKS not in collection_path.read_text() else None
    if config.option.markexpr in ("numerical", "numerical and not mpi") and not is_numerical(collection_path):
        return True if FOR_KERNELS not in collection_path.read_text() else None
    return None


def is_numerical(file: Path) -> bool:
    """Whether BLAS and LAPACK have a hand in what is compared there."""
    return file.is_relative_to(TESTS) and file.relative_to(TESTS).as_posix().startswith(NUMERICAL)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        for mark in (FOR_RANKS, FOR_KERNELS):
            if item.get_closest_marker(mark.rpartition(".")[2]) and mark not in item.path.read_text():
                raise pytest.UsageError(f"{item.nodeid}: where it is to run only files are read that say {mark}")
        file, slow = item.path.relative_to(TESTS).as_posix(), item.get_closest_marker("slow") is not None
        if is_numerical(item.path) and not slow:
            item.add_marker(pytest.mark.numerical)
        read = file.startswith(READ) and not file.startswith(EVALUATED)
        if file.startswith(FENICSX) or not slow and not read:
            item.add_marker(pytest.mark.stack)


@pytest.fixture(autouse=True, scope="module")
def _what_is_loaded_stays() -> None:
    """`free_dropped` collects garbage often, and needn't look through what earlier files have left each time."""
    gc.collect()
    gc.freeze()


@pytest.fixture
def without_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Drawings and pictures stay empty, which take most of a page's time."""

    def empty(name: str, draw: object, caption: str, *arguments: object) -> Drawing:
        return Drawing(name, "<svg></svg>", caption)

    monkeypatch.setattr(drawing, "__code__", empty.__code__)  # many modules have the function itself
    monkeypatch.setattr(background, "has_free_core", lambda: False)  # another process would draw
    monkeypatch.setattr(album, "develop", lambda shots: [b""] * len(shots))


@pytest.fixture
def undrawn(without_figures: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """PDFs too: for tests of what stands beside them."""
    monkeypatch.setattr(document, "print_page", lambda text, file: file.touch())


@pytest.fixture
def unmeasured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[bool], None]:
    """Called with True, `pmr run` measures neither mesh nor model beside a shell, as where there can be no cache."""
    nowhere, found = tmp_path / "no folder", os.environ["PMR_CACHE"]
    nowhere.touch()
    return lambda really: monkeypatch.setenv("PMR_CACHE", str(nowhere / "in it" if really else found))


@pytest.fixture(scope="session")
def load_scene() -> Callable[..., Scene]:
    """A scene of ``workflows/`` with overrides."""

    def load(name: str = "paper_simple", overrides: Sequence[str] = ()) -> Scene:
        return scene.load(WORKFLOWS / f"{name}.toml", overrides)

    return load


@pytest.fixture(params=CASES)
def case(request: pytest.FixtureRequest) -> Case:
    """The paper's test cases."""
    return CASES[request.param]


@pytest.fixture(scope="session")
def full() -> FullBody:
    """The paper's full model: 50 elements, 153 coordinates."""
    return full_body(elements=50)


@pytest.fixture(scope="session")
def reduced(full: FullBody) -> ReducedModel:
    """The paper's reduced model: (5, 6) snapshots, 20 coordinates."""
    return project(full, paper_basis(full, snapshots=5, modes=6, coordinates=20))


@pytest.fixture(scope="session")
def rich() -> FullBody:
    """Damping, two sliders and two inputs, sparse."""
    return rich_body()
