"""Decks of Abaqus and CalculiX: nodes, elements and sets, and what is not read is refused by its line."""

import os
import resource
import time
from pathlib import Path

import numpy as np
import pytest
from fuzz.mutations import scratched

from pmr import InputError
from pmr.files import decks
from pmr.files.deck_content import Deck
from pmr.files.decks import read_deck

BAR = """*Heading
 a bar of two cells
** a comment
*Node, nset=ALL
1, 0., 0., 0.
2, 1., 0., 0.
3, 2., 0.
4, 3
*Element, type=T3D2,
 elset="Bars"
1, 1, 2
2, 2,
3
*NSET, NSET=Ends
1, 3,
*Nset, nset=odd, generate
1, 3, 2
*NSET, NSET=both
ends, ODD, 2
*NSET, NSET=used, ELSET=bars
*ELSET, ELSET=second
2
*MATERIAL, NAME=steel
*ELASTIC
2e11, 0.3
"""


def deck(folder: Path, text: str) -> Deck:
    (folder / "job.inp").write_text(text)
    return read_deck(folder / "job.inp")


def test_nodes_elements_and_sets_are_read(tmp_path: Path) -> None:
    read = deck(tmp_path, BAR)
    assert read.nodes == {1: (0, 0, 0), 2: (1, 0, 0), 3: (2, 0, 0), 4: (3, 0, 0)}
    assert [(one.type, one.numbers, one.nodes) for one in read.elements] == [("T3D2", [1, 2], [[1, 2], [2, 3]])]
    expected = {"all": {1, 2, 3, 4}, "ends": {1, 3}, "odd": {1, 3}, "both": {1, 2, 3}, "used": {1, 2, 3}}
    assert read.node_sets == expected
    assert read.element_sets == {"bars": {1, 2}, "second": {2}} and read.set_spellings["bars"] == "Bars"


def test_several_blocks_of_nodes_and_a_part_with_an_instance_in_place_are_read(tmp_path: Path) -> None:
    text = "*PART, NAME=P\n*NODE\n1, 0, 0, 0\n*NODE, NSET=b\n2, 1, 0, 0\n*END PART\n*ASSEMBLY, NAME=A\n"
    read = deck(
        tmp_path, text + "*INSTANCE, NAME=P-1, PART=P\n0., 0., 0.\n*END INSTANCE\n*NSET, NSET=c, INSTANCE=P-1\n1\n"
    )
    assert list(read.nodes) == [1, 2] and read.node_sets == {"b": {2}, "c": {1}}


