"""What the files of an FMU say: names, units, starts, and the scene that they are made from."""

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import nested
import numpy as np
import pytest
from export.fmi.libraries import Instance, loaded
from export.fmi.units import BOOM, BOTH_WAYS, LOADS, RINGS, STEP, body_alone

import pmr
from pmr import InputError, ReducedModel, System
from pmr.export.fmi import Contents, fmu_contents
from pmr.export.fmi.variables import Drivers
from pmr.reduction.bodies import Reduction
from pmr.simulation import Excitation, TimeStepping
from pmr.simulation.excitation import side_positions
from pmr.simulation.moving import StoredScene, read_scene
from pmr.simulation.statics.equilibrium import equilibrium
from pmr.system.assembly import Assembly
from pmr.system.contacts import Place


def described(model: ReducedModel, version: str) -> Contents:
    """Contents of the FMU of a body alone."""
    return fmu_contents(System.of(model), read_scene(System.of(model), "model.npz"), "body", version)


@pytest.fixture(scope="module")
def two() -> Reduction:
    return pmr.reduce(pmr.load_scene("boom_two", [*BOOM, *BOTH_WAYS, "time.end=0.02"]))


HOSTILE = (
    *("a\x1b[31m", "\0", "\ud800", "<&>'\"", "]]>", "\uffff", "\n", "-", "1", ""),
    *("start", "s", "rate of x", "internal_step"),
)


def assert_readable(contents: Contents) -> None:
    """Assert that the description is XML with names that differ and are identifiers, and that tables have columns."""
    root = ET.fromstring(contents.texts["modelDescription.xml"].encode())
    listed = list(root.find("ModelVariables") or ())
    names = [v.attrib["name"] for v in listed]
    assert len(set(names)) == len(names) > 10 and all(re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) for name in names)
    choices = [v for v in listed if v.tag == "Enumeration" or v.find("Enumeration") is not None]
    assert [v.attrib["name"] for v in choices] == ["start"]
    for text in (t for name, t in contents.texts.items() if name.endswith(".csv")):
        head, *rows = text.splitlines()
        assert head.count(",") == rows[0].count(",") == rows[-1].count(",")


@pytest.mark.parametrize("version", ["2", "3"])
def test_any_name_leaves_a_description_that_can_be_read(version: str) -> None:
    model = body_alone("flexible")
    o = len(model.outputs)
    for pair in zip(HOSTILE, reversed(HOSTILE), strict=True):
        named = replace(
            model,
            input_names=pair,
            row_names=tuple(f"{pair[0]}{k}" for k in range(len(model.row_names))),
            output_names=(*pair, *(f"{pair[1]}{k}" for k in range(o - 2))),
        )
        named.provenance["scene"]["title"] = pair[0]
        assert_readable(described(named, version))


def renamed(system: System, scene: StoredScene, bodies: tuple[str, ...], path: str) -> tuple[System, StoredScene]:
    """With other names of its bodies, its path and its contacts."""
    names = dict(zip(system.bodies, bodies, strict=True))

    def place(at: Place) -> Place:
        return replace(at, body=names[at.body], path=path if at.path else None)

    contacts = [
        replace(one, name=f"{path}{k}", inner=place(one.inner), outer=place(one.outer) if one.outer else None)
        for k, one in enumerate(system.contacts)
    ]
    found = System({names[name]: body for name, body in system.bodies.items()}, tuple(contacts))
    loads = dict(zip(found.input_names, scene.excitation.loads.values(), strict=True))
    (signal,) = scene.excitation.paths.values()
    return found, replace(scene, excitation=Excitation({path: signal}, loads, scene.excitation.stepping))


@pytest.mark.slow
@pytest.mark.parametrize("version", ["2", "3"])
def test_so_does_any_name_of_sections_paths_and_contacts(two: Reduction, version: str) -> None:
    for one, other in zip(HOSTILE, reversed(HOSTILE), strict=True):
        if one and other:
            system, scene = renamed(two.system, read_scene(two.system, "system"), (one, other), one)
            assert_readable(fmu_contents(system, scene, "boom", version))


