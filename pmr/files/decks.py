"""Nodes, elements and sets of an input deck of Abaqus or CalculiX; content that can't be read is refused with its line.

Cards belong to the whole, to a part or to an instance of a part, each a `Deck` with numbers of its own.  An instance is
moved to its place and joined with the whole.  `READERS` has a function for each keyword that is read, and `REFUSED` has
the reasons why some others are refused.  All further keywords do not concern nodes and elements and are ignored.

The readers of others do not serve: meshio's and ccxmeshreader's know no files that are included and no instances, and
drop node sets; that of pyFormex has another licence; abaqus-parse writes decks and reads results.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from pmr.files.cards import Axes, Card, DataLine, Place, move_instance, read_axes, read_cards, rectangular

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
#: Largest number of nodes of several instances together.
MOST_NODES = 500_000


@dataclass(frozen=True)
class Elements:
    """Elements of one card: their type, and three entries for each element.

    These are its number, its line and the numbers of its nodes.
    """

    type: str
    numbers: list[int]
    lines: list[Place]
    nodes: list[list[int]]

    def renumber(self, nodes: Mapping[int, int], elements: Mapping[int, int]) -> Elements:
        """Return these elements with the numbers that `nodes` and `elements` have for theirs."""
        numbers = [elements[number] for number in self.numbers]
        return Elements(self.type, numbers, self.lines, [[nodes[node] for node in of] for of in self.nodes])


@dataclass
class Deck:
    """Content of a deck, a part or an instance.

    The names of sets are in small letters, and sets contain only nodes or elements that exist.  In the whole, sets of a
    part are joined over its instances, and if there are several the set of each is ``instance.set``.
    """

    nodes: dict[int, tuple[float, float, float]] = field(default_factory=dict)  # m, by number, in the file's order
    elements: list[Elements] = field(default_factory=list)
    element_numbers: set[int] = field(default_factory=set)
    node_sets: dict[str, set[int]] = field(default_factory=dict)
    element_sets: dict[str, set[int]] = field(default_factory=dict)
    set_spellings: dict[str, str] = field(default_factory=dict)  # names of sets as first written
    constraints: list[tuple[Place, str]] = field(default_factory=list)  # place, keyword of cards in `CONSTRAINTS`
    turned: list[Card] = field(default_factory=list)  # cards that give nodes outside of parts axes of their own
    axes: Axes | None = None  # of the coordinates of nodes that follow; None for those of the whole
    sets: list[Card] = field(default_factory=list)  # cards of sets, read last as members may stand anywhere
    renumbered: Place | None = None  # the first instance whose nodes have other numbers than in its part

    def copy(self) -> Deck:
        """Return a deck to which nodes, elements and sets can be added without a change of this one."""
        return Deck(
            nodes=dict(self.nodes),
            elements=list(self.elements),
            element_numbers=set(self.element_numbers),
            node_sets={name: set(members) for name, members in self.node_sets.items()},
            element_sets={name: set(members) for name, members in self.element_sets.items()},
            set_spellings=dict(self.set_spellings),
            sets=list(self.sets),
        )


@dataclass(frozen=True)
class _Numbers:
    """Numbers in the whole of the nodes and elements of an instance, by their numbers in it."""

    nodes: Mapping[int, int]
    elements: Mapping[int, int]

    @classmethod
    def of(cls, deck: Deck) -> _Numbers:
        """Return the numbers of a deck that is not joined with others."""
        return cls({number: number for number in deck.nodes}, {number: number for number in deck.element_numbers})

    def of_kind(self, of_nodes: bool) -> Mapping[int, int]:
        """Return the numbers of nodes, or those of elements."""
        return self.nodes if of_nodes else self.elements


@dataclass
class _Assembly:
    """Parts and instances of a deck, what stands outside of them, and the whole that they are joined to."""

    source: str
    outside: Deck
    whole: Deck
    parts: dict[str, Deck] = field(default_factory=dict)
    instances: dict[str, _Numbers] = field(default_factory=dict)  # by name; "" for what stands outside
    open: tuple[Card, Deck] | None = None  # an instance that is being read, and its content
    last: tuple[int, int] = (0, 0)  # largest numbers of nodes and elements of the whole

    def begin_part(self, card: Card) -> Deck:
        """Return the empty deck of a part; InputError for a second part of the same name."""
        name = card.options.get("NAME", "").lower()
        if name in self.parts:
            raise card.place.error(f"a second part {name} is not read; each name once is allowed")
        return self.parts.setdefault(name, Deck())

    def begin_instance(self, card: Card) -> Deck:
        """Return the content of an instance: a copy of its part, to which cards within the instance are added.

        Raises InputError for a missing or second name, for a part that was not read before, and for too many nodes.
        """
        card.allow_options("NAME PART")
        name, part = (card.options.get(key, "").lower() for key in ("NAME", "PART"))
        if not name or name in self.instances:
            raise card.place.error(f"instance {name} is not read; each name once is allowed")
        if part and part not in self.parts:
            raise card.place.error(f"PART={part} is no part that stands further up")
        content = self.parts[part].copy() if part else Deck()
        if self.instances and len(self.whole.nodes) + len(content.nodes) > MOST_NODES:
            raise card.place.error(f"instances that have {MOST_NODES} nodes together are allowed")
        self.open = card, content
        return content

    def end_instance(self) -> None:
        """Move the instance that is open to its place and join it with the whole."""
        if self.open is None:
            return
        (card, content), self.open = self.open, None
        for number, place in zip(content.nodes, move_instance(card, [*content.nodes.values()]), strict=True):
            content.nodes[number] = place
        _read_sets(content, {"": _Numbers.of(content)})
        self._join(card.options["NAME"], content, card.place)

    def end(self) -> Deck:
        """Return the whole; parts of a deck without instances are in place.

        The sets of an only instance have no second names with the instance's name in front.
        """
        self.end_instance()
        if not self.instances:
            for name, part in self.parts.items():
                self.open = Card(Place(self.source, 1), "INSTANCE", {"NAME": name}, ()), part
                self.end_instance()
        self._join("", self.outside, Place(self.source, 1))
        self.whole.sets = self.outside.sets
        _read_sets(self.whole, self.instances)
        if len(self.instances) == 2:  # the sets of the only instance are those of the whole
            for sets in (self.whole.node_sets, self.whole.element_sets):
                for name in [f"{instance}.{of}" for instance in self.instances if instance for of in sets]:
                    sets.pop(name, None)
        return self.whole

    def _join(self, name: str, content: Deck, place: Place) -> None:
        """Add nodes, elements and sets of the instance `name` to the whole.

        Nodes and elements keep their numbers unless the whole has one of them already; `place` is that of the instance.
        """
        whole, numbers = self.whole, _Numbers.of(content)
        if not whole.nodes.keys().isdisjoint(numbers.nodes):
            whole.renumbered = whole.renumbered or place
            numbers = replace(numbers, nodes={part: self.last[0] + k for k, part in enumerate(numbers.nodes, 1)})
        if not whole.element_numbers.isdisjoint(numbers.elements):
            numbers = replace(numbers, elements={part: self.last[1] + k for k, part in enumerate(numbers.elements, 1)})
        self.last = (
            max(self.last[0], max(numbers.nodes.values(), default=0)),
            max(self.last[1], max(numbers.elements.values(), default=0)),
        )
        whole.nodes |= {numbers.nodes[number]: point for number, point in content.nodes.items()}
        whole.element_numbers |= set(numbers.elements.values())
        for block in content.elements:
            for line, number, of in zip(block.lines, block.numbers, block.nodes, strict=True):
                if missing := [node for node in of if node not in numbers.nodes]:
                    raise line.error(f"element {number} has node {missing[0]}, which is not in the file")
            whole.elements.append(block.renumber(numbers.nodes, numbers.elements))
        for ours, theirs, new in (
            (whole.node_sets, content.node_sets, numbers.nodes),
            (whole.element_sets, content.element_sets, numbers.elements),
        ):
            for set_name, members in theirs.items():
                members_of_whole = {new[number] for number in members}
                for key in {set_name, f"{name.lower()}.{set_name}" if name else set_name}:
                    ours.setdefault(key, set()).update(members_of_whole)
        for set_name, spelling in content.set_spellings.items():
            whole.set_spellings.setdefault(set_name, spelling)
            whole.set_spellings.setdefault(f"{name.lower()}.{set_name}", f"{name}.{spelling}")
        self.instances[name.lower()] = numbers


def read_deck(path: Path) -> Deck:
    """Read nodes, elements and sets of an input deck of Abaqus or CalculiX; other cards are ignored.

    Raises InputError with file and line if a card can't be read, or if it has content that pmr does not support.
    """
    assembly = _Assembly(str(path), Deck(), Deck())
    deck = assembly.outside
    for card in read_cards(path):
        if card.keyword in REFUSED:
            raise card.place.error(f"*{card.keyword} is not read; {REFUSED[card.keyword]}")
        if card.keyword == TURNED and deck is assembly.outside:
            assembly.whole.turned.append(card)
        elif card.keyword in CONSTRAINTS:
            assembly.whole.constraints.append((card.place, card.keyword))
        if card.keyword in ("PART", "INSTANCE", "END PART", "END INSTANCE", "ASSEMBLY", "END ASSEMBLY"):
            assembly.end_instance()
            begin = {"PART": assembly.begin_part, "INSTANCE": assembly.begin_instance}.get(card.keyword)
            deck = assembly.outside if begin is None else begin(card)
        elif card.keyword in ("NSET", "ELSET"):
            deck.sets.append(card)
        elif card.keyword in READERS:
            READERS[card.keyword](deck, card)
    return assembly.end()


def _read_system(deck: Deck, card: Card) -> None:
    """Set the axes in which the coordinates of the nodes that follow are given."""
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
        number, *place = (field for field in line.fields)
        while place and not place[-1]:
            place.pop()
        if len(place) > 3 and any(place[3:]):
            place = place[:3]  # the numbers that follow are normals of shells
        node = _whole_number(line, number, "the whole number of a node")
        if node in deck.nodes:
            raise line.place.error(f"node {node} is there a second time; each number once is allowed")
        try:
            coordinates = [float(field.upper().replace("D", "E") or "0") for field in [*place, "0", "0", "0"][:3]]
        except ValueError:
            raise line.place.error(f"coordinates of node {node} that are numbers are allowed") from None
        x, y, z = rectangular(card, deck.axes, coordinates)
        deck.nodes[node] = (x, y, z)
        numbers.append(node)
    if "NSET" in card.options:
        _set_by_name(deck, deck.node_sets, card, "NSET").update(numbers)


def _read_elements(deck: Deck, card: Card) -> None:
    """Add the elements on a card to the deck; InputError with file and line for an element that can't be read.

    An element may go on over several lines.  Elements of a type that pmr does not know are added too.
    """
    card.allow_options("TYPE ELSET INPUT")
    block = Elements(card.options.get("TYPE", "").upper(), [], [], [])
    count, parts, begun = CORNERS.get(KINDS.get(block.type, "")), list[int](), card.place
    for line in card.lines:
        begun = begun if parts else line.place
        parts.extend(_whole_number(line, field, "a whole number") for field in line.fields if field)
        if len(parts) < 1 + count if count else not line.fields[-1]:
            continue  # the element goes on in the next line
        if parts[0] in deck.element_numbers:
            raise begun.error(f"element {parts[0]} is there a second time; each number once is allowed")
        deck.element_numbers.add(parts[0])
        if count and len(parts) != 1 + count:
            raise begun.error(f"the number of an element and {count} nodes are allowed for {block.type}")
        block.numbers.append(parts[0])
        block.lines.append(begun)
        block.nodes.append(parts[1:])
        parts = []
    if parts:
        raise begun.error(f"element {parts[0]} of type {block.type} has too few nodes")
    deck.elements.append(block)
    if "ELSET" in card.options:
        _set_by_name(deck, deck.element_sets, card, "ELSET").update(block.numbers)


def _read_sets(deck: Deck, instances: Mapping[str, _Numbers]) -> None:
    """Add the members of all cards of sets, in their order; `instances` has the numbers of instances, by name."""
    for card in deck.sets:
        _read_set(deck, card, instances)


def _read_set(deck: Deck, card: Card, instances: Mapping[str, _Numbers]) -> None:
    """Add the members of a set's card to the deck.

    The card lists them as numbers, as names of other sets, as a range (first, last, step), or as a set of elements
    whose nodes are the members.  ``instance.number``, or the option INSTANCE, names those of an instance.
    """
    of_nodes, instance = card.keyword == "NSET", card.options.get("INSTANCE", "").lower()
    card.allow_options("NSET ELSET GENERATE UNSORTED INTERNAL INSTANCE INPUT")
    if card.keyword not in card.options:
        raise card.place.error(f"*{card.keyword} with {card.keyword}=NAME is allowed")
    if instance not in instances:
        raise card.place.error(f"INSTANCE={card.options['INSTANCE']} is no instance of a part")
    sets, numbers = deck.node_sets if of_nodes else deck.element_sets, instances[instance].of_kind(of_nodes)
    members = _set_by_name(deck, sets, card, card.keyword)
    if of_nodes and "ELSET" in card.options:
        members.update(_element_set_nodes(deck, card, instance))
    for line in card.lines:
        fields = [field for field in line.fields if field]
        if "GENERATE" in card.options:
            members.update(_read_range(line, card, fields, numbers))
            continue
        for name in fields:
            within, _, text = name.lower().rpartition(".")
            if instance or within not in instances:
                within, text = instance, name.lower()
            if _is_label_number(text):
                labels = instances[within].of_kind(of_nodes)
                _check_existing(line, card, labels, [int(text)])
                members.add(labels[int(text)])
            elif (key := f"{within}.{text}" if within else text) in sets:
                members.update(sets[key])
            else:
                raise line.place.error(f"{name!r} is neither a number nor a set that stands further up")


def _read_range(line: DataLine, card: Card, fields: list[str], numbers: Mapping[int, int]) -> list[int]:
    """Return those of `numbers` that are in the range of a line of a set's card.

    `fields` are its first, last and step, 1 if there is none.  Numbers between the ends that do not exist are left out.
    Raises InputError for other fields, and for ends that do not exist.
    """
    bounds = [_whole_number(line, field, "first, last and step") for field in fields]
    if len(bounds) not in (2, 3) or bounds[2:] == [0]:
        raise line.place.error("first, last and step as whole numbers are allowed")
    first, last, step = [*bounds, 1][:3]
    steps = range(first, last + 1, step)
    _check_existing(line, card, numbers, [*steps[:1], *steps[-1:]])
    return [number for label, number in numbers.items() if label in steps]


def _element_set_nodes(deck: Deck, card: Card, instance: str) -> set[int]:
    """Return the nodes of all elements in the element set that the card names, of an instance if one is named.

    Raises InputError if no such set was read before.
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


