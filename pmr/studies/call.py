"""One call of ``pmr study``, from the study file to its tables.

The kind in a study file decides which keys it may have; a collection names other study files.  Tasks without a result
are computed by a pool of workers.
"""

from __future__ import annotations

import importlib
import os
import pkgutil
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field

from pmr.errors import InputError, duration_text, environment, similar_name_hint
from pmr.scene.keys import SceneTable
from pmr.scene.tomlfiles import Change, Dialect, TomlFile, override, result_name
from pmr.studies import kinds
from pmr.studies.study import RunRecord, Store, StudyBase, StudyResults
from pmr.studies.tasks import Failure, Plan, Task, open_tasks
from pmr.studies.workers import NOT_COMPUTING, Order, Pool, code_of_tasks

#: Files that the digest of the code leaves out, so that tasks are not computed again when these change; the digest of
#: a task covers the module of its own function.
NOT_IN_DIGEST = (*NOT_COMPUTING, "studies/kinds/")
#: Keys of study files that name files; summaries leave them out, since they say only where files are on this machine.
FILES = {"scene", "scenes"}
WATCH_EVERY = 1.0  # s
TASKS_IN_LINE = 4  # tasks that a line of progress names


@dataclass(frozen=True)
class Progress:
    """Progress of a study: how many tasks are done, how many failed or were skipped, how many there are, and times.

    `elapsed` is the time in s since the call began, `remaining` the estimated time in s until its end.
    """

    done: int
    failed: int
    total: int
    elapsed: float
    remaining: float | None  # estimated; None before the first task is done
    running: tuple[str, ...] = ()  # words for the tasks that are computed now
    stages: frozenset[str] = frozenset()  # names of the functions of these tasks

    @property
    def text(self) -> str:
        """The progress as one line of text."""
        failed = f", {self.failed} failed or skipped" if self.failed else ""
        over = not self.remaining or self.done + self.failed >= self.total
        time_left = "" if over else f", about {duration_text(self.remaining or 0.0)} left"
        named, more = ", ".join(self.running[:TASKS_IN_LINE]), " ..." * (len(self.running) > TASKS_IN_LINE)
        now = f"; now {named}{more}" if named else ""
        return f"{self.done} of {self.total} tasks done{failed} after {duration_text(self.elapsed)}{time_left}{now}"


Watch = Callable[[Progress], None]


@dataclass(frozen=True)
class Outcome:
    """Results of a call of ``pmr study``.

    `results` maps the name of each part of the project to the runs of its study.  `computed` is the number of tasks
    that this call computed; failed tasks, and those with a result from an earlier call, are not counted.
    """

    results: Mapping[str, StudyResults]
    computed: int

    @property
    def done(self) -> int:
        """Number of runs that have a result."""
        return sum(len(results.done) for results in self.results.values())

    @property
    def is_complete(self) -> bool:
        """Whether all runs have a result."""
        return all(results.is_complete for results in self.results.values())


def compute_results(project: Project, folder: Path, pool: Pool, watch: Watch) -> Outcome:
    """Compute the tasks of a project that have no stored result, and return the results of all tasks.

    No tables are written.  Results of tasks are stored in ``folder / "tasks"``.  `pool` runs the tasks, and `watch` is
    called with the progress (`run_tasks`).
    """
    store, code = Store(folder / "tasks"), environment.code_digest(environment.source_texts(), NOT_IN_DIGEST)
    store.prepare()
    tasks = open_tasks([part.plan for part in project.parts], code, store.is_sound)
    failures = run_tasks(tasks, store, pool, watch)
    results = {
        part.name: StudyResults.collect(folder / part.name, part.plan, code, store, failures) for part in project.parts
    }
    return Outcome(results, len(tasks) - len(failures))