def test_it_starts_with_the_loads_of_the_scene_and_its_whole_weight() -> None:
    model = body_alone("flexible")
    scene = model.provenance["scene"]
    scene |= {"loads": scene["loads"][:1], "gravity": {"rise": 1.0}}
    root = ET.fromstring(described(model, "3").texts["modelDescription.xml"])
    start = {v.attrib["name"]: float(v.attrib["start"]) for v in root.iter("Float64") if v.get("causality") == "input"}
    assert list(start.values()) == [2.0, float(LOADS[0].value(0.0)), 9.80665, *(0.0,) * 9]


def test_the_same_model_makes_the_same_source(tmp_path: Path) -> None:
    model = body_alone("flexible")
    model.save(tmp_path / "a.npz")
    once, again = (described(one, "2").texts for one in (model, ReducedModel.load(tmp_path / "a.npz")))
    assert once == again


def test_what_probes_measure_has_its_unit() -> None:
    model = body_alone("flexible")
    units = [*("m",) * (len(model.outputs) - 4), "Pa", "1", "mm", "furlong"]
    measured = replace(model, output_units=tuple(units), output_names=tuple(f"p{k}" for k in range(len(units))))
    for version, tag in (("2", "Real"), ("3", "Float64")):
        root = ET.fromstring(described(measured, version).texts["modelDescription.xml"])
        defined = {unit.attrib["name"]: unit for unit in root.iter("Unit")}
        found = {v.attrib["unit"] for v in root.iter(tag) if "unit" in v.attrib}
        assert {"Pa", "Pa/s", "1", "1/s", "mm", "mm/s", "furlong", "furlong/s"} <= found == set(defined)
        assert [base.attrib for base in defined["mm"]] == [{"m": "1", "factor": "0.001"}]
        assert [base.attrib for base in defined["Pa"]] == [{"kg": "1", "m": "-1", "s": "-2"}]


def test_a_moment_has_its_unit() -> None:
    model = body_alone("flexible")
    for load, name, direction in zip(model.provenance["scene"]["loads"], model.input_names, ("ry", "z"), strict=True):
        load |= {"name": name, "direction": direction}
    texts = described(model, "3").texts
    root = ET.fromstring(texts["modelDescription.xml"])
    units = [v.attrib["unit"] for v in root.iter("Float64") if v.attrib["causality"] == "input"]
    assert units == [
        *("m", "N m", "N"), *("m/s", "N m/s", "N/s"), *("m/s2", "N m/s2", "N/s2"), *("m/s3", "N m/s3", "N/s3")
    ]  # fmt: skip
    assert set(units) <= {unit.attrib["name"] for unit in root.iter("Unit")}


def test_inputs_of_sections_have_their_units(two: Reduction) -> None:
    texts = fmu_contents(two.system, read_scene(two.system, "system"), "boom", "3").texts
    root = ET.fromstring(texts["modelDescription.xml"])
    given = {v.attrib["name"]: v.attrib for v in root.iter("Float64") if v.attrib["causality"] == "input"}
    units = {name: has["unit"] for name, has in given.items() if "_rate" not in name}
    assert units == {
        "s_fly": "m", "base_gravity": "m/s2", "fly_tip_force": "N", "fly_gravity": "m/s2", "fly_extension": "m/s2",
    }  # fmt: skip
    assert [given[f"fly_extension_rate{order}"]["unit"] for order in ("", "_2", "_3")] == ["m/s3", "m/s4", "m/s5"]
    low, high = two.system.ranges["fly"]
    assert (float(given["s_fly"]["min"]), float(given["s_fly"]["max"])) == (low, high)


@pytest.mark.parametrize("noise", [0.0, 1e-25])
def test_a_contact_that_gives_way_by_round_off_leaves_no_differential_equation(noise: float) -> None:
    assert not Drivers.of(nested.with_round_off(noise)).is_differential
    assert Drivers.of(nested.reduced(nested.Nested(2, elements=8, compliance=0.0), 3)).is_differential


