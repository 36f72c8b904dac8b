"""Tasks of a study, each a named call of a function, their plan, and tasks that runs of many kinds of studies share.

Shared are reference motions and frequencies of full models.  Each of these tasks is planned from a scene without the
keys that do not decide its result, so that runs which differ only in such keys share the task, within a study and
across the studies of a collection.  Their functions import FEniCSx when they are called: planning works without it.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import re
import sys
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.errors.environment import stage_words
from pmr.files import npz
from pmr.scene import Compare, Damping, Reduction, Scene, Simulation, TimeChoice
from pmr.scene.keys import ALONE
from pmr.system.from_scene import contacts_of
from pmr.system.terms import terms_of

if TYPE_CHECKING:
    from pmr.fullmodel.build import AssembledBody
    from pmr.fullmodel.model import FullModel
    from pmr.system.system import System

#: Value of one cell of the table.
Scalar = float | int | bool | str | None
#: Length of the longest key of a task, and the pattern of keys, which are also names of files.
LONGEST = 120
KEY = re.compile(rf"[A-Za-z0-9][A-Za-z0-9._=,+-]{{0,{LONGEST - 1}}}")


def task_key(text: str) -> str:
    """Return a task key that resembles `text`: characters that keys can't contain are replaced by ``_``.

    The end of a text that is too long (`LONGEST`) is replaced by a digest of the text.  A text that does not begin with
    a letter or a digit gets a ``0`` before it.
    """
    key = re.sub(r"[^A-Za-z0-9._=,+-]+", "_", text)
    key = key if key[:1].isalnum() else f"0{key}"
    return key if len(key) <= LONGEST else f"{key[: LONGEST - 9]}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"


def cell_number(value: Scalar) -> float:
    """Return the value of a table's cell as a float; raises TypeError if the cell is empty (None) or a text."""
    if value is None or isinstance(value, str):
        raise TypeError(f"{value!r} is no number")
    return float(value)


