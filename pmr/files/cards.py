"""Cards of an input deck of Abaqus or CalculiX, with the lines of the files that it includes in their place.

A card is a line with a star, a keyword and options, followed by lines of data.  A keyword line that ends with a comma
goes on in the next line unless this begins with a number; lines that begin with two stars are comments.  Axes of
coordinates in a deck of Abaqus are those of `*SYSTEM`, cylindrical and spherical ones, and places of instances.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from pmr.errors import InputError, missing_file_reason
from pmr.files.arrays import Array

#: Largest depth to which files include others, as in Abaqus, and largest number of inclusions in a deck.
DEEPEST, MOST_INCLUSIONS = 5, 1000
#: Numbers of nodes and elements have to have fewer digits than this.
MOST_DIGITS = 18
#: Keywords of cards whose data may be in a file of their own; that of other cards is not read.
WITH_FILES = ("NODE", "ELEMENT", "NSET", "ELSET")


@dataclass(frozen=True)
class Place:
    """Place of a line in a file: the file's name and the line's number, from 1."""

    source: str
    line: int

    def error(self, why: str) -> InputError:
        """Return an InputError with the file and the line; `why` says in words what is wrong."""
        return InputError(self.source, f"line {self.line}", None, why)


@dataclass(frozen=True)
class DataLine:
    """A line of data in a deck: its place, and its fields as texts."""

    place: Place
    fields: tuple[str, ...]


@dataclass(frozen=True)
class Card:
    """A card of a deck: its place, its keyword and its options by name, both in capitals, and its lines of data."""

    place: Place
    keyword: str
    options: Mapping[str, str]
    lines: tuple[DataLine, ...]

    def allow_options(self, names: str) -> None:
        """Raise InputError for the first option of this card that is not in `names`, names with blanks between them."""
        for name in self.options:
            if name and name not in names.split():
                raise self.place.error(f"the option {name} of *{self.keyword} is not read")


def read_cards(path: Path) -> Iterator[Card]:
    """Yield the cards of a deck; lines before the first card are ignored.

    The option ``INPUT`` of a card of nodes, elements or sets names a file whose lines follow the card as its data.
    Raises InputError, with file and line, for a file that is not there or that includes itself.
    """
    files, head = _Files(path.parent), None
    data = list[DataLine]()
    for place, text in files.lines(path, ()):
        if not text.startswith("*"):
            data.append(DataLine(place, tuple(part.strip() for part in text.split(","))))
            continue
        if head:
            yield replace(head, lines=tuple(data))
        head, data = _head(place, text), []
        if "INPUT" in head.options and head.keyword in WITH_FILES:
            listed = files.include(head, (path,))
            data = [DataLine(at, tuple(part.strip() for part in line.split(","))) for at, line in listed]
    if head:
        yield replace(head, lines=tuple(data))


@dataclass
class _Files:
    """Files of a deck, which name each other relative to the deck's `folder` or to that of the including file."""

    folder: Path
    count: int = 0  # of the inclusions so far

    def lines(self, path: Path, within: Sequence[Path]) -> Iterator[tuple[Place, str]]:
        """Yield place and text of each line of a file but comments, with the lines of included files in their place.

        A keyword line is yielded as one text with the lines in which it goes on.  `within` are the files that include
        this file, the deck first.  Raises the errors of `include`.
        """
        pending: tuple[Place, str] | None = None
        for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), 1):
            line = line.strip()
            if line.startswith("**") or not line:
                continue
            place, text = (Place(str(path), number), line) if pending is None else (pending[0], pending[1] + line)
            if pending is not None and re.match(r"[*\d.+-]", line):  # nothing went on
                yield from self._expand(*pending, (*within, path))
                place, text = Place(str(path), number), line
            pending = (place, text) if text.startswith("*") and text.endswith(",") else None
            if pending is None:
                yield from self._expand(place, text, (*within, path))
        if pending is not None:
            yield from self._expand(*pending, (*within, path))

    def _expand(self, place: Place, text: str, within: Sequence[Path]) -> Iterator[tuple[Place, str]]:
        """Yield the line `text` with its place or, if the line includes a file, the lines of that file.

        `place` is the place of the line, and `within` are the files that led to the line, the deck first.  Raises the
        errors of `include`.
        """
        if text[:1] == "*" and (card := _head(place, text)).keyword == "INCLUDE":
            yield from self.include(card, within)
        else:
            yield place, text

    def include(self, card: Card, within: Sequence[Path]) -> Iterator[tuple[Place, str]]:
        """Return an iterator over place and text of each line of the file that the option INPUT of a card names.

        `within` are the files that led to the card, the deck first.  The file is looked for in the folder of the deck,
        then in that of the file that names it.  Raises InputError, with file and line, for a file that is missing or
        includes itself, and beyond the depth `DEEPEST` or the number `MOST_INCLUSIONS` of inclusions.
        """
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
    """Return the card of the keyword line `text` at `place`, without data."""
    keyword, *parts = (part.strip() for part in text[1:].split(","))
    options = {name.strip().upper(): value.strip().strip('"') for name, _, value in (o.partition("=") for o in parts)}
    return Card(place, " ".join(keyword.upper().split()), options, ())


