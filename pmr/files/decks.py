"""Nodes, elements and sets of an input deck of Abaqus or CalculiX; content that can't be read is refused with its line.

Cards belong to the whole, to a part or to an instance of a part, each a `Deck` with numbers of its own.  An instance is
moved to its place and joined with the whole.  `READERS` has a function for each keyword that is read, and `REFUSED` has
the reasons why some others are refused.  Cards of further keywords are passed over; `FurtherCards.unread` lists all of
these but the `HARMLESS` ones, which describe no model.

The readers of others do not serve: meshio's and ccxmeshreader's know no files that are included and no instances, and
drop node sets; that of pyFormex has another licence; abaqus-parse writes decks and reads results.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from pmr.files.cards import Card, DataLine, Place, move_instance, read_axes, read_cards, read_numbers, rectangular
from pmr.files.deck_content import Deck, Elements, Numbers, read_sets, set_by_name, whole_number

#: Largest number of nodes of several instances together.
MOST_NODES = 500_000


@dataclass
class _Assembly:
    """Parts and instances of a deck that is being read, what stands outside of them, and the whole that they form."""

    source: str
    outside: Deck
    joined: Deck
    parts: dict[str, Deck] = field(default_factory=dict)
    instances: dict[str, Numbers] = field(default_factory=dict)  # by name; "" for what stands outside
    open: tuple[Card, Deck] | None = None  # an instance that is being read, and its content
    last: tuple[int, int] = (0, 0)  # largest numbers of nodes and elements of the whole

    def begin_part(self, card: Card) -> Deck:
        """Return the empty deck of the part that `card` begins; raise InputError for a second part of the same name."""
        name = card.options.get("NAME", "").lower()
        if name in self.parts:
            raise card.place.error(f"a second part {name} is not read; each name once is allowed")
        return self.parts.setdefault(name, Deck())

    def begin_instance(self, card: Card) -> Deck:
        """Return the deck of the instance that `card` begins: a copy of its part.

        The instance's own cards add to this deck.  Raises InputError for a missing or second name, for a part that was
        not read before, and for too many nodes.
        """
        card.allow_options("NAME PART")
        name, part = (card.options.get(key, "").lower() for key in ("NAME", "PART"))
        if not name or name in self.instances:
            raise card.place.error(f"instance {name} is not read; each name once is allowed")
        if part and part not in self.parts:
            raise card.place.error(f"PART={part} is no part that stands further up")
        content = self.parts[part].copy() if part else Deck()
        if self.instances and len(self.joined.nodes) + len(content.nodes) > MOST_NODES:
            raise card.place.error(f"instances that have {MOST_NODES} nodes together are allowed")
        self.open = card, content
        return content

    def end_instance(self) -> None:
        """Move the open instance to its place and join it with the whole; do nothing if no instance is open."""
        if self.open is None:
            return
        (card, content), self.open = self.open, None
        for number, place in zip(content.nodes, move_instance(card, [*content.nodes.values()]), strict=True):
            content.nodes[number] = place
        read_sets(content, {"": Numbers.of(content)})
        self._join(card.options["NAME"], content, card.place)

    def end(self) -> Deck:
        """Return the whole deck.

        Without instances, each part counts as one instance of itself that is not moved.  With exactly one instance, its
        sets have their own names only, not those with the instance's name in front, such as ``instance.set``.
        """
        self.end_instance()
        if not self.instances:
            for name, part in self.parts.items():
                self.open = Card(Place(self.source, 1), "INSTANCE", {"NAME": name}, ()), part
                self.end_instance()
        self._join("", self.outside, Place(self.source, 1))
        self.joined.sets = self.outside.sets
        read_sets(self.joined, self.instances)
        if len(self.instances) == 2:  # the sets of the only instance are those of the whole
            for sets in (self.joined.node_sets, self.joined.element_sets):
                for name in [f"{instance}.{of}" for instance in self.instances if instance for of in sets]:
                    sets.pop(name, None)
        return self.joined

    def _join(self, name: str, content: Deck, place: Place) -> None:
        """Add the `content` of the instance `name`, nodes, elements and sets, to the whole deck.

        Nodes and elements keep their numbers unless the whole has one of them already; `place` is that of the instance.
        """
        joined, numbers = self.joined, Numbers.of(content)
        if not joined.nodes.keys().isdisjoint(numbers.nodes):
            joined.further.renumbered = joined.further.renumbered or place
            numbers = replace(numbers, nodes={part: self.last[0] + k for k, part in enumerate(numbers.nodes, 1)})
        if not joined.element_numbers.isdisjoint(numbers.elements):
            numbers = replace(numbers, elements={part: self.last[1] + k for k, part in enumerate(numbers.elements, 1)})
        self.last = (
            max(self.last[0], max(numbers.nodes.values(), default=0)),
            max(self.last[1], max(numbers.elements.values(), default=0)),
        )
        joined.nodes |= {numbers.nodes[number]: point for number, point in content.nodes.items()}
        joined.element_numbers |= set(numbers.elements.values())
        for block in content.elements:
            for line, number, of in zip(block.lines, block.numbers, block.nodes, strict=True):
                if missing := [node for node in of if node not in numbers.nodes]:
                    raise line.error(f"element {number} has node {missing[0]}, which is not in the file")
            joined.elements.append(block.renumber(numbers.nodes, numbers.elements))
        for ours, theirs, new in (
            (joined.node_sets, content.node_sets, numbers.nodes),
            (joined.surfaces, content.surfaces, numbers.nodes),
            (joined.element_sets, content.element_sets, numbers.elements),
        ):
            for set_name, members in theirs.items():
                new_members = {new[number] for number in members}
                for key in {set_name, f"{name.lower()}.{set_name}" if name else set_name}:
                    ours.setdefault(key, set()).update(new_members)
        for set_name, spelling in content.set_spellings.items():
            joined.set_spellings.setdefault(set_name, spelling)
            joined.set_spellings.setdefault(f"{name.lower()}.{set_name}", f"{name}.{spelling}")
        self.instances[name.lower()] = numbers


def read_deck(path: Path) -> Deck:
    """Read nodes, elements and sets of an input deck of Abaqus or CalculiX; other cards are passed over.

    Raises InputError with file and line if a card can't be read, or if it has content that pmr does not support.
    """
    assembly = _Assembly(str(path), Deck(), Deck())
    deck = assembly.outside
    for card in read_cards(path):
        if card.keyword in REFUSED:
            raise card.place.error(f"*{card.keyword} is not read; {REFUSED[card.keyword]}")
        if card.keyword == TURNED and deck is assembly.outside:
            assembly.joined.further.turned.append(card)
        elif card.keyword in (*CONSTRAINTS, *CONTACTS):
            assembly.joined.further.constraints.append((card.place, card.keyword))
        if card.keyword == TIED:
            assembly.joined.further.ties.append(card)
        elif card.keyword == "EQUATION" and deck is assembly.outside:
            assembly.joined.further.equations.append(card)
        if card.keyword in ("PART", "INSTANCE", "END PART", "END INSTANCE", "ASSEMBLY", "END ASSEMBLY"):
            assembly.end_instance()
            begin = {"PART": assembly.begin_part, "INSTANCE": assembly.begin_instance}.get(card.keyword)
            deck = assembly.outside if begin is None else begin(card)
        elif card.keyword in ("NSET", "ELSET", "SURFACE"):
            deck.sets.append(card)
        elif card.keyword in READERS:
            READERS[card.keyword](deck, card)
        elif card.keyword not in (*CONSTRAINTS, *CONTACTS) and not HARMLESS.fullmatch(card.keyword):
            assembly.joined.further.unread.setdefault(card.keyword, card.place)
    return assembly.end()


def _read_system(deck: Deck, card: Card) -> None:
    """Set the axes in which `deck` has the coordinates of all following nodes, from a card `*SYSTEM`."""
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

_IN_PLACE = "nodes and elements in the file itself, one by one, are allowed"
REFUSED: Mapping[str, str] = {
    **dict.fromkeys(("NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SUBSTRUCTURE PATH"), _IN_PLACE),
}
#: Keyword that gives nodes their own axes.  Then keywords by which coordinates of some nodes depend on coordinates of
#: other nodes; programs leave the dependent coordinates out of their matrices.
TURNED, TIED = "TRANSFORM", "TIE"
CONSTRAINTS = (
    *(TURNED, TIED),
    *("EQUATION", "MPC", "RIGID BODY", "COUPLING", "KINEMATIC", "DISTRIBUTING", "EMBEDDED ELEMENT"),
    *("KINEMATIC COUPLING", "DISTRIBUTING COUPLING", "SHELL TO SOLID COUPLING", "CYCLIC SYMMETRY MODEL"),
    *("PRE-TENSION SECTION", "FASTENER", "NETWORK MPC", "RELEASE", "MODEL CHANGE"),
)
#: Keywords that press nodes on others; programs keep the coordinates of both in their matrices.
CONTACTS = ("CONTACT PAIR", "CONTACT", "CONTACT INCLUSIONS", "SLIDE LINE")
#: Keywords of texts, steps, output and tables that other cards name: they change no model.
HARMLESS = re.compile(
    r"(.+ )?(OUTPUT|PRINT|FILE|FORMAT|CONTROLS|FREQUENCY|DYNAMICS?|RESPONSE|EIGENMODES|MODES)|(MODAL|GLOBAL) DAMPING|"
    r"HEADING|PREPRINT|RESTART|MONITOR|FILTER|AMPLITUDE|TIME POINTS|PHYSICAL CONSTANTS|DISTRIBUTION( TABLE)?|MATERIAL|"
    r"ORIENTATION|NORMAL|SURFACE (INTERACTION|BEHAVIOR)|FRICTION|GAP CONDUCTANCE|RESPONSE SPECTRUM|"
    r"CONTACT (PROPERTY ASSIGNMENT|INITIALIZATION DATA)|(END )?(STEP|PART|INSTANCE|ASSEMBLY)|INCLUDE|STATIC|BUCKLE|"
    r"HEAT TRANSFER|(UN)?COUPLED TEMPERATURE-DISPLACEMENT|VISCO|GREEN|SENSITIVITY|SOLUTION TECHNIQUE|"
    r"(MATRIX|SUBSTRUCTURE) GENERATE|RETAINED NODAL DOFS|FLEXIBLE BODY|MASS ADJUST"
)
