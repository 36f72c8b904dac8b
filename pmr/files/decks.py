"""Nodes of another program's model, from a deck of Abaqus or CalculiX, a table, or bulk data of Nastran.

Of a deck, nodes, elements and sets are read; content that can't be read is refused with its line.

Cards belong to the whole, to a part or to an instance of a part, each a `Deck` with numbers of its own.  An instance is
moved to its place and joined with the whole.  `READERS` has a function for each keyword that is read, and `REFUSED` has
the reasons why some others are refused.  Cards of further keywords are passed over; `FurtherCards.unread` lists all of
these but the `HARMLESS` ones, which describe no model.

The readers of others do not serve: meshio's and ccxmeshreader's know no files that are included and no instances, and
drop node sets; that of pyFormex has another licence; abaqus-parse writes decks and reads results.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from pmr.files.arrays import Array, Indices
from pmr.files.cards import Card, Place, is_label_number, move_instance, read_cards, turned_axes
from pmr.files.deck_content import READERS, Deck, Numbers, read_sets
from pmr.files.labelled import UnreadableError, read_by_suffix
from pmr.files.nastran import read_bulk

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
            raise card.place.error(f"a part {name} was defined before; each name is allowed once")
        return self.parts.setdefault(name, Deck())

    def begin_instance(self, card: Card) -> Deck:
        """Return the deck of the instance that `card` begins: a copy of its part.

        The instance's own cards add to this deck.  Raises InputError for a missing or second name, for a part that was
        not read before, and for too many nodes.
        """
        card.allow_options("NAME PART")
        name, part = (card.options.get(key, "").lower() for key in ("NAME", "PART"))
        if not name or name in self.instances:
            raise card.place.error("each instance needs a name of its own")
        if part and part not in self.parts:
            raise card.place.error(f"PART={part} is no part that stands further up")
        content = self.parts[part].copy() if part else Deck()
        if self.instances and len(self.joined.nodes) + len(content.nodes) > MOST_NODES:
            raise card.place.error(f"instances that have {MOST_NODES} nodes together are allowed")
        self.open = card, content
        return content

    def end_instance(self) -> None:
        """Move the open instance to its place and join it with the whole; do nothing if no instance is open.

        Raises InputError, with file and line, for a place, a set or an element that can't be read.
        """
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
        sets have their own names only, not those with the instance's name in front, such as ``instance.set``.  Raises
        the errors of `end_instance`.
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

        If the whole deck has a node with the number of one of these nodes, all nodes of the instance get new numbers;
        else they keep theirs.  The same holds for elements.  The members of a set are added to the set of this name,
        which has those of all instances, and to the set "instance.set".

        `place` is the place of the instance in its file.  It is stored for the first instance whose nodes get new
        numbers.  Raises InputError, with file and line, if an element has a node that `content` lacks.
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


#: Suffixes of files with bulk data of Nastran.
NASTRAN_SUFFIXES = (".bdf", ".pch", ".dat", ".nas")


@dataclass(frozen=True)
class ForeignNodes:
    """Nodes of a model: their N numbers (N,), points (N, 3) in m and groups, and cards that constrain coordinates."""

    numbers: Indices
    points: Array
    groups: dict[str, Indices]  # numbers of the nodes in each group, by its name
    constraints: Sequence[tuple[Place, str]] = ()  # place and keyword of each card that constrains coordinates
    axes: Mapping[int, Array] = field(default_factory=dict)  # (3, 3): axes of coordinates as rows, by node with its own
    turned: Place | None = None  # card of axes in which the matrices may be, or not
    #: node and direction (from 1) of displacements that depend on others by a card, by its place
    dependent: Mapping[Place, set[tuple[int, int]]] = field(default_factory=dict)
    condensed: bool = False  # whether nodes without rows are condensed, not held

    def only(self, numbers: Indices) -> ForeignNodes:
        """Return only those nodes that have one of the `numbers` (k,), such as boundary nodes of a superelement.

        Groups without any of these nodes are left out.
        """
        at = np.isin(self.numbers, numbers)
        groups = {name: members[np.isin(members, numbers)] for name, members in self.groups.items()}
        groups = {name: members for name, members in groups.items() if len(members)}
        return replace(self, numbers=self.numbers[at], points=self.points[at], groups=groups)

    def without_dependent(self, pairs: Indices) -> ForeignNodes:
        """Return the nodes without dependent nodes, and without the cards that tie only these to other nodes.

        `pairs` (n, 2) are the node and the direction (from 1) of each row of the matrices.  A node is dependent if all
        of its displacements depend on other nodes, and if the matrices have no row of it.
        """
        depending = set[tuple[int, int]]().union(*self.dependent.values())
        nodes = {node for node, _ in depending if {(node, 1), (node, 2), (node, 3)} <= depending} - {
            *pairs[:, 0].tolist()
        }
        if not nodes:
            return self
        explained = {
            place for place, coordinates in self.dependent.items() if {node for node, _ in coordinates} <= nodes
        }
        constraints = [(place, keyword) for place, keyword in self.constraints if place not in explained]
        return replace(self.only(np.setdiff1d(self.numbers, [*nodes])), constraints=constraints)


def check_constraints(nodes: ForeignNodes, pairs: Indices) -> None:
    """Raise InputError for the first card that the matrices do not allow.

    These cards are refused:

    - A card that gives nodes axes of their own.
    - A rigid element of Nastran, if a displacement that it makes dependent has a row in the matrices.
    - Any card that ties displacements, if some displacement of a node has no row in the matrices, as pmr takes such a
      displacement as fixed.

    `pairs` (n, 2) are the node and the direction (from 1) of each row.
    """
    missing = 3 * len(nodes.numbers) - int(np.isin(pairs[:, 1], (1, 2, 3)).sum())
    for place, keyword in nodes.constraints:
        if keyword == TURNED:
            allowed = (
                "rows along the axes of the whole are allowed: *TRANSFORM gives nodes axes of their own; matrices "
                "written without it are allowed"
            )
            raise place.error(allowed)
        is_nastran = Path(place.source).suffix.lower() in NASTRAN_SUFFIXES
        is_rigid = is_nastran and keyword != "MPC"  # of several sets of MPC a run takes one
        with_rows = nodes.dependent.get(place, set()) & {(node, d) for node, d in pairs.tolist()} if is_rigid else set()
        if with_rows:
            node, direction = min(with_rows)
            allowed = (
                f"matrices are allowed that {keyword} is part of: it makes direction {direction} of grid point {node} "
                "depend on others, and the matrices have a row of it"
            )
            raise place.error(allowed)
        if missing > 0:
            star = "" if is_nastran else "*"
            allowed = (
                f"a model is allowed in which {star}{keyword} ties no coordinates to others: {missing} displacements "
                "have no row in the matrices, which pmr takes as fixed"
            )
            raise place.error(allowed)


def _make_nodes(numbers: list[int], points: Sequence[Sequence[float]], groups: dict[str, list[int]]) -> ForeignNodes:
    """Return nodes from their `numbers`, their `points` (x, y, z) in m, and the numbers of the nodes in `groups`.

    Groups without members are left out.  Raises UnreadableError if there are no nodes.
    """
    if not numbers:
        raise UnreadableError("nodes are allowed: this file has none")
    sets_of_nodes = {name: np.unique(np.array(members, dtype=np.int64)) for name, members in groups.items() if members}
    return ForeignNodes(np.array(numbers, dtype=np.int64), np.array(points), sets_of_nodes)


def _read_csv_nodes(path: Path) -> ForeignNodes:
    """Read nodes and groups from a CSV file; its first line is skipped.

    Each line has node, x, y, z in m and the names of the groups that the node belongs to.  A node may have several
    lines, which have to agree on its place.  Raises UnreadableError with the number of a line of another form.
    """
    points, groups = dict[int, list[float]](), dict[str, list[int]]()
    for at, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), 1):
        number, *parts = (part.strip() for part in line.split(","))
        if at == 1 or not line.strip():
            continue
        try:
            place = [float(part) for part in parts[:3]]
        except ValueError:
            place = []
        if len(place) != 3 or not is_label_number(number):
            raise UnreadableError("node, x, y, z and names of groups are allowed", at)
        if points.setdefault(int(number), place) != place:
            raise UnreadableError(f"one place of each node is allowed: node {number} has another one further up", at)
        for name in filter(None, parts[3:]):
            groups.setdefault(name, []).append(int(number))
    return _make_nodes(list(points), [*points.values()], groups)


def dependent_displacements(deck: Deck) -> dict[Place, set[tuple[int, int]]]:
    """Return the dependent displacements of each card of ties or equations, by the card's place.

    Each displacement is a pair of node and direction, from 1.  The displacements are those of a tie's first surface,
    and the first one of each equation.  Cards that name sets of nodes, or surfaces that are not read, are left out.
    """
    dependent = dict[Place, set[tuple[int, int]]]()
    for card in deck.further.ties:
        surfaces = [deck.surfaces.get(line.fields[0].lower(), set()) for line in card.lines]
        if all(surfaces):
            dependent[card.place] = {(node, d) for nodes in surfaces for node in nodes for d in (1, 2, 3)}
    for card in deck.further.equations:
        fields, pairs = [field for line in card.lines for field in line.fields if field], set[tuple[int, int]]()
        while len(fields) > 2 and all(is_label_number(field) for field in fields[:3]):
            pairs.add((int(fields[1]), int(fields[2])))
            fields = fields[1 + 3 * int(fields[0]) :]
        if not fields:
            dependent[card.place] = pairs
    return dependent


def _read_deck_nodes(path: Path) -> ForeignNodes:
    """Read nodes, sets and constraint cards from an input deck of Abaqus or CalculiX.

    Raises InputError if the deck can't be read, if two instances have nodes with the same number, or if axes are turned
    at a set of nodes that is not there.
    """
    deck = read_deck(path)
    if deck.further.renumbered is not None:
        allowed = (
            "matrices name nodes by their numbers: instances whose nodes have numbers that no other has are allowed"
        )
        raise deck.further.renumbered.error(allowed)
    sets = {name: [*members] for name, members in (deck.surfaces | deck.node_sets).items() if name[0] != "_"}
    axes = dict[int, Array]()
    for card in deck.further.turned:
        name = card.options.get("NSET", "")
        if name.lower() not in deck.node_sets:
            raise card.place.error(f"NSET={name} is no set of nodes")
        numbers = sorted(deck.node_sets[name.lower()])
        axes |= zip(numbers, turned_axes(card, np.array([deck.nodes[number] for number in numbers])), strict=True)
    nodes = _make_nodes(list(deck.nodes), [*deck.nodes.values()], sets)
    turned = deck.further.turned[0].place if deck.further.turned else None
    dependent = dependent_displacements(deck)
    constraints = [(place, keyword) for place, keyword in deck.further.constraints if keyword not in CONTACTS]
    return replace(nodes, constraints=constraints, axes=axes, turned=turned, dependent=dependent)


def _read_bulk_nodes(path: Path) -> ForeignNodes:
    """Read grid points, their sets and own axes, and cards that constrain coordinates from Nastran's bulk data.

    Raises the errors of `read_bulk`.
    """
    bulk = read_bulk(path)
    groups = {name: nodes.tolist() for name, nodes in bulk.groups.items()}
    ties = [(Place(str(path), line), name) for line, name in bulk.constraints]
    dependent = {Place(str(path), line): members for line, members in bulk.dependent.items()}
    nodes = _make_nodes(bulk.numbers.tolist(), bulk.points.tolist(), groups)
    return replace(nodes, axes=bulk.axes, constraints=ties, dependent=dependent, condensed=bulk.condensed)


def read_groups(path: Path) -> dict[str, Array]:
    """Return the g points (g, 3) in m of each group in a CSV file, by the group's name.

    `pmr matrices --nodes` takes the same files.  Raises InputError if the file can't be read.
    """
    nodes = read_by_suffix(path, {".csv": _read_csv_nodes})
    return {name: nodes.points[np.isin(nodes.numbers, members)] for name, members in nodes.groups.items()}


#: Readers of nodes, by the suffix of the file.
NODE_READERS: dict[str, Callable[[Path], object]] = {
    ".inp": _read_deck_nodes,
    ".csv": _read_csv_nodes,
    **dict.fromkeys(NASTRAN_SUFFIXES, _read_bulk_nodes),
}
