"""Decks of Abaqus and CalculiX: nodes, elements and sets, and what is not read is refused by its line."""

from __future__ import annotations

from pathlib import Path

import pytest

from pmr.errors import InputError
from pmr.files.decks import Deck, read_deck

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
        ("*Heading", "*INCLUDE, INPUT=other.inp\n*Heading", 1, "*INCLUDE is not read; the lines of that file"),
        ("nset=ALL", "SYSTEM=C", 4, "SYSTEM=C is not read"),
        ("nset=ALL", "INPUT=nodes.txt", 4, "the option INPUT of *NODE is not read"),
        ("2, 1., 0., 0.", "1, 1., 0., 0.", 6, "node 1 is there a second time"),
        ("2, 1., 0., 0.", "2, 1., x, 0.", 6, "coordinates of node 2 that are numbers"),
        ("2, 1., 0., 0.", "2, 1.D0, 0., 0.", 6, "coordinates of node 2 that are numbers"),
        ("2, 1., 0., 0.", "-2, 1., 0., 0.", 6, "the whole number of a node is allowed, not '-2'"),
        ("2, 1., 0., 0.", "9" * 30 + ", 1., 0., 0.", 6, "the whole number of a node"),
        ("1, 1, 2\n", "2, 1, 2\n", 12, "element 2 is there a second time"),
        ("1, 1, 2\n", "1, 1, 2, 3\n", 11, "the number of an element and 2 nodes are allowed for T3D2"),
        ("2, 2,\n3\n", "2, 2,\n", 12, "element 2 of type T3D2 has too few nodes"),
        ("1, 3,\n", "1, 7,\n", 15, "node 7 of set Ends is not in the file"),
        ("1, 3, 2\n", "1, 400000000, 2\n", 17, "node 399999999 of set odd is not in the file"),
        ("1, 3, 2\n", "1, 3, 0\n", 17, "first, last and step as whole numbers"),
        ("1, 3, 2\n", "1\n", 17, "first, last and step as whole numbers"),
        ("ends, ODD, 2", "ends, none", 19, "'none' is neither a number nor a set that stands further up"),
        ("ELSET=bars", "ELSET=rods", 20, "ELSET=rods is no set of elements"),
        ("NSET=used, ELSET", "ELSET", 20, "*NSET with NSET=NAME is allowed"),
        ("*MATERIAL, NAME=steel", "*NGEN\n1, 3, 1", 23, "*NGEN is not read; nodes and elements in the file itself"),
        (
            "*MATERIAL, NAME=steel",
            "*INSTANCE, NAME=a, PART=p\n1., 0., 0.",
            24,
            "translation or rotation of an instance",
        ),
        (
            "*MATERIAL, NAME=steel",
            "*INSTANCE, NAME=a, PART=p\n*END INSTANCE\n*INSTANCE, NAME=b, PART=p\n*END INSTANCE",
            25,
            "a second instance of part p, after that in line 23",
        ),
        (
            "*MATERIAL, NAME=steel",
            "*PART, NAME=Q\n*NODE\n1, 5., 0., 0.\n*END PART",
            25,
            "node 1 is there a second time",
        ),
    ],
)
def test_what_is_not_read_is_refused_by_its_line(old: str, new: str, line: int, says: str, tmp_path: Path) -> None:
    assert old in BAR
    with pytest.raises(InputError) as caught:
        deck(tmp_path, BAR.replace(old, new, 1))
    assert f"job.inp: line {line}: " in str(caught.value) and says in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_sets_that_name_themselves_stay_as_large_as_their_nodes(tmp_path: Path) -> None:
    """Each line once doubled the set's list: forty of them filled any memory."""
    doubled = "both, both, both, both\n" * 40
    assert deck(tmp_path, BAR.replace("ends, ODD, 2\n", "ends, ODD, 2\n" + doubled)).node_sets["both"] == {1, 2, 3}


def test_steps_take_the_nodes_between_that_there_are(tmp_path: Path) -> None:
    text = "*NODE\n1, 0., 0., 0.\n900000001, 1., 0., 0.\n*NSET, NSET=a, GENERATE\n1, 900000001\n"
    assert deck(tmp_path, text).node_sets["a"] == {1, 900000001}
