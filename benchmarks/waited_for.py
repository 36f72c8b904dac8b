"""Times that users wait for, beside required and former ones: commands, steps, a shell, the manual, the tests.

A further row is a further entry of `ROWS`: name, required value, former value, and a function that measures it.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import astuple, dataclass, field
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
    """Processor and wall time in s and, if it was measured, peak memory in B."""

    seconds: float
    wall: float
    memory: float = 0.0

    def less(self, other: Taken) -> Taken:
        """Times of this one minus those of another."""
        return Taken(self.seconds - other.seconds, self.wall - other.wall)

    def least(self, other: Taken) -> Taken:
        """Smaller values of both."""
        return Taken(*(min(pair) for pair in zip(astuple(self), astuple(other), strict=True)))


@dataclass
class Place:
    """Folder with caches of its own, in which commands of one checkout run one after the other."""

    folder: Path
    interpreter: str = sys.executable
    taken: dict[str, Taken] = field(default_factory=dict)  # what they took, by the row's name

    def pmr(self, *arguments: str) -> Taken:
        """Run a command of pmr in the folder and return what it takes."""
        variables = {"OMP_NUM_THREADS": "1"}
        variables["ZIG_GLOBAL_CACHE_DIR"] = str(self.folder / "zig")
        variables["PYTHONDONTWRITEBYTECODE"] = ""  # modules stay compiled from one command to the next, as for any user
        return taken_by(self.folder, variables, self.interpreter, "-m", "pmr", *arguments)

    def python(self, code: str) -> Any:
        """Run a program in Python in the folder, and return the value of the last line that it prints as JSON."""
        done = subprocess.run(
            [self.interpreter, "-c", code], cwd=self.folder, capture_output=True, text=True, check=True
        )
        return json.loads(done.stdout.splitlines()[-1])

    def least(self, row: Row) -> Taken:
        """Measure a row once more, and return the least that it has taken in this folder."""
        taken = row.take(self)
        self.taken[row.name] = taken.least(self.taken.get(row.name, taken))
        return self.taken[row.name]


@dataclass(frozen=True)
class Row:
    """Measurement with its required and its former value: wall or processor time in s, memory in B, or a ratio."""

    name: str
    asked: float
    before: float  # as it was first measured, before anything was done about it, at least
    take: Callable[[Place], Taken]
    limit: str = ""  # why it can't be less
    long: bool = False  # takes minutes
    kind: str = "wall"
    turns: int = 1  # how often it is taken; more than once only where caches are there
    command: bool = False  # an earlier checkout takes it too

    def figure(self, taken: Taken) -> float:
        """Value that the requirement is about."""
        return {"wall": taken.wall, "memory": taken.memory}.get(self.kind, taken.seconds)


def run(*arguments: str) -> Callable[[Place], Taken]:
    """Function that runs ``pmr`` with these arguments in a place."""
    return lambda place: place.pmr(*arguments)


def tolerance(place: Place) -> Taken:
    """What the search for a tolerance takes: a run with it, less the run without it."""
    return place.pmr("run", "mine", "--tolerance", "1%").less(place.taken[f"{MINE}, later"])


def report(place: Place) -> Taken:
    """What the report of a run takes in a process in which all modules are loaded."""
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
    """What Exudyn takes for three sections on pads that push, with the same parts of steps as march."""
    from pmr import load_scene
    from pmr.pipeline import reduce
    from pmr.simulation import Excitation, contact_step, exudyn
    from pmr.simulation.native import systems

    scene = load_scene(ROOT / "workflows" / "boom_three.toml")
    system, excitation = reduce(scene).system, Excitation.from_scene(scene)
    made, omega = systems.simulate(system, excitation).parts, contact_step.contact_frequency(system, excitation)
    same = excitation.with_stepping(contact_step.with_schedule(excitation.stepping, made, omega))
    return timed(lambda: exudyn.simulate_system(system, same, systems.start_of(system, same)))


def step(place: Place) -> Taken:
    """What a step of 1 ms of the FMU of `pmr new boom` takes, called from C, with inputs set and outputs read."""
    scene = place.folder / "mine" / "scene.toml"
    (found,) = fmu.measure(REPEATS, cases={"boom": str(scene)})["seconds"].values()
    return Taken(found["min"], found["min"])


def seven_sections(_: Place) -> Taken:
    """Processor time in s of a boom of seven sections for ten seconds (`wall`), and its ratio to three (`seconds`).

    With a for a joint and b for two joints on one section, the ratio is (6 a + 5 b) / (2 a + b), 5 at most; it would be
    9 if the time grew with the square of the joints.
    """
    ways = [growth.step(growth.boom(count)) for count in (3, 7)]
    times = [[way() for way in ways] for _ in range(REPEATS + 1)][1:]  # compiled or loaded in the first
    three, seven = (STEPS * min(one) for one in zip(*times, strict=True))
    return Taken(seven / three, seven)


def shell(place: Place) -> Taken:
    """What the reduction of the shell boom takes, with the modes of its estimate; measured once for each place."""
    if SHELL not in place.taken:
        found = record_of("benchmarks.scale_run", [str(CELLS)], 1, BOUNDS)
        memory = 2.0**20 * (sum(found["peak_MB"]) - sum(found["loaded_MB"]))
        place.taken[SHELL] = Taken(found["processor"], found["seconds"]["total"], memory)
    return place.taken[SHELL]


def make(target: str) -> Callable[[Place], Taken]:
    """Function that runs a target of the Makefile."""
    return lambda _: taken_by(ROOT, {}, "make", "-s", target)


MODULES = "FEniCSx, PETSc, SciPy, matplotlib and WeasyPrint take 1.5 s to load, and 1.7 s to draw a report"
UNITS = {"wall": "s", "processor": "s", "memory": "B", "ratio": ""}
MINE, THREE = "pmr run of pmr new boom", "pmr run boom_three"
TOLERANCE = "--tolerance 1% on pads that push, beside the run"
SHELL = "shell boom of 91,680 coordinates with its estimate"
EXPORT = ("export", "reports/mine/reduced.npz", "--to", "fmu")
#: In the order in which they are taken: what is measured later finds what earlier ones have cached.
ROWS = (
    Row("pmr --help", 0.3, 1.3, run("--help"), turns=3, command=True),
    Row("pmr info", 0.8, 1.7, run("info"), turns=3, command=True),
    Row(f"{MINE}, {FIRST}", 8.0, 35.0, run("run", "mine"), command=True),
    Row(f"{MINE}, later", 8.0, 23.0, run("run", "mine"), MODULES, turns=3, command=True),
    Row("report of that run", 2.0, 6.0, report, kind="processor"),
    Row("first FMU", 10.0, 97.0, run(*EXPORT), kind="processor", command=True),
    Row(f"{THREE}, {FIRST}", 7.5, 49.0, run("run", "boom_three"), command=True),
    Row(f"{THREE}, later", 5.0, 11.5, run("run", "boom_three"), MODULES, turns=3, command=True),
    Row(TOLERANCE, 2.0, 20.0, tolerance, turns=3),
    Row("a step of an FMU on pads that push", 10e-6, 48e-6, step),
    Row("Exudyn on pads that push, boom_three", 10.0, 200.0, exudyn),
    Row("seven sections over three, 10 s each", 5.0, 9.0, seven_sections, kind="ratio"),
    Row(SHELL, 49.0, 98.0, shell, long=True, kind="processor"),
    Row("the same: memory", 2.35e9, 4.7e9, shell, long=True, kind="memory"),
    Row("make docs", 120.0, 240.0, make("docs"), long=True, kind="processor"),
    Row("make test", 900.0, 1860.0, make("test"), long=True, kind="processor"),
)


def measure(long: bool = False, earlier: Path | None = None) -> dict[str, dict[str, Any]]:
    """Measure all rows, by name, beside their required and former values; long ones only if `long`.

    Commands run in turn with those of the checkout `earlier`, which has an environment of its own in ``.venv``.  The
    gain over that checkout does not depend on the machine, which may be slower than the one of the former values.
    """
    with tempfile.TemporaryDirectory() as here, tempfile.TemporaryDirectory() as there:
        places, found = [Place(Path(here))], dict[str, dict[str, Any]]()
        if earlier is not None:
            places.append(Place(Path(there), str(earlier.resolve() / ".venv" / "bin" / "python")))
        for place in places:
            place.pmr("new", "boom", "mine")
        for row in ROWS:
            if row.long and not long:
                continue
            beside = places if row.command else places[:1]
            taken = [[place.least(row) for place in beside] for _ in range(row.turns)][-1]
            figures: dict[str, Any] = {
                "here": row.figure(taken[0]),
                "wall": taken[0].wall,
                "processor": taken[0].seconds,
            }
            figures["earlier"] = row.figure(taken[1]) if taken[1:] else None
            said = {"asked": row.asked, "before": row.before, "limit": row.limit, "unit": UNITS[row.kind]}
            found[row.name] = figures | said
    return found


def allowed(one: Mapping[str, Any]) -> float:
    """Required value on this machine: the required one times the earlier checkout's time here over its former time."""
    return float(one["asked"] * (one["earlier"] / one["before"] if one.get("earlier") else 1.0))


def timed(work: Callable[[], object]) -> Taken:
    """Measure some work in this process."""
    begun, before = time.perf_counter(), time.process_time()
    work()
    return Taken(time.process_time() - before, time.perf_counter() - begun)


def taken_by(folder: Path, variables: dict[str, str], *command: str) -> Taken:
    """Run a command in a folder and measure it and the processes it waits for; raise if it fails."""
    begun, before = time.perf_counter(), _of_children()
    subprocess.run(list(command), cwd=folder, env=os.environ | variables, capture_output=True, check=True)
    return Taken(_of_children() - before, time.perf_counter() - begun)


def _of_children() -> float:
    """Processor time in s of all ended child processes."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
