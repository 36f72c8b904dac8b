"""A study: the keys that all study files share, and the results of its runs, as they are stored and read.

Each kind of study adds keys of its own and its plan.
"""

from __future__ import annotations

import csv
import io
import json
import math
import os
import re
import time
from abc import abstractmethod
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pmr.errors import InputError, similar_name_hint, warning_kind
from pmr.files import npz
from pmr.files.whole import finish_swap, replacement_folder
from pmr.scene.keys import SceneTable
from pmr.studies.tasks import Failure, Plan, Scalar, TaskResult, digests

Count = Annotated[int, Field(ge=1, strict=True)]


class Statement(SceneTable):
    """Published statement with which a figure of the study is compared."""

    figure: str = Field(description="Name of the study's own figure")
    text: str = Field(description="What it is")
    value: float | str | None = Field(
        default=None, description="What is published, in SI units, per cent as a fraction"
    )
    words: str = Field(default="", description="As it is published, where a number alone would say too much")
    quantity: Literal["share", "length", "energy", "seconds", "ratio", "number"] = Field(
        default="number",
        description="How it is printed: a share in per cent, a quantity in its SI unit, or a plain number",
    )
    is_error: bool = Field(default=False, description="Whether smaller is better")
    why: str = Field(default="", description="Why the two differ, as far as is known")


class StudyBase(SceneTable):
    """A study: settings of its runs, validated and frozen.

    A kind is a module of `pmr.studies.kinds` with a class ``Study`` derived from this class; the type of its key
    ``kind`` is a Literal of the module's name.
    """

    kind: str = Field(description="Kind of study")
    title: str = Field(description="For reports")
    source: str = Field(default="", description="Publication with which the study is compared")
    published: tuple[Statement, ...] = Field(default=(), description="Published values of figures of this study")
    remarks: tuple[str, ...] = Field(default=(), description="Remarks on the results, for the report")

    @abstractmethod
    def plan(self) -> Plan:
        """Return the tasks of the study; every key that can be refused is refused here, before a task runs.

        Raises InputError with source ``"study"`` for a key of the study file; whoever reads the file replaces the
        source by the file's name.
        """

    def hints(self) -> list[str]:
        """Return a line for each key of the study with a number outside its usual range, perhaps in a wrong unit.

        The list is empty unless a kind of study overrides this.
        """
        return []

    def figures(self, results: StudyResults) -> Mapping[str, Scalar]:
        """Return numbers about all runs together, by name, for ``figures`` in summary.json.

        The method is called when all runs are done.  The mapping is empty unless a kind of study overrides this.
        """
        return {}

    @property
    def figure_names(self) -> Collection[str]:
        """Names that `figures` may have; a kind of study that overrides `figures` overrides this too."""
        return ()

    def refuse_unknown_figures(self) -> None:
        """Raise InputError with source ``"study"`` if a published value is of a figure that the study never has."""
        for k, statement in enumerate(self.published):
            if statement.figure not in self.figure_names:
                names, none = ", ".join(self.figure_names), f"none is allowed: the kind {self.kind!r} has no figures"
                allowed = f"{similar_name_hint(statement.figure, self.figure_names)}one of {names} is allowed"
                raise InputError("study", f"published[{k}].figure", statement.figure, allowed if names else none)

    def tables(self, results: StudyResults) -> Mapping[str, str | bytes]:
        """Return the contents of further tables of the finished runs, by file name.

        For an empty content no file is written, and an old file is deleted.
        """
        return {}

    def summary_line(self, results: StudyResults) -> str:
        """Return the main result in one line for the terminal; empty if the kind of study has none.

        The method is called when all runs are done.
        """
        return ""


FORMAT = "pmr-task-result"
FORMAT_VERSION = 3
STALE_AFTER = 3600.0  # s, age at which a file under construction counts as abandoned
#: Text between two warnings in a cell of the table.
SEPARATOR = " | "
#: Files that are written together, and the reports that are made of them.
TABLES, REPORT = ("runs.csv", "runs.npz", "seconds.csv", "summary.json"), ("report.html", "report.pdf")