@pytest.mark.parametrize(
    ("old", "new", "line", "says"),
    [
        ("*Heading", "*INCLUDE, INPUT=other.inp\n*Heading", 1, "INPUT=other.inp: no such file"),
        ("*Heading", "*INCLUDE\n*Heading", 1, "INPUT=: no such file, but a folder"),
        ("*Heading", "*INCLUDE, INPUT=job.inp\n*Heading", 1, "files that do not include themselves"),
        ("nset=ALL", "SYSTEM=T", 4, "SYSTEM=T is not read; R, C (cylindrical)"),
        ("nset=ALL", "INPUT=nodes.txt", 4, "INPUT=nodes.txt: no such file"),
        ("nset=ALL", "COPY=1", 4, "the option COPY of *NODE is not read"),
        ("*Heading", "*SYSTEM\n0., 0., 0., 1., 0., 0.\n2., 0., 0.\n*Heading", 2, "three points that are not on a line"),
        ("*Heading", "*SYSTEM\n0., x\n*Heading", 2, "at most 6 numbers"),
        ("2, 1., 0., 0.", "1, 1., 0., 0.", 6, "node 1 is there a second time"),
        ("2, 1., 0., 0.", "2, 1., x, 0.", 6, "coordinates of node 2 that are numbers"),
        ("2, 1., 0., 0.", "-2, 1., 0., 0.", 6, "the whole number of a node is allowed, not '-2'"),
        ("2, 1., 0., 0.", "9" * 30 + ", 1., 0., 0.", 6, "the whole number of a node"),
        ("1, 1, 2\n", "2, 1, 2\n", 12, "element 2 is there a second time"),
        ("1, 1, 2\n", "1, 1, 2, 3\n", 11, "the number of an element and 2 nodes are allowed for T3D2"),
        ("2, 2,\n3\n", "2, 2,\n7\n", 12, "element 2 has node 7, which is not in the file"),
        ("2, 2,\n3\n", "2, 2,\n", 12, "element 2 of type T3D2 has too few nodes"),
        ("1, 3,\n", "1, 7,\n", 15, "node 7 of set Ends is not in the file"),
        ("1, 3, 2\n", "1, 400000000, 2\n", 17, "node 399999999 of set odd is not in the file"),
        ("1, 3, 2\n", "1, 3, 0\n", 17, "first, last and step as whole numbers"),
        ("1, 3, 2\n", "1\n", 17, "first, last and step as whole numbers"),
        ("ends, ODD, 2", "ends, none", 19, "'none' is neither a number nor a set that stands further up"),
        ("ELSET=bars", "ELSET=rods", 20, "ELSET=rods is no set of elements"),
        ("NSET=used, ELSET", "ELSET", 20, "*NSET with NSET=NAME is allowed"),
        ("*MATERIAL, NAME=steel", "*NGEN\n1, 3, 1", 23, "*NGEN is not read; nodes and elements in the file itself"),
        ("*MATERIAL, NAME=steel", "*INSTANCE, NAME=a, PART=p", 23, "PART=p is no part that stands further up"),
        ("*MATERIAL, NAME=steel", "*PART, NAME=Q\n*PART, NAME=q", 24, "a part q was defined before"),
        ("*MATERIAL, NAME=steel", "*INSTANCE, NAME=a\n*INSTANCE, NAME=a", 24, "each instance needs a name of its own"),
        ("*MATERIAL, NAME=steel", "*NSET, NSET=x, INSTANCE=b\n1", 23, "INSTANCE=b is no instance of a part"),
        ("*MATERIAL, NAME=steel", "*INSTANCE, NAME=a\n1., 0., 0.\n0., 0., 0., 0., 0., 0., 90.\n*NODE\n1, 0., 0., 0.",
         25, "two points on the axis of rotation, which differ"),
    ],
)  # fmt: skip
def test_what_is_not_read_is_refused_by_its_line(old: str, new: str, line: int, says: str, tmp_path: Path) -> None:
    assert old in BAR
    with pytest.raises(InputError) as caught:
        deck(tmp_path, BAR.replace(old, new, 1))
    assert f"job.inp: line {line}: " in str(caught.value) and says in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_files_that_are_included_stand_in_the_place_of_their_card(tmp_path: Path) -> None:
    """Nested, with data that go on behind them, and as data of a card: the same as one file."""
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "nodes.inc").write_text(
        "*Node, nset=ALL\n1, 0., 0., 0.\n** of others\n*include, input=more.inc\n"
    )
    (tmp_path / "parts" / "more.inc").write_text("2, 1.D0, 0.0d+00, 0.\n")
    (tmp_path / "elements.txt").write_text("1, 1, 2\n2, 2,\n3\n")
    begin, end = BAR.index("*Node"), BAR.index("3, 2., 0.")
    text = BAR[:begin] + '*INCLUDE,\n INPUT="parts/nodes.inc"\n' + BAR[end:]
    text = text.replace(' elset="Bars"\n1, 1, 2\n2, 2,\n3\n', ' elset="Bars", input=elements.txt\n')
    whole, split = deck(tmp_path, BAR), deck(tmp_path, text)
    assert split.nodes == whole.nodes and split.node_sets == whole.node_sets
    assert [vars(one) | {"lines": 0} for one in split.elements] == [vars(one) | {"lines": 0} for one in whole.elements]


