"""Reading a study file: its kind decides which keys it may have; a collection names other study files."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field

from pmr.errors import InputError
from pmr.errors.text import similar_name_hint
from pmr.scene.keys import SceneTable
from pmr.scene.tomlfiles import Change, Dialect, TomlFile, override
from pmr.studies import kinds
from pmr.studies.study import StudyBase
from pmr.studies.tasks import Plan, Task

DIALECT = Dialect("study file", references=("file", "files", "scene", "scenes"))
COLLECTION = "collection"
#: Kinds of studies of earlier versions that are scripts in workflows/paper.
EXPERIMENTS = ("combinations", "convergence", "error_map", "histories", "residual", "speed", "trade")


class Collection(SceneTable):
    """Several studies in one call: `files`, and the keys to `change` in each, by its file's name without suffix."""

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
        """Names of all runs: the keys of their tasks, in a collection ``<part>/<key>``."""
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
    """Return a run's key; in a collection the part's name and a slash stand before it."""
    return f"{part.name}/{run.key}" if part.name else run.key


def kind_names() -> list[str]:
    """Return the names of all kinds of studies, ``"collection"`` included."""
    return sorted([*(module.name for module in pkgutil.iter_modules(kinds.__path__)), COLLECTION])


def schemas() -> dict[str, dict[str, Any]]:
    """Return the JSON schema of each kind of study file."""
    return {kind: _study_class(kind).model_json_schema() for kind in kind_names()}


def _study_class(kind: str) -> type[BaseModel]:
    """Return the class that validates study files of a kind."""
    if kind == COLLECTION:
        return Collection
    model: type[StudyBase] = importlib.import_module(f"{kinds.__name__}.{kind}").Study
    return model


def load(path: str | Path, overrides: Sequence[str] = ()) -> Project:
    """Read a study file, which is TOML with a ``kind``, and the files that it names; return studies and plans.

    Names of files in the study file are relative to it, and its key ``extends`` names a base file.  `overrides` are
    texts ``"section.key=value"``.  Raises InputError in one line: file, key, value, what is allowed.
    """
    file = _read(path, [override(text) for text in overrides])
    if file.data["kind"] != COLLECTION:
        part = _plan_study("", file)
        return Project(part.study.title, part.study.kind, (part,))
    collection = file.validate(Collection)
    names = [entry.stem for entry in collection.files]
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
    """Read the study file `path` and apply `changes` to it; raises InputError if its kind is unknown."""
    file = TomlFile.read(path, DIALECT)
    for change in changes:
        file.apply(change)
    kind = file.data.get("kind")
    if kind in EXPERIMENTS:
        allowed = f"this experiment is a script: `pmr study {kind}` runs workflows/paper/{kind}.py"
        raise InputError(file.origin("kind"), "kind", kind, allowed)
    if kind not in kind_names():
        allowed = f"{similar_name_hint(kind, kind_names())}one of {', '.join(kind_names())} is allowed"
        raise InputError(file.origin("kind"), "kind", kind, allowed)
    return file


def _plan_study(name: str, file: TomlFile) -> PlannedStudy:
    """Return the study of a file and its plan; an InputError of the plan names the file."""
    study = file.validate(_study_class(file.data["kind"]))
    assert isinstance(study, StudyBase)  # a collection can't be a part of a collection
    try:
        return PlannedStudy(name, study, study.plan())
    except InputError as error:
        if error.source != "study":
            raise
        raise InputError(file.origin(error.key), error.key, error.value, error.allowed) from None
