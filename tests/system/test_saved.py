"""A system in a file: what was written is read, and what no system is refused in one line.

Shells that slide in each other on pads of finite size: a system of bodies on any structural model.
"""

import io
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from boxes import box
from nested import Nested, full, reduced

from pmr import InputError, ReducedModel, System
from pmr.files import npz
from pmr.fullmodel.actions import Action, Weight
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.pads import Pad, Pads
from pmr.fullmodel.structure import Clamp, Structure, structural_model
from pmr.models.shell import Shell
from pmr.reduction.basis import modal_basis
from pmr.reduction.free_body import FreeBody
from pmr.reduction.residual import section_model
from pmr.reduction.snapshots import free_modes
from pmr.scene.structures import Plate, ShellBody
from pmr.system.assembly import Assembly
from pmr.system.contacts import Contact, Place

EARLIER = Path(__file__).parents[1] / "files" / "earlier" / "reduced.npz"


@pytest.fixture(scope="module")
def system() -> System:
    found = reduced(Nested(3, elements=10, clearance=1e-4), 2)
    return replace(found, provenance={"scene": {"title": "Three"}}, on_modes={"1": found.bodies["1"]})


def test_what_was_saved_is_read(system: System, tmp_path: Path) -> None:
    """Every array to the bit, names, contacts and the scene; equal systems make equal files."""
    file = system.save(tmp_path / "system.npz")
    found = System.load(file)
    assert (found.contacts, found.provenance, list(found.bodies)) == (
        system.contacts,
        system.provenance,
        list(system.bodies),
    )
    pairs = [(body, found.bodies[name]) for name, body in system.bodies.items()]
    for one, other in [*pairs, (system.on_modes["1"], found.on_modes["1"])]:
        expected, arrays = npz.record_arrays(one), npz.record_arrays(other)
        assert set(arrays) == set(expected)
        for key, values in expected.items():
            np.testing.assert_array_equal(arrays[key], values)
    assert found.save(tmp_path / "again.npz").read_bytes() == file.read_bytes()


def test_what_two_models_of_a_body_have_in_common_stands_in_the_file_once(system: System, tmp_path: Path) -> None:
    moved = replace(system, on_modes={"1": replace(system.bodies["1"], M=2.0 * system.bodies["1"].M)})
    with np.load(moved.save(tmp_path / "system.npz")) as data:
        assert [name for name in data if name.startswith("on_modes")] == ["on_modes.0.M"]


def test_the_file_of_one_body_is_that_of_a_body_alone(tmp_path: Path) -> None:
    """Of an earlier version, too, and saved as a system it is the same."""
    model, system = ReducedModel.load(EARLIER), System.load(EARLIER)
    s = np.linspace(*model.domain, 5)
    assert list(system.bodies) == [""] and system.input_names == model.input_names and system.paths == ("slider",)
    again = System.load(system.save(tmp_path / "system.npz"))
    assert again.provenance == model.provenance
    for one in (system, again):
        rows = Assembly(one).contact_rows_over_time(one.side_coordinates({"slider": s}))
        np.testing.assert_array_equal(rows.C, model.C(s))


def changed(header: Callable[[dict[str, Any]], Any]) -> Callable[[dict[str, Any]], None]:
    """A change of the header in its file."""

    def change(arrays: dict[str, Any]) -> None:
        found = json.loads(str(arrays["header"]))
        made = header(found)
        arrays["header"] = np.array(json.dumps(found if made is None else made))

    return change


def contact(**keys: Any) -> Callable[[dict[str, Any]], None]:
    return changed(lambda header: header["contacts"][0].update(keys))


def place(**keys: Any) -> Callable[[dict[str, Any]], None]:
    return changed(lambda header: header["contacts"][0]["inner"].update(keys))


FORGED: dict[str, tuple[Callable[[dict[str, Any]], Any], str]] = {
    "no header": (lambda arrays: arrays.pop("header"), "no header"),
    "another format": (changed(lambda header: header | {"format": "abc"}), "format = 'abc'"),
    "later": (changed(lambda header: header | {"version": 99}), "version = 99"),
    "a header that is a list": (changed(lambda header: [header]), "not a system"),
    "no contacts": (changed(lambda header: header.pop("contacts") and None), "contacts"),
    "contacts that are none": (changed(lambda header: header | {"contacts": [1]}), "contacts.0"),
    "a body more": (changed(lambda header: header["bodies"].append("3")), "M"),
    "two of a name": (changed(lambda header: header | {"bodies": ["0", "0", "1"]}), "names that differ"),
    "one without a name": (changed(lambda header: header | {"bodies": ["", "1", "2"]}), "names that differ"),
    "one with an odd name": (changed(lambda header: header | {"bodies": ["\x1b[31m", "1", "2"]}), "not a name"),
    "a number for a name": (changed(lambda header: header | {"bodies": [0, 1, 2]}), "bodies.0"),
    "another body": (place(body="9"), "contacts.tail 1 top.body = '9'"),
    "another row": (place(row="v"), "contacts.tail 1 top.row = 'v'"),
    "nowhere": (place(at=float("nan")), "place"),
    "a path that leads nowhere": (place(path="1", rate=0.0), "place"),
    "a direction of none": (contact(direction=0.0), "direction = 0.0"),
    "less than rigid": (contact(compliance=-1.0), "compliance = -1.0"),
    "text for a compliance": (contact(compliance="x"), "contacts.0.compliance"),
    "a mass that is none": (lambda arrays: arrays.update({"bodies.1.M": -arrays["bodies.1.M"]}), "bodies.1: M has"),
    "a model on modes of another size": (lambda arrays: arrays.update({"on_modes.0.M": arrays["bodies.1.M"][:2, :2]}),
     "on_modes.1: "),
    "a model on modes of another body": (changed(lambda header: header | {"on_modes": ["0"]}), "on_modes.0: "),
    "a model on modes of no body": (changed(lambda header: header | {"on_modes": ["9"]}), "on_modes.9: 0, 1, 2 are"),
    "an array that stands nowhere": (changed(lambda header: header | {"same": {"on_modes.0.M": "bodies.9.M"}}),
     "bodies.9.M"),
    "a missing matrix": (lambda arrays: arrays.pop("bodies.2.K"), "bodies.2.K"),
}  # fmt: skip


