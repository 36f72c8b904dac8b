"""Content of an input deck of Abaqus or CalculiX: its nodes and elements, and its sets and surfaces from their cards.

The cards of sets and surfaces are read when all nodes and elements are known, as members may stand anywhere.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from copy import copy, deepcopy
from dataclasses import dataclass, field

from pmr.files.cards import (
    Axes,
    Card,
    DataLine,
    Place,
    is_label_number,
    read_axes,
    read_numbers,
    rectangular,
    whole_number,
)

#: For each type of element, the kind of its cells in meshio's words.
KINDS: Mapping[str, str] = {
    **dict.fromkeys(("T2D2", "T2D2H", "T3D2", "T3D2H", "B21", "B21H", "B31", "B31H", "B31R", "B33"), "line"),
    **dict.fromkeys(("CPS3", "CPE3", "STRI3", "S3", "S3R", "S3RS", "R3D3", "M3D3"), "triangle"),
    **dict.fromkeys(("CPS4", "CPS4R", "CPE4", "CPE4R", "S4", "S4R", "S4RS", "S4RSW", "S4R5", "R3D4", "M3D4"), "quad"),
    **dict.fromkeys(("C3D4", "C3D4H"), "tetra"),
    **dict.fromkeys(("C3D8", "C3D8H", "C3D8I", "C3D8IH", "C3D8R", "C3D8RH"), "hexahedron"),
}
#: For each type of element with a node amid each edge, the kind of its cells.
QUADRATIC: Mapping[str, str] = {
    **dict.fromkeys(("S6", "STRI65"), "triangle"),
    **dict.fromkeys(("S8", "S8R", "S8R5"), "quad"),
    **dict.fromkeys(("C3D10", "C3D10H", "C3D10M", "C3D10MH"), "tetra"),
    **dict.fromkeys(("C3D20", "C3D20H", "C3D20R", "C3D20RH"), "hexahedron"),
}
#: Types of elements whose name has the number of their nodes.
COUNTED = re.compile(r"(?:[A-Z]*3D|CPS|CPE|CPEG|CAX|CGAX|SC|S)([1-9]\d?)[A-Z]*")
#: Number of corners of each kind, and the corners that its edges join, in the order of the nodes amid them.
CORNERS: Mapping[str, int] = {"line": 2, "triangle": 3, "quad": 4, "tetra": 4, "hexahedron": 8}
EDGES: Mapping[str, tuple[tuple[int, int], ...]] = {
    "line": (),
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "quad": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "tetra": ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    "hexahedron": (
        *((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6)),
        *((6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)),
    ),
}
_SOLID_FACES: Mapping[str, tuple[tuple[int, ...], ...]] = {
    "tetra": ((0, 1, 2), (0, 1, 3), (1, 2, 3), (0, 2, 3)),
    "hexahedron": ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 4, 5), (1, 2, 5, 6), (2, 3, 6, 7), (0, 3, 4, 7)),
}


@dataclass(frozen=True)
class Elements:
    """Elements of one card, all of one type.

    Each element has its number, its line and the numbers of its nodes.
    """

    type: str
    numbers: list[int]
    lines: list[Place]
    nodes: list[list[int]]

    @property
    def kind(self) -> str:
        """Kind of the elements' cells in meshio's words, such as ``hexahedron``; empty for a type that is not known."""
        return KINDS.get(self.type) or QUADRATIC.get(self.type, "")

    @property
    def node_count(self) -> int:
        """Number of nodes of an element.

        For a type that is not known it is the number in the type's name, such as 15 in C3D15, or 0 if there is none.
        """
        if not self.kind:
            named = COUNTED.fullmatch(self.type)
            return int(named[1]) if named else 0
        return CORNERS[self.kind] + (len(EDGES[self.kind]) if self.type in QUADRATIC else 0)

    def renumber(self, nodes: Mapping[int, int], elements: Mapping[int, int]) -> Elements:
        """Return these elements with new numbers, from `elements`, and with new numbers of their nodes, from `nodes`.

        Both map old numbers to new ones.
        """
        numbers = [elements[number] for number in self.numbers]
        return Elements(self.type, numbers, self.lines, [[nodes[node] for node in of] for of in self.nodes])

    def face_corners(self, face: str) -> tuple[int, ...]:
        """Return the local numbers, from 0, of an element's corners on a `face`, by the face's name: S1, E1, SPOS.

        A shell has the faces SPOS and SNEG, and the edges E1 (Abaqus) or S3 (CalculiX) and so on.  The result is empty
        if the element has no face of that name.
        """
        letter, number = face[:1], int(face[1:]) - 1 if face[1:].isdigit() else -1
        if self.kind in _SOLID_FACES:
            faces = _SOLID_FACES[self.kind]
            return faces[number] if letter == "S" and 0 <= number < len(faces) else ()
        if not self.type.startswith("S") or not self.kind:
            return ()
        if face in ("SPOS", "SNEG", "S1", "S2"):
            return tuple(range(CORNERS[self.kind]))
        number = number - 2 if letter == "S" else number
        return EDGES[self.kind][number] if letter in "SE" and 0 <= number < len(EDGES[self.kind]) else ()


@dataclass
class FurtherCards:
    """Cards of a whole deck that couple displacements or turn their axes, and cards that are not read."""

    constraints: list[tuple[Place, str]] = field(default_factory=list)  # place, keyword of cards in `CONSTRAINTS`
    turned: list[Card] = field(default_factory=list)  # cards that give nodes outside of parts axes of their own
    ties: list[Card] = field(default_factory=list)  # cards that tie two surfaces to each other
    equations: list[Card] = field(default_factory=list)  # cards of linear equations of displacements
    renumbered: Place | None = None  # the first instance whose nodes have other numbers than in its part
    unread: dict[str, Place] = field(default_factory=dict)  # first card of each keyword that is passed over


@dataclass
class Deck:
    """Content of a deck, a part or an instance: its mesh, and the cards that join, turn or name parts of it.

    The names of sets are in small letters, and sets contain only nodes or elements that exist.  In the deck of the
    whole file, a set of a part has the members of all instances of the part.  If there are several instances, the
    members of each are also in a set called ``instance.set``.
    """

    nodes: dict[int, tuple[float, float, float]] = field(default_factory=dict)  # m, by number, in the file's order
    elements: list[Elements] = field(default_factory=list)
    element_numbers: set[int] = field(default_factory=set)  # of all elements
    node_sets: dict[str, set[int]] = field(default_factory=dict)  # numbers of nodes, by name of the set
    element_sets: dict[str, set[int]] = field(default_factory=dict)  # numbers of elements, by name of the set
    surfaces: dict[str, set[int]] = field(default_factory=dict)  # nodes on each surface
    set_spellings: dict[str, str] = field(default_factory=dict)  # names of sets and surfaces as first written
    axes: Axes | None = None  # of the coordinates of nodes that follow; None for those of the whole
    sets: list[Card] = field(default_factory=list)  # cards of sets, read last as members may stand anywhere
    further: FurtherCards = field(default_factory=FurtherCards)

    def copy(self) -> Deck:
        """Return a copy of this deck, to which nodes, elements and sets can be added without a change of this deck.

        The copy has no `axes`: nodes that are read into it have coordinates along the axes of the whole, until a card
        `*SYSTEM` sets other ones.
        """
        sets = deepcopy({"node_sets": self.node_sets, "element_sets": self.element_sets})
        return Deck(**{name: copy(value) for name, value in vars(self).items()} | sets | {"axes": None})


@dataclass(frozen=True)
class Numbers:
    """Numbers that the nodes and elements of an instance have in the whole deck, by their numbers in the instance."""

    nodes: Mapping[int, int]
    elements: Mapping[int, int]

    @classmethod
    def of(cls, deck: Deck) -> Numbers:
        """Return the numbers of a `deck` that is not joined with others: each node and element keeps its number."""
        return cls({number: number for number in deck.nodes}, {number: number for number in deck.element_numbers})

    def of_kind(self, of_nodes: bool) -> Mapping[int, int]:
        """Return the numbers in the whole deck by the numbers in the instance.

        The numbers are those of nodes if `of_nodes`, else those of elements.
        """
        return self.nodes if of_nodes else self.elements


def read_sets(deck: Deck, instances: Mapping[str, Numbers]) -> None:
    """Add the members of all sets and surfaces to `deck`, from the deck's cards.

    `instances` has the numbers of nodes and elements of each instance, by the instance's name.  Sets are read in the
    order of their cards, then surfaces.  Raises InputError, with file and line, for members that do not exist or can't
    be read.
    """
    for card in deck.sets:
        if card.keyword != "SURFACE":
            _read_set(deck, card, instances)
    for card in deck.sets:
        if card.keyword == "SURFACE":
            _read_surface(deck, card, instances)


def _read_set(deck: Deck, card: Card, instances: Mapping[str, Numbers]) -> None:
    """Add the members of a set's card to the deck.

    The card lists them as numbers, as names of other sets, as a range (first, last, step), or as a set of elements
    whose nodes are the members.  ``instance.number``, or the option INSTANCE, names members of an instance; `instances`
    has the numbers of nodes and elements of each instance, by the instance's name.  Raises InputError for members that
    do not exist or can't be read.
    """
    of_nodes, instance = card.keyword == "NSET", card.options.get("INSTANCE", "").lower()
    card.allow_options("NSET ELSET GENERATE UNSORTED INTERNAL INSTANCE INPUT")
    if card.keyword not in card.options:
        raise card.place.error(f"*{card.keyword} with {card.keyword}=NAME is allowed")
    if instance not in instances:
        raise card.place.error(f"INSTANCE={card.options['INSTANCE']} is no instance of a part")
    sets, numbers = deck.node_sets if of_nodes else deck.element_sets, instances[instance].of_kind(of_nodes)
    members = set_by_name(deck, sets, card, card.keyword)
    if of_nodes and "ELSET" in card.options:
        members.update(_element_set_nodes(deck, card, instance))
    for line in card.lines:
        fields = [field for field in line.fields if field]
        if "GENERATE" in card.options:
            members.update(_read_range(line, card, fields, numbers, of_nodes))
            continue
        for name in fields:
            members.update(_named_members(deck, line, card, name, instances, of_nodes, instance))


def _named_members(
    deck: Deck,
    line: DataLine,
    card: Card,
    name: str,
    instances: Mapping[str, Numbers],
    of_nodes: bool,
    instance: str = "",
) -> set[int]:
    """Return the numbers of the nodes or elements that a line of a card names by a number or by a set.

    `name` is the number or the name of the set, of an `instance` if this is not empty.  `deck` has the sets, and
    `instances` the numbers of nodes and elements of each instance by its name.  Nodes are meant if `of_nodes`, else
    elements.  Raises InputError for a number that does not exist and for a set that was not read before.
    """
    sets = deck.node_sets if of_nodes else deck.element_sets
    within, _, text = name.lower().rpartition(".")
    if instance or within not in instances:
        within, text = instance, name.lower()
    if is_label_number(text):
        labels = instances[within].of_kind(of_nodes)
        _check_existing(line, card, labels, [int(text)], of_nodes)
        return {labels[int(text)]}
    if (key := f"{within}.{text}" if within else text) in sets:
        return sets[key]
    raise line.place.error(f"{name!r} is neither a number nor a set that stands further up")


def _read_surface(deck: Deck, card: Card, instances: Mapping[str, Numbers]) -> None:
    """Add to the deck the nodes on the surface of a card: listed nodes (TYPE=NODE), or those on faces or edges.

    Left out are analytical surfaces, combined surfaces and surfaces of whole bodies.  `instances` are the numbers that
    nodes and elements of instances have in the deck, by the instance's name.  Raises the errors of `_named_members`.
    """
    name, kind = card.options.get("NAME", ""), card.options.get("TYPE", "ELEMENT").upper()
    if kind not in ("NODE", "ELEMENT") or not card.lines or not name or "COMBINE" in card.options:
        return
    nodes = set[int]()
    for line in card.lines:
        label, face = [*line.fields, ""][:2]
        if not label:
            return
        members = _named_members(deck, line, card, label, instances, kind == "NODE")
        if kind == "ELEMENT":
            inside, members = members, set()
            for block in deck.elements:
                numbers = [k for k, number in enumerate(block.numbers) if number in inside]
                corners = block.face_corners(face.upper())
                if numbers and not corners:
                    return
                members |= {block.nodes[k][corner] for k in numbers for corner in corners}
        nodes |= members
    deck.set_spellings.setdefault(name.lower(), name)
    deck.surfaces.setdefault(name.lower(), set()).update(nodes)


def _read_range(line: DataLine, card: Card, fields: list[str], numbers: Mapping[int, int], of_nodes: bool) -> list[int]:
    """Return the members of a set that a line of its card gives as a range, by their numbers in the whole deck.

    `fields` are the range's first number, last number and step; the step is 1 if it is missing.  They are numbers as
    the card uses them.  `numbers` maps such numbers of all nodes or elements to their numbers in the whole deck.
    Numbers between the ends that do not exist are left out.

    Raises InputError for other fields, and for ends that do not exist.  `of_nodes` says whether messages name nodes or
    elements.
    """
    bounds = [whole_number(line, field, "first, last and step") for field in fields]
    if len(bounds) not in (2, 3) or bounds[2:] == [0]:
        raise line.place.error("first, last and step as whole numbers are allowed")
    first, last, step = [*bounds, 1][:3]
    steps = range(first, last + 1, step)
    _check_existing(line, card, numbers, [*steps[:1], *steps[-1:]], of_nodes)
    return [number for label, number in numbers.items() if label in steps]


def _element_set_nodes(deck: Deck, card: Card, instance: str) -> set[int]:
    """Return the numbers of the nodes of all elements in the element set that the card's option ELSET names.

    The set belongs to the `instance` if this is not empty.  Raises InputError if no such set was read before.
    """
    name = f"{instance}." * bool(instance) + card.options["ELSET"].lower()
    if name not in deck.element_sets:
        raise card.place.error(f"ELSET={card.options['ELSET']} is no set of elements that stands further up")
    inside = deck.element_sets[name]
    return {
        node
        for block in deck.elements
        for n, members in zip(block.numbers, block.nodes, strict=True)
        if n in inside
        for node in members
    }


def _check_existing(
    line: DataLine, card: Card, existing: Mapping[int, int], numbers: list[int], of_nodes: bool
) -> None:
    """Raise InputError for the first of `numbers` that is not in `existing`, the numbers of all nodes or elements.

    `of_nodes` says whether the message names a node or an element; the error has the place of the `line` of `card`.
    """
    missing = next((number for number in numbers if number not in existing), None)
    if missing is not None:
        of = f"set {card.options[card.keyword]}" if card.keyword in card.options else card.options["NAME"]
        raise line.place.error(f"{'node' if of_nodes else 'element'} {missing} of {of} is not in the file")


def set_by_name(deck: Deck, sets: dict[str, set[int]], card: Card, option: str) -> set[int]:
    """Return the set of `sets` whose name is the value of a card's `option`; a new empty one is added if there is none.

    `sets` has the members of all sets so far by name.  The deck stores how the name is spelled.
    """
    name = card.options[option]
    deck.set_spellings.setdefault(name.lower(), name)
    return sets.setdefault(name.lower(), set())


def _read_system(deck: Deck, card: Card) -> None:
    """Set the axes in which `deck` has the coordinates of all following nodes, from a card `*SYSTEM`.

    Raises InputError for a card with options, and in the cases of `read_axes`.
    """
    card.allow_options("")
    deck.axes = read_axes(card)


def _read_nodes(deck: Deck, card: Card) -> None:
    """Add the nodes on a card to the deck.

    Coordinates that are missing are 0; numbers after the third coordinate are left out.  Raises InputError with file
    and line for a line that can't be read, and for a node that is there already.
    """
    card.allow_options("NSET SYSTEM INPUT")
    numbers = list[int]()
    for line in card.lines:
        number, *place = line.fields
        node = whole_number(line, number, "the whole number of a node")
        if node in deck.nodes:
            raise line.place.error(f"node {node} is there a second time; each number once is allowed")
        what = f"coordinates of node {node} that are numbers are"  # further numbers are normals of shells
        coordinates = read_numbers(DataLine(line.place, tuple(place[:3])), 3, what)
        x, y, z = rectangular(card, deck.axes, [*coordinates, 0.0, 0.0, 0.0][:3])
        deck.nodes[node] = (x, y, z)
        numbers.append(node)
    if "NSET" in card.options:
        set_by_name(deck, deck.node_sets, card, "NSET").update(numbers)


def _read_elements(deck: Deck, card: Card) -> None:
    """Add the elements on a card to the deck; raise InputError, with file and line, for one that can't be read.

    An element may go on over several lines.  Elements of a type that pmr does not know are added too.
    """
    card.allow_options("TYPE ELSET INPUT")
    block = Elements(card.options.get("TYPE", "").upper(), [], [], [])
    count, parts, begun = block.node_count, list[int](), card.place
    for line in card.lines:
        begun = begun if parts else line.place
        parts.extend(whole_number(line, field, "a whole number") for field in line.fields if field)
        if len(parts) < 1 + count if count else not line.fields[-1] and line is not card.lines[-1]:
            continue  # the element goes on in the next line
        if parts[0] in deck.element_numbers:
            raise begun.error(f"element {parts[0]} is there a second time; each number once is allowed")
        deck.element_numbers.add(parts[0])
        if count and len(parts) != 1 + count:
            raise begun.error(f"the number of an element and {count} nodes are allowed for {block.type}")
        block.numbers.append(parts[0])
        block.lines.append(begun)
        block.nodes.append([node for node in parts[1:] if node or block.kind])  # a network of fluids may end at node 0
        parts = []
    if parts:
        raise begun.error(f"element {parts[0]} of type {block.type} has too few nodes")
    deck.elements.append(block)
    if "ELSET" in card.options:
        set_by_name(deck, deck.element_sets, card, "ELSET").update(block.numbers)


READERS: Mapping[str, Callable[[Deck, Card], None]] = {
    "NODE": _read_nodes,
    "ELEMENT": _read_elements,
    "SYSTEM": _read_system,
}
