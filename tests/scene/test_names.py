"""Names come in once: what a table, a deck, a script, a page or a path would read more into is refused there."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fuzz.names import fit, hostile
from pydantic import TypeAdapter, ValidationError

from pmr import InputError, from_matrices
from pmr.errors import LONGEST_NAME, escape_controls, is_name
from pmr.scene import Load, Support
from pmr.scene.built import PadRing
from pmr.scene.joints import FileName, JointPads
from pmr.scene.run_settings import Observe
from pmr.scene.structures import PointMass, Probe

COUNT = 2000 if os.environ.get("PMR_SWEEP") == "full" else 200
CRAFTED = [
    "F\nINCLUDE '/etc/passwd'", "F\rENDDATA", "F\x1b]0;x\x07", 'F" onload="x', "<script>alert(1)</script>", "F&lt;",
    "'; x", "=cmd|'/c calc'!A0", "+1+1", "-1", "@SUM(A1)", "\t=1", "../../etc/passwd", "/etc/passwd", "C:\\x",
    ".hidden", "a\0b", "{{7*7}}", "${x}", "%s%n", "`id`", "$(id)", "F;x", "F|x", "F*", "F?", "F[0]", "F\u2028x",
    "F\u202ex", "F\ud800", "", " ", " F", "F ", "x" * (LONGEST_NAME + 1), "＝1+1", "\ufeffF", "\ufffe", "F\x85x",
    "#!/bin/sh", "$x^2$", "a\\b",
]  # fmt: skip
MEANT = set("\"'\\<>&${}[]|;=*?!@^~`%")


def names() -> list[str]:
    rng = np.random.default_rng(7)
    return CRAFTED + [hostile(rng) for _ in range(COUNT)]


ENTRANCES: dict[str, Callable[[str], Any]] = {
    "loads.name": lambda name: Load(name=name, signal=1.0),
    "loads.on": lambda name: Load(on=name, signal=1.0),
    "supports.on": lambda name: Support(on=name),
    "pads.name": lambda name: PadRing(name=name, faces={"top": (0.0,)}),
    "masses.name": lambda name: PointMass(name=name, on="tip", mass=1.0),
    "masses.on": lambda name: PointMass(name="m", on=name, mass=1.0),
    "probes.name": lambda name: Probe(name=name, on="tip"),
    "probes.on": lambda name: Probe(name="p", on=name),
    "observe.tip": lambda name: Observe(tip=name),
}
OR_NOTHING: dict[str, Callable[[str], Any]] = {
    "supports.name": lambda name: Support(name=name),
    "joint.tail.name": lambda name: JointPads(name=name, at=0.1),
}


@pytest.mark.parametrize("name", CRAFTED)
def test_what_is_crafted_is_no_name(name: str) -> None:
    assert not is_name(name)


@pytest.mark.parametrize(
    "name", ["tip force", "F_z", "pad 1 (left), top", "Kran-Spitze größe", "漢字", "a.b:c/d+e #2", "ऊँचाई"]
)
def test_what_people_call_things_is_a_name(name: str) -> None:
    assert is_name(name) and is_name(fit(name))


@pytest.mark.parametrize("key", [*ENTRANCES, *OR_NOTHING])
def test_no_entrance_takes_what_is_no_name(key: str) -> None:
    make = (ENTRANCES | OR_NOTHING)[key]
    for name in names():
        if is_name(name) or (not name and key in OR_NOTHING):
            make(name)
        else:
            with pytest.raises(ValidationError):
                make(name)


def test_a_name_is_one_line_that_no_reader_obeys() -> None:
    taken = [name for name in names() if is_name(name)] + [fit(name) for name in names()]
    assert len(taken) > COUNT
    for name in taken:
        assert is_name(name) and not MEANT & set(name) and escape_controls(name) == name and len(name.splitlines()) == 1
        assert (name[0].isalnum() or name[0] == "_") and ".." not in Path(name).parts and not Path(name).is_absolute()


def test_a_section_gives_a_file_its_name() -> None:
    for name in [*names(), "x" * 300, "a/b", "a.b", "base", "Ausleger 2"]:
        plain = all(letter.isalnum() or letter in "_ -" for letter in name) and name[:1] not in ("", " ", "-")
        try:
            TypeAdapter(FileName).validate_python(name)
        except ValidationError:
            assert not (plain and name.isascii() and len(name) <= LONGEST_NAME)
        else:
            assert (
                len(Path(f"reduced-{name}.npz").parts) == 1
                and escape_controls(name) == name
                and len(name) <= LONGEST_NAME
            )


def test_groups_of_matrices_have_names_too() -> None:
    for name in CRAFTED:
        with pytest.raises(InputError, match="groups"):
            from_matrices(np.eye(6), np.eye(6), np.zeros((1, 3)), {name: [0]})