@dataclass(frozen=True)
class Store:
    """Folder with the results of tasks: one npz file with a JSON header for each, named by the result's digest.

    The digest covers everything on which the result depends.  A file appears under its name only when it is complete,
    and a damaged file counts as missing; so an interrupted study continues with the files that exist.  Equal tasks of
    several studies share a file.  Nothing in a file is pickled.
    """

    folder: Path

    def path(self, digest: str) -> Path:
        """File of the result with this digest."""
        return self.folder / f"{digest}.npz"

    def prepare(self) -> None:
        """Make the folder, and delete files that interrupted processes left unfinished more than an hour ago."""
        self.folder.mkdir(parents=True, exist_ok=True)
        for file in self.folder.glob("*.part"):
            if file.is_file() and time.time() - file.stat().st_mtime > STALE_AFTER:
                file.unlink(missing_ok=True)

    def is_sound(self, digest: str) -> bool:
        """Return whether the file of this digest exists and is undamaged to the last byte."""
        try:
            self.read(digest)
        except npz.DamagedError:
            return False
        return True

    def write(self, digest: str, key: str, result: TaskResult) -> None:
        """Write the result of the task `key` to the file of this digest, completely or not at all.

        Raises TypeError or ValueError if the result's record holds anything but finite scalars.
        """
        header = {"format": FORMAT, "version": FORMAT_VERSION, "digest": digest, "key": key}
        header |= {"record": _check_record(result.record), "seconds": dict(result.seconds)}
        header |= {"warnings": list(result.warnings)}
        npz.write(self.path(digest), {f"array.{name}": array for name, array in result.arrays.items()}, header)

    def read(self, digest: str, only: Collection[str] | None = None) -> TaskResult:
        """Return the result with this digest; its arrays are read-only.

        `only` holds the names of the arrays that are read; None reads all.  Raises DamagedError if the file is missing
        or damaged.
        """
        file = self.path(digest)
        try:
            data = npz.read(file, only=only)
            header = npz.pop_header(data)
            if (header["format"], header["version"], header["digest"]) != (FORMAT, FORMAT_VERSION, digest):
                raise ValueError("another file's header")
            arrays = {name.removeprefix("array."): array for name, array in data.items()}
            for array in arrays.values():
                array.setflags(write=False)
            return TaskResult(header["record"], arrays, header["seconds"], tuple(header["warnings"]))
        except (KeyError, TypeError, ValueError) as error:
            raise npz.DamagedError(f"{file.name} is missing or damaged ({error})") from None


def _check_record(record: Mapping[str, Scalar]) -> dict[str, Scalar]:
    """Return a record with plain Python scalars under the same keys.

    Raises TypeError for a value of another type, ValueError for a float that is not finite.
    """
    plain: dict[str, Scalar] = {}
    for name, value in record.items():
        value = value.item() if isinstance(value, np.generic) else value
        if not isinstance(value, (float, int, bool, str, type(None))):
            raise TypeError(f"{name} is a {type(value).__name__}; a record holds scalars")
        if isinstance(value, float) and not math.isfinite(value):
            raise ValueError(f"{name} = {value} is not finite")
        plain[name] = value
    return plain


@dataclass(frozen=True)
class RunRecord:
    """One run of a study: the `parameters` that were varied, its `status`, and the numbers that it gave, `figures`.

    `status` is ``"done"``, ``"failed"`` or ``"skipped"``.  Unless it is ``"done"``, `figures` are empty, `reason` says
    why in one line, and `detail` says it at length.  `file` is the path of the run's arrays, relative to the study's
    folder.
    """

    key: str  # name of the run, which no other run of the study has
    status: str
    parameters: Mapping[str, Scalar]
    figures: Mapping[str, Scalar]
    seconds: Mapping[str, float]  # wall times in s, by name of the stage
    reason: str = ""
    detail: str = ""
    warnings: tuple[str, ...] = ()
    file: str = ""

    @property
    def row(self) -> dict[str, Scalar]:
        """Cells of the run in the table, by column: key, status, reason, parameters, figures, warnings."""
        head = {"run": self.key, "status": self.status, "reason": self.reason}
        return {**head, **self.parameters, **self.figures, "warnings": SEPARATOR.join(self.warnings)}