@pytest.mark.parametrize("name", FORGED)
def test_what_no_system_is_refused_in_one_line(name: str, system: System, tmp_path: Path) -> None:
    file, (change, says) = system.save(tmp_path / "system.npz"), FORGED[name]
    with np.load(file) as data:
        arrays = dict(data)
    change(arrays)
    np.savez(file, **arrays)
    with pytest.raises(InputError) as refused:
        System.load(file)
    assert says in str(refused.value) and str(refused.value).startswith(str(file)) and "\n" not in str(refused.value)


def test_a_damaged_file_is_refused(system: System, tmp_path: Path) -> None:
    """Cut off anywhere, or with a pickle in it."""
    file = system.save(tmp_path / "system.npz")
    content = file.read_bytes()
    for share in (0.0, 0.3, 0.9, 0.9999):
        file.write_bytes(content[: int(share * len(content))])
        with pytest.raises(InputError, match="not a system written by pmr"):
            System.load(file)
    with np.load(io.BytesIO(content)) as data:
        np.savez(file, **{**data, "bodies.0.M": np.array([{}], dtype=object)}, allow_pickle=True)
    with pytest.raises(InputError, match="not a system written by pmr"):
        System.load(file)
    with pytest.raises(InputError, match="no such file"):
        System.load(tmp_path / "nothing.npz")


def test_full_bodies_are_not_saved(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="bodies.0 = 'FullBody': a ReducedModel is allowed"):
        full(Nested(2, elements=4)).save(tmp_path / "system.npz")


LENGTH, REACH = 2.0, 0.16  # m; of a section, and from its ends to the centres of pads

FACES = ("bottom", "top", "left", "right")


def section(clamped: bool) -> FullModel:
    """A box with a row on each wall, where a pad may be centred."""
    shell = Shell(ShellBody(plate=Plate(thickness=8e-3)), box(LENGTH, along=6, around=2))
    pads = Pads(moving=tuple(Pad(face, face, length=0.3, width=0.1) for face in FACES), travel=(REACH, LENGTH - REACH))
    return structural_model(
        Structure(
            shell,
            clamps=(Clamp("tail"),) if clamped else (),
            loads=(Weight(), *([] if clamped else [Action("F", "tip", "z")])),
            outputs=(Action("tip", "tip", "z"),),
            pads=pads,
        )
    )


def contacts() -> tuple[Contact, ...]:
    """Two pads of 1e8 N/m on each wall: at the inner one's tail and at the outer one's mouth."""
    end = LENGTH - REACH
    return tuple(
        contact
        for face in FACES
        for contact in (
            Contact(f"tail {face}", Place("inner", face, REACH), Place("outer", face, REACH, "e"), compliance=1e-8),
            Contact(f"mouth {face}", Place("inner", face, end, "e", -1.0), Place("outer", face, end), compliance=1e-8),
        )
    )


@pytest.mark.slow
def test_two_shells_of_thousands_of_coordinates_with_twenty() -> None:
    outer, inner = section(True), section(False)
    full = System({"outer": outer.gather(), "inner": inner.gather()}, contacts())
    small = System(
        {
            "outer": section_model(FreeBody(outer), modal_basis(free_modes(outer, 8)), {}, 8),
            "inner": section_model(FreeBody(inner), modal_basis(free_modes(inner, 12)), {}, 12),
        },
        contacts(),
    )
    whole, x = Assembly(full), {"e": 0.8}
    assert whole.size > 2000 and Assembly(small).size == 20
    found = Assembly(small).frequencies(small.side_coordinates(x), 4)
    # pads in the middle of walls hold neither roll nor motion along the axis, which no load reaches
    expected = whole.frequencies(full.side_coordinates(x), 6)
    assert np.all(expected[:2] < 0.1) and found == pytest.approx(expected[2:], rel=1e-2)