def run_tasks(tasks: Mapping[str, Task], store: Store, pool: Pool, watch: Watch) -> dict[str, Failure]:
    """Compute `tasks`, each as soon as all results that it needs are stored; return the failures by the tasks' digests.

    `tasks` are those that `open_tasks` returned, by digest.  A task that needs a failed one is skipped, which counts as
    a failure with the status ``skipped``.  Results are written into the store; `pool` runs the tasks.  The call blocks
    until all tasks have ended; `watch` is called with the progress whenever a task ends, and every second.
    """
    waiting, code, begin = dict(tasks), code_of_tasks(), time.monotonic()
    running: dict[Future[Failure | None], str] = {}
    done, failures = set[str](), dict[str, Failure]()
    while waiting or running:
        for digest, task in list(waiting.items()):
            needs = [need for need in task.needs.values() if need in tasks]
            failed_need = next((need for need in needs if need in failures), None)
            if failed_need is not None:
                failures[digest] = failures[failed_need].of_skipped(tasks[failed_need].label or tasks[failed_need].key)
                del waiting[digest]
            elif done.issuperset(needs) and len(running) < 2 * pool.slots:  # one waits behind each, so none is idle
                del waiting[digest]
                order = Order(task.key, digest, task.address, task.arguments, task.needs, str(store.folder), code)
                running[pool.submit(order)] = digest
        finished, _ = wait(running, timeout=WATCH_EVERY, return_when=FIRST_COMPLETED)
        for future in [future for future in running if future in finished]:
            digest, error = running.pop(future), future.exception()  # the machine could not even start a process, say
            failure = future.result() if error is None else Failure.from_error(error)
            if failure is None:
                done.add(digest)
            else:
                failures[digest] = failure
        computed_now = [tasks[digest] for digest in running.values()][: pool.slots]
        watch(_progress(tasks, done, failures, time.monotonic() - begin, computed_now))
    return failures


def _progress(
    tasks: Mapping[str, Task], done: set[str], failures: Mapping[str, Failure], elapsed: float, running: list[Task]
) -> Progress:
    """Return the progress after `elapsed` seconds, while the tasks `running` are being computed.

    `tasks` are all tasks by digest, `done` the digests of those with a result, `failures` the failures by digest.
    """
    cost_done = sum(tasks[digest].cost for digest in done)
    cost_left = sum(task.cost for digest, task in tasks.items() if digest not in done and digest not in failures)
    remaining = elapsed * cost_left / cost_done if cost_done else None
    stages = frozenset(task.address for task in running)
    words = tuple(task.label or task.key for task in running)
    return Progress(len(done), len(failures), len(tasks), elapsed, remaining, words, stages)


def save(project: Project, outcome: Outcome, folder: Path) -> list[Path]:
    """Write the tables and summaries of all studies of a project with this outcome, and return the tables' paths.

    The paths are those of ``runs.csv`` and of the further tables that are not empty.  A single study is written to
    `folder`.  Each study of a collection is written to a folder of its own in `folder`, which also gets a summary of
    the runs of all studies.
    """
    written = []
    for part in project.parts:
        results = outcome.results[part.name]
        tables = part.study.tables(results)
        results.save(_summary_head(part.study.title, part.study.kind) | _study_summary(part.study, results), tables)
        written += [results.folder / name for name in ("runs.csv", *filter(tables.get, tables))]
    if "" not in outcome.results:
        runs = tuple(record for name, results in outcome.results.items() for record in _rename_runs(name, results))
        StudyResults(folder, runs).save_summary(
            _summary_head(project.title, project.kind) | {"studies": list(outcome.results)}
        )
    return written


def _rename_runs(name: str, results: StudyResults) -> list[RunRecord]:
    """Return a part's runs with keys ``<name>/<key>`` and with files relative to the folder of the collection."""
    return [
        replace(run, key=f"{name}/{run.key}", file=run.file and os.path.normpath(os.path.join(name, run.file)))
        for run in results.runs
    ]


def _study_summary(study: StudyBase, results: StudyResults) -> dict[str, Any]:
    """Return the entries of a study in summary.json.

    The entries are ``asked`` (the study's own keys), ``figures`` (numbers about all runs; empty unless all runs are
    done), ``source``, ``published``, ``remarks`` and ``hints``.
    """
    base = set(StudyBase.model_fields)
    keys = {name: value for name, value in study.model_dump(mode="json").items() if name not in base | FILES}
    figures = dict(study.figures(results)) if results.is_complete else {}
    published = [statement.model_dump() for statement in study.published]
    about = {"source": study.source, "published": published, "remarks": list(study.remarks), "hints": study.hints()}
    return {"asked": keys, "figures": figures} | about


def _summary_head(title: str, kind: str) -> dict[str, Any]:
    """Return the first entries of every summary.json: ``title``, ``kind``, versions, commit, date and machine.

    The last four tell from where results come (`pmr.errors.environment.describe_origin`).
    """
    return {"title": title, "kind": kind} | environment.describe_origin()


DIALECT = Dialect("study file", references=("file", "files", "scene", "scenes"))
COLLECTION = "collection"


class Collection(SceneTable):
    """Several studies in one call: their `files`, and keys to `change` in each, by the names of the studies."""

    kind: Literal["collection"] = Field(description="Several studies in one call")
    title: str = Field(description="For reports")
    files: Annotated[tuple[Path, ...], Field(min_length=1)] = Field(description="Files of the studies")
    change: dict[str, dict[str, Any]] = Field(
        default={}, description="Keys to change in a study, by the name of its file"
    )