#: Figure by which warnings of one kind are compared, with the prefix of its unit.
_UP_TO = re.compile(r"\bup to (\d+\.?\d*(?:e[-+]?\d+)?)\s?(?:([mkMG])(?=N|Pa|m\b))?")
_PREFIXES = {"m": 1e-3, "k": 1e3, "M": 1e6, "G": 1e9}


def _largest_figure(warning: str) -> float:
    """Number after the first "up to" in a warning, in the unit without its SI prefix; -1 if there is no such number."""
    figure = _UP_TO.search(warning)
    return -1.0 if figure is None else float(figure[1]) * _PREFIXES.get(figure[2], 1.0)


@dataclass(frozen=True)
class CountedWarning:
    """A kind of warning: its worst text, the key of the run with this text, and the keys of all runs concerned."""

    text: str
    runs: tuple[str, ...]
    worst: str

    @classmethod
    def of_runs(cls, texts: Mapping[str, str]) -> CountedWarning:
        """Join the warnings of one kind; `texts` are their texts by the keys of the runs.

        The worst text has the largest figure behind "up to"; without such figures it is the text of the first run.
        """
        worst = max(texts, key=lambda run: _largest_figure(texts[run]))
        return cls(texts[worst], tuple(texts), worst)

    def line(self, count: int) -> str:
        """Return the warning as a line that says how many of the `count` runs of the study have it, and which is worst.

        If the study has a single run, the line is the text alone.
        """
        if count == 1:
            return self.text
        if len(self.runs) == 1:
            return f"in {self.runs[0]}: {self.text}"
        in_all, is_first = len(self.runs) == count, self.worst == self.runs[0]
        where = "" if in_all and is_first else f", {'first' if is_first else 'worst'} in {self.worst}"
        return f"in {'all' if in_all else f'{len(self.runs)} of'} {count} runs{where}: {self.text}"


