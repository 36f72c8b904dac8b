"""Nodes, elements and sets of an input deck of Abaqus or CalculiX; content that can't be read is refused with its line.

A deck is a sequence of cards.  A card is a line with a star, a keyword and options, followed by lines of data.
`READERS` has a function for each keyword that is read, and `REFUSED` has the reasons why some others are refused.  All
further keywords do not concern nodes and elements and are ignored.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field
from pathlib import Path

from pmr.errors import InputError

#: For each type of linear element, the kind of its cells in meshio's words; then the number of corners of each kind.
KINDS: Mapping[str, str] = {
    **dict.fromkeys(("T2D2", "T2D2H", "T3D2", "T3D2H", "B21", "B21H", "B31", "B31H", "B31R", "B33"), "line"),
    **dict.fromkeys(("CPS3", "CPE3", "STRI3", "S3", "S3R", "S3RS", "R3D3", "M3D3"), "triangle"),
    **dict.fromkeys(("CPS4", "CPS4R", "CPE4", "S4", "S4R", "S4RS", "S4RSW", "S4R5", "R3D4", "M3D4"), "quad"),
    **dict.fromkeys(("C3D4", "C3D4H"), "tetra"),
    **dict.fromkeys(("C3D8", "C3D8H", "C3D8I", "C3D8IH", "C3D8R", "C3D8RH"), "hexahedron"),
}
CORNERS: Mapping[str, int] = {"line": 2, "triangle": 3, "quad": 4, "tetra": 4, "hexahedron": 8}


#: Numbers of nodes and elements have to have fewer digits than this.
MOST_DIGITS = 18


@dataclass(frozen=True)
class DataLine:
    """A line of data: its number in the file, from 1, and its fields."""

    number: int  # number of the line in the file, from 1
    fields: tuple[str, ...]


@dataclass(frozen=True)
class Card:
    """A card: number of its line, keyword and names of options in capital letters, and data lines."""

    number: int
    keyword: str
    options: Mapping[str, str]
    lines: tuple[DataLine, ...]


@dataclass(frozen=True)
class Elements:
    """Elements of one card: their type, and three entries for each element.

    These are its number, its line in the file and the numbers of its nodes.
    """

    type: str
    numbers: list[int]
    lines: list[int]
    nodes: list[list[int]]


@dataclass
class Deck:
    """Content of a deck; the names of sets are in small letters, and sets contain only nodes or elements that exist."""

    source: str
    nodes: dict[int, tuple[float, float, float]] = field(default_factory=dict)  # m, by number, in the file's order
    elements: list[Elements] = field(default_factory=list)
    element_numbers: set[int] = field(default_factory=set)
    node_sets: dict[str, set[int]] = field(default_factory=dict)
    element_sets: dict[str, set[int]] = field(default_factory=dict)
    set_spellings: dict[str, str] = field(default_factory=dict)  # names of sets as first written
    constraints: list[tuple[int, str]] = field(default_factory=list)  # line, keyword of cards in `CONSTRAINTS`

    def line_error(self, line: int, why: str) -> InputError:
        """Return an error for the line number `line` of the file."""
        return InputError(self.source, f"line {line}", None, why)


def read_deck(path: Path) -> Deck:
    """Read nodes, elements and sets of a deck.

    Raises InputError with file and line if a card can't be read, or if it has content that pmr does not support.
    """
    deck, parts = Deck(str(path)), _PartInstances()
    sets = list[Card]()
    for card in _cards(deck, path.read_text(encoding="utf-8", errors="replace")):
        if card.keyword in REFUSED:
            raise deck.line_error(card.number, f"*{card.keyword} is not read; {REFUSED[card.keyword]}")
        parts.check_instance(deck, card)
        if card.keyword in CONSTRAINTS:
            deck.constraints.append((card.number, card.keyword))
        if card.keyword in ("NSET", "ELSET"):
            sets.append(card)
        elif card.keyword in READERS:
            READERS[card.keyword](deck, card)
    for card in sets:  # sets are read last, as nodes and elements may stand anywhere in the file
        _read_set(deck, card)
    return deck


def _cards(deck: Deck, text: str) -> Iterator[Card]:
    """Yield the cards in the text of a deck; lines before the first card are ignored."""
    card: tuple[int, str] | None = None
    data = list[DataLine]()
    for number, line in enumerate(text.splitlines(), 1):
        line = line.strip()
        if line.startswith("**") or not line:
            continue
        if card and not data and card[1].endswith(","):  # the keyword line goes on
            card = card[0], card[1] + line
        elif not line.startswith("*"):
            data.append(DataLine(number, tuple(part.strip() for part in line.split(","))))
        else:
            if card:
                yield _card(*card, data)
            card, data = (number, line), []
    if card:
        yield _card(*card, data)


def _card(number: int, head: str, data: Sequence[DataLine]) -> Card:
    """Return the card of line `number`, made of its head line `head` and its data lines."""
    keyword, *parts = (part.strip() for part in head[1:].split(","))
    options = {name.strip().upper(): value.strip().strip('"') for name, _, value in (o.partition("=") for o in parts)}
    return Card(number, " ".join(keyword.upper().split()), options, tuple(data))


class _PartInstances:
    """Instances of parts seen so far.

    Each part may have one instance that is not moved; a second instance would have nodes and elements of the same
    numbers.
    """

    def __init__(self) -> None:
        self._instances = dict[str, int]()

    def check_instance(self, deck: Deck, card: Card) -> None:
        """Raise InputError if a card is an instance that is moved, or the second instance of its part."""
        if card.keyword != "INSTANCE":
            return
        part = card.options.get("PART", card.options.get("NAME", "")).lower()
        if any(field.strip("0.+-") for line in card.lines for field in line.fields):
            raise deck.line_error(
                card.lines[0].number,
                "the translation or rotation of an instance is not read; nodes in their places are allowed",
            )
        if part in self._instances:
            raise deck.line_error(
                card.number,
                f"a second instance of part {part}, after that in line {self._instances[part]}, is not read",
            )
        self._instances[part] = card.number


def _read_nodes(deck: Deck, card: Card) -> None:
    """Add the nodes on a card to the deck."""
    if card.options.get("SYSTEM", "R").upper() != "R":
        allowed = "nodes in rectangular coordinates are allowed"
        raise deck.line_error(card.number, f"SYSTEM={card.options['SYSTEM']} is not read; {allowed}")
    _refuse_options(deck, card, {"NSET", "SYSTEM"})
    numbers = list[int]()
    for line in card.lines:
        number, *place = (field for field in line.fields)
        while place and not place[-1]:
            place.pop()
        if len(place) > 3 and any(place[3:]):
            place = place[:3]  # the numbers that follow are normals of shells
        node = _whole_number(deck, line, number, "the whole number of a node")
        if node in deck.nodes:
            raise deck.line_error(
                line.number, f"node {node} is there a second time; one part is allowed, each number once"
            )
        try:
            x, y, z = (float(field or "0") for field in [*place, "0", "0", "0"][:3])
        except ValueError:
            raise deck.line_error(line.number, f"coordinates of node {node} that are numbers are allowed") from None
        deck.nodes[node] = (x, y, z)
        numbers.append(node)
    if "NSET" in card.options:
        _set_by_name(deck, deck.node_sets, card, "NSET").update(numbers)


def _read_elements(deck: Deck, card: Card) -> None:
    """Add the elements on a card to the deck."""
    _refuse_options(deck, card, {"TYPE", "ELSET"})
    block = Elements(card.options.get("TYPE", "").upper(), [], [], [])
    count, parts, begun = CORNERS.get(KINDS.get(block.type, "")), list[int](), 0
    for line in card.lines:
        begun = begun if parts else line.number
        parts.extend(_whole_number(deck, line, field, "a whole number") for field in line.fields if field)
        if len(parts) < 1 + count if count else not line.fields[-1]:
            continue  # the element goes on in the next line
        if parts[0] in deck.element_numbers:
            raise deck.line_error(
                begun, f"element {parts[0]} is there a second time; one part is allowed, each number once"
            )
        deck.element_numbers.add(parts[0])
        if count and len(parts) != 1 + count:
            raise deck.line_error(begun, f"the number of an element and {count} nodes are allowed for {block.type}")
        block.numbers.append(parts[0])
        block.lines.append(begun)
        block.nodes.append(parts[1:])
        parts = []
    if parts:
        raise deck.line_error(begun, f"element {parts[0]} of type {block.type} has too few nodes")
    deck.elements.append(block)
    if "ELSET" in card.options:
        _set_by_name(deck, deck.element_sets, card, "ELSET").update(block.numbers)


def _read_set(deck: Deck, card: Card) -> None:
    """Add the members of a set's card to the deck.

    The card lists them as numbers, as names of other sets, as a range (first, last, step), or as a set of elements
    whose nodes are the members.
    """
    of_nodes = card.keyword == "NSET"
    _refuse_options(deck, card, {"NSET", "ELSET", "GENERATE", "UNSORTED", "INTERNAL", "INSTANCE"})
    sets = deck.node_sets if of_nodes else deck.element_sets
    existing = deck.nodes.keys() if of_nodes else deck.element_numbers
    if card.keyword not in card.options:
        raise deck.line_error(card.number, f"*{card.keyword} with {card.keyword}=NAME is allowed")
    members = _set_by_name(deck, sets, card, card.keyword)
    if of_nodes and "ELSET" in card.options:
        members.update(_element_set_nodes(deck, card))
    for line in card.lines:
        fields = [field for field in line.fields if field]
        if "GENERATE" in card.options:
            numbers = [_whole_number(deck, line, field, "first, last and step") for field in fields]
            if len(numbers) not in (2, 3) or numbers[2:] == [0]:
                raise deck.line_error(line.number, "first, last and step as whole numbers are allowed")
            first, last, step = [*numbers, 1][:3]
            steps = range(first, last + 1, step)
            _check_existing(deck, line, card, existing, [*steps[:1], *steps[-1:]])
            members.update(number for number in existing if number in steps)
            continue
        for name in fields:
            if _is_label_number(name):
                _check_existing(deck, line, card, existing, [int(name)])
                members.add(int(name))
            elif name.lower() in sets:
                members.update(sets[name.lower()])
            else:
                raise deck.line_error(line.number, f"{name!r} is neither a number nor a set that stands further up")


def _element_set_nodes(deck: Deck, card: Card) -> set[int]:
    """Return the nodes of all elements in the element set that the card names."""
    name = card.options["ELSET"].lower()
    if name not in deck.element_sets:
        raise deck.line_error(
            card.number, f"ELSET={card.options['ELSET']} is no set of elements that stands further up"
        )
    inside = deck.element_sets[name]
    return {
        node
        for block in deck.elements
        for n, members in zip(block.numbers, block.nodes, strict=True)
        if n in inside
        for node in members
    }


def _check_existing(deck: Deck, line: DataLine, card: Card, existing: Set[int], numbers: list[int]) -> None:
    """Raise InputError for the first of `numbers` that is not in `existing`, the numbers of all nodes or elements."""
    missing = next((number for number in numbers if number not in existing), None)
    if missing is not None:
        what = "node" if card.keyword == "NSET" else "element"
        raise deck.line_error(line.number, f"{what} {missing} of set {card.options[card.keyword]} is not in the file")


def _set_by_name(deck: Deck, sets: dict[str, set[int]], card: Card, option: str) -> set[int]:
    """Return the members of the set whose name is the value of a card's `option`.

    `sets` has all sets so far; if it has none of this name, a new empty set is added and returned.
    """
    name = card.options[option]
    deck.set_spellings.setdefault(name.lower(), name)
    return sets.setdefault(name.lower(), set())


def _whole_number(deck: Deck, line: DataLine, text: str, what: str) -> int:
    """Return a text as a whole number.

    Raises InputError if the text is none; `what` is the description of what is allowed.
    """
    if not _is_label_number(text):
        raise deck.line_error(line.number, f"{what} is allowed, not {text!r}")
    return int(text)


def _is_label_number(text: str) -> bool:
    """Whether a text is a whole number that can be the number of a node or an element."""
    return text.isascii() and text.isdigit() and len(text) < MOST_DIGITS


def _refuse_options(deck: Deck, card: Card, allowed: set[str]) -> None:
    """Raise InputError for the first option of a card that is not among the `allowed` ones."""
    for name in card.options:
        if name and name not in allowed:
            raise deck.line_error(card.number, f"the option {name} of *{card.keyword} is not read")


READERS: Mapping[str, Callable[[Deck, Card], None]] = {"NODE": _read_nodes, "ELEMENT": _read_elements}

_IN_PLACE = "nodes and elements in the file itself, one by one, are allowed"
REFUSED: Mapping[str, str] = {
    "INCLUDE": "the lines of that file in its place are allowed",
    "SYSTEM": "nodes in the axes of the whole are allowed",
    **dict.fromkeys(("NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SUBSTRUCTURE PATH"), _IN_PLACE),
}
#: Keyword that gives nodes their own axes.  Then keywords by which coordinates of some nodes depend on coordinates of
#: other nodes; programs leave the dependent coordinates out of their matrices.
TURNED = "TRANSFORM"
CONSTRAINTS = (
    TURNED,
    *("EQUATION", "MPC", "TIE", "RIGID BODY", "COUPLING", "KINEMATIC", "DISTRIBUTING", "EMBEDDED ELEMENT"),
    *("KINEMATIC COUPLING", "DISTRIBUTING COUPLING", "SHELL TO SOLID COUPLING", "CYCLIC SYMMETRY MODEL"),
)