@pytest.mark.slow
def test_a_body_without_contacts_or_paths_is_a_system_too(two: Reduction, tmp_path: Path) -> None:
    """A clamped section by itself, under its weight."""
    base = two.reduced["base"].without_joints()
    system, stepping = System({"base": base}, ()), TimeStepping(0.02, STEP, 0.8)
    weight = read_scene(two.system, "system").excitation.loads["base.gravity"]
    driven = Excitation({}, {"base.gravity": weight}, stepping, start="equilibrium")
    scene = StoredScene("base", driven, np.array([9.81]))
    instance = Instance(loaded(fmu_contents(system, scene, "base", "3"), tmp_path, "3"))
    (moved,) = [[name for name in instance.library.named("output") if name.endswith("tip_z")]]
    instance.initialise()
    assembly = Assembly(system)
    q = np.linalg.solve(assembly.K.toarray(), assembly.B.toarray() @ [9.81])
    sag = (assembly.outputs @ q + assembly.direct @ [9.81])[-1]
    assert instance.get(moved) == pytest.approx([sag], rel=1e-9)
    instance.step(0.0, 20 * STEP)
    assert instance.get(moved) == pytest.approx([sag], rel=1e-9)


@pytest.mark.slow
def test_pads_with_a_clearance_find_where_they_lie(tmp_path: Path) -> None:
    """All of them closed would pull, and all of them open hold nothing."""
    wide = tuple(f"section.joint.{ring}.0.clearance=2e-3" for ring in RINGS)
    system = pmr.reduce(pmr.load_scene("boom_two", [*BOOM, *wide, "time.end=0.01"])).system
    scene = read_scene(system, "system")
    expected = equilibrium(Assembly(system), side_positions(system, scene.excitation)[0], scene.first_loads)
    instance = Instance(loaded(fmu_contents(system, scene, "boom", "3"), tmp_path, "3"))
    instance.initialise()
    forces = instance.get([name for name in instance.library.named("output") if name.startswith("force_of")])
    assert 0 < np.count_nonzero(expected.closed[:-1]) < len(forces) - 1
    np.testing.assert_allclose(forces[:-1], expected.forces[:-1], rtol=0.0, atol=1e-6 * np.abs(expected.forces).max())


def test_what_a_file_does_not_hold_is_said_in_one_line(two: Reduction) -> None:
    scene = two.system.provenance["scene"]
    file = {"kind": "table", "file": "/etc/passwd"}
    (fly,) = (part for part in scene["sections"] if part["name"] == "fly")
    others = [part for part in scene["sections"] if part["name"] != "fly"]
    for wrong, said in (
        ({}, "this one has none"),
        ({"scene": {**scene, "sections": others}}, "provenance.scene"),
        ({"scene": {**scene, "sections": [*others, {**fly, "name": "another"}]}}, "provenance.scene"),
        ({"scene": {**scene, "time": {**scene["time"], "end": 1e8}}}, "steps"),
        ({"scene": {**scene, "sections": [*others, {**fly, "joint": {**fly["joint"], "extension": file}}]}}, "numbers"),
    ):
        with pytest.raises(InputError, match=rf"system.npz: provenance.scene.*{said}|system.npz: {said}") as refused:
            read_scene(replace(two.system, provenance=wrong), "system.npz")
        assert "\n" not in str(refused.value)


def test_a_section_whose_mesh_is_in_a_file_needs_no_such_file(two: Reduction) -> None:
    scene = two.system.provenance["scene"]
    sections = [{**part, "mesh": {"file": "elsewhere.msh"}} for part in scene["sections"]]
    system = replace(two.system, provenance={"scene": {**scene, "sections": sections}})
    found, expected = (read_scene(one, "system.npz").excitation for one in (system, two.system))
    np.testing.assert_array_equal(found.s, expected.s)
    np.testing.assert_array_equal(found.f, expected.f)