@dataclass(frozen=True)
class StudyResults:
    """All runs of one study, in the order of its plan, and the folder in which the results are stored."""

    folder: Path
    runs: tuple[RunRecord, ...]

    @classmethod
    def collect(
        cls, folder: Path, plan: Plan, code: str, store: Store, failures: Mapping[str, Failure]
    ) -> StudyResults:
        """Return the records of a plan's runs, in the order of the plan.

        The record of a failed run is made from `failures`, which has the failures by the digest of the task.  All other
        records are read from the store.  `code` is the digest of the code that computed the results, and `folder` is
        the study's own folder.  Raises DamagedError if a result is missing.
        """
        digest = digests(plan, code)
        runs = []
        for task in plan.runs:
            failure = failures.get(digest[task.key])
            if failure is not None:
                record = RunRecord(task.key, failure.status, task.parameters, {}, {}, failure.reason, failure.detail)
            else:
                done, file = store.read(digest[task.key], only=(npz.HEADER,)), store.path(digest[task.key])
                record = RunRecord(task.key, "done", task.parameters, done.record, done.seconds, warnings=done.warnings)
                record = replace(record, file=os.path.relpath(file, folder))
            runs.append(record)
        return cls(folder, tuple(runs))

    @classmethod
    def load(cls, folder: Path) -> StudyResults:
        """Read the results from the summary.json that `save` wrote into `folder`.

        If `save` was interrupted while it replaced files, this is finished first.
        """
        finish_swap(folder)
        runs = json.loads((folder / "summary.json").read_text())["runs"]
        return cls(folder, tuple(RunRecord(**run | {"warnings": tuple(run["warnings"])}) for run in runs))

    @property
    def warnings(self) -> list[CountedWarning]:
        """Warnings of all runs, one entry for each kind, the kind that most runs have first."""
        of_kind = dict[str, dict[str, str]]()
        for run in self.runs:
            for text in run.warnings:
                of_kind.setdefault(warning_kind(text), {}).setdefault(run.key, text)
        counted = [CountedWarning.of_runs(texts) for texts in of_kind.values()]
        return sorted(counted, key=lambda warning: -len(warning.runs))

    @property
    def done(self) -> list[RunRecord]:
        """Runs that have a result, in the order of the plan."""
        return [run for run in self.runs if run.status == "done"]

    @property
    def is_complete(self) -> bool:
        """Whether all runs are done."""
        return len(self.done) == len(self.runs)

    def arrays(self, key: str) -> Mapping[str, NDArray[Any]]:
        """Read the arrays of the run with this key from the store, by name; the study's kind says their shapes.

        Raises DamagedError if the file is missing or damaged, and also for a run that is not done.  A key that no run
        has raises StopIteration.
        """
        file = next(run.file for run in self.runs if run.key == key)
        path = self.folder / file
        return Store(path.parent).read(path.stem).arrays

    def column(self, name: str) -> NDArray[Any]:
        """Return the column `name` (runs,) of the table; a run without a value has NaN, or "" in a column of texts."""
        values = [run.row.get(name) for run in self.runs]
        values_given = [value for value in values if value is not None]
        if any(isinstance(value, str) for value in values_given):
            return np.array(["" if value is None else str(value) for value in values])
        if len(values_given) == len(values) and values_given:
            return np.array(values_given)  # bool, int or float: the first type that holds all values
        return np.array([np.nan if value is None else float(value) for value in values])

    def save(self, summary: Mapping[str, object], tables: Mapping[str, str | bytes] | None = None) -> None:
        """Write runs.csv, runs.npz, seconds.csv, summary.json (`summary` and the runs) and further `tables`.

        `tables` maps file names to contents; no file is written for empty content, and None stands for no tables.  The
        files are in the study's folder; old files of these names are replaced or deleted.  An existing report is
        deleted, since it shows the old results.
        """
        rows = [run.row for run in self.runs]
        names = _column_names(rows)
        with replacement_folder(self.folder, (*TABLES, *REPORT, *(tables or {}))) as new:
            for name, content in (tables or {}).items():
                if content:
                    (new / name).write_bytes(content.encode() if isinstance(content, str) else content)
            _write(new / "runs.csv", _csv_of_rows(rows))
            npz.write(new / "runs.npz", {name: self.column(name) for name in names})
            times: list[dict[str, Scalar]] = [{"run": run.key} | dict(run.seconds) for run in self.runs]
            _write(new / "seconds.csv", _csv_of_rows(times))
            _write(new / "summary.json", self._text(summary))

    def save_summary(self, summary: Mapping[str, object]) -> None:
        """Write summary.json alone, with `summary` and the runs, and delete an existing report."""
        with replacement_folder(self.folder, ("summary.json", *REPORT)) as new:
            _write(new / "summary.json", self._text(summary))

    def _text(self, summary: Mapping[str, object]) -> str:
        """Return the text of summary.json: the keys of `summary`, and all runs under ``runs``."""
        runs = [
            vars(run) | {n: dict(getattr(run, n)) for n in ("parameters", "figures", "seconds")} for run in self.runs
        ]
        return npz.json_text({**summary, "runs": runs}, indent=1)


def _column_names(rows: Iterable[Mapping[str, Scalar]]) -> list[str]:
    """Return the names of the columns of rows in the order of their first appearance, ``warnings`` last."""
    names = dict.fromkeys(name for row in rows for name in row)
    return sorted(names, key=lambda name: name == "warnings")


def csv_text(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return the text of a CSV file with a line of column heads and rows of cells."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([heads, *rows])
    return text.getvalue()


def _csv_of_rows(rows: Sequence[Mapping[str, Scalar]]) -> str:
    """Return the text of a CSV file of rows by column name; cells that a row lacks are empty."""
    names = _column_names(rows)
    return csv_text(names, [[_cell(row.get(name)) for name in names] for row in rows])


def _cell(value: Scalar) -> str:
    """Return a value as text: None as an empty text, booleans in small letters, numbers with all digits."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    return value if isinstance(value, str) else repr(value)


def _write(path: Path, text: str) -> None:
    """Write a text file in UTF-8."""
    path.write_text(text, encoding="utf-8")
