"""Nodes of another program's model, with their groups, axes and ties, from a deck, a table or Nastran's bulk data."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from pmr.files.arrays import Array, Indices
from pmr.files.cards import Place, turned_axes
from pmr.files.deck_content import dependent_displacements, is_label_number
from pmr.files.decks import CONTACTS, TURNED, read_deck
from pmr.files.labelled import UnreadableError, read_by_suffix
from pmr.files.nastran import read_bulk

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
        """Return the nodes without those that cards tie to other nodes, and without these cards.

        A node is left out if all of its displacements depend on others and it has no row among the node and direction
        `pairs` (n, 2) of the matrices.  A card stays if it ties a displacement of any other node.
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
    """Raise InputError if nodes have axes of their own, or if cards constrain coordinates.

    Such cards are refused only if some displacements have no row in the matrices.  `pairs` (n, 2) are the node and the
    direction (from 1) of each row.
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
    """Return nodes from their `numbers`, their points (x, y, z) in m, and the numbers of the nodes in each group.

    Groups without members are left out.  Raises UnreadableError if there are no nodes.
    """
    if not numbers:
        raise UnreadableError("nodes are allowed: this file has none")
    sets_of_nodes = {name: np.unique(np.array(members, dtype=np.int64)) for name, members in groups.items() if members}
    return ForeignNodes(np.array(numbers, dtype=np.int64), np.array(points), sets_of_nodes)


def _read_csv_nodes(path: Path) -> ForeignNodes:
    """Read nodes and groups from a CSV file; its first line is skipped.

    Each line has node, x, y, z in m and the names of the groups that the node belongs to.  Raises UnreadableError with
    the number of a line of another form.
    """
    numbers, points, groups = list[int](), list[list[float]](), dict[str, list[int]]()
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
        numbers.append(int(number))
        points.append(place)
        for name in filter(None, parts[3:]):
            groups.setdefault(name, []).append(int(number))
    return _make_nodes(numbers, points, groups)


def _read_deck_nodes(path: Path) -> ForeignNodes:
    """Read nodes, sets and constraint cards from an input deck of Abaqus or CalculiX.

    Raises InputError if two instances have nodes with the same number.
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
    """Read grid points, their sets and own axes, and cards that constrain coordinates from Nastran's bulk data."""
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
