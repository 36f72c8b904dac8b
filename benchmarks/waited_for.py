"""What people wait for, beside what was asked and what it was before: commands, steps, a shell, the manual, the tests.

One row more is one entry of `ROWS`: its name, what was asked, what was before, and a function that takes it.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks import fmu, growth
from benchmarks.ranks import Bounds, record_of

ROOT = Path(__file__).parents[1]
FIRST = "with nothing compiled"
#: Repeats of what takes less than a second, of which the least counts, and steps of ten seconds of 1 ms.
REPEATS, STEPS = 5, 10_000
#: Cells of the shell boom in m around it, and what a run of it may take: wall seconds, bytes.
CELLS, BOUNDS = 0.0438, Bounds(3600.0, 20.0 * 2**30)


@dataclass(frozen=True)
class Taken:
    """Seconds of the processor, those of wall time, and bytes of memory at most, where these were looked at."""

    seconds: float
    wall: float
    memory: float = 0.0

    def less(self, other: Taken) -> Taken:
        """What this takes more than another."""
        return Taken(self.seconds - other.seconds, self.wall - other.wall)


@dataclass
class Place:
    """A folder with caches of its own, in which commands run one after the other; what they took, by the row's name."""

    folder: Path
    caches: str = "first"
    taken: dict[str, Taken] = field(default_factory=dict)

    def pmr(self, *arguments: str) -> Taken:
        """A command of pmr."""
        variables = {"NUMBA_CACHE_DIR": str(self.folder / self.caches), "OMP_NUM_THREADS": "1"}
        variables["ZIG_GLOBAL_CACHE_DIR"] = str(self.folder / "zig")
        variables["PYTHONDONTWRITEBYTECODE"] = ""  # modules stay compiled from one command to the next, as for any user
        return taken_by(self.folder, variables, sys.executable, "-m", "pmr", *arguments)

    def python(self, code: str) -> Any:
        """What a program of Python prints as JSON, in a process of its own."""
        done = subprocess.run([sys.executable, "-c", code], cwd=self.folder, capture_output=True, text=True, check=True)
        return json.loads(done.stdout.splitlines()[-1])


@dataclass(frozen=True)
class Row:
    """What is waited for, in seconds of the processor or another unit: bytes of memory, or a ratio."""

    name: str
    asked: float
    before: str  # as it was first measured, before anything was done about it
    take: Callable[[Place], Taken]
    limit: str = ""  # why it can't be less
    long: bool = False  # takes minutes
    unit: str = "s"


def run(*arguments: str) -> Callable[[Place], Taken]:
    """``pmr`` with these arguments."""
    return lambda place: place.pmr(*arguments)


def compiled(*arguments: str) -> Callable[[Place], Taken]:
    """The same first of all after ``pmr compile``, whose caches later commands have."""

    def take(place: Place) -> Taken:
        place.caches = "compiled"
        place.pmr("compile")
        return place.pmr(*arguments)

    return take


def tolerance(place: Place) -> Taken:
    """What the search itself takes."""
    return place.pmr("run", "mine", "--tolerance", "1%").less(place.taken["pmr run of pmr new boom, later"])


def report(place: Place) -> Taken:
    """The report of a run that is there, in a process in which all modules are loaded."""
    found = place.python(REPORT)
    return Taken(found["seconds"], found["wall"])


REPORT = """
import json, time
from pathlib import Path
import pmr
from pmr.report.document import write_report
result = pmr.run(pmr.load_scene("mine")).result
write_report([result], Path("loaded"))
begun, before = time.perf_counter(), time.process_time()
write_report([result], Path("again"))
print(json.dumps({"wall": time.perf_counter() - begun, "seconds": time.process_time() - before}))
"""


def exudyn(_: Place) -> Taken:
    """Exudyn's own seconds for three sections on pads that push, in the parts of a step that march took."""
    from pmr import load_scene
    from pmr.pipeline import reduce
    from pmr.simulation import Excitation, contact_step, exudyn
    from pmr.simulation.native import systems

    scene = load_scene(ROOT / "workflows" / "boom_three.toml")
    system, excitation = reduce(scene).system, Excitation.of(scene)
    made, omega = systems.simulate(system, excitation).parts, contact_step.contact_frequency(system, excitation)
    same = excitation.with_stepping(contact_step.as_made(excitation.stepping, made, omega))
    return timed(lambda: exudyn.simulate_system(system, same, systems.start_of(system, same)))


def step(place: Place) -> Taken:
    """A step of 1 ms of the FMU of `pmr new boom`, called from C, all inputs set and all displacements read."""
    scene = place.folder / "mine" / "scene.toml"
    (found,) = fmu.measure(REPEATS, cases={"boom": str(scene)})["seconds"].values()
    return Taken(found["min"], found["min"])