Point = tuple[float, float, float]


@dataclass(frozen=True)
class Axes:
    """Rectangular axes in a deck: their origin (3,) in m, and a matrix R (3, 3) whose columns are the axes."""

    origin: Array
    R: Array


def read_axes(card: Card) -> Axes | None:
    """Return the axes of a card `*SYSTEM`; None, for the axes of the whole model, if the card has no data.

    The first line has the origin a and a point b on the x axis, the second one a point c in the xy plane.

    - Without c the y axis is horizontal.  If a and b have the same height, the axes are turned about z.
    - With a alone the axes are only moved.

    Raises InputError if a, b and c are on a line, if b is a or straight above or below a without c, and unless the card
    has three, six or nine coordinates.
    """
    numbers = [number for line in card.lines for number in read_numbers(line, 6)]
    if not numbers:
        return None
    first = card.lines[0].place
    if len(numbers) not in (3, 6, 9):
        raise first.error("three coordinates of each of one to three points are allowed")
    a, *further = np.array(numbers).reshape(-1, 3)
    if not further:
        return Axes(a, np.eye(3))
    x = further[0] - a
    across = further[1] - a if len(further) > 1 else np.cross([0.0, 0.0, 1.0], x)
    z = np.cross(x, across)
    size = np.linalg.norm(x) * np.linalg.norm(across)
    if not np.linalg.norm(z) > 1e-9 * size > 0.0:
        raise first.error("three points that are not on a line are allowed")
    x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
    return Axes(a, np.stack([x, np.cross(z, x), z], axis=1))


def rectangular(card: Card, axes: Axes | None, coordinates: Sequence[float]) -> Point:
    """Return x, y, z, in the axes of the whole model, of a node with `coordinates` (3,) on a card `*NODE`.

    `axes` are those of the card `*SYSTEM`, None without such a card.  What the coordinates are, depends on the option
    SYSTEM of the card, with angles in degrees:

    - R, or no such option: x, y and z;
    - C: radius, angle from x, and z;
    - S: radius, angle from x, and latitude above the xy plane.

    Raises InputError for another SYSTEM.
    """
    system = card.options.get("SYSTEM", "R").upper()
    if system not in ("R", "C", "S"):
        raise card.place.error(f"SYSTEM={system} is not read; R, C (cylindrical) and S (spherical) are allowed")
    x, y, z = coordinates
    if system == "S":
        latitude = np.deg2rad(z)
        x, z = x * float(np.cos(latitude)), x * float(np.sin(latitude))
    if system != "R":
        angle = np.deg2rad(y)
        x, y = x * float(np.cos(angle)), x * float(np.sin(angle))
    if axes is not None:
        x, y, z = (axes.origin + axes.R @ [x, y, z]).tolist()
    return x, y, z