def test_files_that_include_each_other_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.inc").write_text("** a\n*INCLUDE, INPUT=b.inc\n")
    (tmp_path / "b.inc").write_text("*INCLUDE, INPUT=a.inc\n")
    with pytest.raises(InputError, match=r"b.inc: line 1: INPUT=a.inc: files that do not include themselves"):
        deck(tmp_path, "*INCLUDE, INPUT=a.inc\n")
    (tmp_path / "a.inc").write_text("** nothing\n")
    with pytest.raises(InputError, match=r"job.inp: line 1001: .* at most 1000 times"):
        deck(tmp_path, "*INCLUDE, INPUT=a.inc\n" * 1100)


PARTS = """*PART, NAME=Rod
*NODE, NSET=all
1, 0., 0., 0.
2, 2., 0., 0.
*ELEMENT, TYPE=T3D2, ELSET=bars
1, 1, 2
*NSET, NSET=End
2
*END PART
*PART, NAME=unused
*NODE
1, 9., 9., 9.
*END PART
*ASSEMBLY, NAME=A
*INSTANCE, NAME=First, PART=rod
*END INSTANCE
*INSTANCE, NAME=Second, PART=Rod
1., 2., 3.
1., 2., 3., 1., 2., 4., 90.
*END INSTANCE
*NODE
1, 7., 0., 0.
*NSET, NSET=tips, INSTANCE=Second
end
*NSET, NSET=tips
First.End, 1
*NSET, NSET=tails
first.1, SECOND.1
*NSET, NSET=of_bars, ELSET=Second.bars
*ELSET, ELSET=both
First.bars, Second.1
*END ASSEMBLY
"""


def test_instances_are_moved_then_turned_and_have_nodes_of_their_own(tmp_path: Path) -> None:
    """The second rod is moved to (1, 2, 3) and turned about z there, by hand."""
    read = deck(tmp_path, PARTS)
    places = {number: tuple(round(x, 12) for x in place) for number, place in read.nodes.items()}
    assert places == {1: (0, 0, 0), 2: (2, 0, 0), 3: (1, 2, 3), 4: (1, 4, 3), 5: (7, 0, 0)}
    assert [(one.numbers, one.nodes) for one in read.elements] == [([1], [[1, 2]]), ([2], [[3, 4]])]
    sets = read.node_sets
    assert sets["tips"] == {2, 4, 5} and sets["tails"] == {1, 3} and sets["of_bars"] == {3, 4}
    assert sets["end"] == {2, 4} and sets["second.end"] == {4} and read.set_spellings["second.end"] == "Second.End"
    assert read.element_sets["both"] == {1, 2} and read.element_sets["first.bars"] == {1}
    assert read.further.renumbered is not None and read.further.renumbered.line == 17


def test_nodes_of_instances_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two lines for an instance could copy a part of any size: a short deck filled any memory."""
    monkeypatch.setattr(decks, "MOST_NODES", 10)
    copies = [f"*INSTANCE, NAME=i{k}, PART=p\n" for k in range(6)]
    part = "*PART, NAME=p\n*NODE\n1, 0., 0., 0.\n2, 1., 0., 0.\n*END PART\n"
    assert len(deck(tmp_path, part + "".join(copies[:5])).nodes) == 10
    with pytest.raises(InputError, match=r"job.inp: line 11: instances that have 10 nodes together are allowed"):
        deck(tmp_path, part + "".join(copies))


def test_nodes_in_other_axes_are_those_of_the_whole(tmp_path: Path) -> None:
    """Cylindrical and spherical ones, and axes of their own that are moved, turned about z, or through three points."""
    text = """*NODE, SYSTEM=C
