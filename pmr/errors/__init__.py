"""Errors that a user can correct, in one line and with exit code 2; text for people; public names of packages.

Text of unknown origin is made safe for terminals, pages and drawings.  Public names are imported at their first use.
"""

from __future__ import annotations

import ast
import copyreg
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Executor
from contextlib import suppress
from copy import copy
from difflib import get_close_matches
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from math import floor, isfinite, log10
from os.path import isdir
from pathlib import Path
from typing import Any, NamedTuple, TypeVar
from warnings import warn

Found = TypeVar("Found")
WIDEST = 60  # largest number of letters of a value that a message shows
#: Share of a path's range by which the path may exceed its ends, as measured paths do; the excess is then cut off.
BEYOND_ENDS = 1e-5


class InputError(ValueError):
    """An input that is not possible: a value of a scene, of a study, of an option or of a file.

    `source` is the file or the option with the value.  `key` is the dotted key, such as ``body.length``, or empty if
    the error concerns the whole file.  `value` is the value that was read, or None if the message shows no value.
    `allowed` says in words what is accepted.
    """

    def __init__(self, source: str, key: str, value: object, allowed: str) -> None:
        self.source, self.key, self.value, self.allowed = source, key, value, allowed
        super().__init__(self._line())

    def __reduce__(self) -> tuple[Any, ...]:
        # Errors are sent between ranks and workers; without this method only the message would be sent.
        return copyreg.__newobj__, (type(self),), vars(self) | {"args": self.args}  # type: ignore[attr-defined]

    def with_source(self, source: str) -> InputError:
        """Return an InputError like this one whose source is `source`, the file or option with the value.

        If the source is not ``"scene"``, this error itself is returned.
        """
        return self._copy_with(source=source) if self.source == "scene" else self

    def with_key(self, key: str) -> InputError:
        """Return an InputError like this one with another key: `key`, as the scene's file spells it.

        If the source is not ``"scene"``, this error itself is returned.
        """
        return self._copy_with(key=key) if self.source == "scene" else self

    def _copy_with(self, **parts: str) -> InputError:
        """Return an error like this one, of the same class, with another ``source`` or ``key`` from `parts`."""
        changed = copy(self)
        vars(changed).update(parts)
        changed.args = (changed._line(),)
        return changed

    def _line(self) -> str:
        """Return the message in one line: source, key, value and what is allowed."""
        text = repr(self.value)
        shown = "" if self.value is None else f" = {text if len(text) <= WIDEST else f'{text[: WIDEST - 3]}...'}"
        where = f"{self.source}: {self.key}{shown}" if self.key else f"{self.source}{shown}"
        return escape_controls(" ".join(f"{where}: {self.allowed}".split()))


class NotHeldError(InputError):
    """A part can move freely; `short` is a clause that names it, such as ``"middle and fly can move along y"``."""

    def __init__(self, source: str, key: str, value: object, allowed: str, short: str) -> None:
        super().__init__(source, key, value, allowed)
        self.short = short


class SimulationError(RuntimeError):
    """A simulation stopped before its end, or its result is not finite."""