def turned_axes(card: Card, points: Array) -> Array:
    """Return the axes (k, 3, 3), as rows, of displacements at k `points` (k, 3) in m, by a card `*TRANSFORM`.

    The card's line has two points, whose meaning depends on the card's TYPE:

    - R: one on the x axis and one in the xy plane; the axes are parallel at all points;
    - C: two on the polar axis; the axes are radial, circumferential and axial;
    - S: the centre and one on the polar axis; the axes are radial, circumferential and meridional.

    Raises InputError for anything else.
    """
    kind = card.options.get("TYPE", "R").upper()
    numbers = [number for line in card.lines for number in read_numbers(line, 6)]
    if kind not in ("R", "C", "S") or len(numbers) != 6:
        raise card.place.error("TYPE=R, C or S with three coordinates of two points is allowed")
    a, b = np.array(numbers[:3]), np.array(numbers[3:])
    x = np.tile(a, (len(points), 1)) if kind == "R" else points - a
    z = np.tile(np.cross(a, b) if kind == "R" else b - a, (len(points), 1))
    y = np.cross(z, x)
    if kind == "S":
        z = np.cross(x, y)
    with np.errstate(invalid="ignore", divide="ignore"):
        y, z = (axis / np.linalg.norm(axis, axis=1)[:, None] for axis in (y, z))
    axes = np.stack([np.cross(y, z), y, z], axis=1)
    if not np.isfinite(axes).all():
        raise card.place.error("two points that are not on a line with the origin are allowed, and nodes off the axis")
    return axes


def move_instance(card: Card, points: Sequence[Point]) -> list[Point]:
    """Return the points of the N nodes of an instance, from their `points` in the part; empty without nodes.

    The first line of the instance's `card` has a translation.  The second one has two points on an axis and an angle in
    degrees by which the nodes are turned about it after they were moved.  Numbers that are missing are 0.  Raises
    InputError for other lines.
    """
    if not points:
        return []
    places = np.array(points)
    if len(card.lines) > 2:
        raise card.lines[2].place.error("a line with the translation and one with the rotation are allowed")
    for line, count in zip(card.lines, (3, 7), strict=False):
        numbers = [*read_numbers(line, count), *[0.0] * count][:count]
        if count == 3:
            places = places + numbers
            continue
        a, b, angle = np.array(numbers[:3]), np.array(numbers[3:6]), numbers[6]
        length = float(np.linalg.norm(b - a))
        if angle and not length > 0.0:
            raise line.place.error("two points on the axis of rotation, which differ, and an angle are allowed")
        if angle:
            places = a + Rotation.from_rotvec(np.deg2rad(angle) * (b - a) / length).apply(places - a)
    return [(x, y, z) for x, y, z in places.tolist()]


def read_numbers(line: DataLine, most: int, what: str = "") -> list[float]:
    """Return the numbers of a line of data; an empty field between others is 0, empty fields at the end are left out.

    Raises InputError for a field that is no number, and for more than `most` numbers; `what` says what is allowed.
    """
    fields = list(line.fields)
    while fields and not fields[-1]:
        fields.pop()
    try:
        numbers = [float(field.upper().replace("D", "E") or "0") for field in fields]
    except ValueError:
        numbers = [np.nan]
    if len(numbers) > most or not np.isfinite(numbers).all():
        raise line.place.error(f"{what or f'at most {most} numbers are'} allowed")
    return numbers


def whole_number(line: DataLine, text: str, what: str) -> int:
    """Return the whole number that the text of a field of a `line` states.

    Raises InputError, with the place of the line, for another text; `what` says what is allowed.
    """
    if not is_label_number(text):
        raise line.place.error(f"{what} is allowed, not {text!r}")
    return int(text)


def is_label_number(text: str) -> bool:
    """Whether a text is a whole number that can be the number of a node or an element."""
    return text.isascii() and text.isdigit() and len(text) < MOST_DIGITS