1, 2., 90., 5.
*SYSTEM
1., 0., 0.
*NODE
2, 1., 1., 1.
*SYSTEM
1., 0., 0., 1., 3., 0.
*NODE
3, 1., 0., 2.
*NODE, SYSTEM=C
4, 1., 90., 0.
*SYSTEM
0., 0., 0., 0., 0., 2.
0., 1., 1.
*NODE
5, 1., 2., 3.
*NODE, SYSTEM=S
7, 2., 90., 30.
*SYSTEM
*NODE
6, 1., 2., 3.
*NODE, SYSTEM=S
8, 2., 90., 30.
9, 2., 180., -90.
"""
    expected = [(0, 2, 5), (2, 1, 1), (1, 1, 2), (0, 0, 0), (-3, 2, 1), (-1, 3**0.5, 0), (1, 2, 3)]
    expected += [(0, 3**0.5, 1), (0, 0, -2)]
    expected = [tuple(round(x, 12) for x in place) for place in expected]
    places = [tuple(round(x, 12) + 0.0 for x in place) for place in deck(tmp_path, text).nodes.values()]
    assert places == expected


def test_decks_as_programs_and_people_write_them_are_read(tmp_path: Path) -> None:
    """A comma that ends a keyword line or an element, a card with a file that is not there, a network that ends."""
    text = """*NODE, NSET=all,
1, 0., 0., 0.
2, 1., 0., 0.
3, 0., 1., 0.
4, 0., 0., 1.
5, 1., 0., 1.
6, 0., 1., 1.
*ELEMENT, TYPE=C3D6, ELSET=wedges
1, 1, 2, 3, 4, 5, 6,
2, 4, 5, 6,
1, 2, 3,
*ELEMENT, TYPE=D
3, 0, 4, 5,
*ELEMENT, TYPE=U1
4, 1, 2,
*ELEMENT, TYPE=DASHPOTA
5, 1, 2
*ELSET, ELSET=last
2,
*SURFACE, NAME=of wedges
1, S3
*SURFACE, NAME=of a dashpot
5, S1
*DLOAD, INPUT=loads.dlo
*NSET,
 NSET=few
1
"""
    read = deck(tmp_path, text)
    assert (read.node_sets["all"], read.node_sets["few"]) == ({1, 2, 3, 4, 5, 6}, {1})
    assert (read.element_sets, read.surfaces) == ({"wedges": {1, 2}, "last": {2}}, {})
    assert [block.nodes for block in read.elements][:2] == [[[1, 2, 3, 4, 5, 6], [4, 5, 6, 1, 2, 3]], [[4, 5]]]


def test_sets_that_name_themselves_stay_as_large_as_their_nodes(tmp_path: Path) -> None:
    """Each line once doubled the set's list: forty of them filled any memory."""
    doubled = "both, both, both, both\n" * 40
    assert deck(tmp_path, BAR.replace("ends, ODD, 2\n", "ends, ODD, 2\n" + doubled)).node_sets["both"] == {1, 2, 3}


def test_steps_take_the_nodes_between_that_there_are(tmp_path: Path) -> None:
    text = "*NODE\n1, 0., 0., 0.\n900000001, 1., 0., 0.\n*NSET, NSET=a, GENERATE\n1, 900000001\n"
    assert deck(tmp_path, text).node_sets["a"] == {1, 900000001}


def test_damaged_decks_are_read_or_refused_in_one_line(tmp_path: Path) -> None:
    """Numbers, names, lines and bytes changed at random: no traceback, and as many nodes as there are lines at most."""
    rng, before = np.random.default_rng(52), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for text in (BAR, PARTS) * (1000 if os.environ.get("PMR_SWEEP") == "full" else 50):
        begun = time.process_time()
        content = scratched(text.encode(), rng)
        (tmp_path / "job.inp").write_bytes(content)
        try:
            read = read_deck(tmp_path / "job.inp")
        except InputError as error:
            assert "job.inp" in str(error) and len(str(error).splitlines()) == 1
        else:
            assert len(read.nodes) <= 2 * content.count(b"\n")
            assert all(members <= read.nodes.keys() for members in read.node_sets.values())
        assert time.process_time() - begun < 10.0
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 1e6  # kB