def _check_existing(line: DataLine, card: Card, existing: Mapping[int, int], numbers: list[int]) -> None:
    """Raise InputError for the first of `numbers` that is not in `existing`, the numbers of all nodes or elements."""
    missing = next((number for number in numbers if number not in existing), None)
    if missing is not None:
        what = "node" if card.keyword == "NSET" else "element"
        raise line.place.error(f"{what} {missing} of set {card.options[card.keyword]} is not in the file")


def _set_by_name(deck: Deck, sets: dict[str, set[int]], card: Card, option: str) -> set[int]:
    """Return the members of the set whose name is the value of a card's `option`.

    `sets` has all sets so far; if it has none of this name, a new empty set is added and returned.
    """
    name = card.options[option]
    deck.set_spellings.setdefault(name.lower(), name)
    return sets.setdefault(name.lower(), set())


def _whole_number(line: DataLine, text: str, what: str) -> int:
    """Return a text as a whole number.

    Raises InputError if the text is none; `what` is the description of what is allowed.
    """
    if not _is_label_number(text):
        raise line.place.error(f"{what} is allowed, not {text!r}")
    return int(text)


def _is_label_number(text: str) -> bool:
    """Whether a text is a whole number that can be the number of a node or an element."""
    return text.isascii() and text.isdigit() and len(text) < MOST_DIGITS


READERS: Mapping[str, Callable[[Deck, Card], None]] = {
    "NODE": _read_nodes,
    "ELEMENT": _read_elements,
    "SYSTEM": _read_system,
}

_IN_PLACE = "nodes and elements in the file itself, one by one, are allowed"
REFUSED: Mapping[str, str] = {
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