class GrowthError(SimulationError):
    """A motion grows without bound: most of its energy comes neither from loads nor from moving constraints.

    `rigid_rows` are the names of the rigid constraints that move, whose multipliers may cause the growth.
    """

    def __init__(self, message: str, rigid_rows: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.rigid_rows = rigid_rows

    def refusal(self, step: float, rho_inf: float) -> InputError:
        """Return this error as an InputError that names the key to change.

        If no rigid constraint moves, the key is time.step.  If one moves, the key is time.rho_inf, or
        reduction.flexibility if `rho_inf` is 0 already.  `step` is the scene's time step in s, and `rho_inf` its
        spectral radius at infinite frequency.
        """
        key, value, allowed = "time.step", step, "a smaller one is allowed"
        if self.rigid_rows and rho_inf > 0.0:
            key, value = "time.rho_inf", rho_inf
        elif self.rigid_rows:
            return InputError("scene", "reduction.flexibility", False, f"true is allowed: {self}")
        return InputError("scene", key, value, f"{allowed}: {self}")


class ConvergenceError(RuntimeError):
    """An iterative solver did not reach its tolerance; the message says what to change."""


class TooManyModesError(ConvergenceError):
    """More modes were requested than the model has; `count` is the number requested, `most` that of the model."""

    def __init__(self, count: int, most: int) -> None:
        """Compose the message from the number `count` of requested modes and the number `most` of the model's modes."""
        super().__init__(
            f"{count} modes asked for, but the model has {most} free coordinates; ask for fewer modes or refine the "
            "mesh"
        )
        self.count, self.most = count, most

    def __reduce__(self) -> tuple[type[TooManyModesError], tuple[int, ...]]:
        return TooManyModesError, (self.count, self.most)


def begin_aside(helper: Executor | None, function: Callable[..., Found], *arguments: Any) -> Callable[[], Found]:
    """Begin ``function(*arguments)`` in a process of `helper`, and return a function that waits for its result.

    Without a process, or if the call fails there, it is made in this process.
    """
    with suppress(BrokenExecutor, OSError):  # the process was ended, or can't be started
        if helper is not None:
            future = helper.submit(function, *arguments)
            return cache(lambda: function(*arguments) if future.exception() else future.result())
    result = function(*arguments)
    return lambda: result


def call_on_first_rank(comm: Any, make: Callable[[], Found]) -> Found | None:
    """Call `make` on rank 0 of `comm`; return its result on rank 0 and None on the other ranks.

    Collective: all ranks have to call it.

    An InputError, SimulationError or ConvergenceError on rank 0 is raised on all ranks; otherwise the other ranks would
    wait for rank 0 in their next exchange.
    """
    result, refused = None, None
    if comm.rank == 0:
        try:
            result = make()
        except (InputError, SimulationError, ConvergenceError) as error:
            refused = error
    refused = comm.bcast(refused)
    if refused is not None:
        raise refused
    return result


class FormerName(NamedTuple):
    """Present name of a public object that was renamed, and the version of pmr that removes its former name."""

    now: str
    until: str


#: Present names of objects of `pmr`, by the public names that they had in earlier versions.
FORMER: Mapping[str, FormerName] = {}


def declared_names(file: str) -> dict[str, str]:
    """Return the objects that a package imports under ``if TYPE_CHECKING``, as ``module:name`` by their names there.

    `file` is the source file of the package.
    """
    blocks = (node for node in ast.parse(Path(file).read_text(encoding="utf-8")).body if isinstance(node, ast.If))
    imports = [node for block in blocks for node in block.body if isinstance(node, ast.ImportFrom)]
    return {name.asname or name.name: f"{node.module}:{name.name}" for node in imports for name in node.names}


def lazy_names(
    package: str,
    places: Mapping[str, str],
    before: Callable[[], object] | None = None,
    former: Mapping[str, FormerName] | None = None,
) -> Callable[[str], Any]:
    """Return a function to be used as ``__getattr__`` of a package, which imports public names at their first use.

    `places` maps each public name to its object, written ``module:name``.  `before`, unless it is None, is called
    before a module is imported; it raises an error if the import would fail for want of a library.  For a name in
    `former` the function returns the object of the present name, with a DeprecationWarning.  For any other name it
    raises AttributeError, which says that a module has to be imported, or lists the names.
    """

    def find(name: str) -> Any:
        if former and name in former:
            now, until = former[name]
            warn(f"{package}.{name} is called {package}.{now} now; {until} has the old name no more",
                 DeprecationWarning, stacklevel=2)  # fmt: skip
            name = now
        if name not in places:
            if package in sys.modules and find_spec(f"{package}.{name}"):
                raise AttributeError(f"{package}.{name} is a module of its own: import {package}.{name}")
            raise AttributeError(
                f"module {package!r} has no public name {name!r}; there are {', '.join(sorted(places))}"
            )
        if before is not None:
            before()
        module, _, attribute = places[name].partition(":")
        return getattr(import_module(module), attribute)

    return find


#: Control characters, which change how a text is displayed: control codes, line ends, marks that change the direction
#: of writing, marks without width, halves of surrogate pairs, and characters that XML and Unicode exclude.
_STEERING = re.compile(
    "[\x00-\x1f\x7f-\x9f\xad\u061c\u180e\u200b\u200e\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\uffff"
    "\ud800-\udfff\U000e0000-\U000e0fff\U000ffffe-\U0010ffff]"
)

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?")

NAME_SIGNS = " _-.,:()+#/"
LONGEST_NAME = 100
NAMED = f"letters, digits and {' '.join(NAME_SIGNS.strip())} are allowed, {LONGEST_NAME} at most, a letter first"


def escape_controls(text: str) -> str:
    r"""Return the text in one line, with control characters as Python escapes them, such as ``\x1b`` or ``\u202e``.

    All other characters are unchanged: letters of any script, symbols, brackets, and markup of other programs.
    """
    return _STEERING.sub(lambda match: match[0].encode("unicode_escape").decode("ascii"), text)


def is_name(text: str, longest: int = LONGEST_NAME) -> bool:
    """Whether all programs that read a file (table, deck, script, page, path) read the text as one name.

    Such a name has letters, digits and signs of any script; of ASCII's punctuation only those in `NAME_SIGNS`.  The
    name is one line, begins with a letter, a digit or _, has no ``..`` and no blank at its ends, and has at most
    `longest` characters.
    """
    plain = all(sign.isalnum() or sign in NAME_SIGNS for sign in text if sign.isascii())
    begins = text[:1].isalnum() or text[:1] == "_"
    return (
        plain and begins and ".." not in text and len(text) <= longest and escape_controls(text) == text == text.strip()
    )


def reason_of(error: Exception) -> str:
    """The reason in an error, in words: what an `InputError` says is allowed, the whole message of any other error."""
    return error.allowed if isinstance(error, InputError) else str(error)


def missing_file_reason(path: Path, what: str = "file") -> str:
    """Return the words for a path at which no file can be read: nothing has this name, or a folder has it.

    `what` names the kind of file, such as "mesh", in these words.
    """
    return f"no such {what}" + ", but a folder" * isdir(path)


def similar_name_hint(name: object, names: Iterable[str]) -> str:
    """Return a question whether the user meant the one of `names` that is most similar to `name`, and a space.

    A name that is the first word of `name` counts as the most similar one.  The text is empty if no name is similar.
    """
    text, first_word = str(name), str(name).split(" ")[0]
    close = [first_word] if first_word in (names := list(names)) else get_close_matches(text, names, n=1)
    return f"did you mean {close[0]!r}? " if close else ""


def overview(head: str, **names: Sequence[str]) -> str:
    """Return a text for a ``repr``: the line `head`, and for each list in `names` its key, length and names.

    Of more than three names the first two and the last one are shown.
    """
    lines = [head]
    for what, listed in names.items():
        shown = [*listed[:2], "...", listed[-1]] if len(listed) > 3 else listed
        lines.append(f"  {what} ({len(listed)}): {', '.join(shown)}".rstrip(": "))
    return "\n".join(lines)


def two_digits(value: float) -> str:
    """Return `value` as text with two significant digits: a decimal number from 1e-4 to 1e6, else with an exponent.

    Zeros at its end are left out, as in ``5`` and ``0.1``.
    """
    return f"{float(f'{value:.2g}'):g}"


def percent(fraction: float, quantity: str = "") -> str:
    """Return an error, given as a fraction, as text in per cent with two significant digits.

    `quantity` names what the error is relative to, such as "the reference". If it is not empty, fractions from 10 on
    are written as a multiple of it: "12 times the reference". A fraction that is not finite gives "an unknown amount".
    """
    if not isfinite(fraction):
        return "an unknown amount"
    many = quantity and fraction >= 10.0
    return f"{two_digits(fraction)} times {quantity}" if many else f"{two_digits(100.0 * fraction)} %"


def two_digits_below(value: float) -> str:
    """Return a positive `value` as text, rounded down to two significant digits.

    A limit that is printed in this way is not larger than the limit itself.
    """
    place = floor(log10(value)) - 1
    return f"{float(f'{floor(value / 10.0**place * (1.0 + 1e-12))}e{place}'):g}"


def warning_kind(warning: str) -> str:
    """Return the kind of a warning: its words before the first of ``,:;(``.

    Numbers are left out, as they differ from run to run.
    """
    return " ".join(re.split(r"[,:;(]", _NUMBER.sub("", warning), maxsplit=1)[0].split())


def duration_text(seconds: float) -> str:
    """Return the time `seconds` as text, in s, from a minute on in min, from an hour on in h."""
    if seconds < 60.0:
        return f"{seconds:.0f} s"
    if seconds < 3600.0:
        return f"{seconds / 60.0:.0f} min"
    return f"{seconds / 3600.0:.1f} h"


def non_finite_names(data: object, name: str = "") -> Iterator[str]:
    """Yield the dotted names of all numbers in `data` that are not finite, such as ``errors.reduced_vs_full.tip``.

    `name` is the name of `data` itself, with which all these names begin.
    """
    if isinstance(data, float) and not isfinite(data):
        yield name
    elif isinstance(data, Mapping):
        for key, value in data.items():
            yield from non_finite_names(value, f"{name}.{key}" if name else str(key))
    elif isinstance(data, list | tuple):
        for number, value in enumerate(data):
            yield from non_finite_names(value, f"{name}[{number}]")


def non_finite_remarks(data: object) -> list[str]:
    """Return a sentence for each number in `data` that is not finite."""
    return [f"{name} is not finite; in summary.json it is null" for name in non_finite_names(data)]


def letters(number: int) -> str:
    """Return letters that stand for a number from 0 on: A to Z, then AA, AB and so on."""
    return (letters(number // 26 - 1) if number >= 26 else "") + chr(ord("A") + number % 26)