@dataclass(frozen=True)
class PlannedStudy:
    """One study of a call and its plan; `name` is the study's folder, empty for a study outside a collection."""

    name: str
    study: StudyBase
    plan: Plan


@dataclass(frozen=True)
class Project:
    """Studies that one call of ``pmr study`` computes."""

    title: str
    kind: str
    parts: tuple[PlannedStudy, ...]

    @property
    def runs(self) -> tuple[str, ...]:
        """Names of all runs: the keys of their tasks, or ``<part>/<key>`` in a collection."""
        return tuple(_run_name(part, run) for part in self.parts for run in part.plan.runs)

    def select_runs(self, names: Sequence[str]) -> Project:
        """Return the project reduced to the runs of these names; raises InputError if a name belongs to no run."""
        unknown = sorted(set(names) - set(self.runs))
        if unknown:
            close = similar_name_hint(unknown[0], self.runs)
            raise InputError("command line", "--only", unknown[0], f"no such run; {close}--list shows them all")
        parts = [
            replace(part, plan=replace(part.plan, runs=tuple(r for r in part.plan.runs if _run_name(part, r) in names)))
            for part in self.parts
        ]
        return replace(self, parts=tuple(part for part in parts if part.plan.runs))


def _run_name(part: PlannedStudy, run: Task) -> str:
    """Return a run's key, preceded by the part's name and a slash if the run is one of a collection."""
    return f"{part.name}/{run.key}" if part.name else run.key


def kind_names() -> list[str]:
    """Return the names of all kinds of studies in alphabetical order, ``"collection"`` included."""
    return sorted([*(module.name for module in pkgutil.iter_modules(kinds.__path__)), COLLECTION])


def schemas() -> dict[str, dict[str, Any]]:
    """Return the JSON schema of each kind of study file, by the name of the kind."""
    return {kind: _study_class(kind).model_json_schema() for kind in kind_names()}


def _study_class(kind: str) -> type[BaseModel]:
    """Return the class that validates study files of a kind."""
    if kind == COLLECTION:
        return Collection
    model: type[StudyBase] = importlib.import_module(f"{kinds.__name__}.{kind}").Study
    return model


def load(path: str | Path, overrides: Sequence[str] = ()) -> Project:
    """Read the study file `path`, TOML with a ``kind``, and all files named there; return studies and plans.

    Names of files in the study file are relative to that file, and its key ``extends`` names a base file.  `overrides`
    are texts ``"section.key=value"``.  Raises InputError in one line: file, key, value, what is allowed.
    """
    file = _read(path, [override(text) for text in overrides])
    if file.data["kind"] != COLLECTION:
        part = _plan_study("", file)
        return Project(part.study.title, part.study.kind, (part,))
    collection = file.validate(Collection)
    names = [result_name(entry) for entry in collection.files]
    if len(set(names)) != len(names):
        raise InputError(file.origin("files"), "files", names, "names must differ")
    unknown = sorted(set(collection.change) - set(names))
    if unknown:
        allowed = f"one of the files' names is allowed: {', '.join(names)}"
        raise InputError(file.origin(["change", unknown[0]]), "change", unknown[0], allowed)
    parts = []
    for name, entry in zip(names, collection.files, strict=True):
        changes = [Change(collection.change.get(name, {}), file.origin(["change", name]))]
        member = _read(entry, changes)
        if member.data["kind"] == COLLECTION:
            raise InputError(file.origin("files"), "files", str(entry), "a collection can't hold another one")
        parts.append(_plan_study(name, member))
    return Project(collection.title, collection.kind, tuple(parts))


def _read(path: str | Path, changes: Sequence[Change]) -> TomlFile:
    """Read the study file `path` and apply `changes` to its content; raise an InputError for an unknown kind.

    Keys other than the kind are not checked.
    """
    file = TomlFile.read(path, DIALECT)
    for change in changes:
        file.apply(change)
    kind = file.data.get("kind")
    if kind not in kind_names():
        allowed = f"{similar_name_hint(kind, kind_names())}one of {', '.join(kind_names())} is allowed"
        raise InputError(file.origin("kind"), "kind", kind, allowed)
    return file


def _plan_study(name: str, file: TomlFile) -> PlannedStudy:
    """Return the study of a file and its plan, called `name`; an InputError of the plan names the file."""
    study = file.validate(_study_class(file.data["kind"]))
    assert isinstance(study, StudyBase)  # a collection can't be a part of a collection
    try:
        study.refuse_unknown_figures()
        return PlannedStudy(name, study, study.plan())
    except InputError as error:
        if error.source != "study":
            raise
        raise InputError(file.origin(error.key), error.key, error.value, error.allowed) from None
