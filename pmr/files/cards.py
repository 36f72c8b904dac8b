"""Cards of an input deck of Abaqus or CalculiX, with the lines of the files that it includes in their place.

A card is a line with a star, a keyword and options, followed by lines of data.  A keyword line that ends with a comma
goes on in the next line; lines that begin with two stars are comments.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pmr.errors import InputError
from pmr.errors.text import missing_file_reason

#: Largest depth to which files include others, as in Abaqus, and largest number of inclusions in a deck.
DEEPEST, MOST_INCLUSIONS = 5, 1000


@dataclass(frozen=True)
class Place:
    """A line of a file, by its number from 1."""

    source: str
    line: int

    def error(self, why: str) -> InputError:
        """Return an error that names the file and the line."""
        return InputError(self.source, f"line {self.line}", None, why)


@dataclass(frozen=True)
class DataLine:
    """A line of data: its place and its fields."""

    place: Place
    fields: tuple[str, ...]


@dataclass(frozen=True)
class Card:
    """A card: its place, keyword and names of options in capital letters, and data lines."""

    place: Place
    keyword: str
    options: Mapping[str, str]
    lines: tuple[DataLine, ...]

    def allow_options(self, names: str) -> None:
        """Raise InputError for the first option that is not among `names`, which spaces separate."""
        for name in self.options:
            if name and name not in names.split():
                raise self.place.error(f"the option {name} of *{self.keyword} is not read")


def read_cards(path: Path) -> Iterator[Card]:
    """Yield the cards of a deck; lines before the first card are ignored.

    The option ``INPUT`` of a card names a file whose lines follow the card as its data.  Raises InputError, with file
    and line, for a file that is not there or that includes itself.
    """
    files, head = _Files(path.parent), None
    data = list[DataLine]()
    for place, text in files.lines(path, ()):
        if not text.startswith("*"):
            data.append(DataLine(place, tuple(part.strip() for part in text.split(","))))
            continue
        if head:
            yield _with_data(head, data)
        head, data = _head(place, text), []
        if "INPUT" in head.options and head.keyword != "INCLUDE":
            listed = files.include(head, (path,))
            data = [DataLine(at, tuple(part.strip() for part in line.split(","))) for at, line in listed]
    if head:
        yield _with_data(head, data)


@dataclass
class _Files:
    """The files of a deck, whose names are relative to the deck's folder or to that of the including file."""

    folder: Path
    count: int = 0

    def lines(self, path: Path, within: Sequence[Path]) -> Iterator[tuple[Place, str]]:
        """Yield place and text of each line of a file that is no comment, with included files in their place.

        A keyword line is yielded whole, with the lines in which it goes on.  `within` are the files that include this.
        """
        pending: tuple[Place, str] | None = None
        for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), 1):
            line = line.strip()
            if line.startswith("**") or not line:
                continue
            place, text = (Place(str(path), number), line) if pending is None else (pending[0], pending[1] + line)
            if pending is not None and line.startswith("*"):  # nothing went on
                yield from self._expand(*pending, (*within, path))
                place, text = Place(str(path), number), line
            pending = (place, text) if text.startswith("*") and text.endswith(",") else None
            if pending is None:
                yield from self._expand(place, text, (*within, path))
        if pending is not None:
            yield from self._expand(*pending, (*within, path))

    def _expand(self, place: Place, text: str, within: Sequence[Path]) -> Iterator[tuple[Place, str]]:
        """Yield a line, or the lines of the file that it includes."""
        if text[:1] == "*" and (card := _head(place, text)).keyword == "INCLUDE":
            yield from self.include(card, within)
        else:
            yield place, text

    def include(self, card: Card, within: Sequence[Path]) -> Iterator[tuple[Place, str]]:
        """Return the lines of the file that the option INPUT of a card names; `within` are the files around it."""
        name = card.options.get("INPUT", "")
        files = [folder / name for folder in (self.folder, within[-1].parent)]
        file = next((file for file in files if name and file.is_file()), None)
        self.count += 1
        if file is None:
            raise card.place.error(f"INPUT={name}: {missing_file_reason(files[-1])}; a file beside the deck is allowed")
        if len(within) > DEEPEST or self.count > MOST_INCLUSIONS or file in within:
            raise card.place.error(
                f"INPUT={name}: files that do not include themselves are allowed, to a depth of {DEEPEST} and at most "
                f"{MOST_INCLUSIONS} times"
            )
        return self.lines(file, within)


def _head(place: Place, text: str) -> Card:
    """Return the card of a keyword line, without data."""
    keyword, *parts = (part.strip() for part in text[1:].split(","))
    options = {name.strip().upper(): value.strip().strip('"') for name, _, value in (o.partition("=") for o in parts)}
    return Card(place, " ".join(keyword.upper().split()), options, ())


def _with_data(head: Card, data: Sequence[DataLine]) -> Card:
    """Return a card with its data lines."""
    return Card(head.place, head.keyword, head.options, tuple(data))