@dataclass(frozen=True)
class TaskResult:
    """Result of a task: numbers for the table (`record`), arrays, times and warnings.

    Each entry of the `record` is a column of the table; its value must not depend on the machine.  Measured times,
    which differ from run to run, are in `seconds` instead.  `warnings` are the warnings of a run of the same scene, one
    line each; warnings that are logged while the task runs are added to them.
    """

    record: Mapping[str, Scalar] = field(default_factory=dict)  # a float must be finite; None leaves the cell empty
    arrays: Mapping[str, NDArray[Any]] = field(default_factory=dict)  # for other tasks or the report; no objects
    seconds: Mapping[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Failure:
    """Why a task has no result: its function failed, or the task was skipped because a task that it needs failed."""

    reason: str  # one line, the same wherever the task fails
    detail: str = ""  # traceback or output that helps to find the cause
    status: str = "failed"  # or "skipped"

    @classmethod
    def from_error(cls, error: BaseException) -> Failure:
        """Return the failure of a task that raised `error`; `detail` is the traceback."""
        return cls(" ".join(f"{type(error).__name__}: {error}".split()), "".join(traceback.format_exception(error)))

    def of_skipped(self, words: str) -> Failure:
        """Return the failure of a task that is skipped because it needs a task with this failure.

        `words` name the needed task.  If the needed task was skipped itself, its reason is repeated, so that the reason
        always names the task that failed.
        """
        reason = self.reason if self.status == "skipped" else f"needs {words}, which failed: {self.reason}"
        return Failure(reason, status="skipped")


#: Arguments of a task, in types of JSON; results of the tasks that it needs, by the names that its function uses.
Arguments = Mapping[str, Any]
Needs = Mapping[str, TaskResult]
TaskFunction = Callable[[Arguments, Needs], TaskResult]


@dataclass(frozen=True)
class Task:
    """One call of a function of a module, in a process of its own.

    The function is called with `arguments` and the results of `needs`; it sees one MPI process and one thread, and its
    result depends on nothing else.
    """

    key: str  # unique in its plan: letters, digits and ``._=,+-``
    function: TaskFunction
    arguments: Mapping[str, Any] = field(default_factory=dict)  # of JSON types; with digests of files that it reads
    needs: Mapping[str, str] = field(default_factory=dict)  # name that the function uses -> key of the needed task
    parameters: Mapping[str, Scalar] = field(default_factory=dict)  # first columns of the table, also for failed runs
    cost: float = 1.0  # expected effort in any unit, from which the time left is estimated
    label: str = ""  # words for progress and reasons; if empty, the key

    def __post_init__(self) -> None:
        """Raise ValueError for a key that can't name a file, and for a method or nested function as the function."""
        if not KEY.fullmatch(self.key):
            raise ValueError(f"task key {self.key!r}: {KEY.pattern} is allowed")
        if "." in self.function.__qualname__:
            raise ValueError(f"task {self.key}: {self.address} is no function of a module")

    @property
    def address(self) -> str:
        """The text ``"module:name"`` that names the function."""
        return f"{self.function.__module__}:{self.function.__qualname__}"

    def digest(self, code: str, needs: Mapping[str, str]) -> str:
        """Return the digest of everything that decides the result.

        It covers the function, the source of its module and the arguments.  It also covers `code`, the digest of the
        package's code, and `needs`, the digests of the results that the task needs, by name.
        """
        content = [code, self.address, _source(self.function.__module__), self.arguments, needs]
        return hashlib.sha256(json.dumps(content, sort_keys=True, allow_nan=False).encode()).hexdigest()[:24]


@lru_cache
def _source(module: str) -> str:
    """Return the source of an imported module."""
    return inspect.getsource(sys.modules[module])


@dataclass(frozen=True)
class Plan:
    """The tasks of one study: its runs, and tasks whose results several runs need; needed tasks come first."""

    runs: tuple[Task, ...]  # one row of the table each, in this order
    shared: tuple[Task, ...] = ()  # tasks without a row that several runs need; computed once if a run still needs them

    def __post_init__(self) -> None:
        """Raise InputError if two tasks have the same key, where capital and small letters are the same.

        A ValueError is raised if a task needs one that does not come before it.
        """
        twice = [key for key, count in Counter(task.key.casefold() for task in self).items() if count > 1]
        if twice:
            allowed = f"two runs are called {', '.join(twice)}; names of scenes and cases, and values, must differ"
            raise InputError("study", "", None, allowed)
        earlier = set[str]()
        for task in self:
            if missing := set(task.needs.values()) - earlier:
                raise ValueError(f"task {task.key} needs {', '.join(sorted(missing))}, which no task before it is")
            earlier.add(task.key)

    def __iter__(self) -> Iterator[Task]:
        """Iterate over all tasks: first those that runs share, then the runs."""
        return iter((*self.shared, *self.runs))


def digests(plan: Plan, code: str) -> dict[str, str]:
    """Return the digest of each task of a plan, by the task's key.

    `code` is the digest of the code with which tasks compute.
    """
    digest = dict[str, str]()
    for task in plan:
        digest[task.key] = task.digest(code, {name: digest[key] for name, key in task.needs.items()})
    return digest


def open_tasks(plans: Sequence[Plan], code: str, is_done: Callable[[str], bool]) -> dict[str, Task]:
    """Return the tasks of `plans` that have to be computed, by digest.

    These are the runs without a stored result, and the tasks without one that such runs need.  Each task comes after
    the tasks that it needs.  Equal tasks of several plans become one.

    In a plan, `Task.needs` has keys of tasks.  In the returned tasks it has the digests of these tasks, by which
    results are stored.  `is_done` tells for a digest whether its result is stored.  `code` is the digest of the code
    with which tasks compute.
    """
    tasks = dict[str, Task]()
    for plan in plans:
        digest, of_plan = digests(plan, code), dict[str, Task]()
        needed = {digest[run.key] for run in plan.runs}
        for task in reversed([*plan]):  # each task before the tasks that it needs
            key = digest[task.key]
            if key in needed and not is_done(key):
                of_plan[key] = replace(task, needs={name: digest[need] for name, need in task.needs.items()})
                needed.update(of_plan[key].needs.values())
        tasks |= dict(reversed(of_plan.items()))
    return tasks


#: Rough effort in s for the beam of Weyrer et al.
COSTS = {"full": 0.5, "ancf": 3.0, "frequencies": 0.5}


def scene_arguments(scene: Scene) -> dict[str, Any]:
    """Return a scene as arguments of a task: ``scene``, its keys, and ``hash``, a digest that covers named files.

    Title and published values, which change no result, are left out.
    """
    plain = scene.model_copy(update={"title": "", "published": None})
    return {"scene": plain.model_dump(mode="json"), "hash": plain.hash}


def scene_of(arguments: Arguments) -> Scene:
    """Return the scene of a task's arguments that `scene_arguments` made."""
    return Scene.model_validate(arguments["scene"])


def model_of(scene: Scene) -> FullModel:
    """Return the full model of a scene's single body, stored for later tasks by `bodies_of`."""
    return bodies_of(scene)[ALONE].model


def full_system(scene: Scene) -> System:
    """Return all full models of a scene, with their contacts, as one system of SciPy matrices.

    The matrices are complete, as a task runs on one rank.
    """
    from pmr.fullmodel.model import FullSystem

    models = {name: built.model for name, built in bodies_of(scene).items()}
    full = FullSystem(models, contacts_of(scene, models)).gather()
    assert full is not None
    return replace(full, terms=terms_of(scene, full.bodies))


def reduced_system(scene: Scene) -> System:
    """Return all bodies of a scene, reduced by their own settings, as one system; it is reduced anew at each call."""
    from pmr.reduction.bodies import join_bodies, reduce_bodies

    return join_bodies(scene, reduce_bodies(scene, bodies_of(scene)))


def bodies_of(scene: Scene) -> Mapping[str, AssembledBody]:
    """Return a scene's full models with their structures, by the body's name; they have the scene's damping.

    The models are stored for later tasks of this process, and shared by scenes that differ in loads, time or comparison
    alone.
    """
    plain = {"title": "", "published": None, "damping": scene.damping}
    return _build_bodies(_without_loads(scene).model_copy(update=plain))


@lru_cache(maxsize=4)
def _build_bodies(scene: Scene) -> Mapping[str, AssembledBody]:
    """Build the full models of a scene's bodies, and log their warnings; return the bodies by name.

    The bodies of the last few scenes are stored, and returned if the scene is one of these.
    """
    from pmr.fullmodel.build import build_bodies, log_warnings

    built = build_bodies(scene)
    log_warnings(built.values(), next(iter(built.values())).model.comm)
    return built


def reference_task(scene: Scene, name: str) -> Task:
    """Return the task that simulates the reference model `name` of a single body, ``"full"`` or ``"ancf"``.

    Scenes that differ in their reduction or in other comparisons alone have the same task.
    """
    is_ancf = name == "ancf"
    alone = scene.model_copy(
        update={
            "reduction": Reduction(),
            "simulation": Simulation(full="auto" if is_ancf else scene.simulation.full),
            "compare": Compare(against=(name,), ancf_elements=scene.compare.ancf_elements if is_ancf else 1),
        }
    )
    return _scene_task(simulate_reference, name, alone, simulator=name)


def frequencies_task(scene: Scene) -> Task:
    """Return the task that computes the lowest frequencies of a single body's full model over the path."""
    return _scene_task(compute_frequencies, "frequencies", _without_loads(scene))


def simulate_reference(arguments: Arguments, needs: Needs) -> TaskResult:
    """Task: simulate the full model or the ANCF cable, as argument ``simulator`` says.

    The arrays of the result are those of the `pmr.results.response.Response`.
    """
    from pmr.pipeline.full_order import FullOrder

    scene = scene_of(arguments)
    response = FullOrder.join(scene, {ALONE: model_of(scene)}).reference(arguments["simulator"])
    assert response is not None
    return TaskResult(arrays=npz.record_arrays(response), seconds={"simulate": response.seconds})


def compute_frequencies(arguments: Arguments, needs: Needs) -> TaskResult:
    """Task: the full model's f lowest frequencies ``omega`` (S, f) in rad/s at path coordinates ``s`` (S,) in m."""
    from pmr.compare.frequencies import CURVES, comparison_positions
    from pmr.fullmodel.eigensolvers import lowest_frequencies

    scene = scene_of(arguments)
    model = model_of(scene)
    s = comparison_positions(scene, model.size)
    return TaskResult(arrays={"s": s, "omega": lowest_frequencies(model, s, CURVES, scene.reduction.solver)})


def _without_loads(scene: Scene) -> Scene:
    """Return the scene without loads, damping and comparison, and with defaults for simulation, time and reduction.

    Only the end of the time and the solver of the reduction are those of the scene.  Free motions are allowed.
    """
    end = scene.time.end  # positions of the path are visited up to this time
    unloaded = scene.without_loads().model_copy(
        update={
            "damping": Damping(),
            "time": TimeChoice(end=end, step=end),
            "compare": Compare(against=()),
            "simulation": Simulation(),
            "free_motions": "allowed",  # simulations refuse free motions; here a slider may stand on a support
        }
    )
    plain = Reduction(solver=scene.sections[0].reduction.solver)
    return unloaded.vary_sections(lambda part: {"reduction": plain})


def _scene_task(function: TaskFunction, kind: str, scene: Scene, **more: Any) -> Task:
    """Return a task of a kind in `COSTS` that calls `function` on the scene, with `more` arguments.

    Its key is `kind` with a digest of its arguments.
    """
    arguments = scene_arguments(scene) | more
    digest = hashlib.sha256(json.dumps(arguments, sort_keys=True).encode()).hexdigest()[:12]
    return Task(f"{kind}-{digest}", function, arguments, cost=COSTS[kind], label=stage_words(kind))