def seven_sections(_: Place) -> Taken:
    """Ten seconds of a boom of seven sections, and how many times as long they are as those of three.

    A joint takes a, and the two on one section b besides, which makes (6 a + 5 b) / (2 a + b), 5 at most; 9 if the time
    grew with the square of the joints.
    """
    ways = [growth.step(growth.boom(count)) for count in (3, 7)]
    times = [[way() for way in ways] for _ in range(REPEATS + 1)][1:]  # compiled or loaded in the first
    three, seven = (STEPS * min(one) for one in zip(*times, strict=True))
    return Taken(seven / three, seven)


def shell(place: Place) -> Taken:
    """The reduction of the shell boom, with its estimate's modes."""
    name = "shell boom of 91,680 coordinates with its estimate"
    if name not in place.taken:
        found = record_of("benchmarks.scale_run", [str(CELLS)], 1, BOUNDS)
        memory = 2.0**20 * (sum(found["peak_MB"]) - sum(found["loaded_MB"]))
        place.taken[name] = Taken(found["processor"], found["seconds"]["total"], memory)
    return place.taken[name]


def make(target: str) -> Callable[[Place], Taken]:
    """A target of the Makefile, with everything set up."""
    return lambda _: taken_by(ROOT, {}, "make", "-s", target)


MODULES = "FEniCSx, PETSc, SciPy, Numba, matplotlib and WeasyPrint take 1.5 s to load, and 1.7 s to draw a report"
#: In the order in which they are taken: what is measured later finds what earlier ones have cached.
ROWS = (
    Row("pmr --help", 0.3, "1.3 s", run("--help")),
    Row("pmr info", 0.8, "1.7 s", run("info")),
    Row(f"pmr run of pmr new boom, {FIRST}", 8.0, "35 s", run("run", "mine"), "Numba compiles for some 8 s"),
    Row("pmr run of pmr new boom, later", 8.0, "23 s", run("run", "mine"), MODULES),
    Row("report of that run", 2.0, "6 s", report),
    Row("first FMU", 10.0, "97 to 103 s", run("export", "reports/mine/reduced.npz", "--to", "fmu")),
    Row(f"pmr run boom_three, {FIRST}", 7.5, "49 s", run("run", "boom_three"), "Numba compiles for some 8 s"),
    Row("pmr run boom_three, first after pmr compile", 7.5, "49 s", compiled("run", "boom_three"), MODULES),
    Row("pmr run boom_three, later", 5.0, "11.5 s", run("run", "boom_three"), MODULES),
    Row("--tolerance 1% on pads that push, beside the run", 2.0, "20 to 31 s", tolerance),
    Row("a step of an FMU on pads that push", 10e-6, "48 us", step),
    Row("Exudyn on pads that push, boom_three", 10.0, "over 200 s", exudyn),
    Row("seven sections over three, 10 s each", 5.0, "0.037 to 0.076 s, as the square", seven_sections, unit=""),
    Row("shell boom of 91,680 coordinates with its estimate", 49.0, "98 s (of 92,280)", shell, long=True),
    Row("the same: memory", 2.35e9, "4.7 GB (of 92,280)", shell, long=True, unit="B"),
    Row("make docs", 120.0, "4 min", make("docs"), long=True),
    Row("make test", 900.0, "31 min", make("test"), long=True),
)


def measure(long: bool = False) -> dict[str, dict[str, Any]]:
    """What each takes, beside what was asked and what was before."""
    with tempfile.TemporaryDirectory() as folder:
        place, found = Place(Path(folder)), dict[str, dict[str, Any]]()
        place.pmr("new", "boom", "mine")
        for row in ROWS:
            if row.long and not long:
                continue
            taken = place.taken[row.name] = row.take(place)
            figures = {"here": taken.memory if row.unit == "B" else taken.seconds, "wall": taken.wall}
            said = {"asked": row.asked, "before": row.before, "limit": row.limit, "unit": row.unit}
            found[row.name] = figures | said
    return found


def timed(work: Callable[[], object]) -> Taken:
    """Some work of this process."""
    begun, before = time.perf_counter(), time.process_time()
    work()
    return Taken(time.process_time() - before, time.perf_counter() - begun)


def taken_by(folder: Path, variables: dict[str, str], *command: str) -> Taken:
    """A command and the processes that it waits for; raises where it fails."""
    begun, before = time.perf_counter(), _of_children()
    subprocess.run(list(command), cwd=folder, env=os.environ | variables, capture_output=True, check=True)
    return Taken(_of_children() - before, time.perf_counter() - begun)


def _of_children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
