"""Input files in TOML: workflows by name, ``extends``, overrides, validation, and errors with file, key and value."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from copy import deepcopy
from dataclasses import dataclass, field
from os.path import isdir, isfile
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from pmr.errors import InputError, missing_file_reason, similar_name_hint
from pmr.scene.keys import Refusal, dotted_key, iterate_keys

Model = TypeVar("Model", bound=BaseModel)


_HERE = Path(__file__).resolve().parents[1]


def workflows() -> dict[str, Path]:
    """Return the files of the workflows that come with pmr, by name; in a checkout they are next to the package."""
    folders = (_HERE.parent / "workflows", _HERE / "workflows")
    return {file.stem: file for folder in folders for file in (*folder.glob("*/*.toml"), *folder.glob("*.toml"))}


def experiments() -> dict[str, Path]:
    """Return the scripts of the experiments of the paper by Weyrer et al., by name; each is a program."""
    files = [file for folder in (_HERE.parent, _HERE) for file in (folder / "workflows" / "paper").glob("*.py")]
    return {file.stem: file for file in files if "__main__" in file.read_text(encoding="utf-8")}


def workflow(name: str) -> Path | None:
    """Return the file of a workflow by its name, with or without ``.toml``; None if there is none."""
    return workflows().get(name.removesuffix(".toml"))


def resolve_path(path: Path, within: str) -> Path:
    """Return the file `path`, the file called `within` in the folder `path`, or the workflow of that name.

    If there is none of these the result is `path`, for which reading reports the error.  A folder of results with the
    name of a workflow does not hide the workflow.
    """
    try:
        if path.is_dir() and (path / within).is_file():
            return path / within
        is_usable = path.exists() and not path.is_dir()
    except OSError:  # a name that no file can have
        is_usable = True
    return path if is_usable else workflow(str(path)) or path  # reading it reports the error


def result_name(path: Path) -> str:
    """Return the name of the scene or study at `path`, after which results and rows of tables are named.

    For a file this is its name without the ending.  For a folder, or for ``scene.toml`` or ``study.toml`` in a folder,
    it is the name of the folder.
    """
    folder = path if isdir(path) else path.parent
    return (folder.resolve().name if isdir(path) or path.name in ("scene.toml", "study.toml") else "") or path.stem


#: The file (or option) in which each key of the merged data was written.
Origins = dict[tuple[str, ...], str]
OPTION = "--set"
#: Most levels of nested tables and lists, and most files that extend one another.
DEEPEST = 40
LARGEST = 10**8  # bytes of a file
LONGEST = 2**63  # TOML's integers have 64 bits
TOO_LARGE = "integers of 64 bits are allowed"
#: A dotted key of more words than `DEEPEST`, for which tomllib takes memory by the square of their number.
_DEEP_KEY = re.compile(
    rf"""(?:^|[{{,])[ \t]*(?:(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*\.[ \t]*){{{DEEPEST}}}""", re.MULTILINE | re.ASCII
)
#: Words of tomllib for a key or table that adds to a table in braces, or stands a second time.
_TAKEN = re.compile(r"Cannot (?:mutate immutable namespace|declare) \(([^)]*)\)(?: twice)?")


@dataclass(frozen=True)
class Dialect:
    """Rules for reading one kind of file, and the kind's name in messages, such as ``"scene file"``."""

    name: str
    #: Keys, at any depth, that hold the name of a file (or a list of names), relative to the file they stand in.
    references: tuple[str, ...] = ("file",)
    #: Keys that a file which extends this one does not take over.
    not_inherited: tuple[str, ...] = ()
    #: Alternative keys of a table for the same setting: a file that sets some of one takes over none of the others.
    alternatives: Mapping[str, tuple[tuple[str, ...], ...]] = field(default_factory=dict)
    #: Dotted keys of earlier versions, without indices of lists, and their present names.
    renamed_keys: Mapping[str, str] = field(default_factory=dict)
    #: Dotted keys of earlier versions without a present name, and the message about each.
    removed_keys: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Change:
    """Nested tables to lay over a file, and their source (a file or option) for messages about refused values."""

    tables: Mapping[str, Any]
    source: str


@dataclass
class TomlFile:
    """Content of a file merged with all files that it extends, and the source of each key."""

    path: Path
    dialect: Dialect
    data: dict[str, Any]
    origins: Origins = field(default_factory=dict)

    @classmethod
    def read(cls, path: str | Path, dialect: Dialect) -> TomlFile:
        """Read the file `path` and all files that it extends; its own keys override theirs.

        The key ``extends`` names a file relative to this one, or a workflow.  `dialect` has the rules for such files.
        """
        file = cls(Path(path), dialect, {})
        file.data = file._with_base(file.path, extending=())
        return file

    def apply(self, change: Change) -> None:
        """Lay a change over the data, in place; raise an InputError for a list entry that does not exist."""
        self._forget_alternatives(self.data, change.tables)
        _merge(self.data, deepcopy(dict(change.tables)), change.source, self.origins)

    def validate(self, model: type[Model]) -> Model:
        """Return the data as an instance of the pydantic class `model`.

        Raises InputError for one key: the first that was renamed or removed since an earlier version; if there is none,
        an unknown key; if there is none, the first whose value is refused.
        """
        for location, name, _, value in iterate_keys(self.data):
            if name in self.dialect.renamed_keys:
                allowed = f"this key is called {self.dialect.renamed_keys[name]} now"
                raise InputError(self.origin(location), location, value, allowed)
            if name in self.dialect.removed_keys:
                raise InputError(self.origin(location), location, value, self.dialect.removed_keys[name])
        try:
            return model.model_validate(self.data)
        except ValidationError as error:
            refused = Refusal.from_validation(error, model, self.data)
            raise InputError(
                self.origin(refused.location), dotted_key(refused.location), refused.value, refused.allowed
            ) from None

    def origin(self, key: str | Sequence[str | int]) -> str:
        """Return the source, a file or an option, that last set a key.

        For a table, it is the source that last set one of its inner keys.  If no source set the key, it is the source
        of the nearest table around the key; if there is none, it is the file itself.
        """
        words = tuple(re.findall(r"[^][.]+", key) if isinstance(key, str) else map(str, key))
        inside = [
            source for key_of_origin, source in self.origins.items() if words and key_of_origin[: len(words)] == words
        ]
        above = [self.origins[words[:k]] for k in range(len(words), 0, -1) if words[:k] in self.origins]
        return (inside[-1:] or above or [str(self.path)])[0]

    def _with_base(self, path: Path, extending: tuple[Path, ...]) -> dict[str, Any]:
        """Return the tables of a file merged over those of the files in its key ``extends``.

        `extending` are the files that lead to this one by their keys ``extends``.  Raises InputError if one of
        `extending` is the file itself, if there are too many, or if ``extends`` names no file.
        """
        what = self.dialect.name
        data = read_tables(path, what)
        if path.resolve() in extending:
            raise InputError(str(path), "extends", None, "a file must not extend itself")
        if len(extending) > DEEPEST:
            raise InputError(str(path), "extends", None, f"at most {DEEPEST} files that extend one another are allowed")
        _resolve_references(data, path.parent, self.dialect.references)
        base: dict[str, Any] = {}
        if "extends" in data:
            extends = data.pop("extends")
            if not isinstance(extends, str):
                raise InputError(str(path), "extends", extends, f"the name of a {what} is allowed")
            file_beside = path.parent / extends
            base_file = file_beside if isfile(file_beside) else workflow(extends)
            if base_file is None:
                allowed = f"{similar_name_hint(extends, workflows())}the name of a {what} is allowed; there is none"
                allowed += ", but a folder" * (extends != "" and isdir(file_beside))
                raise InputError(str(path), "extends", extends, allowed)
            base = self._with_base(base_file, (*extending, path.resolve()))
            for key in self.dialect.not_inherited:
                base.pop(key, None)
        self._forget_alternatives(base, data)
        _merge(base, data, str(path), self.origins)
        return base

    def _forget_alternatives(self, base: dict[str, object], update: Mapping[str, object]) -> None:
        """Remove keys from `base`, in place, if `update` describes the same thing by other keys.

        For example, damping may be given by ``mass`` and ``stiffness`` or by ``ratio`` and ``frequencies``.  If
        `update` has ``ratio``, the keys ``mass`` and ``stiffness`` leave `base`.  The `alternatives` of the dialect are
        such sets of keys, by table.
        """
        for table, ways in self.dialect.alternatives.items():
            old, new = base.get(table), update.get(table)
            if not (isinstance(old, dict) and isinstance(new, Mapping)):
                continue
            used = [way for way in ways if set(way) & set(new)]
            for key in {key for way in ways if used and way not in used for key in way}:
                old.pop(key, None)
                self.origins.pop((table, key), None)


def override(text: str) -> Change:
    """Return the change that ``"section.key=value"`` describes, with the value in TOML notation or as a bare word.

    Raises InputError for a text of another form.
    """
    key, equals, value = text.partition("=")
    keys = key.strip().split(".")
    if not equals or not all(keys) or len(keys) > DEEPEST:
        raise InputError(OPTION, text, None, "section.key=value is allowed, e.g. reduction.coordinates=10")
    try:
        nested: Any = _parse(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        nested = value.strip()
    except ValueError as error:
        raise InputError(OPTION, key, value, str(error)) from None
    for part in reversed(keys):
        nested = {part: nested}
    return Change(nested, OPTION)


def toml_key(name: str) -> str:
    """Return a name as a key of TOML: in quotes unless it has only ASCII letters, digits, - and _."""
    return name if re.fullmatch("[A-Za-z0-9_-]+", name) else json.dumps(name)


def toml_value(value: object) -> str:
    """Return a value that was read from TOML, or nested tables of such values, as TOML on one line.

    Raises TypeError for dates and times.
    """
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{toml_key(name)} = {toml_value(inner)}' for name, inner in value.items())} }}"
    if isinstance(value, list):
        return f"[{', '.join(map(toml_value, value))}]"
    return repr(value) if isinstance(value, float) else json.dumps(value)


def merge_tables(base: Mapping[str, object], update: Mapping[str, object]) -> dict[str, Any]:
    """Return the tables `base` with the tables `update` merged over them, key by key; the arguments are not changed."""
    merged = deepcopy(dict(base))
    _merge(merged, deepcopy(dict(update)), "scene", {})
    return merged


def read_tables(path: Path, what: str) -> dict[str, Any]:
    """Return the tables of one file by key, without the files of its key ``extends``.

    Raises InputError if the file is missing, can't be read, is too large or is not TOML; `what` names the kind of file
    in the message.
    """
    if not isfile(path):
        close = similar_name_hint(path.stem, workflows()) if path.name == str(path) else ""
        close = f"a change of a key stands behind {OPTION}" if "=" in path.name else close
        raise InputError(str(path), "", None, f"{missing_file_reason(path, what)}; {close}".removesuffix("; ").rstrip())
    try:
        if path.stat().st_size > LARGEST:
            raise ValueError(f"a file of at most {LARGEST // 10**6} MB is allowed")
        return _parse(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(str(path), "", None, f"can't be read: {error.strerror}") from None
    except ValueError as error:
        raise InputError(str(path), "", None, f"not valid TOML: {_TAKEN.sub(_say_taken, str(error))}") from None


def _parse(text: str) -> dict[str, Any]:
    """Return the tables of a TOML text, by key.

    Raises ValueError if the text is not TOML, has tables too deep within each other, or has too large numbers.
    """
    with suppress(RecursionError):
        try:
            if not _DEEP_KEY.search(text) and not _is_too_deep(data := tomllib.loads(text)):
                return data
        except tomllib.TOMLDecodeError:
            raise
        except ValueError:  # of Python, for integers of over 4300 digits
            raise ValueError(TOO_LARGE) from None
    raise ValueError(f"at most {DEEPEST} tables or lists within each other are allowed")


def _say_taken(words: re.Match[str]) -> str:
    """Return a message about the key in a match of `_TAKEN`."""
    key = ".".join(part.strip(" '") for part in words[1].split(",") if part.strip())
    return f"{key} can't be added here: a table in braces {{ }} has all its keys within them, and any table stands once"


def _is_too_deep(data: object, depth: int = DEEPEST) -> bool:
    """Whether tables and lists are nested more than `depth` deep; raises ValueError for integers of over 64 bits."""
    if isinstance(data, int) and not -LONGEST <= data < LONGEST:
        raise ValueError(TOO_LARGE)
    inner = data.values() if isinstance(data, dict) else data if isinstance(data, list) else None
    return inner is not None and (depth < 0 or any(_is_too_deep(entry, depth - 1) for entry in inner))


def _resolve_references(data: object, folder: Path, references: tuple[str, ...]) -> None:
    """Put `folder` before relative names of files, in place, in all keys of nested tables that `references` names.

    The value of such a key is one name of a file, or a list of names.
    """
    table = data if isinstance(data, dict) else {}
    for value in data if isinstance(data, list) else table.values():
        _resolve_references(value, folder, references)
    for key in set(references) & set(table):
        if isinstance(table[key], str):
            table[key] = str(folder / table[key])
        elif isinstance(table[key], list):
            table[key] = [str(folder / name) if isinstance(name, str) else name for name in table[key]]


def _merge(
    base: dict[str, object], update: Mapping[str, object], source: str, origins: Origins, prefix: tuple[str, ...] = ()
) -> None:
    """Merge `update` into `base`, in place, and note `source` in `origins` for each key.

    Tables are merged key by key; signals (tables with a kind) replace each other as a whole.  A table that is laid over
    a list changes entries of the list: its keys are the entries' names, or their numbers from 0 on.  `prefix` is the
    key of `base`.
    """
    for key, value in update.items():
        location, old = (*prefix, key), base.get(key)
        if isinstance(value, Mapping) and isinstance(old, dict) and "kind" not in value:
            _merge(old, value, source, origins, location)
        elif isinstance(value, Mapping) and isinstance(old, list):
            for name, part in value.items():
                number = _entry(old, name, source, dotted_key([*location, name]), part)
                if isinstance(part, Mapping):
                    _merge(old[number], part, source, origins, (*location, str(number)))
                else:
                    old[number] = part  # the model refuses what can't be an entry
        else:
            base[key] = value
            for overwritten in [origin for origin in origins if origin[: len(location)] == location]:
                del origins[overwritten]
            origins[location] = source


def _entry(entries: list[object], name: str, source: str, key: str, value: object) -> int:
    """Return the number of the entry called `name` in a list `entries`; `name` may also be the number itself.

    Raises InputError if there is no such entry, with the `source`, the `key` and the `value` that was to be laid over
    the entry.  If this value is a table of a single key, the message names the inner key and its value, and so on.
    """
    while isinstance(value, Mapping) and len(value) == 1:
        ((part, value),) = value.items()
        key = f"{key}.{part}"
    names = [entry.get("name") if isinstance(entry, dict) else None for entry in entries]
    tables = [number for number, entry in enumerate(entries) if isinstance(entry, dict)]
    if names.count(name) == 1:
        return names.index(name)
    if name.isdecimal() and len(name) < 10 and int(name) in tables:
        return int(name)
    if not tables:
        raise InputError(source, key, value, "this list can't be changed in part; set it as a whole")
    listed = ", ".join(str(i) if entry_name is None else f"{entry_name} ({i})" for i, entry_name in enumerate(names))
    allowed = f"the entries of this list are allowed, by name or number: {listed}"
    before = key.removesuffix(name)
    if before.endswith("."):  # the list's own key, not a key within an entry
        first = next((str(entry_name) for entry_name in names if entry_name is not None), "0")
        allowed = f"this is a list; which of its entries is said before {name}, as in {before}{first}.{name}: {listed}"
    raise InputError(source, key, value, allowed)
