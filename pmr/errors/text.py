"""Text for people: names and control characters made safe, numbers in sentences, and hints.

Text of unknown origin is made safe for terminals, pages and drawings.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from math import floor, isfinite, log10
from os.path import isdir
from pathlib import Path

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

    Such a name has letters, digits and signs of any script; of ASCII's punctuation only those in `NAME_SIGNS`.  It is
    one line, begins with a letter, a digit or _, does not lead to a folder above, and has at most `longest` characters.
    """
    plain = all(sign.isalnum() or sign in NAME_SIGNS for sign in text if sign.isascii())
    begins = text[:1].isalnum() or text[:1] == "_"
    return (
        plain and begins and ".." not in text and len(text) <= longest and escape_controls(text) == text == text.strip()
    )


def missing_file_reason(path: Path, what: str = "file") -> str:
    """Return the reason why there is no file to read at `path`: the name does not exist, or is a folder.

    `what` names the kind of file in this sentence.
    """
    return f"no such {what}" + ", but a folder" * isdir(path)


def similar_name_hint(name: object, names: Iterable[str]) -> str:
    """Return a question whether the most similar one of `names` was meant, followed by a space.

    The text is empty if no name is similar.
    """
    close = get_close_matches(str(name), list(names), n=1)
    return f"did you mean {close[0]!r}? " if close else ""


def overview(head: str, **names: Sequence[str]) -> str:
    """Return a text for a ``repr``: the line `head`, then a line for each list of names with its length.

    Of more than three names the first two and the last one are shown.
    """
    lines = [head]
    for what, listed in names.items():
        shown = [*listed[:2], "...", listed[-1]] if len(listed) > 3 else listed
        lines.append(f"  {what} ({len(listed)}): {', '.join(shown)}".rstrip(": "))
    return "\n".join(lines)


def two_digits(value: float) -> str:
    """Return `value` as text with two significant digits, from 1e-4 to 1e6 as a decimal number."""
    return f"{float(f'{value:.2g}'):g}"


def percent(fraction: float, quantity: str = "") -> str:
    """Return an error, given as a fraction, as words in per cent.

    If the `quantity` is named that the fraction refers to, fractions from 10 on are given as a multiple of it.
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
    """Return the time `seconds` as text, in s, min or h."""
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
